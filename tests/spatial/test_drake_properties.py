"""What Drake's own tests assert of spatial velocity, acceleration, force and momentum, held through naive NumPy.

Drake computes both sides of an assertion with the same instructions and gets them equal. Our default precision promises
the bits of the same formula in NumPy, so that equality is asked for here too, eager, compiled and in a batch, in
float32 and float64; beside it stand Drake's hand-checked numbers, which are integers and come out exact.

Re-expression by a rotation is in rotation/, inertia in inertia/. Composition with a moving frame is an operation of the
table that laws/ runs over. What Drake leaves out (NaN, infinities, batches, bounds) is in test_drake_gaps.py.
"""

import copy
import functools
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import drake_oracle as oracle
from tests.helpers.drake_oracle import (
    assert_numbers,
    assert_parts,
    assert_same_bits,
    every_kind,
    every_program,
    every_way,
    random_shift,
)
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

# Drake's fixture.
ROTATIONAL, TRANSLATIONAL = (0, 0, 3), (1, 2, 0)
FIRST = ((1, 2, 3), (4, 5, 6))
SECOND = ((-1, 1.5, -0.5), (5, 7, 8))


@pytest.fixture(params=[np.float32, slow(np.float64)], ids=["x32", "x64"])
def dtype(request):
    with jax.enable_x64(request.param is np.float64):
        yield request.param


def make(kind, parts, dtype):
    return kind(*(np.asarray(part, dtype) for part in parts))


# -- all four kinds ---------------------------------------------------------------------------------------------------


@every_kind
def test_size_is_six_whatever_the_batch(kind, dtype):
    assert make(kind, FIRST, dtype).size == kind.zero(dtype=dtype).size == kind.zero((2, 5), dtype).size == 6


@every_kind
@pytest.mark.parametrize("batch_shape", [(), (1,), (3, 2)])
@pytest.mark.parametrize(("name", "value"), [("zero", 0.0), ("nan", np.nan)])
def test_zero_and_nan_fill_all_six(kind, batch_shape, name, value, dtype):
    x = getattr(kind, name)(batch_shape, dtype)
    assert_parts(x, *[np.full((*batch_shape, 3), value, dtype)] * 2)
    assert x.batch_shape == batch_shape


@every_kind
def test_parts_are_what_was_passed_under_drakes_names(kind, dtype):
    rotational, translational = (np.asarray(part, dtype) for part in FIRST)
    names = oracle.FIELDS[kind]
    for x in (kind(rotational, translational), kind(**dict(zip(names, (rotational, translational), strict=True)))):
        assert_parts(x, rotational, translational)
        assert_parts(x, *(getattr(x, name) for name in names))


@every_kind
@pytest.mark.parametrize("of", [np.asarray, jnp.asarray])
def test_six_coefficients_are_rotational_then_translational(kind, of, dtype):
    six = of(np.arange(1, 7, dtype=dtype))
    x = kind.from_array(six)
    assert_parts(x, *np.split(np.asarray(six), 2))
    assert_same_bits(x.to_array(), six)


@every_kind
def test_six_coefficients_may_be_a_block_of_a_larger_array(kind, dtype):
    table = np.arange(84, dtype=dtype).reshape(12, 7)
    for block in (table[3:9, 2], table[::2, 0], table[::-2, 1], table.T[4, 6:]):
        assert_same_bits(kind.from_array(block).to_array(), block)


@every_kind
def test_what_is_written_to_a_component_is_read_from_it(kind, dtype):
    x = make(kind, FIRST, dtype)
    for i in range(6):
        written = kind.from_array(x.to_array().at[i].set(10.5 + i))
        assert [float(written[j]) for j in range(6)] == [10.5 + j if j == i else float(x[j]) for j in range(6)]


@every_kind
def test_a_vector_keeps_its_numbers_when_the_callers_array_changes(kind, dtype):
    six = np.arange(6, dtype=dtype)
    x = kind.from_array(six)
    six[:] = -1
    assert_numbers(x, (0, 1, 2), (3, 4, 5))


