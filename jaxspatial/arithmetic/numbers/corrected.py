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
from jax import lax

from jaxspatial.arithmetic.numbers import corrections, folding


class Corrected:
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
        return self if other._is(0) else self._combined(other, operator.add, corrections.add)

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
        return self._combined(other, operator.mul, corrections.multiply)

    __rmul__ = __mul__

    def __truediv__(self, other: "Corrected | float"):
        other = self._of(other)
        return self if other._is(1) or self._is(0) else self._combined(other, operator.truediv, corrections.divide)

    def __rtruediv__(self, other: "Corrected | float"):
        return self._of(other) / self

    def sqrt(self):
        return Corrected(*corrections.square_root(_operand(self, self.value.shape)))

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
        return corrections.rounded(self.words, lax.full_like(self.value, 0))[0]

    def _compared(self, comparison: Callable[[Any, Any], Any], other: "Corrected | float"):
        return comparison((self - other).rounded(), 0)

    def __lt__(self, other: "Corrected | float"):
        return self._compared(operator.lt, other)

    def __le__(self, other: "Corrected | float"):
        return self._compared(operator.le, other)

    def __gt__(self, other: "Corrected | float"):
        return self._compared(operator.gt, other)

    def __ge__(self, other: "Corrected | float"):
        return self._compared(operator.ge, other)


def nearest(number: float | fractions.Fraction, dtype: np.dtype[Any]):
    """The one nearest to a Fraction or Python number, known while tracing."""
    value = dtype.type(float(number))
    return Corrected(value, _rest(fractions.Fraction(number), value) if math.isfinite(value) else None)


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
