"""Forward dynamics: how a mechanism moves under forces at its joints, by articulated bodies."""

from typing import Any, NamedTuple

import jax
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.lanes import is_known
from jaxspatial.arithmetic.numbers import Lane, constant, high, is_number, noinline, where
from jaxspatial.dynamics import along, dense, program, recursion
from jaxspatial.dynamics.algorithm import DYNAMICS, FRAMES, Algorithm, algorithm, checked, of_rates
from jaxspatial.dynamics.inverse_dynamics import _inverse_dynamics, forces_of
from jaxspatial.dynamics.links import Motion, across, moved, to_parent, upward
from jaxspatial.dynamics.loads import checked_forces, loads
from jaxspatial.dynamics.mass_matrix import matrix_of
from jaxspatial.inertia import articulated, symmetric
from jaxspatial.mechanism.joints import Free


def forward_dynamics(mechanism, q, v, tau, external_forces=None, *, precision=None):
    """vdot (*batch, nv) under the generalised forces tau of the joints: the inverse of `inverse_dynamics`.

    mechanism: Mechanism; q (*batch, nq), v and tau (*batch, nv), tau in N m or N
    external_forces: SpatialForce by name of a frame (bodies are frames, welded links too), each (*batch,), about the
        origin of the frame, in world axes; it acts on the body that carries the frame, see `Mechanism.frame_body`
    Batch shapes broadcast. A rate that nothing resists, of bodies without mass or armature, keeps vdot = 0. With
    mimics the mass matrix is solved instead, in the same precision. Derivatives, of any order and by all numbers of the
    mechanism, are those of inverse dynamics times M^-1, rounded to the dtype of q on the way: n u c in every precision.
    Error of the largest number, for n links one behind the other and c the condition of the mass matrix: at most
    4 n u c in "fast" and "reproducible"; 1.01 u in the other two, while c < 1 / (4 n u). [Featherstone 2008, table 7.1]
    """
    q, v, tau = checked("forward_dynamics", mechanism, q=q, v=v, tau=tau)
    frames, forces = checked_forces("forward_dynamics", mechanism, external_forces, q)
    return _forward_dynamics(precision, mechanism, q, v, tau, forces, frames=frames)


# -- programs ---------------------------------------------------------------------------------------------------------
#
# vdot = FD(q, v, tau) means ID(q, v, vdot) = tau: the derivatives of FD are those of ID at vdot, times M^-1.


class ForwardDynamics(Algorithm):
    """The program of `_forward_dynamics`, differentiated through inverse dynamics. What has found vdot, the factors of
    the mass matrix, is kept for the derivative."""

    def jvp(self, primals, tangents, n_batch):
        # Its result is one array, whether or not it is ever run on its own.
        self.out_tree = jax.tree.structure(0)
        tau = self.n_fields + 2
        vdot, *factors = program.bind(self.sibling(_with_factors), primals, n_batch)
        at, moving = self.with_leaf(primals, tau, vdot), self.with_leaf(tangents, tau, None)
        (felt,) = self.sibling(_inverse_dynamics, at=tau).tangents(at, moving, n_batch)
        force = plus(self.leaf(tangents, tau), minus(felt))
        return [vdot], [_solved(self, primals, factors, force, n_batch)]


class WithFactors(ForwardDynamics):
    """The same of `_with_factors`, for derivatives of derivatives."""

    def jvp(self, primals, tangents, n_batch):
        found = program.bind(self, primals, n_batch)
        (vdot,), (rate,) = self.sibling(_forward_dynamics).jvp(primals, tangents, n_batch)
        return [vdot, *found[1:]], [rate, *map(program.no_tangent, found[1:])]


class Solve(Algorithm):
    """The program of M^-1 times forces, its own transpose. With M a = f, the derivative of a is M^-1 (f' - M' a)."""

    def jvp(self, primals, tangents, n_batch):
        (a,) = program.bind(self, primals, n_batch)
        *own, force = primals
        n = self._place(self.n_fields + 1)
        (felt,) = self.sibling(_mass_times, arrays=2).tangents([*own[:n], a], [*tangents[:n], None], n_batch)
        force = plus(None if program.is_zero(tangents[-1]) else tangents[-1], minus(felt))
        found = program.no_tangent(a) if force is None else program.bind(self, [*own, force], n_batch)[0]
        return [a], [found]

    def transposed(self, cotangents, arguments, n_batch):
        (a,) = program.bind(self, [*arguments[:-1], *cotangents], n_batch)
        return [*[None] * (len(arguments) - 1), program.over_own(a, arguments[-1].aval)]


