"""Naive formulas of the operations that are sums of products, over the arrays that their arguments consist of.

They run over numbers of any kind: over NumPy floats, rounded operation by operation, they give the bits to expect; over
fractions the exact value; over `Sized` fractions also mag, in units of which the docstrings promise their bounds; over
`duals.Dual` derivatives of all these. Those of the operations that are measured stand in `jaxspatial.measure`.
"""

import numpy as np


def _sum_of_three(x):
    return (x[..., 0] + x[..., 1]) + x[..., 2]


def sum_of_points(x):
    return ((x[..., 0, :] + x[..., 4, :]) + x[..., 2, :]) + (x[..., 1, :] + x[..., 3, :])


def three_by_three(entries):
    return entries.reshape((*entries.shape[:-1], 3, 3))


def _columns(entries):
    return np.swapaxes(three_by_three(entries), -1, -2)


def _turned(rows, v):
    return _sum_of_three(rows * v[..., None, :])


def rotated(entries, tau, f):
    return tuple(_turned(three_by_three(entries), part) for part in (tau, f))


def product(left, right):
    entries = _sum_of_three(three_by_three(left)[..., :, None, :] * _columns(right)[..., None, :, :])
    return entries.reshape((*entries.shape[:-2], 9))


def transformed(entries, p, q):
    return (p + _turned(three_by_three(entries), q),)


def transforms(entries, p, entries2, p2):
    return product(entries, entries2), *transformed(entries, p, p2)


def inverse_times(entries, p, entries2, p2):
    inverse = _columns(entries).reshape(entries.shape)
    return product(inverse, entries2), _turned(_columns(entries), p2 - p)


def moved(entries, p, x, y):
    new = _turned(three_by_three(entries), x)
    return new, _turned(three_by_three(entries), y) + np.cross(p, new)


def moved_back(entries, p, x, y):
    return _turned(_columns(entries), x), _turned(_columns(entries), y - np.cross(p, x))


def moved_acceleration(entries, p, alpha, a, w):
    new, spin = (_turned(three_by_three(entries), x) for x in (alpha, w))
    moved = _turned(three_by_three(entries), a) + np.cross(p, new)
    return new, moved + np.cross(spin, np.cross(p, spin))


def acceleration_moved_back(entries, p, alpha, a, w):
    moved = (a + np.cross(alpha, p)) + np.cross(w, np.cross(w, p))
    return _turned(_columns(entries), alpha), _turned(_columns(entries), moved)


def composed_velocity(w, v, p, w2, v2):
    return w + w2, (v + np.cross(w, p)) + v2


def composed_acceleration(alpha, a, p, w, w2, v2, alpha2, a2):
    coriolis = np.cross(w, v2)
    moved = (a + np.cross(alpha, p)) + np.cross(w, np.cross(w, p))
    return (alpha + alpha2) + np.cross(w, w2), (moved + (coriolis + coriolis)) + a2


_SYMMETRIC = np.array([0, 1, 3, 1, 2, 4, 3, 4, 5])


def _turned_six(rows, six):
    """R S R^T by its six entries."""
    half = _sum_of_three(three_by_three(six[..., _SYMMETRIC])[..., None, :, :] * rows[..., :, None, :])
    full = _sum_of_three(half[..., :, None, :] * rows[..., None, :, :])
    return np.stack([full[..., i, j] for i in range(3) for j in range(i + 1)], -1)


def rotated_inertia(entries, mass, com, central):
    return mass, _turned(three_by_three(entries), com), _turned_six(three_by_three(entries), central)


def acted_inertia(entries, p, mass, com, central):
    return mass, p + _turned(three_by_three(entries), com), _turned_six(three_by_three(entries), central)


def inertia_acted_back(entries, p, mass, com, central):
    return mass, _turned(_columns(entries), com - p), _turned_six(_columns(entries), central)


def applied(mass, com, central, alpha, a):
    f = mass[..., None] * (a + np.cross(alpha, com))
    return _turned(three_by_three(central[..., _SYMMETRIC]), alpha) + np.cross(com, f), f


def twice_energy(mass, com, central, w, v):
    moved = v + np.cross(w, com)
    spinning = _sum_of_three(w * _turned(three_by_three(central[..., _SYMMETRIC]), w))
    return (mass * _sum_of_three(moved * moved) + spinning,)


def _first_moment(mass, com):
    return mass[..., None] * com


def steiner(mass, com):
    """m (|c|^2 1 - c c^T) by its six entries."""
    p = _first_moment(mass, com)
    xx, yy, zz = (p[..., i] * com[..., i] for i in range(3))
    xy, xz, yz = (p[..., i] * com[..., j] for i, j in ((0, 1), (0, 2), (1, 2)))
    return np.stack([yy + zz, -xy, xx + zz, -xz, -yz, xx + yy], -1)


def about_origin(mass, com, central):
    return central + steiner(mass, com)


def _skew(v):
    zero, (x, y, z) = v[..., 0] - v[..., 0], (v[..., i] for i in range(3))
    return _matrix([[zero, -z, y], [z, zero, -x], [-y, x, zero]])


def _matrix(rows):
    return np.stack([np.stack(row, -1) for row in rows], -2)


