"""Spatial vectors of Drake, and wrenches on bodies."""

from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Matrix
from jaxspatial.interop import orders
from jaxspatial.interop.library import library
from jaxspatial.interop.orders.vectors import K
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity
from jaxspatial.spatial.vector import SpatialVector


def from_force(F_Bp_E: Any) -> SpatialForce:
    """Reads pydrake's SpatialForce.

    Args:
        F_Bp_E: [tau; f] about Bp in E.

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialForce.from_array(F_Bp_E.get_coeffs())


def to_force(F_Bp_E: SpatialForce) -> Any:
    """Makes pydrake's SpatialForce.

    Args:
        F_Bp_E: a single one, [tau; f] about Bp in E.

    Returns:
        The same as pydrake's.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pydrake is missing.
    """
    return library("pydrake.multibody.math").SpatialForce(_six(F_Bp_E, "drake.to_force"))


def from_velocity(V_MBp_E: Any) -> SpatialVelocity:
    """Reads pydrake's SpatialVelocity.

    Args:
        V_MBp_E: [w; v] of Bp in E.

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialVelocity.from_array(V_MBp_E.get_coeffs())


def to_velocity(V_MBp_E: SpatialVelocity) -> Any:
    """Makes pydrake's SpatialVelocity.

    Args:
        V_MBp_E: a single one, [w; v] of Bp in E.

    Returns:
        The same as pydrake's.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pydrake is missing.
    """
    return library("pydrake.multibody.math").SpatialVelocity(_six(V_MBp_E, "drake.to_velocity"))


def from_acceleration(A_MBp_E: Any) -> SpatialAcceleration:
    """Reads pydrake's SpatialAcceleration.

    Args:
        A_MBp_E: [alpha; a], a the classical acceleration of Bp, in E.

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialAcceleration.from_array(A_MBp_E.get_coeffs())


def to_acceleration(A_MBp_E: SpatialAcceleration) -> Any:
    """Makes pydrake's SpatialAcceleration.

    Args:
        A_MBp_E: a single one, [alpha; a], a the classical acceleration of Bp, in E.

    Returns:
        The same as pydrake's.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pydrake is missing.
    """
    return library("pydrake.multibody.math").SpatialAcceleration(_six(A_MBp_E, "drake.to_acceleration"))


def from_momentum(L_MSp_E: Any) -> SpatialMomentum:
    """Reads pydrake's SpatialMomentum.

    Args:
        L_MSp_E: [h; l] about Sp in E.

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialMomentum.from_array(L_MSp_E.get_coeffs())


def to_momentum(L_MSp_E: SpatialMomentum) -> Any:
    """Makes pydrake's SpatialMomentum.

    Args:
        L_MSp_E: a single one, [h; l] about Sp in E.

    Returns:
        The same as pydrake's.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pydrake is missing.
    """
    return library("pydrake.multibody.math").SpatialMomentum(_six(L_MSp_E, "drake.to_momentum"))


def from_columns(kind: type[K], m: Matrix) -> K:
    """Reads spatial vectors that are columns of a matrix, as Drake's Jacobians are.

    Args:
        kind: one of the four spatial vectors.
        m: (6, n), rotational part on top.

    Returns:
        A batch (n,).
    """
    m = check.as_float_array(m, "drake.from_columns: m", held=True)
    return kind.from_array(m.T)


def to_columns(x: SpatialVector) -> jax.Array:
    """Puts spatial vectors side by side as columns, as Drake's Jacobians are.

    Args:
        x: a batch (n,) of any of the four kinds.

    Returns:
        (6, n), rotational part on top.
    """
    return x.to_array().T


def _six(x: SpatialVector, name: str) -> np.ndarray:
    return orders.single(x.to_array(), name)


def from_externally_applied(force: Any, X_WB: RigidTransform) -> SpatialForce:
    """Reads an ExternallyAppliedSpatialForce: a wrench about Bq in the world's axes, with Bq given in those of body B.

    Args:
        force: an ExternallyAppliedSpatialForce.
        X_WB: the pose of the body, in float64.

    Returns:
        F_Bo_W, about the body's origin.

    Error: as of `shift`.
    """
    F_Bq_W, p_BoBq_B = from_force(force.F_Bq_W), np.asarray(force.p_BoBq_B)
    return F_Bq_W.shift(-(X_WB.rotation @ p_BoBq_B.astype(X_WB.dtype)))


def to_externally_applied(body_index: Any, F_Bo_W: SpatialForce) -> Any:
    """Makes pydrake's ExternallyAppliedSpatialForce about the body's origin.

    Args:
        body_index: Drake's index of the body.
        F_Bo_W: a single wrench about the body's origin, in the world's axes.

    Returns:
        The ExternallyAppliedSpatialForce.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pydrake is missing.
    """
    force = library("pydrake.multibody.plant").ExternallyAppliedSpatialForce()
    force.body_index, force.p_BoBq_B, force.F_Bq_W = body_index, np.zeros(3), to_force(F_Bo_W)
    return force
