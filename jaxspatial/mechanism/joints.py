"""The kinds of joints: one block each, the same verbs in the same order. A new kind is a form to fill in.

A joint holds the child's frame B against the parent's side P of the joint; both are one frame at zero. Over numbers,
of one item:

    transform(axes, q, turned)      (R_PB by its rows, p_PoBo_P)
    subspace(axes, turned)          nv motions (w_PB_B, v_PBo_B), in the child's axes, per rate: the columns of S
    subspace_rate(axes, turned, v)  dS/dt, nv motions, its entries in the child's axes
    rates(axes, q, turned, v)       dq/dt, nq numbers
    integrate(axes, q, step)        q after the motion S step, that is as constant in B as S is
    difference(axes, q, q2)         the step that integrates q to q2

axes: Axes. q: nq numbers, v and step: nv. turned: (cosine, sine) of the coordinates that are angles. A zero or one of
an axis that is known while tracing leaves no operation behind. [Featherstone 2008, tables 4.1 and 4.2]
"""

import math
from typing import Any, NamedTuple

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.functions import cosine_sine, pi
from jaxspatial.arithmetic.numbers import constant, doubled, nearest_integer, where
from jaxspatial.rotation import exponential, quaternion


class Axes(NamedTuple):
    """What a joint turns about and slides along, unit vectors in P, and the pitch of a helical one, metres per radian.

    Only "universal" has a second axis: the one that is carried by the first.
    """

    first: Any
    second: Any
    pitch: Any


class Kind:
    """Base of all kinds: a joint that only turns about and slides along axes fixed in its child adds its steps."""

    name: str
    nq: int
    nv: int
    # Which coordinates are angles, in radians.
    angles: tuple = ()
    # The coordinates at zero.
    neutral: tuple = (0.0,)
    takes_axis: bool = True
    # The kind that a recursion takes it for: it moves as joints of this name do.
    moves_as: str
    # Whether dq/dt depends on its angles.
    has_turning_rates: bool = False
    # Whether its rates are as those of joints with one rate each, one after the other.
    is_sequential: bool = True

    def __init_subclass__(cls):
        cls.moves_as = vars(cls).get("moves_as", cls.name)

    @classmethod
    def subspace_rate(cls, axes, turned, v):
        return ((_zero(axes), _zero(axes)),) * cls.nv

    @staticmethod
    def rates(axes, q, turned, v):
        return v

    @staticmethod
    def integrate(axes, q, step):
        return vectors.plus(q, step)

    @staticmethod
    def difference(axes, q, q2):
        return vectors.minus(q2, q)


class Fixed(Kind):
    """Welds two bodies."""

    name, nq, nv, neutral, takes_axis = "fixed", 0, 0, (), False

    @staticmethod
    def transform(axes, q, turned):
        return _unturned(axes), _zero(axes)

    @staticmethod
    def subspace(axes, turned):
        return ()


class Revolute(Kind):
    """Turns about the axis: q the angle, rad."""

    name, nq, nv, angles = "revolute", 1, 1, (0,)

    @staticmethod
    def transform(axes, q, turned):
        return about(axes.first, *turned[0]), _zero(axes)

    @staticmethod
    def subspace(axes, turned):
        return ((axes.first, _zero(axes)),)


class Continuous(Revolute):
    """A revolute joint without limits; differences are the short way round."""

    name, moves_as = "continuous", "revolute"

    @staticmethod
    def difference(axes, q, q2):
        return (_shortest(q2[0] - q[0]),)


class Prismatic(Kind):
    """Slides along the axis: q the distance, m."""

    name, nq, nv = "prismatic", 1, 1

    @staticmethod
    def transform(axes, q, turned):
        return _unturned(axes), vectors.times(q[0], axes.first)

    @staticmethod
    def subspace(axes, turned):
        return ((_zero(axes), axes.first),)


class Helical(Kind):
    """A screw: q the angle, rad, and pitch times it along the axis, m."""

    name, nq, nv, angles = "helical", 1, 1, (0,)

    @staticmethod
    def transform(axes, q, turned):
        return about(axes.first, *turned[0]), vectors.times(axes.pitch * q[0], axes.first)

    @staticmethod
    def subspace(axes, turned):
        return ((axes.first, vectors.times(axes.pitch, axes.first)),)


class Cylindrical(Kind):
    """Turns about the axis and slides along it: q the angle, rad, and the distance, m."""

    name, nq, nv, angles, neutral = "cylindrical", 2, 2, (0,), (0.0, 0.0)

    @staticmethod
    def transform(axes, q, turned):
        return about(axes.first, *turned[0]), vectors.times(q[1], axes.first)

    @staticmethod
    def subspace(axes, turned):
        return (axes.first, _zero(axes)), (_zero(axes), axes.first)


class Universal(Kind):
    """Turns about the first axis, and then about the second, that the first carries: q two angles, rad."""

    name, nq, nv, angles, neutral = "universal", 2, 2, (0, 1), (0.0, 0.0)

    @staticmethod
    def transform(axes, q, turned):
        return vectors.product(about(axes.first, *turned[0]), about(axes.second, *turned[1])), _zero(axes)

    @staticmethod
    def subspace(axes, turned):
        return (_carried(axes, turned), _zero(axes)), (axes.second, _zero(axes))

    @classmethod
    def subspace_rate(cls, axes, turned, v):
        """The first axis turns back in the child's axes, at -q2' k2."""
        turning = vectors.cross(_carried(axes, turned), axes.second)
        return (vectors.times(v[1], turning), _zero(axes)), (_zero(axes), _zero(axes))


