"""How a formula is run: as one compiled program, or written into the program that is being traced."""

import functools

import jax
import numpy as np

from jaxspatial.arithmetic.precision import resolve


def kernel(formula):
    """Makes of `formula(precision, *arrays)` a function that compiles once per precision, shapes and dtypes.

    Outside of any transformation a call is one compiled program, as fast as it gets and bitwise the same as inside a
    larger jit. While tracing, NumPy arrays are numbers known to the formula, which then leaves out what they make
    unnecessary; everything else is inlined from a cached trace.
    """
    compiled = jax.jit(formula, static_argnums=0, inline=True)

    @functools.wraps(formula)
    def call(precision, *arrays):
        known = any(isinstance(a, np.ndarray) for a in arrays)
        tracing = any(isinstance(a, jax.core.Tracer) for a in arrays)
        return (formula if known and tracing else compiled)(resolve(precision), *arrays)

    return call
