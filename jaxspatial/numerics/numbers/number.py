"""What a formula may do with any number: constants, selections, scaling, and calls that are not inlined."""

import functools
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeGuard, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree import scaling
from jaxspatial.numerics.errorfree.primitives import choice, not_inlined
from jaxspatial.numerics.jax_internals import jaxpr_as_fun
from jaxspatial.numerics.numbers.corrected import Corrected
from jaxspatial.numerics.numbers.double_word import DoubleWord
from jaxspatial.numerics.numbers.polynomial import Polynomial
from jaxspatial.numerics.numbers.rounded import Number as Number
from jaxspatial.numerics.numbers.rounded import Rounded, is_known, quietly

Numbers = Sequence[Number]
Mask = jax.Array  # (*batch,): what comparisons answer

T = TypeVar("T")
N = TypeVar("N", bound=Number)


def constant(like: N, number) -> N:
    """The number nearest to a Fraction or Python number, of the kind of another."""
    return like._constant(number)


def where(condition: Mask | bool, a: Number | float, b: Number | float) -> Number:
    """a where the condition holds, else b; one of them may be a Python number."""
    like: Any = a if is_number(a) else b
    first, second = a if is_number(a) else constant(like, a), b if is_number(b) else constant(like, b)
    if isinstance(condition, (bool, np.bool_)):
        return first if condition else second
    limbs: list = []
    for x, y in zip(first.limbs, second.limbs, strict=True):
        shape = floats.broadcast_shapes(condition.shape, np.shape(x), np.shape(y))
        are_zero = is_known(x, 0) and is_known(y, 0)
        limbs.append(x if are_zero else lax.select(*(_over(z, shape) for z in (condition, x, y))))
    return like.with_limbs(limbs)


def _over(x, shape: tuple[int, ...]) -> Array:
    if is_known(x) and not np.isfinite(x):
        return choice(x, shape, x.dtype)
    if isinstance(x, Array) and x.shape == shape:
        return x
    return lax.broadcast_in_dim(x, shape, ()) if is_known(x) and shape else jnp.broadcast_to(jnp.asarray(x), shape)


def high(x: Number) -> jax.Array:
    """The number as one array, up to rounding: to decide upon."""
    return x._rounded()


def shape_of(x: Number) -> tuple[int, ...]:
    """That of the number as an array."""
    return np.shape(x.limbs[0])


def nearest_integer(x: Number) -> Number:
    """The integer nearest to the leading limb of x, of one limb; a constant to derivatives."""
    value = x.limbs[0]
    if is_known(value):
        return x._of_limb(np.round(value))
    return x._of_limb(lax.round(lax.stop_gradient(value), lax.RoundingMethod.TO_NEAREST_EVEN))


def frozen(x: Number) -> Number:
    """x, a constant to derivatives."""
    return x.with_limbs(limb if is_known(limb) else lax.stop_gradient(limb) for limb in x.limbs)


def times_power_of_two(x: Number, e) -> Number:
    """x 2^e for integers e (*batch,), exactly but for underflow."""

    if is_constant(x) and isinstance(e, np.integer):
        return x.with_limbs(quietly(np.ldexp, limb, e) for limb in x.limbs)
    return x.with_limbs(
        limb if is_known(limb, 0) else scaling.times_power_of_two(jnp.asarray(limb), e) for limb in x.limbs
    )


def doubled(x: Number, times: int = 1) -> Number:
    """x 2^times, for a number of times known while tracing."""
    return x.with_limbs(quietly(operator.mul, limb, limb.dtype.type(2.0**times)) for limb in x.limbs)


def halved(x) -> Any:
    """x / 2, exactly but for underflow. Of a whole sum before it is rounded: what overflows twice as large is right."""
    return x.halved() if isinstance(x, Polynomial) else doubled(x, -1)


def noinline_pairs(function: Callable[..., T]) -> Callable[..., T]:
    """A function of numbers of two limbs becomes a call that the compiler does not inline.

    Each of their operations is ten of the processor's; fused into one another they would be computed again for every
    use, and compile for minutes.
    """
    call = noinline(function)

    @functools.wraps(function)
    def chosen(*numbers):
        kinds = set(map(type, jax.tree.leaves(numbers, is_leaf=is_number)))
        if Corrected in kinds:
            return call(*numbers)
        return not_inlined(function, *numbers) if DoubleWord in kinds else function(*numbers)

    return chosen


