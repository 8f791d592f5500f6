"""Programs as machine code have the bits of XLA's plain way, and of graphs in NumPy, whatever JAX does to them."""

import concurrent.futures
import contextlib
import functools
import gc
import os
import re
import threading
import weakref

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax import lax
from jax.sharding import PartitionSpec as P

import jaxspatial as js
from jaxspatial.engine import cpu, graph, llvm_ir, program
from jaxspatial.numerics.errorfree.primitives import compiled
from tests.engine.test_cpu import in_order
from tests.helpers import algorithms, exact_dynamics
from tests.helpers.marks import slow, slow_but
from tests.helpers.processes import python

if not cpu.is_available():
    pytest.skip("programs take XLA's way here", allow_module_level=True)

F = np.float32
ARM = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=F)
DT = F(0.01)


def states(*shape, dtype=F, seed=0):
    """Positions, velocities and a third such array of the arm."""
    return tuple(np.random.default_rng(seed).standard_normal((3, *shape, 2)).astype(dtype))


# -- three ways to run a program ---------------------------------------------------------------------------------------


def _by_numpy(made, native, n, arrays):
    """Stands in for `program._natively`: each state of the graph by NumPy, and sums in the order of machine code."""
    avals = [program._aval(x, 1) for x in arrays]
    traced = made.traced(avals)
    whole = graph.graph_of(traced.closed, program._expanded, may_fuse=made.may_fuse)
    is_shared = [x.shape[0] != n for x in arrays]
    primals = [made.primal_of(i) for i in range(len(traced.out_avals))]
    is_summed = [p is not None and is_shared[p] for p in primals]
    width = 1 if n == 1 else cpu.width_of(whole)

    def results(*numbers):
        found = graph.run(whole, *map(np.asarray, numbers))
        found = [np.broadcast_to(y, (n, y.shape[1])) for y in found]
        return [in_order(y, width) if yes else y for y, yes in zip(found, is_summed, strict=True)]

    each = zip(traced.out_avals, is_summed, strict=True)
    shapes = [jax.ShapeDtypeStruct((1 if yes else n, int(np.prod(a.shape))), a.dtype) for a, yes in each]
    flat = jax.pure_callback(results, shapes, *arrays)
    return [y.reshape((y.shape[0], *a.shape[1:])) for y, a in zip(flat, traced.out_avals, strict=True)]


@contextlib.contextmanager
def way(name):
    """Runs programs as machine code, "native", by XLA, "xla", or by their graphs, "numpy". Yields how many of them ran
    as machine code."""
    natively, n_native = program._natively, []

    def counted(*arguments):
        results = natively(*arguments)
        n_native.append(results is not None)
        return results

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(program, "_natively", _by_numpy if name == "numpy" else counted)
        if name == "xla":
            patch.setattr(cpu, "is_available", lambda: False)

        # A program would remember what was compiled of it in another way.
        def compiled_primitive(self, n_batch):
            return compiled(program.program_p, program=self, n_batch=n_batch)

        patch.setattr(program.Program, "compiled_primitive", compiled_primitive)
        yield n_native


def run(name, function, *arguments, is_jitted=True):
    """The results by one of the ways, as NumPy arrays."""
    with way(name) as n_native:
        # JAX has never seen this function, whose program it would remember from another way.
        call = jax.jit(lambda *x: function(*x)) if is_jitted else function
        results = jax.tree.map(np.asarray, call(*arguments))
    assert n_native.count(True) == len(n_native) and bool(n_native) == (name == "native")
    return results


def same(found, expected):
    found, expected = jax.tree.leaves(found), jax.tree.leaves(expected)
    for x, y in zip(found, expected, strict=True):
        assert x.dtype == y.dtype and x.shape == y.shape
        np.testing.assert_array_equal(x, y)
        assert np.isfinite(x).all() and x.any()


def compared(function, *arguments, ways=("numpy", "xla")):
    found = run("native", function, *arguments)
    for other in ways:
        same(found, run(other, function, *arguments))
    return found


# -- transformations ---------------------------------------------------------------------------------------------------


