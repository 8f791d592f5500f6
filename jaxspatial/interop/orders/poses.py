"""Orders of quaternions and poses."""

import jax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import PrecisionName, Quaternion, Vector
from jaxspatial.interop.orders.symmetric import reordered
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform
from jaxspatial.spatial.parts import joined


def quaternion_from_xyzw(q: Quaternion) -> jax.Array:
    """Moves the real part of quaternions from the end to the front.

    Args:
        q: (*batch, 4) xyzw: Pinocchio, SciPy, ROS.

    Returns:
        The quaternions (*batch, 4) wxyz: ours, Drake, MuJoCo, Brax, jaxlie.

    Raises:
        ValueError: the shape does not fit.
    """
    return reordered(q, "quaternion_from_xyzw: q", 3, 0, 1, 2)


def quaternion_to_xyzw(q: Quaternion) -> jax.Array:
    """Moves the real part of quaternions from the front to the end.

    Args:
        q: (*batch, 4) wxyz: ours, Drake, MuJoCo, Brax, jaxlie.

    Returns:
        The quaternions (*batch, 4) xyzw: Pinocchio, SciPy, ROS.

    Raises:
        ValueError: the shape does not fit.
    """
    return reordered(q, "quaternion_to_xyzw: q", 1, 2, 3, 0)


def pose_from_xyz_xyzw(x7: Vector, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes a pose of position and quaternion.

    Args:
        x7: (*batch, 7) [p_AB; xyzw]: Pinocchio's XYZQUAT, ROS; m.
        precision: name of a precision; None takes the default.

    Returns:
        X_AB (*batch,).

    Raises:
        ValueError: the shape does not fit.

    Error: as of `Rotation.from_quaternion`.
    """
    pose = check.as_vectors(x7, "pose_from_xyz_xyzw: x7", size=7, held=True)
    return _pose(pose[..., :3], quaternion_from_xyzw(pose[..., 3:]), precision)


def pose_to_xyz_xyzw(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks position and quaternion of a pose.

    Args:
        X_AB: a pose (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 7) [p_AB; xyzw]: Pinocchio's XYZQUAT, ROS; the real part is not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return joined(X_AB.translation, quaternion_to_xyzw(X_AB.rotation.to_quaternion(precision=precision)))


def pose_from_xyz_wxyz(x7: Vector, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes a pose of position and quaternion.

    Args:
        x7: (*batch, 7) [p_AB; wxyz]: MuJoCo's free joint; m.
        precision: name of a precision; None takes the default.

    Returns:
        X_AB (*batch,).

    Raises:
        ValueError: the shape does not fit.

    Error: as of `Rotation.from_quaternion`.
    """
    pose = check.as_vectors(x7, "pose_from_xyz_wxyz: x7", size=7, held=True)
    return _pose(pose[..., :3], pose[..., 3:], precision)


def pose_to_xyz_wxyz(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks position and quaternion of a pose.

    Args:
        X_AB: a pose (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 7) [p_AB; wxyz]: MuJoCo's free joint; the real part is not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return joined(X_AB.translation, X_AB.rotation.to_quaternion(precision=precision))


def pose_from_wxyz_xyz(x7: Vector, *, precision: PrecisionName = None) -> RigidTransform:
    """Makes a pose of position and quaternion.

    Args:
        x7: (*batch, 7) [wxyz; p_AB]: jaxlie, jaxsim, Drake's floating joint, and the free joint here; m.
        precision: name of a precision; None takes the default.

    Returns:
        X_AB (*batch,).

    Raises:
        ValueError: the shape does not fit.

    Error: as of `Rotation.from_quaternion`.
    """
    pose = check.as_vectors(x7, "pose_from_wxyz_xyz: x7", size=7, held=True)
    return _pose(pose[..., 4:], pose[..., :4], precision)


def pose_to_wxyz_xyz(X_AB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Stacks position and quaternion of a pose.

    Args:
        X_AB: a pose (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 7) [wxyz; p_AB]: jaxlie, jaxsim, Drake's floating joint, and the free joint here; the real part is not
        negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return joined(X_AB.rotation.to_quaternion(precision=precision), X_AB.translation)


def _pose(xyz: jax.Array, wxyz: jax.Array, precision: PrecisionName) -> RigidTransform:
    return RigidTransform(Rotation.from_quaternion(wxyz, precision=precision), xyz)
