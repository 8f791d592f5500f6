"""Steps in time."""

import functools
from collections.abc import Callable
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Numbers, doubled
from jaxspatial.arithmetic.types import Coordinates, Forces, PrecisionName, Rates, Scalar
from jaxspatial.dynamics.along import Array, PyTreeDef
from jaxspatial.dynamics.arguments import ExternalForces, checked
from jaxspatial.dynamics.configuration import advance, configuration_rates, integrate, transport
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.passive import Compliance, acting, resistance
from jaxspatial.dynamics.variational import variational_step
from jaxspatial.mechanism import Mechanism

Checked = Any  # an array
At = tuple[Checked, Checked, Checked, Checked]  # q, v, tau, and `transport` or None


def semi_implicit_step(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    tau: Forces,
    dt: Scalar,
    external_forces: ExternalForces = None,
    *,
    compliance: Compliance | None = None,
    precision: PrecisionName = None,
) -> tuple[jax.Array, jax.Array]:
    """A step of the semi-implicit Euler method: v by the accelerations at the start, then q by the new v.

        v' = v + dt vdot(q, v)        q' = integrate(q, v', dt)

    Linear rates of "free" and "planar" joints, along axes that turn, are stepped along those of the parent, of R:

        u = R v        u' = u + dt du/dt        p' = p + dt u'        v' = R'^T u'

    What spins flies straight, at a constant speed, whatever dt is, where its centre of mass stays at the origin of the
    joint; the linear momentum of other robots that float drifts in proportion to dt. The step of most simulators: of
    first order, one evaluation of `forward_dynamics`; MuJoCo's Euler method, but for its friction, limits and contacts.
    `passive_forces` act. Damping and friction act implicitly, friction by its coefficient at the old rates: stable
    however stiff, and never a motor. Springs and limits act as they are at the start: stable for dt below 2 / w, of the
    largest natural frequency w = sqrt(stiffness / inertia), and dt limit_damping below the inertia. Where the mass
    matrix depends on q the step is not symplectic, and energy drifts in proportion to dt and the time: see
    `symplectic_step`.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        dt: the time, s: a number or (*batch,).
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        compliance: of friction and limits; None takes the default, see `Compliance`.
        precision: name of a precision; None takes the default.

    Returns:
        (q (*batch, nq), v (*batch, nv)) after the time dt, over the common batch; quaternions of unit length.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of rounding, per step, in the largest number: of v at most 2 u (|v| + dt |vdot|) and dt times that of
        `forward_dynamics`; of q that of `integrate` and dt times that of v. Of linear rates of "free" and "planar"
        joints 8 u (|v| + dt |vdot| + dt |w| |v|), in their 2-norm, and u |w dt| of that more beyond half a turn.
    Source: Hairer, Lubich, Wanner 2006, Geometric numerical integration, I.1.2; Todorov 2014, Convex and
        analytically-invertible dynamics with contacts and constraints (implicit damping).
    """
    q, v, tau, h = checked("semi_implicit_step", mechanism, q=q, v=v, tau=tau, dt=dt)
    tau = _with_springs_and_limits(mechanism, q, v, tau, compliance, precision)
    c = resistance(mechanism, v, compliance, precision)
    turning = transport(precision, mechanism, q, v) if _has_turning_axes(mechanism) else None
    accelerated = _accelerated if c is None or (c.ndim == 1 and h.ndim == 1) else _each_accelerated
    vdot = accelerated(mechanism, precision, (q, v, tau, turning), h, c, external_forces)
    if turning is None:
        after = _euler(precision, v, h, vdot)
        return integrate(mechanism, q, after, dt, precision=precision), after
    # Along the axes that there are at q.
    after = _euler(precision, v, h, _plus(precision, turning, vdot))
    return advance(precision, mechanism, q, after, dt)


def _has_turning_axes(mechanism: Mechanism):
    t = mechanism.topology
    return any(t.kind(i).turns_its_axes for i in range(len(t)))


def _with_springs_and_limits(
    mechanism: Mechanism, q: Checked, v: Checked, tau: Checked, compliance: Compliance | None, precision: PrecisionName
) -> Checked:
    forces = acting(mechanism, q, v, compliance, precision, with_resistance=False)
    return tau if forces is None else _plus(precision, tau, forces)


def _accelerated(
    mechanism: Mechanism, precision: PrecisionName, at: At, h: jax.Array, c: jax.Array | None, forces: ExternalForces
) -> jax.Array:
    """dv/dt that leads to rates at which the resistance -c v acts."""
    q, v, tau, turning = at
    if c is not None:
        # (M + h c) dv/dt = tau - c v - ...: as if the rotors had the inertia h c more. v is what the rates would be
        # after the time without dv/dt.
        armature = jnp.asarray(mechanism.armature, c.dtype) + h * c
        still = v if turning is None else _euler(precision, v, h, turning)
        tau, mechanism = _damped(precision, tau, c, still), mechanism.replace(armature=armature)
    return forward_dynamics(mechanism, q, v, tau, forces, precision=precision)


def _each_accelerated(
    mechanism: Mechanism, precision: PrecisionName, at: At, h: jax.Array, c: Checked, forces: ExternalForces
) -> jax.Array:
    """Over a batch with a resistance, or a time, for each."""
    leaves, tree = cast(tuple[list[Any], PyTreeDef], jax.tree.flatten((at, h, c, forces)))
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in leaves))
    function = functools.partial(_accelerated, mechanism, precision)
    for _ in batch:
        function = jax.vmap(function)
    return function(*jax.tree.unflatten(tree, check.broadcast_batch(batch, *leaves)))


