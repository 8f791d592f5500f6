"""Bodies of uniform density: what the constructors of `SpatialInertia` check and compute.

A formula gives [(mass,), com, central], or without the com [(mass,), central], of a mass or density (amount,), lengths
and a direction. Squares are multiplied into the mass one factor at a time, so that nothing over- or underflows before
the result does.
"""

import math
import operator
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.inertia.composition import first, sums_over_items
from jaxspatial.numerics import floats, linear
from jaxspatial.numerics.errorfree.primitives import computed_at_once
from jaxspatial.numerics.floats import expanded
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.functions import pi
from jaxspatial.numerics.linear import PLACES, Matrix, Symmetric, Vector, cross, dot, left_sum
from jaxspatial.numerics.numbers import Number, Numbers, constant, high, noinline_pairs, where
from jaxspatial.numerics.numbers.double_word import from_double_word
from jaxspatial.numerics.promise import Normwise, OfSum, Promise
from jaxspatial.numerics.quantity import require_compatible
from jaxspatial.numerics.types import ArrayLike, PrecisionName

MASS, CENTRAL = Promise(12, 64), Promise(20, 64)
# Of tetrahedra by density: of a determinant.
DETERMINANT, TETRAHEDRON_COM = Normwise(12, "size", u2=64), Normwise(4, "|vertices|", rounded=4)
# Of m triangles, L = ceil(log2 m). Counted: of d, 6 V of a tetrahedron, (8 2 / sqrt(3) + L) u of |a| |b - a| |c - a|,
# as the permanent of three unit vectors is at most 2 / sqrt(3); so of V (1.9 + L / 6) u S, of com (3.4 + 0.3 L) u r S /
# V, where com is no farther than r and S / V at least 6; and of central (13.6 + 1.02 L) u mass r^2 S / V.
MESH_VOLUME, MESH_COM = OfSum(2, of="S", u2=8), OfSum(4, of="r S / V", u2=8)
MESH_CENTRAL = OfSum(15, of="mass r^2 S / V", u2=8)

# -- what all constructors have in common -----------------------------------------------------------------------------


def body(
    shape: Callable,
    mass: ArrayLike | None,
    density: ArrayLike | None,
    precision: PrecisionName,
    lengths: Mapping[str, Any],
    axis: ArrayLike | None = None,
    may_be_zero: Container[str] = (),
    n: int = 1,
) -> tuple:
    """(mass, com, central) that a formula gives for lengths, or vectors of n lengths, and an axis."""
    name = shape.__name__
    kind, amount = single_amount(name, mass, density)
    dtype = dtype_of(*lengths.values(), amount, axis)
    arrays = {kind: expanded(number(amount, f"{name}: {kind}", dtype, may_be_zero=True))}
    for key, x in lengths.items():
        if n == 1:
            arrays[key] = expanded(number(x, f"{name}: {key}", dtype, key in may_be_zero))
        else:
            arrays[key] = floats.as_vectors(x, f"{name}: {key}", dtype, size=n, keep_dtype=True)
            _require_positive(arrays[key], f"{name}: {key}", key in may_be_zero)
    inner, outer = arrays.get("inner_radius"), arrays.get("outer_radius")
    if isinstance(inner, np.ndarray) and isinstance(outer, np.ndarray) and (inner > outer).any():
        raise ValueError(f"{name}: inner_radius: expected at most outer_radius {outer[..., 0]}, got {inner[..., 0]}")
    if axis is not None:
        arrays["axis"] = floats.as_vectors(axis, f"{name}: axis", dtype)
    return computed(shape, precision, arrays, by=kind)


def single_amount(name: str, mass: ArrayLike | None, density: ArrayLike | None) -> tuple[str, Any]:
    """("mass", mass) or ("density", density), of which exactly one is passed."""
    if (mass is None) == (density is None):
        came = "neither" if mass is None else "both"
        raise TypeError(f"{name}: expected either mass or density, got {came}")
    return ("density", density) if mass is None else ("mass", mass)


def dtype_of(*values) -> np.dtype | None:
    """That of the first array of floating point among the values, for all Python numbers; None where there is none."""
    return floats.floating_dtype(*jax.tree.leaves(values, is_leaf=lambda x: isinstance(x, floats.StandIn)))


def number(x: ArrayLike, name: str, dtype: np.dtype | None, may_be_zero: bool = False) -> jax.Array:
    array = floats.as_float_array(x, name, dtype, keep_dtype=True)
    _require_positive(array, name, may_be_zero)
    return array


