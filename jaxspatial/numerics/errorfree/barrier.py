"""What keeps a compiler from rewriting arithmetic: one fma of a product and a sum, sums and products with constants
rearranged, numbers taken from one place for another.

`barrier` is for anywhere; the others are for the inside of primitives, and are not differentiated or batched.
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import DTypeLike

from jaxspatial.numerics.errorfree.primitives import (
    Tangent,
    choice,
    elementwise,
    is_zero,
    lower_fun,
    no_tangent,
    over_one_shape,
    same_sharding,
)
from jaxspatial.numerics.floats import finfo, is_sized
from jaxspatial.numerics.jax_internals import Primitive, ShapedArray, ad, mlir, stablehlo


def barrier(x):
    """x, an array rounded where it stands, of whose numbers the compiler knows nothing: 1 operation.

    For arrays that a caller computed: no fma is made of a product passed through and the sum that follows, sums and
    products with constants are not rearranged. The derivative is 1, and tangents and cotangents pass a barrier, too.
    What is no array of JAX stays as it is.
    """
    return _barrier_p.bind(x) if isinstance(x, Array) else x


def barrier_or_nan(x):
    """`barrier`, for arrays whose errors of sums and products are going to be computed; see `opaque_or_nan`."""
    return _barrier_or_nan_p.bind(x) if isinstance(x, Array) else x


# The index of the replica that runs a program: below 2^31, and unknown to the compiler. Its argument is not looked at.
# It ties the index to the program that computes the argument, where JAX would otherwise evaluate it while tracing.
_replica_p = Primitive("jaxspatial_replica")
_replica_p.def_abstract_eval(lambda _: ShapedArray((), np.dtype(np.uint32)))
mlir.register_lowering(_replica_p, lambda *_: [stablehlo.replica_id()])


def opaque(x: Array) -> Array:
    """`barrier`, for the inside of primitives: the bits of x or those of a zero that the compiler cannot foresee.

    `optimization_barrier`, `reduce_precision`, bitcasts and clamps do not keep XLA CPU from making an fma, and a select
    is folded where an operand is a constant.
    """
    with jax.enable_x64(True):
        return with_bits(x, hidden_zero(x))


def hidden_zero(x: Array) -> Array:
    """A zero (uint32) that the compiler cannot foresee, in the program that x is part of."""
    return lax.shift_right_logical(_replica_p.bind(x), np.uint32(31))


def with_bits(x: Array, mask: Array) -> Array:
    """x with the bits that an integer has set in addition: of a hidden zero, x, of which the compiler knows nothing."""
    bits = bits_of(x)
    mask = lax.convert_element_type(mask, bits.dtype)
    return lax.bitcast_convert_type(lax.bitwise_or(bits, lax.broadcast(mask, bits.shape)), x.dtype)


def bits_of(x: Array) -> Array:
    """The bits of floating-point numbers, as integers of that size."""
    return lax.bitcast_convert_type(x, np.dtype(f"uint{finfo(x.dtype).bits}"))


def opaque_or_nan(x: Array) -> Array:
    """`opaque`, with the program's own proof that a sum has an error: NaN where a compiler takes it for 0.

    Where an option says that sums may be rearranged (`xla_cpu_enable_fast_math`), in XLA_FLAGS or for one program, a
    compiler concludes that the error of every sum is 0, and results would be wrong without a word. So each program adds
    two opaque numbers whose error is known, and compares. Of a batch this is one number: it costs nothing.
    """
    with jax.enable_x64(True):
        zero = lax.convert_element_type(_zero(x), np.uint32)
        numbers = jnp.float32(1), jnp.float32(2.0**-30)
        one, small = (lax.bitcast_convert_type(bits_of(y) + zero, np.float32) for y in numbers)
        s = one + small
        part = s - one
        error = (one - (s - part)) + (small - part)
        is_right = lax.eq(bits_of(error), bits_of(small))
        nan = bits_of(choice(np.nan, (), x.dtype))
        return with_bits(x, lax.select(is_right, _zero(x), nan))


def _zero(x: Array) -> Array:
    """A hidden zero, an integer of as many bits as the numbers of x have."""
    return lax.convert_element_type(hidden_zero(x), np.dtype(f"uint{finfo(x.dtype).bits}"))


def no_fma(x: Array) -> Array:
    """x, rounded where it stands: no fma is made of a product passed through and the sum that follows.

    It asks for a signalling NaN, which no operation returns, as the compiler does not know.
    """
    info = finfo(x.dtype)
    # All ones in the exponent, and a fraction whose first bit, that of a quiet NaN, is not set.
    exponent, quiet = ((1 << info.nexp) - 1) << info.nmant, 1 << (info.nmant - 1)
    # Also in a program without 64-bit types, that a sum in float64 is a part of.
    with jax.enable_x64(True):
        bits = bits_of(x)
        never = bits.dtype.type(exponent | 0x5B5B5B5B5B5B5B5B % quiet)
        # As integers: where there is no NaN (fast-math) a compiler would take x for the only choice.
        usual = lax.ne(bits, lax.full_like(bits, never))
        nan = lax.full_like(bits, never | bits.dtype.type(quiet))
        return lax.bitcast_convert_type(lax.select(usual, bits, nan), x.dtype)


def no_reassociation(x: Array) -> Array:
    """x, a sum: for XLA's algebraic simplifier not a sum any more.

    It would make x + (c1 + c2) of `(x + c1) + c2`, and x of `(x + c) - c`, for constants c. On CPUs a rounding to the
    format that x has already stops that, and is removed before any code is made of it: it costs nothing. On GPUs that
    rounding is removed first, so `no_fma` stops it.
    """
    return _kept_p.bind(x)


def widened(x: Array, dtype: DTypeLike = np.float64) -> Array:
    """x in a wider dtype, as it was rounded. Where x is a conversion from that dtype itself, XLA would leave out both
    on GPUs (`xla_allow_excess_precision`)."""
    return lax.convert_element_type(no_reassociation(x), dtype)


def _to_its_own_format(context, x) -> Sequence:
    info = finfo(context.avals_out[0].dtype)
    return [stablehlo.reduce_precision(x, mlir.i32_attr(info.nexp), mlir.i32_attr(info.nmant))]


def _lowered(function: Callable[..., Array]):
    return lower_fun(function, multiple_results=False)


def _identity(name: str, lower: Callable[[Array], Array]):
    """A primitive that changes nothing, and neither do its derivatives."""

    primitive = elementwise(
        name,
        lax.neg_p,
        _lowered(lower),
        tangent=lambda result, _, t: no_tangent(result) if is_zero(t[0]) else primitive.bind(*t),
        transpose=lambda cotangent, _: [None if is_zero(cotangent) else primitive.bind(cotangent)],
    )
    return primitive


_barrier_p = _identity("barrier", opaque)
_barrier_or_nan_p = _identity("barrier_or_nan", opaque_or_nan)
_kept_p = _identity("kept", no_fma)
mlir.register_lowering(_kept_p, _to_its_own_format, platform="cpu")


# -- sums that are not rearranged --------------------------------------------------------------------------------------
# Each is one operation of a trace. As two, the sum and what holds it, they would make traces a fifth longer.


def fixed_sum(a: Array, b: Array) -> Array:
    """`no_reassociation(a + b)`, of arrays of one shape and dtype, or of one and a number."""
    return _bound(_sum_p, a, b)


def difference(a: Array, b: Array) -> Array:
    """`no_reassociation(a - b)`, of arrays of one shape and dtype, or of one and a number."""
    return _bound(_difference_p, a, b)


def _bound(primitive, a, b) -> Array:
    return primitive.bind(*(same_sharding(a, b) if a.shape == b.shape else (a, b)))


def _of_fixed(name: str, operation: Callable[[Array, Array], Array], like, signed: Callable[[Array], Array]):
    """The primitive of an operation, which is a + signed(b), whose result no compiler rearranges."""

    def tangent(result: Array, _, tangents: Sequence) -> Tangent:
        da, db = tangents
        if is_zero(da):
            return no_tangent(result) if is_zero(db) else signed(db)
        return da if is_zero(db) else _bound(primitive, da, db)

    def transpose(cotangent, a, b) -> list:
        wanted = [ad.is_undefined_primal(x) and not is_zero(cotangent) for x in (a, b)]
        return [cotangent if wanted[0] else None, signed(cotangent) if wanted[1] else None]

    lowered = _lowered(lambda a, b: no_reassociation(operation(*over_one_shape(a, b))))
    primitive = elementwise(name, like, lowered, transpose=transpose, tangent=tangent)
    return primitive


_sum_p = _of_fixed("sum", lax.add, lax.add_p, lambda x: x)
_difference_p = _of_fixed("difference", lax.sub, lax.sub_p, lax.neg)


# -- products and quotients rounded on their own -----------------------------------------------------------------------
# They are primitives, because derivatives need them too: with a guard around the product alone, the tangent
# `da * b + a * db` would become an fma, and a pull-back could not be guarded at all (a select is not linear). Both
# arguments have one shape, and are numbers of the library's own: those of a caller go through `barrier` first.


def product(a, b) -> jax.Array:
    """fl(a * b), never part of an fma: error <= u |a b|, bitwise NumPy's. One of both may be a number."""
    return _bound(_product_p, a, b)


