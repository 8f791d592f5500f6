"""Where spheres on a mechanism touch the ground or other surfaces, how deep, and how they move there.

Both laws of contact begin with it: the explicit one, and the convex step. Numbers of n contacts are arrays
(*batch, n), and vectors (*batch, n, 3) in world axes.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.kinematics import forward_kinematics, velocity_step
from jaxspatial.engine import recursion
from jaxspatial.engine.algorithm import FRAMES, GEOMETRY, algorithm, checked, refuse_double_words
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.mechanism import HalfSpace, Mechanism, PointContacts, ShapeContacts
from jaxspatial.mechanism.shapes import Shape, directions, of_function
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Motion, Pose, Vector, cross
from jaxspatial.numerics.numbers import Numbers, high, where
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial.algebra import composed

# The ground: from the position (3,) of a point in world axes to a number that is zero on its surface.
Ground = Callable[[jax.Array], Any]
# (a, b): sphere i of b touches sphere i of a, or the shape on frame i of a.
Pairs = tuple[PointContacts | ShapeContacts, PointContacts]


# -- arguments --------------------------------------------------------------------------------------------------------


def checked_spheres(
    operation: str,
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    contacts: PointContacts,
    ground: Ground | None,
) -> tuple[jax.Array, jax.Array, PointContacts, Ground, tuple[int, ...]]:
    """q, v, contacts and ground as arrays, and their common batch shape but for that of a ground."""
    contacts = checked_contacts(operation, contacts)
    at_q, at_v = checked(operation, mechanism, q=q, v=v)
    check.require_same_dtype(q=at_q, contacts=contacts)
    ground = checked_ground(operation, ground, at_q)
    batch = floats.common_batch_shape(q=at_q.shape[:-1], v=at_v.shape[:-1], contacts=contacts.batch_shape)
    return at_q, at_v, contacts, ground, batch


def checked_contacts(operation: str, contacts, name: str = "contacts") -> PointContacts:
    """The contacts, as JAX computes with them."""
    if not isinstance(contacts, PointContacts):
        check.refuse(f"{operation}: {name}", "PointContacts", contacts)
    refuse_double_words(operation, **{name: contacts})
    return floats.narrowed(contacts)


def checked_pairs(operation: str, mechanism: Mechanism, q: Array, pairs) -> Pairs | None:
    """The pairs, as JAX computes with them; None where there are none."""
    what = f"{operation}: pairs"
    if not isinstance(pairs, tuple) or len(pairs) != 2:
        check.refuse(what, "(a, b), two PointContacts, or ShapeContacts and PointContacts", pairs)
    if isinstance(pairs[0], ShapeContacts):
        refuse_double_words(operation, pairs=pairs[0])
        a = floats.narrowed(pairs[0])
    else:
        a = checked_contacts(operation, pairs[0], "pairs")
    b = checked_contacts(operation, pairs[1], "pairs")
    for x in (a, b):
        check.require_same_dtype(q=q, pairs=x)
    if len(a.frames) != len(b.frames):
        raise ValueError(f"{what}: expected as many of one as of the other, got {len(a.frames)} and {len(b.frames)}")
    bodies_a, bodies_b = (carriers(f"{what}: frames", mechanism, x) for x in (a, b))
    for frame_a, frame_b, body_a, body_b in zip(a.frames, b.frames, bodies_a, bodies_b, strict=True):
        if body_a == body_b:
            of = "of the world" if body_a < 0 else "of one"
            raise ValueError(f"{what}: expected frames of two bodies, got {frame_a!r} and {frame_b!r}, {of}")
    return (a, b) if a.frames else None


def carriers(what: str, mechanism: Mechanism, contacts: PointContacts | ShapeContacts) -> list[int]:
    """The number of the body that carries each frame, -1 for the world."""
    t = mechanism.topology
    return [t.frames[t.index(mechanism.frame_names, frame, what)][1] for frame in contacts.frames]


def checked_ground(operation: str, ground, q: Array) -> Ground:
    """The ground, as JAX computes with it; z = 0 for None."""
    if ground is None:
        return HalfSpace(np.array([0, 0, 1], q.dtype), np.zeros((), q.dtype))
    if isinstance(ground, Shape):
        refuse_double_words(operation, ground=ground)
        ground = floats.narrowed(ground)
        check.require_same_dtype(q=q, ground=ground)
    elif not callable(ground):
        expected = "a HalfSpace, or a function from a point (3,) to a number, above zero outside"
        check.refuse(f"{operation}: ground", expected, ground)
    return ground


def calls_functions(ground: Ground) -> bool:
    """Whether a caller's function is a part of the ground."""
    return not isinstance(ground, Shape) or ground.calls_functions


