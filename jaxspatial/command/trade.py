"""The trade-off of speed for accuracy, measured: operation x dtype x precision, in cache and streaming through memory;
error against condition number; power before and after a shift."""

import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import DTypeLike
from numpy.typing import ArrayLike

from jaxspatial.measure import error, timing
from jaxspatial.measure.inputs import CONDITIONED
from jaxspatial.measure.operation import OPERATIONS, Operation, Wrenches
from jaxspatial.measure.timing import Advance
from jaxspatial.numerics import floats
from jaxspatial.numerics.precision import DEFAULT, Precision
from jaxspatial.spatial import SpatialForce, SpatialVelocity, dot, shift
from jaxspatial.spatial.operations import DOT, SHIFT

DTYPES = "float16", "bfloat16", "float32", "float64"
# Numbers of wrenches: that stay in the cache, and to stream unless told otherwise.
IN_CACHE, LARGEST = 2_000, 1_000_000
# The other dtypes are there to hold data, not to compute with: one size is enough.
STREAMED = ("float32", "float64")
_STEPS = 100
_SAMPLE = 500
_ROUNDS = 11
# Seconds after which slow cases get fewer rounds.
_LIMIT = 3.0


class Case(NamedTuple):
    """One line of the trade-off."""

    operation: str
    dtype: str
    precision: str


class Row(NamedTuple):
    """What was measured for a case."""

    case: Case
    in_cache: np.ndarray  # seconds per item (rounds,)
    streamed: np.ndarray | None  # the same; None for formats that only hold data
    compile_seconds: float  # tracing and compiling the loop in cache
    ulps: np.ndarray  # error against the exact rational, of every component of a sample
    of_promise: float  # the largest error over the bound promised: it holds up to 1
    worst_in_units: tuple[float, ...]  # the largest error of each part, in its SI unit

    @property
    def operation(self):
        return OPERATIONS[self.case.operation]

    @property
    def promise(self):
        return self.operation.promise(self.case.precision)

    @property
    def holds(self):
        return self.of_promise <= 1

    @property
    def median_ulps(self):
        return float(np.median(self.ulps)) if self.ulps.size else np.nan

    @property
    def worst_ulps(self):
        return float(np.max(self.ulps)) if self.ulps.size else np.nan

    @property
    def errors_in_units(self):
        """(unit, largest error) of each part."""
        return list(zip(self.operation.units, self.worst_in_units, strict=True))

    @property
    def gigabytes_per_second(self):
        """Of numbers read and written while streaming."""
        return self.operation.words * jnp.dtype(self.case.dtype).itemsize / nanoseconds(self.streamed)


def nanoseconds(seconds: np.ndarray | None):
    """Their median; NaN for what was not measured."""
    return np.nan if seconds is None else float(np.median(seconds)) * 1e9


def sizes(largest: int = LARGEST):
    """(items in cache, items streamed)."""
    return min(IN_CACHE, largest), largest


def cases(operations: Iterable[str] = tuple(OPERATIONS), dtypes: Iterable[str] = DTYPES):
    """All lines of the trade-off."""
    return [Case(o, d, str(p)) for o in operations for d in dtypes for p in Precision]


def steps(lines: Sequence[Case]):
    """How often `measure` calls `advance`."""
    streamed = sum(case.dtype in STREAMED for case in lines)
    return len(lines) + streamed + (len(lines) + streamed) // len(Precision) * _ROUNDS


def measure(
    wrenches: Wrenches,
    offset: ArrayLike,
    lines: Sequence[Case],
    largest: int = LARGEST,
    advance: Advance = lambda: None,
):
    """The rows of these lines for these wrenches (float64 arrays), repeated or cut to each size, and this offset."""
    groups = dict.fromkeys((case.operation, case.dtype) for case in lines)
    return [
        row for name, dtype in groups for row in _rows_of_operation(name, wrenches, offset, dtype, largest, advance)
    ]


def _rows_of_operation(name, wrenches, offset, dtype, largest, advance):
    """The rows of one operation in one dtype: its precisions are timed alternately, and share the exact results."""
    operation, precisions, (in_cache, streamed) = OPERATIONS[name], [str(p) for p in Precision], sizes(largest)

    def timed(calls, items):
        seconds = timing.interleaved(calls, _ROUNDS, advance, _LIMIT)
        return {p: x / items for p, x in seconds.items()}

    with jax.enable_x64(dtype == "float64"):
        arrays = operation.drawn(wrenches, offset, in_cache, dtype)
        loops = {p: _Loop(operation, p, arrays, advance) for p in precisions}
        cached, stream = timed(loops, in_cache * _STEPS), dict.fromkeys(precisions)
        if dtype in STREAMED:
            many = operation.drawn(wrenches, offset, streamed, dtype)
            stream = timed({p: _Stream(operation, p, many, advance) for p in precisions}, streamed)
        errors = _errors(operation, loops)
    return [Row(Case(name, dtype, p), cached[p], stream[p], loops[p].compile_seconds, *errors[p]) for p in precisions]