def noinline(function: Callable[..., T]) -> Callable[..., T]:
    """A function of trees of numbers becomes a call that the compiler does not inline.

    For what many entries of a result are made of: it would be computed again for each of them. What is known while
    tracing stays so on both sides of the call.
    """

    @functools.wraps(function)
    def wrapped(*arguments):
        data = data_of(arguments)
        if not data:
            return function(*arguments)
        on_data, whole = _on_data(function, arguments)
        return whole(not_inlined(on_data, data))

    return wrapped


def where_any(mask: Mask, function: Callable[..., T], *arguments) -> T:
    """The function of trees of numbers (n, B) in states in which the mask (m, B) has any true; zeros in others.

    Where no state has any, nothing is computed: in machine code of our own that is asked for a few states at a time.
    """
    data, is_any = data_of(arguments), mask.any(0, keepdims=True)
    on_data, whole = _on_data(function, arguments)

    def chosen(*data: jax.Array) -> list[jax.Array]:
        return [jnp.where(jnp.broadcast_to(is_any, x.shape), x, jnp.zeros_like(x)) for x in on_data(data)]

    closed = jax.make_jaxpr(chosen)(*data)
    zeros = [(x.shape, x.dtype) for x in closed.out_avals]
    return whole(lax.cond(is_any.any(), jaxpr_as_fun(closed), lambda *_: [jnp.zeros(*x) for x in zeros], *data))


def _on_data(
    function: Callable[..., T], arguments: Sequence
) -> tuple[Callable[..., list[jax.Array]], Callable[..., T]]:
    """(the function from arrays among its arguments to arrays; what makes its result of these, after a call of it)."""
    given, found = without_data(arguments), list[T]()

    def on_data(data: Sequence[jax.Array]) -> list[jax.Array]:
        result = function(*with_data(given, data))
        found[:] = [without_data(result)]
        return data_of(result)

    return on_data, lambda data: with_data(found[0], data)


def is_number(x: object) -> TypeGuard[Number]:
    """True for a number of any kind but a polynomial."""
    return isinstance(x, Number)


def is_constant(x: object) -> TypeGuard[Rounded | Corrected]:
    """True for a number that is known while tracing."""
    return isinstance(x, Number) and isinstance(x.limbs[0], np.generic)


def data_of(tree) -> list[jax.Array]:
    """The arrays of a tree of numbers: what of it is not known while tracing."""
    return [x for x in jax.tree.leaves(tree) if isinstance(x, jax.Array)]


_DATA: Any = object()


def without_data(tree: T) -> T:
    """The tree with marks in place of the data: what a function may keep that JAX traces, and outlive the trace."""
    return jax.tree.map(lambda x: _DATA if isinstance(x, jax.Array) else x, tree)


def with_data(tree: T, data: Iterable) -> T:
    """The tree, with other data in place of that which `data_of` finds, or of its marks."""
    leaves, structure = jax.tree.flatten(tree)
    rest = iter(data)
    is_data = [x is _DATA or isinstance(x, jax.Array) for x in leaves]
    return jax.tree.unflatten(structure, [next(rest) if yes else x for x, yes in zip(leaves, is_data, strict=True)])


def as_data(x: Number, shape: tuple[int, ...] | None = None) -> Number:
    """The number without limbs that are known while tracing: a loop has the same of these in every pass.

    shape: over which, if not over its own.
    """
    shape = shape_of(x) if shape is None else shape
    return x.with_limbs([jnp.full(shape, y) if is_known(y) else jnp.broadcast_to(y, shape) for y in x.limbs])


def mapped(function: Callable[..., Array], *numbers: Number) -> Number:
    """A function of arrays, applied to numbers that are data, limb by limb; what is known of all to be 0 stays so."""
    limbs = list(zip(*[x.limbs for x in numbers], strict=True))
    known = [all([isinstance(y, np.generic) and y == 0 for y in same]) for same in limbs]
    if not all(known[1:]):
        limbs = zip(*[as_data(x).limbs for x in numbers], strict=True)
    return numbers[0].with_limbs([y[0] if k else function(*y) for y, k in zip(limbs, known, strict=True)])


def repeated(function: Callable[[Numbers], Numbers], times: int, numbers: Numbers) -> Numbers:
    """The function of a tuple of numbers applied to its own result so many times, as a loop: to be compiled once."""
    if any(map(is_constant, numbers)):
        return functools.reduce(lambda x, _: function(x), range(times), numbers)
    numbers = tuple(as_data(x) for x in numbers)

    def step(data: list, _: None):
        result = function(with_data(numbers, data))
        return data_of([as_data(x, shape_of(like)) for x, like in zip(result, numbers, strict=True)]), None

    return with_data(numbers, lax.scan(step, data_of(numbers), length=times)[0])
