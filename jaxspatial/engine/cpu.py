"""Code for one block of states, compiled by LLVM and called from JAX on CPUs over a batch of any size.

`llvm_ir` writes code that computes `width` states side by side. This module makes it a function that XLA calls by its
typed foreign function interface, version 0.3. In the order of the file:

1. `Code` is what to compile; `Compiled` is machine code; `Target` a processor.
2. Small functions write LLVM IR: addresses, loops, transposes in registers.
3. `Runtime` has what all handlers share and no code may take with it when it is freed: holds on code, other threads.
4. `Handler` writes the functions around one code. XLA calls `handler`. It makes a job, and asks other threads to help.
   A `worker` takes runs of chunks of the job until none is left. A `chunk` reads rows of the batch into columns, calls
   the code block by block, and writes its columns back as rows, or adds them up. Where code is split at a loop, the
   states of several blocks that need many turns are brought together: `ended`.
5. `compiled` compiles both parts, or finds them in memory or on disk, and makes them known to XLA.
6. `call` is the call, while JAX traces; on several devices each makes it for its own states.
7. `is_available` tries all of this once in each process.

Every number has the same bits however many threads there are.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import importlib
import os
import pathlib
import sys
import tempfile
import threading
import warnings
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.engine import llvm_ir
from jaxspatial.engine.graph import Graph
from jaxspatial.engine.machine import Argument, Result
from jaxspatial.numerics.errorfree.primitives import computed_at_once
from jaxspatial.numerics.jax_internals import Primitive, ShapedArray, mlir
from jaxspatial.numerics.jax_internals import ir as mlir_ir

try:
    importlib.import_module("llvmlite.binding")
except (ImportError, OSError):  # XLA does without: see `is_available`.
    IS_INSTALLED = False
else:
    IS_INSTALLED = True
if TYPE_CHECKING or IS_INSTALLED:
    from llvmlite import binding as llvm
    from llvmlite import ir

    VOID, I8, I32, I64, PTR = ir.VoidType(), ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.PointerType()
    NULL = ir.Constant(PTR, None)

Builder = Value = Any  # of llvmlite, which does not say what its methods take and return

# What a thread takes at a time, and what is summed by itself, in states. Sums depend on it; threads do not matter.
CHUNK = 128
# In how many runs of neighbouring chunks a thread takes its share of a job. The last run is what others wait for; but
# with runs of one chunk, memory that a thread has asked for would be what another one takes.
RUNS = 32
# So many operations on vectors take about 20 us. One more thread is asked to help for each such amount after the first.
WORTH_A_THREAD = 100_000
# Above so many bytes, what a thread needs is allocated on the heap.
LARGEST_ON_STACK = 1 << 16
LINE = 64
# Of code that is split at a loop. TOGETHER: bytes of memory of the blocks that are computed together. FEW: the share of
# the states of a block at which those that go on are brought together with others. FEW_TOGETHER: the share at which
# others take the places of those that are done. A step of solo12 on the ground takes 1.1 us with these numbers, and no
# less with others; it takes 2.0 us where all states of a block wait for the last one. A state takes 2.3 iterations in
# the mean, the last of 16 takes 6.7.
TOGETHER = 1 << 20
FEW, FEW_TOGETHER = 0.5, 0.75
FEW_COLUMNS = 4  # that are made of all rows of a block at once
# In bytes, where memory is asked for. Of a shift in float64, which computes as long as memory takes, a million items
# take 6.0 ns each with it, and 8.6 without; mass matrices of a Panda, 65,536 states, 55 and 105 ns.
AHEAD = 4096
REGISTER = 16  # bytes of the parts of a register within which numbers are interleaved at no extra cost
SPINS = 256  # how often a thread looks for the end of others' work before it lets the system run another

# Bytes from the start of the structs of XLA's header `c_api.h`, version 0.3, to the fields that are read or written.
EXTENSION, API, CONTEXT, STAGE, ARGUMENTS, RESULTS = 8, 16, 24, 32, 72, 112
EXTENSION_TYPE, EXTENSION_METADATA = 8, 24
METADATA_MAJOR, METADATA_MINOR, METADATA_STATE = 24, 28, 40
BUFFER_DATA, BUFFER_DIMS = 24, 40
API_DESTROY_ERROR, API_SET_STATE, API_SCHEDULE, API_N_THREADS = 64, 104, 136, 144
MAJOR, MINOR = 0, 3

# Bytes from the start of a job, which the threads of one call share, to its fields. Threads write to the first three,
# which have lines of the cache of their own.
NEXT, DONE, REFERENCES = 0, 64, 128
N_CHUNKS, N_STATES, RUN, SUMS, MODE, WORKER, HOLDERS, BUFFERS = range(192, 192 + 8 * 8, 8)


class Code(NamedTuple):
    """LLVM IR that defines `@block(ptr %arguments, ptr %results, ptr %frame)`, which computes `width` states.

    Each argument and each result has a pointer to numbers [size][width], aligned to a line of the cache where width is
    above one; a shared argument to [size].
    """

    text: str
    width: int
    arguments: tuple[Argument, ...]
    results: tuple[Result, ...]
    frame_bytes: int = 0
    cost: int = 0  # number of operations of a state, by which threads are shared out; zero keeps to one thread
    is_split: bool = False  # whether it defines `before`, `turns` and the like, too: see `llvm_ir.BlockIR`


MOST_UNROLLED = None  # as graphs have it


def least_alike(n: int) -> int:
    """The smallest number of states that runs the same code as n states."""
    return min(n, 2)


def code_of(graph: Graph, arguments: Sequence[Argument], results: Sequence[Result], n: int) -> Code:
    """The code of a graph for one state, or for several side by side."""
    width = 1 if n == 1 else width_of(graph)
    block = llvm_ir.ir_of(graph, width, [x.is_shared for x in arguments], host().has_fma, host().has_compress)
    return Code(block.text, width, tuple(arguments), tuple(results), *block[1:])


def width_of(graph: Graph) -> int:
    """How many states fill a register of the processor, with the widest numbers that a graph computes with.

    Constants are not looked at: numbers of a mechanism may be in float64, and become float32 while the graph is made.
    """
    features = host().features
    n_bytes = 64 if "+avx512f" in features else 32 if "+avx," in features else 16
    each = enumerate(graph.dtypes)
    sizes = {d.itemsize for node, d in each if d.kind == "f" and node not in graph.constants}
    return max(n_bytes // max(sizes, default=4), 4)


class Target(NamedTuple):
    """The processor that code is compiled for."""

    cpu: str
    features: str

    @property
    def has_fma(self) -> bool:
        """Whether it multiplies and adds in one step, rounded once."""
        return architecture() != "x86_64" or "+fma" in self.features.split(",")

    @property
    def has_compress(self) -> bool:
        """Whether it brings some numbers of a vector together in one step."""
        return "+avx512vl" in self.features.split(",")


class Compiled:
    """Machine code, which lives at least as long as this object, and the name by which XLA calls it."""

    def __init__(self, name: str, engine):
        self.name, self.engine = name, engine

    @property
    def address(self) -> int:
        """Where the handler is in memory."""
        return self.engine.get_function_address("handler")


@functools.cache
def host() -> Target:
    """The processor of this machine."""
    try:
        features = llvm.get_host_cpu_features().flatten()
    except RuntimeError:  # LLVM knows no features of some processors.
        features = ""
    return Target(llvm.get_host_cpu_name(), features)


@functools.cache
def architecture() -> str:
    """The kind of processor, as LLVM spells it."""
    name = llvm.get_process_triple().split("-")[0]
    return {"amd64": "x86_64", "arm64": "aarch64"}.get(name, name)


# ----------------------------------------------------------------------------------------------- pieces of IR


def at(b: Builder, pointer: Value, offset: int | Value) -> Value:
    """The address some bytes after a pointer."""
    return b.gep(pointer, [integer(offset)], source_etype=I8)


def integer(value: int | Value) -> Value:
    return ir.Constant(I64, value) if isinstance(value, int) else value


def field(b: Builder, struct: Value, offset: int | Value, kind: ir.Type | None = None) -> Value:
    """What a struct holds some bytes from its start: an address unless another kind is given."""
    return b.load(at(b, struct, offset), typ=kind or PTR)


def on_stack(b: Builder, n_bytes: int) -> Value:
    """Memory of a function, which begins a line of the cache."""
    memory = b.alloca(ir.ArrayType(I8, max(n_bytes, 1)))
    memory.align = LINE
    memory.type = PTR  # Not a pointer to an array, which llvmlite would let hold nothing else.
    return memory


def store_fields(b: Builder, struct: Value, *values: int | Value | None) -> None:
    """Writes fields of eight bytes, one after the other, from the start of a struct. None is a null pointer."""
    for i, value in enumerate(values):
        b.store(NULL if value is None else integer(value), at(b, struct, 8 * i))


def whole_lines(n: int) -> int:
    return -(-n // LINE) * LINE


def smallest(b: Builder, x: Value, y: Value) -> Value:
    return b.select(b.icmp_signed("<", x, y), x, y)


@contextlib.contextmanager
def loop(b: Builder, start: int | Value, stop: int | Value, step: int = 1) -> Iterator[Value]:
    """A loop over an index. Its counter is a phi node, since nothing moves variables from the stack to registers."""
    before = b.block
    head, body, end = (b.append_basic_block(f"loop.{name}") for name in ("head", "body", "end"))
    b.branch(head)
    b.position_at_end(head)
    index = b.phi(I64)
    index.add_incoming(integer(start), before)
    b.cbranch(b.icmp_signed("<", index, integer(stop)), body, end)
    b.position_at_end(body)
    yield index
    index.add_incoming(b.add(index, integer(step)), b.block)
    b.branch(head)
    b.position_at_end(end)


def one_vector(b: Builder, parts: list[Value]) -> Value:
    """One vector of several of equal length, a power of two of them."""
    while len(parts) > 1:
        n = 2 * parts[0].type.count
        parts = [b.shuffle_vector(x, y, lanes(range(n))) for x, y in zip(parts[::2], parts[1::2], strict=True)]
    return parts[0]


def lanes(indices: Sequence[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(I32, len(indices)), list(indices))


def interleaved(b: Builder, vectors: list[Value]) -> list[Value]:
    """Transposes groups of n numbers in n vectors: lane i of vector j goes to lane j of vector i, in each group.

    A perfect shuffle of the vectors, log2(n) times. Groups of 16 bytes need one instruction for two vectors.
    """
    n, width = len(vectors), vectors[0].type.count
    low = [start + i + side for start in range(0, width, n) for i in range(n // 2) for side in (0, width)]
    high = [i + n // 2 for i in low]
    for _ in range(n.bit_length() - 1):
        pairs = zip(vectors[: n // 2], vectors[n // 2 :], strict=True)
        vectors = [b.shuffle_vector(x, y, lanes(half)) for x, y in pairs for half in (low, high)]
    return vectors


def kind_of(dtype: np.dtype) -> ir.Type:
    if dtype.kind == "f":
        return {4: ir.FloatType(), 8: ir.DoubleType()}[dtype.itemsize]
    return ir.IntType(8 * dtype.itemsize)


def plus(b: Builder, x: Value, y: Value, dtype: np.dtype) -> Value:
    return b.fadd(x, y) if dtype.kind == "f" else b.add(x, y)


class Scratch:
    """Where a thread keeps the numbers of a block, in bytes from the start of its memory.

    n_blocks: that are computed together, one behind the other in memory. size: bytes of one of them.
    """

    def __init__(self, code: Code):
        self.size = 0
        self.argument_table = self._take(8 * len(code.arguments))
        self.result_table = self._take(8 * len(code.results))
        is_copied = code.width > 1
        self.arguments = [self._columns(code, x) if is_copied and not x.is_shared else None for x in code.arguments]
        self.results = [self._columns(code, x) if is_copied or x.is_summed else None for x in code.results]
        self.sums = [self._columns(code, x) if x.is_summed else None for x in code.results]
        rows = [x.size * x.dtype.itemsize for x in (*code.arguments, *code.results)]
        self.rows = self._take(code.width * max(rows, default=0))
        self.frame = self._take(code.frame_bytes)
        self.left = self._take(8)
        self.n_blocks = max(min(CHUNK // code.width, TOGETHER // self.size), 1) if code.is_split else 1

    def _take(self, n_bytes: int) -> int:
        place, self.size = self.size, self.size + whole_lines(n_bytes)
        return place

    def _columns(self, code: Code, x: Argument | Result) -> int:
        return self._take(x.size * x.dtype.itemsize * code.width)


class Module:
    """A module of LLVM IR that is being written."""

    def __init__(self, name: str):
        self.module = ir.Module(name)
        self.functions: dict[str, Any] = {}

    def external(self, name: str, result: ir.Type, arguments: list[ir.Type]) -> ir.Function:
        """A function that is defined elsewhere, or that is to be defined."""
        if name not in self.functions:
            self.functions[name] = ir.Function(self.module, ir.FunctionType(result, arguments), name)
        return self.functions[name]

    def begin(self, name: str, result: ir.Type, *arguments: ir.Type, is_internal: bool = True) -> tuple[Builder, tuple]:
        """Begins a function: the builder at its start, and its arguments."""
        function = self.external(name, result, list(arguments))
        function.linkage = "internal" if is_internal else "external"
        return ir.IRBuilder(function.append_basic_block("start")), function.args

    def variable(self, name: str) -> Value:
        """A number in memory, zero at first."""
        place: Value = ir.GlobalVariable(self.module, I64, name)
        place.initializer = ir.Constant(I64, 0)
        return place

    def get_mode(self, b: Builder, to: Value) -> None:
        """Stores how this thread rounds, and whether it flushes subnormal numbers. XLA's threads flush them."""
        if architecture() == "x86_64":
            b.call(self.external("llvm.x86.sse.stmxcsr", VOID, [PTR]), [to])
        elif architecture() == "aarch64":
            b.store(b.call(self.external("llvm.aarch64.get.fpcr", I64, []), []), to)

    def set_mode(self, b: Builder, of: Value) -> None:
        if architecture() == "x86_64":
            b.call(self.external("llvm.x86.sse.ldmxcsr", VOID, [PTR]), [of])
        elif architecture() == "aarch64":
            b.call(self.external("llvm.aarch64.set.fpcr", VOID, [I64]), [b.load(of, typ=I64)])


