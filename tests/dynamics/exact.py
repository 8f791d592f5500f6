"""Inverse dynamics of chains of revolute joints in 60 digits: Newton's and Euler's equations of every body, and what is
left at each joint of the forces beyond it."""

import mpmath as mp
import numpy as np


def _vector(x):
    return mp.matrix([mp.mpf(float(c)) for c in np.asarray(x).ravel()])


def _matrix(x):
    return mp.matrix(3, 3) + mp.matrix([[mp.mpf(float(c)) for c in row] for row in np.asarray(x).reshape(3, 3)])


def _cross(a, b):
    return mp.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def _about(k, angle):
    """k k^T + cos (1 - k k^T) + sin [k]x: for axes that are not quite of unit length as the library has it."""
    x, y, z = k
    kx = mp.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return k * k.T + mp.cos(angle) * (mp.eye(3) - k * k.T) + mp.sin(angle) * kx


def inverse_dynamics(mech, q, v, a):
    """tau of a chain, its numbers taken as they are: where rounding made rotations that are not quite, R^T stands for
    the inverse, as in the library."""
    with mp.workdps(60):
        w, alpha, acceleration = mp.zeros(3, 1), mp.zeros(3, 1), -_vector(mech.gravity)
        bodies = []
        for i in range(mech.nv):
            p, k = _vector(mech.placements.translation[i]), _vector(mech.axes[i])
            R = _matrix(mech.placements.rotation.entries[i]) * _about(k, mp.mpf(float(q[i])))
            acceleration = R.T * (acceleration + _cross(alpha, p) + _cross(w, _cross(w, p)))
            w, alpha = R.T * w, R.T * alpha
            rate = k * mp.mpf(float(v[i]))
            alpha = alpha + k * mp.mpf(float(a[i])) + _cross(w, rate)
            w = w + rate
            bodies.append((R, p, k, *_wrench(mech, i, w, alpha, acceleration)))
        return _felt(bodies)


def _wrench(mech, i, w, alpha, acceleration):
    """(tau, f) about the body's origin that make it move so."""
    xx, xy, yy, xz, yz, zz = (mp.mpf(float(x)) for x in mech.inertias.central[i])
    inertia = mp.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    c = _vector(mech.inertias.com[i])
    f = mp.mpf(float(mech.inertias.mass[i])) * (acceleration + _cross(alpha, c) + _cross(w, _cross(w, c)))
    return inertia * alpha + _cross(w, inertia * w) + _cross(c, f), f


def _felt(bodies):
    tau, f, found = mp.zeros(3, 1), mp.zeros(3, 1), []
    for R, p, k, torque, force in reversed(bodies):
        tau, f = tau + torque, f + force
        found.append(_dot(k, tau))
        f = R * f
        tau = R * tau + _cross(p, f)
    return found[::-1]
