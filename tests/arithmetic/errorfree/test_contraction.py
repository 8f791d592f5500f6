"""Errors of products by contraction: only where they are exact, in every way a program comes about, and the same bits
as Dekker's."""

import os
import subprocess
import sys

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from jaxspatial.arithmetic.errorfree import contraction, transforms
from jaxspatial.arithmetic.numbers import conversion, pairs
from jaxspatial.measure import checks, inputs
from jaxspatial.measure.exact import rationals
from jaxspatial.measure.operation import OPERATIONS
from tests.helpers.marks import slow_but

IS_HERE = contraction.holds(np.dtype("float64"))
WAYS = [pytest.param(True, id="contracted", marks=pytest.mark.skipif(not IS_HERE, reason="no contraction here")), False]
BOTH = pytest.mark.parametrize("way", WAYS)
HERE = pytest.mark.skipif(not IS_HERE, reason="no contraction here")
DTYPES = ["float32", "float64"]


def shifted(tau, f, p, precision="compensated"):
    return js.shift(js.SpatialForce(tau, f), p, precision=precision).tau


def wrenches(n=50, family=inputs.benign):
    return family(np.random.default_rng(3), 3, n, np.dtype("float64"))


def is_contracted(text):
    """A program that divides numbers into halves masks bits; one that is contracted has no mask."""
    return "stablehlo.and" not in text and "stablehlo.replica_id" in text


# -- the trial --------------------------------------------------------------------------------------------------------


CALLS = 14


def test_trial_passes_where_errors_are_exact(monkeypatch):
    """Of errors computed outside of the program, whatever the machine has. JAX hands float64 out as float32."""

    def error(a, b, p):
        exact = np.vectorize(contraction._exact_error, otypes=[p.dtype])
        return jax.pure_callback(exact, jax.ShapeDtypeStruct(p.shape, p.dtype), a, b, p)

    monkeypatch.setattr(contraction, "product_error", error)
    assert contraction._passes(np.dtype("float32"))


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("call", slow_but([0, 1, 5, 10], list(range(CALLS))))
def test_trial_sees_an_error_that_is_missing_somewhere(call, dtype, monkeypatch):
    """Of the products that are tried, each in other surroundings, one as a compiler would break it."""
    right, calls = contraction.product_error, []

    def error(a, b, p):
        calls.append(a)
        e = right(a, b, p)
        return jnp.zeros_like(e) if len(calls) == call + 1 else e

    monkeypatch.setattr(contraction, "product_error", error)
    assert not contraction._passes(np.dtype(dtype)) and len(calls) == CALLS


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("row", [0, 1, 4, 7, 24], ids=["large", "small", "one bit", "body", "remainder"])
def test_trial_sees_one_wrong_error(row, dtype, monkeypatch):
    right = contraction.product_error

    def error(a, b, p):
        e = right(a, b, p)
        return e.at[row].multiply(1 + jnp.finfo(e.dtype).eps) if e.ndim == 2 else e

    monkeypatch.setattr(contraction, "product_error", error)
    assert not contraction._passes(np.dtype(dtype))


def test_a_trial_that_cannot_be_run_means_no(monkeypatch):
    def fails(*_):
        raise RuntimeError

    monkeypatch.setattr(contraction, "_trial", fails)
    assert not contraction._passes(np.dtype("float64"))


@pytest.mark.parametrize("dtype", ["float16", "bfloat16"])
def test_narrow_formats_are_not_tried(dtype):
    assert not contraction.holds(jnp.dtype(dtype))


@HERE
def test_trial_runs_while_something_else_is_traced():
    """In a trace, in a scan, in a vmap, and where JAX evaluates while it traces; with 64-bit types off."""
    arrays = wrenches(5)
    with jax.enable_x64(True):
        expected = np.asarray(jax.jit(shifted)(*arrays))

    def found():
        contraction.holds.cache_clear()
        jax.clear_caches()
        with jax.ensure_compile_time_eval(), jax.enable_x64(True):
            return shifted(*arrays)

    def in_trace(x):
        return x + found()[0, 0]

    for traced in (jax.jit(in_trace), jax.vmap(in_trace), lambda x: lax.scan(lambda c, y: (c, in_trace(y)), 0, x)[1]):
        with jax.enable_x64(True):
            np.testing.assert_array_equal(np.asarray(traced(jnp.zeros(3))), np.full(3, expected[0, 0]))
        assert contraction.holds(np.dtype("float64"))


def test_import_tries_nothing_and_a_program_without_such_products_neither():
    program = (
        "import jax, numpy as np, jaxspatial as js; from jaxspatial.arithmetic.errorfree import contraction as c\n"
        "values = dict(jax.config.values); x = np.ones((3, 3), np.float32); F = js.SpatialForce(x, x)\n"
        "for q in js.Precision: js.shift(F, x, precision=q)\n"
        "assert c.holds.cache_info().currsize == 0 and dict(jax.config.values) == values\n"
        "js.to_double_word(F) * 2; assert c.holds.cache_info().currsize == 1 and dict(jax.config.values) == values"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300)


# -- where it is used -------------------------------------------------------------------------------------------------


@BOTH
def test_each_way_can_be_forced(way):
    with contraction.forced(way), jax.enable_x64(True):
        assert is_contracted(jax.jit(shifted).lower(*wrenches()).as_text()) is way


