"""Principal axes, equivalent shapes, and whether a body can have an inertia: methods of `SpatialInertia`.

The formulas are in `validity`.
"""

from fractions import Fraction
from typing import Self

import jax

from jaxspatial.arithmetic import check, symmetric
from jaxspatial.arithmetic.precision import resolve
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.inertia import validity
from jaxspatial.inertia.parts import Parts
from jaxspatial.rotation.matrices import expanded
from jaxspatial.rotation.rotation import Rotation


class PrincipalAxes(Parts):
    """What the principal moments of a `SpatialInertia` about its centre of mass tell."""

    def principal_moments(self, *, precision: PrecisionName = None) -> jax.Array:
        """The principal moments about the centre of mass.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3), ascending, kg m2.

        Error: as of `principal_moments_and_axes`.
        """
        return self.principal_moments_and_axes(precision=precision)[0]

    def principal_moments_and_axes(self, *, precision: PrecisionName = None) -> tuple[jax.Array, Rotation]:
        """The principal moments about the centre of mass, and their axes.

        Where central is diagonal, up to 2 eps of its trace, axes are exactly coordinate axes, the third one reversed if
        they were left-handed else; where the moments differ by no more than 4 eps of the trace, exactly the identity.

        Derivatives of the moments are the rates of their matrix along the axes, those of axes divide by the distance of
        moments; of axes with equal moments, which have none, the part within their plane is 0.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (moments (*batch, 3), ascending, kg m2; R_EA with the principal axes as its columns, right-handed).

        Error: of the moments at most 8 u times the largest, of the axes 32 u times the largest moment over the distance
            to the next; R R^T is within 16 u of the identity, 2 u in "compensated" and "faithful".
        Source: Jacobi 1846.
        """
        moments, axes = symmetric.eigen(resolve(precision), check.narrowed(self.central))
        return moments, Rotation(axes)

    def equivalent_ellipsoid(self, *, precision: PrecisionName = None) -> tuple[jax.Array, Rotation]:
        """The solid ellipsoid about the centre of mass with this mass and inertia.

        a_i^2 = 5 s_i / m, s_i the second moment as of `validity_slack`; 0 where that is not positive, with derivative
        0. NaN or inf without mass.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (semi-axes a (*batch, 3), descending, m; R_EA of `principal_moments_and_axes`, along whose columns they
            are).

        Error: of a_i^2 at most 64 u times the largest: a rod may have 1e-8 (float32: 1e-3) of its length as its
            thickness.
        """
        return self._equivalent(Fraction(1, 5), precision)

    def equivalent_box(self, *, precision: PrecisionName = None) -> tuple[jax.Array, Rotation]:
        """The solid box with this mass and inertia: edge_i^2 = 12 s_i / m, else as `equivalent_ellipsoid`.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (edges (*batch, 3), descending, m; R_EA of `principal_moments_and_axes`, along whose columns they are).

        Error: as of `equivalent_ellipsoid`.
        """
        return self._equivalent(Fraction(1, 12), precision)

    def _equivalent(self, factor: Fraction, precision: PrecisionName) -> tuple[jax.Array, Rotation]:
        moments, R_EA = self.principal_moments_and_axes(precision=precision)
        return validity.equivalent_lengths(precision, expanded(self.mass), moments, factor), R_EA

    def minimum_length(self, *, precision: PrecisionName = None) -> jax.Array:
        """sqrt(2 tr(central) / mass): no body with this inertia is shorter than that in its longest direction.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,), m.

        Error: at most 8 u.
        Source: Drake, CalcMinimumPhysicalLength.
        """
        return validity.minimum_length(precision, expanded(self.mass), self.central)

    # -- what a body can be -------------------------------------------------------------------------------------------

    def validity_slack(self, *, precision: PrecisionName = None) -> jax.Array:
        """How far this is from what no body can be: the smallest second moment over the sum of the sizes of all.

        Second moments s_i = (l_j + l_k - l_i) / 2, l the principal moments: integrals of x_i^2 dm along the principal
        axes, from the centre of mass. The sum is one of their absolute values.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,): 1/3 for a ball, 0 for a plate, a rod and a point, negative where the triangle inequality of the
            principal moments does not hold; -1 for a negative mass, NaN where a number is not finite.

        Error: at most 32 u.
        Source: Wensing, Kim and Slotine 2018.
        """
        return validity.slack(resolve(precision), *check.narrowed_each(self.vectors))

    def is_physically_valid(self, tolerance: float | None = None, *, precision: PrecisionName = None) -> jax.Array:
        """Whether a body can be like that: all finite, mass >= 0, `validity_slack` >= -tolerance.

        Of the point about which the inertia is nothing depends on it.

        Args:
            tolerance: relative, as the slack is; 16 eps by default, for what rounding takes from a plate.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,) of bool.

        Error: of the slack, as of `validity_slack`.
        """
        tolerance = validity.default_tolerance(check.narrowed(self).dtype) if tolerance is None else tolerance
        return self.validity_slack(precision=precision) >= -tolerance

    def nearest_valid(self, tolerance: float | None = None, *, precision: PrecisionName = None) -> Self:
        """The nearest inertia that a body can have, of mass and second moments about the centre of mass no less than 0.

        The matrix of second moments is the nearest such one in the Frobenius norm. Mass, or central, that are valid
        with this tolerance stay bit for bit, and so do those that are not finite; com always.

        Args:
            tolerance: relative, of the slack; 16 eps by default.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia, over the same batch.

        Error: of central at most 32 u times its largest principal moment.
        """
        M = check.narrowed(self)
        tolerance = validity.default_tolerance(M.dtype) if tolerance is None else tolerance
        mass, central = validity.nearest(resolve(precision), M, float(tolerance))
        return self._like((mass, M.com, central))
