"""Functions that call several algorithms, as one program: a step in time is one function of machine code.

Between programs of their own, arrays over all states would be written to memory and read again.
"""

import functools
from collections.abc import Callable
from typing import Any, cast

import jax
import numpy as np
from jax.core import Tracer

from jaxspatial.engine import program
from jaxspatial.engine.algorithm import Algorithm, contents, program_cache, warn_of_many_programs, with_batch_axes
from jaxspatial.numerics import floats
from jaxspatial.numerics.precision import Precision


class Composite(Algorithm):
    """The program of a function of (precision, scene, *arrays). Its tree is that of ((scene,), arrays)."""

    has_plain_products = True

    @property
    def is_wide(self) -> bool:
        """The programs that it calls compute in 64 bits where they need it."""
        return False

    @functools.cached_property
    def _known_scene(self):
        """The scene, if all of it is known. Made once: with its mechanism live the programs that are called."""
        leaves = self.known[: self.n_fields]
        return None if any(x is None for x in leaves) else jax.tree.unflatten(self.tree.children()[0], leaves)

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        def of_one(*data: jax.Array) -> list[jax.Array]:
            rest = iter(data)
            scene, others = jax.tree.unflatten(self.tree, [next(rest) if x is None else x for x in self.known])
            (scene,) = self._known_scene or scene
            results = self.formula(self.precision, scene, *others, **dict(self.static))
            leaves, self.out_tree = jax.tree.flatten(results)
            return leaves

        if program.n_states(arrays) == 1:
            return [y[None] for y in of_one(*(x[0] for x in arrays))]
        # A symbol of `jax.export`, which stands for any size, is not compared in size.
        axes = [None if x.shape[0] == 1 else 0 for x in arrays]
        of_each = jax.vmap(of_one, axes)
        return of_each(*(x if axis == 0 else x[0] for x, axis in zip(arrays, axes, strict=True)))


def composite(function: Callable) -> Callable[..., Any]:
    """Turns `function(precision, scene, *arrays, **static)` into one program, over a batch.

    scene: a tuple of a Mechanism and other trees, or an empty one. Its NumPy numbers are constants of the program.
    arrays: trees of arrays (*batch, n), None for nothing; batch shapes broadcast. static: hashable arguments. The
    results are trees of arrays of one state.
    """
    vars(function).update(program_class=Composite, result_shape=None)

    @functools.wraps(function)
    def call(precision: Precision, scene: tuple, *arrays, **static):
        leaves, tree = jax.tree.flatten(((scene,), arrays))
        of_scene = tree.children()[0]
        n = of_scene.num_leaves
        tracing = any(isinstance(x, Tracer) for x in leaves)
        batch = floats.broadcast_shapes((), *(x.shape[:-1] for x in leaves[n:]))
        own = jax.tree.leaves(scene[1:])
        key = "composite", of_scene, *(contents(x) for x in own if isinstance(x, np.ndarray))
        cache = program_cache(scene[0] if scene else None, key, of_scene, leaves[:n])
        known = [x if tracing and isinstance(x, np.ndarray) and x.ndim == 1 else None for x in leaves[n:]]
        known = (*cache.known, *known)
        dtype = np.dtype(leaves[n].dtype)
        options = tuple(sorted(static.items()))
        made = cache.program(function, precision, tree, known, options, dtype)
        data = [with_batch_axes(x, i < n, len(batch)) for i, x in enumerate(leaves) if known[i] is None]
        if tracing:
            return made(cast(Any, data), len(batch))
        warn_of_many_programs(function.__name__.lstrip("_"), cache, (function, tree, options, dtype))
        return cache.call(made)(len(batch), data)

    return call
