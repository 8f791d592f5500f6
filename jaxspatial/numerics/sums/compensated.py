"""Sums of products as if computed in twice the precision: the rounding errors are summed beside. [Ogita, Rump, Oishi
2005, Accurate Sum and Dot Product, algorithm 5.3]

The state of a sum is (s, t, e): s the rounded sum, t the errors of its additions, e those of its products. Each is
summed in pairs, which for tau - (a b - c d) gives an error <= u |r| + 4 u^2 mag. Proof, with A, B the powers of two
below the products and the partial sums: |e_i| <= u A_i, |t_i| <= u B_i, hence rounding e_1 - e_2, t_1 + t_2 and their
sum costs at most u^2 (max A + max B + ufp(A_1 + A_2 + B_1 + B_2)), which is <= 4 u^2 ufp(mag) in every case.
"""

import dataclasses
import functools
import operator
from collections.abc import Sequence

from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.numerics.errorfree.barrier import opaque
from jaxspatial.numerics.errorfree.transforms import fast_two_sum, product_error, two_product, two_sum, unguarded
from jaxspatial.numerics.sums.accumulator import Accumulator, Limbs, OverBatch, Terms
from jaxspatial.numerics.sums.pairwise import of_neighbours


def _state_of(terms: Terms) -> Limbs:
    pairs = [signed_product(sign, factors) for sign, factors in terms]
    s, errors = vec_sum([p for p, _ in pairs])
    return s, sum_like(s, errors), sum_like(s, [e for _, e in pairs if e is not None])


def signed_product(sign: int, factors: Sequence[Array]) -> tuple[Array, Array | None]:
    """(p, e) of sign times the product of factors, p + e exact for two; e None for a single one.

    Of n factors the error is at most n (n - 2) u^2 of the product: 3, 8, 15.
    """
    first, *others = factors
    p, e = first if others else opaque(first), None
    for x in others:
        p, r = two_product(p, x)
        e = r if e is None else r + e * x
    # The sign last: a factor that many terms share is made opaque, or split, once.
    return (p, e) if sign > 0 else (-p, None if e is None else -e)


def product_parts(sign: int, factors: Sequence[Array]) -> list[Array]:
    """The product as one number for each doubling of its digits, exactly their sum: pairs (large, small) in a row."""
    first, *others = factors
    result = [first if others else opaque(first)]
    for x in others:
        products = [(part, opaque(part * x)) for part in result]
        result = [y for part, p in products for y in (p, product_error(part, x, p))]
    return result if sign > 0 else [-x for x in result]


def product_parts_of_narrow(sign: int, factors: Sequence[Array]) -> list[Array]:
    """As `product_parts`, of up to six factors of half the digits: products of two are exact, none overflows."""
    return product_parts(sign, [functools.reduce(operator.mul, factors[i : i + 2]) for i in range(0, len(factors), 2)])


def vec_sum(numbers: list[Array]) -> tuple[Array, list[Array]]:
    """(the rounded sum, the errors made), added in pairs."""
    errors: list[Array] = []

    def add(a: Array, b: Array) -> Array:
        s, error = two_sum(a, b, unguarded)
        errors.append(error)
        return s

    return of_neighbours(add, numbers), errors


def sum_like(x: Array, numbers: Sequence[Array]) -> Array:
    """The sum of the numbers in pairs, 0 in the shape of x where there are none."""
    return of_neighbours(operator.add, numbers) if numbers else lax.full_like(x, 0)


def _single(terms: Terms) -> Limbs:
    """Of one product whose error nobody asks for."""
    ((sign, factors),) = terms
    p = opaque(functools.reduce(lax.mul, factors))
    return (p if sign > 0 else -p), lax.full_like(p, 0), lax.full_like(p, 0)


def _plus(state: Limbs, sign: int, x: Array) -> Limbs:
    """What may be a constant goes second."""
    s, t, e = state
    s, error = two_sum(s, -x if sign < 0 else x)
    return s, t + error, e


def _merge(a: Limbs, b: Limbs) -> Limbs:
    s, error = two_sum(a[0], b[0], unguarded)
    return s, (a[1] + b[1]) + error, a[2] + b[2]


def _round(state: Limbs, dtype: DTypeLike) -> Array:
    """Rounded; where something is infinite or NaN, what the plain sum gives."""
    s, t, e = state
    r = s + (t + e)
    return lax.select(lax.is_finite(r), r, s).astype(dtype)


def _pair(state: Limbs, dtype: DTypeLike) -> tuple[Array, Array]:
    """(hi, lo): before the last rounding."""
    s, t, e = state
    hi, lo = fast_two_sum(s, t + e)
    finite = lax.is_finite(hi)
    return lax.select(finite, hi, s).astype(dtype), lax.select(finite, lo, lax.full_like(lo, 0)).astype(dtype)


COMPENSATED = Accumulator(
    state_of=_state_of,
    plus=_plus,
    round=_round,
    pair=_pair,
    over_batch=lambda state, _: OverBatch(state, _merge, _round, _pair),
)
SINGLE = dataclasses.replace(COMPENSATED, state_of=_single)
