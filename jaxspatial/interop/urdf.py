"""Mechanisms from the Unified Robot Description Format (wiki.ros.org/urdf/XML).

The package yourdfpy reads the files. Links and joints become bodies and joints of the same name; what serves pictures,
contact or control (visual, collision, transmission, gazebo, calibration, safety_controller ...) is no part of a
mechanism. Everything else in a robot, a joint or an inertia that has no counterpart is refused, with its line.
"""

import importlib
import io
import pathlib
from typing import NoReturn

import jax
import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism import Body, Joint, Mechanism
from jaxspatial.mechanism.mechanism import READERS
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

_KINDS = {"floating": "free"} | {kind: kind for kind in ("revolute", "continuous", "prismatic", "fixed", "planar")}
_ROOT = "root_joint"
# What a robot may have besides links and joints, and the parts of joints and inertias, with their numbers.
_IGNORED = {"material", "transmission", "gazebo", "ros2_control", "sensor", "frame", "mujoco"}
_JOINT = {"origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"}
_INERTIAL = {"origin", "mass", "inertia"}
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "dynamics": dict.fromkeys(("damping", "friction"), 1),
    "mimic": dict.fromkeys(("multiplier", "offset"), 1),
}
_REQUIRED = {"mass": ("value",), "inertia": ("ixx", "iyy", "izz")}
# Entries of a rotation so near to 0 or 1 are what rounding made of quarter turns.
_ROUNDING = 8 * np.finfo(float).eps


def read(path_or_text, floating_base=False, gravity=(0.0, 0.0, -9.81), dtype=None):
    """The Mechanism of a file, or of its text. The root link is welded to the world, or held by a "free" joint named
    "root_joint"; a root link named "world" is the world.

    Raises ValueError, with line and reason, for what is malformed or cannot be represented; ImportError without
    yourdfpy (`pip install jaxspatial[models]`); FileNotFoundError.
    """
    source, _ = file_source("from_urdf", path_or_text)
    lines = _Lines(source)
    _check_text(lines)
    robot = _parsed(source)
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
    return Mechanism.build(bodies, joints, gravity=gravity, dtype=dtype)


READERS["urdf"] = read


class _Lines:
    """Where in the source an element is, for messages."""

    def __init__(self, source):
        etree = needed("from_urdf", "lxml.etree")
        try:
            self.root = etree.parse(io.BytesIO(source)).getroot()
        except etree.XMLSyntaxError as error:
            raise ValueError(f"from_urdf: malformed XML: {error}") from None
        if self.root.tag != "robot":
            raise ValueError(f"from_urdf: line {self.root.sourceline}: expected <robot>, got <{self.root.tag}>")

    def refuse(self, tag, name, reason) -> NoReturn:
        found = [e for e in self.root.findall(tag) if e.get("name") == name]
        line = f"line {found[0].sourceline}: " if found else ""
        raise ValueError(f'from_urdf: {line}<{tag} name="{name}">: {reason}')

    def refuse_element(self, element, reason) -> NoReturn:
        raise ValueError(f"from_urdf: line {element.sourceline}: <{element.tag}>: {reason}")


def _check_text(lines):
    """What yourdfpy would pass over, or say without the line."""
    if lines.root.get("name") is None:
        lines.refuse_element(lines.root, "name: expected one")
    names = set()
    for e in lines.root.iterchildren("*"):
        if e.tag not in ("link", "joint"):
            _check_known(lines, e, e.tag, _IGNORED)
            continue
        if not e.get("name") or (e.tag, e.get("name")) in names:
            lines.refuse_element(e, "name: " + (f"{e.get('name')!r} comes twice" if e.get("name") else "expected one"))
        names.add((e.tag, e.get("name")))
        for part in e.iterchildren("*") if e.tag == "joint" else e.iterfind("inertial/*"):
            _check_known(lines, part, part.tag, _JOINT if e.tag == "joint" else _INERTIAL)
            _check_numbers(lines, part)
        for side in ("parent", "child") if e.tag == "joint" else ():
            if e.find(side) is None or not e.find(side).get("link"):
                lines.refuse("joint", e.get("name"), f"{side}: expected a link")


def _check_known(lines, element, tag, known):
    if tag not in known:
        lines.refuse_element(element, "there is no counterpart here")


