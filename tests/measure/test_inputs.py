"""What the docstrings of the generators of inputs say, held against exact rationals."""

from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pytest

from jaxspatial.measure import error, inputs
from jaxspatial.measure.operation import OPERATIONS

N = 60
DTYPES = ["float16", "bfloat16", "float32", "float64"]
PAIRS = [(0, 1), (0, 2), (1, 2), (3, 0)]


@pytest.fixture(params=DTYPES)
def dtype(request):
    return jnp.dtype(request.param)


@pytest.fixture
def info(dtype):
    return jnp.finfo(dtype)


def _rng():
    return np.random.default_rng(17)


def _drawn(table, name, dtype, count=4, n=N):
    """The arrays of a family as one array (count, n, 3) of float64."""
    arrays = table[name](_rng(), count, n, dtype)
    assert len(arrays) == count and all(x.shape == (n, 3) and x.dtype == dtype for x in arrays)
    return np.stack(arrays).astype(np.float64)


def _rational(x):
    return Fraction(float(x))


def _conditions(value, mag):
    """mag / |value| in float64, infinite where the value is 0."""
    return np.frompyfunc(lambda v, m: float(m / abs(v)) if v else np.inf, 2, 1)(value, mag).astype(np.float64)


# Families


def test_tables_are_complete_and_documented():
    for table in (inputs.FAMILIES, inputs.EXTREMES):
        assert all(function.__doc__ and function.__name__ == name for name, function in table.items())
    assert set(inputs.CONDITIONED) <= set(OPERATIONS)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("name", inputs.FAMILIES | inputs.EXTREMES)
def test_any_number_of_arrays(name, count, dtype):
    _drawn(inputs.FAMILIES | inputs.EXTREMES, name, dtype, count, n=5)


def test_signed_zeros(dtype):
    x = _drawn(inputs.FAMILIES, "signed_zeros", dtype)
    assert set(np.unique(x)) == {-2, -1, 0, 1, 2}
    zeros = x[x == 0]
    assert 0.25 < zeros.size / x.size < 0.42 and 0.35 < np.signbit(zeros).mean() < 0.65


def test_far_offsets_in_turn(dtype):
    x = _drawn(inputs.FAMILIES, "far_offsets", dtype, n=4 * N)
    sizes = np.sqrt((x**2).mean(-1))
    in_turn = np.arange(4)[:, None] == np.arange(4 * N) % 4
    far, near = (16, 0.25) if dtype == np.float16 else (2.0**27, 2.0**-10)
    np.testing.assert_allclose(np.sqrt((sizes[in_turn] ** 2).mean()), far, rtol=0.15)
    np.testing.assert_allclose(np.sqrt((sizes[~in_turn] ** 2).mean()), near, rtol=0.15)


def test_far_offsets_neither_over_nor_underflow_in_a_product_of_three(dtype, info):
    x = abs(_drawn(inputs.FAMILIES, "far_offsets", dtype))
    assert x.max() ** 2 * 6 * np.median(x) < float(info.max)
    assert np.median(x) ** 3 > float(info.tiny)


# Extremes


def test_every_product_overflows(dtype, info):
    x = _drawn(inputs.EXTREMES, "near_overflow_of_products", dtype)
    assert np.isfinite(x).all()
    smallest = error.rationals(abs(x).min())[()]
    assert smallest * smallest > _rational(info.max)
    first, second = x[:2].astype(dtype)
    with np.errstate(over="ignore"):
        assert np.isinf(first * second).all()


@pytest.mark.parametrize("pair", PAIRS)
def test_though_cross_products_are_representable(pair, dtype, info):
    x = _drawn(inputs.EXTREMES, "near_overflow_of_products", dtype)
    value, _ = error.evaluate(np.cross, x[pair[0]], x[pair[1]])
    assert not value[::2].any()
    assert (value[1::2] != 0).any(-1).mean() > 0.5
    assert abs(value).max() <= _rational(info.max) / 8


