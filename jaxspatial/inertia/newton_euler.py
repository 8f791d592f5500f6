"""The equations of motion of one body."""

import jax

from jaxspatial.inertia.inertia import SpatialInertia
from jaxspatial.numerics import floats
from jaxspatial.numerics.check import require_kind
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Inertia, Motion, Vector, Wrench
from jaxspatial.numerics.numbers import noinline_pairs
from jaxspatial.numerics.promise import Promise, promises
from jaxspatial.numerics.quantity import require_compatible
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialVelocity, algebra

NEWTON_EULER = Promise(12, 48)


@promises(bound=NEWTON_EULER)
def newton_euler(
    M_BP_E: SpatialInertia,
    A_WP_E: SpatialAcceleration,
    w: ArrayLike | SpatialVelocity,
    *,
    precision: PrecisionName = None,
) -> SpatialForce:
    """The wrench F_BP_E about P that gives a body the acceleration A at angular velocity w.

        f = m (a + alpha x c + w x (w x c))        tau = I alpha + w x I w + c x f

    Args:
        M_BP_E: inertia about P, with mass m, centre of mass c = p_PPcm and central inertia I.
        A_WP_E: acceleration of P, the classical one, in the world: rad/s^2, m/s^2.
        w: (*batch, 3) angular velocity of the body, rad/s, or the SpatialVelocity that it is part of. All three are
            expressed in one frame.
        precision: name of a precision; None takes the default.

    Returns:
        The sum of all forces and torques on the body, gravity among them: N m, N, over the common batch. 81 flops.

    Raises:
        TypeError: an argument is of another kind, or dtypes differ.
        ValueError: shapes do not fit.

    Error: per component, mag the sum of the absolute values of the terms, multiplied out: at most 12 u mag in "fast"
        and "reproducible", u |r| + 48 u^2 mag in the other two, while nothing over- or underflows.
    Source: Newton 1687; Euler 1776; Featherstone 2008, 2.14.

    Example:
        >>> M = js.SpatialInertia.point_mass([1.0, 0.0, 0.0], mass=2.0)
        >>> A = js.SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[0.0, 0.0, 0.0])
        >>> print(js.newton_euler(M, A, [0.0, 0.0, 3.0]).f)
        [-18.   0.   0.]
    """
    require_kind(M_BP_E, SpatialInertia, "newton_euler", " first")
    w = angular_velocity(A_WP_E, w, "newton_euler")
    require_compatible(SpatialInertia=M_BP_E, SpatialAcceleration=A_WP_E)
    return SpatialForce(*_newton_euler(precision, Inertia(*M_BP_E._vectors), Motion(*A_WP_E._vectors), w))


def angular_velocity(A: SpatialAcceleration, w: ArrayLike | SpatialVelocity, operation: str) -> jax.Array:
    """The array, or the rotational part of a velocity, of the dtype of the acceleration."""
    require_kind(A, SpatialAcceleration, operation)
    w = w.w if isinstance(w, SpatialVelocity) else floats.as_vectors(w, f"{operation}: w", A.dtype)
    require_compatible(SpatialAcceleration=A, w=w)
    return w


@formula
def _newton_euler(M: Inertia, A: Motion, w: Vector):
    f = _force(M, A, w)
    return Wrench(_torque(M, A.w, w, f), f)


@noinline_pairs
def _force(M: Inertia, A: Motion, w: Vector) -> Vector:
    return M.mass * algebra.shifted_acceleration(A, M.com, w).v


@noinline_pairs
def _torque(M: Inertia, alpha: Vector, w: Vector, f: Vector) -> Vector:
    return algebra.euler_torque(M, alpha, w, M.central @ w, f)
