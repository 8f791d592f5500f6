"""Single components: known numbers and data, brought to one dtype and one batch."""

import math
import typing
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers import folding


def common_dtype(given: Sequence[Any], dtype: Any) -> np.dtype[Any]:
    """That of what has one, or the one named; JAX's default for Python floats alone."""
    typed = {f"component {i}": c for i, c in enumerate(given) if isinstance(c, check.ARRAYS)}
    if dtype is not None:
        typed["dtype"] = np.empty((), jax.dtypes.canonicalize_dtype(dtype))
    check.require_same_dtype(**typed)
    return next(iter(typed.values())).dtype if typed else jax.dtypes.canonicalize_dtype(float)


def over(c: Any, batch: tuple[int, ...], dtype: Any) -> Any:
    """The component over a batch; a number in its dtype."""
    if isinstance(c, (float, np.generic)):
        return folding.quietly(lambda t, number: t.type(number), np.dtype(dtype), c)
    return jax.tree.map(lambda word: _broadcast(word, batch), c)


def _broadcast(word: Any, batch: tuple[int, ...]) -> Any:
    # A copy of NumPy's: the caller may write to his own.
    word = jnp.array(word) if isinstance(word, np.ndarray) else word
    return word if word.shape == batch else jnp.broadcast_to(word, batch)


def plain(number: float) -> float:
    """As a Python float that equals itself: 0 for -0, one NaN for all."""
    number = float(number)
    return math.nan if math.isnan(number) else number + 0.0


def as_data(leaf: Any) -> typing.Any:
    """Data as what a formula computes with: a NumPy array that JAX put there would be known."""
    return jnp.asarray(leaf) if isinstance(leaf, (np.ndarray, np.generic)) else leaf


def shown(leaf: Any) -> str:
    """A number, the shape of more or of something not computed yet."""
    concrete = isinstance(leaf, (np.ndarray, jax.Array)) and not isinstance(leaf, jax.core.Tracer)
    if concrete and leaf.ndim == 0:
        return f"Array({np.asarray(leaf)})"
    return check.in_short(leaf)
