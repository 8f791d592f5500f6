"""Spheres in contact, with the ground or with other spheres, as a term of the convex step.

[Castro, Permenter, Han 2022, An unconstrained convex formulation of compliant contact; Drake 1.51, SapDriver]
"""

import dataclasses
import functools
import operator
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.contact.geometry import (
    Ground,
    Pairs,
    normals_and_distances,
    pair_normals_and_distances,
    per_contact,
    sphere_centers,
)
from jaxspatial.contact.term import NEAR_RIGID, STICKING, Columns, OnBodies, StepData, Term, TermData
from jaxspatial.contact.world import Ends, World, is_nan, mean_size, scalars, with_zero_rows
from jaxspatial.engine import stacking
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.inertia import articulated
from jaxspatial.inertia.articulated import Articulated
from jaxspatial.mechanism import Mechanism, PointContacts, ShapeContacts
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.numerics import floats
from jaxspatial.numerics.linear import Motion, Symmetric, Vector, Wrench, cross, dot
from jaxspatial.numerics.numbers import Mask, Number, constant, high, is_constant, is_number, where, where_any
from jaxspatial.numerics.quantity import tree_of
from jaxspatial.numerics.types import PrecisionName
from jaxspatial.spatial import SpatialForce

T = TypeVar("T")
# Of more contacts than this, those of the same frame and body are left out where none of them touches.
MOST_TOGETHER = 8
# The impulse by which friction is smoothed, as Drake's.
SMOOTHED = 1e-14


# -- arrays -----------------------------------------------------------------------------------------------------------


@tree_of("frames")
class PointsOnFrames:
    """Contact points C on n frames, by number, as arrays (*batch, 3 n).

    positions: of the centres of spheres in their frames; None for the origins. offsets: from there to C, in world axes.
    """

    frames: tuple[int, ...]
    positions: Array | None
    offsets: Array


@tree_of("returns_a")
class ContactData(TermData):
    """The n contacts of a step, as arrays (*batch, n) or (*batch, 3 n), those with the ground first.

    returns_a: of each whether the force on its body a is returned, in place of that on b. points_b: of all contacts.
    points_a: of those between two frames, which come last; None without. normals: out of the ground or from a to b, in
    world axes. distances: between the surfaces, negative inside.
    """

    returns_a: tuple[bool, ...]
    points_b: PointsOnFrames
    points_a: PointsOnFrames | None
    normals: Array
    distances: Array
    stiffness: Array
    relaxation_time: Array
    friction: Array

    @property
    def result_size(self) -> int:
        return 3 * len(self.points_b.frames)

    def wrenches(self, forces: jax.Array) -> SpatialForce:
        """(*batch, n) on the bodies of the spheres that callers passed, about the contact points."""
        f = forces.reshape((*forces.shape[:-1], -1, 3))
        if any(self.returns_a):
            f = jnp.where(np.array(self.returns_a)[:, None], -f, f)
        return SpatialForce(jnp.zeros_like(f), f)

    def to_term(self, world: World, step: StepData) -> "Contacts":
        state, dt, b, a = world.state, world.dt, self.points_b, self.points_a
        bodies_a = [-1] * len(b.frames)
        arm_b, arm_a = world.arms(b.frames, b.positions, b.offsets), state.zero_vector
        if a is not None:
            n, n_ground = len(b.frames), len(b.frames) - len(a.frames)
            bodies_a[n_ground:] = state.topology.bodies_of(a.frames)
            own = world.arms(a.frames, a.positions, a.offsets)
            places = np.array([n] * n_ground + list(range(n - n_ground)))
            arm_a = stacking.mapped(lambda w: with_zero_rows(jnp.broadcast_to(w, (n - n_ground, state.n)), places), own)
        ends = Ends(tuple(state.topology.bodies_of(b.frames)), tuple(bodies_a))
        distance, stiffness, relaxation_time, friction = (
            scalars(state, x) for x in (self.distances, self.stiffness, self.relaxation_time, self.friction)
        )
        memory, normal = dt + relaxation_time, state.vectors(self.normals)
        # NaN, of any number, is not outside.
        is_inside = ~(high(distance) > 0)
        for x in (stiffness, memory, friction):
            is_inside = is_inside if is_constant(x) else is_inside | is_nan(x)
        target, zero = -distance / memory, constant(distance, 0)
        # What is zero here is computed below, in groups of these.
        found = Contacts(ends, b.frames, arm_b, arm_a, normal, is_inside, target, zero, zero, friction, zero)

        def softness(own: Contacts, compliant: Number, memory: Number) -> tuple[Number, Number, Mask, Number]:
            """(R_n, R_t, whether anything can move, the noise)."""
            at_C = own.ends, own.arm_b, own.arm_a
            w = mean_size(world.relative_mobility(*at_C)[0].J)
            rigid = NEAR_RIGID * w
            R_n = where(high(rigid) > high(compliant), rigid, compliant)
            is_movable = high(w) != 0
            # What cannot move has no law: one that is evaluated nevertheless divides by these.
            R_n, R_t = (where(is_movable, x, 1.0) for x in (R_n, STICKING * w))
            return R_n, R_t, is_movable, world.reach(*at_C, own.normal) / memory

        _ = world.units if state.topology.has_mimics else world.mobility  # Made here, of all groups.
        R_n, R_t, is_movable, noise = found.each(softness, 1 / (dt * stiffness * memory), memory)
        if not found.computes_all:
            # Where no contact is inside they are 0: a law of these would have no derivatives.
            R_n, R_t = (where(high(x) == 0, 1.0, x) for x in (R_n, R_t))
        return dataclasses.replace(found, is_touching=is_inside & is_movable, R_n=R_n, R_t=R_t, noise=noise)


