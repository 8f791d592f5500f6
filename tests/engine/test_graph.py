"""Graphs of traces: what they compute, by NumPy, is what XLA computes; nothing is computed twice or for nobody."""

import functools
from fractions import Fraction
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from jaxspatial.engine import cpu, graph, llvm_ir, program, xla
from jaxspatial.numerics.errorfree import barrier, transforms
from jaxspatial.numerics.jax_internals import jaxpr_as_fun
from tests.helpers import graphs
from tests.helpers.graphs import assert_same_bits, fused, graph_of, with_numpy, with_xla
from tests.helpers.marks import slow

F32, F64, I32, U32, I64, BOOL = np.float32, np.float64, np.int32, np.uint32, np.int64, np.bool_
ALL = 10**9  # operations to unroll at most


@pytest.fixture(autouse=True)
def in_64_bits():
    with jax.enable_x64(True):
        yield


def counted(g):
    """How often each operation is needed for results."""
    names = [g.operations[n] for nodes in llvm_ir.Scheduler(g).members.values() for n in nodes]
    return {name: names.count(name) for name in sorted(set(names))}


def of_state(f, *shapes, dtype=F32):
    return graph_of(f, *(np.zeros((1, *shape), dtype) for shape in shapes))


# -- operations --------------------------------------------------------------------------------------------------------


def is_small(x, factor=1):
    """Whether XLA takes a number, which is not 0, for 0."""
    if x.dtype.kind != "f":
        return np.zeros(x.shape, bool)
    return (x != 0) & (np.abs(x) < factor * np.finfo(x.dtype).tiny)


def flushed(results):
    return [np.where(is_small(y), np.copysign(y.dtype.type(0), y), y) if y.dtype.kind == "f" else y for y in results]


@pytest.mark.parametrize("dtype", [F32, I32, BOOL, *map(slow, (F64, U32, I64))])
def test_operations_have_the_bits_of_xla(dtype):
    """Of numbers none of whose operations has a subnormal error: these are in `test_llvm_ir`."""
    x, y = graphs.pairs(dtype)
    factor = 2 / np.finfo(dtype).eps if x.dtype.kind == "f" else 1
    at = ~(is_small(x, factor) | is_small(y, factor))
    arrays, f = (x[at], y[at]), graphs.all_operations(dtype)
    assert_same_bits(flushed(with_numpy(graph_of(f, *arrays), arrays)), flushed(with_xla(f, arrays)))


@pytest.mark.parametrize("dtype", [F32, F64])
def test_operations_of_constants_are_constants(dtype):
    arrays, f = graphs.pairs(dtype, 40), graphs.all_operations(dtype)
    expected = with_numpy(graph_of(f, *arrays), arrays)
    g = of_state(lambda _: f(*map(jnp.asarray, arrays)), ())
    assert counted(g) == {}
    assert_same_bits([y.T for y in with_numpy(g, [np.zeros(1, F32)])], expected)


@pytest.mark.parametrize("dtype", [F32, F64])
def test_the_error_of_a_product_is_exact(dtype):
    rng = np.random.default_rng(0)
    reach = 40 if dtype == F32 else 300
    a, b = (rng.standard_normal((2, 500)) * 2.0 ** rng.integers(-reach, reach, (2, 500))).astype(dtype)
    p, e = with_numpy(graph_of(transforms.two_product, a, b), (a, b))
    each = zip(a.tolist(), b.tolist(), p[:, 0].tolist(), e[:, 0].tolist(), strict=True)
    assert all(Fraction(x) * Fraction(y) == Fraction(s) + Fraction(t) for x, y, s, t in each)
    assert np.count_nonzero(e) > 400


@pytest.mark.parametrize("dtype", [F32, F64])
def test_what_is_fused_is_rounded_once(dtype):
    arrays = graphs.factors(dtype)
    results = with_numpy(graph_of(graphs.fused, *arrays, may_fuse=True), arrays)
    a, b, c = (list(map(Fraction, x.tolist())) for x in arrays)
    signs = (1, 1), (1, 1), (1, -1), (-1, 1)
    for y, (of_product, of_other) in zip(results, signs, strict=True):
        exact = [of_product * p * q + of_other * r for p, q, r in zip(a, b, c, strict=True)]
        near = [[np.nextafter(v, x) for x in (dtype(-np.inf), v, dtype(np.inf))] for v in y[:, 0]]
        errors = [[abs(Fraction(float(x)) - e) for x in three] for three, e in zip(near, exact, strict=True)]
        assert all(three[1] == min(three) for three in errors)
    assert (results[0][:, 0] != arrays[0] * arrays[1] + arrays[2]).sum() > 100


