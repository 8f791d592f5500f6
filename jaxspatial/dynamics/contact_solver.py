"""Newton's method for the convex problem of a step, by articulated bodies.

H = A + sum J_i^T G_i J_i is the mass matrix of the same mechanism with the inertia X^T diag(0, G) X added to each body
in contact, and with G added to the armature of joints at limits: a direction is one pass of the articulated-body
algorithm. Neither H nor any Jacobian is ever formed. A mimic couples joints of different bodies, which no pass over the
tree eliminates: for mechanisms with mimics A and the Jacobians are formed once, and H in each iteration.

With y = v - v0 the change of the velocities, y* = v* - v0 that without contact, and y = (1 - r) y* + x, the gradient is

    g = A (x - r y*) - sum J_i^T gamma_i,               r = 1, x = 0 at first

so that a direction d = r y* + e has the right side H e = sum J_i^T (gamma_i - r G_i J_i y*) - A x, and a step of length
a along it is r -> (1 - a) r, x -> x + a e. A x is summed from the momenta of bodies, which move at the velocities x, in
the pass that finds e: rounding errors of one direction are corrected by the next. A line search sees nothing but the
velocities of contact points and joints. [Castro, Permenter, Han 2022, 4]

The first direction is that of a linear problem: contacts that push at v0, or without contact, stick, even against a
pull and outside of the cone of friction. Its whole step is taken. Most often feet do stick, and the iteration ends; a
search from v0 would stop at the kink of each foot.
"""

import functools
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics import contact_problem as problem
from jaxspatial.dynamics.articulated_bodies import (
    ArticulatedBody,
    Elimination,
    bias_through_joint,
    with_velocities,
    without_velocity,
)
from jaxspatial.dynamics.contact_problem import (
    Body,
    Closing,
    Contacts,
    Ends,
    Force,
    Joints,
    Law,
    Loops,
    Touching,
    Units,
    Where,
)
from jaxspatial.dynamics.external_forces import loads
from jaxspatial.dynamics.newton_euler import forces_of
from jaxspatial.dynamics.passive import is_nothing
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.algorithm import DYNAMICS, FRAMES, Wrenches, algorithm, velocity_shape
from jaxspatial.engine.stacking import Array, Shape
from jaxspatial.engine.state import MechanismState
from jaxspatial.inertia import articulated
from jaxspatial.inertia.articulated import Articulated
from jaxspatial.numerics import check
from jaxspatial.numerics.linear import Inertia, Matrix, Motion, Vector, Wrench, cross, dot
from jaxspatial.numerics.numbers import (
    Mask,
    Number,
    Numbers,
    as_data,
    constant,
    data_of,
    high,
    is_constant,
    is_number,
    mapped,
    shape_of,
    where,
    with_data,
)
from jaxspatial.spatial import algebra

T = TypeVar("T")
# How small, in the norm of H^-1, the gradient is beside the momenta, where Newton's method stops.
TOLERANCES = {4: 2e-6, 8: 1e-10}
MOST_ITERATIONS, MOST_TRIALS = 60, 20
# A line search stops where the slope is this share of the first one; it tries no step longer than this.
SLOPE, LONGEST = 0.1, 1.5
# Rounding errors of a derivative along a direction, in eps of the sum of the sizes of its terms.
NOISE = 8
# Rounding errors of velocities, of depths and of what closures close, in eps of the sizes of what they are sums of; and
# those of momenta.
OF_VELOCITIES, OF_DEPTHS, OF_CLOSURES, OF_MOMENTA = 0.25, 0.125, 1.0, 4.0
# So near the tolerance, or what rounding errors of velocities make, in multiples of these, a square that is more than
# this share of the last is of rounding errors.
NEAR, NOISY, STALLED = 100, 10, 0.25
FIELDS = (*DYNAMICS, *FRAMES, "damping", "friction_loss", "lower", "upper")


class Terms(NamedTuple):
    """What programs read of contacts and closures, None where there are none; their places are a `Where`."""

    touching: Touching | None
    closing: Closing | None


class Scene(NamedTuple):
    """What the solver reads: bodies, and the contacts, joints and closures that are there, with the bodies that these
    are between, and the velocities of the joints. coupled: of mechanisms with mimics. dt: (1, B)."""

    dt: Number
    bodies: list[Body]
    contacts: Contacts | None
    contact_ends: Ends
    joints: Joints | None
    rows: np.ndarray
    loops: Loops | None
    loop_ends: Ends
    coupled: "Coupled | None"


class Vectors(NamedTuple):
    """Numbers of the contact points, a vector (n, B), of the joints with limits or friction (m, B), and of the rows of
    closures (k, B)."""

    points: Vector | None
    joints: Number | None
    loops: Number | None


class Coupled(NamedTuple):
    """A (nv, nv, B), and J: the Vectors at each unit of the generalized velocities, of numbers (rows, nv, B)."""

    A: Number
    J: Vectors


def scene_of(state: MechanismState, still: Array, change: Array, time: Array, terms: Terms, at: Where) -> Scene:
    dt = state.numbers(time[:, None])[0]
    bodies = problem.bodies_in_world(state, dt)
    contacts = joints = loops = units = None
    contact_ends = loop_ends = Ends([], [])
    if state.topology.has_mimics:
        mobility = units = problem.units_of(state, bodies)
        diagonal = units.diagonal
    else:
        diagonal = problem.diagonals(state, bodies)
        mobility = problem.mobilities(state, bodies, diagonal) if any(x is not None for x in terms) else []
    if terms.touching is not None:
        contacts, contact_ends = problem.contacts_of(state, bodies, mobility, at, terms.touching, dt)
    if terms.closing is not None:
        loops, loop_ends = problem.loops_of(state, bodies, mobility, at.closures, terms.closing, dt)
    rows = problem.rows_of_joints(state.topology, state.fields)
    if len(rows):
        before, y = in_world(state, bodies, still, change)
        fastest = where(high(abs(before)) > high(abs(before + y)), abs(before), abs(before + y))
        of_A: Any = diagonal if units is not None else state.numbers_by_velocity(cast(Any, diagonal))
        joints = problem.joints_of(state, rows, of_A, fastest, dt)
    scene = Scene(dt, bodies, contacts, contact_ends, joints, rows, loops, loop_ends, None)
    return scene if units is None else scene._replace(coupled=_coupled(state.n, scene, units))


def in_world(state: MechanismState, bodies: list[Body], *vectors: Array) -> list[Number]:
    """Generalized velocities as numbers (nv, B), those of floating roots in world axes."""
    return [problem.turned(state, bodies, state.numbers(x[:, None])[0], to_world=True) for x in vectors]


class Kind(NamedTuple):
    """How terms of one kind act. A velocity, and an impulse, is a vector (n, B) of contacts, else a number (n, B).

    law(terms, v) -> (impulse, G) at the velocity v. times_G(terms, G, v) -> G v. product(impulse, v) -> impulse . v.
    bound(terms, G, x) -> at least x . G^-1 x, infinite where x has a part in which G is zero. size(terms, v) -> of what
    the law at v takes differences of, velocities without sign.
    """

    law: Callable[..., tuple[Any, Any]]
    times_G: Callable[[Any, Any, Any], Any]
    product: Callable[[Any, Any], Number]
    bound: Callable[[Any, Any, Any], Number]
    size: Callable[[Any, Any], Any]


