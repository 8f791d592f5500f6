"""Shapes: signed distances of points and the normals of surfaces, for the ground and for what bodies touch."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Pose, Vector, dot, norm, scaled, unit
from jaxspatial.numerics.numbers import Number, Numbers, constant, halved, high, times_power_of_two, where
from jaxspatial.numerics.quantity import OfOneDtype, exported_tree_of, rebuilt, require_compatible, tree, tree_of
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

# -- distances, over numbers ------------------------------------------------------------------------------------------
#
# Each is of a point in the axes of the shape, about its centre: (the normal, the signed distance).


def direction(v: Vector, axis: int = 2) -> tuple[Vector, Number]:
    """(the direction of v, its length): at 0 that of an axis, with the derivatives of a plane across it."""
    return direction_or(v, Vector(*(constant(v.x, int(i == axis)) for i in range(3))), v[axis])


def direction_or(v: Vector, normal: Vector, distance: Number) -> tuple[Vector, Number]:
    """(the direction of v, its length): at 0 that of a plane."""
    # Compilers flush subnormal numbers to zero, and 1 / |v| is to stay finite.
    x, y, z = (abs(high(c)) < np.finfo(high(c).dtype).tiny for c in v)
    is_zero = x & y & z
    apart = Vector(*(where(is_zero, n, c) for n, c in zip(normal, v, strict=True)))
    return unit(apart), where(is_zero, distance, norm(apart))


@formula
def directions(v: Vector) -> list[Any]:
    """`direction` of arrays."""
    return list(direction(v))


def _sphere(p: Vector, radius: Numbers) -> tuple[Vector, Number]:
    n, length = direction(p)
    return n, length - radius[0]


def _capsule(p: Vector, radius: Numbers, length: Numbers) -> tuple[Vector, Number]:
    half = halved(length[0])
    # NaN, of the point or the length, is beyond an end.
    beyond = where(p.z > half, p.z - half, where(p.z >= -half, constant(p.z, 0), p.z + half))
    n, distance = direction(Vector(p.x, p.y, beyond), axis=0)
    return n, distance - radius[0]


def clipped(x: Number, half: Number) -> Number:
    """x, or the nearer of -half and half where it is beyond."""
    return where(x > half, half, where(x < -half, -half, x))


def _box(p: Vector, size: Vector) -> tuple[Vector, Number]:
    normal, distance = _of_slabs(p, [halved(x) for x in size])
    return Vector(*normal), distance


def _cylinder(p: Vector, radius: Numbers, length: Numbers) -> tuple[Vector, Number]:
    """As of a box, in the plane through the axis and the point."""
    across, rho = direction(Vector(p.x, p.y, constant(p.x, 0)), axis=0)
    (n_r, n_z), distance = _of_slabs([rho, p.z], [radius[0], halved(length[0])])
    return Vector(across.x * n_r, across.y * n_r, n_z), distance


def _of_slabs(p: Sequence[Number], halves: Sequence[Number]) -> tuple[list[Number], Number]:
    """(the normal, the signed distance) of the box |x_i| <= half_i. Outside they are those of its nearest point. Inside
    they are those of its nearest face, and of the first of several that are as near."""
    gaps = [where(x < 0, -x, x) - half for x, half in zip(p, halves, strict=True)]
    zero = constant(p[0], 0)
    # NaN is outside.
    beyond = [where(gap <= 0, 0.0, gap) for gap in gaps]
    n, outside = direction(Vector(*beyond, *[zero] * (3 - len(p))))
    is_inside, inside, is_nearest = gaps[0] <= 0, gaps[0], list[Any]([True])
    for gap in gaps[1:]:
        is_inside = is_inside & (gap <= 0)
        is_nearer = gap > inside
        is_nearest = [*(x & ~is_nearer for x in is_nearest), is_nearer]
        inside = where(is_nearer, gap, inside)
    normal = [where(is_inside, where(own, 1.0, zero), x) for own, x in zip(is_nearest, n, strict=False)]
    return [where(x < 0, -y, y) for x, y in zip(p, normal, strict=True)], where(is_inside, inside, outside)


@formula
def _stairs(p: Vector, X: Pose, run: Numbers, rise: Numbers, *, steps: int) -> list:
    """The normal of a staircase, and the signed distance of a point. Each step fills a quarter of the plane across the
    stairs, and so does the air above it. Outside the nearest of the steps counts, inside the nearest of the air."""
    at = local(p, X)
    # Squares neither over- nor underflow.
    (x, z, run_, rise_), e = scaled((at.x, at.z, run[0], rise[0]))
    zero, one = constant(x, 0), constant(x, 1)
    # The ground in front goes on for ever, as does that behind the last step.
    ahead, above = _nearest([(zero, z), *(((k - 1) * run_ - x, z - k * rise_) for k in range(1, steps + 1))])
    behind, below = _nearest([*((x - k * run_, k * rise_ - z) for k in range(steps)), (zero, steps * rise_ - z)])
    n, outside = direction(Vector(_positive(ahead), zero, _positive(above)))
    # On the surface: whether on a riser, and not on a tread.
    is_on_riser = below < 0
    plane = Vector(where(is_on_riser, one, zero), zero, where(is_on_riser, zero, one))
    behind, below = _positive(behind), _positive(below)
    m, inside = direction_or(Vector(behind, zero, below), plane, where(is_on_riser, behind, below))
    # NaN is outside.
    is_inside = outside <= 0
    normal = Vector(where(is_inside, -m.x, -n.x), zero, where(is_inside, m.z, n.z))
    return [X.R @ normal, times_power_of_two(where(is_inside, -inside, outside), e)]


def _nearest(quarters: Sequence[tuple[Number, Number]]) -> tuple[Number, Number]:
    """How far in front and how far below the nearest of quarters of a plane is: of several as near, the last one."""
    least, found = None, quarters[0]
    for x, z in quarters:
        ahead, below = _positive(x), _positive(z)
        square = ahead * ahead + below * below
        # NaN wins.
        is_nearer = True if least is None else ~(square > least)
        least = square if least is None else where(is_nearer, square, least)
        found = where(is_nearer, x, found[0]), where(is_nearer, z, found[1])
    return found


def _positive(x: Number) -> Number:
    """x, or 0 where it is below."""
    return where(x < 0, 0.0, x)


def placed(function: Callable[..., tuple[Vector, Number]]) -> Callable:
    """As a formula of (points in the world, the pose of the shape, its numbers): normals and distances."""

    def in_world(p: Vector, X: Pose, *numbers) -> list:
        n, distance = function(local(p, X), *numbers)
        return [X.R @ n, distance]

    in_world.__name__ = function.__name__
    return formula(in_world)


def local(p: Vector, X: Pose) -> Vector:
    """p_SP_S, of a point at p_WP_W and a shape at X_WS."""
    return X.R.T @ (p - X.p)


_locals = formula(local)


@formula
def _turned(X: Pose, n: Vector) -> Vector:
    return X.R @ n


@formula
def units(v: Vector) -> Vector:
    """v / |v|."""
    return unit(v)


@formula
def _distance(n: Vector, p: Vector, offset: Numbers):
    return dot(n, p) - offset[0]


@formula
def _to_first_order(gradient: Vector, value: Numbers) -> list[Any]:
    """The normal of a function, and the distance along it, f / |grad f|; NaN without a normal."""
    length = norm(gradient)
    return [unit(gradient), value[0] / where((length > 0) & (length < math.inf), length, math.nan)]


# -- shapes -----------------------------------------------------------------------------------------------------------


class Shape(OfOneDtype):
    """Base of the shapes, each of which is a function from a point to its signed distance, m.

    Above zero outside, below zero inside. A shape is a pytree: its numbers can be differentiated, and batched.
    """

    # How many axes each of the numbers has that is not of the batch.
    _axes: ClassVar[dict[str, int]] = {}
    # The lengths of those that are vectors, where it is not 3.
    _lengths: ClassVar[dict[str, int]] = {}
    _formula: ClassVar[Callable[..., Any]]

    if TYPE_CHECKING:
        placement: RigidTransform | None

    def __post_init__(self) -> None:
        check_shape(self)

    @property
    def calls_functions(self) -> bool:
        """Whether it calls functions of the caller's, which may read arrays of the caller's."""
        return False

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return floats.broadcast_shapes(*_batch_shapes(self).values())

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(getattr(self, next(iter(self._axes))).dtype)

    def __call__(self, point: ArrayLike) -> jax.Array:
        """The signed distance (*batch,) of points (*batch, 3) in world axes; batch shapes broadcast."""
        return self._checked(point)[1]

    def normal_at(self, point: ArrayLike) -> jax.Array:
        """The normal (*batch, 3) of unit length out of the shape, at points (*batch, 3); batch shapes broadcast.

        Example:
            >>> wedge = js.HalfSpace([0.0, -3.0, 4.0])
            >>> print(wedge.normal_at(jnp.array([[0.0, 0.0, 1.0], [5.0, 0.0, 9.0]])))
            [[ 0.  -0.6  0.8]
             [ 0.  -0.6  0.8]]
        """
        return self._checked(point)[0]

    def _checked(self, point: ArrayLike) -> tuple[jax.Array, jax.Array]:
        what = type(self).__name__
        p = floats.as_vectors(point, f"{what}: point", self.dtype)
        require_compatible(**{what: self, "point": p})
        return floats.narrowed(self).normals_and_distances(None, p)

    def normals_and_distances(self, precision: PrecisionName, p: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The normals (*batch, 3) of the surface, and the signed distances (*batch,), of points (*batch, 3).

        Example:
            >>> at = jnp.array([[2.0, 0.0, 0.0], [0.0, 0.0, 0.25]])
            >>> normals, distances = js.Sphere(0.5).normals_and_distances(None, at)
            >>> print(normals, distances)
            [[1. 0. 0.]
             [0. 0. 1.]] [ 1.5  -0.25]
        """
        numbers = (floats.expanded(getattr(self, k)) if n == 0 else getattr(self, k) for k, n in self._axes.items())
        return tuple(type(self)._formula(precision, p, self.pose, *numbers))

    @property
    def pose(self) -> Pose:
        """X_WS as arrays; known numbers without a placement."""
        X = self.placement
        if X is None:
            entries = np.eye(3, dtype=self.dtype).ravel()
            return Pose(entries, np.zeros(3, self.dtype))  # pyright: ignore[reportArgumentType]
        return Pose(X.rotation.entries, X.translation)  # pyright: ignore[reportArgumentType]

    def of_many_points(self) -> Self:
        """The same with one more axis behind those of the batch, over points of each item.

        Example:
            >>> balls = js.Sphere([0.5, 1.0])  # two, each with three points of its own
            >>> print(balls.of_many_points()(jnp.ones((2, 3, 3))).shape)
            (2, 3)
        """
        parts = {k: _with_axis(getattr(self, k), n) for k, n in self._axes.items()}
        placement = None if self.placement is None else jax.tree.map(lambda x: _with_axis(x, 1), self.placement)
        return _changed(self, **parts, placement=placement)

    def __repr__(self) -> str:
        parts = [f"{k}={check.shown(getattr(self, k), (0, 3, 3)[n])}" for k, n in self._axes.items()]
        parts += [] if self.placement is None else [f"placement={self.placement!r}"]
        return f"{type(self).__name__}({', '.join(parts)})"


