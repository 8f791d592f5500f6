"""Which programs there are: one for a structure where numbers are data, one for what is read where they are known."""

import functools
import gc
import os
import subprocess
import sys
import warnings
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.engine import algorithm, cpu, graph, program
from jaxspatial.engine.algorithm import Algorithm, ManyProgramsWarning
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

Q = np.full(2, 0.3, np.float32)


def robot(seed=0):
    return js.testing.random_mechanism(seed, 2, ["revolute", "prismatic"], dtype=np.float32)


@pytest.fixture(autouse=True)
def _nothing_called_before(monkeypatch):
    """In the precision that compiles soonest. What tests before have left is not searched: there are millions of it."""
    gc.freeze()
    monkeypatch.setattr(algorithm, "_CACHES", weakref.WeakValueDictionary())
    with js.default_precision("fast"):
        yield


def programs():
    """Those that live. Kept in a list, they are there when programs are counted again, whoever made them."""
    gc.collect()
    return [x for x in gc.get_objects() if isinstance(x, Algorithm)]


def test_numbers_that_are_not_read_make_no_new_program():
    mech = robot()
    kept = [mech, mech.replace(damping=2 * mech.damping), mech.replace(lower=mech.lower - 1)]
    before = programs()
    for m in kept:
        js.forward_dynamics(m, Q, Q, Q)
    heavier = js.SpatialInertia(2 * mech.inertias.mass, mech.inertias.com, mech.inertias.central)
    moved = mech.replace(inertias=heavier)
    for m in (mech, moved):
        js.forward_kinematics(m, Q)
    assert len(programs()) == len(before) + 2


def test_programs_of_known_numbers_are_let_go():
    mech = robot(1)
    before = programs()
    other = mech.replace(gravity=np.float32([0, 0, -1]))
    _ = js.gravity_forces(other, Q), js.forward_dynamics(other, Q, Q, Q)
    assert len(programs()) == len(before) + 2
    del other
    assert len(programs()) == len(before)


TRANSFORMED = {
    "vmap": lambda f: jax.vmap(f)(Q[None]),
    "jvp": lambda f: jax.jvp(f, (Q,), (Q,)),
    "vjp": lambda f: jax.vjp(f, Q)[1](Q),
    "linearize": lambda f: jax.linearize(f, Q)[1](Q),
    "jit": lambda f: jax.jit(f)(Q),
}


@pytest.mark.parametrize("name", TRANSFORMED)
def test_programs_are_let_go_by_transformations(name):
    before = programs()
    other = robot(1).replace(gravity=np.float32([0, 0, -2]))
    found = TRANSFORMED[name](functools.partial(js.gravity_forces, other))
    assert len(programs()) == len(before) + 1
    del other, found
    assert len(programs()) == len(before)


def test_a_linear_map_keeps_its_programs_without_the_mechanism():
    def of_other():
        other = robot(1).replace(gravity=np.float32([0, 0, -3]))
        return jax.linearize(lambda q: js.gravity_forces(other, q), Q)[1], js.gravity_forces(other, Q)

    before = programs()
    linear, forces = of_other()
    assert np.isfinite(linear(Q)).all() and linear(Q).shape == forces.shape and len(programs()) == len(before) + 1
    del linear
    assert len(programs()) == len(before)


@pytest.mark.parametrize("step", [False, True], ids=["an algorithm", "a composite"])
def test_a_trace_keeps_programs_of_what_it_knows(step):
    """A mechanism that is made while a caller's function is traced is gone when the function runs."""
    q = np.float32([0.1, 0.2])

    def of_nothing_but_constants(x):
        arm = js.testing.random_mechanism(0, 2, ["revolute"], dtype=np.float32)
        return x * (js.semi_implicit_step(arm, q, q, q, 0.1)[0] if step else js.mass_matrix(arm, q)[0])

    x, expected = jnp.float32(2), of_nothing_but_constants(np.float32(2))
    traced = jax.make_jaxpr(of_nothing_but_constants)(x)
    gc.collect()
    for found in (*jax.core.eval_jaxpr(traced.jaxpr, traced.consts, x), jax.jit(of_nothing_but_constants)(x)):
        np.testing.assert_array_equal(found, expected)


