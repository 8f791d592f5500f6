"""How primitives are made: elementwise ones, of arrays of one shape; compiled, lowered, and with shardings."""

import contextlib
import functools
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.sharding import AxisType

from jaxspatial.numerics.jax_internals import (
    Primitive,
    ShapedArray,
    ad,
    batching,
    def_linearization,
    eval_context,
    mlir,
    set_xla_metadata,
)

T = TypeVar("T")
Tangent = Array | ad.Zero
lower_fun = cast(Callable, mlir.lower_fun)
_NO_MESH = jax.sharding.AbstractMesh((), ())


def elementwise(
    name: str,
    like,
    lower: Callable,
    jvp: Callable | None = None,
    transpose: Callable | None = None,
    tangent: Callable | None = None,
    n_results: int | None = None,
):
    """A primitive with the shapes, shardings and complaints of the lax primitive `like` for the first two arguments.

    One of these may be a number without a shape: it stands for as many as the other has, see `over_one_shape`.
    tangent: tangent(result, primals, tangents) in place of jvp, where all that it computes is linear in the tangents.
    n_results: how many arrays a list of results has; None for one array.
    """
    primitive = Primitive(f"jaxspatial_{name}")
    primitive.multiple_results = n_results is not None

    def abstract(*arrays):
        first = arrays[:2]
        shaped = [a for a in first if a.shape]
        is_with_number = len(shaped) == 1 < len(first) and first[0].dtype == first[1].dtype
        result = like.abstract_eval(*(shaped * 2 if is_with_number else first))[0]
        return result if n_results is None else [result] * n_results

    def batch(args: Sequence[Array], axes: Sequence[int | None]):
        results = primitive.bind(*same_sharding(*_batched(args, axes)))
        return results, 0 if n_results is None else [0] * n_results

    primitive.def_abstract_eval(abstract)
    primitive.def_impl(compiled(primitive))
    mlir.register_lowering(primitive, lower)
    if tangent:
        ad.primitive_jvps[primitive] = lambda x, dx: (result := primitive.bind(*x), tangent(result, x, dx))
        def_linearization(primitive, tangent)
    elif jvp:
        ad.primitive_jvps[primitive] = jvp
    if transpose:
        ad.primitive_transposes[primitive] = transpose
    batching.primitive_batchers[primitive] = batch
    return primitive


def compiled(primitive, **parameters) -> Callable:
    """The primitive outside of a program: one of its own, also where `jax.disable_jit` is on."""

    def bound(*arrays: Array):
        return primitive.bind(*arrays, **parameters)

    # Where `jax_debug_nans` finds a NaN, JAX runs a function again, operation by operation. That this one is an
    # operation it knows from a mark of its own: without it the search would not end.
    vars(bound).update(_apply_primitive=True)
    bound.__qualname__ = primitive.name
    program = cast(Callable, jax.jit(bound))

    def call(*arrays: Array):
        with jax.disable_jit(False):
            return program(*arrays)

    return call


def same_sharding(*arrays: Array, components: int | None = None) -> Sequence[Array]:
    """The arrays, varying over the same axes of a `shard_map` and sharded in one way; lax.mul does this for itself.

    Under explicit sharding, an argument that is whole along an axis is split as the others are; not where it has one
    item for all of theirs. components: the axis along which arrays differ in size without that.
    """
    types = list(map(jax.typeof, arrays))
    if types.count(types[0]) == len(types):
        return arrays
    varied = varying_alike(arrays)
    specs = [jax.typeof(x).sharding.spec for x in varied]
    if all(spec == specs[0] for spec in specs):
        return varied
    sizes = [max(n) for n in zip(*(x.shape for x in arrays), strict=True)]
    common, ours = common_spec(specs), range(len(sizes))
    split = [[common[i] if x.shape[i] == sizes[i] or i == components else None for i in ours] for x in arrays]
    wanted = [jax.sharding.PartitionSpec(*entries) for entries in split]
    # By name of the mesh, which is nobody's context where only arguments have it.
    mesh = next(t.sharding.mesh for t in types if not t.sharding.mesh.empty)
    return [
        x if w == s else jax.sharding.reshard(x, jax.NamedSharding(mesh, w))
        for x, s, w in zip(varied, specs, wanted, strict=True)
    ]


def varying_alike(arrays: Sequence) -> Sequence:
    """The arrays, all varying over the axes of a `shard_map` over which any of them does. So the cotangent of one that
    does not is summed over these axes."""
    # Every call comes here: `jax.typeof` of NumPy's arrays would take microseconds.
    none: frozenset[Any] = frozenset()
    varying: list[frozenset[Any]] = [x.aval.mat.varying if hasattr(x, "aval") else none for x in arrays]
    if not any(varying):
        return arrays
    missing = [tuple(none.union(*varying) - axes) for axes in varying]
    return [lax.pcast(x, m, to="varying") if m else x for x, m in zip(arrays, missing, strict=True)]


