"""Mechanisms from the Unified Robot Description Format (wiki.ros.org/urdf/XML).

The package yourdfpy reads the files, lxml checks them. Links and joints become bodies and joints of the same name. What
serves pictures, contact or control (visual, collision, transmission, gazebo, calibration, safety_controller ...) is no
part of a mechanism: one `ModelFileWarning` lists it. Everything else is refused, with its line: elements and attributes
that are not known (a misspelt one would change the robot), what comes twice, numbers that are not finite or that the
dtype does not have, joints and inertias that have no counterpart.

Inertias that no rigid body has (a third moment larger than the other two together: a dozen of the robots that are
passed around have such) are taken as they are; the warning lists their links.
"""

import functools
import io
from typing import Any, NoReturn

import numpy as np

from jaxspatial.arithmetic.known import in_double
from jaxspatial.interop.files import (
    Notes,
    built,
    file_source,
    needed,
    numbers_of,
    parsed,
    range_of,
    rotation_of,
    with_moments,
)
from jaxspatial.mechanism import Body, Joint
from jaxspatial.mechanism.mechanism import READERS
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

_KINDS = {"floating": "free"} | {kind: kind for kind in ("revolute", "continuous", "prismatic", "fixed", "planar")}
_ROOT = "root_joint"
# What each element consists of, and what it may have besides, which is listed.
_PARTS = {
    "robot": {"link", "joint"},
    "link": {"inertial"},
    "inertial": {"origin", "mass", "inertia"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"},
}
_MANY = {"link", "joint"}
_BESIDES_ALL = {"material", "transmission", "gazebo", "ros2_control", "sensor", "visual", "collision"}
_BESIDES = {
    "robot": {"frame", "mujoco"},
    "link": {"contact", "surface", "self_filter", "collision_checking", "kinematic", "gravity", "origin"},
    "joint": {"calibration", "safety_controller"},
}
# What joints of a kind have no use for.
_USELESS = {
    "fixed": {"axis", "limit", "dynamics", "mimic"},
    "floating": {"axis"},
}
_LIMITS = "lower", "upper"
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": dict.fromkeys(("damping", "friction"), 1),
    "mimic": dict.fromkeys(("multiplier", "offset"), 1),
}
_ATTRIBUTES = {
    "robot": {"name", "version"},
    "link": {"name"},
    "joint": {"name", "type"},
    "parent": {"link"},
    "child": {"link"},
    "mimic": {"joint", "multiplier", "offset"},
}
_ATTRIBUTES_BESIDES = {
    "link": {"type", "drake_ignore"},
    "joint": {"dont_collapse"},
    "limit": {"current", "command_effort", "gear_velocity"},
    "dynamics": {"D", "K", "mu_coulomb", "mu_viscous"},
}
_REQUIRED = {"mass": ("value",), "inertia": ("ixx", "iyy", "izz")}
_NOT_NEGATIVE = {"dynamics": ("damping", "friction"), "limit": ("effort", "velocity"), "mass": ("value",)}
_UNLIMITED = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf}
# By how much of their sum the digits of a file may make the largest moment larger than the other two together.
_DIGITS = 1e-4


def read(path_or_text, floating_base=False, gravity=(0.0, 0.0, -9.81), dtype=None):
    """The Mechanism of a file, or of its text. The root link is welded to the world, or held by a "free" joint named
    "root_joint"; a root link named "world" is the world.

    Warns with `ModelFileWarning` of what was left out. Raises ValueError, with line and reason, for what is malformed
    or cannot be represented; ImportError without yourdfpy (`pip install jaxspatial[models]`); FileNotFoundError.
    """
    source, path = file_source("from_urdf", path_or_text)
    lines = _Lines(source, path is None, dtype)
    _check(lines, lines.root)
    robot = _read(lines)
    _check_joints(robot, lines)
    _check_mimics(robot, lines)
    root = _root(robot, lines)
    bodies = [_body(link, lines) for link in robot.links if link.name != WORLD]
    joints = [_joint(joint, lines) for joint in robot.joints]
    if root != WORLD and floating_base and any(joint.name == _ROOT for joint in robot.joints):
        lines.refuse("joint", _ROOT, "name: that of the joint which holds a floating base")
    if root != WORLD:
        # Without a name, which no joint of a file can have.
        name, kind = (_ROOT, "free") if floating_base else ("", "fixed")
        joints.insert(0, Joint(name, kind, WORLD, root))
    elif floating_base:
        raise ValueError('from_urdf: floating_base: the root link is "world", which cannot float')
    mechanism = built(functools.partial(lines.refuse, "link"), bodies, joints, (), gravity, dtype)
    lines.notes.tell()
    return mechanism


