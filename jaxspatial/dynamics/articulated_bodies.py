"""The articulated-body algorithm: outward for velocities, inward for articulated inertias, outward for accelerations.

[Featherstone 2008, table 7.1]
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.numbers import constant, high, is_constant, is_number, noinline, shape_of, where
from jaxspatial.arithmetic.numbers.protocol import Motion, Number, Numbers, Symmetric, Three
from jaxspatial.dynamics import along, dense, recursion
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.arguments import Wrenches
from jaxspatial.dynamics.links import BodyMotion, across, body_motion, minus_gravity, to_parent
from jaxspatial.dynamics.loads import loads
from jaxspatial.dynamics.mass_matrix import matrix_of
from jaxspatial.dynamics.recursive_newton_euler import forces_of
from jaxspatial.dynamics.state import Inertia, Link, Load, MechanismState, Pose
from jaxspatial.inertia import articulated
from jaxspatial.mechanism.topology import Bundle
from jaxspatial.spatial import algebra


class Articulated(NamedTuple):
    """The articulated body of a subtree: the wrench P A + Z gives its root the acceleration A = (alpha, a)."""

    J: Symmetric
    F: Numbers
    M: Symmetric
    Z: Numbers


class Elimination(NamedTuple):
    """Of one rate: vdot = (u - U . A) / D, with A the acceleration without it."""

    U: Numbers
    D: Number
    u: Number


class RootElimination(NamedTuple):
    """Of a floating root: matrix vdot = u - P A, with P without armature; None where A is zero."""

    matrix: Number
    P: Articulated | None
    u: Numbers


class VelocityBias(NamedTuple):
    """Of a body: angular velocity, velocity-product acceleration c of the joint, and the bias force Z at A = 0."""

    w: Three
    c: Motion
    Z: Numbers


def accelerations(state: MechanismState, v: Array, tau: Array, forces: Wrenches) -> tuple[jax.Array, list[Any]]:
    """(vdot, the factors of the mass matrix), by articulated bodies; with mimics, which tie joints of different bodies
    together, by the matrix."""
    body_loads, gravity, links = loads(state, forces), minus_gravity(state), state.links(v, tau=tau)
    if state.topology.has_mimics:
        M, bias = matrix_of(state), state.numbers_by_rate(forces_of(state, v, None, body_loads, gravity))
        return _by_matrix(state, M, links, bias), [M, *[()] * (len(state.bundles) - 1)]
    own = list(zip(links, body_loads, strict=True))
    zero = state.no_vector
    biases = recursion.outward(state, _velocity_bias, zero, own)
    children = Articulated(zero + zero, zero + zero + zero, zero + zero, zero + zero)
    floating = [floats(b) for b in state.bundles]
    eliminated = recursion.inward(state, _eliminate, children, list(zip(own, biases, floating, strict=True)))
    both = [(link, bias.c, e) for (link, _), bias, e in zip(own, biases, eliminated, strict=True)]
    rates = recursion.outward(state, _accelerate, (zero, gravity), both)
    return state.by_rate(rates), [
        e.matrix if f else [x[:2] for x in e] for e, f in zip(eliminated, floating, strict=True)
    ]


def _by_matrix(state: MechanismState, M: Number, links: list[Link], bias: Number | float = 0.0):
    """M^-1 (tau - bias)."""
    return state.rounded(dense.solved(M, state.own_rates([link.tau for link in links]) - bias))


def floats(bundle: Bundle):
    """Whether its bodies are floating roots, on free joints to the world: all six rates are found at once."""
    return bundle.kind.is_unconstrained and bundle.is_on_world


def solution(state: MechanismState, factors: list[Any], force: Array):
    """M^-1 forces, by the factors that `accelerations` found."""
    zero, links = state.no_vector, state.links(tau=force)
    if state.topology.has_mimics:
        return _by_matrix(state, factors[0], links)
    left = recursion.inward(state, _bias_to_parent, zero + zero, list(zip(links, factors, strict=True)))
    both = [(link, (zero, zero), e) for link, e in zip(links, left, strict=True)]
    return state.by_rate(recursion.outward(state, _accelerate, (zero, zero), both))


def _bias_to_parent(own: tuple[Link, Any], Z: Numbers) -> tuple[Any, Numbers]:
    """([Elimination of each rate], the bias force transformed to the parent), of the bias force Z of a subtree."""
    link, factors = own
    if is_number(factors):
        return RootElimination(factors, None, vectors.minus(link.tau, Z)), Z
    found, rest = list[Elimination](), Z
    for (w, v), (U, D), tau in zip(link.joint.subspace, factors, link.tau, strict=True):
        u = tau - algebra.power((rest[:3], rest[3:]), (w, v))
        rest = _bias_through_joint(rest, u, articulated.UDinv_of(U, D))
        found.append(Elimination(U, D, u))
    tau, f = to_parent(across(link.placement, link.joint), rest[:3], rest[3:])
    return found, (*tau, *f)


def _velocity_bias(own: tuple[Link, Load], w_P: Three):
    """The VelocityBias of a body, under a parent that does not accelerate."""
    link, load = own
    zero = (constant(w_P[0], 0),) * 3
    motion = body_motion(link, BodyMotion(w_P, zero, zero))
    Z = vectors.minus(noinline(_gyroscopic)(link.inertia, motion.w), (*load[0], *load[1]))
    return VelocityBias(motion.w, (motion.alpha, motion.a), Z), motion.w


def _gyroscopic(inertia: Inertia, w: Three) -> Numbers:
    """The gyroscopic wrench about the origin: tau = w x J w, f = w (w . m c) - m c |w|^2."""
    J, _, _ = articulated.of_body(*inertia)
    moment = vectors.times(inertia.mass, inertia.com)
    f = vectors.minus(vectors.times(vectors.dot(w, moment), w), vectors.times(vectors.dot(w, w), moment))
    return *vectors.cross(w, vectors.matrix_times(symmetric.rows(J), w)), *f


def _eliminate(own: tuple[tuple[Link, Load], VelocityBias, bool], children: Articulated) -> tuple[Any, Articulated]:
    """([Elimination of each rate], the articulated body about the parent): P A' + Z is the wrench across the joint, A'
    the acceleration of the parent at the joint."""
    (link, _), bias, is_floating = own
    rest = noinline(_articulated)(link.inertia, bias, children)
    if is_floating:
        return RootElimination(_matrix(rest, link.armature), rest, vectors.minus(link.tau, rest.Z)), rest
    found: list[Elimination] = []
    for (w, v), tau, armature in zip(link.joint.subspace, link.tau, link.armature, strict=True):
        rest, elimination = _without_rate(rest, w, v, tau, armature)
        found.append(elimination)
    return found, _to_parent(across(link.placement, link.joint), rest)


def _matrix(P: Articulated, armature: Numbers):
    """P with the inertia of rotors, as one number (6, 6, ...)."""
    top, bottom = articulated.by_rows(P.J, P.F, P.M)
    rows = [[*a, *b] for a, b in top + bottom]
    entries = [x + armature[i] if i == k else x for i, row in enumerate(rows) for k, x in enumerate(row)]
    shape = np.broadcast_shapes((1, 1), *(shape_of(x) for x in entries))
    return along.mapped(lambda w: w.reshape((6, 6, *shape)), along.stacked(entries, shape, 0))


def _articulated(inertia: Inertia, bias: VelocityBias, children: Articulated):
    """The articulated body of a body and its children, as a function of A': Z + P c in place of Z."""
    P = noinline(_combined)(inertia, bias.Z, children)
    return P._replace(Z=vectors.plus(P.Z, articulated.times_motion(P.J, P.F, P.M, *bias.c)))


