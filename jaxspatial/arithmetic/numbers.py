"""Formulas that are no sums of products (roots, quotients, angles, selections), and the numbers they run in.

Such a formula is written once, over numbers with `+ - * /`, comparisons and the functions below, and runs in what the
precision asks for:

    fast, reproducible      Lanes of the inputs' dtype; of float32 for float16 and bfloat16
    compensated, faithful   Lanes of float64 for narrower dtypes, double words for float64

and is rounded once at the end. Lanes fold what is known while tracing, see `lanes`.
"""

import functools
import operator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.experimental.xla_metadata import set_xla_metadata

from jaxspatial.arithmetic import check, components, lanes, reproducible, scaling
from jaxspatial.arithmetic.components import Components
from jaxspatial.arithmetic.double_word import DoubleWord, nearest_double_word, to_double_word
from jaxspatial.arithmetic.precision import Precision, resolve


class Lane:
    """An array over the batch, or a number known while tracing, whose products are rounded as the precision says."""

    def __init__(self, precision, value):
        self.precision, self.value = precision, value

    @property
    def dtype(self):
        return np.dtype(self.value.dtype)

    def _of(self, other):
        """The value of what stands beside this one."""
        return other.value if isinstance(other, Lane) else self.dtype.type(other)

    def _new(self, value):
        return Lane(self.precision, value)

    def __add__(self, other):
        return self._new(lanes.add(self.value, self._of(other), self.precision))

    __radd__ = __add__

    def __sub__(self, other):
        return self._new(lanes.subtract(self.value, self._of(other), self.precision))

    def __rsub__(self, other):
        return self._new(lanes.subtract(self._of(other), self.value, self.precision))

    def __mul__(self, other):
        return self._new(lanes.multiply(self.precision, self.value, self._of(other)))

    __rmul__ = __mul__

    def __truediv__(self, other):
        return self._new(lanes.divide(self.value, self._of(other)))

    def __rtruediv__(self, other):
        return self._new(lanes.divide(self._of(other), self.value))

    def __neg__(self):
        return self._new(-self.value)

    def __abs__(self):
        return self._new(abs(self.value))

    def __lt__(self, other):
        return self._compared(operator.lt, other)

    def __le__(self, other):
        return self._compared(operator.le, other)

    def __gt__(self, other):
        return self._compared(operator.gt, other)

    def __ge__(self, other):
        return self._compared(operator.ge, other)

    def _compared(self, comparison, other):
        return comparison(*lanes.alike(self.value, self._of(other)))

    def sqrt(self):
        return self._new(np.sqrt(self.value) if lanes.is_known(self.value) else _root(self.value))


@jax.custom_jvp
def _root(x):
    return lax.sqrt(x)


@_root.defjvp  # pyright: ignore[reportFunctionMemberAccess]
def _root_jvp(primals, tangents):
    """dx / (2 sqrt(x)), the quotient rounded on its own: `lax.sqrt` has one that depends on the program around it."""
    root = _root(*primals)
    return root, reproducible.quotient(*tangents, root + root)


Number = Lane | DoubleWord


def constant(like, number):
    """The number nearest to a Fraction or Python number, of the kind of another."""
    if isinstance(like, DoubleWord):
        return nearest_double_word(number, like.dtype)
    return Lane(like.precision, like.dtype.type(float(number)))


def where(condition, a, b) -> Any:
    """a where the condition holds, else b; one of them may be a Python number."""
    like = a if isinstance(a, Number) else b
    a, b = (x if isinstance(x, Number) else constant(like, x) for x in (a, b))
    if isinstance(condition, (bool, np.bool_)):
        return a if condition else b
    if isinstance(like, DoubleWord):
        return jax.tree.map(functools.partial(_selected, condition), a, b)
    return Lane(like.precision, _selected(condition, a.value, b.value))


def _selected(condition, a, b):
    shape = np.broadcast_shapes(condition.shape, np.shape(a), np.shape(b))
    return lax.select(*(jnp.broadcast_to(jnp.asarray(x), shape) for x in (condition, a, b)))


def high(x):
    """The number as one array, up to rounding: to decide upon."""
    return x.hi if isinstance(x, DoubleWord) else x.value


def nearest_integer(x):
    """The integer nearest to x, of one word; a constant to derivatives."""
    value = high(x)
    if lanes.is_known(value) and isinstance(x, Lane):
        return Lane(x.precision, np.round(value))
    rounded = lax.round(lax.stop_gradient(value), lax.RoundingMethod.TO_NEAREST_EVEN)
    return to_double_word(rounded) if isinstance(x, DoubleWord) else Lane(x.precision, rounded)


