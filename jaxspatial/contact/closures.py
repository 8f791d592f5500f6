"""Loop closures: what they hold at zero at a configuration, and how they act as a term of the convex step.

A closure sees the motion of its frame B for an observer on its frame A: the pose X_AB = (R, p), and the twist
V = (w, v) along the axes of A, with dR/dt = [w]x R and dp/dt = v. It holds rows N(R, p) of the twist at zero: N V = 0.
"""

import functools
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.contact.term import NEAR_RIGID_LIMIT, Columns, OnBodies, Rows, StepData, TermData
from jaxspatial.contact.world import Ends, World, is_nan, mean_size, scalars
from jaxspatial.dynamics.jacobians import jacobian
from jaxspatial.dynamics.kinematics import body_accelerations, body_velocities, forward_kinematics
from jaxspatial.engine import stacking
from jaxspatial.engine.algorithm import over_batch
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import LoopClosure, Mechanism
from jaxspatial.mechanism.loops import ROWS, checked_loops
from jaxspatial.mechanism.shapes import directions
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.errorfree.primitives import computed_at_once
from jaxspatial.numerics.linear import Motion, Wrench
from jaxspatial.numerics.numbers import Mask, Number, high, where
from jaxspatial.numerics.quantity import tree_of
from jaxspatial.numerics.types import PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import SpatialForce, algebra

# Two bodies with less mobility against each other than this, in eps of that of each, do not move.
MOBILE = 1e3


# -- arguments --------------------------------------------------------------------------------------------------------


def checked_closures(
    operation: str, mechanism: Mechanism, loops: Iterable[LoopClosure], dtype: np.dtype
) -> tuple[tuple[LoopClosure, ...], list[Array | None]]:
    """The closures, and their distances (*batch, 1) or None."""
    closures, distances = checked_loops(loops, mechanism.topology, f"{operation}: loops"), list[Array | None]()
    for distance in (x.distance for x in closures):
        if isinstance(distance, np.ndarray):
            distance = distance.astype(dtype)
        elif distance is not None:
            distance = floats.as_float_array(distance, f"{operation}: loops: distance", dtype)
            check.require_same_dtype(q=np.zeros(0, dtype), distance=distance)
        distances.append(None if distance is None else distance[..., None])
    return closures, distances


def are_of_one_body(mechanism: Mechanism, loop: LoopClosure) -> bool:
    """Whether nothing moves the frames of a closure against each other: both are of one body, or of the world."""
    return mechanism.frame_body(loop.frame_a) == mechanism.frame_body(loop.frame_b)


def require_closable(
    operation: str,
    mechanism: Mechanism,
    closures: Sequence[LoopClosure],
    distances: Sequence[Array | None],
    dtype: np.dtype,
) -> None:
    """Refuses closures of frames of one body that are open, where these numbers are known."""
    for loop, distance in zip(closures, distances, strict=True):
        known = mechanism.frame_placements, distance
        if not are_of_one_body(mechanism, loop) or not all(isinstance(x, np.ndarray) for x in jax.tree.leaves(known)):
            continue
        with computed_at_once():
            places = [mechanism.frame_names.index(name) for name in (loop.frame_a, loop.frame_b)]
            X_A, X_B = (jax.tree.map(lambda x, i=i: x[i].astype(dtype), known[0]) for i in places)
            R_A, R_B = X_A.rotation.to_matrix(), X_B.rotation.to_matrix()
            p = X_B.translation - X_A.translation
            X_AB = PoseOfB(times(R_A.T, R_B), times(p, R_A))
            placed = Placed(loop.kind, None, True, R_A, X_A.translation, p, X_AB)
            error = placed.error if distance is None else _direction(p)[1] - distance
            gap = float(jnp.max(jnp.abs(error)))
        if gap > floats.eps(dtype) ** 0.5:
            raise ValueError(
                f"{operation}: loops: expected closures that can close, got {loop!r} between frames of one body, "
                f"{mechanism.frame_body(loop.frame_a)!r}, which stays open by {gap:.3g} (rad, m)"
            )


# -- one closure ------------------------------------------------------------------------------------------------------


class PoseOfB(NamedTuple):
    """X_AB by its matrix R (3, 3) and position p (3,), or a derivative of it."""

    R: jax.Array
    p: jax.Array


