"""The loop over the rows of a bundle, whose step is compiled once, whatever the length of its chains and their number.

What the state has that is known all along a loop stays known: a planar arm has no components out of its plane. Where
one group of chains ends and another begins, states wait in a memory. A bundle of single bodies is its step.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic.numbers import as_data, data_of, flattened, noinline, with_data
from jaxspatial.dynamics import along
from jaxspatial.dynamics.along import PyTreeDef
from jaxspatial.mechanism.topology import Bundle

# Of the numbers of a body and the state of the one before: its result and its state.
Step = Callable[[Any, Any], tuple[Any, Any]]

Join = Callable[[Any, Any], Any]


class Turns(NamedTuple):
    """Where chains of a bundle end and others begin.

    kept: the memory, (rows, B). rows: of bodies that chains meet at; the first is of tips, the second of what nobody
    asks for. at (length,): 1 for rows of the bundle after which there is a turn. put, get (length, width): where the
    chains that end put their states, and those that begin find theirs. joined(kept, put): what is kept then.
    """

    kept: Any
    rows: dict[int, int]
    at: np.ndarray
    put: np.ndarray
    get: np.ndarray
    joined: Join
    is_reverse: bool


def run(step: Step, bundle: Bundle, n: int, numbers: Any, start: Any, turns: Turns) -> tuple[Any, Any, Any]:
    """(the results of step(numbers, state), stacked along the bundle, the last state, the memory).

    numbers: (L, W, B), start: (W, B), with size 1 where one is for all.
    """
    if bundle.length == 1:
        first = along.mapped_tree(lambda word: word[0], numbers)
        result, last = noinline(step)(first, start)
        spread = functools.partial(along.mapped_tree, lambda word: jnp.broadcast_to(word, (bundle.width, n)))
        return along.mapped_tree(lambda word: word[None], result), spread(last), None
    return _loop(step, numbers, start, turns, (bundle.width, n))


def _loop(step: Step, numbers: Any, start: Any, turns: Turns, shape: tuple[int, int]) -> tuple[Any, Any, Any]:
    """A loop over the rows of a bundle. A known number of the state that a step changes is none: tried again, with it
    as data, until nothing changes."""
    given, tree = flattened(start)
    kept = flattened(turns.kept)[0] if turns.rows else given
    is_known = [along.alike([x, k]) for x, k in zip(given, kept, strict=True)]
    while True:
        tried = _Tried(step, tree, numbers, turns, shape, is_known)
        results, last, kept_last = tried.run(given, kept)
        if not any(tried.changed):
            return results, last, kept_last
        is_known = [k and not c for k, c in zip(is_known, tried.changed, strict=True)]


class _Tried:
    """A loop, if of its state what `is_known` stays so. changed: what does not."""

    def __init__(
        self, step: Step, tree: PyTreeDef, numbers: Any, turns: Turns, shape: tuple[int, int], is_known: list[bool]
    ):
        self.step, self.tree, self.turns, self.shape, self.is_known = step, tree, turns, shape, is_known
        self.numbers, self.own_tree = flattened(numbers)
        self.changed = [False] * len(is_known)
        self.given: list[Any] = []
        self.results: tuple[list[Any], PyTreeDef] = [], None

    def run(self, given: list[Any], kept: list[Any]) -> tuple[Any, Any, Any]:
        """(the results, the last state, the memory)."""
        turns, memory = self.turns, (len(self.turns.rows) + 2, self.shape[1])
        self.given = self._spread(given, self.shape)
        start = data_of(self.given), data_of(self._spread(kept, memory)) if turns.rows else None
        rows = [jnp.asarray(x, np.int32) for x in (turns.at, turns.put, turns.get)] if turns.rows else None
        # A pull-back runs steps again: it reads what it would have to keep of them more slowly.
        again = cast(Step, jax.checkpoint(self._row, prevent_cse=False))
        (last, kept_last), stacked = lax.scan(again, start, (data_of(self.numbers), rows), reverse=turns.is_reverse)
        leaves, tree = self.results
        results = jax.tree.unflatten(tree, with_data(leaves, stacked))
        return results, self._state(last), self._state(kept_last) if turns.rows else None

    def _spread(self, leaves: list[Any], shape: tuple[int, int]):
        return [x if k else as_data(along.spread(x, shape)) for x, k in zip(leaves, self.is_known, strict=True)]

    def _state(self, data: Any) -> Any:
        return jax.tree.unflatten(self.tree, with_data(self.given, data))

    def _data(self, new: Any, shape: tuple[int, int]) -> list[Any]:
        """Of a new state what is not known, and a note of what is known no more."""
        new = flattened(new)[0]
        lost = [k and not along.alike([x, y]) for x, y, k in zip(self.given, new, self.is_known, strict=True)]
        self.changed = [a or b for a, b in zip(self.changed, lost, strict=True)]
        return data_of([as_data(along.spread(y, shape)) for y, k in zip(new, self.is_known, strict=True) if not k])

    def _row(self, carry: tuple[Any, Any], given: tuple[Any, Any]) -> tuple[Any, Any]:
        (state, kept), (own, rows) = carry, given
        result, new = self.step(jax.tree.unflatten(self.own_tree, with_data(self.numbers, own)), self._state(state))
        self.results = flattened(result)
        state = self._data(new, self.shape)
        if rows:
            at, put, get = rows
            kept, state = cast(Any, lax.cond(at > 0, self._turn, _unchanged, kept, state, put, get))
        return (state, kept), data_of(self.results[0])

    def _turn(self, kept: Any, state: Any, put: jax.Array, get: jax.Array):
        """(the memory, the state of the chains that begin)."""
        for c in range(self.shape[0]):
            both = (self._state(x) for x in (_chains(kept, put[c]), _chains(state, c)))
            new = self._data(noinline(self.turns.joined)(*both), (1, self.shape[1]))
            kept = jax.tree.map(
                functools.partial(lax.dynamic_update_slice_in_dim, start_index=put[c], axis=0), kept, new
            )
        begin = [_chains(kept, get[c]) for c in range(self.shape[0])]
        return kept, jax.tree.map(along.concatenated, *begin)


def _unchanged(kept: Any, state: Any, *_: Any):
    return kept, state


def _chains(data: Any, k: Any) -> Any:
    """One chain, or one row of the memory."""
    return jax.tree.map(functools.partial(lax.dynamic_slice_in_dim, start_index=k, slice_size=1), data)
