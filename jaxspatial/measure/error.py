"""Errors of computed numbers against exact ones: in ulps by component and by vector, and in the unit of bounds."""

import functools
import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.promise import Promise
from jaxspatial.arithmetic.types import DTypeLike
from jaxspatial.measure.exact import rationals

# Exact numbers: an array of Fractions, or one for all.
Exact = np.ndarray | Fraction | int
# Of an exact number and a magnitude.
Unit = Callable[[Fraction, Fraction], Fraction]


def unit_roundoff(dtype: DTypeLike) -> Any:
    """u: half the distance from 1 to the next number, as an exact Fraction."""
    return Fraction(check.eps(dtype)) / 2


def ulp(exact: np.ndarray, dtype: DTypeLike):
    """The units in the last place of exact numbers in a format: an array of Fractions.

    Below the smallest normal number the unit is that of the smallest normal number.
    """
    info = check.finfo(dtype)
    return np.asarray(np.frompyfunc(lambda x: _ulp(x, info), 1, 1)(exact), dtype=object)


def in_ulps(computed: ArrayLike, exact: Exact):
    """|computed - exact| in units in the last place of the exact value, componentwise, as float64.

    Below the smallest normal number the unit is that of the smallest normal number. NaN and infinities are infinitely
    far off.
    """
    info = check.finfo(np.asarray(computed).dtype)
    return _over(computed, exact, lambda e, _: _ulp(e, info), exact)


def in_ulps_of_norm(computed: ArrayLike, exact: Exact):
    """The largest error of a component of a vector in units in the last place of its largest exact component.

    Over the last axis, as float64, one number per vector: the error in the maximum norm. Vectors with NaN or an
    infinity are infinitely far off.
    """
    info, exact = check.finfo(np.asarray(computed).dtype), np.asarray(exact, dtype=object)
    return _over(computed, exact, lambda _, m: _ulp(m, info), abs(exact).max(-1, keepdims=True)).max(-1)


def agrees_when_not_finite(computed: ArrayLike, expected: ArrayLike):
    """Whether computed is NaN where expected is, the same infinity where expected is one, and finite elsewhere.

    Both floating point; componentwise, as bool. The errors above take only finite exact values.
    """
    computed, expected = (np.asarray(x).astype(np.float64) for x in (computed, expected))
    same = (computed == expected) | (np.isnan(computed) & np.isnan(expected))
    return np.where(np.isfinite(expected), np.isfinite(computed), same)


def in_u_of(computed: ArrayLike, exact: Exact, magnitude: Exact, flushed: int = 0):
    """|computed - exact| / (u magnitude), componentwise, as float64: the unit in which bounds are promised.

    `flushed`: so many of the smallest normal number are forgiven beforehand, for subnormals that were flushed to zero.
    """
    dtype = np.asarray(computed).dtype
    u, forgiven = unit_roundoff(dtype), flushed * Fraction(float(check.finfo(dtype).tiny))
    return _over(computed, exact, lambda _, m: u * m, magnitude, forgiven)


def in_units_of(allowed: Exact, computed: ArrayLike, exact: Exact, flushed: int = 0):
    """|computed - exact| / allowed, componentwise, as float64: at most 1 where a promise `allowed` (Fractions) is kept.

    `flushed`: as in `in_u_of`.
    """
    forgiven = flushed * Fraction(float(check.finfo(np.asarray(computed).dtype).tiny))
    return _over(computed, exact, lambda _, a: a, allowed, forgiven)


def allowed(
    promise: Promise, precision: str, value: np.ndarray, mag: np.ndarray, dtype: DTypeLike, condition: Any = 1
) -> Any:
    """The bound of a `Promise` on numbers of exact value and mag, as Fractions; where r is 0, 1 ulp is nothing."""
    ulps = np.where(value != 0, ulp(value, dtype), 0 * mag)
    return promise.allowed(precision, unit_roundoff(dtype), ulps, value, mag, condition)


def _over(computed: ArrayLike, exact: Exact, unit: Unit, magnitude: Exact, forgiven: Fraction | int = 0):
    computed, exact, magnitude = np.broadcast_arrays(*map(np.asarray, (computed, exact, magnitude)))
    finite = np.isfinite(computed.astype(np.float64))
    errors = abs(rationals(np.where(finite, computed, np.zeros_like(computed))) - exact)
    errors = np.maximum(errors - forgiven, 0) if forgiven else errors
    ratios = np.frompyfunc(functools.partial(_ratio, unit), 3, 1)(errors, exact, magnitude)
    return np.where(finite, np.asarray(ratios, np.float64), np.inf)


def _ratio(unit: Unit, error: Fraction, exact: Fraction, magnitude: Fraction):
    size = unit(exact, magnitude)
    return float(error / size) if size else (math.inf if error else 0.0)


def _ulp(x: Fraction, info: Any):
    smallest = Fraction(float(info.tiny)) * Fraction(float(info.eps))
    if not x:
        return smallest
    exponent = abs(x.numerator).bit_length() - x.denominator.bit_length()
    power = Fraction(2) ** exponent
    exponent -= power > abs(x)
    return max(Fraction(2) ** exponent * Fraction(float(info.eps)), smallest)