def contact_data(
    mechanism: Mechanism,
    q: jax.Array,
    contacts: PointContacts | None,
    ground: Ground,
    pairs: Pairs | None,
    precision: PrecisionName,
) -> ContactData | None:
    """The ContactData of spheres on the ground, and behind them of pairs; None without any."""
    parts = list[ContactData]()
    if contacts is not None:
        p_WS = sphere_centers(mechanism, q, contacts, precision)
        normal, s = normals_and_distances("convex_step", ground, p_WS, precision)
        law = (per_contact(x, contacts) for x in (contacts.stiffness, contacts.relaxation_time, contacts.friction))
        points = _on_frames(mechanism, contacts, -s[..., None] * normal)
        distance = s - jnp.broadcast_to(contacts.radius, s.shape)
        parts.append(ContactData((False,) * len(points.frames), points, None, _flat(normal), distance, *law))
    if pairs is not None:
        a, b = pairs
        normal, distance, from_a, from_b = pair_normals_and_distances(mechanism, q, pairs, precision)
        stiffness, friction = (
            harmonic_mean(*(per_contact(getattr(x, name), x) for x in pairs)) for name in ("stiffness", "friction")
        )
        points_b, points_a = _on_frames(mechanism, b, from_b), _on_frames(mechanism, a, from_a)
        # Only frames a of a term may be of the world.
        is_on_world = tuple(mechanism.frame_body(x) == WORLD for x in b.frames)
        if any(is_on_world):
            points_b, points_a = _exchanged(points_b, points_a, is_on_world)
            normal = jnp.where(np.array(is_on_world)[:, None], -normal, normal)
        parts.append(
            ContactData(
                is_on_world,
                points_b,
                points_a,
                _flat(normal),
                distance,
                stiffness / 2,
                per_contact(a.relaxation_time, a) + per_contact(b.relaxation_time, b),
                friction,
            )
        )
    if len(parts) < 2:
        return parts[0] if parts else None
    positions = [x.points_b.positions for x in parts]
    if any(x is not None for x in positions):
        sizes = (3 * len(x.points_b.frames) for x in parts)
        positions = [np.zeros(n, q.dtype) if x is None else x for x, n in zip(positions, sizes, strict=True)]
    points = PointsOnFrames(
        parts[0].points_b.frames + parts[1].points_b.frames,
        None if positions[0] is None else _over_one_batch(positions),
        _over_one_batch([x.points_b.offsets for x in parts]),
    )
    names = "normals", "distances", "stiffness", "relaxation_time", "friction"
    arrays = (_over_one_batch([getattr(x, name) for x in parts]) for name in names)
    return ContactData(parts[0].returns_a + parts[1].returns_a, points, parts[1].points_a, *arrays)


