"""A formula run over symbols, and what it asks for evaluated as sums of products: values, double words, quotients."""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.numerics import floats, linear
from jaxspatial.numerics.errorfree.barrier import quotient, widened
from jaxspatial.numerics.linear import Summed
from jaxspatial.numerics.numbers import components
from jaxspatial.numerics.numbers.components import Components
from jaxspatial.numerics.numbers.double_word import DoubleWord, from_double_word
from jaxspatial.numerics.numbers.polynomial import Polynomial, Quotient, Term, symbols
from jaxspatial.numerics.numbers.rounded import is_known, quietly
from jaxspatial.numerics.precision import Precision
from jaxspatial.numerics.sums.evaluation import Plan, Sum
from jaxspatial.numerics.sums.primitive import bind_nonzero


def run_symbolically(formula: Callable, precision: Precision, arrays: Sequence):
    """The results of formula(vectors) over polynomials, in a precision that looks at whole sums.

    An array that is passed on as it came is a sum of one term, so that all its cotangents are added in one sum. Numbers
    known while tracing stay that.
    """
    are_components = any(isinstance(a, Components) for a in arrays)
    arrays = tuple(map(components.as_components, arrays)) if are_components else arrays
    data = _Data(np.dtype(arrays[0].dtype))
    vectors = [linear.by_size(data.vector(a)) for a in arrays]
    batch = floats.broadcast_shapes(*(a.shape[:-1] for a in arrays))
    plan = Plan((), batch, str(precision), is_pair=any(map(components.has_pairs, arrays)))
    passed = {id(s): a for s, a in zip(vectors, arrays, strict=True) if plan.is_pair or isinstance(a, floats.NUMPY)}
    results = formula(vectors)
    several: list = results if isinstance(results, list) else [results]
    evaluated = _evaluated_unstacked if are_components else _evaluated
    computed = iter(evaluated(plan, data, [x for x in several if id(x) not in passed]))
    values = [floats.broadcast_batch(batch, passed[id(x)])[0] if id(x) in passed else next(computed) for x in several]
    return values if isinstance(results, list) else values[0]


class _Data:
    """The arrays that the symbols of a formula stand for, and the numbers of those that are constants."""

    def __init__(self, dtype: np.dtype):
        self.dtype = dtype
        self.arrays: list = []
        self.constants: dict[int, Any] = {}

    def vector(self, a):
        """A tuple of polynomials."""
        if isinstance(a, Components):
            return tuple(map(self._component, a.components))
        return symbols(self.arrays, self._placed(jax.tree.leaves(a)))

    def _component(self, c) -> Polynomial:
        """Each on its own is an array with one component; a known 0 is none."""
        if is_known(c, 0):
            return Polynomial()
        places = self._placed([limb[..., None] for limb in jax.tree.leaves(c)])
        if is_known(c):
            self.constants[places[0]] = c
        return Polynomial(tuple(Term(1, ((j, 0),)) for j in places), int(c) if is_known(c, 1, -1) else None)

    def _placed(self, limbs: Sequence) -> range:
        self.arrays += limbs
        return range(len(self.arrays) - len(limbs), len(self.arrays))

    def constant(self, factor: tuple[int, int]) -> Fraction:
        """The number of a factor; raises _IsData where there is none."""
        number = self.constants.get(factor[0])
        if number is None or not np.isfinite(number):
            raise _IsData
        return Fraction(float(number))


def _evaluated(plan: Plan, data: _Data, results: Sequence) -> list:
    """What a formula returned, as arrays or double words; everything that is not a quotient in one plan."""
    # With axes of size 1 in front: what is shared by a batch stays one item, whose cotangents are summed once.
    arrays = [jnp.reshape(x, (1,) * (len(plan.batch) + 1 - x.ndim) + x.shape) for x in data.arrays]
    are_quotients = [isinstance(_components(x)[0], Quotient) for x in results]
    plain = iter(_bound(plan, arrays, [x for x, yes in zip(results, are_quotients, strict=True) if not yes]))
    divided = iter([_divided(plan, arrays, x) for x, yes in zip(results, are_quotients, strict=True) if yes])
    return [next(divided if yes else plain) for yes in are_quotients]


