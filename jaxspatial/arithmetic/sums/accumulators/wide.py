"""Sums of products of narrow formats, in float64: products of two are exact, and nothing over- or underflows.

The state of a sum is one array.
"""

import functools
import operator

from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.arithmetic.sums.accumulators.accumulator import Accumulator, OverBatch, Terms, Words


def _total(terms: Terms) -> Words:
    """The sum of terms (sign, factors), factors arrays of float64. Error <= 2^-53 times their number, times mag."""
    products = ((sign, functools.reduce(lax.mul, factors)) for sign, factors in terms)
    return (functools.reduce(operator.add, (p if sign > 0 else -p for sign, p in products)),)


def _plus(state: Words, sign: int, x: Array) -> Words:
    return (x + state[0] if sign > 0 else state[0] - x,)


def _merge(a: Words, b: Words) -> Words:
    return (a[0] + b[0],)


def _round(state: Words, dtype: DTypeLike) -> Array:
    return lax.convert_element_type(state[0], dtype)


def _pair(state: Words, dtype: DTypeLike) -> tuple[Array, Array]:
    """(hi, lo) of dtype with the sum of both as near as two of them get."""
    hi = _round(state, dtype)
    return hi, lax.convert_element_type(state[0] - lax.convert_element_type(hi, state[0].dtype), dtype)


WIDE = Accumulator(
    total=_total,
    plus=_plus,
    round=_round,
    pair=_pair,
    over_batch=lambda state, _: OverBatch(state, _merge, _round, _pair),
)
