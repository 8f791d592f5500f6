"""A graph as LLVM IR, for W states side by side: vectors of W numbers, or single numbers where W is 1.

LLVM takes more than in proportion to the length of a function. So a long graph is a sequence of functions, `pieces`,
each of at most LONGEST operations. What one piece makes and another reads has a place in a scratch memory, the frame:
most of it would be spilled to memory anyway. A loop that fits a piece is written where it stands; of a longer one the
body is pieces, too. Numbers that turns of a loop pass on are in the frame, and so are the rows that it reads and
writes, as tables.

Nothing is contracted, rearranged or assumed: results have the bits of the graph, operation by operation.
"""

import collections
import struct
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxspatial.engine.graph import COMPARISONS, Graph, Loop

LONGEST = 1500
_TYPES = {"f4": "float", "f8": "double", "b1": "i1"}
_SUFFIXES = {"float": "f32", "double": "f64"}
_INTRINSICS = {"abs": "fabs", "sqrt": "sqrt", "round": "rint", "floor": "floor", "ceil": "ceil"}
_ORDERED = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
# What is read where it lies, as often as it is used: nodes that are no operations.
_PLACES = {"constant", "load", "carried", "row", "last", "stacked"}
# An operation, or the number of a loop as (loop,).
Item = Any


class Piece(NamedTuple):
    """Items that follow each other in one function."""

    items: list[Item]


class Written(NamedTuple):
    """The IR of a graph. It defines `@block(ptr %arguments, ptr %results, ptr %frame)`: for W states, with pointers to
    their numbers (n, W), or (n,) of arguments that all states share, and frame_bytes of scratch memory."""

    text: str
    frame_bytes: int
    n_operations: int


def written(graph: Graph, width: int, is_shared: Sequence[bool], has_fma: bool = True) -> Written:
    """The IR of a graph for `width` states.

    is_shared: whether all states share an argument. has_fma: whether the processor multiplies and adds in one step;
    without, the error of a product has the same bits, and takes more steps.
    """
    return _Writer(graph, width, is_shared, has_fma).written()


# -- which operations are needed, and in which order -------------------------------------------------------------------


class _Order:
    """The operations that results need, depth first: an operand is made shortly before it is used.

    members: by region its operations, and its loops. outside: by loop, the nodes that it reads and does not make.
    """

    def __init__(self, graph: Graph):
        self.graph, self.roots = graph, [int(n) for x in graph.results for n in x.ravel()]
        self.carried = {p: (k, c) for k, loop in enumerate(graph.loops) for c, (p, _, _) in enumerate(loop.carried)}
        self.live = set[int]()
        self.live_loops = set[int]()
        self._find()
        self.members = collections.defaultdict[int, list[int]](list)
        for node in sorted(self.live):
            if graph.operations[node] not in _PLACES:
                self.members[graph.regions[node]].append(node)
        self.inner = {k: [j for j in sorted(self.live_loops) if self._is_within(j, k)] for k in self.live_loops}
        self.outside = {k: self._outside(k) for k in self.live_loops}

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

    def _is_within(self, inner: int, outer: int) -> bool:
        g = self.graph
        r, region = g.parents[g.loops[inner].region], g.loops[outer].region
        while g.depths[r] > g.depths[region]:
            r = g.parents[r]
        return r == region

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

    def _outside(self, k: int) -> list[int]:
        g, region = self.graph, self.graph.loops[k].region
        found = dict.fromkeys(self.starts(k))
        for j in (k, *self.inner[k]):
            loop = g.loops[j]
            reads = [x for node in self.members[loop.region] for x in g.operands[node]]
            reads += self.ends(j)
            reads += [loop.condition] if loop.length is None else []
            reads += self.starts(j) if j != k else []
            found.update(dict.fromkeys(x for x in reads if not g.is_inside(x, region)))
        return list(found)

    def item(self, node: int, region: int) -> Item | None:
        """The item of a region that a node comes from, if there is one."""
        g = self.graph
        if g.regions[node] != region:
            return None
        name = g.operations[node]
        if name in ("last", "stacked"):
            return (g.details[node][0],)
        return None if name in _PLACES else node

    def reads(self, item: Item) -> Iterable[int]:
        return self.outside[item[0]] if isinstance(item, tuple) else self.graph.operands[item]

    def scheduled(self, region: int, roots: Sequence[int], done: set[Item]) -> list[Item]:
        """The items of a region that these nodes need, but those that are done."""
        order: list[Item] = []
        for root in roots:
            first = self.item(root, region)
            if first is None or first in done:
                continue
            done.add(first)
            stack = [(first, iter(self.reads(first)))]
            while stack:
                item, rest = stack[-1]
                for node in rest:
                    needed = self.item(node, region)
                    if needed is not None and needed not in done:
                        done.add(needed)
                        stack.append((needed, iter(self.reads(needed))))
                        break
                else:
                    order.append(item)
                    stack.pop()
        return order

    def size(self, item: Item) -> int:
        if not isinstance(item, tuple):
            return 1
        return 4 + sum(len(self.members[self.graph.loops[j].region]) for j in (item[0], *self.inner[item[0]]))


