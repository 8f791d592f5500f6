"""Wrenches through joints against Drake and MuJoCo in float64: an arm, a quadruped, a humanoid, with forces at points,
and linkages that are closed.

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
from pydrake.multibody.parsing import Parser  # noqa: E402
from pydrake.multibody.plant import (  # noqa: E402
    DiscreteContactApproximation,
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
)

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


# -- closed loops -----------------------------------------------------------------------------------------------------
#
# A crank, a rod on it, and a rocker that holds the other end of the rod, by a ball. All hinges of the four-bar have one
# axis; those of the spatial linkage point anywhere, and the rod hangs on the crank by two of them.

LINK = """<link name="{}"><inertial><origin xyz="{}"/><mass value="{}"/>
  <inertia ixx="{}" iyy="{}" izz="{}" ixy="0.001" ixz="-0.002" iyz="0.003"/></inertial></link>"""
JOINT = """<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/><origin xyz="{}" rpy="{}"/>
  <axis xyz="{}"/></joint>"""
LINKS = {
    "base": ("0 0 0", 1, 0.1, 0.1, 0.1),
    "crank": ("0.1 0.02 0.03", 1.5, 0.02, 0.03, 0.04),
    "cross": ("0.01 0 0.02", 0.2, 0.010, 0.012, 0.011),
    "rod": ("0.4 0.05 -0.02", 2, 0.05, 0.06, 0.04),
    "rocker": ("0.1 0.2 0.05", 1.2, 0.03, 0.03, 0.05),
}
# (joints, the end of the rod on it, the pin on the rocker).
LINKAGES = {
    "four-bar": (
        [
            ("a", "base", "crank", "0 0 0", "0 0 0", "0 1 0"),
            ("c", "crank", "rod", "0.3 0 0", "0 0.2 0", "0 1 0"),
            ("d", "base", "rocker", "0.8 0 0.3", "0 0.4 0", "0 1 0"),
        ],
        np.array([0.7, 0, 0]),
        np.array([0.05, 0, 0.35]),
    ),
    "spatial": (
        [
            ("a", "base", "crank", "0 0 0", "0 0 0", "0 1 0.2"),
            ("b", "crank", "cross", "0.3 0.1 0.05", "0.2 0 0.1", "0 0 1"),
            ("c", "cross", "rod", "0 0 0", "0 0 0", "0 1 0"),
            ("d", "base", "rocker", "1 0.2 0.1", "0.1 0.2 0", "0.3 0 1"),
        ],
        np.array([0.8, 0.1, 0.0]),
        np.array([0.1, 0.4, 0.1]),
    ),
}


class Linkage:
    """A linkage of ours, closed and moving, and Drake's. dt: of its steps, in which a constraint closes it; 0 for its
    continuous model of the open tree."""

    def __init__(self, name, dt):
        joints, self.p_rod, self.p_pin = LINKAGES[name]
        names = {x for _, *pair, _, _, _ in joints for x in pair}
        links = "".join(LINK.format(link, *LINKS[link]) for link in LINKS if link in names)
        source = f'<robot name="linkage">{links}{"".join(JOINT.format(*x) for x in joints)}</robot>'
        at = [js.RigidTransform(js.Rotation.identity(), p) for p in (self.p_rod, self.p_pin)]
        mech = js.Mechanism.from_urdf(source, dtype=np.float64)
        self.mech = mech = js.add_frames(mech, [js.Frame("end", "rod", at[0]), js.Frame("pin", "rocker", at[1])])
        self.loops, rng = [js.LoopClosure("pin", "end", "ball")], np.random.default_rng(1)
        start = 0.2 * rng.standard_normal(mech.nq)
        self.q, residual = interpreted(lambda q: js.close_loops(mech, q, self.loops))(start)
        assert residual < 1e-14
        self.J = interpreted(lambda q: js.constraint_jacobian(mech, q, self.loops))(self.q)
        v, self.tau = rng.standard_normal(mech.nv), 5 * rng.standard_normal(mech.nv)
        self.v = v - np.linalg.pinv(self.J) @ (self.J @ v)
        assert abs(self.v).min() > 0.01
        self.plant = plant = MultibodyPlant(dt)
        Parser(plant).AddModelsFromString(source, "urdf")
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        self.rod, self.rocker = (plant.GetBodyByName(x) for x in ("rod", "rocker"))
        if dt:
            plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
            plant.SetUseSampledOutputPorts(False)
            plant.AddBallConstraint(self.rocker, self.p_pin, self.rod, self.p_rod)
        plant.Finalize()
        self.context, self.joints = plant.CreateDefaultContext(), [plant.GetJointByName(x) for x in mech.joint_names]
        self.order = [x.velocity_start() for x in self.joints]
        set_ports = (
            lambda x: plant.SetPositions(self.context, x),
            lambda x: plant.SetVelocities(self.context, x),
            lambda x: plant.get_applied_generalized_force_input_port().FixValue(self.context, x),
        )
        for values, put in zip((self.q, self.v, self.tau), set_ports, strict=True):
            x = np.empty(mech.nv)
            x[self.order] = values
            put(x)

    def reactions(self):
        """Drake's, in the order of our joints."""
        found = self.plant.get_reaction_forces_output_port().Eval(self.context)
        every = [self.plant.get_joint(i).name() for i in self.plant.GetJointIndices()]
        assert all(x.frame_on_child().GetFixedPoseInBodyFrame().IsExactlyEqualTo(RigidTransform()) for x in self.joints)
        return np.array([found[every.index(x.name())].get_coeffs() for x in self.joints])

    def own(self, vdot, f):
        """Ours, with the force f of the closure on the rod."""
        wrenches = js.SpatialForce(np.zeros((1, 3)), f[None])
        given = {"loops": self.loops, "loop_wrenches": wrenches}
        return interpreted(lambda *x: js.joint_reactions(self.mech, *x, **given).to_array())(self.q, self.v, vdot)


