"""From the parts that a caller names to the arrays of a Mechanism: the tree put in order, welded bodies merged."""

import functools
import operator
from collections.abc import Container, Iterable, Sequence
from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers.folding import in_double
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joint_numbers import as_of_followed, parameter, per, registered_parameters, spring_reference
from jaxspatial.mechanism.joints import KINDS, OF_EVERY_JOINT, Parameter
from jaxspatial.mechanism.parts import WORLD, Body, Frame, Joint
from jaxspatial.mechanism.poses import act_unless_identity, check_single, composed, identity, known, or_identity
from jaxspatial.mechanism.topology import Topology
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

# How these go with the ratio of a gear.
_POWERS = {"armature": 2, "damping": 2, "friction_loss": 1, "stiffness": 2}

# A joint with the number of the moving body that carries it, and where on it its parent is.
Hung = tuple[Joint, int, RigidTransform]


def assembled(
    bodies: Sequence[Body], joints: Sequence[Joint], frames: Sequence[Frame]
) -> tuple[Topology, dict[str, Any]]:
    """(Topology, its arrays by name) of parts: what `Mechanism` consists of but for gravity, in float64."""
    _check_names(bodies, joints, frames)
    with in_double():
        tree = _Tree({b.name: b for b in bodies}, {j.name: j for j in joints})
        tree.attach(WORLD, -1, identity())
        _check_reached(bodies, tree.places)
        for frame in frames:
            tree.add_frame(frame)
        return tree.topology(), tree.arrays()


# -- names ------------------------------------------------------------------------------------------------------------


def _check_names(bodies: Sequence[Any], joints: Sequence[Any], frames: Sequence[Any]):
    for what, kind, parts in (("bodies", Body, bodies), ("joints", Joint, joints), ("frames", Frame, frames)):
        for part in parts:
            if not isinstance(part, kind):
                raise TypeError(f"Mechanism.build: {what}: expected {kind.__name__}s, got {type(part).__name__}")
        _check_unique(what, [part.name for part in parts])
    for body in bodies:
        if body.inertia is not None:
            check_single(body, "inertia", SpatialInertia)
    _check_unique("bodies and frames", [WORLD, *(b.name for b in bodies), *(f.name for f in frames)])
    _check_unique("joints: children", [joint.child for joint in joints])
    names = {body.name for body in bodies}
    for joint in joints:
        for side, name, there in (("parent", joint.parent, names | {WORLD}), ("child", joint.child, names)):
            if name not in there:
                near = check.did_you_mean(name, there)
                raise ValueError(f"Joint {joint.name!r}: {side}: there is no body {name!r}{near}")


def _check_unique(what: str, names: Iterable[str]):
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ValueError(f"Mechanism.build: {what}: {name!r} comes twice")
        seen.add(name)


def _check_reached(bodies: Iterable[Body], places: Container[str]):
    lost = [body.name for body in bodies if body.name not in places]
    if lost:
        raise ValueError(f"Mechanism.build: joints: nothing holds {', '.join(map(repr, lost))} against the world")


# -- the tree ---------------------------------------------------------------------------------------------------------