def _inverse(*state):
    return js.inverse_dynamics(ARM, *state)


def _step(q, v, tau):
    return js.semi_implicit_step(ARM, q, v, tau, DT)


def _vmap_of_vmap(q, v, vdot):
    """Over different axes of each argument, of which the velocities have none."""
    q, vdot = jnp.swapaxes(q, 1, 2), jnp.swapaxes(vdot, 0, 1)
    return jax.vmap(jax.vmap(_inverse, (1, None, 0)), (0, None, 1), 1)(q, v[0, 0], vdot)


def _shared(q, v, vdot):
    """By vmap, and by shapes that broadcast."""
    return jax.vmap(_inverse, (0, None, 0))(q, v[0], vdot), _inverse(q[0], v[0], vdot)


def _of_data(q, v, vdot):
    """A mechanism that is data, one for all states."""
    return jax.jit(js.inverse_dynamics)(ARM.as_data(), q, v, vdot)


def _of_masses(q, v, vdot):
    """A mechanism for each state."""
    many = jax.tree.map(lambda x: jnp.stack([x * F(1 + i / 8) for i in range(len(q))]), ARM.as_data())
    return jax.vmap(js.inverse_dynamics)(many, q, v, vdot)


def _jvp(q, v, vdot):
    return jax.jvp(_inverse, (q, v, vdot), (v, vdot, q))


def _vjp(q, v, vdot):
    return jax.vjp(_inverse, q, v, vdot)[1](q)


def _vjp_of_shared(q, v, vdot):
    """Cotangents are added up over the states, in machine code or by XLA."""
    return (
        jax.vjp(lambda v: _inverse(q, v, vdot), v[0])[1](q),
        jax.vjp(lambda v: jax.vmap(_inverse, (0, None, 0))(q, v, vdot), v[0])[1](q),
    )


def _grad(q, v, _):
    return jax.vmap(jax.grad(functools.partial(js.kinetic_energy, ARM), (0, 1)))(q, v)


def _hessian(q, v, _):
    return jax.vmap(jax.hessian(functools.partial(js.kinetic_energy, ARM)))(q, v)


def _scan(q, v, tau):
    return lax.scan(lambda x, _: (_step(*x, tau), x), (q, v), length=3)


def _gradient_of_scan(q, v, tau):
    return jax.vjp(lambda *x: _scan(*x)[0], q, v, tau)[1]((v, q))


def _while(q, v, tau):
    return lax.while_loop(lambda x: x[0] < 3, lambda x: (x[0] + 1, _step(*x[1], tau)), (jnp.int32(0), (q, v)))[1]


def _cond(q, v, tau):
    """One branch for all states, and one for each, where both are computed."""

    def chosen(q, v, tau):
        return lax.cond(q[..., 0].sum() > 0, _inverse, lambda q, v, tau: _inverse(v, tau, q), q, v, tau)

    return chosen(q, v, tau), jax.vmap(chosen)(q, v, tau)


def _checkpoint(q, v, tau):
    return jax.vjp(jax.checkpoint(lambda *x: _inverse(*x)), q, v, tau)[1](q)


TRANSFORMED = (
    _inverse,
    _vmap_of_vmap,
    _shared,
    _of_data,
    _of_masses,
    _jvp,
    _vjp,
    _vjp_of_shared,
    _grad,
    _hessian,
    _scan,
    _gradient_of_scan,
    _while,
    _cond,
    _checkpoint,
)


@pytest.mark.parametrize("function", [slow(f) if f is _gradient_of_scan else f for f in TRANSFORMED])
def test_transformations_have_the_bits_of_graphs(function):
    compared(function, *states(*(3, 7) if function is _vmap_of_vmap else (17,)), ways=["numpy"])


@pytest.mark.parametrize("function", slow_but([_scan], [f for f in TRANSFORMED if f is not _vjp_of_shared]))
def test_transformations_have_the_bits_of_xla(function):
    compared(function, *states(*(3, 7) if function is _vmap_of_vmap else (17,)), ways=["xla"])


