"""Steps on the manifold of configurations: along motions, between configurations, and random ones."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.dynamics.algorithm import JOINTS, algorithm, checked
from jaxspatial.mechanism import Mechanism


def integrate(mechanism, q, v, dt=1.0, *, precision=None):
    """q (*batch, nq) after the rates v, constant in the axes of the bodies, for the time dt, s.

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv), dt a number or (*batch,)
    Follows the exponential of the rigid motion of each joint; quaternions come out of unit length. The inverse of
    `difference`. [Murray, Li, Sastry 1994, 2.36]
    """
    q, v = checked("integrate", mechanism, q=q, v=v)
    dt = check.as_float_array(dt, "integrate: dt", q.dtype)
    check.require_same_dtype(q=q, dt=dt)
    return _integrate(precision, mechanism, q, v, dt[..., None])


def difference(mechanism, q0, q1, *, precision=None):
    """The rates (*batch, nv) that in unit time lead from q0 to q1, the short way round: `integrate(q0, v) = q1`.

    mechanism: Mechanism; q0 and q1 (*batch, nq). At half a turn between orientations see `Rotation.log`.
    """
    q0, q1 = checked("difference", mechanism, q0=q0, q1=q1)
    return _difference(precision, mechanism, q0, q1)


def interpolate(mechanism, q0, q1, t, *, precision=None):
    """`integrate(q0, t difference(q0, q1))`: at constant rates from q0, t = 0, to q1, t = 1. t: number or (*batch,)."""
    return integrate(mechanism, q0, difference(mechanism, q0, q1, precision=precision), t, precision=precision)


def configuration_rates(mechanism, q, v, *, precision=None):
    """dq/dt (*batch, nq) of rates v: for solvers that step q as an array, and its tangent along v.

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv). Of a quaternion q (0, w) / 2, which keeps its length.
    """
    q, v = checked("configuration_rates", mechanism, q=q, v=v)
    return _configuration_rates(precision, mechanism, q, v)


def random_configuration(mechanism, key, batch_shape=(), dtype=None):
    """q (*batch, nq): within the limits where there are two, angles else within half a turn, lengths within 1 m of
    zero, orientations uniform.

    mechanism: Mechanism; key: of jax.random; dtype: that of the mechanism for None
    """
    if not isinstance(mechanism, Mechanism):
        raise TypeError(f"random_configuration: expected a Mechanism first, got {type(mechanism).__name__}")
    dtype = np.dtype(dtype or mechanism.dtype)
    batch_shape = (batch_shape,) if isinstance(batch_shape, int) else tuple(batch_shape)
    t = mechanism.topology
    parts = [
        _random(mechanism, i, k, batch_shape, dtype)
        for i, k in enumerate(jax.random.split(key, len(t)))
        if not t.is_mimic(i)
    ]
    return jnp.concatenate(parts, -1)


@algorithm(*JOINTS)
def _integrate(state, v, dt):
    """Each joint on its own: those of one kind side by side."""
    (dt,) = state.numbers(dt)
    found = [own.apply("integrate", tuple(x * dt for x in own.rates(v))) for own in state.kind_states]
    return state.by_coordinate(found, state.topology.joints_by_kind)


@algorithm(*JOINTS)
def _configuration_rates(state, v):
    return state.by_coordinate([own.dq_dt(v) for own in state.kind_states], state.topology.joints_by_kind)


@algorithm(*JOINTS)
def _difference(state, q1):
    found = [own.apply("difference", own.coordinates(q1)) for own in state.kind_states]
    return state.by_rate(found, state.topology.joints_by_kind)


def _random(mechanism, i, key, batch_shape, dtype):
    kind, own = mechanism.topology.kind(i), mechanism.topology.q_slice(i)
    lower, upper = (jnp.asarray(x[own], dtype) for x in (mechanism.lower, mechanism.upper))
    return kind.random(key, lower, upper, batch_shape)
