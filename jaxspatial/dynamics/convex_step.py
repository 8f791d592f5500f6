"""A step in time with contact, friction and limits: one convex problem, solved by articulated bodies."""

from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics import contact_solver
from jaxspatial.dynamics.contact import Ground, checked_contacts, normals_and_distances
from jaxspatial.dynamics.contact_problem import Touching, rows_of_joints
from jaxspatial.dynamics.docstrings import documented
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.dynamics.passive import is_nothing
from jaxspatial.dynamics.steps import (
    SEMI_IMPLICIT,
    moved,
    semi_implicit_step,
    stepped_velocities,
    without_accelerations,
)
from jaxspatial.engine.algorithm import ExternalForces, checked
from jaxspatial.engine.derivatives import fixed
from jaxspatial.mechanism import Mechanism, PointContacts
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.numerics import check
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce


@exported
class ConvexStep(NamedTuple):
    """The state after a `convex_step`, and how it was found.

    q: (*batch, nq), quaternions of unit length. v: (*batch, nv).
    contact_forces: SpatialForce (*batch, n), on the body of each contact, about the contact point C on the ground, in
        world axes: impulse over dt, N; None without contacts.
    residual: (*batch,) the decrement sqrt(g^T H^-1 g) at the start of the last iteration, relative to the momenta
        sqrt(v^T A v + y^T A y), with g the gradient and H the Hessian of the cost, and y the change of v without
        contact. It is at most 2e-6 in float32 and 1e-10 in float64, unless the iterations were not enough; 0 where
        nothing touches.
    iterations: (*batch,) of Newton's method, at most 60; 0 where nothing touches.
    """

    q: jax.Array
    v: jax.Array
    contact_forces: SpatialForce | None
    residual: jax.Array
    iterations: jax.Array


@documented(bound=SEMI_IMPLICIT)
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
    """A step of semi-implicit Euler with contact, dry friction and limits of joints, as one convex problem.

        v' = argmin |v' - v*|^2_A / 2 + sum l_i(J_i v')        q' = integrate(q, v', dt)

    A is the mass matrix with implicit damping, v* the velocities of `semi_implicit_step` without contact. Each contact
    inside the ground, each limit nearby and each dry friction adds a convex term l_i, whose derivative is its impulse.
    Contact i pushes along the normal with k (x' - tau_d v_n'), never below zero: a spring and a damper at the depth x'
    and the velocity v_n' after the step. Its friction is inside the cone |f_t| <= mu f_n.

    What is not contact acts as in `semi_implicit_step`, without its regularised friction; where nothing touches, the
    result has its bits, and without contacts, limits and dry friction it is that step. Limits act on joints of one
    coordinate. Limits and dry friction are as hard as the time step allows: a joint at rest under less than its
    friction creeps by at most 1e-3 of the velocity that its impulse would cause alone.

    Friction that slides lifts a body by dt' mu |v_t|, with dt' = dt + tau_d, if that is more than its depth: an
    artefact of convexity. Contacts that are found outside of the ground do nothing in this step, however fast they
    approach.

    Derivatives of any order are those of the optimum, by the implicit function theorem: with the same solver, through
    sticking, sliding and flight. Where a contact begins to touch, stick or slide, they are those of one side.

    Args:
        dt: the time, s: a number or (*batch,).
        contacts: PointContacts on frames of moving bodies; None for none.
        ground: HalfSpace, or a function from a point (3,) in world axes to its signed distance; None for z = 0.

    Returns:
        ConvexStep over the common batch.

    Raises:
        NotImplementedError: something touches a mechanism with mimics.

    Error: of v at most {bound.plain} and dt times that of `forward_dynamics`, and what the residual says: the distance
        from the optimum, in the norm of A, is about residual^2 of sqrt(v^T A v + y^T A y), see `ConvexStep`. The
        iteration has the precision of the dtype: what touches is rounded as in "reproducible" in every precision.
    Source: Castro, Permenter, Han 2022, An unconstrained convex formulation of compliant contact; Featherstone 2008,
        table 7.1; Drake 1.51, SapDriver, whose numbers these are.
    """
    *state, h, forces = checked("convex_step", mechanism, q=q, v=v, tau=tau, dt=dt, external_forces=external_forces)
    contacts = None if contacts is None else _checked_contacts(mechanism, state[0], contacts)
    return _step(mechanism, state, h, dt, forces, contacts, ground, precision)


