"""Spheres on a body against a shape on another, against Drake's discrete steps with SAP and point contact."""

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import contact_pairs as scenes
from tests.helpers.contact_pairs import BOXES, HANDS, HELD, Numbers
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow
from tests.helpers.optional import needs

needs("pydrake")
from pydrake.geometry import (  # noqa: E402
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Cylinder,
    GeometrySet,
    HalfSpace,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix  # noqa: E402
from pydrake.multibody.tree import (  # noqa: E402
    FixedOffsetFrame,
    PrismaticJoint,
    QuaternionFloatingJoint,
    RevoluteJoint,
    RotationalInertia,
    SpatialInertia,
)

from tests.helpers.drake_contact import RIGID, ContactPlant, material  # noqa: E402


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def _pose(X):
    if X is None:
        return RigidTransform()
    return RigidTransform(RotationMatrix(np.asarray(X.rotation.to_matrix())), np.asarray(X.translation))


def _shape_of(shape):
    """(Drake's shape, where it is)."""
    if isinstance(shape, js.HalfSpace):
        n = shape.normal / np.linalg.norm(shape.normal)
        return HalfSpace(), HalfSpace.MakePose(n, float(shape.offset) * n)
    made = {
        js.Box: lambda: Box(*shape.size),
        js.Sphere: lambda: Sphere(shape.radius),
        js.Capsule: lambda: Capsule(shape.radius, shape.length),
        js.Cylinder: lambda: Cylinder(shape.radius, shape.length),
    }
    return made[type(shape)](), _pose(shape.placement)


class Plant(ContactPlant):
    """A PairScene in Drake."""

    def __init__(self, scene, dt):
        self.scene = scene
        super().__init__(scene.mechanism, dt)
        plant = self.plant
        plant.mutable_gravity_field().set_gravity_vector(np.asarray(scene.gravity))
        bodies = {name: self._body(name, M) for name, M in scene.bodies.items()}
        for x in scene.joints:
            self._joint(x, bodies)
        allowed = self._geometries(bodies)
        plant.Finalize()
        filters = self.graph.collision_filter_manager()
        everything = GeometrySet([x for pair in allowed for own in pair for x in own])
        filters.Apply(CollisionFilterDeclaration().ExcludeWithin(everything))
        for one, other in allowed:
            filters.Apply(CollisionFilterDeclaration().AllowBetween(GeometrySet(one), GeometrySet(other)))
        self.build()

    def _body(self, name, M):
        I = np.asarray(M.central_matrix())  # noqa: E741
        rotational = RotationalInertia(*np.diag(I), I[0, 1], I[0, 2], I[1, 2])
        return self.plant.AddRigidBody(
            name, SpatialInertia.MakeFromCentralInertia(float(M.mass), np.asarray(M.com), rotational)
        )

    def _joint(self, x, bodies):
        plant = self.plant
        parent = plant.world_frame() if x.parent == "world" else bodies[x.parent].body_frame()
        child = bodies[x.child].body_frame()
        if x.kind == "free":
            return plant.AddJoint(QuaternionFloatingJoint(x.name, parent, child))
        frame = plant.AddFrame(FixedOffsetFrame(f"{x.name} frame", parent, _pose(x.placement)))
        kind = {"prismatic": PrismaticJoint, "revolute": RevoluteJoint}[x.kind]
        return plant.AddJoint(
            kind(name=x.name, frame_on_parent=frame, frame_on_child=child, axis=x.axis, damping=float(x.damping or 0))
        )

    def _geometries(self, bodies):
        """Pairs of lists of geometries that may touch. Spheres have the numbers of contacts in a step for names."""
        plant, (shapes, spheres), contacts = self.plant, self.scene.pairs, self.scene.contacts
        # Friction of a pair is a mean: beside the ground it is that of the sphere.
        ground = material(RIGID, 0.0, float(contacts.friction))
        below = plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "ground", ground)
        allowed = [([below], self._spheres(bodies, contacts, 0))]
        own = self._spheres(bodies, spheres, len(contacts.frames))
        law = material(*(float(x) for x in (shapes.stiffness, shapes.relaxation_time, shapes.friction)))
        # Of a batch of shapes each frame has its own; else a frame has one for all that touch it.
        found = {}
        for i, name in enumerate(shapes.frames):
            shape = jax.tree.map(lambda x, i=i: x[i], shapes.shape) if shapes.shape.batch_shape else shapes.shape
            if name not in found:
                drawn, X = _shape_of(shape)
                found[name] = plant.RegisterCollisionGeometry(bodies[name], X, drawn, f"shape of {name}", law)
            allowed.append(([found[name]], [own[i]]))
        return allowed

    def _spheres(self, bodies, contacts, first):
        law = material(*(float(x) for x in (contacts.stiffness, contacts.relaxation_time, contacts.friction)))
        return [
            self.plant.RegisterCollisionGeometry(
                bodies[name], RigidTransform(p), Sphere(float(contacts.radius)), f"sphere {first + i}", law
            )
            for i, (name, p) in enumerate(zip(contacts.frames, contacts.positions, strict=True))
        ]

    def step(self, moves=False):
        """With zeros for spheres that do not touch."""
        q, v, found = super().step(moves)
        forces = np.zeros((len(self.scene.contacts.frames) + len(self.scene.pairs[1].frames), 3))
        for number, force in found.items():
            forces[number] = force
        return q, v, forces


