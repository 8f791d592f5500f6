"""Programs over batches, and the primitive that runs them: what `vmap`, `jvp` and transposition do is decided here.

An algorithm is one primitive. Its formula sees a single axis of states, innermost in memory, however often and along
whichever axes a caller maps it: (L, W, B), L joints along a chain, W chains, B states. On CPUs and NVIDIA GPUs it is
traced for one state, and the trace becomes machine code for several states side by side: see `graph`, `llvm_ir`, `cpu`
and `cuda`. Elsewhere, and where a trace has what a graph has not, XLA compiles the trace, as `xla` prepares it.
"""

import contextlib
import functools
import gc
import itertools
import math
import weakref
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.engine import cpu, cuda, graph, xla
from jaxspatial.engine.machine import Argument, Machine, Result
from jaxspatial.numerics import floats
from jaxspatial.numerics.errorfree.primitives import (
    compiled,
    inlined_calls,
    is_zero,
    lower_fun,
    n_devices,
    unsharded,
    varying_alike,
)
from jaxspatial.numerics.jax_internals import (
    ClosedJaxpr,
    Primitive,
    ad,
    batching,
    held_weakly,
    jaxpr_as_fun,
    mlir,
    partial_eval,
)
from jaxspatial.numerics.sums.primitive import trace_of_sums

T = TypeVar("T")
Aval = jax.ShapeDtypeStruct
# Numbers of a table that each state has of its own. Of more, machine code would copy all to read a few.
OWN_TABLE = 256


class Program:
    """What the primitive runs. A subclass implements `evaluate` and `outputs`."""

    # Whether it computes in 64 bits, whatever the dtype of the caller. Its derivatives are then traced in 64 bits too,
    # and so are programs that take 64-bit numbers from it.
    is_wide = False
    # Whether products of JAX stand in its trace beside those of formulas, which say themselves how they round.
    has_plain_products = False

    def __init_subclass__(cls):
        held_weakly(cls)

    @property
    def may_fuse(self) -> bool:
        """Whether `a * b + c` may be rounded once: where it promises errors, and no bits."""
        return self.is_wide

    @functools.cached_property
    def _derived(self) -> dict[Hashable, Any]:
        # Of several threads that ask at once, all get the first.
        return vars(self).setdefault("_derived", {})

    def cached(self, key: Hashable, maker: Callable[[], T]) -> T:
        """A derivative, trace or code of this program, made once by `maker`; it lives as long as the program."""
        found = self._derived
        return found[key] if key in found else found.setdefault(key, maker())

    def compiled_primitive(self, n_batch: int) -> Callable[..., list[jax.Array]]:
        """The primitive with this program, outside of any other program: a function of arrays."""

        def made() -> Callable[..., list[jax.Array]]:
            return compiled(program_p, program=InJaxCaches(self), n_batch=n_batch)

        return self.cached(("primitive", n_batch), made)

    def traced(self, avals: Sequence[Aval]) -> "Traced":
        """The trace of the program, made once for the same shapes.

        Symbols of `jax.export` are of one export, and not even compared with those of another.
        """
        in_64_bits = self.is_wide or bool(floats.config.jax_enable_x64)
        if not all(floats.is_sized(a.shape) for a in avals):
            return Traced(self, avals, in_64_bits)
        key = tuple((a.shape, np.dtype(a.dtype).name) for a in avals), in_64_bits
        return self.cached(key, lambda: Traced(self, avals, in_64_bits))

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        """The results for arrays (B, ...), or (1, ...) where all states share one."""
        raise NotImplementedError

    def from_outside(self, x: jax.Array) -> jax.Array:
        """An argument as an operand: behind a barrier where bits are promised, or rounding errors computed."""
        raise NotImplementedError

    def outputs(self, avals: Sequence[Aval]) -> list[Aval]:
        """The results, without the batch, of arguments without it."""
        raise NotImplementedError

    def primal_of(self, i: int) -> int | None:
        """The argument whose cotangent result i is, and whose batch it has; None for results over all states."""
        return None

    def needs_all_states(self, i: int) -> bool:
        """Whether argument i must be repeated for every state, because its cotangents must not be summed."""
        return False

    def columns(self, arrays: Sequence[jax.Array], n_batch: int) -> list[int]:
        """The axes of the batch along which only the last argument varies, if a loop over them is faster than a batch
        on CPUs."""
        return []

    def over_columns(self) -> "Program":
        """The program for a last argument, and a result, with an axis of such columns behind the states."""
        raise NotImplementedError

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int) -> list | None:
        """The results along a new axis in front, if there is a faster way than more states; else None."""
        return None

    def jvp(self, primals: list, tangents: list, n_batch: int) -> tuple[list, list]:
        """(results, their tangents)."""
        raise NotImplementedError

    def transposed(self, cotangents: list, arguments: list, n_batch: int) -> list:
        """The cotangents of the arguments that are linear, None for others."""
        raise NotImplementedError


