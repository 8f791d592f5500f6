"""Kernels for GPUs, without one: run by threads of the CPU, read as text, and assembled by NVIDIA's `ptxas`."""

import functools
import importlib.util
import pathlib
import re
import subprocess
import warnings
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.engine import cpu, cuda, graph, program
from jaxspatial.numerics.errorfree import transforms
from tests.helpers import graphs
from tests.helpers.graphs import assert_same_bits, graph_of, with_numpy
from tests.helpers.marks import slow_but
from tests.helpers.processes import python
from tests.helpers.warps import by_warps

pytest.importorskip("llvmlite.binding")

F32, F64, I32, BOOL = np.float32, np.float64, np.int32, np.bool_
ALL = 10**9  # operations to unroll at most
CAPABILITIES = (75, 90)  # of GPUs without and with the instruction for a maximum that keeps NaN


@pytest.fixture(autouse=True)
def in_64_bits():
    with jax.enable_x64(True):
        yield


def code_of(g, arrays, n, is_summed=()):
    arguments = [cpu.Argument(x[0].size, x.dtype, len(x) != n) for x in arrays]
    results = zip(g.results, graphs.dtypes_of(g), strict=True)
    results = [cpu.Result(x.size, dtype, k in is_summed) for k, (x, dtype) in enumerate(results)]
    return cuda.code_of(g, arguments, results, n)


# -- rows of the batch -------------------------------------------------------------------------------------------------


def rows(n, size):
    """A function of numbers of every size, and arguments."""
    rng = np.random.default_rng(size)
    arrays = [rng.standard_normal((n, size)).astype(F32), rng.integers(0, 9, (n, 3)).astype(I32)]
    arrays += [rng.standard_normal((n, 2)), rng.standard_normal((n, 5)) < 0]

    def f(x, i, y, mask):
        return x[::-1] * x[0], i + 1, (y, y.sum()), ~mask, x.sum() > 0

    return f, arrays


@pytest.mark.parametrize("n", [1, 5, 31, 32, 33, 50, 64, 100])
@pytest.mark.parametrize("size", [1, 7, 8, 33])
def test_rows_are_read_and_written_where_they_are(size, n):
    f, arrays = rows(n, size)
    g = graph_of(f, *arrays)
    assert_same_bits(by_warps(code_of(g, arrays, n), arrays, n), with_numpy(g, arrays))


@pytest.mark.parametrize("longest_row, tile", [(8, 16), (40, 128), (960, 32)])
@pytest.mark.parametrize("n", [5, 40])
def test_what_fits_no_row_of_shared_memory(n, longest_row, tile, monkeypatch):
    """Long arguments are read where they are, long results are written by parts of their columns."""
    monkeypatch.setattr(cuda, "LONGEST_ROW", longest_row)
    monkeypatch.setattr(cuda, "LONGEST_RESULT", 6)
    monkeypatch.setattr(cuda, "TILE", tile)
    f, arrays = rows(n, 70)
    g = graph_of(f, *arrays)
    for longest in (10**9, 20):
        monkeypatch.setattr(cuda, "MOST_OPERATIONS", longest)
        assert_same_bits(by_warps(code_of(g, arrays, n), arrays, n), with_numpy(g, arrays), longest)


@pytest.mark.parametrize("dtype", [F32, F64])
def test_shared_memory_suffices(dtype):
    """Whatever the sizes of arguments and results."""
    dtype = np.dtype(dtype)
    for size in (1, 50, 119, 120, 239, 240, 241, 1000):
        for many in (1, 64, 65, 500):
            g = graph.Graph()
            loads = [g.load(0, j, dtype) for j in range(size)]
            g.results = [np.resize(loads, many), np.array(loads[:1])]
            text = cuda.code_of(
                g, [cpu.Argument(size, dtype)], [cpu.Result(many, dtype), cpu.Result(1, dtype)], 40
            ).text
            assert int(re.search(r"@shared = .*?\[(\d+) x i8\]", text)[1]) <= cuda.MOST_SHARED


@pytest.mark.parametrize("n, warps", [(100, 2), (130, 4), (64, 4)])
def test_several_warps_are_a_block(n, warps, monkeypatch):
    monkeypatch.setattr(cuda, "WARPS", warps)
    f, arrays = rows(n, 7)
    g = graph_of(f, *arrays)
    code = code_of(g, arrays, n)
    assert code.warps == warps
    assert_same_bits(by_warps(code, arrays, n, warps), with_numpy(g, arrays))


