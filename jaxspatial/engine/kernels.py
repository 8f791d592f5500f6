"""Runs traces on CPUs with one kernel for each call that is not inlined.

XLA CPU makes a kernel of every result of a graph, and each computes again what the results share. A variadic reduction
is one kernel with as many results as operands, whatever its body computes. So a call of elementwise operations becomes
a reduction over an axis of two equal items, whose body looks at the item and not at what was reduced before: the
compiler moves it out of the loop over the two, and vectorises over the states. A reduction writes as many arrays as it
reads. So a call with one result becomes a map, which writes this result alone.

Numbers that are known, and differ only from row to row of a loop or from chain to chain, are tables in the body. As
operands each would be a result, too, over all states.

A product is rounded on its own because -0 is added to it, of which the compiler knows nothing: as one fma that is the
rounded product, to the last bit, and the sum that follows finds no product. The -0 is an operand, as XLA knows no other
way into the body.

Of few states, calls that read each other's results are one kernel, too: see `_with_merged_calls`.

Every operation in the body of a reduction has a buffer of its own, which XLA CPU allocates whenever the program is
called: 0.13 us for each. So what leaves no trace in a result is left out.
"""

import collections
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import ShapedArray, Tracer
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal, Primitive, jaxpr_as_fun
from jax.extend.mlir.dialects import stablehlo
from jax.interpreters import mlir
from jax.interpreters import partial_eval as pe

from jaxspatial.numerics.errorfree.barrier import hidden_zero, is_no_reassociation, joined, minus_zero, no_reassociation
from jaxspatial.numerics.errorfree.primitives import (
    CALL,
    CALLS,
    STEP,
    apart,
    called,
    compiled,
    lower_fun,
    n_devices,
    not_inlined,
)

# A kernel of more operations is compiled as the calls that it consists of: thousands would compile for minutes.
# Known numbers in more rows are operands.
MOST_OPERATIONS, MOST_ROWS = 1300, 256
Shape = tuple[int, ...]
# Whether XLA makes one function of a loop, and for how many states that is slower.
_HAS_LOOPS_AS_FUNCTIONS, MANY = jax.__version_info__ >= (0, 11), 32
# Of how many states at most calls are merged.
MOST_MERGED = 128

# What keeps the place of each number, and operations number by number.
_MOVES = {"broadcast_in_dim", "reshape", "squeeze", "copy"}
# What takes a part of an array, or the whole of it.
_TAKES = {
    "slice", "squeeze", "unstack", "reshape", "broadcast_in_dim", "transpose", "jaxspatial_barrier",
    "jaxspatial_unstack",
}  # fmt: skip
_ELEMENTWISE = {
    "abs", "add", "add_any", "and", "bitcast_convert_type", "ceil", "clamp", "convert_element_type", "div", "eq",
    "floor", "ge", "gt", "integer_pow", "is_finite", "le", "lt", "max", "min", "mul", "ne", "neg", "not", "or",
    "reduce_precision", "rem", "round", "rsqrt", "select_n", "shift_left", "shift_right_arithmetic",
    "shift_right_logical", "sign", "sqrt", "square", "stop_gradient", "sub", "xor",
}  # fmt: skip
# How many operations of the processor each is.
_OWN = {"jaxspatial_product", "jaxspatial_root", "jaxspatial_kept", "jaxspatial_barrier"}
# Sums that no compiler rearranges, see `barrier`. Each counts as a sum and what holds it.
_SUMS = {"jaxspatial_sum": lax.add, "jaxspatial_difference": lax.sub}
_SIZES = dict.fromkeys(_ELEMENTWISE | _OWN, 1) | dict.fromkeys(_SUMS, 2) | {"jaxspatial_quotient": 3}


class Table(NamedTuple):
    """Known numbers of several rows, (rows, W, 1), and the row that is meant: an index, or None for the only one."""

    numbers: np.ndarray
    row: Any

    @property
    def shape(self) -> Shape:
        return self.numbers.shape[1:]

    @property
    def size(self) -> int:
        return self.numbers.size

    @property
    def dtype(self) -> np.dtype:
        return self.numbers.dtype

    def array(self) -> jax.Array:
        numbers = jnp.asarray(self.numbers)
        return numbers[0] if self.row is None else _row(numbers, self.row)


class Loops(NamedTuple):
    """How the loops of a program run.

    rows_per_turn: how many rows a turn of a loop over rows takes. is_large: the loop around the program is kept from
    becoming a function, even with one state. It then runs a quarter longer, and compiles much sooner, because LLVM's
    time grows faster than the size of a function. is_split: the states are on several devices. No single number of
    theirs is read then, for one device would have to send it to the others.
    """

    rows_per_turn: int
    is_large: bool = False
    is_split: bool = False


class Common(NamedTuple):
    """What all kernels of a program share. zero: a hidden one. has_pinned_loops: whether loops are kept from becoming
    functions, see `_in_its_loop`. merges_calls: see `_with_merged_calls`.

    The zero is made once, in front of all loops that are not kept from becoming functions. Before JAX 0.11 XLA compiles
    small loops as one function, by an option (`xla_cpu_small_while_loop_byte_threshold`), but not loops in which the
    index of the replica is asked for.
    """

    loops: Loops
    zero: jax.Array
    has_pinned_loops: bool
    merges_calls: bool


