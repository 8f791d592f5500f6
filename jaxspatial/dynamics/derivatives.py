"""Closed-form derivatives of inverse dynamics with respect to configuration, velocities and accelerations.

They are computed from composite bodies, entry by entry as the mass matrix is, and at a similar cost. Mechanics does not
depend on the velocity of the observer: each body is described by an observer for whom its own frame is at rest, so that
linear velocities never enter, and a fast base loses no digits. [Carpentier, Mansard 2018; Singh, Russell, Wensing 2022,
Efficient analytical derivatives of rigid-body dynamics using spatial vector algebra, equations 35 to 38]
"""

import operator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.composite_bodies import combined, with_armature
from jaxspatial.dynamics.external_forces import Load, loads
from jaxspatial.dynamics.kinematics import BodyMotion, motion_step, subspace_times, world_motion
from jaxspatial.dynamics.newton_euler import wrench_of
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.algorithm import DYNAMICS, FRAMES, Wrenches, algorithm
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.inertia.articulated import of_body
from jaxspatial.numerics import numbers
from jaxspatial.numerics.linear import Inertia, Matrix, Motion, Pose, Vector, Wrench, cross, dot, entrywise, skew
from jaxspatial.numerics.numbers import Number, Numbers, doubled, is_constant
from jaxspatial.spatial.algebra import (
    acted_inertia,
    acted_wrench,
    apply_inertia,
    cross_force,
    cross_motion,
    double_cross,
    power,
)

# (S, Psi', S', Psi''), see `_motion_rates`.
JointRates = tuple[Motion, Motion, Motion, Motion]
# (R, p, v) of a body, see `_from_root`.
FromRoot = tuple[Matrix, Vector, Vector]
# Four motions of a row, and eight vectors of a column, then p and v of their bodies.
Sides = tuple[tuple[Motion | Vector, ...], tuple[Vector, ...]]


@algorithm(*DYNAMICS, *FRAMES)
def derivatives(state: MechanismState, v: Array | None, vdot: Array | None, external_forces: Wrenches):
    """(dtau_dq, dtau_dv, M), (nv, nv) each; dtau_dq is with respect to steps of `integrate`."""
    return tuple(map(state.rounded, _matrices(state, v, vdot, external_forces)))


@algorithm(*DYNAMICS, *FRAMES)
def jacobians(
    state: MechanismState,
    v: Array | None,
    vdot: Array | None,
    external_forces: Wrenches,
    *,
    wanted: tuple[bool, ...],
) -> list[jax.Array]:
    """The wanted ones of dtau_dq (nv, nq), which is by coordinates as in JAX, dtau_dv and dtau_dvdot."""
    dq, dv, M = _matrices(state, v, vdot, external_forces)
    all_three = (_by_coordinates(state, dq) if wanted[0] else None), dv, M
    return [state.rounded(x) for x, yes in zip(all_three, wanted, strict=True) if yes]


def _matrices(state: MechanismState, v: Array | None, vdot: Array | None, external_forces: Wrenches):
    body_loads = loads(state, external_forces, _turning)
    links = state.links(v, vdot)
    motions = recursion.outward(state, motion_step, world_motion(state), links)
    zero, world = state.zero_vector, state.world
    zeros = Matrix(zero, zero, zero)
    nothing = CompositeBody(state.zero_inertia, Wrench(zero, zero), zeros, zero, zeros, zero)
    bodies = list(zip(links, motions, body_loads, strict=True))
    composites = recursion.inward(state, _composite_step, nothing, bodies, join=_as_one)
    bodies = [(link, motion, b.is_on_world) for link, motion, b in zip(links, motions, state.bundles, strict=True)]
    placed = recursion.outward(state, _from_root, (world.R, world.p, zero), bodies)
    subspaces = [stacking.stacked_trees(link.joint.subspace) for link in links]
    sides = list(map(_in_world_axes, subspaces, links, motions, composites, placed))
    rows, columns = ([(b.kind.nv, x[side]) for b, x in zip(state.bundles, sides, strict=True)] for side in (0, 1))
    return _assembled(state, links, matrices.matrices(state, _entries, rows, columns, count=5))


# -- composite bodies -------------------------------------------------------------------------------------------------


