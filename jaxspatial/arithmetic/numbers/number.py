"""What a formula asks of any number: constants, selections, scaling, and calls that the compiler leaves alone."""

import functools
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any, TypeGuard, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.experimental.xla_metadata import set_xla_metadata

from jaxspatial.arithmetic.errorfree import scaling
from jaxspatial.arithmetic.numbers import folding
from jaxspatial.arithmetic.numbers.double_word import DoubleWord, nearest_double_word
from jaxspatial.arithmetic.numbers.polynomial import Polynomial
from jaxspatial.arithmetic.numbers.protocol import Mask, Number, Numbers
from jaxspatial.arithmetic.numbers.rounded import Rounded
from jaxspatial.arithmetic.numbers.trees import to_double_word

T = TypeVar("T")
_KINDS: tuple[type[Number], ...] = (Rounded, DoubleWord)


def constant(like: Number, number: float | Fraction) -> Number:
    """The number nearest to a Fraction or Python number, of the kind of another."""
    if isinstance(like, Polynomial):
        return like.constant(number)
    if isinstance(like, DoubleWord):
        return nearest_double_word(number, like.dtype)
    return Rounded(like.precision, like.dtype.type(float(number)))


def where(condition: Mask | bool, a: Number | float, b: Number | float) -> Number:
    """a where the condition holds, else b; one of them may be a Python number."""
    like = a if is_number(a) else b
    a, b = (x if is_number(x) else constant(like, x) for x in (a, b))
    if isinstance(condition, (bool, np.bool_)):
        return a if condition else b
    if isinstance(like, DoubleWord):
        return jax.tree.map(functools.partial(_selected, condition), a, b)
    return Rounded(like.precision, _selected(condition, a.value, b.value))


def _selected(condition: Array, a: Any, b: Any) -> Array:
    shape = np.broadcast_shapes(condition.shape, np.shape(a), np.shape(b))
    return lax.select(*(jnp.broadcast_to(jnp.asarray(x), shape) for x in (condition, a, b)))


def high(x: Number) -> jax.Array:
    """The number as one array, up to rounding: to decide upon."""
    return x.hi if isinstance(x, DoubleWord) else x.value


def nearest_integer(x: Number) -> Number:
    """The integer nearest to x, of one word; a constant to derivatives."""
    value = high(x)
    if folding.is_known(value) and isinstance(x, Rounded):
        return Rounded(x.precision, np.round(value))
    rounded = lax.round(lax.stop_gradient(value), lax.RoundingMethod.TO_NEAREST_EVEN)
    return to_double_word(rounded) if isinstance(x, DoubleWord) else Rounded(x.precision, rounded)


def frozen(x: Number) -> Number:
    """x, a constant to derivatives."""
    if isinstance(x, DoubleWord):
        return jax.tree.map(lax.stop_gradient, x)
    return Rounded(x.precision, x.value if folding.is_known(x.value) else lax.stop_gradient(x.value))


def times_power_of_two(x: Number, e: Any) -> Number:
    """x 2^e for integers e (*batch,), exactly but for underflow."""
    if isinstance(x, DoubleWord):
        return jax.tree.map(lambda word: scaling.times_power_of_two(word, e), x)
    if folding.is_known(x.value) and isinstance(e, np.integer):
        return Rounded(x.precision, folding.quietly(np.ldexp, x.value, e))
    return (
        x if folding.is_known(x.value, 0) else Rounded(x.precision, scaling.times_power_of_two(jnp.asarray(x.value), e))
    )


def doubled(x: Number, times: int = 1) -> Number:
    """x 2^times, for a number of times known while tracing."""
    if isinstance(x, DoubleWord):
        return jax.tree.map(lambda word: word * word.dtype.type(2.0**times), x)
    return x * 2.0**times


def halved(x: Number) -> Number:
    """x / 2, exactly but for underflow. Of a whole sum before it is rounded: what overflows twice as large is right."""
    if isinstance(x, Rounded):
        return x._new(folding.halve(x.value))
    return x.halved() if isinstance(x, Polynomial) else doubled(x, -1)


