"""Derivatives of inverse and forward dynamics with respect to configuration, rates, accelerations and forces.

What the joints of other bodies do to the force at a joint comes in closed form, from composite bodies, with a cost that
grows as the mass matrix's. As nothing in mechanics depends on the velocity of the observer, every body is seen here by
one that its own frame rests for: linear velocities never enter, and a fast base loses no digits. [Carpentier, Mansard
2018; Singh, Russell, Wensing 2022, Efficient analytical derivatives of rigid-body dynamics using spatial vector
algebra, equations 35 to 38]
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import numbers, symmetric, vectors
from jaxspatial.arithmetic.numbers import Motion, Number, Numbers, Rows, Three, Wrench, doubled, noinline
from jaxspatial.dynamics import along, pairs, recursion
from jaxspatial.dynamics.algorithm import DYNAMICS, FRAMES, algorithm
from jaxspatial.dynamics.along import Maybe
from jaxspatial.dynamics.arguments import Wrenches
from jaxspatial.dynamics.coordinates import by_coordinates
from jaxspatial.dynamics.kinematics import world
from jaxspatial.dynamics.links import BodyMotion, across, motion_step, subspace_times, to_parent, world_motion
from jaxspatial.dynamics.loads import loads
from jaxspatial.dynamics.mass_matrix import combine, inertia_to_parent, symmetric_of, with_armature
from jaxspatial.dynamics.recursive_newton_euler import wrench_of
from jaxspatial.dynamics.state import Inertia, Link, Load, MechanismState, Pose
from jaxspatial.inertia import articulated
from jaxspatial.mechanism.topology import Topology
from jaxspatial.spatial import algebra
from jaxspatial.spatial.algebra import force_cross, minus, motion_cross, plus, power, skew, times, twice_crossed

JointRates = tuple[Motion, Motion, Motion, Motion]  # see `_rates`
# (R, p, v) of a body, see `_from_root`.
FromRoot = tuple[Rows, Three, Three]


@algorithm(*DYNAMICS, *FRAMES, entries=lambda t: 5 * t.nv**2)
def derivatives(state: MechanismState, v: Maybe, vdot: Maybe, external_forces: Wrenches):
    """(dtau_dq, dtau_dv, M), (nv, nv) each, q by the steps of `integrate`."""
    return tuple(map(state.rounded, _matrices(state, v, vdot, external_forces)))


@algorithm(*DYNAMICS, *FRAMES, entries=lambda t: 5 * t.nv**2)
def jacobians(
    state: MechanismState, v: Maybe, vdot: Maybe, external_forces: Wrenches, *, wanted: tuple[bool, ...]
) -> list[Any]:
    """Those by q, v and vdot that are wanted, as JAX has them: q by its coordinates, (nv, nq)."""
    dq, dv, M = _matrices(state, v, vdot, external_forces)
    found = (by_coordinates(state, dq) if wanted[0] else None), dv, M
    return [state.rounded(x) for x, yes in zip(found, wanted, strict=True) if yes]


def _matrices(state: MechanismState, v: Maybe, vdot: Maybe, external_forces: Wrenches):
    body_loads = loads(state, external_forces, _load_rate)
    links = state.links(v, vdot)
    motions = recursion.outward(state, motion_step, world_motion(state), links)
    subtrees = _composites(state, links, motions, body_loads)
    placed = recursion.outward(
        state, _from_root, (*world(state), state.no_vector), _with_root_marks(state, links, motions)
    )
    sides = [noinline(_in_world_axes)(*x) for x in zip(links, motions, subtrees, placed, strict=True)]
    rows, columns = ([(b.kind.nv, x[side]) for b, x in zip(state.bundles, sides, strict=True)] for side in (0, 1))
    return _assembled(state, links, pairs.matrices(state, _entries, rows, columns))


# -- composite bodies -------------------------------------------------------------------------------------------------


class Subtree(NamedTuple):
    """The composite body of a subtree, about its J, in the frame that moves with J.

    wrench: the net wrench of all its bodies. p: their momentum. X (3 x 3): an angular velocity y of all of it changes
    the wrench by (X y, 2 y x p), which is twice the Coriolis matrix B. Loads keep their directions: y changes theirs by
    (load_rate y, y x load).
    """

    inertia: Inertia
    wrench: Wrench
    X: Rows
    p: Three
    load_rate: Rows
    load: Three


def _composites(
    state: MechanismState, links: list[Link], motions: list[BodyMotion], body_loads: list[Load]
) -> list[Subtree]:
    """The Subtree of every bundle."""
    own = list(zip(links, motions, body_loads, strict=True))
    zero = state.no_vector
    nothing = Subtree(state.no_inertia, (zero, zero), (zero,) * 3, zero, (zero,) * 3, zero)
    return recursion.inward(state, _composite_step, nothing, own, joined=_combined)


def _load_rate(tau: Three, f: Three, r: Three):
    """The matrix of (matrix y, y x f): the rate of a load at r, fixed in the world, as the body turns with y."""
    about_point = vectors.minus(tau, vectors.cross(r, f))
    return minus(skew(tuple(-x for x in about_point)), twice_crossed(r, f))


def _with_root_marks(state: MechanismState, links: list[Link], motions: list[BodyMotion]):
    return [(*x, b.is_on_world) for *x, b in zip(links, motions, state.bundles, strict=True)]


def _from_root(own: tuple[Link, BodyMotion, bool], parent: FromRoot) -> tuple[FromRoot, FromRoot]:
    """(R, p, v) of a body: as `pairs.from_root`, and its velocity relative to the root."""
    link, motion, is_root = own
    X_PB, _, d = _to_observer(link, motion)
    rows, p, v = parent
    found = (
        vectors.matrix_product(rows, X_PB.rows),
        pairs.at_root(is_root, vectors.plus(p, vectors.matrix_times(rows, X_PB.p))),
        pairs.at_root(is_root, vectors.plus(v, vectors.matrix_times(rows, d))),
    )
    return found, found


def _composite_step(own: tuple[Link, BodyMotion, Load], children: Subtree):
    link, motion, load = own
    subtree = _combined(_of_body(link.inertia, motion, load), children)
    return subtree, _to_parent(link, motion, subtree)


def _of_body(inertia: Inertia, motion: BodyMotion, load: Load):
    """X = -2 [w]x Sigma, with Sigma = (tr J / 2) 1 - J of J about the origin: what is left of Coriolis' matrix where
    the origin rests."""
    tau, f, load_rate = load
    J, _, _ = articulated.of_body(*inertia)
    half_trace = doubled(J[0] + J[2] + J[5], -1)
    sigma = tuple(half_trace - x if i in (0, 2, 5) else -x for i, x in enumerate(J))
    X = vectors.matrix_product(skew(tuple(doubled(-x) for x in motion.w)), symmetric.rows(sigma))
    p = vectors.cross(motion.w, vectors.times(inertia.mass, inertia.com))
    wrench = minus(wrench_of(inertia, motion), (tau, f))
    return Subtree(inertia, wrench, X, p, load_rate, f)


def _to_observer(link: Link, motion: BodyMotion) -> tuple[Pose, Callable[[Three], Three], Three]:
    """(X_PB, a function to the parent's axes, the velocity of J for an observer that the parent's rests for)."""
    X_PB = across(link.placement, link.joint)
    w_r, v_r = subspace_times(link.joint.subspace, link.v)
    turn = functools.partial(vectors.matrix_times, X_PB.rows)
    return X_PB, turn, vectors.plus(vectors.cross(turn(vectors.minus(motion.w, w_r)), X_PB.p), turn(v_r))


def _to_parent(link: Link, motion: BodyMotion, subtree: Subtree):
    X_PB, turn, d = _to_observer(link, motion)
    m, com, _ = subtree.inertia
    p = vectors.plus(turn(subtree.p), vectors.times(m, d))
    shift = plus(twice_crossed(turn(vectors.times(m, com)), d), twice_crossed(X_PB.p, p))
    X = minus(articulated.sandwiched(subtree.X, X_PB.rows), tuple(tuple(doubled(x) for x in row) for row in shift))
    load = turn(subtree.load)
    load_rate = minus(articulated.sandwiched(subtree.load_rate, X_PB.rows), twice_crossed(X_PB.p, load))
    inertia, wrench = inertia_to_parent(X_PB, subtree.inertia), to_parent(X_PB, *subtree.wrench)
    return Subtree(inertia, wrench, X, p, load_rate, load)


def _combined(a: Subtree, b: Subtree):
    parts = (
        plus(a.wrench, b.wrench),
        plus(a.X, b.X),
        vectors.plus(a.p, b.p),
        plus(a.load_rate, b.load_rate),
        vectors.plus(a.load, b.load),
    )
    return Subtree(combine(a.inertia, b.inertia), *parts)


# -- pairs ------------------------------------------------------------------------------------------------------------
#
# Of rate i behind joint j, with Psi' and Psi'' the first and second rates of the motion S of j fixed in
# the parent, S' its own:
#     dtau_i / dq_j = t . Psi'_w + u . Psi'' + l . S_w       dtau_i / dv_j = t . S_w + u . (Psi' + S')
#     dtau_j / dq_i = S . a      a = 2 B Psi'_i + I Psi''_i + S_i x* f, and what loads do
#     dtau_j / dv_i = S . b      b = 2 B S_i + I (Psi'_i + S'_i)
#     M_ij = S . u               u = I S_i          t = the turning part of 2 B^T S_i, l that of loads


def _in_world_axes(
    link: Link, motion: BodyMotion, subtree: Subtree, placed: FromRoot
) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    """(the motions of a joint as rows, its wrenches as columns), of all rates side by side, in world axes."""
    turn = functools.partial(vectors.matrix_times, placed[0])
    where = placed[1:]
    S, first, own, second = _rates(link, motion)
    six = [tuple(map(turn, x)) for x in (S, first, plus(first, own), second)]
    columns = _column(subtree, S, first, own, second)
    return (*six, *where), (*(turn(columns[i : i + 3]) for i in range(0, len(columns), 3)), *where)


def _column(subtree: Subtree, S: Motion, first: Motion, own: Motion, second: Motion) -> Numbers:
    """(u, t, a, b, l), 24 numbers; without l where there are no loads."""
    w, v = S
    transposed = vectors.matrix_times(vectors.transpose(subtree.X), w)
    t = vectors.plus(transposed, tuple(doubled(x) for x in vectors.cross(subtree.p, v)))
    loaded = vectors.matrix_times(vectors.transpose(subtree.load_rate), w)
    loaded = vectors.plus(loaded, vectors.cross(subtree.load, v))
    a = vectors.plus(
        _coriolis(subtree, first[0]), _momentum(subtree.inertia, second), vectors.flat(force_cross(S, subtree.wrench))
    )
    a = vectors.plus(a, (*vectors.matrix_times(subtree.load_rate, w), *vectors.cross(w, subtree.load)))
    b = vectors.plus(_coriolis(subtree, w), _momentum(subtree.inertia, plus(first, own)))
    return *_momentum(subtree.inertia, S), *t, *a, *b, *loaded


def _momentum(inertia: Inertia, motion: Motion):
    """I V, as six numbers."""
    return vectors.flat(algebra.inertia_times(*inertia, *motion))


def _coriolis(subtree: Subtree, y: Three) -> Numbers:
    """2 B of a turning."""
    return *vectors.matrix_times(subtree.X, y), *(doubled(x) for x in vectors.cross(y, subtree.p))


def _entries(row: Any, column: tuple[Three, ...]) -> Numbers:
    """dtau_i / dq_j, dtau_i / dv_j, dtau_j / dq_i, dtau_j / dv_i, M of rates j and i behind j, in the frame of j."""
    S, first, both, second, p, v = row
    u, t, a, b, loaded, p2, v2 = column[:2], column[2], column[3:5], column[5:7], *column[7:]
    arm, d = vectors.minus(p2, p), vectors.minus(v2, v)
    t = vectors.plus(t, tuple(doubled(x) for x in vectors.cross(d, u[1])))
    u, a, b = ((vectors.plus(tau, vectors.cross(arm, f)), f) for tau, f in (u, a, b))
    by_q = vectors.dot(t, first[0]) + vectors.dot(loaded, S[0]) + power(u, second)
    by_v = vectors.dot(t, S[0]) + power(u, both)
    return by_q, by_v, power(a, S), power(b, S), power(u, S)


def _rates(link: Link, motion: BodyMotion) -> JointRates:
    """(S, Psi', S', Psi'') of all rates of a joint side by side, for an observer that J rests for."""
    S, (w_r, v_r) = link.joint.subspace, subspace_times(link.joint.subspace, link.v)
    dw, dv = plus(subspace_times(S, link.vdot), subspace_times(link.joint.subspace_rate(link.v), link.v))
    zero = (numbers.constant(motion.w[0], 0),) * 3
    V, A = (motion.w, zero), (motion.alpha, motion.a)
    before = vectors.minus(motion.w, w_r), tuple(-x for x in v_r)
    across_it = vectors.plus(dw, vectors.cross(motion.w, w_r)), vectors.plus(dv, vectors.cross(motion.w, v_r))
    parents = minus(A, across_it)
    if link.joint.kind.is_sequential:
        return along.abreast(_one_by_one(link, before, parents))
    together = along.abreast(S)
    return together, *_motion_rates(together, before, parents, motion_cross(V, together))


def _one_by_one(link: Link, V: Motion, A: Motion) -> list[JointRates]:
    """As joints with one rate each: V and A are those of the body before each."""
    (w, v), (alpha, a), found = V, A, list[JointRates]()
    for s, rate, change in zip(link.joint.subspace, link.v, link.vdot, strict=True):
        first, own, second = _motion_rates(s, (w, v), (alpha, a), motion_cross((w, v), s))
        found.append((s, first, own, second))
        alpha, a = plus(plus((alpha, a), times(change, s)), times(rate, first))
        w, v = plus((w, v), times(rate, s))
    return found


def _motion_rates(s: Motion, V: Motion, A: Motion, own: Motion) -> tuple[Motion, Motion, Motion]:
    first = motion_cross(V, s)
    w, v = plus(motion_cross(A, s), motion_cross(V, first))
    return first, own, (w, v)


# -- put together -----------------------------------------------------------------------------------------------------


def _assembled(state: MechanismState, links: list[Link], found: Numbers) -> tuple[Number, Number, Number]:
    """(dtau_dq, dtau_dv, M), as numbers (nv, nv, B)."""
    below = jnp.asarray(np.array(_is_behind(state.topology))[:, :, None])
    by_q, by_v = (numbers.where(below, x, _transposed(y)) for x, y in zip(found[2:4], found[:2], strict=True))
    by_q, by_v = (pairs.by_rates(state, pairs.by_rates(state, x, 0), 1) for x in (by_q, by_v))
    return by_q, by_v, with_armature(state, links, symmetric_of(found[4]))


def _transposed(x: Number):
    return along.mapped(lambda w: jnp.swapaxes(w, 0, 1), x)


def _is_behind(t: Topology):
    """(n, n): whether a rate is of a joint after that of another, or after it in a joint that is sequential."""
    joints = [(i, k) for i in range(len(t)) for k in range(t.kind(i).nv)]
    return [[i > j or (i == j and t.kind(i).is_sequential and k > m) for i, k in joints] for j, m in joints]
