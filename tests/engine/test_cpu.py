"""Code compiled by LLVM and called over batches: the bits of NumPy, whatever the batch, the layout and the threads."""

import concurrent.futures
import ctypes
import gc
import importlib.util
import mmap
import pathlib
import subprocess
import sys
import threading
import time
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspatial.engine import cpu
from jaxspatial.engine.cpu import Argument, Code, Result
from tests.helpers.processes import python

llvm = pytest.importorskip("llvmlite.binding")

F32, F64, I8, I32, BOOL = (np.dtype(x) for x in (np.float32, np.float64, np.int8, np.int32, np.bool_))
NAMES = {F32: "float", F64: "double", I8: "i8", I32: "i32", BOOL: "i8"}
BATCHES = [1, 2, 3, 15, 16, 17, 63, 64, 65, 127, 128, 129, 1000, 4096, 100_003]
IS_X86 = llvm.get_process_triple().startswith(("x86_64", "amd64"))


class Body:
    """Writes `@block` by hand: vectors of states, and numbers of all states spread over the lanes."""

    def __init__(self, width, arguments, results):
        self.width, self.arguments, self.results, self.lines = width, arguments, results, []
        self.tables = [self.add(f"load ptr, ptr {self.place('%arguments', 8 * i)}") for i in range(len(arguments))]
        self.outputs = [self.add(f"load ptr, ptr {self.place('%results', 8 * i)}") for i in range(len(results))]

    def add(self, text):
        self.lines.append(f"%v{len(self.lines)} = {text}")
        return f"%v{len(self.lines) - 1}"

    def place(self, base, n_bytes):
        return self.add(f"getelementptr i8, ptr {base}, i64 {n_bytes}")

    def vector(self, dtype):
        return f"<{self.width} x {NAMES[dtype]}>"

    def load(self, i, j):
        x = self.arguments[i]
        kind = self.vector(x.dtype)
        if not x.is_shared:
            return self.add(
                f"load {kind}, ptr {self.place(self.tables[i], j * self.width * x.dtype.itemsize)}, {self.align(x)}"
            )
        one = self.add(f"load {NAMES[x.dtype]}, ptr {self.place(self.tables[i], j * x.dtype.itemsize)}")
        one = self.add(f"insertelement {kind} undef, {NAMES[x.dtype]} {one}, i32 0")
        return self.add(f"shufflevector {kind} {one}, {kind} undef, <{self.width} x i32> zeroinitializer")

    def align(self, x):
        # What the interface promises, so that a place off a line of the cache would crash.
        return f"align {x.dtype.itemsize if self.width == 1 else min(64, self.width * x.dtype.itemsize)}"

    def op(self, name, dtype, x, y):
        return self.add(f"{name} {self.vector(dtype)} {x}, {y}")

    def store(self, i, j, value):
        x = self.results[i]
        place = self.place(self.outputs[i], j * self.width * x.dtype.itemsize)
        self.lines.append(f"store {self.vector(x.dtype)} {value}, ptr {place}, {self.align(x)}")
        self.lines.append(f"%v{len(self.lines)} = add i8 0, 0")

    def code(self, **fields):
        lines = "\n  ".join(self.lines)
        head = "define void @block(ptr noalias %arguments, ptr noalias %results, ptr noalias %frame)"
        return Code(f"{head} {{\n  {lines}\n  ret void\n}}\n", self.width, self.arguments, self.results, **fields)


def plain(width, size=5, dtype=F32, **fields):
    """y = x x + s, with one s for all states."""
    body = Body(width, (Argument(size, dtype), Argument(1, dtype, True)), (Result(size, dtype),))
    times, plus = ("fmul", "fadd") if dtype.kind == "f" else ("mul", "add")
    for j in range(size):
        x = body.load(0, j)
        body.store(0, j, body.op(plus, dtype, body.op(times, dtype, x, x), body.load(1, 0)))
    return body.code(**fields)


def summed(width, size=3, dtype=F32, **fields):
    """The sum of x y over all states, and the products of each."""
    body = Body(width, (Argument(size, dtype), Argument(size, dtype)), (Result(size, dtype, True), Result(size, dtype)))
    for j in range(size):
        product = body.op("fmul" if dtype.kind == "f" else "mul", dtype, body.load(0, j), body.load(1, j))
        body.store(0, j, product)
        body.store(1, j, product)
    return body.code(**fields)


