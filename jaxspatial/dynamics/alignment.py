"""Joints turned to a common axis: z, where their own is known to be one of their frame's.

Frame J becomes J', by a rotation of quarter turns, which moves and negates numbers and rounds none. What is given in
the axes of J is given in those of J'; results in axes of the world, and rates, are the same.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxspatial.dynamics.along import Array
from jaxspatial.mechanism.topology import Topology

# Where the entries of a symmetric matrix are among its six, and these in it.
_SYMMETRIC = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])
_ROWS, _COLUMNS = np.array([0, 1, 1, 2, 2, 2]), np.array([0, 0, 1, 0, 1, 2])

# (which, sign): see `quarter_turns`.
QuarterTurns = tuple[np.ndarray, np.ndarray]


def aligned(topology: Topology, fields: dict[str, Any]) -> tuple[dict[str, Any], QuarterTurns | None]:
    """(the fields as arrays over bodies, by name, transforms as (entries, translation), inertias as (mass, com,
    central), all of them in the axes of J'; the `quarter_turns` to these)."""
    fields = {name: _parts(name, x) for name, x in fields.items()}
    turns = quarter_turns(topology, fields.get("axes"))
    if turns is not None:
        fields = {name: _in_aligned_axes(topology, turns, name, x) for name, x in fields.items()}
    return fields, turns


def _parts(name: str, x: Any) -> Any:
    if name in ("placements", "child_placements", "frame_placements"):
        return x.rotation.entries, x.translation
    if name == "inertias":
        return x.mass[:, None], x.com, x.central
    return x[:, None] if name == "pitches" else x


def quarter_turns(topology: Topology, axes: Array | None) -> QuarterTurns | None:
    """(which, sign), (n, 3) each: component k of a vector in J' is sign[k] times component which[k] of it in J. None
    where nothing turns."""
    if not isinstance(axes, np.ndarray):
        return None
    which, sign = np.tile(np.arange(3), (len(axes), 1)), np.ones((len(axes), 3), axes.dtype)
    for i, axis in enumerate(axes):
        if topology.kind(i).is_about_one_axis and sorted(abs(axis)) == [0, 0, 1]:
            k = int(np.flatnonzero(axis)[0])
            which[i], sign[i] = np.roll(np.arange(3), 2 - k), (1, 1, 1) if axis[k] > 0 else (1, -1, -1)
    return None if (which == np.arange(3)).all() and (sign == 1).all() else (which, sign)


def of_parameters(turns: QuarterTurns) -> QuarterTurns:
    """(which, sign), (n, 10) each: the same for the ten dynamic parameters of bodies."""
    which, sign = turns
    n = len(which)
    one = np.zeros((n, 1), int), np.ones((n, 1), sign.dtype)
    six = _SYMMETRIC[which[:, _ROWS], which[:, _COLUMNS]], sign[:, _ROWS] * sign[:, _COLUMNS]
    return np.concatenate([one[0], 1 + which, 4 + six[0]], 1), np.concatenate([one[1], sign, six[1]], 1)


def _in_aligned_axes(topology: Topology, turns: QuarterTurns, name: str, x: Any) -> Any:
    _, sign = turns
    world = np.arange(3), np.ones(3, sign.dtype)

    def of(bodies: Sequence[int]) -> QuarterTurns:
        found = ([t[i] if i >= 0 else w for i in bodies] for t, w in zip(turns, world, strict=True))
        which, sign = (np.array(x).reshape((-1, 3)) for x in found)
        return which, sign

    if name == "placements":
        parents = of(topology.parents)
        return _matrices(x[0], *parents, *turns), _vectors(x[1], *parents)
    if name in ("child_placements", "frame_placements"):
        own = turns if name == "child_placements" else of([body for _, body in topology.frames])
        n = len(own[0])
        return _matrices(x[0], *own, *(np.tile(w, (n, 1)) for w in world)), _vectors(x[1], *own)
    if name == "inertias":
        return x[0], _vectors(x[1], *turns), _symmetric(x[2], *turns)
    return _vectors(x, *turns) if name == "axes" else x


def _vectors(x: Array, which: np.ndarray, sign: np.ndarray) -> Array:
    """Of (n, 3, ...)."""
    return x[np.arange(len(which))[:, None], which] * _beside(sign, x)


def _matrices(
    x: Array, of_rows: np.ndarray, sign_of_rows: np.ndarray, of_columns: np.ndarray, sign_of_columns: np.ndarray
) -> Array:
    """Of (n, 9, ...), by rows."""
    n = len(of_rows)
    places = (3 * of_rows[:, :, None] + of_columns[:, None, :]).reshape((n, 9))
    sign = (sign_of_rows[:, :, None] * sign_of_columns[:, None, :]).reshape((n, 9))
    return x[np.arange(n)[:, None], places] * _beside(sign, x)


def _symmetric(x: Array, which: np.ndarray, sign: np.ndarray) -> Array:
    """Of (n, 6, ...), the lower triangle by rows."""
    places, signs = _SYMMETRIC[which[:, _ROWS], which[:, _COLUMNS]], sign[:, _ROWS] * sign[:, _COLUMNS]
    return x[np.arange(len(which))[:, None], places] * _beside(signs, x)


def _beside(sign: np.ndarray, x: Array):
    return sign.astype(x.dtype).reshape((*sign.shape, *[1] * (x.ndim - 2)))
