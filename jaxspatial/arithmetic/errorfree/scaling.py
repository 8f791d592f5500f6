"""Scaling by powers of two: exact, so that intermediate results need neither overflow nor underflow."""

import functools
from collections.abc import Iterable

import jax
import jax.numpy as jnp
from jax import lax


def exponent(components: Iterable[jax.Array]) -> jax.Array:
    """e with 2^(e-1) <= max |component| < 2^e, and 0 for zeros, infinities and NaN; a constant to derivatives."""
    largest = functools.reduce(jnp.maximum, (lax.stop_gradient(jnp.abs(c)) for c in components))
    usable = jnp.isfinite(largest) & (largest > 0)
    # In float32, which has the range of bfloat16, or float64: frexp knows no 16-bit floats.
    wide = jnp.where(usable, largest, jnp.ones_like(largest)).astype(
        jnp.float64 if largest.dtype == jnp.float64 else jnp.float32
    )
    return jnp.where(usable, jnp.frexp(wide)[1], 0)


def reciprocal(components):
    """The power of two that brings the largest |component| to between 1/2 and 1, the very largest numbers to below 4; a
    constant to derivatives. For where nobody scales back: one multiplication, where `times_power_of_two` takes three.

    Straight from the bits, and right for no NaN, infinity or zero, which stay what they are.
    """
    largest = functools.reduce(jnp.maximum, (lax.stop_gradient(jnp.abs(c)) for c in components))
    info = jnp.finfo(largest.dtype)
    bits = lax.bitcast_convert_type(largest, jnp.dtype(f"uint{info.bits}"))
    shift, top, one = (lax.full_like(bits, n) for n in (info.nmant, 2 * info.maxexp - 3, 1))
    biased = lax.shift_right_logical(bits, shift)
    found = lax.select(biased < top, top - biased, one)
    return lax.bitcast_convert_type(lax.shift_left(found, shift), largest.dtype)


def times_power_of_two(x: jax.Array, e: jax.Array) -> jax.Array:
    """x 2^e, rounded once where it underflows. In three steps, because 2^e alone may lie outside of the format."""
    first, second = e // 3, (e - e // 3) // 2
    for part in (first, second, e - first - second):
        x = x * _power_of_two(part, x.dtype)
    return x


def _power_of_two(e, dtype):
    """2^e exactly, put together from its bits: XLA's exp2 is not exact at integers."""
    info = jnp.finfo(dtype)
    bits = (e + (info.maxexp - 1)).astype(f"uint{info.bits}")
    return lax.bitcast_convert_type(bits << lax.full_like(bits, info.nmant), dtype)
