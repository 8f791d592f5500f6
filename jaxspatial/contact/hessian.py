"""The Hessian of the convex step, H = A + sum J_i^T G_i J_i, and its inverse by articulated bodies.

H is the mass matrix of the same mechanism with the inertia X^T diag(0, G) X added to each body in contact, and with G
added to the armature of joints at limits. Terms between bodies are added by equations in as many unknowns as they have
rows. Neither H nor any Jacobian is ever formed.

A mimic couples joints of different bodies, which no pass over the tree eliminates: for mechanisms with mimics A and the
Jacobians are formed once, and H for each direction.
"""

import functools
import operator
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.contact.term import Columns, OnBodies, Rows, StepData, Term
from jaxspatial.contact.world import Forces, World, tiled, with_zero_rows
from jaxspatial.dynamics.articulated_bodies import (
    ArticulatedBody,
    Elimination,
    bias_beyond_joint,
    with_velocities,
    without_velocity,
)
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.state import MechanismState
from jaxspatial.inertia import articulated
from jaxspatial.numerics.linear import Motion, Wrench
from jaxspatial.numerics.numbers import Number, Numbers, constant, is_constant, is_number, mapped, shape_of, where
from jaxspatial.spatial import algebra

# For each term its velocities or impulses, and None for a term without; or its G.
ByTerm = Sequence[Any]


class System(NamedTuple):
    """A mechanism and the terms that act on it, in all states of a program. coupled: of mechanisms with mimics."""

    world: World
    terms: tuple[Term, ...]
    coupled: "Coupled | None"


class Coupled(NamedTuple):
    """A (nv, nv, B), and J: the velocities of each term at each unit of the generalized velocities, of numbers
    (m, nv, B)."""

    A: Number
    J: tuple[Any, ...]


def system_of(state: MechanismState, step: StepData) -> System:
    """The System of a step."""
    world = World(state, state.numbers(step.dt[:, None])[0])
    terms = tuple(data.to_term(world, step) for data in step.term_data)
    if not state.topology.has_mimics:
        return System(world, terms, None)
    units, n, nv = world.units, state.n, state.topology.nv

    def by_velocity(term: Term):
        u = tiled(term, n, nv).velocities(units.world, units.motions, units.v)
        each = jax.tree.map(lambda x: stacking.spread(x, (term.count, n * nv)), u, is_leaf=is_number)
        return stacking.mapped(lambda w: w.reshape((term.count, nv, n)), each)

    return System(world, terms, Coupled(units.A, tuple(map(by_velocity, terms))))


def wrenches_on_bodies(system: System, impulses: ByTerm) -> list[Wrench]:
    """The wrenches of impulses on the bodies of every bundle, about their origins, in world axes."""
    both = zip(system.terms, impulses, strict=True)
    parts = [part for term, x in both if x is not None for part in term.on_bodies(x)]
    return system.world.on_bundles(parts, system.world.no_wrench)


def forces_on_joints(system: System, impulses: ByTerm) -> Number | None:
    """The generalized forces (nv, B) of impulses beside their wrenches; None for none."""
    both = zip(system.terms, impulses, strict=True)
    found = [f for term, x in both if x is not None and (f := term.on_joints(system.world, x)) is not None]
    return functools.reduce(operator.add, found) if found else None


class Solution(NamedTuple):
    """x = H^-1 (J^T impulses + forces): as numbers (nv, B), and as Motions of the bodies of every bundle.

    remainders: impulse - G J x of each stiff term, else None. Impulses at limits, and of open closures, are large, and
    what is left of them is small: the difference would have rounding errors in proportion to the impulse.
    """

    x: Number
    motions: list[Motion]
    remainders: list[Number | None]


