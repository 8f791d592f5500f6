"""Exact derivatives: a formula run over numbers that know their tangent."""

import numpy as np

from jaxspatial.measure.error import Sized, sized
from tests.helpers.operations import OPERATIONS

_ZERO = Sized(0)


class Dual:
    """A `Sized` number and its tangent; mag of the tangent is that of its terms, multiplied out. Sums and products."""

    def __init__(self, value, tangent=_ZERO):
        self.value, self.tangent = value, tangent

    def __add__(self, other):
        return Dual(self.value + other.value, self.tangent + other.tangent)

    def __sub__(self, other):
        return Dual(self.value - other.value, self.tangent - other.tangent)

    def __mul__(self, other):
        return Dual(self.value * other.value, self.tangent * other.value + self.value * other.tangent)


_dual = np.frompyfunc(Dual, 2, 1)
_tangent = np.frompyfunc(lambda x: x.tangent, 1, 1)


def _zeros(x):
    return np.full(np.shape(x), _ZERO, dtype=object)


def pushed(name, arrays, tangents):
    """The exact tangents of an operation, arrays of `Sized`, a list of one for each of the result."""
    moving = [_dual(_sized(x), _sized(t)) for x, t in zip(arrays, tangents, strict=True)]
    return [np.asarray(_tangent(r), dtype=object) for r in OPERATIONS[name].formula(*moving)]


def pulled(name, arrays, cotangents):
    """The exact pull-backs of an operation over a batch, arrays of `Sized`, one for each of the arguments."""
    arrays, cotangents = [_sized(x) for x in arrays], [_sized(c) for c in cotangents]
    return [_pulled_to(name, arrays, cotangents, j) for j in range(len(arrays))]


def _sized(x):
    """Arrays of `Sized` stay what they are."""
    return x if np.asarray(x).dtype == object else sized(x)


def _pulled_to(name, arrays, cotangents, j):
    result = _zeros(arrays[j])
    for place in np.ndindex(arrays[j].shape[1:]):
        unit = _zeros(arrays[j])
        unit[:, *place] = Sized(1)
        tangents = [unit if i == j else _zeros(x) for i, x in enumerate(arrays)]
        rates = pushed(name, arrays, tangents)
        each = [(rate * c).reshape(len(c), -1).sum(1) for rate, c in zip(rates, cotangents, strict=True)]
        result[:, *place] = sum(each[1:], each[0])
    return result
