"""A compiled model of MuJoCo, and where in the text its elements are."""

import pathlib
import re
from collections.abc import Iterator
from typing import NoReturn

import numpy as np

from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.mechanism.formats.source import Element, ModelText, included, needed
from jaxspatial.mechanism.parts import WORLD

_KINDS = "free", "ball", "prismatic", "revolute"
# Where in the text the elements of each kind are, and their tags there; none for all.
_SECTIONS = {
    "body": ("worldbody", ("body",)),
    "joint": ("worldbody", ("joint", "freejoint")),
    "site": ("worldbody", ("site",)),
    "eq": ("equality", ()),
    "tendon": ("tendon", ()),
    "actuator": ("actuator", ()),
}
# Arrays with one item for each.
_COUNTED = {"body": "body_parentid", "joint": "jnt_bodyid", "site": "site_bodyid",
            "eq": "eq_type", "tendon": "tendon_num", "actuator": "actuator_trntype"}  # fmt: skip
# Of these, the number of the body that each is on.
_CARRIERS = {what: _COUNTED[what] for what in ("body", "joint", "site")}
# Attributes whose words are numbers, in which MuJoCo takes "nan" and "inf".
_ARE_NUMBERS = {
    "pos", "quat", "axis", "euler", "axisangle", "xyaxes", "zaxis", "fromto", "size", "mass", "density", "diaginertia",
    "fullinertia", "gravity", "armature", "damping", "frictionloss", "stiffness", "ref", "springref", "springdamper",
    "gear", "polycoef",
}  # fmt: skip
_NOT_FINITE = {"nan", "inf", "infinity"}
# Of these, infinite ones say that there is no limit.
_RANGES = {"range", "actuatorfrcrange"}


