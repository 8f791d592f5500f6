"""Double words: a number as the unevaluated sum hi + lo of two floating-point numbers, with twice the bits of one.

The type, and what makes it of arrays and trees. Its arithmetic, with bounds and ranges, is that of `pairs`.
"""

import dataclasses
import fractions
import functools
import operator
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.errorfree.barrier import barrier_or_nan
from jaxspatial.numerics.numbers import pairs
from jaxspatial.numerics.numbers.rounded import Number
from jaxspatial.numerics.types import DTypeLike

# Of two pairs, and of a pair and a limb, by the operators that ask for them.
_OPERATIONS = {
    operator.add: (pairs.add, pairs.add_limb),
    operator.sub: (pairs.subtract, pairs.subtract_limb),
    operator.mul: (pairs.multiply, pairs.multiply_limb),
    operator.truediv: (pairs.divide, pairs.divide_limb),
}
# Of the quotient of what stands on the left of a pair.
_REFLECTED = (lambda x, y: pairs.divide(y, x)), (lambda x, b: pairs.divide(with_zero(b), x))
# Of two pairs.
_COMPARISONS = {
    operator.lt: pairs.less_than,
    operator.le: pairs.less_or_equal,
    operator.gt: lambda x, y: pairs.less_than(y, x),
    operator.ge: lambda x, y: pairs.less_or_equal(y, x),
    operator.eq: pairs.equal,
    operator.ne: lambda x, y: ~pairs.equal(x, y),
}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class DoubleWord(Number, floats.StandIn):
    """A number, or an array of them, as the unevaluated sum hi + lo: about twice the digits of its dtype.

        x = js.to_double_word(jnp.float32(1) / 3)
        y = js.from_double_word((x * x + 1) / x)      # as if computed in 48 bits, rounded once

    hi, lo: arrays of one shape and dtype (float16, bfloat16, float32 or float64). *unchecked* requirement
    hi = fl(hi + lo), hence |lo| <= ulp(hi) / 2; what does not have it: `js.to_double_word(hi) + lo`.

    `+ - * /`, comparisons and `sqrt` work with double words, arrays of the same dtype, which broadcast, and Python
    numbers, of which two limbs keep all bits (float32 limbs: 48 of 53). Relative errors, with u the unit roundoff of
    the dtype: + and - 3 u^2 + 13 u^3, also where they cancel; * 5 u^2; / 15 u^2 + 56 u^3; sqrt 25/8 u^2. With an array
    or a number of one limb: + and - 2 u^2, * 3/2 u^2 + 4 u^3, / 3 u^2. Ranges: see `numbers.pairs`.

    Comparisons are exact, and false with NaN (!= true). A pytree with leaves hi and lo. Derivatives are those of
    hi + lo, accurate to a few u; a gradient with respect to a double word holds the same number twice, in hi and in lo:
    take either, not their sum.

    Example:
        >>> x = js.to_double_word(jnp.float32(1.0)) + 2.0**-40
        >>> print(x.hi, x.lo == 2.0**-40)
        1.0 True
    """

    hi: Any
    lo: Any

    def __post_init__(self) -> None:
        """Checks what a caller passes. JAX rebuilds double words without it, with whatever leaves it needs."""
        if all(check.is_tree_mark(limb) for limb in (self.hi, self.lo)):
            return
        arguments = {"DoubleWord: hi": self.hi, "DoubleWord: lo": self.lo}
        limbs = {name: floats.as_float_array(limb, name) for name, limb in arguments.items()}
        check.require_same_dtype(**limbs)
        if len({limb.shape for limb in limbs.values()}) > 1:
            came = ", ".join(f"{name}: {limb.shape}" for name, limb in limbs.items())
            raise ValueError(f"DoubleWord: expected equal shapes, got {came}; see jnp.broadcast_to")
        for name, limb in zip(("hi", "lo"), limbs.values(), strict=True):
            # A copy: the caller may write to his own.
            object.__setattr__(self, name, barrier_or_nan(jnp.array(limb) if isinstance(limb, np.ndarray) else limb))

    # -- as an array ---------------------------------------------------------------------------------------------------

    @property
    def limbs(self) -> tuple:
        return self.hi, self.lo

    def with_limbs(self, limbs: Iterable) -> "DoubleWord":
        """A number of this kind, see `Number`.

        Example:
            >>> third = js.to_double_word(1.0) / 3.0
            >>> print((third.with_limbs(third.limbs) - third).hi)
            0.0
        """
        return of_limbs(limbs)

    def _constant(self, number: float | fractions.Fraction) -> "DoubleWord":
        """The one nearest to a Fraction or Python number, known while tracing, see `Number`."""
        high = float(number)
        rest = float(fractions.Fraction(number) - fractions.Fraction(high)) if np.isfinite(high) else 0.0
        return of_limbs(limb[()] for limb in map(np.asarray, of_numbers(high, self.dtype, rest)))

    def _of_limb(self, limb: jax.Array) -> "DoubleWord":
        """The one that is one limb, see `Number`."""
        return of_limbs(with_zero(jnp.asarray(limb)))

    def _rounded(self) -> jax.Array:
        """As one limb, see `Number`."""
        return self.hi

    @property
    def shape(self) -> tuple[int, ...]:
        return jnp.shape(self.hi)

    @property
    def dtype(self) -> np.dtype:
        """That of one limb."""
        return np.dtype(self.hi.dtype)

    def astype(self, dtype: DTypeLike) -> "DoubleWord":
        """In limbs of another dtype.

        Args:
            dtype: one of floating point that JAX has switched on.

        Returns:
            A DoubleWord of the same shape.

        Raises:
            TypeError: the dtype is not floating point, or off.

        Error: none into a wider dtype, else at most u^2 |x|, u of the new one.

        Example:
            >>> print(js.to_double_word(jnp.float32(1.0)).astype("float16").dtype)
            float16
        """
        return of_limbs(pairs.convert(self.limbs, known_dtype(dtype)))

    def reshape(self, *shape: int | tuple[int, ...]) -> "DoubleWord":
        """With another shape.

        Args:
            shape: the new one, as one tuple or number by number. -1 as in NumPy.

        Returns:
            A DoubleWord of it.

        Raises:
            TypeError: the sizes do not fit.

        Error: none, it is exact.

        Example:
            >>> print(js.to_double_word(jnp.ones((2, 3))).reshape((6,)).shape)
            (6,)
        """
        return of_limbs(limb.reshape(*shape) for limb in self.limbs)

    def __getitem__(self, index) -> "DoubleWord":
        return of_limbs(limb[index] for limb in self.limbs)

    def __iter__(self) -> Iterator["DoubleWord"]:
        # Without it Python would count up __getitem__ until an IndexError, which JAX never raises.
        return map(of_limbs, zip(*self.limbs, strict=True))

    def __bool__(self) -> bool:
        return bool(self != 0)

    def __float__(self) -> float:
        return float(self.hi) + float(self.lo)

    # -- arithmetic ----------------------------------------------------------------------------------------------------

    def __neg__(self) -> "DoubleWord":
        return of_limbs(pairs.negate(self.limbs))

    def __abs__(self) -> "DoubleWord":
        return of_limbs(pairs.absolute(self.limbs))

    def sqrt(self) -> "DoubleWord":
        """The square root: NaN below 0, -0 of -0, with an infinite derivative at 0.

        Returns:
            A DoubleWord of the same shape.

        Error: as `DoubleWord` states it.
        Source: Lefevre et al. 2023, Accurate calculation of Euclidean norms using double-word arithmetic, SQRTDWtoDW.

        Example:
            >>> root = js.to_double_word(jnp.float32(2.0)).sqrt()
            >>> print(abs(float(root.hi) + float(root.lo) - 2.0**0.5) < 1e-13)
            True
        """
        return of_limbs(pairs.square_root(self.limbs))

    def _operated(self, operation: Callable, other, is_reflected: bool = False):
        if is_reflected and operation is operator.sub:
            return (-self)._operated(operator.add, other)
        on_pairs, on_limb = _REFLECTED if is_reflected else _OPERATIONS[operation]
        result = self._beside(other, lambda x, y: (on_pairs if isinstance(y, tuple) else on_limb)(x, y))
        return result if result is NotImplemented else of_limbs(result)

    def _beside(self, other, operation: Callable):
        """operation(the pair of limbs of this one, the pair or limb of the other), broadcast to one shape."""
        limbs = _limbs_of(other, self.dtype)
        if limbs is NotImplemented:
            return NotImplemented
        first = jax.tree.leaves(limbs)[0]
        check.require_same_dtype(DoubleWord=self, other=first)
        shape = floats.common_batch_shape(DoubleWord=self.shape, other=first.shape)
        return operation(*jax.tree.map(functools.partial(jnp.broadcast_to, shape=shape), (self.limbs, limbs)))

    # -- comparison: arrays of answers; like arrays, what has __eq__ cannot be hashed ----------------------------------

    def __eq__(self, other: object) -> Any:
        return self._compared(operator.eq, other)

    def __ne__(self, other: object) -> Any:
        return self._compared(operator.ne, other)

    def _compared(self, comparison: Callable, other):
        of_pairs = _COMPARISONS[comparison]
        return self._beside(other, lambda x, y: of_pairs(x, y if isinstance(y, tuple) else with_zero(y)))

    def __repr__(self) -> str:
        return f"DoubleWord(hi={_shown(self.hi)}, lo={_shown(self.lo)})"


