"""Polyhedra: tetrahedra, and what a mesh of triangles encloses."""

from collections.abc import Sequence
from typing import Self

import chex

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Amount, PrecisionName, Vector
from jaxspatial.inertia import mesh, shape_formulas
from jaxspatial.inertia.parts import Parts
from jaxspatial.inertia.shape_arguments import computed, dtype_of, known, mass_or_density, number
from jaxspatial.rotation.matrices import expanded


class Polyhedra(Parts):
    """Constructors of `SpatialInertia`, see `Shapes`."""

    @classmethod
    def solid_tetrahedron(
        cls, vertices: Vector, *, mass: Amount = None, density: Amount = None, precision: PrecisionName = None
    ) -> Self:
        """A tetrahedron. By mass it may be flat, or a line.

        Computed from its edges, whose squares are summed: nothing cancels, however far from P it is.

        Args:
            vertices: (*batch, 4, 3) in any order, p_PV, m.
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known mass or density is negative, or shapes do not fit.

        Error: as of all of `Shapes`. By density mass and central have that of a determinant besides, whose size is the
            sum of the absolute values of its six products over its value: at most 12 u size, in the other two 64 u^2
            size. Error of com at most 4 u |vertices|.
        """
        kind, amount = mass_or_density("solid_tetrahedron", mass, density)
        dtype = dtype_of(vertices, amount)
        v = check.as_vectors(vertices, "solid_tetrahedron: vertices", dtype, many=["4"], held=True)
        if v.shape[-2] != 4:
            raise ValueError(f"solid_tetrahedron: vertices: expected shape (*batch, 4, 3), got {v.shape}")
        amount = number(amount, f"solid_tetrahedron: {kind}", v.dtype, may_be_zero=True)
        given = {kind: expanded(amount), "vertices": v.reshape((*v.shape[:-2], 12))}
        return cls(*computed(shape_formulas.solid_tetrahedron, precision, given, by=kind))

    @classmethod
    def triangle_mesh(
        cls,
        vertices: Vector,
        triangles: chex.Array | Sequence[Sequence[int]],
        *,
        mass: Amount = None,
        density: Amount = None,
        precision: PrecisionName = None,
    ) -> Self:
        """What a closed surface of triangles encloses.

        A volume that is not positive (an open or inverted surface, or none) gives NaN for mass, by density, centre of
        mass and central inertia. A sum of signed tetrahedra from the middle of the box around the mesh, by halving: a
        mesh far from P loses nothing but the digits that its vertices do not have. Differentiable in the vertices.

        Args:
            vertices: (*batch, n, 3) positions p_PV, m.
            triangles: (m, 3) integers, m >= 1, the vertices of each, counterclockwise seen from outside. *unchecked*
                requirement: every edge belongs to two triangles, which run along it in opposite directions.
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known mass or density is negative, or shapes do not fit.

        Error: with L = ceil(log2 m), S = sum over triangles of |a| |b - a| |c - a| for vertices a, b, c seen from that
            middle, at most r away, and V the volume: at most (12 + L) u S of the volume, u |com| + (12 + L) u r S / V
            of com, (24 + 2 L) u mass r^2 S / V of an entry of the central inertia in "fast" and "reproducible"; the
            same with u^2 in place of u, 8 times, and 1.01 u of the result, in the other two. For a body as thick as
            wide S / V is about 10.
        Source: Mirtich 1996, Fast and accurate computation of polyhedral mass properties; Eberly 2002.
        """
        kind, amount = mass_or_density("triangle_mesh", mass, density)
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
