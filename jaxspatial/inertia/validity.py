"""Principal axes, equivalent shapes, and which masses and moments a body can have: methods of `SpatialInertia`.

What decides is the matrix of second moments about the centre of mass, Sigma = tr(I) / 2 1 - I = integral of x x^T dm: a
body with non-negative density has Sigma positive semidefinite, which is the triangle inequality of its principal
moments. Its eigenvalues s_i belong to the same axes: s_i = (l_j + l_k - l_i) / 2. [Wensing, Kim and Slotine 2018,
Linear matrix inequalities for physically consistent inertial parameter identification]
"""

# Of `jax.custom_jvp`, which `symmetric.eigen` is, and `jnp.finfo` the stubs say only a part.
# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false, reportUnknownVariableType=false

import functools
from fractions import Fraction
from typing import Self

import jax
import jax.numpy as jnp

from jaxspatial.arithmetic import check, symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import constant, high, times_power_of_two, where
from jaxspatial.arithmetic.numbers.protocol import Mask, Number, Numbers, Symmetric, Three
from jaxspatial.arithmetic.precision import resolve
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.inertia.parts import Parts
from jaxspatial.rotation.matrices import expanded
from jaxspatial.rotation.rotation import Rotation

# Of eps: what rounding an inertia tensor, and finding its moments, can take from a body as flat or thin as can be.
_TOLERANCE = 16


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
        return _lengths(precision, expanded(self.mass), moments, factor=factor), R_EA

    def minimum_length(self, *, precision: PrecisionName = None) -> jax.Array:
        """sqrt(2 tr(central) / mass): no body with this inertia is shorter than that in its longest direction.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch,), m.

        Error: at most 8 u.
        Source: Drake, CalcMinimumPhysicalLength.
        """
        return _minimum_length(precision, expanded(self.mass), self.central)

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
        mass, com, central = check.narrowed_each(self.vectors)
        return _slack(precision, mass, com, central, symmetric.eigen(resolve(precision), central)[0])

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
        tolerance = _TOLERANCE * check.eps(check.narrowed(self).dtype) if tolerance is None else tolerance
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
        tolerance = float(_TOLERANCE * check.eps(M.dtype) if tolerance is None else tolerance)
        parts = *M.vectors, *symmetric.eigen(resolve(precision), M.central)
        mass, central = _nearest(precision, *parts, tolerance=tolerance)
        return self._like((mass, M.com, central))


# -- as formulas over numbers ------------------------------------------------------------------------------------------


@formula
def _slack(mass: Numbers, com: Three, central: Symmetric, moments: Three) -> Number:
    """The smallest s_i over the sum of all |s_i|."""
    found = where(high(mass[0]) < 0, -1.0, _relative(moments))
    return where(_all_finite(*mass, *com, *central), found, float("nan"))


def _relative(moments: Three) -> Number:
    seconds = _second_moments(vectors.scaled(moments)[0])
    total = vectors.recursive_sum([abs(s) for s in seconds])
    is_zero = high(total) == 0
    # Moments are ascending, second moments descending.
    return where(is_zero, 0.0, seconds[2] / where(is_zero, 1.0, total))


def _second_moments(moments: Three) -> tuple[Number, Number, Number]:
    a, b, c = moments
    return 0.5 * ((b - a) + c), 0.5 * (a + (c - b)), 0.5 * (a - (c - b))


def _all_finite(*numbers: Number) -> Mask:
    largest = float(jnp.finfo(numbers[0].dtype).max)
    return functools.reduce(lambda a, b: a & b, [abs(high(x)) <= largest for x in numbers])


@formula
def _nearest(
    mass: Numbers, com: Three, central: Symmetric, moments: Three, axes: Numbers, tolerance: float
) -> list[Number | Numbers]:
    """The part of Sigma with negative eigenvalues taken off: central + tr(N) 1 - N, N = Q diag(max(-s, 0)) Q^T."""
    (scaled, e), q = vectors.scaled(moments), vectors.rows(axes)
    missing = [times_power_of_two(where(high(s) < 0, -s, 0.0), e) for s in _second_moments(scaled)]
    weighted = tuple(tuple(x * s for x, s in zip(row, missing, strict=True)) for row in q)
    n = symmetric.six_of(vectors.matrix_product(weighted, vectors.transpose(q)))
    added = symmetric.trace_minus(n)
    is_kept = ~_all_finite(*central) | (high(_relative(moments)) >= -tolerance)
    clamped = tuple(where(is_kept, x, x + y) for x, y in zip(central, added, strict=True))
    return [where(high(mass[0]) < 0, 0.0, mass[0]), clamped]


# -- equivalent shapes ------------------------------------------------------------------------------------------------


@formula
def _lengths(mass: Numbers, moments: Three, factor: Fraction) -> Three:
    """sqrt(s_i / (factor mass)), descending, 0 where s_i is negative."""
    scaled, e = vectors.scaled(moments)
    (m,), f = vectors.scaled(mass)
    divisor = m * constant(m, factor)
    return tuple(_root_times(s / divisor, e - f) for s in _second_moments(scaled))


def _root_times(x: Number, e: Mask) -> Number:
    """sqrt(max(x, 0) 2^e) with derivative 0 where that is 0."""
    half = e // 2
    is_positive = high(x) > 0
    root = times_power_of_two(where(is_positive, x, 1.0), e - 2 * half).sqrt()
    return where(is_positive, times_power_of_two(root, half), where(high(x) <= 0, 0.0, x))


@formula
def _minimum_length(mass: Numbers, central: Symmetric) -> Number:
    """(*batch,) 2 sqrt(tr(Sigma) / mass)."""
    scaled, e = vectors.scaled(central)
    (m,), f = vectors.scaled(mass)
    return _root_times(2 * ((scaled[0] + scaled[2] + scaled[5]) / m), e - f)
