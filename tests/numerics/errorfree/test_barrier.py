"""Numbers that a caller computes stay apart from ours; and what a compiler is allowed to break says so."""

import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.interpreters import ad

import jaxspatial as js
from jaxspatial.measure.error import rationals
from jaxspatial.numerics.errorfree import transforms
from jaxspatial.numerics.errorfree.barrier import barrier, barrier_or_nan, difference, fixed_sum, product, quotient
from tests.helpers.marks import slow, slow_but

N = 50


def numbers(k, dtype="float64"):
    return np.random.default_rng(0).standard_normal((k, N)).astype(dtype)


LINEAR = {"product": product, "sum": fixed_sum, "difference": difference, "barrier": lambda a, _: barrier(a)}


@pytest.mark.parametrize("name", LINEAR)
def test_pull_backs_do_not_trace_the_jvp_of_each_operation(name, monkeypatch):
    """They are linearized at once, which takes a part of the time, and have the bits of the jvp."""
    operation, (a, b) = LINEAR[name], (jnp.float32([3.0, 0.1]), jnp.float32([0.7, -5.0]))
    _, expected = jax.jvp(operation, (a, b), (jnp.ones_like(a), jnp.zeros_like(b)))
    (equation,) = jax.make_jaxpr(operation)(a, b).eqns
    monkeypatch.delitem(ad.primitive_jvps, equation.primitive)
    _, pull_back = jax.vjp(operation, a, b)
    np.testing.assert_array_equal(pull_back(jnp.ones_like(a))[0], expected)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_product_of_the_caller_stays_rounded(dtype):
    """Without a barrier it is contracted with the sum that follows, here and in a derivative."""
    a, b, c = numbers(3, dtype)
    with jax.enable_x64(True):
        found = jax.jit(lambda a, b, c: barrier(a * b) + c)(a, b, c)
        rate = jax.jit(lambda a, b, c: jax.jvp(lambda x: barrier(x) + c, (a,), (a * b,))[1] + c)(a, b, c)
        pulled = jax.jit(lambda a, b, c: jax.vjp(lambda x: barrier(x) * c[0], a)[1](a * b)[0] + c)(a, b, c)
    np.testing.assert_array_equal(found, a * b + c)
    np.testing.assert_array_equal(rate, a * b + c)
    assert pulled.shape == c.shape


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_products_with_two_constants_are_not_rearranged(dtype):
    """XLA makes x (c d) of (x c) d for constants. Products of the library are for numbers of its own: those of a caller
    go through a barrier first, as all functions that take arrays have it."""
    (x,), c, d = numbers(1, dtype), np.dtype(dtype).type(0.1), numbers(2, dtype)[1]
    with jax.enable_x64(True):
        constant = jnp.asarray(d)
        found = jax.jit(lambda x: product(barrier(x * c), constant))(x)
        scaled = jax.jit(lambda x: (js.SpatialForce(*[jnp.stack([x * c] * 3, -1)] * 2) * constant).tau)(x)
    np.testing.assert_array_equal(found, (x * c) * d)
    np.testing.assert_array_equal(scaled, np.stack([(x * c) * d] * 3, -1))


@pytest.mark.parametrize(
    ("shape", "dtype"),
    [((N,), "float16"), slow((N,), "float64"), *((s, "float32") for s in [(), (N,), (N, 1), (1, N)])]
    + [slow(s, "float32") for s in [(1,), (2, N)]],
)
def test_one_number_for_many_over_another_is_a_quotient(shape, dtype):
    """XLA multiplies by the reciprocal of what is one number for many, here of constants and of what is broadcast."""
    a, b = np.random.default_rng(0).uniform(1, 2, (2, 100)).astype(dtype)
    a, b = np.stack([a, b])[:, a * (1 / b) != a / b][:, :5]
    expected = [np.full(shape, x / y) for x, y in zip(a, b, strict=True)]

    def divided(x, y):
        return quotient(*(barrier(jnp.broadcast_to(z, shape)) for z in (x, y)))

    def of_constants():
        return [divided(jnp.asarray(x), jnp.asarray(y)) for x, y in zip(a, b, strict=True)]

    def in_a_loop(a, b):
        return list(lax.scan(lambda _, xy: (None, divided(*xy)), None, (a, b))[1])

    with jax.enable_x64(True):
        programs = [
            of_constants(),
            jax.jit(of_constants)(),
            jax.jit(lambda a, b: list(map(divided, a, b)))(a, b),
            jax.jit(lambda a, b: list(jax.vmap(divided)(a, b)))(a, b),
            jax.jit(in_a_loop)(a, b),
        ]
    for found in programs:
        assert len(found) == 5
        for x, y in zip(found, expected, strict=True):
            np.testing.assert_array_equal(x, y, strict=True)


