"""Inertias over numbers never rounded, and those that tests are made with."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np

import jaxspatial as js
from jaxspatial.measure.error import rationals

SIX = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]


def matrix(six):
    """(..., 3, 3) of (..., 6), of numbers of any kind."""
    return np.asarray(six)[..., [0, 1, 3, 1, 2, 4, 3, 4, 5]].reshape((*np.shape(six)[:-1], 3, 3))


def six_of(m):
    return np.stack([m[..., i, j] for i, j in SIX], -1)


def steiner(m, c):
    """m (|c|^2 1 - c c^T) by six entries."""
    x, y, z = np.moveaxis(np.asarray(c), -1, 0)
    return np.stack([m * e for e in (y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y)], -1)


def exactly(M):
    """mass, com and central as Fractions."""
    return [rationals(np.asarray(x)) for x in jax.tree.leaves(M)]


def random_inertia(batch, dtype="float64", seed=0, spread=0.0):
    """Valid bodies: points about the centre of mass, sizes and masses over 10^+-spread."""
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((*batch, 5, 3)) * 10.0 ** rng.uniform(-spread, spread, (*batch, 1, 1))
    mass = rng.uniform(0.5, 2, batch) * 10.0 ** rng.uniform(-spread, spread, batch)
    square = (points**2).sum(-1)[..., None, None] * np.eye(3) - points[..., :, None] * points[..., None, :]
    central = mass[..., None, None] * square.mean(-3)
    com = rng.standard_normal((*batch, 3)) * 10.0 ** rng.uniform(-spread, spread, (*batch, 1))
    return js.SpatialInertia(*(np.asarray(x).astype(jnp.dtype(dtype)) for x in (mass, com, six_of(central))))


def is_positive_semidefinite(m, slack=0):
    """Of an exact symmetric 3 x 3 matrix plus slack times 1: all principal minors are non-negative."""
    m = [[m[i][j] + (slack if i == j else 0) for j in range(3)] for i in range(3)]
    minors = [m[i][i] for i in range(3)]
    minors += [m[i][i] * m[j][j] - m[i][j] * m[j][i] for i, j in ((0, 1), (0, 2), (1, 2))]
    first, second, third = m
    cofactors = [second[1] * third[2] - second[2] * third[1], second[2] * third[0] - second[0] * third[2],
                 second[0] * third[1] - second[1] * third[0]]  # fmt: skip
    return all(x >= 0 for x in [*minors, sum(a * b for a, b in zip(first, cofactors, strict=True))])


def second_moments(six):
    """tr(I) / 2 1 - I, exactly, as a list of rows."""
    m = matrix(rationals(six))
    half = sum(m[i, i] for i in range(3)) / Fraction(2)
    return [[(half if i == j else 0) - m[i, j] for j in range(3)] for i in range(3)]
