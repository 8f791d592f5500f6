"""What the tests of rotations share: which dtypes they run in, and how far from the exact result one may be."""

import jax.numpy as jnp
import numpy as np
import pytest

from tests.helpers.marks import slow

wide_dtypes = pytest.mark.parametrize("dtype", ["float32", slow("float64")])


def eps(dtype):
    return float(jnp.finfo(dtype).eps)


def allowed(dtype, precision, bound):
    """`bound` u, or what is left of the error of one rounding."""
    rounded_once = precision in ("compensated", "faithful") or jnp.finfo(dtype).bits < 32
    return (1.01 if rounded_once else bound) * eps(dtype) / 2


def of_dtype(x, dtype):
    return jnp.asarray(np.asarray(x, float).astype(jnp.dtype(dtype)))
