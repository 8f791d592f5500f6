"""Matrices by columns that travel to the base: what happens at one joint, as all between it and the base feel it.

The columns of all bodies behind a body are carried to its parent at once, as numbers that are arrays over columns. They
are in the order of bodies, depth first, those of a mimic among them, so that the ones behind a body follow its own.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.numbers import shared
from jaxspatial.dynamics import recursion


class Matrix(NamedTuple):
    """What bodies add: `size(segment)` columns of `width` numbers each.

    own(numbers of a body): its columns. felt(place, numbers, columns): a row for each rate of its joint; place: which
    body of its segment it is. passed(numbers, one column): the column as the parent has it.
    """

    size: Callable | None
    width: int
    own: Callable
    felt: Callable[..., Any]
    passed: Callable


def blocks(scene, matrix, numbers):
    """The rows of every segment, each from its own first column to the last one behind it: [(where it starts, rows)].

    numbers: those of every segment
    """
    arrived, found, start = {}, [], sum(map(matrix.size, scene.segments))
    step = functools.partial(_step, matrix)
    for segment, own in zip(reversed(scene.segments), reversed(numbers), strict=True):
        start -= matrix.size(segment)
        mine = [_zeros(scene, matrix.size(segment), matrix.width)]
        columns = recursion.concatenated([*mine, *arrived.pop(segment.stop - 1, [])])
        places = jnp.arange(segment.stop - segment.start, dtype=np.int32)
        if segment.is_chain:
            rows, columns = recursion.along(step, (places, own), columns, reverse=True)
        else:
            rows, columns = shared(step)((places[0], own), columns)
        arrived[segment.parent] = [columns, *arrived.get(segment.parent, [])]
        found.append((start, [scene.rounded(row) for row in rows]))
    return found[::-1]


def _step(matrix, own, columns):
    """(the rows of one body, the columns as its parent has them), with its own put among those behind it."""
    place, numbers = own
    mine = [column[: matrix.width] for column in matrix.own(numbers)]
    for k, column in enumerate(mine):
        columns = recursion.with_column(columns, place * len(mine) + k, column)
    return matrix.felt(place, numbers, columns), recursion.each_column(matrix.passed, numbers, columns)


def _zeros(scene, n, width):
    return tuple(recursion.repeated_along(scene.known(0.0), n) for _ in range(width))


# -- put together -----------------------------------------------------------------------------------------------------


def whole(found, n_columns):
    """(rows, n_columns) of blocks, zeros in front of each."""
    return jnp.concatenate([_padded(start, rows, n_columns) for start, rows in found])


def _padded(start, rows, n):
    """The rows of a segment, those of one body after those of the one before, in full length."""
    interleaved = jnp.stack(rows, -2).reshape((-1, rows[0].shape[-1]))
    return jnp.pad(interleaved, ((0, 0), (start, n - start - interleaved.shape[1])))


def rows_of_masters(scene, M):
    """What the joint of a mimic feels, its master's does."""
    starts, masters, kept = _mimics(scene.topology)
    for i, master in masters:
        M = M.at[master].add(scene.mechanism.mimics[i, 0].astype(M.dtype) * M[starts[i]])
    return M[np.array(kept)] if masters else M


def without_mimics(scene, M):
    """What the rate of a mimic does, its master's does, too."""
    return rows_of_masters(scene, rows_of_masters(scene, M).T).T


def _mimics(t):
    """(where the rates of each joint are among those of all, [(mimic, where its master is)], the rates to keep)."""
    starts = np.cumsum([0, *(t.kind(i).nv for i in range(len(t)))])
    mimics = [i for i in range(len(t)) if t.is_mimic(i)]
    left = {starts[i] for i in mimics}
    return starts, [(i, starts[t.masters[i]]) for i in mimics], [k for k in range(starts[-1]) if k not in left]
