"""Formulas as polynomials: which products of which components a result is the sum of.

A formula runs here over symbols instead of arrays, and what comes out is not a number but the list of its terms. What
is known while tracing is gone by then: a component that is 0 takes its terms with it, a factor of 1 is left out. How
the sums are evaluated is decided afterwards, for all precisions that look at a sum as a whole.
"""

import dataclasses
from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from jaxspatial.numerics import floats
from jaxspatial.numerics.numbers.rounded import uniform


class Term(NamedTuple):
    """sign times the product of factors; a factor (j, k) is component k of array j. Of what was halved the sign is 1/2
    or less; of the terms of a Sum always 1 or -1."""

    sign: int | Fraction
    factors: tuple[tuple[int, int], ...]


@dataclasses.dataclass(frozen=True)
class Polynomial:
    """One component of a formula. `unit`: its value where that is known to be 1 or -1."""

    terms: tuple[Term, ...] = ()
    unit: int | None = None

    def _constant(self, number: float) -> "Polynomial":
        """Of numbers that no array holds, zero alone has terms: none."""
        if number != 0:
            raise TypeError(f"a sum of products has no constant but 0, got {number}")
        return Polynomial()

    def __neg__(self) -> "Polynomial":
        return Polynomial(tuple(Term(-t.sign, t.factors) for t in self.terms), self.unit and -self.unit)

    def __add__(self, other: "Polynomial") -> "Polynomial":
        return Polynomial(self.terms + other.terms) if self.terms and other.terms else self if self.terms else other

    def __sub__(self, other: "Polynomial") -> "Polynomial":
        return self + -other

    def __mul__(self, other):
        if not isinstance(other, Polynomial):
            return NotImplemented
        for one, many in ((self, other), (other, self)):
            if one.unit:
                return many if one.unit == 1 else -many
        products = (Term(s.sign * t.sign, s.factors + t.factors) for s in self.terms for t in other.terms)
        return Polynomial(tuple(products))

    def halved(self) -> "Polynomial":
        """A half of it."""
        return Polynomial(tuple(t._replace(sign=Fraction(t.sign, 2)) for t in self.terms))

    def of_whole_terms(self) -> tuple[tuple[Term, ...], float]:
        """(terms of signs 1 and -1, the power of two by which their sum is to be multiplied)."""
        share = max((Fraction(t.sign).denominator for t in self.terms), default=1)
        repeated = (
            Term(1 if t.sign > 0 else -1, t.factors) for t in self.terms for _ in range(int(abs(t.sign) * share))
        )
        return tuple(repeated), 1 / share

    def __truediv__(self, other: "Polynomial"):
        return self * other if other.unit else Quotient(self, other)


class Quotient(NamedTuple):
    """One polynomial by another: what a formula may return, but not go on with."""

    dividend: Polynomial
    divisor: Polynomial


def symbols(arrays: Sequence, parts: Sequence[int]) -> tuple[Polynomial, ...]:
    """A vector of polynomials for the array that is the sum of arrays[j] for j in parts: one, or the two of a double
    word."""
    array, components = arrays[parts[0]], list[Polynomial]()
    for k in range(array.shape[-1]):
        value = uniform(array[..., k]) if len(parts) == 1 and isinstance(array, floats.NUMPY) else None
        terms = () if value == 0 else tuple(Term(1, ((j, k),)) for j in parts)
        components.append(Polynomial(terms, int(value) if value in (1, -1) else None))
    return tuple(components)
