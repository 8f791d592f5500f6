"""Wrenches in files: read and checked, moved to another point and other axes, written whole or not at all.

`Npz` holds arrays, `Csv` named columns; what else is in a file is kept. Parts are "tau", "f" and, both or none, "w",
"v": arrays (n, 3).
"""

import argparse
import contextlib
import csv
import io
import os
import pathlib
import secrets
import shlex
from collections.abc import Sequence
from typing import Any, BinaryIO

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
# Rows that are made text at once: enough for speed, little next to the table.
_ROWS = 10_000
# How far the norm of a quaternion may be from 1: it is normalised, but what is further off is no quaternion.
_ROUNDED = 1e-3

Parts = dict[str, np.ndarray]


class WrenchFile:
    """A file of wrenches: `parts` are the arrays (n, 3) that it holds.

    columns: part -> names of its columns, for files that call them otherwise. What else is in the file is kept and
    written out again as it was.
    """

    def __init__(self, path: str | pathlib.Path, columns: dict[str, tuple[str, ...]] | None = None):
        self.path, columns = options.existing(pathlib.Path(path), options.ENDINGS), columns or {}
        self._content = (Npz if self.path.suffix.lower() == ".npz" else Csv)(self.path, columns)
        present = [part for part in PARTS if self._content.has(part)]
        self._check_parts(present, columns)
        self.parts = {part: self._content.read(part) for part in present}
        self._check_shapes()
        for part, array in self.parts.items():
            self._check_numbers(part, array)

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

    def _check_parts(self, present, columns):
        missing = [part for part in PARTS if part not in present and (part in _REQUIRED or part in columns)]
        if len(present) - len(_REQUIRED) == 1:
            missing += [part for part in _OPTIONAL if part not in (*present, *missing)]
        if missing:
            wanted = "; ".join(f"{PARTS[part]} as {self._content.expected(part)}" for part in missing)
            found = ", ".join(self._content.names) or "nothing"
            raise WrenchFileError(f"{self.path}: expected {wanted}; found {found}")

    def _check_shapes(self):
        tau = self.parts["tau"]
        if not tau.ndim or not len(tau):
            raise WrenchFileError(f"{self.path}: expected at least one wrench, got no rows")
        for part, x in self.parts.items():
            if x.shape != (len(tau), 3) or x.dtype != tau.dtype:
                expected = f"shape {(len(tau), 3)} and {tau.dtype} as tau has"
                raise WrenchFileError(f"{self.path}: {part}: expected {expected}, got {x.shape} and {x.dtype}")

    def _check_numbers(self, part, array):
        dtype, where = array.dtype, f"{self.path}: {part}"
        if not np.issubdtype(dtype, np.floating):
            raise WrenchFileError(f"{where}: expected floating point numbers, got {dtype}")
        if dtype not in _DTYPES or not dtype.isnative:
            expected = "float16, float32 or float64 in the byte order of this machine"
            raise WrenchFileError(f"{where}: expected {expected}, got {dtype}; convert it, as with astype('float64')")
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            value, place = array[tuple(bad[0])], self._content.place(part, *bad[0])
            more = _more(", and so", len(bad) - 1)
            raise WrenchFileError(f"{self.path}: expected finite numbers, got {value} in {place}{more}")


def _more(before, n):
    """How many more there are like the first; nothing where there are none."""
    return f"{before} {'is' if n == 1 else 'are'} {n} more" if n else ""


# -- moving them -------------------------------------------------------------------------------------------------------


def convert(given: argparse.Namespace):
    """Moves the wrenches of a file as the options of `shift` say, and nothing else; returns the exit status."""
    file = WrenchFile(given.file, given.columns)
    offset, rotation, pose = (_resolved(file, name, getattr(given, name)) for name in ("offset", "rotation", "pose"))
    _check_quaternions("rotation", rotation)
    _check_quaternions("pose", pose)
    parts = moved(file.parts, offset, rotation, pose, given.precision)
    file.check_finite(parts)
    with staged(given.output, given.overwrite) as stream:
        file.write(stream, parts)
    done = (("shifted", offset), ("rotated", rotation), ("moved by their pose", pose))
    what = " and ".join(word for word, x in done if x is not None)
    print(f"{len(file):,} wrenches{' and velocities' if file.moves else ''} {what}: {given.output}")
    return 0


