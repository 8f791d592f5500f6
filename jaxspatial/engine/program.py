"""Programs over batches, and the primitive that runs them: what `vmap`, `jvp` and transposition do is decided here.

An algorithm is one primitive. Its formula sees a single axis of states, innermost in memory, however often and along
whichever axes a caller maps it: (L, W, B), L joints along a chain, W chains, B states. On CPUs a batch that does not
fit the cache runs in blocks that do.
"""

import contextlib
import functools
import gc
import itertools
import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import ClosedJaxpr, Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir
from jax.interpreters import partial_eval as pe

from jaxspatial.engine import kernels
from jaxspatial.numerics import check
from jaxspatial.numerics.errorfree.primitives import compiled, is_zero, lower_fun, n_devices, unsharded, without_calls

T = TypeVar("T")
Aval = jax.ShapeDtypeStruct
Result = tuple[tuple[int, ...], Any]  # shape and dtype

# Bounds on the states of a block, long enough for loops and short enough for the cache, and on its numbers of results.
LARGEST_BLOCK, SMALLEST_BLOCK, NUMBERS = 496, 64, 2**18
# Without loops there is less to begin anew in each block.
WRITTEN_OUT_BLOCK = 304
# Numbers of float32 in a line of the cache.
LINE = 16


class Program:
    """What the primitive runs. A subclass implements `evaluate` and `outputs`."""

    # The number of states in a block, on CPUs.
    block = LARGEST_BLOCK
    # Whether it would be slow to compile without kernels.
    always_as_kernels = False
    # Whether XLA takes long to compile one function of it and of the loop around it; whether so for its derivatives.
    is_large, has_large_derivatives = False, False
    # Rows per turn of its loops over bodies, as kernels: with two, what one writes the next reads where it is, and not
    # a copy. Steps of derivatives are so long that copies cost nothing beside them.
    rows_per_turn = 2
    # Whether it computes in 64 bits, whatever the dtype of the caller. Its derivatives are then traced in 64 bits too,
    # and so are programs that take 64-bit numbers from it.
    is_wide = False

    @functools.cached_property
    def _derived(self) -> dict[Hashable, Any]:
        return {}

    def cached(self, key: Hashable, maker: Callable[[], T]) -> T:
        """A derivative or trace of this program, made once by `maker`; it lives as long as the program."""
        if key not in self._derived:
            self._derived[key] = maker()
        return self._derived[key]

    def traced(self, avals: Sequence[Aval]) -> "Traced":
        """The trace of the program, made once for the same shapes.

        Symbols of `jax.export` are of one export, and not even compared with those of another.
        """
        in_64_bits = self.is_wide or bool(check.config.jax_enable_x64)
        if not all(check.is_sized(a.shape) for a in avals):
            return Traced(self, avals, in_64_bits)
        key = tuple((a.shape, np.dtype(a.dtype).name) for a in avals), in_64_bits
        return self.cached(key, lambda: Traced(self, avals, in_64_bits))

    def evaluate(self, *arrays: jax.Array) -> list[jax.Array]:
        """The results for arrays (B, ...), or (1, ...) where all states share one."""
        raise NotImplementedError

    def from_outside(self, x: jax.Array) -> jax.Array:
        """An argument as an operand: behind a barrier where bits are promised, or rounding errors computed."""
        raise NotImplementedError

    def outputs(self, avals: Sequence[Aval], sizes: Sequence[int]) -> list[Result]:
        """Shapes, without the batch, and dtypes of the results. avals: arguments without the batch; sizes: how many
        states each has."""
        raise NotImplementedError

    def primal_of(self, i: int) -> int | None:
        """The argument whose cotangent result i is, and whose batch it has; None for results over all states."""
        return None

    def takes_cotangent(self, i: int) -> bool:
        """Whether argument i is a cotangent, which is 0 for states that pad a block."""
        return False

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

    def batched(self, arrays: Sequence[jax.Array], axes: Sequence[int | None], size: int, n_batch: int) -> Any:
        """The results along a new axis in front, if there is a faster way than more states; else None."""
        return None

    def jvp(self, primals: list[Any], tangents: list[Any], n_batch: int) -> tuple[list[Any], list[Any]]:
        """(results, their tangents)."""
        raise NotImplementedError

    def transposed(self, cotangents: list[Any], arguments: list[Any], n_batch: int) -> list[Any]:
        """The cotangents of the arguments that are linear, None for others."""
        raise NotImplementedError


