"""The convex step with contact, solved densely in NumPy, in float64: what `convex_step` is held to.

    v+ = argmin |v - v*|^2_A / 2 + sum l_i(J_i v)

A = M + dt C and v*, the velocities without contact, are given, and for each term its rows J. Formulas are Drake's of
1.51.1, as its SAP solver evaluates them, with its stopping rule where `solve` is asked for it. Nothing here is derived
by articulated bodies, and nothing is differentiated. Dry friction of joints, which Drake's steps do not have, is a term
of the same kind.

[Castro, Permenter, Han 2022, An unconstrained convex formulation of compliant contact; Castro, Han, Masterjohn 2023,
Irrotational contact fields]
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import jaxspatial as js
from tests.helpers.interpreted import interpreted

NEAR_RIGID, STICKING, NEAR_RIGID_LIMIT = 1 / (4 * np.pi**2), 1e-3, 0.01 / (4 * np.pi**2)
LIMIT_STIFFNESS, WINDOW, SOFT = 1e12, 2.0, 1e-7


class Contact(NamedTuple):
    """A sphere. J (3, nv): of the point of its body at C, two tangents and the normal. distance: negative inside."""

    J: np.ndarray
    distance: float
    stiffness: float
    relaxation_time: float
    friction: float


class Limit(NamedTuple):
    """Of a joint, a tendon or the angle of a ball. J (1, nv): the rate of the gap."""

    J: np.ndarray
    gap: float


class DryFriction(NamedTuple):
    """J (1, nv): the rate of the joint. loss: the largest force."""

    J: np.ndarray
    loss: float


class Held(NamedTuple):
    """A loop closure. J (k, nv): of what it holds, with their errors (k,); size: of the Delassus operator, per row."""

    J: np.ndarray
    errors: np.ndarray
    size: np.ndarray


class Term(NamedTuple):
    """A term with its rows, and its law: velocities -> (cost, impulses, G = -d impulses / d velocities)."""

    J: np.ndarray
    law: Any


class Result(NamedTuple):
    """v, the impulses of each Term, the gradient at v relative to the momenta, and how many iterations it took."""

    v: np.ndarray
    impulses: list[np.ndarray]
    residual: float
    iterations: int
    why: str


# -- laws of the terms ------------------------------------------------------------------------------------------------


def delassus(A, J):
    """|J diag(A)^-1 J^T|_F over the number of rows."""
    return np.linalg.norm((J / np.diag(A)) @ J.T) / len(J)


def of_contact(c, A, dt):
    w, memory = delassus(A, c.J), dt + c.relaxation_time
    R_n, R_t, mu = max(NEAR_RIGID * w, 1 / (dt * c.stiffness * memory)), STICKING * w, c.friction
    R, free = np.array([R_t, R_t, R_n]), np.array([0, 0, -c.distance / memory])

    def law(u):
        y = (free - u) / R
        size = np.sqrt(y[:2] @ y[:2] + SOFT**2)
        t, steep = y[:2] / size, mu * R_t / R_n
        if size <= mu * y[2]:
            impulse, slope = y, np.eye(3)
        elif y[2] + steep * size > 0:
            share = 1 / (1 + mu * steep)
            normal = (y[2] + steep * size) * share
            impulse = np.append(mu * normal * t, normal)
            # Rows of the derivative by y: of the tangents mu (n dt/dy + t dn/dy), of the normal dn/dy.
            dn = share * np.append(steep * t, 1)
            slope = np.zeros((3, 3))
            slope[:2, :2] = mu * normal / size * (np.eye(2) - np.outer(t, t))
            slope[:2] += mu * np.outer(t, dn)
            slope[2] = dn
        else:
            impulse, slope = np.zeros(3), np.zeros((3, 3))
        return R @ impulse**2 / 2, impulse, slope / R

    return Term(c.J, law)


def of_limit(x, A, dt):
    R = max(NEAR_RIGID_LIMIT * delassus(A, x.J), 1 / (2 * dt**2 * LIMIT_STIFFNESS))

    def law(u):
        impulse = np.maximum((-x.gap / (2 * dt) - u) / R, 0)
        return R * impulse @ impulse / 2, impulse, np.diag((impulse > 0) / R)

    return Term(x.J, law)


def of_dry_friction(x, A, dt):
    R, largest = STICKING * delassus(A, x.J), dt * x.loss

    def law(u):
        impulse = np.clip(-u / R, -largest, largest)
        sticks = abs(u) < R * largest
        cost = np.where(sticks, u**2 / (2 * R), largest * abs(u) - R * largest**2 / 2)
        return cost.sum(), impulse, np.diag(sticks / R)

    return Term(x.J, law)


def of_closure(x, A, dt):
    R = NEAR_RIGID_LIMIT * x.size

    def law(u):
        impulse = (-x.errors / dt - u) / R
        return R @ impulse**2 / 2, impulse, np.diag(1 / R)

    return Term(x.J, law)


def terms_of(A, free, v, dt, contacts=(), limits=(), dry=(), closures=()):
    """The terms that are in the problem: spheres inside, limits so near that they may be reached."""
    near = [x for x in limits if x.gap < WINDOW * dt * max(abs(x.J[0] @ v), abs(x.J[0] @ free))]
    inside = [c for c in contacts if c.distance <= 0]
    groups = (of_contact, inside), (of_limit, near), (of_dry_friction, dry), (of_closure, closures)
    return [function(x, A, dt) for function, group in groups for x in group]


# -- Newton's method --------------------------------------------------------------------------------------------------


class Problem:
    """A, v* and the terms."""

    def __init__(self, A, free, terms):
        self.A, self.free, self.terms, self.scale = A, free, terms, 1 / np.sqrt(np.diag(A))

    def at(self, v):
        """(cost, gradient, Hessian, J^T impulses)."""
        change = self.A @ (v - self.free)
        cost, pushed, H = (v - self.free) @ change / 2, np.zeros_like(v), self.A.copy()
        for J, law in self.terms:
            own, impulse, G = law(J @ v)
            cost, pushed, H = cost + own, pushed + J.T @ impulse, H + J.T @ G @ J
        return cost, change - pushed, H, pushed

    def momenta(self, v):
        """(the gradient's norm, what it is compared with), scaled by diag(A)^-1/2."""
        _, g, _, pushed = self.at(v)
        norm = [np.linalg.norm(self.scale * x) for x in (g, self.A @ v, pushed)]
        return norm[0], max(norm[1:])

    def along(self, v, d):
        """The length of the step that minimises the cost along d, at most 1.5."""

        def slope(a):
            _, g, H, _ = self.at(v + a * d)
            return g @ d, d @ H @ d

        low, high = 0.0, 1.5
        cost, g, _, _ = self.at(v)
        first, (last, curvature) = g @ d, slope(high)
        if last <= 0:
            return high
        if -first < 1e-30 + 1e-15 * cost:
            return 1.0
        a = min(-first / curvature, high)
        for _ in range(100):
            s, curvature = slope(a)
            if abs(s) <= 1e-8 * abs(first):
                return a
            low, high = (a, high) if s < 0 else (low, a)
            newton = a - s / curvature
            a = newton if low < newton < high else (low + high) / 2
        return a

    def solve(self, start, relative=1e-6, of_cost=1e-15, most=200):
        """From the velocity `start`, with Drake's stopping rule and tolerances."""
        if not self.terms:
            return Result(self.free, [], 0.0, 0, "free")
        v, a, k, cost, why = start, 0.0, 0, np.inf, "failed"
        while k < most:
            now, g, H, _ = self.at(v)
            size, of = self.momenta(v)
            if size <= 1e-14 + relative * of:
                why = "gradient"
                break
            if a > 0.5 and abs(now - cost) < 1e-30 + of_cost * (abs(now) + abs(cost)) / 2:
                why = "cost"
                break
            d = -np.linalg.solve(H, g)
            a, cost = self.along(v, d), now
            v, k = v + a * d, k + 1
        return Result(v, [law(J @ v)[1] for J, law in self.terms], size / max(of, 1e-300), k, why)

    def optimum(self, start):
        """To rounding: full Newton steps at the end, while the gradient shrinks."""
        if not self.terms:
            return Result(self.free, [], 0.0, 0, "free")
        v, _, _, steps, why = self.solve(start, 1e-10, 0.0)
        size, of = self.momenta(v)
        for _ in range(50):
            _, g, H, _ = self.at(v)
            nearer = v - np.linalg.solve(H, g)
            if self.momenta(nearer)[0] >= size:
                break
            v = nearer
            size, of = self.momenta(v)
        return Result(v, [law(J @ v)[1] for J, law in self.terms], size / max(of, 1e-300), steps, why)


# -- of our mechanisms ------------------------------------------------------------------------------------------------


class Numbers(NamedTuple):
    """What problems are made of, by our own functions: of n spheres and J of their frames, whose origins are p."""

    M: np.ndarray
    bias: np.ndarray
    springs: np.ndarray
    p: np.ndarray
    J: np.ndarray
    centers: np.ndarray
    distances: np.ndarray
    normals: np.ndarray


class Own(NamedTuple):
    """A problem of ours: v in its coordinates, the numbers of the spheres inside, the axes (n, 3, 3) at all spheres."""

    problem: Problem
    v: np.ndarray
    inside: list[int]
    axes: np.ndarray


def on_plane(p):
    return p[2]


def _numbers(mech, frames, ground):
    without = mech.replace(damping=np.zeros(mech.nv), friction_loss=np.zeros(mech.nv))

    def numbers(q, v, positions):
        X = js.forward_kinematics(mech, q, frames)
        centers = jax.vmap(lambda X, p: X @ p)(X, positions)
        values, normals = jax.vmap(jax.vmap(jax.value_and_grad(ground)))(centers)
        distances = values / jnp.sqrt((normals**2).sum(-1))
        dynamics = js.mass_matrix(mech, q), js.bias_forces(mech, q, v), js.passive_forces(without, q, v)
        return Numbers(*dynamics, X.translation, js.jacobian(mech, q, frames), centers, distances, normals)

    return interpreted(numbers)


def problems_of(mech, q, v, tau, dt, contacts, ground=on_plane, pairs=None, loops=()):
    """An Own for each of m states q (m, nq), v, tau (m, nv), dt (m,); numbers of contacts may be batches (m, n).

    Rates of free joints are along the axes of the world, as Drake's; of joints whose axes turn it knows no other.
    """
    m, n = len(q), len(contacts.frames)
    q, v, tau = (np.asarray(x, float) for x in (q, v, tau))
    positions = np.zeros((n, 3)) if contacts.positions is None else np.asarray(contacts.positions)
    numbers = contacts.radius, contacts.stiffness, contacts.relaxation_time, contacts.friction
    of_spheres = np.stack([np.broadcast_to(np.asarray(x), (m, n)) for x in numbers], -1)
    with jax.enable_x64(True):
        found = _numbers(mech, contacts.frames, ground)(q, v, np.broadcast_to(positions, (m, n, 3)))
        between = _between(mech, q, pairs) if pairs else [([], [])] * m
        closures = list(zip(*(_held(mech, q, loop) for loop in loops), strict=True)) if loops else [()] * m
    each = zip(map(Numbers._make, zip(*found, strict=True)), q, v, tau, np.broadcast_to(dt, m), of_spheres, strict=True)
    return [_problem_of(mech, *x, *y) for x, y in zip(each, zip(between, closures, strict=True), strict=True)]


def _between(mech, q, pairs):
    """(a Contact of each sphere that touches another, or a shape; their axes) of each of several q."""

    def numbers(q):
        X, J = ([f(mech, q, x.frames) for x in pairs] for f in (js.forward_kinematics, js.jacobian))
        return [(x.translation, x.rotation.to_matrix(), J) for x, J in zip(X, J, strict=True)]

    of_a, of_b = interpreted(numbers)(q)
    return [_of_pairs(pairs, *([x[k] for x in own] for own in (of_a, of_b))) for k in range(len(q))]


def _of_pairs(pairs, of_a, of_b):
    (p_a, R_a, J_a), (p_b, R_b, J_b) = of_a, of_b
    others, spheres = pairs
    n = len(p_b)
    centres = p_b + _turned(R_b, spheres.positions, n)
    at_a = p_a + _turned(R_a, others.positions, n)
    found, axes = [], []
    for i in range(n):
        names = "stiffness", "relaxation_time", "friction"
        k, tau_d, mu = ([np.broadcast_to(getattr(x, name), n)[i] for x in pairs] for name in names)
        if isinstance(others, js.ShapeContacts):
            shape = others.shape
            normal, distance = surface(shape, R_a[i].T @ (centres[i] - p_a[i]), i if shape.batch_shape else None)
            normal = R_a[i] @ normal
        else:
            normal, distance = _unit(centres[i] - at_a[i])
            distance = distance - np.broadcast_to(others.radius, n)[i]
        radius = np.broadcast_to(spheres.radius, n)[i]
        distance = distance - radius
        axes.append(_axes(normal))
        # Each of the surfaces gives way by its share.
        C = centres[i] - (radius + distance * k[0] / sum(k)) * normal
        at_C = [own[i][3:] - np.cross((C - p[i])[:, None], own[i][:3], axis=0) for own, p in ((J_a, p_a), (J_b, p_b))]
        law = 1 / (1 / k[0] + 1 / k[1]), sum(tau_d), 2 * mu[0] * mu[1] / (mu[0] + mu[1])
        found.append(Contact(axes[-1] @ (at_C[1] - at_C[0]), distance, *law))
    return found, axes


def _turned(R, positions, n):
    return np.einsum("nij,nj->ni", R, np.zeros((n, 3)) if positions is None else np.broadcast_to(positions, (n, 3)))


def _unit(v):
    return v / np.linalg.norm(v), np.linalg.norm(v)


def surface(shape, p, i=None):
    """(the normal, the signed distance) of a point from a shape, or from its item i."""
    number = {k: np.asarray(x if i is None else x[i]) for k, x in vars(shape).items() if k != "placement"}
    R, origin = np.eye(3), np.zeros(3)
    if shape.placement is not None:
        parts = shape.placement.rotation.to_matrix(), shape.placement.translation
        R, origin = (np.asarray(x if i is None or x.ndim == n else x[i]) for n, x in zip((2, 1), parts, strict=True))
    n, distance = SURFACES[type(shape)](R.T @ (p - origin), **number)
    return R @ n, distance


def _of_box(p, size):
    """Outside of the nearest point, inside of the nearest face."""
    nearest = np.clip(p, -size / 2, size / 2)
    if (nearest != p).any():
        return _unit(p - nearest)
    i = (abs(p) - size / 2).argmax()
    return np.eye(len(p))[i] * np.sign(p[i]), abs(p[i]) - size[i] / 2


def _of_cylinder(p, radius, length):
    """In the plane through the axis."""
    rho = np.linalg.norm(p[:2])
    n, distance = _of_box(np.array([rho, p[2]]), np.array([2 * radius, length]))
    return np.array([*p[:2] / rho * n[0], n[1]]), distance


def _of_capsule(p, radius, length):
    n, distance = _unit(p - [0, 0, np.clip(p[2], -length / 2, length / 2)])
    return n, distance - radius


def _of_half_space(p, normal, offset):
    return _unit(normal)[0], p @ _unit(normal)[0] - offset


SURFACES = {
    js.Box: _of_box,
    js.Cylinder: _of_cylinder,
    js.Capsule: _of_capsule,
    js.HalfSpace: _of_half_space,
    js.Sphere: lambda p, radius: (_unit(p)[0], np.linalg.norm(p) - radius),
}


def _held(mech, q, loop):
    """(J, errors, J of all six rows, of which it holds some) of each of several q."""
    weld = [js.LoopClosure(loop.frame_a, loop.frame_b, "weld")]

    def rows(q):
        of_loop = (f(mech, q, [loop]) for f in (js.constraint_jacobian, js.constraint_error))
        return *of_loop, js.constraint_jacobian(mech, q, weld)

    return list(zip(*interpreted(rows)(q), strict=True))


def _problem_of(mech, found, q, v, tau, dt, of_spheres, between=((), ()), closures=()):
    damping, loss, still = np.asarray(mech.damping), np.asarray(mech.friction_loss), v.copy()
    for rows in _of_free_joints(mech):
        w, linear = v[rows].reshape(2, 3)
        still[rows[3:]] += dt * np.cross(w, linear)
    A = found.M + dt * np.diag(damping)
    free = still + dt * np.linalg.solve(A, tau + found.springs - found.bias - damping * still)
    T = in_world(mech, q)
    # T is orthogonal.
    A, free, still = T @ A @ T.T, T @ free, T @ still
    spheres, axes = [], []
    for i, (radius, *own) in enumerate(of_spheres):
        normal = found.normals[i] / np.linalg.norm(found.normals[i])
        arm = found.centers[i] - found.distances[i] * normal - found.p[i]
        at_point = found.J[i][3:] - np.cross(arm[:, None], found.J[i][:3], axis=0)
        axes.append(_axes(normal))
        spheres.append(Contact(axes[-1] @ at_point @ T.T, found.distances[i] - radius, *own))
    limits, dry = [], [DryFriction(np.eye(len(v))[[i]], loss[i]) for i in np.flatnonzero(loss)]
    for name in mech.joint_names:
        own_q, own_v = mech.joint_position_indices(name), mech.joint_velocity_indices(name)
        if len(own_q) == len(own_v) == 1:
            row, x = np.eye(len(v))[own_v], q[own_q[0]]
            limits += [Limit(row, x - mech.lower[own_q[0]]), Limit(-row, mech.upper[own_q[0]] - x)]
    limits = [x for x in [*limits, *_of_tendons(mech, q), *_of_balls(mech, q)] if np.isfinite(x.gap)]
    spheres += [c._replace(J=c.J @ T.T) for c in between[0]]
    axes += between[1]
    inside = [i for i, c in enumerate(spheres) if c.distance <= 0]
    held = []
    for J, errors, six in closures:
        of_blocks = [np.linalg.norm((x / np.diag(A)) @ x.T) / 3 for x in (six[:3] @ T.T, six[3:] @ T.T)]
        n_moving = min(len(J), 3)
        size = np.repeat(of_blocks, [len(J) - n_moving, n_moving])
        # What nothing can move is not closed.
        moves = size > 1e-20
        held.append(Held(J[moves] @ T.T, errors[moves], size[moves]))
    problem = Problem(A, free, terms_of(A, free, still, dt, spheres, limits, dry, held))
    return Own(problem, still, inside, np.array(axes))


def _of_tendons(mech, q):
    """The Limits of all tendons: of joints that are no mimics, whose Jacobians are those of the joints they follow."""
    for tendon in mech.tendons:
        length, row = float(tendon.offset), np.zeros((1, mech.nv))
        for name, c in zip(tendon.joints, np.asarray(tendon.coefficients, float), strict=True):
            (i,), (k,) = mech.joint_position_indices(name), mech.joint_velocity_indices(name)
            length, row[0, k] = length + c * q[i], row[0, k] + c
        yield from (Limit(row, length - float(tendon.lower)), Limit(-row, float(tendon.upper) - length))


def _of_balls(mech, q):
    """The Limits of the angles of balls: the rotation is about the vector part of the quaternion."""
    limits = np.full(len(mech.joint_names), np.inf) if mech.turn_limits is None else np.asarray(mech.turn_limits)
    for name, largest in zip(mech.joint_names, limits, strict=True):
        own_q, own_v = mech.joint_position_indices(name), mech.joint_velocity_indices(name)
        if len(own_v) == 3 and len(own_q) == 4:
            w, *xyz = np.asarray(q, float)[own_q] * np.sign(q[own_q[0]])
            size, row = np.linalg.norm(xyz), np.zeros((1, mech.nv))
            row[0, own_v] = -np.array(xyz) / size
            yield Limit(row, largest - 2 * np.arctan2(size, w))


class Step(NamedTuple):
    """v with rates of free joints in world axes, forces (n, 3) on the spheres in world axes, and the Result.

    Impulses of closures are the last of the Result."""

    v: np.ndarray
    forces: np.ndarray
    result: Result


def steps_of(mech, q, v, tau, dt, contacts, ground=on_plane, pairs=None, loops=()):
    """The Step of each state, to rounding; see `problems_of`."""
    found = []
    problems = problems_of(mech, q, v, tau, dt, contacts, ground, pairs, loops)
    for own, h in zip(problems, np.broadcast_to(dt, len(q)), strict=True):
        result, forces = own.problem.optimum(own.v), np.zeros((len(own.axes), 3))
        for i, impulse in zip(own.inside, result.impulses, strict=False):
            forces[i] = own.axes[i].T @ impulse / h
        found.append(Step(result.v, forces, result))
    return found


def _of_free_joints(mech):
    rows = map(mech.joint_velocity_indices, mech.joint_names)
    return [np.asarray(x) for x in rows if len(x) == 6]


def _axes(normal):
    """Two tangents and the normal, as rows."""
    first = np.cross(normal, np.eye(3)[abs(normal).argmin()])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def in_world(mech, q):
    """T, with T v the rates of which those of free joints are along the axes of the world."""
    T = np.eye(mech.nv)
    for name in mech.joint_names:
        rows, places = np.asarray(mech.joint_velocity_indices(name)), mech.joint_position_indices(name)
        if len(rows) == 6:
            # Placed in the world without a turn of their own.
            T[np.ix_(rows, rows)] = np.kron(np.eye(2), _rotation(np.asarray(q, float)[places[:4]]))
    return T


def _rotation(wxyz):
    w, x, y, z = wxyz / np.linalg.norm(wxyz)
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * skew + 2 * skew @ skew
