"""Steps in time."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers import doubled, numeric
from jaxspatial.dynamics.algorithm import checked
from jaxspatial.dynamics.configuration import configuration_rates, difference, integrate
from jaxspatial.dynamics.energy import kinetic_energy
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import bias_forces
from jaxspatial.dynamics.mass_matrix import factored, mass_matrix
from jaxspatial.dynamics.passive import acting, resistance


def semi_implicit_step(mechanism, q, v, tau, dt, external_forces=None, *, compliance=None, precision=None):
    """(q, v) after the time dt, by the semi-implicit Euler method: q is integrated with the new v.

    mechanism: Mechanism; q (*batch, nq), v and tau (*batch, nv), dt a number or (*batch,), s; external_forces: see
    `forward_dynamics`; compliance: of friction and limits, see `Compliance`
    The step of most simulators: of first order, one evaluation of `forward_dynamics`. What `passive_forces` has acts.
    Damping and friction do implicitly, friction by its coefficient at the old rates: stable however stiff, and never
    a motor. Springs and limits act as they are at the start: stable for dt below 2 / w, of the largest natural
    frequency w = sqrt(stiffness / inertia), and dt limit_damping below the inertia. Where the mass matrix depends on q
    the step is not symplectic, and energy drifts in proportion to dt and the time: see `symplectic_step`.
    [Todorov 2014]
    """
    q, v, tau, dt = _checked("semi_implicit_step", mechanism, q, v, tau, dt)
    tau = _with_springs_and_limits(mechanism, q, v, tau, compliance, precision)
    c = resistance(mechanism, v, compliance, precision)
    accelerated = _accelerated if c is None or (c.ndim == 1 and not dt.ndim) else _each_accelerated
    vdot = accelerated(mechanism, precision, q, v, tau, dt, c, external_forces)
    v = _euler(precision, v, dt[..., None], vdot)
    return integrate(mechanism, q, v, dt, precision=precision), v


def _with_springs_and_limits(mechanism, q, v, tau, compliance, precision):
    forces = acting(mechanism, q, v, compliance, precision, with_resistance=False)
    return tau if forces is None else _plus(precision, tau, forces)


def _accelerated(mechanism, precision, q, v, tau, dt, c, external_forces):
    """dv/dt that leads to rates at which the resistance -c v acts."""
    if c is not None:
        # (M + dt c) dv/dt = tau - c v - ...: as if the rotors had the inertia dt c more.
        armature = jnp.asarray(mechanism.armature, c.dtype) + dt * c
        tau, mechanism = _damped(precision, tau, c, v), mechanism.replace(armature=armature)
    return forward_dynamics(mechanism, q, v, tau, external_forces, precision=precision)


def _each_accelerated(mechanism, precision, q, v, tau, dt, c, external_forces):
    """Over a batch with a resistance, or a time, for each."""
    given = q, v, tau, dt[..., None], c
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in (*given, *jax.tree.leaves(external_forces))))
    *given, dt, c = check.broadcast_batch(batch, *given)
    forces = jax.tree.map(lambda x: jnp.broadcast_to(x, (*batch, x.shape[-1])), external_forces)
    function = functools.partial(_accelerated, mechanism, precision)
    for _ in batch:
        function = jax.vmap(function)
    return function(*given, dt[..., 0], c, forces)


def symplectic_step(mechanism, q, v, tau, dt, external_forces=None, *, iterations=5, compliance=None, precision=None):
    """(q, v) after the time dt, by the variational Euler method: q moves by the new v, the rates of this step.

    mechanism, q, v, tau, dt, external_forces, compliance: as of `semi_implicit_step`; dt the same at every step. Of
    first order. It is the exact motion of a discrete action, the sum of dt T(q, v) - dt V(q), the energy of springs in
    V: without damping, friction, forces that change or take power, the energy stays within bounds in proportion to dt,
    over any number of steps, and so do momenta.
    iterations: the new momentum depends on v, quadratically; each of them takes the error down by dt times the size
        of v. Chosen for dt |v| up to 0.01 in float64; 2 do in float32.
    What `passive_forces` has acts, as in `semi_implicit_step`. About five times the work of the other steps.
    [Marsden, West 2001, Discrete mechanics and variational integrators, 1.1 to 1.4; Lee, Leok, McClamroch 2007]
    """
    q, v, tau, dt = _checked("symplectic_step", mechanism, q, v, tau, dt)
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in (q, v, tau)), dt.shape)
    q, v, tau, h = (jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, v, tau, dt[..., None]))
    tau = _with_springs_and_limits(mechanism, q, v, tau, compliance, precision)
    derivatives, dt, damping = (
        _action_derivatives(mechanism, precision),
        h[..., 0],
        resistance(mechanism, v, compliance, precision),
    )
    damping = None if damping is None else h * jnp.broadcast_to(damping, v.shape)
    before = integrate(mechanism, q, v, -dt, precision=precision)
    momentum = derivatives(before, q, dt)[1] + h * (tau - _static(mechanism, q, external_forces, precision))
    M = mass_matrix(mechanism, q, precision=precision)
    factor = factored(M if damping is None else M + _diagonal(damping))

    def nearer(_, v):
        left = momentum + derivatives(q, integrate(mechanism, q, v, dt, precision=precision), dt)[0]
        return v + factor.solve(left if damping is None else left - damping * v)

    v = jax.lax.fori_loop(0, iterations, nearer, v)
    return integrate(mechanism, q, v, dt, precision=precision), v


def _diagonal(x):
    """(*batch, n, n)."""
    is_diagonal = jnp.broadcast_to(jnp.eye(x.shape[-1], dtype=bool), (*x.shape, x.shape[-1]))
    return jnp.where(is_diagonal, jnp.broadcast_to(x[..., None], is_diagonal.shape), 0)


def _action_derivatives(mechanism, precision):
    """(q, next, dt) -> the derivatives of the kinetic action dt T(q, (next - q) / dt) by motions of q and of next."""

    def action(q, following, dt):
        v = difference(mechanism, q, following, precision=precision) / dt[..., None]
        return (dt * kinetic_energy(mechanism, q, v, precision=precision)).sum()

    def derivatives(q, following, dt):
        found = jax.grad(action, (0, 1))(q, following, dt)
        return [_by_rates(mechanism, x, g, precision) for x, g in zip((q, following), found, strict=True)]

    return derivatives


def _by_rates(mechanism, q, gradient, precision):
    """The derivative by rates, of one by coordinates."""
    rates = functools.partial(configuration_rates, mechanism, q, precision=precision)
    (found,) = jax.vjp(rates, jnp.zeros((*q.shape[:-1], mechanism.nv), q.dtype))[1](gradient)
    return found


def _static(mechanism, q, external_forces, precision):
    """g(q) - J^T F."""
    nothing = np.zeros(mechanism.nv, q.dtype)
    return bias_forces(mechanism, q, nothing, external_forces, precision=precision)


def rk4_step(mechanism, q, v, tau, dt, external_forces=None, *, compliance=None, precision=None):
    """(q, v) after the time dt, by the classical Runge-Kutta method of fourth order.

    mechanism, q, v, tau, dt, external_forces, compliance: as of `semi_implicit_step`. tau and the forces stay during
    the step. On the coordinates as they are; quaternions are brought back to unit length at the end. What
    `passive_forces` has acts, explicitly: stable for dt below 2.8 inertia / c, where c is damping and friction_loss /
    friction_speed. Where friction or a limit sets in, the step is of first order.
    [Hairer, Norsett, Wanner 1993, II.1]
    """
    q, v, tau, dt = _checked("rk4_step", mechanism, q, v, tau, dt)

    def rate(q, v):
        passive = acting(mechanism, q, v, compliance, precision)
        forces = tau if passive is None else _plus(precision, tau, passive)
        vdot = forward_dynamics(mechanism, q, v, forces, external_forces, precision=precision)
        return configuration_rates(mechanism, q, v, precision=precision), vdot

    q, v = _runge_kutta(precision, rate, (q, v), dt[..., None])
    nowhere = np.zeros(mechanism.nv, q.dtype)
    return integrate(mechanism, q, nowhere, precision=precision), v


def _runge_kutta(precision, rate, x, dt):
    k = [rate(*x)]
    for share in (0.5, 0.5, 1.0):
        ahead = (_euler(precision, a, dt * dt.dtype.type(share), b) for a, b in zip(x, k[-1], strict=True))
        k.append(rate(*ahead))
    return tuple(_rk4_mean(precision, a, dt, *rates) for a, *rates in zip(x, *k, strict=True))


@numeric
def _euler(x, dt, rate):
    return tuple(a + dt[0] * b for a, b in zip(x, rate, strict=True))


@numeric
def _rk4_mean(x, dt, *rates):
    def one(a, k1, k2, k3, k4):
        return a + dt[0] * ((k1 + k4) + doubled(k2 + k3)) / 6

    return tuple(one(a, *k) for a, *k in zip(x, *rates, strict=True))


@numeric
def _plus(a, b):
    return tuple(x + y for x, y in zip(a, b, strict=True))


@numeric
def _damped(tau, damping, v):
    return tuple(t - d * x for t, d, x in zip(tau, damping, v, strict=True))


def _checked(operation, mechanism, q, v, tau, dt):
    q, v, tau = checked(operation, mechanism, q=q, v=v, tau=tau)
    dt = check.as_float_array(dt, f"{operation}: dt", q.dtype)
    check.require_same_dtype(q=q, dt=dt)
    return q, v, tau, dt
