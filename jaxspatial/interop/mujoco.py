"""MuJoCo: arrays of mjData and mjModel, of the C library as of MJX, and states of a whole Mechanism.

MuJoCo has two orders of components. Inside, the rotational part comes first, as here: cvel, cacc, cdof, cfrc_int,
cfrc_ext. All of them are in the world's axes, about the centre of mass of the whole tree that the body belongs to,
point C = `subtree_com[body_rootid[i]]`: `shift(x, xpos[i] - C)` moves them to the body's origin. At the surface, force
comes first: xfrc_applied, mj_contactForce. Quaternions are wxyz. Arrays are (*batch, n), so that a field of mjData can
be taken whole; a shape that does not fit raises ValueError.

Functions of states take a mechanism with joints that MuJoCo has, in its order. They raise TypeError where the first
argument is no Mechanism or dtypes differ, and ValueError where MuJoCo has no joints of a kind. MuJoCo has coordinates
for mimics: `to_` functions compute them, `from_` functions leave them out.

Read: MuJoCo's engine_core_smooth.c, mujoco 4.0, mjx 3.17.
"""

import itertools
from collections.abc import Mapping
from types import SimpleNamespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import bodies, orders
from jaxspatial.interop.orders import K
from jaxspatial.mechanism import AppliedForces, Mechanism
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.check import require_kind
from jaxspatial.numerics.errorfree.primitives import computed_at_once
from jaxspatial.numerics.quantity import require_compatible
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.rotation.rotation import rotated
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialVelocity, act, rotate
from jaxspatial.spatial.vectors import SpatialVector, side_by_side

# [xx, yy, zz, xy, xz, yz, m c, m] in ours, [m, m c, xx, xy, yy, xz, yz, zz], and back. Of int32: JAX 0.10 caches what
# it makes of an array of int64, and fails when 64-bit types are switched on later.
_FROM_CINERT = np.array([9, 6, 7, 8, 0, 3, 1, 4, 5, 2], np.int32)
_TO_CINERT = np.argsort(_FROM_CINERT).astype(np.int32)
# The principal axes in reverse, the last one negated so that they stay right-handed.
_REVERSED = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])

# -- accelerations and contact forces of bodies ------------------------------------------------------------------------


def from_cacc(
    cacc: ArrayLike, cvel: ArrayLike, gravity: ArrayLike, *, precision: PrecisionName = None
) -> SpatialAcceleration:
    """Reads mjData.cacc, which is there after mj_rnePostConstraint: a = cacc[3:] + gravity + w x v.

    MuJoCo's is Featherstone's acceleration, about C at rest, less gravity: -gravity for the world body, 0 in free fall.

    Args:
        cacc: (*batch, 6) [alpha; a], rad/s2, m/s2.
        cvel: (*batch, 6) [w; v] of mjData, rad/s, m/s.
        gravity: (3,) of mjOption, m/s2.
        precision: name of a precision; None takes the default.

    Returns:
        A_WC_W (*batch,) of the body's point at C, classical.

    Error: as of `SpatialAcceleration.from_featherstone`.

    Example:
        >>> cacc, cvel, gravity = np.float32([0, 0, 0, 0, 0, 9.81]), np.zeros(6, np.float32), np.float32([0, 0, -9.81])
        >>> js.interop.mujoco.from_cacc(cacc, cvel, gravity)  # of a body at rest
        SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[0.0, 0.0, 0.0])
    """
    spatial = from_object_acceleration(cacc, gravity).to_array()
    return SpatialAcceleration.from_featherstone(spatial, SpatialVelocity.from_array(cvel), precision=precision)


