"""Arithmetic on component arrays: a 3-vector is three arrays over the batch, or numbers known while tracing.

A component that is known to be 0 or 1 leaves no operation behind, so that a formula written once becomes the program of
exactly this scene. A known 0 is an exact zero, also next to an infinity or a NaN; a 0 that arrives as data behaves as
IEEE 754 says. No axis of length 3 is ever reduced, and no product of matrices reaches a BLAS.
"""

import contextlib
import operator
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.errorfree import reproducible
from jaxspatial.arithmetic.errorfree.barrier import kept
from jaxspatial.arithmetic.numbers.layout import apart
from jaxspatial.arithmetic.numbers.polynomial import uniform
from jaxspatial.arithmetic.precision import Precision

# In "fast" the compiler may contract a product with the addition that follows: error <= u |a b|, or none.
_PRODUCT = {Precision.FAST: lax.mul, Precision.REPRODUCIBLE: reproducible.product}


def is_known(a: Any, *values: float) -> bool:
    """True for a number known while tracing, and, with values given, only if it is one of them."""
    return isinstance(a, np.generic) and (not values or a in values)


@contextlib.contextmanager
def in_double():
    """Within, numbers that are known stay known, also while JAX traces a function around; in float64."""
    with jax.ensure_compile_time_eval(), jax.enable_x64(True):
        yield


# -- arrays apart and together ----------------------------------------------------------------------------------------


def unstack(x: Any) -> tuple[Any, ...]:
    """The components of x (*batch, n), each (*batch,); of a NumPy array, numbers where one is the same throughout."""
    if isinstance(x, check.NUMPY):
        return tuple(_number_if_uniform(x[..., i]) for i in range(x.shape[-1]))
    return tuple(apart(x))


def _number_if_uniform(column: np.ndarray) -> Any:
    number = uniform(column)
    return jnp.asarray(column) if number is None else number


def stack(components: Sequence[Any], batch_shape: tuple[int, ...] = ()) -> Any:
    """(*batch, n) of n components. Stacked along a leading axis: 2 to 3 times faster on XLA CPU than along the last."""
    if all(is_known(c) for c in components):
        return np.broadcast_to(np.stack(components), (*batch_shape, len(components)))
    full = [jnp.full(batch_shape, c) if is_known(c) else jnp.broadcast_to(c, batch_shape) for c in components]
    return jnp.moveaxis(jnp.stack(full), 0, -1)


def stack_like(x: Any, components: Sequence[Any]) -> Any:
    """`stack`, in the layout of the array x (*batch, n), for a result that no addition ties to one.

    x is added as a -0 that the compiler cannot know: half the time on XLA CPU, see `whole`.
    """
    stacked = stack(components, x.shape[:-1])
    if not isinstance(stacked, jax.Array) or any(is_known(c) for c in components):
        return stacked
    x = lax.stop_gradient(jnp.asarray(x))
    never = lax.lt(lax.abs(x), lax.full_like(x, -1))
    return lax.select(never, x, lax.full_like(x, -0.0)) + stacked


def whole(operation: Callable[..., Any], x: Any, others: Any, precision: Precision | None) -> Any:
    """x + others, or x - others, for x (*batch, n) and n components or an array: one operation on arrays where all is
    data, else one per component that is not known to be 0.

    The addition of arrays ties the result to the layout of x. Where a transposed stack is itself a result of the
    program, XLA CPU writes it transposed and copies it in a second pass: 4 times slower, and donated memory unused.
    """
    if isinstance(others, jax.Array) and isinstance(x, jax.Array):
        return _rounded(_OF_ARRAYS[operation], x, others, precision)
    others = others if isinstance(others, (check.LIST, check.TUPLE)) else unstack(others)
    if isinstance(x, check.NUMPY) or any(map(is_known, others)):
        each = [operation(a, c, precision) for a, c in zip(unstack(x), others, strict=True)]
        return stack(each, np.broadcast_shapes(x.shape[:-1], *(c.shape for c in others)))
    return _rounded(_OF_ARRAYS[operation], x, stack(others, x.shape[:-1]), precision)


# -- one operation ----------------------------------------------------------------------------------------------------


def add(a: Any, b: Any, precision: Precision | None = None) -> Any:
    if is_known(a, 0):
        return b
    return a if is_known(b, 0) else _rounded(operator.add, *alike(a, b), precision)


def subtract(a: Any, b: Any, precision: Precision | None = None) -> Any:
    if is_known(a, 0):
        return -b
    return a if is_known(b, 0) else _rounded(operator.sub, *alike(a, b), precision)


_OF_ARRAYS = {add: operator.add, subtract: operator.sub}


def _rounded(operation: Callable[..., Any], a: Any, b: Any, precision: Precision | None) -> Any:
    """fl(a + b) or fl(a - b), also next to another sum with constants.

    In "fast", only next to what is known here: keeping every sum makes programs a quarter longer.
    """
    result = quietly(operation, a, b)
    is_free = precision is Precision.FAST and not (is_known(a) or is_known(b))
    return result if is_free or not isinstance(result, jax.Array) else kept(result)


def multiply(precision: Precision, a: Any, b: Any) -> Any:
    for one, other in ((a, b), (b, a)):
        if is_known(one, 0):
            return one * one
        if is_known(one, 1, -1):
            return other if one == 1 else -other
    if (is_known(a) and is_known(b)) or _is_pair(a, b):
        return quietly(operator.mul, a, b)
    return _PRODUCT[precision](*alike(a, b))


def divide(a: Any, b: Any) -> Any:
    """a / b for a number b known or not; rounded on its own in every precision."""
    if is_known(b, 1) or is_known(a, 0):
        return a
    if (is_known(a) and is_known(b)) or _is_pair(a, b):
        return quietly(check.truediv, a, b)
    return reproducible.quotient(*alike(a, b))


def _is_pair(a: Any, b: Any) -> bool:
    """True where one is a double word, which knows the operation itself."""
    return isinstance(a, check.StandIn) or isinstance(b, check.StandIn)


def quietly(operation: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """The operation; on numbers known while tracing NumPy does it now, as silent about overflow and NaN as JAX is."""
    with np.errstate(all="ignore"):
        return operation(a, b)


def alike(a: Any, b: Any) -> tuple[Any, Any]:
    """a and b over one shape; a known number beside an array made an array."""
    if (is_known(a) and is_known(b)) or _is_pair(a, b):
        return a, b
    if is_known(a) or is_known(b):
        return (jnp.full_like(b, a), b) if is_known(a) else (a, jnp.full_like(a, b))
    if a.shape == b.shape:
        return a, b
    shape = np.broadcast_shapes(a.shape, b.shape)
    return jnp.broadcast_to(a, shape), jnp.broadcast_to(b, shape)
