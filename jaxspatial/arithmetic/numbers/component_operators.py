"""The operators of Components: component by component, what is known folds, and each result is rounded once."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers import component_numbers, folding
from jaxspatial.arithmetic.numbers.polynomial import uniform
from jaxspatial.arithmetic.precision import Precision


class Operators(check.StandIn):
    """Base of what is made of components, and of nothing else."""

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    components: Any
    shape: Any
    dtype: Any
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
            return self.of([component_numbers.over(float(other), (), self.dtype)] * n)
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
    return a.of([operation(x, y) for x, y in zip(a.components, b.components, strict=True)])


_compiled = jax.jit(_combined, static_argnums=0, inline=True)
_product = functools.partial(folding.multiply, Precision.REPRODUCIBLE)
