"""Bodies of revolution: cylinders, tubes, capsules, cones and rods along an axis."""

from typing import Self

from jaxspatial.arithmetic.types import Amount, PrecisionName, Scalar, Vector3
from jaxspatial.inertia.parts import Parts
from jaxspatial.inertia.shape_arguments import made

_Z = (0.0, 0.0, 1.0)


class AxialShapes(Parts):
    """Constructors of `SpatialInertia`, see `Shapes`."""

    @classmethod
    def solid_cylinder(
        cls,
        radius: Scalar,
        length: Scalar,
        axis: Vector3 = _Z,
        *,
        mass: Amount = None,
        density: Amount = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cylinder.

        Args:
            radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
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
        return made(cls, "solid_cylinder", precision, mass, density, {"radius": radius, "length": length}, axis)

    @classmethod
    def solid_cylinder_about_end(
        cls,
        radius: Scalar,
        length: Scalar,
        axis: Vector3 = _Z,
        *,
        mass: Amount = None,
        density: Amount = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cylinder about the centre of one of its ends.

        Args:
            radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about P, the centre of an end: from there axis points to the centre of mass. Over the common
            batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, a length 0, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        lengths = {"radius": radius, "length": length}
        return made(cls, "solid_cylinder_about_end", precision, mass, density, lengths, axis)

    @classmethod
    def hollow_cylinder(
        cls,
        inner_radius: Scalar,
        outer_radius: Scalar,
        length: Scalar,
        axis: Vector3 = _Z,
        *,
        mass: Amount = None,
        density: Amount = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A tube: what is between two radii; with equal ones a shell (by mass).

        Args:
            inner_radius: (*batch,) m, from 0 to the outer one.
            outer_radius: (*batch,) m.
            length: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, outer_radius or length 0, or inner_radius larger than outer_radius;
                or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        lengths = {"inner_radius": inner_radius, "outer_radius": outer_radius, "length": length}
        return made(cls, "hollow_cylinder", precision, mass, density, lengths, axis, {"inner_radius"})

    @classmethod
    def solid_capsule(
        cls,
        radius: Scalar,
        length: Scalar,
        axis: Vector3 = _Z,
        *,
        mass: Amount = None,
        density: Amount = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cylinder between two half balls. With length 0 it is a ball, with radius 0 a thin rod.

        Args:
            radius: (*batch,) m.
            length: (*batch,) of the cylinder, m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
            mass: (*batch,) kg; exactly one of mass and density is given.
            density: (*batch,) kg/m3.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia about the centre of mass, the origin P, over the common batch.

        Raises:
            TypeError: both or neither of mass and density are given, or dtypes differ.
            ValueError: a known number is negative, or shapes do not fit.

        Error: as of all of `Shapes`.
        """
        lengths = {"radius": radius, "length": length}
        return made(cls, "solid_capsule", precision, mass, density, lengths, axis, lengths.keys())

    @classmethod
    def solid_cone(
        cls,
        radius: Scalar,
        height: Scalar,
        axis: Vector3 = _Z,
        *,
        mass: Amount = None,
        density: Amount = None,
        precision: PrecisionName = None,
    ) -> Self:
        """A cone: the centre of its base is at -height/4, the apex at 3/4 height along axis.

        Args:
            radius: (*batch,) of the base, m.
            height: (*batch,) m.
            axis: (*batch, 3) its axis, of any length but 0 (NaN).
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
        return made(cls, "solid_cone", precision, mass, density, {"radius": radius, "height": height}, axis)

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
        return made(cls, "thin_rod", precision, mass, None, {"length": length}, axis)
