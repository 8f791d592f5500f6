"""Rotations, poses and floating joints of Drake."""

from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic.types import PrecisionName, Six, Vector
from jaxspatial.interop import orders
from jaxspatial.interop.library import library
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity


def from_rotation_matrix(R_AB: Any) -> Rotation:
    """Reads pydrake's RotationMatrix.

    Args:
        R_AB: a RotationMatrix.

    Returns:
        The same, single, as NumPy in float64.
    """
    return Rotation.from_matrix(np.array(R_AB.matrix()))


def to_rotation_matrix(R_AB: Rotation) -> Any:
    """Makes pydrake's RotationMatrix, of the entries as they are.

    From float32 it is orthogonal to float32's eps only, invalid to Drake (`IsValid`: 128 eps of float64);
    `RotationMatrix.ProjectToRotationMatrix` repairs that.

    Args:
        R_AB: a single one.

    Returns:
        The RotationMatrix.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pydrake is missing.
    """
    entries = orders.single(R_AB.entries, "drake.to_rotation_matrix").reshape(3, 3)
    return library("pydrake.math").RotationMatrix.MakeUnchecked(entries)


def from_rigid_transform(X_AB: Any) -> RigidTransform:
    """Reads pydrake's RigidTransform.

    Args:
        X_AB: a RigidTransform; m.

    Returns:
        The same, single, as NumPy in float64.
    """
    return RigidTransform(from_rotation_matrix(X_AB.rotation()), np.array(X_AB.translation()))


def to_rigid_transform(X_AB: RigidTransform) -> Any:
    """Makes pydrake's RigidTransform. The rotation is that of `to_rotation_matrix`.

    Args:
        X_AB: a single one; m.

    Returns:
        The RigidTransform.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pydrake is missing.
    """
    R_AB = to_rotation_matrix(X_AB.rotation)
    return library("pydrake.math").RigidTransform(R_AB, orders.single(X_AB.translation, "drake.to_rigid_transform"))


def from_floating_positions(q7: Vector, *, precision: PrecisionName = None) -> RigidTransform:
    """Reads the positions of a quaternion floating joint.

    Args:
        q7: (*batch, 7) [wxyz; p_FM]; m.
        precision: name of a precision; None takes the default.

    Returns:
        X_FM (*batch,).

    Raises:
        ValueError: the shape does not fit.

    Error: as of `Rotation.from_quaternion`.
    """
    return orders.pose_from_wxyz_xyz(q7, precision=precision)


def to_floating_positions(X_FM: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Makes the positions of a quaternion floating joint.

    Args:
        X_FM: a pose (*batch,); m.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 7) [wxyz; p_FM], the real part not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return orders.pose_to_wxyz_xyz(X_FM, precision=precision)


def from_floating_velocities(v6: Six) -> SpatialVelocity:
    """Reads the velocities of a floating joint.

    Args:
        v6: (*batch, 6) [w; v], both in the axes of the parent's frame F; rad/s, m/s.

    Returns:
        V_FMo_F (*batch,).

    Raises:
        ValueError: the shape does not fit.
    """
    return SpatialVelocity.from_array(v6)


def to_floating_velocities(V_FMo_F: SpatialVelocity) -> jax.Array:
    """Makes the velocities of a floating joint.

    Args:
        V_FMo_F: (*batch,), in the axes of the parent's frame F.

    Returns:
        (*batch, 6) [w; v]; rad/s, m/s.
    """
    return V_FMo_F.to_array()
