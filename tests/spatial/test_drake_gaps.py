"""What Drake's own tests leave out of shift, dot and comparison, held through naive NumPy and exact rationals.

NaN and infinities in every slot, zero offsets, batches of every shape with an offset per column, that shifts add up and
that power stays the same within a bound, and derivatives. The numbers of Drake's tests are in test_drake_properties.py,
the error bounds in laws/. What rotations and inertias have to do with a shift is in inertia/test_inertia.py.
"""

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import drake_oracle as oracle
from tests.helpers.drake_oracle import (
    assert_parts,
    assert_same_bits,
    assert_within,
    every_kind,
    every_precision,
    every_program,
    every_way,
    offsets_of,
    random_shift,
)
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

FORCES = pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum])
INFINITIES = [np.nan, np.inf, -np.inf]


@pytest.fixture(params=[np.float32, slow(np.float64)], ids=["x32", "x64"])
def dtype(request):
    with jax.enable_x64(request.param is np.float64):
        yield request.param


def parts_of(x):
    return np.asarray(x.rotational), np.asarray(x.translational)


# -- comparison: NaN is near nothing ----------------------------------------------------------------------------------


def spoiled(kind, dtype, value):
    """Six equal vectors, and the same with `value` in slot i of the i-th."""
    six = np.tile(np.arange(1, 7, dtype=dtype), (6, 1))
    other = six.copy()
    np.fill_diagonal(other, value)
    return kind.from_array(six), kind.from_array(other)


@every_kind
@every_program
def test_nan_in_any_slot_of_either_is_near_nothing_at_any_tolerance(kind, way, dtype):
    x, y = spoiled(kind, dtype, np.nan)
    near, approx = way(kind.is_nearly_equal_within_absolute_tolerance), way(kind.is_approx)
    differences = way(kind.get_maximum_absolute_differences)
    for a, b in ((x, y), (y, x), (y, y)):
        for tolerance in (dtype(0), np.finfo(dtype).max, dtype(np.inf)):
            assert_same_bits(near(a, b, tolerance, tolerance), np.zeros(6, bool))
            assert_same_bits(approx(a, b, tolerance), np.zeros(6, bool))
        assert_same_bits(approx(a, b), np.zeros(6, bool))
        rotational, translational = differences(a, b)
        assert_same_bits(rotational, np.array([np.nan] * 3 + [0] * 3, dtype))
        assert_same_bits(translational, np.array([0] * 3 + [np.nan] * 3, dtype))


@every_kind
def test_nan_is_near_nothing_in_a_single_vector_either(kind, dtype):
    x, y = spoiled(kind, dtype, np.nan)
    for slot in range(6):
        a, b = kind.from_array(x.to_array()[slot]), kind.from_array(y.to_array()[slot])
        assert not a.is_approx(b, np.inf) and not b.is_approx(a, np.inf) and not b.is_approx(b, np.inf)


@every_kind
@every_program
@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_an_infinity_is_not_near_a_number_at_any_finite_tolerance(kind, way, value, dtype):
    x, y = spoiled(kind, dtype, value)
    for a, b in ((x, y), (y, x)):
        assert_same_bits(way(kind.is_approx)(a, b, np.finfo(dtype).max), np.zeros(6, bool))
        rotational, translational = way(kind.get_maximum_absolute_differences)(a, b)
        assert_same_bits(rotational, np.array([np.inf] * 3 + [0] * 3, dtype))
        assert_same_bits(translational, np.array([0] * 3 + [np.inf] * 3, dtype))


@every_kind
@every_program
def test_comparison_answers_for_every_vector_of_the_batch(kind, way, dtype):
    """One vector against six, of which the i-th is i + 1 away in slot i."""
    six = np.arange(1, 7, dtype=dtype)
    x, moved = kind.from_array(six), kind.from_array(six + np.diag(six))
    rotational, translational = way(kind.get_maximum_absolute_differences)(x, moved)
    assert_same_bits(rotational, np.array([1, 2, 3, 0, 0, 0], dtype))
    assert_same_bits(translational, np.array([0, 0, 0, 4, 5, 6], dtype))
    near = way(kind.is_nearly_equal_within_absolute_tolerance)(x, moved, dtype(2), dtype(4))
    assert_same_bits(near, np.array([True, True, False, True, False, False]))
    assert_same_bits(way(kind.is_approx)(x, moved, dtype(4)), np.array([True, True, True, True, False, False]))


# -- shift: zero, NaN and infinite offsets ----------------------------------------------------------------------------


@every_kind
@every_way
@every_precision
def test_shift_by_zero_changes_nothing(kind, way, precision, dtype):
    x, (p, *w) = random_shift(kind, dtype)
    shift = way(lambda x, *offsets: js.shift(x, *offsets, precision=precision))
    assert_parts(shift(x, np.zeros_like(p), *w), *parts_of(x))