@HERE
def test_what_is_lowered_for_another_machine_does_without():
    with jax.enable_x64(True):
        arrays = wrenches()
        assert is_contracted(jax.jit(shifted).lower(*arrays).as_text())
        exported = jax.export.export(jax.jit(shifted))(*arrays)
        texts = [exported.mlir_module()]
        for platforms in (("tpu",), ("cuda",)):
            texts.append(jax.jit(shifted).trace(*arrays).lower(lowering_platforms=platforms).as_text())
        assert not any(map(is_contracted, texts))
        np.testing.assert_array_equal(exported.call(*arrays), jax.jit(shifted)(*arrays))


def test_a_persistent_cache_gives_each_process_a_program_that_is_right_for_it(tmp_path):
    """One with fused multiply-add, one without, one with: each tries for itself, and finds the exact result."""
    program = (
        "import jax, numpy as np, jaxspatial as js\n"
        "from jaxspatial.arithmetic.errorfree import contraction as c\n"
        "jax.config.update('jax_enable_x64', True)\n"
        "p = np.arange(1, 13).reshape(4, 3) / 3; f = np.flip(p, 0) * np.pi\n"
        "found = jax.jit(lambda *x: js.shift(js.SpatialForce(*x[:2]), x[2], precision='compensated').tau)\n"
        "print(found(np.cross(p, f), f, p).tobytes().hex(), c.holds(np.dtype('float64')))"
    )
    cache = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    runs = []
    for flags in ("", "--xla_cpu_max_isa=AVX", ""):
        environment = {**os.environ, **cache, "XLA_FLAGS": flags}
        run = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        runs.append(run.stdout.split())
    assert len({bits for bits, _ in runs}) == 1
    assert runs[1][1] == "False"
    assert sum("_trial" in path.name and "cache" in path.name for path in tmp_path.iterdir()) == 3


# -- what it gives ----------------------------------------------------------------------------------------------------


@BOTH
@pytest.mark.parametrize("precision", ["compensated", "faithful"])
@pytest.mark.parametrize("name", ["shift_force", "dot"])
def test_hostile_inputs_each_way(name, precision, way):
    """Values, in a batch, a loop and one by one, whatever cancels or nearly overflows."""
    with contraction.forced(way):
        arrays = checks._hostile(name, js.Precision(precision), "float64")
        assert checks._over_promise(OPERATIONS[name], js.Precision(precision), arrays) <= 1


@BOTH
@pytest.mark.parametrize("precision", ["compensated", "faithful"])
def test_derivatives_each_way(precision, way):
    with contraction.forced(way):
        assert checks._derivatives_over(js.Precision(precision), "float64") <= 1


def _both_ways(function, *arrays):
    for way in (True, False):
        with contraction.forced(way), jax.enable_x64(True):
            yield jax.tree.map(np.asarray, jax.jit(function)(*arrays))


def _assert_same_bits(function, *arrays):
    contracted, divided = map(jax.tree.leaves, _both_ways(function, *arrays))
    for x, y in zip(contracted, divided, strict=True):
        np.testing.assert_array_equal(x, y)
        np.testing.assert_array_equal(np.signbit(x), np.signbit(y))


# Whose products have errors that are normal numbers, and that Dekker's halves do not overflow.
FAMILIES = [name for name in inputs.FAMILIES if "overflow" not in name and "tiny" not in name]


@HERE
@pytest.mark.parametrize("precision", ["compensated", "faithful"])
@pytest.mark.parametrize("family", slow_but(["nearly_parallel", "far_offsets"], FAMILIES))
def test_same_bits_both_ways(family, precision):
    arrays = wrenches(100, inputs.FAMILIES[family])

    def value_and_derivatives(tau, f, p):
        value, pull_back = jax.vjp(lambda *x: shifted(*x, precision), tau, f, p)
        return value, pull_back(f)

    _assert_same_bits(value_and_derivatives, *arrays)
    _assert_same_bits(lambda tau, f, p: [x[0] for x in value_and_derivatives(tau[:1], f[:1], p[:1])[1]], *arrays)


@HERE
@pytest.mark.parametrize("dtype", DTYPES)
def test_double_words_have_the_same_bits_both_ways(dtype):
    numbers = np.random.default_rng(5).standard_normal((4, 200))
    x, y = (tuple(js.to_double_word(z).words) for z in numbers[:2])
    x, y = (tuple(np.asarray(w, dtype) for w in conversion.of_numbers(z, np.dtype(dtype))) for z in numbers[:2])
    x = np.abs(x[0]), x[1] * np.sign(x[0])
    word = numbers[2].astype(dtype)
    _assert_same_bits(
        lambda x, y, b: [
            pairs.multiply(x, y),
            pairs.divide(x, y),
            pairs.multiply_word(x, b),
            pairs.divide_word(x, b),
            pairs.square_root(x),
        ],
        x,
        y,
        word,
    )


@BOTH
@pytest.mark.parametrize("dtype", DTYPES)
def test_errors_down_to_the_smallest_number_are_off_by_no_more_than_that(way, dtype):
    """Below tiny / eps halves are not exact any more, and subnormal errors are lost: at most 3 u of the product."""
    info = np.finfo(dtype)
    rng = np.random.default_rng(0)
    a = np.ldexp(rng.uniform(0.5, 1, 300).astype(dtype), rng.integers(info.minexp, info.minexp + 2 * info.nmant, 300))
    b = rng.uniform(-1, 1, 300).astype(dtype)
    with contraction.forced(way), jax.enable_x64(True):
        p, e = jax.jit(transforms.two_product)(a.astype(dtype), b)
    off = abs(rationals(p) + rationals(e) - rationals(a.astype(dtype)) * rationals(b))
    allowed = 3 * rationals(np.full(1, info.eps))[0] * abs(rationals(p)) + 2 * rationals(np.full(1, info.tiny))[0]
    assert (off <= allowed).all()
