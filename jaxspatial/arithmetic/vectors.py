"""Vectors as tuples of numbers, and matrices by their rows, whatever kind of numbers: see `numbers`."""

import functools
import math
import operator
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.errorfree import scaling
from jaxspatial.arithmetic.numbers import Number, Numbers, Rounded, Rows, Three, folding, is_constant
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.number import constant, each, frozen, high, noinline_pairs, times_power_of_two, where
from jaxspatial.arithmetic.numbers.stacking import Stacked, Summed


def recursive_sum(numbers: Iterable[Number]) -> Number:
    """Their sum, from the left. [Higham 2002, 4.1: recursive summation]"""
    return functools.reduce(operator.add, numbers)


def dot(a: Numbers, b: Numbers) -> Number:
    return recursive_sum(each(operator.mul, a, b))


def dots(pairs: Sequence[tuple[Numbers, Numbers]]) -> list[Number]:
    """The dot products of pairs of vectors of one length."""
    n = len(pairs[0][0])
    products = each(operator.mul, *([x for pair in pairs for x in pair[side]] for side in (0, 1)))
    return functools.reduce(functools.partial(each, operator.add), [products[i::n] for i in range(n)])


def square(v: Three) -> tuple[Number, Number | None]:
    """|v|^2 as (rounded, what rounding left), for |v| <= 64; beyond as `dot` has it. With two words (dot(v, v), None).

    Each component is split on a grid, so coarse that squares of its points add up without rounding.
    """
    if not isinstance(v[0], Rounded):
        return dot(v, v), None
    bits = check.finfo(v[0].dtype).nmant + 1
    shift = constant(v[0], 1.5 * 2 ** (bits - 1 - (bits - 12) // 2))
    grid = tuple((x + shift) - shift for x in v)
    coarse = dot(grid, grid)
    fine = recursive_sum([(x + y) * (x - y) for x, y in zip(v, grid, strict=True)])
    rounded = coarse + fine
    return rounded, frozen(fine - (rounded - coarse))


def cross(a: Three, b: Three) -> Three:
    products = each(operator.mul, _at(a, 1, 2, 0, 2, 0, 1), _at(b, 2, 0, 1, 1, 2, 0))
    return tuple(each(operator.sub, products[:3], products[3:]))


def _at(v: Numbers, *indices: int) -> Numbers:
    return [v[i] for i in indices]


def plus(*vectors: Numbers) -> Numbers:
    """Their sum, from the left. Of an array and a vector one array, in the layout of that."""
    return functools.reduce(_plus, vectors)


def _plus(a: Numbers, b: Numbers) -> Numbers:
    return a.combined(folding.add, b) if isinstance(a, Stacked) else tuple(each(operator.add, a, b))


def minus(a: Numbers, b: Numbers) -> Numbers:
    return a.combined(folding.subtract, b) if isinstance(a, Stacked) else tuple(each(operator.sub, a, b))


def negative(v: Numbers) -> Numbers:
    return tuple(-x for x in v)


def laid_out_as(x: Numbers, v: Numbers) -> Numbers:
    """v, to be a result in the layout of the array that x is: for what no addition ties to one, see `plus`."""
    return x.laid_out(v) if isinstance(x, Stacked) else tuple(v)


def summed(v: Numbers) -> Summed:
    """The sum of v over the last axis of the batch, by halving: what a formula may return, but not go on with."""
    return Summed(v)


def times(s: Number | float, v: Numbers) -> Numbers:
    return tuple(each(operator.mul, [s] * len(v), v))


def componentwise_product(a: Numbers, b: Numbers) -> Numbers:
    """Component by component."""
    return tuple(each(operator.mul, a, b))


def matrix_times(m: Rows, v: Numbers) -> Numbers:
    """Of a matrix by its rows."""
    return tuple(dots([(row, v) for row in m]))


def transpose(m: Rows) -> Rows:
    return tuple(zip(*m, strict=True))


def matrix_product(m: Rows, n: Rows) -> Rows:
    """Of two matrices by their rows."""
    return rows(tuple(dots([(row, column) for row in m for column in transpose(n)])), len(n[0]))


def flat(m: Rows) -> Numbers:
    return tuple(x for row in m for x in row)


def rows(entries: Numbers, n: int = 3) -> Rows:
    return tuple(entries[i : i + n] for i in range(0, len(entries), n))


def scaled(v: Numbers) -> tuple[Numbers, Any]:
    """(v 2^-e, e) with the largest component between 1/2 and 1: squares neither over- nor underflow."""
    e = _exponent([high(x) for x in v])
    return tuple(times_power_of_two(x, -e) for x in v), e


def _scaled_once(v: Numbers) -> Numbers:
    """v times a power of two, as `scaled` for who does not need to know it."""
    if isinstance(v[0], DoubleWord) or all(map(is_constant, v)):
        return scaled(v)[0]
    s = scaling.reciprocal([high(x) for x in v])
    return tuple(x.with_words(w if folding.is_known(w, 0) else w * s for w in x.words) for x in v)


def _exponent(values: Sequence[Any]) -> Any:
    if not all(map(folding.is_known, values)):
        return scaling.exponent(values)
    largest = float(max(abs(x) for x in values))
    return np.int32(math.frexp(largest)[1] if math.isfinite(largest) else 0)


@noinline_pairs
def unit(v: Numbers) -> Numbers:
    """v / |v|, of any finite length but 0: NaN there, and where a component is infinite or NaN."""
    v = _scaled_once(v)
    length = dot(v, v).sqrt()
    length = where(high(length) < math.inf, length, math.nan)
    return tuple(each(check.truediv, v, [length] * len(v)))


@noinline_pairs
def norm(v: Numbers) -> Number:
    """|v|, without over- or underflow on the way. At 0 derivatives are 0: the subgradient of least norm."""
    v, e = scaled(v)
    squared = dot(v, v)
    is_zero = high(squared) == 0
    length = where(is_zero, 0.0, where(is_zero, 1.0, squared).sqrt())
    return times_power_of_two(length, e)
