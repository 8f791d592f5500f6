"""Systems of linear equations in numbers, (n, n, B): in the precision that an algorithm has."""

from typing import Any, cast

import jax
import numpy as np
from jax import lax

from jaxspatial.arithmetic.numbers import Number, as_data, data_of, high, mapped, shape_of, where, with_data
from jaxspatial.dynamics import along


def solved(M: Number, b: Number) -> Number:
    """M^-1 b of a symmetric positive M (n, n, ...), b (n, ...), by eliminating one row after the other, in a loop.

    Where a pivot is not positive nothing resists: its unknown is 0. Error: n u cond(M) times a small number.
    [Golub and Van Loan 2013, 4.1: Gauss and Jordan]
    """
    n, *shape = shape_of(b)
    start = [as_data(M), as_data(b)]

    def eliminated(k: jax.Array, data: list[Any]) -> list[Any]:
        left, right = with_data(start, data)
        row, own = (_row(x, k) for x in (left, right))
        pivot = _row(row, k)
        is_none = high(pivot) <= 0
        scale = where(is_none, 0.0, 1 / where(is_none, 1.0, pivot))
        here = (np.arange(n, dtype=np.int32) == k).reshape((n, *[1] * len(shape)))
        column = _row(left, k, 1)
        factor = where(here, scale * 0.0, column * _lifted(scale))
        rest = left - mapped(lambda w: w[:, None], factor) * _lifted(row)
        right = where(here, where(is_none, 0.0, right), right - factor * _lifted(own))
        return data_of([as_data(rest), as_data(right)])

    found = cast(list[Any], lax.fori_loop(0, n, eliminated, data_of(start)))
    left, right = with_data(start, found)
    diagonal = along.joined([mapped(lambda w, k=k: w[k, k][None], left) for k in range(n)])
    is_none = high(diagonal) <= 0
    return where(is_none, 0.0, right / where(is_none, 1.0, diagonal))


def _row(x: Number, k: Any, axis: int = 0):
    return mapped(lambda w: cast(jax.Array, lax.dynamic_index_in_dim(w, k, axis, keepdims=False)), x)


def _lifted(x: Number):
    return mapped(lambda w: w[None], x)
