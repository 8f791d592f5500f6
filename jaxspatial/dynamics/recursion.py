"""From the base to the tips and back, bundle by bundle: the one place that knows how a recursion over a tree runs.

Chains of equal length that hang side by side are one `loop`, and so are those that come after them, see `Bundle`.
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import flattened, noinline
from jaxspatial.dynamics import along
from jaxspatial.dynamics.loop import Join, Step, Turns, run
from jaxspatial.dynamics.state import MechanismState
from jaxspatial.mechanism.topology import Bundle


def outward(state: MechanismState, step: Step, root: Any, own: Sequence[Any]) -> list[Any]:
    """The results of every bundle: step(own, the state of the parent) gives (result, state of the body), with `root`
    for the state of the world."""
    results, ends = list[Any](), {-1: _of_world(root)}
    for bundle, numbers in zip(state.bundles, own, strict=True):
        first = bundle.groups[0]
        start = [ends[i] for i in bundle.by_column(first, first.parents)]
        turns = _turns(state, bundle, ends, start[0], _replaced, reverse=False)
        result, last, kept = run(step, bundle, state.n, numbers, _beside(start, state.n), turns)
        ends |= {i: _chain(kept, k) for i, k in turns.rows.items() if i not in ends}
        ends |= {i: _chain(last, c) for c, i in enumerate(bundle.groups[-1].ends)}
        results.append(result)
    return results


def inward(
    state: MechanismState, step: Step, nothing: Any, own: Sequence[Any], joined: Join | None = None
) -> list[Any]:
    """The results of every bundle: step(own, what its children pass on) gives (result, what is passed on). Of several
    children that is `joined`, by default added; `nothing` arrives at tips."""
    arrived, results, joined = dict[int, Any](), list[Any](), joined or _added
    for bundle, numbers in zip(reversed(state.bundles), reversed(own), strict=True):
        first, last = bundle.groups[0], bundle.groups[-1]
        start = [arrived.pop(i, nothing) for i in bundle.by_column(last, last.ends)]
        turns = _turns(state, bundle, arrived, nothing, joined, reverse=True)
        result, passed, kept = run(step, bundle, state.n, numbers, _beside(start, state.n), turns)
        arrived |= {i: _chain(kept, k) for i, k in turns.rows.items() if i not in bundle.ends}
        for c, parent in enumerate(first.parents):
            if parent >= 0:
                mine = _chain(passed, c)
                arrived[parent] = noinline(joined)(arrived[parent], mine) if parent in arrived else mine
        results.append(result)
    return results[::-1]


def _replaced(_: Any, new: Any) -> Any:
    return new


def _added(a: Any, b: Any) -> Any:
    (left, form), (right, _) = map(flattened, (a, b))
    return jax.tree.unflatten(form, vectors.plus(tuple(left), tuple(right)))


def _of_world(root: Any) -> Any:
    """Numbers of the world, (B,) as gravity is, as one chain's."""
    return along.mapped_tree(lambda word: word.reshape((1, -1)), root)


def _chain(tree: Any, c: int) -> Any:
    """Of one of the chains, or one row of a memory: numbers (1, B)."""
    return along.mapped_tree(lambda word: word[c : c + 1], tree)


def _beside(trees: Sequence[Any], n: int) -> Any:
    """The states of chains side by side, (W, B): one tree where all are the same."""
    same = all(tree is trees[0] for tree in trees)
    return trees[0] if same else along.concatenated_trees(trees, n)


# -- where one group of chains ends and another begins ----------------------------------------------------------------


def _turns(state: MechanismState, bundle: Bundle, found: dict[int, Any], nothing: Any, joined: Join, reverse: bool):
    """Turns of a loop outward, or in reverse: what is found of bodies that groups meet at, else nothing, is kept."""
    meet = [i for g in bundle.groups[1:] for i in g.parents]
    meet += [i for g in bundle.groups[:-1] for i in g.ends if state.topology.children[i]]
    rows = {i: k + 2 for k, i in enumerate(dict.fromkeys(meet))}
    kept = _beside([nothing, nothing, *(found.get(i, nothing) for i in rows)], state.n) if rows else None
    at, put, get = (np.zeros(shape, int) for shape in ((bundle.length,), *[bundle.bodies.shape] * 2))
    for row, end, begin in _meetings(bundle, reverse):
        at[row] = 1
        twins = [1] * (bundle.width - len(end))
        put[row], get[row] = [rows.get(i, 1) for i in end] + twins, [rows.get(i, 0) for i in begin]
    return Turns(kept, rows, at, put, get, joined, reverse)


def _meetings(bundle: Bundle, reverse: bool) -> Iterator[tuple[int, Sequence[int], Sequence[int]]]:
    """(the row after which a group ends, the bodies that its chains meet others at, those of the chains that begin)."""
    first = 0
    for a, b in itertools.pairwise(bundle.groups):
        first += a.length
        yield (
            (first, b.parents, bundle.by_column(a, a.ends))
            if reverse
            else (first - 1, a.ends, bundle.by_column(b, b.parents))
        )
