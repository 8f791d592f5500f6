"""MuJoCo's arrays as ours, against what MuJoCo itself says of a model that moves, in float64; and MJX's arrays.

Tolerances are u = 2^-53 times the sizes that are multiplied, a few times: MuJoCo sums over the tree.
"""

import operator
import re

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop
from tests.helpers.interpreted import interpreted
from tests.helpers.optional import needs

U = 2.0**-53
MODEL = """
<mujoco>
  <option gravity="0.3 -0.2 -9.81"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 .1"/>
    <body name="a" pos=".1 .2 2" quat=".9 .1 -.3 .2"><freejoint/>
      <inertial pos=".05 -.02 .03" quat=".8 .2 .3 -.1" mass="2" diaginertia=".04 .03 .02"/>
      <body name="b" pos=".2 0 .1" quat=".7 .1 .5 -.2"><joint axis=".2 .3 1" pos=".02 .01 -.03"/>
        <inertial pos=".02 .05 -.04" mass="1.3" fullinertia=".03 .025 .02 .003 -.002 .001"/>
        <body name="c" pos="0 .3 .1"><joint type="slide" axis="1 1 0"/>
          <inertial pos="0 .01 0" mass=".7" diaginertia=".02 .02 .01"/>
        </body>
      </body>
    </body>
    <body name="box" pos="1 1 .28" quat="1 .02 .03 0"><freejoint/><geom type="box" size=".1 .2 .3"/></body>
  </worldbody>
</mujoco>
"""
NAMES = ("a", "b", "c", "box")


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module")
def state():
    """A model that moves, falls, is pushed, and touches the floor with one box."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    data.qvel[:] = rng.normal(size=model.nv)
    data.qpos[7:9] = rng.normal(size=2)
    data.xfrc_applied[1:4] = rng.normal(size=(3, 6))
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    return model, data


def near(ours, theirs, size=1.0, k=64):
    np.testing.assert_allclose(np.asarray(ours), np.asarray(theirs), rtol=0, atol=k * U * size)


def centres(model, data):
    """C of each body."""
    return data.subtree_com[model.body_rootid]


def body_object(model, data, of, name):
    """What MuJoCo says of a body's origin, in the world's axes."""
    result = np.zeros(6)
    of(model, data, mujoco.mjtObj.mjOBJ_XBODY, model.body(name).id, result, 0)
    return result


def test_poses(state):
    model, data = state
    X = js.RigidTransform(js.Rotation(data.xmat), data.xpos)
    of_quaternion = js.RigidTransform(js.Rotation.from_quaternion(data.xquat), data.xpos)
    near(of_quaternion.to_matrix(), X.to_matrix(), k=16)
    np.testing.assert_array_equal(X.translation, data.xpos)
    np.testing.assert_array_equal(X.rotation.entries, data.xmat)
    near(np.abs(np.sum(np.asarray(X.rotation.to_quaternion()) * data.xquat, -1)), 1, k=16)
    in_mjx = js.RigidTransform(js.Rotation.from_matrix(data.xmat.reshape(-1, 3, 3)), data.xpos)
    np.testing.assert_array_equal(in_mjx.to_matrix(), X.to_matrix())
    X_BI = js.RigidTransform(js.Rotation.from_quaternion(model.body_iquat), model.body_ipos)
    near((X @ X_BI).translation, data.xipos, k=16)


def test_cvel_shifted_to_the_body_is_its_velocity(state):
    model, data = state
    V_WC = js.SpatialVelocity.from_array(data.cvel)
    V_WB = js.shift(V_WC, data.xpos - centres(model, data))
    for name in NAMES:
        near(V_WB.to_array()[model.body(name).id], body_object(model, data, mujoco.mj_objectVelocity, name), 10)
    back = js.shift(V_WB, centres(model, data) - data.xpos).to_array()
    near(back, data.cvel, 10)


def test_cdof_are_the_columns_of_the_velocity(state):
    model, data = state
    columns = js.SpatialVelocity.from_array(data.cdof)
    V_C = (columns * data.qvel).to_array()[:8].sum(0)
    near(V_C, data.cvel[model.body("c").id], 10)
    np.testing.assert_array_equal(columns.to_array(), data.cdof)


def test_cacc_shifted_to_the_body_is_its_classical_acceleration(state):
    model, data = state
    gravity, offset = model.opt.gravity, data.xpos - centres(model, data)
    V_WC = js.SpatialVelocity.from_array(data.cvel)
    A_WC = interop.mujoco.from_cacc(data.cacc, data.cvel, gravity)
    A_WB = js.shift(A_WC, offset, V_WC.w)
    for name in NAMES:
        theirs = body_object(model, data, mujoco.mj_objectAcceleration, name)
        ours = jax.tree.map(operator.itemgetter(model.body(name).id), A_WB)
        near(interop.mujoco.to_object_acceleration(ours, gravity), theirs, 1e3)
        near(interop.mujoco.from_object_acceleration(theirs, gravity).to_array(), ours.to_array(), 1e3)
    np.testing.assert_array_equal(A_WC.to_array()[0], np.zeros(6))
    near(interop.mujoco.to_cacc(A_WC, V_WC, gravity), data.cacc, 1e2)


def test_free_joint(state):
    model, data = state
    body = model.body("a").id
    X = interop.orders.pose_from_xyz_wxyz(data.qpos[:7])
    near(X.to_matrix(), js.RigidTransform(js.Rotation(data.xmat), data.xpos).to_matrix()[body], 2)
    near(interop.orders.pose_to_xyz_wxyz(X), data.qpos[:7] * np.sign(data.qpos[3]), k=8)
    V = interop.mujoco.from_free_joint(js.SpatialVelocity, data.qvel[:6], X.rotation)
    near(V.to_array(), body_object(model, data, mujoco.mj_objectVelocity, "a"), 10)
    near(interop.mujoco.to_free_joint(V, X.rotation), data.qvel[:6], 10)
    A = interop.mujoco.from_free_joint(js.SpatialAcceleration, data.qacc[:6], X.rotation)
    theirs = body_object(model, data, mujoco.mj_objectAcceleration, "a")
    near(A.to_array(), interop.mujoco.from_object_acceleration(theirs, model.opt.gravity).to_array(), 1e3)
    near(interop.mujoco.to_free_joint(A, X.rotation), data.qacc[:6], 1e3)


def test_wrench_on_a_free_body_is_its_generalised_force(state):
    """xfrc_applied about the centre of mass, force first; in qfrc force first too, torque in body axes."""
    model, data = state
    body = model.body("a").id
    X = js.RigidTransform(js.Rotation(data.xmat[body]), data.xpos[body])
    F_Bo = js.SpatialForce(*np.random.default_rng(1).normal(size=(2, 3)))
    pushed = np.asarray(interop.orders.to_linear_first(js.shift(F_Bo, data.xipos[body] - data.xpos[body])))
    qfrc = np.zeros(model.nv)
    mujoco.mj_applyFT(model, data, pushed[:3].copy(), pushed[3:].copy(), data.xipos[body], body, qfrc)
    near(interop.mujoco.from_free_joint(js.SpatialForce, qfrc[:6], X.rotation).to_array(), F_Bo.to_array(), 10)
    near(interop.mujoco.to_free_joint(F_Bo, X.rotation), qfrc[:6], 10)
    F_Bcm = interop.orders.from_linear_first(js.SpatialForce, pushed)
    near(js.shift(F_Bcm, data.xpos[body] - data.xipos[body]).to_array(), F_Bo.to_array(), 10)


def test_cfrc_ext_is_what_was_applied_moved_to_the_centre(state):
    model, data = state
    applied = interop.orders.from_linear_first(js.SpatialForce, data.xfrc_applied[1:4])
    at_centre = js.shift(applied, (centres(model, data) - data.xipos)[1:4])
    ours = js.SpatialForce.from_array(data.cfrc_ext[1:4])
    near(ours.to_array(), at_centre.to_array(), 10)
    np.testing.assert_array_equal(ours.to_array(), data.cfrc_ext[1:4])
    power = js.dot(ours, js.SpatialVelocity.from_array(data.cvel[1:4])).sum()
    near(power, data.qvel @ generalised(model, data), 100)


def generalised(model, data):
    """xfrc_applied as MuJoCo puts it into joint coordinates."""
    qfrc = np.zeros(model.nv)
    for body in range(1, model.nbody):
        six = data.xfrc_applied[body]
        mujoco.mj_applyFT(model, data, six[:3].copy(), six[3:].copy(), data.xipos[body], body, qfrc)
    return qfrc


def test_contact_forces_are_the_force_on_the_box(state):
    model, data = state
    box, total = model.body("box").id, js.SpatialForce.zero()
    assert data.ncon
    for i in range(data.ncon):
        contact, six = data.contact[i], np.zeros(6)
        mujoco.mj_contactForce(model, data, i, six)
        assert model.geom_bodyid[contact.geom2] == box
        F = interop.mujoco.from_contact_force(six, contact.frame)
        near(interop.mujoco.to_contact_force(F, contact.frame), six, 1e3)
        total = total + js.shift(F, centres(model, data)[box] - contact.pos)
    assert total.f[2] > 1
    near(total.to_array(), data.cfrc_ext[box], 1e4)


def test_joint_force_is_its_own_part_of_cfrc_int(state):
    """The axis of a joint times the wrench between its bodies is the force in the joint, whatever else acts."""
    model, data = state[0], mujoco.MjData(state[0])
    data.qpos[:], data.qvel[:], data.xfrc_applied[:] = (
        getattr(state[1], name) for name in ("qpos", "qvel", "xfrc_applied")
    )
    data.qfrc_applied[6:8] = 1.7, -0.4
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    bodies = [model.body(name).id for name in "bc"]
    F, V = js.SpatialForce.from_array(data.cfrc_int[bodies]), js.SpatialVelocity.from_array(data.cdof[6:8])
    near(js.dot(F, V), [1.7, -0.4], 1e3)
    np.testing.assert_array_equal(F.to_array(), data.cfrc_int[bodies])


@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialVelocity], ids=lambda kind: kind.__name__)
def test_transform_spatial_is_shift_then_rotate(kind):
    rng = np.random.default_rng(2)
    for six in rng.normal(size=(20, 6)):
        old, new = rng.normal(size=(2, 3))
        R, result = js.Rotation.exp(rng.normal(size=3)), np.zeros(6)
        flag = kind is js.SpatialForce
        rotation = np.array(R.inverse().entries).reshape(9)
        mujoco.mju_transformSpatial(result, six, flag, new, old, rotation)
        ours = js.rotate(R, js.shift(kind.from_array(six), new - old))
        near(ours.to_array(), result, 10)


def test_arrays_of_mjx_are_the_same():
    mjx = needs("mujoco.mjx")
    model = mujoco.MjModel.from_xml_string(MODEL.replace('type="box"', 'type="sphere"'))
    with jax.enable_x64(False), jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        data = mujoco.MjData(model)
        data.qvel[:] = np.random.default_rng(0).normal(size=model.nv)
        mujoco.mj_forward(model, data)
        there = mjx.put_data(model, data)
        cvel = getattr(there, "cvel", None)
        cvel = there._impl.cvel if cvel is None else cvel
        X = js.RigidTransform(js.Rotation.from_matrix(there.xmat), there.xpos)
        V = js.SpatialVelocity.from_array(cvel)
    np.testing.assert_allclose(
        X.to_matrix(), js.RigidTransform(js.Rotation(data.xmat), data.xpos).to_matrix(), atol=1e-6
    )
    np.testing.assert_allclose(V.to_array(), data.cvel, atol=1e-6)


@pytest.mark.slow
def test_a_robot_computes_with_states_of_mjx():
    """From the same file, batched, under jit, with a derivative: the bias forces that MuJoCo has."""
    mjx = needs("mujoco.mjx")
    text = re.sub("<geom.*?/>", "", MODEL).replace(
        "/></body>", '/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    )
    model, mech = mujoco.MjModel.from_xml_string(text), js.Mechanism.from_mjcf(text, dtype=np.float32).as_static()
    states = []
    with jax.enable_x64(False), jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        for seed in range(3):
            data = mujoco.MjData(model)
            data.qvel[:] = np.random.default_rng(seed).normal(size=model.nv)
            mujoco.mj_integratePos(model, data.qpos, data.qvel, 0.3)
            mujoco.mj_forward(model, data)
            states.append((mjx.put_data(model, data), data.qfrc_bias.copy()))

        def bias(data):
            q = interop.mujoco.from_qpos(mech, data.qpos)
            v = interop.mujoco.from_qvel(mech, q, data.qvel)
            vdot = interop.mujoco.from_qacc(mech, q, v, jnp.zeros_like(data.qvel))
            return interop.mujoco.to_qfrc(mech, q, js.inverse_dynamics(mech, q, v, vdot))

        many = jax.tree.map(lambda *x: jnp.stack(x), *(there for there, _ in states))
        found = jax.jit(jax.vmap(bias))(many)
        data = states[0][0]
        power = interpreted(jax.grad(lambda qvel: bias(data.replace(qvel=qvel)) @ qvel))
        assert np.isfinite(power(data.qvel)).all()
    expected = np.stack([theirs for _, theirs in states])
    np.testing.assert_allclose(found, expected, atol=2.0**-18 * abs(expected).max())


def test_inertia_of_bodies(state):
    """From principal axes, about the body's origin, to cinert, about C in world axes; and back."""
    model, data = state
    bodies = slice(1, None)
    arrays = [getattr(model, f"body_{name}")[bodies] for name in ("mass", "inertia", "ipos", "iquat")]
    X = js.RigidTransform(js.Rotation(data.xmat[bodies]), (data.xpos - centres(model, data))[bodies])

    def there_and_back(arrays, X, cinert):
        M_B = interop.mujoco.from_body_inertia(*arrays)
        M_C, back = js.act(X, M_B), interop.mujoco.from_cinert(cinert)
        matrices = interop.mujoco.to_cinert(M_C), M_C.to_matrix(), back.to_matrix()
        return M_B, M_C, back, matrices, interop.mujoco.to_body_inertia(M_B)

    M_B, M_C, back, matrices, of_body = interpreted(there_and_back)(arrays, X, data.cinert[bodies])
    near(matrices[0], data.cinert[bodies], 10)
    near(matrices[2], matrices[1], 10)
    near(back.central, M_C.central, 10)
    mass, inertia, ipos, iquat = of_body
    np.testing.assert_array_equal(mass, arrays[0])
    near(inertia, arrays[1])
    np.testing.assert_array_equal(ipos, arrays[2])
    again = interpreted(interop.mujoco.from_body_inertia)(mass, inertia, ipos, iquat)
    near(again.central, M_B.central)


