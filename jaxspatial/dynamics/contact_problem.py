"""A step with contact as a convex problem, and what of it depends on the configuration.

    v+ = argmin |v - v*|^2_A / 2 + sum l_i(J_i v)        A = M + dt C, with v* the velocities without contact

There is one term l_i for each contact, for each joint with limits or dry friction, and for each row of a loop closure.
Its derivative is the impulse: gamma_i = -dl_i/dv_i at the velocity v_i = J_i v; its second derivative
G_i = -dgamma_i/dv_i is never negative.

Everything is in world axes, about the origins of joints: passes over the tree move spatial vectors without turning
them. [Castro, Permenter, Han 2022, An unconstrained convex formulation of compliant contact; Drake 1.51, SapDriver]
"""

import functools
import itertools
import operator
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics.articulated_bodies import has_floating_roots
from jaxspatial.dynamics.composite_bodies import combined
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState, across
from jaxspatial.inertia import articulated
from jaxspatial.inertia.articulated import Articulated
from jaxspatial.mechanism.topology import Bundle, Topology
from jaxspatial.numerics import check
from jaxspatial.numerics.linear import Inertia, Matrix, Motion, Pose, Symmetric, Vector, Wrench, congruence, cross, dot
from jaxspatial.numerics.numbers import (
    Mask,
    Number,
    Numbers,
    constant,
    data_of,
    high,
    is_constant,
    is_number,
    where,
    with_data,
)
from jaxspatial.spatial import algebra

T = TypeVar("T")
# Drake's numbers: how much softer than rigid contacts are in the near-rigid regime, in units of the Delassus operator
# along the normal and along the tangents, the same for limits, and the impulse by which friction is smoothed.
NEAR_RIGID, STICKING, NEAR_RIGID_LIMIT = 1.0 / (4 * np.pi**2), 1e-3, 0.1**2 / (4 * np.pi**2)
SMOOTHED = 1e-14
# Stiffness of limits, and how many steps ahead they are seen.
LIMIT_STIFFNESS, LIMIT_WINDOW = 1e12, 2.0
# Two bodies with less mobility against each other than this, in eps of that of each, do not move.
MOBILE = 1e3


class Centres(NamedTuple):
    """Centres of n spheres on frames, as arrays (*batch, 3 n). positions: in the frames; None for the origins. offsets:
    from the centres to the contact points C, in world axes."""

    positions: Array | None
    offsets: Array


class Touching(NamedTuple):
    """The contacts of a step, as arrays (*batch, n) or (*batch, 3 n): n spheres on frames.

    others: of the spheres that the last of them touch; all but these touch the ground. normals: out of the ground or of
    the other sphere, in world axes. distances: between the surfaces, negative inside.
    """

    centres: Centres
    others: Centres | None
    normals: Array
    distances: Array
    stiffness: Array
    relaxation_time: Array
    friction: Array


class Closing(NamedTuple):
    """The k rows of loop closures in a step, as arrays: what closures hold at zero, see `closed_loops`.

    turning, moving (*batch, 3 k): N of the twist of frame B for an observer on A, about the origin of B in world axes.
    errors (*batch, k): rad, m. p_AB_W (*batch, 3 n): of n closures.
    """

    turning: Array
    moving: Array
    errors: Array
    p_AB_W: Array


class Closure(NamedTuple):
    """Frames of a loop closure, by number, and how many of its rows hold orientations and positions."""

    frame_a: int
    frame_b: int
    n_turning: int
    n_moving: int


class Where(NamedTuple):
    """The frames that contacts are on, the frames of the others that the last of them touch, and loop closures."""

    frames: tuple[int, ...] = ()
    others: tuple[int, ...] = ()
    closures: tuple[Closure, ...] = ()


class Ends(NamedTuple):
    """The bodies b and a that each of n terms acts between, -1 for the world."""

    b: list[int]
    a: list[int]

    @property
    def between_bodies(self) -> np.ndarray:
        """Which terms act between two bodies."""
        return np.flatnonzero(np.array(self.a) >= 0)


class Body(NamedTuple):
    """The bodies of a bundle. R: their axes. r: positions from the parent's origin.

    S: the motions of each velocity of their joints. resistance: armature, and dt times the damping of the joint.
    turns: whether velocities are along the axes of the world, and not along those of the bodies: of floating roots,
    whose motions S are then known.
    """

    R: Matrix
    r: Vector
    S: tuple[Motion, ...]
    inertia: Inertia
    resistance: Numbers
    turns: bool


def is_nan(x: Number) -> Mask:
    return high(x) != high(x)


# -- bodies -----------------------------------------------------------------------------------------------------------


