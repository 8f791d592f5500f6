"""Integrators: semi-implicit Euler, variational Euler, and Runge-Kutta steps in time."""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.composite_bodies import factored, mass_matrix
from jaxspatial.dynamics.configuration import advance, configuration_rates, difference, integrate, transport
from jaxspatial.dynamics.energy import kinetic_energy
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import bias_forces
from jaxspatial.dynamics.passive import (
    Compliance,
    checked_compliance,
    damping_coefficients,
    passive_forces_or_none,
)
from jaxspatial.engine.algorithm import ExternalForces, checked, over_batch
from jaxspatial.engine.composite import composite
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.formula import formula, plus
from jaxspatial.numerics.numbers import Number, doubled
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.promise import Normwise, promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName

Scene = tuple[Mechanism, Compliance | None]
At = tuple[jax.Array, jax.Array, jax.Array]  # q, v, tau

# Error bounds of velocities: in general, of linear ones whose axes turn, and what turning beyond half a turn adds.
# In every precision.
SEMI_IMPLICIT, RK4 = (Normwise(u, "(|v| + dt |vdot|)", rounded=u) for u in (2, 4))
STRAIGHT_AHEAD = Normwise(8, "(|v| + dt |vdot| + dt |w| |v|)", rounded=8)
TURNS = Normwise(1, "|w dt| of that", rounded=1)
RK4_COORDINATES = Normwise(4, "(|q| + dt |dq/dt|)", rounded=4)
SYMPLECTIC = Normwise(8, "c (|v| + dt |vdot|)", per="n", rounded=8)


@promises(bound=SEMI_IMPLICIT, linear=STRAIGHT_AHEAD, turns=TURNS)
def semi_implicit_step(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    compliance: Compliance | None = None,
    precision: PrecisionName = None,
) -> tuple[jax.Array, jax.Array]:
    """A step of the semi-implicit Euler method: v by the accelerations at the start, then q by the new v.

        v' = v + dt vdot(q, v)        q' = integrate(q, v', dt)

    It is of first order, takes one evaluation of `forward_dynamics`, and is the step of most simulators: MuJoCo's Euler
    method, except for friction, limits and contacts.

    The linear velocities of "free" and "planar" joints are along axes that turn, with rotation R. They are stepped in
    the axes of the parent:

        u = R v        u' = u + dt du/dt        p' = p + dt u'        v' = R'^T u'

    A spinning body whose centre of mass is at the origin of its joint then moves along a straight line at constant
    speed, whatever dt is; the linear momentum of other floating robots drifts in proportion to dt.

    `passive_forces` act. Damping and friction are implicit, friction with its coefficient at the old velocities: the
    step is stable however large they are, and they never add energy. Springs and limits are explicit: the step is
    stable for dt below 2 / w, with w = sqrt(stiffness / inertia) the largest natural frequency, and for
    dt limit_damping below the inertia. Where the mass matrix depends on q the step is not symplectic, and energy drifts
    in proportion to dt and the time: see `symplectic_step`.

    A velocity without inertia, of what has neither mass, armature nor damping, stays as it is, see `forward_dynamics`.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        dt: the time, s: a number or (*batch,).
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        compliance: of friction and limits; None takes the default, see `Compliance`.
        precision: name of a precision; None takes the default.

    Returns:
        (q (*batch, nq), v (*batch, nv)) after the time dt, over the common batch; quaternions of unit length. What
        turns by more than some 1 / u rad in the step is NaN, see `integrate`.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of rounding, per step, in the largest number: of v at most 2 u (|v| + dt |vdot|) and dt times that of
        `forward_dynamics`; of q that of `integrate` and dt times that of v. Of linear velocities of "free" and "planar"
        joints 8 u (|v| + dt |vdot| + dt |w| |v|), in their 2-norm, and u |w dt| of that more beyond half a turn.
    Source: Hairer, Lubich, Wanner 2006, Geometric numerical integration, I.1.2; Todorov 2014, Convex and
        analytically-invertible dynamics with contacts and constraints (implicit damping).

    Example:
        >>> q1, v1 = js.semi_implicit_step(arm, q, v, tau, dt=1e-2)
        >>> print(q1, v1)
        [ 0.5095 -0.194 ] [0.9549 0.6009]
    """
    *at, h, forces = checked("semi_implicit_step", mechanism, q=q, v=v, tau=tau, dt=dt, external_forces=external_forces)
    if not mechanism.nv:
        return at_rest(*at, h, forces)
    return _semi_implicit_step(resolve(precision), _scene(mechanism, at[1], compliance), *at, h, forces)


