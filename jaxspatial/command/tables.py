"""Tables of wrenches in files: `.npz` with arrays, `.csv` with named columns; what else is there is kept."""

import csv
import io
import pathlib
import shlex
from collections.abc import Iterable, Sequence
from types import EllipsisType
from typing import BinaryIO, TextIO

import numpy as np

from jaxspatial.command.files import WrenchFileError, decimal_point

_AXES = {3: "xyz", 4: "wxyz"}
_SEPARATORS = (",", ";", "\t")
# Rows that are made text at once: enough for speed, little next to the table.
_ROWS = 10_000

# By part, "tau", "f", "w", "v": its arrays (n, 3); and what its array, or columns, are called in the file.
Parts = dict[str, np.ndarray]
Named = dict[str, tuple[str, ...]]

# Into an array: all of it, or a column.
Index = EllipsisType | tuple[EllipsisType, int]


class Npz:
    """Arrays by name. A column is an array (n,), or one of an array: p_x of p (n, 3), q_w of q (n, 4), a_0 of a (n, k).

    named: part -> name of its array, or of its three columns; others go by their own name.
    """

    def __init__(self, path: pathlib.Path, named: Named):
        try:
            with np.load(path, allow_pickle=False) as file:
                self.arrays = dict(file)
        except Exception as error:
            raise WrenchFileError(f"{path}: expected a NumPy .npz archive without pickles: {error}") from error
        self.path, self.names, self._named = path, tuple(self.arrays), named

    def has(self, part: str):
        return all(self._find(name)[0] for name in self._names(part))

    def expected(self, part: str):
        names = self._names(part)
        return f"array '{names[0]}' of shape (n, 3)" if len(names) == 1 else f"columns {', '.join(names)}"

    def read(self, part: str):
        columns = [self._values(name) for name in self._names(part)]
        if len({x.shape for x in columns}) > 1:
            raise WrenchFileError(
                f"{self.path}: {part}: expected columns of one length, got {[len(x) for x in columns]}"
            )
        return columns[0] if len(columns) == 1 else np.stack(columns, axis=-1)

    def column(self, name: str):
        """The numbers (n,) of a column, as float64."""
        found = self._values(name) if self._find(name)[0] else np.empty(())
        if found.ndim != 1 or not np.issubdtype(found.dtype, np.number) or np.iscomplexobj(found):
            raise _no_column(self, name)
        return found.astype(np.float64)

    def place(self, part: str, row: int, column: int):
        names = self._names(part)
        return f"{part}[{row}, {column}]" if len(names) == 1 else f"{names[column]}[{row}]"

    def write(self, file: BinaryIO, parts: Parts):
        arrays = {name: array.copy() for name, array in self.arrays.items()}
        for part, array in parts.items():
            for i, name in enumerate(self._names(part)):
                base, index = self._find(name)
                arrays[base][index] = array if len(self._names(part)) == 1 else array[:, i]
        np.savez(file, **arrays)

    def _names(self, part: str):
        return self._named.get(part, (part,))

    def _find(self, name: str) -> tuple[str, Index]:
        """(array, index into it) of a name; no array where there is nothing of that name."""
        base, _, last = name.rpartition("_")
        if name in self.arrays:
            return name, ...
        indices = _indices(self.arrays[base]) if base in self.arrays else {}
        return (base, (..., indices[last])) if last in indices else ("", ...)

    def _values(self, name: str):
        base, index = self._find(name)
        return self.arrays[base][index]


def _indices(array: np.ndarray) -> dict[str, int]:
    """What the columns of an array (n, k) are called, by their place."""
    if array.ndim != 2:
        return {}
    k = array.shape[1]
    return {str(i): i for i in range(k)} | {axis: i for i, axis in enumerate(_AXES.get(k, ""))}