def _with_axis(x, n: int):
    """With an axis of one before the last n."""
    return x.reshape((*x.shape[: x.ndim - n], 1, *x.shape[x.ndim - n :]))


def _changed(shape, **parts):
    return rebuilt(type(shape), vars(shape), (parts.get(k, x) for k, x in vars(shape).items()))


def _batch_shapes(shape) -> dict[str, tuple[int, ...]]:
    shapes = {k: getattr(shape, k).shape for k in shape._axes}
    shapes = {k: s[: len(s) - shape._axes[k]] for k, s in shapes.items()}
    return shapes if shape.placement is None else {**shapes, "placement": shape.placement.batch_shape}


def check_shape(shape, least: dict[str, float] | None = None) -> None:
    """Checks the numbers that a caller passes, and keeps them as arrays; marks of a tree of axes or specs pass.

    least: below which numbers are refused that are known while tracing; 0 where nothing is said.
    """
    what, placement = type(shape).__name__, shape.placement
    given = {k: getattr(shape, k) for k in shape._axes}
    # A whole number is an axis where an array belongs, and a size where a number does.
    if all(x is None or (check.is_tree_mark(x) and (any(shape._axes.values()) or not isinstance(x, int)))
           for x in given.values()):  # fmt: skip
        return
    dtype = floats.floating_dtype(*given.values(), *jax.tree.leaves(placement))
    arrays = {}
    for name, x in given.items():
        if x is None:
            raise TypeError(f"{what}: {name}: expected numbers, got None")
        if shape._axes[name] == 1:
            array = floats.as_vectors(x, f"{what}: {name}", dtype, shape._lengths.get(name, 3), keep_dtype=True)
        else:
            array = floats.as_float_array(x, f"{what}: {name}", dtype, keep_dtype=True)
        lowest = (least or {}).get(name, 0)
        # NaN passes, and gives NaN.
        if isinstance(array, np.ndarray) and (array < lowest).any():
            raise ValueError(f"{what}: {name}: expected numbers of at least {lowest:g}, got {x}")
        arrays[name] = floats.owned(array)
    if placement is not None:
        check.require_kind(placement, RigidTransform, f"{what}: placement")
    check.require_same_dtype(**arrays, **({} if placement is None else {"placement": placement}))
    for name, x in arrays.items():
        object.__setattr__(shape, name, x)
    floats.common_batch_shape(**_batch_shapes(shape))