def numbers(shape, dtype, seed=0):
    rng = np.random.default_rng(seed)
    if dtype.kind == "f":
        return rng.standard_normal(shape).astype(dtype)
    return rng.integers(0, 2 if dtype == BOOL else 100, shape).astype(dtype)


def run(code, *arrays, n=None, target=None):
    held = cpu.compiled(code, target)
    n = len(arrays[0]) if n is None else n
    results = jax.jit(lambda *x: cpu.call(code, x, n, target))(*arrays)
    jax.block_until_ready(results)
    assert held
    return [np.asarray(x) for x in results]


def same(x, y):
    assert x.dtype == y.dtype and x.shape == y.shape
    np.testing.assert_array_equal(x.view(np.uint8), y.view(np.uint8))


def test_it_is_available():
    assert cpu.is_available()


def test_it_is_found_out_while_jax_traces_too():
    cpu.is_available.cache_clear()
    with jax.transfer_guard("disallow"):
        jax.eval_shape(lambda x: x + int(cpu.is_available()), jax.ShapeDtypeStruct((), np.int32))
    assert cpu.is_available.cache_info().currsize == 1


def test_it_is_found_out_on_a_mesh_too():
    """Of which no device is known, and in the middle of a `shard_map` outside of `jit`."""
    mesh = jax.make_mesh((1,), ("batch",), axis_types=(jax.sharding.AxisType.Explicit,))

    def found(x):
        cpu.is_available.cache_clear()
        return x + int(cpu.is_available())

    with jax.sharding.use_abstract_mesh(mesh.abstract_mesh):
        assert found(0) == 1
    assert jax.shard_map(found, mesh=mesh, in_specs=jax.P(), out_specs=jax.P())(0) == 1


def test_it_warns_once_where_it_is_not(monkeypatch):
    monkeypatch.setattr(cpu, "_PROBE", cpu._PROBE.replace("fmul", "fadd"))
    cpu.is_available.cache_clear()
    try:
        with pytest.warns(UserWarning, match="does not compile programs"):
            assert not cpu.is_available()
        assert not cpu.is_available()
    finally:
        cpu.is_available.cache_clear()


def test_without_llvmlite(monkeypatch):
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    monkeypatch.delitem(sys.modules, "llvmlite.binding")
    spec = importlib.util.spec_from_file_location("cpu_without", cpu.__file__)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "cpu_without", module)
    spec.loader.exec_module(module)
    with pytest.warns(UserWarning, match="does not compile programs"):
        assert not module.is_available()


@pytest.mark.parametrize("width", [1, 8, 16])
def test_batches_of_any_size(width):
    code = plain(width)
    held = cpu.compiled(code)
    for n in BATCHES:
        x, s = numbers((n, 5), F32), numbers((1, 1), F32, 1)
        same(*run(code, x, s), x * x + s)
    assert held


@pytest.mark.parametrize("dtype", [F32, I8], ids=str)
@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 40])
def test_rows_of_any_length(size, dtype):
    x, s = numbers((37, size), dtype), numbers((1, 1), dtype, 1)
    same(*run(plain(16, size, dtype), x, s), x * x + s)


@pytest.mark.parametrize("width", [4, 8, 32])
@pytest.mark.parametrize("dtype", [F32, I8], ids=str)
def test_other_widths(width, dtype):
    x, s = numbers((75, 19), dtype), numbers((1, 1), dtype, 1)
    same(*run(plain(width, 19, dtype), x, s), x * x + s)


@pytest.mark.parametrize("width", [1, 8, 16])
def test_dtypes_side_by_side(width):
    kinds = F32, F64, I32, BOOL
    body = Body(
        width,
        tuple(Argument(i + 2, x) for i, x in enumerate(kinds)),
        tuple(Result(i + 2, x) for i, x in enumerate(kinds)),
    )
    for i, x in enumerate(kinds):
        for j in range(i + 2):
            name = {"f": "fadd", "i": "add", "b": "xor"}[x.kind]
            body.store(i, j, body.op(name, x, body.load(i, j), body.load(i, (j + 1) % (i + 2))))
    with jax.enable_x64(True):
        arrays = [numbers((29, i + 2), x) for i, x in enumerate(kinds)]
        results = run(body.code(), *arrays)
    for x, y in zip(arrays, results, strict=True):
        same(y, (x ^ np.roll(x, -1, 1)) if x.dtype == BOOL else x + np.roll(x, -1, 1))
    with pytest.raises(TypeError, match="64"):
        run(plain(width, 5, F64), numbers((3, 5), F64), numbers((1, 1), F64))


