"""What a spatial inertia is: mass, centre of mass and central inertia; checked, made, told."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.quantity import Additive
from jaxspatial.arithmetic.tree import rebuilt
from jaxspatial.arithmetic.types import Matrix3, Scalar, Six, Vector3
from jaxspatial.inertia.arguments import checked
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