def _combined(inertia: Inertia, Z: Numbers, children: Articulated):
    J, F, M = articulated.of_body(*inertia)
    return Articulated(*(vectors.plus(a, b) for a, b in zip((J, F, M, Z), children, strict=True)))


def _without_rate(P: Articulated, w: Three, v: Three, tau: Number, armature: Number):
    """P with one motion of the joint free, and what finds its rate.

    Along an axis of the frame, without armature, only tau reaches the parent: these rows are known.
    """
    U, D = articulated.U_and_D(P.J, P.F, P.M, w, v, armature)
    UDinv = articulated.UDinv_of(U, D)
    u = tau - algebra.power((P.Z[:3], P.Z[3:]), (w, v))
    rest = Articulated(
        *articulated.rank_one_downdate(P.J, P.F, P.M, U, UDinv), noinline(_bias_through_joint)(P.Z, u, UDinv)
    )
    k = _free_axis(w, v, armature)
    return rest if k is None else _with_zero_row(rest, k, tau), Elimination(U, D, u)


def _bias_through_joint(Z: Numbers, u: Number, UDinv: Numbers):
    """Z + U D^-1 u."""
    return vectors.plus(Z, vectors.times(u, UDinv))


def _free_axis(w: Three, v: Three, armature: Number) -> int | None:
    """Which axis of the frame a motion is known to be along, where nothing else resists it; None for all others."""
    *known, resisting = (abs(float(x.value)) if is_constant(x) else np.nan for x in (*w, *v, armature))
    return known.index(1) if resisting == 0 and sorted(known) == [0, 0, 0, 0, 0, 1] else None