@pytest.mark.slow
def test_sums_over_states_have_the_numbers_of_xla():
    """Which adds them up in another order."""
    both = (run(name, _vjp_of_shared, *states(17)) for name in ("native", "xla"))
    for x, y in zip(*map(jax.tree.leaves, both), strict=True):
        np.testing.assert_allclose(x, y, rtol=1e-5, atol=1e-5)


def test_outside_of_jit():
    """Eager, and operation by operation, where each turn of a loop calls machine code."""
    x = states(5)
    same(run("native", _inverse, *x, is_jitted=False), run("native", _inverse, *x))
    scanned = run("native", _scan, *x)
    with jax.disable_jit():
        same(run("native", _scan, *x, is_jitted=False), scanned)
        same(run("native", jax.vmap(_inverse), *x, is_jitted=False), run("numpy", _inverse, *x))


@pytest.mark.slow
def test_contacts():
    """A step with contact: a while loop in a program, which states leave at different turns."""
    law = {"stiffness": F(1e4), "relaxation_time": F(0.01), "friction": F(0.5)}
    tip = js.PointContacts([ARM.body_names[-1]], None, F(0.1), **law)

    def velocity(q, v, tau):
        return js.convex_step(ARM, q, v, tau, DT, contacts=tip).v

    compared(velocity, *states(17))
    compared(lambda *x: jax.vjp(velocity, *x)[1](x[1]), *states(17), ways=["numpy"])


# -- batches -----------------------------------------------------------------------------------------------------------

BATCHES = 1, 2, 3, 15, 16, 17, 63, 64, 4096


@pytest.mark.parametrize("batches", [BATCHES, slow((65_536, 1_000_003))])
def test_batches_of_any_size(batches):
    x = states(max(batches))
    expected = run("xla", _inverse, *x)
    if batches is BATCHES:  # NumPy would need gigabytes for others.
        same(run("numpy", _inverse, *x), expected)
    for n in batches:
        same(run("native", _inverse, *(y[:n] for y in x)), expected[:n])


def test_one_state():
    x = states(2)
    expected = run("numpy", _inverse, *x)
    same(run("native", _inverse, *(y[0] for y in x)), expected[0])


def test_no_state():
    """Nothing is computed, and sums over no states are zero."""
    x, none = states(3), states(0)
    for shape in ((0,), (3, 0), (0, 3)):
        empty = states(*shape)
        for function in (_inverse, jax.vmap(_inverse)):
            assert jax.jit(lambda *x, function=function: function(*x))(*empty).shape == (*shape, 2)
            assert function(*empty).shape == (*shape, 2)

    def pulled(q, v, vdot):
        return jax.vjp(_inverse, q, v, vdot)[1](q)

    for function in (pulled, lambda q, v, vdot: jax.vjp(jax.vmap(_inverse, (0, None, 0)), q, v, vdot)[1](q)):
        found = jax.jit(function)(none[0], x[1][0], none[2])
        assert [y.shape for y in found] == [(0, 2), (2,), (0, 2)] and not found[1].any()
    assert jax.jit(jax.vmap(jax.jacobian(_inverse, 1), (0, None, 0)))(none[0], x[1][0], none[2]).shape == (0, 2, 2)


def test_memory_of_a_call():
    """Arguments and results, and nothing between them."""
    x = states(4096)
    for function, n_results in ((_inverse, 1), (_vjp, 3), (_step, 2)):
        memory = jax.jit(function).lower(*x).compile().memory_analysis()
        size = x[0].nbytes
        assert memory.argument_size_in_bytes == 3 * size
        assert n_results * size <= memory.output_size_in_bytes <= n_results * size + 64
        assert memory.temp_size_in_bytes <= 256, function


def test_donated_arguments():
    """XLA may write results where arguments were; no state is read after it was written."""
    donated = jax.jit(_step, donate_argnums=(0, 1))
    for n in (17, 4096):
        x = states(n)
        q, v = jnp.array(x[0]), jnp.array(x[1])
        found = jax.tree.map(np.asarray, donated(q, v, x[2]))
        assert q.is_deleted() and v.is_deleted()
        same(found, run("numpy", _step, *x))


