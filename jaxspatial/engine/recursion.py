"""Recursions over the tree, outward from the base and inward from the tips: a step for one body, looped over a bundle.

A bundle consists of chains of joints of one kind; groups of equal chains follow each other in its rows (`Bundle`). Its
step is compiled once, whatever the length and number of the chains. Numbers of a message that are known all along a
loop stay known: a planar arm has no components out of its plane. What a body passes on, outward to its children or
inward to its parent, is a message: numbers such as its velocity, or the force on it. Where one group ends and the next
begins, a memory holds the messages of the bodies where chains meet. A bundle of single bodies needs no loop.
"""

import collections
import functools
import itertools
import operator
from collections.abc import Callable, Sequence
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.engine import stacking
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism.topology import Bundle
from jaxspatial.numerics.numbers import (
    as_data,
    data_of,
    is_number,
    with_data,
    without_data,
)

T = TypeVar("T")
# Trees of numbers: those of a body, the message that bodies pass on, the result for a body.
B = TypeVar("B")
M = TypeVar("M")
R = TypeVar("R")
Step = Callable[[B, M], tuple[R, M]]
Join = Callable[[M, M], M]


def outward(state: MechanismState, step: Step[B, M, R], root: M, numbers: Sequence[B]) -> list[R]:
    """Computes body after body from the base to the tips: the results for every bundle.

    step(numbers of a body, message of its parent) -> (its result, its message). root: the message of the world.
    """
    results, ends = list[R](), {-1: stacking.mapped(lambda word: word.reshape((1, -1)), root)}
    for bundle, of_bundle in zip(state.bundles, numbers, strict=True):
        first = bundle.groups[0]
        start = [ends[i] for i in bundle.by_column(first, first.parents)]
        boundaries = _boundaries(state, bundle, ends.get, start[0], lambda _, new: new, is_reverse=False)
        result, last, memory = _run(step, bundle, state.n, of_bundle, _side_by_side(start, state.n), boundaries)
        ends |= {i: _chain(memory, k) for i, k in boundaries.rows.items() if i not in ends}
        ends |= {i: _chain(last, c) for c, i in enumerate(bundle.groups[-1].ends)}
        results.append(result)
    return results


def inward(
    state: MechanismState, step: Step[B, M, R], at_tips: M, numbers: Sequence[B], join: Join[M] | None = None
) -> list[R]:
    """Computes body after body from the tips to the base: the results for every bundle.

    step(numbers of a body, joined messages of its children) -> (its result, its message). at_tips: the message that
    bodies without children receive. join: combines the messages of two children; by default their sum.
    """
    of_children, results = collections.defaultdict[int, list[M]](list), list[R]()
    join = join or (lambda a, b: jax.tree.map(operator.add, a, b, is_leaf=is_number))

    def from_children(i: int, default: M) -> M:
        messages = of_children.pop(i, [default])
        return messages[0] if len(messages) == 1 else functools.reduce(join, messages)

    for bundle, of_bundle in zip(reversed(state.bundles), reversed(numbers), strict=True):
        first, last = bundle.groups[0], bundle.groups[-1]
        start = [from_children(i, at_tips) for i in last.ends]
        boundaries = _boundaries(state, bundle, from_children, at_tips, join, is_reverse=True)
        start = _side_by_side(bundle.by_column(last, start), state.n)
        result, passed, memory = _run(step, bundle, state.n, of_bundle, start, boundaries)
        ends = {i for group in bundle.groups for i in group.ends}
        for i, k in boundaries.rows.items():
            if i not in ends:
                of_children[i].append(_chain(memory, k))
        for c, parent in enumerate(first.parents):
            if parent >= 0:
                of_children[parent].append(_chain(passed, c))
        results.append(result)
    return results[::-1]


def _chain(tree: T, c: int) -> T:
    """The numbers (1, B) of one chain, or of one row of a memory."""
    return stacking.mapped(lambda word: lax.slice_in_dim(word, c, c + 1), tree)


