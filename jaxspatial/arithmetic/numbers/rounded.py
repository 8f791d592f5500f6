"""Numbers rounded as the precision says: an array over the batch, or a number known while tracing, which folds."""

import functools
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

    def __init__(self, precision: Precision, value: Any, operand: Any = None):
        """operand: the value to compute with, if it is a caller's: behind a barrier."""
        self.precision, self.value = precision, value
        self.operand = value if operand is None else operand

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(self.value.dtype)

    @property
    def words(self) -> tuple[Any, ...]:
        return (self.operand,)

    def with_words(self, words: Iterable[Any]) -> "Rounded":
        """A number of this kind."""
        return self._new(*words)

    def constant(self, number: float | Fraction) -> "Rounded":
        return self._new(self.dtype.type(float(number)))

    def of_word(self, word: Any) -> "Rounded":
        return self._new(word)

    def rounded(self) -> Any:
        return self.value

    def _of(self, other: "Rounded | float") -> "Rounded":
        """What stands beside this one."""
        return other if isinstance(other, Rounded) else self._new(self.dtype.type(other))

    def _new(self, value: Any) -> "Rounded":
        return Rounded(self.precision, value)

    def _result(self, operation: Callable[[Any, Any], Any], other: "Rounded") -> "Rounded":
        """operation(this, other); what it just passes on stays as it is."""
        found = operation(self.operand, other.operand)
        return next((x for x in (self, other) if found is x.operand), None) or self._new(found)

    def __add__(self, other: "Rounded | float") -> "Rounded":
        return self._result(functools.partial(folding.add, precision=self.precision), self._of(other))

    __radd__ = __add__

    def __sub__(self, other: "Rounded | float") -> "Rounded":
        return self._result(functools.partial(folding.subtract, precision=self.precision), self._of(other))

    def __rsub__(self, other: "Rounded | float") -> "Rounded":
        return self._of(other) - self

    def __mul__(self, other: "Rounded | float") -> "Rounded":
        return self._result(functools.partial(folding.multiply, self.precision), self._of(other))

    __rmul__ = __mul__

    def __truediv__(self, other: "Rounded | float") -> "Rounded":
        return self._result(folding.divide, self._of(other))

    def __rtruediv__(self, other: "Rounded | float") -> "Rounded":
        return self._of(other) / self

    def __neg__(self) -> "Rounded":
        return self._new(-self.operand)

    def __abs__(self) -> "Rounded":
        return self._new(abs(self.value))

    def compared(self, comparison: Callable[[Any, Any], Any], other: "Rounded | float") -> Any:
        return comparison(*folding.alike(self.operand, self._of(other).operand))

    def sqrt(self) -> "Rounded":
        return self._new(np.sqrt(self.value) if folding.is_known(self.value) else _root(self.operand))


@jax.custom_jvp
def _root(x: Array) -> Array:
    return lax.sqrt(x)


@_root.defjvp  # pyright: ignore[reportFunctionMemberAccess]
def _root_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    """dx / (2 sqrt(x)), the quotient rounded on its own: `lax.sqrt` has one that depends on the program around it."""
    root = _root(*primals)
    return root, reproducible.quotient(*tangents, root + root)
