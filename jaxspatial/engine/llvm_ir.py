"""A graph as LLVM IR, for W states side by side: vectors of W numbers, or single numbers where W is 1.

LLVM takes more than in proportion to the length of a function. So a long graph is a sequence of functions, `pieces`,
each of at most LONGEST operations. What one piece makes and another reads has a place in a scratch memory, the frame:
most of it would be spilled to memory anyway. A loop that fits a piece is written where it stands; of a longer one the
body is pieces, too. Numbers that turns of a loop pass on are in the frame, and so are the rows that it reads and
writes, as tables.

States may need very different numbers of turns of a long `while` loop, such as Newton's method of a step with contact.
Of W states side by side each turn takes as long for one that goes on as for all. So such a program is split: what is in
front of the loop, turns, and what is behind. In between, states that go on can be moved: see `BlockIR`.

Nothing is contracted, rearranged or assumed: results have the bits of the graph, operation by operation.
"""

import collections
import struct
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxspatial.engine import registers
from jaxspatial.engine.graph import BOOL, COMPARISONS, Graph, Loop
from jaxspatial.engine.registers import Item

# With 16 states side by side: of 500, 1500, 3000 and 8000, a G1's forward dynamics takes 0.5, 0.5, 0.6 and 0.8 s to
# compile, and 460, 450, 440 and 470 ns for a state; what fits one piece is up to a tenth faster.
LONGEST = 3000
# A program is split at a loop of at least so many operations. Of 2330, which `inverse_kinematics` of a Panda's position
# has, 1000 states take 0.54 ms, and 0.92 where the program is not split.
LEAST_SPLIT = 500
N_REGISTERS = 32  # that hold vectors, of a processor with AVX-512 or an Arm
_TYPES = {"f": "float", "d": "double", "?": "i1"}
_SUFFIXES = {"float": "f32", "double": "f64"}
_INTRINSICS = {"abs": "fabs", "sqrt": "sqrt", "round": "rint", "floor": "floor", "ceil": "ceil"}
_ORDERED = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
_SHIFTS = {"shl": "shl", "shr": "lshr", "sar": "ashr"}
# Of integers they are more than one instruction, unless the second operand is known.
_GUARDED = {"div", "rem", *_SHIFTS}
# What is read where it lies, as often as it is used: nodes that are no operations.
_PLACES = {"constant", "load", "carried", "row", "last", "stacked"}
_OF_LOOPS = {"row", "last", "stacked"}


class BlockIR(NamedTuple):
    """The IR of a graph. It defines `@block(ptr %arguments, ptr %results, ptr %frame)`: for W states, with pointers to
    their numbers (n, W), or (n,) of arguments that all states share, and frame_bytes of scratch memory.

    is_split: whether the same is also there in three functions, which are called one after the other: `@before`,
    `@turns` and `@after`. They have the parameters of `@block`. `@turns` has two more, `states` and `few`: it ends as
    soon as at most `few` of the `states` go on, and returns these. Sets of states have a bit for each. `@turns` may be
    called again, and in between states may move to other memory: `@lent(ptr %arguments, ptr %frame, i64 %states,
    ptr %of_arguments, ptr %of_frame, i64 %of_states)` copies what turns read of `of_states` to the places `states`, as
    many, in the same order. `@returned`, with the same parameters, copies what turns change.
    """

    text: str
    frame_bytes: int
    n_operations: int
    is_split: bool = False


def ir_of(
    graph: Graph, width: int, is_shared: Sequence[bool], has_fma: bool = True, has_compress: bool = False
) -> BlockIR:
    """The IR of a graph for `width` states.

    is_shared: whether all states share an argument. has_fma: whether the processor multiplies and adds in one step;
    without, the error of a product has the same bits, and takes more steps. has_compress: whether it brings some
    numbers of a vector together in one step.
    """
    return Writer(graph, width, is_shared, has_fma, has_compress).block_ir()


# -- which operations are needed, and in which order -------------------------------------------------------------------


