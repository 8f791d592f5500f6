"""Arrays as vectors of numbers, and vectors of numbers as arrays."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic.check import NUMPY, SCALAR, finfo
from jaxspatial.arithmetic.errorfree.barrier import barrier
from jaxspatial.arithmetic.numbers import Corrected, Numbers, Rounded, folding, high
from jaxspatial.arithmetic.numbers.components import Components
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.trees import to_double_word
from jaxspatial.arithmetic.precision import Precision


class Stacked(Sequence[Any]):
    """A vector of numbers that is an array (*batch, n) as well: whichever is asked for is made.

    is_given: whether it comes from outside of it. It is passed on as it came, and computed with behind barriers.
    """

    def __init__(
        self,
        precision: Precision,
        size: int,
        make_array: Callable[[], Any],
        make_values: Callable[[], Sequence[Any]],
        is_given: bool = False,
    ):
        self.precision, self._size, self._is_given = precision, size, is_given
        self._make_array, self._make_values = make_array, make_values

    @functools.cached_property
    def array(self) -> Any:
        return self._make_array()

    @functools.cached_property
    def operand(self) -> Any:
        """The array, to compute with."""
        return from_outside(self.array, self.precision) if self._is_given else self.array

    @functools.cached_property
    def _numbers(self) -> Any:
        values = self._make_values()
        operands = folding.unstack(self.operand) if self._is_given else values
        return tuple(Rounded(self.precision, x, y) for x, y in zip(values, operands, strict=True))

    def __getitem__(self, i: Any) -> Any:
        return self._numbers[i]

    def __len__(self) -> int:
        return self._size

    def combined(self, operation: Callable[..., Any], vector: Sequence[Any]) -> "Stacked":
        """`folding.add` or `folding.subtract` of this and a vector: of arrays one operation, where it can be."""

        def whole() -> Any:
            others = vector.operand if isinstance(vector, Stacked) else [x.operand for x in vector]
            return folding.whole(operation, self.operand, others, self.precision)

        def apart() -> list[Any]:
            return [operation(a.operand, b.operand, self.precision) for a, b in zip(self, vector, strict=True)]

        return Stacked(self.precision, len(self), whole, apart)

    def laid_out(self, vector: Sequence[Any]) -> "Stacked":
        """A vector as an array in the layout of this one."""
        values = [x.value for x in vector]
        return Stacked(self.precision, len(values), lambda: folding.stack_like(self.array, values), lambda: values)


def stacked(precision: Precision, array: Any) -> Stacked:
    """The numbers of an array (*batch, n) from outside."""
    return Stacked(precision, array.shape[-1], lambda: array, lambda: folding.unstack(array), is_given=True)


def from_outside(x: Any, precision: Precision) -> Any:
    """An array that a caller computed, of whose operations a compiler would make one with ours: behind a barrier, but
    in "fast", and but for what is known while tracing."""
    return x if precision is Precision.FAST else barrier(x)


# It comes back as a tuple, which JAX allows and its stub does not.
jax.tree_util.register_pytree_node(Stacked, lambda v: (tuple(v), None), lambda _, numbers: cast(Any, tuple(numbers)))


class Summed(NamedTuple):
    """Of a vector the sum over the last axis of the batch: what a formula may return, but not go on with."""

    vector: Any


def of_array(array: Any, precision: Precision, twice: bool, dtype: Any = None) -> Numbers:
    """The components of an array (*batch, n) as numbers to compute with, such as those of `dtype`, if not its own."""
    dtype = np.dtype(dtype or array.dtype)
    if isinstance(array, Components):
        return tuple(of_array(c[..., None], precision, twice)[0] for c in array.components)
    if twice and dtype == np.float64:
        array = array if array.dtype == dtype else array.astype(dtype)
        return tuple(to_double_word(array[..., i]) for i in range(array.shape[-1]))
    wide = np.dtype(np.float64 if twice else np.float32 if finfo(dtype).bits < 32 else dtype)
    precision = Precision.REPRODUCIBLE if twice else precision
    if isinstance(array, DoubleWord):
        parts = zip(*(folding.unstack(word) for word in (array.hi, array.lo)), strict=True)
        return tuple(Rounded(precision, converted(hi, wide) + converted(lo, wide)) for hi, lo in parts)
    operands = folding.unstack(from_outside(array, precision))
    values = folding.unstack(array) if array.dtype == wide else [None] * len(operands)
    given = ((y if x is None else x, y) for x, y in zip(values, operands, strict=True))
    return tuple(Rounded(precision, *(converted(word, wide) for word in words)) for words in given)


def of_terms(array: Any, precision: Precision, dtype: np.dtype[Any]) -> Numbers:
    """`of_array`, for promises relative to the terms of results, and no promise of bits: in twice the digits by
    corrections, or in float64 as the compiler likes it."""
    if not precision.sees_whole_sums:
        return of_array(array, precision, False, dtype)
    kind = Corrected if dtype == np.float64 else functools.partial(Rounded, Precision.FAST)
    return tuple(kind(converted(x, np.dtype(np.float64))) for x in folding.unstack(array))


def as_array(x: Any, dtype: Any) -> Any:
    """The number as an array, or known number, of one word, rounded to a dtype."""
    return converted(high(x), dtype)


def converted(x: Any, dtype: Any) -> Any:
    """Rounded once: XLA has leave to drop a conversion to 16 bits and back (`xla_allow_excess_precision`).

    Not where something stands between. For float16 that is no `reduce_precision`, which flushes its subnormals.
    """
    if isinstance(x, (NUMPY, SCALAR)) or x.dtype == dtype or finfo(dtype).bits >= 32:
        return x.astype(dtype) if isinstance(x, (NUMPY, SCALAR)) else lax.convert_element_type(x, dtype)
    if dtype == jnp.bfloat16:
        return lax.convert_element_type(lax.reduce_precision(x, exponent_bits=8, mantissa_bits=7), dtype)
    return barrier(lax.convert_element_type(x, dtype))