def test_a_second_robot_of_the_same_structure_is_not_traced_again():
    """With numbers as data, whatever its names."""
    first, second = (robot(seed).as_data() for seed in (0, 1))
    parents = first.topology.parents
    second = second if second.topology.parents == parents else first.replace(gravity=2 * first.gravity)
    js.inverse_dynamics(first, Q, Q, Q)
    before = programs()
    js.inverse_dynamics(second, Q, Q, Q)
    assert len(programs()) == len(before)


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_a_graph_takes_programs_within_as_they_are_traced(precision, monkeypatch):
    """And sums of one plan: to trace what they are made of again took longer than all else."""
    mech = robot()
    closed = jax.make_jaxpr(lambda q, v: js.rk4_step(mech, q, v, v, Q[0], precision=precision))(Q, Q)
    first = graph.graph_of(closed, program._expanded)
    monkeypatch.setattr(jax, "make_jaxpr", None)
    again = graph.graph_of(closed, program._expanded)
    assert len(again) == len(first) > 100


@pytest.mark.parametrize("name", ["gravity_forces", "semi_implicit_step"])
def test_the_fourth_program_of_a_structure_is_told(name):
    mech = robot(2)
    different = [mech.replace(gravity=np.float32([0, 0, -k])) for k in range(5)]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for m in different:
            js.gravity_forces(m, Q) if name == "gravity_forces" else js.semi_implicit_step(m, Q, Q, Q, Q[0])
    (one,) = (x for x in told if x.category is ManyProgramsWarning)
    assert str(one.message).startswith(f"{name}: ") and "as_data()" in str(one.message)


def test_known_numbers_are_read_only():
    for mech in (robot(), robot().astype(np.float16), robot().replace(gravity=np.zeros(3, np.float32))):
        with pytest.raises(ValueError, match="read-only"):
            mech.gravity[2] = 1.0
    given = np.array([0, 0, -1], np.float32)
    robot().replace(gravity=given)
    given[2] = 2.0


PROCESS = """
import sys, numpy as np, jax, jaxspatial as js
jax.config.update("jax_compilation_cache_dir", sys.argv[1])
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
mech = js.testing.random_mechanism(0, 2, ["revolute"])
q = np.ones((4, 2), np.float32)
jax.jit(jax.vmap(lambda q: jax.grad(lambda q: js.gravity_forces(mech, q).sum())(q)))(q)
"""


@pytest.mark.slow
def test_the_persistent_cache_hits_in_a_new_process(tmp_path):
    """Nothing of a program depends on the process that made it."""
    found = []
    for seed in ("1", "2"):
        run = [sys.executable, "-c", PROCESS, str(tmp_path)]
        subprocess.run(run, check=True, env={**os.environ, "PYTHONHASHSEED": seed})
        found.append(sorted(x.name for x in tmp_path.iterdir() if x.name.endswith("-cache")))
    assert found[0] and found[0] == found[1]


def test_derivatives_of_batches_that_share_an_argument():
    """Cotangents of what a batch shares are added up, over blocks too, of which states that only fill the last one up
    have none; of what is one for each item they are not."""
    mech = robot(3).as_data()
    q = np.random.default_rng(0).standard_normal((2501, 2)).astype(np.float32)

    def total(gravity, q):
        own = mech.replace(gravity=gravity)
        return jax.vmap(lambda x: js.gravity_forces(own, x).sum())(q).sum()

    whole = interpreted(jax.grad(total))(mech.gravity, q)
    apart = interpreted(jax.vmap(lambda x: jax.grad(total)(mech.gravity, x[None])))(q)
    np.testing.assert_allclose(whole, np.asarray(apart, np.float64).sum(0), rtol=1e-4)


@pytest.mark.slow
def test_any_order_of_derivatives():
    """Forward over reverse, reverse over reverse and reverse over forward agree, of forward dynamics and its steps."""
    with jax.enable_x64(True):
        mech = js.testing.random_mechanism(4, 3, ["revolute", "free"], dtype=np.float64)
        rng = np.random.default_rng(0)
        q = np.asarray(js.random_configuration(mech, jax.random.key(0), (), np.float64))
        v, tau, t = rng.standard_normal((3, mech.nv))

        def f(v):
            return (js.forward_dynamics(mech, q, v, tau) ** 2).sum()

        ways = (jax.jvp(jax.grad(f), (v,), (t,))[1],
                jax.grad(lambda v: jax.grad(f)(v) @ t)(v),
                jax.grad(lambda v: jax.jvp(f, (v,), (t,))[1])(v))  # fmt: skip
        step = 1e-5
        expected = (jax.grad(f)(v + step * t) - jax.grad(f)(v - step * t)) / (2 * step)
        for found in ways:
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6 * abs(np.asarray(expected)).max())
            np.testing.assert_allclose(found, ways[0], rtol=1e-10, atol=1e-10 * abs(np.asarray(expected)).max())


