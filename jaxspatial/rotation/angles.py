"""Rotations about axes by angles, as formulas over numbers."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.functions import angle_ratio, cosine_sine, pi
from jaxspatial.arithmetic.numbers import Number, Numbers, Rows, Three, constant, high, noinline, where


def about(k: int, angle: Number) -> Rows:
    """The matrix of a rotation about the k-th axis, by its rows."""
    c, s = cosine_sine(angle)
    zero, one = constant(c, 0), constant(c, 1)
    i, j = (k + 1) % 3, (k + 2) % 3
    entries = {(i, i): c, (j, j): c, (j, i): s, (i, j): -s, (k, k): one}
    return tuple(tuple(entries.get((a, b), zero) for b in range(3)) for a in range(3))


def about_axis(axis: Three, angle: Number) -> Numbers:
    """The quaternion of a rotation about an axis of any length."""
    c, s = cosine_sine(angle * 0.5)
    return c, *vectors.times(s, vectors.unit(axis))


def axis_angle(q: Numbers) -> tuple[Three, Number]:
    """(axis, angle), 0 <= angle <= pi, of a unit quaternion with real part >= 0; the axis is x where the angle is 0."""
    c, *v = q
    sine = vectors.norm(v)
    is_zero = high(sine) == 0
    length = where(is_zero, 1.0, sine)
    axis = tuple(where(is_zero, float(i == 0), x / length) for i, x in enumerate(v))
    return axis, 2 * angle_ratio(sine * sine, c) * sine


@noinline
def angle_of(s: Number, c: Number) -> Number:
    """atan2(s, c), in [-pi, pi]; 0 for (0, 0). Of a vector of any length."""
    is_negative = high(s) < 0
    (s, c), _ = vectors.scaled((s, c))
    squared = s * s
    total = squared + c * c
    is_zero, is_behind = high(total) == 0, high(c) < 0
    length = where(is_zero, 1.0, total).sqrt()
    ahead = angle_ratio(squared, where(is_behind, -c, c), length) * s
    return where(is_behind, where(is_negative, -pi(s), pi(s)) - ahead, ahead)


def from_roll_pitch_yaw(roll: Number, pitch: Number, yaw: Number) -> Numbers:
    """The quaternion of Rz(yaw) Ry(pitch) Rx(roll)."""
    (a, x), (b, y), (c, z) = (cosine_sine(angle * 0.5) for angle in (roll, pitch, yaw))
    cb, sb, cy, sy = c * b, z * y, c * y, z * b
    return cb * a + sb * x, cb * x - sb * a, cy * a + sy * x, sy * a - cy * x


def roll_pitch_yaw(q: Numbers) -> Three:
    """(roll, pitch, yaw) of a unit quaternion, |pitch| <= pi / 2.

    Sum and difference of roll and yaw are angles of their own, which keep their digits near |pitch| = pi / 2; where one
    of them has no meaning any more it is taken as 0. [Mitiguy, in Drake's RollPitchYaw]
    """
    w, x, y, z = q
    half_sum, half_difference = angle_of(z + x, w - y), angle_of(z - x, w + y)
    roll, yaw = half_sum - half_difference, half_sum + half_difference
    pitch = _pitch(w + y, z - x, w - y, z + x)
    return _wrapped(roll), pitch, _wrapped(yaw)


def _pitch(a: Number, b: Number, c: Number, d: Number) -> Number:
    """2 atan(|(a, b)| / |(c, d)|) - pi / 2, with a^2 + b^2 = 1 + sin(pitch), c^2 + d^2 = 1 - sin(pitch)."""
    above, below = vectors.norm((a, b)), vectors.norm((c, d))
    return 2 * angle_of(above - below, above + below)


def _wrapped(angle: Number) -> Number:
    """In [-pi, pi], of an angle within 2 pi."""
    half = pi(angle)
    raised = where(high(angle) < -high(half), angle + 2 * half, angle)
    return where(high(angle) > high(half), angle - 2 * half, raised)