class Placed(NamedTuple):
    """A closure at one configuration: where its frames are. is_of_one_body: nothing moves them against each other."""

    kind: str
    distance: jax.Array | None
    is_of_one_body: bool
    R_WA: jax.Array
    p_WA: jax.Array
    p_AB_W: jax.Array
    X_AB: PoseOfB

    @property
    def error(self) -> jax.Array:
        """(rows,), see `constraint_error`."""
        R, p = self.X_AB
        if self.distance is not None:
            return _direction(p)[1][None] - self.distance
        if self.kind == "weld":
            return jnp.concatenate([Rotation(R.reshape(9)).log(), p])
        if self.kind == "hinge":
            z = np.array([0, 0, 1], R.dtype)
            return jnp.concatenate([Rotation.between(z, R[:, 2]).log()[:2], p])
        return jnp.concatenate([-R[2:, 0], p]) if self.kind == "universal" else p

    def N(self, X_AB: PoseOfB) -> jax.Array:
        """N (rows, 6), for a twist in the axes of A: at closed configurations the derivative of the error."""
        R, p = X_AB
        twist = jnp.eye(6, dtype=R.dtype)
        if self.kind == "universal":
            across = jnp.stack([-R[1, 0], R[0, 0], *jnp.zeros(4, R.dtype)])  # z of A x x of B
            return jnp.concatenate([across[None], twist[3:]])
        if self.kind == "distance":
            return jnp.concatenate([jnp.zeros(3, R.dtype), _direction(p)[0]])[None]
        return {"weld": twist, "hinge": twist[np.array([0, 1, 3, 4, 5])], "ball": twist[3:]}[self.kind]

    @property
    def N_W(self) -> jax.Array:
        """N for a twist in world axes."""
        N = self.N(self.X_AB)
        return jnp.concatenate([times(N[:, :3], self.R_WA.T), times(N[:, 3:], self.R_WA.T)], -1)

    def bias(self, V_A: jax.Array, V_B: jax.Array, A_A: jax.Array, A_B: jax.Array) -> jax.Array:
        """d/dt (N V), from velocities and accelerations (6,) of the two origins in world axes."""
        (w_A, v_A), (w_B, v_B), (alpha_A, a_A), (alpha_B, a_B) = (jnp.split(x, 2) for x in (V_A, V_B, A_A, A_B))
        p, cross = self.p_AB_W, jnp.cross
        w, v = w_B - w_A, v_B - v_A - cross(w_A, p)
        alpha = alpha_B - alpha_A - cross(w_A, w_B)
        a = a_B - a_A - cross(alpha_A, p) - cross(w_A, cross(w_A, p) + 2 * v)
        w, v, alpha, a = (times(x, self.R_WA) for x in (w, v, alpha, a))
        rates = PoseOfB(jnp.cross(w[:, None], self.X_AB.R, axis=0), v)
        N, of_N = jax.jvp(self.N, (self.X_AB,), (rates,))
        return times(N, jnp.concatenate([alpha, a])) + times(of_N, jnp.concatenate([w, v]))


# As all numbers of closures, in every precision.
_direction = functools.partial(directions, "reproducible")
times = functools.partial(jnp.matmul, precision=lax.Precision.HIGHEST)


# -- all of them ------------------------------------------------------------------------------------------------------


class LoopJacobian(NamedTuple):
    """J (rows, nv), and the squares of the norms of rows (rows,) that it would have if nothing cancelled."""

    J: jax.Array
    squares: jax.Array


