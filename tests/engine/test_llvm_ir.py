"""The IR of graphs: for any number of states side by side, in pieces of any length, it has the bits of the graph."""

import ctypes
import functools
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxspatial.engine import cpu, graph, llvm_ir
from jaxspatial.numerics.errorfree import barrier, transforms
from tests.helpers import graphs
from tests.helpers.graphs import assert_same_bits, by_itself, code_of, graph_of, in_handler, with_numpy, with_xla
from tests.helpers.marks import slow

llvm = pytest.importorskip("llvmlite.binding")

F32, F64, I32, U32, I64, BOOL = np.float32, np.float64, np.int32, np.uint32, np.int64, np.bool_
ALL = 10**9  # operations to unroll at most
is_x86 = pytest.mark.skipif(not llvm.get_process_triple().startswith(("x86_64", "amd64")), reason="of x86")
OLD = {
    "no vectors of 64 bytes": cpu.Target("x86-64-v3", ""),
    "no multiply-add": cpu.Target("x86-64", ""),
}


@pytest.fixture(autouse=True)
def in_64_bits():
    """And with programs that are split at every loop that may be, however short."""
    with jax.enable_x64(True), mock.patch.object(llvm_ir, "LEAST_SPLIT", 0):
        yield


@functools.cache
def of_operations(dtype):
    """(the graph of all operations, arguments, the results)."""
    with jax.enable_x64(True):
        arrays = graphs.pairs(dtype)
        g = graph_of(graphs.all_operations(dtype), *arrays)
        return g, arrays, with_numpy(g, arrays)


@pytest.mark.parametrize("width", [1, 4, 8, 16])
@pytest.mark.parametrize("dtype", [F32, F64, I32, U32, I64, BOOL])
def test_operations_have_the_bits_of_the_graph(dtype, width):
    g, arrays, expected = of_operations(dtype)
    assert_same_bits(by_itself(code_of(g, width, arrays), arrays), expected)


@is_x86
@pytest.mark.parametrize("target", OLD.values(), ids=OLD)
@pytest.mark.parametrize("dtype", [F32, F64, I32])
def test_old_processors_have_the_same_bits(dtype, target):
    g, arrays, expected = of_operations(dtype)
    code = code_of(g, 4, arrays, target)
    assert_same_bits(by_itself(code, arrays, target), expected)


@pytest.mark.parametrize("dtype", [F32, BOOL, *map(slow, (F64, I32, U32, I64))])
def test_operations_have_the_bits_of_xla_where_subnormal_numbers_are_flushed(dtype):
    g, arrays, _ = of_operations(dtype)
    expected = with_xla(graphs.all_operations(dtype), arrays)
    assert_same_bits(in_handler(code_of(g, 16, arrays), arrays), expected)


@pytest.mark.parametrize("has_fma", [True, False])
@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("dtype", [F32, F64])
def test_the_error_of_a_product_needs_no_multiply_add(dtype, width, has_fma):
    rng = np.random.default_rng(0)
    reach = 60 if dtype == F32 else 500
    a, b = (rng.standard_normal((2, 997)) * 2.0 ** rng.integers(-reach, reach, (2, 997))).astype(dtype)
    info = np.finfo(dtype)
    near = [info.max, info.max * (1 - info.eps), (1 - 2.0**-26) * info.max, 1 + info.eps]
    a[:4], b[:4] = near, [1 - info.eps, -0.75, 0.5, 1 + info.eps]
    g = graph_of(transforms.two_product, a, b)
    written = llvm_ir.ir_of(g, width, [False, False], has_fma)
    assert ("llvm.fma" in written.text) == has_fma
    sizes = (cpu.Argument(1, a.dtype),) * 2, (cpu.Result(1, a.dtype),) * 2
    code = cpu.Code(written.text, width, *sizes, written.frame_bytes)
    p, e = by_itself(code, (a, b))
    expected = with_numpy(g, (a, b))
    # Where the error is subnormal, or a number is so small that its lower half would be, digits are lost.
    usual = np.isfinite(p[:, 0]) & (np.abs(p[:, 0]) > info.tiny / info.eps)
    usual &= np.minimum(np.abs(a), np.abs(b)) > info.tiny / info.eps
    assert usual.sum() > 500
    assert_same_bits([p, e[usual]], [expected[0], expected[1][usual]])


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("dtype", [F32, F64])
def test_what_is_fused_is_one_instruction(dtype, width):
    arrays = graphs.factors(dtype)
    g = graph_of(graphs.fused, *arrays, may_fuse=True)
    code = code_of(g, width, arrays)
    # a b + c is there once, and the piece is called, too.
    assert code.text.count("call") == 3 + 1 and "fmul" not in code.text
    assert_same_bits(by_itself(code, arrays), with_numpy(g, arrays))


