"""Matrices over pairs of joints, such as the mass matrix, and the solution of linear equations.

An entry depends only on its two joints, one of which carries the other. Both are expressed in world axes, with
positions from the root that carries both, so nothing is propagated from body to body: the entries of all pairs of
bodies of two bundles are one operation.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.engine import recursion, stacking
from jaxspatial.engine.state import JointState, MechanismState, across
from jaxspatial.mechanism.topology import Chains
from jaxspatial.numerics import floats, numbers
from jaxspatial.numerics.linear import Pose, Vector
from jaxspatial.numerics.numbers import (
    Number,
    Numbers,
    as_data,
    data_of,
    high,
    mapped,
    where,
    with_data,
)
from jaxspatial.spatial.algebra import composed

Entry = Callable[[Any, Any], Numbers]
# For every bundle (k, tree of numbers), see `matrices`.
Sides = Sequence[tuple[int, Any]]


def matrices(state: MechanismState, entry: Entry, rows: Sides, columns: Sides, count: int = 1) -> Numbers:
    """Assembles matrices (rows, columns, B), one for each of the `count` numbers of the tuple `entry(row, column)`.

    Entries are 0 where the joint of the row does not carry the body of the column.

    rows, columns: for every bundle (k, a tree of numbers (k, L, W, B)); k is the number of velocities of its joint, or
    of columns per body. Numbers that are the same for all k may lack the first axis.
    """
    t = state.topology
    # The first row of each body, and at the end the number of rows.
    starts = [np.cumsum([0, *(y[t.places[i][0]][0] for i in range(len(t)))]) for y in (rows, columns)]
    of_rows, of_columns = ([_of_chains(state, y, group) for group in t.chains] for y in (rows, columns))
    whole: Numbers = ()
    for b, (n_columns, column) in enumerate(of_columns):
        for a, pairs in t.carriers(b).items():
            n_rows, row = of_rows[a]
            if not (n_rows and n_columns):
                continue
            chains_b, chains_a = zip(*pairs, strict=True)
            on_a = stacking.mapped(lambda w, chains=chains_a: _picked(w, chains)[:, None], row)
            on_b = stacking.mapped(lambda w, chains=chains_b: _picked(w, chains)[None], column)
            block = [stacking.spread(x, (n_rows, n_columns, len(pairs), state.n)) for x in entry(on_a, on_b)]
            if a == b:
                # Of one chain with itself: 0 where the body of the column comes before that of the row.
                of_row, of_column = (np.arange(n) // (n // t.chains[a].length) for n in (n_rows, n_columns))
                is_behind = jnp.asarray((of_column >= of_row[:, None])[:, :, None, None])
                block = [where(is_behind, x, 0.0) for x in block]
            full = *(int(x[-1]) for x in starts), state.n
            whole = whole or [mapped(lambda w: jnp.zeros(full, w.dtype), x) for x in block]  # noqa: B023
            for k, (c, r) in enumerate(pairs):
                place = int(starts[0][t.chains[a].starts[r]]), int(starts[1][t.chains[b].starts[c]]), 0
                put: Callable = lambda w, x, k=k, at=place: lax.dynamic_update_slice(w, x[:, :, k], at)  # noqa: E731
                whole = [mapped(put, x, y) for x, y in zip(whole, block, strict=True)]
    return whole or [state.zeros(int(starts[0][-1]), int(starts[1][-1]))] * count


def _of_chains(state: MechanismState, trees: Sides, group: Chains) -> tuple[int, Any]:
    """(the number of rows of one chain, the numbers (rows, W, B) of all chains of a group)."""
    b, first, _ = state.topology.places[group.starts[0]]
    k, tree = trees[b]

    def flat(word: jax.Array) -> jax.Array:
        """The rows of all bodies of a chain as one axis: (L k, W, B)."""
        if word.ndim >= 3:
            word = word[..., first : first + group.length, : group.width, :]
        full = jnp.broadcast_to(word, (k, group.length, *floats.broadcast_shapes(word.shape[-2:], (1, 1))))
        return jnp.moveaxis(full, 0, 1).reshape((-1, *full.shape[2:]))

    return k * group.length, stacking.mapped(flat, tree) if k else None


def _picked(w: jax.Array, chains: tuple[int, ...]) -> jax.Array:
    """w[:, chains], without a copy where possible."""
    if chains == tuple(range(w.shape[1])) or w.shape[1] == 1:
        return w
    return w[:, chains[0] : chains[0] + 1] if len(set(chains)) == 1 else jnp.stack([w[:, c] for c in chains], 1)


def by_velocity(state: MechanismState, x: Number, axis: int) -> Number:
    """Reduces an axis over the velocities of all joints to one over v.

    The force on a mimic acts, times its multiplier, on the joint that it follows.
    """
    t = state.topology
    if not t.has_mimics:
        return x
    bodies = np.repeat(np.arange(len(t)), [t.kind(i).nv for i in range(len(t))])
    first = stacking.mapped(lambda w: jnp.moveaxis(w, axis, 0), x)
    result = state.fold_mimics(first, np.array(t.v_starts)[bodies], bodies)
    return stacking.mapped(lambda w: jnp.moveaxis(w, 0, axis), result)


def symmetric_of(upper: Number) -> Number:
    """The symmetric matrix with this upper triangle."""
    n = numbers.shape_of(upper)[0]
    is_upper = jnp.asarray(np.triu(np.ones((n, n), bool))[:, :, None])
    return where(is_upper, upper, transposed(upper))


def transposed(x: Number) -> Number:
    return stacking.mapped(lambda w: jnp.swapaxes(w, 0, 1), x)


# -- poses from the root ----------------------------------------------------------------------------------------------


def poses_from_root(state: MechanismState) -> list[Pose]:
    """The Pose of every bundle: in the axes of the world, with positions from the root that carries it."""

    def step(link: tuple[Pose, JointState, bool], parent: Pose) -> tuple[Pose, Pose]:
        placement, joint, is_root = link
        X = composed(parent, across(placement, joint))
        X = Pose(X.R, zero_at_root(is_root, X.p))
        return X, X

    links = [(state.placement(b), joint, b.is_on_world) for b, joint in zip(state.bundles, state.joints, strict=True)]
    return recursion.outward(state, step, state.world, links)


def zero_at_root(is_root: bool, v: Vector) -> Vector:
    """v, or known zeros for a root."""
    return Vector(*(numbers.constant(x, 0) for x in v)) if is_root else v


# -- linear equations -------------------------------------------------------------------------------------------------


def inverse_times(M: Number, b: Number) -> Number:
    """M^-1 b for a symmetric positive M (n, n, ...) and b (n, ...), by Gauss-Jordan elimination in a loop.

    Where a pivot is not positive, the unknown is 0. Error: n u cond(M) times a small number.
    [Golub and Van Loan 2013, 4.1: Gauss and Jordan]
    """
    n, *shape = numbers.shape_of(b)
    # The right side is one more column, the last.
    parts = stacking.spread(M, (n, n, *shape)), stacking.spread(mapped(lambda w: w[:, None], b), (n, 1, *shape))
    start = as_data(mapped(lambda *words: jnp.concatenate(words, 1), *parts))
    last = jnp.arange(n + 1).reshape((1, -1, *[1] * len(shape))) == n

    def turn(k: jax.Array, data: list) -> list:
        """Eliminates one unknown; its own equation stays."""
        whole = with_data(start, data)
        row, column = (_slice(whole, k, axis) for axis in (0, 1))
        here = (jnp.arange(n, dtype=np.int32) == k).reshape((n, 1, *[1] * len(shape)))
        pivot = _slice(row, k, 1)
        is_none = high(pivot) <= 0
        scale = where(is_none, 0.0, 1 / where(is_none, 1.0, pivot))
        factor = where(here, scale * 0.0, column * scale)
        after = where(here & last, where(is_none, 0.0, whole), whole - factor * row)
        return data_of(as_data(after))

    whole = with_data(start, lax.fori_loop(0, n, turn, data_of(start)))
    diagonal = stacking.concatenated([mapped(lambda w, k=k: w[k, k][None], whole) for k in range(n)])
    is_none = high(diagonal) <= 0
    return where(is_none, 0.0, mapped(lambda w: w[:, n], whole) / where(is_none, 1.0, diagonal))


def _slice(x: Number, k, axis: int) -> Number:
    return mapped(lambda w: lax.dynamic_slice_in_dim(w, k, 1, axis), x)