def _times_one(m):
    zero = m - m
    return _matrix([[m if i == j else zero for j in range(3)] for i in range(3)])


def _blocks(a, b, c, d):
    return np.concatenate([np.concatenate(row, -1) for row in ((a, b), (c, d))], -2)


def moments_about_origin(mass, com, central):
    return (three_by_three(about_origin(mass, com, central)[..., _SYMMETRIC]),)


def six_by_six(mass, com, central):
    arm = _skew(_first_moment(mass, com))
    (inertia,) = moments_about_origin(mass, com, central)
    return (_blocks(inertia, arm, np.swapaxes(arm, -1, -2), _times_one(mass)),)


def dynamic_parameters(mass, com, central):
    parts = mass[..., None], _first_moment(mass, com), about_origin(mass, com, central)
    return (np.concatenate(parts, -1),)


def twice_pseudo_inertia(mass, com, central):
    p = _first_moment(mass, com)
    xx, xy, yy, xz, yz, zz = (central[..., i] for i in range(6))

    def diagonal(i, a, b, minus):
        square = p[..., i] * com[..., i]
        return ((a + b) - minus) + (square + square)

    def product(i, j, entry):
        half = p[..., i] * com[..., j] - entry
        return half + half

    a, b, c = diagonal(0, yy, zz, xx), diagonal(1, xx, zz, yy), diagonal(2, xx, yy, zz)
    d, e, f = product(0, 1, xy), product(0, 2, xz), product(1, 2, yz)
    x, y, z = (p[..., i] + p[..., i] for i in range(3))
    return (_matrix([[a, d, e, x], [d, b, f, y], [e, f, c, z], [x, y, z, mass + mass]]),)


def motion_matrix(entries, p):
    rows = three_by_three(entries)
    moved = np.swapaxes(np.cross(p[..., None, :], np.swapaxes(rows, -1, -2)), -1, -2)
    return (_blocks(rows, rows - rows, moved, rows),)


def inverse(entries, p):
    return _columns(entries).reshape(entries.shape), -_turned(_columns(entries), p)


def articulated(mass, com, central):
    arm = _skew(_first_moment(mass, com))
    m = _times_one(mass)
    lower = np.stack([m[..., i, j] for i in range(3) for j in range(i + 1)], -1)
    return about_origin(mass, com, central), arm.reshape((*arm.shape[:-2], 9)), lower


def articulated_times(j, f, m, alpha, a):
    J, F, M = three_by_three(j[..., _SYMMETRIC]), three_by_three(f), three_by_three(m[..., _SYMMETRIC])
    return _turned(J, alpha) + _turned(F, a), _turned(np.swapaxes(F, -1, -2), alpha) + _turned(M, a)


def articulated_shifted(j, f, m, p):
    F, M, arm = three_by_three(f), three_by_three(m[..., _SYMMETRIC]), p[..., None, :]
    new = F - np.swapaxes(np.cross(arm, M), -1, -2)
    before, after = np.cross(F, arm), np.cross(new, arm)
    added = [before[..., k, i] + after[..., i, k] for i in range(3) for k in range(i + 1)]
    return j + np.stack(added, -1), new.reshape((*new.shape[:-2], 9)), m


def regressor(alpha, a, w):
    """Rows of m, of m c, of the moments."""
    alpha, a, w = np.broadcast_arrays(alpha, a, w)
    torque = _moments(alpha) + np.cross(w[..., None, :], np.swapaxes(_moments(w), -1, -2)).swapaxes(-1, -2)
    force = _skew(alpha) + np.cross(w[..., None, :], np.swapaxes(_skew(w), -1, -2)).swapaxes(-1, -2)
    nothing = a[..., None] - a[..., None]
    none = torque - torque
    return (_blocks_of_ten((nothing, -_skew(a), torque), (a[..., None], force, none)),)


def _blocks_of_ten(top, bottom):
    return np.concatenate([np.concatenate(row, -1) for row in (top, bottom)], -2)


def _moments(x):
    """The matrix that gives I x of the six moments."""
    zero, (x, y, z) = x[..., 0] - x[..., 0], (x[..., i] for i in range(3))
    return _matrix([[x, y, zero, z, zero, zero], [zero, x, y, zero, z, zero], [zero, zero, zero, x, y, z]])


def swapped(formula):
    """Of a force, whose translational part is what turns the other."""
    return lambda entries, p, tau, f: formula(entries, p, f, tau)[::-1]


def twice(*parts):
    return tuple(np.stack((part, part), -2) for part in parts)


def wrench(points, forces):
    return sum_of_points(np.cross(points, forces)), sum_of_points(forces)


def axis(tau, f):
    squared = _sum_of_three(f * f)
    return _sum_of_three(f * tau) / squared, np.cross(f, tau) / squared[..., None]


def pressed(tau, f, normal):
    return (np.cross(normal, tau) / _sum_of_three(normal * f)[..., None],)


def differences(x, y, x2, y2):
    return np.abs(x - x2).max(-1), np.abs(y - y2).max(-1)


def near(rotational_tolerance, translational_tolerance, *parts):
    rotational, translational = differences(*parts)
    return ((rotational <= rotational_tolerance) & (translational <= translational_tolerance),)


def scaled_force(tau, f, s):
    return tau * s[..., None], f * s[..., None]