@pytest.mark.parametrize("count", [2, 3, 4])
def test_splits_overflow_though_products_are_about_one(count, dtype, info):
    x = abs(_drawn(inputs.EXTREMES, "near_overflow_of_splits", dtype, count))
    largest, tiny = float(info.max), float(info.tiny)
    huge, small = (x >= largest / 8).all(-1), (x < 8 * tiny).all(-1)
    assert (huge.sum(0) == 1).all() and (small.sum(0) == 1).all()
    others = x[~huge & ~small]
    assert (x[small] >= tiny).all() and (others >= 0.25).all() and (others < 0.5).all()
    factor = Fraction(2) ** -(-(info.nmant + 1) // 2) + 1
    assert (error.rationals(x[huge]) * factor > _rational(largest)).all()
    turns = {(int(a), int(b)) for a, b in zip(huge.argmax(0), small.argmax(0), strict=True)}
    assert len(turns) == count * (count - 1)


def test_products_beside_a_huge_number_are_finite(dtype, info):
    x = abs(error.rationals(_drawn(inputs.EXTREMES, "near_overflow_of_splits", dtype)))
    largest, limit = x.max(-1), _rational(info.max)
    assert (2 * np.sort(largest, 0)[-1] * np.sort(largest, 0)[-2] <= limit).all()
    products = np.sort(x.max(-1), 0)[-1] * np.sort(x.min(-1), 0)[0]
    assert (products >= Fraction(1, 2)).all() and (products < 32).all()


def test_one_array_alone_is_huge(dtype, info):
    (x,) = _drawn(inputs.EXTREMES, "near_overflow_of_splits", dtype, 1)
    assert (abs(x) >= float(info.max) / 8).all()


def test_tiny_products(dtype, info):
    x = abs(_drawn(inputs.EXTREMES, "tiny_products", dtype))
    tiny, eps = _rational(info.tiny), _rational(info.eps)
    assert x.min() >= float(tiny)
    smallest, largest = error.rationals(x.min())[()] ** 2, error.rationals(x.max())[()] ** 2
    assert tiny * eps <= smallest < tiny and tiny / eps / 4 < largest <= 4 * tiny / eps
    products = error.rationals(x[0]) * error.rationals(x[1])
    errors = abs(error.rationals(inputs.nearest(products, dtype)) - products)
    assert (errors < 2 * tiny).all() and (errors > 0).any()


def test_subnormals(dtype, info):
    x = abs(_drawn(inputs.EXTREMES, "subnormals", dtype, n=300))
    tiny = float(info.tiny)
    below, near = x < tiny, (x >= tiny) & (x < 8 * tiny)
    assert (x > 0).all()
    for kind in (below, near, ~below & ~near):
        assert 0.3 < kind.mean() < 0.37
    smallest = float(info.smallest_subnormal)
    assert x.min() < 4 * smallest and x[below].max() > tiny / 2


def test_not_finite(dtype):
    x = _drawn(inputs.EXTREMES, "not_finite", dtype, n=300)
    assert 0.22 < 1 - np.isfinite(x).mean() < 0.28
    for kind in (np.isnan(x), x == np.inf, x == -np.inf):
        assert 0.06 < kind.mean() < 0.11


# Condition numbers on request


def _requested(dtype, power):
    """Condition numbers from 1 to u^-power, more of them near 1, where terms hardly cancel."""
    largest = float(1 / error.unit_roundoff(dtype)) ** power
    return sorted({1.0, 1.5, 2.0, 3.0, 7.0, 30.0, *np.geomspace(100, largest, 5).tolist()})


@pytest.mark.parametrize("name", [name for name in inputs.CONDITIONED if name != "dot"])
def test_shifts_have_the_condition_asked_for(name, dtype):
    for condition in _requested(dtype, 1):
        arrays = inputs.CONDITIONED[name](_rng(), N, dtype, condition)
        assert all(x.shape == (N, 3) and x.dtype == dtype for x in arrays)
        reached = _conditions(*OPERATIONS[name].exactly(*arrays)[0])
        assert (reached <= 2.1 * condition).all() and (reached >= condition / 2.1).all(), condition


def test_dot_has_the_condition_asked_for(dtype):
    for condition in _requested(dtype, 2):
        arrays = inputs.dot_with_condition(_rng(), N, dtype, condition)
        assert all(x.shape == (N, 3) and x.dtype == dtype for x in arrays)
        reached = _conditions(*OPERATIONS["dot"].exactly(*arrays)[0])
        assert (reached <= 2.1 * condition).all() and (reached >= condition / 2.1).all(), condition


@pytest.mark.parametrize("terms", [4, 5, 6, 20])
def test_products_of_any_number(terms, dtype):
    for condition in (1.0, float(error.unit_roundoff(dtype)) ** -2):
        x, y = inputs.products_with_condition(_rng(), terms, 20, dtype, condition)
        assert x.shape == y.shape == (20, terms)
        reached = _conditions(*error.evaluate(lambda x, y: (x * y).sum(-1), x, y))
        assert (reached <= 2.1 * condition).all() and (reached >= condition / 2.1).all()


def test_factors_keep_away_from_the_ends_of_the_range(dtype, info):
    for condition in _requested(dtype, 2):
        sizes = abs(np.stack(inputs.dot_with_condition(_rng(), 3 * N, dtype, condition)).astype(np.float64))
        assert sizes.max() <= 2.0 ** (info.maxexp / 4) and sizes.min() >= 2.0 ** (-info.maxexp / 4)


def test_products_come_in_random_order_and_sign(dtype):
    x, y = inputs.products_with_condition(_rng(), 6, 200, dtype, float(error.unit_roundoff(dtype)) ** -2)
    smallest = abs(x.astype(float) * y.astype(float)).argmin(-1)
    assert (np.bincount(smallest, minlength=6) > 10).all()
    assert 80 < (x[:, 0] > 0).sum() < 120 and 80 < (y[:, 0] > 0).sum() < 120


@pytest.mark.parametrize("factor", [2.0, 1e3, 1e30, np.inf])
@pytest.mark.parametrize("name", ["shift_force", "shift_velocity", "shift_acceleration"])
def test_beyond_the_format_nothing_but_rounding_errors_are_left(name, factor, dtype):
    u = error.unit_roundoff(dtype)
    arrays = inputs.CONDITIONED[name](_rng(), N, dtype, factor / float(u))
    assert _conditions(*OPERATIONS[name].exactly(*arrays)[0]).min() >= 1 / (2 * float(u))


def test_infinite_condition_cancels_to_the_last_bit(dtype):
    tau, f, p = inputs.CONDITIONED["shift_force"](_rng(), N, dtype, np.inf)
    value, _ = error.evaluate(np.cross, p, f)
    assert (tau == inputs.nearest(value, dtype)).all()
    assert error.in_ulps(tau, value).max() <= 0.5


def test_workless_forces(dtype):
    arrays = inputs.dot_with_condition(_rng(), N, dtype, np.inf)
    ((value, mag),) = OPERATIONS["dot"].exactly(*arrays)
    assert not value.any() and mag.all()
    sizes = abs(np.stack(arrays).astype(np.float64))
    assert sizes.min() >= 1 / 8 and sizes.max() <= 4
    assert all((x == y).all() for x, y in zip(arrays, inputs.workless(_rng(), N, dtype), strict=True))


def test_sizes_of_what_the_docstrings_of_the_shifts_name(dtype):
    for name, first in {"shift_force": 0, "shift_velocity": 1, "shift_acceleration": 1}.items():
        arrays = inputs.CONDITIONED[name](_rng(), N, dtype, 1e2)
        for x in (abs(x.astype(float)) for i, x in enumerate(arrays) if i != first):
            assert x.min() >= 0.5 and x.max() < 1


def test_condition_of_a_formula_of_the_user(dtype):
    """A linear combination, one condition number per component, inputs from a family."""
    others = inputs.mixed_scales(_rng(), 2, N, dtype)
    asked = np.array([3.0, 20.0, 100.0])

    def formula(a, b, c):
        return a + b + c * c

    arrays = inputs.with_condition(_rng(), formula, others, asked)
    assert arrays[1] is others[0] and arrays[2] is others[1]
    value, mag = error.evaluate(formula, *arrays)
    normal = abs(arrays[0].astype(float)) >= float(jnp.finfo(dtype).tiny)
    reached = _conditions(value, mag)
    assert normal.mean() > 0.9 and ((reached <= 2.1 * asked) & (reached >= asked / 2.1))[normal].all()


def test_signs_of_the_result_are_random(dtype):
    ((value, _),) = OPERATIONS["shift_force"].exactly(*inputs.CONDITIONED["shift_force"](_rng(), N, dtype, 50.0))
    assert 0.3 < (value > 0).mean() < 0.7


def test_nearest_rounds_to_even(dtype, info):
    one, eps = Fraction(1), _rational(info.eps)
    exactly = np.array([one + eps / 2, one + 3 * eps / 2, one + eps / 2 + eps**4, -one - eps / 4, 0 * one])
    expected = [1, 1 + 2 * float(eps), 1 + float(eps), -1, 0]
    assert list(inputs.nearest(exactly, dtype).astype(float)) == expected
    subnormal = np.array([_rational(info.smallest_subnormal) * 3 / 2])
    assert inputs.nearest(subnormal, dtype).astype(float) == 2 * float(info.smallest_subnormal)


def test_dtypes_may_be_names():
    assert inputs.dot_with_condition(_rng(), 2, "bfloat16", 10.0)[0].dtype == jnp.bfloat16
    assert inputs.EXTREMES["subnormals"](_rng(), 1, 2, "float16")[0].dtype == np.float16
