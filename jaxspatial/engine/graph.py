"""Programs as graphs: operations on single numbers of one state, in static single assignment, with loops.

A graph is made from the trace of a program for one state. An array of the trace becomes an array of nodes, so that what
only moves numbers (slices, transposes, concatenations) leaves nothing behind. Nodes have no effects: an operation that
is found again is one node, one of constants is a constant, and one whose operands a loop does not change stands in
front of the loop. What a compiler makes of a graph is in `llvm_ir`; `run` evaluates it with NumPy.
"""

import contextlib
import functools
import itertools
import math
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from jax import lax

from jaxspatial.numerics.jax_internals import ClosedJaxpr, Literal

Nodes = np.ndarray  # of the numbers of nodes, of dtype int64
BOOL = np.dtype(bool)
# A loop is unrolled where the graph has at most so many nodes with all its turns. Unrolled code is faster, for it needs
# no tables and what is the same in several turns is one node, and LLVM takes some 50 us for each operation. In float32,
# 16 states side by side, ns for a state and seconds of LLVM, loops kept and unrolled:
#   inverse dynamics, forward dynamics, mass matrix, gradient of forward dynamics
#   solo12: 58, 154, 121, 354 ns, 0.1, 0.2, 0.3, 0.5 s     50, 127, 88, 290 ns, 0.2, 0.4, 0.3, 1.0 s
#   G1: 157, 439, 414, 1006 ns, 0.3, 0.5, 0.9, 1.3 s       164, 425, 347, 869 ns, 0.4, 1.2, 1.0, 2.6 s
#   G1, gradient of a step: 1350 ns, 1.7 s                 930 ns, 2.3 s
#   solo12, step on the ground: 1440 ns, 1.4 s             1300 ns, 1.5 s
MOST_UNROLLED = 50_000
# A loop of many turns is unrolled up to fewer nodes: inverse dynamics of 100 links takes 0.69 us for a state and 0.53 s
# to compile, unrolled, and 0.57 us and 0.24 s as a loop.
MANY_TURNS, MOST_OF_MANY = 16, 20_000
# A loop that reads no rows does the same in each turn. It is unrolled up to so many nodes: 20 iterations of
# `close_loops` of two arms of seven joints take 12 s to compile, unrolled, and 4 s as a loop.
MOST_REPEATED = 2_000
# A branch of at least so many operations is skipped where no state takes it.
LEAST_SKIPPED = 50
# Numbers in a table from which a program picks by an index. Where there are more, reading them takes the compiler long.
LARGEST_TABLE = 1 << 16
# Numbers that are read at once beside an index.
LARGEST_WINDOW = 8


class NotSupportedError(Exception):
    """A trace has an operation that no graph has: the program takes XLA's way."""


class Loop:
    """A loop of a graph. Nodes of its region are computed in every turn.

    length: the number of turns; None for a loop that goes on while `condition` is true. is_branch: whether it has at
    most one turn, of states for which `condition` is true. is_reverse: whether the rows are taken from the last one on.
    carried: of each number that turns pass on (parameter, its first value, its new value). rows: by parameter, the
    nodes that it is in each turn, by row. stacked: nodes of the body whose values in all turns are results.
    """

    def __init__(self, region: int, length: int | None, is_reverse: bool = False):
        self.region, self.length, self.is_reverse, self.is_branch = region, length, is_reverse, False
        self.carried: list[tuple[int, int, int]] = []
        self.rows: dict[int, tuple[int, ...]] = {}
        self.stacked: list[int] = []
        self.condition = -1


class Graph:
    """Nodes by number: what they compute, of which nodes, in which dtype and region.

    operations: names. A "load" has (argument, place) in `details`, a "constant" its value, a "carried" or "row" the
    number of its loop. A "last" is what a loop leaves of a carried number, and a "stacked" what a node of the body was
    in one turn: their details are (loop, which, row). A "convert" or "bitcast" has another dtype than its operand.
    regions: 0 is the program, others are the bodies of loops. parents: of each region, the one around it.
    A "lookup" is what a table has so many places behind an index: its details are the numbers of the table and of the
    places. tables: of each the nodes, all constants or loads that lie one after the other. results: for each result of
    the program its nodes. copies: nodes that do again what others do.
    """

    def __init__(self):
        self.operations, self.operands, self.dtypes = list[str](), list[tuple[int, ...]](), list[np.dtype]()
        self.regions, self.details = list[int](), dict[int, Any]()
        self.constants: dict[int, Any] = {}
        self.parents, self.depths = [-1], [0]
        self.loops: list[Loop] = []
        self.tables: list[tuple[int, ...]] = []
        self.results: list[Nodes] = []
        self.copies = set[int]()
        self._known: dict[Hashable, int] = {}
        self._table_numbers: dict[tuple[int, ...], int] = {}
        # The branch that is being read: what is new is computed there, whatever it is made of, and known only there.
        self._branch_region, self._known_there = 0, list[Hashable]()

    def __len__(self) -> int:
        return len(self.operations)

    # -- nodes --------------------------------------------------------------------------------------------------------

    def constant(self, x, dtype: np.dtype) -> int:
        x = np.asarray(x, dtype)[()]
        key = dtype.char, x.tobytes()
        node = self._known.get(key)
        if node is None:
            node = self._known[key] = self._added("constant", (), dtype, 0)
            self.constants[node] = x
        return node

    def load(self, argument: int, place: int, dtype: np.dtype) -> int:
        key = "load", argument, place
        if key not in self._known:
            self._known[key] = self._added("load", (), dtype, 0)
            self.details[self._known[key]] = argument, place
        return self._known[key]

    def operation(self, name: str, operands: tuple[int, ...], dtype: np.dtype) -> int:
        """The node of an operation, which may be known already, or be a constant."""
        key = (name, *operands) if name not in ("convert", "bitcast") else (name, *operands, dtype.char)
        node = self._known.get(key)
        if node is None:
            node = self._known[key] = self._simplest(name, operands, dtype)
            if self._branch_region:
                self._known_there.append(key)
        return node

    def _simplest(self, name: str, operands: tuple[int, ...], dtype: np.dtype) -> int:
        constants, depths, regions = self.constants, self.depths, self.regions
        for x in operands:
            if x not in constants:
                break
        else:
            with np.errstate(all="ignore"):
                return self.constant(EVALUATE[name](dtype, *[constants[x] for x in operands]), dtype)
        simpler = _SIMPLER.get(name)
        if simpler is not None and (node := simpler(self, *operands)) is not None:
            return node
        region = self._branch_region
        for x in operands:
            r = regions[x]
            if depths[r] > depths[region]:
                region = r
        return self._added(name, operands, dtype, region)

    def _added(self, name: str, operands: tuple[int, ...], dtype: np.dtype, region: int) -> int:
        self.operations.append(name)
        self.operands.append(operands)
        self.dtypes.append(dtype)
        self.regions.append(region)
        return len(self.operations) - 1

    def table(self, nodes: Sequence[int]) -> int:
        """The number of a table of these nodes."""
        table, operations = tuple(nodes), {self.operations[n] for n in nodes}
        if len(table) > LARGEST_TABLE:
            raise NotSupportedError("a gather from a large array")
        if operations == {"load"}:
            argument, first = self.details[table[0]]
            is_row = all(self.details[n] == (argument, first + k) for k, n in enumerate(table))
        else:
            is_row = operations == {"constant"}
        if not is_row or self.dtypes[table[0]] == BOOL:
            raise NotSupportedError("a gather from what is computed")
        if table not in self._table_numbers:
            self._table_numbers[table] = len(self.tables)
            self.tables.append(table)
        return self._table_numbers[table]

    def lookup(self, table: int, index: int, places: int, dtype: np.dtype) -> int:
        """The node of the number of a table so many places behind an index, which is in its range."""
        key = "lookup", table, index, places
        if key not in self._known:
            region = max(self._branch_region, self.regions[index], key=self.depths.__getitem__)
            self._known[key] = node = self._added("lookup", (index,), dtype, region)
            self.details[node] = table, places
            if self._branch_region:
                self._known_there.append(key)
        return self._known[key]

    def copied(self, node: int, operands: tuple[int, ...]) -> int:
        """A node that does once more what another one does."""
        self.copies.add(len(self))
        if self.operations[node] == "lookup":
            self.details[len(self)] = self.details[node]
        return self._added(self.operations[node], operands, self.dtypes[node], self.regions[node])

    # -- loops --------------------------------------------------------------------------------------------------------

    def begun(self, around: int, length: int | None, is_reverse: bool = False) -> Loop:
        """A new loop, in the region `around`."""
        self.parents.append(around)
        self.depths.append(self.depths[around] + 1)
        self.loops.append(Loop(len(self.parents) - 1, length, is_reverse))
        return self.loops[-1]

    @contextlib.contextmanager
    def branch(self, around: int) -> Iterator[Loop]:
        """A new branch, in which nodes are made meanwhile."""
        loop = self.begun(around, None)
        loop.is_branch = True
        before = self._branch_region, self._known_there
        self._branch_region, self._known_there = loop.region, []
        yield loop
        for key in self._known_there:
            del self._known[key]
        self._branch_region, self._known_there = before

    def parameter(self, loop: Loop, name: str, dtype: np.dtype) -> int:
        node = self._added(name, (), dtype, loop.region)
        self.details[node] = self.loops.index(loop)
        return node

    def loop_result(self, loop: Loop, name: str, which: int, row: int, dtype: np.dtype) -> int:
        node = self._added(name, (), dtype, self.parents[loop.region])
        self.details[node] = self.loops.index(loop), which, row
        return node

    def is_inside(self, inner: int, outer: int) -> bool:
        """Whether a region is another one, or inside of it."""
        while self.depths[inner] > self.depths[outer]:
            inner = self.parents[inner]
        return inner == outer