def _require_positive(x: jax.Array, name: str, may_be_zero: bool) -> None:
    """Raises ValueError for known numbers that are negative, or 0; arrays of JAX, which may be traced, pass."""
    if isinstance(x, np.ndarray) and ((x < 0).any() or (not may_be_zero and (x == 0).any())):
        expected = "no negative number" if may_be_zero else "a positive number"
        raise ValueError(f"{name}: expected {expected}, got {x}")


def computed(
    shape: Callable, precision: PrecisionName, arrays: dict[str, jax.Array], **static
) -> tuple[jax.Array, Any, jax.Array]:
    """(mass, com, central) that a formula gives; com is a known zero where the formula has none."""
    batch = require_compatible(**arrays)
    has_no_axis = False
    if "axis" in arrays:
        has_no_axis = isinstance(arrays["axis"], np.ndarray) and not arrays["axis"].any(-1).all()
        arrays["axis"] = evaluated(_direction, None, arrays["axis"])
    m, *com, central = evaluated(shape, precision, *arrays.values(), **static)
    require_finite(shape.__name__, arrays.values(), m, central, nan=has_no_axis)
    return m.reshape(batch), com[0] if com else floats.numpy_for(batch).zeros((*batch, 3), central.dtype), central


def require_finite(name: str, arguments: Iterable, *results, nan: bool = False) -> None:
    """Raises ValueError where finite arguments make a mass or moments that overflow, if all are known.

    nan: whether results may be NaN by definition, as those of a mesh that encloses no volume.
    """
    if all(isinstance(x, np.ndarray) for x in results) and all(np.isfinite(x).all() for x in arguments):
        if any((np.isinf(x) if nan else ~np.isfinite(x)).any() for x in results):
            dtype = results[-1].dtype
            largest = f"{float(floats.finfo(dtype).max):.3g} in {dtype}"
            raise ValueError(f"{name}: expected mass and moments with terms of at most {largest}, got larger ones")


def evaluated(shape: Callable, precision: PrecisionName, *arrays: jax.Array, **static):
    """The formula; where all arrays are known its results are known too, while tracing as well."""
    if not all(isinstance(a, np.ndarray) for a in arrays):
        return shape(precision, *arrays, **static)
    with computed_at_once():
        return jax.tree.map(np.asarray, shape(precision, *arrays, **static))


@formula
def _direction(axis: Vector) -> Vector:
    """The axis times a power of two, with its largest component from 1 to 2: one along x, y or z with a known 1."""
    return 2 * linear.scaled(axis)[0]


# -- formulas ---------------------------------------------------------------------------------------------------------


def _mass(by: str, amount: Number, *factors: Number) -> Number:
    return amount if by == "mass" else math.prod(factors, start=amount)


def _round(m: Number, along: Number, across: Number, difference: Number, n: Vector) -> list:
    """Of a body of revolution about n, of any length: along n n^T / n.n + across (1 - n n^T / n.n), difference = along
    - across.

    Moments are sums of terms that are not negative; no root is taken, and a known coordinate axis is no special case.
    """
    squared = dot(n, n)
    x, y, z = (c * c / squared for c in n)
    xy, xz, yz = (difference * (n[i] * n[j] / squared) for i, j in ((0, 1), (0, 2), (1, 2)))
    xx, yy, zz = (along * a + across * (b + c) for a, b, c in ((x, y, z), (y, z, x), (z, x, y)))
    return [(m,), Symmetric(xx, xy, yy, xz, yz, zz)]


@formula
def solid_box(amount: Numbers, size: Vector, by: str) -> list:
    m = _mass(by, amount[0], *size)
    x, y, z = (m * c * c / 12 for c in size)
    return [(m,), Symmetric.diagonal(y + z, z + x, x + y)]


@formula
def solid_cube(amount: Numbers, size: Numbers, by: str) -> list:
    (c,) = size
    m = _mass(by, amount[0], c, c, c)
    moment = m * c * c / 6
    return [(m,), Symmetric.diagonal(moment, moment, moment)]


@formula
def solid_sphere(amount: Numbers, radius: Numbers, by: str) -> list:
    (r,) = radius
    m = _mass(by, amount[0], r, r, 4 * r, pi(r) / 3)
    moment = 2 * (m * r * r) / 5
    return [(m,), Symmetric.diagonal(moment, moment, moment)]


@formula
def hollow_sphere(amount: Numbers, radius: Numbers, by: str) -> list:
    (r,) = radius
    m = _mass(by, amount[0], r, r, 4 * pi(r))
    moment = 2 * (m * r * r) / 3
    return [(m,), Symmetric.diagonal(moment, moment, moment)]