def test_lists_take_the_dtype_beside_them_and_narrowing_is_said():
    """Of forces held as float64 NumPy, and of a mechanism made data, while 64-bit types are off."""
    mech = robot(5)
    assert js.inverse_dynamics(mech, [1, 0], Q, [0.5, 1.0]).dtype == np.float32
    with jax.enable_x64(True):
        assert js.inverse_dynamics(mech.as_data(), [1, 0], Q, Q).dtype == np.float32
    wide = js.SpatialForce(np.ones(3), np.ones(3))
    for call in (lambda: js.gravity_forces(mech.astype(np.float64).as_data(), Q),
                 lambda: js.bias_forces(mech, Q, Q, {"body1": wide})):  # fmt: skip
        with pytest.warns(js.NarrowingWarning):
            call()


def test_jit_switched_off():
    """Outside of a program they are still one."""
    with jax.disable_jit():
        found = js.inverse_dynamics(robot(), Q, Q, Q)
    np.testing.assert_array_equal(found, js.inverse_dynamics(robot(), Q, Q, Q))


@pytest.mark.parametrize("was_enabled", [True, False])
def test_garbage_is_collected_again_after_a_trace(was_enabled, monkeypatch):
    """Not while programs are traced, and made graphs of; afterwards as before, also where a trace fails."""
    seen, evaluate = [], Algorithm.evaluate

    def evaluated(self, *arrays):
        seen.append(gc.isenabled())
        if len(seen) > 1:
            raise ZeroDivisionError
        return evaluate(self, *arrays)

    def made(*arguments, **options):
        seen.append(gc.isenabled())
        return graph_of(*arguments, **options)

    graph_of = graph.graph_of
    monkeypatch.setattr(Algorithm, "evaluate", evaluated)
    monkeypatch.setattr(graph, "graph_of", made)
    gc.enable() if was_enabled else gc.disable()
    try:
        js.gravity_forces(robot(2), Q)
        assert gc.isenabled() == was_enabled
        with pytest.raises(ZeroDivisionError):
            js.gravity_forces(robot(3), Q)
        assert gc.isenabled() == was_enabled
    finally:
        gc.enable()
    assert seen == [False] * 3


def same(found, expected):
    for x, y in zip(found, expected, strict=True):
        np.testing.assert_array_equal(np.asarray(x).view(np.uint8), np.asarray(y).view(np.uint8))


@pytest.mark.parametrize("function", [js.inverse_dynamics, js.forward_dynamics])
def test_a_state_has_the_same_bits_alone_in_a_loop_and_in_a_batch(function):
    mech = js.testing.random_mechanism(3, 6, ["revolute"], is_chain=True, dtype=np.float32)
    states = np.random.default_rng(0).standard_normal((3, 5, 6)).astype(np.float32)
    with js.default_precision("reproducible"):
        alone = [function(mech, *x) for x in states.swapaxes(0, 1)]
        in_loop = jax.jit(lambda *x: jax.lax.map(lambda state: function(mech, *state), x))(*states)
        many = jax.jit(functools.partial(function, mech))(*np.tile(states, (1, 200, 1)))
    same(in_loop, alone)
    same(many[:5], alone)


@pytest.mark.parametrize("function", [slow(js.inverse_dynamics), js.forward_dynamics])
def test_a_pullback_adds_up_each_number_of_a_robot_once(function, monkeypatch):
    """Also where XLA compiles it: not wherever the number is used, which for this arm is in 267 places."""
    monkeypatch.setattr(cpu, "is_available", lambda: False)
    mech = js.testing.random_mechanism(3, 6, ["revolute"], is_chain=True, dtype=np.float32)
    x = np.ones((4, 6), np.float32)
    pulled = jax.grad(lambda mech, *of: function(mech, *of).sum(), allow_int=True)
    assert jax.jit(pulled).lower(mech, x, x, x).as_text().count("stablehlo.reduce(") <= 20


def _stepped(mech, q, tau, v, precision):
    return js.symplectic_step(mech, q, v, tau, np.float32(0.01), iterations=1, precision=precision)[1]


OF_64_BITS = [(js.forward_dynamics, "faithful"), (_stepped, "compensated")]


@pytest.mark.parametrize(
    ("function", "precision"), [*OF_64_BITS, slow(js.forward_dynamics, "compensated"), slow(_stepped, "faithful")]
)
def test_what_is_computed_in_64_bits_needs_no_switch_by_the_caller(function, precision):
    """The factors of the mass matrix, which one program keeps for another; slices of joints, which JAX pads back."""
    mech = js.testing.random_mechanism(0, 2, ["revolute"], dtype=np.float32)

    def total(x):
        return function(mech, Q, Q, x, precision=precision).sum()

    def gradient(x64):
        with jax.enable_x64(x64):
            return interpreted(jax.grad(total))(Q)

    assert gradient(False).dtype == np.float32 and gradient(False).any()
    np.testing.assert_allclose(gradient(False), gradient(True), rtol=2.0**-21)