def run(closed: ClosedJaxpr, loops: Loops, *arrays: jax.Array) -> list[jax.Array]:
    """The results of a trace."""
    with jax.enable_x64(True):
        n = max((x.shape[0] for x in arrays if x.ndim), default=1)
        is_many = n >= MANY
        is_pinned = _HAS_LOOPS_AS_FUNCTIONS and (is_many or loops.is_large)
        common = Common(loops, hidden_zero(arrays[0]), is_pinned, merges_calls=n <= MOST_MERGED)
        zero = _in_its_loop(common, *(x for x in arrays if x.shape[:1] == (n,)), are_states=True)
        common = common._replace(zero=zero, has_pinned_loops=common.has_pinned_loops and is_many)
        return [_array(x) for x in _evaluated(closed.jaxpr, closed.consts, arrays, common)]


def _array(x: Any) -> jax.Array:
    x = _whole(x)
    return x.array() if isinstance(x, Table) else x


class Moved(NamedTuple):
    """An array that may have been taken from another one, `before`, by an operation that moves numbers.

    A call that is not inlined gets the other one, and takes its part inside: no copy is made, and no kernel for it.
    operation: an equation of the trace, and which of its results; None if there was none. of_pieces: whether the array
    is a concatenation, or was made of one outside of kernels: the compiler may not have stored it.
    """

    array: jax.Array
    before: Any = None
    operation: Any = None
    of_pieces: bool = False

    @property
    def source(self) -> tuple[jax.Array, list[Any]]:
        """(the array that it is taken from, the operations), as far back as states are the last axis."""
        found, operations = (self.array, list[Any]()), list[Any]()
        x: Any = self
        while isinstance(x, Moved) and x.operation is not None:
            operations.insert(0, x.operation)
            x = x.before
            if (array := _whole(x)).shape[-1:] == self.array.shape[-1:]:
                found = array, list(operations)
        return found


class Stack:
    """Rows that are stored one by one. `array`: all of them, as a concatenation."""

    def __init__(self, rows: Sequence[jax.Array]):
        self.rows = rows

    @functools.cached_property
    def array(self) -> jax.Array:
        return jnp.stack(self.rows)


def _whole(x: Any) -> Any:
    return x.array if isinstance(x, (Moved, Stack)) else x


# -- a trace, operation by operation ----------------------------------------------------------------------------------


def _evaluated(jaxpr: Any, consts: Sequence[Any], arguments: Sequence[Any], common: Common) -> list[Any]:
    """The results, where a Table may stand for a known number, and a Moved or a Stack for an array."""
    values = {v: _known(c) for v, c in zip(jaxpr.constvars, consts, strict=True)}
    values |= dict(zip(jaxpr.invars, arguments, strict=True))
    for eqn in _with_merged_calls(jaxpr, values) if common.merges_calls else jaxpr.eqns:
        inputs = [x.val if isinstance(x, Literal) else values[x] for x in eqn.invars]
        if isinstance(eqn, Jaxpr):
            results = _run_as_kernels(ClosedJaxpr(eqn, []), inputs, is_call=True, common=common)
        elif (name := eqn.primitive.name) == "jit" and eqn.params["name"] in (CALL, STEP):
            results = _called(eqn, inputs, common)
        elif name in CALLS:
            inner = called(eqn)
            results = _evaluated(inner.jaxpr, inner.consts, inputs, common)
        elif name == "scan":
            results = _scanned(eqn, inputs, common)
        elif name == "while":
            results = _repeated(eqn, list(map(_array, inputs)), common)
        else:
            results = _known_moved(eqn, list(map(_whole, inputs))) or _bound(eqn, list(map(_array, inputs)), common)
            results = [_result(eqn, k, inputs, y) for k, y in enumerate(results)]
        values |= dict(zip(eqn.outvars, results, strict=True))
    return [x.val if isinstance(x, Literal) else values[x] for x in jaxpr.outvars]


def _result(eqn: Any, k: int, inputs: Sequence[Any], result: Any) -> Any:
    """Result k of an operation, as a Moved where it only moves numbers, or is made of pieces."""
    of_pieces = eqn.primitive.name == "concatenate" or any(map(_is_of_pieces, inputs))
    is_taken = eqn.primitive.name in _TAKES and isinstance(result, Tracer) and result.size <= np.size(_whole(inputs[0]))
    if is_taken:
        return Moved(result, inputs[0], (eqn, k), of_pieces)
    return Moved(result, of_pieces=True) if of_pieces else result


def _is_of_pieces(x: Any) -> bool:
    return isinstance(x, Stack) or (isinstance(x, Moved) and x.of_pieces)


def _bound(eqn: Any, inputs: Sequence[Any], common: Common) -> list[Any]:
    if eqn.primitive.name == "jaxspatial_barrier":
        return [joined(inputs[0], common.zero)]
    results = eqn.primitive.bind(*inputs, **eqn.params)
    return list(results) if eqn.primitive.multiple_results else [results]


