"""A mechanism in world axes, as the convex step needs it: its bodies, and passes over its tree.

Spatial vectors are about the origins of joints: passes move them from body to body without turning them. Velocities are
along the axes of joints, but those of floating roots along the axes of the world, see `World.turned`.
"""

import copy
import functools
import itertools
import operator
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.contact.term import OnBodies
from jaxspatial.dynamics.articulated_bodies import has_floating_roots
from jaxspatial.dynamics.composite_bodies import combined
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState, across
from jaxspatial.inertia import articulated
from jaxspatial.inertia.articulated import Articulated
from jaxspatial.mechanism.topology import Bundle
from jaxspatial.numerics.linear import Inertia, Matrix, Motion, Symmetric, Vector, Wrench, congruence, dot
from jaxspatial.numerics.numbers import (
    Mask,
    Number,
    Numbers,
    data_of,
    high,
    is_constant,
    is_number,
    where,
    with_data,
)
from jaxspatial.spatial import algebra

T = TypeVar("T")


class Ends(NamedTuple):
    """The bodies b and a that each of n impulses acts between, -1 for the world."""

    b: tuple[int, ...]
    a: tuple[int, ...]

    @property
    def between_bodies(self) -> np.ndarray:
        """Which impulses act between two bodies."""
        return np.flatnonzero(np.array(self.a) >= 0)


class Bodies(NamedTuple):
    """The bodies of a bundle. R: their axes. r: positions from the parent's origin.

    S: the motions of each velocity of their joints. resistance: armature, and dt times the damping of the joint.
    is_along_world: whether velocities are along the axes of the world, and not along those of the bodies: of floating
    roots, whose motions S are then known.
    """

    R: Matrix
    r: Vector
    S: tuple[Motion, ...]
    inertia: Inertia
    resistance: Numbers
    is_along_world: bool


class Forces(NamedTuple):
    """Forces on the bodies of a bundle, about their origins in world axes, and on the velocities of their joints."""

    on_bodies: Wrench
    on_joints: Numbers


