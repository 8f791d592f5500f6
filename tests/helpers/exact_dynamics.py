"""Chains of revolute joints in 60 digits: Newton's and Euler's equations of every body, and what is left at each joint
of the forces beyond it. Every number knows how large it would be if no terms cancelled."""

import functools

import mpmath as mp
import numpy as np

DIGITS = 60


class Sized:
    """A number, a vector or a matrix, and its size: of what is given its absolute value or 2-norm, of a sum the sum, of
    a product the product. A rotation has the size 1."""

    def __init__(self, value, size):
        self.value, self.size = value, size

    def __neg__(self):
        return Sized(-self.value, self.size)

    def __add__(self, other):
        return Sized(self.value + other.value, self.size + other.size)

    def __sub__(self, other):
        return Sized(self.value - other.value, self.size + other.size)

    def __mul__(self, number):
        return Sized(self.value * number.value, self.size * number.size)

    def __truediv__(self, number):
        return Sized(self.value / number.value, self.size / abs(number.value))

    def __matmul__(self, other):
        return Sized(self.value @ other.value, self.size * other.size)

    @property
    def T(self):
        return Sized(self.value.T, self.size)

    def numbers(self):
        """Each with the size of all."""
        return [Sized(x, self.size) for x in np.ravel(self.value)]


def values(numbers):
    return [x.value for x in numbers]


def number(x):
    x = mp.mpf(float(x))
    return Sized(x, abs(x))


def angle(x):
    """Of the size of its rotation."""
    return Sized(mp.mpf(float(x)), mp.mpf(1))


def array(x, size=None):
    """A vector, or a matrix."""
    x = np.asarray(x, float)
    return Sized(
        np.vectorize(mp.mpf, otypes=[object])(x), mp.mpf(float(np.linalg.norm(x, 2))) if size is None else size
    )


def zero():
    return array(np.zeros(3))


def cross(a, b):
    (a1, a2, a3), (b1, b2, b3) = a.value, b.value
    return Sized(np.array([a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1], object), a.size * b.size)


def about(k, q):
    """k k^T + cos (1 - k k^T) + sin [k]x: for axes that are not quite of unit length as the library has it."""
    x, y, z = k.value
    kx, kk = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], object), np.outer(k.value, k.value)
    return Sized(kk + mp.cos(q.value) * (np.eye(3, dtype=int) - kk) + mp.sin(q.value) * kx, q.size)


class Body:
    """The numbers of a body of a chain and of its joint, as they are."""

    def __init__(self, mech, i):
        xx, xy, yy, xz, yz, zz = mech.inertias.central[i]
        self.p, self.k = array(mech.placements.translation[i]), array(mech.axes[i])
        self.R = array(np.asarray(mech.placements.rotation.entries[i]).reshape(3, 3), mp.mpf(1))
        self.mass, self.com = number(mech.inertias.mass[i]), array(mech.inertias.com[i])
        self.central = array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def wrench(self, w, alpha, a):
        """(tau, f) about the body's origin that make it move so."""
        f = (a + cross(alpha, self.com) + cross(w, cross(w, self.com))) * self.mass
        return self.central @ alpha + cross(w, self.central @ w) + cross(self.com, f), f


def inverse_dynamics(mech, q, v, a):
    """tau of a chain, its numbers taken as they are: where rounding made rotations that are not quite, R^T stands for
    the inverse, as in the library."""
    with mp.workdps(DIGITS):
        return values(Chain(mech, q, v, a).inverse_dynamics())


