"""The error of a product in one operation, where the compiler makes it one.

With p = fl(a b), and a hidden from the compiler so that it sees two products and not one, XLA CPU contracts
`hidden(a) * b - p` to a fused multiply-add, which is a b - p exactly. No operation asks for it and nothing promises it:
some machines have no such instruction, flags take it away, compilers change. Where it is missing the line gives 0. So
it is tried, once per process, on products whose errors are known, when the first program that could use it is lowered.
Any doubt means no: a trial that is not exact everywhere or cannot be run, another platform than the CPU, a program to
be exported, which may run on another machine.

A program that was compiled with it stays right: it has the instruction in it. Programs with it and without differ
before they are compiled, and one with it is compiled only in a process whose trial passed: JAX's persistent cache
cannot give it to one where it would be wrong. The trial itself is never found there, for it holds a number of its own.
What it cannot see are compiler options of one program alone (`jax.jit(..., compiler_options=...)`).
"""

import fractions
import functools
import secrets
import threading
from collections.abc import Sequence
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
from jaxspatial.arithmetic.errorfree.fence import kept

# -- a zero that the compiler does not know ----------------------------------------------------------------------------


# The index of the replica, of which there are fewer than 2^31: not known before a program runs. Of an argument that it
# does not look at, so that it is part of the program which that is part of, whatever JAX evaluates while tracing.
_replica_p: Any = Primitive("jaxspatial_replica")


@_replica_p.def_abstract_eval
def _(_: Any) -> ShapedArray:
    return ShapedArray((), np.dtype(np.uint32))


mlir.register_lowering(_replica_p, lambda *_: [stablehlo.replica_id()])


def hidden(x: Array):
    """x, of which the compiler knows nothing, constants included: its bits, plus a zero that it cannot foresee.

    A product passed through is not contracted with the sum that follows, and a sum with constants not rearranged. For
    what is lowered for the CPU: not differentiated, batched or run outside of a program.
    """
    integer = np.dtype(f"uint{finfo(x.dtype).bits}")
    with jax.enable_x64(True):
        zero = lax.convert_element_type(lax.shift_right_logical(_replica_p.bind(x), np.uint32(31)), integer)
        bits = lax.bitcast_convert_type(x, integer)
        return lax.bitcast_convert_type(lax.add(bits, lax.broadcast(zero, bits.shape)), x.dtype)


def product_error(a: Array, b: Array, p: Array):
    """a b - p exactly, of p = fl(a b) `hidden` or fenced, while that is a normal number or 0. 1 flop.

    Kept: of a constant p the compiler would make `x + (c2 - p)` of (x - p) + c2.
    """
    return kept(hidden(a) * b - p)


# -- whether it may be used --------------------------------------------------------------------------------------------

_forced: Any = jax.make_user_context(default_value=None)


def forced(is_used: bool):
    """A context manager, for tests: programs lowered inside use contraction, or do not, whatever was found."""
    return _forced(bool(is_used))


def is_used(context: Any, dtype: DTypeLike):
    """Whether the program of a lowering context may rely on it, for numbers of a dtype."""
    module = context.module_context
    platforms = tuple(context.platforms or module.platforms)
    if platforms != ("cpu",) or module.lowering_parameters.for_export:
        return False
    return holds(np.dtype(dtype)) if _forced.value is None else _forced.value


@functools.cache
def holds(dtype: np.dtype[Any]) -> bool:
    """Whether errors of products by contraction are exact on the CPU of this process, as far as has been tried."""
    found: list[bool] = []
    # In a thread of its own: what this one is tracing, or has set for a while, is not the trial's business.
    thread = threading.Thread(target=lambda: found.append(_passes(np.dtype(dtype))))
    thread.start()
    thread.join()
    return found == [True]


def _passes(dtype: Any):
    if dtype not in (np.float32, np.float64):
        return False
    try:
        with jax.enable_x64(True), jax.default_device(jax.local_devices(backend="cpu")[0]):
            return _is_exact(np.dtype(dtype))
    except Exception:  # noqa: BLE001 - whatever goes wrong, there is a way without
        return False


