"""Functions that call several algorithms, as one program: a step in time is one function of machine code.

Between programs of their own, arrays over all states would be written to memory and read again.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxspatial.engine import program
from jaxspatial.engine.algorithm import Algorithm, contents, run_formula
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
    """Makes one program, over a batch, of `function(precision, scene, *arrays, **static)`.

    scene: a tuple of a Mechanism and other trees, or an empty one. Its NumPy numbers are constants of the program.
    Where it has a batch of its own, or calls a function of the caller's, which may read arrays of the caller's, there
    is no such program: the function is part of the caller's. arrays: trees of arrays (*batch, n), None for nothing;
    batch shapes broadcast. static: hashable arguments. The results are trees of arrays of one state.
    """
    vars(function).update(program_class=Composite, result_shape=None)
    name = function.__name__.lstrip("_")

    @functools.wraps(function)
    def call(precision: Precision, scene: tuple, *arrays, **static):
        if any(map(_is_of_caller, scene[1:])):
            return function(precision, scene, *arrays, **static)
        leaves, tree = jax.tree.flatten(((scene,), arrays))
        own = (contents(x) for x in jax.tree.leaves(scene[1:]) if isinstance(x, np.ndarray))
        of_scene, options = tree.children()[0], tuple(sorted(static.items()))
        reads, mechanism = ("composite", of_scene, *own), scene[0] if scene else None
        return run_formula(name, function, precision, mechanism, reads, leaves, tree, of_scene, options)

    return call


def _is_of_caller(x) -> bool:
    return bool(getattr(x, "batch_shape", ()) or getattr(x, "calls_functions", callable(x)))
