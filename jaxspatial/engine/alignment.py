"""Aligns joint frames so that a known axis along x, y or z, in either direction, becomes z.

Frame J becomes J', by a rotation by a multiple of 90 degrees about each axis: a signed permutation, which moves and
negates numbers and rounds none. Fields in the axes of J become those in the axes of J'; results in world axes, and
generalized velocities, are the same.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxspatial.engine.stacking import Array
from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics.linear import PLACES, WHICH_OF_SIX

# (which, sign): see `signed_permutations`.
SignedPermutations = tuple[np.ndarray, np.ndarray]


def aligned(topology: Topology, fields: dict[str, Any]) -> tuple[dict[str, Any], SignedPermutations | None]:
    """(the fields by name, as arrays over bodies in the axes of J'; the `signed_permutations` to these axes).

    Transforms become (entries, translation), inertias (mass, com, central).
    """
    fields = {name: _parts(name, x) for name, x in fields.items()}
    permutations = signed_permutations(topology, fields.get("axes"))
    if permutations is not None:
        fields = {name: _in_aligned_axes(topology, permutations, name, x) for name, x in fields.items()}
    return fields, permutations


def _parts(name: str, x):
    if name in ("placements", "child_placements", "frame_placements"):
        return x.rotation.entries, x.translation
    if name in ("inertias", "weld_inertias"):
        return x.mass[:, None], x.com, x.central
    return x[:, None] if name == "pitches" else x


def signed_permutations(topology: Topology, axes: Array | None) -> SignedPermutations | None:
    """(which, sign), (n, 3) each: component k of a vector in J' is sign[k] times its component which[k] in J.

    None if all are the identity.
    """
    if not isinstance(axes, np.ndarray):
        return None
    which, sign = np.tile(np.arange(3), (len(axes), 1)), np.ones((len(axes), 3), axes.dtype)
    for i, axis in enumerate(axes):
        if topology.kind(i).is_about_one_axis and sorted(abs(axis)) == [0, 0, 1]:
            k = int(np.flatnonzero(axis)[0])
            which[i], sign[i] = np.roll(np.arange(3), 2 - k), (1, 1, 1) if axis[k] > 0 else (1, -1, -1)
    return None if (which == np.arange(3)).all() and (sign == 1).all() else (which, sign)


def of_parameters(permutations: SignedPermutations) -> SignedPermutations:
    """The permutations (n, 10) of the ten dynamic parameters of bodies."""
    (which, sign), (which6, sign6) = permutations, _of_symmetric(permutations)
    zero, one = np.zeros((len(which), 1), int), np.ones((len(which), 1), sign.dtype)
    return np.concatenate([zero, 1 + which, 4 + which6], 1), np.concatenate([one, sign, sign6], 1)


def _in_aligned_axes(topology: Topology, permutations: SignedPermutations, name: str, x):
    _, sign = permutations
    world = np.arange(3), np.ones(3, sign.dtype)

    def of(bodies: Sequence[int]) -> SignedPermutations:
        picked = ([t[i] if i >= 0 else w for i in bodies] for t, w in zip(permutations, world, strict=True))
        which, sign = (np.array(x).reshape((-1, 3)) for x in picked)
        return which, sign

    if name == "placements":
        parents = of(topology.parents)
        return _permuted(x[0], _of_matrices(parents, permutations)), _permuted(x[1], parents)
    if name in ("child_placements", "frame_placements"):
        bodies = permutations if name == "child_placements" else of([body for _, body in topology.frames])
        return _permuted(x[0], _of_matrices(bodies, of([-1] * len(bodies[0])))), _permuted(x[1], bodies)
    if name == "inertias":
        return x[0], _permuted(x[1], permutations), _permuted(x[2], _of_symmetric(permutations))
    return _permuted(x, permutations) if name == "axes" else x


def _permuted(x: Array, permutations: SignedPermutations) -> Array:
    """An array (n, k, ...) with its k components permuted, and their signs changed."""
    which, sign = permutations
    return x[np.arange(len(which))[:, None], which] * sign.astype(x.dtype).reshape((*sign.shape, *[1] * (x.ndim - 2)))


def _of_matrices(rows: SignedPermutations, columns: SignedPermutations) -> SignedPermutations:
    """The permutations (n, 9) of matrices by rows."""
    (i, sign_i), (k, sign_k) = rows, columns
    places, sign = 3 * i[:, :, None] + k[:, None, :], sign_i[:, :, None] * sign_k[:, None, :]
    return places.reshape((-1, 9)), sign.reshape((-1, 9))


def _of_symmetric(permutations: SignedPermutations) -> SignedPermutations:
    """The permutations (n, 6) of symmetric matrices, the lower triangle by rows."""
    (which, sign), (rows, columns) = permutations, np.transpose(PLACES)
    return np.array(WHICH_OF_SIX)[which[:, rows], which[:, columns]], sign[:, rows] * sign[:, columns]
