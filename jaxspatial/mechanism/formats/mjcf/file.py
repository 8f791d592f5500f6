"""The model that MuJoCo compiles of an MJCF, and where in the text its elements are."""

import functools
import pathlib
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NoReturn

import numpy as np

from jaxspatial.mechanism.formats.source import Element, ModelText, needed, parsed, rotation_of
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

_KINDS = "free", "ball", "prismatic", "revolute"
# For each kind of element: the section of the text, the tags there (none for all), an array of the model with one item
# for each element.
_ELEMENTS = {
    "body": ("worldbody", ("body",), "body_parentid"),
    "joint": ("worldbody", ("joint", "freejoint"), "jnt_bodyid"),
    "site": ("worldbody", ("site",), "site_bodyid"),
    "cam": ("worldbody", ("camera",), "cam_bodyid"),
    "eq": ("equality", (), "eq_type"),
    "tendon": ("tendon", (), "tendon_num"),
    "actuator": ("actuator", (), "actuator_trntype"),
}
# Attributes whose words are numbers, in which MuJoCo takes "nan" and "inf".
_ARE_NUMBERS = {
    "pos", "quat", "axis", "euler", "axisangle", "xyaxes", "zaxis", "fromto", "size", "mass", "density", "diaginertia",
    "fullinertia", "gravity", "armature", "damping", "frictionloss", "stiffness", "ref", "springref", "springdamper",
    "gear", "polycoef",
}  # fmt: skip
_NOT_FINITE = {"nan", "inf", "infinity"}
# Attributes in which infinite numbers mean that there is no limit.
_RANGES = {"range", "actuatorfrcrange"}
_NOT_NEGATIVE = {"mass", "stiffness", "armature", "damping", "frictionloss"}


