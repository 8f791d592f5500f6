"""Functions of one state by every way there is: NumPy over a graph, machine code of our own, and XLA."""

import ctypes
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxspatial.engine import cpu, graph, llvm_ir
from jaxspatial.numerics.errorfree import barrier, transforms

LINE = 64


def graph_of(f, *arrays, may_fuse=False):
    """The graph of a function of one state, for arrays (n, ...) over states."""
    state = [jax.ShapeDtypeStruct(x.shape[1:], x.dtype) for x in arrays]
    return graph.graph_of(jax.make_jaxpr(lambda *x: jax.tree.leaves(f(*x)))(*state), may_fuse=may_fuse)


def fused(a, b, c):
    """What may be fused: products that are added, and that are subtracted, on either side."""
    return a * b + c, c + a * b, a * b - c, c - a * b


def factors(dtype):
    """(a, b, c) of which a b + c cancels, entirely or in part, or is one of both alone, or lies half way between two
    numbers, which rounding twice gets wrong."""
    rng = np.random.default_rng(0)
    reach = 30 if dtype == np.float32 else 200
    a, b = (rng.standard_normal((2, 1200)) * 2.0 ** rng.integers(-reach, reach, (2, 1200))).astype(dtype)
    near = a * b * rng.choice([1, -1], 1200) * 2.0 ** rng.integers(-60, 60, 1200)
    c = np.where(rng.random(1200) < 0.3, -(a * b), near).astype(dtype)
    eps = np.finfo(dtype).eps
    a[:4], b[:4], c[:4] = 1 + eps, [1, 1 + eps / 2, 1 + eps, 1 + eps], [eps / 2, eps / 4, 2 / eps, eps**2 / 8]
    return a, b, c


def with_numpy(g, arrays):
    """The results (n, size) of a graph, by the oracle."""
    return graph.run(g, *map(np.asarray, arrays))


def with_xla(f, arrays):
    """The same of a function of one state, mapped over states."""
    results = jax.jit(jax.vmap(lambda *x: jax.tree.leaves(f(*x))))(*arrays)
    return [np.asarray(y).reshape((len(y), -1)) for y in results]


def code_of(g, width, arrays, target=None):
    """A graph as code for arrays (n, ...), or (1, ...) where all states share one."""
    n = max(map(len, arrays))
    is_shared = [len(x) != n for x in arrays]
    target = target or cpu.host()
    written = llvm_ir.ir_of(g, width, is_shared, target.has_fma, target.has_compress)
    arguments = [cpu.Argument(x[0].size, x.dtype, s) for x, s in zip(arrays, is_shared, strict=True)]
    results = [cpu.Result(x.size, dtype) for x, dtype in zip(g.results, dtypes_of(g), strict=True)]
    return cpu.Code(written.text, width, tuple(arguments), tuple(results), *written[1:])


def dtypes_of(g):
    return [g.dtypes[int(x.flat[0])] if x.size else np.dtype(np.float32) for x in g.results]


def in_handler(code, arrays, target=None):
    """The results of code that XLA calls. Its threads flush subnormal numbers."""
    n = max(map(len, arrays))
    held = cpu.compiled(code, target)
    flat = [np.reshape(x, (len(x), -1)) for x in arrays]
    results = jax.jit(lambda *x: cpu.call(code, x, n, target))(*flat)
    jax.block_until_ready(results)
    assert held
    return [np.asarray(y) for y in results]


def by_itself(code, arrays, target=None):
    """The results of code that is called outside of XLA: subnormal numbers are not flushed."""
    assert cpu.is_available()
    target = target or cpu.host()
    engine = cpu._loaded(cpu._object([code.text], target), target)
    block = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(engine.get_function_address("block"))
    memory, results = in_columns(code, arrays)
    for *pointers, _ in memory:
        block(*pointers)
    return [_rows(y, x, code.width)[: max(map(len, arrays))] for x, y in zip(code.results, results, strict=True)]


