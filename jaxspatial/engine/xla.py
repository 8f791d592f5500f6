"""Prepares a trace for XLA, which compiles it where machine code of our own cannot be called.

Results keep the bits of that code, and XLA takes seconds where it would take minutes.
"""

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.numerics.errorfree import barrier
from jaxspatial.numerics.errorfree.primitives import not_inlined
from jaxspatial.numerics.jax_internals import ClosedJaxpr, Literal, jaxpr_as_fun

# XLA compiles a long trace for CPUs in parts of this many operations.
PART = 400


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


# -- factors of matrices -----------------------------------------------------------------------------------------------


def with_own_factors(closed: ClosedJaxpr) -> ClosedJaxpr:
    """A trace in which Cholesky's method and substitution are loops, rounded as `graph` has them.

    The libraries that XLA calls for both round in another order, which differs between machines.
    """
    eqns = [_with_own_factors(eqn) for eqn in closed.jaxpr.eqns]
    if all(a is b for a, b in zip(eqns, closed.jaxpr.eqns, strict=True)):
        return closed
    unnamed = closed.jaxpr.debug_info.with_unknown_names()
    return ClosedJaxpr(closed.jaxpr.replace(eqns=eqns, debug_info=unnamed), closed.consts)


def _with_own_factors(eqn):
    """An operation, or a call of the loop in its place; the same object where nothing changes."""
    if eqn.primitive.name in _LOOPS:
        loop = functools.partial(_LOOPS[eqn.primitive.name], **eqn.params)
        (call,) = jax.make_jaxpr(jax.jit(loop))(*(x.aval for x in eqn.invars)).eqns
        return call.replace(invars=eqn.invars, outvars=eqn.outvars)
    params = jax.tree.map(lambda x: with_own_factors(x) if isinstance(x, ClosedJaxpr) else x, eqn.params)
    both = zip(jax.tree.leaves(params), jax.tree.leaves(eqn.params), strict=True)
    return eqn if all(a is b for a, b in both) else eqn.replace(params=params)


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


_LOOPS = {"cholesky": _cholesky, "triangular_solve": _triangular_solve}
