"""Sums of products to within one unit in the last place, however much cancels: no error is dropped before the end.

The state of a sum is an expansion: numbers in increasing order that do not overlap and add up to it exactly.
[Shewchuk 1997, Adaptive Precision Floating-Point Arithmetic, theorem 10]

Products that would overflow are computed once more, scaled down together with all other terms, and those are taken
where the overflowing ones do not cancel to exactly zero: a sum of them that is not zero is at least 2^894, next to
which what the scaling loses of the other terms is nothing.
"""

import functools
import operator
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from jaxspatial.arithmetic import compensated, tripled
from jaxspatial.arithmetic.eft import fast_two_sum, two_difference, two_product, two_sum, unguarded

# A sum of 2^20 products below 2^1000 is finite, and so is 2^2048 scaled by 2^-540 twice.
_LARGE = 2.0**1000
_SCALE = 2.0**-540


class State(NamedTuple):
    """A sum: its expansion, times unit^2; and what the plain sum gives, for infinities and NaN."""

    expansion: tuple
    unit: object
    plain: object


def total_of_narrow(terms, guard):
    """The state of the sum of terms (sign, factors), factors of at most half the digits: products of two are exact."""
    products = []
    for sign, (first, *others) in terms:
        p = guard(-first * others[0] if sign < 0 else first * others[0]) if others else guard(first * sign)
        products.append(two_product(p, others[1], guard) if others[1:] else (p,))
    return _state(products, _plain(products))


def total(terms, guard):
    """The state of the sum of terms (sign, factors), products of two of which may overflow."""
    products = [parts(sign, factors, guard) for sign, factors in terms]
    plain = _plain(products)
    zero, one, scale = (jnp.full_like(plain, x) for x in (0.0, 1.0, _SCALE))
    large = [_is_large(p[0]) & (len(f) == 2) for (_, f), p in zip(terms, products, strict=True)]
    scaled = [_scaled_parts(p, sign, f, guard, scale) for p, (sign, f) in zip(products, terms, strict=True)]
    alone = [[jnp.where(m, x, zero) for x in s] for m, s in zip(large, scaled, strict=True)]
    is_scaled = _sum(_expansion(alone)) != 0
    chosen = [
        [jnp.where(is_scaled, y, jnp.where(m, zero, x)) for x, y in zip(p, s, strict=True)]
        for m, p, s in zip(large, products, scaled, strict=True)
    ]
    return _state(chosen, plain)._replace(unit=jnp.where(is_scaled, scale, one))


def _plain(products):
    return compensated.in_pairs([p[0] for p in products])


def _state(products, plain):
    return State(_expansion(products), jnp.ones_like(plain), plain)


def _is_large(p):
    return ~(jnp.abs(p) < jnp.full_like(p, _LARGE))


def parts(sign, factors, guard):
    """The product as one number for each doubling of its digits, largest first; exactly their sum."""
    found = [guard(-factors[0] if sign < 0 else factors[0])]
    for x in factors[1:]:
        found = [y for part in found for y in two_product(part, x, guard)]
    return found


def _scaled_parts(unscaled, sign, factors, guard, scale):
    """The parts of a product of two factors, each factor scaled; of all others by as much."""
    if len(factors) == 2:
        return parts(sign, [x * scale for x in factors], guard)
    return [(x * scale) * scale for x in unscaled]


def _expansion(products):
    """The expansion of the sum of products, each the numbers of an expansion, largest first. [Shewchuk 1997, 12]"""
    expansion, *others = (tuple(reversed(p)) for p in products)
    for product in others:
        settled = ()
        for x in product:
            lowest, *expansion = _grown(expansion, x)
            settled = (*settled, lowest)
        expansion = (*settled, *expansion)
    return tuple(expansion)


def _grown(expansion, x):
    grown = []
    for y in expansion:
        x, error = two_sum(x, y, unguarded)
        grown.append(error)
    return (*grown, x)


def _sum(expansion):
    """The sum, with an error far below one unit in the last place: the errors of the largest added are added last."""
    *others, s = expansion
    errors = []
    for x in reversed(others):
        s, error = fast_two_sum(s, x, unguarded)
        errors.append(error)
    return s + compensated.in_pairs(errors[::-1]) if errors else s


def plus(state, sign, x):
    """The state with one more term."""
    scaled = (x * state.unit) * state.unit
    plain = state.plain - x if sign < 0 else state.plain + x
    return State(_grown_by(state.expansion, sign, scaled), state.unit, plain)


def _grown_by(expansion, sign, x):
    """The first sum has x second, which may be a constant."""
    first, *others = expansion
    s, error = (two_difference if sign < 0 else two_sum)(first, x)
    return (error, *_grown(tuple(others), s))


def pair(state, dtype):
    """(hi, lo): rounded to twice the precision."""
    return tripled.pair(tripled.from_numbers(numbers(state)), dtype)


def levelled(states):
    """The states with zero in place of None, and expansions of one length."""
    like = next(state for state in states if state is not None)
    zero, one = jnp.zeros_like(like.plain), jnp.ones_like(like.plain)
    states = [State((), one, zero) if state is None else state for state in states]
    longest = max(len(state.expansion) for state in states)
    return [s._replace(expansion=(zero,) * (longest - len(s.expansion)) + s.expansion) for s in states]


def numbers(state):
    """The numbers of the expansion, in increasing order."""
    return [_unscaled(x, state.unit) for x in state.expansion]


def value(state, dtype):
    """Rounded; where something is infinite or NaN, what the plain sum gives."""
    # Numbers that do not overlap, added from the smallest: relative error 2^-51, far below a unit of a narrower dtype.
    total = _sum(state.expansion) if dtype == jnp.float64 else functools.reduce(operator.add, state.expansion)
    r = _unscaled(total, state.unit)
    return lax.convert_element_type(jnp.where(jnp.isnan(r), state.plain, r), dtype)


def _unscaled(x, unit):
    inverse = jnp.where(unit == 1, unit, jnp.full_like(unit, 1 / _SCALE))
    return (x * inverse) * inverse
