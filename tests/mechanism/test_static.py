"""A mechanism without leaves: what learners' modules hold, and jit takes for a constant."""

import copy
import gc
import inspect
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.counting import asked_for, done
from tests.helpers.interpreted import interpreted

RNG = np.random.default_rng(0)


def build(**more):
    """A turning, a sliding and a free body, with a spring, damping, friction, limits and a frame."""
    ball = js.SpatialInertia.solid_ellipsoid(np.float32([0.1, 0.2, 0.3]), mass=np.float32(2))
    out = js.RigidTransform(js.Rotation.identity(), np.float32([0, 0.5, -1]))
    spring = {"stiffness": 3.0, "damping": 0.5, "friction_loss": 0.1, "lower": -1.0, "upper": 1.0}
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0), **spring),
        js.Joint("k", "prismatic", "a", "b", placement=out),
        js.Joint("w", "fixed", "b", "hand", placement=out),
        js.Joint("f", "free", "world", "c"),
        js.Joint("g", "fixed", "world", "floor"),
    ]
    names = ("a", "b", "hand", "c", "floor")
    tips = [js.Frame("tip", "hand", out), js.Frame("mark", "floor")]
    return js.Mechanism.build([js.Body(name, ball) for name in names], joints, tips, **more)


MECH = build()
Q = np.float32([0.3, 0.2, 0.6, 0.8, 0, 0, 1, 2, 3])
V, A, T = (jnp.asarray(RNG.standard_normal(MECH.nv), np.float32) for _ in range(3))
FORCES = {"hand": js.SpatialForce(jnp.float32([1, 2, 3]), jnp.float32([4, 5, 6]))}
FEET = js.PointContacts(["tip", "c"], radius=np.float32(5), stiffness=10.0, relaxation_time=0.1, friction=0.5)
DT = np.float32(1e-3)
LOOPS = (js.LoopClosure("tip", "c", "distance", 2.0),)
# All functions of the package that take a mechanism, with what else they take.
CALLS = {
    js.add_frames: ([js.Frame("point", "tip")],),
    js.applied_wrenches: (Q, FORCES),
    js.joint_reactions: (Q, V, A, FORCES),
    js.bias_forces: (Q, V, FORCES),
    js.body_accelerations: (Q, V, A, ["tip"]),
    js.body_velocities: (Q, V),
    js.close_loops: (Q, LOOPS),
    js.constrained_forward_dynamics: (Q, V, T, LOOPS),
    js.constraint_error: (Q, LOOPS),
    js.constraint_jacobian: (Q, LOOPS),
    js.center_of_mass: (Q,),
    js.center_of_mass_jacobian: (Q,),
    js.center_of_mass_velocity: (Q, V),
    js.centroidal_momentum: (Q, V),
    js.centroidal_momentum_matrix: (Q,),
    js.configuration_rates: (Q, V),
    js.contact_forces: (Q, V, FEET),
    js.contact_report: (Q, V, FEET),
    js.difference: (Q, Q),
    js.forward_dynamics: (Q, V, T, FORCES),
    js.forward_dynamics_derivatives: (Q, V, T),
    js.convex_step: (Q, V, T, DT),
    js.forward_kinematics: (Q,),
    js.gravity_forces: (Q,),
    js.integrate: (Q, V, DT),
    js.interpolate: (Q, Q, DT),
    js.inverse_dynamics: (Q, V, A, FORCES),
    js.inverse_dynamics_derivatives: (Q, V, A),
    js.inverse_kinematics: (Q, "tip", np.float32([1, 2, 3])),
    js.jacobian: (Q, "tip"),
    js.jacobian_rate: (Q, V, "hand"),
    js.regressors.joint_torque_regressor: (Q, V, A),
    js.kinetic_energy: (Q, V),
    js.lock_joints: ({"j": 0.5},),
    js.mass_matrix: (Q,),
    js.mass_matrix_factor: (Q,),
    js.passive_forces: (Q, V, js.Compliance(limit_stiffness=2.0)),
    js.potential_energy: (Q,),
    js.random_configuration: (jax.random.key(0), (2,)),
    js.rk4_step: (Q, V, T, DT),
    js.semi_implicit_step: (Q, V, T, DT),
    js.subtree: ("b",),
    js.symplectic_step: (Q, V, T, DT),
}


def _takes_a_mechanism(function):
    return inspect.isfunction(function) and next(iter(inspect.signature(function).parameters), "") == "mechanism"


