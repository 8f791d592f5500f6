"""Drake (pydrake): rotational part first, about a point, accelerations classical, quaternions wxyz: as ours.

Objects of pydrake are single and float64. What is read is NumPy in float64, copied, known while tracing; what is made
takes one item, and a batch raises ValueError. Read: Drake's multibody/math and multibody/tree headers, pydrake 1.51.
"""

from typing import Any

import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity
from jaxspatial.spatial.vectors import SpatialVector

_KINDS = {kind.__name__: kind for kind in (SpatialForce, SpatialVelocity, SpatialAcceleration, SpatialMomentum)}

# -- spatial vectors, and wrenches on bodies ---------------------------------------------------------------------------


def from_spatial_vector(x):
    """Reads pydrake's SpatialForce, SpatialVelocity, SpatialAcceleration or SpatialMomentum: ours has the same name.

    Point, frame and units are the same: F_Bp_E is [tau; f] about Bp, V_MBp_E [w; v] of Bp, A_MBp_E [alpha; a] with a
    the classical acceleration of Bp, L_MSp_E [h; l] about Sp, all in E.

    Raises:
        TypeError: x is of another class, or not of floats.

    Example:
        >>> from pydrake.multibody.math import SpatialForce
        >>> js.interop.drake.from_spatial_vector(SpatialForce(tau=[0, 0, 3], f=[1, 2, 0]))
        SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
    """
    name = type(x).__name__
    if name not in _KINDS:
        raise TypeError(f"drake.from_spatial_vector: x: expected pydrake's {' or '.join(_KINDS)}, got {name}")
    return _KINDS[name].from_array(x.get_coeffs())


def to_spatial_vector(x: SpatialVector):
    """Makes pydrake's spatial vector of the same name: a single force, velocity, acceleration or momentum.

    Example:
        >>> theirs = js.interop.drake.to_spatial_vector(F)
        >>> print(theirs.rotational(), theirs.translational())
        [0. 0. 3.] [1. 2. 0.]
    """
    from pydrake.multibody import math

    return getattr(math, type(x).__name__)(orders.single(x.to_array(), "drake.to_spatial_vector"))


def from_externally_applied(force, X_WB: RigidTransform) -> SpatialForce:
    """Reads an ExternallyAppliedSpatialForce: a wrench about Bq in the world's axes, with Bq given in those of body B.

    Args:
        force: an ExternallyAppliedSpatialForce.
        X_WB: the pose of the body, in float64.

    Returns:
        F_Bo_W, about the body's origin.

    Error: as of `shift`.

    Example:
        >>> from pydrake.multibody.plant import ExternallyAppliedSpatialForce
        >>> force = ExternallyAppliedSpatialForce()
        >>> force.p_BoBq_B, force.F_Bq_W = [2, 0, 0], js.interop.drake.to_spatial_vector(F)
        >>> with jax.enable_x64(True):
        ...     js.interop.drake.from_externally_applied(force, js.RigidTransform.identity())
        SpatialForce(tau=[0.0, 0.0, 7.0], f=[1.0, 2.0, 0.0])
    """
    F_Bq_W, p_BoBq_B = SpatialForce.from_array(force.F_Bq_W.get_coeffs()), np.asarray(force.p_BoBq_B)
    return F_Bq_W.shift(-(X_WB.rotation @ p_BoBq_B.astype(X_WB.dtype)))


def to_externally_applied(body_index, F_Bo_W: SpatialForce):
    """Makes an ExternallyAppliedSpatialForce on the body of that index, of a single wrench about the body's origin.

    Example:
        >>> from pydrake.multibody.tree import BodyIndex
        >>> force = js.interop.drake.to_externally_applied(BodyIndex(1), F)
        >>> print(force.body_index, force.p_BoBq_B, force.F_Bq_W.translational())
        BodyIndex(1) [0. 0. 0.] [1. 2. 0.]
    """
    from pydrake.multibody.plant import ExternallyAppliedSpatialForce

    force: Any = ExternallyAppliedSpatialForce()
    force.body_index, force.p_BoBq_B, force.F_Bq_W = body_index, np.zeros(3), to_spatial_vector(F_Bo_W)
    return force


# -- rotations and poses -----------------------------------------------------------------------------------------------