@composite
def _semi_implicit_step(
    precision: Precision, scene: Scene, q: jax.Array, v: jax.Array, tau: jax.Array, h: jax.Array, forces: ExternalForces
) -> tuple[jax.Array, jax.Array]:
    mechanism, compliance = scene
    c = damping_coefficients(mechanism, v, compliance, precision)
    after = stepped_velocities(mechanism, (q, v, tau), h, c, forces, compliance, precision).v
    return moved(mechanism, q, after, h[..., 0], precision)


def _scene(mechanism: Mechanism, v: jax.Array, compliance: Compliance | None) -> Scene:
    """What a step is one program for."""
    return mechanism, None if compliance is None else checked_compliance(mechanism, v, compliance)


def at_rest(q: jax.Array, *others: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(q, v) without any coordinates and velocities, over the common batch."""
    batch = floats.broadcast_shapes(*(x.shape[:-1] for x in jax.tree.leaves((q, others))))
    nothing = jnp.zeros((*batch, 0), q.dtype)
    return nothing, nothing


class SteppedVelocities(NamedTuple):
    """v: the velocities after a time dt, along the axes at the start. turning: `transport`, None where no joint turns
    its axes. vdot: the accelerations. tau: the forces at the joints, with those of springs and limits."""

    v: jax.Array
    turning: jax.Array | None
    vdot: jax.Array
    tau: jax.Array


def stepped_velocities(
    mechanism: Mechanism,
    at: tuple[jax.Array, jax.Array, jax.Array],
    h: jax.Array,
    c: jax.Array | None,
    forces: ExternalForces,
    compliance: Compliance | None,
    precision: PrecisionName,
) -> SteppedVelocities:
    """The SteppedVelocities of a state (q, v, tau), under implicit damping: the force is -c v at the new velocities."""
    q, v, tau = at
    springs = passive_forces_or_none(mechanism, q, v, compliance, precision, with_resistance=False)
    tau = tau if springs is None else plus(precision, tau, springs)
    turning = transport(precision, mechanism, q, v) if mechanism.topology.turns_axes else None
    accelerated = functools.partial(_accelerated, mechanism, precision)
    if c is None or (c.ndim == 1 and h.ndim == 1):
        vdot = accelerated((q, v, tau), h, c, forces)
    else:
        # Damping coefficients, or times, differ within the batch.
        vdot = over_batch(accelerated, (q, v, tau), h, c, forces)
    after = euler(precision, v, h, vdot if turning is None else plus(precision, turning, vdot))
    return SteppedVelocities(after, turning, vdot, tau)


def without_accelerations(precision: PrecisionName, v: jax.Array, h: jax.Array, turning: jax.Array | None) -> jax.Array:
    """The velocities after a time dt in which only the axes turn."""
    return v if turning is None else euler(precision, v, h, turning)


def moved(
    mechanism: Mechanism, q: jax.Array, v: jax.Array, dt: ArrayLike, precision: PrecisionName
) -> tuple[jax.Array, jax.Array]:
    """(q, v) after the time dt, for new velocities v along the axes at the old q."""
    if mechanism.topology.turns_axes:
        # `advance` turns v to the axes at the new q.
        return advance(precision, mechanism, q, v, dt)
    return integrate(mechanism, q, v, dt, precision=precision), v


def _accelerated(
    mechanism: Mechanism, precision: PrecisionName, at: At, h: jax.Array, c: jax.Array | None, forces: ExternalForces
) -> jax.Array:
    """The accelerations under implicit damping, with one time and the same damping for all states."""
    q, v, tau = at
    if c is not None:
        # (M + h c) vdot = tau - c v - ...: as with armature increased by h c. Where axes turn, both act on the rates in
        # the axes of the parent: v' - v = h (vdot + w x v).
        armature = jnp.asarray(mechanism.armature, c.dtype) + h * c
        tau, mechanism = _damped(precision, tau, c, v), mechanism.replace(armature=armature)
    return forward_dynamics(mechanism, q, v, tau, forces, precision=precision)


@promises(bound=SYMPLECTIC)
def symplectic_step(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    iterations: int = 5,
    compliance: Compliance | None = None,
    precision: PrecisionName = None,
) -> tuple[jax.Array, jax.Array]:
    """A step of the variational Euler method, which is symplectic: q moves by the new v, the velocity of this step.

    It is of first order, and about five times the work of the other steps. It makes the discrete action, the sum of
    dt T(q, v) - dt V(q), stationary, with the energy of springs in V. Without damping, friction, and forces that vary
    or dissipate, the errors of energy and momenta stay bounded in proportion to dt, over any number of steps.
    `passive_forces` act as in `semi_implicit_step`. v is the velocity of the screw motion that led to q, so the linear
    velocity of a spinning body has the direction of half a step earlier. Where a velocity has neither inertia nor
    damping the step is NaN.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        dt: the time, s: a number or (*batch,). The same at every step.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        iterations: how many, of the quadratic equation for v. Each reduces the error by a factor of dt |v| times a
            number between 1 and about the condition number of the mass matrix.
        compliance: of friction and limits; None takes the default, see `Compliance`.
        precision: name of a precision; None takes the default.

    Returns:
        (q (*batch, nq), v (*batch, nv)) after the time dt, over the common batch; quaternions of unit length.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit, or iterations is no integer from 0 on.
        KeyError: there is no such frame.

    Error: of rounding, per step, in the largest number: of v at most 8 n u c (|v| + dt |vdot|) in every precision, for
        n links in the longest chain and c the condition number of the mass matrix; of q that of `integrate` and dt
        times that of v. The remainder of the iteration comes on top.
    Source: Marsden, West 2001, Discrete mechanics and variational integrators, 1.1 to 1.4; Lee, Leok, McClamroch 2007,
        Lie group variational integrators for the full body problem.

    Example:
        >>> q1, v1 = js.symplectic_step(arm, q, v, jnp.zeros(2), dt=1e-2)
        >>> print(q1, v1)
        [ 0.5091 -0.1933] [0.9138 0.6721]
    """
    *at, h, forces = checked("symplectic_step", mechanism, q=q, v=v, tau=tau, dt=dt, external_forces=external_forces)
    iterations = check.as_count(iterations, "symplectic_step: iterations", 0)
    if not mechanism.nv:
        return at_rest(*at, h, forces)
    scene = _scene(mechanism, at[1], compliance)
    return _variational_step(resolve(precision), scene, *at, h, forces, iterations=iterations)


@composite
def _variational_step(
    precision: Precision,
    scene: Scene,
    q: jax.Array,
    v: jax.Array,
    tau: jax.Array,
    h: jax.Array,
    external_forces: ExternalForces,
    *,
    iterations: int,
) -> tuple[jax.Array, jax.Array]:
    mechanism, compliance = scene
    q, v, tau = map(jnp.asarray, (q, v, tau))
    springs = passive_forces_or_none(mechanism, q, v, compliance, precision, with_resistance=False)
    tau = tau if springs is None else plus(precision, tau, springs)
    damping = damping_coefficients(mechanism, v, compliance, precision)
    derivatives, dt = _action_derivatives(mechanism, precision), h[..., 0]
    damping = None if damping is None else h * jnp.broadcast_to(damping, v.shape)
    before = integrate(mechanism, q, v, -dt, precision=precision)
    at_rest = np.zeros(mechanism.nv, q.dtype)
    static = bias_forces(mechanism, q, at_rest, external_forces, precision=precision)  # g(q) - J^T F
    momentum = euler(precision, derivatives(before, q, v, dt)[1], h, tau - static)
    M = mass_matrix(mechanism, q, precision=precision)
    if damping is not None:
        on_diagonal = jnp.broadcast_to(jnp.eye(mechanism.nv, dtype=bool), M.shape)
        M = M + jnp.where(on_diagonal, jnp.broadcast_to(damping[..., None], M.shape), 0)
    factor = factored(M)

    def nearer(_: jax.Array, v: jax.Array) -> jax.Array:
        left = momentum + derivatives(q, integrate(mechanism, q, v, dt, precision=precision), v, dt)[0]
        return v + factor.solve(left if damping is None else _damped(precision, left, damping, v))

    v = jax.lax.fori_loop(0, iterations, nearer, v)
    return integrate(mechanism, q, v, dt, precision=precision), v


def _action_derivatives(mechanism: Mechanism, precision: PrecisionName) -> Callable[..., list[jax.Array]]:
    """A function of (q, next q, v, dt): the derivatives of the kinetic action dt T(q, v) by motions of q and of next q.

    v = (next q - q) / dt is an argument because that difference would have a rounding error of u |q| / dt.
    """

    def energy(q: jax.Array, v: jax.Array):
        return kinetic_energy(mechanism, q, v, precision=precision).sum()

    def derivatives(q: jax.Array, next_q: jax.Array, v: jax.Array, dt: jax.Array) -> list[jax.Array]:
        of_q, momentum = jax.grad(energy, (0, 1))(q, v)
        _, of_motions = jax.vjp(functools.partial(difference, mechanism, precision=precision), q, next_q)
        by_q, by_next_q = of_motions(momentum)
        by_velocity = list[jax.Array]()
        for x, by_x in ((q, euler(precision, by_q, dt[..., None], of_q)), (next_q, by_next_q)):
            rates = functools.partial(configuration_rates, mechanism, x, precision=precision)
            by_velocity += jax.vjp(rates, jnp.zeros((*x.shape[:-1], mechanism.nv), x.dtype))[1](by_x)
        return by_velocity

    return derivatives


@promises(bound=RK4, coordinates=RK4_COORDINATES)
def rk4_step(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    dt: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    compliance: Compliance | None = None,
    precision: PrecisionName = None,
) -> tuple[jax.Array, jax.Array]:
    """A step of the classical Runge-Kutta method of fourth order.

    tau and the external forces are constant during the step. Coordinates are stepped as an array; quaternions are
    normalised at the end. The linear velocities of "free" and "planar" joints are along axes that turn with w: the step
    is stable for dt |w| below 2.8, and a spinning body keeps its speed to (dt |w|)^6 / 144 per step. `passive_forces`
    are explicit: stable for dt below 2.8 inertia / c, with c the sum of damping and friction_loss / friction_speed. A
    step in which friction or a limit sets in is of first order. A velocity without inertia stays as it is, see
    `forward_dynamics`.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        dt: the time, s: a number or (*batch,).
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        compliance: of friction and limits; None takes the default, see `Compliance`.
        precision: name of a precision; None takes the default.

    Returns:
        (q (*batch, nq), v (*batch, nv)) after the time dt, over the common batch; quaternions of unit length.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of rounding, per step, in the largest number: of v at most 4 u (|v| + dt |vdot|) and dt times that of
        `forward_dynamics`, with vdot the largest of the four; of q 4 u (|q| + dt |dq/dt|) and dt times that of v. In
        "compensated" and "faithful" the stages between are rounded to the dtype.
    Source: Hairer, Norsett, Wanner 1993, Solving ordinary differential equations I, II.1.

    Example:
        >>> q1, v1 = js.rk4_step(arm, q, v, jnp.zeros(2), dt=1e-2)
        >>> print(q1, v1)
        [ 0.5096 -0.1941] [0.9135 0.672 ]
    """
    *at, h, forces = checked("rk4_step", mechanism, q=q, v=v, tau=tau, dt=dt, external_forces=external_forces)
    if not mechanism.nv:
        return at_rest(*at, h, forces)
    return _rk4_step(resolve(precision), _scene(mechanism, at[1], compliance), *at, h, forces)


@composite
def _rk4_step(
    precision: Precision,
    scene: Scene,
    q: jax.Array,
    v: jax.Array,
    tau: jax.Array,
    h: jax.Array,
    external: ExternalForces,
) -> tuple[jax.Array, jax.Array]:
    mechanism, compliance = scene

    def rate(q: jax.Array, v: jax.Array) -> tuple[jax.Array, jax.Array]:
        passive = passive_forces_or_none(mechanism, q, v, compliance, precision)
        forces = tau if passive is None else plus(precision, tau, passive)
        vdot = forward_dynamics(mechanism, q, v, forces, external, precision=precision)
        return configuration_rates(mechanism, q, v, precision=precision), vdot

    k = [rate(q, v)]
    for share in (0.5, 0.5, 1.0):
        ahead = (euler(precision, a, h * h.dtype.type(share), b) for a, b in zip((q, v), k[-1], strict=True))
        k.append(rate(*ahead))
    q, v = (_rk4_mean(precision, a, h, *rates) for a, *rates in zip((q, v), *k, strict=True))
    # A step of length zero normalises quaternions.
    zero = np.zeros(mechanism.nv, q.dtype)
    return integrate(mechanism, q, zero, precision=precision), v


@formula(by_number=True)
def euler(x: Number, dt: Number, rate: Number):
    return x + dt * rate


@formula(by_number=True)
def _rk4_mean(x: Number, dt: Number, k1: Number, k2: Number, k3: Number, k4: Number):
    return x + dt * ((k1 + k4) + doubled(k2 + k3)) / 6


@formula(by_number=True)
def _damped(tau: Number, damping: Number, v: Number):
    return tau - damping * v
