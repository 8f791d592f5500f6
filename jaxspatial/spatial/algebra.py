"""The laws of spatial algebra over numbers, each once: what typed operations and dynamics are made of.

Vectors are tuples of three numbers, matrices tuples of their rows, a symmetric matrix six numbers (see `symmetric`).
A motion is a pair (w, v) or (alpha, a), a wrench a pair (tau, f), both about one point in one frame.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.numbers import Motion, Number, Rows, Symmetric, Three, Wrench, constant, noinline_pairs

M = TypeVar("M", bound=Rows)

# -- to another point -------------------------------------------------------------------------------------------------


def velocity_at(w: Three, v: Three, p: Three) -> Three:
    """v + w x p: of the point at p. [Jain 2010, 1.4]"""
    return vectors.plus(v, vectors.cross(w, p))


def acceleration_at(alpha: Three, a: Three, w: Three, p: Three) -> Three:
    """a + alpha x p + w x (w x p): the classical acceleration of the point at p. [Featherstone 2008, 2.11]"""
    return vectors.plus(a, vectors.cross(alpha, p), vectors.cross(w, vectors.cross(w, p)))


def torque_about(tau: Three, f: Three, p: Three) -> Three:
    """tau - p x f: about the point at p. [Jain 2010, 1.5]"""
    return vectors.minus(tau, vectors.cross(p, f))


# -- to another frame -------------------------------------------------------------------------------------------------


def act(rows: Rows, p: Three, x: Three, y: Three) -> tuple[Three, Three]:
    """(R x, R y + p x R x): a motion (x, y), or a wrench (y, x), from Bo in B to Ao in A. [Featherstone 2008, 2.8]"""
    turned = noinline_pairs(vectors.matrix_times)(rows, x)
    return turned, vectors.plus(vectors.matrix_times(rows, y), vectors.cross(p, turned))


def act_inverse(rows: Rows, p: Three, x: Three, y: Three) -> tuple[Three, Three]:
    """(R^T x, R^T (y - p x x)): back again."""
    back = vectors.transpose(rows)
    return vectors.matrix_times(back, x), vectors.matrix_times(back, vectors.minus(y, vectors.cross(p, x)))


def act_on_acceleration(rows: Rows, p: Three, w: Three, alpha: Three, a: Three) -> Motion:
    """(R alpha, R a + p x R alpha + R w x (p x R w)) of a classical acceleration."""
    turned, spin = vectors.matrix_times(rows, alpha), vectors.matrix_times(rows, w)
    tangential, centripetal = vectors.cross(p, turned), vectors.cross(spin, vectors.cross(p, spin))
    return turned, vectors.plus(vectors.matrix_times(rows, a), tangential, centripetal)


def act_inverse_on_acceleration(rows: Rows, p: Three, w: Three, alpha: Three, a: Three) -> Motion:
    """(R^T alpha, R^T (a + alpha x p + w x (w x p)))."""
    back = vectors.transpose(rows)
    return vectors.matrix_times(back, alpha), vectors.matrix_times(back, acceleration_at(alpha, a, w, p))


def sandwiched(m: Rows, rows: Rows) -> Rows:
    """R m R^T."""
    return vectors.matrix_product(rows, vectors.matrix_product(m, vectors.transpose(rows)))


def congruent(six: Symmetric, rows: Rows) -> Symmetric:
    """R S R^T of a symmetric matrix."""
    turned = vectors.matrix_product(rows, symmetric.rows(six))
    return tuple(vectors.dot(turned[i], rows[k]) for i in range(3) for k in range(i + 1))


# -- where motion meets motion and force ------------------------------------------------------------------------------


def motion_cross(V: Motion, X: Motion) -> Motion:
    """(w x x, w x y + v x x): how a motion (x, y) changes, carried by V. [Featherstone 2008, 2.31]"""
    (w, v), (x, y) = V, X
    return vectors.cross(w, x), vectors.plus(vectors.cross(w, y), vectors.cross(v, x))


def force_cross(V: Motion, F: Wrench) -> Wrench:
    """(w x tau + v x f, w x f): how a wrench changes, carried by V. [Featherstone 2008, 2.32]"""
    f, tau = motion_cross(V, (F[1], F[0]))
    return tau, f


def power(F: Wrench, V: Motion) -> Number:
    """tau . w + f . v."""
    return vectors.dot(F[0], V[0]) + vectors.dot(F[1], V[1])


# -- inertia ----------------------------------------------------------------------------------------------------------


def inertia_times(m: Number, c: Three, central: Symmetric, w: Three, v: Three) -> Wrench:
    """(I w + c x f, f = m (v + w x c)): the momentum of a motion, or the force of an acceleration. [Jain 2010, 2.1]"""
    f = vectors.times(m, velocity_at(w, v, c))
    return vectors.plus(vectors.matrix_times(symmetric.rows(central), w), vectors.cross(c, f)), f


def twice_kinetic_energy(
    m: Number, c: Three, central: Symmetric, w: Three, v: Three, half: Callable[[Number], Number] = lambda x: x
) -> Number:
    """m |v + w x c|^2 + w . I w; with `half` of a number one factor of each square is taken before it is squared.

    The mass is the last factor: m v may be beyond the largest number where v w, and with it m v w, is zero.
    """
    at_center = velocity_at(w, v, c)
    turning = vectors.dot(tuple(map(half, w)), vectors.matrix_times(symmetric.rows(central), w))
    return vectors.dot(tuple(map(half, at_center)), at_center) * m + turning


def parallel_axis(p: Three, q: Three) -> Symmetric:
    """(p . q) 1 - p q^T of parallel vectors, as six: of m c and c what a mass m at c adds. [Steiner 1840]"""
    products = [p[i] * q[j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return symmetric.trace_minus(products)


def newton_euler_torque(c: Three, central: Symmetric, alpha: Three, w: Three, h: Three, f: Three) -> Three:
    """I alpha + w x h + c x f, with h = I w the angular momentum about the centre of mass c, and f = m a_c the force
    that makes it accelerate. [Newton 1687; Euler 1776]"""
    turning = vectors.matrix_times(symmetric.rows(central), alpha)
    return vectors.plus(turning, vectors.cross(w, h), vectors.cross(c, f))


# -- pairs and matrices, row by row: motions, wrenches -----------------------------------------------------------------


def plus(m: M, n: M) -> M:
    found: Any = tuple(vectors.plus(a, b) for a, b in zip(m, n, strict=True))
    return found


def minus(m: M, n: M) -> M:
    found: Any = tuple(vectors.minus(a, b) for a, b in zip(m, n, strict=True))
    return found


def times(s: Number, m: Rows) -> Rows:
    return tuple(vectors.times(s, x) for x in m)


# -- matrices ---------------------------------------------------------------------------------------------------------


def skew(v: Three) -> Rows:
    """[v]x with [v]x y = v x y."""
    x, y, z = v
    zero = constant(x, 0)
    return (zero, -z, y), (z, zero, -x), (-y, x, zero)


def twice_crossed(a: Three, b: Three) -> Rows:
    """[a]x [b]x = b a^T - (a . b) 1."""
    inner = vectors.dot(a, b)
    return tuple(tuple(y * x - inner if i == j else y * x for j, x in enumerate(a)) for i, y in enumerate(b))


def of_moments(v: Three) -> Rows:
    """The matrix that gives I v of [Ixx, Ixy, Iyy, Ixz, Iyz, Izz]."""
    x, y, z = v
    zero = constant(x, 0)
    return (x, y, zero, z, zero, zero), (zero, x, y, zero, z, zero), (zero, zero, zero, x, y, z)