# -- dtypes and precisions ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_64_bit_types(dtype):
    """A program in float32 has the same bits beside them."""
    arm = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=dtype)
    x = states(17, dtype=dtype)
    found = []
    for is_on in [False, True] if dtype == np.float32 else [True]:
        with jax.enable_x64(is_on):
            found.append(compared(lambda *x: js.inverse_dynamics(arm, *x), *x, ways=["numpy"]))
    same(found[0], found[-1])
    assert found[0].dtype == dtype


def test_a_symplectic_step_is_one_program():
    """The factors of its mass matrix are a part of it."""

    def step(*x):
        return js.symplectic_step(ARM, *x, DT, iterations=1)

    x = states(5)
    assert jax.jit(step).lower(*x).compile().as_text().count('custom_call_target="jaxspatial') == 1
    compared(step, *x, ways=["numpy"])


def test_derivatives_of_forward_dynamics_are_one_program():
    """With the bits of XLA's way, which is that of `jax.export`."""

    def derivatives(*x):
        return tuple(js.forward_dynamics_derivatives(ARM, *x))

    x = states(5)
    assert jax.jit(derivatives).lower(*x).compile().as_text().count('custom_call_target="jaxspatial') == 1
    compared(derivatives, *x, ways=["numpy", "xla"])


# Of those that need more than one call: calls, and kernels of XLA, at most.
KERNELS = {
    "applied_wrenches": (1, 2),
    "constrained_forward_dynamics": (1, 2),
    "contact_report": (1, 12),
    "difference": (2, 0),
    "interpolate": (2, 1),
    "inverse_dynamics": (1, 2),
    "inverse_kinematics": (2, 16),
    "joint_reactions": (1, 2),
    "momentum observer": (2, 2),
    "of a factor": (2, 0),
}
EACH = {**algorithms.ALGORITHMS, "of a factor": algorithms.ALGORITHMS["mass_matrix_factor"]}
EACH["mass_matrix_factor"] = lambda mech, q, v, a: js.mass_matrix_factor(mech, q)
QUICK = "close_loops", "constraint_error", "constraint_jacobian", "contact_forces", "mass_matrix_factor", "of a factor"
OF_XLA = r"= \S+ (?:fusion|dot|while|reduce|scatter|gather|sort|concatenate|transpose|copy|slice|call)\("


@pytest.mark.parametrize("name", slow_but(QUICK, EACH))
def test_an_algorithm_is_one_call(name):
    """Kernels of XLA between calls write all states to memory, and read them again."""
    function = functools.partial(EACH[name], algorithms.mechanism())
    text = jax.jit(function).lower(*algorithms.state((20,))).compile().as_text()
    entry = text[text.index("ENTRY") :]
    n_calls, n_others = entry.count('custom_call_target="jaxspatial'), len(re.findall(OF_XLA, entry))
    most = KERNELS.get(name, (1, 0))
    assert 0 < n_calls <= most[0] and n_others <= most[1], (n_calls, n_others)


def test_constants_do_not_decide_how_many_states_fill_a_register():
    """Numbers of a mechanism in float64, of which nothing is computed as they are."""
    widths, ir_of = [], llvm_ir.ir_of
    with pytest.MonkeyPatch.context() as patch, jax.enable_x64(True):
        patch.setattr(llvm_ir, "ir_of", lambda g, width, *more: widths.append(width) or ir_of(g, width, *more))
        for dtype in (F, np.float64):
            tree, x = js.testing.random_mechanism(5, 2, ["revolute"], dtype=dtype), np.ones((2, 2), F)
            jax.jit(lambda x, tree=tree: js.inverse_dynamics(tree, x, x, x)).lower(x)
    assert len(widths) == 2 and widths[0] == widths[1]


@pytest.mark.parametrize("dtype", [jnp.bfloat16, slow(jnp.float16)])
def test_16_bit_types_take_the_way_of_xla(dtype):
    arm = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=np.float32)
    arm = jax.tree.map(lambda x: x.astype(dtype) if x.dtype == np.float32 else x, arm)
    x = [y.astype(dtype) for y in states(3)]
    with way("native") as n_native:
        found = jax.jit(lambda *x: js.inverse_dynamics(arm, *x))(*x)
    assert n_native == [False] and found.dtype == dtype
    np.testing.assert_allclose(found.astype(F), js.inverse_dynamics(ARM, *(y.astype(F) for y in x)), rtol=0.1, atol=0.1)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("precision", ["compensated", "faithful"])