class World:
    """A mechanism in its states. dt: (1, B). bodies: the Bodies of every bundle.

    What depends on the state alone is computed where it is first asked for, before any loop of the solver.
    """

    def __init__(self, state: MechanismState, dt: Number):
        self.state, self.dt = state, dt
        # The damping takes the place of the force, which the step has in `y_free`.
        links = [
            x._replace(tau=state.own(b, state.fields["damping"]))
            for x, b in zip(state.links(), state.bundles, strict=True)
        ]
        frames = [(link.placement, link.joint, b.is_on_world) for link, b in zip(links, state.bundles, strict=True)]
        placed = recursion.outward(state, _placed, state.world.R, frames)
        self.bodies = [self._body(b, x, link) for b, x, link in zip(state.bundles, placed, links, strict=True)]

    def _body(self, bundle: Bundle, placed: tuple[Matrix, Vector], link: Link) -> Bodies:
        (R, r), M = placed, link.inertia
        dt = stacking.mapped(lambda w: w[None], self.dt)
        S = tuple(Motion(R @ s.w, R @ s.v) for s in link.joint.subspace)
        inertia = Inertia(M.mass, R @ M.com, congruence(R, M.central))
        # The time is the same for all rows.
        resistance = stacking.mapped(
            lambda w: jnp.broadcast_to(w, (bundle.length, *w.shape[1:])),
            tuple(a + dt * c for a, c in zip(link.armature, link.tau, strict=True)),
        )
        # What acts along the axes of bodies keeps velocities along these: dry friction too.
        friction = self.state.own(bundle, self.state.fields["friction_loss"])
        is_free = all(is_constant(x) and x.value == 0 for x in (*resistance, *friction))
        is_along_world = has_floating_roots(bundle) and is_free
        if is_along_world:
            S = self._along_world
        return Bodies(R, r, S, inertia, resistance, is_along_world)

    @property
    def _along_world(self) -> tuple[Motion, ...]:
        """The motions of a free joint along the axes of the world."""
        e, zero = self.state.world.R, self.state.zero_vector
        return *(Motion(x, zero) for x in e), *(Motion(zero, x) for x in e)

    def of_states(self, n: int) -> "World":
        """The same in n states, of which the caller has all numbers."""
        other = copy.copy(self)
        other.state = copy.copy(self.state)
        other.state.n = n
        return other

    # -- generalized velocities ---------------------------------------------------------------------------------------

    def velocity_numbers(self, *vectors: Array) -> list[Number]:
        """Generalized velocities as numbers (nv, B), those of floating roots in world axes."""
        return [self.turned(self.state.numbers(x[:, None])[0], to_world=True) for x in vectors]

    def turned(self, v: Number, to_world: bool) -> Number:
        """Velocities (nv, B) with those of floating roots in world axes, from those along the axes of bodies; or
        back."""
        if not any(body.is_along_world for body in self.bodies):
            return v
        by_bundle = self.by_bundle(v)
        for k, body in enumerate(self.bodies):
            if body.is_along_world:
                R = body.R if to_world else body.R.T
                by_bundle[k] = (*(R @ Vector(*by_bundle[k][:3])), *(R @ Vector(*by_bundle[k][3:])))
        return self.state.numbers_by_velocity(by_bundle)

    def by_bundle(self, x: Number | None) -> list[Numbers]:
        """The numbers (nv, B) of every bundle, zeros for mimics and for None."""
        if x is None:
            return [(self.state.known(0.0),) * len(body.S) for body in self.bodies]
        t, found = self.state.topology, list[Numbers]()
        for b in self.state.bundles:
            numbers = _rows_of_bundle(self.state, b, x)
            if t.has_mimics_in(b):
                is_own = jnp.asarray(~np.vectorize(t.is_mimic)(b.bodies)[:, :, None])
                numbers = tuple(where(is_own, y, 0.0) for y in numbers)
            found.append(numbers)
        return found

    def rates(self, k: int, v: Number) -> Numbers:
        """The velocities of the joints of bundle k, of generalized velocities (nv, B)."""
        b = self.state.bundles[k]
        rates = _rows_of_bundle(self.state, b, v)
        if not self.state.topology.has_mimics_in(b):
            return rates
        multiplier, _ = self.state.mimics(b)
        return tuple(multiplier * y for y in rates)

    def at_velocities(self, x: Number, rows: np.ndarray) -> Number:
        """Numbers (nv, B): x (m, B) in rows, zero elsewhere."""
        places = np.full(self.state.topology.nv, len(rows))
        places[rows] = np.arange(len(rows))
        return stacking.mapped(lambda w: with_zero_rows(w, places), x)

    # -- motions of bodies --------------------------------------------------------------------------------------------

    @property
    def at_rest(self) -> Motion:
        return Motion(self.state.zero_vector, self.state.zero_vector)

    @property
    def no_wrench(self) -> Wrench:
        return Wrench(self.state.zero_vector, self.state.zero_vector)

    def motions(self, *velocities: Number) -> list[list[Motion]]:
        """The Motion of every bundle at each of several generalized velocities (nv, B)."""
        by_bundle = [[self.rates(k, v) for v in velocities] for k in range(len(self.bodies))]
        both = [(body.S, body.r, x) for body, x in zip(self.bodies, by_bundle, strict=True)]
        found = recursion.outward(self.state, _velocity, (self.at_rest,) * len(velocities), both)
        return [[V[k] for V in found] for k in range(len(velocities))]

    def of_bodies(self, bodies: Sequence[int], motions: list[Motion]) -> Motion:
        """The motions (n, B) of n bodies."""
        return self.state.of_bodies(bodies, motions, self.at_rest)

    def momenta(self, motions: list[Motion], v: Number) -> list[Forces]:
        """A v, of velocities v (nv, B) at which the bodies have these motions."""
        found = list[Forces]()
        for k, (body, V) in enumerate(zip(self.bodies, motions, strict=True)):
            on_joints = tuple(a * rate for a, rate in zip(body.resistance, self.rates(k, v), strict=True))
            found.append(Forces(algebra.apply_inertia(body.inertia, V), on_joints))
        return found

    def twice_energy(self, motions: list[Motion], v: Number) -> Number:
        """v^T A v, (1, B)."""
        parts = list[Number]()
        for k, (body, V) in enumerate(zip(self.bodies, motions, strict=True)):
            total = algebra.twice_energy(body.inertia, V)
            for a, rate in zip(body.resistance, self.rates(k, v), strict=True):
                total = total + a * rate * rate
            parts.append(total)
        return stacking.mapped(lambda w: w[None], self.state.sum_over_bodies(parts))

    def generalized(self, forces: list[Forces]) -> Number:
        """The generalized forces (nv, B) of forces on every bundle."""
        links = [(body.S, body.r, F) for body, F in zip(self.bodies, forces, strict=True)]
        return self.state.numbers_by_velocity(recursion.inward(self.state, _joint_forces, self.no_wrench, links))

    # -- numbers of several bodies ------------------------------------------------------------------------------------

    def arms(self, frames: Sequence[int], positions: Array | None, offsets: Array) -> Vector:
        """Points (n, B) from the origins of the bodies that carry n frames, in world axes.

        positions: in the frames, None for their origins; offsets: from there, in world axes; arrays (3 n, B)."""
        state = self.state
        bodies = state.topology.bodies_of(frames)
        R, X_JF = state.of_bodies(bodies, [x.R for x in self.bodies], state.world.R), state.frame_placements(frames)
        return R @ (X_JF.p + X_JF.R @ state.vectors(positions)) + state.vectors(offsets)

    def on_bundles(self, parts: list[OnBodies], nothing: T) -> list[T]:
        """Numbers (n, B) of bodies as those of every bundle: their sums where a body comes several times.

        Known numbers are zeros. nothing: known zeros, for bundles without any of the bodies.
        """
        carriers = [body for part in parts for body in part.bodies]
        bodies = sorted(set(carriers) - {-1})
        if not bodies:
            return [nothing] * len(self.bodies)
        tree = parts[0].numbers
        if len(parts) > 1:
            counts = [len(part.bodies) for part in parts]
            tree = stacking.concatenated_trees([part.numbers for part in parts], self.state.n, counts)
        of_body = [[k for k, c in enumerate(carriers) if c == body] for body in bodies]
        most, shape = max(map(len, of_body)), (len(carriers), self.state.n)
        # Row n is zero.
        places = np.array([[x[k] if k < len(x) else len(carriers) for x in of_body] for k in range(most)])

        def summed(x: Number) -> Number:
            if is_constant(x):
                return x
            x = stacking.mapped(lambda w: with_zero_rows(jnp.broadcast_to(w, shape), places.ravel()), x)
            whole = stacking.mapped(lambda w: w.reshape((*places.shape, shape[1])), x)
            return stacking.pairwise_sum(whole) if most > 1 else stacking.mapped(lambda w: w[0], whole)

        sums = jax.tree.map(summed, tree, is_leaf=is_number)
        found = list[T]()
        for bundle in self.state.bundles:
            own = np.array([bodies.index(i) if i in bodies else len(bodies) for i in bundle.bodies.ravel().tolist()])
            if (own == len(bodies)).all():
                found.append(nothing)
                continue
            over = *bundle.bodies.shape, -1
            found.append(stacking.mapped(lambda w, own=own, over=over: with_zero_rows(w, own).reshape(over), sums))
        return found

    # -- the diagonal of A, and of the Delassus operator --------------------------------------------------------------

    @functools.cached_property
    def units(self) -> "Units":
        """The Units of a mechanism with mimics."""
        state = self.state
        n, nv = state.n, state.topology.nv
        wide = self.of_states(n * nv)
        wide.bodies = tiled(self.bodies, n, nv)
        wide.state.fields = {**state.fields, "mimics": tiled(state.fields["mimics"], n, nv)}
        (v,) = wide.state.numbers(jnp.repeat(jnp.eye(nv, dtype=state.dtype), n, axis=1)[:, None])
        (motions,) = wide.motions(v)
        A = stacking.mapped(lambda w: w.reshape((nv, nv, n)), wide.generalized(wide.momenta(motions, v)))
        diagonal = stacking.concatenated([stacking.mapped(lambda w, i=i: w[i, i][None], A) for i in range(nv)])
        roots = [
            (state.topology.v_starts[i], state.of_bodies([i], [x.R for x in self.bodies], state.world.R))
            for b, body in zip(state.bundles, self.bodies, strict=True)
            if has_floating_roots(b) and not body.is_along_world
            for i in b.bodies.ravel().tolist()
        ]
        return Units(wide, v, motions, A, diagonal, roots)

    @functools.cached_property
    def composites(self) -> list[Inertia]:
        """The inertia of each body and of all that hang on it, about its origin, of every bundle."""
        links = [(body.inertia, body.r) for body in self.bodies]
        return recursion.inward(self.state, _composite, self.state.zero_inertia, links, join=combined)

    def diagonal_by_bundle(self, bodies: Sequence[Bodies]) -> list[Numbers]:
        """The diagonal of A without mimics, for motions S of bodies: for every bundle a number of each velocity."""
        return [
            tuple(
                algebra.power(algebra.apply_inertia(M, s), s) + a for s, a in zip(body.S, body.resistance, strict=True)
            )
            for body, M in zip(bodies, self.composites, strict=True)
        ]

    @functools.cached_property
    def diagonal(self) -> Number:
        """The diagonal of A (nv, B)."""
        if self.state.topology.has_mimics:
            return self.units.diagonal
        return self.state.numbers_by_velocity(self.diagonal_by_bundle(self.bodies))

    @functools.cached_property
    def mobility(self) -> list[Articulated]:
        """S D^-1 S^T of the velocities that carry each body, with D the diagonal of A, of every bundle.

        As an Articulated with velocities in place of torques and angular velocities in place of forces: both move to
        another point alike. Velocities of floating roots count along the axes of the world. So how hard contacts are
        does not depend on which numbers are known while tracing.
        """
        bodies = list(self.bodies)
        for k, (b, body) in enumerate(zip(self.state.bundles, self.bodies, strict=True)):
            if has_floating_roots(b) and not body.is_along_world:
                # The resistance is the diagonal along these axes.
                turning, moving = Vector(*body.resistance[:3]), Vector(*body.resistance[3:])
                squares = [Vector(*(x * x for x in row)) for row in body.R]
                resistance = tuple(dot(x, own) for own in (turning, moving) for x in squares)
                bodies[k] = body._replace(S=self._along_world, resistance=resistance)
        both = [(body.S, body.r, d) for body, d in zip(bodies, self.diagonal_by_bundle(bodies), strict=True)]
        return recursion.outward(self.state, _mobility, articulated.none(self.state.known(0.0)), both)

    def relative_mobility(self, ends: Ends, arm_b: Vector, arm_a: Vector) -> tuple[Articulated, Articulated]:
        """J D^-1 J^T of the motion of bodies b for observers on bodies a, about points: numbers (n, B); and the same as
        if they moved on their own.

        arm_b, arm_a: the points, from the origins of b and a. What carries both bodies moves neither for the other.
        """
        if self.state.topology.has_mimics:
            return self.units.relative_mobility(self.state.n, ends, arm_b, arm_a)
        state, nothing = self.state, articulated.none(self.state.known(0.0))
        whole = articulated.shifted(state.of_bodies(ends.b, self.mobility, nothing), arm_b)
        if not len(ends.between_bodies):
            return whole, whole
        t = state.topology
        common, from_common = list[int](), list[Vector]()
        for b, a in zip(*ends, strict=True):
            behind = [i for i in t.ancestors(b) if i not in set(t.ancestors(a))]
            common.append(t.parents[behind[-1]] if behind else b)
            arms = [state.of_bodies([i], [body.r for body in self.bodies], state.zero_vector) for i in behind]
            from_common.append(functools.reduce(operator.add, arms, state.zero_vector))
        whole = whole + articulated.shifted(state.of_bodies(ends.a, self.mobility, nothing), arm_a)
        arm = arm_b + stacking.concatenated_trees(from_common, state.n)
        return whole - 2.0 * articulated.shifted(state.of_bodies(common, self.mobility, nothing), arm), whole

    def reach(self, ends: Ends, arm_b: Vector, arm_a: Vector, normal: Vector) -> Number:
        """How large the numbers are of which a distance between points along a normal is the sum: the position of each
        root along the normal, and the lengths of all arms from there to the points. Its rounding errors grow with it.
        """
        state = self.state
        at_world = state.zero_vector, state.known(0.0)
        roots = [(body.r, b.is_on_world) for body, b in zip(self.bodies, state.bundles, strict=True)]
        reaches = recursion.outward(state, _reached, at_world, roots)
        total = state.known(0.0)
        for of_ends, own in ((ends.b, arm_b), (ends.a, arm_a)):
            root, arms = state.of_bodies(of_ends, reaches, at_world)
            total = total + abs(dot(root, normal)) + arms + _norm_1(own)
        return total


