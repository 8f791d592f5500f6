"""Mechanisms from the Unified Robot Description Format (wiki.ros.org/urdf/XML), versions 1.0 to 1.2.

Links and joints become bodies and joints of the same name. What serves pictures, contact or control (visual, collision,
transmission, gazebo, calibration, safety_controller ...) is no part of a mechanism, and is left out.

Files in circulation have more than the format allows. What follows is read, unless `strict=True` refuses it:

- Elements and attributes that the format does not know are left out; one `ModelFileWarning` lists them, and asks about
  those that are nearly words of the format. What means motion (`loop_joint`, `cable`, `force_element`, `drake:joint`
  ...) is refused by its name.
- XML with an unknown version, blanks before its declaration, a default namespace, or prefixes that nobody declares; a
  robot without a name; a link "world" that only joints name: it is the world.
- Numbers with commas between them, where they cannot be decimals; a number with a dot or an "f" behind it; an empty
  attribute that may be left out. The warning lists them as doubtful.
- Of a part that comes twice the first is taken. What is left of calls of macros, in a file that xacro has made, is left
  out. The warning lists both as doubtful.
- An inertia without products, moments or mass has zeros for them. A revolute joint without limits, or with a lower one
  above the upper one, has none; so has effort or velocity below zero. The warning lists them as doubtful.

The warning begins with coordinates along which nothing has inertia: any torque accelerates nothing there.

Everything else is refused, with its line: names that come twice, numbers that are not finite or beyond the dtype,
joints that a mechanism cannot represent.

What a joint does not say has the format's default: the axis is x. Limits that are left out are infinite here, and 0 in
Pinocchio. A "spherical" joint is a ball. A "planar" joint moves across its axis: x and y are where the shortest turn
from z to the axis takes them, as in Drake. (Pinocchio takes every axis for z.) Of a mimic of a mimic multipliers
multiply.

Inertias that no rigid body has (a third moment larger than the other two together: a dozen of the robots in circulation
have such) are taken as they are. The warning lists their links, with the rule that is broken and by how much, unless
the link is welded to others with which it makes a possible body.
"""

import functools
import pathlib
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, NamedTuple, NoReturn

import numpy as np

from jaxspatial.mechanism.formats.collision import CollisionShape, mesh_file
from jaxspatial.mechanism.formats.source import (
    IMPOSSIBLE,
    MASSLESS,
    Element,
    Made,
    ModelText,
    built,
    mended_numbers,
    numbers_of,
    rotation_of,
    with_moments,
    word_of,
)
from jaxspatial.mechanism.formats.weightless import doubt_weightless
from jaxspatial.mechanism.parts import WORLD, Body, Joint
from jaxspatial.numerics import check
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.numerics.types import ArrayLike, DTypeLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

_ROOT = "root_joint"
_SCALAR = "revolute", "continuous", "prismatic"
# {type of a joint: kind of ours}
_KINDS = {"floating": "free", "spherical": "ball"} | {kind: kind for kind in (*_SCALAR, "fixed", "planar")}
# What joints of a type have no use for.
_USELESS = {"fixed": {"axis", "limit", "dynamics", "mimic"}, "floating": {"axis"}, "spherical": {"axis"}}
# Words of vendors that make a mechanism another one, whatever prefix they have; and these of the format with one.
_MOVING = {
    "loop_joint", "cable", "spring", "force_element", "linear_spring_damper", "linear_bushing_rpy", "ball_constraint",
    "deformable", "reduced_deformable",
}  # fmt: skip
# Statements of xacro; other words with its prefix are calls of macros.
_OF_XACRO = {"macro", "include", "property", "arg", "if", "unless", "call", "element", "attribute", "insert_block"}
_MOVING_WITH_PREFIX = {"joint", "link", "inertial", "mimic"}