@tree
class Sphere(Shape):
    """A ball.

    At the centre the normal is z of the shape, with the derivatives of a plane across it.

    Args:
        radius: m: a number or (*batch,); 0 for a point.
        placement: RigidTransform X_WS of the centre in the world, or in the frame of whoever asks; None for the
            origin.

    Raises:
        TypeError: dtypes differ, or the placement is no RigidTransform.
        ValueError: shapes do not fit, or a number known while tracing is negative.

    Error: of a distance at most 16 u (|p| + |p_WS| + size), with p_WS the translation of the placement, in "fast" and
        "reproducible"; in "compensated" and "faithful" u of the distance and 256 u^2 of the same. The default precision
        counts. A normal is exact for a point that is as far away as that.

    Example:
        >>> ball = js.Sphere(0.1)
        >>> print(ball(jnp.array([0.0, 0.0, 0.5])), ball(jnp.array([0.0, 0.0, 0.0])))
        0.4 -0.1
    """

    radius: jax.Array
    placement: RigidTransform | None = None

    _axes = {"radius": 0}
    _formula = placed(_sphere)

    if TYPE_CHECKING:

        def __init__(self, radius: ArrayLike, placement: RigidTransform | None = None): ...


@tree
class Capsule(Shape):
    """All that is within a radius of a straight line, along z.

    On the line the normal is x of the shape, with the derivatives of a plane across it.

    Args:
        radius: m: a number or (*batch,).
        length: of the line, without the round ends, m: as the radius.
        placement: RigidTransform X_WS of the middle; None for the origin.

    Raises:
        TypeError: dtypes differ, or the placement is no RigidTransform.
        ValueError: shapes do not fit, or a number known while tracing is negative.

    Error: of a distance at most 16 u (|p| + |p_WS| + size), with p_WS the translation of the placement, in "fast" and
        "reproducible"; in "compensated" and "faithful" u of the distance and 256 u^2 of the same. The default precision
        counts. A normal is exact for a point that is as far away as that.

    Example:
        >>> rod = js.Capsule(0.25, length=2.0)
        >>> print(rod(jnp.array([[0.5, 0.0, 0.9], [0.0, 0.0, 2.0]])))
        [0.25 0.75]
    """

    radius: jax.Array
    length: jax.Array
    placement: RigidTransform | None = None

    _axes = {"radius": 0, "length": 0}
    _formula = placed(_capsule)

    if TYPE_CHECKING:

        def __init__(self, radius: ArrayLike, length: ArrayLike, placement: RigidTransform | None = None): ...


