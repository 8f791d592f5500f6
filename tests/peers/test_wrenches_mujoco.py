"""Wrenches as xfrc_applied of MuJoCo, against mj_applyFT and mj_forward in float64, and of MJX in float32.

Robots are those of Brax: an arm with fingers welded to it, a quadruped with bodies that have no names, a humanoid with
several joints on one body. What is added up differs in its order alone: tolerances are a few u = 2^-53 of the sizes.
"""

import functools
import pathlib
import warnings

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import mujoco as states
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow
from tests.helpers.optional import needs

ROBOTS = ("pusher", "ant", "humanoid")
robots = pytest.mark.parametrize("name", ROBOTS)
N = 4
U = 2.0**-53
KINDS = ("DAMPER", "SPRING", "CONSTRAINT", "ACTUATION")


@pytest.fixture
def float64():
    with jax.enable_x64(True):
        yield


@functools.cache
def robot(name):
    """(the model, without what acts on it but gravity; our mechanism; N configurations)."""
    file = pathlib.Path(needs("brax").__file__).parent / f"envs/assets/{name}.xml"
    model = mujoco.MjModel.from_xml_path(str(file))
    for kind in KINDS:
        model.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{kind}"))
    with warnings.catch_warnings(), jax.enable_x64(True):
        warnings.simplefilter("ignore", js.interop.ModelFileWarning)
        mech = js.Mechanism.from_mjcf(file, dtype=np.float64)
        q = js.random_configuration(mech, jax.random.key(1), N, np.float64)
    return model, mech, q


def frames(mech):
    """All that have a body in MuJoCo, which a camera has not: the welded ones, and some twice."""
    names = [name for name in mech.frame_names if name != "world" and "/" not in mech.frame_body(name)]
    names = [name for name in names if not name.startswith("cam_")]
    return *names, names[-1], names[0]


def applied(mech, axes, dtype=np.float64, batch=(N,), seed=0):
    """A wrench on every frame, at a point of its own."""
    names, rng = frames(mech), np.random.default_rng(seed)
    tau, f = rng.normal(size=(2, *batch, len(names), 3)).astype(dtype)
    return js.AppliedForces(names, js.SpatialForce(tau, f), rng.normal(size=(len(names), 3)).astype(dtype), axes)


def at_state(model, mech, q):
    data = mujoco.MjData(model)
    data.qpos[:] = states.to_qpos(mech, q)
    mujoco.mj_forward(model, data)
    return data


def xfrc_applied(model, mech, q, forces):
    return interpreted(lambda q, forces: states.to_xfrc_applied(model, mech, q, forces))(q, forces)


def body(model, name):
    """The body of MuJoCo that a frame is; of one without a name by its number."""
    return int(name.removeprefix("body_")) if name.startswith("body_") else model.body(name).id


def generalized(model, data, forces, i):
    """The sum of mj_applyFT over the wrenches of state i, each at its own point on its own body."""
    qfrc = np.zeros(model.nv)
    for k, name in enumerate(forces.frames):
        b = body(model, name)
        R_WB = data.xmat[b].reshape(3, 3)
        turned = R_WB if forces.axes == "frame" else np.eye(3)
        f, tau = turned @ forces.wrenches.f[i, k], turned @ forces.wrenches.tau[i, k]
        mujoco.mj_applyFT(model, data, f, tau, data.xpos[b] + R_WB @ forces.points[k], b, qfrc)
    return qfrc


def generalized_of_rows(model, data, rows):
    """The same sum over rows of xfrc_applied, about the centres of mass."""
    qfrc = np.zeros(model.nv)
    for b, row in enumerate(np.array(rows)):
        mujoco.mj_applyFT(model, data, row[:3], row[3:], data.xipos[b], b, qfrc)
    return qfrc


@robots
@pytest.mark.parametrize("axes", ["world", "frame"])
def test_as_mj_apply_ft(name, axes, float64):
    model, mech, q = robot(name)
    forces = applied(mech, axes)
    rows = xfrc_applied(model, mech, q, forces)
    assert rows.shape == (N, model.nbody, 6)
    for i in range(N):
        data = at_state(model, mech, q[i])
        expected = generalized(model, data, forces, i)
        found = generalized_of_rows(model, data, rows[i])
        np.testing.assert_allclose(found, expected, rtol=0, atol=64 * U * abs(expected).max())