def _exchanged(b: PointsOnFrames, a: PointsOnFrames, which: tuple[bool, ...]) -> tuple[PointsOnFrames, PointsOnFrames]:
    """Some of b in place of those of a, and those of a in place of them."""
    wide = np.repeat(which, 3)

    def chosen(own: PointsOnFrames, other: PointsOnFrames) -> PointsOnFrames:
        frames = tuple(y if swaps else x for x, y, swaps in zip(own.frames, other.frames, which, strict=True))
        positions = [np.zeros_like(wide, x.offsets.dtype) if x.positions is None else x.positions for x in (own, other)]
        return PointsOnFrames(frames, jnp.where(wide, *positions[::-1]), jnp.where(wide, other.offsets, own.offsets))

    return chosen(b, a), chosen(a, b)


def harmonic_mean(a, b) -> jax.Array:
    """2 a b / (a + b), and 0 where both are."""
    return 2 * a * (b / jnp.where(a + b == 0, 1, a + b))


def _over_one_batch(arrays) -> jax.Array:
    """Arrays (*batch, k), which may lack axes of the batch, side by side."""
    batch = floats.broadcast_shapes(*(x.shape[:-1] for x in arrays))
    return jnp.concatenate([jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in arrays], -1)


def _on_frames(mechanism: Mechanism, contacts: PointContacts | ShapeContacts, offsets: jax.Array) -> PointsOnFrames:
    positions = contacts.positions
    frames = tuple(map(mechanism.frame_names.index, contacts.frames))
    return PointsOnFrames(frames, None if positions is None else _flat(positions), _flat(offsets))


def _flat(vectors):
    """(*batch, 3 n) of (*batch, n, 3)."""
    return vectors.reshape((*vectors.shape[:-2], -1))


# -- the term ---------------------------------------------------------------------------------------------------------


class LawDerivative(NamedTuple):
    """G of contacts, minus the derivative of the law, as a matrix of the normal n and the direction t of friction:

    G = normal n n^T + mixed (n t^T + t n^T) + across (1 - n n^T) + along t t^T
    """

    t: Vector
    normal: Number
    mixed: Number
    across: Number
    along: Number


def _groups(*keys: Sequence[int]) -> list[np.ndarray]:
    """The rows of each group of contacts that have the same keys."""
    rows = dict[tuple[int, ...], list[int]]()
    for k, key in enumerate(zip(*keys, strict=True)):
        rows.setdefault(key, []).append(k)
    return [np.array(x) for x in rows.values()]