def bodies_in_world(state: MechanismState, dt: Number) -> list[Body]:
    """The Body of every bundle. dt: (1, B)."""
    links = [
        x._replace(tau=state.own(b, state.fields["damping"])) for x, b in zip(state.links(), state.bundles, strict=True)
    ]
    frames = [(link.placement, link.joint, b.is_on_world) for link, b in zip(links, state.bundles, strict=True)]
    placed = recursion.outward(state, _placed, state.world.R, frames)
    dt = stacking.mapped(lambda w: w[None], dt)
    return [_body(state, b, x, link, dt) for b, x, link in zip(state.bundles, placed, links, strict=True)]


def _placed(frame: Any, R_P: Matrix) -> tuple[tuple[Matrix, Vector], Matrix]:
    """((R, r) of a body, R)."""
    placement, joint, is_root = frame
    X_PB = across(placement, joint)
    R = R_P @ X_PB.R
    return (R, matrices.zero_at_root(is_root, R_P @ X_PB.p)), R


def _body(state: MechanismState, bundle: Bundle, placed: Any, link: Link, dt: Number) -> Body:
    R, r = placed
    S, inertia, resistance = _in_world(R, link, dt)
    # The time is the same for all rows.
    resistance = stacking.mapped(lambda w: jnp.broadcast_to(w, (bundle.length, *w.shape[1:])), resistance)
    turns = has_floating_roots(bundle) and all(is_constant(x) and x.value == 0 for x in resistance)
    if turns:
        e = state.world.R
        zero = state.zero_vector
        S = (*(Motion(x, zero) for x in e), *(Motion(zero, x) for x in e))
    return Body(R, r, S, inertia, resistance, turns)


def _in_world(R: Matrix, link: Link, dt: Number) -> tuple[tuple[Motion, ...], Inertia, Numbers]:
    S = tuple(Motion(R @ s.w, R @ s.v) for s in link.joint.subspace)
    M = link.inertia
    resistance = tuple(a + dt * c for a, c in zip(link.armature, link.tau, strict=True))
    return S, Inertia(M.mass, R @ M.com, congruence(R, M.central)), resistance


def turned(state: MechanismState, bodies: list[Body], x: Number, to_world: bool) -> Number:
    """Velocities (nv, B) with those of floating roots in world axes, from those along the axes of bodies; or back."""
    if not any(body.turns for body in bodies):
        return x
    of_bundles = [own_of_bundle(state, k, x) for k in range(len(bodies))]
    return state.numbers_by_velocity(
        [_turned(b.R if to_world else b.R.T, y) if b.turns else y for b, y in zip(bodies, of_bundles, strict=True)]
    )


def _turned(R: Matrix, six: Numbers) -> Numbers:
    return (*(R @ Vector(*six[:3])), *(R @ Vector(*six[3:])))


def velocities(state: MechanismState, bodies: list[Body], fields: Sequence[Number]) -> list[tuple[Motion, ...]]:
    """The velocity of every bundle for each of several vectors (nv, B) of generalized velocities."""
    of_bundles = [[of_bundle(state, k, x) for x in fields] for k in range(len(bodies))]
    at_rest = tuple(Motion(state.zero_vector, state.zero_vector) for _ in fields)
    both = [(body.S, body.r, x) for body, x in zip(bodies, of_bundles, strict=True)]
    return recursion.outward(state, _velocity, at_rest, both)


def _velocity(body: Any, parent: tuple[Motion, ...]) -> tuple[Any, Any]:
    S, r, fields = body
    found = []
    for V, x in zip(parent, fields, strict=True):
        V = algebra.shifted_motion(V, r)
        for s, rate in zip(S, x, strict=True):
            V = V + rate * s
        found.append(V)
    return tuple(found), tuple(found)


def of_bundle(state: MechanismState, k: int, x: Number) -> Numbers:
    """The velocities of bundle k among generalized velocities (nv, B)."""
    b = state.bundles[k]
    rates = _rows_of_bundle(state, b, x)
    if not state.topology.has_mimics_in(b):
        return rates
    multiplier, _ = state.mimics(b)
    return tuple(multiplier * y for y in rates)


def own_of_bundle(state: MechanismState, k: int, x: Number) -> Numbers:
    """The numbers of bundle k among numbers (nv, B), zeros for mimics."""
    t, b = state.topology, state.bundles[k]
    numbers = _rows_of_bundle(state, b, x)
    if not t.has_mimics_in(b):
        return numbers
    is_own = jnp.asarray(~np.vectorize(t.is_mimic)(b.bodies)[:, :, None])
    return tuple(where(is_own, y, 0.0) for y in numbers)


