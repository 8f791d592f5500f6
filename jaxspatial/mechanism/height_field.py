"""Terrain: ground by its heights on a grid."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.mechanism.shapes import Shape, check_shape, clipped, local
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Pose, Vector, unit
from jaxspatial.numerics.numbers import Number, Numbers, constant, halved, where
from jaxspatial.numerics.quantity import tree
from jaxspatial.numerics.types import ArrayLike, DTypeLike, PrecisionName
from jaxspatial.spatial import RigidTransform


@tree
class HeightField(Shape):
    """Terrain by its heights on a grid, for the `ground` of a step: bilinear between samples.

    heights[i, j] is at x_i and y_j. The samples go from -size / 2 to size / 2 along x and y of the field. The distance
    of a point is f / |grad f|, with f = z - h(x, y): that to the plane which touches the surface above or under the
    point. It is right to first order, best close to the surface; the normal is that of the surface there. On a line
    between cells it is that of the cell on the side of larger coordinates. Beyond the border the heights of the border
    hold, and the normal has no part that points out of the field.

    Heights are data: they can be differentiated, and `vmap` gives each environment its own. A height that is NaN is
    none where it counts, and changes nothing elsewhere.

    Args:
        heights: (*batch, n_x, n_y), m, at least two along each axis.
        size: (2,) or (*batch, 2), from the first sample to the last along x and y, m, above zero.
        placement: RigidTransform X_WS of the middle of the field, at height 0; None for the origin.

    Raises:
        TypeError: dtypes differ, or the placement is no RigidTransform.
        ValueError: shapes do not fit, there are too few samples, or a number known while tracing is not finite, or a
            size not above zero.

    Error: of a distance at most 32 u (|p| + |p_WS| + H + s (|p| + |p_WS| + size)) in "fast" and "reproducible", with H
        the largest height of the cell, up and down, and s the largest slope along a line of the grid, of the cell and
        of those beside it; in "compensated" and "faithful" u of the distance and 1024 u^2 of the same. Coordinates of
        16 bits are taken to float32 first. A normal is that at a point which is 8 u (|p| + |p_WS| + size) away.

    Example:
        >>> ridge = js.HeightField([[0.0, 0.0], [0.5, 0.5], [0.0, 0.0]], size=(4.0, 2.0))  # along y
        >>> print(ridge(jnp.array([0.0, 0.0, 0.5])), ridge.normal_at(jnp.array([-1.0, 0.0, 0.5])))
        0.0 [-0.2425  0.      0.9701]
    """

    heights: jax.Array
    size: jax.Array
    placement: RigidTransform | None = None

    _axes = {"heights": 2, "size": 1}
    _lengths = {"size": 2}

    if TYPE_CHECKING:

        def __init__(self, heights: ArrayLike, size: ArrayLike, placement: RigidTransform | None = None): ...

    def __post_init__(self) -> None:
        check_shape(self, least={"heights": -np.inf})
        for name in ("heights", "size"):
            x = getattr(self, name)
            if isinstance(x, np.ndarray) and not np.isfinite(x).all():
                at = tuple(np.argwhere(~np.isfinite(x))[0].tolist())
                raise ValueError(f"HeightField: {name}: expected finite numbers, got {x[at]} at {list(at)}")
        if isinstance(self.size, np.ndarray) and not (self.size > 0).all():
            raise ValueError(f"HeightField: size: expected numbers above 0, got {self.size.tolist()}")
        if not check.is_tree_mark(self.heights):
            shape = self.heights.shape
            if len(shape) < 2 or min(shape[-2:]) < 2:
                raise ValueError(f"HeightField: heights: expected shape (*batch, n_x, n_y), of 2 at least, got {shape}")

    @classmethod
    def from_image(
        cls, levels: ArrayLike, size: ArrayLike, height: ArrayLike, placement: RigidTransform | None = None
    ) -> Self:
        """Terrain from an image of grey levels, as it is looked at from above: x to the right, y up.

            levels = np.asarray(PIL.Image.open("hills.png").convert("L"))
            terrain = js.HeightField.from_image(levels, (10.0, 10.0), 1.5)

        Args:
            levels: (rows, columns): whole numbers without a sign of any width, black 0 and white the largest of them,
                or floating point from 0 to 1.
            size: (2,), as of a HeightField, m.
            height: of white, m; black is at 0.
            placement: as of a HeightField.

        Returns:
            The HeightField, with heights (columns, rows).

        Raises:
            TypeError: levels are no whole numbers or floating point.
            ValueError: they are no image of one channel.

        Error: each height is rounded twice.

        Example:
            >>> levels = np.array([[0, 255], [0, 255]], np.uint8)  # black on the left, white on the right
            >>> print(js.HeightField.from_image(levels, (10.0, 10.0), 1.5).heights)
            [[0.  0. ]
             [1.5 1.5]]
        """
        image: Any = levels if isinstance(levels, jax.Array) else np.asarray(levels)
        if image.ndim != 2:
            expected = "HeightField.from_image: levels: expected an image of one channel, (rows, columns)"
            raise ValueError(f"{expected}, got {image.shape}")
        dtype = floats.floating_dtype(image, size, height, *jax.tree.leaves(placement))
        dtype = floats.as_dtype(None) if dtype is None else dtype
        if image.dtype.kind == "u":
            image = image.astype(dtype) / np.asarray(np.iinfo(image.dtype).max, dtype)
        elif image.dtype.kind == "i":
            raise TypeError(
                f"HeightField.from_image: levels: expected whole numbers without a sign, or floating point, got "
                f"{image.dtype}; convert with .astype('uint8')"
            )
        image = floats.as_float_array(image, "HeightField.from_image: levels", dtype, keep_dtype=True)
        height = floats.as_float_array(height, "HeightField.from_image: height", dtype, keep_dtype=True)
        return cls(height * image[::-1].T, size, placement)

    @classmethod
    def from_mjcf(
        cls,
        path_or_text: Any,
        geom: str | None = None,
        *,
        assets: Mapping[str, bytes] | None = None,
        dtype: DTypeLike | None = None,
    ) -> Self:
        """Terrain that an MJCF has as a geom of type `hfield`.

            terrain = js.HeightField.from_mjcf("hills.xml")

        MuJoCo splits each cell into two triangles; here the surface of a cell is bilinear, with the same heights at its
        corners and along its edges. The box under the field, and its depth, count for nothing.

        Args:
            path_or_text: a path; the text itself; a mujoco.MjSpec, or a mujoco.MjModel.
            geom: its name; None for the only one.
            assets: files that the text names, by their names.
            dtype: of the numbers; None for the default.

        Returns:
            The HeightField, with NumPy numbers, placed where the geom is.

        Raises:
            FileNotFoundError: there is no such file.
            ImportError: mujoco or lxml is missing.
            ValueError: MuJoCo does not compile the file, or there is no such height field that does not move.

        Error: none in the heights but that of MuJoCo's, which are float32 shares of the largest; a few u of the
            position in the placement.

        Example:
            >>> hills = '<hfield name="hills" nrow="2" ncol="2" size="5 5 1.5 1" elevation="0 1 0 1"/>'
            >>> world = '<worldbody><geom type="hfield" hfield="hills"/></worldbody>'
            >>> terrain = js.HeightField.from_mjcf(f"<mujoco><asset>{hills}</asset>{world}</mujoco>")
            >>> print(terrain.size, terrain.heights)
            [10. 10.] [[0.  0. ]
             [1.5 1.5]]
        """
        from jaxspatial.mechanism.formats import mjcf

        heights, size, placement = mjcf.read_height_field(path_or_text, geom, assets)
        return cls(heights, size, placement).astype(floats.as_dtype(dtype))

    def normals_and_distances(self, precision: PrecisionName, p: jax.Array) -> tuple[jax.Array, jax.Array]:
        dtype = np.dtype(p.dtype)
        if dtype.itemsize == 2:
            # Numbers of a cell need more digits than those of 16 bits have.
            wide, p = self.astype(np.float32), p.astype(np.float32)
            n, distance = wide.normals_and_distances(precision, p)
            return n.astype(dtype), distance.astype(dtype)
        counts = np.array(self.heights.shape[-2:], dtype) - 1
        cells = lax.stop_gradient(_cell(precision, p, self.pose, self.size, counts))
        last = [n - 2 for n in self.heights.shape[-2:]]
        # NaN becomes some cell.
        i, j = (jnp.clip(jnp.floor(cells[..., k]), 0, n).astype(np.int32) for k, n in enumerate(last))
        cells = jnp.stack([i, j], -1).astype(dtype)
        of = corners(self.heights, i, j), cells, self.size, counts
        return tuple(_of_cell(precision, p, self.pose, *of))


def corners(heights, i: jax.Array, j: jax.Array) -> jax.Array:
    """The heights (*batch, 4) at the corners (i, j), (i, j + 1), (i + 1, j), (i + 1, j + 1) of cells (*batch,)."""
    many = heights.shape[:-2]
    if math.prod(many) != 1:
        # Of the axes of a batch of heights, those of one belong to all points.
        is_one = len(many) < i.ndim or many[0] == 1
        own = heights if len(many) < i.ndim else heights[0] if is_one else heights
        return jax.vmap(corners, in_axes=(None if is_one else 0, 0, 0))(own, i, j)
    heights = jnp.asarray(heights).reshape(heights.shape[-2:])
    windows = lax.GatherDimensionNumbers((i.ndim, i.ndim + 1), collapsed_slice_dims=(), start_index_map=(0, 1))
    cells = lax.gather(heights, jnp.stack([i, j], -1), windows, (2, 2), mode="promise_in_bounds")
    return cells.reshape((*i.shape, 4))


@formula
def _cell(p: Vector, X: Pose, size: Numbers, counts: Numbers):
    """Where a point is, in cells from the first corner along each axis."""
    along = local(p, X)
    return tuple((clipped(x, halved(s)) + halved(s)) / (s / n) for x, s, n in zip(along[:2], size, counts, strict=True))


@formula
def _of_cell(p: Vector, X: Pose, corners: Numbers, cell: Numbers, size: Numbers, counts: Numbers) -> list[Any]:
    """The normal of the surface of a cell, and the distance along it."""
    at = local(p, X)
    shares, edges, is_within = list[Number](), list[Number](), list[Any]()
    for x, s, n, k in zip(at[:2], size, counts, cell, strict=True):
        half, edge = halved(s), s / n
        shares.append(((clipped(x, half) + half) - k * edge) / edge)
        edges.append(edge)
        is_within.append((x <= half) & (x >= -half))
    (t_x, t_y), (h_00, h_01, h_10, h_11) = shares, corners
    rise_x = (1 - t_y) * (h_10 - h_00) + t_y * (h_11 - h_01)
    rise_y = (1 - t_x) * (h_01 - h_00) + t_x * (h_11 - h_10)
    height = (1 - t_x) * ((1 - t_y) * h_00 + t_y * h_01) + t_x * ((1 - t_y) * h_10 + t_y * h_11)
    slope_x, slope_y = (where(w, r / e, 0.0) for w, r, e in zip(is_within, (rise_x, rise_y), edges, strict=True))
    up = unit(Vector(-slope_x, -slope_y, constant(height, 1)))
    return [X.R @ up, (at.z - height) * up.z]
