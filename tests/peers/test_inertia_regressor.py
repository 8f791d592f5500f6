"""Regressors and the force of inertia against Pinocchio, whose vectors hold the linear part first, in float64.

Pinocchio takes spatial accelerations, the classical one less w x v, and its body regressor multiplies the ten
parameters in the same order. Both sides err by a few u mag, mag the sum of the absolute values of a component's terms.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia
from jaxspatial.inertia.newton_euler import newton_euler
from jaxspatial.inertia.regressors import newton_euler_regressor
from tests.helpers.interpreted import interpreted
from tests.helpers.optional import needs

pin = needs("pinocchio")

N, EPS = 50, float(np.finfo(float).eps)


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def motions():
    """(V, A classical), and the same as Pinocchio's motions."""
    rng = np.random.default_rng(0)
    w, v, alpha, a = rng.standard_normal((4, N, 3)) * 10 ** rng.uniform(-3, 3, (4, N, 1))
    velocities = [pin.Motion(*x) for x in zip(v, w, strict=True)]
    accelerations = [pin.Motion(x - np.cross(y, z), n) for x, y, z, n in zip(a, w, v, alpha, strict=True)]
    V = js.SpatialVelocity(jnp.asarray(w), jnp.asarray(v))
    return V, js.SpatialAcceleration(jnp.asarray(alpha), jnp.asarray(a)), velocities, accelerations


def test_body_regressor():
    V, A, velocities, accelerations = motions()
    theirs = np.array([pin.bodyRegressor(v, a) for v, a in zip(velocities, accelerations, strict=True)])
    theirs = np.concatenate([theirs[:, 3:], theirs[:, :3]], 1)
    # They add w x v to the acceleration again: what cancels there is an error of theirs.
    w, v, a = (np.linalg.norm(x, axis=-1) for x in (V.w, V.v, A.a))
    size = np.linalg.norm(A.alpha, axis=-1) + w * w + a + 2 * w * v
    for precision in js.Precision:
        ours = interpreted(functools.partial(newton_euler_regressor, precision=precision))(A, V)
        assert (abs(ours - theirs).max((-1, -2)) <= 4 * EPS * size).all()


def test_force_of_a_moving_body():
    V, A, velocities, accelerations = motions()
    bodies = [pin.Inertia.Random() for _ in range(N)]
    forces = [M * a + v.cross(M * v) for M, v, a in zip(bodies, velocities, accelerations, strict=True)]
    pi = np.array([M.toDynamicParameters() for M in bodies])
    M = SpatialInertia.from_dynamic_parameters(jnp.asarray(pi))
    # Their momentum in a cross product with the velocity: v x m v is what cancels.
    w, v, alpha, a = (np.linalg.norm(x, axis=-1) for x in (V.w, V.v, A.alpha, A.a))
    size = (alpha + a + (w + v) ** 2) * abs(pi).sum(-1)
    theirs = np.array([[*F.angular, *F.linear] for F in forces])
    assert (abs(newton_euler(M, A, V).to_array() - theirs).max(-1) <= 16 * EPS * size).all()
