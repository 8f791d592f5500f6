"""The definitions that spatial vectors are held to, written naively: in NumPy for the bits, in rationals for bounds."""

from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

KINDS = (js.SpatialVelocity, js.SpatialAcceleration, js.SpatialForce, js.SpatialMomentum)
FIELDS = {
    js.SpatialVelocity: ("w", "v"),
    js.SpatialAcceleration: ("alpha", "a"),
    js.SpatialForce: ("tau", "f"),
    js.SpatialMomentum: ("h", "l"),
}

every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
# Error bounds of "faithful", which compiles for long, are those of the laws.
every_precision = pytest.mark.parametrize("precision", ["fast", "reproducible", "compensated", slow("faithful")])


def _in_the_middle_of_a_batch(function):
    def call(*args):
        three = jax.tree.map(lambda x: jnp.stack([jnp.asarray(x)] * 3), args)
        return jax.tree.map(lambda x: x[1], jax.vmap(function)(*three))

    return call


def _eager(function):
    return function


WAYS = {"numpy": interpreted, "eager": _eager, "jit": jax.jit, "vmap": _in_the_middle_of_a_batch}
# By default in NumPy: that every program has these bits, `laws.test_transformations` holds of the same operations.
every_way = pytest.mark.parametrize("way", [interpreted, *map(slow, list(WAYS.values())[1:])], ids=WAYS.keys())
# Of what the laws have no operation for, comparisons and arithmetic, a compiled program is tried too.
every_program = pytest.mark.parametrize("way", [jax.jit, slow(_eager), slow(_in_the_middle_of_a_batch)],
                                        ids=["jit", "eager", "vmap"])  # fmt: skip


# In NumPy every operation rounds once, in the order it is written; on arrays of Fraction none does.


def shifted(kind, rotational, translational, p, *w):
    """The two parts of the quantity about Q, p from P to Q; w for an acceleration."""
    if kind in (js.SpatialForce, js.SpatialMomentum):
        return rotational - np.cross(p, translational), translational
    translational = translational + np.cross(rotational, p)
    for turning in w:
        translational = translational + np.cross(turning, np.cross(turning, p))
    return rotational, translational


def shift_magnitudes(kind, rotational, translational, p, *w):
    """For both parts, the sum of the absolute values of the terms of each component; 0 where nothing is computed."""
    r, t, p = (np.abs(np.asarray(x, float)) for x in (rotational, translational, p))
    if kind in (js.SpatialForce, js.SpatialMomentum):
        return r + cross_magnitudes(p, t), np.zeros_like(t)
    t = t + cross_magnitudes(r, p)
    for turning in w:
        t = t + cross_magnitudes(turning, cross_magnitudes(turning, p))
    return np.zeros_like(r), t


def cross_magnitudes(a, b):
    a, b = (np.abs(np.asarray(x, float)) for x in (a, b))
    return np.roll(a, -1, -1) * np.roll(b, -2, -1) + np.roll(a, -2, -1) * np.roll(b, -1, -1)


def dot(tau, f, w, v):
    """Each part summed from the left, then both."""

    def three(a, b):
        return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]

    return three(tau, w) + three(f, v)


def dot_magnitude(tau, f, w, v):
    return dot(*(np.abs(np.asarray(x, float)) for x in (tau, f, w, v)))


def exactly(x):
    """x as an array of Fraction."""
    x = np.asarray(x, float)
    return np.array([Fraction(number) for number in x.ravel().tolist()], object).reshape(x.shape)


def unit_roundoff(dtype):
    return float(np.finfo(dtype).eps) / 2


def random_vectors(seed, count, shape, dtype):
    """`count` arrays of numbers of both signs whose sizes vary from 2^-8 to 2^8."""
    rng = np.random.default_rng(seed)
    return tuple((rng.normal(size=shape) * np.exp2(rng.integers(-8, 9, shape))).astype(dtype) for _ in range(count))


def offsets_of(kind):
    """How many vectors a shift takes: the offset and, for an acceleration, w."""
    return 2 if kind is js.SpatialAcceleration else 1


def random_shift(kind, dtype, shape=(200, 3), offset_shape=None):
    """A batch of `kind`, and the arrays that shift it."""
    x = kind(*random_vectors(1, 2, shape, dtype))
    return x, random_vectors(2, offsets_of(kind), offset_shape or shape, dtype)


def assert_same_bits(result, expected):
    """Of the same dtype and shape, and equal: NaN where NaN is expected, zeros of the same sign."""
    result, expected = np.asarray(result), np.asarray(expected)
    assert result.dtype == expected.dtype
    np.testing.assert_array_equal(result, expected, strict=True)
    numbers = ~np.isnan(expected)
    np.testing.assert_array_equal(np.signbit(result[numbers]), np.signbit(expected[numbers]))


def assert_parts(x, rotational, translational):
    """x has exactly these parts, bit by bit."""
    assert_same_bits(x.rotational, rotational)
    assert_same_bits(x.translational, translational)


def assert_numbers(x, rotational, translational):
    """x has exactly these numbers for parts, whatever the sign of zeros."""
    np.testing.assert_array_equal(x.rotational, np.asarray(rotational, x.dtype), strict=True)
    np.testing.assert_array_equal(x.translational, np.asarray(translational, x.dtype), strict=True)


def assert_within(result, exact, bound):
    """|result - exact| <= bound, in rational arithmetic."""
    excess = abs(exactly(result) - exact) - exactly(bound)
    assert (excess <= 0).all(), f"beyond the bound by up to {float(excess.max())}"
