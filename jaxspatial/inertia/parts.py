"""What a spatial inertia is: mass, centre of mass and central inertia; checked, made, told."""

import functools
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Self, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, symmetric
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.quantity import Additive
from jaxspatial.arithmetic.tree import rebuilt
from jaxspatial.arithmetic.types import DTypeLike, Matrix3, Scalar, Six, Vector, Vector3
from jaxspatial.rotation.matrices import expanded, owned, shown


class Parts(Additive):
    """The three parts of `SpatialInertia`, which tells what they are."""

    mass: jax.Array
    com: jax.Array
    central: jax.Array

    _items = (), (3,), (6,)

    if TYPE_CHECKING:

        def __init__(self, mass: Scalar, com: Vector3, central: Six | Matrix3): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds inertias without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(leaf) for leaf in self._parts):
            return
        for name, array in zip(self.__match_args__, checked("SpatialInertia", *self._parts), strict=True):
            object.__setattr__(self, name, owned(array))

    # -- parts --------------------------------------------------------------------------------------------------------

    @property
    def _parts(self) -> tuple[Any, Any, Any]:
        return self.mass, self.com, self.central

    @property
    def vectors(self) -> tuple[Any, ...]:
        return expanded(self.mass), self.com, self.central

    def with_vectors(self, vectors: Iterable[Any]) -> Self:
        mass, com, central = vectors
        return self._like((mass[..., 0], com, central))

    @classmethod
    def _like(cls, parts: Iterable[Any]) -> Self:
        """Of parts that are right as they are."""
        return rebuilt(cls, cls.__match_args__, parts)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape."""
        return jnp.shape(self.mass)

    @property
    def dtype(self) -> np.dtype[Any]:
        """The dtype of the numbers."""
        return np.dtype(self.mass.dtype)

    def __repr__(self) -> str:
        named = zip(self.__match_args__, self._parts, (0, 3, 6), strict=True)
        return f"SpatialInertia({', '.join(f'{name}={shown(x, n)}' for name, x, n in named)})"


_Kind = TypeVar("_Kind", bound=Parts)


def moved(M: _Kind, batch_shape: tuple[int, ...], com: jax.Array, central: jax.Array) -> _Kind:
    """The inertia of the same mass, over a batch, with another centre of mass and other moments."""
    (mass,) = check.broadcast_batch(batch_shape, expanded(M.mass))
    return rebuilt(type(M), M.__match_args__, (M.mass if M.batch_shape == batch_shape else mass[..., 0], com, central))


# -- as arrays ---------------------------------------------------------------------------------------------------------


def checked(operation: str, mass: Scalar, com: Vector3, six: Six | Matrix3, name: str = "central") -> list[Any]:
    """The three as arrays of one dtype over their common batch, the last by six entries."""
    arguments: tuple[Any, ...] = mass, com, six
    dtype = check.floating_dtype(*arguments)
    given = {
        f"{operation}: mass": check.as_float_array(mass, f"{operation}: mass", dtype, held=True),
        f"{operation}: com": check.as_vectors(com, f"{operation}: com", dtype, held=True),
        f"{operation}: {name}": as_entries(six, f"{operation}: {name}", 6, dtype),
    }
    arrays = check.alike(**given)
    items = dict(zip(arrays, ((), (3,), (6,)), strict=True))
    shapes = {key: x.shape[: len(x.shape) - len(items[key])] for key, x in arrays.items()}
    batch = check.common_batch_shape(**shapes)
    return [x if shapes[key] == batch else _broadcast(x, (*batch, *items[key])) for key, x in arrays.items()]


def as_entries(x: Vector | Matrix3, name: str, n: int, dtype: DTypeLike | None = None) -> Any:
    """An array (*batch, n), or of matrices (*batch, 3, 3) their n entries: 6 of symmetric ones, or all 9."""
    array = check.as_float_array(x, name, dtype, held=True)
    if array.shape[-1:] == (n,):
        return array
    if array.shape[-2:] != (3, 3):
        raise ValueError(f"{name}: expected shape (*batch, 3, 3) or (*batch, {n}), got {array.shape}")
    return symmetric.from_matrix(array) if n == 6 else array.reshape((*array.shape[:-2], 9))


def _broadcast(array: Any, shape: tuple[int, ...]) -> Any:
    if isinstance(array, DoubleWord):
        over: Callable[[Any], Any] = functools.partial(jnp.broadcast_to, shape=shape)
        return jax.tree.map(over, array)
    if isinstance(array, check.StandIn):
        return array.over_batch(shape[:-1])
    xp: Any = np if isinstance(array, np.ndarray) else jnp
    return xp.broadcast_to(array, shape)
