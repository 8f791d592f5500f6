"""What readers of model files have in common: what a caller may pass, strict numbers, and what is said of the rest."""

import importlib
import io
import pathlib
import re
import warnings

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.known import in_double
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism import Mechanism

# Entries of a rotation so near to 0 or 1 are what rounding made of quarter turns.
_ROUNDING = 8 * np.finfo(float).eps
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_MARK = "\ufeff"
_SHOWN = 4


class ModelFileWarning(UserWarning):
    """What a file has that is no part of the mechanism made of it, or that no rigid body can have.

    left_out: names (or lines) of what was left out, by kind
    doubtful: likewise, what was taken as it is
    Silence it with `warnings.simplefilter("ignore", jaxspatial.interop.ModelFileWarning)`.
    """

    def __init__(self, operation, left_out, doubtful):
        self.left_out = {kind: tuple(names) for kind, names in left_out.items()}
        self.doubtful = {kind: tuple(names) for kind, names in doubtful.items()}
        heads = ("left out, for it is no part of a mechanism", self.left_out), ("taken as it is", self.doubtful)
        said = (f"{head}: {'; '.join(_counted(*item) for item in found.items())}" for head, found in heads if found)
        super().__init__(f"{operation}: {'. '.join(said)}")


def _counted(kind, names):
    some = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
    return f"{kind} ({len(names)}: {some})"


class Notes:
    """What a reader has to tell about a file, once, at its end."""

    def __init__(self, operation):
        self.operation, self.left_out, self.doubtful = operation, {}, {}

    def leave_out(self, kind, name):
        self.left_out.setdefault(kind, []).append(name)

    def doubt(self, kind, name):
        self.doubtful.setdefault(kind, []).append(name)

    def tell(self, stacklevel=4):
        """To whom called `Mechanism.from_...`: by way of it, of a reader, and of this."""
        if self.left_out or self.doubtful:
            warnings.warn(ModelFileWarning(self.operation, self.left_out, self.doubtful), stacklevel=stacklevel)


# -- sources ----------------------------------------------------------------------------------------------------------


def file_source(operation, path_or_text):
    """(the bytes of a file, its path), or (those of a text, None): text is told by its first sign."""
    if isinstance(path_or_text, str):
        text = path_or_text.removeprefix(_MARK)
        if text.lstrip().startswith("<"):
            return _with_declaration_first(text).encode(), None
        _check_name(operation, text)
    if not isinstance(path_or_text, (str, pathlib.Path)):
        raise TypeError(f"{operation}: path_or_text: expected a path or text, got {type(path_or_text).__name__}")
    return pathlib.Path(path_or_text).read_bytes(), pathlib.Path(path_or_text)


def _with_declaration_first(text):
    """Blank lines before <?xml ...?> go behind it, where they are no error and lines keep their numbers."""
    blanks = text[: len(text) - len(text.lstrip())]
    rest = text.lstrip()
    end = rest.find("?>") + 2 if blanks and rest.startswith("<?xml") else 0
    return rest[:end] + blanks + rest[end:] if end > 1 else text


def _check_name(operation, text):
    if not text.strip():
        raise ValueError(f"{operation}: path_or_text: expected a path or text, got {text!r}")
    if "\n" in text or "\0" in text:
        shown = text if len(text) <= 40 else text[:37] + "..."
        raise ValueError(f"{operation}: path_or_text: expected a path, or text that begins with '<', got {shown!r}")


def parsed(operation, source, is_text):
    """The root element. Text has no encoding but what it came in, whatever it declares."""
    etree = needed(operation, "lxml.etree")
    try:
        return etree.parse(io.BytesIO(source), etree.XMLParser(encoding="utf-8" if is_text else None)).getroot()
    except etree.XMLSyntaxError as error:
        raise ValueError(f"{operation}: malformed XML: {error}") from None


def needed(operation, module):
    """A module of an optional package."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.split(".")[0]
        raise ImportError(f"{operation}: needs the package {package}: pip install jaxspatial[models]") from error


# -- numbers ----------------------------------------------------------------------------------------------------------


def numbers_of(text):
    """The numbers of a text, as XML Schema writes finite decimals; None for anything else, "1_0" and "nan" too."""
    words = text.split()
    return [float(word) for word in words] if all(map(_NUMBER.fullmatch, words)) else None


def range_of(dtype):
    """(the smallest normal, the largest) number of a dtype, JAX's default for None."""
    info = jnp.finfo(jax.dtypes.canonicalize_dtype(float if dtype is None else dtype))
    return float(info.tiny), float(info.max)


def built(refuse, bodies, joints, frames, gravity, dtype):
    """`Mechanism.build`; refuse(body, reason) where what numbers make together is none of the dtype."""
    with np.errstate(over="ignore"):
        mechanism = Mechanism.build(bodies, joints, frames, gravity, dtype)
    _check_finite(mechanism, refuse)
    return mechanism


def _check_finite(mechanism, refuse):
    """Limits may be infinite."""
    for field in ("placements", "child_placements", "axes", "mimics", "inertias"):
        for leaf in jax.tree.leaves(getattr(mechanism, field)):
            bad = ~np.isfinite(leaf).all(tuple(range(1, leaf.ndim)))
            if bad.any():
                reason = f"{field}: with what is welded to it beyond the numbers of {mechanism.dtype}"
                refuse(mechanism.body_names[int(bad.argmax())], reason)


def rotation_of(entries):
    """(3, 3) of the entries of a rotation, in float64, without the rounding of quarter turns."""
    entries = np.asarray(entries, np.float64).reshape(3, 3)
    nearest = np.round(entries)
    return np.where(abs(entries - nearest) <= _ROUNDING, nearest, entries)


def with_moments(mass, X_BI, moments):
    """M_BBo_B of a body with its centre of mass at I, and the (3, 3) moments about it in the axes of I."""
    R = X_BI.rotation.entries.reshape(3, 3)
    with in_double():
        return SpatialInertia(np.float64(mass), X_BI.translation, R @ np.asarray(moments, float) @ R.T)
