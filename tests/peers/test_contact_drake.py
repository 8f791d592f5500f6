"""Contact against Drake, in float64: its discrete steps with SAP and point contact, and its continuous forces."""

import functools

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import contact_oracle as oracle
from tests.helpers import contact_scenes as scenes
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow
from tests.helpers.optional import needs

needs("pydrake")
needs("pinocchio")
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, HalfSpace, Sphere  # noqa: E402
from pydrake.math import RigidTransform  # noqa: E402
from pydrake.multibody.parsing import Parser  # noqa: E402
from pydrake.multibody.tree import JacobianWrtVariable, MultibodyForces  # noqa: E402

from tests.helpers.drake_contact import RIGID, ContactPlant, material  # noqa: E402


class Plant(ContactPlant):
    """A scene in Drake."""

    def __init__(self, name, dt, dissipation=0.0, stiction_speed=1e-3):
        self.scene = scenes.SCENES[name]()
        super().__init__(self.scene.mechanism, dt)
        plant = self.plant
        Parser(plant).AddModelsFromString(self.scene.text, "urdf")
        if not self.scene.is_floating:
            plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(self.scene.mechanism.frame_names[1]))
        mu = self.scene.friction
        ground = material(RIGID, 0.0, mu)
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "ground", ground)
        own = material(self.scene.stiffness, self.scene.relaxation_time, mu, dissipation)
        self.bodies = [plant.GetBodyByName(name) for name in self.scene.frames]
        spheres = [
            plant.RegisterCollisionGeometry(body, RigidTransform(p), Sphere(self.scene.radius), f"sphere {i}", own)
            for i, (body, p) in enumerate(zip(self.bodies, self.scene.positions, strict=True))
        ]
        plant.Finalize()
        if not dt:
            plant.set_stiction_tolerance(stiction_speed)
        filters = self.graph.collision_filter_manager()
        filters.Apply(CollisionFilterDeclaration().ExcludeWithin(GeometrySet(spheres)))
        self.build()

    def problem(self):
        """The oracle's problem at this state, in Drake's coordinates: (Problem, the numbers of the spheres inside)."""
        plant, context, scene, dt = self.plant, self.context, self.scene, self.dt
        v = plant.GetVelocities(context)
        M, damping = plant.CalcMassMatrix(context), np.zeros(plant.num_velocities())
        joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
        simple = [x for x in joints if x.num_velocities() == 1]
        for x in simple:
            damping[x.velocity_start()] = x.GetDampingVector(context)[0]
        A = M + dt * np.diag(damping)
        gravity = plant.CalcGravityGeneralizedForces(context)
        total = self.forces + gravity - plant.CalcBiasTerm(context) - damping * v
        free = v + dt * np.linalg.solve(A, total)
        world = plant.world_frame()
        contacts = []
        for body, p in zip(self.bodies, scene.positions, strict=True):
            center = body.EvalPoseInWorld(context) @ p
            p_BC = body.EvalPoseInWorld(context).inverse() @ (center * [1, 1, 0])
            J = plant.CalcJacobianTranslationalVelocity(
                context, JacobianWrtVariable.kV, body.body_frame(), p_BC, world, world
            )
            numbers = scene.stiffness, scene.relaxation_time, scene.friction
            contacts.append(oracle.Contact(J, center[2] - scene.radius, *numbers))
        limits = []
        for x in simple:
            row = np.eye(len(v))[x.velocity_start()][None]
            q = plant.GetPositions(context)[x.position_start()]
            limits.append(oracle.Limit(row, q - x.position_lower_limits()[0]))
            limits.append(oracle.Limit(-row, x.position_upper_limits()[0] - q))
        inside = [i for i, c in enumerate(contacts) if c.distance <= 0]
        limits = [x for x in limits if np.isfinite(x.gap)]
        return oracle.Problem(A, free, oracle.terms_of(A, free, v, dt, contacts, limits)), inside


@functools.cache
def plant(name, dt, *more):
    return Plant(name, dt, *more)


