"""Bodies that touch one another: boxes and shapes on boxes, a hand, an arm that touches itself; random states of them,
and cases that one works out by hand."""

import functools
import itertools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxspatial as js
from tests.helpers.interpreted import interpreted

G = 9.81
# The radius of the spheres in the corners of boxes.
ROUND = 0.01


class PairScene(NamedTuple):
    """What a mechanism is built of, gravity, spheres on the ground z = 0, and pairs."""

    bodies: dict[str, js.SpatialInertia]
    joints: list[js.Joint]
    gravity: Any
    contacts: js.PointContacts
    pairs: tuple[js.ShapeContacts, js.PointContacts]

    @property
    def mechanism(self):
        """Inertias and gravity may be traced."""
        bodies = [
            js.Body(name, js.SpatialInertia.solid_sphere(np.float64(1), mass=np.float64(1))) for name in self.bodies
        ]
        mech = js.Mechanism.build(bodies, self.joints, dtype=np.float64)
        inertias = [self.bodies[name] for name in mech.body_names]
        is_known = all(isinstance(x, np.ndarray) for x in jax.tree.leaves(inertias))
        stacked = jax.tree.map(lambda *x: (np if is_known else jnp).stack(x), *inertias)
        return mech.replace(inertias=stacked, gravity=self.gravity)

    def stepper(self):
        """A function of (q, v, tau, dt)."""
        return functools.partial(js.convex_step, self.mechanism, contacts=self.contacts, pairs=self.pairs)


class Numbers(NamedTuple):
    """Of a scene of two bodies, or of a hand and what it holds; each may be traced, and batched.

    masses: of both, or of a finger and what it holds. friction, stiffness, relaxation_time: of their surfaces. size: of
    the upper box, or of what is held.
    """

    masses: Any = (4.0, 2.0)
    friction: Any = (0.4, 0.6)
    stiffness: Any = (2e4, 5e4)
    relaxation_time: Any = (0.01, 0.02)
    size: Any = (0.3, 0.2, 0.2)
    gravity: Any = (0.0, 0.0, -G)

    @classmethod
    def of(cls, **numbers):
        return cls(*(np.asarray(x, float) for x in cls(**numbers)))

    def law(self, i):
        return {k: getattr(self, k)[i] for k in ("friction", "stiffness", "relaxation_time")}


def corners(size, faces=(-1, 1)):
    """Centres of the spheres in the corners of a box, which touch its faces from inside: of its lower and upper end."""
    signs = np.array(list(itertools.product((-1.0, 1.0), (-1.0, 1.0), faces)))
    return signs * (size / 2 - ROUND)[None]


def _placed(w, p):
    with jax.enable_x64(True):
        entries = np.asarray(js.Rotation.exp(np.array(w, float)).entries)
    return js.RigidTransform(js.Rotation(entries), np.array(p, float))


def _free(name):
    return js.Joint(f"to {name}", "free", "world", name)


LOWER = np.array([0.6, 0.5, 0.2])
SHAPES = {
    "box": js.Box(LOWER),
    "sphere": js.Sphere(np.float64(0.25), _placed([0, 0, 0], [0.05, 0, 0])),
    "capsule": js.Capsule(np.float64(0.15), np.float64(0.4), _placed([0.3, 1.2, 0], [0, 0.05, 0])),
    "cylinder": js.Cylinder(np.float64(0.2), np.float64(0.3), _placed([0.2, 0.1, 0], [0, 0, 0.02])),
    "half space": js.HalfSpace(np.array([0.1, -0.2, 1.0]), np.float64(0.1)),
}


def two_bodies(numbers, shape="box"):
    """One stands on four spheres and carries a shape; a box with spheres in its lower corners is on it."""
    radius = np.float64(ROUND)
    bodies = {
        name: js.SpatialInertia.solid_box(size, mass=m)
        for name, size, m in zip(("lower", "upper"), (LOWER, numbers.size), numbers.masses, strict=True)
    }
    contacts = js.PointContacts(["lower"] * 4, corners(LOWER, (-1,)), radius, **numbers.law(0))
    pairs = (
        js.ShapeContacts(["lower"] * 4, SHAPES[shape], **numbers.law(0)),
        js.PointContacts(["upper"] * 4, corners(numbers.size, (-1,)), radius, **numbers.law(1)),
    )
    return PairScene(bodies, [_free("lower"), _free("upper")], numbers.gravity, contacts, pairs)


