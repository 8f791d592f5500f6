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

from jaxspatial.contact.explicit import Ground, normals_and_distances
from jaxspatial.contact.term import NEAR_RIGID, STICKING, Columns, OnBodies, StepData, Term, TermData
from jaxspatial.contact.world import Ends, World, is_nan, mean_size, scalars, with_zero_rows
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.engine import stacking
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.inertia import articulated
from jaxspatial.inertia.articulated import Articulated
from jaxspatial.mechanism import Mechanism, PointContacts, ShapeContacts
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.mechanism.shapes import directions
from jaxspatial.numerics import check
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Motion, Symmetric, Vector, Wrench, cross, dot
from jaxspatial.numerics.numbers import Mask, Number, Numbers, constant, high, is_constant, is_number, where, where_any
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
class Centres:
    """Centres of n spheres on frames, by number, as arrays (*batch, 3 n). positions: in the frames; None for the
    origins. offsets: from the centres to the contact points C, in world axes."""

    frames: tuple[int, ...]
    positions: Array | None
    offsets: Array


@tree_of("reversed")
class ContactData(TermData):
    """The contacts of a step, as arrays (*batch, n) or (*batch, 3 n): n spheres on frames.

    reversed: of each whether its force is returned as that on the other, in place of that on the sphere. others: of the
    spheres that the last of them touch; all but these touch the ground. normals: out of the ground or of the other
    sphere, in world axes. distances: between the surfaces, negative inside.
    """

    reversed: tuple[bool, ...]
    centres: Centres
    others: Centres | None
    normals: Array
    distances: Array
    stiffness: Array
    relaxation_time: Array
    friction: Array

    @property
    def result_size(self) -> int:
        return 3 * len(self.centres.frames)

    def wrenches(self, forces: jax.Array) -> SpatialForce:
        """(*batch, n) on the bodies of the spheres, about the contact points."""
        f = forces.reshape((*forces.shape[:-1], -1, 3))
        if any(self.reversed):
            f = jnp.where(np.array(self.reversed)[:, None], -f, f)
        return SpatialForce(jnp.zeros_like(f), f)

    def term(self, world: World, step: StepData) -> "Contacts":
        """The Contacts of all states."""
        state, dt, centres, others = world.state, world.dt, self.centres, self.others
        on_ground = [-1] * len(centres.frames)
        arm, arm_a = world.arms(centres.frames, centres.positions, centres.offsets), state.zero_vector
        if others is not None:
            n, n_ground = len(centres.frames), len(centres.frames) - len(others.frames)
            on_ground[n_ground:] = state.topology.bodies_of(others.frames)
            own = world.arms(others.frames, others.positions, others.offsets)
            places = np.array([n] * n_ground + list(range(n - n_ground)))
            arm_a = stacking.mapped(lambda w: with_zero_rows(jnp.broadcast_to(w, (n - n_ground, state.n)), places), own)
        ends = Ends(tuple(state.topology.bodies_of(centres.frames)), tuple(on_ground))
        distance, stiffness, relaxation_time, friction = (
            scalars(state, x) for x in (self.distances, self.stiffness, self.relaxation_time, self.friction)
        )
        memory, normal = dt + relaxation_time, state.vectors(self.normals)
        # NaN, of any number, is not outside.
        is_inside = ~(high(distance) > 0)
        for x in (stiffness, memory, friction):
            is_inside = is_inside if is_constant(x) else is_inside | is_nan(x)
        free, zero = -distance / memory, constant(distance, 0)
        found = Contacts(ends, centres.frames, arm, arm_a, normal, is_inside, free, zero, zero, friction, zero)

        def softness(own: Contacts, compliant: Number, memory: Number) -> tuple[Number, Number, Mask, Number]:
            """(R_n, R_t, whether anything can move, the noise)."""
            at_C = own.ends, own.arm, own.arm_a
            w = mean_size(world.relative_mobility(*at_C)[0].J)
            rigid = NEAR_RIGID * w
            R_n = where(high(rigid) > high(compliant), rigid, compliant)
            is_movable = high(w) != 0
            # What cannot move has no law: one that is evaluated nevertheless divides by these.
            R_n, R_t = (where(is_movable, x, 1.0) for x in (R_n, STICKING * w))
            return R_n, R_t, is_movable, world.reach(*at_C, own.normal) / memory

        _ = world.units if state.topology.has_mimics else world.mobility  # Made here, of all groups.
        R_n, R_t, is_movable, noise = found.each(softness, 1 / (dt * stiffness * memory), memory)
        if not found._is_whole:
            # Where no contact is inside they are 0: a law of these would have no derivatives.
            R_n, R_t = (where(high(x) == 0, 1.0, x) for x in (R_n, R_t))
        return dataclasses.replace(found, is_touching=is_inside & is_movable, R_n=R_n, R_t=R_t, noise=noise)


