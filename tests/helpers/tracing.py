"""What is made of known numbers, made while JAX traces."""

import chex
import jax
import numpy as np


def assert_known_while_tracing(made):
    """made() gives the same NumPy arrays inside every transformation."""
    expected = made()

    def nothing(x):
        found = made()
        chex.assert_trees_all_equal(found, expected)
        assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(found))
        return x.sum()

    x = np.ones((2, 2), np.float32)
    with_scan = jax.jit(lambda x: jax.lax.scan(lambda c, y: (c, nothing(y)), 0, x)[1])
    of_gradients = jax.jit(jax.vmap(jax.grad(nothing)))
    for function in (jax.jit(nothing), jax.vmap(nothing), jax.grad(nothing), with_scan, of_gradients):
        function(x)
