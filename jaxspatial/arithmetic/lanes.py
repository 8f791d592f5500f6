"""Components as lanes: a 3-vector is three separate arrays over the batch, or numbers known while tracing.

A component that is known to be 0 or 1 leaves no operation behind, so that a formula written once becomes the program of
exactly this scene. A known 0 is an exact zero, also next to an infinity or a NaN; a 0 that arrives as data behaves as
IEEE 754 says. No axis of length 3 is ever reduced, and no product of matrices reaches a BLAS.

In the precisions that look at whole sums the same functions run over symbols, see `polynomial`.
"""

import dataclasses
import operator

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import check, fast, reproducible
from jaxspatial.arithmetic.fence import kept
from jaxspatial.arithmetic.layout import apart
from jaxspatial.arithmetic.polynomial import Polynomial, Quotient, Symbol, uniform
from jaxspatial.arithmetic.precision import Precision
from jaxspatial.arithmetic.total import total

_PRODUCT = {Precision.FAST: fast.product, Precision.REPRODUCIBLE: reproducible.product}


class BatchApart(tuple):
    """The batch shape of a formula whose arrays are Apart."""


@dataclasses.dataclass(frozen=True, eq=False)
class Apart:
    """An array of a formula by its components, which are not stacked: what is known stays known in results too.

    All arrays of one formula are, or none; what is stacked over their batch shape is as well.
    """

    components: tuple
    batch: BatchApart

    @property
    def dtype(self):
        return self.components[0].dtype


def is_known(a, *values):
    """True for a number known while tracing, and, with values given, only if it is one of them."""
    return isinstance(a, np.generic) and (not values or a in values)


def is_symbolic(*components):
    """True for components of symbols."""
    return any(isinstance(c, (Polynomial, Quotient)) for c in components)


def unstack(x):
    """The components of x (*batch, n), each (*batch,); of a NumPy array, numbers where one is the same throughout."""
    if isinstance(x, (Symbol, Apart)):
        return x.components
    if isinstance(x, np.ndarray):
        return tuple(_number_if_uniform(x[..., i]) for i in range(x.shape[-1]))
    return tuple(apart(x))


def _number_if_uniform(column):
    number = uniform(column)
    return jnp.asarray(column) if number is None else number


def stack(components, batch_shape=()):
    """(*batch, n) of n components. Stacked along a leading axis: 2 to 3 times faster on XLA CPU than along the last."""
    if is_symbolic(*components):
        return Symbol(tuple(components))
    if isinstance(batch_shape, BatchApart):
        return Apart(tuple(components), batch_shape)
    if all(is_known(c) for c in components):
        return np.broadcast_to(np.stack(components), (*batch_shape, len(components)))
    full = [jnp.full(batch_shape, c) if is_known(c) else jnp.broadcast_to(c, batch_shape) for c in components]
    return jnp.moveaxis(jnp.stack(full), 0, -1)


def stack_like(x, components):
    """`stack`, in the layout of the array x (*batch, n), for a result that no addition ties to one.

    x is added as a -0 that the compiler cannot know: half the time on XLA CPU, see `_with_array`.
    """
    if is_symbolic(*components):
        return Symbol(tuple(components))
    stacked = stack(components, batch_shape(x))
    if isinstance(stacked, Apart):
        return stacked
    if not isinstance(stacked, jax.Array) or any(is_known(c) for c in components):
        return stacked
    x = lax.stop_gradient(jnp.asarray(x))
    never = lax.lt(lax.abs(x), lax.full_like(x, -1))
    return lax.select(never, x, lax.full_like(x, -0.0)) + stacked


def zero_like(x):
    """A known 0, as a component beside those of the array x."""
    return Polynomial() if isinstance(x, Symbol) else np.dtype(x.dtype).type(0)


def negate(a):
    return -a


def add(a, b, precision=None):
    if is_known(a, 0):
        return b
    return a if is_known(b, 0) else rounded_sum(*alike(a, b), precision)


def subtract(a, b, precision=None):
    if is_known(a, 0):
        return negate(b)
    return a if is_known(b, 0) else rounded_difference(*alike(a, b), precision)


def rounded_sum(a, b, precision=None):
    """fl(a + b), also next to another sum with constants."""
    return _rounded(operator.add, a, b, precision)


def rounded_difference(a, b, precision=None):
    """fl(a - b), also next to another sum with constants."""
    return _rounded(operator.sub, a, b, precision)


def _rounded(operation, a, b, precision):
    """In "fast", only next to what is known here: keeping every sum makes programs a quarter longer."""
    result = quietly(operation, a, b)
    is_free = precision is Precision.FAST and not (is_known(a) or is_known(b))
    return result if is_free or not isinstance(result, jax.Array) else kept(result)


