"""Plans: which sums of products are to be evaluated, and how that becomes arithmetic: in which format, by which
accumulator, and in which layout.

Components are computed as lanes and then picked, see `layout`. Terms that are one array as it stands are added last, to
the whole array: that ties the result to its layout, and lets it take its place in memory.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.numerics.errorfree.barrier import opaque, opaque_or_nan
from jaxspatial.numerics.errorfree.primitives import not_inlined
from jaxspatial.numerics.numbers.layout import picked
from jaxspatial.numerics.numbers.polynomial import Term
from jaxspatial.numerics.sums.accumulator import WIDE, Trial
from jaxspatial.numerics.sums.certified import CERTIFIED, CERTIFIED_OF_NARROW
from jaxspatial.numerics.sums.compensated import COMPENSATED, SINGLE
from jaxspatial.numerics.sums.estimated import ESTIMATED, ESTIMATED_OF_NARROW
from jaxspatial.numerics.sums.faithful import FAITHFUL, FAITHFUL_OF_NARROW
from jaxspatial.numerics.sums.pairwise import by_halving


class Sum(NamedTuple):
    """One array of the result: for each of its components the terms; the axes of the batch it is summed over; and the
    powers of two that components are multiplied by before they are rounded, none for 1."""

    components: tuple[tuple[Term, ...], ...]
    reduced: tuple[int, ...] = ()
    shares: tuple[float, ...] = ()


class Plan(NamedTuple):
    """What is to be evaluated: Sums over a batch, in a precision, each as one array or as the pair of a double word.

    `leading`: components are on the first axis, with the batch behind them, and not on the last.
    """

    sums: tuple[Sum, ...]
    batch: tuple[int, ...]
    precision: str
    is_pair: bool
    leading: bool = False

    @property
    def axis(self) -> int:
        return 0 if self.leading else len(self.batch)

    def shape(self, s: Sum) -> tuple[int, ...]:
        """The shape of the result for a Sum; axes that are summed over keep size 1."""
        batch = [1 if i in s.reduced else n for i, n in enumerate(self.batch)]
        return (len(s.components), *batch) if self.leading else (*batch, len(s.components))


def evaluate(*arrays: Array, plan: Plan) -> list[Array]:
    """The results of the plan: one array per Sum, or two for a pair."""
    same = [_same_as(plan, s, arrays) for s in plan.sums]
    others = tuple(s for s, j in zip(plan.sums, same, strict=True) if j is None)
    with jax.enable_x64(True):
        computed = iter(_computed(plan._replace(sums=others), arrays) if others else ())
    width = 1 + plan.is_pair
    return [x for j in same for x in ([next(computed) for _ in range(width)] if j is None else [arrays[j]])]


def _same_as(plan: Plan, s: Sum, arrays: Sequence[Array]) -> int | None:
    """The index of the array that a Sum just passes on, or None."""
    first = s.components[0]
    j = first[0].factors[0][0] if len(first) == 1 and not plan.is_pair else None
    if j is None or s.reduced or s.shares or arrays[j].shape != plan.shape(s):
        return None
    passed = all(terms == (Term(1, ((j, k),)),) for k, terms in enumerate(s.components))
    return j if passed else None


def _computed(plan: Plan, arrays: Sequence[Array]) -> list[Array]:
    is_narrow = arrays[0].dtype != np.float64
    is_single = all(_is_single(plan, s) for s in plan.sums)
    if is_narrow and (is_single or plan.precision != "faithful"):
        return _evaluated(plan, WIDE, arrays)
    if is_single:
        return _evaluated(plan, SINGLE, arrays)
    if plan.precision == "faithful":
        return _by_trials(plan, _trials(plan, is_narrow), arrays)
    return _unfused(plan, COMPENSATED, arrays)


# So many exact products take less to add without an error than a trial.
_FEW = 3


def _trials(plan: Plan, is_narrow: bool) -> Sequence[Trial]:
    """What `faithful` tries, each for what the one before leaves open.

    Sums over a batch and pairs need more digits than the first has.
    """
    estimated, certified, faithful = (
        (ESTIMATED_OF_NARROW, CERTIFIED_OF_NARROW, FAITHFUL_OF_NARROW)
        if is_narrow
        else (ESTIMATED, CERTIFIED, FAITHFUL)
    )
    is_exact = is_narrow and all(len(t.factors) <= 2 for s in plan.sums for terms in s.components for t in terms)
    has_trial = not plan.is_pair and not any(s.reduced for s in plan.sums) and (is_exact or not is_narrow)
    rest = [faithful] if is_exact else [certified, faithful]
    is_short = is_exact and max(len(terms) for s in plan.sums for terms in s.components) <= _FEW
    return [estimated, *rest] if has_trial and not is_short else rest


def _unfused(plan: Plan, accumulator, arrays: Sequence[Array]) -> list[Array]:
    """As a call that the compiler does not inline. Where one such sum is fused into the next, XLA CPU computes every
    component again for each it is used in, without vectorising: a shift and a dot then take 7 times as long."""
    return not_inlined(functools.partial(_evaluated, plan, accumulator), arrays)


def _by_trials(plan: Plan, trials: Sequence[Trial], arrays: Sequence[Array]) -> list[Array]:
    """Evaluated by the first trial, and while that leaves a NaN in the batch once more by the next.

    Loops of at most one pass: unlike branches they leave results where they are in memory.
    """
    first, *others = trials
    if not others:
        return _unfused(plan, first, arrays)
    results = _evaluated(plan, first, arrays)
    is_missing = _is_missing(results)
    for trial in others:

        def again(state, trial: Trial = trial):
            # Where the results have a NaN, the others: the result of an item does not depend on its batch.
            results, others = state[0], _evaluated(plan, trial, arrays)
            width = 1 + plan.is_pair
            missing = [jnp.isnan(results[i - i % width]) for i in range(len(results))]
            results = [lax.select(m, y, x) for m, x, y in zip(missing, results, others, strict=True)]
            return results, np.zeros((), bool), _is_missing(results)

        results, _, is_missing = lax.while_loop(lambda state: state[1], again, (results, is_missing, is_missing))
    return results


def _is_missing(results: Sequence[Array]) -> Array:
    return functools.reduce(lax.bitwise_or, (jnp.any(jnp.isnan(r)) for r in results))


def _evaluated(plan: Plan, accumulator, arrays: Sequence[Array]) -> list[Array]:
    evaluation = _Evaluation(plan, accumulator, arrays)
    return [x for s in plan.sums for x in evaluation.results(s)]


class _Evaluation:
    """What a plan of sums of products of arrays comes to, by one accumulator."""

    def __init__(self, plan: Plan, accumulator, arrays: Sequence[Array]):
        self.plan, self.accumulator, self.arrays = plan, accumulator, arrays
        self._lanes: dict[tuple[int, int], Array] = {}
        # What comes from outside is made opaque to the compiler, in its own format: a conversion may be left out.
        self._opaque = opaque if accumulator in (WIDE, SINGLE) else opaque_or_nan

    def results(self, s: Sum) -> Sequence[Array]:
        """Of a Sum: one array, or the two of a pair."""
        if not s.reduced:
            is_single = self.accumulator is COMPENSATED and _is_single(self.plan, s)
            return self._of_items(s, SINGLE if is_single else self.accumulator)
        shares = s.shares or [1] * len(s.components)
        results = [self._over_batch(s, *component) for component in zip(s.components, shares, strict=True)]
        limbs = ([x if x is None else x[i] for x in results] for i in range(1 + self.plan.is_pair))
        return [picked(self.plan.axis, components) for components in limbs]

    def _over_batch(self, s: Sum, terms: Sequence[Term], share: float) -> Sequence[Array] | None:
        """One component, summed over axes of the batch by halving: a result of size 1 along these."""
        if not terms:
            return None
        items = self.accumulator.over_batch(self._state_of(self.accumulator, terms, share), s.reduced)
        limbs = items.limbs
        for axis in s.reduced:
            limbs = by_halving(items.merge, limbs, axis)
        return self._rounded(items, limbs)

    def _of_items(self, s: Sum, accumulator) -> Sequence[Array]:
        whole, rest = self._separated(s)
        states = [
            self._state_of(accumulator, terms, share) if terms else None
            for terms, share in zip(rest, s.shares or [1] * len(rest), strict=True)
        ]
        if all(state is None for state in states):
            state = accumulator.state_of([(sign, [self._entered(self.arrays[j])]) for sign, j in whole])
        else:
            state = jax.tree.map(lambda *lanes: picked(self.plan.axis, lanes), *accumulator.padded(states))
            for sign, j in whole:
                state = accumulator.plus(state, sign, self._entered(self.arrays[j]))
        return self._rounded(accumulator, state)

    def _rounded(self, accumulator, state) -> Sequence[Array]:
        dtype = self.arrays[0].dtype
        if not self.plan.is_pair:
            return [accumulator.round(state, dtype)]
        high, low = accumulator.pair(state, dtype)
        # Beside an infinity inf - inf, whose sum with it is NaN.
        return high, lax.select(lax.is_finite(high), low, lax.full_like(low, 0))

    def _state_of(self, accumulator, terms: Sequence[Term], share: float):
        """The state of one component."""
        state = accumulator.state_of([(t.sign, [self._lane(*f) for f in t.factors]) for t in terms])
        return state if share == 1 else accumulator.times_power_of_two(state, share)

    def _lane(self, j: int, k: int) -> Array:
        """Component k of array j over the whole batch, taken out once. Converted alone: a conversion of a whole array
        that is used many times would be a pass of its own."""
        if (j, k) not in self._lanes:
            lane = lax.index_in_dim(self.arrays[j], k, self.plan.axis, keepdims=False)
            self._lanes[j, k] = jnp.broadcast_to(self._entered(lane), self.plan.batch)
        return self._lanes[j, k]

    def _entered(self, x: Array) -> Array:
        return lax.convert_element_type(self._opaque(x), np.float64)

    def _separated(self, s: Sum) -> tuple[list[tuple[Any, int]], list[list[Term]]]:
        """((sign, j) for every array j that is a term just as it stands, the other terms of each component)."""
        if s.shares:
            return [], list(map(list, s.components))
        first = [t for t in s.components[0] if len(t.factors) == 1 and t.factors[0][1] == 0]
        whole: list[tuple[Any, int]] = []
        for sign, ((j, _),) in first:
            same = all(Term(sign, ((j, k),)) in terms for k, terms in enumerate(s.components))
            if same and self.arrays[j].shape == self.plan.shape(s) and (sign, j) not in whole:
                whole.append((sign, j))
        rest = list(map(list, s.components))
        for sign, j in whole:
            for k, terms in enumerate(rest):
                terms.remove(Term(sign, ((j, k),)))
        return whole, rest


def is_simple(plan: Plan, s: Sum, arrays: Sequence[Array]) -> bool:
    """True where a Sum takes no error-free transform: it passes an array on, or has products that are rounded once."""
    return _same_as(plan, s, arrays) is not None or _is_single(plan, s)


def _is_single(plan: Plan, s: Sum) -> bool:
    """True where no component is more than one product of two: rounded once as it is, in every precision."""
    return not (plan.is_pair or s.reduced or s.shares) and all(
        len(terms) <= 1 and all(len(t.factors) <= 2 for t in terms) for terms in s.components
    )
