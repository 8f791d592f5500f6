"""How a formula is run: as one compiled program, or written into the program that is being traced."""

import functools

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.double_word import DoubleWord
from jaxspatial.arithmetic.precision import resolve
from jaxspatial.arithmetic.symbolic import run_symbolically


def kernel(formula):
    """Makes of `formula(precision, *arrays)` a function that compiles once per precision, shapes and dtypes.

    Arrays are (*batch, n), with batch shapes that broadcast. Outside of any transformation a call is one compiled
    program, as fast as it gets and bitwise the same as inside a larger jit. While tracing, NumPy arrays are numbers
    known to the formula, which then leaves out what they make unnecessary; everything else is inlined from a cached
    trace. Arguments may be double words: then the results are, whatever the precision asked for.
    """
    program = functools.partial(_run, formula)
    compiled = jax.jit(program, static_argnums=0, inline=True)

    @functools.wraps(formula)
    def call(precision, *arrays):
        known = any(isinstance(a, np.ndarray) for a in arrays)
        tracing = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(arrays))
        return (program if known and tracing else compiled)(resolve(precision), *arrays)

    return call


def _run(formula, precision, *arrays):
    if precision.sees_whole_sums or any(isinstance(a, DoubleWord) for a in arrays):
        return run_symbolically(formula, precision, arrays)
    batch = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    return formula(precision, *check.broadcast_batch(batch, *arrays))