class _Body(NamedTuple):
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

    def given_back(self, place: int, n_bytes: int) -> None:
        self.free[max(n_bytes, 1)].append(place)


class _Function:
    """The text of one function. registers: of nodes that it has made or read."""

    def __init__(self, name: str):
        self.name, self.lines, self.entry = name, list[str](), list[str]()
        self.registers = dict[int, str]()
        self.pointers = dict[str, str]()
        self.count, self.block = 0, "body"

    def new(self) -> str:
        self.count += 1
        return f"%v{self.count}"

    def add(self, line: str) -> None:
        self.lines.append("  " + line)

    def pointer(self, array: str, k: int) -> str:
        """Of argument or result k, read once at the entry."""
        key = f"{array}{k}"
        if key not in self.pointers:
            self.pointers[key] = f"%{key}"
            self.entry.append(f"  %at.{key} = getelementptr ptr, ptr %{array}, i64 {k}")
            self.entry.append(f"  %{key} = load ptr, ptr %at.{key}")
        return self.pointers[key]

    def text(self, linkage: str) -> str:
        head = f"define {linkage}void @{self.name}(ptr noalias %arguments, ptr noalias %results, ptr noalias %frame) {{"
        return "\n".join([head, "entry:", *self.entry, "  br label %body", "body:", *self.lines, "  ret void", "}"])


