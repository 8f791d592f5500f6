"""What readers of model files share: the text with its lines, the warning, strict numbers, and their last check."""

import importlib
import io
import pathlib
import re
import warnings
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NoReturn, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.assembly import BeyondNumbers
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.spatial import RigidTransform

Element = Any  # of lxml, which declares no types
Made = TypeVar("Made")  # a Mechanism
Refuse = Callable[[str, str, str], NoReturn]  # arguments: "body", "joint" or "frame"; its name; the reason

_BYTE_ORDER_MARK = "\ufeff"
# {tag of the root element: (what the file is, who reads it)}
_FORMATS = {"robot": ("a URDF", "from_urdf"), "mujoco": ("an MJCF", "from_mjcf")}
# How many names of each kind a warning shows.
_SHOWN = 4
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
# Entries of a rotation so near to 0 or 1 come from rounding quarter turns.
_ROUNDING = 8 * np.finfo(float).eps
# Numbers per generalized velocity or coordinate that are sums over a joint, its actuators and its mimics.
_OF_JOINTS = {"armature": "v", "damping": "v", "friction_loss": "v", "stiffness": "v", "spring_references": "q"}


class ModelFileWarning(UserWarning):
    """Lists what of a model file is left out of the mechanism, and what no rigid body can have.

    Silence it with `warnings.simplefilter("ignore", jaxspatial.interop.ModelFileWarning)`.

    Attributes:
        left_out: what was left out, names or lines by kind.
        doubtful: the same for what was taken as it is.
    """

    def __init__(self, operation: str, left_out: Mapping[str, Iterable[str]], doubtful: Mapping[str, Iterable[str]]):
        self.left_out = {kind: tuple(names) for kind, names in left_out.items()}
        self.doubtful = {kind: tuple(names) for kind, names in doubtful.items()}
        parts = ("left out, for it is no part of a mechanism", self.left_out), ("taken as it is", self.doubtful)
        texts = (f"{head}: {'; '.join(_counted(*item) for item in lists.items())}" for head, lists in parts if lists)
        super().__init__(f"{operation}: {'. '.join(texts)}")


def _counted(kind: str, names: tuple[str, ...]):
    some = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
    return f"{kind} ({len(names)}: {some})"


class ModelText:
    """The text of a model file: its elements with their lines, and what the reader's one warning lists."""

    def __init__(self, operation: str, path_or_text: object, dtype: DTypeLike | None):
        self.operation = operation
        self.left_out, self.doubtful = dict[str, list[str]](), dict[str, list[str]]()
        self.source, self.path = _file_source(operation, path_or_text)
        self.root = self._parsed()
        tag, expected = self.root.tag, {reader: tag for tag, (_, reader) in _FORMATS.items()}[operation]
        if tag != expected:
            hint = "; this is {}: read it with Mechanism.{}".format(*_FORMATS[tag]) if tag in _FORMATS else ""
            self.refuse_element(self.root, f"expected <{expected}>{hint}")
        finfo: Any = jnp.finfo(jax.dtypes.canonicalize_dtype(float if dtype is None else dtype))
        self.smallest, self.largest = float(finfo.tiny), float(finfo.max)  # normal numbers of the dtype

    def _parsed(self) -> Element:
        """The root element. Text is UTF-8 here, whatever encoding it declares."""
        etree = needed(self.operation, "lxml.etree")
        parser = etree.XMLParser(encoding="utf-8" if self.path is None else None)
        try:
            return etree.parse(io.BytesIO(self.source), parser).getroot()
        except etree.XMLSyntaxError as error:
            raise ValueError(f"{self.operation}: malformed XML: {error}") from None

    def line(self, element: Element) -> str:
        """The line of an element, with its file where that is an included one."""
        return f"line {element.sourceline}" + (f" of {element.base}" if element.base else "")

    def refuse_element(self, element: Element, reason: str) -> NoReturn:
        raise ValueError(f"{self.operation}: {self.line(element)}: <{element.tag}>: {reason}")

    def refuse_named(self, place: str, tag: str, name: str, reason: str) -> NoReturn:
        raise ValueError(f'{self.operation}: {place}: <{tag} name="{name}">: {reason}')

    def leave_out(self, kind: str, name: str):
        self.left_out.setdefault(kind, []).append(name)

    def doubt(self, kind: str, name: str):
        self.doubtful.setdefault(kind, []).append(name)

    def warn(self):
        """Warns the caller of `Mechanism.from_...`, which called `read`, which called this."""
        if self.left_out or self.doubtful:
            warnings.warn(ModelFileWarning(self.operation, self.left_out, self.doubtful), stacklevel=4)