@robots
def test_a_dict_of_wrenches_about_origins(name, float64):
    """Frame by frame, as mj_applyFT at the origin of the body that MuJoCo has."""
    model, mech, q = robot(name)
    names, rng = frames(mech)[:-2], np.random.default_rng(1)
    wrenches = {frame: js.SpatialForce(*rng.normal(size=(2, N, 3))) for frame in names}
    rows = xfrc_applied(model, mech, q, wrenches)
    pulled = {body(model, mech.frame_body(frame)) for frame in names if mech.frame_body(frame) != "world"}
    assert {int(b) for b in np.flatnonzero(np.any(np.asarray(rows), (0, 2)))} == pulled
    for i in range(N):
        data, expected = at_state(model, mech, q[i]), np.zeros(model.nv)
        for frame, F in wrenches.items():
            b = body(model, frame)
            mujoco.mj_applyFT(model, data, np.array(F.f[i]), np.array(F.tau[i]), data.xpos[b], b, expected)
        found = generalized_of_rows(model, data, rows[i])
        np.testing.assert_allclose(found, expected, rtol=0, atol=64 * U * abs(expected).max())


@pytest.mark.parametrize("name", ["pusher", slow("ant"), slow("humanoid")])
def test_mj_forward_has_our_accelerations(name, float64):
    """And back: what is read of xfrc_applied gives the same."""
    model, mech, q = robot(name)
    forces = applied(mech, "frame", seed=2)
    v = jnp.asarray(np.random.default_rng(3).normal(size=(N, mech.nv)))
    rows = xfrc_applied(model, mech, q, forces)
    back = states.from_xfrc_applied(model, rows)
    assert back.axes == "world" and len(back.frames) == model.nbody - 1
    tau = jnp.zeros((N, mech.nv))
    dynamics = interpreted(lambda q, v, F: js.forward_dynamics(mech, q, v, tau, F))
    vdot, again = (dynamics(q, v, F) for F in (forces, back))
    qvel = interpreted(lambda q, v: states.to_qvel(mech, q, v))(q, v)
    qacc = interpreted(lambda q, v, vdot: states.to_qacc(mech, q, v, vdot))(q, v, vdot)
    for i in range(N):
        data = at_state(model, mech, q[i])
        data.qvel[:], data.xfrc_applied[:] = qvel[i], rows[i]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(qacc[i], data.qacc, rtol=0, atol=1e-12 * abs(data.qacc).max())
    np.testing.assert_allclose(again, vdot, rtol=0, atol=1e-12 * abs(vdot).max())


def test_rows_are_read_as_they_are(float64):
    """Force first, at the centre of mass, of every body but the world."""
    model, _, _ = robot("ant")
    rows = np.random.default_rng(0).normal(size=(N, model.nbody, 6))
    forces = states.from_xfrc_applied(model, rows)
    np.testing.assert_array_equal(forces.wrenches.f, rows[:, 1:, :3])
    np.testing.assert_array_equal(forces.wrenches.tau, rows[:, 1:, 3:])
    np.testing.assert_array_equal(forces.points, model.body_ipos[1:])
    assert forces.frames[:4] == ("torso", "front_left_leg", "aux_1", "body_4")


def test_under_grad_and_vmap(float64):
    """The work of xfrc_applied over a small turn, by the derivative, is that of the wrench: finite and not zero."""
    model, mech, q = robot("pusher")
    forces = applied(mech, "world", batch=())

    def total(q):
        return jnp.sum(states.to_xfrc_applied(model, mech, q, forces) ** 2)

    gradient = interpreted(jax.vmap(jax.grad(total)))(q)
    h = 1e-6
    ahead, behind = (interpreted(total)(q[0] + s * h * np.eye(mech.nq)[3]) for s in (1, -1))
    moved = (ahead - behind) / (2 * h)
    assert abs(moved) > 1
    np.testing.assert_allclose(gradient[0, 3], moved, rtol=1e-7)
    each = jax.jit(jax.vmap(lambda q: states.to_xfrc_applied(model, mech, q, forces)))(q)
    np.testing.assert_allclose(each, xfrc_applied(model, mech, q, forces), rtol=0, atol=1e-14)