def per_contact(x: Array, contacts: PointContacts | ShapeContacts) -> Array:
    """A number of a law (*batch, n), from one for each contact or one for all."""
    return (np if isinstance(x, np.ndarray) else jnp).broadcast_to(x, (*x.shape[:-1], len(contacts.frames)))


# -- where surfaces touch ---------------------------------------------------------------------------------------------


def sphere_centers(mechanism: Mechanism, q: jax.Array, contacts: PointContacts, precision: PrecisionName) -> jax.Array:
    """p_WS (*batch, n, 3)."""
    X_WF = forward_kinematics(mechanism, q, contacts.frames, precision=precision)
    return X_WF.translation if contacts.positions is None else X_WF @ contacts.positions


def normals_and_distances(
    operation: str, ground: Ground, p: jax.Array, precision: PrecisionName
) -> tuple[jax.Array, jax.Array]:
    """The normals (*batch, n, 3) of the ground and the signed distances (*batch, n) of points (*batch, n, 3).

    ground: as `checked_ground` returns it. A shape may be a batch, of which each has n points.
    """
    if isinstance(ground, Shape):
        floats.common_batch_shape(q=p.shape[:-2], ground=ground.batch_shape)
        return ground.of_many_points().normals_and_distances(precision, p)
    return of_function(f"{operation}: ground", ground, p, precision)


