"""Double words: a number as the unevaluated sum hi + lo of two floating-point numbers, with twice the bits of one.

Functions on pairs `(hi, lo)` first, then the type `DoubleWord` and the conversions of whole trees. The arrays of one
call to a function on pairs have one shape and one dtype.

The bounds are relative, in terms of u, the unit roundoff of the words' dtype (float32: 2^-24, so that u^2 is 4e-15;
float64: 2^-53 and 1e-32). They hold for normalised pairs, hi = fl(hi + lo), which all functions return, while no word
given is subnormal (XLA CPU takes subnormals for zero) and none exceeds (1 - 2^-12) finfo.max (float64: (1 - 2^-27)
finfo.max), beyond which products and quotients are those of `hi`. Parts of numbers below finfo.tiny are flushed to
zero: this adds up to 10 tiny to the error of a sum, 10 tiny (1 + |x| + |y|) to that of a product x y, and 10 tiny (1 +
(1 + |q|) / |d|) to that of a quotient q by d, or of a root with q = d, so that numbers below tiny / u^2 (float32:
4e-24, float64: 2e-276, bfloat16: 8e-34, float16: 256!) have fewer bits.

Where the operation on the words `hi` alone gives an infinity, a NaN or a zero of either sign, so does `hi`, and `lo`
is 0 (unless the words `lo` make of that zero a number).

Results are bitwise the same eager and compiled, in any batch and surrounding; sums and products commute bitwise.

Derivatives are those of the value hi + lo, accurate to a few u: the tangent of a result lies in its `hi` and depends on
the sum of the tangents of an operand's words; the rounding residual `lo` of a result has none.

[Joldes, Muller, Popescu 2017, Tight and rigorous error bounds for basic building blocks of double-word arithmetic, ACM
TOMS 44(2): the algorithms named by number] [Muller, Rideau 2022, Formalization of double-word arithmetic, and comments
on the former, ACM TOMS 48(1)] [Lefevre, Louvet, Muller, Picot, Rideau 2023, Accurate calculation of Euclidean norms
using double-word arithmetic, ACM TOMS 49(1)]
"""

import dataclasses
import fractions
import functools
import typing

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_derivatives import SymbolicZero, zero_from_primal

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.eft import fast_two_sum, two_product, two_sum
from jaxspatial.arithmetic.fence import fence
from jaxspatial.arithmetic.reproducible import product, quotient

# -- derivatives ------------------------------------------------------------------------------------------------------


def _differentiable(tangent) -> typing.Any:
    """Decorator of an operation on pairs and words, with `tangent(result, operands, tangents)` as its derivative.

    All three are values hi + lo in one word: hi up to rounding, but with the derivatives of the sum. A tangent known
    to be zero is None: times an infinite derivative it must not become NaN. Called outside of a transformation, an
    operation is one compiled program.
    """

    def decorate(operation):
        differentiable = jax.custom_jvp(operation)
        call = functools.wraps(operation)(jax.jit(differentiable, inline=True))

        def jvp(operands, tangents):
            hi, lo = call(*operands)
            d_hi = tangent(hi + lo, [_value(x) for x in operands], [_tangent_of_value(t) for t in tangents])
            return (hi, lo), (jnp.zeros_like(hi) if d_hi is None else d_hi, zero_from_primal(lo, symbolic_zeros=True))

        differentiable.defjvp(jvp, symbolic_zeros=True)
        return call

    return decorate


def _value(x):
    return x[0] + x[1] if isinstance(x, tuple) else x


def _tangent_of_value(tangents):
    return _sum(*(None if isinstance(t, SymbolicZero) else t for t in jax.tree.leaves(tangents)))


def _sum(*terms):
    """The sum of the terms that are there, None if none is."""
    there = [t for t in terms if t is not None]
    return functools.reduce(lax.add, there) if there else None


def _linear(operation, t, *others):
    """operation(t, *others) of a tangent that may be None."""
    return None if t is None else operation(t, *others)


def _sum_tangent(_, operands, tangents):
    return _sum(*tangents)


def _product_tangent(_, operands, tangents):
    (a, b), (da, db) = operands, tangents
    return _sum(_linear(product, da, b), _linear(product, db, a))


def _quotient_tangent(result, operands, tangents):
    """d(a / b) = (da - (a / b) db) / b."""
    (_, b), (da, db) = operands, tangents
    return _linear(quotient, _sum(da, _linear(lax.neg, _linear(product, db, result))), b)


def _root_tangent(result, _, tangents):
    """d sqrt(a) = da / (2 sqrt(a)): infinite at 0."""
    return _linear(quotient, tangents[0], result + result)