@every_kind
@every_program
@pytest.mark.parametrize("factor", [3, slow(3.0), -0.7, np.float32(1.1)], ids=repr)
def test_scaling_scales_both_parts_from_either_side(kind, way, factor, dtype):
    x, s = make(kind, FIRST, dtype), dtype(factor)
    python_number = factor if isinstance(factor, (int, float)) else s
    expected = [part * s for part in (x.rotational, x.translational)]
    for scaled in (lambda x: x * python_number, lambda x: python_number * x, lambda x: x * s, lambda x: s * x):
        assert_parts(way(scaled)(x), *expected)
    assert_parts(way(lambda x, s: s * x)(x, s), *expected)


@every_kind
@every_program
@pytest.mark.parametrize("scalar", [1.1, slow(-0.7)])
def test_division_divides_both_parts_and_rounds_once(kind, way, scalar, dtype):
    """Drake has none. A compiler likes to multiply by the reciprocal instead, which rounds twice."""
    x, s = kind(*oracle.random_vectors(4, 2, (200, 3), dtype)), dtype(scalar)
    expected = [part / s for part in (x.rotational, x.translational)]
    for divided in (lambda x: x / scalar, lambda x: x / s):
        assert_parts(way(divided)(x), *expected)
    assert_parts(way(lambda x, s: x / s)(x, s), *expected)


@every_kind
@every_program
def test_minus_negates_both_parts(kind, way, dtype):
    x = make(kind, (ROTATIONAL, TRANSLATIONAL), dtype)
    assert_parts(way(lambda x: -x)(x), -x.rotational, -x.translational)


@every_kind
@every_program
def test_sum_and_difference_go_component_by_component(kind, way, dtype):
    x, y = make(kind, FIRST, dtype), make(kind, SECOND, dtype)
    assert_parts(way(lambda x, y: x + y)(x, y), x.rotational + y.rotational, x.translational + y.translational)
    assert_parts(way(lambda x, y: x - y)(x, y), x.rotational - y.rotational, x.translational - y.translational)


@every_kind
def test_assignment_operators_name_a_new_vector_and_leave_the_old(kind, dtype):
    x, y = make(kind, FIRST, dtype), make(kind, SECOND, dtype)
    z = x
    z += y
    z *= 3
    z -= y
    expected = [(a + b) * 3 - b for a, b in ((x.rotational, y.rotational), (x.translational, y.translational))]
    assert_parts(z, *expected)
    assert_numbers(x, *FIRST)


@every_kind
def test_repr_has_the_numbers_in_order_and_makes_the_vector_again(kind, dtype):
    x = make(kind, (ROTATIONAL, TRANSLATIONAL), dtype)
    rotational, translational = oracle.FIELDS[kind]
    assert repr(x) == f"{kind.__name__}({rotational}=[0.0, 0.0, 3.0], {translational}=[1.0, 2.0, 0.0])"
    for y in (x, make(kind, SECOND, dtype) / dtype(3)):
        assert_parts(eval(repr(y), vars(js).copy()), y.rotational, y.translational)


@every_kind
def test_repr_of_what_is_not_computed_yet_has_the_names_in_order(kind, dtype):
    shown = []
    jax.jit(lambda x: shown.append(repr(x)))(make(kind, FIRST, dtype))
    rotational, translational = oracle.FIELDS[kind]
    leaf = f"{np.dtype(dtype).name}[3]"
    assert shown == [f"{kind.__name__}({rotational}={leaf}, {translational}={leaf})"]


@every_kind
@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_copies_and_pickles_keep_kind_and_numbers(kind, copied, dtype):
    for x in (make(kind, FIRST, dtype), jax.tree.map(jnp.asarray, make(kind, SECOND, dtype))):
        y = copied(x)
        assert type(y) is kind
        assert_parts(y, x.rotational, x.translational)


# -- comparison, with Drake's numbers ---------------------------------------------------------------------------------


def displaced(kind, dtype):
    """Two vectors 2.2 eps (rotational) and 4.4 eps (translational) apart, and these two displacements.

    Rounded to the numbers near 1.1 to 9.9 they become 2 eps, and 8 or 4 eps.
    """
    eps = np.finfo(dtype).eps
    rotational, translational = np.asarray((1.1, 2.2, -3.3), dtype), np.asarray((9.9, 8.8, -7.7), dtype)
    signs = np.asarray((1, -1, 1), dtype)
    moved = kind(rotational + dtype(2.2) * eps * signs, translational - dtype(4.4) * eps * signs)
    return kind(rotational, translational), moved, float(2.2 * eps), float(4.4 * eps)