# -- operations --------------------------------------------------------------------------------------------------------


def _product_error(d: np.dtype, a, b, p):
    """a b - p of p = fl(a b), rounded once as a fused multiply-add does it.

    Of float64 by Dekker's splitting, of numbers between 1/2 and 1. [Dekker 1971]
    """
    if d == np.float32:
        return np.asarray(np.float64(a) * np.float64(b) - np.float64(p)).astype(d)
    (a, a_exponent), (b, b_exponent) = np.frexp(np.float64(a)), np.frexp(np.float64(b))
    exponent, product = a_exponent + b_exponent, a * b
    half, upper = np.uint64(1 << 26), np.uint64(0xFFFFFFFFF8000000)
    a_hi, b_hi = (((x.view(np.uint64) + half) & upper).view(np.float64) for x in (a, b))
    a_lo, b_lo = a - a_hi, b - b_hi
    error = ((a_hi * b_hi - product) + a_hi * b_lo + a_lo * b_hi) + a_lo * b_lo
    usual = np.isfinite(a) & np.isfinite(b)
    return np.ldexp((product - np.ldexp(p, -exponent)) + np.where(usual, error, 0), exponent)


def _fma(d: np.dtype, a, b, c):
    """a b + c rounded once, while the error of a b is a normal number. [Boldo, Melquiond 2008, Emulation of FMA and
    correctly rounded sums: proved algorithms using rounding to odd, Fig. 5]"""
    if d == np.float32:  # Whose products float64 holds.
        return _rounded_to_odd(np.float64(a) * np.float64(b), np.float64(c)).astype(d)
    p = a * b
    high, low = _two_sum(c, _product_error(d, a, b, p))
    total, rest = _two_sum(p, high)
    return np.where(np.isfinite(p), total + _rounded_to_odd(low, rest), p + c)


def _two_sum(a, b) -> tuple[Any, Any]:
    s = a + b
    part = s - a
    return s, (a - (s - part)) + (b - part)


def _rounded_to_odd(a, b):
    """a + b of float64, and if that is not a number of the format the one of both neighbours whose last bit is set."""
    s, error = _two_sum(a, b)
    is_even = np.asarray(s).view(np.uint64) & np.uint64(1) == 0
    return np.where((error != 0) & is_even & np.isfinite(s), np.nextafter(s, np.copysign(np.inf, error)), s)


def _shifted(to: Callable, is_logical: bool, d: np.dtype, a, b):
    """By as many bits as a number has, or more, all are shifted out. Those that come in are 0, or repeat the sign."""
    bits, unsigned = 8 * d.itemsize, np.dtype(f"u{d.itemsize}")
    is_far = np.asarray(b).view(unsigned) >= bits
    a = np.asarray(a).view(unsigned if is_logical else f"i{d.itemsize}")
    shifted = to(a, np.where(is_far, bits - 1, b).astype(a.dtype)).view(d)
    return np.where(is_far, d.type(0), shifted) if is_logical else shifted


def _converted(d: np.dtype, a):
    """Of numbers that an integer does not hold the nearest one, and 0 of NaN."""
    a = np.asarray(a)
    if a.dtype.kind != "f" or d.kind not in "iu":
        return a.astype(d)
    info = np.iinfo(d)
    low, high = a.dtype.type(info.min), a.dtype.type(info.max)
    inside = np.where((a > low) & (a < high), a, 0).astype(d)
    return np.select([a <= low, a >= high], [d.type(info.min), d.type(info.max)], inside)