@tree
class Box(Shape):
    """A box. Its sizes may be infinite: a wall, or a bar without ends.

    Inside the normal is that of the nearest face, the first of x, y, z where several are as near, and of the side of
    larger coordinates in the middle. Outside it points from the nearest point of the box. On edges, corners and in the
    middle derivatives are those of the face whose normal it is.

    Args:
        size: (3,) or (*batch, 3), edge lengths along x, y, z, m.
        placement: RigidTransform X_WS of the centre; None for the origin.

    Raises:
        TypeError: dtypes differ, or the placement is no RigidTransform.
        ValueError: shapes do not fit, or a number known while tracing is negative.

    Error: of a distance at most 16 u (|p| + |p_WS| + size), with p_WS the translation of the placement, in "fast" and
        "reproducible"; in "compensated" and "faithful" u of the distance and 256 u^2 of the same. The default precision
        counts. A normal is exact for a point that is as far away as that.

    Example:
        >>> wall = js.Box([0.5, np.inf, np.inf])
        >>> print(wall(jnp.array([2.0, 3.0, 4.0])), wall.normal_at(jnp.array([2.0, 3.0, 4.0])))
        1.75 [1. 0. 0.]
    """

    size: jax.Array
    placement: RigidTransform | None = None

    _axes = {"size": 1}
    _formula = placed(_box)

    if TYPE_CHECKING:

        def __init__(self, size: ArrayLike, placement: RigidTransform | None = None): ...


