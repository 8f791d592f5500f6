"""Derivatives of operations on pairs of words and words: those of their sum hi + lo, accurate to a few u."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_derivatives import SymbolicZero, zero_from_primal

from jaxspatial.arithmetic.errorfree.reproducible import product, quotient

Pair = tuple[jax.Array, jax.Array]  # (hi, lo), or (value, correction)
Operand = Pair | jax.Array
Tangent = jax.Array | None  # None where it is known to be zero
TangentRule = Callable[..., Tangent]  # of (result, operands, tangents)


def differentiable(tangent: TangentRule) -> Any:
    """Decorator of an operation on pairs and words, with `tangent(result, operands, tangents)` as its derivative.

    All three are values hi + lo in one word: hi up to rounding, but with the derivatives of the sum. A tangent known
    to be zero is None: times an infinite derivative it must not become NaN. Called outside of a transformation, an
    operation is one compiled program.
    """

    def decorate(operation: Callable[..., Any]) -> Any:
        differentiable = jax.custom_jvp(operation)
        call = functools.wraps(operation)(jax.jit(differentiable, inline=True))

        def jvp(operands: Sequence[Any], tangents: Sequence[Any]) -> Any:
            hi, lo = call(*operands)
            d_hi = tangent(hi + lo, [_value(x) for x in operands], [_tangent_of_value(t) for t in tangents])
            return (hi, lo), (jnp.zeros_like(hi) if d_hi is None else d_hi, zero_from_primal(lo, symbolic_zeros=True))

        differentiable.defjvp(jvp, symbolic_zeros=True)
        return call

    return decorate


def _value(x: Operand):
    return x[0] + x[1] if isinstance(x, tuple) else x


def _tangent_of_value(tangents: Any):
    return total(*(None if isinstance(t, SymbolicZero) else t for t in jax.tree.leaves(tangents)))


def total(*terms: Tangent):
    """The sum of the terms that are there, None if none is."""
    there = [t for t in terms if t is not None]
    return functools.reduce(lax.add, there) if there else None


def linear(operation: Callable[..., Any], t: Tangent, *others: jax.Array):
    """operation(t, *others) of a tangent that may be None."""
    return None if t is None else operation(t, *others)


def sum_tangent(_: jax.Array, operands: Sequence[jax.Array], tangents: Sequence[Any]):
    return total(*tangents)


def product_tangent(_: jax.Array, operands: Sequence[Any], tangents: Sequence[Any]):
    (a, b), (da, db) = operands, tangents
    return total(linear(product, da, b), linear(product, db, a))


def quotient_tangent(result: jax.Array, operands: Sequence[Any], tangents: Sequence[Any]):
    """d(a / b) = (da - (a / b) db) / b."""
    (_, b), (da, db) = operands, tangents
    return linear(quotient, total(da, linear(lax.neg, linear(product, db, result))), b)


def root_tangent(result: jax.Array, _: Sequence[jax.Array], tangents: Sequence[Any]):
    """d sqrt(a) = da / (2 sqrt(a)): infinite at 0."""
    return linear(quotient, tangents[0], result + result)
