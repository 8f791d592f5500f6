"""Matrices by pairs: each entry of one joint, and of one that carries it.

An entry needs the two joints alone, in the axes of the root that carries both, with positions from there: entries
of two bundles, of all pairs of their bodies, are one operation. Nothing is propagated from body to body.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import numbers
from jaxspatial.arithmetic.numbers import Number, Numbers, Three, noinline
from jaxspatial.dynamics import along, recursion
from jaxspatial.dynamics.kinematics import composed, world
from jaxspatial.dynamics.links import across
from jaxspatial.dynamics.state import JointState, MechanismState, Pose
from jaxspatial.mechanism.topology import Chains

Entry = Callable[[Any, Any], Numbers]
# (chain of the column, chain of the row that carries it).
Chained = list[tuple[int, int]]
Sides = Sequence[tuple[int, Any]]


def matrices(state: MechanismState, entry: Entry, rows: Sides, columns: Sides) -> Numbers:
    """Matrices (rows, columns, B), as numbers, of `entry(row, column)`, a tuple of numbers: 0 where the joint of the
    row does not carry the body of the column.

    rows, columns: for every bundle (k, a tree of numbers (k, L, W, B)), of k rates of its joint, or of whatever a body
    has k columns of; without the first axis where numbers are the same for all.
    """
    chains = state.topology.chains
    sizes = [[_count(state, y, group) * group.length for group in chains] for y in (rows, columns)]
    starts = [_starts(state, y) for y in (rows, columns)]
    rows, columns = ([_of_chains(state, y, group) for group in chains] for y in (rows, columns))
    whole: Numbers = ()
    for b, column in enumerate(columns):
        for a, both in state.topology.carriers(b).items():
            if rows[a] is not None and column is not None:
                shape = sizes[0][a], sizes[1][b], len(both), state.n
                block = _block(entry, rows[a], column, both, shape)
                block = [_upper(x, chains[a].length) for x in block] if a == b else block
                whole = _with_block(state, whole or _zeros(state, block, starts), block, starts, a, b, both)
    return whole


def _place(state: MechanismState, group: Chains):
    return state.topology.places[group.starts[0]]


def _count(state: MechanismState, trees: Sides, group: Chains):
    return trees[_place(state, group)[0]][0]


def _starts(state: MechanismState, trees: Sides):
    """Where the rows of each body begin, and their number."""
    t = state.topology
    return np.cumsum([0, *(trees[t.places[i][0]][0] for i in range(len(t)))])


def _of_chains(state: MechanismState, trees: Sides, group: Chains) -> Any:
    """Of trees of all bundles that of one group of chains, of numbers (rows, W, B); None without rows."""
    b, first, _ = _place(state, group)
    k, tree = trees[b]
    flat = functools.partial(_flat, group, k, first)
    return along.mapped_tree(flat, tree) if k else None


def _flat(group: Chains, k: int, first: int, word: jax.Array):
    """The rows of all bodies of a chain as one axis: (L k, W, B)."""
    if word.ndim >= 3:
        word = word[..., first : first + group.length, : group.width, :]
    full = jnp.broadcast_to(word, (k, group.length, *np.broadcast_shapes(word.shape[-2:], (1, 1))))
    return jnp.moveaxis(full, 0, 1).reshape((-1, *full.shape[2:]))


def _block(entry: Entry, row: Any, column: Any, chains: Chained, shape: tuple[int, ...]) -> list[Number]:
    """Numbers (rows, columns, W, B), of pairs (chain of the column, chain of the row)."""
    of_columns, of_rows = zip(*chains, strict=True)
    row = along.mapped_tree(lambda w: _picked(w, of_rows)[:, None], row)
    found = noinline(entry)(row, along.mapped_tree(lambda w: _picked(w, of_columns)[None], column))
    return [along.spread(x, shape) for x in found]


def _picked(w: jax.Array, chains: tuple[int, ...]):
    if chains == tuple(range(w.shape[1])) or w.shape[1] == 1:
        return w
    return w[:, chains[0] : chains[0] + 1] if len(set(chains)) == 1 else jnp.stack([w[:, c] for c in chains], 1)


def _upper(x: Number, length: int):
    """Of one chain: 0 where the body of the column comes before that of the row."""
    n, m = numbers.shape_of(x)[:2]
    is_behind = np.arange(m)[None, :] // (m // length) >= np.arange(n)[:, None] // (n // length)
    return numbers.where(jnp.asarray(is_behind[:, :, None, None]), x, 0.0)


def _zeros(state: MechanismState, block: list[Number], starts: list[np.ndarray]):
    shape = int(starts[0][-1]), int(starts[1][-1]), state.n
    return [numbers.mapped(lambda w: jnp.zeros(shape, w.dtype), x) for x in block]


def _with_block(
    state: MechanismState, whole: Numbers, block: Numbers, starts: list[np.ndarray], a: int, b: int, chains: Chained
):
    """The matrices with the entries of one pair of bundles."""
    of_rows, of_columns = (state.topology.chains[k].starts for k in (a, b))
    for k, (c, mine) in enumerate(chains):
        place = int(starts[0][of_rows[mine]]), int(starts[1][of_columns[c]]), 0
        whole = [_put(x, y, k, place) for x, y in zip(whole, block, strict=True)]
    return whole


def _put(whole: Number, block: Number, k: int, place: tuple[int, int, int]):
    return numbers.mapped(lambda x, y: jax.lax.dynamic_update_slice(x, y[:, :, k], place), whole, block)


def by_rates(state: MechanismState, x: Number, axis: int):
    """Of a matrix over the rates of all joints, along an axis, that over v: the force on a mimic, times its multiplier,
    acts on the joint that it follows."""
    t = state.topology
    if not t.has_mimics:
        return x
    bodies = np.repeat(np.arange(len(t)), [t.kind(i).nv for i in range(len(t))])
    first = along.mapped(lambda w: jnp.moveaxis(w, axis, 0), x)
    found = state.following(first, np.array(t.v_starts)[bodies], bodies)
    return along.mapped(lambda w: jnp.moveaxis(w, 0, axis), found)


# -- where joints are, seen from the root -----------------------------------------------------------------------------


def from_root(state: MechanismState) -> list[Pose]:
    """The Pose of every bundle: in the axes of the world, and from the root that carries it."""
    own = [(state.placement(b), joint, b.is_on_world) for b, joint in zip(state.bundles, state.joints, strict=True)]
    return recursion.outward(state, _from_root, world(state), own)


def _from_root(own: tuple[Pose, JointState, bool], parent: Pose):
    placement, joint, is_root = own
    X = composed(parent, across(placement, joint))
    found = Pose(X.rows, at_root(is_root, X.p))
    return found, found


def at_root(is_root: bool, vector: Three) -> Three:
    """Zero for roots."""
    return tuple(numbers.constant(x, 0) for x in vector) if is_root else vector
