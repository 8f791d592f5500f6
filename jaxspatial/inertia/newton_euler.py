"""The equations of motion of one body, and what makes them linear: its ten dynamic parameters."""

import jax

from jaxspatial.arithmetic import check, symmetric, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Numbers, Rows, Symmetric, Three, constant, halved, noinline_pairs
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.inertia.inertia import SpatialInertia
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialVelocity, algebra
from jaxspatial.spatial.arguments import require_kind


def newton_euler(
    M_BP_E: SpatialInertia,
    A_WP_E: SpatialAcceleration,
    w: Vector3 | SpatialVelocity,
    *,
    precision: PrecisionName = None,
) -> SpatialForce:
    """The wrench F_BP_E about P that gives a body the acceleration A while it turns at w.

        f = m (a + alpha x c + w x (w x c))        tau = I alpha + w x I w + c x f

    Args:
        M_BP_E: inertia about P, with mass m, centre of mass c = p_PPcm and central inertia I.
        A_WP_E: acceleration of P, the classical one, in the world: rad/s^2, m/s^2.
        w: (*batch, 3) angular velocity of the body, rad/s, or the SpatialVelocity that it is part of. All three are
            expressed in one frame.
        precision: name of a precision; None takes the default.

    Returns:
        All forces and torques on the body together, gravity among them: N m, N, over the common batch. 81 flops.

    Raises:
        TypeError: an argument is of another kind, or dtypes differ.
        ValueError: shapes do not fit.

    Error: per component, mag the sum of the absolute values of the terms, multiplied out: at most 12 u mag in "fast"
        and "reproducible", u |r| + 48 u^2 mag in the other two, while nothing over- or underflows.
    Source: Newton 1687; Euler 1776; Featherstone 2008, 2.14.
    """
    require_kind(M_BP_E, SpatialInertia, "newton_euler", " first")
    turning = _angular_velocity(A_WP_E, w, "newton_euler")
    require_alike(SpatialInertia=M_BP_E, SpatialAcceleration=A_WP_E)
    return SpatialForce(*_newton_euler(precision, *M_BP_E.vectors, *A_WP_E.vectors, turning))


def newton_euler_regressor(
    A_WP_E: SpatialAcceleration, w: Vector3 | SpatialVelocity, *, precision: PrecisionName = None
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

    Error: per entry, mag the sum of the absolute values of its terms: at most 2 u mag in "fast" and "reproducible",
        u |r| + 4 u^2 mag in "compensated", 1 ulp in "faithful"; what is 0 is so exactly.
    Source: Atkeson, An, Hollerbach 1986, Estimation of inertial parameters of manipulator loads and links, equation
        10.
    """
    turning = _angular_velocity(A_WP_E, w, "newton_euler_regressor")
    return _matrix(_newton_euler_regressor(precision, *A_WP_E.vectors, turning))


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
    """
    require_kind(V_WP_E, SpatialVelocity, "momentum_regressor")
    return _matrix(_momentum_regressor(precision, V_WP_E.w, V_WP_E.v))


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

    Error: per entry, mag the sum of the absolute values of its terms: at most 3 u mag in "fast" and "reproducible",
        u |r| + 8 u^2 mag in "compensated", 1 ulp in "faithful".
    """
    require_kind(V_WP_E, SpatialVelocity, "kinetic_energy_regressor")
    return _energy(precision, V_WP_E.w, V_WP_E.v)


def _angular_velocity(A: SpatialAcceleration, w: Vector3 | SpatialVelocity, operation: str) -> jax.Array:
    require_kind(A, SpatialAcceleration, operation)
    found = w.w if isinstance(w, SpatialVelocity) else check.as_vectors(w, f"{operation}: w", A.dtype)
    require_alike(SpatialAcceleration=A, w=found)
    return found


def _matrix(entries: jax.Array) -> jax.Array:
    return entries.reshape((*entries.shape[:-1], 6, 10))


@formula
def _newton_euler(mass: Numbers, com: Three, central: Symmetric, alpha: Three, a: Three, w: Three) -> list[Three]:
    f = _force(mass[0], com, alpha, a, w)
    return [_torque(com, central, alpha, w, f), f]


@noinline_pairs
def _force(m: Number, c: Three, alpha: Three, a: Three, w: Three) -> Three:
    return vectors.times(m, algebra.acceleration_at(alpha, a, w, c))


@noinline_pairs
def _torque(c: Three, central: Symmetric, alpha: Three, w: Three, f: Three) -> Three:
    h = vectors.matrix_times(symmetric.rows(central), w)
    return algebra.newton_euler_torque(c, central, alpha, w, h, f)


# -- regressors: row by row -------------------------------------------------------------------------------------------


@formula(of_sums=True)
def _newton_euler_regressor(alpha: Three, a: Three, w: Three) -> Numbers:
    torque = algebra.plus(algebra.of_moments(alpha), _crossed(w, algebra.of_moments(w)))
    force = algebra.plus(algebra.skew(alpha), _crossed(w, algebra.skew(w)))
    return _stacked(_negative(algebra.skew(a)), torque, a, force)


@formula(of_sums=True)
def _momentum_regressor(w: Three, v: Three) -> Numbers:
    return _stacked(_negative(algebra.skew(v)), algebra.of_moments(w), v, algebra.skew(w))


@formula(of_sums=True)
def _energy(w: Three, v: Three) -> Numbers:
    half_w, half_v = (tuple(map(halved, x)) for x in (w, v))
    xx, yy, zz = vectors.componentwise_product(half_w, w)
    xy, xz, yz = (w[i] * w[j] for i, j in ((1, 0), (2, 0), (2, 1)))
    return vectors.dot(half_v, v), *vectors.cross(v, w), xx, xy, yy, xz, yz, zz


def _crossed(w: Three, m: Rows) -> Rows:
    """[w]x m."""
    return vectors.transpose([vectors.cross(w, column) for column in vectors.transpose(m)])


def _negative(m: Rows) -> Rows:
    return tuple(map(vectors.negative, m))


def _stacked(torque_of_arm: Rows, torque_of_moments: Rows, force: Three, force_of_arm: Rows) -> Numbers:
    """The rows in three blocks: of m, of m c, of the moments of inertia."""
    zero = constant(force[0], 0)
    top = [x for arm, moments in zip(torque_of_arm, torque_of_moments, strict=True) for x in (zero, *arm, *moments)]
    bottom = [x for f, arm in zip(force, force_of_arm, strict=True) for x in (f, *arm, *[zero] * 6)]
    return *top, *bottom
