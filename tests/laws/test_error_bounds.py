"""Every operation keeps the error bound of its docstring, held against exact rationals.

Operations x precisions x dtypes x families of hostile inputs x contexts, with the result used alone. The tolerance is
the promise itself.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from jaxspatial.measure import error, exact
from jaxspatial.measure.inputs import FAMILIES

N = 24


def _cross_motion(w, v, x, y):
    return (
        exact.evaluate(lambda w, v, x, y: np.cross(w, x), w, v, x, y),
        exact.evaluate(lambda w, v, x, y: np.cross(w, y) + np.cross(v, x), w, v, x, y),
    )


def _cross_force(w, v, tau, f):
    return _cross_motion(w, v, f, tau)[::-1]


def _point_forces(points, forces):
    return (
        exact.evaluate(lambda p, f: np.cross(p, f).sum(-2), points, forces),
        exact.evaluate(lambda f: f.sum(-2), forces),
    )


def _cross(X):
    return lambda w, v, x, y, q: js.cross(js.SpatialVelocity(w, v), X(x, y), precision=q)._parts


# name -> (number of 3-vectors, function of arrays and a precision giving arrays, exact results with magnitudes, bounds)
OPERATIONS = {
    "shift force": (
        3,
        lambda t, f, p, q: [js.shift(js.SpatialForce(t, f), p, precision=q).tau],
        lambda t, f, p: [exact.shift_force(t, f, p)],
        [3],
    ),
    "shift momentum": (
        3,
        lambda h, m, p, q: [js.shift(js.SpatialMomentum(h, m), p, precision=q).h],
        lambda h, m, p: [exact.shift_force(h, m, p)],
        [3],
    ),
    "shift velocity": (
        3,
        lambda w, v, p, q: [js.shift(js.SpatialVelocity(w, v), p, precision=q).v],
        lambda w, v, p: [exact.shift_velocity(w, v, p)],
        [3],
    ),
    "shift acceleration": (
        4,
        lambda b, a, p, w, q: [js.shift(js.SpatialAcceleration(b, a), p, w, precision=q).a],
        lambda b, a, p, w: [exact.shift_acceleration(b, a, p, w)],
        [7],
    ),
    "dot": (
        4,
        lambda t, f, w, v, q: [js.dot(js.SpatialForce(t, f), js.SpatialVelocity(w, v), precision=q)],
        lambda t, f, w, v: [exact.dot(t, f, w, v)],
        [4],
    ),
    "cross motion": (4, _cross(js.SpatialVelocity), _cross_motion, [2, 3]),
    "cross force": (4, _cross(js.SpatialForce), _cross_force, [3, 2]),
}
CONTEXTS = {
    "eager": lambda f: f,
    "jit": jax.jit,
    "vmap": lambda f: jax.jit(jax.vmap(f)),
    "scan": lambda f: jax.jit(lambda *a: lax.scan(lambda _, x: (None, f(*x)), None, a)[1]),
}


@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "float32", "float64"])
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("operation", OPERATIONS)
def test_bound_of_the_docstring(operation, family, dtype):
    count, function, reference, bounds = OPERATIONS[operation]
    inputs = FAMILIES[family](np.random.default_rng(7), count, N, jnp.dtype(dtype))
    expected = reference(*inputs)
    with jax.enable_x64(dtype == "float64"):
        for precision in js.Precision:
            for name, context in CONTEXTS.items():
                for part, (value, magnitude) in enumerate(expected):
                    alone = context(lambda *a, part=part, precision=precision: function(*a, precision)[part])
                    worst = error.in_u_of(alone(*map(jnp.asarray, inputs)), value, magnitude).max()
                    assert worst <= bounds[part], (precision, name, part)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("precision", js.Precision)
@pytest.mark.parametrize("operation", ["shift force", "shift velocity", "dot"])
def test_bound_when_all_terms_cancel(operation, precision, dtype):
    """The torque is fl(p x f), the velocity orthogonal to fl: what is left is rounding errors only."""
    rng = np.random.default_rng(3)
    x, y, z, w = (rng.standard_normal((200, 3)).astype(dtype) for _ in range(4))
    inputs = {
        "shift force": (np.cross(z, y), y, z),
        "shift velocity": (x, -np.cross(x, z), z),
        "dot": (x, y, x * np.float32(0.5), (-y * np.float32(0.5)) * (x * x).sum(-1, keepdims=True).astype(dtype)
                / (y * y).sum(-1, keepdims=True)),
    }[operation]  # fmt: skip
    _, function, reference, bounds = OPERATIONS[operation]
    ((value, magnitude),) = reference(*inputs)
    with jax.enable_x64(dtype == "float64"):
        computed = jax.jit(jax.vmap(lambda *a: function(*a, precision)[0]))(*map(jnp.asarray, inputs))
        assert error.in_u_of(computed, value, magnitude).max() <= bounds[0]


@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "float32", "float64"])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 64])
def test_wrench_from_point_forces(n, dtype):
    rng = np.random.default_rng(n)
    points, forces = (rng.standard_normal((5, n, 3)).astype(jnp.dtype(dtype)) for _ in range(2))
    (tau, tau_mag), (f, f_mag) = _point_forces(points, forces)
    bound = 2 + int(np.ceil(np.log2(n)))
    with jax.enable_x64(dtype == "float64"):
        for precision in js.Precision:
            for context in (lambda g: g, jax.jit, lambda g: jax.jit(jax.vmap(g))):
                F = context(lambda p, f, q=precision: js.wrench_from_point_forces(p, f, precision=q))(points, forces)
                assert error.in_u_of(F.tau, tau, tau_mag).max() <= bound
                assert error.in_u_of(F.f, f, f_mag).max() <= bound


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("family", ["benign", "mixed_scales", "nearly_parallel", "just_above_powers_of_two"])
def test_central_axis(family, dtype):
    t, u = FAMILIES[family](np.random.default_rng(11), 2, 100, jnp.dtype(dtype))
    squared = (exact.rationals(u) ** 2).sum(-1)
    pitch, pitch_mag = exact.evaluate(lambda tau, f: (tau * f).sum(-1) / (f * f).sum(-1), t, u)
    point, point_mag = exact.evaluate(lambda tau, f: np.cross(f, tau), t, u)
    with jax.enable_x64(dtype == "float64"):
        for precision in js.Precision:
            axis = jax.jit(jax.vmap(lambda F, q=precision: js.central_axis(F, precision=q)))(js.SpatialForce(t, u))
            assert error.in_u_of(axis.pitch, pitch, pitch_mag).max() <= 7
            assert error.in_u_of(axis.point, point / squared[:, None], point_mag / squared[:, None]).max() <= 7


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("family", ["benign", "just_above_powers_of_two"])
@pytest.mark.parametrize("oblique", [False, True])
def test_center_of_pressure(oblique, family, dtype):
    t, u, m = FAMILIES[family](np.random.default_rng(13), 3, 100, jnp.dtype(dtype))
    m = m if oblique else np.broadcast_to(np.array([0, 0, 2.5], dtype), m.shape)
    f, normal = map(exact.rationals, (u, m))
    pressing = (normal * f).sum(-1)[:, None]
    moment, moment_mag = exact.evaluate(lambda tau, normal: np.cross(normal, tau), t, m)
    exact_point = moment / pressing
    c = abs(pressing) / abs(normal * f).sum(-1)[:, None]
    allowed = 3.5 * moment_mag / abs(pressing) + 4 * abs(exact_point) / c
    assert (c.astype(float) >= 24 * float(error.unit_roundoff(dtype))).all()
    with jax.enable_x64(dtype == "float64"):
        for precision in js.Precision:
            function = jax.jit(jax.vmap(lambda F, m, q=precision: js.center_of_pressure(F, m, precision=q)))
            assert error.in_u_of(function(js.SpatialForce(t, u), m), exact_point, allowed).max() <= 1


@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "float32", "float64"])
def test_scaling_rounds_once(dtype):
    x, y, s = FAMILIES["benign"](np.random.default_rng(5), 3, 50, jnp.dtype(dtype))
    factors = s[:, 0]
    with jax.enable_x64(dtype == "float64"):
        F = js.SpatialForce(x, y)
        for scaled, exactly in ((F * factors, exact.rationals(x) * exact.rationals(factors)[:, None]),
                                (F / factors, exact.rationals(x) / exact.rationals(factors)[:, None])):  # fmt: skip
            assert error.in_u_of(scaled.tau, exactly, abs(exactly)).max() <= 1
