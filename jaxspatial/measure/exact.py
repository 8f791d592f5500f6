"""Exact references: the formulas of the library over numbers never rounded, which know the size of their terms."""

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

# Over numbers of any kind; a lambda takes its types from the number of its arguments.
Formula = Callable[[Any, Any], Any] | Callable[[Any, Any, Any], Any] | Callable[[Any, Any, Any, Any], Any]


def rationals(x: npt.ArrayLike) -> Any:
    """Every number of x as the Fraction it is. For finite floating point of at most 64 bits."""
    return np.asarray(np.frompyfunc(Fraction, 1, 1)(np.asarray(x).astype(np.float64).astype(object)), dtype=object)


class Sized:
    """An exact number with mag, the sum of the absolute values of the terms it is made of, and the condition (mag over
    size) of the last number it was divided by: what error bounds are stated in."""

    def __init__(self, value: Fraction, mag: Fraction | None = None, condition: Fraction = Fraction(1)):
        self.value, self.mag, self.condition = value, abs(value) if mag is None else mag, condition

    def __neg__(self):
        return Sized(-self.value, self.mag)

    def __add__(self, other: "Sized"):
        return Sized(self.value + other.value, self.mag + other.mag)

    def __sub__(self, other: "Sized"):
        return Sized(self.value - other.value, self.mag + other.mag)

    def __mul__(self, other: "Sized"):
        return Sized(self.value * other.value, self.mag * other.mag)

    def __truediv__(self, other: "Sized"):
        size = abs(other.value)
        return Sized(self.value / other.value, self.mag / size, other.mag / size)


def sized(x: npt.ArrayLike) -> Any:
    """Every number of x as the `Sized` it is; NumPy's formulas work on the array."""
    return np.asarray(np.frompyfunc(Sized, 1, 1)(rationals(x)), dtype=object)


def attribute(array: np.ndarray, name: str) -> Any:
    """One attribute of every `Sized` of an array: "value", "mag" or "condition"."""
    return np.asarray(np.frompyfunc(lambda x: getattr(x, name), 1, 1)(array), dtype=object)


def evaluate(formula: Formula | Callable[..., Any], *arrays: npt.ArrayLike):
    """(exact value, mag) of a formula over arrays: two arrays of Fractions.

    >>> evaluate(lambda tau, f, p: tau - np.cross(p, f), tau, f, p)
    """
    result = formula(*map(sized, arrays))
    return attribute(result, "value"), attribute(result, "mag")


def shift_force(tau: npt.ArrayLike, f: npt.ArrayLike, p: npt.ArrayLike):
    """(exact torque about Q, mag): tau - p x f."""
    return evaluate(lambda tau, f, p: tau - np.cross(p, f), tau, f, p)


def shift_velocity(w: npt.ArrayLike, v: npt.ArrayLike, p: npt.ArrayLike):
    """(exact velocity of Q, mag): v + w x p."""
    return evaluate(lambda w, v, p: v + np.cross(w, p), w, v, p)


def shift_acceleration(alpha: npt.ArrayLike, a: npt.ArrayLike, p: npt.ArrayLike, w: npt.ArrayLike):
    """(exact acceleration of Q, mag): a + alpha x p + w x (w x p)."""
    return evaluate(lambda b, a, p, w: a + np.cross(b, p) + np.cross(w, np.cross(w, p)), alpha, a, p, w)


def dot(tau: npt.ArrayLike, f: npt.ArrayLike, w: npt.ArrayLike, v: npt.ArrayLike):
    """(exact power, mag): tau . w + f . v."""
    return evaluate(lambda tau, f, w, v: (tau * w).sum(-1) + (f * v).sum(-1), tau, f, w, v)
