"""Matrices by their entries (*batch, n n): as arguments, as results, and what they do to vectors."""

from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.arithmetic.numbers.components import as_array
from jaxspatial.arithmetic.numbers.trees import from_double_word
from jaxspatial.arithmetic.types import Matrix


def as_matrices(m: Matrix, name: str, n: int = 3) -> jax.Array:
    """Matrices (*batch, n, n) by their entries (*batch, n n)."""
    array = check.as_vectors(m, name, size=n, many=[str(n)], held=True)
    if array.shape[-2] != n:
        raise ValueError(f"{name}: expected shape (*batch, {n}, {n}), got {array.shape}")
    return array.reshape((*array.shape[:-2], n * n))


def require_rotations(entries: jax.Array, name: str) -> None:
    """Raises ValueError for known entries that are no rotation, see `Rotation.from_matrix`; traced ones pass."""
    leaves = jax.tree.leaves(entries)
    if not leaves or any(isinstance(x, (Tracer, jax.ShapeDtypeStruct)) for x in leaves):
        return
    tolerance = 1e-3 + 16 * check.eps(entries.dtype)
    m = np.asarray(from_double_word(as_array(entries, entries.shape[:-1]))).astype(np.float64).reshape((-1, 3, 3))
    with np.errstate(all="ignore"):
        off = abs(m @ np.swapaxes(m, -1, -2) - np.eye(3)).max((-1, -2), initial=0.0)
        wrong = np.flatnonzero((off > tolerance) | (np.linalg.det(m) < 0))
    if wrong.size:
        i = wrong[0]
        which = f"at place {i} of {len(m)} " if len(m) > 1 else ""
        how = f"with an entry of m m^T {off[i]:.3g} off" if off[i] > tolerance else "with a negative determinant"
        raise ValueError(
            f"{name}: expected rotation matrices, got {which}{m[i].tolist()}, {how}; Rotation.nearest(m) is the "
            "nearest rotation, Rotation(m.reshape((*m.shape[:-2], 9))) takes numbers as they are"
        )


def owned(array: jax.Array) -> jax.Array:
    """A NumPy array as a read-only copy: the caller may write to his own."""
    if isinstance(array, np.ndarray):
        copy: Any = np.array(array)
        copy.setflags(write=False)
        return copy
    return array


def shown(x: jax.Array | check.StandIn | None, n: int) -> str:
    """The numbers of one item, n in a row (0 of a scalar); the shape of a batch or of something not computed yet."""
    whole: Any = x
    if check.is_computed(whole) and whole.ndim == min(n, 1):
        if not n:
            return str(x)
        numbers = [str(number) for number in np.asarray(x)]
        rows = [", ".join(numbers[i : i + n]) for i in range(0, len(numbers), n)]
        return "[" + "; ".join(rows) + "]"
    return check.in_short(x)


def expanded(x: jax.Array) -> jax.Array:
    """(*batch,) as (*batch, 1)."""
    return x.reshape((*x.shape, 1))


def matrices(entries: jax.Array, n: int) -> jax.Array:
    """Entries (*batch, n n) as matrices (*batch, n, n)."""
    return entries.reshape((*entries.shape[:-1], n, n))


# -- products ---------------------------------------------------------------------------------------------------------


@formula(of_sums=True)
def rotated(entries: Numbers, *given: Numbers) -> list[Numbers]:
    rows = vectors.rows(entries)
    return [vectors.laid_out_as(v, vectors.matrix_times(rows, v)) for v in given]


TRANSPOSED = np.arange(9).reshape(3, 3).T.ravel()


@formula(of_sums=True)
def transposed(entries: Numbers) -> Numbers:
    return vectors.flat(vectors.transpose(vectors.rows(entries)))


@formula(of_sums=True)
def composed(left: Numbers, right: Numbers) -> Numbers:
    return vectors.laid_out_as(left, vectors.flat(vectors.matrix_product(vectors.rows(left), vectors.rows(right))))