def once(write: Callable[..., None]) -> Callable[..., Any]:
    """A method that returns the function that `write(self, name, *options)` defines, and calls it at the first use."""

    @functools.wraps(write)
    def function(self: Module, *options):
        name = "_".join((write.__name__, *map(str, options)))
        if name not in self.functions:
            write(self, name, *options)
        return self.functions[name]

    return function


class Runtime(Module):
    """Functions that all handlers share, and that stay in memory.

    A task that starts late, and XLA when it destroys an executable, may be the last to hold code. What they then run
    must not be part of it.
    """

    ANSWER, HOLD, LET_GO = "jaxspatial_answer", "jaxspatial_hold", "jaxspatial_let_go"
    HELP, TASK, WAIT, RELEASE = "jaxspatial_help", "jaxspatial_task", "jaxspatial_wait", "jaxspatial_release"

    def __init__(self):
        super().__init__("runtime")
        # XLA's number of the type of a hold on code.
        self.hold_type = self.variable("hold_type")
        for write in (self.answer, self.hold, self.let_go, self.release, self.task, self.help, self.wait):
            write()

    def answer(self) -> None:
        """Answers XLA's question for the version of the interface, which comes with a frame of its own: (call frame).

        It returns whether this was a question.
        """
        b, (frame,) = self.begin(self.ANSWER, I64, PTR, is_internal=False)
        extension = field(b, frame, EXTENSION)
        with b.if_then(b.icmp_unsigned("!=", extension, NULL)):
            with b.if_then(b.icmp_signed("==", field(b, extension, EXTENSION_TYPE, I32), ir.Constant(I32, 1))):
                metadata = field(b, extension, EXTENSION_METADATA)
                b.store(ir.Constant(I32, MAJOR), at(b, metadata, METADATA_MAJOR))
                b.store(ir.Constant(I32, MINOR), at(b, metadata, METADATA_MINOR))
                b.store(b.load(self.hold_type, typ=I64), at(b, metadata, METADATA_STATE))
                b.ret(integer(1))
        b.ret(integer(0))

    def hold(self) -> None:
        """Lets the executable that XLA makes hold code until it dies: (call frame, the number of holders)."""
        b, (frame, holders) = self.begin(self.HOLD, PTR, PTR, PTR, is_internal=False)
        request = on_stack(b, 48)
        is_question = b.call(self.functions[self.ANSWER], [frame])
        with b.if_then(b.icmp_signed("!=", is_question, integer(0))):
            b.ret(NULL)
        b.atomic_rmw("add", holders, integer(1), "monotonic")
        stage = b.zext(field(b, frame, STAGE, I32), I64)
        store_fields(b, request, 48, None, field(b, frame, CONTEXT), stage, self.hold_type, holders)
        asks = ir.FunctionType(PTR, [PTR]).as_pointer()
        b.ret(b.call(field(b, field(b, frame, API), API_SET_STATE, asks), [request]))

    def let_go(self) -> None:
        """Counts one holder of code less: (where their number is)."""
        b, (holders,) = self.begin(self.LET_GO, VOID, PTR, is_internal=False)
        b.atomic_rmw("sub", holders, integer(1), "release")
        b.ret_void()

    def release(self) -> None:
        """Gives up a reference to a job: (job). The last to do so frees it."""
        b, (job,) = self.begin(self.RELEASE, VOID, PTR, is_internal=False)
        before = b.atomic_rmw("sub", at(b, job, REFERENCES), integer(1), "acq_rel")
        with b.if_then(b.icmp_signed("==", before, integer(1))):
            b.call(self.external("free", VOID, [PTR]), [job])
        b.ret_void()

    def task(self) -> None:
        """What another thread does: (job). If it starts late, no chunk is left, and it reads nothing but the job."""
        b, (job,) = self.begin(self.TASK, VOID, PTR, is_internal=False)
        mode = on_stack(b, 8)
        self.get_mode(b, mode)
        self.set_mode(b, at(b, job, MODE))
        b.call(field(b, job, WORKER, ir.FunctionType(VOID, [PTR]).as_pointer()), [job])
        self.set_mode(b, mode)
        b.atomic_rmw("sub", field(b, job, HOLDERS), integer(1), "release")
        b.call(self.functions[self.RELEASE], [job])
        b.ret_void()

    def destroyed(self, b: Builder, api: Value, error: Value, request: Value) -> None:
        """Destroys an error of XLA, which there is no one to tell: the thread that asked computes by itself."""
        store_fields(b, request, 24, None, error)
        b.call(field(b, api, API_DESTROY_ERROR, ir.FunctionType(VOID, [PTR]).as_pointer()), [request])

    def help(self) -> None:
        """Asks up to n of XLA's threads to help with a job: (call frame, job, n)."""
        b, (frame, job, wanted) = self.begin(self.HELP, VOID, PTR, PTR, I64, is_internal=False)
        asks = ir.FunctionType(PTR, [PTR]).as_pointer()
        api, context = field(b, frame, API), field(b, frame, CONTEXT)
        request, n_threads = on_stack(b, 40), on_stack(b, 8)
        b.store(integer(0), n_threads)
        store_fields(b, request, 32, None, context, n_threads)
        error = b.call(field(b, api, API_N_THREADS, asks), [request])
        with b.if_then(b.icmp_unsigned("!=", error, NULL)):
            self.destroyed(b, api, error, request)
            b.store(integer(0), n_threads)
        n = smallest(b, wanted, b.sub(b.load(n_threads, typ=I64), integer(1)))
        with b.if_then(b.icmp_signed(">", n, integer(0))):
            runs = b.mul(b.add(n, integer(1)), integer(RUNS))
            run = b.sdiv(b.add(field(b, job, N_CHUNKS, I64), b.sub(runs, integer(1))), runs)
            b.store(run, at(b, job, RUN))
        with loop(b, 0, n):
            counts = at(b, job, REFERENCES), field(b, job, HOLDERS)
            for count in counts:
                b.atomic_rmw("add", count, integer(1), "monotonic")
            store_fields(b, request, 40, None, context, self.functions[self.TASK], job)
            error = b.call(field(b, api, API_SCHEDULE, asks), [request])
            with b.if_then(b.icmp_unsigned("!=", error, NULL)):
                self.destroyed(b, api, error, request)
                for count in counts:
                    b.atomic_rmw("sub", count, integer(1), "monotonic")
        b.ret_void()

    def wait(self) -> None:
        """Waits until all chunks are done: (job). Each is in the hands of a thread that runs."""
        b, (job,) = self.begin(self.WAIT, VOID, PTR, is_internal=False)
        before = b.block
        head, body, end = (b.append_basic_block(name) for name in ("head", "body", "end"))
        b.branch(head)
        b.position_at_end(head)
        spins = b.phi(I64)
        spins.add_incoming(integer(1), before)
        done = b.load_atomic(at(b, job, DONE), "acquire", 8, typ=I64)
        b.cbranch(b.icmp_signed("<", done, field(b, job, N_CHUNKS, I64)), body, end)
        b.position_at_end(body)
        if architecture() == "x86_64":
            b.call(self.external("llvm.x86.sse2.pause", VOID, []), [])
        elif architecture() == "aarch64":
            b.call(self.external("llvm.aarch64.hint", VOID, [I32]), [ir.Constant(I32, 1)])
        if sys.platform != "win32":
            with b.if_then(b.icmp_signed("==", b.and_(spins, integer(SPINS - 1)), integer(0))):
                b.call(self.external("sched_yield", I32, []), [])
        spins.add_incoming(b.add(spins, integer(1)), b.block)
        b.branch(head)
        b.position_at_end(end)
        b.ret_void()


