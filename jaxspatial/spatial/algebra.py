"""The formulas of spatial algebra over numbers, each written once; typed operations and dynamics call them.

A `Motion` is a velocity (w, v) or an acceleration (alpha, a), a `Wrench` a force (tau, f) or a momentum (h, l), both
about one point in one frame. A `Pose` is X_AB, an `Inertia` that of a rigid body about a point.
"""

from collections.abc import Callable

from jaxspatial.numerics.linear import Inertia, Matrix, Motion, Pose, Symmetric, Vector, Wrench, congruence, cross, dot
from jaxspatial.numerics.numbers import Number

# -- about another point ----------------------------------------------------------------------------------------------


def shifted_motion(V: Motion, p: Vector) -> Motion:
    """The velocity of the point at p: (w, v + w x p). [Jain 2010, 1.4]"""
    return Motion(V.w, V.v + cross(V.w, p))


def shifted_acceleration(A: Motion, p: Vector, w: Vector) -> Motion:
    """The classical acceleration of the point at p: (alpha, a + alpha x p + w x (w x p)). [Featherstone 2008, 2.11]"""
    return Motion(A.w, A.v + cross(A.w, p) + cross(w, cross(w, p)))


def shifted_wrench(F: Wrench, p: Vector) -> Wrench:
    """The wrench about the point at p: (tau - p x f, f). [Jain 2010, 1.5]"""
    return Wrench(F.tau - cross(p, F.f), F.f)


# -- in another frame: from Bo in B to Ao in A, and back --------------------------------------------------------------


def composed(X_AB: Pose, X_BC: Pose) -> Pose:
    """X_AC = X_AB X_BC: (R_AB R_BC, p_AB + R_AB p_BC)."""
    p = X_AB.p + X_AB.R @ X_BC.p
    return Pose(X_AB.R @ X_BC.R, p)


def acted_motion(X: Pose, V: Motion) -> Motion:
    """A motion about Bo in B, as one about Ao in A: (R w, R v + p x R w). [Featherstone 2008, 2.8]"""
    w = X.R @ V.w
    return Motion(w, X.R @ V.v + cross(X.p, w))


def acted_wrench(X: Pose, F: Wrench) -> Wrench:
    """A wrench about Bo in B, as one about Ao in A: (R tau + p x R f, R f). [Featherstone 2008, 2.8]"""
    f = X.R @ F.f
    return Wrench(X.R @ F.tau + cross(X.p, f), f)


def acted_acceleration(X: Pose, A: Motion, w: Vector) -> Motion:
    """A classical acceleration of Bo in B, as one of Ao in A: (R alpha, R a + p x R alpha + R w x (p x R w))."""
    alpha, w = X.R @ A.w, X.R @ w
    return Motion(alpha, X.R @ A.v + cross(X.p, alpha) + cross(w, cross(X.p, w)))


def inverse_acted_motion(X: Pose, V: Motion) -> Motion:
    """A motion about Ao in A, as one about Bo in B: (R^T w, R^T (v - p x w))."""
    return Motion(X.R.T @ V.w, X.R.T @ (V.v - cross(X.p, V.w)))


def inverse_acted_wrench(X: Pose, F: Wrench) -> Wrench:
    """A wrench about Ao in A, as one about Bo in B: (R^T (tau - p x f), R^T f)."""
    return Wrench(X.R.T @ (F.tau - cross(X.p, F.f)), X.R.T @ F.f)


def inverse_acted_acceleration(X: Pose, A: Motion, w: Vector) -> Motion:
    """A classical acceleration of Ao in A, as one of Bo in B: (R^T alpha, R^T (a + alpha x p + w x (w x p)))."""
    alpha, a = shifted_acceleration(A, X.p, w)
    return Motion(X.R.T @ alpha, X.R.T @ a)


def acted_inertia(X: Pose, M: Inertia) -> Inertia:
    """An inertia about Bo in B, as one about Ao in A: the mass m at R c + p, with the central inertia R I R^T."""
    return Inertia(M.mass, X.p + X.R @ M.com, congruence(X.R, M.central))


def inverse_acted_inertia(X: Pose, M: Inertia) -> Inertia:
    """An inertia about Ao in A, as one about Bo in B: the mass m at R^T (c - p), with the central inertia R^T I R."""
    return Inertia(M.mass, X.R.T @ (M.com - X.p), congruence(X.R.T, M.central))


# -- where motion meets motion and force ------------------------------------------------------------------------------


def cross_motion(V: Motion, W: Motion) -> Motion:
    """The rate of a motion W fixed in a body with velocity V: (w x w2, w x v2 + v x w2). [Featherstone 2008, 2.31]"""
    return Motion(cross(V.w, W.w), cross(V.w, W.v) + cross(V.v, W.w))


def cross_force(V: Motion, F: Wrench) -> Wrench:
    """The rate of a wrench F fixed in a body with velocity V: (w x tau + v x f, w x f). [Featherstone 2008, 2.32]"""
    return Wrench(cross(V.w, F.tau) + cross(V.v, F.f), cross(V.w, F.f))


def power(F, V) -> Number:
    """The power of a wrench at a velocity: tau . w + f . v."""
    return dot(F[0], V[0]) + dot(F[1], V[1])


# -- inertia ----------------------------------------------------------------------------------------------------------


def apply_inertia(M: Inertia, V: Motion) -> Wrench:
    """The momentum of a velocity, or force of an acceleration: (I w + c x f, f = m (v + w x c)). [Jain 2010, 2.1]"""
    f = M.mass * (V.v + cross(V.w, M.com))
    return Wrench(M.central @ V.w + cross(M.com, f), f)


def twice_energy(M: Inertia, V: Motion, half: Callable[[Number], Number] = lambda x: x) -> Number:
    """Twice the kinetic energy: m |v + w x c|^2 + w . I w.

    The mass is the last factor, as m v may overflow where the square is zero.

    half: applied to one factor of each square, before it is squared.
    """
    v_c = V.v + cross(V.w, M.com)
    rotational = dot(tuple(map(half, V.w)), M.central @ V.w)
    return dot(tuple(map(half, v_c)), v_c) * M.mass + rotational


def point_inertia(p: Vector, q: Vector) -> Symmetric:
    """(p . q) 1 - p q^T, of parallel vectors. For q = m p it is the inertia of a point mass m at p. [Steiner 1840]"""
    (px, py, pz), (qx, qy, qz) = p, q
    return Symmetric(px * qx, px * qy, py * qy, px * qz, py * qz, pz * qz).trace_minus()


def euler_torque(M: Inertia, alpha: Vector, w: Vector, h: Vector, f: Vector) -> Vector:
    """The torque of Euler's equation about the origin: I alpha + w x h + c x f. [Newton 1687; Euler 1776]

    h = I w is the angular momentum about the centre of mass c, f = m a_c the force that accelerates it.
    """
    return M.central @ alpha + cross(w, h) + cross(M.com, f)


def double_cross(a: Vector, b: Vector) -> Matrix:
    """[a]x [b]x = b a^T - (a . b) 1."""
    inner = dot(a, b)
    return Matrix(*(Vector(*(y * x - inner if i == j else y * x for j, x in enumerate(a))) for i, y in enumerate(b)))
