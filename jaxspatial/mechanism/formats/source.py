"""What readers of model files share: the text with its lines, the warning, numbers, and the last checks."""

import codecs
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
# {tag of the root element of what no reader takes: what to do}
_OTHERS = {
    "sdf": "this is an SDF: convert it to a URDF or an MJCF first",
    "mujocoinclude": "this is a part that models include: read one of these",
}
# How many names of each kind a warning shows.
_SHOWN = 4
# What is said before all else.
NO_INERTIA = "no inertia along coordinates, so that no torque accelerates them"
MASSLESS, IMPOSSIBLE = "mass 0 with moments", "inertia that no rigid body has"
FIRST_DOUBTS = NO_INERTIA, MASSLESS, IMPOSSIBLE
# Errors of XML that leave no doubt what is meant: prefixes that nobody declares, a version that there is not, "--" in a
# comment, "<" in an attribute, a second declaration.
_HARMLESS = {
    "NS_ERR_UNDEFINED_NAMESPACE", "NS_ERR_QNAME", "ERR_UNKNOWN_VERSION", "ERR_VERSION_MISSING",
    "ERR_HYPHEN_IN_COMMENT", "ERR_LT_IN_ATTRIBUTE", "ERR_RESERVED_XML_NAME",
}  # fmt: skip
_BEHIND = "ERR_DOCUMENT_END"  # more behind the root element
# What the parser cannot get over, and TinyXML can, by which Pinocchio and MuJoCo read: (what, what to put there). Lines
# keep their numbers.
_MENDED = (
    (re.compile(rb"-{2,}->"), b"-->"),  # comments that end by more than two
    (re.compile(rb"&(?!(\w+|#\d+|#x[0-9a-fA-F]+);)"), b"&amp;"),
    (re.compile(rb"&(?!(amp|lt|gt|quot|apos|#\w+);)"), b"&amp;"),  # of HTML, where the text declares none of its own
    (re.compile(rb"""(=\s*("[^"<>]*"|'[^'<>]*'))(?=[A-Za-z_:])"""), rb"\1 "),  # attributes with nothing between
    (re.compile(rb"<[ \t]+(?=[A-Za-z_])"), b"<"),
    (re.compile(rb"[\x01-\x08\x0b\x0c\x0e-\x1f]"), b" "),
)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
# A number of C, or one whose dot was written twice.
_NUMBER_AND_MORE = re.compile(_NUMBER.pattern + "[.fF]", re.ASCII)
# Entries of a rotation so near to 0 or 1 come from rounding quarter turns.
_ROUNDING = 8 * np.finfo(float).eps
_WIDER = "take a wider dtype, or smaller numbers"
# Numbers per generalized velocity or coordinate that are sums over a joint, its actuators and its mimics.
_OF_JOINTS = {"armature": "v", "damping": "v", "friction_loss": "v", "stiffness": "v", "spring_references": "q"}


class ModelFileWarning(UserWarning):
    """Says what of a model file may move otherwise than its author meant: doubts first, then words that are left out.

    Silence it with `warnings.simplefilter("ignore", jaxspatial.interop.ModelFileWarning)`.

    Attributes:
        doubtful: what was taken as it is, or was made into something else: names or lines by kind. First of all "no
            inertia along coordinates".
        unknown: what was left out that changes the motion, or may: words that the reader does not know, by kind.
        left_out: all that was left out, what serves pictures, contact or control too, by kind.

    Example:
        >>> import warnings
        >>> text = '<robot name="r"><link name="a"><inertial><mass value="1"/></inertial></link></robot>'
        >>> with warnings.catch_warnings(record=True) as said:
        ...     warnings.simplefilter("always")
        ...     mech = js.Mechanism.from_urdf(text, floating_base=True)
        >>> print(list(said[0].message.doubtful)[-1])
        <inertial> without inertia, taken as 0
    """

    def __init__(
        self,
        operation: str,
        doubtful: Mapping[str, Iterable[str]],
        unknown: Mapping[str, Iterable[str]],
        left_out: Mapping[str, Iterable[str]],
    ):
        lists = ({kind: tuple(names) for kind, names in x.items()} for x in (doubtful, unknown, left_out))
        self.doubtful, self.unknown, self.left_out = lists
        texts = [f"{kind} ({len(names)}: {_some(names)})" for kind, names in self.doubtful.items()]
        if self.unknown:
            kinds = tuple(f"{kind} ({len(names)})" for kind, names in self.unknown.items())
            texts.append(f"left out: {_some(kinds)}")
        super().__init__(f"{operation}: {'; '.join(texts)}")


def _some(names: tuple[str, ...]):
    return ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")