def to_cacc(
    A_WC_W: SpatialAcceleration, V_WC_W: SpatialVelocity, gravity: ArrayLike, *, precision: PrecisionName = None
) -> jax.Array:
    """Makes mjData.cacc: (alpha, a - w x v - gravity).

    Args:
        A_WC_W: of the body's point at C (*batch,), classical.
        V_WC_W: of the same point.
        gravity: (3,) of mjOption, m/s2.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 6) [alpha; a], rad/s2, m/s2.

    Error: as of `SpatialAcceleration.to_featherstone`.

    Example:
        >>> A, V = js.SpatialAcceleration.zero(dtype=np.float32), js.SpatialVelocity.zero(dtype=np.float32)
        >>> print(js.interop.mujoco.to_cacc(A, V, np.float32([0, 0, -9.81])))
        [0.   0.   0.   0.   0.   9.81]
    """
    spatial = A_WC_W.to_featherstone(V_WC_W, precision=precision)
    return to_object_acceleration(SpatialAcceleration.from_array(spatial), gravity)


def from_object_acceleration(x6: ArrayLike, gravity: ArrayLike) -> SpatialAcceleration:
    """Reads what mj_objectAcceleration gives with flg_local = 0.

    Args:
        x6: (*batch, 6) [alpha; a - gravity], rad/s2, m/s2.
        gravity: (3,) of mjOption, m/s2.

    Returns:
        A_WP_W (*batch,) of the object's origin P, classical.

    Error: a sum, rounded once.

    Example:
        >>> js.interop.mujoco.from_object_acceleration(np.float32([0, 0, 0, 0, 0, 9.81]), np.float32([0, 0, -9.81]))
        SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[0.0, 0.0, 0.0])
    """
    A_WP_W = SpatialAcceleration.from_array(x6)
    return A_WP_W + _of_gravity(gravity, A_WP_W)


def to_object_acceleration(A_WP_W: SpatialAcceleration, gravity: ArrayLike) -> jax.Array:
    """Makes what mj_objectAcceleration gives with flg_local = 0: (*batch, 6) [alpha; a - gravity].

    Args:
        A_WP_W: of the object's origin P (*batch,), classical.
        gravity: (3,) of mjOption, m/s2.

    Error: a difference, rounded once.

    Example:
        >>> A = js.SpatialAcceleration.zero(dtype=np.float32)
        >>> print(js.interop.mujoco.to_object_acceleration(A, np.float32([0, 0, -9.81])))
        [ 0.    0.    0.   -0.   -0.    9.81]
    """
    return (A_WP_W - _of_gravity(gravity, A_WP_W)).to_array()


def _of_gravity(gravity: ArrayLike, like: SpatialAcceleration) -> SpatialAcceleration:
    a = floats.as_vectors(gravity, "gravity", like.dtype)
    return SpatialAcceleration(0 * a, a)


def from_contact_force(force: ArrayLike, frame: ArrayLike, *, precision: PrecisionName = None) -> SpatialForce:
    """Reads what mj_contactForce gives.

    Args:
        force: (*batch, 6) [f; tau] along the axes of the contact, N, N m.
        frame: (*batch, 9) or (*batch, 3, 3) of the contact: its axes by rows, the first of them the normal from geom1
            to geom2.
        precision: name of a precision; None takes the default.

    Returns:
        F_P_W (*batch,), about the contact's `pos` in the world's axes, on the body of its second geom; on that of the
        first acts -F.

    Error: as of `rotate`.

    Example:
        >>> frame = np.float32([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # the normal is z
        >>> js.interop.mujoco.from_contact_force(np.float32([5, 0, 0, 0, 0, 0]), frame).f
        Array([0., 0., 5.], dtype=float32)
    """
    return rotate(_rotation(frame).inverse(), orders.from_linear_first(SpatialForce, force), precision=precision)


