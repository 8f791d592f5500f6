"""The reproducible precision: products and quotients rounded on their own, in values and derivatives of any order.

They are primitives, because derivatives need them too: written with a fence alone, the tangent `da * b + a * db` would
be contracted, and a pull-back could not be fenced at all (a select is not linear). Both arguments have one shape.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxspatial.arithmetic.fence import settled


def product(a, b):
    """fl(a * b), never contracted with what follows: error <= u |a b|, bitwise NumPy's."""
    return _product_p.bind(*_alike(a, b))


def quotient(a, b):
    """fl(a / b), never a multiplication by fl(1 / b): error <= u |a / b|, bitwise NumPy's."""
    return _quotient_p.bind(*_alike(a, b))


def _alike(a, b):
    """a and b, varying over the same axes of a `shard_map` and sharded alike; lax.mul does this for itself."""
    return _sharded_alike(*_varying_alike(a, b))


def _varying_alike(a, b):
    axes = [frozenset(jax.typeof(x).mat.varying) for x in (a, b)]
    missing = [tuple((axes[0] | axes[1]) - own) for own in axes]
    return [lax.pcast(x, m, to="varying") if m else x for x, m in zip((a, b), missing, strict=True)]


def _sharded_alike(a, b):
    """Under explicit sharding, an argument that is whole along an axis is split as the other one is."""
    specs = [jax.typeof(x).sharding.spec for x in (a, b)]
    if specs[0] == specs[1]:
        return [a, b]
    both = jax.sharding.PartitionSpec(*(s if s is not None else t for s, t in zip(*specs, strict=True)))
    return [x if spec == both else jax.sharding.reshard(x, both) for x, spec in zip((a, b), specs, strict=True)]


def _rounded_product(a, b):
    return settled(lax.mul(a, b))


def _rounded_quotient(a, b):
    """XLA multiplies by the reciprocal of a divisor that is one number for many; not if it depends on the dividend.

    Infinities and NaN, for which the other divisor is taken, divide by half of b as they do by b. Of quotients of
    quotients it makes products, `a / (b c)` of `(a / b) / c`, that may overflow, and of `1 / sqrt(x)` a reciprocal
    root: not of what is fenced.
    """
    finite = lax.le(lax.abs(a), lax.full_like(a, jnp.finfo(a.dtype).max))
    divisor = lax.select(finite, b, lax.mul(b, lax.full_like(b, 0.5)))
    return settled(lax.div(a, settled(divisor)))


def _is_zero(tangent):
    return type(tangent) is ad.Zero


def _product_jvp(primals, tangents):
    (a, b), (da, db) = primals, tangents
    result = product(a, b)
    return result, _sum(result, [product(x, y) for x, y in ((da, b), (a, db)) if not (_is_zero(x) or _is_zero(y))])


def _quotient_jvp(primals, tangents):
    """d(a / b) = da / b - (a / b) db / b."""
    (a, b), (da, db) = primals, tangents
    result = quotient(a, b)
    of_dividend = [] if _is_zero(da) else [quotient(da, b)]
    of_divisor = [] if _is_zero(db) else [lax.neg(quotient(product(result, db), b))]
    return result, _sum(result, of_dividend + of_divisor)


def _sum(result, terms):
    """The sum of at most two tangents of `result`."""
    return lax.add(*terms) if len(terms) == 2 else terms[0] if terms else _no_tangent(result)


def _no_tangent(x):
    return ad.Zero(jax.typeof(x).to_tangent_aval())


def _product_transpose(cotangent, a, b):
    if _is_zero(cotangent):
        return [None, None]
    return [product(cotangent, b), None] if ad.is_undefined_primal(a) else [None, product(a, cotangent)]


def _quotient_transpose(cotangent, _, b):
    return [None if _is_zero(cotangent) else quotient(cotangent, b), None]


def _elementwise(name, like, rounded, jvp, transpose):
    """A primitive of two arguments with the shapes, shardings and errors of the lax primitive `like`."""
    primitive = Primitive(f"jaxspatial_{name}")
    primitive.def_abstract_eval(lambda a, b: like.abstract_eval(a, b)[0])
    primitive.def_impl(jax.jit(rounded))
    mlir.register_lowering(primitive, mlir.lower_fun(rounded, multiple_results=False))
    ad.primitive_jvps[primitive] = jvp
    ad.primitive_transposes[primitive] = transpose
    batching.primitive_batchers[primitive] = lambda args, axes: (
        primitive.bind(*_alike(*_batched(args, axes))),
        0,
    )
    return primitive


def _batched(arguments, axes):
    """The arguments with the batch axis first; one without it repeated, so that its cotangents are summed."""
    size = next(x.shape[axis] for x, axis in zip(arguments, axes, strict=True) if axis is not None)
    for x, axis in zip(arguments, axes, strict=True):
        yield lax.broadcast(x, (size,)) if axis is None else jnp.moveaxis(x, axis, 0)


_product_p = _elementwise("product", lax.mul_p, _rounded_product, _product_jvp, _product_transpose)
_quotient_p = _elementwise("quotient", lax.div_p, _rounded_quotient, _quotient_jvp, _quotient_transpose)