def frozen(x):
    """x, a constant to derivatives."""
    if isinstance(x, DoubleWord):
        return jax.tree.map(lax.stop_gradient, x)
    return Lane(x.precision, x.value if lanes.is_known(x.value) else lax.stop_gradient(x.value))


def times_power_of_two(x, e):
    """x 2^e for integers e (*batch,), exactly but for underflow."""
    if isinstance(x, DoubleWord):
        return jax.tree.map(lambda word: scaling.times_power_of_two(word, e), x)
    if lanes.is_known(x.value) and isinstance(e, np.integer):
        return Lane(x.precision, lanes.quietly(np.ldexp, x.value, e))
    return x if lanes.is_known(x.value, 0) else Lane(x.precision, scaling.times_power_of_two(jnp.asarray(x.value), e))


def doubled(x, times=1):
    """x 2^times, for a number of times known while tracing."""
    if isinstance(x, DoubleWord):
        return jax.tree.map(lambda word: word * word.dtype.type(2.0**times), x)
    return x * 2.0**times


def noinline_pairs(function) -> Any:
    """A function of numbers that are double words becomes a call that the compiler does not inline.

    Each of their operations is ten of the processor's; fused into one another they would be computed again for every
    use, and compile for minutes.
    """

    @functools.wraps(function)
    def call(*numbers):
        if not any(isinstance(x, DoubleWord) for x in jax.tree.leaves(numbers, is_leaf=_is_double_word)):
            return function(*numbers)
        with set_xla_metadata(inlineable="false"):
            return jax.jit(function)(*numbers)

    return call


def noinline(function) -> Any:
    """A function of numbers becomes a call that the compiler does not inline.

    For what many entries of a result are made of: it would be computed again for each of them. What is known stays so
    on both sides of the call; arguments and results are trees of numbers, and of anything else that is known.
    """

    @functools.wraps(function)
    def call(*arguments):
        leaves, tree = jax.tree.flatten(arguments, is_leaf=is_number)
        results = []

        def on_data(data):
            result = function(*jax.tree.unflatten(tree, with_data(leaves, data)))
            results.extend(jax.tree.flatten(result, is_leaf=is_number))
            return data_of(results[0])

        if not any(map(_is_data, leaves)):
            return function(*arguments)
        with set_xla_metadata(inlineable="false"):
            data = jax.jit(on_data)(data_of(leaves))
        return jax.tree.unflatten(results[1], with_data(results[0], data))

    return call


def is_number(x):
    """True for a Lane or a double word."""
    return isinstance(x, Number)


def _is_data(x):
    return not lanes.is_known(x.value) if isinstance(x, Lane) else isinstance(x, (jax.Array, DoubleWord))


def data_of(leaves):
    """What of numbers and masks is not known while tracing: the arrays of lanes, and double words."""
    return [x.value if isinstance(x, Lane) else x for x in leaves if _is_data(x)]


def with_data(leaves, data):
    """The leaves, with other data for that which `data_of` finds."""
    data = iter(data)
    return [x if not _is_data(x) else x._new(next(data)) if isinstance(x, Lane) else next(data) for x in leaves]


def as_data(x):
    """A number that is known as one that is not: a loop has the same of these at every turn."""
    return x._new(jnp.asarray(x.value)) if isinstance(x, Lane) and lanes.is_known(x.value) else x


def mapped(function, *numbers):
    """A function of arrays, applied to numbers that are data, word by word."""
    words = [jax.tree.leaves(data_of([x])) for x in numbers]
    found = [function(*parts) for parts in zip(*words, strict=True)]
    like = numbers[0]
    return like._new(found[0]) if isinstance(like, Lane) else jax.tree.unflatten(jax.tree.structure(like), found)


def repeated(function, times, numbers):
    """The function of a tuple of numbers applied to its own result so many times, as a loop: to be compiled once."""
    if not all(map(_is_data, numbers)):
        return functools.reduce(lambda x, _: function(x), range(times), numbers)
    found = lax.scan(lambda x, _: (data_of(function(with_data(numbers, x))), None), data_of(numbers), length=times)[0]
    return tuple(with_data(numbers, found))


