"""`reproducible` is NumPy to the last bit, whatever surrounds it; with and without fused multiply-add in the hardware.

The file runs a second time in a process whose compiler may not use the FMA units (`test_without_fma`).
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from tests.helpers.marks import slow_but
from tests.helpers.operations import EXACT, OPERATIONS

SIZES = [1, 7, 257, 4096]
DTYPES = ["float32", "float64"]


# (operation, which of its results): used alone.
RESULTS = [
    (name, part)
    for name in ("shift_force", "shift_momentum", "shift_velocity", "shift_acceleration", "dot_force_velocity",
                 "cross_velocity", "cross_force", "rotate")
    for part, bound in enumerate(OPERATIONS[name].bounds or ())
    if bound != EXACT
]  # fmt: skip


# Of all operations one size and dtype, alone and in a larger program; of one operation three, in all contexts.
CASES = [(*result, n, dtype) for result, n, dtype in itertools.product(RESULTS, SIZES, DTYPES)]
USUAL = [(*case, 257, "float32") for case in RESULTS]
USUAL += [("shift_force", 0, 1, "float32"), ("shift_force", 0, 257, "float64")]


def _alone(name, part):
    """One result of an operation, as a function of arrays, in the default precision."""
    return lambda *arrays: OPERATIONS[name].on_arrays(None)(*arrays)[part]


CONTEXTS = {
    "eager": lambda f: f,
    "jit": jax.jit,
    "vmap": lambda f: jax.vmap(f),
    "jit vmap": lambda f: jax.jit(jax.vmap(f)),
    "jit vmap, batch last": lambda f: lambda *a: _last(f)(*(x.T for x in a)),
    "scan": lambda f: jax.jit(lambda *a: lax.scan(lambda _, x: (None, f(*x)), None, a)[1]),
    "primal of a gradient": lambda f: lambda *a: _primal(f, *a),
    "inside a larger fusion": lambda f: jax.jit(lambda *a: f(*(x * 2 for x in a)) + 0 * f(*a)),
}


def _last(f):
    return jax.jit(jax.vmap(f, in_axes=-1, out_axes=0))


def _primal(f, *a):
    return jax.jit(lambda *a: jax.vjp(f, *a)[0])(*a)


def _vectors(count, n, dtype, seed=0):
    return _arrays([(3,)] * count, n, dtype, seed)


def _arrays(shapes, n, dtype, seed=0):
    rng = np.random.default_rng(seed)
    normal = [rng.standard_normal((n, *shape)) for shape in shapes]
    return [(x * 2.0 ** rng.integers(-8, 8, x.shape)).astype(dtype) for x in normal]


@pytest.mark.parametrize(("name", "part", "n", "dtype"), slow_but(USUAL, CASES))
def test_bitwise_numpy(name, part, n, dtype):
    inputs = _arrays(OPERATIONS[name].shapes, n, dtype)
    with jax.enable_x64(dtype == "float64"):
        for how in CONTEXTS if name == "shift_force" else ("jit vmap", "scan", "inside a larger fusion"):
            factor = 2 if how == "inside a larger fusion" else 1
            expected = OPERATIONS[name].formula(*(x * np.asarray(factor, dtype) for x in inputs))[part]
            computed = np.asarray(CONTEXTS[how](_alone(name, part))(*map(jnp.asarray, inputs)))
            np.testing.assert_array_equal(computed, expected, err_msg=how, strict=True)


@pytest.mark.parametrize("dtype", DTYPES)
def test_jit_of_one_is_the_batch(dtype):
    inputs = _vectors(3, 257, dtype)
    function = _alone("shift_force", 0)
    with jax.enable_x64(dtype == "float64"):
        batch = np.asarray(jax.jit(jax.vmap(function))(*inputs))
        single = jax.jit(function)
        for i in (0, 1, 100, 256):
            np.testing.assert_array_equal(np.asarray(single(*(jnp.asarray(x[i]) for x in inputs))), batch[i])


@pytest.mark.parametrize("context", ["eager", "jit", "vmap", "jit vmap"])
@pytest.mark.parametrize("dtype", DTYPES)
def test_cross_of_equals_is_zero_and_cross_is_antisymmetric(dtype, context):
    """Equal values as two arguments: the same tracer twice would hide a contraction behind a common subexpression."""
    w, v, x, y = _vectors(4, 1000, dtype)
    with jax.enable_x64(dtype == "float64"):
        function = CONTEXTS[context](
            lambda *a: js.cross(js.SpatialVelocity(*a[:2]), js.SpatialVelocity(*a[2:]))._vectors
        )
        for part in function(w, v, w.copy(), v.copy()):
            np.testing.assert_array_equal(np.asarray(part), 0)
        for there, back in zip(function(w, v, x, y), function(x, y, w, v), strict=True):
            np.testing.assert_array_equal(np.asarray(there), -np.asarray(back))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("powers", [(3, -7, 5), (-20, 9, -30)])
def test_powers_of_two_scale_bitwise(powers, dtype):
    t, f, p = _vectors(3, 500, dtype)
    a, b = (np.asarray(2.0**k, dtype) for k in (powers[0], powers[1]))
    with jax.enable_x64(dtype == "float64"):
        shifted = jax.jit(jax.vmap(js.shift))
        plain = shifted(js.SpatialForce(t, f), p)
        scaled = shifted(js.SpatialForce(t * a * b, f * a), p * b)
        np.testing.assert_array_equal(np.asarray(scaled.tau), np.asarray(plain.tau) * a * b)
        np.testing.assert_array_equal(np.asarray(scaled.f), np.asarray(plain.f) * a)


@pytest.mark.parametrize("dtype", DTYPES)
def test_derivatives_are_reproducible_too(dtype):
    """Tangents and cotangents of a product are rounded products: the same compiled, batched or not."""
    t, f, p = _vectors(3, 300, dtype)
    dt, df, dp = _vectors(3, 300, dtype, seed=1)
    with jax.enable_x64(dtype == "float64"):
        function = _alone("shift_force", 0)
        tangent = jax.jit(jax.vmap(lambda *a: jax.jvp(function, a[:3], a[3:])[1]))(t, f, p, dt, df, dp)
        i, j = [1, 2, 0], [2, 0, 1]
        rate = (dp[:, i] * f[:, j] + p[:, i] * df[:, j]) - (dp[:, j] * f[:, i] + p[:, j] * df[:, i])
        np.testing.assert_array_equal(np.asarray(tangent), dt - rate)
        pull = jax.jit(jax.vmap(lambda t, f, p, ct: jax.vjp(function, t, f, p)[1](ct)))(t, f, p, dt)
        for i in (0, 123, 299):
            one = jax.vjp(function, *(jnp.asarray(x[i]) for x in (t, f, p)))[1](jnp.asarray(dt[i]))
            for single, batch in zip(one, pull, strict=True):
                np.testing.assert_array_equal(np.asarray(single), np.asarray(batch)[i])