@pytest.mark.parametrize("longest_result", [64, 1])
@pytest.mark.parametrize("n", [1, 20, 32, 45, 96])
def test_sums_over_the_states_of_a_warp(n, longest_result, monkeypatch):
    """Each state is in one sum, also where the last warp computes states of the one before."""
    monkeypatch.setattr(cuda, "LONGEST_RESULT", longest_result)
    rng = np.random.default_rng(n)
    x, s = rng.integers(-9, 9, (n, 3)).astype(F32), F32([[2, 3]])
    g = graph_of(lambda x, s: (x * s[0], x[:2] + s, jnp.concatenate([x] * 12)), x, s)
    found = by_warps(code_of(g, [x, s], n, is_summed=[0, 2]), [x, s], n)
    sums = [y.sum(0) for y in (found[0], found[2])]
    assert_same_bits([sums[0], found[1], sums[1]], [(2 * x).sum(0), x[:, :2] + s, np.tile(x, 12).sum(0)])


# -- bits --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [F32, F64, I32, BOOL])
def test_operations_have_the_bits_of_the_graph(dtype):
    arrays = graphs.pairs(dtype, 64)
    g = graph_of(graphs.all_operations(dtype), *arrays)
    assert_same_bits(by_warps(code_of(g, arrays, len(arrays[0])), arrays, len(arrays[0])), with_numpy(g, arrays))


