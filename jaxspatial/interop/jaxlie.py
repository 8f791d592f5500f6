"""jaxlie: poses [wxyz; xyz], tangents [v; w], batched over leading axes as here. It has no forces."""

from typing import Any

import jax

from jaxspatial.arithmetic.types import Matrix, PrecisionName, Six
from jaxspatial.interop import orders
from jaxspatial.interop.library import library
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity


def from_so3(R_AB: Any, *, precision: PrecisionName = None) -> Rotation:
    """Reads a jaxlie.SO3, which holds quaternions wxyz.

    Args:
        R_AB: an SO3 (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The same (*batch,).

    Error: as of `Rotation.from_quaternion`.
    """
    return Rotation.from_quaternion(R_AB.wxyz, precision=precision)


def to_so3(R_AB: Rotation, *, precision: PrecisionName = None) -> Any:
    """Makes a jaxlie.SO3, the real part not negative.

    Args:
        R_AB: (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The SO3.

    Raises:
        ImportError: jaxlie is missing.

    Error: as of `Rotation.to_quaternion`.
    """
    return library("jaxlie").SO3(wxyz=R_AB.to_quaternion(precision=precision))


def from_se3(X_AB: Any, *, precision: PrecisionName = None) -> RigidTransform:
    """Reads a jaxlie.SE3, which holds [wxyz; p_AB].

    Args:
        X_AB: an SE3 (*batch,); m.
        precision: name of a precision; None takes the default.

    Returns:
        The same (*batch,).

    Error: as of `Rotation.from_quaternion`.
    """
    return orders.pose_from_wxyz_xyz(X_AB.wxyz_xyz, precision=precision)


def to_se3(X_AB: RigidTransform, *, precision: PrecisionName = None) -> Any:
    """Makes a jaxlie.SE3, the real part not negative.

    Args:
        X_AB: (*batch,); m.
        precision: name of a precision; None takes the default.

    Returns:
        The SE3.

    Raises:
        ImportError: jaxlie is missing.

    Error: as of `Rotation.to_quaternion`.
    """
    return library("jaxlie").SE3(wxyz_xyz=orders.pose_to_wxyz_xyz(X_AB, precision=precision))


def from_tangent(x6: Six) -> SpatialVelocity:
    """Reads a tangent of SE3: `exp` is the same of both.

    Args:
        x6: (*batch, 6) [v; w]; m, rad.

    Returns:
        The velocity over unit time (*batch,).

    Raises:
        ValueError: the shape does not fit.
    """
    return orders.from_linear_first(SpatialVelocity, x6)


def to_tangent(V: SpatialVelocity) -> jax.Array:
    """Makes a tangent of SE3.

    Args:
        V: the velocity over unit time (*batch,).

    Returns:
        (*batch, 6) [v; w]; m, rad.
    """
    return orders.to_linear_first(V)


def from_adjoint(m: Matrix) -> jax.Array:
    """Reads jaxlie's `SE3.adjoint()`, which acts on [v; w].

    Args:
        m: (*batch, 6, 6).

    Returns:
        `RigidTransform.to_motion_matrix` of it (*batch, 6, 6), which acts on [w; v].

    Raises:
        ValueError: the shape does not fit.
    """
    return orders.matrix_from_linear_first(m)


def to_adjoint(m: Matrix) -> jax.Array:
    """Makes jaxlie's `SE3.adjoint()`; its inverse transpose acts on [f; tau].

    Args:
        m: `RigidTransform.to_motion_matrix()` (*batch, 6, 6).

    Returns:
        The adjoint (*batch, 6, 6), which acts on [v; w].

    Raises:
        ValueError: the shape does not fit.
    """
    return orders.matrix_to_linear_first(m)
