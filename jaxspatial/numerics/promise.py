"""Error bounds as records, stated once: docstrings, `measure`, the tests and the tables of the pages read them.

    @promises(bound=Promise(3, 4))
    def shift(...):
        \"\"\"...

        Error: per component at most 3 u mag in "fast" and "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of
            r in "faithful", while nothing over- or underflows.
        \"\"\"

`shift.promises["bound"]` is the record. A test holds the docstring to it, and writes it there; see the page on
contributing. A precision that promises anything else than those there are is a line in each method of a record.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple, TypeVar

from jaxspatial.numerics.precision import Precision

_Function = TypeVar("_Function", bound=Callable)

# A quotient is promised where its denominator is at least so many units of roundoff of its own mag.
SMALLEST = 24
TERMS = "the sum of the absolute values of its terms, multiplied out"


class Promise(NamedTuple):
    """The largest error of a number whose exact value is r. A number without any of these factors is exact.

        fast, reproducible   u u mag + u_of_result u |r| c
        compensated          u |r| + u2 u^2 mag + u2_of_result u^2 |r| c
        faithful             1 ulp of r + u3 u^3 mag

    u stands for the unit roundoff of the inputs' dtype behind each factor, mag for what its field says, c for the
    condition of the denominator that r was divided by.
    """

    u: float = 0
    u2: float = 0
    u_of_result: float = 0
    u2_of_result: float = 0
    u3: float = 0
    mag: str = TERMS

    @property
    def is_exact(self) -> bool:
        return not any(self[:-1])

    def allowed(self, precision: Precision | str, roundoff, ulp, r, mag, condition=1):
        """The bound for numbers r of any kind, as of exact rationals. ulp: the unit in the last place of r."""
        if self.is_exact:
            return 0 * mag
        # Factors as the kind of number that the unit roundoff is of.
        precision, number = Precision(precision), type(roundoff)
        if precision.is_within_an_ulp:
            return ulp + number(self.u3) * roundoff**3 * mag
        if precision.sees_whole_sums:
            twice, of_result = (number(x) * roundoff**2 for x in (self.u2, self.u2_of_result))
            return roundoff * abs(r) + twice * mag + of_result * abs(r) * condition
        once, of_result = (number(x) * roundoff for x in (self.u, self.u_of_result))
        return once * mag + of_result * abs(r) * condition

    def words(self, precision: Precision | str) -> str:
        """The bound in a table."""
        precision = Precision(precision)
        if precision.is_within_an_ulp:
            return "1 ulp"
        return f"u |r| + {self.u2:g} u² mag" if precision.sees_whole_sums else f"{self.u:g} u mag"

    @property
    def plain(self) -> str:
        """The bound in "fast" and "reproducible"."""
        return f"{self.u:g} u mag" + (f" + {self.u_of_result:g} u |r| c" if self.u_of_result else "")

    @property
    def precise(self) -> str:
        """The bound in "compensated"."""
        return f"u |r| + {self.u2:g} u^2 mag" + (f" + {self.u2_of_result:g} u^2 |r| c" if self.u2_of_result else "")

    def __str__(self) -> str:
        bounds = f'at most {self.plain} in "fast" and "reproducible", {self.precise} in "compensated"'
        return f'{bounds}, 1 ulp of r in "faithful"'

    def is_given(self, precision: Precision | str, roundoff, condition):
        """Where anything is promised: not of a quotient whose denominator is little more than its rounding errors."""
        precision = Precision(precision)
        if not self.u_of_result or precision.is_within_an_ulp:
            return condition == condition
        smallest = SMALLEST * (roundoff**2 if precision.sees_whole_sums else roundoff)
        return condition * smallest <= 1


class Normwise(NamedTuple):
    """The largest error of a result whose exact value is r, in its norm, or of the largest of its numbers:

        fast, reproducible       u u size
        compensated, faithful    rounded u |r| + u2 u^2 size

    u stands for the unit roundoff behind each factor; size is what `per` and `of` say.
    """

    u: float
    of: str = "normwise"
    per: str = ""
    rounded: float = 1.01
    u2: float = 0

    def allowed(self, precision: Precision | str, roundoff, size, r=None):
        """r: the norm of the exact result, None where it is the size."""
        if not Precision(precision).sees_whole_sums:
            return self.u * roundoff * size
        return self.rounded * roundoff * (size if r is None else r) + self.u2 * roundoff**2 * size

    @property
    def plain(self) -> str:
        """The bound in "fast" and "reproducible"."""
        return " ".join(x for x in ("" if self.u == 1 else f"{self.u:g}", self.per, "u", self.of) if x)

    @property
    def precise(self) -> str:
        """The bound in "compensated" and "faithful"."""
        once = f"{self.rounded:g} u |r|" if self.rounded else ""
        twice = " ".join(x for x in (f"{self.u2:g}", self.per, "u^2", self.of) if x) if self.u2 else ""
        return " + ".join(x for x in (once, twice) if x)

    def __str__(self) -> str:
        return f'at most {self.plain} in "fast" and "reproducible", {self.precise} in the other two'


class OfSum(NamedTuple):
    """The bound of a sum of n items, added in L = ceil(log2 n) rounds of pairs: (each + rounds L) u of.

    In "compensated" and "faithful" one rounding, and u2 u^2 in place of u.
    """

    each: int = 0
    rounds: int = 1
    of: str = "mag"
    u2: float = 0

    def factor(self, n: int):
        return self.each + self.rounds * math.ceil(math.log2(n))

    @property
    def plain(self) -> str:
        """The bound in "fast" and "reproducible"."""
        rounds = "L" if self.rounds == 1 else f"{self.rounds} L"
        return f"({self.each} + {rounds}) u {self.of}" if self.each else f"{rounds} u {self.of}"

    @property
    def precise(self) -> str:
        """The bound in "compensated" and "faithful"."""
        rounds = "L" if self.rounds == 1 else f"{self.rounds} L"
        return f"u |r| + {self.u2:g} {f'({self.each} + {rounds})' if self.each else rounds} u^2 {self.of}"

    def __str__(self) -> str:
        return f'at most {self.plain} in "fast" and "reproducible", {self.precise} in the other two'


EXACT = Promise()
# Of sums, products, quotients and roots of double words, in u^2 of the result; cubes of u are left out.
DOUBLE_WORDS = {"+": Fraction(3), "*": Fraction(5), "/": Fraction(15), "sqrt": Fraction(25, 8)}


def promises(**bounds: Promise | Normwise | OfSum) -> Callable[[_Function], _Function]:
    """Decorator that attaches records to a function, as its attribute `promises`."""

    def attach(function: _Function) -> _Function:
        target: Any = getattr(function, "__func__", function)
        target.promises = bounds
        return function

    return attach