def multiply(precision, a, b):
    if is_symbolic(a):
        return a * b
    for one, other in ((a, b), (b, a)):
        if is_known(one, 0):
            return one * one
        if is_known(one, 1, -1):
            return other if one == 1 else negate(other)
    if (is_known(a) and is_known(b)) or _is_pair(a, b):
        return quietly(operator.mul, a, b)
    return _PRODUCT[precision](*alike(a, b))


def halve(a):
    """a / 2, exactly but for underflow. Of a whole sum before it is rounded: what overflows twice as large is right."""
    return a.halved() if is_symbolic(a) else quietly(operator.mul, a, a.dtype.type(0.5))


def divide(a, b):
    """a / b for a number b known or not; rounded on its own in every precision."""
    if is_symbolic(a):
        return a / b
    if is_known(b, 1) or is_known(a, 0):
        return a
    if (is_known(a) and is_known(b)) or _is_pair(a, b):
        return quietly(operator.truediv, a, b)
    return reproducible.quotient(*alike(a, b))


def _is_pair(a, b):
    """True where one is a double word, which knows the operation itself."""
    return isinstance(a, check.Number) or isinstance(b, check.Number)


def quietly(operation, a, b):
    """The operation; on numbers known while tracing NumPy does it now, as silent about overflow and NaN as JAX is."""
    with np.errstate(all="ignore"):
        return operation(a, b)


def alike(a, b):
    """a and b over one shape; a known number beside an array made an array. Symbols have no shape."""
    if (is_known(a) and is_known(b)) or _is_pair(a, b) or is_symbolic(a, b):
        return a, b
    if is_known(a) or is_known(b):
        return (jnp.full_like(b, a), b) if is_known(a) else (a, jnp.full_like(a, b))
    if a.shape == b.shape:
        return a, b
    shape = np.broadcast_shapes(a.shape, b.shape)
    return jnp.broadcast_to(a, shape), jnp.broadcast_to(b, shape)


def cross(precision, a, b):
    """a x b. 9 flops; error <= 2 u mag per component, mag = |a_i b_j| + |a_j b_i|."""

    def difference(i, j):
        return subtract(multiply(precision, a[i], b[j]), multiply(precision, a[j], b[i]))

    return difference(1, 2), difference(2, 0), difference(0, 1)


def dot(precision, a, b):
    """a . b, summed from the left. 5 flops; error <= 3 u mag, mag = sum of |a_i b_i|."""
    x, y, z = (multiply(precision, p, q) for p, q in zip(a, b, strict=True))
    return add(add(x, y), z)


def plus(x, components):
    """x + components, for x (*batch, n)."""
    return _with_array(rounded_sum, add, x, components)


def minus(x, components):
    """x - components, for x (*batch, n)."""
    return _with_array(rounded_difference, subtract, x, components)


def _with_array(whole, each, x, components):
    """One addition of arrays where all components are data, else one per component that is not known to be 0.

    The addition of arrays ties the result to the layout of x. Where a transposed stack is itself a result of the
    program, XLA CPU writes it transposed and copies it in a second pass: 4 times slower, and donated memory unused.
    """
    if isinstance(x, Symbol):
        return Symbol(tuple(each(a, c) for a, c in zip(x.components, components, strict=True)))
    if isinstance(x, Apart):
        return Apart(tuple(each(a, c) for a, c in zip(x.components, components, strict=True)), x.batch)
    if isinstance(x, np.ndarray) or any(is_known(c) for c in components):
        return stack([each(a, c) for a, c in zip(unstack(x), components, strict=True)], _batch_shape(x, components))
    return whole(x, stack(components, x.shape[:-1]))


def summed(x):
    """The sum of x (*batch, n, k) over n: (*batch, k). Known zeros stay that."""
    if isinstance(x, Symbol):
        return Symbol(x.components, is_summed=True)
    if isinstance(x, Apart):
        return _summed_apart(x)
    if isinstance(x, np.ndarray) and not x.any():
        return np.zeros((*x.shape[:-2], x.shape[-1]), x.dtype)
    return jnp.moveaxis(total(jnp.moveaxis(x, -1, 0)), 0, -1)


def _summed_apart(x):
    """A known 0 stays known; of other numbers the sum is data, rounded as that of an array."""
    batch = BatchApart(x.batch[:-1])
    sums = (c if is_known(c, 0) else total(jnp.broadcast_to(c, x.batch)) for c in x.components)
    return Apart(tuple(sums), batch)


def batch_shape(x):
    """The batch shape of an array of the formula; a Symbol has none."""
    return x.batch if isinstance(x, Apart) else () if isinstance(x, Symbol) else x.shape[:-1]


def _batch_shape(x, components):
    return np.broadcast_shapes(x.shape[:-1], *(c.shape for c in components))
