"""Bodies of uniform density: mass, centre of mass and central inertia of boxes, balls, cylinders and the like.

All formulas are over numbers: lengths and masses may be arrays over a batch, traced or known. Squares are multiplied
into the mass one factor at a time, so that nothing over- or underflows before the result does.
"""

from typing import Self

import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Amount, PrecisionName, Scalar, Vector3
from jaxspatial.inertia.axial_shapes import AxialShapes
from jaxspatial.inertia.polyhedra import Polyhedra
from jaxspatial.inertia.shape_arguments import dtype_of, made, number
from jaxspatial.rotation.matrices import expanded


class Shapes(AxialShapes, Polyhedra):
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
    def solid_box(
        cls, size: Vector3, *, mass: Amount = None, density: Amount = None, precision: PrecisionName = None
    ) -> Self:
        """A box with edges along x, y and z.

        Args:
            size: (*batch, 3) lengths of the edges, m.
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        return made(cls, "solid_box", precision, mass, density, {"size": size}, n=3)

    @classmethod
    def solid_cube(
        cls, size: Scalar, *, mass: Amount = None, density: Amount = None, precision: PrecisionName = None
    ) -> Self:
        """A cube.

        Args:
            size: (*batch,) length of an edge, m.
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        return made(cls, "solid_cube", precision, mass, density, {"size": size})

    @classmethod
    def solid_sphere(
        cls, radius: Scalar, *, mass: Amount = None, density: Amount = None, precision: PrecisionName = None
    ) -> Self:
        """A ball.

        Args:
            radius: (*batch,) m.
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        return made(cls, "solid_sphere", precision, mass, density, {"radius": radius})

    @classmethod
    def hollow_sphere(
        cls, radius: Scalar, *, mass: Amount = None, density: Amount = None, precision: PrecisionName = None
    ) -> Self:
        """A spherical shell.

        Args:
            radius: (*batch,) m.
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) of the surface, kg/m2.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        return made(cls, "hollow_sphere", precision, mass, density, {"radius": radius})

    @classmethod
    def solid_ellipsoid(
        cls, semi_axes: Vector3, *, mass: Amount = None, density: Amount = None, precision: PrecisionName = None
    ) -> Self:
        """An ellipsoid with its axes along x, y and z.

        Args:
            semi_axes: (*batch, 3) m.
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        return made(cls, "solid_ellipsoid", precision, mass, density, {"semi_axes": semi_axes}, n=3)

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