# (robot, dt, how many states).
FEW = [("box", 5e-3, 24), ("arm", 1e-3, 24), ("solo12", 1e-2, 24)]
MANY = [(name, dt, 200) for name in scenes.SCENES for dt in (1e-3, 5e-3, 1e-2)]
CASES = [*FEW, *map(lambda case: slow(*case), MANY)]


@pytest.mark.parametrize(("name", "dt", "n"), CASES)
def test_the_oracle_is_drake(name, dt, n):
    """By Drake's own matrices and stopping rule: velocities and forces to 1e-10 of the largest."""
    there, touching, limited = plant(name, dt), 0, 0
    for state in scenes.states(there.scene, n):
        there.set(state)
        _, v, forces = there.step()
        problem, inside = there.problem()
        found = problem.solve(there.plant.GetVelocities(there.context))
        assert found.why != "failed"
        np.testing.assert_allclose(found.v, v, rtol=0, atol=1e-10 * max(abs(v).max(), 1))
        # Drake tells of contacts, not of those without a force.
        assert set(forces) <= set(inside)
        for number, impulse in zip(inside, found.impulses, strict=False):
            f = forces.get(number, np.zeros(3))
            np.testing.assert_allclose(impulse / dt, f, rtol=0, atol=1e-9 * max(abs(f).max(), 1))
        touching += len(inside)
        limited += len(problem.terms) > len(inside)
    assert touching > n / 4 and (limited or name != "arm")


@functools.cache
def _convex(name, dt):
    scene = scenes.SCENES[name]()
    mech, contacts = scene.mechanism, scene.contacts
    return interpreted(lambda q, v, tau: js.convex_step(mech, q, v, tau, dt, contacts=contacts))


@pytest.mark.parametrize(("name", "dt", "n"), CASES)
def test_a_step_is_drakes(name, dt, n):
    """To the tolerance of Drake's solver, which stops at 1e-6 of the momenta: velocities to 2e-5 of the largest, and to
    1e-8 in the median, as Newton's method mostly does better than it has to; coordinates and forces likewise.

    Of the change of velocities that contact makes, ours are off Drake's by 2e-6 in nine of ten states, and by 1e-4 at
    most. What is off is Drake's, where it stops: from the optimum of its problem, by its own matrices, ours are 1e-11.
    """
    there = plant(name, dt)
    states = scenes.states(there.scene, n)
    with jax.enable_x64(True):
        found = _convex(name, dt)(*map(np.array, zip(*states, strict=True)))
    found = jax.tree.map(np.asarray, found)
    of_v, of_f, of_change, from_optimum, touching = [], [], [], [], 0
    for i, state in enumerate(states):
        there.set(state)
        q, v, forces = there.step()
        own_v, size = there.rates(found.q[i]) @ found.v[i], max(abs(v).max(), abs(state.v).max())
        of_v.append(abs(own_v - v).max() / size)
        # Drake adds dt times the rate of a quaternion, ours turns by dt w: all else is compared.
        others = slice(4 * there.scene.is_floating, None)
        np.testing.assert_allclose(found.q[i][others], q[there.q_order][others], rtol=0, atol=2e-5 * size * dt + 1e-12)
        expected = np.array([forces.get(k, np.zeros(3)) for k in range(len(there.bodies))])
        of_f.append(abs(found.contact_forces.f[i] - expected).max() / max(abs(expected).max(), 1))
        touching += bool(forces)
        problem, before = there.problem()[0], there.plant.GetVelocities(there.context)
        change = abs(v - problem.free).max()
        # Less is of rounding errors: nothing acts.
        if change > 1e-8 * size:
            of_change.append(abs(own_v - v).max() / change)
            from_optimum.append(abs(own_v - problem.optimum(before).v).max() / change)
    assert max(of_v) < 2e-5 and np.median(of_v) < 1e-8, (max(of_v), np.median(of_v))
    assert max(of_f) < 1e-3 and np.median(of_f) < 1e-6, (max(of_f), np.median(of_f))
    assert np.quantile(of_change, 0.9) < 2e-6 and max(of_change) < 1e-4, max(of_change)
    assert max(from_optimum) < 1e-11, max(from_optimum)
    assert touching > n / 4 and len(of_change) > n / 2


