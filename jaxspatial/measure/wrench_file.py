"""Wrenches in files: read and checked, moved to another point and other axes, written whole or not at all.

`Npz` holds arrays, `Csv` named columns; what else is in a file is kept. Parts are "tau", "f" and, both or none, "w",
"v": arrays (n, 3). Files are read in blocks of rows, so that a file may be larger than memory.
"""

import argparse
import contextlib
import csv
import io
import itertools
import math
import os
import pathlib
import secrets
import shlex
import shutil
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, BinaryIO, NamedTuple

import jax
import numpy as np

from jaxspatial.measure import options
from jaxspatial.measure.options import PARTS, OutputError, WrenchFileError
from jaxspatial.numerics import check
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialForce, SpatialVelocity, act, rotate, shift

_REQUIRED, _OPTIONAL = ("tau", "f"), ("w", "v")
_DTYPES = tuple(np.dtype(name) for name in ("float16", "float32", "float64"))
_AXES = {3: "xyz", 4: "wxyz"}
_SEPARATORS = (",", ";", "\t")
# Rows that are read, moved and written at once: enough for speed, and as text some 60 MB.
_BLOCK = 65_536
# How a file that calls its numbers otherwise is moved.
_NAMED = "shift ... --columns tau=Mx,My,Mz f=Fx,Fy,Fz"
_NAMED_VELOCITIES = "shift ... --columns w=Wx,Wy,Wz v=Vx,Vy,Vz"
# How far the norm of a quaternion may be from 1: it is normalised, but what is further off is no quaternion.
_ROUNDED = 1e-3

Parts = dict[str, np.ndarray]


class Rows(NamedTuple):
    """Rows of a file as a format reads them: the number of the first, how many, whether there may be more, and the
    numbers (n,) or (n, k) under a name."""

    first: int
    n: int
    is_last: bool
    values: Callable[[str], np.ndarray]


class Block:
    """Rows of a file of wrenches: `parts` are arrays (n, 3), finite; `first` is the number of the first row."""

    def __init__(self, content: "Npz | Csv", rows: Rows, parts: Sequence[str]):
        self._content, self._rows, self.first = content, rows, rows.first
        self.parts = {part: self._part(part) for part in parts}
        for part, array in self.parts.items():
            self._check_numbers(part, array)

    def __len__(self):
        return self._rows.n

    def column(self, name: str) -> np.ndarray:
        """The finite numbers (n,) of a column beside the wrenches, as float64."""
        self._content.check_column(name)
        numbers = self._rows.values(name).astype(np.float64)
        bad = np.flatnonzero(~np.isfinite(numbers))
        if len(bad):
            where = f"row {self.first + bad[0] + 1}, column {name}"
            raise WrenchFileError(f"{self._content.path}: expected finite numbers, got {numbers[bad[0]]} in {where}")
        return numbers

    def check_finite(self, parts: Parts):
        """Refuses results that overflow: the first is named by its place."""
        for part, array in parts.items():
            bad = np.argwhere(~np.isfinite(array))
            if len(bad):
                raise WrenchFileError(
                    f"{self._content.path}: the {PARTS[part]} about the new point, {self._place(part, bad[0])}, is too "
                    f"large for {array.dtype} (at most {float(check.finfo(array.dtype).max):.3g})"
                    f"{self._more('; so', len(bad) - 1)}"
                )

    def _part(self, part):
        columns = [self._rows.values(name) for name in self._content.named(part)]
        return columns[0] if len(columns) == 1 else np.stack(columns, axis=-1)

    def _place(self, part, index):
        return self._content.place(part, self.first + index[0], index[1])

    def _check_numbers(self, part, array):
        dtype, where = array.dtype, f"{self._content.path}: {part}"
        if not np.issubdtype(dtype, np.floating):
            raise WrenchFileError(f"{where}: expected floating point numbers, got {dtype}")
        if dtype not in _DTYPES or not dtype.isnative:
            expected = "float16, float32 or float64 in the byte order of this machine"
            raise WrenchFileError(f"{where}: expected {expected}, got {dtype}; convert it, as with astype('float64')")
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            value, place = array[tuple(bad[0])], self._place(part, bad[0])
            more = self._more(", and so", len(bad) - 1)
            raise WrenchFileError(f"{self._content.path}: expected finite numbers, got {value} in {place}{more}")

    def _more(self, before, n):
        """How many more there are like the first, as far as is read; nothing where there are none."""
        until = "" if self._rows.is_last else f" up to row {self.first + len(self)}"
        return f"{before} {'is' if n == 1 else 'are'} {n} more{until}" if n else ""


