"""Error against condition number: where a precision begins to lose digits, and where it has none left."""

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.measure import error
from jaxspatial.measure.inputs import CONDITIONED
from jaxspatial.measure.operation import OPERATIONS, Operation, Parts
from jaxspatial.measure.timing import Advance

DTYPES = ("float32", "float64")
# Those of which a curve is measured; the others do not look different.
CURVED = ("shift_force", "dot")
_ITEMS = 60
_POINTS = 17


# Condition numbers of about one size, and which results have them.
Bins = list[tuple[float, np.ndarray]]


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


def subjects(operations: Sequence[str] = CURVED, dtypes: Sequence[str] = DTYPES):
    """Those operations and dtypes of which there are curves, as pairs of names."""
    return [(name, dtype) for name in operations if name in CURVED for dtype in dtypes if dtype in DTYPES]


def measure(pairs: Iterable[tuple[str, str]], advance: Advance = lambda: None, seed: int = 0):
    """The curves of `subjects`, one per precision; calls `advance` after each of them."""
    return [curve for name, dtype in pairs for curve in _curves(OPERATIONS[name], dtype, advance, seed)]


def requested(dtype: DTypeLike) -> list[float]:
    """Condition numbers from 1 to 1/u^2, and infinity."""
    u = float(error.unit_roundoff(dtype))
    return [*np.geomspace(1, u**-2, _POINTS).tolist(), np.inf]


def _curves(operation: Operation, dtype: str, advance: Advance, seed: int):
    """All items of all condition numbers in one call; then each in the bin of the condition number it has."""
    generate, rng = CONDITIONED[operation.name], np.random.default_rng(seed)
    groups = [generate(rng, _ITEMS, dtype, condition) for condition in requested(dtype)]
    arrays = [np.concatenate(x) for x in zip(*groups, strict=True)]
    ((value, mag),) = operation.exactly(*arrays)
    with jax.enable_x64(dtype == "float64"):
        results = {p: np.asarray(_run(operation.name, p)(*arrays)[0]) for p in Precision}
    advance()
    bins = _bins(value, mag)
    points = {p: _points(operation, p, x, value, mag, bins) for p, x in results.items()}
    return [Curve(operation.name, dtype, str(p), found) for p, found in points.items()]


@functools.cache
def _run(name: str, precision: Precision | str) -> Callable[..., Parts]:
    """Compiled once, however often the curves are measured."""
    return jax.jit(OPERATIONS[name].batched(precision))


def _bins(value: np.ndarray, mag: np.ndarray):
    """Condition numbers by factors of 10, as (condition, mask)."""
    of_each = np.frompyfunc(lambda m, r: float(m / abs(r)) if r else np.inf, 2, 1)(mag, value)
    condition = np.asarray(of_each, np.float64)
    is_finite = np.isfinite(condition)
    decade = np.where(is_finite, np.round(np.log10(np.where(is_finite, condition, 1))), np.inf)
    return [(float(np.median(condition[decade == d])), decade == d) for d in np.unique(decade)]


def _points(
    operation: Operation, precision: Precision, computed: np.ndarray, value: np.ndarray, mag: np.ndarray, bins: Bins
):
    bound = operation.allowed(precision, 0, value, mag, computed.dtype)
    ratio, ulps = error.in_units_of(bound, computed, value, operation.flushed), error.in_ulps(computed, value)
    return tuple(Point(c, int(mask.sum()), float(ulps[mask].max()), float(ratio[mask].max())) for c, mask in bins)


def promised_ulps(curve: Curve, condition: np.ndarray):
    """The bound of a curve's precision at a condition number, for the largest numbers that share an ulp."""
    promise, u = OPERATIONS[curve.operation].bounds[0], float(error.unit_roundoff(jnp.dtype(curve.dtype)))
    return promise.allowed(curve.precision, u, u, 1.0, condition) / u
