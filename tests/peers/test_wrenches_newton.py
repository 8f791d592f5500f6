"""body_f against Newton itself, on the CPU: one short step from rest of three worlds, and poses of its bodies."""

import functools
import warnings

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop

newton = pytest.importorskip("newton")
WORLDS, DT = 3, 1e-6
MODEL = """
<mujoco model="two"><compiler angle="radian"/><worldbody>
  <body name="a" pos=".1 .2 2"><freejoint/>
    <inertial pos=".05 -.02 .03" quat=".8 .2 .3 -.1" mass="2" diaginertia=".04 .03 .02"/>
    <body name="b" pos=".2 0 .1" quat=".7 .1 .5 -.2"><joint axis=".2 .3 1" pos=".02 .01 -.03"/>
      <inertial pos=".02 .05 -.04" mass="1.3" fullinertia=".03 .025 .02 .003 -.002 .001"/>
      <body name="c" pos="0 .3 .1"><joint axis="1 1 0"/>
        <inertial pos="0 .01 0" mass=".7" diaginertia=".02 .02 .01"/></body></body></body>
</worldbody></mujoco>
"""


@functools.cache
def case():
    """(Newton's model without gravity, our mechanism, configurations of all worlds, forces)."""
    one, many = (newton.ModelBuilder(gravity=(0.0, 0.0, 0.0)) for _ in range(2))
    one.add_mjcf(MODEL)
    many.replicate(one, WORLDS)
    model = many.finalize(device="cpu")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", interop.ModelFileWarning)
        mech = js.Mechanism.from_mjcf(MODEL.replace("<worldbody>", '<option gravity="0 0 0"/><worldbody>'))
    q = js.random_configuration(mech, jax.random.key(0), WORLDS)
    # A free joint has its position first in Newton, then a quaternion xyzw.
    theirs = np.concatenate([q[:, 4:7], q[:, 1:4], q[:, :1], q[:, 7:]], 1)
    model.joint_q.assign(theirs.ravel())
    model.joint_qd.zero_()
    rng, frames = np.random.default_rng(0), ("a", "c", "c", "b")
    F = js.SpatialForce(*rng.normal(size=(2, WORLDS, len(frames), 3)).astype(np.float32))
    points = rng.normal(size=(len(frames), 3)).astype(np.float32)
    return model, mech, q, js.AppliedForces(frames, F, points, axes="frame")


def at_rest(model):
    state = model.state()
    newton.eval_fk(model, model.joint_q, model.joint_qd, state)
    return state


def test_bodies_are_where_ours_are():
    model, mech, q, _ = case()
    X = interop.orders.pose_from_xyz_xyzw(at_rest(model).body_q.numpy().reshape(WORLDS, -1, 7))
    ours = js.forward_kinematics(mech, q)
    np.testing.assert_allclose(X.to_matrix(), ours.to_matrix(), rtol=0, atol=2.0**-20)


@pytest.mark.parametrize("solver", ["SolverFeatherstone", "SolverMuJoCo"])
def test_a_step_from_rest_has_our_accelerations(solver):
    """Of the centres of mass, which is what Newton tells the velocities of."""
    if solver == "SolverMuJoCo":
        pytest.importorskip("mujoco_warp")
    model, mech, q, forces = case()
    before, after = at_rest(model), model.state()
    x = interop.newton.to_body_f(model, mech, q, forces)
    before.body_f.assign(np.asarray(x).reshape(-1, 6))
    options = {"angular_damping": 0.0} if solver == "SolverFeatherstone" else {}
    getattr(newton.solvers, solver)(model, **options).step(before, after, model.control(), None, DT)
    found = after.body_qd.numpy().reshape(WORLDS, -1, 6) / DT
    rest = np.zeros((WORLDS, mech.nv), np.float32)
    vdot = js.forward_dynamics(mech, q, rest, rest, forces)
    A_WBo_W, X_WB = js.body_accelerations(mech, q, rest, vdot), js.forward_kinematics(mech, q)
    com = model.body_com.numpy().reshape(WORLDS, -1, 3)
    A_WBcm_W = js.shift(A_WBo_W, X_WB.rotation @ com, np.zeros_like(com))
    expected = interop.orders.to_linear_first(A_WBcm_W)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2.0**-15 * abs(expected).max())


def test_what_is_read_has_the_same_generalized_forces():
    model, mech, q, forces = case()
    state, rest = model.state(), np.zeros((WORLDS, mech.nv), np.float32)
    state.body_f.assign(np.asarray(interop.newton.to_body_f(model, mech, q, forces)).reshape(-1, 6))
    back = interop.newton.from_body_f(model, state.body_f)
    expected = js.bias_forces(mech, q, rest, forces)
    np.testing.assert_allclose(
        js.bias_forces(mech, q, rest, back), expected, rtol=0, atol=2.0**-20 * abs(expected).max()
    )