def solve_hessian(system: System, G: ByTerm, balanced: ByTerm, applied: ByTerm, forces: list[Forces]) -> Solution:
    """The Solution for the impulses `balanced` + `applied`, and for forces on every bundle.

    balanced: impulses that G x balances. applied: those that forces balance. Both have the same x, but for rounding
    errors.
    """
    if system.coupled is not None:
        return _solve_with_mimics(system, system.coupled, G, balanced, applied, forces)
    world, terms = system.world, system.terms
    zero = world.state.zero_vector
    nothing = ArticulatedBody(articulated.none(zero[0]), world.no_wrench)
    inertias = world.on_bundles([part for t, g in zip(terms, G, strict=True) for part in t.inertia(g)], nothing.P)
    pushed = wrenches_on_bodies(system, applied)
    touched = [ArticulatedBody(P, -(F + more.on_bodies)) for P, F, more in zip(inertias, pushed, forces, strict=True)]
    impulses_and_G = [world.by_bundle(_on_single_velocities(system, x)) for x in (balanced, G)]
    on_joints = [more.on_joints for more in forces]
    if (tau := forces_on_joints(system, applied)) is not None:
        both = zip(on_joints, world.by_bundle(tau), strict=True)
        on_joints = [tuple(map(operator.add, *x)) for x in both]
    links = list(zip(world.bodies, touched, on_joints, *impulses_and_G, strict=True))
    eliminated = recursion.inward(world.state, _eliminate, nothing, links)
    both = [(body.S, body.r, e) for body, e in zip(world.bodies, eliminated, strict=True)]
    found = recursion.outward(world.state, _accelerate, world.at_rest, both)
    found, remainders = _with_terms_between(system, G, balanced, applied, eliminated, found)
    for k, term in enumerate(terms):
        if (rows := term.single_velocities()) is not None:
            left = world.state.numbers_by_velocity([d.left for d in found])
            remainders[k] = stacking.mapped(lambda w, rows=rows: stacking.rows(w, rows), left)
    return Solution(world.state.numbers_by_velocity([d.x for d in found]), [d.motion for d in found], remainders)


def _on_single_velocities(system: System, numbers: ByTerm) -> Number | None:
    """Numbers (nv, B) of the terms that act on single velocities; None without such terms."""
    both = [(term.single_velocities(), x) for term, x in zip(system.terms, numbers, strict=True)]
    found = [system.world.at_velocities(x, rows) for rows, x in both if rows is not None]
    return functools.reduce(operator.add, found) if found else None


class Direction(NamedTuple):
    """What is found of the bodies of a bundle. x: the velocities of their joints. motion: that of the bodies. left: the
    part of the impulses on single velocities of the joints that G x does not balance."""

    x: Numbers
    motion: Motion
    left: Numbers


class VelocityElimination(NamedTuple):
    """whole: the Elimination of a velocity. D, u: its numbers without the G and the impulse of the joint; None for a
    joint that has none."""

    whole: Elimination
    D: Number | None
    u: Number | None


def _eliminate(link, children: ArticulatedBody) -> tuple[list[VelocityElimination], ArticulatedBody]:
    """([VelocityElimination of each velocity], the articulated body about the parent's origin)."""
    body, touched, tau, impulse, G = link
    P, Z = articulated.of_body(body.inertia) + touched.P + children.P, touched.Z + children.Z
    eliminated = list[VelocityElimination]()
    for s, force, own, resistance, g in zip(body.S, tau, impulse, body.resistance, G, strict=True):
        u = None if is_constant(g) else force - algebra.power(Z, s)
        (P, Z), whole = without_velocity(ArticulatedBody(P, Z), s, force + own, resistance + g)
        eliminated.append(VelocityElimination(whole, None if u is None else algebra.power(whole.U, s) + resistance, u))
    return eliminated, ArticulatedBody(articulated.shifted(P, -body.r), algebra.shifted_wrench(Z, -body.r))