class InJaxCaches:
    """A program as an operand of functions that it holds itself, compiled. JAX's caches keep what such a function was
    traced with for as long as the function: were that the program, neither would ever be freed."""

    def __init__(self, program: Program):
        self._program = weakref.ref(program)

    def __getattr__(self, name: str):
        return getattr(self._program(), name)


class Traced:
    """The trace of a program, without dead code."""

    def __init__(self, program: Program, avals: Sequence[Aval], in_64_bits: bool):
        with jax.enable_x64(in_64_bits), inlined_calls(), _without_collection():
            closed = jax.make_jaxpr(lambda *arrays: list(program.evaluate(*arrays)))(*avals)
        jaxpr, _ = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars), instantiate=True)
        self.closed = ClosedJaxpr(jaxpr, closed.consts)
        self.out_avals = closed.out_avals
        self.has_plain_products = program.has_plain_products

    def __call__(self, *arrays: jax.Array) -> list[jax.Array]:
        with jax.enable_x64(True):
            return jaxpr_as_fun(self._for_xla())(*arrays)

    def in_parts(self, *arrays: jax.Array) -> list[jax.Array]:
        """The same, as XLA compiles it soonest for CPUs: see `xla.in_parts`."""
        with jax.enable_x64(True):
            return xla.in_parts(self._for_xla(), arrays)

    def _for_xla(self) -> ClosedJaxpr:
        return xla.rounded_as_in_graphs(self.closed, self.has_plain_products)

    def selected(self, wanted: Sequence[bool]) -> "Traced":
        """The trace of these results alone."""
        jaxpr, _ = partial_eval.dce_jaxpr(self.closed.jaxpr, list(wanted), instantiate=True)
        selection = object.__new__(Traced)
        selection.closed = ClosedJaxpr(jaxpr, self.closed.consts)
        selection.out_avals = list(itertools.compress(self.out_avals, wanted))
        selection.has_plain_products = self.has_plain_products
        return selection