KINDS = {
    "box": (scenes.two_bodies, Numbers.of(), "box"),
    "sphere": (scenes.two_bodies, Numbers.of(), "sphere"),
    "capsule": (scenes.two_bodies, Numbers.of(), "capsule"),
    "cylinder": (scenes.two_bodies, Numbers.of(), "cylinder"),
    "half space": (scenes.two_bodies, Numbers.of(), "half space"),
    "heavy on light": (scenes.two_bodies, Numbers.of(masses=(1e-2, 1e2), stiffness=(1e5, 1e6)), "box"),
    "light on heavy": (scenes.two_bodies, Numbers.of(masses=(1e3, 1e-3), friction=(1.5, 0.2)), "box"),
    "hand and cylinder": (scenes.hand, HELD, "cylinder"),
    "hand and box": (scenes.hand, HELD, "box"),
    "arm": (scenes.arm, Numbers.of(), "box"),
}


@pytest.mark.parametrize(("name", "n"), [("box", 24), *(slow(name, 200) for name in KINDS)])
def test_a_step_is_drakes(name, n):
    """To the tolerance of Drake's solver, which stops at 1e-6 of the momenta: velocities in the norm of the mass
    matrix, where masses are far apart, too. Surfaces are not as stiff, so the point of contact counts."""
    make, numbers, shape = KINDS[name]
    scene, dt = make(numbers, shape), 5e-3
    there, states = Plant(scene, dt), scenes.states(make, numbers, n, shape, seed=20)
    found = interpreted(lambda q, v, tau: scene.stepper()(q, v, tau, dt))(*states)
    of_v, of_f, pushing = [], [], 0
    for i in range(n):
        state = scenes.State(*(x[i] for x in states))
        there.set(state)
        _, v, forces = there.step()
        own, M = there.rates(found.q[i]) @ found.v[i], there.plant.CalcMassMatrix(there.context)
        before = there.plant.GetVelocities(there.context)
        energy = max(x @ M @ x for x in (v, before))
        of_v.append(np.sqrt((own - v) @ M @ (own - v) / energy))
        of_f.append(abs(found.contact_forces.f[i] - forces).max() / max(abs(forces).max(), 1))
        pushing += forces[len(scene.contacts.frames) :].any()
    assert max(of_v) < 5e-6 and np.median(of_v) < 1e-8, (max(of_v), np.median(of_v))
    assert max(of_f) < 1e-3 and np.median(of_f) < 1e-6, (max(of_f), np.median(of_f))
    assert pushing > n / 2


def _rolled_out(make, case, shape, steps):
    """Drake's coordinates, and forces, after each step of a Case."""
    there = Plant(make(case.numbers, shape), float(case.dt))
    there.set(case.state)
    found = [there.step(moves=True)[::2] for _ in range(steps)]
    return np.array([q[there.q_order] for q, _ in found]), np.array([f for _, f in found])


# How far the coordinates are off Drake's in the end, m and of quaternions: where boxes hop, errors grow.
@pytest.mark.slow
@pytest.mark.parametrize("name", BOXES)
def test_boxes_rest_slide_and_tip_as_drakes(name):
    case, steps = BOXES[name], 300
    q, f = _rolled_out(scenes.two_bodies, case, "box", steps)
    own = scenes.rolled_out(scenes.two_bodies, [case], steps)
    np.testing.assert_allclose(own.q[0], q, rtol=0, atol=1e-3 if name in ("tips", "falls") else 1e-5)
    if name in ("rests", "heavy on light", "light on heavy", "stands", "sticks"):
        np.testing.assert_allclose(own.contact_forces.f[0, -1], f[-1], rtol=0, atol=1e-4 * abs(f[-1]).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", HANDS)
def test_hands_hold_as_drakes(name):
    case, steps = HANDS[name], 200
    q, f = _rolled_out(scenes.hand, case, "cylinder", steps)
    own = scenes.rolled_out(scenes.hand, [case], steps, "cylinder")
    np.testing.assert_allclose(own.q[0], q, rtol=0, atol=1e-5)
    if "slips" not in name and "fast" not in name:
        np.testing.assert_allclose(own.contact_forces.f[0, -1], f[-1], rtol=0, atol=1e-4 * abs(f[-1]).max())
