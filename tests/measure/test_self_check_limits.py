"""The limits that the self-check compares with: what is just within a promise holds, what is just beyond is seen."""

from fractions import Fraction

import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from jaxspatial.measure import checks, error, inputs
from jaxspatial.measure.operation import OPERATIONS
from tests.helpers.marks import slow

U = Fraction(1, 2**24)
BOUNDED = pytest.mark.parametrize("precision", [js.Precision.COMPENSATED, js.Precision.FAITHFUL])


@BOUNDED
@pytest.mark.parametrize("part", ["_values_over", "_derivatives_over"])
@pytest.mark.parametrize("dtype", checks.DTYPES)
def test_an_error_may_be_what_is_promised_and_no_more(precision, part, dtype, monkeypatch):
    for worst in (1.0, 1.001, np.inf):
        monkeypatch.setattr(checks, "_values_over", lambda p, d: 0.5)
        monkeypatch.setattr(checks, "_derivatives_over", lambda p, d: 0.5)
        monkeypatch.setattr(checks, part, lambda p, d, worst=worst: worst if d == dtype else 0.5)
        holds, measured, advice = checks.bounds(precision)
        assert holds is (worst <= 1) and f"{worst:.2g} ({dtype})" in measured and bool(advice) is (worst > 1)


def last_bit_off(function):
    """The operation, each of its results one number too large."""
    return lambda *x: tuple(jnp.nextafter(y, jnp.full_like(y, jnp.inf)) for y in function(*x))


@BOUNDED
@pytest.mark.parametrize("name", ["shift_force", slow("dot")])
def test_a_wrong_last_bit_is_seen(name, precision):
    """In a batch, in a loop, one by one; results off by one number are off by more than half a unit in the last place,
    and by more than one somewhere."""
    right = OPERATIONS[name]
    wrong = right._replace(function=last_bit_off(right.function))
    arrays = inputs.benign(np.random.default_rng(0), len(right.arguments), 64, np.dtype("float32"))
    assert checks._over_promise(right, precision, arrays) <= 1 < checks._over_promise(wrong, precision, arrays)


def of_derivatives(precision, computed, value):
    """The error over the bound promised of a derivative with one exact value, and terms of size 1."""
    value, mag = (np.array([x], object) for x in (Fraction(value), Fraction(1)))
    return checks._over(precision, np.array([computed], np.float32), value, mag)


def test_derivatives_are_held_to_their_bound():
    """u |r| + 16 u^2 mag in compensated, 6 u mag in reproducible, 1 ulp of r in faithful."""
    u = 2.0**-24
    assert of_derivatives("compensated", 16 * u**2, 0) == pytest.approx(1)
    assert of_derivatives("compensated", 1 + 2 * u, 1) == pytest.approx(2)
    assert of_derivatives("reproducible", 6 * u, 0) == pytest.approx(1)
    assert of_derivatives("faithful", 1 + 2 * u, 1) == pytest.approx(1)


def test_double_words_are_held_to_their_promises(monkeypatch):
    """3 u^2 of a sum, 5 of a product, 15 of a quotient."""
    for worst, expected in (((3, 5, 15), True), ((3.1, 0, 0), False), ((0, 5.1, 0), False), ((0, 0, 15.1), False)):
        errors = iter(worst)
        monkeypatch.setattr(checks, "_over_square", lambda *_, errors=errors: next(errors))
        holds, _, advice = checks.double_words()
        assert holds is expected and bool(advice) is not expected


def test_errors_of_double_words_are_in_units_of_the_square():
    x = js.DoubleWord(np.ones(2, np.float32), np.array([5 * 2.0**-48, -2 * 2.0**-48], np.float32))
    assert checks._over_square(x, np.array([Fraction(1)] * 2), U) == 5


@pytest.mark.parametrize("wrong", ["sum", "error"])
def test_transforms_that_are_not_exact_are_seen(wrong):
    def two_sum(a, b):
        s = a + b
        return (s, jnp.zeros_like(s)) if wrong == "error" else (s + s, s - s)

    holds, measured, _ = checks.error_free(two_sum, lambda a, b: a + b, constants=True)
    assert holds is False and "broken" in measured


def test_transforms_that_are_wrong_beside_constants_only_are_seen():
    a = np.array([0.1, 0.3], np.float32)
    inexact = checks._wrong_with_constants(lambda a, b: (a + b, (a + b) * 0), lambda a, b: a + b, a)
    assert all(share > 0 for share in inexact)


def test_a_quotient_that_is_not_rounded_correctly_is_seen(monkeypatch):
    monkeypatch.setattr(checks, "quotient", lambda a, b: a * lax.div(jnp.ones_like(b), b))
    holds, measured, _ = checks.division()
    assert holds is False and "broken" in measured


def test_a_reproducible_result_that_is_not_that_of_numpy_is_seen(monkeypatch):
    wrong = OPERATIONS["dot"]._replace(function=last_bit_off(OPERATIONS["dot"].function))
    monkeypatch.setitem(OPERATIONS, "dot", wrong)
    assert checks.reproducible_bits()[0] is False


@pytest.mark.parametrize(("beyond", "noted"), [(58, "full precision"), (66, "cut to fewer digits")])
def test_a_matrix_product_is_full_up_to_one_u_per_term(beyond, noted, monkeypatch):
    """A sum of 64 products may be off by 64 u of their sizes."""

    def off(a, b):
        product, mag = a @ b, jnp.abs(a) @ jnp.abs(b)
        return product + jnp.float32(beyond * 2.0**-24) * mag

    monkeypatch.setattr(jnp, "matmul", off)
    holds, measured, _ = checks.matmul()
    assert holds is None and noted in measured


def test_one_broken_result_is_enough():
    assert checks.verdict({"float32": 0.0, "float64": 0.0}, "exact") == (True, "exact", "")
    holds, measured, advice = checks.verdict({"float32": 0.0, "float64": 1e-3}, "exact")
    assert holds is False and "float64" in measured and advice


def test_shares_count_bits_but_those_of_a_nan():
    found, expected = np.array([1.0, -0.0, np.nan, 2.0, np.nan]), np.array([1.0, 0.0, np.nan, 2.5, 1.0])
    assert checks.differing([found], [expected]) == 3 / 5


def test_what_is_not_finite_counts_as_zero():
    assert error.rationals(checks.finite([np.inf, 1.0])).tolist() == [0, 1]
