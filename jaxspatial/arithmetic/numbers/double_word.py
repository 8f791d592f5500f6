"""Double words: a number as the unevaluated sum hi + lo of two floating-point numbers, with twice the bits of one.

The type. Its arithmetic, with bounds and ranges, is that of `pairs`; conversions are in `trees`.
"""

import dataclasses
import fractions
import functools
import typing
from collections.abc import Callable, Iterable, Iterator

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import DTypeLike

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.errorfree.barrier import proving_barrier
from jaxspatial.arithmetic.numbers import conversion, pairs

_Operation = Callable[[typing.Any, typing.Any], typing.Any]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class DoubleWord(check.StandIn):
    """A number, or an array of them, as the unevaluated sum hi + lo: about twice the digits of its dtype.

        x = js.to_double_word(jnp.float32(1) / 3)
        y = js.from_double_word((x * x + 1) / x)      # as if computed in 48 bits, rounded once

    hi, lo: arrays of one shape and dtype (float16, bfloat16, float32 or float64). *unchecked* requirement
    hi = fl(hi + lo), hence |lo| <= ulp(hi) / 2; what does not have it: `js.to_double_word(hi) + lo`.

    `+ - * /`, comparisons and `sqrt` work with double words, arrays of the same dtype, which broadcast, and Python
    numbers, of which two words keep all bits (float32 words: 48 of 53). Relative errors, with u the unit roundoff of
    the dtype: + and - 3 u^2 + 13 u^3, also where they cancel; * 5 u^2; / 15 u^2 + 56 u^3; sqrt 25/8 u^2. With an array
    or a number of one word: + and - 2 u^2, * 3/2 u^2 + 4 u^3, / 3 u^2. Ranges: see `numbers.pairs`.

    Comparisons are exact, and false with NaN (!= true). A pytree with leaves hi and lo. Derivatives are those of
    hi + lo, accurate to a few u; a gradient with respect to a double word holds the same number twice, in hi and in lo:
    take either, not their sum.
    """

    hi: typing.Any
    lo: typing.Any

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds double words without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(word) for word in (self.hi, self.lo)):
            return
        given = {"DoubleWord: hi": self.hi, "DoubleWord: lo": self.lo}
        words = {name: check.as_float_array(word, name) for name, word in given.items()}
        check.require_same_dtype(**words)
        if len({word.shape for word in words.values()}) > 1:
            came = ", ".join(f"{name}: {word.shape}" for name, word in words.items())
            raise ValueError(f"DoubleWord: expected equal shapes, got {came}; see jnp.broadcast_to")
        for name, word in zip(("hi", "lo"), words.values(), strict=True):
            # A copy: the caller may write to his own.
            object.__setattr__(self, name, proving_barrier(jnp.array(word) if isinstance(word, np.ndarray) else word))

    # -- as an array --------------------------------------------------------------------------------------------------

    @property
    def words(self) -> tuple[typing.Any, typing.Any]:
        return self.hi, self.lo

    def with_words(self, words: Iterable[typing.Any]) -> "DoubleWord":
        """A number of this kind, see `Number`."""
        return of_words(words)

    def constant(self, number: float | fractions.Fraction) -> "DoubleWord":
        """The one nearest to a Fraction or Python number, known while tracing, see `Number`."""
        high = float(number)
        rest = float(fractions.Fraction(number) - fractions.Fraction(high)) if np.isfinite(high) else 0.0
        return of_words(word[()] for word in map(np.asarray, conversion.of_numbers(high, self.dtype, rest)))

    def of_word(self, word: jax.Array) -> "DoubleWord":
        """The one that is one word, see `Number`."""
        return of_words(with_zero(jnp.asarray(word)))

    def rounded(self) -> jax.Array:
        """As one word, see `Number`."""
        return self.hi

    @property
    def shape(self) -> tuple[int, ...]:
        return jnp.shape(self.hi)

    @property
    def dtype(self) -> np.dtype[typing.Any]:
        """That of one word."""
        return np.dtype(self.hi.dtype)

    def astype(self, dtype: DTypeLike) -> "DoubleWord":
        """In words of another dtype.

        Args:
            dtype: one of floating point that JAX has switched on.

        Returns:
            A DoubleWord of the same shape.

        Raises:
            TypeError: the dtype is not floating point, or off.

        Error: none into a wider dtype, else at most u^2 |x|, u of the new one.
        """
        return of_words(pairs.convert(self.words, conversion.known_dtype(dtype)))

    def reshape(self, *shape: typing.Any) -> "DoubleWord":
        """With another shape.

        Args:
            shape: the new one, as one tuple or number by number. -1 as in NumPy.

        Returns:
            A DoubleWord of it.

        Raises:
            TypeError: the sizes do not fit.

        Error: none, it is exact.
        """
        return of_words(word.reshape(*shape) for word in self.words)

    def __getitem__(self, index: typing.Any) -> "DoubleWord":
        return of_words(word[index] for word in self.words)

    def __iter__(self) -> Iterator["DoubleWord"]:
        # Without it Python would count up __getitem__ until an IndexError, which JAX never raises.
        return map(of_words, zip(*self.words, strict=True))

    def __bool__(self) -> bool:
        return bool(self != 0)

    def __float__(self) -> float:
        return float(self.hi) + float(self.lo)

    # -- arithmetic ---------------------------------------------------------------------------------------------------

    def __neg__(self) -> "DoubleWord":
        return of_words(pairs.negate(self.words))

    def __abs__(self) -> "DoubleWord":
        return of_words(pairs.absolute(self.words))

    def sqrt(self) -> "DoubleWord":
        """The square root: NaN below 0, -0 of -0, with an infinite derivative at 0.

        Returns:
            A DoubleWord of the same shape.

        Error: as `DoubleWord` states it.
        Source: Lefevre et al. 2023, Accurate calculation of Euclidean norms using double-word arithmetic, SQRTDWtoDW.
        """
        return of_words(pairs.square_root(self.words))

    def __add__(self, other: typing.Any) -> "DoubleWord":
        return self._combined(other, pairs.add, pairs.add_word)

    __radd__ = __add__

    def __sub__(self, other: typing.Any) -> "DoubleWord":
        return self._combined(other, pairs.subtract, pairs.subtract_word)

    def __rsub__(self, other: typing.Any) -> "DoubleWord":
        return (-self).__add__(other)

    def __mul__(self, other: typing.Any) -> "DoubleWord":
        return self._combined(other, pairs.multiply, pairs.multiply_word)

    __rmul__ = __mul__

    def __truediv__(self, other: typing.Any) -> "DoubleWord":
        return self._combined(other, pairs.divide, pairs.divide_word)

    def __rtruediv__(self, other: typing.Any) -> "DoubleWord":
        return self._combined(other, lambda x, y: pairs.divide(y, x), lambda x, b: pairs.divide(with_zero(b), x))

    def _combined(self, other: typing.Any, on_pairs: _Operation, on_word: _Operation) -> typing.Any:
        found = self._beside(other, lambda x, y: (on_pairs if isinstance(y, tuple) else on_word)(x, y))
        return found if found is NotImplemented else of_words(found)

    def _beside(self, other: typing.Any, operation: _Operation) -> typing.Any:
        """operation(the pair of words of this one, the pair or word of the other), broadcast to one shape."""
        words = _words_of(other, self.dtype)
        if words is NotImplemented:
            return NotImplemented
        first = jax.tree.leaves(words)[0]
        check.require_same_dtype(DoubleWord=self, other=first)
        shape = check.common_batch_shape(DoubleWord=self.shape, other=first.shape)
        return operation(*jax.tree.map(functools.partial(jnp.broadcast_to, shape=shape), (self.words, words)))

    # -- comparison: arrays of answers; like arrays, what has __eq__ cannot be hashed ---------------------------------

    def __lt__(self, other: typing.Any) -> jax.Array:
        return self._compared(other, pairs.less)

    def __le__(self, other: typing.Any) -> jax.Array:
        return self._compared(other, pairs.less_equal)

    def __gt__(self, other: typing.Any) -> jax.Array:
        return self._compared(other, lambda x, y: pairs.less(y, x))

    def __ge__(self, other: typing.Any) -> jax.Array:
        return self._compared(other, lambda x, y: pairs.less_equal(y, x))

    def __eq__(self, other: typing.Any) -> typing.Any:
        return self._compared(other, pairs.equal)

    def __ne__(self, other: typing.Any) -> typing.Any:
        return self._compared(other, lambda x, y: ~pairs.equal(x, y))

    def _compared(self, other: typing.Any, comparison: _Operation) -> typing.Any:
        return self._beside(other, lambda x, y: comparison(x, y if isinstance(y, tuple) else with_zero(y)))

    def __repr__(self) -> str:
        return f"DoubleWord(hi={_shown(self.hi)}, lo={_shown(self.lo)})"