def _rows_of_bundle(state: MechanismState, b: Bundle, x: Number) -> Numbers:
    places = b.places(state.topology.v_starts, b.kind.nv)
    # It is pulled back as one stack; rows that are taken one by one, as many arrays of zeros but for one row.
    words = (jnp.unstack(stacking.rows(w, places), axis=2) for w in data_of(x))
    return (x,) * b.kind.nv if is_constant(x) else tuple(with_data(x, each) for each in zip(*words, strict=True))


# -- the diagonal of A, and of the Delassus operator ------------------------------------------------------------------


def diagonals(state: MechanismState, bodies: list[Body]) -> list[Numbers]:
    """The diagonal of A: for every bundle a number of each velocity."""
    links = [(body.inertia, body.r) for body in bodies]
    composites = recursion.inward(state, _composite, state.zero_inertia, links, join=combined)
    return [_diagonal(body.S, body.resistance, M) for body, M in zip(bodies, composites, strict=True)]


def _composite(body: tuple[Inertia, Vector], children: Inertia) -> tuple[Inertia, Inertia]:
    """The composite inertia of a body and its children: (about its origin, about that of its parent)."""
    M = combined(body[0], children)
    return M, Inertia(M.mass, M.com + body[1], M.central)


def _diagonal(S: Sequence[Motion], resistance: Numbers, M: Inertia) -> Numbers:
    return tuple(algebra.power(algebra.apply_inertia(M, s), s) + a for s, a in zip(S, resistance, strict=True))


def mobilities(state: MechanismState, bodies: list[Body], diagonal: list[Numbers]) -> list[Articulated]:
    """S D^-1 S^T of the velocities that carry each body, with D the diagonal of A.

    As an Articulated with velocities in place of torques and angular velocities in place of forces: both move to
    another point alike.
    """
    nothing = articulated.none(state.known(0.0))
    both = [(body.S, body.r, d) for body, d in zip(bodies, diagonal, strict=True)]
    return recursion.outward(state, _mobility, nothing, both)


def _mobility(body: Any, parent: Articulated) -> tuple[Articulated, Articulated]:
    S, r, diagonal = body
    whole = articulated.shifted(parent, r)
    for s, d in zip(S, diagonal, strict=True):
        U = Wrench(s.v, s.w)
        UDinv = articulated.UDinv_of(U, d)
        whole = articulated.rank_one_downdate(whole, U, -UDinv)
    return whole, whole


# -- mimics -----------------------------------------------------------------------------------------------------------


class Units(NamedTuple):
    """How bodies move at each unit of the generalized velocities, and A: what mechanisms with mimics have in place of
    recursions, as a generalized velocity moves bodies in several places.

    state: of nv times as many states: velocity after velocity, each in all states. x: (nv, nv B), these velocities.
    motions: of every bundle. A: (nv, nv, B). diagonal: of A, (nv, B).
    """

    state: MechanismState
    x: Number
    motions: list[Motion]
    A: Number
    diagonal: Number


def units_of(state: MechanismState, bodies: list[Body]) -> Units:
    n, nv = state.n, state.topology.nv
    wide, repeated = state.of_size(n * nv), tiled(bodies, n, nv)
    wide.fields = {**state.fields, "mimics": tiled(state.fields["mimics"], n, nv)}
    (x,) = wide.numbers(jnp.repeat(jnp.eye(nv, dtype=state.dtype), n, axis=1)[:, None])
    motions = [V for (V,) in velocities(wide, repeated, [x])]
    momenta = [
        momentum(body.inertia, V, body.resistance, of_bundle(wide, k, x))
        for k, (body, V) in enumerate(zip(repeated, motions, strict=True))
    ]
    A = stacking.mapped(lambda w: w.reshape((nv, nv, n)), generalized(wide, repeated, momenta))
    diagonal = stacking.concatenated([stacking.mapped(lambda w, i=i: w[i, i][None], A) for i in range(nv)])
    return Units(wide, x, motions, A, diagonal)


def tiled(tree: T, n: int, k: int) -> T:
    """Numbers of n states as those of k times n: of all states, again and again."""

    def repeated(w: jax.Array) -> jax.Array:
        return jnp.tile(w, (*[1] * (w.ndim - 1), k)) if w.shape[-1] == n != 1 else w

    return stacking.mapped(repeated, tree)


class Force(NamedTuple):
    """Forces on the bodies of a bundle, about their origins in world axes, and on the velocities of their joints."""

    on_bodies: Wrench
    on_joints: Numbers


def momentum(M: Inertia, V: Motion, resistance: Numbers, x: Numbers) -> Force:
    return Force(algebra.apply_inertia(M, V), tuple(a * rate for a, rate in zip(resistance, x, strict=True)))


