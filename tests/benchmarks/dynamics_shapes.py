"""Chains of any length, hands and quadrupeds: whether size costs compile time, and a link the same."""

import numpy as np
from dynamics_claims import FORWARD, INVERSE, Case, Shape
from dynamics_compiling import cold, in_turns, watched
from dynamics_rows import States, program

import jaxspatial as js

# name -> (size -> its chains, each a list of axes; whether they hang on a floating base)
_FINGER, _LEG = "zyyy", "xyy"
SHAPES = {
    "chain": ({f"{n} links": ["yz" * (n // 2)] for n in (10, 100, 1000)}, False),
    "hand": ({"one finger": [_FINGER], "five fingers": [_FINGER] * 5}, False),
    "quadruped": ({"one leg": [_LEG], "four legs": [_LEG] * 4}, True),
}


def mechanism(chains, is_floating):
    """Of revolute joints, every link with numbers of its own."""
    rng = np.random.default_rng(0)
    bodies = [js.Body("base", _inertia(rng))] if is_floating else []
    joints = [js.Joint("base", "free", "world", "base")] if is_floating else []
    for c, axes in enumerate(chains):
        parent = "base" if is_floating else "world"
        for k, axis in enumerate(axes):
            name = f"link {c}.{k}"
            bodies.append(js.Body(name, _inertia(rng)))
            joints.append(_joint(rng, name, parent, axis))
            parent = name
    return js.Mechanism.build(bodies, joints, dtype=np.float64)


def _inertia(rng):
    a = rng.standard_normal((3, 3))
    com, central = rng.standard_normal(3) * 0.02, (a @ a.T + np.eye(3)) * 1e-4
    return js.SpatialInertia(np.float64(rng.uniform(0.1, 0.3)), com, central)


def _joint(rng, name, parent, axis):
    offset = js.RigidTransform(js.Rotation.identity(dtype=np.float64), rng.standard_normal(3) * 0.05)
    return js.Joint(name, "revolute", parent, name, axis=np.eye(3)["xyz".index(axis)], placement=offset)


def measured(batch, rounds, limit, dtype="float32"):
    """Shape by Shape. Compile times one per round, in turns."""
    for name, (sizes, is_floating) in SHAPES.items():
        for algorithm in (INVERSE, FORWARD):
            compiling, cases = {size: [] for size in sizes}, {}
            for _ in range(rounds):
                for size, chains in sizes.items():
                    call, found = _compiled(chains, is_floating, algorithm, batch, dtype)
                    compiling[size].append(found.total)
                    cases[Case(size, batch, algorithm)] = call
            seconds = _per_link(in_turns(cases, 3 * rounds, limit), sizes) if name == "chain" else {}
            yield Shape(name, algorithm, {k: np.array(x) for k, x in compiling.items()}, seconds)


def _compiled(chains, is_floating, algorithm, batch, dtype):
    mech = mechanism(chains, is_floating)
    arrays = States(None, mech, batch).ours(dtype)
    del mech
    return cold(lambda: program(watched(mechanism(chains, is_floating)), None, algorithm), arrays)


def _per_link(seconds, sizes):
    return {case.algorithm: s / len(sizes[case.algorithm][0]) for case, s in seconds.items()}