def contact_data(
    mechanism: Mechanism,
    q: jax.Array,
    contacts: PointContacts | None,
    ground: Ground,
    pairs: tuple[PointContacts | ShapeContacts, PointContacts] | None,
    precision: PrecisionName,
) -> ContactData | None:
    """The ContactData of spheres on the ground, and behind them of spheres that touch others; None without any."""
    parts = list[ContactData]()
    if contacts is not None:
        p_WS = _centres(mechanism, q, contacts, precision)
        normal, s = normals_and_distances("convex_step", ground, p_WS, precision)
        law = (_per_contact(x, contacts) for x in (contacts.stiffness, contacts.relaxation_time, contacts.friction))
        centres = _on_frames(mechanism, contacts, -s[..., None] * normal)
        depths = s - jnp.broadcast_to(contacts.radius, s.shape)
        parts.append(ContactData((False,) * len(centres.frames), centres, None, _flat(normal), depths, *law))
    if pairs is not None:
        others, spheres = pairs
        normal, distance, from_a, from_b = between(mechanism, q, others, spheres, precision)
        stiffness, friction = (
            harmonic_mean(*(_per_contact(getattr(x, name), x) for x in pairs)) for name in ("stiffness", "friction")
        )
        # What stands still is the other: of spheres on the world, what touches them.
        is_still = tuple(mechanism.frame_body(x) == WORLD for x in spheres.frames)
        ends = _on_frames(mechanism, spheres, from_b), _on_frames(mechanism, others, from_a)
        if any(is_still):
            ends = _exchanged(*ends, is_still)
            normal = jnp.where(np.array(is_still)[:, None], -normal, normal)
        parts.append(
            ContactData(
                is_still,
                *ends,
                _flat(normal),
                distance,
                stiffness / 2,
                _per_contact(others.relaxation_time, others) + _per_contact(spheres.relaxation_time, others),
                friction,
            )
        )
    if len(parts) < 2:
        return parts[0] if parts else None
    positions = [x.centres.positions for x in parts]
    if any(x is not None for x in positions):
        sizes = (3 * len(x.centres.frames) for x in parts)
        positions = [np.zeros(n, q.dtype) if x is None else x for x, n in zip(positions, sizes, strict=True)]
    centres = Centres(
        parts[0].centres.frames + parts[1].centres.frames,
        None if positions[0] is None else _over_one_batch(positions),
        _over_one_batch([x.centres.offsets for x in parts]),
    )
    names = "normals", "distances", "stiffness", "relaxation_time", "friction"
    arrays = (_over_one_batch([getattr(x, name) for x in parts]) for name in names)
    return ContactData(parts[0].reversed + parts[1].reversed, centres, parts[1].others, *arrays)


def _exchanged(b: Centres, a: Centres, which: tuple[bool, ...]) -> tuple[Centres, Centres]:
    """Some of b in place of those of a, and those of a in place of them."""
    wide = np.repeat(which, 3)

    def chosen(own: Centres, other: Centres) -> Centres:
        frames = tuple(y if swaps else x for x, y, swaps in zip(own.frames, other.frames, which, strict=True))
        positions = [np.zeros_like(wide, x.offsets.dtype) if x.positions is None else x.positions for x in (own, other)]
        return Centres(frames, jnp.where(wide, *positions[::-1]), jnp.where(wide, other.offsets, own.offsets))

    return chosen(b, a), chosen(a, b)