def generalized(state: MechanismState, bodies: list[Body], forces: list[Force]) -> Number:
    """The generalized forces (nv, B) of forces on the bodies of every bundle."""
    nothing = Wrench(state.zero_vector, state.zero_vector)
    links = [(body.S, body.r, F) for body, F in zip(bodies, forces, strict=True)]
    return state.numbers_by_velocity(recursion.inward(state, _at_joint, nothing, links))


def _at_joint(link: Any, children: Wrench) -> tuple[Numbers, Wrench]:
    """(the forces at a joint, the wrench on its body and all that hang on it, about the parent's origin)."""
    S, r, (on_body, on_joint) = link
    F = on_body + children
    return tuple(algebra.power(F, s) + f for s, f in zip(S, on_joint, strict=True)), algebra.shifted_wrench(F, -r)


def _mobility_of_units(
    units: Units, n: int, ends: Ends, arm_b: Vector, arm_a: Vector
) -> tuple[Articulated, Articulated]:
    """`relative_mobility`, without the coupling of turning and moving: sums over all generalized velocities."""
    state, m, nv = units.state, len(ends.b), units.state.topology.nv
    at_rest = Motion(state.zero_vector, state.zero_vector)

    def by_velocity(bodies: list[int], arm: Vector) -> Motion:
        V = algebra.shifted_motion(state.of_bodies(bodies, units.motions, at_rest), tiled(arm, n, nv))
        each = jax.tree.map(lambda x: stacking.spread(x, (m, state.n)), V, is_leaf=is_number)
        return stacking.mapped(lambda w: jnp.moveaxis(w.reshape((m, nv, n)), 1, 0), each)

    def total(V: Motion) -> Articulated:
        sums = jax.tree.map(stacking.pairwise_sum, _squares(V, D), is_leaf=is_number)
        return Articulated(sums[0], articulated.none(state.known(0.0)).F, sums[1])

    D = stacking.mapped(lambda w: w[:, None], units.diagonal)
    V_b, V_a = by_velocity(ends.b, arm_b), by_velocity(ends.a, arm_a)
    return total(V_b - V_a), total(V_b) + total(V_a)


def _squares(V: Motion, D: Number) -> tuple[Symmetric, Symmetric]:
    """(v v^T / D, w w^T / D); 0 where D is not positive."""
    is_none = high(D) <= 0
    scale = where(is_none, 0.0, 1 / where(is_none, 1.0, D))

    def square(v: Vector) -> Symmetric:
        x, y, z = v
        return Symmetric(*(a * (scale * b) for a, b in ((x, x), (x, y), (y, y), (x, z), (y, z), (z, z))))

    return square(V.v), square(V.w)


# -- between bodies ---------------------------------------------------------------------------------------------------


def relative_mobility(
    state: MechanismState,
    bodies: list[Body],
    mobility: list[Articulated] | Units,
    ends: Ends,
    arm_b: Vector,
    arm_a: Vector,
) -> tuple[Articulated, Articulated]:
    """J D^-1 J^T of the motion of bodies b for observers on bodies a, about points: numbers (n, B); and the same as if
    they moved on their own.

    arm_b, arm_a: the points, from the origins of b and a. What carries both bodies moves neither for the other.
    """
    if isinstance(mobility, Units):
        return _mobility_of_units(mobility, state.n, ends, arm_b, arm_a)
    nothing = articulated.none(state.known(0.0))
    whole = articulated.shifted(state.of_bodies(ends.b, mobility, nothing), arm_b)
    if not len(ends.between_bodies):
        return whole, whole
    t = state.topology
    common, from_common = list[int](), list[Vector]()
    for b, a in zip(*ends, strict=True):
        behind = [i for i in t.ancestors(b) if i not in set(t.ancestors(a))]
        common.append(t.parents[behind[-1]] if behind else b)
        arms = [state.of_bodies([i], [body.r for body in bodies], state.zero_vector) for i in behind]
        from_common.append(functools.reduce(operator.add, arms, state.zero_vector))
    whole = whole + articulated.shifted(state.of_bodies(ends.a, mobility, nothing), arm_a)
    arm = arm_b + stacking.concatenated_trees(from_common, state.n)
    return whole - 2.0 * articulated.shifted(state.of_bodies(common, mobility, nothing), arm), whole


def _reach(state: MechanismState, bodies: list[Body], ends: Ends, arm: Vector, arm_a: Vector, normal: Vector) -> Number:
    """The size of what distances between points along normals are sums of: positions of roots along the normal, and all
    of the arms behind them, which the bodies have turned."""
    roots = [(body.r, b.is_on_world) for body, b in zip(bodies, state.bundles, strict=True)]
    reaches = recursion.outward(state, _reached, (state.zero_vector, state.known(0.0)), roots)
    total = state.known(0.0)
    for of_ends, own in ((ends.b, arm), (ends.a, arm_a)):
        root, arms = state.of_bodies(of_ends, reaches, (state.zero_vector, state.known(0.0)))
        total = total + abs(dot(root, normal)) + arms + _length_of(own)
    return total


