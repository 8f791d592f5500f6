"""Motions (w, v) and wrenches (tau, f) as halves, and 3 x 3 matrices by their rows, over numbers."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import constant


def motion_cross(a, b):
    """a x b of spatial motions: the rate of b, fixed in a frame that moves with a. [Featherstone 2008, 2.31]"""
    return vectors.cross(a[0], b[0]), vectors.plus(vectors.cross(a[0], b[1]), vectors.cross(a[1], b[0]))


def force_cross(S, wrench):
    """S x* F: the rate of a wrench that is fixed in a frame moving with S. [Featherstone 2008, 2.32]"""
    tau, f = wrench[:3], wrench[3:]
    return *vectors.plus(vectors.cross(S[0], tau), vectors.cross(S[1], f)), *vectors.cross(S[0], f)


def scaled(s, motion):
    return tuple(vectors.times(s, x) for x in motion)


def skew(v):
    x, y, z = v
    zero = constant(x, 0)
    return (zero, -z, y), (z, zero, -x), (-y, x, zero)


def twice_crossed(a, b):
    """[a]x [b]x = b a^T - (a . b) 1, by its rows."""
    inner = vectors.dot(a, b)
    return tuple(tuple(y * x - inner if i == j else y * x for j, x in enumerate(a)) for i, y in enumerate(b))


def plus(m, n):
    """Of motions, or of matrices."""
    return tuple(vectors.plus(a, b) for a, b in zip(m, n, strict=True))


def minus(m, n):
    return tuple(vectors.minus(a, b) for a, b in zip(m, n, strict=True))