@every_kind
@every_program
def test_maximum_absolute_differences_are_of_the_size_of_the_displacement(kind, way, dtype):
    x, y, rotational, translational = displaced(kind, dtype)
    largest = way(kind.get_maximum_absolute_differences)(x, y)
    assert_same_bits(largest[0], abs(x.rotational - y.rotational).max())
    assert_same_bits(largest[1], abs(x.translational - y.translational).max())
    assert 0.25 * rotational < largest[0] < 4 * rotational
    assert 0.25 * translational < largest[1] < 4 * translational


@every_kind
@every_program
def test_nearly_equal_within_four_times_the_displacement_and_not_within_a_quarter(kind, way, dtype):
    x, y, rotational, translational = displaced(kind, dtype)

    def near(factor_rotational, factor_translational):
        tolerances = np.asarray((factor_rotational * rotational, factor_translational * translational), dtype)
        return way(kind.is_nearly_equal_within_absolute_tolerance)(x, y, *tolerances)

    assert near(4, 4)
    assert not near(0.25, 0.25)
    assert not near(4, 0.25)
    assert not near(0.25, 4)


@every_kind
@every_program
def test_nearly_equal_includes_the_tolerance_itself(kind, way, dtype):
    x, y, *_ = displaced(kind, dtype)
    near = way(kind.is_nearly_equal_within_absolute_tolerance)
    rotational, translational = (np.asarray(d) for d in x.get_maximum_absolute_differences(y))
    assert near(x, y, rotational, translational)
    assert not near(x, y, np.nextafter(rotational, dtype(0)), translational)
    assert not near(x, y, rotational, np.nextafter(translational, dtype(0)))


@every_kind
@every_program
def test_is_approx_measures_absolutely(kind, way, dtype):
    """Against itself times 1 + d the largest difference is 3 d, within (3 + a little) d and not within d."""
    d, a_little = (1e-10, 1e-6) if dtype is np.float64 else (1e-4, 1e-2)
    x = make(kind, (ROTATIONAL, TRANSLATIONAL), dtype)
    y = x * (1 + d)
    assert way(lambda x, y: x.is_approx(y, (3 + a_little) * d))(x, y)
    assert not way(lambda x, y: x.is_approx(y, d))(x, y)


@every_kind
@every_program
def test_is_approx_allows_one_eps_if_nothing_is_said(kind, way, dtype):
    """Beside 1, numbers are eps apart."""
    ones = np.ones(3, dtype)
    next_ones = np.nextafter(ones, dtype(2))
    after_those = np.nextafter(next_ones, dtype(2))
    is_approx = way(kind.is_approx)
    assert is_approx(kind(ones, ones), kind(next_ones, next_ones))
    assert not is_approx(kind(ones, ones), kind(ones, after_those))
    assert not is_approx(kind(ones, ones), kind(after_those, ones))


# -- shift: numbers worked out by hand, then the bits of NumPy --------------------------------------------------------

_SHIFTED_BY_HAND = {
    # w x p = 3z x (2, -2, 0) = (6, 6, 0), added to (1, 2, 0)
    "velocity": (js.SpatialVelocity, (0, 0, 3), (1, 2, 0), (2, -2, 0), None, (0, 0, 3), (7, 8, 0)),
    # p x f = (2, -2, 1) x (1, 2, 0) = (-2, 1, 6), taken from (0, 0, 3)
    "force": (js.SpatialForce, (0, 0, 3), (1, 2, 0), (2, -2, 1), None, (2, -1, -3), (1, 2, 0)),
    "momentum": (js.SpatialMomentum, (0, 0, 3), (1, 2, 0), (2, -2, 1), None, (2, -1, -3), (1, 2, 0)),
    # w x (w x p) = -9 p for p across w
    "centrifugal": (js.SpatialAcceleration, (0, 0, 0), (0, 0, 0), (1, 1, 0), (0, 0, 3), (0, 0, 0), (-9, -9, 0)),
    # p along w: nothing but alpha x p = 2y x z = 2x
    "along the axis": (js.SpatialAcceleration, (0, 2, 0), (0, 0, 0), (0, 0, 1), (0, 0, 3), (0, 2, 0), (2, 0, 0)),
    # 1.5y + 2y x (1, 1, 0) - 9 (1, 1, 0) = (-9, -7.5, -2)
    "all terms": (js.SpatialAcceleration, (0, 2, 0), (0, 1.5, 0), (1, 1, 0), (0, 0, 3), (0, 2, 0), (-9, -7.5, -2)),
    # without w only alpha x p = -2z is left
    "not turning": (js.SpatialAcceleration, (0, 2, 0), (0, 1.5, 0), (1, 1, 0), (0, 0, 0), (0, 2, 0), (0, 1.5, -2)),
}


