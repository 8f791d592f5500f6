"""How a formula is run: over which numbers; as one compiled program, or written into the one that is being traced."""

import functools
import typing
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.errorfree.barrier import barrier
from jaxspatial.arithmetic.numbers import Number, Rounded, components, folding, is_number
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.polynomial import Quotient
from jaxspatial.arithmetic.numbers.stacking import Stacked, Summed, as_array, converted, from_outside, of_array, stacked
from jaxspatial.arithmetic.numbers.trees import to_double_word
from jaxspatial.arithmetic.precision import Precision, resolve
from jaxspatial.arithmetic.sums.pairwise import pairwise_sum
from jaxspatial.arithmetic.sums.symbolic import run_symbolically


def formula(function: Callable[..., typing.Any] | None = None, *, of_sums: bool = False) -> typing.Any:
    """Makes of `function(*vectors, **static)` a function of (precision, *arrays, **static).

    Arrays are (*batch, n), with batch shapes that broadcast; the function gets each as a vector of n numbers. It
    returns a number, a vector (an array with a last axis), a mask, or a list of these. What is static is hashable.

    of_sums: True for sums of products, of which the last step may be a quotient; then

        fast, reproducible      in the inputs' dtype; bfloat16 in float32
        compensated, faithful   each result a polynomial, evaluated as a whole: see `symbolic`

    and for all others, with roots, quotients and selections,

        fast, reproducible      in the inputs' dtype; float16 and bfloat16 in float32
        compensated, faithful   in float64 for narrower dtypes, in double words for float64

    and rounded once at the end. Arguments may be double words: then the results are, whatever the precision asked for.
    If any is Components, all results with an axis of components are, known where the structure of the arguments makes
    them so; if these are zeros all of them, only those results are that are zero.

    Outside of any transformation a call is one compiled program, as fast as it gets and bitwise the same as inside a
    larger jit; it compiles once per precision, shapes and dtypes. While tracing, NumPy arrays are numbers known to the
    formula, which then leaves out what they make unnecessary; everything else is inlined from a cached trace.
    """
    if function is None:
        return functools.partial(formula, of_sums=of_sums)
    program = functools.partial(_run_beside_zeros, _run_sums if of_sums else _run, function)
    compiled: Any = jax.jit(program, static_argnums=(0, 1), inline=True)

    @functools.wraps(function)
    def call(precision: Any, *arrays: Any, **static: Any) -> Any:
        arrays = components.alike(check.narrowed_each(arrays))
        known = any(isinstance(a, np.ndarray) for a in arrays)
        tracing = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arrays))
        run = program if known and tracing else compiled
        return run(resolve(precision), tuple(sorted(static.items())), *arrays)

    return call


def _run_beside_zeros(
    run: Callable[..., Any], function: Callable[..., Any], precision: Precision, static: Any, *arrays: Any
) -> Any:
    """As `run`. Where all Components are zeros, whole arrays are computed with, and zeros come out as Components."""
    zeros = [components.is_zero(a) for a in arrays if components.is_components(a)]
    if not zeros or not all(zeros):
        return run(function, precision, static, *arrays)
    is_vector: list[bool] = []

    def noted(*vectors: Any, **static: Any) -> Any:
        found = function(*vectors, **static)
        several: list[Any] = found if isinstance(found, check.LIST) else [found]
        is_vector[:] = [isinstance(x, (Stacked, check.TUPLE)) and not isinstance(x, Quotient) for x in several]
        return found

    found = run(noted, precision, static, *(components.as_array(a, ()) for a in arrays))
    several = found if isinstance(found, check.LIST) else [found]
    several = [
        components.zero(x.shape[-1], x.dtype) if yes and components.is_zero(x) else x
        for yes, x in zip(is_vector, several, strict=True)
    ]
    return several if isinstance(found, check.LIST) else several[0]


def _run(function: Callable[..., Any], precision: Precision, static: tuple[tuple[str, Any], ...], *arrays: Any) -> Any:
    is_pair = any(map(components.has_pairs, arrays))
    twice = is_pair or precision.sees_whole_sums
    with jax.enable_x64(bool(check.config.jax_enable_x64) or twice):
        numbers = functools.partial(of_array, precision=precision, twice=twice)
        return _run_over(numbers, functools.partial(function, **dict(static)), arrays, is_pair)


