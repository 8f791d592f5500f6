"""Whether the precisions keep their promises, on inputs that make it hard."""

from collections.abc import Callable, Sequence

import jax
import numpy as np
from jax.typing import ArrayLike

from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.promise import Promise
from jaxspatial.measure import error, exact, inputs
from jaxspatial.measure.findings import DTYPES, cause, differing_from_numpy, in_dtype, rng, scanned, verdict
from jaxspatial.measure.operation import OPERATIONS, Operation
from jaxspatial.spatial.promises import SHIFT

_N = 48
# Of a rate, the sum of two shifts, and of what is pulled back.
_DERIVATIVE = Promise(u=2 * SHIFT.u, u2=4 * SHIFT.u2)


def reproducible_bits():
    """Bitwise NumPy; among the vectors crossed are equal ones, for which zero is expected."""
    shares: dict[str, float] = dict.fromkeys(DTYPES, 0.0)
    for dtype in DTYPES:
        a, b, c, d = inputs.mixed_scales(rng(), 4, 200, dtype)
        equal = np.where(np.arange(200)[:, None] % 2 == 0, a, c), np.where(np.arange(200)[:, None] % 2 == 0, b, d)
        for name, arrays in (("shift_force", (a, b, c)), ("cross_motion", (a, b, *equal)), ("dot", (a, b, c, d))):
            for context in (lambda f: f, jax.jit, lambda f: jax.jit(lambda *x: [p * 1 for p in f(*x)])):
                shares[dtype] = max(shares[dtype], differing_from_numpy(name, dtype, arrays, context))
    return verdict(shares, "NumPy's, bit by bit: shift, cross, dot, alone and in a larger program; cross(V, V) is 0")


def bounds(precision: Precision):
    """A check that holds a precision against its promise: values and derivatives, in the dtypes of `DTYPES`."""

    def check():
        worst = {dtype: max(_values_over(precision, dtype), _derivatives_over(precision, dtype)) for dtype in DTYPES}
        numbers = ", ".join(f"{ratio:.2g} ({dtype})" for dtype, ratio in worst.items())
        holds = max(worst.values()) <= 1
        what = "shift and dot at any condition number, in batches and item by item, and derivatives"
        return holds, f"{what}: worst error over promised {numbers}", "" if holds else cause()

    return check


def _values_over(precision: Precision, dtype: str):
    names = ("shift_force", "dot")
    return max(_over_promise(OPERATIONS[name], precision, _hostile(name, precision, dtype)) for name in names)


def _hostile(name: str, precision: Precision, dtype: str):
    """Arguments that cancel, up to everything, and differ in size; for a shift, whose results stay in range, also such
    as have products that overflow, where that is promised not to matter."""
    random, u = rng(), float(error.unit_roundoff(dtype))
    conditioned = inputs.CONDITIONED[name]
    groups = [conditioned(random, _N, dtype, c) for c in (1.5, u**-0.5, 0.3 / u, u**-1.5, np.inf)]
    families = ("mixed_scales", "nearly_parallel", "far_offsets", "small_integers_and_zeros")
    groups += [inputs.FAMILIES[family](random, len(groups[0]), _N, dtype) for family in families]
    if name == "shift_force" and (precision.is_within_an_ulp or dtype != "float64"):
        groups.append(inputs.near_overflow_of_products(random, len(groups[0]), _N, dtype))
    return [np.concatenate(x) for x in zip(*groups, strict=True)]


def _over_promise(subject: Operation, precision: Precision, arrays: Sequence[np.ndarray]):
    exactly = subject.exactly(*arrays)
    with in_dtype(arrays[0].dtype.name):
        results = [run(subject, precision)(*arrays) for run in (_in_a_batch, _in_a_loop, _one_by_one)]
    return max(subject.of_promise(precision, computed, exactly)[0] for computed in results)


def _in_a_batch(subject: Operation, precision: Precision):
    return jax.jit(subject.batched(precision))


def _in_a_loop(subject: Operation, precision: Precision):
    return jax.jit(scanned(lambda *item: subject.function(str(precision), *item)))


def _one_by_one(subject: Operation, precision: Precision) -> Callable[..., list[np.ndarray]]:
    """Of scalars a compiler makes other programs than of arrays."""
    compiled = jax.jit(lambda *item: subject.function(str(precision), *item))
    return lambda *arrays: [np.stack(x) for x in zip(*map(compiled, *arrays), strict=True)]


def _derivatives_over(precision: Precision, dtype: str):
    """Of a shifted torque: its rate, and what is pulled back to the force. Offset and force are nearly parallel."""
    tau, f, p, d = inputs.nearly_parallel(rng(), 4, 4 * _N, dtype)
    shifted = OPERATIONS["shift_force"].function

    def derivatives(tau: jax.Array, f: jax.Array, p: jax.Array, d: jax.Array) -> tuple[jax.Array, jax.Array]:
        _, pull_back = jax.vjp(lambda *x: shifted(str(precision), *x)[0], tau, f, p)
        rate = jax.jvp(lambda *x: shifted(str(precision), *x)[0], (tau, f, p), (d, f, d))[1]
        return rate, pull_back(d)[1]

    formulas = (lambda tau, f, p, d: d - np.cross(d, f) - np.cross(p, f), lambda tau, f, p, d: np.cross(p, d))
    with in_dtype(dtype):
        computed = jax.jit(jax.vmap(derivatives))(tau, f, p, d)
    exactly = [exact.evaluate(formula, tau, f, p, d) for formula in formulas]
    return max(_over(precision, x, *e) for x, e in zip(computed, exactly, strict=True))


def _over(precision: Precision, computed: ArrayLike, value: np.ndarray, mag: np.ndarray):
    bound = error.allowed(_DERIVATIVE, precision, value, mag, np.asarray(computed).dtype)
    return float(error.in_units_of(bound, computed, value, OPERATIONS["shift_force"].flushed).max())
