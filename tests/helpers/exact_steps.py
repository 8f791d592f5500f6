"""Steps on the manifold of configurations, and in time, in 60 digits."""

import mpmath as mp

from tests.helpers import exact_dynamics as exact


def numbers(x):
    return [mp.mpf(float(c)) for c in x]


def norm(x):
    return mp.sqrt(sum(c * c for c in x))


def unit(q):
    return [c / norm(q) for c in q]


def product(p, q):
    a, b, c, d = p
    e, f, g, h = q
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]


def rotated(q, v):
    """By a quaternion of any length but 0."""
    q = unit(q)
    return product(product(q, [0, *v]), [q[0], *(-c for c in q[1:])])[1:]


def cross(a, b):
    (a1, a2, a3), (b1, b2, b3) = a, b
    return [a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1]


def combination(c, half, d, w, v):
    along = d * sum(a * b for a, b in zip(w, v, strict=True))
    return [c * x + half * y + along * z for x, y, z in zip(v, cross(w, v), w, strict=True)]


def exp_quaternion(w):
    t = norm(w)
    return [mp.cos(t / 2), *(c * (mp.sin(t / 2) / t if t else mp.mpf(1) / 2) for c in w)]


def log_quaternion(q):
    q = unit(q)
    q = [-c for c in q] if q[0] < 0 else q
    s = norm(q[1:])
    return [c * (2 * mp.atan2(s, q[0]) / s if s else 2) for c in q[1:]]


def translation(w, v):
    """Of exp(w, v)."""
    t = norm(w)
    if not t:
        return list(v)
    return combination(mp.sin(t) / t, (1 - mp.cos(t)) / t**2, (t - mp.sin(t)) / t**3, w, v)


def translation_inverse(w, p):
    t = norm(w)
    if not t:
        return list(p)
    e = t / 2 * mp.cot(t / 2)
    return combination(e, -mp.mpf(1) / 2, (1 - e) / t**2, w, p)


def shortest(angle):
    return angle - 2 * mp.pi * mp.nint(angle / (2 * mp.pi))


def planar(q):
    """(quaternion, position) of planar coordinates."""
    return exp_quaternion([0, 0, q[2]]), [*q[:2], mp.mpf(0)]


def integrated(kind, q, step):
    """The coordinates of one joint after a step of its rates."""
    if kind == "ball":
        return unit(product(q, exp_quaternion(step)))
    if kind == "free":
        arm = rotated(q[:4], translation(step[:3], step[3:]))
        return [*integrated("ball", q[:4], step[:3]), *(a + b for a, b in zip(q[4:], arm, strict=True))]
    if kind == "planar":
        turn, p = planar(q)
        arm = rotated(turn, translation([0, 0, step[2]], [*step[:2], 0]))
        return [p[0] + arm[0], p[1] + arm[1], q[2] + step[2]]
    return [a + b for a, b in zip(q, step, strict=True)]


def differed(kind, q, q2):
    if kind == "ball":
        return log_quaternion(product([q[0], *(-c for c in q[1:])], q2))
    if kind == "free":
        w = differed("ball", q[:4], q2[:4])
        back = [q[0], *(-c for c in q[1:4])]
        arm = rotated(back, [b - a for a, b in zip(q[4:], q2[4:], strict=True)])
        return [*w, *translation_inverse(w, arm)]
    if kind == "planar":
        turn, p = planar([0, 0, -q[2]])[0], [q2[0] - q[0], q2[1] - q[1], 0]
        w = shortest(q2[2] - q[2])
        return [*translation_inverse([0, 0, w], rotated(turn, p))[:2], w]
    apart = [b - a for a, b in zip(q, q2, strict=True)]
    return [shortest(apart[0])] if kind == "continuous" else apart


def rates(kind, q, v):
    if kind == "ball":
        return [c / 2 for c in product(q, [0, *v])]
    if kind == "free":
        return [*rates("ball", q[:4], v[:3]), *rotated(q[:4], v[3:])]
    if kind == "planar":
        return [*rotated(planar(q)[0], [*v[:2], 0])[:2], v[2]]
    return v


