"""Frames and bodies to hold peers to."""

import operator

import jax
import numpy as np

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia

N = 40


def each(tree):
    """The items of a batch (N,)."""
    return [jax.tree.map(operator.itemgetter(i), tree) for i in range(N)]


def poses(seed=7):
    """(N,) of any angle, some tens of metres away."""
    rng = np.random.default_rng(seed)
    return js.RigidTransform(js.Rotation.exp(rng.normal(size=(N, 3)) * 2), rng.normal(size=(N, 3)) * 10)


def inertias():
    """N pairs of a body and the size of its inertia about the origin: compact, thin, rods, points, near and far, of
    masses from 2^-40 to 2^40."""
    rng = np.random.default_rng(9)
    for i in range(N):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        second = rng.uniform(0.1, 1, 3) * [(1, 1, 1), (1, 1, 1e-6), (1, 0, 0), (0, 0, 0)][i % 4]
        central = axes @ np.diag(second.sum() - second) @ axes.T
        central = np.tril(central) + np.tril(central, -1).T
        mass = rng.uniform(1, 2) * np.exp2(rng.integers(-40, 41))
        com = rng.normal(size=3) * np.exp2(rng.integers(-8, 9))
        yield SpatialInertia(mass, com, mass * central), mass * (abs(central).max() + com @ com)