def test_quotients_in_64_bits_of_a_program_of_32():
    """Rounded to float32 they are its quotients, because float64 has more than twice the digits."""
    a, b = numbers(2, "float32")

    def divided(a, b):
        with jax.enable_x64(True):
            a, b = (lax.convert_element_type(x, np.float64) for x in (a, b))
        with jax.enable_x64(False):
            wide = quotient(a, b)
        with jax.enable_x64(True):
            return lax.convert_element_type(wide, np.float32)

    with jax.enable_x64(False):
        found = jax.jit(divided)(a, b)
    np.testing.assert_array_equal(found, a / b, strict=True)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("held, plain", [(fixed_sum, operator.add), (difference, operator.sub)])
def test_sums_with_constants_are_not_rearranged(held, plain, dtype):
    """XLA makes x + (c + d) of (x + c) + d for constants (with JAX 0.10), also in a batch, a loop, and a derivative."""
    x, (c, d) = numbers(1, dtype)[0], np.array([1e5, -1e5], dtype)

    def twice(operation):
        return lambda x: operation(operation(x, jnp.full_like(x, c)), jnp.full_like(x, d))

    def along(x):
        return jax.jvp(held, (x, x), (held(x, jnp.full_like(x, c)), jnp.full_like(x, d)))[1]

    def row_by_row(x):
        return jax.lax.scan(lambda _, y: (None, twice(held)(y)), None, x)[1]

    with jax.enable_x64(True):
        found = [jax.jit(f)(x) for f in (twice(held), jax.vmap(twice(held)), row_by_row, along)]
    for y in found:
        np.testing.assert_array_equal(y, plain(plain(x, c), d))


@pytest.mark.parametrize("held, sign", [(fixed_sum, 1), (difference, -1)])
@pytest.mark.parametrize("which", [(0,), (1,), (0, 1)])
def test_derivatives_of_sums_are_their_terms(held, sign, which):
    a, b, da, db = jnp.asarray(numbers(4, "float32"))

    def function(*moving):
        rest = iter(moving)
        return held(*(next(rest) if k in which else x for k, x in enumerate((a, b))))

    primals, tangents = ([x[k] for k in which] for x in ((a, b), (da, db)))
    signed = {0: da, 1: sign * db}
    _, rate = jax.jvp(function, primals, tangents)
    np.testing.assert_array_equal(rate, sum(signed[k] for k in which))
    for found, k in zip(jax.vjp(function, *primals)[1](da), which, strict=True):
        np.testing.assert_array_equal(found, da if k == 0 else sign * da)
    assert (jax.grad(lambda x: function(*[x] * len(which)).sum())(a) == sum((1, sign)[k] for k in which)).all()


# -- options of one program -------------------------------------------------------------------------------------------

UNOPTIMISED, REARRANGED = {"xla_backend_optimization_level": 0}, {"xla_cpu_enable_fast_math": True}


def cancelling():
    rng = np.random.default_rng(3)
    p, f = rng.standard_normal((2, N, 3)) * [[[1e6]], [[1.0]]]
    return np.cross(p, f), f, p


def shifted(precision):
    return lambda tau, f, p: js.shift(js.SpatialForce(tau, f), p, precision=precision).tau


@pytest.mark.parametrize(
    "held, plain", [(fixed_sum, operator.add), (difference, operator.sub), (product, operator.mul)]
)
@pytest.mark.parametrize("is_first", [True, False])
def test_a_number_stands_for_as_many_as_the_array_has(held, plain, is_first):
    """In every surrounding, and as a batch of numbers, one for each item."""
    x, numbers = np.float32([[0.3, -1.7, 2.9], [0.1, 5.5, -0.7]]), np.float32([2.5, -0.3])

    def both(operation):
        return lambda x, n: operation(n, x) if is_first else operation(x, n)

    f, expected = both(held), both(plain)
    for n in numbers:
        for way in (
            lambda f: f,
            jax.jit,
            jax.vmap,
            lambda f: jax.vmap(f, 1, 1),
            lambda f: jax.jit(jax.vmap(jax.vmap(f))),
        ):
            np.testing.assert_array_equal(way(lambda x, n=n: f(x, n))(x), expected(x, n))
        one = functools.partial(f, n=n)
        slope = np.broadcast_to(jax.jvp(functools.partial(expected, n=n), (x,), (np.ones_like(x),))[1], x.shape)
        np.testing.assert_array_equal(jax.jit(lambda x, one=one: jax.jvp(one, (x,), (jnp.ones_like(x),))[1])(x), slope)
        np.testing.assert_array_equal(jax.grad(lambda x, one=one: one(x).sum())(x), slope)
    np.testing.assert_array_equal(jax.vmap(f)(x, numbers), expected(x, numbers[:, None]))
    np.testing.assert_array_equal(jax.vmap(f, (1, None), 1)(x, numbers[0]), expected(x, numbers[0]))
    with pytest.raises(TypeError):
        f(x, np.float64(2) if jax.config.jax_enable_x64 else np.float16(2))


