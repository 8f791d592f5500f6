"""Where bodies and frames are and how they move."""

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import noinline, where
from jaxspatial.dynamics import along, recursion
from jaxspatial.dynamics.algorithm import FRAMES, GEOMETRY, algorithm, checked
from jaxspatial.dynamics.links import Motion, across, angular_acceleration_tensor, motion_step, subspace_times
from jaxspatial.dynamics.state import Pose
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialVelocity


def forward_kinematics(mechanism, q, frames=None, *, precision=None):
    """X_WF of frames: a RigidTransform (*batch, n).

    mechanism: Mechanism; q (*batch, nq)
    frames: a sequence of `mechanism.frame_names`, in the order of results; `mechanism.body_names` for None
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    (q,) = checked("forward_kinematics", mechanism, q=q)
    entries, p = _forward_kinematics(precision, mechanism, q, frames=_places(mechanism, frames, "forward_kinematics"))
    return RigidTransform(Rotation(entries), p)


def body_velocities(mechanism, q, v, frames=None, *, precision=None):
    """V_WF_W of the origins of frames, in world axes: a SpatialVelocity (*batch, n).

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv); frames: see `forward_kinematics`
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    q, v = checked("body_velocities", mechanism, q=q, v=v)
    frames = _places(mechanism, frames, "body_velocities")
    return SpatialVelocity(*_body_velocities(precision, mechanism, q, v, frames=frames))


def body_accelerations(mechanism, q, v, vdot, frames=None, *, precision=None):
    """A_WF_W of the origins of frames, in world axes: a SpatialAcceleration (*batch, n), the time derivative of
    `body_velocities`, without gravity.

    mechanism: Mechanism; q (*batch, nq), v and vdot (*batch, nv); frames: see `forward_kinematics`
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    q, v, vdot = checked("body_accelerations", mechanism, q=q, v=v, vdot=vdot)
    frames = _places(mechanism, frames, "body_accelerations")
    return SpatialAcceleration(*_body_accelerations(precision, mechanism, q, v, vdot, frames=frames))


def jacobian(mechanism, q, body, *, precision=None):
    """J (*batch, 6, nv), rotational on top, with V_WF_W = J v for the origin of a body or frame, in world axes.

    mechanism: Mechanism; q (*batch, nq); body: one of `mechanism.frame_names`
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    (q,) = checked("jacobian", mechanism, q=q)
    return _jacobian(precision, mechanism, q, frame=_place(mechanism, body, "jacobian: body"))


def jacobian_rate(mechanism, q, v, body, *, precision=None):
    """dJ/dt (*batch, 6, nv) of `jacobian` along v: A_WF_W = J vdot + dJ/dt v.

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv); body: one of `mechanism.frame_names`
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    q, v = checked("jacobian_rate", mechanism, q=q, v=v)
    return _jacobian_rate(precision, mechanism, q, v, frame=_place(mechanism, body, "jacobian_rate: body"))


def _place(mechanism, name, what):
    return mechanism.topology.index(mechanism.frame_names, name, what)


def _places(mechanism, names, operation):
    if names is None:
        return None
    if isinstance(names, str):
        raise TypeError(f"{operation}: frames: expected a sequence of names, got the string {names!r}")
    return tuple(_place(mechanism, name, f"{operation}: frames") for name in names)


# -- poses ------------------------------------------------------------------------------------------------------------


def poses(state):
    """X_WJ of every bundle."""
    own = list(zip(map(state.placement, state.bundles), state.joints, strict=True))
    return recursion.outward(state, _pose, world(state), own)


def world(state):
    zero, one = (state.known(x) for x in (0.0, 1.0))
    return Pose(((one, zero, zero), (zero, one, zero), (zero, zero, one)), (zero, zero, zero))


def _pose(own, X_WP):
    X_WJ = composed(X_WP, across(*own))
    return X_WJ, X_WJ


def composed(X_AB, X_BC):
    p = vectors.plus(X_AB.p, vectors.matrix_times(X_AB.rows, X_BC.p))
    return Pose(vectors.product(X_AB.rows, X_BC.rows), p)


def _on_joints(state, frames, found, at_world):
    """[(X_JF, what was found for J)] of frames, or of all bodies, a bundle each, for None."""
    if frames is None:
        return list(zip(map(state.child_placement, state.bundles), found, strict=True))
    return [(state.frame_placement(k), _of_carrier(state, k, found, at_world)) for k in frames]


def _of_carrier(state, frame, found, at_world):
    """What was found for the joint that a frame is carried by."""
    return state.of_body(state.topology.frames[frame][1], found, at_world)


def _arranged(state, frames, found):
    """(frames, k, B) of tuples of k numbers: of bundles in the order of bodies, or one for each frame."""
    if frames is None:
        return state.by_body(found)
    return jnp.stack([jnp.stack([state.rounded(c).reshape((-1,)) for c in x]) for x in found])


@algorithm(*GEOMETRY, *FRAMES, entries=lambda t: 12 * len(t))
def _forward_kinematics(state, *, frames):
    found = [composed(X, X_JF) for X_JF, X in _on_joints(state, frames, poses(state), world(state))]
    return _arranged(state, frames, [vectors.flat(X.rows) for X in found]), _arranged(
        state, frames, [X.p for X in found]
    )


# -- velocities and accelerations -------------------------------------------------------------------------------------


def velocities(state, v):
    """(w, v) of every bundle: V_WJ_J."""
    return recursion.outward(state, _velocity, (state.no_vector, state.no_vector), state.links(v))


def _velocity(link, parent):
    X_PB = across(link.placement, link.joint)
    R_BP = vectors.transpose(X_PB.rows)
    w_r, v_r = subspace_times(link.joint.subspace, link.v)
    arm = vectors.plus(parent[1], vectors.cross(parent[0], X_PB.p))
    V = vectors.plus(vectors.matrix_times(R_BP, parent[0]), w_r), vectors.plus(vectors.matrix_times(R_BP, arm), v_r)
    return V, V


def _with_poses(state, frames, found, at_world):
    """Those of `_on_joints` with the pose of J."""
    both = list(zip(poses(state), found, strict=True))
    return _on_joints(state, frames, both, (world(state), at_world))


@algorithm(*GEOMETRY, *FRAMES)
def _body_velocities(state, v, *, frames):
    found = _with_poses(state, frames, velocities(state, v), (state.no_vector, state.no_vector))
    found = [_velocity_in_world(X, X_JF, V) for X_JF, (X, V) in found]
    return tuple(_arranged(state, frames, [V[k] for V in found]) for k in (0, 1))


def _velocity_in_world(X_WJ, X_JF, V):
    """V_WF_W of V_WJ_J."""
    w, v = V
    v = vectors.plus(v, vectors.cross(w, X_JF.p))
    return vectors.matrix_times(X_WJ.rows, w), vectors.matrix_times(X_WJ.rows, v)


@algorithm(*GEOMETRY, *FRAMES)
def _body_accelerations(state, v, vdot, *, frames):
    at_rest = Motion(*(state.no_vector,) * 3)
    motions = recursion.outward(state, motion_step, at_rest, state.links(v, vdot))
    found = [_acceleration_in_world(X, X_JF, A) for X_JF, (X, A) in _with_poses(state, frames, motions, at_rest)]
    return tuple(_arranged(state, frames, [A[k] for A in found]) for k in (0, 1))


def _acceleration_in_world(X_WJ, X_JF, motion):
    arm = vectors.matrix_times(angular_acceleration_tensor(motion.w, motion.alpha), X_JF.p)
    a = vectors.plus(motion.a, arm)
    return vectors.matrix_times(X_WJ.rows, motion.alpha), vectors.matrix_times(X_WJ.rows, a)


# -- Jacobians --------------------------------------------------------------------------------------------------------


@algorithm(*GEOMETRY, *FRAMES, entries=lambda t: 6 * t.nv)
def _jacobian(state, *, frame):
    found = poses(state)
    p_WF = _origin(state, frame, found).p
    columns = [
        tuple(_column(state, b, frame, x) for x in _arms(joint, X, p_WF))
        for b, joint, X in zip(state.bundles, state.joints, found, strict=True)
    ]
    return state.matrix_by_rate(columns)


def _origin(state, frame, found):
    """X_WF of one frame."""
    return composed(_of_carrier(state, frame, found, world(state)), state.frame_placement(frame))


def _arms(joint, X_WJ, p_WF):
    """Of every motion of a joint: the velocity of the frame's origin, per rate."""
    arm = vectors.minus(p_WF, X_WJ.p)
    return [noinline(_velocity_at)(X_WJ.rows, motion, arm) for motion in joint.subspace]