def _accelerate(link, parent: Motion) -> tuple[Direction, Motion]:
    """(the Direction of a body, its motion)."""
    S, r, eliminated = link
    A, found = algebra.shifted_motion(parent, r), list[tuple[Number, Number]]()
    for s, (whole, D, u) in zip(reversed(S), reversed(eliminated), strict=True):
        (x,), after = with_velocities(A, [s], [whole])
        # D x = u + impulse - G x - U . A
        left = constant(x, 0) if D is None or u is None else D * x - (u - algebra.power(whole.U, A))
        found.append((x, left))
        A = after
    x, left = zip(*reversed(found), strict=True) if found else ((), ())
    return Direction(x, A, left), A


# -- terms between bodies ---------------------------------------------------------------------------------------------


def _with_terms_between(
    system: System,
    G: ByTerm,
    balanced: ByTerm,
    applied: ByTerm,
    eliminated: list[list[VelocityElimination]],
    found: list[Direction],
) -> tuple[list[Direction], list[Number | None]]:
    """(what `_accelerate` found, corrected for terms between bodies; what is left of the impulses of these).

    found: x', without the G of these terms and without the impulses that G x balances. With H' all else of H,

        x = x' + Y s        (1 + L^T J Y) s = L^-1 impulse - L^T J x'        Y = H'^-1 J^T L

    of as many columns as there are rows, by the formula of Sherman, Morrison and Woodbury, and impulse - G J x = L s.
    Impulses of open closures are large, and what is left of them is small: so they are never applied as a whole.
    [Golub and Van Loan 2013, 2.1.4]
    """
    world, terms, remainders = system.world, system.terms, list[Any]([None] * len(system.terms))
    by_term = [term.columns(world, g) for term, g in zip(terms, G, strict=True)]
    columns = _side_by_side(world, [part for own in by_term for part in own])
    if columns is None:
        return found, remainders
    state, n, k = world.state, world.state.n, len(columns.b)
    # Of Y, columns are states beside each other.
    Y = _columns_of_Y(system, G, columns, eliminated)
    through = _column_velocities(world.of_states(n * k), tiled(columns, n, k), Y)
    M, on_diagonal = stacking.mapped(lambda w: jnp.broadcast_to(w, (k, k * n)).reshape((k, k, n)), through), np.eye(k)
    M = where(jnp.broadcast_to(on_diagonal.astype(bool)[:, :, None], (k, k, n)), M + 1.0, M)
    right = stacking.spread(-_column_velocities(world, columns, found), (k, n))
    # The columns of each stiff term.
    ends = np.cumsum([0, *(sum(len(part.b) for part in own) for own in by_term)]).tolist()
    places = {i: ends[i : i + 2] for i, t in enumerate(terms) if t.is_stiff and ends[i] < ends[i + 1]}
    # Of these L is diagonal: R^-1/2.
    roots = {i: cast(Rows, terms[i]).R.sqrt() for i in places}
    given = {i: balanced[i] * root for i, root in roots.items()}
    if not all(map(is_constant, given.values())):
        each = [stacking.spread(given[i], (b - a, n)) for i, (a, b) in places.items()]
        rows, in_order = np.full(k, k), np.concatenate([np.arange(a, b) for a, b in places.values()])
        rows[in_order] = np.arange(len(in_order))
        right = right + stacking.mapped(lambda w: with_zero_rows(w, rows), stacking.concatenated(each))
    s = matrices.inverse_times(M, right)
    summed = list[tuple[Numbers, Numbers]]()
    for d, columns_of_d in zip(found, Y, strict=True):
        own = d.x, d.left
        for i in range(k):
            share, here = stacking.mapped(lambda w, i=i: w[i], s), slice(i * n, (i + 1) * n)
            column = stacking.mapped(
                lambda w, here=here: w[..., here] if w.shape[-1] == n * k else w, (columns_of_d.x, columns_of_d.left)
            )
            own = jax.tree.map(lambda a, b, s=share: a + s * b, own, column, is_leaf=is_number)
        summed.append(own)
    # Columns may cancel one another: sums of their motions would have other rounding errors than those of their rates.
    (motions,) = world.motions(state.numbers_by_velocity([x for x, _ in summed]))
    for i, (a, b) in places.items():
        left = stacking.mapped(lambda w, a=a, b=b: w[a:b], s) / roots[i]
        remainders[i] = left if applied[i] is None else left + applied[i]
    return [Direction(x, V, left) for (x, left), V in zip(summed, motions, strict=True)], remainders