@pytest.mark.parametrize("precision", ["compensated", "faithful"])
def test_code_that_is_not_optimised_has_the_same_bits(precision):
    arrays = cancelling()
    with jax.enable_x64(True):
        expected = jax.jit(shifted(precision))(*arrays)
        np.testing.assert_array_equal(jax.jit(shifted(precision), compiler_options=UNOPTIMISED)(*arrays), expected)


CASES = {
    "shift": shifted("compensated"),
    "faithful shift": shifted("faithful"),
    "sum of a batch": lambda tau, f, p: js.SpatialForce(tau, f).sum(0, precision="compensated").tau,
    "double word sum": lambda tau, f, p: (js.to_double_word(tau) + f).limbs[0],
    "double word product": lambda tau, f, p: (js.to_double_word(tau) * f).limbs[0],
    "gradient": lambda *x: jax.grad(lambda *x: shifted("compensated")(*x).sum(), 2)(*x),
    "one item": lambda tau, f, p: shifted("compensated")(tau[0], f[0], p[0]),
    "scan": lambda *x: lax.scan(lambda c, y: (c, shifted("compensated")(*y)), 0, x)[1],
}


@pytest.mark.parametrize("name", slow_but(["shift", "faithful shift", "double word sum", "gradient"], list(CASES)))
def test_where_sums_may_be_rearranged_results_are_nan(name):
    """Not finite but wrong: with the option the error of every sum is 0 to the compiler."""
    function = CASES[name]
    with jax.enable_x64(True):
        found = jax.tree.leaves(jax.jit(function, compiler_options=REARRANGED)(*cancelling()))
        right = jax.tree.leaves(jax.jit(function)(*cancelling()))
    assert all(np.isnan(x).all() for x in found) and all(np.isfinite(x).all() for x in right)


def test_what_needs_no_errors_of_sums_stays_within_its_bound_there():
    """float32 is computed in float64; "fast" and "reproducible" round as they do."""
    tau, f, p = cancelling()
    narrow = [x.astype(np.float32) for x in (tau, f, p)]
    exact = rationals(narrow[0]) - np.cross(*map(rationals, (narrow[2], narrow[1])))
    with jax.enable_x64(True):
        found = rationals(jax.jit(shifted("compensated"), compiler_options=REARRANGED)(*narrow))
    assert (abs(found - exact) <= abs(exact) * 2**-23).all()


def test_a_proof_is_one_number_of_a_batch():
    """No operation more over the batch than a barrier has."""
    x = jax.ShapeDtypeStruct((1000,), np.float32)

    def over_the_batch(function):
        return jax.jit(function).lower(x).as_text().count("tensor<1000x")

    assert over_the_batch(barrier_or_nan) == over_the_batch(barrier)


def test_products_in_a_batch_that_is_reversed_beside_one_constant():
    """Both products of a guard by contraction were merged here, and 40 of 60 errors were 0."""
    x = np.random.default_rng(0).standard_normal((20, 3))
    with jax.enable_x64(True):
        p, e = jax.jit(lambda x: transforms.two_product(jnp.full_like(x, 0.7), x[:, ::-1]))(x)
    assert (rationals(p) + rationals(e) == rationals(0.7) * rationals(x[:, ::-1])).all() and np.any(e)


def test_the_same_numbers_multiplied_by_the_caller():
    """The product of a guard by contraction was taken for the caller's here, and all low words were 0."""
    f, w, c = numbers(3)

    def found(f, w, c):
        zero = jnp.zeros_like(f)
        F, V = (js.SpatialForce(*[jnp.stack([x, zero, zero], -1)] * 2) for x in (f, w))
        y = js.dot(F, js.SpatialVelocity(V.tau, jnp.zeros_like(V.f)), precision="compensated")
        z = js.to_double_word(w * f) * c
        return y * c, z.hi, z.lo

    with jax.enable_x64(True):
        _, hi, lo = jax.jit(found)(f, w, c)
    assert (rationals(hi) + rationals(lo) == rationals(w * f) * rationals(c)).all() and np.any(lo)
