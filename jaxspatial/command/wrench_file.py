"""Wrenches in a file: moved to another point and other axes, and written with all else that the file holds.

A file is columns of numbers under names: those of a .csv, or of a .npz its arrays (n,) and the columns of its arrays
(n, k). It has the force, and may have the torque, and the velocities w and v of the body. Where there is no torque, the
forces act at the point itself. A .csv is read and written in blocks of rows, and may be larger than memory.
"""

import argparse
import contextlib
import csv
import io
import itertools
import pathlib
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, BinaryIO

import jax
import numpy as np

from jaxspatial.command import files
from jaxspatial.command.files import WrenchFileError
from jaxspatial.command.options import ENDINGS, PARTS, decimal_point, example, number_of
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialForce, SpatialVelocity, act, rotate, shift

_DTYPES = ("float16", "float32", "float64")
_AXES = {3: "xyz", 4: "wxyz"}
# Rows of text that are read, moved and written at once: enough for speed, some 60 MB.
_BLOCK = 65_536
_NAMED = "--columns tau=Mx,My,Mz f=Fx,Fy,Fz w=Wx,Wy,Wz v=Vx,Vy,Vz"
_UNMOVED = f"; what is a velocity among them moves once it is named: {_NAMED}"
# How far the norm of a quaternion may be from 1: it is normalised, but what is further off is no quaternion.
_ROUNDED = 1e-3

Parts = dict[str, Any]  # arrays (n, 3)


# -- what a file holds -------------------------------------------------------------------------------------------------


class Archive:
    """The arrays of a .npz; its columns are views of them."""

    first = 0

    def __init__(self, path: pathlib.Path):
        self.path = path
        # NumPy takes what has no other beginning for a pickle, and advises to load that.
        if not zipfile.is_zipfile(path):
            raise WrenchFileError(f"{path}: expected a NumPy .npz archive of arrays, got no archive")
        try:
            with np.load(path, allow_pickle=False) as file:
                self.arrays = dict(file)
        except (ValueError, EOFError, AttributeError, zipfile.BadZipFile, zlib.error) as error:
            raise WrenchFileError(f"{path}: expected a NumPy .npz archive of arrays: {error}") from error
        self.columns: dict[str, np.ndarray] = {}
        for name, x in self.arrays.items():
            if x.ndim == 1:
                self.columns[name] = x
            elif x.ndim == 2:
                axes = _AXES.get(x.shape[1], map(str, range(x.shape[1])))
                self.columns |= {f"{name}_{axis}": x[:, i] for i, axis in enumerate(axes)}
        self.names = list(self.columns)

    def numbers(self, name: str) -> np.ndarray:
        return self.columns[name]

    def put(self, names: Sequence[str], x: np.ndarray) -> None:
        """Stores a part (n, 3), in columns that are there or in an array of its own."""
        if names[0] not in self.columns:
            self.arrays[names[0].removesuffix("_x")] = x
        for name, column in zip(names, x.T, strict=True) if names[0] in self.columns else ():
            self.columns[name][:] = column

    def write(self, file: BinaryIO) -> None:
        np.savez(file, **self.arrays)