class _Tree:
    """What has been hung up so far."""

    def __init__(self, bodies: dict[str, Body], joints: dict[str, Joint]):
        self.bodies = bodies
        self.held: dict[str, list[Joint]] = {}
        for joint in joints.values():
            self.held.setdefault(joint.parent, []).append(joint)
        self.moving, self.parents = list[Joint](), list[int]()
        self.placements, self.masses = list[RigidTransform](), list[list[SpatialInertia]]()
        # Of every body: the moving one that it is a part of, and where on it.
        self.places: dict[str, tuple[int, RigidTransform]] = {}

    def attach(self, name: str, carrier: int, X: RigidTransform):
        """The body at X on the moving body number `carrier`, and all that hangs on it: each body right behind its
        parent or a branch of it, as chains need it."""
        pending = self._place(name, carrier, X)
        while pending:
            pending += self._place(*self._attached(*pending.pop()))

    def _place(self, name: str, carrier: int, X: RigidTransform) -> list[Hung]:
        """What hangs on a body, the first joint last."""
        self.places[name] = carrier, X
        if carrier >= 0 and (M := self.bodies[name].inertia) is not None:
            self.masses[carrier].append(act_unless_identity(X, M))
        return [(joint, carrier, X) for joint in reversed(self.held.get(name, []))]

    def _attached(self, joint: Joint, carrier: int, X: RigidTransform):
        placement = composed(X, or_identity(joint, "placement"))
        child = or_identity(joint, "child_placement")
        if joint.kind == "fixed":
            return joint.child, carrier, composed(placement, child)
        self.moving.append(joint)
        self.parents.append(carrier)
        self.placements.append(placement)
        self.masses.append([])
        return joint.child, len(self.moving) - 1, child

    def add_frame(self, frame: Frame):
        if frame.body not in self.places:
            near = check.did_you_mean(frame.body, self.places)
            raise ValueError(f"Frame {frame.name!r}: body: there is no body {frame.body!r}{near}")
        carrier, X = self.places[frame.body]
        self.places[frame.name] = carrier, composed(X, or_identity(frame, "placement"))

    # -- results ------------------------------------------------------------------------------------------------------

    def topology(self):
        names = [joint.name for joint in self.moving]
        return Topology(
            body_names=tuple(joint.child for joint in self.moving),
            joint_names=tuple(names),
            kinds=tuple(joint.kind for joint in self.moving),
            parents=tuple(self.parents),
            followed=tuple(self._followed(names, i) for i in range(len(names))),
            frames=tuple((name, carrier) for name, (carrier, _) in self.places.items()),
        )

    def _followed(self, names: list[str], i: int) -> int:
        joint = self.moving[i]
        if not (mimic := joint.follows):
            return i
        both = [joint, *(other for other in self.moving if other.name == mimic.joint)]
        if len(both) < 2 or both[1].follows or any(KINDS[x.kind].nq != 1 for x in both):
            near = "" if len(both) > 1 else check.did_you_mean(mimic.joint, names)
            expected = "the name of a joint with one coordinate of its own"
            raise ValueError(f"Joint {joint.name!r}: mimic: expected {expected}, got {mimic.joint!r}{near}")
        return names.index(mimic.joint)

    def arrays(self) -> dict[str, Any]:
        own = [joint for joint in self.moving if not joint.follows]
        limits = {"effort_limit": "nv", "velocity_limit": "nv", "lower": "nq", "upper": "nq"}
        return {
            "placements": _stacked(self.placements),
            "child_placements": _stacked([or_identity(joint, "child_placement") for joint in self.moving]),
            **{p.field: self._parameter(p) for p in OF_EVERY_JOINT if p.field},
            "parameters": {p.name: self._parameter(p) for p in registered_parameters(j.kind for j in self.moving)},
            "mimics": rows([mimic[1:] if (mimic := joint.follows) else (1.0, 0.0) for joint in self.moving], 2),
            "inertias": _inertias(self.masses),
            "frame_placements": _stacked([X for _, X in self.places.values()]),
            **{name: self._with_mimics(own, name, power) for name, power in _POWERS.items()},
            **{name: per(own, name, size) for name, size in limits.items()},
            "spring_references": self._references(own),
        }

    def _parameter(self, p: Parameter):
        """(n, size) of all joints, (n,) of the pitch."""
        found = rows([parameter(joint, p) for joint in self.moving], p.size)
        return found[:, 0] if p.field and p.size == 1 else found

    def _references(self, own: list[Joint]):
        """Where the springs of each joint and its mimics together rest: the mean of where each does, by stiffness."""
        return np.concatenate([np.zeros(0), *(self._rests(joint) for joint in own)])

    def _rests(self, joint: Joint):
        own, followers = spring_reference(joint), [(j, j.follows) for j in self.moving]
        springs = [as_of_followed(j, mimic) for j, mimic in followers if mimic and mimic.joint == joint.name]
        stiffness = per([joint], "stiffness", "nv")[0] if springs else 0.0
        total = stiffness + sum(k for k, _ in springs)
        return own if not total else sum((k * x for k, x in springs), stiffness * own) / total

    def _with_mimics(self, own: list[Joint], name: str, power: int):
        """One number per rate: what a mimic has of it is with the joint that it follows."""
        found = np.split(per(own, name, "nv"), np.cumsum([KINDS[joint.kind].nv for joint in own])[:-1])
        places = {joint.name: k for k, joint in enumerate(own)}
        for joint in self.moving:
            if mimic := joint.follows:
                found[places[mimic.joint]] += abs(mimic.multiplier) ** power * per([joint], name, "nv")
        return np.concatenate([np.zeros(0), *found])


# -- arrays -----------------------------------------------------------------------------------------------------------


def rows(rows: Sequence[Any], n: int):
    return np.array(rows, np.float64).reshape(len(rows), n)


def _stacked(transforms: Sequence[RigidTransform]):
    entries = rows([X.rotation.entries for X in transforms], 9)
    return RigidTransform(Rotation(entries), rows([X.translation for X in transforms], 3))


def _inertias(masses: list[list[SpatialInertia]]):
    merged = [functools.reduce(operator.add, parts) if parts else _nothing() for parts in masses]
    leaves = [jax.tree.leaves(jax.tree.map(known, M)) for M in merged]
    mass, com, central = ([parts[k] for parts in leaves] for k in range(3))
    return SpatialInertia(rows(mass, 1)[:, 0], rows(com, 3), rows(central, 6))


def _nothing():
    return SpatialInertia.zero(dtype=np.float64)
