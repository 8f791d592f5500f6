"""Robots of example-robot-data against Drake in float64, with a fixed and a floating base: relative error 1e-12.

Relative to the largest number of each result. What differs, and is converted here:

    a floating base   Drake's rates are the base's velocity in world axes, ours in those of the base: see `to_drake`
    bias              Drake's has no gravity, which is a force of its own, with the other sign
    damping           Drake's joints have it in forward dynamics; ours carry it, for a caller to apply
    mimics            Drake has constraints in their place: the models here have none
    welded to world   Drake's centre of mass and potential energy count such links: see `_at_rest`

Ours is evaluated op by op in NumPy, which gives the bits of the compiled program.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lxml import etree

import jaxspatial as js
from tests.helpers.optional import needs

needs("pydrake")
needs("pinocchio")
from pydrake.multibody.math import SpatialForce  # noqa: E402
from pydrake.multibody.parsing import Parser  # noqa: E402
from pydrake.multibody.plant import MultibodyPlant  # noqa: E402
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable, MultibodyForces  # noqa: E402

from tests.helpers import pinocchio_models as models  # noqa: E402
from tests.helpers.interpreted import interpreted  # noqa: E402

N = 4
ALLOWED = 1e-12
GRAVITY = 9.81
# What is for pictures, contact and motors, and what Drake has constraints for.
STRIPPED = "visual", "collision", "transmission", "gazebo", "safety_controller", "mimic"


def text(name):
    root = etree.parse(models.ROBOTS[name]).getroot()
    for element in [e for tag in STRIPPED for e in root.iter(tag)]:
        element.getparent().remove(element)
    return etree.tostring(root, encoding="unicode")


class Robot:
    """Drake's plant and our mechanism, and N states of ours."""

    def __init__(self, name, floating_base):
        source = text(name)
        self.mech = models.read(source, floating_base)
        with jax.enable_x64(True):
            self.q = np.array(js.random_configuration(self.mech, jax.random.key(3), N))
        rng = np.random.default_rng(4)
        (self.v, self.a), self.pushes = rng.standard_normal((2, N, self.mech.nv)), rng.standard_normal((N, 6))
        self.plant = MultibodyPlant(0.0)
        Parser(self.plant).AddModelsFromString(source, "urdf")
        if not floating_base:
            self.plant.WeldFrames(self.plant.world_frame(), self.plant.GetFrameByName(_root(self.mech)))
        self.plant.Finalize()
        self.context = self.plant.CreateDefaultContext()
        self.bodies = [self.plant.GetBodyByName(name) for name in self.mech.body_names]
        joints = [_joint_of(self.plant, body) for body in self.bodies]
        self.q_order = _order((j.position_start(), j.num_positions()) for j in joints)
        self.v_order = _order((j.velocity_start(), j.num_velocities()) for j in joints)
        self.is_floating = floating_base

    def set(self, i):
        """Takes on state i: (T, T' v) with T v Drake's rates of ours, those of a floating base in world axes."""
        n, q = self.mech.nv, np.empty(self.mech.nq)
        q[self.q_order] = self.q[i]
        self.plant.SetPositions(self.context, q)
        T, T_rate_v = np.zeros((n, n)), np.zeros(n)
        T[self.v_order, np.arange(n)] = 1
        if self.is_floating:
            R_WB, w, v = self.bodies[0].EvalPoseInWorld(self.context).rotation().matrix(), *self.v[i, :6].reshape(2, 3)
            T[np.ix_(self.v_order[:6], np.arange(6))] = np.kron(np.eye(2), R_WB)
            T_rate_v[self.v_order[3:6]] = R_WB @ np.cross(w, v)
        self.plant.SetVelocities(self.context, T @ self.v[i])
        return T, T_rate_v


def _root(mech):
    return mech.frame_names[1]


def _joint_of(plant, body):
    """That carries it."""
    joints = map(plant.get_joint, plant.GetJointIndices())
    return next(joint for joint in joints if joint.child_body().index() == body.index())


def _order(pieces):
    return np.concatenate([start + np.arange(n) for start, n in pieces])


# -- both -------------------------------------------------------------------------------------------------------------


def _ours(mech, q, v, a, push):
    X, V = js.forward_kinematics(mech, q), js.body_velocities(mech, q, v)
    forces = {mech.body_names[-1]: js.SpatialForce.from_array(push)}
    return {
        "inverse dynamics": js.inverse_dynamics(mech, q, v, a),
        "inverse dynamics, pushed": js.inverse_dynamics(mech, q, v, a, forces),
        "forward dynamics": js.forward_dynamics(mech, q, v, a - jnp.asarray(mech.damping) * v),
        "bias forces": js.bias_forces(mech, q, v),
        "gravity forces": js.gravity_forces(mech, q),
        "mass matrix": js.mass_matrix(mech, q),
        "positions": X.translation,
        "rotations": X.rotation.to_matrix(),
        "velocities": jnp.concatenate([V.w, V.v], -1),
        "jacobian": js.jacobian(mech, q, mech.body_names[-1]),
        "centre of mass": js.center_of_mass(mech, q),
        "kinetic energy": js.kinetic_energy(mech, q, v),
        "potential energy": js.potential_energy(mech, q),
    }


def ours(r):
    with jax.enable_x64(True):
        return interpreted(jax.vmap(functools.partial(_ours, r.mech)))(r.q, r.v, r.a, r.pushes)


