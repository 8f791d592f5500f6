"""Rigid bodies put together and taken apart: the methods of `SpatialInertia`, whose formulas are in `addition`."""

from collections.abc import Callable
from typing import Any, Self

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.precision import resolve
from jaxspatial.arithmetic.quantity import moved_to_last, require_alike
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.inertia import addition
from jaxspatial.inertia.parts import Parts


class Composition(Parts):
    """Sums and differences of `SpatialInertia` about one point in one frame."""

    def __add__(self, other: Any) -> Any:
        """Two bodies as one: see `combine`."""
        return self.combine(other) if isinstance(other, type(self)) else NotImplemented

    def __radd__(self, other: Any) -> Any:
        """0 + M is M, for Python's `sum`; for many bodies `SpatialInertia.sum` is faster and better."""
        return self if isinstance(other, int) and other == 0 else NotImplemented

    def __sub__(self, other: Any) -> Any:
        """What is left without a part: see `remove`."""
        return self.remove(other) if isinstance(other, type(self)) else NotImplemented

    def combine(self, other: Self, *, precision: PrecisionName = None) -> Self:
        """The inertia of two bodies as one, about the same point in the same frame.

            com = c1 + (m2 / m) d    central = I1 + I2 + (m1 m2 / m) (|d|^2 1 - d d^T)    d = c2 - c1

        The terms are positive semidefinite, so that nothing cancels and nothing turns indefinite but by rounding an
        entry: the validity slack falls by at most 16 u. Where the centres of mass coincide, com is exactly theirs. Two
        bodies without mass have the mean of their com.

        Args:
            other: the inertia of the other body.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia of both together, over the common batch.

        Raises:
            TypeError: the other is no SpatialInertia, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: of mass u m, of com at most 6 u (m1 |c1| + m2 |c2|) / m, of central 10 u mag; in "compensated" and
            "faithful" u |r| + 128 u^2 mag. Derivatives are exact to a few u.
        Source: Featherstone 2008, 2.13.
        """
        return self._with(addition.combined, "+", other, precision)

    def remove(self, other: Self, *, precision: PrecisionName = None) -> Self:
        """The inertia of what is left of this body without a part of it, about the same point in the same frame.

        This cancels: of mass, com and central as many digits are lost as what is left is smaller. Where no mass is left
        of a body that had some, com and central are infinite or NaN; without mass from the start com stays.

        Args:
            other: the inertia of the part.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia of what is left, over the common batch.

        Raises:
            TypeError: the other is no SpatialInertia, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `combine`, with mag of the differences, com's over the mass that is left.
        """
        return self._with(addition.removed, "-", other, precision)

    def _with(self, operation: Callable[..., Any], sign: str, other: Any, precision: PrecisionName) -> Self:
        if not isinstance(other, type(self)):
            raise TypeError(f"{sign}: expected a SpatialInertia, got {type(other).__name__}")
        require_alike(left=self, right=other)
        return self._like(operation(precision, *self.vectors, *other.vectors))

    def sum(self, axis: int = 0, *, precision: PrecisionName = None) -> Self:
        """The inertia of all bodies along an axis of the batch as one, about the same point in the same frame.

            com = sum m_i c_i / m    central = sum (I_i + m_i (|d_i|^2 1 - d_i d_i^T))    d_i = c_i - com

        Sums by halving, always in the same order; what com is off counts in central by its square only. Nothing turns
        indefinite but by rounding, as for `combine`. Without any mass com is the mean; of no bodies at all the result
        is zero.

        Args:
            axis: an integer; which axis of the batch.
            precision: name of a precision; None takes the default.

        Returns:
            The inertia of all together, over the other axes of the batch.

        Raises:
            TypeError: the axis is no integer.
            ValueError: the batch has no such axis.

        Error: with L = ceil(log2 n), of mass at most L u m, of com (4 + L) u sum m_i |c_i| / m, of central (10 + L) u
            mag, mag = sum (|I_i| + m_i |d_i|^2) with |d_i|^2 <= |c_i|^2 + |com|^2; in "compensated" and "faithful" u
            |r| + 64 (4 + L) u^2 mag. Of double words com and central are good to 64 (4 + L) u^2 mag.
        """
        place = check.batch_axis(axis, self.batch_shape, "SpatialInertia.sum")
        if not self.batch_shape[place]:
            return self.zero((*self.batch_shape[:place], *self.batch_shape[place + 1 :]), self.dtype)
        moved = moved_to_last(check.narrowed_each(self.vectors), place, self.batch_shape)
        return self._like(addition.composite(resolve(precision), *moved))