class WrenchLog:
    """A file of wrenches, read in blocks of rows: however long it is, it takes the memory of one.

    columns: part -> names of its columns, for files that call them otherwise. What else is in the file is kept and
    written out again as it was.
    """

    def __init__(self, path: str | pathlib.Path, columns: dict[str, tuple[str, ...]] | None = None):
        self.path, columns = options.existing(pathlib.Path(path), options.ENDINGS), columns or {}
        self._content = (Npz if self.path.suffix.lower() == ".npz" else Csv)(self.path, columns)
        self._present = [part for part in PARTS if self._content.has(part)]
        self._check_parts(columns)
        self._content.check_shapes(self._present)

    @property
    def moves(self):
        """Whether the motion is known."""
        return "w" in self._present

    def left_behind(self, used: Iterable[str] = ()) -> str:
        """Says which numbers stay as they were, where the motion is not known and they may be velocities: three or
        more in a row. used: names of those that say how the wrenches move."""
        names = {*used, *itertools.chain(*map(self._content.named, self._present))}
        left = [] if self.moves else self._content.left(names)
        if sum(width for _, width in left) < 3:
            return ""
        names = ", ".join(name for name, _ in left)
        return f"as they were: {names}; if velocities are among them, name them: {_NAMED_VELOCITIES}"

    def blocks(self, rows: int) -> Iterator[Block]:
        """All of the file, so many rows at once."""
        return (Block(self._content, read, self._present) for read in self._content.rows(rows))

    def rewrite(
        self,
        file: BinaryIO,
        change: Callable[[Block], Parts],
        rows: int,
        advance: Callable[[float], Any] = lambda share: None,
    ) -> int:
        """Writes a copy into a binary file, with `change(block)` in place of the parts of each block of so many rows.

        Returns how many wrenches there are. What did not change stays as it was. `advance` hears which share of the
        work is done."""
        n = 0

        def changed(read: Rows):
            nonlocal n
            block = Block(self._content, read, self._present)
            parts = change(block)
            block.check_finite(parts)
            n = max(n, read.first + read.n)
            return {name: x for name, x in parts.items() if x.tobytes() != block.parts[name].tobytes()}

        self._content.rewrite(file, self._present, changed, rows, advance)
        return n

    def _check_parts(self, columns):
        present = self._present
        missing = [part for part in PARTS if part not in present and (part in _REQUIRED or part in columns)]
        if len(present) - len(_REQUIRED) == 1:
            missing += [part for part in _OPTIONAL if part not in (*present, *missing)]
        if missing:
            wanted = "; ".join(f"{PARTS[part]} as {self._content.expected(part)}" for part in missing)
            found = ", ".join(self._content.names) or "nothing"
            way_out = f"; if they have other names, {_NAMED}" if self._content.names and not columns else ""
            raise WrenchFileError(f"{self.path}: expected {wanted}; found {found}{way_out}")


class WrenchFile(WrenchLog):
    """A file of wrenches that is read at once: `parts` are the arrays (n, 3) that it holds."""

    def __init__(self, path: str | pathlib.Path, columns: dict[str, tuple[str, ...]] | None = None):
        super().__init__(path, columns)
        (self._block,) = self.blocks(sys.maxsize)
        self.parts = self._block.parts

    def __len__(self):
        return len(self._block)

    def write(self, file: BinaryIO, parts: Parts):
        """Writes a copy into a binary file, with `parts` in place of its own. What did not change stays as it was."""
        self.rewrite(file, lambda block: parts, sys.maxsize)

    def check_finite(self, parts: Parts):
        """Refuses results that overflow: the first is named by its place."""
        self._block.check_finite(parts)


# -- moving them -------------------------------------------------------------------------------------------------------


def convert(given: argparse.Namespace):
    """Moves the wrenches of a file as the options of `shift` say, and nothing else; returns the exit status."""
    log = WrenchLog(given.file, given.columns)

    def change(block: Block):
        offset, rotation, pose = (
            _resolved(block, name, getattr(given, name)) for name in ("offset", "rotation", "pose")
        )
        return moved(block.parts, offset, rotation, pose, given.precision)

    with staged(given.output, given.overwrite) as stream, _bar() as advance:
        n = log.rewrite(stream, change, _BLOCK, advance)
    done = {"offset": "shifted", "rotation": "rotated", "pose": "moved by their pose"}
    what = " and ".join(word for name, word in done.items() if getattr(given, name) is not None)
    print(f"{n:,} wrenches{' and velocities' if log.moves else ''} {what}: {given.output}")
    entries = itertools.chain(given.offset or (), given.rotation or (), given.pose or ())
    if left := log.left_behind(entry for entry in entries if isinstance(entry, str)):
        print(left)
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


