"""Sums of products as one primitive: what precisions that look at a whole sum are made of.

It takes arrays and a list of polynomials in their components. Tangents and pull-backs of a sum of products are sums of
products again, evaluated by the same primitive: derivatives of every order keep the promise of their precision, and a
cotangent that many terms contribute to is rounded once, over a batch that shares one item too.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.numerics.errorfree.primitives import (
    common_spec,
    compiled,
    inlined_calls,
    is_zero,
    no_tangent,
    rule,
    same_sharding,
)
from jaxspatial.numerics.jax_internals import ClosedJaxpr, Primitive, ad, batching, mlir
from jaxspatial.numerics.numbers.polynomial import Term
from jaxspatial.numerics.sums.evaluation import Plan, Sum, evaluate


def bind_nonzero(plan: Plan, sums: Sequence[Sum], arrays: Sequence[Array]) -> list:
    """For each Sum its result, a list of one array or of the two of a pair; None for a Sum without terms.

    Arrays have the components on the plan's axis, and on each axis of the batch its size or 1.
    """
    nonzero = [s for s in sums if any(s.components)]
    if not nonzero:
        return [None] * len(sums)
    # Of the arrays, those that are used.
    used = sorted({j for s in nonzero for terms in s.components for t in terms for j, _ in t.factors})
    places, renumbered = {j: i for i, j in enumerate(used)}, list[Sum]()
    for s in nonzero:
        components = [[Term(sign, tuple((places[j], k) for j, k in f)) for sign, f in terms] for terms in s.components]
        renumbered.append(s._replace(components=tuple(map(tuple, components))))
    arrays = same_sharding(*(arrays[j] for j in used), components=plan.axis)
    results = iter(sums_p.bind(*arrays, plan=plan._replace(sums=tuple(renumbered))))
    return [[next(results) for _ in range(1 + plan.is_pair)] if any(s.components) else None for s in sums]


def _abstract(*arrays, plan: Plan) -> list:
    like = arrays[0]
    common = common_spec([a.sharding.spec for a in arrays])
    results: list = []
    for shape in map(plan.shape, plan.sums):
        spec = [None if n == 1 or i == plan.axis else common[i] for i, n in enumerate(shape)]
        sharding = like.sharding.update(spec=jax.sharding.PartitionSpec(*spec))
        results += [like.update(shape=shape, sharding=sharding, weak_type=False)] * (1 + plan.is_pair)
    return results


# -- derivatives -------------------------------------------------------------------------------------------------------


def _jvp(primals: Sequence[Array], tangents: Sequence, *, plan: Plan) -> tuple[list[Array], list]:
    results = sums_p.bind(*primals, plan=plan)
    n = len(primals)
    moving = {j: n + j for j, t in enumerate(tangents) if not is_zero(t)}
    sums = [s._replace(components=tuple(_differential(terms, moving) for terms in s.components)) for s in plan.sums]
    differentials = bind_nonzero(plan, sums, [*primals, *tangents])
    width = 1 + plan.is_pair
    flat = [d for pair in differentials for d in (pair or [None] * width)]
    return results, [no_tangent(x) if d is None else d for x, d in zip(results, flat, strict=True)]


def _differential(terms: Sequence[Term], moving: dict[int, int]) -> tuple[Term, ...]:
    """The product rule: each factor in turn replaced by its tangent."""
    return tuple(
        Term(t.sign, (*t.factors[:i], (moving[j], k), *t.factors[i + 1 :]))
        for t in terms
        for i, (j, k) in enumerate(t.factors)
        if j in moving
    )


def _transpose(cotangents: Sequence, *arrays, plan: Plan) -> list:
    """The low limb of a pair is a rounding error: its cotangent counts for nothing."""
    cotangents = [_shared(plan, s, c) for s, c in zip(plan.sums, cotangents[:: 1 + plan.is_pair], strict=True)]
    n = len(arrays)
    incoming = {o: n + o for o, c in enumerate(cotangents) if not is_zero(c)}
    linear = [j for j, x in enumerate(arrays) if ad.is_undefined_primal(x)]
    sums = [_pulled_back(plan, incoming, j, arrays[j].aval) for j in linear]
    pulled = bind_nonzero(plan._replace(is_pair=False), sums, [*arrays, *cotangents])
    by_array = {j: x[0] for j, x in zip(linear, pulled, strict=True) if x is not None}
    return [by_array.get(j) for j in range(n)]


def _shared(plan: Plan, s: Sum, cotangent):
    """The cotangent of the sum of the terms alone."""
    if not s.shares or is_zero(cotangent):
        return cotangent
    shares = np.asarray(s.shares, cotangent.dtype).reshape([-1 if i == plan.axis else 1 for i in range(cotangent.ndim)])
    return lax.mul(cotangent, jnp.broadcast_to(shares, cotangent.shape))


def _pulled_back(plan: Plan, incoming: dict[int, int], j: int, aval) -> Sum:
    """The Sum for the cotangent of array j: from every term that has one of its components, the other factors."""
    components: list[list[Term]] = [[] for _ in range(aval.shape[plan.axis])]
    for o, s in enumerate(plan.sums):
        for k, terms in enumerate(s.components):
            for sign, factors in terms if o in incoming else ():
                for i, (array, component) in enumerate(factors):
                    if array == j:
                        others = (*factors[:i], *factors[i + 1 :], (incoming[o], k))
                        components[component].append(Term(sign, others))
    batch = aval.shape[1:] if plan.leading else aval.shape[:-1]
    reduced = tuple(i for i, (one, n) in enumerate(zip(batch, plan.batch, strict=True)) if one != n)
    return Sum(tuple(map(tuple, components)), reduced)


# -- batching and lowering ---------------------------------------------------------------------------------------------


def _batch(arrays: Sequence[Array], axes: Sequence[int | None], *, plan: Plan) -> tuple[list[Array], list[int]]:
    """The new axis stays where it is if it is there in all, behind the components where it comes behind them."""
    mapped = {axis for axis in axes if axis is not None}
    leading = plan.leading if plan.batch else mapped == {1}
    at = mapped.pop() if len(mapped) == 1 else -1
    first, last = (1, 1 + len(plan.batch)) if leading else (0, len(plan.batch))
    at = at if first <= at <= last else first
    size = next(x.shape[axis] for x, axis in zip(arrays, axes, strict=True) if axis is not None)
    moved = [
        lax.expand_dims(x, [at]) if axis is None else jnp.moveaxis(x, axis, at)
        for x, axis in zip(arrays, axes, strict=True)
    ]
    place = at - first
    sums = tuple(s._replace(reduced=tuple(i + (i >= place) for i in s.reduced)) for s in plan.sums)
    batch = (*plan.batch[:place], size, *plan.batch[place:])
    batched = plan._replace(sums=sums, batch=batch, leading=leading)
    results = sums_p.bind(*same_sharding(*moved, components=batched.axis), plan=batched)
    return results, [at] * len(results)


def trace_of_sums(eqn) -> ClosedJaxpr | None:
    """What an operation of a trace computes, if it is one of sums of products; else None."""
    if eqn.primitive is not sums_p:
        return None
    return _traced(tuple((v.aval.shape, v.aval.dtype) for v in eqn.invars), eqn.params["plan"])


@functools.lru_cache(maxsize=256)
def _traced(arrays: tuple, plan: Plan) -> ClosedJaxpr:
    """One trace for all sums of one plan: a program has hundreds of a few plans."""
    with jax.enable_x64(True), inlined_calls():
        return jax.make_jaxpr(functools.partial(evaluate, plan=plan))(*(jax.ShapeDtypeStruct(*a) for a in arrays))


sums_p: Any = Primitive("jaxspatial_sums")
sums_p.multiple_results = True
sums_p.def_abstract_eval(_abstract)
_program = functools.lru_cache(maxsize=256)(functools.partial(compiled, sums_p))
sums_p.def_impl(lambda *arrays, plan: _program(plan=plan)(*arrays))
# Without calls, but on CPUs: see `inlined_calls`.
mlir.register_lowering(sums_p, rule(inlined_calls()(evaluate)))
lower_for_cpus = rule(evaluate)
mlir.register_lowering(sums_p, lower_for_cpus, platform="cpu")
ad.primitive_jvps[sums_p] = _jvp
ad.primitive_transposes[sums_p] = _transpose
batching.primitive_batchers[sums_p] = _batch