def _known(x: Any) -> Any:
    """A constant of the trace, as a Table where it is a number of each chain."""
    is_known = not isinstance(x, Tracer) and _is_of_chains(np.shape(x))
    return Table(np.asarray(x)[None], None) if is_known else x


def _is_of_chains(shape: Shape) -> bool:
    return len(shape) == 2 and shape[1] == 1 and shape[0] <= MOST_ROWS


def _known_moved(eqn: Any, inputs: Sequence[Any]) -> list[Any] | None:
    """The result of an operation that only moves a known number of each chain, as a Table; else None."""
    shape = eqn.outvars[0].aval.shape
    if eqn.primitive.name not in ("squeeze", "reshape", "broadcast_in_dim") or not _is_of_chains(shape):
        return None
    (x,) = inputs
    if isinstance(x, Tracer) or not np.ndim(x) or math.prod(x.shape) != shape[0]:
        return None
    return [Table(x.numbers.reshape((-1, *shape)), x.row) if isinstance(x, Table) else _known(np.reshape(x, shape))]


def _scanned(eqn: Any, inputs: Sequence[Any], common: Common) -> list[Any]:
    """A loop over rows, with kernels for the calls in it, and known numbers of its rows as Tables.

    Several rows per turn are calls of one function, which gets the index of its row as an operand: equal kernels are
    compiled once. So the indices are hidden where the compiler could know them.
    """
    n_consts, n_carry = _constants_and_carried(eqn)
    length, is_reverse, body = (eqn.params[k] for k in ("length", "reverse", "jaxpr"))
    n = n_consts + n_carry
    inputs = [x if isinstance(x, Stack) else _whole(x) for x in inputs]
    consts, carry = list(map(_array, inputs[:n_consts])), list(map(_array, inputs[n_consts:n]))
    tables = {k for k, x in enumerate(inputs) if k >= n and _is_table_of_rows(x)}
    rows = [x for k, x in enumerate(inputs) if k >= n and k not in tables]

    def row(zero: jax.Array, index: jax.Array, consts: Any, carry: Any, of_row: Any) -> tuple[list[Any], list[Any]]:
        left = iter(of_row)
        each = (Table(np.asarray(inputs[k]), index) if k in tables else next(left) for k in range(n, len(inputs)))
        arguments = [*consts, *carry, *each]
        results = list(map(_array, _evaluated(body.jaxpr, body.consts, arguments, common._replace(zero=zero))))
        return results[:n_carry], results[n_carry:]

    per_turn = common.loops.rows_per_turn if _is_of_kernels(body.jaxpr) else 1
    if per_turn == 1:
        xs = list(map(_array, rows)), lax.iota(np.uint32, length)
        carry, stacked = lax.scan(
            lambda carry, x: row(_in_its_loop(common, x[1]), x[1], consts, carry, x[0]),
            carry,
            xs,
            reverse=is_reverse,
        )
        return [*carry, *stacked]
    is_unrolled = length < 2 * per_turn
    rows = [x if is_unrolled and isinstance(x, Stack) else _array(x) for x in rows]

    @apart
    def one(zero: jax.Array, index: jax.Array, consts: Any, carry: Any, of_row: Any) -> tuple[list[Any], list[Any]]:
        own = [x if isinstance(y, Stack) else _row(x, index) for x, y in zip(of_row, rows, strict=True)]
        return row(zero, index, consts, carry, own)

    def index_of(k: Any) -> Any:
        return np.uint32(length - 1) - k if is_reverse else k

    if is_unrolled:
        stacked: list[Any] = [None] * length
        # Not the hidden zero itself: a kernel that gets one array twice is another kernel.
        first = common.zero << np.uint32(1)
        for k in map(index_of, range(length)):
            of_row = [x.rows[k] if isinstance(x, Stack) else x for x in rows]
            carry, stacked[k] = one(common.zero, first + np.uint32(k), consts, carry, of_row)
        return [*carry, *map(Stack, zip(*stacked, strict=True))]

    def turn(state: Any, first: jax.Array, count: int = per_turn) -> tuple[Any, None]:
        (carry, stacked), zero = state, _in_its_loop(common, first)
        for k in range(count):
            index = index_of(first + np.uint32(k))
            carry, results = one(zero, index, consts, carry, rows)
            stacked = [lax.dynamic_update_index_in_dim(x, y, index, 0) for x, y in zip(stacked, results, strict=True)]
        return (carry, stacked), None

    avals = [cast(Any, v.aval) for v in body.jaxpr.outvars[n_carry:]]
    state = carry, [lax.full((length, *a.shape), 0, a.dtype) for a in avals]
    n_turns, left = divmod(length, per_turn)
    state, _ = lax.scan(turn, state, lax.iota(np.uint32, n_turns) * np.uint32(per_turn))
    state, _ = turn(state, common.zero + np.uint32(n_turns * per_turn), left)
    return [*state[0], *state[1]]


