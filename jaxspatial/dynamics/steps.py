"""Steps in time."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers import doubled, numeric
from jaxspatial.dynamics.configuration import configuration_rates, difference, integrate
from jaxspatial.dynamics.energy import kinetic_energy
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import bias_forces
from jaxspatial.dynamics.mass_matrix import factored, mass_matrix
from jaxspatial.dynamics.algorithm import checked


def semi_implicit_step(mechanism, q, v, tau, dt, external_forces=None, *, precision=None):
    """(q, v) after the time dt, by the semi-implicit Euler method: the new rates move the configuration.

    mechanism: Mechanism; q (*batch, nq), v and tau (*batch, nv), dt a number or (*batch,), s; external_forces: see
    `forward_dynamics`
    The step of most simulators: of first order, one evaluation of `forward_dynamics`. `Mechanism.damping` acts,
    implicitly: stable however stiff it is. Friction and limits do not. Where the mass matrix depends on q it is not
    symplectic, and energy drifts in proportion to dt and the time: see `symplectic_step`. [Todorov 2014]
    """
    q, v, tau, dt = _checked("semi_implicit_step", mechanism, q, v, tau, dt)
    damping = _damping(mechanism, q)
    if damping is not None:
        tau, mechanism = _damped(precision, tau, damping, v), _stiffened(mechanism, damping, dt)
    vdot = forward_dynamics(mechanism, q, v, tau, external_forces, precision=precision)
    v = _ahead(precision, v, dt[..., None], vdot)
    return integrate(mechanism, q, v, dt, precision=precision), v


def symplectic_step(mechanism, q, v, tau, dt, external_forces=None, *, iterations=5, precision=None):
    """(q, v) after the time dt, by the variational Euler method: q moves by the new v, the rates of this step.

    mechanism, q, v, tau, dt, external_forces: as of `semi_implicit_step`; dt the same at every step. Of first order.
    It is the exact motion of a discrete action, the sum of dt T(q, v) - dt V(q): without damping, forces that change
    or take power, the energy stays within bounds in proportion to dt, over any number of steps, and so do momenta.
    iterations: the new momentum depends on v, quadratically; each of them takes the error down by dt times the size
        of v. Chosen for dt |v| up to 0.01 in float64; 2 do in float32.
    `Mechanism.damping` acts, implicitly; friction and limits do not. About five times the work of the other steps.
    [Marsden, West 2001, Discrete mechanics and variational integrators, 1.1 to 1.4; Lee, Leok, McClamroch 2007]
    """
    q, v, tau, dt = _checked("symplectic_step", mechanism, q, v, tau, dt)
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in (q, v, tau)), dt.shape)
    q, v, tau, h = (jnp.broadcast_to(x, (*batch, x.shape[-1])) for x in (q, v, tau, dt[..., None]))
    apart, dt, damping = _moved(mechanism, precision), h[..., 0], _damping(mechanism, q)
    damping = None if damping is None else h * jnp.broadcast_to(damping, v.shape)
    before = integrate(mechanism, q, v, -dt, precision=precision)
    momentum = apart(before, q, dt)[1] + h * (tau - _static(mechanism, q, external_forces, precision))
    M = mass_matrix(mechanism, q, precision=precision)
    factor = factored(M if damping is None else M + _diagonal(damping))

    def nearer(_, v):
        left = momentum + apart(q, integrate(mechanism, q, v, dt, precision=precision), dt)[0]
        return v + factor.solve(left if damping is None else left - damping * v)

    v = jax.lax.fori_loop(0, iterations, nearer, v)
    return integrate(mechanism, q, v, dt, precision=precision), v


def _diagonal(x):
    """(*batch, n, n)."""
    is_diagonal = jnp.broadcast_to(jnp.eye(x.shape[-1], dtype=bool), (*x.shape, x.shape[-1]))
    return jnp.where(is_diagonal, jnp.broadcast_to(x[..., None], is_diagonal.shape), 0)


def _moved(mechanism, precision):
    """(q, next, dt) -> the derivatives of the kinetic action dt T(q, (next - q) / dt) by motions of q and of next."""

    def action(q, following, dt):
        v = difference(mechanism, q, following, precision=precision) / dt[..., None]
        return (dt * kinetic_energy(mechanism, q, v, precision=precision)).sum()

    def derivatives(q, following, dt):
        found = jax.grad(action, (0, 1))(q, following, dt)
        return [_along(mechanism, x, g, precision) for x, g in zip((q, following), found, strict=True)]

    return derivatives


def _along(mechanism, q, gradient, precision):
    """The derivative by rates, of one by coordinates."""
    rates = functools.partial(configuration_rates, mechanism, q, precision=precision)
    (found,) = jax.vjp(rates, jnp.zeros((*q.shape[:-1], mechanism.nv), q.dtype))[1](gradient)
    return found


def _static(mechanism, q, external_forces, precision):
    """g(q) - J^T F."""
    nothing = np.zeros(mechanism.nv, q.dtype)
    return bias_forces(mechanism, q, nothing, external_forces, precision=precision)


def rk4_step(mechanism, q, v, tau, dt, external_forces=None, *, precision=None):
    """(q, v) after the time dt, by the classical Runge-Kutta method of fourth order.

    mechanism, q, v, tau, dt, external_forces: as of `semi_implicit_step`. tau and the forces stay during the step. On
    the coordinates as they are; quaternions are brought back to unit length at the end. `Mechanism.damping` acts,
    friction and limits do not. [Hairer, Norsett, Wanner 1993, II.1]
    """
    q, v, tau, dt = _checked("rk4_step", mechanism, q, v, tau, dt)
    damping = _damping(mechanism, q)

    def rate(q, v):
        forces = tau if damping is None else _damped(precision, tau, damping, v)
        vdot = forward_dynamics(mechanism, q, v, forces, external_forces, precision=precision)
        return configuration_rates(mechanism, q, v, precision=precision), vdot

    q, v = _runge_kutta(precision, rate, (q, v), dt[..., None])
    nowhere = np.zeros(mechanism.nv, q.dtype)
    return integrate(mechanism, q, nowhere, precision=precision), v


def _runge_kutta(precision, rate, x, dt):
    k = [rate(*x)]
    for share in (0.5, 0.5, 1.0):
        ahead = (_ahead(precision, a, dt * dt.dtype.type(share), b) for a, b in zip(x, k[-1], strict=True))
        k.append(rate(*ahead))
    return tuple(_mean_ahead(precision, a, dt, *rates) for a, *rates in zip(x, *k, strict=True))


@numeric
def _ahead(x, dt, rate):
    return tuple(a + dt[0] * b for a, b in zip(x, rate, strict=True))


@numeric
def _mean_ahead(x, dt, *rates):
    def one(a, k1, k2, k3, k4):
        return a + dt[0] * ((k1 + k4) + doubled(k2 + k3)) / 6

    return tuple(one(a, *k) for a, *k in zip(x, *rates, strict=True))


@numeric
def _damped(tau, damping, v):
    return tuple(t - d * x for t, d, x in zip(tau, damping, v, strict=True))


def _checked(operation, mechanism, q, v, tau, dt):
    q, v, tau = checked(operation, mechanism, q=q, v=v, tau=tau)
    dt = check.as_float_array(dt, f"{operation}: dt", q.dtype)
    check.require_same_dtype(q=q, dt=dt)
    return q, v, tau, dt


def _damping(mechanism, q):
    """None for zeros known while tracing."""
    is_none = isinstance(mechanism.damping, np.ndarray) and not mechanism.damping.any()
    return None if is_none else jnp.asarray(mechanism.damping, q.dtype)


def _stiffened(mechanism, damping, dt):
    """A mechanism whose inertia is M + dt D."""
    if dt.ndim:
        raise ValueError("semi_implicit_step: dt: expected a number for a mechanism with damping; vmap over others")
    return mechanism.replace(armature=jnp.asarray(mechanism.armature, damping.dtype) + dt * damping)
