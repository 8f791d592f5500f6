"""Rigid bodies put together and taken apart, about one point in one frame.

In the reduced-mass form I1 + I2 + m1 m2 / m (|d|^2 1 - d d^T), d the distance of the centres of mass, only terms that
are positive semidefinite are added: nothing cancels, however far from the origin. [Featherstone 2008, 2.13]
"""

# Of `jax.jit` and `jax.tree` the stubs say only a part.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownLambdaType=false

import functools
from collections.abc import Callable, Sequence
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Rounded, constant, high, noinline_pairs, where
from jaxspatial.arithmetic.numbers.folding import is_known
from jaxspatial.arithmetic.numbers.protocol import Number, Numbers, Symmetric, Three
from jaxspatial.arithmetic.precision import Precision, resolve
from jaxspatial.arithmetic.quantity import moved_to_last, require_alike
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.inertia.parts import Parts
from jaxspatial.inertia.reduction import summed
from jaxspatial.spatial import algebra

Ten = list[Number | Numbers]  # mass, com, central


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
        return self._with(_combined, "+", other, precision)

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
        return self._with(_removed, "-", other, precision)

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
        return self._like(composite(resolve(precision), *moved))


# -- as formulas over numbers ------------------------------------------------------------------------------------------


@formula
def _combined(mass: Numbers, com: Three, central: Symmetric, mass2: Numbers, com2: Three, central2: Symmetric) -> Ten:
    """[mass, com, central] of two bodies as one; without mass, the mean of their centres of mass."""
    return joined(mass[0], com, central, mass2[0], com2, central2, 0.5)


@formula
def _removed(mass: Numbers, com: Three, central: Symmetric, mass2: Numbers, com2: Three, central2: Symmetric) -> Ten:
    """[mass, com, central] of what is left of the first without the second; without mass, com stays."""
    return joined(mass[0], com, central, -mass2[0], com2, vectors.negative(central2), 0.0)


def joined(m1: Number, c1: Three, i1: Symmetric, m2: Number, c2: Three, i2: Symmetric, share: float) -> Ten:
    """Seen from the heavier body: where the centres of mass are one, it is exactly theirs."""
    m = m1 + m2
    is_massless = (high(m1) == 0) & (high(m2) == 0)
    divisor = where(is_massless, 1.0, m)
    d = [b - a for a, b in zip(c1, c2, strict=True)]
    is_first = abs(high(m1)) >= abs(high(m2))
    lighter, heavier = where(is_first, m2, m1), where(is_first, m1, m2)
    part = where(is_massless, share, lighter / divisor)
    com = tuple(where(is_first, a, b) + where(is_first, part, -part) * x for a, b, x in zip(c1, c2, d, strict=True))
    arm = steiner(heavier * (lighter / divisor), d)
    return [m, com, tuple((a + b) + c for a, b, c in zip(i1, i2, arm, strict=True))]


@noinline_pairs
def steiner(m: Number, d: Three) -> Symmetric:
    """m (|d|^2 1 - d d^T), of m d first: its square may not be a number of the format where the product is."""
    return algebra.parallel_axis(d, vectors.times(m, d))


# -- many -------------------------------------------------------------------------------------------------------------


@functools.partial(jax.jit, static_argnums=0, inline=True)
def composite(precision: Precision, mass: jax.Array, com: jax.Array, central: jax.Array) -> list[jax.Array]:
    """[mass (*batch,), com, central] of n bodies as one, given as (*batch, n, 1), (*batch, n, 3), (*batch, n, 6)."""
    one, vector, six = _composite(precision, mass, com, central)
    return [one[..., 0], vector[..., 0, :], six[..., 0, :]]


@formula
def _composite(mass: Numbers, com: Three, central: Symmetric) -> Ten:
    """What the common centre is off by counts in central by its square only."""
    m = mass[0]
    shape = np.broadcast_shapes(*(jnp.shape(high(x)) for x in (m, *com, *central)))
    (whole,) = summed((m,), shape[-1])
    all_of_it = _spread(whole, shape)
    is_massless = high(all_of_it) == 0
    mean = 1 / constant(m, shape[-1])
    share = where(is_massless, mean, m / where(is_massless, 1.0, all_of_it))
    center = summed(vectors.times(share, com), shape[-1])
    arm = steiner(m, [c - _spread(x, shape) for c, x in zip(com, center, strict=True)])
    return [whole, center, summed(tuple(i + a for i, a in zip(central, arm, strict=True)), shape[-1])]


def _spread(x: Number, shape: Sequence[int]) -> Number:
    """A sum as a number for each of its terms."""
    if isinstance(x, Rounded):
        return x if is_known(x.value) else Rounded(x.precision, jnp.broadcast_to(x.value, shape))
    return jax.tree.map(lambda word: jnp.broadcast_to(word, shape), x)
