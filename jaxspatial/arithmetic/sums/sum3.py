"""Sums over many items in three times the precision, for `faithful`, whose expansions would grow with their number.

The state of a sum is (s, c, d), each the errors of the one before. [Ogita, Rump, Oishi 2005, algorithm 4.8, K = 3]
"""

from collections.abc import Callable, Sequence

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.arithmetic.errorfree.transforms import fast_two_sum, two_sum, unguarded
from jaxspatial.arithmetic.sums.accumulators.accumulator import OverBatch, Words
from jaxspatial.arithmetic.sums.accumulators.compensated import sum_like


def from_numbers(numbers: Sequence[Array]) -> Words:
    """The state of the sum of numbers in increasing order."""
    s, errors = _swept(list(numbers))
    c, errors = _swept(errors[::-1]) if errors else (jnp.zeros_like(s), [])
    return s, c, sum_like(s, errors)


def _swept(numbers: Sequence[Array]) -> tuple[Array, list[Array]]:
    """(the rounded sum, the errors made, of the largest first)."""
    *others, s = numbers
    errors = []
    for x in reversed(others):
        s, error = two_sum(s, x, unguarded)
        errors.append(error)
    return s, errors


def over_batch(numbers: Sequence[Array], settled: Callable[[Array], Array]) -> OverBatch:
    """Of items, each given as numbers in increasing order; `settled`: what becomes of each word of the result."""
    return OverBatch(
        from_numbers(numbers),
        _merge,
        lambda state, dtype: settled(rounded(state, dtype)),
        lambda state, dtype: tuple(settled(x) for x in pair(state, dtype)),
    )


def _merge(a: Words, b: Words) -> Words:
    s, error = two_sum(a[0], b[0], unguarded)
    c, first = two_sum(a[1], b[1], unguarded)
    c, second = two_sum(c, error, unguarded)
    return s, c, (a[2] + b[2]) + (first + second)


def rounded(state: Words, dtype: DTypeLike) -> Array:
    """Rounded; where something is infinite or NaN, what the plain sum gives."""
    s, c = two_sum(state[0], state[1], unguarded)
    r = s + (c + state[2])
    return lax.convert_element_type(lax.select(lax.is_finite(r), r, state[0]), dtype)


def pair(state: Words, dtype: DTypeLike) -> tuple[Array, Array]:
    """(hi, lo): rounded to twice the precision."""
    s, c = two_sum(state[0], state[1], unguarded)
    hi, lo = fast_two_sum(s, c + state[2])
    finite = lax.is_finite(hi)
    hi, lo = lax.select(finite, hi, state[0]), lax.select(finite, lo, jnp.zeros_like(lo))
    high = lax.convert_element_type(hi, dtype)
    return high, lax.convert_element_type((hi - lax.convert_element_type(high, hi.dtype)) + lo, dtype)