READERS["urdf"] = read


class _Lines:
    """Where in the source an element is, for messages, and what is told of it at the end."""

    def __init__(self, source, is_text, dtype):
        self.root, self.notes = parsed("from_urdf", source, is_text), Notes("from_urdf")
        self.smallest, self.largest = range_of(dtype)
        if self.root.tag != "robot":
            raise ValueError(f"from_urdf: line {self.root.sourceline}: expected <robot>, got <{self.root.tag}>")

    def element(self, tag, name) -> Any:
        return next((e for e in self.root.iterchildren(tag) if e.get("name") == name), None)

    def refuse(self, tag, name, reason) -> NoReturn:
        found = self.element(tag, name)
        line = "" if found is None else f"line {found.sourceline}: "
        raise ValueError(f'from_urdf: {line}<{tag} name="{name}">: {reason}')

    def refuse_element(self, element, reason) -> NoReturn:
        raise ValueError(f"from_urdf: line {element.sourceline}: <{element.tag}>: {reason}")

    def leave_out(self, kind, element):
        """By its own name or that of what it is in; by its line where there is none."""
        named = next((e.get("name") for e in (element, *element.iterancestors("link", "joint")) if e.get("name")), None)
        self.notes.leave_out(kind, named or f"line {element.sourceline}")


# -- the text ---------------------------------------------------------------------------------------------------------


def _check(lines, element):
    """An element and all that is in it: what yourdfpy would pass over, or say without the line. What is left out is
    taken out."""
    _check_name(lines, element)
    _check_attributes(lines, element)
    _check_numbers(lines, element)
    _check_no_text(lines, element)
    _check_parts(lines, element)
    for part in element.iterchildren("*"):
        _check(lines, part)
    if element.tag == "inertial":
        _check_inertial(lines, element)
    if element.tag == "joint":
        _check_joint(lines, element)


def _check_name(lines, element):
    if element.tag in ("robot", "link", "joint") and not element.get("name"):
        lines.refuse_element(element, "name: expected one")


def _check_attributes(lines, element):
    known = _ATTRIBUTES.get(element.tag, set()) | set(_NUMBERS.get(element.tag, ()))
    for name in element.attrib:
        if name in _ATTRIBUTES_BESIDES.get(element.tag, ()):
            lines.leave_out(f"{name} of <{element.tag}>", element)
        elif name not in known:
            expected = f"expected one of {', '.join(sorted(known))}" if known else "expected none"
            lines.refuse_element(element, f"{name}: there is no such attribute, {expected}")


def _check_no_text(lines, element):
    texts = [element.text, *(part.tail for part in element)]
    if stray := " ".join(text.strip() for text in texts if text).strip():
        lines.refuse_element(element, f"expected no text, got {stray[:40]!r}")


def _check_parts(lines, element):
    own = _PARTS.get(element.tag, set())
    besides = _BESIDES.get(element.tag, set()) | _BESIDES_ALL if own else set()
    seen = set()
    for part in list(element.iterchildren("*")):
        if part.tag in besides:
            lines.leave_out(f"<{part.tag}>", part)
            element.remove(part)
        elif part.tag not in own:
            lines.refuse_element(part, _no_counterpart(part, element, own))
        else:
            _check_once(lines, part, seen)


def _no_counterpart(part, element, own):
    if "xacro" in part.tag:
        return "this is a text for the tool xacro, that makes a URDF of it: run it first"
    expected = f"expected one of {', '.join(sorted(own))}" if own else "expected nothing"
    return f"there is no counterpart here for this part of a {element.tag}, {expected}"