def test_the_table_has_all_functions_of_mechanisms():
    mujoco = vars(js.interop.mujoco)
    assert set(CALLS) == set(filter(_takes_a_mechanism, (vars(js) | vars(js.regressors)).values()))
    assert {name for name, f in mujoco.items() if _takes_a_mechanism(f) and name[0] != "_"} == {
        "key_frames",
        *(f"{way}_{what}" for way in ("from", "to") for what in ("qpos", "qvel", "qacc", "qfrc")),
    }


def _evaluated(function, mech):
    """In NumPy, of the coordinates, rates and forces; what makes other mechanisms or random numbers is called."""
    given = CALLS[function]
    places = [i for i, x in enumerate(given) if getattr(x, "dtype", None) == np.float32]
    if not places:
        return function(mech, *given)

    def call(*numbers):
        moving = dict(zip(places, numbers, strict=True))
        return function(mech, *(moving.get(i, x) for i, x in enumerate(given)))

    return interpreted(call)(*(given[i] for i in places))


@pytest.mark.parametrize("function", CALLS, ids=lambda f: f.__name__)
def test_every_function_takes_it_with_the_same_bits(function):
    expected, found = (_evaluated(function, mech) for mech in (MECH, MECH.as_static()))
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    jax.tree.map(np.testing.assert_array_equal, found, expected)


def test_a_step_with_contacts_takes_it():
    """The same bits, of a step in which feet touch."""

    def own(mech):
        return interpreted(lambda q, v: js.convex_step(mech, q, v, T, DT, contacts=FEET))(Q, V)

    expected, found = own(MECH), own(MECH.as_static())
    assert (np.asarray(expected.contact_forces.f) != 0).any()
    jax.tree.map(np.testing.assert_array_equal, found, expected)


def test_states_of_mujoco_take_it():
    mech = js.subtree(MECH, "b")
    q, v = jnp.ones((2, mech.nv), np.float32)
    for function in (js.interop.mujoco.to_qvel, js.interop.mujoco.to_qfrc):
        np.testing.assert_array_equal(function(mech.as_static(), q, v), function(mech, q, v))
    np.testing.assert_array_equal(js.interop.mujoco.to_qpos(mech.as_static(), q), js.interop.mujoco.to_qpos(mech, q))


def test_it_has_no_leaves_and_is_equal_by_its_contents():
    first, again = build().as_static(), build().as_static()
    assert jax.tree.leaves(first) == []
    assert first == again and hash(first) == hash(again) and jax.tree.structure(first) == jax.tree.structure(again)
    changed = [
        MECH.replace(gravity=MECH.gravity * np.float32(1 + 1e-7)),
        MECH.replace(damping=-0.0 * MECH.damping),
        build(dtype=np.float64),
        js.lock_joints(MECH, {}).replace(damping=0 * MECH.damping),
    ]
    assert len({MECH.as_static(), *(mech.as_static() for mech in changed)}) == 5
    assert first != MECH and MECH != first and first.as_static() is first


def test_names_are_part_of_it():
    one, other = (
        js.Mechanism.build([js.Body(name)], [js.Joint("j", "revolute", "world", name)]).as_static() for name in "ab"
    )
    assert one != other


@pytest.fixture
def only_new_objects():
    """What the tests before have left is neither searched nor counted: there are millions."""
    gc.freeze()


def test_equal_ones_are_one_while_one_lives(only_new_objects):
    first = build().as_static()
    assert build().as_static() is first and first.replace().as_static() is first
    key, n = first.contents, _count_static(first)
    changed = MECH.replace(gravity=np.float32([0, 0, 3])).as_static()
    assert _count_static(first) == n + 1 and changed.contents != key
    del changed
    assert _count_static(first) == n


def _count_static(one):
    """How many static mechanisms live, of those made in this test."""
    gc.collect()
    return sum(type(x) is type(one) for x in gc.get_objects())


def test_an_equal_copy_is_not_compiled_again_and_folds(only_new_objects):
    traced = []

    def seen(mech, q):
        traced.append(mech.gravity)
        return js.gravity_forces(mech, q)

    torques, q = jax.jit(seen), jnp.asarray(Q)
    np.testing.assert_allclose(torques(build().as_static(), q), js.gravity_forces(MECH, q), rtol=1e-6)
    gc.collect()
    torques(build().as_static(), q)
    assert len(traced) == 1 and type(traced[0]) is np.ndarray
    flat = torques(MECH.replace(gravity=np.zeros(3, np.float32)).as_static(), q)
    assert len(traced) == 2 and not flat.any()
    # It asks for what the program of a mechanism that is closed over asks for; one with leaves asks for more.
    for count in (asked_for, done):
        static = count(torques, MECH.as_static(), q)["multiply"]
        closed_over = count(lambda q: js.gravity_forces(MECH, q), q)["multiply"]
        assert 0 < static == closed_over < count(torques, MECH, q)["multiply"]


