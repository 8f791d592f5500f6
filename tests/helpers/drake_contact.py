"""Spheres in Drake that touch by its point contact: what scenes on a ground and scenes of pairs have in common."""

import numpy as np

from tests.helpers import contact_oracle as oracle
from tests.helpers.optional import needs

needs("pydrake")
from pydrake.geometry import AddContactMaterial, ProximityProperties  # noqa: E402
from pydrake.multibody.plant import (  # noqa: E402
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
)
from pydrake.systems.framework import DiagramBuilder  # noqa: E402

# The ground is rigid: of two stiffnesses in series that of the sphere is left.
RIGID = 1e40


def material(stiffness, relaxation_time, friction, dissipation=0.0):
    found = ProximityProperties()
    AddContactMaterial(dissipation, stiffness, CoulombFriction(friction, friction), found)
    found.AddProperty("material", "relaxation_time", relaxation_time)
    return found


class ContactPlant:
    """A plant, and how its numbers are ordered beside those of our mechanism. dt = 0: Drake's continuous model.

    Geometries "sphere 3" are spheres with the numbers of contacts in our steps.
    """

    def __init__(self, mechanism, dt):
        self.mechanism, self.dt, self.builder = mechanism, dt, DiagramBuilder()
        self.plant, self.graph = AddMultibodyPlantSceneGraph(self.builder, time_step=dt)
        self.plant.set_contact_model(ContactModel.kPoint)
        if dt:
            self.plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
            self.plant.SetUseSampledOutputPorts(False)

    def build(self):
        """After the plant is finalized, and its filters are set."""
        self.inspector = self.graph.model_inspector()
        self.diagram = self.builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.plant.GetMyContextFromRoot(self.root)
        joints = [self.plant.get_joint(i) for i in self.plant.GetJointIndices()]
        by_body = {joint.child_body().name(): joint for joint in joints}
        own = [by_body[name] for name in self.mechanism.body_names]
        self.q_order = np.concatenate([x.position_start() + np.arange(x.num_positions()) for x in own])
        self.v_order = np.concatenate([x.velocity_start() + np.arange(x.num_velocities()) for x in own])

    def rates(self, q):
        """T: Drake's rates are T times ours; of a floating body they are in world axes."""
        n = self.mechanism.nv
        order = np.zeros((n, n))
        order[self.v_order, np.arange(n)] = 1
        return order @ oracle.in_world(self.mechanism, q)

    def set(self, state):
        """`rates` at this state."""
        q = np.empty(len(state.q))
        q[self.q_order] = state.q
        self.plant.SetPositions(self.context, q)
        T = self.rates(state.q)
        self.plant.SetVelocities(self.context, T @ state.v)
        # Generalized forces are dual to rates.
        self.forces = np.linalg.solve(T.T, state.tau)
        self.plant.get_applied_generalized_force_input_port().FixValue(self.context, self.forces)
        return T

    def step(self, moves=False):
        """(next q, next rates, as Drake has them; the force on each sphere that touches, by its number)."""
        plant = self.plant
        after = np.array(plant.EvalUniquePeriodicDiscreteUpdate(self.context).value())
        results = plant.get_contact_results_output_port().Eval(self.context)
        forces = {}
        for k in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(k)
            pair = info.point_pair()
            names = [self.inspector.GetName(i).rpartition("::")[2] for i in (pair.id_A, pair.id_B)]
            (number,) = (int(name.removeprefix("sphere ")) for name in names if name.startswith("sphere "))
            # Drake's is on body B.
            forces[number] = info.contact_force() * (1 if names[1].startswith("sphere ") else -1)
        if moves:
            plant.SetPositionsAndVelocities(self.context, after)
        n = plant.num_positions()
        return after[:n], after[n:], forces
