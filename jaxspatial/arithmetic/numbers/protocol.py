"""What a formula may ask of a number, as a type; and names for tuples of numbers, by what they hold."""

import operator
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Any, Protocol, Self

import jax
import numpy as np


class Number(Protocol):
    """A number that formulas are written over: an array over the batch, however many digits it has, or a known number.

    Beside it, on either side of an operation, may stand another of its kind or a Python number.
    """

    @property
    def dtype(self) -> np.dtype[Any]: ...

    @property
    def words(self) -> tuple[Any, ...]:
        """What it is the sum of: arrays, or numbers known while tracing."""
        ...

    def with_words(self, words: Iterable[Any], /) -> Self:
        """A number of this kind."""
        ...

    def constant(self, number: float | Fraction, /) -> Self:
        """The number of this kind nearest to a Fraction or Python number."""
        ...

    def of_word(self, word: Any, /) -> Self:
        """A number of this kind that is one word."""
        ...

    def rounded(self) -> Any:
        """The number as one word, up to rounding."""
        ...

    def __neg__(self) -> Self: ...

    def __abs__(self) -> Self: ...

    def __add__(self, other: Self | float, /) -> Self: ...

    def __radd__(self, other: Self | float, /) -> Self: ...

    def __sub__(self, other: Self | float, /) -> Self: ...

    def __rsub__(self, other: Self | float, /) -> Self: ...

    def __mul__(self, other: Self | float, /) -> Self: ...

    def __rmul__(self, other: Self | float, /) -> Self: ...

    def __truediv__(self, other: Self | float, /) -> Self: ...

    def __rtruediv__(self, other: Self | float, /) -> Self: ...

    def __lt__(self, other: Self | float, /) -> jax.Array: ...

    def __le__(self, other: Self | float, /) -> jax.Array: ...

    def __gt__(self, other: Self | float, /) -> jax.Array: ...

    def __ge__(self, other: Self | float, /) -> jax.Array: ...

    def sqrt(self) -> Self: ...


class Compared:
    """Base of kinds of which all comparisons are made in one way."""

    def compared(self, comparison: Callable[[Any, Any], Any], other: Any) -> Any:
        """What the comparison, one of arrays, answers for this and the other."""
        raise NotImplementedError

    def __lt__(self, other: Any) -> jax.Array:
        return self.compared(operator.lt, other)

    def __le__(self, other: Any) -> jax.Array:
        return self.compared(operator.le, other)

    def __gt__(self, other: Any) -> jax.Array:
        return self.compared(operator.gt, other)

    def __ge__(self, other: Any) -> jax.Array:
        return self.compared(operator.ge, other)


# Sequences, because a vector that comes from an array makes its numbers when they are asked for, see `stacking`.
Numbers = Sequence[Number]  # any number of them
Three = Sequence[Number]  # x, y, z
Symmetric = Sequence[Number]  # xx, xy, yy, xz, yz, zz of a symmetric matrix
Rows = Sequence[Three]  # of a matrix
Motion = tuple[Three, Three]  # (w, v), or (alpha, a)
Wrench = tuple[Three, Three]  # (tau, f)
Mask = jax.Array  # (*batch,): what comparisons answer
