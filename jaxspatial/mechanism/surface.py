"""Where a signed distance is zero, as triangles: what is drawn of a ground that is given as a function."""

import itertools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import check
from jaxspatial.numerics.types import DTypeLike

# The six tetrahedra of a cube: each goes from one corner to the opposite one, along the axes in one of their orders.
_TETRAHEDRA = np.stack(
    [np.cumsum([(0, 0, 0), *np.eye(3, dtype=int)[[*order]]], axis=0) for order in itertools.permutations(range(3))]
)
# Between which of four corners, from the lowest distance to the highest, the surface passes, by how many are inside.
_CUTS = {1: [(0, 1), (0, 2), (0, 3)], 2: [(0, 2), (0, 3), (1, 3), (1, 2)], 3: [(0, 3), (1, 3), (2, 3)]}


def surface(
    operation: str, ground: Callable[[jax.Array], Any], centre, edge: float, cells: int, dtype: DTypeLike
) -> np.ndarray:
    """The triangles (n, 3, 3) of the ground in a cube about the point of the ground that is next to a centre, m.

    ground: a function from a point (3,) to its signed distance; distances of any slope serve, and where they are not
    finite there is no ground. edge: of the cube. cells: along each edge; a plane is exact, other surfaces are as near
    as a distance is to its linear interpolation in a cell. Marching tetrahedra [Doi, Koide 1991].
    """

    def distance(point: jax.Array) -> jax.Array:
        x = jnp.asarray(ground(point))
        if x.shape:
            expected = f"{operation}: ground: expected a signed distance, {np.dtype(dtype)}[], of a point (3,)"
            raise ValueError(f"{expected}, got {check.in_short(x)}")
        return x

    centre = _on_ground(jax.jit(jax.value_and_grad(distance)), np.asarray(centre, dtype))
    grid = np.stack(np.meshgrid(*[np.arange(cells + 1)] * 3, indexing="ij"), axis=-1)
    low, step = centre - edge / 2, edge / cells
    points = (low + step * grid).astype(dtype)
    distances = np.asarray(jax.jit(jax.vmap(distance))(points.reshape(-1, 3)), float).reshape(grid.shape[:3])
    corners = np.stack(
        [distances[tuple(slice(i, cells + i) for i in at)] for at in itertools.product((0, 1), repeat=3)]
    )
    # NaN is neither inside nor outside.
    crossed = np.argwhere((corners <= 0).any(0) & (corners > 0).any(0))
    tetrahedra = (crossed[:, None, None] + _TETRAHEDRA).reshape(-1, 4, 3)
    d = distances[tuple(np.moveaxis(tetrahedra, -1, 0))]
    tetrahedra, d = tetrahedra[np.isfinite(d).all(1)], d[np.isfinite(d).all(1)]
    order = np.argsort(d, axis=1)
    d, p = np.take_along_axis(d, order, 1), low + step * np.take_along_axis(tetrahedra, order[..., None], 1)
    triangles = [_cut(p[k == n], d[k == n], cuts) for k in [(d <= 0).sum(1)] for n, cuts in _CUTS.items()]
    found = np.concatenate(triangles)
    area = np.linalg.norm(np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]), axis=-1)
    found = found[area > 1e-9 * step**2]
    if not len(found):
        where = f"{edge:.3g} m about {centre.tolist()}"
        raise ValueError(f"{operation}: ground: expected a distance that is 0 near the robot, got none in {where}")
    return found


def _on_ground(value_and_gradient, p: np.ndarray) -> np.ndarray:
    """A point of the ground, found from another along gradients by Newton's method, or the last one that was finite."""
    for _ in range(30):
        d, gradient = map(np.asarray, value_and_gradient(p))
        with np.errstate(all="ignore"):
            step = d * gradient / (gradient @ gradient)
        if not np.isfinite(step).all() or not step.any():
            break
        p = p - step
    return p.astype(float)


def _cut(p: np.ndarray, d: np.ndarray, cuts: list[tuple[int, int]]) -> np.ndarray:
    """The triangles (m, 3, 3) in tetrahedra (n, 4, 3) that the surface cuts between these corners."""
    ends = [p[:, a] + (d[:, a] / (d[:, a] - d[:, b]))[:, None] * (p[:, b] - p[:, a]) for a, b in cuts]
    fans = [np.stack([ends[0], *ends[i : i + 2]], axis=1) for i in range(1, len(ends) - 1)]
    return np.concatenate(fans)