@tree
class Cylinder(Shape):
    """A cylinder along z.

    Inside the normal is that of the mantle, or of an end if that is nearer; on the axis that of the mantle is x of the
    shape. Kinks are as those of a `Box`.

    Args:
        radius: m: a number or (*batch,).
        length: along z, m: as the radius.
        placement: RigidTransform X_WS of the centre; None for the origin.

    Raises:
        TypeError: dtypes differ, or the placement is no RigidTransform.
        ValueError: shapes do not fit, or a number known while tracing is negative.

    Error: of a distance at most 16 u (|p| + |p_WS| + size), with p_WS the translation of the placement, in "fast" and
        "reproducible"; in "compensated" and "faithful" u of the distance and 256 u^2 of the same. The default precision
        counts. A normal is exact for a point that is as far away as that.

    Example:
        >>> drum = js.Cylinder(0.5, length=1.0)
        >>> print(drum(jnp.array([[2.0, 0.0, 0.0], [0.0, 0.0, 2.0]])))
        [1.5 1.5]
    """

    radius: jax.Array
    length: jax.Array
    placement: RigidTransform | None = None

    _axes = {"radius": 0, "length": 0}
    _formula = placed(_cylinder)

    if TYPE_CHECKING:

        def __init__(self, radius: ArrayLike, length: ArrayLike, placement: RigidTransform | None = None): ...


