"""Sums of products to within one unit in the last place, however much cancels: no error is dropped before the end.

The state of a sum is an expansion: numbers in increasing order that do not overlap and add up to it exactly.
[Shewchuk 1997, Adaptive Precision Floating-Point Arithmetic, theorem 10]

Products that would overflow are computed once more, scaled down together with all other terms, and those are taken
where the overflowing ones do not cancel to exactly zero: a sum of them that is not zero is at least 2^894, next to
which what the scaling loses of the other terms is nothing. Of a sum over many items all are scaled where one is: its
error bound, too, is in units of its largest terms.
"""

import dataclasses
import functools
import operator
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.numerics.errorfree.barrier import opaque
from jaxspatial.numerics.errorfree.transforms import fast_two_sum, two_difference, two_sum, unguarded
from jaxspatial.numerics.sums import certified
from jaxspatial.numerics.sums.accumulator import Accumulator, OverBatch, Terms, multiplied
from jaxspatial.numerics.sums.compensated import product_parts, product_parts_of_narrow
from jaxspatial.numerics.sums.pairwise import of_neighbours

# A sum of 2^20 products below 2^1000 is finite, and so is 2^2048 scaled by 2^-540 twice.
_LARGE = 2.0**1000
_SCALE = 2.0**-540
# So many numbers make an expansion without a loop: their square is the length of the program.
_UNROLLED = 12


class State(NamedTuple):
    """A sum: its expansion, divided by unit^2 (None: 1); and what the plain sum gives, for infinities and NaN."""

    expansion: tuple[Array, ...]
    plain: Array
    unit: Array | None = None


def _state_of(terms: Terms) -> State:
    """The state of the sum of terms (sign, factors), products of two of which may overflow."""
    is_long = _is_long(terms, 1)
    # Terms of so many factors may overflow. Of two numbers no sum does but that of all; of three one may on the way.
    scalable = {2, 1} if sum(len(factors) == 1 for _, factors in terms) > 2 else {2}
    terms = _grouped(terms) if is_long else terms
    can = [len(factors) in scalable for _, factors in terms]
    products = [product_parts(sign, factors) for sign, factors in terms]
    plain = _plain(products, is_long)
    large = [_is_large(p[0]) & c for p, c in zip(products, can, strict=True)]
    scaled = [
        _scaled_parts(p, sign, factors, lax.full_like(p[0], _SCALE))
        for p, (sign, factors) in zip(products, terms, strict=True)
    ]
    alone = [_masked(m, s) for m, s, c in zip(large, scaled, can, strict=True) if c]
    is_scaled = _sum(_expansion(alone, is_long)) != 0 if alone else lax.full(plain.shape, False)
    chosen = [_chosen(is_scaled, m, p, s) for m, p, s in zip(large, products, scaled, strict=True)]
    unit = lax.select(is_scaled, lax.full_like(plain, _SCALE), lax.full_like(plain, 1))
    return State(_expansion(chosen, is_long), plain, unit)


def _state_of_narrow(terms: Terms) -> State:
    """The state of the sum of terms (sign, factors), factors of at most half the digits: no product overflows."""
    is_long = _is_long(terms, 2)
    products = [product_parts_of_narrow(sign, factors) for sign, factors in (_grouped(terms) if is_long else terms)]
    return State(_expansion(products, is_long), _plain(products, is_long))


def _plain(products: Sequence[Sequence[Array]], is_long: bool) -> Array:
    """What the plain sum gives: of interest where it is infinite or NaN."""
    if is_long:
        return functools.reduce(operator.add, (jnp.sum(p[0], 0) for p in products))
    return of_neighbours(operator.add, [p[0] for p in products])


def _is_large(p: Array) -> Array:
    return ~(lax.abs(p) < lax.full_like(p, _LARGE))


def _scaled_parts(unscaled: Sequence[Array], sign: int, factors: Sequence[Array], scale: Array) -> list[Array]:
    """The parts of a product of two factors, each factor scaled; of all others by as much.

    Hidden: of `(a c) (b c)` and `(x c) c` for a constant c XLA makes `(a b) (c c)` and `x (c c)`, on single items.
    """
    if len(factors) == 2:
        return product_parts(sign, [opaque(x * scale) for x in factors])
    return [opaque(x * scale) * scale for x in unscaled]


def _chosen(is_scaled: Array, is_large: Array, product: Sequence[Array], scaled: Sequence[Array]) -> list[Array]:
    """Of a product the scaled parts where the sum is scaled, else its own, but for one that overflows: nothing."""
    return [
        lax.select(jnp.broadcast_to(is_scaled, x.shape), y, lax.select(is_large, lax.full_like(x, 0), x))
        for x, y in zip(product, scaled, strict=True)
    ]


def _expansion(products: Sequence[Sequence[Array]], is_long: bool) -> tuple[Array, ...]:
    """The expansion of the sum of products, each given by its parts."""
    if is_long:
        return _expansion_in_a_loop(products)
    pairs = [p[i : i + 2] for p in products for i in range(0, len(p), 2)]
    expansion, *others = (tuple(reversed(pair)) for pair in pairs)
    for pair in others:
        # The expansion of the sum of two. [Shewchuk 1997, theorem 12]
        lowest: list[Array] = []
        for x in pair:
            smallest, *expansion = _grown(expansion, x)
            lowest.append(smallest)
        expansion = (*lowest, *expansion)
    return expansion


