"""Wrenches in files: `.npz` with arrays, `.csv` with named columns; checked when read, written whole or not at all."""

import csv
import os
import pathlib
import tempfile

import numpy as np

_PARTS = {"tau": "torque", "f": "force", "w": "angular velocity", "v": "velocity"}
_REQUIRED, _OPTIONAL = ("tau", "f"), ("w", "v")


class WrenchFileError(ValueError):
    """A file that does not hold wrenches; the message says where and why."""


class WrenchFile:
    """A file of wrenches: `parts` are the arrays (n, 3) it holds under "tau", "f" and, both or none, "w", "v".

    What else is in the file is kept and written out again as it was.
    """

    def __init__(self, path):
        self.path = pathlib.Path(path)
        readers = {".npz": _Npz, ".csv": _Csv}
        if self.path.suffix not in readers:
            raise WrenchFileError(
                f"{path}: expected a file ending in .npz or .csv, got {self.path.suffix or 'no ending'}"
            )
        if not self.path.is_file():
            raise WrenchFileError(f"{path}: no such file")
        self._content = readers[self.path.suffix](self.path)
        self.parts = _checked(self.path, self._content)

    def write_shifted(self, parts):
        """Writes a copy of the file, with `parts` in place of its own, beside it; returns its path."""
        target = self.path.with_name(f"{self.path.stem}_shifted{self.path.suffix}")
        handle, name = tempfile.mkstemp(dir=target.parent, suffix=target.suffix)
        os.close(handle)
        try:
            self._content.write(name, parts)
            os.replace(name, target)
        except BaseException:
            os.unlink(name)
            raise
        return target


def _checked(path, content):
    present = [part for part in (*_REQUIRED, *_OPTIONAL) if content.has(part)]
    missing = [part for part in _REQUIRED if part not in present]
    if len(present) - len(_REQUIRED) == 1:
        missing += [part for part in _OPTIONAL if part not in present]
    if missing:
        wanted = "; ".join(f"{_PARTS[part]} as {content.expected(part)}" for part in missing)
        raise WrenchFileError(f"{path}: expected {wanted}; found {', '.join(content.names) or 'nothing'}")
    parts = {part: content.read(part) for part in present}
    _check_shapes(path, parts)
    for part, array in parts.items():
        _check_numbers(path, part, array, content)
    return parts


def _check_shapes(path, parts):
    n = len(parts["tau"]) if parts["tau"].ndim else 0
    if n == 0:
        raise WrenchFileError(f"{path}: expected at least one wrench, got no rows")
    for part, array in parts.items():
        if array.shape != (n, 3) or array.dtype != parts["tau"].dtype:
            raise WrenchFileError(
                f"{path}: {part}: expected shape {(n, 3)} and {parts['tau'].dtype} as tau has, "
                f"got {array.shape} and {array.dtype}"
            )


def _check_numbers(path, part, array, content):
    if not np.issubdtype(array.dtype, np.floating):
        raise WrenchFileError(f"{path}: {part}: expected floating point numbers, got {array.dtype}")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        row, column = bad[0]
        raise WrenchFileError(
            f"{path}: expected finite numbers, got {array[row, column]} in {content.place(part, row, column)} "
            f"and in {len(bad) - 1} more places"
        )


class _Npz:
    def __init__(self, path):
        try:
            with np.load(path, allow_pickle=False) as file:
                self.arrays = dict(file)
        except Exception as error:
            raise WrenchFileError(f"{path}: expected a NumPy .npz archive without pickles: {error}") from error
        self.names = tuple(self.arrays)

    def has(self, part):
        return part in self.arrays

    def expected(self, part):
        return f"array '{part}' of shape (n, 3)"

    def read(self, part):
        return self.arrays[part]

    def place(self, part, row, column):
        return f"{part}[{row}, {column}]"

    def write(self, path, parts):
        with open(path, "wb") as file:
            np.savez(file, **{**self.arrays, **parts})


class _Csv:
    def __init__(self, path):
        try:
            with open(path, newline="", encoding="utf-8-sig") as file:
                rows = [row for row in csv.reader(file) if row]
        except UnicodeDecodeError as error:
            raise WrenchFileError(f"{path}: expected text in UTF-8: {error}") from error
        self.path, self.names, self.rows = path, tuple(name.strip() for name in rows[0]) if rows else (), rows[1:]
        for i, row in enumerate(self.rows):
            if len(row) != len(self.names):
                raise WrenchFileError(f"{path}: row {i + 1}: expected {len(self.names)} values, got {len(row)}")

    @staticmethod
    def _columns(part):
        return tuple(f"{part}_{axis}" for axis in "xyz")

    def has(self, part):
        return all(name in self.names for name in self._columns(part))

    def expected(self, part):
        return f"columns {', '.join(self._columns(part))}"

    def read(self, part):
        indices = [self.names.index(name) for name in self._columns(part)]
        numbers = [[self._number(i, j) for j in indices] for i in range(len(self.rows))]
        return np.array(numbers, dtype=np.float64).reshape(-1, 3)

    def _number(self, row, column):
        try:
            return float(self.rows[row][column])
        except ValueError:
            where = f"row {row + 1}, column {self.names[column]}"
            raise WrenchFileError(
                f"{self.path}: expected a number, got {self.rows[row][column]!r} in {where}"
            ) from None

    def place(self, part, row, column):
        return f"row {row + 1}, column {self._columns(part)[column]}"

    def write(self, path, parts):
        rows = [list(row) for row in self.rows]
        for part, array in parts.items():
            for axis, name in enumerate(self._columns(part)):
                column = self.names.index(name)
                for row, value in zip(rows, array[:, axis].tolist(), strict=True):
                    row[column] = repr(value)
        with open(path, "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([self.names, *rows])