def _resolved(block: Block, name, entries: Sequence[float | str] | None):
    """Numbers and columns as one array (k,), or (n, k) where each row has its own."""
    if entries is None:
        return None
    try:
        columns = [block.column(e) if isinstance(e, str) else e for e in entries]
    except WrenchFileError as error:
        raise WrenchFileError(f"{error}; {options.example(name)}") from error
    x = np.stack(np.broadcast_arrays(*columns), axis=-1)
    if name != "offset":
        _check_quaternions(name, x, block.first)
    return x


def _check_quaternions(name, x, first):
    norms = np.linalg.norm(x[..., :4], axis=-1)
    wrong = np.argwhere(~(abs(norms - 1) <= _ROUNDED))
    if len(wrong):
        got = f"one of norm {norms[tuple(wrong[0])]:.6g}" + (f" in row {first + wrong[0][0] + 1}" if norms.ndim else "")
        raise WrenchFileError(f"--{name}: expected a unit quaternion W X Y Z first, got {got}")


def moved(parts: dict[str, Any], offset=None, rotation=None, pose=None, precision: str | None = None) -> Parts:
    """The parts about another point, then in other axes: in the dtype they came in.

    offset: p_PQ_E (3,) or (n, 3).  rotation: quaternion wxyz of R_AE, (4,) or (n, 4).  pose: quaternion and position
    of X_AB, (7,) or (n, 7), of a file of wrenches about the origin of B, in B: they come out about that of A, in A.
    """
    dtype = parts["tau"].dtype

    def rotation_of(wxyz):
        """Rounded once, from float64."""
        return jax.tree.map(lambda x: x.astype(dtype), Rotation.from_quaternion(np.asarray(wxyz, np.float64)))

    with jax.enable_x64(True):
        vectors: list[Any] = [SpatialForce(parts["tau"], parts["f"])]
        vectors += [SpatialVelocity(parts["w"], parts["v"])] if "w" in parts else []
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


# -- files that are written whole or not at all, with the permissions of any new file, and over no other one unasked ---


@contextlib.contextmanager
def staged(path: pathlib.Path, overwrite: bool = False):
    """Yields a new binary file that takes its place at path when the block ends, and vanishes when the block fails."""
    target = options.writable(path, overwrite).resolve()
    temporary = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            # What does not fit shows here at the latest, while the place is not yet taken.
            os.fsync(file.fileno())
        _publish(temporary, target, overwrite)
    except OutputError:
        raise
    except OSError as problem:
        raise OutputError(f"{path}: not written: {problem.strerror or problem}") from problem
    finally:
        temporary.unlink(missing_ok=True)


def _publish(temporary, target, overwrite):
    if overwrite:
        return os.replace(temporary, target)
    try:
        # Unlike a renaming this fails where another file came into being meanwhile.
        os.link(temporary, target)
    except FileExistsError:
        raise
    except OSError:  # on file systems without hard links
        if os.path.lexists(target):
            raise FileExistsError(f"{target}: exists already") from None
        os.rename(temporary, target)


# -- the formats -------------------------------------------------------------------------------------------------------


class _Array(NamedTuple):
    """An array of an archive, without its numbers; `whole` are they where they cannot be read row by row."""

    shape: tuple[int, ...]
    dtype: np.dtype
    whole: np.ndarray | None