def _grown(expansion: Sequence[Array], x: Array) -> tuple[Array, ...]:
    grown: list[Array] = []
    for y in expansion:
        x, error = two_sum(x, y, unguarded)
        grown.append(error)
    return (*grown, x)


# -- long sums: programs whose length does not grow with the square of their number of terms ---------------------------


def _is_long(terms: Terms, exact: int) -> bool:
    """True where the products have more parts than are added without a loop; of `exact` factors there is one part."""
    return sum(2 ** ((len(factors) - 1) // exact) for _, factors in terms) > _UNROLLED


def _grouped(terms: Terms) -> Terms:
    """The terms with as many factors as one, stacked along a new first axis: one term of sign 1 for each number."""
    groups: dict[int, list[list[Array]]] = {}
    for sign, (first, *others) in terms:
        groups.setdefault(len(others), []).append([first if sign > 0 else -first, *others])
    return [(1, [jnp.stack(x) for x in zip(*group, strict=True)]) for group in groups.values()]


def _masked(mask: Array, numbers: Sequence[Array]) -> list[Array]:
    return [lax.select(mask, x, lax.full_like(x, 0)) for x in numbers]


def _expansion_in_a_loop(products: Sequence[Sequence[Array]]) -> tuple[Array, ...]:
    """The expansion of the sum of products, each group given by its parts, grown by one number after the other."""

    def add(expansion: Array, x: Array) -> tuple[Array, None]:
        largest, grown = lax.scan(lambda x, y: two_sum(x, y, unguarded), x, expansion)
        # As long as there are fewer numbers than places the lowest is 0.
        return jnp.concatenate([grown[1:], largest[None]]), None

    numbers = jnp.concatenate([x for p in products for x in p])
    expansion, _ = lax.scan(add, lax.full_like(numbers, 0), numbers)
    return tuple(expansion[i] for i in range(len(numbers)))


def _sum(expansion: Sequence[Array]) -> Array:
    """The sum, with an error far below one unit in the last place: the errors of the largest added are added last."""
    s, errors = certified.swept(expansion, fast_two_sum)
    return s + of_neighbours(operator.add, errors[::-1]) if errors else s


def _plus(state: State, sign: int, x: Array) -> State:
    scaled = x if state.unit is None else (x * state.unit) * state.unit
    plain = state.plain - x if sign < 0 else state.plain + x
    # The first sum has x second, which may be a constant.
    first, *others = state.expansion
    s, error = (two_difference if sign < 0 else two_sum)(first, scaled)
    return State((error, *_grown(others, s)), plain, state.unit)


def _pair(state: State, dtype: DTypeLike) -> tuple[Array, Array]:
    """Rounded to twice the precision."""
    return certified.pair(certified.from_numbers([_unscaled(x, state.unit) for x in state.expansion]), dtype)


def _padded(states: Sequence[State | None]) -> list[State]:
    """The states with zero in place of None, and expansions of one length."""
    like = next(state for state in states if state is not None)
    zero = lax.full_like(like.plain, 0)
    nothing = State((), zero, None if like.unit is None else lax.full_like(zero, 1))
    states = [nothing if state is None else state for state in states]
    longest = max(len(state.expansion) for state in states)
    return [s._replace(expansion=(zero,) * (longest - len(s.expansion)) + s.expansion) for s in states]


def _over_batch(state: State, axes: Sequence[int]) -> OverBatch:
    """With one unit for all items of a sum: scaled where an item is, or is so large that the sum might overflow on the
    way. Of an item that is not finite the plain sum is taken."""
    numbers, plain, unit = state.expansion, state.plain, None
    lost = jnp.isnan(functools.reduce(operator.add, numbers))
    if state.unit is not None:
        any_scaled = jnp.any(_is_large(numbers[-1]) | (state.unit != 1), axes, keepdims=True)
        unit = lax.select(any_scaled, *(lax.full(any_scaled.shape, x, state.unit.dtype) for x in (_SCALE, 1.0)))
        change = lax.select(state.unit == unit, lax.full_like(state.unit, 1), jnp.broadcast_to(unit, state.unit.shape))
        numbers, plain = [(x * change) * change for x in numbers], (plain * unit) * unit
    *others, largest = numbers
    increasing = [*_masked(~lost, others), lax.select(lost, plain, largest)]
    return certified.over_batch(increasing, lambda x: _unscaled(x, unit))


def _round(state: State, dtype: DTypeLike) -> Array:
    """Rounded; where something is infinite or NaN, what the plain sum gives."""
    # Numbers that do not overlap, added from the smallest: relative error 2^-51, far below a unit of a narrower dtype.
    r = _sum(state.expansion) if dtype == jnp.float64 else functools.reduce(operator.add, state.expansion)
    r = _unscaled(r, state.unit)
    return lax.convert_element_type(lax.select(jnp.isnan(r), state.plain, r), dtype)


def _unscaled(x: Array, unit: Array | None) -> Array:
    """x unit^-2; None: 1."""
    if unit is None:
        return x
    inverse = lax.select(unit == 1, unit, lax.full_like(unit, 1 / _SCALE))
    return (x * inverse) * inverse


FAITHFUL = Accumulator(
    state_of=_state_of,
    plus=_plus,
    round=_round,
    pair=_pair,
    over_batch=_over_batch,
    padded=_padded,
    times_power_of_two=lambda state, share: State(*multiplied(state[:2], share), unit=state.unit),
)
FAITHFUL_OF_NARROW = dataclasses.replace(FAITHFUL, state_of=_state_of_narrow)