jax.tree_util.register_pytree_with_keys(
    DoubleWord,
    lambda x: (tuple((jax.tree_util.GetAttrKey(name), getattr(x, name)) for name in ("hi", "lo")), None),
    lambda _, words: of_words(words),
    lambda x: ((x.hi, x.lo), None),
)
jax.export.register_pytree_node_serialization(
    DoubleWord,
    serialized_name="jaxspatial.DoubleWord",
    serialize_auxdata=lambda _: b"",
    deserialize_auxdata=lambda _: None,
)


def of_words(words: Iterable[typing.Any]) -> DoubleWord:
    """The double word of hi and lo, unchecked."""
    x = object.__new__(DoubleWord)
    for name, word in zip(("hi", "lo"), words, strict=True):
        object.__setattr__(x, name, word)
    return x


def with_zero(word: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The pair of words that equals one."""
    return word, lax.full_like(word, 0)


def _words_of(x: typing.Any, dtype: DTypeLike) -> typing.Any:
    """What stands beside words of `dtype` in an operation: a pair, one word where that says it all, NotImplemented."""
    if isinstance(x, DoubleWord):
        return x.words
    if isinstance(x, (int, float)):
        hi, lo = conversion.of_number(x, dtype)
        return (hi, lo) if lo else hi
    if isinstance(x, (np.ndarray, np.generic)) and conversion.is_floating(x) and x.dtype != jnp.result_type(x):
        return conversion.of_numbers(x, jnp.result_type(x))
    is_array = isinstance(x, (np.ndarray, np.generic, jax.Array))
    return proving_barrier(check.as_float_array(x, "DoubleWord: other")) if is_array else NotImplemented


def _shown(word: typing.Any) -> str:
    """Up to six numbers, the shape of more or of something not computed yet."""
    if check.is_computed(word) and word.ndim <= 1 and word.size <= 6:
        numbers = [str(number) for number in np.asarray(word).ravel()]
        return "[" + ", ".join(numbers) + "]" if word.ndim else numbers[0]
    return check.in_short(word)
