"""The default precision is a context: part of jit's cache key, nested, and overruled by an explicit one."""

import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js

V = js.SpatialVelocity(np.float32([0.1, 0.2, 0.3]), np.float32([1.7, -0.9, 0.4]))


def _products(function, *arguments):
    """How many products are rounded on their own in what a function traces to."""
    return str(jax.make_jaxpr(function)(*arguments)).count("jaxspatial_product")


def test_the_default_is_reproducible():
    assert _products(js.dot, _force(), V) == 6


def _force():
    return js.SpatialForce(jnp.ones(3), jnp.ones(3))


@pytest.mark.parametrize("name", ["fast", js.Precision.FAST])
def test_the_context_sets_it_and_ends(name):
    with js.default_precision(name):
        assert _products(js.dot, _force(), V) == 0
        with js.default_precision("reproducible"):
            assert _products(js.dot, _force(), V) == 6
        assert _products(js.dot, _force(), V) == 0
    assert _products(js.dot, _force(), V) == 6


def test_an_explicit_precision_wins():
    with js.default_precision("fast"):
        assert _products(lambda F, V: js.dot(F, V, precision="reproducible"), _force(), V) == 6


def test_it_is_part_of_the_cache_key():
    traces = []

    @jax.jit
    def power(F, V):
        traces.append(1)
        return js.dot(F, V)

    for _ in range(2):
        power(_force(), V)
        with js.default_precision("fast"):
            power(_force(), V)
    assert len(traces) == 2


def test_each_thread_has_its_own():
    seen = []
    with js.default_precision("fast"):
        thread = threading.Thread(target=lambda: seen.append(_products(js.dot, _force(), V)))
        thread.start()
        thread.join()
    assert seen == [6]


def test_an_unknown_name_is_refused():
    names = "'fast', 'reproducible', 'compensated', 'faithful' or None"
    with pytest.raises(ValueError, match=f"precision: expected one of {names}, got 'exact'"):
        js.default_precision("exact")