def _law_of_contacts(contacts: Contacts, v: Vector, *held: Mask) -> tuple[Vector, Law]:
    of_law = problem.law(contacts, v, *held)
    return of_law.impulse, of_law


def _bound_of_contacts(contacts: Contacts, of_law: Law, x: Vector) -> Number:
    along = dot(contacts.normal, x)
    across = x - along * contacts.normal
    # Where contacts slide, an impulse has no part along one direction: G is zero there.
    sticks = (high(of_law.mixed) == 0) & (high(of_law.across) > 0)
    square = along * along * contacts.R_n + dot(across, across) * contacts.R_t
    return where(sticks | (high(dot(x, x)) == 0), square, np.inf)


def _size_of_contacts(contacts: Contacts, v: Vector) -> Vector:
    free = abs(contacts.free)
    return Vector(*(abs(x) + free * abs(n) for x, n in zip(v, contacts.normal, strict=True)))


def _size_of_joints(joints: Joints, v: Number) -> Number:
    return abs(v) + abs(joints.lower) + abs(joints.upper)


def _size_of_loops(loops: Loops, v: Number) -> Number:
    return abs(v) + abs(loops.free)


def _times_G_of_rows(_: Joints | Loops, G: Number, v: Number) -> Number:
    return G * v


def _bound_of_rows(_: Joints | Loops, G: Number, x: Number) -> Number:
    is_stiff = high(G) > 0
    return where(is_stiff | (high(x) == 0), x * x / where(is_stiff, G, 1.0), np.inf)


# In the order of `Vectors`.
KINDS = (
    Kind(_law_of_contacts, problem.times_G, dot, _bound_of_contacts, _size_of_contacts),
    Kind(problem.joint_law, _times_G_of_rows, operator.mul, _bound_of_rows, _size_of_joints),
    Kind(problem.loop_law, _times_G_of_rows, operator.mul, _bound_of_rows, _size_of_loops),
)


def of_each(
    scene: Scene, function: Callable[..., Any], *numbers: Sequence[Any], shared: Sequence[Any] = ()
) -> list[tuple[Any, ...]]:
    """Calls function(kind, terms, *their numbers, *shared) for contacts, joints and closures: each of its results, for
    all three, with None for terms that are not there.

    numbers: of each kind, such as Vectors. shared: by all.
    """
    all_terms = scene.contacts, scene.joints, scene.loops
    return _by_result(
        None if terms is None else function(kind, terms, *own, *shared)
        for kind, terms, *own in zip(KINDS, all_terms, *numbers, strict=True)
    )


def _by_result(of_kinds: Iterable[Any]) -> list[tuple[Any, ...]]:
    """For each of several results those of all kinds, from those of each kind, or None."""
    of_kinds = list(of_kinds)
    count = next(len(x) for x in of_kinds if x is not None)
    return list(zip(*((None,) * count if x is None else x for x in of_kinds), strict=True))


def laws(scene: Scene, v: Vectors) -> tuple[Vectors, Any]:
    """(impulses, G) at velocities v: G is a Law for contacts, numbers for joints and closures."""
    impulses, G = of_each(scene, lambda kind, terms, x: kind.law(terms, x), v)
    return Vectors(*impulses), G


def _total(parts: Iterable[Number | None]) -> Number:
    """The sum of all numbers (rows, B), (1, B)."""
    rows = (stacking.pairwise_sum(x) for x in parts if x is not None)
    return stacking.mapped(lambda w: w[None], functools.reduce(operator.add, rows))


# -- passes over the tree ---------------------------------------------------------------------------------------------


def velocities_at(state: MechanismState, scene: Scene, motions: list[Motion], x: Number) -> Vectors:
    """The velocities of contact points, joints and closures, from those of bodies and generalized ones (nv, B)."""
    points = loops = None
    if scene.contacts is not None:
        at_ends = (state.of_bodies(x, motions, _at_rest(state)) for x in scene.contact_ends)
        points = problem.at_points(scene.contacts, *at_ends)
    if scene.loops is not None:
        at_ends = (state.of_bodies(x, motions, _at_rest(state)) for x in scene.loop_ends)
        loops = problem.along_rows(scene.loops, *at_ends)
    joints = None if scene.joints is None else stacking.mapped(lambda w: stacking.rows(w, scene.rows), x)
    return Vectors(points, joints, loops)


def wrenches(state: MechanismState, scene: Scene, impulse: Vectors) -> list[Wrench]:
    """The wrenches of impulses on the bodies of every bundle, about their origins, in world axes."""
    bodies, parts, counts = list[int](), list[Wrench](), list[int]()
    if scene.contacts is not None and impulse.points is not None:
        on_b, on_a = _on_both_bodies(scene.contacts, impulse.points)
        parts.append(on_b)
        bodies, between = scene.contact_ends.b, scene.contact_ends.between_bodies
        counts.append(len(bodies))
        if len(between):
            parts.append(stacking.mapped(lambda w: stacking.rows(w, between), on_a))
            bodies = bodies + [scene.contact_ends.a[i] for i in between]
            counts.append(len(between))
    if scene.loops is not None and impulse.loops is not None:
        parts += _on_loops(scene.loops, impulse.loops)
        bodies = [*bodies, *scene.loop_ends.b, *scene.loop_ends.a]
        counts += [len(scene.loop_ends.b)] * 2
    nothing = Wrench(state.zero_vector, state.zero_vector)
    if not parts:
        return [nothing] * len(scene.bodies)
    whole = parts[0] if len(parts) == 1 else stacking.concatenated_trees(parts, state.n, counts)
    return problem.on_bundles(state, bodies, whole, nothing)


def _on_both_bodies(contacts: Contacts, impulse: Vector) -> tuple[Wrench, Wrench]:
    """The wrenches of an impulse on bodies b and a, about their origins."""
    return Wrench(cross(contacts.arm, impulse), impulse), Wrench(-cross(contacts.arm_a, impulse), -impulse)


def _on_loops(loops: Loops, impulse: Number) -> tuple[Wrench, Wrench]:
    return impulse * loops.on_b, impulse * loops.on_a


class Solution(NamedTuple):
    """x = H^-1 (J^T impulse + forces): as numbers (nv, B), and as Motions of the bodies of every bundle.

    left: impulse - G J x, of joints and of rows of closures.
    Impulses at limits, and of open closures, are large, and what is left of them is small: the difference would have
    rounding errors in proportion to the impulse.
    """

    x: Number
    motions: list[Motion]
    left: Vectors