def _file_source(operation: str, path_or_text: object) -> tuple[bytes, pathlib.Path | None]:
    """(bytes, path) of a file, or (bytes, None) of a text, which begins with "<"."""
    if isinstance(path_or_text, str):
        text = path_or_text.removeprefix(_BYTE_ORDER_MARK)
        if text.lstrip().startswith("<"):
            return _with_declaration_first(text).encode(), None
        if not text.strip():
            raise ValueError(f"{operation}: path_or_text: expected a path or text, got {text!r}")
        if "\n" in text or "\0" in text:
            shown = text if len(text) <= 40 else text[:37] + "..."
            raise ValueError(f"{operation}: path_or_text: expected a path, or text that begins with '<', got {shown!r}")
    elif not isinstance(path_or_text, pathlib.Path):
        raise TypeError(f"{operation}: path_or_text: expected a path or text, got {type(path_or_text).__name__}")
    return pathlib.Path(path_or_text).read_bytes(), pathlib.Path(path_or_text)


def _with_declaration_first(text: str):
    """Moves blanks before <?xml ...?> behind it, where they are no error and lines keep their numbers."""
    rest = text.lstrip()
    blanks = text[: len(text) - len(rest)]
    end = rest.find("?>") + 2 if blanks and rest.startswith("<?xml") else 0
    return rest[:end] + blanks + rest[end:] if end > 1 else text


def needed(operation: str, module: str):
    """Imports a module of an optional package."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        raise ImportError(f"{operation}: needs the package {package}: from a clone, pip install '.[models]'") from error


# -- numbers ----------------------------------------------------------------------------------------------------------


def numbers_of(text: str):
    """The numbers of a text, as XML Schema writes finite decimals; None for anything else, "1_0" and "nan" too."""
    words = text.split()
    return [float(word) for word in words] if all(map(_NUMBER.fullmatch, words)) else None


def rotation_of(entries: npt.ArrayLike):
    """(3, 3) of the entries of a rotation, in float64, without the rounding of quarter turns."""
    entries = np.asarray(entries, np.float64).reshape(3, 3)
    nearest = np.round(entries)
    return np.where(abs(entries - nearest) <= _ROUNDING, nearest, entries)


def with_moments(mass: float, X_BI: RigidTransform, moments: npt.ArrayLike):
    """M_BBo_B of a body with its centre of mass at I, and the moments (3, 3) about it in the axes of I."""
    R = X_BI.rotation.entries.reshape(3, 3)
    with in_double():
        return SpatialInertia(np.float64(mass), X_BI.translation, R @ np.asarray(moments, float) @ R.T)


def built(build: Callable[..., Made], refuse: Refuse, *parts: Any) -> Made:
    """build(*parts), refused where numbers together are beyond the dtype. Limits may be infinite."""
    try:
        with np.errstate(over="ignore"):
            mechanism: Any = build(*parts)
    except BeyondNumbers as error:
        refuse("body", error.body, error.reason)
    of_bodies = dict.fromkeys(("placements", "child_placements", "axes", "mimics"), "body")
    for field, what in {**of_bodies, "frame_placements": "frame"}.items():
        for leaf in jax.tree.leaves(getattr(mechanism, field)):
            bad = ~np.isfinite(leaf).all(tuple(range(1, leaf.ndim)))
            if bad.any():
                reason = f"{field}: with what is welded to it beyond the numbers of {mechanism.dtype}"
                refuse(what, getattr(mechanism, f"{what}_names")[int(bad.argmax())], reason)
    for field, size in _OF_JOINTS.items():
        array, place = getattr(mechanism, field), getattr(mechanism.topology, f"{size}_slice")
        for i, name in enumerate(mechanism.joint_names):
            if not np.isfinite(array[place(i)]).all():
                reason = f"{field}: with what drives it and follows it beyond the numbers of {mechanism.dtype}"
                refuse("joint", name, reason)
    return mechanism
