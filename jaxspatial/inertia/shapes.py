"""Bodies of uniform density: mass, centre of mass and central inertia of boxes, balls, cylinders and the like.

All formulas are over numbers: lengths and masses may be arrays over a batch, traced or known. Squares are multiplied
into the mass one factor at a time, so that nothing over- or underflows before the result does.
"""

from typing import Self, Unpack

import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Matrix, PrecisionName, Scalar, Vector, Vector3
from jaxspatial.inertia import mesh, shape_formulas
from jaxspatial.inertia.parts import Parts
from jaxspatial.inertia.shape_arguments import Given, completed, computed, dtype_of, known, made, number, single_amount
from jaxspatial.rotation.matrices import expanded

_Z = (0.0, 0.0, 1.0)


@completed
class Shapes(Parts):
    """The constructors of `SpatialInertia` for bodies of uniform density.

    Lengths in metres, `mass` in kg or `density` in kg/m3 (exactly one of them), each a number or (*batch,); vectors
    (*batch, 3). Batch shapes broadcast, Python numbers take the dtype of the arrays beside them. `axis`: (*batch, 3),
    of any length but 0 (NaN). Inertias are about the centre of mass, which is the origin P unless said otherwise: a
    zero known while tracing. Where all that is given are NumPy arrays or Python numbers, so are mass and central
    inertia.

    Arrays of JAX, which may be traced, are *unchecked*: their lengths are to be positive, masses positive or 0.

    Raises:
        TypeError: both or neither of mass and density are given.
        ValueError: Python or NumPy numbers are negative, or lengths 0 (a capsule may have one that is); with the name
            of the argument.

    Error: with u the unit roundoff and mag the sum of the absolute values of an entry's terms, errors are at most 12 u
        mass and 20 u mag in "fast" and "reproducible", of moments, on the diagonal, thus 20 u relative to themselves;
        u |r| + 64 u^2 mag in the other two, r the exact value; while nothing over- or underflows. Tetrahedra by
        density, and meshes: see there. Derivatives are exact to a few u.
    Source: Drake, UnitInertia; Mirtich 1996.
    """

    @classmethod
    def solid_box(cls, size: Vector3, **given: Unpack[Given]) -> Self:
        """A box with edges along x, y and z.

        Args:
            size: (*batch, 3) lengths of the edges, m.
        """
        return made(cls, "solid_box", {"size": size}, n=3, **given)

    @classmethod
    def solid_cube(cls, size: Scalar, **given: Unpack[Given]) -> Self:
        """A cube.

        Args:
            size: (*batch,) length of an edge, m.
        """
        return made(cls, "solid_cube", {"size": size}, **given)

    @classmethod
    def solid_sphere(cls, radius: Scalar, **given: Unpack[Given]) -> Self:
        """A ball.

        Args:
            radius: (*batch,) m.
        """
        return made(cls, "solid_sphere", {"radius": radius}, **given)

    @classmethod
    def hollow_sphere(cls, radius: Scalar, **given: Unpack[Given]) -> Self:
        """A spherical shell.

        Args:
            radius: (*batch,) m.
        """
        return made(cls, "hollow_sphere", {"radius": radius}, **given)

    @classmethod
    def solid_ellipsoid(cls, semi_axes: Vector3, **given: Unpack[Given]) -> Self:
        """An ellipsoid with its axes along x, y and z.

        Args:
            semi_axes: (*batch, 3) m.
        """
        return made(cls, "solid_ellipsoid", {"semi_axes": semi_axes}, n=3, **given)

    @classmethod
    def point_mass(cls, com: Vector3, *, mass: Scalar) -> Self:
        """All mass in one point.

        Args:
            com: (*batch, 3) p_PPcm, m.
            mass: (*batch,) kg.

        Returns:
            The inertia about P, over the common batch.

        Raises:
            TypeError: dtypes differ or are not floating point.
            ValueError: a known mass is negative, or shapes do not fit.

        Error: none, it is exact.
        """
        dtype = dtype_of(com, mass)
        c = check.as_vectors(com, "point_mass: com", dtype, held=True)
        m = number(mass, "point_mass: mass", dtype, may_be_zero=True)
        check.require_same_dtype(com=c, mass=m)
        batch = check.common_batch_shape(com=c.shape[:-1], mass=m.shape)
        m, c = check.broadcast_batch(batch, expanded(m), c)
        return cls(m.reshape(batch), c, np.zeros((*batch, 6), c.dtype))

    # -- bodies of revolution ------------------------------------------------------------------------------------------

    @classmethod
    def solid_cylinder(cls, radius: Scalar, length: Scalar, axis: Vector3 = _Z, **given: Unpack[Given]) -> Self:
        """A cylinder.

        Args:
            radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
        """
        return made(cls, "solid_cylinder", {"radius": radius, "length": length}, axis, **given)

    @classmethod
    def solid_cylinder_about_end(
        cls, radius: Scalar, length: Scalar, axis: Vector3 = _Z, **given: Unpack[Given]
    ) -> Self:
        """A cylinder about the centre of one of its ends: from there axis points to the centre of mass.

        Args:
            radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
        """
        return made(cls, "solid_cylinder_about_end", {"radius": radius, "length": length}, axis, **given)

    @classmethod
    def hollow_cylinder(
        cls, inner_radius: Scalar, outer_radius: Scalar, length: Scalar, axis: Vector3 = _Z, **given: Unpack[Given]
    ) -> Self:
        """A tube: what is between two radii; with equal ones a shell (by mass).

        Args:
            inner_radius: (*batch,) m, from 0 to the outer one.
            outer_radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
        """
        lengths = {"inner_radius": inner_radius, "outer_radius": outer_radius, "length": length}
        return made(cls, "hollow_cylinder", lengths, axis, ("inner_radius",), **given)

    @classmethod
    def solid_capsule(cls, radius: Scalar, length: Scalar, axis: Vector3 = _Z, **given: Unpack[Given]) -> Self:
        """A cylinder between two half balls. With length 0 it is a ball, with radius 0 a thin rod.

        Args:
            radius: (*batch,) m.
            length: (*batch,) of the cylinder, m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
        """
        return made(cls, "solid_capsule", {"radius": radius, "length": length}, axis, ("radius", "length"), **given)

    @classmethod
    def solid_cone(cls, radius: Scalar, height: Scalar, axis: Vector3 = _Z, **given: Unpack[Given]) -> Self:
        """A cone: the centre of its base is at -height/4, the apex at 3/4 height along axis.

        Args:
            radius: (*batch,) of the base, m.
            height: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
        """
        return made(cls, "solid_cone", {"radius": radius, "height": height}, axis, **given)

    @classmethod
    def thin_rod(cls, length: Scalar, axis: Vector3 = _Z, *, mass: Scalar, precision: PrecisionName = None) -> Self:
        """A straight line of mass; without a moment about its axis.

        Args:
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        return made(cls, "thin_rod", {"length": length}, axis, mass=mass, precision=precision)

    # -- polyhedra -----------------------------------------------------------------------------------------------------

    @classmethod
    def solid_tetrahedron(cls, vertices: Vector, **given: Unpack[Given]) -> Self:
        """A tetrahedron, about P. By mass it may be flat, or a line.

        Computed from its edges, whose squares are summed: nothing cancels, however far from P it is.

        Args:
            vertices: (*batch, 4, 3) in any order, p_PV, m.

        Error: as of all of `Shapes`. By density mass and central have that of a determinant besides, whose size is the
            sum of the absolute values of its six products over its value: at most 12 u size, in the other two 64 u^2
            size. Error of com at most 4 u |vertices|.
        """
        kind, amount, precision = single_amount("solid_tetrahedron", **given)
        dtype = dtype_of(vertices, amount)
        v = check.as_vectors(vertices, "solid_tetrahedron: vertices", dtype, many=["4"], held=True)
        if v.shape[-2] != 4:
            raise ValueError(f"solid_tetrahedron: vertices: expected shape (*batch, 4, 3), got {v.shape}")
        amount = number(amount, f"solid_tetrahedron: {kind}", v.dtype, may_be_zero=True)
        arrays = {kind: expanded(amount), "vertices": v.reshape((*v.shape[:-2], 12))}
        return cls(*computed(shape_formulas.solid_tetrahedron, precision, arrays, by=kind))

    @classmethod
    def triangle_mesh(cls, vertices: Vector, triangles: Matrix, **given: Unpack[Given]) -> Self:
        """What a closed surface of triangles encloses, about P.

        A volume that is not positive (an open or inverted surface, or none) gives NaN for mass, by density, centre of
        mass and central inertia. A sum of signed tetrahedra from the middle of the box around the mesh, by halving: a
        mesh far from P loses nothing but the digits that its vertices do not have. Differentiable in the vertices.

        Args:
            vertices: (*batch, n, 3) positions p_PV, m.
            triangles: (m, 3) integers, m >= 1, the vertices of each, counterclockwise seen from outside. *unchecked*
                requirement: every edge belongs to two triangles, which run along it in opposite directions.

        Error: with L = ceil(log2 m), S = sum over triangles of |a| |b - a| |c - a| for vertices a, b, c seen from that
            middle, at most r away, and V the volume: at most (12 + L) u S of the volume, u |com| + (12 + L) u r S / V
            of com, (24 + 2 L) u mass r^2 S / V of an entry of the central inertia in "fast" and "reproducible"; the
            same with u^2 in place of u, 8 times, and 1.01 u of the result, in the other two. For a body as thick as
            wide S / V is about 10.
        Source: Mirtich 1996, Fast and accurate computation of polyhedral mass properties; Eberly 2002.
        """
        kind, amount, precision = single_amount("triangle_mesh", **given)
        dtype = dtype_of(vertices, amount)
        vertices = check.as_vectors(vertices, "triangle_mesh: vertices", dtype, many=["n"])
        corners = mesh.corners(vertices, triangles)
        amount = number(amount, f"triangle_mesh: {kind}", corners.dtype, may_be_zero=True)
        check.require_same_dtype(vertices=corners, **{kind: amount})
        check.common_batch_shape(vertices=corners.shape[:-2], **{kind: amount.shape})
        arrays = [amount.reshape((*amount.shape, 1, 1)), corners, mesh.middle(corners)]
        found = known(mesh.enclosed, precision, *arrays, by=kind, size=corners.shape[-2])
        m, com, central = (x[..., 0, :] for x in found)
        return cls(m.reshape(m.shape[:-1]), com, central)
