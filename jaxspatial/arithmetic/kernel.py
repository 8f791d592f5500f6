"""How a formula is run: as one compiled program, or written into the program that is being traced."""

import functools
import typing

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.arithmetic import check, components, lanes
from jaxspatial.arithmetic.components import Components
from jaxspatial.arithmetic.precision import resolve
from jaxspatial.arithmetic.symbolic import run_symbolically


def kernel(formula) -> typing.Any:
    """Makes of `formula(precision, *arrays)` a function that compiles once per precision, shapes and dtypes.

    Arrays are (*batch, n), with batch shapes that broadcast. Outside of any transformation a call is one compiled
    program, as fast as it gets and bitwise the same as inside a larger jit. While tracing, NumPy arrays are numbers
    known to the formula, which then leaves out what they make unnecessary; everything else is inlined from a cached
    trace. Arguments may be double words: then the results are, whatever the precision asked for. If any is Components,
    all results with an axis of components are, known where the structure of the arguments makes them so. bfloat16, each
    operation of which XLA CPU emulates, is evaluated in float32 and rounded once.
    """
    program = functools.partial(_run, formula)
    compiled = jax.jit(program, static_argnums=0, inline=True)

    @functools.wraps(formula)
    def call(precision, *arrays):
        arrays = components.alike(check.narrowed_each(arrays))
        known = any(isinstance(a, np.ndarray) for a in arrays)
        tracing = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(arrays))
        return (program if known and tracing else compiled)(resolve(precision), *arrays)

    return call


def _run(formula, precision, *arrays):
    if precision.sees_whole_sums or any(map(components.has_pairs, arrays)):
        return run_symbolically(formula, precision, arrays)
    if arrays[0].dtype == jnp.bfloat16:
        found = _run_as_it_is(formula, precision, *(jax.tree.map(lambda x: x.astype(np.float32), a) for a in arrays))
        return jax.tree.map(_to_bfloat16, found)
    return _run_as_it_is(formula, precision, *arrays)


def _to_bfloat16(x):
    """Rounded once. By name: XLA has leave to drop a conversion there and back (`xla_allow_excess_precision`)."""
    return x.astype(jnp.bfloat16) if isinstance(x, np.ndarray) else lax.reduce_precision(x, 8, 7).astype(jnp.bfloat16)


def _run_as_it_is(formula, precision, *arrays):
    batch = np.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    arrays = check.broadcast_batch(batch, *arrays)
    if not any(isinstance(a, Components) for a in arrays):
        return formula(precision, *arrays)
    apart = (lanes.Apart(components.as_components(a).components, lanes.BatchApart(batch)) for a in arrays)
    found = formula(precision, *apart)
    return tuple(_gathered(x, batch) for x in found) if isinstance(found, tuple) else _gathered(found, batch)


def _gathered(x, batch):
    """What a formula returns of arrays that are apart."""
    return components.of(x.components) if isinstance(x, lanes.Apart) else jnp.broadcast_to(x, batch)
