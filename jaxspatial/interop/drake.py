"""Drake (pydrake): rotational part first, about a point, accelerations classical, quaternions wxyz: as ours.

Objects of pydrake are single and float64: what is read is NumPy, copied, in float64, known while tracing;
what is made takes one item. Read: Drake's multibody/math and multibody/tree headers, pydrake 1.51.
"""

import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity

# -- spatial vectors --------------------------------------------------------------------------------------------------


def from_force(F_Bp_E):
    """Of pydrake's SpatialForce, [tau; f] about Bp in E. Exact."""
    return SpatialForce.from_array(F_Bp_E.get_coeffs())


def to_force(F_Bp_E):
    """pydrake's SpatialForce of a single one."""
    from pydrake.multibody import math

    return math.SpatialForce(_six(F_Bp_E, "drake.to_force"))


def from_velocity(V_MBp_E):
    """Of pydrake's SpatialVelocity, [w; v] of Bp in E. Exact."""
    return SpatialVelocity.from_array(V_MBp_E.get_coeffs())


def to_velocity(V_MBp_E):
    """pydrake's SpatialVelocity of a single one."""
    from pydrake.multibody import math

    return math.SpatialVelocity(_six(V_MBp_E, "drake.to_velocity"))


def from_acceleration(A_MBp_E):
    """Of pydrake's SpatialAcceleration, [alpha; a], a the classical acceleration of Bp, in E. Exact."""
    return SpatialAcceleration.from_array(A_MBp_E.get_coeffs())


def to_acceleration(A_MBp_E):
    """pydrake's SpatialAcceleration of a single one."""
    from pydrake.multibody import math

    return math.SpatialAcceleration(_six(A_MBp_E, "drake.to_acceleration"))


def from_momentum(L_MSp_E):
    """Of pydrake's SpatialMomentum, [h; l] about Sp in E. Exact."""
    return SpatialMomentum.from_array(L_MSp_E.get_coeffs())


def to_momentum(L_MSp_E):
    """pydrake's SpatialMomentum of a single one."""
    from pydrake.multibody import math

    return math.SpatialMomentum(_six(L_MSp_E, "drake.to_momentum"))


def from_columns(kind, m):
    """A batch (n,) of spatial vectors of that kind from (6, n), one column each, as Drake's Jacobians are."""
    m = check.as_float_array(m, "drake.from_columns: m", held=True)
    return kind.from_array(m.T)


def to_columns(x):
    """(6, n), one column each, of a batch (n,)."""
    return x.to_array().T


# -- frames -----------------------------------------------------------------------------------------------------------


def from_rotation_matrix(R_AB):
    """Of pydrake's RotationMatrix. Exact."""
    return Rotation.from_matrix(np.array(R_AB.matrix()))


def to_rotation_matrix(R_AB):
    """pydrake's RotationMatrix of a single Rotation, taken as it is.

    From float32 it is orthogonal to float32's eps only, invalid to Drake (`IsValid`: 128 eps of float64);
    `RotationMatrix.ProjectToRotationMatrix` repairs that.
    """
    from pydrake.math import RotationMatrix

    return RotationMatrix.MakeUnchecked(_matrix(R_AB, "drake.to_rotation_matrix"))


def from_rigid_transform(X_AB):
    """Of pydrake's RigidTransform. Exact."""
    return RigidTransform(from_rotation_matrix(X_AB.rotation()), np.array(X_AB.translation()))


def to_rigid_transform(X_AB):
    """pydrake's RigidTransform of a single one. The rotation as of `to_rotation_matrix`."""
    import pydrake.math

    R_AB = to_rotation_matrix(X_AB.rotation)
    return pydrake.math.RigidTransform(R_AB, orders.single(X_AB.translation, "drake.to_rigid_transform"))


def from_floating_positions(q7, *, precision=None):
    """X_FM from the positions (*batch, 7) [wxyz; p_FM] of a quaternion floating joint."""
    return orders.pose_from_wxyz_xyz(q7, precision=precision)


def to_floating_positions(X_FM, *, precision=None):
    """The positions (*batch, 7) [wxyz; p_FM] of a quaternion floating joint, the real part not negative."""
    return orders.pose_to_wxyz_xyz(X_FM, precision=precision)


def from_floating_velocities(v6):
    """V_FMo_F from the velocities (*batch, 6) [w; v] of a floating joint, both in the axes of the parent's frame F."""
    return SpatialVelocity.from_array(v6)


def to_floating_velocities(V_FMo_F):
    """The velocities (*batch, 6) [w; v] of a floating joint."""
    return V_FMo_F.to_array()


# -- inertia ----------------------------------------------------------------------------------------------------------


def from_inertia(M_SP_E):
    """Of pydrake's SpatialInertia, which holds mass, com and inertia about P per unit mass: [m, p_PScm, G_SP].

    Drake shifts G to the centre of mass, in float64, which costs u m |com|^2. A body without mass has no inertia
    here, whatever its G.
    """
    mass, com = M_SP_E.get_mass(), np.array(M_SP_E.get_com())
    central = M_SP_E.get_unit_inertia().ShiftToCenterOfMass(com).CopyToFullMatrix3()
    return SpatialInertia(mass, com, mass * central)


def to_inertia(M_SP_E):
    """pydrake's SpatialInertia of a single one, valid or not. Error of G_SP a few u (|central| / m + |com|^2).

    Raises ValueError for a central inertia without mass (a rotor's), which Drake cannot hold; without either, G_SP is
    that of a point mass. Far from its centre of mass Drake may then call a rod, or a point, invalid.
    """
    from pydrake.multibody import tree

    mass, com, central = _inertia(M_SP_E)
    moments_and_products = orders.symmetric_to_diagonal_first(central / mass if mass else central)
    G_SP_E = tree.UnitInertia(*moments_and_products).ShiftFromCenterOfMass(com)
    return tree.SpatialInertia(mass, com, G_SP_E, skip_validity_check=True)


def _inertia(M_SP_E):
    mass, com, central = (orders.single(x, "drake.to_inertia") for x in M_SP_E._vectors)
    if mass[0] == 0 and central.any():
        raise ValueError(f"drake.to_inertia: expected no central inertia without mass, got {central} for mass 0")
    return mass[0], com, central


# -- forces on bodies -------------------------------------------------------------------------------------------------


def from_externally_applied(force, X_WB):
    """F_Bo_W, about the body's origin, of an ExternallyAppliedSpatialForce: that is a wrench about Bq in the
    world's axes, with Bq given in the axes of body B. X_WB: pose of the body."""
    F_Bq_W, p_BoBq_B = from_force(force.F_Bq_W), np.asarray(force.p_BoBq_B)
    return F_Bq_W.shift(-(X_WB.rotation @ p_BoBq_B.astype(X_WB.dtype)))


def to_externally_applied(body_index, F_Bo_W):
    """pydrake's ExternallyAppliedSpatialForce, about the body's origin, of a wrench about it in the world's axes."""
    from pydrake.multibody.plant import ExternallyAppliedSpatialForce

    force = ExternallyAppliedSpatialForce()
    force.body_index, force.p_BoBq_B, force.F_Bq_W = body_index, np.zeros(3), to_force(F_Bo_W)
    return force


def _six(x, name):
    return orders.single(x.to_array(), name)


def _matrix(R_AB, name):
    return orders.single(R_AB.entries, name).reshape(3, 3)
