"""`python -m jaxspatial shift FILE`: the wrenches of a file, and velocities where they are known, about another point
and in other axes; nothing else is done."""

import argparse
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any, cast

import jax
import numpy as np

from jaxspatial.command import files, options
from jaxspatial.command.tables import Parts
from jaxspatial.command.wrench_file import WrenchFile, WrenchFileError
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialForce, SpatialVelocity, act, rotate, shift
from jaxspatial.spatial.vector import SpatialVector

# How far the norm of a quaternion may be from 1: it is normalised, but what is further off is no quaternion.
_ROUNDED = 1e-3

# One motion for all wrenches, or one each; None for none.
Entries = np.ndarray | None


def run(given: argparse.Namespace):
    """Converts what `options.to_shift` was told, and says so; returns the exit status."""
    file = WrenchFile(given.file, given.columns)
    parts = moved(file.parts, *_motion(file, given), precision=given.precision)
    file.check_finite(parts)
    with files.staged(given.output, given.overwrite) as stream:
        file.write(stream, parts)
    print(f"{len(file):,} wrenches{' and velocities' if file.moves else ''} {_said(given)}: {given.output}")
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


def _motion(file: WrenchFile, given: argparse.Namespace):
    """offset, rotation, pose as arrays: one for all, or one each where columns of the file are named."""
    found = [_resolved(file, name, getattr(given, name)) for name in ("offset", "rotation", "pose")]
    for name, x in zip(("rotation", "pose"), found[1:], strict=True):
        _check_quaternions(name, x)
    return found


def _resolved(file: WrenchFile, name: str, entries: Sequence[float | str] | None):
    """Numbers and columns as one array (k,) or (n, k)."""
    if entries is None:
        return None
    try:
        columns = [file.column(e) if isinstance(e, str) else e for e in entries]
    except WrenchFileError as error:
        raise WrenchFileError(f"{error}; {options.example(name)}") from error
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def _check_quaternions(name: str, x: Entries):
    if x is None:
        return
    norms = np.linalg.norm(x[..., :4], axis=-1)
    wrong = np.argwhere(~(abs(norms - 1) <= _ROUNDED))
    if len(wrong):
        where = f" in row {wrong[0][0] + 1}" if norms.ndim else ""
        found = norms[tuple(wrong[0])]
        raise WrenchFileError(f"--{name}: expected a unit quaternion W X Y Z first, got one of norm {found:.6g}{where}")


def _said(given: argparse.Namespace):
    done = (("shifted", given.offset), ("rotated", given.rotation), ("moved by their pose", given.pose))
    return " and ".join(word for word, entries in done if entries is not None)
