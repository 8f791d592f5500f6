"""Derivatives of every operation are those of the exact formula, and pull-backs belong to tangents, of every dtype.

Operations without a formula in the table are compared with differences in float64. Bounds on hostile inputs: see
`test_derivatives`.
"""

import functools
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.measure.error import rationals, unit_roundoff
from tests.helpers.interpreted import interpreted
from tests.helpers.operations import OPERATIONS
from tests.laws import cases
from tests.laws.batches import ONE, arrays, assert_same_bits

# How far float32 may be from float64, in u normwise: well conditioned values cancel a little.
DERIVED = 64
# Central differences of order 8 at steps of 2^-10, in float64, and the error that rounding leaves.
STEP, WEIGHTS, OF_DIFFERENCES = 2.0**-10, (4 / 5, -1 / 5, 4 / 105, -1 / 280), 2.5e-10


@cases.LINEARISATIONS.parametrize
def test_tangent_is_the_derivative(name, dtype, precision):
    result, tangent = _pushed(name, dtype, precision)
    if precision is None and OPERATIONS[name].formula:
        assert_same_bits(result, OPERATIONS[name].naive(*_point(name, dtype)))
    for x, (exact, near) in zip(tangent, _derivative(name, dtype), strict=True):
        assert x.dtype == dtype
        assert abs(rationals(x) - exact).max() <= near


@cases.LINEARISATIONS.parametrize
def test_pull_back_is_the_transpose_of_the_tangent(name, dtype, precision):
    tangent = _pushed(name, dtype, precision)[1]
    _assert_transpose(OPERATIONS[name].on_arrays(precision), _point(name, dtype), _direction(name, dtype), tangent)


@cases.SHARED_ARGUMENTS.parametrize
def test_pull_back_of_an_item_shared_by_a_batch(name, how):
    operation = OPERATIONS[name]
    kinds = operation.arguments.split()
    for i, kind in enumerate(kinds):
        if how == "broadcasting" and kind in ("F", "A") and "scalar" in kinds:
            continue  # refused: see `test_one_item_is_shared_by_a_batch`
        shared = [place == i for place in operation.places]
        x, t = (
            [a[ONE] if is_shared else a[:, 0, 0] for a, is_shared in zip(make(name, "float32"), shared, strict=True)]
            for make in (_point, _direction)
        )
        one = operation.on_arrays()
        function = one if how == "broadcasting" else jax.vmap(one, [None if is_shared else 0 for is_shared in shared])
        _assert_transpose(function, x, t, interpreted(functools.partial(_jvp, function))(x, t)[1])


@cases.COMPILED_DERIVATIVES.parametrize
def test_derivatives_are_bitwise_the_same_compiled_and_recomputed(name, dtype):
    function, inputs = OPERATIONS[name].on_arrays(), (_point(name, dtype), _direction(name, dtype))
    with jax.enable_x64(dtype == "float64"):
        x, t = jax.tree.map(jnp.asarray, inputs)
        cotangent = _cotangent(jax.eval_shape(function, *x))
        again = jax.checkpoint(function)
        tangent, gradient = jax.jit(lambda x, t: (_jvp(again, x, t)[1], _pulled(again, cotangent, *x)))(x, t)
        # Separate calls, op by op, add up in another order.
        runs = interpreted if OPERATIONS[name].formula else lambda f: f
        expected = runs(functools.partial(_pulled, function, cotangent))(*x)
    assert_same_bits(tangent, _pushed(name, dtype)[1])
    assert_same_bits(gradient, expected)


# -- helpers ----------------------------------------------------------------------------------------------------------


@functools.cache
def _point(name, dtype):
    """The same numbers in every dtype."""
    return [x.astype(jnp.dtype(dtype)) for x in arrays(name)]


@functools.cache
def _direction(name, dtype):
    rng = np.random.default_rng(1)
    return [rng.standard_normal(x.shape).astype(np.float32).astype(jnp.dtype(dtype)) for x in arrays(name)]


@functools.cache
def _pushed(name, dtype, precision=None):
    """(value, tangent)."""
    with jax.enable_x64(dtype != "float32"):
        function = functools.partial(_jvp, OPERATIONS[name].on_arrays(precision))
        return interpreted(function)(_point(name, dtype), _direction(name, dtype))


@functools.cache
def _derivative(name, dtype):
    """For each array of the tangent (what it is to be as Fractions, how near)."""
    u = unit_roundoff(dtype)
    if OPERATIONS[name].formula:
        return [(exact, 32 * u * abs(exact).max()) for exact in _linearisation(name, dtype)]
    if dtype == "float64":
        differences = map(rationals, _differences(name))
        return [(exact, OF_DIFFERENCES * max(abs(exact).max(), 1)) for exact in differences]
    return [(exact, DERIVED * u * abs(exact).max()) for exact in map(rationals, _pushed(name, "float64")[1])]


def _linearisation(name, dtype):
    """Central differences over fractions: nothing is rounded, and the step is too small to matter."""
    step = Fraction(1, 2**100)
    x, t = (list(map(rationals, given(name, dtype))) for given in (_point, _direction))
    ahead, behind = (OPERATIONS[name].formula(*(a + s * b for a, b in zip(x, t, strict=True))) for s in (step, -step))
    return [(np.asarray(a) - np.asarray(b)) / (2 * step) for a, b in zip(ahead, behind, strict=True)]


def _differences(name):
    x, t = _point(name, "float64"), _direction(name, "float64")
    steps = STEP * np.array([s * k for k in (1, 2, 3, 4) for s in (1, -1)])
    spread = [a + steps.reshape((8, *[1] * a.ndim)) * b for a, b in zip(x, t, strict=True)]
    results = OPERATIONS[name].op_by_op(*spread)
    return [sum(w * (y[2 * k] - y[2 * k + 1]) for k, w in enumerate(WEIGHTS)) / STEP for y in results]


def _jvp(function, x, t):
    return jax.jvp(function, tuple(x), tuple(t))


def _pulled(function, cotangent, *x):
    return jax.vjp(function, *x)[1](cotangent)


def _cotangent(result):
    rng = np.random.default_rng(2)
    return [jnp.asarray(rng.standard_normal(x.shape).astype(x.dtype)) for x in result]


def _assert_transpose(function, x, t, tangent):
    """cotangent . tangent = pulled . t, and what is pulled back has the shapes and dtypes of x."""
    with jax.enable_x64(x[0].dtype != np.float32):
        cotangent = _cotangent(tangent)
        pulled = interpreted(functools.partial(_pulled, function, cotangent))(*x)
    assert [(a.shape, a.dtype) for a in pulled] == [(a.shape, a.dtype) for a in x]
    (left, left_size), (right, right_size) = _inner(cotangent, tangent), _inner(pulled, t)
    assert abs(left - right) <= (left_size + right_size) * 16 * unit_roundoff(x[0].dtype)


def _inner(a, b):
    """(the inner product of two lists of arrays, the sum of the absolute values of its terms), exactly."""
    terms = [rationals(x) * rationals(y) for x, y in zip(a, b, strict=True)]
    return sum(np.sum(x) for x in terms), sum(np.sum(abs(x)) for x in terms)
