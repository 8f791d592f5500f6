"""How many roundings a number of a result can have seen: what an error bound has to allow, whatever the inputs.

To first order, as bounds are stated: (1 + u)^k - 1 is k u. Of an operation that is traced, number by number, in
"reproducible"; and of the sums of products that it asks for in "compensated", in float64, where errors are added beside
(`numerics.sums.compensated`). A bound that says less is not proved, whatever the inputs it was tried on.
"""

import math
import unittest.mock
from typing import NamedTuple

import jax
import numpy as np

from jaxspatial.numerics.promise import DOUBLE_WORDS
from jaxspatial.numerics.sums.compensated import COMPENSATED
from jaxspatial.numerics.sums.evaluation import _Evaluation
from jaxspatial.numerics.sums.pairwise import of_neighbours
from tests.helpers import interpreted


class Roundings(NamedTuple):
    """The largest error of a number: so many u of its mag, so many u of itself for what it was divided by."""

    of_mag: float = 0
    of_result: float = 0

    @property
    def of_both(self):
        return self.of_mag + self.of_result


class Counted:
    """A number with its roundings; of one that is known, such as a factor of 2, products and sums may be exact."""

    def __init__(self, roundings=None, known=None):
        self.roundings, self.known = roundings or Roundings(), known

    def __neg__(self):
        return Counted(self.roundings, None if self.known is None else -self.known)

    def __add__(self, other):
        other = _number(other)
        if self.known == 0 or other.known == 0:
            return other if self.known == 0 else self
        if self is other:
            return Counted(self.roundings)
        return Counted(Roundings(1 + max(self.roundings.of_both, other.roundings.of_both)))

    def __sub__(self, other):
        return Counted(known=0) if self is other else self + -_number(other)

    def __mul__(self, other):
        other = _number(other)
        if self.known == 0 or other.known == 0:
            return Counted(known=0)
        for a, b in ((self, other), (other, self)):
            if _is_power_of_two(a.known):
                return Counted(b.roundings, None if b.known is None else a.known * b.known)
        return Counted(Roundings(1 + self.roundings.of_both + other.roundings.of_both))

    def __truediv__(self, other):
        other = _number(other)
        if self.known == 0 or _is_power_of_two(other.known):
            return self
        return Counted(Roundings(self.roundings.of_both, 1 + other.roundings.of_both))

    def __radd__(self, other):
        return self + other

    def __rsub__(self, other):
        return _number(other) - self

    def __rmul__(self, other):
        return self * other

    def __rtruediv__(self, other):
        return _number(other) / self


def _number(x):
    return x if isinstance(x, Counted) else Counted(known=float(x))


def _is_power_of_two(x):
    return x is not None and math.frexp(abs(x))[0] == 0.5


def plain(operation):
    """Of each array of the result the largest `Roundings` of a number, in "fast" and "reproducible"."""
    return _largest(operation.over(_numbers(operation.arrays((1,), "float32"))))


def _numbers(arrays):
    return [np.frompyfunc(lambda _: Counted(), 1, 1)(x) for x in arrays]


def _largest(arrays):
    return [max((_number(x).roundings for x in np.ravel(a)), key=lambda x: x.of_both) for a in arrays]


# -- sums in "compensated" --------------------------------------------------------------------------------------------


def twice(operation):
    """Of each array of the result the largest `Roundings` of a number in "compensated", in u^2; None of other formulas
    than sums of products and quotients of two, and of sums over many items."""
    arrays = operation.arrays((1,), "float64")
    with jax.enable_x64(True), unittest.mock.patch.dict(interpreted.OF_ARRAYS, _TWICE):
        try:
            closed = jax.make_jaxpr(operation.on_arrays("compensated"))(*arrays)
            return _largest(interpreted.over(closed, _numbers(arrays)))
        except (NotSums, TypeError):  # The latter of comparisons.
            return None


class NotSums(Exception):
    """Of a formula that is evaluated number by number, or a sum over items."""


def _sums(*arrays, plan):
    results = []
    for s in plan.sums:
        if s.reduced:
            raise NotSums
        wholes, rest = _separated(plan, s, arrays)
        numbers = [Counted(Roundings(_of_terms(terms, wholes)), None if terms or wholes else 0) for terms in rest]
        high = np.broadcast_to(np.array(numbers, object), plan.shape(s))
        # Of a pair the low part is what no rounding takes.
        results += [high, np.full(high.shape, Counted(known=0))] if plan.is_pair else [high]
    return results


def _separated(plan, s, arrays):
    """(how many arrays are terms as they stand, which are added last; the other terms of each component)."""
    evaluation = _Evaluation(plan, COMPENSATED, arrays)
    whole, rest = evaluation._separated(s)
    return len(whole), rest


def _of_terms(terms, n_wholes):
    """The largest share that a term has in the errors of the sum: so many u^2 of its size.

    Each term has its share of the error of its product; of the rounding of all sums of such errors it is in; of the
    rounding of all sums of errors of sums it is in; and of that of the sum of both.
    """
    share = [max(len(t.factors) - 2, 0) * len(t.factors) for t in terms] + [0] * n_wholes

    def added(a, b):
        """Of two sums of errors, each as the shares in u of all terms."""
        total = {i: a.get(i, 0) + b.get(i, 0) for i in {*a, *b}}
        for i, x in total.items():
            share[i] += x
        return total

    errors = []

    def summed(a, b):
        errors.append(dict.fromkeys({*a, *b}, 1))
        return a + b

    whole = of_neighbours(summed, [(i,) for i in range(len(terms))]) if terms else ()
    of_products = [{i: len(t.factors) - 1} for i, t in enumerate(terms) if len(t.factors) > 1]
    of_products = of_neighbours(added, of_products) if of_products else {}
    of_sums = of_neighbours(added, errors) if errors else {}
    for i in range(len(terms), len(share)):
        if whole:
            error = dict.fromkeys((*whole, i), 1)
            of_sums = added(of_sums, error) if of_sums else error
        whole += (i,)
    if of_products and of_sums:
        added(of_products, of_sums)
    return max(share, default=0)


def _quotient(*arrays, call_jaxpr, **_):
    if call_jaxpr.eqns[0].primitive.name != "jaxspatial_quotient":
        raise NotSums
    above, _, below, _ = arrays
    quotient = np.frompyfunc(_divided, 2, 1)(above, below)
    return [quotient, np.full(quotient.shape, Counted(known=0))]


def _divided(above, below):
    """Of two double words."""
    of_quotient = float(DOUBLE_WORDS["/"])
    return Counted(Roundings(above.roundings.of_both, of_quotient + below.roundings.of_both))


_TWICE = {"jaxspatial_sums": _sums, "custom_jvp_call": _quotient}
