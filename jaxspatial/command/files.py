"""Files that are there or may be written, and that are written whole or not at all."""

import contextlib
import itertools
import os
import pathlib
import secrets


class WrenchFileError(ValueError):
    """A file that does not hold wrenches, or a wish that cannot be met; the message says where and why."""


class OutputError(OSError):
    """A file that cannot be written; the message says which and why, and nothing of it is there."""


def existing(path: pathlib.Path, endings: tuple[str, ...] = ()):
    """path, if a file of one of these formats is there; raises `WrenchFileError` otherwise."""
    if path.is_dir():
        raise WrenchFileError(f"{path}: expected a file, got a folder")
    ending = path.suffix.lower()
    if endings and ending not in endings:
        names = f"{', '.join(endings[:-1])} or {endings[-1]}"
        raise WrenchFileError(f"{path}: expected a file ending in {names}, got {ending or 'no ending'}")
    if not path.is_file():
        raise WrenchFileError(f"{path}: no such file")
    return path


def writable(path: pathlib.Path, overwrite: bool = False):
    """path, if a file may be written there; raises `OutputError` otherwise."""
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
    """path, or where it is taken the same with a number: a name by default."""
    names = (path.with_stem(f"{path.stem}_{i}") for i in itertools.count(2))
    return next(p for p in itertools.chain([path], names) if not os.path.lexists(p))


@contextlib.contextmanager
def staged(path: pathlib.Path, overwrite: bool = False):
    """Yields a new binary file that takes its place at path when the block ends, and vanishes when the block fails."""
    target = writable(path, overwrite).resolve()
    temporary = target.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            # What does not fit shows here at the latest, while the place is not yet taken.
            os.fsync(file.fileno())
        writable(path, overwrite)  # another file may have come into being meanwhile
        os.replace(temporary, target)
    except OutputError:
        raise
    except OSError as problem:
        raise OutputError(f"{path}: not written: {problem.strerror or problem}") from problem
    finally:
        temporary.unlink(missing_ok=True)
