"""Steps in time."""

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.dynamics.configuration import configuration_rates, integrate
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.scene import checked


def symplectic_step(mechanism, q, v, tau, dt, external_forces=None, *, precision=None):
    """(q, v) after the time dt, by the semi-implicit Euler method: the new rates move the configuration.

    mechanism: Mechanism; q (*batch, nq), v and tau (*batch, nv), dt a number or (*batch,), s; external_forces: see
    `forward_dynamics`
    Of first order; energy stays within bounds that shrink with dt, over any number of steps. `Mechanism.damping` acts,
    implicitly: stable however stiff it is. Friction and limits do not. [Hairer, Lubich, Wanner 2006, I.1.2; Todorov
    2014, for the damping]
    """
    q, v, tau, dt = _checked("symplectic_step", mechanism, q, v, tau, dt)
    damping = jnp.asarray(mechanism.damping, q.dtype) if _is_damped(mechanism) else None
    if damping is not None:
        tau, mechanism = tau - damping * v, _stiffened(mechanism, damping, dt)
    vdot = forward_dynamics(mechanism, q, v, tau, external_forces, precision=precision)
    v = v + dt[..., None] * vdot
    return integrate(mechanism, q, v, dt, precision=precision), v


def rk4_step(mechanism, q, v, tau, dt, external_forces=None, *, precision=None):
    """(q, v) after the time dt, by the classical Runge-Kutta method of fourth order.

    mechanism, q, v, tau, dt, external_forces: as of `symplectic_step`. tau and the forces stay during the step. On the
    coordinates as they are; quaternions are brought back to unit length at the end. `Mechanism.damping` acts, friction
    and limits do not. [Hairer, Norsett, Wanner 1993, II.1]
    """
    q, v, tau, dt = _checked("rk4_step", mechanism, q, v, tau, dt)
    damping = jnp.asarray(mechanism.damping, q.dtype) if _is_damped(mechanism) else None

    def rate(q, v):
        forces = tau if damping is None else tau - damping * v
        vdot = forward_dynamics(mechanism, q, v, forces, external_forces, precision=precision)
        return configuration_rates(mechanism, q, v, precision=precision), vdot

    q, v = _runge_kutta(rate, (q, v), dt[..., None])
    nowhere = np.zeros(mechanism.nv, q.dtype)
    return integrate(mechanism, q, nowhere, precision=precision), v


def _runge_kutta(rate, x, dt):
    def ahead(share, k):
        return tuple(a + dt * (b * b.dtype.type(share)) for a, b in zip(x, k, strict=True))

    k1 = rate(*x)
    k2 = rate(*ahead(0.5, k1))
    k3 = rate(*ahead(0.5, k2))
    k4 = rate(*ahead(1, k3))
    return tuple(a + dt * ((p + 2 * q + 2 * r + s) / 6) for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True))


def _checked(operation, mechanism, q, v, tau, dt):
    q, v, tau = checked(operation, mechanism, q=q, v=v, tau=tau)
    dt = check.as_float_array(dt, f"{operation}: dt", q.dtype)
    check.require_same_dtype(q=q, dt=dt)
    return q, v, tau, dt


def _is_damped(mechanism):
    """Whether damping is anything but zeros known while tracing."""
    return not (isinstance(mechanism.damping, np.ndarray) and not mechanism.damping.any())


def _stiffened(mechanism, damping, dt):
    """A mechanism whose inertia is M + dt D."""
    if dt.ndim:
        raise ValueError("symplectic_step: dt: expected a number for a mechanism with damping; vmap over others")
    return mechanism.replace(armature=jnp.asarray(mechanism.armature, damping.dtype) + dt * damping)
