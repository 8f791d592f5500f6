"""Where bodies and frames are and how they move."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax.numpy as jnp

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Motion, Numbers, Three
from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics import recursion
from jaxspatial.dynamics.algorithm import FRAMES, GEOMETRY, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.arguments import Frames
from jaxspatial.dynamics.links import BodyMotion, acceleration_at, across, motion_step, subspace_times
from jaxspatial.dynamics.state import JointState, Link, MechanismState, Pose
from jaxspatial.mechanism import Mechanism
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialVelocity

T = TypeVar("T")


def forward_kinematics(
    mechanism: Mechanism, q: Coordinates, frames: str | Sequence[str] | None = None, *, precision: PrecisionName = None
) -> RigidTransform:
    """The poses of frames: X_WF.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        frames: a name of `mechanism.frame_names`, or several, in the order of the results; None takes
            `mechanism.body_names`.
        precision: name of a precision; None takes the default.

    Returns:
        X_WF (*batch,), the pose in the world of the one frame that is named, (*batch, n) of several; translations in m.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 3.2.
    """
    entries, p = _forward_kinematics(precision, mechanism, q, frames=frames)
    return RigidTransform(Rotation(entries), p)


def body_velocities(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    frames: str | Sequence[str] | None = None,
    *,
    precision: PrecisionName = None,
) -> SpatialVelocity:
    """The velocities of the origins of frames: V_WF_W.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        frames: a name of `mechanism.frame_names`, or several, in the order of the results; None takes
            `mechanism.body_names`.
        precision: name of a precision; None takes the default.

    Returns:
        V_WF_W (*batch,) of the one frame that is named, (*batch, n) of several, in world axes: rad/s, m/s.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Featherstone 2008, 4.4 (velocities from body to body).
    """
    return SpatialVelocity(*_body_velocities(precision, mechanism, q, v, frames=frames))


def body_accelerations(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    vdot: Rates,
    frames: str | Sequence[str] | None = None,
    *,
    precision: PrecisionName = None,
) -> SpatialAcceleration:
    """The accelerations of the origins of frames, without gravity: the time derivative of `body_velocities`.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        vdot: (*batch, nv) time derivatives of the rates: rad/s^2, m/s^2.
        frames: a name of `mechanism.frame_names`, or several, in the order of the results; None takes
            `mechanism.body_names`.
        precision: name of a precision; None takes the default.

    Returns:
        A_WF_W (*batch,) of the one frame that is named, (*batch, n) of several, in world axes: rad/s^2, m/s^2, the
        classical acceleration of the origin.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Luh, Walker, Paul 1980, On-line computational scheme for mechanical manipulators.
    """
    return SpatialAcceleration(*_body_accelerations(precision, mechanism, q, v, vdot, frames=frames))


# -- poses ------------------------------------------------------------------------------------------------------------


def poses(state: MechanismState) -> list[Pose]:
    """X_WJ of every bundle."""
    own = list(zip(map(state.placement, state.bundles), state.joints, strict=True))
    return recursion.outward(state, _pose, world(state), own)


def world(state: MechanismState):
    zero, one = (state.known(x) for x in (0.0, 1.0))
    return Pose(((one, zero, zero), (zero, one, zero), (zero, zero, one)), (zero, zero, zero))


def _pose(own: tuple[Pose, JointState], X_WP: Pose):
    X_WJ = composed(X_WP, across(*own))
    return X_WJ, X_WJ


def composed(X_AB: Pose, X_BC: Pose):
    p = vectors.plus(X_AB.p, vectors.matrix_times(X_AB.rows, X_BC.p))
    return Pose(vectors.matrix_product(X_AB.rows, X_BC.rows), p)


def of_carrier(state: MechanismState, frame: int, found: list[T], at_world: T) -> T:
    """What was found for the joint that a frame is carried by."""
    return state.of_body(state.topology.frames[frame][1], found, at_world)


def _of_frames(
    state: MechanismState, frames: Frames, function: Callable[[Pose, Pose, T], Any], found: list[T], at_world: T
) -> tuple[Any, ...]:
    """Of function(X_WJ, X_JF, what was found for J), two tuples of k numbers for each frame, arrays (frames, k, B); of
    one frame (k, B)."""
    both = list(zip(poses(state), found, strict=True))
    if frames is None:
        placed = zip(map(state.child_placement, state.bundles), both, strict=True)
    else:
        root = world(state), at_world
        named = (frames,) if isinstance(frames, int) else frames
        placed = ((state.frame_placement(k), of_carrier(state, k, both, root)) for k in named)
    results = [function(X_WJ, X_JF, x) for X_JF, (X_WJ, x) in placed]
    return tuple(_arranged(state, frames, [x[k] for x in results]) for k in (0, 1))


def _arranged(state: MechanismState, frames: Frames, found: Sequence[Numbers]):
    """(frames, k, B) of tuples of k numbers: of bundles in the order of bodies, or of frames; (k, B) of one frame."""
    if frames is None:
        return state.by_body(found)
    each = [jnp.stack([state.rounded(c).reshape((-1,)) for c in x]) for x in found]
    return each[0] if isinstance(frames, int) else jnp.stack(each)


@algorithm(*GEOMETRY, *FRAMES, entries=lambda t: 12 * len(t))
def _forward_kinematics(state: MechanismState, *, frames: Frames):
    return _of_frames(state, frames, _pose_in_world, [()] * len(state.bundles), ())


def _pose_in_world(X_WJ: Pose, X_JF: Pose, _: Any) -> tuple[Numbers, Three]:
    X_WF = composed(X_WJ, X_JF)
    return vectors.flat(X_WF.rows), X_WF.p


# -- velocities and accelerations -------------------------------------------------------------------------------------


def velocities(state: MechanismState, v: Array) -> list[Motion]:
    """(w, v) of every bundle: V_WJ_J."""
    return recursion.outward(state, _velocity, (state.no_vector, state.no_vector), state.links(v))


def _velocity(link: Link, parent: Motion) -> tuple[Motion, Motion]:
    X_PB = across(link.placement, link.joint)
    R_BP = vectors.transpose(X_PB.rows)
    w_r, v_r = subspace_times(link.joint.subspace, link.v)
    arm = vectors.plus(parent[1], vectors.cross(parent[0], X_PB.p))
    V = vectors.plus(vectors.matrix_times(R_BP, parent[0]), w_r), vectors.plus(vectors.matrix_times(R_BP, arm), v_r)
    return V, V


@algorithm(*GEOMETRY, *FRAMES)
def _body_velocities(state: MechanismState, v: Array, *, frames: Frames):
    return _of_frames(state, frames, velocity_in_world, velocities(state, v), (state.no_vector, state.no_vector))


def velocity_in_world(X_WJ: Pose, X_JF: Pose, V: Motion) -> Motion:
    """V_WF_W of V_WJ_J."""
    w, v = V
    v = vectors.plus(v, vectors.cross(w, X_JF.p))
    return vectors.matrix_times(X_WJ.rows, w), vectors.matrix_times(X_WJ.rows, v)


@algorithm(*GEOMETRY, *FRAMES)
def _body_accelerations(state: MechanismState, v: Array, vdot: Array, *, frames: Frames):
    at_rest = BodyMotion(*(state.no_vector,) * 3)
    motions = recursion.outward(state, motion_step, at_rest, state.links(v, vdot))
    return _of_frames(state, frames, _acceleration_in_world, motions, at_rest)


def _acceleration_in_world(X_WJ: Pose, X_JF: Pose, motion: BodyMotion) -> Motion:
    a = acceleration_at(motion, X_JF.p)
    return vectors.matrix_times(X_WJ.rows, motion.alpha), vectors.matrix_times(X_WJ.rows, a)