def _step(operation: Operation, precision):
    """function(parts before, *arguments) -> parts: in place where the operation can be."""
    batched, i = operation.batched(precision), operation.in_place

    def step(previous, *arrays):
        return batched(*arrays) if i is None else batched(*arrays[:i], *previous, *arrays[i + 1 :])

    return step


def _first(operation: Operation, arrays):
    """Parts to start from: the argument that is replaced, or room for the result."""
    if operation.in_place is not None:
        return (arrays[operation.in_place] + 0,)
    return tuple(jnp.zeros(x.shape, x.dtype) for x in jax.eval_shape(operation.batched(DEFAULT), *arrays))


class _Stream:
    """One pass over memory; the result takes the place of an argument, or of the result before (no page faults)."""

    def __init__(self, operation, precision, arrays, advance):
        self._state, self._arrays = _first(operation, arrays), arrays
        compiled = jax.jit(_step(operation, precision), donate_argnums=0, keep_unused=True)
        self._run = compiled.lower(self._state, *arrays).compile()
        advance()

    def __call__(self):
        self._state = self._run(self._state, *self._arrays)
        return self._state


class _Loop:
    """Many steps over items that stay in the cache, in one call.

    Some arguments change sign from step to step, which costs a product each: results go there and back, and nothing can
    be computed before the loop. The number of steps is an argument, so that the program that is timed also gives the
    result of a single step.
    """

    def __init__(self, operation, precision, arrays, advance):
        self.arrays, self._first, step = arrays, _first(operation, arrays), _step(operation, precision)

        def run(count, first, *arrays):
            def body(_, carry):
                previous, sign = carry
                signed = [x * sign if i in operation.flipped else x for i, x in enumerate(arrays)]
                return step(previous, *signed), -sign

            return lax.fori_loop(0, count, body, (first, jnp.ones((), arrays[0].dtype)))[0]

        start = time.perf_counter()
        self._run = jax.jit(run).lower(_STEPS, self._first, *arrays).compile()
        self.compile_seconds = time.perf_counter() - start
        advance()

    def __call__(self, count: int = _STEPS):
        return self._run(count, self._first, *self.arrays)