def _solved(own, primals, factors, force, n_batch):
    """M^-1 of a tangent, None for zero, with the fields, q and factors of a program."""
    if force is None:
        return program.no_tangent(primals[-1])
    solve = own.sibling(_solve, arrays=2 + len(factors))
    return program.bind(solve, [*primals[: own._place(own.n_fields + 1)], *factors, force], n_batch)[0]


def plus(a, b):
    """The sum of tangents, of which None is zero."""
    return a if b is None else b if a is None else a + b


def minus(a):
    return None if a is None else -a


@algorithm(*DYNAMICS, *FRAMES, kind=ForwardDynamics, result=of_rates)
def _forward_dynamics(state, v, tau, forces, *, frames):
    return accelerations(state, v, tau, loads(state, frames, forces), upward(state))[0]


@algorithm(*DYNAMICS, *FRAMES, kind=WithFactors, entries=lambda t: 8 * t.nv)
def _with_factors(state, v, tau, forces, *, frames):
    """And every word of the factors, as it is."""
    vdot, factors = accelerations(state, v, tau, loads(state, frames, forces), upward(state))
    return vdot, *state.words(factors)


@algorithm(*DYNAMICS, *FRAMES, kind=Solve, result=of_rates)
def _solve(state, *factors_and_force):
    *factors, force = factors_and_force
    return solution(state, state.of_words(factors, _form(state)), force)


def _form(state):
    """What factors look like."""
    zero = state.known(0.0)
    if state.topology.has_mimics:
        return [zero, *[()] * (len(state.bundles) - 1)]
    return [zero if _floats(state, b) else [((zero,) * 6, zero)] * b.kind.nv for b in state.bundles]


@algorithm(*DYNAMICS, *FRAMES, result=of_rates)
def _mass_times(state, a):
    return state.by_rate(forces_of(state, None, a, loads(state, (), ()), state.no_vector))


class Articulated(NamedTuple):
    """What a body feels like with all that hangs on it: the wrench P A + Z makes it accelerate by A = (alpha, a)."""

    J: Any
    F: Any
    M: Any
    Z: Any


class Elimination(NamedTuple):
    """Of one rate: vdot = (u - U . A) / D, with A the acceleration without it."""

    U: Any
    D: Any
    u: Any


class RootElimination(NamedTuple):
    """Of a body that floats: matrix vdot = u - P A, with P without rotors; None where A is zero."""

    matrix: Any
    P: Any
    u: Any


class VelocityBias(NamedTuple):
    """Of a body: its angular velocity, its acceleration across the joint without vdot, and the wrench it takes at
    A = 0."""

    w: Any
    c: Any
    Z: Any


def accelerations(state, v, tau, pulled, gravity):
    """(vdot, the factors of the mass matrix), by articulated bodies; with mimics, which tie joints of different bodies
    together, by the matrix."""
    if state.topology.has_mimics:
        M, bias = matrix_of(state), state.numbers_by_rate(forces_of(state, v, None, pulled, gravity))
        return state.rounded(dense.solved(M, dense.rows_of(state, tau) - bias)), [M, *[()] * (len(state.bundles) - 1)]
    own = list(zip(state.links(v, tau), pulled, strict=True))
    zero = state.no_vector
    biases = recursion.outward(state, _velocity_bias, zero, own)
    held = Articulated(zero + zero, zero + zero + zero, zero + zero, zero + zero)
    floats = [_floats(state, b) for b in state.bundles]
    eliminated = recursion.inward(state, _eliminate, held, list(zip(own, biases, floats, strict=True)))
    both = [(link, bias.c, e) for (link, _), bias, e in zip(own, biases, eliminated, strict=True)]
    rates = recursion.outward(state, _accelerate, (zero, gravity), both)
    return state.by_rate(rates), [
        e.matrix if f else [x[:2] for x in e] for e, f in zip(eliminated, floats, strict=True)
    ]


