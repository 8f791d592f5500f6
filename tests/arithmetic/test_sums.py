"""Sums of products as one primitive: what is known folds, and layouts and memory are kept."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.arithmetic.polynomial import Polynomial, symbol

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
    one, minus_one, zero = symbol(arrays, [0]).components
    x, *_ = symbol(arrays, [1]).components
    assert (one * x, minus_one * x, zero * x) == (x, -x, Polynomial())
    assert (one * minus_one).unit == -1 and len((one + one).terms) == 2


@PRECISIONS
def test_known_units_are_summed(precision):
    """Numbers known to be 1 are left out of products, not of sums."""
    p, f = np.float32([1, 1, 0]), np.float32([0, 1, -1])
    tau, *_ = _vectors(3)
    known = jax.jit(lambda tau: js.shift(js.SpatialForce(tau, f), p, precision=precision).tau)(tau)
    np.testing.assert_array_equal(known, np.asarray(tau) - np.cross(p, f))


@PRECISIONS
@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("axis", [0, -1])
def test_donated_memory_is_used(axis, dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        arrays = _vectors(*((64, 3) if axis == 0 else (3, 64)), dtype=dtype)

        def shift(tau, f, p):
            wrench = jax.tree.unflatten(jax.tree.structure(js.SpatialForce.zero()), (tau, f))
            return js.shift(wrench, p, precision=precision).tau

        compiled = jax.jit(jax.vmap(shift, axis, axis), donate_argnums=0).lower(*arrays).compile()
        assert compiled.memory_analysis().alias_size_in_bytes == arrays[0].nbytes


def test_pull_back_of_a_shared_item_is_rounded_once():
    """A cotangent that cancels over the batch: the terms rounded one by one would leave nothing of it."""
    f = jnp.float32([[1, 2**24, 0], [1, -(2**24), 0], [1, 1, 0]])
    tau = jnp.zeros_like(f)

    def total(p):
        shifted = jax.vmap(lambda tau, f: js.shift(js.SpatialForce(tau, f), p, precision="compensated").tau)(tau, f)
        return shifted[:, 2].sum()

    np.testing.assert_array_equal(jax.grad(total)(jnp.zeros(3, jnp.float32)), [-1, 3, 0])


def test_float64_inside_a_program_that_knows_none():
    with jax.enable_x64(False):
        tau, f, p = _vectors(10, 3)
        program = jax.jit(lambda tau, f, p: js.shift(js.SpatialForce(tau, f), p, precision="compensated").tau)
        assert "f64" in program.lower(tau, f, p).as_text() and program(tau, f, p).dtype == np.float32
