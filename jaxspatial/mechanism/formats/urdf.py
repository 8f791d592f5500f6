"""Mechanisms from the Unified Robot Description Format (wiki.ros.org/urdf/XML).

Links and joints become bodies and joints of the same name. What serves pictures, contact or control (visual, collision,
transmission, gazebo, calibration, safety_controller ...) is no part of a mechanism: one `ModelFileWarning` lists it.
Everything else is refused, with its line: unknown elements and attributes (a misspelt one would change the robot), what
comes twice, numbers that are not finite or beyond the dtype, joints and inertias that a mechanism cannot represent.

Inertias that no rigid body has (a third moment larger than the other two together: a dozen of the robots in circulation
have such) are taken as they are. The warning lists their links, with the rule that is broken and by how much, unless
the link is welded to others with which it makes a possible body.
"""

import pathlib
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, NamedTuple, NoReturn

import numpy as np

from jaxspatial.mechanism.formats.source import Element, Made, ModelText, built, numbers_of, rotation_of, with_moments
from jaxspatial.mechanism.parts import WORLD, Body, Joint
from jaxspatial.numerics import check
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.numerics.types import ArrayLike, DTypeLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

_ROOT = "root_joint"
_SCALAR = "revolute", "continuous", "prismatic"
# {type of a joint: kind of ours}
_KINDS = {"floating": "free"} | {kind: kind for kind in (*_SCALAR, "fixed", "planar")}
# What joints of a type have no use for.
_USELESS = {"fixed": {"axis", "limit", "dynamics", "mimic"}, "floating": {"axis"}}


class _Schema(NamedTuple):
    """What an element may have, and what of it is left out and listed."""

    attributes: Set[str] = frozenset()
    numbers: Mapping[str, int] = {}  # attributes that are so many numbers each
    required: Sequence[str] = ()  # of these
    not_negative: Sequence[str] = ()
    parts: Set[str] = frozenset()
    left_out: Set[str] = frozenset()  # parts
    left_out_attributes: Set[str] = frozenset()


_LEFT_OUT = {"material", "transmission", "gazebo", "ros2_control", "sensor", "visual", "collision"}
_OF_LINKS = {"contact", "surface", "self_filter", "collision_checking", "kinematic", "gravity", "origin"}
_MOMENTS: dict[str, int] = dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1)
_SCHEMAS = {
    "robot": _Schema({"name", "version"}, parts={"link", "joint"}, left_out=_LEFT_OUT | {"frame", "mujoco"}),
    "link": _Schema(
        {"name"}, parts={"inertial"}, left_out=_LEFT_OUT | _OF_LINKS, left_out_attributes={"type", "drake_ignore"}
    ),
    "inertial": _Schema(parts={"origin", "mass", "inertia"}, left_out=_LEFT_OUT),
    "mass": _Schema(numbers={"value": 1}, required=["value"], not_negative=["value"]),
    "inertia": _Schema(numbers=_MOMENTS, required=[*_MOMENTS]),
    "joint": _Schema(
        {"name", "type"},
        parts={"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"},
        left_out=_LEFT_OUT | {"calibration", "safety_controller"},
        left_out_attributes={"dont_collapse"},
    ),
    "parent": _Schema({"link"}),
    "child": _Schema({"link"}),
    "origin": _Schema(numbers={"xyz": 3, "rpy": 3}),
    "axis": _Schema(numbers={"xyz": 3}, required=["xyz"]),
    "limit": _Schema(
        numbers={"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
        not_negative=["effort", "velocity"],
        left_out_attributes={"current", "command_effort", "gear_velocity"},
    ),
    "dynamics": _Schema(
        numbers={"damping": 1, "friction": 1},
        not_negative=["damping", "friction"],
        left_out_attributes={"D", "K", "mu_coulomb", "mu_viscous"},
    ),
    "mimic": _Schema({"joint"}, numbers={"multiplier": 1, "offset": 1}),
}
_UNLIMITED = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf}
# By how much of their sum the digits of a file may make the largest moment larger than the other two together.
_DIGITS = 1e-4


