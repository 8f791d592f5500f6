"""Exact results, and how far off computed ones are: in ulps by component and by vector, and in the unit of bounds."""

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
from jax.typing import DTypeLike
from numpy.typing import ArrayLike

from jaxspatial.numerics import floats
from jaxspatial.numerics.promise import Promise

# -- exact results, and the sizes of their terms -----------------------------------------------------------------------


def rationals(x: ArrayLike) -> np.ndarray:
    """Every number of x as the Fraction it is. For finite floating point of at most 64 bits.

    Example:
        >>> print(*js.measure.rationals(np.float32([0.5, 0.1])))
        1/2 13421773/134217728
    """
    return np.asarray(np.frompyfunc(Fraction, 1, 1)(np.asarray(x).astype(np.float64).astype(object)), dtype=object)


class Sized:
    """An exact number with mag, the sum of the absolute values of the terms it is made of, and the condition (mag over
    size) of the last number it was divided by: what error bounds are stated in."""

    def __init__(self, value: Fraction, mag: Fraction | None = None, condition: Fraction = Fraction(1)):
        self.value, self.mag, self.condition = value, abs(value) if mag is None else mag, condition

    def __neg__(self):
        return Sized(-self.value, self.mag)

    def __add__(self, other: "Sized | float"):
        other = _number(other)
        return Sized(self.value + other.value, self.mag + other.mag)

    __radd__ = __add__

    def __sub__(self, other: "Sized | float"):
        other = _number(other)
        return Sized(self.value - other.value, self.mag + other.mag)

    def __mul__(self, other: "Sized | float"):
        other = _number(other)
        return Sized(self.value * other.value, self.mag * other.mag)

    __rmul__ = __mul__

    def __truediv__(self, other: "Sized | float"):
        other = _number(other)
        size = abs(other.value)
        return Sized(self.value / other.value, self.mag / size, other.mag / size)

    def __rsub__(self, other: float):
        return _number(other) - self

    def __rtruediv__(self, other: float):
        return _number(other) / self


def _number(x: "Sized | float"):
    """A constant of a formula is a number like others."""
    return x if isinstance(x, Sized) else Sized(Fraction(float(x)))


def sized(x: ArrayLike) -> np.ndarray:
    """Every number of x as the `Sized` it is; NumPy's formulas work on the array."""
    return np.asarray(np.frompyfunc(Sized, 1, 1)(rationals(x)), dtype=object)


def attribute(array: np.ndarray, name: str):
    """One attribute of every `Sized` of an array: "value", "mag" or "condition"."""
    return np.asarray(np.frompyfunc(lambda x: getattr(x, name), 1, 1)(array), dtype=object)


def evaluate(formula: Callable, *arrays: ArrayLike):
    """(exact value, mag) of a formula over arrays: two arrays of Fractions; mag adds up the sizes of all terms.

    Example:
        >>> arrays = (np.asarray(x) for x in (F.tau, F.f, p_PQ))
        >>> value, mag = js.measure.evaluate(lambda tau, f, p: tau - np.cross(p, f), *arrays)
        >>> print(*value, "of terms that add up to", *mag)
        2 -1 -3 of terms that add up to 2 1 9
    """
    result = formula(*map(sized, arrays))
    return attribute(result, "value"), attribute(result, "mag")


# -- errors ------------------------------------------------------------------------------------------------------------


def unit_roundoff(dtype: DTypeLike) -> Fraction:
    """u: half the distance from 1 to the next number, as an exact Fraction.

    Example:
        >>> print(js.measure.unit_roundoff(np.float32), js.measure.unit_roundoff(np.float16))
        1/16777216 1/2048
    """
    return Fraction(floats.eps(dtype)) / 2


def ulp(exact: np.ndarray, dtype: DTypeLike):
    """The units in the last place of exact numbers in a format: an array of Fractions.

    Below the smallest normal number the unit is that of the smallest normal number.

    Example:
        >>> print(*js.measure.ulp(js.measure.rationals([1.0, 1000.0]), np.float16))
        1/1024 1/2
    """
    info = floats.finfo(dtype)
    return np.asarray(np.frompyfunc(lambda x: _ulp(x, info), 1, 1)(exact), dtype=object)


def in_ulps(computed: ArrayLike, exact: ArrayLike):
    """|computed - exact| in units in the last place of the exact value, componentwise, as float64.

    Below the smallest normal number the unit is that of the smallest normal number. NaN and infinities are infinitely
    far off.

    Example:
        >>> third = np.float32(1) / np.float32(3)
        >>> print(js.measure.in_ulps(third, 1 / js.measure.rationals(3.0)))
        0.3333333333333333
    """
    info = floats.finfo(np.asarray(computed).dtype)
    return _ratios(computed, exact, lambda e, _: _ulp(e, info), exact)