def _in_its_loop(common: Common, *arrays: jax.Array, are_states: bool = False) -> jax.Array:
    """The hidden zero, which the compiler finds out anew in every turn of a loop.

    arrays: the largest of them differs from turn to turn. are_states: whether they are split where states are. From
    JAX 0.11 on XLA makes one function of a loop, in which no kernel is vectorised: for many states that is three times
    as slow. It does not where something is sorted.
    """
    if not common.has_pinned_loops or (are_states and common.loops.is_split):
        return common.zero
    x = max((x for x in arrays if x.dtype != bool), key=lambda x: x.size)
    x = lax.reshape(lax.slice(x, (0,) * x.ndim, (1,) * x.ndim), (1,))
    integer = np.dtype(f"uint{8 * x.dtype.itemsize}")
    bits = lax.convert_element_type(lax.bitcast_convert_type(x, integer), np.uint32) >> np.uint32(1)
    pair = lax.concatenate([bits, bits >> np.uint32(1)], 0)
    return common.zero | lax.squeeze(lax.slice(lax.sort(pair), (0,), (1,)) >> np.uint32(31), (0,))


def _constants_and_carried(eqn: Any) -> tuple[int, int]:
    """How many arguments of a loop are constants, and how many are carried from turn to turn."""
    if "ft_in" in eqn.params:  # From JAX 0.11 on: (constants, what is carried, what is sliced).
        consts, carried, _ = eqn.params["ft_in"].unpack()
        return len(consts), len(carried)
    return eqn.params["num_consts"], eqn.params["num_carry"]


def _row(x: jax.Array, index: jax.Array) -> jax.Array:
    """x[index]. `lax.dynamic_index_in_dim` is a call of its own, which a kernel in a call would not take in."""
    start = (index, *[np.uint32(0)] * (x.ndim - 1))
    return lax.squeeze(lax.dynamic_slice(x, start, (1, *x.shape[1:])), (0,))


def _repeated(eqn: Any, inputs: Sequence[Any], common: Common) -> list[Any]:
    """A loop until a condition, with kernels for the calls in it."""
    n_of_cond, n_of_body = eqn.params["cond_nconsts"], eqn.params["body_nconsts"]
    of_cond, of_body = inputs[:n_of_cond], inputs[n_of_cond : n_of_cond + n_of_body]

    def run_of(name: str, consts: Sequence[Any], carry: Sequence[Any]) -> list[Any]:
        inner, own = eqn.params[name], common._replace(zero=_in_its_loop(common, *carry, are_states=True))
        return list(map(_array, _evaluated(inner.jaxpr, inner.consts, [*consts, *carry], own)))

    return lax.while_loop(
        lambda carry: run_of("cond_jaxpr", of_cond, carry)[0],
        lambda carry: run_of("body_jaxpr", of_body, carry),
        list(inputs[n_of_cond + n_of_body :]),
    )


def _is_of_kernels(jaxpr: Any) -> bool:
    """Whether the steps of a loop are kernels: others would compute again, for the second row, what the two share."""
    for eqn in jaxpr.eqns:
        if eqn.primitive.name == "jit" and eqn.params["name"] == STEP:
            if _kernels(called(eqn), [v.aval for v in eqn.invars]) is None:
                return False
        elif eqn.primitive.name in CALLS and not _is_of_kernels(called(eqn).jaxpr):
            return False
    return True


def _is_table_of_rows(x: Any) -> bool:
    is_known = not isinstance(x, (Tracer, Table, Stack))
    return is_known and np.ndim(x) == 3 and np.shape(x)[-1] == 1 and np.size(x) <= MOST_ROWS


# -- calls ------------------------------------------------------------------------------------------------------------


def _called(eqn: Any, inputs: Sequence[Any], common: Common) -> list[Any]:
    """A call as kernels. Its sums, and what is computed from them, come after the kernels."""
    inner, is_call = called(eqn), eqn.params["name"] == CALL
    inputs = [
        x if isinstance(x, (Moved, Stack)) or hasattr(x, "shape") else np.asarray(x, v.aval.dtype)
        for x, v in zip(inputs, eqn.invars, strict=True)
    ]
    first, last = _before_and_after_sums(inner)
    results = _run_as_kernels(first, inputs, is_call, common)
    return results if last is None else _evaluated(last.jaxpr, last.consts, results, common)


def _before_and_after_sums(inner: ClosedJaxpr) -> tuple[ClosedJaxpr, ClosedJaxpr | None]:
    """A trace in two parts. The second begins with the sums and takes the results of the first; None without sums."""
    early, late, depend = list[Any](), list[Any](), set[Any]()
    for eqn in inner.jaxpr.eqns:
        variables = {x for x in eqn.invars if not isinstance(x, Literal)}
        if eqn.primitive.name == "reduce_sum" or variables & depend:
            late.append(eqn)
            depend.update(eqn.outvars)
        else:
            early.append(eqn)
    if not late:
        return inner, None
    read = [*(x for eqn in late for x in eqn.invars), *inner.jaxpr.outvars]
    between = list(dict.fromkeys(x for x in read if not isinstance(x, Literal) and x not in depend))
    unnamed = inner.jaxpr.debug_info.with_unknown_names()
    first = inner.jaxpr.replace(eqns=early, outvars=between, debug_info=unnamed)
    last = inner.jaxpr.replace(eqns=late, invars=between, constvars=[], debug_info=unnamed)
    return ClosedJaxpr(first, inner.consts), ClosedJaxpr(last, [])


