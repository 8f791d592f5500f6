"""Bodies of uniform density: mass, centre of mass and central inertia of boxes, balls, cylinders and the like.

All formulas are over numbers: lengths and masses may be arrays over a batch, traced or known. Squares are multiplied
into the mass one factor at a time, so that nothing over- or underflows before the result does.
"""

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.inertia import mesh, shape_formulas
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
        return _made(cls, "solid_box", precision, mass, density, n=3, size=size)

    @classmethod
    def solid_cube(cls, size, *, mass=None, density=None, precision=None):
        """A cube with edges of length size."""
        return _made(cls, "solid_cube", precision, mass, density, size=size)

    @classmethod
    def solid_sphere(cls, radius, *, mass=None, density=None, precision=None):
        """A ball."""
        return _made(cls, "solid_sphere", precision, mass, density, radius=radius)

    @classmethod
    def hollow_sphere(cls, radius, *, mass=None, density=None, precision=None):
        """A spherical shell; its density is one of the surface, kg/m2."""
        return _made(cls, "hollow_sphere", precision, mass, density, radius=radius)

    @classmethod
    def solid_ellipsoid(cls, semi_axes, *, mass=None, density=None, precision=None):
        """An ellipsoid with semi-axes (*batch, 3) along x, y and z."""
        return _made(cls, "solid_ellipsoid", precision, mass, density, n=3, semi_axes=semi_axes)

    @classmethod
    def solid_cylinder(cls, radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A cylinder."""
        return _made(cls, "solid_cylinder", precision, mass, density, axis, radius=radius, length=length)

    @classmethod
    def solid_cylinder_about_end(cls, radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A cylinder, P at the centre of one of its ends: axis points from there to its centre of mass."""
        return _made(cls, "solid_cylinder_about_end", precision, mass, density, axis, radius=radius, length=length)

    @classmethod
    def hollow_cylinder(cls, inner_radius, outer_radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A tube: what is between two radii, the inner one at most the outer; with equal ones a shell (by mass)."""
        return _made(
            cls,
            "hollow_cylinder",
            precision,
            mass,
            density,
            axis,
            {"inner_radius"},
            inner_radius=inner_radius,
            outer_radius=outer_radius,
            length=length,
        )

    @classmethod
    def solid_capsule(cls, radius, length, axis=_Z, *, mass=None, density=None, precision=None):
        """A cylinder of that length between two half balls. With length 0 a ball, with radius 0 a thin rod."""
        return _made(
            cls, "solid_capsule", precision, mass, density, axis, {"radius", "length"}, radius=radius, length=length
        )

    @classmethod
    def solid_cone(cls, radius, height, axis=_Z, *, mass=None, density=None, precision=None):
        """A cone. P is its centre of mass: the centre of the base is at -height/4, the apex at 3/4 height along
        axis."""
        return _made(cls, "solid_cone", precision, mass, density, axis, radius=radius, height=height)

    @classmethod
    def thin_rod(cls, length, axis=_Z, *, mass, precision=None):
        """A straight line of mass; without a moment about its axis."""
        return _made(cls, "thin_rod", precision, mass, None, axis, length=length)

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
        return cls(*_computed(shape_formulas.solid_tetrahedron, precision, given, by=kind))

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


def _made(cls, name, precision, mass, density, axis=None, may_be_zero=(), n=1, **lengths):
    """The inertia that the formula of this name gives for lengths, or vectors of n lengths, and an axis."""
    kind, amount = _amount(name, mass, density)
    dtype = _dtype(*lengths.values(), amount, axis)
    given = {kind: expanded(_number(amount, f"{name}: {kind}", dtype, may_be_zero=True))}
    for key, x in lengths.items():
        given[key] = _lengths(x, f"{name}: {key}", dtype, n, key in may_be_zero)
    if "inner_radius" in given:
        _require_order(name, given["inner_radius"], given["outer_radius"])
    if axis is not None:
        given["axis"] = check.as_vectors(axis, f"{name}: axis", dtype)
    return cls(*_computed(getattr(shape_formulas, name), precision, given, by=kind))


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
        (given["axis"],) = _known(shape_formulas.direction, None, given["axis"])
    m, *com, central = _known(formula, precision, *given.values(), **static)
    return m.reshape(batch), com[0] if com else np.zeros((*batch, 3), central.dtype), central


def _known(formula, precision, *arrays, **static):
    """The formula; of what is known its results are known too, while tracing as well."""
    if not all(isinstance(a, np.ndarray) for a in arrays):
        return formula(precision, *arrays, **static)
    with jax.ensure_compile_time_eval():
        return [np.asarray(x) for x in formula(precision, *arrays, **static)]