# -- operations on pairs and words ------------------------------------------------------------------------------------


def negate(x):
    """-x, exactly."""
    return -x[0], -x[1]


def absolute(x):
    """|x|, exactly."""
    return lax.abs(x[0]), lax.select(lax.lt(x[0], lax.full_like(x[0], 0)), -x[1], x[1])


@_differentiable(_sum_tangent)
def add(x, y):
    """x + y of two pairs. Error <= (3 u^2 + 13 u^3) |x + y|, also where they cancel. 20 flops. [Algorithm 6]"""
    s, s_error = two_sum(x[0], y[0])
    t, t_error = two_sum(x[1], y[1])
    high, low = _normalised(s, s_error + t)
    return _settled(s, high, t_error + low)


@_differentiable(_sum_tangent)
def add_word(x, b):
    """x + b of a pair and a word. Error <= 2 u^2 |x + b|. 10 flops. [Algorithm 4]"""
    s, error = two_sum(x[0], b)
    return _settled(s, s, x[1] + error)


def subtract(x, y):
    """x - y of two pairs. Error <= (3 u^2 + 13 u^3) |x - y|."""
    return add(x, negate(y))


def subtract_word(x, b):
    """x - b of a pair and a word. Error <= 2 u^2 |x - b|."""
    return add_word(x, -b)


@_differentiable(_product_tangent)
def multiply(x, y):
    """x y of two pairs. Error <= 5 u^2 |x y|. 16 flops and 2 splits. [Algorithm 10; 7 u^2 there, 5 u^2 in Muller 2022]

    The products with low words are rounded on their own: contracted ones would not commute.
    """
    p, error = two_product(x[0], y[0])
    return _settled(p, p, error + (product(x[0], y[1]) + product(x[1], y[0])))


@_differentiable(_product_tangent)
def multiply_word(x, b):
    """x b of a pair and a word. Error <= (3/2 u^2 + 4 u^3) |x b|. 17 flops and 2 splits. [Algorithm 7]"""
    return _settled(*_times_word(x, b))


def _times_word(x, b):
    """(fl(hi b), high, low), with x b = high + low but for the error of `multiply_word`. Not yet normalised."""
    p, error = two_product(x[0], b)
    high, low = fast_two_sum(p, product(x[1], b))
    return p, high, low + error


@_differentiable(_quotient_tangent)
def divide(x, y):
    """x / y of two pairs. Error <= (15 u^2 + 56 u^3) |x / y|. 25 flops and 2 splits. [Algorithm 17]"""
    q = quotient(x[0], y[0])
    _, high, low = _times_word(y, q)
    high, low = _normalised(high, low)
    # Fenced, here and below: of a constant x the compiler would add up the words, (c1 - e) + c2 = (c1 + c2) - e.
    rest = fence(x[0] - high) + (x[1] - low)
    return _settled(q, q, quotient(rest, y[0]))


@_differentiable(_quotient_tangent)
def divide_word(x, b):
    """x / b of a pair and a word. Error <= 3 u^2 |x / b|. 17 flops and 2 splits. [Algorithm 15]"""
    q = quotient(x[0], b)
    p, error = two_product(q, b)
    rest = fence((x[0] - p) - error) + x[1]
    return _settled(q, q, quotient(rest, b))


@_differentiable(_root_tangent)
def square_root(x):
    """sqrt(x) of a pair. Error <= 25/8 u^2 sqrt(x). 18 flops and 2 splits. [Lefevre 2023, SQRTDWtoDW]

    Without a fused multiply-add: hi - r^2 is a floating-point number, found as (hi - p) - error without rounding.
    """
    r = lax.sqrt(x[0])
    p, error = two_product(r, r)
    rest = fence((x[0] - p) - error) + x[1]
    return _settled(r, r, quotient(rest, r + r))


def _normalised(high, low):
    """`fast_two_sum`, with `low` fenced: the compiler would take c1 + (x + c2) for x + (c1 + c2)."""
    return fast_two_sum(high, fence(low))


def _settled(single, high, low):
    """high + low as a normalised pair; where that is not finite, `single`, the operation on the high words, and 0.

    An infinity has no error term (inf - inf is NaN), a zero no sign left after its error was added. *unchecked*
    requirement |high| >= |low| or high == 0.
    """
    high, low = _normalised(high, low)
    finite = _is_finite(high)
    # Equal numbers of which only `single` has the right sign, if they are 0.
    hi = lax.select(finite & lax.ne(high, single), high, single)
    return hi, lax.select(finite, low, lax.full_like(low, 0))


def _is_finite(x):
    return lax.le(lax.abs(x), lax.full_like(x, jnp.finfo(x.dtype).max))


