"""Programs evaluated in NumPy, one operation of JAX after another.

Nothing is compiled, contracted or rewritten. What comes is what the formulas say, in a small part of the time that XLA
takes to compile them; in "reproducible" compiled programs give the same bits, which `dynamics.test_transformations`
and `laws.test_transformations` hold.
"""

import collections
import functools
import itertools
import math
import weakref
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

from jaxspatial.engine import graph, llvm_ir
from jaxspatial.engine import program as programs
from jaxspatial.numerics.sums import primitive as sums


def interpreted(function):
    """The function, of arrays or trees of arrays, with NumPy arrays for results."""

    def call(*arguments):
        closed, shape = jax.make_jaxpr(function, return_shape=True)(*arguments)
        with np.errstate(all="ignore"):
            found = _evaluated(closed, [np.asarray(x) for x in jax.tree.leaves(arguments)])
        return jax.tree.unflatten(jax.tree.structure(shape), found)

    return call


def over(closed, numbers):
    """The results of a closed jaxpr over arrays of numbers of any kind, which know + - * / and no comparisons."""
    return _evaluated(closed, numbers)


def evaluated(precision, function):
    """As `interpreted`; compiled in "fast", of which the compiler has a say."""
    return (jax.jit if precision == "fast" else interpreted)(function)


def _evaluated(closed, arrays):
    """The results of a closed jaxpr."""
    plan = _planned(closed.jaxpr)
    known = [*map(np.asarray, closed.consts), *arrays, *plan.literals, *[None] * plan.n_made]
    for primitive, inputs, outputs, parameters in plan.steps:
        found = _result(primitive, [known[i] for i in inputs], parameters)
        for i, y in zip(outputs, found if primitive.multiple_results else [found], strict=True):
            known[i] = np.asarray(y)
    return [known[i] for i in plan.results]


class _Plan(NamedTuple):
    """Where values are: constants, arguments, literals, and what is made of them, one behind the other."""

    literals: list
    n_made: int
    steps: list
    results: list


_plans = weakref.WeakKeyDictionary()


def _planned(jaxpr):
    """Made once for all turns of a loop."""
    if jaxpr not in _plans:
        asked = [x for equation in jaxpr.eqns for x in equation.invars] + jaxpr.outvars
        literals = [x for x in asked if isinstance(x, Literal)]
        made = [x for equation in jaxpr.eqns for x in equation.outvars]
        places = {id(x): i for i, x in enumerate([*jaxpr.constvars, *jaxpr.invars, *literals, *made])}
        steps = [
            (e.primitive, [places[id(x)] for x in e.invars], [places[id(x)] for x in e.outvars], e.params)
            for e in jaxpr.eqns
        ]
        values = [np.asarray(x.val, x.aval.dtype) for x in literals]
        _plans[jaxpr] = _Plan(values, len(made), steps, [places[id(x)] for x in jaxpr.outvars])
    return _plans[jaxpr]


def _result(primitive, arrays, parameters):
    if primitive.name in OF_NUMBERS:
        return OF_NUMBERS[primitive.name](*arrays)
    if primitive.name in OF_ARRAYS:
        return OF_ARRAYS[primitive.name](*arrays, **parameters)
    # What has no line below is a program of its own, as outside of `jax.jit`.
    return primitive.bind(*map(jnp.asarray, arrays), **parameters)


# -- number by number -------------------------------------------------------------------------------------------------


def _select(which, *cases):
    return np.where(which, *cases[::-1]) if which.dtype == bool else np.choose(which, cases)