def _is_exact(dtype: np.dtype[Any]):
    a, b = _operands(dtype)
    trial = jax.jit(functools.partial(_trial, a, b, dtype.type(secrets.randbits(20))))
    *found, _ = trial.lower(a, b).compile()(a, b)
    return all(np.array_equal(np.broadcast_to(x, y.shape), y) for x, y in zip(found, _expected(a, b), strict=True))


# So many that a loop over them has a vector body and a remainder; in rows of three that are divided between lanes.
_ROWS = 25


def _operands(dtype: np.dtype[Any]) -> tuple[np.ndarray, np.ndarray]:
    """a and b (rows, 3), of all sizes and signs, with errors that are normal numbers or 0."""
    info = np.finfo(dtype)
    rng = np.random.default_rng(0)
    a, b = rng.uniform(0.5, 1, (2, _ROWS, 3)).astype(dtype) * rng.choice([-1, 1], (2, _ROWS, 3)).astype(dtype)
    reach = info.maxexp // 2 - info.nmant
    a, b = (np.ldexp(x, rng.integers(-reach, reach, x.shape, np.int32)) for x in (a, b))
    # Next to the largest number and to the smallest, zeros, powers of two, and errors of one bit.
    for row, exponent in ((0, info.maxexp), (1, info.minexp + 1)):
        a[row], b[row] = (np.ldexp(np.frexp(x[row])[0], e) for x, e in ((a, exponent), (b, -exponent // 2)))
    a[2], b[3], a[4], b[4] = (0, 1, -2), (-0.5, 0, 4), 1 + info.eps, 1 - info.epsneg
    return a, b


def _hidden_product(a: Array, b: Array) -> tuple[Array, Array]:
    p = hidden(a * b)
    return p, product_error(a, b, p)


def _trial(a_known: Any, b_known: Any, own: Array, a: Array, b: Array):
    """What is tried: results beside errors and errors alone, arrays, single numbers and loops, numbers that are known
    to the compiler on one side or both, the same for many or not, next to other known numbers, and lanes picked again.
    """
    a_known, b_known, p_known = (jnp.asarray(x) for x in (a_known, b_known, a_known * b_known))
    one, other, one_known, other_known = (x[5, 0] for x in (a, b, a_known, b_known))
    scanned = lax.scan(lambda carry, x: (carry, _hidden_product(*x)[1]), 0, (a[:, 0], b[:, 0]))[1]
    columns = [[x[:, k] for x in (a, b)] for k in range(3)]
    return (
        *_hidden_product(a, b),
        _hidden_product(b, a)[1],
        _hidden_product(a, b_known)[1],
        _hidden_product(a_known, b)[1],
        _hidden_product(a_known, b_known)[1],
        product_error(a_known, b_known, p_known) + b_known,
        _hidden_product(_spread(one), _spread(other))[1] + 0 * a,
        _hidden_product(_spread(one_known), _spread(other_known))[1] + 0 * a,
        _hidden_product(one, other)[1],
        _hidden_product(one_known, other_known)[1],
        scanned,
        *_picked([_hidden_product(*x) for x in columns]),
        jnp.asarray(own),
    )


def _spread(x: Array):
    return lax.broadcast(x, (_ROWS, 3))


def _picked(pairs: Sequence[Sequence[Array]]):
    """The products and the errors of three columns, each as one array of rows."""
    index = lax.broadcasted_iota(np.int32, (_ROWS, 3), 1)
    for columns in zip(*pairs, strict=True):
        x, y, z = (lax.broadcast_in_dim(x, (_ROWS, 3), (0,)) for x in columns)
        yield lax.select(index == 0, x, lax.select(index == 1, y, z))


def _expected(a: np.ndarray, b: np.ndarray):
    """What `_trial` has to find, but for its own number."""
    p = a * b
    e = np.vectorize(_exact_error, otypes=[a.dtype])(a, b, p)
    same, one = np.full_like(e, e[5, 0]), e[5, 0]
    return p, e, e, e, e, e, e + b, same, same, one, one, e[:, 0], p, e


def _exact_error(a: float, b: float, p: float):
    return float(fractions.Fraction(float(a)) * fractions.Fraction(float(b)) - fractions.Fraction(float(p)))