def _check_once(lines, part, seen):
    key = (part.tag, part.get("name")) if part.tag in _MANY else part.tag
    if key in seen:
        what = f"name: {part.get('name')!r}" if part.tag in _MANY else f"<{part.tag}>"
        lines.refuse_element(part, f"{what} comes twice")
    seen.add(key)


def _check_numbers(lines: _Lines, element):
    for name, n in _NUMBERS.get(element.tag, {}).items():
        if element.get(name) is not None:
            _check_number(lines, element, name, n)
    for name in _REQUIRED.get(element.tag, ()):
        if element.get(name) is None:
            lines.refuse_element(element, f"{name}: expected a number")


def _check_number(lines: _Lines, element, name, n):
    text, is_limit = element.get(name), element.tag == "limit"
    found = numbers_of(text)
    if is_limit and text.strip() in _UNLIMITED:
        found = [_UNLIMITED[text.strip()]]
    elif found is None or len(found) != n:
        lines.refuse_element(element, f"{name}: expected {n} number{'s' * (n > 1)}, got {text!r}")
    elif not all(abs(x) <= (np.finfo(float).max if is_limit else lines.largest) for x in found):
        lines.refuse_element(element, f"{name}: expected at most {lines.largest:.3g} in this dtype, got {text!r}")
    if name in _NOT_NEGATIVE.get(element.tag, ()) and found[0] < 0:
        lines.refuse_element(element, f"{name}: expected a number >= 0, got {text!r}")


def _check_inertial(lines: _Lines, element: Any):
    link, mass, moments = element.getparent().get("name"), element.find("mass"), element.find("inertia")
    if mass is None or moments is None:
        lines.refuse("link", link, "inertial: expected mass and inertia")
    if 0 < float(mass.get("value")) < lines.smallest:
        lines.refuse_element(
            mass, f"value: expected at least {lines.smallest:.3g} in this dtype, got {mass.get('value')!r}"
        )
    if _is_impossible([float(moments.get(name, 0)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]):
        lines.notes.doubt("inertia that no rigid body has", f"{link} in line {moments.sourceline}")


def _is_impossible(six):
    """Whether one of the principal moments is larger than the other two together."""
    xx, xy, xz, yy, yz, zz = np.array(six) / (max(map(abs, six)) or 1.0)
    principal = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    return principal[2] - principal[1] - principal[0] > _DIGITS * abs(principal).sum()


def _check_joint(lines, element: Any):
    for side in ("parent", "child"):
        if element.find(side) is None or not element.find(side).get("link"):
            lines.refuse("joint", element.get("name"), f"{side}: expected a link")
    kind, is_mimic = element.get("type"), element.find("mimic") is not None
    for part in element.iterchildren(*_USELESS.get(kind, ("none",))):
        lines.leave_out(f"<{part.tag}> of a {kind} joint", part)
    limit = element.find("limit")
    if limit is not None and is_mimic and kind != "fixed":
        lines.leave_out("<limit> of a mimic", limit)
    elif limit is not None and kind in ("continuous", "floating", "planar") and any(map(limit.get, _LIMITS)):
        lines.leave_out(f"lower and upper limit of a {kind} joint", limit)


# -- the robot --------------------------------------------------------------------------------------------------------


def _read(lines):
    etree, yourdfpy = needed("from_urdf", "lxml.etree"), needed("from_urdf", "yourdfpy")
    source = io.BytesIO(etree.tostring(lines.root))
    try:
        return yourdfpy.URDF.load(source, build_scene_graph=False, load_meshes=False).robot
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"from_urdf: the reader yourdfpy says {type(error).__name__}: {error}") from error


def _check_joints(robot, lines):
    links = {link.name for link in robot.links}
    held = {}
    for joint in robot.joints:
        if joint.type not in _KINDS:
            lines.refuse("joint", joint.name, f"type: expected one of {', '.join(_KINDS)}, got {joint.type!r}")
        for side, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links or (side, name) == ("child", WORLD):
                reason = "the world hangs on nothing" if name in links else f"there is no link {name!r}"
                lines.refuse("joint", joint.name, f"{side}: {reason}")
        if joint.child in held:
            other = held[joint.child].name
            lines.refuse("joint", joint.name, f"child: {joint.child!r} hangs on {other!r} already: a loop")
        held[joint.child] = joint
    _check_no_loop(held, lines)


