"""What mass, centre of mass and central inertia say in other words, as formulas over numbers.

Matrices and vectors of parameters, there and back: from the centre of mass to the origin terms are added; the way back
subtracts m |c|^2, which cancels where the body is small next to its distance. Then which inertias a body can have, and
the ellipsoid or box that has the same one.
"""

import functools
import operator
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import eigen, linear
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.functions import exp, log
from jaxspatial.numerics.linear import PLACES, WHICH_OF_SIX, Inertia, Matrix, Symmetric, Vector, left_sum, skew
from jaxspatial.numerics.numbers import Mask, Number, Numbers, constant, halved, high, times_power_of_two, where
from jaxspatial.numerics.types import PrecisionName
from jaxspatial.spatial import algebra

# Where the ten dynamic parameters stand in a 6 x 6 matrix, and in a pseudo-inertia m, m c, and Sigma.
# Indices of 32 bits: those of 64, first used while 64-bit types are off, fail for good once they are on (jax 0.10).
OF_SIX_BY_SIX = np.array([21, 16, 5, 9, *(6 * i + k for i, k in PLACES)], np.int32)
OF_PSEUDO = np.array([15, 3, 7, 11, *(4 * i + k for i, k in PLACES)], np.int32)
# Where the entries of a pseudo-inertia stand among Sigma, m c, m.
_TO_PSEUDO = np.array([*([*row, 6 + i] for i, row in enumerate(WHICH_OF_SIX)), [6, 7, 8, 9]], np.int32).ravel()


# -- sums of products: from the centre of mass to the origin ----------------------------------------------------------


def _about_origin(M: Inertia) -> Symmetric:
    return M.central + algebra.point_inertia(M.mass * M.com, M.com)


about_origin = formula(_about_origin, of_sums=True)


@formula(of_sums=True)
def about_center(M: Inertia) -> Symmetric:
    """The inertia about the centre of mass, of that about the origin in place of `central`."""
    return M.central - algebra.point_inertia(M.mass * M.com, M.com)


@formula(of_sums=True)
def dynamic_parameters(M: Inertia) -> Numbers:
    """m, m c, inertia about the origin."""
    return M.mass, *(M.mass * M.com), *_about_origin(M)


@formula(of_sums=True)
def six_by_six(M: Inertia) -> Numbers:
    """The 36 entries of [[I, m [c x]], [-m [c x], m 1]] about the origin."""
    m, zero = M.mass, constant(M.com[0], 0)
    arm, ones = skew(m * M.com), Matrix.of_entries([m if i % 4 == 0 else zero for i in range(9)])
    blocks = (_about_origin(M).matrix, arm), (arm.T, ones)
    return tuple(x for left, right in blocks for a, b in zip(left, right, strict=True) for x in (*a, *b))


@formula(of_sums=True)
def _second_moments_about_origin(M: Inertia) -> Numbers:
    """Sigma_xx, Sigma_xy, Sigma_yy, Sigma_xz, Sigma_yz, Sigma_zz about the origin, m c, m."""
    moment, (cx, cy, cz) = M.mass * M.com, M.com
    xx, xy, yy, xz, yz, zz = M.central
    xx, yy, zz = map(halved, (xx, yy, zz))
    return (
        ((yy + zz) - xx) + moment.x * cx,
        moment.x * cy - xy,
        ((xx + zz) - yy) + moment.y * cy,
        moment.x * cz - xz,
        moment.y * cz - yz,
        ((xx + yy) - zz) + moment.z * cz,
        *moment,
        M.mass,
    )


def pseudo_inertia(precision: PrecisionName, M: Inertia) -> jax.Array:
    """(*batch, 4, 4) [[Sigma, m c], [m c^T, m]] about the origin."""
    ten = _second_moments_about_origin(precision, M)
    return eigen.at_places(ten, _TO_PSEUDO).reshape((*ten.shape[:-1], 4, 4))


# -- quotients and roots: back again ----------------------------------------------------------------------------------


@formula
def from_dynamic_parameters(ten: Numbers) -> list[Numbers]:
    """[com, central]."""
    moment = Vector(*ten[1:4])
    com = Vector(*(quotient(p, ten[0]) for p in moment))
    return [com, Symmetric(*map(operator.sub, ten[4:], algebra.point_inertia(moment, com)))]


def quotient(a: Number, b: Number) -> Number:
    """a / b; 0 where nothing is divided by nothing."""
    return a / where((high(b) == 0) & (high(a) == 0), 1.0, b)


@formula
def from_second_moments(ten: Numbers) -> list[Numbers]:
    """[com, central] of m, m c, and Sigma about the origin."""
    moment = Vector(*ten[1:4])
    com = Vector(*(quotient(p, ten[0]) for p in moment))
    products = [moment[i] * com[j] for i, j in PLACES]
    return [com, Symmetric(*map(operator.sub, ten[4:], products)).trace_minus()]


# -- log-Cholesky -----------------------------------------------------------------------------------------------------


@formula
def from_log_cholesky(theta: Numbers) -> Inertia:
    """J = U U^T leaves Sigma = m L L^T about the centre of mass, and t is the centre of mass."""
    alpha, d1, d2, d3, s12, s23, s13, *t = theta
    m, e1, e2, e3 = exp(2 * alpha), exp(d1), exp(d2), exp(d3)
    xx, yy, zz = e1 * e1 + (s12 * s12 + s13 * s13), e2 * e2 + s23 * s23, e3 * e3
    xy, xz, yz = s12 * e2 + s13 * s23, s13 * e3, s23 * e3
    central = Symmetric(xx, xy, yy, xz, yz, zz).trace_minus()
    return Inertia(m, Vector(*t), Symmetric(*(m * x for x in central)))