@tree_of("ends", "frames")
class Contacts(Term[Vector, LawDerivative]):
    """n contacts, as numbers (n, B). Their velocities and impulses are Vectors in world axes: of the points of bodies b
    at C, for observers on bodies a.

    frames: those on bodies b. arm_b, arm_a: from the origins of bodies b and a to C. target: the velocity along the
    normal to which impulses push, and at which there are none. R_n, R_t: how much an impulse changes velocities along
    the normal and the tangents. noise: rounding errors of `target`, in eps: those of positions along the chain of
    bodies.
    """

    ends: Ends
    frames: tuple[int, ...]
    arm_b: Vector
    arm_a: Vector
    normal: Vector
    is_touching: Mask
    target: Number
    R_n: Number
    R_t: Number
    friction: Number
    noise: Number

    rounding_share = 0.125

    @property
    def count(self) -> int:
        return len(self.ends.b)

    # -- contacts that are left out -----------------------------------------------------------------------------------

    @property
    def computes_all(self) -> bool:
        """Whether all are computed, touching or not: few, or of one frame."""
        return self.count <= MOST_TOGETHER or len(_groups(*self.ends, self.frames)) == 1

    def _rows(self, tree: T, rows: np.ndarray) -> T:
        """These rows of numbers, which have one row where all are the same."""
        return stacking.mapped(lambda w: w if w.shape[0] == 1 else stacking.rows(w, rows), tree)

    def _of_each_group(self, groups: list[np.ndarray], function: Callable[..., T], *numbers) -> list[T]:
        """function(contacts, their numbers) of each group: zeros where none of it touches."""
        found = list[T]()
        for rows in groups:
            b, a, frames = (tuple(x[k] for k in rows) for x in (*self.ends, self.frames))
            own = dataclasses.replace(self._rows(self, rows), ends=Ends(b, a), frames=frames)
            found.append(where_any(own.is_touching, function, own, *self._rows(numbers, rows)))
        return found

    def each(self, function: Callable[..., T], *numbers) -> T:
        if self.computes_all:
            return function(self, *numbers)
        # A paw and its shank are one body, and have frames of their own.
        return self._in_order(_groups(*self.ends, self.frames), function, *numbers)

    def _in_order(self, groups: list[np.ndarray], function: Callable[..., T], *numbers) -> T:
        """The results of `_of_each_group`, in the order of the contacts."""
        found = self._of_each_group(groups, function, *numbers)
        order, n = np.argsort(np.concatenate(groups)), self.is_touching.shape[1]

        def in_order(*parts):
            if not is_number(parts[0]):
                return stacking.rows(jnp.concatenate(parts), order)
            return stacking.mapped(lambda w: stacking.rows(w, order), stacking.concatenated_trees(parts, n, sizes))

        sizes = [len(rows) for rows in groups]
        return jax.tree.map(in_order, *found, is_leaf=is_number)

    def _by_bodies(self, function: Callable[..., T], *numbers) -> tuple[Ends, T]:
        """What acts on bodies: one row for all contacts between the same two, their sum; all rows if there are few."""
        if self.computes_all:
            return self.ends, function(self, *numbers)
        groups = _groups(*self.ends)
        most = max(map(len, groups))

        def sum_of_rows(x: Number, count: int) -> Number:
            """The sum of all rows, in the order in which those of most contacts are added."""
            places = np.minimum(np.arange(most), count)
            x = stacking.mapped(lambda w: with_zero_rows(jnp.broadcast_to(w, (count, w.shape[1])), places), x)
            return stacking.mapped(lambda w: w[None], stacking.pairwise_sum(x))

        def sum_of_group(own: Contacts, *numbers) -> T:
            parts = _groups(own.frames)
            found = function(own, *numbers) if len(parts) == 1 else own._in_order(parts, function, *numbers)
            return jax.tree.map(lambda x: x if is_constant(x) else sum_of_rows(x, own.count), found, is_leaf=is_number)

        first = [rows[0] for rows in groups]
        ends = Ends(*(tuple(bodies[k] for k in first) for bodies in self.ends))
        found = self._of_each_group(groups, sum_of_group, *numbers)
        return ends, stacking.concatenated_trees(found, self.is_touching.shape[1])

    # -- the law ------------------------------------------------------------------------------------------------------

    def law(self, u: Vector, held: Mask | None = None) -> tuple[Vector, LawDerivative]:
        """Projection on the cone of friction in the norm of R.

        y = (target n - u) / R sticks where |y_t| <= mu y_n, with impulse y. Else it slides, or there is no impulse.
        [Castro, Permenter, Han 2022, 3.2]

        held: contacts that stick wherever y is.
        """
        n, mu, R_n, R_t = self.normal, self.friction, self.R_n, self.R_t
        u_n = dot(n, u)
        y_n, y_t = (self.target - u_n) / R_n, (u_n * n - u) / R_t
        length = (dot(y_t, y_t) + SMOOTHED).sqrt()
        t = y_t / length
        steep = mu * R_t / R_n
        share = 1 / (1 + mu * steep)
        sliding = (y_n + steep * length) * share
        sticks = self.is_touching & (high(length) <= high(mu * y_n))
        sticks = sticks if held is None else sticks | held
        # NaN slides, and becomes the impulse.
        slides = self.is_touching & ~sticks & ~(high(y_n + steep * length) <= 0)
        zero = constant(y_n, 0)

        def chosen(stick: Number, slide: Number) -> Number:
            return where(sticks, stick, where(slides, slide, zero))

        normal_impulse, size = chosen(y_n, sliding), chosen(length, mu * sliding)
        turning = mu * sliding / (length * R_t)
        return normal_impulse * n + size * t, LawDerivative(
            t,
            normal=chosen(1 / R_n, share / R_n),
            mixed=chosen(zero, mu * share / R_n),
            across=chosen(1 / R_t, turning),
            along=chosen(zero, mu * steep * share / R_t - turning),
        )

    def times_G(self, G: LawDerivative, u: Vector) -> Vector:
        n, t = self.normal, G.t
        u_n, u_t = dot(n, u), dot(t, u)
        return ((G.normal - G.across) * u_n + G.mixed * u_t) * n + (G.mixed * u_n + G.along * u_t) * t + G.across * u

    def product(self, impulse: Vector, u: Vector) -> Number:
        return dot(impulse, u)

    def bound(self, G: LawDerivative, x: Vector) -> Number:
        x_n = dot(self.normal, x)
        x_t = x - x_n * self.normal
        # Where contacts slide, an impulse has no part along one direction: G is zero there.
        sticks = (high(G.mixed) == 0) & (high(G.across) > 0)
        square = x_n * x_n * self.R_n + dot(x_t, x_t) * self.R_t
        return where(sticks | (high(dot(x, x)) == 0), square, np.inf)

    def magnitude(self, u: Vector) -> Vector:
        target = abs(self.target)
        return Vector(*(abs(x) + target * abs(n) for x, n in zip(u, self.normal, strict=True)))

    def acts(self) -> jax.Array:
        return self.is_touching

    def held(self, *velocities: Vector) -> Mask:
        """Those that push at any of the velocities."""
        return functools.reduce(operator.or_, (high(self.law(u)[1].normal) > 0 for u in velocities))

    def rounding(self, G: LawDerivative, u: Vector) -> Number:
        """Errors of `target`."""
        return self.noise * self.noise * G.normal

    # -- the mechanism ------------------------------------------------------------------------------------------------

    def velocities(self, world: World, motions: list[Motion], v: Number) -> Vector:
        V_b, V_a = (world.of_bodies(bodies, motions) for bodies in self.ends)
        return V_b.v + cross(V_b.w, self.arm_b) - (V_a.v + cross(V_a.w, self.arm_a))

    def on_bodies(self, impulse: Vector) -> list[OnBodies]:
        ends, (on_b, on_a) = self._by_bodies(Contacts._on_both, impulse)
        between = ends.between_bodies
        if not len(between):
            return [OnBodies(ends.b, on_b)]
        on_a = self._rows(on_a, between)
        return [OnBodies(ends.b, on_b), OnBodies(tuple(ends.a[i] for i in between), on_a)]

    def _on_both(self, impulse: Vector) -> tuple[Wrench, Wrench]:
        """The wrenches of an impulse on bodies b and a, about their origins."""
        return Wrench(cross(self.arm_b, impulse), impulse), Wrench(-cross(self.arm_a, impulse), -impulse)

    def inertia(self, G: LawDerivative) -> list[OnBodies]:
        """The inertia G at C of contacts with the ground."""

        def about_origin(own: Contacts, G: LawDerivative) -> Articulated:
            matrix = own._matrix(G)
            at_C = articulated.none(constant(matrix[0], 0))._replace(M=matrix)
            return articulated.shifted(at_C, -own.arm_b)

        ends, found = self._by_bodies(about_origin, G)
        return [OnBodies(tuple(b if a < 0 else -1 for b, a in zip(*ends, strict=True)), found)]

    def columns(self, world: World, G: LawDerivative) -> list[Columns]:
        """Three for each contact between two bodies, by Cholesky's method; a pivot that is zero leaves a column of
        zeros."""
        between = self.ends.between_bodies
        if not len(between):
            return []
        # Of size 1 where all contacts have the same number.
        own, G = self._rows((self, G), between)
        xx, xy, yy, xz, yz, zz = own._matrix(G)
        zero, size = constant(xx, 0), xx + yy + zz

        def column(pivot: Number, *below: Number) -> list[Number]:
            # Rounding may leave one that is zero at either side of it.
            is_none = ~(high(pivot) > high(8 * floats.eps(high(size).dtype) * size))
            root = where(is_none, 1.0, pivot).sqrt()
            return [where(is_none, zero, x / root) for x in (pivot, *below)]

        a, b, c = column(xx, xy, xz)
        d, e = column(yy - b * b, yz - b * c)
        (f,) = column(zz - c * c - e * e)
        end_b, end_a = (tuple(bodies[i] for i in between) for bodies in self.ends)
        vectors = Vector(a, b, c), Vector(zero, d, e), Vector(zero, zero, f)
        return [Columns(end_b, end_a, *own._on_both(x)) for x in vectors]

    def _matrix(self, G: LawDerivative) -> Symmetric:
        """G as a matrix."""
        n, t = self.normal, G.t
        a, k = G.normal - G.across, G.across

        def entry(i: int, j: int) -> Number:
            x = a * (n[i] * n[j]) + G.mixed * (n[i] * t[j] + t[i] * n[j]) + G.along * (t[i] * t[j])
            return x + k if i == j else x

        return Symmetric(entry(0, 0), entry(0, 1), entry(1, 1), entry(0, 2), entry(1, 2), entry(2, 2))

    # -- results ------------------------------------------------------------------------------------------------------

    def results(self, state: MechanismState, impulse: Vector) -> list[jax.Array]:
        """Vectors (3 n, B)."""
        return [jnp.stack([state.rounded(x) for x in impulse], 1).reshape((-1, state.n))]
