"""Runs formulas over arrays: arguments become vectors of numbers of some kind, results become arrays again.

Outside of a trace a formula is one compiled program; inside, it becomes part of the program that is traced.
"""

import functools
import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from jaxspatial.numerics import floats, linear
from jaxspatial.numerics.errorfree.barrier import barrier
from jaxspatial.numerics.errorfree.primitives import of_any_mesh
from jaxspatial.numerics.linear import Articulated, Inertia, Matrix, Motion, Pose, Summed, Wrench
from jaxspatial.numerics.numbers import Corrected, Number, Rounded, components, high, is_number
from jaxspatial.numerics.numbers.components import Components
from jaxspatial.numerics.numbers.double_word import DoubleWord, to_double_word
from jaxspatial.numerics.numbers.layout import stack, stack_like, unstack, whole
from jaxspatial.numerics.numbers.polynomial import Quotient
from jaxspatial.numerics.numbers.rounded import add, is_known, subtract
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.sums.pairwise import pairwise_sum
from jaxspatial.numerics.sums.symbolic import run_symbolically


def formula(
    function: Callable | None = None,
    *,
    of_sums: bool = False,
    layout: Sequence[int | None] = (),
    by_number: bool = False,
) -> Any:
    """Turns a function of vectors of numbers into a function of (precision, *arrays, **static).

        shifted = formula(lambda F, p: Wrench(F.tau - cross(p, F.f), F.f), of_sums=True)
        tau, f = shifted("compensated", Wrench(tau, f), p)

    Arrays are (*batch, n), with batch shapes that broadcast. The function receives each as a Vector (n = 3), a
    Symmetric (6), a Matrix (9), or a tuple of n numbers; a Motion, Wrench, Pose, Inertia or Articulated of arrays
    arrives as one of vectors. It returns a number, a vector or matrix (which becomes an array with a last axis), a
    mask, or several of these: a list, or a Motion or the like, which becomes a list of arrays. Static arguments are
    hashable.

    of_sums: True where each result is a sum of products, or a quotient of two. These are evaluated

        fast, reproducible      in the inputs' dtype; bfloat16 in float32
        compensated, faithful   each result as a whole, as a polynomial: see `symbolic`

    and all others, with roots, inner quotients or selections,

        fast, reproducible      in the inputs' dtype; float16 and bfloat16 in float32
        compensated, faithful   in float64 for narrower dtypes, in double words for float64

    and rounded once at the end. If an argument is a double word, so are the results, in every precision. If an argument
    is Components, so is every result with an axis of components, and it knows what the structure of the arguments says
    about its numbers. If all Components among the arguments are zeros, results are arrays, and only zeros Components.

    layout: for each result, the index of the array whose memory layout it gets, None for any. XLA CPU writes a result
    transposed unless an addition ties it to an array, and then copies it in a second pass: see `layout.whole`.

    by_number: True where number i of a result depends on number i of each argument alone. The function then receives
    one number per argument, which stands for the whole array (*batch, n). It is for the coordinates of a mechanism:
    there may be many of them, and as components of a vector each would be a kernel of its own.

    Outside of any transformation a call is one compiled program, bitwise the same as inside a larger jit; it compiles
    once per precision, shapes and dtypes. While tracing, NumPy arrays are constants of the formula, and operations that
    they make unnecessary are left out; without such constants a cached trace is inlined.
    """
    if function is None:
        return functools.partial(formula, of_sums=of_sums, layout=layout, by_number=by_number)
    if by_number:
        of_numbers = function

        def of_vectors(*vectors, **static):
            return of_numbers(*(v[0] for v in vectors), **static)

        function = functools.wraps(of_numbers)(of_vectors)
    run = functools.partial(_run_sums, layout=tuple(layout)) if of_sums else _run
    program = functools.partial(_run_with_zeros, run, function)

    @functools.cache
    def compiled():
        """Made when it is first called: `jit` reads signatures, which for all formulas is a twentieth of an import."""
        return jax.jit(program, static_argnums=(0, 1, 2), inline=True)

    @functools.wraps(function)
    def call(precision, *trees, **static):
        groups: list = []
        arrays = []
        for x in trees:
            groups.append(type(x) if isinstance(x, _GROUPS) else None)
            arrays.extend(x) if groups[-1] else arrays.append(x)
        arrays = [x[..., None] for x in arrays] if by_number else arrays
        arrays = floats.narrowed_each(arrays)
        if Components in map(type, arrays) and not components.all_are_zero(arrays):
            # Beside Components, NumPy arrays are known where they are 0, 1 or -1.
            arrays = [components.as_components(a) if isinstance(a, np.ndarray) else a for a in arrays]
        known = np.ndarray in map(type, arrays)
        tracing = known and any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arrays))
        return (program if tracing else compiled())(
            resolve(precision), tuple(groups), tuple(sorted(static.items())), *arrays
        )

    return call


