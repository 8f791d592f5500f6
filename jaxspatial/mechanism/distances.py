"""Distances between shapes, and their closest points: spheres, capsules, boxes, cylinders, and half spaces under
them."""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.mechanism.shapes import (
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Shape,
    Sphere,
    clipped,
    direction,
    direction_or,
    local,
)
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.errorfree.primitives import of_any_mesh
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Matrix, Pose, Vector, cross, dot, scaled, unit
from jaxspatial.numerics.numbers import Number, Numbers, constant, halved, high, where
from jaxspatial.numerics.quantity import exported, require_compatible
from jaxspatial.numerics.types import PrecisionName

# In units of eps and of the largest length: lines that are as near cross, and edges that are as parallel have no common
# perpendicular.
_ROUNDING = 4


@exported
class ClosestPoints(NamedTuple):
    """Where two shapes are closest.

    distance: (*batch,) m, below zero where they penetrate. normal: (*batch, 3) of unit length, from shape a to shape b:
        along it they come apart. point_a, point_b: (*batch, 3) on the surfaces, in the axes and from the origin of the
        placements: point_b - point_a is the distance times the normal.

    Example:
        >>> aside = js.RigidTransform(js.Rotation.identity(), [3.0, 0.0, 0.0])
        >>> closest = js.closest_points(js.Sphere(1.0), js.Sphere(0.5, aside))
        >>> print(closest.distance, closest.normal)
        1.5 [1. 0. 0.]
    """

    distance: jax.Array
    normal: jax.Array
    point_a: jax.Array
    point_b: jax.Array


def distance(a: Shape, b: Shape, *, precision: PrecisionName = None) -> jax.Array:
    """The signed distance between two shapes: below zero how far they have to move to come apart.

        X_WF = js.forward_kinematics(mech, q, frames)
        links = js.Capsule(radii, lengths, X_WF)                     # a batch of n
        i, j = np.triu_indices(n, 1)
        of_pairs = js.distance(*(jax.tree.map(lambda x: x[k], links) for k in (i, j)))

    A Sphere may be beside any shape; a Capsule, a Box or a Cylinder beside one of these or a HalfSpace, but for two
    Cylinders. The distance can be differentiated by placements and sizes, any number of times. Where the closest points
    jump, or the direction in which shapes come apart, derivatives are those of one side. Axes of capsules that cross
    come apart along their common perpendicular, and along x of a where they are parallel. What meets the rim of a
    Cylinder is found by bisection, to the last bit: a loop of as many turns as numbers have digits.

    Args:
        a: a shape; its placement and that of b are in the same axes, from the same origin.
        b: another; batch shapes broadcast.
        precision: name of a precision; None takes the default.

    Returns:
        The distances (*batch,), m.

    Raises:
        TypeError: one is no shape, dtypes differ, or there is no distance between these two.
        ValueError: batch shapes do not broadcast.

    Error: at most 64 u (|p_AB| + sizes of both) and 4 u of the positions of both, in every precision; of a Sphere that
        of the shape beside it.

    Example:
        >>> aside = js.RigidTransform(js.Rotation.identity(), [3.0, 0.0, 0.0])
        >>> print(js.distance(js.Box([2.0, 2.0, 2.0]), js.Sphere(0.5, aside)))
        1.5
    """
    apart, _ = _distance_and_points(a, b, "distance")
    return of_any_mesh(apart)(precision)


def closest_points(a: Shape, b: Shape, *, precision: PrecisionName = None) -> ClosestPoints:
    """The closest points of two shapes, the direction from one to the other, and their distance.

    Shapes and distances are those of `distance`. Where several points are as close, as between parallel faces, it is
    one of them, and derivatives are those of that one: without curvature of its choice. Where shapes penetrate, the
    points are those that touch once b has moved out along the normal.

    Args:
        a: a shape, as of `distance`.
        b: another; batch shapes broadcast.
        precision: name of a precision; None takes the default.

    Returns:
        ClosestPoints over the common batch.

    Raises:
        TypeError: one is no shape, dtypes differ, or there is no distance between these two.
        ValueError: batch shapes do not broadcast.

    Error: of the distance that of `distance`; points are closest for shapes that are as far away as that.

    Example:
        >>> aside = js.RigidTransform(js.Rotation.identity(), [3.0, 0.0, 0.0])
        >>> found = js.closest_points(js.Box([2.0, 2.0, 2.0]), js.Sphere(0.5, aside))
        >>> print(found.point_a, found.point_b)
        [1. 0. 0.] [2.5 0.  0. ]
    """
    _, points = _distance_and_points(a, b, "closest_points")
    return of_any_mesh(points)(precision)