class ModelFile(ModelText):
    """The compiled model, and where in the text its elements are."""

    def __init__(self, path_or_text: str | pathlib.Path, dtype: DTypeLike | None):
        mujoco = self.mujoco = needed("from_mjcf", "mujoco")
        super().__init__("from_mjcf", path_or_text, dtype)
        self._include(self.root, {self.path and self.path.resolve()})
        self._check_finite()
        try:
            # By its path, so that MuJoCo finds what the file includes.
            text, path = mujoco.MjModel.from_xml_string, mujoco.MjModel.from_xml_path
            self.model = text(self.source.decode()) if self.path is None else path(str(self.path))
        except ValueError as error:
            raise ValueError(f"from_mjcf: {self._with_line(' '.join(str(error).split()))}") from None
        bits = mujoco.mjtDisableBit.__members__
        self.disabled = {
            name for name, bit in bits.items() if "DSBL" in name and self.model.opt.disableflags & int(bit)
        }
        self.equalities = {int(value): name for name, value in mujoco.mjtEq.__members__.items()}
        self.on_joints = int(mujoco.mjtTrn.mjTRN_JOINT)

    def _include(self, element: Element, files: set[pathlib.Path | None]):
        """Puts the elements of included files in place, as MuJoCo does; what cannot be read is for MuJoCo to refuse."""
        folder = pathlib.Path() if self.path is None else self.path.parent
        for mark in list(element.iter("include")):
            name = mark.get("file", "")
            path = (folder / name).resolve()
            if path not in files and (root := included(path)) is not None:
                self._include(root, {*files, path})
                for part in list(root.iterchildren("*")):
                    part.base = part.base or name
                    mark.addprevious(part)
                mark.getparent().remove(mark)

    def _with_line(self, said: str):
        """What MuJoCo says. Of other files it says no line: that of the element which names one."""
        if re.search(r"line \d+", said):
            return f"MuJoCo says {said}"
        quoted = tuple(re.findall(r"'([^']+)'", said))
        naming = [e for e in self.root.iter("*") if any(text.endswith(quoted) for text in e.attrib.values())]
        return f"{self.line((*naming, self.root)[0])}: MuJoCo says {said}"

    def _check_finite(self):
        """Of the text itself, with its lines; MuJoCo would write into a log."""
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
        return getattr(self.model, what)(i).name or f"{what}_{i}"

    def kind(self, j: int) -> str:
        return _KINDS[int(self.model.jnt_type[j])]

    def is_limited(self, j: int):
        """Whether the range of a joint is one."""
        return bool(self.model.jnt_limited[j]) and self.has("LIMIT", "CONSTRAINT")

    def dofs(self, j: int):
        """Where the rates of a joint are; of a free joint all are alike."""
        start = self.model.jnt_dofadr[j]
        return slice(start, start + {"free": 6, "ball": 3}.get(self.kind(j), 1))

    def n_coordinates(self, j: int):
        """How many coordinates a joint has."""
        return {"free": 7, "ball": 4}.get(self.kind(j), 1)

    def numbers(self, name: str):
        """An array of the model as (n, k); one of zeros, (n, 0), where this version of MuJoCo does not have it."""
        array = getattr(self.model, name, None)
        return np.zeros((1 << 16, 0)) if array is None else np.asarray(array).reshape((len(array), array[:1].size or 1))

    def option(self, name: str) -> Element:
        """The last element that sets an option, or the root."""
        return [self.root, *(e for e in self.root.findall("option") if e.get(name))][-1]

    def refuse(self, what: str, i: int, reason: str) -> NoReturn:
        element = self._element(what, i)
        if element is None:
            around = self._around(what, i)
            self.refuse_part(f"{self.line(around)}: in <{around.tag}>", what, self.name(what, i), reason)
        self.refuse_part(self.line(element), element.tag, self.name(what, i), reason)

    def refuse_named(self, what: str, name: str, reason: str) -> NoReturn:
        """A part of the mechanism, by its name. "<body>/<joint>" is a body of ours, "<body>/<site>" a site that has the
        name of a body; both are frames."""
        body, _, last = name.rpartition("/")
        of_frames = ("body", name), ("site", name), ("site", last), ("body", body)
        for kind, own in {"body": of_frames[::3], "frame": of_frames}.get(what, ((what, name),)):
            names = [self.name(kind, i) for i in range(len(self._counted(kind)))]
            if own in names:
                self.refuse(kind, names.index(own), reason)
        self.refuse_element(self.root, reason)

    def _element(self, what: str, i: int) -> Element | None:
        """By its name, or by its place where the text has all elements that the model has; None for all others."""
        section, tags = _SECTIONS[what]
        found = [e for part in self.root.findall(section) for e in part.iter(*tags) if isinstance(e.tag, str)]
        named = [e for e in found if e.get("name") and e.get("name") == getattr(self.model, what)(i).name]
        listed = list(self._listed(what))
        return named[0] if named else listed[i] if len(listed) == len(self._counted(what)) else None

    def _around(self, what: str, i: int) -> Element:
        """What holds an element that is not in the text itself, as one of an attached model: a body, or the section."""
        if what in _CARRIERS and (what, i) != ("body", 0):
            carrier = int(self._counted(what)[i])
            element = self._element("body", carrier)
            return self._around("body", carrier) if element is None else element
        return [self.root, *self.root.findall(_SECTIONS[what][0])][-1]

    def _counted(self, what: str):
        return getattr(self.model, _COUNTED[what])

    def _listed(self, what: str) -> Iterator[Element]:
        """Elements in the order of the model."""
        section, tags = _SECTIONS[what]
        if section != "worldbody":
            yield from (e for part in self.root.findall(section) for e in part.iterchildren("*"))
            return
        for body in self._bodies():
            if what == "body":
                yield body[0]
            else:
                yield from (e for part in body for e in _children(part, tags))

    def _bodies(self) -> Iterator[list[Element]]:
        """The elements of every body: the world may have several."""
        worlds = self.root.findall("worldbody")
        yield worlds or [self.root]
        pending = [e for part in worlds for e in _children(part, ("body",))]
        while pending:
            body = pending.pop(0)
            yield [body]
            pending = [*_children(body, ("body",)), *pending]


def _children(element: Element, tags: tuple[str, ...]) -> Iterator[Element]:
    """Those in frames too, and those that are replicated as often as they are."""
    for part in element.iterchildren("*"):
        if part.tag in tags:
            yield part
        elif part.tag in ("frame", "replicate"):
            yield from [*_children(part, tags)] * int(part.get("count", 1))
