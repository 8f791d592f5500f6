"""Exponential and logarithm of rotations and rigid motions, and their Jacobians, as formulas over numbers.

With t the angle |w| and x its square, everything is made of

    cos(t/2)    S = sin(t/2) / (t/2)    c3 = (t - sin t) / t^3    c4 = (1/2 - (1 - cos t) / t^2) / t^2    c5 = ...

as series in x, which have right derivatives of every order at 0 and need no switch up to pi. Beyond, whole turns are
taken off first. An error of u x would be one of pi u / 2 of an angle near pi: what rounding took from x is kept.
[Barfoot 2017, State Estimation for Robotics, 7.1]
"""

import itertools
import math
from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.functions import angle_ratio, cosine_series, series, sine_series, turns
from jaxspatial.arithmetic.numbers import constant, doubled, high, noinline, where
from jaxspatial.arithmetic.numbers.protocol import Mask, Motion, Number, Numbers, Rows, Three
from jaxspatial.rotation import quaternion

# A little above pi^2 and (pi / 2)^2.
_UP_TO_PI, _UP_TO_HALF_PI = 10, Fraction(5, 2)


class Turn(NamedTuple):
    """What the exponential of w is made of: the angle squared, cos and S of half the angle after whole turns are taken
    off, the rest of the angle as a part of it, and a mask where whole turns were taken off."""

    squared: Number
    cosine: Number
    sine: Number
    part: Number
    is_large: Mask


@noinline
def turn(w: Three) -> Turn:
    """The Turn of a rotation vector."""
    squared, missing = vectors.square(w)
    is_large = high(squared) > _UP_TO_PI
    angle = where(is_large, squared, 16.0).sqrt()
    rest = turns(angle, 1)[1]
    if missing is not None:
        rest = rest + 0.5 * (missing / angle)
    quarter = doubled(where(is_large, rest * rest, squared), -2)
    cosine, sine = cosine_series(quarter, _UP_TO_HALF_PI), sine_series(quarter, _UP_TO_HALF_PI)
    if missing is not None:
        missing = where(is_large, 0.0, 0.25 * missing)
        # The derivatives -S/2 and -1/6 + x/240 - ...: two digits are enough.
        cosine, sine = cosine - 0.5 * (sine * missing), sine - (0.167 - quarter * 0.016) * missing
    return Turn(squared, cosine, sine, where(is_large, rest / angle, 1.0), is_large)


def to_quaternion(w: Three) -> Numbers:
    """exp(w) as a unit quaternion."""
    return _quaternion(turn(w), w)


def _quaternion(t: Turn, w: Three) -> Numbers:
    return t.cosine, *vectors.times(doubled(t.sine * t.part, -1), w)


def from_quaternion(q: Numbers) -> Three:
    """log of a quaternion of a length about 1, with real part >= 0: the rotation vector, of length <= pi."""
    return _logarithm(q)[0]


@noinline
def _logarithm(q: Numbers) -> tuple[Three, Number]:
    """(w, (t/2) cot(t/2)), of which nothing is rounded to unit length first."""
    c, *v = q
    squared = vectors.dot(v, v)
    length = (c * c + squared).sqrt()
    half = angle_ratio(squared, c, where(high(length) < math.inf, length, math.nan))
    return vectors.times(doubled(half), v), half * c


def rotation(w: Three) -> Rows:
    """exp(w) as a matrix by its rows."""
    return quaternion.to_matrix(to_quaternion(w))


def rotation_vector(m: Rows) -> Three:
    """log of a matrix by its rows."""
    return from_quaternion(quaternion.proportional(m))


# -- coefficients -----------------------------------------------------------------------------------------------------


def _coefficient(t: Turn, first: int) -> Number:
    """sum of (-x)^n / (2 n + first)! for angles up to pi."""
    x = where(t.is_large, 0.0, t.squared)
    return series((Fraction((-1) ** n, math.factorial(2 * n + first)) for n in itertools.count()), x, _UP_TO_PI)


@noinline
def coefficients(t: Turn) -> tuple[Number, Number, Number]:
    """c1 = sin t / t, c2 = (1 - cos t) / t^2, c3 = (1 - c1) / t^2."""
    s = t.sine * t.part
    c1 = s * t.cosine
    return c1, doubled(s * s, -1), _beyond_pi(t, 1 - c1, _coefficient(t, 3))


@noinline
def higher_coefficients(t: Turn, c2: Number, c3: Number) -> tuple[Number, Number]:
    """c4 = (1/2 - c2) / t^2, c5 = (1/6 - c3) / t^2."""
    sixth = constant(c3, Fraction(1, 6))
    return _beyond_pi(t, 0.5 - c2, _coefficient(t, 4)), _beyond_pi(t, sixth - c3, _coefficient(t, 5))


def _beyond_pi(t: Turn, numerator: Number, up_to_pi: Number) -> Number:
    return where(t.is_large, numerator / where(t.is_large, t.squared, 16.0), up_to_pi)


@noinline
def inverse_coefficients(t: Turn) -> tuple[Number, Number]:
    """e = (t/2) cot(t/2), d = (1 - e) / t^2: infinite at whole turns but 0."""
    e = t.cosine / (t.sine * t.part)
    return e, _missing_to_one(e, t.squared)