class Scheduler:
    """The operations that results need, and orders of them.

    members: by region its operations, and its loops. inputs: by loop, the nodes that it reads and does not make.
    only_in_branches: parameters of branches that are read only in branches with the same condition: where that is
    false, they may have any value, or none.
    """

    def __init__(self, graph: Graph, n_registers: int = N_REGISTERS):
        self.n_registers = n_registers
        self.graph, self.roots = graph, [int(n) for x in graph.results for n in x.ravel()]
        self.carried = {p: (k, c) for k, loop in enumerate(graph.loops) for c, (p, _, _) in enumerate(loop.carried)}
        self.live = set[int]()
        self.live_loops = set[int]()
        self._find()
        self.items: list[Item | None] = [
            (graph.details[node][0],) if name in ("last", "stacked") else None if name in _PLACES else node
            for node, name in enumerate(graph.operations)
        ]
        # The first of the nodes that are results of a loop.
        self.first: dict[Item, int] = {}
        for node, item in enumerate(self.items):
            if type(item) is tuple:
                self.first.setdefault(item, node)
        self.members = collections.defaultdict[int, list[int]](list)
        for node in sorted(self.live):
            if graph.operations[node] not in _PLACES:
                self.members[graph.regions[node]].append(node)
        around = {k: graph.parents[graph.loops[k].region] for k in self.live_loops}
        self.inner = {
            k: [j for j in sorted(self.live_loops) if graph.is_inside(around[j], graph.loops[k].region)]
            for k in self.live_loops
        }
        self.inputs = {k: self._inputs_of(k) for k in self.live_loops}
        self.only_in_branches = self._only_in_branches()

    def _find(self) -> None:
        g, waiting = self.graph, list(self.roots)
        while waiting:
            node = waiting.pop()
            if node in self.live:
                continue
            self.live.add(node)
            waiting += g.operands[node]
            name = g.operations[node]
            if name not in ("carried", "row", "last", "stacked"):
                continue
            k = g.details[node] if name in ("carried", "row") else g.details[node][0]
            loop = g.loops[k]
            if k not in self.live_loops:
                self.live_loops.add(k)
                if loop.length is None:
                    waiting.append(loop.condition)
            if name == "carried":
                waiting += loop.carried[self.carried[node][1]]
            elif name == "row":
                waiting += loop.rows[node]
            elif name == "last":
                waiting += loop.carried[g.details[node][1]]
            else:
                waiting.append(loop.stacked[g.details[node][1]])

    def carried_of(self, loop: Loop) -> list[tuple[int, int, int]]:
        return [c for c in loop.carried if c[0] in self.live]

    def rows_of(self, loop: Loop) -> list[int]:
        return [p for p in loop.rows if p in self.live]

    def stacked_of(self, k: int) -> list[int]:
        """The stacked nodes that are read."""
        g = self.graph
        return [i for i, node in enumerate(g.loops[k].stacked) if node in self.live]

    def ends(self, k: int) -> list[int]:
        """What a turn of a loop makes: new values of what it carries, and what is stacked."""
        loop = self.graph.loops[k]
        return [*(new for _, _, new in self.carried_of(loop)), *(loop.stacked[i] for i in self.stacked_of(k))]

    def starts(self, k: int) -> list[int]:
        """What is read in front of a loop."""
        loop = self.graph.loops[k]
        return [
            *(first for _, first, _ in self.carried_of(loop)),
            *(n for p in self.rows_of(loop) for n in loop.rows[p]),
        ]

    def _inputs_of(self, k: int) -> list[int]:
        g, region = self.graph, self.graph.loops[k].region
        found = dict.fromkeys(self.starts(k))
        for j in (k, *self.inner[k]):
            loop = g.loops[j]
            reads = [x for node in self.members[loop.region] for x in g.operands[node]]
            reads += self.ends(j)
            reads += [loop.condition] if loop.length is None else []
            reads += self.starts(j) if j != k else []
            found.update(dict.fromkeys(x for x in reads if not g.is_inside(g.regions[x], region)))
        return list(found)

    def _only_in_branches(self) -> set[int]:
        g = self.graph
        branch_at = {loop.region: loop for loop in g.loops if loop.is_branch}
        found = {c[0] for k in self.live_loops if g.loops[k].is_branch for c in self.carried_of(g.loops[k])}

        def is_in_branch(region: int, condition: int) -> bool:
            while region > 0:
                if region in branch_at and branch_at[region].condition == condition:
                    return True
                region = g.parents[region]
            return False

        def read(nodes: Iterable[int], region: int) -> None:
            for node in nodes:
                if g.operations[node] == "last":
                    k, which, _ = g.details[node]
                    parameter = g.loops[k].carried[which][0]
                    if parameter in found and not is_in_branch(region, g.loops[k].condition):
                        found.remove(parameter)

        read(self.roots, 0)
        for k in self.live_loops:
            loop = g.loops[k]
            read(self.starts(k), g.parents[loop.region])
            read(self.ends(k), loop.region)
            if loop.length is None:
                read([loop.condition], g.parents[loop.region] if loop.is_branch else loop.region)
        for node in self.live:
            read(g.operands[node], g.regions[node])
        return found

    def scheduled(self, region: int, roots: Sequence[int], done: set[Item]) -> list[Item]:
        """The items of a region that these nodes need, but those that are done.

        Depth first, or as they were traced. Neither is always better: in the order of the trace inverse dynamics of a
        Panda takes 18 ns for a state instead of 21, the gradient of its forward dynamics 114 instead of 133; depth
        first the mass matrix of a G1 takes 430 instead of 620, and forward dynamics of a Panda in float64 for float32,
        with products part of sums, 87 instead of 117, though it reads only a tenth fewer.
        """
        order = self._depth_first(region, roots, done)
        # In the order of the trace, a node is behind those that it reads, results of a loop behind all that it needs.
        as_traced = sorted(order, key=lambda item: self.first[item] if type(item) is tuple else item)
        if self.n_registers > N_REGISTERS:
            backward = self._depth_first(region, roots[::-1], done)
            all_items = as_traced, order, backward
            orders = [registers.Order(self.graph, x, self.items, self.nodes_read) for x in all_items]
            orders = [orders[0], *(x.with_few_waiting(roots) for x in orders[1:])]
            best = min(orders, key=lambda x: x.excess(self.n_registers))
            if region == 0:
                best.compute_again(self.n_registers)
            order = best.items
        elif self._reloads(as_traced) <= 1.05 * self._reloads(order):
            order = as_traced
        done.update(order)
        return order

    def nodes_read(self, item: Item) -> Iterable[int]:
        return self.inputs[item[0]] if type(item) is tuple else self.graph.operands[item]

    def _depth_first(self, region: int, roots: Sequence[int], done: set[Item]) -> list[Item]:
        items, regions, order, done = self.items, self.graph.regions, list[Item](), set(done)
        # Each item that waits, and what it reads and has not been looked at.
        stack: list[tuple[Item, Iterator[int]]] = [(None, iter(roots))]
        while stack:
            waiting, rest = stack[-1]
            for node in rest:
                item = items[node]
                if item is not None and regions[node] == region and item not in done:
                    done.add(item)
                    stack.append((item, iter(self.nodes_read(item))))
                    break
            else:
                stack.pop()
                if waiting is not None:
                    order.append(waiting)
        return order

    def _reloads(self, order: Sequence[Item]) -> int:
        """How often an item reads what no register holds any more, because so many other items lie in between."""
        items, last, count = self.items, dict[Item, int](), 0
        for k, item in enumerate(order):
            last[item] = k
            for node in self.nodes_read(item):
                read = items[node]
                if read in last:
                    count += k - last[read] > self.n_registers
                    last[read] = k
        return count

    def size(self, item: tuple[int]) -> int:
        """About how many instructions a loop has."""
        return 4 + sum(len(self.members[self.graph.loops[j].region]) for j in (item[0], *self.inner[item[0]]))


class _Rows(NamedTuple):
    """Where rows that a loop reads lie: in an argument, among what another loop stacked, or constants.

    first: of an argument its number and the first place, of what is stacked the `details` of the first row, of
    constants their nodes. step: the places from row to row.
    """

    operation: str
    first: Any
    step: int


class _Place(NamedTuple):
    """Where numbers of W states are: in an argument, None for the frame, so many bytes from its start."""

    argument: int | None
    first: int
    dtype: np.dtype


class _BodyPieces(NamedTuple):
    """A loop: pieces in front of its condition, and after. own: the piece that begins and ends turns."""

    own: int
    condition: list[int]
    rest: list[int]


# -- places in the frame -----------------------------------------------------------------------------------------------