def _check_numbers(lines, element):
    for name, n in _NUMBERS.get(element.tag, {}).items():
        text = element.get(name)
        if text is not None and not _are_numbers(text, n):
            lines.refuse_element(element, f"{name}: expected {n} number{'s' * (n > 1)}, got {text!r}")
    for name in _REQUIRED.get(element.tag, ()):
        if element.get(name) is None:
            lines.refuse_element(element, f"{name}: expected a number")


def _are_numbers(text, n):
    try:
        return len(numbers := [float(x) for x in text.split()]) == n and not np.isnan(numbers).any()
    except ValueError:
        return False


def _parsed(source):
    yourdfpy = needed("from_urdf", "yourdfpy")
    try:
        return yourdfpy.URDF.load(io.BytesIO(source), build_scene_graph=False, load_meshes=False).robot
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
            lines.refuse("joint", joint.name, f"child: {joint.child!r} hangs on {held[joint.child]!r} already: a loop")
        held[joint.child] = joint.name


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
        reason = f"expected one link that is no joint's child, got {', '.join(map(repr, roots)) or 'none: a loop'}"
        lines.refuse_element(lines.root, reason)
    return roots[0]


def _body(link, lines: _Lines):
    if link.inertial is None:
        return Body(link.name)
    mass, six = link.inertial.mass, link.inertial.inertia
    if mass is None or six is None:
        lines.refuse("link", link.name, "inertial: expected mass and inertia")
    X = _pose(link.inertial.origin)
    if not (np.isfinite(mass) and mass >= 0 and np.isfinite(np.asarray(six, float)).all()):
        lines.refuse("link", link.name, f"inertial: expected a mass >= 0 and finite numbers, got mass {mass}")
    return Body(link.name, with_moments(mass, X, six))


def _joint(joint, lines):
    kind = _KINDS[joint.type]
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, float)
    if kind == "planar" and not (axis[2] > 0 and not axis[:2].any()):
        lines.refuse("joint", joint.name, f"axis: a planar joint is normal to z here, got {axis.tolist()}")
    if kind in ("revolute", "continuous", "prismatic") and not axis.any():
        lines.refuse("joint", joint.name, "axis: expected three numbers, not all zero")
    numbers = {**_limits(joint, kind, lines), **_dynamics(joint), "mimic": _mimic(joint)}
    return Joint(joint.name, kind, joint.parent, joint.child, _pose(joint.origin), axis=axis, **numbers)


def _limits(joint, kind, lines):
    if kind == "revolute" and joint.limit is None:
        lines.refuse("joint", joint.name, "limit: a revolute joint needs one; without, it is continuous")
    if joint.limit is None:
        return {}
    names = {"effort": "effort_limit", "velocity": "velocity_limit"}
    names |= {"lower": "lower", "upper": "upper"} if kind in ("revolute", "prismatic") else {}
    given = {new: getattr(joint.limit, old) for old, new in names.items()}
    limits = {name: float(x) for name, x in given.items() if x is not None}
    if limits.get("lower", -np.inf) > limits.get("upper", np.inf):
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
    return in_double(lambda m, p: RigidTransform(Rotation(m.ravel()), p), rotation_of(matrix[:3, :3]), matrix[:3, 3])


# -- for readers of other formats too ---------------------------------------------------------------------------------


def file_source(operation, path_or_text):
    """(the bytes of a file, its path), or (those of a text, None): text is told by its first sign."""
    if isinstance(path_or_text, str) and path_or_text.lstrip().startswith("<"):
        return path_or_text.encode(), None
    if not isinstance(path_or_text, (str, pathlib.Path)):
        raise TypeError(f"{operation}: path_or_text: expected a path or text, got {type(path_or_text).__name__}")
    return pathlib.Path(path_or_text).read_bytes(), pathlib.Path(path_or_text)


def needed(operation, module):
    """A module of an optional package."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        raise ImportError(f"{operation}: needs the package {package}: pip install jaxspatial[models]") from error


def in_double(make, *arrays):
    with jax.enable_x64(True):
        return make(*arrays)


def rotation_of(entries):
    """(3, 3) of the entries of a rotation, in float64, without the rounding of quarter turns."""
    entries = np.asarray(entries, np.float64).reshape(3, 3)
    nearest = np.round(entries)
    return np.where(abs(entries - nearest) <= _ROUNDING, nearest, entries)


def with_moments(mass, X_BI, moments):
    """M_BBo_B of a body with its centre of mass at I, and the (3, 3) moments about it in the axes of I."""
    R = X_BI.rotation.entries.reshape(3, 3)
    return in_double(SpatialInertia, np.float64(mass), X_BI.translation, R @ np.asarray(moments, float) @ R.T)