def test_nothing_acts(float64):
    model, mech, q = robot("pusher")
    for forces in ({}, {"world": js.SpatialForce(np.ones(3), np.ones(3))}):
        rows = states.to_xfrc_applied(model, mech, q, forces)
        assert rows.shape == (N, model.nbody, 6) and not rows.any()


def test_what_mujoco_does_not_have_is_named(float64):
    model, mech, q = robot("humanoid")
    F = js.SpatialForce(np.ones(3), np.ones(3))
    with pytest.raises(KeyError, match="no body 'right_thigh/right_hip_x'; did you mean 'right_thigh'"):
        states.to_xfrc_applied(model, mech, q, {"right_thigh/right_hip_x": F})
    with pytest.raises(KeyError, match="did you mean 'pelvis'"):
        states.to_xfrc_applied(model, mech, q, {"pelviss": F})
    with pytest.raises(TypeError, match="Mechanism second"):
        states.to_xfrc_applied(model, model, q, {"pelvis": F})
    with pytest.raises(ValueError, match=rf"\*batch, {model.nbody}, 6"):
        states.from_xfrc_applied(model, np.zeros((model.nbody - 1, 6)))


SMALL = """
<mujoco><worldbody>
  <body name="base" pos="0 0 1"><freejoint/><inertial pos=".1 0 .02" mass="2" diaginertia=".1 .12 .15"/>
    <body name="arm" pos=".2 0 .3" quat=".8 .6 0 0"><joint axis="0 1 0"/>
      <inertial pos=".1 .03 .05" mass="1" diaginertia=".02 .03 .02"/>
      <body name="hand" pos="0 .1 .4"><inertial pos="0 0 .1" mass=".2" diaginertia=".001 .001 .001"/></body>
    </body></body>
</worldbody></mujoco>
"""


def test_a_model_of_mjx_has_the_rows_of_its_own():
    """In float32, of several states."""
    mjx, model, mech = needs("mujoco.mjx"), mujoco.MjModel.from_xml_string(SMALL), js.Mechanism.from_mjcf(SMALL)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        on_device = mjx.put_model(model)
    q, forces = js.random_configuration(mech, jax.random.key(0), N), applied(mech, "frame", np.float32)
    found, expected = (xfrc_applied(x, mech, q, forces) for x in (on_device, model))
    assert found.dtype == np.float32 and abs(expected).max() > 1
    np.testing.assert_allclose(found, expected, rtol=0, atol=16 * 2.0**-24 * abs(expected).max())


@pytest.mark.slow
def test_512_environments_of_mjx():
    """mjx.step by vmap, from data whose xipos are those of another state: the accelerations are ours."""
    mjx, n = needs("mujoco.mjx"), 512
    model = mujoco.MjModel.from_xml_string(SMALL)
    mech = js.Mechanism.from_mjcf(SMALL)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        on_device, start = mjx.put_model(model), mjx.make_data(model)
        q = js.random_configuration(mech, jax.random.key(0), n)
        v = jnp.asarray(np.random.default_rng(0).normal(size=(n, mech.nv)), jnp.float32)
        forces = applied(mech, "frame", np.float32, (n,))

        @functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})
        @jax.vmap
        def step(q, v, forces):
            rows = states.to_xfrc_applied(on_device, mech, q, forces)
            data = start.replace(qpos=states.to_qpos(mech, q), qvel=states.to_qvel(mech, q, v), xfrc_applied=rows)
            return mjx.step(on_device, data).qacc

        # vmap maps over every leaf: the points are given for each environment too.
        many = js.AppliedForces(forces.frames, forces.wrenches, np.tile(forces.points, (n, 1, 1)), forces.axes)
        found = step(q, v, many)
        ours = interpreted(lambda q, v, F: states.to_qacc(mech, q, v, js.forward_dynamics(mech, q, v, 0 * v, F)))
        expected = ours(q, v, forces)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2.0**-17 * abs(expected).max())