def symplectic_step(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    tau: Forces,
    dt: Scalar,
    external_forces: ExternalForces = None,
    *,
    iterations: int = 5,
    compliance: Compliance | None = None,
    precision: PrecisionName = None,
) -> tuple[jax.Array, jax.Array]:
    """A step of the variational Euler method: q moves by the new v, the rates of this step.

    Of first order. It is the exact motion of a discrete action, the sum of dt T(q, v) - dt V(q), with the energy of
    springs in V. Without damping, friction and forces that change or take power, the energy stays within bounds in
    proportion to dt, over any number of steps, and so do momenta. `passive_forces` act as in `semi_implicit_step`.
    v are the rates of the screw motion that led to q: a linear velocity of what spins points where it did half a step
    before.
    About five times the work of the other steps.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        dt: the time, s: a number or (*batch,). The same at every step.
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        iterations: of the equation for v, which is quadratic. Each takes the error down by dt |v| times a number
            between 1 and about the condition of the mass matrix.
        compliance: of friction and limits; None takes the default, see `Compliance`.
        precision: name of a precision; None takes the default.

    Returns:
        (q (*batch, nq), v (*batch, nv)) after the time dt, over the common batch; quaternions of unit length.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of rounding, per step, in the largest number: of v at most 8 n u c (|v| + dt |vdot|), for n links one behind
        the other and c the condition of the mass matrix, in every precision; of q that of `integrate` and dt times that
        of v. The remainder of the iteration comes on top.
    Source: Marsden, West 2001, Discrete mechanics and variational integrators, 1.1 to 1.4; Lee, Leok, McClamroch 2007,
        Lie group variational integrators for the full body problem.
    """
    *at, h = checked("symplectic_step", mechanism, q=q, v=v, tau=tau, dt=dt)
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in at), h.shape[:-1])
    q, v, tau, h = (jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in (*at, h))
    tau = _with_springs_and_limits(mechanism, q, v, tau, compliance, precision)
    damping = resistance(mechanism, v, compliance, precision)
    return variational_step(mechanism, q, v, tau, h, damping, external_forces, iterations, precision)


def rk4_step(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    tau: Forces,
    dt: Scalar,
    external_forces: ExternalForces = None,
    *,
    compliance: Compliance | None = None,
    precision: PrecisionName = None,
) -> tuple[jax.Array, jax.Array]:
    """A step of the classical Runge-Kutta method of fourth order.

    tau and the external forces stay during the step. It steps the coordinates as they are; quaternions are brought back
    to unit length at the end. Linear rates of "free" and "planar" joints turn with their axes: stable for dt |w| below
    2.8, and what spins keeps its speed to (dt |w|)^6 / 144 per step. `passive_forces` act explicitly: stable for dt
    below 2.8 inertia / c, where c is damping and friction_loss / friction_speed. Where friction or a limit sets in, the
    step is of first order.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        dt: the time, s: a number or (*batch,).
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        compliance: of friction and limits; None takes the default, see `Compliance`.
        precision: name of a precision; None takes the default.

    Returns:
        (q (*batch, nq), v (*batch, nv)) after the time dt, over the common batch; quaternions of unit length.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of rounding, per step, in the largest number: of v at most 4 u (|v| + dt |vdot|) and dt times that of
        `forward_dynamics`, with vdot the largest of the four; of q 4 u (|q| + dt |dq/dt|) and dt times that of v. In
        "compensated" and "faithful" the stages between are rounded to the dtype.
    Source: Hairer, Norsett, Wanner 1993, Solving ordinary differential equations I, II.1.
    """
    q, v, tau, h = checked("rk4_step", mechanism, q=q, v=v, tau=tau, dt=dt)

    def rate(q: Array, v: Array) -> tuple[jax.Array, jax.Array]:
        passive = acting(mechanism, q, v, compliance, precision)
        forces = tau if passive is None else _plus(precision, tau, passive)
        vdot = forward_dynamics(mechanism, q, v, forces, external_forces, precision=precision)
        return configuration_rates(mechanism, q, v, precision=precision), vdot

    q, v = _runge_kutta(precision, rate, (q, v), h)
    nowhere = np.zeros(mechanism.nv, q.dtype)
    return integrate(mechanism, q, nowhere, precision=precision), v


def _runge_kutta(
    precision: PrecisionName, rate: Callable[..., tuple[jax.Array, jax.Array]], x: tuple[Checked, Checked], h: jax.Array
) -> tuple[jax.Array, ...]:
    k = [rate(*x)]
    for share in (0.5, 0.5, 1.0):
        ahead = (_euler(precision, a, h * h.dtype.type(share), b) for a, b in zip(x, k[-1], strict=True))
        k.append(rate(*ahead))
    return tuple(_rk4_mean(precision, a, h, *rates) for a, *rates in zip(x, *k, strict=True))


@formula
def _euler(x: Numbers, dt: Numbers, rate: Numbers):
    return tuple(a + dt[0] * b for a, b in zip(x, rate, strict=True))


@formula
def _rk4_mean(x: Numbers, dt: Numbers, *rates: Numbers):
    def one(a: Number, k1: Number, k2: Number, k3: Number, k4: Number):
        return a + dt[0] * ((k1 + k4) + doubled(k2 + k3)) / 6

    return tuple(one(a, *k) for a, *k in zip(x, *rates, strict=True))


@formula
def _plus(a: Numbers, b: Numbers):
    return tuple(x + y for x, y in zip(a, b, strict=True))


@formula
def _damped(tau: Numbers, damping: Numbers, v: Numbers):
    return tuple(t - d * x for t, d, x in zip(tau, damping, v, strict=True))