class CompositeBody(NamedTuple):
    """The bodies of a subtree as one rigid body, about J, in the frame that moves with J.

    wrench: their net wrench. p: their linear momentum. X (3 x 3): an additional angular velocity y of all of them
    changes the wrench by 2 B y = (X y, 2 y x p), with B the Coriolis matrix. load: the external forces on them that
    keep their directions in the world: a rotation by y changes their wrench by (load_rate y, y x load).
    """

    inertia: Inertia
    wrench: Wrench
    X: Matrix
    p: Vector
    load_rate: Matrix
    load: Vector


def _turning(tau: Vector, f: Vector, r: Vector, in_world: bool) -> tuple[Matrix, Vector]:
    """(load_rate, load) of a CompositeBody, for a load at r. One that turns with the body has none of either."""
    if not in_world:
        zero = Vector(*[numbers.constant(tau[0], 0)] * 3)
        return Matrix(zero, zero, zero), zero
    about_point = tau - cross(r, f)
    return skew(-about_point) - double_cross(r, f), f


def _from_root(body: tuple[Link, BodyMotion, bool], parent: FromRoot) -> tuple[FromRoot, FromRoot]:
    """(R, p, v) of a body: its pose in the axes of the world from the root, and its velocity relative to the root."""
    link, motion, is_root = body
    X_PB = link.X_PB
    d = _velocity_seen(link, motion, X_PB)
    R, p, v = parent
    R_B = R @ X_PB.R
    p = matrices.zero_at_root(is_root, p + R @ X_PB.p)
    result = R_B, p, matrices.zero_at_root(is_root, v + R @ d)
    return result, result


def _composite_step(
    body: tuple[Link, BodyMotion, Load], children: CompositeBody
) -> tuple[CompositeBody, CompositeBody]:
    link, motion, load = body
    composite = _as_one(_of_body(link.inertia, motion, load), children)
    # The same about the parent's origin in its axes, for the observer that moves with it.
    X_PB = link.X_PB
    d = _velocity_seen(link, motion, X_PB)
    (R, p_PJ), m = X_PB, composite.inertia.mass
    p = R @ composite.p + m * d
    shift = double_cross(R @ (m * composite.inertia.com), d) + double_cross(p_PJ, p)
    X = R @ (composite.X @ R.T) - Matrix(*map(_twice, shift))
    load_P = R @ composite.load
    load_rate = R @ (composite.load_rate @ R.T) - double_cross(p_PJ, load_P)
    inertia, wrench = acted_inertia(X_PB, composite.inertia), acted_wrench(X_PB, composite.wrench)
    return composite, CompositeBody(inertia, wrench, X, p, load_rate, load_P)


def _of_body(inertia: Inertia, motion: BodyMotion, load: Load) -> CompositeBody:
    """The CompositeBody of a single body.

    X = -2 [w]x Sigma, with Sigma = (tr J / 2) 1 - J for J about the origin: the Coriolis matrix where the origin rests.
    """
    tau, f, (load_rate, in_world) = load
    J = of_body(inertia).J
    xx, xy, yy, xz, yz, zz = J
    half_trace = doubled(xx + yy + zz, -1)
    sigma = J._make((half_trace - xx, -xy, half_trace - yy, -xz, -yz, half_trace - zz))
    X = skew(_twice(-motion.w)) @ sigma
    p = cross(motion.w, inertia.mass * inertia.com)
    return CompositeBody(inertia, wrench_of(inertia, motion) - Wrench(tau, f), X, p, load_rate, in_world)


def _twice(v: Vector) -> Vector:
    return Vector(*map(doubled, v))


def _velocity_seen(link: Link, motion: BodyMotion, X_PB: Pose) -> Vector:
    """The velocity of Jo for an observer for whom the parent's origin is at rest, in the parent's axes."""
    w_r, v_r = subspace_times(link.joint.subspace, link.v)
    return cross(X_PB.R @ (motion.w - w_r), X_PB.p) + X_PB.R @ v_r


def _as_one(a: CompositeBody, b: CompositeBody) -> CompositeBody:
    sums = a.wrench + b.wrench, a.X + b.X, a.p + b.p, a.load_rate + b.load_rate, a.load + b.load
    return CompositeBody(combined(a.inertia, b.inertia), *sums)