def in_columns(code, arrays):
    """([what the functions of code take for each block, and what must live as long], columns of all results)."""
    n_blocks = -(-max(map(len, arrays)) // code.width)
    given = [
        _lines(np.asarray(x).reshape((1, -1))) if argument.is_shared else _lines(_columns(x, code.width, n_blocks))
        for x, argument in zip(arrays, code.arguments, strict=True)
    ]
    results = [_lines(np.zeros((n_blocks, x.size * code.width), x.dtype)) for x in code.results]
    memory = []
    for k in range(n_blocks):
        tables = [_table([x[min(k, len(x) - 1)] for x in own]) for own in (given, results)]
        frame = _lines(np.zeros((1, code.frame_bytes), np.uint8))
        memory.append((*tables, frame.ctypes.data, (given, frame)))
    return memory, results


def _columns(x, width, n_blocks):
    """Rows of states as columns of so many states; the last one is there again where there are too few."""
    rows = np.asarray(x).reshape((len(x), -1))
    rows = np.concatenate([rows, np.repeat(rows[-1:], n_blocks * width - len(rows), 0)])
    return rows.reshape((n_blocks, width, -1)).transpose((0, 2, 1)).reshape((n_blocks, -1))


def _rows(lines, result, width):
    """Columns of states as rows of states."""
    columns = lines[:, : result.size * width * result.dtype.itemsize].copy().view(result.dtype)
    columns = columns.reshape((len(lines), result.size, width))
    return columns.transpose((0, 2, 1)).reshape((len(lines) * width, result.size))


def _lines(rows):
    """Bytes of rows, each of which begins a line of the cache."""
    data = np.ascontiguousarray(rows).view(np.uint8)
    stride = -(-max(data.shape[1], 1) // LINE) * LINE
    memory = np.zeros(len(data) * stride + LINE, np.uint8)
    first = -memory.ctypes.data % LINE
    lines = memory[first : first + len(data) * stride].reshape((len(data), stride))
    lines[:, : data.shape[1]] = data
    return lines


def _table(arrays):
    return ctypes.cast((ctypes.c_void_p * max(len(arrays), 1))(*[x.ctypes.data for x in arrays]), ctypes.c_void_p)


def assert_same_bits(results, expected, note=""):
    """Any NaN stands for any other: their bits depend on the processor."""
    for i, (x, y) in enumerate(zip(results, expected, strict=True)):
        assert x.shape == y.shape, (note, i, x.shape, y.shape)
        if not x.size:
            continue
        assert x.dtype == y.dtype, (note, i, x.dtype, y.dtype)
        wrong = x.view(f"u{x.itemsize}") != y.view(f"u{y.itemsize}")
        if x.dtype.kind == "f":
            wrong &= ~(np.isnan(x) & np.isnan(y))
        assert not wrong.any(), (note, i, f"{wrong.sum()} wrong", np.argwhere(wrong)[0], x[wrong][:5], y[wrong][:5])


# -- operations and hostile numbers ------------------------------------------------------------------------------------


def hostile(dtype):
    """Numbers at which operations differ: signed zeros, subnormals, ties, those that no integer holds."""
    dtype = np.dtype(dtype)
    if dtype.kind == "b":
        return np.array([False, True])
    if dtype.kind in "iu":
        info, bits = np.iinfo(dtype), 8 * dtype.itemsize
        small = [0, 1, 2, 3, 7, 31, 32, 33, 63, 64, 65, 100, info.max, info.max - 1, 1 << (bits - 2), 0x12345678]
        signed = [-1, -2, -3, -7, -32, -100, info.min, info.min + 1]
        return np.array(small + (signed if dtype.kind == "i" else [(1 << bits) - 5, 1 << (bits - 1)]), dtype)
    info = np.finfo(dtype)
    some = [0, info.smallest_subnormal, 3 * info.smallest_subnormal, info.tiny / 2, info.tiny, info.eps, 0.3, 0.5, 1]
    some += [1 + info.eps, 1.5, 2.5, 3, 7, 1e9, 2.0**24 + 2, 2.0**31, 2.0**32, 2.0**53, 2.0**63, 2.0**64, info.max / 3]
    some += [info.max, np.inf, 1e-20, 255.5, 2.0**31 - 128]
    return np.array([*some, *(-x for x in some), np.nan], dtype)


def pairs(dtype, n=None):
    """Pairs of hostile numbers, all of them or so many."""
    x = hostile(dtype)
    a, b = np.repeat(x, len(x)), np.tile(x, len(x))
    at = np.random.default_rng(0).permutation(len(a))[:n]
    return a[at], b[at]


def _two(f):
    return lambda x, y: list(f(x, y))


def operations(dtype):
    """Every operation of numbers of a dtype that graphs have, by name."""
    dtype = np.dtype(dtype)
    # By other constants XLA does not divide: it multiplies with their reciprocals.
    one, low, high = (np.asarray(x, dtype)[()] for x in (1, 1, 4))
    found = {f"compare {f.__name__}": f for f in (lax.lt, lax.le, lax.gt, lax.ge, lax.eq, lax.ne)}
    found |= {
        # Not of what is compared, of which a compiler makes a maximum.
        "select": lambda x, y: lax.select(lax.lt(x, y), y, lax.full_like(x, 1)),
        "min": lax.min,
        "max": lax.max,
        "clamp": lambda x, y: lax.clamp(low, x, high),
        "clamp between": lambda x, y: lax.clamp(y, x, high),
        "stop gradient": lambda x, y: lax.stop_gradient(x),
        "optimization barrier": lambda x, y: lax.optimization_barrier(x),
    }
    for to in np.float32, np.float64, np.int8, np.uint8, np.int32, np.uint32, np.int64, np.uint64, np.bool_:
        found[f"convert to {to.__name__}"] = lambda x, y, to=to: lax.convert_element_type(x, to)
    if dtype.kind == "b":
        return found | {"and": lax.bitwise_and, "or": lax.bitwise_or, "xor": lax.bitwise_xor} | {
            "not": lambda x, y: lax.bitwise_not(x)
        }  # fmt: skip
    found |= {"add": lax.add, "sub": lax.sub, "mul": lax.mul, "div": lax.div, "rem": lax.rem}
    found |= {
        "neg": lambda x, y: lax.neg(x),
        "sign": lambda x, y: lax.sign(x),
        "square": lambda x, y: lax.square(x),
        "integer power": lambda x, y: lax.integer_pow(x, 2),
        "divided by a constant": lambda x, y: lax.div(x, high),
        "remainder of a constant": lambda x, y: lax.rem(x, high),
        "times one": lambda x, y: lax.mul(x, one),
        "over one": lambda x, y: lax.div(x, one),
    }
    same = {2: np.int16, 4: (np.float32, np.int32, np.uint32), 8: (np.float64, np.int64, np.uint64)}
    for to in same[dtype.itemsize]:
        found[f"bits as {to.__name__}"] = lambda x, y, to=to: lax.bitcast_convert_type(x, to)
    if dtype.kind != "u":
        found["abs"] = lambda x, y: lax.abs(x)
    if dtype.kind in "iu":
        some = {f"by {k}": lambda x, y, k=k: lax.shift_left(x, dtype.type(k)) for k in (0, 5, 31)}
        return found | some | {
            "and": lax.bitwise_and, "or": lax.bitwise_or, "xor": lax.bitwise_xor,
            "not": lambda x, y: lax.bitwise_not(x),
            "shift left": lax.shift_left, "shift right, logical": lax.shift_right_logical,
            "shift right, arithmetic": lax.shift_right_arithmetic,
        }  # fmt: skip
    formats = {np.dtype(np.float32): ((8, 7), (8, 10), (8, 22), (8, 23)), np.dtype(np.float64): ((11, 20), (11, 51))}
    for bits in formats[dtype]:
        found[f"rounded to {bits} bits"] = functools.partial(
            lambda x, y, e, m: lax.reduce_precision(x, e, m), e=bits[0], m=bits[1]
        )
    return found | {
        "sqrt": lambda x, y: lax.sqrt(x),
        "round": lambda x, y: lax.round(x, lax.RoundingMethod.TO_NEAREST_EVEN),
        "floor": lambda x, y: lax.floor(x),
        "ceil": lambda x, y: lax.ceil(x),
        "is finite": lambda x, y: lax.is_finite(x),
        "two sum": _two(transforms.two_sum),
        "product": barrier.product,
        "quotient": barrier.quotient,
        "root": lambda x, y: barrier.root(x),
        "total": barrier.fixed_sum,
        "difference": barrier.difference,
        "no fma": lambda x, y: barrier.no_reassociation(lax.mul(x, y)),
        "barrier": lambda x, y: barrier.barrier(x),
    }


def all_operations(dtype):
    """One function of them all, so that there is one program to compile."""
    chosen = operations(dtype)
    return lambda x, y: [f(x, y) for f in chosen.values()]


def random_function(seed):
    """(a function of one state, its arguments): arithmetic with loops, slices and branches, drawn at random."""
    return _Random(seed).made()


class _Random:
    """Draws steps on a list of vectors of a fixed length."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.dtype = np.dtype(self.rng.choice(["float32", "float64"]))
        self.size = int(self.rng.integers(1, 5))
        self.n = int(self.rng.choice([1, 5, 16, 19]))

    def made(self):
        arguments = [self.rng.standard_normal((self.n, self.size)).astype(self.dtype) for _ in range(3)]
        steps = [self._step(2) for _ in range(int(self.rng.integers(3, 9)))]
        kept = self.rng.permutation(3 + len(steps))[:3]

        def f(*x):
            values = list(x)
            for step in steps:
                values.append(step(values))
            return [values[k] for k in kept], values[-1]

        return f, arguments

    def _places(self, n):
        return [int(k) for k in self.rng.integers(0, 1000, n)]

    def _step(self, depth):
        """A function of a list of vectors that makes another one."""
        simple = [self._arithmetic, self._select, self._moved, self._constant]
        loops = [self._scan, self._while, self._cond, self._fori, self._slice]
        return self.rng.choice(simple + 2 * loops if depth else simple)(depth - 1)

    def _body(self, depth):
        """A few steps after each other: of a list of vectors to one."""
        steps = [self._step(depth) for _ in range(int(self.rng.integers(1, 4)))]

        def f(values):
            values = list(values)
            for step in steps:
                values.append(step(values))
            return values[-1]

        return f

    def _arithmetic(self, _):
        # Held, so that XLA makes no fma of a product and a sum, and does not divide by multiplying.
        held = [barrier.product, barrier.fixed_sum, barrier.difference, barrier.quotient]
        f = [*held, lax.max, lax.min, lambda x, y: lax.abs(x), lambda x, y: lax.neg(y)][self.rng.integers(8)]
        a, b = self._places(2)
        return lambda v: f(v[a % len(v)], v[b % len(v)])

    def _select(self, _):
        a, b, c = self._places(3)

        def f(v):
            x, y = v[a % len(v)], v[b % len(v)]
            return jnp.where(x < y, v[c % len(v)], x)

        return f

    def _moved(self, _):
        (a,), k = self._places(1), int(self.rng.integers(self.size))
        return lambda v: jnp.concatenate([v[a % len(v)][k:], v[a % len(v)][:k]])[::-1]

    def _constant(self, _):
        c, (a,) = self.rng.choice([0, 1, -1, 0.5, 3], self.size).astype(self.dtype), self._places(1)
        return lambda v: barrier.product(v[a % len(v)], jnp.asarray(c))

    def _scan(self, depth):
        a, b = self._places(2)
        body, n, is_reverse = self._body(depth), int(self.rng.integers(1, 6)), bool(self.rng.integers(2))
        has_boundaries, at = bool(self.rng.integers(2)), self.rng.integers(0, 2, n).astype(np.int32)

        def f(v):
            rows = jnp.stack([v[(a + k) % len(v)] for k in range(n)])

            def turn(carry, row):
                x, is_here = row
                y = body([*v, carry, x])
                y = lax.cond(is_here > 0, lambda y: y, lambda y: barrier.difference(y, carry), y)
                return barrier.product(y, jnp.full_like(y, 0.5)), barrier.fixed_sum(y, x)

            given = jnp.asarray(at) if has_boundaries else jnp.zeros_like(at) + (v[0][0] > 0).astype(np.int32)
            last, stacked = lax.scan(turn, v[b % len(v)], (rows, given), reverse=is_reverse)
            return barrier.difference(last, stacked[n // 2])

        return f

    def _fori(self, depth):
        a, n, body = self._places(1)[0], int(self.rng.integers(0, 4)), self._body(depth)
        return lambda v: lax.fori_loop(
            0, n, lambda i, c: barrier.product(body([*v, c]), jnp.full_like(c, i)), v[a % len(v)]
        )

    def _while(self, depth):
        a, body, limit = self._places(1)[0], self._body(depth), int(self.rng.integers(1, 7))

        def f(v):
            # Lanes end after different numbers of turns.
            n = jnp.clip(lax.abs(v[0][0]) * 3, 0, limit).astype(np.int32)

            def turn(state):
                k, x = state
                return k + 1, barrier.product(body([*v, x]), jnp.full_like(x, 0.5))

            return lax.while_loop(lambda state: state[0] < n, turn, (jnp.zeros_like(n), v[a % len(v)]))[1]

        return f

    def _cond(self, depth):
        (a, b), yes, no = self._places(2), self._body(depth), self._body(depth)
        return lambda v: lax.cond(v[a % len(v)][0] < v[b % len(v)][-1], yes, no, v)

    def _slice(self, _):
        a, b = self._places(2)

        def f(v):
            x, y = v[a % len(v)], v[b % len(v)]
            k = jnp.clip(y[0] * 3, -9, 9).astype(np.int32)
            one = lax.dynamic_slice_in_dim(x, k, 1)
            return lax.dynamic_update_slice_in_dim(y, one, k + 1, 0)

        return f


# -- functions that move numbers, and loops ----------------------------------------------------------------------------


def moves():
    """Functions that only move numbers of a matrix (2, 3)."""
    return {
        "reshape": lambda x: x.reshape((3, 2)),
        "transpose": lambda x: x.T,
        "expand and squeeze": lambda x: lax.squeeze(lax.expand_dims(x, (1,)), (1,)),
        "reverse": lambda x: lax.rev(x, (0, 1)),
        "slice": lambda x: x[:, 1:],
        "every second": lambda x: lax.slice(x, (0, 0), (2, 3), (1, 2)),
        "broadcast": lambda x: jnp.broadcast_to(x[:, None], (2, 4, 3)),
        "concatenate": lambda x: jnp.concatenate([x, x[:1]], axis=0),
        "stack": lambda x: jnp.stack([x[0], x[1], x[0]], axis=1),
        "split": lambda x: lax.split(x, (1, 2), axis=1),
        "pad": lambda x: lax.pad(x, np.float32(7), ((1, 0, 1), (0, 2, 2))),
        "pad nothing": lambda x: lax.pad(x[:, :0], np.float32(7), ((0, 0, 0), (1, 2, 1))),
        "dynamic slice": lambda x: lax.dynamic_slice(x, (1, 5), (1, 2)),
        "dynamic update": lambda x: lax.dynamic_update_slice(x, x[:1, :2], (jnp.int32(-4), jnp.int32(9))),
        "moved": lambda x: jnp.moveaxis(x.reshape((1, 2, 3)), 0, -1),
        "called": jax.jit(lambda x: x[0]),
        "remembered": jax.checkpoint(lambda x: x[::-1]),
        "constants": lambda x: (jnp.arange(3, dtype=np.int32), jnp.zeros((0, 3), np.float32), np.float32(2)),
        "known branch": lambda x: lax.cond(jnp.bool_(True), lambda x: x[0], lambda x: x[1], x),
        "known case": lambda x: lax.switch(jnp.int32(7), [lambda x: x, lambda x: x[::-1]], x),
        "gather": lambda x: (x[:, np.array([2, 0])], x[np.array([1, 0, 1])], x[np.array([1, 0]), :, None]),
        "gather from rows": lambda x: x[np.arange(2)[:, None], np.array([[2, 0], [1, 1]])],
        "gather from batches": lambda x: jax.vmap(lambda row, at: row[at])(x, np.array([[2, 0], [1, 1]])),
        "diagonal": lambda x: (
            jnp.diagonal(x[:, :2]),
            lax.platform_dependent(x, tpu=lambda x: -x, default=lambda x: x),
        ),
        "nothing": lambda x: (),
        "the same twice": lambda x: (x, x, x[1], x[1, 2]),
    }


def reductions():
    """Reductions of a matrix (2, 3), and products of it, in the order of its rows where that matters."""
    return {
        "sum": lambda x: jnp.sum((x * 8).astype(np.int32), axis=0),
        "product": lambda x: jnp.prod((x * 8).astype(np.int32), axis=1),
        "maximum": lambda x: jnp.max(x, axis=(0, 1)),
        "minimum": lambda x: jnp.min(x, axis=1),
        "all": lambda x: jnp.all(x > -1, axis=0),
        "any": lambda x: jnp.any(x > 1, axis=1),
        "sum of one": lambda x: jnp.sum(x[:1], axis=0),
        "sum of two": lambda x: jnp.sum(x, axis=0),
        "scatter": lambda x: x.at[:, np.array([2, 0, 2])].add(x),
        "scatter to rows": lambda x: x.at[np.array([1, 1])].add(x),
        "scatter to batches": lambda x: jax.vmap(lambda row, at: row.at[at].add(row[:2]))(
            x, np.array([[2, 0], [1, 1]])
        ),
        "dot": lambda x: lax.dot((x * 8).astype(np.int32), (x * 8).astype(np.int32).T),
        "dots": lambda x: jnp.einsum("ij,ik->ij", (x * 8).astype(np.int32), (x * 4).astype(np.int32)),
        "bits": lambda x: lax.reduce_and(lax.bitcast_convert_type(x, np.uint32), (0,)),
    }


def _carries(x, y):
    """Several carries: one that does not change, one that is set, two that change places, and masks."""

    def turn(carry, row):
        a, b, fixed, count, is_large = carry
        is_large = is_large | (row[0] > 0.5)
        return (b, barrier.fixed_sum(a, row), fixed, count + 1, is_large), (barrier.product(b, fixed), is_large)

    start = x[0], y, x[1], jnp.int32(3), jnp.bool_(False)
    return lax.scan(turn, start, x)


def _with_boundaries(is_reverse):
    at = np.array([0, 0, 0, 1, 0, 2, 2], np.int32)

    def f(x, y):
        def turn(c, row):
            x, k = row
            c = lax.cond(k > 0, lambda c: barrier.product(c, y), lambda c: barrier.fixed_sum(c, y), c)
            return c, (barrier.fixed_sum(c, x), k)

        return lax.scan(turn, y, (jnp.concatenate([x, x[:2]]), jnp.asarray(at)), reverse=is_reverse)

    return f


def _nested(x, y):
    def outer(c, row):
        def inner(d, k):
            return barrier.fixed_sum(barrier.product(d, row), c), (d, k)

        d, stacked = lax.scan(inner, row, x, reverse=True)
        return barrier.difference(d, stacked[0][1]), stacked[1].T

    return lax.scan(outer, y, x)


def _halved(x, y):
    """Turns until a number is small: other numbers of turns in each state. NaN ends it, too."""

    def turn(s):
        return s[0] + 1, barrier.product(s[1], jnp.full_like(s[1], 0.5)), barrier.fixed_sum(s[2], s[1])

    return lax.while_loop(lambda s: jnp.abs(s[1][0]) > 0.1, turn, (jnp.int32(0), y, x[0]))


def _while_in_scan(x, y):
    def turn(c, row):
        n, small, total = _halved(x, row)
        return barrier.fixed_sum(c, total), (n, small)

    return lax.scan(turn, y, x)


def _scan_in_while(x, y):
    def turn(s):
        k, c = s
        c, _ = lax.scan(lambda c, row: (barrier.difference(barrier.product(c, row), y), None), c, x)
        return k + 1, c

    return lax.while_loop(lambda s: (s[0] < 5) & (s[1][1] < 1), turn, (jnp.int32(0), y))


def _while_in_while(x, y):
    def turn(s):
        return s[0] + 1, barrier.fixed_sum(s[1], _halved(x, s[1])[1])

    return lax.while_loop(lambda s: s[0] < (jnp.abs(y[0]) * 4).astype(np.int32), turn, (jnp.int32(0), y))


def _tables(x, y):
    """Rows that a loop stacked, as they are, backwards, and mixed with others; parts of an argument; constants."""
    _, rows = lax.scan(lambda c, row: (barrier.fixed_sum(c, row), (c, c > row)), y, x)

    def turn(c, row):
        return barrier.fixed_sum(c, row[0]), (barrier.product(row[0], row[1]), row[3], jnp.where(row[2], c, row[1]))

    constants = jnp.asarray(np.linspace(-1, 1, 15).reshape((5, 3)), x.dtype)
    masks = jnp.asarray(np.arange(15).reshape((5, 3)) % 3 == 0)
    mixed = jnp.concatenate([rows[0][:2], x[2:]])
    both = [lax.scan(turn, y, (rows[0], mixed, rows[1], masks), reverse=r) for r in (False, True)]
    return both, lax.scan(turn, y, (x[::-1], constants, masks, masks)), lax.scan(turn, y, (x, x, masks, rows[1]))


def _slices(x, y):
    k = jnp.clip(y[0] * 4, -9, 9).astype(np.int32)
    one = lax.dynamic_slice(x, (k, jnp.int32(1)), (2, 2))
    put = lax.dynamic_update_slice(x, x[:3] * 2, (k, jnp.int32(0)))
    whole = lax.dynamic_update_slice(x, x * 2, (k, k))
    return one, put, whole, lax.dynamic_slice(y, (jnp.uint8(k > 0),), (2,)), lax.dynamic_slice(y, (k,), (3,))


def _branches(x, y):
    k = (y[0] * 3).astype(np.int32)
    cases = [lambda v: v + 1, lambda v: barrier.product(v, v), lambda v: v[::-1]]
    chosen = lax.switch(k, cases, y)
    yes, no = (lambda v: (v[0], v[1] > 0), lambda v: (barrier.product(v[0], v[0]), v[1] < 0))
    return chosen, lax.cond(y[0] < y[1], yes, no, x)


def _lookups(x, y):
    """In tables of an argument and of constants, at indices that are moved into them: numbers, and windows of them."""
    k = (y * 40).astype(np.int32)
    pairs = jnp.stack([k, (y * 3).astype(np.int32)], -1)
    square = lax.GatherDimensionNumbers((1, 2), (), (0, 1))
    row = lax.GatherDimensionNumbers((0,), (0,), (0, 1))
    grid = jnp.asarray(np.arange(12.0).reshape((3, 4)).astype(y.dtype))
    squares = [lax.gather(table, pairs, square, (2, 2), mode="clip") for table in (x, grid)]
    rows = lax.gather(x, pairs.astype(np.int8), row, (1, 3), mode="clip")
    known = np.linspace(-1, 1, 9).astype(y.dtype)
    own = x.reshape(-1).at[k].get(mode="clip")
    other = jnp.asarray(known).at[jnp.clip(k, 0, 8).astype(np.uint8)].get(mode="promise_in_bounds")
    turned = lax.scan(lambda c, row: (c + own, own * row[0]), y, x)
    return own, other, turned, squares, lax.cond(y[0] > 0, lambda v: v + rows, lambda v: v, rows)


def _skipped(x, y):
    """A long branch that some states take, others not; in one another, and in loops that end at different turns."""

    def long(v):
        for _ in range(30):
            v = barrier.fixed_sum(barrier.product(v, y), y)
        return v, v[0] > y[1], y

    def short(v):
        return v, jnp.bool_(True), y

    def of_both(v):
        a, _, _ = lax.cond(v[0] > v[1], long, short, v)
        for _ in range(30):
            a = barrier.product(a, v)
        return a, a[0] > 0, v

    def turn(state):
        k, v = state
        return k + 1, lax.cond(v[1] > 0, short, of_both, v)[0]

    n = jnp.clip(lax.abs(y[0]) * 3, 0, 4).astype(np.int32)
    ended = lax.while_loop(lambda state: state[0] < n, turn, (jnp.zeros_like(n), y))
    # What a branch has made is made again outside of it.
    return lax.cond(y[0] < y[1], long, short, x[0]), long(x[0]), lax.cond(y[0] < y[1], short, of_both, x[1]), ended


def _skipped_alike(x, y):
    """Branches with one condition, of which one reads what another has made: in a loop, in a branch between them, and
    where it is not so alone."""

    def long(v, *more):
        for _ in range(30):
            v = barrier.fixed_sum(barrier.product(v, y), v)
        return jnp.where(y[0] < y[1], v, x[2]), sum(more, v) * v

    def none(v, *_):
        return jnp.zeros_like(v), jnp.zeros_like(v)

    def where(is_taken, *operands):
        return lax.cond(is_taken, long, none, *operands)

    condition, other = y[0] < y[1], y[1] < y[2]
    first, second = where(condition, y)
    third, fourth = where(condition, y, first)
    fifth = lax.cond(other, lambda *v: where(condition, *v)[0], lambda v, *_: v, y, second, third)

    def turn(state):
        k, v = state
        once = where(condition, v, fourth)
        return k + 1, where(condition, y, *once)[0]

    return third, fifth, lax.while_loop(lambda s: s[0] < 3, turn, (jnp.int32(0), y))[1], where(condition, y, x[0])[1]


def _counting(x, y):
    """Loops over an index: known where it is unrolled, not where it is a loop."""
    picked = lax.fori_loop(0, 5, lambda k, c: barrier.fixed_sum(c, x[k]), y)
    put = lax.fori_loop(
        1, 4, lambda k, c: lax.dynamic_update_index_in_dim(c, barrier.product(c[k - 1], y), k, axis=0), x
    )
    counted = lax.scan(lambda c, k: (c + k, c), jnp.int32(0), jnp.arange(5, dtype=np.int32))
    return picked, put, counted


def _long(x, y):
    """Bodies that are longer than what fits one function, with loops in them."""

    def turn(c, row):
        for k in range(12):
            c = barrier.fixed_sum(barrier.product(c, row), x[k % 5])
        n, small, _ = _halved(x, c)
        for k in range(12):
            c = barrier.difference(barrier.product(c, small), x[k % 5])
        return c, (n, small)

    return lax.scan(turn, y, x), lax.while_loop(lambda s: s[0] < s[1], lambda s: (s[0] + 1, s[1], turn(s[2], y)[0]),
        (jnp.int32(0), jnp.clip(y[1] * 3, 0, 4).astype(np.int32), y))[2]  # fmt: skip


def _ends(x, y):
    """No turns, one, two; loops nobody reads; loops that change nothing; results that are what loops begin with."""
    none = lax.scan(lambda c, row: (c * row, c), y, x[:0])
    one = lax.scan(lambda c, row: (barrier.fixed_sum(c, row), c), y, x[:1])
    two = lax.scan(lambda c, row: (barrier.fixed_sum(c, row), c), y, x[:2], reverse=True)
    lax.scan(lambda c, row: (c * row, c), y, x)
    same = lax.scan(lambda c, row: ((c[1], c[1]), y), (y, y), x)
    never = lax.while_loop(lambda s: jnp.bool_(False), lambda s: s * 2, y)
    only_last = lax.scan(lambda c, row: (barrier.product(c, row), row), y, x)
    return none, one, two, same, never, only_last[0], only_last[1]


def loops():
    """Functions of x (5, 3) and y (3,) with loops and branches."""
    return {
        "carries": _carries,
        "boundaries": _with_boundaries(False),
        "boundaries, in reverse": _with_boundaries(True),
        "nested": _nested,
        "while": _halved,
        "while in scan": _while_in_scan,
        "scan in while": _scan_in_while,
        "while in while": _while_in_while,
        "tables": _tables,
        "slices": _slices,
        "branches": _branches,
        "skipped": _skipped,
        "skipped alike": _skipped_alike,
        "lookups": _lookups,
        "counting": _counting,
        "long": _long,
        "ends": _ends,
    }


def of_loops(dtype, n=19):
    """Arguments of the functions with loops; not all are finite."""
    rng = np.random.default_rng(0)
    x, y = (rng.uniform(-2, 2, (n, *shape)).astype(dtype) for shape in ((5, 3), (3,)))
    y[1], y[2, 1], x[3, 2] = 0, np.nan, 1e3
    return x, y