def _components(x) -> Sequence:
    if isinstance(x, Summed):
        return x.vector
    return (x,) if _is_number(x) else x.entries if isinstance(x, linear.Matrix) else x


def _is_number(x) -> bool:
    return isinstance(x, (Polynomial, Quotient))


# -- unstacked components ----------------------------------------------------------------------------------------------


def _evaluated_unstacked(plan: Plan, data: _Data, results: Sequence) -> list:
    """As `_evaluated`, with each component of a result on its own, and known where all its terms are constants."""
    known = [[_known(data, x, c) for c in _components(x)] for x in results]
    wanted = [
        Summed((c,)) if isinstance(x, Summed) else (c,)
        for x, numbers in zip(results, known, strict=True)
        for c, number in zip(_components(x), numbers, strict=True)
        if number is None
    ]
    computed = (x[..., 0] for x in (_evaluated(plan, data, wanted) if wanted else ()))
    found: list = []
    for x, numbers in zip(results, known, strict=True):
        parts = [next(computed) if number is None else number for number in numbers]
        number = jnp.broadcast_to(parts[0], plan.batch) if is_known(parts[0]) else parts[0]
        found.append(number if _is_number(x) else components.of(parts))
    return found


def _known(data: _Data, x, c):
    """The number that a component is, its exact value rounded once; None for data."""
    try:
        value = _value(data, c)
        is_data = value and isinstance(x, Summed)
        return None if is_data else quietly(lambda t, number: t.type(number), data.dtype, float(value))
    except (_IsData, ZeroDivisionError, OverflowError):
        return None


class _IsData(Exception):
    """A term has a factor that is not known."""


def _value(data: _Data, c: Polynomial | Quotient) -> Fraction:
    """The exact value of what consists of constants, 0 by whatever is 0 as in `rounded`; raises _IsData for others."""
    if isinstance(c, Quotient):
        return _value(data, c.dividend) / _value(data, c.divisor) if c.dividend.terms else Fraction()
    return Fraction(sum(t.sign * math.prod(map(data.constant, t.factors)) for t in c.terms))


# -- evaluation --------------------------------------------------------------------------------------------------------


def _divided(plan: Plan, arrays: Sequence, x):
    """Numerators and the one denominator, divided, and rounded once."""
    parts = [tuple(q.dividend for q in _components(x)), (_components(x)[0].divisor,)]
    dtype = arrays[0].dtype
    if plan.is_pair or dtype == np.float64:
        above, below = _bound(plan._replace(is_pair=True), arrays, parts)
        divided = above / below if plan.is_pair else from_double_word(above / below)
    else:
        with jax.enable_x64(True):
            above, below = _bound(plan, list(map(widened, arrays)), parts)
            divided = lax.convert_element_type(quotient(above, jnp.broadcast_to(below, above.shape)), dtype)
    return divided[..., 0] if _is_number(x) else divided


def _bound(plan: Plan, arrays: Sequence, results: Sequence) -> list:
    """The results of a plan for polynomials: an array or double word each; zeros where there are no terms."""
    wanted = list[Sum]()
    for x in results:
        terms, shares = zip(*(p.of_whole_terms() for p in _components(x)), strict=True)
        reduced = (len(plan.batch) - 1,) if isinstance(x, Summed) else ()
        wanted.append(Sum(terms, reduced, () if set(shares) == {1} else shares))
    computed = iter(bind_nonzero(plan, wanted, arrays))
    return [_shaped(plan, x, s, next(computed), arrays[0].dtype) for x, s in zip(results, wanted, strict=True)]


def _shaped(plan: Plan, x, s: Sum, result, dtype: np.dtype):
    """Without the axes that a scalar, or a sum over items, does not have."""
    if result is None:
        result = [floats.numpy_for(plan.batch).zeros(plan.shape(s), dtype)] * (1 + plan.is_pair)
    if s.reduced:
        result = [a[..., 0, :] for a in result]
    if _is_number(x):
        result = [a[..., 0] for a in result]
    return DoubleWord(*result) if plan.is_pair else result[0]