def test_no_array_for_the_states():
    """All is shared and summed: there is one state."""
    body = Body(8, (Argument(1, F32, True),), (Result(1, F32, True),))
    body.store(0, 0, body.load(0, 0))
    same(*run(body.code(), np.float32([[3]]), n=1), np.float32([[3]]))


def in_order(x, width):
    """The order in which columns are summed: lanes over blocks, pairs of lanes, pairs of chunks."""
    rows = []
    for chunk in np.split(x, range(cpu.CHUNK, len(x), cpu.CHUNK)):
        lanes = np.zeros((width, x.shape[1]), x.dtype)
        for block in np.split(chunk, range(width, len(chunk), width)):
            lanes[: len(block)] += block
        while len(lanes) > 1:
            lanes = lanes[::2] + lanes[1::2]
        rows.append(lanes[0])
    while len(rows) > 1:
        half = (len(rows) + 1) // 2
        rows = [a + b for a, b in zip(rows, rows[half:], strict=False)] + rows[len(rows) - half : half]
    return rows[0][None]


@pytest.mark.parametrize("width", [1, 8, 16])
@pytest.mark.parametrize("dtype", [F32, I32], ids=str)
def test_sums(width, dtype):
    code = summed(width, 3, dtype)
    held = cpu.compiled(code)
    for n in (1, 3, 17, 128, 129, 1000, 5000):
        x, y = numbers((n, 3), dtype), numbers((n, 3), dtype, 1)
        total, products = run(code, x, y)
        same(products, x * y)
        same(total, in_order(x * y, width))
    assert held


def test_threads_do_not_matter():
    """Many states of many operations are shared out: the same bits as by one thread."""
    alone, together = summed(16), summed(16, cost=100_000)
    x, y = numbers((100_003, 3), F32), numbers((100_003, 3), F32, 1)
    x[::3] *= np.float32(1e-39)  # Some products are subnormal: XLA's threads flush them, all alike.
    for one, other in zip(run(alone, x, y), run(together, x, y), strict=True):
        same(one, other)


def test_empty_batches():
    code = summed(16)
    total, products = run(code, *np.zeros((2, 0, 3), np.float32))
    same(total, np.zeros((1, 3), np.float32))
    assert products.shape == (0, 3)


def test_missing_states_repeat_the_last():
    """The code divides by what it reads: it would see zeros or worse past the end of the batch."""
    body = Body(16, (Argument(1, I32),), (Result(1, I32),))
    x = body.load(0, 0)
    body.store(0, 0, body.op("sdiv", I32, x, x))
    x = np.arange(1, 8, dtype=np.int32)[:, None]
    same(*run(body.code(), x), np.ones_like(x))


def test_infinite_lanes_past_the_end_are_not_summed():
    x = np.float32([[np.inf], [1]])[1:]
    total, _ = run(summed(8, 1), x, x)
    same(total, x)


@pytest.mark.skipif(not IS_X86, reason="names processors of one kind")
@pytest.mark.parametrize("make", [plain, summed])
@pytest.mark.parametrize("name", ["x86-64", "haswell"])  # Without and with fused multiply-add, which nothing may use.
def test_any_processor_has_the_same_bits(make, name):
    code, features = make(16), llvm.get_host_cpu_features()
    if name == "haswell" and not (features.get("fma") and features.get("avx2") and features.get("bmi2")):
        pytest.skip("this processor cannot run code for the other")
    x = (
        numbers((77, code.arguments[0].size), F32),
        numbers((1 if make is plain else 77, code.arguments[1].size), F32, 1),
    )
    for one, other in zip(run(code, *x), run(code, *x, target=cpu.Target(name, "")), strict=True):
        same(one, other)


def test_large_memory_of_a_thread():
    code = plain(16, frame_bytes=1 << 20, cost=10**6)
    x, s = numbers((1000, 5), F32), numbers((1, 1), F32, 1)
    same(*run(code, x, s), x * x + s)


