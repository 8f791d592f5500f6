"""What the tests of rotations share: which dtypes they run in, and how far from the exact result one may be."""

import jax.numpy as jnp
import numpy as np
import pytest

from tests.helpers.marks import slow

wide_dtypes = pytest.mark.parametrize("dtype", ["float32", slow("float64")])


def eps(dtype):
    return float(jnp.finfo(dtype).eps)


def allowed(dtype, precision, bound, size=1.0):
    """The bound of a record. 16-bit types are computed in float32, and rounded once."""
    return bound.allowed("compensated" if jnp.finfo(dtype).bits < 32 else precision, eps(dtype) / 2, size, size)


def of_dtype(x, dtype):
    return np.asarray(x, float).astype(jnp.dtype(dtype))