def straight_ahead(kind, q, v, a, h):
    """(q, v) of a floating joint after a step of Euler's method in the parent's axes, of its rates by the accelerations
    a, linear ones those of its origin along the axes at q: then of its coordinates by the new rates."""
    v = [x + h * y for x, y in zip(v, a, strict=True)]
    if kind == "free":
        w, u, turn, p = v[:3], v[3:], q[:4], q[4:]
    else:
        turn, p = planar(q)
        w, u = [mp.mpf(0), mp.mpf(0), v[2]], [*v[:2], mp.mpf(0)]
    step = [h * x for x in w]
    p = [x + h * y for x, y in zip(p, rotated(turn, u), strict=True)]
    u = rotated(exp_quaternion([-x for x in step]), u)
    if kind == "free":
        return [*integrated("ball", turn, step), *p], [*w, *u]
    return [*p[:2], q[2] + step[2]], [*u[:2], w[2]]


class Steps:
    """Steps in time of a chain of revolute joints."""

    def __init__(self, mech, tau, h):
        self.tau, self.h, self.n = numbers(tau), mp.mpf(float(h)), len(tau)
        self.chain = exact.Chain(mech, *[[0] * self.n] * 3)

    def forces(self, q, v, a, gravity=1):
        chain = self.chain.at(q=_sized(q), v=_sized(v), a=_sized(a))
        return exact.values(chain.inverse_dynamics(gravity))

    def mass_matrix(self, q):
        units = [[mp.mpf(int(i == k)) for i in range(self.n)] for k in range(self.n)]
        return mp.matrix([self.forces(q, [0] * self.n, unit, 0) for unit in units])

    def solved(self, q, forces):
        return list(mp.lu_solve(self.mass_matrix(q), mp.matrix(forces)))

    def accelerations(self, q, v):
        bias = self.forces(q, v, [mp.mpf(0)] * self.n)
        return self.solved(q, [t - b for t, b in zip(self.tau, bias, strict=True)])

    def ahead(self, x, h, rate):
        return [a + h * b for a, b in zip(x, rate, strict=True)]

    def semi_implicit(self, q, v):
        v = self.ahead(v, self.h, self.accelerations(q, v))
        return self.ahead(q, self.h, v), v

    def rk4(self, q, v):
        k = [(v, self.accelerations(q, v))]
        for share in (mp.mpf(1) / 2, mp.mpf(1) / 2, 1):
            at = [self.ahead(x, share * self.h, rate) for x, rate in zip((q, v), k[-1], strict=True)]
            k.append((at[1], self.accelerations(*at)))
        means = [[(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(*(x[i] for x in k), strict=True)] for i in (0, 1)]
        return tuple(self.ahead(x, self.h, rate) for x, rate in zip((q, v), means, strict=True))

    def kinetic_slopes(self, q, v):
        """dT/dq: differences, with a step that 60 digits bear."""
        d, v = mp.mpf(10) ** -20, mp.matrix(v)

        def energy(k, s):
            at = [x + s * d if i == k else x for i, x in enumerate(q)]
            return (v.T * self.mass_matrix(at) * v)[0] / 2

        return [(energy(k, 1) - energy(k, -1)) / (2 * d) for k in range(self.n)]

    def symplectic(self, q, v):
        """M(q) v' = M(q - h v) v + h (tau - g(q)) + h dT/dq(q, v'), the discrete Euler-Lagrange equation."""
        zero = [mp.mpf(0)] * self.n
        before = self.mass_matrix(self.ahead(q, -self.h, v)) * mp.matrix(v)
        static = self.forces(q, zero, zero)
        momentum = [p + self.h * (t - g) for p, t, g in zip(before, self.tau, static, strict=True)]
        for _ in range(12):
            v = self.solved(q, self.ahead(momentum, self.h, self.kinetic_slopes(q, v)))
        return self.ahead(q, self.h, v), v


def _sized(numbers):
    return [exact.Sized(x, abs(x)) for x in numbers]
