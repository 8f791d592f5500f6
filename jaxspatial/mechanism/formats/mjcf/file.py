"""A compiled model of MuJoCo, and where in the text its elements are."""

import pathlib
from typing import NoReturn

import numpy as np

from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.mechanism.formats.source import Element, ModelText, needed
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
_COUNTS = {"joint": "njnt", "site": "nsite"}
_COUNTED = {"eq": "eq_type", "tendon": "tendon_num", "actuator": "actuator_trntype"}
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
        self._check_finite()
        try:
            # By its path, so that MuJoCo finds what the file includes.
            text, path = mujoco.MjModel.from_xml_string, mujoco.MjModel.from_xml_path
            self.model = text(self.source.decode()) if self.path is None else path(str(self.path))
        except ValueError as error:
            raise ValueError(f"from_mjcf: MuJoCo says {' '.join(str(error).split())}") from None
        bits = mujoco.mjtDisableBit.__members__
        self.disabled = {
            name for name, bit in bits.items() if "DSBL" in name and self.model.opt.disableflags & int(bit)
        }
        self.equalities = {int(value): name for name, value in mujoco.mjtEq.__members__.items()}
        self.on_joints = int(mujoco.mjtTrn.mjTRN_JOINT)

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

    def refuse(self, what: str, i: int, reason: str) -> NoReturn:
        element = self._element(what, i)
        self.refuse_part(element, what if element is None else element.tag, self.name(what, i), reason)

    def refuse_named(self, what: str, name: str, reason: str) -> NoReturn:
        """By its name; a body of ours between the joints of one of theirs is not among them."""
        names = [self.name(what, i) for i in range(getattr(self.model, f"n{what}"))]
        self.refuse(what, names.index(name) if name in names else names.index(name.rpartition("/")[0]), reason)

    def _element(self, what: str, i: int) -> Element | None:
        """By its name, or by its place where the text has all elements that the model has; None for all others."""
        section, tags = _SECTIONS[what]
        found = [e for part in self.root.findall(section) for e in part.iter(*tags) if isinstance(e.tag, str)]
        named = [e for e in found if e.get("name") and e.get("name") == getattr(self.model, what)(i).name]
        listed, n = self._listed(what)
        return named[0] if named else listed[i] if len(listed) == n else None

    def _listed(self, what: str) -> tuple[list[Element], int]:
        """(elements in the order of the model, how many it has)."""
        section, _ = _SECTIONS[what]
        bodies = [e for part in self.root.findall("worldbody") for e in (part, *part.iter("body"))]
        if what == "body":
            return bodies, self.model.nbody
        if section == "worldbody":
            tags = _SECTIONS[what][1]
            return [e for body in bodies for e in body.iterchildren(*tags)], getattr(self.model, _COUNTS[what])
        listed = [e for part in self.root.findall(section) for e in part.iterchildren("*")]
        return listed, len(getattr(self.model, _COUNTED[what]))