@formula
def solid_ellipsoid(amount: Numbers, semi_axes: Vector, by: str) -> list:
    a, b, c = semi_axes
    m = _mass(by, amount[0], a, b, 4 * c, pi(c) / 3)
    a, b, c = (m * s * s / 5 for s in semi_axes)
    return [(m,), Symmetric.diagonal(b + c, c + a, a + b)]


@formula
def solid_cylinder(amount: Numbers, radius: Numbers, length: Numbers, axis: Vector, by: str) -> list:
    return _cylinder(by, amount[0], radius[0], length[0], axis)


@formula
def solid_cylinder_about_end(amount: Numbers, radius: Numbers, length: Numbers, axis: Vector, by: str) -> list:
    m, central = _cylinder(by, amount[0], radius[0], length[0], axis)
    half = length[0] / 2 / dot(axis, axis).sqrt()
    return [m, half * axis, central]


def _cylinder(by: str, amount: Number, r: Number, length: Number, axis: Vector) -> list:
    m = _mass(by, amount, r, r, length, pi(r))
    a, b = m * r * r, m * length * length
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def hollow_cylinder(
    amount: Numbers, inner_radius: Numbers, outer_radius: Numbers, length: Numbers, axis: Vector, by: str
) -> list:
    (p,), (q,), (h,) = inner_radius, outer_radius, length
    m = _mass(by, amount[0], q - p, q + p, h, pi(q))
    a, b = m * p * p + m * q * q, m * h * h
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def solid_capsule(amount: Numbers, radius: Numbers, length: Numbers, axis: Vector, by: str) -> list:
    """Of a cylinder, 3 h / (3 h + 4 r) of the mass, and two half balls, 4 r / (3 h + 4 r)."""
    (r,), (h,) = radius, length
    whole = 3 * h + 4 * r
    m = _mass(by, amount[0], r, r, whole, pi(r) / 3)
    whole = where(high(whole) == 0, 1.0, whole)
    between, ends = m * (3 * h / whole), m * (4 * r / whole)
    rr, hh = between * r * r, between * h * h
    along = (5 * rr + 4 * (ends * r * r)) / 10
    across = (3 * rr + hh) / 12 + (16 * (ends * r * r) + (10 * (ends * h * h) + 15 * (ends * h * r))) / 40
    return _round(m, along, across, (3 * rr - hh) / 12 - (2 * (ends * h * h) + 3 * (ends * h * r)) / 8, axis)


@formula
def solid_cone(amount: Numbers, radius: Numbers, height: Numbers, axis: Vector, by: str) -> list:
    (r,), (h,) = radius, height
    m = _mass(by, amount[0], r, r, h, pi(r) / 3)
    a, b = 12 * (m * r * r), 3 * (m * h * h)
    return _round(m, 2 * a / 80, (a + b) / 80, (a - b) / 80, axis)


@formula
def thin_rod(mass: Numbers, length: Numbers, axis: Vector, by: str) -> list:
    across = mass[0] * length[0] * length[0] / 12
    return _round(mass[0], constant(across, 0), across, -across, axis)


