"""Error-free transforms: a sum or a product as a pair (rounded result, its exact error).

They hold eager, jit, vmap and scan, also where only the error is used or an operand is a constant of the program, with
and without fused multiply-add. Operands are numbers of the library's own: those of a caller go through
`barrier_or_nan` first, which gives NaN where the compiler may rearrange sums (`xla_cpu_enable_fast_math`). An error
below the smallest normal number is lost where subnormals are flushed.
"""

import math
from collections.abc import Callable, Sequence

import jax
from jax import Array, lax

from jaxspatial.numerics.errorfree.barrier import bits_of, no_reassociation, opaque, product_tangent
from jaxspatial.numerics.errorfree.primitives import elementwise, no_tangent, rule, same_sharding
from jaxspatial.numerics.floats import finfo

Guard = Callable[[Array], Array]


def two_sum(a: Array, b: Array, guard: Guard = no_reassociation) -> tuple[Array, Array]:
    """(s, e) with s = fl(a + b) and s + e = a + b exactly. 6 flops. [Knuth, TAOCP 2, 4.2.2, theorem B]

    guard: keeps the compiler from looking into s; without it `(x + c) - c` becomes x, and `(x + c1) + c2` becomes
    x + (c1 + c2), for constants c. `unguarded` where neither operand can be one.
    """
    s = guard(a + b)
    b_part = s - a
    return s, (a - (s - b_part)) + (b - b_part)


def two_difference(a: Array, b: Array, guard: Guard = no_reassociation) -> tuple[Array, Array]:
    """(s, e) with s = fl(a - b) and s + e = a - b exactly: `two_sum` of a and -b."""
    s = guard(a - b)
    b_part = s - a
    return s, (a - (s - b_part)) - (b + b_part)


def fast_two_sum(a: Array, b: Array, guard: Guard = no_reassociation) -> tuple[Array, Array]:
    """(s, e) as `two_sum`, in 3 flops. [Dekker 1971]  *unchecked* requirement: |a| >= |b| or a == 0."""
    s = guard(a + b)
    return s, b - (s - a)


def unguarded(x: Array) -> Array:
    """x: the guard that guards nothing."""
    return x


def split(x: Array) -> tuple[Array, Array]:
    """(hi, lo) with hi + lo = x exactly, each of at most half the bits, so that products of halves are exact.

    Rounded in its bits, half away from zero: unlike Veltkamp's multiplication this does not overflow for large x, and
    it is several times faster than `reduce_precision`. Next to the largest number, where hi would be rounded to an
    infinity, it is cut off: lo has one bit more then, and products with the halves of a number that is not so large
    are exact. Below tiny / eps, where lo would be flushed to zero and a product lose half of its digits, hi is x:
    products are then rounded, and good to 3 u.
    """
    info = finfo(x.dtype)
    cleared = info.nmant + 1 - (info.nmant + 1) // 2
    bits = bits_of(x)
    half, mask = (bits.dtype.type(n) for n in (1 << (cleared - 1), (1 << info.bits) - (1 << cleared)))
    size = lax.abs(x)
    # The smallest number whose upper half, rounded, is the power of two that the format does not hold.
    n = (info.nmant + 1) // 2
    limit = math.ldexp(1 - 2.0 ** -(n + 1), info.maxexp) if info.maxexp < 1024 else (2 - 2.0**-n) * 2.0**1023
    is_usual = lax.lt(size, lax.full_like(x, limit))
    added = lax.select(is_usual, lax.full_like(bits, half), lax.full_like(bits, 0))
    rounded = (bits + added) & lax.full_like(bits, mask)
    has_low_half = lax.ge(size, lax.full_like(x, info.tiny / info.eps))
    hi = lax.select(has_low_half, lax.bitcast_convert_type(rounded, x.dtype), x)
    return hi, x - hi


def two_product(a: Array, b: Array) -> tuple[Array, Array]:
    """(p, e) with p = fl(a * b) and p + e = a * b exactly, while e is a normal number or 0.

    Where p is infinite or NaN, e means nothing. Below tiny / eps see `split`.
    """
    return tuple(_two_product_p.bind(*same_sharding(a, b)))


def product_error(a: Array, b: Array, p: Array) -> Array:
    """a * b - p exactly, of p = fl(a * b) that is `opaque`, while that is a normal number or 0. [Dekker 1971]

    Each step is exact, as an fma or not: the error does not depend on what a compiler makes of it. Spelled with
    `ah * bh - p`, never with `p - ah * bh`: of the latter and the product p the compiler makes an fma when p itself is
    not used. p is opaque for the same reason.

    Where there is a fused multiply-add, `opaque(a) * b - p` would be the error in two operations, if the compiler made
    one of them. It need not: it vectorises both products together, or finds the second one elsewhere in the program.
    """
    a_hi, a_lo = split(a)
    b_hi, b_lo = split(b)
    # Kept after each step: of constants it would make `(c1 - p) + c2` to (c1 + c2) - p.
    e = no_reassociation(no_reassociation(no_reassociation(a_hi * b_hi - p) + a_hi * b_lo) + a_lo * b_hi)
    return no_reassociation(e + a_lo * b_lo)


def _two_product(a: Array, b: Array) -> list[Array]:
    # Also in a program without 64-bit types, which it is lowered as a part of: see `no_fma`.
    with jax.enable_x64(True):
        p = opaque(a * b)
        return [p, product_error(a, b, p)]


def _two_product_jvp(primals: Sequence[Array], tangents: Sequence) -> tuple[list[Array], list]:
    """The derivatives of a b are those of p: the error has none of its own."""
    p, e = _two_product_p.bind(*primals)
    return [p, e], [product_tangent(p, primals, tangents), no_tangent(e)]


_two_product_p = elementwise("two_product", lax.mul_p, rule(_two_product), _two_product_jvp, n_results=2)