def solved(
    state: MechanismState,
    scene: Scene,
    G: Any,
    impulse: Vectors,
    forces: list[Force],
    on_bodies: Number | None = None,
) -> Solution:
    """The Solution of the equations of one direction. forces: on every bundle.

    on_bodies: impulses of closures that are added to those forces, where these balance them: the impulses of `impulse`
    are balanced by G x.
    """
    if scene.coupled is not None:
        return _solved_as_one(state, scene, scene.coupled, G, impulse, forces, on_bodies)
    of_contacts, of_joints, _ = G
    zero = state.zero_vector
    nothing = ArticulatedBody(articulated.none(zero[0]), Wrench(zero, zero))
    stiff = [nothing.P] * len(scene.bodies)
    if scene.contacts is not None:
        on_one = [b if a < 0 else -1 for b, a in zip(*scene.contact_ends, strict=True)]
        stiff = problem.on_bundles(state, on_one, _contact_inertia(scene.contacts, of_contacts), nothing.P)
    pushed = wrenches(state, scene, impulse._replace(loops=on_bodies))
    numbers = (_by_bundle(state, scene, _whole(state, scene, x)) for x in (impulse.joints, of_joints))
    touched = [ArticulatedBody(P, -(F + more.on_bodies)) for P, F, more in zip(stiff, pushed, forces, strict=True)]
    links = list(zip(scene.bodies, touched, [x.on_joints for x in forces], *numbers, strict=True))
    eliminated = recursion.inward(state, _eliminate, nothing, links)
    both = [(body.S, body.r, e) for body, e in zip(scene.bodies, eliminated, strict=True)]
    found = recursion.outward(state, _accelerate, _at_rest(state), both)
    found, of_loops = _with_complement(state, scene, G, impulse.loops, eliminated, found)
    x, motions, of_joints = ([y[k] for y in found] for k in range(3))
    left = None
    if scene.joints is not None:
        left = stacking.mapped(lambda w: stacking.rows(w, scene.rows), state.numbers_by_velocity(of_joints))
    if on_bodies is not None and of_loops is not None:
        of_loops = of_loops + on_bodies
    return Solution(state.numbers_by_velocity(x), motions, Vectors(None, left, of_loops))


def _at_rest(state: MechanismState) -> Motion:
    return Motion(state.zero_vector, state.zero_vector)


def _whole(state: MechanismState, scene: Scene, of_rows: Number | None) -> Number | None:
    """Numbers (nv, B): those of the joints with limits or friction in their places, zero elsewhere."""
    if of_rows is None:
        return None
    places = np.full(state.topology.nv, len(scene.rows))
    places[scene.rows] = np.arange(len(scene.rows))
    return stacking.mapped(lambda w: problem.with_zero_rows(w, places), of_rows)


def _by_bundle(state: MechanismState, scene: Scene, x: Number | None) -> list[Numbers]:
    """The numbers (nv, B) of the joints of every bundle, known zeros for None."""
    if x is None:
        return [(state.known(0.0),) * len(body.S) for body in scene.bodies]
    return [problem.own_of_bundle(state, k, x) for k in range(len(scene.bodies))]


def _contact_inertia(contacts: Contacts, of_law: Law) -> Articulated:
    """The inertia G of a contact about the origin of its body."""
    G = problem.matrix_G(contacts, of_law)
    return articulated.shifted(articulated.none(constant(G[0], 0))._replace(M=G), -contacts.arm)


class Stiff(NamedTuple):
    """The Elimination of a velocity, and its D and u without the G and the impulse of the joint; None without these."""

    whole: Elimination
    D: Number | None
    u: Number | None


def _eliminate(link: Any, children: ArticulatedBody) -> tuple[list[Stiff], ArticulatedBody]:
    """([Stiff of each velocity], the articulated body about the parent's origin)."""
    body, touched, tau, impulse, G = link
    rest = ArticulatedBody(articulated.of_body(body.inertia) + touched.P + children.P, touched.Z + children.Z)
    eliminated = list[Stiff]()
    for s, force, own, resistance, g in zip(body.S, tau, impulse, body.resistance, G, strict=True):
        u = None if is_constant(g) else force - algebra.power(rest.Z, s)
        rest, whole = without_velocity(rest, s, force + own, resistance + g)
        eliminated.append(Stiff(whole, None if u is None else algebra.power(whole.U, s) + resistance, u))
    return eliminated, ArticulatedBody(articulated.shifted(rest.P, -body.r), algebra.shifted_wrench(rest.Z, -body.r))


def _accelerate(link: Any, parent: Motion) -> tuple[Any, Motion]:
    """((velocities, the motion of the body, what is left of the impulses of the joint), the motion)."""
    S, r, eliminated = link
    A, found = algebra.shifted_motion(parent, r), list[tuple[Number, Number]]()
    for s, (whole, D, u) in zip(reversed(S), reversed(eliminated), strict=True):
        (x,), after = with_velocities(A, [s], [whole])
        # D x = u + impulse - G x - U . A
        left = constant(x, 0) if D is None or u is None else D * x - (u - algebra.power(whole.U, A))
        found.append((x, left))
        A = after
    x, left = zip(*reversed(found), strict=True) if found else ((), ())
    return (x, A, left), A


# -- mechanisms with mimics -------------------------------------------------------------------------------------------


def _coupled(n: int, scene: Scene, units: Units) -> Coupled:
    """The Coupled of a scene, of n states."""
    state, nv = units.state, units.state.topology.nv
    contacts, loops = problem.tiled((scene.contacts, scene.loops), n, nv)
    J = velocities_at(state, scene._replace(contacts=contacts, loops=loops), units.motions, units.x)

    def by_velocity(rows: Any, m: int) -> Any:
        each = jax.tree.map(lambda x: stacking.spread(x, (m, n * nv)), rows, is_leaf=is_number)
        return stacking.mapped(lambda w: w.reshape((m, nv, n)), each)

    counts = len(scene.contact_ends.b), len(scene.rows), len(scene.loop_ends.b)
    return Coupled(units.A, Vectors(*map(by_velocity, J, counts)))