def _resolved(file, name, entries: Sequence[float | str] | None):
    """Numbers and columns as one array (k,), or (n, k) where each row has its own."""
    if entries is None:
        return None
    try:
        columns = [file.column(e) if isinstance(e, str) else e for e in entries]
    except WrenchFileError as error:
        raise WrenchFileError(f"{error}; {options.example(name)}") from error
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _check_quaternions(name, x):
    norms = np.ones(()) if x is None else np.linalg.norm(x[..., :4], axis=-1)
    wrong = np.argwhere(~(abs(norms - 1) <= _ROUNDED))
    if len(wrong):
        got = f"one of norm {norms[tuple(wrong[0])]:.6g}" + (f" in row {wrong[0][0] + 1}" if norms.ndim else "")
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


class Npz:
    """Arrays by name. A column is an array (n,), or one of an array: p_x of p (n, 3), q_w of q (n, 4), a_0 of a (n, k).

    columns: part -> name of its array, or of its three columns; others go by their own name.
    """

    def __init__(self, path: pathlib.Path, columns: dict[str, tuple[str, ...]]):
        try:
            with np.load(path, allow_pickle=False) as file:
                self.arrays = dict(file)
        except Exception as error:
            raise WrenchFileError(f"{path}: expected a NumPy .npz archive without pickles: {error}") from error
        self.path, self.names, self._columns = path, tuple(self.arrays), columns

    def has(self, part):
        return all(self._find(name)[0] for name in self._named(part))

    def expected(self, part):
        names = self._named(part)
        return f"array '{names[0]}' of shape (n, 3)" if len(names) == 1 else f"columns {', '.join(names)}"

    def read(self, part):
        columns = [self._values(name) for name in self._named(part)]
        if len({x.shape for x in columns}) > 1:
            lengths = [len(x) for x in columns]
            raise WrenchFileError(f"{self.path}: {part}: expected columns of one length, got {lengths}")
        return columns[0] if len(columns) == 1 else np.stack(columns, axis=-1)

    def column(self, name):
        """The numbers (n,) of a column, as float64."""
        x = self._values(name) if self._find(name)[0] else np.empty(())
        if x.ndim != 1 or not np.issubdtype(x.dtype, np.number) or np.iscomplexobj(x):
            raise _no_column(self, name)
        return x.astype(np.float64)

    def place(self, part, row, column):
        names = self._named(part)
        return f"{part}[{row}, {column}]" if len(names) == 1 else f"{names[column]}[{row}]"

    def write(self, file: BinaryIO, parts: Parts):
        arrays = {name: array.copy() for name, array in self.arrays.items()}
        for part, array in parts.items():
            names = self._named(part)
            for i, name in enumerate(names):
                base, index = self._find(name)
                arrays[base][index] = array if len(names) == 1 else array[:, i]
        np.savez(file, **arrays)

    def _named(self, part):
        return self._columns.get(part, (part,))

    def _find(self, name):
        """(array, index into it) of a name; no array where there is nothing of that name."""
        if name in self.arrays:
            return name, ...
        base, _, last = name.rpartition("_")
        if base in self.arrays and self.arrays[base].ndim == 2:
            k = self.arrays[base].shape[1]
            indices = {str(i): i for i in range(k)} | {axis: i for i, axis in enumerate(_AXES.get(k, ""))}
            if last in indices:
                return base, (..., indices[last])
        return "", ...

    def _values(self, name):
        base, index = self._find(name)
        return self.arrays[base][index]


