"""What a closed surface of triangles encloses: volume, centre of mass and central inertia, by signed tetrahedra."""

# Of arrays of NumPy, for which those of JAX stand too, the stubs say only a part.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import check, symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Numbers, Symmetric, Three, high, noinline_pairs, where
from jaxspatial.arithmetic.numbers.trees import from_double_word
from jaxspatial.inertia.reduction import first, summed

# Of what a symmetric matrix of six numbers consists.
PAIRS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def corners(vertices: jax.Array, triangles: Any) -> jax.Array:
    """(*batch, m, 9): the three vertices of each of m triangles."""
    indices = _as_indices(triangles, vertices.shape[-2])
    x = vertices[..., indices, :]
    return x.reshape((*x.shape[:-3], indices.shape[0], 9))


def _as_indices(given: Any, n: int) -> Any:
    triangles: Any = given if isinstance(given, check.ARRAYS) else np.asarray(given)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not triangles.shape[0]:
        raise ValueError(f"triangle_mesh: triangles: expected shape (m, 3) with m >= 1, got {triangles.shape}")
    if not jnp.issubdtype(triangles.dtype, jnp.integer):
        raise TypeError(f"triangle_mesh: triangles: expected integers, got {triangles.dtype}")
    if isinstance(triangles, np.ndarray) and (triangles.min() < 0 or triangles.max() >= n):
        came = f"{triangles.min()} to {triangles.max()}"
        raise ValueError(f"triangle_mesh: triangles: expected indices from 0 to {n - 1}, got {came}")
    return triangles


def middle(corners: jax.Array) -> jax.Array:
    """(*batch, 1, 3) the middle of the box around all corners.

    Any point does: the result does not depend on it, hence neither do derivatives. Near the mesh nothing cancels, and
    differences from it are exact where the mesh is far away.
    """
    x: Any = from_double_word(corners)
    xp = np if isinstance(x, np.ndarray) else jnp
    x = x if xp is np else lax.stop_gradient(x)
    x = x.reshape((*x.shape[:-2], -1, 3))
    return x.min(-2, keepdims=True) / 2 + x.max(-2, keepdims=True) / 2


@formula
def enclosed(amount: Numbers, corners: Numbers, middle: Three, by: str, size: int) -> list[Numbers]:
    """[(mass,), com, central] for mass or density (amount,) and triangles, `size` of them along the last axis."""
    d, *moments = summed(_moments(corners, middle), size)
    d = where(high(d) > 0, d, math.nan)
    m = first(amount[0]) if by == "mass" else first(amount[0]) * (d / 6)
    return [(m,), *_about_center(m, d, moments[:3], moments[3:], tuple(map(first, middle)))]


@noinline_pairs
def _moments(corners: Numbers, middle: Three) -> Numbers:
    """Of the tetrahedron from the middle to a triangle (a, b, c): d = 6 volume, d s and d (s s^T + a a^T + b b^T + c
    c^T) with s = a + b + c.

    d = a . (b - a) x (c - a) with edges as they come: the error goes down with the size of the triangle.
    """
    a, b, c = vectors.rows(corners)
    edges = [tuple(y - x for x, y in zip(a, other, strict=True)) for other in (b, c)]
    points = [tuple(x - o for x, o in zip(p, middle, strict=True)) for p in (a, b, c)]
    d = vectors.dot(points[0], vectors.cross(*edges))
    s = vectors.plus(*points)
    squares = tuple(d * vectors.recursive_sum([p[i] * p[j] for p in (s, *points)]) for i, j in PAIRS)
    return d, *vectors.times(d, s), *squares


@noinline_pairs
def _about_center(m: Number, d: Number, arm: Three, squares: Symmetric, middle: Three) -> tuple[Three, Symmetric]:
    """(com, central) from the sums over all tetrahedra."""
    c = tuple(x / (4 * d) for x in arm)
    six = tuple(m * (x / (20 * d) - c[i] * c[j]) for x, (i, j) in zip(squares, PAIRS, strict=True))
    return vectors.plus(middle, c), symmetric.trace_minus(six)
