"""Laws of spatial algebra on random input: they need no other engine, and catch what a wrong sign or frame would break.

In float64, with the tolerance that rounding asks for: a few units of the sizes of what is added up.
"""

import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

N, TOLERANCE = 200, 2e-14
precisions = pytest.mark.parametrize("precision", ["reproducible", slow("compensated")])


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def _vectors(seed, count=2):
    return [jnp.asarray(x) for x in np.random.default_rng(seed).standard_normal((count, N, 3))]


def _velocity(seed=0):
    return js.SpatialVelocity(*_vectors(seed))


def _force(seed=1):
    return js.SpatialForce(*_vectors(seed))


def _pose(seed=2):
    w, p = _vectors(seed)
    return js.RigidTransform(js.Rotation.exp(w), p)


def _inertia(seed=3):
    """Random bodies: boxes, turned and moved."""
    rng = np.random.default_rng(seed)
    size, mass = (jnp.asarray(rng.uniform(0.2, 2.0, (N, k))) for k in (3, 1))
    return js.act(_pose(seed + 100), js.SpatialInertia.solid_box(size, mass=mass[:, 0]))


def _law(test):
    """The law, which gives (one side, the other, the size of what is added up), evaluated in NumPy."""

    @functools.wraps(test)
    def hold(*arguments, **case):
        sizes = []

        def sides():
            *found, sizes[:] = zip(*test(*arguments, **case), strict=True)
            return found

        for x, y, size in zip(*interpreted(sides)(), sizes, strict=True):
            chex.assert_trees_all_close(x, y, rtol=0, atol=TOLERANCE * size)

    return hold


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
@_law
def test_power_changes_neither_with_the_point_nor_with_the_frame(precision):
    F, V, X = _force(), _velocity(), _pose()
    power = js.dot(F, V)
    p = X.translation
    shifted = [js.shift(x, p, precision=precision) for x in (F, V)]
    yield js.dot(*shifted, precision=precision), power, 10
    yield js.dot(*(js.rotate(X.rotation, x, precision=precision) for x in (F, V))), power, 10
    yield js.dot(*(js.act(X, x, precision=precision) for x in (F, V))), power, 10
    yield js.dot(*(js.act_inverse(X, x, precision=precision) for x in (F, V))), power, 10


@precisions
@_law
def test_to_act_is_to_shift_and_to_rotate(precision):
    X, w = _pose(), _vectors(5, 1)[0]
    for vector in (_force(), _velocity(), js.SpatialMomentum(*_vectors(6))):
        turned = js.rotate(X.rotation, vector)
        yield js.act(X, vector, precision=precision), js.shift(turned, -X.translation), 10
        yield js.act_inverse(X, js.act(X, vector, precision=precision), precision=precision), vector, 10
    A = js.SpatialAcceleration(*_vectors(7))
    turned = js.shift(js.rotate(X.rotation, A), -X.translation, X.rotation @ w)
    yield js.act(X, A, w, precision=precision), turned, 100
    yield js.act_inverse(X, turned, X.rotation @ w, precision=precision), A, 100


@precisions
@_law
def test_acting_twice_is_acting_with_the_product(precision):
    X, Y = _pose(2), _pose(4)
    for x in (_force(), _velocity(), _inertia()):
        yield js.act(X, js.act(Y, x, precision=precision), precision=precision), js.act(X @ Y, x), 100


@precisions
@_law
def test_cross_products_are_dual_and_obey_jacobi(precision):
    U, V, W, F = _velocity(8), _velocity(9), _velocity(10), _force()

    def cross(a, b):
        return js.cross(a, b, precision=precision)

    yield js.dot(cross(V, F), W), -js.dot(F, cross(V, W)), 10
    yield (cross(U, cross(V, W)) + cross(V, cross(W, U)) + cross(W, cross(U, V))).to_array(), np.zeros((N, 6)), 100
    yield cross(V, W), -cross(W, V), 10
    X = _pose()
    yield js.act(X, cross(V, W)), cross(js.act(X, V), js.act(X, W)), 100
    yield js.act(X, cross(V, F)), cross(js.act(X, V), js.act(X, F)), 100


@precisions
@_law
def test_momentum_and_energy_of_a_body(precision):
    M, V, X = _inertia(), _velocity(), _pose()
    p, momentum = X.translation, M.apply(V, precision=precision)
    energy = M.kinetic_energy(V, precision=precision)
    yield js.dot(momentum, V) / 2, energy, 100
    yield js.shift(M, p) @ js.shift(V, p), js.shift(momentum, p), 1000
    yield js.act(X, M) @ js.act(X, V), js.act(X, momentum), 1000
    for moved, by in ((js.shift(M, p), js.shift(V, p)), (js.act(X, M), js.act(X, V)), (X.rotation @ M, X.rotation @ V)):
        yield moved.kinetic_energy(by, precision=precision), energy, 1000
    yield (M.to_matrix() @ V.to_array()[..., None])[..., 0], momentum.to_array(), 1000