class Chain:
    """A chain of revolute joints. In world axes for rotations that are exact, and axes of unit length."""

    def __init__(self, mech, q, v, a):
        self.bodies, self.gravity = [Body(mech, i) for i in range(mech.nv)], array(mech.gravity)
        self.q = [angle(x) for x in q]
        self.v, self.a = ([number(x) for x in y] for y in (v, a))

    def at(self, **coordinates):
        """The same chain elsewhere."""
        other = object.__new__(Chain)
        own = {name: vars(self)[name] for name in ("bodies", "gravity", "q", "v", "a")}
        vars(other).update(own | coordinates)
        return other

    def unit(self, k):
        return [number(i == k) for i in range(len(self.q))]

    @property
    def nothing(self):
        return self.unit(-1)

    # -- in the axes of the bodies ------------------------------------------------------------------------------------

    def motions(self, base):
        """(R, w, alpha, a) of every body, a of its origin, on a base with an acceleration."""
        (w, alpha, a), found = (zero(), zero(), base), []
        for body, q, v, vdot in zip(self.bodies, self.q, self.v, self.a, strict=True):
            R, k = body.R @ about(body.k, q), body.k
            a = R.T @ (a + cross(alpha, body.p) + cross(w, cross(w, body.p)))
            w, alpha = R.T @ w, R.T @ alpha
            alpha = alpha + k * vdot + cross(w, k * v)
            w = w + k * v
            found.append((R, w, alpha, a))
        return found

    def inverse_dynamics(self, gravity=1):
        motions = self.motions(-self.gravity * number(gravity))
        return self.at_joints(motions, [body.wrench(*x[1:]) for body, x in zip(self.bodies, motions, strict=True)])

    def at_joints(self, motions, wrenches):
        """The forces at the joints of wrenches on bodies."""
        through = self.through_joints(motions, wrenches)
        return [body.k @ tau for body, (tau, _) in zip(self.bodies, through, strict=True)]

    def through_joints(self, motions, wrenches):
        """(tau, f) of the whole wrenches, about the origins of the bodies, in their axes."""
        (tau, f), found = (zero(), zero()), []
        for body, (R, *_), (torque, force) in zip(*map(reversed, (self.bodies, motions, wrenches)), strict=True):
            tau, f = tau + torque, f + force
            found.append((tau, f))
            f = R @ f
            tau = R @ tau + cross(body.p, f)
        return found[::-1]

    def joint_reactions(self):
        motions = self.motions(-self.gravity)
        wrenches = [body.wrench(*x[1:]) for body, x in zip(self.bodies, motions, strict=True)]
        return [x for tau, f in self.through_joints(motions, wrenches) for x in (*tau.numbers(), *f.numbers())]

    def applied_wrench(self, i, tau, f, p, axes="frame"):
        """About the origin of body i, in world axes, of a wrench (tau, f) at p on it, in its axes or the world's."""
        R, *_ = self.placed[i]
        tau, f, p = array(tau), array(f), R @ array(p)
        if axes == "frame":
            tau, f = R @ tau, R @ f
        return [*(tau + cross(p, f)).numbers(), *f.numbers()]

    def applied_wrenches(self, i, tau, f, p, axes):
        """The sum of k of these, of (k, 3) each."""
        each = [self.applied_wrench(i, *one, axes) for one in zip(tau, f, p, strict=True)]
        return [_sum(terms) for terms in zip(*each, strict=True)]

    def bias_forces(self):
        return self.at(a=self.nothing).inverse_dynamics()

    def gravity_forces(self):
        return self.at(v=self.nothing, a=self.nothing).inverse_dynamics()

    def mass_matrix(self):
        n = range(len(self.q))
        return [x for k in n for x in self.at(v=self.nothing, a=self.unit(k)).inverse_dynamics(gravity=0)]

    def solved(self, forces):
        """M^-1 of forces; of the size of all its terms."""
        n = len(self.q)
        inverse = np.reshape(
            (mp.matrix(np.reshape(values(self.mass_matrix()), (n, n)).tolist()) ** -1).tolist(), (n, n)
        )
        sizes = abs(inverse) @ np.array([x.size for x in forces])
        return [Sized(*x) for x in zip(inverse @ np.array(values(forces)), sizes, strict=True)]

    def forward_dynamics(self):
        """The accelerations under the forces that stand in the place of accelerations."""
        return self.solved([x - y for x, y in zip(self.a, self.bias_forces(), strict=True)])

    def regressor(self):
        """The forces of units of all ten parameters of all bodies, by rows."""
        motions, none = self.motions(-self.gravity), (zero(), zero())
        columns = [
            self.at_joints(motions, [wrench if j == i else none for j in range(len(motions))])
            for i, (_, *motion) in enumerate(motions)
            for wrench in self._of_parameters(*motion)
        ]
        return [column[i] for i in range(len(self.q)) for column in columns]

    @staticmethod
    def _of_parameters(w, alpha, a):
        """Of a unit of mass, of the first moments, of the entries xx, xy, yy, xz, yz, zz about the body's origin."""
        yield zero(), a
        for e in np.eye(3):
            e = array(e)
            yield cross(e, a), cross(alpha, e) + cross(w, cross(w, e))
        for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)):
            J = np.zeros((3, 3))
            J[i, j] = J[j, i] = 1
            J = array(J)
            yield J @ alpha + cross(w, J @ w), zero()

    def momentum_and_beta(self):
        """(p, beta) of `MomentumObserver`, from the momentum and the weight of all that a joint carries."""
        (w, v), g, found = (zero(), zero()), -self.gravity, []
        for body, q, rate in zip(self.bodies, self.q, self.v, strict=True):
            R = body.R @ about(body.k, q)
            v, g = R.T @ (v + cross(w, body.p)), R.T @ g
            w = R.T @ w + body.k * rate
            l = (v + cross(w, body.com)) * body.mass  # noqa: E741
            found.append((R, w, v, body.central @ w + cross(body.com, l), l, g * body.mass))
        (h, l, tau, f), momenta, betas = (zero(),) * 4, [], []  # noqa: E741
        for body, (R, w, v, h_own, l_own, weight) in zip(reversed(self.bodies), reversed(found), strict=True):
            h, l, tau, f = h + h_own, l + l_own, tau + cross(body.com, weight), f + weight  # noqa: E741
            momenta.append(body.k @ h)
            betas.append(body.k @ (tau + cross(w, h) + cross(v, l)))
            l, f = R @ l, R @ f  # noqa: E741
            h, tau = R @ h + cross(body.p, l), R @ tau + cross(body.p, f)
        return momenta[::-1], betas[::-1]

    def momentum_rate(self):
        """dM/dt v."""
        return self.along("q", self.v, lambda chain: chain.at(a=self.v, v=self.nothing).inverse_dynamics(gravity=0))

    # -- in world axes ------------------------------------------------------------------------------------------------

    @functools.cached_property
    def placed(self):
        """(R, p, k, w, v, alpha, a) of every body, k of its axis, v and a of its origin."""
        (p, w, v, alpha, a), R, found = [zero()] * 5, array(np.eye(3), mp.mpf(1)), []
        for body, q, rate, vdot in zip(self.bodies, self.q, self.v, self.a, strict=True):
            arm = R @ body.p
            a = a + cross(alpha, arm) + cross(w, cross(w, arm))
            v, p = v + cross(w, arm), p + arm
            R = R @ body.R
            k, R = R @ body.k, R @ about(body.k, q)
            alpha = alpha + k * vdot + cross(w, k * rate)
            w = w + k * rate
            found.append((R, p, k, w, v, alpha, a))
        return found

    def rotations(self):
        return [x for R, *_ in self.placed for x in R.numbers()]

    def positions(self):
        return [x for _, p, *_ in self.placed for x in p.numbers()]

    def velocities(self):
        return [x for *_, w, v, _, _ in self.placed for x in (*w.numbers(), *v.numbers())]

    def accelerations(self):
        return [x for *_, alpha, a in self.placed for x in (*alpha.numbers(), *a.numbers())]

    def jacobian(self, i):
        """Of the origin of body i, by rows."""
        p_F, columns = self.placed[i][1], []
        for j, (_, p, k, *_) in enumerate(self.placed):
            columns.append((k, cross(k, p_F - p)) if j <= i else (zero(), zero()))
        return _rows([(*w.numbers(), *v.numbers()) for w, v in columns])

    def masses(self):
        """(m, the centre of mass in the world, its velocity, the inertia about it, w) of every body."""
        found = []
        for body, (R, p, _, w, v, *_) in zip(self.bodies, self.placed, strict=True):
            arm = R @ body.com
            found.append((body.mass, p + arm, v + cross(w, arm), R @ body.central @ R.T, w))
        return found

    def center(self):
        """(the centre of mass, its velocity)."""
        masses = self.masses()
        total = _sum(x[0] for x in masses)
        return tuple(_sum(x[k] * x[0] for x in masses) / total for k in (1, 2))

    def kinetic_energy(self):
        return [_sum((v @ v) * m + w @ (inertia @ w) for m, _, v, inertia, w in self.masses()) * number(0.5)]

    def potential_energy(self):
        return [-_sum((self.gravity @ c) * m for m, c, *_ in self.masses())]

    def momentum(self):
        center, _ = self.center()
        angular = _sum(inertia @ w + cross(c - center, v * m) for m, c, v, inertia, w in self.masses())
        return [*angular.numbers(), *_sum(v * m for m, _, v, *_ in self.masses()).numbers()]

    def momentum_matrix(self):
        return _rows([self.at(v=self.unit(k)).momentum() for k in range(len(self.q))])

    def center_jacobian(self):
        return _rows([self.at(v=self.unit(k)).center()[1].numbers() for k in range(len(self.q))])

    # -- derivatives --------------------------------------------------------------------------------------------------

    def along(self, name, rates, function):
        """The derivative of numbers by coordinates, along rates: differences, with a step that 60 digits bear. Of sizes
        too, which are polynomials of those of the coordinates: what no terms of the derivative cancel in."""
        h = mp.mpf(10) ** (-DIGITS // 3)
        plus, minus = (
            function(self.at(**{name: [_moved(x, s * h, r) for x, r in zip(vars(self)[name], rates, strict=True)]}))
            for s in (1, -1)
        )
        return [
            Sized((a.value - b.value) / (2 * h), (a.size - b.size) / (2 * h)) for a, b in zip(plus, minus, strict=True)
        ]

    def jacobian_rate(self, i):
        return self.along("q", self.v, lambda chain: chain.jacobian(i))

    def derivative(self, name):
        """Of the torques, with respect to q or v, by rows."""
        return _rows([self.along(name, self.unit(k), Chain.inverse_dynamics) for k in range(len(self.q))])


def _moved(x, h, rate):
    return Sized(x.value + h * rate.value, x.size + h * rate.size)


def _sum(terms):
    return functools.reduce(lambda a, b: a + b, terms)


def _rows(columns):
    return [x for row in zip(*columns, strict=True) for x in row]
