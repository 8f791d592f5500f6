"""Limits and dry friction in the convex step, against MuJoCo's, where both model the same."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import ModelFileWarning
from jaxspatial.interop import mujoco as states

mujoco = pytest.importorskip("mujoco")


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


MODEL = """<mujoco><option timestep="0.002" gravity="1 2 -9.81"/><compiler angle="radian"/><worldbody>
<body name="a"><joint name="j" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
<body name="b" pos="0.3 0 0"><joint name="k" axis="0 0 1" damping="0.5"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"/></body></body>
<body name="c" pos="0 1 0"><joint name="l" type="ball" range="0 0.7"/>
<geom type="capsule" fromto="0 0 0 0.3 0.1 0" size="0.03"/></body></worldbody>
<tendon><fixed name="t" limited="true" range="-0.4 0.5"><joint joint="j" coef="1"/><joint joint="k" coef="-0.5"/>
</fixed></tendon></mujoco>"""


def test_what_hangs_on_limits_as_in_mujoco():
    """At rest the limits carry the weight: their forces do not depend on how soft they are, nor do the lengths, but for
    MuJoCo's softness."""
    mech = js.Mechanism.from_mjcf(MODEL, dtype=np.float64)
    mech = mech.replace(damping=np.full(mech.nv, 0.3))
    model = mujoco.MjModel.from_xml_string(MODEL.replace('damping="0.5"', ""))
    model.dof_damping[:], data = 0.3, mujoco.MjData(model)
    for reference, share in ((model.jnt_solref, model.jnt_solimp), (model.tendon_solref_lim, model.tendon_solimp_lim)):
        reference[:], share[:, :2] = [0.004, 1.0], 0.999

    def rest(state, _):
        after = js.convex_step(mech, *state, np.zeros(mech.nv), 0.01)
        return (after.q, after.v), after.residual

    start = jnp.asarray(mech.neutral()), jnp.zeros(mech.nv)
    (q, v), residual = jax.jit(lambda s: jax.lax.scan(rest, s, None, 1500))(start)
    for _ in range(10_000):
        mujoco.mj_step(model, data)
    assert abs(v).max() < 1e-8 and residual.max() < 1e-6 and abs(data.qvel).max() < 1e-8
    # The tendon is at its upper limit, the ball at its angle.
    found, theirs = np.asarray(q), data.qpos
    assert abs(found[0] - 0.5 * found[1] - 0.5) < 1e-5 and abs(2 * np.arccos(found[2]) - 0.7) < 1e-5
    np.testing.assert_allclose(found, theirs, rtol=0, atol=1e-4)
    # Forces: at our rest, what holds it up is along the rows of the limits, as in MuJoCo's.
    bias = np.asarray(js.gravity_forces(mech, q))
    pull, axis = bias[0], found[3:] / np.linalg.norm(found[3:])
    np.testing.assert_allclose(bias[1], -0.5 * pull, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.cross(bias[2:], axis), 0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(bias, data.qfrc_constraint, rtol=0, atol=1e-4 * abs(bias).max())


COUPLED = """<mujoco><option timestep="0.002" gravity="1 2 -9"/><compiler angle="radian"/><worldbody>
<body name="a" pos="0 0 1" quat=".8 0 .6 0"><joint name="j" axis="0 1 0" ref=".1"/>
  <inertial pos=".1 .2 .3" mass="2" diaginertia=".1 .12 .15"/>
  <body pos=".3 0 .1"><joint name="k" axis="1 2 0" damping="0.3"/>
    <inertial pos="0 .1 .1" mass="1" diaginertia=".02 .03 .02"/>
    <body pos="0 .2 .1" quat=".6 .8 0 0"><joint name="l" type="slide" axis="0 1 1"/>
      <inertial pos=".1 .1 0" mass=".7" diaginertia=".02 .03 .02"/>
      <body><joint name="m" axis="1 0 0" ref="-.2"/><inertial pos=".1 0 .1" mass=".5" diaginertia=".02 .03 .02"/></body>
    </body></body></body></worldbody>
<tendon><fixed name="t"><joint joint="j" coef="1"/><joint joint="k" coef="-.5"/><joint joint="l" coef="2"/>
</fixed></tendon>
<equality><tendon name="coupling" tendon1="t" polycoef=".25" SOFT/><joint name="held" joint1="m" polycoef=".1" SOFT/>
</equality></mujoco>"""


def test_equalities_of_forms_as_in_mujoco():
    """Of three joints, and of one that is held. Closed, both push alike: by MuJoCo's M, bias and rows, as stiff as the
    step is here; and by its own accelerations, in which they are nearly rigid."""
    with pytest.warns(ModelFileWarning, match=r"of one length, which convex_step holds \(2: coupling, held\)"):
        mech = js.Mechanism.from_mjcf(COUPLED.replace("SOFT", ""), dtype=np.float64)
    model = mujoco.MjModel.from_xml_string(COUPLED.replace("SOFT", 'solref="0.004 1" solimp="0.9999 0.9999 1"'))
    data, rng, dt = mujoco.MjData(model), np.random.default_rng(0), 1e-4
    q, v = 0.3 * rng.normal(size=(4, 4)), rng.normal(size=(4, 4))
    # The forms hold, and so do their rates.
    q[:, 2], q[:, 3] = (0.35 - q[:, 0] + 0.5 * q[:, 1]) / 2, -0.1
    v[:, 2], v[:, 3] = (-v[:, 0] + 0.5 * v[:, 1]) / 2, 0
    after = jax.jit(lambda q, v: js.convex_step(mech, q, v, np.zeros((4, 4)), dt).v)(q, v)
    for i in range(4):
        data.qpos[:], data.qvel[:], M = q[i], v[i], np.zeros((4, 4))
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.efc_pos, 0, atol=1e-15)
        for column, unit in zip(M, np.eye(4), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        J, A = data.efc_J.reshape(2, 4), M + dt * np.diag(model.dof_damping)
        R = 0.01 / (4 * np.pi**2) * (J**2 / np.diag(A)).sum(1)
        H = A + J.T @ (J / R[:, None])
        expected = np.linalg.solve(H, A @ v[i] + dt * (data.qfrc_passive - data.qfrc_bias))
        np.testing.assert_allclose(after[i], expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose((after[i] - v[i]) / dt, data.qacc, rtol=0, atol=2e-3 * abs(data.qacc).max())


def read(text):
    with pytest.warns(ModelFileWarning, match="free joint read as slides NAME/x, NAME/y, NAME/z and a ball NAME/ball"):
        return js.Mechanism.from_mjcf(text, dtype=np.float64)


def test_a_free_joint_rubs_along_the_axes_of_the_world():
    """Where it slides or turns, with MuJoCo's forces; else it stays."""
    text = """<mujoco><option gravity="0 0 0"/><worldbody><body name="a"><joint type="free" frictionloss="0.3"/>
    <geom type="box" size="0.15 0.1 0.05" mass="2"/></body></worldbody></mujoco>"""
    mech, model = read(text), mujoco.MjModel.from_xml_string(text)
    without = mech.replace(friction_loss=np.zeros(6))
    data, rng, dt = mujoco.MjData(model), np.random.default_rng(0), 1e-3
    q, v, tau = rng.normal(size=(5, 7)), rng.normal(size=(5, 6)), np.zeros((5, 6))
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1, keepdims=True)
    v = v + 2 * np.sign(v)  # Slower, MuJoCo's friction gives way.
    v[4], tau[4] = 0, 0.5 * 0.3

    def rubbed(q, v, tau):
        after, free = (js.convex_step(m, q, v, tau, dt).v for m in (mech, without))
        return ((js.mass_matrix(mech, q) @ x[..., None])[..., 0] / dt for x in (after - free, after))

    found, left = jax.jit(lambda *x: tuple(rubbed(*x)))(q, v, tau)
    for i in range(4):
        data.qpos[:], data.qvel[:] = q[i], v[i]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(abs(data.qfrc_constraint), 0.3, rtol=1e-12)
        np.testing.assert_allclose(found[i], data.qfrc_constraint, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[4], -tau[4], rtol=2e-3)
    assert abs(left[4]).max() <= 1e-3 * 0.5 * 0.3


RUBBING = """<mujoco><option timestep="2e-4" gravity="1 2 -9"/><worldbody>
<body name="a" pos="1 2 3" quat=".8 0 .6 0"><joint name="f" type="free" frictionloss="0.3" damping="0.2" armature="0.1"
    stiffness="4"/>
  <inertial pos="0.1 0.2 0.3" mass="2" diaginertia="0.1 0.12 0.15"/>
  <body pos="0.3 0 0.1"><joint axis="1 2 0" damping="0.1"/>
    <inertial pos="0 0.1 0.1" mass="1" diaginertia="0.02 0.03 0.02"/></body></body></worldbody></mujoco>"""


def test_what_is_made_of_a_free_joint_that_rubs_moves_as_mujocos():
    """M, bias and springs, with numbers of each axis, as a model can have them; and 500 steps, in which all of it
    slides. States are MuJoCo's as they are."""
    model = mujoco.MjModel.from_xml_string(RUBBING)
    model.dof_armature[:6], model.dof_damping[:6] = np.arange(1, 7) / 20, np.arange(7, 1, -1) / 20
    model.dof_frictionloss[:6] = np.arange(1, 7) / 16
    mech, data, rng = read(model), mujoco.MjData(model), np.random.default_rng(1)
    q, v = rng.normal(size=8), np.array([2, -3, 2.5, 4, -5, 6, 1])
    q[3:7] /= np.linalg.norm(q[3:7])

    def step(state, _):
        after = js.convex_step(mech, *state, np.zeros(7), 2e-4)
        return (after.q, after.v), (after.q, after.v)

    def of_state(q, v):
        forces = js.mass_matrix(mech, q), js.bias_forces(mech, q, v), js.passive_forces(mech, q, 0 * v)
        return *forces, states.to_qpos(mech, q), states.to_qvel(mech, q, v)

    M, bias, springs, *state = jax.jit(of_state)(q, v)
    data.qpos[:], data.qvel[:], columns = q, v, np.zeros((7, 7))
    mujoco.mj_forward(model, data)
    for column, unit in zip(columns, np.eye(7), strict=True):
        mujoco.mj_mulM(model, data, column, unit)
    expected = columns, data.qfrc_bias, data.qfrc_spring, q, v
    for found, theirs in zip((M, bias, springs, *state), expected, strict=True):
        np.testing.assert_allclose(found, theirs, rtol=0, atol=1e-12 * abs(theirs).max())
    Q, V = jax.jit(lambda s: jax.lax.scan(step, s, None, 500)[1])((jnp.asarray(q), jnp.asarray(v)))
    for k in range(500):
        mujoco.mj_step(model, data)
        found = np.concatenate([Q[k], V[k]])
        np.testing.assert_allclose(found, np.concatenate([data.qpos, data.qvel]), rtol=0, atol=1e-9)
    assert (np.sign(V) == np.sign(v))[:, :6].all()