def _run_as_kernels(inner: ClosedJaxpr, inputs: Sequence[Any], is_call: bool, common: Common) -> list[Any]:
    """A trace as kernels, one for all results of one shape; or, if it is none, with kernels for the calls in it.

    What only takes parts of arrays is no kernel.
    """
    if all(eqn.primitive.name in _TAKES and not _repeats(eqn) for eqn in inner.jaxpr.eqns):
        return _evaluated(inner.jaxpr, inner.consts, inputs, common)
    kernels = _kernels(inner, list(map(_whole, inputs)))
    # A concatenation inside a kernel, where each number asks which piece it is of, would not be vectorised.
    is_apart = any(map(_is_of_pieces, inputs)) if kernels else is_call
    if not is_apart:
        inputs = list(map(_whole, inputs))
    taken = [x.source if isinstance(x, Moved) else (_whole(x), []) for x in inputs]
    sources = {id(x): x for x, _ in taken if not isinstance(x, Table)}

    def call(zero: jax.Array, *arrays: jax.Array) -> list[jax.Array]:
        of_source = dict(zip(sources, arrays, strict=True))
        inside, known = common._replace(zero=zero), dict[Any, list[Any]]()
        each = [_taken(of_source.get(id(x), x), operations, inside, known) for x, operations in taken]
        if kernels is None:
            return [_array(x) for x in _evaluated(inner.jaxpr, inner.consts, each, inside)]
        results: dict[int, jax.Array] = {}
        for kernel in kernels:
            results |= kernel.run(zero, [x for x, yes in zip(each, kernel.reads, strict=True) if yes])
        return [results[k] for k in range(len(results))]

    data = list(map(jnp.asarray, sources.values()))
    return not_inlined(call, common.zero, *data) if is_apart and data else call(common.zero, *data)


def _repeats(eqn: Any) -> bool:
    """Whether the result has each number several times: one kernel writes all such results of a call."""
    return eqn.outvars[0].aval.size > eqn.invars[0].aval.size


def _taken(x: Any, operations: Sequence[Any], common: Common, known: dict[Any, list[Any]]) -> Any:
    """x after the operations of a Moved. known: the results of operations, for others that begin with the same ones."""
    for eqn, k in operations:
        key = id(x), id(eqn)
        if key not in known:
            known[key] = _bound(eqn, [x], common)
        x = known[key][k]
    return x


class Kernel(NamedTuple):
    """The results of one shape. places: which results of the call. reads: which of its arguments they need."""

    trace: ClosedJaxpr
    shape: Shape
    places: tuple[int, ...]
    reads: tuple[bool, ...]

    def run(self, zero: jax.Array, arguments: Sequence[Any]) -> dict[int, jax.Array]:
        return dict(zip(self.places, _one_kernel(self.trace, zero, arguments, self.shape), strict=True))


def _kernels(inner: ClosedJaxpr, arguments: Sequence[Any]) -> list[Kernel] | None:
    """None if the trace is too long, or does more than operations number by number, or all numbers are known."""
    by_shape = collections.defaultdict[Shape, list[int]](list)
    for k, a in enumerate(inner.out_avals):
        by_shape[a.shape].append(k)
    kernels = list[Kernel]()
    for shape, places in by_shape.items():
        wanted = [k in places for k in range(len(inner.jaxpr.outvars))]
        jaxpr, reads = pe.dce_jaxpr(inner.jaxpr, wanted)
        shapes = [x.shape for x, yes in zip(arguments, reads, strict=True) if yes]
        if not all(_fits(s, shape) for s in shapes) or not 0 <= _count(jaxpr, shape) <= MOST_OPERATIONS:
            return None
        if all(isinstance(x, Table) or not yes for x, yes in zip(arguments, reads, strict=True)):
            return None
        kernels.append(Kernel(ClosedJaxpr(jaxpr, inner.consts), shape, tuple(places), tuple(reads)))
    return kernels


def _fits(shape: Shape, whole: Shape) -> bool:
    """Whether an array broadcasts to the whole, whose last axes are its own."""
    both = zip(reversed(shape), reversed(whole), strict=False)
    return len(shape) <= len(whole) and all(a in (1, b) for a, b in both)


def _count(jaxpr: Any, shape: Shape) -> int:
    """How many operations number by number a trace has; a negative number if it has others."""
    if any(math.prod(v.aval.shape) > 1 for v in jaxpr.constvars):
        return -1
    count = 0
    for eqn in jaxpr.eqns:
        name = eqn.primitive.name
        if name in CALLS:
            more = _count(called(eqn).jaxpr, shape)
        else:
            more = 0 if name in _MOVES and _keeps_places(eqn) else _SIZES.get(name, -1)
        if more < 0 or not all(_fits(v.aval.shape, shape) for v in eqn.outvars):
            return -1
        count += more
    return count