def _reached(body: Any, parent: tuple[Vector, Number]) -> tuple[Any, Any]:
    r, is_root = body
    root, arms = parent
    reach = (r, arms) if is_root else (root, arms + _length_of(r))
    return reach, reach


def _length_of(r: Vector) -> Number:
    x, y, z = map(abs, r)
    return x + y + z


def _size(S: Symmetric) -> Number:
    """The Frobenius norm over 3."""
    xx, xy, yy, xz, yz, zz = S
    return dot((xx, yy, zz, xy + xy, xz + xz, yz + yz), (xx, yy, zz, xy, xz, yz)).sqrt() / 3


# -- contacts ---------------------------------------------------------------------------------------------------------


class Contacts(NamedTuple):
    """n contacts, as numbers (n, B). arm, arm_a: from the origins of bodies b and a to C. free: the velocity along the
    normal at which there is no impulse. R_n, R_t: how much an impulse changes velocities along the normal and the
    tangents. noise: rounding errors of `free`, in eps: those of positions along the chain of bodies."""

    arm: Vector
    arm_a: Vector
    normal: Vector
    is_touching: Mask
    free: Number
    R_n: Number
    R_t: Number
    friction: Number
    noise: Number


def contacts_of(
    state: MechanismState,
    bodies: list[Body],
    mobility: list[Articulated] | Units,
    at: Where,
    touching: Touching,
    dt: Number,
) -> tuple[Contacts, Ends]:
    """The Contacts, and the bodies that they are between. dt: (1, B)."""
    n, n_ground = len(at.frames), len(at.frames) - len(at.others)
    ends = Ends(state.topology.bodies_of(at.frames), [-1] * n_ground + state.topology.bodies_of(at.others))
    arm, arm_a = _arms(state, bodies, at.frames, touching.centres), state.zero_vector
    if touching.others is not None:
        places = np.array([n] * n_ground + list(range(n - n_ground)))
        own = _arms(state, bodies, at.others, touching.others)
        arm_a = stacking.mapped(lambda w: with_zero_rows(jnp.broadcast_to(w, (n - n_ground, state.n)), places), own)
    scalars = (
        _scalars(state, x)
        for x in (touching.distances, touching.stiffness, touching.relaxation_time, touching.friction)
    )
    distance, stiffness, relaxation_time, friction = scalars
    w = _size(relative_mobility(state, bodies, mobility, ends, arm, arm_a)[0].J)
    free, R_n, R_t = _regularisation(w, distance, stiffness, relaxation_time, dt)
    normal = state.vectors(touching.normals)
    # What cannot move has no law: its R_t is zero. NaN, of any number, is not outside.
    is_inside = ~(high(distance) > 0) & (high(w) != 0)
    for x in (stiffness, dt + relaxation_time, friction):
        is_inside = is_inside if is_constant(x) else is_inside | is_nan(x)
    noise = _reach(state, bodies, ends, arm, arm_a, normal) / (dt + relaxation_time)
    return Contacts(arm, arm_a, normal, is_inside, free, R_n, R_t, friction, noise), ends


def _arms(state: MechanismState, bodies: list[Body], frames: tuple[int, ...], centres: Centres) -> Vector:
    R = state.of_bodies(state.topology.bodies_of(frames), [body.R for body in bodies], state.world.R)
    return _arm(R, state.frame_placements(frames), state.vectors(centres.positions), state.vectors(centres.offsets))


def on_bundles(state: MechanismState, carriers: list[int], tree: T, nothing: T) -> list[T]:
    """Numbers (n, B) of n bodies as those of every bundle: their sums where a body comes several times.

    Known numbers are zeros; the body -1 is the world. nothing: known zeros, for bundles without any of the bodies.
    """
    bodies = sorted(set(carriers) - {-1})
    if not bodies:
        return [nothing] * len(state.bundles)
    of_body = [[k for k, c in enumerate(carriers) if c == body] for body in bodies]
    most = max(map(len, of_body))
    # Row n is zero.
    places = np.array([[x[k] if k < len(x) else len(carriers) for x in of_body] for k in range(most)])
    sums = jax.tree.map(lambda x: _summed(x, places, (len(carriers), state.n)), tree, is_leaf=is_number)
    return [_on_bundle(state, b, bodies, sums, nothing) for b in state.bundles]


def _summed(x: Number, places: np.ndarray, shape: tuple[int, int]) -> Number:
    if is_constant(x):
        return x
    x = stacking.mapped(lambda w: with_zero_rows(jnp.broadcast_to(w, shape), places.ravel()), x)
    whole = stacking.mapped(lambda w: w.reshape((*places.shape, shape[1])), x)
    return stacking.pairwise_sum(whole) if len(places) > 1 else stacking.mapped(lambda w: w[0], whole)