@pytest.mark.parametrize("seed", range(12))
def test_random_functions_have_the_bits_of_the_graph(seed, monkeypatch):
    """With few registers much is computed again, and with few operations a function is several."""
    f, arrays = graphs.random_function(seed)
    n = len(arrays[0])
    monkeypatch.setattr(cuda, "REGISTERS", [33, 40, 200][seed % 3])
    monkeypatch.setattr(cuda, "MOST_OPERATIONS", [10**9, 20, 5][seed // 3 % 3])
    g = graph_of(f, *arrays)
    kept = graph.graph_of(*_traced(f, arrays), most_unrolled=[0, ALL][seed % 2])
    assert_same_bits(by_warps(code_of(kept, arrays, n), arrays, n), with_numpy(g, arrays))


@pytest.mark.parametrize("name", slow_but(["lookups", "while", "skipped alike"], list(graphs.loops())))
def test_loops_have_the_bits_of_the_graph(name):
    f, arrays = graphs.loops()[name], graphs.of_loops(F32)
    g = graph.graph_of(*_traced(f, arrays), most_unrolled=0)
    assert_same_bits(by_warps(code_of(g, arrays, len(arrays[0])), arrays, len(arrays[0])), with_numpy(g, arrays))


def _traced(f, arrays):
    state = [jax.ShapeDtypeStruct(x.shape[1:], x.dtype) for x in arrays]
    return (jax.make_jaxpr(lambda *x: jax.tree.leaves(f(*x)))(*state),)


# -- programs of the library ------------------------------------------------------------------------------------------


@functools.cache
def arm():
    return js.testing.random_mechanism(0, 7, ["revolute"], is_chain=True, dtype=F32)


def tip():
    return arm().body_names[-1]


def closure():
    return [js.LoopClosure("world", tip(), "ball")]


def contacts():
    return js.PointContacts((tip(),), stiffness=F32(1e4), relaxation_time=F32(0.01), friction=F32(0.7), radius=F32(0.1))


def states(mech, n=40):
    rng = np.random.default_rng(1)
    q = np.asarray(js.random_configuration(mech, jax.random.key(0), n, F32))
    return q, *rng.standard_normal((2, n, mech.nv)).astype(F32)


PROGRAMS = {
    "inverse dynamics": lambda q, v, a: js.inverse_dynamics(arm(), q, v, a),
    "forward dynamics": lambda q, v, a: js.forward_dynamics(arm(), q, v, a),
    "mass matrix": lambda q, v, a: js.mass_matrix(arm(), q),
    "a step": lambda q, v, a: js.semi_implicit_step(arm(), q, v, a, F32(1e-3)),
    "gradient": lambda q, v, a: jax.grad(lambda *x: js.forward_dynamics(arm(), *x).sum(), (0, 1, 2))(q, v, a),
    "a step with contact": lambda q, v, a: js.convex_step(arm(), q, v, a, F32(1e-3), contacts=contacts())[:2],
    "inverse kinematics": lambda q, v, a: js.inverse_kinematics(arm(), q, tip(), v[..., :3]),
    "dynamics of a loop": lambda q, v, a: js.constrained_forward_dynamics(arm(), q, v, a, closure()).vdot,
    "a loop that is closed": lambda q, v, a: js.close_loops(arm(), q, closure()),
}
LONG = "a step with contact", "inverse kinematics", "dynamics of a loop", "a loop that is closed"
EACH = [pytest.param(name, marks=[pytest.mark.slow] if name in LONG else []) for name in PROGRAMS]
# Bytes of registers that are written to memory because there are too few. ptxas 13.5 says 0, for these 24 and 60.
SPILLED = {"gradient": 64, "a step with contact": 128}


@functools.cache
def kernel(name):
    """(the graph of a program, its code for batches)."""
    x = states(arm(), 1)
    closed = jax.make_jaxpr(PROGRAMS[name])(*x)
    with jax.enable_x64(False):
        g = graph.graph_of(closed, program._expanded, most_unrolled=cuda.MOST_UNROLLED)
    arguments = [cpu.Argument(y.size, y.dtype) for y in x]
    results = [cpu.Result(int(np.prod(y.shape[1:])), np.dtype(y.dtype)) for y in closed.out_avals]
    return g, cuda.code_of(g, arguments, results, 1000)


# The gradient has the operations of both dynamics, a step those of configurations.
@pytest.mark.parametrize("name", slow_but(["gradient", "a step"], PROGRAMS))
def test_programs_have_the_bits_of_the_cpu(name):
    x = states(arm())
    with jax.enable_x64(False):
        expected = [np.asarray(y).reshape((40, -1)) for y in jax.tree.leaves(jax.jit(PROGRAMS[name])(*x))]
    assert_same_bits(by_warps(kernel(name)[1], x, 40), expected)


def ptxas():
    """The assembler, of the package `nvidia-cuda-nvcc`."""
    package = importlib.util.find_spec("nvidia")
    for folder in (package and package.submodule_search_locations) or ():
        for path in pathlib.Path(folder).glob("*/bin/ptxas*"):
            return path
    return pytest.skip("ptxas is not installed")


@pytest.mark.parametrize("name", EACH)
def test_registers_suffice(name, tmp_path):
    """The assembler takes every program, in which nothing, or little, is written to memory for lack of registers."""
    text = cuda.compiled(kernel(name)[1], 90).text.replace(str(cuda.N_STATES), "1000")
    path = tmp_path / "kernel.ptx"
    path.write_text(text)
    command = [ptxas(), "-arch=sm_90", "-v", path, "-o", tmp_path / "kernel.cubin"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    assert int(re.search(r"(\d+) bytes spill stores", said)[1]) <= SPILLED.get(name, 0), said
    assert int(re.search(r"Used (\d+) registers", said)[1]) <= 255, said


@pytest.mark.parametrize("capability", CAPABILITIES)
def test_nothing_is_contracted_flushed_or_approximated(capability):
    """Each operation is rounded to nearest. A multiply-add is there where the graph has the error of a product."""
    x = np.zeros((50, 2), F32)

    def f(x):
        product, error = transforms.two_product(x[0], x[1])
        return x[0] * x[1] + x[0] - x[1], x[0] / x[1], jnp.sqrt(x[0]), product, error, jnp.maximum(x[0], x[1])

    text = cuda.compiled(code_of(graph_of(f, x), [x], 50), capability).text
    assert f".target sm_{capability}" in text
    assert len(re.findall(r"\bfma\.rn\.f32", text)) == 1
    arithmetic = re.findall(r"\b(?:add|sub|mul|div|sqrt|fma)\.[a-z.]*f32", text)
    assert len(arithmetic) >= 6 and all(x.endswith(".rn.f32") and "ftz" not in x for x in arithmetic), arithmetic
    assert ".approx" not in text and ".ftz" not in text


def lowered(n, function=PROGRAMS["inverse dynamics"]):
    """The text of a program for a GPU."""
    cuda._COMPILED.clear()
    is_here = mock.patch.object(cuda, "is_available", lambda: True)
    with is_here, mock.patch.object(cuda, "_capability", lambda: 90), jax.enable_x64(False):
        traced = jax.jit(lambda *x: function(*x)).trace(*states(arm(), n))
        return traced.lower(lowering_platforms=("cuda",)).as_text()


def test_a_program_is_one_kernel():
    """With its grid, one thread for a state; the text for other numbers of states is the same but for their number."""
    for n, blocks, threads in ((5, 1, 32), (1000, 32, 32), (2**18, 2**18 // 128, 128)):
        text = lowered(n, PROGRAMS["a step"])
        assert text.count("stablehlo.custom_call") == 1 and "@__gpu$xla.gpu.ptx" in text
        assert f"grid_x = {blocks} : i32" in text and f"block_x = {threads} : i32" in text
        assert "output_indices = [3 : i32, 4 : i32]" in text
        assert n < 32 or f"n_states = {n};" in text
    many, more = (re.sub(r"n_states = \d+", "", lowered(n)) for n in (1000, 1001))
    assert re.search('kernel_data = "(.*?)"', many)[1] == re.search('kernel_data = "(.*?)"', more)[1]


def test_kernels_are_kept_on_disk():
    """Beside the programs of XLA."""
    code = kernel("inverse dynamics")[1]
    cuda._COMPILED.clear()
    text = cuda.compiled(code, 90).text
    cuda._COMPILED.clear()
    with mock.patch.object(cpu.llvm, "parse_assembly", None):
        assert cuda.compiled(code, 90).text == text


def test_kernels_are_let_go():
    code = kernel("inverse dynamics")[1]
    held = cuda.compiled(code, 90)
    assert cuda.compiled(code, 90) is held
    del held
    assert (code, 90) not in cuda._COMPILED


def test_without_a_gpu_xla_compiles_and_nothing_is_said():
    """A program may be lowered for another machine."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not cuda.is_available.__wrapped__()


@pytest.mark.parametrize("fault", ["an error", "another number"])
def test_a_gpu_that_computes_something_else_is_said_to_once(fault, monkeypatch):
    def called(code, arrays, n):
        if fault == "an error":
            raise RuntimeError("no such target")
        return [arrays[0] + 1]

    monkeypatch.setattr(cuda, "_called", called)
    monkeypatch.setattr(jax, "local_devices", lambda backend: jax.devices("cpu"))
    with pytest.warns(UserWarning, match="no such target" if fault == "an error" else "squared is"):
        assert not cuda.is_available.__wrapped__()
    monkeypatch.setattr(cuda, "_called", lambda code, arrays, n: [arrays[0] ** 2])
    assert cuda.is_available.__wrapped__()


# -- several GPUs ------------------------------------------------------------------------------------------------------

DEVICES = """
import jax, numpy as np
from jax.sharding import NamedSharding, PartitionSpec as P
from jaxspatial.engine import cpu, cuda

number = np.dtype(np.float32)
arguments = cpu.Argument(3, number), cpu.Argument(2, number, True)
code = cuda.Code("", 1, arguments, (cpu.Result(3, number), cpu.Result(2, number, True)))
sizes = []


def called(code, arrays, n):
    x, y = arrays
    assert x.shape == (n, 3) and y.shape == (1, 2)
    sizes.append(n)
    return [2 * x, (x[:, :2] * y).sum(0, keepdims=True)]


cuda._called = called
mesh = jax.make_mesh((2, 2), ("a", "b"), axis_types=(jax.sharding.AxisType.Auto,) * 2)
x, y = np.arange(96, dtype=np.float32).reshape((32, 3)), np.ones((1, 2), np.float32)
for spec, n in ((P(("a", "b")), 8), (P("b"), 16), (P(), 32)):
    places = NamedSharding(mesh, spec), NamedSharding(mesh, P())
    sizes.clear()
    program = jax.jit(lambda x, y: cuda.call(code, [x, y], 32, 4)).lower(*map(jax.device_put, (x, y), places)).compile()
    double, total = program(*map(jax.device_put, (x, y), places))
    assert n in sizes and (np.asarray(double) == 2 * x).all() and (np.asarray(total) == x[:, :2].sum(0)).all()
    assert double.sharding.is_equivalent_to(places[0], 2), double.sharding
    assert "all-gather" not in program.as_text() and ("all-reduce" in program.as_text()) == (n < 32)
print("done")
"""


def test_each_device_computes_its_states():
    assert python("-c", DEVICES, n_devices=4).stdout.strip() == "done"