def between(
    mechanism: Mechanism,
    q: jax.Array,
    others: PointContacts | ShapeContacts,
    spheres: PointContacts,
    precision: PrecisionName,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """(the normal from one to the other, the distance between surfaces, the offsets of C from both) of pairs.

    C is between the surfaces, each of which gives way by its share of the depth: the one that is twice as stiff, by
    half as much. Its offsets are from the centres of spheres, and from the origin of the frame of a shape.
    """
    p_WB = _centres(mechanism, q, spheres, precision)
    k_A, k_B = (check.expanded(_per_contact(x.stiffness, x)) for x in (others, spheres))
    if isinstance(others, ShapeContacts):
        X_WA = forward_kinematics(mechanism, q, others.frames, precision=precision)
        from_origin = p_WB - X_WA.translation
        n_A, s = others.shape.normals_and_distances(precision, X_WA.rotation.inverse() @ from_origin)
        normal, r_B = X_WA.rotation @ n_A, jnp.broadcast_to(spheres.radius, s.shape)
        distance = s - r_B
        from_b = _to_contact(precision, -normal, *map(check.expanded, (r_B, distance)), k_B, k_A)
        return normal, distance, from_origin + from_b, from_b
    normal, length = directions(precision, p_WB - _centres(mechanism, q, others, precision))
    r_A, r_B = (jnp.broadcast_to(x.radius, length.shape) for x in (others, spheres))
    distance = length - r_A - r_B
    of_a, of_b, d = map(check.expanded, (r_A, r_B, distance))
    from_a = _to_contact(precision, normal, of_a, d, k_A, k_B)
    return normal, distance, from_a, _to_contact(precision, -normal, of_b, d, k_B, k_A)


@formula
def _to_contact(n: Vector, radius: Numbers, distance: Numbers, k: Numbers, other: Numbers) -> Vector:
    """From the centre of a sphere along its normal n, by its radius, and by its share of the distance to another."""
    total = k[0] + other[0]
    return (radius[0] + (other[0] / where(high(total) == 0, 1.0, total)) * distance[0]) * n


def harmonic_mean(a, b) -> jax.Array:
    """2 a b / (a + b), and 0 where both are."""
    return 2 * a * (b / jnp.where(a + b == 0, 1, a + b))


def _over_one_batch(arrays) -> jax.Array:
    """Arrays (*batch, k), which may lack axes of the batch, side by side."""
    batch = check.broadcast_shapes(*(x.shape[:-1] for x in arrays))
    return jnp.concatenate([jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in arrays], -1)


def _on_frames(mechanism: Mechanism, contacts: PointContacts | ShapeContacts, offsets: jax.Array) -> Centres:
    positions = contacts.positions
    frames = tuple(map(mechanism.frame_names.index, contacts.frames))
    return Centres(frames, None if positions is None else _flat(positions), _flat(offsets))


def _flat(vectors):
    """(*batch, 3 n) of (*batch, n, 3)."""
    return vectors.reshape((*vectors.shape[:-2], -1))


def _centres(mechanism: Mechanism, q: jax.Array, contacts: PointContacts, precision: PrecisionName) -> jax.Array:
    """p_WS (*batch, n, 3)."""
    X_WF = forward_kinematics(mechanism, q, contacts.frames, precision=precision)
    return X_WF.translation if contacts.positions is None else X_WF @ contacts.positions


def _per_contact(x, contacts: PointContacts | ShapeContacts):
    """A number of a law (*batch, n), from one for each contact or one for all."""
    return (np if isinstance(x, np.ndarray) else jnp).broadcast_to(x, (*x.shape[:-1], len(contacts.frames)))


# -- the term ---------------------------------------------------------------------------------------------------------


class Law(NamedTuple):
    """G = normal n n^T + mixed (n t^T + t n^T) + across (1 - n n^T) + along t t^T of contacts."""

    t: Vector
    normal: Number
    mixed: Number
    across: Number
    along: Number


@tree_of("ends", "frames")
class Contacts(Term[Vector, Law]):
    """n contacts, as numbers (n, B). Their velocities and impulses are Vectors in world axes: of the points of bodies b
    at C, for observers on bodies a.

    frames: of the spheres on bodies b. arm, arm_a: from the origins of bodies b and a to C. free: the velocity along
    the normal at which there is no impulse. R_n, R_t: how much an impulse changes velocities along the normal and the
    tangents. noise: rounding errors of `free`, in eps: those of positions along the chain of bodies.
    """

    ends: Ends
    frames: tuple[int, ...]
    arm: Vector
    arm_a: Vector
    normal: Vector
    is_touching: Mask
    free: Number
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
    def _is_whole(self) -> bool:
        """Whether all are computed, touching or not: few, or of one frame."""
        return self.count <= MOST_TOGETHER or len(self._alike(*self.ends, self.frames)) == 1

    def _alike(self, *keys: Sequence[int]) -> list[np.ndarray]:
        """Which contacts have the same keys."""
        rows = dict[tuple[int, ...], list[int]]()
        for k, key in enumerate(zip(*keys, strict=True)):
            rows.setdefault(key, []).append(k)
        return [np.array(x) for x in rows.values()]

    def _rows(self, tree: T, rows: np.ndarray) -> T:
        """These rows of numbers, which have one row where all are the same."""
        return stacking.mapped(lambda w: w if w.shape[0] == 1 else stacking.rows(w, rows), tree)

    def _of_groups(self, groups: list[np.ndarray], function: Callable[..., T], *numbers) -> list[T]:
        """function(contacts, their numbers) of each group: zeros where none of it touches."""
        found = list[T]()
        for rows in groups:
            b, a, frames = (tuple(x[k] for k in rows) for x in (*self.ends, self.frames))
            own = dataclasses.replace(self._rows(self, rows), ends=Ends(b, a), frames=frames)
            found.append(where_any(own.is_touching, function, own, *self._rows(numbers, rows)))
        return found

    def each(self, function: Callable[..., T], *numbers) -> T:
        if self._is_whole:
            return function(self, *numbers)
        # A paw and its shank are one body, and have frames of their own.
        return self._by_group(self._alike(*self.ends, self.frames), function, *numbers)

    def _by_group(self, groups: list[np.ndarray], function: Callable[..., T], *numbers) -> T:
        """What groups have, in the order of the contacts."""
        found = self._of_groups(groups, function, *numbers)
        order, n = np.argsort(np.concatenate(groups)), self.is_touching.shape[1]

        def in_order(*parts):
            if not is_number(parts[0]):
                return stacking.rows(jnp.concatenate(parts), order)
            return stacking.mapped(lambda w: stacking.rows(w, order), stacking.concatenated_trees(parts, n, sizes))

        sizes = [len(rows) for rows in groups]
        return jax.tree.map(in_order, *found, is_leaf=is_number)

    def _summed(self, function: Callable[..., T], *numbers) -> tuple[Ends, T]:
        """What acts on bodies: one row for all contacts between the same two, their sum; all rows if there are few."""
        if self._is_whole:
            return self.ends, function(self, *numbers)
        groups = self._alike(*self.ends)
        most = max(map(len, groups))

        def of_all(x: Number, count: int) -> Number:
            """The sum of all rows, in the order in which those of most contacts are added."""
            places = np.minimum(np.arange(most), count)
            x = stacking.mapped(lambda w: with_zero_rows(jnp.broadcast_to(w, (count, w.shape[1])), places), x)
            return stacking.mapped(lambda w: w[None], stacking.pairwise_sum(x))

        def of_pair(own: Contacts, *numbers) -> T:
            parts = own._alike(own.frames)
            found = function(own, *numbers) if len(parts) == 1 else own._by_group(parts, function, *numbers)
            return jax.tree.map(lambda x: x if is_constant(x) else of_all(x, own.count), found, is_leaf=is_number)

        first = [rows[0] for rows in groups]
        ends = Ends(*(tuple(bodies[k] for k in first) for bodies in self.ends))
        found = self._of_groups(groups, of_pair, *numbers)
        return ends, stacking.concatenated_trees(found, self.is_touching.shape[1])

    # -- the law ------------------------------------------------------------------------------------------------------

    def law(self, u: Vector, held: Mask | None = None) -> tuple[Vector, Law]:
        """Projection on the cone of friction in the norm of R.

        y = (free n - u) / R sticks where |y_t| <= mu y_n, with impulse y. Else it slides, or there is no impulse.
        [Castro, Permenter, Han 2022, 3.2]

        held: contacts that stick wherever y is.
        """
        n, mu, R_n, R_t = self.normal, self.friction, self.R_n, self.R_t
        along_normal = dot(n, u)
        y_n, y_t = (self.free - along_normal) / R_n, (along_normal * n - u) / R_t
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
        return normal_impulse * n + size * t, Law(
            t,
            normal=chosen(1 / R_n, share / R_n),
            mixed=chosen(zero, mu * share / R_n),
            across=chosen(1 / R_t, turning),
            along=chosen(zero, mu * steep * share / R_t - turning),
        )

    def times_G(self, G: Law, u: Vector) -> Vector:
        n, t = self.normal, G.t
        u_n, u_t = dot(n, u), dot(t, u)
        return ((G.normal - G.across) * u_n + G.mixed * u_t) * n + (G.mixed * u_n + G.along * u_t) * t + G.across * u

    def product(self, impulse: Vector, u: Vector) -> Number:
        return dot(impulse, u)

    def bound(self, G: Law, x: Vector) -> Number:
        along = dot(self.normal, x)
        across = x - along * self.normal
        # Where contacts slide, an impulse has no part along one direction: G is zero there.
        sticks = (high(G.mixed) == 0) & (high(G.across) > 0)
        square = along * along * self.R_n + dot(across, across) * self.R_t
        return where(sticks | (high(dot(x, x)) == 0), square, np.inf)

    def magnitude(self, u: Vector) -> Vector:
        free = abs(self.free)
        return Vector(*(abs(x) + free * abs(n) for x, n in zip(u, self.normal, strict=True)))

    def acts(self) -> jax.Array:
        return self.is_touching

    def held(self, *velocities: Vector) -> Mask:
        """Those that push at any of the velocities."""
        return functools.reduce(operator.or_, (high(self.law(u)[1].normal) > 0 for u in velocities))

    def rounding(self, G: Law, u: Vector) -> Number:
        """Errors of `free`."""
        return self.noise * self.noise * G.normal

    # -- the mechanism ------------------------------------------------------------------------------------------------

    def velocities(self, world: World, motions: list[Motion], v: Number) -> Vector:
        V_b, V_a = (world.of_bodies(bodies, motions) for bodies in self.ends)
        return V_b.v + cross(V_b.w, self.arm) - (V_a.v + cross(V_a.w, self.arm_a))

    def on_bodies(self, impulse: Vector) -> list[OnBodies]:
        ends, (on_b, on_a) = self._summed(Contacts._on_both, impulse)
        between = ends.between_bodies
        if not len(between):
            return [OnBodies(ends.b, on_b)]
        on_a = self._rows(on_a, between)
        return [OnBodies(ends.b, on_b), OnBodies(tuple(ends.a[i] for i in between), on_a)]

    def _on_both(self, impulse: Vector) -> tuple[Wrench, Wrench]:
        """The wrenches of an impulse on bodies b and a, about their origins."""
        return Wrench(cross(self.arm, impulse), impulse), Wrench(-cross(self.arm_a, impulse), -impulse)

    def inertia(self, G: Law) -> list[OnBodies]:
        """The inertia G at C of contacts with the ground."""

        def about_origin(own: Contacts, G: Law) -> Articulated:
            matrix = own._matrix(G)
            at_C = articulated.none(constant(matrix[0], 0))._replace(M=matrix)
            return articulated.shifted(at_C, -own.arm)

        ends, found = self._summed(about_origin, G)
        return [OnBodies(tuple(b if a < 0 else -1 for b, a in zip(*ends, strict=True)), found)]

    def columns(self, world: World, G: Law) -> list[Columns]:
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
            is_none = ~(high(pivot) > high(8 * check.eps(high(size).dtype) * size))
            root = where(is_none, 1.0, pivot).sqrt()
            return [where(is_none, zero, x / root) for x in (pivot, *below)]

        a, b, c = column(xx, xy, xz)
        d, e = column(yy - b * b, yz - b * c)
        (f,) = column(zz - c * c - e * e)
        end_b, end_a = (tuple(bodies[i] for i in between) for bodies in self.ends)
        vectors = Vector(a, b, c), Vector(zero, d, e), Vector(zero, zero, f)
        return [Columns(end_b, end_a, *own._on_both(x)) for x in vectors]

    def _matrix(self, G: Law) -> Symmetric:
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