@tree
class HalfSpace(Shape):
    """The ground under a plane: a function from a point to its signed distance, m.

    Args:
        normal: (3,) or (*batch, 3), out of the ground, in world axes; of any length above zero.
        offset: distance of the plane from the origin of the world along the normal, m: a number or (*batch,).

    Raises:
        TypeError: dtypes differ.
        ValueError: shapes do not fit, or a normal known while tracing is zero.

    Error: none, nothing is computed; of a distance 8 u (|p| + |offset|).

    Example:
        >>> slope = js.HalfSpace([0.0, -3.0, 4.0])
        >>> print(slope(jnp.array([0.0, 0.0, 1.0])), slope.normal_at(jnp.array([0.0, 0.0, 1.0])))
        0.8 [ 0.  -0.6  0.8]
    """

    normal: jax.Array = (0.0, 0.0, 1.0)  # pyright: ignore[reportAssignmentType]
    offset: jax.Array = 0.0  # pyright: ignore[reportAssignmentType]

    _axes = {"normal": 1, "offset": 0}
    placement = None

    if TYPE_CHECKING:

        def __init__(self, normal: ArrayLike = (0.0, 0.0, 1.0), offset: ArrayLike = 0.0): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; the placeholders in trees of axes or specs pass unchecked."""
        if all(map(check.is_tree_mark, (self.normal, self.offset))):
            return
        dtype = floats.floating_dtype(self.normal, self.offset)
        normal = floats.as_vectors(self.normal, "HalfSpace: normal", dtype, keep_dtype=True)
        offset = floats.as_float_array(self.offset, "HalfSpace: offset", dtype, keep_dtype=True)
        check.require_same_dtype(normal=normal, offset=offset)
        floats.common_batch_shape(normal=normal.shape[:-1], offset=offset.shape)
        if isinstance(normal, np.ndarray) and not normal.any(-1).all():
            raise ValueError(f"HalfSpace: normal: expected a vector of a length above 0, got {self.normal}")
        object.__setattr__(self, "normal", floats.owned(normal))
        object.__setattr__(self, "offset", floats.owned(offset))

    def normals_and_distances(self, precision: PrecisionName, p: jax.Array) -> tuple[jax.Array, jax.Array]:
        # In a formula of its own: of a quotient with one divisor for a whole batch compilers make a product.
        normals = units(precision, self.normal)
        distances = _distance(precision, normals, p, floats.expanded(self.offset))
        return jnp.broadcast_to(normals, (*distances.shape, 3)), distances

    def __repr__(self) -> str:
        return f"HalfSpace({check.shown(self.normal, 3)}, {check.shown(self.offset, 0)})"


@exported_tree_of("steps")
class Stairs(Shape):
    """Stairs up along x, as wide as the world: flat ground up to the origin, steps, and flat ground behind them.

    The first tread is from x = 0 to the run, and as high above z = 0 as the rise. The distance is that of the whole
    staircase, also inside: a foot that is deeper below the tread than behind the riser is pushed back. On an edge the
    normal is that of the tread; of two steps as near it is that of the higher one.

    Args:
        steps: how many; static, at least 1.
        run: the depth of each along x, m: a number or (*batch,).
        rise: the height of each, m: as the run.
        placement: RigidTransform X_WS of the foot of the first riser; None for the origin. A turn about z makes them go
            up another way, and one of half a turn, down.

    Raises:
        TypeError: dtypes differ, or the placement is no RigidTransform.
        ValueError: shapes do not fit, there are no steps, or a number known while tracing is negative.

    Error: as of a Box, with steps (run + rise) for its size.

    Example:
        >>> stairs = js.Stairs(8, run=0.25, rise=0.125)
        >>> print(stairs(jnp.array([[-1.0, 0.0, 1.0], [0.375, 0.0, 1.0]])))
        [1.    0.625]
    """

    steps: int
    run: jax.Array
    rise: jax.Array
    placement: RigidTransform | None = None

    _axes = {"run": 0, "rise": 0}
    if TYPE_CHECKING:

        def __init__(self, steps: int, run: ArrayLike, rise: ArrayLike, placement: RigidTransform | None = None): ...

    def __post_init__(self) -> None:
        if isinstance(self.steps, bool) or not isinstance(self.steps, (int, np.integer)) or self.steps < 1:
            raise ValueError(f"Stairs: steps: expected a whole number of at least 1, got {self.steps!r}")
        object.__setattr__(self, "steps", int(self.steps))
        check_shape(self)

    def normals_and_distances(self, precision: PrecisionName, p: jax.Array) -> tuple[jax.Array, jax.Array]:
        lengths = floats.expanded(self.run), floats.expanded(self.rise)
        return tuple(_stairs(precision, p, self.pose, *lengths, steps=self.steps))

    def __repr__(self) -> str:
        return f"Stairs({self.steps}, {super().__repr__().partition('(')[2]}"


@tree
class Union(Shape):
    """Several shapes as one: its distance is the least of theirs, its normal that of the nearest, of the first of some
    that are as near.

    Outside distances are exact where those of the parts are. Inside, where parts overlap, the depth is that in the
    deepest of them, and the surface may be farther.

    Args:
        shapes: such as there are, a HeightField or a Union too. Their batch shapes broadcast.

    Raises:
        TypeError: one is no shape, or dtypes differ.
        ValueError: there are none, or batch shapes do not broadcast.

    Error: that of the parts.

    Example:
        >>> ground = js.Union([js.HalfSpace(), js.Box([0.5, 0.5, 0.5])])
        >>> print(ground(jnp.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0]])))
        [0.75 1.  ]
    """

    shapes: tuple[Shape, ...]

    if TYPE_CHECKING:

        def __init__(self, shapes: Iterable[Shape]): ...

    def __post_init__(self) -> None:
        shapes = tuple(self.shapes) if isinstance(self.shapes, Iterable) else (self.shapes,)
        if shapes and all(map(check.is_tree_mark, jax.tree.leaves(shapes, is_leaf=lambda x: x is None))):
            return
        if not shapes:
            raise ValueError("Union: shapes: expected at least one, got none")
        for i, x in enumerate(shapes):
            if not isinstance(x, Shape):
                check.refuse(f"Union: shapes[{i}]", "a shape, such as js.Box", x)
        require_compatible(**{f"shapes[{i}]": x for i, x in enumerate(shapes)})
        object.__setattr__(self, "shapes", shapes)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return floats.broadcast_shapes(*(x.batch_shape for x in self.shapes))

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return self.shapes[0].dtype

    def normals_and_distances(self, precision: PrecisionName, p: jax.Array) -> tuple[jax.Array, jax.Array]:
        normal, distance = self.shapes[0].normals_and_distances(precision, p)
        for x in self.shapes[1:]:
            n, d = x.normals_and_distances(precision, p)
            # NaN wins.
            is_nearer = ~(d >= distance)
            normal, distance = jnp.where(is_nearer[..., None], n, normal), jnp.where(is_nearer, d, distance)
        return normal, distance

    @property
    def calls_functions(self) -> bool:
        """Whether a part does."""
        return any(x.calls_functions for x in self.shapes)

    def of_many_points(self) -> Self:
        return _changed(self, shapes=tuple(x.of_many_points() for x in self.shapes))

    def __repr__(self) -> str:
        return f"Union({list(self.shapes)})"


@tree_of("function")
class SignedDistance(Shape):
    """A shape of one's own, by its signed distance: for what bodies touch, or for a part of a Union.

        def torus(p):
            x = jnp.hypot(jnp.hypot(p[0], p[1]) - 0.2, p[2])
            return x - 0.05

        ring = js.ShapeContacts(["ring"] * 4, js.SignedDistance(torus), **law)

    The distance is f / |grad f| of the function f, and the normal is the direction of its gradient: exact for signed
    distances, and else to first order. Where the gradient is zero or not finite, both are NaN. Numbers that the
    function closes over may be traced, and differentiated.

    Args:
        function: from a point (3,) in the axes of the shape, about its origin, to a number (): zero on the surface,
            above zero outside; static.
        placement: RigidTransform X_WS of the origin in the world, or in the frame of whoever asks; None for the origin,
            in JAX's default dtype, which `astype` changes.

    Raises:
        TypeError: function is none, or the placement is no RigidTransform.
        ValueError: the function does not return a number in the dtype of its point.

    Error: of the point 16 u (|p| + |p_WS|), with p_WS the translation of the placement; and that of the function.

    Example:
        >>> edge = js.SignedDistance(lambda p: jnp.maximum(p[2] - 1, p[0] - 2))
        >>> print(edge(jnp.array([0.0, 0.0, 3.0])), edge.normal_at(jnp.array([3.0, 0.0, 0.0])))
        2.0 [1. 0. 0.]
    """

    function: Callable[[jax.Array], Any]
    placement: RigidTransform | None = None

    _axes = {}

    if TYPE_CHECKING:

        def __init__(self, function: Callable[[jax.Array], Any], placement: RigidTransform | None = None): ...

    def __post_init__(self) -> None:
        if not callable(self.function):
            check.refuse("SignedDistance: function", "a function from a point (3,) to a number", self.function)
        if all(map(check.is_tree_mark, jax.tree.leaves(self.placement))) and self.placement is not None:
            return
        if self.placement is None:
            dtype = floats.as_dtype(None)
            identity = RigidTransform(Rotation(np.eye(3, dtype=dtype).ravel()), np.zeros(3, dtype))
            object.__setattr__(self, "placement", identity)
        check.require_kind(self.placement, RigidTransform, "SignedDistance: placement")

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(cast(RigidTransform, self.placement).dtype)

    @property
    def calls_functions(self) -> bool:
        return True

    def normals_and_distances(self, precision: PrecisionName, p: jax.Array) -> tuple[jax.Array, jax.Array]:
        at = _locals(precision, p, self.pose)
        n, distance = of_function("SignedDistance: function", self.function, at, precision)
        return _turned(precision, self.pose, n), distance

    def __repr__(self) -> str:
        return f"SignedDistance({self.function!r}, placement={self.placement!r})"


def of_function(
    what: str, function: Callable[[jax.Array], Any], p: jax.Array, precision: PrecisionName
) -> tuple[jax.Array, jax.Array]:
    """The normals (*batch, 3) and distances (*batch,) of points, of a function that is zero on a surface."""
    dtype = np.dtype(p.dtype)

    def distance(point: jax.Array) -> jax.Array:
        x = jnp.asarray(function(point))
        if x.shape or x.dtype != dtype:
            raise ValueError(f"{what}: expected a number, {dtype}[], of a point {dtype}[3], got {check.in_short(x)}")
        return x

    values, gradients = jax.vmap(jax.value_and_grad(distance))(p.reshape((-1, 3)))
    return tuple(_to_first_order(precision, gradients.reshape(p.shape), values.reshape(p.shape[:-1])[..., None]))