def test_body_inertia_is_what_the_compiler_makes_of_full_inertia(state):
    model, _ = state
    full = np.array([0.03, 0.025, 0.02, 0.003, -0.002, 0.001])
    pos = np.array([0.02, 0.05, -0.04])
    M = js.SpatialInertia(1.3, pos, interop.orders.symmetric_from_diagonal_first(full))
    np.testing.assert_array_equal(interop.orders.symmetric_to_diagonal_first(M.central), full)
    np.testing.assert_array_equal(pos, M.com)
    b = model.body("b").id
    arrays = [getattr(model, f"body_{name}")[b] for name in ("mass", "inertia", "ipos", "iquat")]
    theirs = interop.mujoco.from_body_inertia(*arrays)
    # MuJoCo stops the iteration for its eigenvectors at 1e-12.
    np.testing.assert_allclose(theirs.central, M.central, rtol=0, atol=1e-13)
    assert theirs.mass == M.mass
    np.testing.assert_allclose(interop.mujoco.to_body_inertia(M)[1], arrays[1], rtol=0, atol=1e-13)


def test_kinetic_energy_and_momentum_of_the_tree(state):
    """M V of every body about C sums to MuJoCo's momentum, and the energies to its energy."""
    model, data = state
    M, V = interop.mujoco.from_cinert(data.cinert), js.SpatialVelocity.from_array(data.cvel)
    mujoco.mj_energyVel(model, data)
    mujoco.mj_subtreeVel(model, data)
    near(M.kinetic_energy(V)[1:].sum(), data.energy[1], 100)
    momentum = (M @ V).to_array()[1:4].sum(0)
    near(momentum[:3], data.subtree_angmom[1], 100)
    near(momentum[3:] / model.body_subtreemass[1], data.subtree_linvel[1], 10)


def test_composite_inertia_is_the_sum(state):
    """crb of the root of the tree: all its bodies as one."""
    _, data = state
    bodies = interop.mujoco.from_cinert(data.cinert[1:4])
    theirs = interop.mujoco.from_cinert(data.crb[1])
    near(bodies.sum().to_matrix(), theirs.to_matrix(), 10)