def pair_normals_and_distances(
    mechanism: Mechanism, q: jax.Array, pairs: Pairs, precision: PrecisionName
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """(the normals from a to b, the distances between surfaces, the offsets of C from a and from b) of pairs (a, b).

    C is between the surfaces, each of which gives way by its share of the depth: the one that is twice as stiff, by
    half as much. Its offsets are from the centres of spheres, and from the origin of the frame of a shape.
    """
    a, b = pairs
    p_WB = sphere_centers(mechanism, q, b, precision)
    k_A, k_B = (floats.expanded(per_contact(x.stiffness, x)) for x in pairs)
    if isinstance(a, ShapeContacts):
        X_WA = forward_kinematics(mechanism, q, a.frames, precision=precision)
        from_origin = p_WB - X_WA.translation
        n_A, s = a.shape.normals_and_distances(precision, X_WA.rotation.inverse() @ from_origin)
        normal, r_B = X_WA.rotation @ n_A, jnp.broadcast_to(b.radius, s.shape)
        distance = s - r_B
        from_b = _to_contact(precision, -normal, *map(floats.expanded, (r_B, distance)), k_B, k_A)
        return normal, distance, from_origin + from_b, from_b
    normal, length = directions(precision, p_WB - sphere_centers(mechanism, q, a, precision))
    r_A, r_B = (jnp.broadcast_to(x.radius, length.shape) for x in (a, b))
    distance = length - r_A - r_B
    of_a, of_b, d = map(floats.expanded, (r_A, r_B, distance))
    from_a = _to_contact(precision, normal, of_a, d, k_A, k_B)
    return normal, distance, from_a, _to_contact(precision, -normal, of_b, d, k_B, k_A)


@formula
def _to_contact(n: Vector, radius: Numbers, distance: Numbers, k: Numbers, other: Numbers) -> Vector:
    """From the centre of a sphere along its normal n, by its radius, and by its share of the distance to another."""
    total = k[0] + other[0]
    return (radius[0] + (other[0] / where(high(total) == 0, 1.0, total)) * distance[0]) * n


# -- how they move there ----------------------------------------------------------------------------------------------


class ContactGeometry(NamedTuple):
    """Where n contacts are, and how they move, in world axes: of spheres with the ground, or of pairs (a, b).

    centers (*batch, n, 3): p_WS of the spheres, those of b. depth (*batch, n): how far surfaces are inside one another,
    m. normals (*batch, n, 3): out of the ground, or from a to b. offsets (*batch, n, 3): p_SC, from the centres to the
    contact points. velocities (*batch, n, 3): of the point of the body that is at C, for observers on a, m/s.
    """

    centers: jax.Array
    depth: jax.Array
    normals: jax.Array
    offsets: jax.Array
    velocities: jax.Array


def contact_geometry(
    operation: str,
    mechanism: Mechanism,
    q: jax.Array,
    v: jax.Array,
    contacts: PointContacts,
    ground: Ground,
    precision: PrecisionName,
) -> ContactGeometry:
    """Of spheres with the ground, as `checked_spheres` returns them. operation: who asks, for messages."""
    if not contacts.frames:
        nothing = jnp.zeros((*floats.broadcast_shapes(q.shape[:-1], v.shape[:-1], contacts.batch_shape), 0, 3), q.dtype)
        return ContactGeometry(nothing, nothing[..., 0], nothing, nothing, nothing)
    centers, w, velocities = _motions(operation, mechanism, q, v, contacts, precision)
    normals, distances = normals_and_distances(operation, ground, centers, precision)
    offsets, depth, at_C = _on_ground(
        precision, w, velocities, normals, *map(floats.expanded, (distances, contacts.radius))
    )
    return ContactGeometry(centers, depth, normals, offsets, at_C)


def pair_geometry(
    operation: str, mechanism: Mechanism, q: jax.Array, v: jax.Array, pairs: Pairs, precision: PrecisionName
) -> ContactGeometry:
    """Of pairs, as `checked_pairs` returns them. operation: who asks, for messages."""
    (_, *motions_a), (centers, *motions_b) = (_motions(operation, mechanism, q, v, x, precision) for x in pairs)
    normals, distances, from_a, from_b = pair_normals_and_distances(mechanism, q, pairs, precision)
    velocities = _relative_velocity(precision, *motions_a, from_a, *motions_b, from_b)
    return ContactGeometry(centers, -distances, normals, from_b, velocities)


def _motions(
    operation: str,
    mechanism: Mechanism,
    q: jax.Array,
    v: jax.Array,
    contacts: PointContacts | ShapeContacts,
    precision: PrecisionName,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """The centres of spheres, or origins of frames, the angular velocities of their bodies, and the velocities of the
    centres: (*batch, n, 3) in world axes."""
    n, points = len(contacts.frames), contacts.positions
    points = None if points is None else points.reshape((*points.shape[:-2], 3 * n))
    return _point_motions(precision, mechanism, q, v, points, frames=contacts.frames, operation=operation)


@algorithm(*GEOMETRY, *FRAMES)
def _point_motions(state: MechanismState, v: Array, points: Array | None, *, frames: tuple[int, ...]):
    """Positions, angular velocities and velocities (n, 3, B) of points of frames, in world axes.

    points: (3 n, B) their positions in the frames; None for the origins.
    """
    at_rest = Motion(state.zero_vector, state.zero_vector)
    moving = recursion.outward(state, _pose_and_velocity, (state.world, at_rest), state.links(v))
    X_WJ, V_J = state.of_bodies(state.topology.bodies_of(frames), moving, (state.world, at_rest))
    X_JF, shape = state.frame_placements(frames), (len(frames), state.n)
    p_JS = X_JF.p + X_JF.R @ state.vectors(points)
    motions = X_WJ.p + X_WJ.R @ p_JS, X_WJ.R @ V_J.w, X_WJ.R @ (V_J.v + cross(V_J.w, p_JS))
    return tuple(jnp.stack([jnp.broadcast_to(state.rounded(c), shape) for c in x], 1) for x in motions)


def _pose_and_velocity(link: Link, parent: tuple[Pose, Motion]):
    X_WP, V_P = parent
    motion = composed(X_WP, link.X_PB), velocity_step(link, V_P)[0]
    return motion, motion


@formula
def _on_ground(w: Vector, v: Vector, normal: Vector, distance: Numbers, radius: Numbers) -> list[Any]:
    """The offset of C from the centre, the depth of the sphere, and the velocity of the body at C."""
    offset = -distance[0] * normal
    return [offset, radius[0] - distance[0], v + cross(w, offset)]


@formula
def _relative_velocity(w_a: Vector, v_a: Vector, from_a: Vector, w_b: Vector, v_b: Vector, from_b: Vector) -> Vector:
    return v_b + cross(w_b, from_b) - (v_a + cross(w_a, from_a))