class Text:
    """Rows of a .csv, the first of them number `first`; numbers are those of float64."""

    def __init__(self, path: pathlib.Path, first: int, names: list[str], rows: list[list[str]], style: dict[str, Any]):
        self.path, self.first, self.names, self._n, self._style = path, first, list(names), len(rows), style
        for i, row in enumerate(rows, first + 1):
            if len(row) != len(names):
                hint = "; numbers have decimal points, not commas" if style["delimiter"] == "," else ""
                raise WrenchFileError(f"{path}: row {i}: expected {len(names)} values, got {len(row)}{hint}")
        self._columns = [list(column) for column in zip(*rows, strict=True)]

    def numbers(self, name: str) -> np.ndarray:
        cells = self._columns[self.names.index(name)]
        try:
            return np.fromiter(map(float, cells), np.float64, self._n)
        except ValueError:
            i, text = next((i, text) for i, text in enumerate(cells) if number_of(text, float) is None)
            where = f"row {self.first + i + 1}, column {name}"
            hint = decimal_point(text)
            raise WrenchFileError(f"{self.path}: expected a number, got {text!r} in {where}{hint}") from None

    def put(self, names: Sequence[str], x: np.ndarray) -> None:
        """Stores a part (n, 3), as the shortest text that reads back as the same numbers."""
        for name, column in zip(names, x.T, strict=True):
            cells = list(map(repr, column.tolist()))
            if name in self.names:
                self._columns[self.names.index(name)] = cells
            else:
                self.names.append(name)
                self._columns.append(cells)

    def write(self, file: BinaryIO) -> None:
        text = io.StringIO()
        writer = csv.writer(text, **self._style)
        if not self.first:
            writer.writerow(self.names)
        writer.writerows(zip(*self._columns, strict=True))
        file.write(text.getvalue().encode())


def _texts(path: pathlib.Path, rows: int, advance: Callable[[float], Any] = lambda share: None) -> Iterator[Text]:
    """All of a .csv, so many rows at once; separator and ends of lines are those of its first line."""
    read, size = 0, path.stat().st_size

    def counted(file):
        nonlocal read
        for line in file:
            read += len(line)
            yield line

    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            head = file.readline()
            file.seek(0)
            style = {
                "delimiter": max(",;\t", key=head.count),
                "lineterminator": "\r\n" if head.endswith("\r\n") else "\n",
            }
            lines = (row for row in csv.reader(counted(file), delimiter=style["delimiter"]) if row)
            names, first = [name.strip() for name in next(lines, [])], 0
            if names:  # NumPy's savetxt writes them as a comment; "#" alone is a name
                names[0] = names[0].lstrip("#% ") or names[0]
            while block := list(itertools.islice(lines, rows)):
                yield Text(path, first, names, block, style)
                first += len(block)
                advance(read / size)
    except (UnicodeDecodeError, csv.Error) as error:
        raise WrenchFileError(f"{path}: expected text in UTF-8: {error}") from error
    if not first:
        found = f"; found {', '.join(names)}" if names else ", found nothing"
        raise WrenchFileError(f"{path}: expected at least one wrench, got no rows{found}")


