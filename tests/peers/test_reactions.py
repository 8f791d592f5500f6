"""Wrenches through joints against Drake and MuJoCo in float64: an arm, a quadruped, a humanoid, with forces at points.

Drake's reaction forces act on the child, about the joint's frame on it, which for URDF is that of the body. MuJoCo's
cfrc_int acts on the body too, about the centre of mass of its tree, in world axes.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import mujoco as states
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but
from tests.helpers.optional import needs
from tests.peers import test_wrenches_mujoco as with_wrenches

needs("pydrake")
needs("pinocchio")
from pydrake.common.value import Value  # noqa: E402
from pydrake.math import RigidTransform  # noqa: E402
from pydrake.multibody.math import SpatialForce  # noqa: E402
from pydrake.multibody.plant import ExternallyAppliedSpatialForce  # noqa: E402

from tests.peers.test_dynamics_drake import Robot  # noqa: E402

ALLOWED = 1e-12
N_POINTS = 5


def forces_at_points(mech, rng, bodies=None):
    bodies = bodies or [name for name in mech.body_names if "/" not in name]
    names = [bodies[i] for i in rng.integers(0, len(bodies), N_POINTS)]
    tau, f, p = rng.standard_normal((3, N_POINTS, 3))
    return js.AppliedForces(names, js.SpatialForce(jnp.asarray(tau), jnp.asarray(10 * f)), jnp.asarray(p))


@pytest.mark.parametrize(("name", "floating"), [("panda", False), ("solo12", True), ("talos_reduced", True)])
def test_as_drakes_reaction_forces(name, floating):
    """Of the output port: tau and forces go in, accelerations and reactions come out. Welds have them, too, and what is
    welded is pushed as well."""
    r = Robot(name, floating)
    mech, rng = r.mech, np.random.default_rng(0)
    welded = [mech.frame_names[frame] for _, frame in mech.topology.welds]
    with jax.enable_x64(True):
        F = forces_at_points(mech, rng, [*mech.body_names, *welded])
        q, v = r.q[0], r.v[0]
        T, T_rate_v = r.set(0)
        tau = np.linalg.solve(T.T, rng.standard_normal(mech.nv))
        plant, context = r.plant, r.context
        plant.get_applied_generalized_force_input_port().FixValue(context, tau)
        applied = []
        for body, wrench, p in zip(F.frames, np.asarray(F.wrenches.to_array()), np.asarray(F.points), strict=True):
            one = ExternallyAppliedSpatialForce()
            one.body_index = plant.GetBodyByName(body).index()
            one.p_BoBq_B, one.F_Bq_W = p, SpatialForce(wrench)
            applied.append(one)
        plant.get_applied_spatial_force_input_port().FixValue(context, Value(applied))
        derivatives = plant.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()
        vdot = np.linalg.solve(T, derivatives - T_rate_v)
        reactions = plant.get_reaction_forces_output_port().Eval(context)
        joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
        # The port has them in the order of joints.
        of_child = {joint.child_body().index(): k for k, joint in enumerate(joints)}
        expected = []
        assert welded
        for body in [*r.bodies, *map(plant.GetBodyByName, welded)]:
            k = of_child[body.index()]
            assert joints[k].frame_on_child().GetFixedPoseInBodyFrame().IsExactlyEqualTo(RigidTransform())
            expected.append(reactions[k].get_coeffs())
        names = [*mech.joint_names, *welded]
        found = interpreted(lambda *x: js.joint_reactions(mech, *x, joints=names).to_array())(q, v, vdot, F)
    expected = np.array(expected)
    assert abs(np.asarray(found) - expected).max() <= ALLOWED * abs(expected).max()


@pytest.mark.parametrize("name", slow_but(["ant"], with_wrenches.ROBOTS))
def test_as_mujocos_cfrc_int(name):
    with jax.enable_x64(True):
        model, mech, q = with_wrenches.robot(name)
        q, rng = q[0], np.random.default_rng(1)
        v, a = (jnp.asarray(x) for x in rng.standard_normal((2, mech.nv)))
        F = forces_at_points(mech, rng)
        data = mujoco.MjData(model)
        state = interpreted(
            lambda *x: (states.to_qpos(mech, x[0]), states.to_qvel(mech, *x), states.to_qacc(mech, *x, a))
        )
        (data.qpos[:], data.qvel[:], qacc) = state(q, v)
        data.xfrc_applied[:] = interpreted(lambda q, F: states.to_xfrc_applied(model, mech, q, F))(q, F)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        data.qacc[:] = qacc
        data.ncon = 0
        mujoco.mj_rnePostConstraint(model, data)
        # Between two joints of one body MuJoCo has none.
        own = {i: with_wrenches.body(model, name) for i, name in enumerate(mech.body_names) if "/" not in name}
        rows, numbers = (np.array(x) for x in (list(own), list(own.values())))

        def about_centres(q, v, a, F):
            # It acts about the origin of the world after `act`.
            in_world = js.act(js.forward_kinematics(mech, q), js.joint_reactions(mech, q, v, a, F)).at_batch(rows)
            return js.shift(in_world, jnp.asarray(data.subtree_com[model.body_rootid[numbers]])).to_array()

        found = interpreted(about_centres)(q, v, a, F)
    expected = data.cfrc_int[numbers]
    assert len(expected) >= 3 and abs(found - expected).max() <= ALLOWED * abs(expected).max()