def _side_by_side(trees: Sequence[T], n: int) -> T:
    """The messages of several chains as one tree (W, B), or as the single one that all share."""
    same = all(tree is trees[0] for tree in trees)
    return trees[0] if same else stacking.concatenated_trees(trees, n)


# -- boundaries between groups ----------------------------------------------------------------------------------------


class Boundaries(NamedTuple, Generic[M]):
    """Where groups of a bundle end and others begin.

    Chains that end write their messages to a memory, and chains that begin read theirs from it.

    memory: (rows, B), one message for each body where chains meet. Row 0 has that of tips, row 1 is scratch. Nothing
        reads it if there are none.
    rows: the row of each of these bodies.
    at: (length,), 1 at rows of the bundle which a boundary follows.
    put: (length, width), the row of the memory that each chain writes at such a boundary.
    get: (length, width), the row that the next chain of the column reads.
    join: a function of (old, new), which combines the messages that are written to one row.
    is_reverse: whether the loop goes from the last row to the first.
    """

    memory: M
    rows: dict[int, int]
    at: np.ndarray
    put: np.ndarray
    get: np.ndarray
    join: Join[M]
    is_reverse: bool


def _boundaries(
    state: MechanismState,
    bundle: Bundle,
    message_of: Callable[[int, M], M],
    default: M,
    join: Join[M],
    is_reverse: bool,
) -> Boundaries[M]:
    """The Boundaries of a loop outward, or in reverse. message_of(i, default): that of a body where groups may
    meet."""
    meet = [i for g in bundle.groups[1:] for i in g.parents]
    meet += [i for g in bundle.groups[:-1] for i in g.ends if state.topology.children[i]]
    rows = {i: k + 2 for k, i in enumerate(dict.fromkeys(meet))}
    memory = _side_by_side([default, default, *(message_of(i, default) for i in rows)], state.n) if rows else default
    at, put, get = (np.zeros(shape, int) for shape in ((bundle.length,), *[bundle.bodies.shape] * 2))
    first = 0
    for a, b in itertools.pairwise(bundle.groups):
        first += a.length
        # The last row of a group, the bodies whose rows its chains write, and those that the next chains read.
        if is_reverse:
            row, end, begin = first, b.parents, bundle.by_column(a, a.ends)
        else:
            row, end, begin = first - 1, a.ends, bundle.by_column(b, b.parents)
        padding = [1] * (bundle.width - len(end))
        at[row], put[row] = 1, [rows.get(i, 1) for i in end] + padding
        get[row] = [rows.get(i, 0) for i in begin]
    return Boundaries(memory, rows, at, put, get, join, is_reverse)


# -- the loop ---------------------------------------------------------------------------------------------------------


def _run(
    step: Step[B, M, R], bundle: Bundle, n: int, numbers: B, start: M, boundaries: Boundaries[M]
) -> tuple[R, M, M]:
    """Runs a bundle: (the results stacked along it, the last message, the memory).

    numbers: (L, W, B), start: (W, B), of size 1 along axes where one serves all.
    """
    if bundle.length > 1:
        return _loop(step, numbers, start, boundaries, (bundle.width, n))
    of_one = stacking.mapped(lambda word: lax.squeeze(word, (0,)), numbers)
    result, last = step(of_one, start)
    last = stacking.mapped(lambda word: jnp.broadcast_to(word, (bundle.width, n)), last)
    return stacking.mapped(lambda word: lax.expand_dims(word, (0,)), result), last, boundaries.memory


def _loop(
    step: Step[B, M, R], numbers: B, start: M, boundaries: Boundaries[M], shape: tuple[int, int]
) -> tuple[R, M, M]:
    """Loops over the rows of a bundle.

    A known number of the message stays known unless a step changes it. The loop is then traced again with this number
    as data, until no known number changes.
    """
    message, structure = jax.tree.flatten(start, is_leaf=is_number)
    memory = jax.tree.leaves(boundaries.memory, is_leaf=is_number) if boundaries.rows else message
    is_known = [stacking.all_equal([x, k]) for x, k in zip(message, memory, strict=True)]
    while True:
        trial = _Loop(step, structure, numbers, boundaries, shape, is_known)
        results, last, last_memory = trial.run(message, memory)
        if not any(trial.changed):
            return results, last, last_memory
        is_known = [k and not c for k, c in zip(is_known, trial.changed, strict=True)]