class Traced:
    """The trace of a program, without dead code."""

    def __init__(self, program: Program, avals: Sequence[Aval], in_64_bits: bool):
        def flat(*arrays: jax.Array) -> list[jax.Array]:
            return list(program.evaluate(*arrays))

        with jax.enable_x64(in_64_bits), _without_collection():
            closed = jax.make_jaxpr(flat)(*avals)
        jaxpr, _ = pe.dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars), instantiate=True)
        self.closed = ClosedJaxpr(jaxpr, closed.consts)
        self.out_avals = closed.out_avals

    def __call__(self, *arrays: jax.Array) -> list[jax.Array]:
        return jaxpr_as_fun(self.closed)(*arrays)

    def as_kernels(self, loops: kernels.Loops, *arrays: jax.Array) -> list[jax.Array]:
        """As is best on CPUs."""
        return kernels.run(self.closed, loops, *arrays)

    def without_calls(self, *arrays: jax.Array) -> list[jax.Array]:
        """As is best on GPUs."""
        return without_calls(self.closed, *arrays)


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


def bind(program: Program, arrays: Sequence[Any], n_batch: int) -> list[Any]:
    """The results (*batch, ...) of arrays that have n_batch axes in front, of size 1 where they do not vary."""
    arrays = [c if not is_zero(c) else zeros(c.aval) for c in arrays]
    in_loop = any(map(_is_in_loop, arrays))
    return list(_program_p.bind(*arrays, program=program, n_batch=n_batch, in_loop=in_loop))


def _is_in_loop(x: Any) -> bool:
    """Whether an array is traced for the body of a loop of JAX, as far as its trace tells.

    Speed alone depends on the answer, see `_in_blocks`; a version of JAX that does not tell is taken to say no.
    """
    trace = getattr(x, "_trace", None)
    while trace is not None:
        information = getattr(getattr(trace, "frame", None), "debug_info", None)
        if str(getattr(information, "traced_for", "")).startswith(("scan", "while", "fori")):
            return True
        trace = getattr(trace, "parent_trace", None)
    return False


def _abstract(*avals, program: Program, n_batch: int, in_loop: bool) -> list[Any]:
    batch = check.broadcast_shapes(*(a.shape[:n_batch] for a in avals))
    items = [jax.ShapeDtypeStruct(a.shape[n_batch:], a.dtype) for a in avals]
    # Of symbols of `jax.export`, which stand for any size, results have the shapes that they have of a block.
    size = block_size(math.prod(batch), program.block) if check.is_sized(batch) else program.block
    sizes = [size if _varies(a.shape[:n_batch]) else 1 for a in avals]
    specs = [a.sharding.spec for a in avals]
    common = [next((s[k] for s in specs if s[k] is not None), None) for k in range(n_batch)]
    # Numbers of a robot may be of no mesh.
    meshed = next((a for a in avals if not a.sharding.mesh.empty), avals[0])
    varying = frozenset[Any]().union(*(a.mat.varying for a in avals))
    results: list[Any] = []
    for i, (shape, dtype) in enumerate(program.outputs(items, sizes)):
        primal = program.primal_of(i)
        if primal is not None:
            results.append(avals[primal].update(weak_type=False))
            continue
        like, spec = avals[0], jax.sharding.PartitionSpec(*common, *[None] * len(shape))
        sharding = meshed.sharding.update(spec=spec)
        aval = like.update(shape=(*batch, *shape), dtype=dtype, weak_type=False, sharding=sharding)
        if varying:
            aval = aval.update(manual_axis_type=like.mat.update(varying=varying))
        results.append(aval)
    return results


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], *, program: Program, n_batch: int, in_loop: bool):
    return program.jvp(list(primals), list(tangents), n_batch)


def _transpose(cotangents: Sequence[Any], *arguments, program: Program, n_batch: int, in_loop: bool):
    return program.transposed(list(cotangents), list(arguments), n_batch)


def _batch(arrays: Sequence[Any], axes: Sequence[int | None], *, program: Program, n_batch: int, in_loop: bool):
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


def over_batch_of(x: jax.Array, aval: Aval) -> jax.Array:
    """Sums a cotangent over the axes along which its argument has size 1."""
    axes = [k for k, (a, b) in enumerate(zip(x.shape, aval.shape, strict=True)) if a != b]
    return x.sum(axes, keepdims=True) if axes else x


