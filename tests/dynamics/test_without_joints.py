"""Mechanisms in which nothing moves: all bodies are welded to the world, as in a free-body diagram."""

import inspect
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.optional import needs

MECH = js.Mechanism.build(
    [js.Body("table", js.SpatialInertia.solid_sphere(0.1, mass=2.0)), js.Body("vice")],
    [
        js.Joint("bolted", "fixed", "world", "table"),
        js.Joint(
            "clamped",
            "fixed",
            "table",
            "vice",
            placement=js.RigidTransform(js.Rotation.about_z(np.float32(0.5)), np.float32([1, 2, 3])),
        ),
    ],
    [js.Frame("tip", "vice", js.RigidTransform(js.Rotation.identity(), np.float32([0, 0, 1])))],
    dtype=np.float32,
)
NAN, NOTHING = np.full(3, np.nan), np.zeros((0, 3))
X_WF = np.array([1.0, 2, 4])
FORCES = {"vice": js.SpatialForce(jnp.ones(3), jnp.ones(3))}
# What has to do with forces, contacts and closures on frames of the world computes as with all others.
COMPUTED = {
    js.applied_wrenches,
    js.close_loops,
    js.constraint_error,
    js.constraint_jacobian,
    js.contact_forces,
    js.contact_report,
}

# Closures between frames of the world that are open are refused by what closes them.
CLOSURES = {f: ("world", "tip") for f in (js.constraint_error, js.constraint_jacobian)}

# {function: the arrays of its result for one state}
RESULTS = {
    js.center_of_mass: [NAN],
    js.center_of_mass_jacobian: [np.zeros((3, 0))],
    js.center_of_mass_velocity: [NAN],
    js.centroidal_momentum: [NAN, np.zeros(3)],
    js.centroidal_momentum_matrix: [np.zeros((6, 0))],
    js.close_loops: [np.zeros(0), np.array(0.0)],
    js.constrained_forward_dynamics: [np.zeros(0), np.zeros((1, 3)), np.zeros((1, 3))],
    js.constraint_error: [X_WF],
    js.constraint_jacobian: [np.zeros((3, 0))],
    js.configuration_rates: [np.zeros(0)],
    js.difference: [np.zeros(0)],
    js.integrate: [np.zeros(0)],
    js.interpolate: [np.zeros(0)],
    js.random_configuration: [np.zeros(0)],
    js.contact_forces: [np.zeros((1, 3)), np.zeros((1, 3))],
    # Of a sphere of 0.5 at (1, 2, 3): it touches nothing.
    js.contact_report: [
        np.array([[1.0, 2, 0]]),
        np.array([[0.0, 0, 1]]),
        np.array([-2.5]),
        np.zeros(1),
        np.zeros((1, 3)),
        np.array([False]),
    ],
    js.convex_step: [np.zeros(0), np.zeros(0), np.array(0.0), np.array(0)],
    js.kinetic_energy: [np.array(0.0)],
    js.potential_energy: [np.array(0.0)],
    # About the origin of the world, of (1, 1, 1) at (1, 2, 3).
    js.applied_wrenches: [np.array([1.0 - 1, 1 + 2, 1 - 1]), np.ones(3)],
    js.forward_dynamics: [np.zeros(0)],
    js.bias_forces: [np.zeros(0)],
    js.gravity_forces: [np.zeros(0)],
    js.inverse_dynamics: [np.zeros(0)],
    js.joint_reactions: [NOTHING, NOTHING],
    js.jacobian: [np.zeros((6, 0))],
    js.jacobian_rate: [np.zeros((6, 0))],
    js.body_accelerations: [np.zeros(3), np.zeros(3)],
    js.body_velocities: [np.zeros(3), np.zeros(3)],
    js.forward_kinematics: [np.array([[np.cos(0.5), -np.sin(0.5), 0, np.sin(0.5), np.cos(0.5), 0, 0, 0, 1]])[0], X_WF],
    js.forward_dynamics_derivatives: [np.zeros((0, 0))] * 3,
    js.inverse_dynamics_derivatives: [np.zeros((0, 0))] * 3,
    js.mass_matrix: [np.zeros((0, 0))],
    js.mass_matrix_factor: [np.zeros((0, 0))],
    js.passive_forces: [np.zeros(0)],
    js.rk4_step: [np.zeros(0)] * 2,
    js.semi_implicit_step: [np.zeros(0)] * 2,
    js.symplectic_step: [np.zeros(0)] * 2,
    js.regressors.joint_torque_regressor: [np.zeros((0, 0))],
}
STATE = "q", "q0", "q1", "v", "vdot", "tau"


def _called(f, mech, arrays):
    """The leaves of the results, with forces where a function takes them."""
    given = {"frames": "tip", "external_forces": FORCES, "dt": np.float32(0.1), "t": np.float32(0.5)}
    given |= {"loops": [js.LoopClosure(*CLOSURES.get(f, ("tip", "tip")), "ball")], "key": jax.random.key(0)}
    given |= {"loop_wrenches": js.SpatialForce.zero(1, dtype=np.float32)}
    law = {"stiffness": 1.0, "relaxation_time": 0.0, "friction": 0.5}
    if f is not js.convex_step:
        given["contacts"] = js.PointContacts(["vice"], radius=np.float32(0.5), **law)
    else:
        del given["loops"]
    names = [name for name in inspect.signature(f).parameters if name in given]
    return jax.tree.leaves(f(mech, **arrays, **{name: given[name] for name in names}))


def _arrays(f, *batch):
    return {x: jnp.zeros((*batch, 0), np.float32) for x in inspect.signature(f).parameters if x in STATE}


