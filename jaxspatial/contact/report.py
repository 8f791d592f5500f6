"""What is known of each contact: where it is, how deep, how fast it comes and slides, and whether it sticks."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.contact.geometry import (
    ContactGeometry,
    Ground,
    Pairs,
    checked_pairs,
    checked_spheres,
    contact_geometry,
    pair_geometry,
)
from jaxspatial.contact.points import harmonic_mean
from jaxspatial.dynamics.configuration import advance
from jaxspatial.engine.algorithm import NO_ARRAY, checked
from jaxspatial.mechanism import Mechanism, PointContacts
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Vector, dot
from jaxspatial.numerics.numbers import Numbers
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce

# By how much, in eps of the force, one that slides may be inside the cone of friction.
ON_THE_CONE = 32


@exported
class ContactReport(NamedTuple):
    """What is known of n contacts, those of `contacts` first and then those of `pairs`, in world axes.

    points: (*batch, n, 3) p_WC, the contact points that `contact_forces` of a step are about, m: on the ground under a
        sphere; of a pair between the surfaces, as far from each as it gives way: nearer to the stiffer one.
    normals: (*batch, n, 3) out of the ground, or from a to b.
    depths: (*batch, n) how far the surfaces are inside one another, m; below zero apart.
    approach: (*batch, n) how fast they come together along the normal, m/s.
    slip: (*batch, n, 3) how fast the body slides along the ground, or that of b along that of a, m/s.
    touches: (*batch, n) whether the depth is not below zero: these contacts take part in a step.
    sticks: (*batch, n) whether it pushes with a friction below its largest; None without forces.

    Example:
        >>> tip = js.PointContacts(["hand"], stiffness=1e4, relaxation_time=0.01, friction=0.8)
        >>> report = js.contact_report(arm, q, v, tip, js.HalfSpace(offset=-2.0))
        >>> print(report.points, report.touches)
        [[-0.7749  0.     -2.    ]] [False]
    """

    points: jax.Array
    normals: jax.Array
    depths: jax.Array
    approach: jax.Array
    slip: jax.Array
    touches: jax.Array
    sticks: jax.Array | None


def contact_report(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    contacts: PointContacts | None = None,
    ground: Ground | None = None,
    *,
    pairs: Pairs | None = None,
    forces: SpatialForce | None = None,
    dt: ArrayLike | None = None,
    precision: PrecisionName = None,
) -> ContactReport:
    """Where contacts are, how deep, how fast they come together and slide, and which of them stick.

        after = js.convex_step(mech, q, v, tau, dt, contacts=feet, ground=terrain)
        report = js.contact_report(mech, q, after.v, feet, terrain, forces=after.contact_forces, dt=dt)

    A step finds its contacts at the old q, and its law holds at the new v: with these the report is that of the step.
    Balances of momentum with the forces about `points` are then those of the step. Friction that is as large as it may
    be, to rounding errors, counts as sliding.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        contacts: PointContacts, as of the step; None for none.
        ground: as of `convex_step`.
        pairs: as of `convex_step`.
        forces: SpatialForce (*batch, n) on the contacts, such as `contact_forces` of the step or `wrenches` of
            `contact_forces`, of which the force counts; None for none.
        dt: the time of the step from q to v, s: a number or (*batch,). The new v of a floating body is along its axes
            at the end of the step. None where v is along those at q.
        precision: name of a precision; None takes the default.

    Returns:
        ContactReport over the common batch.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, contacts are no
            PointContacts, or forces no SpatialForce.
        ValueError: shapes do not fit, there are neither contacts nor pairs, or not as many forces.
        KeyError: there is no such frame.

    Error: of points and velocities that of `forward_kinematics` and `body_velocities`; depth is a difference of
        positions.
    Source: Castro, Permenter, Han 2022, An unconstrained convex formulation of compliant contact.

    Example:
        >>> tip = js.PointContacts(["hand"], stiffness=1e4, relaxation_time=0.01, friction=0.8)
        >>> floor = js.HalfSpace(jnp.array([0.0, 0.0, 1.0]), jnp.array(-1.96875))  # 1/32 m above the hand
        >>> report = js.contact_report(arm, 0 * q, 0 * v, tip, floor)
        >>> print(report.depths, report.touches)
        [0.0312] [ True]
    """
    what = "contact_report"
    at_q, at_v, h = checked(what, mechanism, q=q, v=v, dt=NO_ARRAY if dt is None else dt)
    if h is not None and mechanism.topology.turns_axes:
        # Turning back takes the angular velocity alone, which is the same along both axes.
        at_v = advance(precision, mechanism, at_q, at_v, -h[..., 0])[1]
    parts, friction = list[ContactGeometry](), list[jax.Array]()
    if contacts is not None:
        at_q, at_v, contacts, ground, _ = checked_spheres(what, mechanism, at_q, at_v, contacts, ground)
        parts.append(contact_geometry(what, mechanism, at_q, at_v, contacts, ground, precision))
        friction.append(jnp.broadcast_to(contacts.friction, parts[-1].depth.shape))
    pairs = None if pairs is None else checked_pairs(what, mechanism, at_q, pairs)
    if pairs is not None:
        parts.append(pair_geometry(what, mechanism, at_q, at_v, pairs, precision))
        friction.append(jnp.broadcast_to(harmonic_mean(*(x.friction for x in pairs)), parts[-1].depth.shape))
    if not parts:
        raise ValueError(f"{what}: expected contacts or pairs, got neither")
    batch = floats.broadcast_shapes(*(x.depth.shape[:-1] for x in parts))
    centers, depths, normals, offsets, velocities = (
        jnp.concatenate([jnp.broadcast_to(x, (*batch, *x.shape[axis:])) for x in each], axis)
        for axis, each in zip((-2, -1, -2, -2, -2), zip(*parts, strict=True), strict=True)
    )
    points, approach, slip = _point_and_speeds(precision, centers, offsets, normals, velocities)
    sticks = None
    if forces is not None:
        check.require_kind(forces, SpatialForce, f"{what}: forces")
        n = depths.shape[-1]
        if forces.f.shape[-2:] != (n, 3):
            raise ValueError(f"{what}: forces: expected one for each of {n} contacts, got {forces.batch_shape}")
        mu = floats.expanded(jnp.concatenate([jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in friction], -1))
        eps = np.full(1, ON_THE_CONE * floats.eps(at_q.dtype), at_q.dtype)
        sticks = _sticks(precision, forces.f, normals, mu, eps)
    return ContactReport(points, normals, depths, approach, slip, ~(depths < 0), sticks)


@formula
def _point_and_speeds(center: Vector, offset: Vector, n: Vector, v: Vector) -> list[Any]:
    """(the contact point, how fast surfaces approach, how fast they slide)."""
    along = dot(n, v)
    return [center + offset, -along, v - along * n]


@formula
def _sticks(f: Vector, n: Vector, mu: Numbers, eps: Numbers):
    pressed = dot(n, f)
    across = f - pressed * n
    largest = mu[0] * pressed - eps[0] * pressed
    return (pressed > 0) & (largest > 0) & (dot(across, across) < largest * largest)