class Handler(Module):
    """Writes the module around a code: `@handler`, which XLA calls, and what it calls in turn."""

    def __init__(self, code: Code):
        super().__init__("handler")
        if code.width < 1 or code.width & (code.width - 1):
            raise ValueError(f"a width of {code.width}, which is no power of two")
        if any(x.is_summed and x.dtype.kind == "b" for x in code.results):
            raise ValueError("truth values cannot be summed")
        self.code, self.scratch = code, Scratch(code)
        self.block = self.external("block", VOID, [PTR, PTR, PTR])
        # How many executables and tasks hold this code.
        self.holders = self.variable("holders")
        # A sum of a chunk is a row, one result after the other.
        self.sum_places, self.sum_bytes = [], 0
        for x in code.results:
            self.sum_places.append(self.sum_bytes)
            self.sum_bytes += whole_lines(x.size * x.dtype.itemsize) if x.is_summed else 0
        # What XLA calls when it makes an executable.
        b, (frame,) = self.begin("instantiate", PTR, PTR, is_internal=False)
        b.ret(b.call(self.external(Runtime.HOLD, PTR, [PTR, PTR]), [frame, self.holders]))
        self.handler()

    def copy(self, b: Builder, to: Value, of: Value, n_bytes: int | Value) -> None:
        move = self.external("llvm.memcpy.p0.p0.i64", VOID, [PTR, PTR, I64, ir.IntType(1)])
        b.call(move, [to, of, integer(n_bytes), ir.Constant(ir.IntType(1), 0)])

    def clear(self, b: Builder, place: Value, n_bytes: int | Value) -> None:
        """Writes zeros."""
        fill = self.external("llvm.memset.p0.i64", VOID, [PTR, I8, I64, ir.IntType(1)])
        b.call(fill, [place, ir.Constant(I8, 0), integer(n_bytes), ir.Constant(ir.IntType(1), 0)])

    # ------------------------------------------------------------------------------- rows to columns and back

    @once
    def transposed(self, name: str, n_bytes: int, size: int, is_read: bool) -> None:
        """Copies `width` rows of the batch to columns, or columns to rows: (rows, columns).

        A group of columns at a time. Where the number of columns is no multiple of it, the last group overlaps the one
        before, so that nothing outside the rows is touched.
        """
        width = self.code.width
        b, (rows, columns) = self.begin(name, VOID, PTR, PTR)
        for argument in (rows, columns):
            argument.add_attribute("noalias")
        self.ask_for(b, rows, n_bytes * size * width, is_read)
        if size <= FEW_COLUMNS:
            self.transpose_few(b, rows, columns, n_bytes, size, is_read)
            b.ret_void()
            return
        group = min(REGISTER // n_bytes, width, 1 << (size.bit_length() - 1))
        part = ir.VectorType(ir.IntType(8 * n_bytes), group)
        whole = ir.VectorType(ir.IntType(8 * n_bytes), width)
        with loop(b, 0, size, group) as column:
            column = smallest(b, column, integer(size - group))
            row = at(b, rows, b.mul(column, integer(n_bytes)))
            lane = at(b, columns, b.mul(column, integer(n_bytes * width)))

            def place(i: int) -> Value:
                return at(b, row, i * size * n_bytes)  # noqa: B023, which is called in this turn of the loop only

            if is_read:
                # Lane i of a vector is of row i in the end: the parts of vector k are of rows k, k + group, ...
                parts = [
                    [b.load(place(i), align=n_bytes, typ=part) for i in range(k, width, group)] for k in range(group)
                ]
                for k, vector in enumerate(interleaved(b, [one_vector(b, x) for x in parts])):
                    b.store(vector, at(b, lane, k * n_bytes * width), align=min(LINE, n_bytes * width))
            else:
                vectors = [
                    b.load(at(b, lane, k * n_bytes * width), align=min(LINE, n_bytes * width), typ=whole)
                    for k in range(group)
                ]
                for k, vector in enumerate(interleaved(b, vectors)):
                    for i in range(0, width, group):
                        half = b.shuffle_vector(vector, vector, lanes(range(i, i + group)))
                        b.store(half, place(i + k), align=n_bytes)
        b.ret_void()

    def ask_for(self, b: Builder, rows: Value, n_bytes: int, is_read: bool) -> None:
        """Asks for memory a little behind the rows of a block, which is read or written soon.

        Of a block that is larger than that distance each row is a stream, which the processor sees by itself.
        """
        if n_bytes > AHEAD:
            return
        ask = self.external("llvm.prefetch.p0", VOID, [PTR, I32, I32, I32])
        options = [ir.Constant(I32, x) for x in (int(not is_read), 3, 1)]  # into the first cache, as data
        with loop(b, AHEAD, AHEAD + n_bytes, LINE) as place:
            b.call(ask, [at(b, rows, place), *options])

    def transpose_few(self, b: Builder, rows: Value, columns: Value, n_bytes: int, size: int, is_read: bool) -> None:
        """`transposed` of so few columns that each is made of all rows at once, which are `size` vectors in memory."""
        width = self.code.width
        whole = ir.VectorType(ir.IntType(8 * n_bytes), width)
        (of, of_align), (to, to_align) = (rows, n_bytes), (columns, min(LINE, n_bytes * width))
        if not is_read:
            (of, of_align), (to, to_align) = (to, to_align), (of, of_align)
        given = [b.load(at(b, of, k * n_bytes * width), align=of_align, typ=whole) for k in range(size)]
        for j in range(size):
            # Where each number of vector j is: of which vector, and there in which lane.
            if is_read:
                places = [divmod(i * size + j, width) for i in range(width)]
            else:
                places = [divmod(i, size)[::-1] for i in range(j * width, (j + 1) * width)]
            vector = given[0]
            for k in range(1, size):
                # Lanes that later vectors fill may hold anything.
                chosen = [
                    width + lane if source == k else i if k > 1 or source else lane
                    for i, (source, lane) in enumerate(places)
                ]
                vector = b.shuffle_vector(vector, given[k], lanes(chosen))
            b.store(vector, at(b, to, j * n_bytes * width), align=to_align)

    @once
    def padded(self, name: str) -> None:
        """Copies the rows at the end of a batch, and the last of them again for each that is missing.

        (rows, number of rows, bytes of a row, where to). The code then sees no numbers that are not of the batch, which
        could keep a loop from ending.
        """
        b, (rows, n, row_bytes, to) = self.begin(name, VOID, PTR, I64, I64, PTR)
        self.copy(b, to, rows, b.mul(n, row_bytes))
        last = at(b, rows, b.mul(b.sub(n, integer(1)), row_bytes))
        with loop(b, n, self.code.width) as i:
            self.copy(b, at(b, to, b.mul(i, row_bytes)), last, row_bytes)
        b.ret_void()

    def read(self, b: Builder, x: Argument, rows: Value, n: Value, scratch: Value, to: int) -> None:
        """Reads n rows, at most `width`, into columns."""
        if not x.size:
            return
        transposed = self.transposed(x.dtype.itemsize, x.size, True)
        with b.if_else(b.icmp_signed("==", n, integer(self.code.width)), likely=True) as (whole, rest):
            with whole:
                b.call(transposed, [rows, at(b, scratch, to)])
            with rest:
                copied = at(b, scratch, self.scratch.rows)
                b.call(self.padded(), [rows, n, integer(x.size * x.dtype.itemsize), copied])
                b.call(transposed, [copied, at(b, scratch, to)])

    def write(self, b: Builder, x: Result, rows: Value, n: Value, scratch: Value, of: int) -> None:
        """Writes columns to n rows, at most `width`."""
        if not x.size:
            return
        transposed = self.transposed(x.dtype.itemsize, x.size, False)
        with b.if_else(b.icmp_signed("==", n, integer(self.code.width)), likely=True) as (whole, rest):
            with whole:
                b.call(transposed, [rows, at(b, scratch, of)])
            with rest:
                copied = at(b, scratch, self.scratch.rows)
                b.call(transposed, [copied, at(b, scratch, of)])
                self.copy(b, rows, copied, b.mul(n, integer(x.size * x.dtype.itemsize)))

    # ------------------------------------------------------------------------------------------------- sums

    @once
    def accumulated(self, name: str, dtype: np.dtype) -> None:
        """Adds columns of a block to sums, lane by lane: (sums, columns, size, number of states in the block).

        Lanes past the end of the batch are chosen away: what they hold may be infinite.
        """
        width, kind = self.code.width, ir.VectorType(kind_of(dtype), self.code.width)
        b, (sums, columns, size, n) = self.begin(name, VOID, PTR, PTR, I64, I64)
        n = b.insert_element(ir.Constant(ir.VectorType(I64, width), ir.Undefined), n, integer(0))
        n = b.shuffle_vector(n, n, lanes([0] * width))
        is_state = b.icmp_signed("<", ir.Constant(n.type, list(range(width))), n)
        with loop(b, 0, size) as j:
            place = b.mul(j, integer(width * dtype.itemsize))
            value = b.load(at(b, columns, place), align=dtype.itemsize, typ=kind)
            value = b.select(is_state, value, ir.Constant(kind, None))
            place = at(b, sums, place)
            b.store(plus(b, b.load(place, align=dtype.itemsize, typ=kind), value, dtype), place, align=dtype.itemsize)
        b.ret_void()

    @once
    def folded(self, name: str, dtype: np.dtype) -> None:
        """Adds up the lanes of sums, pairwise: (sums, size, row of results)."""
        width, kind = self.code.width, kind_of(dtype)
        b, (sums, size, row) = self.begin(name, VOID, PTR, I64, PTR)
        with loop(b, 0, size) as j:
            of = at(b, sums, b.mul(j, integer(width * dtype.itemsize)))
            terms = [field(b, of, i * dtype.itemsize, kind) for i in range(width)]
            while len(terms) > 1:
                terms = [plus(b, x, y, dtype) for x, y in zip(terms[::2], terms[1::2], strict=True)]
            b.store(terms[0], at(b, row, b.mul(j, integer(dtype.itemsize))))
        b.ret_void()

    @once
    def added_up(self, name: str, dtype: np.dtype) -> None:
        """Adds up rows of sums, pairwise: (rows, number of rows, size, the result). It overwrites the rows."""
        kind = kind_of(dtype)
        b, (rows, n, size, result) = self.begin(name, VOID, PTR, I64, I64, PTR)
        before = b.block
        head, body, end = (b.append_basic_block(f"halve.{name}") for name in ("head", "body", "end"))
        b.branch(head)
        b.position_at_end(head)
        left = b.phi(I64)
        left.add_incoming(n, before)
        b.cbranch(b.icmp_signed(">", left, integer(1)), body, end)
        b.position_at_end(body)
        half = b.lshr(b.add(left, integer(1)), integer(1))
        with loop(b, half, left) as i:
            other = at(b, rows, b.mul(i, integer(self.sum_bytes)))
            row = at(b, rows, b.mul(b.sub(i, half), integer(self.sum_bytes)))
            with loop(b, 0, size) as j:
                place = b.mul(j, integer(dtype.itemsize))
                x, y = field(b, row, place, kind), field(b, other, place, kind)
                b.store(plus(b, x, y, dtype), at(b, row, place))
        left.add_incoming(half, b.block)
        b.branch(head)
        b.position_at_end(end)
        self.copy(b, result, rows, b.mul(size, integer(dtype.itemsize)))
        b.ret_void()

    # ------------------------------------------------------------------------------------------------ chunks

    def buffer(self, i: int) -> int:
        """Where a job keeps the address of an argument, or, counted on, of a result."""
        return BUFFERS + 8 * i

    def memory_of(self, b: Builder, block: Value) -> list[Value]:
        """What the functions of the code take, of a block with this memory."""
        place = self.scratch
        return [at(b, block, x) for x in (place.argument_table, place.result_table, place.frame)]

    def read_block(
        self, b: Builder, inputs: list[Value], outputs: list[Value], state: Value, n: Value, block: Value
    ) -> None:
        """Reads n states from this one on into the memory of a block, or lets its tables point to them."""
        code, place = self.code, self.scratch
        for i, (x, base, to) in enumerate(zip(code.arguments, inputs, place.arguments, strict=True)):
            rows = at(b, base, b.mul(state, integer(x.size * x.dtype.itemsize)))
            if to is not None:
                self.read(b, x, rows, n, block, to)
            elif not x.is_shared:
                b.store(rows, at(b, block, place.argument_table + 8 * i))
        for i, (x, base, of) in enumerate(zip(code.results, outputs, place.results, strict=True)):
            if of is None:
                rows = at(b, base, b.mul(state, integer(x.size * x.dtype.itemsize)))
                b.store(rows, at(b, block, place.result_table + 8 * i))

    def write_block(
        self, b: Builder, outputs: list[Value], state: Value, n: Value, block: Value, scratch: Value
    ) -> None:
        """Writes the results of a block, or adds them to the sums of the thread."""
        place = self.scratch
        for x, base, of, sums in zip(self.code.results, outputs, place.results, place.sums, strict=True):
            if of is None:
                continue
            if sums is not None:
                columns = at(b, block, of)
                b.call(self.accumulated(x.dtype), [at(b, scratch, sums), columns, integer(x.size), n])
            else:
                self.write(b, x, at(b, base, b.mul(state, integer(x.size * x.dtype.itemsize))), n, block, of)

    def split_blocks(
        self, b: Builder, first: Value, last: Value, inputs: list[Value], outputs: list[Value], scratch: Value
    ) -> None:
        """Computes states of split code, several blocks at a time."""
        width, place = self.code.width, self.scratch
        before, after = (self.external(name, VOID, [PTR, PTR, PTR]) for name in ("before", "after"))
        turns = self.external("turns", I64, [PTR, PTR, PTR, I64, I64])

        @contextlib.contextmanager
        def each_block(begin: Value, end: Value) -> Iterator[tuple[Value, Value, Value]]:
            """(first state, number of states, memory) of each."""
            with loop(b, begin, end, width) as state:
                block = at(b, scratch, b.mul(b.udiv(b.sub(state, begin), integer(width)), integer(place.size)))
                yield state, smallest(b, b.sub(end, state), integer(width)), block

        with loop(b, first, last, width * place.n_blocks) as begin:
            end = smallest(b, b.add(begin, integer(width * place.n_blocks)), last)
            is_alone = b.icmp_signed("<=", b.sub(end, begin), integer(width))
            few = b.select(is_alone, integer(0), integer(int(FEW * width)))
            with each_block(begin, end) as (state, n, block):
                self.read_block(b, inputs, outputs, state, n, block)
                b.call(before, self.memory_of(b, block))
                states = b.sub(b.shl(integer(1), n), integer(1))
                left = b.call(turns, [*self.memory_of(b, block), states, few])
                b.store(left, at(b, block, place.left))
            n_blocks = b.udiv(b.add(b.sub(end, begin), integer(width - 1)), integer(width))
            b.call(self.ended(), [scratch, n_blocks])
            with each_block(begin, end) as (state, n, block):
                b.call(after, self.memory_of(b, block))
                self.write_block(b, outputs, state, n, block, scratch)

    @once
    def waiting(self, name: str) -> None:
        """The first block with states that go on, or null: (memory of the thread, number of blocks)."""
        b, (memory, n_blocks) = self.begin(name, PTR, PTR, I64)
        with loop(b, 0, n_blocks) as k:
            block = at(b, memory, b.mul(k, integer(self.scratch.size)))
            with b.if_then(b.icmp_signed("!=", field(b, block, self.scratch.left, I64), integer(0))):
                b.ret(block)
        b.ret(NULL)

    @once
    def ended(self, name: str) -> None:
        """Takes the turns of states that go on: (memory of the thread, number of blocks).

        They are lent to one more block. When enough of them are done, they return, and others take their places.
        """
        width, place, zero = self.code.width, self.scratch, integer(0)
        b, (memory, n_blocks) = self.begin(name, VOID, PTR, I64)
        lent, returned = (self.external(x, VOID, [PTR, PTR, I64, PTR, PTR, I64]) for x in ("lent", "returned"))
        turns = self.external("turns", I64, [PTR, PTR, PTR, I64, I64])
        more, every = at(b, memory, place.size * place.n_blocks), integer((1 << width) - 1)
        arguments, _, frame = self.memory_of(b, more)
        # Sets of places there: those that are taken, and those that one block takes, with the set of their states in
        # it. Of each place: the block that lends a state to it, and the set of this one state.
        taken, new, of_new, blocks, states = (on_stack(b, 8 * n) for n in (1, 1, 1, width, width))

        def lend(block: Value, to: Value, of: Value) -> None:
            of_arguments, _, of_frame = self.memory_of(b, block)
            b.call(lent, [arguments, frame, to, of_arguments, of_frame, of])

        first = b.call(self.waiting(), [memory, n_blocks])
        with b.if_then(b.icmp_unsigned("==", first, NULL)):
            b.ret_void()
        # Numbers of no state could keep a loop from ending.
        lend(first, every, every)
        b.store(zero, taken)
        head, body, end = (b.append_basic_block(f"together.{part}") for part in ("head", "body", "end"))
        b.branch(head)
        b.position_at_end(head)
        with loop(b, 0, n_blocks) as k:
            block = at(b, memory, b.mul(k, integer(place.size)))
            left = at(b, block, place.left)
            store_fields(b, new, 0)
            store_fields(b, of_new, 0)
            with b.if_then(b.icmp_signed("!=", b.load(left, typ=I64), zero)):
                with loop(b, 0, width) as lane:
                    bit, waiting = b.shl(integer(1), lane), b.load(left, typ=I64)
                    is_free = b.icmp_signed("==", b.and_(b.load(taken, typ=I64), bit), zero)
                    with b.if_then(b.and_(is_free, b.icmp_signed("!=", waiting, zero))):
                        state = b.and_(waiting, b.neg(waiting))
                        b.store(block, at(b, blocks, b.mul(lane, integer(8))))
                        b.store(state, at(b, states, b.mul(lane, integer(8))))
                        b.store(b.xor(waiting, state), left)
                        for variable, of in ((taken, bit), (new, bit), (of_new, state)):
                            b.store(b.or_(b.load(variable, typ=I64), of), variable)
                with b.if_then(b.icmp_signed("!=", b.load(new, typ=I64), zero)):
                    lend(block, b.load(new, typ=I64), b.load(of_new, typ=I64))
        going = b.load(taken, typ=I64)
        b.cbranch(b.icmp_signed("!=", going, zero), body, end)
        b.position_at_end(body)
        is_last = b.icmp_unsigned("==", b.call(self.waiting(), [memory, n_blocks]), NULL)
        few = b.select(is_last, zero, integer(int(FEW_TOGETHER * width)))
        goes_on = b.call(turns, [*self.memory_of(b, more), going, few])
        b.store(goes_on, taken)
        with loop(b, 0, width) as lane:
            bit = b.shl(integer(1), lane)
            with b.if_then(b.icmp_signed("!=", b.and_(b.xor(going, goes_on), bit), zero)):
                of_arguments, _, of_frame = self.memory_of(b, field(b, blocks, b.mul(lane, integer(8))))
                state = field(b, states, b.mul(lane, integer(8)), I64)
                b.call(returned, [of_arguments, of_frame, state, arguments, frame, bit])
        b.branch(head)
        b.position_at_end(end)
        b.ret_void()

    @once
    def chunk(self, name: str) -> None:
        """Computes the states of one chunk: (job, number of the chunk, memory of the thread)."""
        code, width, place = self.code, self.code.width, self.scratch
        b, (job, chunk, scratch) = self.begin(name, VOID, PTR, I64, PTR)
        n = field(b, job, N_STATES, I64)
        first = b.mul(chunk, integer(CHUNK))
        last = smallest(b, b.add(first, integer(CHUNK)), n)
        buffers = [field(b, job, self.buffer(i)) for i in range(len(code.arguments) + len(code.results))]
        inputs, outputs = buffers[: len(code.arguments)], buffers[len(code.arguments) :]
        for x, sums in zip(code.results, place.sums, strict=True):
            if sums is not None:
                self.clear(b, at(b, scratch, sums), x.size * x.dtype.itemsize * width)
        if code.is_split:
            self.split_blocks(b, first, last, inputs, outputs, scratch)
        else:
            with loop(b, first, last, width) as state:
                n = smallest(b, b.sub(last, state), integer(width))
                self.read_block(b, inputs, outputs, state, n, scratch)
                b.call(self.block, self.memory_of(b, scratch))
                self.write_block(b, outputs, state, n, scratch, scratch)
        row = at(b, field(b, job, SUMS), b.mul(chunk, integer(self.sum_bytes)))
        for x, sums, to in zip(code.results, place.sums, self.sum_places, strict=True):
            if sums is not None:
                b.call(self.folded(x.dtype), [at(b, scratch, sums), integer(x.size), at(b, row, to)])
        b.ret_void()

    @once
    def worker(self, name: str) -> None:
        """Takes runs of chunks of a job until none is left: (job)."""
        code, place, chunk = self.code, self.scratch, self.chunk()
        b, (job,) = self.begin(name, VOID, PTR)
        # Split code has one block more, for states that need many turns.
        n_blocks = place.n_blocks + int(code.is_split)
        size = place.size * n_blocks
        is_large = size > LARGEST_ON_STACK
        if is_large:
            memory = b.call(self.external("malloc", PTR, [I64]), [integer(size + LINE)])
            scratch = b.ptrtoint(memory, I64)
            scratch = b.inttoptr(b.and_(b.add(scratch, integer(LINE - 1)), integer(-LINE)), PTR)
        else:
            memory = scratch = on_stack(b, size)
        places = zip((*code.arguments, *code.results), (*place.arguments, *place.results), strict=True)
        tables = [place.argument_table + 8 * i for i in range(len(code.arguments))]
        tables += [place.result_table + 8 * i for i in range(len(code.results))]
        with loop(b, 0, n_blocks) as k:
            block = at(b, scratch, b.mul(k, integer(place.size)))
            for i, (table, (x, own)) in enumerate(zip(tables, places, strict=True)):
                if own is not None:
                    b.store(at(b, block, own), at(b, block, table))
                elif isinstance(x, Argument) and x.is_shared:
                    b.store(field(b, job, self.buffer(i)), at(b, block, table))
        run, n_chunks = field(b, job, RUN, I64), field(b, job, N_CHUNKS, I64)
        head, body, end = (b.append_basic_block(f"take.{name}") for name in ("head", "body", "end"))
        b.branch(head)
        b.position_at_end(head)
        first = b.atomic_rmw("add", at(b, job, NEXT), run, "monotonic")
        b.cbranch(b.icmp_signed("<", first, n_chunks), body, end)
        b.position_at_end(body)
        last = smallest(b, b.add(first, run), n_chunks)
        with loop(b, first, last) as k:
            b.call(chunk, [job, k, scratch])
        b.atomic_rmw("add", at(b, job, DONE), b.sub(last, first), "release")
        b.branch(head)
        b.position_at_end(end)
        if is_large:
            b.call(self.external("free", VOID, [PTR]), [memory])
        b.ret_void()

    # ------------------------------------------------------------------------------------------------ the call

    def n_states(self, b: Builder, buffers: list[Value]) -> Value:
        """The number of rows of the first array that has one for each state."""
        for x, buffer in zip((*self.code.arguments, *self.code.results), buffers, strict=True):
            if not (x.is_shared if isinstance(x, Argument) else x.is_summed):
                return field(b, field(b, buffer, BUFFER_DIMS), 0, I64)
        return integer(1)

    def handler(self) -> None:
        """What XLA calls: (call frame). It returns no error."""
        code, worker = self.code, self.worker()
        b, (frame,) = self.begin("handler", PTR, PTR, is_internal=False)
        is_question = b.call(self.external(Runtime.ANSWER, I64, [PTR]), [frame])
        with b.if_then(b.icmp_signed("!=", is_question, integer(0)), likely=False):
            b.ret(NULL)
        inputs, outputs = field(b, frame, ARGUMENTS), field(b, frame, RESULTS)
        buffers = [field(b, inputs, 8 * i) for i in range(len(code.arguments))]
        buffers += [field(b, outputs, 8 * i) for i in range(len(code.results))]
        n = self.n_states(b, buffers)
        n_chunks = b.sdiv(b.add(n, integer(CHUNK - 1)), integer(CHUNK))
        # Late tasks read the job after this call has returned.
        job = b.call(self.external("malloc", PTR, [I64]), [integer(BUFFERS + 8 * len(buffers))])
        for value, place in ((0, NEXT), (0, DONE), (1, REFERENCES), (n_chunks, N_CHUNKS), (n, N_STATES)):
            b.store(integer(value), at(b, job, place))
        for value, place in ((n_chunks, RUN), (worker, WORKER), (self.holders, HOLDERS)):
            b.store(value, at(b, job, place))
        self.get_mode(b, at(b, job, MODE))
        for i, buffer in enumerate(buffers):
            b.store(field(b, buffer, BUFFER_DATA), at(b, job, self.buffer(i)))
        sums = NULL
        if self.sum_bytes:
            sums = b.call(self.external("malloc", PTR, [I64]), [b.mul(n_chunks, integer(self.sum_bytes))])
        b.store(sums, at(b, job, SUMS))
        if code.cost:
            work = b.sdiv(b.mul(n, integer(code.cost)), integer(code.width * WORTH_A_THREAD))
            wanted = smallest(b, b.sub(work, integer(1)), b.sub(n_chunks, integer(1)))
            with b.if_then(b.icmp_signed(">", wanted, integer(0))):
                b.call(self.external(Runtime.HELP, VOID, [PTR, PTR, I64]), [frame, job, wanted])
        b.call(worker, [job])
        b.call(self.external(Runtime.WAIT, VOID, [PTR]), [job])
        if self.sum_bytes:
            for i, (x, place) in enumerate(zip(code.results, self.sum_places, strict=True)):
                if x.is_summed:
                    result = field(b, job, self.buffer(len(code.arguments) + i))
                    b.call(self.added_up(x.dtype), [at(b, sums, place), n_chunks, integer(x.size), result])
                    # Rows after the first, which there are where the batch is split over devices.
                    row = integer(x.size * x.dtype.itemsize)
                    n_rows = field(b, field(b, buffers[len(code.arguments) + i], BUFFER_DIMS), 0, I64)
                    self.clear(b, at(b, result, row), b.mul(b.sub(n_rows, integer(1)), row))
            b.call(self.external("free", VOID, [PTR]), [sums])
        b.call(self.external(Runtime.RELEASE, VOID, [PTR]), [job])
        b.ret(NULL)


# ----------------------------------------------------------------------------------------------- machine code

_LOCK = threading.RLock()
_COMPILED: weakref.WeakValueDictionary[tuple[Code, Target], Compiled] = weakref.WeakValueDictionary()
_TIMES_REGISTERED: dict[str, int] = {}
_STILL_HELD: list[Any] = []  # Engines whose code executables or tasks hold, while Python does not.


def _target_machine(target: Target):
    of = llvm.Target.from_triple(llvm.get_process_triple())
    return of.create_target_machine(cpu=target.cpu, features=target.features, opt=2, jit=True)


def _object(texts: Sequence[str], target: Target) -> bytes:
    """Machine code of several modules together, as a file that a linker would read."""
    module, *others = [llvm.parse_assembly(text) for text in texts]
    for other in others:
        module.link_in(other)
    module.verify()
    return _target_machine(target).emit_object(module)


def on_disk(name: str, make: Callable[[], bytes]) -> bytes:
    """What is compiled under a name, from JAX's cache on disk where there is one."""
    folder = jax.config.values["jax_compilation_cache_dir"]
    if not folder or "://" in folder or not jax.config.values["jax_enable_compilation_cache"]:
        return make()
    path = pathlib.Path(folder) / "jaxspatial" / name
    with contextlib.suppress(OSError):
        digest, content = (data := path.read_bytes())[:32], data[32:]
        if hashlib.sha256(content).digest() == digest:
            return content
    content = make()
    # Other processes see the whole file or none. A cache that cannot be written to is none.
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            file.write(hashlib.sha256(content).digest() + content)
        os.replace(file.name, path)
    return content


def _cached(name: str, texts: Sequence[str], target: Target) -> bytes:
    """Machine code of several modules together."""
    return on_disk(f"{name}.o", lambda: _object(texts, target))


def _loaded(content: bytes, target: Target):
    """An engine that holds machine code in memory."""
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target_machine(target))
    engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(content))
    engine.finalize_object()
    return engine


