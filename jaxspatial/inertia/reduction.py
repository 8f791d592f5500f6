"""Sums of numbers over an axis of the batch, in one fixed order."""

import functools

import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import folding
from jaxspatial.arithmetic.double_word import DoubleWord
from jaxspatial.arithmetic.numbers import Rounded, noinline_pairs
from jaxspatial.arithmetic.total import total


def summed(numbers, size):
    """The sum of each of a tuple of numbers over the last axis of the batch, which is kept with size 1.

    size: of that axis, at least 1. By halving, always in the same order: error <= ceil(log2 size) u mag, mag = sum of
    |x_i|; of double words 3 ceil(log2 size) u^2 mag. A known 0 stays one.
    """
    if isinstance(numbers[0], DoubleWord):
        return _of_double_words(numbers)
    data = [x.value for x in numbers if not folding.is_known(x.value, 0)]
    sums = iter(_of_rounded(data, size) if data else ())
    return tuple(x if folding.is_known(x.value, 0) else Rounded(x.precision, next(sums)) for x in numbers)


def _of_rounded(values, size):
    """All of them in one array: one chain of additions."""
    shape = np.broadcast_shapes((size,), *(x.shape for x in values))
    sums = total(jnp.stack([jnp.broadcast_to(x, shape) for x in values]))
    return [sums[i, ..., None] for i in range(len(values))]


@noinline_pairs
def _of_double_words(numbers):
    stacked = DoubleWord(*(jnp.stack([getattr(x, word) for x in numbers]) for word in ("hi", "lo")))
    sums = _halved(stacked)
    return tuple(sums[i] for i in range(len(numbers)))


def _halved(x):
    n = x.shape[-1]
    padding = [(0, 0, 0)] * (x.ndim - 1) + [(0, (1 << (n - 1).bit_length()) - n, 0)]
    x = DoubleWord(*(lax.pad(word, np.asarray(0, x.dtype), padding) for word in (x.hi, x.lo)))
    while x.shape[-1] > 1:
        half = x.shape[-1] // 2
        x = x[..., :half] + x[..., half:]
    return x


def first(x):
    """A number that is the same along the last axis of the batch, with that axis of size 1."""
    if isinstance(x, DoubleWord):
        return x[..., :1]
    return x if folding.is_known(x.value) else Rounded(x.precision, x.value[..., :1])


def product(factors):
    """Of numbers, from the left."""
    return functools.reduce(lambda x, y: x * y, factors)