# -- steps of passes over the tree ------------------------------------------------------------------------------------


def _placed(frame, R_P: Matrix) -> tuple[tuple[Matrix, Vector], Matrix]:
    """((R, r) of a body, R)."""
    placement, joint, is_root = frame
    X_PB = across(placement, joint)
    R = R_P @ X_PB.R
    return (R, matrices.zero_at_root(is_root, R_P @ X_PB.p)), R


def _velocity(body, parent: tuple[Motion, ...]) -> tuple[tuple[Motion, ...], tuple[Motion, ...]]:
    S, r, fields = body
    found = []
    for V, x in zip(parent, fields, strict=True):
        V = algebra.shifted_motion(V, r)
        for s, rate in zip(S, x, strict=True):
            V = V + rate * s
        found.append(V)
    return tuple(found), tuple(found)


def _joint_forces(link, children: Wrench) -> tuple[Numbers, Wrench]:
    """(the forces at a joint, the wrench on its body and all that hang on it, about the parent's origin)."""
    S, r, (on_body, on_joint) = link
    F = on_body + children
    return tuple(algebra.power(F, s) + f for s, f in zip(S, on_joint, strict=True)), algebra.shifted_wrench(F, -r)


def _composite(body: tuple[Inertia, Vector], children: Inertia) -> tuple[Inertia, Inertia]:
    """The composite inertia of a body and its children: (about its origin, about that of its parent)."""
    M = combined(body[0], children)
    return M, Inertia(M.mass, M.com + body[1], M.central)


