"""The kinds of joints. Each is a subclass of `JointKind`, and so is a kind that is added from elsewhere:

from jaxspatial.mechanism.joints import JointKind, register

@register
class Sliding(JointKind):
    name, nq, nv, parameters = "sliding", 1, 1, (...)
    ...

js.Joint("j", "sliding", "world", "body", parameters={...})
"""

from jaxspatial.numerics import check
from jaxspatial.mechanism.joints.axes import Continuous as Continuous
from jaxspatial.mechanism.joints.axes import Cylindrical as Cylindrical
from jaxspatial.mechanism.joints.axes import Fixed as Fixed
from jaxspatial.mechanism.joints.axes import Helical as Helical
from jaxspatial.mechanism.joints.axes import Prismatic as Prismatic
from jaxspatial.mechanism.joints.axes import Revolute as Revolute
from jaxspatial.mechanism.joints.axes import Universal as Universal
from jaxspatial.mechanism.joints.ball import Ball as Ball
from jaxspatial.mechanism.joints.ball import Free as Free
from jaxspatial.mechanism.joints.kind import AXIS as AXIS
from jaxspatial.mechanism.joints.kind import OF_EVERY_JOINT as OF_EVERY_JOINT
from jaxspatial.mechanism.joints.kind import PITCH as PITCH
from jaxspatial.mechanism.joints.kind import SECOND_AXIS as SECOND_AXIS
from jaxspatial.mechanism.joints.kind import CosSin as CosSin
from jaxspatial.mechanism.joints.kind import JointKind as JointKind
from jaxspatial.mechanism.joints.kind import Parameter as Parameter
from jaxspatial.mechanism.joints.planar import Planar as Planar

BUILT_IN = Fixed, Revolute, Continuous, Prismatic, Helical, Cylindrical, Universal, Planar, Ball, Free
# {name: kind} of all kinds, registered ones too.
KINDS: dict[str, type[JointKind]] = {kind.name: kind for kind in BUILT_IN}


def kind_named(name: str) -> type[JointKind]:
    """Returns the kind of a name. Raises KeyError that lists the kinds there are."""
    if name not in KINDS:
        near, known = check.did_you_mean(name, KINDS), ", ".join(map(repr, KINDS))
        raise KeyError(f"kind: expected one of {known}, got {name!r}; `register` adds others{near}")
    return KINDS[name]


def register(kind: type[JointKind]) -> type[JointKind]:
    """Class decorator: registers a kind of joint by its name, for `Joint(..., kind=name)`.

    Args:
        kind: a subclass of `JointKind`.

    Returns:
        The kind.

    Raises:
        TypeError: it is no subclass of `JointKind`.
        ValueError: another kind has the name, by which programs are cached; `neutral` has not nq coordinates; S depends
            on q and has no rate; a parameter has the name of a different one of another kind, or of an attribute of
            `JointKind`.

    Example:
        >>> from jaxspatial.mechanism.joints import Revolute, register
        >>> register(Revolute).name  # a kind of your own instead; that there is it already changes nothing
        'revolute'
    """
    if not (isinstance(kind, type) and issubclass(kind, JointKind)):
        raise TypeError(f"register: expected a subclass of JointKind, got {kind!r}")
    if KINDS.get(kind.name, kind) is not kind:
        raise ValueError(f"register: name: there is another kind {kind.name!r}")
    if kind.subspace_needs_q and kind.motion_subspace_rate is JointKind.motion_subspace_rate:
        raise ValueError(f"register: {kind.name}: motion_subspace_rate: expected the rates of an S that depends on q")
    if len(kind.neutral) != kind.nq:
        raise ValueError(f"register: {kind.name}: neutral: expected {kind.nq} coordinates, got {len(kind.neutral)}")
    known = {p.name: p for other in KINDS.values() for p in other.parameters} | {p.name: p for p in OF_EVERY_JOINT}
    for p in kind.parameters:
        if p.name in (*dir(JointKind), "zero"):
            raise ValueError(f"register: {kind.name}: parameters: {p.name!r} is something else in the form")
        if known.get(p.name, p) != p:
            raise ValueError(f"register: {kind.name}: parameters: there is another {p.name!r}: {known[p.name]}")
    KINDS[kind.name] = kind
    return kind
