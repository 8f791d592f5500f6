"""Which precision a function needs: it runs in each, on the numbers that it is for, and is timed and compared."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.precision import OF_REFERENCES, Precision, default_precision
from jaxspatial.measure import timing


class Measured(NamedTuple):
    """One precision: the largest relative error of a result, seconds per call, and whether the tolerance holds."""

    precision: str
    error: float
    seconds: float
    holds: bool


class Recommendation:
    """What `recommend` found; printed, it is a table.

    precision: the fastest that holds the tolerance, None where none does. rows: a `Measured` for each precision.
    """

    def __init__(self, rows: Iterable[Measured], tolerance: float):
        self.rows, self.tolerance = tuple(rows), tolerance
        held = [row for row in self.rows if row.holds]
        self.precision = min(held, key=lambda row: row.seconds).precision if held else None

    def __repr__(self):
        fastest = min(row.seconds for row in self.rows)
        lines = [f"{'precision':14}{'largest error':>14}{'time':>14}{'of fastest':>12}{'holds':>7}"]
        for row in self.rows:
            time, ratio = f"{row.seconds * 1e6:.4g} us", f"{row.seconds / fastest:.2f}"
            lines.append(f"{row.precision:14}{row.error:14.2e}{time:>14}{ratio:>12}{'yes' if row.holds else 'no':>7}")
        return "\n".join([*lines, self._said])

    @property
    def _said(self):
        if self.precision is not None:
            return f'use "{self.precision}": the fastest with errors of at most {self.tolerance:.2g} of the result'
        best = min(self.rows, key=lambda row: row.error)
        return (
            f"no precision holds {self.tolerance:.2g}, the best has {best.error:.2e}: the numbers themselves have to "
            "be of a wider dtype, or carried as DoubleWord"
        )


def recommend(function: Callable[..., Any], *arguments: Any, tolerance: float, rounds: int = 9):
    """Which precision a function needs on given arguments, and what each costs on this machine.

        print(recommend(lambda q, v, a: js.inverse_dynamics(mech, q, v, a), q, v, a, tolerance=1e-6))

    It is compiled in each precision, as the default (calls inside that name one keep it), run in turns, and compared
    with a reference: itself in "compensated", on the same numbers as float64. For float64 arguments that is the best
    that the function does, not exact: errors below 1e-15 say no more.

    function: of the arguments, to arrays or trees of them; whatever jit takes. What it closes over has to go with
        float64 arguments as well, for the reference: Python numbers do, and a Mechanism of known numbers.
    arguments: trees of arrays, of one floating dtype
    tolerance: the largest error allowed, relative to the largest number of each result
    rounds: how often each precision is timed; the median counts

    Returns a Recommendation: `.precision` by name, `.rows`, and a table to print. Raises ValueError for a tolerance
    that is not positive, and for arguments without floating numbers.
    """
    if not tolerance > 0:
        raise ValueError(f"recommend: tolerance: expected a number above 0, got {tolerance!r}")
    _require_floats(arguments)
    calls = {str(p): compiled(function, p, arguments) for p in Precision}
    found = {name: jax.tree.leaves(call()) for name, call in calls.items()}
    expected = reference(function, arguments)
    errors = {name: _largest_error(results, expected) for name, results in found.items()}
    seconds = {name: float(np.median(s)) for name, s in timing.interleaved(calls, rounds).items()}
    rows = [Measured(name, errors[name], seconds[name], errors[name] <= tolerance) for name in calls]
    return Recommendation(rows, tolerance)


def _require_floats(arguments: Sequence[Any]):
    if not any(map(_is_floating, jax.tree.leaves(arguments))):
        raise ValueError("recommend: arguments: expected arrays of floating point numbers, got none")


def _is_floating(x: Any):
    return isinstance(x, check.ARRAYS) and jnp.issubdtype(x.dtype, jnp.floating)


def compiled(function: Callable[..., Any], precision: Precision | str, arguments: Sequence[Any]):
    """The function compiled in a precision, as a function of nothing."""
    with default_precision(precision):
        program = jax.jit(function).lower(*arguments).compile()
    return lambda: program(*arguments)


def reference(function: Callable[..., Any], arguments: Sequence[Any], precision: Precision = OF_REFERENCES):
    """The results as float64, of arguments as float64."""
    with jax.enable_x64(True):
        call = compiled(function, precision, jax.tree.map(_widened, arguments))
        return [np.asarray(x, np.float64) for x in jax.tree.leaves(call())]


def _widened(x: Any):
    return x.astype(np.float64) if _is_floating(x) else x


def _largest_error(results: Iterable[ArrayLike], expected: Iterable[np.ndarray]) -> Any:
    """Of all results, each relative to its largest number; infinite where one is not finite and should be."""
    return max((_error(np.asarray(x, np.float64), y) for x, y in zip(results, expected, strict=True)), default=0.0)


def _error(x: np.ndarray, exact: np.ndarray):
    same = (x == exact) | (np.isnan(x) & np.isnan(exact))
    if same.all():
        return 0.0
    if not np.isfinite(x[~same]).all() or not np.isfinite(exact[~same]).all():
        return float("inf")
    finite = abs(exact[np.isfinite(exact)])
    size = float(finite.max()) if finite.size else 0.0
    return float(abs(x - exact)[~same].max() / size) if size else float("inf")
