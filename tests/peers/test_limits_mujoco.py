"""Limits and dry friction in the convex step, against MuJoCo's, where both model the same."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js

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


def test_slides_and_a_ball_rub_as_a_free_joint_does():
    """What the page names in place of friction of a free joint: where it slides, MuJoCo's forces; else it stays."""
    tail = '<geom type="box" size="0.15 0.1 0.05" mass="2"/></body></worldbody></mujoco>'
    head = '<mujoco><option gravity="0 0 0"/><worldbody><body name="a">'
    axes = zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
    slides = "".join(f'<joint name="{x}" type="slide" axis="{axis}" frictionloss="0.3"/>' for x, axis in axes)
    mech = js.Mechanism.from_mjcf(f'{head}{slides}<joint type="ball" frictionloss="0.3"/>{tail}', dtype=np.float64)
    without = mech.replace(friction_loss=np.zeros(6))
    model = mujoco.MjModel.from_xml_string(f'{head}<joint type="free" frictionloss="0.3"/>{tail}')
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
