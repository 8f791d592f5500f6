"""Forward dynamics: the accelerations of a mechanism under forces at its joints, by articulated bodies."""

import functools
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax

from jaxspatial.dynamics.articulated_bodies import accelerations, has_floating_roots, solution
from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.external_forces import loads
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics_of
from jaxspatial.dynamics.newton_euler import forces_of
from jaxspatial.engine import program
from jaxspatial.engine.algorithm import DYNAMICS, FRAMES, Algorithm, ExternalForces, Wrenches, algorithm, velocity_shape
from jaxspatial.engine.derivatives import times_columns
from jaxspatial.engine.program import bind
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.errorfree.primitives import is_zero, no_tangent
from jaxspatial.numerics.linear import Wrench
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName

# c is the condition number of the mass matrix.
FORWARD_DYNAMICS = ALGORITHM._replace(of="c mag")


@promises(bound=FORWARD_DYNAMICS)
def forward_dynamics(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The generalized accelerations under given forces: the inverse of `inverse_dynamics`.

        vdot = M(q)^-1 (tau - C(q, v) v - g(q) + J^T F)

    With mimics the system is solved with the mass matrix, in the same precision. Derivatives, of any order and with
    respect to all numbers of the mechanism, are those of inverse dynamics times M^-1.

    A velocity without inertia moves neither mass nor armature: its acceleration is 0, whatever the forces, and all
    others are those of a mechanism whose joint is locked there. Of a file without inertias all accelerations are 0, and
    nothing says so: `mass_matrix_factor` is NaN then.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        external_forces: AppliedForces; a dict from frames to SpatialForces (*batch,) about their origins, in world
            axes; or a list of several of these, which add up. See `AppliedForces`.
        precision: name of a precision; None takes the default.

    Returns:
        vdot (*batch, nv), over the common batch: rad/s^2, m/s^2; 0 along velocities without inertia.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are neither a
            dict of SpatialForces nor AppliedForces, nor a list of these.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: of every number at most 4 n u c mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 c mag in the other
        two; c is the condition number of the mass matrix, n, r and mag are as in `jaxspatial.dynamics.bounds`.
        Derivatives are rounded to the dtype of q on the way: n u c in every precision.
    Source: Featherstone 2008, table 7.1.

    Example:
        >>> vdot = js.forward_dynamics(arm, q, v, tau)
        >>> print(vdot, js.inverse_dynamics(arm, q, v, vdot))
        [-4.5085 10.0859] [10.  2.]
    """
    return _forward_dynamics(precision, mechanism, q, v, tau, external_forces)


# States of which a factorisation is shared by several columns.
MANY = 64

# -- programs ---------------------------------------------------------------------------------------------------------
#
# vdot = FD(q, v, tau) means ID(q, v, vdot) = tau: the derivatives of FD are those of ID at vdot, times M^-1.


class ForwardDynamics(Algorithm):
    """The program of `_forward_dynamics`, differentiated through inverse dynamics.

    The derivative uses the factors of the mass matrix that vdot was computed with.
    """

    has_rule = True

    def rule(self, primals: list, tangents: list, n_batch: int) -> list:
        tau = self.n_fields + 2
        vdot, *factors = bind(self.program_of(_with_factors), primals, n_batch)
        at, moving = self.with_leaf(primals, tau, vdot), self.with_leaf(tangents, tau, None)
        (tau_dot,) = self.program_of(inverse_dynamics_of, at=tau).tangents(at, moving, n_batch)
        of_tau = None if self.known[tau] is not None else tangents[self.place(tau)]
        force = difference_of(None if of_tau is None or is_zero(of_tau) else of_tau, tau_dot)
        if force is None:
            return [no_tangent(primals[-1])]
        solve = self.program_of(_solve, arrays=2 + len(factors))
        return bind(solve, [*primals[: self.place(self.n_fields + 1)], *factors, force], n_batch)


class WithFactors(Algorithm):
    """The program of `_with_factors`, for derivatives of derivatives. Its factors are constants of these."""

    def jvp(self, primals: list, tangents: list, n_batch: int) -> tuple[list, list]:
        _, *factors = bind(self, primals, n_batch)
        (vdot,), (rate,) = self.program_of(_forward_dynamics).jvp(primals, tangents, n_batch)
        return [vdot, *factors], [rate, *map(no_tangent, factors)]


class Solve(Algorithm):
    """The program of a = M^-1 f, which is its own transpose. Its derivative is a' = M^-1 (f' - M' a)."""

    def jvp(self, primals: list, tangents: list, n_batch: int) -> tuple[list, list]:
        (a,) = bind(self, primals, n_batch)
        *at, force = primals
        n = self.place(self.n_fields + 1)
        (tau_dot,) = self.program_of(_mass_times, arrays=2).tangents([*at[:n], a], [*tangents[:n], None], n_batch)
        force = difference_of(None if is_zero(tangents[-1]) else tangents[-1], tau_dot)
        return [a], [no_tangent(a) if force is None else bind(self, [*at, force], n_batch)[0]]

    def batched(
        self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int
    ) -> list[jax.Array] | None:
        """Forces mapped at one state, if there are more of them than velocities: M^-1 once, times all."""
        *at, force = arrays
        if any(axis is not None for axis in axes[:-1]) or size <= self.topology.nv:
            return None
        units = jnp.eye(self.topology.nv, dtype=force.dtype).reshape((-1, *[1] * n_batch, self.topology.nv))
        (inverse,) = bind(self, [*(x[None] for x in at), units], n_batch + 1)
        return [times_columns(jnp.moveaxis(inverse, 0, -1), jnp.moveaxis(force, axes[-1] or 0, 0))]

    def columns(self, arrays: Sequence[jax.Array], n_batch: int) -> list[int]:
        """Axes of forces that share many states, whose factors a batch would repeat for every column."""
        *at, force = arrays
        n_states = max(math.prod(x.shape[:n_batch]) for x in at)
        shared = (k for k in range(n_batch) if all(x.shape[k] == 1 for x in at) and force.shape[k] > 1)
        return list(shared) if n_states >= MANY else []

    def over_columns(self):
        return self.cached("over columns", lambda: OverColumns(self))

    def transposed(self, cotangents: list, arguments: list, n_batch: int) -> list:
        (a,) = bind(self, [*arguments[:-1], *cotangents], n_batch)
        return [*[None] * (len(arguments) - 1), program.summed_like(a, arguments[-1].aval)]


class OverColumns(program.Program):
    """A program whose last argument, and result, has an axis of columns behind the states."""

    def __init__(self, program: Algorithm):
        self.program, self.is_wide = program, program.is_wide

    def evaluate(self, *arrays: jax.Array):
        *at, columns = arrays
        (x,) = lax.map(functools.partial(self.program.evaluate, *at), jnp.moveaxis(columns, 1, 0))
        return [jnp.moveaxis(x, 0, 1)]


def difference_of(a: jax.Array | None, b: jax.Array | None):
    """a - b, of tangents of which None stands for zero."""
    return a if b is None else -b if a is None else a + -b


@algorithm(*DYNAMICS, *FRAMES, program_class=ForwardDynamics, result_shape=velocity_shape)
def _forward_dynamics(state: MechanismState, v: Array, tau: Array, external_forces: Wrenches):
    return accelerations(state, v, tau, external_forces)[0]


@algorithm(*DYNAMICS, *FRAMES, program_class=WithFactors)
def _with_factors(state: MechanismState, v: Array, tau: Array, external_forces: Wrenches) -> tuple[jax.Array, ...]:
    """vdot, and the unrounded limbs of the factors of the mass matrix."""
    vdot, factors = accelerations(state, v, tau, external_forces)
    return vdot, *state.words(factors)


@algorithm(*DYNAMICS, *FRAMES, program_class=Solve, result_shape=velocity_shape)
def _solve(state: MechanismState, *factors_and_force: Array):
    *factors, force = factors_and_force
    # In the structure of the factors that `accelerations` returns.
    zero, U = state.known(0.0), Wrench(state.zero_vector, state.zero_vector)
    form: list = [zero if has_floating_roots(b) else [(U, zero)] * b.kind.nv for b in state.bundles]
    if state.topology.has_mimics:
        form = [zero, *[[]] * (len(state.bundles) - 1)]
    return solution(state, state.of_words(factors, form), force)


@algorithm(*DYNAMICS, *FRAMES, result_shape=velocity_shape)
def _mass_times(state: MechanismState, a: Array):
    """M a, by inverse dynamics at rest and without gravity."""
    return state.by_velocity(forces_of(state, None, a, loads(state, ()), state.zero_vector))
