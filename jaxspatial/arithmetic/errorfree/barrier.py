"""What keeps a compiler from rewriting arithmetic: products contracted with sums, sums and products with constants
rearranged, numbers taken from one place for another.

`barrier` is for anywhere; the others are for the inside of primitives, and are not differentiated or batched.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.extend.mlir.dialects import stablehlo
from jax.interpreters import mlir
from jax.typing import DTypeLike

from jaxspatial.arithmetic.check import finfo
from jaxspatial.arithmetic.errorfree.primitives import elementwise, is_zero, lower_fun, no_tangent


def barrier(x: Any) -> Any:
    """x, an array rounded where it stands, of whose numbers the compiler knows nothing: 1 operation.

    For arrays that a caller computed: a product passed through is not contracted with the sum that follows, sums and
    products with constants are not rearranged. The derivative is 1, and tangents and cotangents pass a barrier, too.
    What is no array of JAX stays as it is.
    """
    return _barrier_p.bind(x) if isinstance(x, Array) else x


def proving_barrier(x: Any) -> Any:
    """`barrier`, for arrays whose errors of sums and products are going to be computed; see `proven`."""
    return _proving_barrier_p.bind(x) if isinstance(x, Array) else x


def read(operation: Callable[..., Any], *arrays: Any) -> Any:
    """operation(*arrays) of arrays behind barriers; what it just passes on stays as it is."""
    hidden = [barrier(x) for x in arrays]
    found = operation(*hidden)
    return next((x for x, y in zip(arrays, hidden, strict=True) if found is y), found)


# The index of the replica, of which there are fewer than 2^31: not known before a program runs. Of an argument that it
# does not look at, so that it is part of the program which that is part of, whatever JAX evaluates while tracing.
_replica_p: Any = Primitive("jaxspatial_replica")


@_replica_p.def_abstract_eval
def _(_: Any) -> ShapedArray:
    return ShapedArray((), np.dtype(np.uint32))


mlir.register_lowering(_replica_p, lambda *_: [stablehlo.replica_id()])


def hidden(x: Array) -> Array:
    """`barrier`, for the inside of primitives: the bits of x or those of a zero that the compiler cannot foresee.

    `optimization_barrier`, `reduce_precision`, bitcasts and clamps do not keep XLA CPU from contracting, and a select
    is folded where an operand is a constant.
    """
    with jax.enable_x64(True):
        return _of_bits(lax.bitwise_or(bits := _bits(x), lax.broadcast(_zero(x), bits.shape)), x.dtype)


def proven(x: Array) -> Array:
    """`hidden`, with the program's own proof that a sum has an error: NaN where a compiler takes it for 0.

    Told by an option that sums may be rearranged (`xla_cpu_enable_fast_math`), in XLA_FLAGS or for one program, a
    compiler finds that the error of every sum is 0, and results would be wrong without a word. So each program adds
    two hidden numbers whose error is known, and compares. Of a batch this is one number: it costs nothing.
    """
    with jax.enable_x64(True):
        zero = lax.convert_element_type(_zero(x), np.uint32)
        one, small = (_of_bits(_bits(y) + zero, y.dtype) for y in (jnp.float32(1), jnp.float32(2.0**-30)))
        total = one + small
        part = total - one
        error = (one - (total - part)) + (small - part)
        is_right = lax.eq(_bits(error), _bits(small))
        bits = _bits(x)
        nan = _bits(lax.full((), np.nan, x.dtype))
        mask = lax.select(is_right, _zero(x), nan)
        return _of_bits(lax.bitwise_or(bits, lax.broadcast(mask, bits.shape)), x.dtype)


def _zero(x: Array) -> Array:
    """A zero that the compiler cannot foresee, an integer of as many bits as the numbers of x have."""
    return lax.convert_element_type(lax.shift_right_logical(_replica_p.bind(x), np.uint32(31)), _integer(x.dtype))


def _integer(dtype: DTypeLike) -> np.dtype[Any]:
    return np.dtype(f"uint{finfo(dtype).bits}")


def _bits(x: Array) -> Array:
    return lax.bitcast_convert_type(x, _integer(x.dtype))


def _of_bits(bits: Array, dtype: DTypeLike) -> Array:
    return lax.bitcast_convert_type(bits, dtype)


def settled(x: Array) -> Array:
    """x, rounded where it stands: a product passed through is not contracted with the sum that follows.

    It asks for a signalling NaN, which no operation returns, as the compiler does not know.
    """
    info, integer = finfo(x.dtype), _integer(x.dtype)
    # All ones in the exponent, and a fraction whose first bit, that of a quiet NaN, is not set.
    exponent, quiet = ((1 << info.nexp) - 1) << info.nmant, 1 << (info.nmant - 1)
    never = integer.type(exponent | 0x5B5B5B5B5B5B5B5B % quiet)
    # Also in a program without 64-bit types, that a sum in float64 is a part of.
    with jax.enable_x64(True):
        bits = _bits(x)
        # As integers: told that there is no NaN (fast-math), a compiler would take x for the only choice.
        usual, nan = lax.ne(bits, lax.full_like(bits, never)), lax.full_like(bits, never | integer.type(quiet))
        return _of_bits(lax.select(usual, bits, nan), x.dtype)


def kept(x: Array) -> Array:
    """x, a sum: for XLA's algebraic simplifier not a sum any more.

    It would make x + (c1 + c2) of `(x + c1) + c2`, and x of `(x + c) - c`, for constants c. A rounding to the format
    that x has already stops that, and is removed before any code is made of it: it costs nothing.
    """
    info = finfo(x.dtype)
    return lax.reduce_precision(x, exponent_bits=info.nexp, mantissa_bits=info.nmant)


def _identity(name: str, lower: Callable[[Array], Array]) -> Any:
    """A primitive that changes nothing, and neither do its derivatives."""

    def jvp(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Array, Any]:
        result, (tangent,) = primitive.bind(*primals), tangents
        return result, no_tangent(result) if is_zero(tangent) else primitive.bind(tangent)

    def transpose(cotangent: Any, _: Any) -> list[Any]:
        return [None if is_zero(cotangent) else primitive.bind(cotangent)]

    primitive = elementwise(name, lax.neg_p, lower_fun(lower, multiple_results=False), jvp, transpose)
    return primitive


_barrier_p = _identity("barrier", hidden)
_proving_barrier_p = _identity("proving_barrier", proven)
