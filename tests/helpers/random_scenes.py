"""Random mechanisms that touch, are held by closures, are at limits and rub: what a step with contact may meet."""

from typing import Any, NamedTuple

import jax
import numpy as np

import jaxspatial as js
from tests.helpers import contact_oracle as oracle
from tests.helpers.interpreted import interpreted

JOINTS = "revolute", "ball", "prismatic", "universal", "revolute", "free"
CLOSURES = "weld", "hinge", "universal", "ball", "distance"


class RandomScene(NamedTuple):
    """A mechanism, what its step takes by name, the time of a step, and states: q, v and tau, (n, ...)."""

    mechanism: js.Mechanism
    terms: dict[str, Any]
    dt: Any
    states: tuple

    def step(self, dtype="float64"):
        """A ConvexStep of all states."""
        own = self.astype(dtype)
        return interpreted(lambda *x: js.convex_step(own.mechanism, *x, own.dt, **own.terms))(*own.states)

    def astype(self, dtype):
        dtype = np.dtype(dtype)
        return RandomScene(
            *jax.tree.map(lambda x: x.astype(dtype) if hasattr(x, "astype") else dtype.type(x), tuple(self))
        )

    def decrements(self, found, dtype="float64"):
        """sqrt(g^T H^-1 g) of every state, relative to the momenta, at the velocities that were found: in float64, of
        the numbers that the step was given."""
        own = self.astype(dtype).astype("float64")
        q, v, tau = own.states
        problems = oracle.problems_of(own.mechanism, q, v, tau, own.dt, **own.terms)
        return np.array([decrement(own.mechanism, x, *y) for x, *y in zip(problems, found.q, found.v, strict=True)])


def decrement(mech, own, q, v):
    """sqrt(g^T H^-1 g), relative to the momenta, of an `oracle.Own` at the q and v after a step."""
    after = oracle.in_world(mech, q) @ np.asarray(v, float)
    problem, y = own.problem, own.problem.free - own.v
    if not problem.terms:
        return 0.0
    _, g, H, _ = problem.at(after)
    return np.sqrt(g @ np.linalg.solve(H, g) / (own.v @ problem.A @ own.v + y @ problem.A @ y))


def random_scene(seed, n=2, opening=1e-2):
    """Two to six bodies of masses between 0.1 and 10 with random joints, limits and dry friction; up to six spheres on
    the ground, a pair of spheres and up to two closures, open by some `opening`, m and rad, where these can close."""
    rng = np.random.default_rng(seed)
    n_bodies = int(rng.integers(2, 7))
    names, bodies, joints = [f"b{i}" for i in range(n_bodies)], [], []
    for i, name in enumerate(names):
        axes, mass = rng.uniform(0.05, 0.3, 3), 10 ** rng.uniform(-1, 1)
        bodies.append(js.Body(name, js.SpatialInertia.solid_ellipsoid(axes, mass=np.float64(mass))))
        parent = "world" if i == 0 else names[rng.integers(i)] if rng.random() < 0.9 else "world"
        kinds = JOINTS if parent == "world" else JOINTS[:-1]
        kind = kinds[rng.integers(len(kinds))]
        joints.append(js.Joint(f"j{i}", kind, parent, name, _pose(rng, kind), **_of_joint(rng, kind)))
    mech = js.Mechanism.build(bodies, joints, dtype=np.float64)
    frames = [js.Frame(f"f{i}", names[rng.integers(n_bodies)], _pose(rng, "")) for i in range(4)]
    return _touching(rng, js.add_frames(mech, frames), names, n, opening)


# (parent, kind, axis) of bodies b0, b1 ..., and closures between them, or frames f0, f1 ... on the last and the first.
BUILT = {
    # A universal joint between links of a tree with six contacts.
    "universal": (
        [
            ("world", "free", None),
            ("b0", "revolute", (0, 1, 0.3)),
            ("b0", "revolute", (1, 0.2, 0)),
            ("b1", "ball", None),
        ],
        [("b2", "f0", "universal")],
        6,
    ),
    # A weld to the world, and a ball on two bodies.
    "weld and ball": (
        [("world", "free", None), ("b0", "revolute", (0, 1, 0)), ("b1", "revolute", (1, 0, 0)), ("b0", "ball", None)],
        [("world", "f1", "weld"), ("b2", "f0", "ball")],
        3,
    ),
    # A leg with a weld across its knee.
    "leg": ([("world", "free", None), ("b0", "revolute", (0, 1, 0)), ("b1", "revolute", (0, 1, 0))], [], 1),
}