def test_only_what_promises_no_bits_is_fused():
    x = np.ones((1, 3), F32)
    assert counted(graph_of(graphs.fused, x, x, x)) == {"add": 6, "mul": 3, "sub": 6}
    # One product is not computed, the other sign is part of the instruction.
    assert counted(graph_of(graphs.fused, x, x, x, may_fuse=True)) == {"fma": 9, "neg": 6}


def test_what_is_rounded_by_itself_is_not_fused():
    """Primitives of the library, products that are read as they are, and what else a product by 1 is."""

    def f(a, b, c):
        p, e = transforms.two_product(a, c)
        alone = barrier.product(a, b)
        return alone + c, 1 * alone + b, barrier.fixed_sum(a * c, b), barrier.difference(b, a * c), p + b, e

    x = np.ones((1,), F32)
    assert "fma" not in counted(graph_of(f, x, x, x, may_fuse=True))


def test_a_part_of_a_trace_is_fused_by_itself():
    """What a program may do, others that it calls, or that call it, need not."""
    x = jnp.ones(())
    outer = jax.make_jaxpr(lambda a, b: lax.erf_inv(a) + a * b)(x, x)
    inner = jax.make_jaxpr(lambda a: a * a + a)(x)
    for may_fuse in (False, True):
        g = graph.graph_of(outer, lambda _, run, x, may=not may_fuse: run(inner, x, may), may_fuse=may_fuse)
        assert counted(g) == {"add": 1, "fma": 1, "mul": 1}


def test_what_moves_numbers_leaves_nothing_behind():
    x = np.arange(1, 31, dtype=F32).reshape((5, 2, 3))
    found = graphs.moves()
    g = graph_of(lambda x: [f(x) for f in found.values()], x)
    assert counted(g) == {}
    assert_same_bits(with_numpy(g, [x]), with_xla(lambda x: [f(x) for f in found.values()], [x]))


def test_reductions():
    x = np.random.default_rng(0).uniform(-2, 2, (20, 2, 3)).astype(F32)
    x[0], x[1, 0], x[2, 0, 0] = -0.0, 0, np.nan

    def f(x):
        return [reduce(x) for reduce in graphs.reductions().values()]

    results, expected = with_numpy(graph_of(f, x), [x]), with_xla(f, [x])
    assert_same_bits(results, expected)


# -- loops and branches ------------------------------------------------------------------------------------------------


@functools.cache
def loops_of_xla():
    """What XLA makes of all functions with loops: one program."""
    with jax.enable_x64(True):
        results = with_xla(lambda *x: [jax.tree.leaves(f(*x)) for f in graphs.loops().values()], graphs.of_loops(F32))
    found = iter(results)
    x, y = graphs.of_loops(F32)
    sizes = [len(jax.tree.leaves(jax.eval_shape(f, x[0], y[0]))) for f in graphs.loops().values()]
    return {name: [next(found) for _ in range(n)] for name, n in zip(graphs.loops(), sizes, strict=True)}


@pytest.mark.parametrize("most_unrolled", [0, ALL])
@pytest.mark.parametrize("name", graphs.loops())
def test_loops_have_the_bits_of_xla(name, most_unrolled):
    arrays = graphs.of_loops(F32)
    with mock.patch.object(graph, "MOST_UNROLLED", most_unrolled):
        g = graph_of(graphs.loops()[name], *arrays)
    assert_same_bits(with_numpy(g, arrays), loops_of_xla()[name])


@pytest.mark.parametrize("seed", [*range(3), *map(slow, range(3, 8))])
def test_random_functions_have_the_bits_of_xla(seed):
    f, arrays = graphs.random_function(seed)
    with mock.patch.object(graph, "MOST_UNROLLED", ALL * (seed % 2)):
        assert_same_bits(with_numpy(graph_of(f, *arrays), arrays), with_xla(f, arrays))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 300))
