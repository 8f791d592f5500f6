"""What keeps XLA from rewriting arithmetic: products contracted with sums, sums with constants rearranged."""

import jax
import numpy as np
from jax import Array, lax

from jaxspatial.arithmetic.check import finfo


def fence(x: Array) -> Array:
    """x, rounded where it stands: a product passed through is not fused with the addition that follows.

    XLA CPU contracts `a * b - c * d` always, and there is no operation to forbid it. A select stops it, under jit,
    vmap and scan; barriers, bitcasts, clamps and `reduce_precision` do not. NaN, infinities and -0 pass unchanged and
    the derivative is 1. Compared with the largest number, and not `x != x`, which a compiler may fold away.
    """
    largest = lax.full_like(x, finfo(x.dtype).max)
    return lax.select(lax.le(lax.abs(x), largest), x, lax.add(x, x))


def settled(x: Array) -> Array:
    """`fence`, in fewer operations, for the inside of primitives: not to be differentiated.

    It asks for a signalling NaN, which no operation returns, as the compiler does not know.
    """
    info = finfo(x.dtype)
    integer = np.dtype(f"uint{info.bits}")
    # All ones in the exponent, and a fraction whose first bit, that of a quiet NaN, is not set.
    exponent, quiet = ((1 << info.nexp) - 1) << info.nmant, 1 << (info.nmant - 1)
    never = integer.type(exponent | 0x5B5B5B5B5B5B5B5B % quiet)
    # Also in a program without 64-bit types, that a sum in float64 is a part of.
    with jax.enable_x64(True):
        bits = lax.bitcast_convert_type(x, integer)
        # As integers: told that there is no NaN (fast-math), a compiler would take x for the only choice.
        usual, nan = lax.ne(bits, lax.full_like(bits, never)), lax.full_like(bits, never | integer.type(quiet))
        return lax.bitcast_convert_type(lax.select(usual, bits, nan), x.dtype)


def kept(x: Array) -> Array:
    """x, a sum: for XLA's algebraic simplifier not a sum any more.

    It would make x + (c1 + c2) of `(x + c1) + c2`, and x of `(x + c) - c`, for constants c. A rounding to the format
    that x has already stops that, and is removed before any code is made of it: it costs nothing.
    """
    info = finfo(x.dtype)
    return lax.reduce_precision(x, exponent_bits=info.nexp, mantissa_bits=info.nmant)