def _mobility(body, parent: Articulated) -> tuple[Articulated, Articulated]:
    S, r, diagonal = body
    whole = articulated.shifted(parent, r)
    for s, d in zip(S, diagonal, strict=True):
        U = Wrench(s.v, s.w)
        whole = articulated.rank_one_downdate(whole, U, -articulated.UDinv_of(U, d))
    return whole, whole


def _reached(body, parent: tuple[Vector, Number]) -> tuple[tuple[Vector, Number], tuple[Vector, Number]]:
    r, is_root = body
    root, arms = parent
    reach = (r, arms) if is_root else (root, arms + _norm_1(r))
    return reach, reach


def _norm_1(r: Vector) -> Number:
    """|x| + |y| + |z|: no root, and at least the length."""
    x, y, z = map(abs, r)
    return x + y + z


# -- mimics -----------------------------------------------------------------------------------------------------------


class Units(NamedTuple):
    """How bodies move at each unit of the generalized velocities, and A: what mechanisms with mimics have in place of
    recursions, as a generalized velocity moves bodies in several places.

    world: of nv times as many states: velocity after velocity, each in all states. v: (nv, nv B), these velocities.
    motions: of every bundle. A: (nv, nv, B). diagonal: of A, (nv, B). roots: of floating roots whose velocities are not
    along the axes of the world, the first row of these, and R (1, B).
    """

    world: World
    v: Number
    motions: list[Motion]
    A: Number
    diagonal: Number
    roots: list[tuple[int, Matrix]]

    def relative_mobility(self, n: int, ends: Ends, arm_b: Vector, arm_a: Vector) -> tuple[Articulated, Articulated]:
        """That of a World of n states, without the coupling of turning and moving: sums over all velocities."""
        state, m, nv = self.world.state, len(ends.b), self.world.state.topology.nv

        def by_velocity(bodies: Sequence[int], arm: Vector) -> Motion:
            V = algebra.shifted_motion(self.world.of_bodies(bodies, self.motions), tiled(arm, n, nv))
            each = jax.tree.map(lambda x: stacking.spread(x, (m, state.n)), V, is_leaf=is_number)
            each = stacking.mapped(lambda w: jnp.moveaxis(w.reshape((m, nv, n)), 1, 0), each)
            return jax.tree.map(self._along_world, each, is_leaf=is_number)

        def summed(V: Motion) -> Articulated:
            sums = jax.tree.map(stacking.pairwise_sum, (square(V.v), square(V.w)), is_leaf=is_number)
            return Articulated(sums[0], articulated.none(state.known(0.0)).F, sums[1])

        def square(v: Vector) -> Symmetric:
            """v v^T / D; 0 where D is not positive."""
            x, y, z = v
            return Symmetric(*(a * (scale * b) for a, b in ((x, x), (x, y), (y, y), (x, z), (y, z), (z, z))))

        D = stacking.mapped(lambda w: w[:, None], self._diagonal_along_world())
        is_none = high(D) <= 0
        scale = where(is_none, 0.0, 1 / where(is_none, 1.0, D))
        V_b, V_a = by_velocity(ends.b, arm_b), by_velocity(ends.a, arm_a)
        return summed(V_b - V_a), summed(V_b) + summed(V_a)

    def _along_world(self, x: Number) -> Number:
        """Numbers (nv, m, B) of each velocity as those of velocities of roots along the axes of the world."""
        for start, R in self.roots:
            wide = stacking.mapped(lambda w: w[:, None], R)
            for k in (start, start + 3):
                rows = (stacking.mapped(lambda w, i=i: w[i : i + 1], x) for i in range(k, k + 3))
                x = _with_rows(x, k, wide @ Vector(*rows))
        return x

    def _diagonal_along_world(self) -> Number:
        """The diagonal of A for these velocities."""
        x = self.diagonal
        for start, R in self.roots:
            for k in (start, start + 3):
                block = [
                    Vector(*(stacking.mapped(lambda w, i=i, j=j: w[i, j][None], self.A) for j in range(k, k + 3)))
                    for i in range(k, k + 3)
                ]
                x = _with_rows(x, k, Vector(*(dot(r, Vector(*(dot(own, r) for own in block))) for r in R)))
        return x


