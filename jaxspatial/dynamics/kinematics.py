"""Where bodies and frames are and how they move."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import shared
from jaxspatial.dynamics import recursion
from jaxspatial.dynamics.links import Motion, across, combined, move, swing
from jaxspatial.dynamics.scene import Pose, algorithm, checked
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


def poses(scene):
    """X_WJ of every segment."""
    own = list(zip(map(scene.placement, scene.segments), scene.joints, strict=True))
    return recursion.outward(scene.segments, _pose, world(scene), own)


def world(scene):
    zero, one = (scene.known(x) for x in (0.0, 1.0))
    return Pose(((one, zero, zero), (zero, one, zero), (zero, zero, one)), (zero, zero, zero))


def _pose(own, X_WP):
    X_WJ = composed(X_WP, across(*own))
    return X_WJ, X_WJ


def composed(X_AB, X_BC):
    p = vectors.plus(X_AB.p, vectors.matrix_times(X_AB.rows, X_BC.p))
    return Pose(vectors.product(X_AB.rows, X_BC.rows), p)


def _on_joints(scene, frames, found, at_world):
    """[(X_JF, what was found for J)] of frames, or of all bodies, a segment each, for None."""
    if frames is None:
        return list(zip(map(scene.child_placement, scene.segments), found, strict=True))
    return [(scene.frame_placement(k), _of_carrier(scene, k, found, at_world)) for k in frames]


def _of_carrier(scene, frame, found, at_world):
    """What was found for the joint that a frame is carried by."""
    body = scene.topology.frames[frame][1]
    if body < 0:
        return at_world
    segment, place = scene.place(body)
    return scene.of_body(segment, place, found[segment])


@algorithm
def _forward_kinematics(scene, *, frames):
    found = [composed(X, X_JF) for X_JF, X in _on_joints(scene, frames, poses(scene), world(scene))]
    return scene.stacked([vectors.flat(X.rows) for X in found]), scene.stacked([X.p for X in found])


# -- velocities and accelerations -------------------------------------------------------------------------------------


def velocities(scene, v):
    """(w, v) of every segment: V_WJ_J."""
    zero = (scene.known(0.0),) * 3
    return recursion.outward(scene.segments, _velocity, (zero, zero), scene.links(v, None))


def _velocity(link, parent):
    X_PB = across(link.placement, link.hinge)
    R_BP = vectors.transpose(X_PB.rows)
    w_r, v_r = combined(link.hinge.subspace, link.v)
    arm = vectors.plus(parent[1], vectors.cross(parent[0], X_PB.p))
    V = vectors.plus(vectors.matrix_times(R_BP, parent[0]), w_r), vectors.plus(vectors.matrix_times(R_BP, arm), v_r)
    return V, V


def _moving(scene, frames, found, at_world):
    """Those of `_on_joints` with the pose of J."""
    both = list(zip(poses(scene), found, strict=True))
    return _on_joints(scene, frames, both, (world(scene), at_world))


@algorithm
def _body_velocities(scene, v, *, frames):
    zero = (scene.known(0.0),) * 3
    found = _moving(scene, frames, velocities(scene, v), (zero, zero))
    found = [_velocity_in_world(X, X_JF, V) for X_JF, (X, V) in found]
    return tuple(scene.stacked([V[k] for V in found]) for k in (0, 1))


def _velocity_in_world(X_WJ, X_JF, V):
    """V_WF_W of V_WJ_J."""
    w, v = V
    v = vectors.plus(v, vectors.cross(w, X_JF.p))
    return vectors.matrix_times(X_WJ.rows, w), vectors.matrix_times(X_WJ.rows, v)


@algorithm
def _body_accelerations(scene, v, vdot, *, frames):
    zero = (scene.known(0.0),) * 3
    at_rest = Motion(zero, zero, zero)
    motions = recursion.outward(scene.segments, move, at_rest, scene.links(v, vdot))
    found = [_acceleration_in_world(X, X_JF, A) for X_JF, (X, A) in _moving(scene, frames, motions, at_rest)]
    return tuple(scene.stacked([A[k] for A in found]) for k in (0, 1))


def _acceleration_in_world(X_WJ, X_JF, motion):
    arm = vectors.matrix_times(swing(motion.w, motion.alpha), X_JF.p)
    a = vectors.plus(motion.a, arm)
    return vectors.matrix_times(X_WJ.rows, motion.alpha), vectors.matrix_times(X_WJ.rows, a)


# -- Jacobians --------------------------------------------------------------------------------------------------------


@algorithm
def _jacobian(scene, *, frame):
    found = poses(scene)
    p_WF = _origin(scene, frame, found).p
    columns = [
        tuple(_column(scene, s, frame, x) for x in _arms(scene, s, hinge, X, p_WF))
        for s, hinge, X in zip(scene.segments, scene.joints, found, strict=True)
    ]
    return scene.by_rate(columns).T


def _origin(scene, frame, found):
    """X_WF of one frame."""
    return composed(_of_carrier(scene, frame, found, world(scene)), scene.frame_placement(frame))


def _arms(scene, segment, hinge, X_WJ, p_WF):
    """Of every motion of a joint: the velocity that it gives the frame."""
    arm = vectors.minus(tuple(scene.spread(segment, x) for x in p_WF), X_WJ.p)
    return [shared(_moved)(X_WJ.rows, motion, arm) for motion in hinge.subspace]


def _moved(rows, motion, arm):
    """A motion of J's origin, turned by the rows, of a point at the arm."""
    w, v = (vectors.matrix_times(rows, x) for x in motion)
    return *w, *vectors.plus(v, vectors.cross(w, arm))


