"""Sums of products to within one unit in the last place where little cancels, at the price of `compensated`; NaN where
that is not certain, to be computed again by `certified`.

The state of a sum is (s, c, size): the rounded sum; the sum of the errors made there and in products; and the sum of
the absolute values of all that was rounded to get c, u times which bounds its error. Of narrow formats products are
exact and s has digits enough: c is None, and size is of what was rounded to get s.
"""

import functools
import operator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from jaxspatial.arithmetic.errorfree.transforms import two_sum
from jaxspatial.arithmetic.sums.accumulators.compensated import product, vec_sum

# Of a unit of the result, what an error before the last rounding may be.
_ENOUGH = 2.0**-3


class State(NamedTuple):
    s: Any
    c: Any
    size: Any


def total(terms, error):
    """The state of the sum of terms (sign, factors)."""
    pairs = [product(sign, factors, error) for sign, factors in terms]
    s, errors = vec_sum([p for p, _ in pairs])
    # Those of products first: where products cancel exactly, so do they.
    return State(s, *_summed(s, [e for _, e in pairs if e is not None] + errors))


def total_of_narrow(terms, _):
    """As `total`, for at most two factors of at most half the digits."""
    products = [functools.reduce(operator.mul, factors) for _, factors in terms]
    signed = [p if sign > 0 else -p for (sign, _), p in zip(terms, products, strict=True)]
    s, size = _summed(products[0], signed)
    return State(s, None, size)


def _summed(like, numbers):
    """(the sum in pairs, the sum of the absolute values of what was rounded)."""
    size = jnp.zeros_like(like)
    if not numbers:
        return size, size
    while len(numbers) > 1:
        sums = [a + b for a, b in zip(numbers[::2], numbers[1::2], strict=False)]
        size = functools.reduce(operator.add, map(lax.abs, sums), size)
        numbers = sums + numbers[len(numbers) // 2 * 2 :]
    return numbers[0], size


def plus(state, sign, x):
    """The state with one more term, which may be a constant: it goes second."""
    x = -x if sign < 0 else x
    if state.c is None:
        s = state.s + x
        return State(s, None, state.size + lax.abs(s))
    s, error = two_sum(state.s, x)
    c = state.c + error
    return State(s, c, state.size + lax.abs(c))


def padded(states):
    """The states with zero in place of None."""
    like = next(state for state in states if state is not None)
    return [jax.tree.map(jnp.zeros_like, like) if state is None else state for state in states]


def times_power_of_two(state, share):
    """The state of the sum times a power of two."""
    return jax.tree.map(lambda x: x * jnp.full_like(x, share), state)


def value(state, dtype):
    """Rounded, or NaN."""
    r = state.s if state.c is None else state.s + state.c
    unit = float(jnp.finfo(dtype).eps / jnp.finfo(r.dtype).eps)
    is_certain = (state.size <= lax.abs(r) * (unit * _ENOUGH)) & (lax.abs(r) <= jnp.finfo(r.dtype).max)
    return lax.convert_element_type(lax.select(is_certain, r, jnp.full_like(r, jnp.nan)), dtype)