class Csv:
    """Text in columns under names, separated by commas, semicolons or tabs; numbers are those of float64.

    named: part -> names of its three columns, or their stem; others are found under part_x, part_y, part_z.
    """

    def __init__(self, path: pathlib.Path, named: Named):
        self.path, self._named = path, named
        try:
            with open(path, newline="", encoding="utf-8-sig") as file:
                rows = self._rows(file)
        except UnicodeDecodeError as error:
            raise WrenchFileError(f"{path}: expected text in UTF-8: {error}") from error
        except csv.Error as error:
            raise WrenchFileError(f"{path}: expected rows of text: {error}") from error
        self.names, self.rows = tuple(name.strip() for name in rows[0]) if rows else (), rows[1:]
        self._check_first_line()
        for i, row in enumerate(self.rows):
            if len(row) != len(self.names):
                raise WrenchFileError(
                    f"{path}: row {i + 1}: expected {len(self.names)} values, got {len(row)}{self._if_too_many(row)}"
                )

    def _check_first_line(self):
        first = self.names[0] if self.names else ""
        if len(first) > 1 and first.startswith(("#", "%", "//")):
            # Names behind such a sign, as many as there are numbers below, are what NumPy's savetxt writes.
            is_names = bool(self.rows) and len(self.rows[0]) == len(self.names) > 1
            command = "sed '1s|^[#%/ ]*||'" if is_names else "tail -n +2"
            raise WrenchFileError(
                f"{self.path}: line 1: expected names of columns, as in tau_x,tau_y,tau_z,f_x,f_y,f_z, got the comment "
                f"{first!r}; take it out: {command} {self._named_in_a_shell()}"
            )

    def _named_in_a_shell(self):
        """As what a command reads, and a file for what it writes."""
        return f"{shlex.quote(str(self.path))} > new{self.path.suffix}"

    def _if_too_many(self, row: Sequence[str]):
        is_doubt = self._separator == "," and len(row) > len(self.names)
        return "; if its numbers have decimal commas, write 1.5 for 1,5" if is_doubt else ""

    def _rows(self, file: TextIO):
        """All rows that are not empty; separator and ends of lines are those of the first."""
        head = file.readline()
        file.seek(0)
        self._separator = max(_SEPARATORS, key=head.count)
        self._end = "\r\n" if head.endswith("\r\n") else "\n"
        self._quoted = False
        # As tuples: the garbage collector soon leaves those of text alone.
        return [tuple(row) for row in csv.reader(self._watched(file), delimiter=self._separator) if row]

    def _watched(self, lines: Iterable[str]):
        """The lines, noting whether any has quotes."""
        for line in lines:
            self._quoted = self._quoted or '"' in line
            yield line

    def _columns(self, part: str):
        names = self._named.get(part, (part,))
        return tuple(f"{names[0]}_{axis}" for axis in "xyz") if len(names) == 1 else names

    def has(self, part: str):
        return all(name in self.names for name in self._columns(part))

    def expected(self, part: str):
        return f"columns {', '.join(self._columns(part))}"

    def read(self, part: str):
        return np.stack([self.column(name) for name in self._columns(part)], axis=-1)

    def column(self, name: str):
        """The numbers (n,) of a column, as float64."""
        if self.names.count(name) != 1:
            raise _no_column(self, name)
        j = self.names.index(name)
        try:
            return np.fromiter((float(row[j]) for row in self.rows), np.float64, len(self.rows))
        except ValueError:
            raise self._no_number(j) from None

    def _no_number(self, j: int):
        """Which cell it was that is no number."""
        i = next(i for i, row in enumerate(self.rows) if not _is_number(row[j]))
        where, text = f"row {i + 1}, column {self.names[j]}", self.rows[i][j]
        hint = decimal_point(text) and f"{decimal_point(text)}: tr , . < {self._named_in_a_shell()}"
        return WrenchFileError(f"{self.path}: expected a number, got {text!r} in {where}{hint}")

    def place(self, part: str, row: int, column: int):
        return f"row {row + 1}, column {self._columns(part)[column]}"

    def write(self, file: BinaryIO, parts: Parts):
        """Numbers as the shortest text that reads back as the same number."""
        names = [(part, i, self.names.index(x)) for part in parts for i, x in enumerate(self._columns(part))]
        changed = {j: parts[part][:, i] for part, i, j in names}
        file.write(self._text([self.names]))
        for begin in range(0, len(self.rows), _ROWS):
            columns: list[Sequence[str]] = list(zip(*self.rows[begin : begin + _ROWS], strict=True))
            for j, numbers in changed.items():
                columns[j] = list(map(repr, numbers[begin : begin + _ROWS].tolist()))
            file.write(self._text(zip(*columns, strict=True)))

    def _text(self, rows: Iterable[Sequence[str]]):
        """Rows as bytes. Without quotes anywhere no cell needs any, which is quick."""
        if self._quoted:
            text = io.StringIO()
            csv.writer(text, delimiter=self._separator, lineterminator=self._end).writerows(rows)
            return text.getvalue().encode()
        return "".join(f"{line}{self._end}" for line in map(self._separator.join, rows)).encode()


def _is_number(text: str):
    try:
        float(text)
    except ValueError:
        return False
    return True


def _no_column(table: Npz | Csv, name: str):
    count, found = table.names.count(name), ", ".join(table.names) or "nothing"
    number = f"{count} of that name" if count > 1 else "no numbers of that name"
    return WrenchFileError(f"{table.path}: expected one column {name!r}, got {number}; found {found}")
