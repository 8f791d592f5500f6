"""Unit quaternions (w, x, y, z) over numbers: from and to matrices, axes, angles and directions."""

import math
import operator

from jaxspatial.numerics.functions import angle_ratio, cosine_sine, pi
from jaxspatial.numerics.linear import Matrix, Vector, cross, dot, entrywise, norm, scaled, unit
from jaxspatial.numerics.numbers import Number, Numbers, constant, doubled, high, noinline, repeated, where

# -- quaternions and matrices -----------------------------------------------------------------------------------------


@noinline
def to_matrix(q: Numbers) -> Matrix:
    """The matrix of a unit quaternion, as accurate as if q had exactly unit length.

    The matrix of q has twice the error that rounding left in the length. To remove it, 1 - |q|^2 times the matrix is
    added, computed of the same squares as the diagonal, so that their rounding errors cancel.
    """
    w, x, y, z = q
    ww, xx, yy, zz, *doubles = entrywise(operator.mul, (w, x, y, z, x, x, y, w, w, w), (w, x, y, z, y, z, z, x, y, z))
    missing = 1 - ((ww + xx) + (yy + zz))
    xy, xz, yz, wx, wy, wz = map(doubled, doubles)
    low = entrywise(operator.sub, (ww, ww, ww, xx, yy, zz, xy, xz, yz), (yy, xx, xx, zz, zz, yy, wz, wy, wx))
    a, e, i, b, f, g = entrywise(operator.add, (*low[:3], xy, xz, yz), (low[3], low[4], low[5], wz, wy, wx))
    m = (a, low[6], f, b, e, low[8], low[7], g, i)
    return Matrix.of_entries(entrywise(operator.add, m, _times(missing, m)))


def from_matrix(m: Matrix) -> Numbers:
    """The unit quaternion with w >= 0 of a matrix, nearly a rotation."""
    return unit(proportional(m))


@noinline
def proportional(m: Matrix) -> Numbers:
    """A quaternion with w >= 0, of a length from 1/2 to 1, of a matrix, nearly a rotation.

    4 q q^T has rows that are sums of entries of m; the one with the largest diagonal is 4 q_i q, with |q_i| >= 1/2.
    [Shepperd 1978]
    """
    (a, b, c), (d, e, f), (g, h, i) = m
    plus, minus, ei_sum, ei_difference = 1 + a, 1 - a, e + i, e - i
    p, q, bd, cg, fh = entrywise(operator.add, (plus, minus, b, c, f), (ei_sum, ei_difference, d, g, h))
    r, s, hf, gc, db = entrywise(operator.sub, (plus, minus, h, c, d), (ei_sum, ei_difference, f, g, b))
    rows = (p, hf, gc, db), (hf, r, bd, cg), (gc, bd, q, fh), (db, cg, fh, s)
    largest, diagonal = rows[0], rows[0][0]
    for k in (1, 2, 3):
        is_larger = high(rows[k][k]) > high(diagonal)
        largest = tuple(where(is_larger, x, y) for x, y in zip(rows[k], largest, strict=True))
        diagonal = where(is_larger, rows[k][k], diagonal)
    return with_positive_real_part(tuple(doubled(x, -2) for x in largest))


def with_positive_real_part(q: Numbers) -> Numbers:
    """q or -q, which mean the same rotation; q where w is 0."""
    is_negative = high(q[0]) < 0
    return tuple(where(is_negative, -x, x) for x in q)


def hamilton_product(p: Numbers, q: Numbers) -> Numbers:
    """p q: first q, then p."""
    a, b, v, w = p[0], q[0], Vector(*p[1:]), Vector(*q[1:])
    return a * b - dot(v, w), *(a * w + b * v + cross(v, w))


# -- axes and angles --------------------------------------------------------------------------------------------------


def matrix_about(k: int, angle: Number) -> Matrix:
    """The matrix of a rotation about the k-th axis."""
    c, s = cosine_sine(angle)
    zero, one = constant(c, 0), constant(c, 1)
    i, j = (k + 1) % 3, (k + 2) % 3
    entries = {(i, i): c, (j, j): c, (j, i): s, (i, j): -s, (k, k): one}
    return Matrix.of_entries([entries.get((a, b), zero) for a in range(3) for b in range(3)])


def about_axis(axis: Vector, angle: Number) -> Numbers:
    """The quaternion of a rotation about an axis of any length."""
    c, s = cosine_sine(angle * 0.5)
    return c, *(s * unit(axis))


def axis_angle(q: Numbers) -> list[Vector | Number]:
    """[axis, angle], 0 <= angle <= pi, of a unit quaternion with w >= 0; the axis is x where the angle is 0."""
    c, *v = q
    sine = norm(v)
    is_zero = high(sine) == 0
    length = where(is_zero, 1.0, sine)
    axis = Vector(*(where(is_zero, float(i == 0), x / length) for i, x in enumerate(v)))
    return [axis, 2 * angle_ratio(sine * sine, c) * sine]


@noinline
def angle_of(s: Number, c: Number) -> Number:
    """atan2(s, c), in [-pi, pi]; 0 for (0, 0). Of a vector of any length."""
    is_negative = high(s) < 0
    (s, c), _ = scaled((s, c))
    squared = s * s
    length_squared = squared + c * c
    is_zero, is_behind = high(length_squared) == 0, high(c) < 0
    length = where(is_zero, 1.0, length_squared).sqrt()
    ahead = angle_ratio(squared, where(is_behind, -c, c), length) * s
    return where(is_behind, where(is_negative, -pi(s), pi(s)) - ahead, ahead)


