"""A graph as a kernel for NVIDIA GPUs, one state per thread, and its call from JAX.

LLVM writes the kernel as PTX, the assembly language of these GPUs, from the IR that `llvm_ir` writes for one state. It
travels as text within the program of JAX, and the driver compiles it for the GPU at hand. The 32 threads of a warp copy
rows of the batch to shared memory, so that neighbours in memory are read by neighbouring threads; each thread computes
its state from there; and results go back the same way.

Every number has the bits that the CPU's machine code gives it.
"""

import contextlib
import functools
import math
import warnings
import weakref
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import lax
from jax.sharding import NamedSharding, PartitionSpec

from jaxspatial.engine import cpu, llvm_ir
from jaxspatial.engine.graph import Graph
from jaxspatial.engine.machine import Argument, Result
from jaxspatial.numerics.errorfree.primitives import computed_at_once
from jaxspatial.numerics.jax_internals import custom_partitioning

WARP = 32
# Bytes of shared memory that a block may take without asking for more.
MOST_SHARED = 48 * 1024
# Bytes of a state's row in shared memory. What does not fit is read where it is.
LONGEST_ROW = 960
# Numbers of a result above which it is written by columns at the end, instead of from the row.
LONGEST_RESULT = 64
# Bytes of a row of a large result that are written together. Such parts begin and end within 32 bytes, the least that
# memory takes: the longer they are, the fewer of these are written twice.
TILE = 512
# Warps of a block, where there are enough of them for all multiprocessors.
WARPS, MANY_WARPS = 4, 4096
# Loops are kept where graphs have more nodes without: long code does not fit the cache of instructions, and the driver
# takes long for it.
MOST_UNROLLED = 10_000
# Above so many operations, a program is several functions, whose time to compile grows in proportion.
MOST_OPERATIONS = 30_000
# How many loads of a copy are under way before the first number is stored.
AT_ONCE = 16
# Of the 255 registers of a thread, those for numbers that wait. The assembler needs the others.
REGISTERS = 220
# Stands for the number of states in the text of a kernel. No program has this number.
N_STATES = 0x5AFE5AFE5AFE
# Of GPUs that LLVM has names for. A later one runs the code of an earlier one.
CAPABILITIES = (70, 75, 80, 86, 89, 90, 100)
TRIPLE = "nvptx64-nvidia-cuda"
ROWS, FRAME = "ptr addrspace(3) %rows", "ptr addrspace(5) %frame"


class Code(NamedTuple):
    """A kernel for batches of at least 32 states, or for so many of fewer.

    text: its LLVM IR. warps: of a block at most.
    """

    text: str
    warps: int
    arguments: tuple[Argument, ...]
    results: tuple[Result, ...]


def least_alike(n: int) -> int:
    """The smallest number of states that runs the same code as n states."""
    return min(n, WARP)


def code_of(graph: Graph, arguments: Sequence[Argument], results: Sequence[Result], n: int) -> Code:
    """The code of a graph for n states."""
    writer = _ThreadWriter(graph, arguments, results, min(n, WARP))
    return Code(writer.kernel(), writer.warps, tuple(arguments), tuple(results))


# -- the kernel --------------------------------------------------------------------------------------------------------


