"""Sums of products of float64 in twice the digits are machine code over many items, with the bits of XLA's way."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import PartitionSpec as P

import jaxspatial as js
from jaxspatial.engine import cpu, sums
from tests.helpers.marks import slow_but
from tests.helpers.processes import python

if not cpu.is_available():
    pytest.skip("sums take XLA's way here", allow_module_level=True)

N = sums.FEWEST
F64 = np.float64


@pytest.fixture(autouse=True)
def in_64_bits():
    with jax.enable_x64(True), js.default_precision("compensated"):
        yield


def vectors(*shape, count=4):
    """Of very different size, with zeros, infinities and NaN among them, and pairs whose products nearly cancel."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((count, *shape, 3)) * 2.0 ** rng.integers(-200, 200, (count, *shape, 1))
    flat = x.reshape((count, -1, 3))
    flat[1, ::3] = flat[2, ::3] * 3
    for k, extreme in enumerate([0, -0.0, np.inf, np.nan, 1e200, 1.7e308]):
        flat[k % count, 5 * k + 1, k % 3] = extreme
    return x


def force(a, b, *_):
    return js.SpatialForce(a, b)


def shifted(a, b, c, d):
    return js.shift(force(a, b), c)


def power(a, b, c, d):
    return js.dot(force(a, b), js.SpatialVelocity(c, d))


def crossed(a, b, c, d):
    return js.cross(js.SpatialVelocity(c, d), force(a, b))


def tangent(a, b, c, d):
    """Of a product of three factors, and as a pair of limbs."""
    A = js.SpatialAcceleration(a, b)
    found = jax.jvp(lambda w: js.shift(A, c, w), (d,), (a,))
    return found, js.shift(js.to_double_word(force(a, b)), c)


FUNCTIONS = {"shift": (shifted, 1), "dot": (power, 1), "cross": (crossed, 2), "of three factors": (tangent, 3)}


def calls(function, *arrays):
    """How often machine code is called by what XLA makes of a function."""
    return jax.jit(lambda *x: function(*x)).lower(*arrays).compile().as_text().count('custom_call_target="jaxspatial')


def by_xla(function, *arrays):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cpu, "is_available", lambda: False)
        assert calls(function, *arrays) == 0
        return jax.jit(lambda *x: function(*x))(*arrays)


def assert_same(found, expected):
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(x, y)
        number = ~np.isnan(x)
        np.testing.assert_array_equal(np.signbit(x)[number], np.signbit(y)[number])


@pytest.mark.parametrize("name", slow_but(["shift", "of three factors"], FUNCTIONS))
def test_the_bits_are_those_of_xla(name):
    function, n_calls = FUNCTIONS[name]
    arrays = vectors(N + 3)
    assert calls(function, *arrays) == n_calls
    expected = by_xla(function, *arrays)
    assert_same(jax.jit(function)(*arrays), expected)
    one = jax.jit(function)(*(x[7] for x in arrays))
    assert_same(one, jax.tree.map(lambda y: y[7], expected))


def test_an_offset_that_all_items_share():
    a, b, c, d = vectors(2, N)
    c = c[0, 9]
    assert_same(jax.jit(jax.vmap(jax.vmap(shifted, (0, 0, None, 0)), (0, 0, None, 0)))(a, b, c, d), shifted(a, b, c, d))
    assert_same(shifted(a, b, c, d), by_xla(shifted, a, b, c, d))


def test_a_program_without_64_bit_types():
    """It divides in double words of float64, and returns float32."""

    def axis(a, b):
        return js.central_axis(js.SpatialForce(a, b))

    arrays = np.random.default_rng(0).standard_normal((2, N, 3)).astype(np.float32)
    with jax.enable_x64(False):
        assert calls(axis, *arrays) > 0
        assert_same(jax.jit(axis)(*arrays), by_xla(axis, *arrays))


def test_what_nobody_reads_is_not_computed():
    arrays = vectors(N)
    assert calls(lambda *x: crossed(*x).tau, *arrays) == 1
    assert calls(lambda *x: shifted(*x).f, *arrays) == 0


def test_what_stays_with_xla():
    """Few items, whose call would take longer than they do; formats that float64 holds twice; what is exported."""
    arrays = vectors(N)
    assert calls(shifted, *(x[1:] for x in arrays)) == 0
    assert calls(shifted, *np.ones(arrays.shape, np.float32)) == 0
    with js.default_precision("reproducible"):
        assert calls(shifted, *arrays) == 0
    with js.default_precision("faithful"):
        assert calls(shifted, *arrays) == 0
    exported = jax.export.export(jax.jit(lambda *x: shifted(*x)))(*arrays)
    assert "custom_call" not in exported.mlir_module()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["Auto", "Explicit"])
def test_items_that_are_split_over_devices_stay_where_they_are(kind):
    program = f"from tests.engine.test_sums import on_devices; on_devices({kind!r})"
    python("-c", program, n_devices=4)


def on_devices(kind):
    with jax.enable_x64(True), js.default_precision("compensated"):
        mesh = jax.make_mesh((4,), ("items",), axis_types=(getattr(jax.sharding.AxisType, kind),))
        a, b, c, d = vectors(4 * (N + 3))
        expected = shifted(a, b, c, d), power(a, b, c, d), shifted(a, b, c[7], d)
        with jax.set_mesh(mesh):
            a, b, c, d = (jax.device_put(x, jax.NamedSharding(mesh, P("items"))) for x in (a, b, c, d))
            shared = jax.device_put(vectors(4 * (N + 3))[2, 7], jax.NamedSharding(mesh, P()))
            compiled = jax.jit(lambda a, b, c, d, p: (shifted(a, b, c, d), power(a, b, c, d), shifted(a, b, p, d)))
            compiled = compiled.lower(a, b, c, d, shared).compile()
            text = compiled.as_text()
            assert text.count('custom_call_target="jaxspatial') == 3 and not re.search("all-|collective", text)
            found = compiled(a, b, c, d, shared)
        assert_same(found, expected)
        assert all(not x.sharding.is_fully_replicated for x in jax.tree.leaves(found))


def test_gradients():
    a, b, c, d = map(jnp.asarray, np.random.default_rng(0).standard_normal((4, N, 3)))

    def work(*x):
        return power(*x).sum() + (shifted(*x).tau * a).sum()

    found = jax.jit(jax.grad(work, (0, 1, 2, 3)))(a, b, c, d)
    assert_same(found, by_xla(jax.grad(work, (0, 1, 2, 3)), a, b, c, d))
