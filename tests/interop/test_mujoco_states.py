"""States of a whole mechanism to and from MuJoCo's: orders, frames and signs, of a file that MuJoCo compiles too."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import mujoco as states
from tests.helpers.interpreted import interpreted

pytestmark = pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")

TREE = """<mujoco><worldbody>
  <body name="base"><freejoint/><geom size="1"/><body name="arm"><joint name="a"/><geom size="1"/>
    <body name="hand"><joint type="ball"/><geom size="1"/></body></body>
    <body name="other"><joint name="b"/><geom size="1"/></body></body>
</worldbody><equality><joint joint1="a" joint2="b" polycoef=".5 -2"/></equality></mujoco>"""
# A quarter turn about z, and where it is.
BASE = [np.sqrt(0.5), 0, 0, np.sqrt(0.5), 1, 2, 3]
Q = np.array([*BASE, 1, 0, 0, 0, 0.25], np.float32)
V = np.array([1, 2, 3, 10, 20, 30, 4, 5, 6, 7], np.float32)


def test_orders():
    """In MuJoCo the position comes before the quaternion, the velocity in world axes before the spin in the body's."""
    mech, model = js.Mechanism.from_mjcf(TREE), mujoco.MjModel.from_xml_string(TREE)
    qpos, qvel = interpreted(lambda q, v: (states.to_qpos(mech, q), states.to_qvel(mech, q, v)))(Q, V)
    assert (qpos.shape, qvel.shape) == ((model.nq,), (model.nv,))
    np.testing.assert_array_equal(qpos, np.float32([*BASE[4:], *BASE[:4], 0, 1, 0, 0, 0, 0.25]))
    np.testing.assert_allclose(qvel, [-20, 10, 30, 1, 2, 3, -14, 4, 5, 6, 7], rtol=1e-6)
    q, v = interpreted(lambda qpos, q, qvel: (states.from_qpos(mech, qpos), states.from_qvel(mech, q, qvel)))(
        qpos, Q, qvel
    )
    np.testing.assert_array_equal(q, Q)
    np.testing.assert_allclose(v, V, rtol=1e-6)


def test_acceleration_of_a_turning_body():
    """In its own axes a constant velocity of a body that turns is an acceleration: w x v."""
    mech = js.Mechanism.from_mjcf(TREE)
    qacc = states.to_qacc(mech, Q, V, np.zeros(10, np.float32))
    w_x_v = np.cross(V[:3], V[3:6])
    np.testing.assert_allclose(qacc, [-w_x_v[1], w_x_v[0], w_x_v[2], *[0] * 8], rtol=1e-6, atol=4e-6)
    np.testing.assert_allclose(states.from_qacc(mech, Q, V, qacc), 0, atol=4e-6)


def test_forces_have_the_power_of_ours():
    mech, tau = js.Mechanism.from_mjcf(TREE), np.array([3, 1, 4, 1, 5, 9, 2, 6, 5, 3], np.float32)
    qfrc = states.to_qfrc(mech, Q, tau)
    np.testing.assert_allclose(qfrc, [-5, 1, 9, 3, 1, 4, 0, 2, 6, 5, 3], rtol=1e-6)
    np.testing.assert_allclose(qfrc @ states.to_qvel(mech, Q, V), tau @ V, rtol=1e-6)
    # What acts on the mimic acts on the joint that it follows, by the ratio of -2.
    on_all = np.ones(11, np.float32)
    np.testing.assert_allclose(states.from_qfrc(mech, Q, on_all) @ V, on_all @ states.to_qvel(mech, Q, V), rtol=1e-6)


def test_batches_and_transformations(x64):
    mech = js.Mechanism.from_mjcf(TREE)
    dtype = jnp.float64 if x64 else jnp.float32
    q, v = np.stack([Q.astype(dtype)] * 3), V.astype(dtype)
    one = interpreted(lambda q, v: states.to_qvel(mech, q, v))(q[0], v)
    found = functools.partial(states.to_qvel, mech)(q, v)
    assert (found.shape, found.dtype) == ((3, 11), dtype)
    np.testing.assert_array_equal(found, [one] * 3)
    mapped = interpreted(jax.vmap(lambda q: states.from_qpos(mech, states.to_qpos(mech, q))))(q)
    np.testing.assert_array_equal(mapped, q)
    assert jax.jit(states.to_qpos)(mech, q).shape == (3, 13)


def test_what_comes_is_checked():
    mech = js.Mechanism.from_mjcf(TREE)
    with pytest.raises(ValueError, match=r"mujoco.from_qpos: qpos: expected shape \(\*batch, 13\), got \(12,\)"):
        states.from_qpos(mech, Q)
    with pytest.raises(ValueError, match=r"mujoco.to_qvel: v: expected shape \(\*batch, 10\), got \(12,\)"):
        states.to_qvel(mech, Q, Q)
    with pytest.raises(TypeError, match="mujoco.to_qpos: expected a Mechanism first, got ndarray"):
        states.to_qpos(Q, mech)
    with pytest.raises(ValueError, match="MuJoCo has no joints like 'joint0': planar"):
        states.to_qpos(js.testing.random_mechanism(0, 1, ["planar"]), np.zeros(3, np.float32))