jax.tree_util.register_pytree_with_keys(
    DoubleWord,
    lambda x: (tuple((jax.tree_util.GetAttrKey(name), getattr(x, name)) for name in ("hi", "lo")), None),
    lambda _, limbs: of_limbs(limbs),
    lambda x: ((x.hi, x.lo), None),
)
jax.export.register_pytree_node_serialization(
    DoubleWord,
    serialized_name="jaxspatial.DoubleWord",
    serialize_auxdata=lambda _: b"",
    deserialize_auxdata=lambda _: None,
)


def of_limbs(limbs: Iterable) -> DoubleWord:
    """The double word of hi and lo, unchecked."""
    x = object.__new__(DoubleWord)
    for name, limb in zip(("hi", "lo"), limbs, strict=True):
        object.__setattr__(x, name, limb)
    return x


def with_zero(limb: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The pair of limbs that equals one."""
    return limb, lax.full_like(limb, 0)


def _limbs_of(x, dtype: DTypeLike):
    """What stands beside limbs of `dtype` in an operation: a pair, one limb where that says it all, NotImplemented."""
    if isinstance(x, DoubleWord):
        return x.limbs
    if isinstance(x, (int, float)):
        # Of an int, which may have more than 64 bits, in two parts.
        rounded = float(x)
        hi, lo = of_numbers(rounded, dtype, float(x - int(rounded)) if isinstance(x, int) else 0.0)
        return (hi, lo) if lo else hi
    if isinstance(x, (np.ndarray, np.generic)) and is_floating(x) and x.dtype != jnp.result_type(x):
        return of_numbers(x, jnp.result_type(x))
    is_array = isinstance(x, (np.ndarray, np.generic, jax.Array))
    return barrier_or_nan(floats.as_float_array(x, "DoubleWord: other")) if is_array else NotImplemented


def _shown(limb) -> str:
    """Up to six numbers, the shape of more or of something not computed yet."""
    if floats.is_computed(limb) and limb.ndim <= 1 and limb.size <= 6:
        numbers = [str(number) for number in np.asarray(limb).ravel()]
        return "[" + ", ".join(numbers) + "]" if limb.ndim else numbers[0]
    return check.in_short(limb)


# -- arrays and trees --------------------------------------------------------------------------------------------------


def to_double_word(x: object, dtype: DTypeLike | None = None) -> Any:
    """Every floating-point array of a tree as a DoubleWord: state carried at twice the precision across operations.

        state = js.to_double_word(state)
        state, _ = jax.lax.scan(step, state, inputs)
        state = js.from_double_word(state)

    Args:
        x: an array, a Python float, or a pytree of them. What is not floating point (integers, masks, keys) stays as it
            is, a DoubleWord too.
        dtype: of the limbs; by default the array's own, and then hi is the array and lo is 0. An array of a wider dtype
            is split between both limbs. By default this happens to float64 NumPy arrays and Python floats while JAX's
            64-bit types are off.

    Returns:
        The same tree, with a DoubleWord of the same shape in place of each array.

    Raises:
        TypeError: the dtype is not floating point.

    Error: none, it is exact, but of an array that is split: float64 in two float32 keeps 48 of 53 bits, error <=
        u^2 |x| = 2^-48 |x| while lo is no subnormal (|x| > 1e-30).

    Example:
        >>> F = js.to_double_word(js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0]))
        >>> p = js.to_double_word(jnp.array([2.0, 0.0, 0.0]))
        >>> print(F.shift(p).tau.hi)
        [ 0.  0. -1.]
    """
    dtype = None if dtype is None else known_dtype(dtype)
    return jax.tree.map(
        functools.partial(_as_double_word, dtype=dtype), x, is_leaf=lambda leaf: isinstance(leaf, DoubleWord)
    )


def _as_double_word(leaf, dtype: DTypeLike | None):
    if isinstance(leaf, DoubleWord):
        return leaf if dtype is None else leaf.astype(dtype)
    if not is_floating(leaf):
        return leaf
    if isinstance(leaf, (np.ndarray, np.generic)):
        leaf = floats.as_float_array(leaf, "to_double_word: x", keep_dtype=True)
    if isinstance(leaf, (float, np.ndarray)):
        return of_limbs(jnp.array(limb) for limb in of_numbers(leaf, dtype or jnp.result_type(leaf)))
    x = of_limbs(with_zero(barrier_or_nan(floats.as_float_array(leaf, "to_double_word: x"))))
    return x if dtype is None else x.astype(dtype)


def from_double_word(x: object, dtype: DTypeLike | None = None) -> Any:
    """Every DoubleWord of a tree as one array: hi + lo, rounded once. All else stays as it is.

    Args:
        x: a pytree of anything, or one DoubleWord.
        dtype: of the arrays; by default that of the limbs, where the result is hi of a normalised pair, and at least as
            wide: float32 limbs come out as float64 with up to 53 of their bits. Narrower would round twice, see
            `DoubleWord.astype`.

    Returns:
        The same tree, with an array of the same shape in place of each DoubleWord.

    Raises:
        TypeError: the dtype is not floating point.
        ValueError: the dtype does not hold that of the limbs.

    Error: at most u |hi + lo|, u the unit roundoff of the dtype.

    Example:
        >>> x = js.to_double_word(jnp.float32(1.0)) + 2.0**-20
        >>> print(js.from_double_word(x))
        1.000001
    """
    dtype = None if dtype is None else known_dtype(dtype)
    return jax.tree.map(functools.partial(_as_array, dtype=dtype), x, is_leaf=lambda leaf: isinstance(leaf, DoubleWord))


def _as_array(leaf, dtype: np.dtype | None):
    if not isinstance(leaf, DoubleWord):
        return leaf
    dtype = leaf.dtype if dtype is None else dtype
    if not pairs.holds(dtype, leaf.dtype):
        raise ValueError(f"from_double_word: dtype: expected one that holds {leaf.dtype}, got {dtype}; see astype")
    hi, lo = (lax.convert_element_type(limb, dtype) for limb in leaf.limbs)
    return hi + lo


# -- numbers from outside of JAX ---------------------------------------------------------------------------------------


def of_numbers(x, dtype: DTypeLike, rest=0.0) -> tuple:
    """The pair nearest to x + rest as NumPy arrays, of numbers of at most 64 bits, of which JAX may know only 32."""
    x = np.asarray(x, np.float64)
    with np.errstate(all="ignore"):
        high: np.ndarray = x.astype(dtype)
        rest = (x - high.astype(np.float64)) + rest
        low = np.where(np.isfinite(rest), rest, 0).astype(dtype)
        # Once more: NumPy rounds twice on the way from float64 to bfloat16. A zero keeps its sign.
        hi = np.where(low == 0, high, high + low)
        lo = low - (hi - high)
    return hi, np.where(low == 0, low, lo)


def is_floating(x) -> bool:
    """Whether x is a Python float or an array of floating point."""
    return isinstance(x, float) or (isinstance(x, floats.ARRAYS) and jnp.issubdtype(x.dtype, jnp.floating))


def known_dtype(dtype: DTypeLike) -> np.dtype:
    """A dtype as NumPy's, of floating point, and one that JAX knows as things are set."""
    dtype = floats.as_dtype(dtype)
    if jax.dtypes.canonicalize_dtype(dtype) != dtype:
        raise TypeError(f"dtype: expected one that JAX has switched on, got {dtype}; see jax.enable_x64")
    return dtype
