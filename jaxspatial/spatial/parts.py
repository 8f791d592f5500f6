"""What a spatial vector is: two 3-vectors, rotational on top of translational, about one point, in one frame.

Which point, which body and which frame is said by names (monogram notation: `F_Bp_E` acts on body B at point Bp,
expressed in frame E), never stored: vectors of different frames can be stacked, scanned and batched.
"""

import operator
from typing import TYPE_CHECKING, Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.numbers.components import Components, as_array, is_components, is_zero, zero
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import to_double_word
from jaxspatial.arithmetic.quantity import Additive
from jaxspatial.arithmetic.types import Six, Vector3
from jaxspatial.rotation.matrices import owned, shown

# Stands for a part that is left out: a known zero, which takes the dtype of the other.
LEFT_OUT: Any = Components(0.0, 0.0, 0.0, dtype=np.float32)


class Parts(Additive):
    """Two parts by the names of the fields of a subclass: checked, made, told. One of them may be left out."""

    _items = (3,), (3,)
    _as_array = "to_array"

    if TYPE_CHECKING:

        def __init__(self, rotational: Vector3 = LEFT_OUT, translational: Vector3 = LEFT_OUT): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds vectors without it, with whatever leaves it needs."""
        kind, names = type(self).__name__, self.__match_args__
        given = {f"{kind}: {name}": getattr(self, name) for name in names if getattr(self, name) is not LEFT_OUT}
        if not given:
            raise TypeError(f"{kind}: expected {', '.join(names)} or both, got neither; zero is {kind}.zero()")
        parts, left_out = given, None
        if not all(map(check.is_tree_mark, given.values())):
            parts = check.alike(**{name: owned(check.as_vectors(x, name, held=True)) for name, x in given.items()})
            _require_one_batch(kind, parts)
            left_out = zero(3, next(iter(parts.values())).dtype) if len(parts) == 1 else None
        for name in names:
            object.__setattr__(self, name, parts.get(f"{kind}: {name}", left_out))

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

    # -- parts --------------------------------------------------------------------------------------------------------

    @property
    def vectors(self) -> tuple[Any, Any]:
        """Both parts. One that is a known zero alone takes the dtype of the other, whatever was made of that since."""
        first, second = (getattr(self, name) for name in self.__match_args__)
        return _zero_like(first, second), _zero_like(second, first)

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
        parts = ", ".join(f"{name}={shown(getattr(self, name), 3)}" for name in self.__match_args__)
        return f"{type(self).__name__}({parts})"


def _zero_like(x: Any, other: Any) -> Any:
    dtype = getattr(other, "dtype", None)
    return zero(3, dtype) if is_components(x) and is_zero(x) and dtype not in (None, x.dtype) else x


def _require_one_batch(kind: str, arrays: dict[str, Any]) -> None:
    batch_shapes = {name: a.shape[:-1] for name, a in arrays.items() if not check.goes_with_any_batch(a)}
    if len(set(batch_shapes.values())) > 1:
        came = ", ".join(f"{name}: {shape}" for name, shape in batch_shapes.items())
        raise ValueError(f"{kind}: expected equal batch shapes, got {came}; see jnp.broadcast_to")


def joined(*parts: Any) -> Any:
    """(*batch, 6) of the two parts; as NumPy where JAX would narrow them."""
    arrays = [as_array(part, check.batch_shape(*parts)) for part in parts]
    if all(map(check.is_only_held, arrays)):
        return np.concatenate(arrays, axis=-1)
    arrays = to_double_word(arrays) if any(isinstance(x, DoubleWord) for x in arrays) else arrays
    return jax.tree.map(lambda *words: jnp.concatenate(words, axis=-1), *arrays)
