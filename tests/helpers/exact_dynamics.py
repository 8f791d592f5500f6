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
        return recursion(mech, *([mp.mpf(float(x)) for x in y] for y in (q, v, a)), -_vector(mech.gravity))


def recursion(mech, q, v, a, acceleration):
    """Newton's and Euler's equations on a base with an acceleration."""
    w, alpha = mp.zeros(3, 1), mp.zeros(3, 1)
    bodies = []
    for i in range(mech.nv):
        p, k = _vector(mech.placements.translation[i]), _vector(mech.axes[i])
        R = _matrix(mech.placements.rotation.entries[i]) * _about(k, q[i])
        acceleration = R.T * (acceleration + _cross(alpha, p) + _cross(w, _cross(w, p)))
        w, alpha = R.T * w, R.T * alpha
        alpha = alpha + k * a[i] + _cross(w, k * v[i])
        w = w + k * v[i]
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


class Chain:
    """A chain of revolute joints in 60 digits, in world axes: for rotations that are exact, and axes of unit length."""

    def __init__(self, mech, q, v, a):
        self.mech, self.q, self.v, self.a = mech, *([mp.mpf(float(x)) for x in y] for y in (q, v, a))
        zero, R, p = mp.zeros(3, 1), mp.eye(3), mp.zeros(3, 1)
        state = zero, zero, zero, zero
        self.bodies, self.axes = [], []
        for i in range(mech.nv):
            R, p, k, state = self._next(i, R, p, state)
            self.axes.append((k, p))
            self.bodies.append((R, p, *state))

    def _next(self, i, R, p, state):
        """Of the next body: R, p, the axis, (w, v, alpha, a), a the acceleration of its origin."""
        w, v, alpha, a = state
        arm = R * _vector(self.mech.placements.translation[i])
        a = a + _cross(alpha, arm) + _cross(w, _cross(w, arm))
        v, p = v + _cross(w, arm), p + arm
        axis = _vector(self.mech.axes[i])
        R = R * _matrix(self.mech.placements.rotation.entries[i])
        k, R = R * axis, R * _about(axis, self.q[i])
        alpha = alpha + k * self.a[i] + _cross(w, k * self.v[i])
        return R, p, k, (w + k * self.v[i], v, alpha, a)

    def poses(self):
        return [x for R, *_ in self.bodies for x in R], [x for _, p, *_ in self.bodies for x in p]

    def velocities(self):
        return [x for *_, w, v, _, _ in self.bodies for x in (*w, *v)]

    def accelerations(self):
        return [x for *_, alpha, a in self.bodies for x in (*alpha, *a)]

    def jacobian(self, i):
        """Of the origin of body i, by rows."""
        zero = mp.zeros(3, 1)
        arms = [self.bodies[i][1] - p for _, p in self.axes]
        columns = [
            (k, _cross(k, arm)) if j <= i else (zero, zero)
            for j, ((k, _), arm) in enumerate(zip(self.axes, arms, strict=True))
        ]
        return [column[side][row] for side in (0, 1) for row in range(3) for column in columns]

    def masses(self):
        """(m, the centre of mass in the world, its velocity, the inertia about it) of every body."""
        found = []
        for i, (R, p, w, v, *_) in enumerate(self.bodies):
            arm = R * _vector(self.mech.inertias.com[i])
            found.append(
                (mp.mpf(float(self.mech.inertias.mass[i])), p + arm, v + _cross(w, arm), R * self._central(i) * R.T)
            )
        return found

    def _central(self, i):
        xx, xy, yy, xz, yz, zz = (mp.mpf(float(x)) for x in self.mech.inertias.central[i])
        return mp.matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def center(self):
        """(the mass, the centre of mass, its velocity)."""
        masses = self.masses()
        m = sum(x[0] for x in masses)
        return m, *(sum((x[0] * x[k] for x in masses), mp.zeros(3, 1)) / m for k in (1, 2))

    def energies(self):
        both = list(zip(self.masses(), self.bodies, strict=True))
        kinetic = sum(m * _dot(v, v) + _dot(b[2], inertia * b[2]) for (m, _, v, inertia), b in both) / 2
        return kinetic, -sum(m * _dot(_vector(self.mech.gravity), c) for (m, c, *_), _ in both)

    def momentum(self):
        _, center, _ = self.center()
        angular, linear = mp.zeros(3, 1), mp.zeros(3, 1)
        for (m, c, v, inertia), (_, _, w, *_) in zip(self.masses(), self.bodies, strict=True):
            angular, linear = angular + inertia * w + _cross(c - center, m * v), linear + m * v
        return [*angular, *linear]

    def inverse_dynamics(self, q=None, v=None, a=None, gravity=1):
        base = -gravity * _vector(self.mech.gravity)
        return recursion(self.mech, q or self.q, v or self.v, a or self.a, base)

    def mass_matrix(self):
        n = len(self.q)
        rows = [self.inverse_dynamics(v=[0] * n, a=[int(i == k) for i in range(n)], gravity=0) for k in range(n)]
        return [x for row in rows for x in row]

    def forward_dynamics(self):
        """The accelerations under the forces that stand in the place of accelerations."""
        n, entries = len(self.q), self.mass_matrix()
        M = mp.matrix([entries[i * n : i * n + n] for i in range(n)])
        bias = self.inverse_dynamics(a=[0] * n)
        return list(mp.lu_solve(M, mp.matrix([x - y for x, y in zip(self.a, bias, strict=True)])))

    def derivative(self, of):
        """Of the torques, with respect to q or v, by rows: differences, with a step that 60 digits bear."""
        x, h, n = list(getattr(self, of)), mp.mpf(10) ** -20, len(self.q)
        columns = []
        for k in range(n):
            ends = [
                self.inverse_dynamics(**{of: [y + s * h if i == k else y for i, y in enumerate(x)]}) for s in (1, -1)
            ]
            columns.append([(p - m) / (2 * h) for p, m in zip(*ends, strict=True)])
        return [columns[k][i] for i in range(n) for k in range(n)]
