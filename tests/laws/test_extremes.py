"""At the edges of the formats: overflow on the way, results beyond the largest number, subnormals, NaN and infinities;
and double words, which lose nothing on the way there and back.
"""

import functools
import itertools
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from jaxspatial.measure import error
from jaxspatial.measure.error import attribute, rationals, sized
from jaxspatial.measure.inputs import EXTREMES
from tests.helpers import hostile
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.operation import violations
from tests.helpers.operations import DTYPES, EXACT, OPERATIONS, of_sum

# Where intermediate results may overflow: all formats evaluated in a wider one, and whatever is faithful.
SAFE = [(dtype, precision) for dtype in DTYPES for precision in ("compensated", "faithful")]
SAFE.remove(("float64", "compensated"))
NAMES = ("shift_force", "shift_velocity", "dot_force_velocity", "cross_force")
N = 48
# By default in float32 all precisions of the first operation and one of the others; each other dtype in one or two.
ALL = list(itertools.product(DTYPES, js.Precision))
OF_OTHERS = [("float64", "reproducible"), ("float64", "faithful"), ("float16", "compensated"), ("bfloat16", "faithful")]
WIDE, SINGLE = (
    ("float32", "float64"),
    [("float32", "reproducible"), ("float32", "faithful"), ("float64", "compensated")],
)
FEW = [case for case in ALL if case[0] == "float32" or case in OF_OTHERS]
CASES = list(itertools.product([*NAMES, "shift_acceleration"], DTYPES, js.Precision))
USUAL = [case for case in CASES if (case[0] == NAMES[0] and case[1:] in FEW)]
USUAL += [(name, "float32", "compensated") for name in NAMES[1:]]

safe = pytest.mark.parametrize(("dtype", "precision"), SAFE)
precisions = pytest.mark.parametrize("precision", js.Precision)
few = pytest.mark.parametrize(("dtype", "precision"), slow_but(FEW, ALL))


def _results(case, precision, how="jit vmap"):
    if how == "op by op":
        return case.operation.op_by_op(*case.arrays, precision=precision)
    with jax.enable_x64(case.arrays[0].dtype == np.float64):
        return [np.asarray(x) for x in _compiled(case.operation.name, precision, how)(*map(jnp.asarray, case.arrays))]


@functools.cache
def _compiled(name, precision, how):
    """One function for all tests: arrays of one shape are compiled once."""
    return hostile.SURROUNDINGS[how](OPERATIONS[name].on_arrays(precision))


def _everywhere(case, precision):
    """Results by surroundings: of the first in all of them in float64, whose products overflow, else in batches."""
    is_wide = case.arrays[0].dtype == np.float64 and case.operation.name == NAMES[0]
    return {how: _results(case, precision, how) for how in (hostile.SURROUNDINGS if is_wide else ["jit vmap"])}


@functools.cache
def _extreme(name, family, dtype):
    arrays = hostile.arranged(name, EXTREMES[family], np.random.default_rng(17), N, dtype)
    return hostile.made(name, arrays)


# -- overflow ---------------------------------------------------------------------------------------------------------


@safe
@pytest.mark.parametrize("name", [NAMES[0], *map(slow, NAMES[1:])])
def test_products_that_overflow_on_the_way_do_not_matter(name, dtype, precision):
    case = _extreme(name, "near_overflow_of_products", dtype)
    for how, results in _everywhere(case, precision).items():
        case.check(precision, results, how, flushed=6)


@pytest.mark.parametrize(("name", "dtype", "precision"), slow_but(USUAL, CASES[: -len(ALL)]))
def test_huge_factors_beside_tiny_ones(name, dtype, precision):
    """In float64 tiny ones leave no digits to error-free products: errors are those of "fast" then, and no larger."""
    case = _extreme(name, "near_overflow_of_splits", dtype)
    bound = "fast" if dtype == "float64" else precision
    parts = [i for i, b in enumerate(case.operation.bounds) if b != EXACT]
    for how, results in _everywhere(case, precision).items():
        case.check(bound, [results[i] for i in parts], how, parts, flushed=32)