def from_roll_pitch_yaw(roll: Number, pitch: Number, yaw: Number) -> Numbers:
    """The quaternion of Rz(yaw) Ry(pitch) Rx(roll)."""
    (a, x), (b, y), (c, z) = (cosine_sine(angle * 0.5) for angle in (roll, pitch, yaw))
    cb, sb, cy, sy = c * b, z * y, c * y, z * b
    return cb * a + sb * x, cb * x - sb * a, cy * a + sy * x, sy * a - cy * x


def roll_pitch_yaw(q: Numbers) -> Vector:
    """(roll, pitch, yaw) of a unit quaternion, |pitch| <= pi / 2.

    Sum and difference of roll and yaw are computed as angles, which keep their digits near |pitch| = pi / 2; where one
    of them has no meaning any more it is 0. [Mitiguy, in Drake's RollPitchYaw]
    """
    w, x, y, z = q
    half_sum, half_difference = angle_of(z + x, w - y), angle_of(z - x, w + y)
    roll, yaw = half_sum - half_difference, half_sum + half_difference
    # 2 atan(above / below) - pi / 2, with above^2 = 1 + sin(pitch), below^2 = 1 - sin(pitch).
    above, below = norm((w + y, z - x)), norm((w - y, z + x))
    pitch = 2 * angle_of(above - below, above + below)
    return Vector(_wrapped(roll), pitch, _wrapped(yaw))


def _wrapped(angle: Number) -> Number:
    """In [-pi, pi], of an angle within 2 pi."""
    half = pi(angle)
    raised = where(high(angle) < -high(half), angle + 2 * half, angle)
    return where(high(angle) > high(half), angle - 2 * half, raised)


# -- directions -------------------------------------------------------------------------------------------------------


def from_one_vector(u: Vector, axis: int) -> Matrix:
    """The rotation whose column `axis` is u / |u|; the next column is perpendicular to the coordinate axis along which
    u is smallest."""
    u = unit(u)
    v = unit(cross(_axis_of_smallest(u), u))
    return _of_columns(axis, u, v, cross(u, v))


def from_two_vectors(u: Vector, v: Vector, axes: tuple[int, int]) -> Matrix:
    """The rotation whose column axes[0] is u / |u|, with v in the half plane of that column and column axes[1], on its
    positive side."""
    u = unit(u)
    normal = unit(cross(u, unit(v)))
    second = cross(normal, u)
    first, other = axes
    if (other - first) % 3 == 1:
        return _of_columns(first, u, second, normal)
    return _of_columns(first, u, -normal, second)


def _of_columns(axis: int, *columns: Vector) -> Matrix:
    """The matrix with the columns axis, axis + 1, axis + 2."""
    return Matrix(*(columns[(k - axis) % 3] for k in range(3))).T


def _axis_of_smallest(u: Vector) -> Vector:
    """The unit vector along the smallest component of u in absolute value, the first of equals."""
    a, b, c = (abs(high(x)) for x in u)
    is_first, is_second = (a <= b) & (a <= c), b <= c
    masks = is_first, ~is_first & is_second, ~is_first & ~is_second
    return Vector(*(where(mask, 1.0, 0 * x) for mask, x in zip(masks, u, strict=True)))


def between(a: Vector, b: Vector) -> Numbers:
    """The quaternion of the smallest rotation that takes the direction of a to that of b.

    Half way between, h = (a + b) / |a + b|, it is (a . h, a x h). For opposite directions h is any perpendicular one.
    """
    a, b = unit(a), unit(b)
    half = a + b
    is_opposite = high(dot(half, half)) == 0
    sideways = cross(a, _axis_of_smallest(a))
    h = unit(Vector(*(where(is_opposite, s, x) for s, x in zip(sideways, half, strict=True))))
    return dot(a, h), *cross(a, h)


def nearest(m: Matrix) -> Matrix:
    """The rotation nearest to a matrix of positive determinant: its orthogonal polar factor.

    Newton's iteration, the mean of the matrix and its inverse transpose, scaled at the start so that it converges in as
    many steps as the squares of errors need. [Higham 1986, Computing the polar decomposition; 2008, Functions of
    matrices, 8.6]
    """
    return Matrix.of_entries(repeated(_newton_step, 12, scaled(m.entries)[0].entries))


def _newton_step(entries: Numbers) -> Numbers:
    """(s m + m^-T / s) / 2 with s^2 = |m^-T| / |m|, which gives both the same size."""
    x, y, z = Matrix.of_entries(entries)
    cofactors = Matrix(cross(y, z), cross(z, x), cross(x, y))
    determinant = dot(x, cofactors.x)
    is_proper = (high(determinant) > 0) & (high(determinant) < math.inf)
    inverse = _times(1 / where(is_proper, determinant, math.nan), cofactors.entries)
    s = (dot(inverse, inverse).sqrt() / dot(entries, entries).sqrt()).sqrt()
    mean = entrywise(operator.add, _times(s, entries), _times(1 / s, inverse))
    return tuple(doubled(x, -1) for x in mean)


def _times(s: Number, entries: Numbers) -> Numbers:
    """All in one operation, where that is shorter to compile: see `entrywise`."""
    return entrywise(operator.mul, (s,) * len(entries), entries)
