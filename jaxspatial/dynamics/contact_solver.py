"""Newton's method for the convex problem of a step, by articulated bodies.

H = A + sum J_i^T G_i J_i is the mass matrix of the same mechanism with the inertia X^T diag(0, G) X added to each body
in contact, and with G added to the armature of joints at limits: a direction is one pass of the articulated-body
algorithm. Neither H nor any Jacobian is ever formed.

With y = v - v0 the change of the velocities, y* = v* - v0 that without contact, and r the share of y* that y lacks, the
gradient at every iterate is

    g = -(r A y* + sum J_i^T (gamma_i - phi_i)),        r = 1, phi = 0 at first

so that a direction d = r y* + e has the right side H e = sum J_i^T (gamma_i - phi_i - r G_i J_i y*), and a step of
length a along it is r -> (1 - a) r, phi_i -> (1 - a) phi_i + a (gamma_i - G_i J_i d). A line search, too, sees nothing
but the velocities of contact points and joints. [Castro, Permenter, Han 2022, 4]
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics import contact_problem as problem
from jaxspatial.dynamics.articulated_bodies import ArticulatedBody, Elimination, with_velocities, without_velocities
from jaxspatial.dynamics.contact_problem import Body, Contacts, Joints, Law, Touching
from jaxspatial.dynamics.external_forces import loads
from jaxspatial.dynamics.newton_euler import forces_of
from jaxspatial.dynamics.passive import is_nothing
from jaxspatial.engine import recursion, stacking
from jaxspatial.engine.algorithm import DYNAMICS, FRAMES, Algorithm, Wrenches, algorithm, velocity_shape
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.inertia import articulated
from jaxspatial.numerics import check
from jaxspatial.numerics.linear import Inertia, Matrix, Motion, Vector, Wrench, cross, dot
from jaxspatial.numerics.numbers import (
    Number,
    Numbers,
    as_data,
    constant,
    data_of,
    high,
    noinline,
    shape_of,
    where,
    with_data,
)
from jaxspatial.spatial import algebra

# How small, in the norm of H^-1, the gradient is beside the momenta, where Newton's method stops.
TOLERANCES = {4: 2e-6, 8: 1e-10}
MOST_ITERATIONS, MOST_TRIALS = 60, 20
# A line search stops where the slope is this share of the first one; it tries no step longer than this.
SLOPE, LONGEST = 0.1, 1.5
# Rounding errors of a derivative along a direction, in eps of the sum of the sizes of its terms.
NOISE = 8
FIELDS = (*DYNAMICS, *FRAMES, "damping", "friction_loss", "lower", "upper")


class ContactProgram(Algorithm):
    """A program in small blocks: each iterates until its slowest state has converged."""

    always_as_kernels = True

    @property
    def block(self) -> int:
        return 80


class Scene(NamedTuple):
    """What the solver reads: bodies, and the contacts and joints that are there, at known places of the mechanism.

    dt: (1, B).
    """

    dt: Number
    bodies: list[Body]
    carriers: list[int]
    contacts: Contacts | None
    rows: np.ndarray
    joints: Joints | None


class Vectors(NamedTuple):
    """Numbers of the contact points, a vector (n, B), and of the joints with limits or friction (m, B)."""

    points: Vector | None
    joints: Number | None


def scene_of(
    state: MechanismState,
    still: Array,
    change: Array,
    time: Array,
    touching: Touching | None,
    frames: tuple[int, ...],
) -> Scene:
    dt = state.numbers(time[:, None])[0]
    bodies = problem.bodies_in_world(state, dt)
    diagonal = problem.diagonals(state, bodies)
    contacts = joints = None
    carriers = state.topology.bodies_of(frames)
    if touching is not None:
        mobility = problem.mobilities(state, bodies, diagonal)
        contacts = problem.contacts_of(state, bodies, mobility, frames, touching, dt)
    rows = problem.rows_of_joints(state.topology, state.fields)
    if len(rows):
        before, y = in_world(state, bodies, still, change)
        fastest = where(high(abs(before)) > high(abs(before + y)), abs(before), abs(before + y))
        joints = problem.joints_of(state, rows, state.numbers_by_velocity(diagonal), fastest, dt)
    return Scene(dt, bodies, carriers, contacts, rows, joints)


def in_world(state: MechanismState, bodies: list[Body], *vectors: Array) -> list[Number]:
    """Generalized velocities as numbers (nv, B), those of floating roots in world axes."""
    return [problem.turned(state, bodies, state.numbers(x[:, None])[0], to_world=True) for x in vectors]


def laws(scene: Scene, v: Vectors) -> tuple[Vectors, tuple[Law | None, Number | None]]:
    """(impulses, G) at velocities v."""
    of_contacts = None if scene.contacts is None else _law(scene.contacts, v.points)
    impulse, G = (None, None) if scene.joints is None else _joint_law(scene.joints, v.joints)
    return Vectors(None if of_contacts is None else of_contacts.impulse, impulse), (of_contacts, G)


_law, _joint_law = noinline(problem.law), noinline(problem.joint_law)


def times_G(scene: Scene, G: Any, v: Vectors) -> Vectors:
    of_contacts, of_joints = G
    rates: Any = v.joints
    points = None if scene.contacts is None else _times_G(scene.contacts, of_contacts, v.points)
    return Vectors(points, None if of_joints is None else of_joints * rates)


_times_G = noinline(problem.times_G)


def inner(a: Vectors, b: Vectors) -> Number:
    """The sum of a . b, (1, B)."""
    sums = list[Number]()
    if a.points is not None:
        sums.append(stacking.pairwise_sum(_dot(a.points, b.points)))
    if a.joints is not None and b.joints is not None:
        sums.append(stacking.pairwise_sum(a.joints * b.joints))
    total = sums[0] if len(sums) == 1 else sums[0] + sums[1]
    return stacking.mapped(lambda w: w[None], total)


_dot = noinline(dot)


def combined(function: Any, *vectors: Vectors) -> Vectors:
    """A function of numbers, applied to those of Vectors, part by part."""
    points, joints = zip(*vectors, strict=True)
    return Vectors(
        None if points[0] is None else Vector(*(function(*x) for x in zip(*points, strict=True))),
        None if joints[0] is None else function(*joints),
    )


# -- passes over the tree ---------------------------------------------------------------------------------------------


def velocities_at(state: MechanismState, scene: Scene, motions: list[Motion], x: Number) -> Vectors:
    """The velocities of contact points and joints, from those of bodies and generalized ones (nv, B)."""
    points = None
    if scene.contacts is not None:
        V = state.of_bodies(scene.carriers, motions, _at_rest(state))
        points = _at_points(scene.contacts.arm, V)
    joints = stacking.mapped(lambda w: stacking.rows(w, scene.rows), x) if scene.joints is not None else None
    return Vectors(points, joints)


_at_points = noinline(problem.at_points)


def solved(state: MechanismState, scene: Scene, G: Any, impulse: Vectors, force: Number | None) -> tuple[Any, Any]:
    """(H^-1 (J^T impulse + force) as numbers (nv, B), the same as Motions of the bodies of every bundle)."""
    of_contacts, of_joints = G
    zero = state.zero_vector
    nothing = ArticulatedBody(articulated.none(zero[0]), Wrench(zero, zero))
    on_bodies: list[ArticulatedBody] = [nothing] * len(scene.bodies)
    if scene.contacts is not None:
        added = _contact_inertia(scene.contacts, of_contacts, impulse.points)
        on_bodies = problem.on_bundles(state, scene.carriers, added, nothing)
    joint_forces, stiffer = _whole(state, scene, impulse.joints, force), _whole(state, scene, of_joints, None)
    links = []
    for k, (body, touched) in enumerate(zip(scene.bodies, on_bodies, strict=True)):
        none = (state.known(0.0),) * len(body.S)
        tau = none if joint_forces is None else problem.of_bundle(state, k, joint_forces)
        more = none if stiffer is None else problem.of_bundle(state, k, stiffer)
        links.append((body, touched, tau, more))
    eliminated = recursion.inward(state, _eliminate, nothing, links)
    both = [(body.S, body.r, e) for body, e in zip(scene.bodies, eliminated, strict=True)]
    found = recursion.outward(state, _accelerate, _at_rest(state), both)
    return state.numbers_by_velocity([x for x, _ in found]), [A for _, A in found]


def _at_rest(state: MechanismState) -> Motion:
    return Motion(state.zero_vector, state.zero_vector)


def _whole(state: MechanismState, scene: Scene, of_rows: Number | None, force: Number | None) -> Number | None:
    """Numbers (nv, B): those of the rows in their places, zero elsewhere, and a force."""
    if of_rows is None:
        return force
    places = np.full(state.topology.nv, len(scene.rows))
    places[scene.rows] = np.arange(len(scene.rows))
    whole = stacking.mapped(lambda w: problem.with_zero_rows(w, places), of_rows)
    return whole if force is None else whole + force


@noinline
def _contact_inertia(contacts: Contacts, of_law: Law, impulse: Vector) -> ArticulatedBody:
    """The inertia G of a contact, and the impulse on it as a bias, about the origin of its body."""
    P = articulated.none(constant(impulse[0], 0))._replace(M=problem.matrix_G(contacts, of_law))
    P = articulated.shifted(P, -contacts.arm)
    return ArticulatedBody(P, Wrench(-cross(contacts.arm, impulse), -impulse))


def _eliminate(link: Any, children: ArticulatedBody) -> tuple[list[Elimination], ArticulatedBody]:
    """([Elimination of each velocity], the articulated body about the parent's origin)."""
    body, touched, tau, more = link
    P = articulated.of_body(body.inertia) + touched.P + children.P
    rest = ArticulatedBody(P, touched.Z + children.Z)
    resistance = tuple(a + b for a, b in zip(body.resistance, more, strict=True))
    rest, eliminated = without_velocities(rest, body.S, tau, resistance)
    return eliminated, ArticulatedBody(articulated.shifted(rest.P, -body.r), algebra.shifted_wrench(rest.Z, -body.r))


def _accelerate(link: Any, parent: Motion) -> tuple[Any, Motion]:
    S, r, eliminated = link
    x, A = with_velocities(algebra.shifted_motion(parent, r), S, eliminated)
    return (x, A), A


# -- Newton's method --------------------------------------------------------------------------------------------------


class Iterate(NamedTuple):
    """y: (nv, B). v: velocities of points and joints. phi, lacking (1, B): see above. residual: (1, B)."""

    y: Number
    v: Vectors
    phi: Vectors
    lacking: Number
    residual: Number


@algorithm(*FIELDS, program_class=ContactProgram)
def solve(
    state: MechanismState,
    still: Array,
    change: Array,
    time: Array,
    touching: Touching | None,
    *,
    frames_in_contact: tuple[int, ...],
):
    """(y, residual, iterations): the change of the velocities from `still`, that without contact being `change`.

    Where nothing touches there are no iterations, and y is `change`.
    """
    scene = scene_of(state, still, change, time, touching, frames_in_contact)
    before, free = in_world(state, scene.bodies, still, change)
    both = problem.velocities(state, scene.bodies, [before, free])
    v, v_free = (velocities_at(state, scene, [V[k] for V in both], x) for k, x in enumerate((before, free)))
    energy_before, energy = (_twice_energy(state, scene, [V[k] for V in both], x) for k, x in enumerate((before, free)))
    scale = energy_before + energy
    tolerance = TOLERANCES[state.dtype.itemsize] ** 2

    shape, zero = (1, state.n), state.known(0.0)
    # One row for each contact and joint, also where all have the same velocity.
    v = Vectors(
        None if v.points is None else Vector(*(as_data(x, (len(scene.carriers), state.n)) for x in v.points)),
        None if v.joints is None else as_data(v.joints, (len(scene.rows), state.n)),
    )
    at_rest = combined(lambda x: as_data(zero, shape_of(x)), v)
    y = as_data(zero, (state.topology.nv, state.n))
    start = Iterate(y, v, at_rest, as_data(state.known(1.0), shape), as_data(zero, shape))
    is_touched = _is_touched(scene, state.n)
    count = jnp.zeros(shape, np.int32)

    def iterate(carry: Any) -> Any:
        data, is_done, count, k = carry
        at: Iterate = with_data(start, data)
        new, is_small = _iterated(state, scene, at, v_free, free, energy, scale * tolerance, is_done)
        kept = [jnp.where(is_done, x, y) for x, y in zip(data, data_of(new), strict=True)]
        return kept, is_done | is_small, count + (~is_done).astype(np.int32), k + 1

    def is_going(carry: Any) -> jax.Array:
        return (carry[3] < MOST_ITERATIONS) & ~carry[1].all()

    data, _, count, _ = lax.while_loop(is_going, iterate, (data_of(start), ~is_touched, count, np.int32(0)))
    last: Iterate = with_data(start, data)
    found = problem.turned(state, scene.bodies, last.y, to_world=False)
    y = where(is_touched, found, state.numbers(change[:, None])[0])
    reference = high(scale)
    # Rounding may leave a square below zero.
    residual = jnp.sqrt(jnp.maximum(high(last.residual), 0) / jnp.where(reference > 0, reference, 1))
    return high(y), residual, count


@algorithm(*FIELDS, program_class=ContactProgram, result_shape=velocity_shape)
def solve_at(
    state: MechanismState,
    still: Array,
    change: Array,
    y: Array,
    time: Array,
    touching: Touching | None,
    force: Array,
    *,
    frames_in_contact: tuple[int, ...],
):
    """H^-1 times a force, with H at the velocities `still` + y."""
    scene, (impulse, G) = _at(state, still, change, y, time, touching, frames_in_contact)
    nothing = combined(lambda x: 0.0 * x, impulse)
    (right,) = in_world(state, scene.bodies, force)
    solution: Any = solved(state, scene, G, nothing, right)[0]
    return high(problem.turned(state, scene.bodies, solution, to_world=False))


def _at(
    state: MechanismState,
    still: Array,
    change: Array,
    y: Array,
    time: Array,
    touching: Touching | None,
    frames: tuple[int, ...],
) -> tuple[Scene, Any]:
    """(the Scene, `laws` at the velocities `still` + y)."""
    scene = scene_of(state, still, change, time, touching, frames)
    before, y_in_world = in_world(state, scene.bodies, still, y)
    after = before + y_in_world
    motions = [V for (V,) in problem.velocities(state, scene.bodies, [after])]
    return scene, laws(scene, velocities_at(state, scene, motions, after))


@algorithm(*FIELDS, program_class=ContactProgram, result_shape=velocity_shape)
def imbalance(
    state: MechanismState,
    v: Array,
    still: Array,
    change: Array,
    y: Array,
    vdot: Array,
    tau: Array,
    time: Array,
    touching: Touching | None,
    external_forces: Wrenches,
    *,
    frames_in_contact: tuple[int, ...],
):
    """The gradient of the cost at y = dt vdot: by Newton and Euler, with the impulses of contacts as forces."""
    scene, (impulse, _) = _at(state, still, change, y, time, touching, frames_in_contact)
    body_loads = loads(state, external_forces)
    if scene.contacts is not None:
        R = state.of_bodies(scene.carriers, [body.R for body in scene.bodies], state.world.R)
        nothing = Wrench(state.zero_vector, state.zero_vector)
        on_joints = _about_joint(scene.contacts.arm, impulse.points, R, scene.dt)
        wrenches = problem.on_bundles(state, scene.carriers, on_joints, nothing)
        body_loads = [(tau + F.tau, f + F.f, more) for (tau, f, more), F in zip(body_loads, wrenches, strict=True)]
    forces = state.numbers_by_velocity(forces_of(state, v, vdot, body_loads, state.minus_gravity))
    lacking = scene.dt * (forces - state.numbers(tau[:, None])[0])
    if not is_nothing(state.fields["damping"]):
        before, change_, c = (state.numbers(x[:, None])[0] for x in (still, y, state.fields["damping"]))
        lacking = lacking + scene.dt * (c * (before + change_))
    on_joints = _whole(state, scene, impulse.joints, None)
    return high(lacking if on_joints is None else lacking - on_joints)


@noinline
def _about_joint(arm: Vector, impulse: Vector, R: Matrix, dt: Number) -> Wrench:
    f = impulse / dt
    return Wrench(R.T @ cross(arm, f), R.T @ f)


@algorithm(*FIELDS, program_class=ContactProgram)
def impulses(
    state: MechanismState,
    still: Array,
    change: Array,
    y: Array,
    time: Array,
    touching: Touching | None,
    *,
    frames_in_contact: tuple[int, ...],
):
    """The impulses of contacts (3 n, B), at the velocities `still` + y."""
    _, (impulse, _) = _at(state, still, change, y, time, touching, frames_in_contact)
    points: Any = impulse.points
    parts = [state.rounded(x) for x in points]
    return jnp.stack(parts, 1).reshape((-1, state.n))


def _is_touched(scene: Scene, n: int) -> jax.Array:
    """Whether contacts, limits or friction act at all, (1, B)."""
    any_of = jnp.zeros((1, n), bool)
    if scene.contacts is not None:
        any_of = any_of | scene.contacts.is_touching.any(0, keepdims=True)
    if scene.joints is not None:
        x = scene.joints
        acts = x.near_lower | x.near_upper | (high(x.friction) > 0)
        any_of = any_of | acts.any(0, keepdims=True)
    return any_of


def _twice_energy(state: MechanismState, scene: Scene, motions: list[Motion], x: Number) -> Number:
    """v^T A v, (1, B)."""
    parts = []
    for k, (body, V) in enumerate(zip(scene.bodies, motions, strict=True)):
        parts.append(_energy(body.inertia, V, body.resistance, problem.of_bundle(state, k, x)))
    return stacking.mapped(lambda w: w[None], state.sum_over_bodies(parts))


@noinline
def _energy(M: Inertia, V: Motion, resistance: Numbers, x: Numbers) -> Number:
    total = algebra.twice_energy(M, V)
    for a, rate in zip(resistance, x, strict=True):
        total = total + a * rate * rate
    return total


class Along(NamedTuple):
    """A direction d. v: its velocities at points and joints. slope: the derivative of |v - v*|^2_A / 2 along it.
    curvature: d . A d. decrement: d . H d. rounding: the size of rounding errors of the decrement."""

    v: Vectors
    slope: Number
    curvature: Number
    decrement: Number
    rounding: Number


def _iterated(
    state: MechanismState,
    scene: Scene,
    at: Iterate,
    v_free: Vectors,
    free: Number,
    energy: Number,
    smallest: Number,
    is_done: jax.Array,
) -> tuple[Iterate, jax.Array]:
    """(the next Iterate, whether the gradient of this one was small)."""
    impulse, G = laws(scene, at.v)
    change = times_G(scene, G, v_free)
    right = combined(lambda a, b, c: a - b - at.lacking * c, impulse, at.phi, change)
    e, motions = solved(state, scene, G, right, None)
    v_e = velocities_at(state, scene, motions, e)
    d, v_d = e + at.lacking * free, combined(lambda a, b: a + at.lacking * b, v_e, v_free)
    G_d = times_G(scene, G, v_d)
    over = combined(lambda a, b: a - b, impulse, at.phi)
    # y* . A d, by the equation of d.
    along_free = at.lacking * energy + inner(over, v_free) - inner(v_free, G_d)
    decrement = at.lacking * along_free + inner(over, v_d)
    curvature = decrement - inner(v_d, G_d)
    slope = inner(at.phi, v_d) - at.lacking * along_free
    noise = inner(combined(abs, impulse), combined(abs, v_d)) + abs(slope) + abs(curvature)
    # Below what rounding errors make of it, no direction goes down.
    rounding = NOISE * check.eps(state.dtype) * noise
    is_small = ~(high(decrement) > high(where(high(rounding) > high(smallest), rounding, smallest)))
    length = _searched(state, scene, at.v, Along(v_d, slope, curvature, decrement, rounding), is_small | is_done)
    rest = 1 - length
    new = Iterate(
        at.y + length * d,
        combined(lambda a, b: a + length * b, at.v, v_d),
        combined(lambda p, i, g: rest * p + length * (i - g), at.phi, impulse, G_d),
        rest * at.lacking,
        decrement,
    )
    return new, is_small


def _searched(state: MechanismState, scene: Scene, v: Vectors, along: Along, is_good: jax.Array) -> Number:
    """The length (1, B) of a step at which the derivative of the cost along it is small, by safeguarded Newton.

    is_good: states for which a whole step is taken.
    """
    shape = 1, state.n
    goal = SLOPE * abs(along.decrement) + along.rounding

    def at(length: Number) -> tuple[Number, Number]:
        f, rate = _slopes(scene, v, along.v, length)
        return along.slope + length * along.curvature - f, along.curvature + rate

    low, one, up = (as_data(state.known(x), shape) for x in (0.0, 1.0, LONGEST))
    f, rate = at(one)
    start = low, up, one, where(is_good, 0.0, f), rate

    def trial(carry: Any) -> Any:
        data, k = carry
        low, up, length, f, rate = with_data(start, data)
        low, up, new = _next_length(low, up, length, f, rate, goal)
        is_over = is_good | ~(high(abs(f)) > high(goal))
        new = where(is_over, length, new)
        f, rate = at(new)
        return data_of((low, up, new, where(is_over, 0.0, f), rate)), k + 1

    def is_going(carry: Any) -> jax.Array:
        data, k = carry
        f = with_data(start, data)[3]
        return (k < MOST_TRIALS) & (high(abs(f)) > high(goal)).any()

    data, _ = lax.while_loop(is_going, trial, (data_of(start), np.int32(0)))
    return with_data(start, data)[2]


@noinline
def _next_length(low: Number, up: Number, length: Number, f: Number, rate: Number, goal: Number):
    """(the ends of the interval that holds the length, the next length to try)."""
    is_short = high(f) < 0
    low, up = where(is_short, length, low), where(is_short, up, length)
    step = length - f / where(high(rate) > 0, rate, 1.0)
    is_inside = (high(step) > high(low)) & (high(step) < high(up))
    return low, up, where(is_inside, step, (low + up) * 0.5)


def _slopes(scene: Scene, v: Vectors, v_d: Vectors, length: Number) -> tuple[Number, Number]:
    """(d . impulses, d . G d) at v + length d, summed over contacts and joints."""
    parts = list[tuple[Number, Number]]()
    if scene.contacts is not None:
        parts.append(_slopes_at_contacts(scene.contacts, v.points, v_d.points, length))
    if scene.joints is not None:
        parts.append(_slopes_at_joints(scene.joints, v.joints, v_d.joints, length))
    sums = [[stacking.mapped(lambda w: w[None], stacking.pairwise_sum(x)) for x in part] for part in parts]
    f, rate = sums[0] if len(sums) == 1 else [a + b for a, b in zip(*sums, strict=True)]
    return f, rate


@noinline
def _slopes_at_contacts(contacts: Contacts, v: Vector, d: Vector, length: Number) -> tuple[Number, Number]:
    of_law = problem.law(contacts, v + length * d)
    return dot(of_law.impulse, d), dot(problem.times_G(contacts, of_law, d), d)


@noinline
def _slopes_at_joints(joints: Joints, v: Number, d: Number, length: Number) -> tuple[Number, Number]:
    impulse, G = problem.joint_law(joints, v + length * d)
    return impulse * d, G * d * d
