"""Builds the arrays of a mechanism from its parts: puts the tree in order and merges welded bodies."""

import dataclasses
import functools
import math
import operator
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.joints import KINDS, OF_EVERY_JOINT, Parameter
from jaxspatial.mechanism.parts import (
    WORLD,
    Body,
    Frame,
    Joint,
    Mimic,
    check_armature,
    check_limits,
    known,
    numbers,
    parameter,
    spring_reference,
)
from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, act

# Fields to which a mimic adds what it has, and the power of its multiplier, as of a gear ratio, that they go with.
_POWERS = {"armature": 2, "damping": 2, "friction_loss": 1, "stiffness": 2}
_LIMITS = {"effort_limit": "nv", "velocity_limit": "nv", "lower": "nq", "upper": "nq"}


class BeyondNumbers(ValueError):
    """A body has inertia, or carries so much, that the algorithms cannot take it in a dtype. Readers add its line.

    Attributes:
        body: its name.
        reason: the argument, what was expected and what came.
    """

    def __init__(self, body: str, reason: str):
        super().__init__(f"Body {body!r}: {reason}")
        self.body, self.reason = body, reason


def assembled(
    bodies: Sequence[Body], joints: Sequence[Joint], frames: Sequence[Frame]
) -> tuple[Topology, dict[str, Any]]:
    """Returns the topology and, by name, the arrays of a Mechanism except gravity, in float64."""
    _check_names(bodies, joints, frames)
    with in_double():
        tree = _Tree(bodies, joints)
        lost = [body.name for body in bodies if body.name not in tree.places]
        if lost:
            raise ValueError(f"Mechanism.build: joints: nothing holds {', '.join(map(repr, lost))} against the world")
        for frame in frames:
            tree.add_frame(frame)
        return tree.topology(), tree.arrays()


def registered_parameters(kinds: Iterable[str]) -> list[Parameter]:
    """The parameters that registered kinds declare, each once."""
    return list(dict.fromkeys(p for kind in kinds for p in KINDS[kind].parameters if p.field is None))


# -- names ------------------------------------------------------------------------------------------------------------


def _check_names(bodies: Sequence[Body], joints: Sequence[Joint], frames: Sequence[Frame]):
    for what, parts in (("bodies", bodies), ("joints", joints), ("frames", frames)):
        for part in parts:
            if not isinstance(part.name, str):
                kind = type(part).__name__
                raise TypeError(f"Mechanism.build: {what}: expected a text as the name of a {kind}, got {part.name!r}")
        _check_unique(what, [part.name for part in parts])
    for body in bodies:
        for field in ("inertia", "lift"):
            if getattr(body, field) is not None:
                _check_single(body, field, SpatialInertia)
    _check_unique("bodies and frames", [WORLD, *(b.name for b in bodies), *(f.name for f in frames)])
    _check_unique("joints: children", [joint.child for joint in joints])
    names = {body.name for body in bodies}
    for joint in joints:
        for side, name, there in (("parent", joint.parent, names | {WORLD}), ("child", joint.child, names)):
            if name not in there:
                near = check.did_you_mean(name, there)
                raise ValueError(f"Joint {joint.name!r}: {side}: there is no body {name!r}{near}")


def _check_unique(what: str, names: Iterable[str]):
    seen = set[str]()
    for name in names:
        if name in seen:
            raise ValueError(f"Mechanism.build: {what}: {name!r} comes twice")
        seen.add(name)


# -- the tree ---------------------------------------------------------------------------------------------------------


