"""Symmetric systems of linear equations over numbers, written out entry by entry: L D L^T, and L^T D L of a tree.

[Golub and Van Loan 2013, 4.1.2] `jaxspatial.engine.matrices` solves dense ones of any size in a loop.
"""

import functools
import math
import operator
from collections.abc import Mapping, Sequence
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


# Of a tree, such as a mass matrix: entry (k, i) is 0 unless unknown i carries k, or k carries i. From the last unknown
# to the first nothing else becomes other than 0. [Featherstone 2008, 6.5]


def tree_factors(lower: Sequence[Mapping[int, Number]], carriers: Sequence[Sequence[int]]) -> list[dict[int, Number]]:
    """The factors of a symmetric matrix L^T D L: L, and 1 / D on its diagonal, NaN where a pivot is not positive.

    carriers: of each unknown those before it that carry it. lower: of each row the entries of its carriers, and its
    own, by their columns.
    """
    rows = [dict(row) for row in lower]
    for k in reversed(range(len(rows))):
        row = rows[k]
        scale = 1 / where(high(row[k]) > 0, row[k], math.nan)
        factors = {i: row[i] * scale for i in carriers[k]}
        for i, factor in factors.items():
            for j in (*carriers[i], i):
                rows[i][j] = rows[i][j] - factor * row[j]
        row |= factors
        row[k] = scale
    return rows


def solve_tree(
    factors: Sequence[Mapping[int, Number]], carriers: Sequence[Sequence[int]], right: Sequence[Number]
) -> list[Number]:
    """x with A x = right, from the factors of A that `tree_factors` returns."""
    x = list(right)
    for k in reversed(range(len(x))):
        for i in carriers[k]:
            x[i] = x[i] - factors[k][i] * x[k]
    for k, row in enumerate(factors):
        x[k] = functools.reduce(operator.sub, (row[i] * x[i] for i in carriers[k]), x[k] * row[k])
    return x