@every_way
@pytest.mark.parametrize("case", _SHIFTED_BY_HAND.values(), ids=_SHIFTED_BY_HAND.keys())
def test_shift_gives_the_numbers_worked_out_by_hand(case, way, dtype):
    kind, rotational, translational, p, w, *expected = case
    x = make(kind, (rotational, translational), dtype)
    offsets = [np.asarray(o, dtype) for o in (p, w) if o is not None]
    assert_numbers(way(js.shift)(x, *offsets), *expected)
    assert_numbers(way(kind.shift)(x, *offsets), *expected)


@every_kind
@every_way
def test_shift_has_the_bits_of_the_formula_in_numpy(kind, way, dtype):
    x, offsets = random_shift(kind, dtype)
    expected = oracle.shifted(kind, x.rotational, x.translational, *offsets)
    assert_parts(way(js.shift)(x, *offsets), *expected)
    assert_parts(way(jax.vmap(js.shift))(x, *offsets), *expected)


@every_kind
@every_way
def test_one_offset_for_many_columns_shifts_each_as_if_alone(kind, way, dtype):
    """Drake's static Shift of a 6 x n matrix; Drake's test has three equal columns, here they differ."""
    x, offsets = random_shift(kind, dtype, (3, 3))
    offsets = [o[0] for o in offsets]
    columns = jax.vmap(js.shift, in_axes=(0, *[None] * len(offsets)))
    shifted = way(columns)(x, *offsets)
    assert_parts(shifted, *oracle.shifted(kind, x.rotational, x.translational, *(o[None] for o in offsets)))
    for i in range(3):
        alone = js.shift(kind(x.rotational[i], x.translational[i]), *offsets)
        assert_parts(alone, shifted.rotational[i], shifted.translational[i])


@every_kind
def test_equal_columns_stay_equal(kind, dtype):
    x = make(kind, [[part] * 3 for part in (ROTATIONAL, TRANSLATIONAL)], dtype)
    offsets = [np.asarray(o, dtype) for o in ((2, -2, 1), (0.3, 0.1, -7))][: oracle.offsets_of(kind)]
    shifted = js.shift(x, *offsets)
    assert_parts(shifted, *([part[0]] * 3 for part in (shifted.rotational, shifted.translational)))


@every_kind
def test_shift_in_place_there_and_back_returns_the_matrix(kind, dtype):
    """Drake's ShiftInPlace is a compiled shift that is given its input; integers come back exactly."""
    x = jax.tree.map(jnp.asarray, make(kind, [[part] * 3 for part in (ROTATIONAL, TRANSLATIONAL)], dtype))
    offsets = [np.asarray([o] * 3, dtype) for o in ((2, -2, 1), (0, 0, 3))][: oracle.offsets_of(kind)]
    in_place = jax.jit(js.shift, donate_argnums=0)
    there = in_place(x, *offsets)
    with pytest.raises(RuntimeError, match="deleted"):
        _ = x.rotational + 0
    assert_numbers(in_place(there, -offsets[0], *offsets[1:]), [ROTATIONAL] * 3, [TRANSLATIONAL] * 3)


# -- acceleration: the second derivative of a moving point ------------------------------------------------------------


def skew(w):
    x, y, z = w
    return jnp.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(turning, t):
    return jax.scipy.linalg.expm(skew(turning[0] + turning[1] * t + turning[2] * t**2))


def derivative(function):
    return lambda t: jax.jvp(function, (t,), (jnp.ones_like(t),))[1]