class _Tree:
    """The bodies in depth-first order: each comes right after its parent or a branch of it, as chains need it.

    moving: the joints that move. parents, placements, masses: of each of them. places: {body or frame: (number of the
    moving body it is a part of, pose on the joint of that body)}.
    """

    def __init__(self, bodies: Sequence[Body], joints: Sequence[Joint]):
        self.inertias = {body.name: body.inertia for body in bodies}
        self.lifts = {body.name: body.lift for body in bodies if body.lift is not None}
        self.moving, self.parents = list[Joint](), list[int]()
        self.placements, self.masses = list[RigidTransform](), list[list[SpatialInertia]]()
        self.places = dict[str, tuple[int, RigidTransform]]()
        self.hanging, self.carried_by = dict[str, list[Joint]](), {WORLD: WORLD}
        self.mimics = _resolved(joints)
        self.welds = list[tuple[Joint, RigidTransform]]()
        for joint in reversed(joints):
            self.hanging.setdefault(joint.parent, []).append(joint)
        pending = self._place(WORLD, -1, identity())
        while pending:
            pending += self._place(*self._attach(pending.pop()))

    def _place(self, name: str, carrier: int, X: RigidTransform):
        """Adds a body to its carrier; returns the joints that hang on it, the first one last."""
        self.places[name] = carrier, X
        if carrier >= 0:
            self.masses[carrier] += [_acted(X, M) for M in self._own(name)]
        return self.hanging.get(name, [])

    def _attach(self, joint: Joint):
        carrier, X = self.places[joint.parent]
        own, child = or_identity(joint, "placement"), or_identity(joint, "child_placement")
        placement = composed(X, own)
        if joint.kind == "fixed":
            self.carried_by[joint.child] = joint.parent
            self.welds.append((joint, composed(own, child)))
            return joint.child, carrier, composed(placement, child)
        self.carried_by[joint.child] = joint.child
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
        self.carried_by[frame.name] = frame.body

    def topology(self):
        number = {name: i for i, name in enumerate(self.places)}
        moving = {joint.name: i for i, joint in enumerate(self.moving)}
        return Topology(
            body_names=tuple(joint.child for joint in self.moving),
            joint_names=tuple(joint.name for joint in self.moving),
            kinds=tuple(joint.kind for joint in self.moving),
            parents=tuple(self.parents),
            followed=tuple(moving[self.mimics[x].joint if x in self.mimics else x] for x in moving),
            frames=tuple((name, carrier) for name, (carrier, _) in self.places.items()),
            welds=tuple((joint.name, number[joint.child]) for joint, _ in self.welds),
            carried_by=tuple(number[self.carried_by[name]] for name in self.places),
            hung_on=tuple(number[joint.parent] for joint in self.moving),
        )

    def _lifted(self) -> list[list[SpatialInertia]]:
        """What gravity does not pull at, of each moving body, without moments."""
        found = [list[SpatialInertia]() for _ in self.moving]
        for name, lift in self.lifts.items():
            carrier, X = self.places[name]
            if carrier >= 0:
                found[carrier].append(_acted(X, dataclasses.replace(jax.tree.map(known, lift), central=np.zeros(6))))
        return found

    def _welded(self) -> list[list[SpatialInertia]]:
        """For each weld the inertias of all bodies that are welded behind it, about the origin of its own."""
        found = {joint.child: self._own(joint.child) for joint, _ in self.welds}
        for joint, X in reversed(self.welds):
            if joint.parent in found:
                found[joint.parent] += [_acted(X, M) for M in found[joint.child]]
        return [found[joint.child] for joint, _ in self.welds]

    def _own(self, name: str) -> list[SpatialInertia]:
        M = self.inertias[name]
        return [] if M is None else [jax.tree.map(known, M)]

    def arrays(self) -> dict[str, Any]:
        leaders = [joint for joint in self.moving if joint.name not in self.mimics]
        for joint in leaders:
            check_armature(joint)
            check_limits(joint)
        mimics = [(joint, self.mimics[joint.name]) for joint in self.moving if joint.name in self.mimics]
        alone, turn_limits = Mimic(""), np.array([joint.turn_limit for joint in self.moving], np.float64)
        return {
            "placements": _stacked_poses(self.placements),
            "child_placements": _stacked_poses([or_identity(joint, "child_placement") for joint in self.moving]),
            **{p.field: self._parameter(p) for p in OF_EVERY_JOINT if p.field},
            "parameters": {p.name: self._parameter(p) for p in registered_parameters(j.kind for j in self.moving)},
            "mimics": _matrix([self.mimics.get(joint.name, alone)[1:] for joint in self.moving], 2),
            "inertias": _inertias(self.masses),
            # No arrays of size zero, which checkpoints refuse.
            "weld_inertias": _inertias(self._welded()) if self.welds else None,
            "lifts": _inertias(self._lifted()) if self.lifts else None,
            "turn_limits": turn_limits if np.isfinite(turn_limits).any() else None,
            "frame_placements": _stacked_poses([X for _, X in self.places.values()]),
            **{name: _with_mimics(leaders, mimics, name, power) for name, power in _POWERS.items()},
            **{name: _concatenated(numbers(joint, name, size) for joint in leaders) for name, size in _LIMITS.items()},
            "spring_references": _concatenated(_rest(joint, mimics) for joint in leaders),
        }

    def _parameter(self, p: Parameter):
        """(n, size) of all joints, (n,) of the pitch."""
        values = _matrix([parameter(joint, p) for joint in self.moving], p.size)
        return values[:, 0] if p.field and p.size == 1 else values