class Planar(Kind):
    """Slides in the plane of x and y and turns about z: q = (x, y, angle), m and rad, in the parent's axes.

    v = (x, y, angular) is in the child's axes, so that the subspace is constant.
    """

    name, nq, nv, angles, neutral, takes_axis = "planar", 3, 3, (2,), (0.0, 0.0, 0.0), False
    is_sequential, has_turning_rates = False, True

    @staticmethod
    def transform(axes, q, turned):
        return about(_unit(axes, 2), *turned[2]), (q[0], q[1], constant(axes.pitch, 0))

    @staticmethod
    def subspace(axes, turned):
        zero = _zero(axes)
        return (zero, _unit(axes, 0)), (zero, _unit(axes, 1)), (_unit(axes, 2), zero)

    @staticmethod
    def rates(axes, q, turned, v):
        c, s = turned[2]
        return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]

    @staticmethod
    def integrate(axes, q, step):
        c, s = cosine_sine(q[2])
        x, y, _ = exponential.translation((*_zero(axes)[:2], step[2]), (*step[:2], constant(axes.pitch, 0)))
        return q[0] + (c * x - s * y), q[1] + (s * x + c * y), q[2] + step[2]

    @staticmethod
    def difference(axes, q, q2):
        c, s = cosine_sine(q[2])
        x, y, turn = q2[0] - q[0], q2[1] - q[1], _shortest(q2[2] - q[2])
        axis, arm = (*_zero(axes)[:2], turn), (c * x + s * y, c * y - s * x, constant(axes.pitch, 0))
        return (*vectors.matrix_times(exponential.left_jacobian_inverse(axis), arm)[:2], turn)


class Ball(Kind):
    """Turns about any axis: q a unit quaternion wxyz, v = w_PB_B, rad/s."""

    name, nq, nv, neutral, takes_axis = "ball", 4, 3, (1.0, 0.0, 0.0, 0.0), False
    is_sequential = False

    @staticmethod
    def transform(axes, q, turned):
        return quaternion.to_matrix(q), _zero(axes)

    @staticmethod
    def subspace(axes, turned):
        return tuple((_unit(axes, k), _zero(axes)) for k in range(3))

    @staticmethod
    def rates(axes, q, turned, v):
        """q (0, v) / 2."""
        return tuple(doubled(x, -1) for x in quaternion.product(q, (constant(v[0], 0), *v)))

    @staticmethod
    def integrate(axes, q, step):
        return vectors.unit(quaternion.product(q, exponential.to_quaternion(step)))

    @staticmethod
    def difference(axes, q, q2):
        return exponential.from_quaternion(_between(q, q2))


class Free(Kind):
    """Holds nothing: q = (unit quaternion wxyz, p_PoBo_P), v = V_PB_B, angular first, both in the child's axes."""

    name, nq, nv, takes_axis, is_sequential = "free", 7, 6, False, False
    neutral = (1.0, *[0.0] * 6)

    @staticmethod
    def transform(axes, q, turned):
        return quaternion.to_matrix(q[:4]), tuple(q[4:])

    @staticmethod
    def subspace(axes, turned):
        zero, units = _zero(axes), [_unit(axes, k) for k in range(3)]
        return *((unit, zero) for unit in units), *((zero, unit) for unit in units)

    @staticmethod
    def rates(axes, q, turned, v):
        return *Ball.rates(axes, q[:4], turned, v[:3]), *vectors.matrix_times(quaternion.to_matrix(q[:4]), v[3:])

    @staticmethod
    def integrate(axes, q, step):
        turn, p = exponential.screw(step[:3], step[3:])
        turned = vectors.unit(quaternion.product(q[:4], turn))
        return *turned, *vectors.plus(q[4:], vectors.matrix_times(quaternion.to_matrix(q[:4]), p))

    @staticmethod
    def difference(axes, q, q2):
        back = vectors.transpose(quaternion.to_matrix(q[:4]))
        arm = vectors.matrix_times(back, vectors.minus(q2[4:], q[4:]))
        w, v = exponential.motion_logarithm(quaternion.to_matrix(_between(q[:4], q2[:4])), arm)
        return *w, *v


_KINDS = Fixed, Revolute, Continuous, Prismatic, Helical, Cylindrical, Universal, Planar, Ball, Free
KINDS = {kind.name: kind for kind in _KINDS}


def about(axis, c, s):
    """The rotation about a unit vector, by its rows: k k^T + c (1 - k k^T) + s [k]x. [Rodrigues 1840]"""
    x, y, z = axis
    kk = [[a * b for b in axis] for a in axis]
    kx = (None, -z, y), (z, None, -x), (-y, x, None)
    less = 1 - c
    return tuple(
        tuple(kk[i][j] + c * (1 - kk[i][j]) if i == j else kk[i][j] * less + s * kx[i][j] for j in range(3))
        for i in range(3)
    )


def _zero(axes):
    return (constant(axes.pitch, 0),) * 3


def _unit(axes, k):
    return tuple(constant(axes.pitch, int(i == k)) for i in range(3))


def _unturned(axes):
    return tuple(_unit(axes, k) for k in range(3))


def _carried(axes, turned):
    """The first axis in the axes of the child."""
    return vectors.matrix_times(vectors.transpose(about(axes.second, *turned[1])), axes.first)


def _between(q, q2):
    """conj(q) q2, with real part >= 0."""
    return quaternion.with_positive_real_part(quaternion.product((q[0], *(-x for x in q[1:])), q2))


def _shortest(angle):
    """The angle less whole turns, within half a turn."""
    turns = nearest_integer(angle * (1 / math.tau))
    return where(abs(angle) <= math.pi, angle, angle - turns * (2 * pi(angle)))