class ModelText:
    """The text of a model file: its elements with their lines, and what the reader's one warning says.

    strict: whether words that the reader does not know, and what XML and the format do not allow, are refused.
    is_read_by_another: whether elements are read for their lines alone, as what counts is read by another library.
    malformed: what XML does not allow, and the reader cannot get over; "" for nothing.
    """

    is_read_by_another, malformed = False, ""

    def __init__(self, operation: str, path_or_text: object, dtype: DTypeLike | None, strict: bool = False):
        self.operation, self.strict = operation, strict
        self.doubtful, self.unknown, self.quiet = (dict[str, list[str]]() for _ in range(3))
        self.source, self.path = _file_source(operation, path_or_text)
        self.root = self._parsed()
        if not strict and (uri := self.root.nsmap.get(None)):
            # What is in the namespace of the root and has no prefix: these are words of the format.
            for element in self.root.iter("*"):
                if element.prefix is None:
                    element.tag = element.tag.removeprefix(f"{{{uri}}}")
        tag, expected = self.root.tag, {reader: tag for tag, (_, reader) in _FORMATS.items()}[operation]
        if tag != expected:
            hint = "; this is {}: read it with Mechanism.{}".format(*_FORMATS[tag]) if tag in _FORMATS else ""
            hint = f"; {_OTHERS[tag]}" if tag in _OTHERS else hint
            if strict and tag.endswith(f"}}{expected}"):
                self.refuse_strictly(self.root, f"expected <{expected}> without a namespace")
            self.refuse_element(self.root, f"expected <{expected}>{hint}")
        finfo: Any = jnp.finfo(jax.dtypes.canonicalize_dtype(float if dtype is None else dtype))
        self.smallest, self.largest = float(finfo.tiny), float(finfo.max)  # normal numbers of the dtype

    def _parsed(self) -> Element:
        """The root element."""
        # Text is UTF-8 here, whatever encoding it declares.
        encoding = "utf-8" if self.path is None else None
        root, errors = parsed(self.operation, self.source, encoding, self.strict)
        if root is None and not self.strict and 0 < self.source.find(b"<"):
            # What a tool that made the text said first. MuJoCo and Pinocchio read what comes after it.
            before, bracket, rest = self.source.partition(b"<")
            text = _with_declaration_first(b"\n" * before.count(b"\n") + bracket + rest)
            root, errors = parsed(self.operation, text, encoding, self.strict)
            if root is not None:
                self.miss(f"text before <{word_of(root)}>", "line 1")
        behind = [e for e in errors if e.type_name == _BEHIND and not self.strict and root is not None]
        errors = [e for e in errors if e not in behind]
        if errors or root is None:
            # Of text that has no element at all, the parser says nothing.
            what = "{0.message}, line {0.line}, column {0.column}".format(errors[0]) if errors else "no element, line 1"
            self.malformed = f"malformed XML: {' '.join(what.split())}; mend the file there"
            if root is None or self.strict or not self.is_read_by_another:
                raise ValueError(f"{self.operation}: {self.malformed}")
        elif behind:
            self.miss(f"text behind </{word_of(root)}>", f"line {behind[0].line}")
        return root

    def line(self, element: Element) -> str:
        """The line of an element, with its file where that is an included one."""
        return f"line {element.sourceline}" + (f" of {element.base}" if element.base else "")

    def refuse_element(self, element: Element, reason: str) -> NoReturn:
        raise ValueError(f"{self.operation}: {self.line(element)}: <{word_of(element)}>: {reason}")

    def refuse_strictly(self, element: Element, reason: str) -> NoReturn:
        """Refuses what is read unless `strict`."""
        reason = f"{reason}; mend it, or read the file without strict=True"
        if name := element.get("name"):
            self.refuse_named(self.line(element), word_of(element), name, reason)
        self.refuse_element(element, reason)

    def refuse_named(self, place: str, tag: str, name: str, reason: str) -> NoReturn:
        raise ValueError(f'{self.operation}: {place}: <{tag} name="{name}">: {reason}')

    def leave_out(self, kind: str, name: str):
        """What is no part of a mechanism: pictures, contact, control. Nobody is warned of it."""
        self.quiet.setdefault(kind, []).append(name)

    def miss(self, kind: str, name: str):
        """What is left out though it changes the motion, or may."""
        self.unknown.setdefault(kind, []).append(name)

    def doubt(self, kind: str, name: str):
        self.doubtful.setdefault(kind, []).append(name)

    def warn(self):
        """Warns the caller of `Mechanism.from_...`, which called `read`, which called this."""
        if self.doubtful or self.unknown:
            first = [kind for kind in FIRST_DOUBTS if kind in self.doubtful]
            doubtful = {kind: self.doubtful[kind] for kind in dict.fromkeys([*first, *self.doubtful])}
            left_out = {**self.unknown, **self.quiet}
            warnings.warn(ModelFileWarning(self.operation, doubtful, self.unknown, left_out), stacklevel=4)


def parsed(operation: str, text: bytes, encoding: str | None, strict: bool) -> tuple[Element, list[Any]]:
    """(the root element, errors). The parser goes on after errors: the root counts where it found none."""
    root, errors = _tree(operation, text, encoding, () if strict else _HARMLESS)
    if errors and not strict and {e.type_name for e in errors} != {_BEHIND}:
        if any("ENCODING" in e.type_name for e in errors):
            try:
                text.decode()
                encoding = "utf-8"
            except UnicodeDecodeError:
                encoding = "iso-8859-1"
        has_entities = b"<!ENTITY" in text
        for pattern, instead in _MENDED:
            text = text if has_entities and b"amp|" in pattern.pattern else pattern.sub(instead, text)
        root, errors = _tree(operation, text, encoding, _HARMLESS)
    return root, errors


