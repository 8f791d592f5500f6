"""Numbers rounded as the precision says: an array over the batch, or a number known while tracing, which folds.

A component that is known to be 0 or 1 leaves no operation behind, so that a formula written once becomes the program of
exactly this scene. A known 0 is an exact zero, also next to an infinity or a NaN; a 0 that arrives as data behaves as
IEEE 754 says. No axis of length 3 is ever reduced, and no product of matrices reaches a BLAS.
"""

import contextlib
import operator
from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree.barrier import difference, fixed_sum, product, quotient, root
from jaxspatial.numerics.errorfree.primitives import computed_at_once
from jaxspatial.numerics.precision import Precision

# What operators do to arrays of one shape and dtype, without asking: JAX traces it in half of the time. In "fast" the
# compiler may make one fma of a product and the addition that follows: error <= u |a b|, or none. It may also rearrange
# sums there, as holding on to every sum makes programs a quarter longer.
_OF_ARRAYS = {
    Precision.FAST: {operator.add: lax.add, operator.sub: lax.sub, operator.mul: lax.mul},
    Precision.REPRODUCIBLE: {operator.add: fixed_sum, operator.sub: difference, operator.mul: product},
}
_COMPARISONS = {operator.lt: lax.lt, operator.le: lax.le, operator.gt: lax.gt, operator.ge: lax.ge}
# Operands that are not arrays of JAX: numbers known while tracing, and what stands for an array.
# Its stub knows no operators.
_KNOWN: type[Any] = np.generic
_NO_ARRAYS: Any = (np.generic, floats.StandIn)
_Other = floats.StandIn | jax.typing.ArrayLike  # beside a number; vectors know their multiples
# Factors that leave no product behind.
_UNITS = 0, 1, -1


def is_known(a, *values: float) -> bool:
    """True for a number known while tracing, and, if there are values, only where it is one of them."""
    return isinstance(a, np.generic) and (not values or a in values)


def uniform(column: np.ndarray):
    """The number that a NumPy array is throughout, or None."""
    first = column.flat[0] if column.size else None
    return first if first is not None and (column == first).all() else None


@contextlib.contextmanager
def in_double():
    """Within, numbers that are known stay known, also while JAX traces a function around; in float64."""
    with computed_at_once(), jax.enable_x64(True):
        yield


# -- one operation -----------------------------------------------------------------------------------------------------
# Of arrays (*batch,), known numbers and double words. These are called for each operation of each formula: they test
# for `np.generic`, which is what `is_known` does, themselves.


def add(a, b, precision: Precision):
    if isinstance(a, np.generic) and a == 0:
        return b
    return a if isinstance(b, np.generic) and b == 0 else rounded_sum(operator.add, a, b, precision)


def subtract(a, b, precision: Precision):
    if is_known(b, 0):
        return a
    return _negative(b) if is_known(a, 0) else rounded_sum(operator.sub, a, b, precision)


def rounded_sum(operation: Callable, a, b, precision: Precision):
    """fl(a + b) or fl(a - b), also next to another sum with constants."""
    precision = precision.of_one_limb
    if isinstance(a, Array) and isinstance(b, Array):
        return _OF_ARRAYS[precision][operation](*((a, b) if a.shape == b.shape else broadcast(a, b)))
    return _with_known(operation, a, b, precision)


def multiply(a, b, precision: Precision):
    if isinstance(a, _NO_ARRAYS) or isinstance(b, _NO_ARRAYS):
        if isinstance(a, _KNOWN) and a in _UNITS:
            return a * a if a == 0 else b if a == 1 else _negative(b)
        if isinstance(b, _KNOWN) and b in _UNITS:
            return b * b if b == 0 else a if b == 1 else _negative(a)
        return _with_known(operator.mul, a, b, precision)
    return _OF_ARRAYS[precision][operator.mul](*((a, b) if a.shape == b.shape else broadcast(a, b)))