def zeros(aval: Aval) -> jax.Array:
    return lax.full(aval.shape, 0, aval.dtype)


# -- running a program ------------------------------------------------------------------------------------------------


class Way(NamedTuple):
    """How a program runs. in_blocks: in blocks, with kernels, as is best on CPUs; else at once, without calls. in_loop:
    as part of a loop. n_devices: over how many devices the compiler may split the batch."""

    in_blocks: bool
    in_loop: bool = False
    n_devices: int = 1


def run(program: Program, n_batch: int, way: Way, *arrays: jax.Array) -> list[jax.Array]:
    """Runs a program on arrays with n_batch axes in front, flattened to one axis of states."""
    batch = check.broadcast_shapes(*(x.shape[:n_batch] for x in arrays))
    columns = program.columns(arrays, n_batch) if way.in_blocks and check.is_sized(batch) else []
    if columns:
        return [_over_columns(program.over_columns(), columns, n_batch, way, arrays)]
    flat = [with_one_axis(x, n_batch, batch) for x in arrays]
    results = _in_blocks(program, way, math.prod(batch), flat)
    return [with_batch(y, program.primal_of(i), arrays, n_batch, batch) for i, y in enumerate(results)]


def _over_columns(program: Program, axes: list[int], n_batch: int, way: Way, arrays: Sequence[jax.Array]) -> jax.Array:
    """Runs a program with these axes of the batch, its columns, as one axis behind the states."""
    *others, last = arrays
    states = [k for k in range(n_batch) if k not in axes]
    shape, sizes = last.shape[:n_batch], [last.shape[k] for k in axes]
    last = jnp.transpose(last, (*states, *axes, n_batch))
    last = last.reshape((*(shape[k] for k in states), math.prod(sizes), -1))
    (y,) = run(program, len(states), way, *(x.reshape(np.delete(x.shape, axes)) for x in others), last)
    y = y.reshape((*y.shape[: len(states)], *sizes, -1))
    return jnp.transpose(y, (*np.argsort([*states, *axes]), n_batch))


def _varies(batch: tuple[int, ...]) -> bool:
    """Whether an array over such a batch may have several states; a symbol of `jax.export` stands for any number."""
    return not check.is_sized(batch) or math.prod(batch) > 1


def with_one_axis(x: jax.Array, n_batch: int, batch: tuple[int, ...]) -> jax.Array:
    """An array (*batch, ...) as (B, ...), or as (1, ...) where no axis of the batch varies."""
    shape = x.shape[:n_batch]
    if _varies(shape) and shape != batch:
        x, shape = jnp.broadcast_to(x, (*batch, *x.shape[n_batch:])), batch
    return x.reshape((math.prod(shape), *x.shape[n_batch:]))


