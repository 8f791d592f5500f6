"""The one construct that keeps XLA from contracting a product into a fused multiply-add."""

import jax.numpy as jnp
from jax import lax


def fence(x):
    """x, rounded where it stands: a product passed through is not fused with the addition that follows.

    XLA CPU contracts `a * b - c * d` always, and there is no operation to forbid it. A select stops it, under jit,
    vmap and scan; barriers, bitcasts, clamps and `reduce_precision` do not. NaN, infinities and -0 pass unchanged and
    the derivative is 1. Compared with the largest number, and not `x != x`, which a compiler may fold away.
    """
    largest = lax.full_like(x, jnp.finfo(x.dtype).max)
    return lax.select(lax.le(lax.abs(x), largest), x, lax.add(x, x))
