"""How a plan of sums becomes arithmetic: in which format, by which algorithm, and in which layout.

Components are computed as lanes and then picked, see `layout`. Terms that are one array as it stands are added last, to
the whole array: that ties the result to its layout, and lets it take its place in memory.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.experimental.xla_metadata import set_xla_metadata

from jaxspatial.arithmetic.errorfree.contraction import hidden
from jaxspatial.arithmetic.errorfree.transforms import product_error
from jaxspatial.arithmetic.numbers.layout import picked
from jaxspatial.arithmetic.numbers.polynomial import Term
from jaxspatial.arithmetic.sums import sum3, wide
from jaxspatial.arithmetic.sums.accumulators import certified, compensated, estimated, faithful
from jaxspatial.arithmetic.sums.pairwise import by_halving


def evaluate(plan, arrays, contracted):
    """The results of the plan: one array per Sum, or two for a pair. contracted: see `lowering.rule`."""
    same = [_same_as(plan, s, arrays) for s in plan.sums]
    others = tuple(s for s, j in zip(plan.sums, same, strict=True) if j is None)
    with jax.enable_x64(True):
        computed = iter(_computed(plan._replace(sums=others), arrays, product_error(contracted)) if others else ())
    width = 1 + plan.is_pair
    return [x for j in same for x in ([next(computed) for _ in range(width)] if j is None else [arrays[j]])]


def _same_as(plan, s, arrays):
    """The index of the array that a Sum just passes on, or None."""
    first = s.components[0]
    j = first[0].factors[0][0] if len(first) == 1 and not plan.is_pair else None
    if j is None or s.reduced or s.shares or arrays[j].shape != plan.shape(s):
        return None
    passed = all(terms == (Term(1, ((j, k),)),) for k, terms in enumerate(s.components))
    return j if passed else None


def _computed(plan, arrays, error):
    is_narrow = arrays[0].dtype != np.float64
    is_single = all(_is_single(plan, s) for s in plan.sums)
    if is_narrow and (is_single or plan.precision != "faithful"):
        return _evaluated(plan, _Tier(wide, wide.total, error), arrays)
    if is_single:
        return _evaluated(plan, _Tier(compensated, _rounded, error), arrays)
    if plan.precision == "faithful":
        return _tried(plan, _tiers(plan, is_narrow, error), arrays)
    return _unfused(plan, _Tier(compensated, compensated.total, error), arrays)


# So many exact products take less to be added without an error than to be tried first.
_FEW = 3


def _tiers(plan, is_narrow, error):
    """What `faithful` tries, each for what the one before leaves open.

    Sums over a batch and pairs need more digits than the first has.
    """
    is_exact = is_narrow and plan.degree <= 2
    is_tried = not plan.is_pair and not any(s.reduced for s in plan.sums) and (is_exact or not is_narrow)
    tried = [faithful] if is_exact else [certified, faithful]
    if is_tried and not (is_exact and max(len(terms) for s in plan.sums for terms in s.components) <= _FEW):
        tried.insert(0, estimated)
    return [_Tier(m, m.total_of_narrow if is_narrow else m.total, error) for m in tried]


def _unfused(plan, tier, arrays):
    """As a call that the compiler does not inline. Where one such sum is fused into the next, XLA CPU computes every
    component again for each it is used in, without vectorising: a shift and a dot then take 7 times as long."""
    evaluated = jax.jit(functools.partial(_evaluated, plan, tier))
    with set_xla_metadata(inlineable="false"):
        return evaluated(arrays)


def _tried(plan, tiers, arrays):
    """Evaluated by the first tier, and while that leaves a NaN in the batch once more by the next.

    Loops of at most one turn: unlike branches they leave results where they are in memory.
    """
    if len(tiers) == 1:
        return _unfused(plan, tiers[0], arrays)
    results = _evaluated(plan, tiers[0], arrays)
    is_missing = _is_missing(results)
    for tier in tiers[1:]:

        def again(state, tier=tier):
            found = _completed(plan, state[0], _evaluated(plan, tier, arrays))
            return found, np.zeros((), bool), _is_missing(found)

        results, _, is_missing = lax.while_loop(lambda state: state[1], again, (results, is_missing, is_missing))
    return results


def _is_missing(results):
    return functools.reduce(lax.bitwise_or, (jnp.any(jnp.isnan(r)) for r in results))


def _completed(plan, results, others):
    """The results, the others in place of NaN: what is found of an item does not depend on its batch."""
    width = 1 + plan.is_pair
    missing = [jnp.isnan(results[i - i % width]) for i in range(len(results))]
    return [lax.select(m, y, x) for m, x, y in zip(missing, results, others, strict=True)]


def _evaluated(plan, tier, arrays):
    lanes = _Lanes(plan, arrays)
    return [x for s in plan.sums for x in _results(tier, plan, s, lanes, arrays[0].dtype)]


class _Tier(NamedTuple):
    """A module with the verbs plus, merge, times_power_of_two, value, pair and padded; which total; and the error of a
    product, see `transforms`."""

    verbs: Any
    total: Callable
    error: Callable


def _wide(x):
    return lax.convert_element_type(x, np.float64)


class _Lanes:
    """The components of the arrays, each over the whole batch, taken apart once. Converted one by one: a conversion of
    a whole array that is used many times would be a pass of its own."""

    def __init__(self, plan, arrays):
        self.plan, self.arrays = plan, arrays
        self._known = {}

    def __getitem__(self, factor):
        if factor not in self._known:
            j, k = factor
            lane = lax.index_in_dim(self.arrays[j], k, self.plan.axis, keepdims=False)
            self._known[factor] = jnp.broadcast_to(_wide(lane), self.plan.batch)
        return self._known[factor]


def _is_single(plan, s):
    """True where no component is more than one product of two: rounded once as it is, in every precision."""
    return not (plan.is_pair or s.reduced or s.shares) and all(
        len(terms) <= 1 and all(len(t.factors) <= 2 for t in terms) for terms in s.components
    )


def _rounded(terms, _):
    """The state of a single product whose error nobody asks for."""
    ((sign, factors),) = terms
    p = hidden(functools.reduce(lax.mul, factors))
    return (p if sign > 0 else -p), jnp.zeros_like(p), jnp.zeros_like(p)


def _results(tier, plan, s, lanes, dtype):
    if tier.verbs is compensated and _is_single(plan, s):
        tier = tier._replace(total=_rounded)
    if s.reduced:
        results = [_reduced(tier, plan, s, *component, lanes, dtype) for component in _components(s)]
        return [picked(plan.axis, [x if x is None else x[i] for x in results]) for i in range(1 + plan.is_pair)]
    whole, components = _separated(plan.shape(s), s, lanes.arrays)
    state = _state(
        tier, plan, [(terms, share) for terms, (_, share) in zip(components, _components(s), strict=True)], lanes
    )
    if state is None:
        state = tier.total([(sign, [_wide(lanes.arrays[j])]) for sign, j in whole], tier.error)
        whole = []
    for sign, j in whole:
        state = tier.verbs.plus(state, sign, _wide(lanes.arrays[j]))
    return tier.verbs.pair(state, dtype) if plan.is_pair else [tier.verbs.value(state, dtype)]


def _separated(shape, s, arrays):
    """((sign, j) for every array j that is a term just as it stands, the other terms of each component)."""
    if s.shares:
        return [], list(s.components)
    first = [t for t in s.components[0] if len(t.factors) == 1 and t.factors[0][1] == 0]
    whole = []
    for sign, ((j, _),) in first:
        same = all(Term(sign, ((j, k),)) in terms for k, terms in enumerate(s.components))
        if same and arrays[j].shape == shape and (sign, j) not in whole:
            whole.append((sign, j))
    taken = [{Term(sign, ((j, k),)) for sign, j in whole} for k in range(len(s.components))]
    return whole, [_without(terms, t) for terms, t in zip(s.components, taken, strict=True)]


def _without(terms, taken):
    """The terms but for one of each of those taken."""
    rest = list(terms)
    for t in taken:
        rest.remove(t)
    return rest


def _state(tier, plan, components, lanes):
    """The state of all components as whole arrays, None if none of them has a term."""
    states = [_total(tier, *component, lanes) if component[0] else None for component in components]
    if all(state is None for state in states):
        return None
    return jax.tree.map(lambda *components: picked(plan.axis, components), *tier.verbs.padded(states))


def _components(s):
    """(terms, share) of each component of a Sum."""
    return list(zip(s.components, s.shares or [1] * len(s.components), strict=True))


def _total(tier, terms, share, lanes):
    state = tier.total([(t.sign, [lanes[f] for f in t.factors]) for t in terms], tier.error)
    return state if share == 1 else tier.verbs.times_power_of_two(state, share)


def _reduced(tier, plan, s, terms, share, lanes, dtype):
    """One component, summed over axes of the batch by halving: a result of size 1 along these."""
    if not terms:
        return None
    verbs, state, settled = _summable(tier.verbs, _total(tier, terms, share, lanes), s.reduced)
    for axis in s.reduced:
        state = by_halving(verbs.merge, state, axis)
    return [settled(x) for x in (verbs.pair(state, dtype) if plan.is_pair else [verbs.value(state, dtype)])]


def _summable(verbs, state, axes):
    """The verbs and the state in which items are summed along axes, and what remains to be done with the result."""
    if verbs is certified:
        return sum3, sum3.from_numbers(state[2::-1]), certified.finite_or_nan
    if verbs is faithful:
        numbers, unit = faithful.in_one_unit(state, axes)
        return sum3, sum3.from_numbers(numbers), lambda x: faithful.unscaled(x, unit)
    return verbs, state, lambda x: x
