"""Inverse kinematics: configurations that put frames at targets, within the limits of the joints.

Let e be the velocity that leads the frames to their targets in unit time, along the axes of the frames, and J its
negative derivative by the velocities of the joints. A step of Levenberg and Marquardt moves the joints by

    dq = J^T (J J^T + d)^-1 e

with d in proportion to e . e [Fan, Yuan 2005]: careful far from the target, and quadratic near it. Joints at their
limits that would go beyond are left out of a step, and what goes beyond in it is put back.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics.configuration import integrate, random_configuration
from jaxspatial.dynamics.jacobians import jacobian
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.engine.algorithm import checked, over_batch, refuse_double_words
from jaxspatial.engine.composite import composite
from jaxspatial.engine.derivatives import fixed, valued
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, Key, PrecisionName
from jaxspatial.spatial import RigidTransform, SpatialVelocity

# Times the squared error, at most 1 of it, in units of the mean square of J.
_DAMPING = 0.1
# The longest turn of a step, rad.
_LONGEST = 1.0


@exported
class InverseKinematics(NamedTuple):
    """What `inverse_kinematics` finds.

    q: (*batch, nq), within the limits, quaternions of unit length. error: SpatialVelocity (*batch,) of the one frame
    that is named, (*batch, n) of several: the velocity V_FT_F that leads from the frame at q to its target T in unit
    time, rad and m, in the axes of the frame; for positions without its turn. is_solved: (*batch,) whether the error is
    within the tolerances. iterations: (*batch,) how many steps were taken.
    """

    q: jax.Array
    error: SpatialVelocity
    is_solved: jax.Array
    iterations: jax.Array


def inverse_kinematics(
    mechanism: Mechanism,
    q: ArrayLike,
    frames: str | Sequence[str],
    targets: RigidTransform | ArrayLike,
    *,
    key: Key | None = None,
    starts: int = 1,
    iterations: int = 20,
    angle: float = 1e-4,
    distance: float = 1e-4,
    precision: PrecisionName = None,
) -> InverseKinematics:
    """Inverse kinematics: moves q to a configuration near by in which frames are at their targets, within the limits.

    Steps may get stuck, at a limit or at a least distance that is not zero. With a key, `starts` says from how many
    configurations to go: q first, then random ones. From one random start about half of the poses that an arm of seven
    joints can reach are solved, from 30 nearly all. `is_solved` says which, and of the others q is the one with the
    least error of all steps. Of a batch each state takes the steps that it needs; all end with one start before any
    begins at the next.

    Distances count in units of a length of the robot, the ratio of the parts of its Jacobian, so that its size does not
    matter. The derivative of q by targets and by numbers of the mechanism is that of the smallest motion that follows
    them to first order, with joints that are at a limit at rest; by the start it is zero. There is no promise of second
    derivatives, nor of the first where a target was not reached.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates to start from: rad, m, quaternions (read normalised). Those beyond their limits
            start at them.
        frames: a name of `mechanism.frame_names`, or several, in the order of the results.
        targets: X_WT (*batch,) of the one frame that is named, (*batch, n) of several; or positions p_WT (*batch, 3) or
            (*batch, n, 3), in world axes, m, where orientations do not matter.
        key: of `jax.random`, for further starts.
        starts: from how many configurations at most.
        iterations: how many steps from each, at most.
        angle: the largest rotation from a frame to its target that counts as solved, rad.
        distance: the largest distance that counts as solved, m.
        precision: name of a precision; None takes the default.

    Returns:
        InverseKinematics: q (*batch, nq), error, is_solved and iterations (*batch,), over the common batch.

    Raises:
        TypeError: the first argument is no Mechanism, frames no names, or dtypes differ or are not floating point.
        ValueError: shapes do not fit, a number is not above zero or not known while tracing, starts or iterations is
            no integer, or there are several starts and no key.
        KeyError: there is no such frame.

    Error: `error` is evaluated anew at the q that is returned: as of `forward_kinematics` and `RigidTransform.log`.
        Limits hold exactly; of "ball" joints `turn_limits` do not count.
    Source: Fan, Yuan 2005, On the quadratic convergence of the Levenberg-Marquardt method without nonsingularity
        assumption.

    Example:
        >>> p_WT = jnp.array([-0.6, 0.0, -1.2])
        >>> found = js.inverse_kinematics(arm, q, "hand", p_WT)
        >>> print(found.is_solved, js.forward_kinematics(arm, found.q, "hand").translation.round(2))
        True [-0.6  0.  -1.2]
    """
    start = checked("inverse_kinematics", mechanism, q=q, frames=frames)[0]
    starts = check.as_count(starts, "inverse_kinematics: starts", 1)
    iterations = check.as_count(iterations, "inverse_kinematics: iterations", 1)
    angle = check.above_zero(angle, "inverse_kinematics: angle")
    distance = check.above_zero(distance, "inverse_kinematics: distance")
    if starts > 1 and key is None:
        raise ValueError(f"inverse_kinematics: key: expected one of jax.random for {starts} starts, got None")
    if key is not None:
        check.require_key(key, "inverse_kinematics: key")
    if not mechanism.nv:
        raise ValueError("inverse_kinematics: mechanism: expected one with joints that move, got nv = 0")
    flat, batch = _targets(targets, frames, start)
    batch = floats.broadcast_shapes(start.shape[:-1], batch)
    names = (frames,) if isinstance(frames, str) else tuple(frames)
    still, start, given = fixed((mechanism, jnp.broadcast_to(start, (*batch, start.shape[-1])), flat))
    numbers = {"names": names, "iterations": iterations, "angle": angle, "distance": distance}
    approach = functools.partial(_inverse_kinematics, resolve(precision), (still,), **numbers)
    best = approach(start, given, None)
    if starts > 1:

        def again(state: tuple[jax.Array, _Best]) -> tuple[jax.Array, _Best]:
            k, best = state
            q = random_configuration(still, jax.random.fold_in(cast(Any, key), k), batch, start.dtype)
            return k + 1, approach(q, given, best)

        first = jnp.ones((), np.int32), best
        best = lax.while_loop(lambda x: (x[0] < starts) & ~(x[1].size <= 1).all(), again, first)[1]

    def ended(q, flat) -> tuple[jax.Array, SpatialVelocity, jax.Array]:
        """(q with its derivatives, the error there, its size). One step more has the derivatives of the motion that
        follows targets, and of no value."""
        task = _Task(mechanism, names, flat, precision)
        step = task.step(q, task.error(q), to_be_differentiated=True)
        q = valued(task.moved(q, step), q)
        error = task.error(q)
        return q, error.at_batch(0) if isinstance(frames, str) else error, _size(error, angle, distance)

    found, error, size = over_batch(ended, best.q, flat)
    return InverseKinematics(found, error, size <= 1, best.iterations[..., 0])


# -- arguments --------------------------------------------------------------------------------------------------------


def _targets(targets, frames, q) -> tuple[list, tuple[int, ...]]:
    """The targets as arrays (*batch, n 9) and (*batch, n 3), or the second alone; and their batch."""
    what = "inverse_kinematics: targets"
    n: tuple[int, ...] = () if isinstance(frames, str) else (len(frames),)
    refuse_double_words("inverse_kinematics", targets=targets)
    if isinstance(targets, RigidTransform):
        arrays = [jnp.asarray(x, x.dtype) for x in jax.tree.leaves(targets)]
    else:
        arrays = [floats.as_vectors(targets, what, q.dtype)]
    check.require_same_dtype(q=q, targets=arrays[-1])
    shape = arrays[-1].shape[:-1]
    if shape[len(shape) - len(n) :] != n:
        raise ValueError(f"{what}: expected a batch (*batch, {len(frames)}) for {len(frames)} frames, got {shape}")
    batch = shape[: len(shape) - len(n)]
    # Written out, for there may be no states.
    return [x.reshape(*batch, math.prod(x.shape[len(batch) :])) for x in arrays], batch


# -- one state --------------------------------------------------------------------------------------------------------


class _Task(NamedTuple):
    """What frames should be where. flat: the rotations (n 9,) and positions (n 3,) of targets, or the second alone."""

    mechanism: Mechanism
    frames: Sequence[str]
    flat: list[Any]
    precision: PrecisionName

    def error(self, q) -> SpatialVelocity:
        """V_FT_F (n,), of each frame."""
        X_WF = forward_kinematics(self.mechanism, q, self.frames, precision=self.precision)
        p_WT = self.flat[-1].reshape(-1, 3)
        if len(self.flat) == 1:
            p_FT_F = X_WF.rotation.inverse() @ (p_WT - X_WF.translation)
            return SpatialVelocity(jnp.zeros_like(p_FT_F), p_FT_F)
        X_WT = X_WF._with_vectors((self.flat[0].reshape(-1, 9), p_WT))
        return X_WF.inverse_times(X_WT, precision=self.precision).log(precision=self.precision)

    def jacobian(self, q) -> jax.Array:
        """The velocities of the frames (n, 2, 3, nv), angular and linear, in their axes."""
        J = jacobian(self.mechanism, q, self.frames, precision=self.precision)
        R_WF = forward_kinematics(self.mechanism, q, self.frames, precision=self.precision).rotation.to_matrix()
        J = J.reshape(len(self.frames), 2, 3, self.mechanism.nv)
        return jnp.einsum("nji,nkjv->nkiv", R_WF, J, precision="highest")

    def step(self, q, e: SpatialVelocity, *, to_be_differentiated: bool = False) -> jax.Array:
        """dq (nv,), bounded and damped; or, to be differentiated by e, neither, and with joints at limits at rest."""
        J, mechanism = self.jacobian(q), self.mechanism
        turns, moves = jnp.sum(J[:, 0] ** 2), jnp.sum(J[:, 1] ** 2)
        length = jnp.sqrt(jnp.where((turns > 0) & (moves > 0), moves / turns, 1.0).astype(J.dtype))
        is_turn = jnp.any(J[:, 0] != 0, axis=(0, 1))
        rows, error = J[:, 1] / length, jnp.asarray(e.v) / length
        if len(self.flat) == 2:
            rows, error = jnp.concatenate([J[:, 0], rows], 1), jnp.concatenate([jnp.asarray(e.w), error], -1)
        A, error = fixed(rows.reshape(-1, mechanism.nv)), error.reshape(-1)
        (are_one, places), (lower, upper) = _coordinates(mechanism), self._limits(q)
        is_low, is_high = (x[places] & are_one for x in (q <= lower, q >= upper))
        pull = jnp.matmul(error, A, precision="highest")
        is_held = is_low | is_high if to_be_differentiated else (is_low & (pull < 0)) | (is_high & (pull > 0))
        A = jnp.where(fixed(is_held), jnp.zeros_like(A), A)
        square = jnp.sum(A * A) / len(A)
        damping = jnp.asarray(32 * floats.eps(A.dtype), A.dtype)
        if not to_be_differentiated:
            damping = damping + _DAMPING * jnp.minimum(jnp.sum(error * error), 1.0)
        dq = _least_motion(A, error, damping * square)
        if to_be_differentiated:
            return dq
        turn = jnp.sqrt(jnp.sum(jnp.where(is_turn, dq, 0.0) ** 2))
        return dq * jnp.minimum(1.0, _LONGEST / jnp.maximum(turn, _LONGEST)).astype(dq.dtype)

    def moved(self, q, dq) -> jax.Array:
        q = integrate(self.mechanism, q, dq, precision=self.precision)
        return jnp.clip(q, *self._limits(q))

    def _limits(self, q) -> list[jax.Array]:
        return [jnp.asarray(x, q.dtype) for x in (self.mechanism.lower, self.mechanism.upper)]


def _coordinates(mechanism: Mechanism) -> tuple[np.ndarray, np.ndarray]:
    """For each velocity: whether it is the rate of a single coordinate, and of which."""
    t = mechanism.topology
    are_one, places = np.zeros(t.nv, bool), np.zeros(t.nv, int)
    for i in range(len(t)):
        if not t.is_mimic(i) and t.kind(i).nq == t.kind(i).nv == 1:
            are_one[t.v_slice(i)], places[t.v_slice(i)] = True, t.q_slice(i).start
    return are_one, places


def _least_motion(A: jax.Array, error: jax.Array, damping: jax.Array) -> jax.Array:
    """A^T (A A^T + damping)^-1 error, by the smaller of the two ways to write it; zero where A is."""
    wide = A.astype(A.dtype if A.dtype.itemsize > 2 else np.float32)
    e, shift = error.astype(wide.dtype), jnp.maximum(damping.astype(wide.dtype), jnp.finfo(wide.dtype).tiny ** 0.5)

    def solve(square: jax.Array, b: jax.Array) -> jax.Array:
        factor = jnp.linalg.cholesky(square + shift * jnp.eye(len(square), dtype=wide.dtype))
        return jax.scipy.linalg.cho_solve((factor, True), b)

    def times(x: jax.Array, y: jax.Array) -> jax.Array:
        return jnp.matmul(x, y, precision="highest")

    if len(A) <= A.shape[1]:
        return times(wide.T, solve(times(wide, wide.T), e)).astype(A.dtype)
    return solve(times(wide.T, wide), times(wide.T, e)).astype(A.dtype)


class _Best(NamedTuple):
    """The best configuration so far, (*batch, nq). size: of its error, in units of tolerances, (*batch, 1). iterations:
    how many steps were taken, (*batch, 1)."""

    q: jax.Array
    size: jax.Array
    iterations: jax.Array


class _State(NamedTuple):
    """Where the steps are, the best of where they have been, and how many from this start."""

    q: jax.Array
    error: SpatialVelocity
    best: _Best
    steps: jax.Array


def _size(error: SpatialVelocity, angle: float, distance: float) -> jax.Array:
    """Of the errors (n,) of one state, in units of the tolerances; infinite where they are NaN."""
    turn, way = (jnp.sqrt(jnp.max(jnp.sum(x * x, -1))) for x in (jnp.asarray(error.w), jnp.asarray(error.v)))
    largest = jnp.maximum(turn / angle, way / distance)
    return jnp.where(jnp.isnan(largest), np.inf, largest).astype(way.dtype)


@composite
def _inverse_kinematics(
    precision: Precision,
    scene: tuple[Mechanism],
    q: jax.Array,
    flat: list[jax.Array],
    before: _Best | None,
    *,
    names: tuple[str, ...],
    iterations: int,
    angle: float,
    distance: float,
) -> _Best:
    """The best configuration of some steps from a start, and of those before. As one program: in a batch each state
    ends by itself."""
    (mechanism,) = scene
    task = _Task(mechanism, names, flat, precision.value)

    def nearer(best: _Best, q, error: SpatialVelocity) -> _Best:
        found = _size(error, angle, distance)[None]
        is_better = (found < best.size) & ~(best.size <= 1)
        return best._replace(q=jnp.where(is_better, q, best.q), size=jnp.where(is_better, found, best.size))

    def stepped(state: _State) -> _State:
        q = task.moved(state.q, task.step(state.q, state.error))
        error = task.error(q)
        return _State(q, error, nearer(state.best, q, error), state.steps + 1)

    # A step of length 0 normalises quaternions.
    q = task.moved(q, np.zeros(mechanism.nv, q.dtype))
    error = task.error(q)
    if before is None:
        before = _Best(q, jnp.full(1, np.inf, q.dtype), jnp.zeros(1, np.int32))
    start = _State(q, error, nearer(before, q, error), jnp.zeros(1, np.int32))

    def goes_on(state: _State) -> jax.Array:
        return (~(state.best.size <= 1) & (state.steps < iterations))[0]

    end = lax.while_loop(goes_on, stepped, start)
    return end.best._replace(iterations=before.iterations + end.steps)
