"""Arithmetic of values with corrections: plain operations, and what they lose to first order.

An operand is a pair (value, correction), or a value alone, of one shape and dtype. Of a result the value is the
operation on the values, rounded; of quotients and roots on values rounded anew, which may have cancelled. Where that is
an infinity or NaN the correction means nothing. Errors below are those of value + correction, with (a, c) and (b, d)
the operands and u the unit roundoff, while no product of words underflows.

Derivatives are those of value + correction, accurate to a few u, see `differentiable`.
"""

from jax import Array, lax

from jaxspatial.arithmetic.errorfree.fence import fence
from jaxspatial.arithmetic.errorfree.reproducible import quotient
from jaxspatial.arithmetic.errorfree.transforms import two_product, two_sum
from jaxspatial.arithmetic.numbers.differentiable import (
    Operand,
    Pair,
    Tangent,
    differentiable,
    linear,
    product_tangent,
    quotient_tangent,
    root_tangent,
    sum_tangent,
    total,
)
from jaxspatial.arithmetic.numbers.pairs import is_finite


@differentiable(sum_tangent)
def add(x: Operand, y: Operand):
    """x + y. Error <= 3 u (|c| + |d| + u |a + b|). 8 flops."""
    (a, c), (b, d) = _words(x), _words(y)
    s, error = two_sum(a, b)
    return s, total(error, total(c, d))


@differentiable(product_tangent)
def multiply(x: Operand, y: Operand):
    """x y. Error <= |c d| + 3 u (|a d| + |b c| + u |a b|). 6 flops, or 17 and 2 splits."""
    (a, c), (b, d) = _words(x), _words(y)
    p, error = two_product(a, b)
    return p, total(error, linear(lax.mul, d, a), linear(lax.mul, c, b))


@differentiable(quotient_tangent)
def divide(x: Operand, y: Operand):
    """x / y. Error <= 5 u (|c / y| + 2 u |a / y|)."""
    (a, c), (b, d) = _words(x), normalised(*_words(y))
    q = quotient(a, b)
    p, error = two_product(q, b)
    # Fenced, here and below: of a constant a the compiler would add up the words, (c1 - e) + c2 = (c1 + c2) - e.
    rest = total(fence((a - p) - error), c, linear(lax.mul, d, -q))
    return q, _finite(quotient(rest, b))


@differentiable(root_tangent)
def square_root(x: Operand):
    """sqrt(x). Error <= 5 u^2 sqrt(x)."""
    a, c = normalised(*_words(x))
    r = lax.sqrt(a)
    p, error = two_product(r, r)
    return r, _finite(quotient(total(fence((a - p) - error), c), r + r))


@differentiable(sum_tangent)
def rounded(x: Pair, zero: Array):
    """(value + correction as one word, zero); the value where there is no correction, so that a zero keeps its sign."""
    value, correction = x
    usable = is_finite(correction) & lax.ne(correction, zero)
    return lax.select(usable, value + correction, value), zero


def normalised(value: Array, correction: Tangent):
    """(high, low), with high = fl(value + correction); (value, 0) where the correction is not finite."""
    if correction is None:
        return value, None
    high, low = two_sum(value, correction)
    usable = is_finite(correction)
    return lax.select(usable, high, value), lax.select(usable, low, lax.full_like(low, 0))


def _words(x: Operand):
    return x if isinstance(x, tuple) else (x, None)


def _finite(correction: Array):
    return lax.select(is_finite(correction), correction, lax.full_like(correction, 0))