def quotient(a, b) -> jax.Array:
    """fl(a / b), never a multiplication by fl(1 / b): error <= u |a / b|, bitwise NumPy's."""
    return _quotient_p.bind(*same_sharding(a, b))


def root(x: Array) -> jax.Array:
    """fl(sqrt(x)): error <= u sqrt(x), bitwise NumPy's."""
    return _root_p.bind(x)


def _rounded_quotient(a: Array, b: Array):
    """XLA multiplies by the reciprocal of a divisor that is one number for many; not if it depends on the dividend.

    So the divisor is b where the dividend is finite, and b / 2 where it is infinite or NaN: the quotient of these is
    the same. If the dividend is one number for many, too, the test alone is one number as well. Then an index is added
    to the largest number that it compares with. The sum is the largest number or infinity: the test means the same.

    XLA makes `a / (b c)`, which may overflow, of `(a / b) / c`, and a reciprocal root of `1 / sqrt(x)`: not where
    `no_fma` stands in between.
    """
    largest = lax.full_like(a, finfo(a.dtype).max)
    if a.ndim:
        # Also in float64 in a program without 64-bit types, as in `no_fma`.
        with jax.enable_x64(True):
            # Sizes may be symbols of `jax.export`, of which any may be the largest.
            axes = [int(np.argmax(a.shape))] if is_sized(a.shape) else range(a.ndim)
            for axis in axes:
                largest = lax.add(largest, lax.broadcasted_iota(a.dtype, a.shape, axis))
    finite = lax.le(lax.abs(a), largest)
    divisor = lax.select(finite, b, lax.mul(b, lax.full_like(b, 0.5)))
    return no_fma(lax.div(a, no_fma(divisor)))