def _errors(operation: Operation, loops: dict[str, _Loop]):
    """precision -> (errors in ulps, the largest over the bound, the largest of each part in its unit), on the items
    that do not overflow in this dtype."""
    arrays = [np.asarray(x) for x in next(iter(loops.values())).arrays]
    finite = np.all([np.isfinite(x.astype(np.float64)).all(-1) for x in arrays], axis=0)
    some = np.flatnonzero(finite)[:: max(1, len(finite) // _SAMPLE)]
    exactly = operation.exactly(*(x[some] for x in arrays))
    # Items whose terms add up to less than half of the largest number.
    largest = float(floats.finfo(arrays[0].dtype).max) / 2
    small = [(mag < largest).astype(bool) for _, mag in exactly]
    inside = np.all([x.all(tuple(range(1, x.ndim))) for x in small], axis=0)
    exactly, errors = [(value[inside], mag[inside]) for value, mag in exactly], {}
    for precision, loop in loops.items():
        computed = [np.asarray(x)[some[inside]] for x in loop(1)]
        worst, ulps = operation.of_promise(precision, computed, exactly)
        errors[precision] = ulps, worst, operation.in_units(computed, exactly)
    return errors


# -- error against condition number: where a precision begins to lose digits, and where it has none left ---------------

# The operations of which a curve is measured; the others do not look different.
CURVED = ("shift_force", "dot")
_ITEMS = 60
_POINTS = 17


class Point(NamedTuple):
    """The worst of many results with about one condition number (inf: the exact result is 0)."""

    condition: float
    results: int
    worst_ulps: float
    of_promise: float


class Curve(NamedTuple):
    """Points of increasing condition number."""

    operation: str
    dtype: str
    precision: str
    points: tuple[Point, ...]

    @property
    def holds(self):
        return all(point.of_promise <= 1 for point in self.points)


def curved(operations: Sequence[str] = CURVED, dtypes: Sequence[str] = STREAMED):
    """Those operations and dtypes of which there are curves, as pairs of names."""
    return [(name, dtype) for name in operations if name in CURVED for dtype in dtypes if dtype in STREAMED]


def curves(pairs: Iterable[tuple[str, str]], advance: Advance = lambda: None, seed: int = 0):
    """The curves of `curved` operations, one per precision; calls `advance` after each pair."""
    return [curve for name, dtype in pairs for curve in _curves(OPERATIONS[name], dtype, advance, seed)]


def _curves(operation: Operation, dtype, advance, seed):
    """All items of all condition numbers in one call; then each in the bin of the condition number it has."""
    rng, u = np.random.default_rng(seed), float(error.unit_roundoff(dtype))
    requested = [*np.geomspace(1, u**-2, _POINTS).tolist(), np.inf]
    groups = [CONDITIONED[operation.name](rng, _ITEMS, dtype, condition) for condition in requested]
    arrays = [np.concatenate(x) for x in zip(*groups, strict=True)]
    ((value, mag),) = operation.exactly(*arrays)
    with jax.enable_x64(dtype == "float64"):
        results = {p: np.asarray(jax.jit(operation.batched(p))(*arrays)[0]) for p in Precision}
    advance()
    bins = _bins(value, mag)
    for precision, computed in results.items():
        bound = operation.allowed(precision, 0, value, mag, computed.dtype)
        ratio, ulps = error.in_units_of(bound, computed, value, operation.flushed), error.in_ulps(computed, value)
        points = (Point(c, int(some.sum()), float(ulps[some].max()), float(ratio[some].max())) for c, some in bins)
        yield Curve(operation.name, dtype, str(precision), tuple(points))


def _bins(value, mag):
    """Condition numbers by factors of 10, as (condition, mask)."""
    of_each = np.frompyfunc(lambda m, r: float(m / abs(r)) if r else np.inf, 2, 1)(mag, value)
    condition = np.asarray(of_each, np.float64)
    is_finite = np.isfinite(condition)
    decade = np.where(is_finite, np.round(np.log10(np.where(is_finite, condition, 1))), np.inf)
    return [(float(np.median(condition[decade == d])), decade == d) for d in np.unique(decade)]


def promised_ulps(curve: Curve, condition: np.ndarray):
    """The bound of a curve's precision at a condition number, for the largest numbers that share an ulp."""
    promise, u = OPERATIONS[curve.operation].bounds[0], float(error.unit_roundoff(jnp.dtype(curve.dtype)))
    return promise.allowed(curve.precision, u, u, 1.0, condition) / u


# -- power before and after a shift: the same number, up to rounding ---------------------------------------------------

# Two shifts and two pairings, on terms whose sizes add up to mag (see `power`).
POWER_BOUND = 2.0 * (SHIFT.u + DOT.u)


class Power(NamedTuple):
    """Total power in watts about P and about Q, and the largest difference for one wrench, over u mag."""

    before: float
    after: float
    difference: float


def power(wrenches: Wrenches, offset: ArrayLike, dtype: str, sample: int = 2_000):
    """Power of all wrenches about P and, force and velocity shifted, about Q; the difference over a sample of them."""
    with jax.enable_x64(dtype == "float64"):
        tau, f, w, v = (jnp.asarray(x, dtype) for x in wrenches)
        F, V, p = SpatialForce(tau, f), SpatialVelocity(w, v), jnp.asarray(offset, dtype)
        before, after = (np.asarray(x) for x in jax.jit(_powers)(F, V, p))
    some = np.linspace(0, len(before) - 1, min(sample, len(before))).astype(int)
    _, mag = error.evaluate(
        lambda tau, f, w, v, p: ((tau - np.cross(p, f)) * w).sum(-1) + (f * (v + np.cross(w, p))).sum(-1),
        *(np.asarray(x)[some] for x in (F.tau, F.f, V.w, V.v)),
        np.asarray(p),
    )
    difference = error.in_u_of(after[some], error.rationals(before[some]), mag, flushed=30).max()
    return Power(float(before.astype(np.float64).sum()), float(after.astype(np.float64).sum()), float(difference))


def _powers(F, V, p):
    return dot(F, V), dot(jax.vmap(shift, in_axes=(0, None))(F, p), jax.vmap(shift, in_axes=(0, None))(V, p))


def fits(wrenches: Wrenches, offset: ArrayLike, dtype: DTypeLike):
    """Whether the terms of torques about Q and, where the motion is known, of power are within the range of a dtype."""
    sizes: Any = [None if x is None else abs(np.asarray(x, np.float64)) for x in (*wrenches, offset)]
    tau, f, w, v, p = sizes
    with np.errstate(over="ignore", invalid="ignore"):
        torque = tau + _cross_of_sizes(p, f)
        sizes = [torque.max(), f.max()]
        if w is not None and v is not None:
            powers = (torque * w + f * (v + _cross_of_sizes(w, p))).sum(-1)
            # The total is added up in float64, whatever the dtype: NaN where it is beyond that.
            sizes += [w.max(), v.max(), powers.max(), 0 * powers.sum()]
    return bool(np.max(sizes) < float(floats.finfo(dtype).max))


def _cross_of_sizes(a, b):
    return np.roll(a, -1, -1) * np.roll(b, 1, -1) + np.roll(a, 1, -1) * np.roll(b, -1, -1)