class File(ModelText):
    """An MJCF. Elements are named by what they are ("body", "joint" ...) and their number in the model."""

    is_read_by_another = True

    def __init__(self, source: Any, assets: Mapping[str, bytes] | None, dtype: DTypeLike | None, strict: bool):
        mujoco = self.mujoco = needed("from_mjcf", "mujoco")
        self.assets, text = dict(assets or {}), source
        self.model: Any = None
        self.of_text = ""
        if isinstance(source, mujoco.MjSpec):
            # A copy: compiling adds what elements get by default.
            spec = source.copy()
            self.model, text = self._compiled(spec.compile), spec.to_xml()
            self.of_text = " of MjSpec.to_xml()"
        elif isinstance(source, mujoco.MjModel):
            self.model, text, self.of_text = source, "<mujoco/>", " of no text: an MjModel has none"
        super().__init__("from_mjcf", text, dtype, strict)
        self._include(self.root, {self.path and self.path.resolve()})
        self._check_finite()
        if self.model is None:
            # By its path, so that MuJoCo finds included files.
            by_text, by_path = mujoco.MjModel.from_xml_string, mujoco.MjModel.from_xml_path
            read, given = (by_text, self.source.decode()) if self.path is None else (by_path, str(self.path))
            self.model = self._compiled(functools.partial(read, given, self.assets))
        self._check_encoding_of_names()
        bits = mujoco.mjtDisableBit.__members__
        flags = self.model.opt.disableflags
        self.disabled = {name for name, bit in bits.items() if "DSBL" in name and flags & int(bit)}

    def _compiled(self, compile: Callable[[], Any]) -> Any:
        try:
            return compile()
        except ValueError as error:
            message = " ".join(str(error).split())
            said = self._with_line(message) if hasattr(self, "root") else f"MuJoCo says {message}"
            if self.malformed:
                raise ValueError(f"from_mjcf: {self.malformed}") from None
            raise ValueError(f"from_mjcf: {said}; mend the model") from None

    def line(self, element: Element) -> str:
        return super().line(element) + self.of_text

    def _include(self, element: Element, files: set[pathlib.Path | None]):
        """Puts the elements of included files in place, as MuJoCo does; leaves what cannot be read for it to refuse."""
        folder = pathlib.Path() if self.path is None else self.path.parent
        for mark in list(element.iter("include")):
            name = mark.get("file", "")
            path = (folder / name).resolve()
            if path in files:
                continue
            try:
                root, _ = parsed(self.operation, self.assets.get(name) or path.read_bytes(), None, False)
            except OSError:
                continue
            if root is None:
                continue
            self._include(root, {*files, path})
            for part in list(root.iterchildren("*")):
                part.base = part.base or name
                mark.addprevious(part)
            mark.getparent().remove(mark)

    def _with_line(self, message: str):
        """A message of MuJoCo. One about an included file has no line: that of the element which names the file."""
        if b"\0" in self.source[:4]:
            return "line 1: expected text in UTF-8, got UTF-16; save it as UTF-8"
        if found := re.search(r"Line number=(\d+)", message):
            return f"line {found[1]}: MuJoCo says {message}"
        if re.search(r"line \d+", message):
            return f"MuJoCo says {message}"
        quoted = tuple(re.findall(r"'([^']+)'", message))
        naming = [e for e in self.root.iter("*") if any(text.endswith(quoted) for text in e.attrib.values())]
        return f"{self.line((*naming, self.root)[0])}: MuJoCo says {message}"

    def _check_encoding_of_names(self):
        """Checks that names are UTF-8: the model has no others."""
        try:
            self.model.names.decode()
        except UnicodeDecodeError as error:
            byte = error.object[error.start : error.start + 1]
            line = self.source[: max(self.source.find(byte), 0)].count(b"\n") + 1
            reason = f"expected names in UTF-8, got the byte 0x{byte.hex()}; save the text as UTF-8"
            raise ValueError(f"from_mjcf: line {line}: {reason}") from None

    def _check_finite(self):
        """Checks the text: its lines are known, and MuJoCo would write into a log."""
        for element in self.root.iter("*"):
            for name, text in element.items():
                words = {word.lstrip("+-") for word in text.lower().split()}
                if ("nan" in words and name in _RANGES) or (words & _NOT_FINITE and name in _ARE_NUMBERS):
                    self.refuse_element(element, f"{name}: expected finite numbers, got {text!r}")

    def has(self, *flags: str):
        """Whether none of these is switched off: "SPRING", ..."""
        return not any(f"mjDSBL_{flag}" in self.disabled for flag in flags)

    @property
    def gravity(self):
        return np.array(self.model.opt.gravity) if self.has("GRAVITY") else np.zeros(3)

    def name(self, what: str, i: int) -> str:
        if (what, i) == ("body", 0):
            return WORLD
        # Of a plugin the model has no view.
        own = (
            self.mujoco.mj_id2name(self.model, int(self.mujoco.mjtObj.mjOBJ_PLUGIN), i)
            if what == "plugin"
            else (getattr(self.model, what)(i).name)
        )
        return own or f"{what}_{i}"

    def kind(self, j: int) -> str:
        return _KINDS[int(self.model.jnt_type[j])]

    def is_limited(self, j: int):
        """Whether the range of a joint limits it."""
        return bool(self.model.jnt_limited[j]) and self.has("LIMIT", "CONSTRAINT")

    def dofs(self, j: int):
        """The places of the velocities of a joint."""
        start = self.model.jnt_dofadr[j]
        return slice(start, start + {"free": 6, "ball": 3}.get(self.kind(j), 1))

    def coordinates(self, j: int):
        """The places of the coordinates of a joint."""
        start = self.model.jnt_qposadr[j]
        return slice(start, start + {"free": 7, "ball": 4}.get(self.kind(j), 1))

    def reference(self, j: int):
        """MuJoCo's coordinate in the pose that the file describes."""
        is_number = self.kind(j) in ("revolute", "prismatic")
        return float(self.model.qpos0[self.model.jnt_qposadr[j]]) if is_number else 0.0

    def frame_of_site(self, i: int) -> str:
        """The name of the frame of a site."""
        name, taken = self.name("site", i), {self.name("body", k) for k in range(self.model.nbody)}
        return f"{self.name('body', self.model.site_bodyid[i])}/{name}" if name in taken else name

    def numbers(self, name: str):
        """An array of the model as (n, k); zeros (n, 0) where this version of MuJoCo does not have it."""
        array = getattr(self.model, name, None)
        return np.zeros((1 << 16, 0)) if array is None else np.asarray(array).reshape((len(array), array[:1].size or 1))

    def option(self, name: str) -> Element:
        """The last element that sets an option, or the root."""
        return [self.root, *(e for e in self.root.findall("option") if e.get(name))][-1]

    def refuse(self, what: str, i: int, reason: str) -> NoReturn:
        element = self._element(what, i)
        if element is None:
            around = self._around(what, i)
            self.refuse_named(f"{self.line(around)}: in <{around.tag}>", what, self.name(what, i), reason)
        self.refuse_named(self.line(element), element.tag, self.name(what, i), reason)

    def refuse_part(self, what: str, name: str, reason: str) -> NoReturn:
        """Refuses a part of the mechanism. "<body>/<joint>" is a body of ours, "<joint>/x" a joint, "<body>/<site>" a
        site that has the name of a body; bodies and sites are frames."""
        kind = "body" if what == "frame" else what
        # The name, and what is left of it before each "/" from the last one on.
        words = name.split("/")
        own, *before = ((kind, "/".join(words[:k])) for k in range(len(words), 0, -1))
        sites = (("site", name), ("site", name.rpartition("/")[2])) if what == "frame" else ()
        for kind, candidate in (own, *sites, *before):
            names = [self.name(kind, i) for i in range(len(self._array(kind)))]
            if candidate in names:
                self.refuse(kind, names.index(candidate), reason)
        self.refuse_element(self.root, reason)

    def check_number(self, what: str, i: int, name: str, x: np.ndarray):
        if not (abs(x) <= self.largest).all():
            self.refuse(what, i, f"{name}: {self.expected_finite}, got {x.tolist()}")
        if name in _NOT_NEGATIVE and (x < 0).any():
            self.refuse(what, i, f"{name}: expected a number >= 0, got {x.tolist()}")
        if name == "mass" and 0 < x < self.smallest:
            self.refuse(what, i, f"mass: expected at least {self.smallest:.3g}, got {x.tolist()}")

    @property
    def expected_finite(self) -> str:
        """What messages about too large numbers say."""
        return f"expected finite numbers of at most {self.largest:.3g}"

    def _array(self, what: str):
        return getattr(self.model, _ELEMENTS[what][2])

    def _element(self, what: str, i: int) -> Element | None:
        """By its name, or by its place where the text has all elements that the model has; else None."""
        section, tags, _ = _ELEMENTS[what]
        elements = [e for part in self.root.findall(section) for e in part.iter(*tags) if isinstance(e.tag, str)]
        named = [e for e in elements if e.get("name") and e.get("name") == getattr(self.model, what)(i).name]
        listed = self._listed(what)
        return named[0] if named else listed[i] if len(listed) == len(self._array(what)) else None

    def _around(self, what: str, i: int) -> Element:
        """What holds an element that is not in the text, as one of an attached model: a body, or the section."""
        if what in ("body", "joint", "site", "cam") and (what, i) != ("body", 0):
            carrier = int(self._array(what)[i])
            element = self._element("body", carrier)
            return self._around("body", carrier) if element is None else element
        return [self.root, *self.root.findall(_ELEMENTS[what][0])][-1]

    def _listed(self, what: str) -> list[Element]:
        """Elements in the order of the model: body by body, bodies depth first. The world may have several elements."""
        section, tags, _ = _ELEMENTS[what]
        parts = self.root.findall(section)
        if section != "worldbody":
            return [e for part in parts for e in part.iterchildren("*")]
        bodies = [parts or [self.root], *([body] for part in parts for body in _bodies(part))]
        if what == "body":
            return [body[0] for body in bodies]
        return [e for body in bodies for part in body for e in _children(part, tags)]


def _bodies(element: Element) -> Iterator[Element]:
    for body in _children(element, ("body",)):
        yield body
        yield from _bodies(body)


def _children(element: Element, tags: tuple[str, ...]) -> Iterator[Element]:
    """Children with these tags, those in frames too, and those in <replicate> as often as it says."""
    for part in element.iterchildren("*"):
        if part.tag in tags:
            yield part
        elif part.tag in ("frame", "replicate"):
            yield from [*_children(part, tags)] * int(part.get("count", 1))


def pose_of(p: np.ndarray, wxyz: np.ndarray):
    entries = Rotation.from_quaternion(np.array(wxyz)).entries
    return RigidTransform(Rotation(rotation_of(entries).ravel()), np.array(p))
