"""Arithmetic of pairs `(hi, lo)`: a number as the unevaluated sum of two, with twice the bits of one.

What the type `DoubleWord` is made of. The arrays of one call have one shape and one dtype.

The bounds are relative, in terms of u, the unit roundoff of the limbs' dtype (float32: 2^-24, so that u^2 is 4e-15;
float64: 2^-53 and 1e-32). They hold for normalised pairs, hi = fl(hi + lo), which all functions return, while no limb
of an argument is subnormal (XLA CPU takes subnormals for zero) and none exceeds (1 - 2^-12) finfo.max (float64:
(1 - 2^-27) finfo.max), beyond which products and quotients are those of `hi`. Parts of numbers below finfo.tiny are
flushed to zero. This adds up to 10 tiny to the error of a sum, 10 tiny (1 + |x| + |y|) to that of a product x y, and
10 tiny (1 + (1 + |q|) / |d|) to that of a quotient q by d, or of a root with q = d. Numbers below tiny / u^2 (float32:
4e-24, float64: 2e-276, bfloat16: 8e-34, float16: 256!) therefore have fewer bits.

Where the operation on the limbs `hi` alone gives an infinity, a NaN or a zero of either sign, so does `hi`, and `lo`
is 0 (unless the limbs `lo` make of that zero a number).

Results are bitwise the same eager and compiled, in any batch and surrounding; sums and products commute bitwise.

Derivatives are those of the value hi + lo, accurate to a few u: the tangent of a result lies in its `hi` and depends on
the sum of the tangents of an operand's limbs; the rounding residual `lo` of a result has none.

[Joldes, Muller, Popescu 2017, Tight and rigorous error bounds for basic building blocks of double-word arithmetic, ACM
TOMS 44(2): the algorithms named by number] [Muller, Rideau 2022, Formalization of double-word arithmetic, and comments
on the former, ACM TOMS 48(1)] [Lefevre, Louvet, Muller, Picot, Rideau 2023, Accurate calculation of Euclidean norms
using double-word arithmetic, ACM TOMS 49(1)]
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero, zero_from_primal  # pyright: ignore[reportUnknownVariableType]: no stub
from jax.typing import DTypeLike

from jaxspatial.numerics.errorfree.barrier import barrier, product, quotient, root
from jaxspatial.numerics.errorfree.transforms import fast_two_sum, two_product, two_sum
from jaxspatial.numerics.floats import finfo

# -- derivatives: those of the sum hi + lo, accurate to a few u --------------------------------------------------------

Pair = tuple[jax.Array, jax.Array]  # (hi, lo), or (value, correction)
Operand = Pair | jax.Array
Tangent = jax.Array | None  # None where it is known to be zero
TangentRule = Callable[..., Tangent]  # of (result, operands, tangents)


def differentiable(tangent: TangentRule):
    """Decorator of an operation on pairs and limbs, with `tangent(result, operands, tangents)` as its derivative.

    All three are values hi + lo in one limb: hi up to rounding, but with the derivatives of the sum. A tangent known
    to be zero is None: times an infinite derivative it must not become NaN. Called outside of a transformation, an
    operation is one compiled program.
    """

    def decorate(operation: Callable):
        differentiable = jax.custom_jvp(operation)
        call = functools.wraps(operation)(cast(Any, jax.jit(differentiable, inline=True)))

        def jvp(operands: Sequence, tangents: Sequence):
            hi, lo = call(*operands)
            values = [x[0] + x[1] if isinstance(x, tuple) else x for x in operands]
            of_limbs = ([None if isinstance(t, SymbolicZero) else t for t in jax.tree.leaves(x)] for x in tangents)
            d_hi = tangent(hi + lo, values, [added(*x) for x in of_limbs])
            return (hi, lo), (jnp.zeros_like(hi) if d_hi is None else d_hi, zero_from_primal(lo, symbolic_zeros=True))

        differentiable.defjvp(jvp, symbolic_zeros=True)
        return call

    return decorate


def added(*terms: Tangent):
    """The sum of the terms that are there, None if none is."""
    there = [t for t in terms if t is not None]
    return functools.reduce(lax.add, there) if there else None


def linear(operation: Callable, t: Tangent, *others) -> Tangent:
    """operation(t, *others) of a tangent that may be None."""
    return None if t is None else operation(t, *others)


@differentiable
def as_sum(_: jax.Array, operands: Sequence[jax.Array], tangents: Sequence):
    return added(*tangents)


@differentiable
def as_product(_: jax.Array, operands: Sequence, tangents: Sequence):
    (a, b), (da, db) = operands, tangents
    return added(linear(product, da, b), linear(product, db, a))


@differentiable
def as_quotient(result: jax.Array, operands: Sequence, tangents: Sequence):
    """d(a / b) = (da - (a / b) db) / b."""
    (_, b), (da, db) = operands, tangents
    return linear(quotient, added(da, linear(lax.neg, linear(product, db, result))), b)


@differentiable
def as_root(result: jax.Array, _: Sequence[jax.Array], tangents: Sequence):
    """d sqrt(a) = da / (2 sqrt(a)): infinite at 0."""
    return linear(quotient, tangents[0], result + result)


# -- operations on pairs and limbs -------------------------------------------------------------------------------------


def negate(x: Pair):
    """-x, exactly."""
    return -x[0], -x[1]


def absolute(x: Pair):
    """|x|, exactly."""
    return lax.abs(x[0]), lax.select(lax.lt(x[0], lax.full_like(x[0], 0)), -x[1], x[1])


@as_sum
def add(x: Pair, y: Pair):
    """x + y of two pairs. Error <= (3 u^2 + 13 u^3) |x + y|, also where they cancel. 20 flops. [Algorithm 6]"""
    s, s_error = two_sum(x[0], y[0])
    t, t_error = two_sum(x[1], y[1])
    high, low = _normalised(s, s_error + t)
    return _finished(s, high, t_error + low)


@as_sum
def add_limb(x: Pair, b: Array):
    """x + b of a pair and a limb. Error <= 2 u^2 |x + b|. 10 flops. [Algorithm 4]"""
    s, error = two_sum(x[0], b)
    return _finished(s, s, x[1] + error)


def subtract(x: Pair, y: Pair):
    """x - y of two pairs. Error <= (3 u^2 + 13 u^3) |x - y|."""
    return add(x, negate(y))


def subtract_limb(x: Pair, b: Array):
    """x - b of a pair and a limb. Error <= 2 u^2 |x - b|."""
    return add_limb(x, -b)


@as_product
def multiply(x: Pair, y: Pair):
    """x y of two pairs. Error <= 5 u^2 |x y|. 16 flops and 2 splits. [Algorithm 10; 7 u^2 there, 5 u^2 in Muller 2022]

    The products with low limbs are rounded on their own: an fma would not commute.
    """
    p, error = two_product(x[0], y[0])
    return _finished(p, p, error + (product(x[0], y[1]) + product(x[1], y[0])))


@as_product
def multiply_limb(x: Pair, b: Array):
    """x b of a pair and a limb. Error <= (3/2 u^2 + 4 u^3) |x b|. 17 flops and 2 splits. [Algorithm 7]"""
    return _finished(*_times_limb(x, b))


def _times_limb(x: Pair, b: Array):
    """(fl(hi b), high, low), with x b = high + low but for the error of `multiply_limb`. Not yet normalised."""
    p, error = two_product(x[0], b)
    high, low = fast_two_sum(p, product(x[1], b))
    return p, high, low + error


@as_quotient
def divide(x: Pair, y: Pair):
    """x / y of two pairs. Error <= (15 u^2 + 56 u^3) |x / y|. 25 flops and 2 splits. [Algorithm 17]"""
    q = quotient(x[0], y[0])
    _, high, low = _times_limb(y, q)
    high, low = _normalised(high, low)
    # A barrier, here and below: of a constant x the compiler would add up the limbs, (c1 - e) + c2 = (c1 + c2) - e.
    rest = barrier(x[0] - high) + (x[1] - low)
    return _finished(q, q, quotient(rest, y[0]))


@as_quotient
def divide_limb(x: Pair, b: Array):
    """x / b of a pair and a limb. Error <= 3 u^2 |x / b|. 17 flops and 2 splits. [Algorithm 15]"""
    q = quotient(x[0], b)
    p, error = two_product(q, b)
    rest = barrier((x[0] - p) - error) + x[1]
    return _finished(q, q, quotient(rest, b))


@as_root
def square_root(x: Pair):
    """sqrt(x) of a pair. Error <= 25/8 u^2 sqrt(x). 18 flops and 2 splits. [Lefevre 2023, SQRTDWtoDW]

    Without a fused multiply-add: hi - r^2 is a floating-point number, computed as (hi - p) - error without rounding.
    """
    r = root(x[0])
    p, error = two_product(r, r)
    rest = barrier((x[0] - p) - error) + x[1]
    return _finished(r, r, quotient(rest, r + r))


def _normalised(high: Array, low: Array):
    """`fast_two_sum`, with `low` behind a barrier: the compiler would take c1 + (x + c2) for x + (c1 + c2)."""
    return fast_two_sum(high, barrier(low))


def _finished(single: Array, high: Array, low: Array):
    """high + low as a normalised pair; where that is not finite, `single`, the operation on the high limbs, and 0.

    An infinity has no error term (inf - inf is NaN), a zero no sign left after its error was added. *unchecked*
    requirement |high| >= |low| or high == 0.
    """
    high, low = _normalised(high, low)
    finite = is_finite(high)
    # Equal numbers of which only `single` has the right sign, if they are 0.
    hi = lax.select(finite & lax.ne(high, single), high, single)
    return hi, lax.select(finite, low, lax.full_like(low, 0))


def is_finite(x: Array):
    """Neither infinite nor NaN."""
    return lax.le(lax.abs(x), lax.full_like(x, finfo(x.dtype).max))


# -- comparisons: exact on normalised pairs, which represent a number in one way ---------------------------------------


def less_than(x: Pair, y: Pair):
    """x < y: false where either is NaN."""
    return lax.lt(x[0], y[0]) | (lax.eq(x[0], y[0]) & lax.lt(x[1], y[1]))


def less_or_equal(x: Pair, y: Pair):
    """x <= y: false where either is NaN."""
    return lax.lt(x[0], y[0]) | (lax.eq(x[0], y[0]) & lax.le(x[1], y[1]))


def equal(x: Pair, y: Pair):
    """x == y: false where either is NaN."""
    return lax.eq(x[0], y[0]) & lax.eq(x[1], y[1])


# -- conversion --------------------------------------------------------------------------------------------------------


def convert(x: Pair, dtype: DTypeLike):
    """The pair in limbs of another dtype: exact into a wider one, else with an error <= u^2 |x|, u of that dtype."""
    return _conversion(np.dtype(dtype))(x)


@functools.cache
def _conversion(dtype: np.dtype):
    @differentiable(lambda _, __, tangents: linear(lax.convert_element_type, tangents[0], dtype))
    def converted(x: Pair):
        # The narrowest dtype that holds both.
        own = np.dtype(x[0].dtype)
        wide = own if holds(own, dtype) else dtype if holds(dtype, own) else np.dtype(np.float32)
        hi, lo = (lax.convert_element_type(limb, wide) for limb in x)
        s, error = two_sum(hi, lo)
        # Behind a barrier: a compiler may leave out a conversion there and back.
        high = barrier(lax.convert_element_type(s, dtype))
        low = (s - lax.convert_element_type(high, wide)) + error
        return _finished(high, high, lax.convert_element_type(low, dtype))

    return converted


def holds(a: np.dtype, b: np.dtype) -> bool:
    """Whether dtype a holds all numbers of dtype b."""
    wide, narrow = finfo(a), finfo(b)
    return bool(wide.nmant >= narrow.nmant and wide.maxexp >= narrow.maxexp)
