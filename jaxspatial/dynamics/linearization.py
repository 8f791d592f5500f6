"""Derivatives of inverse and forward dynamics with respect to configuration, velocities, accelerations and forces."""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.composite_bodies import factored, solver
from jaxspatial.dynamics.configuration import integrate
from jaxspatial.dynamics.derivatives import derivatives
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics
from jaxspatial.engine.algorithm import ExternalForces, checked, checked_mechanism
from jaxspatial.engine.composite import composite
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, PrecisionName

Scene = tuple[Mechanism]


@exported
class InverseDynamicsDerivatives(NamedTuple):
    """(*batch, nv, nv) each: rows are generalized forces, columns velocities. dtau_dvdot is the mass matrix.

    Example:
        >>> found = js.inverse_dynamics_derivatives(arm, q, v, jnp.zeros(2))
        >>> print(found.dtau_dvdot)  # as `mass_matrix`
        [[5.2935 1.6467]
         [1.6467 0.6667]]
    """

    dtau_dq: jax.Array
    dtau_dv: jax.Array
    dtau_dvdot: jax.Array


@exported
class ForwardDynamicsDerivatives(NamedTuple):
    """(*batch, nv, nv) each: rows are accelerations, columns velocities. dvdot_dtau is the inverse mass matrix.

    Example:
        >>> found = js.forward_dynamics_derivatives(arm, q, v, tau)
        >>> found.dvdot_dq.shape, found.dvdot_dv.shape
        ((2, 2), (2, 2))
    """

    dvdot_dq: jax.Array
    dvdot_dv: jax.Array
    dvdot_dtau: jax.Array


