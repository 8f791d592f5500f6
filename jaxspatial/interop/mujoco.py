"""MuJoCo: arrays of mjData and mjModel, of the C library as of MJX. It has two orders of components.

Inside, rotational part first: cvel, cacc, cdof, cfrc_int, cfrc_ext. All of them are in the world's axes, about the
centre of mass of the whole tree that the body belongs to, point C = `subtree_com[body_rootid[i]]`: move them to the
body's origin by `shift(x, xpos[i] - C)`. At the surface, force first: xfrc_applied, mj_contactForce. Quaternions are
wxyz. Arrays are (*batch, n), so that a field of mjData can be taken whole. Read: MuJoCo's engine_core_smooth.c, mujoco
4.0, mjx 3.17.
"""

import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.rotation.rotation import Rotation, rotated
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialVelocity, act, rotate

# -- inside: rotational first, about C, in the world's axes ------------------------------------------------------------


def from_cvel(cvel):
    """V_WC_W, of the body's point at C, of mjData.cvel (*batch, 6) [w; v]."""
    return SpatialVelocity.from_array(cvel)


def to_cvel(V_WC_W):
    """mjData.cvel (*batch, 6) [w; v]."""
    return V_WC_W.to_array()


def from_cdof(cdof):
    """V_WC_W per unit velocity of each degree of freedom, of mjData.cdof (nv, 6) [w; v]."""
    return SpatialVelocity.from_array(cdof)


def to_cdof(V_WC_W):
    """mjData.cdof (nv, 6) [w; v]."""
    return V_WC_W.to_array()


def from_cacc(cacc, cvel, gravity, *, precision=None):
    """A_WC_W of the body's point at C, classical, of mjData.cacc and cvel (*batch, 6): a = cacc[3:] + gravity + w x v.

    MuJoCo's is Featherstone's acceleration, about C at rest, less gravity: -gravity for the world body, 0 in free fall.
    gravity: (3,) of mjOption.  cacc is there after mj_rnePostConstraint.
    """
    cacc = SpatialAcceleration.from_array(cacc)
    falling = cacc + _falling(gravity, cacc.dtype)
    return SpatialAcceleration.from_featherstone(falling.to_array(), from_cvel(cvel), precision=precision)


def to_cacc(A_WC_W, V_WC_W, gravity, *, precision=None):
    """mjData.cacc (*batch, 6) of acceleration and velocity of the body's point at C: (alpha, a - w x v - gravity)."""
    spatial = SpatialAcceleration.from_array(A_WC_W.to_featherstone(V_WC_W, precision=precision))
    return (spatial - _falling(gravity, spatial.dtype)).to_array()


def from_object_acceleration(x6, gravity):
    """A_WP_W of the object's origin P, classical, of what mj_objectAcceleration gives with flg_local = 0: (*batch, 6)
    [alpha; a - gravity]."""
    A_WP_W = SpatialAcceleration.from_array(x6)
    return A_WP_W + _falling(gravity, A_WP_W.dtype)


def to_object_acceleration(A_WP_W, gravity):
    """What mj_objectAcceleration gives with flg_local = 0: (*batch, 6) [alpha; a - gravity]."""
    return (A_WP_W - _falling(gravity, A_WP_W.dtype)).to_array()


def from_cfrc(cfrc):
    """F_C_W of mjData.cfrc_int or cfrc_ext (*batch, 6) [tau; f]: on the body, by its parent or from outside."""
    return SpatialForce.from_array(cfrc)


def to_cfrc(F_C_W):
    """mjData.cfrc_int or cfrc_ext (*batch, 6) [tau; f]."""
    return F_C_W.to_array()


def _falling(gravity, dtype):
    gravity = check.as_vectors(gravity, "gravity", dtype)
    return SpatialAcceleration(0 * gravity, gravity)


# -- at the surface: force first ---------------------------------------------------------------------------------------


def from_xfrc_applied(xfrc_applied):
    """F_Bcm_W, about the body's centre of mass `xipos` in world axes, of mjData.xfrc_applied (*batch, 6) [f; tau]."""
    return orders.from_linear_first(SpatialForce, xfrc_applied)


