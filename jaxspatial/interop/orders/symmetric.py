"""Orders of symmetric matrices; one item, for libraries that hold one."""

from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Six, Vector


def symmetric_from_diagonal_first(x6: Six) -> jax.Array:
    """Puts the entries of symmetric matrices in our order.

    Args:
        x6: (*batch, 6) [xx, yy, zz, xy, xz, yz], moments first: MuJoCo's `fullinertia` and `cinert`, the six arguments
            of Drake's RotationalInertia.

    Returns:
        (*batch, 6) [xx, xy, yy, xz, yz, zz], the lower triangle by rows.

    Raises:
        ValueError: the shape does not fit.
    """
    return reordered(x6, "symmetric_from_diagonal_first: x6", 0, 3, 1, 4, 5, 2)


def symmetric_to_diagonal_first(x6: Six) -> jax.Array:
    """Puts the entries of symmetric matrices in another order.

    Args:
        x6: (*batch, 6) [xx, xy, yy, xz, yz, zz], the lower triangle by rows.

    Returns:
        (*batch, 6) [xx, yy, zz, xy, xz, yz], moments first: MuJoCo's `fullinertia` and `cinert`, the six arguments of
        Drake's RotationalInertia.

    Raises:
        ValueError: the shape does not fit.
    """
    return reordered(x6, "symmetric_to_diagonal_first: x6", 0, 2, 5, 1, 3, 4)


def symmetric_from_upper_triangle(x6: Six) -> jax.Array:
    """Puts the entries of symmetric matrices in our order.

    Args:
        x6: (*batch, 6) [xx, xy, xz, yy, yz, zz], the upper triangle by rows: URDF, SDF.

    Returns:
        (*batch, 6) [xx, xy, yy, xz, yz, zz], the lower triangle by rows.

    Raises:
        ValueError: the shape does not fit.
    """
    return reordered(x6, "symmetric_from_upper_triangle: x6", 0, 1, 3, 2, 4, 5)


def symmetric_to_upper_triangle(x6: Six) -> jax.Array:
    """Puts the entries of symmetric matrices in another order.

    Args:
        x6: (*batch, 6) [xx, xy, yy, xz, yz, zz], the lower triangle by rows.

    Returns:
        (*batch, 6) [xx, xy, xz, yy, yz, zz], the upper triangle by rows: URDF, SDF.

    Raises:
        ValueError: the shape does not fit.
    """
    return symmetric_from_upper_triangle(x6)


def reordered(x: Vector, name: str, *order: int) -> jax.Array:
    """Vectors (*batch, n) with their numbers in another order."""
    return check.as_vectors(x, name, size=len(order), held=True)[..., np.array(order)]


def single(x: Any, name: str) -> np.ndarray:
    """Brings one item to the host, for a constructor that takes nothing else.

    Args:
        x: an array (n,), or a double word.
        name: what the item is, for the message.

    Returns:
        (n,) float64; of a double word the nearest.

    Raises:
        ValueError: it is a batch.
    """
    words = [np.asarray(word, np.float64) for word in jax.tree.leaves(x)]
    if words[0].ndim != 1:
        raise ValueError(
            f"{name}: expected one item, got a batch of shape {words[0].shape[:-1]}; "
            "item i is jax.tree.map(lambda leaf: leaf[i], x)"
        )
    return np.sum(words, axis=0)
