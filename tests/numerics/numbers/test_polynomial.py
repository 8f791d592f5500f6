"""Polynomials over the components of arrays: their values are those of the numbers that they stand for."""

import itertools
import operator
from fractions import Fraction

import numpy as np
import pytest

from jaxspatial.numerics.numbers.polynomial import Polynomial, Quotient, symbols
from jaxspatial.numerics.numbers.rounded import uniform

DATA = np.array([3.0, 0.0, 1.0, -1.0, 5.0])  # as NumPy: 0, 1 and -1 among them are known
NUMBERS = [Fraction(float(x)) for x in DATA]


def components():
    """Those of a batch of one: 3 and 5 are no units, but they are uniform; terms say what they are."""
    return symbols([DATA[None]], (0,))


def value(p):
    """What a polynomial is for these numbers."""
    return sum(
        (t.sign * np.prod([NUMBERS[k] for _, k in t.factors], initial=Fraction(1)) for t in p.terms), Fraction(0)
    )


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul])
def test_sums_and_products_are_those_of_the_numbers(operation):
    for (p, x), (q, y) in itertools.product(zip(components(), NUMBERS, strict=True), repeat=2):
        assert value(operation(p, q)) == operation(x, y)
        assert value(operation(-p, q)) == operation(-x, y)


def test_units_are_known_and_leave_no_factor():
    three, zero, one, minus, five = components()
    assert [p.unit for p in (three, zero, one, minus, -one, -minus)] == [None, None, 1, -1, -1, 1]
    assert not zero.terms and not (zero * three).terms and (zero + three) == three
    assert one * three == three * one == -minus * three == three and minus * three == -three
    assert three / one == three and isinstance(three / five, Quotient)


def test_the_only_constant_is_zero():
    three, *_ = components()
    assert three._constant(0) == Polynomial()
    with pytest.raises(TypeError, match="no constant but 0, got 2"):
        three._constant(2)


def test_halves():
    """In whole terms, and the power of two that is left."""
    three, *_, five = components()
    p = (three + five).halved() - five
    terms, share = p.of_whole_terms()
    assert value(p) == Fraction(3 + 5, 2) - 5 == value(Polynomial(terms)) * Fraction(share)
    assert {t.sign for t in terms} == {1, -1} and share == 0.5


def test_uniform_columns():
    assert uniform(np.array([2.0])) == uniform(np.array([[2.0, 2.0]])) == 2
    assert uniform(np.array([2.0, 3.0])) is None and uniform(np.array([2.0, 2.0, 3.0])) is None
    assert uniform(np.zeros(0)) is None