# -- comparisons: exact on normalised pairs, which represent a number in one way --------------------------------------


def less(x, y):
    """x < y: false where either is NaN."""
    return lax.lt(x[0], y[0]) | (lax.eq(x[0], y[0]) & lax.lt(x[1], y[1]))


def less_equal(x, y):
    """x <= y: false where either is NaN."""
    return lax.lt(x[0], y[0]) | (lax.eq(x[0], y[0]) & lax.le(x[1], y[1]))


def equal(x, y):
    """x == y: false where either is NaN."""
    return lax.eq(x[0], y[0]) & lax.eq(x[1], y[1])


# -- conversions ------------------------------------------------------------------------------------------------------


def convert(x, dtype):
    """The pair in words of another dtype: exact into a wider one, else with an error <= u^2 |x|, u of that dtype."""
    return _conversion(np.dtype(dtype))(x)


@functools.cache
def _conversion(dtype):
    def tangent(result, operands, tangents):
        return _linear(lax.convert_element_type, tangents[0], dtype)

    def converted(x):
        wide = _wide(x[0].dtype, dtype)
        s, error = two_sum(*(lax.convert_element_type(word, wide) for word in x))
        # Fenced: a compiler may leave out a conversion there and back.
        high = fence(lax.convert_element_type(s, dtype))
        low = (s - lax.convert_element_type(high, wide)) + error
        return _settled(high, high, lax.convert_element_type(low, dtype))

    return _differentiable(tangent)(converted)


def _words_of_numbers(x, dtype, rest=0.0):
    """The pair nearest to x + rest as NumPy arrays, of numbers of at most 64 bits, of which JAX may know only 32."""
    x = np.asarray(x, np.float64)
    with np.errstate(all="ignore"):
        high = x.astype(dtype)
        rest = (x - high.astype(np.float64)) + rest
        low = np.where(np.isfinite(rest), rest, 0).astype(dtype)
        # Once more: NumPy rounds twice on the way from float64 to bfloat16. A zero keeps its sign.
        hi = np.where(low == 0, high, high + low)
        lo = low - (hi - high)
    return hi, np.where(low == 0, low, lo)


def nearest_double_word(number, dtype):
    """The DoubleWord nearest to a Fraction or Python number, known while tracing."""
    high = float(number)
    rest = float(fractions.Fraction(number) - fractions.Fraction(high)) if np.isfinite(high) else 0.0
    return _rebuild(word[()] for word in map(np.asarray, _words_of_numbers(high, dtype, rest)))


def _wide(a, b):
    """The narrowest dtype that holds both."""
    return a if _holds(a, b) else b if _holds(b, a) else np.dtype(np.float32)


def _holds(a, b):
    a, b = jnp.finfo(a), jnp.finfo(b)
    return a.nmant >= b.nmant and a.maxexp >= b.maxexp