@promises(bound=ALGORITHM)
def inverse_dynamics_derivatives(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    vdot: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> InverseDynamicsDerivatives:
    """The derivatives of `inverse_dynamics` with respect to configuration, velocities and accelerations.

    dtau_dq is the derivative with respect to the step of `integrate(mechanism, q, step)`, at zero, with the numbers of
    v and vdot fixed. It equals the derivative by q for joints with as many coordinates as velocities, except "planar".
    For a product with one vector `jax.jvp` or `jax.vjp` of `inverse_dynamics` is faster, several times for a humanoid.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        vdot: (*batch, nv) generalized accelerations: rad/s^2, m/s^2.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        precision: name of a precision; None takes the default.

    Returns:
        InverseDynamicsDerivatives, (*batch, nv, nv) each.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Singh, Russell, Wensing 2022, Efficient analytical derivatives of rigid-body dynamics using spatial vector
        algebra.

    Example:
        >>> found = js.inverse_dynamics_derivatives(arm, q, v, jnp.zeros(2))
        >>> print(found.dtau_dq)
        [[35.1991  8.1468]
         [ 9.3719 10.3519]]
    """
    operation = "inverse_dynamics_derivatives"
    if checked_mechanism(operation, mechanism).topology.has_subspaces_of_q:
        q, v, vdot, forces = checked(operation, mechanism, q=q, v=v, vdot=vdot, external_forces=external_forces)
        return _column_by_column(mechanism, q, v, vdot, forces, precision)
    return InverseDynamicsDerivatives(
        *derivatives(precision, mechanism, q, v, vdot, external_forces, operation=operation)
    )


def _column_by_column(mechanism: Mechanism, q, v, vdot, forces, precision: PrecisionName) -> InverseDynamicsDerivatives:
    """The derivatives of `inverse_dynamics` as JAX takes them: where S depends on q there is no closed form."""

    at = jnp.zeros_like(v), v, vdot

    def torques(k: int, x: jax.Array) -> jax.Array:
        step, v, vdot = (x if i == k else y for i, y in enumerate(at))
        moved = integrate(mechanism, q, step, precision=precision)
        return inverse_dynamics(mechanism, moved, v, vdot, forces, precision=precision)

    def column(k: int, unit: jax.Array) -> jax.Array:
        along = jnp.broadcast_to(unit, at[k].shape)
        return jax.jvp(functools.partial(torques, k), (jnp.asarray(at[k]),), (along,))[1]

    units = jnp.eye(mechanism.nv, dtype=q.dtype)
    parts = (jax.vmap(functools.partial(column, k), out_axes=-1)(units) for k in range(3))
    return InverseDynamicsDerivatives(*parts)


def forward_dynamics_derivatives(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> ForwardDynamicsDerivatives:
    """The derivatives of `forward_dynamics` with respect to configuration, velocities and forces.

        dvdot_dq = -M^-1 dtau_dq        dvdot_dv = -M^-1 dtau_dv        dvdot_dtau = M^-1

    The derivatives of inverse dynamics are taken at the accelerations of `forward_dynamics`. M is factored in the dtype
    of q (float32 for 16-bit types) in every precision. It is one program; for a chain of more than 28 joints a library
    factors M instead. For a product with one vector `jax.jvp` or `jax.vjp` of `forward_dynamics` is faster, several
    times for a humanoid.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        precision: name of a precision; None takes the default.

    Returns:
        ForwardDynamicsDerivatives, (*batch, nv, nv) each, dvdot_dq as in `inverse_dynamics_derivatives`; NaN if
        some velocity has no inertia, at least for all velocities of its tree.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every column as of `MassMatrixFactor.solve`, in addition to the inverse times the error of
        `inverse_dynamics_derivatives` at the accelerations of `forward_dynamics`.
    Source: Carpentier, Mansard 2018, Analytical derivatives of rigid body dynamics algorithms.

    Example:
        >>> found = js.forward_dynamics_derivatives(arm, q, v, tau)
        >>> print(found.dvdot_dtau)
        [[ 0.8157 -2.015 ]
         [-2.015   6.4772]]
    """
    operation = "forward_dynamics_derivatives"
    q, v, tau, forces = checked(operation, mechanism, q=q, v=v, tau=tau, external_forces=external_forces)
    at: Any = resolve(precision), (mechanism,), q, v, tau, forces
    if not mechanism.nv:
        return ForwardDynamicsDerivatives(*_at_accelerations(*at))
    sizes = map(len, mechanism.topology.velocity_carriers)
    is_short = sum(n * (n + 1) // 2 for n in sizes) <= _MOST_PRODUCTS
    derivatives_of = _forward_dynamics_derivatives if is_short else _derivatives_of_many_velocities
    return ForwardDynamicsDerivatives(*derivatives_of(*at))


# The products of one factorisation that are written out, one by one, in a program of machine code: more take longer to
# compile than they save. A humanoid of 35 velocities has 1,742; a chain of 28 joints has 3,654.
_MOST_PRODUCTS = 4000


@composite
def _forward_dynamics_derivatives(precision: Precision, scene: Scene, q, v, tau, forces) -> tuple[jax.Array, ...]:
    dq, dv, M = _at_accelerations(precision, scene, q, v, tau, forces)
    solve = solver(scene[0].topology, M, precision)
    return -solve(dq), -solve(dv), solve(jnp.eye(*M.shape, dtype=M.dtype))


def _derivatives_of_many_velocities(precision: Precision, scene: Scene, q, v, tau, forces) -> tuple[jax.Array, ...]:
    """By a library's Cholesky method."""
    dq, dv, M = _at_accelerations(precision, scene, q, v, tau, forces)
    inverse = factored(M).inverse()
    times = functools.partial(jnp.matmul, inverse, precision=lax.Precision.HIGHEST)
    return -times(dq), -times(dv), inverse


def _at_accelerations(precision: Precision, scene: Scene, q, v, tau, forces) -> InverseDynamicsDerivatives:
    (mechanism,) = scene
    vdot = forward_dynamics(mechanism, q, v, tau, forces, precision=precision)
    return inverse_dynamics_derivatives(mechanism, q, v, vdot, forces, precision=precision)
