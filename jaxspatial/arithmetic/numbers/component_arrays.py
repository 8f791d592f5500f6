"""Components where arrays are meant, and arrays beside Components."""

import typing
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic.numbers.components import as_components, is_components
from jaxspatial.arithmetic.numbers.double_word import DoubleWord


def from_components(x: typing.Any) -> typing.Any:
    """Every Components of a tree as one array. All else stays as it is.

    What is known goes with any batch, and comes without one where all of it is known.

    Args:
        x: a pytree of anything, or one Components (*batch, n).

    Returns:
        The same tree, with an array (*batch, n), or a DoubleWord, in place of each Components.

    Error: none, it is exact.
    """
    return jax.tree.map(lambda leaf: leaf.to_array() if is_components(leaf) else leaf, x, is_leaf=is_components)


def as_array(x: typing.Any, batch_shape: tuple[int, ...]) -> typing.Any:
    """Components as one array over a batch, of which known numbers have none; anything else as it is."""
    return x.to_array(batch_shape) if is_components(x) else x


def alike(arrays: Sequence[Any]) -> Any:
    """The arguments of a formula; where one is Components, NumPy arrays made such, known where they are 0, 1 or -1."""
    if not any(map(is_components, arrays)):
        return arrays
    return tuple(as_components(a) if isinstance(a, np.ndarray) else a for a in arrays)


def has_pairs(x: Any) -> bool:
    """True for a DoubleWord, and for Components of which one is."""
    return isinstance(x, DoubleWord) or (is_components(x) and any(isinstance(c, DoubleWord) for c in x.data))
