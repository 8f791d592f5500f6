"""What a spatial vector is: two 3-vectors, rotational on top of translational, about one point, in one frame.

Which point, which body and which frame is said by names (monogram notation: `F_Bp_E` acts on body B at point Bp,
expressed in frame E), never stored: vectors of different frames can be stacked, scanned and batched.
"""

import dataclasses
import operator
import typing
from collections.abc import Iterable
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers.component_arrays import as_array
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import to_double_word
from jaxspatial.arithmetic.quantity import Quantity
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.arithmetic.types import BatchShape, DTypeLike, Six, Vector3
from jaxspatial.rotation.matrices import owned, shown

_Parts = typing.TypeVar("_Parts", bound="Parts")


class Parts(Quantity):
    """Two parts by the names of the fields of a subclass: checked, made, told."""

    if typing.TYPE_CHECKING:

        def __init__(self, rotational: Vector3, translational: Vector3): ...

    # The names of the two fields, set by `spatial_vector`.
    _names: typing.ClassVar[tuple[str, ...]] = ()

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds vectors without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(leaf) for leaf in self.vectors):
            return
        names = [f"{type(self).__name__}: {name}" for name in self._names]
        given = zip(names, self.vectors, strict=True)
        arrays = check.alike(**{name: owned(check.as_vectors(x, name, held=True)) for name, x in given})
        batch_shapes = {name: a.shape[:-1] for name, a in arrays.items() if not check.goes_with_any_batch(a)}
        if len(set(batch_shapes.values())) > 1:
            came = ", ".join(f"{name}: {shape}" for name, shape in batch_shapes.items())
            raise ValueError(f"{type(self).__name__}: expected equal batch shapes, got {came}; see jnp.broadcast_to")
        for name, array in zip(self._names, arrays.values(), strict=True):
            object.__setattr__(self, name, array)

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def from_array(cls, x6: Six) -> Self:
        """From six coefficients, rotational on top.

        Args:
            x6: (*batch, 6).

        Returns:
            The vector (*batch,).

        Raises:
            TypeError: x6 is not of floating point.
            ValueError: the shape does not fit.

        Error: none, it is exact.
        """
        array = check.as_vectors(x6, f"{cls.__name__}.from_array: x6", size=6, held=True)
        return cls(array[..., :3], array[..., 3:])

    @classmethod
    def zero(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> Self:
        """Six zeros, known while tracing: what is added to them, or made of them, leaves no operation behind.

        Args:
            batch_shape: shape of the batch.
            dtype: of the numbers; None takes JAX's default.

        Returns:
            The vector (*batch_shape,).

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, it is exact.
        """
        return cls._filled(0, batch_shape, dtype)

    @classmethod
    def nan(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> Self:
        """Six NaNs, for what is yet to be set.

        Args:
            batch_shape: shape of the batch.
            dtype: of the numbers; None takes JAX's default.

        Returns:
            The vector (*batch_shape,).

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, nothing is computed.
        """
        return cls._filled(np.nan, batch_shape, dtype)

    @classmethod
    def _filled(cls, value: float, batch_shape: BatchShape, dtype: DTypeLike | None) -> Self:
        dtype = check.as_dtype(dtype)
        batch_shape = (batch_shape,) if isinstance(batch_shape, int) else batch_shape
        return cls(*(np.full((*batch_shape, 3), value, dtype) for _ in range(2)))

    # -- parts --------------------------------------------------------------------------------------------------------

    @property
    def vectors(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in self._names)

    def with_vectors(self, vectors: Iterable[Any]) -> Self:
        return rebuilt(type(self), self._names, vectors)

    @property
    def rotational(self) -> Any:
        """(*batch, 3) the rotational part."""
        return self.vectors[0]

    @property
    def translational(self) -> Any:
        """(*batch, 3) the translational part."""
        return self.vectors[1]

    def to_array(self) -> jax.Array:
        """The coefficients (*batch, 6), rotational on top; as NumPy where JAX would narrow them. Exact."""
        return joined(*self.vectors)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return check.batch_shape(*self.vectors)

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return np.dtype(self.rotational.dtype)

    @property
    def size(self) -> int:
        """6, whatever the batch."""
        return 6

    def __getitem__(self, i: int) -> Any:
        """The i-th of the six components of one vector, rotational first."""
        if self.batch_shape:
            # Not an IndexError: Python would take it for the end when iterating.
            raise TypeError(
                f"{type(self).__name__}[i] is the i-th component of a single vector, this is a batch of shape "
                f"{self.batch_shape}; component i of all: x.to_array()[..., i], vector i of the batch: x.at_batch(i)"
            )
        i = operator.index(i)
        if not -6 <= i < 6:
            raise IndexError(f"{type(self).__name__}: expected a component index from -6 to 5, got {i}")
        return self.vectors[i % 6 // 3][i % 3]

    def __repr__(self) -> str:
        parts = ", ".join(f"{name}={shown(part, 3)}" for name, part in zip(self._names, self.vectors, strict=True))
        return f"{type(self).__name__}({parts})"


@typing.dataclass_transform(eq_default=False, frozen_default=True)
def spatial_vector(cls: type[_Parts]) -> type[_Parts]:
    """Class decorator: a frozen dataclass of two 3-vectors, rotational first, known to JAX as a pytree."""
    cls = tree(cls)
    cls._names = tuple(field.name for field in dataclasses.fields(cls))
    return cls


def joined(*parts: Any) -> Any:
    """(*batch, 6) of the two parts; as NumPy where JAX would narrow them."""
    arrays = [as_array(part, check.batch_shape(*parts)) for part in parts]
    if all(map(check.is_only_held, arrays)):
        return np.concatenate(arrays, axis=-1)
    arrays = to_double_word(arrays) if any(isinstance(x, DoubleWord) for x in arrays) else arrays
    return jax.tree.map(lambda *words: jnp.concatenate(words, axis=-1), *arrays)