def _resolved(joints: Iterable[Joint]) -> dict[str, Mimic]:
    """{name of a joint that follows: the joint with a coordinate of its own that it follows, along a chain of mimics}.

    Of q = a (b r + c) + d the multiplier is a b, the offset a c + d.
    """
    of = {joint.name: joint for joint in joints if joint.kind != "fixed"}
    found = dict[str, Mimic]()
    for joint in of.values():
        if (mimic := joint.follows) is None:
            continue
        leader, a, b = mimic
        passed = [joint.name]
        while leader in of and leader not in passed and (further := of[leader].follows):
            passed.append(leader)
            leader, a, b = further.joint, a * further.multiplier, a * further.offset + b
        if leader not in of or leader in passed or any(KINDS[x.kind].nq != 1 for x in (joint, of[leader])):
            near = check.did_you_mean(leader, of) if leader not in of else ""
            came = f"{mimic.joint!r}, which follows {leader!r}" if len(passed) > 1 else repr(leader)
            expected = "the name of a joint with one coordinate of its own, or of one that follows such a joint"
            raise ValueError(f"Joint {joint.name!r}: mimic: expected {expected}, got {came}{near}")
        found[joint.name] = Mimic(leader, a, b)
    return found


# -- arrays -----------------------------------------------------------------------------------------------------------

_Mimics = list[tuple[Joint, Mimic]]


def _with_mimics(leaders: list[Joint], mimics: _Mimics, name: str, power: int):
    """A number per generalized velocity: what a mimic has is added to the joint that it follows."""
    totals = {joint.name: numbers(joint, name, "nv") for joint in leaders}
    for joint, (leader, multiplier, _) in mimics:
        totals[leader] = totals[leader] + _power(multiplier, power) * numbers(joint, name, "nv")
    return _concatenated(totals.values())


def _power(multiplier: float, power: int):
    """|a|^n, or the largest number: times what a joint does not have it is 0."""
    with np.errstate(over="ignore"):
        return np.minimum(np.float64(abs(multiplier)) ** power, np.finfo(float).max)


def _rest(joint: Joint, mimics: _Mimics):
    """The coordinates at which the springs of a joint and its mimics together rest: the mean of theirs, by stiffness.

    The spring k of a mimic at a q + b is one of a^2 k at q.
    """
    rest = spring_reference(joint)
    springs = [
        (_power(a, 2) * numbers(mimic, "stiffness", "nv")[0], (spring_reference(mimic) - b) / (a or 1.0))
        for mimic, (leader, a, b) in mimics
        if leader == joint.name
    ]
    stiffness = numbers(joint, "stiffness", "nv")[0] if springs else 0.0
    total = stiffness + sum(k for k, _ in springs)
    return rest if not total else sum((k * x for k, x in springs), stiffness * rest) / total


def _concatenated(arrays: Iterable[np.ndarray]):
    return np.concatenate([np.zeros(0), *arrays])


def _matrix(values: Sequence[Any], n: int):
    return np.array(values, np.float64).reshape(len(values), n)


def _stacked_poses(transforms: Sequence[RigidTransform]):
    entries = _matrix([X.rotation.entries for X in transforms], 9)
    return RigidTransform(Rotation(entries), _matrix([X.translation for X in transforms], 3))


def _acted(X: RigidTransform, M: SpatialInertia) -> SpatialInertia:
    return M if is_identity(X) else jax.tree.map(known, act(X, M))


def _inertias(masses: list[list[SpatialInertia]]):
    nothing = SpatialInertia.zero(dtype=np.float64)
    sums = [jax.tree.map(known, functools.reduce(operator.add, parts)) if parts else nothing for parts in masses]
    mass, com, central = [M.mass for M in sums], [M.com for M in sums], [M.central for M in sums]
    return SpatialInertia(_matrix(mass, 1)[:, 0], _matrix(com, 3), _matrix(central, 6))