def hand(numbers, shape="cylinder"):
    """A palm that moves along z, and two fingers of two balls each that close along y; what they hold stands on
    three balls, or is in the air."""
    finger = js.SpatialInertia.solid_box(np.array([0.02, 0.02, 0.1]), mass=numbers.masses[0])
    held = js.SpatialInertia.solid_box(numbers.size, mass=numbers.masses[1])
    bodies = {"palm": finger, "left": finger, "right": finger, "held": held}
    joints = [
        js.Joint("lift", "prismatic", "world", "palm", axis=(0, 0, 1), damping=0.5),
        js.Joint("close left", "prismatic", "palm", "left", axis=(0, 1, 0)),
        js.Joint("close right", "prismatic", "palm", "right", axis=(0, -1, 0)),
        _free("held"),
    ]
    under = np.array([[0.02, 0, -0.05], [-0.01, 0.02, -0.05], [-0.01, -0.02, -0.05]])
    tips, radius = np.array([[0, 0, -0.03], [0, 0, 0.03]] * 2), np.float64(ROUND)
    of_held = js.Cylinder(numbers.size[1] / 2, numbers.size[2]) if shape == "cylinder" else js.Box(numbers.size)
    pairs = (
        js.ShapeContacts(["held"] * 4, of_held, **numbers.law(1)),
        js.PointContacts(["left"] * 2 + ["right"] * 2, tips, radius, **numbers.law(0)),
    )
    contacts = js.PointContacts(["held"] * 3, under, radius, **numbers.law(1))
    return PairScene(bodies, joints, numbers.gravity, contacts, pairs)


HELD = Numbers.of(masses=(0.5, 0.3), friction=(0.7, 0.8), size=(0.06, 0.06, 0.12))


UP, OUT = _placed([0.1, 0, 0], [0, 0, 0.15]), _placed([0, 0, 0], [0, 0, 0.25])


def arm(numbers, shape="box"):
    """A floating base with an arm that bends back: balls on its last link touch the base and the first link."""
    link = js.SpatialInertia.solid_capsule(np.float64(0.04), np.float64(0.2), mass=numbers.masses[1])
    base = js.SpatialInertia.solid_box(np.array([0.3, 0.3, 0.2]), mass=numbers.masses[0])
    bodies = {"base": base} | {f"link{i}": link for i in range(3)}
    joints = [
        _free("base"),
        js.Joint("shoulder", "revolute", "base", "link0", UP, axis=(0, 0, 1), damping=0.1),
        js.Joint("elbow", "revolute", "link0", "link1", OUT, axis=(0, 1, 0), damping=0.1),
        js.Joint("wrist", "revolute", "link1", "link2", OUT, axis=(0, 1, 0), damping=0.1),
    ]
    size = np.array([0.3, 0.3, 0.2])
    contacts = js.PointContacts(["base"] * 4, corners(size, (-1,)), np.float64(ROUND), **numbers.law(0))
    boxes = js.Box(np.array([size, [0.08, 0.08, 0.2]]))
    pairs = (
        js.ShapeContacts(["base", "link0"], boxes, **numbers.law(0)),
        js.PointContacts(["link2"] * 2, np.array([[0, 0, 0.1], [0, 0, 0.05]]), np.float64(0.04), **numbers.law(1)),
    )
    return PairScene(bodies, joints, numbers.gravity, contacts, pairs)


# -- random states ----------------------------------------------------------------------------------------------------


class State(NamedTuple):
    """Of n states: (n, nq), (n, nv), (n, nv)."""

    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray


