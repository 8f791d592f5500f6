"""Matrices that the wrench, the momentum and the kinetic energy of a body are linear with, in its dynamic parameters.

pi = [m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz], I about P: see `SpatialInertia.to_dynamic_parameters`
"""

import jax

from jaxspatial.inertia.newton_euler import angular_velocity
from jaxspatial.numerics.check import require_kind
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Matrix, Motion, Vector, cross, dot, skew
from jaxspatial.numerics.numbers import Number, Numbers, constant, halved
from jaxspatial.numerics.promise import Promise, promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialAcceleration, SpatialVelocity

NEWTON_EULER_REGRESSOR, ENERGY_REGRESSOR = Promise(2, 4), Promise(3, 8)


@promises(bound=NEWTON_EULER_REGRESSOR)
def newton_euler_regressor(
    A_WP_E: SpatialAcceleration, w: ArrayLike | SpatialVelocity, *, precision: PrecisionName = None
) -> jax.Array:
    """The matrix Y with Y pi the wrench F_BP_E of `newton_euler`.

        pi = [m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz], I about P: see `SpatialInertia.to_dynamic_parameters`

        tau = (m c) x a + I alpha + w x I w        f = m a + alpha x (m c) + w x (w x (m c))

    Args:
        A_WP_E: acceleration of P, the classical one, in the world: rad/s^2, m/s^2.
        w: (*batch, 3) angular velocity of the body, rad/s, or the SpatialVelocity that it is part of, in the same
            frame.
        precision: name of a precision; None takes the default.

    Returns:
        Y (*batch, 6, 10), over the common batch, rotational rows on top.

    Raises:
        TypeError: an argument is of another kind, or dtypes differ.
        ValueError: shapes do not fit.

    Error: per entry, mag the sum of the absolute values of its terms: at most 2 u mag in "fast" and "reproducible", u
        |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful"; what is 0 is so exactly.
    Source: Atkeson, An, Hollerbach 1986, Estimation of inertial parameters of manipulator loads and links, equation
        10.

    Example:
        >>> A, V = js.SpatialAcceleration(a=[0.0, 0.0, 2.0]), js.SpatialVelocity(w=[0.0, 0.0, 1.0])
        >>> Y = js.regressors.newton_euler_regressor(A, V)
        >>> M = js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=6.0)
        >>> print(Y @ M.to_dynamic_parameters())
        [ 0.  0.  0.  0.  0. 12.]
    """
    w = angular_velocity(A_WP_E, w, "newton_euler_regressor")
    return _as_matrix(_of_wrench(precision, Motion(*A_WP_E._vectors), w))


def momentum_regressor(V_WP_E: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
    """The matrix Y with Y pi the momentum about P of a body that moves at V.

        h = I w + (m c) x v        l = m v + w x (m c)

    Args:
        V_WP_E: velocity of P: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        Y (*batch, 6, 10), rotational rows on top; pi as of `newton_euler_regressor`.

    Raises:
        TypeError: the first argument is no SpatialVelocity.

    Error: none, every entry is 0 or a component of V with a sign.

    Example:
        >>> V = js.SpatialVelocity(w=[0.0, 0.0, 1.0], v=[2.0, 0.0, 0.0])
        >>> print(js.regressors.momentum_regressor(V)[3])
        [ 2.  0. -1.  0.  0.  0.  0.  0.  0.  0.]
    """
    require_kind(V_WP_E, SpatialVelocity, "momentum_regressor")
    return _as_matrix(_of_momentum(precision, Motion(*V_WP_E._vectors)))


@promises(bound=ENERGY_REGRESSOR)
def kinetic_energy_regressor(V_WP_E: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
    """The vector y with y . pi the kinetic energy of a body that moves at V.

        T = m v.v / 2 + (m c) . (v x w) + w . I w / 2

    Args:
        V_WP_E: velocity of P: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        y (*batch, 10); pi as of `newton_euler_regressor`. y . pi is in joules.

    Raises:
        TypeError: the first argument is no SpatialVelocity.

    Error: per entry, mag the sum of the absolute values of its terms: at most 3 u mag in "fast" and "reproducible", u
        |r| + 8 u^2 mag in "compensated", 1 ulp of r in "faithful".

    Example:
        >>> V = js.SpatialVelocity(w=[0.0, 0.0, 1.0], v=[2.0, 0.0, 0.0])
        >>> print(js.regressors.kinetic_energy_regressor(V))
        [ 2.   0.  -2.   0.   0.   0.   0.   0.   0.   0.5]
    """
    require_kind(V_WP_E, SpatialVelocity, "kinetic_energy_regressor")
    return _of_energy(precision, Motion(*V_WP_E._vectors))


def _as_matrix(entries: jax.Array) -> jax.Array:
    return entries.reshape((*entries.shape[:-1], 6, 10))


# -- over numbers -----------------------------------------------------------------------------------------------------


@formula(of_sums=True)
def _of_wrench(A: Motion, w: Vector) -> Numbers:
    alpha, a = A
    torque = [
        [x + y for x, y in zip(*rows, strict=True)]
        for rows in zip(_of_moments(alpha), _crossed(w, _of_moments(w)), strict=True)
    ]
    return _row_by_row(-skew(a), torque, a, skew(alpha) + _crossed(w, skew(w)))


@formula(of_sums=True)
def _of_momentum(V: Motion) -> Numbers:
    return _row_by_row(-skew(V.v), _of_moments(V.w), V.v, skew(V.w))


@formula(of_sums=True)
def _of_energy(V: Motion) -> Numbers:
    w, v = V
    half_w, half_v = (Vector(*map(halved, x)) for x in V)
    xx, yy, zz = (x * y for x, y in zip(half_w, w, strict=True))
    xy, xz, yz = (w[i] * w[j] for i, j in ((1, 0), (2, 0), (2, 1)))
    return dot(half_v, v), *cross(v, w), xx, xy, yy, xz, yz, zz


def _of_moments(v: Vector):
    """The rows of the matrix that gives I v of [Ixx, Ixy, Iyy, Ixz, Iyz, Izz]."""
    x, y, z = v
    zero = constant(x, 0)
    return (x, y, zero, z, zero, zero), (zero, x, y, zero, z, zero), (zero, zero, zero, x, y, z)


def _crossed(w: Vector, m):
    """The rows of [w]x m."""
    columns = [cross(w, column) for column in zip(*m, strict=True)]
    return Matrix(*map(Vector, *columns)) if isinstance(m, Matrix) else list(zip(*columns, strict=True))


def _row_by_row(torque_of_arm: Matrix, torque_of_moments, force: Vector, force_of_arm: Matrix) -> Numbers:
    """Six rows of ten, in three blocks: of m, of m c, of the moments of inertia."""
    zero: Number = constant(force[0], 0)
    top = [x for arm, moments in zip(torque_of_arm, torque_of_moments, strict=True) for x in (zero, *arm, *moments)]
    bottom = [x for f, arm in zip(force, force_of_arm, strict=True) for x in (f, *arm, *[zero] * 6)]
    return *top, *bottom
