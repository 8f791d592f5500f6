"""Error-free transforms are exact in every surrounding in which a compiler has been seen to break them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxspatial.measure.error import rationals
from jaxspatial.numerics.errorfree import scaling, transforms
from jaxspatial.numerics.errorfree.barrier import barrier, barrier_or_nan
from tests.helpers.marks import slow_but

DTYPES = ["float16", "bfloat16", "float32", "float64"]
N = 400


def _numbers(dtype, seed=0):
    rng = np.random.default_rng(seed)
    reach = {"float16": 2, "bfloat16": 20, "float32": 20, "float64": 150}[dtype]
    a, b = rng.standard_normal((2, N)) * 2.0 ** rng.integers(-reach, reach, (2, N))
    return a.astype(jnp.dtype(dtype)), b.astype(jnp.dtype(dtype))


# What a transform is used in: both results, the error alone, the error added to something else, inside a scan.
SURROUNDINGS = {
    "eager": lambda f: f,
    "jit": jax.jit,
    "vmap": lambda f: jax.jit(jax.vmap(f)),
    "scan": lambda f: jax.jit(lambda a, b: lax.scan(lambda _, x: (None, f(*x)), None, (a, b))[1]),
    "error alone": lambda f: _joined(jax.jit(lambda a, b: f(a, b)[0]), jax.jit(lambda a, b: f(a, b)[1])),
    "error alone, vmap": lambda f: _joined(
        jax.jit(jax.vmap(lambda a, b: f(a, b)[0])), jax.jit(jax.vmap(lambda a, b: f(a, b)[1]))
    ),
    "error alone, scan": lambda f: _joined(
        jax.jit(lambda a, b: f(a, b)[0]), jax.jit(lambda a, b: lax.scan(lambda c, x: (c, f(*x)[1]), 0, (a, b))[1])
    ),
}


def _joined(result, error):
    return lambda a, b: (result(a, b), error(a, b))


@pytest.mark.parametrize("dtype", slow_but(["float32", "float64"], DTYPES))
@pytest.mark.parametrize("surrounding", SURROUNDINGS)
def test_two_sum(surrounding, dtype):
    a, b = _numbers(dtype)
    with jax.enable_x64(dtype == "float64"):
        s, e = SURROUNDINGS[surrounding](transforms.two_sum)(jnp.asarray(a), jnp.asarray(b))
    np.testing.assert_array_equal(np.asarray(s), a + b)
    assert (rationals(s) + rationals(e) == rationals(a) + rationals(b)).all()


@pytest.mark.parametrize("dtype", slow_but(["float32", "float64"], DTYPES))
@pytest.mark.parametrize("surrounding", SURROUNDINGS)
def test_fast_two_sum(surrounding, dtype):
    a, b = _numbers(dtype)
    a, b = np.where(abs(a) >= abs(b), a, b), np.where(abs(a) >= abs(b), b, a)
    with jax.enable_x64(dtype == "float64"):
        s, e = SURROUNDINGS[surrounding](transforms.fast_two_sum)(jnp.asarray(a), jnp.asarray(b))
    assert (rationals(s) + rationals(e) == rationals(a) + rationals(b)).all()


@pytest.mark.parametrize("dtype", slow_but(["float32", "float64"], DTYPES[1:]))
@pytest.mark.parametrize("surrounding", SURROUNDINGS)
def test_two_product(surrounding, dtype):
    a, b = _numbers(dtype)
    with jax.enable_x64(dtype == "float64"):
        p, e = SURROUNDINGS[surrounding](transforms.two_product)(jnp.asarray(a), jnp.asarray(b))
    np.testing.assert_array_equal(np.asarray(p), a * b)
    assert (rationals(p) + rationals(e) == rationals(a) * rationals(b)).all()


@pytest.mark.parametrize("surrounding", SURROUNDINGS)
def test_two_product_of_float16_while_its_error_is_normal(surrounding):
    rng = np.random.default_rng(2)
    a, b = rng.uniform(1, 2, (2, N)).astype(np.float16) * np.float16(8)
    p, e = SURROUNDINGS[surrounding](transforms.two_product)(jnp.asarray(a), jnp.asarray(b))
    assert (rationals(p) + rationals(e) == rationals(a) * rationals(b)).all()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("transform", [transforms.two_sum, transforms.two_difference])
def test_sums_with_constants_of_the_program(transform, dtype):
    """XLA would rewrite `(c + x) - c` to x, and `(x + c1) + c2` to x + (c1 + c2)."""
    a, _ = _numbers(dtype)
    sign = -1 if transform is transforms.two_difference else 1
    with jax.enable_x64(dtype == "float64"):
        c, d = (jnp.asarray(x, dtype) for x in (0.7, -0.3))
        for function in (lambda a: (a, c), lambda a: (c, a), lambda a: (transforms.two_sum(a, d)[0], c)):
            x, y = function(jnp.asarray(a))
            s, e = jax.jit(lambda a, f=function: transform(*f(a)))(jnp.asarray(a))
            assert (rationals(s) + rationals(e) == rationals(x) + sign * rationals(y)).all()


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_errors_down_to_the_smallest_number_are_off_by_no_more_than_that(dtype):
    """Below tiny / eps halves are not exact any more, and subnormal errors are lost: at most 3 u of the product."""
    info = np.finfo(dtype)
    rng = np.random.default_rng(0)
    a = np.ldexp(rng.uniform(0.5, 1, 300).astype(dtype), rng.integers(info.minexp, info.minexp + 2 * info.nmant, 300))
    b = rng.uniform(-1, 1, 300).astype(dtype)
    with jax.enable_x64(True):
        p, e = jax.jit(transforms.two_product)(a.astype(dtype), b)
    off = abs(rationals(p) + rationals(e) - rationals(a.astype(dtype)) * rationals(b))
    allowed = 3 * rationals(np.full(1, info.eps))[0] * abs(rationals(p)) + 2 * rationals(np.full(1, info.tiny))[0]
    assert (off <= allowed).all()


@pytest.mark.parametrize("dtype", DTYPES)
def test_split_has_halves_whose_products_are_exact(dtype):
    a, b = _numbers(dtype)
    info = jnp.finfo(dtype)
    a, b = (x[abs(x) >= info.tiny / info.eps] for x in (a, b))
    bits = (info.nmant + 1 + 1) // 2
    with jax.enable_x64(dtype == "float64"):
        halves = [*jax.jit(transforms.split)(jnp.asarray(a)), *jax.jit(transforms.split)(jnp.asarray(b))]
    assert (rationals(halves[0]) + rationals(halves[1]) == rationals(a)).all()
    for half in halves:
        assert all(_significant_bits(x) <= bits for x in rationals(half))


@pytest.mark.parametrize("dtype", DTYPES)
def test_products_with_the_largest_numbers_are_exact(dtype):
    """Whose halves are not rounded up to an infinity."""
    info = jnp.finfo(dtype)
    with jax.enable_x64(dtype == "float64"):
        near = jnp.asarray(info.max) * (1 - jnp.arange(8, dtype=dtype) * jnp.asarray(info.eps))
        hi, _ = jax.jit(transforms.split)(near)
        a, b = jnp.repeat(near, 3), jnp.tile(jnp.asarray([0, 1, 0.7], dtype), 8)
        p, e = jax.jit(transforms.two_product)(a, b)
    assert np.isfinite(np.asarray(hi, float)).all()
    assert (rationals(p) + rationals(e) == rationals(a) * rationals(b)).all()


def _significant_bits(x):
    odd = abs(x.numerator)
    while odd and odd % 2 == 0:
        odd //= 2
    return odd.bit_length()


@pytest.mark.parametrize("dtype", DTYPES)
def test_exponent_is_that_of_the_largest(dtype):
    info = jnp.finfo(dtype)
    others = np.array([0, 1, 2, 0.5, info.max, info.tiny, np.inf, -np.inf, np.nan]).astype(jnp.dtype(dtype))
    x = np.concatenate([others, *_numbers(dtype)])
    with jax.enable_x64(dtype == "float64"):
        found = jax.jit(lambda x: scaling.exponent((x / 4, x)))(jnp.asarray(x))
    np.testing.assert_array_equal(found, _exponents(x))


def test_exponent_where_64_bit_types_are_on_for_a_part_of_a_program():
    """JAX 0.12 puts off what `jnp.frexp` does until it lowers the program, and they are off again."""

    def found(x):
        with jax.enable_x64(True):
            return scaling.exponent((lax.convert_element_type(x, np.float64),))

    x = _numbers("float32")[0]
    np.testing.assert_array_equal(jax.jit(found)(x), _exponents(x))


def _exponents(x):
    usable = np.isfinite(x) & (x != 0)
    return np.where(usable, np.frexp(np.where(usable, x, 1).astype(np.float64))[1], 0)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("barrier", [barrier, barrier_or_nan], ids=lambda f: f.__name__)
def test_a_barrier_passes_everything_and_has_derivative_one(barrier, dtype):
    with jax.enable_x64(dtype == "float64"):
        largest = float(jnp.finfo(dtype).max)
        x = jnp.array([0.0, -0.0, 1.5, -largest, largest, jnp.inf, -jnp.inf, jnp.nan], dtype)
        through, given = (np.asarray(y).astype(np.float64) for y in (jax.jit(barrier)(x), x))
        np.testing.assert_array_equal(through, given)
        np.testing.assert_array_equal(np.signbit(through), np.signbit(given))
        assert jax.grad(barrier)(x[2]) == 1


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("function", [lambda a, b: transforms.two_sum(a, b), lambda a, b: transforms.two_product(a, b)])
def test_derivatives_pass_through(function, dtype):
    """The sum of the pair has the derivatives of a + b, or of a b: the error has none of its own."""
    with jax.enable_x64(dtype == "float64"):
        a, b = jnp.asarray(1.3, dtype), jnp.asarray(-0.7, dtype)
        expected = (1, 1) if function(a, b)[0] == a + b else (b, a)
        whole = jax.grad(lambda a, b: sum(function(a, b)), (0, 1))(a, b)
        np.testing.assert_array_equal(np.asarray(whole), np.asarray(expected, dtype))