def built_scene(name, n=2, opening=1e-2):
    """One of BUILT, open by some `opening`, with random numbers."""
    rng, (links, closures, n_spheres) = np.random.default_rng(1), BUILT[name]
    names = [f"b{i}" for i in range(len(links))]
    M = js.SpatialInertia.solid_ellipsoid(np.array([0.1, 0.2, 0.15]), mass=np.float64(2))
    out = js.RigidTransform(js.Rotation.exp(np.array([0.1, 0.2, -0.1])), np.array([0.3, 0.05, -0.2]))
    joints = [
        js.Joint(
            f"j{i}",
            kind,
            parent,
            f"b{i}",
            None if parent == "world" else out,
            **({} if axis is None else {"axis": axis}),
        )
        for i, (parent, kind, axis) in enumerate(links)
    ]
    mech = js.Mechanism.build([js.Body(x, M) for x in names], joints, dtype=np.float64)
    mech = js.add_frames(mech, [js.Frame("f0", names[-1], _pose(rng, "")), js.Frame("f1", "b0", _pose(rng, ""))])
    loops = [js.LoopClosure(*x) for x in closures]
    if name == "leg":
        # Where the knee is straight.
        X = interpreted(lambda q: js.forward_kinematics(mech, q, ["b1", "b2"]))(mech.neutral())
        X_AB = X.at_batch(0).inverse() @ X.at_batch(1)
        mech = js.add_frames(mech, [js.Frame("knee", "b1", jax.tree.map(np.asarray, X_AB))])
        loops = [js.LoopClosure("knee", "b2", "weld")]
    return _touching(rng, mech, names, n, opening, loops, n_spheres)


def _touching(rng, mech, names, n, opening, loops=None, n_spheres=None):
    """The RandomScene of a mechanism in states near where closures are closed, with spheres on its bodies."""
    moved = interpreted(lambda q, v: js.integrate(mech, q, v))
    q = moved(np.repeat(np.asarray(mech.neutral())[None], n, 0), 0.7 * rng.standard_normal((n, mech.nv)))
    v, tau = rng.standard_normal((n, mech.nv)) * 10 ** rng.uniform(-1, 0.5), rng.standard_normal((n, mech.nv))
    n_spheres = int(rng.integers(1, 7)) if n_spheres is None else n_spheres
    on = tuple(names[rng.integers(len(names))] for _ in range(n_spheres))
    p = rng.uniform(-0.2, 0.2, (n_spheres, 3))
    loops = _closures(rng, mech, names) if loops is None else loops
    if loops:
        shut = interpreted(lambda q: js.close_loops(mech, q, loops))(q)
        q = np.where((shut.residual < 1e-9)[:, None], shut.q, q)
        q = moved(q, opening * rng.standard_normal((n, mech.nv)))
    # Spheres are on the ground z = 0, half of them inside: they are moved, and not the mechanism.
    X = interpreted(lambda q: js.forward_kinematics(mech, q, on))(q[0])
    depths = np.asarray(X @ p)[..., 2] - 0.05 - rng.uniform(-0.02, 0.02, n_spheres)
    p = p - np.asarray(X.rotation.inverse() @ (depths[:, None] * np.array([0.0, 0, 1])))
    terms = {"contacts": _spheres(rng, on, p), "loops": loops}
    return RandomScene(mech, terms, 10 ** rng.uniform(-3, -2), (q, v, tau))


def _pose(rng, kind):
    # Those of free joints are placed in the world without a turn of their own.
    turn = np.zeros(3) if kind == "free" else rng.standard_normal(3)
    return js.RigidTransform(js.Rotation.exp(turn), rng.uniform(-0.4, 0.4, 3))


def _of_joint(rng, kind):
    given = {}
    if kind in ("revolute", "prismatic"):
        given["axis"] = rng.standard_normal(3)
        if rng.random() < 0.5:
            given |= {"lower": -0.3, "upper": 0.3}
    if kind == "universal":
        given |= {"axis": (0, 0, 1), "second_axis": (1, 0, 0)}
    if kind != "free" and rng.random() < 0.3:
        given["friction_loss"] = 0.3
    if kind != "free" and rng.random() < 0.3:
        given["damping"] = 0.2
    return given


def _spheres(rng, on, p):
    n = len(on)
    law = {"stiffness": 10 ** rng.uniform(3, 6, n), "relaxation_time": rng.uniform(0, 0.05, n)}
    return js.PointContacts(on, p, np.full(n, 0.05), friction=rng.uniform(0, 1, n), **law)


def _closures(rng, mech, names):
    loops = []
    for _ in range(int(rng.integers(0, 3))):
        of_body = {
            name: [name, *(f for f in mech.frame_names if f[0] == "f" and mech.frame_body(f) == name)] for name in names
        }
        a, b = (["world", *names][i] for i in rng.choice(len(names) + 1, 2, replace=False))
        a, b = (x if x == "world" else of_body[x][rng.integers(len(of_body[x]))] for x in (a, b))
        kind = CLOSURES[rng.integers(len(CLOSURES))]
        loops.append(js.LoopClosure(a, b, kind, *([0.5] if kind == "distance" else [])))
    return loops