class _Loop(Generic[B, M, R]):
    """One trace of a loop. is_known: the numbers of the message to keep known; changed: those that a step changed."""

    def __init__(
        self,
        step: Step[B, M, R],
        structure,
        numbers: B,
        boundaries: Boundaries[M],
        shape: tuple[int, int],
        is_known: list[bool],
    ):
        self.step, self.structure, self.numbers = step, structure, numbers
        self.boundaries, self.shape, self.is_known = boundaries, shape, is_known
        self.changed = [False] * len(is_known)
        self.message: list[Any] = []
        self.result = None

    def run(self, message: list, memory: list) -> tuple[Any, Any, Any]:
        """(the results, the last message, the memory)."""
        boundaries, n_rows = self.boundaries, len(self.boundaries.rows)
        self.message = self._spread(message, self.shape)
        start = data_of(self.message), data_of(self._spread(memory, (n_rows + 2, self.shape[1]))) if n_rows else None
        rows = (boundaries.at, boundaries.put, boundaries.get)
        # Unsigned, no index is asked whether it counts from the end.
        inputs = data_of(self.numbers), [jnp.asarray(x, np.uint32) for x in rows] if n_rows else None
        # A pull-back recomputes the steps, which is faster than reading stored intermediates.
        again = jax.checkpoint(self._row, prevent_cse=False)
        (last, last_memory), stacked = lax.scan(again, start, inputs, reverse=boundaries.is_reverse)
        results = with_data(self.result, stacked)
        return results, self._with_data(last), self._with_data(last_memory) if n_rows else boundaries.memory

    def _spread(self, message: list, shape: tuple[int, int]) -> list:
        """Numbers of the message over all chains."""
        both = zip(message, self.is_known, strict=True)
        return [x if known else as_data(stacking.spread(x, shape)) for x, known in both]

    def _with_data(self, data):
        return jax.tree.unflatten(self.structure, with_data(self.message, data))

    def _data(self, message: M, shape: tuple[int, int]) -> list:
        """The data of a new message; records in `changed` which known numbers differ."""
        new = jax.tree.leaves(message, is_leaf=is_number)
        for i, (x, y, k) in enumerate(zip(self.message, new, self.is_known, strict=True)):
            self.changed[i] |= k and not stacking.all_equal([x, y])
        return data_of([as_data(stacking.spread(y, shape)) for y, k in zip(new, self.is_known, strict=True) if not k])

    def _row(self, carry: tuple[Any, Any], inputs: tuple[Any, Any]) -> tuple[Any, Any]:
        (message, memory), (data, rows) = carry, inputs
        result, new = self.step(with_data(self.numbers, data), self._with_data(message))
        self.result = without_data(result)
        message = self._data(new, self.shape)
        if rows:
            at, put, get = rows
            memory, message = lax.cond(at > 0, self._cross, lambda *x: x[:2], memory, message, put, get)
        return (message, memory), data_of(result)

    def _cross(self, memory: list, message: list, put: jax.Array, get: jax.Array) -> tuple[Any, Any]:
        """(the memory, the message of the chains that begin), at a boundary."""
        for c in range(self.shape[0]):
            both = (self._with_data(x) for x in (_row_of(memory, put[c]), _row_of(message, c)))
            new = self._data(self.boundaries.join(*both), (1, self.shape[1]))
            update = functools.partial(lax.dynamic_update_slice_in_dim, start_index=put[c], axis=0)
            memory = jax.tree.map(update, memory, new)
        begin = [_row_of(memory, get[c]) for c in range(self.shape[0])]
        return memory, jax.tree.map(lambda *words: jnp.concatenate(words), *begin)


def _row_of(data, k):
    """Row k of data (rows, B)."""
    return jax.tree.map(functools.partial(lax.dynamic_slice_in_dim, start_index=k, slice_size=1), data)