# Tuples of vectors that are one argument of a formula.
_GROUPS: Any = Motion, Wrench, Pose, Inertia, Articulated


def _applied(function: Callable, groups: Sequence, vectors: Iterable):
    """Calls the function with the vectors, grouped into Motions and the like: one result, or a list of several."""
    rest, arguments = iter(vectors), []
    for kind in groups:
        if kind is None:
            arguments.append(next(rest))
            continue
        x = kind(*(next(rest) for _ in kind._fields))
        # The mass, an array (*batch, 1), is a number.
        arguments.append(x._replace(mass=x.mass[0]) if kind is Inertia else x)
    result = function(*arguments)
    return list(result) if isinstance(result, _GROUPS) else result


@of_any_mesh
def _run_with_zeros(run: Callable, function: Callable, precision: Precision, groups, static, *arrays):
    """Runs a formula as `run` does; if all Components are zero, it computes with arrays, and returns only known zeros
    as Components."""
    call = functools.partial(_applied, functools.partial(function, **dict(static)) if static else function, groups)
    if Components not in map(type, arrays) or not components.all_are_zero(arrays):
        return run(call, precision, arrays)
    is_vector: list[bool] = []

    def noted(vectors):
        results = call(vectors)
        several: list = results if isinstance(results, list) else [results]
        is_vector[:] = [isinstance(x, (ArrayVector, tuple)) and not isinstance(x, Quotient) for x in several]
        return results

    results = run(noted, precision, [components.as_array(a, ()) for a in arrays])
    several = results if isinstance(results, list) else [results]
    several = [
        components.zero(x.shape[-1], x.dtype) if yes and components.is_zero(x) else x
        for yes, x in zip(is_vector, several, strict=True)
    ]
    return several if isinstance(results, list) else several[0]


def _run(function: Callable, precision: Precision, arrays: Sequence):
    is_pair = any(map(components.has_pairs, arrays))
    twice = is_pair or precision.sees_whole_sums
    with jax.enable_x64(bool(floats.config.jax_enable_x64) or twice):
        numbers = functools.partial(of_array, precision=precision, twice=twice)
        return _run_over(numbers, function, arrays, is_pair=is_pair)


def _run_over(
    numbers: Callable,
    function: Callable,
    arrays: Sequence,
    layout: Sequence[int | None] = (),
    is_pair: bool = False,
):
    """Broadcasts the arrays, converts each to a vector by `numbers`, calls the function, and rounds its results."""
    batch = floats.broadcast_shapes(*[a.shape[:-1] for a in arrays])
    are_components = Components in map(type, arrays)
    vectors = list(map(numbers, floats.broadcast_batch(batch, *arrays)))
    result = function([v.numbers if isinstance(v, ArrayVector) and v.size == 9 else v for v in vectors])
    results = _Results(batch, np.dtype(arrays[0].dtype), is_pair, are_components)
    if not isinstance(result, list):
        return results.rounded(_laid_out(result, vectors, layout[0] if layout else None))
    if layout:
        return [results.rounded(_laid_out(x, vectors, k)) for x, k in zip(result, layout, strict=False)]
    return [results.rounded(x) for x in result]


def _laid_out(x, vectors: Sequence, k: int | None):
    """A result in the memory layout of argument k."""
    if k is None or isinstance(x, ArrayVector) or not isinstance(vectors[k], ArrayVector):
        return x
    entries: Any = x.entries if isinstance(x, Matrix) else x
    like, values = vectors[k], [number.value for number in entries]
    return ArrayVector(like.precision, len(values), lambda: stack_like(like.array, values), lambda: values)


# -- sums of products --------------------------------------------------------------------------------------------------


def _run_sums(function: Callable, precision: Precision, arrays: Sequence, layout: Sequence[int | None]):
    if precision.sees_whole_sums or any(map(components.has_pairs, arrays)):
        return run_symbolically(function, precision, arrays)

    def numbers(array):
        if not are_components:
            return Argument(precision, array)
        values = components.as_components(array).components
        return linear.by_size(tuple(Rounded(precision, x, from_outside(x, precision)) for x in values))

    are_components = Components in map(type, arrays)
    if arrays[0].dtype != jnp.bfloat16:
        return _run_over(numbers, function, arrays, layout)
    # The barrier keeps the compiler from dropping the rounding to bfloat16 before it.
    wide = jax.tree.map(lambda x: barrier(x).astype(np.float32), arrays)
    results = _run_over(numbers, function, wide, layout)
    return jax.tree.map(functools.partial(converted, dtype=jnp.bfloat16), results)


