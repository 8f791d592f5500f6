"""Drake (pydrake): rotational part first, about a point, accelerations classical, quaternions wxyz: as ours.

Objects of pydrake are single and float64: what is read is NumPy, copied, in float64, known while tracing;
what is made takes one item. Read: Drake's multibody/math and multibody/tree headers, pydrake 1.51.
"""

from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import Matrix, PrecisionName, Six, Vector
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.interop.library import library
from jaxspatial.interop.orders.vectors import K
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity
from jaxspatial.spatial.vector import SpatialVector

# -- spatial vectors, and wrenches on bodies ---------------------------------------------------------------------------


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
    return _made(F_Bp_E, "drake.to_force")


def from_velocity(V_MBp_E: Any) -> SpatialVelocity:
    """Reads pydrake's SpatialVelocity, [w; v] of Bp in E: as `from_force`."""
    return SpatialVelocity.from_array(V_MBp_E.get_coeffs())


def to_velocity(V_MBp_E: SpatialVelocity) -> Any:
    """Makes pydrake's SpatialVelocity of a single one, [w; v] of Bp in E: as `to_force`, errors too."""
    return _made(V_MBp_E, "drake.to_velocity")


def from_acceleration(A_MBp_E: Any) -> SpatialAcceleration:
    """Reads pydrake's SpatialAcceleration, [alpha; a] in E, a the classical acceleration of Bp: as `from_force`."""
    return SpatialAcceleration.from_array(A_MBp_E.get_coeffs())


def to_acceleration(A_MBp_E: SpatialAcceleration) -> Any:
    """Makes pydrake's SpatialAcceleration of a single one, [alpha; a] in E, a classical: as `to_force`, errors too."""
    return _made(A_MBp_E, "drake.to_acceleration")


def from_momentum(L_MSp_E: Any) -> SpatialMomentum:
    """Reads pydrake's SpatialMomentum, [h; l] about Sp in E: as `from_force`."""
    return SpatialMomentum.from_array(L_MSp_E.get_coeffs())


def to_momentum(L_MSp_E: SpatialMomentum) -> Any:
    """Makes pydrake's SpatialMomentum of a single one, [h; l] about Sp in E: as `to_force`, errors too."""
    return _made(L_MSp_E, "drake.to_momentum")


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


def _made(x: SpatialVector, name: str) -> Any:
    """By the name of its class, which is Drake's."""
    return getattr(library("pydrake.multibody.math"), type(x).__name__)(orders.single(x.to_array(), name))


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


# -- rotations, poses and floating joints ------------------------------------------------------------------------------


def from_rotation_matrix(R_AB: Any) -> Rotation:
    """Reads pydrake's RotationMatrix: single, as NumPy in float64."""
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
    """Reads pydrake's RigidTransform, m: single, as NumPy in float64."""
    return RigidTransform(from_rotation_matrix(X_AB.rotation()), np.array(X_AB.translation()))


def to_rigid_transform(X_AB: RigidTransform) -> Any:
    """Makes pydrake's RigidTransform, m, of a single one: its rotation as by `to_rotation_matrix`, errors too."""
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


# -- spatial inertias --------------------------------------------------------------------------------------------------


def from_inertia(M_SP_E: Any) -> SpatialInertia:
    """Reads pydrake's SpatialInertia, which holds mass, com and inertia about P per unit mass: [m, p_PScm, G_SP].

    Drake shifts G to the centre of mass. A body without mass has no inertia here, whatever its G.

    Args:
        M_SP_E: a SpatialInertia.

    Returns:
        M_SP_E, single, as NumPy in float64.

    Error: u m |com|^2 of float64, of the shift.
    """
    mass, com = M_SP_E.get_mass(), np.array(M_SP_E.get_com())
    central = M_SP_E.get_unit_inertia().ShiftToCenterOfMass(com).CopyToFullMatrix3()
    return SpatialInertia(mass, com, mass * central)


def to_inertia(M_SP_E: SpatialInertia) -> Any:
    """Makes pydrake's SpatialInertia, valid or not.

    Without mass G_SP is that of a point mass. Far from its centre of mass Drake may call a rod, or a point, invalid.

    Args:
        M_SP_E: a single one.

    Returns:
        The SpatialInertia.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ValueError: there is a central inertia without mass (a rotor's), which Drake cannot hold.
        ImportError: pydrake is missing.

    Error: of G_SP a few u (|central| / m + |com|^2).
    """
    tree = library("pydrake.multibody.tree")
    (mass,), com, central = (orders.single(x, "drake.to_inertia") for x in M_SP_E.vectors)
    if mass == 0 and central.any():
        raise ValueError(f"drake.to_inertia: expected no central inertia without mass, got {central} for mass 0")
    moments_and_products = orders.symmetric_to_diagonal_first(central / mass if mass else central)
    G_SP_E = tree.UnitInertia(*moments_and_products).ShiftFromCenterOfMass(com)
    return tree.SpatialInertia(mass, com, G_SP_E, skip_validity_check=True)