def _solved_as_one(
    state: MechanismState,
    scene: Scene,
    coupled: Coupled,
    G: Any,
    impulse: Vectors,
    forces: list[Force],
    on_bodies: Number | None,
) -> Solution:
    """`solved` by elimination: of x, and of what is left of the impulses of joints and closures, y.

        (A + J_c^T G_c J_c) x - J^T y = J_c^T impulse_c + J^T on_bodies + forces        G J x + y = impulse

    with J_c of contacts, and J of joints and closures. y is no difference of large numbers. Of closures
    y + on_bodies is left.
    """
    (A, J), nv = coupled, state.topology.nv
    H, right = A, problem.generalized(state, scene.bodies, forces)
    if on_bodies is not None and J.loops is not None:
        m = shape_of(J.loops)[0]
        on_bodies = stacking.spread(on_bodies, (m, state.n))
        on_velocities = stacking.mapped(lambda w: w[:, None], on_bodies) * J.loops
        right = right + stacking.pairwise_sum(stacking.spread(on_velocities, (m, nv, state.n)))
    if scene.contacts is not None and impulse.points is not None and J.points is not None:
        at = stacking.mapped(lambda w: w[:, None], (scene.contacts, G[0], impulse.points))
        terms, shape = _on_velocities(*at, J.points), (len(scene.contact_ends.b), nv, nv, state.n)
        stiff, pushed = (stacking.spread(x, shape[:k] + shape[-1:]) for x, k in zip(terms, (3, 2), strict=True))
        H, right = H + stacking.pairwise_sum(stiff), right + stacking.pairwise_sum(pushed)
    by_kind = cast(Any, J)
    kinds = [k for k in (1, 2) if by_kind[k] is not None]
    if kinds:
        counts = [shape_of(by_kind[k])[0] for k in kinds]
        of_rows = (
            [stacking.spread(x[k], (m, state.n)) for k, m in zip(kinds, counts, strict=True)]
            for x in (G, cast(Any, impulse))
        )
        stiffness, given = map(stacking.concatenated, of_rows)
        H = _with_rows(H, stacking.concatenated([by_kind[k] for k in kinds]), stiffness)
        right = stacking.concatenated([right, given])
    found, left = matrices.solved(H, right), list[Any]([None] * 3)
    first = nv
    for k in kinds:
        last = first + shape_of(by_kind[k])[0]
        left[k], first = stacking.mapped(lambda w, a=first, b=last: w[a:b], found), last
    if on_bodies is not None:
        left[2] = left[2] + on_bodies
    x = stacking.mapped(lambda w: w[:nv], found)
    return Solution(x, [V for (V,) in problem.velocities(state, scene.bodies, [x])], Vectors(*left))


def _on_velocities(contacts: Contacts, of_law: Law, impulse: Vector, J: Vector) -> tuple[Number, Number]:
    """(J^T G J (n, nv, nv, B), J^T impulse (n, nv, B)) of each of n contacts. J: (n, nv, B)."""
    GJ = problem.times_G(contacts, of_law, J)
    rows, columns = stacking.mapped(lambda w: w[:, :, None], J), stacking.mapped(lambda w: w[:, None], GJ)
    return dot(rows, columns), dot(J, impulse)


def _with_rows(H: Number, J: Number, G: Number) -> Number:
    """[[H, -J^T], [G J, 1]], of J (rows, nv, B)."""
    m, n = shape_of(J)[0], shape_of(J)[2]
    own = jnp.broadcast_to(np.eye(m, dtype=bool)[:, :, None], (m, m, n))
    across = -stacking.mapped(lambda w: jnp.swapaxes(w, 0, 1), J)
    below, one = stacking.mapped(lambda w: w[:, None], G) * J, stacking.spread(constant(J, 1), (m, m, n))
    pairs = [(H, across), (below, where(own, one, 0.0))]
    return stacking.concatenated([mapped(lambda *words: jnp.concatenate(words, 1), *pair) for pair in pairs])


# -- the complement of terms between two bodies -----------------------------------------------------------------------


class Columns(NamedTuple):
    """L^T J of the terms between two bodies, with G = L L^T: k rows as the wrenches (k, B) that they put on bodies b
    and a, about the origins of these, in world axes."""

    on_b: Wrench
    on_a: Wrench


def _with_complement(
    state: MechanismState, scene: Scene, G: Any, impulse: Number | None, eliminated: list[Any], found: list[Any]
) -> tuple[list[Any], Number | None]:
    """(what `_accelerate` found, corrected for terms between two bodies; what is left of the impulses of closures).

    found: x', without the G of these terms and without the impulses of closures. With H' all the rest of H,

        x = x' + Y s        (1 + L^T J Y) s = L^-1 impulse - L^T J x'        Y = H'^-1 J^T L

    of as many columns as there are rows, by the formula of Sherman, Morrison and Woodbury, and impulse - G J x = L s.
    Impulses of open closures are large, and what is left of them is small: so they are never applied as a whole.
    [Golub and Van Loan 2013, 2.1.4]
    """
    columns, ends = _columns(state, scene, G)
    if columns is None:
        return found, None
    # Columns are states beside each other.
    n, k = state.n, len(ends.b)
    wide, own = state.of_size(n * k), np.eye(k, dtype=bool)[:, :, None]

    def apart(w: jax.Array) -> jax.Array:
        """Row i in column i, zero elsewhere."""
        return jnp.where(own, jnp.broadcast_to(w, (k, n))[:, None], 0).reshape((k, k * n))

    def column(w: jax.Array, i: int) -> jax.Array:
        return w[..., i * n : (i + 1) * n] if w.shape[-1] == n * k else w

    def rates(state: MechanismState, columns: Columns, results: list[Any]) -> Number:
        motions = [x[1] for x in results]
        return _rates(columns, *(state.of_bodies(x, motions, _at_rest(state)) for x in ends))

    nothing = Wrench(state.zero_vector, state.zero_vector)
    rows = stacking.concatenated_trees(list(stacking.mapped(apart, columns)), wide.n, [k, k])
    forces = problem.on_bundles(wide, ends.b + ends.a, rows, nothing)
    factors = [(b.S, b.r, [x.whole[:2] for x in e]) for b, e in zip(scene.bodies, eliminated, strict=True)]
    factors, stiffer = problem.tiled((factors, _by_bundle(state, scene, _whole(state, scene, G[1]))), n, k)
    returned = recursion.inward(wide, _to_parent, nothing, list(zip(factors, forces, strict=True)))
    both = [(S, r, e, g) for (S, r, _), e, g in zip(factors, returned, stiffer, strict=True)]
    Y = recursion.outward(wide, _follow, _at_rest(wide), both)
    through = rates(wide, problem.tiled(columns, n, k), Y)
    M = stacking.mapped(lambda w: jnp.broadcast_to(w, (k, k * n)).reshape((k, k, n)), through)
    M = where(jnp.broadcast_to(own, (k, k, n)), M + 1.0, M)
    lacking = stacking.spread(-rates(state, columns, found), (k, n))
    n_contacts = k - len(scene.loop_ends.b)
    if scene.loops is not None and impulse is not None:
        given = _over_L(scene.loops, impulse)
        places = np.array([k] * n_contacts + list(range(k - n_contacts)))
        lacking = lacking + stacking.mapped(lambda w: problem.with_zero_rows(w, places), given)
    s = matrices.solved(M, lacking)
    shares = [stacking.mapped(lambda w, i=i: w[i], s) for i in range(k)]
    of_joints, of_columns = ([(x, left) for x, _, left in y] for y in (found, Y))
    of_bundles = [[stacking.mapped(lambda w, i=i: column(w, i), y) for i in range(k)] for y in of_columns]
    summed = [_plus(x, shares, y) for x, y in zip(of_joints, of_bundles, strict=True)]
    # Columns may cancel one another: sums of their motions would have other rounding errors than those of their rates.
    moving = problem.velocities(state, scene.bodies, [state.numbers_by_velocity([x for x, _ in summed])])
    found = [(x, V, left) for (x, left), (V,) in zip(summed, moving, strict=True)]
    if scene.loops is None:
        return found, None
    return found, _times_L(scene.loops, stacking.mapped(lambda w: w[n_contacts:], s))


