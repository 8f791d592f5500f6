"""Exact references: the formulas of the library over rational numbers, and the size of their terms."""

from fractions import Fraction

import numpy as np

_exactly = np.frompyfunc(Fraction, 1, 1)


def rationals(x) -> np.ndarray:
    """Every number of x as the Fraction it is. For finite floating point of at most 64 bits."""
    x = np.asarray(x)
    return np.asarray(_exactly(x.astype(np.float64).astype(object)), dtype=object)


def cross(a, b):
    """a x b of object arrays (*batch, 3), with nothing rounded."""
    i, j = np.array([1, 2, 0]), np.array([2, 0, 1])
    return a[..., i] * b[..., j] - a[..., j] * b[..., i]


def cross_magnitude(a, b):
    """The sum of the absolute values of the terms of each component of a x b."""
    i, j = np.array([1, 2, 0]), np.array([2, 0, 1])
    return abs(a[..., i] * b[..., j]) + abs(a[..., j] * b[..., i])


def shift_force(tau, f, p):
    """(exact torque about Q, mag): tau - p x f, as arrays of Fractions."""
    tau, f, p = map(rationals, (tau, f, p))
    return tau - cross(p, f), abs(tau) + cross_magnitude(p, f)


def shift_velocity(w, v, p):
    """(exact velocity of Q, mag): v + w x p, as arrays of Fractions."""
    w, v, p = map(rationals, (w, v, p))
    return v + cross(w, p), abs(v) + cross_magnitude(w, p)


def shift_acceleration(alpha, a, p, w):
    """(exact acceleration of Q, mag): a + alpha x p + w x (w x p), as arrays of Fractions."""
    alpha, a, p, w = map(rationals, (alpha, a, p, w))
    exact = a + cross(alpha, p) + cross(w, cross(w, p))
    return exact, abs(a) + cross_magnitude(alpha, p) + cross_magnitude(abs(w), cross_magnitude(w, p))


def dot(tau, f, w, v):
    """(exact power, mag): tau . w + f . v, as arrays of Fractions."""
    terms = np.concatenate([rationals(tau) * rationals(w), rationals(f) * rationals(v)], axis=-1)
    return terms.sum(-1), abs(terms).sum(-1)
