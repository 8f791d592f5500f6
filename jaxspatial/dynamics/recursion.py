"""From the base to the tips and back: the one place that knows how a recursion over a tree is compiled.

Chains of equal length that hang side by side are one loop, whose step is compiled once, whatever their length and
number. What the state has that is known all along a chain stays known: a planar arm has no components out of its
plane. A bundle of single bodies is its step.
"""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import data_of, is_number, shared, with_data
from jaxspatial.dynamics import along


def outward(state, step, root, own):
    """The results of every bundle: step(own, the state of the parent) gives (result, state of the body), with `root`
    for the state of the world."""
    results, ends = [], {}
    for bundle, numbers in zip(state.bundles, own, strict=True):
        start = _beside([ends.get(parent, root) for parent in bundle.parents], state.n)
        result, last = _run(step, bundle, state.n, numbers, start, reverse=False)
        ends |= {i + bundle.length - 1: _chain(last, c) for c, i in enumerate(bundle.starts)}
        results.append(result)
    return results


def inward(state, step, nothing, own, joined=None):
    """The results of every bundle: step(own, what its children pass on) gives (result, what is passed on). Of several
    children that is `joined`, by default added; `nothing` arrives at tips."""
    joined = joined or _added
    arrived, results = {}, []
    for bundle, numbers in zip(reversed(state.bundles), reversed(own), strict=True):
        ends = [i + bundle.length - 1 for i in bundle.starts]
        start = _beside([arrived.pop(i, nothing) for i in ends], state.n)
        result, passed = _run(step, bundle, state.n, numbers, start, reverse=True)
        for c, parent in enumerate(bundle.parents):
            if parent >= 0:
                mine = _chain(passed, c)
                arrived[parent] = shared(joined)(arrived[parent], mine) if parent in arrived else mine
        results.append(result)
    return results[::-1]


def _added(a, b):
    leaves, tree = jax.tree.flatten(a, is_leaf=is_number)
    return jax.tree.unflatten(tree, vectors.plus(tuple(leaves), tuple(jax.tree.leaves(b, is_leaf=is_number))))


def _chain(tree, c):
    """Of one of the chains: numbers (1, B)."""
    return along.mapped_tree(lambda word: word[c : c + 1], tree)


def _beside(trees, n):
    """The states of chains side by side, (W, B): one tree where all are the same."""
    same = all(tree is trees[0] for tree in trees)
    return trees[0] if same else along.concatenated_trees(trees, n)


def _run(step, bundle, n, numbers, start, reverse):
    """(the results of step(numbers, state), stacked along the chain, the last state)."""
    numbers = along.mapped_tree(functools.partial(_along, bundle.length), numbers)
    if bundle.length == 1:
        first = along.mapped_tree(lambda word: word[0], numbers)
        result, last = shared(step)(first, start)
        spread = functools.partial(along.mapped_tree, lambda word: jnp.broadcast_to(word, (bundle.width, n)))
        return along.mapped_tree(lambda word: word[None], result), spread(last)
    return _loop(step, numbers, start, (bundle.width, n), reverse)


def _along(length, word):
    """(L, ..., W, B), of what may be one for all: double words are never known."""
    return word if word.ndim >= 3 else jnp.broadcast_to(word, (length, 1, 1))


def _loop(step, numbers, start, shape, reverse):
    """A loop over the bodies of chains. A known number of the state that a step changes is none: tried again, with it
    as data, until nothing changes."""
    given, tree = jax.tree.flatten(start, is_leaf=is_number)
    while True:
        found = _tried(step, numbers, given, tree, shape, reverse)
        if not any(found.changed):
            return found.results, found.last
        given = [along.spread(x, shape) if c else x for x, c in zip(given, found.changed, strict=True)]


class _Tried:
    """What a loop found: its results, the last state, and which known numbers of the state have changed."""

    results, last, changed = None, None, ()


def _tried(step, numbers, given, tree, shape, reverse):
    leaves, own_tree = jax.tree.flatten(numbers, is_leaf=is_number)
    given = [x if along.is_constant(x) else along.spread(x, shape) for x in given]
    found, form = _Tried(), []

    def body(carry, own):
        state = jax.tree.unflatten(tree, with_data(given, carry))
        result, new = step(jax.tree.unflatten(own_tree, with_data(leaves, own)), state)
        new = jax.tree.leaves(new, is_leaf=is_number)
        found.changed = [along.is_constant(x) and not along.alike([x, y]) for x, y in zip(given, new, strict=True)]
        form[:] = jax.tree.flatten(result, is_leaf=is_number)
        kept = [along.spread(y, shape) for x, y in zip(given, new, strict=True) if not along.is_constant(x)]
        return data_of(kept), data_of(form[0])

    # A pull-back runs steps again: it reads what it would have to keep of them more slowly.
    step_again = jax.checkpoint(body, prevent_cse=False)
    last, stacked = lax.scan(step_again, data_of(given), data_of(leaves), reverse=reverse)
    found.results = jax.tree.unflatten(form[1], with_data(form[0], stacked))
    found.last = jax.tree.unflatten(tree, with_data(given, last))
    return found
