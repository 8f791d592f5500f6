"""Single steps of a flywheel, whose equations are solved by hand: I dv/dt = tau - c v; and many steps of others."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

INERTIA, DAMPING, TORQUE, RATE, DT = 0.5, 2.0, 3.0, -4.0, 1e-2
DECAY = DAMPING / INERTIA * DT


@pytest.fixture(autouse=True)
def _x64():
    """In the precision that compiles soonest."""
    with jax.enable_x64(True), js.default_precision("fast"):
        yield


def flywheel(damping=DAMPING):
    body = js.Body("a", js.SpatialInertia(1.0, np.zeros(3), INERTIA * np.eye(3)))
    joint = js.Joint("j", "revolute", "world", "a", axis=(0.0, 0.0, 1.0), damping=damping)
    return js.Mechanism.build([body], [joint], dtype=np.float64)


def step_of(step, damping=DAMPING, torque=TORQUE, rate=RATE):
    """(angle, rate) from an angle of 1."""
    # A mass matrix of which every number is known while tracing is refused, see the test of it.
    mech = flywheel(damping).as_data()
    q, v = interpreted(step)(mech, np.ones(1), np.full(1, rate), np.full(1, torque), DT)
    return float(q[0]), float(v[0])


STEPS = pytest.mark.parametrize(
    "step", [js.semi_implicit_step, js.symplectic_step, js.rk4_step], ids=["semi-implicit", "symplectic", "rk4"]
)


def test_runge_kutta_damps():
    """v = tau / c + (v0 - tau / c) exp(-c t / I), to within (c t / I)^5 / 120."""
    q, v = step_of(js.rk4_step)
    limit, fall = TORQUE / DAMPING, np.exp(-DECAY)
    np.testing.assert_allclose(v, limit + (RATE - limit) * fall, rtol=DECAY**5 / 60)
    np.testing.assert_allclose(q, 1 + limit * DT + (RATE - limit) * (1 - fall) * INERTIA / DAMPING, rtol=DECAY**5 / 60)


@pytest.mark.parametrize("step", [js.semi_implicit_step, js.symplectic_step], ids=["semi-implicit", "symplectic"])
def test_damping_acts_at_the_new_rate(step):
    """I (v - v0) = dt (tau - c v), and the new rate moves the angle."""
    q, v = step_of(step)
    np.testing.assert_allclose(v, (RATE + DT * TORQUE / INERTIA) / (1 + DECAY), rtol=1e-14)
    np.testing.assert_allclose(q, 1 + DT * v, rtol=1e-14)


@STEPS
def test_damping_takes_rate_of_either_sign(step):
    for rate in (4.0, -4.0):
        assert 0 < step_of(step, torque=0.0, rate=rate)[1] / rate < 1


@STEPS
def test_a_torque_alone_adds_to_the_rate(step):
    np.testing.assert_allclose(step_of(step, damping=0.0)[1], RATE + DT * TORQUE / INERTIA, rtol=1e-14)


def test_a_mass_matrix_that_is_known():
    np.testing.assert_array_equal(js.mass_matrix(flywheel(), np.ones(1)), [[INERTIA]])


# -- many steps -------------------------------------------------------------------------------------------------------


def energy(mech, q, v):
    return js.kinetic_energy(mech, q, v) + js.potential_energy(mech, q)


def test_momentum_is_conserved_in_free_fall():
    """A floating mechanism without gravity, over 40 steps of Runge and Kutta."""
    mech = js.random_mechanism(3, 4, ["free", "revolute", "ball", "prismatic"], is_chain=True, dtype=np.float64)
    mech = mech.replace(gravity=np.zeros(3), damping=0 * mech.damping, armature=0 * mech.armature)
    q = js.random_configuration(mech, jax.random.key(0), (), np.float64)
    v = jnp.asarray(np.random.default_rng(0).standard_normal(mech.nv))

    def step(x, _):
        return js.rk4_step(mech, *x, jnp.zeros(mech.nv), 1e-3), (js.centroidal_momentum(mech, *x), energy(mech, *x))

    _, (L, E) = interpreted(lambda q, v: jax.lax.scan(step, (q, v), length=40))(q, v)
    L = np.asarray(L.to_array())
    assert abs(L - L[0]).max() <= 1e-10 * abs(L[0]).max()
    assert abs(E - E[0]).max() <= 1e-9 * abs(E[0])


@functools.cache
def double_pendulum():
    rod = js.shift(js.SpatialInertia.thin_rod(1.0, (0.0, 0.0, 1.0), mass=1.0), np.array([0.0, 0.0, 0.5]))
    below = js.RigidTransform(js.Rotation.identity(dtype=np.float64), np.array([0.0, 0.0, -1.0]))
    joints = [
        js.Joint("upper", "revolute", "world", "a", axis=(0, 1, 0)),
        js.Joint("lower", "revolute", "a", "b", axis=(0, 1, 0), placement=below),
    ]
    return js.Mechanism.build([js.Body("a", rod), js.Body("b", rod)], joints, dtype=np.float64)


def simulated(step, mech, x, dt, n, run=jax.jit):
    def body(x, _):
        x = step(mech, *x, jnp.zeros(mech.nv), dt)
        return x, energy(mech, *x)

    return run(lambda x: jax.lax.scan(body, x, length=n))(x)


def test_energy_of_a_double_pendulum_over_many_steps():
    """A hundred thousand symplectic ones: bounded, in proportion to dt, without a drift. The motion is chaotic: of 16
    starts within 1e-9 the largest deviations are 0.0288 to 0.0314 of the swing."""
    mech, x = double_pendulum(), (jnp.array([2.0, 1.0]), jnp.zeros(2))
    start = energy(mech, *x)
    swing = 2 * (0.5 + 1.5) * 9.81  # of the potential, from lowest to highest
    largest = []
    for dt, n in ((1e-3, 100_000), (5e-4, 20_000)):
        E = np.asarray(simulated(js.symplectic_step, mech, x, dt, n)[1] - start)
        largest.append(abs(E).max() / swing)
        assert abs(E[-n // 4 :].mean() - E[: n // 4].mean()) <= 0.1 * abs(E).max()
    assert largest[0] <= 0.032 and largest[1] <= 0.75 * largest[0]


@pytest.mark.parametrize(
    ("step", "order"),
    [(js.semi_implicit_step, 1), pytest.param(js.symplectic_step, 1, marks=pytest.mark.slow), (js.rk4_step, 4)],
    ids=["semi-implicit", "symplectic", "Runge-Kutta"],
)
def test_orders_of_the_steps(step, order):
    """Half the step, half the error, and a sixteenth."""
    mech, rng = js.random_mechanism(4, 2, ["planar", "ball"], dtype=np.float64), np.random.default_rng(0)
    x = js.random_configuration(mech, jax.random.key(1), (), np.float64), jnp.asarray(rng.standard_normal(mech.nv))

    @interpreted
    def end(x, dt, n):
        return jax.lax.fori_loop(0, n, lambda _, x: step(mech, *x, jnp.zeros(mech.nv), dt), x)

    ends = [end(x, 0.08 / n, n) for n in (8, 16, 32)]
    apart = [(js.difference(mech, a[0], b[0]), b[1] - a[1]) for a, b in itertools.pairwise(ends)]
    errors = [np.linalg.norm(np.concatenate(x)) for x in apart]
    assert abs(np.log2(errors[0] / errors[1]) - order) <= 0.3, errors


@pytest.mark.parametrize("step", [js.semi_implicit_step, js.symplectic_step], ids=["semi-implicit", "symplectic"])
def test_stiff_damping_is_stable(step):
    """Implicit: the rate falls to what the torque keeps up, and no further; explicit it would blow up."""
    mech = double_pendulum().replace(damping=np.array([1e6, 1e6]))
    (q, v), _ = simulated(step, mech, (jnp.array([2.0, 1.0]), jnp.array([1.0, -1.0])), 1e-3, 50, interpreted)
    gravity = js.gravity_forces(mech, q)
    np.testing.assert_allclose(v, -np.asarray(gravity) / 1e6, rtol=1e-5)
