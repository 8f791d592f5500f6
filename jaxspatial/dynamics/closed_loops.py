"""Closed loops: what holds frames of a mechanism together beside its joints, and the motion of all under it.

A closure is described by the motion of its frame B as seen from its frame A, X_AB = (R, p). The error e(R, p), in rows,
is a function of it, and the Jacobian and what velocities contribute to accelerations are derivatives of that function.

The equations of motion are those of the tree with the wrenches of the closures,

    M vdot + h = tau + J^T l        J vdot + b = 0        b = dJ/dt v

The accelerations of the tree alone come from articulated bodies, and so does Y = M^-1 J^T, column by column with the
factors that are there already. What is left is G l = -(J vdot_tree + b), G = J Y, as large as there are rows. Where
rows depend on others, G is singular: the equation is solved by proximal iterations, which find one of its solutions.
All of them give the same J^T l. [Carpentier, Budhiraja, Mansard 2021, Proximal and sparse resolution of constrained
dynamic equations]
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.dynamics.configuration import difference, integrate
from jaxspatial.dynamics.docstrings import documented
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.jacobians import jacobian
from jaxspatial.dynamics.kinematics import body_accelerations, body_velocities, forward_kinematics
from jaxspatial.engine.algorithm import ExternalForces, checked
from jaxspatial.mechanism import LoopClosure, Mechanism
from jaxspatial.mechanism.loops import checked_loops
from jaxspatial.numerics import check
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import SpatialForce

# Of the proximal iterations: how many. Each reduces the error along an eigenvector of G, with its rows scaled to a
# diagonal of ones, by shift / (eigenvalue + shift); the shift is eps^(2/3).
_ITERATIONS = 6


@exported
class ConstrainedDynamics(NamedTuple):
    """What `constrained_forward_dynamics` finds.

    vdot: (*batch, nv) generalized accelerations. loop_wrenches: SpatialForce (*batch, number of closures), of each
    closure on the body of its frame B, about the origin of B, in world axes; on the body of frame A acts the opposite,
    about the same point.
    """

    vdot: jax.Array
    loop_wrenches: SpatialForce


@exported
class ClosedConfiguration(NamedTuple):
    """What `close_loops` finds.

    q: (*batch, nq). residual: (*batch,) the largest number of `constraint_error` there, rad or m.
    """

    q: jax.Array
    residual: jax.Array


@documented
def constraint_error(
    mechanism: Mechanism, q: ArrayLike, loops: Iterable[LoopClosure], *, precision: PrecisionName = None
) -> jax.Array:
    """How far loops are from closed: zero where they are.

    Rows come closure by closure, for each first of orientations, then of positions, from frame A to frame B and in the
    axes of A. "weld": the rotation vector of R_AB, rad, and p_AB. "hinge": x and y of the rotation vector that takes z
    of A to z of B, rad, and p_AB. "universal": the sine of the angle about -z of A x x of B by which x of B leaves the
    plane across z of A, and p_AB. "ball": p_AB. "distance": |p_AB| less the distance.

    Returns:
        (*batch, rows): rad, m.

    Error: in every precision 64 u of 1 rad and of the largest coordinate of an origin in the world, in addition to the
        errors of `forward_kinematics`.
    Source: Featherstone 2008, 8.2 (loop constraints).
    """
    q, loops, distances = _checked("constraint_error", mechanism, loops, q=q)

    def error(q: Any, distances: Any) -> jax.Array:
        return _errors(_closures(mechanism, q, loops, distances, precision), q.dtype)

    return _over_batch(error, q, distances)


@documented
def constraint_jacobian(
    mechanism: Mechanism, q: ArrayLike, loops: Iterable[LoopClosure], *, precision: PrecisionName = None
) -> jax.Array:
    """The derivative of `constraint_error` along velocities: its rate is J v, at all q.

    J^T l is the generalized force of the closures whose multipliers are l. At the closed configurations of a "weld",
    "hinge" or "ball" multipliers are torques and forces on B along the axes of A.

    Returns:
        J (*batch, rows, nv).

    Error: in every precision 64 u of the largest number of `jacobian` of the frames, in addition to its errors and
        those of `forward_kinematics`.
    Source: Featherstone 2008, 8.2 (loop constraints).
    """
    q, loops, distances = _checked("constraint_jacobian", mechanism, loops, q=q)

    def rows(q: Any, distances: Any) -> jax.Array:
        closures = _closures(mechanism, q, loops, distances, precision)
        return _jacobian(mechanism, q, loops, closures, [x.by_twist() for x in closures], precision)

    return _over_batch(rows, q, distances)


@documented
def constrained_forward_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    loops: Iterable[LoopClosure],
    external_forces: ExternalForces = None,
    *,
    stabilization: ArrayLike | None = None,
    precision: PrecisionName = None,
) -> ConstrainedDynamics:
    """The generalized accelerations of a mechanism with closed loops, and the wrenches that keep them closed.

        M vdot + C(q, v) v + g(q) = tau + J^T F + J^T l        d^2/dt^2 constraint_error = 0

    q and v are to be closed: `close_loops` closes q, and J v = 0. They are taken as they are, and accelerations say
    nothing of errors that are there. In time, loops open: an error of the first step stays, one of velocity grows in
    proportion to time, and those of an integrator add up. `stabilization` pulls back.

    Closures may be redundant: a planar loop closed by a "ball", a hinge that is held at two points. vdot and J^T l are
    unique then, the multipliers are not, and of the wrenches these are one choice of many. Closures that contradict one
    another are met in the mean.

    Derivatives, by all arguments, are those of the equations, which the same factors solve; also where closures are
    redundant. In configurations in which rows become dependent that are not so beside them, as of a four-bar linkage
    folded flat, the multipliers grow without bound as one comes near, and there are no derivatives.

    Args:
        stabilization: a rate k, 1/s, a number or (*batch,), after Baumgarte: errors e then decay as
            d^2e/dt^2 = -2 k de/dt - k^2 e. An explicit integrator wants k dt well below 1. None for none.

    Returns:
        ConstrainedDynamics: vdot (*batch, nv): rad/s^2, m/s^2; loop_wrenches (*batch, number of closures): N m, N.

    Error: in every precision n u c of the largest acceleration of the tree and of the largest number of M^-1 J^T l,
        with c the condition number of the mass matrix and n the number of links in the longest chain and of rows, while
        the eigenvalues of J M^-1 J^T, its rows scaled to a diagonal of ones, are 0 or above 1e-8 in float64 and 1e-3 in
        float32.
    Source: Carpentier, Budhiraja, Mansard 2021, Proximal and sparse resolution of constrained dynamic equations;
        Baumgarte 1972, Stabilization of constraints and integrals of motion in dynamical systems.
    """
    operation = "constrained_forward_dynamics"
    q, v, tau, forces, loops, distances = _checked(
        operation, mechanism, loops, q=q, v=v, tau=tau, external_forces=external_forces
    )
    k = None if stabilization is None else check.as_float_array(stabilization, f"{operation}: stabilization", q.dtype)
    k = None if k is None else k[..., None]
    return _over_batch(functools.partial(_constrained, mechanism, loops, precision), q, v, tau, k, distances, forces)


@documented
def close_loops(
    mechanism: Mechanism,
    q: ArrayLike,
    loops: Iterable[LoopClosure],
    *,
    iterations: int = 20,
    precision: PrecisionName = None,
) -> ClosedConfiguration:
    """Closes loops: moves q to a configuration near by in which `constraint_error` is zero.

    Damped Gauss-Newton iterations, each the smallest motion, in the 2-norm over velocities, that closes the loops to
    first order. They are damped by the square of their length, and converge quadratically near a closed configuration,
    also where closures are redundant. Far from one they may not converge: `residual` tells. To choose which joints
    move, lock the others (`lock_joints`), or start from where these should be.

    The derivative by q is the projection of motions onto those that keep loops closed, and that by numbers of the
    mechanism the smallest motion that closes them again (the implicit function theorem): exact where q is closed
    already, else as if the result had been the start. Second derivatives are not those of a projection.

    Args:
        iterations: how many at most; their number is fixed, and each is a few kernels. From 0.1 rad 5 are enough.

    Returns:
        ClosedConfiguration: q (*batch, nq), quaternions of unit length; residual (*batch,): rad or m.

    Error: the residual, which is as small as the error of `constraint_error` where iterations have converged.
    Source: Fan, Yuan 2005, On the quadratic convergence of the Levenberg-Marquardt method without nonsingularity
        assumption.
    """
    q, loops, distances = _checked("close_loops", mechanism, loops, q=q)

    def closed(q: Any, distances: Any) -> ClosedConfiguration:
        return _closed(mechanism, loops, precision, iterations, q, distances)

    return _over_batch(closed, q, distances)


# -- arguments --------------------------------------------------------------------------------------------------------


def _checked(operation: str, mechanism: Mechanism, loops: Any, **arguments: Any) -> tuple[Any, ...]:
    """The arguments as `engine.algorithm.checked` returns them, the closures, and their distances (*batch, 1) or None.

    The frames of closures are looked up here, so that messages name the operation.
    """
    found = checked(operation, mechanism, **arguments)
    loops, dtype = checked_loops(loops, f"{operation}: loops"), found[0].dtype
    for name in (name for loop in loops for name in (loop.frame_a, loop.frame_b)):
        mechanism.topology.index(mechanism.frame_names, name, f"{operation}: loops")
    distances = [None if loop.distance is None else _distance(operation, loop, dtype) for loop in loops]
    return *found, loops, distances


def _distance(operation: str, loop: LoopClosure, dtype: np.dtype) -> Any:
    distance: Any = loop.distance
    if isinstance(distance, np.ndarray):
        return distance.astype(dtype)[..., None]
    distance = check.as_float_array(distance, f"{operation}: loops: distance", dtype)
    check.require_same_dtype(q=np.zeros(0, dtype), distance=distance)
    return distance[..., None]


def _over_batch(function: Callable[..., Any], *arguments: Any) -> Any:
    """The function of one state, over the common batch of its arguments: trees of arrays (*batch, n)."""
    leaves, tree = jax.tree.flatten(arguments)
    batch = np.broadcast_shapes(*(x.shape[:-1] for x in leaves))

    def of_leaves(*leaves: Any) -> Any:
        return function(*jax.tree.unflatten(tree, leaves))

    for _ in batch:
        of_leaves = jax.vmap(of_leaves)
    return of_leaves(*check.broadcast_batch(batch, *leaves))


# -- one closure ------------------------------------------------------------------------------------------------------


class _Pose(NamedTuple):
    """X_AB by its matrix R (3, 3) and position p (3,), or a derivative of it."""

    R: jax.Array
    p: jax.Array


class _Closure(NamedTuple):
    """A closure at one configuration: the poses of its frames, and its error as a function of X_AB."""

    R_WA: jax.Array
    p_AB_W: jax.Array
    X_AB: _Pose
    error: Callable[[_Pose], jax.Array]

    def by_twist(self) -> jax.Array:
        """The derivative (rows, 6) of the error by the motion of B seen from A: (w, v) in world axes."""
        twists = jnp.eye(6, dtype=self.p_AB_W.dtype)

        def along(twist: jax.Array) -> jax.Array:
            return jax.jvp(self.error, (self.X_AB,), (_Pose(_skew(twist[:3]) @ self.X_AB.R, twist[3:]),))[1]

        of_A = jax.vmap(along)(twists)
        R_AW = self.R_WA.T
        return jnp.concatenate([_times(of_A[:3].T, R_AW), _times(of_A[3:].T, R_AW)], -1)

    def second_rate(self, V_A: jax.Array, V_B: jax.Array, A_A: jax.Array, A_B: jax.Array) -> jax.Array:
        """The second rate of the error, from velocities and accelerations (6,) of the two origins in world axes."""
        (w_A, v_A), (w_B, v_B), (alpha_A, a_A), (alpha_B, a_B) = (jnp.split(x, 2) for x in (V_A, V_B, A_A, A_B))
        p, cross = self.p_AB_W, jnp.cross
        # The motion of B for an observer who moves with A.
        w, v = w_B - w_A, v_B - v_A - cross(w_A, p)
        alpha = alpha_B - alpha_A - cross(w_A, w_B)
        a = a_B - a_A - cross(alpha_A, p) - cross(w_A, cross(w_A, p) + 2 * v)
        w, v, alpha, a = map(self._in_A, (w, v, alpha, a))
        turning = _skew(w)
        first = _Pose(_times(turning, self.X_AB.R), v)
        second = _Pose(_times(_skew(alpha) + _times(turning, turning), self.X_AB.R), a)

        def rate(X: _Pose, of_X: _Pose) -> jax.Array:
            return jax.jvp(self.error, (X,), (of_X,))[1]

        return jax.jvp(rate, (self.X_AB, first), (first, second))[1]

    def _in_A(self, x: jax.Array) -> jax.Array:
        return _times(self.R_WA.T, x)


def _error(kind: str, distance: jax.Array | None, X_AB: _Pose) -> jax.Array:
    """The rows of one closure, see `constraint_error`."""
    R, p = X_AB
    if kind == "distance":
        return _length(p)[None] - distance
    if kind == "weld":
        return jnp.concatenate([Rotation(R.reshape(9)).log(), p])
    if kind == "hinge":
        z = np.array([0, 0, 1], R.dtype)
        return jnp.concatenate([Rotation.between(z, R[:, 2]).log()[:2], p])
    return jnp.concatenate([-R[2:, 0], p]) if kind == "universal" else p


def _length(p: jax.Array) -> jax.Array:
    """|p|, with derivative 0 where it is 0."""
    squared = jnp.sum(p * p)
    is_zero = squared == 0
    return jnp.where(is_zero, 0, jnp.sqrt(jnp.where(is_zero, 1, squared)))


def _skew(x: jax.Array) -> jax.Array:
    """[x]x."""
    i, j, k = x
    zero = jnp.zeros_like(i)
    return jnp.stack([zero, -k, j, k, zero, -i, -j, i, zero]).reshape(3, 3)


_times = functools.partial(jnp.matmul, precision=lax.Precision.HIGHEST)


# -- all of them ------------------------------------------------------------------------------------------------------


def _closures(
    mechanism: Mechanism, q: Any, loops: Sequence[LoopClosure], distances: Sequence[Any], precision: PrecisionName
) -> list[_Closure]:
    if not loops:
        return []
    X_WF = forward_kinematics(mechanism, q, _frames(loops), precision=precision)
    R_WF, p_WF, n = X_WF.rotation.to_matrix(), X_WF.translation, len(loops)
    closures: list[_Closure] = []
    for R_WA, R_WB, p_WA, p_WB, loop, distance in zip(R_WF, R_WF[n:], p_WF, p_WF[n:], loops, distances, strict=False):
        p_AB_W = p_WB - p_WA
        X_AB = _Pose(_times(R_WA.T, R_WB), _times(R_WA.T, p_AB_W))
        closures.append(_Closure(R_WA, p_AB_W, X_AB, functools.partial(_error, loop.kind, distance)))
    return closures


def _frames(loops: Sequence[LoopClosure]) -> list[str]:
    """Frames A of all closures, then frames B."""
    return [loop.frame_a for loop in loops] + [loop.frame_b for loop in loops]


def _errors(closures: Sequence[_Closure], dtype: np.dtype) -> jax.Array:
    return jnp.concatenate([jnp.zeros(0, dtype), *(x.error(x.X_AB) for x in closures)])


def _jacobian(
    mechanism: Mechanism,
    q: Any,
    loops: Sequence[LoopClosure],
    closures: Sequence[_Closure],
    by_twist: Sequence[jax.Array],
    precision: PrecisionName,
) -> jax.Array:
    """The rows (rows, nv) of all closures."""
    rows = [jnp.zeros((0, mechanism.nv), q.dtype)]
    J_WF = jacobian(mechanism, q, _frames(loops), precision=precision) if loops else ()
    for J_A, J_B, closure, D in zip(J_WF, J_WF[len(loops) :], closures, by_twist, strict=False):
        # The twists of B for an observer who moves with A.
        turned = _times(_skew(closure.p_AB_W), J_A[:3])
        rows.append(_times(D, J_B - J_A + jnp.concatenate([jnp.zeros_like(turned), turned])))
    return jnp.concatenate(rows)


# -- dynamics ---------------------------------------------------------------------------------------------------------


def _constrained(
    mechanism: Mechanism,
    loops: Sequence[LoopClosure],
    precision: PrecisionName,
    q: Any,
    v: Any,
    tau: Any,
    k: Any,
    distances: Sequence[Any],
    forces: Any,
) -> ConstrainedDynamics:
    """`constrained_forward_dynamics` of one state."""

    def of_tree(tau: Any) -> jax.Array:
        return forward_dynamics(mechanism, q, v, tau, forces, precision=precision)

    # The derivative by tau is M^-1, with the factors that vdot is computed with.
    vdot, times_inverse = jax.linearize(of_tree, tau)
    closures = _closures(mechanism, q, loops, distances, precision)
    by_twist = [x.by_twist() for x in closures]
    J = _jacobian(mechanism, q, loops, closures, by_twist, precision)
    if not loops:
        return ConstrainedDynamics(vdot, SpatialForce.zero(0, vdot.dtype))
    Y = jax.vmap(times_inverse)(J)
    due = -_biases(mechanism, q, v, loops, closures, precision)
    if k is not None:
        due -= 2 * k * _times(J, v) + k * k * _errors(closures, vdot.dtype)
    multipliers = _multipliers(_times(J, Y.T), due - _times(J, vdot))
    of_each = jnp.split(multipliers, np.cumsum([loop.rows for loop in loops])[:-1].tolist())
    F = jnp.stack([_times(D.T, x) for D, x in zip(by_twist, of_each, strict=True)])
    return ConstrainedDynamics(vdot + _times(multipliers, Y), SpatialForce(F[:, :3], F[:, 3:]))


def _biases(
    mechanism: Mechanism,
    q: Any,
    v: Any,
    loops: Sequence[LoopClosure],
    closures: Sequence[_Closure],
    precision: PrecisionName,
) -> jax.Array:
    """The second rates of all errors (rows,) at vdot = 0."""
    frames, n = _frames(loops), len(loops)
    V = body_velocities(mechanism, q, v, frames, precision=precision).to_array()
    A = body_accelerations(mechanism, q, v, jnp.zeros_like(v), frames, precision=precision).to_array()
    each = zip(closures, V, V[n:], A, A[n:], strict=False)
    return jnp.concatenate([closure.second_rate(*motions) for closure, *motions in each])


def _multipliers(G: jax.Array, b: jax.Array) -> jax.Array:
    """A solution x of G x = b for symmetric G, positive semidefinite; in the mean where there is none.

    JAX differentiates it by its equation, not by its iterations.
    """
    solve = _proximal(G)
    found = lax.custom_linear_solve(
        functools.partial(_times, G), b, lambda _, b: solve(b), lambda _, b: solve(b), symmetric=True
    )
    return cast(jax.Array, found)


def _proximal(G: jax.Array) -> Callable[[jax.Array], jax.Array]:
    """The solver of G x = b by proximal iterations."""
    scale, A = _equilibrated(G)
    inverse = _inverse(A, _shift(A.dtype))

    def solve(b: jax.Array) -> jax.Array:
        b, x = scale * b, jnp.zeros_like(b)
        for _ in range(_ITERATIONS):
            x += _times(inverse, b - _times(A, x))
        return scale * x

    return solve


def _equilibrated(G: jax.Array) -> tuple[jax.Array, jax.Array]:
    """(s, s G s), with a diagonal of ones: rows may be of radians and of metres. Rows of zeros stay."""
    diagonal = jnp.diagonal(G)
    scale = lax.rsqrt(jnp.where(diagonal > 0, diagonal, 1))
    return scale, scale[:, None] * G * scale[None, :]


def _inverse(A: jax.Array, shift: jax.Array | float) -> jax.Array:
    """(A + shift)^-1, of a positive definite matrix."""
    eye = jnp.eye(len(A), dtype=A.dtype)
    half = lax.linalg.triangular_solve(jnp.linalg.cholesky(A + shift * eye), eye, left_side=True, lower=True)
    return _times(half.T, half)


def _shift(dtype: np.dtype) -> float:
    return check.eps(dtype) ** (2 / 3)


# -- configurations ---------------------------------------------------------------------------------------------------


def _closed(
    mechanism: Mechanism,
    loops: Sequence[LoopClosure],
    precision: PrecisionName,
    iterations: int,
    q: Any,
    distances: Sequence[Any],
) -> ClosedConfiguration:
    """`close_loops` of one state."""
    # A step of length 0 normalises quaternions.
    at_rest = np.zeros(mechanism.nv, q.dtype)
    if not loops:
        q = integrate(mechanism, q, at_rest, precision=precision)
        return ClosedConfiguration(q, jnp.zeros((), q.dtype))
    fixed, start, lengths = _fixed(mechanism), _fixed(q), _fixed(distances)

    def linearized(q: Any) -> tuple[jax.Array, jax.Array]:
        closures = _closures(fixed, q, loops, lengths, precision)
        J = _jacobian(fixed, q, loops, closures, [x.by_twist() for x in closures], precision)
        return _errors(closures, q.dtype), J

    def nearer(_: Any, q: Any) -> jax.Array:
        error, J = linearized(q)
        scale, A = _equilibrated(_times(J, J.T))
        error = scale * error
        damping = _shift(A.dtype) + jnp.sum(error * error)
        step = _times(scale * _times(_inverse(A, damping), error), J)
        return integrate(fixed, q, -step, precision=precision)

    end = lax.fori_loop(0, iterations, nearer, integrate(fixed, start, at_rest, precision=precision))
    # Derivatives are those of one more step, in which the start and the error vary, and nothing else.
    moved = integrate(fixed, q, difference(fixed, start, end, precision=precision), precision=precision)
    _, J = linearized(_fixed(moved))
    error = _errors(_closures(mechanism, moved, loops, distances, precision), moved.dtype)
    closed = integrate(fixed, moved, -_times(_proximal(_times(J, J.T))(error), J), precision=precision)
    residual, _ = linearized(_fixed(closed))
    return ClosedConfiguration(closed, jnp.max(jnp.abs(residual)))


def _fixed(tree: Any) -> Any:
    """The tree as constants of derivatives; NumPy numbers are so already, and stay known."""
    return jax.tree.map(lambda x: lax.stop_gradient(x) if isinstance(x, jax.Array) else x, tree)
