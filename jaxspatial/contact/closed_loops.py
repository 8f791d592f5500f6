"""Closed loops: what holds frames of a mechanism together beside its joints, and the motion of all under it.

The equations of motion are those of the tree with the wrenches of the closures, whose rows `closures` defines,

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

from jaxspatial.contact.closures import (
    LoopJacobian,
    LoopsOfState,
    are_of_one_body,
    checked_closures,
    errors_of,
    require_closable,
    times,
)
from jaxspatial.dynamics.configuration import difference, integrate
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.engine.algorithm import ExternalForces, Wrenches, checked, over_batch
from jaxspatial.engine.composite import composite
from jaxspatial.engine.derivatives import fixed, valued
from jaxspatial.engine.stacking import Array
from jaxspatial.mechanism import LoopClosure, Mechanism
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialForce

# Of the proximal iterations: how many. Each reduces the error along an eigenvector of G, with its rows scaled to a
# diagonal of ones, by shift / (eigenvalue + shift). The shift is the root of eps: where closures contradict one another
# multipliers grow with its inverse, and their rounding errors with them.
_ITERATIONS = 10
# Of Gauss-Newton steps, times the square of their length in rad: bounds steps to about 1.6 rad.
_DAMPING = 0.1


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


def constraint_error(
    mechanism: Mechanism, q: ArrayLike, loops: Iterable[LoopClosure], *, precision: PrecisionName = None
) -> jax.Array:
    """How far loops are from closed: zero where they are.

    Rows come closure by closure, for each first of orientations, then of positions, from frame A to frame B and in the
    axes of A. "weld": the rotation vector of R_AB, rad, and p_AB. "hinge": x and y of the rotation vector that takes z
    of A to z of B, rad, and p_AB. "universal": the sine of the angle about -z of A x x of B by which x of B leaves the
    plane across z of A, and p_AB. "ball": p_AB. "distance": |p_AB| less the distance. Rows between frames of the same
    body, or of the world, are constant: what is open there can never close.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        loops: LoopClosures, such as `mechanism.loops`; none at all leave the tree.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, rows): rad, m.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or loops are no
            LoopClosures.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: in every precision 8 u of 1 rad and of the largest coordinate of an origin in the world, in addition to the
        errors of `forward_kinematics`.
    Source: Featherstone 2008, 8.2 (loop constraints).

    Example:
        >>> pin = js.LoopClosure("world", "hand", "ball")
        >>> print(js.constraint_error(arm, q, [pin]))
        [-0.7749  0.     -1.8329]
    """
    q, closures, distances = _checked("constraint_error", mechanism, loops, q=q)
    return _constraint_error(resolve(precision), (mechanism, closures), q, distances)


def constraint_jacobian(
    mechanism: Mechanism, q: ArrayLike, loops: Iterable[LoopClosure], *, precision: PrecisionName = None
) -> jax.Array:
    """The Jacobian of loop closures: J v is the velocity that they hold at zero.

    Rows are those of `constraint_error`: of angular velocities, then of the velocity of the origin of B, for an
    observer on A and in the axes of A. A "distance" between origins that coincide is along z of A. At closed
    configurations J v is the rate of `constraint_error`, for "universal", "ball" and "distance" at all others too.
    J^T l is the generalized force of closures with the multipliers l, torques and forces on B along the axes of A. Rows
    of a closure between frames of the same body, or of the world, are zero.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        loops: LoopClosures, such as `mechanism.loops`; none at all leave the tree.
        precision: name of a precision; None takes the default.

    Returns:
        J (*batch, rows, nv).

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or loops are no
            LoopClosures.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: in every precision 8 u of the largest number of `jacobian` of the frames, in addition to its errors and those
        of `forward_kinematics`.
    Source: Featherstone 2008, 8.2 (loop constraints).

    Example:
        >>> pin = js.LoopClosure("world", "hand", "ball")
        >>> J = js.constraint_jacobian(arm, q, [pin])
        >>> print(np.allclose(J, js.jacobian(arm, q, "hand")[3:], atol=1e-6))
        True
    """
    q, closures, distances = _checked("constraint_jacobian", mechanism, loops, q=q)
    return _constraint_jacobian(resolve(precision), (mechanism, closures), q, distances)


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

    Velocities without inertia have the acceleration 0, as in `forward_dynamics`: a closure is not met where it would
    have to accelerate a body without mass or armature. One between frames of the same body, or of the world, asks for
    nothing: its wrench is zero. An open one can never close, and is refused where its numbers are known while tracing;
    `constraint_error` tells of others.

    Derivatives, by all arguments, are those of the equations, which the same factors solve; also where closures are
    redundant. There are none in singular configurations, such as a four-bar linkage that is folded flat: there rows
    become dependent that are independent nearby, and the multipliers grow without bound as one comes near. Neither are
    there derivatives by what takes a planar loop out of its plane.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        loops: LoopClosures, such as `mechanism.loops`; none at all leave the tree.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        stabilization: a rate k, 1/s, a number or (*batch,), after Baumgarte: errors e then decay as
            d^2e/dt^2 = -2 k de/dt - k^2 e. An explicit integrator wants k dt well below 1. None for none.
        precision: name of a precision; None takes the default.

    Returns:
        ConstrainedDynamics: vdot (*batch, nv): rad/s^2, m/s^2; loop_wrenches (*batch, number of closures): N m, N.

    Raises:
        ValueError: a closure between frames of the same body, or of the world, is open, by numbers that are known while
            tracing.

    Error: in every precision n u c of the largest acceleration of the tree and of the largest number of M^-1 J^T l,
        with c the condition number of the mass matrix and n the number of links in the longest chain and of rows, while
        the eigenvalues of J M^-1 J^T, its rows scaled to a diagonal of ones, are 0 or above 1e-7 in float64 and 1e-3 in
        float32. Closures that contradict one another by r add 1e-7 r in float64, 1e-2 r in float32.
    Source: Carpentier, Budhiraja, Mansard 2021, Proximal and sparse resolution of constrained dynamic equations;
        Baumgarte 1972, Stabilization of constraints and integrals of motion in dynamical systems.

    Example:
        >>> pin = js.LoopClosure("world", "lower", "ball")  # already there: it holds the elbow
        >>> found = js.constrained_forward_dynamics(arm, q, 0 * v, tau, [pin])
        >>> print(np.abs(js.constraint_jacobian(arm, q, [pin]) @ found.vdot).max() < 1e-4)
        True
    """
    operation = "constrained_forward_dynamics"
    q, v, tau, forces, closures, distances = _checked(
        operation, mechanism, loops, q=q, v=v, tau=tau, external_forces=external_forces
    )
    dtype, k = cast(Any, q).dtype, None
    require_closable(operation, mechanism, closures, distances, dtype)
    if stabilization is not None:
        k = floats.as_float_array(stabilization, f"{operation}: stabilization", dtype)[..., None]

    if closures and mechanism.nv:
        return _constrained_forward_dynamics(resolve(precision), (mechanism, closures), q, v, tau, k, forces, distances)
    # Without velocities nothing moves whatever the wrenches are.
    vdot = forward_dynamics(mechanism, q, v, tau, forces, precision=precision)
    batch = floats.broadcast_shapes(vdot.shape[:-1], *(x.shape[:-1] for x in jax.tree.leaves((distances, k))))
    vdot = jnp.broadcast_to(vdot, (*batch, mechanism.nv))
    return ConstrainedDynamics(vdot, SpatialForce.zero((*batch, len(closures)), dtype))


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
    first order. They are damped in proportion to the square of their length, and converge quadratically near a closed
    configuration, also where closures are redundant. Far from one they may not converge: `residual` tells. To choose
    which joints move, lock the others (`lock_joints`), or start from where these should be.

    The derivative by q is the projection of motions onto those that keep loops closed, and that by numbers of the
    mechanism the smallest motion that closes them again (the implicit function theorem): exact where q is closed
    already, else as if the result had been the start. So are second derivatives; of higher ones there is no promise.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        loops: LoopClosures, such as `mechanism.loops`; none at all leave the tree.
        iterations: how many at most. From 0.1 rad 5 are enough. Each state of a batch takes those that it needs.
        precision: name of a precision; None takes the default.

    Returns:
        ClosedConfiguration: q (*batch, nq), quaternions of unit length; residual (*batch,): rad or m.

    Raises:
        ValueError: iterations is no integer from 0 on; or a closure between frames of the same body, or of the world,
            is open, by numbers that are known while tracing. The residual tells of others.

    Error: the residual, which is as small as the error of `constraint_error` where iterations have converged.
    Source: Fan, Yuan 2005, On the quadratic convergence of the Levenberg-Marquardt method without nonsingularity
        assumption.

    Example:
        >>> rope = js.LoopClosure("world", "hand", "distance", 1.5)
        >>> closed = js.close_loops(arm, q, [rope])
        >>> print(closed.q, closed.residual < 1e-5)
        [ 0.5    -1.4455] True
    """
    q, closures, distances = _checked("close_loops", mechanism, loops, q=q)
    iterations = check.as_count(iterations, "close_loops: iterations", 0)
    require_closable("close_loops", mechanism, closures, distances, cast(Any, q).dtype)

    return over_batch(
        lambda q, own: _closed_configuration(LoopsOfState(mechanism, closures, own, precision), q, iterations),
        q,
        distances,
    )


# -- arguments --------------------------------------------------------------------------------------------------------


def _checked(operation: str, mechanism: Mechanism, loops, **arguments) -> tuple:
    """The arguments as `algorithm.checked` returns them, the closures, and their distances (*batch, 1) or None."""
    found = checked(operation, mechanism, **arguments)
    return *found, *checked_closures(operation, mechanism, loops, found[0].dtype)


# -- errors and rows --------------------------------------------------------------------------------------------------


# What programs of closures have beside arrays: see `composite`.
Scene = tuple[Mechanism, tuple[LoopClosure, ...]]


@composite
def _constraint_error(precision: Precision, scene: Scene, q: jax.Array, distances: Sequence[Array | None]):
    return errors_of(LoopsOfState(*scene, distances, precision.value).placed(q), q.dtype)


@composite
def _constraint_jacobian(precision: Precision, scene: Scene, q: jax.Array, distances: Sequence[Array | None]):
    loops = LoopsOfState(*scene, distances, precision.value)
    return loops.jacobian(q, loops.placed(q)).J


# -- dynamics ---------------------------------------------------------------------------------------------------------


@composite
def _constrained_forward_dynamics(
    precision: Precision,
    scene: Scene,
    q: jax.Array,
    v: jax.Array,
    tau: jax.Array,
    k: Array | None,
    forces: Wrenches,
    distances: Sequence[Array | None],
) -> ConstrainedDynamics:
    """`constrained_forward_dynamics` of one state, as one program."""
    loops = LoopsOfState(*scene, distances, precision.value)

    def of_tree(tau: jax.Array) -> jax.Array:
        return forward_dynamics(loops.mechanism, q, v, tau, cast(ExternalForces, forces), precision=loops.precision)

    # The derivative by tau is M^-1, with the factors that vdot is computed with.
    vdot, times_inverse = jax.linearize(of_tree, tau)
    placed = loops.placed(q)
    J, squares = loops.jacobian(q, placed)
    Y = jax.vmap(times_inverse)(J)
    due = -loops.biases(q, v, placed)
    if k is not None:
        due -= 2 * k * times(J, v) + k * k * errors_of(placed, vdot.dtype)
    multipliers = _multipliers(times(J, Y.T), due - times(J, vdot), LoopJacobian(J, squares))
    of_each = jnp.split(multipliers, np.cumsum([x.rows for x in loops.closures])[:-1].tolist())
    F = jnp.stack([times(own, x.N_W) for own, x in zip(of_each, placed, strict=True)])
    return ConstrainedDynamics(vdot + times(multipliers, Y), SpatialForce(F[:, :3], F[:, 3:]))


def _multipliers(G: jax.Array, b: jax.Array, rows: LoopJacobian) -> jax.Array:
    """A solution x of G x = b. JAX differentiates it by its equation, and not by how it is solved."""
    solve = _proximal(*fixed((G, rows)))
    found = lax.custom_linear_solve(functools.partial(times, G), b, lambda _, b: solve(b), symmetric=True)
    return cast(jax.Array, found)


def _proximal(G: jax.Array, rows: LoopJacobian) -> Callable[[jax.Array], jax.Array]:
    """The solver of G x = b for symmetric positive semidefinite G by proximal iterations; in the mean where there is no
    solution."""
    scale, A = _equilibrated(G, rows)
    inverse = _inverse(A, _regularization(A.dtype))

    def solve(b: jax.Array) -> jax.Array:
        b, x = scale * b, jnp.zeros_like(b)
        for _ in range(_ITERATIONS):
            x += times(inverse, b - times(A, x))
        return scale * x

    return solve


def _equilibrated(G: jax.Array, rows: LoopJacobian) -> tuple[jax.Array, jax.Array]:
    """(s, s G s), with a diagonal of ones: rows may be of radians and of metres.

    Rows that are zero stay so, up to rounding: across the plane of a planar loop nothing moves, and what is left of
    numbers that cancel says nothing.
    """
    norms = jnp.sum(rows.J * rows.J, -1)
    share = norms / jnp.where(rows.squares > 0, norms + _regularization(G.dtype) * rows.squares, 1)
    diagonal = jnp.diagonal(G)
    scale = jnp.sqrt(share / jnp.where(diagonal > 0, diagonal, 1))
    return scale, scale[:, None] * G * scale[None, :]


def _inverse(A: jax.Array, shift: jax.Array | float) -> jax.Array:
    """(A + shift)^-1, of a positive semidefinite matrix and a shift above 0; by way of float32 for 16-bit types."""
    eye = jnp.eye(len(A), dtype=A.dtype if A.dtype.itemsize > 2 else np.float32)
    lower = cast(jax.Array, jnp.linalg.cholesky(A.astype(eye.dtype) + eye * jnp.asarray(shift, eye.dtype)))
    half = lax.linalg.triangular_solve(lower, eye, left_side=True, lower=True)
    return times(half.T, half).astype(A.dtype)


def _regularization(dtype: np.dtype) -> float:
    """The shift of the proximal iterations, see `_ITERATIONS`."""
    return floats.eps(dtype) ** 0.5


# -- configurations ---------------------------------------------------------------------------------------------------


class _Iterate(NamedTuple):
    """Where the steps are, the squared error from which the last began, whether it got no smaller, and how many."""

    q: jax.Array
    squared: jax.Array
    is_at_end: jax.Array
    steps: jax.Array


class _Converged(NamedTuple):
    """Where the iterations end, (nq,); one undamped step further, which is the result; its residual, (1,)."""

    end: jax.Array
    q: jax.Array
    residual: jax.Array


@composite
def _close_loops(
    precision: Precision,
    scene: Scene,
    q: jax.Array,
    distances: Sequence[Array | None],
    *,
    iterations: int,
) -> _Converged:
    """A closed configuration near by, as one program: in a batch each state ends by itself."""
    mechanism, closures = scene
    loops = LoopsOfState(mechanism, closures, distances, precision.value)

    def nearer(last: _Iterate) -> _Iterate:
        q, placed = last.q, loops.placed(last.q)
        rows = loops.jacobian(q, placed)
        scale, A = _equilibrated(times(rows.J, rows.J.T), rows)
        error = scale * errors_of(placed, q.dtype)
        squared, least = jnp.sum(error * error), _regularization(A.dtype)
        step = times(scale * times(_inverse(A, least + _DAMPING * squared), error), rows.J)
        # Near a closed configuration a step leaves the square of the error, or what rounding leaves.
        is_at_end = (_DAMPING * squared <= least) & (squared >= 0.25 * last.squared)
        q = integrate(mechanism, q, -step, precision=loops.precision)
        return _Iterate(q, squared, is_at_end, last.steps + 1)

    def goes_on(last: _Iterate) -> jax.Array:
        return ~last.is_at_end & (last.steps < iterations)

    # A step of length 0 normalises quaternions.
    q = integrate(mechanism, q, np.zeros(mechanism.nv, q.dtype), precision=loops.precision)
    start = _Iterate(q, jnp.full((), np.inf, q.dtype), jnp.zeros((), bool), jnp.zeros((), np.int32))
    end = lax.while_loop(goes_on, nearer, start).q
    closed = _stepped(loops, end)[0]
    return _Converged(end, closed, jnp.max(jnp.abs(errors_of(loops.placed(closed), q.dtype)))[None])


def _stepped(loops: LoopsOfState, q: jax.Array) -> tuple[jax.Array, LoopJacobian]:
    """An undamped step, and the rows that it is taken along."""
    placed = loops.placed(q)
    rows = loops.jacobian(q, placed)
    multipliers = _multipliers(times(rows.J, rows.J.T), errors_of(placed, q.dtype), rows)
    return integrate(loops.mechanism, q, -times(multipliers, rows.J), precision=loops.precision), rows


def _closed_configuration(loops: LoopsOfState, q: jax.Array, iterations: int) -> ClosedConfiguration:
    """`close_loops` of one state."""
    mechanism, precision = loops.mechanism, loops.precision
    if not mechanism.nv or all(are_of_one_body(mechanism, x) for x in loops.closures):
        # A step of length 0 normalises quaternions.
        q = integrate(mechanism, q, np.zeros(mechanism.nv, q.dtype), precision=precision)
        left = jnp.abs(errors_of(loops.placed(q), q.dtype))
        return ClosedConfiguration(q, jnp.max(left) if loops.closures else jnp.zeros((), q.dtype))
    mechanism, start, distances = fixed((mechanism, q, loops.distances))
    found = _close_loops(resolve(precision), (mechanism, loops.closures), start, distances, iterations=iterations)
    # For derivatives the last step is taken again, and here the start and all numbers vary. What it leaves is of second
    # order in their changes, and of the step after it the second order is that of a step along constant rows.
    moved = integrate(mechanism, q, difference(mechanism, start, found.end, precision=precision), precision=precision)
    closed, rows = _stepped(loops, moved)
    J, squares = fixed(rows)
    solve = _proximal(times(J, J.T), LoopJacobian(J, squares))
    left = times(solve(errors_of(loops.placed(closed), closed.dtype)), J)
    closed = integrate(loops.mechanism, closed, -left, precision=precision)
    return ClosedConfiguration(valued(closed, found.q), found.residual[0])
