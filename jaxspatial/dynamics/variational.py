"""The variational Euler method: the step that solves the discrete Euler-Lagrange equation.

[Marsden, West 2001, Discrete mechanics and variational integrators, 1.1 to 1.4]
"""

import functools
from collections.abc import Callable
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.dynamics.arguments import ExternalForces
from jaxspatial.dynamics.configuration import configuration_rates, difference, integrate
from jaxspatial.dynamics.energy import kinetic_energy
from jaxspatial.dynamics.inverse_dynamics import bias_forces
from jaxspatial.dynamics.mass_matrix import factored, mass_matrix
from jaxspatial.dynamics.tangents import pullback
from jaxspatial.mechanism import Mechanism

Two = tuple[jax.Array, jax.Array]


def variational_step(
    mechanism: Mechanism,
    q: jax.Array,
    v: jax.Array,
    tau: Any,
    h: jax.Array,
    damping: jax.Array | None,
    external_forces: ExternalForces,
    iterations: int,
    precision: PrecisionName,
) -> tuple[jax.Array, jax.Array]:
    """(q, v) after the time h (*batch, 1), under forces tau and the resistance -damping v, None for none."""
    derivatives, dt = _action_derivatives(mechanism, precision), h[..., 0]
    damping = None if damping is None else h * jnp.broadcast_to(damping, v.shape)
    before = integrate(mechanism, q, v, -dt, precision=precision)
    momentum = derivatives(before, q, v, dt)[1] + h * (tau - _static(mechanism, q, external_forces, precision))
    M = mass_matrix(mechanism, q, precision=precision)
    factor = factored(M if damping is None else M + _diagonal(damping))

    def nearer(_: jax.Array, v: jax.Array) -> jax.Array:
        left = momentum + derivatives(q, integrate(mechanism, q, v, dt, precision=precision), v, dt)[0]
        return v + factor.solve(left if damping is None else left - damping * v)

    v = cast(jax.Array, jax.lax.fori_loop(0, iterations, nearer, v))
    return integrate(mechanism, q, v, dt, precision=precision), v


def _diagonal(x: jax.Array):
    """(*batch, n, n)."""
    is_diagonal = jnp.broadcast_to(jnp.eye(x.shape[-1], dtype=bool), (*x.shape, x.shape[-1]))
    return jnp.where(is_diagonal, jnp.broadcast_to(x[..., None], is_diagonal.shape), 0)


def _action_derivatives(mechanism: Mechanism, precision: PrecisionName) -> Callable[..., list[jax.Array]]:
    """(q, next, v, dt) -> the derivatives of the kinetic action dt T(q, (next - q) / dt) by motions of q and of next.

    v is (next - q) / dt before next is rounded: the difference, divided by dt, would have an error of u |q| / dt.
    """

    def energy(q: jax.Array, v: jax.Array):
        return kinetic_energy(mechanism, q, v, precision=precision).sum()

    def derivatives(q: jax.Array, following: jax.Array, v: jax.Array, dt: jax.Array) -> list[jax.Array]:
        of_q, momentum = cast(Two, jax.grad(energy, (0, 1))(q, v))
        of_motions = pullback(functools.partial(difference, mechanism, precision=precision), q, following)
        by_q, by_following = of_motions(momentum)
        both = (q, dt[..., None] * of_q + by_q), (following, by_following)
        return [_by_rates(mechanism, x, by_x, precision) for x, by_x in both]

    return derivatives


def _by_rates(mechanism: Mechanism, q: jax.Array, gradient: jax.Array, precision: PrecisionName) -> jax.Array:
    """The derivative by rates, of one by coordinates."""
    rates = functools.partial(configuration_rates, mechanism, q, precision=precision)
    return pullback(rates, jnp.zeros((*q.shape[:-1], mechanism.nv), q.dtype))(gradient)[0]


def _static(mechanism: Mechanism, q: jax.Array, external_forces: ExternalForces, precision: PrecisionName) -> jax.Array:
    """g(q) - J^T F."""
    nothing = np.zeros(mechanism.nv, q.dtype)
    return bias_forces(mechanism, q, nothing, external_forces, precision=precision)