def _velocity_at(rows, motion, arm):
    """The velocity of the point at an arm from J, in world axes, of a motion of J in its own axes."""
    w, v = (vectors.matrix_times(rows, x) for x in motion)
    return *w, *vectors.plus(v, vectors.cross(w, arm))


def _column(state, bundle, frame, column):
    """The columns of bodies that carry the frame, zeros for others."""
    carriers = set(state.topology.ancestors(state.topology.frames[frame][1]))
    is_carrier = np.isin(bundle.bodies, list(carriers))
    if not is_carrier.any():
        return (state.known(0.0),) * 6
    mask = jnp.asarray(np.broadcast_to(is_carrier[..., None], (*is_carrier.shape, state.n)))
    return tuple(where(mask, along.spread(x, mask.shape), 0.0) for x in column)


@algorithm(*GEOMETRY, *FRAMES, entries=lambda t: 6 * t.nv)
def _jacobian_rate(state, v, *, frame):
    found = list(zip(poses(state), velocities(state, v), strict=True))
    X, V = _of_carrier(state, frame, found, (world(state), (state.no_vector, state.no_vector)))
    _, v_WF = _velocity_in_world(X, state.frame_placement(frame), V)
    p_WF = _origin(state, frame, [x for x, _ in found]).p
    columns = [
        tuple(_column(state, b, frame, x) for x in _arm_rates(link, *own, p_WF, v_WF))
        for b, link, own in zip(state.bundles, state.links(v), found, strict=True)
    ]
    return state.matrix_by_rate(columns)


def _arm_rates(link, X_WJ, V_WJ_J, p_WF, v_WF):
    """The time derivatives of `_arms`."""
    motions = zip(link.joint.subspace, link.joint.subspace_rate(link.v), strict=True)
    return [noinline(_velocity_rate_at)(X_WJ, V_WJ_J, motion, rate, p_WF, v_WF) for motion, rate in motions]


def _velocity_rate_at(X_WJ, V_WJ_J, motion, rate, p_WF, v_WF):
    """d/dt of R k and R l + R k x r, of a motion (k, l) with rates of its own, r the arm from J to F in the world."""
    turning, (k, _) = V_WJ_J[0], motion
    dk, dl = (vectors.plus(vectors.cross(turning, x), dx) for x, dx in zip(motion, rate, strict=True))
    k, dk, dl, v_WJ = (vectors.matrix_times(X_WJ.rows, x) for x in (k, dk, dl, V_WJ_J[1]))
    tangential = vectors.cross(dk, vectors.minus(p_WF, X_WJ.p))
    return *dk, *vectors.plus(dl, tangential, vectors.cross(k, vectors.minus(v_WF, v_WJ)))
