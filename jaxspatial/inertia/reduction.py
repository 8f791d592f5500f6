"""Sums of numbers over an axis of the batch, in one fixed order."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.numbers import Number, Numbers, Rounded, folding, noinline_pairs
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.layout import apart
from jaxspatial.arithmetic.sums.pairwise import by_halving, pairwise_sum


def summed(numbers: Numbers, size: int) -> Numbers:
    """The sum of each of a tuple of numbers over the last axis of the batch, which is kept with size 1.

    size: of that axis, at least 1. By halving, always in the same order: error <= ceil(log2 size) u mag, mag = sum of
    |x_i|; of double words 3 ceil(log2 size) u^2 mag. A known 0 stays one.
    """
    rounded = [x for x in numbers if isinstance(x, Rounded)]
    if not rounded:
        return _of_double_words(numbers)
    data = [x.value for x in rounded if not folding.is_known(x.value, 0)]
    sums = iter(_of_rounded(data, size) if data else ())
    return tuple(x if folding.is_known(x.value, 0) else Rounded(x.precision, next(sums)) for x in rounded)


def _of_rounded(values: Sequence[jax.Array], size: int) -> list[jax.Array]:
    """All of them in one array: one chain of additions."""
    shape = np.broadcast_shapes((size,), *(x.shape for x in values))
    sums = pairwise_sum(jnp.stack([jnp.broadcast_to(x, shape) for x in values]))
    return [x[..., None] for x in apart(jnp.moveaxis(sums, 0, -1))]


@noinline_pairs
def _of_double_words(numbers: Numbers) -> Numbers:
    words = [jnp.stack([getattr(x, word) for x in numbers]) for word in ("hi", "lo")]
    sums = DoubleWord(*by_halving(_added, words, words[0].ndim - 1))
    return tuple(sums[i] for i in range(len(numbers)))


def _added(a: Any, b: Any) -> tuple[jax.Array, ...]:
    return tuple(jax.tree.leaves(DoubleWord(*a) + DoubleWord(*b)))


def first(x: Number) -> Number:
    """A number that is the same along the last axis of the batch, with that axis of size 1."""
    if isinstance(x, DoubleWord):
        return x[..., :1]
    return Rounded(x.precision, x.value[..., :1]) if isinstance(x, Rounded) and not folding.is_known(x.value) else x
