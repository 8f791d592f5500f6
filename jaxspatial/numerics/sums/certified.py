"""Sums of products in three times the precision, certified to be within one unit in the last place.

Where it cannot be given, because more cancels than that or something overflows, the result is NaN: to be computed again
by `faithful`, which takes several times as long. That sums over a batch this way, too: its expansions would grow with
the number of items.

The state of a sum is (s, c, d, size): the rounded sum, the sum of the errors made there, the sum of the errors made in
that one, and the sum of the absolute values of the last, which bounds what is unknown about it. [Ogita, Rump, Oishi
2005, algorithm 4.8, K = 3]
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.numerics.errorfree.barrier import widened
from jaxspatial.numerics.errorfree.primitives import choice
from jaxspatial.numerics.errorfree.transforms import fast_two_sum, two_sum, unguarded
from jaxspatial.numerics.sums.accumulator import Accumulator, Limbs, OverBatch, Terms
from jaxspatial.numerics.sums.compensated import product_parts, product_parts_of_narrow, sum_like, vec_sum

# d is a sum of at most 2^10 numbers: its error is at most 2^-43 size, and what is allowed is 2^-56 |r|.
_ENOUGH = 2.0**-13


def _state_of(terms: Terms, of: Callable[..., list[Array]] = product_parts) -> Limbs:
    products = [of(sign, factors) for sign, factors in terms]
    s, errors = vec_sum([p[0] for p in products])
    lower = errors + [x for p in products for x in p[1:]]
    if not lower:
        return (s, *[lax.full_like(s, 0)] * 3)
    c, errors = vec_sum(lower)
    return s, c, sum_like(s, errors), sum_like(s, [lax.abs(x) for x in errors])


def _plus(state: Limbs, sign: int, x: Array) -> Limbs:
    """What may be a constant goes second."""
    s, c, d, size = state
    s, error = two_sum(s, -x if sign < 0 else x)
    c, error = two_sum(c, error, unguarded)
    return s, c, d + error, size + lax.abs(error)


def _round(state: Limbs, dtype: DTypeLike) -> Array:
    """Rounded, or NaN."""
    r = rounded(state[:3], state[0].dtype)
    return lax.convert_element_type(_or_nan(r, r, state), dtype)


def _pair(state: Limbs, dtype: DTypeLike) -> tuple[Array, Array]:
    """(hi, lo): rounded to twice the precision, or NaN. The error is at most 2^-96 |r|."""
    hi, lo = pair(state[:3], dtype)
    return _or_nan(hi, rounded(state[:3], state[0].dtype), state), lo


def _or_nan(x: Array, r: Array, state: Limbs) -> Array:
    """x where r is certain, an exact 0 too, but no NaN or infinity."""
    largest = np.finfo(r.dtype).max
    is_certain = (state[3] <= lax.abs(r) * _ENOUGH) & (lax.abs(r) <= largest)
    return lax.select(is_certain, x, choice(math.nan, x.shape, x.dtype))


# -- sums of many numbers, without their size: (s, c, d) ---------------------------------------------------------------


def from_numbers(numbers: Sequence[Array]) -> Limbs:
    """The state of the sum of numbers in increasing order."""
    s, errors = swept(numbers)
    c, errors = swept(errors[::-1]) if errors else (lax.full_like(s, 0), [])
    return s, c, sum_like(s, errors)


def swept(numbers: Sequence[Array], two_sum: Callable[..., tuple[Array, Array]] = two_sum) -> tuple[Array, list[Array]]:
    """(the rounded sum, the errors made, of the largest first)."""
    *others, s = numbers
    errors: list[Array] = []
    for x in reversed(others):
        s, error = two_sum(s, x, unguarded)
        errors.append(error)
    return s, errors


def over_batch(numbers: Sequence[Array], finished: Callable[[Array], Array]) -> OverBatch:
    """Of items, each given as numbers in increasing order; `finished`: what becomes of each limb of the result."""

    def finished_pair(state: Limbs, dtype: DTypeLike) -> tuple[Array, Array]:
        hi, lo = pair(state, dtype)
        return finished(hi), finished(lo)

    return OverBatch(from_numbers(numbers), _merge, lambda state, dtype: finished(rounded(state, dtype)), finished_pair)


def _merge(a: Limbs, b: Limbs) -> Limbs:
    s, error = two_sum(a[0], b[0], unguarded)
    c, first = two_sum(a[1], b[1], unguarded)
    c, second = two_sum(c, error, unguarded)
    return s, c, (a[2] + b[2]) + (first + second)


def rounded(state: Limbs, dtype: DTypeLike) -> Array:
    """Rounded; where something is infinite or NaN, what the plain sum gives."""
    s, c = two_sum(state[0], state[1], unguarded)
    r = s + (c + state[2])
    return lax.convert_element_type(lax.select(lax.is_finite(r), r, state[0]), dtype)


def pair(state: Limbs, dtype: DTypeLike) -> tuple[Array, Array]:
    """(hi, lo): rounded to twice the precision."""
    s, c = two_sum(state[0], state[1], unguarded)
    hi, lo = fast_two_sum(s, c + state[2])
    finite = lax.is_finite(hi)
    hi, lo = lax.select(finite, hi, state[0]), lax.select(finite, lo, lax.full_like(lo, 0))
    high = lax.convert_element_type(hi, dtype)
    return high, lax.convert_element_type((hi - widened(high, hi.dtype)) + lo, dtype)


def _over_batch(state: Limbs, _) -> OverBatch:
    """With NaN in place of an infinity: what overflowed on the way is to be computed again."""
    return over_batch(state[2::-1], lambda x: lax.select(lax.is_finite(x), x, choice(math.nan, x.shape, x.dtype)))


CERTIFIED = Accumulator(state_of=_state_of, plus=_plus, round=_round, pair=_pair, over_batch=_over_batch)
CERTIFIED_OF_NARROW = dataclasses.replace(CERTIFIED, state_of=functools.partial(_state_of, of=product_parts_of_narrow))