def _on_bundle(state: MechanismState, bundle: Bundle, bodies: list[int], sums: T, nothing: T) -> T:
    none = len(bodies)
    places = np.array([bodies.index(i) if i in bodies else none for i in bundle.bodies.ravel().tolist()])
    if (places == none).all():
        return nothing
    shape = *bundle.bodies.shape, -1
    return stacking.mapped(lambda w: with_zero_rows(w, places).reshape(shape), sums)


def with_zero_rows(x: jax.Array, places: np.ndarray) -> jax.Array:
    """x[places] (m, B), with rows of zeros for the place len(x)."""
    pieces = list[Any]()
    for is_zero, run in itertools.groupby(places.tolist(), lambda k: k >= len(x)):
        rows = list(run)
        shape = len(rows), *x.shape[1:]
        pieces.append(lax.full(shape, 0, x.dtype) if is_zero else stacking.rows(x, np.array(rows)))
    return pieces[0] if len(pieces) == 1 else jnp.concatenate(pieces)


def _scalars(state: MechanismState, array: Array) -> Number:
    return state.numbers(array[:, None])[0]


def _arm(R: Matrix, X_JF: Pose, centre: Vector, offset: Vector) -> Vector:
    return R @ (X_JF.p + X_JF.R @ centre) + offset


def _regularisation(w: Number, distance: Number, stiffness: Number, relaxation_time: Number, dt: Number):
    """(the free velocity along the normal, R_n, R_t)."""
    memory = dt + relaxation_time
    compliant, rigid = 1 / (dt * stiffness * memory), NEAR_RIGID * w
    return -distance / memory, where(high(rigid) > high(compliant), rigid, compliant), STICKING * w


class Law(NamedTuple):
    """The impulse of a contact, and G = normal n n^T + mixed (n t^T + t n^T) + across (1 - n n^T) + along t t^T."""

    impulse: Vector
    t: Vector
    normal: Number
    mixed: Number
    across: Number
    along: Number


def law(contacts: Contacts, v: Vector, held: Mask | None = None) -> Law:
    """The Law at velocities v of the contact points: projection on the cone of friction in the norm of R.

    y = (free n - v) / R sticks where |y_t| <= mu y_n, with impulse y. Else it slides, or there is no impulse.
    [Castro, Permenter, Han 2022, 3.2]

    held: contacts that stick wherever y is.
    """
    n, mu, R_n, R_t = contacts.normal, contacts.friction, contacts.R_n, contacts.R_t
    along_normal = dot(n, v)
    y_n, y_t = (contacts.free - along_normal) / R_n, (along_normal * n - v) / R_t
    length = (dot(y_t, y_t) + SMOOTHED).sqrt()
    t = y_t / length
    steep = mu * R_t / R_n
    share = 1 / (1 + mu * steep)
    sliding = (y_n + steep * length) * share
    sticks = contacts.is_touching & (high(length) <= high(mu * y_n))
    sticks = sticks if held is None else sticks | held
    # NaN slides, and becomes the impulse.
    slides = contacts.is_touching & ~sticks & ~(high(y_n + steep * length) <= 0)
    zero = constant(y_n, 0)

    def chosen(stick: Number, slide: Number) -> Number:
        return where(sticks, stick, where(slides, slide, zero))

    normal_impulse, size = chosen(y_n, sliding), chosen(length, mu * sliding)
    mixed = chosen(zero, mu * share / R_n)
    turning = mu * sliding / (length * R_t)
    return Law(
        normal_impulse * n + size * t,
        t,
        chosen(1 / R_n, share / R_n),
        mixed,
        chosen(1 / R_t, turning),
        chosen(zero, mu * steep * share / R_t - turning),
    )


def times_G(contacts: Contacts, of_law: Law, v: Vector) -> Vector:
    """G v."""
    n, t = contacts.normal, of_law.t
    v_n, v_t = dot(n, v), dot(t, v)
    return (
        ((of_law.normal - of_law.across) * v_n + of_law.mixed * v_t) * n
        + (of_law.mixed * v_n + of_law.along * v_t) * t
        + of_law.across * v
    )


def rounding_of_contacts(contacts: Contacts, of_law: Law) -> Number:
    """What rounding errors of `free` are in g^T H^-1 g, in eps^2."""
    return contacts.noise * contacts.noise * of_law.normal


