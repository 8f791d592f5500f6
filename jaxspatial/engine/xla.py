"""Prepares a trace for XLA, which compiles it where machine code of our own cannot be called.

Results keep the bits of that code, and XLA takes seconds where it would take minutes.
"""

import functools
import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree import barrier
from jaxspatial.numerics.errorfree.primitives import not_inlined
from jaxspatial.numerics.jax_internals import ClosedJaxpr, Literal, jaxpr_as_fun

# XLA compiles a long trace for CPUs in parts of this many operations.
PART = 400
# A loop adds at most so many terms one by one. What is longer is a sum over states, which XLA computes.
MOST_TERMS = 64


def in_parts(closed: ClosedJaxpr, arrays: Sequence) -> list:
    """The results of a trace, PART operations at a time, as calls that the compiler does not inline.

    XLA makes a kernel of every result for CPUs, and each computes again what results share: in one long function that
    is nearly all there is before them, and compiles for minutes.
    """
    jaxpr, values = closed.jaxpr, {}
    values.update(zip(jaxpr.constvars, closed.consts, strict=True))
    values.update(zip(jaxpr.invars, arrays, strict=True))
    parts = [jaxpr.eqns[k : k + PART] for k in range(0, len(jaxpr.eqns), PART)]
    # From the end: what is read behind each part.
    read, behind = set(jaxpr.outvars), list[set]()
    for part in reversed(parts):
        behind.insert(0, set(read))
        read |= {x for eqn in part for x in eqn.invars if not isinstance(x, Literal)}
    for part, wanted in zip(parts, behind, strict=True):
        made = {v for eqn in part for v in eqn.outvars}
        inputs = dict.fromkeys(x for eqn in part for x in eqn.invars if not isinstance(x, Literal) and x not in made)
        outputs = [v for eqn in part for v in eqn.outvars if v in wanted]
        unnamed = jaxpr.debug_info.with_unknown_names()
        own = jaxpr.replace(eqns=part, invars=[*inputs], outvars=outputs, constvars=[], debug_info=unnamed)
        run = jaxpr_as_fun(ClosedJaxpr(own.replace(eqns=[_with_parts(eqn) for eqn in part]), []))
        read_here = [values[x] for x in inputs]
        found = not_inlined(run, *read_here) if len(parts) > 1 else run(*read_here)
        values.update(zip(outputs, found, strict=True))
    return [x.val if isinstance(x, Literal) else values[x] for x in jaxpr.outvars]


def _with_parts(eqn):
    """A loop whose body is in parts, if it is long; other operations as they are."""
    bodies = {k: x for k, x in eqn.params.items() if isinstance(x, ClosedJaxpr) and len(x.jaxpr.eqns) > PART}
    if eqn.primitive.name not in ("scan", "while") or not bodies:
        return eqn
    parted = {k: jax.make_jaxpr(lambda *arrays, body=x: in_parts(body, arrays))(*x.in_avals) for k, x in bodies.items()}
    return eqn.replace(params={**eqn.params, **parted})


# -- rounding ----------------------------------------------------------------------------------------------------------


def rounded_as_in_graphs(closed: ClosedJaxpr, has_plain_products: bool) -> ClosedJaxpr:
    """A trace whose results have the bits that `graph` gives them.

    Products of matrices, Cholesky's method, substitution and sums become loops: XLA, and the libraries that it calls,
    round them in another order, which differs between machines. With `has_plain_products` products and quotients of
    single numbers are rounded before they are added. Formulas say themselves how theirs are rounded.
    """
    eqns = [_rounded(eqn, has_plain_products) for eqn in closed.jaxpr.eqns]
    if all(a is b for a, b in zip(eqns, closed.jaxpr.eqns, strict=True)):
        return closed
    unnamed = closed.jaxpr.debug_info.with_unknown_names()
    return ClosedJaxpr(closed.jaxpr.replace(eqns=eqns, debug_info=unnamed), closed.consts)


def _rounded(eqn, has_plain_products: bool):
    """An operation, or a call of what stands for it; the same object where nothing changes."""
    own = _own(eqn, has_plain_products)
    if own is not None:
        (call,) = jax.make_jaxpr(jax.jit(functools.partial(own, **eqn.params)))(*(x.aval for x in eqn.invars)).eqns
        return call.replace(invars=eqn.invars, outvars=eqn.outvars)

    def within(x):
        return rounded_as_in_graphs(x, has_plain_products) if isinstance(x, ClosedJaxpr) else x

    params = jax.tree.map(within, eqn.params)
    both = zip(jax.tree.leaves(params), jax.tree.leaves(eqn.params), strict=True)
    return eqn if all(a is b for a, b in both) else eqn.replace(params=params)


def _own(eqn, has_plain_products: bool) -> Callable | None:
    """What stands for an operation, if there is such."""
    name = eqn.primitive.name
    if eqn.outvars[0].aval.dtype.kind != "f":
        return None
    if name in _SUMS:
        summed = eqn.params["axes"] if name == "reduce_sum" else eqn.params["dimension_numbers"][0][0]
        sizes = [eqn.invars[0].aval.shape[k] for k in summed]
        return _SUMS[name] if floats.is_sized(sizes) and 0 < math.prod(sizes) <= MOST_TERMS else None
    return _FACTORS.get(name) or (_ELEMENTWISE.get(name) if has_plain_products else None)


