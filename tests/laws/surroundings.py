"""What can stand around a function in a program, each of which the compiler rewrites in a way of its own."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from tests.helpers import hostile
from tests.helpers.operations import OPERATIONS

# -- around a function of the arrays of one item, applied to those of a batch -----------------------------------------


def _batch_last(f):
    return lambda *a: jax.jit(jax.vmap(f, in_axes=-1, out_axes=0))(*(jnp.moveaxis(x, 0, -1) for x in a))


def _larger(f):
    """Computes the operands and computes with the results; but by factors of 1, which the compiler does not know."""

    def fused(one, *a):
        results = f(*(x * one for x in a))
        return [r * one + (one - 1) * s for r, s in zip(results, reversed(results), strict=True) if r.shape == s.shape]

    return lambda *a: jax.jit(fused)(jnp.ones((), a[0].dtype), *a)


OF_ITEMS = {
    **hostile.SURROUNDINGS,
    "eager": lambda f: f,
    "jit": jax.jit,
    "vmap": jax.vmap,
    "jit vmap, batch last": _batch_last,
    "primal of a pull-back": lambda f: jax.jit(lambda *a: jax.vjp(f, *a)[0]),
    "inside a larger fusion": _larger,
}


# -- around a function of a dict, which has the arrays of each of its operations --------------------------------------


def _nested(f):
    """scan of vmap of vmap of cond of checkpoint, over a batch with three axes; nobody knows the condition."""

    def chosen(is_on, item):
        return lax.cond(is_on, jax.checkpoint(f), functools.partial(_zeros_like, f), item)

    def over_batch(is_on, data):
        one = functools.partial(chosen, is_on)
        return lax.scan(lambda _, x: (None, jax.vmap(jax.vmap(one))(x)), None, data)[1]

    return lambda data: jax.jit(over_batch)(_true(), data)


def _partly_known(f):
    """Only the first argument is unknown while tracing. If it is the only one, its first array is; if that has only
    one array, that is."""

    def call(arrays):
        unknown = {name: x[: _count_unknown(name)] for name, x in arrays.items()}
        known = {name: [np.asarray(a) for a in x[_count_unknown(name) :]] for name, x in arrays.items()}
        return jax.jit(lambda unknown: f({name: [*x, *known[name]] for name, x in unknown.items()}))(unknown)

    return call


def _count_unknown(name):
    places = OPERATIONS[name].places
    return places.count(0) if places[-1] else min(1, len(places) - 1)


def _true():
    return jnp.asarray(True)


def _zeros_like(f, data):
    return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(f, data))


OF_OPERATIONS = {
    "eager": lambda f: f,
    "jit": jax.jit,
    "vmap": lambda f: jax.jit(jax.vmap(f)),
    "vmap_of_vmap": lambda f: jax.jit(jax.vmap(jax.vmap(f))),
    "scan": lambda f: lambda data: lax.scan(lambda _, x: (None, f(x)), None, data)[1],
    "cond": lambda f: lambda data: lax.cond(_true(), f, functools.partial(_zeros_like, f), data),
    "checkpoint": lambda f: jax.jit(jax.checkpoint(f)),
    "known": _partly_known,
    "nested": _nested,
}