def to_contact_force(F_P_W: SpatialForce, frame: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """Makes what mj_contactForce gives, (*batch, 6) [f; tau] along the axes of the contact: see `from_contact_force`.

    Error: as of `rotate`.

    Example:
        >>> frame = jnp.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
        >>> print(js.interop.mujoco.to_contact_force(js.SpatialForce(f=[0.0, 0.0, 5.0]), frame))
        [5. 0. 0. 0. 0. 0.]
    """
    return orders.to_linear_first(rotate(_rotation(frame), F_P_W, precision=precision))


def _rotation(matrix: ArrayLike) -> Rotation:
    """Of (*batch, 9) in C or (*batch, 3, 3) in MJX, row by row."""
    m = floats.as_float_array(matrix, "mujoco: matrix", keep_dtype=True)
    return Rotation.from_matrix(m if m.shape[-1] == 3 else m.reshape((*m.shape[:-1], 3, 3)))


# -- wrenches on bodies ------------------------------------------------------------------------------------------------


def to_xfrc_applied(
    model, mechanism: Mechanism, q: ArrayLike, forces: ExternalForces, *, precision: PrecisionName = None
) -> jax.Array:
    """Makes mjData.xfrc_applied: [f; tau] on each body, about its centre of mass, in world axes.

        tau_Bcm = tau_Bo - R_WB ipos x f

    R_WB is that of q. `xipos` of mjx.Data is not read: until `mjx.kinematics` runs again it is that of the step before.
    A body welded to another is a frame of that body here, and the wrench acts on that body. The motion is the same;
    MuJoCo's force sensors between the two do not see the wrench.

    Args:
        model: a mujoco.MjModel or mjx.Model, whose bodies have the names of the bodies of the mechanism, as
            `Mechanism.from_mjcf` gives them; `body_ipos` may be data.
        mechanism: with the joints of the model, read from the same file or from another one of the same robot.
        q: (*batch, nq) our coordinates, see `from_qpos`.
        forces: as `external_forces` of `forward_dynamics`: a dict of SpatialForces by name of a frame, or
            AppliedForces.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, model.nbody, 6) [f; tau], N, N m; zeros of bodies without a wrench.

    Raises:
        KeyError: there is no such frame, or MuJoCo has no body with the name of the body that carries it.

    Error: as of `applied_wrenches`, then of a rotation and of `shift`.

    Example:
        >>> import mujoco
        >>> xml = '<body name="ball"><freejoint/><geom size=".1" pos="0 0 .5"/></body>'
        >>> xml = f"<mujoco><worldbody>{xml}</worldbody></mujoco>"
        >>> model, ball = mujoco.MjModel.from_xml_string(xml), js.Mechanism.from_mjcf(xml)
        >>> push = js.SpatialForce(f=[1.0, 0.0, 0.0])  # about the origin of the body, 0.5 m below the centre of mass
        >>> print(js.interop.mujoco.to_xfrc_applied(model, ball, ball.neutral(), {"ball": push})[1])
        [ 1.   0.   0.   0.  -0.5  0. ]
    """
    require_kind(mechanism, Mechanism, "mujoco.to_xfrc_applied", " second")
    names = _body_names(model)

    def row(name: str) -> int:
        if name not in names:
            near = check.did_you_mean(name, names)
            raise KeyError(f"mujoco.to_xfrc_applied: the model has no body {name!r}{near}")
        return names.index(name)

    return bodies.to_rows(mechanism, q, forces, row, model.body_ipos, precision)


def from_xfrc_applied(model, xfrc_applied: ArrayLike) -> AppliedForces:
    """Reads mjData.xfrc_applied as `external_forces`, exactly.

    Args:
        model: a mujoco.MjModel or mjx.Model. Bodies without a name are "body_<id>", as `Mechanism.from_mjcf` has it.
        xfrc_applied: (*batch, model.nbody, 6) [f; tau] about centres of mass, in world axes, N, N m.

    Returns:
        AppliedForces (*batch,) on all bodies but the world, each at its centre of mass `body_ipos`, in world axes.

    Example:
        >>> import mujoco
        >>> xml = '<body name="ball"><freejoint/><geom size=".1" pos="0 0 .5"/></body>'
        >>> model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{xml}</worldbody></mujoco>")
        >>> forces = js.interop.mujoco.from_xfrc_applied(model, np.eye(2, 6, dtype=np.float32))
        >>> print(forces.frames, forces.points, forces.wrenches.f)
        ('ball',) [[0.  0.  0.5]] [[0. 1. 0.]]
    """
    six = floats.as_vectors(
        xfrc_applied, "mujoco.from_xfrc_applied: xfrc_applied", size=6, many=["nbody"], keep_dtype=True
    )
    if six.shape[-2] != model.nbody:
        raise ValueError(f"mujoco.from_xfrc_applied: expected shape (*batch, {model.nbody}, 6), got {six.shape}")
    return bodies.from_rows(_body_names(model)[1:], six[..., 1:, :], model.body_ipos[..., 1:, :])


def _body_names(model) -> tuple[str, ...]:
    """Of all bodies; mjx.Model has no accessors by index. Where there is no name: as `Mechanism.from_mjcf` has it."""
    starts = np.asarray(model.name_bodyadr).tolist()
    found = [model.names[start : model.names.index(b"\0", start)].decode() for start in starts]
    return tuple(name or f"body_{i}" for i, name in enumerate(found))


# -- one free joint: linear part in world axes, then angular part in body axes -----------------------------------------


def from_free_joint(kind: type[K], x6: ArrayLike, R_WB: Rotation, *, precision: PrecisionName = None) -> K:
    """Reads the numbers of a free joint in qvel, qacc, qfrc_applied and the like.

    Args:
        kind: SpatialVelocity for qvel, SpatialAcceleration for qacc, SpatialForce for generalized forces.
        x6: (*batch, 6) [v in world axes; w in body axes], [a; alpha] or [f; tau].
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        V_WBo_W, A_WBo_W (classical) or F_Bo_W (*batch,), of or about the body's origin, in world axes.

    Error: as of `rotate`.

    Example:
        >>> turned = js.Rotation.from_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        >>> js.interop.mujoco.from_free_joint(js.SpatialVelocity, jnp.arange(1.0, 7.0), turned)
        SpatialVelocity(w=[-5.0, 4.0, 6.0], v=[1.0, 2.0, 3.0])
    """
    x = orders.from_linear_first(kind, x6)
    return kind(rotated(R_WB, x.rotational, precision=precision), x.translational)


def to_free_joint(x_Bo_W: SpatialVector, R_WB: Rotation, *, precision: PrecisionName = None) -> jax.Array:
    """Makes the numbers of a free joint in qvel, qacc, qfrc_applied and the like.

    Args:
        x_Bo_W: V_WBo_W, A_WBo_W (classical) or F_Bo_W (*batch,), of or about the body's origin, in world axes.
        R_WB: the orientation of the body (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 6) [v in world axes; w in body axes], [a; alpha] or [f; tau].

    Error: as of `rotate`.

    Example:
        >>> turned = js.Rotation.from_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        >>> print(js.interop.mujoco.to_free_joint(V, turned))
        [0.5 0.  0.  0.  0.  1. ]
    """
    return side_by_side(x_Bo_W.translational, rotated(R_WB.inverse(), x_Bo_W.rotational, precision=precision))


# -- inertias of bodies ------------------------------------------------------------------------------------------------


def from_cinert(cinert: ArrayLike, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads mjData.cinert or crb.

    Args:
        cinert: (*batch, 10) [xx, yy, zz, xy, xz, yz, m c, m], the inertia about C too; kg m2, kg m, kg.
        precision: name of a precision; None takes the default.

    Returns:
        M_BC_W (*batch,), about C in the world's axes.

    Error: as of `SpatialInertia.from_dynamic_parameters`, which says what cancels.

    Example:
        >>> ten = np.float32([0.5, 0.4, 0.3, 0, 0, 0, 0, 0, 0, 2.0])
        >>> js.interop.mujoco.from_cinert(ten).mass
        array(2., dtype=float32)
    """
    ten = floats.as_vectors(cinert, "mujoco.from_cinert: cinert", size=10)
    return SpatialInertia.from_dynamic_parameters(ten[..., _FROM_CINERT], precision=precision)


def to_cinert(M_BC_W: SpatialInertia, *, precision: PrecisionName = None) -> jax.Array:
    """Makes mjData.cinert or crb, (*batch, 10) [xx, yy, zz, xy, xz, yz, m c, m], of an inertia about C in world axes.

    Error: as of `SpatialInertia.to_dynamic_parameters`.

    Example:
        >>> print(js.interop.mujoco.to_cinert(rod)[-2:])  # of 2 kg, 0.5 m below its end
        [-1.  2.]
    """
    return M_BC_W.to_dynamic_parameters(precision=precision)[..., _TO_CINERT]


def from_body_inertia(
    body_mass: ArrayLike,
    body_inertia: ArrayLike,
    body_ipos: ArrayLike,
    body_iquat: ArrayLike,
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

    Error: as of `act` of an inertia.

    Example:
        >>> moments, ipos, iquat = np.float32([3, 2, 1]), np.float32([0, 0, 1]), np.float32([1, 0, 0, 0])
        >>> M_BBo_B = js.interop.mujoco.from_body_inertia(np.float32(2.0), moments, ipos, iquat)
        >>> print(M_BBo_B.com, M_BBo_B.central)
        [0. 0. 1.] [3. 0. 2. 0. 0. 1.]
    """
    X_BI = RigidTransform(Rotation.from_quaternion(body_iquat, precision=precision), body_ipos)
    moments = floats.as_vectors(body_inertia, "mujoco.from_body_inertia: body_inertia", X_BI.dtype)
    is_moment = np.array([1, 0, 1, 0, 0, 1], X_BI.dtype)
    diagonal = moments[..., np.array([0, 0, 1, 0, 0, 2])] * np.broadcast_to(is_moment, (*moments.shape[:-1], 6))
    principal = SpatialInertia(body_mass, np.zeros(3, X_BI.dtype), diagonal)
    return act(X_BI, principal, precision=precision)


def to_body_inertia(
    M_BBo_B: SpatialInertia, *, precision: PrecisionName = None
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Makes mjModel's body_mass, body_inertia, body_ipos and body_iquat, moments descending as its compiler sorts them.

    Args:
        M_BBo_B: about the body's origin in its axes (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The four arrays, as `from_body_inertia` takes them.

    Error: as of `SpatialInertia.principal_moments_and_axes`.

    Example:
        >>> box = js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=6.0)
        >>> mass, moments, ipos, iquat = js.interop.mujoco.to_body_inertia(box)
        >>> print(mass, moments, ipos)
        6.0 [6.5 5.  2.5] [0. 0. 0.]
    """
    moments, R_BA = M_BBo_B.principal_moments_and_axes(precision=precision)
    R_BI = R_BA @ Rotation.from_matrix(_REVERSED.astype(R_BA.dtype))
    return M_BBo_B.mass, moments[..., ::-1], M_BBo_B.com, R_BI.to_quaternion(precision=precision)


# -- states of a whole Mechanism ---------------------------------------------------------------------------------------


def to_qpos(mechanism: Mechanism, q: ArrayLike) -> jax.Array:
    """Makes mjData.qpos (*batch, model.nq), exact but for mimics.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.

    Example:
        >>> print(js.interop.mujoco.to_qpos(arm, q))  # of hinges it is q
        [ 0.5 -0.2]
    """
    joints, state = _arguments("mujoco.to_qpos", mechanism, q=q)
    return _of_joints(state.q, [j.rolled(j.followed(state.q[..., j.q], with_offset=True), 4) for j in joints])


def from_qpos(mechanism: Mechanism, qpos: ArrayLike) -> jax.Array:
    """Reads mjData.qpos as q (*batch, nq), exactly.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        qpos: (*batch, model.nq).

    Example:
        >>> print(js.interop.mujoco.from_qpos(arm, jnp.array([0.5, -0.2])))
        [ 0.5 -0.2]
    """
    joints, state = _arguments("mujoco.from_qpos", mechanism, qpos=qpos)
    return _of_joints(state.qpos, [j.rolled(state.qpos[..., j.qpos], 3) for j in joints if not j.is_mimic])


class KeyFrame(NamedTuple):
    """A state that a file names. q: (nq,), v: (nv,), ctrl: one number for each of `Actuators.from_mjcf`.

    Example:
        >>> part = '<body><joint name="hinge"/><geom size="0.1"/></body>'
        >>> text = f'<mujoco><worldbody>{part}</worldbody><keyframe><key name="up" qpos="0.5"/></keyframe></mujoco>'
        >>> frames = js.interop.mujoco.key_frames(js.Mechanism.from_mjcf(text), text)
        >>> print(frames["up"].q, frames["up"].v)
        [0.5] [0.]
    """

    q: np.ndarray
    v: np.ndarray
    ctrl: np.ndarray


def key_frames(mechanism: Mechanism, path_or_text, *, assets: Mapping[str, bytes] | None = None) -> dict[str, KeyFrame]:
    """Reads the key frames of an MJCF, `<key>`, by their names; one without a name is "key_<id>".

        q, v, ctrl = js.interop.mujoco.key_frames(mech, "dog.xml")["home"]

    Args:
        mechanism: that of the file.
        path_or_text: a path; the text itself; a mujoco.MjSpec, or a mujoco.MjModel.
        assets: files that the text names, by their names.

    Returns:
        {name: KeyFrame}, NumPy in the dtype of the mechanism.

    Raises:
        ValueError: MuJoCo does not compile the file, or the mechanism has other joints.

    Error: of q none, of v that of `from_qvel`.

    Example:
        >>> xml = '<worldbody><body><joint axis="0 0 1"/><geom size=".1"/></body></worldbody>'
        >>> xml = f'<mujoco>{xml}<keyframe><key name="home" qpos="0.5"/></keyframe></mujoco>'
        >>> js.interop.mujoco.key_frames(js.Mechanism.from_mjcf(xml), xml)["home"].q
        array([0.5], dtype=float32)
    """
    from jaxspatial.mechanism.formats import mjcf

    found = dict[str, KeyFrame]()
    with computed_at_once():  # of known numbers, also while somebody traces
        for part in mjcf.read_key_frames(path_or_text, assets):
            qpos, qvel, ctrl = (x.astype(mechanism.dtype) for x in part[1:])
            q = from_qpos(mechanism, qpos)
            found[part.name] = KeyFrame(np.asarray(q), np.asarray(from_qvel(mechanism, q, qvel)), ctrl)
    return found


def to_qvel(mechanism: Mechanism, q: ArrayLike, v: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """Makes mjData.qvel (*batch, model.nv).

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        v: (*batch, nv) our generalized velocities.
        precision: name of a precision; None takes the default.

    Error: of a free joint as of `rotate`; else exact but for mimics.

    Example:
        >>> print(js.interop.mujoco.to_qvel(arm, q, v))
        [1.  0.5]
    """
    joints, state = _arguments("mujoco.to_qvel", mechanism, q=q, v=v)
    return _of_joints(state.q, [j.in_world(state.q, j.followed(state.v[..., j.v]), precision) for j in joints])


def from_qvel(mechanism: Mechanism, q: ArrayLike, qvel: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """Reads mjData.qvel as v (*batch, nv).

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        qvel: (*batch, model.nv).
        precision: name of a precision; None takes the default.

    Error: of a free joint as of `rotate`; else exact.

    Example:
        >>> print(js.interop.mujoco.from_qvel(arm, q, jnp.array([1.0, 0.5])))
        [1.  0.5]
    """
    joints, state = _arguments("mujoco.from_qvel", mechanism, q=q, qvel=qvel)
    return _of_joints(
        state.q, [j.in_body(state.q, state.qvel[..., j.qvel], precision) for j in joints if not j.is_mimic]
    )


def to_qacc(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, vdot: ArrayLike, *, precision: PrecisionName = None
) -> jax.Array:
    """Makes mjData.qacc (*batch, model.nv).

    MuJoCo's linear acceleration of a free joint is that of the body's origin in world axes, R (dv/dt + w x v).

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        v: (*batch, nv) our generalized velocities.
        vdot: (*batch, nv), the derivatives of v.
        precision: name of a precision; None takes the default.

    Error: of a free joint as of `SpatialAcceleration.from_featherstone` and `rotate`; else exact but for mimics.

    Example:
        >>> print(js.interop.mujoco.to_qacc(arm, q, v, jnp.array([3.0, 1.0])))
        [3. 1.]
    """
    joints, state = _arguments("mujoco.to_qacc", mechanism, q=q, v=v, vdot=vdot)
    parts: list[jax.Array] = []
    for joint in joints:
        a = joint.followed(state.vdot[..., joint.v])
        if joint.is_free:
            V = SpatialVelocity.from_array(state.v[..., joint.v])
            a = SpatialAcceleration.from_featherstone(a, V, precision=precision).to_array()
        parts.append(joint.in_world(state.q, a, precision))
    return _of_joints(state.q, parts)


def from_qacc(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, qacc: ArrayLike, *, precision: PrecisionName = None
) -> jax.Array:
    """Reads mjData.qacc as vdot (*batch, nv), the derivatives of v.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        v: (*batch, nv) our generalized velocities.
        qacc: (*batch, model.nv).
        precision: name of a precision; None takes the default.

    Error: of a free joint as of `rotate` and `SpatialAcceleration.to_featherstone`; else exact.

    Example:
        >>> print(js.interop.mujoco.from_qacc(arm, q, v, jnp.array([3.0, 1.0])))
        [3. 1.]
    """
    joints, state = _arguments("mujoco.from_qacc", mechanism, q=q, v=v, qacc=qacc)
    parts: list[jax.Array] = []
    for joint in (j for j in joints if not j.is_mimic):
        a = joint.in_body(state.q, state.qacc[..., joint.qvel], precision)
        if joint.is_free:
            V = SpatialVelocity.from_array(state.v[..., joint.v])
            a = SpatialAcceleration.from_array(a).to_featherstone(V, precision=precision)
        parts.append(a)
    return _of_joints(state.q, parts)


def to_qfrc(mechanism: Mechanism, q: ArrayLike, tau: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """Makes generalized forces of MuJoCo (*batch, model.nv), such as qfrc_applied, with the same power; 0 on mimics.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        tau: (*batch, nv) our generalized forces, N m or N.
        precision: name of a precision; None takes the default.

    Error: of a free joint as of `rotate`; else exact.

    Example:
        >>> print(js.interop.mujoco.to_qfrc(arm, q, tau))
        [10.  2.]
    """
    joints, state = _arguments("mujoco.to_qfrc", mechanism, q=q, tau=tau)
    parts = ((j, state.tau[..., j.v]) for j in joints)
    return _of_joints(state.q, [0 * part if j.is_mimic else j.in_world(state.q, part, precision) for j, part in parts])


def from_qfrc(mechanism: Mechanism, q: ArrayLike, qfrc: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """Reads generalized forces of MuJoCo, such as qfrc_inverse or qfrc_bias, as tau (*batch, nv), with the same power.

    What acts on a mimic acts, times its multiplier, on the joint that it follows.

    Args:
        mechanism: with joints that MuJoCo has, in its order.
        q: (*batch, nq) our coordinates.
        qfrc: (*batch, model.nv), N m or N.
        precision: name of a precision; None takes the default.

    Error: of a free joint as of `rotate`; else exact but for mimics.

    Example:
        >>> print(js.interop.mujoco.from_qfrc(arm, q, jnp.array([10.0, 2.0])))
        [10.  2.]
    """
    joints, state = _arguments("mujoco.from_qfrc", mechanism, q=q, qfrc=qfrc)
    by_start = {j.v.start: j.in_body(state.q, state.qfrc[..., j.qvel], precision) for j in joints if not j.is_mimic}
    for joint in (j for j in joints if j.is_mimic):
        by_start[joint.v.start] = by_start[joint.v.start] + joint.followed(state.qfrc[..., joint.qvel])
    return _of_joints(state.q, [by_start[start] for start in sorted(by_start)])


class _Joint:
    """One joint: its slices of q, v, qpos and qvel, and the conversions of its part of a state."""

    def __init__(self, mechanism: Mechanism, i: int, qpos: slice, qvel: slice, dtype: np.dtype):
        t = mechanism.topology
        if t.kinds[i] not in ("free", "ball", "prismatic", "revolute", "continuous"):
            raise ValueError(f"mujoco: MuJoCo has no joints like {t.joint_names[i]!r}: {t.kinds[i]}")
        self.q, self.v, self.qpos, self.qvel = t.q_slice(i), t.v_slice(i), qpos, qvel
        self.is_free, self.is_mimic = t.kinds[i] == "free", t.is_mimic(i)
        self.multiplier, self.offset = (mechanism.mimics[i, k : k + 1].astype(dtype) for k in (0, 1))

    def followed(self, x: jax.Array, with_offset: bool = False) -> jax.Array:
        """Of a mimic multiplier x + offset, with x the part of the joint that it follows; of other joints x."""
        if not self.is_mimic:
            return x
        multiplier, offset = (jnp.broadcast_to(y, x.shape) for y in (self.multiplier, self.offset))
        return multiplier * x + offset if with_offset else multiplier * x

    def rolled(self, x: jax.Array, n: int) -> jax.Array:
        """Of a free joint with its first n numbers, the quaternion or the position, at the end."""
        return jnp.concatenate([x[..., n:], x[..., :n]], -1) if self.is_free else x

    def in_world(self, q: jax.Array, x: jax.Array, precision: PrecisionName) -> jax.Array:
        """Of a free joint [linear in world axes; angular in body axes] of [angular; linear], both in body axes."""
        if not self.is_free:
            return x
        return side_by_side(rotated(self._R_WB(q, precision), x[..., 3:], precision=precision), x[..., :3])

    def in_body(self, q: jax.Array, x: jax.Array, precision: PrecisionName) -> jax.Array:
        """Back of `in_world`."""
        if not self.is_free:
            return x
        return side_by_side(x[..., 3:], rotated(self._R_WB(q, precision).inverse(), x[..., :3], precision=precision))

    def _R_WB(self, q: jax.Array, precision: PrecisionName) -> Rotation:
        return Rotation.from_quaternion(q[..., self.q][..., :4], precision=precision)


def _arguments(operation: str, mechanism: Mechanism, **arrays: ArrayLike) -> tuple[list[_Joint], SimpleNamespace]:
    """(all joints, the checked arrays by name, over one batch shape)."""
    require_kind(mechanism, Mechanism, operation, " first")
    kinds = [mechanism.topology.kind(i) for i in range(len(mechanism.topology))]
    qpos, qvel = ([0, *itertools.accumulate(sizes)] for sizes in ([k.nq for k in kinds], [k.nv for k in kinds]))
    sizes = {"q": mechanism.nq, "qpos": qpos[-1]} | dict.fromkeys(("qvel", "qacc", "qfrc"), qvel[-1])
    checked = {
        name: floats.as_vectors(x, f"{operation}: {name}", size=sizes.get(name, mechanism.nv))
        for name, x in arrays.items()
    }
    batch = require_compatible(**checked)
    dtype = next(iter(checked.values())).dtype
    slices = ([slice(a, b) for a, b in itertools.pairwise(ends)] for ends in (qpos, qvel))
    joints = [_Joint(mechanism, i, a, b, dtype) for i, (a, b) in enumerate(zip(*slices, strict=True))]
    return joints, SimpleNamespace(**dict(zip(checked, floats.broadcast_batch(batch, *checked.values()), strict=True)))


def _of_joints(like: jax.Array, parts: list[jax.Array]) -> jax.Array:
    """The parts side by side; of no joints an array without numbers."""
    return jnp.concatenate([like[..., :0], *parts], -1)
