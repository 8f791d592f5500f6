"""Sums of products as one primitive: what is known folds, and layouts and memory are kept."""

import functools
import itertools
import math
import operator
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.measure.error import ulp, unit_roundoff
from jaxspatial.numerics import linear
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.numbers.polynomial import Polynomial, symbols
from tests.helpers.marks import slow, slow_but

ZERO = np.zeros(3, np.float32)
PRECISIONS = pytest.mark.parametrize("precision", ["compensated", "faithful"])


def _terms(function, *arguments):
    """How many terms the sums of a program have; an array that is passed on is none."""
    plans = _plans(jax.make_jaxpr(function)(*arguments).jaxpr)
    sums = [s.components for plan in plans for s in plan.sums]
    return sum(len(terms) for s in sums for terms in s if any(len(t) > 1 for t in s))


def _plans(jaxpr):
    for equation in jaxpr.eqns:
        inner = [x.jaxpr for x in equation.params.values() if hasattr(x, "jaxpr")]
        yield from (plan for j in inner for plan in _plans(j))
        if "plan" in equation.params:
            yield equation.params["plan"]


def _vectors(*shape, dtype=np.float32):
    return [jnp.asarray(x) for x in np.random.default_rng(0).standard_normal((3, *shape)).astype(dtype)]


@PRECISIONS
def test_what_is_known_to_be_zero_leaves_no_term(precision):
    tau, f, p = _vectors(3)

    def shift(tau, f, p):
        return js.shift(js.SpatialForce(tau, f), p, precision=precision).tau

    assert _terms(shift, tau, f, p) == 9
    assert _terms(lambda tau, f: shift(tau, f, np.float32([0, 0, 0.3])), tau, f) == 5
    assert _terms(lambda f, p: shift(ZERO, f, p), f, p) == 6
    assert _terms(lambda tau, p: shift(tau, ZERO, p), tau, p) == 0
    assert jax.make_jaxpr(lambda p: shift(ZERO, ZERO, p))(p).eqns == []


def test_a_known_one_is_no_factor():
    arrays = [np.float32([1, -1, 0]), np.float32([0.3, 2, 3])]
    one, minus_one, zero = symbols(arrays, [0])
    x, *_ = symbols(arrays, [1])
    assert (one * x, minus_one * x, zero * x) == (x, -x, Polynomial())
    assert (one * minus_one).unit == -1 and len((one + one).terms) == 2


@PRECISIONS
def test_known_units_are_summed(precision):
    """Numbers known to be 1 are left out of products, not of sums."""
    p, f = np.float32([1, 1, 0]), np.float32([0, 1, -1])
    tau, *_ = _vectors(3)
    known = jax.jit(lambda tau: js.shift(js.SpatialForce(tau, f), p, precision=precision).tau)(tau)
    np.testing.assert_array_equal(known, np.asarray(tau) - np.cross(p, f))


