"""The yardstick itself: exact references, and errors in ulps and in u mag."""

from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pytest

from jaxspatial.measure import error
from jaxspatial.measure.inputs import FAMILIES
from jaxspatial.measure.operation import OPERATIONS

DTYPES = ["float16", "bfloat16", "float32", "float64"]


@pytest.mark.parametrize("dtype", DTYPES)
def test_rationals_are_the_numbers(dtype):
    x = np.array([0.0, -0.5, 3.0, float(jnp.finfo(dtype).max), float(jnp.finfo(dtype).tiny)]).astype(jnp.dtype(dtype))
    assert [Fraction(float(v)) for v in x] == list(error.rationals(x))


@pytest.mark.parametrize("dtype", DTYPES)
def test_one_ulp_is_one_ulp(dtype):
    x = np.array([1.0, 1.5, -2.0, 1000.0]).astype(jnp.dtype(dtype))
    away = np.nextafter(x, x * 2)
    np.testing.assert_array_equal(error.in_ulps(away, error.rationals(x)), 1)


def test_ulps_agree_with_numpy_spacing():
    x = np.random.default_rng(0).standard_normal(100) * 10.0 ** np.arange(-50, 50)
    half = error.rationals(x) + error.rationals(np.spacing(abs(x))) / 2
    np.testing.assert_array_equal(error.in_ulps(x, half), 0.5)


def test_an_exact_zero_is_missed_in_smallest_units():
    tiny, eps = float(jnp.finfo(np.float32).tiny), float(jnp.finfo(np.float32).eps)
    assert error.in_ulps(np.float32([tiny]), np.array([Fraction(0)])) == 1 / eps


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_infinitely_far_off(bad):
    one = np.array([Fraction(1)])
    assert error.in_ulps(np.array([bad]), one) == np.inf and error.in_u_of(np.array([bad]), one, one) == np.inf


@pytest.mark.parametrize("dtype", DTYPES)
def test_ulps_of_exact_numbers(dtype):
    info = jnp.finfo(dtype)
    eps, tiny = Fraction(float(info.eps)), Fraction(float(info.tiny))
    below_two, zero = 2 - eps / 8, Fraction(0)
    units = error.ulp(np.array([Fraction(1), below_two, Fraction(-2), Fraction(1, 3), tiny / 2, zero]), dtype)
    assert list(units) == [eps, eps, 2 * eps, eps / 4, tiny * eps, tiny * eps]


@pytest.mark.parametrize("dtype", DTYPES)
def test_ulps_of_the_norm_are_those_of_the_largest_component(dtype):
    eps, value = float(jnp.finfo(dtype).eps), error.rationals([[1.0, -4.5, 0.0], [0.0, 0.0, 0.25]])
    computed = np.array([[1 + 2 * eps, -4.5, 6 * eps], [0, eps, 0.25]]).astype(jnp.dtype(dtype))
    assert list(error.in_ulps_of_norm(computed, value)) == [1.5, 4]
    assert error.in_ulps_of_norm(computed[0], value[0]) == 1.5


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_vector_with_one_component_not_finite_is_infinitely_far_off(bad):
    value = error.rationals(np.ones((2, 3)))
    assert list(error.in_ulps_of_norm(np.array([[1, bad, 1], [1, 1, 1]]), value)) == [np.inf, 0]


def test_agreement_when_not_finite():
    nan, inf = np.nan, np.inf
    expected = np.array([nan, nan, nan, inf, inf, inf, -inf, 1, 1, 1])
    computed = np.float32([nan, inf, 1, inf, -inf, 1, -inf, 2, nan, inf])
    agrees = [True, False, False, True, False, False, True, True, False, False]
    assert list(error.agrees_when_not_finite(computed, expected)) == agrees


def test_units_of_magnitude():
    computed, value, magnitude = np.array([1 + 2**-52]), np.array([Fraction(1)]), np.array([Fraction(4)])
    assert error.in_u_of(computed, value, magnitude) == 0.5
    zero = np.array([Fraction(0)])
    assert error.in_u_of(np.array([0.0]), zero, zero) == 0
    assert error.in_u_of(np.array([1e-300]), zero, zero) == np.inf


def test_flushed_subnormals_are_forgiven():
    tiny = float(jnp.finfo(np.float32).tiny)
    one = np.array([Fraction(tiny)])
    assert error.in_u_of(np.float32([0]), one, one, flushed=1) == 0
    assert error.in_u_of(np.float32([0]), 2 * one, one, flushed=1) == 2**24


def test_exact_formulas_are_the_definitions_on_integers():
    tau, f, p, w = np.array([[0.0, 0, 3], [1, 2, 0], [2, -2, 1], [0, 0, 3]])
    for name, arrays, expected in (
        ("shift_force", (tau, f, p), [2, -1, -3]),
        ("shift_velocity", (tau, f, [2, -2, 0]), [7, 8, 0]),
        ("shift_acceleration", (0 * tau, 0 * f, [1, 1, 0], w), [-9, -9, 0]),
        ("dot", ([[4, 1, -3]], [[11, 9, -2]], [[1, 2, 3]], [[-2, -5, 8]]), [-86]),
    ):
        ((value, _),) = OPERATIONS[name].exactly(*arrays)
        assert value.tolist() == expected


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("family", FAMILIES)
def test_families_are_finite_and_of_the_dtype(family, dtype):
    for x in FAMILIES[family](np.random.default_rng(0), 3, 20, jnp.dtype(dtype)):
        assert x.shape == (20, 3) and x.dtype == jnp.dtype(dtype) and np.isfinite(x.astype(float)).all()


@pytest.mark.parametrize("dtype", DTYPES)
def test_parallel_vectors_are(dtype):
    value, mag = error.evaluate(np.cross, *FAMILIES["parallel"](np.random.default_rng(0), 2, 20, jnp.dtype(dtype)))
    assert not value.any() and mag.all()


def test_sized_numbers_add_up_their_terms():
    value, mag = error.evaluate(lambda a, b: a * b - a * b + -b, np.array([2.0]), np.array([-3.0]))
    assert value == 3 and mag == 15
    (quotient,) = error.sized([6.0]) / (error.sized([3.0]) - error.sized([1.0]))
    assert (quotient.value, quotient.mag, quotient.condition) == (3, 3, 2)