def _floats(state, bundle):
    """Whether nothing holds its bodies, not even another that moves: all six rates are found at once."""
    return bundle.kind is Free and state.is_root(bundle)


def solution(state, factors, force):
    """M^-1 forces, by the factors that `accelerations` found."""
    if state.topology.has_mimics:
        M, *_ = factors
        return state.rounded(dense.solved(M, dense.rows_of(state, force)))
    zero, links = state.no_vector, state.links(None, force)
    left = recursion.inward(state, _pass_on, zero + zero, list(zip(links, factors, strict=True)))
    both = [(link, (zero, zero), e) for link, e in zip(links, left, strict=True)]
    return state.by_rate(recursion.outward(state, _accelerate, (zero, zero), both))


def _pass_on(own, Z):
    """([Elimination of each rate], the wrench that the parent takes), of the bias Z of what hangs on a body."""
    link, factors = own
    if is_number(factors):
        return RootElimination(factors, None, vectors.minus(link.vdot, Z)), Z
    found = []
    for (w, v), (U, D), tau in zip(link.joint.subspace, factors, link.vdot, strict=True):
        u = tau - (vectors.dot(w, Z[:3]) + vectors.dot(v, Z[3:]))
        Z = _with_share(Z, u, articulated.share_of(U, D))
        found.append(Elimination(U, D, u))
    tau, f = to_parent(across(link.placement, link.joint), Z[:3], Z[3:])
    return found, (*tau, *f)


def _velocity_bias(own, w_P):
    """The motion without vdot, under a parent that does not accelerate, and the wrench at that angular velocity."""
    link, load = own
    zero = (constant(w_P[0], 0),) * 3
    motion = moved(link._replace(vdot=tuple(constant(x, 0) for x in link.v)), Motion(w_P, zero, zero))
    Z = vectors.minus(noinline(_of_turning)(link.inertia, motion.w), (*load[0], *load[1]))
    return VelocityBias(motion.w, (motion.alpha, motion.a), Z), motion.w


def _of_turning(inertia, w):
    """The wrench of a body that turns steadily about its origin: tau = w x J w, f = w (w . m c) - m c |w|^2."""
    J, _, _ = articulated.of_body(*inertia)
    moment = vectors.times(inertia.mass, inertia.com)
    f = vectors.minus(vectors.times(vectors.dot(w, moment), w), vectors.times(vectors.dot(w, w), moment))
    return *vectors.cross(w, vectors.matrix_times(symmetric.rows(J), w)), *f


def _eliminate(own, held):
    """([Elimination of each rate], what the parent feels): with P A' + Z the wrench across the joint, A' the
    acceleration of the parent at the joint."""
    (link, _), bias, floats = own
    P = noinline(_held_with)(link.inertia, bias, held)
    if floats:
        return RootElimination(_matrix(P, link.armature), P, vectors.minus(link.vdot, P.Z)), P
    found = []
    for (w, v), tau, armature in zip(link.joint.subspace, link.vdot, link.armature, strict=True):
        P, elimination = _without_rate(P, w, v, tau, armature)
        found.append(elimination)
    return found, _seen_from_parent(across(link.placement, link.joint), P)


def _matrix(P, armature):
    """P with the inertia of rotors, as one number (6, 6, ...)."""
    top, bottom = articulated.by_rows(P.J, P.F, P.M)
    rows = [[*a, *b] for a, b in top + bottom]
    entries = [x + armature[i] if i == k else x for i, row in enumerate(rows) for k, x in enumerate(row)]
    shape = np.broadcast_shapes((1, 1), *(np.shape(high(x)) for x in entries))
    return along.mapped(lambda w: w.reshape((6, 6, *shape)), along.stacked(entries, shape, 0))


def _held_with(inertia, bias, held):
    """Of the body itself and what its children pass on, as a function of A': Z + P c in place of Z."""
    parts = noinline(_combined)(inertia, bias.Z, held)
    c = articulated.product(*parts[:3], *bias.c)
    return Articulated(*parts[:3], vectors.plus(parts[3], c))


