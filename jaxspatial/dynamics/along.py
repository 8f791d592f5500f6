"""Numbers that are arrays over bodies and states: rows taken, put side by side, added up."""

import functools
import itertools
import operator
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import numbers
from jaxspatial.arithmetic.numbers import Number, Numbers, is_constant, is_number, where
from jaxspatial.arithmetic.numbers.number import PyTreeDef as PyTreeDef
from jaxspatial.arithmetic.sums.pairwise import pairwise

T = TypeVar("T")
Array = jax.Array | np.ndarray
Maybe = Array | None
Shape = tuple[int, ...]
OfWord = Callable[[Any], Any]


def rows(array: Array, places: np.ndarray) -> Array:
    """array[places] along its first axis, for known places (L, W, ...): by slices, where it is data, chain by chain."""
    if isinstance(array, np.ndarray):
        return array[places]
    if np.ndim(places) > 1:
        return jnp.swapaxes(_sliced(array, np.swapaxes(places, 0, 1)), 0, 1)
    return _sliced(array, places)


def _sliced(array: jax.Array, places: np.ndarray):
    flat = np.ravel(places)
    ends = [0, *(np.flatnonzero(np.diff(flat) != 1) + 1).tolist(), flat.size]
    pieces = [array[flat[a] : flat[a] + b - a] for a, b in zip(ends[:-1], ends[1:], strict=True) if b > a]
    taken = pieces[0] if len(pieces) == 1 else jnp.concatenate(pieces) if pieces else array[:0]
    return taken.reshape((*np.shape(places), *array.shape[1:]))


def mapped(function: OfWord, x: Number) -> Number:
    """A function of arrays applied to a number word by word; to what is known, not at all."""
    return numbers.mapped(function, x) if is_number(x) and not is_constant(x) else x


def mapped_tree(function: OfWord, tree: T) -> T:
    return jax.tree.map(functools.partial(mapped, function), tree, is_leaf=is_number)


def tuple_of(*forms: PyTreeDef) -> PyTreeDef:
    return cast(PyTreeDef, jax.tree_util.treedef_tuple(forms))


def spread(x: Number, shape: Shape) -> Number:
    """A number as an array of this shape."""
    if is_constant(x):
        return x.with_words(jnp.full(shape, word) for word in x.words)
    return numbers.mapped(lambda word: jnp.broadcast_to(word, shape), x)


def stacked(parts: Numbers, shape: Shape, axis: int):
    """Numbers one beside the other along a new axis, each over the shape."""

    def side_by_side(*words: jax.Array):
        return jnp.stack(words, axis)

    return numbers.mapped(side_by_side, *(spread(x, shape) for x in parts))


def abreast(trees: Sequence[Any]) -> Any:
    """Trees of numbers as one of numbers (k, ...): what is known and alike stays so. A single one as it is."""
    return trees[0] if len(trees) == 1 else _each(trees, lambda xs: stacked(xs, _common_shape(xs), 0))


def _each(trees: Sequence[Any], combined: Callable[[Numbers], Number]) -> Any:
    """The leaves of trees combined, but for what is known and alike."""
    leaves, forms = zip(*map(numbers.flattened, trees), strict=True)
    found = [xs[0] if alike(xs) else combined(xs) for xs in zip(*leaves, strict=True)]
    return jax.tree.unflatten(forms[0], found)


def _common_shape(xs: Numbers):
    return np.broadcast_shapes((1, 1, 1), *(numbers.shape_of(x) for x in xs))


def joined(parts: Numbers):
    """Numbers one behind the other along their first axis."""
    return parts[0] if len(parts) == 1 else numbers.mapped(concatenated, *parts)


def concatenated(*words: jax.Array):
    return jnp.concatenate(words)


def split(function: Callable[[Number], Numbers], parts: Numbers) -> list[Numbers]:
    """function(x), a tuple of numbers, of each of the numbers: in one call for all."""
    shapes = [numbers.shape_of(x) for x in parts]
    size = max(shape[-1] for shape in shapes)
    flat = [
        numbers.mapped(lambda w, s=s: jnp.broadcast_to(w, (*s[:-1], size)).reshape((-1, size)), x)
        for x, s in zip(parts, shapes, strict=True)
    ]
    found = function(joined(flat))
    ends = np.cumsum([int(np.prod(s[:-1])) for s in shapes])
    return [
        tuple(mapped(lambda w, s=s, e=e: w[e - int(np.prod(s[:-1])) : e].reshape((*s[:-1], size)), x) for x in found)
        for s, e in zip(shapes, ends, strict=True)
    ]


def alike(values: Sequence[Any]):
    """Whether all are known, and the same number."""
    return all(map(is_constant, values)) and len({tuple(map(float, x.words)) for x in values}) == 1


def concatenated_trees(trees: Sequence[Any], n: int) -> Any:
    """Trees of numbers (1, B) as one of numbers (many, B); known where they are known and alike."""
    return _each(trees, lambda xs: joined([spread(x, (1, n)) for x in xs]))


def added_at(x: Number, place: int, y: Number):
    """x with y added to one of its rows."""
    shape = numbers.shape_of(x)
    here = jnp.asarray(np.arange(shape[0]) == place).reshape((-1, *[1] * (len(shape) - 1)))
    return where(jnp.broadcast_to(here, shape), x + spread(y, shape), x)


def pairwise_sum(x: Number):
    """The sum over the first axis, each of the first half added to one of the second."""

    def halves(x: Number) -> list[Number]:
        n = numbers.shape_of(x)[0]
        ends = [0, n // 2, n // 2 * 2, n] if n > 1 else []
        return [_slice(x, a, b) for a, b in itertools.pairwise(ends) if b > a]

    return numbers.mapped(lambda word: word[0], pairwise(operator.add, x, halves, joined))


def _slice(x: Number, start: int, stop: int):
    return numbers.mapped(lambda word: word[start:stop], x)