class Npz:
    """Arrays by name. A column is an array (n,), or one of an array: p_x of p (n, 3), q_w of q (n, 4), a_0 of a (n, k).

    columns: part -> name of its array, or of its three columns; others go by their own name.
    """

    def __init__(self, path: pathlib.Path, columns: dict[str, tuple[str, ...]]):
        try:
            with zipfile.ZipFile(path) as archive:
                files = [name for name in archive.namelist() if name.endswith(".npy")]
                self.arrays = {name.removesuffix(".npy"): self._described(archive, name) for name in files}
        except Exception as error:
            raise WrenchFileError(f"{path}: expected a NumPy .npz archive without pickles: {error}") from error
        self.path, self.names, self._columns = path, tuple(self.arrays), columns

    @staticmethod
    def _described(archive, name):
        with archive.open(name) as file:
            shape, is_fortran, dtype = _header(file)
        if not is_fortran:
            return _Array(shape, dtype, None)
        with archive.open(name) as file:
            return _Array(shape, dtype, np.lib.format.read_array(file, allow_pickle=False))

    def has(self, part):
        return all(self._find(name)[0] for name in self.named(part))

    def expected(self, part):
        names = self.named(part)
        return f"array '{names[0]}' of shape (n, 3)" if len(names) == 1 else f"columns {', '.join(names)}"

    def check_shapes(self, parts):
        found = {part: self._shape_and_dtype(part) for part in parts}
        (length, *_), tau = found["tau"][0] or (0,), found["tau"][1]
        if not length:
            raise WrenchFileError(f"{self.path}: expected at least one wrench, got no rows")
        for part, (shape, dtype) in found.items():
            if shape != (length, 3) or dtype != tau:
                expected = f"shape {(length, 3)} and {tau} as tau has"
                raise WrenchFileError(f"{self.path}: {part}: expected {expected}, got {shape} and {dtype}")
        self._length = length

    def check_column(self, name):
        """Refuses what is no column of as many real numbers as there are wrenches."""
        base, index = self._find(name)
        if not base:
            raise _no_column(self, name)
        shape, dtype, _ = self.arrays[base]
        is_real = np.issubdtype(dtype, np.number) and not np.issubdtype(dtype, np.complexfloating)
        if len(shape) != (1 if index is ... else 2) or not is_real:
            raise _no_column(self, name)
        if shape[0] != self._length:
            raise WrenchFileError(f"{self.path}: {name}: expected {self._length} numbers, got {shape[0]}")

    def left(self, names):
        """(array or column of one, how many numbers in a row) of those beside some names with a row for each wrench."""
        used: dict[str, set[int]] = {}
        for base, index in map(self._find, names):
            entries = range(math.prod(self.arrays[base].shape[1:])) if index is ... else [index[1]]
            used.setdefault(base, set()).update(entries)
        found: list[tuple[str, int]] = []
        for base, (shape, dtype, _) in self.arrays.items():
            if shape[:1] == (self._length,) and np.issubdtype(dtype, np.floating):
                width = math.prod(shape[1:])
                rest = [(f"{base}_{i}", 1) for i in range(width) if i not in used.get(base, ())]
                found += rest if base in used else [(base, width)]
        return found

    def place(self, part, row, column):
        names = self.named(part)
        return f"{part}[{row}, {column}]" if len(names) == 1 else f"{names[column]}[{row}]"

    def rows(self, at_once: int) -> Iterator[Rows]:
        with zipfile.ZipFile(self.path) as archive, contextlib.ExitStack() as stack:
            streams: dict[str, Any] = {}
            for begin in range(0, self._length, at_once):
                n = min(at_once, self._length - begin)
                read: dict[str, np.ndarray] = {}

                def values(name, begin=begin, n=n, read=read):
                    base, index = self._find(name)
                    if base not in read:
                        read[base] = self._next(archive, stack, streams, base, begin, n)
                    return read[base][index]

                yield Rows(begin, n, begin + n == self._length, values)

    def rewrite(self, file: BinaryIO, parts, changed, at_once: int, advance):
        """An archive holds one array after the other: all rows are read again for each one that changes."""
        places: dict[str, list[tuple[str, Any, Any]]] = {}
        for part in parts:
            names = self.named(part)
            for i, name in enumerate(names):
                base, index = self._find(name)
                places.setdefault(base, []).append((part, ... if len(names) == 1 else (..., i), index))
        done, all_rows = 0, self._length * len(places)
        with zipfile.ZipFile(self.path) as source, zipfile.ZipFile(file, "w") as target:
            for info in source.infolist():
                base = info.filename.removesuffix(".npy")
                with target.open(info.filename, "w", force_zip64=True) as out:
                    if base not in places:
                        with source.open(info) as member:
                            shutil.copyfileobj(member, out)
                        continue
                    shape, dtype, _ = self.arrays[base]
                    descr = np.lib.format.dtype_to_descr(dtype)
                    header = {"descr": descr, "fortran_order": False, "shape": shape}
                    np.lib.format.write_array_header_1_0(out, header)
                    for rows in self.rows(at_once):
                        x, new = self._own(rows, base), changed(rows)
                        for part, entries, index in places[base]:
                            if part in new:
                                x[index] = new[part][entries]
                        out.write(x.tobytes())
                        done += rows.n
                        advance(done / all_rows)

    def named(self, part):
        return self._columns.get(part, (part,))

    def _own(self, rows, base):
        """A copy of rows of a whole array."""
        return np.array(rows.values(base))

    def _find(self, name):
        """(array, index into it) of a name; no array where there is nothing of that name."""
        if name in self.arrays:
            return name, ...
        base, _, last = name.rpartition("_")
        if base in self.arrays and len(self.arrays[base].shape) == 2:
            k = self.arrays[base].shape[1]
            indices = {str(i): i for i in range(k)} | {axis: i for i, axis in enumerate(_AXES.get(k, ""))}
            if last in indices:
                return base, (..., indices[last])
        return "", ...

    def _shape_and_dtype(self, part):
        """Of the array of a part, or of its columns together."""
        found = [(self.arrays[base], index) for base, index in map(self._find, self.named(part))]
        shapes = [x.shape if index is ... else x.shape[:1] for x, index in found]
        if len(set(shapes)) > 1:
            lengths = [shape[0] if shape else 0 for shape in shapes]
            raise WrenchFileError(f"{self.path}: {part}: expected columns of one length, got {lengths}")
        shape = shapes[0] if len(shapes) == 1 else (*shapes[0], len(shapes))
        return shape, np.result_type(*(x.dtype for x, _ in found))

    def _next(self, archive, stack, streams, base, begin, n):
        """n rows of an array from `begin` on, where it was left, or from where it is kept."""
        shape, dtype, whole = self.arrays[base]
        if whole is not None:
            return whole[begin : begin + n]
        try:
            if base not in streams:
                streams[base] = stack.enter_context(archive.open(f"{base}.npy"))
                _header(streams[base])
            size = n * math.prod(shape[1:]) * dtype.itemsize
            data = streams[base].read(size)
        except (zipfile.BadZipFile, zlib.error, EOFError) as error:
            raise WrenchFileError(f"{self.path}: {base}: {error}") from error
        if len(data) != size:
            raise WrenchFileError(f"{self.path}: {base}: expected {shape[0]} rows, got fewer")
        return np.frombuffer(data, dtype).reshape(n, *shape[1:])


