"""The interface of accumulators: what a sum of products becomes on the way to its result; and `WIDE`, the simplest.

A sum has a state, a tree of arrays of float64: the rounded sum, and what is known of its errors.
"""

import dataclasses
import functools
import operator
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.numerics.errorfree.barrier import widened

State = Any
Terms = Sequence[tuple[int, Sequence[jax.Array]]]  # (1 or -1, factors) of each
Limbs = Sequence[jax.Array]


class OverBatch(NamedTuple):
    """Items of a batch that are to be summed: their states, each as many limbs, and what is done with them."""

    limbs: Limbs
    merge: Callable[[Limbs, Limbs], Limbs]  # of the sum of two
    round: Callable[[Limbs, DTypeLike], jax.Array]
    pair: Callable[[Limbs, DTypeLike], tuple[jax.Array, jax.Array]]  # the low limb anything beside an infinity


def with_zeros(states: Sequence[State]) -> list[State]:
    """The states with zero in place of None."""
    like = next(state for state in states if state is not None)
    zeros = jax.tree.map(functools.partial(lax.full_like, fill_value=0), like)
    return [zeros if state is None else state for state in states]


def multiplied(state: State, share: float) -> State:
    """The state of the sum times a power of two."""
    return jax.tree.map(lambda x: x * lax.full_like(x, share), state)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Trial:
    """How sums of single items are taken and rounded to one limb; NaN may say that it takes more than that."""

    state_of: Callable[[Terms], State]  # the state of the sum of terms
    plus: Callable[[State, int, jax.Array], State]  # with one more term, which may be a constant
    round: Callable[[State, DTypeLike], jax.Array]
    padded: Callable[[Sequence[State]], list[State]] = with_zeros
    times_power_of_two: Callable[[State, float], State] = multiplied


@dataclasses.dataclass(frozen=True, kw_only=True)
class Accumulator(Trial):
    """How sums are taken, over a batch too, and rounded: to one limb, or to the (hi, lo) of a double word."""

    pair: Callable[[State, DTypeLike], tuple[jax.Array, jax.Array]]
    over_batch: Callable[[State, Sequence[int]], OverBatch]  # along axes of the batch


# -- the simplest one: WIDE --------------------------------------------------------------------------------------------
# Sums of products of narrow formats, in float64: products of two are exact, and nothing over- or underflows. The state
# of a sum is one array.


def _state_of(terms: Terms) -> Limbs:
    """The sum of terms (sign, factors), factors arrays of float64. Error <= 2^-53 times their number, times mag."""
    products = ((sign, functools.reduce(lax.mul, factors)) for sign, factors in terms)
    return (functools.reduce(operator.add, (p if sign > 0 else -p for sign, p in products)),)


def _plus(state: Limbs, sign: int, x: Array) -> Limbs:
    return (x + state[0] if sign > 0 else state[0] - x,)


def _merge(a: Limbs, b: Limbs) -> Limbs:
    return (a[0] + b[0],)


def _round(state: Limbs, dtype: DTypeLike) -> Array:
    return lax.convert_element_type(state[0], dtype)


def _pair(state: Limbs, dtype: DTypeLike) -> tuple[Array, Array]:
    """(hi, lo) of dtype with the sum of both as near as two of them get."""
    hi = _round(state, dtype)
    return hi, lax.convert_element_type(state[0] - widened(hi, state[0].dtype), dtype)


WIDE = Accumulator(
    state_of=_state_of,
    plus=_plus,
    round=_round,
    pair=_pair,
    over_batch=lambda state, _: OverBatch(state, _merge, _round, _pair),
)