def test_inside_of_transformations():
    code = plain(8, 2)
    held = cpu.compiled(code)
    x, s = numbers((21, 2), F32), np.float32([[0.25]])

    def step(x):
        return cpu.call(code, [x, jnp.asarray(s)], 21)[0]

    expected = [x]
    for _ in range(3):
        expected.append(expected[-1] * expected[-1] + s)
    same(np.asarray(step(x)), expected[1])
    same(np.asarray(jax.jit(lambda x: jax.lax.scan(lambda x, _: (step(x), None), x, length=3)[0])(x)), expected[3])
    looped = jax.jit(lambda x: jax.lax.fori_loop(0, jnp.int32(3), lambda _, x: step(x), x))
    same(np.asarray(looped(x)), expected[3])
    assert held


def test_what_does_not_fit():
    with pytest.raises(ValueError, match="power of two"):
        cpu.compiled(plain(6))
    with pytest.raises(ValueError, match="truth"):
        cpu.compiled(summed(8, 1, BOOL))
    with pytest.raises(TypeError, match="of 3 states"):
        cpu.call(plain(8), [jnp.zeros((3, 5)), jnp.zeros((3, 1))], 3)


# ------------------------------------------------------------------------------------------------ life of code


def test_equal_code_is_compiled_once():
    assert cpu.compiled(plain(8, 6)) is cpu.compiled(plain(8, 6))
    assert cpu.compiled(plain(8, 6)) is not cpu.compiled(plain(8, 7))


def test_code_is_freed_and_compiled_again():
    code = plain(8, 6)
    x, s = numbers((9, 6), F32), np.float32([[1]])
    names = []
    for _ in range(3):
        held = cpu.compiled(code)
        names.append(held.name)
        alive = weakref.ref(held)
        same(*run(code, x, s), x * x + s)
        del held
        jax.clear_caches()
        gc.collect()
        assert alive() is None
    assert len(set(names)) == 3


def test_threads_compile_at_once():
    codes = [plain(8, size) for size in range(20, 24)] * 4
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        found = list(pool.map(cpu.compiled, codes))
    assert len(set(map(id, found))) == 4


def test_executables_hold_code_by_themselves():
    """JAX may lose what it holds for an executable that it still calls: XLA holds it, until the executable dies."""
    code = plain(8, 11)
    x, s = numbers((9, 11), F32), np.float32([[1]])
    held = cpu.compiled(code)
    call = jax.jit(lambda *x: cpu.call(code, x, 9)).lower(x, s).compile()
    engine = weakref.ref(held.engine)
    del held
    gc.collect()
    same(np.asarray(call(x, s)[0]), x * x + s)
    assert engine() is not None
    del call
    jax.clear_caches()
    # On a machine with much else to do, a thread of XLA may still be about to let go.
    for _ in range(100):
        gc.collect()
        cpu._free()
        if engine() is None:
            break
        time.sleep(0.05)
    assert engine() is None


def test_machine_code_on_disk(monkeypatch):
    code = plain(8, 14)
    name, texts = cpu.compiled(code).name, (code.text, str(cpu.Handler(code).module))
    path = pathlib.Path(jax.config.jax_compilation_cache_dir) / "jaxspatial" / f"{name}.o"
    written = path.read_bytes()
    path.write_bytes(written[:-1])  # A file that is not whole counts for nothing, and is written again.
    content = cpu._cached(name, texts, cpu.host())
    assert path.read_bytes() == written and content == written[32:]
    monkeypatch.setattr(cpu, "_object", None)
    assert cpu._cached(name, texts, cpu.host()) == content


FOUND_ON_DISK = """
import jax
from jaxspatial.engine import cpu
from tests.engine import test_cpu

hits = []
jax.monitoring.register_event_listener(lambda name, **_: hits.append(name.split("/")[-1]))
cpu._object = None  # Nothing can be compiled.
test_cpu.run_on_disk()
print(hits.count("cache_hits"), hits.count("cache_misses"))
"""


def run_on_disk():
    x, s = numbers((9, 13), F32), np.float32([[1]])
    same(*run(plain(8, 13), x, s), x * x + s)


