"""The explicit law of contact with the ground: forces on spheres, from their depths and velocities.

[Hunt, Crossley 1975; Castro and others 2020, A transition-aware method for the simulation of compliant contact with
regularized friction; Drake, Multibody, compliant point contact]
"""

import jax
import numpy as np

from jaxspatial.contact.geometry import Ground, checked_spheres, contact_geometry
from jaxspatial.engine.composite import composite
from jaxspatial.mechanism import AppliedForces, Mechanism, PointContacts
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Vector, cross, dot, norm
from jaxspatial.numerics.numbers import Number, Numbers, where
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce


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
        ValueError: shapes do not fit, or of numbers known while tracing a dissipation is below zero, a stiction speed
            not above it, or one is NaN.
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
    at_q, at_v, contacts, ground, batch = checked_spheres(what, mechanism, q, v, contacts, ground)
    dtype, n = at_q.dtype, len(contacts.frames)
    given = {"dissipation": dissipation, "stiction_speed": stiction_speed}
    own = {name: floats.as_float_array(x, f"{what}: {name}", dtype) for name, x in given.items()}
    for name, x in own.items():
        if x.shape[-1:] not in ((), (n,)):
            raise ValueError(f"{what}: {name}: expected a number, or shape (*batch, {n}), got {x.shape}")
    check.require_same_dtype(q=at_q, **own)
    if isinstance(own["dissipation"], np.ndarray) and not (own["dissipation"] >= 0).all():
        raise ValueError(f"{what}: dissipation: expected numbers of at least 0, got {dissipation}")
    if isinstance(own["stiction_speed"], np.ndarray) and not (own["stiction_speed"] > 0).all():
        raise ValueError(f"{what}: stiction_speed: expected numbers above 0, got {stiction_speed}")
    batch = floats.common_batch_shape(**{"q, v and contacts": batch}, **{name: x.shape[:-1] for name, x in own.items()})
    scene, numbers = (mechanism, contacts, ground), [x if x.ndim else x.reshape(1) for x in own.values()]
    if not n:
        wrenches = SpatialForce.zero((*batch, 0), dtype)
    else:
        wrenches = _contact_forces(resolve(precision), scene, at_q, at_v, *numbers)
    return AppliedForces(contacts.frames, wrenches, contacts.positions)


@composite
def _contact_forces(
    precision: Precision,
    scene: tuple[Mechanism, PointContacts, Ground],
    q: jax.Array,
    v: jax.Array,
    d: jax.Array,
    v_s: jax.Array,
) -> SpatialForce:
    """`contact_forces` of arrays, of some contacts."""
    mechanism, contacts, ground = scene
    found = contact_geometry("contact_forces", mechanism, q, v, contacts, ground, precision)
    numbers = map(floats.expanded, (found.depth, contacts.stiffness, contacts.friction, d, v_s))
    return SpatialForce(*_forces(precision, found.normals, found.velocities, found.offsets, *numbers))


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