@is_x86
@pytest.mark.parametrize("dtype", [F32, F64])
def test_nothing_is_fused_where_the_processor_does_not(dtype):
    arrays, target = graphs.factors(dtype), OLD["no multiply-add"]
    code = code_of(graph_of(graphs.fused, *arrays, may_fuse=True), 4, arrays, target)
    assert_same_bits(by_itself(code, arrays, target), with_numpy(graph_of(graphs.fused, *arrays), arrays))


@pytest.mark.parametrize("width", [1, 16])
def test_arguments_that_all_states_share(width):
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((21, 6, 3)).astype(F32), rng.standard_normal((1, 3)).astype(F32)
    mask = np.array([[True, False, True]])

    def f(x, y, mask):
        def turn(c, row):
            return lax.select(mask, barrier.product(c, row), c), (row, mask)

        return lax.scan(turn, y, x), lax.scan(turn, y, x * y[0]), lax.scan(lambda c, r: (c - r, r), x[0, 0], y)

    with mock.patch.object(graph, "MOST_UNROLLED", 0):
        g = graph_of(f, x, y, mask)
    assert_same_bits(by_itself(code_of(g, width, (x, y, mask)), (x, y, mask)), with_numpy(g, (x, y, mask)))


# -- loops and pieces --------------------------------------------------------------------------------------------------


@functools.cache
def of_loops(most_unrolled, dtype):
    """(the graph of all functions with loops, arguments, the results)."""
    with jax.enable_x64(True), mock.patch.object(graph, "MOST_UNROLLED", most_unrolled):
        arrays = graphs.of_loops(dtype)
        g = graph_of(lambda *x: [f(*x) for f in graphs.loops().values()], *arrays)
        return g, arrays, with_numpy(g, arrays)


CASES = [
    (0, 1500, 1, F32), (0, 50, 8, F64), (0, 5, 4, F32), (ALL, 1500, 16, F32),
    *(slow(*x) for x in [(0, 1500, 16, F32), (0, 50, 1, F64), (0, 5, 16, F32), (ALL, 50, 1, F32), (ALL, 5, 8, F64)]),
]  # fmt: skip


@pytest.mark.parametrize("most_unrolled, longest, width, dtype", CASES)
def test_loops_have_the_bits_of_the_graph(most_unrolled, longest, width, dtype):
    g, arrays, expected = of_loops(most_unrolled, dtype)
    with mock.patch.object(llvm_ir, "LONGEST", longest):
        code = code_of(g, width, arrays)
    assert_same_bits(by_itself(code, arrays), expected)


def test_loops_kept_and_unrolled_have_the_same_bits():
    assert_same_bits(of_loops(0, np.float32)[2], of_loops(ALL, np.float32)[2])


@pytest.mark.parametrize("seed", range(30))
def test_random_functions_have_the_bits_of_the_graph(seed):
    f, arrays = graphs.random_function(seed)
    with mock.patch.object(graph, "MOST_UNROLLED", [0, ALL][seed % 2]):
        g = graph_of(f, *arrays)
    with mock.patch.object(llvm_ir, "LONGEST", [5, 20, 1500][seed % 3]):
        code = code_of(g, [1, 4, 8, 16][seed // 2 % 4], arrays)
    assert_same_bits(by_itself(code, arrays), with_numpy(g, arrays))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 400))
def test_more_random_functions_have_the_bits_of_the_graph(seed):
    test_random_functions_have_the_bits_of_the_graph(seed)


@pytest.mark.parametrize("seed", [*range(3), *(slow(k) for k in range(3, 60))])
def test_random_functions_in_the_handler_have_the_bits_of_xla(seed):
    f, arrays = graphs.random_function(1000 + seed)
    g = graph_of(f, *arrays)
    assert_same_bits(in_handler(code_of(g, [16, 8, 4][seed % 3], arrays), arrays), with_xla(f, arrays))


# -- programs that are split at a loop ---------------------------------------------------------------------------------