def test_another_process_finds_both_caches():
    """JAX's own knows the call by the name of the code, which is the same in every process."""
    run_on_disk()
    done = subprocess.run([sys.executable, "-c", FOUND_ON_DISK], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "1 0", done.stderr


# --------------------------------------------------------------------------------------------- threads, by hand


class Pool:
    """Stands in for XLA: a call frame in memory, and threads that begin when the test wants, or at once."""

    def __init__(self, arrays, results, n_threads, is_refused=False, at_once=False):
        self.tasks, self.errors, self.kept = [], 0, []
        self.n_threads, self.is_refused, self.at_once = n_threads, is_refused, at_once
        api = (ctypes.c_void_p * 24)()
        for place, function in ((64, self.destroy), (136, self.schedule), (144, self.count)):
            function = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.POINTER(ctypes.c_void_p))(function)
            api[place // 8] = ctypes.cast(function, ctypes.c_void_p)
            self.kept.append(function)
        self.frame = self.struct(*[0] * 21)
        self.frame[2] = ctypes.addressof(api)
        self.frame[9], self.frame[14] = (self.buffers(x) for x in (arrays, results))
        self.kept += [api, arrays, results]

    def struct(self, *values):
        fields = (ctypes.c_int64 * len(values))(*values)
        self.kept.append(fields)
        return fields

    def buffers(self, arrays):
        dims = [self.struct(*x.shape) for x in arrays]
        buffers = [
            self.struct(48, 0, 0, x.ctypes.data, x.ndim, ctypes.addressof(y)) for x, y in zip(arrays, dims, strict=True)
        ]
        return ctypes.addressof(self.struct(*map(ctypes.addressof, buffers)))

    def destroy(self, request):
        self.errors += 1

    def schedule(self, request):
        if self.is_refused:
            return 1
        self.tasks.append((ctypes.CFUNCTYPE(None, ctypes.c_void_p)(request[3]), request[4]))
        if self.at_once:
            task, job = self.tasks[-1]
            self.tasks[-1] = threading.Thread(target=task, args=(job,))
            self.tasks[-1].start()

    def count(self, request):
        ctypes.c_int64.from_address(request[3]).value = self.n_threads

    def call(self, held):
        assert not ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p)(held.address)(ctypes.addressof(self.frame))


def by_hand(n_threads, n=5000, **options):
    x, y = numbers((n, 3), F32), numbers((n, 3), F32, 1)
    results = np.zeros((1, 3), np.float32), np.zeros((n, 3), np.float32)
    code = summed(16, cost=100_000)
    held = cpu.compiled(code)
    pool = Pool((x, y), results, n_threads, **options)
    pool.call(held)
    same(results[1], x * y)
    same(results[0], in_order(x * y, 16))
    return pool, held


def holders(held):
    return cpu._number(held.engine, "holders").value


def test_tasks_that_begin_when_all_is_done():
    """No chunk is left for them. They hold the code, which the caller may have dropped."""
    pool, held = by_hand(4)
    assert len(pool.tasks) == holders(held) == 3
    for k, (task, job) in enumerate(pool.tasks):
        task(job)
        assert holders(held) == 2 - k


@pytest.mark.parametrize("n_threads", [2, 3])
def test_threads_that_take_several_chunks_at_a_time(n_threads):
    n = cpu.RUNS * n_threads * 3 * cpu.CHUNK - 1
    for _ in range(5):
        pool, held = by_hand(n_threads, n, at_once=True)
        for thread in pool.tasks:
            thread.join()
        assert len(pool.tasks) == n_threads - 1 and holders(held) == 0


def test_no_thread_is_asked_for_little_work_or_where_there_is_one():
    assert not by_hand(1)[0].tasks
    x, s = numbers((5000, 5), F32), numbers((1, 1), F32)
    pool = Pool((x, s), (np.zeros_like(x),), 4)
    held = cpu.compiled(plain(16, cost=10))
    pool.call(held)
    assert not pool.tasks


def test_threads_that_are_refused():
    pool, held = by_hand(4, is_refused=True)
    assert pool.errors == 3 and holders(held) == 0