def _step(
    mechanism: Mechanism,
    state: Sequence[Any],
    h: Any,
    dt: ArrayLike,
    forces: Any,
    contacts: PointContacts | None,
    ground: Ground | None,
    precision: PrecisionName,
) -> ConvexStep:
    """`convex_step` of checked arguments. state: q, v and tau; h: dt as (*batch, 1)."""
    q, v, tau = state
    batch = _batch(q, v, tau, h, forces, contacts)
    if contacts is None and not len(rows_of_joints(mechanism.topology, vars(mechanism))):
        after = semi_implicit_step(mechanism, q, v, tau, dt, forces, precision=precision)
        # Known zeros leave no operation behind.
        residual, iterations = cast(Any, (np.zeros(batch, q.dtype), np.zeros(batch, np.int32)))
        return ConvexStep(after[0], after[1], None, residual, iterations)
    if mechanism.topology.has_mimics:
        raise NotImplementedError("convex_step: mechanism: contacts, limits and friction of mechanisms with mimics")
    c = None if is_nothing(mechanism.damping) else jnp.asarray(mechanism.damping, q.dtype)
    free, turning, vdot, tau = stepped_velocities(mechanism, (q, v, tau), h, c, forces, None, precision)
    still = without_accelerations(precision, v, h, turning)

    free, still, vdot, wide_h = (jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in (free, still, vdot, h))
    touching = None if contacts is None else _touching(mechanism, q, contacts, ground, precision)
    problem = _Problem(mechanism, q, v, still, lax.stop_gradient(wide_h * vdot), tau, wide_h, touching, forces)
    frames = () if contacts is None else tuple(map(mechanism.frame_names.index, contacts.frames))
    # The iteration has numbers of one limb.
    narrow = resolve(precision).of_one_limb
    y, residual, iterations = problem.solved(narrow, frames)
    is_touched = jnp.broadcast_to((iterations > 0)[..., None], y.shape)
    after = _valued(still + y, lax.stop_gradient(jnp.where(is_touched, still + y, free)))
    pushed = None if contacts is None else problem.forces_at(narrow, frames, y)
    next_q, next_v = moved(mechanism, q, after, dt, precision)
    return ConvexStep(next_q, next_v, pushed, residual, iterations)


def _checked_contacts(mechanism: Mechanism, q: Any, contacts: Any) -> PointContacts | None:
    contacts = checked_contacts("convex_step", contacts)
    for name in contacts.frames:
        if mechanism.frame_body(name) == WORLD:
            raise ValueError(f"convex_step: contacts: expected frames of moving bodies, got {name!r}, of the world")
    check.require_same_dtype(q=q, contacts=contacts)
    return contacts if contacts.frames else None


def _batch(q: Any, v: Any, tau: Any, h: Any, forces: Any, contacts: PointContacts | None) -> tuple[int, ...]:
    of_contacts = () if contacts is None else contacts.batch_shape
    return np.broadcast_shapes(*(x.shape[:-1] for x in (q, v, tau, h, *jax.tree.leaves(forces))), of_contacts)


class _Problem(NamedTuple):
    """What the programs of `contact_solver` take. still: v along axes that do not turn. change: by which it changes
    without contact. h: (*batch, 1), the time."""

    mechanism: Mechanism
    q: jax.Array
    v: jax.Array
    still: jax.Array
    change: jax.Array
    tau: jax.Array
    h: jax.Array
    touching: Touching | None
    forces: Any

    def solved(self, precision: Precision, frames: tuple[int, ...]) -> tuple[jax.Array, jax.Array, jax.Array]:
        """(the change of velocities, the residual, the iterations); derivatives by the implicit function theorem."""
        at = fixed(self)
        y, residual, iterations = contact_solver.solve(
            precision, at.mechanism, at.q, at.still, at.change, at.h, at.touching, frames_in_contact=frames
        )

        def imbalance(y: jax.Array) -> jax.Array:
            state = self.q, self.v, self.still, self.change, y, y / self.h, self.tau, self.h
            return contact_solver.imbalance(
                precision, self.mechanism, *state, self.touching, self.forces, frames_in_contact=frames
            )

        def inverse(_: Any, force: jax.Array) -> jax.Array:
            state = at.q, at.still, at.change, y, at.h, at.touching
            return contact_solver.solve_at(precision, at.mechanism, *state, force, frames_in_contact=frames)

        def tangent(times_H: Any, force: jax.Array) -> jax.Array:
            return lax.custom_linear_solve(times_H, force, inverse, symmetric=True)

        return lax.custom_root(imbalance, y, lambda _, y: y, tangent), residual[..., 0], iterations[..., 0]

    def forces_at(self, precision: Precision, frames: tuple[int, ...], y: jax.Array) -> SpatialForce:
        """The forces of contacts, for a change y of the velocities."""
        state = self.q, self.still, self.change, y, self.h
        impulses = contact_solver.impulses(precision, self.mechanism, *state, self.touching, frames_in_contact=frames)
        f = (impulses / self.h).reshape((*impulses.shape[:-1], len(frames), 3))
        return SpatialForce(jnp.zeros_like(f), f)


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