# -- entries of two joints --------------------------------------------------------------------------------------------
#
# For velocity i of a joint that joint j carries. Psi' and Psi'' are the first and second rates of the motion S of j
# fixed in the parent, S' is the rate of S fixed in the body of j:
#     dtau_i / dq_j = t . Psi'_w + u . Psi'' + l . S_w       dtau_i / dv_j = t . S_w + u . (Psi' + S')
#     dtau_j / dq_i = S . a      a = 2 B Psi'_i + I Psi''_i + S_i x* f + the rate of loads
#     dtau_j / dv_i = S . b      b = 2 B S_i + I (Psi'_i + S'_i)
#     M_ij = S . u               u = I S_i          t = rotational part of 2 B^T S_i, l that of loads


def _in_world_axes(S: Motion, link: Link, motion: BodyMotion, body: CompositeBody, placed: FromRoot) -> Sides:
    """(the motions of a joint for rows, its wrenches for columns), stacked over its velocities, in world axes.

    S: the stacked motion subspace. The columns are (u, t, a, b, l), with u, a and b wrenches, as eight vectors.
    """
    R, *where = placed
    S, first, carried, second = _rates(S, link, motion)
    row = [Motion(R @ x.w, R @ x.v) for x in (S, first, first + carried, second)]
    t = body.X.T @ S.w + _twice(cross(body.p, S.v))
    loaded = body.load_rate.T @ S.w + cross(body.load, S.v)
    a = _coriolis(body, first.w) + apply_inertia(body.inertia, second) + cross_force(S, body.wrench)
    a = a + Wrench(body.load_rate @ S.w, cross(S.w, body.load))
    b = _coriolis(body, S.w) + apply_inertia(body.inertia, first + carried)
    column = *apply_inertia(body.inertia, S), t, *a, *b, loaded
    return (*row, *where), (*(R @ x for x in column), *where)


def _coriolis(body: CompositeBody, y: Vector) -> Wrench:
    """2 B (y, 0), for an angular velocity y."""
    return Wrench(body.X @ y, _twice(cross(y, body.p)))


def _entries(row, column: tuple[Vector, ...]) -> Numbers:
    """(dtau_i / dq_j, dtau_i / dv_j, dtau_j / dq_i, dtau_j / dv_i, M_ij), with j that of the row, i of the column."""
    S, first, both, second, p, v = row
    u, t, a, b, loaded, p2, v2 = column[:2], column[2], column[3:5], column[5:7], *column[7:]
    arm, d = p2 - p, v2 - v
    t = t + _twice(cross(d, u[1]))
    u, a, b = (Wrench(tau + cross(arm, f), f) for tau, f in (u, a, b))
    by_q = dot(t, first.w) + dot(loaded, S.w) + power(u, second)
    by_v = dot(t, S.w) + power(u, both)
    return by_q, by_v, power(a, S), power(b, S), power(u, S)


def _rates(S: Motion, link: Link, motion: BodyMotion) -> JointRates:
    """(S, Psi', S', Psi'') of all velocities of a joint, for an observer for whom J is at rest."""
    subspace = link.joint.subspace
    across_joint = subspace_times(subspace, link.v)
    change = subspace_times(subspace, link.vdot) + subspace_times(link.joint.subspace_rate(link.v), link.v)
    zero = Vector(*[numbers.constant(motion.w[0], 0)] * 3)
    V, A = Motion(motion.w, zero), Motion(motion.alpha, motion.a)
    before = Motion(motion.w - across_joint.w, -across_joint.v)
    turning = Motion(cross(motion.w, across_joint.w), cross(motion.w, across_joint.v))
    of_parent = A - (change + turning)
    if link.joint.kind.is_sequential:
        return stacking.stacked_trees(_one_by_one(link, before, of_parent))
    return S, *_motion_rates(S, before, of_parent, cross_motion(V, S))


def _one_by_one(link: Link, V: Motion, A: Motion) -> list[JointRates]:
    """The JointRates of each velocity, as of a chain of joints. V and A: the motion of the body before the first."""
    rates = list[JointRates]()
    for s, v, change in zip(link.joint.subspace, link.v, link.vdot, strict=True):
        first, carried, second = _motion_rates(s, V, A, cross_motion(V, s))
        rates.append((s, first, carried, second))
        A = A + change * s + v * first
        V = V + v * s
    return rates


