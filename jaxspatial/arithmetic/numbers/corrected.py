"""Numbers that carry the first-order correction of their rounding errors: as plain arithmetic, with twice the digits.

What whole algorithms compute in where their promise is relative to the terms of a result. `value` is what plain
arithmetic gives, rounded operation by operation; `correction` adds up what each operation lost, propagated to first
order. No operation normalises: a sum takes 8 flops and a product 6, where double words take 20 and more.

Let mag be what a number would be if all terms had one sign, and a u mag the error of its value, which plain arithmetic
would have. A correction has that size. What value + correction misses is products of two corrections, in all at most
a^2 u^2 mag / 2, and that each operation rounds corrections, by 3 a u^2 mag at most. For algorithms with n bodies in a
chain 32 n u^2 mag are promised: products of corrections stay below that for a <= 8 sqrt(n), and found is a = 1 for n of
6 to 100, with an error of n u^2 mag / 4. Quotients are first order as well: an inverse D^-1 counts with mag as many
times as the condition of D says. Where a value is infinite or NaN, its correction means nothing and is not used.

[Lange, Rump 2020, Faithfully rounded floating-point computations, ACM TOMS 46(3): CPair arithmetic] [Langlois 2001,
Automatic linear correction of rounding errors, BIT 41(3)]
"""

import fractions
import math
import operator
from collections.abc import Callable, Iterable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.errorfree.barrier import barrier
from jaxspatial.arithmetic.errorfree.reproducible import quotient
from jaxspatial.arithmetic.errorfree.transforms import two_product, two_sum
from jaxspatial.arithmetic.numbers import folding, pairs
from jaxspatial.arithmetic.numbers.protocol import Compared


class Corrected(Compared):
    """value + correction: arrays over the batch, or numbers known while tracing, which fold.

    A correction may be known to be 0 beside a value that is data; what has a known value has a known correction.
    """

    def __init__(self, value: Any, correction: Any = None):
        self.value = value
        self.correction = value.dtype.type(0) if correction is None else correction

    @property
    def dtype(self):
        return np.dtype(self.value.dtype)

    @property
    def words(self):
        return self.value, self.correction

    def with_words(self, words: Iterable[Any]):
        """A number of this kind."""
        return Corrected(*words)

    def constant(self, number: float | fractions.Fraction):
        """The one nearest to a Fraction or Python number, known while tracing."""
        value = self.dtype.type(float(number))
        return Corrected(value, _rest(fractions.Fraction(number), value) if math.isfinite(value) else None)

    def of_word(self, word: Any):
        return Corrected(word)

    @property
    def is_known(self):
        return folding.is_known(self.value)

    def _is(self, *values: float):
        return folding.is_known(self.value, *values) and self.correction == 0

    def _of(self, other: "Corrected | float"):
        return other if isinstance(other, Corrected) else Corrected(self.dtype.type(other))

    def __neg__(self):
        return Corrected(-self.value, -self.correction)

    def __abs__(self):
        is_negative = self < 0
        return Corrected(*(_negated(is_negative, word) for word in self.words))

    def __add__(self, other: "Corrected | float"):
        other = self._of(other)
        if self._is(0):
            return other
        return self if other._is(0) else self._combined(other, operator.add, _add)

    __radd__ = __add__

    def __sub__(self, other: "Corrected | float"):
        return self + -self._of(other)

    def __rsub__(self, other: "Corrected | float"):
        return self._of(other) + -self

    def __mul__(self, other: "Corrected | float"):
        other = self._of(other)
        for one, x in ((self, other), (other, self)):
            if one._is(0):
                return Corrected(one.value * one.value)
            if one._is(1):
                return x
            if one.is_known and _is_power_of_two(one):
                return Corrected(*(folding.quietly(operator.mul, word, one.value) for word in x.words))
        return self._combined(other, operator.mul, _multiply)

    __rmul__ = __mul__

    def __truediv__(self, other: "Corrected | float"):
        other = self._of(other)
        return self if other._is(1) or self._is(0) else self._combined(other, check.truediv, _divide)

    def __rtruediv__(self, other: "Corrected | float"):
        return self._of(other) / self

    def sqrt(self):
        return Corrected(*_square_root(_operand(self, self.value.shape)))

    def _combined(self, other: "Corrected", exact: Callable[[Any, Any], Any], of_words: Callable[..., Any]):
        if self.is_known and other.is_known:
            return _known(exact, self, other)
        shape = np.broadcast_shapes(np.shape(self.value), np.shape(other.value))
        return Corrected(*of_words(_operand(self, shape), _operand(other, shape)))

    # -- decisions ----------------------------------------------------------------------------------------------------

    def rounded(self):
        """The number as one word."""
        if folding.is_known(self.correction):
            return self.value
        return _rounded(self.words, lax.full_like(self.value, 0))[0]

    def compared(self, comparison: Callable[[Any, Any], Any], other: "Corrected | float"):
        return comparison((self - other).rounded(), 0)


