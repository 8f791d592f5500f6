"""Forward kinematics: poses, velocities and accelerations of bodies and frames."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.engine import matrices, recursion, stacking
from jaxspatial.engine.algorithm import FRAMES, GEOMETRY, Algorithm, Frames, algorithm
from jaxspatial.engine.derivatives import Differentiable, Moving, Pullback
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import JointState, Link, MechanismState, across
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.topology import Bundle
from jaxspatial.numerics.linear import Matrix, Motion, Pose, Vector, Wrench, cross, dot
from jaxspatial.numerics.numbers import Numbers, where
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialVelocity
from jaxspatial.spatial.algebra import composed, power

T = TypeVar("T")


@promises(bound=ALGORITHM)
def forward_kinematics(
    mechanism: Mechanism, q: ArrayLike, frames: str | Sequence[str] | None = None, *, precision: PrecisionName = None
) -> RigidTransform:
    """The poses of frames: X_WF.

    Args:
        mechanism: the mechanism, see `Mechanism`.
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

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 3.2.

    Example:
        >>> print(js.forward_kinematics(arm, q, "hand").translation)
        [-0.7749  0.     -1.8329]
    """
    entries, p = _forward_kinematics(precision, mechanism, q, frames=frames)
    return RigidTransform(Rotation(entries), p)


@promises(bound=ALGORITHM)
def body_velocities(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    frames: str | Sequence[str] | None = None,
    *,
    precision: PrecisionName = None,
) -> SpatialVelocity:
    """The velocities of the origins of frames: V_WF_W.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        frames: a name of `mechanism.frame_names`, or several, in the order of the results; None takes
            `mechanism.body_names`.
        precision: name of a precision; None takes the default.

    Returns:
        V_WF_W (*batch,) of the one frame that is named, (*batch, n) of several, in world axes: rad/s, m/s.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Featherstone 2008, 4.4 (velocities from body to body).

    Example:
        >>> js.body_velocities(arm, q, v, "hand")
        SpatialVelocity(w=[0.0, 1.5, 0.0], v=[-2.3105874, 0.0, 0.9227059])
    """
    return SpatialVelocity(*_body_velocities(precision, mechanism, q, v, frames=frames))


@promises(bound=ALGORITHM)
def body_accelerations(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    vdot: ArrayLike,
    frames: str | Sequence[str] | None = None,
    *,
    precision: PrecisionName = None,
) -> SpatialAcceleration:
    """The accelerations of the origins of frames, without gravity: the time derivative of `body_velocities`.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        vdot: (*batch, nv) generalized accelerations: rad/s^2, m/s^2.
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

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Luh, Walker, Paul 1980, On-line computational scheme for mechanical manipulators.

    Example:
        >>> js.body_accelerations(arm, q, v, jnp.zeros(2), "hand")
        SpatialAcceleration(alpha=[0.0, 0.0, 0.0], a=[1.144346, 0.0, 3.0270896])
    """
    return SpatialAcceleration(*_body_accelerations(precision, mechanism, q, v, vdot, frames=frames))


# -- poses ------------------------------------------------------------------------------------------------------------


def poses(state: MechanismState) -> list[Pose]:
    """X_WJ of every bundle."""
    links = list(zip(map(state.placement, state.bundles), state.joints, strict=True))
    return recursion.outward(state, _pose, state.world, links)


def _pose(link: tuple[Pose, JointState], X_WP: Pose) -> tuple[Pose, Pose]:
    X_WJ = composed(X_WP, across(*link))
    return X_WJ, X_WJ


def at_carrier(state: MechanismState, frame: int, results: list[T], at_world: T) -> T:
    """The result for the body that carries a frame, from those for every bundle."""
    return state.of_bodies(state.topology.bodies_of([frame]), results, at_world)


def _of_frames(
    state: MechanismState, frames: Frames, function: Callable[[Pose, Pose, T], Any], results: list[T], at_world: T
) -> tuple:
    """Calls function(X_WJ, X_JF, the result for J), which returns two tuples of k numbers, for each frame.

    Returns two arrays (frames, k, B), for a single frame (k, B).
    """
    both = list(zip(poses(state), results, strict=True))
    if frames is None:
        placed = zip(map(state.child_placement, state.bundles), both, strict=True)
        of_bundles = [function(X_WJ, X_JF, x) for X_JF, (X_WJ, x) in placed]
        sizes = map(len, function(state.world, state.world, at_world))
        return tuple(state.by_body([x[k] for x in of_bundles], size) for k, size in enumerate(sizes))
    named = (frames,) if isinstance(frames, int) else frames
    X_WJ, x = state.of_bodies(state.topology.bodies_of(named), both, (state.world, at_world))
    of_frames = [state.by_row(y, len(named)) for y in function(X_WJ, state.frame_placements(named), x)]
    return tuple(y[0] if isinstance(frames, int) else y for y in of_frames)


@algorithm(*GEOMETRY, *FRAMES)
def _forward_kinematics(state: MechanismState, *, frames: Frames):
    state = state.carrying(frames)
    return _of_frames(state, frames, _pose_in_world, [()] * len(state.bundles), ())


def _pose_in_world(X_WJ: Pose, X_JF: Pose, _) -> tuple[Numbers, Vector]:
    X_WF = composed(X_WJ, X_JF)
    return X_WF.R.entries, X_WF.p


# -- velocities -------------------------------------------------------------------------------------------------------


def velocities(state: MechanismState, v: Array) -> list[Motion]:
    """V_WJ_J of every bundle."""
    return recursion.outward(state, velocity_step, Motion(state.zero_vector, state.zero_vector), state.links(v))


def velocity_step(link: Link, V_P: Motion) -> tuple[Motion, Motion]:
    """V_WJ_J of a body from that of its parent, as the step of an outward recursion."""
    X_PB = link.X_PB
    w, v = subspace_times(link.joint.subspace, link.v)
    v_B = V_P.v + cross(V_P.w, X_PB.p)
    V = Motion(X_PB.R.T @ V_P.w + w, X_PB.R.T @ v_B + v)
    return V, V


def subspace_times(S: Sequence[Motion], v: Numbers) -> Motion:
    """S v: the motion across a joint."""
    w, linear = (Vector(*(dot(v, [s[k][i] for s in S]) for i in range(3))) for k in (0, 1))
    return Motion(w, linear)


class BodyVelocities(Algorithm):
    """The program of `_body_velocities`. The pull-back of one frame to v is J^T F, without a recursion inward."""

    def pullback_program(self, moving: Moving, given: Moving | None = None) -> Differentiable:
        moves = [i for i, yes in enumerate(moving) if yes]
        if isinstance(dict(self.static)["frames"], int) and moves == [self.place(self.n_fields + 1)]:
            return self.cached(("J^T F", moving, given), lambda: JacobianTransposed(self, moving, given))
        return super().pullback_program(moving, given)


class JacobianTransposed(Pullback):
    """(arguments, the wrench on the frame about its origin, in world axes) -> the generalized forces."""

    program: Algorithm

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        arguments, cotangents = self._parted(arrays)
        state, _ = self.program.state_of(arguments, max(x.shape[0] for x in arrays))
        rest = (Vector(*state.numbers(jnp.moveaxis(self.from_outside(x), 0, -1)[None])) for x in cotangents)
        F = Wrench(*(next(rest) if yes else state.zero_vector for yes in self.given or (True, True)))
        return [jnp.moveaxis(_forces_of_wrench(state, dict(self.program.static)["frames"], F), -1, 0)]


def _forces_of_wrench(state: MechanismState, frame: int, F_F_W: Wrench) -> jax.Array:
    """J^T F (nv, B), of a wrench on one frame."""
    state = state.carrying(frame)
    placed = matrices.poses_from_root(state)
    p_F = composed(at_carrier(state, frame, placed, state.world), state.frame_placements((frame,))).p
    forces, (tau, f) = list[Numbers](), F_F_W
    for b, joint, X in zip(state.bundles, state.joints, placed, strict=True):
        about_J = Wrench(X.R.T @ (tau + cross(p_F - X.p, f)), X.R.T @ f)
        forces.append(of_carriers(state, b, frame, tuple(power(about_J, s) for s in joint.subspace)))
    return state.by_all_velocities(forces)


def of_carriers(state: MechanismState, bundle: Bundle, frame: int, numbers: Numbers) -> Numbers:
    """Numbers (L, W, B) of a bundle, zero for bodies that do not carry the frame."""
    carriers = set(state.topology.ancestors(state.topology.frames[frame][1]))
    is_carrier = np.isin(bundle.bodies, list(carriers))
    if not is_carrier.any():
        return (state.known(0.0),) * len(numbers)
    if is_carrier.all():
        return numbers
    mask = jnp.asarray(np.broadcast_to(is_carrier[..., None], (*is_carrier.shape, state.n)))
    return tuple(where(mask, stacking.spread(x, mask.shape), 0.0) for x in numbers)


@algorithm(*GEOMETRY, *FRAMES, program_class=BodyVelocities)
def _body_velocities(state: MechanismState, v: Array, *, frames: Frames):
    state, at_rest = state.carrying(frames), Motion(state.zero_vector, state.zero_vector)
    return _of_frames(state, frames, velocity_in_world, velocities(state, v), at_rest)


def velocity_in_world(X_WJ: Pose, X_JF: Pose, V: Motion) -> Motion:
    """V_WF_W of a frame, from V_WJ_J of the body that carries it."""
    v = V.v + cross(V.w, X_JF.p)
    return Motion(X_WJ.R @ V.w, X_WJ.R @ v)


# -- accelerations ----------------------------------------------------------------------------------------------------


class BodyMotion(NamedTuple):
    """Angular velocity and acceleration of a body, and the classical acceleration of its origin, in its axes.

    Gravity is an upward acceleration of the world. The linear velocity is left out, as no formula needs it.
    """

    w: Vector
    alpha: Vector
    a: Vector


def body_motion(link: Link, parent: BodyMotion) -> BodyMotion:
    """The BodyMotion of a body, from that of its parent.

        w = R^T w_P + w_r    alpha = R^T alpha_P + (R^T w_P) x w_r + dw_r
        a = R^T (a_P + E_P p) + 2 (R^T w_P) x v_r + w_r x v_r + dv_r        E = [alpha]x + [w]x [w]x

    with (w_r, v_r) = S v the motion across the joint in the child's axes, (dw_r, dv_r) = S vdot + dS/dt v.
    """
    X_PB = link.X_PB
    R_BP = X_PB.R.T
    S, bias = link.joint.subspace, subspace_times(link.joint.subspace_rate(link.v), link.v)
    (w_r, v_r), (dw, dv) = subspace_times(S, link.v), subspace_times(S, link.vdot)
    w_P, a_P = R_BP @ parent.w, acceleration_at(parent, X_PB.p)
    alpha = R_BP @ parent.alpha + cross(w_P, w_r) + dw + bias.w
    coriolis = cross(w_P + w_P + w_r, v_r)
    return BodyMotion(w_P + w_r, alpha, R_BP @ a_P + coriolis + dv + bias.v)


def motion_step(link: Link, parent: BodyMotion) -> tuple[BodyMotion, BodyMotion]:
    """`body_motion`, as the step of an outward recursion."""
    motion = body_motion(link, parent)
    return motion, motion


def world_motion(state: MechanismState) -> BodyMotion:
    """The motion of the world, at rest, with gravity as an upward acceleration."""
    return BodyMotion(state.zero_vector, state.zero_vector, state.minus_gravity)


def angular_acceleration_tensor(w: Vector, alpha: Vector) -> Matrix:
    """E = [alpha]x + [w]x [w]x: the point at r has the acceleration a + E r, with a that of the origin."""
    x, y, z = w
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    i, j, k = alpha
    return Matrix(
        Vector(-(yy + zz), xy - k, xz + j), Vector(xy + k, -(xx + zz), yz - i), Vector(xz - j, yz + i, -(xx + yy))
    )


def acceleration_at(motion: BodyMotion, p: Vector) -> Vector:
    """The classical acceleration a + E p of the point of a body at p from its origin."""
    return motion.a + angular_acceleration_tensor(motion.w, motion.alpha) @ p


@algorithm(*GEOMETRY, *FRAMES)
def _body_accelerations(state: MechanismState, v: Array, vdot: Array, *, frames: Frames):
    state, at_rest = state.carrying(frames), BodyMotion(*(state.zero_vector,) * 3)
    motions = recursion.outward(state, motion_step, at_rest, state.links(v, vdot))
    return _of_frames(state, frames, _acceleration_in_world, motions, at_rest)


def _acceleration_in_world(X_WJ: Pose, X_JF: Pose, motion: BodyMotion) -> Motion:
    a = acceleration_at(motion, X_JF.p)
    return Motion(X_WJ.R @ motion.alpha, X_WJ.R @ a)
