"""External forces in derivatives in closed form: several on one body, on frames welded to it, and on others."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

FRAMES = ("upper", "lower", "tool", "tip", "elbow")


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def pose(rng):
    q = rng.standard_normal(4)
    return js.RigidTransform(js.Rotation.from_quaternion(q / np.linalg.norm(q)), rng.standard_normal(3))


@functools.cache
def arm():
    """Two bodies that move, a tool welded to the second, and frames on the first and on the tool."""
    rng = np.random.default_rng(0)
    inertia = js.SpatialInertia(2.0, np.array([0.1, -0.2, 0.3]), np.diag([0.3, 0.4, 0.5]))
    joints = [
        js.Joint("shoulder", "universal", "world", "upper", placement=pose(rng)),
        js.Joint("elbow joint", "cylindrical", "upper", "lower", placement=pose(rng)),
        js.Joint("weld", "fixed", "lower", "tool", placement=pose(rng)),
    ]
    frames = [js.Frame("tip", "tool", pose(rng)), js.Frame("elbow", "upper", pose(rng))]
    bodies = [js.Body(name, inertia) for name in ("upper", "lower", "tool")]
    return js.Mechanism.build(bodies, joints, frames=frames, dtype=np.float64)


@functools.cache
def state():
    mech, rng = arm(), np.random.default_rng(1)
    q = js.random_configuration(mech, jax.random.key(0), (), np.float64)
    return q, *(jnp.asarray(x) for x in rng.standard_normal((2, mech.nv)))


@functools.cache
def programs():
    """(derivatives under forces on all frames, the change of all -J^T F with the configuration)."""
    mech, (q, v, a) = arm(), state()

    def closed(forces):
        return js.inverse_dynamics_derivatives(mech, q, v, a, forces)

    def by_jacobians(forces):
        def pulled(step):
            moved = js.integrate(mech, q, step)
            return -sum(js.jacobian(mech, moved, name).T @ F.to_array() for name, F in forces.items())

        return jax.jacfwd(pulled)(jnp.zeros(mech.nv))

    return interpreted(closed), interpreted(by_jacobians)


@pytest.mark.parametrize("pulled", [*FRAMES, "all"])
def test_loads_change_derivatives_as_jacobians_change(pulled):
    """What derivatives of inverse dynamics have of loads is that of -J^T F; none by rate or acceleration."""
    rng, (closed, by_jacobians) = np.random.default_rng(2), programs()
    forces = {name: js.SpatialForce(*rng.standard_normal((2, 3))) for name in FRAMES}
    forces = {name: F if pulled in (name, "all") else F * 0.0 for name, F in forces.items()}
    nothing = {name: F * 0.0 for name, F in forces.items()}
    found, without, expected = closed(forces), closed(nothing), np.asarray(by_jacobians(forces))
    scale = abs(expected).max() + abs(np.asarray(without.dtau_dq)).max()
    np.testing.assert_allclose(found.dtau_dq - without.dtau_dq, expected, atol=256 * 2.0**-53 * scale)
    assert abs(expected).max() > 0.1
    np.testing.assert_array_equal(found.dtau_dv, without.dtau_dv)
    np.testing.assert_array_equal(found.dtau_dvdot, without.dtau_dvdot)