def _columns_of_Y(
    system: System, G: ByTerm, columns: Columns, eliminated: list[list[VelocityElimination]]
) -> list[Direction]:
    """Y = H'^-1 J^T L, as `_accelerate` finds a direction: of k columns side by side, in k times as many states."""
    world, n, k = system.world, system.world.state.n, len(columns.b)
    wide, own = world.of_states(n * k), np.eye(k, dtype=bool)[:, :, None]

    def in_own_column(w: jax.Array) -> jax.Array:
        """Row i in column i, zero elsewhere."""
        return jnp.where(own, jnp.broadcast_to(w, (k, n))[:, None], 0).reshape((k, k * n))

    sides = (columns.b, columns.on_b), (columns.a, columns.on_a)
    parts = [OnBodies(bodies, stacking.mapped(in_own_column, x)) for bodies, x in sides]
    on_joints = world.by_bundle(None)
    if columns.on_joints is not None:
        by_velocity = stacking.mapped(lambda w: jnp.swapaxes(w, 0, 1).reshape((-1, k * n)), columns.on_joints)
        on_joints = wide.by_bundle(by_velocity)
    factors = [(b.S, b.r, [x.whole[:2] for x in e]) for b, e in zip(world.bodies, eliminated, strict=True)]
    factors, G_on_joints = tiled((factors, world.by_bundle(_on_single_velocities(system, G))), n, k)
    links = list(zip(factors, wide.on_bundles(parts, world.no_wrench), on_joints, strict=True))
    returned = recursion.inward(wide.state, _to_parent, world.no_wrench, links)
    both = [(S, r, e, g) for (S, r, _), e, g in zip(factors, returned, G_on_joints, strict=True)]
    return recursion.outward(wide.state, _follow, world.at_rest, both)


def _column_velocities(world: World, columns: Columns, found: list[Direction]) -> Number:
    """Columns . (velocities and motions), (k, B)."""
    motions = [d.motion for d in found]
    V_b, V_a = (world.of_bodies(bodies, motions) for bodies in (columns.b, columns.a))
    of_bodies = algebra.power(columns.on_b, V_b) + algebra.power(columns.on_a, V_a)
    if columns.on_joints is None:
        return of_bodies
    x = stacking.mapped(lambda w: w[:, None], world.state.numbers_by_velocity([d.x for d in found]))
    return of_bodies + stacking.pairwise_sum(stacking.mapped(lambda w: jnp.swapaxes(w, 0, 1), columns.on_joints) * x)


def _side_by_side(world: World, parts: list[Columns]) -> Columns | None:
    """All Columns as one; None for none."""
    if len(parts) < 2:
        return parts[0] if parts else None
    n, nv, counts = world.state.n, world.state.topology.nv, [len(part.b) for part in parts]
    on_b, on_a = stacking.concatenated_trees([(part.on_b, part.on_a) for part in parts], n, counts)
    on_joints = [part.on_joints for part in parts]
    if any(x is not None for x in on_joints):
        each = zip(on_joints, counts, strict=True)
        zero = world.state.known(0.0)
        on_joints = stacking.concatenated([stacking.spread(zero if x is None else x, (m, nv, n)) for x, m in each])
    else:
        on_joints = None
    b, a = (tuple(body for bodies in x for body in bodies) for x in list(zip(*parts, strict=True))[:2])
    return Columns(b, a, on_b, on_a, on_joints)


def _to_parent(body, children: Wrench) -> tuple[list[Elimination], Wrench]:
    """([Elimination of each velocity], the bias force about the parent's origin) of a body under a wrench and forces on
    its joint."""
    (S, r, factors), F, tau = body
    eliminated, Z = bias_beyond_joint(children - F, S, factors, tau)
    return eliminated, algebra.shifted_wrench(Z, -r)