@formula
def solid_tetrahedron(amount: Numbers, vertices: Numbers, by: str) -> list:
    corners = [Vector(*vertices[i : i + 3]) for i in range(0, 12, 3)]
    edges = [_difference(b, a) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    m = amount[0] if by == "mass" else _mass(by, amount[0], abs(_determinant(*edges[:3])) / 6)
    com = Vector(*(x + y / 4 for x, y in zip(corners[0], edges[0] + edges[1] + edges[2], strict=True)))
    return [(m,), com, _squares(m / 80, edges).trace_minus()]


def _difference(a: Vector, b: Vector) -> Vector:
    return Vector(*map(operator.sub, a, b))


@noinline_pairs
def _determinant(a: Vector, b: Vector, c: Vector) -> Number:
    return dot(a, cross(b, c))


@noinline_pairs
def _squares(m: Number, edges: Sequence[Vector]) -> Symmetric:
    """m times the sum of e e^T."""
    return Symmetric(*(left_sum([m * e[k] * e[i] for e in edges]) for i, k in PLACES))


# -- meshes: signed tetrahedra from the middle to each triangle -------------------------------------------------------


def corners_of(vertices: jax.Array, triangles) -> jax.Array:
    """(*batch, m, 9): the three vertices of each of m triangles."""
    n = vertices.shape[-2]
    triangles = triangles if isinstance(triangles, floats.ARRAYS) else np.asarray(triangles)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not triangles.shape[0]:
        raise ValueError(f"triangle_mesh: triangles: expected shape (m, 3) with m >= 1, got {triangles.shape}")
    if not jnp.issubdtype(triangles.dtype, jnp.integer):
        raise TypeError(f"triangle_mesh: triangles: expected integers, got {triangles.dtype}")
    if isinstance(triangles, np.ndarray) and (triangles.min() < 0 or triangles.max() >= n):
        came = f"{triangles.min()} to {triangles.max()}"
        raise ValueError(f"triangle_mesh: triangles: expected indices from 0 to {n - 1}, got {came}")
    if isinstance(triangles, np.ndarray):
        _require_closed(vertices, triangles)
    else:
        vertices = jnp.asarray(vertices)  # NumPy arrays take no tracers for indices.
    x = vertices[..., triangles, :]
    return x.reshape((*x.shape[:-3], triangles.shape[0], 9))


def _require_closed(vertices: jax.Array, triangles: np.ndarray) -> None:
    """Every edge belongs to as many triangles that run along it one way as the other. Known vertices at one place are
    one, as those of files that list three for each triangle."""
    edge = _lone_edge(triangles)
    if edge is not None and isinstance(vertices, np.ndarray):
        # Zeros are positive: those of both signs are one place.
        places = np.moveaxis(vertices, -2, 0).reshape(vertices.shape[-2], -1) + 0.0
        _, firsts, of_place = np.unique(places, return_index=True, return_inverse=True, axis=0)
        edge = _lone_edge(firsts[of_place.reshape(-1)][triangles])
    if edge is not None:
        expected = "expected a closed surface: along every edge two triangles, in opposite directions"
        raise ValueError(f"triangle_mesh: triangles: {expected}; none runs from vertex {edge[1]} to {edge[0]}")


def _lone_edge(triangles: np.ndarray) -> tuple[int, int] | None:
    """An edge that triangles run along more often one way than back; None where there is none."""
    start, end = triangles.astype(np.int64)[:, [0, 1, 2, 1, 2, 0]].reshape(-1, 2, 3).swapaxes(0, 1).reshape(2, -1)
    n = int(triangles.max()) + 1
    (there, some), (back, others) = (np.unique(x, return_counts=True) for x in (start * n + end, end * n + start))
    for x, count in zip(there.tolist(), some.tolist(), strict=True):
        k = int(np.searchsorted(back, x))
        if k == len(back) or back[k] != x or others[k] < count:
            return divmod(x, n)
    return None


def middle_of(corners: jax.Array) -> jax.Array:
    """(*batch, 1, 3) the middle of the box around all corners.

    Any point does: the result does not depend on it, hence neither do derivatives. Near the mesh nothing cancels, and
    differences from it are exact where the mesh is far away.
    """
    x = from_double_word(corners)
    x = x if isinstance(x, np.ndarray) else lax.stop_gradient(x)
    # In two steps: of an array that is split explicitly, JAX reshapes axes only by splitting or by merging.
    x = x.reshape((*x.shape[:-1], 3, 3)).reshape((*x.shape[:-2], -1, 3))
    return x.min(-2, keepdims=True) / 2 + x.max(-2, keepdims=True) / 2


@formula
def triangle_mesh(amount: Numbers, corners: Matrix, middle: Vector, by: str, size: int) -> list:
    """Of a mass or density (amount,) and triangles, `size` of them along the last axis."""
    d, *moments = sums_over_items(_moments(corners, middle), size)
    d = where(high(d) > 0, d, math.nan)
    m = first(amount[0]) if by == "mass" else first(amount[0]) * (d / 6)
    arm, squares = Vector(*moments[:3]), Symmetric(*moments[3:])
    return [(m,), *_about_center(m, d, arm, squares, Vector(*map(first, middle)))]


@noinline_pairs
def _moments(corners: Matrix, middle: Vector) -> Numbers:
    """Of the tetrahedron from the middle to a triangle (a, b, c): d = 6 volume, d s and d (s s^T + a a^T + b b^T + c
    c^T) with s = a + b + c.

    d = a . (b - a) x (c - a), with edges from the corners as they come: the error falls with the size of the triangle.
    """
    a, b, c = corners
    edges = _difference(b, a), _difference(c, a)
    a, b, c = (_difference(p, middle) for p in (a, b, c))
    d = dot(a, cross(*edges))
    s = a + b + c
    squares = (d * left_sum([p[k] * p[i] for p in (s, a, b, c)]) for i, k in PLACES)
    return d, *(d * s), *squares


@noinline_pairs
def _about_center(m: Number, d: Number, arm: Vector, squares: Symmetric, middle: Vector) -> tuple[Vector, Symmetric]:
    """(com, central) from the sums over all tetrahedra."""
    c = Vector(*(x / (4 * d) for x in arm))
    six = Symmetric(*(m * (x / (20 * d) - c[k] * c[i]) for x, (i, k) in zip(squares, PLACES, strict=True)))
    return middle + c, six.trace_minus()