def near_a_touch(make, numbers, rng, n):
    """Coordinates (n, nq)."""
    still = np.array([1.0, 0, 0, 0])
    if make is two_bodies:
        q = np.zeros((n, 14))
        q[:, :4], q[:, 7:11] = still + 0.02 * rng.normal(size=(n, 4)), still + 0.3 * rng.normal(size=(n, 4))
        q[:, 6], q[:, 11:13] = 0.1 - rng.uniform(-0.002, 0.005, n), rng.uniform(-0.3, 0.3, (n, 2))
        q[:, 13] = LOWER[2] + numbers.size[2] / 2 + rng.uniform(-0.1, 0.1, n)
        flat = rng.random(n) < 0.5
        q[flat, :4], q[flat, 7:11] = (still + 0.003 * rng.normal(size=(flat.sum(), 4)) for _ in range(2))
        q[flat, 13] = LOWER[2] + numbers.size[2] / 2 - rng.uniform(0, 0.006, flat.sum())
    elif make is hand:
        q = np.zeros((n, 10))
        q[:, 0], q[:, 1:3] = rng.uniform(0, 0.1, n), -0.04 + rng.uniform(-0.002, 0.004, (n, 2))
        q[:, 3:7], q[:, 7:9] = still + 0.02 * rng.normal(size=(n, 4)), rng.uniform(-0.003, 0.003, (n, 2))
        q[:, 9] = rng.uniform(0.055, 0.08, n)
    else:
        q = np.zeros((n, 10))
        q[:, :4], q[:, 6] = still + 0.02 * rng.normal(size=(n, 4)), 0.1 - rng.uniform(-0.002, 0.005, n)
        q[:, 7], q[:, 8:10] = rng.uniform(-3, 3, n), rng.uniform(0.8, 2.9, (n, 2))
    return q


def states(make, numbers, n, shape="box", seed=0):
    """n random states: of three in four the deepest pair is up to 5 mm inside, of the others up to 5 mm apart; at rest
    but for little, sliding, and fast. Where 16 n random places have none as deep, the one that is nearest to it."""
    rng = np.random.default_rng(seed)
    with jax.enable_x64(True):
        scene = make(numbers, shape)
        mech = scene.mechanism
        q, still = near_a_touch(make, numbers, rng, 16 * n), np.zeros(mech.nv)
        indices = [(mech.joint_position_indices(x), mech.joint_velocity_indices(x)) for x in mech.joint_names]
        floating = [(np.asarray(i)[:4], np.asarray(k)) for i, k in indices if len(k) == 6]
        for i, _ in floating:
            q[:, i] /= np.linalg.norm(q[:, i], axis=1, keepdims=True)
        depths = interpreted(jax.vmap(lambda q: js.contact_report(mech, q, still, pairs=scene.pairs).depths))(q)
    deepest = depths.max(1)
    wanted = rng.uniform(0, 0.005, n) * np.where(np.arange(n) % 4 == 3, -1, 1)
    chosen = []
    for depth in wanted:
        distance = abs(deepest - depth)
        distance[chosen] = np.inf
        chosen.append(distance.argmin())
    v, tau = rng.standard_normal((n, mech.nv)), rng.standard_normal((n, mech.nv))
    v *= np.array([0.01, 0.3, 1.0])[np.arange(n) % 3, None]
    for _, k in floating:
        tau[:, k] = 0
    return State(q[chosen], v, tau)


# -- cases that one works out -----------------------------------------------------------------------------------------


class Case(NamedTuple):
    """A scene, how it starts, and the time of a step."""

    numbers: Numbers
    state: State
    dt: np.float64


def rolled_out(make, cases, steps, shape="box"):
    """The ConvexSteps (n, steps) of n Cases."""
    stacked = jax.tree.map(lambda *x: np.stack(x), *cases)
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _rolling(make, steps, shape)(*stacked))


@functools.cache
def _rolling(make, steps, shape):
    def of(numbers, state, dt):
        step = make(numbers, shape).stepper()

        def one(at, _):
            after = step(*at, state.tau, dt)
            return (after.q, after.v), after

        return jax.lax.scan(one, (state.q, state.v), None, steps)[1]

    return jax.jit(jax.vmap(of))


def mean_friction(numbers):
    """Of the two surfaces."""
    a, b = numbers.friction
    return 2 * a * b / (a + b)