def from_rotation_matrix(R_AB) -> Rotation:
    """Reads pydrake's RotationMatrix, exactly.

    Example:
        >>> from pydrake.math import RotationMatrix
        >>> print(js.interop.drake.from_rotation_matrix(RotationMatrix.MakeZRotation(0.5)).to_matrix()[0])
        [ 0.8776 -0.4794  0.    ]
    """
    return Rotation.from_matrix(np.array(R_AB.matrix()))


def to_rotation_matrix(R_AB: Rotation):
    """Makes pydrake's RotationMatrix of the entries as they are.

    From float32 it is orthogonal to float32's eps only, invalid to Drake (`IsValid`: 128 eps of float64);
    `RotationMatrix.ProjectToRotationMatrix` repairs that.

    Example:
        >>> print(js.interop.drake.to_rotation_matrix(js.Rotation.about_z(0.5)).matrix()[0])
        [ 0.8776 -0.4794  0.    ]
    """
    from pydrake.math import RotationMatrix

    return RotationMatrix.MakeUnchecked(orders.single(R_AB.entries, "drake.to_rotation_matrix").reshape(3, 3))


def from_rigid_transform(X_AB) -> RigidTransform:
    """Reads pydrake's RigidTransform, m, exactly.

    Example:
        >>> from pydrake.math import RigidTransform
        >>> js.interop.drake.from_rigid_transform(RigidTransform([1, 2, 3])).translation
        array([1., 2., 3.])
    """
    return RigidTransform(from_rotation_matrix(X_AB.rotation()), np.array(X_AB.translation()))


def to_rigid_transform(X_AB: RigidTransform):
    """Makes pydrake's RigidTransform, m, its rotation as by `to_rotation_matrix`.

    Example:
        >>> print(js.interop.drake.to_rigid_transform(below).translation())
        [ 0.  0. -1.]
    """
    from pydrake import math

    R_AB = to_rotation_matrix(X_AB.rotation)
    return math.RigidTransform(R_AB, orders.single(X_AB.translation, "drake.to_rigid_transform"))


# -- spatial inertias --------------------------------------------------------------------------------------------------


def from_inertia(M_SP_E) -> SpatialInertia:
    """Reads pydrake's SpatialInertia, which holds mass, com and inertia about P per unit mass: [m, p_PScm, G_SP].

    Drake shifts G to the centre of mass. A body without mass has no inertia here, whatever its G.

    Error: u m |com|^2 of float64, of the shift.

    Example:
        >>> from pydrake.multibody.tree import SpatialInertia
        >>> M_SP_E = js.interop.drake.from_inertia(SpatialInertia.ThinRodWithMassAboutEnd(2.0, 1.0, [0, 0, -1]))
        >>> print(M_SP_E.mass, M_SP_E.com)
        2.0 [ 0.   0.  -0.5]
    """
    mass, com = M_SP_E.get_mass(), np.array(M_SP_E.get_com())
    central = M_SP_E.get_unit_inertia().ShiftToCenterOfMass(com).CopyToFullMatrix3()
    return SpatialInertia(mass, com, mass * central)


def to_inertia(M_SP_E: SpatialInertia):
    """Makes pydrake's SpatialInertia, valid or not.

    Without mass G_SP is that of a point mass. Far from its centre of mass Drake may call a rod, or a point, invalid.

    Raises:
        ValueError: there is a central inertia without mass (a rotor's), which Drake cannot hold.

    Error: of G_SP a few u (|central| / m + |com|^2).

    Example:
        >>> theirs = js.interop.drake.to_inertia(rod)
        >>> print(theirs.get_mass(), theirs.get_com())
        2.0 [ 0.   0.  -0.5]
    """
    from pydrake.multibody import tree

    (mass,), com, central = (orders.single(x, "drake.to_inertia") for x in M_SP_E._vectors)
    if mass == 0 and central.any():
        raise ValueError(f"drake.to_inertia: expected no central inertia without mass, got {central} for mass 0")
    moments_and_products = orders.symmetric_to_diagonal_first(central / mass if mass else central)
    G_SP_E = tree.UnitInertia(*moments_and_products).ShiftFromCenterOfMass(com)
    return tree.SpatialInertia(mass, com, G_SP_E, skip_validity_check=True)
