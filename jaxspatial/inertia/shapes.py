"""Bodies of uniform density: mass, centre of mass and central inertia of boxes, balls, cylinders and the like.

All formulas are over numbers: lengths and masses may be arrays over a batch, traced or known. Squares are multiplied
into the mass one factor at a time, so that nothing over- or underflows before the result does.
"""

import jax
import numpy as np

from jaxspatial.arithmetic import check, symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.functions import pi
from jaxspatial.arithmetic.numbers import constant, high, noinline_pairs, where
from jaxspatial.inertia import mesh
from jaxspatial.inertia.reduction import product
from jaxspatial.rotation.matrices import expanded

_Z = (0.0, 0.0, 1.0)


class Shapes:
    """The constructors of `SpatialInertia` for bodies of uniform density.

    Lengths in metres, `mass` in kg or `density` in kg/m3 (exactly one of them), each a number or (*batch,); vectors
    (*batch, 3). Batch shapes broadcast, Python numbers take the dtype of the arrays beside them. `axis`: (*batch, 3),
    of any length but 0 (NaN). Inertias are about the centre of mass, which is the origin P unless said otherwise: a
    zero known while tracing. Where all that is given are NumPy arrays or Python numbers, so are mass and central
    inertia.

    Raises TypeError for both or neither of mass and density, ValueError, with the name of the argument, for Python or
    NumPy numbers that are negative, and for lengths that are 0 (a capsule may have one that is). Arrays of JAX, which
    may be traced, are *unchecked*: their lengths are to be positive, masses positive or 0.

    precision: "fast", "reproducible" (the default), "compensated", "faithful" or a `Precision`. With u the unit
    roundoff and mag the sum of the absolute values of an entry's terms, errors are at most 12 u mass and 20 u mag in
    "fast" and "reproducible", of moments, on the diagonal, thus 20 u relative to themselves; u |r| + 64 u^2 mag in the
    other two, r the exact value; while nothing over- or underflows. Tetrahedra by density, and meshes: see there.
    Derivatives are exact to a few u. [Drake, UnitInertia; Mirtich 1996]
    """

    @classmethod
    def solid_box(cls, size, *, mass=None, density=None, precision=None):
        """A box with edges size (*batch, 3) along x, y and z."""
        return _made(cls, "solid_box", _solid_box, precision, _amount("solid_box", mass, density), n=3, size=size)

    @classmethod
    def solid_cube(cls, size, *, mass=None, density=None, precision=None):
        """A cube with edges of length size."""
        return _made(cls, "solid_cube", _solid_cube, precision, _amount("solid_cube", mass, density), size=size)

    @classmethod
    def solid_sphere(cls, radius, *, mass=None, density=None, precision=None):
        """A ball."""
        return _made(
            cls, "solid_sphere", _solid_sphere, precision, _amount("solid_sphere", mass, density), radius=radius
        )

    @classmethod
    def hollow_sphere(cls, radius, *, mass=None, density=None, precision=None):
        """A spherical shell; its density is one of the surface, kg/m2."""
        amount = _amount("hollow_sphere", mass, density)
        return _made(cls, "hollow_sphere", _hollow_sphere, precision, amount, radius=radius)

    @classmethod
    def solid_ellipsoid(cls, semi_axes, *, mass=None, density=None, precision=None):
        """An ellipsoid with semi-axes (*batch, 3) along x, y and z."""
        amount = _amount("solid_ellipsoid", mass, density)
        return _made(cls, "solid_ellipsoid", _solid_ellipsoid, precision, amount, n=3, semi_axes=semi_axes)

    @classmethod
    def solid_cylinder(cls, radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A cylinder."""
        amount = _amount("solid_cylinder", mass, density)
        return _made(cls, "solid_cylinder", _solid_cylinder, precision, amount, axis, radius=radius, length=length)

    @classmethod
    def solid_cylinder_about_end(cls, radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A cylinder, P at the centre of one of its ends: axis points from there to its centre of mass."""
        name, amount = "solid_cylinder_about_end", _amount("solid_cylinder_about_end", mass, density)
        return _made(cls, name, _cylinder_about_end, precision, amount, axis, radius=radius, length=length)

    @classmethod
    def hollow_cylinder(cls, inner_radius, outer_radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A tube: what is between two radii, the inner one at most the outer; with equal ones a shell (by mass)."""
        amount = _amount("hollow_cylinder", mass, density)
        lengths = {"inner_radius": inner_radius, "outer_radius": outer_radius, "length": length}
        return _made(cls, "hollow_cylinder", _hollow_cylinder, precision, amount, axis, {"inner_radius"}, **lengths)

    @classmethod
    def solid_capsule(cls, radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A cylinder of that length between two half balls. With length 0 a ball, with radius 0 a thin rod."""
        amount, may_be_zero = _amount("solid_capsule", mass, density), {"radius", "length"}
        lengths = {"radius": radius, "length": length}
        return _made(cls, "solid_capsule", _solid_capsule, precision, amount, axis, may_be_zero, **lengths)

    @classmethod
    def solid_cone(cls, radius, height, axis=_Z, *, mass=None, density=None, precision=None):
        """A cone. P is its centre of mass: the centre of the base is at -height/4, the apex at 3/4 height along
        axis."""
        amount = _amount("solid_cone", mass, density)
        return _made(cls, "solid_cone", _solid_cone, precision, amount, axis, radius=radius, height=height)

    @classmethod
    def thin_rod(cls, length, axis=_Z, *, mass, precision=None):
        """A straight line of mass; without a moment about its axis."""
        return _made(cls, "thin_rod", _thin_rod, precision, ("mass", mass), axis, length=length)

    @classmethod
    def point_mass(cls, com, *, mass):
        """All mass in one point, com = p_PPcm (*batch, 3)."""
        dtype = _dtype(com, mass)
        com = check.as_vectors(com, "point_mass: com", dtype, held=True)
        mass = _number(mass, "point_mass: mass", dtype, may_be_zero=True)
        check.require_same_dtype(com=com, mass=mass)
        batch = check.common_batch_shape(com=com.shape[:-1], mass=mass.shape)
        com, mass = check.broadcast_batch(batch, com, expanded(mass))
        return cls(mass.reshape(batch), com, np.zeros((*batch, 6), com.dtype))

    @classmethod
    def solid_tetrahedron(cls, vertices, *, mass=None, density=None, precision=None):
        """A tetrahedron with vertices (*batch, 4, 3) in any order, p_PV. By mass it may be flat, or a line.

        Computed from its edges, whose squares are summed: nothing cancels, however far from P it is. By density
        mass and central have the error of a determinant besides: at most 12 u, or 64 u^2, times the sum of the absolute
        values of its six products over its value. Error of com at most 4 u |vertices|.
        """
        kind, amount = _amount("solid_tetrahedron", mass, density)
        dtype = _dtype(vertices, amount)
        v = check.as_vectors(vertices, "solid_tetrahedron: vertices", dtype, many=["4"], held=True)
        if v.shape[-2] != 4:
            raise ValueError(f"solid_tetrahedron: vertices: expected shape (*batch, 4, 3), got {v.shape}")
        amount = _number(amount, f"solid_tetrahedron: {kind}", v.dtype, may_be_zero=True)
        given = {kind: expanded(amount), "vertices": v.reshape((*v.shape[:-2], 12))}
        return cls(*_computed(_solid_tetrahedron, precision, given, by=kind))

    @classmethod
    def triangle_mesh(cls, vertices, triangles, *, mass=None, density=None, precision=None):
        """What a closed surface of triangles encloses.

        vertices: (*batch, n, 3) positions p_PV, metres.
        triangles: (m, 3) integers, m >= 1, the vertices of each, counterclockwise seen from outside. *unchecked*
            requirement: every edge belongs to two triangles, which run along it in opposite directions.

        A volume that is not positive (an open or inverted surface, or none) gives NaN for mass, by density, centre of
        mass and central inertia. A sum of signed tetrahedra from the middle of the box around the mesh, by halving: a
        mesh far from P loses nothing but the digits that its vertices do not have. Differentiable in the vertices.

        Errors, with L = ceil(log2 m), S = sum over triangles of |a| |b - a| |c - a| for vertices a, b, c seen from that
        middle, at most r away, and V the volume: at most (12 + L) u S of the volume, u |com| + (12 + L) u r S / V of
        com, (24 + 2 L) u mass r^2 S / V of an entry of the central inertia in "fast" and "reproducible"; the same with
        u^2 in place of u, 8 times, and 1.01 u of the result, in the other two. For a body as thick as wide S / V is
        about 10.
        [Mirtich 1996, Fast and accurate computation of polyhedral mass properties; Eberly 2002]
        """
        kind, amount = _amount("triangle_mesh", mass, density)
        dtype = _dtype(vertices, amount)
        vertices = check.as_vectors(vertices, "triangle_mesh: vertices", dtype, many=["n"])
        corners = mesh.corners(vertices, triangles)
        amount = _number(amount, f"triangle_mesh: {kind}", corners.dtype, may_be_zero=True)
        check.require_same_dtype(vertices=corners, **{kind: amount})
        check.common_batch_shape(vertices=corners.shape[:-2], **{kind: amount.shape})
        arrays = [amount.reshape((*amount.shape, 1, 1)), corners, mesh.middle(corners)]
        found = _known(mesh.enclosed, precision, *arrays, by=kind, size=corners.shape[-2])
        m, com, central = (x[..., 0, :] for x in found)
        return cls(m.reshape(m.shape[:-1]), com, central)


# -- what comes in ----------------------------------------------------------------------------------------------------


def _amount(name, mass, density):
    """("mass", mass) or ("density", density), of which exactly one is given."""
    if (mass is None) == (density is None):
        came = "neither" if mass is None else "both"
        raise TypeError(f"{name}: expected either mass or density, got {came}")
    return ("density", density) if mass is None else ("mass", mass)


def _made(cls, name, formula, precision, amount, axis=None, may_be_zero=(), n=1, **lengths):
    """The inertia that the formula gives for a mass or density, lengths or vectors of n lengths, and an axis."""
    kind, amount = amount
    dtype = _dtype(*lengths.values(), amount, axis)
    given = {kind: expanded(_number(amount, f"{name}: {kind}", dtype, may_be_zero=True))}
    for key, x in lengths.items():
        given[key] = _lengths(x, f"{name}: {key}", dtype, n, key in may_be_zero)
    if "inner_radius" in given:
        _require_order(name, given["inner_radius"], given["outer_radius"])
    if axis is not None:
        given["axis"] = check.as_vectors(axis, f"{name}: axis", dtype)
    return cls(*_computed(formula, precision, given, by=kind))


def _dtype(*values):
    """That of the first of the values that has one, for all Python numbers; None if none has."""
    leaves = jax.tree.leaves(values, is_leaf=lambda x: isinstance(x, check.StandIn))
    return next((np.dtype(x.dtype) for x in leaves if hasattr(x, "dtype") and not isinstance(x, float)), None)


def _number(x, name, dtype, may_be_zero=False):
    x = check.as_float_array(x, name, dtype, held=True)
    _require_positive(x, name, may_be_zero)
    return x


def _lengths(x, name, dtype, n, may_be_zero):
    if n == 1:
        return expanded(_number(x, name, dtype, may_be_zero))
    x = check.as_vectors(x, name, dtype, size=n, held=True)
    _require_positive(x, name, may_be_zero)
    return x


def _require_positive(x, name, may_be_zero):
    """Of what is known; nothing is asked of arrays that may be traced."""
    if isinstance(x, np.ndarray) and ((x < 0).any() or (not may_be_zero and (x == 0).any())):
        expected = "no negative number" if may_be_zero else "a positive number"
        raise ValueError(f"{name}: expected {expected}, got {x}")


def _require_order(name, inner, outer):
    if isinstance(inner, np.ndarray) and isinstance(outer, np.ndarray) and (inner > outer).any():
        raise ValueError(f"{name}: inner_radius: expected at most outer_radius {outer[..., 0]}, got {inner[..., 0]}")


def _computed(formula, precision, given, **static):
    """(mass, com, central) that a formula gives; without a com of its own zeros, known while tracing."""
    check.require_same_dtype(**given)
    batch = check.common_batch_shape(**{name: x.shape[:-1] for name, x in given.items()})
    if "axis" in given:
        (given["axis"],) = _known(_direction, None, given["axis"])
    m, *com, central = _known(formula, precision, *given.values(), **static)
    return m.reshape(batch), com[0] if com else np.zeros((*batch, 3), central.dtype), central


def _known(formula, precision, *arrays, **static):
    """The formula; of what is known its results are known too, while tracing as well."""
    if not all(isinstance(a, np.ndarray) for a in arrays):
        return formula(precision, *arrays, **static)
    with jax.ensure_compile_time_eval():
        return [np.asarray(x) for x in formula(precision, *arrays, **static)]


# -- in numbers: [(mass,), central] for (amount,), lengths and direction ----------------------------------------------


@formula
def _direction(axis):
    """The axis times a power of two, with its largest component from 1 to 2: one along x, y or z with a known 1."""
    return [vectors.times(2, vectors.scaled(axis)[0])]


def _mass(by, amount, *factors):
    return amount if by == "mass" else product((amount, *factors))


def _diagonal(xx, yy, zz):
    zero = constant(xx, 0)
    return xx, zero, yy, zero, zero, zz


def _round(m, along, across, difference, n):
    """Of a body round about n, of any length: along n n^T / n.n + across (1 - n n^T / n.n), difference = along -
    across.

    Moments are sums of what is not negative; no root is taken, and nothing is done about a known coordinate axis.
    """
    squared = vectors.dot(n, n)
    x, y, z = (c * c / squared for c in n)
    xy, xz, yz = (difference * (n[i] * n[j] / squared) for i, j in ((0, 1), (0, 2), (1, 2)))
    xx, yy, zz = (along * a + across * (b + c) for a, b, c in ((x, y, z), (y, z, x), (z, x, y)))
    return [(m,), (xx, xy, yy, xz, yz, zz)]


@formula
def _solid_box(amount, size, by):
    m = _mass(by, *amount, *size)
    x, y, z = (m * c * c / 12 for c in size)
    return [(m,), _diagonal(y + z, z + x, x + y)]


@formula
def _solid_cube(amount, size, by):
    (c,) = size
    m = _mass(by, *amount, c, c, c)
    moment = m * c * c / 6
    return [(m,), _diagonal(moment, moment, moment)]


def _ball(by, amount, a, b, c):
    """Mass of an ellipsoid."""
    return _mass(by, amount, a, b, 4 * c, pi(c) / 3)


@formula
def _solid_sphere(amount, radius, by):
    (r,) = radius
    m = _ball(by, *amount, r, r, r)
    moment = 2 * (m * r * r) / 5
    return [(m,), _diagonal(moment, moment, moment)]


@formula
def _hollow_sphere(amount, radius, by):
    (r,) = radius
    m = _mass(by, *amount, r, r, 4 * pi(r))
    moment = 2 * (m * r * r) / 3
    return [(m,), _diagonal(moment, moment, moment)]


@formula
def _solid_ellipsoid(amount, semi_axes, by):
    m = _ball(by, *amount, *semi_axes)
    a, b, c = (m * s * s / 5 for s in semi_axes)
    return [(m,), _diagonal(b + c, c + a, a + b)]


@formula
def _solid_cylinder(amount, radius, length, axis, by):
    return _cylinder(by, *amount, *radius, *length, axis)


@formula
def _cylinder_about_end(amount, radius, length, axis, by):
    m, central = _cylinder(by, *amount, *radius, *length, axis)
    half = length[0] / 2 / vectors.dot(axis, axis).sqrt()
    return [m, vectors.times(half, axis), central]


def _cylinder(by, amount, r, length, axis):
    m = _mass(by, amount, r, r, length, pi(r))
    a, b = m * r * r, m * length * length
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def _hollow_cylinder(amount, inner_radius, outer_radius, length, axis, by):
    (p,), (q,), (h,) = inner_radius, outer_radius, length
    m = _mass(by, *amount, q - p, q + p, h, pi(q))
    a, b = m * p * p + m * q * q, m * h * h
    return _round(m, a / 2, (3 * a + b) / 12, (3 * a - b) / 12, axis)


@formula
def _solid_capsule(amount, radius, length, axis, by):
    """Of a cylinder, 3 h / (3 h + 4 r) of the mass, and two half balls, 4 r / (3 h + 4 r)."""
    (r,), (h,) = radius, length
    parts = 3 * h + 4 * r
    m = _mass(by, *amount, r, r, parts, pi(r) / 3)
    parts = where(high(parts) == 0, 1.0, parts)
    between, ends = m * (3 * h / parts), m * (4 * r / parts)
    rr, hh = between * r * r, between * h * h
    along = (5 * rr + 4 * (ends * r * r)) / 10
    across = (3 * rr + hh) / 12 + (16 * (ends * r * r) + (10 * (ends * h * h) + 15 * (ends * h * r))) / 40
    return _round(m, along, across, (3 * rr - hh) / 12 - (2 * (ends * h * h) + 3 * (ends * h * r)) / 8, axis)


@formula
def _solid_cone(amount, radius, height, axis, by):
    (r,), (h,) = radius, height
    m = _mass(by, *amount, r, r, h, pi(r) / 3)
    a, b = 12 * (m * r * r), 3 * (m * h * h)
    return _round(m, 2 * a / 80, (a + b) / 80, (a - b) / 80, axis)


@formula
def _thin_rod(mass, length, axis, by):
    across = mass[0] * length[0] * length[0] / 12
    return _round(*mass, constant(across, 0), across, -across, axis)


@formula
def _solid_tetrahedron(amount, vertices, by):
    corners = vectors.rows(vertices)
    edges = [_difference(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    m = _mass(by, *amount, *(() if by == "mass" else (abs(_determinant(*edges[:3])) / 6,)))
    com = tuple(x + total / 4 for x, total in zip(corners[0], vectors.plus(*edges[:3]), strict=True))
    return [(m,), com, symmetric.trace_minus(_squares(m / 80, edges))]


def _difference(a, b):
    return tuple(y - x for x, y in zip(a, b, strict=True))


@noinline_pairs
def _determinant(a, b, c):
    return vectors.dot(a, vectors.cross(b, c))


@noinline_pairs
def _squares(m, edges):
    """m times the sum of e e^T: xx, xy, yy, xz, yz, zz."""
    return tuple(vectors.total([m * e[i] * e[j] for e in edges]) for i, j in mesh.PAIRS)