def _dot_general(x: jax.Array, y: jax.Array, *, dimension_numbers, **_) -> jax.Array:
    (terms_x, terms_y), (batches_x, batches_y) = dimension_numbers

    def factors(x: jax.Array, terms: Sequence[int], batches: Sequence[int]) -> tuple[jax.Array, list[int]]:
        """(terms, batches, what is left as one axis), and the sizes of what is left."""
        n, first = len(terms), len(terms) + len(batches)
        x = jnp.moveaxis(x, (*terms, *batches), range(first))
        rest = x.shape[first:]
        return x.reshape((math.prod(x.shape[:n]), *x.shape[n:first], math.prod(rest))), list(rest)

    (a, of_x), (b, of_y) = factors(x, terms_x, batches_x), factors(y, terms_y, batches_y)

    def term(k: jax.Array | int) -> jax.Array:
        row, column = (lax.dynamic_index_in_dim(f, k, keepdims=False) for f in (a, b))
        return barrier.product(row[..., :, None], column[..., None, :])

    return _total(term, len(a)).reshape((*a.shape[1:-1], *of_x, *of_y))


def _reduce_sum(x: jax.Array, *, axes, **_) -> jax.Array:
    rows = jnp.moveaxis(x, axes, range(len(axes)))
    rows = rows.reshape((math.prod(rows.shape[: len(axes)]), *rows.shape[len(axes) :]))
    return _total(lambda k: lax.dynamic_index_in_dim(rows, k, keepdims=False), len(rows))


def _total(term: Callable, n: int) -> jax.Array:
    """The sum of n terms, one by one, from 0 on where there are several."""
    first = term(0)
    return first if n == 1 else lax.fori_loop(0, n, lambda k, total: total + term(k), jnp.zeros_like(first))


def _cholesky(A: jax.Array, **_) -> jax.Array:
    """L of L L^T, column by column; NaN from the first pivot on that is not positive."""
    i, j = (lax.broadcasted_iota(np.int32, A.shape, axis) for axis in (A.ndim - 2, A.ndim - 1))

    def turn(k: jax.Array, A: jax.Array) -> jax.Array:
        """Column k becomes that of L, and its products are subtracted from the columns behind it."""
        column = lax.dynamic_index_in_dim(A, k, -1)
        square = lax.dynamic_index_in_dim(column, k, -2)
        pivot = jnp.where(square > 0, barrier.root(square), np.array(np.nan, A.dtype))
        of_L = barrier.quotient(column, jnp.broadcast_to(pivot, column.shape))
        rest = A - barrier.product(of_L, of_L.mT)
        return jnp.where(j < k, A, jnp.where(j > k, rest, jnp.where(i > k, of_L, pivot)))

    return jnp.where(i >= j, lax.fori_loop(0, A.shape[-1], turn, A), np.zeros((), A.dtype))


def _triangular_solve(a: jax.Array, b: jax.Array, **how) -> jax.Array:
    """x of a x = b, or of x a = b, by substitution, row by row."""
    n, is_transposed = a.shape[-1], how["transpose_a"] != (not how["left_side"])
    a, x = (a.mT if is_transposed else a), (b if how["left_side"] else b.mT)
    is_forward, i = how["lower"] != is_transposed, lax.broadcasted_iota(np.int32, x.shape, x.ndim - 2)

    def turn(k: jax.Array, x: jax.Array) -> jax.Array:
        """Row k becomes that of x, and its products are subtracted from the rows that come after it."""
        k = k if is_forward else n - 1 - k
        column, row = lax.dynamic_index_in_dim(a, k, -1), lax.dynamic_index_in_dim(x, k, -2)
        if not how["unit_diagonal"]:
            row = barrier.quotient(row, jnp.broadcast_to(lax.dynamic_index_in_dim(column, k, -2), row.shape))
        rest = x - barrier.product(column, row)
        return jnp.where(i == k, row, jnp.where(i > k if is_forward else i < k, rest, x))

    x = lax.fori_loop(0, n, turn, x)
    return x if how["left_side"] else x.mT


def _square(x: jax.Array, *, y: int = 2, **_) -> jax.Array:
    return barrier.product(x, x) if y == 2 else lax.integer_pow(x, y)


_FACTORS: dict[str, Callable] = {"cholesky": _cholesky, "triangular_solve": _triangular_solve}
_SUMS: dict[str, Callable] = {"dot_general": _dot_general, "reduce_sum": _reduce_sum}
_ELEMENTWISE: dict[str, Callable] = {
    "div": lambda a, b, **_: barrier.quotient(*jnp.broadcast_arrays(a, b)),
    "integer_pow": _square,
    "mul": lambda a, b, **_: barrier.product(*jnp.broadcast_arrays(a, b)),
    "sqrt": lambda x, **_: barrier.root(x),
    "square": _square,
}