class _Frame:
    """Places in the frame, which are used again when nobody reads them any more."""

    def __init__(self):
        self.size = 0
        self.free = collections.defaultdict[int, list[int]](list)

    def taken(self, n_bytes: int) -> int:
        n_bytes = max(n_bytes, 1)
        if self.free[n_bytes]:
            return self.free[n_bytes].pop()
        alignment = min(64, 1 << (n_bytes - 1).bit_length()) if n_bytes < 64 else 64
        first = -(-self.size // alignment) * alignment
        self.size = first + n_bytes
        return first


class Function:
    """The text of one function. registers: of nodes that it has made or read. lanes: of indices, state by state.
    result: what it returns, with its type.

    Pointers are texts with their types, like "ptr %frame".
    """

    def __init__(self, name: str, parameters: Sequence[str]):
        self.name, self.parameters, self.result = name, parameters, "void"
        self.lines, self.entry = list[str](), list[str]()
        self.registers, self.lanes = dict[int, str](), dict[int, list[str]]()
        self.pointers = dict[str, str]()
        self.count = 0

    def new(self) -> str:
        self.count += 1
        return f"%v{self.count}"

    def add(self, line: str) -> None:
        self.lines.append("  " + line)

    def pointer(self, array: str, k: int) -> str:
        """Of argument or result k, read once at the entry."""
        key = f"{array}{k}"
        if key not in self.pointers:
            self.pointers[key] = f"ptr %{key}"
            self.entry.append(f"  %at.{key} = getelementptr ptr, ptr %{array}, i64 {k}")
            self.entry.append(f"  %{key} = load ptr, ptr %at.{key}")
        return self.pointers[key]

    def text(self, linkage: str) -> str:
        t = self.result.split()[0]
        head = f"define {linkage}{t} @{self.name}({', '.join(self.parameters)}) {{"
        end = f"  ret {self.result}"
        return "\n".join([head, "entry:", *self.entry, "  br label %body", "body:", *self.lines, end, "}"])


class Writer:
    """Writes a graph. A subclass says what functions are given, and where arguments and results are."""

    parameters: Sequence[str] = ("ptr noalias %arguments", "ptr noalias %results", "ptr noalias %frame")
    frame = "ptr %frame"

    def __init__(
        self,
        graph: Graph,
        width: int,
        is_shared: Sequence[bool],
        has_fma: bool,
        has_compress: bool = False,
        n_registers: int = N_REGISTERS,
    ):
        self.graph, self.width, self.is_shared, self.scheduler = graph, width, is_shared, Scheduler(graph, n_registers)
        self.has_fma, self.has_compress, self.longest = has_fma, has_compress, LONGEST
        self.declared, self.globals = set[str](), dict[str, str]()
        self.types, self.literals = dict[str, str](), dict[int, str]()
        self.templates: dict[tuple[str, str, str, bool], str] = {}
        self.schedules: dict[int, tuple[list[Item], list[Item]]] = {}
        self.pieces: list[list[Item]] = []
        self.bodies: dict[int, _BodyPieces] = {}
        self.home, self.readers = dict[int, int](), collections.defaultdict[int, set[int]](set)
        self.slots: dict[int, int] = {}
        self.indices: dict[int, int] = {}
        self.rows_in_frame: dict[tuple, tuple[int, int]] = {}  # places in the frame, and bytes from row to row
        # By table, index and places behind it.
        self.lookups = {
            (graph.details[n][0], graph.operands[n][0], graph.details[n][1]): n
            for n in self.scheduler.live
            if graph.operations[n] == "lookup"
        }
        self.result_places = collections.defaultdict[int, list[tuple[int, int]]](list)
        for k, nodes in enumerate(graph.results):
            for j, node in enumerate(nodes.ravel().tolist()):
                self.result_places[node].append((k, j))

    # -- the plan -----------------------------------------------------------------------------------------------------

    def _in_pieces(self, items: Iterable[Item]) -> list[int]:
        """Pieces for items in this order: their numbers, among which those of long loops are their own pieces."""
        found, current, size = list[int](), list[Item](), 0

        def close() -> None:
            nonlocal current, size
            if current:
                self.pieces.append(current)
                found.append(len(self.pieces) - 1)
            current, size = [], 0

        for item in items:
            n = self.scheduler.size(item) if type(item) is tuple else 1
            if n > self.longest or type(item) is tuple and self._may_split(item[0]):
                close()
                self.pieces.append([item])
                own, (condition, rest) = len(self.pieces) - 1, self._scheduled_body(item[0])
                self.bodies[item[0]] = _BodyPieces(own, self._in_pieces(condition), self._in_pieces(rest))
                found.append(own)
                continue
            if size + n > self.longest:
                close()
            current.append(item)
            size += n
        close()
        return found

    def _scheduled_body(self, k: int) -> tuple[list[Item], list[Item]]:
        """(the items in front of the condition of a loop, those after it)."""
        if k not in self.schedules:
            loop, done = self.graph.loops[k], set[Item]()
            condition = [] if loop.length is not None else self.scheduler.scheduled(loop.region, [loop.condition], done)
            self.schedules[k] = condition, self.scheduler.scheduled(loop.region, self.scheduler.ends(k), done)
        return self.schedules[k]

    def note_homes(self) -> None:
        """Which piece makes each node, and which others read it."""
        for p, items in enumerate(self.pieces):
            self._note_items(p, items)
        for node in self.result_places:
            if node in self.home:
                self.readers[node].add(self.home[node])

    def _note_items(self, p: int, items: Iterable[Item]) -> None:
        home, readers, operands = self.home, self.readers, self.graph.operands
        for item in items:
            if type(item) is not tuple:
                home[item] = p
                reads: Iterable[int] = operands[item]
            else:
                k = item[0]
                loop = self.graph.loops[k]
                reads = [*self.scheduler.starts(k), *self.scheduler.ends(k)]
                reads += [loop.condition] if loop.length is None else []
                if k not in self.bodies:
                    for part in self._scheduled_body(k):
                        self._note_items(p, part)
            for node in reads:
                readers[node].add(p)

    # -- places -------------------------------------------------------------------------------------------------------

    def _bytes(self, dtype: np.dtype) -> int:
        return max(self.width // 8, 1) if dtype.kind == "b" else self.width * dtype.itemsize

    def _allocate(self) -> int:
        """Gives places in the frame to what another piece reads, and to what loops carry: the size of the frame."""
        begin, end, clock = dict[int | tuple, int](), dict[int | tuple, int](), 0
        size_of: dict[int | tuple, int] = {}

        operations, operands, dtypes = self.graph.operations, self.graph.operands, self.graph.dtypes
        readers = self.readers

        def touch(key, n_bytes: int) -> None:
            begin.setdefault(key, clock)
            end[key] = max(end.get(key, 0), clock)
            size_of[key] = n_bytes

        def read(node: int) -> None:
            name = operations[node]
            if name == "last":
                k, which, _ = self.graph.details[node]
                node = self.graph.loops[k].carried[which][0]
            elif name == "stacked":
                k, which, _ = self.graph.details[node]
                key = "stacked", k, which
                touch(key, size_of[key])
                return
            elif name == "row":
                key = "rows", node
                if key in size_of:
                    touch(key, size_of[key])
                return
            if node in begin:
                touch(node, size_of[node])

        def walk(items: Iterable[Item], p: int) -> None:
            nonlocal clock
            for item in items:
                clock += 1
                if type(item) is tuple:
                    loop_at(item[0], p)
                    continue
                for x in operands[item]:
                    if x in begin or operations[x] in _OF_LOOPS:
                        read(x)
                if len(readers[item]) > 1 or p not in readers[item]:
                    touch(item, self._bytes(dtypes[item]))

        def loop_at(k: int, p: int) -> None:
            nonlocal clock
            loop, start = self.graph.loops[k], clock
            own: list = [("index", k)]
            touch(own[0], 8)
            for node in self.scheduler.starts(k):
                read(node)
            for parameter, _, _ in self.scheduler.carried_of(loop):
                touch(parameter, self._bytes(dtypes[parameter]))
                own.append(parameter)
            for i in self.scheduler.stacked_of(k):
                key = "stacked", k, i
                touch(key, self._bytes(dtypes[loop.stacked[i]]) * int(loop.length or 0))
                own.append(key)
            for parameter in self.scheduler.rows_of(loop):
                rows = self._rows_elsewhere(parameter, loop)
                if rows is None:
                    key = "rows", parameter
                    touch(key, self._bytes(dtypes[parameter]) * int(loop.length or 0))
                    own.append(key)
                elif rows.operation == "stacked":
                    own.append(("stacked", *rows.first[:2]))
            if k in self.bodies:
                for q in (*self.bodies[k].condition, *self.bodies[k].rest):
                    walk(self.pieces[q], q)
            else:
                for part in self._scheduled_body(k):
                    walk(part, p)
            clock += 1
            for node in self.scheduler.ends(k) + ([loop.condition] if loop.length is None else []):
                read(node)
            # What was there before the loop, and is read in it, is read again in the next turn; so is what it owns.
            for key, first in begin.items():
                if first <= start and end[key] >= start or key in own:
                    end[key] = max(end[key], clock) if end[key] > start or key in own else end[key]

        for p in self.top:
            walk(self.pieces[p], p)
        clock += 1
        for node in self.result_places:
            read(node)
        frame, ending = _Frame(), collections.defaultdict[int, list[int | tuple]](list)
        for key, last in end.items():
            ending[last].append(key)
        places: dict[int | tuple, int] = {}
        done = 0
        for key in sorted(begin, key=begin.__getitem__):
            for t in range(done, begin[key]):
                for old in ending[t]:
                    frame.free[max(size_of[old], 1)].append(places[old])
            done = max(done, begin[key])
            places[key] = frame.taken(size_of[key])
        for key, place in places.items():
            if isinstance(key, int):
                self.slots[key] = place
            elif key[0] == "index":
                self.indices[key[1]] = place
            else:
                length = self.graph.loops[key[1] if key[0] == "stacked" else self.graph.details[key[1]]].length
                self.rows_in_frame[key] = place, size_of[key] // max(int(length or 1), 1)
        return frame.size

    def _rows_elsewhere(self, parameter: int, loop: Loop) -> _Rows | None:
        """Where the rows of a parameter lie already, if they do."""
        g, nodes = self.graph, loop.rows[parameter]
        names = {g.operations[n] for n in nodes}
        if names == {"constant"}:
            return _Rows("constant", nodes, 1)
        if names == {"load"}:
            places = [g.details[n] for n in nodes]
            steps = {b[1] - a[1] for a, b in zip(places, places[1:], strict=False)}
            if len({k for k, _ in places}) == 1 and len(steps) == 1 and g.dtypes[parameter].kind != "b":
                return _Rows("load", places[0], steps.pop())
        if names == {"stacked"}:
            places = [g.details[n] for n in nodes]
            steps = {b[2] - a[2] for a, b in zip(places, places[1:], strict=False)}
            if len({x[:2] for x in places}) == 1 and steps == {1}:
                return _Rows("stacked", places[0], 1)
        return None

    def argument(self, f: Function, k: int) -> str:
        return f.pointer("arguments", k)

    def result(self, f: Function, k: int) -> str:
        return f.pointer("results", k)

    # -- types and numbers --------------------------------------------------------------------------------------------

    def scalar(self, dtype: np.dtype) -> str:
        return _TYPES.get(dtype.char) or f"i{8 * dtype.itemsize}"

    def type(self, dtype: np.dtype) -> str:
        t = self.types.get(dtype.char)
        if t is None:
            t = self.scalar(dtype)
            t = self.types[dtype.char] = t if self.width == 1 else f"<{self.width} x {t}>"
        return t

    def suffix(self, dtype: np.dtype) -> str:
        t = self.scalar(dtype)
        t = _SUFFIXES.get(t, t)
        return t if self.width == 1 else f"v{self.width}{t}"

    def literal(self, x, dtype: np.dtype) -> str:
        t, value = self.scalar(dtype), _literal(x, dtype)
        return value if self.width == 1 else f"splat ({t} {value})"

    def loaded(self, f: Function, pointer: str, dtype: np.dtype) -> str:
        register = f.new()
        f.add(f"{register} = load {self.type(dtype)}, {pointer}, align {min(64, self._bytes(dtype))}")
        return register

    def stored(self, f: Function, value: str, pointer: str, dtype: np.dtype) -> None:
        f.add(f"store {self.type(dtype)} {value}, {pointer}, align {min(64, self._bytes(dtype))}")

    def offset(self, f: Function, pointer: str, n_bytes: int | str) -> str:
        if n_bytes == 0:
            return pointer
        register = f.new()
        f.add(f"{register} = getelementptr i8, {pointer}, i64 {n_bytes}")
        return f"{pointer.rpartition(' ')[0]} {register}"

    def spread(self, f: Function, value: str, dtype: np.dtype) -> str:
        """A vector of W times one number."""
        if self.width == 1:
            return value
        t, one, whole = self.scalar(dtype), f.new(), f.new()
        f.add(f"{one} = insertelement {self.type(dtype)} poison, {t} {value}, i64 0")
        zeros = f"<{self.width} x i32> zeroinitializer"
        f.add(f"{whole} = shufflevector {self.type(dtype)} {one}, {self.type(dtype)} poison, {zeros}")
        return whole

    # -- reading nodes ------------------------------------------------------------------------------------------------

    def read(self, f: Function, node: int) -> str:
        g = self.graph
        if node in g.constants:
            if node not in self.literals:
                self.literals[node] = self.literal(g.constants[node], g.dtypes[node])
            return self.literals[node]
        if node not in f.registers:
            f.registers[node] = self._read_anew(f, node)
        return f.registers[node]

    def read_again(self, f: Function, node: int) -> str:
        """For an operation that is done again."""
        return self.read(f, node)

    def _read_anew(self, f: Function, node: int) -> str:
        g, dtype = self.graph, self.graph.dtypes[node]
        name = g.operations[node]
        if name == "load":
            k, place = g.details[node]
            pointer = self.argument(f, k)
            return self._read_outside(f, pointer, place * self._stride(k, dtype), dtype, self.is_shared[k])
        if name == "row":
            return self._read_row(f, node, g.loops[g.details[node]])
        if name == "stacked":
            k, which, row = g.details[node]
            place, stride = self.rows_in_frame["stacked", k, which]
            return self.loaded(f, self.offset(f, self.frame, place + row * stride), dtype)
        if name == "last":
            k, which, _ = g.details[node]
            node = g.loops[k].carried[which][0]
        return self.loaded(f, self.offset(f, self.frame, self.slots[node]), dtype)

    def _stride(self, k: int, dtype: np.dtype) -> int:
        return dtype.itemsize * (1 if self.is_shared[k] else self.width)

    def _read_outside(self, f: Function, pointer: str, place: int | str, dtype: np.dtype, is_shared: bool) -> str:
        """A number that is outside of the frame."""
        at = self.offset(f, pointer, place)
        inside = np.dtype(np.uint8) if dtype.kind == "b" else dtype
        if is_shared:
            one = f.new()
            f.add(f"{one} = load {self.scalar(inside)}, {at}")
            value = self.spread(f, one, inside)
        else:
            value = self.loaded(f, at, inside)
        if dtype.kind != "b":
            return value
        mask = f.new()
        f.add(f"{mask} = icmp ne {self.type(inside)} {value}, {self.literal(0, inside)}")
        return mask

    def _index(self, f: Function, k: int) -> str:
        """The row that the turn of loop k is for."""
        register = f.new()
        f.add(f"{register} = load i64, {self.offset(f, self.frame, self.indices[k])}")
        return register

    def _read_row(self, f: Function, node: int, loop: Loop) -> str:
        g, dtype = self.graph, self.graph.dtypes[node]
        index = self._index(f, g.details[node])
        kind, first, step = self._rows_elsewhere(node, loop) or _Rows("own", (), 1)
        if kind == "constant":
            inside, at = np.dtype(np.uint8) if dtype.kind == "b" else dtype, f.new()
            table = self._constant_table([g.constants[n] for n in first], inside)
            f.add(f"{at} = getelementptr {self.scalar(inside)}, ptr {table}, i64 {index}")
            return self._read_outside(f, f"ptr {at}", 0, dtype, is_shared=True)
        scaled = f.new()
        if kind == "load":
            k, place = first
            stride = self._stride(k, dtype)
            f.add(f"{scaled} = mul i64 {index}, {step * stride}")
            base = self.offset(f, self.argument(f, k), place * stride)
            return self._read_outside(f, base, scaled, dtype, self.is_shared[k])
        if kind == "stacked":
            k, which, row = first
            place, stride = self.rows_in_frame["stacked", k, which]
            place += row * stride
        else:
            place, stride = self.rows_in_frame["rows", node]
        f.add(f"{scaled} = mul i64 {index}, {stride}")
        return self.loaded(f, self.offset(f, self.offset(f, self.frame, place), scaled), dtype)

    def _looked_up(self, f: Function, node: int, index: str) -> str:
        """What a table has behind an index. It is read for one state after the other: a gather is slower on processors
        that are protected against Gather Data Sampling. Two numbers beside each other are read at once."""
        g, dtype = self.graph, self.graph.dtypes[node]
        (number, places), (of,) = g.details[node], g.operands[node]
        table, t, shared = g.tables[number], self.scalar(dtype), True
        if table[0] in g.constants:
            base, size = f"ptr {self._constant_table([g.constants[n] for n in table], dtype)}", dtype.itemsize
        else:
            k, first = g.details[table[0]]
            size, shared = self._stride(k, dtype), self.is_shared[k]
            base = self.offset(f, self.argument(f, k), first * size)
        base, lanes = self.offset(f, base, places * size), self._lanes(f, of, index)
        cell = t if shared else f"[{self.width} x {t}]"
        beside = self.lookups.get((number, of, places + 1), node) if shared and self.width > 1 else node
        is_pair = beside != node and beside not in f.registers and g.regions[beside] == g.regions[node]
        read_as, align = (f"<2 x {t}>", f", align {dtype.itemsize}") if is_pair else (t, "")
        parts = list[str]()
        for lane, place in enumerate(lanes):
            at, one = f.new(), f.new()
            f.add(f"{at} = getelementptr {cell}, {base}, i64 {place}{'' if shared else f', i64 {lane}'}")
            f.add(f"{one} = load {read_as}, {base.rpartition(' ')[0]} {at}{align}")
            parts.append(one)
        if self.width == 1:
            return parts[0]
        if not is_pair:
            value = "poison"
            for lane, one in enumerate(parts):
                value, before = f.new(), value
                f.add(f"{value} = insertelement {self.type(dtype)} {before}, {t} {one}, i64 {lane}")
            return value
        n = 2
        while len(parts) > 1:
            both = zip(parts[::2], parts[1::2], strict=True)
            parts, n = [self._shuffled(f, a, b, t, n, range(2 * n)) for a, b in both], 2 * n
        f.registers[beside] = self._shuffled(f, parts[0], "poison", t, n, range(1, n, 2))
        return self._shuffled(f, parts[0], "poison", t, n, range(0, n, 2))

    def _lanes(self, f: Function, node: int, index: str) -> list[str]:
        """An index state by state, as i64."""
        if node not in f.lanes:
            kind, wide, found = self.graph.dtypes[node], np.dtype(np.int64), list[str]()
            convert = _conversion(kind, wide) if kind.itemsize < wide.itemsize else "bitcast"
            for lane in range(self.width):
                one, place = index, f.new()
                if self.width > 1:
                    one = f.new()
                    f.add(f"{one} = extractelement {self.type(kind)} {index}, i64 {lane}")
                f.add(f"{place} = {convert} {self.scalar(kind)} {one} to i64")
                found.append(place)
            f.lanes[node] = found
        return f.lanes[node]

    def _shuffled(self, f: Function, a: str, b: str, t: str, n: int, places: Iterable[int]) -> str:
        """Numbers of two vectors of n, by their places."""
        register, vector, mask = f.new(), f"<{n} x {t}>", [f"i32 {k}" for k in places]
        f.add(f"{register} = shufflevector {vector} {a}, {vector} {b}, <{len(mask)} x i32> <{', '.join(mask)}>")
        return register

    def _constant_table(self, values: Sequence[Any], dtype: np.dtype) -> str:
        """The name of a table of constants."""
        t = self.scalar(dtype)
        items = ", ".join(f"{t} {_literal(x, dtype)}" for x in values)
        content = f"[{len(values)} x {t}] [{items}]"
        return self.globals.setdefault(content, f"@table{len(self.globals)}")

    # -- writing ------------------------------------------------------------------------------------------------------

    def plan(self) -> int:
        """Plans pieces and places: the size of the frame."""
        self.top = self._in_pieces(self.scheduler.scheduled(0, self.scheduler.roots, set()))
        self.note_homes()
        return self._allocate()

    def block_ir(self) -> BlockIR:
        size = self.plan()
        # The longest loop of those at which it may be split.
        may_split = filter(self._may_split, self.bodies)
        k = max(may_split, key=lambda k: self.scheduler.size((k,)), default=None)
        block, split = Function("block", self.parameters), list[Function]()
        if k is None:
            self.write_calls(block, self.top)
            self._write_known_results(block)
        else:
            split = self._split_at(k)
            self._write_call(block, "before")
            block.add(f"%left = call i64 @turns({self._passed()}, i64 -1, i64 0)")
            self._write_call(block, "after")
        pieces = [self.piece(p) for p in range(len(self.pieces)) if k is None or p != self.bodies[k].own]
        text = self.module_text(pieces, "\n".join(f.text("") for f in (*split, block)))
        return BlockIR(text, size, sum(map(len, self.scheduler.members.values())), k is not None)

    def write_calls(self, f: Function, pieces: Iterable[int]) -> None:
        for p in pieces:
            self._write_call(f, f"piece{p}")

    def _write_known_results(self, f: Function) -> None:
        """Results that no piece makes."""
        for node, places in self.result_places.items():
            if node not in self.home:
                self.stored_results(f, node, places)

    def module_text(self, functions: Iterable[Function], last: str) -> str:
        """The text of the module."""
        tables = [f"{name} = internal constant {content}" for content, name in self.globals.items()]
        texts = [f.text("internal ") for f in functions]
        return "\n".join([*tables, *texts, last, *sorted(self.declared), ""])

    def _write_call(self, f: Function, name: str) -> None:
        f.add(f"call void @{name}({self._passed()})")

    def _passed(self) -> str:
        return ", ".join(x.replace("noalias ", "") for x in self.parameters)

    def piece(self, p: int) -> Function:
        f = Function(f"piece{p}", self.parameters)
        self.write(f, p, self.pieces[p])
        return f

    def write(self, f: Function, p: int, items: Iterable[Item]) -> None:
        operands, dtypes, copies = self.graph.operands, self.graph.dtypes, self.graph.copies
        lines, slots, results = f.lines, self.slots, self.result_places
        read, template_of = self.read, self._template_of
        for item in items:
            if type(item) is tuple:
                self._write_loop(f, p, item[0])
                continue
            registers = f.registers
            if item in copies:
                values = [self.read_again(f, x) for x in operands[item]]
            else:
                values = [registers[x] if x in registers else read(f, x) for x in operands[item]]
            if self.graph.operations[item] == "lookup":
                register = registers.get(item) or self._looked_up(f, item, *values)
                registers[item] = register
            else:
                register = registers[item] = f"%n{item}"
                lines.append(template_of(item).format(register, *values))
            if item in slots:
                self.stored(f, register, self.offset(f, self.frame, slots[item]), dtypes[item])
            if item in results:
                self.stored_results(f, item, results[item])

    def stored_results(self, f: Function, node: int, places: Iterable[tuple[int, int]]) -> None:
        """Results are stored as soon as they are known."""
        value, dtype = self.read_for_outside(f, node)
        for k, j in places:
            pointer = self.offset(f, self.result(f, k), j * self.width * dtype.itemsize)
            self.stored(f, value, pointer, dtype)

    def read_for_outside(self, f: Function, node: int) -> tuple[str, np.dtype]:
        """A number as it is outside of the frame, where masks are bytes."""
        value, dtype = self.read(f, node), self.graph.dtypes[node]
        if dtype.kind != "b":
            return value, dtype
        mask, value, byte = value, f.new(), np.dtype(np.uint8)
        f.add(f"{value} = zext {self.type(dtype)} {mask} to {self.type(byte)}")
        return value, byte

    def _write_loop(self, f: Function, p: int, k: int) -> None:
        g, loop, scheduler = self.graph, self.graph.loops[k], self.scheduler
        self._write_start(f, k)
        index = self.offset(f, self.frame, self.indices[k])
        first, last, step = (int(loop.length or 0) - 1, 0, -1) if loop.is_reverse else (0, int(loop.length or 0) - 1, 1)
        f.add(f"store i64 {first}, {index}")
        f.count += 1
        head, body, end = (f"{name}{f.count}" for name in ("head", "turn", "end"))
        f.add(f"br label %{head}")
        f.lines.append(f"{head}:")
        outside, lanes = dict(f.registers), dict(f.lanes)
        self._write_part(f, p, k, 0)
        active = ""
        if loop.length is None:
            active = any_active = self.read(f, loop.condition)
            if self.width > 1:
                any_active, mask = f.new(), self.type(BOOL)
                f.add(f"{any_active} = {self.call(f'llvm.vector.reduce.or.v{self.width}i1', 'i1', (mask, active))}")
            f.add(f"br i1 {any_active}, label %{body}, label %{end}")
            f.lines.append(f"{body}:")
        self._write_part(f, p, k, 1)
        for i in scheduler.stacked_of(k):
            place, stride = self.rows_in_frame["stacked", k, i]
            row, scaled = self._index(f, k), f.new()
            f.add(f"{scaled} = mul i64 {row}, {stride}")
            pointer = self.offset(f, self.offset(f, self.frame, place), scaled)
            self.stored(f, self.read(f, loop.stacked[i]), pointer, g.dtypes[loop.stacked[i]])
        self._store_carried(f, [(c[0], c[2]) for c in scheduler.carried_of(loop)], active)
        if loop.length is None:
            f.add(f"br label %{end if loop.is_branch else head}")
        else:
            row, following, is_last = self._index(f, k), f.new(), f.new()
            f.add(f"{is_last} = icmp eq i64 {row}, {last}")
            f.add(f"{following} = add i64 {row}, {step}")
            f.add(f"store i64 {following}, {index}")
            f.add(f"br i1 {is_last}, label %{end}, label %{head}")
        f.lines.append(f"{end}:")
        f.registers, f.lanes = outside, lanes

    def _write_start(self, f: Function, k: int) -> None:
        """Stores what the first turn of a loop reads."""
        loop, scheduler = self.graph.loops[k], self.scheduler
        for parameter in scheduler.rows_of(loop):
            if ("rows", parameter) in self.rows_in_frame:
                place, stride = self.rows_in_frame["rows", parameter]
                for row, node in enumerate(loop.rows[parameter]):
                    pointer = self.offset(f, self.frame, place + row * stride)
                    self.stored(f, self.read(f, node), pointer, self.graph.dtypes[parameter])
        carried = (c for c in scheduler.carried_of(loop) if c[0] not in scheduler.only_in_branches)
        self._store_carried(f, [(parameter, first) for parameter, first, _ in carried])

    def _write_part(self, f: Function, p: int, k: int, part: int) -> None:
        """What is in front of the condition of a loop, 0, or after it, 1."""
        if k not in self.bodies:
            self.write(f, p, self._scheduled_body(k)[part])
            return
        self.write_calls(f, self.bodies[k].rest if part else self.bodies[k].condition)

    def _store_carried(self, f: Function, pairs: Sequence[tuple[int, int]], active: str = "") -> None:
        """Stores new values of what a loop carries. All are read before the first is stored.

        active: of lanes that go on; others keep what they have.
        """
        values: list[str] = []
        for parameter, node in pairs:
            value, dtype = self.read(f, node), self.graph.dtypes[parameter]
            if active and self.width > 1 and parameter not in self.scheduler.only_in_branches:
                old, chosen, t = self.read(f, parameter), f.new(), self.type(dtype)
                f.add(f"{chosen} = select {self.type(BOOL)} {active}, {t} {value}, {t} {old}")
                value = chosen
            values.append(value)
        for (parameter, _), value in zip(pairs, values, strict=True):
            pointer = self.offset(f, self.frame, self.slots[parameter])
            self.stored(f, value, pointer, self.graph.dtypes[parameter])

    # -- a program that is split at a loop ----------------------------------------------------------------------------

    def _may_split(self, k: int) -> bool:
        """Whether a loop may go on for some states and not for others, and is long enough to bring these together."""
        loop = self.graph.loops[k]
        is_own = loop.length is None and not loop.is_branch and self.graph.parents[loop.region] == 0
        return self.width > 1 and is_own and self.scheduler.size((k,)) >= LEAST_SPLIT

    def _split_at(self, k: int) -> list[Function]:
        """The functions of a split program, see `BlockIR`."""
        loop, body, carried = self.graph.loops[k], self.bodies[k], self.scheduler.carried_of(self.graph.loops[k])
        before, turns, after = (Function(name, self.parameters) for name in ("before", "turns", "after"))
        place = self.top.index(body.own)
        self.write_calls(before, self.top[:place])
        self._write_start(before, k)
        self.write_calls(after, self.top[place + 1 :])
        self._write_known_results(after)

        turns.parameters = [*self.parameters, "i64 %states", "i64 %few"]
        turns.add("br label %head")
        turns.lines.append("head:")
        self._write_part(turns, body.own, k, 0)
        active, bits = self.read(turns, loop.condition), f"i{self.width}"
        turns.add(f"%bits = bitcast {self.type(BOOL)} {active} to {bits}")
        turns.add(f"%active = zext {bits} %bits to i64")
        turns.add("%left = and i64 %active, %states")
        turns.add(f"%count = {self.call('llvm.ctpop.i64', 'i64', ('i64', '%left'))}")
        turns.add("%is_over = icmp ule i64 %count, %few")
        turns.add("br i1 %is_over, label %end, label %turn")
        turns.lines.append("turn:")
        self._write_part(turns, body.own, k, 1)
        self._store_carried(turns, [(c[0], c[2]) for c in carried], active)
        turns.add("br label %head")
        turns.lines.append("end:")
        turns.result = "i64 %left"

        changed, read = (
            list(dict.fromkeys(x for node in nodes if (x := self._place_of(node)) is not None))
            for nodes in ((c[0] for c in carried), self._inputs_and_tables(k))
        )
        return [before, turns, after, self._copy("lent", [*changed, *read]), self._copy("returned", changed)]

    def _inputs_and_tables(self, k: int) -> Iterator[int]:
        """The nodes that a loop reads and does not make, with those of tables."""
        yield from self.scheduler.inputs[k]
        for j in (k, *self.scheduler.inner[k]):
            for node in self.scheduler.members[self.graph.loops[j].region]:
                if self.graph.operations[node] == "lookup":
                    yield from self.graph.tables[self.graph.details[node][0]]

    def _place_of(self, node: int) -> _Place | None:
        """Where numbers are that are not made in a loop; None of what is the same for all states."""
        g, name, dtype = self.graph, self.graph.operations[node], self.graph.dtypes[node]
        if name == "constant":
            return None
        if name == "load":
            k, place = g.details[node]
            return None if self.is_shared[k] else _Place(k, place * self._stride(k, dtype), dtype)
        if name == "stacked":
            k, which, row = g.details[node]
            place, stride = self.rows_in_frame["stacked", k, which]
            return _Place(None, place + row * stride, dtype)
        if name == "last":
            k, which, _ = g.details[node]
            node = g.loops[k].carried[which][0]
        return _Place(None, self.slots[node], dtype)

    def _copy(self, name: str, places: Iterable[_Place]) -> Function:
        """A function that copies numbers of some states, as `lent` does, in a loop over a table of their places.

        It stores the numbers of these states side by side in memory, and loads them from there to their new places.
        With `has_compress` a register is packed before it is stored, because some processors are slow to pack into
        memory. Vectors that are longer than a register are packed into memory all the same: LLVM 22 would split them,
        and store the second half as if it were aligned.
        """
        f, mask, bits = Function(name, ()), self.type(BOOL), f"i{self.width}"
        f.parameters = ["ptr noalias %arguments", "ptr noalias %frame", "i64 %states"]
        f.parameters += ["ptr noalias %of_arguments", "ptr noalias %of_frame", "i64 %of_states"]
        f.entry.append("  %memory = alloca [512 x i8], align 64")
        for of in ("", "of_"):
            f.entry.append(f"  %{of}bits = trunc i64 %{of}states to {bits}")
            f.entry.append(f"  %{of}set = bitcast {bits} %{of}bits to {mask}")
        found = collections.defaultdict[tuple, list[int]](list)
        for k, place, dtype in places:
            # In the frame a mask has a bit for each state, in arguments a byte.
            found[k, 1 if dtype.kind == "b" and k is None else 8 * dtype.itemsize].append(place)
        for n, ((k, size), own) in enumerate(found.items()):
            arrays = (self.frame, "ptr %of_frame")
            if k is not None:
                arrays = tuple(f.pointer(array, k) for array in ("arguments", "of_arguments"))
            table, before = self._constant_table(own, np.dtype(np.int32)), f"end{n - 1}" if n else "body"
            f.add(f"br label %copy{n}")
            f.lines.append(f"copy{n}:")
            f.add(f"%k{n} = phi i64 [0, %{before}], [%next{n}, %copy{n}]")
            f.add(f"%entry{n} = getelementptr i32, ptr {table}, i64 %k{n}")
            f.add(f"%short{n} = load i32, ptr %entry{n}")
            f.add(f"%place{n} = zext i32 %short{n} to i64")
            to, of = (self.offset(f, array, f"%place{n}") for array in arrays)
            inside, kind = f"<{self.width} x i{size}>", f"i{max(size, 32)}"
            t, align = f"<{self.width} x {kind}>", f"align {min(max(self.width * size // 8, 1), 64)}"
            old, new, chosen, moved = (f.new() for _ in range(4))
            for register, pointer in ((old, to), (new, of)):
                narrow = f.new() if size < 32 else register
                f.add(f"{narrow} = load {inside}, {pointer}, {align}")
                if size < 32:
                    f.add(f"{register} = zext {inside} {narrow} to {t}")
            suffix = f"v{self.width}{kind}"
            if self.has_compress and self.width * max(size, 32) <= 512:
                compress = f"llvm.experimental.vector.compress.{suffix}"
                f.add(f"{chosen} = {self.call(compress, t, (t, new), (mask, '%of_set'), (t, 'poison'))}")
                f.add(f"store {t} {chosen}, ptr %memory, align 64")
            else:
                compress = f"llvm.masked.compressstore.{suffix}"
                f.add(self.call(compress, "void", (t, new), ("ptr", "%memory"), (mask, "%of_set")))
            expand = f"llvm.masked.expandload.{suffix}"
            f.add(f"{moved} = {self.call(expand, t, ('ptr', '%memory'), (mask, '%set'), (t, old))}")
            if size < 32:
                wide, moved = moved, f.new()
                f.add(f"{moved} = trunc {t} {wide} to {inside}")
            f.add(f"store {inside} {moved}, {to}, {align}")
            f.add(f"%next{n} = add i64 %k{n}, 1")
            f.add(f"%is_last{n} = icmp eq i64 %next{n}, {len(own)}")
            f.add(f"br i1 %is_last{n}, label %end{n}, label %copy{n}")
            f.lines.append(f"end{n}:")
        return f

    # -- operations ---------------------------------------------------------------------------------------------------

    def _template_of(self, node: int) -> str:
        """The instructions of an operation, with {0} in place of its register, and {1}, {2}, {3} of its operands."""
        g = self.graph
        operands = g.operands[node]
        name, dtype, of = g.operations[node], g.dtypes[node], g.dtypes[operands[0]]
        is_usual = False
        if name in _GUARDED:
            # Whether every processor shifts by this number, or divides by it, as XLA does.
            known, least, most = g.constants.get(operands[1]), int(name in ("div", "rem")), 8 * dtype.itemsize
            is_usual = dtype.kind == "f" or bool(known is not None and known >= least and (least or known < most))
        key = name, dtype.char, of.char, is_usual
        template = self.templates.get(key)
        if template is None:
            lines = self._instructions(name, dtype, of, is_usual)
            template = self.templates[key] = "\n".join("  " + line for line in lines)
        return template

    def _instructions(self, name: str, dtype: np.dtype, of: np.dtype, is_usual: bool) -> list[str]:
        """of: the dtype of the first operand."""
        t, source = self.type(dtype), self.type(of)
        if name in _GUARDED and not is_usual:
            return self._divided(name, dtype) if name in ("div", "rem") else self._shifted(name, dtype)
        if name == "product_error":
            return self._product_error(dtype)
        if name == "fma" and not self.has_fma:
            # The bits are nobody's promise, and to round once would take some 20 instructions.
            return [f"{{0}}.product = fmul {t} {{1}}, {{2}}", f"{{0}} = fadd {t} {{0}}.product, {{3}}"]
        if name == "fma":
            return [f"{{0}} = {self.call(f'llvm.fma.{self.suffix(dtype)}', t, (t, '{1}'), (t, '{2}'), (t, '{3}'))}"]
        if name == "rem" and dtype.kind == "f":
            # What libraries of C make of a subnormal divisor that counts as 0 differs: here it is NaN, as of 0.
            is_none, nan = f"fcmp oeq {t} {{2}}, zeroinitializer", self.literal(np.nan, dtype)
            rest = [f"{{0}}.none = {is_none}", f"{{0}}.rest = frem {t} {{1}}, {{2}}"]
            return [*rest, f"{{0}} = select {self.type(np.dtype(bool))} {{0}}.none, {t} {nan}, {t} {{0}}.rest"]
        if name in ("add", "sub", "mul", "div", "rem", "and", "or", "xor", *_SHIFTS):
            text = f"{_instruction(name, dtype)} {t} {{1}}, {{2}}"
        elif name in COMPARISONS:
            sign = "" if name in ("eq", "ne") else "s" if of.kind == "i" else "u"
            instruction = f"fcmp {_ORDERED[name]}" if of.kind == "f" else f"icmp {sign}{name}"
            text = f"{instruction} {source} {{1}}, {{2}}"
        elif name == "select":
            text = f"select {source} {{1}}, {t} {{2}}, {t} {{3}}"
        elif name == "neg":
            text = f"fneg {t} {{1}}" if dtype.kind == "f" else f"sub {t} zeroinitializer, {{1}}"
        elif name == "not":
            text = f"xor {t} {{1}}, {self.literal(True if dtype.kind == 'b' else -1, dtype)}"
        elif name == "abs" and dtype.kind != "f":
            text = self.call(f"llvm.abs.{self.suffix(dtype)}", t, (t, "{1}"), ("i1", "false"))
        elif name in _INTRINSICS:
            text = self.call(f"llvm.{_INTRINSICS[name]}.{self.suffix(dtype)}", t, (t, "{1}"))
        elif name in ("max", "min"):
            full = {"f": f"{name}imum", "i": f"s{name}", "u": f"u{name}", "b": f"u{name}"}[dtype.kind]
            text = self.call(f"llvm.{full}.{self.suffix(dtype)}", t, (t, "{1}"), (t, "{2}"))
        elif name == "bitcast":
            text = f"bitcast {source} {{1}} to {t}"
        else:
            text = self._converted(of, dtype)
        return [f"{{0}} = {text}"]

    def call(self, name: str, t: str, *operands: tuple[str, str]) -> str:
        self.declared.add(f"declare {t} @{name}({', '.join(kind for kind, _ in operands)})")
        return f"call {t} @{name}({', '.join(f'{kind} {x}' for kind, x in operands)})"

    def _converted(self, of: np.dtype, to: np.dtype) -> str:
        source, t = self.type(of), self.type(to)
        if to.kind == "b":
            return f"{'fcmp une' if of.kind == 'f' else 'icmp ne'} {source} {{1}}, zeroinitializer"
        if of.kind == "f" and to.kind in "iu":
            # What does not fit is cut off, and NaN is 0, as in XLA.
            name = f"llvm.fpto{'s' if to.kind == 'i' else 'u'}i.sat.{self.suffix(to)}.{self.suffix(of)}"
            return self.call(name, t, (source, "{1}"))
        return f"{_conversion(of, to)} {source} {{1}} to {t}"

    def _shifted(self, name: str, dtype: np.dtype) -> list[str]:
        """LLVM does not say what a shift by as many bits as a number has, or more, is."""
        t, mask, bits = self.type(dtype), self.type(BOOL), 8 * dtype.itemsize
        result = f"{_SHIFTS[name]} {t} {{1}}, {{0}}.near"
        lines = [
            f"{{0}}.is_near = icmp ult {t} {{2}}, {self.literal(bits, dtype)}",
            f"{{0}}.near = select {mask} {{0}}.is_near, {t} {{2}}, {t} {self.literal(bits - 1, dtype)}",
        ]
        if name == "sar":
            return [*lines, f"{{0}} = {result}"]
        chosen = f"{{0}} = select {mask} {{0}}.is_near, {t} {{0}}.result, {t} zeroinitializer"
        return [*lines, f"{{0}}.result = {result}", chosen]

    def _divided(self, name: str, dtype: np.dtype) -> list[str]:
        """Integers. Processors stop at a division by 0, and at that of the smallest number by -1: here by 1."""
        t, mask = self.type(dtype), self.type(BOOL)
        lines, is_bad = [f"{{0}}.is_zero = icmp eq {t} {{2}}, zeroinitializer"], "{0}.is_zero"
        if dtype.kind == "i":
            is_bad = "{0}.is_bad"
            lines += [
                f"{{0}}.is_minus = icmp eq {t} {{2}}, {self.literal(-1, dtype)}",
                f"{{0}}.is_least = icmp eq {t} {{1}}, {self.literal(np.iinfo(dtype).min, dtype)}",
                f"{{0}}.overflows = and {mask} {{0}}.is_minus, {{0}}.is_least",
                f"{is_bad} = or {mask} {{0}}.is_zero, {{0}}.overflows",
            ]
        of_zero = "{1}" if name == "rem" else self.literal(-1, dtype)
        return lines + [
            f"{{0}}.divisor = select {mask} {is_bad}, {t} {self.literal(1, dtype)}, {t} {{2}}",
            f"{{0}}.result = {_instruction(name, dtype)} {t} {{1}}, {{0}}.divisor",
            f"{{0}} = select {mask} {{0}}.is_zero, {t} {of_zero}, {t} {{0}}.result",
        ]

    def _product_error(self, dtype: np.dtype) -> list[str]:
        """a b - p: by a fused multiply-add; or in float64, which holds products of float32; or after Dekker [1971].

        The third loses digits below tiny / eps, where the other two do not. See `transforms.split`.
        """
        t = self.type(dtype)
        if self.has_fma:
            fused = self.call(f"llvm.fma.{self.suffix(dtype)}", t, (t, "{1}"), (t, "{2}"), (t, "{0}.minus"))
            return [f"{{0}}.minus = fneg {t} {{3}}", f"{{0}} = {fused}"]
        wide = self.type(np.dtype(np.float64))
        if dtype == np.float32:
            return [
                *(f"{{0}}.{name} = fpext {t} {{{k + 1}}} to {wide}" for k, name in enumerate("abp")),
                f"{{0}}.ab = fmul {wide} {{0}}.a, {{0}}.b",
                f"{{0}}.error = fsub {wide} {{0}}.ab, {{0}}.p",
                f"{{0}} = fptrunc {wide} {{0}}.error to {t}",
            ]
        integer, info = np.dtype(np.uint64), np.finfo(np.float64)
        bits, mask, half = self.type(integer), self.type(BOOL), self.literal(1 << 26, integer)
        lines: list[str] = []
        for x, operand in (("{0}.a", "{1}"), ("{0}.b", "{2}")):
            size = self.call(f"llvm.fabs.{self.suffix(dtype)}", t, (t, operand))
            lines += [
                f"{x}_size = {size}",
                f"{x}_is_usual = fcmp olt {t} {x}_size, {self.literal((2 - 2.0**-26) * 2.0**1023, dtype)}",
                f"{x}_has_low = fcmp oge {t} {x}_size, {self.literal(info.tiny / info.eps, dtype)}",
                f"{x}_half = select {mask} {x}_is_usual, {bits} {half}, {bits} zeroinitializer",
                f"{x}_bits = bitcast {t} {operand} to {bits}",
                f"{x}_rounded = add {bits} {x}_bits, {x}_half",
                f"{x}_upper = and {bits} {x}_rounded, {self.literal((1 << 64) - (1 << 27), integer)}",
                f"{x}_number = bitcast {bits} {x}_upper to {t}",
                f"{x}_high = select {mask} {x}_has_low, {t} {x}_number, {t} {operand}",
                f"{x}_low = fsub {t} {operand}, {x}_high",
            ]
        return lines + [
            f"{{0}}.p1 = fmul {t} {{0}}.a_high, {{0}}.b_high",
            f"{{0}}.p2 = fmul {t} {{0}}.a_high, {{0}}.b_low",
            f"{{0}}.p3 = fmul {t} {{0}}.a_low, {{0}}.b_high",
            f"{{0}}.p4 = fmul {t} {{0}}.a_low, {{0}}.b_low",
            f"{{0}}.e1 = fsub {t} {{0}}.p1, {{3}}",
            f"{{0}}.e2 = fadd {t} {{0}}.e1, {{0}}.p2",
            f"{{0}}.e3 = fadd {t} {{0}}.e2, {{0}}.p3",
            f"{{0}} = fadd {t} {{0}}.e3, {{0}}.p4",
        ]


def _literal(x, dtype: np.dtype) -> str:
    if dtype.kind == "f":
        with np.errstate(all="ignore"):
            return f"0x{struct.unpack('<Q', struct.pack('<d', float(x)))[0]:016X}"
    return ("true" if x else "false") if dtype.kind == "b" else str(int(x))


def _instruction(name: str, dtype: np.dtype) -> str:
    if name in _SHIFTS or name in ("and", "or", "xor"):
        return _SHIFTS.get(name, name)
    if dtype.kind == "f":
        return f"f{name}"
    return f"{'s' if dtype.kind == 'i' else 'u'}{name}" if name in ("div", "rem") else name


def _conversion(of: np.dtype, to: np.dtype) -> str:
    """The instruction for a conversion that loses nothing but digits."""
    if of.kind == to.kind == "f":
        return "fpext" if to.itemsize > of.itemsize else "fptrunc"
    if to.kind == "f":
        return "sitofp" if of.kind == "i" else "uitofp"
    if of.kind == "b" or to.itemsize > of.itemsize:
        return "sext" if of.kind == "i" else "zext"
    return "trunc" if to.itemsize < of.itemsize else "bitcast"