def _column(scene, segment, frame, column):
    """The column where the segment carries the frame, else zeros; of a chain, zeros behind the body that does."""
    body = scene.topology.frames[frame][1]
    if segment.start not in scene.topology.ancestors(body):
        return (scene.spread(segment, scene.known(0.0)),) * 6
    return tuple(scene.up_to(segment, body, x) for x in column)


@algorithm
def _jacobian_rate(scene, v, *, frame):
    zero = (scene.known(0.0),) * 3
    found = list(zip(poses(scene), velocities(scene, v), strict=True))
    X, V = _of_carrier(scene, frame, found, (world(scene), (zero, zero)))
    _, v_WF = _velocity_in_world(X, scene.frame_placement(frame), V)
    p_WF = _origin(scene, frame, [x for x, _ in found]).p
    links = scene.links(v, None)
    columns = [
        tuple(_column(scene, s, frame, x) for x in _arm_rates(scene, s, link, *own, p_WF, v_WF))
        for s, link, own in zip(scene.segments, links, found, strict=True)
    ]
    return scene.by_rate(columns).T


def _arm_rates(scene, segment, link, X_WJ, V_WJ_J, p_WF, v_WF):
    """The time derivatives of `_arms`."""
    p, v = (tuple(scene.spread(segment, x) for x in y) for y in (p_WF, v_WF))
    motions = zip(link.hinge.subspace, link.hinge.subspace_rate(link.v), strict=True)
    return [shared(_moved_rate)(X_WJ, V_WJ_J, motion, rate, p, v) for motion, rate in motions]


def _moved_rate(X_WJ, V_WJ_J, motion, rate, p_WF, v_WF):
    """d/dt of R k and R l + R k x r, of a motion (k, l) with rates of its own, r the arm from J to F in the world."""
    turning, (k, _) = V_WJ_J[0], motion
    dk, dl = (vectors.plus(vectors.cross(turning, x), dx) for x, dx in zip(motion, rate, strict=True))
    k, dk, dl, v_WJ = (vectors.matrix_times(X_WJ.rows, x) for x in (k, dk, dl, V_WJ_J[1]))
    swung = vectors.cross(dk, vectors.minus(p_WF, X_WJ.p))
    return *dk, *vectors.plus(dl, swung, vectors.cross(k, vectors.minus(v_WF, v_WJ)))