def _columns(state: MechanismState, scene: Scene, G: Any) -> tuple[Columns | None, Ends]:
    """(the Columns, the bodies of each); None without terms between two bodies."""
    parts, counts, b, a = list[Columns](), list[int](), list[int](), list[int]()
    between = scene.contact_ends.between_bodies
    if scene.contacts is not None and len(between):
        parts += _columns_of_contacts(*stacking.mapped(lambda w: _rows(w, between), (scene.contacts, G[0])))
        counts += [len(between)] * 3
        b += [scene.contact_ends.b[i] for i in between] * 3
        a += [scene.contact_ends.a[i] for i in between] * 3
    if scene.loops is not None:
        parts.append(_columns_of_loops(scene.loops))
        counts.append(len(scene.loop_ends.b))
        b, a = b + scene.loop_ends.b, a + scene.loop_ends.a
    if not parts:
        return None, Ends(b, a)
    whole = parts[0] if len(parts) == 1 else stacking.concatenated_trees(parts, state.n, counts)
    return whole, Ends(b, a)


def _rows(w: Any, places: np.ndarray) -> Any:
    """Rows of numbers (n, B), of size 1 where all have the same."""
    return w if w.shape[0] == 1 else stacking.rows(w, places)


def _columns_of_contacts(contacts: Contacts, of_law: Law) -> list[Columns]:
    """The columns of L, for each contact, by Cholesky's method; a pivot that is zero leaves a column of zeros."""
    xx, xy, yy, xz, yz, zz = problem.matrix_G(contacts, of_law)
    zero, size = constant(xx, 0), xx + yy + zz

    def column(pivot: Number, *below: Number) -> list[Number]:
        # Rounding may leave one that is zero at either side of it.
        is_none = ~(high(pivot) > high(8 * check.eps(high(size).dtype) * size))
        root = where(is_none, 1.0, pivot).sqrt()
        return [where(is_none, zero, x / root) for x in (pivot, *below)]

    a, b, c = column(xx, xy, xz)
    d, e = column(yy - b * b, yz - b * c)
    (f,) = column(zz - c * c - e * e)
    columns = Vector(a, b, c), Vector(zero, d, e), Vector(zero, zero, f)
    return [Columns(*_on_both_bodies(contacts, x)) for x in columns]


def _columns_of_loops(loops: Loops) -> Columns:
    scale = (1 / loops.R).sqrt()
    return Columns(scale * loops.on_b, scale * loops.on_a)


def _follow(link: Any, parent: Motion) -> tuple[Any, Motion]:
    """`_accelerate`, where joints have no impulses."""
    S, r, eliminated, G = link
    x, A = with_velocities(algebra.shifted_motion(parent, r), S, eliminated)
    return (x, A, tuple(-g * y for g, y in zip(G, x, strict=True))), A


def _to_parent(body: Any, children: Wrench) -> tuple[list[Elimination], Wrench]:
    """([Elimination of each velocity], the bias force about the parent's origin) of a body under a wrench."""
    (S, r, factors), F = body
    Z, eliminated = children - F, list[Elimination]()
    for s, (U, D) in zip(S, factors, strict=True):
        u = -algebra.power(Z, s)
        Z = bias_through_joint(Z, u, articulated.UDinv_of(U, D))
        eliminated.append(Elimination(U, D, u))
    return eliminated, algebra.shifted_wrench(Z, -r)


def _rates(columns: Columns, V_b: Motion, V_a: Motion) -> Number:
    return algebra.power(columns.on_b, V_b) + algebra.power(columns.on_a, V_a)


def _plus(x: Any, shares: list[Number], columns: list[Any]) -> Any:
    """x and the sum of columns, times their shares."""
    for share, column in zip(shares, columns, strict=True):
        x = jax.tree.map(lambda a, b, s=share: a + s * b, x, column, is_leaf=is_number)
    return x


def _over_L(loops: Loops, impulse: Number) -> Number:
    return impulse * loops.R.sqrt()


def _times_L(loops: Loops, s: Number) -> Number:
    return s / loops.R.sqrt()


# -- Newton's method --------------------------------------------------------------------------------------------------


class Scalars(NamedTuple):
    """Of an Iterate: over_free: y* . A x. lacking: r. residual: g^T H^-1 g before the last step, or a bound of it after
    that. noise: what rounding errors of velocities make of it. Numbers (1, B)."""

    over_free: Number
    lacking: Number
    residual: Number
    noise: Number


class Iterate(NamedTuple):
    """x: (nv, B), and the Motions of bodies that have these velocities. v: velocities of points and joints."""

    x: Number
    motions: list[Motion]
    v: Vectors
    scalars: Scalars


class Free(NamedTuple):
    """The velocities of points and joints that y* makes, and y* . A y*."""

    v: Vectors
    energy: Number


@algorithm(*FIELDS)
def solve(
    state: MechanismState,
    still: Array,
    change: Array,
    time: Array,
    terms: Terms,
    *,
    places: Where,
):
    """(y, iterations): the change of the velocities from `still`, that without contact being `change`.

    Where nothing touches there are no iterations, and y is `change`.
    """
    scene = scene_of(state, still, change, time, terms, places)
    before, free = in_world(state, scene.bodies, still, change)
    both = problem.velocities(state, scene.bodies, [before, free])
    motions, motions_free = ([V[k] for V in both] for k in range(2))
    v, v_free = (velocities_at(state, scene, V, x) for V, x in ((motions, before), (motions_free, free)))
    energy_before, energy = (_twice_energy(state, scene, V, x) for V, x in ((motions, before), (motions_free, free)))
    scale, without = energy_before + energy, Free(v_free, energy)
    tolerance = TOLERANCES[state.dtype.itemsize] ** 2

    shape, zero = (1, state.n), state.known(0.0)
    # One row for each contact, joint and row of a closure, also where all have the same velocity.
    n_points, *counts = (len(x) for x in (scene.contact_ends.b, scene.rows, scene.loop_ends.b))
    points = None if v.points is None else Vector(*(as_data(x, (n_points, state.n)) for x in v.points))
    v = Vectors(points, *(x if x is None else as_data(x, (m, state.n)) for x, m in zip(v[1:], counts, strict=True)))
    held = _pushes(scene, v, v_free)
    x = as_data(zero, (state.topology.nv, state.n))
    at_rest = [
        Motion(*(Vector(*(as_data(zero, (*b.bodies.shape, state.n)) for _ in range(3))) for _ in range(2)))
        for b in state.bundles
    ]
    nothing = as_data(zero, shape)
    start = Iterate(x, at_rest, v, Scalars(nothing, as_data(state.known(1.0), shape), nothing, nothing))
    is_touched = _is_touched(scene, state.n)
    count = jnp.zeros(shape, np.int32)

    def iterate(carry: Any) -> Any:
        data, is_done, count, k = carry
        at: Iterate = with_data(start, data)
        new, is_small = _iterated(state, scene, at, without, scale * tolerance, is_done, held, k == 0)
        return data_of(new), is_done | is_small, count + (~is_done).astype(np.int32), k + 1

    def is_going(carry: Any) -> jax.Array:
        return (carry[3] < MOST_ITERATIONS) & ~carry[1].all()

    data, _, count, _ = lax.while_loop(is_going, iterate, (data_of(start), ~is_touched, count, np.int32(0)))
    last: Iterate = with_data(start, data)
    found = problem.turned(state, scene.bodies, (1 - last.scalars.lacking) * free + last.x, to_world=False)
    y = where(is_touched, found, state.numbers(change[:, None])[0])
    return high(y), count


