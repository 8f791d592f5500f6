"""A body with the joint that carries it: what moves across the joint, and what a wrench on one side is on the other."""

from typing import Any, NamedTuple

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import noinline
from jaxspatial.dynamics.state import Pose


class Motion(NamedTuple):
    """Of a body's frame, in its axes: angular velocity and acceleration, and the classical acceleration of its origin.

    With gravity as an upward acceleration of the world. No linear velocity: nothing needs it.
    """

    w: Any
    alpha: Any
    a: Any


def falling(state):
    """The motion of the world as bodies feel it: with gravity as an upward acceleration."""
    return Motion(state.no_vector, state.no_vector, upward(state))


def upward(state):
    """The acceleration that stands for gravity."""
    return tuple(-g for g in state.numbers(state.fields["gravity"]))


@noinline
def across(placement, joint):
    """X_PB of a body in its parent."""
    X = joint.transform
    p = vectors.plus(placement.p, vectors.matrix_times(placement.rows, X.p))
    return Pose(vectors.product(placement.rows, X.rows), p)


@noinline
def angular_acceleration_tensor(w, alpha):
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


def move(link, parent):
    """`moved`, as a step outward."""
    motion = moved(link, parent)
    return motion, motion


def moved(link, parent):
    """The motion of a body, of that of its parent.

        w = R^T w_P + w_r    alpha = R^T alpha_P + (R^T w_P) x w_r + dw_r
        a = R^T (a_P + E_P p) + 2 (R^T w_P) x v_r + w_r x v_r + dv_r        E = [alpha]x + [w]x [w]x

    with (w_r, v_r) = S v the motion across the joint in the child's axes, (dw_r, dv_r) = S vdot + dS/dt v.
    """
    X_PB = across(link.placement, link.joint)
    R_BP = vectors.transpose(X_PB.rows)
    S, bias = link.joint.subspace, combined(link.joint.subspace_rate(link.v), link.v)
    (w_r, v_r), (dw, dv) = combined(S, link.v), combined(S, link.vdot)
    carried = noinline(vectors.matrix_times)(R_BP, parent.w)
    arm = vectors.plus(parent.a, vectors.matrix_times(angular_acceleration_tensor(parent.w, parent.alpha), X_PB.p))
    alpha = vectors.plus(vectors.matrix_times(R_BP, parent.alpha), vectors.cross(carried, w_r), dw, bias[0])
    coriolis = vectors.cross(vectors.plus(carried, carried, w_r), v_r)
    return Motion(
        vectors.plus(carried, w_r), alpha, vectors.plus(vectors.matrix_times(R_BP, arm), coriolis, dv, bias[1])
    )
