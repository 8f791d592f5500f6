"""The operators of Components: component by component, what is known folds, and each result is rounded once.

And what they work on: single components, and an index of them.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.errorfree.barrier import read
from jaxspatial.arithmetic.numbers import folding
from jaxspatial.arithmetic.numbers.polynomial import uniform
from jaxspatial.arithmetic.precision import Precision

_INTEGERS: tuple[type[Any], ...] = int, np.integer
_SLICE: type[Any] = slice


class Operators(check.StandIn):
    """Base of what is made of components, and of nothing else."""

    components: Any
    _fill: Callable[..., None]

    @classmethod
    def of(cls, components: Sequence[Any]) -> Self:
        """Of components of one dtype, not checked.

        Args:
            components: NumPy scalars, which are known, and data (*batch,) over one batch.

        Returns:
            Components of these.

        Error: none, it is exact.
        """
        x = object.__new__(cls)
        x._fill(components)
        return x

    @classmethod
    def of_array(cls, x: Any) -> Self:
        """Of an array: in one of NumPy, components that are 0, 1 or -1 throughout are known.

        Args:
            x: (*batch, n) array.

        Returns:
            Its n components, (*batch,) each.

        Error: none, it is exact.
        """
        columns = [x[..., i] for i in range(x.shape[-1])]
        return cls.of([_known_if_unit(c) for c in columns] if isinstance(x, np.ndarray) else columns)

    def __neg__(self) -> Self:
        return self.of([-c for c in self.components])

    def __abs__(self) -> Self:
        return self.of([abs(c) for c in self.components])

    def __add__(self, other: Any) -> Self:
        return self._combined(folding.add, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Self:
        return self._combined(folding.subtract, other)

    def __rsub__(self, other: Any) -> Self:
        return self._combined(folding.subtract, other, is_reflected=True)

    def __mul__(self, other: Any) -> Self:
        return self._combined(_product, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Self:
        return self._combined(folding.divide, other)

    def __rtruediv__(self, other: Any) -> Self:
        return self._combined(folding.divide, other, is_reflected=True)

    def _combined(self, operation: Callable[..., Any], other: Any, is_reflected: bool = False) -> Any:
        other = self._beside(other)
        if other is NotImplemented:
            return NotImplemented
        a, b = (other, self) if is_reflected else (self, other)
        batch = check.common_batch_shape(left=a.shape[:-1], right=b.shape[:-1])
        return _compiled(operation, *check.broadcast_batch(batch, a, b))

    def _beside(self, other: Any) -> Any:
        """What stands beside this one in an operation, with as many components; NotImplemented."""
        n = self.shape[-1]
        if isinstance(other, (int, float)) and not isinstance(other, bool):
            return self.of([over(float(other), (), self.dtype)] * n)
        if not isinstance(other, (np.generic, np.ndarray, jax.Array, check.StandIn)):
            return NotImplemented
        array: Any = check.as_float_array(other, "Components: other")
        check.require_same_dtype(Components=self, other=array)
        parts = [array[()]] if isinstance(other, np.generic) else self._parts(array)
        return self.of(parts * n if len(parts) == 1 else parts)

    def _parts(self, array: Any) -> Any:
        """The components of an array (*batch, n), (*batch, 1) or ()."""
        n, array = self.shape[-1], array if array.ndim else array.reshape((1,))
        if array.shape[-1] not in (1, n):
            raise ValueError(f"Components: other: expected shape (*batch, {n}) or (*batch, 1), got {array.shape}")
        return (array if isinstance(array, Operators) else self.of_array(array)).components


def _known_if_unit(column: np.ndarray) -> Any:
    number = uniform(column)
    return column.dtype.type(number) if number is not None and number in (0, 1, -1) else jnp.asarray(column)


def _combined(operation: Callable[..., Any], a: Any, b: Any) -> Any:
    return a.of([read(operation, x, y) for x, y in zip(a.components, b.components, strict=True)])


_compiled: Callable[..., Any] = jax.jit(_combined, static_argnums=0, inline=True)
_product = functools.partial(folding.multiply, Precision.REPRODUCIBLE)


# -- single components: known numbers and data, brought to one dtype and one batch -------------------------------------


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
    return jax.tree.map(functools.partial(_broadcast, batch=batch), c)


def _broadcast(word: Any, batch: tuple[int, ...]) -> Any:
    # A copy of NumPy's: the caller may write to his own.
    word = jnp.array(word) if isinstance(word, np.ndarray) else word
    return word if word.shape == batch else jnp.broadcast_to(word, batch)


def plain(number: float) -> float:
    """As a Python float that equals itself: 0 for -0, one NaN for all."""
    number = float(number)
    return math.nan if math.isnan(number) else number + 0.0


def as_data(leaf: Any) -> Any:
    """Data as what a formula computes with: a NumPy array that JAX put there would be known."""
    return jnp.asarray(leaf) if isinstance(leaf, (np.ndarray, np.generic)) else leaf


def shown(leaf: Any) -> str:
    """A number, the shape of more or of something not computed yet."""
    if check.is_computed(leaf) and leaf.ndim == 0:
        return f"Array({np.asarray(leaf)})"
    return check.in_short(leaf)


# -- an index: that of the batch, and that of the components ----------------------------------------------------------


def split(index: Any, ndim: int, has_batch: bool) -> tuple[tuple[Any, ...], Any]:
    """An index as that of the batch and that of the components, the latter None where they do not stay apart.

    What is known goes with any batch: without data, of an index [..., i, j] the last is taken.
    """
    index = index if isinstance(index, check.TUPLE) else (index,)
    if not has_batch and len(index) > 2 and index[0] is Ellipsis and index[-1] is not None:
        index = index[-1:]
    given = [i for i in index if i is not Ellipsis]
    if len(given) > ndim or any(i is None or _is_mask(i) for i in given):
        return (), None
    before = next((k for k, i in enumerate(index) if i is Ellipsis), len(index))
    *batch, last = *index[:before], *[slice(None)] * (ndim - len(given)), *index[before + 1 :]
    return tuple(batch), _which(last, is_alone=all(isinstance(i, (int, slice)) for i in batch))


def _is_mask(i: Any) -> bool:
    return isinstance(i, bool) or (isinstance(i, check.ARRAYS) and i.dtype == np.bool_)


def _which(i: Any, is_alone: bool) -> Any:
    """The index of components as an int, a slice or a list; None for traced ones, and lists beside arrays."""
    if isinstance(i, _INTEGERS):
        return int(i)
    is_list = is_alone and isinstance(i, (check.LIST, check.NUMPY)) and np.ndim(i) == 1
    return i if isinstance(i, _SLICE) else np.asarray(i) if is_list else None