@every_kind
@pytest.mark.parametrize("value", INFINITIES)
def test_zero_known_while_tracing_changes_nothing_beside_nan_or_infinity(kind, value, dtype):
    x = kind(*(np.full(3, value, dtype) for _ in range(2)))
    assert_parts(jax.jit(lambda x: js.shift(x, *np.zeros((offsets_of(kind), 3), dtype)))(x), *parts_of(x))


@every_kind
@every_way
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize("value", INFINITIES)
def test_nan_and_infinity_in_any_number_go_where_the_formula_takes_them(kind, way, value, dtype):
    """A batch with `value` in one number each, of the vector and of what shifts it; a zero offset is among them."""
    numbers = 6 + 3 * offsets_of(kind)
    rows = np.concatenate([np.tile(np.arange(1, numbers + 1, dtype=dtype), (numbers, 1))] * 2)
    rows[numbers:, 6:] = 0
    rows[np.arange(2 * numbers), np.tile(np.arange(numbers), 2)] = value
    rotational, translational, *offsets = np.split(rows, numbers // 3, axis=-1)
    shifted = way(js.shift)(kind(rotational, translational), *offsets)
    expected = oracle.shifted(kind, rotational, translational, *offsets)
    for part, expected_part in zip(parts_of(shifted), expected, strict=True):
        np.testing.assert_array_equal(part, expected_part)


# -- shift and dot: batches -------------------------------------------------------------------------------------------


@every_kind
@every_way
@pytest.mark.parametrize("shape", [(3,), (0, 3), (1, 3), (2, 0, 3), (3, 1, 2, 3)], ids=str)
def test_shift_takes_any_batch_with_an_offset_for_each(kind, way, shape, dtype):
    x, offsets = random_shift(kind, dtype, shape)
    assert_parts(way(js.shift)(x, *offsets), *oracle.shifted(kind, *parts_of(x), *offsets))


@every_kind
@every_way
@pytest.mark.parametrize("shapes", [((4, 3), (3,)), ((3,), (4, 3)), ((4, 1, 3), (5, 3)), ((0, 3), (1, 3))], ids=str)
def test_shift_broadcasts_vectors_against_offsets(kind, way, shapes, dtype):
    x, offsets = random_shift(kind, dtype, *shapes)
    full = np.broadcast_shapes(*shapes)
    everything = [np.broadcast_to(part, full) for part in (*parts_of(x), *offsets)]
    assert_parts(way(js.shift)(x, *offsets), *oracle.shifted(kind, *everything))


@every_kind
@pytest.mark.parametrize("n", [0, 1, 5])
def test_different_offsets_shift_each_column_as_if_alone(kind, n, dtype):
    x, offsets = random_shift(kind, dtype, (n, 3))
    shifted = js.shift(x, *offsets)
    assert_parts(jax.vmap(js.shift)(x, *offsets), *parts_of(shifted))
    for i in range(n):
        alone = js.shift(*jax.tree.map(lambda leaf, i=i: leaf[i], (x, *offsets)))
        assert_parts(alone, shifted.rotational[i], shifted.translational[i])


@FORCES
@every_way
@pytest.mark.parametrize("shapes", [((0, 3),) * 2, ((1, 3),) * 2, ((2, 0, 3),) * 2, ((4, 1, 3), (5, 3))], ids=str)
def test_dot_takes_any_batch(kind, way, shapes, dtype):
    x = kind(*oracle.random_vectors(7, 2, shapes[0], dtype))
    V = js.SpatialVelocity(*oracle.random_vectors(8, 2, shapes[1], dtype))
    assert_same_bits(way(js.dot)(x, V), oracle.dot(*parts_of(x), *parts_of(V)))


@every_kind
@pytest.mark.parametrize("batch_shape", [(0,), (1,), (2, 0)])
def test_arithmetic_and_comparison_take_empty_batches_and_batches_of_one(kind, batch_shape, dtype):
    x = kind(*oracle.random_vectors(9, 2, (*batch_shape, 3), dtype))
    assert_parts(2 * x - x + -x, *[np.zeros_like(part) for part in parts_of(x)])
    assert_same_bits(x.is_approx(x), np.ones(batch_shape, bool))
    for difference in x.get_maximum_absolute_differences(x):
        assert_same_bits(difference, np.zeros(batch_shape, dtype))


@every_kind
def test_float32_stays_float32_where_64_bits_are_on(kind):
    with jax.enable_x64(True):
        x, offsets = random_shift(kind, np.float32)
        for way in oracle.WAYS.values():
            assert_parts(way(js.shift)(x, *offsets), *oracle.shifted(kind, *parts_of(x), *offsets))
            assert_parts(way(lambda x: 2 * x - x)(x), *parts_of(x))


# -- shifts add up, power stays the same ------------------------------------------------------------------------------


@every_kind
@every_way
@every_precision
def test_shift_by_a_then_b_is_shift_by_their_sum(kind, way, precision, dtype):
    """To c u M, M the magnitude of a shift by |a| + |b|: three shifts err by 3 u M each, 7 for an acceleration, the sum
    of the offsets by u of it, so c = 3 + 3 + 3 + 1 = 10, or 22."""
    x, (a, *w) = random_shift(kind, dtype)
    (b,) = oracle.random_vectors(11, 1, a.shape, dtype)

    def both(x, a, b, *w):
        in_steps = js.shift(js.shift(x, a, *w, precision=precision), b, *w, precision=precision)
        return in_steps, js.shift(x, a + b, *w, precision=precision)

    in_steps, at_once = way(both)(x, a, b, *w)
    magnitudes = oracle.shift_magnitudes(kind, *parts_of(x), abs(a) + abs(b), *w)
    bound = (22 if kind is js.SpatialAcceleration else 10) * oracle.unit_roundoff(dtype)
    for one, other, magnitude in zip(parts_of(in_steps), parts_of(at_once), magnitudes, strict=True):
        assert_within(one, oracle.exactly(other), bound * magnitude)


@every_kind
@every_way
def test_shifts_of_integers_add_up_exactly(kind, way, dtype):
    integers = np.random.default_rng(12).integers(-20, 21, (5, 50, 3)).astype(dtype)
    rotational, translational, a, b, w = integers
    w = [w] if kind is js.SpatialAcceleration else []
    x = kind(rotational, translational)
    in_steps = way(lambda x, a, b, *w: js.shift(js.shift(x, a, *w), b, *w))(x, a, b, *w)
    oracle.assert_numbers(in_steps, *parts_of(interpreted(js.shift)(x, a + b, *w)))


@FORCES
@every_way
@every_precision
def test_power_stays_the_same_when_both_are_shifted(kind, way, precision, dtype):
    """To 11 u M, M = |tau'| . |w| + |f| . |v'| with the magnitudes of the shifted parts: 4 u M for either power, 3 u M
    for the two shifts."""
    (tau, f, w, v), (p,) = oracle.random_vectors(13, 4, (200, 3), dtype), oracle.random_vectors(14, 1, (200, 3), dtype)
    x, V = kind(tau, f), js.SpatialVelocity(w, v)

    def power_about_q(x, V, p):
        shifted = (js.shift(moved, p, precision=precision) for moved in (x, V))
        return js.dot(*shifted, precision=precision)

    here = interpreted(lambda x, V: js.dot(x, V, precision=precision))(x, V)
    there = way(power_about_q)(x, V, p)
    about_q = oracle.shift_magnitudes(kind, tau, f, p)[0], f, w, oracle.shift_magnitudes(js.SpatialVelocity, w, v, p)[1]
    bound = 11 * oracle.unit_roundoff(dtype) * oracle.dot_magnitude(*about_q)
    assert_within(there, oracle.exactly(here), bound)


# -- derivatives ------------------------------------------------------------------------------------------------------


def skew(a):
    """[a] with [a] b = a x b."""
    return np.cross(a, np.eye(3, dtype=a.dtype)).T


DERIVATIVES = pytest.mark.parametrize("jacobian", [jax.jacfwd, jax.jacrev], ids=["forward", "reverse"])


@every_precision
@DERIVATIVES
def test_derivatives_of_shifts_are_the_matrices_of_the_cross_product(jacobian, precision, dtype):
    """tau' = tau - [p] f = tau + [f] p,  v' = v - [p] w = v + [w] p, and a' = a - [p] alpha + [w][w] p + [alpha] p.

    Of small integers, hence exact.
    """
    rotational, translational, p, w = np.array([(1, 2, 3), (4, -5, 6), (7, 3, -5), (-2, 8, 1)], dtype)
    one, none = np.eye(3, dtype=dtype), np.zeros((3, 3), dtype)

    def matrices(kind, *offsets):
        function = jacobian(lambda x, p: js.shift(x, p, *offsets, precision=precision), argnums=(0, 1))
        of = interpreted(function)(kind(rotational, translational), p)
        (by_x, by_p) = of.rotational, of.translational
        return [np.asarray(m) for row in (by_x, by_p) for m in (row[0].rotational, row[0].translational, row[1])]

    def assert_all(found, expected):
        for matrix, expected_matrix in zip(found, expected, strict=True):
            np.testing.assert_array_equal(matrix, expected_matrix, strict=True)

    for kind in (js.SpatialForce, js.SpatialMomentum):
        assert_all(matrices(kind), (one, -skew(p), skew(translational), none, one, none))
    assert_all(matrices(js.SpatialVelocity), (one, none, none, -skew(p), one, skew(rotational)))
    by_p = skew(rotational) + skew(w) @ skew(w)
    assert_all(matrices(js.SpatialAcceleration, w), (one, none, none, -skew(p), one, by_p))


@FORCES
@every_precision
@DERIVATIVES
def test_derivatives_of_power_are_the_other_vector(kind, jacobian, precision, dtype):
    parts = oracle.random_vectors(15, 4, (3,), dtype)
    x, V = kind(*parts[:2]), js.SpatialVelocity(*parts[2:])
    by_x, by_V = interpreted(jacobian(lambda x, V: js.dot(x, V, precision=precision), argnums=(0, 1)))(x, V)
    assert_parts(by_x, *parts_of(V))
    assert_parts(by_V, *parts_of(x))
