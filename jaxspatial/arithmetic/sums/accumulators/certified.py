"""Sums of products in three times the precision, certified to be within one unit in the last place.

Where it cannot be given, because more cancels than that or something overflows, the result is NaN: to be computed again
by `faithful`, which takes several times as long.

The state of a sum is (s, c, d, size): the rounded sum, the sum of the errors made there, the sum of the errors made in
that one, and the sum of the absolute values of the last, which bounds what is unknown about it. [Ogita, Rump, Oishi
2005, algorithm 4.8, K = 3]
"""

import dataclasses
from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.arithmetic.errorfree.transforms import two_sum, unguarded
from jaxspatial.arithmetic.sums import sum3
from jaxspatial.arithmetic.sums.accumulators.accumulator import Accumulator, Error, OverBatch, Terms, Words
from jaxspatial.arithmetic.sums.accumulators.compensated import sum_like, vec_sum
from jaxspatial.arithmetic.sums.accumulators.faithful import parts, parts_of_narrow

# d is a sum of at most 2^10 numbers: its error is at most 2^-43 size, and what is allowed is 2^-56 |r|.
_ENOUGH = 2.0**-13


def _total(terms: Terms, error: Error) -> Words:
    return _sum([parts(sign, factors, error) for sign, factors in terms])


def _total_of_narrow(terms: Terms, error: Error) -> Words:
    """As `_total`, for factors of at most half the digits."""
    return _sum([parts_of_narrow(sign, factors, error) for sign, factors in terms])


def _sum(products: Sequence[Sequence[Array]]) -> Words:
    s, errors = vec_sum([p[0] for p in products])
    lower = errors + [x for p in products for x in p[1:]]
    if not lower:
        return (s, *[jnp.zeros_like(s)] * 3)
    c, errors = vec_sum(lower)
    return s, c, sum_like(s, errors), sum_like(s, [lax.abs(x) for x in errors])


def _plus(state: Words, sign: int, x: Array) -> Words:
    """What may be a constant goes second."""
    s, c, d, size = state
    s, error = two_sum(s, -x if sign < 0 else x)
    c, error = two_sum(c, error, unguarded)
    return s, c, d + error, size + lax.abs(error)


def _round(state: Words, dtype: DTypeLike) -> Array:
    """Rounded, or NaN."""
    r = sum3.rounded(state[:3], state[0].dtype)
    return lax.convert_element_type(_or_nan(r, r, state), dtype)


def _pair(state: Words, dtype: DTypeLike) -> tuple[Array, Array]:
    """(hi, lo): rounded to twice the precision, or NaN. The error is at most 2^-96 |r|."""
    hi, lo = sum3.pair(state[:3], dtype)
    return _or_nan(hi, sum3.rounded(state[:3], state[0].dtype), state), lo


def _finite_or_nan(x: Array) -> Array:
    """x, NaN in place of an infinity: what overflowed on the way is to be computed again."""
    return lax.select(lax.is_finite(x), x, jnp.full_like(x, jnp.nan))


def _or_nan(x: Array, r: Array, state: Words) -> Array:
    """x where r is certain, an exact 0 too, but no NaN or infinity."""
    largest = jnp.finfo(r.dtype).max
    is_certain = (state[3] <= lax.abs(r) * _ENOUGH) & (lax.abs(r) <= largest)
    return lax.select(is_certain, x, jnp.full_like(x, jnp.nan))


def _over_batch(state: Words, axes: Sequence[int]) -> OverBatch:
    return sum3.over_batch(state[2::-1], _finite_or_nan)


CERTIFIED = Accumulator(total=_total, plus=_plus, round=_round, pair=_pair, over_batch=_over_batch)
CERTIFIED_OF_NARROW = dataclasses.replace(CERTIFIED, total=_total_of_narrow)
