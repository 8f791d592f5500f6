"""Vectors and rotations that kinds of joints share, over numbers."""

import math

from jaxspatial.numerics.functions import pi
from jaxspatial.numerics.linear import Matrix, Vector, skew
from jaxspatial.numerics.numbers import Number, constant, nearest_integer, where


def rotation_about(axis: Vector, cosine: Number, sine: Number) -> Matrix:
    """The rotation about a unit vector: k k^T + c (1 - k k^T) + s [k]x. [Rodrigues 1840]"""
    kk, kx = [[a * b for b in axis] for a in axis], skew(axis)
    one_minus_cosine = 1 - cosine
    return Matrix.of_entries(
        [
            kk[i][j] + cosine * (1 - kk[i][j]) if i == j else kk[i][j] * one_minus_cosine + sine * kx[i][j]
            for i in range(3)
            for j in range(3)
        ]
    )


def perpendicular(axis: Vector) -> tuple[Vector, Vector]:
    """Two unit vectors that make a right-handed frame with this one. [Duff et al. 2017, Building an orthonormal basis,
    revisited, listing 3]"""
    x, y, z = axis
    sign = where(z >= 0, constant(z, 1), constant(z, -1))
    a = -1 / (sign + z)
    b = x * y * a
    return Vector(1 + sign * (x * x * a), sign * b, -(sign * x)), Vector(b, sign + y * y * a, -y)


def shortest_angle(angle: Number) -> Number:
    """The angle less whole turns, within half a turn."""
    turns = nearest_integer(angle * (1 / math.tau))
    return where(abs(angle) <= math.pi, angle, angle - turns * (2 * pi(angle)))