def each(operation, *lists) -> list:
    """[operation(a, b) for a, b of the lists]; of double words one operation on all of them, to be compiled once."""
    pairs = [x for numbers in lists for x in numbers if isinstance(x, DoubleWord)]
    if len(lists[0]) == 1 or not pairs:
        return [operation(*xs) for xs in zip(*lists, strict=True)]
    shape = np.broadcast_shapes(*(x.shape for x in pairs))
    found = noinline_pairs(operation)(*(_stacked(numbers, pairs[0], shape) for numbers in lists))
    return [found[i] for i in range(len(lists[0]))]


def _stacked(numbers, like, shape):
    pairs = (x if isinstance(x, DoubleWord) else constant(like, x) for x in numbers)
    return jax.tree.map(lambda *words: jnp.stack([jnp.broadcast_to(word, shape) for word in words]), *pairs)


def _is_double_word(x):
    return isinstance(x, DoubleWord)


# -- running a formula ------------------------------------------------------------------------------------------------


def numeric(formula) -> Any:
    """Makes of `formula(*vectors, **static)` a function of (precision, *arrays, **static).

    Arrays are (*batch, n), with batch shapes that broadcast; the formula gets each as a tuple of n numbers. It returns
    a number, a tuple of numbers (an array with a last axis), a mask, or a list of these.
    """
    program = functools.partial(_run, formula)
    compiled = jax.jit(program, static_argnums=(0, 1), inline=True)

    @functools.wraps(formula)
    def call(precision, *arrays, **static):
        arrays = components.alike(check.narrowed_each(arrays))
        known = any(isinstance(a, np.ndarray) for a in arrays)
        tracing = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(arrays))
        run = program if known and tracing else compiled
        return run(resolve(precision), tuple(sorted(static.items())), *arrays)

    return call


def _run(formula, precision, static, *arrays):
    batch = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    is_pair, is_apart = any(map(components.has_pairs, arrays)), any(isinstance(a, Components) for a in arrays)
    dtype = np.dtype(arrays[0].dtype)
    twice = is_pair or precision.sees_whole_sums
    with jax.enable_x64(bool(jax.config.jax_enable_x64) or twice):
        given = [of_array(a, precision, twice) for a in check.broadcast_batch(batch, *arrays)]
        found = formula(*given, **dict(static))
        round_ = functools.partial(rounded, batch, dtype, is_pair, is_apart)
        return [round_(x) for x in found] if isinstance(found, list) else round_(found)


def of_array(array, precision, twice, dtype=None):
    """The components of an array (*batch, n) as numbers to compute with, such as those of `dtype`, if not its own."""
    dtype = np.dtype(dtype or array.dtype)
    if isinstance(array, Components):
        return tuple(of_array(c[..., None], precision, twice)[0] for c in array.components)
    if twice and dtype == np.float64:
        array = array if array.dtype == dtype else array.astype(dtype)
        return tuple(to_double_word(array[..., i]) for i in range(array.shape[-1]))
    wide = np.dtype(np.float64 if twice else np.float32 if jnp.finfo(dtype).bits < 32 else dtype)
    precision = Precision.REPRODUCIBLE if twice else precision
    if isinstance(array, DoubleWord):
        parts = zip(*(lanes.unstack(word) for word in (array.hi, array.lo)), strict=True)
        return tuple(Lane(precision, _converted(hi, wide) + _converted(lo, wide)) for hi, lo in parts)
    return tuple(Lane(precision, _converted(x, wide)) for x in lanes.unstack(array))


def _converted(x, dtype):
    return x.astype(dtype) if lanes.is_known(x) else lax.convert_element_type(x, dtype)


def rounded(batch, dtype, is_pair, is_apart, x):
    """A result of the formula as an array, or double word, of the inputs' dtype."""
    if isinstance(x, tuple):
        parts = [rounded(batch, dtype, is_pair, False, c) for c in x]
        if is_apart:
            return components.of(parts)
        return jax.tree.map(lambda *words: lanes.stack(words, batch), *parts)
    if not isinstance(x, Number):
        return jnp.broadcast_to(x, batch)
    if isinstance(x, DoubleWord):
        return jax.tree.map(lambda word: jnp.broadcast_to(word, batch), x) if is_pair else _known_or_full(x.hi, batch)
    return _split(x.value, batch, dtype) if is_pair else _known_or_full(_converted(x.value, dtype), batch)


def _known_or_full(x, batch):
    """What is known stays so, for the array that it becomes a component of."""
    return x if lanes.is_known(x) else jnp.broadcast_to(x, batch)


def _split(x, batch, dtype):
    return to_double_word(jnp.broadcast_to(x, batch), dtype)
