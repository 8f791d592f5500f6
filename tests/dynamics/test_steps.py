"""Single steps of a flywheel, whose equations are solved by hand: I dv/dt = tau - c v."""

import jax
import numpy as np
import pytest

import jaxspatial as js

INERTIA, DAMPING, TORQUE, RATE, DT = 0.5, 2.0, 3.0, -4.0, 1e-2
DECAY = DAMPING / INERTIA * DT


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def flywheel(damping=DAMPING):
    body = js.Body("a", js.SpatialInertia(1.0, np.zeros(3), INERTIA * np.eye(3)))
    joint = js.Joint("j", "revolute", "world", "a", axis=(0.0, 0.0, 1.0), damping=damping)
    return js.Mechanism.build([body], [joint], dtype=np.float64)


def step_of(step, damping=DAMPING, torque=TORQUE, rate=RATE):
    """(angle, rate) from an angle of 1."""
    mech = flywheel(damping)
    # A mass matrix of which every number is known while tracing is refused, see the test of it.
    mech = mech.as_data() if step is js.symplectic_step else mech
    q, v = step(mech, np.ones(1), np.full(1, rate), np.full(1, torque), DT)
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