def _run_over(numbers: Callable[..., Any], function: Callable[..., Any], arrays: Sequence[Any], is_pair: bool = False):
    """The results for arrays, each over their batch made a vector of numbers."""
    batch = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    is_apart = any(map(components.is_components, arrays))
    found = function(*map(numbers, check.broadcast_batch(batch, *arrays)))
    results = _Results(batch, np.dtype(arrays[0].dtype), is_pair, is_apart)
    return [results.rounded(x) for x in found] if isinstance(found, check.LIST) else results.rounded(found)


# -- sums of products -------------------------------------------------------------------------------------------------


def _widened(x: Any) -> Any:
    """In float32: behind a barrier first, for a rounding to bfloat16 and back may be left out."""
    return barrier(x).astype(np.float32)


def _run_sums(
    function: Callable[..., Any], precision: Precision, static: tuple[tuple[str, Any], ...], *arrays: Any
) -> Any:
    function = functools.partial(function, **dict(static))
    if precision.sees_whole_sums or any(map(components.has_pairs, arrays)):
        return run_symbolically(function, precision, arrays)

    def numbers(array: Any) -> Sequence[Number]:
        if not is_apart:
            return stacked(precision, array)
        apart = components.as_components(array).components
        return tuple(Rounded(precision, x, from_outside(x, precision)) for x in apart)

    is_apart = any(map(components.is_components, arrays))
    if arrays[0].dtype != jnp.bfloat16:
        return _run_over(numbers, function, arrays)
    found = _run_over(numbers, function, jax.tree.map(_widened, arrays))
    return jax.tree.map(functools.partial(converted, dtype=jnp.bfloat16), found)


# -- what comes out ---------------------------------------------------------------------------------------------------


class _Results(typing.NamedTuple):
    """What the results of a formula become: arrays, double words or Components over a batch, of the inputs' dtype."""

    batch: tuple[int, ...]
    dtype: np.dtype
    is_pair: bool
    is_apart: bool

    def rounded(self, x: Any) -> Any:
        if isinstance(x, Summed):
            return self._summed(x.vector)
        if isinstance(x, Stacked):
            return x.array
        if isinstance(x, check.TUPLE):
            parts = [self._number(c) for c in x]
            if self.is_apart:
                return components.of(parts)
            return jax.tree.map(lambda *words: folding.stack(words, self.batch), *parts)
        found = self._number(x)
        return np.broadcast_to(found, self.batch) if self.batch and folding.is_known(found) else found

    def _number(self, x: Any) -> Any:
        if not is_number(x):
            return jnp.broadcast_to(x, self.batch)
        if not self.is_pair:
            return self._over_batch(as_array(x, self.dtype))
        if isinstance(x, DoubleWord):
            return jax.tree.map(self._over_batch, x)
        return to_double_word(jnp.broadcast_to(x.words[0], self.batch), self.dtype)

    def _over_batch(self, x: Any) -> Any:
        """What is known stays so, for the array that it becomes a component of."""
        return x if folding.is_known(x) else jnp.broadcast_to(x, self.batch)

    def _summed(self, vector: Any) -> Any:
        """Over the last axis of the batch. A known 0 stays known; of other numbers the sum is data."""
        if not self.is_apart:
            return _sum_of_items(self.rounded(vector))
        parts = ((c, folding.is_known(c, 0)) for c in (x.operand for x in vector))
        return components.of([c if is_0 else pairwise_sum(jnp.broadcast_to(c, self.batch)) for c, is_0 in parts])


def _sum_of_items(x: Any) -> Any:
    """The sum of x (*batch, n, k) over n: (*batch, k)."""
    if isinstance(x, check.NUMPY) and not x.any():
        return np.zeros((*x.shape[:-2], x.shape[-1]), x.dtype)
    return jnp.moveaxis(pairwise_sum(jnp.moveaxis(barrier(x), -1, 0)), 0, -1)
