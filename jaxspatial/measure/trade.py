"""The trade of speed for accuracy, measured: operation x dtype x precision x number of wrenches."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.precision import Precision
from jaxspatial.measure import error, exact, timing
from jaxspatial.spatial import SpatialForce, SpatialVelocity, dot, shift

SIZES = (1_000, 100_000, 1_000_000)
DTYPES = ("float32", "float64")
OPERATIONS = ("shift", "dot")
# Numbers read and written per wrench: shift in place (torque, force, offset; torque), dot (four vectors; power).
_WORDS = {"shift": 12, "dot": 13}
_SAMPLE = 1_000
_ROUNDS = 15
# One flushed subnormal for each product and each sum.
_FLUSHED = 11


class Case(NamedTuple):
    """One line of the trade."""

    operation: str
    dtype: str
    precision: str


class Row(NamedTuple):
    """What was measured for a case."""

    case: Case
    seconds: dict  # number of wrenches -> array (rounds,), for the whole batch
    ulps: np.ndarray  # error against the exact rational, componentwise
    condition: np.ndarray  # magnitude of the terms over the exact value
    u_of_magnitude: float  # largest error / (u mag), to be compared with the bound
    bound: float  # the promise, in the same unit

    def nanoseconds(self, n):
        return float(np.median(self.seconds[n])) / n * 1e9

    def gigabytes_per_second(self, n):
        return _WORDS[self.case.operation] * np.dtype(self.case.dtype).itemsize / self.nanoseconds(n)


CASES = tuple(Case(o, d, str(p)) for o in OPERATIONS for d in DTYPES for p in Precision)
_BOUND = {"shift": 3.0, "dot": 4.0}


def steps(sizes):
    """How often `measure` calls `advance`."""
    return len(sizes) * len(DTYPES) * _ROUNDS + len(CASES)


def measure(wrenches, offset, sizes=SIZES, advance=lambda: None):
    """The rows of the trade for these wrenches (float64 arrays), repeated or cut to each size, and this offset."""
    seconds = {case: {} for case in CASES}
    for n in sizes:
        for dtype in DTYPES:
            with jax.enable_x64(dtype == "float64"):
                cases = {case: _call(case, wrenches, offset, n) for case in CASES if case.dtype == dtype}
                for case, times in timing.interleaved(cases, _ROUNDS, advance).items():
                    seconds[case][n] = times
    return [_row(case, seconds[case], wrenches, offset, advance) for case in CASES]


def _vectors(wrenches, offset, n, dtype):
    """The first n wrenches, repeated as often as needed, on the device."""
    index = np.arange(n) % len(wrenches.tau)
    tau, f, w, v = (jnp.asarray(x[index], dtype) for x in wrenches)
    return SpatialForce(tau, f), SpatialVelocity(w, v), jnp.broadcast_to(jnp.asarray(offset, dtype), (n, 3)) + 0


def _call(case, wrenches, offset, n):
    """A function without arguments that runs the case once over n wrenches."""
    F, V, p = _vectors(wrenches, offset, n, case.dtype)
    if case.operation == "dot":
        power = jax.jit(jax.vmap(lambda F, V: dot(F, V, precision=case.precision)))
        return lambda: power(F, V)
    in_place = jax.jit(jax.vmap(lambda F, p: shift(F, p, precision=case.precision)), donate_argnums=0)
    state = [F]

    def call():
        state[0] = in_place(state[0], p)
        return state[0]

    return call


def _row(case, seconds, wrenches, offset, advance):
    with jax.enable_x64(case.dtype == "float64"):
        F, V, p = _vectors(wrenches, offset, _SAMPLE, case.dtype)
        if case.operation == "shift":
            computed = jax.jit(jax.vmap(lambda F, p: shift(F, p, precision=case.precision)))(F, p).tau
            value, magnitude = exact.shift_force(F.tau, F.f, p)
        else:
            computed = jax.jit(jax.vmap(lambda F, V: dot(F, V, precision=case.precision)))(F, V)
            value, magnitude = exact.dot(F.tau, F.f, V.w, V.v)
    advance()
    condition = np.frompyfunc(lambda m, e: float(m / abs(e)) if e else np.inf, 2, 1)(magnitude, value)
    largest = error.in_u_of(computed, value, magnitude, flushed=_FLUSHED).max()
    ulps = error.in_ulps(computed, value).ravel()
    return Row(case, seconds, ulps, condition.astype(np.float64).ravel(), float(largest), _BOUND[case.operation])