# What each operation computes, of NumPy scalars or arrays; d is the dtype of the result.
EVALUATE: dict[str, Callable] = {
    "add": lambda d, a, b: a + b,
    "sub": lambda d, a, b: a - b,
    "mul": lambda d, a, b: a * b,
    # Integers as XLA has them: towards zero, and with all bits set over 0.
    "div": lambda d, a, b: a / b if d.kind == "f" else np.where(b == 0, ~d.type(0), (a - np.fmod(a, b)) // b),
    "rem": lambda d, a, b: np.fmod(a, b) if d.kind == "f" else np.where(b == 0, a, np.fmod(a, b)),
    "product_error": _product_error,
    "fma": _fma,
    "neg": lambda d, a: -a,
    "abs": lambda d, a: np.abs(a),
    "sqrt": lambda d, a: np.sqrt(a),
    "round": lambda d, a: np.rint(a),
    "floor": lambda d, a: np.floor(a),
    "ceil": lambda d, a: np.ceil(a),
    # NaN where one is, and 0 is more than -0.
    "max": lambda d, a, b: np.where((d.kind == "f") & (a == b) & np.signbit(a), b, np.maximum(a, b)),
    "min": lambda d, a, b: np.where((d.kind == "f") & (a == b) & np.signbit(b), b, np.minimum(a, b)),
    "lt": lambda d, a, b: a < b,
    "le": lambda d, a, b: a <= b,
    "gt": lambda d, a, b: a > b,
    "ge": lambda d, a, b: a >= b,
    "eq": lambda d, a, b: a == b,
    "ne": lambda d, a, b: a != b,
    "and": lambda d, a, b: a & b,
    "or": lambda d, a, b: a | b,
    "xor": lambda d, a, b: a ^ b,
    "not": lambda d, a: ~a,
    "shl": functools.partial(_shifted, np.left_shift, True),
    "shr": functools.partial(_shifted, np.right_shift, True),
    "sar": functools.partial(_shifted, np.right_shift, False),
    "select": lambda d, c, t, f: np.where(c, t, f),
    "convert": _converted,
    "bitcast": lambda d, a: np.asarray(a).view(d),
}
COMPARISONS = {"lt", "le", "gt", "ge", "eq", "ne"}


def _select(g: Graph, condition: int, yes: int, no: int) -> int | None:
    if condition in g.constants:
        return yes if g.constants[condition] else no
    return yes if yes == no else None


def _logical(is_all: bool, g: Graph, a: int, b: int) -> int | None:
    """a and b, or a or b, where one of them is known: of masks any, of integers the 0 that changes no bits."""
    is_mask = g.dtypes[a] == BOOL
    if is_mask and a == b:
        return a
    for x, y in ((a, b), (b, a)):
        if x in g.constants and is_mask:
            return y if bool(g.constants[x]) == is_all else x
        if x in g.constants and not is_all and not g.constants[x]:
            return y
    return None


def _product(g: Graph, a: int, b: int) -> int | None:
    """1 x = x. A product with -1 or 0 stays: it has other bits where x is NaN or infinite."""
    constants = g.constants
    if a in constants and constants[a] == 1:
        return b
    return a if b in constants and constants[b] == 1 else None


_SIMPLER: dict[str, Callable[..., int | None]] = {
    "select": _select,
    "and": functools.partial(_logical, True),
    "or": functools.partial(_logical, False),
    "neg": lambda g, a: g.operands[a][0] if g.operations[a] == "neg" else None,
    "mul": _product,
    "div": lambda g, a, b: a if b in g.constants and g.constants[b] == 1 else None,
}
# Operations number by number, by the name of the primitive.
_OWN_NAMES = {"select", "convert", "bitcast", "round", "shl", "shr", "sar", "product_error", "fma"}
_ELEMENTWISE = {name: name for name in EVALUATE if name not in _OWN_NAMES}
_ELEMENTWISE |= {
    "add_any": "add",
    "jaxspatial_root": "sqrt",
    "jaxspatial_product": "mul",
    "jaxspatial_sum": "add",
    "jaxspatial_difference": "sub",
    "jaxspatial_quotient": "div",
    "shift_left": "shl",
    "shift_right_logical": "shr",
    "shift_right_arithmetic": "sar",
}
# As many, of what has a method of its own.
_LIKE_ELEMENTWISE = {
    "select_n",
    "round",
    "convert_element_type",
    "bitcast_convert_type",
    "integer_pow",
    "square",
    "is_finite",
    "sign",
    "clamp",
    "reduce_precision",
    "jaxspatial_two_product",
}
# Sums and products that a compiler may make one operation of, where bits are not promised. Those of the library's own
# primitives are rounded one by one.
_FUSIBLE = {"mul", "add", "sub", "add_any"}
# What keeps XLA from rewriting arithmetic, or says where arrays are: our compiler rewrites nothing.
_UNCHANGED = {
    "jaxspatial_barrier",
    "jaxspatial_barrier_or_nan",
    "jaxspatial_kept",
    "stop_gradient",
    "copy",
    "copy_p",
    "optimization_barrier",
    "sharding_constraint",
    "pvary",
    "reshard",
}
# What moves numbers: the nodes of a result of the given shape, of the parameters of the primitive and nodes.
_MOVED: dict[str, Callable[..., Nodes]] = {
    **dict.fromkeys(("reshape", "squeeze", "expand_dims"), lambda p, shape, x: x.reshape(shape)),
    "transpose": lambda p, shape, x: x.transpose(p["permutation"]),
    "rev": lambda p, shape, x: np.flip(x, p["dimensions"]),
    "slice": lambda p, shape, x: x[
        tuple(map(slice, p["start_indices"], p["limit_indices"], p["strides"] or [1] * x.ndim))
    ],
    "concatenate": lambda p, shape, *x: np.concatenate(x, axis=p["dimension"]),
    **dict.fromkeys(("stack", "jaxspatial_stack"), lambda p, shape, *x: np.stack(x, axis=p["axis"])),
}
# What calls another trace.
_CALLS = {
    "jit",
    "pjit",
    "core_call",
    "closed_call",
    "custom_jvp_call",
    "custom_vjp_call",
    "remat2",
    "checkpoint",
}
_REDUCTIONS = {
    "reduce_sum": "add",
    "reduce_or": "or",
    "reduce_and": "and",
    "reduce_max": "max",
    "reduce_min": "min",
    "reduce_prod": "mul",
}
# The results of a trace, of nodes in place of its arguments, and whether `a * b + c` may be rounded once in it.
Read = Callable[[ClosedJaxpr, Sequence[Nodes], bool], list[Nodes]]
# Of a primitive that stands for a trace: a function of (equation, Read, nodes) -> its results; None of any other.
Expand = Callable[[Any, Read, list[Nodes]], list[Nodes] | None]


def graph_of(
    closed: ClosedJaxpr,
    expand: Expand = lambda *_: None,
    *,
    most_unrolled: int | None = None,
    may_fuse: bool = False,
) -> Graph:
    """The graph of a trace for one state.

    expand: runs primitives that stand for a trace. most_unrolled: how many nodes a graph has at most with loops
    unrolled, MOST_UNROLLED unless given. may_fuse: whether `a * b + c` may be rounded once.

    Raises:
        NotSupportedError: the trace has an operation that graphs do not have.
    """
    builder = _Builder(expand, MOST_UNROLLED if most_unrolled is None else most_unrolled, may_fuse)
    arguments: list[Nodes] = []
    for i, v in enumerate(closed.jaxpr.invars):
        aval, dtype = cast(Any, v.aval), np.dtype(cast(Any, v.aval).dtype)
        _require_supported(dtype)
        nodes = [builder.graph.load(i, j, dtype) for j in range(int(np.prod(aval.shape)))]
        arguments.append(np.array(nodes, np.int64).reshape(aval.shape))
    builder.graph.results = [np.asarray(x) for x in builder.read(closed, arguments)]
    return builder.graph


def _require_supported(dtype: np.dtype) -> None:
    if dtype.char in "fd" or dtype.kind in "iub":
        return
    raise NotSupportedError(f"numbers of dtype {dtype}")


class _Builder:
    """Reads a trace, operation by operation, with arrays of nodes in place of arrays."""

    def __init__(self, expand: Expand, most_unrolled: int, may_fuse: bool):
        self.graph, self.expand, self.region = Graph(), expand, 0
        self.most_unrolled, self.may_fuse = most_unrolled, may_fuse
        # Products that may become part of a sum.
        self._loose = set[int]()
        self._singles: dict[tuple[int, tuple[int, ...]], Nodes] = {}

    def read(self, closed, arguments: Sequence[Nodes]) -> list[Nodes]:
        jaxpr, values = closed.jaxpr, dict[Any, Nodes]()
        values.update(zip(jaxpr.constvars, map(self.lifted, closed.consts), strict=True))
        values.update(zip(jaxpr.invars, arguments, strict=True))
        literal = self.literal
        for eqn in jaxpr.eqns:
            operands = [literal(x) if type(x) is Literal else values[x] for x in eqn.invars]
            for v, result in zip(eqn.outvars, self.equation(eqn, operands), strict=True):
                values[v] = result
        return [literal(x) if type(x) is Literal else values[x] for x in jaxpr.outvars]

    def read_within(self, closed, arguments: Sequence[Nodes], may_fuse: bool) -> list[Nodes]:
        """Runs a trace that a primitive stands for."""
        before, self.may_fuse = self.may_fuse, may_fuse
        results = self.read(closed, arguments)
        self.may_fuse = before
        return results

    def literal(self, x) -> Nodes:
        return self.lifted(np.asarray(x.val, x.aval.dtype))

    def lifted(self, x) -> Nodes:
        x = np.asarray(x)
        _require_supported(x.dtype)
        flat = x.ravel()
        return np.array([self.graph.constant(c, x.dtype) for c in flat], np.int64).reshape(x.shape)

    def each(self, name: str, dtype: np.dtype, *arrays: Nodes) -> Nodes:
        """An operation of each number of arrays that broadcast."""
        shape = arrays[0].shape
        for a in arrays:
            if a.shape != shape:
                arrays = tuple(np.broadcast_arrays(*arrays))
                shape = arrays[0].shape
                break
        suffix = (dtype.char,) if name in ("convert", "bitcast") else ()
        known, graph = self.graph._known, self.graph
        if arrays[0].size == 1:
            # Most are single numbers, of which one array each is kept.
            operands = tuple([a.item() for a in arrays])
            node = known.get((name, *operands, *suffix))
            if node is None:
                node = graph.operation(name, operands, dtype)
            single = self._singles.get((node, shape))
            if single is None:
                single = self._singles[node, shape] = np.array(node, np.int64).reshape(shape)
            return single
        found: list[int] = []
        for operands in zip(*[a.ravel().tolist() for a in arrays], strict=True):
            node = known.get((name, *operands, *suffix))
            found.append(graph.operation(name, operands, dtype) if node is None else node)
        return np.array(found, np.int64).reshape(shape)

    def equation(self, eqn, x: list[Nodes]) -> list[Nodes]:
        name = eqn.primitive.name
        if (operation := _ELEMENTWISE.get(name)) is not None:
            dtype = eqn.outvars[0].aval.dtype
            _require_supported(dtype)
            if self.may_fuse and name in _FUSIBLE:
                return [self._fused(operation, dtype, *x)]
            return [self.each(operation, dtype, *x)]
        if name in _UNCHANGED:
            return x
        if (moved := _MOVED.get(name)) is not None:
            return [moved(eqn.params, eqn.outvars[0].aval.shape, *x)]
        if name in _CALLS:
            return self.read(_called(eqn), x)
        method = getattr(self, f"_{name.replace('-', '_')}", None)
        if method is not None:
            return method(eqn, *x)
        if (results := self.expand(eqn, self.read_within, x)) is not None:
            return results
        if name in _REDUCTIONS:
            dtype, axes = np.dtype(eqn.outvars[0].aval.dtype), eqn.params["axes"]
            y = np.moveaxis(x[0], axes, range(len(axes))).reshape((-1, *eqn.outvars[0].aval.shape))
            return [self._reduced(_REDUCTIONS[name], dtype, y)]
        raise NotSupportedError(f"operation {name}")

    # -- number by number ---------------------------------------------------------------------------------------------

    def _fused(self, operation: str, dtype: np.dtype, a: Nodes, b: Nodes) -> Nodes:
        """A product, or a sum or difference of which a product becomes part: one operation in place of two."""
        graph, first_new = self.graph, len(self.graph)
        if operation == "mul":
            product = self.each("mul", dtype, a, b)
            self._loose.update(n for n in product.ravel().tolist() if n >= first_new and graph.operations[n] == "mul")
            return product
        a, b = np.broadcast_arrays(a, b)
        found: list[int] = []
        for x, y in zip(a.ravel().tolist(), b.ravel().tolist(), strict=True):
            if y in self._loose:
                factor, other = graph.operands[y]
                factor = graph.operation("neg", (factor,), dtype) if operation == "sub" else factor
                found.append(graph.operation("fma", (factor, other, x), dtype))
            elif x in self._loose:
                y = graph.operation("neg", (y,), dtype) if operation == "sub" else y
                found.append(graph.operation("fma", (*graph.operands[x], y), dtype))
            else:
                found.append(graph.operation(operation, (x, y), dtype))
        return np.array(found, np.int64).reshape(a.shape)

    def _select_n(self, eqn, which: Nodes, *cases: Nodes) -> list[Nodes]:
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        if len(cases) != 2 or eqn.invars[0].aval.dtype != bool:
            raise NotSupportedError(f"a selection of {len(cases)} cases")
        return [self.each("select", dtype, which, cases[1], cases[0])]

    def _round(self, eqn, x: Nodes) -> list[Nodes]:
        if int(eqn.params["rounding_method"]) != 1:
            raise NotSupportedError("rounding of halves away from zero")
        return [self.each("round", np.dtype(eqn.outvars[0].aval.dtype), x)]

    def _convert_element_type(self, eqn, x: Nodes) -> list[Nodes]:
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        _require_supported(dtype)
        return [x if dtype == eqn.invars[0].aval.dtype else self.each("convert", dtype, x)]

    def _bitcast_convert_type(self, eqn, x: Nodes) -> list[Nodes]:
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        if dtype.itemsize != eqn.invars[0].aval.dtype.itemsize:
            raise NotSupportedError("bits of numbers of another size")
        g, found = self.graph, list[int]()
        for node in x.ravel().tolist():
            # The bits of a number that was made of bits are these.
            (of,) = g.operands[node] if g.operations[node] == "bitcast" else (-1,)
            found.append(of if of >= 0 and g.dtypes[of] == dtype else g.operation("bitcast", (node,), dtype))
        return [np.array(found, np.int64).reshape(x.shape)]

    def _integer_pow(self, eqn, x: Nodes) -> list[Nodes]:
        if (power := eqn.params.get("y", 2)) != 2:
            raise NotSupportedError(f"the power {power}")
        return [self.each("mul", np.dtype(eqn.outvars[0].aval.dtype), x, x)]

    _square = _integer_pow

    def _is_finite(self, eqn, x: Nodes) -> list[Nodes]:
        dtype = np.dtype(eqn.invars[0].aval.dtype)
        infinity = self.lifted(np.full((), np.inf, dtype))
        return [self.each("lt", BOOL, self.each("abs", dtype, x), infinity)]

    def _sign(self, eqn, x: Nodes) -> list[Nodes]:
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        zero, one = (self.lifted(np.full((), c, dtype)) for c in (0, 1))
        # Twice a zero or NaN is the same; twice a subnormal number is 0 where these are flushed, as in XLA.
        rest = self.each("add", dtype, x, x) if dtype.kind == "f" else x
        if dtype.kind != "u":
            minus = self.lifted(np.full((), -1, dtype))
            rest = self.each("select", dtype, self.each("lt", BOOL, x, zero), minus, rest)
        return [self.each("select", dtype, self.each("gt", BOOL, x, zero), one, rest)]

    def _clamp(self, eqn, low: Nodes, x: Nodes, high: Nodes) -> list[Nodes]:
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        return [self.each("min", dtype, self.each("max", dtype, low, x), high)]

    def _reduce_precision(self, eqn, x: Nodes) -> list[Nodes]:
        """Rounds to fewer digits, half to even, in the bits of the numbers."""
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        info, digits = np.finfo(dtype), eqn.params["mantissa_bits"]
        if eqn.params["exponent_bits"] != info.nexp:
            raise NotSupportedError("exponents of fewer bits")
        cleared = info.nmant - digits
        if cleared == 0:
            return [x]
        integer = np.dtype(f"uint{info.bits}")

        def of(value: int) -> Nodes:
            return self.lifted(np.full((), value, integer))

        bits = self.each("bitcast", integer, x)
        odd = self.each("and", integer, self.each("shr", integer, bits, of(cleared)), of(1))
        added = self.each("add", integer, odd, of((1 << (cleared - 1)) - 1))
        rounded = self.each("add", integer, bits, added)
        kept = self.each("and", integer, rounded, of((1 << info.bits) - (1 << cleared)))
        is_number = self.each("eq", BOOL, x, x)
        return [self.each("select", dtype, is_number, self.each("bitcast", dtype, kept), x)]

    def _jaxspatial_replica(self, eqn, _: Nodes) -> list[Nodes]:
        """A zero that no compiler knows, but this one."""
        return [self.lifted(np.zeros((), eqn.outvars[0].aval.dtype))]

    def _jaxspatial_two_product(self, eqn, a: Nodes, b: Nodes) -> list[Nodes]:
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        p = self.each("mul", dtype, a, b)
        return [p, self.each("product_error", dtype, a, b, p)]

    # -- what moves numbers -------------------------------------------------------------------------------------------

    def _broadcast_in_dim(self, eqn, x: Nodes) -> list[Nodes]:
        shape = [1] * len(eqn.params["shape"])
        for k, axis in enumerate(eqn.params["broadcast_dimensions"]):
            shape[axis] = x.shape[k]
        return [np.broadcast_to(x.reshape(shape), eqn.params["shape"])]

    def _unstack(self, eqn, x: Nodes) -> list[Nodes]:
        axis = eqn.params["axis"]
        return [np.take(x, k, axis) for k in range(x.shape[axis])]

    _jaxspatial_unstack = _unstack

    def _split(self, eqn, x: Nodes) -> list[Nodes]:
        return list(np.split(x, np.cumsum(eqn.params["sizes"])[:-1], axis=eqn.params["axis"]))

    def _pad(self, eqn, x: Nodes, value: Nodes) -> list[Nodes]:
        config = eqn.params["padding_config"]
        if any(low < 0 or high < 0 for low, high, _ in config):
            raise NotSupportedError("negative padding")
        y = np.full(eqn.outvars[0].aval.shape, value[()], np.int64)
        places = (
            slice(low, low + (n - 1) * (inner + 1) + 1 if n else low, inner + 1)
            for (low, _, inner), n in zip(config, x.shape, strict=True)
        )
        y[tuple(places)] = x
        return [y]

    def _platform_index(self, eqn) -> list[Nodes]:
        """Which of several ways a function goes on this platform: the one for all that are not named."""
        named = {name for names in eqn.params["platforms"] if names for name in names}
        if named & {"cpu", "cuda"}:
            raise NotSupportedError("a way of its own for CPUs or NVIDIA's GPUs")
        return [self.lifted(np.int32(eqn.params["platforms"].index(None)))]

    def _iota(self, eqn, *_: Nodes) -> list[Nodes]:
        shape, axis = eqn.params["shape"], eqn.params["dimension"]
        row = np.arange(shape[axis], dtype=eqn.params["dtype"])
        return [np.broadcast_to(self.lifted(row).reshape([-1 if k == axis else 1 for k in range(len(shape))]), shape)]

    def _empty(self, eqn, *_: Nodes) -> list[Nodes]:
        aval = eqn.outvars[0].aval
        return [self.lifted(np.zeros(aval.shape, aval.dtype))]

    _empty2 = _empty

    def _dynamic_slice(self, eqn, x: Nodes, *starts: Nodes) -> list[Nodes]:
        sizes = eqn.params["slice_sizes"]
        at = self._places(x, sizes, starts)
        if at is not None:
            return [x[at]]
        options, axis = self._options(x, sizes, starts)
        dtype = np.dtype(eqn.outvars[0].aval.dtype)
        return [self._chosen(dtype, starts[axis], [x[at] for at in options])]

    def _dynamic_update_slice(self, eqn, x: Nodes, new: Nodes, *starts: Nodes) -> list[Nodes]:
        at = self._places(x, new.shape, starts)
        if at is not None:
            y = x.copy()
            y[at] = new
            return [y]
        options, axis = self._options(x, new.shape, starts)
        dtype, y = np.dtype(eqn.outvars[0].aval.dtype), x.copy()
        for k, place in enumerate(options):
            is_here = self._is_at(starts[axis], k, len(options))
            y[place] = self.each("select", dtype, is_here, new, y[place])
        return [y]

    def _gather(self, eqn, x: Nodes, indices: Nodes) -> list[Nodes]:
        d = eqn.params["dimension_numbers"]
        axes = _WindowAxes(
            d.collapsed_slice_dims, d.start_index_map, d.operand_batching_dims, d.start_indices_batching_dims
        )
        is_known = all(i in self.graph.constants for i in indices.ravel().tolist())
        is_inside = eqn.params["mode"] in (lax.GatherScatterMode.CLIP, lax.GatherScatterMode.PROMISE_IN_BOUNDS)
        sizes, n_batch = eqn.params["slice_sizes"], indices.ndim - 1
        is_small = x.size and not axes.batching and math.prod(sizes) <= LARGEST_WINDOW
        if not is_known and is_inside and is_small:
            y = self._looked_up(x, sizes, indices, axes)
        else:
            y = x.ravel()[self._windows(x.shape, sizes, indices, axes)]
        return [np.moveaxis(y, range(n_batch, y.ndim), d.offset_dims)]

    def _looked_up(self, x: Nodes, sizes: Sequence[int], indices: Nodes, axes: "_WindowAxes") -> Nodes:
        """Windows of a table at indices, which are moved to lie in it: (*batch, *axes that windows keep)."""
        graph, flat = self.graph, x.ravel().tolist()
        table, dtype, kind = graph.table(flat), graph.dtypes[flat[0]], graph.dtypes[int(indices.flat[0])]
        if len(axes.of_indices) > 1 and kind.itemsize < 4:
            indices, kind = self.each("convert", np.dtype(np.int32), indices), np.dtype(np.int32)
        parts = list[Nodes]()
        for k, axis in enumerate(axes.of_indices):
            stride = math.prod(x.shape[axis + 1 :])
            last, zero, step = (self.lifted(np.full((), c, kind)) for c in (x.shape[axis] - sizes[axis], 0, stride))
            inside = self.each("min", kind, self.each("max", kind, indices[..., k], zero), last)
            parts.append(self.each("mul", kind, inside, step) if stride > 1 else inside)
        first = functools.reduce(lambda a, b: self.each("add", kind, a, b), parts)
        kept = [n for k, n in enumerate(sizes) if k not in axes.dropped]
        window = np.reshape(np.ravel_multi_index(tuple(np.indices(sizes)), x.shape), kept)
        found = [
            flat[int(graph.constants[i]) + places] if i in graph.constants else graph.lookup(table, i, places, dtype)
            for i in first.ravel().tolist()
            for places in window.ravel().tolist()
        ]
        return np.array(found, np.int64).reshape((*first.shape, *window.shape))

    def _scatter_add(self, eqn, x: Nodes, indices: Nodes, new: Nodes) -> list[Nodes]:
        d, dtype = eqn.params["dimension_numbers"], np.dtype(eqn.outvars[0].aval.dtype)
        axes = _WindowAxes(
            d.inserted_window_dims,
            d.scatter_dims_to_operand_dims,
            d.operand_batching_dims,
            d.scatter_indices_batching_dims,
        )
        window = iter(new.shape[k] for k in d.update_window_dims)
        one = {*axes.dropped, *axes.batching}
        places = self._windows(x.shape, [1 if k in one else next(window) for k in range(x.ndim)], indices, axes)
        moved = np.moveaxis(new, d.update_window_dims, range(indices.ndim - 1, new.ndim))
        flat = x.ravel().copy()
        for place, node in zip(places.ravel().tolist(), moved.ravel().tolist(), strict=True):
            flat[place] = self.graph.operation("add", (int(flat[place]), node), dtype)
        return [flat.reshape(x.shape)]

    def _windows(self, shape: tuple[int, ...], sizes: Sequence[int], indices: Nodes, axes: "_WindowAxes") -> np.ndarray:
        """The places in a flat array of windows of such sizes: (*batch of the indices, *axes that windows keep)."""
        constants, n = self.graph.constants, len(shape)
        if any(i not in constants for i in indices.ravel().tolist()):
            raise NotSupportedError("a gather or scatter whose indices are not known")
        known = np.array([int(constants[i]) for i in indices.ravel().tolist()], np.int64).reshape(indices.shape)
        starts = np.zeros((*known.shape[:-1], n), np.int64)
        starts[..., list(axes.of_indices)] = known
        for axis, of_batch in zip(axes.batching, axes.of_batching, strict=True):
            starts[..., axis] = np.indices(known.shape[:-1])[of_batch]
        if (starts < 0).any() or (starts + sizes > shape).any():
            raise NotSupportedError("a gather or scatter outside of an array")
        inside = np.moveaxis(np.indices(sizes), 0, -1)
        places = starts.reshape((*starts.shape[:-1], *[1] * n, n)) + inside
        flat = np.asarray(np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), shape))
        return flat.squeeze(tuple(known.ndim - 1 + k for k in (*axes.dropped, *axes.batching)))

    def _places(self, x: Nodes, sizes: Sequence[int], starts: Sequence[Nodes]) -> tuple[slice, ...] | None:
        """Where a slice begins and ends, if that is known; it is moved to lie in the array, as XLA does."""
        constants = self.graph.constants
        both = zip(starts, x.shape, sizes, strict=True)
        found = [0 if n == size else constants.get(int(i[()])) for i, n, size in both]
        if any(i is None for i in found):
            return None
        firsts = [max(0, min(int(cast(Any, i)), n - size)) for i, n, size in zip(found, x.shape, sizes, strict=True)]
        return tuple(slice(i, i + size) for i, size in zip(firsts, sizes, strict=True))

    def _options(self, x: Nodes, sizes: Sequence[int], starts: Sequence[Nodes]) -> tuple[list[tuple[slice, ...]], int]:
        """(the places that a slice may have, the axis along which its start is not known)."""
        both = enumerate(zip(starts, x.shape, sizes, strict=True))
        unknown = [k for k, (i, n, size) in both if n > size and int(i[()]) not in self.graph.constants]
        if len(unknown) != 1:
            raise NotSupportedError("a slice whose place is unknown along several axes")
        axis = unknown[0]
        zero = self.lifted(np.zeros((), np.int32))
        firsts = [zero if k == axis else i for k, i in enumerate(starts)]
        at = cast(tuple[slice, ...], self._places(x, sizes, firsts))
        n = x.shape[axis] - sizes[axis] + 1
        return [(*at[:axis], slice(k, k + sizes[axis]), *at[axis + 1 :]) for k in range(n)], axis

    def _chosen(self, dtype: np.dtype, index: Nodes, options: Sequence[Nodes]) -> Nodes:
        chosen = options[-1]
        for k in range(len(options) - 2, -1, -1):
            chosen = self.each("select", dtype, self._is_at(index, k, len(options)), options[k], chosen)
        return chosen

    def _is_at(self, index: Nodes, k: int, n: int) -> Nodes:
        """Whether an index, moved into 0 ... n - 1, is k."""
        dtype = self.graph.dtypes[int(index[()])]
        name = "le" if k == 0 and n > 1 else "ge" if k == n - 1 else "eq"
        return self.each(name, BOOL, index, self.lifted(np.full((), k, dtype)))

    def _dot_general(self, eqn, x: Nodes, y: Nodes) -> list[Nodes]:
        """Term by term, from the first on, as `xla` adds them."""
        dtypes = {np.dtype(v.aval.dtype) for v in (*eqn.invars, *eqn.outvars)}
        if len(dtypes) > 1:
            raise NotSupportedError("a product of numbers of several dtypes")
        (summed, batches), shape, dtype = eqn.params["dimension_numbers"], eqn.outvars[0].aval.shape, dtypes.pop()

        def in_front(x: Nodes, which: int) -> Nodes:
            """With the axes of batches first, then those of terms, then one."""
            axes = (*batches[which], *summed[which])
            sizes = [x.shape[k] for k in axes]
            moved, n = np.moveaxis(x, axes, range(len(axes))), len(batches[which])
            return moved.reshape((math.prod(sizes[:n]), math.prod(sizes[n:]), -1))

        x, y = in_front(x, 0), in_front(y, 1)
        terms = self.each("mul", dtype, x[:, :, :, None], y[:, :, None, :])
        return [self._reduced("add", dtype, np.moveaxis(terms, 1, 0)).reshape(shape)]

    def _cholesky(self, eqn, x: Nodes) -> list[Nodes]:
        """L of L L^T, column by column; NaN from the first pivot on that is not positive. [Golub, Van Loan 2013, 4.2.5]

        Rounded in the order of `xla`, not in that of LAPACK.
        """
        dtype, n = np.dtype(eqn.outvars[0].aval.dtype), x.shape[-1]
        zero, nan = (self.lifted(np.full((), c, dtype)) for c in (0, np.nan))
        L = np.broadcast_to(zero, x.shape).copy()
        for j in range(n):
            column = x[..., j:, j]
            for k in range(j):
                product = self.each("mul", dtype, L[..., j:, k], L[..., j, k, None])
                column = self.each("sub", dtype, column, product)
            pivot = self.each("sqrt", dtype, column[..., :1])
            pivot = self.each("select", dtype, self.each("lt", BOOL, zero, column[..., :1]), pivot, nan)
            L[..., j:, j] = np.concatenate([pivot, self.each("div", dtype, column[..., 1:], pivot)], -1)
        return [L]

    def _triangular_solve(self, eqn, a: Nodes, b: Nodes) -> list[Nodes]:
        """The solution of a x = b, or of x a = b, by substitution, row by row."""
        p, dtype, n = eqn.params, np.dtype(eqn.outvars[0].aval.dtype), a.shape[-1]
        is_transposed = p["transpose_a"] != (not p["left_side"])
        a, x = a.swapaxes(-1, -2) if is_transposed else a, (b if p["left_side"] else b.swapaxes(-1, -2)).copy()
        order = range(n) if p["lower"] != is_transposed else range(n)[::-1]
        for i, row in enumerate(order):
            for k in order[:i]:
                product = self.each("mul", dtype, a[..., row, k, None], x[..., k, :])
                x[..., row, :] = self.each("sub", dtype, x[..., row, :], product)
            if not p["unit_diagonal"]:
                x[..., row, :] = self.each("div", dtype, x[..., row, :], a[..., row, row, None])
        return [x if p["left_side"] else x.swapaxes(-1, -2)]

    def _reduced(self, operation: str, dtype: np.dtype, y: Nodes) -> Nodes:
        """The rows of an array together."""
        if not len(y):
            raise NotSupportedError("a reduction of nothing")
        # XLA begins with 0, which tells from -0.
        begins = operation == "add" and dtype.kind == "f" and len(y) > 1
        total, *rows = [self.lifted(np.zeros((), dtype)), *y] if begins else y
        for row in rows:
            total = self.each(operation, dtype, total, row)
        return np.asarray(total)

    # -- branches and loops -------------------------------------------------------------------------------------------

    def _cond(self, eqn, index: Nodes, *x: Nodes) -> list[Nodes]:
        branches, node = eqn.params["branches"], int(index[()])
        if node in self.graph.constants:
            k = int(self.graph.constants[node])
            return self.read(branches[max(0, min(k, len(branches) - 1))], x)
        (condition,) = self.graph.operands[node] if self.graph.operations[node] == "convert" else (node,)
        # Within a branch that is taken where the condition holds, it is known.
        if condition in self.graph.constants:
            return self.read(branches[bool(self.graph.constants[condition])], x)
        # Of states side by side all take both ways, where one is short.
        if len(branches) == 2 and self.graph.dtypes[condition] == BOOL:
            sizes = [self._size(branch.jaxpr) for branch in branches]
            if min(sizes) == 0 and max(sizes) >= LEAST_SKIPPED:
                return self._skipped(condition, branches, sizes[1] > 0, x)
        results = [self.read(branch, x) for branch in branches]
        if self.graph.dtypes[node] == BOOL:
            both = zip(*results, strict=True)
            return [self.each("select", self._dtype(yes), index, yes, no) for no, yes in both]
        return [self._chosen(self._dtype(options[0]), index, options) for options in zip(*results, strict=True)]

    def _size(self, jaxpr) -> int:
        """About how many operations a trace has, number by number; what may be known, such as an index, is left out."""
        size = 0
        for eqn in jaxpr.eqns:
            name, p = eqn.primitive.name, eqn.params
            if name in _ELEMENTWISE or name in _LIKE_ELEMENTWISE:
                size += sum(math.prod(v.aval.shape) for v in eqn.outvars)
            elif name in _REDUCTIONS:
                size += math.prod(eqn.invars[0].aval.shape)
            elif name == "dot_general":
                (terms, _), _ = p["dimension_numbers"]
                n_terms = math.prod(eqn.invars[0].aval.shape[k] for k in terms)
                size += 2 * n_terms * math.prod(eqn.outvars[0].aval.shape)
            elif name in ("cholesky", "triangular_solve"):
                a, b = eqn.invars[0].aval.shape, eqn.invars[-1].aval.shape
                size += math.prod(b) * a[-1] // (3 if name == "cholesky" else 1)
            elif name == "scan":
                size += p["length"] * self._size(p["jaxpr"].jaxpr)
            elif name == "while":
                size += self._size(p["cond_jaxpr"].jaxpr) + self._size(p["body_jaxpr"].jaxpr)
            elif name == "cond":
                size += sum(self._size(branch.jaxpr) for branch in p["branches"])
            elif name == "custom_linear_solve":
                size += self._size(p["jaxprs"].solve.jaxpr)
            elif name in _CALLS:
                size += self._size(_called(eqn).jaxpr)
            elif name not in _MOVED and name not in _UNCHANGED:
                size += self._size_within(eqn)
        return size

    def _size_within(self, eqn) -> int:
        """That of the trace that a primitive stands for, if it is such a one."""
        size = 0

        def read(closed: ClosedJaxpr, _: Sequence[Nodes], __: bool) -> list[Nodes]:
            nonlocal size
            size += self._size(closed.jaxpr)
            return [np.zeros(cast(Any, v.aval).shape, np.int64) for v in closed.jaxpr.outvars]

        self.expand(eqn, read, [np.zeros(v.aval.shape, np.int64) for v in eqn.invars])
        return size

    def _skipped(self, condition: int, branches: Sequence, of: bool, x: Sequence[Nodes]) -> list[Nodes]:
        """The results of a branch that is taken where the condition is `of`; else those of the other."""
        graph, others = self.graph, self.read(branches[not of], x)
        before, starts = self.region, _flat(others)
        holds = condition if of else graph.operation("not", (condition,), BOOL)
        with graph.branch(before) as loop:
            self.region, loop.condition = loop.region, holds
            # Nobody reads what is computed there for states that do not take it.
            known = {condition: np.bool_(of), holds: np.bool_(True)}
            graph.constants.update(known)
            ends = _flat(self.read(branches[of], x))
            for node in known:
                del graph.constants[node]
            self.region = before
        found, last = dict[tuple[int, int], int](), list[int]()
        for start, end in zip(starts, ends, strict=True):
            if start != end and (start, end) not in found:
                loop.carried.append((graph.parameter(loop, "carried", graph.dtypes[start]), start, end))
                which = len(loop.carried) - 1
                found[start, end] = graph.loop_result(loop, "last", which, 0, graph.dtypes[start])
            last.append(start if start == end else found[start, end])
        return _unflat(last, others)

    def _custom_linear_solve(self, eqn, *x: Nodes) -> list[Nodes]:
        """The solution by the caller's function; the others are for derivatives."""
        lengths, solve = eqn.params["const_lengths"], eqn.params["jaxprs"].solve
        first = lengths.matvec + lengths.vecmat
        return self.read(solve, [*x[first : first + lengths.solve], *x[sum(lengths) :]])

    def _dtype(self, x: Nodes) -> np.dtype:
        return self.graph.dtypes[int(x.flat[0])] if x.size else BOOL

    def _while(self, eqn, *x: Nodes) -> list[Nodes]:
        p = eqn.params
        n_condition, n_body = p["cond_nconsts"], p["body_nconsts"]
        of_condition, of_body = x[:n_condition], x[n_condition : n_condition + n_body]

        def turn(loop: Loop, carry: Sequence[Nodes], _: Sequence[Nodes]) -> tuple[list[Nodes], list[Nodes]]:
            (condition,) = self.read(p["cond_jaxpr"], [*of_condition, *carry])
            loop.condition = int(condition.ravel()[0])
            return self.read(p["body_jaxpr"], [*of_body, *carry]), []

        return self._looped(turn, None, list(x[n_condition + n_body :]), [])[0]

    def _scan(self, eqn, *x: Nodes) -> list[Nodes]:
        """Runs of rows in which known integers are the same are loops: where a boundary is, is such an integer."""
        p = eqn.params
        if "ft_in" in p:  # From JAX 0.11 on: (constants, what is carried, what is sliced).
            n_consts, n_carry, _ = map(len, p["ft_in"].unpack())
        else:
            n_consts, n_carry = p["num_consts"], p["num_carry"]
        length = p["length"]
        consts, carry, rows = x[:n_consts], list(x[n_consts : n_consts + n_carry]), x[n_consts + n_carry :]

        def turn(_: Loop | None, carry: Sequence[Nodes], row: Sequence[Nodes]) -> tuple[list[Nodes], list[Nodes]]:
            results = self.read(p["jaxpr"], [*consts, *carry, *row])
            return results[:n_carry], results[n_carry:]

        count, pieces = len(p["jaxpr"].jaxpr.outvars) - n_carry, list[list[Nodes]]()
        runs = self._alike_rows(rows, length)
        if p["reverse"]:
            runs = runs[::-1]
        size = self._size(p["jaxpr"].jaxpr)
        for first, last in runs:
            n = last - first
            most = self.most_unrolled if n <= MANY_TURNS else min(self.most_unrolled, MOST_OF_MANY)
            if n > 2 and (len(self.graph) + n * size > most or not rows and n * size > MOST_REPEATED):
                carry, stacked = self._looped(turn, n, carry, [y[first:last] for y in rows], p["reverse"])
            else:
                each: list[list[Nodes]] = []
                for k in range(first, last)[:: -1 if p["reverse"] else 1]:
                    carry, row = turn(None, carry, [y[k] for y in rows])
                    each.append(row)
                if p["reverse"]:
                    each.reverse()
                stacked = [np.stack([row[i] for row in each]) for i in range(count)]
            pieces.append(stacked)
        if p["reverse"]:
            pieces.reverse()
        if not pieces:
            return [*carry, *(self.lifted(np.zeros(v.aval.shape, v.aval.dtype)) for v in eqn.outvars[n_carry:])]
        return [*carry, *(np.concatenate([piece[i] for piece in pieces]) for i in range(count))]

    def _alike_rows(self, rows: Sequence[Nodes], length: int) -> list[tuple[int, int]]:
        """(first, last) of rows that follow each other and have the same known integers."""
        constants, dtypes = self.graph.constants, self.graph.dtypes
        known = [
            y.reshape((length, -1))
            for y in rows
            if y.size and dtypes[int(y.flat[0])].kind in "iub" and all(n in constants for n in y.ravel().tolist())
        ]
        # An index that counts rows is another one in each of them; it selects nothing but places in arrays.
        found, first = list[tuple[int, int]](), 0
        for k in range(1, length + 1):
            if k == length or any((y[k] != y[first]).any() for y in known):
                found.append((first, k))
                first = k
        return found

    def _looped(
        self,
        turn: Callable[[Loop, Sequence[Nodes], Sequence[Nodes]], tuple[list[Nodes], list[Nodes]]],
        length: int | None,
        carry: list[Nodes],
        rows: Sequence[Nodes],
        is_reverse: bool = False,
    ) -> tuple[list[Nodes], list[Nodes]]:
        """(what a loop leaves of its carry, what its turns stack). turn(loop, carry, row) -> (carry, stacked).

        What no turn changes is no parameter of the loop. It is found out by a first trial.
        """
        graph, flat = self.graph, _flat(carry)
        fixed = [False] * len(flat)
        while True:
            loop = graph.begun(self.region, length, is_reverse)
            outer, self.region = self.region, loop.region
            parameters = [
                x if is_fixed else graph.parameter(loop, "carried", graph.dtypes[x])
                for x, is_fixed in zip(flat, fixed, strict=True)
            ]
            of_rows = [self._of_row(loop, y) for y in rows]
            new_carry, stacked = turn(loop, _unflat(parameters, carry), of_rows)
            self.region, new = outer, _flat(new_carry)
            again = [y in (x, p) for x, p, y in zip(flat, parameters, new, strict=True)]
            if again == fixed:
                break
            fixed = again
        moving = [k for k, is_fixed in enumerate(fixed) if not is_fixed]
        loop.carried = [(parameters[k], flat[k], new[k]) for k in moving]
        last = list(flat)
        for which, k in enumerate(moving):
            last[k] = graph.loop_result(loop, "last", which, 0, graph.dtypes[flat[k]])
        return _unflat(last, carry), [self._of_all_turns(loop, y) for y in stacked]

    def _of_row(self, loop: Loop, rows: Nodes) -> Nodes:
        """The parameters that stand for one row: those that are the same in all rows stay what they are."""
        graph, n = self.graph, len(rows)
        columns = rows.reshape((n, -1)).T.tolist()
        known: dict[tuple[int, ...], int] = {nodes: p for p, nodes in loop.rows.items()}
        found: list[int] = []
        for column in map(tuple, columns):
            if column.count(column[0]) == n:
                found.append(column[0])
                continue
            if column not in known:
                known[column] = graph.parameter(loop, "row", graph.dtypes[column[0]])
                loop.rows[known[column]] = column
            found.append(known[column])
        return np.array(found, np.int64).reshape(rows.shape[1:])

    def _of_all_turns(self, loop: Loop, x: Nodes) -> Nodes:
        graph, n = self.graph, cast(int, loop.length)
        columns: list[list[int]] = []
        for node in x.ravel().tolist():
            if not graph.is_inside(graph.regions[node], loop.region):
                columns.append([node] * n)
                continue
            if node in loop.stacked:
                which = loop.stacked.index(node)
            else:
                which = len(loop.stacked)
                loop.stacked.append(node)
            columns.append([])
            for row in range(n):
                key = "stacked", loop.region, which, row
                if key not in graph._known:
                    graph._known[key] = graph.loop_result(loop, "stacked", which, row, graph.dtypes[node])
                columns[-1].append(graph._known[key])
        return np.array(columns, np.int64).reshape((-1, n)).T.reshape((n, *x.shape))