def _combined(inertia, Z, held):
    J, F, M = articulated.of_body(*inertia)
    return [vectors.plus(a, b) for a, b in zip((J, F, M, Z), held, strict=True)]


def _without_rate(P, w, v, tau, armature):
    """P with one motion of the joint free, and what finds its rate.

    Across an axis of the frame, without armature, nothing but tau is passed on: these rows are known.
    """
    U, D = articulated.felt(P.J, P.F, P.M, w, v, armature)
    share = articulated.share_of(U, D)
    u = tau - (vectors.dot(w, P.Z[:3]) + vectors.dot(v, P.Z[3:]))
    rest = Articulated(*articulated.without(P.J, P.F, P.M, U, share), noinline(_with_share)(P.Z, u, share))
    k = _free_axis(w, v, armature)
    return rest if k is None else _cleared(rest, k, tau), Elimination(U, D, u)


def _with_share(Z, u, share):
    return vectors.plus(Z, vectors.times(u, share))


def _free_axis(w, v, armature):
    """Which axis of the frame a motion is known to be along, where nothing else resists it; None for all others."""
    known = [x.value if isinstance(x, Lane) and is_known(x.value) else None for x in (*w, *v, armature)]
    if None in known or known[6] != 0 or sorted(map(abs, known[:6])) != [0, 0, 0, 0, 0, 1]:
        return None
    return [abs(x) for x in known].index(1)


def _cleared(P, k, tau):
    """P with a row of known zeros, and what this axis passes on."""
    zero = constant(tau, 0)
    i, is_turn = k % 3, k < 3
    six = {0: (0, 1, 3), 1: (1, 2, 4), 2: (3, 4, 5)}[i]
    nine = [3 * i + j for j in range(3)] if is_turn else [3 * j + i for j in range(3)]
    J, M = (_at(x, six, zero) if turns == is_turn else x for x, turns in ((P.J, True), (P.M, False)))
    return Articulated(J, _at(P.F, nine, zero), M, P.Z)


def _at(numbers, places, number):
    return tuple(number if i in places else x for i, x in enumerate(numbers))


def _seen_from_parent(X_PB, P):
    turned = articulated.turned(P.J, P.F, P.M, X_PB.rows)
    J, F, M = noinline(articulated.shifted)(*turned, tuple(-x for x in X_PB.p))
    tau, f = to_parent(X_PB, P.Z[:3], P.Z[3:])
    return Articulated(J, F, M, (*tau, *f))


def _accelerate(own, parent):
    """(vdot, (alpha, a)) of a body."""
    link, c, eliminated = own
    A = noinline(_carried)(across(link.placement, link.joint), *parent)
    if isinstance(eliminated, RootElimination):
        rates = _floating(eliminated, A)
        A = vectors.plus(A, rates, (*c[0], *c[1]))
        return rates, (A[:3], A[3:])
    rates = []
    for (w, v), (U, D, u) in zip(reversed(link.joint.subspace), reversed(eliminated), strict=True):
        is_none = high(D) <= 0
        rate = where(is_none, 0.0, (u - vectors.dot(U, A)) / where(is_none, 1.0, D))
        A = vectors.plus(A, vectors.times(rate, (*w, *v)))
        rates.append(rate)
    A = vectors.plus(A, (*c[0], *c[1]))
    return tuple(reversed(rates)), (A[:3], A[3:])


def _floating(eliminated, A):
    """The six rates of a body that floats."""
    matrix, P, u = eliminated
    u = u if P is None else vectors.minus(u, articulated.product(P.J, P.F, P.M, A[:3], A[3:]))
    shape = np.broadcast_shapes(np.shape(high(matrix))[2:], *(np.shape(high(x)) for x in u))
    found = dense.solved(matrix, along.stacked(u, shape, 0))
    return tuple(along.mapped(lambda w, k=k: w[k], found) for k in range(6))


def _carried(X_PB, alpha, a):
    """The acceleration of the parent where the joint is, in the child's axes."""
    R_BP = vectors.transpose(X_PB.rows)
    arm = vectors.cross(alpha, X_PB.p)
    return *vectors.matrix_times(R_BP, alpha), *vectors.matrix_times(R_BP, vectors.plus(a, arm))