@algorithm(*FIELDS, result_shape=velocity_shape)
def solve_at(
    state: MechanismState,
    still: Array,
    change: Array,
    y: Array,
    time: Array,
    terms: Terms,
    force: Array,
    *,
    places: Where,
):
    """H^-1 times a force, with H at the velocities `still` + y."""
    scene, _, (impulse, G) = _at(state, still, change, y, time, terms, places)
    nothing = jax.tree.map(lambda x: 0.0 * x, impulse, is_leaf=is_number)
    x, _ = _times_inverse(state, scene, G, nothing, state.numbers(force[:, None])[0])
    return high(problem.turned(state, scene.bodies, x, to_world=False))


def _times_inverse(
    state: MechanismState, scene: Scene, G: Any, nothing: Vectors, force: Number
) -> tuple[Number, list[Motion]]:
    """H^-1 times a force (nv, B), in world axes; and the Motions of bodies that have these velocities."""
    right = problem.turned(state, scene.bodies, force, to_world=True)
    at_rest = Wrench(state.zero_vector, state.zero_vector)
    forces = [Force(at_rest, x) for x in _by_bundle(state, scene, right)]
    solution = solved(state, scene, G, nothing, forces)
    return solution.x, solution.motions


def _at(
    state: MechanismState,
    still: Array,
    change: Array,
    y: Array,
    time: Array,
    terms: Terms,
    places: Where,
) -> tuple[Scene, Vectors, Any]:
    """(the Scene, the velocities of its terms when those of joints are `still` + y, `laws` there)."""
    scene = scene_of(state, still, change, time, terms, places)
    before, y_in_world = in_world(state, scene.bodies, still, y)
    after = before + y_in_world
    motions = [V for (V,) in problem.velocities(state, scene.bodies, [after])]
    v = velocities_at(state, scene, motions, after)
    return scene, v, laws(scene, v)


@algorithm(*FIELDS, result_shape=lambda *_: (1,))
def residual(
    state: MechanismState,
    v: Array,
    still: Array,
    change: Array,
    y: Array,
    vdot: Array,
    tau: Array,
    time: Array,
    terms: Terms,
    external_forces: Wrenches,
    *,
    places: Where,
):
    """sqrt(g^T H^-1 g) at y = dt vdot, with g the `imbalance` and what rounding errors make of it, relative to the
    momenta, (1, B). 0 where nothing touches."""
    scene, at_terms, (impulse, G) = _at(state, still, change, y, time, terms, places)
    is_touched = _is_touched(scene, state.n)
    g = _lacking(state, scene, impulse, (v, still, y, vdot, tau), external_forces)
    nothing = jax.tree.map(lambda x: 0.0 * x, impulse, is_leaf=is_number)
    d, motions = _times_inverse(state, scene, G, nothing, g)
    squares, noise = of_each(scene, _square, at_terms, velocities_at(state, scene, motions, d), G)
    parts = [_total(squares), _total(noise), *_roundings(scene, at_terms, G)]
    left = functools.reduce(operator.add, parts, _twice_energy(state, scene, motions, d))
    fields = in_world(state, scene.bodies, still, change)
    both = problem.velocities(state, scene.bodies, fields)
    energies = (_twice_energy(state, scene, [V[k] for V in both], x) for k, x in enumerate(fields))
    scale, least = high(functools.reduce(operator.add, energies)), (OF_MOMENTA * check.eps(state.dtype)) ** 2
    share = jnp.where(is_touched, high(left), 0) / jnp.where(scale <= 0, 1, scale)
    return jnp.sqrt(share + jnp.where(is_touched, least, 0))


def _square(kind: Kind, terms: Any, v: Any, v_d: Any, G: Any) -> tuple[Number, Number]:
    """(d . G d of the velocity along d, `_noise`)."""
    return kind.product(v_d, kind.times_G(terms, G, v_d)), _noise(kind, terms, v, G)


def _roundings(scene: Scene, v: Vectors, G: Any) -> list[Number]:
    """What rounding errors of depths, and of what closures close, make of g^T H^-1 g, (1, B) each."""
    squares, parts = list[tuple[float, Number]](), list[Number]()
    if scene.contacts is not None:
        squares.append((OF_DEPTHS, problem.rounding_of_contacts(scene.contacts, G[0])))
    if scene.loops is not None and v.loops is not None:
        squares.append((OF_CLOSURES, problem.rounding_of_loops(scene.loops, v.loops)))
    for errors, square in squares:
        total = _total([square])
        parts.append((errors * check.eps(high(total).dtype)) ** 2 * total)
    return parts


@algorithm(*FIELDS, result_shape=velocity_shape)
def imbalance(
    state: MechanismState,
    v: Array,
    still: Array,
    change: Array,
    y: Array,
    vdot: Array,
    tau: Array,
    time: Array,
    terms: Terms,
    external_forces: Wrenches,
    *,
    places: Where,
):
    """The gradient of the cost at y = dt vdot: by Newton and Euler, with the impulses of contacts as forces."""
    scene, _, (impulse, _) = _at(state, still, change, y, time, terms, places)
    return high(_lacking(state, scene, impulse, (v, still, y, vdot, tau), external_forces))


def _lacking(
    state: MechanismState, scene: Scene, impulse: Vectors, at: Sequence[Array], external_forces: Wrenches
) -> Number:
    """`imbalance` (nv, B). at: v, still, y, vdot, tau."""
    v, still, y, vdot, tau = at
    body_loads = loads(state, external_forces)
    pushed = wrenches(state, scene, impulse)
    pushed = [_in_axes(body.R, F, scene.dt) for body, F in zip(scene.bodies, pushed, strict=True)]
    body_loads = [(tau + F.tau, f + F.f, more) for (tau, f, more), F in zip(body_loads, pushed, strict=True)]
    forces = state.numbers_by_velocity(forces_of(state, v, vdot, body_loads, state.minus_gravity))
    lacking = scene.dt * (forces - state.numbers(tau[:, None])[0])
    if not is_nothing(state.fields["damping"]):
        before, change_, c = (state.numbers(x[:, None])[0] for x in (still, y, state.fields["damping"]))
        lacking = lacking + scene.dt * (c * (before + change_))
    on_joints = _whole(state, scene, impulse.joints)
    return lacking if on_joints is None else lacking - on_joints


def _in_axes(R: Matrix, impulse: Wrench, dt: Number) -> Wrench:
    """The wrench of an impulse in world axes, in the axes of a body."""
    return Wrench(*(R.T @ (x / dt) for x in impulse))


def _shapes_of_impulses(_: Any, static: dict[str, Any]) -> list[Shape]:
    """Those of the results of `impulses`."""
    places: Where = static["places"]
    of_contacts, of_closures = 3 * len(places.frames), sum(c.n_turning + c.n_moving for c in places.closures)
    return [(n,) for n in (of_contacts, of_closures) if n]