@safe
def test_parallel_vectors_of_which_all_products_overflow(dtype, precision):
    """The moment of a force along the offset is zero, and the torque stays, to the bit."""
    big, rng = float(jnp.finfo(dtype).max) ** 0.65, np.random.default_rng(2)
    direction = np.array([3.0, -5.0, 7.0])
    p = (np.tile(direction, (N, 1)) * big / 8).astype(jnp.dtype(dtype))
    f = (p.astype(np.float64) * 2.0 ** rng.integers(-3, 2, (N, 1))).astype(p.dtype)
    tau = rng.standard_normal((N, 3)).astype(p.dtype)
    for shifted, _ in _everywhere(hostile.made("shift_force", [tau, f, p]), precision).values():
        np.testing.assert_array_equal(shifted, tau)


@safe
def test_power_of_huge_products_that_cancel(dtype, precision):
    """Two products of the largest numbers cancel exactly; the four small ones that are left keep their bound."""
    big, rng = float(jnp.finfo(dtype).max), np.random.default_rng(3)
    tau, f, w, v = rng.standard_normal((4, N, 3)).astype(jnp.dtype(dtype))
    tau[:, 1], w[:, 1] = (tau[:, 1].astype(np.float64) * (big / 16)).astype(tau.dtype), tau.dtype.type(big)
    f[:, 2], v[:, 2] = tau[:, 1], -w[:, 1]
    case = hostile.made("dot_force_velocity", [tau, f, w, v])
    for how, results in _everywhere(case, precision).items():
        case.check(precision, results, how)


@few
@pytest.mark.parametrize("name", ["shift_force", "dot_force_velocity"])
def test_a_result_beyond_the_largest_number_is_an_infinity(name, dtype, precision):
    """Of the right sign: all terms of a component have one sign."""
    big, rng = float(jnp.finfo(dtype).max) ** 0.5, np.random.default_rng(5)
    shapes = OPERATIONS[name].shapes
    arrays = [(big * (2 + rng.random((N, 3)))).astype(jnp.dtype(dtype)) for _ in shapes]
    if name == "shift_force":
        p, f = np.array([1, 1, 0]), np.array([0, 0, 1])
        arrays = [arrays[0], *(np.where(m, x, np.zeros_like(x)) for m, x in zip((f, p), arrays[1:], strict=True))]
    case = hostile.made(name, arrays)
    for results in _everywhere(case, precision).values():
        for bound, computed, exact in zip(case.operation.bounds, results, case.exact, strict=True):
            if bound != EXACT:
                _assert_infinite(computed, attribute(exact, "value"))


def _assert_infinite(computed, exact):
    computed, largest = computed.astype(np.float64), Fraction(float(jnp.finfo(computed.dtype).max))
    beyond = np.asarray(abs(exact) > 2 * largest, bool)
    assert beyond.any()
    signs = np.where(exact > 0, np.inf, -np.inf)
    np.testing.assert_array_equal(computed[beyond], signs[beyond])


@few
@pytest.mark.parametrize(
    "beyond", [pytest.param(1.0, id="far", marks=pytest.mark.slow), pytest.param(2.0**-7, id="near")]
)
def test_a_double_word_beyond_the_largest_number_is_an_infinity(beyond, dtype, precision):
    """Nothing beside it, of one item and of many; beyond: the largest number, in parts of it."""
    big, one = (np.asarray([[0, 0, x]], jnp.dtype(dtype)) for x in (jnp.finfo(dtype).max, 1))
    f, p, zero = big[:, [2, 0, 1]], one[:, [0, 2, 1]], np.zeros_like(one)
    # Of what is compiled float32 tells: others are made the same way.
    run = jax.jit if dtype == "float32" else interpreted
    with jax.enable_x64(dtype == "float64"):
        shifted = run(_shifted(precision))((-beyond * big).astype(big.dtype), f, js.DoubleWord(p, zero))
        total = run(_moments(precision))(js.DoubleWord(np.tile(p, (4, 1)), np.tile(zero, (4, 1))), np.tile(f, (4, 1)))
        for x in (shifted, total):
            np.testing.assert_array_equal(np.asarray(x.hi, float).ravel(), [0, 0, -np.inf])
            np.testing.assert_array_equal(np.asarray(x.lo, float).ravel(), [0, 0, 0])


def _shifted(precision):
    return lambda tau, f, p: js.shift(js.SpatialForce(tau, f), -p, precision=precision).tau


def _moments(precision):
    return lambda p, f: js.wrench_from_point_forces(p, f, precision=precision).tau


