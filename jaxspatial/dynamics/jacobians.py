"""Jacobians of frames, and their time derivatives."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp

from jaxspatial.dynamics.docstrings import documented
from jaxspatial.dynamics.kinematics import at_carrier, carrying, of_carriers, poses, velocities, velocity_in_world
from jaxspatial.engine.algorithm import FRAMES, GEOMETRY, algorithm
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.linear import Matrix, Motion, Pose, Vector, cross
from jaxspatial.numerics.numbers import Numbers
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial.algebra import composed


@documented
def jacobian(
    mechanism: Mechanism, q: ArrayLike, frames: str | Sequence[str], *, precision: PrecisionName = None
) -> jax.Array:
    """The Jacobian of the origin of a frame: V_WF_W = J v.

    Without the matrix J v is `body_velocities` of the frame, and J^T F its pull-back, by `jax.vjp` with respect to v:
    in about the same time for an arm, in less for a humanoid.

    Returns:
        J (*batch, 6, nv) of the one frame that is named, (*batch, n, 6, nv) of several; rotational rows on top, in
        world axes.

    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 3.4.
    """
    _require_names("jacobian", frames)
    return _jacobian(precision, mechanism, q, frames=frames)


@documented
def jacobian_rate(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    frames: str | Sequence[str],
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The time derivative of `jacobian` along v: A_WF_W = J vdot + dJ/dt v.

    Returns:
        dJ/dt (*batch, 6, nv) of the one frame that is named, (*batch, n, 6, nv) of several; rotational rows on top, in
        world axes.

    Source: the derivative of that of `jacobian`.
    """
    _require_names("jacobian_rate", frames)
    return _jacobian_rate(precision, mechanism, q, v, frames=frames)


def _require_names(operation: str, frames: object) -> None:
    """Refuses None, which for other functions stands for all bodies."""
    if frames is None:
        raise TypeError(f"{operation}: frames: expected the name of a frame, or a sequence of names, got None")


def _stacked(frames: int | tuple[int, ...], function: Callable[[int], jax.Array]) -> jax.Array:
    """The matrix of one frame, or those of several."""
    return function(frames) if isinstance(frames, int) else jnp.stack([function(frame) for frame in frames])


@algorithm(*GEOMETRY, *FRAMES)
def _jacobian(state: MechanismState, *, frames: int | tuple[int, ...]):
    state = carrying(state, frames)
    placed = poses(state)

    def of_frame(frame: int) -> jax.Array:
        p_WF = _origin(state, frame, placed).p
        columns: list[tuple[Numbers, ...]] = []
        for b, joint, X in zip(state.bundles, state.joints, placed, strict=True):
            arm = p_WF - X.p
            columns.append(tuple(of_carriers(state, b, frame, _six(_velocity_at(X.R, s, arm))) for s in joint.subspace))
        return state.matrix_by_velocity(columns, 6)

    return _stacked(frames, of_frame)


def _origin(state: MechanismState, frame: int, placed: list[Pose]) -> Pose:
    """X_WF of one frame."""
    return composed(at_carrier(state, frame, placed, state.world), state.frame_placements((frame,)))


def _six(V: Motion) -> Numbers:
    return *V.w, *V.v


def _velocity_at(R: Matrix, s: Motion, arm: Vector) -> Motion:
    """A motion of J in its own axes, as the velocity in world axes of the point at an arm from J."""
    w, v = R @ s.w, R @ s.v
    return Motion(w, v + cross(w, arm))


@algorithm(*GEOMETRY, *FRAMES)
def _jacobian_rate(state: MechanismState, v: Array, *, frames: int | tuple[int, ...]):
    state = carrying(state, frames)
    moving = list(zip(poses(state), velocities(state, v), strict=True))
    at_rest = Motion(state.zero_vector, state.zero_vector)

    def of_frame(frame: int) -> jax.Array:
        X, V = at_carrier(state, frame, moving, (state.world, at_rest))
        v_WF = velocity_in_world(X, state.frame_placements((frame,)), V).v
        p_WF = _origin(state, frame, [x for x, _ in moving]).p
        columns = [
            tuple(
                of_carriers(state, b, frame, _six(_velocity_rate_at(X_WJ, V_WJ_J, s, rate, p_WF, v_WF)))
                for s, rate in zip(link.joint.subspace, link.joint.subspace_rate(link.v), strict=True)
            )
            for b, link, (X_WJ, V_WJ_J) in zip(state.bundles, state.links(v), moving, strict=True)
        ]
        return state.matrix_by_velocity(columns, 6)

    return _stacked(frames, of_frame)


def _velocity_rate_at(X_WJ: Pose, V_WJ_J: Motion, s: Motion, rate: Motion, p_WF: Vector, v_WF: Vector) -> Motion:
    """d/dt of (R k, R l + R k x r), for a motion s = (k, l) with rate ds/dt in J, and the arm r from J to F."""
    turning, R = V_WJ_J.w, X_WJ.R
    dk, dl = (cross(turning, x) + dx for x, dx in zip(s, rate, strict=True))
    k, dk, dl, v_WJ = R @ s.w, R @ dk, R @ dl, R @ V_WJ_J.v
    tangential = cross(dk, p_WF - X_WJ.p)
    return Motion(dk, dl + tangential + cross(k, v_WF - v_WJ))