def _tree(operation: str, text: bytes, encoding: str | None, harmless: Iterable[str]):
    etree = needed(operation, "lxml.etree")
    parser = etree.XMLParser(encoding=encoding, recover=True)
    try:
        root = etree.parse(io.BytesIO(text), parser).getroot()
    except etree.XMLSyntaxError as error:
        # There is nothing to go on with: the file is empty, or no text.
        line, column = error.position
        raise ValueError(
            f"{operation}: malformed XML: {error.msg.split(',')[0]}, line {line}, column {column}; mend the file there"
        ) from None
    return root, [e for e in parser.error_log if e.type_name not in harmless and e.level_name != "WARNING"]


def word_of(element: Element, name: str | None = None) -> str:
    """The tag of an element, or the name of an attribute of it, as it is written: with the prefix of its namespace."""
    uri, _, local = (element.tag if name is None else name).removeprefix("{").rpartition("}")
    prefixes = {uri: prefix for prefix, uri in element.nsmap.items() if prefix}
    return f"{prefixes[uri]}:{local}" if uri in prefixes else local


def _file_source(operation: str, path_or_text: object) -> tuple[bytes, pathlib.Path | None]:
    """(bytes, path) of a file, or (bytes, None) of a text, which begins with "<"."""
    if isinstance(path_or_text, str):
        text = path_or_text.removeprefix(_BYTE_ORDER_MARK)
        if text.lstrip().startswith("<"):
            return _with_declaration_first(text.encode()), None
        if not text.strip():
            raise ValueError(f"{operation}: path_or_text: expected a path or text, got {text!r}")
        if "\n" in text or "\0" in text:
            shown = text if len(text) <= 40 else text[:37] + "..."
            raise ValueError(f"{operation}: path_or_text: expected a path, or text that begins with '<', got {shown!r}")
    elif not isinstance(path_or_text, pathlib.Path):
        raise TypeError(f"{operation}: path_or_text: expected a path or text, got {type(path_or_text).__name__}")
    return _with_declaration_first(pathlib.Path(path_or_text).read_bytes()), pathlib.Path(path_or_text)


def _with_declaration_first(text: bytes):
    """Moves blanks before <?xml ...?> behind it, where they are no error and lines keep their numbers. What C++ writes
    behind the text, the zero at the end of a string, is no part of it."""
    if b"\0" in text[:4]:  # UTF-16, in which every second byte is a zero
        return text
    text = text.rstrip(b"\0 \t\r\n") if text.endswith(b"\0") else text
    rest = text.removeprefix(codecs.BOM_UTF8).lstrip()
    blanks = text[: len(text) - len(rest)].removeprefix(codecs.BOM_UTF8)
    end = rest.find(b"?>") + 2 if blanks and rest.startswith(b"<?xml") else 0
    return rest[:end] + blanks + rest[end:] if end > 1 else text


def needed(operation: str, module: str, package: str = ""):
    """Imports a module of an optional package; named, where the package has another name."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = package or module.split(".")[0]
        raise ImportError(f"{operation}: needs the package {package}: from a clone, pip install '.[models]'") from error


# -- numbers ----------------------------------------------------------------------------------------------------------


def numbers_of(text: str):
    """The numbers of a text, as XML Schema writes finite decimals; None for anything else, "1_0" and "nan" too."""
    words = text.split()
    return [float(word) for word in words] if all(map(_NUMBER.fullmatch, words)) else None


def mended_numbers(text: str, n: int) -> tuple[str, str] | None:
    """(what is wrong, the text without it) of n numbers that are written as other tools read them; None where it could
    mean something else: "1,5 2" may be two numbers or three."""
    without_commas = re.sub(r",(?=\s|$)", " ", text)
    if text.count(",") == n - 1:
        without_commas = text.replace(",", " ")
    words = re.findall(r"\S+", without_commas)
    short = [word[:-1] if _NUMBER_AND_MORE.fullmatch(word) else word for word in words]
    if len(short) != n or numbers_of(" ".join(short)) is None:
        return None
    if "," in text and n > 1:
        return "commas between numbers, taken as blanks", " ".join(short)
    return ("number with a dot or an f behind it, taken without", " ".join(short)) if short != words else None


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
                reason = f"{field}: with what is welded to it beyond the numbers of {mechanism.dtype}; {_WIDER}"
                refuse(what, getattr(mechanism, f"{what}_names")[int(bad.argmax())], reason)
    for field, size in _OF_JOINTS.items():
        array, place = getattr(mechanism, field), getattr(mechanism.topology, f"{size}_slice")
        for i, name in enumerate(mechanism.joint_names):
            if not np.isfinite(array[place(i)]).all():
                reason = f"{field}: with what drives it and follows it beyond the numbers of {mechanism.dtype}"
                refuse("joint", name, f"{reason}; {_WIDER}")
    return mechanism