@functools.cache
def _runtime() -> tuple[Any, Any]:
    """What this process needs once, and keeps: functions that handlers call, and what XLA knows of holds on code."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    texts = [str(Runtime().module)]
    engine = _loaded(_cached(name_of(texts, host()), texts, host()), host())
    for name in (Runtime.ANSWER, Runtime.HOLD, Runtime.HELP, Runtime.WAIT, Runtime.RELEASE):
        llvm.add_symbol(name, engine.get_function_address(name))
    information = (ctypes.c_int64 * 3)(24, 0, engine.get_function_address(Runtime.LET_GO))
    # XLA may do so later, once it is in use at all.
    jax.ffi.register_ffi_type(
        "jaxspatial_hold",
        {
            "type_id": _capsule(engine.get_global_value_address("hold_type")),
            "type_info": _capsule(ctypes.addressof(information)),
        },
        platform="cpu",
    )
    return engine, information


def name_of(texts: Sequence[str], target: Target) -> str:
    """A name of what is compiled that is another for any other code, in all processes."""
    identity = "\0".join((*texts, str(llvm.llvm_version_info), llvm.get_process_triple(), *target))
    return f"jaxspatial_{hashlib.sha256(identity.encode()).hexdigest()[:32]}"


def _capsule(address: int):
    """An address, as JAX takes it."""
    return jax.ffi.pycapsule(ctypes.CFUNCTYPE(None)(address))


def _free(engine=None) -> None:
    """Frees machine code once no executable and no task holds it any more: now, or when other code comes or goes.

    Python may call this anywhere, so that it waits for no other thread.
    """
    if engine is not None:
        _STILL_HELD.append(engine)
    if _LOCK.acquire(blocking=False):
        try:
            for x in list(_STILL_HELD):
                if not _number(x, "holders").value and x in _STILL_HELD:
                    _STILL_HELD.remove(x)
        finally:
            _LOCK.release()


def _number(engine, name: str) -> ctypes.c_int64:
    """A variable of machine code."""
    return ctypes.c_int64.from_address(engine.get_global_value_address(name))


def compiled(code: Code, target: Target | None = None) -> Compiled:
    """Compiles code, or finds it if it is in use already, and makes it known to XLA.

    A lowering rule that calls it holds the result by `context.module_context.add_keepalive(compiled(code))`, until XLA
    has made the executable. The machine code is freed when neither Python nor an executable holds it.
    """
    with _LOCK:
        _runtime()
        target = target or host()
        key = code, target
        if (found := _COMPILED.get(key)) is not None:
            return found
        _free()
        texts = code.text, str(Handler(code).module)
        name = name_of(texts, target)
        engine = _loaded(_cached(name, texts, target), target)
        # XLA keeps names for ever. Code that was freed, and is needed again, is elsewhere in memory.
        times = _TIMES_REGISTERED[name] = _TIMES_REGISTERED.get(name, 0) + 1
        result = Compiled(name if times == 1 else f"{name}_{times}", engine)
        stages = {"instantiate": "instantiate", "execute": "handler"}
        stages = {stage: _capsule(engine.get_function_address(name)) for stage, name in stages.items()}
        jax.ffi.register_ffi_target(result.name, stages, platform="cpu")
        weakref.finalize(result, _free, engine).atexit = False
        _COMPILED[key] = result
        return result


# ----------------------------------------------------------------------------------------------------- calls


def call(
    code: Code, arrays: Sequence[jax.Array], n: int, target: Target | None = None, n_devices: int = 1
) -> list[jax.Array]:
    """Calls code over n states, while JAX traces: arrays (n, size), or (1, size) if all states share them.

    The caller holds `compiled(code)` until XLA has made the executable.

    Args:
        code: what to compute.
        arrays: its arguments.
        n: the number of states.
        target: the processor, if it is not this one.
        n_devices: for how many devices XLA compiles one program. It then splits the states as its inputs are split.

    Returns:
        Arrays (n, size), or (1, size) where results are summed over states.
    """
    for x, array in zip(code.arguments, arrays, strict=True):
        if (array.shape, array.dtype) != ((1 if x.is_shared else n, x.size), x.dtype):
            raise TypeError(f"the code takes {x} of {n} states, not {array.dtype}{list(array.shape)}")
    for x in code.results:
        if jax.dtypes.canonicalize_dtype(x.dtype) != x.dtype:
            raise TypeError(f"JAX has no {x.dtype} unless 64-bit types are enabled")
    if n == 0:
        return [jnp.zeros((1 if x.is_summed else n, x.size), x.dtype) for x in code.results]
    name = compiled(code, target).name
    if n_devices > 1 and n % n_devices == 0:
        return _on_devices(code, name, n, arrays)
    outputs = [jax.ShapeDtypeStruct((1 if x.is_summed else n, x.size), x.dtype) for x in code.results]
    return list(jax.ffi.ffi_call(name, outputs)(*arrays))


def _on_devices(code: Code, name: str, n: int, arrays: Sequence[jax.Array]) -> list[jax.Array]:
    """The call, which each device makes for its states, an equal number of them.

    XLA splits calls whose arrays all have an axis of states. What states share is repeated for each of them, of which
    the handler reads the first; of a sum, each device gives its part in its first row, and zeros in the others.
    """
    _let_xla_split(name)
    repeated = [jnp.broadcast_to(x, (n, x.shape[1])) for x in arrays]
    avals = tuple(ShapedArray((n, x.size), x.dtype) for x in code.results)
    sizes = tuple(x.size for x in (*code.arguments, *code.results))
    results = _on_devices_p.bind(*repeated, name=name, sizes=sizes, avals=avals)
    # The sum has the dtype of its terms.
    return [
        y.sum(0, keepdims=True, dtype=x.dtype) if x.is_summed else y for x, y in zip(code.results, results, strict=True)
    ]


@functools.cache
def _let_xla_split(name: str) -> None:
    jax.ffi.register_ffi_target_as_batch_partitionable(name)


_on_devices_p = Primitive("jaxspatial_call")
_on_devices_p.multiple_results = True
_on_devices_p.def_abstract_eval(lambda *_, name, sizes, avals: avals)


def _lower_on_devices(
    context: mlir.LoweringRuleContext,
    *arrays,
    name: str,
    sizes: tuple[int, ...],
    avals: tuple[ShapedArray, ...],
):
    """A call whose first axis XLA may split, while no other axis of an array is split."""
    # As the language of sharding rules has them: j to z, then z_1, z_2 and so on.
    factors = ["jklmnopqrstuvwxyz"[k] if k < 17 else f"z_{k - 16}" for k in range(len(sizes))]
    axes = [f"[i, {factor}]" for factor in factors]
    operands, results, whole = ", ".join(axes[: len(arrays)]), ", ".join(axes[len(arrays) :]), ", ".join(factors)
    lengths = ", ".join(f"{factor}={size}" for factor, size in zip(factors, sizes, strict=True))
    lengths = f"i={avals[0].shape[0]}, {lengths}"
    rule = f"<({operands})->({results}) {{{lengths}}} need_replication={{{whole}}}, custom>"
    is_batched: Any = mlir_ir.DictAttr.get({"num_batch_dims": mlir_ir.StringAttr.get("1")})
    attributes = {"mhlo.frontend_attributes": is_batched}
    if jax.config.values["jax_use_shardy_partitioner"]:
        attributes["sdy.sharding_rule"] = mlir_ir.Attribute.parse(f"#sdy.op_sharding_rule{rule}")
    return jax.ffi.ffi_lowering(name, extra_attributes=attributes)(context, *arrays)


mlir.register_lowering(_on_devices_p, _lower_on_devices, platform="cpu")


_PROBE = """
define void @block(ptr noalias %arguments, ptr noalias %results, ptr noalias %frame) {
  %x = load ptr, ptr %arguments
  %y = load ptr, ptr %results
  %a = load <4 x float>, ptr %x
  %b = fmul <4 x float> %a, %a
  store <4 x float> %b, ptr %y
  ret void
}
"""


@functools.cache
def is_available() -> bool:
    """Whether code can be compiled and called here: llvmlite is installed, and a known result comes out right."""
    numbers = (Argument(1, np.dtype(np.float32)),), (Result(1, np.dtype(np.float32)),)
    code = Code(_PROBE, 4, *numbers)
    try:
        importlib.import_module("llvmlite.binding")
        held = compiled(code)
        x = np.arange(1, 8, dtype=np.float32)[:, None]
        device = jax.local_devices(backend="cpu")[0]
        # Whatever the caller forbids, or is in the middle of.
        with computed_at_once(), jax.default_device(device), jax.transfer_guard("allow"):
            (y,) = jax.jit(lambda x: call(code, [x], 7))(x)
        if np.array_equal(np.asarray(y), x * x):
            del held  # Until here the code has to live.
            return True
        reason = f"{x.ravel()} squared is {np.asarray(y).ravel()}"
    except Exception as error:  # Whatever goes wrong, JAX can compute the same without.
        reason = str(error)
    warnings.warn(f"jaxspatial does not compile programs by itself on this machine: {reason}", stacklevel=2)
    return False