def with_batch(
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


def block_size(n: int, block: int) -> int:
    """The size of blocks for n states: about `block`, as even as possible.

    An odd number of lines of the cache, of float32: arrays as long as a power of two would all lie in its same sets.
    """
    if n <= block:
        return n
    lines = -(-n // (-(-n // block) * LINE))
    return min((lines + 1 - lines % 2) * LINE, n)


def n_states(arrays: Sequence[jax.Array]) -> int:
    """The number of states of arrays (B, ...), or (1, ...) where all states share one."""
    sizes = tuple(x.shape[0] for x in arrays)
    symbols = (n for n in sizes if not check.is_sized((n,)))
    return next(symbols, None) or max(sizes, default=1)


def _in_blocks(program: Program, way: Way, n: int, arrays: Sequence[jax.Array]) -> list[jax.Array]:
    if not check.is_sized((n,)):
        # A symbol of `jax.export`, which stands for any number: neither blocks nor kernels.
        one = program.traced(list(map(_aval, arrays)))
        return one(*arrays) if way.in_blocks else one.without_calls(*arrays)
    # Each device has a part of the states, and takes its blocks from there: blocks of the whole would be gathered.
    n_parts = math.gcd(n, way.n_devices)
    n_each = n // n_parts
    size = block_size(n_each, program.block) if way.in_blocks else n_each
    varies = [x.shape[0] > 1 for x in arrays]
    avals = [_aval(x, n_parts * size if yes else None) for x, yes in zip(arrays, varies, strict=True)]
    one = program.traced(avals)
    if not way.in_blocks:
        return one.without_calls(*arrays)
    loops = kernels.Loops(program.rows_per_turn, program.is_large, is_split=way.n_devices > 1)
    if size == n_each:
        # With kernels a call of the program takes longer, by a buffer for each of their operations, and each turn of
        # a loop is several times as fast. The bits are the same.
        if not (way.in_loop or program.always_as_kernels):
            return one(*arrays)
        # Of one state copies cost nothing.
        return one.as_kernels(loops if size > 1 else loops._replace(rows_per_turn=1), *arrays)
    # The first block holds what is left over, and states of the second, which computes them again.
    n_blocks = -(-n_each // size)
    first = n_each - (n_blocks - 1) * size
    starts = np.array([0, *(first + size * np.arange(n_blocks - 1))], np.int32)
    adds = [(k := program.primal_of(i)) is not None and not varies[k] for i in range(len(one.out_avals))]
    masked = [yes and any(adds) and first < size and program.takes_cotangent(i) for i, yes in enumerate(varies)]

    axis = int(n_parts > 1)

    def split(x: jax.Array) -> jax.Array:
        return x.reshape((n_parts, -1, *x.shape[1:])) if axis else x

    def joined(x: jax.Array) -> jax.Array:
        return x.reshape((-1, *x.shape[2:])) if axis else x

    def block(x: jax.Array, start: jax.Array, is_masked: bool) -> jax.Array:
        x = lax.dynamic_slice_in_dim(x, start, size, axis)
        if is_masked:
            row = lax.broadcasted_iota(np.int32, x.shape, axis)
            x = lax.select((row < first) | (start > 0), x, lax.full_like(x, 0))
        return joined(x)

    def body(results: list[jax.Array], start: jax.Array) -> tuple[list[jax.Array], None]:
        each = zip(parts, varies, masked, strict=True)
        new = one.as_kernels(loops, *(block(x, start, is_masked) if yes else x for x, yes, is_masked in each))
        return [
            old + y if yes else lax.dynamic_update_slice_in_dim(old, split(y), start, axis)
            for old, y, yes in zip(results, new, adds, strict=True)
        ], None

    parts = [split(x) if yes else x for x, yes in zip(arrays, varies, strict=True)]
    both = list(zip(one.out_avals, adds, strict=True))
    begin = [
        lax.full(a.shape, 0, a.dtype) if yes else split(lax.full((n, *a.shape[1:]), 0, a.dtype)) for a, yes in both
    ]
    results = lax.scan(body, begin, jnp.asarray(starts))[0]
    return [y if yes else joined(y) for y, (_, yes) in zip(results, both, strict=True)]


def _aval(x: jax.Array, size: int | None = None) -> Aval:
    """That of an array, or of a block of so many of its states."""
    return jax.ShapeDtypeStruct(x.shape if size is None else (size, *x.shape[1:]), x.dtype)


def _lowering(in_blocks: bool) -> Callable[..., Any]:
    def rule(context, *arrays, program: Program, n_batch: int, in_loop: bool):
        # Not within a `shard_map`, where arrays are those of one device already.
        way = Way(in_blocks, in_loop, n_devices(context))
        lower = lower_fun(functools.partial(run, program, n_batch, way), multiple_results=True)
        with _without_collection():
            return unsharded(lower, context, *arrays)

    return rule


@functools.lru_cache(maxsize=64)
def _compiled(program: Program, n_batch: int, in_loop: bool) -> Callable[..., list[jax.Array]]:
    return compiled(_program_p, program=program, n_batch=n_batch, in_loop=in_loop)


def _run_alone(*arrays: jax.Array, program: Program, n_batch: int, in_loop: bool) -> list[jax.Array]:
    """The results outside of any transformation."""
    return _compiled(program, n_batch, in_loop)(*arrays)


_program_p: Any = Primitive("jaxspatial_program")
_program_p.multiple_results = True
_program_p.def_abstract_eval(_abstract)
_program_p.def_impl(_run_alone)
mlir.register_lowering(_program_p, _lowering(False))
mlir.register_lowering(_program_p, _lowering(True), platform="cpu")
ad.primitive_jvps[_program_p] = _jvp
ad.primitive_transposes[_program_p] = _transpose
batching.primitive_batchers[_program_p] = _batch
