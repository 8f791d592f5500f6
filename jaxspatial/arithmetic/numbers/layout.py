"""Arrays of components taken apart into lanes, and lanes picked together again.

Lanes are picked by the index along their axis. XLA CPU unrolls and vectorises that; a concatenation of the same lanes
it does not, nor a sum of arrays that are zero but for one lane, which the pull-back of slices would be: both take 3 to
10 times as long. Hence two primitives, each the transpose of the other.
"""

import functools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

from jaxspatial.arithmetic.errorfree.primitives import Rule, alike, compiled, is_zero, no_tangent, rule


def apart(x: Array) -> list[Array]:
    """The components of an array (*batch, n), a list of arrays (*batch,)."""
    return _apart_p.bind(x, axis=x.ndim - 1)


def together(lanes: Sequence[Array], axis: int) -> Array:
    """The lanes, of one shape and dtype, as one array with a new axis."""
    return _together_p.bind(*alike(*lanes), axis=axis)[0]


def picked(axis: int, lanes: Sequence[Array | None]) -> Array:
    """The lanes, None for 0, as one array with a new axis: `together`, in the program of a primitive."""
    like = next(x for x in lanes if x is not None)
    shape = (*like.shape[:axis], len(lanes), *like.shape[axis:])
    index = lax.broadcasted_iota(np.int32, shape, axis)
    full = (jnp.zeros_like(like) if x is None else x for x in lanes)
    wide = [jnp.broadcast_to(lax.expand_dims(x, [axis]), shape) for x in full]
    found = wide[-1]
    for k in reversed(range(len(wide) - 1)):
        found = lax.select(index == k, wide[k], found)
    return found


# -- the primitives ---------------------------------------------------------------------------------------------------


def _without(entries: Sequence[Any], axis: int) -> tuple[Any, ...]:
    return (*entries[:axis], *entries[axis + 1 :])


def _with(entries: Sequence[Any], axis: int, entry: Any) -> tuple[Any, ...]:
    return (*entries[:axis], entry, *entries[axis:])


def _like(x: Any, shape: tuple[int, ...], spec: Sequence[Any]) -> Any:
    sharding = x.sharding.update(spec=jax.sharding.PartitionSpec(*spec))
    return x.update(shape=tuple(shape), sharding=sharding, weak_type=False)


def _abstract_apart(x: Any, *, axis: int) -> list[Any]:
    return [_like(x, _without(x.shape, axis), _without(x.sharding.spec, axis))] * x.shape[axis]


def _abstract_together(*lanes: Any, axis: int) -> list[Any]:
    x = lanes[0]
    return [_like(x, _with(x.shape, axis, len(lanes)), _with(x.sharding.spec, axis, None))]


def _lowered_apart(x: Array, *, axis: int) -> list[Array]:
    return [lax.index_in_dim(x, k, axis, keepdims=False) for k in range(x.shape[axis])]


def _lowered_together(*lanes: Array, axis: int, **_: Any) -> list[Array]:
    return [picked(axis, lanes)]


def _batch_apart(arguments: Sequence[Array], axes: Sequence[int], *, axis: int) -> tuple[list[Array], list[int]]:
    (x,), (at,) = arguments, axes
    whole = axis + (at <= axis)
    return _apart_p.bind(x, axis=whole), [at - (whole < at)] * x.shape[whole]


def _batch_together(lanes: Sequence[Array], axes: Sequence[int | None], *, axis: int) -> tuple[list[Array], list[int]]:
    given = {at for at in axes if at is not None}
    at = given.pop() if len(given) == 1 else 0
    size = next(x.shape[i] for x, i in zip(lanes, axes, strict=True) if i is not None)
    lanes = [_batched(x, i, at, size) for x, i in zip(lanes, axes, strict=True)]
    whole, found = (axis + 1, at) if at <= axis else (axis, at + 1)
    return _together_p.bind(*alike(*lanes), axis=whole), [found]


def _batched(x: Array, axis: int | None, at: int, size: int) -> Array:
    if axis is not None:
        return jnp.moveaxis(x, axis, at)
    return jnp.broadcast_to(lax.expand_dims(x, [at]), _with(x.shape, at, size))


def _transposed_apart(cotangents: Sequence[Any], x: Any, *, axis: int) -> list[Any]:
    if all(map(is_zero, cotangents)):
        return [no_tangent(x.aval)]
    return [together([_instantiated(c) for c in cotangents], axis)]


def _transposed_together(cotangents: Sequence[Any], *lanes: Any, axis: int) -> list[Any]:
    (cotangent,) = cotangents
    return [None] * len(lanes) if is_zero(cotangent) else _apart_p.bind(cotangent, axis=axis)


def _instantiated(tangent: Any) -> Array:
    return jnp.zeros(tangent.aval.shape, tangent.aval.dtype) if is_zero(tangent) else tangent


def _linear(name: str, abstract: Rule, lowered: Rule, transposed: Rule, batched: Rule) -> Any:
    primitive: Any = Primitive(f"jaxspatial_{name}")
    primitive.multiple_results = True
    primitive.def_abstract_eval(abstract)
    program = functools.cache(functools.partial(compiled, primitive))

    def call(*arrays: Array, axis: int) -> Any:
        return program(axis=axis)(*arrays)

    primitive.def_impl(call)
    mlir.register_lowering(primitive, rule(lowered))
    ad.primitive_jvps[primitive] = functools.partial(_moved, primitive)
    ad.primitive_transposes[primitive] = transposed
    batching.primitive_batchers[primitive] = batched
    return primitive


def _moved(
    primitive: Any, primals: Sequence[Array], tangents: Sequence[Any], *, axis: int
) -> tuple[list[Array], list[Any]]:
    """It is linear: tangents go the same way."""
    results = primitive.bind(*primals, axis=axis)
    if all(map(is_zero, tangents)):
        return results, [no_tangent(x) for x in results]
    return results, primitive.bind(*alike(*map(_instantiated, tangents)), axis=axis)


_apart_p = _linear("apart", _abstract_apart, _lowered_apart, _transposed_apart, _batch_apart)
_together_p = _linear("together", _abstract_together, _lowered_together, _transposed_together, _batch_together)