def noinline_pairs(function: Callable[..., T]) -> Callable[..., T]:
    """A function of numbers that are double words becomes a call that the compiler does not inline.

    Each of their operations is ten of the processor's; fused into one another they would be computed again for every
    use, and compile for minutes.
    """

    @functools.wraps(function)
    def call(*numbers: Any) -> Any:
        if not any(isinstance(x, DoubleWord) for x in jax.tree.leaves(numbers, is_leaf=_is_double_word)):
            return function(*numbers)
        with set_xla_metadata(inlineable="false"):
            return jax.jit(function)(*numbers)

    return call


def noinline(function: Callable[..., T]) -> Callable[..., T]:
    """A function of numbers becomes a call that the compiler does not inline.

    For what many entries of a result are made of: it would be computed again for each of them. What is known stays so
    on both sides of the call; arguments and results are trees of numbers, and of anything else that is known.
    """

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        leaves, tree = jax.tree.flatten(arguments, is_leaf=is_number)
        results = []

        def on_data(data: list[Any]) -> list[Any]:
            result = function(*jax.tree.unflatten(tree, with_data(leaves, data)))
            results.extend(jax.tree.flatten(result, is_leaf=is_number))
            return data_of(results[0])

        if not any(map(_is_data, leaves)):
            return function(*arguments)
        with set_xla_metadata(inlineable="false"):
            data = jax.jit(on_data)(data_of(leaves))
        return jax.tree.unflatten(results[1], with_data(results[0], data))

    return call


def is_number(x: object) -> TypeGuard[Number]:
    """True for a rounded number or a double word."""
    return isinstance(x, _KINDS)


def _is_data(x: Any) -> bool:
    return not folding.is_known(x.value) if isinstance(x, Rounded) else isinstance(x, (jax.Array, DoubleWord))


def data_of(leaves: Iterable[Any]) -> list[Any]:
    """What of numbers and masks is not known while tracing: the arrays of rounded numbers, and double words."""
    return [x.value if isinstance(x, Rounded) else x for x in leaves if _is_data(x)]


def with_data(leaves: Iterable[Any], data: Iterable[Any]) -> list[Any]:
    """The leaves, with other data for that which `data_of` finds."""
    data = iter(data)
    return [x if not _is_data(x) else x._new(next(data)) if isinstance(x, Rounded) else next(data) for x in leaves]


def as_data(x: Number) -> Number:
    """A number that is known as one that is not: a loop has the same of these at every turn."""
    return x._new(jnp.asarray(x.value)) if isinstance(x, Rounded) and folding.is_known(x.value) else x


def mapped(function: Callable[..., jax.Array], *numbers: Number) -> Number:
    """A function of arrays, applied to numbers that are data, word by word."""
    words = [jax.tree.leaves(data_of([x])) for x in numbers]
    found = [function(*parts) for parts in zip(*words, strict=True)]
    like = numbers[0]
    return like._new(found[0]) if isinstance(like, Rounded) else jax.tree.unflatten(jax.tree.structure(like), found)


def repeated(function: Callable[[Numbers], Numbers], times: int, numbers: Numbers) -> Numbers:
    """The function of a tuple of numbers applied to its own result so many times, as a loop: to be compiled once."""
    if not all(map(_is_data, numbers)):
        return functools.reduce(lambda x, _: function(x), range(times), numbers)
    found = lax.scan(lambda x, _: (data_of(function(with_data(numbers, x))), None), data_of(numbers), length=times)[0]
    return tuple(with_data(numbers, found))


def each(operation: Callable[..., Number], *lists: Numbers) -> list[Number]:
    """[operation(a, b) for a, b of the lists]; of double words one operation on all of them, to be compiled once."""
    pairs = [x for numbers in lists for x in numbers if isinstance(x, DoubleWord)]
    if len(lists[0]) == 1 or not pairs:
        return [operation(*xs) for xs in zip(*lists, strict=True)]
    shape = np.broadcast_shapes(*(x.shape for x in pairs))
    found: Any = noinline_pairs(operation)(*(_abreast(numbers, pairs[0], shape) for numbers in lists))
    return [found[i] for i in range(len(lists[0]))]


def _abreast(numbers: Any, like: Number, shape: tuple[int, ...]) -> Any:
    pairs = (x if isinstance(x, DoubleWord) else constant(like, x) for x in numbers)
    return jax.tree.map(lambda *words: jnp.stack([jnp.broadcast_to(word, shape) for word in words]), *pairs)


def _is_double_word(x: Any) -> bool:
    return isinstance(x, DoubleWord)