@pytest.mark.parametrize(
    ("axis", "dtype", "precision"),
    slow_but(
        [(0, "float32", "compensated"), (0, "float32", "faithful"), (-1, "float64", "compensated")],
        list(itertools.product([0, -1], ["float32", "float64"], ["compensated", "faithful"])),
    ),
)
def test_donated_memory_is_used(axis, dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        arrays = _vectors(*((64, 3) if axis == 0 else (3, 64)), dtype=dtype)

        def shift(tau, f, p):
            wrench = jax.tree.unflatten(jax.tree.structure(js.SpatialForce.zero()), (tau, f))
            return js.shift(wrench, p, precision=precision).tau

        compiled = jax.jit(jax.vmap(shift, axis, axis), donate_argnums=0).lower(*arrays).compile()
        analysis = compiled.memory_analysis()
        assert analysis is not None and analysis.alias_size_in_bytes == arrays[0].nbytes


def _pulled_back_to_a_shared_offset(precision, f):
    """How the torque about z depends on an offset that a batch shares: minus the sum of f_y, and the sum of f_x."""

    def total(p):
        shifted = jax.vmap(lambda f: js.shift(js.SpatialForce(jnp.zeros_like(f), f), p, precision=precision).tau)(f)
        return shifted[:, 2].sum()

    return jax.grad(total)(jnp.zeros(3, f.dtype))


# Faithful in float64: `laws.test_extremes` has a pull-back to a shared item there.
@pytest.mark.parametrize(
    ("dtype", "precision"),
    [("float32", "compensated"), ("float32", "faithful"), ("float64", "compensated"), slow("float64", "faithful")],
)
def test_pull_back_of_a_shared_item_is_rounded_once(dtype, precision):
    """A cotangent that cancels over the batch: the terms rounded one by one would leave nothing of it."""
    with jax.enable_x64(dtype == "float64"):
        large = 1 / unit_roundoff(dtype)
        f = jnp.asarray([[1, large, 0], [1, -large, 0], [1, 1, 0]], dtype)
        np.testing.assert_array_equal(_pulled_back_to_a_shared_offset(precision, f), [-1, 3, 0])


@PRECISIONS
@pytest.mark.parametrize("axis", [0, slow(1), 2])
def test_pull_backs_of_shared_items_side_by_side(axis, precision):
    f = jnp.arange(4 * 5 * 3, dtype=jnp.float32).reshape(4, 5, 3)
    found = jax.vmap(lambda f: _pulled_back_to_a_shared_offset(precision, f), axis)(jnp.moveaxis(f, 0, axis))
    x, y, z = np.moveaxis(np.asarray(f.sum(1)), -1, 0)
    np.testing.assert_array_equal(found, np.stack([-y, x, 0 * z], -1))


def test_float64_inside_a_program_that_knows_none():
    with jax.enable_x64(False):
        tau, f, p = _vectors(10, 3)
        program = jax.jit(lambda tau, f, p: js.shift(js.SpatialForce(tau, f), p, precision="compensated").tau)
        assert "f64" in program.lower(tau, f, p).as_text() and program(tau, f, p).dtype == np.float32


@pytest.mark.parametrize(
    ("degree", "dtype"),
    slow_but(
        [(3, "float16"), *((degree, "float32") for degree in (3, 4, 5, 6))],
        list(itertools.product([3, 4, 5, 6], ["float16", "float32", "float64"])),
    ),
)
def test_terms_of_any_degree(degree, dtype):
    """(x y - z) w ... with all digits but those of the last factors cancelling: against fractions."""

    @formula(of_sums=True)
    def difference(x, y):
        return functools.reduce(operator.mul, x) - functools.reduce(operator.mul, y)

    with jax.enable_x64(dtype == "float64"):
        rng = np.random.default_rng(degree)
        x = (1 + rng.random((40, degree))).astype(dtype)
        # The same factors in another order: the product is the same, but for one ulp of the last factor.
        y = x[:, ::-1].copy()
        y[:20, 0] = np.nextafter(y[:20, 0], np.asarray(0, dtype))
        exact = [
            math.prod(map(Fraction, a.tolist())) - math.prod(map(Fraction, b.tolist()))
            for a, b in zip(x, y, strict=True)
        ]
        found = difference("faithful", jnp.asarray(x), jnp.asarray(y))
        assert all(
            abs(Fraction(float(a)) - b) <= ulp(np.asarray([b]), dtype)[0] * bool(b)
            for a, b in zip(found, exact, strict=True)
        )
        u, found = unit_roundoff(dtype), difference("compensated", jnp.asarray(x), jnp.asarray(y))
        mags = [2 * math.prod(map(Fraction, a.tolist())) for a in x]
        for a, b, mag in zip(found, exact, mags, strict=True):
            assert abs(Fraction(float(a)) - b) <= u * abs(b) + (degree * (degree - 2) + 4) * u * u * mag


@pytest.mark.parametrize("dtype", [slow("float32"), "float64"])
def test_long_sums_that_cancel(dtype):
    """More numbers than are added without a loop, of which almost nothing is left, and some of which overflow."""

    summed = formula(linear.dot, of_sums=True)

    with jax.enable_x64(dtype == "float64"):
        rng = np.random.default_rng(0)
        x, y = ((1 + rng.random((30, 9))) * 2.0 ** rng.integers(-40, 40, (30, 9)) for _ in range(2))
        if dtype == "float64":
            x[20:, :3], y[20:, :3] = x[20:, :3] * 2.0**540, y[20:, :3] * 2.0**540
        x, y = x.astype(dtype), y.astype(dtype)
        left, right = np.concatenate((x, -y[:, ::-1], x[:, :1]), 1), np.concatenate((y, x[:, ::-1], x[:, 1:2]), 1)
        exact = [
            sum(Fraction(a) * Fraction(b) for a, b in zip(*rows, strict=True))
            for rows in zip(left.tolist(), right.tolist(), strict=True)
        ]
        found = summed("faithful", jnp.asarray(left), jnp.asarray(right))
        for a, b in zip(found, exact, strict=True):
            if abs(b) < Fraction(float(jnp.finfo(dtype).max)):
                assert abs(Fraction(float(a)) - b) <= ulp(np.asarray([b]), dtype)[0]


@pytest.mark.parametrize("n", [4, slow(8), 16])
def test_numbers_whose_sum_overflows_on_the_way(n):
    """Added in the order they come in, they would be infinite; with a product beside them, and in a loop, too."""
    rng = np.random.default_rng(n)
    halves = rng.uniform(1, 2, (30, n // 2)) * 2.0**1023
    x = rng.permuted(np.concatenate([halves, -halves * (1 - 2.0**-20)], 1), axis=1)
    y = np.ones((30, 2)) * 2.0**500

    summed = formula(lambda x, y: functools.reduce(operator.add, x, y[0] * y[1]), of_sums=True)

    with jax.enable_x64(True):
        found = np.asarray(summed("faithful", jnp.asarray(x), jnp.asarray(y)))
    for a, row in zip(found, x.tolist(), strict=True):
        exact = sum(map(Fraction, row)) + 2**1000
        assert abs(Fraction(float(a)) - exact) <= ulp(np.asarray([exact]), "float64")[0]
