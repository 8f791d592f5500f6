"""How long calls take, measured fairly; and which precision a function needs on the numbers that it is for."""

import os
import platform
import time
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.precision import OF_REFERENCES, Precision, default_precision

Name = TypeVar("Name", bound=Hashable)
# What is called after each step of the work, for a progress bar.
Advance = Callable[[], object]


def interleaved(
    cases: Mapping[Name, Callable],
    rounds: int = 15,
    advance: Advance = lambda: None,
    limit: float = float("inf"),
):
    """Seconds per call of every case: name -> array (rounds,).

    All cases run in one process, alternately, after warm-up, so that what disturbs the machine disturbs all of them.

    cases: name -> function without arguments; what it returns is waited for.
    advance: called after every round, for a progress bar.
    limit: no new round begins after so many seconds, but the first three do.

    Example:
        >>> cases = {"shift": lambda: js.shift(F, p_PQ), "dot": lambda: js.dot(F, V)}
        >>> seconds = js.measure.interleaved(cases, rounds=5)
        >>> print({name: x.shape for name, x in seconds.items()})
        {'shift': (5,), 'dot': (5,)}
    """
    for call in cases.values():
        jax.block_until_ready(call())
        jax.block_until_ready(call())
    seconds: dict[Name, list[float]] = {name: [] for name in cases}
    begin = time.perf_counter()
    for i in range(rounds):
        for name, call in cases.items() if i < 3 or time.perf_counter() < begin + limit else ():
            start = time.perf_counter()
            jax.block_until_ready(call())
            seconds[name].append(time.perf_counter() - start)
        advance()
    return {name: np.array(s) for name, s in seconds.items()}


def machine():
    """One line that says where numbers come from.

    Example:
        >>> print(jax.__version__ in js.measure.machine())
        True
    """
    n = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    cores = f"{n} core{'' if n == 1 else 's'} in use, {jax.default_backend()}"
    versions = f"jax {jax.__version__}, jaxlib {version('jaxlib')}, numpy {np.__version__}"
    try:
        with open("/proc/cpuinfo") as lines:
            processor = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        processor = platform.processor() or platform.machine()
    return f"{processor}, {cores}, Python {platform.python_version()}, {versions}"


# -- which precision a function needs ----------------------------------------------------------------------------------


class Measured(NamedTuple):
    """One precision: the largest relative error of a result, seconds per call, and whether the tolerance holds."""

    precision: str
    error: float
    seconds: float
    holds: bool


class Recommendation:
    """What `recommend` found; printed, it is a table.

    precision: the fastest that holds the tolerance, None where none does. rows: a `Measured` for each precision.

    Example:
        >>> found = js.measure.recommend(lambda x: 2.0 * x, np.float32(1.5), tolerance=1e-6, rounds=1)
        >>> print([row.precision for row in found.rows if row.holds])
        ['fast', 'reproducible', 'compensated', 'faithful']
    """

    def __init__(self, rows: Iterable[Measured], tolerance: float):
        self.rows, self.tolerance = tuple(rows), tolerance
        good = [row for row in self.rows if row.holds]
        self.precision = min(good, key=lambda row: row.seconds).precision if good else None

    def __repr__(self):
        fastest = min(row.seconds for row in self.rows)
        lines = [f"{'precision':14}{'largest error':>14}{'time':>14}{'of fastest':>12}{'holds':>7}"]
        for row in self.rows:
            time, ratio = f"{row.seconds * 1e6:.4g} us", f"{row.seconds / fastest:.2f}"
            lines.append(f"{row.precision:14}{row.error:14.2e}{time:>14}{ratio:>12}{'yes' if row.holds else 'no':>7}")
        best = min(self.rows, key=lambda row: row.error)
        conclusion = (
            f"no precision holds {self.tolerance:.2g}, the best has {best.error:.2e}: the numbers themselves have to "
            "be of a wider dtype, or carried as DoubleWord"
        )
        if self.precision is not None:
            conclusion = (
                f'use "{self.precision}": the fastest with errors of at most {self.tolerance:.2g} of the result'
            )
        return "\n".join([*lines, conclusion])


def recommend(function: Callable, *arguments, tolerance: float, rounds: int = 9):
    """Which precision a function needs on given arguments, and what each costs on this machine.

    The function is compiled in each precision, as the default (calls inside that name one keep it), timed alternately,
    and compared with a reference: itself in "compensated", on the same numbers as float64. For float64 arguments that
    is the best that the function does, not exact: errors below 1e-15 say no more.

    Args:
        function: of the arguments, to arrays or trees of them; whatever jit takes. What it closes over has to go with
            float64 arguments as well, for the reference: Python numbers do, and a Mechanism of known numbers.
        arguments: trees of arrays, of one floating dtype.
        tolerance: the largest error allowed, relative to the largest number of each result.
        rounds: how often each precision is timed; the median counts.

    Returns:
        A Recommendation: `.precision` by name, `.rows`, and a table to print.

    Raises:
        ValueError: the tolerance is not positive, or the arguments have no floating numbers.

    Example:
        >>> f, v = np.float32([1e4, 1.0, 1e4]), np.float32([1e4, 0.1, -1e4])
        >>> power = lambda f, v: js.dot(js.SpatialForce(f=f), js.SpatialVelocity(v=v))
        >>> found = js.measure.recommend(power, f, v, tolerance=1e-6, rounds=1)
        >>> print([row.precision for row in found.rows if row.holds])
        ['compensated', 'faithful']
    """
    tolerance = check.above_zero(tolerance, "recommend: tolerance")
    if not any(map(_is_floating, jax.tree.leaves(arguments))):
        raise ValueError("recommend: arguments: expected arrays of floating point numbers, got none")
    calls = {str(p): compiled(function, p, arguments) for p in Precision}
    results = {name: jax.tree.leaves(call()) for name, call in calls.items()}
    expected = reference(function, arguments)
    errors = {name: max(map(_relative_error, x, expected), default=0.0) for name, x in results.items()}
    seconds = {name: float(np.median(s)) for name, s in interleaved(calls, rounds).items()}
    return Recommendation([Measured(p, errors[p], seconds[p], errors[p] <= tolerance) for p in calls], tolerance)


def compiled(function: Callable, precision: Precision | str, arguments: Sequence):
    """The function compiled in a precision, as a function of nothing."""
    with default_precision(precision):
        program = jax.jit(function).lower(*arguments).compile()
    return lambda: program(*arguments)


def reference(function: Callable, arguments: Sequence, precision: Precision = OF_REFERENCES):
    """The results as float64, of arguments as float64."""
    with jax.enable_x64(True):
        wide = jax.tree.map(lambda x: x.astype(np.float64) if _is_floating(x) else x, arguments)
        return [np.asarray(x, np.float64) for x in jax.tree.leaves(compiled(function, precision, wide)())]


def _is_floating(x):
    return isinstance(x, floats.ARRAYS) and jnp.issubdtype(x.dtype, jnp.floating)


def _relative_error(x, exact):
    """The largest error relative to the largest number; infinite where a result is not finite and should be."""
    x = np.asarray(x, np.float64)
    same = (x == exact) | (np.isnan(x) & np.isnan(exact))
    if same.all():
        return 0.0
    if not np.isfinite(x[~same]).all() or not np.isfinite(exact[~same]).all():
        return float("inf")
    size = float(abs(exact[np.isfinite(exact)]).max(initial=0.0))
    return float(abs(x - exact)[~same].max() / size) if size else float("inf")