def read(
    build: Callable[..., Made],
    path_or_text: str | pathlib.Path,
    floating_base: bool = False,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    dtype: DTypeLike | None = None,
) -> Made:
    """Reads a URDF for `Mechanism.from_urdf`: the same arguments and errors, and `Mechanism.build`.

    The root link is welded to the world, or held by a "free" joint named "root_joint"; a root link named "world" is
    the world.
    """
    file = _File(path_or_text, dtype)
    file.check(file.root)
    links, joints = file.root.findall("link"), file.root.findall("joint")
    _check_tree(file, links, joints)
    _check_mimics(file, joints)
    root = _root(file, links, joints)
    bodies = [_body(link) for link in links if link.get("name") != WORLD]
    parts = [_joint(file, joint) for joint in joints]
    if root == WORLD and floating_base:
        raise ValueError('from_urdf: floating_base: the root link is "world", which cannot float')
    if root != WORLD:
        if floating_base and any(part.name == _ROOT for part in parts):
            file.refuse_part("joint", _ROOT, "name: that of the joint which holds a floating base")
        # A weld has no name: no joint of a file can have the same.
        parts.insert(0, Joint(_ROOT, "free", WORLD, root) if floating_base else Joint("", "fixed", WORLD, root))
    mechanism = built(build, file.refuse_part, bodies, parts, (), gravity, dtype)
    for link, why in file.impossible.items():
        if _is_impossible(mechanism, link):
            file.doubt("inertia that no rigid body has", why)
    file.warn()
    return mechanism


# -- the text, element by element -------------------------------------------------------------------------------------


