"""Double words of arrays and of whole trees, and arrays of double words."""

import functools
import typing

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.errorfree.barrier import proving_barrier
from jaxspatial.arithmetic.numbers import conversion
from jaxspatial.arithmetic.numbers.double_word import DoubleWord, of_words, with_zero
from jaxspatial.arithmetic.types import DTypeLike


def to_double_word(x: typing.Any, dtype: DTypeLike | None = None) -> typing.Any:
    """Every floating-point array of a tree as a DoubleWord: state carried at twice the precision across operations.

        state = js.to_double_word(state)
        state, _ = jax.lax.scan(step, state, inputs)
        state = js.from_double_word(state)

    Args:
        x: an array, a Python float, or a pytree of them. What is not floating point (integers, masks, keys) stays as it
            is, a DoubleWord too.
        dtype: of the words; by default the array's own, and then hi is the array and lo is 0. An array of a wider dtype
            is split between both words. By default this happens to float64 NumPy arrays and Python floats while JAX's
            64-bit types are off.

    Returns:
        The same tree, with a DoubleWord of the same shape in place of each array.

    Raises:
        TypeError: the dtype is not floating point.

    Error: none, it is exact, but of an array that is split: float64 in two float32 keeps 48 of 53 bits, error <=
        u^2 |x| = 2^-48 |x| while lo is no subnormal (|x| > 1e-30).
    """
    dtype = None if dtype is None else conversion.known_dtype(dtype)
    return jax.tree.map(functools.partial(_as_double_word, dtype=dtype), x, is_leaf=_is_double_word)


def _as_double_word(leaf: typing.Any, dtype: DTypeLike | None) -> typing.Any:
    if _is_double_word(leaf):
        return leaf if dtype is None else leaf.astype(dtype)
    if not conversion.is_floating(leaf):
        return leaf
    if isinstance(leaf, (float, np.ndarray, np.generic)):
        return of_words(jnp.array(word) for word in conversion.of_numbers(leaf, dtype or jnp.result_type(leaf)))
    x = of_words(with_zero(proving_barrier(check.as_float_array(leaf, "to_double_word: x"))))
    return x if dtype is None else x.astype(dtype)


def from_double_word(x: typing.Any, dtype: DTypeLike | None = None) -> typing.Any:
    """Every DoubleWord of a tree as one array: hi + lo, rounded once. All else stays as it is.

    Args:
        x: a pytree of anything, or one DoubleWord.
        dtype: of the arrays; by default that of the words, where the result is hi of a normalised pair, and at least as
            wide: float32 words come out as float64 with up to 53 of their bits. Narrower would round twice, see
            `DoubleWord.astype`.

    Returns:
        The same tree, with an array of the same shape in place of each DoubleWord.

    Raises:
        TypeError: the dtype is not floating point.
        ValueError: the dtype does not hold that of the words.

    Error: at most u |hi + lo|, u the unit roundoff of the dtype.
    """
    dtype = None if dtype is None else conversion.known_dtype(dtype)
    return jax.tree.map(functools.partial(_as_word, dtype=dtype), x, is_leaf=_is_double_word)


def _as_word(leaf: typing.Any, dtype: np.dtype[typing.Any] | None) -> typing.Any:
    if not _is_double_word(leaf):
        return leaf
    dtype = leaf.dtype if dtype is None else dtype
    if not conversion.holds(dtype, leaf.dtype):
        raise ValueError(f"from_double_word: dtype: expected one that holds {leaf.dtype}, got {dtype}; see astype")
    hi, lo = (lax.convert_element_type(word, dtype) for word in leaf.words)
    return hi + lo


def _is_double_word(x: object) -> typing.TypeGuard[DoubleWord]:
    return isinstance(x, DoubleWord)