def test_transformations_pass_it_by():
    static, q = MECH.as_static(), jnp.stack([jnp.asarray(Q)] * 2)
    found = jax.vmap(js.gravity_forces, in_axes=(None, 0))(static, q)
    np.testing.assert_array_equal(found[0], jax.jit(js.gravity_forces)(static, jnp.asarray(Q)))
    assert jax.grad(lambda mech: js.potential_energy(mech, Q))(static) is static
    carried, _ = jax.lax.scan(lambda mech, _: (mech, None), static, length=2)
    assert carried is static
    assert jax.tree.map(lambda x: 1 / 0, static) is static


def test_what_leads_back_to_leaves():
    static = MECH.as_static()
    for mech in (static._as_known(), static.replace(), static.as_data()._as_known(), jax.jit(lambda: MECH.as_data())()):
        assert type(mech) is js.Mechanism
        jax.tree.map(np.testing.assert_array_equal, mech, MECH)
    assert all(isinstance(x, jax.Array) for x in jax.tree.leaves(static.as_data()))
    heavier = static.replace(gravity=2 * jnp.asarray(static.gravity))
    assert type(heavier) is js.Mechanism and isinstance(heavier.gravity, jax.Array)
    np.testing.assert_allclose(js.gravity_forces(heavier, Q), 2 * js.gravity_forces(MECH, Q), rtol=1e-6)
    half = static.astype(np.float16)
    assert half is MECH.astype(np.float16).as_static() and half.gravity.dtype == np.float16
    assert repr(static) == "Static" + repr(MECH)


def test_data_becomes_known_but_not_what_is_traced():
    assert MECH.as_data().as_static() is MECH.as_static()
    for method in ("as_static", "_as_known"):
        with pytest.raises(TypeError, match="Mechanism._as_known: expected numbers .*, got .*Tracer"):
            jax.jit(lambda mech, method=method: getattr(mech, method)().nv)(MECH)


def test_nobody_can_change_it():
    mech = build()._as_known()
    static = mech.as_static()
    mech.replace().damping.flags.writeable = True
    mech.damping[:] = 7
    assert static is MECH.as_static() and not (static.damping == 7).any()
    for x in (static.gravity, static.inertias.mass, static.frame_placements.translation):
        with pytest.raises(ValueError, match="read-only"):
            x[...] = 0
    with pytest.raises(AttributeError):
        static.gravity = np.zeros(3)


def test_copies_and_pickles_are_the_same():
    static = MECH.as_static()
    assert copy.copy(static) is copy.deepcopy(static) is pickle.loads(pickle.dumps(static)) is static
    # Hashes of names are those of one process, and are left behind.
    assert hash(MECH.topology) and "_hash" not in vars(pickle.loads(pickle.dumps(MECH)).topology)
    assert pickle.loads(pickle.dumps(MECH)).topology == MECH.topology


@pytest.mark.parametrize("dtype", [np.float32, jnp.bfloat16])
def test_a_program_of_it_is_exported(dtype):
    mech, q = MECH.astype(dtype).as_static(), jnp.asarray(Q, dtype)
    exported = jax.export.export(jax.jit(js.gravity_forces))(mech, q)
    again = jax.export.deserialize(exported.serialize())
    np.testing.assert_array_equal(again.call(mech, q), jax.jit(js.gravity_forces)(mech, q))
    with pytest.raises(ValueError, match="pytree"):
        again.call(MECH.replace(gravity=0 * MECH.gravity).astype(dtype).as_static(), q)


def test_bodies_of_frames():
    expected = {"world": "world", "a": "a", "b": "b", "hand": "b", "tip": "b", "c": "c", "floor": "world"}
    for mech in (MECH, MECH.as_static(), MECH.as_data()):
        assert {name: mech.frame_body(name) for name in mech.frame_names} == {**expected, "mark": "world"}
    with pytest.raises(KeyError, match="Mechanism.frame_body: name: expected one of 'world', 'a', .*got 'x'"):
        MECH.frame_body("x")
