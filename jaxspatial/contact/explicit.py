"""Contact with the ground: where spheres on a mechanism touch it, how they move there, and the explicit law of forces.

[Hunt, Crossley 1975; Castro and others 2020, A transition-aware method for the simulation of compliant contact with
regularized friction; Drake, Multibody, compliant point contact]
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.kinematics import velocity_step
from jaxspatial.engine import recursion
from jaxspatial.engine.algorithm import FRAMES, GEOMETRY, algorithm, checked
from jaxspatial.engine.composite import composite
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import Link, MechanismState
from jaxspatial.mechanism import AppliedForces, HalfSpace, Mechanism, PointContacts, ShapeContacts
from jaxspatial.mechanism.shapes import Shape, of_function
from jaxspatial.numerics import check
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Motion, Pose, Vector, cross, dot, norm
from jaxspatial.numerics.numbers import Number, Numbers, where
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce
from jaxspatial.spatial.algebra import composed

# The ground: from the position (3,) of a point in world axes to a number that is zero on its surface.
Ground = Callable[[jax.Array], Any]


def contact_forces(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    contacts: PointContacts,
    ground: Ground | None = None,
    *,
    dissipation: ArrayLike = 0.0,
    stiction_speed: ArrayLike = 1e-3,
    precision: PrecisionName = None,
) -> AppliedForces:
    """The forces of spheres that touch the ground, for the `external_forces` of an algorithm.

        f_n = k x (1 + d dx/dt), never below zero        f_t = -mu f_n s(|v_t| / v_s) v_t / |v_t|

    at a depth x > 0, with v_t the velocity of the body along the ground, k the stiffness, d the dissipation, mu the
    friction, v_s the stiction speed, and s(r) = r^3 (10 - 15 r + 6 r^2) for r < 1, else 1. At a distance forces are
    exactly zero. The force acts on the ground under the sphere: at C, the centre less its distance from the ground
    along the normal. This is Drake's continuous model, whose forces act half a depth lower. The relaxation
    times of the contacts have no part in it.

    Forces depend on the state alone. They are smooth in it, but where a sphere begins to touch and where f_n becomes
    zero. A stiff contact needs short steps: with `semi_implicit_step` below 2 sqrt(m / k), and below m v_s / (mu f_n)
    for its friction, with m the mass that a sphere moves. Friction is zero at rest: all creeps on a slope.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        contacts: PointContacts: spheres on frames, how stiff and how rough they are.
        ground: HalfSpace, HeightField, another shape or a function, see `convex_step`; None is the plane z = 0.
        dissipation: d, s/m: a number, (n,) or (*batch, n), of n contacts.
        stiction_speed: v_s, m/s, above zero: the speed from which friction has its full size; as `dissipation`.
        precision: name of a precision; None takes the default.

    Returns:
        AppliedForces (*batch,) on the frames of the contacts, at the centres of the spheres, in world axes.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or contacts are no
            PointContacts.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of centres and velocities that of `forward_kinematics` and `body_velocities`, of forces that of depth times k
        and 64 u of the force; depth is a difference of positions.
    Source: Hunt, Crossley 1975, Coefficient of restitution interpreted as damping in vibroimpact; Castro and others
        2020, A transition-aware method for the simulation of compliant contact with regularized friction.

    Example:
        >>> tip = js.PointContacts(["hand"], stiffness=1e4, relaxation_time=0.01, friction=0.8)
        >>> floor = js.HalfSpace(jnp.array([0.0, 0.0, 1.0]), jnp.array(-1.96875))  # 1/32 m above the hand
        >>> print(js.contact_forces(arm, 0 * q, 0 * v, tip, floor).wrenches.f)
        [[  0.    0.  312.5]]
    """
    what = "contact_forces"
    at_q, at_v, contacts, ground, batch = _checked(what, mechanism, q, v, contacts, ground)
    dtype, n = at_q.dtype, len(contacts.frames)
    given = {"dissipation": dissipation, "stiction_speed": stiction_speed}
    own = {name: check.as_float_array(x, f"{what}: {name}", dtype) for name, x in given.items()}
    for name, x in own.items():
        if x.shape[-1:] not in ((), (n,)):
            raise ValueError(f"{what}: {name}: expected a number, or shape (*batch, {n}), got {x.shape}")
    check.require_same_dtype(q=at_q, **own)
    if isinstance(own["stiction_speed"], np.ndarray) and (own["stiction_speed"] <= 0).any():
        raise ValueError(f"{what}: stiction_speed: expected numbers above 0, got {stiction_speed}")
    batch = check.common_batch_shape(**{"q, v and contacts": batch}, **{name: x.shape[:-1] for name, x in own.items()})
    scene, numbers = (mechanism, contacts, ground), [x if x.ndim else x.reshape(1) for x in own.values()]
    if not n:
        wrenches = SpatialForce.zero((*batch, 0), dtype)
    else:
        wrenches = _contact_forces(resolve(precision), scene, at_q, at_v, *numbers)
    return AppliedForces(contacts.frames, wrenches, contacts.positions)


@composite
def _contact_forces(
    precision: Precision, scene: tuple[Mechanism, PointContacts, Ground], q, v, d: jax.Array, v_s: jax.Array
) -> SpatialForce:
    """`contact_forces` of arrays, of some contacts."""
    mechanism, contacts, ground = scene
    at = _geometry("contact_forces", mechanism, q, v, contacts, ground, precision)
    numbers = map(check.expanded, (at.depth, contacts.stiffness, contacts.friction, d, v_s))
    return SpatialForce(*_forces(precision, at.normals, at.velocities, at.offsets, *numbers))


@formula
def _forces(
    normal: Vector, velocity: Vector, offset: Vector, depth: Numbers, k: Numbers, mu: Numbers, d: Numbers, v_s: Numbers
) -> list[Vector]:
    """The torque about the centre, and the force."""
    is_outside, speed = depth[0] <= 0, dot(normal, velocity)
    # NaN is not outside. Numbers outside are replaced, as derivatives there are to be zero and not NaN.
    x = where(is_outside, 0.0, depth[0])
    pressed = k[0] * x * (1 - d[0] * where(is_outside, 0.0, speed))
    pressed = where(pressed <= 0, 0.0, pressed)
    along = velocity - speed * normal
    f = pressed * normal - mu[0] * pressed * _regularised(along, v_s[0])
    return [cross(offset, f), f]


def _regularised(v: Vector, v_s: Number) -> Vector:
    """The direction of v, times a smooth step from 0 at rest to 1 at the speed v_s."""
    r = norm(v) / v_s
    is_slow = r < 1
    slow, fast = where(is_slow, r, 0.0), where(is_slow, 1.0, r)
    step = where(is_slow, slow * slow * (10 - slow * (15 - 6 * slow)), 1 / fast)
    return Vector(*((step / v_s) * c for c in v))


# -- geometry ---------------------------------------------------------------------------------------------------------


class ContactGeometry(NamedTuple):
    """Where n spheres on a mechanism are, and how they move, in world axes.

    centers (*batch, n, 3): p_WS. depth (*batch, n): how far each sphere is inside the ground, m. normals
    (*batch, n, 3): out of the ground. offsets (*batch, n, 3): p_SC, from the centres to the contact points on the
    ground. velocities (*batch, n, 3): of the point of the body that is at C, m/s.
    """

    centers: jax.Array
    depth: jax.Array
    normals: jax.Array
    offsets: jax.Array
    velocities: jax.Array


def contact_geometry(
    operation: str,
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    contacts: PointContacts,
    ground: Ground | None,
    precision: PrecisionName,
) -> ContactGeometry:
    """The ContactGeometry, over the common batch of all arguments. operation: who asks, for messages."""
    at_q, at_v, contacts, ground, batch = _checked(operation, mechanism, q, v, contacts, ground)
    if not contacts.frames:
        nothing = jnp.zeros((*batch, 0, 3), at_q.dtype)
        return ContactGeometry(nothing, nothing[..., 0], nothing, nothing, nothing)
    return _geometry(operation, mechanism, at_q, at_v, contacts, ground, precision)


def _checked(
    operation: str, mechanism: Mechanism, q, v, contacts: PointContacts, ground: Ground | None
) -> tuple[jax.Array, jax.Array, PointContacts, Ground, tuple[int, ...]]:
    """q, v, contacts and ground as arrays, and their common batch shape but for that of a ground."""
    contacts = checked_contacts(operation, contacts)
    at_q, at_v = checked(operation, mechanism, q=q, v=v)
    check.require_same_dtype(q=at_q, contacts=contacts)
    ground = checked_ground(operation, ground, at_q)
    batch = check.common_batch_shape(q=at_q.shape[:-1], v=at_v.shape[:-1], contacts=contacts.batch_shape)
    return at_q, at_v, contacts, ground, batch


def _geometry(
    operation: str, mechanism: Mechanism, q, v, contacts: PointContacts, ground: Ground, precision: PrecisionName
) -> ContactGeometry:
    centers, w, velocities = point_motions(operation, mechanism, q, v, contacts, precision)
    normals, distances = normals_and_distances(operation, ground, centers, precision)
    offsets, depth, at_C = _at_contact(
        precision, w, velocities, normals, *map(check.expanded, (distances, contacts.radius))
    )
    return ContactGeometry(centers, depth, normals, offsets, at_C)


def point_motions(
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


def checked_contacts(operation: str, contacts, name: str = "contacts") -> PointContacts:
    """The contacts, as JAX computes with them."""
    if not isinstance(contacts, PointContacts):
        check.refuse(f"{operation}: {name}", "PointContacts", contacts)
    return check.narrowed(contacts)


def checked_pairs(
    operation: str, mechanism: Mechanism, q, pairs: Any
) -> tuple[PointContacts | ShapeContacts, PointContacts] | None:
    """The pairs, as JAX computes with them; None where there are none."""
    what = f"{operation}: pairs"
    if not isinstance(pairs, tuple) or len(pairs) != 2:
        check.refuse(what, "(a, b), two PointContacts, or ShapeContacts and PointContacts", pairs)
    is_shape = isinstance(pairs[0], ShapeContacts)
    a = check.narrowed(pairs[0]) if is_shape else checked_contacts(operation, pairs[0], "pairs")
    b = checked_contacts(operation, pairs[1], "pairs")
    for x in (a, b):
        check.require_same_dtype(q=q, pairs=x)
    if len(a.frames) != len(b.frames):
        raise ValueError(f"{what}: expected as many of one as of the other, got {len(a.frames)} and {len(b.frames)}")
    of_each = zip(a.frames, b.frames, *(bodies_of(f"{what}: frames", mechanism, x) for x in (a, b)), strict=True)
    for one, other, body, of_other in of_each:
        if body == of_other:
            of = "of the world" if body < 0 else "of one"
            raise ValueError(f"{what}: expected frames of two bodies, got {one!r} and {other!r}, {of}")
    return (a, b) if a.frames else None


def bodies_of(what: str, mechanism: Mechanism, contacts: PointContacts | ShapeContacts) -> list[int]:
    """The number of the body that carries each frame, -1 for the world."""
    t = mechanism.topology
    return [t.frames[t.index(mechanism.frame_names, frame, what)][1] for frame in contacts.frames]


def checked_ground(operation: str, ground, q) -> Ground:
    """The ground, as JAX computes with it; z = 0 for None."""
    if ground is None:
        return HalfSpace(np.array([0, 0, 1], q.dtype), np.zeros((), q.dtype))
    if isinstance(ground, Shape):
        ground = check.narrowed(ground)
        check.require_same_dtype(q=q, ground=ground)
    elif not callable(ground):
        expected = "a HalfSpace, or a function from a point (3,) to a number, above zero outside"
        check.refuse(f"{operation}: ground", expected, ground)
    return ground


def calls_functions(ground: Ground) -> bool:
    """Whether a caller's function is a part of the ground."""
    return not isinstance(ground, Shape) or ground.calls_functions


def normals_and_distances(
    operation: str, ground: Ground, p: jax.Array, precision: PrecisionName
) -> tuple[jax.Array, jax.Array]:
    """The normals (*batch, n, 3) of the ground and the signed distances (*batch, n) of points (*batch, n, 3).

    ground: as `checked_ground` returns it. A shape may be a batch, of which each has n points.
    """
    if isinstance(ground, Shape):
        check.common_batch_shape(q=p.shape[:-2], ground=ground.batch_shape)
        return ground.of_many_points().normals_and_distances(precision, p)
    return of_function(f"{operation}: ground", ground, p, precision)


@formula
def _at_contact(w: Vector, v: Vector, normal: Vector, distance: Numbers, radius: Numbers) -> list[Any]:
    """The offset of C from the centre, the depth of the sphere, and the velocity of the body at C."""
    offset = -distance[0] * normal
    return [offset, radius[0] - distance[0], v + cross(w, offset)]


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
