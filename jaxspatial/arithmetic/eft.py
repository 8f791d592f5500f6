"""Error-free transforms: a sum or a product as a pair (rounded result, its exact error).

They hold eager, jit, vmap and scan, also where only the error is used, with and without fused multiply-add. What they
cannot survive is `--xla_cpu_enable_fast_math`, and the flushing of subnormals: a product's error below the smallest
normal number is lost.
"""

import jax.numpy as jnp
from jax import lax

from jaxspatial.arithmetic.fence import fence


def two_sum(a, b):
    """(s, e) with s = fl(a + b) and s + e = a + b exactly. 6 flops. [Knuth, TAOCP 2, 4.2.2, theorem B]

    *unchecked* requirement: a is not a constant of the program; XLA rewrites `(c + x) - c` to x. Put constants second.
    """
    s = a + b
    b_part = s - a
    return s, (a - (s - b_part)) + (b - b_part)


def fast_two_sum(a, b):
    """(s, e) as `two_sum`, in 3 flops. [Dekker 1971]  *unchecked* requirement: |a| >= |b| or a == 0."""
    s = a + b
    return s, b - (s - a)


def split(x):
    """(hi, lo) with hi + lo = x exactly, each of at most half the bits, so that products of halves are exact.

    Rounded by `reduce_precision`, which unlike Veltkamp's multiplication does not overflow for large x, and unlike a
    bit mask can be transposed. *unchecked* requirement: |x| <= (1 - 2^-4) finfo.max (hi would round to infinity).
    """
    info = jnp.finfo(x.dtype)
    hi = lax.reduce_precision(x, exponent_bits=info.nexp, mantissa_bits=(info.nmant + 1) // 2 - 1)
    return hi, x - hi


def two_product(a, b):
    """(p, e) with p = fl(a * b) and p + e = a * b exactly, while e is a normal number or 0. [Dekker 1971]

    The error is spelled with `ah * bh - p`, never with `p - ah * bh`: the compiler contracts the latter with the
    product p when p itself is not used. p is fenced for the same reason.
    """
    p = fence(a * b)
    a_hi, a_lo = split(a)
    b_hi, b_lo = split(b)
    e = ((a_hi * b_hi - p) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo
    return p, jnp.where(jnp.isfinite(p), e, jnp.zeros_like(e))
