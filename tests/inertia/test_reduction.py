"""Sums over the last axis of a batch, of numbers and of double words, against exact ones."""

import math
from fractions import Fraction

import numpy as np
import pytest

from jaxspatial.inertia.composition import first, sums_over_items
from jaxspatial.measure.error import rationals
from jaxspatial.numerics.numbers import Rounded
from jaxspatial.numerics.numbers.double_word import DoubleWord
from jaxspatial.numerics.precision import Precision

U = Fraction(1, 2**24)
SIZES = pytest.mark.parametrize("shape", [(1,), (2,), (3,), (2, 5), (2, 2, 8)])


@SIZES
def test_double_words(shape):
    """Error <= 3 ceil(log2 n) u^2 mag, of each of several."""
    hi = np.random.default_rng(0).standard_normal((2, *shape)).astype(np.float32)
    lo = (hi * np.float32(2.0**-26)).astype(np.float32)
    for k, found in enumerate(sums_over_items(tuple(DoubleWord(h, x) for h, x in zip(hi, lo, strict=True)), shape[-1])):
        assert found.hi.shape == (*shape[:-1], 1) and found.hi.dtype == np.float32
        exact = rationals(hi[k]) + rationals(lo[k])
        error = abs(rationals(found.hi) + rationals(found.lo) - exact.sum(-1, keepdims=True))
        allowed = 3 * math.ceil(math.log2(shape[-1])) * U**2 * abs(exact).sum(-1, keepdims=True)
        assert (error <= allowed).all()


@SIZES
def test_numbers(shape):
    """Error <= ceil(log2 n) u mag; a known 0 stays one."""
    x = np.random.default_rng(1).standard_normal((2, *shape)).astype(np.float32)
    zero = Rounded(Precision.REPRODUCIBLE, np.float32(0))
    first, second = (Rounded(Precision.REPRODUCIBLE, a) for a in x)
    a, nothing, b = sums_over_items((first, zero, second), shape[-1])
    assert nothing is zero
    for y, found in zip(x, (a, b), strict=True):
        error = abs(rationals(found.value) - rationals(y).sum(-1, keepdims=True))
        assert found.value.shape == (*shape[:-1], 1)
        allowed = math.ceil(math.log2(shape[-1])) * U * abs(rationals(y)).sum(-1, keepdims=True)
        assert (error <= allowed).all()


def test_the_first_of_an_axis():
    x = np.array([[2.0, 3.0], [5.0, 7.0]], np.float32)
    np.testing.assert_array_equal(first(DoubleWord(x, 0 * x)).hi, x[:, :1])
    np.testing.assert_array_equal(first(Rounded(Precision.REPRODUCIBLE, x)).value, x[:, :1])
