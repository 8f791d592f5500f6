"""A body with the joint that carries it: motions across the joint, and wrenches transformed to the parent."""

from typing import Any, NamedTuple

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import noinline
from jaxspatial.dynamics.state import Pose
from jaxspatial.spatial import algebra


class Motion(NamedTuple):
    """Of a body's frame, in its axes: angular velocity and acceleration, and the classical acceleration of its origin.

    With gravity as an minus_gravity acceleration of the world. No linear velocity: nothing needs it.
    """

    w: Any
    alpha: Any
    a: Any


def world_motion(state):
    """The motion of the world, at rest, with gravity as an upward acceleration."""
    return Motion(state.no_vector, state.no_vector, minus_gravity(state))


def minus_gravity(state):
    """-g: the acceleration of the world that stands for gravity."""
    return tuple(-g for g in state.numbers(state.fields["gravity"]))


@noinline
def across(placement, joint):
    """X_PB of a body in its parent."""
    X = joint.transform
    p = vectors.plus(placement.p, vectors.matrix_times(placement.rows, X.p))
    return Pose(vectors.matrix_product(placement.rows, X.rows), p)


@noinline
def angular_acceleration_tensor(w, alpha):
    """E = [alpha]x + [w]x [w]x: points at r from the origin have the acceleration E r more than it."""
    x, y, z = w
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    i, j, k = alpha
    return (-(yy + zz), xy - k, xz + j), (xy + k, -(xx + zz), yz - i), (xz - j, yz + i, -(xx + yy))


def subspace_times(S, rates):
    """S rates, as (w, v)."""
    w, v = ([motion[side] for motion in S] for side in (0, 1))
    return tuple(tuple(vectors.dot(rates, [x[i] for x in part]) for i in range(3)) for part in (w, v))


def to_parent(X_PB, tau, f):
    """The same wrench about the parent's origin, in its axes."""
    return algebra.act(*X_PB, f, tau)[::-1]


def motion_step(link, parent):
    """`body_motion`, as a step outward."""
    motion = body_motion(link, parent)
    return motion, motion


def body_motion(link, parent):
    """The motion of a body, from that of its parent.

        w = R^T w_P + w_r    alpha = R^T alpha_P + (R^T w_P) x w_r + dw_r
        a = R^T (a_P + E_P p) + 2 (R^T w_P) x v_r + w_r x v_r + dv_r        E = [alpha]x + [w]x [w]x

    with (w_r, v_r) = S v the motion across the joint in the child's axes, (dw_r, dv_r) = S vdot + dS/dt v.
    """
    X_PB = across(link.placement, link.joint)
    R_BP = vectors.transpose(X_PB.rows)
    S, bias = link.joint.subspace, subspace_times(link.joint.subspace_rate(link.v), link.v)
    (w_r, v_r), (dw, dv) = subspace_times(S, link.v), subspace_times(S, link.vdot)
    w_P = noinline(vectors.matrix_times)(R_BP, parent.w)
    arm = vectors.plus(parent.a, vectors.matrix_times(angular_acceleration_tensor(parent.w, parent.alpha), X_PB.p))
    alpha = vectors.plus(vectors.matrix_times(R_BP, parent.alpha), vectors.cross(w_P, w_r), dw, bias[0])
    coriolis = vectors.cross(vectors.plus(w_P, w_P, w_r), v_r)
    return Motion(vectors.plus(w_P, w_r), alpha, vectors.plus(vectors.matrix_times(R_BP, arm), coriolis, dv, bias[1]))
