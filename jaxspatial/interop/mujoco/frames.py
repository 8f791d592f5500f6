"""Poses of bodies, and the arrays of one free joint."""

import jax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Matrix, PrecisionName, Quaternion, Six, Vector, Vector3
from jaxspatial.interop import orders
from jaxspatial.interop.orders.vectors import K
from jaxspatial.rotation.matrices import matrices
from jaxspatial.rotation.rotation import Rotation, rotated
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialVelocity
from jaxspatial.spatial.vector import SpatialVector


def from_xpos_xquat(xpos: Vector3, xquat: Quaternion, *, precision: PrecisionName = None) -> RigidTransform:
    """Reads mjData.xpos and xquat.

    Also mocap_pos and mocap_quat, and of mjModel body_pos and body_quat (X_PB, on the parent) and body_ipos and
    body_iquat (X_BI, of the principal axes).

    Args:
        xpos: (*batch, 3), m.
        xquat: (*batch, 4) wxyz.
        precision: name of a precision; None takes the default.

    Returns:
        X_WB (*batch,).

    Raises:
        ValueError: the shape does not fit.

    Error: as of `Rotation.from_quaternion`.
    """
    xquat = check.as_vectors(xquat, "mujoco.from_xpos_xquat: xquat", size=4)
    return RigidTransform(Rotation.from_quaternion(xquat, precision=precision), xpos)


def to_xpos_xquat(X_WB: RigidTransform, *, precision: PrecisionName = None) -> tuple[jax.Array, jax.Array]:
    """Makes mjData.xpos and xquat.

    Args:
        X_WB: (*batch,), m.
        precision: name of a precision; None takes the default.

    Returns:
        xpos (*batch, 3) and xquat (*batch, 4) wxyz, the real part not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return X_WB.translation, X_WB.rotation.to_quaternion(precision=precision)


def from_xpos_xmat(xpos: Vector3, xmat: Vector | Matrix) -> RigidTransform:
    """Reads mjData.xpos and xmat, also ximat and the like.

    Args:
        xpos: (*batch, 3), m.
        xmat: (*batch, 9) in C, (*batch, 3, 3) in MJX.

    Returns:
        X_WB (*batch,). Exact.

    Raises:
        ValueError: the shape does not fit.
    """
    return RigidTransform(rotation(xmat), xpos)


def to_xpos_xmat(X_WB: RigidTransform) -> tuple[jax.Array, jax.Array]:
    """Makes mjData.xpos and xmat.

    Args:
        X_WB: (*batch,), m.

    Returns:
        xpos (*batch, 3) and xmat (*batch, 9). Exact.
    """
    return X_WB.translation, X_WB.rotation.entries


def from_free_joint_qpos(qpos: Vector, *, precision: PrecisionName = None) -> RigidTransform:
    """Reads the numbers of a free joint in qpos.

    Args:
        qpos: (*batch, 7) [p_WB; wxyz]; m.
        precision: name of a precision; None takes the default.

    Returns:
        X_WB (*batch,).

    Raises:
        ValueError: the shape does not fit.

    Error: as of `Rotation.from_quaternion`.
    """
    return orders.pose_from_xyz_wxyz(qpos, precision=precision)


def to_free_joint_qpos(X_WB: RigidTransform, *, precision: PrecisionName = None) -> jax.Array:
    """Makes the numbers of a free joint in qpos.

    Args:
        X_WB: (*batch,), m.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 7) [p_WB; wxyz], the real part not negative.

    Error: as of `Rotation.to_quaternion`.
    """
    return orders.pose_to_xyz_wxyz(X_WB, precision=precision)


def from_free_joint_qvel(qvel: Six, R_WB: Rotation, *, precision: PrecisionName = None) -> SpatialVelocity:
    """Reads the numbers of a free joint in qvel.

    Args:
        qvel: (*batch, 6) [v in world axes; w in body axes].
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        V_WBo_W (*batch,), of the origin, in world axes.

    Raises:
        ValueError: the shape does not fit.

    Error: as of `rotate`.
    """
    return _from_mixed(SpatialVelocity, qvel, R_WB, precision)


def to_free_joint_qvel(V_WBo_W: SpatialVelocity, R_WB: Rotation, *, precision: PrecisionName = None) -> jax.Array:
    """Makes the numbers of a free joint in qvel.

    Args:
        V_WBo_W: of the origin, in world axes (*batch,).
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 6) [v in world axes; w in body axes].

    Error: as of `rotate`.
    """
    return _to_mixed(V_WBo_W, R_WB, precision)


def from_free_joint_qacc(qacc: Six, R_WB: Rotation, *, precision: PrecisionName = None) -> SpatialAcceleration:
    """Reads the numbers of a free joint in qacc.

    Args:
        qacc: (*batch, 6) [a in world axes; alpha in body axes].
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        A_WBo_W (*batch,), of the origin, classical, in world axes.

    Raises:
        ValueError: the shape does not fit.

    Error: as of `rotate`.
    """
    return _from_mixed(SpatialAcceleration, qacc, R_WB, precision)


def to_free_joint_qacc(A_WBo_W: SpatialAcceleration, R_WB: Rotation, *, precision: PrecisionName = None) -> jax.Array:
    """Makes the numbers of a free joint in qacc.

    Args:
        A_WBo_W: of the origin, classical, in world axes (*batch,).
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 6) [a in world axes; alpha in body axes].

    Error: as of `rotate`.
    """
    return _to_mixed(A_WBo_W, R_WB, precision)


def from_free_joint_qfrc(qfrc: Six, R_WB: Rotation, *, precision: PrecisionName = None) -> SpatialForce:
    """Reads the numbers of a free joint in qfrc_applied and the like.

    Args:
        qfrc: (*batch, 6) [f in world axes; tau in body axes].
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        F_Bo_W (*batch,), about the origin, in world axes.

    Raises:
        ValueError: the shape does not fit.

    Error: as of `rotate`.
    """
    return _from_mixed(SpatialForce, qfrc, R_WB, precision)


def to_free_joint_qfrc(F_Bo_W: SpatialForce, R_WB: Rotation, *, precision: PrecisionName = None) -> jax.Array:
    """Makes the numbers of a free joint in qfrc_applied and the like.

    Args:
        F_Bo_W: about the origin, in world axes (*batch,).
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 6) [f in world axes; tau in body axes].

    Error: as of `rotate`.
    """
    return _to_mixed(F_Bo_W, R_WB, precision)


def _from_mixed(kind: type[K], x6: Six, R_WB: Rotation, precision: PrecisionName) -> K:
    x = orders.from_linear_first(kind, x6)
    return kind(rotated(R_WB, x.rotational, precision=precision), x.translational)


def _to_mixed(x: SpatialVector, R_WB: Rotation, precision: PrecisionName) -> jax.Array:
    turned = rotated(R_WB.inverse(), x.rotational, precision=precision)
    return orders.to_linear_first(type(x)(turned, x.translational))


def rotation(matrix: Vector | Matrix) -> Rotation:
    """Of (*batch, 9) or (*batch, 3, 3), row by row."""
    m = check.as_float_array(matrix, "mujoco: matrix", held=True)
    return Rotation.from_matrix(m if m.shape[-1] == 3 else matrices(m, 3))