def matrix_G(contacts: Contacts, of_law: Law) -> Symmetric:
    """G."""
    n, t, c = contacts.normal, of_law.t, of_law
    a, k = c.normal - c.across, c.across

    def entry(i: int, j: int) -> Number:
        x = a * (n[i] * n[j]) + c.mixed * (n[i] * t[j] + t[i] * n[j]) + c.along * (t[i] * t[j])
        return x + k if i == j else x

    return Symmetric(entry(0, 0), entry(0, 1), entry(1, 1), entry(0, 2), entry(1, 2), entry(2, 2))


def at_points(contacts: Contacts, V_b: Motion, V_a: Motion) -> Vector:
    """The velocities of contact points on bodies b, for observers on bodies a."""
    return V_b.v + cross(V_b.w, contacts.arm) - (V_a.v + cross(V_a.w, contacts.arm_a))


# -- limits and dry friction of joints --------------------------------------------------------------------------------


class Joints(NamedTuple):
    """m velocities with limits or dry friction, as numbers (m, B).

    lower, upper: how fast, at most, a joint may approach a limit. near_lower, near_upper: whether a limit is near, and
    may act. friction: the largest impulse of dry friction, a known zero without. R, R_f: how much an impulse of a
    limit, and of friction, changes the velocity.
    """

    lower: Number
    upper: Number
    near_lower: Mask
    near_upper: Mask
    friction: Number
    R: Number
    R_f: Number


def rows_of_joints(topology: Topology, fields: Mapping[str, Any]) -> np.ndarray:
    """The velocities (m,) on which limits or dry friction may act. fields: numbers of the mechanism, by name.

    Limits act on joints of one coordinate, whose rate is their velocity.
    """
    rows = list[int]()
    for i in (i for i in range(len(topology)) if not topology.is_mimic(i)):
        own = topology.v_slice(i)
        if _has_limits(topology, fields, i) or not _is_known(fields["friction_loss"], own, 0):
            rows += range(own.start, own.stop)
    return np.array(rows, int)


def _has_limits(topology: Topology, fields: Mapping[str, Any], i: int) -> bool:
    kind, places = topology.kind(i), topology.q_slice(i)
    is_simple = kind.nq == kind.nv == 1 and not kind.rates_need_angles
    unlimited = (_is_known(fields[k], places, x) for k, x in (("lower", -np.inf), ("upper", np.inf)))
    return is_simple and not all(unlimited)


def _is_known(x: Array, places: slice, number: float) -> bool:
    return isinstance(x, np.ndarray) and bool((x[places] == number).all())


def joints_of(state: MechanismState, rows: np.ndarray, diagonal: Number, fastest: Number, dt: Number) -> Joints:
    """The Joints of these velocities. diagonal: of A, fastest: the larger of |v| and |v*|, both (nv, B). dt: (1, B)."""
    t, fields = state.topology, state.fields
    own = (i for i in range(len(t)) if not t.is_mimic(i))
    body = {v: i for i in own for v in range(t.v_slice(i).start, t.v_slice(i).stop)}
    has_limits = np.array([_has_limits(t, fields, body[v]) for v in rows])
    q_rows = np.array([t.q_starts[body[v]] for v in rows])
    q, lower, upper, friction = (
        _scalars(state, stacking.rows(x, places))
        for x, places in (
            (state.q, q_rows),
            (fields["lower"], q_rows),
            (fields["upper"], q_rows),
            (fields["friction_loss"], rows),
        )
    )
    w, fastest = (stacking.mapped(lambda x: stacking.rows(x, rows), y) for y in (1 / diagonal, fastest))
    return _joints(q, lower, upper, friction, w, fastest, dt, has_limits)


def _joints(
    q: Number, lower: Number, upper: Number, friction: Number, w: Number, fastest: Number, dt: Number, has_limits: Any
) -> Joints:
    compliant, rigid = 1 / (2 * LIMIT_STIFFNESS * (dt * dt)), NEAR_RIGID_LIMIT * w
    R = where(high(rigid) > high(compliant), rigid, compliant)
    window = LIMIT_WINDOW * dt * fastest
    near, speeds = list[Any](), list[Any]()
    for gap in (q - lower, upper - q):
        # NaN is near, and becomes the impulse.
        near.append(~(high(gap) >= high(window)) & has_limits[:, None])
        speeds.append(where(near[-1], gap, 0.0) / (2 * dt))
    (lower_speed, upper_speed), (near_lower, near_upper) = speeds, near
    return Joints(lower_speed, upper_speed, near_lower, near_upper, friction * dt, R, STICKING * w)