def to_xfrc_applied(F_Bcm_W):
    """mjData.xfrc_applied (*batch, 6) [f; tau]. From the body's origin: `shift(F_Bo_W, xipos - xpos)`."""
    return orders.to_linear_first(F_Bcm_W)


def from_contact_force(force, frame, *, precision=None):
    """F_P_W, about the contact's `pos` in the world's axes, on the body of its second geom, of mj_contactForce.

    force: (*batch, 6) [f; tau] along the axes of the contact, the first of which is the normal from geom1 to geom2.
    frame: (*batch, 9) or (*batch, 3, 3) of the contact: these axes by rows. On the body of the first geom acts -F.
    """
    return rotate(_rotation(frame).inverse(), orders.from_linear_first(SpatialForce, force), precision=precision)


def to_contact_force(F_P_W, frame, *, precision=None):
    """mj_contactForce (*batch, 6) [f; tau] in the axes of the contact, of the wrench on the body of its second geom."""
    return orders.to_linear_first(rotate(_rotation(frame), F_P_W, precision=precision))


# -- frames ------------------------------------------------------------------------------------------------------------


def from_xpos_xquat(xpos, xquat, *, precision=None):
    """X_WB of mjData.xpos (*batch, 3) and xquat (*batch, 4) wxyz; also of mocap_pos, mocap_quat, and of mjModel's
    body_pos, body_quat (X_PB, of the parent) and body_ipos, body_iquat (X_BI, of the principal axes)."""
    xquat = check.as_vectors(xquat, "mujoco.from_xpos_xquat: xquat", size=4)
    return RigidTransform(Rotation.from_quaternion(xquat, precision=precision), xpos)


def to_xpos_xquat(X_WB, *, precision=None):
    """(xpos, xquat), the real part not negative."""
    return X_WB.translation, X_WB.rotation.to_quaternion(precision=precision)


def from_xpos_xmat(xpos, xmat):
    """X_WB of mjData.xpos (*batch, 3) and xmat, (*batch, 9) in C, (*batch, 3, 3) in MJX; also of ximat ... Exact."""
    return RigidTransform(_rotation(xmat), xpos)


def to_xpos_xmat(X_WB):
    """(xpos, xmat), xmat (*batch, 9)."""
    return X_WB.translation, X_WB.rotation.entries


def from_free_joint_qpos(qpos, *, precision=None):
    """X_WB of a free joint's (*batch, 7) [p_WB; wxyz] in qpos."""
    return orders.pose_from_xyz_wxyz(qpos, precision=precision)


def to_free_joint_qpos(X_WB, *, precision=None):
    """A free joint's (*batch, 7) [p_WB; wxyz] in qpos, the real part not negative."""
    return orders.pose_to_xyz_wxyz(X_WB, precision=precision)


def from_free_joint_qvel(qvel, R_WB, *, precision=None):
    """V_WBo_W of a free joint's (*batch, 6) in qvel: v of the origin in world axes, then w in body axes."""
    return _from_mixed(SpatialVelocity, qvel, R_WB, precision)


def to_free_joint_qvel(V_WBo_W, R_WB, *, precision=None):
    """A free joint's (*batch, 6) [v in world axes; w in body axes] in qvel."""
    return _to_mixed(V_WBo_W, R_WB, precision)


def from_free_joint_qacc(qacc, R_WB, *, precision=None):
    """A_WBo_W, classical, of a free joint's (*batch, 6) in qacc: a in world axes, then alpha in body axes."""
    return _from_mixed(SpatialAcceleration, qacc, R_WB, precision)


def to_free_joint_qacc(A_WBo_W, R_WB, *, precision=None):
    """A free joint's (*batch, 6) [a in world axes; alpha in body axes] in qacc."""
    return _to_mixed(A_WBo_W, R_WB, precision)


def from_free_joint_qfrc(qfrc, R_WB, *, precision=None):
    """F_Bo_W of a free joint's (*batch, 6) in qfrc_applied and its like: f in world axes, then tau in body axes."""
    return _from_mixed(SpatialForce, qfrc, R_WB, precision)


def to_free_joint_qfrc(F_Bo_W, R_WB, *, precision=None):
    """A free joint's (*batch, 6) [f in world axes; tau in body axes] in qfrc_applied."""
    return _to_mixed(F_Bo_W, R_WB, precision)