def _distance_and_points(a, b, what: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """(the distance, the ClosestPoints) of two shapes, as functions of the precision."""
    for name, x in (("a", a), ("b", b)):
        if not isinstance(x, Shape):
            check.refuse(f"{what}: {name}", "a shape, such as js.Capsule", x)
    require_compatible(a=a, b=b)
    a, b = floats.narrowed((a, b))
    kinds = f"{type(a).__name__} and {type(b).__name__}"
    is_turned = (
        isinstance(b, Sphere)
        or (isinstance(a, HalfSpace) and isinstance(b, _CORES))
        or (type(b), type(a)) in _FEATURES.keys() - {(type(a), type(b))}
    )
    if is_turned:
        a, b = b, a
    if isinstance(a, Sphere) or (isinstance(a, _CORES) and isinstance(b, HalfSpace)):
        points = functools.partial(_beside_sphere if isinstance(a, Sphere) else _beside_half_space, a, b)
        apart: Callable[..., Any] = lambda precision: points(precision).distance  # noqa: E731
    elif (type(a), type(b)) in _FEATURES:
        given = _FEATURES[type(a), type(b)], _Cores.of(a), _Cores.of(b)
        apart, points = functools.partial(_distance, *given), functools.partial(_points, *given)
        if isinstance(b, Cylinder):
            points = functools.partial(_aligned, points)
    else:
        expected = "a Sphere, or a Capsule, a Box or a Cylinder and one of these or a HalfSpace, but no two Cylinders"
        instead = "" if kinds != "Cylinder and Cylinder" else "; take a Capsule for one, or the distances of its points"
        raise TypeError(f"{what}: expected {expected}, got {kinds}{instead}")
    return apart, (lambda precision: _reversed(points(precision))) if is_turned else points


def _reversed(x: ClosestPoints) -> ClosestPoints:
    return ClosestPoints(x.distance, -x.normal, x.point_b, x.point_a)


# -- beside spheres and half spaces -----------------------------------------------------------------------------------


def _beside_sphere(a: Sphere, b: Shape, precision: PrecisionName) -> ClosestPoints:
    center = a.pose.p
    n, from_center = b.normals_and_distances(precision, jnp.asarray(center))
    return ClosestPoints(*_around(precision, center, n, *map(floats.expanded, (from_center, a.radius))))


@formula
def _around(center: Vector, n: Vector, distance: Numbers, radius: Numbers) -> list[Any]:
    return [distance[0] - radius[0], -n, center - radius[0] * n, center - distance[0] * n]


def _beside_half_space(a, b: HalfSpace, precision: PrecisionName) -> ClosestPoints:
    """Of the point of a that is deepest, the one of larger coordinates of some that are."""
    core = _Cores.of(a)
    n, _ = b.normals_and_distances(precision, jnp.asarray(core.pose.p))
    shares = (_lowest_of_cylinder if isinstance(a, Cylinder) else _lowest)(precision, core.pose, n)
    lowest = _placed(precision, core.pose, core.half, shares)
    from_center = b.normals_and_distances(precision, lowest)[1]
    return ClosestPoints(*_around(precision, lowest, n, floats.expanded(from_center), core.radius))


@formula
def _lowest(X: Pose, n: Vector) -> Vector:
    return Vector(*(where(x > 0, constant(x, -1), 1.0) for x in X.R.T @ n))


@formula
def _lowest_of_cylinder(X: Pose, n: Vector) -> Vector:
    down = -(X.R.T @ n)
    x, y, _ = _horizontal(down)
    return Vector(x, y, where(down.z < 0, constant(down.z, -1), 1.0))


def _horizontal(v: Vector) -> Vector:
    """The direction of (x, y, 0); x where both are zero."""
    return direction(Vector(v.x, v.y, constant(v.x, 0)), axis=0)[0]


def _level_across(v: Vector) -> Vector:
    """The horizontal direction across v; x where v is upright."""
    return _horizontal(Vector(-v.y, v.x, v.z))


@formula
def _placed(X: Pose, half: Vector, shares: Vector) -> Vector:
    return X.p + X.R @ _times(half, shares)


def _times(half: Vector, shares: Vector) -> Vector:
    return Vector(*(h * s for h, s in zip(half, shares, strict=True)))


# -- capsules and boxes -----------------------------------------------------------------------------------------------


_CORES = Capsule, Box, Cylinder


class _Cores(NamedTuple):
    """Boxes, and lines as boxes, with something around: all points p + R (half x) with |x| <= 1, and the radius about.

    half (*batch, 3), radius (*batch, 1). Of a cylinder x is in the unit circle across z.
    """

    pose: Pose
    half: Any
    radius: Any

    @classmethod
    def of(cls, shape) -> "_Cores":
        if isinstance(shape, Box):
            return cls(shape.pose, shape.size / 2, np.zeros(1, shape.dtype))
        if isinstance(shape, Cylinder):
            library = np if isinstance(shape.radius, np.ndarray) and isinstance(shape.length, np.ndarray) else jnp
            radius, half = library.broadcast_arrays(shape.radius, shape.length / 2)
            return cls(shape.pose, library.stack([radius, radius, half], -1), np.zeros(1, shape.dtype))
        library = np if isinstance(shape.length, np.ndarray) else jnp
        zero = library.zeros_like(shape.length)
        return cls(shape.pose, library.stack([zero, zero, shape.length / 2], -1), floats.expanded(shape.radius))


class _Features(NamedTuple):
    """Where two cores are closest. of_a, of_b (*batch, 3): shares of half sizes, from -1 to 1. apart (*batch, 3): the
    direction in which they come apart, where `penetrate` (*batch, 1) is one, or else where they touch."""

    of_a: Any
    of_b: Any
    apart: Any
    penetrate: Any


def _distance(features_of: Callable[..., _Features], a: _Cores, b: _Cores, precision: PrecisionName) -> jax.Array:
    leaves, structure = jax.tree.flatten((a, b))
    is_data = [not isinstance(x, np.ndarray) for x in leaves]

    def cores(data: Sequence[Any]):
        rest = iter(data)
        whole = [next(rest) if own else x for own, x in zip(is_data, leaves, strict=True)]
        return jax.tree.unflatten(structure, whole)

    def separation(data, features: _Features):
        a, b = cores(data)
        return _separated(precision, *a, *b, *features)[0]

    # The closest points do not count in first derivatives: to differentiate them would bring in rounding errors, which
    # are large where lines are nearly parallel. Second derivatives are those of the first.
    @jax.custom_jvp
    def of(*data):
        return separation(data, features_of(precision, *cores(data)))

    @of.defjvp
    def _(primals, tangents):
        features = features_of(precision, *cores(primals))
        return jax.jvp(lambda *data: separation(data, features), primals, tangents)

    return of(*(x for own, x in zip(is_data, leaves, strict=True) if own))


def _points(features_of: Callable[..., _Features], a: _Cores, b: _Cores, precision: PrecisionName) -> ClosestPoints:
    found = _separated(precision, *a, *b, *features_of(precision, a, b))
    return ClosestPoints(_distance(features_of, a, b, precision), *found[1:])


def _aligned(points: Callable[..., ClosestPoints], precision: PrecisionName) -> ClosestPoints:
    """With the point of b that is behind that of a. Where two directions are as good, to rounding errors, it makes the
    difference."""
    x = points(precision)
    return x._replace(point_b=_behind(precision, x.point_a, x.normal, floats.expanded(x.distance)))


@formula
def _behind(point: Vector, n: Vector, distance: Numbers) -> Vector:
    return point + distance[0] * n


@formula
def _separated(
    X_A: Pose, half_a: Vector, r_a: Numbers, X_B: Pose, half_b: Vector, r_b: Numbers,
    of_a: Vector, of_b: Vector, apart: Vector, penetrate: Numbers,
) -> list[Any]:  # fmt: skip
    """The numbers of ClosestPoints, of two cores and their features."""
    own, other = X_A.R @ _times(half_a, of_a), X_B.R @ _times(half_b, of_b)
    w = (X_B.p - X_A.p) + (other - own)
    n, length = direction_or(w, apart, dot(apart, w))
    is_penetrating = high(penetrate[0]) > 0
    n = Vector(*(where(is_penetrating, x, y) for x, y in zip(apart, n, strict=True)))
    length = where(is_penetrating, dot(apart, w), length)
    return [length - r_a[0] - r_b[0], n, X_A.p + own + r_a[0] * n, X_B.p + other - r_b[0] * n]


@formula
def _of_two_lines(X_A: Pose, half_a: Vector, X_B: Pose, half_b: Vector) -> list[Any]:
    """Of lines along z: the least of the distances between one end and the other line, and of that between points
    inside both. [Ericson 2005, 5.1.9]

    With the sum u and the difference v of the directions, which are perpendicular, the last is two problems of one
    unknown each: no determinant that vanishes for parallel lines.
    """
    a, b = X_A.R.T.z, X_B.R.T.z
    (x, y, z, h_a, h_b), _ = scaled((*(X_B.p - X_A.p), half_a.z, half_b.z))
    r = Vector(x, y, z)
    u, v = a + b, b - a

    def on_a(t: Number) -> Number:
        return clipped(dot(r + t * b, a), h_a)

    def on_b(s: Number) -> Number:
        return clipped(-dot(r - s * a, b), h_b)

    sums = differences = constant(h_a, 0)
    for _ in range(2):
        w = r + differences * v - sums * u
        sums, differences = sums + _quotient(dot(w, u), dot(u, u)), differences - _quotient(dot(w, v), dot(v, v))
    s = on_a(clipped(differences - sums, h_b))
    t = on_b(s)
    w = r + t * b - s * a
    least = dot(w, w)
    for x, y in (*((x, on_b(x)) for x in (h_a, -h_a)), *((on_a(x), x) for x in (h_b, -h_b))):
        w = r + y * b - x * a
        square = dot(w, w)
        is_nearer = square < least
        least, s, t = where(is_nearer, square, least), where(is_nearer, x, s), where(is_nearer, y, t)
    n, is_parallel = _across(a, b)
    n = Vector(*(where(is_parallel, x, y) for x, y in zip(X_A.R.T.x, n, strict=True)))
    eps = float(floats.finfo(h_a.dtype).eps)
    zero = constant(h_a, 0)
    touch = where(least <= (_ROUNDING * eps) ** 2, constant(h_a, 1), zero)
    return [Vector(zero, zero, _quotient(s, h_a)), Vector(zero, zero, _quotient(t, h_b)), n, (touch,)]


def _quotient(x: Number, y: Number) -> Number:
    """x / y, and 0 where y is."""
    is_zero = high(y) == 0
    return where(is_zero, 0.0, x / where(is_zero, 1.0, y))


def _across(a: Vector, b: Vector) -> tuple[Vector, Any]:
    """(the common perpendicular of two unit vectors, whether they are parallel, to rounding).

    As the product of their sum and difference, made perpendicular: it keeps its digits where they are nearly parallel.
    """
    u, v = a + b, b - a
    is_acute = high(dot(a, b)) >= 0
    large = Vector(*(where(is_acute, x, y) for x, y in zip(u, v, strict=True)))
    small = Vector(*(where(is_acute, y, x) for x, y in zip(u, v, strict=True)))
    small = small - (dot(small, large) / dot(large, large)) * large
    eps = float(floats.finfo(a.x.dtype).eps)
    is_parallel = high(dot(small, small)) <= (_ROUNDING * eps) ** 2
    product = cross(large, small)
    return unit(Vector(*(where(is_parallel, float(i == 0), x) for i, x in enumerate(product)))), is_parallel


# -- lines and boxes --------------------------------------------------------------------------------------------------


@formula
def _in_b(X_A: Pose, half_a: Vector, X_B: Pose, half_b: Vector) -> list[Any]:
    """The pose of A in the axes of B and the half sizes of both, in units of the largest length."""
    R, p = X_B.R.T @ X_A.R, X_B.R.T @ (X_A.p - X_B.p)
    (p, half_a, half_b), _ = scaled((*p, *half_a, *half_b))
    return [R, p, half_a, half_b]


def _gap(p: Vector, R: Matrix, half_a: Vector, half_b: Vector, is_line: bool) -> tuple[Number, Vector]:
    """The widest gap between two boxes along normals of faces and common perpendiculars of edges, below zero where they
    penetrate, and its direction from B to A: of two sums of lines no other directions come into question."""
    columns, e = R.T, [Vector(*(constant(p.x, int(i == k)) for i in range(3))) for k in range(3)]
    of_a, of_b = [(columns[k], half_a[k]) for k in range(3)], [(e[k], half_b[k]) for k in range(3)]
    axes: list[tuple[Vector, Any]] = [(x, None) for x in (e if is_line else (*e, *columns))]
    axes += [_across(columns[k], e[i]) for k in ((2,) if is_line else range(3)) for i in range(3)]
    widest = normal = None
    for n, is_none in axes:
        along = dot(p, n)
        reach = [half * abs(dot(x, n)) for x, half in (*of_a, *of_b)]
        gap = abs(along) - functools.reduce(lambda x, y: x + y, reach)
        outward = Vector(*(where(along < 0, -c, c) for c in n))
        if widest is None or normal is None:
            widest, normal = gap, outward
            continue
        # Rounding errors do not choose an edge in place of a face.
        is_wider = gap > widest + _ROUNDING * float(floats.finfo(p.x.dtype).eps)
        is_wider = is_wider if is_none is None else is_wider & ~is_none
        widest = where(is_wider, gap, widest)
        normal = Vector(*(where(is_wider, x, y) for x, y in zip(outward, normal, strict=True)))
    assert widest is not None and normal is not None
    return widest, normal


@formula
def _moved_apart(R: Matrix, p: Vector, half_a: Vector, half_b: Vector, X_B: Matrix, *, is_line: bool) -> list[Any]:
    """p of A moved out of B, where they penetrate; the direction from A to B in the world; whether they penetrate."""
    gap, n = _gap(p, R, half_a, half_b, is_line)
    is_in = high(gap) < 0
    moved = p - where(is_in, gap, 0.0) * n
    return [moved, X_B @ -n, (where(is_in, constant(gap, 1), constant(gap, 0)),)]


@formula
def _line_to_box(c: Vector, e: Vector, half: Numbers, box: Vector) -> list[Any]:
    """Of the points c + s e, |s| <= half, the nearest to a box: (s / half, shares of the box, the squared distance).

    The derivative by s of half the square is piecewise linear, and never falls. Its zero is between the bounds of two
    slabs, or of the line, that are next to one another.
    """
    h = half[0]

    def beyond(s: Number) -> Vector:
        return Vector(*(x - clipped(x, b) for x, b in zip(c + s * e, box, strict=True)))

    def slope(s: Number) -> Number:
        return dot(e, beyond(s))

    low, high_, g_low, g_high = -h, h, slope(-h), slope(h)
    # Where it has one sign, an end is nearest.
    is_first, is_last = g_low >= 0, g_high <= 0
    both = is_first & is_last
    for x, d, b in zip(c, e, box, strict=True):
        is_along = high(abs(d)) == 0
        per = where(is_along, 1.0, d)
        for side in (b, -b):
            s = clipped(where(is_along, 0.0, (side - x) / per), h)
            g = slope(s)
            is_below, is_above = (g <= 0) & (s > low), (g >= 0) & (s < high_)
            low, g_low = where(is_below, s, low), where(is_below, g, g_low)
            high_, g_high = where(is_above, s, high_), where(is_above, g, g_high)
    rise = g_high - g_low
    is_flat = high(rise) <= 0
    between = low - (g_low / where(is_flat, 1.0, rise)) * (high_ - low)
    s = where(is_flat, halved(low + high_), between)
    s = where(is_first & ~both, -h, where(is_last & ~both, h, clipped(s, h)))
    at, w = c + s * e, beyond(s)
    return [(_quotient(s, h),), _shares(at, box), (dot(w, w),)]


def _shares(x: Vector, half: Vector) -> Vector:
    return Vector(*(_quotient(clipped(c, h), h) for c, h in zip(x, half, strict=True)))


@formula
def _point_to_box(p: Vector, X: Pose, box: Vector) -> list[Any]:
    """(shares of the box, the squared distance) of a point from a box at X."""
    x = local(p, X)
    w = Vector(*(c - clipped(c, b) for c, b in zip(x, box, strict=True)))
    return [_shares(x, box), (dot(w, w),)]


def _of_line_and_box(precision: PrecisionName, a: _Cores, b: _Cores) -> _Features:
    R, p, half_a, half_b = _in_b(precision, a.pose, a.half, b.pose, b.half)
    moved, n, is_in = _moved_apart(precision, R, p, half_a, half_b, b.pose.R, is_line=True)
    share, of_b, _ = _line_to_box(precision, moved, R[..., 2::3], half_a[..., 2:], half_b)
    zero = jnp.zeros_like(share)
    return _Features(jnp.concatenate([zero, zero, share], -1), of_b, n, is_in)


# The corners of a box, and its edges: of each its axis, and the shares of its middle.
_CORNERS = np.array(list(itertools.product((-1, 1), repeat=3)))
_AXES = np.repeat(np.arange(3), 4)
_MIDDLES = np.array([np.insert(x, k, 0) for k in range(3) for x in itertools.product((-1, 1), repeat=2)])


def _of_boxes(precision: PrecisionName, a: _Cores, b: _Cores) -> _Features:
    """The closest of the edges of A and the box B, and of the corners of B and the box A."""
    R, p, half_a, half_b = _in_b(precision, a.pose, a.half, b.pose, b.half)
    moved, n, is_in = _moved_apart(precision, R, p, half_a, half_b, b.pose.R, is_line=False)
    R_, moved, own, other = (x[..., None, :] for x in (R, moved, half_a, half_b))
    dtype = np.dtype(p.dtype)
    middles, corners = _MIDDLES.astype(dtype), _CORNERS.astype(dtype)
    centers = _placed(precision, Pose(R_, moved), own, middles)
    edges = jnp.stack([R[..., k::3] for k in _AXES], -2)
    lengths = jnp.stack([half_a[..., k : k + 1] for k in _AXES], -2)
    share, of_b, squares = _line_to_box(precision, centers, edges, lengths, other)
    batch = share.shape[:-2]
    is_along = jnp.asarray(_AXES[:, None] == np.arange(3))
    of_a = jnp.where(is_along, share, jnp.broadcast_to(middles, (*batch, 12, 3)))
    at = jnp.broadcast_to(other, (*batch, 8, 3)) * jnp.broadcast_to(corners, (*batch, 8, 3))
    corners_a, more = _point_to_box(precision, at, Pose(R_, moved), own)
    of_a = jnp.concatenate([of_a, corners_a], -2)
    of_b = jnp.concatenate([of_b, jnp.broadcast_to(corners, (*batch, 8, 3))], -2)
    squares = jnp.concatenate([squares, more], -2)
    of_a, of_b = _taken(jnp.argmin(squares[..., 0], -1), of_a, of_b)
    return _Features(of_a, of_b, n, is_in)


def _taken(which: jax.Array, *several: jax.Array) -> list[jax.Array]:
    """Of arrays (*batch, k, n) the rows (*batch, n) of these numbers (*batch,)."""
    return [jnp.take_along_axis(x, which[..., None, None], -2)[..., 0, :] for x in several]


# -- lines and boxes beside cylinders ---------------------------------------------------------------------------------


def _root(slope: Callable[[Any], Any], low, high):
    """Where numbers that are not above zero at low go above it, by bisection to the last bit; low where they nowhere
    are below. Its derivatives are those of the root."""
    low, high = map(lax.stop_gradient, (low, high))

    def bisected(slope: Callable[[Any], Any], _):
        def halve(_, ends):
            low, high = ends
            middle = (low + high) / 2
            is_low = slope(middle) <= 0
            return jnp.where(is_low, middle, low), jnp.where(is_low, high, middle)

        return lax.fori_loop(0, floats.finfo(low.dtype).nmant + 3, halve, (low, high))[0]

    def inverse(rate: Callable[[Any], Any], y):
        by = rate(jnp.ones_like(y))
        return y / jnp.where(by == 0, 1, by)

    return lax.custom_root(slope, low, bisected, inverse)


def _from_axis(v: Vector) -> Number:
    """The distance of a point from the axis z."""
    square = v.x * v.x + v.y * v.y
    is_zero = high(square) == 0
    return where(is_zero, 0.0, where(is_zero, 1.0, square).sqrt())


@formula
def _pull(c: Vector, e: Vector, s: Numbers, half: Vector) -> list[Any]:
    """Of the points c + s e: the derivative by s of half the squared distance from a cylinder. It never falls."""
    at = c + s[0] * e
    rho = _from_axis(at)
    is_beside = high(rho) > high(half.x)
    outward = (rho - half.x) / where(is_beside, rho, 1.0) * (at.x * e.x + at.y * e.y)
    return [(where(is_beside, outward, 0.0) + (at.z - clipped(at.z, half.z)) * e.z,)]


@formula
def _point_to_cylinder(c: Vector, e: Vector, s: Numbers, half: Vector) -> list[Any]:
    """(shares of the cylinder, the squared distance) of the points c + s e."""
    at = c + s[0] * e
    rho = _from_axis(at)
    per = where(high(rho) > high(half.x), rho, half.x)
    nearest = Vector(_quotient(at.x, per), _quotient(at.y, per), _quotient(clipped(at.z, half.z), half.z))
    w = at - _times(half, nearest)
    return [nearest, (dot(w, w),)]


def _lines_to_cylinder(precision: PrecisionName, c, e, half, cylinder) -> list[Any]:
    """Of the points c + s e, |s| <= half (*batch, 1), the nearest to a cylinder: (s / half, shares of the cylinder, the
    squared distance)."""

    def slope(s):
        return _pull(precision, c, e, s, cylinder)[0]

    first = slope(-half)
    half = jnp.broadcast_to(half, first.shape)
    last = slope(half)
    s = _root(slope, -half, half)
    is_first, is_last = first >= 0, last <= 0
    s = jnp.where(is_first, jnp.where(is_last, 0, -half), jnp.where(is_last, half, s))
    shares, square = _point_to_cylinder(precision, c, e, s, cylinder)
    return [s / jnp.where(half == 0, 1, half), shares, square]


@formula
def _along_rim(c: Vector, e: Vector, half: Vector, side: Numbers) -> list[Any]:
    """Of lines along unit vectors e through c: (t, m, numbers), with t and m across e, t across z too. Of a line and
    the rim at one side of the cylinder the gap along cos(a) t + sin(a) m is

        A cos(a) + B sin(a) - sqrt(r^2 cos^2(a) + b^2 sin^2(a))

    for a between 0 and a right angle: numbers are A >= 0, B, r^2, b^2 and r^2 - b^2.
    """
    t = _level_across(e)
    along = dot(c, t)
    t = Vector(*(where(along < 0, -x, x) for x in t))
    m = side[0] * cross(e, t)
    square = half.x * half.x
    return [t, m, (abs(along), dot(c, m) - half.z * abs(m.z), square, square * (e.z * e.z), square * (m.z * m.z))]


@formula
def _turning(at: Numbers, x: Numbers) -> list[Any]:
    """The derivative of minus that gap by the angle, where sin : cos = x : 1 - x."""
    A, B, r2, b2, difference = at
    c, s = 1 - x[0], x[0]
    square = r2 * c * c + b2 * s * s
    is_none = high(square) <= 0
    root = where(is_none, 1.0, square).sqrt()
    return [(A * s - B * c - where(is_none, 0.0, difference * s * c / root),)]


@formula
def _between_directions(t: Vector, m: Vector, x: Numbers) -> Vector:
    return unit((1 - x[0]) * t + x[0] * m)


def _of_rims(precision: PrecisionName, c, e, half):
    """The directions (*batch, 2 k, 3), across each of k lines (*batch, k, 3), in which the gap between it and a rim is
    widest: of the upper and of the lower rim.

    The gap has one maximum inside of the right angle if B >= 0. Else there is none, or a minimum and a maximum on
    either side of the place where they meet as B grows: the point of the evolute of the ellipse. [Farouki 2008, 7]
    """
    c, e = (jnp.concatenate([x, x], -2) for x in (c, e))
    sides = np.repeat(np.array([1, -1], e.dtype), e.shape[-2] // 2)[:, None]
    t, m, at = _along_rim(precision, c, e, half, sides)
    A, B, r2, b2 = (at[..., i : i + 1] for i in range(4))
    cosine, sine = jnp.cbrt(lax.stop_gradient(A * b2)), jnp.cbrt(lax.stop_gradient(abs(B) * r2))
    total = cosine + sine
    low = jnp.where((B < 0) & (total > 0), sine / jnp.where(total > 0, total, 1), 0)
    x = _root(lambda x: _turning(precision, at, x)[0], low, jnp.ones_like(low))
    return _between_directions(precision, t, m, x)


_horizontals, _levels_across = formula(_horizontal), formula(_level_across)


@formula
def _on_rims(v: Vector, sides: Numbers) -> Vector:
    x, y, _ = _horizontal(v)
    return Vector(sides[0] * x, sides[0] * y, sides[1])


@formula
def _gap_along(n: Vector, p: Vector, R: Matrix, half_a: Vector, half_b: Vector) -> list[Any]:
    """(the direction n or -n, from a cylinder B to a box A, the gap between them along it)."""
    along = dot(p, n)
    gap = abs(along) - half_b.x * _from_axis(n) - half_b.z * abs(n.z)
    for k, half in enumerate(half_a):
        gap = gap - half * abs(dot(R.T[k], n))
    return [Vector(*(where(along < 0, -x, x) for x in n)), (gap,)]


def _of_cylinder(precision: PrecisionName, a: _Cores, b: _Cores, *, is_line: bool) -> _Features:
    """The closest of the edges of A and the cylinder, and of points on its rims and the box A.

    Where they penetrate, it is by the least gap, below zero, along: the axis of the cylinder; normals of faces of the
    box; horizontal directions, to corners and across edges; and those across an edge and a rim. No others come into
    question for a sum of a line or a box, a circle and a line. What touches is then found at one length more apart,
    where it is the same.
    """
    R, p, half_a, half_b = _in_b(precision, a.pose, a.half, b.pose, b.half)
    batch, dtype = p.shape[:-1], np.dtype(p.dtype)
    # With one more axis, over parts of each item.
    wide: list[Any] = [jnp.broadcast_to(x, (*batch, x.shape[-1]))[..., None, :] for x in (R, p, half_a, half_b)]
    R_, center, own, other = wide
    axes, middles, corners = np.array([2]), np.zeros((1, 3), dtype), np.array([[0, 0, -1], [0, 0, 1]], dtype)
    if not is_line:
        axes, middles, corners = _AXES, _MIDDLES.astype(dtype), _CORNERS.astype(dtype)
    columns = [R[..., k::3] for k in range(3)]
    edges = jnp.stack([columns[k] for k in axes], -2)
    lengths = jnp.stack([half_a[..., k : k + 1] for k in axes], -2)

    faces = [jnp.broadcast_to(np.array([0, 0, 1], dtype), p.shape), *(() if is_line else columns)]
    across = _levels_across(precision, jnp.stack([columns[k] for k in sorted(set(axes.tolist()))], -2))
    to_corners = _horizontals(precision, _placed(precision, Pose(R_, center), own, corners))
    of_rims = _of_rims(precision, _placed(precision, Pose(R_, center), own, middles), edges, other)
    normals = jnp.concatenate([jnp.stack(faces, -2), across, to_corners, of_rims], -2)
    normals, gaps = _gap_along(precision, normals, center, R_, own, other)
    # Rounding errors do not choose an edge in place of a face.
    is_face = np.arange(gaps.shape[-2]) < len(faces)
    margin = is_face * dtype.type(_ROUNDING * float(floats.finfo(dtype).eps))
    n, gap = _taken(jnp.argmax(gaps[..., 0] + jnp.broadcast_to(margin, gaps.shape[:-1]), -1), normals, gaps)
    is_in = gap < _ROUNDING * float(floats.finfo(dtype).eps)
    moved: Any = (p + jnp.where(is_in, 1 - gap, 0) * n)[..., None, :]

    centers = _placed(precision, Pose(R_, moved), own, middles)
    share, of_b, squares = _lines_to_cylinder(precision, centers, edges, lengths, other)
    is_along = jnp.asarray(axes[:, None] == np.arange(3))
    of_a = jnp.where(is_along, share, jnp.broadcast_to(middles, (*batch, len(axes), 3)))
    if not is_line:
        # Where faces of the box may touch: each rim where the cylinder is farthest along the normal, and against it.
        sides = np.repeat(np.array(list(itertools.product((-1, 1), repeat=2)), dtype), 3, 0)
        rims = _on_rims(precision, jnp.concatenate([jnp.stack(columns, -2)] * 4, -2), sides)
        shares, more = _point_to_box(precision, rims * other, Pose(R_, moved), own)
        of_a, of_b, squares = (jnp.concatenate(x, -2) for x in ((of_a, shares), (of_b, rims), (squares, more)))
    of_a, of_b = _taken(jnp.argmin(squares[..., 0], -1), of_a, of_b)
    return _Features(of_a, of_b, _away(precision, b.pose.R, n), is_in.astype(dtype))


@formula
def _away(R: Matrix, n: Vector) -> Vector:
    return R @ -n


_FEATURES = {
    (Capsule, Capsule): lambda precision, a, b: _Features(*_of_two_lines(precision, a.pose, a.half, b.pose, b.half)),
    (Capsule, Box): _of_line_and_box,
    (Box, Box): _of_boxes,
    (Capsule, Cylinder): functools.partial(_of_cylinder, is_line=True),
    (Box, Cylinder): functools.partial(_of_cylinder, is_line=False),
}