def common_spec(specs: Iterable) -> list:
    """For every axis what one of the specs has there."""
    return [next((s for s in entries if s is not None), None) for entries in zip(*specs, strict=True)]


def _batched(arguments: Sequence[Array], axes: Sequence[int | None]) -> Iterator[Array]:
    """The arguments with the batch axis first; one without it repeated, so that its cotangents are summed."""
    size = next(x.shape[axis] for x, axis in zip(arguments, axes, strict=True) if axis is not None)
    items = [x.shape if axis is None else np.delete(x.shape, axis) for x, axis in zip(arguments, axes, strict=True)]
    shape = max(items, key=len)
    for x, axis, item in zip(arguments, axes, items, strict=True):
        y = lax.broadcast(x, (size,)) if axis is None else jnp.moveaxis(x, axis, 0)
        # A number beside arrays: of each item another one.
        yield y if len(item) == len(shape) else lax.broadcast_in_dim(y, (size, *shape), (0,))


def over_one_shape(*arrays: Array) -> Sequence[Array]:
    """The arrays, a number without a shape repeated for those of the others."""
    shape = max((x.shape for x in arrays), key=len)
    return [x if x.shape == shape or x.shape else lax.broadcast(x, shape) for x in arrays]


class _Calls(threading.local):
    are_inlined = False


_calls = _Calls()


@contextlib.contextmanager
def inlined_calls() -> Iterator[None]:
    """What is traced meanwhile has no call of `not_inlined`. Programs that become machine code of our own need none,
    and on GPUs XLA fuses nothing in a call: each of its operations would be a kernel."""
    before, _calls.are_inlined = _calls.are_inlined, True
    try:
        yield
    finally:
        _calls.are_inlined = before


def not_inlined(function: Callable, *arguments):
    """function(*arguments), as a call that the compiler does not inline, unless `inlined_calls`."""
    if _calls.are_inlined:
        return function(*arguments)

    def jaxspatial_call(*arguments):
        return function(*arguments)

    with set_xla_metadata(inlineable="false"):
        return cast(Any, jax.jit(jaxspatial_call))(*arguments)


def choice(number: float, shape: tuple[int, ...], dtype) -> Array:
    """An infinity or NaN over a shape, for a select. Before it is selected, JAX's options `jax_debug_nans` and
    `jax_debug_infs` are not to find it."""
    with jax.debug_nans(False), jax.debug_infs(False):
        return lax.full(shape, number, dtype)


def is_zero(tangent: object) -> bool:
    return type(tangent) is ad.Zero


def no_tangent(x):
    return ad.Zero(jax.typeof(x).to_tangent_aval())


def rule(function: Callable[..., Sequence[Array]]) -> Callable:
    """The lowering rule of a primitive: `function(*arrays, **parameters)` returns a list of arrays."""
    return functools.partial(unsharded, lower_fun(function, multiple_results=True))


@contextlib.contextmanager
def computed_at_once() -> Iterator[None]:
    """What is computed of known numbers meanwhile is known, whatever JAX is in the middle of: a trace, or a `shard_map`
    outside of `jit`. Traced numbers may not come in."""
    with eval_context(), jax.ensure_compile_time_eval(), jax.sharding.use_abstract_mesh(_NO_MESH):
        yield


def of_any_mesh(function: Callable[..., T]) -> Callable[..., T]:
    """The function, in which constants have no sharding, and go with arrays that are split along explicit axes. Those
    of the mesh in the context would be whole."""

    @functools.wraps(function)
    def call(*arguments, **options):
        types = jax.sharding.get_abstract_mesh().axis_types
        if AxisType.Explicit not in types or AxisType.Manual in types:
            return function(*arguments, **options)
        with jax.sharding.use_abstract_mesh(_NO_MESH):
            return function(*arguments, **options)

    return call


def n_devices(context) -> int:
    """Over how many devices the compiler may split what is lowered."""
    return getattr(context.module_context.axis_context, "num_devices", 1) or 1


def unsharded(lower: Callable, context, *arrays, **parameters):
    """What `lower`, a `lower_fun`, lowers its function to, traced without shardings and manual axes in the types: the
    arithmetic is elementwise, for the compiler to split. (With them, every constant and index made on the way would
    have to be sharded by hand.)"""
    with jax.sharding.use_abstract_mesh(_NO_MESH):
        plain = [ShapedArray(a.shape, a.dtype) for a in context.avals_in]
        return lower(context.replace(avals_in=plain), *arrays, **parameters)
