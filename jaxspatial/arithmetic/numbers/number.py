"""What a formula asks of any number: constants, selections, scaling, and calls that the compiler leaves alone."""

import functools
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeGuard, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.arithmetic.errorfree import scaling
from jaxspatial.arithmetic.errorfree.primitives import not_inlined
from jaxspatial.arithmetic.numbers import folding
from jaxspatial.arithmetic.numbers.corrected import Corrected
from jaxspatial.arithmetic.numbers.double_word import DoubleWord
from jaxspatial.arithmetic.numbers.polynomial import Polynomial
from jaxspatial.arithmetic.numbers.protocol import Mask, Number, Numbers
from jaxspatial.arithmetic.numbers.rounded import Rounded

T = TypeVar("T")
PyTreeDef = Any  # of jax.tree_util, whose stub has a variable of this name
OfWords = Callable[[Array], Array] | Callable[[Array, Array], Array]
_KINDS: tuple[type[Number], ...] = (Rounded, Corrected, DoubleWord)


def constant(like: Any, number: Any) -> Any:
    """The number nearest to a Fraction or Python number, of the kind of another."""
    return like.constant(number)


def where(condition: Mask | bool, a: Number | float, b: Number | float) -> Number:
    """a where the condition holds, else b; one of them may be a Python number."""
    like: Any = a if is_number(a) else b
    first, second = (x if is_number(x) else constant(like, x) for x in (a, b))
    if isinstance(condition, (bool, np.bool_)):
        return first if condition else second
    return like.with_words(_selected(condition, *words) for words in zip(first.words, second.words, strict=True))


def _selected(condition: Array, a: Any, b: Any) -> Any:
    if folding.is_known(a, 0) and folding.is_known(b, 0):
        return a
    shape = np.broadcast_shapes(condition.shape, np.shape(a), np.shape(b))
    return lax.select(*(jnp.broadcast_to(jnp.asarray(x), shape) for x in (condition, a, b)))


def high(x: Number) -> jax.Array:
    """The number as one array, up to rounding: to decide upon."""
    return x.rounded()


def shape_of(x: Number) -> tuple[int, ...]:
    """That of the number as an array."""
    return np.shape(x.words[0])


def nearest_integer(x: Number) -> Number:
    """The integer nearest to the first word of x, of one word; a constant to derivatives."""
    value = x.words[0]
    if folding.is_known(value):
        return x.of_word(np.round(value))
    return x.of_word(lax.round(lax.stop_gradient(value), lax.RoundingMethod.TO_NEAREST_EVEN))


def frozen(x: Number) -> Number:
    """x, a constant to derivatives."""
    return x.with_words(word if folding.is_known(word) else lax.stop_gradient(word) for word in x.words)


def times_power_of_two(x: Number, e: Any) -> Number:
    """x 2^e for integers e (*batch,), exactly but for underflow."""
    return x.with_words(_word_times_power_of_two(word, e) for word in x.words)


def _word_times_power_of_two(word: Any, e: Any) -> Any:
    if folding.is_known(word) and isinstance(e, np.integer):
        return folding.quietly(np.ldexp, word, e)
    return word if folding.is_known(word, 0) else scaling.times_power_of_two(jnp.asarray(word), e)


def doubled(x: Number, times: int = 1) -> Number:
    """x 2^times, for a number of times known while tracing."""
    return x.with_words(folding.quietly(operator.mul, word, word.dtype.type(2.0**times)) for word in x.words)


def halved(x: Any) -> Any:
    """x / 2, exactly but for underflow. Of a whole sum before it is rounded: what overflows twice as large is right."""
    return x.halved() if isinstance(x, Polynomial) else doubled(x, -1)


def noinline_pairs(function: Callable[..., T]) -> Callable[..., T]:
    """A function of numbers of two words becomes a call that the compiler does not inline.

    Each of their operations is ten of the processor's; fused into one another they would be computed again for every
    use, and compile for minutes.
    """

    @functools.wraps(function)
    def call(*numbers: Any) -> Any:
        leaves = jax.tree.leaves(numbers, is_leaf=is_number)
        if any(isinstance(x, Corrected) for x in leaves):
            return noinline(function)(*numbers)
        if not any(isinstance(x, DoubleWord) for x in leaves):
            return function(*numbers)
        return not_inlined(function, *numbers)

    return call


