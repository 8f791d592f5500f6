"""A step in time with contact, friction and limits: one convex problem, solved by articulated bodies."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics import contact_solver
from jaxspatial.dynamics.contact import Ground, normals_and_distances
from jaxspatial.dynamics.contact_problem import Touching
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.dynamics.passive import is_nothing
from jaxspatial.dynamics.steps import (
    accelerated,
    euler,
    moved,
    plus,
    semi_implicit_step,
    turning_of_axes,
    with_springs_and_limits,
)
from jaxspatial.engine.algorithm import ExternalForces, checked
from jaxspatial.mechanism import Mechanism, PointContacts
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce


@exported
class ConvexStep(NamedTuple):
    """The result of `convex_step`."""

    q: jax.Array
    v: jax.Array
    contact_forces: SpatialForce | None
    residual: jax.Array
    iterations: jax.Array


def convex_step(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    contacts: PointContacts | None = None,
    ground: Ground | None = None,
    precision: PrecisionName = None,
) -> ConvexStep:
    q, v, tau, h, forces = checked("convex_step", mechanism, q=q, v=v, tau=tau, dt=dt, external_forces=external_forces)
    contacts = contacts if contacts is not None and contacts.frames else None
    batch = _batch(q, v, tau, h, forces, contacts)
    if contacts is None and not acts_on_joints(mechanism):
        after = semi_implicit_step(mechanism, q, v, tau, dt, forces, precision=precision)
        return ConvexStep(*after, None, jnp.zeros(batch, q.dtype), jnp.zeros(batch, np.int32))
    tau = with_springs_and_limits(mechanism, q, v, tau, None, precision)
    c = None if is_nothing(mechanism.damping) else jnp.asarray(mechanism.damping, q.dtype)
    turning = turning_of_axes(mechanism, q, v, precision)
    vdot = accelerated(mechanism, precision, (q, v, tau, turning), h, c, forces)
    free = euler(precision, v, h, vdot if turning is None else plus(precision, turning, vdot))
    still = v if turning is None else euler(precision, v, h, turning)

    free, still, vdot, wide_h = (jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in (free, still, vdot, h))
    touching = None if contacts is None else _touching(mechanism, q, contacts, ground, precision)
    y, residual, iterations = _changed(
        _narrow(precision), mechanism, q, v, still, wide_h * vdot, tau, wide_h, touching, forces, contacts
    )
    is_touched = jnp.broadcast_to((iterations > 0)[..., None], y.shape)
    after = _valued(still + y, lax.stop_gradient(jnp.where(is_touched, still + y, free)))
    next_q, next_v = moved(mechanism, q, after, dt, precision)
    return ConvexStep(next_q, next_v, None, residual, iterations)


def _narrow(precision: PrecisionName) -> Precision:
    """The precision of the iteration: numbers of one limb."""
    asked = resolve(precision)
    return Precision.REPRODUCIBLE if asked.sees_whole_sums else asked


def _batch(q: Any, v: Any, tau: Any, h: Any, forces: Any, contacts: PointContacts | None) -> tuple[int, ...]:
    of_contacts = () if contacts is None else contacts.batch_shape
    return np.broadcast_shapes(*(x.shape[:-1] for x in (q, v, tau, h, *jax.tree.leaves(forces))), of_contacts)


def acts_on_joints(mechanism: Mechanism) -> bool:
    """Whether limits or dry friction may act."""
    is_limited = not all(isinstance(x, np.ndarray) and np.isinf(x).all() for x in (mechanism.lower, mechanism.upper))
    return is_limited or not is_nothing(mechanism.friction_loss)


def _changed(
    precision: Precision,
    mechanism: Mechanism,
    q: Any,
    v: Any,
    still: jax.Array,
    change: jax.Array,
    tau: Any,
    h: jax.Array,
    touching: Touching | None,
    forces: Any,
    contacts: PointContacts | None,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """(the change of velocities, the residual, the iterations); derivatives by the implicit function theorem."""
    names = () if contacts is None else contacts.frames
    options: Any = {"frames_in_contact": tuple(mechanism.frame_names.index(name) for name in names)}
    change = lax.stop_gradient(change)
    fixed = jax.tree.map(
        lambda x: x if isinstance(x, np.ndarray) else lax.stop_gradient(x),
        (mechanism, q, still, h, touching),
    )
    y, residual, iterations = contact_solver.solve(
        precision, fixed[0], fixed[1], fixed[2], change, *fixed[3:], **options
    )

    def imbalance(y: jax.Array) -> jax.Array:
        return contact_solver.imbalance(
            precision, mechanism, q, v, still, change, y, y / h, tau, h, touching, forces, **options
        )

    def inverse(_: Any, force: jax.Array) -> jax.Array:
        return contact_solver.solve_at(
            precision, fixed[0], fixed[1], fixed[2], change, y, *fixed[3:], force, **options
        )

    def solve_tangent(times_H: Any, force: jax.Array) -> jax.Array:
        return lax.custom_linear_solve(times_H, force, inverse, symmetric=True)

    y = lax.custom_root(imbalance, y, lambda _, y: y, solve_tangent)
    return y, residual[..., 0], iterations[..., 0]


@jax.custom_jvp
def _valued(x: jax.Array, value: jax.Array) -> jax.Array:
    """`value`, with the derivative of x."""
    return value


@_valued.defjvp
def _(primals: Any, tangents: Any) -> Any:
    return primals[1], tangents[0]


def _touching(
    mechanism: Mechanism, q: jax.Array, contacts: PointContacts, ground: Ground | None, precision: PrecisionName
) -> Touching:
    n = len(contacts.frames)
    contacts = jax.tree.map(lambda x: x.astype(q.dtype) if isinstance(x, np.ndarray) else x, contacts)
    X_WF = forward_kinematics(mechanism, q, contacts.frames, precision=precision)
    p_WS = X_WF.translation if contacts.positions is None else X_WF @ contacts.positions

    normal, s = normals_and_distances("convex_step", ground, p_WS, precision)
    radius = jnp.broadcast_to(contacts.radius, s.shape)

    def flat(x: jax.Array) -> jax.Array:
        return x.reshape((*x.shape[:-2], 3 * n))

    def each(x: Any) -> Any:
        return (np if isinstance(x, np.ndarray) else jnp).broadcast_to(x, (*x.shape[:-1], n))

    positions = None if contacts.positions is None else contacts.positions.reshape((*contacts.positions.shape[:-2], -1))
    return Touching(
        positions,
        flat(-s[..., None] * normal),
        flat(normal),
        s - radius,
        each(contacts.stiffness),
        each(contacts.relaxation_time),
        each(contacts.friction),
    )
