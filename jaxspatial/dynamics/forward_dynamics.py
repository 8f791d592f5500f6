"""Forward dynamics: how a mechanism moves under forces at its joints, by articulated bodies."""

import functools
import math
from collections.abc import Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
from jax import lax

from jaxspatial.arithmetic.types import Coordinates, Forces, PrecisionName, Rates
from jaxspatial.dynamics import primitive, program
from jaxspatial.dynamics.algorithm import DYNAMICS, FRAMES, Algorithm, algorithm, of_rates
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.arguments import ExternalForces, Wrenches
from jaxspatial.dynamics.articulated_bodies import accelerations, floats, solution
from jaxspatial.dynamics.inverse_dynamics import _inverse_dynamics  # pyright: ignore[reportPrivateUsage] - unchecked
from jaxspatial.dynamics.loads import loads
from jaxspatial.dynamics.recursive_newton_euler import forces_of
from jaxspatial.dynamics.state import MechanismState
from jaxspatial.dynamics.tangents import times_columns
from jaxspatial.mechanism import Mechanism


def forward_dynamics(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    tau: Forces,
    external_forces: ExternalForces = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The accelerations under generalized forces: the inverse of `inverse_dynamics`.

    With mimics the mass matrix is solved, in the same precision. Derivatives, of any order and by all numbers of the
    mechanism, are those of inverse dynamics times M^-1.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        tau: (*batch, nv) generalized forces of the joints: N m, N.
        external_forces: by name of a frame (bodies are frames, welded links too) a SpatialForce (*batch,) about the
            origin of the frame, in world axes. It acts on the body that carries the frame, see `Mechanism.frame_body`.
        precision: name of a precision; None takes the default.

    Returns:
        vdot (*batch, nv), over the common batch: rad/s^2, m/s^2. A rate without inertia, of bodies without mass and
        armature, keeps vdot = 0.

    Raises:
        TypeError: the first argument is no Mechanism, dtypes differ or are not floating point, or forces are no dict of
            SpatialForces.
        ValueError: shapes do not fit.
        KeyError: there is no such frame.

    Error: for n links one behind the other, c the condition of the mass matrix, r the largest number and mag what it
        would be if no terms cancelled, at most 4 n u c mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 c mag in
        the other two. Derivatives are rounded to the dtype of q on the way: n u c in every precision.
    Source: Featherstone 2008, table 7.1.
    """
    return _forward_dynamics(precision, mechanism, q, v, tau, external_forces)


# -- programs ---------------------------------------------------------------------------------------------------------
#
# vdot = FD(q, v, tau) means ID(q, v, vdot) = tau: the derivatives of FD are those of ID at vdot, times M^-1.


class ForwardDynamics(Algorithm):
    """The program of `_forward_dynamics`, differentiated through inverse dynamics. What has found vdot, the factors of
    the mass matrix, is kept for the derivative."""

    def jvp(self, primals: list[Any], tangents: list[Any], n_batch: int) -> tuple[list[Any], list[Any]]:
        # Its result is one array, whether or not it is ever run on its own.
        self.out_tree = jax.tree.structure(0)
        tau = self.n_fields + 2
        vdot, *factors = primitive.bind(self.sibling(_with_factors), primals, n_batch)
        at, moving = self.with_leaf(primals, tau, vdot), self.with_leaf(tangents, tau, None)
        (tau_dot,) = self.sibling(_inverse_dynamics, at=tau).tangents(at, moving, n_batch)
        force = plus(self.leaf(tangents, tau), minus(tau_dot))
        return [vdot], [_solved(self, primals, factors, force, n_batch)]


class WithFactors(ForwardDynamics):
    """The same of `_with_factors`, for derivatives of derivatives."""

    def jvp(self, primals: list[Any], tangents: list[Any], n_batch: int) -> tuple[list[Any], list[Any]]:
        found = primitive.bind(self, primals, n_batch)
        (vdot,), (rate,) = self.sibling(_forward_dynamics).jvp(primals, tangents, n_batch)
        return [vdot, *found[1:]], [rate, *map(primitive.no_tangent, found[1:])]


class Solve(Algorithm):
    """The program of M^-1 times forces, its own transpose. With M a = f, the derivative of a is M^-1 (f' - M' a)."""

    def jvp(self, primals: list[Any], tangents: list[Any], n_batch: int) -> tuple[list[Any], list[Any]]:
        (a,) = primitive.bind(self, primals, n_batch)
        *own, force = primals
        n = self.place(self.n_fields + 1)
        (tau_dot,) = self.sibling(_mass_times, arrays=2).tangents([*own[:n], a], [*tangents[:n], None], n_batch)
        force = plus(None if primitive.is_zero(tangents[-1]) else tangents[-1], minus(tau_dot))
        found = primitive.no_tangent(a) if force is None else primitive.bind(self, [*own, force], n_batch)[0]
        return [a], [found]

    def batched(
        self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int
    ) -> list[jax.Array] | None:
        """More forces at one state than there are rates: M^-1 once, times all."""
        *own, force = arrays
        if any(axis is not None for axis in axes[:-1]) or size <= self.topology.nv:
            return None
        units = jnp.eye(self.topology.nv, dtype=force.dtype).reshape((-1, *[1] * n_batch, self.topology.nv))
        (inverse,) = primitive.bind(self, [*(x[None] for x in own), units], n_batch + 1)
        return [times_columns(jnp.moveaxis(inverse, 0, -1), jnp.moveaxis(force, axes[-1] or 0, 0))]

    def columns(self, arrays: Sequence[jax.Array], n_batch: int) -> list[int]:
        """Of many states: their factors would have to be repeated for every column."""
        *own, force = arrays
        n_states = max(math.prod(x.shape[:n_batch]) for x in own)
        shared = (k for k in range(n_batch) if all(x.shape[k] == 1 for x in own) and force.shape[k] > 1)
        return list(shared) if n_states >= program.SMALLEST_BLOCK else []

    def over_columns(self):
        return self.made("over columns", lambda: OverColumns(self))

    def transposed(self, cotangents: list[Any], arguments: list[Any], n_batch: int) -> list[Any]:
        (a,) = primitive.bind(self, [*arguments[:-1], *cotangents], n_batch)
        return [*[None] * (len(arguments) - 1), primitive.over_own(a, arguments[-1].aval)]


class OverColumns(program.Program):
    """A program whose last argument, and result, has an axis of columns behind the states."""

    def __init__(self, of: Algorithm):
        self.of, self.block, self.is_wide = of, of.block, of.is_wide

    def evaluate(self, *arrays: jax.Array):
        *own, columns = arrays
        (found,) = cast(Any, lax.map(functools.partial(self.of.evaluate, *own), jnp.moveaxis(columns, 1, 0)))
        return [jnp.moveaxis(found, 0, 1)]


def _solved(own: Algorithm, primals: list[Any], factors: list[jax.Array], force: jax.Array | None, n_batch: int) -> Any:
    """M^-1 of a tangent, None for zero, with the fields, q and factors of a program."""
    if force is None:
        return primitive.no_tangent(primals[-1])
    solve = own.sibling(_solve, arrays=2 + len(factors))
    return primitive.bind(solve, [*primals[: own.place(own.n_fields + 1)], *factors, force], n_batch)[0]


def plus(a: jax.Array | None, b: jax.Array | None):
    """The sum of tangents, of which None is zero."""
    return a if b is None else b if a is None else a + b


def minus(a: jax.Array | None):
    return None if a is None else -a


@algorithm(*DYNAMICS, *FRAMES, kind=ForwardDynamics, result=of_rates)
def _forward_dynamics(state: MechanismState, v: Array, tau: Array, external_forces: Wrenches):
    return accelerations(state, v, tau, external_forces)[0]


@algorithm(*DYNAMICS, *FRAMES, kind=WithFactors, entries=lambda t: 8 * t.nv)
def _with_factors(state: MechanismState, v: Array, tau: Array, external_forces: Wrenches) -> tuple[jax.Array, ...]:
    """And every word of the factors, as it is."""
    vdot, factors = accelerations(state, v, tau, external_forces)
    return vdot, *state.words(factors)


@algorithm(*DYNAMICS, *FRAMES, kind=Solve, result=of_rates)
def _solve(state: MechanismState, *factors_and_force: Array):
    *factors, force = factors_and_force
    return solution(state, state.of_words(factors, _form(state)), force)


def _form(state: MechanismState) -> list[Any]:
    """What factors look like."""
    zero = state.known(0.0)
    if state.topology.has_mimics:
        return [zero, *[()] * (len(state.bundles) - 1)]
    return [zero if floats(b) else [((zero,) * 6, zero)] * b.kind.nv for b in state.bundles]


@algorithm(*DYNAMICS, *FRAMES, result=of_rates)
def _mass_times(state: MechanismState, a: Array):
    return state.by_rate(forces_of(state, None, a, loads(state, {}), state.no_vector))