def _header(file):
    """(shape, whether in Fortran's order, dtype) of an array in a file, which is left where its numbers begin."""
    version = np.lib.format.read_magic(file)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read:
        raise ValueError(f"format {version} of an array")
    shape, is_fortran, dtype = read[version](file)
    if dtype.hasobject:
        raise ValueError("arrays of objects")
    return shape, is_fortran, dtype


class Csv:
    """Text in columns under names, separated by commas, semicolons or tabs; numbers are those of float64.

    columns: part -> names of its three columns, or their stem; others are found under part_x, part_y, part_z.
    """

    def __init__(self, path: pathlib.Path, columns: dict[str, tuple[str, ...]]):
        self.path, self._columns = path, columns
        lines = self._lines()
        self.names = tuple(name.strip() for name in next(lines, ()))
        self._are_names_quoted = self._quoted
        self._first = next(lines, None)
        self._check_first_line()

    def _check_first_line(self):
        first = self.names[0] if self.names else ""
        if len(first) > 1 and first.startswith(("#", "%", "//")):
            # Names behind such a sign, as many as there are numbers below, are what NumPy's savetxt writes.
            is_names = self._first is not None and len(self._first) == len(self.names) > 1
            command = "sed '1s|^[#%/ ]*||'" if is_names else "tail -n +2"
            raise WrenchFileError(
                f"{self.path}: line 1: expected names of columns, as in tau_x,tau_y,tau_z,f_x,f_y,f_z, got the comment "
                f"{first!r}; take it out: {command} {self._in_a_shell()}"
            )

    def _in_a_shell(self):
        """As what a command reads, and a file for what it writes."""
        return f"{shlex.quote(str(self.path))} > new{self.path.suffix}"

    def _lines(self):
        """The cells of all lines that are not empty; separator and ends of lines are those of the first.

        Notes whether any has quotes, and how many characters are read."""
        self._quoted, self._characters = False, 0

        def watched(file):
            for line in file:
                self._quoted = self._quoted or '"' in line
                self._characters += len(line)
                yield line

        try:
            with open(self.path, newline="", encoding="utf-8-sig") as file:
                head = file.readline()
                file.seek(0)
                self._separator = max(_SEPARATORS, key=head.count)
                self._end = "\r\n" if head.endswith("\r\n") else "\n"
                # As tuples: the garbage collector soon leaves those of text alone.
                yield from (tuple(row) for row in csv.reader(watched(file), delimiter=self._separator) if row)
        except UnicodeDecodeError as error:
            raise WrenchFileError(f"{self.path}: expected text in UTF-8: {error}") from error
        except csv.Error as error:
            raise WrenchFileError(f"{self.path}: expected rows of text: {error}") from error

    def named(self, part):
        names = self._columns.get(part, (part,))
        return tuple(f"{names[0]}_{axis}" for axis in "xyz") if len(names) == 1 else names

    def has(self, part):
        return all(name in self.names for name in self.named(part))

    def expected(self, part):
        return f"columns {', '.join(self.named(part))}"

    def check_shapes(self, parts):
        if self._first is None:
            raise WrenchFileError(f"{self.path}: expected at least one wrench, got no rows")
        for name in itertools.chain(*map(self.named, parts)):
            self.check_column(name)

    def check_column(self, name):
        if self.names.count(name) != 1:
            raise _no_column(self, name)

    def left(self, names):
        """(column, 1) of those beside some names, as of `Npz`."""
        return [(name, 1) for name in self.names if name not in names]

    def place(self, part, row, column):
        return f"row {row + 1}, column {self.named(part)[column]}"

    def rows(self, at_once: int) -> Iterator[Rows]:
        for first, table, is_last in self._tables(at_once):
            yield self._as_rows(first, table, is_last)

    def rewrite(self, file: BinaryIO, parts, changed, at_once: int, advance):
        """Numbers as the shortest text that reads back as the same number."""
        size = self.path.stat().st_size
        file.write(self._text([self.names], self._are_names_quoted))
        for first, table, is_last in self._tables(at_once):
            columns = list(zip(*table, strict=True))
            for part, x in changed(self._as_rows(first, table, is_last)).items():
                for name, numbers in zip(self.named(part), x.T, strict=True):
                    columns[self.names.index(name)] = tuple(map(repr, numbers.tolist()))
            file.write(self._text(zip(*columns, strict=True), self._quoted))
            advance(self._characters / size)

    def _tables(self, at_once):
        """(number of the first, cells by row and column, whether it is the last) of so many lines at once."""
        lines, first, n = self._lines(), 0, len(self.names)
        next(lines)
        table = list(itertools.islice(lines, at_once))
        while table:
            for i, row in enumerate(table, first):
                if len(row) != n:
                    is_doubt = self._separator == "," and len(row) > n
                    hint = "; if its numbers have decimal commas, write 1.5 for 1,5" if is_doubt else ""
                    raise WrenchFileError(f"{self.path}: row {i + 1}: expected {n} values, got {len(row)}{hint}")
            yield first, table, len(table) < at_once
            first += len(table)
            self._quoted = False
            table = list(itertools.islice(lines, at_once))

    def _as_rows(self, first, table, is_last):
        def values(name):
            j = self.names.index(name)
            try:
                return np.fromiter((float(row[j]) for row in table), np.float64, len(table))
            except ValueError:
                raise self._no_number(first, table, j) from None

        return Rows(first, len(table), is_last, values)

    def _no_number(self, first, table, j):
        """Which cell it was that is no number."""
        i, text = next((i, row[j]) for i, row in enumerate(table, first) if not _is_number(row[j]))
        hint = options.decimal_point(text)
        hint += f": tr , . < {self._in_a_shell()}" if hint else ""
        where = f"row {i + 1}, column {self.names[j]}"
        return WrenchFileError(f"{self.path}: expected a number, got {text!r} in {where}{hint}")

    def _text(self, rows, is_quoted):
        """Rows as bytes. Without quotes anywhere no cell needs any, which is quick."""
        if is_quoted:
            text = io.StringIO()
            csv.writer(text, delimiter=self._separator, lineterminator=self._end).writerows(rows)
            return text.getvalue().encode()
        return "".join(f"{line}{self._end}" for line in map(self._separator.join, rows)).encode()


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True


def _no_column(table: Npz | Csv, name):
    count, found = table.names.count(name), ", ".join(table.names) or "nothing"
    number = f"{count} of that name" if count > 1 else "no numbers of that name"
    return WrenchFileError(f"{table.path}: expected one column {name!r}, got {number}; found {found}")
