"""The reproducible precision: every product is rounded on its own, in values and in derivatives of any order.

The product is a primitive, because a derivative needs one too: written with `fence` alone, the tangent
`da * b + a * db` would be contracted and a pull-back could not be fenced at all (a select is not linear).
"""

import jax
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxspatial.arithmetic.fence import fence

_product_p = Primitive("jaxspatial_product")


def product(a, b):
    """fl(a * b), never contracted with what follows: error <= u |a b|, bitwise NumPy's."""
    return _product_p.bind(*_varying_alike(a, b))


def _varying_alike(a, b):
    """a and b, marked as varying over the same axes of a `shard_map` (lax.mul does this by itself)."""
    axes = tuple(getattr(jax.typeof(x), "vma", frozenset()) for x in (a, b))
    missing = [tuple((axes[0] | axes[1]) - own) for own in axes]
    return (lax.pcast(x, m, to="varying") if m else x for x, m in zip((a, b), missing, strict=True))


def _rounded(a, b):
    return fence(lax.mul(a, b))


def _jvp(primals, tangents):
    (a, b), (da, db) = primals, tangents
    terms = [product(x, y) for x, y in ((da, b), (a, db)) if ad.Zero not in (type(x), type(y))]
    result = product(a, b)
    return result, lax.add(*terms) if len(terms) == 2 else terms[0] if terms else ad.Zero.from_primal_value(result)


def _transpose(cotangent, a, b):
    if type(cotangent) is ad.Zero:
        return [None, None]
    linear_in_a = ad.is_undefined_primal(a)
    return [product(cotangent, b), None] if linear_in_a else [None, product(a, cotangent)]


# Shapes, shardings and errors are those of a plain multiplication.
_product_p.def_abstract_eval(lambda a, b: lax.mul_p.abstract_eval(a, b)[0])
_product_p.def_impl(jax.jit(_rounded))
mlir.register_lowering(_product_p, mlir.lower_fun(_rounded, multiple_results=False))
ad.primitive_jvps[_product_p] = _jvp
ad.primitive_transposes[_product_p] = _transpose
batching.defbroadcasting(_product_p)