def _in_float64(function: Callable[..., Array]) -> Callable[..., Array]:
    """A quotient or a root on GPUs, where XLA has them to 2 ulp in float32: computed in float64, and rounded again.

    The second rounding changes nothing, for float64 has more than twice the digits of float32, and two more. [Figueroa
    1995] LLVM knows this, too, and would go back to float32, were it not for the barrier in `function`.
    """

    def rounded_twice(*operands: Array) -> Array:
        with jax.enable_x64(True):
            return lax.convert_element_type(function(*map(widened, operands)), operands[0].dtype)

    return rounded_twice


def _rounded_root(x: Array):
    return no_fma(lax.sqrt(x))


def product_tangent(result: Array, primals: Sequence[Array], tangents: Sequence):
    """da b + a db, of tangents that may be known to be zero."""
    (a, b), (da, db) = primals, tangents
    return _sum_of_tangents(result, [product(x, y) for x, y in ((da, b), (a, db)) if not (is_zero(x) or is_zero(y))])


def _quotient_jvp(primals: Sequence[Array], tangents: Sequence) -> tuple[Array, Tangent]:
    """d(a / b) = da / b - (a / b) db / b."""
    (a, b), (da, db) = primals, tangents
    result = quotient(a, b)
    of_dividend = [] if is_zero(da) else [quotient(da, b)]
    of_divisor = [] if is_zero(db) else [lax.neg(quotient(product(result, db), b))]
    return result, _sum_of_tangents(result, of_dividend + of_divisor)


def _root_jvp(primals: Sequence[Array], tangents: Sequence) -> tuple[Array, Tangent]:
    """dx / (2 sqrt(x)), the quotient rounded on its own: `lax.sqrt` has one that depends on the program around it."""
    (dx,), result = tangents, root(*primals)
    return result, no_tangent(result) if is_zero(dx) else quotient(dx, lax.add(result, result))


def _sum_of_tangents(result: Array, terms: Sequence[Array]):
    """Of at most two tangents of `result`."""
    return lax.add(*terms) if len(terms) == 2 else terms[0] if terms else no_tangent(result)


def _product_transpose(cotangent, a, b) -> list[Array | None]:
    if is_zero(cotangent):
        return [None, None]
    return [product(cotangent, b), None] if ad.is_undefined_primal(a) else [None, product(a, cotangent)]


_product_p = elementwise(
    "product",
    lax.mul_p,
    _lowered(lambda a, b: no_fma(lax.mul(*over_one_shape(a, b)))),
    transpose=_product_transpose,
    tangent=product_tangent,
)
_quotient_p = elementwise(
    "quotient",
    lax.div_p,
    _lowered(_rounded_quotient),
    _quotient_jvp,
    lambda cotangent, _, b: [None if is_zero(cotangent) else quotient(cotangent, b), None],
)
_root_p = elementwise("root", lax.sqrt_p, _lowered(lax.sqrt), _root_jvp)
mlir.register_lowering(_quotient_p, _lowered(_in_float64(_rounded_quotient)), platform="gpu")
mlir.register_lowering(_root_p, _lowered(_in_float64(_rounded_root)), platform="gpu")