def test_the_table_has_all_functions():
    functions = {
        f
        for f in vars(js).values()
        if inspect.isfunction(f) and f.__module__.startswith(("jaxspatial.dynamics", "jaxspatial.contact"))
    }
    # Inverse kinematics of what does not move is refused, in `test_inverse_kinematics`.
    assert functions - {js.inverse_kinematics} < {*RESULTS}


@pytest.mark.parametrize("f", RESULTS, ids=lambda f: f.__name__)
def test_results_are_empty_or_constants(f):
    expected = RESULTS[f]
    for mech in (MECH,) if f in COMPUTED else (MECH, MECH.as_data(), MECH.as_static()):
        found = _called(f, mech, _arrays(f))
        for x, y in zip(found, expected, strict=True):
            assert x.shape == y.shape and x.dtype in (np.float32, np.int32, bool)
            np.testing.assert_allclose(x, y, rtol=4e-7, atol=1e-6)


@pytest.mark.parametrize(
    "f", [f for f in RESULTS if f not in {*COMPUTED, js.random_configuration}], ids=lambda f: f.__name__
)
def test_over_batches_and_transformed(f):
    """Leading axes, `vmap`, `jit` of the mechanism as an argument, and gradients, which are empty or zero."""
    expected = RESULTS[f]
    in_batch, arrays = _called(f, MECH, _arrays(f, 2, 3)), _arrays(f, 3)
    mapped = jax.vmap(lambda x: _called(f, MECH, x))(arrays)
    jitted = jax.jit(lambda mech, x: _called(f, mech, x))(MECH, _arrays(f))
    for a, b, c, y in zip(in_batch, mapped, jitted, expected, strict=True):
        assert a.shape == (2, 3, *y.shape) and b.shape == (3, *y.shape) and c.shape == y.shape
        for x in (a[1, 2], b[2], c):
            np.testing.assert_allclose(x, y, rtol=4e-7, atol=1e-6)
    floats = [i for i, y in enumerate(expected) if y.dtype == float]
    gradients = jax.grad(lambda x: sum(_called(f, MECH, x)[i].sum() for i in floats))(_arrays(f))
    assert all(x.shape == (0,) for x in gradients.values())


@pytest.mark.parametrize("f", [f for f in RESULTS if f not in COMPUTED], ids=lambda f: f.__name__)
def test_programs_are_constants(f):
    text = jax.jit(lambda x: _called(f, MECH, x)).lower(_arrays(f, 5)).as_text()
    assert {*re.findall(r"stablehlo\.(\w+)", text)} <= {"constant", "broadcast_in_dim"}


def test_frames_by_default_are_those_of_bodies_of_which_there_are_none():
    for f in (js.forward_kinematics, js.body_velocities, js.body_accelerations):
        for batch in ((), (4,)):
            leaves = jax.tree.leaves(f(MECH, **_arrays(f, *batch)))
            assert all(x.shape in ((*batch, 0, 3), (*batch, 0, 9)) for x in leaves)


def test_derivatives_by_the_numbers_of_what_does_not_move():
    q = jnp.zeros(0)

    def tip(p):
        placements = js.RigidTransform(MECH.frame_placements.rotation, p)
        return js.forward_kinematics(MECH.replace(frame_placements=placements), q, "tip").translation

    places = jnp.asarray(MECH.frame_placements.translation)
    of_tip = np.zeros((3, *places.shape))
    of_tip[:, MECH.frame_names.index("tip")] = np.eye(3)
    np.testing.assert_array_equal(jax.jacrev(tip)(places), of_tip)
    by_gravity = jax.grad(lambda g: js.potential_energy(MECH.replace(gravity=g), q))(jnp.ones(3))
    np.testing.assert_array_equal(by_gravity, np.zeros(3))
    assert jax.jacrev(lambda g: js.forward_dynamics(MECH.replace(gravity=g), q, q, q))(jnp.ones(3)).shape == (0, 3)


@pytest.mark.parametrize("precision", ["fast", "compensated", "faithful"])
def test_in_all_precisions(precision):
    q = jnp.zeros((2, 0))
    X = js.forward_kinematics(MECH, q, "tip", precision=precision)
    np.testing.assert_array_equal(X.translation, np.broadcast_to(X_WF, (2, 3)))
    assert js.inverse_dynamics(MECH.as_data(), q, q, q, FORCES, precision=precision).shape == (2, 0)
    assert np.isnan(js.center_of_mass(MECH, q, precision=precision)).all()


def test_observers_and_factors():
    q = jnp.zeros((2, 0))
    observer = js.MomentumObserver.start(MECH, q, q).update(MECH, q, q, q, 0.1, 5.0)
    assert all(x.shape == (2, 0) for x in jax.tree.leaves(observer))
    factor = js.mass_matrix_factor(MECH, q)
    assert factor.solve(q).shape == (2, 0) and factor.inverse().shape == (2, 0, 0)
    np.testing.assert_array_equal(factor.log_determinant(), np.zeros(2))


def test_locked_joints_and_drawings():
    needs("matplotlib")
    from jaxspatial import plot

    arm = js.testing.random_mechanism(0, 2, ["revolute"], dtype=np.float32)
    locked = js.lock_joints(arm, {"joint0": 0.3, "joint1": 0.2})
    X = js.forward_kinematics(locked, locked.neutral(), "body1")
    expected = js.forward_kinematics(arm, np.float32([0.3, 0.2]), "body1")
    np.testing.assert_allclose(X.to_matrix(), expected.to_matrix(), atol=1e-6)
    plot.mechanism(locked, locked.neutral())