@formula
def log_cholesky(M: Inertia) -> Numbers:
    """The ten parameters: Sigma / m = L L^T, L upper triangular, from the last column on."""
    m, com, (ixx, ixy, iyy, ixz, iyz, izz) = M
    xx, yy, zz = (0.5 * (x / m) for x in ((iyy - ixx) + izz, (ixx - iyy) + izz, (ixx - izz) + iyy))
    l33 = zz.sqrt()
    s13, s23 = -(ixz / m) / l33, -(iyz / m) / l33
    y = yy - s23 * s23
    s12 = (-(ixy / m) - s13 * s23) / y.sqrt()
    x = xx - (s12 * s12 + s13 * s13)
    return *(0.5 * log(a) for a in (m, x, y, zz)), s12, s23, s13, *com


# -- which masses and moments a body can have -------------------------------------------------------------------------
#
# What decides is the matrix of second moments about the centre of mass, Sigma = tr(I) / 2 1 - I = integral of x x^T dm:
# a body with non-negative density has Sigma positive semidefinite, which is the triangle inequality of its principal
# moments. Its eigenvalues s_i belong to the same axes: s_i = (l_j + l_k - l_i) / 2. [Wensing, Kim and Slotine 2018,
# Linear matrix inequalities for physically consistent inertial parameter identification]


@formula
def slack(M: Inertia, moments: Vector) -> Number:
    """The smallest s_i over the sum of all |s_i|; -1 for a negative mass and for moments without mass, NaN where a
    number is not finite."""
    mass = high(M.mass)
    result = where((mass < 0) | ((mass == 0) & _any(M.central)), -1.0, _relative(moments))
    return where(_all_finite(M.mass, *M.com, *M.central), result, float("nan"))


def _relative(moments: Vector) -> Number:
    # Moments are ascending, second moments descending.
    seconds = _second_moments(linear.scaled(moments)[0])
    sizes = left_sum([abs(s) for s in seconds])
    is_zero = high(sizes) == 0
    return where(is_zero, 0.0, seconds[2] / where(is_zero, 1.0, sizes))


def _second_moments(moments: Vector) -> Vector:
    a, b, c = moments
    return Vector(0.5 * ((b - a) + c), 0.5 * (a + (c - b)), 0.5 * (a - (c - b)))


def _all_finite(*numbers: Number) -> Mask:
    largest = float(jnp.finfo(numbers[0].dtype).max)
    return functools.reduce(lambda a, b: a & b, [abs(high(x)) <= largest for x in numbers])


def _any(numbers: Numbers) -> Mask:
    """Whether any of them is not 0."""
    return functools.reduce(operator.or_, [high(x) != 0 for x in numbers])


@formula
def nearest_valid(M: Inertia, moments: Vector, axes: Matrix, tolerance: float) -> list:
    """[mass, central] without the part of Sigma that has negative eigenvalues: central + tr(N) 1 - N, with
    N = Q diag(max(-s, 0)) Q^T. The mass of moments without any is the smallest normal number."""
    scaled, e = linear.scaled(moments)
    missing = [times_power_of_two(where(high(s) < 0, -s, 0.0), e) for s in _second_moments(scaled)]
    weighted = Matrix(*(Vector(*(x * s for x, s in zip(row, missing, strict=True))) for row in axes))
    added = Symmetric.of_matrix(weighted @ axes.T).trace_minus()
    is_kept = ~_all_finite(*M.central) | (high(_relative(moments)) >= -tolerance)
    clamped = Symmetric(*(where(is_kept, x, x + y) for x, y in zip(M.central, added, strict=True)))
    least = where(_any(clamped) & _all_finite(*clamped), float(jnp.finfo(M.mass.dtype).tiny), constant(M.mass, 0))
    return [where(high(M.mass) <= 0, least, M.mass), clamped]


# -- equivalent shapes ------------------------------------------------------------------------------------------------


@formula
def lengths(mass: Numbers, moments: Vector, factor: Fraction) -> Vector:
    """sqrt(s_i / (factor mass)), descending, 0 where s_i is negative."""
    scaled, e = linear.scaled(moments)
    (m,), f = linear.scaled(mass)
    divisor = m * constant(m, factor)
    return Vector(*(_root_times(s / divisor, e - f) for s in _second_moments(scaled)))


def _root_times(x: Number, e: Mask) -> Number:
    """sqrt(max(x, 0) 2^e) with derivative 0 where that is 0."""
    half = e // 2
    is_positive = high(x) > 0
    root = times_power_of_two(where(is_positive, x, 1.0), e - 2 * half).sqrt()
    return where(is_positive, times_power_of_two(root, half), where(high(x) <= 0, 0.0, x))


@formula
def minimum_length(mass: Numbers, central: Symmetric) -> Number:
    """2 sqrt(tr(Sigma) / mass)."""
    scaled, e = linear.scaled(central)
    (m,), f = linear.scaled(mass)
    return _root_times(2 * ((scaled.xx + scaled.yy + scaled.zz) / m), e - f)
