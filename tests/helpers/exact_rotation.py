"""Rotations and rigid motions in 160 digits, from their definitions: of what cancels, 60 digits are left at 1e-30."""

import mpmath as mp
import numpy as np


def vector(x):
    """The numbers of an array, exactly."""
    return [mp.mpf(float(c)) for c in np.asarray(x).ravel()]


def cross_matrix(w):
    x, y, z = w
    return mp.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def length(w):
    return mp.sqrt(sum(c * c for c in w))


def _coefficients(t):
    """sin t / t, (1 - cos t) / t^2, (t - sin t) / t^3."""
    if t == 0:
        return mp.mpf(1), mp.mpf(1) / 2, mp.mpf(1) / 6
    return mp.sin(t) / t, (1 - mp.cos(t)) / t**2, (t - mp.sin(t)) / t**3


def exp(w):
    """3 x 3. [Rodrigues 1840]"""
    k, (a, b, _) = cross_matrix(w), _coefficients(length(w))
    return mp.eye(3) + a * k + b * k * k


def left_jacobian(w):
    k, (_, b, c) = cross_matrix(w), _coefficients(length(w))
    return mp.eye(3) + b * k + c * k * k


def translation(w, v):
    return left_jacobian(w) * mp.matrix(v)


def motion_jacobian(w, v):
    """6 x 6: the sum of ad^n / (n + 1)!, ad = [[w x, 0], [v x, w x]]."""
    ad = mp.zeros(6)
    ad[:3, :3] = ad[3:, 3:] = cross_matrix(w)
    ad[3:, :3] = cross_matrix(v)
    result, term, n = mp.eye(6), mp.eye(6), 1
    while n < 200 and mp.mnorm(term, "f") > mp.mpf(10) ** -80:
        n += 1
        term = term * ad / n
        result += term
    return result


def from_quaternion(q):
    n = length(q)
    w, x, y, z = (c / n for c in q)
    k = cross_matrix((x, y, z))
    return mp.eye(3) + 2 * w * k + 2 * k * k


def proportional_to_quaternion(entries):
    """Of 4 q q^T the row with the largest diagonal, its first number not negative; the matrix is taken as it is."""
    a, b, c, d, e, f, g, h, i = vector(entries)
    rows = [
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 + e - a - i, f + h],
        [d - b, c + g, f + h, 1 + i - a - e],
    ]
    k = max(range(4), key=lambda k: rows[k][k])
    return [-x for x in rows[k]] if rows[k][0] < 0 else rows[k]


def from_roll_pitch_yaw(roll, pitch, yaw):
    return exp((0, 0, yaw)) * exp((0, pitch, 0)) * exp((roll, 0, 0))


def differences(computed, exact):
    """computed - exact per item as floats: (n, k) of arrays (n, k) and n lists or matrices of k numbers."""
    computed = np.asarray(computed).reshape((len(exact), -1))
    rows = [
        [mp.mpf(float(c)) - e for c, e in zip(row, list(ref), strict=True)]
        for row, ref in zip(computed, exact, strict=True)
    ]
    return np.array(rows, float)


def directions(count, rng):
    """Unit vectors: random ones, then the axes and the diagonal."""
    d = np.concatenate((rng.standard_normal((count, 3)), np.eye(3), [[1, 1, 1], [0, 1, -1]]))
    return d / np.linalg.norm(d, axis=1)[:, None]


def first_derivatives(f, x):
    """The Jacobian of f, from a list of numbers to one, by central differences: 60 digits."""
    return np.array([_along(f, x, k) for k in range(len(x))], object).T


def _along(f, x, k):
    h = mp.mpf(10) ** -40
    return [(a - b) / (2 * h) for a, b in zip(f(_moved(x, (k, h))), f(_moved(x, (k, -h))), strict=True)]


def second_derivatives(f, x):
    """Of each number that f returns, (n, k, k)."""
    rows = [[_twice(f, x, i, j) for j in range(len(x))] for i in range(len(x))]
    return np.moveaxis(np.array(rows, object), -1, 0)


def _twice(f, x, i, j):
    h = mp.mpf(10) ** -30
    corners = [f(_moved(x, (i, a * h), (j, b * h))) for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    return [(a - b - c + d) / (4 * h * h) for a, b, c, d in zip(*corners, strict=True)]


def _moved(x, *steps):
    x = list(x)
    for k, h in steps:
        x[k] = x[k] + h
    return x
