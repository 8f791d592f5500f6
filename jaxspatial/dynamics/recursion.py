"""From the base to the tips and back: the one place that knows how a recursion over a tree is compiled.

A step is a call that the compiler does not inline: fused into one another, the steps of a long tree would be computed
again for each of the many results. Long chains of equal joints are loops, compiled once. Whether a step runs as one or
the other makes no difference to its results.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.lanes import is_known
from jaxspatial.arithmetic.numbers import Lane, as_data, data_of, is_number, mapped, shared, where, with_data


def outward(segments, step, root, own):
    """The result of every segment: step(own[i], the state of its parent) gives (result, state), with `root` for the
    state of the world."""
    results, states = [], {-1: root}
    for segment, numbers in zip(segments, own, strict=True):
        run = along if segment.is_chain else _once
        result, states[segment.stop - 1] = run(step, numbers, states[segment.parent], reverse=False)
        results.append(result)
    return results


def inward(segments, step, nothing, own, joined=None):
    """([the result of every segment], what arrives at the world): step(own[i], what its children pass on) gives
    (result, what is passed on). Of several children that is `joined`, by default added; `nothing` arrives at tips."""
    joined = joined or _added
    arrived, results = {}, []
    for segment, numbers in zip(reversed(segments), reversed(own), strict=True):
        given = arrived.pop(segment.stop - 1, nothing)
        run = along if segment.is_chain else _once
        result, passed = run(step, numbers, given, reverse=True)
        beside = arrived.get(segment.parent)
        arrived[segment.parent] = passed if beside is None else shared(joined)(beside, passed)
        results.append(result)
    return results[::-1], arrived.get(-1, nothing)


def _added(a, b):
    leaves, tree = jax.tree.flatten(a, is_leaf=is_number)
    return jax.tree.unflatten(tree, vectors.plus(tuple(leaves), tuple(jax.tree.leaves(b, is_leaf=is_number))))


def _once(step, numbers, state, reverse):
    return shared(step)(numbers, state)


def along(step, numbers, state, reverse):
    """A chain as a loop: (the results of step(numbers, state), stacked along it, the last state)."""
    leaves, tree = jax.tree.flatten(numbers, is_leaf=is_number)
    start, state_tree = jax.tree.flatten(state, is_leaf=is_number)
    start = list(map(as_data, start))
    data = data_of(leaves)
    # What is the same for all of them is no number along the chain.
    is_along = [jax.tree.leaves(x)[0].ndim > 0 for x in data]
    shape = []

    def body(carry, own):
        own = iter(own)
        all_of_them = [next(own) if yes else x for yes, x in zip(is_along, data, strict=True)]
        numbers = jax.tree.unflatten(tree, with_data(leaves, all_of_them))
        result, new = step(numbers, jax.tree.unflatten(state_tree, with_data(start, carry)))
        shape[:] = jax.tree.flatten(result, is_leaf=is_number)
        return data_of(map(as_data, jax.tree.leaves(new, is_leaf=is_number))), data_of(shape[0])

    along_it = [x for yes, x in zip(is_along, data, strict=True) if yes]
    last, stacked = lax.scan(body, data_of(start), along_it, reverse=reverse)
    return (
        jax.tree.unflatten(shape[1], with_data(shape[0], stacked)),
        jax.tree.unflatten(state_tree, with_data(start, last)),
    )


# -- many at once: numbers that are arrays ----------------------------------------------------------------------------


def each_column(function, common, columns):
    """function(common, one of the columns) for all of them: numbers that are arrays along one axis."""
    leaves, tree = jax.tree.flatten(columns, is_leaf=is_number)
    shape = []

    def one(data):
        result = function(common, jax.tree.unflatten(tree, with_data(leaves, data)))
        found, result_tree = jax.tree.flatten(result, is_leaf=is_number)
        shape[:] = [list(map(as_data, found)), result_tree]
        return data_of(shape[0])

    data = jax.vmap(one)(data_of(leaves))
    return jax.tree.unflatten(shape[1], with_data(shape[0], data))


def repeated_along(x, n):
    """A number as n columns."""
    return mapped(lambda word: jnp.broadcast_to(word, (n,)), as_data(x))


def raveled(x):
    """A number, or what is many along one axis, as the latter."""
    return mapped(jnp.ravel, x)


def part(x, end, shape):
    """Of many numbers those before the end, in the shape () or (n,)."""
    return mapped(lambda word: word[end - shape[0] : end] if shape else word[end - 1], x)


def concatenated(sets):
    """Sets of columns one after the other."""
    return tuple(mapped(lambda *words: jnp.concatenate(words), *parts) for parts in zip(*sets, strict=True))


def with_column(columns, place, column):
    """The columns with another at a place that is data."""
    return tuple(
        mapped(lambda word, x: lax.dynamic_update_index_in_dim(word, x, place, 0), c, as_data(x))
        for c, x in zip(columns, column, strict=True)
    )


def added_at(row, place, x):
    """A row of numbers with one added at a place that is data."""
    if isinstance(x, Lane) and is_known(x.value, 0):
        return row
    here = jnp.arange(jax.tree.leaves(data_of([row]))[0].shape[-1], dtype=np.int32) == place
    return where(here, row + repeated_along(x, here.shape[0]), row)