def test_precise_programs(dtype, precision):
    """As if computed in twice the digits, and rounded once; float32 also where 64-bit types are off."""
    arm = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=dtype)
    arm, x = arm.replace(armature=np.zeros_like(arm.armature)), states(5, dtype=dtype)
    with jax.enable_x64(dtype == np.float64):
        found = compared(lambda *x: js.inverse_dynamics(arm, *x, precision=precision), *x, ways=["numpy"])
    expected = [exact_dynamics.inverse_dynamics(arm, *state) for state in zip(*x, strict=True)]
    error = np.abs(np.vectorize(mpmath.mpf, otypes=[object])(found.astype(float)) - np.array(expected))
    assert (error <= 0.5000001 * np.spacing(np.abs(found)).astype(float)).all()


# -- export, processes, threads and life -------------------------------------------------------------------------------


@pytest.mark.slow
def test_exported_programs_take_the_way_of_xla():
    """Machine code is of one processor and one process; an exported program may run on others."""
    x = states(5)
    (n,) = jax.export.symbolic_shape("n")
    with way("native") as n_native:
        exported = jax.export.export(jax.jit(_inverse))(*[jax.ShapeDtypeStruct((n, 2), F)] * 3)
    assert not n_native and "custom_call" not in exported.mlir_module().replace("custom_call @shape_assertion", "")
    exported = jax.export.deserialize(exported.serialize())
    for n in (1, 5):
        same(np.asarray(exported.call(*(y[:n] for y in x))), run("numpy", _inverse, *(y[:n] for y in x)))


def test_threads_compile_at_once():
    """Programs of one mechanism and of several, traced and compiled by eight threads."""
    arms = [ARM, *(js.testing.random_mechanism(seed, 2, ["revolute"], is_chain=True, dtype=F) for seed in (1, 2))]
    x, barrier = states(33), threading.Barrier(8)

    def found(i):
        barrier.wait()
        return np.asarray(jax.jit(lambda *x: js.inverse_dynamics(arms[i % 3], *x))(*x))

    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        results = list(pool.map(found, range(8)))
    for i, result in enumerate(results):
        same(result, results[i % 3])
    same(results[0], run("numpy", _inverse, *x))


@pytest.mark.filterwarnings("ignore::jaxspatial.engine.algorithm.ManyProgramsWarning")
@pytest.mark.parametrize("n", [20, slow(1000)])
def test_code_is_freed_with_its_mechanism(monkeypatch, n):
    """Mechanisms one after the other, each compiled eagerly: next to no machine code is left in memory."""
    engines, loaded = [], cpu._loaded

    def recorded(*arguments):
        engine = loaded(*arguments)
        engines.append(weakref.ref(engine))
        return engine

    monkeypatch.setattr(cpu, "_loaded", recorded)
    pendulum, q = js.testing.random_mechanism(0, 1, ["revolute"], dtype=F), states(5)[0][:, :1]
    for i in range(n):
        heavier = pendulum.replace(gravity=np.array([i, -i, 1], F))
        assert np.isfinite(js.potential_energy(heavier, q)).all()
        assert engines[-1]() is not None
        del heavier
    gc.collect()
    cpu._free()
    assert len(engines) == n
    assert sum(engine() is not None for engine in engines) <= 2


# -- other processes ---------------------------------------------------------------------------------------------------


def in_another_process(name, *arguments, **environment):
    """Runs a function of this file there."""
    return python("-c", f"from tests.engine import test_native_programs as t; t.{name}{arguments!r}", **environment)


def test_programs_are_found_on_disk(tmp_path):
    """By a process that can compile nothing. Code that was freed and is compiled again has another name, so that only
    this test has this arm."""
    expected = np.asarray(jax.jit(_of_another_arm)(*states(9)))
    in_another_process("_without_compiler", f"{tmp_path}/found.npy")
    same(np.load(tmp_path / "found.npy"), expected)