def joint_law(joints: Joints, v: Number) -> tuple[Number, Number]:
    """(the impulses of joints at velocities v (m, B), their G)."""
    zero = constant(v, 0)
    down, up = (-joints.lower - v) / joints.R, (v - joints.upper) / joints.R
    is_down, is_up = joints.near_lower & ~(high(down) <= 0), joints.near_upper & ~(high(up) <= 0)
    stuck = -v / joints.R_f
    largest = joints.friction
    is_stuck = high(abs(stuck)) < high(largest)
    slipping = where(high(stuck) > 0, largest, -largest)
    impulse = where(is_down, down, zero) - where(is_up, up, zero) + where(is_stuck, stuck, slipping)
    return impulse, where(is_down | is_up, 1 / joints.R, zero) + where(is_stuck, 1 / joints.R_f, zero)


# -- loop closures ----------------------------------------------------------------------------------------------------


class Loops(NamedTuple):
    """k rows of loop closures, as numbers (k, B). on_b, on_a: the wrenches on bodies b and a of a unit impulse, about
    their origins. free: the velocity at which there is no impulse. R: how much an impulse changes the velocity.

    noise, loss: rounding errors of `free` in eps, and those of its difference from a velocity, in eps of that: these
    come from R and from momenta."""

    on_b: Wrench
    on_a: Wrench
    free: Number
    R: Number
    noise: Number
    loss: Number


def loops_of(
    state: MechanismState,
    bodies: list[Body],
    mobility: list[Articulated] | Units,
    closures: tuple[Closure, ...],
    closing: Closing,
    dt: Number,
) -> tuple[Loops, Ends]:
    """The Loops, and the bodies that each row is between. dt: (1, B)."""
    frames_a, frames_b = tuple(c.frame_a for c in closures), tuple(c.frame_b for c in closures)
    arm_b = _arms(state, bodies, frames_b, Centres(None, np.zeros(3 * len(closures), state.dtype)))
    arm_a = _arms(state, bodies, frames_a, Centres(None, closing.p_AB_W))
    ends = Ends(*map(state.topology.bodies_of, (frames_b, frames_a)))
    both = relative_mobility(state, bodies, mobility, ends, arm_b, arm_a)
    sizes = [stacking.concatenated_trees([_size(P.M), _size(P.J)], state.n, [len(closures)] * 2) for P in both]
    # Of each row the closure, and whether it holds a position.
    of_row = np.array([k for k, c in enumerate(closures) for _ in range(c.n_turning + c.n_moving)])
    moves = np.array([i >= c.n_turning for c in closures for i in range(c.n_turning + c.n_moving)])
    w, alone = stacking.mapped(lambda x: stacking.rows(x, of_row + len(closures) * moves), sizes)
    arm_b, arm_a = stacking.mapped(
        lambda x: stacking.rows(jnp.broadcast_to(x, (len(closures), state.n)), of_row), (arm_b, arm_a)
    )
    N = Wrench(state.vectors(closing.turning), state.vectors(closing.moving))
    ends = Ends([ends.b[k] for k in of_row], [ends.a[k] for k in of_row])
    # An angle is of 1 rad.
    size = where(jnp.asarray(moves[:, None]), _reach(state, bodies, ends, arm_b, arm_a, N.f), 1.0)
    loops = _loops(N, arm_b, arm_a, _scalars(state, closing.errors), size, w, alone, dt)
    return loops, ends


def _loops(
    N: Wrench, arm_b: Vector, arm_a: Vector, error: Number, size: Number, w: Number, apart: Number, dt: Number
) -> Loops:
    on_b, on_a = (algebra.shifted_wrench(N, -arm) for arm in (arm_b, arm_a))
    # Where the two cannot move against each other, w is made of rounding errors, and nothing closes an error.
    least = MOBILE * check.eps(high(w).dtype) * apart
    moves = ~(high(w) <= high(least)) | is_nan(error)
    whole = where(moves, w, where(high(apart) > 0, least, 1.0))
    # A momentum is as large as the impulse, and changes velocities by w of it.
    noise, loss = where(moves, size, 0.0) / dt, where(moves, apart / whole + NEAR_RIGID_LIMIT**-0.5, 0.0)
    return Loops(on_b, -on_a, where(moves, -error, 0.0) / dt, NEAR_RIGID_LIMIT * whole, noise, loss)


def along_rows(loops: Loops, V_b: Motion, V_a: Motion) -> Number:
    """The velocities that closures hold at zero."""
    return algebra.power(loops.on_b, V_b) + algebra.power(loops.on_a, V_a)


def loop_law(loops: Loops, v: Number) -> tuple[Number, Number]:
    """(the impulses of closures at velocities v (k, B), their G)."""
    return (loops.free - v) / loops.R, 1 / loops.R


def rounding_of_loops(loops: Loops, v: Number) -> Number:
    """What rounding errors of closures are in g^T H^-1 g at velocities v (k, B), at most, in eps^2: H is at least
    J^T R^-1 J."""
    x = loops.noise + loops.loss * abs(loops.free - v)
    return x * x / loops.R