def _negative(a):
    return lax.neg(a) if isinstance(a, Array) else -a


def divide(a, b, _: Precision):
    """a / b; rounded on its own in every precision."""
    if is_known(b, 1) or is_known(a, 0):
        return a
    a, b = broadcast(a, b)
    if isinstance(a, _NO_ARRAYS) or isinstance(b, _NO_ARRAYS):
        return quietly(operator.truediv, a, b)
    return quotient(a, b)


def _with_known(operation: Callable, a, b, precision: Precision):
    """The operation where a number is known while tracing, or something stands for an array."""
    if beside := _beside_array(a, b):
        return _OF_ARRAYS[precision][operation](*beside)
    return quietly(operation, *broadcast(a, b))


def _beside_array(a, b) -> tuple | None:
    """An array and a known number in one dtype, None for others. The number stays one: repeated for all of the array,
    it would be one more operation to trace."""
    if isinstance(a, np.generic):
        return (b.dtype.type(a), b) if isinstance(b, Array) else None
    return (a, a.dtype.type(b)) if isinstance(b, np.generic) and isinstance(a, Array) else None


def quietly(operation: Callable, a, b):
    """The operation; on numbers known while tracing NumPy does it now, as silent about overflow and NaN as JAX is."""
    with np.errstate(all="ignore"):
        return operation(a, b)


def broadcast(a, b) -> tuple:
    """a and b over one shape; a known number beside an array made an array. A double word broadcasts itself."""
    is_known_a, is_known_b = isinstance(a, np.generic), isinstance(b, np.generic)
    if (is_known_a and is_known_b) or isinstance(a, floats.StandIn) or isinstance(b, floats.StandIn):
        return a, b
    if is_known_a or is_known_b:
        return (_filled(b, a), b) if is_known_a else (a, _filled(a, b))
    if a.shape == b.shape:
        return a, b
    shape = floats.broadcast_shapes(a.shape, b.shape)
    return jnp.broadcast_to(a, shape), jnp.broadcast_to(b, shape)


def _filled(like: Array, number) -> Array:
    """An array like another of one number. `jnp.full_like` asks so much that it took a third of tracing."""
    kind = jax.typeof(like)
    if not (like.shape and kind.sharding.mesh.empty) or kind.mat.varying:
        return jnp.full_like(like, number)
    return lax.broadcast_in_dim(kind.dtype.type(number), like.shape, ())


# -- numbers -----------------------------------------------------------------------------------------------------------


class Arithmetic:
    """Base of kinds of which all sums, products and quotients are made in one way."""

    def _operated(self, operation: Callable, other, is_reflected: bool = False) -> Any:
        """operation(self, other), of one of `operator`; operation(other, self) if reflected. Or NotImplemented."""
        raise NotImplementedError

    def __add__(self, other: "Arithmetic | _Other") -> Self:
        return self._operated(operator.add, other)

    __radd__ = __add__

    def __sub__(self, other: "Arithmetic | _Other") -> Self:
        return self._operated(operator.sub, other)

    def __rsub__(self, other: "Arithmetic | _Other") -> Self:
        return self._operated(operator.sub, other, is_reflected=True)

    def __mul__(self, other: "Arithmetic | _Other") -> Self:
        return self._operated(operator.mul, other)

    __rmul__ = __mul__

    def __truediv__(self, other: "Arithmetic | _Other") -> Self:
        return self._operated(operator.truediv, other)

    def __rtruediv__(self, other: "Arithmetic | _Other") -> Self:
        return self._operated(operator.truediv, other, is_reflected=True)


