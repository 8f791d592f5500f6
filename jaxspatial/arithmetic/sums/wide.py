"""Sums of products of narrow formats, in float64: products of two are exact, and nothing over- or underflows.

The state of a sum is one array. Verbs as in `compensated` and `faithful`.
"""

import functools
import operator

import jax.numpy as jnp
from jax import lax

from jaxspatial.arithmetic.sums.accumulators.compensated import padded as padded
from jaxspatial.arithmetic.sums.accumulators.compensated import times_power_of_two as times_power_of_two


def total(terms, _):
    """The sum of terms (sign, factors), factors arrays of float64. Error <= 2^-53 times their number, times mag."""
    return (functools.reduce(operator.add, (_signed(sign, functools.reduce(lax.mul, x)) for sign, x in terms)),)


def _signed(sign, x):
    return x if sign > 0 else -x


def plus(state, sign, x):
    """The state with one more term."""
    return (x + state[0] if sign > 0 else state[0] - x,)


def merge(a, b):
    """The state of the sum of two."""
    return (a[0] + b[0],)


def value(state, dtype):
    """Rounded to dtype."""
    return lax.convert_element_type(state[0], dtype)


def pair(state, dtype):
    """(hi, lo) of dtype with the sum of both as near as two of them get."""
    hi = value(state, dtype)
    low = state[0] - lax.convert_element_type(hi, state[0].dtype)
    return hi, lax.convert_element_type(lax.select(lax.is_finite(hi), low, jnp.zeros_like(low)), dtype)
