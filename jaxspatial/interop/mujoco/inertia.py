"""Inertias of bodies."""

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import PrecisionName, Quaternion, Scalar, Vector, Vector3
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.interop.mujoco.frames import from_xpos_xquat
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import act

# [xx, yy, zz, xy, xz, yz, m c, m] in ours, [m, m c, xx, xy, yy, xz, yz, zz], and back. Of int32: JAX 0.10 caches what
# it makes of an array of int64, and fails when 64-bit types are switched on later.
_OF_CINERT = np.array([9, 6, 7, 8, 0, 3, 1, 4, 5, 2], np.int32)
_TO_CINERT = np.argsort(_OF_CINERT).astype(np.int32)
# The principal axes in reverse, the last turned round so that they stay right-handed.
_REVERSED = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])


def from_cinert(cinert: Vector, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads mjData.cinert or crb.

    Args:
        cinert: (*batch, 10) [xx, yy, zz, xy, xz, yz, m c, m], the inertia about C too.
        precision: name of a precision; None takes the default.

    Returns:
        M_BC_W (*batch,), about C in the world's axes.

    Raises:
        ValueError: the shape does not fit.

    Error: as of `SpatialInertia.from_dynamic_parameters`, which tells what cancels.
    """
    ten = check.as_vectors(cinert, "mujoco.from_cinert: cinert", size=10)
    return SpatialInertia.from_dynamic_parameters(ten[..., _OF_CINERT], precision=precision)


def to_cinert(M_BC_W: SpatialInertia, *, precision: PrecisionName = None) -> jax.Array:
    """Makes mjData.cinert or crb.

    Args:
        M_BC_W: about C in the world's axes (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 10) [xx, yy, zz, xy, xz, yz, m c, m].

    Error: as of `SpatialInertia.to_dynamic_parameters`.
    """
    return M_BC_W.to_dynamic_parameters(precision=precision)[..., _TO_CINERT]


def from_body_inertia(
    body_mass: Scalar,
    body_inertia: Vector3,
    body_ipos: Vector3,
    body_iquat: Quaternion,
    *,
    precision: PrecisionName = None,
) -> SpatialInertia:
    """Reads mjModel's body_mass, body_inertia, body_ipos and body_iquat.

    Args:
        body_mass: (*batch,), kg.
        body_inertia: (*batch, 3) moments about principal axes, kg m2.
        body_ipos: (*batch, 3) position of these axes, m.
        body_iquat: (*batch, 4) wxyz of these axes.
        precision: name of a precision; None takes the default.

    Returns:
        M_BBo_B (*batch,), about the body's origin in its axes.

    Raises:
        ValueError: the shape does not fit.

    Error: as of `act` of an inertia.
    """
    X_BI = from_xpos_xquat(body_ipos, body_iquat, precision=precision)
    moments = check.as_vectors(body_inertia, "mujoco.from_body_inertia: body_inertia", X_BI.dtype)
    is_moment = np.array([1, 0, 1, 0, 0, 1], X_BI.dtype)
    diagonal = moments[..., np.array([0, 0, 1, 0, 0, 2])] * np.broadcast_to(is_moment, (*moments.shape[:-1], 6))
    principal = SpatialInertia(body_mass, np.zeros(3, X_BI.dtype), diagonal)
    return act(X_BI, principal, precision=precision)


def to_body_inertia(
    M_BBo_B: SpatialInertia, *, precision: PrecisionName = None
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Makes mjModel's body_mass, body_inertia, body_ipos and body_iquat.

    Args:
        M_BBo_B: about the body's origin in its axes (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The four arrays, moments descending as MuJoCo's compiler sorts them.

    Error: as of `SpatialInertia.principal_moments_and_axes`.
    """
    moments, R_BA = M_BBo_B.principal_moments_and_axes(precision=precision)
    R_BI = R_BA @ Rotation.from_matrix(_REVERSED.astype(R_BA.dtype))
    return M_BBo_B.mass, moments[..., ::-1], M_BBo_B.com, R_BI.to_quaternion(precision=precision)


def from_full_inertia(mass: Scalar, pos: Vector3, fullinertia: Vector) -> SpatialInertia:
    """Reads MJCF's <inertial mass pos fullinertia>.

    Args:
        mass: (*batch,), kg.
        pos: (*batch, 3) centre of mass, m.
        fullinertia: (*batch, 6) [xx, yy, zz, xy, xz, yz] about the centre of mass, in body axes, kg m2.

    Returns:
        M_BBo_B (*batch,). Exact.

    Raises:
        ValueError: the shape does not fit.
    """
    return SpatialInertia(mass, pos, orders.symmetric_from_diagonal_first(fullinertia))


def to_full_inertia(M_BBo_B: SpatialInertia) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Makes the numbers of MJCF's <inertial>.

    Args:
        M_BBo_B: about the body's origin in its axes (*batch,).

    Returns:
        mass (*batch,), pos (*batch, 3), fullinertia (*batch, 6). Exact.
    """
    return M_BBo_B.mass, M_BBo_B.com, orders.symmetric_to_diagonal_first(M_BBo_B.central)
