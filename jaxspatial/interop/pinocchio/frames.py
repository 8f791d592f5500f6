"""Reference frames, poses and the free flyer of Pinocchio."""

from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic.types import PrecisionName, Six, Vector, Vector3
from jaxspatial.interop import orders
from jaxspatial.interop.library import library
from jaxspatial.interop.orders.vectors import K
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity, act, act_inverse, rotate


def from_world(X_WB: RigidTransform, x_Wo_W: K, w: Vector3 | None = None, *, precision: PrecisionName = None) -> K:
    """Moves a spatial vector from ReferenceFrame.WORLD to LOCAL, as `act_inverse` does.

    Args:
        X_WB: the pose of B in the world (*batch,).
        x_Wo_W: any of the four kinds, about the origin of the world, in its axes; an acceleration is that of the body's
            point there.
        w: (*batch, 3) angular velocity of B, for an acceleration; in W.
        precision: name of a precision; None takes the default.

    Returns:
        The same about Bo in the axes of B.

    Error: as of `act_inverse`.
    """
    return act_inverse(X_WB, x_Wo_W, w, precision=precision)


def to_world(X_WB: RigidTransform, x_Bo_B: K, w: Vector3 | None = None, *, precision: PrecisionName = None) -> K:
    """Moves a spatial vector from ReferenceFrame.LOCAL to WORLD, as `act` does.

    Args:
        X_WB: the pose of B in the world (*batch,).
        x_Bo_B: any of the four kinds, about Bo in the axes of B.
        w: (*batch, 3) angular velocity of B, for an acceleration; in B.
        precision: name of a precision; None takes the default.

    Returns:
        The same about the origin of the world, in its axes.

    Error: as of `act`.
    """
    return act(X_WB, x_Bo_B, w, precision=precision)


def from_local_world_aligned(X_WB: RigidTransform, x_Bo_W: K, *, precision: PrecisionName = None) -> K:
    """Re-expresses a spatial vector of ReferenceFrame.LOCAL_WORLD_ALIGNED in LOCAL.

    Args:
        X_WB: the pose of B in the world (*batch,).
        x_Bo_W: any of the four kinds, about Bo, in the axes of the world.
        precision: name of a precision; None takes the default.

    Returns:
        The same in the axes of B.

    Error: as of `rotate`.
    """
    return rotate(X_WB.rotation.inverse(), x_Bo_W, precision=precision)


def to_local_world_aligned(X_WB: RigidTransform, x_Bo_B: K, *, precision: PrecisionName = None) -> K:
    """Re-expresses a spatial vector of ReferenceFrame.LOCAL in LOCAL_WORLD_ALIGNED.

    Args:
        X_WB: the pose of B in the world (*batch,).
        x_Bo_B: any of the four kinds, about Bo, in the axes of B.
        precision: name of a precision; None takes the default.

    Returns:
        The same in the axes of the world.

    Error: as of `rotate`.
    """
    return rotate(X_WB.rotation, x_Bo_B, precision=precision)


def from_se3(X_AB: Any) -> RigidTransform:
    """Reads a pinocchio.SE3, such as `data.oMi[i]`; a copy, while SE3 hands out its own memory.

    Args:
        X_AB: an SE3; m.

    Returns:
        The same, single, as NumPy in float64.
    """
    return RigidTransform(Rotation.from_matrix(np.array(X_AB.rotation)), np.array(X_AB.translation))


def to_se3(X_AB: RigidTransform) -> Any:
    """Makes a pinocchio.SE3, the rotation taken as it is (`SE3.normalize` repairs it).

    Args:
        X_AB: a single one; m.

    Returns:
        The SE3.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.
    """
    R = orders.single(X_AB.rotation.entries, "pinocchio.to_se3").reshape(3, 3)
    return library("pinocchio").SE3(R, orders.single(X_AB.translation, "pinocchio.to_se3"))


def from_free_flyer_configuration(q7: Vector, *, precision: PrecisionName = None) -> RigidTransform:
    """Reads the seven numbers of JointModelFreeFlyer in q, also of `SE3ToXYZQUAT`.

    Args:
        q7: (*batch, 7) [p_WB; xyzw]; m.
        precision: name of a precision; None takes the default.

    Returns:
        X_WB (*batch,).

    Raises:
        ValueError: the shape does not fit.

    Error: as of `Rotation.from_quaternion`.
    """
    return orders.pose_from_xyz_xyzw(q7, precision=precision)


def to_free_flyer_configuration(X_WB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Makes the seven numbers of JointModelFreeFlyer in q.

    Args:
        X_WB: the pose of B in the world (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 7) [p_WB; xyzw], the real part not negative; m.

    Error: as of `Rotation.to_quaternion`.
    """
    return orders.pose_to_xyz_xyzw(X_WB, precision=precision)


def from_free_flyer_velocity(v6: Six) -> SpatialVelocity:
    """Reads the six numbers of JointModelFreeFlyer in v.

    Args:
        v6: (*batch, 6) [v; w], both in the axes of B; m/s, rad/s.

    Returns:
        V_WBo_B (*batch,).

    Raises:
        ValueError: the shape does not fit.
    """
    return orders.from_linear_first(SpatialVelocity, v6)


def to_free_flyer_velocity(V_WBo_B: SpatialVelocity) -> jax.Array:
    """Makes the six numbers of JointModelFreeFlyer in v.

    Args:
        V_WBo_B: (*batch,), in the axes of B.

    Returns:
        (*batch, 6) [v; w]; m/s, rad/s.
    """
    return orders.to_linear_first(V_WBo_B)
