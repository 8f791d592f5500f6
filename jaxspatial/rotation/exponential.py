"""Exponential and logarithm of rotations and rigid motions, and their Jacobians, as formulas over numbers.

With t the angle |w| and x its square, everything is made of

    cos(t/2)    S = sin(t/2) / (t/2)    c3 = (t - sin t) / t^3    c4 = (1/2 - (1 - cos t) / t^2) / t^2    c5 = ...

(c_k are Stumpff's functions) as series in x, which have the right derivatives of every order at 0 and need no switch
up to pi. Beyond pi, whole turns
are subtracted first. Near pi an error of u x makes one of pi u / 2 in the angle, so the rounding error of x is computed
too, and used as a correction.
[Barfoot 2017, State Estimation for Robotics, 7.1]
"""

import itertools
import math
from collections.abc import Iterator
from fractions import Fraction
from typing import NamedTuple

from jaxspatial.numerics.functions import angle_ratio, series, stumpff, turns
from jaxspatial.numerics.linear import Matrix, Motion, Pose, Vector, cross, dot, skew, square
from jaxspatial.numerics.numbers import Mask, Number, Numbers, constant, doubled, high, noinline, where
from jaxspatial.rotation import quaternion

# A little above pi^2 and (pi / 2)^2.
_UP_TO_PI, _UP_TO_HALF_PI = 10, Fraction(5, 2)


class Angle(NamedTuple):
    """The angle |w|, as the exponential of w needs it.

    squared: its square
    cosine, sine: cos and S of half the angle, whole turns subtracted
    part: the angle with whole turns subtracted, as a fraction of the angle
    is_large: a mask, where whole turns are subtracted
    """

    squared: Number
    cosine: Number
    sine: Number
    part: Number
    is_large: Mask


@noinline
def _angle(w: Vector) -> Angle:
    squared, missing = square(w)
    is_large = high(squared) > _UP_TO_PI
    angle = where(is_large, squared, 16.0).sqrt()
    rest = turns(angle, 1)[1]
    if missing is not None:
        rest = rest + 0.5 * (missing / angle)
    quarter = doubled(where(is_large, rest * rest, squared), -2)
    cosine, sine = stumpff(0, quarter, _UP_TO_HALF_PI), stumpff(1, quarter, _UP_TO_HALF_PI)
    if missing is not None:
        missing = where(is_large, 0.0, 0.25 * missing)
        # The derivatives -S/2 and -1/6 + x/240 - ...: two digits are enough.
        cosine, sine = cosine - 0.5 * (sine * missing), sine - (0.167 - quarter * 0.016) * missing
    return Angle(squared, cosine, sine, where(is_large, rest / angle, 1.0), is_large)


# -- exponential and logarithm ----------------------------------------------------------------------------------------


def to_quaternion(w: Vector) -> Numbers:
    """exp(w) as a unit quaternion."""
    return _quaternion(_angle(w), w)


def _quaternion(t: Angle, w: Vector) -> Numbers:
    return t.cosine, *(doubled(t.sine * t.part, -1) * Vector(*w))


def from_quaternion(q: Numbers) -> Vector:
    """log of a quaternion of a length about 1, with real part >= 0: the rotation vector, of length <= pi."""
    return _logarithm(q)[0]


@noinline
def _logarithm(q: Numbers) -> tuple[Vector, Number]:
    """(w, (t/2) cot(t/2)), without a rounding of q to unit length before."""
    c, v = q[0], Vector(*q[1:])
    squared = dot(v, v)
    length = (c * c + squared).sqrt()
    half = angle_ratio(squared, c, where(high(length) < math.inf, length, math.nan))
    return doubled(half) * v, half * c


def rotation(w: Vector) -> Matrix:
    """exp(w) as a matrix."""
    return quaternion.to_matrix(to_quaternion(w))


def rotation_vector(m: Matrix) -> Vector:
    """log of a matrix."""
    return from_quaternion(quaternion.proportional(m))


def pose(V: Motion) -> Pose:
    """exp(w, v)."""
    q, p = screw(*V)
    return Pose(quaternion.to_matrix(q), p)


def screw(w: Vector, v: Vector) -> tuple[Numbers, Vector]:
    """exp(w, v) as a unit quaternion and a translation."""
    t = _angle(w)
    return _quaternion(t, w), _translation(t, w, v)


def translation(w: Vector, v: Vector) -> Vector:
    """The translation of exp(w, v)."""
    return _translation(_angle(w), w, v)