class _WindowAxes(NamedTuple):
    """Of an array that is gathered from, or scattered to: axes that windows do not keep, axes that indices are of, and
    axes that are batches, with those of the indices that these go with."""

    dropped: Sequence[int]
    of_indices: Sequence[int]
    batching: Sequence[int]
    of_batching: Sequence[int]


def _called(eqn) -> ClosedJaxpr:
    """The trace that a call runs."""
    inner = next(eqn.params[k] for k in ("jaxpr", "call_jaxpr") if k in eqn.params)
    return inner if isinstance(inner, ClosedJaxpr) else ClosedJaxpr(inner, ())


def _flat(arrays: Iterable[Nodes]) -> list[int]:
    return [node for x in arrays for node in x.ravel().tolist()]


def _unflat(nodes: Sequence[int], like: Sequence[Nodes]) -> list[Nodes]:
    ends = list(itertools.accumulate((x.size for x in like), initial=0))
    both = zip(itertools.pairwise(ends), like, strict=True)
    return [np.array(nodes[a:b], np.int64).reshape(x.shape) for (a, b), x in both]


# -- evaluation with NumPy ---------------------------------------------------------------------------------------------


class _Evaluation(NamedTuple):
    graph: Graph
    arguments: Sequence[np.ndarray]
    known: dict[int, Any]