class LoopsOfState(NamedTuple):
    """The closures of a mechanism, for one state."""

    mechanism: Mechanism
    closures: tuple[LoopClosure, ...]
    distances: Sequence[Array | None]
    precision: PrecisionName

    @property
    def frames(self) -> list[str]:
        """Frames A of all closures, then frames B."""
        return [x.frame_a for x in self.closures] + [x.frame_b for x in self.closures]

    def placed(self, q: jax.Array) -> list[Placed]:
        """All closures at q."""
        if not self.closures:
            return []
        X_WF = forward_kinematics(self.mechanism, q, self.frames, precision=self.precision)
        of_A, of_B = jnp.split(X_WF.rotation.to_matrix(), 2), jnp.split(X_WF.translation, 2)
        placed: list[Placed] = []
        for x, distance, R_WA, R_WB, p_WA, p_WB in zip(self.closures, self.distances, *of_A, *of_B, strict=True):
            p_AB_W = p_WB - p_WA
            X_AB = PoseOfB(times(R_WA.T, R_WB), times(p_AB_W, R_WA))
            is_of_one_body = are_of_one_body(self.mechanism, x)
            placed.append(Placed(x.kind, distance, is_of_one_body, R_WA, p_WA, p_AB_W, X_AB))
        return placed

    def jacobian(self, q: jax.Array, placed: Sequence[Placed]) -> LoopJacobian:
        """The rows of all closures; zero where nothing moves their frames against each other."""
        rows = [LoopJacobian(jnp.zeros((0, self.mechanism.nv), q.dtype), jnp.zeros(0, q.dtype))]
        if placed:
            J_WF = jacobian(self.mechanism, q, self.frames, precision=self.precision)
            for x, J_A, J_B in zip(placed, *jnp.split(J_WF, 2), strict=True):
                if x.is_of_one_body:
                    zeros = jnp.zeros((ROWS[x.kind], self.mechanism.nv), q.dtype)
                    rows.append(LoopJacobian(zeros, jnp.zeros(zeros.shape[:1], zeros.dtype)))
                    continue
                # The twists of B for an observer on A are J_B - J_A + turned.
                turned = jnp.cross(x.p_AB_W[:, None], J_A[:3], axis=0)
                turned = jnp.concatenate([jnp.zeros_like(turned), turned])
                sizes = times(jnp.abs(x.N_W), jnp.abs(J_A) + jnp.abs(J_B) + jnp.abs(turned))
                rows.append(LoopJacobian(times(x.N_W, J_B - J_A + turned), jnp.sum(sizes * sizes, -1)))
        return LoopJacobian(*(jnp.concatenate(parts) for parts in zip(*rows, strict=True)))

    def biases(self, q: jax.Array, v: jax.Array, placed: Sequence[Placed]) -> jax.Array:
        """dJ/dt v (rows,)."""
        V = body_velocities(self.mechanism, q, v, self.frames, precision=self.precision)
        A = body_accelerations(self.mechanism, q, v, jnp.zeros_like(v), self.frames, precision=self.precision)
        each = zip(placed, *jnp.split(V.to_array(), 2), *jnp.split(A.to_array(), 2), strict=True)
        return jnp.concatenate(
            [jnp.zeros(ROWS[x.kind], q.dtype) if x.is_of_one_body else x.bias(*motions) for x, *motions in each]
        )


def errors_of(placed: Sequence[Placed], dtype: np.dtype) -> jax.Array:
    """The errors of all closures, (rows,)."""
    return jnp.concatenate([jnp.zeros(0, dtype), *(x.error for x in placed)])


# -- arrays -----------------------------------------------------------------------------------------------------------


class ClosureStructure(NamedTuple):
    """What is static of a closure: the numbers of its frames, and how many of its rows hold orientations and
    positions."""

    frame_a: int
    frame_b: int
    n_turning: int
    n_moving: int


@tree_of("closures")
class ClosureData(TermData):
    """The k rows of n loop closures in a step, as arrays.

    turning, moving (*batch, 3 k): N of the twist of frame B for an observer on A, about the origin of B in world axes.
    errors (*batch, k): rad, m. p_AB_W (*batch, 3 n).
    """

    closures: tuple[ClosureStructure, ...]
    turning: Array
    moving: Array
    errors: Array
    p_AB_W: Array

    def to_term(self, world: World, step: StepData) -> "Closures":
        state, dt, n = world.state, world.dt, len(self.closures)
        frames_a, frames_b = (tuple(x) for x in list(zip(*self.closures, strict=True))[:2])
        arm_b = world.arms(frames_b, None, np.zeros(3 * n, state.dtype))
        arm_a = world.arms(frames_a, None, self.p_AB_W)
        ends = Ends(*(tuple(state.topology.bodies_of(x)) for x in (frames_b, frames_a)))
        both = world.relative_mobility(ends, arm_b, arm_a)
        sizes = [stacking.concatenated_trees([mean_size(P.M), mean_size(P.J)], state.n, [n] * 2) for P in both]
        # Of each row the closure, and whether it holds a position.
        of_row = np.repeat(np.arange(n), [c.n_turning + c.n_moving for c in self.closures])
        moves = np.array([i >= c.n_turning for c in self.closures for i in range(c.n_turning + c.n_moving)])
        w, alone = stacking.mapped(lambda x: stacking.rows(x, of_row + n * moves), sizes)
        arm_b, arm_a = stacking.mapped(
            lambda x: stacking.rows(jnp.broadcast_to(x, (n, state.n)), of_row), (arm_b, arm_a)
        )
        N = Wrench(state.vectors(self.turning), state.vectors(self.moving))
        ends = Ends(*(tuple(bodies[k] for k in of_row) for bodies in ends))
        # An angle is of 1 rad.
        size = where(jnp.asarray(moves[:, None]), world.reach(ends, arm_b, arm_a, N.f), 1.0)
        on_b, on_a = (algebra.shifted_wrench(N, -arm) for arm in (arm_b, arm_a))
        error = scalars(state, self.errors)
        # Where the two cannot move against each other, w is made of rounding errors, and nothing closes an error.
        least = MOBILE * floats.eps(high(w).dtype) * alone
        can_move = ~(high(w) <= high(least)) | is_nan(error)
        whole = where(can_move, w, where(high(alone) > 0, least, 1.0))
        # A momentum is as large as the impulse, and changes velocities by w of it.
        noise, loss = where(can_move, size, 0.0) / dt, where(can_move, alone / whole + NEAR_RIGID_LIMIT**-0.5, 0.0)
        target = where(can_move, -error, 0.0) / dt
        return Closures(ends, on_b, -on_a, target, NEAR_RIGID_LIMIT * whole, noise, loss)

    @property
    def result_size(self) -> int:
        return sum(x.n_turning + x.n_moving for x in self.closures)

    def wrenches(self, forces: jax.Array) -> SpatialForce:
        """(*batch, n) of each closure on the body of its frame B, about the origin of B."""
        rows = (x.reshape((*x.shape[:-1], -1, 3)) for x in (self.turning, self.moving))
        counts = np.cumsum([x.n_turning + x.n_moving for x in self.closures])[:-1].tolist()
        tau, f = (jnp.stack([x.sum(-2) for x in jnp.split(forces[..., None] * N, counts, -2)], -2) for N in rows)
        return SpatialForce(tau, f)


