"""The fast precision: products and sums as the compiler likes them."""

from jax import Array, lax


def product(a: Array, b: Array) -> Array:
    """a * b, which the compiler may contract with the addition that follows: error <= u |a b|, or none."""
    return lax.mul(a, b)
