"""Which masses and moments a body can have, how far they are from it, and what shapes have them.

What decides is the matrix of second moments about the centre of mass, Sigma = tr(I) / 2 1 - I = integral of x x^T dm: a
body with non-negative density has Sigma positive semidefinite, which is the triangle inequality of its principal
moments. Its eigenvalues s_i belong to the same axes: s_i = (l_j + l_k - l_i) / 2. [Wensing, Kim and Slotine 2018,
Linear matrix inequalities for physically consistent inertial parameter identification]
"""

import functools
from fractions import Fraction

import jax
import jax.numpy as jnp

from jaxspatial.arithmetic import check, symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import constant, high, times_power_of_two, where
from jaxspatial.arithmetic.numbers.protocol import Mask, Number, Numbers, Symmetric, Three
from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.types import DTypeLike, PrecisionName
from jaxspatial.inertia.parts import Parts

# Of eps: what rounding an inertia tensor, and finding its moments, can take from a body as flat or thin as can be.
_TOLERANCE = 16


def default_tolerance(dtype: DTypeLike) -> float:
    return _TOLERANCE * check.eps(dtype)


def slack(precision: Precision, mass: jax.Array, com: jax.Array, central: jax.Array) -> jax.Array:
    """The smallest s_i over the sum of all |s_i|; see `SpatialInertia.validity_slack`. mass: (*batch, 1)."""
    return _slack(precision, mass, com, central, symmetric.eigen(precision, central)[0])


@formula
def _slack(mass: Numbers, com: Three, central: Symmetric, moments: Three) -> Number:
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


def nearest(precision: Precision, M: Parts, tolerance: float) -> list[jax.Array]:
    """(mass, central) with mass and eigenvalues of Sigma no less than 0; unchanged where the slack is -tolerance."""
    return _nearest(precision, *M.vectors, *symmetric.eigen(precision, M.central), tolerance=tolerance)


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


def equivalent_lengths(precision: PrecisionName, mass: jax.Array, moments: jax.Array, factor: Fraction) -> jax.Array:
    """(*batch, 3) sqrt(s_i / (factor mass)), descending, 0 where s_i is negative. factor: a Fraction."""
    return _lengths(precision, mass, moments, factor=Fraction(factor))


@formula
def _lengths(mass: Numbers, moments: Three, factor: Fraction) -> Three:
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
def minimum_length(mass: Numbers, central: Symmetric) -> Number:
    """(*batch,) 2 sqrt(tr(Sigma) / mass)."""
    scaled, e = vectors.scaled(central)
    (m,), f = vectors.scaled(mass)
    return _root_times(2 * ((scaled[0] + scaled[2] + scaled[5]) / m), e - f)
