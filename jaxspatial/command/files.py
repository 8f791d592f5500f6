"""Files that are there to be read, and those that are written whole or not at all, with the permissions of any new
file, and over no other one unasked."""

import contextlib
import itertools
import os
import pathlib
import re
import secrets
from collections.abc import Generator
from typing import BinaryIO

# What the formats of wrenches end in.
ENDINGS = ".npz", ".csv", ".tsv"


class WrenchFileError(ValueError):
    """A file that does not hold wrenches, or a wish that cannot be met; the message says where and why."""


class OutputError(OSError):
    """A file that cannot be written; the message says which and why, and nothing of it is there."""


def existing(path: pathlib.Path, endings: tuple[str, ...] = ()):
    """path, if a file of one of these formats is there; raises `WrenchFileError` before any work is done."""
    if path.is_dir():
        raise WrenchFileError(f"{path}: expected a file, got a folder")
    ending = path.suffix.lower()
    if endings and ending not in endings:
        names = f"{', '.join(endings[:-1])} or {endings[-1]}"
        raise WrenchFileError(f"{path}: expected a file ending in {names}, got {ending or 'no ending'}")
    if not path.is_file():
        raise WrenchFileError(f"{path}: no such file")
    return path


def decimal_point(text: str):
    """What is said of a number with a decimal comma; nothing of anything else."""
    is_number = re.fullmatch(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*", text)
    return f"; numbers have a decimal point, as {text.strip().replace(',', '.')}" if is_number else ""


def shifted_path(path: pathlib.Path):
    """Where the shifted wrenches of a file go unless told otherwise: beside it."""
    return path.with_name(f"{path.stem}_shifted{path.suffix}")


@contextlib.contextmanager
def staged(path: pathlib.Path, overwrite: bool = False) -> Generator[BinaryIO, None, None]:
    """Yields a new binary file that takes its place at path when the block ends, and vanishes when the block fails."""
    target = checked(path, overwrite).resolve()
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


def checked(path: pathlib.Path, overwrite: bool = False):
    """path, if a file may be written there; raises `OutputError` before any work is done."""
    path = pathlib.Path(path)
    if not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
        raise OutputError(f"{path.parent}: expected a folder to write to")
    if path.is_dir():
        raise OutputError(f"{path}: a folder is in the way")
    if path.exists() and not path.is_file():
        raise OutputError(f"{path}: expected a place for a file, got a device")
    if path.exists() and not overwrite:
        raise OutputError(f"{path}: exists already, and is only replaced with --overwrite")
    return path


def free(path: pathlib.Path):
    """path, or where it is taken the same with a number: a name for what was not given one."""
    names = (path.with_stem(f"{path.stem}_{i}") for i in itertools.count(2))
    return next(p for p in itertools.chain([path], names) if not os.path.lexists(p))


def _publish(temporary: pathlib.Path, target: pathlib.Path, overwrite: bool):
    if overwrite:
        os.replace(temporary, target)
        return
    try:
        # Unlike a renaming this fails where another file came into being meanwhile.
        os.link(temporary, target)
    except FileExistsError:
        raise
    except OSError:
        _rename_where_free(temporary, target)


def _rename_where_free(temporary: pathlib.Path, target: pathlib.Path):
    """On file systems without hard links."""
    if os.path.lexists(target):
        raise FileExistsError(f"{target}: exists already")
    os.rename(temporary, target)