# -- arrays as vectors of numbers --------------------------------------------------------------------------------------


class ArrayVector(Sequence[Any]):
    """A vector of numbers that is also an array (*batch, n); each form is made when it is first used.

    `+` and `-` with it on the left are one operation on whole arrays, unless some numbers are known.
    """

    def __init__(self, precision: Precision, size: int, make_array: Callable, make_values: Callable[[], Sequence]):
        self.precision, self.size = precision, size
        self._make_array, self._make_values = make_array, make_values

    @functools.cached_property
    def array(self):
        return self._make_array()

    @functools.cached_property
    def operand(self):
        """The array as an operand of further operations."""
        return self.array

    @functools.cached_property
    def numbers(self):
        """The numbers as a Vector, Symmetric, Matrix or tuple, see `linear.by_size`."""
        return linear.by_size(tuple(map(Rounded, itertools.repeat(self.precision), self._make_values())))

    def __getitem__(self, i):
        return self.numbers[i]

    def __iter__(self):
        return iter(self.numbers)

    def __len__(self) -> int:
        return self.size

    def __getattr__(self, name: str):
        if name.startswith("_"):
            raise AttributeError(name)
        return getattr(self.numbers, name)

    def __add__(self, other: Sequence) -> "ArrayVector":
        return self._as_whole(add, other)

    def __sub__(self, other: Sequence) -> "ArrayVector":
        return self._as_whole(subtract, other)

    def __neg__(self):
        return -self.numbers

    def __mul__(self, s):
        return self.numbers * s

    def __rmul__(self, s):
        return s * self.numbers

    def __truediv__(self, s):
        return self.numbers / s

    def __matmul__(self, other):
        return self.numbers @ other

    def __rmatmul__(self, other):
        return other @ self.numbers

    def _as_whole(self, operation: Callable, vector: Sequence) -> "ArrayVector":
        """`add` or `subtract` of this and a vector."""

        def array():
            others = vector.operand if isinstance(vector, ArrayVector) else [x.operand for x in vector]
            return whole(operation, self.operand, others, self.precision)

        def values() -> list:
            return [operation(a.operand, b.operand, self.precision) for a, b in zip(self, vector, strict=True)]

        return ArrayVector(self.precision, len(self), array, values)


class Argument(ArrayVector):
    """The numbers of an argument (*batch, n): its value is the array itself, its operand the array behind a barrier."""

    def __init__(self, precision: Precision, array):
        self.precision, self.size, self.array = precision, array.shape[-1], array

    @functools.cached_property
    def operand(self):
        return from_outside(self.array, self.precision)

    @functools.cached_property
    def numbers(self):
        values, operands = unstack(self.array), unstack(self.operand)
        return linear.by_size(tuple(map(Rounded, itertools.repeat(self.precision), values, operands)))


def from_outside(x, precision: Precision):
    """An argument behind a barrier, so that the compiler does not fuse the operations that computed it with ours.

    Precision "fast" needs none, and constants pass unchanged.
    """
    return x if precision is Precision.FAST else barrier(x)


# As trees they flatten to their numbers, and unflatten to plain tuples.
for _kind in (ArrayVector, Argument):
    jax.tree_util.register_pytree_node(_kind, lambda v: (tuple(v), None), lambda _, numbers: cast(Any, numbers))


def of_array(array, precision: Precision, twice: bool, dtype=None):
    """The components of an array (*batch, n) as numbers: a Vector, Symmetric, Matrix or tuple, see `linear.by_size`.

    twice: in twice the digits, float64 as double words and narrower dtypes in float64.
    dtype: the working precision, by default that of the array.
    """
    return linear.by_size(_components(array, precision, twice, np.dtype(dtype or array.dtype)))