def _moments_beyond(rng, n, items):
    """points, forces (n, items, 3): moments of pairs of items are beyond the largest number, their sums far below."""
    half = [rng.standard_normal((n, items // 2, 3)) * 2.0**k for k in (514, 513)]
    points, forces = (np.concatenate([x, x], 1) for x in half)
    forces[:, items // 2 :] *= -(1 - 2.0**-12)
    return points, forces


def _check_sums(computed, terms):
    """Faithful sums (n, 3) of terms (n, items, 3), `Sized`."""
    exact = terms.sum(-2)
    assert not violations(of_sum(terms.shape[1], js.wrench_from_point_forces), "faithful", computed, exact).any()


def _sums(precision, how="jit vmap"):
    return hostile.SURROUNDINGS[how](lambda p, f: js.wrench_from_point_forces(p, f, precision=precision)._vectors)


@pytest.mark.parametrize("how", slow_but(["jit vmap"], hostile.SURROUNDINGS))
def test_moments_and_forces_that_overflow_on_the_way_to_their_sums(how):
    """In float64, where no wider format takes them up; both sums are in range."""
    rng = np.random.default_rng(11)
    points, forces = _moments_beyond(rng, 6, 8)
    largest = np.array([1.5e308, 1.0, -1.6e308])
    of_large = np.concatenate([np.tile(largest, (6, 4, 1)), np.tile(-largest * (1 - 2.0**-8), (6, 4, 1))], 1)
    for p, f in ((points, forces), (rng.standard_normal(points.shape) / 16, of_large)):
        with jax.enable_x64(True):
            tau, total = map(np.asarray, _sums("faithful", how)(p, f))
        _check_sums(tau, np.cross(sized(p), sized(f)))
        _check_sums(total, sized(f))


def test_a_pull_back_to_a_shared_item_whose_products_overflow():
    """What the items of a batch give to the one offset they share is a sum over them: sum of cotangent x force."""
    cotangents, forces = (x[0] for x in _moments_beyond(np.random.default_rng(12), 1, 8))

    def torques(p):
        return js.shift(js.SpatialForce(jnp.zeros_like(forces), forces), p, precision="faithful").tau

    with jax.enable_x64(True):
        (pulled,) = jax.jit(lambda p: jax.vjp(torques, p)[1](cotangents))(jnp.ones(3))
    _check_sums(np.asarray(pulled)[None], np.cross(sized(cotangents), sized(forces))[None])


@precisions
@pytest.mark.parametrize("bad", [np.inf, slow(-np.inf), np.nan])
def test_what_is_not_finite_in_a_sum_over_points(bad, precision):
    points, forces = np.ones((6, 8, 3)), np.arange(144.0).reshape(6, 8, 3)
    forces[1, 1, 1] = bad
    with jax.enable_x64(True):
        found = map(np.asarray, _sums(precision)(points, forces))
    for computed, plain in zip(found, (np.cross(points, forces).sum(1), forces.sum(1)), strict=True):
        assert error.agrees_when_not_finite(computed, plain).all()


# -- underflow --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("family", ["tiny_products", "subnormals"])
@pytest.mark.parametrize(("name", "dtype", "precision"), slow_but(USUAL, CASES[: -len(ALL)]))
def test_what_is_flushed_costs_a_few_of_the_smallest_numbers(name, dtype, family, precision):
    """In float64 the last two are as good as the first two there, beyond that."""
    case = _extreme(name, family, dtype)
    parts = [i for i, bound in enumerate(case.operation.bounds) if bound != EXACT]
    bound = "reproducible" if dtype == "float64" else precision
    # A subnormal operand is taken for zero, beside a factor of up to 4; six products, their errors and their sums.
    for how, results in _everywhere(case, precision).items():
        case.check(bound, [results[i] for i in parts], how, parts, flushed=32)


def _is_flushed(dtype):
    tiny = jnp.full(8, float(jnp.finfo(dtype).tiny), dtype)
    return not np.asarray(jax.jit(lax.mul)(tiny, jnp.full_like(tiny, 0.5))).any()


@few
def test_subnormal_numbers_that_are_given_count_as_zero(dtype, precision):
    """Beside a factor so large that it would matter; those of float16 are numbers as all others."""
    with jax.enable_x64(dtype == "float64"):
        p = np.array([[float(jnp.finfo(dtype).tiny) / 4, 0, 0]], np.float64).astype(jnp.dtype(dtype))
        f = np.array([[0, float(jnp.finfo(dtype).max) / 8, 0]], np.float64).astype(p.dtype)
        ((_, _, torque),), _ = _results(hostile.made("shift_force", [np.zeros_like(f), f, p]), precision)
        product = float(p[0, 0]) * float(f[0, 1])
        is_zero = dtype != "float16" and _is_flushed(dtype)
        assert torque == 0 if is_zero else abs(float(torque) + product) <= 4 * float(jnp.finfo(dtype).eps) * product


@pytest.mark.parametrize(
    ("precision", "how"), [("compensated", "jit vmap"), ("faithful", "op by op"), slow("faithful", "jit vmap")]
)
def test_three_factors_in_float64(precision, how):
    """w x (w x p): while no product of two is below 2^-960 the bound holds; below, a term may be lost altogether."""
    w, p = np.random.default_rng(41).uniform(1, 2, (2, N, 3))
    for size, holds in ((2.0**-479, True), (2.0**-600, False)):
        zero = np.zeros_like(w)
        case = hostile.made("shift_acceleration", [zero, zero, p / size, w * size])
        _, a = _results(case, precision, how)
        if holds:
            case.check(precision, [a], size, [1])
        mag = attribute(case.exact[1], "mag")
        assert (abs(rationals(a) - attribute(case.exact[1], "value")) <= mag).all()


# -- NaN and infinities -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "dtype", "precision"), slow_but(USUAL, CASES))
def test_results_are_finite_where_those_of_the_formula_are(name, dtype, precision):
    for computed, plain in zip(*_not_finite(name, dtype, precision), strict=True):
        np.testing.assert_array_equal(np.isfinite(computed), np.isfinite(plain))


@pytest.mark.parametrize(("name", "dtype", "precision"), slow_but(USUAL, CASES[: -len(ALL)]))
def test_nan_and_infinities_go_where_the_formula_takes_them(name, dtype, precision):
    """A product of three is multiplied out: there it is one of NaN and infinity, not always the same."""
    for computed, plain in zip(*_not_finite(name, dtype, precision), strict=True):
        assert error.agrees_when_not_finite(computed, plain).all()


@functools.cache
def _not_finite(name, dtype, precision):
    """(computed, what the formula gives in float64) where a quarter of the numbers is not finite."""
    operation = OPERATIONS[name]
    arrays = hostile.arranged(name, EXTREMES["not_finite"], np.random.default_rng(23), 200, dtype)
    with np.errstate(all="ignore"):
        expected = operation.formula(*(x.astype(np.float64) for x in arrays))
    with jax.enable_x64(dtype == "float64"):
        results = jax.jit(jax.vmap(operation.on_arrays(precision)))(*map(jnp.asarray, arrays))
    return [np.asarray(x).astype(np.float64) for x in results], expected


# -- double words -----------------------------------------------------------------------------------------------------


def _loop(convert, back, precision, F, offsets):
    """Moved along all offsets, and then back along all of them."""

    def step(F, p):
        return js.shift(F, p, precision=precision), None

    there, _ = lax.scan(step, convert(F), offsets)
    return back(lax.scan(step, there, -offsets[::-1])[0])


@pytest.mark.parametrize(
    ("dtype", "precision"),
    [
        ("float32", "compensated"),
        *(slow(*x) for x in [("float32", "faithful"), ("float64", "compensated"), ("float64", "faithful")]),
    ],
)
def test_a_hundred_shifts_there_and_back_in_double_words_are_exact(dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        F, offsets = _there_and_back(dtype)
        looped = jax.jit(functools.partial(_loop, js.to_double_word, js.from_double_word, precision))(F, offsets)
        for x, y in zip(looped._vectors, F._vectors, strict=True):
            np.testing.assert_array_equal(np.asarray(x), np.asarray(y))


@pytest.mark.parametrize(("dtype", "precision"), slow_but(SINGLE, [case for case in ALL if case[0] in WIDE]))
def test_single_words_do_not_come_back(dtype, precision):
    """However precise a step is: what counts is how the state is stored in between."""
    with jax.enable_x64(dtype == "float64"):
        F, offsets = _there_and_back(dtype)
        looped = jax.jit(functools.partial(_loop, lambda x: x, lambda x: x, precision))(F, offsets)
        assert (np.asarray(looped.tau) != np.asarray(F.tau)).mean() > 0.5


def _there_and_back(dtype):
    rng = np.random.default_rng(31)
    tau, f = map(jnp.asarray, rng.standard_normal((2, 32, 3)).astype(dtype))
    return js.SpatialForce(tau, f), jnp.asarray(rng.standard_normal((50, 32, 3)).astype(dtype))
