"""What yourdfpy reads, as the parts of a mechanism."""

import io
from typing import Any

import numpy as np
import numpy.typing as npt

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers.folding import in_double
from jaxspatial.mechanism.formats.numbers import rotation_of, with_moments
from jaxspatial.mechanism.formats.source import needed
from jaxspatial.mechanism.formats.urdf.text import LIMITS, Lines
from jaxspatial.mechanism.parts import WORLD, Body, Joint
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

Robot = Any  # of yourdfpy, which declares no types
Part = Any  # a joint or a link of it
_KINDS = {"floating": "free"} | {kind: kind for kind in ("revolute", "continuous", "prismatic", "fixed", "planar")}


def robot_of(lines: Lines) -> Robot:
    etree, yourdfpy = needed("from_urdf", "lxml.etree"), needed("from_urdf", "yourdfpy")
    source = io.BytesIO(etree.tostring(lines.root))
    try:
        return yourdfpy.URDF.load(source, build_scene_graph=False, load_meshes=False).robot
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"from_urdf: the reader yourdfpy says {type(error).__name__}: {error}") from error


def check_joints(robot: Robot, lines: Lines):
    links = {link.name for link in robot.links}
    held: dict[str, Part] = {}
    for joint in robot.joints:
        if joint.type not in _KINDS:
            near = check.did_you_mean(joint.type, _KINDS)
            lines.refuse("joint", joint.name, f"type: expected one of {', '.join(_KINDS)}, got {joint.type!r}{near}")
        for side, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links or (side, name) == ("child", WORLD):
                near = check.did_you_mean(name, links)
                reason = "the world hangs on nothing" if name in links else f"there is no link {name!r}{near}"
                lines.refuse("joint", joint.name, f"{side}: {reason}")
        if joint.child in held:
            other = held[joint.child].name
            lines.refuse("joint", joint.name, f"child: {joint.child!r} hangs on {other!r} already: a loop")
        held[joint.child] = joint
    _check_no_loop(held, lines)


def _check_no_loop(held: dict[str, Part], lines: Lines):
    """Each link on the way from a joint to its root once."""
    safe: set[str] = set()
    for link in held:
        way: list[str] = []
        while link in held and link not in safe:
            if link in way:
                joint = held[link].name
                lines.refuse(
                    "joint", joint, f"child: {', '.join(map(repr, way[way.index(link) :]))} hold each other: a loop"
                )
            way.append(link)
            link = held[link].parent
        safe.update(way)


def check_mimics(robot: Robot, lines: Lines):
    """Of one coordinate each. What is fixed has none: like its axis and limits, what it would follow says nothing."""
    names = {joint.name for joint in robot.joints}
    own = {joint.name for joint in robot.joints if joint.mimic is None and _is_scalar(joint)}
    for joint in robot.joints:
        if joint.mimic is not None and joint.mimic.joint not in names:
            near = check.did_you_mean(joint.mimic.joint, names)
            lines.refuse("joint", joint.name, f"mimic: there is no joint {joint.mimic.joint!r}{near}")
        if joint.mimic is not None and joint.type != "fixed" and not (_is_scalar(joint) and joint.mimic.joint in own):
            reason = f"expected two joints of one coordinate, the second its own, got {joint.mimic.joint!r}"
            lines.refuse("joint", joint.name, f"mimic: {reason}")


def _is_scalar(joint: Part):
    return _KINDS[joint.type] in ("revolute", "continuous", "prismatic")


def root_of(robot: Robot, lines: Lines) -> str:
    roots = [link.name for link in robot.links if link.name not in {joint.child for joint in robot.joints}]
    if len(roots) != 1:
        reason = f"expected one link that is no joint's child, got {', '.join(map(repr, roots)) or 'no link at all'}"
        lines.refuse_element(lines.root, reason)
    return roots[0]


def body(link: Part, lines: Lines):
    if link.inertial is None:
        return Body(link.name)
    return Body(link.name, with_moments(link.inertial.mass, _pose(link.inertial.origin), link.inertial.inertia))


def joint(joint: Part, lines: Lines):
    kind = _KINDS[joint.type]
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, float)
    if kind == "planar" and not (axis[2] > 0 and not axis[:2].any()):
        lines.refuse("joint", joint.name, f"axis: a planar joint is normal to z here, got {axis.tolist()}")
    if kind not in ("revolute", "continuous", "prismatic"):
        axis = np.array([0.0, 0.0, 1.0])
    if not axis.any():
        lines.refuse("joint", joint.name, "axis: expected three numbers, not all zero")
    numbers: dict[str, Any] = {**_limits(joint, kind, lines), **_dynamics(joint), "mimic": _mimic(joint)}
    return Joint(joint.name, kind, joint.parent, joint.child, _pose(joint.origin), axis=axis, **numbers)


def _limits(joint: Part, kind: str, lines: Lines) -> dict[str, float]:
    if kind == "revolute" and joint.limit is None:
        lines.refuse("joint", joint.name, "limit: a revolute joint needs one; without, it is continuous")
    if joint.limit is None:
        return {}
    names = {"effort": "effort_limit", "velocity": "velocity_limit"}
    names |= {name: name for name in LIMITS} if kind in ("revolute", "prismatic") else {}
    given = {new: getattr(joint.limit, old) for old, new in names.items()}
    limits = {name: float(x) for name, x in given.items() if x is not None}
    lower, upper = limits.get("lower", -np.inf), limits.get("upper", np.inf)
    if not (lower <= upper and lower < np.inf and upper > -np.inf):
        lines.refuse("joint", joint.name, "limit: expected lower <= upper")
    return limits


def _dynamics(joint: Part) -> dict[str, float]:
    if joint.dynamics is None:
        return {}
    return {"damping": float(joint.dynamics.damping or 0), "friction_loss": float(joint.dynamics.friction or 0)}


def _mimic(joint: Part):
    if joint.mimic is None or joint.type == "fixed":
        return None
    multiplier = 1.0 if joint.mimic.multiplier is None else float(joint.mimic.multiplier)
    return joint.mimic.joint, multiplier, float(joint.mimic.offset or 0.0)


def _pose(matrix: npt.ArrayLike | None):
    """A RigidTransform of a homogeneous matrix; the identity of None."""
    matrix = np.eye(4) if matrix is None else np.asarray(matrix, float)
    with in_double():
        return RigidTransform(Rotation(rotation_of(matrix[:3, :3]).ravel()), matrix[:3, 3])
