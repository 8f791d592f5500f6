"""Whole algorithms in the trade: inverse and forward dynamics of a robot, precision against time against error."""

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.precision import OF_ALGORITHMS, OF_REFERENCES
from jaxspatial.dynamics.configuration import random_configuration
from jaxspatial.dynamics.forward_dynamics import forward_dynamics
from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics
from jaxspatial.measure import error, exact, timing
from jaxspatial.measure.recommend import compiled
from jaxspatial.measure.timing import Advance
from jaxspatial.measure.trade import Case
from jaxspatial.mechanism import Mechanism

DTYPES = ("float32", "float64")
# What all others are held against: its result is as if of twice the digits of float64, rounded once.
REFERENCE = ("float64", OF_REFERENCES)
STATES = 500
_ROUNDS, _LIMIT = 11, 3.0
_TURNING = {"revolute", "continuous", "helical", "universal", "ball"}

State = tuple[jax.Array, jax.Array, jax.Array]
Key = tuple[str, str]  # dtype and precision


class Algorithm(NamedTuple):
    """One algorithm: of q, v and, per coordinate, vdot or tau; turning is the unit of joints that do nothing else."""

    name: str
    function: Callable[..., jax.Array]
    turning: str

    @property
    def title(self):
        return self.name.replace("_", " ")

    def unit(self, mechanism: Mechanism):
        """Of the numbers of its results."""
        is_turning = set(mechanism.topology.kinds) <= _TURNING
        return self.turning if is_turning else "SI"


ALGORITHMS = {
    algorithm.name: algorithm
    for algorithm in (
        Algorithm("inverse_dynamics", inverse_dynamics, "N m"),
        Algorithm("forward_dynamics", forward_dynamics, "rad/s²"),
    )
}


class Evaluated(NamedTuple):
    """What was measured for an algorithm in one dtype and precision. Errors of the reference are not known: NaN."""

    case: Case
    seconds: np.ndarray  # per evaluation (rounds,)
    compile_seconds: float
    ulps: np.ndarray  # of each state the largest error, in ulps of the largest number of its result
    worst_in_units: float
    unit: str

    @property
    def worst_ulps(self):
        return float(np.max(self.ulps))


def cases(algorithms: Iterable[str] = tuple(ALGORITHMS), dtypes: Iterable[str] = DTYPES):
    """All that is measured."""
    return [Case(a, d, str(p)) for a in algorithms for d in dtypes if d in DTYPES for p in OF_ALGORITHMS]


def steps(lines: Sequence[Case]):
    """How often `measure` calls `advance`."""
    names = {case.operation for case in lines}
    needed = {*lines, *(Case(name, *map(str, REFERENCE)) for name in names)}
    return len(needed) + len(names) * _ROUNDS


def measure(mechanism: Mechanism, lines: Sequence[Case], states: int = STATES, advance: Advance = lambda: None):
    """What `cases` cost for random states of a Mechanism, all of them in one call, and how far off they are."""
    names = dict.fromkeys(case.operation for case in lines)
    mechanism = mechanism.astype(np.float32)
    return [row for name in names for row in _group(ALGORITHMS[name], mechanism, lines, states, advance)]


def _group(algorithm: Algorithm, mechanism: Mechanism, lines: Sequence[Case], states: int, advance: Advance):
    """One algorithm, timed in turns; all in numbers of float32, which every dtype holds."""
    state = _state(algorithm, mechanism, states)
    wanted = [case[1:] for case in lines if case.operation == algorithm.name]
    needed = dict.fromkeys([*wanted, REFERENCE])
    programs = {key: _Program(algorithm, mechanism, state, key, advance) for key in needed}
    seconds = timing.interleaved({key: programs[key] for key in wanted}, _ROUNDS, advance, _LIMIT)
    expected, unit = exact.rationals(programs[REFERENCE]()), algorithm.unit(mechanism)
    for key in wanted:
        errors = _errors(programs[key](), expected) if key != REFERENCE else (np.full(states, np.nan), np.nan)
        yield Evaluated(Case(algorithm.name, *key), seconds[key] / states, programs[key].compile_seconds, *errors, unit)


def _errors(computed: jax.Array, expected: np.ndarray):
    """(per state in ulps of the largest number, the largest of all as it is)."""
    return error.in_ulps_of_norm(computed, expected), float(error.in_units_of(1, computed, expected).max())


def _state(algorithm: Algorithm, mechanism: Mechanism, n: int) -> State:
    """q, v and vdot (n, ...) of random motions; or q, v and the generalized forces that they need."""
    rng, q = np.random.default_rng(0), random_configuration(mechanism, jax.random.key(0), (n,), jnp.float32)
    v, vdot = (jnp.asarray(x) for x in rng.standard_normal((2, n, mechanism.nv)).astype(np.float32))
    if algorithm.function is inverse_dynamics:
        return q, v, vdot
    return q, v, cast(jax.Array, jax.jit(jax.vmap(partial(inverse_dynamics, mechanism)))(q, v, vdot))


class _Program:
    """An algorithm for all states at once, compiled in a dtype and precision."""

    def __init__(self, algorithm: Algorithm, mechanism: Mechanism, state: State, key: Key, advance: Advance):
        dtype, precision = key
        mechanism, self._is_wide = mechanism.astype(np.dtype(dtype)), dtype == "float64"
        with jax.enable_x64(self._is_wide):
            arrays = [jnp.asarray(np.asarray(x), dtype) for x in state]
            start = time.perf_counter()
            self._call = compiled(jax.vmap(lambda *x: algorithm.function(mechanism, *x)), precision, arrays)
            self.compile_seconds = time.perf_counter() - start
        advance()

    def __call__(self):
        with jax.enable_x64(self._is_wide):
            return self._call()
