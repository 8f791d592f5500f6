"""`python -m jaxspatial shift FILE`: the wrenches of a file, and velocities where they are known, about another point
and in other axes; nothing else is done."""

import argparse
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import jax
import numpy as np

from jaxspatial.command import files
from jaxspatial.command.tables import Parts
from jaxspatial.command.wrench_file import WrenchFile, WrenchFileError, shifted_path
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialForce, SpatialVelocity, act, rotate, shift
from jaxspatial.spatial.vector import SpatialVector

# How far the norm of a quaternion may be from 1: it is normalised, but what is further off is no quaternion.
_ROUNDED = 1e-3

# One motion for all wrenches, or one each; None for none.
Entries = np.ndarray | None


def run(options: argparse.Namespace):
    """Converts, and says so; returns the exit status."""
    path = options.output or shifted_path(options.file)
    if path.suffix.lower() != options.file.suffix.lower():
        raise WrenchFileError(f"--output: expected a name ending in {options.file.suffix}, as {options.file} has")
    files.checked(path, options.overwrite)
    file = WrenchFile(options.file, options.columns)
    parts = moved(file.parts, *_motion(file, options), precision=options.precision)
    file.check_finite(parts)
    with files.staged(path, options.overwrite) as stream:
        file.write(stream, parts)
    print(f"{len(file):,} wrenches{' and velocities' if file.moves else ''} {_said(options)}: {path}")
    return 0


def moved(
    parts: Parts, offset: Entries = None, rotation: Entries = None, pose: Entries = None, precision: str | None = None
) -> Parts:
    """The parts about another point, then in other axes: in the dtype they came in.

    offset: p_PQ_E (3,) or (n, 3).  rotation: quaternion wxyz of R_AE, (4,) or (n, 4).  pose: quaternion and position
    of X_AB, (7,) or (n, 7), of a file of wrenches about the origin of B, in B: they come out about that of A, in A.
    """
    with jax.enable_x64(True):
        known = cast(dict[str, Any], parts)
        vectors = [SpatialForce(known["tau"], known["f"])]
        vectors += [SpatialVelocity(known["w"], known["v"])] if "w" in parts else []
        for step in _steps(offset, rotation, pose, parts["tau"].dtype, precision):
            vectors = [step(X) for X in vectors]
        arrays = [np.asarray(x) for X in vectors for x in (X.rotational, X.translational)]
    return dict(zip(("tau", "f", "w", "v"), arrays, strict=False))


def _steps(
    offset: Entries, rotation: Entries, pose: Entries, dtype: np.dtype, precision: str | None
) -> Iterator[Callable[[SpatialVector], Any]]:
    """What is done to a spatial vector, in turn."""
    if offset is not None:
        p = np.asarray(offset).astype(dtype)
        yield lambda X: shift(X, p, precision=precision)
    if rotation is not None:
        R_AE = _rotation(rotation, dtype)
        yield lambda X: rotate(R_AE, X, precision=precision)
    if pose is not None:
        X_AB = RigidTransform(_rotation(pose[..., :4], dtype), np.asarray(pose[..., 4:]).astype(dtype))
        yield lambda X: act(X_AB, X, precision=precision)


def _rotation(wxyz: np.ndarray, dtype: np.dtype):
    """Rounded once, from float64."""
    return jax.tree.map(operator.methodcaller("astype", dtype), Rotation.from_quaternion(np.asarray(wxyz, np.float64)))


def _motion(file: WrenchFile, options: argparse.Namespace):
    """offset, rotation, pose as arrays: one for all, or one each where columns of the file are named."""
    if options.offset is options.rotation is options.pose is None:
        raise WrenchFileError("expected --offset X Y Z, --rotation W X Y Z or --pose W X Y Z PX PY PZ")
    if options.pose is not None and not (options.offset is options.rotation is None):
        raise WrenchFileError("--pose: is a rotation and a position; expected no --offset or --rotation beside it")
    found = [_resolved(file, entries) for entries in (options.offset, options.rotation, options.pose)]
    for name, x in zip(("rotation", "pose"), found[1:], strict=True):
        _check_quaternions(name, x)
    return found


def _resolved(file: WrenchFile, entries: Sequence[float | str] | None):
    """Numbers and columns as one array (k,) or (n, k)."""
    if entries is None:
        return None
    return np.stack(np.broadcast_arrays(*(file.column(e) if isinstance(e, str) else e for e in entries)), axis=-1)


def _check_quaternions(name: str, x: Entries):
    if x is None:
        return
    norms = np.linalg.norm(x[..., :4], axis=-1)
    wrong = np.argwhere(~(abs(norms - 1) <= _ROUNDED))
    if len(wrong):
        where = f" in row {wrong[0][0] + 1}" if norms.ndim else ""
        found = norms[tuple(wrong[0])]
        raise WrenchFileError(f"--{name}: expected a unit quaternion W X Y Z first, got one of norm {found:.6g}{where}")


def _said(options: argparse.Namespace):
    done = (("shifted", options.offset), ("rotated", options.rotation), ("moved by their pose", options.pose))
    return " and ".join(word for word, given in done if given is not None)