def _follow(link, parent: Motion) -> tuple[Direction, Motion]:
    """`_accelerate`, where joints have no impulses."""
    S, r, eliminated, G = link
    x, A = with_velocities(algebra.shifted_motion(parent, r), S, eliminated)
    return Direction(x, A, tuple(-g * y for g, y in zip(G, x, strict=True))), A


# -- mechanisms with mimics -------------------------------------------------------------------------------------------


def _solve_with_mimics(
    system: System, coupled: Coupled, G: ByTerm, balanced: ByTerm, applied: ByTerm, forces: list[Forces]
) -> Solution:
    """`solve_hessian` by elimination: of x, and of what is left of the impulses of stiff terms, z.

        (A + J_c^T G_c J_c) x - J^T z = J_c^T impulse_c + J^T applied + forces        G J x + z = balanced

    with J_c of the other terms. z is no difference of large numbers. z + applied is left.
    """
    world, n, nv, H = system.world, system.world.state.n, system.world.state.topology.nv, coupled.A
    right = world.generalized(forces)
    each = list[Any](zip(system.terms, coupled.J, G, balanced, applied, strict=True))
    stiff, others = ([x for x in each if x[0].is_stiff is flag] for flag in (True, False))
    for term, J, _, _, own in stiff:
        if own is not None:
            on_velocities = stacking.mapped(lambda w: w[:, None], stacking.spread(own, (term.count, n))) * J
            right = right + stacking.pairwise_sum(stacking.spread(on_velocities, (term.count, nv, n)))
    for term, J, g, _, own in others:
        m = term.count
        wide_term, g, own = stacking.mapped(lambda w: w[:, None], (term, g, own))
        rows, columns = (
            stacking.mapped(lambda w: w[:, :, None], J),
            stacking.mapped(lambda w: w[:, None], wide_term.times_G(g, J)),
        )
        J_G_J, pushed = wide_term.product(rows, columns), wide_term.product(J, own)
        H = H + stacking.pairwise_sum(stacking.spread(J_G_J, (m, nv, nv, n)))
        right = right + stacking.pairwise_sum(stacking.spread(pushed, (m, nv, n)))
    if stiff:
        G_stiff = stacking.concatenated([stacking.spread(g, (term.count, n)) for term, _, g, _, _ in stiff])
        given = stacking.concatenated([stacking.spread(own, (term.count, n)) for term, _, _, own, _ in stiff])
        H = _bordered(H, stacking.concatenated([J for _, J, _, _, _ in stiff]), G_stiff)
        right = stacking.concatenated([right, given])
    found, remainders, first = matrices.inverse_times(H, right), list[Number | None](), nv
    for term, _, _, _, own in each:
        if not term.is_stiff:
            remainders.append(None)
            continue
        left = stacking.mapped(lambda w, a=first, b=first + term.count: w[a:b], found)
        remainders.append(left if own is None else left + own)
        first += term.count
    x = stacking.mapped(lambda w: w[:nv], found)
    return Solution(x, world.motions(x)[0], remainders)


def _bordered(H: Number, J: Number, G: Number) -> Number:
    """[[H, -J^T], [G J, 1]], of J (rows, nv, B)."""
    m, n = shape_of(J)[0], shape_of(J)[2]
    own = jnp.broadcast_to(np.eye(m, dtype=bool)[:, :, None], (m, m, n))
    across = -stacking.mapped(lambda w: jnp.swapaxes(w, 0, 1), J)
    below, one = stacking.mapped(lambda w: w[:, None], G) * J, stacking.spread(constant(J, 1), (m, m, n))
    pairs = [(H, across), (below, where(own, one, 0.0))]
    return stacking.concatenated([mapped(lambda *words: jnp.concatenate(words, 1), *pair) for pair in pairs])
