"""Sums of products to within one unit in the last place where little cancels, at the price of `compensated`; NaN where
that is not certain, to be computed again by `certified`.

The state of a sum is (s, c, size): the rounded sum; the sum of the errors made there and in products; and the sum of
the absolute values of all that was rounded to get c, u times which bounds its error. Of narrow formats products are
exact and s has digits enough: c is None, and size is of what was rounded to get s.
"""

import dataclasses
import functools
import math
import operator
from typing import NamedTuple

import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree.primitives import choice
from jaxspatial.numerics.errorfree.transforms import two_sum
from jaxspatial.numerics.sums.accumulator import Terms, Trial
from jaxspatial.numerics.sums.compensated import signed_product, vec_sum
from jaxspatial.numerics.sums.pairwise import of_neighbours

# Of a unit of the result, what an error before the last rounding may be.
_ENOUGH = 2.0**-3


class State(NamedTuple):
    s: Array
    c: Array | None
    size: Array


def _state_of(terms: Terms) -> State:
    pairs = [signed_product(sign, factors) for sign, factors in terms]
    s, errors = vec_sum([p for p, _ in pairs])
    # Those of products first: where products cancel exactly, so do they.
    return State(s, *_summed(s, [e for _, e in pairs if e is not None] + errors))


def _state_of_narrow(terms: Terms) -> State:
    """As `_state_of`, for at most two factors of at most half the digits."""
    products = [functools.reduce(operator.mul, factors) for _, factors in terms]
    signed = [p if sign > 0 else -p for (sign, _), p in zip(terms, products, strict=True)]
    s, size = _summed(products[0], signed)
    return State(s, None, size)


def _summed(like: Array, numbers: list[Array]) -> tuple[Array, Array]:
    """(the sum in pairs, the sum of the absolute values of what was rounded)."""
    rounded: list[Array] = []

    def add(a: Array, b: Array) -> Array:
        rounded.append(a + b)
        return rounded[-1]

    s = of_neighbours(add, numbers) if numbers else lax.full_like(like, 0)
    return s, functools.reduce(operator.add, map(lax.abs, rounded), lax.full_like(like, 0))


def _plus(state: State, sign: int, x: Array) -> State:
    """What may be a constant goes second."""
    x = -x if sign < 0 else x
    if state.c is None:
        s = state.s + x
        return State(s, None, state.size + lax.abs(s))
    s, error = two_sum(state.s, x)
    c = state.c + error
    return State(s, c, state.size + lax.abs(c))


def _round(state: State, dtype: DTypeLike) -> Array:
    """Rounded, or NaN."""
    r = state.s if state.c is None else state.s + state.c
    unit = floats.eps(dtype) / floats.eps(r.dtype)
    is_certain = (state.size <= lax.abs(r) * (unit * _ENOUGH)) & (lax.abs(r) <= np.finfo(r.dtype).max)
    return lax.convert_element_type(lax.select(is_certain, r, choice(math.nan, r.shape, r.dtype)), dtype)


ESTIMATED = Trial(state_of=_state_of, plus=_plus, round=_round)
ESTIMATED_OF_NARROW = dataclasses.replace(ESTIMATED, state_of=_state_of_narrow)