def _with_rows(x: Number, k: int, new: Vector) -> Number:
    """With rows k, k + 1 and k + 2 in their place."""
    before, behind = (stacking.mapped(lambda w, own=own: w[own], x) for own in (slice(k), slice(k + 3, None)))
    return stacking.concatenated([before, *new, behind])


# -- rows -------------------------------------------------------------------------------------------------------------


def scalars(state: MechanismState, array: Array) -> Number:
    """An array (n, B) as a number."""
    return state.numbers(array[:, None])[0]


def tiled(tree: T, n: int, k: int) -> T:
    """Numbers of n states as those of k times n: of all states, again and again."""
    return stacking.mapped(
        lambda w: jnp.tile(w, (*[1] * (w.ndim - 1), k)) if w.shape[-1] == n != 1 else w,
        tree,
    )


def with_zero_rows(x: jax.Array, places: np.ndarray) -> jax.Array:
    """x[places] (m, B), with rows of zeros for the place len(x)."""
    pieces: list = []
    for is_zero, run in itertools.groupby(places.tolist(), lambda k: k >= len(x)):
        rows = list(run)
        shape = len(rows), *x.shape[1:]
        pieces.append(lax.full(shape, 0, x.dtype) if is_zero else stacking.rows(x, np.array(rows)))
    return pieces[0] if len(pieces) == 1 else jnp.concatenate(pieces)


def _rows_of_bundle(state: MechanismState, b: Bundle, x: Number) -> Numbers:
    places = b.places(state.topology.v_starts, b.kind.nv)
    # It is pulled back as one stack; rows that are taken one by one, as many arrays of zeros but for one row.
    words = (jnp.unstack(stacking.rows(w, places), axis=2) for w in data_of(x))
    return (x,) * b.kind.nv if is_constant(x) else tuple(with_data(x, each) for each in zip(*words, strict=True))


def mean_size(S: Symmetric) -> Number:
    """The Frobenius norm over 3; of zero it is zero, and so are its derivatives."""
    xx, xy, yy, xz, yz, zz = S
    square = dot((xx, yy, zz, xy + xy, xz + xz, yz + yz), (xx, yy, zz, xy, xz, yz))
    is_none = high(square) == 0
    return where(is_none, 0.0, where(is_none, 1.0, square).sqrt() / 3)


def is_nan(x: Number) -> Mask:
    return high(x) != high(x)