def _components(array, precision: Precision, twice: bool, dtype: np.dtype) -> tuple:
    if isinstance(array, Components):
        return tuple(_components(c[..., None], precision, twice, np.dtype(c.dtype))[0] for c in array.components)
    if twice and dtype == np.float64:
        array = array if array.dtype == dtype else array.astype(dtype)
        return tuple(to_double_word(array[..., i]) for i in range(array.shape[-1]))
    wide = np.dtype(np.float64 if twice else np.float32 if floats.finfo(dtype).bits < 32 else dtype)
    precision = Precision.REPRODUCIBLE if twice else precision
    if isinstance(array, DoubleWord):
        parts = zip(*(unstack(limb) for limb in (array.hi, array.lo)), strict=True)
        return tuple(Rounded(precision, converted(hi, wide) + converted(lo, wide)) for hi, lo in parts)
    operands = unstack(from_outside(array, precision))
    values = unstack(array) if array.dtype == wide else [None] * len(operands)
    pairs = [(y if x is None else x, y) for x, y in zip(values, operands, strict=True)]
    return tuple([Rounded(precision, converted(x, wide), converted(y, wide)) for x, y in pairs])


def of_terms(array, precision: Precision, dtype: np.dtype) -> tuple:
    """The components of an array (*batch, n) as numbers of an algorithm over a mechanism.

    In "compensated" and "faithful" errors are small relative to the terms of results, and no bits are promised: float64
    is computed with corrections, narrower dtypes in float64, which the compiler may fuse.
    """
    if not precision.sees_whole_sums:
        return _components(array, precision, False, dtype)
    kind = Corrected if dtype == np.float64 else functools.partial(Rounded, Precision.FAST)
    return tuple(kind(converted(x, np.dtype(np.float64))) for x in unstack(array))


# -- what comes out ----------------------------------------------------------------------------------------------------


class _Results(NamedTuple):
    """Rounds the results of a formula to arrays, double words or Components over a batch, in the inputs' dtype."""

    batch: tuple[int, ...]
    dtype: np.dtype
    is_pair: bool
    are_components: bool

    def rounded(self, x) -> Any:
        """A number, vector, matrix, mask or `Summed`, as an array."""
        if isinstance(x, Summed):
            return self._summed(x.vector)
        if isinstance(x, ArrayVector):
            return x.array
        if isinstance(x, tuple):
            x = x.entries if isinstance(x, Matrix) else x
            parts = [self._number(c) for c in x]
            if self.are_components:
                return components.of(parts)
            return jax.tree.map(lambda *limbs: stack(limbs, self.batch), *parts)
        number = self._number(x)
        is_whole = not self.batch or not is_known(number)
        return number if is_whole else floats.numpy_for(self.batch).broadcast_to(number, self.batch)

    def _number(self, x):
        if not is_number(x):
            return jnp.broadcast_to(x, self.batch)
        if not self.is_pair:
            return self._over_batch(converted(high(x), self.dtype))
        if isinstance(x, DoubleWord):
            return jax.tree.map(self._over_batch, x)
        return to_double_word(jnp.broadcast_to(x.limbs[0], self.batch), self.dtype)

    def _over_batch(self, x):
        """The component of a result; one that is known stays known."""
        return x if is_known(x) else jnp.broadcast_to(x, self.batch)

    def _summed(self, vector):
        """The sum of a vector, (*batch, n, k) as an array, over n. Known zeros stay known; other sums are data."""
        if not self.are_components:
            x = self.rounded(vector)
            if isinstance(x, floats.NUMPY) and not x.any():
                return np.zeros((*x.shape[:-2], x.shape[-1]), x.dtype)
            return jnp.moveaxis(pairwise_sum(jnp.moveaxis(barrier(x), -1, 0)), 0, -1)
        parts = ((c, is_known(c, 0)) for c in (x.operand for x in vector))
        return components.of([c if is_0 else pairwise_sum(jnp.broadcast_to(c, self.batch)) for c, is_0 in parts])


def converted(x, dtype):
    """Converts to a dtype, with exactly one rounding.

    XLA may drop a conversion to 16 bits and back (`xla_allow_excess_precision`), unless something stands between: for
    bfloat16 a `reduce_precision`; for float16 a barrier, as `reduce_precision` flushes its subnormals.
    """
    if isinstance(x, (floats.NUMPY, np.generic)) or x.dtype == dtype or floats.finfo(dtype).bits >= 32:
        return x.astype(dtype) if isinstance(x, (floats.NUMPY, np.generic)) else lax.convert_element_type(x, dtype)
    if dtype == jnp.bfloat16:
        return lax.convert_element_type(lax.reduce_precision(x, exponent_bits=8, mantissa_bits=7), dtype)
    return barrier(lax.convert_element_type(x, dtype))


@formula(by_number=True)
def plus(a: Number, b: Number) -> Number:
    """a + b, of coordinates or of forces of joints."""
    return a + b