def _with_zero_row(P: Articulated, k: int, tau: Number):
    """P with a row of known zeros; tau along this axis reaches the parent."""
    zero = constant(tau, 0)
    i, is_turn = k % 3, k < 3
    six = {0: (0, 1, 3), 1: (1, 2, 4), 2: (3, 4, 5)}[i]
    nine = [3 * i + j for j in range(3)] if is_turn else [3 * j + i for j in range(3)]
    J, M = (_at(x, six, zero) if turns == is_turn else x for x, turns in ((P.J, True), (P.M, False)))
    return Articulated(J, _at(P.F, nine, zero), M, P.Z)


def _at(numbers: Numbers, places: Sequence[int], number: Number):
    return tuple(number if i in places else x for i, x in enumerate(numbers))


def _to_parent(X_PB: Pose, P: Articulated):
    rotated = articulated.reexpressed(P.J, P.F, P.M, X_PB.rows)
    J, F, M = noinline(articulated.shifted)(*rotated, tuple(-x for x in X_PB.p))
    tau, f = to_parent(X_PB, P.Z[:3], P.Z[3:])
    return Articulated(J, F, M, (*tau, *f))


def _accelerate(own: tuple[Link, Motion, Any], parent: Motion) -> tuple[Numbers, Motion]:
    """(vdot, (alpha, a)) of a body."""
    link, c, eliminated = own
    found = noinline(_parent_acceleration)(across(link.placement, link.joint), *parent)
    if isinstance(eliminated, RootElimination):
        six = _floating(eliminated, found)
        found = vectors.plus(found, six, (*c[0], *c[1]))
        return six, (found[:3], found[3:])
    rates: list[Number] = []
    for (w, v), (U, D, u) in zip(reversed(link.joint.subspace), reversed(eliminated), strict=True):
        is_none = high(D) <= 0
        rate = where(is_none, 0.0, (u - vectors.dot(U, found)) / where(is_none, 1.0, D))
        found = vectors.plus(found, vectors.times(rate, (*w, *v)))
        rates.append(rate)
    found = vectors.plus(found, (*c[0], *c[1]))
    return tuple(reversed(rates)), (found[:3], found[3:])


def _floating(eliminated: RootElimination, A: Numbers):
    """The six rates of a floating root."""
    matrix, P, u = eliminated
    u = u if P is None else vectors.minus(u, articulated.times_motion(P.J, P.F, P.M, A[:3], A[3:]))
    shape = np.broadcast_shapes(shape_of(matrix)[2:], *(shape_of(x) for x in u))
    found = dense.solved(matrix, along.stacked(u, shape, 0))
    return tuple(along.mapped(lambda w, k=k: w[k], found) for k in range(6))


def _parent_acceleration(X_PB: Pose, alpha: Three, a: Three) -> Numbers:
    """The acceleration of the parent where the joint is, in the child's axes."""
    R_BP = vectors.transpose(X_PB.rows)
    arm = vectors.cross(alpha, X_PB.p)
    return *vectors.matrix_times(R_BP, alpha), *vectors.matrix_times(R_BP, vectors.plus(a, arm))
