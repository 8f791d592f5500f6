"""Numbers with corrections, against rational numbers: hostile operands, every surrounding.

Bounds are those of the docstrings of the operations.
"""

import functools
import math
import operator
from fractions import Fraction

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

from jaxspatial.measure.error import rationals
from jaxspatial.numerics import functions, linear, numbers
from jaxspatial.numerics.numbers import Corrected

N = 200


def operands(dtype, positive=False):
    """(value, correction) of two numbers each: corrections up to many u of the value, some larger than it or 0; values
    that cancel but for their corrections, and values that did."""
    rng, u = np.random.default_rng(0), float(np.finfo(dtype).eps) / 2
    a, b = rng.standard_normal((2, N)) * 2.0 ** rng.integers(-20, 20, (2, N))
    c, d = rng.standard_normal((2, N)) * u * 2.0 ** rng.integers(-3, 12, (2, N)) * (a, b)
    b[:50] = -a[:50] * (1 + 2 * u * rng.integers(-2, 3, 50))
    d[:25] = -c[:25] * (1 + 1e-3)
    c[50:60], d[60:70] = 0, 0
    # Where all digits of a value were lost.
    a[70:80], c[70:80] = -c[70:80] * (1 + 0.1 * rng.standard_normal(10)), a[70:80].copy()
    b[80:90], d[80:90] = 0, b[80:90].copy()
    if positive:
        a, c = abs(a), np.where(abs(c) > abs(a), abs(c), c)
    return [x.astype(dtype) for x in (a, c, b, d)]


def words(operation):
    return lambda a, c, b, d: operation(Corrected(a, c), Corrected(b, d)).limbs


def bound(name, a, c, b, d, u):
    """As the docstrings have it."""
    x, y = a + c, b + d
    return {
        "add": lambda: 3 * u * (abs(c) + abs(d) + u * abs(a + b)),
        "mul": lambda: abs(c * d) + 3 * u * (abs(a * d) + abs(b * c) + u * abs(a * b)),
        "truediv": lambda: 5 * u * (abs(c / y) + 2 * u * abs(a / y)),
        "sqrt": lambda: 5 * u**2 * abs(Fraction(math.isqrt(int(x * 2**400))) / 2**200),
    }[name]()


def exactly(operation, x, y):
    if operation is root:
        return Fraction(math.isqrt(int(x * 2**600))) / 2**300
    return operation(x, y)


def root(x, _):
    return x.sqrt()


SURROUNDINGS = {
    "eager": lambda f: f,
    "vmap": lambda f: jax.jit(jax.vmap(f)),
    "scan": lambda f: jax.jit(lambda *x: jax.lax.scan(lambda _, y: (None, f(*y)), None, x)[1]),
}


@pytest.mark.parametrize("operation", [operator.add, operator.mul, operator.truediv, root], ids=lambda f: f.__name__)
@pytest.mark.parametrize("surrounding", ["eager", "vmap", "scan"])
def test_bounds(surrounding, operation):
    arrays = operands(np.float64, positive=operation is root)
    with jax.enable_x64(True):
        found = SURROUNDINGS[surrounding](words(operation))(*map(jnp.asarray, arrays))
    check(operation, arrays, found, Fraction(1, 2**53))


@pytest.mark.parametrize("operation", [operator.add, operator.mul, operator.truediv], ids=lambda f: f.__name__)
def test_bounds_in_float32(operation):
    """Without types of 64 bits."""
    arrays = operands(np.float32)
    with jax.enable_x64(False):
        found = jax.jit(words(operation))(*map(jnp.asarray, arrays))
    assert found[0].dtype == np.float32
    check(operation, arrays, found, Fraction(1, 2**24))


def check(operation, arrays, found, u):
    name = {root: "sqrt"}.get(operation, operation.__name__)
    found = rationals(found[0]) + rationals(found[1])
    for ours, a, c, b, d in zip(found, *map(rationals, arrays), strict=True):
        limit = bound(name, a, c, b, d, u)
        assert abs(ours - exactly(operation, a + c, b + d)) <= limit, (name, float(a), float(c), float(b), float(d))


def test_the_value_is_that_of_plain_arithmetic():
    a, c, b, d = operands(np.float64)
    with jax.enable_x64(True):
        for operation in (operator.add, operator.sub, operator.mul):
            value, _ = jax.jit(words(operation))(a, c, b, d)
            np.testing.assert_array_equal(value, operation(a, b))


def test_sums_of_products_that_cancel():
    """As accurate as in twice the digits, whatever they cancel to, with constants of the program too."""
    rng, u = np.random.default_rng(1), 2.0**-53
    v, w = rng.standard_normal((2, 6, N))
    w[5] = -(v[:5] * w[:5]).sum(0) / v[5]

    def dot(v, w):
        return linear.dot([Corrected(x) for x in v], [Corrected(jnp.asarray(x)) for x in w])._rounded()

    exact = sum(rationals(x) * rationals(y) for x, y in zip(v, w, strict=True))
    mag = sum(abs(rationals(x) * rationals(y)) for x, y in zip(v, w, strict=True))
    with jax.enable_x64(True):
        for found in (jax.jit(dot)(v, w), jax.jit(lambda v: dot(v, w))(v)):
            error = abs(rationals(found) - exact)
            assert (error <= Fraction(u) * abs(exact) + 60 * Fraction(u) ** 2 * mag).all()


