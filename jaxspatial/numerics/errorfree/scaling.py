"""Scaling by powers of two: exact, so that intermediate results need neither overflow nor underflow."""

import functools
from collections.abc import Iterable

import jax
import jax.numpy as jnp
from jax import Array, lax

from jaxspatial.numerics.errorfree.barrier import bits_of
from jaxspatial.numerics.floats import finfo


def exponent(components: Iterable[jax.Array]) -> jax.Array:
    """e with 2^(e-1) <= max |component| < 2^e, and 0 for zeros, infinities and NaN; a constant to derivatives.

    Subnormal numbers, where they are not flushed, are given the e of the largest of them. Not by `jnp.frexp`: JAX 0.12
    expands that when it lowers a program, where 64-bit types that were on for a while are off again.
    """
    # float32 has the range of bfloat16, and no float16 is subnormal in it.
    largest = _largest(components)
    largest = largest if largest.dtype == jnp.float64 else largest.astype(jnp.float32)
    e = _biased_exponent(largest).astype(jnp.int32) - (finfo(largest.dtype).maxexp - 2)
    return jnp.where((largest > 0) & jnp.isfinite(largest), e, 0)


def reciprocal(components: Iterable[Array]) -> Array:
    """The power of two that brings the largest |component| to between 1/2 and 1, the very largest numbers to below 4; a
    constant to derivatives. For where nobody scales back: one multiplication, where `times_power_of_two` takes three.

    Right for no NaN, infinity or zero, which stay what they are.
    """
    largest = _largest(components)
    biased, info = _biased_exponent(largest), finfo(largest.dtype)
    shift, top, one = (lax.full_like(biased, n) for n in (info.nmant, 2 * info.maxexp - 3, 1))
    result = lax.select(biased < top, top - biased, one)
    return lax.bitcast_convert_type(lax.shift_left(result, shift), largest.dtype)


def _largest(components: Iterable[jax.Array]) -> jax.Array:
    return functools.reduce(jnp.maximum, (lax.stop_gradient(jnp.abs(c)) for c in components))


def _biased_exponent(x: jax.Array) -> jax.Array:
    """Of a number that is not negative, straight from its bits."""
    bits = bits_of(x)
    return lax.shift_right_logical(bits, lax.full_like(bits, finfo(x.dtype).nmant))


def times_power_of_two(x: jax.Array, e: jax.Array) -> jax.Array:
    """x 2^e, rounded once where it underflows. In three steps, because 2^e alone may lie outside of the format."""
    first, second = e // 3, (e - e // 3) // 2
    info = finfo(x.dtype)
    for part in (first, second, e - first - second):
        # 2^part, put together from its bits: XLA's exp2 is not exact at integers.
        bits = (part + (info.maxexp - 1)).astype(f"uint{info.bits}")
        x = x * lax.bitcast_convert_type(bits << lax.full_like(bits, info.nmant), x.dtype)
    return x