class Csv:
    """Text in columns under names, separated by commas, semicolons or tabs; numbers are those of float64.

    columns: part -> names of its three columns, or their stem; others are found under part_x, part_y, part_z.
    """

    def __init__(self, path: pathlib.Path, columns: dict[str, tuple[str, ...]]):
        self.path, self._columns = path, columns
        try:
            with open(path, newline="", encoding="utf-8-sig") as file:
                rows = self._rows(file)
        except UnicodeDecodeError as error:
            raise WrenchFileError(f"{path}: expected text in UTF-8: {error}") from error
        except csv.Error as error:
            raise WrenchFileError(f"{path}: expected rows of text: {error}") from error
        self.names, self.rows = tuple(name.strip() for name in rows[0]) if rows else (), rows[1:]
        self._check_first_line()
        n = len(self.names)
        for i, row in enumerate(self.rows):
            if len(row) != n:
                is_doubt = self._separator == "," and len(row) > n
                hint = "; if its numbers have decimal commas, write 1.5 for 1,5" if is_doubt else ""
                raise WrenchFileError(f"{path}: row {i + 1}: expected {n} values, got {len(row)}{hint}")

    def _check_first_line(self):
        first = self.names[0] if self.names else ""
        if len(first) > 1 and first.startswith(("#", "%", "//")):
            # Names behind such a sign, as many as there are numbers below, are what NumPy's savetxt writes.
            is_names = bool(self.rows) and len(self.rows[0]) == len(self.names) > 1
            command = "sed '1s|^[#%/ ]*||'" if is_names else "tail -n +2"
            raise WrenchFileError(
                f"{self.path}: line 1: expected names of columns, as in tau_x,tau_y,tau_z,f_x,f_y,f_z, got the comment "
                f"{first!r}; take it out: {command} {self._in_a_shell()}"
            )

    def _in_a_shell(self):
        """As what a command reads, and a file for what it writes."""
        return f"{shlex.quote(str(self.path))} > new{self.path.suffix}"

    def _rows(self, file):
        """All rows that are not empty; separator and ends of lines are those of the first."""
        head = file.readline()
        file.seek(0)
        self._separator = max(_SEPARATORS, key=head.count)
        self._end = "\r\n" if head.endswith("\r\n") else "\n"
        self._quoted = False

        def watched():
            """The lines, noting whether any has quotes."""
            for line in file:
                self._quoted = self._quoted or '"' in line
                yield line

        # As tuples: the garbage collector soon leaves those of text alone.
        return [tuple(row) for row in csv.reader(watched(), delimiter=self._separator) if row]

    def _named(self, part):
        names = self._columns.get(part, (part,))
        return tuple(f"{names[0]}_{axis}" for axis in "xyz") if len(names) == 1 else names

    def has(self, part):
        return all(name in self.names for name in self._named(part))

    def expected(self, part):
        return f"columns {', '.join(self._named(part))}"

    def read(self, part):
        return np.stack([self.column(name) for name in self._named(part)], axis=-1)

    def column(self, name):
        """The numbers (n,) of a column, as float64."""
        if self.names.count(name) != 1:
            raise _no_column(self, name)
        j = self.names.index(name)
        try:
            return np.fromiter((float(row[j]) for row in self.rows), np.float64, len(self.rows))
        except ValueError:
            raise self._no_number(j) from None

    def _no_number(self, j):
        """Which cell it was that is no number."""
        i, text = next((i, row[j]) for i, row in enumerate(self.rows) if not _is_number(row[j]))
        hint = options.decimal_point(text)
        hint += f": tr , . < {self._in_a_shell()}" if hint else ""
        where = f"row {i + 1}, column {self.names[j]}"
        return WrenchFileError(f"{self.path}: expected a number, got {text!r} in {where}{hint}")

    def place(self, part, row, column):
        return f"row {row + 1}, column {self._named(part)[column]}"

    def write(self, file: BinaryIO, parts: Parts):
        """Numbers as the shortest text that reads back as the same number."""
        changed = {
            self.names.index(name): x[:, i] for part, x in parts.items() for i, name in enumerate(self._named(part))
        }
        file.write(self._text([self.names]))
        for begin in range(0, len(self.rows), _ROWS):
            columns = list(zip(*self.rows[begin : begin + _ROWS], strict=True))
            for j, numbers in changed.items():
                columns[j] = tuple(map(repr, numbers[begin : begin + _ROWS].tolist()))
            file.write(self._text(zip(*columns, strict=True)))

    def _text(self, rows):
        """Rows as bytes. Without quotes anywhere no cell needs any, which is quick."""
        if self._quoted:
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