def _check_no_loop(held, lines):
    """Each link on the way from a joint to its root once."""
    safe = set()
    for link in held:
        way = []
        while link in held and link not in safe:
            if link in way:
                joint = held[link].name
                lines.refuse(
                    "joint", joint, f"child: {', '.join(map(repr, way[way.index(link) :]))} hold each other: a loop"
                )
            way.append(link)
            link = held[link].parent
        safe.update(way)


def _check_mimics(robot, lines):
    """Of one coordinate each. What is fixed has none: like its axis and limits, what it would follow says nothing."""
    names = {joint.name for joint in robot.joints}
    own = {joint.name for joint in robot.joints if joint.mimic is None and _is_scalar(joint)}
    for joint in robot.joints:
        if joint.mimic is not None and joint.mimic.joint not in names:
            lines.refuse("joint", joint.name, f"mimic: there is no joint {joint.mimic.joint!r}")
        if joint.mimic is not None and joint.type != "fixed" and not (_is_scalar(joint) and joint.mimic.joint in own):
            reason = f"expected two joints of one coordinate, the second its own, got {joint.mimic.joint!r}"
            lines.refuse("joint", joint.name, f"mimic: {reason}")


def _is_scalar(joint):
    return _KINDS[joint.type] in ("revolute", "continuous", "prismatic")


def _root(robot, lines):
    roots = [link.name for link in robot.links if link.name not in {joint.child for joint in robot.joints}]
    if len(roots) != 1:
        reason = f"expected one link that is no joint's child, got {', '.join(map(repr, roots)) or 'no link at all'}"
        lines.refuse_element(lines.root, reason)
    return roots[0]


def _body(link, lines):
    if link.inertial is None:
        return Body(link.name)
    return Body(link.name, with_moments(link.inertial.mass, _pose(link.inertial.origin), link.inertial.inertia))


def _joint(joint, lines):
    kind = _KINDS[joint.type]
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, float)
    if kind == "planar" and not (axis[2] > 0 and not axis[:2].any()):
        lines.refuse("joint", joint.name, f"axis: a planar joint is normal to z here, got {axis.tolist()}")
    if kind not in ("revolute", "continuous", "prismatic"):
        axis = np.array([0.0, 0.0, 1.0])
    if not axis.any():
        lines.refuse("joint", joint.name, "axis: expected three numbers, not all zero")
    numbers = {**_limits(joint, kind, lines), **_dynamics(joint), "mimic": _mimic(joint)}
    return Joint(joint.name, kind, joint.parent, joint.child, _pose(joint.origin), axis=axis, **numbers)


def _limits(joint, kind, lines):
    if kind == "revolute" and joint.limit is None:
        lines.refuse("joint", joint.name, "limit: a revolute joint needs one; without, it is continuous")
    if joint.limit is None:
        return {}
    names = {"effort": "effort_limit", "velocity": "velocity_limit"}
    names |= {name: name for name in _LIMITS} if kind in ("revolute", "prismatic") else {}
    given = {new: getattr(joint.limit, old) for old, new in names.items()}
    limits = {name: float(x) for name, x in given.items() if x is not None}
    lower, upper = limits.get("lower", -np.inf), limits.get("upper", np.inf)
    if not (lower <= upper and lower < np.inf and upper > -np.inf):
        lines.refuse("joint", joint.name, "limit: expected lower <= upper")
    return limits


def _dynamics(joint):
    if joint.dynamics is None:
        return {}
    return {"damping": float(joint.dynamics.damping or 0), "friction_loss": float(joint.dynamics.friction or 0)}


def _mimic(joint):
    if joint.mimic is None or joint.type == "fixed":
        return None
    multiplier = 1.0 if joint.mimic.multiplier is None else float(joint.mimic.multiplier)
    return joint.mimic.joint, multiplier, float(joint.mimic.offset or 0.0)


def _pose(matrix):
    """A RigidTransform of a homogeneous matrix; the identity of None."""
    matrix = np.eye(4) if matrix is None else np.asarray(matrix, float)
    with in_double():
        return RigidTransform(Rotation(rotation_of(matrix[:3, :3]).ravel()), matrix[:3, 3])
