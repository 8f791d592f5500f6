"""Inverse and forward dynamics linearised: their derivatives by coordinates, rates, accelerations and forces."""

from typing import NamedTuple

import jax

from jaxspatial.arithmetic.types import Coordinates, Forces, PrecisionName, Rates
from jaxspatial.dynamics.arguments import ExternalForces
from jaxspatial.dynamics.derivatives import derivatives
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.mass_matrix import factored
from jaxspatial.mechanism import Mechanism


class InverseDynamicsDerivatives(NamedTuple):
    """(*batch, nv, nv) each: rows are generalized forces, columns rates. dtau_dvdot is the mass matrix."""

    dtau_dq: jax.Array
    dtau_dv: jax.Array
    dtau_dvdot: jax.Array


class ForwardDynamicsDerivatives(NamedTuple):
    """(*batch, nv, nv) each: rows are accelerations, columns rates. dvdot_dtau is the inverse of the mass matrix."""

    dvdot_dq: jax.Array
    dvdot_dv: jax.Array
    dvdot_dtau: jax.Array


def inverse_dynamics_derivatives(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    vdot: Rates,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> InverseDynamicsDerivatives:
    """The derivatives of `inverse_dynamics` by coordinates, rates and accelerations.

    dtau_dq is by the step of `integrate(mechanism, q, step)`, at zero, with v and vdot the same numbers. It is the
    derivative by q for joints with as many coordinates as rates, but "planar".

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        vdot: (*batch, nv) time derivatives of the rates: rad/s^2, m/s^2.
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        precision: name of a precision; None takes the default.

    Returns:
        InverseDynamicsDerivatives, (*batch, nv, nv) each.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Singh, Russell, Wensing 2022, Efficient analytical derivatives of rigid-body dynamics using spatial vector
        algebra.
    """
    found = derivatives(precision, mechanism, q, v, vdot, external_forces, operation="inverse_dynamics_derivatives")
    return InverseDynamicsDerivatives(*found)


def forward_dynamics_derivatives(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    tau: Forces,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> ForwardDynamicsDerivatives:
    """The derivatives of `forward_dynamics` by coordinates, rates and forces.

    They are those of inverse dynamics, at the accelerations found, times the inverse of the mass matrix, which is
    factored in the dtype of q in every precision.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        precision: name of a precision; None takes the default.

    Returns:
        ForwardDynamicsDerivatives, (*batch, nv, nv) each, dvdot_dq as in `inverse_dynamics_derivatives`; NaN for rates
        without inertia.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: as of `inverse_dynamics_derivatives` at the accelerations of `forward_dynamics`, times the inverse, with an
        error as of `MassMatrixFactor.inverse`; products are rounded in the dtype of q.
    Source: Carpentier, Mansard 2018, Analytical derivatives of rigid body dynamics algorithms.
    """
    vdot = forward_dynamics(mechanism, q, v, tau, external_forces, precision=precision)
    dq, dv, M = inverse_dynamics_derivatives(mechanism, q, v, vdot, external_forces, precision=precision)
    inverse = factored(M).inverse()
    return ForwardDynamicsDerivatives(-(inverse @ dq), -(inverse @ dv), inverse)
