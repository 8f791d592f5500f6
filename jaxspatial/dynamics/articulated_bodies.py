"""The articulated-body algorithm: velocities outward, articulated inertias inward, accelerations outward.

[Featherstone 2008, table 7.1]
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from jaxspatial.dynamics.composite_bodies import matrix_of
from jaxspatial.dynamics.external_forces import Load, loads
from jaxspatial.dynamics.kinematics import BodyMotion, body_motion
from jaxspatial.dynamics.newton_euler import forces_of
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.algorithm import Wrenches
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.inertia import articulated
from jaxspatial.inertia.articulated import Articulated
from jaxspatial.mechanism.topology import Bundle
from jaxspatial.numerics import elimination, floats
from jaxspatial.numerics.linear import WHICH_OF_SIX, Matrix, Motion, Symmetric, Vector, Wrench, cross, dot
from jaxspatial.numerics.numbers import (
    Number,
    Numbers,
    constant,
    high,
    is_constant,
    is_number,
    shape_of,
    where,
)
from jaxspatial.spatial import algebra


class ArticulatedBody(NamedTuple):
    """A subtree as an articulated body: the wrench P A + Z gives its root the acceleration A = (alpha, a)."""

    P: Articulated
    Z: Wrench


class Elimination(NamedTuple):
    """The equation of one joint velocity: vdot = (u - U . A) / D, with A the acceleration of the body without it."""

    U: Wrench
    D: Number
    u: Number


class FloatingElimination(NamedTuple):
    """The equation of a floating root: matrix vdot = u - P A. P is without armature, and None where A is zero."""

    matrix: Articulated
    P: Articulated | None
    u: Wrench


class VelocityBias(NamedTuple):
    """The velocity terms of a body: angular velocity, velocity-product acceleration c of its joint, bias force Z."""

    w: Vector
    c: Motion
    Z: Wrench


# What is eliminated of a bundle, and the factors of its part of the mass matrix: (U, D) of each velocity, or P of
# floating roots as one number. With mimics the first is the whole matrix.
Eliminated = FloatingElimination | list[Elimination]
Factors = Number | list[tuple[Wrench, Number]]


def accelerations(state: MechanismState, v: Array, tau: Array, forces: Wrenches) -> tuple[jax.Array, Sequence[Factors]]:
    """(vdot, the factors of the mass matrix), by articulated bodies.

    With mimics, which couple joints of different bodies, by the mass matrix.
    """
    body_loads, gravity, links = loads(state, forces), state.minus_gravity, state.links(v, tau=tau)
    if state.topology.has_mimics:
        M, bias = matrix_of(state), state.numbers_by_velocity(forces_of(state, v, None, body_loads, gravity))
        return _by_matrix(state, M, links, bias), [M, *[[]] * (len(state.bundles) - 1)]
    bodies = list(zip(links, body_loads, strict=True))
    zero = state.zero_vector
    biases = recursion.outward(state, _velocity_bias, zero, bodies)
    nothing = ArticulatedBody(articulated.none(zero[0]), Wrench(zero, zero))
    floating = [has_floating_roots(b) for b in state.bundles]
    eliminated = recursion.inward(state, _eliminate, nothing, list(zip(bodies, biases, floating, strict=True)))
    both = [(link, bias.c, e) for (link, _), bias, e in zip(bodies, biases, eliminated, strict=True)]
    vdot = recursion.outward(state, _accelerate, Motion(zero, gravity), both)
    factors = list[Factors]()
    for e in eliminated:
        if isinstance(e, FloatingElimination):
            # As one number (L, 21, W, B), for other programs.
            entries = jax.tree.leaves(e.matrix, is_leaf=is_number)
            shape = floats.broadcast_shapes((1, 1, 1), *(shape_of(x) for x in entries))
            factors.append(stacking.stacked(entries, shape, 1))
        else:
            factors.append([(x.U, x.D) for x in e])
    return state.by_velocity(vdot), factors


def _by_matrix(state: MechanismState, M: Number, links: list[Link], bias: Number | float = 0.0) -> jax.Array:
    """M^-1 (tau - bias)."""
    return state.rounded(matrices.inverse_times(M, state.of_independent_joints([link.tau for link in links]) - bias))


def has_floating_roots(bundle: Bundle) -> bool:
    """Whether the bodies of a bundle are floating roots, on free joints to the world: six accelerations at once."""
    return bundle.kind.is_unconstrained and bundle.is_on_world


def solution(state: MechanismState, factors: Sequence[Factors], force: Array) -> jax.Array:
    """M^-1 times a force, from the factors that `accelerations` returns."""
    zero, links = state.zero_vector, state.links(tau=force)
    if state.topology.has_mimics and not isinstance(factors[0], list):
        return _by_matrix(state, factors[0], links)
    left = recursion.inward(state, _bias_to_parent, Wrench(zero, zero), list(zip(links, factors, strict=True)))
    at_rest = Motion(zero, zero)
    both = [(link, at_rest, e) for link, e in zip(links, left, strict=True)]
    return state.by_velocity(recursion.outward(state, _accelerate, at_rest, both))


def _bias_to_parent(body: tuple[Link, Factors], Z: Wrench) -> tuple[Eliminated, Wrench]:
    """([Elimination of each velocity], the bias force about the parent's origin), from the children's bias force Z."""
    link, factors = body
    if not isinstance(factors, list):
        entries = [stacking.mapped(lambda w, k=k: w[k], factors) for k in range(shape_of(factors)[0])]
        matrix = Articulated(Symmetric(*entries[:6]), Matrix.of_entries(entries[6:15]), Symmetric(*entries[15:]))
        return FloatingElimination(matrix, None, _wrench(link.tau) - Z), Z
    eliminated, Z = bias_beyond_joint(Z, link.joint.subspace, factors, link.tau)
    return eliminated, algebra.acted_wrench(link.X_PB, Z)


def bias_beyond_joint(
    Z: Wrench, S: Sequence[Motion], factors: Sequence[tuple[Wrench, Number]], tau: Numbers
) -> tuple[list[Elimination], Wrench]:
    """([Elimination of each velocity], the bias force across the joint), from the factors (U, D) of each velocity."""
    eliminated = list[Elimination]()
    for s, (U, D), force in zip(S, factors, tau, strict=True):
        u = force - algebra.power(Z, s)
        Z = Z + u * articulated.UDinv_of(U, D)
        eliminated.append(Elimination(U, D, u))
    return eliminated, Z


def _wrench(six: Numbers) -> Wrench:
    return Wrench(Vector(*six[:3]), Vector(*six[3:]))


# -- outward: velocities ----------------------------------------------------------------------------------------------


def _velocity_bias(body: tuple[Link, Load], w_P: Vector) -> tuple[VelocityBias, Vector]:
    """(the VelocityBias of a body, its angular velocity)."""
    link, (tau, f, _) = body
    zero = Vector(*[constant(w_P[0], 0)] * 3)
    motion = body_motion(link, BodyMotion(w_P, zero, zero))
    # The gyroscopic wrench about the origin: tau = w x J w, f = w (w . m c) - m c |w|^2.
    w, M = motion.w, link.inertia
    J, moment = articulated.of_body(M).J, M.mass * M.com
    gyroscopic = Wrench(cross(w, J @ w), dot(w, moment) * w - dot(w, w) * moment)
    return VelocityBias(w, Motion(motion.alpha, motion.a), gyroscopic - Wrench(tau, f)), w


# -- inward: articulated inertias -------------------------------------------------------------------------------------


def _eliminate(
    body: tuple[tuple[Link, Load], VelocityBias, bool], children: ArticulatedBody
) -> tuple[Eliminated, ArticulatedBody]:
    """([Elimination of each velocity], the articulated body about the parent's origin).

    P A' + Z is the wrench across the joint, with A' the acceleration of the parent at the joint: Z includes P c.
    """
    (link, _), bias, is_floating = body
    P = articulated.of_body(link.inertia) + children.P
    rest = ArticulatedBody(P, bias.Z + children.Z + articulated.apply(P, bias.c))
    # Without accelerations, the rotors of joints that turn their axes take a part.
    tau = tuple(x - y for x, y in zip(link.tau, link.rotor_forces, strict=True))
    if is_floating:
        u, armature = _wrench(tau) - rest.Z, (link.armature[:3], link.armature[3:])
        J, M = (
            Symmetric(xx + a, xy, yy + b, xz, yz, zz + c)
            for (xx, xy, yy, xz, yz, zz), (a, b, c) in zip((rest.P.J, rest.P.M), armature, strict=True)
        )
        return FloatingElimination(Articulated(J, rest.P.F, M), rest.P, u), rest
    eliminated: list[Elimination] = []
    for s, force, armature in zip(link.joint.subspace, tau, link.armature, strict=True):
        rest, elimination = without_velocity(rest, s, force, armature)
        eliminated.append(elimination)
    X_PB = link.X_PB
    P = articulated.shifted(articulated.reexpressed(rest.P, X_PB.R), -X_PB.p)
    return eliminated, ArticulatedBody(P, algebra.acted_wrench(X_PB, rest.Z))


def without_velocity(
    body: ArticulatedBody, s: Motion, tau: Number, armature: Number
) -> tuple[ArticulatedBody, Elimination]:
    """The articulated body with one motion of the joint free, and the Elimination that gives the acceleration of it.

    Along an axis of the frame, without armature, nothing but tau is transmitted: this row of P is known to be zero.
    """
    P, Z = body
    U, D = articulated.U_and_D(P, s, armature)
    UDinv = articulated.UDinv_of(U, D)
    u = tau - algebra.power(Z, s)
    Z = Z + u * UDinv
    P = _with_known_zeros(articulated.rank_one_downdate(P, U, UDinv), s, armature)
    return ArticulatedBody(P, Z), Elimination(U, D, u)


def _with_known_zeros(P: Articulated, s: Motion, armature: Number) -> Articulated:
    """P with known zeros in the row and column of s, if that is known to be along an axis and without armature."""
    *known, resisting = (abs(float(x.value)) if is_constant(x) else np.nan for x in (*s.w, *s.v, armature))
    if resisting != 0 or sorted(known) != [0, 0, 0, 0, 0, 1]:
        return P

    def zeroed(numbers: Numbers, places: Sequence[int]) -> Numbers:
        return [constant(armature, 0) if i in places else x for i, x in enumerate(numbers)]

    k = known.index(1)
    i, of_symmetric = k % 3, WHICH_OF_SIX[k % 3]
    if k < 3:
        F = Matrix.of_entries(zeroed(P.F.entries, range(3 * i, 3 * i + 3)))
        return Articulated(Symmetric(*zeroed(P.J, of_symmetric)), F, P.M)
    F = Matrix.of_entries(zeroed(P.F.entries, range(i, 9, 3)))
    return Articulated(P.J, F, Symmetric(*zeroed(P.M, of_symmetric)))


# -- outward: accelerations -------------------------------------------------------------------------------------------


def _accelerate(body: tuple[Link, Motion, Eliminated], parent: Motion) -> tuple[Numbers, Motion]:
    """(vdot, the acceleration (alpha, a)) of a body."""
    link, c, eliminated = body
    X_PB = link.X_PB
    R_BP = X_PB.R.T
    # That of the parent at the joint, in the child's axes.
    A = Motion(R_BP @ parent.w, R_BP @ (parent.v + cross(parent.w, X_PB.p)))
    if isinstance(eliminated, FloatingElimination):
        matrix, P, u = eliminated
        right = u if P is None else u - articulated.apply(P, A)
        lower = [row[: i + 1] for i, row in enumerate(articulated.six_rows(matrix))]
        six = elimination.solve(lower, (*right.tau, *right.f))
        return six, A + Motion(Vector(*six[:3]), Vector(*six[3:])) + c
    vdot, A = with_velocities(A, link.joint.subspace, eliminated)
    return vdot, A + c


def with_velocities(A: Motion, S: Sequence[Motion], eliminated: Sequence[Elimination]) -> tuple[Numbers, Motion]:
    """(the accelerations of the joint, that of the body), from that of the body without them."""
    found = list[Number]()
    for s, (U, D, u) in zip(reversed(S), reversed(eliminated), strict=True):
        is_none = high(D) <= 0
        x = where(is_none, 0.0, (u - dot((*U.tau, *U.f), (*A.w, *A.v))) / where(is_none, 1.0, D))
        A = A + x * s
        found.append(x)
    return tuple(reversed(found)), A
