"""Numbers that carry the first-order correction of their rounding errors: as plain arithmetic, with twice the digits.

Whole algorithms compute with them where their promise is relative to the terms of a result. `value` is what plain
arithmetic gives, rounded operation by operation; `correction` adds up what each operation lost, propagated to first
order. No operation normalises: a sum takes 8 flops and a product 6, where double words take 20 and more.

Let mag be the number with every term replaced by its absolute value, and let the error of `value`, that of plain
arithmetic, be a u mag. The correction has that size. Two things are left out of value + correction: products of two
corrections, in all at most a^2 u^2 mag / 2, and the rounding of corrections, at most 3 a u^2 mag. For algorithms with
n bodies in series 32 n u^2 mag are promised. Products of corrections stay below that for a <= 8 sqrt(n). Measured for
n of 6 to 100, a is 1 and the error n u^2 mag / 4. Quotients are first order as well: an inverse D^-1 counts with mag
as many times as the condition of D says. Where a value is infinite or NaN, its correction means nothing and is not
used.

[Lange, Rump 2020, Faithfully rounded floating-point computations, ACM TOMS 46(3): CPair arithmetic] [Langlois 2001,
Automatic linear correction of rounding errors, BIT 41(3)]
"""

import fractions
import math
import operator
from collections.abc import Callable, Iterable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree.barrier import barrier, quotient, root
from jaxspatial.numerics.errorfree.transforms import two_product, two_sum
from jaxspatial.numerics.numbers import pairs
from jaxspatial.numerics.numbers.rounded import Number, is_known, quietly


class Corrected(Number):
    """value + correction: arrays over the batch, or numbers known while tracing, which fold.

    A correction may be known to be 0 beside a value that is data; what has a known value has a known correction.
    """

    def __init__(self, value, correction=None):
        self.value = value
        self.correction = value.dtype.type(0) if correction is None else correction

    @property
    def dtype(self):
        return np.dtype(self.value.dtype)

    @property
    def limbs(self):
        return self.value, self.correction

    def with_limbs(self, limbs: Iterable):
        """A number of this kind."""
        return Corrected(*limbs)

    def _constant(self, number: float | fractions.Fraction):
        """The one nearest to a Fraction or Python number, known while tracing."""
        value = self.dtype.type(float(number))
        return Corrected(value, _rest(fractions.Fraction(number), value) if math.isfinite(value) else None)

    def _of_limb(self, limb):
        return Corrected(limb)

    @property
    def is_known(self):
        return is_known(self.value)

    def __neg__(self):
        return Corrected(-self.value, -self.correction)

    def __abs__(self):
        is_negative = self < 0
        if self.is_known:
            return -self if is_negative else self
        return Corrected(*(x if is_known(x) else lax.select(is_negative, -x, x) for x in self.limbs))

    def sqrt(self):
        return Corrected(*_square_root(_operand(self, self.value.shape)))

    def _is(self, number: float):
        return is_known(self.value, number) and self.correction == 0

    def _operated(self, operation: Callable, other, is_reflected: bool = False):
        """A known 0, and a factor that is known to be a power of two, leave no operation of limbs behind."""
        if not isinstance(other, Corrected):
            if isinstance(other, Sequence):
                return NotImplemented  # A vector, which knows its multiples itself.
            other = Corrected(self.dtype.type(other))
        a, b = (other, self) if is_reflected else (self, other)
        if operation is operator.sub:
            operation, b = operator.add, -b
        if operation is operator.add and (a._is(0) or b._is(0)):
            return b if a._is(0) else a
        if operation is operator.truediv and (b._is(1) or a._is(0)):
            return a
        for one, x in ((a, b), (b, a)) if operation is operator.mul else ():
            if one._is(0):
                return Corrected(one.value * one.value)
            if one._is(1):
                return x
            if one.is_known and one.correction == 0 and abs(math.frexp(float(one.value))[0]) == 0.5:
                return Corrected(*(quietly(operator.mul, limb, one.value) for limb in x.limbs))
        if a.is_known and b.is_known:
            return _folded(operation, a, b)
        shape = floats.broadcast_shapes(np.shape(a.value), np.shape(b.value))
        return Corrected(*_OF_LIMBS[operation](_operand(a, shape), _operand(b, shape)))

    # -- decisions -----------------------------------------------------------------------------------------------------

    def _rounded(self):
        """The number as one limb."""
        if is_known(self.correction):
            return self.value
        return _rounded(self.limbs, lax.full_like(self.value, 0))[0]

    def _compared(self, comparison: Callable, other):
        return comparison((self - other)._rounded(), 0)


