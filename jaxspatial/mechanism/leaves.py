"""Leaves of a mechanism: what NumPy numbers are before programs are made for their values."""

import dataclasses
import functools
from typing import Any, TypeVar

import jax
import numpy as np
import numpy.typing as npt
from jax.core import Tracer

from jaxspatial.arithmetic import check

M = TypeVar("M")


class ByContents:
    """Hashable, and equal to others of its class with the same contents."""

    contents: Any

    @functools.cached_property
    def _hash(self):
        return hash(self.contents)

    def __hash__(self):
        return self._hash

    def __eq__(self, other: object):
        return self is other or (isinstance(other, type(self)) and self.contents == other.contents)


def read_only(mechanism: M) -> M:
    """With NumPy numbers of its own that nobody writes to: programs are made for their values, and found again by the
    mechanism."""
    return jax.tree.map(_of_its_own, mechanism)


def _of_its_own(x: jax.Array | np.ndarray):
    is_ready = not isinstance(x, np.ndarray) or (x.base is None and not x.flags.writeable)
    return x if is_ready else frozen(x)


def check_replaced(cls: type[Any], name: str, old: Any, new: Any):
    if old is None or name == "topology":
        fields = ", ".join(f.name for f in dataclasses.fields(cls) if f.name != "topology")
        near = check.did_you_mean(name, fields.split(", "))
        raise TypeError(f"Mechanism.replace: expected one of {fields}, got {name!r}{near}")
    forms: list[Any] = [jax.tree.structure(x) for x in (old, new)]
    if forms[0] != forms[1]:
        names = [type(x).__name__ for x in (old, new)]
        expected, came = names if names[0] != names[1] else forms
        raise TypeError(f"Mechanism.replace: {name}: expected {expected}, got {came}")
    for a, b in zip(jax.tree.leaves(old), jax.tree.leaves(new), strict=True):
        if np.shape(a) != np.shape(b):
            raise ValueError(f"Mechanism.replace: {name}: expected shape {np.shape(a)}, got {np.shape(b)}")
        check.as_float_array(b, f"Mechanism.replace: {name}", check.floating_dtype(a), held=True)


def known(x: Any):
    if isinstance(x, Tracer):
        came = x.__class__.__name__
        raise TypeError(f"Mechanism.as_known: expected numbers (NumPy or JAX arrays), got {came}, traced")
    return np.asarray(x)


def frozen(x: npt.ArrayLike):
    """A copy that nobody can write to."""
    x = np.array(x, order="C")
    x.flags.writeable = False
    return x