def _keeps_places(eqn: Any) -> bool:
    """Whether each number of the result is that of the argument at the same place, counted from the last axis."""
    before, after = eqn.invars[0].aval.shape, eqn.outvars[0].aval.shape
    if eqn.primitive.name == "broadcast_in_dim":
        return tuple(eqn.params["broadcast_dimensions"]) == tuple(range(len(after) - len(before), len(after)))
    longer, shorter = sorted((before, after), key=len, reverse=True)
    return longer == (*[1] * (len(longer) - len(shorter)), *shorter)


# -- merged calls -----------------------------------------------------------------------------------------------------


class Unit:
    """Equations of a trace that run together: one, or calls that are merged.

    shape: that of all results, of calls that may be a kernel; else None. size: how many operations they have. above:
    the units that must run before.
    """

    def __init__(self, shape: Shape | None):
        self.shape, self.size = shape, 0
        self.eqns, self.above = list[Any](), set["Unit"]()


def _with_merged_calls(jaxpr: Any, values: dict[Any, Any]) -> Sequence[Any]:
    """The equations of a trace, where one trace stands for calls of one shape that read results of each other.

    Kernels of their own would write arrays for each other. Each array costs time when a kernel starts and when it is
    compiled. With hundreds of states that is little, and merged kernels were up to 4 % slower. values: of constants and
    arguments.
    """
    units, unit_of = list[Unit](), dict[Any, Unit]()
    known = {v for v, x in values.items() if isinstance(x, Table)}
    for eqn in jaxpr.eqns:
        read = dict.fromkeys(x for x in eqn.invars if not isinstance(x, Literal)).keys()
        if read <= known and eqn.primitive.name in _TAKES:
            known.update(eqn.outvars)
        shape, size = (None, 0) if read <= known else _shape_and_size(eqn)
        before = dict.fromkeys(unit_of[x] for x in read if x in unit_of)
        # No call joins a unit if it also reads what others make of the unit's results: they must run in between.
        joinable = (
            u
            for u in (before if shape is not None else ())
            if u.shape == shape and u.size + size <= MOST_OPERATIONS and not any(u in w.above for w in before)
        )
        unit = next(joinable, None)
        if unit is None:
            units.append(unit := Unit(shape))
        unit.eqns.append(eqn)
        unit.size += size
        above = set(before).union(*(w.above for w in before)) - {unit}
        for w in units if len(unit.eqns) > 1 else [unit]:
            if w is unit or unit in w.above:
                w.above |= above
        unit_of |= dict.fromkeys(eqn.outvars, unit)
    if len(units) == len(jaxpr.eqns):
        return jaxpr.eqns
    # What must run before a unit has fewer units above it.
    order = sorted(units, key=lambda u: len(u.above))
    return [_merged(jaxpr, u.eqns) if len(u.eqns) > 1 else u.eqns[0] for u in order]


def _shape_and_size(eqn: Any) -> tuple[Shape | None, int]:
    """The shape of all results of a call that may be a kernel, and how many operations it has; else (None, 0)."""
    if eqn.primitive.name != "jit" or eqn.params["name"] != CALL:
        return None, 0
    inner = called(eqn)
    shapes = {a.shape for a in inner.out_avals}
    shape = shapes.pop() if len(shapes) == 1 else None
    if shape is None or not all(_fits(v.aval.shape, shape) for v in eqn.invars):
        return None, 0
    size = _count(inner.jaxpr, shape)
    return (shape, size) if size >= 0 else (None, 0)


def _merged(jaxpr: Any, eqns: list[Any]) -> Any:
    """These calls of a trace as one. Its results are what others read of theirs."""
    own, made = set(map(id, eqns)), {v for e in eqns for v in e.outvars}
    read = [x for e in jaxpr.eqns if id(e) not in own for x in e.invars]
    wanted = {x for x in [*read, *jaxpr.outvars] if not isinstance(x, Literal)}
    invars = dict.fromkeys(x for e in eqns for x in e.invars if not isinstance(x, Literal) and x not in made)
    outvars = [v for e in eqns for v in e.outvars if v in wanted]
    unnamed = jaxpr.debug_info.with_unknown_names()
    return jaxpr.replace(eqns=eqns, invars=[*invars], outvars=outvars, constvars=[], debug_info=unnamed)


# -- one kernel -------------------------------------------------------------------------------------------------------


