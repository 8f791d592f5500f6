"""Finds joints of a mechanism along which nothing has inertia, so that no torque accelerates them."""

from typing import Any

import numpy as np

from jaxspatial.mechanism.formats.source import NO_INERTIA, ModelText
from jaxspatial.numerics import eigen
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.rotation import Rotation

# What is smaller than this share of what masses could make at their distances is rounding.
_LEAST = 1e-12


def doubt_weightless(file: ModelText, mechanism: Any):
    """Names the joints along which nothing has inertia in the warning of a file."""
    t = mechanism.topology
    weightless = set(_weightless(mechanism))
    for i in weightless:
        # The coordinate of a joint moves those that follow it, too.
        moved = {k for k in range(len(t)) if t.followed[k] == i and (k == i or mechanism.mimics[k, 0] != 0)}
        if not t.is_mimic(i) and moved <= weightless:
            file.doubt(NO_INERTIA, t.joint_names[i])


def _weightless(mechanism: Any) -> list[int]:
    """The joints with a velocity along which what they carry has no inertia, at coordinates that were drawn."""
    t, M = mechanism.topology, mechanism.inertias
    n, mass = len(t), np.asarray(M.mass, float)
    central = np.asarray(eigen.matrix_of_six(M.central), float)
    largest = abs(central).max((1, 2), initial=0.0)
    smallest = np.linalg.eigvalsh(central)[:, :1].min(1, initial=np.inf)
    # A solid body has inertia along everything that moves it.
    is_solid = (mass > 0) & (smallest > _LEAST * largest)
    carried: list[list[int]] = [[] for _ in range(n)]
    for i in range(n):
        for k in t.ancestors(i):
            carried[k].append(i)
    # Rotors may give every velocity of a joint inertia.
    has_rotors = [bool((np.asarray(mechanism.armature)[t.v_slice(i)] > 0).all()) for i in range(n)]
    suspects = [i for i in range(n) if not is_solid[carried[i]].any() and not has_rotors[i]]
    if not suspects:
        return []
    axes, R, p, C, c = _drawn_poses(mechanism, central)
    found: list[int] = []
    for i in suspects:
        behind = carried[i]
        d = c[behind] - p[i]
        size = (mass[behind] * (d * d).sum(1) + largest[behind]).sum()
        turns, slides = _motions(t.kinds[i], axes[i], R[i])
        rotary = [(mass[behind] * (np.cross(w, d) ** 2).sum(1)).sum() + w @ C[behind].sum(0) @ w for w in turns]
        if any(x <= _LEAST * size for x in rotary) or (len(slides) and not mass[behind].any()):
            found.append(i)
    return found


def _drawn_poses(mechanism: Any, central: np.ndarray):
    """(axes, axes of bodies, origins, central moments, centres of mass) in the world, at random coordinates."""
    t, rng, n = mechanism.topology, np.random.default_rng(0), len(mechanism.topology)
    placed = np.asarray(mechanism.placements.rotation.entries, float).reshape(n, 3, 3)
    at = np.asarray(mechanism.placements.translation, float)
    axes, R, p = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 3))
    for i, parent in enumerate(t.parents):
        Q, r = (np.eye(3), np.zeros(3)) if parent < 0 else (R[parent], p[parent])
        R[i], p[i] = Q @ placed[i], r + Q @ at[i]
        axes[i] = R[i] @ np.asarray(mechanism.axes[i], float)
        turns, slides = _motions(t.kinds[i], axes[i], R[i])
        p[i] += rng.uniform(-1, 1, len(slides)) @ slides
        w = rng.uniform(-1, 1, len(turns)) @ turns
        with in_double():
            R[i] = np.asarray(Rotation.exp(w).entries).reshape(3, 3) @ R[i]
    c = p + np.einsum("nij,nj->ni", R, np.asarray(mechanism.inertias.com, float))
    return axes, R, p, R @ central @ R.swapaxes(1, 2), c


def _motions(kind: str, axis: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The directions (k, 3) in the world that a joint of a file turns about, and those that it slides along."""
    nothing, x_y_z = np.zeros((0, 3)), R.T
    if kind in ("revolute", "continuous"):
        return axis[None], nothing
    if kind == "prismatic":
        return nothing, axis[None]
    if kind == "planar":
        return x_y_z[2:], x_y_z[:2]
    return x_y_z, x_y_z if kind == "free" else nothing