class WrenchFile:
    """A file of wrenches. columns: part -> its three columns or their stem, where the file calls them otherwise."""

    def __init__(self, path: str | pathlib.Path, columns: dict[str, tuple[str, ...]] | None = None):
        self.path, columns = files.existing(pathlib.Path(path), ENDINGS), columns or {}
        stems = {part: columns.get(part, (part,)) for part in PARTS}
        self._columns = {p: tuple(f"{x[0]}_{i}" for i in "xyz") if len(x) == 1 else x for p, x in stems.items()}
        self.names = next(self.tables(rows=1)).names
        self.present = [part for part in PARTS if set(self._columns[part]) <= set(self.names)]
        partly = [part for part in PARTS if set(self._columns[part]) & set(self.names)]
        needed = {"f", *partly, *columns, *({"w", "v"} if {"w", "v"} & {*partly} else ())}
        missing = [part for part in PARTS if part in needed and part not in self.present]
        if missing:
            wanted = "; ".join(f"{PARTS[part]} as columns {', '.join(self._columns[part])}" for part in missing)
            found, way_out = ", ".join(self.names) or "nothing", "" if columns else f"; if named otherwise: {_NAMED}"
            raise WrenchFileError(f"{self.path}: expected {wanted}; found {found}{way_out}")

    def tables(self, rows: int = _BLOCK, advance: Callable[[float], Any] = lambda share: None):
        """All of the file: a .npz at once, a .csv so many rows at once."""
        return iter([Archive(self.path)]) if self.path.suffix.lower() == ".npz" else _texts(self.path, rows, advance)

    def parts(self, table: Archive | Text) -> Parts:
        """Arrays (n, 3) of finite numbers: f, and tau, w, v if the file has them."""
        found = {part: self._part(table, part) for part in self.present}
        lengths = {part: len(x) for part, x in found.items()}
        if set(lengths.values()) != {lengths["f"]} or not lengths["f"]:
            raise WrenchFileError(f"{self.path}: expected at least one wrench, all parts of one length, got {lengths}")
        return found

    def all_parts(self) -> Parts:
        """Those of the whole file."""
        blocks = [self.parts(table) for table in self.tables()]
        return {part: np.concatenate([block[part] for block in blocks]) for part in self.present}

    def rewrite(
        self, file: BinaryIO, change: Callable[[Archive | Text, Parts], Parts], advance: Callable[[float], Any]
    ) -> int:
        """Writes a copy with `change(table, parts)` in place of the parts; returns how many wrenches there are.

        What did not change stays as it was, down to the spelling of numbers."""
        n = 0
        for table in self.tables(_BLOCK, advance):
            parts = self.parts(table)
            for part, x in change(table, parts).items():
                self._require_finite(table, part, x, f"the {PARTS[part]} about the new point is too large, ")
                if part not in parts or not np.array_equal(x, parts[part]):
                    table.put(self._columns[part], x)
            table.write(file)
            n += len(parts["f"])
        return n

    def left_behind(self, used: Sequence[str] = ()) -> list[str]:
        """The columns that stay as they were and say nothing about how the wrenches move."""
        named = {name for part in self.present for name in self._columns[part]}
        return [name for name in self.names if name not in named and name not in used]

    def _part(self, table, part):
        x = [column(table, name) for name in self._columns[part]]
        if len({len(c) for c in x}) > 1:
            raise WrenchFileError(f"{self.path}: {part}: expected columns of one length, got {[len(c) for c in x]}")
        dtype = np.result_type(*x)
        if str(dtype.newbyteorder("=")) not in _DTYPES:
            raise WrenchFileError(f"{self.path}: {part}: expected {', '.join(_DTYPES)} numbers, got {dtype}")
        x = np.stack(x, axis=-1).astype(dtype.newbyteorder("="))
        self._require_finite(table, part, x)
        return x

    def _require_finite(self, table, part, x, what="expected finite numbers, "):
        bad = np.argwhere(~np.isfinite(x))
        if len(bad):
            where = f"row {table.first + bad[0, 0] + 1}, column {self._columns[part][bad[0, 1]]}"
            raise WrenchFileError(f"{self.path}: {what}got {x[tuple(bad[0])]} in {where}, in {x.dtype}")


def column(table: Archive | Text, name: str) -> np.ndarray:
    """The numbers (n,) under a name that comes once."""
    if (count := table.names.count(name)) != 1:
        number = f"{count} of that name" if count else "no numbers of that name"
        raise WrenchFileError(
            f"{table.path}: expected one column {name!r}, got {number}; found {', '.join(table.names)}"
        )
    return table.numbers(name)


# -- moving them -------------------------------------------------------------------------------------------------------


def convert(given: argparse.Namespace):
    """Moves the wrenches of a file as the options of `shift` say, and nothing else; returns the exit status."""
    log = WrenchFile(given.file, given.columns)
    motion = {name: getattr(given, name) for name in ("offset", "rotation", "pose")}

    def change(table, parts):
        resolved = {name: _resolved(table, name, len(parts["f"]), entries) for name, entries in motion.items()}
        return moved(parts, **resolved, precision=given.precision)

    with files.staged(given.output, given.overwrite) as stream, _bar() as advance:
        n = log.rewrite(stream, change, advance)
    done = {"offset": "shifted", "rotation": "rotated", "pose": "moved by their pose"}
    what = "wrenches and velocities" if "w" in log.present else "wrenches"
    print(f"{n:,} {what} {' and '.join(done[name] for name, x in motion.items() if x is not None)}: {given.output}")
    if "tau" not in log.present:
        print(f"the file has no torques tau_x, tau_y, tau_z: its forces act at their point; otherwise: {_NAMED}")
    used = [entry for entries in motion.values() for entry in entries or () if isinstance(entry, str)]
    if left := log.left_behind(used):
        print(f"as they were: {', '.join(left)}{'' if 'w' in log.present else _UNMOVED}")
    return 0