@algorithm(*FIELDS, result_shape=_shapes_of_impulses)
def impulses(
    state: MechanismState,
    still: Array,
    change: Array,
    y: Array,
    time: Array,
    terms: Terms,
    *,
    places: Where,
):
    """The impulses of contacts (3 n, B), and of rows of closures (k, B), at the velocities `still` + y."""
    _, _, (impulse, _) = _at(state, still, change, y, time, terms, places)
    points: Any = impulse.points
    found = [] if points is None else [jnp.stack([state.rounded(x) for x in points], 1).reshape((-1, state.n))]
    return tuple(found if impulse.loops is None else [*found, state.rounded(impulse.loops)])


def _is_touched(scene: Scene, n: int) -> jax.Array:
    """Whether contacts, limits, friction or closures act at all, (1, B)."""
    any_of = jnp.full((1, n), scene.loops is not None)
    if scene.contacts is not None:
        any_of = any_of | scene.contacts.is_touching.any(0, keepdims=True)
    if scene.joints is not None:
        x = scene.joints
        acts = x.near_lower | x.near_upper | ~(high(x.friction) <= 0)
        any_of = any_of | acts.any(0, keepdims=True)
    return any_of


def _twice_energy(state: MechanismState, scene: Scene, motions: list[Motion], x: Number) -> Number:
    """v^T A v, (1, B)."""
    parts = []
    for k, (body, V) in enumerate(zip(scene.bodies, motions, strict=True)):
        parts.append(_energy(body.inertia, V, body.resistance, problem.of_bundle(state, k, x)))
    return stacking.mapped(lambda w: w[None], state.sum_over_bodies(parts))


def _energy(M: Inertia, V: Motion, resistance: Numbers, x: Numbers) -> Number:
    total = algebra.twice_energy(M, V)
    for a, rate in zip(resistance, x, strict=True):
        total = total + a * rate * rate
    return total


class Slopes(NamedTuple):
    """Along a direction d. slope: the derivative of |v - v*|^2_A / 2. curvature: d . A d. decrement: d . H d. rounding:
    the size of rounding errors of the decrement. Numbers (1, B)."""

    slope: Number
    curvature: Number
    decrement: Number
    rounding: Number


class Products(NamedTuple):
    """Products of impulses at an Iterate, and of G d, with the velocities y* (`free`) and d.

    noise: impulse_d, of the sizes of its factors. Numbers (n, B) of n terms, or their sums (1, B).
    """

    impulse_free: Number
    free_G_d: Number
    impulse_d: Number
    d_G_d: Number
    noise: Number


def _iterated(
    state: MechanismState,
    scene: Scene,
    at: Iterate,
    free: Free,
    smallest: Number,
    is_done: jax.Array,
    held: Mask,
    is_first: jax.Array,
) -> tuple[Iterate, jax.Array]:
    """(the next Iterate, whether the gradient of this one was small, or that of the next is). What is done stays.

    held: contacts that stick in the first iteration, whose step is not searched.
    """
    lacking = at.scalars.lacking
    all_held = (held & is_first,), (), ()
    impulse, G, right = of_each(scene, _pushed, at.v, free.v, all_held, shared=[lacking])
    momenta = _momenta(state, scene, at.motions, at.x)
    forces = jax.tree.map(operator.neg, momenta, is_leaf=is_number)
    right, on_bodies = _applied(Vectors(*right), is_first)
    e, motions, left = solved(state, scene, G, right, forces, on_bodies)
    v_e = velocities_at(state, scene, motions, e)
    v_d, linear, products = of_each(scene, _along, G, impulse, v_e, free.v, shared=[lacking])
    sums, energy = Products(*map(_total, _by_result(products))), _twice_energy(state, scene, motions, e)
    slopes, free_e, is_small = _slopes_and_size(at.scalars, free.energy, sums, energy, smallest, is_first)
    length = _searched(state, scene, at.v, Vectors(*v_d), slopes, is_small | is_done | is_first)
    linear = linear[0], left.joints, left.loops
    v, bounds, noise = of_each(scene, _after, at.v, v_d, linear, shared=[length, is_done])
    x, moving = _moved((at.x, at.motions), (e, motions), length, is_done)
    scalars, is_settled = _next_scalars(
        at.scalars, length, free_e, slopes.decrement, _total(bounds), _total(noise), smallest, is_first, is_done
    )
    return Iterate(x, moving, Vectors(*v), scalars), is_small | is_settled


def _applied(impulse: Vectors, is_first: jax.Array) -> tuple[Vectors, Number | None]:
    """(impulses, of closures those that G x balances, the impulses of closures that act on bodies), see `solved`.

    In the first direction what closes a loop is balanced by G x. Later the momenta A x balance what is left: of a
    closure that cannot close, or works against a limit, that is large.
    """
    if impulse.loops is None:
        return impulse, None
    zero = constant(impulse.loops, 0)
    return impulse._replace(loops=where(is_first, impulse.loops, zero)), where(is_first, zero, impulse.loops)


def _moved(at: T, along: T, length: Number, is_done: jax.Array) -> T:
    """Numbers after a step along others; where it is done, those before."""
    return jax.tree.map(lambda x, d: where(is_done, x, x + length * d), at, along, is_leaf=is_number)


def _pushed(
    kind: Kind, terms: Any, v: Any, v_free: Any, held: tuple[Mask, ...], lacking: Number
) -> tuple[Any, Any, Any]:
    """(impulse, G, the impulse of the right side of a direction). held: see `law`."""
    impulse, G = kind.law(terms, v, *held)
    return impulse, G, impulse - lacking * kind.times_G(terms, G, v_free)


def _along(
    kind: Kind, terms: Any, G: Any, impulse: Any, v_e: Any, v_free: Any, lacking: Number
) -> tuple[Any, Any, Products]:
    """(the velocity along a direction, the impulse at the end of the direction if it were linear, Products)."""
    v_d = v_e + lacking * v_free
    G_d = kind.times_G(terms, G, v_d)
    sizes = (jax.tree.map(abs, x, is_leaf=is_number) for x in (impulse, v_d))
    products = Products(
        impulse_free=kind.product(impulse, v_free),
        free_G_d=kind.product(v_free, G_d),
        impulse_d=kind.product(impulse, v_d),
        d_G_d=kind.product(v_d, G_d),
        noise=kind.product(*sizes),
    )
    return v_d, impulse - G_d, products


def _after(
    kind: Kind, terms: Any, v: Any, v_d: Any, linear: Any, length: Number, is_done: jax.Array
) -> tuple[Any, Number, Number]:
    """(the velocity after a step, see `_moved`, what is at least the term's share of g^T H^-1 g there, and what errors
    of rounding the velocity make of that).

    linear: the impulse phi that the step took, by G. The gradient is J^T x, with x = phi - gamma. As H is at least
    J^T G J, g^T H^-1 g is at most the sum of x_i^T G_i^-1 x_i, where no x_i has a part in which G_i is zero. And x is
    zero, but for rounding errors, where laws are linear: where contacts stick, or do nothing, as before the step. So no
    pass over the tree is needed there; elsewhere the bound is infinite.
    """
    v = _moved(v, v_d, length, is_done)
    impulse, G = kind.law(terms, v)
    return v, kind.bound(terms, G, linear - impulse), _noise(kind, terms, v, G)


