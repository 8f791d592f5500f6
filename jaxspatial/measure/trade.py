"""The trade of speed for accuracy, measured: operation x dtype x precision, in cache and streaming through memory."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jax import lax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.precision import DEFAULT, Precision
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.measure import timing
from jaxspatial.measure.operation import OPERATIONS, Exactly, Operation, Parts
from jaxspatial.measure.scene import Wrenches
from jaxspatial.measure.timing import Advance, Name

LARGEST = 1_000_000
SMALLEST = 1_000
IN_CACHE = 2_000
DTYPES = ("float16", "bfloat16", "float32", "float64")
# The others are there to hold data, not to compute with: one size tells enough.
STREAMED = ("float32", "float64")
_STEPS = 100
_SAMPLE = 500
_ROUNDS = 11
# Seconds after which slow cases get fewer rounds.
_LIMIT = 3.0

# Of a loop: the parts before, and the sign of the next step.
Carry = tuple[Parts, jax.Array]


class Case(NamedTuple):
    """One line of the trade."""

    operation: str
    dtype: str
    precision: str


Lines = Sequence[Case]


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
    def promise(self):
        return OPERATIONS[self.case.operation].promise(self.case.precision)

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
        return list(zip(OPERATIONS[self.case.operation].units, self.worst_in_units, strict=True))

    @property
    def gigabytes_per_second(self):
        """Of numbers read and written while streaming."""
        words = OPERATIONS[self.case.operation].words
        return words * jnp.dtype(self.case.dtype).itemsize / nanoseconds(self.streamed)


def nanoseconds(seconds: np.ndarray | None):
    """Their median; NaN for what was not measured."""
    return np.nan if seconds is None else float(np.median(seconds)) * 1e9


def sizes(largest: int = LARGEST):
    """(items in cache, items streamed)."""
    return min(IN_CACHE, largest), largest


def cases(operations: Iterable[str] = tuple(OPERATIONS), dtypes: Iterable[str] = DTYPES):
    """All lines of the trade."""
    return [Case(o, d, str(p)) for o in operations for d in dtypes for p in Precision]


def steps(lines: Lines):
    """How often `measure` calls `advance`."""
    streamed = sum(case.dtype in STREAMED for case in lines)
    return len(lines) + streamed + (len(lines) + streamed) // len(Precision) * _ROUNDS


def measure(
    wrenches: Wrenches, offset: npt.ArrayLike, lines: Lines, largest: int = LARGEST, advance: Advance = lambda: None
):
    """The rows of the trade for these wrenches (float64 arrays), repeated or cut to each size, and this offset."""
    groups = dict.fromkeys((case.operation, case.dtype) for case in lines)
    return [row for name, dtype in groups for row in _group((wrenches, offset), name, dtype, largest, advance)]


def _group(scene: tuple[Wrenches, npt.ArrayLike], name: str, dtype: str, largest: int, advance: Advance):
    """The rows of one operation in one dtype: its precisions are timed in turns, and share the exact results."""
    operation, (wrenches, offset), (in_cache, streamed) = OPERATIONS[name], scene, sizes(largest)
    with jax.enable_x64(dtype == "float64"):
        arrays = arguments(operation, wrenches, offset, in_cache, dtype)
        loops = {p: _Loop(operation, p, arrays, advance) for p in map(str, Precision)}
        cached = _timed(loops, in_cache * _STEPS, advance)
        stream = _streamed(operation, arguments(operation, wrenches, offset, streamed, dtype), advance)
        errors = _errors(operation, loops)
    return [
        Row(Case(name, dtype, p), cached[p], stream[p], loops[p].compile_seconds, *errors[p])
        for p in map(str, Precision)
    ]


def _streamed(operation: Operation, arrays: Sequence[jax.Array], advance: Advance):
    """precision -> seconds per item (rounds,), None for formats that only hold data."""
    if arrays[0].dtype.name not in STREAMED:
        return dict.fromkeys(map(str, Precision))
    calls = {p: _Stream(operation, p, arrays, advance) for p in map(str, Precision)}
    return _timed(calls, len(arrays[0]), advance)


def _timed(calls: Mapping[Name, Callable[[], Any]], items: int, advance: Advance):
    return {p: x / items for p, x in timing.interleaved(calls, _ROUNDS, advance, _LIMIT).items()}


def arguments(operation: Operation, wrenches: Wrenches, offset: npt.ArrayLike, n: int, dtype: str):
    """The arguments of an operation for n of the wrenches, evenly spread, or repeated as often as needed.

    Accelerations are those of a body of 1 kg and 1 kg m2 under the wrench.
    """
    count = len(wrenches.tau)
    index = np.linspace(0, count - 1, n).astype(int) if n < count else np.arange(n) % count
    known = {
        **wrenches._asdict(),
        "alpha": wrenches.tau,
        "a": wrenches.f,
        "p": np.broadcast_to(np.asarray(offset, np.float64), wrenches.tau.shape),
    }
    with np.errstate(over="ignore"):
        return [jnp.asarray(known[name][index].astype(jnp.dtype(dtype))) for name in operation.arguments]


def _step(operation: Operation, precision: str):
    """function(parts before, *arguments) -> parts: in place where the operation can be."""
    batched, i = operation.batched(precision), operation.replaced

    def step(previous: Parts, *arrays: jax.Array):
        return batched(*arrays) if i is None else batched(*arrays[:i], *previous, *arrays[i + 1 :])

    return step


def _first(operation: Operation, arrays: Sequence[jax.Array]):
    """Parts to start from: the argument that is replaced, or room for the result."""
    if operation.replaced is not None:
        return (arrays[operation.replaced] + 0,)
    shapes = jax.eval_shape(operation.batched(DEFAULT), *arrays)
    return tuple(jnp.zeros(x.shape, x.dtype) for x in shapes)


class _Stream:
    """One pass over memory; the result takes the place of an argument, or of the result before (no page faults)."""

    def __init__(self, operation: Operation, precision: str, arrays: Sequence[jax.Array], advance: Advance):
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

    def __init__(self, operation: Operation, precision: str, arrays: Sequence[jax.Array], advance: Advance):
        self.arrays, self._first = arrays, _first(operation, arrays)
        start = time.perf_counter()
        looped = jax.jit(_looped(operation, precision))
        self._run = looped.lower(_STEPS, self._first, *arrays).compile()
        self.compile_seconds = time.perf_counter() - start
        advance()

    def __call__(self, count: int = _STEPS):
        return self._run(count, self._first, *self.arrays)


def _looped(operation: Operation, precision: str) -> Callable[..., Parts]:
    step = _step(operation, precision)

    def run(count: int, first: Parts, *arrays: jax.Array) -> Parts:
        def body(_: jax.Array, carry: Carry) -> Carry:
            previous, sign = carry
            turned = [x * sign if i in operation.turned else x for i, x in enumerate(arrays)]
            return step(previous, *turned), -sign

        return cast(Carry, lax.fori_loop(0, count, body, (first, jnp.ones((), arrays[0].dtype))))[0]

    return run


def _errors(operation: Operation, loops: Mapping[str, _Loop]) -> dict[str, tuple[np.ndarray, float, tuple[float, ...]]]:
    """precision -> (errors in ulps, the largest over the bound, the largest of each part in its unit), on the items
    that do not overflow in this dtype."""
    arrays = [np.asarray(x) for x in next(iter(loops.values())).arrays]
    finite = np.all([np.isfinite(x.astype(np.float64)).all(-1) for x in arrays], axis=0)
    some = np.flatnonzero(finite)[:: max(1, len(finite) // _SAMPLE)]
    exactly = operation.exactly(*(x[some] for x in arrays))
    inside = _inside(exactly, arrays[0].dtype)
    chosen = some[inside]
    exactly = [(value[inside], mag[inside]) for value, mag in exactly]
    computed = {p: [np.asarray(x)[chosen] for x in loop(1)] for p, loop in loops.items()}
    found = {p: operation.of_promise(p, x, exactly) for p, x in computed.items()}
    return {p: (ulps, worst, operation.in_units(computed[p], exactly)) for p, (worst, ulps) in found.items()}


def _inside(exactly: Sequence[Exactly], dtype: DTypeLike):
    """Items whose terms add up to less than half of the largest number."""
    largest = float(check.finfo(dtype).max) / 2
    small = [(mag < largest).astype(bool) for _, mag in exactly]
    return np.all([x.all(tuple(range(1, x.ndim))) for x in small], axis=0)
