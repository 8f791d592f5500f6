"""Sums of products in three times the precision, certified to be within one unit in the last place.

Where it cannot be given, because more cancels than that or something overflows, the result is NaN: to be computed again
by `faithful`, which takes several times as long.

The state of a sum is (s, c, d, size): the rounded sum, the sum of the errors made there, the sum of the errors made in
that one, and the sum of the absolute values of the last, which bounds what is unknown about it. [Ogita, Rump, Oishi
2005, algorithm 4.8, K = 3]
"""

import jax.numpy as jnp

from jaxspatial.arithmetic import compensated, tripled
from jaxspatial.arithmetic.eft import two_sum, unguarded
from jaxspatial.arithmetic.faithful import parts

# d is a sum of at most 2^10 numbers: its error is at most 2^-43 size, and what is allowed is 2^-56 |r|.
_ENOUGH = 2.0**-13


def total(terms, guard):
    """The state of the sum of terms (sign, factors)."""
    products = [parts(sign, factors, guard) for sign, factors in terms]
    s, errors = _swept([p[0] for p in products])
    lower = errors + [x for p in products for x in p[1:]]
    if not lower:
        return (s, *[jnp.zeros_like(s)] * 3)
    c, errors = _swept(lower)
    return s, c, _sum(errors, s), _sum([jnp.abs(x) for x in errors], s)


def _swept(numbers):
    """(the rounded sum, the errors made), in pairs."""
    errors = []
    while len(numbers) > 1:
        sums = [two_sum(a, b, unguarded) for a, b in zip(numbers[::2], numbers[1::2], strict=False)]
        errors += [e for _, e in sums]
        numbers = [s for s, _ in sums] + numbers[len(numbers) // 2 * 2 :]
    return numbers[0], errors


def _sum(numbers, like):
    return compensated.in_pairs(numbers) if numbers else jnp.zeros_like(like)


def plus(state, sign, x):
    """The state with one more term, which may be a constant: it goes second."""
    s, c, d, size = state
    s, error = two_sum(s, -x if sign < 0 else x)
    c, error = two_sum(c, error, unguarded)
    return s, c, d + error, size + jnp.abs(error)


def levelled(states):
    """The states with zero in place of None."""
    return compensated.levelled(states)


def value(state, dtype):
    """Rounded, or NaN."""
    r = tripled.value(state[:3], dtype)
    return jnp.where(_is_certain(r, state), r, jnp.full_like(r, jnp.nan))


def pair(state, dtype):
    """(hi, lo): rounded to twice the precision, or NaN. The error is at most 2^-96 |r|."""
    hi, lo = tripled.pair(state[:3], dtype)
    return jnp.where(_is_certain(hi, state), hi, jnp.full_like(hi, jnp.nan)), lo


def _is_certain(r, state):
    """Also of an exact 0. False where r is NaN or infinite."""
    return (state[3] <= jnp.abs(r) * _ENOUGH) & (jnp.abs(r) <= jnp.finfo(r.dtype).max)
