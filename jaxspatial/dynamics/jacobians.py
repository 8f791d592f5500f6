"""Jacobians of frames, and their rates."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Motion, Numbers, Rows, Three, noinline, where
from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics import along
from jaxspatial.dynamics.algorithm import FRAMES, GEOMETRY, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.kinematics import composed, of_carrier, poses, velocities, velocity_in_world, world
from jaxspatial.dynamics.state import JointState, Link, MechanismState, Pose
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.topology import Bundle


def jacobian(
    mechanism: Mechanism, q: Coordinates, frames: str | Sequence[str], *, precision: PrecisionName = None
) -> jax.Array:
    """The Jacobian of the origin of a frame: V_WF_W = J v.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        frames: a name of `mechanism.frame_names`, or several, in the order of the results.
        precision: name of a precision; None takes the default.

    Returns:
        J (*batch, 6, nv) of the one frame that is named, (*batch, n, 6, nv) of several; rotational rows on top, in
        world axes.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 3.4.
    """
    _require_names("jacobian", frames)
    return _jacobian(precision, mechanism, q, frames=frames)


def jacobian_rate(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    frames: str | Sequence[str],
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The time derivative of `jacobian` along v: A_WF_W = J vdot + dJ/dt v.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        frames: a name of `mechanism.frame_names`, or several, in the order of the results.
        precision: name of a precision; None takes the default.

    Returns:
        dJ/dt (*batch, 6, nv) of the one frame that is named, (*batch, n, 6, nv) of several; rotational rows on top, in
        world axes.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: the derivative of that of `jacobian`.
    """
    _require_names("jacobian_rate", frames)
    return _jacobian_rate(precision, mechanism, q, v, frames=frames)


def _require_names(operation: str, frames: object) -> None:
    """None, which elsewhere stands for all bodies, is nothing to take a Jacobian of."""
    if frames is None:
        raise TypeError(f"{operation}: frames: expected the name of a frame, or a sequence of names, got None")


def _stacked(frames: int | tuple[int, ...], function: Callable[[int], jax.Array]) -> jax.Array:
    """The matrix of one frame, or those of several."""
    return function(frames) if isinstance(frames, int) else jnp.stack([function(frame) for frame in frames])


@algorithm(*GEOMETRY, *FRAMES, entries=lambda t: 6 * t.nv)
def _jacobian(state: MechanismState, *, frames: int | tuple[int, ...]):
    found = poses(state)

    def of_frame(frame: int) -> jax.Array:
        p_WF = _origin(state, frame, found).p
        columns = [
            tuple(_column(state, b, frame, x) for x in _arms(joint, X, p_WF))
            for b, joint, X in zip(state.bundles, state.joints, found, strict=True)
        ]
        return state.matrix_by_rate(columns)

    return _stacked(frames, of_frame)


def _origin(state: MechanismState, frame: int, found: list[Pose]):
    """X_WF of one frame."""
    return composed(of_carrier(state, frame, found, world(state)), state.frame_placement(frame))


def _arms(joint: JointState, X_WJ: Pose, p_WF: Three):
    """Of every motion of a joint: the velocity of the frame's origin, per rate."""
    arm = vectors.minus(p_WF, X_WJ.p)
    return [noinline(_velocity_at)(X_WJ.rows, motion, arm) for motion in joint.subspace]


def _velocity_at(rows: Rows, motion: Motion, arm: Three) -> Numbers:
    """The velocity of the point at an arm from J, in world axes, of a motion of J in its own axes."""
    w, v = (vectors.matrix_times(rows, x) for x in motion)
    return *w, *vectors.plus(v, vectors.cross(w, arm))


def _column(state: MechanismState, bundle: Bundle, frame: int, column: Numbers):
    """The columns of bodies that carry the frame, zeros for others."""
    carriers = set(state.topology.ancestors(state.topology.frames[frame][1]))
    is_carrier = np.isin(bundle.bodies, list(carriers))
    if not is_carrier.any():
        return (state.known(0.0),) * 6
    mask = jnp.asarray(np.broadcast_to(is_carrier[..., None], (*is_carrier.shape, state.n)))
    return tuple(where(mask, along.spread(x, mask.shape), 0.0) for x in column)


@algorithm(*GEOMETRY, *FRAMES, entries=lambda t: 6 * t.nv)
def _jacobian_rate(state: MechanismState, v: Array, *, frames: int | tuple[int, ...]):
    found = list(zip(poses(state), velocities(state, v), strict=True))

    def of_frame(frame: int) -> jax.Array:
        X, V = of_carrier(state, frame, found, (world(state), (state.no_vector, state.no_vector)))
        _, v_WF = velocity_in_world(X, state.frame_placement(frame), V)
        p_WF = _origin(state, frame, [x for x, _ in found]).p
        columns = [
            tuple(_column(state, b, frame, x) for x in _arm_rates(link, *own, p_WF, v_WF))
            for b, link, own in zip(state.bundles, state.links(v), found, strict=True)
        ]
        return state.matrix_by_rate(columns)

    return _stacked(frames, of_frame)


def _arm_rates(link: Link, X_WJ: Pose, V_WJ_J: Motion, p_WF: Three, v_WF: Three):
    """The time derivatives of `_arms`."""
    motions = zip(link.joint.subspace, link.joint.subspace_rate(link.v), strict=True)
    return [noinline(_velocity_rate_at)(X_WJ, V_WJ_J, motion, rate, p_WF, v_WF) for motion, rate in motions]


def _velocity_rate_at(X_WJ: Pose, V_WJ_J: Motion, motion: Motion, rate: Motion, p_WF: Three, v_WF: Three) -> Numbers:
    """d/dt of R k and R l + R k x r, of a motion (k, l) with rates of its own, r the arm from J to F in the world."""
    turning, (k, _) = V_WJ_J[0], motion
    dk, dl = (vectors.plus(vectors.cross(turning, x), dx) for x, dx in zip(motion, rate, strict=True))
    k, dk, dl, v_WJ = (vectors.matrix_times(X_WJ.rows, x) for x in (k, dk, dl, V_WJ_J[1]))
    tangential = vectors.cross(dk, vectors.minus(p_WF, X_WJ.p))
    return *dk, *vectors.plus(dl, tangential, vectors.cross(k, vectors.minus(v_WF, v_WJ)))