@pytest.mark.parametrize("name", slow_but(["spatial"], LINKAGES))
def test_reactions_in_a_linkage_that_drakes_constraint_closes(name):
    """In a discrete step of Drake. The force of its constraint, which no port tells, is what its accelerations lack."""
    dt = 1e-3
    with jax.enable_x64(True):
        x = Linkage(name, dt)
        after = x.plant.AllocateDiscreteVariables()
        x.plant.CalcForcedDiscreteVariableUpdate(x.context, after)
        vdot = (after.get_vector().CopyToVector()[x.plant.num_positions() :][x.order] - x.v) / dt
        lacking = interpreted(lambda *y: js.inverse_dynamics(x.mech, *y))(x.q, x.v, vdot) - x.tau
        # Along the axes of the pin; one that is not determined, across the plane of a four-bar, has none.
        multipliers, *_ = np.linalg.lstsq(x.J.T, lacking, rcond=1e-10)
        np.testing.assert_allclose(x.J.T @ multipliers, lacking, atol=1e-9 * abs(lacking).max())
        R = interpreted(lambda q: js.forward_kinematics(x.mech, q, "pin").rotation.to_matrix())(x.q)
        found, expected = x.own(vdot, R @ multipliers), x.reactions()
        without = x.own(vdot, np.zeros(3))
    assert abs(without - expected).max() > 0.1 * abs(expected).max()
    assert abs(found - expected).max() <= 1e-9 * abs(expected).max()


@pytest.mark.parametrize("name", slow_but(["spatial"], LINKAGES))
def test_the_wrench_of_a_closure_closes_drakes_open_linkage(name):
    """Of `constrained_forward_dynamics`: on the rod, and its opposite on the rocker, it makes Drake's tree accelerate
    as a closed loop, by Drake's kinematics; reactions agree at every joint."""
    with jax.enable_x64(True):
        x = Linkage(name, 0.0)
        vdot, wrenches = interpreted(lambda *y: js.constrained_forward_dynamics(x.mech, *y, x.loops))(x.q, x.v, x.tau)
        (f,), applied = np.asarray(wrenches.f), []
        for body, p, push in ((x.rod, x.p_rod, f), (x.rocker, x.p_pin, -f)):
            one = ExternallyAppliedSpatialForce()
            one.body_index, one.p_BoBq_B, one.F_Bq_W = body.index(), p, SpatialForce(np.zeros(3), push)
            applied.append(one)
        plant, context = x.plant, x.context
        plant.get_applied_spatial_force_input_port().FixValue(context, Value(applied))
        theirs = plant.EvalTimeDerivatives(context).get_generalized_velocity().CopyToVector()[x.order]
        ends = [
            body.EvalSpatialAccelerationInWorld(context).Shift(
                body.EvalPoseInWorld(context).rotation() @ p, body.EvalSpatialVelocityInWorld(context).rotational()
            )
            for body, p in ((x.rod, x.p_rod), (x.rocker, x.p_pin))
        ]
        rod, pin = (end.translational() for end in ends)
        found, expected = x.own(vdot, f), x.reactions()
    np.testing.assert_allclose(vdot, theirs, rtol=0, atol=1e-10 * abs(theirs).max())
    np.testing.assert_allclose(rod, pin, rtol=0, atol=1e-10 * abs(rod).max())
    assert abs(found - expected).max() <= 1e-10 * abs(expected).max()
