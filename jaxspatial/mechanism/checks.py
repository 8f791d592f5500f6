"""What `Mechanism.build` refuses of the names of parts."""

from collections.abc import Container, Iterable, Sequence
from typing import Any

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.parts import WORLD, Body, Frame, Joint
from jaxspatial.mechanism.poses import check_single


def check_names(bodies: Sequence[Any], joints: Sequence[Any], frames: Sequence[Any]):
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
    for joint in joints:
        for side, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in {body.name for body in bodies} and (name, side) != (WORLD, "parent"):
                raise ValueError(f"Joint {joint.name!r}: {side}: there is no body {name!r}")


def _check_unique(what: str, names: Iterable[str]):
    seen = set()
    for name in names:
        if name in seen:
            raise ValueError(f"Mechanism.build: {what}: {name!r} comes twice")
        seen.add(name)


def check_reached(bodies: Iterable[Body], places: Container[str]):
    lost = [body.name for body in bodies if body.name not in places]
    if lost:
        raise ValueError(f"Mechanism.build: joints: nothing holds {', '.join(map(repr, lost))} against the world")