def _one_kernel(trace: ClosedJaxpr, zero: jax.Array, arguments: Sequence[Any], shape: Shape) -> list[jax.Array]:
    """The results of a trace, all of this shape. zero: a hidden one."""
    tables = [x for x in arguments if isinstance(x, Table) and x.size > 1]
    rows = max((len(x.numbers) for x in tables), default=1)
    arrays = [_hidden(zero, tables, shape), *(jnp.asarray(x) for x in arguments if not isinstance(x, Table))]
    kinds = [cast(Any, a).dtype for a in trace.out_avals]
    # The reduction keeps `computed`, which must not keep what the caller has traced.
    looked_up = [x._replace(row=None) if isinstance(x, Table) else None for x in arguments]

    def computed(hidden: jax.Array, *items: jax.Array) -> list[jax.Array]:
        """The results, of one number of every array."""
        index, zero, left = hidden & np.uint32(2**31 - 1), hidden >> np.uint32(31), iter(items)
        each = [next(left) if x is None else _looked_up(x, rows, shape, index) for x in looked_up]
        results = _Scalars(zero).results(trace.jaxpr, trace.consts, each)
        return [lax.convert_element_type(y, d) for y, d in zip(results, kinds, strict=True)]

    return (_mapped if len(kinds) == 1 else _reduced)(computed, arrays, kinds, shape)


def _mapped(
    computed: Callable[..., list[jax.Array]], arrays: Sequence[jax.Array], kinds: Sequence[np.dtype], shape: Shape
) -> list[jax.Array]:
    """The one result, as a map."""
    whole = [lax.broadcast_in_dim(x, shape, range(len(shape) - x.ndim, len(shape))) for x in arrays]
    trace = jax.make_jaxpr(computed)(*(jax.ShapeDtypeStruct((), x.dtype) for x in whole))
    return [_map_p.bind(*whole, trace=trace)]


_map_p: Any = Primitive("jaxspatial_map")
_map_p.def_impl(lambda *arrays, trace: compiled(_map_p, trace=trace)(*arrays))


@_map_p.def_abstract_eval
def _(*arrays: ShapedArray, trace: ClosedJaxpr) -> ShapedArray:
    return ShapedArray(arrays[0].shape, cast(Any, trace.out_avals[0]).dtype)


def _lowered_map(context: Any, *arrays: Any, trace: ClosedJaxpr) -> Any:
    """Lowers to `map` of StableHLO, which JAX does not use.

    Over several devices it lowers to a reduction: of a map the compiler would gather the operands on each device.
    """
    (whole,), result = context.avals_out, cast(Any, trace.out_avals[0])

    def reduced(*arrays: jax.Array) -> list[jax.Array]:
        return _reduced(jaxpr_as_fun(trace), arrays, [result.dtype], whole.shape)

    if n_devices(context) > 1:
        return lower_fun(reduced, multiple_results=True)(context, *arrays)
    types = [mlir.aval_to_ir_type(context.module_context, a) for a in (whole, *trace.in_avals)]
    operation = stablehlo.MapOp(types[0], arrays, range(whole.ndim))
    body = operation.computation.blocks.append(*types[1:])
    with mlir.ir.InsertionPoint(body):
        inner = context.replace(avals_in=trace.in_avals, avals_out=[result])
        stablehlo.return_(lower_fun(jaxpr_as_fun(trace), multiple_results=True)(inner, *body.arguments))
    return operation.results


mlir.register_lowering(_map_p, _lowered_map)


def _reduced(
    computed: Callable[..., list[jax.Array]], arrays: Sequence[jax.Array], kinds: Sequence[np.dtype], shape: Shape
) -> list[jax.Array]:
    """The results, as a reduction."""
    operands = _Operands(kinds, shape)
    places = [operands.add(x) for x in arrays]

    def body(_: Any, items: Sequence[jax.Array]) -> tuple[jax.Array, ...]:
        return *computed(*(items[k] for k in places)), *items[len(kinds) :]

    whole, start = operands.arrays, [d.type(0) for d in operands.kinds]
    # A simplification of results without use is wrong where operands differ in dtype: behind the barrier all have one.
    return lax.optimization_barrier(lax.reduce(tuple(whole), tuple(start), body, (0,)))[: len(kinds)]


class _Operands:
    """The operands of a reduction, as many as there are results or more. kinds: their dtypes, first of the results."""

    def __init__(self, kinds: Sequence[np.dtype], shape: Shape):
        self.kinds, self.two = list(kinds), (2, *shape)
        self.items: list[jax.Array | None] = [None] * len(kinds)

    def add(self, x: jax.Array) -> int:
        """The place of an operand: that of a result of its kind, if one is left."""
        free = (k for k, y in enumerate(self.items) if y is None and self.kinds[k] == x.dtype)
        k = next(free, len(self.items))
        if k == len(self.items):
            self.items.append(None)
            self.kinds.append(x.dtype)
        rank = len(self.two)
        self.items[k] = lax.broadcast_in_dim(x, self.two, range(rank - x.ndim, rank))
        return k

    @property
    def arrays(self) -> list[jax.Array]:
        return [lax.full(self.two, 0, d) if x is None else x for x, d in zip(self.items, self.kinds, strict=True)]


def _hidden(zero: jax.Array, tables: Sequence[Table], shape: Shape) -> jax.Array:
    """A hidden zero in the first bit, and where to look in tables, in the others."""
    zero = zero << np.uint32(31)
    if not tables:
        return zero
    row = next((x.row for x in tables if x.row is not None), np.uint32(0))
    return row * np.uint32(shape[0]) + lax.broadcasted_iota(np.uint32, (shape[0], 1), 0) | zero