@noinline
def _missing_to_one(e: Number, squared: Number) -> Number:
    """(1 - e) / t^2 of e = (t/2) cot(t/2)."""
    is_small = high(squared) <= 1
    closed = (1 - e) / where(is_small, 16.0, squared)
    return where(is_small, series(_bernoulli(), where(is_small, squared, 0.0), 1), closed)


def _bernoulli() -> Iterator[Fraction]:
    """|B_2n| / (2 n)! for n = 1, 2, ...: 1/12, 1/720, ..."""
    known = [Fraction(1)]
    for m in itertools.count(1):
        known.append(-sum((math.comb(m + 1, k) * b for k, b in enumerate(known)), Fraction()) / (m + 1))
        if m % 2 == 0:
            yield abs(known[m]) / math.factorial(m)


# -- applied ----------------------------------------------------------------------------------------------------------


def _combination(c: Number, half: Number | float, d: Number, w: Three, v: Three) -> Three:
    """c v + half w x v + d (w . v) w."""
    along = d * vectors.dot(w, v)
    return vectors.plus(vectors.times(c, v), vectors.times(half, vectors.cross(w, v)), vectors.times(along, w))


def motion(w: Three, v: Three) -> tuple[Rows, Three]:
    """exp(w, v) as a matrix by its rows and a translation."""
    t = turn(w)
    return quaternion.to_matrix(_quaternion(t, w)), _translation(t, w, v)


def screw(w: Three, v: Three) -> tuple[Numbers, Three]:
    """exp(w, v) as a unit quaternion and a translation."""
    t = turn(w)
    return _quaternion(t, w), _translation(t, w, v)


@noinline
def motion_logarithm(m: Rows, p: Three) -> Motion:
    """(w, v) of a matrix by its rows and a translation."""
    w, e = _logarithm(quaternion.proportional(m))
    return w, _combination(e, -0.5, _missing_to_one(e, vectors.dot(w, w)), w, p)


def translation(w: Three, v: Three) -> Three:
    """The translation of exp(w, v)."""
    return _translation(turn(w), w, v)


@noinline
def _translation(t: Turn, w: Three, v: Three) -> Three:
    """J(w) v, J the left Jacobian. Written without the difference of v and its share
    along the axis, nothing cancels: at pi, sin t / t is 0."""
    return _combination(*coefficients(t), w, v)


# -- Jacobians --------------------------------------------------------------------------------------------------------


def left_jacobian(w: Three) -> Rows:
    """J with exp(w + e) = exp(J e) exp(w) for small e, by its rows; also of the translation of exp(w, v) in v."""
    return _operator(*coefficients(turn(w)), w)


@noinline
def left_jacobian_inverse(w: Three) -> Rows:
    """J^-1 of `left_jacobian`, by its rows."""
    e, d = inverse_coefficients(turn(w))
    return _operator(e, -0.5, d, w)


def _operator(c: Number, half: Number | float, d: Number, w: Three) -> Rows:
    """The matrix c 1 + half [w x] + d w w^T."""
    x, y, z = vectors.times(half, w)
    skew = ((0, -z, y), (z, 0, -x), (-y, x, 0))
    dw = vectors.times(d, w)
    return tuple(tuple(dw[i] * w[j] + (c if i == j else skew[i][j]) for j in range(3)) for i in range(3))


@noinline
def coupling(w: Three, v: Three) -> Rows:
    """Q, the lower left block of the left Jacobian of exp(w, v), rotational part on top, by its rows.

    The motion exp((w, v) + (e, 0)) exp(w, v)^-1 moves the point at the origin by d - (J e) x p, where p = J v is the
    translation and d its derivative along e. With c1, c2, c3 of J = c1 1 + c2 [w x] + c3 w w^T as functions of w^2,

        2 dc1 = c3 - c2        2 dc2 = 2 c4 - c3        2 dc3 = 3 c5 - c4
    """
    t = turn(w)
    c1, c2, c3 = coefficients(t)
    c4, c5 = higher_coefficients(t, c2, c3)
    along, w_v = vectors.dot(w, v), vectors.cross(w, v)
    by_square = vectors.plus(
        vectors.times(c3 - c2, v), vectors.times(2 * c4 - c3, w_v), vectors.times((3 * c5 - c4) * along, w)
    )
    p, jacobian = _combination(c1, c2, c3, w, v), _operator(c1, c2, c3, w)
    columns: list[Three] = []
    for k in range(3):
        unit = tuple(constant(w[0], int(i == k)) for i in range(3))
        sideways = vectors.cross(unit, v)
        of_axis = tuple(c3 * (v[k] * x + (along if i == k else 0)) for i, x in enumerate(w))
        d = vectors.plus(vectors.times(w[k], by_square), vectors.times(c2, sideways), of_axis)
        Je_p = vectors.cross(tuple(row[k] for row in jacobian), p)
        columns.append(tuple(a - b for a, b in zip(d, Je_p, strict=True)))
    return vectors.transpose(columns)


def inverse_coupling(w: Three, v: Three) -> Rows:
    """-J^-1 Q J^-1, the lower left block of the inverse left Jacobian of exp(w, v)."""
    inverse = left_jacobian_inverse(w)
    found = vectors.matrix_product(inverse, vectors.matrix_product(coupling(w, v), inverse))
    return tuple(tuple(-x for x in row) for row in found)