class _Schema(NamedTuple):
    """What an element may have, and what of it is left out and listed."""

    attributes: Set[str] = frozenset()
    numbers: Mapping[str, int] = {}  # attributes that are so many numbers each
    required: Sequence[str] = ()  # of these
    usual: Sequence[str] = ()  # of these: required by the format, and 0 where files do without
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
    "inertia": _Schema(numbers=_MOMENTS, required=["ixx", "iyy", "izz"], usual=["ixy", "ixz", "iyz"]),
    "joint": _Schema(
        {"name", "type"},
        parts={"origin", "parent", "child", "axis", "limit", "dynamics", "mimic"},
        left_out=_LEFT_OUT | {"calibration", "safety_controller"},
        left_out_attributes={"dont_collapse"},
    ),
    "parent": _Schema({"link"}),
    "child": _Schema({"link"}),
    "origin": _Schema(numbers={"xyz": 3, "rpy": 3, "quat_xyzw": 4}),
    "axis": _Schema(numbers={"xyz": 3}, required=["xyz"]),
    "limit": _Schema(
        numbers={"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
        not_negative=["effort", "velocity"],
        left_out_attributes={"acceleration", "deceleration", "jerk", "current", "command_effort", "gear_velocity"},
    ),
    "dynamics": _Schema(
        numbers={"damping": 1, "friction": 1},
        not_negative=["damping", "friction"],
        left_out_attributes={"D", "K", "mu_coulomb", "mu_viscous"},
    ),
    "mimic": _Schema({"joint"}, numbers={"multiplier": 1, "offset": 1}),
}
_UNLIMITED = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf}
_LOOP = "a loop; take one of its joints out, and close it by a LoopClosure"
# How near an unknown word has to be to one of the format (1 where they are the same) for it to be taken for a slip.
_NEARLY = 0.65
# Shorter quaternions than this have no direction that digits can tell.
_SHORTEST = 1e-100
# By how much of their sum the digits of a file may make the largest moment larger than the other two together.
_DIGITS = 1e-4


def read(
    build: Callable[..., Made],
    path_or_text: str | pathlib.Path,
    floating_base: bool = False,
    gravity: ArrayLike = (0.0, 0.0, -9.81),
    dtype: DTypeLike | None = None,
    strict: bool = False,
) -> Made:
    """Reads a URDF for `Mechanism.from_urdf`: the same arguments and errors, and `Mechanism.build`.

    The root link is welded to the world, or held by a "free" joint named "root_joint"; a root link named "world" is
    the world.
    """
    file = _File(path_or_text, dtype, strict)
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
            file.refuse_part("joint", _ROOT, "name: that of the joint which holds a floating base; name it otherwise")
        # A weld has no name: no joint of a file can have the same.
        parts.insert(0, Joint(_ROOT, "free", WORLD, root) if floating_base else Joint("", "fixed", WORLD, root))
    mechanism: Any = built(build, file.refuse_part, bodies, parts, (), gravity, dtype)
    doubt_weightless(file, mechanism)
    frames, M = dict(mechanism.topology.frames), mechanism.inertias
    for link, (kind, why) in file.impossible.items():
        # The moving body that the link is part of, -1 for the world.
        body = frames[link]
        if body >= 0 and _broken_rule(M.mass[body], M.central[body]):
            file.doubt(kind, why)
    file.warn()
    return mechanism


def read_shapes(path_or_text: str | pathlib.Path) -> list[CollisionShape]:
    """The collision shapes of a URDF for `PointContacts.from_urdf`. Those without a name are "<link>_<number>"."""
    file = _File(path_or_text, None, False)
    folder = pathlib.Path() if file.path is None else file.path.parent
    links = file.root.findall("link")
    return [_shape(file, *item, folder) for link in links for item in enumerate(link.findall("collision"))]


# -- the text, element by element -------------------------------------------------------------------------------------


