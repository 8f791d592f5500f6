"""Vectors that are hard on arithmetic, in families; none over- or underflows in a product of three."""

import jax.numpy as jnp
import numpy as np


def benign(rng, count, n, dtype):
    """count arrays (n, 3) of normally distributed numbers."""
    return _rounded(rng.standard_normal((count, n, 3)), dtype)


def mixed_scales(rng, count, n, dtype):
    """Components whose sizes differ by up to the fourth root of the range of the format."""
    exponents = _spread(dtype)
    return _rounded(
        rng.standard_normal((count, n, 3)) * 2.0 ** rng.integers(-exponents, exponents, (count, n, 3)), dtype
    )


def parallel(rng, count, n, dtype):
    """Multiples of one direction by powers of two: their cross products are exactly 0."""
    direction = _rounded(rng.standard_normal((1, n, 3)), dtype)[0]
    return [direction * np.asarray(2.0 ** rng.integers(-2, 3, (n, 1)), dtype) for _ in range(count)]


def nearly_parallel(rng, count, n, dtype):
    """As `parallel`, but for a few units in the last place."""
    eps = float(jnp.finfo(dtype).eps)
    wide = (x.astype(np.float64) for x in parallel(rng, count, n, dtype))
    return [(x * (1 + 4 * eps * rng.standard_normal((n, 3)))).astype(dtype) for x in wide]


def just_above_powers_of_two(rng, count, n, dtype):
    """Significands of few units above 1, where a rounding error is largest relative to the number."""
    eps = float(jnp.finfo(dtype).eps)
    return _rounded((1 + eps * rng.integers(0, 8, (count, n, 3))) * rng.choice([-1.0, 1.0], (count, n, 3)), dtype)


def small_integers_and_zeros(rng, count, n, dtype):
    """Integers from -2 to 2, many of them zero."""
    return _rounded(rng.integers(-2, 3, (count, n, 3)), dtype)


FAMILIES = {
    family.__name__: family
    for family in (benign, mixed_scales, parallel, nearly_parallel, just_above_powers_of_two, small_integers_and_zeros)
}


def _spread(dtype):
    return max(int(jnp.finfo(dtype).maxexp) // 8, 1)


def _rounded(x, dtype):
    return list(np.asarray(x, np.float64).astype(dtype))
