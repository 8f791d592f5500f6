"""Wrenches in files: checked when read, written whole or not at all."""

import pathlib
from typing import BinaryIO

import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.command import files
from jaxspatial.command.files import WrenchFileError as WrenchFileError
from jaxspatial.command.names import PARTS
from jaxspatial.command.tables import Csv, Named, Npz, Parts

_REQUIRED, _OPTIONAL = ("tau", "f"), ("w", "v")
_READERS: dict[str, type[Npz | Csv]] = dict(zip(files.ENDINGS, (Npz, Csv, Csv), strict=True))
_DTYPES = tuple(np.dtype(name) for name in ("float16", "float32", "float64"))


class WrenchFile:
    """A file of wrenches: `parts` are the arrays (n, 3) it holds under "tau", "f" and, both or none, "w", "v".

    named: part -> names of its columns, for files that call them otherwise. What else is in the file is kept and
    written out again as it was.
    """

    def __init__(self, path: str | pathlib.Path, named: Named | None = None):
        self.path = files.existing(pathlib.Path(path), files.ENDINGS)
        self._content = _READERS[self.path.suffix.lower()](self.path, named or {})
        self.parts = _checked(self.path, self._content, named or {})

    @property
    def moves(self):
        """Whether the motion is known."""
        return "w" in self.parts

    def __len__(self):
        return len(self.parts["tau"])

    def column(self, name: str) -> np.ndarray:
        """The finite numbers (n,) of a column beside the wrenches, as float64."""
        numbers = self._content.column(name)
        if len(numbers) != len(self):
            raise WrenchFileError(f"{self.path}: {name}: expected {len(self)} numbers, got {len(numbers)}")
        bad = np.flatnonzero(~np.isfinite(numbers))
        if len(bad):
            where = f"row {bad[0] + 1}, column {name}"
            raise WrenchFileError(f"{self.path}: expected finite numbers, got {numbers[bad[0]]} in {where}")
        return numbers

    def write(self, file: BinaryIO, parts: Parts):
        """Writes a copy into a binary file, with `parts` in place of its own. What did not change stays as it was."""
        changed = {name: x for name, x in parts.items() if x.tobytes() != self.parts[name].tobytes()}
        self._content.write(file, changed)

    def check_finite(self, parts: Parts):
        """Refuses results that overflow: the first is named by its place."""
        for part, array in parts.items():
            bad = np.argwhere(~np.isfinite(array))
            if len(bad):
                where = self._content.place(part, *bad[0])
                raise WrenchFileError(
                    f"{self.path}: the {PARTS[part]} about the new point, {where}, is too large for {array.dtype} "
                    f"(at most {float(check.finfo(array.dtype).max):.3g}){_more('; so', len(bad) - 1)}"
                )


def _checked(path: pathlib.Path, content: Npz | Csv, named: Named):
    present = [part for part in (*_REQUIRED, *_OPTIONAL) if content.has(part)]
    missing = [part for part in PARTS if part not in present and (part in _REQUIRED or part in named)]
    if len(present) - len(_REQUIRED) == 1:
        missing += [part for part in _OPTIONAL if part not in (*present, *missing)]
    if missing:
        wanted = "; ".join(f"{PARTS[part]} as {content.expected(part)}" for part in missing)
        raise WrenchFileError(f"{path}: expected {wanted}; found {', '.join(content.names) or 'nothing'}")
    parts = {part: content.read(part) for part in present}
    _check_shapes(path, parts)
    for part, array in parts.items():
        _check_numbers(path, part, array, content)
    return parts


def _check_shapes(path: pathlib.Path, parts: Parts):
    n = len(parts["tau"]) if parts["tau"].ndim else 0
    if n == 0:
        raise WrenchFileError(f"{path}: expected at least one wrench, got no rows")
    for part, array in parts.items():
        if array.shape != (n, 3) or array.dtype != parts["tau"].dtype:
            raise WrenchFileError(
                f"{path}: {part}: expected shape {(n, 3)} and {parts['tau'].dtype} as tau has, "
                f"got {array.shape} and {array.dtype}"
            )


def _check_numbers(path: pathlib.Path, part: str, array: np.ndarray, content: Npz | Csv):
    _check_dtype(path, part, array.dtype)
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        row, column = bad[0]
        raise WrenchFileError(
            f"{path}: expected finite numbers, got {array[row, column]} in {content.place(part, row, column)}"
            f"{_more(', and so', len(bad) - 1)}"
        )


def _more(before: str, n: int):
    """How many more there are like the first; nothing where there are none."""
    return f"{before} {'is' if n == 1 else 'are'} {n} more" if n else ""


def _check_dtype(path: pathlib.Path, part: str, dtype: np.dtype):
    if not np.issubdtype(dtype, np.floating):
        raise WrenchFileError(f"{path}: {part}: expected floating point numbers, got {dtype}")
    if dtype not in _DTYPES or not dtype.isnative:
        names = "float16, float32 or float64 in the byte order of this machine"
        raise WrenchFileError(f"{path}: {part}: expected {names}, got {dtype}; convert it, as with astype('float64')")
