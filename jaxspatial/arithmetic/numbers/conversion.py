"""Numbers from outside of JAX as words: pairs of NumPy numbers, and what a dtype holds."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike

from jaxspatial.arithmetic import check


def of_numbers(x: Any, dtype: DTypeLike, rest: Any = 0.0) -> tuple[Any, Any]:
    """The pair nearest to x + rest as NumPy arrays, of numbers of at most 64 bits, of which JAX may know only 32."""
    x = np.asarray(x, np.float64)
    with np.errstate(all="ignore"):
        high: np.ndarray[Any, Any] = x.astype(dtype)
        rest = (x - high.astype(np.float64)) + rest
        low = np.where(np.isfinite(rest), rest, 0).astype(dtype)
        # Once more: NumPy rounds twice on the way from float64 to bfloat16. A zero keeps its sign.
        hi = np.where(low == 0, high, high + low)
        lo = low - (hi - high)
    return hi, np.where(low == 0, low, lo)


def of_number(x: float, dtype: DTypeLike) -> tuple[Any, Any]:
    """The pair nearest to a Python number; of an int, which may have more than 64 bits, in two parts."""
    rounded = float(x)
    rest = float(x - int(rounded)) if isinstance(x, int) else 0.0
    return of_numbers(rounded, dtype, rest)


def is_floating(x: Any) -> bool:
    """Whether x is a Python float or an array of floating point."""
    return isinstance(x, float) or (isinstance(x, check.ARRAYS) and jnp.issubdtype(x.dtype, jnp.floating))


def known_dtype(dtype: DTypeLike) -> np.dtype[Any]:
    """A dtype as NumPy's, of floating point, and one that JAX knows as things are set."""
    dtype = np.dtype(dtype)
    if not jnp.issubdtype(dtype, jnp.floating):
        raise TypeError(f"dtype: expected float16, bfloat16, float32 or float64, got {dtype}")
    if jax.dtypes.canonicalize_dtype(dtype) != dtype:
        raise TypeError(f"dtype: expected one that JAX has switched on, got {dtype}; see jax.enable_x64")
    return dtype


def narrowest(a: np.dtype[Any], b: np.dtype[Any]) -> np.dtype[Any]:
    """The narrowest dtype that holds both."""
    return a if holds(a, b) else b if holds(b, a) else np.dtype(np.float32)


def holds(a: np.dtype[Any], b: np.dtype[Any]) -> bool:
    """Whether dtype a holds all numbers of dtype b."""
    wide, narrow = check.finfo(a), check.finfo(b)
    return bool(wide.nmant >= narrow.nmant and wide.maxexp >= narrow.maxexp)