def noinline(function: Callable[..., T]) -> Callable[..., T]:
    """A function of numbers becomes a call that the compiler does not inline.

    For what many entries of a result are made of: it would be computed again for each of them. What is known stays so
    on both sides of the call; arguments and results are trees of numbers, and of anything else that is known.
    """

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        leaves, tree = flattened(arguments)
        results: list[Any] = []

        def on_data(data: list[Any]) -> list[Any]:
            result = function(*jax.tree.unflatten(tree, with_data(leaves, data)))
            results.extend(flattened(result))
            return data_of(results[0])

        if not data_of(leaves):
            return function(*arguments)
        data = not_inlined(on_data, data_of(leaves))
        return jax.tree.unflatten(results[1], with_data(results[0], data))

    return call


def flattened(tree: Any) -> tuple[list[Any], PyTreeDef]:
    """(the numbers of a tree, its form)."""
    return cast(tuple[list[Any], PyTreeDef], jax.tree.flatten(tree, is_leaf=is_number))


def is_number(x: object) -> TypeGuard[Number]:
    """True for a number of any kind but a polynomial."""
    return isinstance(x, _KINDS)


def is_constant(x: object) -> TypeGuard[Rounded | Corrected]:
    """True for a number that is known while tracing."""
    return is_number(x) and folding.is_known(x.words[0])


def _words(leaf: Any) -> list[tuple[Any, bool]]:
    """(word, whether it is data) of a number, or of a mask or anything else."""
    if is_number(leaf):
        return [(word, not folding.is_known(word)) for word in leaf.words]
    return [(leaf, isinstance(leaf, jax.Array))]


def data_of(leaves: Iterable[Any]) -> list[Any]:
    """What of numbers and masks is not known while tracing: the arrays that they consist of."""
    return [word for x in leaves for word, is_data in _words(x) if is_data]


def with_data(leaves: Iterable[Any], data: Iterable[Any]) -> list[Any]:
    """The leaves, with other data for that which `data_of` finds."""
    rest, found = iter(data), list[Any]()
    for x in leaves:
        words = [next(rest) if is_data else word for word, is_data in _words(x)]
        found.append(x.with_words(words) if is_number(x) else words[0])
    return found


def as_data(x: Number, shape: tuple[int, ...] | None = None) -> Number:
    """A number of which words are known as one of which none is: a loop has the same of these at every turn.

    shape: over which, if not over its own.
    """
    shape = shape_of(x) if shape is None else shape
    return x.with_words(
        jnp.full(shape, word) if folding.is_known(word) else jnp.broadcast_to(word, shape) for word in x.words
    )


def mapped(function: OfWords, *numbers: Number) -> Number:
    """A function of arrays, applied to numbers that are data, word by word; what is known of all to be 0 stays so."""
    words = list(zip(*(x.words for x in numbers), strict=True))
    known = [all(folding.is_known(word, 0) for word in same) for same in words]
    words = zip(*(x.words if all(known[1:]) else as_data(x).words for x in numbers), strict=True)
    return numbers[0].with_words(w[0] if k else function(*w) for w, k in zip(words, known, strict=True))


def repeated(function: Callable[[Numbers], Numbers], times: int, numbers: Numbers) -> Numbers:
    """The function of a tuple of numbers applied to its own result so many times, as a loop: to be compiled once."""
    if any(map(is_constant, numbers)):
        return functools.reduce(lambda x, _: function(x), range(times), numbers)
    numbers = [as_data(x) for x in numbers]

    def turn(data: list[Any], _: None):
        found = function(with_data(numbers, data))
        return data_of(as_data(x, shape_of(like)) for x, like in zip(found, numbers, strict=True)), None

    return tuple(with_data(numbers, lax.scan(turn, data_of(numbers), length=times)[0]))


def each(operation: Callable[..., Number], *lists: Sequence[Any]) -> list[Number]:
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
