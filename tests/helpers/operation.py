"""What tests know of an operation, and whether a result keeps its bound."""

import functools
from collections.abc import Callable
from fractions import Fraction
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.measure import error
from jaxspatial.measure.error import attribute, rationals, sized
from jaxspatial.numerics.promise import EXACT
from tests.helpers.arguments import KINDS
from tests.helpers.interpreted import interpreted, over


class Operation(NamedTuple):
    """One line of the table: which arguments it takes, and what it does with one item (and so, broadcast, a batch)."""

    name: str
    arguments: str
    function: Callable
    # Over the arrays that the arguments consist of, see `formulas`. None: what takes roots, angles or decisions.
    formula: Any = None
    # Per array of the result, of what is a `Promise`: sums of products, and quotients of two.
    bounds: tuple | None = None
    # Else of numbers that are rounded once each: in "faithful" the promise is that of "compensated".
    is_of_sums: bool = True
    # The operation that runs the same formula, of other types: what is told of that one need not be told again.
    twin: str | None = None
    takes_precision: bool = True
    differentiable: bool = True
    # A result of many terms of many factors, which takes long to compile in precision "faithful".
    is_long: bool = False
    # Evaluated as a whole in the wider format, if in one, and rounded once; else results of one formula enter another.
    is_one_formula: bool = True
    # What comes is True for the items with even numbers, False for the others.
    is_mask: bool = False

    @property
    def kinds(self):
        return [KINDS[argument] for argument in self.arguments.split()]

    @property
    def shapes(self):
        """Of one item, the shapes of the arrays that the arguments consist of."""
        return [shape for kind in self.kinds for shape in kind.shapes]

    @property
    def places(self):
        """For each of the arrays, which argument it belongs to."""
        return [i for i, kind in enumerate(self.kinds) for _ in kind.shapes]

    def build(self, arrays):
        """The arguments that consist of these arrays."""
        remaining = iter(arrays)
        return tuple(kind.make(*(next(remaining) for _ in kind.shapes)) for kind in self.kinds)

    def arrays(self, batch_shape, dtype, seed=0):
        """Random arrays that the arguments consist of, as NumPy arrays."""
        rng = np.random.default_rng(seed)
        drawn = [x for kind in self.kinds for x in kind.draw(rng, batch_shape)]
        return [np.asarray(x).astype(jnp.dtype(dtype)) for x in drawn]

    def inputs(self, batch_shape, dtype, seed=0):
        """Random arguments as a tuple of trees of NumPy arrays."""
        return self.build(self.arrays(batch_shape, dtype, seed))

    def on_arrays(self, precision=None):
        """The operation as a function of arrays that gives a list of arrays."""
        given = {"precision": precision} if precision and self.takes_precision else {}
        return lambda *arrays: jax.tree.leaves(self.function(*self.build(arrays), **given))

    def op_by_op(self, *arrays, precision=None):
        """What the operation gives where nothing is compiled, 64-bit types on where something needs them."""
        with jax.enable_x64(arrays[0].dtype == np.float64 or bool(precision)):
            return interpreted(self.on_arrays(precision))(*arrays)

    def naive(self, *inputs):
        """The arrays of the result to the bit, in "reproducible": of the formula in NumPy, else op by op."""
        arrays = jax.tree.leaves(inputs)
        if not self.formula:
            return self.op_by_op(*arrays)
        if getattr(arrays[0], "dtype", None) != jnp.bfloat16:
            return [np.asarray(x) for x in self.formula(*arrays)]
        # Evaluated in float32, and rounded once.
        wide = [np.asarray(x) for x in self.formula(*(np.asarray(x).astype(np.float32) for x in arrays))]
        return [x if x.dtype == bool else x.astype(jnp.bfloat16) for x in wide]

    def sized(self, *inputs):
        """The result of the formula, or else of what is computed number by number, exactly: arrays of `Sized`."""
        return self.over([sized(x) for x in jax.tree.leaves(inputs)])

    def over(self, numbers):
        """The arrays of the result over arrays of numbers that know + - * /, of a batch with one axis."""
        if self.formula:
            return [np.asarray(x) for x in self.formula(*numbers)]
        return over(_traced(self, len(numbers[0])), numbers)


@functools.cache
def _traced(operation, n):
    return jax.make_jaxpr(operation.on_arrays("reproducible"))(*operation.arrays((n,), "float32"))


def violations(bound, precision, computed, exact, flushed=0):
    """The places of a computed array where the bound is broken, as a mask; `flushed`: so many finfo.tiny are forgiven.

    Where the exact value is below the smallest normal number, that number is forgiven: it may be flushed to zero.
    Where it is above the largest, nothing is promised here.
    """
    computed = np.asarray(computed)
    tiny, largest = (Fraction(float(getattr(jnp.finfo(computed.dtype), name))) for name in ("tiny", "max"))
    value, mag, condition = (attribute(exact, name) for name in ("value", "mag", "condition"))
    allowed = error.allowed(bound, precision, value, mag, computed.dtype, condition) + flushed * tiny
    allowed = allowed + tiny * ((value != 0) & (abs(value) < tiny)).astype(int) if bound != EXACT else allowed
    finite = np.isfinite(computed.astype(np.float64))
    wrong = abs(rationals(np.where(finite, computed, np.zeros_like(computed))) - value) > allowed
    in_range = (abs(value) <= largest).astype(bool)
    is_promised = bound.is_given(precision, error.unit_roundoff(computed.dtype), condition).astype(bool)
    return (~finite | wrong.astype(bool)) & in_range & is_promised