class _File(ModelText):
    """The text of a URDF. `impossible`: {link: (what its inertia is that no rigid body has, where it is and why)}."""

    def __init__(self, path_or_text: object, dtype: DTypeLike | None, strict: bool):
        super().__init__("from_urdf", path_or_text, dtype, strict)
        self.impossible: dict[str, tuple[str, str]] = {}

    @functools.cached_property
    def is_for_xacro(self) -> bool:
        """Whether the text has statements of the tool xacro. What it has made has none; of macros that it did not know,
        earlier versions left the calls in place."""
        words = (word_of(element) for element in self.root.iter("*"))
        return any(word.partition(":")[2] in _OF_XACRO for word in words if word.startswith("xacro:"))

    def refuse(self, element: Element, reason: str) -> NoReturn:
        """Refuses a link or a joint."""
        self.refuse_named(self.line(element), element.tag, element.get("name"), reason)

    def refuse_part(self, what: str, name: str, reason: str) -> NoReturn:
        """Refuses a part of the mechanism."""
        tag = "joint" if what == "joint" else "link"
        element = next((e for e in self.root.iterchildren(tag) if e.get("name") == name), self.root)
        self.refuse_named(self.line(element), tag, name, reason)

    def place(self, element: Element) -> str:
        """Its own name, that of its link or joint, or its line."""
        names = (e.get("name") for e in (element, *element.iterancestors("link", "joint")))
        return next(filter(None, names), f"line {element.sourceline}")

    def take_as(self, element: Element, kind: str, reason: str):
        """What the format does not allow, and files have: doubtful, refused where `strict`."""
        if self.strict:
            self.refuse_strictly(element, reason)
        self.doubt(kind, self.place(element))

    def check(self, element: Element):
        """Checks an element and all that is in it; removes what is left out."""
        schema = _SCHEMAS[element.tag]
        if element.tag in ("robot", "link", "joint") and not element.get("name"):
            if element.tag != "robot":
                self.refuse_element(element, "name: expected one")
            if self.strict:
                self.refuse_strictly(element, "name: expected one")
        self._check_attributes(element, schema)
        for name in schema.required:
            if element.get(name) is None:
                self.refuse_element(element, f"{name}: expected {_counted(schema.numbers[name])}")
        for name in schema.usual:
            if element.get(name) is None:
                self.take_as(element, f"no {name} of <{element.tag}>", f"{name}: expected 1 number")
        texts = [element.text, *(part.tail for part in element)]
        if stray := " ".join(text.strip() for text in texts if text).strip():
            if self.strict:
                self.refuse_strictly(element, f"expected no text, got {stray[:40]!r}")
            self.miss("text", self.place(element))
        self._check_parts(element, schema)
        for part in element.iterchildren("*"):
            self.check(part)
        if element.tag == "origin" and element.get("quat_xyzw") is not None:
            self._check_quaternion(element)
        if element.tag == "inertial":
            self._check_inertial(element)
        if element.tag == "joint":
            self._check_joint(element)

    def _check_attributes(self, element: Element, schema: _Schema):
        known = schema.attributes | schema.numbers.keys()
        for name in element.attrib:
            if name in schema.left_out_attributes:
                self.leave_out(f"{name} of <{element.tag}>", self.place(element))
            elif name not in known:
                word = word_of(element, name)
                if self.strict:
                    expected = f"expected one of {', '.join(sorted(known))}" if known else "expected none"
                    self.refuse_strictly(element, f"{word}: there is no such attribute, {expected}")
                self._miss_word(element, f"{word} of <{element.tag}>", name, known - {*element.attrib})
        for name in schema.numbers:
            if element.get(name) is not None:
                self._check_numbers(element, name, schema)

    def _miss_word(self, element: Element, kind: str, name: str, missing: Set[str]):
        """Leaves out a word. It is doubtful where it is nearly one that is not there."""
        near = check.did_you_mean(name, missing, _NEARLY)
        if near:
            self.doubt(f"{kind} is not read{near}", self.place(element))
        self.miss(kind, self.place(element))

    def _check_numbers(self, element: Element, name: str, schema: _Schema):
        text, n, is_limit = element.get(name), schema.numbers[name], element.tag == "limit"
        is_unlimited = is_limit and text.strip() in _UNLIMITED
        values = [_UNLIMITED[text.strip()]] if is_unlimited else numbers_of(text)
        if values is None or len(values) != n:
            hint = "; numbers have blanks between them" if "," in text else ""
            hint = "; this is a text for the tool xacro: run it first" if "$" in text else hint
            reason = f"{name}: expected {_counted(n)}, got {text!r}{hint}"
            if not text.strip() and name not in schema.required:
                self.take_as(element, f"empty {name} of <{element.tag}>, taken as left out", reason)
                del element.attrib[name]
                return
            mended = mended_numbers(text, n)
            if mended is None:
                self.refuse_element(element, reason)
            what, text = mended
            self.take_as(element, what, reason)
            element.set(name, text)
            values = numbers_of(text) or []
        largest = np.finfo(float).max if is_limit else self.largest
        if not is_unlimited and max(map(abs, values)) > largest:
            self.refuse_element(element, f"{name}: expected at most {self.largest:.3g} in this dtype, got {text!r}")
        if name in schema.not_negative and values[0] < 0:
            reason = f"{name}: expected a number >= 0, got {text!r}"
            if not is_limit:
                self.refuse_element(element, reason)
            self.take_as(element, f"{name} below 0, taken as none", reason)
            del element.attrib[name]

    def _check_parts(self, element: Element, schema: _Schema):
        seen, useless = dict[Any, Element](), _USELESS.get(element.get("type"), ()) if element.tag == "joint" else ()
        for part in list(element.iterchildren("*")):
            word = word_of(part)
            if word in schema.left_out or (word in useless and not self.strict):
                of = f" of a {element.get('type')} joint" if word in useless else ""
                self.leave_out(f"<{word}>{of}", self.place(part))
                element.remove(part)
                continue
            if word not in schema.parts:
                self._leave_out_part(element, part, word, schema.parts)
                continue
            is_one_of_many = part.tag in ("link", "joint")
            key = (part.tag, part.get("name")) if is_one_of_many else part.tag
            if key in seen:
                if is_one_of_many:
                    self.refuse_element(part, f"name: {part.get('name')!r} comes twice; take one of them out")
                if self.strict:
                    self.refuse_strictly(part, f"<{part.tag}> comes twice")
                if not _is_same(part, seen[key]):
                    self.doubt(f"<{part.tag}> comes twice, the first is taken", self.place(part))
                element.remove(part)
                continue
            seen[key] = part

    def _leave_out_part(self, element: Element, part: Element, word: str, known: Set[str]):
        """A part that the format does not know: left out, or refused."""
        local, has_prefix = word.rpartition(":")[2], ":" in word
        is_of_xacro = "xacro" in part.tag
        if is_of_xacro and (self.strict or self.is_for_xacro):
            self.refuse_element(part, "this is a text for the tool xacro, that makes a URDF of it; run it first")
        if self.strict:
            expected = f"expected one of {', '.join(sorted(known))}" if known else "expected nothing"
            reason = f"there is no counterpart here for this part of a {element.tag}, {expected}"
            self.refuse_strictly(part, reason)
        if is_of_xacro:
            self.doubt("macro that xacro did not know", f"{word} in line {part.sourceline}")
        if local in _MOVING or (has_prefix and local in _MOVING_WITH_PREFIX):
            reason = "this changes how the robot moves, and is no part of the format; take it out, or make the robot by"
            self.refuse_element(part, f"{reason} Mechanism.build, with loops where it has such")
        self._miss_word(part, f"<{word}>", local, known - {"link", "joint"} - {p.tag for p in element})
        # What stands behind an element is its tail, which lxml takes out with it: it was checked before.
        element.remove(part)

    def _check_quaternion(self, element: Element):
        if element.get("rpy") is not None:
            self.refuse_element(element, "expected rpy or quat_xyzw, got both; take one of them out")
        length = np.linalg.norm([float(word) for word in element.get("quat_xyzw").split()])
        if not _SHORTEST < length < np.inf:
            self.refuse_element(element, f"quat_xyzw: expected a length of about 1, got {element.get('quat_xyzw')!r}")

    def _check_inertial(self, element: Element):
        link, mass, moments = element.getparent(), element.find("mass"), element.find("inertia")
        if mass is None or moments is None:
            if self.strict:
                self.refuse_strictly(link, "inertial: expected mass and inertia")
            lacks = [what for what, x in (("mass", mass), ("inertia", moments)) if x is None]
            self.doubt(f"<inertial> without {' and '.join(lacks)}, taken as 0", self.place(element))
        value = 0.0 if mass is None else float(mass.get("value"))
        if mass is not None and 0 < value < self.smallest:
            expected = f"expected at least {self.smallest:.3g} in this dtype"
            self.refuse_element(mass, f"value: {expected}, got {mass.get('value')!r}")
        if moments is None:
            return
        six = [float(moments.get(name, 0.0)) for name in ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")]
        if why := _broken_rule(value, six):
            where = f"{link.get('name')} in line {moments.sourceline}: {why}"
            self.impossible[link.get("name")] = IMPOSSIBLE if value else MASSLESS, where

    def _check_joint(self, element: Element):
        for side in ("parent", "child"):
            if element.find(side) is None or not element.find(side).get("link"):
                self.refuse(element, f"{side}: expected a link")
        kind, limit = element.get("type"), element.find("limit")
        if (
            limit is not None
            and element.find("mimic") is None
            and kind in ("continuous", "floating", "planar", "spherical")
            and (limit.get("lower") or limit.get("upper"))
        ):
            self.miss(f"lower and upper limit of a {kind} joint", self.place(limit))


def _is_same(a: Element, b: Element) -> bool:
    """Whether two elements say the same."""
    is_same = a.tag == b.tag and dict(a.attrib) == dict(b.attrib) and len(a) == len(b)
    return is_same and all(map(_is_same, a, b))


def _counted(n: int):
    return f"{n} number{'s' * (n > 1)}"


# -- the tree ---------------------------------------------------------------------------------------------------------


def _end(joint: Element, side: str) -> str:
    """The name of the parent or the child of a joint."""
    return joint.find(side).get("link")


def _check_tree(file: _File, links: list[Element], joints: list[Element]):
    names = {link.get("name") for link in links}
    parents = names if file.strict else names | {WORLD}
    joint_of = dict[str, Element]()
    for joint in joints:
        if joint.get("type") not in _KINDS:
            kind, near = joint.get("type"), check.did_you_mean(joint.get("type"), _KINDS)
            file.refuse(joint, f"type: expected one of {', '.join(_KINDS)}, got {kind!r}{near}")
        for side, there in (("parent", parents), ("child", names - {WORLD})):
            name = _end(joint, side)
            if name not in there:
                way_out = check.did_you_mean(name, names) or "; declare it, or mend the name"
                is_held = (side, name) == ("child", WORLD)
                missing = f"there is no link {name!r}{way_out}"
                reason = "the world hangs on nothing; make it the parent" if is_held else missing
                file.refuse(joint, f"{side}: {reason}")
        child = _end(joint, "child")
        if child in joint_of:
            file.refuse(joint, f"child: {child!r} hangs on {joint_of[child].get('name')!r} already: {_LOOP}")
        joint_of[child] = joint
    safe = set[str]()
    for link in joint_of:
        way = list[str]()
        while link in joint_of and link not in safe:
            if link in way:
                loop = ", ".join(map(repr, way[way.index(link) :]))
                file.refuse(joint_of[link], f"child: {loop} hold each other: {_LOOP}")
            way.append(link)
            link = _end(joint_of[link], "parent")
        safe.update(way)


def _check_mimics(file: _File, joints: list[Element]):
    """Both joints have one coordinate. A fixed joint has none: its mimic, like its axis and limits, says nothing."""
    of = {joint.get("name"): joint for joint in joints}
    followed = {n: j.find("mimic").get("joint") for n, j in of.items() if j.find("mimic") is not None}
    for name, leader in followed.items():
        joint = of[name]
        if leader not in of:
            way_out = check.did_you_mean(leader, of) or "; mend the name, or take the mimic out"
            file.refuse(joint, f"mimic: there is no joint {leader!r}{way_out}")
        if joint.get("type") == "fixed":
            continue
        passed = [name]
        while of[leader].get("type") in _SCALAR and leader in followed and leader not in passed:
            passed.append(leader)
            leader = followed[leader]
            if leader not in of:
                break  # It is refused at the joint that follows it.
        if leader in of and not (joint.get("type") in _SCALAR and of[leader].get("type") in _SCALAR):
            file.refuse(joint, f"mimic: expected two joints of one coordinate, the second its own, got {leader!r}")
        if leader in passed:
            ring = ", ".join(map(repr, passed[passed.index(leader) :]))
            file.refuse(
                joint, f"mimic: expected a joint of its own coordinate at the end, got {ring} in a ring; cut it"
            )
        limit = joint.find("limit")
        if limit is not None and not _has_limits_within(of[followed[name]], joint):
            file.miss("<limit> of a mimic", file.place(limit))


def _has_limits_within(leader: Element, joint: Element) -> bool:
    """Whether the limits of a mimic, in place and speed, say no more than those of the joint that it follows.

    Its motor is that of the other joint, so an effort of its own says nothing.
    """
    multiplier, offset = _number(joint, "mimic", "multiplier", 1.0), _number(joint, "mimic", "offset", 0.0)
    (low, high), ends = (
        (_number(x, "limit", "lower", -np.inf), _number(x, "limit", "upper", np.inf)) for x in (joint, leader)
    )
    moved = [multiplier * end + offset for end in ends]
    of_own, of_leader = (_number(x, "limit", "velocity", np.inf) for x in (joint, leader))
    within = low <= min(moved) and max(moved) <= high and abs(multiplier) * of_leader <= of_own
    return bool(multiplier) and within


def _root(file: _File, links: list[Element], joints: list[Element]) -> str:
    children = {_end(joint, "child") for joint in joints}
    names = dict.fromkeys(link.get("name") for link in links)
    if any(_end(joint, "parent") == WORLD for joint in joints):
        names[WORLD] = None
    roots = [name for name in names if name not in children]
    if len(roots) != 1:
        came = f"{', '.join(map(repr, roots))}; hold all but one by joints" if roots else "no link at all"
        file.refuse_element(file.root, f"expected one link that is no joint's child, got {came}")
    return roots[0]


# -- the parts --------------------------------------------------------------------------------------------------------


def _body(link: Element):
    if (inertial := link.find("inertial")) is None:
        return Body(link.get("name"))
    axes = "xx", "xy", "xz", "yy", "yz", "zz"
    xx, xy, xz, yy, yz, zz = (_number(inertial, "inertia", "i" + pair, 0.0) for pair in axes)
    moments = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    return Body(link.get("name"), with_moments(_number(inertial, "mass", "value", 0.0), _pose(inertial), moments))


def _joint(file: _File, joint: Element):
    kind, mimic = _KINDS[joint.get("type")], joint.find("mimic")
    axis, X_PJ, X_JB = np.array(_numbers(joint, "axis", "xyz") or [1.0, 0.0, 0.0]), _pose(joint), None
    if kind in (*_SCALAR, "planar") and not axis.any():
        file.refuse(joint, "axis: expected three numbers, not all zero")
    if kind == "planar":
        R = _turn_from_z(axis)
        if not np.array_equal(R, np.eye(3)):
            with in_double():
                X_PJ = X_PJ @ RigidTransform(Rotation(R.ravel()), np.zeros(3))
                X_JB = RigidTransform(Rotation(R.T.ravel()), np.zeros(3))
    if kind not in _SCALAR:
        axis = np.array([0.0, 0.0, 1.0])
    numbers: dict[str, Any] = _limits(file, joint, kind)
    numbers["damping"] = _number(joint, "dynamics", "damping", 0.0)
    numbers["friction_loss"] = _number(joint, "dynamics", "friction", 0.0)
    if mimic is not None and kind != "fixed":
        multiplier, offset = _number(joint, "mimic", "multiplier", 1.0), _number(joint, "mimic", "offset", 0.0)
        numbers["mimic"] = mimic.get("joint"), multiplier, offset
    return Joint(joint.get("name"), kind, _end(joint, "parent"), _end(joint, "child"), X_PJ, X_JB, axis, **numbers)


def _turn_from_z(axis: np.ndarray):
    """(3, 3) the shortest turn that takes z to an axis; half a turn about x to -z."""
    x, y, z = axis / 2.0 ** np.floor(np.log2(abs(axis).max()))
    x, y, z = np.array([x, y, z]) / np.sqrt(x * x + y * y + z * z)
    across = x * x + y * y
    if z < 0 and not across:
        return np.diag([1.0, -1.0, -1.0])
    # 1 / (1 + z), without cancellation.
    s = 1 / (1 + z) if z >= 0 else (1 - z) / across
    return rotation_of([1 - x * x * s, -x * y * s, x, -x * y * s, 1 - y * y * s, y, -x, -y, z])


def _limits(file: _File, joint: Element, kind: str):
    limit = joint.find("limit")
    if kind == "revolute" and limit is None:
        reason = "limit: a revolute joint needs one; without, it is continuous"
        if file.strict:
            file.refuse_strictly(joint, reason)
        file.doubt("revolute joint without <limit>, taken as unlimited", joint.get("name"))
    names = {"effort": "effort_limit", "velocity": "velocity_limit"}
    names |= {"lower": "lower", "upper": "upper"} if kind in ("revolute", "prismatic") else {}
    limits = {field: _number(joint, "limit", name) for name, field in names.items()}
    limits = {field: x for field, x in limits.items() if x is not None}
    lower, upper = limits.get("lower", -np.inf), limits.get("upper", np.inf)
    if not (lower <= upper and lower < np.inf and upper > -np.inf):
        reason = f"limit: expected lower <= upper, got {lower} and {upper}"
        if not np.isfinite([lower, upper]).all():
            file.refuse(joint, reason)
        if file.strict:
            file.refuse_strictly(joint, reason)
        file.doubt("lower limit above the upper one, taken as unlimited", joint.get("name"))
        del limits["lower"], limits["upper"]
    return limits


def _numbers(element: Element, tag: str, name: str):
    """The numbers of an attribute of a part; none where it is missing."""
    part = element.find(tag)
    return [] if part is None else [float(word) for word in part.get(name, "").split()]


def _number(element: Element, tag: str, name: str, default: Any = None):
    return next(iter(_numbers(element, tag, name)), default)


def _pose(element: Element):
    """The pose that an <origin> gives by xyz, m, and rpy, angles about the fixed axes x, y, z in turn, rad, or by a
    quaternion of any length."""
    xyz, rpy = (_numbers(element, "origin", name) or [0.0] * 3 for name in ("xyz", "rpy"))
    if xyzw := _numbers(element, "origin", "quat_xyzw"):
        with in_double():
            R = Rotation.from_quaternion(np.roll(np.array(xyzw) / np.linalg.norm(xyzw), 1))
            return RigidTransform(Rotation(rotation_of(R.entries).ravel()), np.add(xyz, 0.0))
    (cx, cy, cz), (sx, sy, sz) = np.cos(rpy), np.sin(rpy)
    rows = [
        [cy * cz, sy * (sx * cz) - cx * sz, sy * (cx * cz) + sx * sz],
        [cy * sz, sy * (sx * sz) + cx * cz, sy * (cx * sz) - sx * cz],
        [-sy, cy * sx, cy * cx],
    ]
    with in_double():
        # Zeros are positive.
        return RigidTransform(Rotation(rotation_of(np.add(rows, 0.0)).ravel()), np.add(xyz, 0.0))


# -- the shapes that touch --------------------------------------------------------------------------------------------

# {shape: its sizes}, m. Boxes have three edges; meshes have scales, and their file.
_SIZES = {
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "cylinder": ("radius", "length"),
    "ellipsoid": ("a", "b", "c"),
    "box": ("size",),
    "mesh": (),
}


def _shape(file: _File, number: int, collision: Element, folder: pathlib.Path) -> CollisionShape:
    link = collision.getparent().get("name")
    for origin in collision.findall("origin"):
        file.check(origin)
    parts = [part for geometry in collision.findall("geometry") for part in geometry.iterchildren("*")]
    words = [word_of(part) for part in parts]
    # Words of vendors beside a shape, such as <drake:declare_convex/>, are no shapes.
    shapes = [i for i, word in enumerate(words) if ":" not in word or word.rpartition(":")[2] in _SIZES]
    kind = words[shapes[0]].rpartition(":")[2] if len(shapes) == 1 else ""
    if kind not in _SIZES:
        came = ", ".join(f"<{word}>" for word in words) or "none"
        expected = f"expected a <geometry> with one of {', '.join(_SIZES)}, got {came}"
        file.refuse_element(collision, f"{expected}; leave it out of the file")
    part = parts[shapes[0]]
    size = [x for name in _SIZES[kind] for x in _sizes(file, part, name, 3 if name == "size" else 1)]
    vertices = None
    if kind == "mesh":
        path, scale = part.get("filename"), _sizes(file, part, "scale", 3) if part.get("scale") else 1.0
        if not path:
            file.refuse_element(part, "filename: expected one")
        where = f"{file.line(part)}: <mesh>"
        vertices = lambda: mesh_file(file.operation, path, folder, where) * np.array(scale)  # noqa: E731
    return CollisionShape(
        collision.get("name") or f"{link}_{number}", link, _pose(collision), kind, tuple(size), vertices
    )


def _sizes(file: _File, part: Element, name: str, n: int) -> list[float]:
    """The numbers of a size, above 0, or of a scale, not 0: a mesh may be mirrored. A sphere may be a point."""
    values, is_scale, is_sphere = numbers_of(part.get(name, "")), name == "scale", part.tag.endswith("sphere")
    fits = (lambda x: x != 0) if is_scale else (lambda x: x >= 0) if is_sphere else (lambda x: x > 0)
    if values is None or len(values) != n or not all(map(fits, values)):
        bound = "other than 0" if is_scale else "of at least 0" if is_sphere else "above 0"
        file.refuse_element(part, f"{name}: expected {_counted(n)} {bound}, got {part.get(name)!r}")
    return values


# -- inertias of no rigid body ----------------------------------------------------------------------------------------


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