@contextlib.contextmanager
def _without_collection() -> Iterator[None]:
    """Python's garbage collector is off meanwhile. Tracing makes many objects, nearly all of which stay, and to search
    them again and again takes a fifth of its time."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


# -- the primitive ----------------------------------------------------------------------------------------------------


def bind(program: Program, arrays: Sequence, n_batch: int) -> list:
    """The results (*batch, ...) of arrays that have n_batch axes in front, of size 1 where they do not vary."""
    arrays = [c if not is_zero(c) else zeros(c.aval) for c in arrays]
    return list(program_p.bind(*varying_alike(arrays), program=program, n_batch=n_batch))


def _abstract(*avals, program: Program, n_batch: int) -> list:
    batch = floats.broadcast_shapes(*(a.shape[:n_batch] for a in avals))
    items = [jax.ShapeDtypeStruct(a.shape[n_batch:], a.dtype) for a in avals]
    specs = [a.sharding.spec for a in avals]
    common = [next((s[k] for s in specs if s[k] is not None), None) for k in range(n_batch)]
    # Numbers of a robot may be of no mesh.
    meshed = next((a for a in avals if not a.sharding.mesh.empty), avals[0])
    varying = frozenset[Any]().union(*(a.mat.varying for a in avals))
    results: list = []
    for i, y in enumerate(program.outputs(items)):
        primal = program.primal_of(i)
        if primal is not None:
            results.append(avals[primal].update(weak_type=False))
            continue
        like, spec = avals[0], jax.sharding.PartitionSpec(*common, *[None] * y.ndim)
        sharding = meshed.sharding.update(spec=spec)
        aval = like.update(shape=(*batch, *y.shape), dtype=y.dtype, weak_type=False, sharding=sharding)
        if varying:
            aval = aval.update(manual_axis_type=like.mat.update(varying=varying))
        results.append(aval)
    return results


def _batch(arrays: Sequence, axes: Sequence[int | None], *, program: Program, n_batch: int):
    """Batches along a new axis in front of the others."""
    size = next(x.shape[axis] for x, axis in zip(arrays, axes, strict=True) if axis is not None)
    results = program.batched(arrays, axes, size, n_batch)
    if results is None:
        every = map(program.needs_all_states, range(len(arrays)))
        results = bind(program, list(map(batch_axis_first, arrays, axes, itertools.repeat(size), every)), n_batch + 1)
    return results, [0] * len(results)


def batch_axis_first(x: jax.Array, axis: int | None, size: int, for_each: bool) -> jax.Array:
    if axis is not None:
        return jnp.moveaxis(x, axis, 0)
    return jnp.broadcast_to(x, (size, *x.shape)) if for_each else x[None]


def summed_like(x: jax.Array, aval: Aval) -> jax.Array:
    """Sums a cotangent over the axes along which its argument has size 1."""
    axes = [k for k, (a, b) in enumerate(zip(x.shape, aval.shape, strict=True)) if a != b]
    return x.sum(axes, keepdims=True) if axes else x


def zeros(aval: Aval) -> jax.Array:
    return lax.full(aval.shape, 0, aval.dtype)


# -- running a program ------------------------------------------------------------------------------------------------


class Native(NamedTuple):
    """How machine code of our own is called: by `cpu`, or by `cuda`. n_devices: over how many devices the compiler may
    split the batch. hold: keeps the code for as long as the program of XLA that calls it."""

    machine: Machine[Any]
    n_devices: int
    hold: Callable

    @classmethod
    def of(cls, context, machine: Machine[Any]) -> "Native | None":
        """In a lowering rule: None where machine code cannot be called, or is not to be, as in what is exported."""
        module = context.module_context
        if module.lowering_parameters.for_export or not machine.is_available():
            return None
        return cls(machine, n_devices(context), module.add_keepalive)


def run(
    program: Program, n_batch: int, native: Native | None, *arrays: jax.Array, in_parts: bool = False
) -> list[jax.Array]:
    """Runs a program on arrays with n_batch axes in front, flattened to one axis of states.

    native: None for XLA's way. in_parts: whether XLA compiles it for CPUs, see `xla.in_parts`.
    """
    batch = floats.broadcast_shapes(*(x.shape[:n_batch] for x in arrays))
    if floats.is_sized(batch) and math.prod(batch) == 0:
        return _of_no_states(program, n_batch, batch, arrays)
    is_on_cpu = native is not None and native.machine is cpu
    columns = program.columns(arrays, n_batch) if is_on_cpu and floats.is_sized(batch) else []
    if columns:
        return [_over_columns(program.over_columns(), columns, n_batch, native, arrays)]
    flat = [with_one_axis(x, n_batch, batch) for x in arrays]
    results = _natively(program, native, math.prod(batch), flat) if native else None
    if results is None:
        traced = program.traced(list(map(_aval, flat)))
        results = traced.in_parts(*flat) if in_parts else traced(*flat)
    return [with_callers_axes(y, program.primal_of(i), arrays, n_batch, batch) for i, y in enumerate(results)]


def _of_no_states(
    program: Program, n_batch: int, batch: tuple[int, ...], arrays: Sequence[jax.Array]
) -> list[jax.Array]:
    """Results without numbers, and cotangents that are sums of nothing."""
    items, results = [jax.ShapeDtypeStruct(x.shape[n_batch:], x.dtype) for x in arrays], list[jax.Array]()
    for i, y in enumerate(program.outputs(items)):
        primal = program.primal_of(i)
        with jax.enable_x64(True):
            results.append(lax.full((*batch, *y.shape) if primal is None else arrays[primal].shape, 0, y.dtype))
    return results


def _over_columns(
    program: Program, axes: list[int], n_batch: int, native: Native | None, arrays: Sequence[jax.Array]
) -> jax.Array:
    """Runs a program with these axes of the batch, its columns, as one axis behind the states."""
    *others, last = arrays
    states = [k for k in range(n_batch) if k not in axes]
    shape, sizes = last.shape[:n_batch], [last.shape[k] for k in axes]
    last = jnp.transpose(last, (*states, *axes, n_batch))
    last = last.reshape((*(shape[k] for k in states), math.prod(sizes), -1))
    (y,) = run(program, len(states), native, *(x.reshape(np.delete(x.shape, axes)) for x in others), last)
    y = y.reshape((*y.shape[: len(states)], *sizes, -1))
    return jnp.transpose(y, (*np.argsort([*states, *axes]), n_batch))


def with_one_axis(x: jax.Array, n_batch: int, batch: tuple[int, ...]) -> jax.Array:
    """An array (*batch, ...) as (B, ...), or as (1, ...) where no axis of the batch varies."""
    shape = x.shape[:n_batch]
    # A symbol of `jax.export` stands for any number of states.
    if (not floats.is_sized(shape) or math.prod(shape) > 1) and shape != batch:
        x, shape = jnp.broadcast_to(x, (*batch, *x.shape[n_batch:])), batch
    return x.reshape((math.prod(shape), *x.shape[n_batch:]))


def with_callers_axes(
    y: jax.Array, primal: int | None, arrays: Sequence[jax.Array], n_batch: int, batch: tuple[int, ...]
) -> jax.Array:
    """A result (B, ...) over the batch, or, of a cotangent, over the batch of its argument."""
    if primal is None:
        return y.reshape((*batch, *y.shape[1:]))
    shape = arrays[primal].shape[:n_batch]
    if y.shape[0] == math.prod(shape):
        return y.reshape((*shape, *y.shape[1:]))
    whole = y.reshape((*batch, *y.shape[1:]))
    over = tuple(k for k, (a, b) in enumerate(zip(shape, batch, strict=True)) if a != b)
    return whole.sum(over, keepdims=True) if over else whole


def n_states(arrays: Sequence[jax.Array]) -> int:
    """The number of states of arrays (B, ...), or (1, ...) where all states share one."""
    sizes = tuple(x.shape[0] for x in arrays)
    symbols = (n for n in sizes if not floats.is_sized((n,)))
    return next(symbols, None) or max(sizes, default=1)


# -- machine code ------------------------------------------------------------------------------------------------------


def _natively(program: Program, native: Native, n: int, arrays: Sequence[jax.Array]) -> list[jax.Array] | None:
    """The results for arrays (n, ...), or (1, ...) where all states share one, by machine code; None if there is none.

    A result that is the cotangent of what all states share is summed over them.
    """
    if not floats.is_sized((n,)):
        return None
    is_shared = tuple(x.shape[0] != n for x in arrays)
    code = _code_with_shapes(
        program, native.machine, [_aval(x, 1) for x in arrays], is_shared, native.machine.least_alike(n)
    )
    if code is None:
        return None
    native.hold(native.machine.compiled(code.code))
    flat = [x.reshape((x.shape[0], -1)) for x in arrays]
    results = native.machine.call(code.code, flat, n, n_devices=native.n_devices)
    return [y.reshape((y.shape[0], *shape)) for y, shape in zip(results, code.shapes, strict=True)]


class _CodeWithShapes(NamedTuple):
    """The code of a program, and the shapes of its results at one state."""

    code: Any
    shapes: list[tuple[int, ...]]


def _code_with_shapes(
    program: Program, machine: Machine[Any], avals: Sequence[Aval], is_shared: tuple[bool, ...], n: int
) -> _CodeWithShapes | None:
    """The code of a program for n states; None if its trace has what graphs have not."""

    def made() -> _CodeWithShapes | None:
        with _without_collection():
            traced = program.traced(avals)
            try:
                how = {"most_unrolled": machine.MOST_UNROLLED, "may_fuse": program.may_fuse}
                whole = graph.graph_of(traced.closed, _expanded, **how)
            except graph.NotSupportedError:
                return None
            tables = (table for table in whole.tables if table[0] not in whole.constants and n > 1)
            if any(len(x) > OWN_TABLE and not is_shared[whole.details[x[0]][0]] for x in tables):
                return None
            each = zip(avals, is_shared, strict=True)
            arguments = [Argument(math.prod(a.shape), np.dtype(a.dtype), shared) for a, shared in each]
            results: list[Result] = []
            for i, a in enumerate(traced.out_avals):
                primal = program.primal_of(i)
                is_summed = primal is not None and is_shared[primal]
                results.append(Result(math.prod(a.shape), np.dtype(a.dtype), is_summed))
            code = machine.code_of(whole, arguments, results, n)
        return _CodeWithShapes(code, [a.shape[1:] for a in traced.out_avals])

    key = tuple((a.shape, np.dtype(a.dtype).name) for a in avals), is_shared, n
    in_64_bits = bool(floats.config.jax_enable_x64)
    return program.cached(("code", machine, key, in_64_bits), made)


def _expanded(eqn, read_trace: graph.Read, nodes: list[graph.Nodes]) -> list[graph.Nodes] | None:
    """The results of a primitive of the library that stands for a trace, as nodes of a graph.

    Programs that promise errors and no bits say that sums may be fused with products.
    """
    if eqn.primitive is not program_p:
        closed = trace_of_sums(eqn)
        return None if closed is None else read_trace(closed, nodes, False)
    program, n_batch = eqn.params["program"], eqn.params["n_batch"]
    avals = [jax.ShapeDtypeStruct(v.aval.shape, v.aval.dtype) for v in eqn.invars]
    # As it is traced elsewhere, so that it need not be traced again.
    is_wide = program.is_wide or any(np.dtype(a.dtype).itemsize == 8 for a in avals)
    with jax.enable_x64(is_wide or bool(floats.config.jax_enable_x64)):
        if math.prod(floats.broadcast_shapes(*(a.shape[:n_batch] for a in avals))) != 1:
            closed = jax.make_jaxpr(functools.partial(run, program, n_batch, None))(*avals)
            return read_trace(closed, nodes, program.may_fuse)
        # Of one state: its own trace as it is.
        flat = [x.reshape((1, *x.shape[n_batch:])) for x in nodes]
        traced = program.traced([jax.ShapeDtypeStruct(x.shape, a.dtype) for x, a in zip(flat, avals, strict=True)])
    found = read_trace(traced.closed, flat, program.may_fuse)
    return [y.reshape(v.aval.shape) for y, v in zip(found, eqn.outvars, strict=True)]


def _aval(x: jax.Array, size: int | None = None) -> Aval:
    """That of an array, or of so many of its states."""
    return jax.ShapeDtypeStruct(x.shape if size is None else (size, *x.shape[1:]), x.dtype)


# -- lowering ----------------------------------------------------------------------------------------------------------


def _lower(machine: Machine[Any] | None, context, *arrays, program: Program, n_batch: int):
    native, in_parts = Native.of(context, machine) if machine else None, machine is cpu
    lower = lower_fun(functools.partial(run, program, n_batch, native, in_parts=in_parts), multiple_results=True)
    with _without_collection():
        return unsharded(lower, context, *arrays)


program_p: Any = Primitive("jaxspatial_program")
program_p.multiple_results = True
program_p.def_abstract_eval(_abstract)
program_p.def_impl(lambda *arrays, program, n_batch: program.compiled_primitive(n_batch)(*arrays))
mlir.register_lowering(program_p, functools.partial(_lower, None))
mlir.register_lowering(program_p, functools.partial(_lower, cpu), platform="cpu")
mlir.register_lowering(program_p, functools.partial(_lower, cuda), platform="cuda")
ad.primitive_jvps[program_p] = lambda x, t, *, program, n_batch: program.jvp(list(x), list(t), n_batch)
ad.primitive_transposes[program_p] = lambda cotangents, *x, program, n_batch: program.transposed(
    list(cotangents), list(x), n_batch
)
batching.primitive_batchers[program_p] = _batch
