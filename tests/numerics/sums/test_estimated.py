"""The first trial of `faithful`: what it gives is within one unit in the last place, whatever cancels, and NaN else."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.measure import inputs
from jaxspatial.measure.error import rationals, ulp
from jaxspatial.numerics.sums.estimated import ESTIMATED, ESTIMATED_OF_NARROW
from tests.helpers.marks import slow

N = 400
CONDITIONS = [1.5, 1e4, 1e8, 1e12, 1e14, 1e15, 3e15, 1e16, 1e17, 1e20, np.inf]


def _dots(dtype, condition, n=N) -> Any:
    """Six pairs of factors (n,) each, and the exact sums of their products."""
    arrays = inputs.CONDITIONED["dot"](np.random.default_rng(7), n, np.dtype(dtype), condition)
    pairs = [(x[:, k], y[:, k]) for x, y in ((arrays[0], arrays[2]), (arrays[1], arrays[3])) for k in range(3)]
    return arrays, pairs, sum(rationals(a) * rationals(b) for a, b in pairs)


def _estimate(pairs, dtype):
    """The sum of the products, or NaN."""

    def run(pairs):
        terms = [(1, [x.astype(np.float64) for x in pair]) for pair in pairs]
        estimated = ESTIMATED if dtype == "float64" else ESTIMATED_OF_NARROW
        return estimated.round(estimated.state_of(terms), np.dtype(dtype))

    with jax.enable_x64(True):
        return np.asarray(jax.jit(run)(pairs))


@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_what_is_given_is_faithful(dtype):
    """At every condition number: of those in between some are given and some are not."""
    shares = []
    for condition in CONDITIONS:
        _, pairs, exact = _dots(dtype, condition)
        found = _estimate(pairs, dtype)
        given = ~np.isnan(found)
        errors = abs(rationals(found[given]) - exact[given])
        allowed = np.array([ulp(x, np.dtype(dtype)) for x in exact[given]], object)
        assert (errors <= allowed).all()
        shares.append(given.mean())
    assert shares[0] == 1 and shares[-2] == 0 and any(0 < share < 1 for share in shares)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_products_that_cancel_exactly_are_certain(dtype):
    """Vectors that are parallel are no reason to try again, nor are zeros."""
    (a, b), *_ = _dots(dtype, 1.5)[1]
    zero = np.zeros_like(a)
    np.testing.assert_array_equal(_estimate([(a, b), (-a, b)], dtype), zero)
    np.testing.assert_array_equal(_estimate([(zero, b), (a, zero)], dtype), zero)


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_what_is_not_finite_is_not_certain(value):
    (a, b), *_ = _dots("float64", 1.5)[1]
    assert np.isnan(_estimate([(a, np.full_like(b, value)), (a, b)], "float64")).all()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_terms_added_last_count(dtype):
    """Numbers that cancel nearly all of the products."""
    arrays = inputs.CONDITIONED["shift_force"](np.random.default_rng(1), N, np.dtype(dtype), 1e15)
    tau, f, p = arrays

    def run(tau, f, p):
        wide = [x.astype(np.float64) for x in (tau, f, p)]
        terms = [(-1, [wide[2][:, 1], wide[1][:, 2]]), (1, [wide[2][:, 2], wide[1][:, 1]])]
        estimated = ESTIMATED if dtype == "float64" else ESTIMATED_OF_NARROW
        state = estimated.plus(estimated.state_of(terms), 1, wide[0][:, 0])
        return estimated.round(state, np.dtype(dtype)), estimated.round(estimated.plus(state, -1, wide[0][:, 0]), dtype)

    with jax.enable_x64(True):
        found, again = map(np.asarray, jax.jit(run)(tau, f, p))
    products = rationals(p[:, 2]) * rationals(f[:, 1]) - rationals(p[:, 1]) * rationals(f[:, 2])
    for x, exact in ((found, products + rationals(tau[:, 0])), (again, products)):
        given = ~np.isnan(x)
        allowed = np.array([ulp(e, np.dtype(dtype)) for e in exact[given]], object)
        assert (abs(rationals(x[given]) - exact[given]) <= allowed).all()


@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_an_item_has_the_same_bits_in_any_batch(dtype):
    """Beside items that take every trial there is."""
    easy, hard, hopeless = (_dots(dtype, c, 40)[0] for c in (1.5, 1e18, np.inf))

    def power(tau, f, w, v):
        return js.dot(js.SpatialForce(tau, f), js.SpatialVelocity(w, v), precision="faithful")

    with jax.enable_x64(True):
        alone = np.asarray(jax.jit(power)(*easy))
        for others in ([hard], [hard, hopeless]):
            batch = [np.concatenate(x) for x in zip(easy, *others, strict=True)]
            np.testing.assert_array_equal(np.asarray(jax.jit(power)(*map(jnp.asarray, batch)))[: len(alone)], alone)