class Number(Arithmetic):
    """What formulas are written over: an array over the batch, however many digits it has, or a known number.

    Beside it, on either side of an operation, may stand another of its kind or a Python number.
    """

    if TYPE_CHECKING:
        # What each kind has, beside operators.
        @property
        def dtype(self) -> np.dtype: ...

        @property
        def limbs(self) -> tuple:
            """What it is the sum of: arrays, or numbers known while tracing."""
            ...

        def with_limbs(self, limbs: Iterable, /) -> Self:
            """A number of this kind."""
            ...

        def _constant(self, number: float | Fraction, /) -> Self:
            """The number of this kind nearest to a Fraction or Python number."""
            ...

        def _of_limb(self, limb, /) -> Self:
            """A number of this kind that is one limb."""
            ...

        def _rounded(self) -> jax.Array:
            """The number as one limb, up to rounding."""
            ...

        def __neg__(self) -> Self: ...

        def __abs__(self) -> Self: ...

        def sqrt(self) -> Self: ...

    def _compared(self, comparison: Callable, other) -> jax.Array:
        """What a comparison, one of `operator`, answers for this and the other."""
        raise NotImplementedError

    def __lt__(self, other) -> jax.Array:
        return self._compared(operator.lt, other)

    def __le__(self, other) -> jax.Array:
        return self._compared(operator.le, other)

    def __gt__(self, other) -> jax.Array:
        return self._compared(operator.gt, other)

    def __ge__(self, other) -> jax.Array:
        return self._compared(operator.ge, other)


_OPERATIONS = {operator.add: add, operator.sub: subtract, operator.mul: multiply, operator.truediv: divide}


class Rounded(Number):
    """An array over the batch, or a number known while tracing, whose operations are rounded as the precision says.

    JAX takes it for a tree of one array, or of one known number.
    """

    __slots__ = ("precision", "value", "operand")

    def __init__(self, precision: Precision, value: Any = None, operand: Any = None):
        """operand: the value to compute with, where that is behind a barrier; one of both may be left out."""
        self.precision = precision
        self.value = operand if value is None else value
        self.operand: Any = value if operand is None else operand

    @property
    def dtype(self) -> np.dtype:
        return np.dtype(self.value.dtype)

    @property
    def limbs(self) -> tuple:
        return (self.operand,)

    def with_limbs(self, limbs: Iterable) -> "Rounded":
        """A number of this kind."""
        return Rounded(self.precision, *limbs)

    def _constant(self, number: float | Fraction) -> "Rounded":
        return Rounded(self.precision, self.dtype.type(float(number)))

    def _of_limb(self, limb) -> "Rounded":
        return Rounded(self.precision, limb)

    def _rounded(self) -> jax.Array:
        return self.value

    def _operated(self, operation: Callable, other, is_reflected: bool = False):
        if not isinstance(other, Rounded):
            if isinstance(other, Sequence):
                return NotImplemented  # A vector, which knows its multiples itself.
            other = self._constant(other)
        a, b = (other, self) if is_reflected else (self, other)
        result = _OPERATIONS[operation](a.operand, b.operand, self.precision)
        # An operand that comes back as it went in is its number.
        if result is a.operand:
            return a
        return b if result is b.operand else Rounded(self.precision, result)

    def __neg__(self) -> "Rounded":
        return Rounded(self.precision, _negative(self.operand))

    def __abs__(self) -> "Rounded":
        return Rounded(self.precision, lax.abs(self.value) if isinstance(self.value, Array) else abs(self.value))

    def _compared(self, comparison: Callable, other: "Rounded | float"):
        other = other if isinstance(other, Rounded) else self._constant(other)
        a, b = self.operand, other.operand
        if beside := _beside_array(a, b):
            return _COMPARISONS[comparison](*beside)
        a, b = broadcast(a, b)
        of_arrays = isinstance(a, Array) and isinstance(b, Array)
        return _COMPARISONS[comparison](a, b) if of_arrays else comparison(a, b)

    def sqrt(self) -> "Rounded":
        return Rounded(self.precision, np.sqrt(self.value) if is_known(self.value) else root(self.operand))


jax.tree_util.register_dataclass(Rounded, data_fields=("operand",), meta_fields=("precision",))