def test_what_is_known_leaves_no_operation():
    x = jax.ShapeDtypeStruct((3,), np.float32)

    def count(function):
        return len(jax.make_jaxpr(lambda x: function(Corrected(x)).limbs)(x).eqns)

    zero, one = (numbers.constant(Corrected(np.float32(0)), n) for n in (0, 1))
    assert count(lambda x: x + zero) == count(lambda x: x * one) == count(lambda x: zero * x) == 0
    assert count(lambda x: x * 0.25) == 1 and count(lambda x: -x) == 1
    third = numbers.constant(zero, Fraction(1, 3))
    assert abs(sum(map(Fraction, map(float, third.limbs))) - Fraction(1, 3)) < Fraction(1, 2**48)
    nine = numbers.constant(zero, 9)
    for x, y in ((third * nine, 3), (third + third, Fraction(2, 3)), (one / third, 3)):
        assert x.is_known and abs(sum(map(Fraction, map(float, x.limbs))) - y) < Fraction(1, 2**45)


def test_infinities_and_zeros_are_those_of_plain_arithmetic():
    special = np.array([0.0, -0.0, 1.0, -2.0, np.inf, -np.inf, np.nan, 1e300])
    a, b = (x.ravel() for x in np.meshgrid(special, special))
    with jax.enable_x64(True), np.errstate(all="ignore"):
        for operation in (operator.add, operator.sub, operator.mul, operator.truediv):
            found = jax.jit(lambda a, b, f=operation: f(Corrected(a), Corrected(b))._rounded())(a, b)
            np.testing.assert_array_equal(found, operation(a, b))
            np.testing.assert_array_equal(np.signbit(found)[found == 0], np.signbit(operation(a, b))[found == 0])
        found = jax.jit(lambda a: (Corrected(a) * 3.0).sqrt()._rounded())(special)
        np.testing.assert_array_equal(found, np.sqrt(special * 3.0))


def test_a_result_behind_an_infinity_is_that_of_plain_arithmetic():
    with jax.enable_x64(True):
        x = jnp.asarray([1e300, 3.0])
        found = jax.jit(lambda x: (1 / (Corrected(x) * Corrected(x)) + Corrected(x))._rounded())(x)
    np.testing.assert_array_equal(found, [1e300, 3.0 + 1 / 9])


def test_comparisons_are_of_both_words():
    one, tiny = np.array([1.0, 1.0, 1.0, -1.0]), np.array([0.0, 1e-20, -1e-20, 2.0])
    with jax.enable_x64(True):
        x = Corrected(jnp.asarray(one), jnp.asarray(tiny))
        assert (x > 1).tolist() == [False, True, False, False] and (x >= 1).tolist() == [True, True, False, True]
        assert (x < 1).tolist() == [False, False, True, False] and (x <= 1).tolist() == [True, False, True, True]
        assert abs(-x)._rounded().tolist() == [1.0] * 4
        chosen = numbers.where(x > 1, x, 0.5)
        assert chosen.value.tolist() == [0.5, 1.0, 0.5, 0.5] and chosen.correction.tolist() == [0, 1e-20, 0, 0]


def test_functions_have_twice_the_digits():
    x = np.random.default_rng(2).uniform(-1, 1, N) * np.repeat([1e-3, 1.0, 10.0, 1e4], N // 4)

    def of(function, x):
        found = function(Corrected(x))
        return [y.limbs for y in (found if isinstance(found, tuple) else (found,))]

    with jax.enable_x64(True), mp.workdps(60):
        positive = abs(x) + 0.1
        for function, exact, at in (
            (functions.cosine_sine, (mp.cos, mp.sin), x),
            (functions.exp, (mp.exp,), x / 1e3),
            (functions.log, (mp.log,), positive),
            (lambda x: linear.norm((x, x * 2.0)), (lambda x: abs(x) * mp.sqrt(5),), x),
        ):
            found = jax.jit(functools.partial(of, function))(at)
            for (high, low), f in zip(found, exact, strict=True):
                exactly = [f(mp.mpf(float(y))) for y in at]
                ours = [mp.mpf(float(p)) + mp.mpf(float(q)) for p, q in zip(high, low, strict=True)]
                errors = [abs(p - q) / max(abs(q), 1) for p, q in zip(ours, exactly, strict=True)]
                assert max(errors) <= 64 * mp.mpf(2) ** -106, float(max(errors) * mp.mpf(2) ** 106)


def test_derivatives_are_those_of_the_number():
    """Of value + correction: not of the value, of which all digits have cancelled."""

    def function(x, tiny):
        difference = (Corrected(x) + tiny) - Corrected(x)
        return (Corrected(x) / difference)._rounded()

    with jax.enable_x64(True):
        x, tiny = jnp.asarray([1.0, 3.0]), 1e-20
        rate = jax.jit(lambda x: jax.jvp(lambda x: function(x, tiny), (x,), (jnp.ones(2),))[1])(x)
        np.testing.assert_allclose(rate, np.full(2, 1 / tiny), rtol=1e-14)
        slope = jax.vmap(jax.grad(lambda x: (Corrected(x) * Corrected(x) / 3.0).sqrt()._rounded()))(x)
        np.testing.assert_allclose(slope, np.full(2, 3**-0.5), rtol=1e-15)