# -- the type ---------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class DoubleWord(check.Number):
    """A number, or an array of them, as the unevaluated sum hi + lo: about twice the digits of its dtype.

        x = js.to_double_word(jnp.float32(1) / 3)
        y = js.from_double_word((x * x + 1) / x)      # as if computed in 48 bits, rounded once

    hi, lo: arrays of one shape and dtype (float16, bfloat16, float32 or float64). *unchecked* requirement
    hi = fl(hi + lo), hence |lo| <= ulp(hi) / 2; what does not have it: `js.to_double_word(hi) + lo`.

    `+ - * /`, comparisons and `sqrt` work with double words, arrays of the same dtype, which broadcast, and Python
    numbers, of which two words keep all bits (float32 words: 48 of 53). Relative errors, with u the unit roundoff of
    the dtype: + and - 3 u^2 + 13 u^3, also where they cancel; * 5 u^2; / 15 u^2 + 56 u^3; sqrt 25/8 u^2. With an array
    or a number of one word: + and - 2 u^2, * 3/2 u^2 + 4 u^3, / 3 u^2. Ranges: see the module.

    Comparisons are exact, and false with NaN (!= true). A pytree with leaves hi and lo. Derivatives are those of
    hi + lo, accurate to a few u; a gradient with respect to a double word holds the same number twice, in hi and in lo:
    take either, not their sum.
    """

    hi: typing.Any
    lo: typing.Any

    # NumPy and JAX arrays on the left of an operator leave it to us.
    __array_ufunc__ = None

    def __post_init__(self):
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
            object.__setattr__(self, name, jnp.array(word) if isinstance(word, np.ndarray) else word)

    # -- as an array --------------------------------------------------------------------------------------------------

    @property
    def _words(self):
        return self.hi, self.lo

    @property
    def shape(self):
        return jnp.shape(self.hi)

    @property
    def ndim(self):
        return len(self.shape)

    @property
    def dtype(self):
        """That of one word."""
        return np.dtype(self.hi.dtype)

    def astype(self, dtype):
        """In words of another dtype: exact into a wider one, else with an error <= u^2 |x|, u of that dtype."""
        return _rebuild(convert(self._words, _known_dtype(dtype)))

    def reshape(self, *shape):
        return _rebuild(word.reshape(*shape) for word in self._words)

    def __getitem__(self, index):
        return _rebuild(word[index] for word in self._words)

    def __iter__(self):
        # Without it Python would count up __getitem__ until an IndexError, which JAX never raises.
        return map(_rebuild, zip(*self._words, strict=True))

    def __bool__(self):
        return bool(self != 0)

    def __float__(self):
        return float(self.hi) + float(self.lo)

    # -- arithmetic ---------------------------------------------------------------------------------------------------

    def __neg__(self):
        return _rebuild(negate(self._words))

    def __abs__(self):
        return _rebuild(absolute(self._words))

    def sqrt(self):
        """See `sqrt`."""
        return _rebuild(square_root(self._words))

    def __add__(self, other):
        return self._combined(other, add, add_word)

    __radd__ = __add__

    def __sub__(self, other):
        return self._combined(other, subtract, subtract_word)

    def __rsub__(self, other):
        return (-self).__add__(other)

    def __mul__(self, other):
        return self._combined(other, multiply, multiply_word)

    __rmul__ = __mul__

    def __truediv__(self, other):
        return self._combined(other, divide, divide_word)

    def __rtruediv__(self, other):
        return self._combined(other, lambda x, y: divide(y, x), lambda x, b: divide(_with_zero(b), x))

    def _combined(self, other, on_pairs, on_word):
        operands = self._operands(other)
        if operands is NotImplemented:
            return NotImplemented
        return _rebuild((on_pairs if isinstance(operands[1], tuple) else on_word)(*operands))

    def _operands(self, other):
        """The pair of words of this one, and the pair or word of the other, broadcast to one shape."""
        words = _words_of(other, self.dtype)
        if words is NotImplemented:
            return NotImplemented
        first = jax.tree.leaves(words)[0]
        check.require_same_dtype(DoubleWord=self, other=first)
        shape = check.common_batch_shape(DoubleWord=self.shape, other=first.shape)
        return jax.tree.map(lambda word: jnp.broadcast_to(word, shape), (self._words, words))

    # -- comparison: arrays of answers; like arrays, what has __eq__ cannot be hashed ---------------------------------

    def __lt__(self, other):
        return self._compared(other, less)

    def __le__(self, other):
        return self._compared(other, less_equal)

    def __gt__(self, other):
        return self._compared(other, lambda x, y: less(y, x))

    def __ge__(self, other):
        return self._compared(other, lambda x, y: less_equal(y, x))

    def __eq__(self, other):
        return self._compared(other, equal)

    def __ne__(self, other):
        return self._compared(other, lambda x, y: ~equal(x, y))

    def _compared(self, other, comparison):
        operands = self._operands(other)
        if operands is NotImplemented:
            return NotImplemented
        x, y = operands
        return comparison(x, y if isinstance(y, tuple) else _with_zero(y))

    def __repr__(self):
        return f"DoubleWord(hi={_shown(self.hi)}, lo={_shown(self.lo)})"


jax.tree_util.register_pytree_with_keys(
    DoubleWord,
    lambda x: (tuple((jax.tree_util.GetAttrKey(name), getattr(x, name)) for name in ("hi", "lo")), None),
    lambda _, words: _rebuild(words),
    lambda x: ((x.hi, x.lo), None),
)
jax.export.register_pytree_node_serialization(
    DoubleWord,
    serialized_name="jaxspatial.DoubleWord",
    serialize_auxdata=lambda _: b"",
    deserialize_auxdata=lambda _: None,
)


def _rebuild(words):
    x = object.__new__(DoubleWord)
    for name, word in zip(("hi", "lo"), words, strict=True):
        object.__setattr__(x, name, word)
    return x


def _with_zero(word):
    return word, lax.full_like(word, 0)


def _words_of(x, dtype):
    """What stands beside words of `dtype` in an operation: a pair, one word where that says it all, NotImplemented."""
    if isinstance(x, DoubleWord):
        return x._words
    if isinstance(x, (int, float)):
        hi, lo = _words_of_number(x, dtype)
        return (hi, lo) if lo else hi
    if isinstance(x, (np.ndarray, np.generic)) and _is_floating(x) and x.dtype != jnp.result_type(x):
        return _words_of_numbers(x, jnp.result_type(x))
    is_array = isinstance(x, (np.ndarray, np.generic, jax.Array))
    return check.as_float_array(x, "DoubleWord: other") if is_array else NotImplemented