def run(graph: Graph, *arguments: np.ndarray) -> list[np.ndarray]:
    """The results (B, n) of a graph, of arrays (B, n), or (1, n) where all states share one; by NumPy.

    Slow, and right by inspection: what compilers make of graphs is compared with it.
    """
    size = max((len(x) for x in arguments), default=1)
    values = _Evaluation(graph, [np.broadcast_to(x.reshape((len(x), -1)), (size, x[0].size)) for x in arguments], {})
    with np.errstate(all="ignore"):
        found = [[_value(values, n) for n in x.ravel().tolist()] for x in graph.results]
    return [np.stack([np.broadcast_to(x, (size,)) for x in row], 1) if row else np.empty((size, 0)) for row in found]


def _value(values: _Evaluation, node: int):
    """The value of a node: an array (B,), or a scalar. Its operands come first, without recursion."""
    graph, known, waiting = values.graph, values.known, [node]
    while waiting:
        n = waiting[-1]
        if n in known:
            waiting.pop()
            continue
        missing = [x for x in graph.operands[n] if x not in known]
        if missing:
            waiting += missing
            continue
        known[n] = _evaluated(values, n)
        waiting.pop()
    return known[node]


def _evaluated(values: _Evaluation, node: int):
    graph, name = values.graph, values.graph.operations[node]
    if name == "constant":
        return graph.constants[node]
    if name == "load":
        argument, place = graph.details[node]
        return values.arguments[argument][:, place]
    if name in ("last", "stacked"):
        loop, which, row = graph.details[node]
        return _results_of_loop(values, graph.loops[loop])[name][which if name == "last" else (which, row)]
    if name == "lookup":
        table, places = graph.details[node]
        rows = [_value(values, n) for n in graph.tables[table]]
        return looked_up(rows, values.known[graph.operands[node][0]], places)
    return EVALUATE[name](graph.dtypes[node], *(values.known[x] for x in graph.operands[node]))