@precisions
@_law
def test_bodies_put_together(precision):
    a, b, c = _inertia(11), _inertia(12), _inertia(13)
    V = _velocity()

    def plus(x, y):
        return x.combine(y, precision=precision)

    yield plus(plus(a, b), c), plus(a, plus(b, c)), 1000
    yield plus(a, b), plus(b, a), 100
    yield plus(a, b) @ V, (a @ V) + (b @ V), 1000
    yield plus(a, b).remove(b, precision=precision), a, 1000
    together = jax.tree.map(lambda *x: jnp.stack(x), a, b, c)
    yield together.sum(0, precision=precision), plus(plus(a, b), c), 1000


def _path(t):
    """A pose that moves, and one that moves in it: smooth, with nothing special about it."""
    w, p, w2, p2 = (jnp.asarray(x) for x in np.random.default_rng(14).standard_normal((4, 3, 3)))
    powers = jnp.stack([jnp.ones_like(t), t, t * t])
    first, second = ((powers @ a, powers @ b) for a, b in ((w, p), (w2, p2)))
    return [js.RigidTransform(js.Rotation.exp(a), b) for a, b in (first, second)]


def _motion(pose):
    """(X, V, A) at t = 0.3 of a frame's origin in the fixed frame, by differentiation of its pose."""

    def velocity(t):
        X, rate = jax.jvp(pose, (t,), (jnp.ones_like(t),))
        spin = rate.rotation.to_matrix() @ X.rotation.to_matrix().T
        return X, jnp.stack([spin[2, 1], spin[0, 2], spin[1, 0]]), rate.translation

    t = jnp.asarray(0.3)
    (X, w, v), (_, alpha, a) = jax.jvp(velocity, (t,), (jnp.ones_like(t),))
    return X, js.SpatialVelocity(w, v), js.SpatialAcceleration(alpha, a)


@_law
def test_motion_in_a_moving_frame_is_the_derivative_of_the_pose():
    X_MB, V_MB, A_MB = _motion(lambda t: _path(t)[0])
    X_BC, V_BC, A_BC = _motion(lambda t: _path(t)[1])
    _, V_MC, A_MC = _motion(lambda t: _path(t)[0] @ _path(t)[1])
    R = X_MB.rotation
    p, V, A = R @ X_BC.translation, R @ V_BC, R @ A_BC
    yield V_MB.compose_with_moving_frame(p, V), V_MC, 100
    yield A_MB.compose_with_moving_frame(p, V_MB.w, V, A), A_MC, 1000


@_law
def test_a_shifted_acceleration_is_that_of_the_other_point():
    X, V, A = _motion(lambda t: _path(t)[0])
    p_BQ_B = jnp.asarray([0.3, -1.2, 0.7])
    _, V_Q, A_Q = _motion(lambda t: _path(t)[0] @ js.RigidTransform(js.Rotation.identity(dtype=float), p_BQ_B))
    yield js.shift(V, X.rotation @ p_BQ_B), V_Q, 100
    yield js.shift(A, X.rotation @ p_BQ_B, V.w), A_Q, 1000


@_law
def test_newton_and_euler_is_the_rate_of_momentum():
    """About a fixed point of the world: the momentum of a body that is carried along the path."""
    M_B = jax.tree.map(lambda x: x[0], _inertia())

    def momentum(t):
        X, rate = jax.jvp(lambda t: _path(t)[0], (t,), (jnp.ones_like(t),))
        spin = rate.rotation.to_matrix() @ X.rotation.to_matrix().T
        V_B = js.SpatialVelocity(jnp.stack([spin[2, 1], spin[0, 2], spin[1, 0]]), rate.translation)
        return js.shift((X.rotation @ M_B) @ V_B, -X.translation)

    t = jnp.asarray(0.3)
    _, rate = jax.jvp(momentum, (t,), (jnp.ones_like(t),))
    X, V, A = _motion(lambda t: _path(t)[0])
    F = js.shift(js.newton_euler(X.rotation @ M_B, A, V), -X.translation)
    yield (F.tau, F.f), (rate.h, rate.l), 1000
    Y = js.regressors.newton_euler_regressor(A, V)
    by_regressor = Y @ (X.rotation @ M_B).to_dynamic_parameters()
    yield by_regressor, js.newton_euler(X.rotation @ M_B, A, V).to_array(), 1000


@_law
def test_featherstones_acceleration_is_the_rate_of_the_velocity_seen_from_a_fixed_point():
    _, V, A = _motion(lambda t: _path(t)[0])
    spatial = A.to_featherstone(V)
    yield spatial[3:], A.a - jnp.cross(V.w, V.v), 100
    yield js.SpatialAcceleration.from_featherstone(spatial, V), A, 100
