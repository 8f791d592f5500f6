"""Pinocchio: Force [f; tau] and Motion [v; w], linear part first; accelerations are Featherstone's; SE3 as X_AB.

Its Force is a force as well as a momentum, its Motion a velocity as well as an acceleration: which one is meant is said
by the name of the function here. Objects are single and float64: what is read is NumPy, copied, in float64, known while
tracing; what is made takes one item. Read: Pinocchio's spatial headers, pin 4.1.
"""

import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import (
    RigidTransform,
    SpatialAcceleration,
    SpatialForce,
    SpatialMomentum,
    SpatialVelocity,
    act,
    act_inverse,
    rotate,
)

# -- spatial vectors --------------------------------------------------------------------------------------------------


def from_force(F):
    """SpatialForce of a pinocchio.Force, such as `data.f[i]`: about the origin of its frame, in its axes. Exact."""
    return SpatialForce(F.angular, F.linear)


def from_momentum(L):
    """SpatialMomentum of a pinocchio.Force, such as `data.h[i]`, or `data.hg` (about the centre of mass). Exact."""
    return SpatialMomentum(L.angular, L.linear)


def to_force(F):
    """pinocchio.Force of a single SpatialForce or SpatialMomentum."""
    import pinocchio

    return pinocchio.Force(_six(F, "pinocchio.to_force"))


def from_motion(V):
    """SpatialVelocity of a pinocchio.Motion, such as `data.v[i]`. Exact."""
    return SpatialVelocity(V.angular, V.linear)


def to_motion(V):
    """pinocchio.Motion of a single SpatialVelocity."""
    import pinocchio

    return pinocchio.Motion(_six(V, "pinocchio.to_motion"))


def from_spatial_acceleration(A, V, *, precision=None):
    """SpatialAcceleration, ours being classical, of Motions A, such as `data.a[i]`, and V, of the same frame:
    a = A.linear + w x v. `data.a` is without gravity, `data.a_gf` less gravity."""
    six = np.concatenate((A.angular, A.linear))
    return SpatialAcceleration.from_featherstone(six, from_motion(V), precision=precision)


def to_spatial_acceleration(A, V, *, precision=None):
    """pinocchio.Motion, such as `data.a[i]`, of a single SpatialAcceleration and SpatialVelocity about one point."""
    import pinocchio

    spatial = SpatialVelocity.from_array(A.to_featherstone(V, precision=precision))
    return pinocchio.Motion(_six(spatial, "pinocchio.to_spatial_acceleration"))


def from_classical_acceleration(A):
    """SpatialAcceleration of a Motion that holds the classical one, from `getFrameClassicalAcceleration`. Exact."""
    return SpatialAcceleration(A.angular, A.linear)


def to_classical_acceleration(A):
    """A Motion that holds the classical acceleration, as `getFrameClassicalAcceleration` returns, of a single one."""
    import pinocchio

    return pinocchio.Motion(_six(A, "pinocchio.to_classical_acceleration"))


# -- reference frames -------------------------------------------------------------------------------------------------


def from_world(X_WB, x_Wo_W, w=None, *, precision=None):
    """ReferenceFrame.WORLD as LOCAL: about the origin of the world, in its axes, as about Bo in the axes of B.

    x_Wo_W: any of the four kinds; an acceleration, that of the body's point at Wo, with w, in W. As `act_inverse`.
    """
    return act_inverse(X_WB, x_Wo_W, w, precision=precision)


def to_world(X_WB, x_Bo_B, w=None, *, precision=None):
    """ReferenceFrame.LOCAL as WORLD: about Bo in the axes of B, as about the world's origin in its axes. As `act`."""
    return act(X_WB, x_Bo_B, w, precision=precision)


def from_local_world_aligned(X_WB, x_Bo_W, *, precision=None):
    """ReferenceFrame.LOCAL_WORLD_ALIGNED as LOCAL: about Bo, in the axes of the world, as in those of B."""
    return rotate(X_WB.rotation.inverse(), x_Bo_W, precision=precision)


def to_local_world_aligned(X_WB, x_Bo_B, *, precision=None):
    """ReferenceFrame.LOCAL as LOCAL_WORLD_ALIGNED: about Bo, in the axes of B, as in those of the world."""
    return rotate(X_WB.rotation, x_Bo_B, precision=precision)