def _noise(kind: Kind, terms: Any, v: Any, G: Any) -> Number:
    """What rounding errors of velocities make of g^T H^-1 g."""
    size = kind.size(terms, v)
    rounding = check.eps(high(kind.product(size, size)).dtype) * OF_VELOCITIES * size
    return kind.product(rounding, kind.times_G(terms, G, rounding))


def _slopes_and_size(
    at: Scalars, free_energy: Number, sums: Products, energy: Number, smallest: Number, is_first: jax.Array
) -> tuple[Slopes, Number, jax.Array]:
    """(the Slopes, y* . A e, whether the gradient is small). sums: over all terms. energy: e . A e.

    The decrement is d . H d, a sum of squares: d . g is the same, but a difference of products of impulses, of which
    rounding may leave anything, also what is below zero.
    """
    # y* . A e, by the equation of d.
    free_e = sums.impulse_free - sums.free_G_d - at.over_free
    curvature = energy + at.lacking * (2 * free_e + at.lacking * free_energy)
    decrement = curvature + sums.d_G_d
    slope = sums.impulse_d - decrement
    noise = sums.noise + abs(slope) + abs(curvature)
    # Below what rounding errors make of it, no direction goes down.
    rounding = NOISE * check.eps(high(noise).dtype) * noise
    is_small = ~(high(decrement) > high(where(high(rounding) > high(smallest), rounding, smallest)))
    is_near = (high(decrement) < high(NEAR**2 * smallest)) | (high(decrement) < high(NOISY**2 * at.noise))
    is_small = is_small | (is_near & (high(decrement) > high(STALLED * at.residual)) & (high(at.residual) > 0))
    # The first decrement is of another problem.
    return Slopes(slope, curvature, decrement, rounding), free_e, is_small & ~is_first


def _next_scalars(
    at: Scalars,
    length: Number,
    free_e: Number,
    decrement: Number,
    bound: Number,
    noise: Number,
    smallest: Number,
    is_first: jax.Array,
    is_done: jax.Array,
) -> tuple[Scalars, jax.Array]:
    """(those of the next Iterate, whether its gradient is small). bound: see `_after`."""
    bound = where(high(length) == 1, bound, np.inf)
    is_settled = high(bound) <= high(smallest)
    residual = where(is_settled, bound, where(is_first, 0.0, decrement))
    after = Scalars(at.over_free + length * free_e, (1 - length) * at.lacking, residual, noise)
    return Scalars(*(where(is_done, x, y) for x, y in zip(at, after, strict=True))), is_settled


def _momenta(state: MechanismState, scene: Scene, motions: list[Motion], x: Number) -> list[Force]:
    """A x, of velocities x (nv, B) at which the bodies of every bundle have Motions."""
    return [
        problem.momentum(body.inertia, V, body.resistance, problem.of_bundle(state, k, x))
        for k, (body, V) in enumerate(zip(scene.bodies, motions, strict=True))
    ]


def _pushes(scene: Scene, *velocities: Vectors) -> Mask:
    """Contacts that push at any of the velocities; none beside closures, which throw bodies far where they are open."""
    if scene.contacts is None or scene.loops is not None:
        return jnp.zeros((1, 1), bool)
    return _push_at_any(scene.contacts, *(v.points for v in velocities if v.points is not None))


def _push_at_any(contacts: Contacts, *velocities: Vector) -> Mask:
    return functools.reduce(operator.or_, (high(problem.law(contacts, v).normal) > 0 for v in velocities))


class Search(NamedTuple):
    """low, up: the ends of the interval that holds the length. f, rate: the first two derivatives of the cost at the
    length; f is 0 where the search is over. Numbers (1, B)."""

    low: Number
    up: Number
    length: Number
    f: Number
    rate: Number


def _searched(
    state: MechanismState, scene: Scene, v: Vectors, v_d: Vectors, along: Slopes, is_good: jax.Array
) -> Number:
    """The length (1, B) of a step at which the derivative of the cost along it is small, by safeguarded Newton.

    v_d: the velocities of the direction at points and joints. is_good: states for which a whole step is taken.
    """
    shape = 1, state.n
    goal = SLOPE * abs(along.decrement) + along.rounding
    # The first length is 1, whose derivative is not known before the loop: it is evaluated in one place.
    low, one, up, unknown = (as_data(state.known(x), shape) for x in (0.0, 1.0, LONGEST, np.inf))
    start = Search(low, up, one, where(is_good, 0.0, unknown), one)

    def trial(carry: Any) -> Any:
        data, k = carry
        (low, up, length), is_over = _next_length(with_data(start, data), goal, is_good, k == 0)
        f, rate = _derivative(along, length, *_slopes(scene, v, v_d, length), is_over)
        return data_of(Search(low, up, length, f, rate)), k + 1

    def is_going(carry: Any) -> jax.Array:
        data, k = carry
        f = with_data(start, data).f
        return (k <= MOST_TRIALS) & (high(abs(f)) > high(goal)).any()

    data, _ = lax.while_loop(is_going, trial, (data_of(start), np.int32(0)))
    return with_data(start, data).length


def _next_length(at: Search, goal: Number, is_good: jax.Array, is_first: jax.Array) -> tuple[Numbers, jax.Array]:
    """((low, up, the next length to try), whether the search is over and they stay as they are)."""
    is_short = high(at.f) < 0
    low, up = where(is_short, at.length, at.low), where(is_short, at.up, at.length)
    step = at.length - at.f / where(high(at.rate) > 0, at.rate, 1.0)
    is_inside = (high(step) > high(low)) & (high(step) < high(up))
    after = low, up, where(is_inside, step, (low + up) * 0.5)
    is_over = is_good | ~(high(abs(at.f)) > high(goal))
    return tuple(where(is_over | is_first, x, y) for x, y in zip(at[:3], after, strict=True)), is_over


def _derivative(along: Slopes, length: Number, f: Number, rate: Number, is_over: jax.Array) -> tuple[Number, Number]:
    """The first two derivatives of the cost. f, rate: of its terms, see `_slopes`."""
    f = along.slope + length * along.curvature - f
    return where(is_over, 0.0, f), along.curvature + rate


def _slopes(scene: Scene, v: Vectors, v_d: Vectors, length: Number) -> tuple[Number, Number]:
    """(d . impulses, d . G d) at v + length d, summed over all terms."""
    f, rate = of_each(scene, _slope, v, v_d, shared=[length])
    return _total(f), _total(rate)


def _slope(kind: Kind, terms: Any, v: Any, d: Any, length: Number) -> tuple[Number, Number]:
    impulse, G = kind.law(terms, v + length * d)
    return kind.product(impulse, d), kind.product(kind.times_G(terms, G, d), d)
