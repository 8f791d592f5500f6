"""Jacobians of frames, and their time derivatives."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.kinematics import at_carrier, of_carriers, poses, velocities, velocity_in_world
from jaxspatial.engine.algorithm import FRAMES, GEOMETRY, algorithm
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.linear import Motion, Pose, cross
from jaxspatial.numerics.numbers import Numbers
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial.algebra import composed


@promises(bound=ALGORITHM)
def jacobian(
    mechanism: Mechanism, q: ArrayLike, frames: str | Sequence[str], *, precision: PrecisionName = None
) -> jax.Array:
    """The Jacobian of the origin of a frame: V_WF_W = J v.

    Without the matrix J v is `body_velocities` of the frame, and J^T F its pull-back, by `jax.vjp` with respect to v:
    in about the same time for an arm, in less for a humanoid.

    Args:
        mechanism: the mechanism, see `Mechanism`.
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

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 3.4.

    Example:
        >>> J = js.jacobian(arm, q, "hand")
        >>> print(J @ v)  # as `body_velocities`
        [ 0.      1.5     0.     -2.3106  0.      0.9227]
    """
    _require_names("jacobian", frames)
    return _jacobian(precision, mechanism, q, frames=frames)


@promises(bound=ALGORITHM)
def jacobian_rate(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    frames: str | Sequence[str],
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The time derivative of `jacobian` along v: A_WF_W = J vdot + dJ/dt v.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        frames: a name of `mechanism.frame_names`, or several, in the order of the results.
        precision: name of a precision; None takes the default.

    Returns:
        dJ/dt (*batch, 6, nv) of the one frame that is named, (*batch, n, 6, nv) of several; rotational rows on top, in
        world axes.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: the derivative of that of `jacobian`.

    Example:
        >>> print(js.jacobian_rate(arm, q, v, "hand") @ v)  # as `body_accelerations` without vdot
        [0.     0.     0.     1.1443 0.     3.0271]
    """
    _require_names("jacobian_rate", frames)
    return _jacobian_rate(precision, mechanism, q, v, frames=frames)


def _require_names(operation: str, frames: object) -> None:
    """Refuses None, which for other functions stands for all bodies."""
    if frames is None:
        raise TypeError(f"{operation}: frames: expected the name of a frame, or a sequence of names, got None")


def _for_each(frames: int | tuple[int, ...], function: Callable[[int], jax.Array]) -> jax.Array:
    """The matrix of one frame, or those of several."""
    return function(frames) if isinstance(frames, int) else jnp.stack([function(frame) for frame in frames])


@algorithm(*GEOMETRY, *FRAMES)
def _jacobian(state: MechanismState, *, frames: int | tuple[int, ...]):
    state = state.carrying(frames)
    placed = poses(state)

    def of_frame(frame: int) -> jax.Array:
        p_WF = _origin(state, frame, placed).p
        columns: list[tuple[Numbers, ...]] = []
        for b, joint, X in zip(state.bundles, state.joints, placed, strict=True):
            arm, of_joint = p_WF - X.p, list[Numbers]()
            for s in joint.subspace:
                w, v = X.R @ s.w, X.R @ s.v
                of_joint.append(of_carriers(state, b, frame, (*w, *(v + cross(w, arm)))))
            columns.append(tuple(of_joint))
        return state.matrix_by_velocity(columns, 6)

    return _for_each(frames, of_frame)


def _origin(state: MechanismState, frame: int, placed: list[Pose]) -> Pose:
    """X_WF of one frame."""
    return composed(at_carrier(state, frame, placed, state.world), state.frame_placements((frame,)))


@algorithm(*GEOMETRY, *FRAMES)
def _jacobian_rate(state: MechanismState, v: Array, *, frames: int | tuple[int, ...]):
    state = state.carrying(frames)
    moving = list(zip(poses(state), velocities(state, v), strict=True))
    at_rest = Motion(state.zero_vector, state.zero_vector)

    def of_frame(frame: int) -> jax.Array:
        X, V = at_carrier(state, frame, moving, (state.world, at_rest))
        v_WF = velocity_in_world(X, state.frame_placements((frame,)), V).v
        p_WF = _origin(state, frame, [x for x, _ in moving]).p
        columns: list[tuple[Numbers, ...]] = []
        for b, link, ((R, p_WJ), V_J) in zip(state.bundles, state.links(v), moving, strict=True):
            of_joint = list[Numbers]()
            for s, rate in zip(link.joint.subspace, link.joint.subspace_rate(link.v), strict=True):
                # d/dt of (R k, R l + R k x r), for a motion s = (k, l) with rate ds/dt in J, and the arm r from J to F.
                dk, dl = (cross(V_J.w, x) + dx for x, dx in zip(s, rate, strict=True))
                k, dk, dl, v_WJ = R @ s.w, R @ dk, R @ dl, R @ V_J.v
                tangential = cross(dk, p_WF - p_WJ)
                linear = dl + tangential + cross(k, v_WF - v_WJ)
                of_joint.append(of_carriers(state, b, frame, (*dk, *linear)))
            columns.append(tuple(of_joint))
        return state.matrix_by_velocity(columns, 6)

    return _for_each(frames, of_frame)
