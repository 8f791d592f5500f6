"""The primitive of programs: the one place where what `vmap`, `jvp` and transposition do to an algorithm is decided.

A batch that leaves the cache runs in blocks that stay in it, on processors.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxspatial.arithmetic.errorfree.primitives import compiled, lower_fun, unsharded
from jaxspatial.arithmetic.errorfree.primitives import is_zero as is_zero
from jaxspatial.arithmetic.errorfree.primitives import no_tangent as no_tangent
from jaxspatial.dynamics.program import Aval, Program


def bind(program: Program, arrays: Sequence[Any], n_batch: int) -> list[Any]:
    """The results (*batch, ...) of arrays that have n_batch axes in front, of size 1 where they do not vary."""
    arrays = [c if not is_zero(c) else zeros(c.aval) for c in arrays]
    return list(_program_p.bind(*arrays, program=program, n_batch=n_batch))


def _abstract(*avals: Any, program: Program, n_batch: int) -> list[Any]:
    batch = np.broadcast_shapes(*(a.shape[:n_batch] for a in avals))
    items = [jax.ShapeDtypeStruct(a.shape[n_batch:], a.dtype) for a in avals]
    size = block_size(math.prod(batch), program.block)
    sizes = [size if math.prod(a.shape[:n_batch]) > 1 else 1 for a in avals]
    specs = [a.sharding.spec for a in avals]
    common = [next((s[k] for s in specs if s[k] is not None), None) for k in range(n_batch)]
    varying = frozenset[Any]().union(*(a.mat.varying for a in avals))
    found: list[Any] = []
    for i, (shape, dtype) in enumerate(program.outputs(items, sizes)):
        owner = program.owner(i)
        if owner is not None:
            found.append(avals[owner].update(weak_type=False))
            continue
        like, spec = avals[0], jax.sharding.PartitionSpec(*common, *[None] * len(shape))
        sharding = like.sharding.update(spec=spec)
        aval = like.update(shape=(*batch, *shape), dtype=dtype, weak_type=False, sharding=sharding)
        if varying:
            aval = aval.update(manual_axis_type=like.mat.update(varying=varying))
        found.append(aval)
    return found


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], *, program: Program, n_batch: int):
    return program.jvp(list(primals), list(tangents), n_batch)


def _transpose(cotangents: Sequence[Any], *arguments: Any, program: Program, n_batch: int):
    return program.transposed(list(cotangents), list(arguments), n_batch)


def _batch(arrays: Sequence[Any], axes: Sequence[int | None], *, program: Program, n_batch: int):
    """The new axis in front of those there are."""
    size = next(x.shape[axis] for x, axis in zip(arrays, axes, strict=True) if axis is not None)
    found = program.batched(arrays, axes, size, n_batch)
    if found is None:
        own = map(program.needs_own, range(len(arrays)))
        found = bind(program, list(map(batch_axis_first, arrays, axes, itertools.repeat(size), own)), n_batch + 1)
    return found, [0] * len(found)


def batch_axis_first(x: jax.Array, axis: int | None, size: int, is_own: bool):
    if axis is not None:
        return jnp.moveaxis(x, axis, 0)
    return jnp.broadcast_to(x, (size, *x.shape)) if is_own else x[None]


def over_own(x: jax.Array, aval: Aval):
    """A cotangent over the batch of what it is the cotangent of."""
    axes = [k for k, (a, b) in enumerate(zip(x.shape, aval.shape, strict=True)) if a != b]
    return x.sum(axes, keepdims=True) if axes else x


def zeros(aval: Aval):
    return lax.full(aval.shape, 0, aval.dtype)


# -- running it -------------------------------------------------------------------------------------------------------


def run(program: Program, n_batch: int, in_blocks: bool, *arrays: jax.Array) -> list[jax.Array]:
    """With one axis of states, in blocks where so asked."""
    batch = np.broadcast_shapes(*(x.shape[:n_batch] for x in arrays))
    columns = program.columns(arrays, n_batch) if in_blocks else []
    if columns:
        return [_over_columns(program.over_columns(), columns, n_batch, arrays)]
    flat = [_flat(x, n_batch, batch) for x in arrays]
    found = _in_blocks(program, program.block if in_blocks else math.prod(batch), math.prod(batch), flat)
    return [_unflat(y, program.owner(i), arrays, n_batch, batch) for i, y in enumerate(found)]


def _over_columns(program: Program, axes: list[int], n_batch: int, arrays: Sequence[jax.Array]):
    """With columns, along these axes of the batch, as an axis behind the states."""
    *own, last = arrays
    states = [k for k in range(n_batch) if k not in axes]
    shape, sizes = last.shape[:n_batch], [last.shape[k] for k in axes]
    last = jnp.transpose(last, (*states, *axes, n_batch))
    last = last.reshape((*(shape[k] for k in states), math.prod(sizes), -1))
    (found,) = run(program, len(states), True, *(x.reshape(np.delete(x.shape, axes)) for x in own), last)
    found = found.reshape((*found.shape[: len(states)], *sizes, -1))
    return jnp.transpose(found, (*np.argsort([*states, *axes]), n_batch))


def _flat(x: jax.Array, n_batch: int, batch: tuple[int, ...]):
    """(B, ...), or (1, ...) where no axis of the batch varies."""
    own = x.shape[:n_batch]
    if math.prod(own) > 1 and own != batch:
        x, own = jnp.broadcast_to(x, (*batch, *x.shape[n_batch:])), batch
    return x.reshape((math.prod(own), *x.shape[n_batch:]))


def _unflat(y: jax.Array, owner: int | None, arrays: Sequence[jax.Array], n_batch: int, batch: tuple[int, ...]):
    if owner is None:
        return y.reshape((*batch, *y.shape[1:]))
    own = arrays[owner].shape[:n_batch]
    if y.shape[0] == math.prod(own):
        return y.reshape((*own, *y.shape[1:]))
    whole = y.reshape((*batch, *y.shape[1:]))
    over = tuple(k for k, (a, b) in enumerate(zip(own, batch, strict=True)) if a != b)
    return whole.sum(over, keepdims=True) if over else whole


def block_size(n: int, block: int):
    """How many of n states make a block."""
    return -(-n // -(-n // block)) if n else n


def _in_blocks(program: Program, block: int, n: int, arrays: Sequence[jax.Array]) -> list[jax.Array]:
    n_blocks = -(-n // block) if block else 1
    if n_blocks < 2:
        return program.traced([_aval(x) for x in arrays])(*arrays)
    size = block_size(n, block)
    varies = [x.shape[0] > 1 for x in arrays]
    filled = [
        _blocks(x, size, n_blocks, program.takes_cotangent(i)) if yes else x
        for i, (x, yes) in enumerate(zip(arrays, varies, strict=True))
    ]
    avals = [_aval(x[0] if yes else x) for x, yes in zip(filled, varies, strict=True)]
    one = program.traced(avals)
    adds = [(k := program.owner(i)) is not None and not varies[k] for i in range(len(one.out_avals))]

    def body(sums: list[jax.Array], own: Iterable[jax.Array]):
        own = iter(own)
        found = one(*(next(own) if yes else x for x, yes in zip(filled, varies, strict=True)))
        sums = [s + y for s, y in zip(sums, [y for y, yes in zip(found, adds, strict=True) if yes], strict=True)]
        return sums, [y for y, yes in zip(found, adds, strict=True) if not yes]

    start = [zeros(a) for a, yes in zip(one.out_avals, adds, strict=True) if yes]
    sums, stacked = lax.scan(body, start, [x for x, yes in zip(filled, varies, strict=True) if yes])
    sums, stacked = iter(sums), iter(stacked)
    return [next(sums) if yes else _joined(next(stacked), n) for yes in adds]


def _blocks(x: jax.Array, size: int, n_blocks: int, is_cotangent: bool):
    """(n_blocks, size, ...): filled up with the last state, and zeros of its cotangents."""
    missing = size * n_blocks - x.shape[0]
    if missing:
        last = jnp.broadcast_to(x[-1:], (missing, *x.shape[1:]))
        x = jnp.concatenate([x, jnp.zeros_like(last) if is_cotangent else last])
    return x.reshape((n_blocks, size, *x.shape[1:]))


def _joined(x: jax.Array, n: int):
    return x.reshape((-1, *x.shape[2:]))[:n]


def _aval(x: jax.Array):
    return jax.ShapeDtypeStruct(x.shape, x.dtype)


def _lowering(in_blocks: bool) -> Callable[..., Any]:
    def rule(context: Any, *arrays: Any, program: Program, n_batch: int) -> Any:
        lower = lower_fun(functools.partial(run, program, n_batch, in_blocks), multiple_results=True)
        return unsharded(lower, context, *arrays)

    return rule


@functools.lru_cache(maxsize=64)
def _compiled(program: Program, n_batch: int) -> Callable[..., list[jax.Array]]:
    return compiled(_program_p, program=program, n_batch=n_batch)


def _alone(*arrays: jax.Array, program: Program, n_batch: int):
    """The results outside of any transformation."""
    return _compiled(program, n_batch)(*arrays)


_program_p: Any = Primitive("jaxspatial_program")
_program_p.multiple_results = True
_program_p.def_abstract_eval(_abstract)
_program_p.def_impl(_alone)
mlir.register_lowering(_program_p, _lowering(False))
mlir.register_lowering(_program_p, _lowering(True), platform="cpu")
ad.primitive_jvps[_program_p] = _jvp
ad.primitive_transposes[_program_p] = _transpose
batching.primitive_batchers[_program_p] = _batch