class _ThreadWriter(llvm_ir.Writer):
    """Writes a kernel, in which each thread computes the state of its row.

    n_rows: the states of a warp: 32, or all states of a smaller batch. offsets: by argument, and by result counted on,
    where it begins in a row of shared memory; not there for what is read or written without.
    """

    frame = FRAME

    def __init__(self, graph: Graph, arguments: Sequence[Argument], results: Sequence[Result], n_rows: int):
        super().__init__(graph, 1, [x.is_shared for x in arguments], has_fma=True, n_registers=REGISTERS)
        self.arguments, self.results, self.n_rows = arguments, results, n_rows
        self.longest, n = MOST_OPERATIONS, len(arguments)
        # Results are first: arguments can be read where they are.
        rows = [(i, x) for i, x in enumerate(results, n) if x.size <= LONGEST_RESULT]
        large = [(i, x) for i, x in enumerate(results, n) if x.size > LONGEST_RESULT]
        self.offsets: dict[int, int] = {}
        size = 0
        for i, x in (*rows, *enumerate(arguments)):
            item = x.dtype.itemsize
            first = -(-size // item) * item
            is_shared = isinstance(x, Argument) and x.is_shared
            if x.size and not is_shared and first + x.size * item <= LONGEST_ROW:
                self.offsets[i], size = first, first + x.size * item
        large += [(i, x) for i, x in rows if x.size and i not in self.offsets]
        self.row_bytes = _odd(size, max((x.dtype.itemsize for x in (*arguments, *results)), default=4))
        self.columns = {i: TILE // x.dtype.itemsize for i, x in large}
        longest = max((min(self.columns[i], x.size) * x.dtype.itemsize for i, x in large), default=0)
        item = max((x.dtype.itemsize for _, x in large), default=0)
        self.tile, self.tile_bytes = WARP * self.row_bytes, _odd(longest, item) if large else 0
        self.shared_bytes = -(-(self.tile + WARP * self.tile_bytes) // 16) * 16
        self.warps = max(1, min(WARPS, MOST_SHARED // max(self.shared_bytes, 1)))
        self.in_place = [i for i in range(n) if i not in self.offsets and arguments[i].size]
        self.parameters = ["ptr addrspace(3) noalias %rows", "ptr addrspace(5) noalias %frame", "i64 %state"]
        self.parameters += [f"ptr addrspace(1) noalias %a{i}" for i in self.in_place]
        self.parameters += [f"ptr addrspace(1) noalias %g{i}" for i, _ in large]
        # Of large results, which nodes a part of its columns waits for. Sums are made at the end.
        self.tiles: dict[tuple[int, int], set[llvm_ir.Item]] = {}
        for i, x in large:
            for first in range(0, x.size, self.columns[i]):
                items = {self.scheduler.items[node] for node in self._nodes_of(i, first)}
                self.tiles[i, first] = items - {None} | ({None} if x.is_summed else set())
        self.tiles_of: dict[llvm_ir.Item, list[tuple[int, int]]] = {}
        for tile, items in self.tiles.items():
            for item in items:
                self.tiles_of.setdefault(item, []).append(tile)

    def argument(self, f: llvm_ir.Function, k: int) -> str:
        return self.offset(f, ROWS, self.offsets[k]) if k in self.offsets else f"ptr addrspace(1) %a{k}"

    def result(self, f: llvm_ir.Function, k: int) -> str:
        return self.offset(f, ROWS, self.offsets[len(self.arguments) + k])

    def stored_results(self, f: llvm_ir.Function, node: int, places) -> None:
        n = len(self.arguments)
        if inside := [(k, j) for k, j in places if n + k in self.offsets]:
            super().stored_results(f, node, inside)

    def _nodes_of(self, i: int, first: int) -> list[int]:
        """The nodes of a part of a large result."""
        return self.graph.results[i - len(self.arguments)].ravel()[first : first + self.columns[i]].tolist()

    def note_homes(self) -> None:
        """A part of a large result is written where the last of its numbers is known."""
        super().note_homes()
        place = {item: p for p, items in enumerate(self.pieces) for item in items}
        end = 0 if len(self.pieces) == 1 else len(self.pieces)
        for (i, first), items in self.tiles.items():
            p = max((place.get(x, end) for x in items), default=end)
            for node in self._nodes_of(i, first):
                self.readers[node].add(p)

    def write(self, f: llvm_ir.Function, p: int, items: Iterable[llvm_ir.Item]) -> None:
        for item in items:
            super().write(f, p, [item])
            for tile in self.tiles_of.get(item, ()):
                self.tiles[tile].discard(item)
                if not self.tiles[tile]:
                    del self.tiles[tile]
                    self._write_tile(f, *tile)

    def read_again(self, f: llvm_ir.Function, node: int) -> str:
        """Unknown to LLVM, which would else find that the operation was done before."""
        value, dtype = self.read(f, node), self.graph.dtypes[node]
        if node in self.graph.constants or node in self.graph.copies or dtype.kind == "b":
            return value
        letter = {"f": "f", "d": "d"}.get(dtype.char) or ("r" if dtype.itemsize == 4 else "l")
        hidden, t = f.new(), self.type(dtype)
        move, kinds = f"mov.b{8 * dtype.itemsize} $0, $1;", f"={letter},{letter}"
        f.add(f'{hidden} = call {t} asm sideeffect "{move}", "{kinds}"({t} {value})')
        return hidden

    def piece(self, p: int) -> llvm_ir.Function:
        f = super().piece(p)
        f.entry += self._threads()
        return f

    def _threads(self) -> list[str]:
        """Which thread of the warp this is, and which row it computes: those without a state repeat the last one."""
        lane = self.call("llvm.nvvm.read.ptx.sreg.tid.x", "i32")
        n = self.n_rows - 1
        return [
            f"  %thread = {lane}",
            "  %lane = and i32 %thread, 31",
            "  %part = lshr i32 %thread, 5",
            f"  %part.place = mul i32 %part, {self.shared_bytes}",
            "  %part.place64 = zext i32 %part.place to i64",
            "  %shared = getelementptr i8, ptr addrspace(3) @shared, i64 %part.place64",
            f"  %is_less = icmp ult i32 %lane, {n}",
            f"  %row = select i1 %is_less, i32 %lane, i32 {n}",
            "  %own = zext i32 %row to i64",
        ]

    def kernel(self) -> str:
        frame_bytes = self.plan()
        n, n_rows = len(self.arguments), self.n_rows
        names = [f"%g{i}" for i in range(n + len(self.results))]
        f = llvm_ir.Function("kernel", [f"ptr addrspace(1) noalias {name}" for name in names])
        f.entry += self._threads()
        f.add(f"%block = {self.call('llvm.nvvm.read.ptx.sreg.ctaid.x', 'i32')}")
        f.add(f"%threads = {self.call('llvm.nvvm.read.ptx.sreg.ntid.x', 'i32')}")
        f.add("%warps = lshr i32 %threads, 5")
        f.add("%before = mul i32 %block, %warps")
        f.add("%warp32 = add i32 %before, %part")
        f.add("%warp = zext i32 %warp32 to i64")
        if n_rows < WARP:
            f.add("%state = add i64 0, 0")
        else:
            # The last warp begins earlier, so that it is full, and computes some states once more.
            f.add(f"%wanted = mul i64 %warp, {WARP}")
            f.add("%n = load i64, ptr addrspace(4) @n_states")
            f.add("%is_outside = icmp uge i64 %wanted, %n")
            f.add("br i1 %is_outside, label %outside, label %inside")
            f.lines += ["outside:", "  ret void", "inside:"]
            f.add(f"%last = sub i64 %n, {WARP}")
            f.add("%is_last = icmp ugt i64 %wanted, %last")
            f.add("%state = select i1 %is_last, i64 %last, i64 %wanted")
            f.add("%again64 = sub i64 %wanted, %state")
            f.add("%again = trunc i64 %again64 to i32")
        f.add(f"%places = mul i64 %own, {self.row_bytes}")
        f.add("%rows = getelementptr i8, ptr addrspace(3) %shared, i64 %places")
        f.add("%own_state = add i64 %state, %own")
        for i, x in enumerate(self.arguments):
            if i in self.offsets:
                rows = "ptr addrspace(3) %shared", self.row_bytes, self.offsets[i]
                self._copy_columns(f, i, x, rows, range(x.size))
        for i in self.in_place:
            x = self.arguments[i]
            state = "0" if x.is_shared else "%own_state"
            f.add(f"%at{i} = mul i64 {state}, {x.size * x.dtype.itemsize}")
            f.add(f"%a{i} = getelementptr i8, ptr addrspace(1) %g{i}, i64 %at{i}")
        f.entry.append(f"  %memory = alloca [{max(frame_bytes, 1)} x i8], align 16")
        f.entry.append("  %frame = addrspacecast ptr %memory to ptr addrspace(5)")
        self._synchronised(f)
        if len(self.pieces) == 1 and not self.bodies:
            functions = list[llvm_ir.Function]()
            self.write(f, 0, self.pieces[0])
        else:
            functions = [self.piece(p) for p in range(len(self.pieces))]
            self.write_calls(f, self.top)
        for node, places in self.result_places.items():
            if node not in self.home:
                self.stored_results(f, node, places)
        self._synchronised(f)
        for tile in self.tiles:
            self._write_tile(f, *tile)
        for i, x in enumerate(self.results, n):
            if i in self.offsets:
                rows = "ptr addrspace(3) %shared", self.row_bytes, self.offsets[i]
                self._write_back(f, i, x, rows, range(x.size))
        shared = f"@shared = internal addrspace(3) global [{self.warps * self.shared_bytes} x i8] undef, align 16"
        shared += f"\n@n_states = addrspace(4) externally_initialized constant i64 {N_STATES}"
        text = f.text("ptx_kernel ")
        text = text.replace(") {", f') "nvvm.maxntid"="{self.warps * WARP}" {{', 1)
        return f"{shared}\n{self.module_text(functions, text)}"

    def _write_tile(self, f: llvm_ir.Function, i: int, first: int) -> None:
        """Writes columns of a large result."""
        x = self.results[i - len(self.arguments)]
        nodes = self._nodes_of(i, first)
        own, pointer = f.new(), "ptr addrspace(3) %shared"
        f.add(f"{own} = mul i64 %own, {self.tile_bytes}")
        for j, node in enumerate(nodes):
            value, dtype = self.read_for_outside(f, node)
            place = self.offset(f, self.offset(f, pointer, own), self.tile + j * dtype.itemsize)
            self.stored(f, value, place, dtype)
        self._synchronised(f)
        tile = pointer, self.tile_bytes, self.tile - first * x.dtype.itemsize
        self._write_back(f, i, x, tile, range(first, first + len(nodes)))
        self._synchronised(f)

    def _synchronised(self, f: llvm_ir.Function) -> None:
        """Threads of the warp see what others wrote to shared memory."""
        f.add(self.call("llvm.nvvm.bar.warp.sync", "void", ("i32", "-1")))

    # -- copies between rows of the batch and shared memory -----------------------------------------------------------

    def _lane(self, f: llvm_ir.Function, i: int, x, shared: tuple[str, int, int], first: int, width: int):
        """(where a lane begins in global memory, and in shared memory) to copy `width` columns of several rows."""
        size, item = x.size, x.dtype.itemsize
        pointer, row_bytes, offset = shared
        row, column, place, of_state, at, inside = (f.new() for _ in range(6))
        f.add(f"{row} = udiv i32 %lane, {width}")
        f.add(f"{column} = and i32 %lane, {width - 1}")
        wide_row, wide_column = f.new(), f.new()
        f.add(f"{wide_row} = zext i32 {row} to i64")
        f.add(f"{wide_column} = zext i32 {column} to i64")
        f.add(f"{place} = add i64 %state, {wide_row}")
        f.add(f"{of_state} = mul i64 {place}, {size * item}")
        f.add(f"{at} = mul i64 {wide_column}, {item}")
        f.add(f"{inside} = mul i64 {wide_row}, {row_bytes}")
        there = self.offset(f, self.offset(f, f"ptr addrspace(1) %g{i}", of_state), at)
        here = self.offset(f, self.offset(f, pointer, inside), at)
        return row, column, self.offset(f, there, first * item), self.offset(f, here, offset + first * item)

    @contextlib.contextmanager
    def _if(self, f: llvm_ir.Function, conditions: Sequence[str]) -> Iterator[None]:
        """What follows is done by threads for which these hold."""
        if not conditions:
            yield
            return
        condition = conditions[0]
        for other in conditions[1:]:
            both = f.new()
            f.add(f"{both} = and i1 {condition}, {other}")
            condition = both
        f.count += 1
        name = f"where{f.count}"
        f.add(f"br i1 {condition}, label %{name}, label %{name}.end")
        f.lines.append(f"{name}:")
        yield
        f.add(f"br label %{name}.end")
        f.lines.append(f"{name}.end:")

    def _copy_columns(
        self, f: llvm_ir.Function, i: int, x, shared: tuple[str, int, int], columns: range, is_read: bool = True
    ) -> None:
        """Copies columns of an argument to shared memory, or of a result from there.

        As many lanes as a power of two has side by side, and as many rows at once as there are lanes for.
        """
        t, item = f"i{8 * x.dtype.itemsize}", x.dtype.itemsize
        for first, width, wanted in _parts(columns):
            row, column, there, here = self._lane(f, i, x, shared, first, width)
            of, to = (there, here) if is_read else (here, there)
            steps = (x.size * item, shared[1]) if is_read else (shared[1], x.size * item)
            rows = WARP // width
            whole, rest = divmod(self.n_rows, rows)
            inside = list[str]()
            if wanted < width:
                inside.append(f.new())
                f.add(f"{inside[0]} = icmp ult i32 {column}, {wanted}")

            def moved(places: Sequence[int]) -> None:
                values = list[str]()
                for k in places:
                    pointer = self.offset(f, of, k * rows * steps[0])  # noqa: B023
                    values.append(f.new())
                    f.add(f"{values[-1]} = load {t}, {pointer}, align {item}")
                for k, value in zip(places, values, strict=True):
                    pointer = self.offset(f, to, k * rows * steps[1])  # noqa: B023
                    f.add(f"store {t} {value}, {pointer}, align {item}")

            with self._if(f, inside):
                for k in range(0, whole, AT_ONCE):
                    moved(range(k, min(k + AT_ONCE, whole)))
            if rest:
                inside.append(f.new())
                f.add(f"{inside[-1]} = icmp ult i32 {row}, {rest}")
                with self._if(f, inside):
                    moved([whole])

    def _write_back(self, f: llvm_ir.Function, i: int, x: Result, shared: tuple[str, int, int], columns: range) -> None:
        if x.is_summed:
            self._write_sums(f, i, x, shared, columns)
        else:
            self._copy_columns(f, i, x, shared, columns, is_read=False)

    def _write_sums(self, f: llvm_ir.Function, i: int, x: Result, shared: tuple[str, int, int], columns: range) -> None:
        """Writes sums over the states of the warp, of which each lane makes one."""
        pointer, row_bytes, offset = shared
        t, item = self.scalar(x.dtype), x.dtype.itemsize
        plus = "fadd" if x.dtype.kind == "f" else "add"
        for first in range(columns.start, columns.stop, WARP):
            n = min(WARP, columns.stop - first)
            is_one, lane, at = f.new(), f.new(), f.new()
            f.add(f"{is_one} = icmp ult i32 %lane, {n}")
            with self._if(f, [is_one]):
                f.add(f"{lane} = zext i32 %lane to i64")
                f.add(f"{at} = mul i64 {lane}, {item}")
                here = self.offset(f, self.offset(f, pointer, at), offset + first * item)
                terms = list[str]()
                for row in range(self.n_rows):
                    value = f.new()
                    f.add(f"{value} = load {t}, {self.offset(f, here, row * row_bytes)}, align {item}")
                    if self.n_rows == WARP and row < WARP - 1:
                        is_new, chosen = f.new(), f.new()
                        f.add(f"{is_new} = icmp ule i32 %again, {row}")
                        f.add(f"{chosen} = select i1 {is_new}, {t} {value}, {t} zeroinitializer")
                        value = chosen
                    terms.append(value)
                while len(terms) > 1:
                    sums = list[str]()
                    for a, b in zip(terms[::2], terms[1::2], strict=False):
                        sums.append(f.new())
                        f.add(f"{sums[-1]} = {plus} {t} {a}, {b}")
                    terms = sums + ([terms[-1]] if len(terms) % 2 else [])
                of_warp = f.new()
                f.add(f"{of_warp} = mul i64 %warp, {x.size * item}")
                there = self.offset(f, self.offset(f, f"ptr addrspace(1) %g{i}", of_warp), at)
                f.add(f"store {t} {terms[0]}, {self.offset(f, there, first * item)}, align {item}")


def _odd(n_bytes: int, item: int) -> int:
    """The least length of rows of which 32 begin in different banks of shared memory."""
    item = max(item, 4)
    n = -(-n_bytes // item)
    return item * (n + 1 - n % 2)


def _parts(columns: range) -> Iterator[tuple[int, int, int]]:
    """(first column, lanes, columns of them) of parts of columns: powers of two of lanes, of which few are idle."""
    first = columns.start
    while first < columns.stop:
        n = min(columns.stop - first, WARP)
        above = 1 << (n - 1).bit_length()
        width = above if 4 * n > 3 * above else above // 2
        yield first, width, min(n, width)
        first += min(n, width)


# -- compiling and calling ---------------------------------------------------------------------------------------------


@functools.cache
def _capability() -> int:
    """The least compute capability of the GPUs here, 90 for 9.0."""
    return min(int(x.compute_capability.replace(".", "")) for x in jax.local_devices(backend="cuda"))


class Kernel:
    """A kernel as PTX, in which `N_STATES` stands for the number of states."""

    def __init__(self, text: str):
        self.text = text


_COMPILED: weakref.WeakValueDictionary[tuple[Code, int], Kernel] = weakref.WeakValueDictionary()


def compiled(code: Code, capability: int | None = None) -> Kernel:
    """The Kernel of code, or the one that is in use already."""
    capability = capability or _capability()
    if (found := _COMPILED.get((code, capability))) is not None:
        return found
    target = cpu.Target(f"sm_{max(x for x in CAPABILITIES if x <= capability)}", "")

    def made() -> bytes:
        cpu.llvm.initialize_all_targets()
        cpu.llvm.initialize_all_asmprinters()
        module = cpu.llvm.parse_assembly(f'target triple = "{TRIPLE}"\n{code.text}')
        module.verify()
        target_machine = cpu.llvm.Target.from_triple(TRIPLE).create_target_machine(cpu=target.cpu, opt=2)
        return target_machine.emit_assembly(module).encode()

    kernel = Kernel(cpu.on_disk(f"{cpu.name_of([code.text], target)}.ptx", made).decode())
    return _COMPILED.setdefault((code, capability), kernel)


def call(code: Code, arrays: Sequence[jax.Array], n: int, n_devices: int = 1) -> list[jax.Array]:
    """Calls code over n states, while JAX traces: arrays (n, size), or (1, size) if all states share them.

    Args:
        code: what to compute.
        arrays: its arguments.
        n: the number of states.
        n_devices: for how many devices XLA compiles one program. It then splits the states as its inputs are split.

    Returns:
        Arrays (n, size), or (1, size) where results are summed over states.
    """
    return _on_devices(code, arrays, n) if n_devices > 1 and n % n_devices == 0 else _called(code, arrays, n)


def _called(code: Code, arrays: Sequence[jax.Array], n: int) -> list[jax.Array]:
    """The call on one device."""
    n_warps = -(-n // WARP)
    shapes = [jax.ShapeDtypeStruct((n_warps if x.is_summed else n, x.size), x.dtype) for x in code.results]
    warps = code.warps if n_warps >= MANY_WARPS else 1
    kernel: dict[str, Any] = {
        "name": "kernel",
        "kernel_type": "ptx",
        "kernel_data": compiled(code).text.replace(str(N_STATES), str(n)),
        **_along_axes("grid", -(-n_warps // warps)),
        **_along_axes("block", warps * WARP),
        "shared_mem_bytes": np.int32(0),
        "output_indices": tuple(np.int32(len(arrays) + k) for k in range(len(shapes))),
    }
    results = jax.ffi.ffi_call("__gpu$xla.gpu.ptx", shapes)(*arrays, **kernel)
    return [
        y.sum(0, keepdims=True, dtype=x.dtype) if x.is_summed and n_warps > 1 else y
        for x, y in zip(code.results, results, strict=True)
    ]


def _along_axes(name: str, n: int) -> dict[str, np.int32]:
    return {f"{name}_{axis}": np.int32(k) for axis, k in zip("xyz", (n, 1, 1), strict=True)}


def _on_devices(code: Code, arrays: Sequence[jax.Array], n: int) -> list[jax.Array]:
    """The call, which each device makes for its states, an equal number of them; sums are added up over devices."""

    def whole(*arrays: jax.Array) -> tuple[jax.Array, ...]:
        return tuple(_called(code, arrays, n))

    def placed(mesh, arguments: Sequence) -> tuple[Any, list, list]:
        """(the axes of the mesh that states are split over, shardings of arguments, of results)."""
        specs = [x.sharding.spec for x, own in zip(arguments, code.arguments, strict=True) if not own.is_shared]
        axis = next((spec[0] for spec in specs if len(spec) and spec[0] is not None), None)
        split, same = (NamedSharding(mesh, PartitionSpec(a, None)) for a in (axis, None))
        return (
            axis,
            [same if x.is_shared else split for x in code.arguments],
            [same if x.is_summed else split for x in code.results],
        )

    def partition(mesh, arguments: Sequence, _) -> tuple:
        axis, of_arguments, of_results = placed(mesh, arguments)
        axes = (axis,) if isinstance(axis, str) else axis or ()
        n_own = n // math.prod(mesh.shape[a] for a in axes)

        def own(*arrays: jax.Array) -> tuple[jax.Array, ...]:
            results = zip(code.results, _called(code, arrays, n_own), strict=True)
            return tuple(lax.psum(y, axes) if x.is_summed and axes else y for x, y in results)

        return mesh, own, tuple(of_results), tuple(of_arguments)

    def inferred(mesh, arguments: Sequence, _) -> tuple:
        return tuple(placed(mesh, arguments)[2])

    names = iter(f"k{i}" for i in range(2 * (len(arrays) + len(code.results))))
    rules = [f"{next(names) if x.is_shared else 'n'} {next(names)}" for x in code.arguments]
    results = [f"{next(names) if x.is_summed else 'n'} {next(names)}" for x in code.results]
    rule = f"{', '.join(rules)} -> {', '.join(results)}"
    others = tuple(dict.fromkeys(x for x in rule.replace(",", "").split() if x[0] == "k"))
    call = custom_partitioning(whole)
    call.def_partition(partition, inferred, sharding_rule=rule, need_replication_factors=others)
    return list(call(*arrays))


@functools.cache
def is_available() -> bool:
    """Whether kernels can be compiled and called here: llvmlite is installed, and a known result comes out right."""
    try:
        device = jax.local_devices(backend="cuda")[0]
    except RuntimeError:  # There is no GPU: a program is lowered for another machine.
        return False
    try:
        x, square, number = np.arange(1, 41, dtype=np.float32)[:, None], Graph(), np.dtype(np.float32)
        node = square.load(0, 0, number)
        square.results = [np.array([square.operation("mul", (node, node), number)])]
        code = code_of(square, [Argument(1, number)], [Result(1, number)], WARP)
        # Whatever the caller forbids, or is in the middle of.
        with computed_at_once(), jax.default_device(device), jax.transfer_guard("allow"):
            (y,) = jax.jit(lambda x: call(code, [x], len(x)))(x)
        if np.array_equal(np.asarray(y), x * x):
            return True
        reason = f"{x.ravel()} squared is {np.asarray(y).ravel()}"
    except Exception as error:  # Whatever goes wrong, JAX can compute the same without.
        reason = str(error)
    warnings.warn(f"jaxspatial writes no kernels of its own on this GPU: {reason}", stacklevel=2)
    return False
