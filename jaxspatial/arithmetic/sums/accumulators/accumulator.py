"""The form of an accumulator: what a sum of products becomes on the way to its result. Each file here fills it in.

A sum has a state, a tree of arrays of float64: the rounded sum, and what is known of its errors.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
from jax import lax
from jax.typing import DTypeLike

State = Any
Terms = Sequence[tuple[int, Sequence[jax.Array]]]  # (1 or -1, factors) of each
Words = Sequence[jax.Array]


class OverBatch(NamedTuple):
    """Items of a batch that are to be summed: their states, each as many words, and what is done with them."""

    words: Words
    merge: Callable[[Words, Words], Words]  # of the sum of two
    round: Callable[[Words, DTypeLike], jax.Array]
    pair: Callable[[Words, DTypeLike], tuple[jax.Array, jax.Array]]  # the low word anything beside an infinity


def with_zeros(states: Sequence[State]) -> list[State]:
    """The states with zero in place of None."""
    like = next(state for state in states if state is not None)
    zeros = jax.tree.map(functools.partial(lax.full_like, fill_value=0), like)
    return [zeros if state is None else state for state in states]


def multiplied(state: State, share: float) -> State:
    """The state of the sum times a power of two."""

    def times(x: jax.Array) -> jax.Array:
        return x * lax.full_like(x, share)

    return jax.tree.map(times, state)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """How sums of single items are taken and rounded to one word; NaN may say that it takes more than that."""

    total: Callable[[Terms], State]  # the state of the sum of terms
    plus: Callable[[State, int, jax.Array], State]  # with one more term, which may be a constant
    round: Callable[[State, DTypeLike], jax.Array]
    padded: Callable[[Sequence[State]], list[State]] = with_zeros
    times_power_of_two: Callable[[State, float], State] = multiplied


@dataclasses.dataclass(frozen=True, kw_only=True)
class Accumulator(Trial):
    """How sums are taken, over a batch too, and rounded: to one word, or to the (hi, lo) of a double word."""

    pair: Callable[[State, DTypeLike], tuple[jax.Array, jax.Array]]
    over_batch: Callable[[State, Sequence[int]], OverBatch]  # along axes of the batch