jax.tree_util.register_pytree_node(Corrected, lambda x: (x.limbs, None), lambda _, limbs: Corrected(*limbs))


def _rest(exact: fractions.Fraction, value):
    return value.dtype.type(float(exact - fractions.Fraction(float(value))))


def _folded(operation: Callable, a: Corrected, b: Corrected):
    """The operation on known numbers: its value rounded, its correction from rational numbers."""
    value = quietly(operation, a.value, b.value)
    limbs = *a.limbs, *b.limbs
    if not np.isfinite([value, *limbs]).all() or (operation is operator.truediv and b.value == 0):
        return Corrected(value)
    exact = (sum(fractions.Fraction(float(limb)) for limb in x.limbs) for x in (a, b))
    return Corrected(value, _rest(operation(*exact), value))


def _operand(x: Corrected, shape: tuple[int, ...]):
    """(value, correction) over a shape, or the value alone where there is no correction."""
    value = _array(x.value, shape)
    return value if is_known(x.correction, 0) else (value, _array(x.correction, shape))


def _array(limb, shape: tuple[int, ...]):
    return jnp.full(shape, limb) if is_known(limb) else jnp.broadcast_to(limb, shape)


# -- the operations ----------------------------------------------------------------------------------------------------
# An operand is a pair (value, correction), or a value alone, of one shape and dtype. Of a result the value is the
# operation on the values, rounded; of quotients and roots on values rounded anew, which may have cancelled. Where that
# is an infinity or NaN the correction means nothing. Errors below are those of value + correction, with (a, c) and
# (b, d) the operands and u the unit roundoff, while no product of limbs underflows.


@pairs.as_sum
def _add(x: pairs.Operand, y: pairs.Operand):
    """x + y. Error <= 3 u (|c| + |d| + u |a + b|). 8 flops."""
    (a, c), (b, d) = _limbs(x), _limbs(y)
    s, error = two_sum(a, b)
    return s, pairs.added(error, pairs.added(c, d))


@pairs.as_product
def _multiply(x: pairs.Operand, y: pairs.Operand):
    """x y. Error <= |c d| + 3 u (|a d| + |b c| + u |a b|). 6 flops, or 17 and 2 splits."""
    (a, c), (b, d) = _limbs(x), _limbs(y)
    p, error = two_product(a, b)
    return p, pairs.added(error, pairs.linear(lax.mul, d, a), pairs.linear(lax.mul, c, b))


@pairs.as_quotient
def _divide(x: pairs.Operand, y: pairs.Operand):
    """x / y. Error <= 5 u (|c / y| + 2 u |a / y|)."""
    (a, c), (b, d) = _limbs(x), _normalised(*_limbs(y))
    q = quotient(a, b)
    p, error = two_product(q, b)
    # A barrier, here and below: of a constant a the compiler would add up the limbs, (c1 - e) + c2 = (c1 + c2) - e.
    rest = pairs.added(barrier((a - p) - error), c, pairs.linear(lax.mul, d, -q))
    return q, _finite(quotient(rest, b))


_OF_LIMBS = {operator.add: _add, operator.mul: _multiply, operator.truediv: _divide}


@pairs.as_root
def _square_root(x: pairs.Operand):
    """sqrt(x). Error <= 5 u^2 sqrt(x)."""
    a, c = _normalised(*_limbs(x))
    r = root(a)
    p, error = two_product(r, r)
    return r, _finite(quotient(pairs.added(barrier((a - p) - error), c), r + r))


@pairs.as_sum
def _rounded(x: pairs.Pair, zero: Array):
    """(value + correction as one limb, zero); the value where there is no correction, so that a zero keeps its sign."""
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


def _limbs(x: pairs.Operand):
    return x if isinstance(x, tuple) else (x, None)


def _finite(correction: Array):
    return lax.select(pairs.is_finite(correction), correction, lax.full_like(correction, 0))
