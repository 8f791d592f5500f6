"""Numbers rounded as the precision says: an array over the batch, or a number known while tracing, which folds."""

from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

import jax
import numpy as np
from jax import Array, lax

from jaxspatial.arithmetic.errorfree import reproducible
from jaxspatial.arithmetic.numbers import folding
from jaxspatial.arithmetic.numbers.protocol import Compared
from jaxspatial.arithmetic.precision import Precision


class Rounded(Compared):
    """An array over the batch, or a number known while tracing, whose operations are rounded as the precision says."""

    def __init__(self, precision: Precision, value: Any):
        self.precision, self.value = precision, value

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(self.value.dtype)

    @property
    def words(self) -> tuple[Any, ...]:
        return (self.value,)

    def with_words(self, words: Iterable[Any]) -> "Rounded":
        """A number of this kind."""
        return self._new(*words)

    def constant(self, number: float | Fraction) -> "Rounded":
        return self._new(self.dtype.type(float(number)))

    def of_word(self, word: Any) -> "Rounded":
        return self._new(word)

    def rounded(self) -> Any:
        return self.value

    def _of(self, other: "Rounded | float") -> Any:
        """The value of what stands beside this one."""
        return other.value if isinstance(other, Rounded) else self.dtype.type(other)

    def _new(self, value: Any) -> "Rounded":
        return Rounded(self.precision, value)

    def __add__(self, other: "Rounded | float") -> "Rounded":
        return self._new(folding.add(self.value, self._of(other), self.precision))

    __radd__ = __add__

    def __sub__(self, other: "Rounded | float") -> "Rounded":
        return self._new(folding.subtract(self.value, self._of(other), self.precision))

    def __rsub__(self, other: "Rounded | float") -> "Rounded":
        return self._new(folding.subtract(self._of(other), self.value, self.precision))

    def __mul__(self, other: "Rounded | float") -> "Rounded":
        return self._new(folding.multiply(self.precision, self.value, self._of(other)))

    __rmul__ = __mul__

    def __truediv__(self, other: "Rounded | float") -> "Rounded":
        return self._new(folding.divide(self.value, self._of(other)))

    def __rtruediv__(self, other: "Rounded | float") -> "Rounded":
        return self._new(folding.divide(self._of(other), self.value))

    def __neg__(self) -> "Rounded":
        return self._new(-self.value)

    def __abs__(self) -> "Rounded":
        return self._new(abs(self.value))

    def compared(self, comparison: Callable[[Any, Any], Any], other: "Rounded | float") -> Any:
        return comparison(*folding.alike(self.value, self._of(other)))

    def sqrt(self) -> "Rounded":
        return self._new(np.sqrt(self.value) if folding.is_known(self.value) else _root(self.value))


@jax.custom_jvp
def _root(x: Array) -> Array:
    return lax.sqrt(x)


@_root.defjvp  # pyright: ignore[reportFunctionMemberAccess]
def _root_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    """dx / (2 sqrt(x)), the quotient rounded on its own: `lax.sqrt` has one that depends on the program around it."""
    root = _root(*primals)
    return root, reproducible.quotient(*tangents, root + root)