def _from_mixed(kind, x6, R_WB, precision):
    x = orders.from_linear_first(kind, x6)
    return kind(rotated(R_WB, x.rotational, precision=precision), x.translational)


def _to_mixed(x, R_WB, precision):
    turned = rotated(R_WB.inverse(), x.rotational, precision=precision)
    return orders.to_linear_first(type(x)(turned, x.translational))


def _rotation(matrix):
    """Of (*batch, 9) or (*batch, 3, 3), row by row."""
    matrix = check.as_float_array(matrix, "mujoco: matrix", held=True)
    return Rotation.from_matrix(matrix if matrix.shape[-1] == 3 else matrix.reshape((*matrix.shape[:-1], 3, 3)))


# -- inertia -----------------------------------------------------------------------------------------------------------

# [xx, yy, zz, xy, xz, yz, m c, m] in ours, [m, m c, xx, xy, yy, xz, yz, zz], and back. Of int32: JAX 0.10 caches what
# it makes of an array of int64, and fails when 64-bit types are switched on later.
_OF_CINERT = np.array([9, 6, 7, 8, 0, 3, 1, 4, 5, 2], np.int32)
_TO_CINERT = np.argsort(_OF_CINERT).astype(np.int32)
# The principal axes in reverse, the last turned round so that they stay right-handed.
_REVERSED = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])


def from_cinert(cinert, *, precision=None):
    """M_BC_W, about C in the world's axes, of mjData.cinert or crb (*batch, 10) [xx, yy, zz, xy, xz, yz, m c, m], the
    inertia in them about C too. Errors, and what cancels, as of `SpatialInertia.from_dynamic_parameters`."""
    cinert = check.as_vectors(cinert, "mujoco.from_cinert: cinert", size=10)
    return SpatialInertia.from_dynamic_parameters(cinert[..., _OF_CINERT], precision=precision)


def to_cinert(M_BC_W, *, precision=None):
    """mjData.cinert or crb (*batch, 10) of an inertia about C in the world's axes."""
    return M_BC_W.to_dynamic_parameters(precision=precision)[..., _TO_CINERT]


def from_body_inertia(body_mass, body_inertia, body_ipos, body_iquat, *, precision=None):
    """M_BBo_B, about the body's origin in its axes, of mjModel's body_mass (*batch,), body_inertia (*batch, 3), moments
    about principal axes, and the pose body_ipos (*batch, 3), body_iquat (*batch, 4) of these."""
    X_BI = from_xpos_xquat(body_ipos, body_iquat, precision=precision)
    moments = check.as_vectors(body_inertia, "mujoco.from_body_inertia: body_inertia", X_BI.dtype)
    is_moment = np.array([1, 0, 1, 0, 0, 1], X_BI.dtype)
    diagonal = moments[..., np.array([0, 0, 1, 0, 0, 2])] * np.broadcast_to(is_moment, (*moments.shape[:-1], 6))
    principal = SpatialInertia(body_mass, np.zeros(3, X_BI.dtype), diagonal)
    return act(X_BI, principal, precision=precision)


def to_body_inertia(M_BBo_B, *, precision=None):
    """(body_mass, body_inertia, body_ipos, body_iquat), moments descending as MuJoCo's compiler sorts them."""
    moments, R_BA = M_BBo_B.principal_moments_and_axes(precision=precision)
    R_BI = R_BA @ Rotation.from_matrix(_REVERSED.astype(R_BA.dtype))
    return M_BBo_B.mass, moments[..., ::-1], M_BBo_B.com, R_BI.to_quaternion(precision=precision)


def from_full_inertia(mass, pos, fullinertia):
    """M_BBo_B of MJCF's <inertial mass pos fullinertia>: [xx, yy, zz, xy, xz, yz] about the centre of mass, in body
    axes. Exact."""
    return SpatialInertia(mass, pos, orders.symmetric_from_diagonal_first(fullinertia))


def to_full_inertia(M_BBo_B):
    """(mass, pos, fullinertia) of MJCF's <inertial>. Exact."""
    return M_BBo_B.mass, M_BBo_B.com, orders.symmetric_to_diagonal_first(M_BBo_B.central)