def _of_another_arm(q, v, vdot):
    return js.inverse_dynamics(js.testing.random_mechanism(5, 2, ["revolute"], is_chain=True, dtype=F), q, v, vdot)


def _without_compiler(path):
    missed = []
    jax.monitoring.register_event_listener(lambda name, **_: missed.append(name) if "cache_miss" in name else None)
    cpu._object = None
    np.save(path, jax.jit(_of_another_arm)(*states(9)))
    assert not missed


# Writes inverse dynamics at the states of one file to another.
SCRIPT = """
import os, sys
import numpy as np

def run(place):
    arm = js.testing.random_mechanism(0, 2, ["revolute"], is_chain=True, dtype=np.float32)
    np.save(place, jax.jit(lambda *x: js.inverse_dynamics(arm, *x))(*np.load(sys.argv[1])))
"""
WITHOUT_LLVMLITE = """
sys.modules["llvmlite"] = None
import jax, jaxspatial as js
run(sys.argv[2])
run(sys.argv[2])
"""
FORKED = """
import jax, jaxspatial as js
child = os.fork()
run(sys.argv[2 if child else 3])
if child:
    assert not os.waitpid(child, 0)[1]
"""


def test_without_llvmlite(tmp_path):
    """One warning, and XLA's way."""
    x, y = tmp_path / "x.npy", tmp_path / "y.npy"
    np.save(x, states(9))
    assert python("-c", SCRIPT + WITHOUT_LLVMLITE, x, y).stderr.count("jaxspatial does not compile programs") == 1
    same(np.load(y), run("numpy", _inverse, *states(9)))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no forks")
def test_forked_processes(tmp_path):
    """Forked before JAX computes anything: afterwards JAX computes nothing in a fork."""
    x, *places = (tmp_path / f"{name}.npy" for name in ("x", "parent", "child"))
    np.save(x, states(9))
    python("-c", SCRIPT + FORKED, x, *places)
    for place in places:
        same(np.load(place), run("numpy", _inverse, *states(9)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("function", "kind"),
    [("_inverse", "Auto"), ("mapped", "Auto"), ("mapped", "Explicit"), ("summed", "Auto")],
)
def test_devices(function, kind):
    """Machine code on each of four devices, for its own states. `test_devices` has more functions."""
    in_another_process("_on_devices", function, kind, n_devices=4)


def _on_devices(function, kind):
    mesh = jax.make_mesh((4,), ("batch",), axis_types=(getattr(jax.sharding.AxisType, kind),))
    split = jax.NamedSharding(mesh, P("batch"))

    def mapped(*x):
        return jax.shard_map(_vjp, mesh=mesh, in_specs=P("batch"), out_specs=P("batch"))(*x)

    def summed(q, v, vdot):
        return jax.vjp(lambda v: _inverse(q, v, vdot), v[0])[1](q)[0]

    function = {"_inverse": _inverse, "mapped": mapped, "summed": summed}[function]
    x = [jax.device_put(y, split) for y in states(4 * 17)]
    with way("native") as n_native:
        compiled = jax.jit(lambda *x: function(*x)).lower(*x).compile()
    assert n_native and all(n_native)
    # A sum over all states needs the sums of all devices.
    assert bool(re.search("all-|collective|reduce-scatter", compiled.as_text())) == (function is summed)
    results = compiled(*x)
    if function is summed:
        np.testing.assert_allclose(results, run("numpy", summed, *states(4 * 17)), rtol=1e-5)
        return
    for y in jax.tree.leaves(results):
        assert [z.data.shape for z in y.addressable_shards] == [(17, 2)] * 4
    same(results, run("numpy", _vjp if function is mapped else _inverse, *states(4 * 17)))
    # Devices cannot have equal numbers of these states.
    whole = [jax.device_put(y, jax.NamedSharding(mesh, P())) for y in states(30)]
    same(np.asarray(jax.jit(_inverse)(*whole)), run("numpy", _inverse, *states(30)))