@noinline
def motion_logarithm(m: Matrix, p: Vector) -> Motion:
    """(w, v) of a matrix and a translation."""
    w, e = _logarithm(quaternion.proportional(m))
    return Motion(w, _combination(e, -0.5, _missing_to_one(e, dot(w, w)), w, p))


@noinline
def _translation(t: Angle, w: Vector, v: Vector) -> Vector:
    """J(w) v, J the left Jacobian. Written without the difference of v and its component along the axis, nothing
    cancels: at pi, sin t / t is 0."""
    return _combination(*_coefficients(t), w, v)


def _combination(c: Number, half: Number | float, d: Number, w: Vector, v: Vector) -> Vector:
    """c v + half w x v + d (w . v) w."""
    along = d * dot(w, v)
    return c * Vector(*v) + half * cross(w, v) + along * Vector(*w)


# -- coefficients -----------------------------------------------------------------------------------------------------


@noinline
def _coefficients(t: Angle) -> tuple[Number, Number, Number]:
    """c1 = sin t / t, c2 = (1 - cos t) / t^2, c3 = (1 - c1) / t^2."""
    s = t.sine * t.part
    c1 = s * t.cosine
    return c1, doubled(s * s, -1), _stumpff(3, t, 1 - c1)


@noinline
def _higher_coefficients(t: Angle, c2: Number, c3: Number) -> tuple[Number, Number]:
    """c4 = (1/2 - c2) / t^2, c5 = (1/6 - c3) / t^2."""
    sixth = constant(c3, Fraction(1, 6))
    return _stumpff(4, t, 0.5 - c2), _stumpff(5, t, sixth - c3)


def _stumpff(k: int, t: Angle, numerator: Number) -> Number:
    """c_k, which is numerator / t^2: that beyond pi, the series up to pi."""
    up_to_pi = stumpff(k, where(t.is_large, 0.0, t.squared), _UP_TO_PI)
    return where(t.is_large, numerator / where(t.is_large, t.squared, 16.0), up_to_pi)


@noinline
def _inverse_coefficients(t: Angle) -> tuple[Number, Number]:
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


# -- Jacobians --------------------------------------------------------------------------------------------------------


def left_jacobian(w: Vector) -> Matrix:
    """J with exp(w + e) = exp(J e) exp(w) for small e; also of the translation of exp(w, v) in v."""
    return _operator(*_coefficients(_angle(w)), w)


@noinline
def left_jacobian_inverse(w: Vector) -> Matrix:
    """J^-1 of `left_jacobian`."""
    e, d = _inverse_coefficients(_angle(w))
    return _operator(e, -0.5, d, w)


def _operator(c: Number, half: Number | float, d: Number, w: Vector) -> Matrix:
    """The matrix c 1 + half [w]x + d w w^T."""
    w = Vector(*w)
    of_skew, dw = skew(half * w), d * w
    return Matrix(*(Vector(*(dw[i] * w[j] + (c if i == j else of_skew[i][j]) for j in range(3))) for i in range(3)))


@noinline
def coupling(w: Vector, v: Vector) -> Matrix:
    """Q, the lower left block of the left Jacobian of exp(w, v), rotational part on top.

    The motion exp((w, v) + (e, 0)) exp(w, v)^-1 moves the point at the origin by d - (J e) x p, where p = J v is the
    translation and d its derivative along e. With c1, c2, c3 of J = c1 1 + c2 [w]x + c3 w w^T as functions of w^2,

        2 dc1 = c3 - c2        2 dc2 = 2 c4 - c3        2 dc3 = 3 c5 - c4
    """
    t = _angle(w)
    c1, c2, c3 = _coefficients(t)
    c4, c5 = _higher_coefficients(t, c2, c3)
    along, w_v = dot(w, v), cross(w, v)
    by_square = (c3 - c2) * v + (2 * c4 - c3) * w_v + ((3 * c5 - c4) * along) * w
    p, jacobian = _combination(c1, c2, c3, w, v), _operator(c1, c2, c3, w)
    columns: list[Vector] = []
    for k, Je in enumerate(jacobian.T):
        e = Vector(*(constant(w[0], int(i == k)) for i in range(3)))
        sideways = cross(e, v)
        of_axis = Vector(*(c3 * (v[k] * x + (along if i == k else 0)) for i, x in enumerate(w)))
        d = w[k] * by_square + c2 * sideways + of_axis
        # By components: a difference of vectors of double words is stacked into one, which takes longer here.
        columns.append(Vector(*(a - b for a, b in zip(d, cross(Je, p), strict=True))))
    return Matrix(*columns).T