def _looked_up(table: Table, rows: int, shape: Shape, index: jax.Array) -> Any:
    if table.size == 1:
        return table.numbers.reshape(())[()]
    numbers = np.broadcast_to(table.numbers[..., 0], (rows, shape[0])).ravel()
    return _table_p.bind(index, numbers=_Contents(numbers))


class _Contents:
    """A NumPy array as a parameter, equal where the numbers are."""

    def __init__(self, array: np.ndarray):
        self.array = np.ascontiguousarray(array)
        self._key = self.array.dtype.str, self.array.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Contents) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


_table_p: Any = Primitive("jaxspatial_table")


@_table_p.def_abstract_eval
def _(_, *, numbers: _Contents) -> ShapedArray:
    return ShapedArray((), numbers.array.dtype)


def _lowered_table(context: Any, index: Any, *, numbers: _Contents) -> Any:
    def picked(index: jax.Array, numbers: jax.Array) -> jax.Array:
        return lax.dynamic_slice(numbers, (index,), (1,)).reshape(())

    constant = mlir.ir_constant(numbers.array)
    context = context.replace(avals_in=[*context.avals_in, ShapedArray(numbers.array.shape, numbers.array.dtype)])
    return lower_fun(picked, multiple_results=False)(context, index, constant)


mlir.register_lowering(_table_p, _lowered_table)


class _Scalars:
    """Runs traces on one number of every argument. What is the same is computed once: programs compile sooner.

    zero: the hidden zero of a kernel.
    """

    def __init__(self, zero: jax.Array):
        self.zero = zero
        self.minus_zeros: dict[np.dtype, jax.Array] = {}
        # Results by operation. The operands are kept, so that no other object takes the identity of one.
        self.known: dict[Any, tuple[Sequence[Any], list[Any]]] = {}

    def results(self, jaxpr: Any, consts: Sequence[Any], arguments: Sequence[Any]) -> list[Any]:
        values = {v: np.asarray(c).reshape(())[()] for v, c in zip(jaxpr.constvars, consts, strict=True)}
        values |= dict(zip(jaxpr.invars, arguments, strict=True))

        def read(x: Any) -> Any:
            return np.asarray(x.val, cast(Any, x.aval).dtype).reshape(())[()] if isinstance(x, Literal) else values[x]

        # Sums of numbers that are not known, which no simplification takes apart.
        sums: set[Any] = set()
        for eqn in jaxpr.eqns:
            name, inputs = eqn.primitive.name, [read(x) for x in eqn.invars]
            if name in CALLS:
                inner = called(eqn)
                results = self.results(inner.jaxpr, inner.consts, inputs)
            elif name in _MOVES or (is_no_reassociation(eqn) and eqn.invars[0] in sums):
                results = inputs[:1]
            else:
                results = self._once(eqn, inputs)
                if name in ("add", "sub", *_SUMS) and all(isinstance(x, Tracer) for x in inputs):
                    sums.update(eqn.outvars)
            values |= dict(zip(eqn.outvars, results, strict=True))
        return [read(x) for x in jaxpr.outvars]

    def _once(self, eqn: Any, inputs: Sequence[Any]) -> list[Any]:
        """The results of an operation, which may be known already."""
        params = {k: None if k == "sharding" else x for k, x in eqn.params.items()}
        key = eqn.primitive.name, *map(_identity, inputs), *sorted((k, str(x)) for k, x in params.items())
        if key not in self.known:
            self.known[key] = inputs, self._computed(eqn, inputs, params)
        return self.known[key][1]

    def _computed(self, eqn: Any, inputs: Sequence[Any], params: dict[str, Any]) -> list[Any]:
        if eqn.primitive.name == "jaxspatial_product":
            return [self._rounded(lax.mul(*inputs))]
        if eqn.primitive.name in _SUMS:
            result = _SUMS[eqn.primitive.name](*inputs)
            are_unknown = all(isinstance(x, Tracer) for x in inputs)
            return [result if are_unknown else no_reassociation(result)]
        if eqn.primitive.name == "jaxspatial_quotient":
            # Of a divisor that is known, or a root or quotient itself, the compiler would make a factor.
            return [self._rounded(lax.div(inputs[0], joined(jnp.asarray(inputs[1]), self.zero)))]
        if eqn.primitive.name == "jaxspatial_root":
            return [lax.sqrt(*inputs)]
        if eqn.primitive.name == "jaxspatial_barrier":
            return [joined(inputs[0], self.zero)]
        return [eqn.primitive.bind(*inputs, **params)]

    def _rounded(self, x: jax.Array) -> jax.Array:
        """x plus -0, of which the compiler knows nothing: no part of the operations that follow."""
        if x.dtype not in self.minus_zeros:
            self.minus_zeros[x.dtype] = minus_zero(self.zero, x.dtype)
        return lax.add(x, self.minus_zeros[x.dtype])


def _identity(x: Any) -> Any:
    """What is equal of two numbers only if they are the same."""
    return id(x) if isinstance(x, Tracer) else (np.asarray(x).dtype.str, np.asarray(x).tobytes())