def angular_velocity(turning, t):
    """w of dR/dt = [w] R."""
    rate = derivative(functools.partial(rotation, turning))(t) @ rotation(turning, t).T
    return jnp.stack([rate[2, 1], rate[0, 2], rate[1, 0]])


@jax.vmap
def shifted_and_differentiated(turning, path, p_PQ_B):
    """The acceleration of point Q of a body, by shifting that of its point P, and by differentiating its path twice.

    P follows path(t), the body turns by R(t) = expm [turning(t)] about it, and Q is at path(t) + R(t) p_PQ_B.
    """

    def r_P(t):
        return path[0] * t + path[1] * t**2 + path[2] * t**3

    def r_Q(t):
        return r_P(t) + rotation(turning, t) @ p_PQ_B

    t = jnp.array(0.7)
    w_of = functools.partial(angular_velocity, turning)
    w, alpha, a = w_of(t), derivative(w_of)(t), derivative(derivative(r_P))(t)
    p_PQ_E = rotation(turning, t) @ p_PQ_B
    shifted = js.shift(js.SpatialAcceleration(alpha, a), p_PQ_E, w)
    return shifted, derivative(derivative(r_Q))(t), (alpha, a, p_PQ_E, w)


def test_shifted_acceleration_is_the_second_derivative_of_the_path_of_the_point():
    """What Drake's tests have as a TODO. To 40 u mag in float64: 7 for the shift, the rest for the exponential's."""
    with jax.enable_x64(True):
        rng = np.random.default_rng(2)
        motions = rng.normal(size=(20, 3, 3)), rng.normal(size=(20, 3, 3)), rng.normal(size=(20, 3))
        shifted, expected, terms = interpreted(shifted_and_differentiated)(*motions)
        assert_same_bits(shifted.rotational, terms[0])
        _, magnitude = oracle.shift_magnitudes(js.SpatialAcceleration, *terms)
        assert (abs(np.asarray(shifted.translational - expected)) <= 40 * oracle.unit_roundoff(float) * magnitude).all()


# -- power and kinetic energy -----------------------------------------------------------------------------------------


@every_way
@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum])
def test_dot_is_the_number_worked_out_by_hand_both_ways_round(kind, way, dtype):
    """(4, 1, -3) . (1, 2, 3) + (11, 9, -2) . (-2, -5, 8) = (4 + 2 - 9) + (-22 - 45 - 16) = -86"""
    x = make(kind, ((4, 1, -3), (11, 9, -2)), dtype)
    V = make(js.SpatialVelocity, ((1, 2, 3), (-2, -5, 8)), dtype)
    for power in (way(js.dot)(x, V), way(js.dot)(V, x), way(kind.dot)(x, V), way(js.SpatialVelocity.dot)(V, x)):
        assert_same_bits(power, dtype(-86))


@every_way
@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum])
def test_dot_has_the_bits_of_the_sums_in_numpy_both_ways_round(kind, way, dtype):
    parts = oracle.random_vectors(3, 4, (200, 3), dtype)
    x, V = kind(*parts[:2]), js.SpatialVelocity(*parts[2:])
    for order in ((x, V), (V, x)):
        assert_same_bits(way(js.dot)(*order), oracle.dot(*parts))
        assert_same_bits(way(jax.vmap(js.dot))(*order), oracle.dot(*parts))


@every_way
@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum])
def test_dot_does_not_change_when_both_are_shifted(kind, way, dtype):
    """Integers, hence exactly. (1, 2, 3) . (7, 8, 9) + (4, 5, 6) . (-1, -2, -3) = 50 - 32 = 18"""
    x, V = make(kind, FIRST, dtype), make(js.SpatialVelocity, ((7, 8, 9), (-1, -2, -3)), dtype)
    p = np.asarray((7, -3, 5), dtype)
    moved = js.shift(x, p)
    # p x (4, 5, 6) = (-18 - 25, 20 - 42, 35 + 12) = (-43, -22, 47), taken from (1, 2, 3)
    assert_numbers(moved, (44, 24, -44), (4, 5, 6))
    assert_same_bits(way(lambda x, V, p: js.dot(js.shift(x, p), js.shift(V, p)))(x, V, p), dtype(18))