def _words_of_number(x, dtype):
    """The pair nearest to a Python number; of an int, which may have more than 64 bits, in two parts."""
    rounded = float(x)
    rest = float(x - int(rounded)) if isinstance(x, int) else 0.0
    return _words_of_numbers(rounded, dtype, rest)


def _is_floating(x):
    return isinstance(x, float) or (hasattr(x, "dtype") and jnp.issubdtype(x.dtype, jnp.floating))


def _known_dtype(dtype):
    """A dtype as NumPy's, of floating point, and one that JAX knows as things are set."""
    dtype = np.dtype(dtype)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise TypeError(f"dtype: expected float16, bfloat16, float32 or float64, got {dtype}")
    if jax.dtypes.canonicalize_dtype(dtype) != dtype:
        raise TypeError(f"dtype: expected one that JAX has switched on, got {dtype}; see jax.enable_x64")
    return dtype


def _shown(word):
    """Up to six numbers, the shape of more or of something not computed yet."""
    concrete = isinstance(word, (np.ndarray, jax.Array)) and not isinstance(word, jax.core.Tracer)
    if concrete and word.ndim <= 1 and word.size <= 6:
        numbers = [str(number) for number in np.asarray(word).ravel()]
        return "[" + ", ".join(numbers) + "]" if word.ndim else numbers[0]
    if hasattr(word, "shape") and hasattr(word, "dtype"):
        return f"{np.dtype(word.dtype).name}[{','.join(map(str, word.shape))}]"
    return repr(word)


# -- functions of double words and of trees of them -------------------------------------------------------------------


def sqrt(x):
    """The square root of a DoubleWord, or of an array to twice its digits, as a DoubleWord.

    Error <= 25/8 u^2 sqrt(x). As `jnp.sqrt`: NaN below 0, -0 of -0, an infinite derivative at 0.
    """
    return to_double_word(x).sqrt()


def to_double_word(x, dtype=None):
    """Every floating-point array of a tree as a DoubleWord: state carried at twice the precision across operations.

    x: an array, a Python float, or a pytree of them. What is not floating point (integers, masks, keys) stays as it is,
    a DoubleWord too.
    dtype: of the words; by default the array's own, and then hi is the array and lo is 0. An array of a wider dtype is
    split between both words: float64 in two float32 keeps 48 of 53 bits, error <= u^2 |x| = 2^-48 |x| while lo is no
    subnormal (|x| > 1e-30). By default this happens to float64 NumPy arrays and Python floats while JAX's 64-bit types
    are off.

        state = js.to_double_word(state)
        state, _ = jax.lax.scan(step, state, inputs)
        state = js.from_double_word(state)
    """
    dtype = None if dtype is None else _known_dtype(dtype)
    return jax.tree.map(lambda leaf: _as_double_word(leaf, dtype), x, is_leaf=_is_double_word)


def _as_double_word(leaf, dtype):
    if _is_double_word(leaf):
        return leaf if dtype is None else leaf.astype(dtype)
    if not _is_floating(leaf):
        return leaf
    if isinstance(leaf, (float, np.ndarray, np.generic)):
        return _rebuild(map(jnp.array, _words_of_numbers(leaf, dtype or jnp.result_type(leaf))))
    x = _rebuild(_with_zero(check.as_float_array(leaf, "to_double_word: x")))
    return x if dtype is None else x.astype(dtype)


def from_double_word(x, dtype=None):
    """Every DoubleWord of a tree as one array: hi + lo, rounded once. All else stays as it is.

    dtype: of the arrays; by default that of the words, where the result is hi of a normalised pair, and at least as
    wide: float32 words come out as float64 with up to 53 of their bits. (Narrower would round twice; see `astype`.)
    """
    dtype = None if dtype is None else _known_dtype(dtype)
    return jax.tree.map(lambda leaf: _as_word(leaf, dtype), x, is_leaf=_is_double_word)


def _as_word(leaf, dtype):
    if not _is_double_word(leaf):
        return leaf
    dtype = leaf.dtype if dtype is None else dtype
    if not _holds(dtype, leaf.dtype):
        raise ValueError(f"from_double_word: dtype: expected one that holds {leaf.dtype}, got {dtype}; see astype")
    hi, lo = (lax.convert_element_type(word, dtype) for word in leaf._words)
    return hi + lo


def _is_double_word(x):
    return isinstance(x, DoubleWord)