@contextlib.contextmanager
def _bar():
    """Yields what shows which share of the work is done: a bar, where rich is installed and somebody sees it."""
    try:
        from rich import progress
        from rich.console import Console
    except ImportError:
        yield lambda share: None
        return
    console = Console(stderr=True)
    columns = (progress.BarColumn(), progress.TaskProgressColumn(), progress.TimeRemainingColumn())
    with progress.Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda share: bar.update(task, completed=share)


def _resolved(table, name, n, entries: Sequence[float | str] | None):
    """Numbers and columns as one array (k,), or (n, k) where each row has its own."""
    if entries is None:
        return None
    try:
        x = [column(table, e).astype(np.float64) if isinstance(e, str) else np.float64(e) for e in entries]
    except WrenchFileError as error:
        raise WrenchFileError(f"{error}; {example(name)}") from error
    for entry, numbers in zip(entries, x, strict=True):
        if np.shape(numbers) not in ((), (n,)) or not np.isfinite(numbers).all():
            row = table.first + 1 + int(np.argmin(np.isfinite(numbers)))
            raise WrenchFileError(f"{table.path}: expected {n} finite numbers, got others in row {row}, column {entry}")
    x = np.stack(np.broadcast_arrays(*x), axis=-1)
    if name != "offset":
        norms = np.linalg.norm(x[..., :4], axis=-1)
        wrong = np.argwhere(~(abs(norms - 1) <= _ROUNDED))
        if len(wrong):
            where = f" in row {table.first + wrong[0][0] + 1}" if norms.ndim else ""
            got = f"one of norm {norms[tuple(wrong[0])]:.6g}{where}"
            raise WrenchFileError(f"--{name}: expected a unit quaternion W X Y Z first, got {got}")
    return x


def moved(parts: Parts, offset=None, rotation=None, pose=None, precision: str | None = None) -> Parts:
    """The parts about another point, then in other axes, in the dtype of the force. Torques that are not known are 0.

    offset: p_PQ_E (3,) or (n, 3).  rotation: quaternion wxyz of R_AE, (4,) or (n, 4).  pose: quaternion and position
    of X_AB, (7,) or (n, 7), of a file of wrenches about the origin of B, in B: they come out about that of A, in A.
    """
    dtype = parts["f"].dtype

    def rotation_of(wxyz):
        """Rounded once, from float64."""
        return jax.tree.map(lambda x: x.astype(dtype), Rotation.from_quaternion(np.asarray(wxyz, np.float64)))

    with jax.enable_x64(True):
        tau = parts["tau"].astype(dtype) if "tau" in parts else np.zeros_like(parts["f"])
        vectors: list[Any] = [SpatialForce(tau, parts["f"])]
        if "w" in parts:
            vectors.append(SpatialVelocity(parts["w"].astype(dtype), parts["v"].astype(dtype)))
        if offset is not None:
            p = np.asarray(offset).astype(dtype)
            vectors = [shift(X, p, precision=precision) for X in vectors]
        if rotation is not None:
            R_AE = rotation_of(rotation)
            vectors = [rotate(R_AE, X, precision=precision) for X in vectors]
        if pose is not None:
            X_AB = RigidTransform(rotation_of(pose[..., :4]), np.asarray(pose[..., 4:]).astype(dtype))
            vectors = [act(X_AB, X, precision=precision) for X in vectors]
        arrays = [np.asarray(x) for X in vectors for x in (X.rotational, X.translational)]
    return dict(zip(PARTS, arrays, strict=False))