def _generalized_contact_forces(there):
    """Of Drake's continuous plant: what accelerations are more than without contact."""
    results = there.plant.get_contact_results_output_port().Eval(there.context)
    total = np.zeros(there.plant.num_velocities())
    world = there.plant.world_frame()
    for k in range(results.num_point_pair_contacts()):
        info = results.point_pair_contact_info(k)
        for body, sign in ((info.bodyA_index(), -1), (info.bodyB_index(), 1)):
            frame = there.plant.get_body(body).body_frame()
            p = there.plant.CalcPointsPositions(there.context, world, info.contact_point(), frame)
            J = there.plant.CalcJacobianTranslationalVelocity(
                there.context, JacobianWrtVariable.kV, frame, p, world, world
            )
            total += sign * J.T @ info.contact_force()
    return total


@functools.cache
def _explicit(name):
    """Generalized forces of one sphere of a scene, whose force acts half its depth under the ground, as Drake's does:
    a sphere larger by as much, and a ground as much lower."""
    scene = scenes.SCENES[name]()
    mech, given = scene.mechanism, scene.contacts
    numbers = {x: getattr(given, x) for x in ("stiffness", "relaxation_time", "friction")}
    options = {"dissipation": np.float64(DISSIPATION), "stiction_speed": np.float64(STICTION_SPEED)}

    def forces(q, v, lower, i):
        contacts = js.PointContacts(
            scene.frames[i : i + 1], scene.positions[i : i + 1], given.radius + lower, **numbers
        )
        ground = js.HalfSpace(np.array([0.0, 0.0, 1.0]), -lower)
        F = js.contact_forces(mech, q, v, contacts, ground, **options)
        return js.bias_forces(mech, q, v) - js.bias_forces(mech, q, v, F)

    return [interpreted(functools.partial(forces, i=i)) for i in range(len(scene.frames))]


DISSIPATION, STICTION_SPEED = 0.5, 0.05


@pytest.mark.parametrize("name", ["box", "arm", slow("solo12")])
def test_explicit_forces_are_drakes(name):
    """Of its continuous model, as generalized forces, to 1e-10 of the largest."""
    there, most = plant(name, 0.0, DISSIPATION, STICTION_SPEED), 0.0
    scene = there.scene
    for state in scenes.states(scene, 24):
        T = there.set(state)
        expected, found = T.T @ _generalized_contact_forces(there), 0.0
        for body, p, forces in zip(there.bodies, scene.positions, _explicit(name), strict=True):
            depth = scene.radius - (body.EvalPoseInWorld(there.context) @ p)[2]
            if depth > 0:
                with jax.enable_x64(True):
                    found = found + forces(state.q, state.v, np.float64(depth / 2))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * max(abs(expected).max(), 1))
        most = max(most, abs(expected).max())
    assert most > 10


def test_generalized_forces_are_what_drake_moves_by():
    """The generalized contact forces of the test above, in Drake's own accelerations."""
    there = plant("box", 0.0, DISSIPATION, STICTION_SPEED)
    for state in scenes.states(there.scene, 4):
        there.set(state)
        M, vdot = there.plant.CalcMassMatrix(there.context), there.plant.EvalTimeDerivatives(there.context)
        forces = MultibodyForces(there.plant)
        there.plant.CalcForceElementsContribution(there.context, forces)
        free = forces.generalized_forces() + there.plant.CalcGravityGeneralizedForces(there.context)
        total = M @ vdot.CopyToVector()[-there.plant.num_velocities() :] + there.plant.CalcBiasTerm(there.context)
        expected = total - free - there.forces
        np.testing.assert_allclose(_generalized_contact_forces(there), expected, rtol=0, atol=1e-8)
