"""The text of a URDF, checked: yourdfpy would pass over what is wrong in it, or say so without the line."""

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np

from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.mechanism.formats.numbers import numbers_of
from jaxspatial.mechanism.formats.source import Element, ModelText

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
_USELESS = {"fixed": {"axis", "limit", "dynamics", "mimic"}, "floating": {"axis"}}
LIMITS = "lower", "upper"
_NUMBERS: dict[str, dict[str, int]] = {
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
_REQUIRED = {"mass": ("value",), "inertia": tuple(_NUMBERS["inertia"]), "axis": ("xyz",)}
_NOT_NEGATIVE = {"dynamics": ("damping", "friction"), "limit": ("effort", "velocity"), "mass": ("value",)}
_UNLIMITED = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf}
# By how much of their sum the digits of a file may make the largest moment larger than the other two together.
_DIGITS = 1e-4


class Lines(ModelText):
    """The text of a URDF, and where in it links and joints are."""

    def __init__(self, path_or_text: object, dtype: DTypeLike | None):
        super().__init__("from_urdf", path_or_text, dtype)
        self.impossible: dict[str, str] = {}  # by link: where its inertia is that no rigid body has, and why not

    def refuse(self, tag: str, name: str, reason: str) -> NoReturn:
        found = next((e for e in self.root.iterchildren(tag) if e.get("name") == name), self.root)
        self.refuse_part(self.line(found), tag, name, reason)

    def refuse_made(self, what: str, name: str, reason: str) -> NoReturn:
        """A part of the mechanism."""
        self.refuse("joint" if what == "joint" else "link", name, reason)

    def leave_out(self, kind: str, element: Element):
        """By its own name or that of what it is in; by its line where there is none."""
        named = next((e.get("name") for e in (element, *element.iterancestors("link", "joint")) if e.get("name")), None)
        self.notes.leave_out(kind, named or f"line {element.sourceline}")


def check(lines: Lines, element: Element):
    """An element and all that is in it: what yourdfpy would pass over, or say without the line. What is left out is
    taken out."""
    _check_name(lines, element)
    _check_attributes(lines, element)
    _check_numbers(lines, element)
    _check_no_text(lines, element)
    _check_parts(lines, element)
    for part in element.iterchildren("*"):
        check(lines, part)
    if element.tag == "inertial":
        _check_inertial(lines, element)
    if element.tag == "joint":
        _check_joint(lines, element)


def _check_name(lines: Lines, element: Element):
    if element.tag in ("robot", "link", "joint") and not element.get("name"):
        lines.refuse_element(element, "name: expected one")


def _check_attributes(lines: Lines, element: Element):
    known = _ATTRIBUTES.get(element.tag, set()) | set(_NUMBERS.get(element.tag, ()))
    for name in element.attrib:
        if name in _ATTRIBUTES_BESIDES.get(element.tag, ()):
            lines.leave_out(f"{name} of <{element.tag}>", element)
        elif name not in known:
            expected = f"expected one of {', '.join(sorted(known))}" if known else "expected none"
            lines.refuse_element(element, f"{name}: there is no such attribute, {expected}")


def _check_no_text(lines: Lines, element: Element):
    texts = [element.text, *(part.tail for part in element)]
    if stray := " ".join(text.strip() for text in texts if text).strip():
        lines.refuse_element(element, f"expected no text, got {stray[:40]!r}")


def _check_parts(lines: Lines, element: Element):
    own = _PARTS.get(element.tag, set())
    besides: set[str] = _BESIDES.get(element.tag, set()) | _BESIDES_ALL if own else set()
    seen: set[Any] = set()
    for part in list(element.iterchildren("*")):
        if part.tag in besides:
            lines.leave_out(f"<{part.tag}>", part)
            element.remove(part)
        elif part.tag not in own:
            lines.refuse_element(part, _no_counterpart(part, element, own))
        else:
            _check_once(lines, part, seen)


