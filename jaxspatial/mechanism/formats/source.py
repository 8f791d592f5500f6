"""The text of a model file: what a caller may pass, and its elements."""

import importlib
import io
import pathlib
from typing import Any, NoReturn

from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.mechanism.formats.notes import Notes
from jaxspatial.mechanism.formats.numbers import range_of

Element = Any  # of lxml, which declares no types
_MARK = "\ufeff"
# By the root element of a file: what it is, and who reads it.
_FORMATS = {"robot": ("a URDF", "from_urdf"), "mujoco": ("an MJCF", "from_mjcf")}


class ModelText:
    """The text of a model file: its elements, by their lines, and what is told of it at the end."""

    def __init__(self, operation: str, path_or_text: object, dtype: DTypeLike | None):
        self.operation, self.notes = operation, Notes(operation)
        self.source, self.path = _file_source(operation, path_or_text)
        self.root = _parsed(operation, self.source, self.path is None)
        self._check_format()
        self.smallest, self.largest = range_of(dtype)

    def _check_format(self):
        tag = self.root.tag
        expected = next(tag for tag, (_, reader) in _FORMATS.items() if reader == self.operation)
        if tag != expected:
            hint = "; this is {}: read it with Mechanism.{}".format(*_FORMATS[tag]) if tag in _FORMATS else ""
            self.refuse_element(self.root, f"expected <{expected}>{hint}")

    def line(self, element: Element) -> str:
        """Where an element is; with the file, where that is another one, which this includes."""
        return f"line {element.sourceline}" + (f" of {element.base}" if element.base else "")

    def refuse_element(self, element: Element, reason: str) -> NoReturn:
        raise ValueError(f"{self.operation}: {self.line(element)}: <{element.tag}>: {reason}")

    def refuse_part(self, place: str, tag: str, name: str, reason: str) -> NoReturn:
        """One that has a name."""
        raise ValueError(f'{self.operation}: {place}: <{tag} name="{name}">: {reason}')


def _file_source(operation: str, path_or_text: object) -> tuple[bytes, pathlib.Path | None]:
    """(the bytes of a file, its path), or (those of a text, None): text is told by its first sign."""
    if isinstance(path_or_text, str):
        text = path_or_text.removeprefix(_MARK)
        if text.lstrip().startswith("<"):
            return _with_declaration_first(text).encode(), None
        _check_name(operation, text)
    if not isinstance(path_or_text, (str, pathlib.Path)):
        raise TypeError(f"{operation}: path_or_text: expected a path or text, got {type(path_or_text).__name__}")
    return pathlib.Path(path_or_text).read_bytes(), pathlib.Path(path_or_text)


def _with_declaration_first(text: str):
    """Blank lines before <?xml ...?> go behind it, where they are no error and lines keep their numbers."""
    blanks = text[: len(text) - len(text.lstrip())]
    rest = text.lstrip()
    end = rest.find("?>") + 2 if blanks and rest.startswith("<?xml") else 0
    return rest[:end] + blanks + rest[end:] if end > 1 else text


def _check_name(operation: str, text: str):
    if not text.strip():
        raise ValueError(f"{operation}: path_or_text: expected a path or text, got {text!r}")
    if "\n" in text or "\0" in text:
        shown = text if len(text) <= 40 else text[:37] + "..."
        raise ValueError(f"{operation}: path_or_text: expected a path, or text that begins with '<', got {shown!r}")


def _parsed(operation: str, source: bytes, is_text: bool) -> Element:
    """The root element. Text has no encoding but what it came in, whatever it declares."""
    etree = needed(operation, "lxml.etree")
    try:
        return etree.parse(io.BytesIO(source), etree.XMLParser(encoding="utf-8" if is_text else None)).getroot()
    except etree.XMLSyntaxError as error:
        raise ValueError(f"{operation}: malformed XML: {error}") from None


def included(path: pathlib.Path) -> Element | None:
    """The root element of a file that another includes; None where there is none."""
    etree = importlib.import_module("lxml.etree")
    try:
        return etree.parse(io.BytesIO(path.read_bytes())).getroot()
    except (OSError, etree.XMLSyntaxError):
        return None


def needed(operation: str, module: str):
    """A module of an optional package."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        raise ImportError(f"{operation}: needs the package {package}: from a clone, pip install '.[models]'") from error