def many_turns(x, turns, mask, shared):
    """A loop of any number of turns, which reads all that a loop can read, and changes numbers of three kinds."""
    last, rows = lax.scan(lambda c, row: (c * row, c + row), x[0], x)
    is_up = mask & (x[:3] > 0)

    def inner(state):
        a, k = state
        return a * shared[k] + last, k + 1

    def turn(state):
        a, k, is_odd, b = state
        a, _ = lax.while_loop(lambda s: (s[1] < 3) & (s[0] < 2), inner, (a, jnp.int32(0)))
        place = k[None] * 5 % 16
        a = lax.select(is_up[0], a - x.at[place].get(mode="clip")[0], a * x.dtype.type(0.5))
        b = lax.select((is_up | is_odd) & mask[1], b + rows[:3] * a, b - shared.at[place].get(mode="clip")[0])
        return a, k + 1, ~is_odd, b

    start = x[1], turns.dtype.type(0) * turns[0], mask, x[1:4]
    a, k, is_odd, b = lax.while_loop(lambda s: s[1] < turns[0], turn, start)
    return a, k[None], is_odd, b * last, rows + a


def of_many_turns(n, dtype, seed=0, integer=I32):
    """(the graph, arguments of n states). Most states need few turns, some many."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (n, 16)).astype(dtype)
    turns = (np.minimum(rng.geometric(0.3, (n, 1)) - 1, 40) * rng.choice([0, 1, 1, 9], (n, 1))).astype(integer)
    arrays = x, turns, rng.random((n, 3)) < 0.5, rng.uniform(-1, 1, (1, 16)).astype(dtype)
    with mock.patch.object(graph, "MOST_UNROLLED", 0):
        return graph_of(many_turns, *arrays), arrays


def split(g, width, arrays, longest=5):
    with mock.patch.object(llvm_ir, "LONGEST", longest):
        code = code_of(g, width, arrays)
    assert code.is_split == (width > 1)
    return code


@pytest.mark.parametrize("width, dtype", [(1, F32), (4, F64), (8, F64), (16, F32)])
def test_split_programs_have_the_bits_of_the_graph(width, dtype):
    g, arrays = of_many_turns(700, dtype, integer=I64 if width == 16 else I32)
    expected = with_numpy(g, arrays)
    code = split(g, width, arrays)
    assert_same_bits(by_itself(code, arrays), expected)
    for n in (1, 2, width, width + 1, 127, 130, 700):
        some = [x[-n:] if len(x) > 1 else x for x in arrays]
        assert_same_bits(in_handler(code, some), [x[-n:] for x in expected])


@pytest.mark.parametrize(
    "few, few_together, together", [(0, 0, 1 << 20), (0.9, 0.9, 1 << 20), (0.1, 0.5, 1 << 13), (0.5, 0.75, 1)]
)
def test_when_states_are_brought_together_does_not_matter(few, few_together, together):
    g, arrays = of_many_turns(300, F32, seed=1)
    code = split(g, 16, arrays)
    places = {"FEW": few, "FEW_TOGETHER": few_together, "TOGETHER": together}
    with mock.patch.multiple(cpu, **places):
        cpu._COMPILED.clear()
        assert_same_bits(in_handler(code, arrays), with_numpy(g, arrays))


@is_x86
@pytest.mark.parametrize("target", OLD.values(), ids=OLD)
def test_split_programs_on_old_processors(target):
    g, arrays = of_many_turns(200, F32, seed=3)
    with mock.patch.object(llvm_ir, "LONGEST", 5):
        code = code_of(g, 8, arrays, target)
    assert_same_bits(in_handler(code, arrays, target), with_numpy(g, arrays))


def test_sums_over_states_of_split_programs():
    """They have the bits of those of a program that is not split."""
    g, arrays = of_many_turns(700, F32, seed=2)
    code = split(g, 16, arrays)
    results = tuple(x._replace(is_summed=x.dtype.kind != "b") for x in code.results)
    found, expected = (in_handler(code._replace(results=results, is_split=s), arrays) for s in (True, False))
    assert_same_bits(found, expected)


def test_turns_end_where_few_states_go_on():
    """The states that are asked for alone are counted, and each keeps what it has where it is done."""
    turns = np.arange(16, dtype=I32)[:, None]
    g, (x, _, *rest) = of_many_turns(16, F32)
    arrays = x, turns, *rest
    code, expected = split(g, 16, arrays), with_numpy(g, arrays)
    engine = cpu._loaded(cpu._object([code.text], cpu.host()), cpu.host())
    ((*memory, _),), results = graphs.in_columns(code, arrays)

    def function(name, result, *more):
        kinds = [ctypes.c_void_p] * 3 + [ctypes.c_int64] * len(more)
        return ctypes.CFUNCTYPE(result, *kinds)(engine.get_function_address(name))(*memory, *more)

    function("before", None)
    done = 0
    for states, few in ((0xFFFF, 12), (0xFFFF, 12), (0xF0FF, 4), (0xFFFF, 1), (0x0FFF, 0), (0xFFFF, 0)):
        left = function("turns", ctypes.c_int64, states, few)
        asked = [k for k in range(16) if states >> k & 1]
        done = max(done, sorted(turns[asked, 0])[-1 - few])
        assert left == sum(1 << k for k in asked if turns[k, 0] > done)
    function("after", None)
    assert_same_bits([graphs._rows(y, r, 16) for r, y in zip(code.results, results, strict=True)], expected)


# -- planted faults ----------------------------------------------------------------------------------------------------


@functools.cache
def examples():
    """By operation a graph with it, arguments, and the results."""
    found = {}
    with jax.enable_x64(True):
        of_factors = [(f, graphs.factors(F64), f is graphs.fused) for f in (graphs.fused, transforms.two_product)]
        more = [
            (graph_of(f, *x[:n], may_fuse=fused), x[:n]) for (f, x, fused), n in zip(of_factors, (3, 2), strict=True)
        ]
        given = [of_operations(d) for d in (F32, F64, I32, U32, I64, BOOL)] + [
            (g, x, with_numpy(g, x)) for g, x in more
        ]
        for g, arrays, results in given:
            for nodes in llvm_ir.Scheduler(g).members.values():
                for name in map(g.operations.__getitem__, nodes):
                    found.setdefault(name, (g, arrays, results))
    return found


def test_every_operation_has_an_example():
    assert set(examples()) == set(graph.EVALUATE)


@pytest.mark.slow
@pytest.mark.parametrize("name", graph.EVALUATE)
def test_an_operation_that_does_nothing_is_seen(name):
    """In the code it has the value of its first operand, or 0, where that is of another type."""
    g, arrays, expected = examples()[name]
    written = llvm_ir.Writer._instructions

    def faulty(self, operation, dtype, of, is_usual):
        if operation != name:
            return written(self, operation, dtype, of, is_usual)
        x = "{1}" if dtype == of else "zeroinitializer"
        return [f"{{0}} = select i1 true, {self.type(dtype)} {x}, {self.type(dtype)} {x}"]

    with mock.patch.object(llvm_ir.Writer, "_instructions", faulty):
        found = by_itself(code_of(g, 8, arrays), arrays)
    with pytest.raises(AssertionError):
        assert_same_bits(found, expected)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(graph.EVALUATE) - {"product_error", "fma"}))
def test_an_operation_of_the_graph_that_does_nothing_is_seen(name):
    """By XLA. Of products and sums rounded once, exact numbers are the reference, see `test_graph`."""
    dtype = next(d for d in (F32, F64, I32, U32, I64, BOOL) if of_operations(d)[0] is examples()[name][0])
    _, arrays, _ = of_operations(dtype)
    f = graphs.all_operations(dtype)
    expected = with_xla(f, arrays)

    def differ():
        return [(x != y) & ((x == x) | (y == y)) for x, y in zip(with_numpy(g, arrays), expected, strict=True)]

    g = graph_of(f, *arrays)
    before = differ()
    fault = lambda d, a, *_: a if np.asarray(a).dtype == d else np.zeros(np.shape(a), d)  # noqa: E731
    with mock.patch.dict(graph.EVALUATE, {name: fault}):
        assert any((y & ~x).any() for x, y in zip(before, differ(), strict=True))


# -- the text ----------------------------------------------------------------------------------------------------------


def chain(n):
    """A chain of n sums, of which none is needed much later than it is made."""

    def f(x):
        for k in range(n):
            x = barrier.fixed_sum(barrier.product(x, x), x) if k % 2 else barrier.difference(x, barrier.product(x, x))
        return x

    return graph_of(f, np.zeros((1, 1), F32))


def test_a_long_graph_is_several_functions_which_use_memory_again():
    with mock.patch.object(llvm_ir, "LONGEST", 20):
        few, many = (llvm_ir.ir_of(chain(n), 16, [False]) for n in (50, 200))
    assert (few.n_operations, many.n_operations) == (100, 400)
    assert few.text.count("define internal") == 5 and many.text.count("define internal") == 20
    assert few.frame_bytes == many.frame_bytes <= 4 * 64


def test_what_branches_with_one_condition_pass_on_costs_where_it_is_taken():
    """No zeros in its place elsewhere, and no selection: neither of what the branch makes, nor inside of it."""

    def long(v):
        return functools.reduce(barrier.fixed_sum, [v] * graph.LEAST_SKIPPED)

    def f(x, is_read):
        def skipped(v):
            return lax.cond(x[0] > 0, lambda v: jnp.where(x[0] > 0, long(v), 0), jnp.zeros_like, v)

        first = skipped(x)
        return (skipped(first), first) if is_read else skipped(first)

    def counted(is_read):
        text = llvm_ir.ir_of(graph_of(functools.partial(f, is_read=is_read), np.zeros((1, 3), F32)), 16, [False]).text
        return text.count(" select "), text.count("store <16 x float> splat (float 0x0000000000000000)")

    assert counted(is_read=False) == (3, 3) and counted(is_read=True) == (6, 6)


def test_a_window_of_a_table_is_read_by_rows():
    """Of a cell its four corners: an index is taken apart once, and moved into the table once; two reads of two."""
    windows = lax.GatherDimensionNumbers((0, 1), (), (0, 1))

    def f(table, place):
        cell = place.astype(I32)
        return lax.gather(table.reshape((4, 5)), cell, windows, (2, 2), mode="promise_in_bounds")

    g = graph_of(f, np.zeros((1, 20), F32), np.zeros((16, 2), F32))
    names = [g.operations[n] for n in llvm_ir.Scheduler(g).live]
    assert {x: names.count(x) for x in ("lookup", "min", "max", "mul", "add")} == {
        "lookup": 4, "min": 2, "max": 2, "mul": 1, "add": 1,
    }  # fmt: skip
    text = llvm_ir.ir_of(g, 16, [True, False]).text
    assert text.count("extractelement") == 16 and text.count("load <2 x float>") == 32 and "insertelement" not in text


def test_the_text_of_a_graph_is_the_same_each_time():
    f, arrays = graphs.random_function(3)
    first, second = (llvm_ir.ir_of(graph_of(f, *arrays), 8, [False] * 3).text for _ in range(2))
    assert first == second


def test_nothing_may_be_contracted_or_assumed():
    g, _, _ = of_operations(F32)
    words = set(llvm_ir.ir_of(g, 16, [False, False]).text.split())
    assert not words & {"fast", "contract", "reassoc", "nnan", "ninf", "nsz", "arcp", "afn", "nsw", "nuw", "exact"}


@pytest.mark.parametrize("width", [1, 4])
@pytest.mark.parametrize("triple", ["aarch64-linux-gnu", "arm64-apple-macosx"])
def test_code_for_arm_has_every_operation_and_no_other(triple, width):
    """Compiled here, and read: a product and a sum that follow each other stay two instructions."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(triple).create_target_machine(opt=2)
    module = llvm.parse_assembly(llvm_ir.ir_of(chain(100), width, [False]).text)
    lines = [line.split() for line in machine.emit_assembly(module).splitlines()]
    names = [words[0].partition(".")[0] for words in lines if words and words[0].startswith("f")]
    counts = {name: names.count(name) for name in set(names)}
    assert counts["fmul"] == 100 and counts["fadd"] == counts["fsub"] == 50
    assert not set(counts) & {"fmadd", "fmsub", "fnmadd", "fnmsub", "fmla", "fmls"}
    g, arrays = of_many_turns(16, F32)
    with mock.patch.object(llvm_ir, "LONGEST", 5):
        split_text = llvm_ir.ir_of(g, width, [len(x) == 1 for x in arrays]).text
    found = machine.emit_assembly(llvm.parse_assembly(split_text))
    assert all((f"{name}:" in found) == (width > 1) for name in ("before", "turns", "after", "lent", "returned"))


def test_a_graph_without_operations():
    x = np.arange(12, dtype=F32).reshape((4, 3))
    g = graph_of(lambda x: (x[::-1], np.float64(2), x[:0]), x)
    assert_same_bits(by_itself(code_of(g, 4, [x]), [x]), with_numpy(g, [x]))
