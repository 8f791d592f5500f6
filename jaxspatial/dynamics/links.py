"""A body with the joint that carries it: what moves across the joint, and what a wrench on one side is on the other."""

from jaxspatial.arithmetic import vectors
from jaxspatial.dynamics.scene import Pose


def across(placement, hinge):
    """X_PB of a body in its parent."""
    X = hinge.transform
    p = vectors.plus(placement.p, vectors.matrix_times(placement.rows, X.p))
    return Pose(vectors.product(placement.rows, X.rows), p)


def swing(w, alpha):
    """E = [alpha]x + [w]x [w]x: points at r from the origin have the acceleration E r more than it."""
    x, y, z = w
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    i, j, k = alpha
    return (-(yy + zz), xy - k, xz + j), (xy + k, -(xx + zz), yz - i), (xz - j, yz + i, -(xx + yy))


def combined(S, rates):
    """S rates, as (w, v)."""
    w, v = ([motion[side] for motion in S] for side in (0, 1))
    return tuple(tuple(vectors.dot(rates, [x[i] for x in part]) for i in range(3)) for part in (w, v))


def to_parent(X_PB, tau, f):
    """The same wrench about the parent's origin, in its axes."""
    f = vectors.matrix_times(X_PB.rows, f)
    return vectors.plus(vectors.matrix_times(X_PB.rows, tau), vectors.cross(X_PB.p, f)), f
