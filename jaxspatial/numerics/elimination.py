"""Small symmetric systems of linear equations over numbers, written out entry by entry: L D L^T.

[Golub and Van Loan 2013, 4.1.2] `jaxspatial.engine.matrices` solves those of whole mechanisms in a loop.
"""

import functools
import operator
from collections.abc import Sequence
from typing import NamedTuple

from jaxspatial.numerics.numbers import Mask, Number, Numbers, high, where


class Pivot(NamedTuple):
    """A step of elimination. column: of L, below its one on the diagonal; zero where the pivot is not positive."""

    is_none: Mask
    divisor: Number  # the pivot, 1 where it is not positive
    column: Numbers


def pivots(lower: Sequence[Numbers]) -> list[Pivot]:
    """The factors L D L^T of a symmetric matrix, from the rows of its lower triangle."""
    steps = list[Pivot]()
    while lower:
        (pivot,), *below = lower
        is_none = high(pivot) <= 0
        divisor = where(is_none, 1.0, pivot)
        scale = where(is_none, 0.0, 1 / divisor)
        column = [row[0] * scale for row in below]
        lower = [
            [x - factor * other[0] for x, other in zip(row[1:], below, strict=False)]
            for factor, row in zip(column, below, strict=True)
        ]
        steps.append(Pivot(is_none, divisor, column))
    return steps


def solve(lower: Sequence[Numbers], right: Sequence[Number]) -> Numbers:
    """x with A x = right, from the rows of the lower triangle of A; 0 where a pivot is not positive."""
    steps, x = pivots(lower), list[Number]()
    for is_none, divisor, column in steps:
        first, *right = right
        x.append(where(is_none, 0.0, first / divisor))
        right = [y - factor * first for y, factor in zip(right, column, strict=True)]
    for i in reversed(range(len(x))):
        x[i] = functools.reduce(operator.sub, map(operator.mul, steps[i].column, x[i + 1 :]), x[i])
    return x