# -- what the algorithms make of inertias, and a dtype must hold ------------------------------------------------------


def require_in_range(topology: Topology, arrays: dict[str, Any], dtype: np.dtype):
    """Raises BeyondNumbers where masses, moments or weights of the assembled arrays, in float64, overflow in a dtype.

    Of what a joint carries, these are bounds over all angles: the distance of a body from the joint is at most the
    length of the way there, from joint to joint. Displacements of joints are not in it.
    """
    largest, names = float(floats.finfo(dtype).max), [name for name, _ in topology.frames]
    for i, (_, number) in enumerate(topology.welds):
        _require_own(names[number], _sums(arrays["weld_inertias"], i), largest, dtype)
    gravity = math.hypot(*arrays["gravity"].tolist())
    own = [_sums(arrays["inertias"], i) for i in range(len(topology))]
    for name, sums in zip(topology.body_names, own, strict=True):
        _require_own(name, sums, largest, dtype)
    all_of_them = 0.0
    for i in reversed(range(len(topology))):
        mass, first, second = own[i]
        weight = gravity * max(mass, first)
        for what, x in ("moments (kg m2)", second), ("weight (N, N m)", weight):
            if not x <= largest:
                expected = f"{what} of at most {largest:.3g} in {dtype}, with what it carries"
                raise BeyondNumbers(topology.body_names[i], f"inertia: expected {expected}, got {x:.3g}")
        parent, d = topology.parents[i], math.hypot(*arrays["placements"].translation[i].tolist())
        if parent >= 0:
            m, f, s = own[parent]
            own[parent] = m + mass, f + first + d * mass, s + second + 2 * (d * first) + d * mass * d
        else:
            all_of_them += mass
    if not max(1.0, gravity) * all_of_them <= largest:
        heaviest = topology.body_names[int(arrays["inertias"].mass.argmax())]
        expected = f"a mass and a weight of all bodies of at most {largest:.3g} in {dtype}"
        came = f"{all_of_them:.3g} kg and {gravity * all_of_them:.3g} N"
        raise BeyondNumbers(heaviest, f"inertia: expected {expected}, got {came}")


def _sums(M: SpatialInertia, i: int) -> tuple[float, float, float]:
    """(mass, mass times distance, moments) of body i about the origin of its joint."""
    mass, c = float(M.mass[i]), math.hypot(*M.com[i].tolist())
    return mass, mass * c, float(abs(M.central[i]).max()) + mass * c * c


def _require_own(name: str, sums: tuple[float, float, float], largest: float, dtype: np.dtype):
    if not max(map(abs, sums)) <= largest or any(map(math.isnan, sums)):
        mass, _, moments = sums
        expected = f"mass and moments about its origin, with what is welded to it, of at most {largest:.3g} in {dtype}"
        raise BeyondNumbers(name, f"inertia: expected {expected}, got {mass:.3g} kg, {moments:.3g} kg m2")


# -- known poses, exact where frames coincide -------------------------------------------------------------------------


def identity() -> RigidTransform:
    return RigidTransform.identity(dtype=np.float64)


def or_identity(part: Joint | Frame, name: str) -> RigidTransform:
    X = getattr(part, name)
    if X is None:
        return identity()
    _check_single(part, name, RigidTransform)
    return jax.tree.map(known, X)


def _check_single(part: Body | Joint | Frame, name: str, kind: type[RigidTransform | SpatialInertia]):
    x = getattr(part, name)
    if not isinstance(x, kind) or x.batch_shape:
        came = f"a batch of shape {x.batch_shape}" if isinstance(x, kind) else type(x).__name__
        raise TypeError(f"{type(part).__name__} {part.name!r}: {name}: expected a single {kind.__name__}, got {came}")


def is_identity(X: RigidTransform) -> bool:
    return bool(not X.translation.any() and (X.rotation.entries == np.eye(3).ravel()).all())


def composed(X_AB: RigidTransform, X_BC: RigidTransform) -> RigidTransform:
    if is_identity(X_AB) or is_identity(X_BC):
        return X_BC if is_identity(X_AB) else X_AB
    return jax.tree.map(known, X_AB @ X_BC)