def _no_counterpart(part: Element, element: Element, own: set[str]):
    if "xacro" in part.tag:
        return "this is a text for the tool xacro, that makes a URDF of it: run it first"
    expected = f"expected one of {', '.join(sorted(own))}" if own else "expected nothing"
    return f"there is no counterpart here for this part of a {element.tag}, {expected}"


def _check_once(lines: Lines, part: Element, seen: set[Any]):
    key = (part.tag, part.get("name")) if part.tag in _MANY else part.tag
    if key in seen:
        what = f"name: {part.get('name')!r}" if part.tag in _MANY else f"<{part.tag}>"
        lines.refuse_element(part, f"{what} comes twice")
    seen.add(key)


def _check_numbers(lines: Lines, element: Element):
    for name, n in _NUMBERS.get(element.tag, {}).items():
        if element.get(name) is not None:
            _check_number(lines, element, name, n)
    for name in _REQUIRED.get(element.tag, ()):
        if element.get(name) is None:
            n = _NUMBERS[element.tag][name]
            lines.refuse_element(element, f"{name}: expected {_counted(n)}")


def _check_number(lines: Lines, element: Element, name: str, n: int):
    text, is_limit = element.get(name), element.tag == "limit"
    found = numbers_of(text)
    if is_limit and text.strip() in _UNLIMITED:
        found = [_UNLIMITED[text.strip()]]
    elif found is None or len(found) != n:
        lines.refuse_element(element, f"{name}: expected {_counted(n)}, got {text!r}")
    elif not all(abs(x) <= (np.finfo(float).max if is_limit else lines.largest) for x in found):
        lines.refuse_element(element, f"{name}: expected at most {lines.largest:.3g} in this dtype, got {text!r}")
    if name in _NOT_NEGATIVE.get(element.tag, ()) and found[0] < 0:
        lines.refuse_element(element, f"{name}: expected a number >= 0, got {text!r}")


def _counted(n: int):
    return f"{n} number{'s' * (n > 1)}"


def _check_inertial(lines: Lines, element: Element):
    link, mass, moments = element.getparent().get("name"), element.find("mass"), element.find("inertia")
    if mass is None or moments is None:
        lines.refuse("link", link, "inertial: expected mass and inertia")
    if 0 < float(mass.get("value")) < lines.smallest:
        lines.refuse_element(
            mass, f"value: expected at least {lines.smallest:.3g} in this dtype, got {mass.get('value')!r}"
        )
    if why := broken_rule([float(moments.get(name)) for name in ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")]):
        lines.impossible[link] = f"{link} in line {moments.sourceline}: {why}"


def broken_rule(central: Sequence[float]) -> str | None:
    """Which rule of principal moments an inertia (xx, xy, yy, xz, yz, zz) breaks, and by how much; None for none."""
    largest = max(map(abs, central)) or 1.0
    xx, xy, yy, xz, yz, zz = (float(x) / largest for x in central)
    a, b, c = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])).tolist()
    tolerance = _DIGITS * (abs(a) + abs(b) + abs(c))
    if c - b - a <= tolerance:
        return None
    if a < -tolerance:
        return f"principal moment {a * largest:.6g} kg m2 < 0"
    moments, excess = (f"{x * largest:.6g}" for x in (a, b, c)), (c - b - a) * largest
    return "principal moments {} + {} < {} kg m2".format(*moments) + f" by {excess:.2g} (triangle inequality)"


def _check_joint(lines: Lines, element: Element):
    for side in ("parent", "child"):
        if element.find(side) is None or not element.find(side).get("link"):
            lines.refuse("joint", element.get("name"), f"{side}: expected a link")
    kind, is_mimic = element.get("type"), element.find("mimic") is not None
    for part in element.iterchildren(*_USELESS.get(kind, ("none",))):
        lines.leave_out(f"<{part.tag}> of a {kind} joint", part)
    limit = element.find("limit")
    if limit is not None and is_mimic and kind != "fixed":
        lines.leave_out("<limit> of a mimic", limit)
    elif limit is not None and kind in ("continuous", "floating", "planar") and any(map(limit.get, LIMITS)):
        lines.leave_out(f"lower and upper limit of a {kind} joint", limit)