def between_walls(array, place):
    """A copy of an array at the end, or at the start, of memory that nothing around it may touch."""
    page = mmap.PAGESIZE
    n = -(-array.nbytes // page) * page
    memory = mmap.mmap(-1, n + 2 * page)
    start = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    for wall in (start, start + page + n):
        assert not ctypes.CDLL(None).mprotect(ctypes.c_void_p(wall), ctypes.c_size_t(page), 0)
    copy = np.frombuffer(memory, array.dtype, array.size, page + (n - array.nbytes if place == "end" else 0))
    copy = copy.reshape(array.shape)
    copy[...] = array
    return copy


@pytest.mark.skipif(sys.platform != "linux", reason="asks the system to protect memory")
@pytest.mark.parametrize("place", ["start", "end"])
def test_nothing_outside_of_the_arrays_is_touched(place):
    for width, dtype in ((16, F32), (8, I8), (1, F32)):
        for size in (1, 3, 7, 13):
            held = cpu.compiled(plain(width, size, dtype))
            for n in (1, 15, 16, 17, 130):
                x, s = numbers((n, size), dtype), numbers((1, 1), dtype, 1)
                arrays = [between_walls(a, place) for a in (x, s, np.zeros_like(x))]
                Pool(arrays[:2], arrays[2:], 1).call(held)
                same(arrays[2], x * x + s)


# -------------------------------------------------------------------------------------------------- devices


DEVICES = """
import jax, numpy as np
from jax.extend.core import Primitive
from jax.interpreters import mlir
from jax.sharding import NamedSharding, PartitionSpec as P
from jaxspatial.engine import cpu
from jaxspatial.engine.cpu import Argument, Result
from jaxspatial.numerics.errorfree.primitives import n_devices
from tests.engine.test_cpu import F32, Body, numbers, plain, summed

mesh = jax.make_mesh((2, 2), ("a", "b"), axis_types=(jax.sharding.AxisType.Auto,) * 2)


def lower(context, *arrays, code):
    held = cpu.compiled(code)
    context.module_context.add_keepalive(held)
    function = lambda *x: cpu.call(code, x, context.avals_in[0].shape[0], n_devices=n_devices(context))
    return mlir.lower_fun(function, multiple_results=True)(context, *arrays)


program = Primitive("program")
program.multiple_results = True
program.def_abstract_eval(lambda x, *_, code: [
    jax.core.ShapedArray((1 if y.is_summed else x.shape[0], y.size), y.dtype) for y in code.results
])
mlir.register_lowering(program, lower, platform="cpu")


def compared(code, spec, arrays, expected):
    n, is_split = len(arrays[0]), len(spec) > 0 and spec[0] is not None
    places = [NamedSharding(mesh, spec if len(x) == n else P()) for x in arrays]
    call = jax.jit(lambda *x: program.bind(*x, code=code)).lower(*map(jax.device_put, arrays, places)).compile()
    text = call.as_text()
    assert "all-gather" not in text or spec == P(None, "b"), text
    assert ("all-reduce" in text) == (is_split and any(x.is_summed for x in code.results)), text
    for x, y, z in zip(code.results, call(*map(jax.device_put, arrays, places)), expected, strict=True):
        if x.is_summed:
            np.testing.assert_allclose(y, z, rtol=1e-5, atol=1e-5)
        else:
            assert y.sharding.is_equivalent_to(NamedSharding(mesh, spec if is_split else P()), 2), y.sharding
            assert (np.asarray(y) == z).all()


many = Body(8, (Argument(1, F32),) * 25, (Result(1, F32, True),))
many.store(0, 0, many.load(24, 0))
for n, spec in ((64, P(("a", "b"))), (64, P("b")), (64, P(None, "b")), (64, P()), (30, P())):
    x, y, s = numbers((n, 4), F32), numbers((n, 4), F32, 1), np.float32([[0.5]])
    compared(plain(8, 4), spec, (x, s), [x * x + s])
    compared(summed(8, 4), spec, (x, y), [(x * y).sum(0, keepdims=True), x * y])
    if spec != P(None, "b"):
        compared(many.code(), spec, [x[:, :1]] * 25, [x[:, :1].sum(0, keepdims=True)])
x, s = numbers((64, 4), F32), np.float32([[0.5]])
manual = jax.shard_map(
    lambda x, s: program.bind(x, s, code=plain(8, 4))[0],
    mesh=mesh,
    in_specs=(P("a"), P()),
    out_specs=P("a"),
    check_vma=False,
)
assert (np.asarray(jax.jit(manual)(x, s)) == x * x + s).all()
print("done")
"""


def test_states_split_over_devices():
    assert python("-c", DEVICES, n_devices=4).stdout.strip() == "done"
