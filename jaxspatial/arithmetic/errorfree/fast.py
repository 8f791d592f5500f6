"""The fast precision: products and sums as the compiler likes them."""

from jax import lax


def product(a, b):
    """a * b, which the compiler may contract with the addition that follows: error <= u |a b|, or none."""
    return lax.mul(a, b)
