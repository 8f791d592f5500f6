"""A body with the joint that carries it: motions across the joint, and wrenches transformed to the parent."""

from collections.abc import Sequence
from typing import NamedTuple

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Motion, Numbers, Rows, Three, Wrench, noinline, noinline_pairs
from jaxspatial.dynamics.state import JointState, Link, MechanismState, Pose
from jaxspatial.spatial import algebra


class BodyMotion(NamedTuple):
    """Of a body's frame, in its axes: angular velocity and acceleration, and the classical acceleration of its origin.

    With gravity as an upward acceleration of the world. No linear velocity: nothing needs it.
    """

    w: Three
    alpha: Three
    a: Three


def world_motion(state: MechanismState):
    """The motion of the world, at rest, with gravity as an upward acceleration."""
    return BodyMotion(state.no_vector, state.no_vector, minus_gravity(state))


def minus_gravity(state: MechanismState):
    """-g: the acceleration of the world that stands for gravity."""
    return tuple(-g for g in state.numbers(state.fields["gravity"]))


@noinline
def across(placement: Pose, joint: JointState):
    """X_PB of a body in its parent."""
    X = joint.transform
    p = vectors.plus(placement.p, vectors.matrix_times(placement.rows, X.p))
    return Pose(vectors.matrix_product(placement.rows, X.rows), p)


@noinline
def angular_acceleration_tensor(w: Three, alpha: Three) -> Rows:
    """E = [alpha]x + [w]x [w]x: points at r from the origin have the acceleration E r more than it."""
    x, y, z = w
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    i, j, k = alpha
    return (-(yy + zz), xy - k, xz + j), (xy + k, -(xx + zz), yz - i), (xz - j, yz + i, -(xx + yy))


def acceleration_at(motion: BodyMotion, p: Three) -> Three:
    """The acceleration of the point at p from a body's origin, by the tensor E that its other points share."""
    return vectors.plus(motion.a, vectors.matrix_times(angular_acceleration_tensor(motion.w, motion.alpha), p))


def subspace_times(S: Sequence[Motion], rates: Numbers) -> Motion:
    """S rates, as (w, v)."""
    w, v = (tuple(vectors.dot(rates, [motion[side][i] for motion in S]) for i in range(3)) for side in (0, 1))
    return w, v


def to_parent(X_PB: Pose, tau: Three, f: Three) -> Wrench:
    """The same wrench about the parent's origin, in its axes."""
    f, tau = algebra.act(*X_PB, f, tau)
    return tau, f


def motion_step(link: Link, parent: BodyMotion):
    """`body_motion`, as a step outward."""
    motion = body_motion(link, parent)
    return motion, motion


def body_motion(link: Link, parent: BodyMotion):
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
    arm = noinline_pairs(acceleration_at)(parent, X_PB.p)
    alpha = vectors.plus(vectors.matrix_times(R_BP, parent.alpha), vectors.cross(w_P, w_r), dw, bias[0])
    coriolis = vectors.cross(vectors.plus(w_P, w_P, w_r), v_r)
    return BodyMotion(
        vectors.plus(w_P, w_r), alpha, vectors.plus(vectors.matrix_times(R_BP, arm), coriolis, dv, bias[1])
    )