def _rest(exact: fractions.Fraction, value: Any):
    return value.dtype.type(float(exact - fractions.Fraction(float(value))))


def _known(operation: Callable[[Any, Any], Any], a: Corrected, b: Corrected):
    """The operation on known numbers: its value rounded, its correction from rational numbers."""
    value = folding.quietly(operation, a.value, b.value)
    words = *a.words, *b.words
    if not np.isfinite([value, *words]).all() or (operation is operator.truediv and b.value == 0):
        return Corrected(value)
    return Corrected(value, _rest(operation(_exact(a), _exact(b)), value))


def _exact(x: Corrected):
    return sum(fractions.Fraction(float(word)) for word in x.words)


def _is_power_of_two(x: Corrected):
    return x.correction == 0 and abs(math.frexp(float(x.value))[0]) == 0.5


def _negated(condition: Any, word: Any):
    """-word where the condition holds."""
    if folding.is_known(word):
        return -word if word and condition else word
    return lax.select(condition, -word, word)


def _operand(x: Corrected, shape: tuple[int, ...]):
    """(value, correction) over a shape, or the value alone where there is no correction."""
    value = _array(x.value, shape)
    return value if folding.is_known(x.correction, 0) else (value, _array(x.correction, shape))


def _array(word: Any, shape: tuple[int, ...]):
    return jnp.full(shape, word) if folding.is_known(word) else jnp.broadcast_to(word, shape)


# -- the operations ---------------------------------------------------------------------------------------------------
# An operand is a pair (value, correction), or a value alone, of one shape and dtype. Of a result the value is the
# operation on the values, rounded; of quotients and roots on values rounded anew, which may have cancelled. Where that
# is an infinity or NaN the correction means nothing. Errors below are those of value + correction, with (a, c) and
# (b, d) the operands and u the unit roundoff, while no product of words underflows.


@pairs.as_sum
def _add(x: pairs.Operand, y: pairs.Operand):
    """x + y. Error <= 3 u (|c| + |d| + u |a + b|). 8 flops."""
    (a, c), (b, d) = _words(x), _words(y)
    s, error = two_sum(a, b)
    return s, pairs.total(error, pairs.total(c, d))


@pairs.as_product
def _multiply(x: pairs.Operand, y: pairs.Operand):
    """x y. Error <= |c d| + 3 u (|a d| + |b c| + u |a b|). 6 flops, or 17 and 2 splits."""
    (a, c), (b, d) = _words(x), _words(y)
    p, error = two_product(a, b)
    return p, pairs.total(error, pairs.linear(lax.mul, d, a), pairs.linear(lax.mul, c, b))


@pairs.as_quotient
def _divide(x: pairs.Operand, y: pairs.Operand):
    """x / y. Error <= 5 u (|c / y| + 2 u |a / y|)."""
    (a, c), (b, d) = _words(x), _normalised(*_words(y))
    q = quotient(a, b)
    p, error = two_product(q, b)
    # A barrier, here and below: of a constant a the compiler would add up the words, (c1 - e) + c2 = (c1 + c2) - e.
    rest = pairs.total(barrier((a - p) - error), c, pairs.linear(lax.mul, d, -q))
    return q, _finite(quotient(rest, b))


@pairs.as_root
def _square_root(x: pairs.Operand):
    """sqrt(x). Error <= 5 u^2 sqrt(x)."""
    a, c = _normalised(*_words(x))
    r = lax.sqrt(a)
    p, error = two_product(r, r)
    return r, _finite(quotient(pairs.total(barrier((a - p) - error), c), r + r))


@pairs.as_sum
def _rounded(x: pairs.Pair, zero: Array):
    """(value + correction as one word, zero); the value where there is no correction, so that a zero keeps its sign."""
    value, correction = x
    usable = pairs.is_finite(correction) & lax.ne(correction, zero)
    return lax.select(usable, value + correction, value), zero


def _normalised(value: Array, correction: pairs.Tangent):
    """(high, low), with high = fl(value + correction); (value, 0) where the correction is not finite."""
    if correction is None:
        return value, None
    high, low = two_sum(value, correction)
    usable = pairs.is_finite(correction)
    return lax.select(usable, high, value), lax.select(usable, low, lax.full_like(low, 0))


def _words(x: pairs.Operand):
    return x if isinstance(x, tuple) else (x, None)


def _finite(correction: Array):
    return lax.select(pairs.is_finite(correction), correction, lax.full_like(correction, 0))