def in_ulps_of_norm(computed: ArrayLike, exact: ArrayLike):
    """The largest error of a component of a vector in units in the last place of its largest exact component.

    Over the last axis, as float64, one number per vector: the error in the maximum norm. Vectors with NaN or an
    infinity are infinitely far off.

    Example:
        >>> thirds = np.float32([1, 100]) / np.float32(3)
        >>> print(js.measure.in_ulps_of_norm(thirds, js.measure.rationals([1.0, 100.0]) / 3))
        0.3333333333333333
    """
    info, exact = floats.finfo(np.asarray(computed).dtype), np.asarray(exact, dtype=object)
    return _ratios(computed, exact, lambda _, m: _ulp(m, info), abs(exact).max(-1, keepdims=True)).max(-1)


def agrees_when_not_finite(computed: ArrayLike, expected: ArrayLike):
    """Whether computed is NaN where expected is, the same infinity where expected is one, and finite elsewhere.

    Both floating point; componentwise, as bool. The errors above take only finite exact values.

    Example:
        >>> print(js.measure.agrees_when_not_finite(np.float32([np.nan, np.inf, np.inf]), [np.nan, np.inf, 1.0]))
        [ True  True False]
    """
    computed, expected = (np.asarray(x).astype(np.float64) for x in (computed, expected))
    same = (computed == expected) | (np.isnan(computed) & np.isnan(expected))
    return np.where(np.isfinite(expected), np.isfinite(computed), same)


def in_u_of(computed: ArrayLike, exact: ArrayLike, magnitude: ArrayLike, flushed: int = 0):
    """|computed - exact| / (u magnitude), componentwise, as float64: the unit in which bounds are promised.

    `flushed`: so many of the smallest normal number are forgiven beforehand, for subnormals that were flushed to zero.

    Example:
        >>> x, y = np.float32([0.1, 0.2]), np.float32([0.3, -0.15])
        >>> exact, mag = js.measure.evaluate(lambda x, y: (x * y).sum(), x, y)
        >>> print(js.measure.in_u_of((x * y).sum(), exact, mag) <= 2)
        True
    """
    u = unit_roundoff(np.asarray(computed).dtype)
    return _ratios(computed, exact, lambda _, m: u * m, magnitude, flushed)


def in_units_of(allowed: ArrayLike | Fraction, computed: ArrayLike, exact: ArrayLike, flushed: int = 0):
    """|computed - exact| / allowed, componentwise, as float64: at most 1 where a promise `allowed` (Fractions) is kept.

    `flushed`: as in `in_u_of`.

    Example:
        >>> x, y = np.float32(0.1), np.float32(0.3)
        >>> exact, mag = js.measure.evaluate(lambda x, y: x * y, x, y)
        >>> print(js.measure.in_units_of(mag * js.measure.unit_roundoff(np.float32), x * y, exact) <= 1)
        True
    """
    return _ratios(computed, exact, lambda _, a: a, allowed, flushed)


def allowed(promise: Promise, precision: str, value, mag, dtype: DTypeLike, condition=1):
    """The bound of a `Promise` on numbers of exact value and mag, as Fractions; where r is 0, 1 ulp is nothing."""
    ulps = np.where(value != 0, ulp(value, dtype), 0 * mag)
    return promise.allowed(precision, unit_roundoff(dtype), ulps, value, mag, condition)


def _ratios(computed, exact, unit, magnitude, flushed=0):
    """|computed - exact| over unit(exact, magnitude), once `flushed` smallest normal numbers are taken off."""
    computed, exact, magnitude = np.broadcast_arrays(*map(np.asarray, (computed, exact, magnitude)))
    finite = np.isfinite(computed.astype(np.float64))
    errors = abs(rationals(np.where(finite, computed, np.zeros_like(computed))) - exact)
    if flushed:
        errors = np.maximum(errors - flushed * Fraction(float(floats.finfo(computed.dtype).tiny)), 0)
    sizes = np.frompyfunc(unit, 2, 1)(exact, magnitude)
    ratios = np.frompyfunc(lambda e, size: float(e / size) if size else math.inf if e else 0.0, 2, 1)(errors, sizes)
    return np.where(finite, np.asarray(ratios, np.float64), np.inf)


def _ulp(x, info):
    smallest = Fraction(float(info.tiny)) * Fraction(float(info.eps))
    if not x:
        return smallest
    exponent = abs(x.numerator).bit_length() - x.denominator.bit_length()
    exponent -= Fraction(2) ** exponent > abs(x)
    return max(Fraction(2) ** exponent * Fraction(float(info.eps)), smallest)
