"""Vectors and rotations that kinds of joints share, over numbers."""

import math

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.functions import pi
from jaxspatial.arithmetic.numbers import Motion, Three, Wrench, constant, nearest_integer, where
from jaxspatial.arithmetic.numbers import Number as Number
from jaxspatial.arithmetic.numbers import Rows as Rows
from jaxspatial.spatial import algebra

Vector = Three
# (angular, linear): a motion (w_PB_B, v_PBo_B), or a wrench (tau, f), about Bo in the child's axes.
Six = Motion | Wrench


def rotation_about(axis: Vector, cosine: Number, sine: Number) -> Rows:
    """The rotation about a unit vector, by its rows: k k^T + c (1 - k k^T) + s [k]x. [Rodrigues 1840]"""
    kk, kx = [[a * b for b in axis] for a in axis], algebra.skew(axis)
    less = 1 - cosine
    return tuple(
        tuple(kk[i][j] + cosine * (1 - kk[i][j]) if i == j else kk[i][j] * less + sine * kx[i][j] for j in range(3))
        for i in range(3)
    )


def perpendicular(axis: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors that make a right-handed frame with this one. [Duff et al. 2017, Building an orthonormal basis,
    revisited, listing 3]"""
    x, y, z = axis
    sign = where(z >= 0, constant(z, 1), constant(z, -1))
    a = -1 / (sign + z)
    b = x * y * a
    return (1 + sign * (x * x * a), sign * b, -(sign * x)), (b, sign + y * y * a, -y)


def shortest_angle(angle: Number) -> Number:
    """The angle less whole turns, within half a turn."""
    turns = nearest_integer(angle * (1 / math.tau))
    return where(abs(angle) <= math.pi, angle, angle - turns * (2 * pi(angle)))


def rotate_back(rows: Rows, v: Vector) -> Vector:
    """R^T v."""
    return vectors.matrix_times(vectors.transpose(rows), v)
