"""The reproducible precision: products and quotients rounded on their own, in values and derivatives of any order.

They are primitives, because derivatives need them too: with a guard around the product alone, the tangent
`da * b + a * db` would be contracted, and a pull-back could not be guarded at all (a select is not linear). Both
arguments have one shape, and are numbers of the library's own: those of a caller go through `barrier` first.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
from jax import Array, lax
from jax.interpreters import ad

from jaxspatial.arithmetic.check import finfo
from jaxspatial.arithmetic.errorfree.barrier import settled
from jaxspatial.arithmetic.errorfree.primitives import alike, elementwise, is_zero, lower_fun, no_tangent


def product(a: Any, b: Any) -> jax.Array:
    """fl(a * b), never contracted with what follows: error <= u |a b|, bitwise NumPy's."""
    return _product_p.bind(*alike(a, b))


def quotient(a: Any, b: Any) -> jax.Array:
    """fl(a / b), never a multiplication by fl(1 / b): error <= u |a / b|, bitwise NumPy's."""
    return _quotient_p.bind(*alike(a, b))


def _rounded_product(a: Array, b: Array):
    return settled(lax.mul(a, b))


def _rounded_quotient(a: Array, b: Array):
    """XLA multiplies by the reciprocal of a divisor that is one number for many; not if it depends on the dividend.

    Infinities and NaN, for which the other divisor is taken, divide by half of b as they do by b. Of quotients of
    quotients it makes products, `a / (b c)` of `(a / b) / c`, that may overflow, and of `1 / sqrt(x)` a reciprocal
    root: not of what is settled.
    """
    finite = lax.le(lax.abs(a), lax.full_like(a, finfo(a.dtype).max))
    divisor = lax.select(finite, b, lax.mul(b, lax.full_like(b, 0.5)))
    return settled(lax.div(a, settled(divisor)))


def _product_jvp(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Array, Any]:
    result = product(*primals)
    return result, product_tangent(result, primals, tangents)


def product_tangent(result: Array, primals: Sequence[Array], tangents: Sequence[Any]) -> Any:
    """da b + a db, of tangents that may be known to be zero."""
    (a, b), (da, db) = primals, tangents
    return _sum(result, [product(x, y) for x, y in ((da, b), (a, db)) if not (is_zero(x) or is_zero(y))])


def _quotient_jvp(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Array, Any]:
    """d(a / b) = da / b - (a / b) db / b."""
    (a, b), (da, db) = primals, tangents
    result = quotient(a, b)
    of_dividend = [] if is_zero(da) else [quotient(da, b)]
    of_divisor = [] if is_zero(db) else [lax.neg(quotient(product(result, db), b))]
    return result, _sum(result, of_dividend + of_divisor)


def _sum(result: Array, terms: Sequence[Array]) -> Any:
    """The sum of at most two tangents of `result`."""
    return lax.add(*terms) if len(terms) == 2 else terms[0] if terms else no_tangent(result)


def _product_transpose(cotangent: Any, a: Any, b: Any) -> list[Array | None]:
    if is_zero(cotangent):
        return [None, None]
    return [product(cotangent, b), None] if ad.is_undefined_primal(a) else [None, product(a, cotangent)]


def _quotient_transpose(cotangent: Any, _: Any, b: Array) -> list[Array | None]:
    return [None if is_zero(cotangent) else quotient(cotangent, b), None]


def _lowered(function: Callable[..., Array]) -> Any:
    return lower_fun(function, multiple_results=False)


_product_p = elementwise("product", lax.mul_p, _lowered(_rounded_product), _product_jvp, _product_transpose)
_quotient_p = elementwise("quotient", lax.div_p, _lowered(_rounded_quotient), _quotient_jvp, _quotient_transpose)
