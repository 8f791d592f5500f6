"""Other ways to say what mass, centre of mass and central inertia say, as functions of arrays, both ways.

mass (*batch, 1), com (*batch, 3), central and inertias about the origin (*batch, 6). What goes from the centre of mass
to the origin adds; the way back subtracts m |c|^2, which cancels where the body is small next to its distance.
"""

import jax
import numpy as np

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.functions import exp, log
from jaxspatial.arithmetic.numbers import Number, Numbers, Symmetric, Three, constant, halved, high, where
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.spatial import algebra

# Where the ten dynamic parameters stand in a 6 x 6 matrix, and in a pseudo-inertia m, m c, and Sigma.
# Indices of 32 bits: those of 64, first used while 64-bit types are off, fail for good once they are on (jax 0.10).
_OF_SIX_BY_SIX = np.array([21, 16, 5, 9, 0, 6, 7, 12, 13, 14], np.int32)
_OF_PSEUDO = np.array([15, 3, 7, 11, 0, 4, 5, 8, 9, 10], np.int32)
_TO_PSEUDO = np.array([0, 1, 3, 6, 1, 2, 4, 7, 3, 4, 5, 8, 6, 7, 8, 9], np.int32)


# -- sums of products: from the centre of mass to the origin ----------------------------------------------------------


def about_origin_of(mass: Numbers, com: Three, central: Symmetric) -> Symmetric:
    """(*batch, 6) inertia about the origin."""
    return vectors.plus(central, algebra.parallel_axis(vectors.times(mass[0], com), com))


about_origin = formula(about_origin_of, of_sums=True)


@formula(of_sums=True)
def about_center(mass: Numbers, com: Three, about_origin: Symmetric) -> Symmetric:
    """(*batch, 6) inertia about the centre of mass."""
    return vectors.minus(about_origin, algebra.parallel_axis(vectors.times(mass[0], com), com))


@formula(of_sums=True)
def dynamic_parameters(mass: Numbers, com: Three, central: Symmetric) -> Numbers:
    """(*batch, 10) m, m c, inertia about the origin."""
    return mass[0], *vectors.times(mass[0], com), *about_origin_of(mass, com, central)


@formula(of_sums=True)
def six_by_six(mass: Numbers, com: Three, central: Symmetric) -> Numbers:
    """(*batch, 36) [[I, m [c x]], [-m [c x], m 1]] about the origin."""
    m, zero = mass[0], constant(com[0], 0)
    arm = algebra.skew(vectors.times(m, com))
    ones = [[m if i == j else zero for j in range(3)] for i in range(3)]
    blocks = (symmetric.rows(about_origin_of(mass, com, central)), arm), (vectors.transpose(arm), ones)
    return tuple(x for left, right in blocks for a, b in zip(left, right, strict=True) for x in (*a, *b))


@formula(of_sums=True)
def _second_moments(mass: Numbers, com: Three, central: Symmetric) -> Numbers:
    """(*batch, 10) Sigma_xx, Sigma_xy, Sigma_yy, Sigma_xz, Sigma_yz, Sigma_zz about the origin, m c, m."""
    moment = vectors.times(mass[0], com)
    xx, xy, yy, xz, yz, zz = central
    xx, yy, zz = map(halved, (xx, yy, zz))

    def diagonal(i: int, a: Number, b: Number, minus: Number) -> Number:
        return ((a + b) - minus) + moment[i] * com[i]

    def off_diagonal(i: int, j: int, entry: Number) -> Number:
        return moment[i] * com[j] - entry

    entries = diagonal(0, yy, zz, xx), off_diagonal(0, 1, xy), diagonal(1, xx, zz, yy)
    entries += off_diagonal(0, 2, xz), off_diagonal(1, 2, yz), diagonal(2, xx, yy, zz)
    return *entries, *moment, *mass


def pseudo_inertia(precision: PrecisionName, mass: jax.Array, com: jax.Array, central: jax.Array) -> jax.Array:
    """(*batch, 4, 4) [[Sigma, m c], [m c^T, m]] about the origin."""
    ten = _second_moments(precision, mass, com, central)
    return symmetric.picked(ten, _TO_PSEUDO).reshape((*ten.shape[:-1], 4, 4))


# -- quotients and roots: back again ----------------------------------------------------------------------------------


def from_six_by_six(precision: PrecisionName, entries: jax.Array) -> list[jax.Array]:
    """(com, central) of a 6 x 6 matrix by its 36 entries; m is entry 21."""
    return from_dynamic_parameters(precision, entries[..., _OF_SIX_BY_SIX])


@formula
def from_dynamic_parameters(ten: Numbers) -> list[Numbers]:
    """[com, central]."""
    moment, inertia = ten[1:4], ten[4:]
    com = _center(ten[0], moment)
    return [com, tuple(i - a for i, a in zip(inertia, algebra.parallel_axis(moment, com), strict=True))]


def _center(m: Number, moment: Three) -> Three:
    """m c / m; 0 where nothing is divided by nothing."""
    return tuple(p / where((high(m) == 0) & (high(p) == 0), 1.0, m) for p in moment)


def from_pseudo_inertia(precision: PrecisionName, entries: jax.Array) -> list[jax.Array]:
    """[com, central] of a 4 x 4 pseudo-inertia by its 16 entries; m is the last."""
    return _from_pseudo_inertia(precision, entries[..., _OF_PSEUDO])


@formula
def _from_pseudo_inertia(ten: Numbers) -> list[Numbers]:
    m, *moment = ten[:4]
    com = _center(m, moment)
    products = [moment[i] * com[j] for i, j in ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))]
    seconds = [s - p for s, p in zip(ten[4:], products, strict=True)]
    return [com, symmetric.trace_minus(seconds)]


# -- log-Cholesky -----------------------------------------------------------------------------------------------------


@formula
def from_log_cholesky(theta: Numbers) -> list[Number | Numbers]:
    """[mass, com, central]: J = U U^T leaves Sigma = m L L^T about the centre of mass, and t is the centre of mass."""
    alpha, d1, d2, d3, s12, s23, s13, *t = theta
    m, e1, e2, e3 = exp(2 * alpha), exp(d1), exp(d2), exp(d3)
    xx, yy, zz = e1 * e1 + (s12 * s12 + s13 * s13), e2 * e2 + s23 * s23, e3 * e3
    xy, xz, yz = s12 * e2 + s13 * s23, s13 * e3, s23 * e3
    central = symmetric.trace_minus((xx, xy, yy, xz, yz, zz))
    return [m, tuple(t), tuple(m * x for x in central)]


@formula
def log_cholesky(mass: Numbers, com: Three, central: Symmetric) -> Numbers:
    """The ten parameters: Sigma / m = L L^T, L upper triangular, from the last column on."""
    (m,), (ixx, ixy, iyy, ixz, iyz, izz) = mass, central
    xx, yy, zz = (0.5 * (x / m) for x in ((iyy - ixx) + izz, (ixx - iyy) + izz, (ixx - izz) + iyy))
    l33 = zz.sqrt()
    s13, s23 = -(ixz / m) / l33, -(iyz / m) / l33
    y = yy - s23 * s23
    s12 = (-(ixy / m) - s13 * s23) / y.sqrt()
    x = xx - (s12 * s12 + s13 * s13)
    return *(0.5 * log(a) for a in (m, x, y, zz)), s12, s23, s13, *com