def _pushed(r, push):
    """Drake's forces of a wrench about the last body's origin, in world axes."""
    forces = MultibodyForces(r.plant)
    r.bodies[-1].AddInForceInWorld(r.context, SpatialForce(push), forces)
    return forces


def _accelerated(r, tau):
    """The derivatives of Drake's rates under forces at the joints."""
    r.plant.get_applied_generalized_force_input_port().FixValue(r.context, tau)
    return r.plant.EvalTimeDerivatives(r.context).get_generalized_velocity().CopyToVector()


def _jacobian(r):
    frame, world = r.bodies[-1].body_frame(), r.plant.world_frame()
    return r.plant.CalcJacobianSpatialVelocity(r.context, JacobianWrtVariable.kV, frame, np.zeros(3), world, world)


def _at_rest(r):
    """(mass, mass times centre of mass) of the links welded to the world."""
    bodies = [body for body in r.plant.GetBodiesWeldedTo(r.plant.world_body()) if body.index() != BodyIndex(0)]
    masses = [body.get_mass(r.context) for body in bodies]
    centres = [body.EvalPoseInWorld(r.context) @ body.CalcCenterOfMassInBodyFrame(r.context) for body in bodies]
    return sum(masses), sum((m * c for m, c in zip(masses, centres, strict=True)), np.zeros(3))


def _of_state(r, i):
    plant, context = r.plant, r.context
    T, T_rate_v = r.set(i)
    gravity, vdot, none = plant.CalcGravityGeneralizedForces(context), T @ r.a[i] + T_rate_v, MultibodyForces(plant)
    poses = [body.EvalPoseInWorld(context) for body in r.bodies]
    velocities = [body.EvalSpatialVelocityInWorld(context) for body in r.bodies]
    mass, (rest, moment) = plant.CalcTotalMass(context), _at_rest(r)
    return {
        "inverse dynamics": T.T @ (plant.CalcInverseDynamics(context, vdot, none) - gravity),
        "inverse dynamics, pushed": T.T @ (plant.CalcInverseDynamics(context, vdot, _pushed(r, r.pushes[i])) - gravity),
        "forward dynamics": np.linalg.solve(T, _accelerated(r, np.linalg.solve(T.T, r.a[i])) - T_rate_v),
        "bias forces": T.T @ (plant.CalcInverseDynamics(context, T_rate_v, none) - gravity),
        "gravity forces": -T.T @ gravity,
        "mass matrix": T.T @ plant.CalcMassMatrix(context) @ T,
        "positions": [X.translation() for X in poses],
        "rotations": [X.rotation().matrix() for X in poses],
        "velocities": [V.get_coeffs() for V in velocities],
        "jacobian": _jacobian(r) @ T,
        "centre of mass": (mass * plant.CalcCenterOfMassPositionInWorld(context) - moment) / (mass - rest),
        "kinetic energy": plant.CalcKineticEnergy(context),
        "potential energy": plant.CalcPotentialEnergy(context) - GRAVITY * moment[2],
    }


def drakes(r):
    found = [_of_state(r, i) for i in range(N)]
    return {what: np.stack([np.asarray(state[what]) for state in found]) for what in found[0]}


@pytest.mark.parametrize(
    ("name", "floating_base"),
    [
        pytest.param("double_pendulum", True, id="double_pendulum-floating"),
        pytest.param("panda", False, id="panda-fixed", marks=pytest.mark.slow),
        pytest.param("solo12", True, id="solo12-floating", marks=pytest.mark.slow),
    ],
)
def test_all_algorithms(name, floating_base):
    r = Robot(name, floating_base)
    found, expected = ours(r), drakes(r)
    assert {what: x.shape for what, x in found.items()} == {what: x.shape for what, x in expected.items()}
    errors = {what: float(abs(np.asarray(found[what]) - x).max() / abs(x).max()) for what, x in expected.items()}
    assert not {what: error for what, error in errors.items() if not error <= ALLOWED}, errors


@pytest.mark.parametrize("axis", ["1 0 0", "0 1 0", "0 0 1", "-1 0 0", "0 0 -1", "1 2 3", "-1 2 -3"])
def test_planar_joints_move_across_any_axis(axis):
    """Their coordinates are Drake's."""
    inertia = '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="b"><inertial><mass value="1"/>{inertia}</inertial></link>'
    origin = '<origin xyz=".1 .2 .3" rpy=".4 .5 .6"/>'
    joint = f'<parent link="world"/><child link="b"/>{origin}<axis xyz="{axis}"/>'
    source = f'<robot name="r">{link}<joint name="j" type="planar">{joint}</joint></robot>'
    plant, mech = MultibodyPlant(0.0), models.read(source, False)
    Parser(plant).AddModelsFromString(source, "urdf")
    plant.Finalize()
    context, q = plant.CreateDefaultContext(), np.array([0.5, -0.7, 0.9])
    plant.SetPositions(context, q)
    expected = plant.GetBodyByName("b").EvalPoseInWorld(context)
    with jax.enable_x64(True):
        X = interpreted(lambda q: js.forward_kinematics(mech, q, "b"))(q)
    np.testing.assert_allclose(X.translation, expected.translation(), rtol=0, atol=1e-15)
    np.testing.assert_allclose(X.rotation.entries.reshape(3, 3), expected.rotation().matrix(), rtol=0, atol=2e-15)