class _File(ModelText):
    """The text of a URDF. `impossible`: {link: where its inertia is that no rigid body has, and why not}."""

    def __init__(self, path_or_text: object, dtype: DTypeLike | None):
        super().__init__("from_urdf", path_or_text, dtype)
        self.impossible: dict[str, str] = {}

    def refuse(self, element: Element, reason: str) -> NoReturn:
        """Refuses a link or a joint."""
        self.refuse_named(self.line(element), element.tag, element.get("name"), reason)

    def refuse_part(self, what: str, name: str, reason: str) -> NoReturn:
        """Refuses a part of the mechanism."""
        tag = "joint" if what == "joint" else "link"
        element = next((e for e in self.root.iterchildren(tag) if e.get("name") == name), self.root)
        self.refuse_named(self.line(element), tag, name, reason)

    def skip(self, kind: str, element: Element):
        """Lists an element that is left out by its own name, by that of its link or joint, or by its line."""
        names = (e.get("name") for e in (element, *element.iterancestors("link", "joint")))
        self.leave_out(kind, next(filter(None, names), f"line {element.sourceline}"))

    def check(self, element: Element):
        """Checks an element and all that is in it; removes what is left out."""
        schema = _SCHEMAS[element.tag]
        if element.tag in ("robot", "link", "joint") and not element.get("name"):
            self.refuse_element(element, "name: expected one")
        known = schema.attributes | schema.numbers.keys()
        for name in element.attrib:
            if name in schema.left_out_attributes:
                self.skip(f"{name} of <{element.tag}>", element)
            elif name not in known:
                expected = f"expected one of {', '.join(sorted(known))}" if known else "expected none"
                self.refuse_element(element, f"{name}: there is no such attribute, {expected}")
        for name in schema.numbers:
            if element.get(name) is not None:
                self._check_numbers(element, name, schema)
        for name in schema.required:
            if element.get(name) is None:
                self.refuse_element(element, f"{name}: expected {_counted(schema.numbers[name])}")
        texts = [element.text, *(part.tail for part in element)]
        if stray := " ".join(text.strip() for text in texts if text).strip():
            self.refuse_element(element, f"expected no text, got {stray[:40]!r}")
        self._check_parts(element, schema)
        for part in element.iterchildren("*"):
            self.check(part)
        if element.tag == "inertial":
            self._check_inertial(element)
        if element.tag == "joint":
            self._check_joint(element)

    def _check_numbers(self, element: Element, name: str, schema: _Schema):
        text, n, is_limit = element.get(name), schema.numbers[name], element.tag == "limit"
        is_unlimited = is_limit and text.strip() in _UNLIMITED
        values = [_UNLIMITED[text.strip()]] if is_unlimited else numbers_of(text)
        if values is None or len(values) != n:
            self.refuse_element(element, f"{name}: expected {_counted(n)}, got {text!r}")
        largest = np.finfo(float).max if is_limit else self.largest
        if not is_unlimited and max(map(abs, values)) > largest:
            self.refuse_element(element, f"{name}: expected at most {self.largest:.3g} in this dtype, got {text!r}")
        if name in schema.not_negative and values[0] < 0:
            self.refuse_element(element, f"{name}: expected a number >= 0, got {text!r}")

    def _check_parts(self, element: Element, schema: _Schema):
        seen = set[Any]()
        for part in list(element.iterchildren("*")):
            if part.tag in schema.left_out:
                self.skip(f"<{part.tag}>", part)
                element.remove(part)
                continue
            if part.tag not in schema.parts:
                self.refuse_element(part, _no_counterpart(part, element, schema.parts))
            is_one_of_many = part.tag in ("link", "joint")
            key = (part.tag, part.get("name")) if is_one_of_many else part.tag
            if key in seen:
                what = f"name: {part.get('name')!r}" if is_one_of_many else f"<{part.tag}>"
                self.refuse_element(part, f"{what} comes twice")
            seen.add(key)

    def _check_inertial(self, element: Element):
        link, mass, moments = element.getparent(), element.find("mass"), element.find("inertia")
        if mass is None or moments is None:
            self.refuse(link, "inertial: expected mass and inertia")
        if 0 < float(mass.get("value")) < self.smallest:
            expected = f"expected at least {self.smallest:.3g} in this dtype"
            self.refuse_element(mass, f"value: {expected}, got {mass.get('value')!r}")
        six = [float(moments.get(name)) for name in ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")]
        if why := _broken_rule(float(mass.get("value")), six):
            self.impossible[link.get("name")] = f"{link.get('name')} in line {moments.sourceline}: {why}"

    def _check_joint(self, element: Element):
        for side in ("parent", "child"):
            if element.find(side) is None or not element.find(side).get("link"):
                self.refuse(element, f"{side}: expected a link")
        kind, limit = element.get("type"), element.find("limit")
        for part in element.iterchildren(*_USELESS.get(kind, ("none",))):
            self.skip(f"<{part.tag}> of a {kind} joint", part)
        if limit is not None and element.find("mimic") is not None and kind != "fixed":
            self.skip("<limit> of a mimic", limit)
        elif (
            limit is not None
            and kind in ("continuous", "floating", "planar")
            and (limit.get("lower") or limit.get("upper"))
        ):
            self.skip(f"lower and upper limit of a {kind} joint", limit)


def _no_counterpart(part: Element, element: Element, known: Set[str]):
    if "xacro" in part.tag:
        return "this is a text for the tool xacro, that makes a URDF of it: run it first"
    expected = f"expected one of {', '.join(sorted(known))}" if known else "expected nothing"
    return f"there is no counterpart here for this part of a {element.tag}, {expected}"


def _counted(n: int):
    return f"{n} number{'s' * (n > 1)}"


# -- the tree ---------------------------------------------------------------------------------------------------------


def _end(joint: Element, side: str) -> str:
    """The name of the parent or the child of a joint."""
    return joint.find(side).get("link")


def _check_tree(file: _File, links: list[Element], joints: list[Element]):
    names = {link.get("name") for link in links}
    held = dict[str, Element]()
    for joint in joints:
        if joint.get("type") not in _KINDS:
            kind, near = joint.get("type"), check.did_you_mean(joint.get("type"), _KINDS)
            file.refuse(joint, f"type: expected one of {', '.join(_KINDS)}, got {kind!r}{near}")
        for side in ("parent", "child"):
            name = _end(joint, side)
            if name not in names or (side, name) == ("child", WORLD):
                near = check.did_you_mean(name, names)
                reason = "the world hangs on nothing" if name in names else f"there is no link {name!r}{near}"
                file.refuse(joint, f"{side}: {reason}")
        child = _end(joint, "child")
        if child in held:
            file.refuse(joint, f"child: {child!r} hangs on {held[child].get('name')!r} already: a loop")
        held[child] = joint
    safe = set[str]()
    for link in held:
        way = list[str]()
        while link in held and link not in safe:
            if link in way:
                loop = ", ".join(map(repr, way[way.index(link) :]))
                file.refuse(held[link], f"child: {loop} hold each other: a loop")
            way.append(link)
            link = _end(held[link], "parent")
        safe.update(way)


def _check_mimics(file: _File, joints: list[Element]):
    """Both joints have one coordinate. A fixed joint has none: its mimic, like its axis and limits, says nothing."""
    names = {joint.get("name") for joint in joints}
    leaders = {j.get("name") for j in joints if j.find("mimic") is None and j.get("type") in _SCALAR}
    for joint in joints:
        if (mimic := joint.find("mimic")) is None:
            continue
        name, kind = mimic.get("joint"), joint.get("type")
        if name not in names:
            file.refuse(joint, f"mimic: there is no joint {name!r}{check.did_you_mean(name, names)}")
        if kind != "fixed" and not (kind in _SCALAR and name in leaders):
            file.refuse(joint, f"mimic: expected two joints of one coordinate, the second its own, got {name!r}")


def _root(file: _File, links: list[Element], joints: list[Element]) -> str:
    children = {_end(joint, "child") for joint in joints}
    roots = [link.get("name") for link in links if link.get("name") not in children]
    if len(roots) != 1:
        names = ", ".join(map(repr, roots)) or "no link at all"
        file.refuse_element(file.root, f"expected one link that is no joint's child, got {names}")
    return roots[0]


# -- the parts --------------------------------------------------------------------------------------------------------


def _body(link: Element):
    if (inertial := link.find("inertial")) is None:
        return Body(link.get("name"))
    xx, xy, xz, yy, yz, zz = (_number(inertial, "inertia", "i" + axes) for axes in ("xx", "xy", "xz", "yy", "yz", "zz"))
    moments = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return Body(link.get("name"), with_moments(_number(inertial, "mass", "value"), _pose(inertial), moments))


def _joint(file: _File, joint: Element):
    kind, mimic = _KINDS[joint.get("type")], joint.find("mimic")
    axis = np.array(_numbers(joint, "axis", "xyz") or [1.0, 0.0, 0.0])
    if kind == "planar" and not (axis[2] > 0 and not axis[:2].any()):
        file.refuse(joint, f"axis: a planar joint is normal to z here, got {axis.tolist()}")
    if kind not in _SCALAR:
        axis = np.array([0.0, 0.0, 1.0])
    if not axis.any():
        file.refuse(joint, "axis: expected three numbers, not all zero")
    numbers: dict[str, Any] = _limits(file, joint, kind)
    numbers["damping"] = _number(joint, "dynamics", "damping", 0.0)
    numbers["friction_loss"] = _number(joint, "dynamics", "friction", 0.0)
    if mimic is not None and kind != "fixed":
        multiplier, offset = _number(joint, "mimic", "multiplier", 1.0), _number(joint, "mimic", "offset", 0.0)
        numbers["mimic"] = mimic.get("joint"), multiplier, offset
    return Joint(
        joint.get("name"), kind, _end(joint, "parent"), _end(joint, "child"), _pose(joint), axis=axis, **numbers
    )


def _limits(file: _File, joint: Element, kind: str):
    if kind == "revolute" and joint.find("limit") is None:
        file.refuse(joint, "limit: a revolute joint needs one; without, it is continuous")
    names = {"effort": "effort_limit", "velocity": "velocity_limit"}
    names |= {"lower": "lower", "upper": "upper"} if kind in ("revolute", "prismatic") else {}
    limits = {field: _number(joint, "limit", name) for name, field in names.items()}
    limits = {field: x for field, x in limits.items() if x is not None}
    lower, upper = limits.get("lower", -np.inf), limits.get("upper", np.inf)
    if not (lower <= upper and lower < np.inf and upper > -np.inf):
        file.refuse(joint, "limit: expected lower <= upper")
    return limits


def _numbers(element: Element, tag: str, name: str):
    """The numbers of an attribute of a part; none where it is missing."""
    part = element.find(tag)
    return [] if part is None else [float(word) for word in part.get(name, "").split()]


def _number(element: Element, tag: str, name: str, default: Any = None):
    return next(iter(_numbers(element, tag, name)), default)


def _pose(element: Element):
    """The pose that an <origin> gives by xyz, m, and rpy, angles about the fixed axes x, y, z in turn, rad."""
    xyz, rpy = (_numbers(element, "origin", name) or [0.0] * 3 for name in ("xyz", "rpy"))
    (cx, cy, cz), (sx, sy, sz) = np.cos(rpy), np.sin(rpy)
    rows = [
        [cy * cz, sy * (sx * cz) - cx * sz, sy * (cx * cz) + sx * sz],
        [cy * sz, sy * (sx * sz) + cx * cz, sy * (cx * sz) - sx * cz],
        [-sy, cy * sx, cy * cx],
    ]
    with in_double():
        # Zeros are positive.
        return RigidTransform(Rotation(rotation_of(np.add(rows, 0.0)).ravel()), np.add(xyz, 0.0))


# -- inertias of no rigid body ----------------------------------------------------------------------------------------


def _is_impossible(mechanism: Any, link: str):
    """Whether the moving body that a link is part of has such an inertia."""
    body = dict(mechanism.topology.frames)[link]
    M = mechanism.inertias
    return body >= 0 and _broken_rule(M.mass[body], M.central[body]) is not None


def _broken_rule(mass: float, central: Sequence[float]) -> str | None:
    """Which rule an inertia with moments (xx, xy, yy, xz, yz, zz) breaks, and by how much; None for none."""
    largest = max(map(abs, central))
    if largest and not mass:
        return f"mass 0 kg with moments up to {largest:.6g} kg m2"
    largest = largest or 1.0
    xx, xy, yy, xz, yz, zz = (float(x) / largest for x in central)
    a, b, c = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])).tolist()
    tolerance = _DIGITS * (abs(a) + abs(b) + abs(c))
    if c - b - a <= tolerance:
        return None
    if a < -tolerance:
        return f"principal moment {a * largest:.6g} kg m2 < 0"
    moments, excess = (f"{x * largest:.6g}" for x in (a, b, c)), (c - b - a) * largest
    return "principal moments {} + {} < {} kg m2".format(*moments) + f" by {excess:.2g} (triangle inequality)"