def test_more_random_functions_have_the_bits_of_xla(seed):
    test_random_functions_have_the_bits_of_xla(seed)


def test_a_loop_is_kept_where_it_is_long():
    def f(x, y):
        return lax.scan(lambda c, row: (barrier.fixed_sum(c, row), None), y, x)[0]

    for length in (graph.MOST_UNROLLED + 1, graph.MOST_OF_MANY + 1):
        g = of_state(f, (length, 1), (1,))
        assert len(g.loops) == 1 and counted(g) == {"add": 1}
    g = of_state(f, (10, 1), (1,))
    assert len(g.loops) == 0 and counted(g) == {"add": 10}


def test_a_loop_that_does_the_same_in_each_turn_is_kept():
    def turn(_, c):
        for _ in range(graph.MOST_REPEATED // 10):
            c = barrier.product(c, c)
        return c

    assert [len(of_state(lambda x, n=n: lax.fori_loop(0, n, turn, x), (1,)).loops) for n in (5, 20)] == [0, 1]


def test_known_integers_split_a_loop():
    at = np.array([0, 0, 0, 5, 0, 0, 0, 0], I32)

    def f(x, y):
        def turn(c, row):
            picked = lax.cond(row[1] > 0, lambda: lax.dynamic_slice(y, (row[1],), (1,)), lambda: row[0])
            return barrier.fixed_sum(c, picked), None

        return lax.scan(turn, y[:1], (x, jnp.asarray(at)))[0]

    with mock.patch.object(graph, "MOST_UNROLLED", 0):
        g = of_state(f, (8, 1), (9,))
    # Three rows, one with a slice whose place is known, and four: no selection is left.
    assert [loop.length for loop in g.loops] == [3, 4] and counted(g) == {"add": 3}


def test_what_a_loop_does_not_change_is_in_front_of_it():
    def f(x, y):
        def turn(c, row):
            fixed, c = c
            once = barrier.product(fixed, y) / barrier.fixed_sum(y, fixed)
            return (fixed, barrier.fixed_sum(c, barrier.product(row, once))), once

        return lax.scan(turn, (y, y), x)

    with mock.patch.object(graph, "MOST_UNROLLED", 0):
        g = of_state(f, (6, 1), (1,))
    order = llvm_ir.Scheduler(g)
    inside = [g.operations[n] for n in order.members[g.loops[-1].region]]
    assert sorted(inside) == ["add", "mul"]
    assert sorted(g.operations[n] for n in order.members[0]) == ["add", "div", "mul"]
    # What is stacked in each turn is one number, which is not stacked.
    assert order.live_loops == {len(g.loops) - 1} and not g.loops[-1].stacked


# -- nothing twice, nothing for nobody ---------------------------------------------------------------------------------


def test_what_is_found_again_is_one_node():
    g = of_state(lambda x, y: [(x + y) * (x + y), jax.jit(lambda a: a + y)(x), jnp.stack([x + y, y])], (2,), (2,))
    assert counted(g) == {"add": 2, "mul": 2}


def test_conversions_to_different_types_are_different_nodes():
    g = of_state(lambda x: [x.astype(I32), x.astype(U32), x.astype(I32), x.view(I32), x.view(U32)], ())
    assert counted(g) == {"bitcast": 2, "convert": 2}


def test_constants_fold():
    c = np.array([1.0, 2.0, 0.5], F32)
    g = of_state(lambda x: barrier.product(x, barrier.product(jnp.asarray(c), jnp.asarray(2 - c))), (3,))
    # 1 (2 - 1) = 1, 2 (2 - 2) = 0 and 0.5 (2 - 0.5) = 0.75: a product with 0 stays, as x may be infinite.
    assert counted(g) == {"mul": 2}


def test_simple_operations_leave_nothing_behind():
    def f(x, m):
        yes = jnp.full(m.shape, True)
        return [
            lax.select(m, x, x), lax.select(yes, x, -x), lax.neg(lax.neg(x)), x * jnp.ones_like(x),
            x / jnp.ones_like(x), m & yes, m | yes, m & m, m | ~yes, lax.stop_gradient(x), barrier.barrier(x),
            x.astype(F32),
        ]  # fmt: skip

    g = graph_of(f, np.zeros((1, 2), F32), np.zeros((1, 2), bool))
    assert counted(g) == {}


def test_zeros_that_have_a_sign_stay():
    assert counted(of_state(lambda x: [x + 0, x - 0, 0 - x, x * 0], ())) == {"add": 1, "mul": 1, "sub": 2}


def test_what_nobody_reads_is_not_computed():
    def f(x, y):
        _ = y * y
        last, (rows, squares) = lax.scan(lambda c, r: (c + r, (c * r, c - r)), y, x)
        return last, squares[1]

    with mock.patch.object(graph, "MOST_UNROLLED", 0):
        g = of_state(f, (7, 1), (1,))
    assert counted(g) == {"add": 1, "sub": 1}


def test_a_branch_within_a_branch_of_the_same_condition():
    """It is known there."""

    def long(y):
        return functools.reduce(barrier.fixed_sum, [y] * graph.LEAST_SKIPPED, y)

    def f(x):
        inner = lambda y: lax.cond(x[0] > 0, long, lambda y: y, 2 * y)  # noqa: E731
        return lax.cond(x[0] > 0, lambda y: long(inner(y)), lambda y: y, x)

    g = of_state(f, (1,))
    for x in np.float32([[3], [-3]]):
        (found,) = with_numpy(g, [x[None]])
        np.testing.assert_array_equal(found[0], f(x))


def test_a_long_branch_is_computed_where_it_is_taken():
    """Not in front of the loop around it, although nothing in the loop changes what it reads."""

    def f(x):
        def turn(state):
            k, y = state
            long = lambda y: functools.reduce(barrier.fixed_sum, [x] * graph.LEAST_SKIPPED, y)  # noqa: E731
            return k + 1, lax.cond(y[0] > 0, lambda _: long(x), lambda y: y, y)

        return lax.while_loop(lambda state: state[1][0] < 9, turn, (jnp.int32(0), x))[1]

    g = of_state(f, (1,))
    (branch,) = (x for x in g.loops if x.is_branch and x.region in {g.regions[n] for n in llvm_ir.Scheduler(g).live})
    adds = [n for n in llvm_ir.Scheduler(g).live if g.operations[n] == "add" and g.dtypes[n] == F32]
    assert len(adds) == graph.LEAST_SKIPPED and {g.regions[n] for n in adds} == {branch.region}


# -- what graphs do not have -------------------------------------------------------------------------------------------

NOT_SUPPORTED = {
    "sine": lambda x: jnp.sin(x),
    "dot of several dtypes": lambda x: lax.dot(x, x, preferred_element_type=F64),
    "cumsum": lambda x: jnp.cumsum(x),
    "gather of what is computed": lambda x: (x * 2).at[(x * 3).astype(I32)].get(mode="clip"),
    "gather that may miss": lambda x: x.at[(x * 3).astype(I32)].get(mode="fill"),
    "gather of rows": lambda x: jnp.stack([x, x]).at[(x * 3).astype(I32)].get(mode="clip"),
    "gather of masks": lambda x: jnp.asarray(np.eye(3)[0] > 0).at[(x * 3).astype(I32)].get(mode="clip"),
    "scatter": lambda x: x.at[(x[0] * 3).astype(I32)].set(1),
    "sort": lambda x: jnp.sort(x),
    "half precision": lambda x: x.astype(np.float16),
    "complex": lambda x: lax.complex(x, x),
    "cube": lambda x: x**3,
    "halves away from zero": lambda x: lax.round(x, lax.RoundingMethod.AWAY_FROM_ZERO),
    "fewer exponents": lambda x: lax.reduce_precision(x, 5, 10),
    "bits of another size": lambda x: lax.bitcast_convert_type(x, np.uint8),
    "several cases": lambda x: lax.select_n((x * 3).astype(I32), x, x, x),
    "reduction of nothing": lambda x: jnp.sum(x[:0]),
    "negative padding": lambda x: lax.pad(x, F32(0), ((-1, 0, 0),)),
    "unknown place": lambda x: lax.dynamic_slice(
        jnp.stack([x, x]), (x[0].astype(I32), x[1].astype(I32)), (1, 1)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", NOT_SUPPORTED)
def test_what_is_not_supported_is_said(name):
    with pytest.raises(graph.NotSupportedError):
        of_state(NOT_SUPPORTED[name], (3,))


class Custom(program.Program):
    """A program of one function of numbers of each state."""

    def __init__(self, f):
        self.f = f

    def evaluate(self, *arrays):
        return [self.f(*arrays)]

    def outputs(self, avals):
        return [avals[0]]


@pytest.mark.parametrize("f, is_native", [(lambda x: barrier.product(x, x), True), (jnp.sin, False)])
def test_a_program_without_a_graph_takes_the_way_of_xla(f, is_native):
    if not cpu.is_available():
        pytest.skip("LLVM is not here")
    x = jnp.linspace(0, 1, 40, dtype=F32).reshape((20, 2))
    custom = Custom(f)
    lowered = jax.jit(lambda x: program.bind(custom, [x], 1)).lower(x)
    assert ("jaxspatial_" in lowered.as_text().split("custom_call")[-1]) == is_native
    np.testing.assert_allclose(lowered.compile()(x)[0], f(x), rtol=1e-6)


# -- rounding, where XLA compiles a trace ------------------------------------------------------------------------------


def assert_xla_has_the_bits(f, found, *arrays):
    """Of what a graph found, where XLA compiles the trace, and no library is called: in a loop, too."""

    def in_a_loop(*arrays):
        return lax.fori_loop(0, 1, lambda _, x: x + f(*arrays), jnp.zeros(found.shape, found.dtype))

    for g in (f, in_a_loop):
        closed = xla.rounded_as_in_graphs(jax.make_jaxpr(g)(*arrays), has_plain_products=True)
        lowered = jax.jit(jaxpr_as_fun(closed)).lower(*arrays)
        assert all(name not in lowered.as_text() for name in ("lapack", "stablehlo.dot"))
        np.testing.assert_array_equal(lowered.compile()(*arrays)[0], found)


# Of x (3, 20) and y (20, 2): of at most 64 terms.
ROUNDED = {
    "product": lambda x, y: x @ y,
    "products over two axes": lambda x, y: jnp.einsum("ij,jk,ij->k", x, y, x),
    "products of one term": lambda x, y: jnp.einsum("i,k->ik", x[:, 0], y[0]),
    "sum": lambda x, y: jnp.sum(x, 1),
    "sum over two axes": lambda x, y: jnp.sum(x * x),
    "fused": lambda x, y: jnp.stack(fused(x[:, :2], y[:3], x[:, 2:4])),
    "square": lambda x, y: x**2 + lax.square(x / 3),
    "quotient by what all share": lambda x, y: x / y[0, 0],
    "root": lambda x, y: 1 / jnp.sqrt(abs(x)),
}


@pytest.mark.parametrize("name", ROUNDED)
def test_xla_rounds_as_a_graph(name):
    rng = np.random.default_rng(0)
    f, arrays = ROUNDED[name], [rng.standard_normal((7, *shape)).astype(F32) for shape in ((3, 20), (20, 2))]
    (found,) = with_numpy(graph_of(f, *arrays), arrays)
    shape = jax.eval_shape(jax.vmap(f), *arrays).shape
    assert_xla_has_the_bits(jax.vmap(f), found.reshape(shape), *arrays)


@pytest.mark.parametrize("n", [0, 64, 65])
def test_what_xla_adds(n):
    """Sums of more than 64 terms, and of none: a loop over all states of a batch would take long."""
    x = np.ones((2, n), F32)
    closed = xla.rounded_as_in_graphs(jax.make_jaxpr(lambda x: (x.sum(1), x @ x.T))(x), has_plain_products=True)
    lowered = jax.jit(jaxpr_as_fun(closed)).lower(x)
    assert ("stablehlo.while" in lowered.as_text()) == (n == 64) != ("stablehlo.reduce" in lowered.as_text())
    total, product = lowered.compile()(x)
    assert (total == n).all() and (product == n).all()


@pytest.mark.parametrize("n", [1, 2, 5])
def test_factors_are_those_of_numpy(n):
    rng = np.random.default_rng(n)
    A = rng.standard_normal((20, 2, n, n))
    A = A @ A.swapaxes(-1, -2) + np.eye(n)
    (L,) = with_numpy(graph_of(jnp.linalg.cholesky, A), [A])
    np.testing.assert_allclose(L.reshape(A.shape), np.linalg.cholesky(A), rtol=1e-12, atol=1e-12)
    assert_xla_has_the_bits(jnp.linalg.cholesky, L.reshape(A.shape), A)


@pytest.mark.parametrize("is_lower", [True, False])
@pytest.mark.parametrize("is_transposed", [True, False])
@pytest.mark.parametrize("is_left", [True, False])
@pytest.mark.parametrize("is_unit", [True, False])
def test_triangular_systems_are_solved(is_lower, is_transposed, is_left, is_unit):
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((7, 3, 3)) + 4 * np.eye(3), rng.standard_normal((7, 3, 2))
    b = b if is_left else b.swapaxes(-1, -2)
    options = dict(left_side=is_left, lower=is_lower, transpose_a=is_transposed, unit_diagonal=is_unit)
    solve = functools.partial(lax.linalg.triangular_solve, **options)
    (x,) = with_numpy(graph_of(solve, a, b), [a, b])
    if is_lower == is_left and is_transposed != is_unit:
        # Each value of each option is among these four.
        assert_xla_has_the_bits(solve, x.reshape(b.shape), a, b)
    x, whole = x.reshape(b.shape), np.tril(a) if is_lower else np.triu(a)
    whole = np.where(np.eye(3, dtype=bool), 1, whole) if is_unit else whole
    whole = whole.swapaxes(-1, -2) if is_transposed else whole
    np.testing.assert_allclose(whole @ x if is_left else x @ whole, b, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("pivot", [0.0, -1.0, np.nan])
def test_a_matrix_that_is_not_positive_has_no_factor(pivot):
    A = np.diag([1, pivot, 1])[None]
    (L,) = with_numpy(graph_of(jnp.linalg.cholesky, A), [A])
    assert np.isnan(L.reshape((3, 3))[1, 1])
    assert_xla_has_the_bits(jnp.linalg.cholesky, L.reshape(A.shape), A)


# -- how long a trace is -----------------------------------------------------------------------------------------------


def _solved(x):
    A = x @ x.T + 4 * jnp.eye(6, dtype=x.dtype)
    return lax.linalg.triangular_solve(lax.linalg.cholesky(A, symmetrize_input=False), x, left_side=True, lower=True)


# Of x (6, 6).
SIZED = {
    "elementwise": lambda x: (barrier.product(x, x), lax.square(x).astype(np.int32)),
    "product": lambda x: x @ x,
    "sum": lambda x: jnp.sum(x, 0),
    "factors": _solved,
    "while": lambda x: lax.while_loop(lambda x: x[0, 0] < 9, lambda x: x * x + x, x),
    "branches": lambda x: lax.cond(x[0, 0] < 0, lambda x: x * x, lambda x: x + x, x),
    "called": jax.jit(lambda x: x * x),
    "program": lambda x: program.bind(Custom(lambda x: x * x - x / 3), [x[None]], 1)[0],
    "sums": lambda x: js.shift(js.SpatialForce(tau=x[0, :3], f=x[0, 3:]), x[1, :3], precision="compensated").tau,
}


@pytest.mark.parametrize("name", SIZED)
def test_a_trace_is_about_as_long_as_its_graph(name):
    """By this it is decided which loops are unrolled, and which branches are skipped."""
    closed = jax.make_jaxpr(SIZED[name])(jax.ShapeDtypeStruct((6, 6), F32))
    g = graph.graph_of(closed, program._expanded)
    n = sum(x not in ("load", "constant", "carried", "last") for x in g.operations)
    size = graph._Builder(program._expanded, graph.MOST_UNROLLED, False)._size(closed.jaxpr)
    assert 0.6 * n <= size <= 2.1 * n, (size, n)