def looked_up(table: Sequence[Any], index, places: int):
    """What a table has so many places behind indices; both are numbers or arrays (B,)."""
    index, *rows = np.broadcast_arrays(np.asarray(index, np.int64), *table)
    return np.take_along_axis(np.stack(rows), index[None] + places, 0)[0]


def _results_of_loop(values: _Evaluation, loop: Loop) -> dict[str, dict[Any, Any]]:
    graph, known = values.graph, values.known
    key = -1 - loop.region
    if key in known:
        return known[key]
    carry = [_value(values, first) for _, first, _ in loop.carried]
    rows = {p: [_value(values, n) for n in nodes] for p, nodes in loop.rows.items()}
    stacked: dict[Any, Any] = {}
    turns = itertools.count() if loop.length is None else range(loop.length)[:: -1 if loop.is_reverse else 1]
    for k in turns:
        outside = {n: x for n, x in known.items() if n < 0 or not graph.is_inside(graph.regions[n], loop.region)}
        inner = values._replace(known=outside)
        inner.known.update(zip((p for p, _, _ in loop.carried), carry, strict=True))
        inner.known.update({p: x[k] for p, x in rows.items()})
        goes_on = True if loop.length is not None else _value(inner, loop.condition)
        if not np.any(goes_on) or loop.is_branch and k:
            break
        new = [_value(inner, y) for _, _, y in loop.carried]
        carry = [np.where(goes_on, y, x) if loop.length is None else y for x, y in zip(carry, new, strict=True)]
        stacked |= {(i, k): _value(inner, y) for i, y in enumerate(loop.stacked)}
    known[key] = {"last": dict(enumerate(carry)), "stacked": stacked}
    return known[key]