def in_series(numbers):
    """The stiffness of a contact of the two surfaces."""
    return 1 / sum(1 / numbers.stiffness)


def on_one_another(slope=0.0, dt=2e-3, ahead=0.0, speed=0.0, height=0.0, w=(0.0, 0.0, 0.0), **numbers):
    """Boxes on one another that lie on a slope, along whose axes they are; the upper one slides down it, or turns and
    falls from a height."""
    numbers = Numbers.of(gravity=G * np.array([np.sin(slope), 0, -np.cos(slope)]), **numbers)
    q, v = np.zeros(14), np.zeros(12)
    # In as far as the weight presses them, without the moment of the upper one.
    k, weights = np.array([numbers.stiffness[0], in_series(numbers)]), G * numbers.masses
    depths = np.array([weights.sum(), weights[1]]) / (4 * k)
    q[[0, 7]], q[6], q[11] = 1, LOWER[2] / 2 - depths[0], ahead
    q[13] = q[6] + (LOWER[2] + numbers.size[2]) / 2 - depths[1] + height
    v[6:9], v[9] = w, speed
    return Case(numbers, State(q, v, np.zeros(12)), np.float64(dt))


FIRM = {"stiffness": (1e5, 1e5), "relaxation_time": (2e-3, 2e-3)}
HARD = {"stiffness": (1e6, 1e6), "relaxation_time": (2e-3, 2e-3)}
TALL = {"size": (0.1, 0.2, 0.4), "friction": (0.9, 0.9), **HARD}
# Of the points that it stands on: half of the width over half of the height.
TIPS = (0.05 - ROUND) / 0.2
ROUGH = {"masses": (40.0, 2.0), "friction": (0.8, 0.3), **FIRM}
MU = 2 * 0.8 * 0.3 / 1.1
BOXES = {
    "rests": on_one_another(),
    "heavy on light": on_one_another(masses=(1.0, 100.0), stiffness=(1e5, 2e5)),
    "light on heavy": on_one_another(masses=(1e3, 1e-3), stiffness=(1e6, 10.0)),
    "slides": on_one_another(dt=1e-3, ahead=-0.1, speed=0.6, **ROUGH),
    "stands": on_one_another(np.arctan(0.96 * TIPS), **TALL),
    "tips": on_one_another(np.arctan(1.04 * TIPS), **TALL),
    "sticks": on_one_another(np.arctan(0.97 * MU), **ROUGH),
    "slips": on_one_another(np.arctan(1.1 * MU), ahead=-0.15, **ROUGH),
    "falls": on_one_another(dt=1e-3, height=0.1, w=(2.0, -1.0, 3.0)),
}


SOFT = {"stiffness": (4e3, 4e3), "relaxation_time": (1e-3, 1e-3)}


def held(squeeze, lift=0.0, **numbers):
    """A hand that squeezes, in shares of the least that holds: mu N of two fingers, under m (g + lift). The force on
    the palm carries all weights, and accelerates all by `lift`."""
    numbers = HELD._replace(**{k: np.asarray(x, float) for k, x in (SOFT | numbers).items()})
    finger, mass = numbers.masses
    least = mass * (G + lift) / (2 * mean_friction(numbers))
    q, tau = np.zeros(10), np.zeros(9)
    # The balls are in by as much as the squeeze presses them.
    q[1:3] = squeeze * least / 2 / in_series(numbers) - (numbers.size[1] / 2 + ROUND)
    q[0], q[3], q[9] = 0.5, 1, 0.5
    tau[:3] = (3 * finger + mass) * (G + lift), squeeze * least, squeeze * least
    return Case(numbers, State(q, np.zeros(9), tau), np.float64(1e-3))


# How much the hand squeezes, and how fast it lifts.
SQUEEZES = {"holds": (1.05, 0.0), "slips": (0.9, 0.0), "lifts": (1.05, 4.0), "lifts too fast": (0.9, 4.0)}
HANDS = {name: held(*x) for name, x in SQUEEZES.items()}
HANDS["heavy"] = held(1.05, masses=(0.01, 10.0), stiffness=(1e5, 1e5))