def _motion_rates(s: Motion, V: Motion, A: Motion, carried: Motion) -> tuple[Motion, Motion, Motion]:
    """(Psi', S', Psi'') of a motion s; V and A: the motion of the body that it is fixed in before the joint."""
    first = cross_motion(V, s)
    return first, carried, cross_motion(A, s) + cross_motion(V, first)


# -- assembly ---------------------------------------------------------------------------------------------------------


def _assembled(state: MechanismState, links: list[Link], entries: Numbers) -> tuple[Number, Number, Number]:
    """(dtau_dq, dtau_dv, M), as numbers (nv, nv, B)."""
    t = state.topology
    joints = [(i, k) for i in range(len(t)) for k in range(t.kind(i).nv)]
    # Whether the column's velocity comes after the row's, in a later joint or in the same sequential one.
    behind = [[i > j or (i == j and t.kind(i).is_sequential and k > m) for i, k in joints] for j, m in joints]
    is_behind = jnp.asarray(np.array(behind, bool).reshape((len(joints), len(joints), 1)))
    both = zip(entries[2:4], entries[:2], strict=True)
    by_q, by_v = (numbers.where(is_behind, x, matrices.transposed(y)) for x, y in both)
    by_q, by_v = (matrices.by_velocity(state, matrices.by_velocity(state, x, 0), 1) for x in (by_q, by_v))
    return by_q, _with_turning(state, links, by_v), with_armature(state, links, matrices.symmetric_of(entries[4]))


def _with_turning(state: MechanismState, links: list[Link], by_v: Number) -> Number:
    """Adds the derivatives of the forces that move armature along axes that joints turn, armature (w x v)."""
    t = state.topology
    # The first velocity of the joint of each row.
    starts = np.array([t.v_starts[i] for i in range(len(t)) if not t.is_mimic(i) for _ in range(t.kind(i).nv)])
    for m in range(max((b.kind.nv for b in state.bundles if b.kind.turned), default=0)):
        # The derivatives by velocity m of each joint, known zeros where it has no such.
        rates = list[Numbers]()
        for link in links:
            kind, v = link.joint.kind, link.v
            unit = tuple(numbers.constant(kind.zero, int(k == m)) for k in range(len(v)))
            both = zip(link.armature, kind.transport(unit, v), kind.transport(v, unit), strict=True)
            rates.append(tuple(a * (x + y) for a, x, y in both))
        if all(is_constant(x) and x.value == 0 for of_joint in rates for x in of_joint):
            continue
        column = state.of_independent_joints(rates)
        is_here = jnp.asarray((np.arange(len(starts)) == starts[:, None] + m)[:, :, None])
        by_v = numbers.where(is_here, by_v + stacking.mapped(lambda w: w[:, None], column), by_v)
    return by_v


def _by_coordinates(state: MechanismState, matrix: Number) -> Number:
    """A matrix (nv, nv, B) with columns by velocity, converted to columns by coordinate."""
    t, columns, places = state.topology, list[Number](), list[np.ndarray]()
    rows_by_velocity = matrices.transposed(matrix)
    for joints in state.independent_joints:
        bodies = joints.bundle.own_bodies
        of_bodies = [np.array(t.v_starts)[bodies] + k for k in range(joints.kind.nv)]
        by_velocity = [stacking.mapped(lambda w, v=v: stacking.rows(w, v), rows_by_velocity) for v in of_bodies]
        kind = joints.kind
        if kind.nq == kind.nv and not kind.rates_need_angles:  # dq/dt = v
            columns += by_velocity
        else:
            # dq/dt = G v, where the columns g of G are orthogonal, those of quaternions too: v = G^+ dq/dt, with rows
            # g / |g|^2.
            units = (tuple(state.known(float(i == k)) for i in range(kind.nv)) for k in range(kind.nv))
            inverse = [tuple(entrywise(operator.mul, [1 / dot(g, g)] * len(g), g)) for g in joints.dq_dt(*units)]
            # Numbers (1, joints, B) beside rows (joints, n, B).
            lifted = ([matrices.transposed(x) for x in row] for row in zip(*inverse, strict=True))
            columns += [dot(row, by_velocity) for row in lifted]
        places += [np.array(t.q_starts)[bodies] + c for c in range(joints.kind.nq)]
    if not columns:
        return state.zeros(t.nv, t.nq)
    order = np.argsort(np.concatenate(places))
    return matrices.transposed(stacking.mapped(lambda w: stacking.rows(w, order), stacking.concatenated(columns)))