def _divide(a, b):
    """Of integers towards zero."""
    return ((a - np.fmod(a, b)) // b).astype(a.dtype) if np.issubdtype(a.dtype, np.integer) else np.divide(a, b)


OF_NUMBERS = {
    "add": np.add,
    "add_any": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "jaxspatial_sum": np.add,
    "jaxspatial_difference": np.subtract,
    "jaxspatial_product": np.multiply,
    "div": _divide,
    "jaxspatial_quotient": np.divide,
    "neg": np.negative,
    "abs": np.abs,
    "max": np.maximum,
    "min": np.minimum,
    "sqrt": np.sqrt,
    "rem": np.fmod,
    "sign": np.sign,
    "floor": np.floor,
    "square": np.square,
    "select_n": _select,
    "eq": np.equal,
    "ne": np.not_equal,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "and": np.bitwise_and,
    "or": np.bitwise_or,
    "not": np.invert,
    "is_finite": np.isfinite,
    "shift_left": np.left_shift,
    "shift_right_logical": np.right_shift,
    "stop_gradient": np.asarray,
    "jaxspatial_root": np.sqrt,
    "jaxspatial_kept": np.asarray,
    "jaxspatial_barrier": np.asarray,
    "jaxspatial_barrier_or_nan": np.asarray,
    # The zero that no compiler foresees.
    "jaxspatial_replica": lambda _: np.uint32(0),
}


# -- arrays, and programs of programs ---------------------------------------------------------------------------------


def _broadcast_in_dim(x, *, shape, broadcast_dimensions, **_):
    own = [1] * len(shape)
    for i, n in zip(broadcast_dimensions, x.shape, strict=True):
        own[i] = n
    x = x.reshape(own)
    if x.shape == shape:
        return x
    if math.prod(shape) > 1000:
        return np.broadcast_to(x, shape)
    # A copy of few numbers takes a third of the time that NumPy takes to find out how to go without one.
    found = np.empty(shape, x.dtype)
    found[...] = x
    return found


def _iota(*, dtype, shape, dimension, **_):
    return _broadcast_in_dim(np.arange(shape[dimension], dtype=dtype), shape=shape, broadcast_dimensions=[dimension])


def _slice(x, *, start_indices, limit_indices, strides):
    return x[tuple(map(slice, start_indices, limit_indices, strides or [1] * x.ndim))]


def _dynamic_slice(x, *starts, slice_sizes):
    return x[_window(x, starts, slice_sizes)]


def _dynamic_update_slice(x, update, *starts):
    found = x.copy()
    found[_window(x, starts, update.shape)] = update
    return found


def _window(x, starts, sizes):
    starts = [min(max(int(i), 0), n - k) for i, n, k in zip(starts, x.shape, sizes, strict=True)]
    return tuple(slice(i, i + k) for i, k in zip(starts, sizes, strict=True))


def _pad(x, value, *, padding_config):
    before, after, between = zip(*padding_config, strict=True)
    if min(before) < 0 or min(after) < 0:
        return jax.lax.pad(x, value, padding_config)
    sizes = [(n - 1) * (1 + k) + 1 if n else 0 for n, k in zip(x.shape, between, strict=True)]
    found = np.full([a + n + b for a, n, b in zip(before, sizes, after, strict=True)], value)
    found[tuple(slice(a, a + n, 1 + k) for a, n, k in zip(before, sizes, between, strict=True))] = x
    return found


@functools.cache
def _bits(dtype):
    info = jnp.finfo(dtype)
    return info.nexp, info.nmant


def _reduce_precision(x, *, exponent_bits, mantissa_bits):
    return (
        x
        if _bits(x.dtype) == (exponent_bits, mantissa_bits)
        else jax.lax.reduce_precision(x, exponent_bits, mantissa_bits)
    )


def _sums(*arrays, plan):
    avals = tuple(jax.ShapeDtypeStruct(x.shape, x.dtype) for x in arrays)
    return _evaluated(_traced_sums(plan, avals), arrays)


@functools.lru_cache(maxsize=1024)
def _traced_sums(plan, avals):
    """Traced once for all turns of a loop. Also of arrays in float64 in a program without 64-bit types."""
    with jax.enable_x64(True):
        return jax.make_jaxpr(functools.partial(sums.evaluate, plan=plan))(*avals)


def _program(*arrays, program, n_batch):
    """What one state needs is traced, as for machine code: several states are the nodes of its graph, over arrays.

    Traced for several states, as XLA's way has it, where there is no such graph.
    """
    batch = np.broadcast_shapes(*(x.shape[:n_batch] for x in arrays))
    varies = [math.prod(x.shape[:n_batch]) > 1 for x in arrays]
    over = [np.broadcast_to(x, (*batch, *x.shape[n_batch:])) if y else x for x, y in zip(arrays, varies, strict=True)]
    flat = [programs.with_one_axis(x, n_batch, batch) for x in over]
    found = _of_graph(program, flat, math.prod(batch))
    if found is None:
        traced = program.traced([jax.ShapeDtypeStruct(x.shape, x.dtype) for x in flat])
        found = _evaluated(traced.closed, flat)
    return [programs.with_callers_axes(y, program.primal_of(i), arrays, n_batch, batch) for i, y in enumerate(found)]


def _of_graph(program, arrays, n):
    """The results of n states by the graph of one; None where there is none."""
    if n < 2 or any(x.dtype == object for x in arrays):
        return None
    avals = [jax.ShapeDtypeStruct((1, *x.shape[1:]), x.dtype) for x in arrays]
    key = tuple((a.shape, np.dtype(a.dtype).name) for a in avals), bool(jax.config.values["jax_enable_x64"])
    nodes, of_one = program.cached(("of one state", key), lambda: _nodes(program.traced(avals)))
    if nodes is None:
        return None
    places, known = [x.reshape((len(x), -1)).T for x in arrays], dict(nodes.graph.constants)
    _evaluate_region(nodes, 0, places, known)
    results = []
    for i, (found, a) in enumerate(zip(nodes.graph.results, of_one, strict=True)):
        y, primal = np.empty((found.size, n), a.dtype), program.primal_of(i)
        for row, node in zip(y, found.ravel().tolist(), strict=True):
            row[:] = known[node]
        y = y.T
        if primal is not None and len(arrays[primal]) != n:
            y = y.sum(0, keepdims=True, dtype=y.dtype)
        results.append(y.reshape((len(y), *a.shape[1:])))
    return results


class _Nodes(NamedTuple):
    """A graph, the nodes that its results need, and those of each region: operands before what is made of them."""

    graph: graph.Graph
    live: set
    of_region: dict


def _nodes(traced):
    """(the _Nodes of a trace, its results for one state); None for nodes if there are none."""
    try:
        made = graph.graph_of(traced.closed, programs._expanded)
    except graph.NotSupportedError:
        return None, traced.out_avals
    of_region, live = collections.defaultdict(list), llvm_ir.Scheduler(made).live
    for node in sorted(live):
        if made.operations[node] not in ("constant", "carried", "row"):
            of_region[made.regions[node]].append(node)
    return _Nodes(made, live, of_region), traced.out_avals


def _evaluate_region(nodes, region, places, known):
    """Adds the values of the nodes of a region. places: by argument the numbers (places, states)."""
    g = nodes.graph
    for node in nodes.of_region[region]:
        name = g.operations[node]
        if name == "load":
            argument, place = g.details[node]
            known[node] = places[argument][place]
        elif name in ("last", "stacked"):
            k, which, row = g.details[node]
            if ("loop", k) not in known:
                known["loop", k] = _evaluate_loop(nodes, g.loops[k], places, known)
            known[node] = known["loop", k][name, which, row]
        elif name == "lookup":
            number, behind = g.details[node]
            table = [places[g.details[n][0]][g.details[n][1]] if g.operations[n] == "load" else known[n]
                     for n in g.tables[number]]  # fmt: skip
            known[node] = graph.looked_up(table, known[g.operands[node][0]], behind)
        else:
            known[node] = graph.EVALUATE[name](g.dtypes[node], *[known[x] for x in g.operands[node]])


def _evaluate_loop(nodes, loop, places, known):
    """What a loop leaves: by ("last", which, 0) and ("stacked", which, row)."""
    turns = itertools.count() if loop.length is None else range(loop.length)[:: -1 if loop.is_reverse else 1]
    inner = [k for k, other in enumerate(nodes.graph.loops) if nodes.graph.parents[other.region] == loop.region]
    carried = {i: c for i, c in enumerate(loop.carried) if c[0] in nodes.live}
    last, stacked = {i: known[first] for i, (_, first, _) in carried.items()}, {}
    for k in turns:
        known.update((p, last[i]) for i, (p, _, _) in carried.items())
        known.update((p, known[rows[k]]) for p, rows in loop.rows.items() if p in nodes.live)
        for j in inner:
            known.pop(("loop", j), None)
        _evaluate_region(nodes, loop.region, places, known)
        new = {i: known[y] for i, (_, _, y) in carried.items()}
        if loop.length is None:
            goes_on = known[loop.condition]
            if not np.any(goes_on) or loop.is_branch and k:
                break
            new = {i: np.where(goes_on, y, last[i]) for i, y in new.items()}
        last = new
        stacked |= {("stacked", i, k): known[y] for i, y in enumerate(loop.stacked) if y in nodes.live}
    return stacked | {("last", i, 0): x for i, x in last.items()}


def _dot_general(x, y, *, dimension_numbers, **_):
    """The terms of each number one after the other, as in graphs of programs."""

    def in_front(x, summed, batches):
        moved = np.moveaxis(x, (*batches, *summed), range(len(batches) + len(summed)))
        sizes, n = moved.shape, len(batches)
        last = len(batches) + len(summed)
        return moved.reshape((math.prod(sizes[:n]), math.prod(sizes[n:last]), -1)), sizes[:n], sizes[last:]

    (of_x, of_y), (batches_x, batches_y) = dimension_numbers
    (x, batch, rows), (y, _, columns) = in_front(x, of_x, batches_x), in_front(y, of_y, batches_y)
    terms = x[:, :, :, None] * y[:, :, None, :]
    total = np.zeros(terms[:, 0].shape, terms.dtype)
    for k in range(terms.shape[1]):
        total = total + terms[:, k]
    return total.reshape((*batch, *rows, *columns))


def _scan(*arrays, jaxpr, length, reverse, num_consts=0, num_carry=0, ft_in=None, **_):
    if ft_in is not None:  # JAX 0.12: (constants, what is carried, what is sliced).
        num_consts, num_carry, _ = map(len, ft_in.unpack())
    start = num_consts + num_carry
    consts, carry, xs = arrays[:num_consts], arrays[num_consts:start], arrays[start:]
    stacked = [np.empty((length, *a.shape), a.dtype) for a in jaxpr.out_avals[num_carry:]]
    for i in reversed(range(length)) if reverse else range(length):
        found = _evaluated(jaxpr, [*consts, *carry, *(x[i] for x in xs)])
        carry = found[:num_carry]
        for whole, y in zip(stacked, found[num_carry:], strict=True):
            whole[i] = y
    return [*carry, *stacked]


def _while(*arrays, cond_jaxpr, body_jaxpr, cond_nconsts, body_nconsts):
    start = cond_nconsts + body_nconsts
    carry = arrays[start:]
    while _evaluated(cond_jaxpr, [*arrays[:cond_nconsts], *carry])[0]:
        carry = _evaluated(body_jaxpr, [*arrays[cond_nconsts:start], *carry])
    return carry


def _linear_solve(*arrays, const_lengths, jaxprs):
    """By the solver that the caller gave: its constants come after those of the two products with the matrix."""
    start, n = const_lengths.matvec + const_lengths.vecmat, const_lengths.solve
    return _evaluated(jaxprs.solve, [*arrays[start : start + n], *arrays[sum(const_lengths) :]])


def _call(*arrays, jaxpr=None, call_jaxpr=None, **_):
    inner = call_jaxpr if jaxpr is None else jaxpr
    return _evaluated(inner if hasattr(inner, "consts") else jax.extend.core.ClosedJaxpr(inner, ()), arrays)


OF_ARRAYS = {
    "broadcast_in_dim": _broadcast_in_dim,
    "iota": _iota,
    "reshape": lambda x, *, new_sizes, **_: x.reshape(new_sizes),
    "squeeze": lambda x, *, dimensions: x.squeeze(dimensions),
    "transpose": lambda x, *, permutation: x.transpose(permutation),
    "rev": lambda x, *, dimensions: np.flip(x, dimensions),
    "concatenate": lambda *arrays, dimension: np.concatenate(arrays, dimension),
    "stack": lambda *arrays, axis: np.stack(arrays, axis),
    "unstack": lambda x, *, axis: list(np.moveaxis(x, axis, 0)),
    "split": lambda x, *, sizes, axis: np.split(x, np.cumsum(sizes)[:-1], axis),
    "slice": _slice,
    "dynamic_slice": _dynamic_slice,
    "dynamic_update_slice": _dynamic_update_slice,
    "pad": _pad,
    "convert_element_type": lambda x, *, new_dtype, **_: x if x.dtype == object else x.astype(new_dtype),
    "bitcast_convert_type": lambda x, *, new_dtype: x.view(new_dtype),
    "reduce_precision": _reduce_precision,
    "jaxspatial_unstack": lambda x, *, axis: list(np.moveaxis(x, axis, 0)),
    "jaxspatial_stack": lambda *lanes, axis: [np.stack(lanes, axis)],
    "jaxspatial_sums": _sums,
    "jaxspatial_program": _program,
    "scan": _scan,
    "dot_general": _dot_general,
    "custom_linear_solve": _linear_solve,
    "while": _while,
    "cond": lambda which, *arrays, branches, **_: _evaluated(branches[int(which)], arrays),
    **dict.fromkeys(("jit", "pjit", "closed_call", "custom_jvp_call", "checkpoint", "remat2"), _call),
}
