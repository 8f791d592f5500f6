"""Rows, stacks, concatenations and sums of numbers that are arrays over bodies and states."""

import itertools
import operator
from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.numerics import floats, numbers
from jaxspatial.numerics.numbers import Number, Numbers, is_constant, is_number
from jaxspatial.numerics.sums.pairwise import pairwise

T = TypeVar("T")
Array = jax.Array | np.ndarray
Shape = tuple[int, ...]


def rows(array: Array, places: np.ndarray) -> Array:
    """array[places], for places (L, W, ...) known while tracing; data is sliced, chain by chain."""
    if isinstance(array, np.ndarray):
        return array[places]
    if np.ndim(places) > 1:
        swapped = _sliced(array, np.swapaxes(places, 0, 1))
        return lax.transpose(swapped, (1, 0, *range(2, swapped.ndim)))
    return _sliced(array, places)


def _sliced(array: jax.Array, places: np.ndarray) -> jax.Array:
    flat = np.ravel(places)
    ends = [0, *(np.flatnonzero(np.diff(flat) != 1) + 1).tolist(), flat.size]
    runs = [(flat[a], flat[a] + b - a) for a, b in itertools.pairwise(ends) if b > a]
    pieces = [lax.slice_in_dim(array, first, last) for first, last in runs]
    taken = pieces[0] if len(pieces) == 1 else jnp.concatenate(pieces) if pieces else array[:0]
    shape = *np.shape(places), *array.shape[1:]
    return taken if taken.shape == shape else taken.reshape(shape)


def mapped(function: Callable, tree: T) -> T:
    """Applies a function to the arrays in a tree of numbers; known numbers pass unchanged."""
    return jax.tree.map(lambda x: function(x) if isinstance(x, jax.Array) else x, tree)


def spread(x: Number, shape: Shape) -> Number:
    """A number broadcast to an array of this shape, also if it is known."""
    if is_constant(x):
        return x.with_limbs(jnp.full(shape, word) for word in x.limbs)
    return numbers.mapped(lambda word: jnp.broadcast_to(word, shape), x)


def all_equal(values: Sequence) -> bool:
    """Whether all numbers are known, and equal."""
    return all(map(is_constant, values)) and len({tuple(map(float, x.limbs)) for x in values}) == 1


def stacked(parts: Numbers, shape: Shape, axis: int) -> Number:
    """Broadcasts numbers to the shape, and stacks them along a new axis."""
    return numbers.mapped(lambda *words: jnp.stack(words, axis), *(spread(x, shape) for x in parts))


def stacked_trees(trees: Sequence[T]) -> T:
    """Stacks k trees of numbers to one of numbers (k, ...). Known equal numbers stay known, a single tree unchanged."""
    if len(trees) == 1:
        return trees[0]
    return _leafwise(trees, lambda x: stacked(x, floats.broadcast_shapes((1, 1, 1), *map(numbers.shape_of, x)), 0))


def concatenated(parts: Numbers) -> Number:
    """Concatenates numbers along their first axis."""
    return parts[0] if len(parts) == 1 else numbers.mapped(lambda *words: jnp.concatenate(words), *parts)


def concatenated_trees(trees: Sequence[T], n: int, counts: Sequence[int] | None = None) -> T:
    """Concatenates trees of numbers (k, B) to one of numbers (sum of k, B). Known equal numbers stay known.

    counts: the k of each tree, 1 for None. A tree has one row where all its rows are the same.
    """
    k = counts or [1] * len(trees)
    return _leafwise(trees, lambda xs: concatenated([spread(x, (i, n)) for x, i in zip(xs, k, strict=True)]))


def _leafwise(trees: Sequence, combine: Callable[[Numbers], Number]):
    return jax.tree.map(lambda *xs: xs[0] if all_equal(xs) else combine(xs), *trees, is_leaf=is_number)


def pairwise_sum(x: Number) -> Number:
    """The sum over the first axis, each of the first half added to one of the second."""

    def halves(x: Number) -> list[Number]:
        n = numbers.shape_of(x)[0]
        ends = [0, n // 2, n // 2 * 2, n] if n > 1 else []
        runs = [(a, b) for a, b in itertools.pairwise(ends) if b > a]
        return [numbers.mapped(lambda w, a=a, b=b: lax.slice_in_dim(w, a, b), x) for a, b in runs]

    return numbers.mapped(lambda word: word[0], pairwise(operator.add, x, halves, concatenated))