def closure_data(
    mechanism: Mechanism,
    q: jax.Array,
    closures: tuple[LoopClosure, ...],
    distances: Sequence[Array | None],
    precision: PrecisionName,
) -> ClosureData:
    """The rows of all closures as the convex step takes them."""
    number = mechanism.frame_names.index
    structures = tuple(
        ClosureStructure(number(x.frame_a), number(x.frame_b), x.rows - min(x.rows, 3), min(x.rows, 3))
        for x in closures
    )

    def of_state(q: jax.Array, distances: Sequence[Array | None]) -> ClosureData:
        placed = LoopsOfState(mechanism, closures, distances, precision).placed(q)
        N = jnp.concatenate([x.N_W for x in placed])
        p_AB_W = jnp.concatenate([x.p_AB_W for x in placed])
        return ClosureData(structures, N[:, :3].reshape(-1), N[:, 3:].reshape(-1), errors_of(placed, q.dtype), p_AB_W)

    return over_batch(of_state, q, distances)


# -- the term ---------------------------------------------------------------------------------------------------------


@tree_of("ends")
class Closures(Rows):
    """k rows of loop closures, as numbers (k, B). on_b, on_a: the wrenches on bodies b and a of a unit impulse, about
    their origins. target: the velocity to which impulses push, and at which there are none. R: how much an impulse
    changes the velocity.

    noise, loss: rounding errors of `target` in eps, and those of its difference from a velocity, in eps of that: these
    come from R and from momenta."""

    ends: Ends
    on_b: Wrench
    on_a: Wrench
    target: Number
    R: Number
    noise: Number
    loss: Number

    throws, rounding_share = True, 1.0

    @property
    def count(self) -> int:
        return len(self.ends.b)

    def law(self, u: Number, held: Mask | None = None) -> tuple[Number, Number]:
        return (self.target - u) / self.R, 1 / self.R

    def magnitude(self, u: Number) -> Number:
        return abs(u) + abs(self.target)

    def acts(self) -> jax.Array:
        return jnp.ones((1, 1), bool)

    def rounding(self, G: Number, u: Number) -> Number:
        """Errors of `target`, and of its difference from u: H is at least J^T R^-1 J."""
        x = self.noise + self.loss * abs(self.target - u)
        return x * x / self.R

    def velocities(self, world: World, motions: list[Motion], v: Number) -> Number:
        V_b, V_a = (world.of_bodies(bodies, motions) for bodies in self.ends)
        return algebra.power(self.on_b, V_b) + algebra.power(self.on_a, V_a)

    def on_bodies(self, impulse: Number) -> list[OnBodies]:
        return [OnBodies(self.ends.b, impulse * self.on_b), OnBodies(self.ends.a, impulse * self.on_a)]

    def columns(self, world: World, G: Number) -> list[Columns]:
        scale = (1 / self.R).sqrt()
        return [Columns(*self.ends, scale * self.on_b, scale * self.on_a)]

    def results(self, state: MechanismState, impulse: Number) -> list[jax.Array]:
        """(k, B)."""
        return [state.rounded(impulse)]