class _Writer:
    def __init__(self, graph: Graph, width: int, is_shared: Sequence[bool], has_fma: bool):
        self.g, self.width, self.is_shared, self.order = graph, width, is_shared, _Order(graph)
        self.has_fma = has_fma
        self.declared, self.globals = set[str](), dict[str, str]()
        self.pieces: list[list[Item]] = []
        self.bodies: dict[int, _Body] = {}
        self.home, self.readers = dict[int, int](), collections.defaultdict[int, set[int]](set)
        self.slots: dict[int, int] = {}
        self.indices: dict[int, int] = {}
        self.tables: dict[Any, tuple[str, Any, int]] = {}
        self.at = collections.defaultdict[int, list[tuple[int, int]]](list)
        for k, nodes in enumerate(graph.results):
            for j, node in enumerate(nodes.ravel().tolist()):
                self.at[node].append((k, j))

    # -- the plan -----------------------------------------------------------------------------------------------------

    def _planned(self, items: Iterable[Item]) -> list[int]:
        """Pieces for items in this order: their numbers, among which those of long loops are their own pieces."""
        found, current, size = list[int](), list[Item](), 0

        def close() -> None:
            nonlocal current, size
            if current:
                self.pieces.append(current)
                found.append(len(self.pieces) - 1)
            current, size = [], 0

        for item in items:
            n = self.order.size(item)
            if isinstance(item, tuple) and n > LONGEST:
                close()
                found.append(self._planned_loop(item[0]))
                continue
            if size + n > LONGEST:
                close()
            current.append(item)
            size += n
        close()
        return found

    def _scheduled_body(self, k: int) -> tuple[list[Item], list[Item]]:
        """(the items in front of the condition of a loop, those after it)."""
        loop, done = self.g.loops[k], set[Item]()
        condition = [] if loop.length is not None else self.order.scheduled(loop.region, [loop.condition], done)
        return condition, self.order.scheduled(loop.region, self.order.ends(k), done)

    def _planned_loop(self, k: int) -> int:
        self.pieces.append([(k,)])
        own = len(self.pieces) - 1
        condition, rest = self._scheduled_body(k)
        self.bodies[k] = _Body(own, self._planned(condition), self._planned(rest))
        return own

    def _note_homes(self) -> None:
        """Which piece makes each node, and which others read it."""
        for p, items in enumerate(self.pieces):
            self._note_items(p, items)
        for node in self.at:
            if node in self.home:
                self.readers[node].add(self.home[node])

    def _note_items(self, p: int, items: Iterable[Item]) -> None:
        for item in items:
            if not isinstance(item, tuple):
                self.home[item] = p
                self._note_reads(p, self.g.operands[item])
                continue
            k = item[0]
            loop = self.g.loops[k]
            ends = self.order.ends(k) + ([loop.condition] if loop.length is None else [])
            self._note_reads(p, [*self.order.starts(k), *ends])
            if k not in self.bodies:
                for part in self._scheduled_body(k):
                    self._note_items(p, part)

    def _note_reads(self, p: int, nodes: Iterable[int]) -> None:
        for node in nodes:
            self.readers[node].add(p)

    # -- places -------------------------------------------------------------------------------------------------------

    def _bytes(self, node: int) -> int:
        dtype = self.g.dtypes[node]
        return max(self.width // 8, 1) if dtype.kind == "b" else self.width * dtype.itemsize

    def _allocate(self) -> int:
        """Gives places in the frame to what another piece reads, and to what loops carry: the size of the frame."""
        begin, end, clock = dict[Any, int](), dict[Any, int](), 0
        size_of: dict[Any, int] = {}

        def touch(key: Any, n_bytes: int) -> None:
            begin.setdefault(key, clock)
            end[key] = max(end.get(key, 0), clock)
            size_of[key] = n_bytes

        def read(node: int) -> None:
            name = self.g.operations[node]
            if name == "last":
                k, which, _ = self.g.details[node]
                node = self.g.loops[k].carried[which][0]
            elif name == "stacked":
                k, which, _ = self.g.details[node]
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
                if isinstance(item, tuple):
                    loop_at(item[0], p)
                    continue
                for x in self.g.operands[item]:
                    read(x)
                if self.readers[item] - {p}:
                    touch(item, self._bytes(item))

        def loop_at(k: int, p: int) -> None:
            nonlocal clock
            loop, start = self.g.loops[k], clock
            own: list[Any] = [("index", k)]
            touch(own[0], 8)
            for node in self.order.starts(k):
                read(node)
            for parameter, _, _ in self.order.carried_of(loop):
                touch(parameter, self._bytes(parameter))
                own.append(parameter)
            for i in self.order.stacked_of(k):
                key = "stacked", k, i
                touch(key, self._bytes(loop.stacked[i]) * int(loop.length or 0))
                own.append(key)
            for parameter in self.order.rows_of(loop):
                table = self._found_table(parameter, loop)
                if table is None:
                    key = "rows", parameter
                    touch(key, self._bytes(parameter) * int(loop.length or 0))
                    own.append(key)
                elif table[0] == "stacked":
                    own.append(("stacked", *table[1][:2]))
            if k in self.bodies:
                for q in (*self.bodies[k].condition, *self.bodies[k].rest):
                    walk(self.pieces[q], q)
            else:
                for part in self._scheduled_body(k):
                    walk(part, p)
            clock += 1
            for node in self.order.ends(k) + ([loop.condition] if loop.length is None else []):
                read(node)
            # What was there before the loop, and is read in it, is read again in the next turn; so is what it owns.
            for key, first in begin.items():
                if first <= start and end[key] >= start or key in own:
                    end[key] = max(end[key], clock) if end[key] > start or key in own else end[key]

        for p in self.top:
            walk(self.pieces[p], p)
        clock += 1
        for node in self.at:
            read(node)
        frame, ending = _Frame(), collections.defaultdict[int, list[Any]](list)
        for key, last in end.items():
            ending[last].append(key)
        places: dict[Any, int] = {}
        done = 0
        for key in sorted(begin, key=begin.__getitem__):
            for t in range(done, begin[key]):
                for old in ending[t]:
                    frame.given_back(places[old], size_of[old])
            done = max(done, begin[key])
            places[key] = frame.taken(size_of[key])
        for key, place in places.items():
            if isinstance(key, int):
                self.slots[key] = place
            elif key[0] == "index":
                self.indices[key[1]] = place
            else:
                self.tables[key] = "%frame", place, size_of[key] // max(int(self._length_of(key) or 1), 1)
        return frame.size

    def _length_of(self, key: Any) -> int | None:
        return self.g.loops[key[1] if key[0] == "stacked" else self.g.details[key[1]]].length

    def _found_table(self, parameter: int, loop: Loop) -> tuple[str, Any, int] | None:
        """Where the rows of a parameter lie already: in an argument, among what another loop stacked, or constants.

        (array, first, stride): of an argument its number and bytes; of a stacked table the same in rows.
        """
        g, nodes = self.g, loop.rows[parameter]
        names = {g.operations[n] for n in nodes}
        if names == {"constant"}:
            return "constant", nodes, 1
        if names == {"load"}:
            places = [g.details[n] for n in nodes]
            steps = {b[1] - a[1] for a, b in zip(places, places[1:], strict=False)}
            if len({k for k, _ in places}) == 1 and len(steps) == 1 and g.dtypes[parameter].kind != "b":
                return "load", places[0], steps.pop()
        if names == {"stacked"}:
            places = [g.details[n] for n in nodes]
            steps = {b[2] - a[2] for a, b in zip(places, places[1:], strict=False)}
            if len({x[:2] for x in places}) == 1 and steps == {1}:
                return "stacked", places[0], 1
        return None

    # -- types and numbers --------------------------------------------------------------------------------------------

    def scalar(self, dtype: np.dtype) -> str:
        return _TYPES.get(dtype.str[1:], f"i{8 * dtype.itemsize}")

    def type(self, dtype: np.dtype) -> str:
        return self.scalar(dtype) if self.width == 1 else f"<{self.width} x {self.scalar(dtype)}>"

    def suffix(self, dtype: np.dtype) -> str:
        t = self.scalar(dtype)
        t = _SUFFIXES.get(t, t)
        return t if self.width == 1 else f"v{self.width}{t}"

    def literal(self, x: Any, dtype: np.dtype) -> str:
        t, value = self.scalar(dtype), _literal(x, dtype)
        return value if self.width == 1 else f"splat ({t} {value})"

    def call(self, f: _Function, register: str, name: str, t: str, *operands: tuple[str, str]) -> None:
        self.declared.add(f"declare {t} @{name}({', '.join(kind for kind, _ in operands)})")
        f.add(f"{register} = call {t} @{name}({', '.join(f'{kind} {x}' for kind, x in operands)})")

    def loaded(self, f: _Function, pointer: str, dtype: np.dtype) -> str:
        register = f.new()
        f.add(f"{register} = load {self.type(dtype)}, ptr {pointer}, align {self._alignment(dtype)}")
        return register

    def stored(self, f: _Function, value: str, pointer: str, dtype: np.dtype) -> None:
        f.add(f"store {self.type(dtype)} {value}, ptr {pointer}, align {self._alignment(dtype)}")

    def _alignment(self, dtype: np.dtype) -> int:
        n = max(self.width // 8, 1) if dtype.kind == "b" else self.width * dtype.itemsize
        return min(64, n)

    def offset(self, f: _Function, pointer: str, n_bytes: int | str) -> str:
        if n_bytes == 0:
            return pointer
        register = f.new()
        f.add(f"{register} = getelementptr i8, ptr {pointer}, i64 {n_bytes}")
        return register

    def spread(self, f: _Function, value: str, dtype: np.dtype) -> str:
        """A vector of W times one number."""
        if self.width == 1:
            return value
        t, one, whole = self.scalar(dtype), f.new(), f.new()
        f.add(f"{one} = insertelement {self.type(dtype)} poison, {t} {value}, i64 0")
        zeros = f"<{self.width} x i32> zeroinitializer"
        f.add(f"{whole} = shufflevector {self.type(dtype)} {one}, {self.type(dtype)} poison, {zeros}")
        return whole

    # -- reading nodes ------------------------------------------------------------------------------------------------

    def read(self, f: _Function, node: int) -> str:
        g = self.g
        if node in g.constants:
            return self.literal(g.constants[node], g.dtypes[node])
        if node not in f.registers:
            f.registers[node] = self._read_anew(f, node)
        return f.registers[node]

    def _read_anew(self, f: _Function, node: int) -> str:
        g, dtype = self.g, self.g.dtypes[node]
        name = g.operations[node]
        if name == "load":
            return self._read_argument(f, *g.details[node], dtype)
        if name == "row":
            return self._read_row(f, node, g.loops[g.details[node]])
        if name == "stacked":
            k, which, row = g.details[node]
            _, place, stride = self.tables["stacked", k, which]
            return self.loaded(f, self.offset(f, "%frame", place + row * stride), dtype)
        if name == "last":
            k, which, _ = g.details[node]
            node = g.loops[k].carried[which][0]
        return self.loaded(f, self.offset(f, "%frame", self.slots[node]), dtype)

    def _read_argument(self, f: _Function, k: int, place: int, dtype: np.dtype) -> str:
        pointer = f.pointer("arguments", k)
        return self._read_outside(f, pointer, place * self._stride(k, dtype), dtype, self.is_shared[k])

    def _stride(self, k: int, dtype: np.dtype) -> int:
        return dtype.itemsize * (1 if self.is_shared[k] else self.width)

    def _read_outside(self, f: _Function, pointer: str, place: int | str, dtype: np.dtype, is_shared: bool) -> str:
        """A number outside of the frame, where masks are bytes."""
        at = self.offset(f, pointer, place)
        inside = np.dtype(np.uint8) if dtype.kind == "b" else dtype
        if is_shared:
            one = f.new()
            f.add(f"{one} = load {self.scalar(inside)}, ptr {at}")
            value = self.spread(f, one, inside)
        else:
            value = self.loaded(f, at, inside)
        if dtype.kind != "b":
            return value
        mask = f.new()
        f.add(f"{mask} = icmp ne {self.type(inside)} {value}, {self.literal(0, inside)}")
        return mask

    def _index(self, f: _Function, k: int) -> str:
        """The row that the turn of loop k is for."""
        register = f.new()
        f.add(f"{register} = load i64, ptr {self.offset(f, '%frame', self.indices[k])}")
        return register

    def _read_row(self, f: _Function, node: int, loop: Loop) -> str:
        g, dtype = self.g, self.g.dtypes[node]
        index = self._index(f, g.details[node])
        kind, first, step = self._found_table(node, loop) or ("own", 0, 1)
        if kind == "constant":
            return self._read_constant(f, index, [g.constants[n] for n in first], dtype)
        scaled = f.new()
        if kind == "load":
            k, place = first
            stride = self._stride(k, dtype)
            f.add(f"{scaled} = mul i64 {index}, {step * stride}")
            base = self.offset(f, f.pointer("arguments", k), place * stride)
            return self._read_outside(f, base, scaled, dtype, self.is_shared[k])
        if kind == "stacked":
            k, which, row = first
            _, place, stride = self.tables["stacked", k, which]
            place += row * stride
        else:
            _, place, stride = self.tables["rows", node]
        f.add(f"{scaled} = mul i64 {index}, {stride}")
        return self.loaded(f, self.offset(f, self.offset(f, "%frame", place), scaled), dtype)

    def _read_constant(self, f: _Function, index: str, values: Sequence[Any], dtype: np.dtype) -> str:
        inside = np.dtype(np.uint8) if dtype.kind == "b" else dtype
        t = self.scalar(inside)
        items = ", ".join(f"{t} {_literal(x, inside)}" for x in values)
        content = f"[{len(values)} x {t}] [{items}]"
        name = self.globals.setdefault(content, f"@table{len(self.globals)}")
        at = f.new()
        f.add(f"{at} = getelementptr {t}, ptr {name}, i64 {index}")
        return self._read_outside(f, at, 0, dtype, is_shared=True)

    # -- writing ------------------------------------------------------------------------------------------------------

    def written(self) -> Written:
        self.top = self._planned(self.order.scheduled(0, self.order.roots, set()))
        self._note_homes()
        size = self._allocate()
        functions = [self._piece(p) for p in range(len(self.pieces))]
        block = _Function("block")
        for p in self.top:
            self._called(block, p)
        for node, places in self.at.items():
            if node not in self.home:
                self._stored_results(block, node, places)
        tables = [f"{name} = internal constant {content}" for content, name in self.globals.items()]
        texts = [f.text("internal ") for f in functions]
        text = "\n".join([*tables, *texts, block.text(""), *sorted(self.declared), ""])
        return Written(text, size, sum(map(len, self.order.members.values())))

    def _called(self, f: _Function, p: int) -> None:
        f.add(f"call void @piece{p}(ptr %arguments, ptr %results, ptr %frame)")

    def _piece(self, p: int) -> _Function:
        f = _Function(f"piece{p}")
        for item in self.pieces[p]:
            self._write(f, p, item)
        return f

    def _write(self, f: _Function, p: int, item: Item) -> None:
        if isinstance(item, tuple):
            self._write_loop(f, p, item[0])
            return
        f.registers[item] = self._operation(f, item)
        if item in self.slots:
            pointer = self.offset(f, "%frame", self.slots[item])
            self.stored(f, f.registers[item], pointer, self.g.dtypes[item])
        if item in self.at:
            self._stored_results(f, item, self.at[item])

    def _stored_results(self, f: _Function, node: int, places: Iterable[tuple[int, int]]) -> None:
        """Results are stored as soon as they are known."""
        dtype, value = self.g.dtypes[node], self.read(f, node)
        inside = np.dtype(np.uint8) if dtype.kind == "b" else dtype
        if dtype.kind == "b":
            mask, value = value, f.new()
            f.add(f"{value} = zext {self.type(dtype)} {mask} to {self.type(inside)}")
        for k, j in places:
            pointer = self.offset(f, f.pointer("results", k), j * self.width * inside.itemsize)
            self.stored(f, value, pointer, inside)

    def _write_loop(self, f: _Function, p: int, k: int) -> None:
        g, loop, order = self.g, self.g.loops[k], self.order
        carried = order.carried_of(loop)
        for parameter in order.rows_of(loop):
            if ("rows", parameter) in self.tables:
                _, place, stride = self.tables["rows", parameter]
                for row, node in enumerate(loop.rows[parameter]):
                    pointer = self.offset(f, "%frame", place + row * stride)
                    self.stored(f, self.read(f, node), pointer, g.dtypes[parameter])
        self._store_carried(f, [(c[0], c[1]) for c in carried])
        index = self.offset(f, "%frame", self.indices[k])
        first, last, step = (int(loop.length or 0) - 1, 0, -1) if loop.is_reverse else (0, int(loop.length or 0) - 1, 1)
        f.add(f"store i64 {first}, ptr {index}")
        f.count += 1
        head, body, end = (f"{name}{f.count}" for name in ("head", "turn", "end"))
        f.add(f"br label %{head}")
        f.lines.append(f"{head}:")
        outside, condition, rest = dict(f.registers), *self._parts(k)
        self._write_part(f, p, condition)
        active = ""
        if loop.length is None:
            active = any_active = self.read(f, loop.condition)
            if self.width > 1:
                any_active, name = f.new(), f"llvm.vector.reduce.or.v{self.width}i1"
                self.call(f, any_active, name, "i1", (self.type(np.dtype(bool)), active))
            f.add(f"br i1 {any_active}, label %{body}, label %{end}")
            f.lines.append(f"{body}:")
        self._write_part(f, p, rest)
        for i in order.stacked_of(k):
            _, place, stride = self.tables["stacked", k, i]
            row, scaled = self._index(f, k), f.new()
            f.add(f"{scaled} = mul i64 {row}, {stride}")
            pointer = self.offset(f, self.offset(f, "%frame", place), scaled)
            self.stored(f, self.read(f, loop.stacked[i]), pointer, g.dtypes[loop.stacked[i]])
        self._store_carried(f, [(c[0], c[2]) for c in carried], active)
        if loop.length is None:
            f.add(f"br label %{head}")
        else:
            row, following, is_last = self._index(f, k), f.new(), f.new()
            f.add(f"{is_last} = icmp eq i64 {row}, {last}")
            f.add(f"{following} = add i64 {row}, {step}")
            f.add(f"store i64 {following}, ptr {index}")
            f.add(f"br i1 {is_last}, label %{end}, label %{head}")
        f.lines.append(f"{end}:")
        f.registers = outside

    def _parts(self, k: int) -> tuple[Any, Any]:
        if k in self.bodies:
            return self.bodies[k].condition, self.bodies[k].rest
        condition, rest = self._scheduled_body(k)
        return Piece(condition), Piece(rest)

    def _write_part(self, f: _Function, p: int, part: Any) -> None:
        if isinstance(part, Piece):
            for item in part.items:
                self._write(f, p, item)
        else:
            for q in part:
                self._called(f, q)

    def _store_carried(self, f: _Function, pairs: Sequence[tuple[int, int]], active: str = "") -> None:
        """Stores new values of what a loop carries. All are read before the first is stored.

        active: of lanes that go on; others keep what they have.
        """
        values: list[str] = []
        for parameter, node in pairs:
            value, dtype = self.read(f, node), self.g.dtypes[parameter]
            if active and self.width > 1:
                old, chosen, t = self.read(f, parameter), f.new(), self.type(dtype)
                f.add(f"{chosen} = select {self.type(np.dtype(bool))} {active}, {t} {value}, {t} {old}")
                value = chosen
            values.append(value)
        for (parameter, _), value in zip(pairs, values, strict=True):
            pointer = self.offset(f, "%frame", self.slots[parameter])
            self.stored(f, value, pointer, self.g.dtypes[parameter])

    # -- operations ---------------------------------------------------------------------------------------------------

    def _operation(self, f: _Function, node: int) -> str:
        g = self.g
        name, dtype, of = g.operations[node], g.dtypes[node], [g.dtypes[x] for x in g.operands[node]]
        args, t = [self.read(f, x) for x in g.operands[node]], self.type(dtype)
        types, r = [self.type(d) for d in of], f.new()
        if name in ("div", "rem") and dtype.kind != "f":
            self._divided(f, r, name, g.operands[node], args, dtype)
        elif name in ("add", "sub", "mul", "div", "rem"):
            f.add(f"{r} = {_arithmetic(name, dtype)} {t} {args[0]}, {args[1]}")
        elif name == "neg":
            f.add(f"{r} = fneg {t} {args[0]}" if dtype.kind == "f" else f"{r} = sub {t} zeroinitializer, {args[0]}")
        elif name == "product_error":
            self._product_error(f, r, args, dtype)
        elif name == "abs" and dtype.kind != "f":
            self.call(f, r, f"llvm.abs.{self.suffix(dtype)}", t, (t, args[0]), ("i1", "false"))
        elif name in _INTRINSICS:
            self.call(f, r, f"llvm.{_INTRINSICS[name]}.{self.suffix(dtype)}", t, (t, args[0]))
        elif name in ("max", "min"):
            full = {"f": f"{name}imum", "i": f"s{name}", "u": f"u{name}", "b": f"u{name}"}[dtype.kind]
            self.call(f, r, f"llvm.{full}.{self.suffix(dtype)}", t, (t, args[0]), (t, args[1]))
        elif name in COMPARISONS:
            f.add(f"{r} = {_comparison(name, of[0])} {types[0]} {args[0]}, {args[1]}")
        elif name in ("and", "or", "xor"):
            f.add(f"{r} = {name} {t} {args[0]}, {args[1]}")
        elif name == "not":
            f.add(f"{r} = xor {t} {args[0]}, {self.literal(True if dtype.kind == 'b' else -1, dtype)}")
        elif name == "select":
            f.add(f"{r} = select {types[0]} {args[0]}, {t} {args[1]}, {t} {args[2]}")
        elif name == "convert":
            self._converted(f, r, of[0], args[0], dtype)
        elif name == "bitcast":
            f.add(f"{r} = bitcast {types[0]} {args[0]} to {t}")
        else:
            self._shifted(f, r, name, g.operands[node][1], args, dtype)
        return r

    def _shifted(self, f: _Function, r: str, name: str, by: int, args: Sequence[str], dtype: np.dtype) -> None:
        """LLVM does not say what a shift by as many bits as a number has, or more, is."""
        t, mask, bits = self.type(dtype), self.type(np.dtype(bool)), 8 * dtype.itemsize
        instruction, a, b = {"shl": "shl", "shr": "lshr", "sar": "ashr"}[name], args[0], args[1]
        known = self.g.constants.get(by)
        if known is not None and 0 <= known < bits:
            f.add(f"{r} = {instruction} {t} {a}, {b}")
            return
        is_near, near, shifted = f.new(), f.new(), f.new()
        f.add(f"{is_near} = icmp ult {t} {b}, {self.literal(bits, dtype)}")
        f.add(f"{near} = select {mask} {is_near}, {t} {b}, {t} {self.literal(bits - 1, dtype)}")
        if name == "sar":
            f.add(f"{r} = {instruction} {t} {a}, {near}")
            return
        f.add(f"{shifted} = {instruction} {t} {a}, {near}")
        f.add(f"{r} = select {mask} {is_near}, {t} {shifted}, {t} zeroinitializer")

    def _divided(
        self, f: _Function, r: str, name: str, of: tuple[int, ...], args: Sequence[str], dtype: np.dtype
    ) -> None:
        """Integers. Processors stop at a division by 0, and at that of the smallest number by -1: here by 1."""
        t, mask, (a, b) = self.type(dtype), self.type(np.dtype(bool)), args
        instruction = f"{'s' if dtype.kind == 'i' else 'u'}{name}"
        known = self.g.constants.get(of[1])
        if known is not None and known > 0:
            f.add(f"{r} = {instruction} {t} {a}, {b}")
            return
        is_zero, is_bad, divisor, result = f.new(), f.new(), f.new(), f.new()
        f.add(f"{is_zero} = icmp eq {t} {b}, zeroinitializer")
        if dtype.kind == "i":
            is_minus, is_least, overflows = f.new(), f.new(), f.new()
            f.add(f"{is_minus} = icmp eq {t} {b}, {self.literal(-1, dtype)}")
            f.add(f"{is_least} = icmp eq {t} {a}, {self.literal(np.iinfo(dtype).min, dtype)}")
            f.add(f"{overflows} = and {mask} {is_minus}, {is_least}")
            f.add(f"{is_bad} = or {mask} {overflows}, {is_zero}")
        else:
            is_bad = is_zero
        f.add(f"{divisor} = select {mask} {is_bad}, {t} {self.literal(1, dtype)}, {t} {b}")
        f.add(f"{result} = {instruction} {t} {a}, {divisor}")
        of_zero = a if name == "rem" else self.literal(-1, dtype)
        f.add(f"{r} = select {mask} {is_zero}, {t} {of_zero}, {t} {result}")

    def _product_error(self, f: _Function, r: str, args: Sequence[str], dtype: np.dtype) -> None:
        """a b - p: by a fused multiply-add; or in float64, which holds products of float32; or after Dekker [1971].

        The third loses digits below tiny / eps, where the other two do not. See `transforms.split`.
        """
        t, (a, b, p) = self.type(dtype), args

        def of(instruction: str, x: str, y: str, kind: str = t) -> str:
            register = f.new()
            f.add(f"{register} = {instruction} {kind} {x}, {y}")
            return register

        def cast(instruction: str, x: str, source: str, to: str) -> str:
            register = f.new()
            f.add(f"{register} = {instruction} {source} {x} to {to}")
            return register

        if self.has_fma:
            minus = f.new()
            f.add(f"{minus} = fneg {t} {p}")
            self.call(f, r, f"llvm.fma.{self.suffix(dtype)}", t, (t, a), (t, b), (t, minus))
            return
        wide = self.type(np.dtype(np.float64))
        if dtype == np.float32:
            a, b, p = (cast("fpext", x, t, wide) for x in (a, b, p))
            error = of("fsub", of("fmul", a, b, wide), p, wide)
            f.add(f"{r} = fptrunc {wide} {error} to {t}")
            return
        mask, integer = self.type(np.dtype(bool)), np.dtype(np.uint64)
        bits, info, half = self.type(integer), np.finfo(np.float64), self.literal(1 << 26, np.dtype(np.uint64))

        def split(x: str) -> tuple[str, str]:
            size, added, kept = f.new(), f.new(), f.new()
            self.call(f, size, f"llvm.fabs.{self.suffix(dtype)}", t, (t, x))
            is_usual = of("fcmp olt", size, self.literal((2 - 2.0**-26) * 2.0**1023, dtype))
            has_low_half = of("fcmp oge", size, self.literal(info.tiny / info.eps, dtype))
            f.add(f"{added} = select {mask} {is_usual}, {bits} {half}, {bits} zeroinitializer")
            rounded = of("add", cast("bitcast", x, t, bits), added, bits)
            upper = of("and", rounded, self.literal((1 << 64) - (1 << 27), integer), bits)
            upper = cast("bitcast", upper, bits, t)
            f.add(f"{kept} = select {mask} {has_low_half}, {t} {upper}, {t} {x}")
            return kept, of("fsub", x, kept)

        (a_hi, a_lo), (b_hi, b_lo) = split(a), split(b)
        e = of("fsub", of("fmul", a_hi, b_hi), p)
        for x, y in ((a_hi, b_lo), (a_lo, b_hi)):
            e = of("fadd", e, of("fmul", x, y))
        f.add(f"{r} = fadd {t} {e}, {of('fmul', a_lo, b_lo)}")

    def _converted(self, f: _Function, r: str, of: np.dtype, x: str, to: np.dtype) -> None:
        kinds, source, t = of.kind + to.kind, self.type(of), self.type(to)
        if to.kind == "b":
            f.add(f"{r} = {'fcmp une' if of.kind == 'f' else 'icmp ne'} {source} {x}, zeroinitializer")
        elif kinds in ("fi", "fu"):
            # What does not fit is cut off, and NaN is 0, as in XLA.
            name = f"llvm.fpto{'s' if to.kind == 'i' else 'u'}i.sat.{self.suffix(to)}.{self.suffix(of)}"
            self.call(f, r, name, t, (source, x))
        else:
            f.add(f"{r} = {_conversion(kinds, of, to)} {source} {x} to {t}")


def _literal(x: Any, dtype: np.dtype) -> str:
    if dtype.kind == "f":
        with np.errstate(all="ignore"):
            return f"0x{struct.unpack('<Q', struct.pack('<d', float(x)))[0]:016X}"
    return ("true" if x else "false") if dtype.kind == "b" else str(int(x))


def _arithmetic(name: str, dtype: np.dtype) -> str:
    if dtype.kind == "f":
        return f"f{name}"
    if name in ("div", "rem"):
        return f"{'s' if dtype.kind == 'i' else 'u'}{name}"
    return name


def _comparison(name: str, of: np.dtype) -> str:
    if of.kind == "f":
        return f"fcmp {_ORDERED[name]}"
    return f"icmp {'' if name in ('eq', 'ne') else 's' if of.kind == 'i' else 'u'}{name}"


def _conversion(kinds: str, of: np.dtype, to: np.dtype) -> str:
    """The instruction for a conversion, by the kinds of both dtypes."""
    if kinds == "ff":
        return "fpext" if to.itemsize > of.itemsize else "fptrunc"
    if kinds[1] == "f":
        return "sitofp" if kinds[0] == "i" else "uitofp"
    if kinds[0] == "b" or to.itemsize > of.itemsize:
        return "sext" if kinds[0] == "i" else "zext"
    return "trunc" if to.itemsize < of.itemsize else "bitcast"