# -- frames -----------------------------------------------------------------------------------------------------------


def from_se3(X_AB):
    """RigidTransform of a pinocchio.SE3, such as `data.oMi[i]`. Exact; a copy, while SE3 hands out its own memory."""
    return RigidTransform(Rotation.from_matrix(np.array(X_AB.rotation)), np.array(X_AB.translation))


def to_se3(X_AB):
    """pinocchio.SE3 of a single RigidTransform, the rotation taken as it is (`SE3.normalize` repairs it)."""
    import pinocchio

    R = orders.single(X_AB.rotation.entries, "pinocchio.to_se3").reshape(3, 3)
    return pinocchio.SE3(R, orders.single(X_AB.translation, "pinocchio.to_se3"))


def from_free_flyer_configuration(q7, *, precision=None):
    """X_WB from the seven numbers (*batch, 7) [p_WB; xyzw] of JointModelFreeFlyer in q, also `SE3ToXYZQUAT`."""
    return orders.pose_from_xyz_xyzw(q7, precision=precision)


def to_free_flyer_configuration(X_WB, *, precision=None):
    """The seven numbers (*batch, 7) [p_WB; xyzw] of JointModelFreeFlyer in q, the real part not negative."""
    return orders.pose_to_xyz_xyzw(X_WB, precision=precision)


def from_free_flyer_velocity(v6):
    """V_WBo_B from the six numbers (*batch, 6) [v; w] of JointModelFreeFlyer in v, both in the axes of B."""
    return orders.from_linear_first(SpatialVelocity, v6)


def to_free_flyer_velocity(V_WBo_B):
    """The six numbers (*batch, 6) [v; w] of JointModelFreeFlyer in v."""
    return orders.to_linear_first(V_WBo_B)


# -- inertia ----------------------------------------------------------------------------------------------------------
# Its ten dynamic parameters, as arrays, are `SpatialInertia.from_dynamic_parameters` and `to_dynamic_parameters`.


def from_inertia(Y):
    """SpatialInertia of a pinocchio.Inertia, which holds mass, lever (com) and the central inertia. Exact."""
    return SpatialInertia(Y.mass, np.array(Y.lever), np.array(Y.inertia))


def to_inertia(M):
    """pinocchio.Inertia of a single SpatialInertia, as it is: Pinocchio's constructor would refuse one that rounding
    has made a little indefinite, like that of a rod."""
    import pinocchio

    mass, com, central = (orders.single(x, "pinocchio.to_inertia") for x in (*M._vectors[:2], _nine(M)))
    Y = pinocchio.Inertia.Zero()
    Y.mass, Y.lever, Y.inertia = mass[0], com, central.reshape(3, 3)
    return Y


def from_pseudo_inertia(J, *, precision=None):
    """SpatialInertia of a pinocchio.PseudoInertia. Errors as of `SpatialInertia.from_pseudo_inertia`."""
    return SpatialInertia.from_pseudo_inertia(np.array(J.toMatrix()), precision=precision)


def to_pseudo_inertia(M, *, precision=None):
    """pinocchio.PseudoInertia of a single SpatialInertia. Errors as of `SpatialInertia.to_pseudo_inertia`."""
    import pinocchio

    J = M.to_pseudo_inertia(precision=precision)
    entries = orders.single(J.reshape((*J.shape[:-2], 16)), "pinocchio.to_pseudo_inertia")
    return pinocchio.PseudoInertia.FromMatrix(entries.reshape(4, 4))


def from_log_cholesky(theta, *, precision=None):
    """SpatialInertia of a pinocchio.LogCholeskyParameters. Errors as of `SpatialInertia.from_log_cholesky`."""
    return SpatialInertia.from_log_cholesky(np.array(theta.parameters), precision=precision)


def to_log_cholesky(M, *, precision=None):
    """pinocchio.LogCholeskyParameters, which Pinocchio has no way to make of an inertia, of a single SpatialInertia."""
    import pinocchio

    theta10 = orders.single(M.to_log_cholesky(precision=precision), "pinocchio.to_log_cholesky")
    return pinocchio.LogCholeskyParameters(theta10)


def _nine(M):
    return M.central_matrix().reshape((*M.batch_shape, 9))


def _six(x, name):
    return orders.single(orders.to_linear_first(x), name)
