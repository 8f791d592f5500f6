"""How high things bounce: what the page says of relaxation times and of the explicit law."""

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted


def ball(mass):
    M = js.SpatialInertia.solid_sphere(np.float64(0.05), mass=np.float64(mass))
    joint = js.Joint("height", "prismatic", "world", "ball", axis=(0, 0, 1))
    return js.Mechanism.build([js.Body("ball", M)], [joint]).replace(gravity=np.zeros(3))


@pytest.mark.parametrize(("mass", "k", "dt", "wanted"), [(1.0, 1e4, 5e-4, 0.8), (0.2, 1e3, 1e-3, 0.6)])
def test_a_relaxation_time_is_a_height(mass, k, dt, wanted):
    """The share of the kinetic energy that comes back, by tau_d = -log(share) / (pi sqrt(k / m)) - dt."""
    with jax.enable_x64(True):
        w = np.sqrt(k / mass)
        tau_d, mech = -np.log(wanted) / (np.pi * w) - dt, ball(mass)
        assert tau_d > 0
        contacts = js.PointContacts(["ball"], stiffness=k, relaxation_time=tau_d, friction=0.0).astype(np.float64)

        def one(state, _):
            after = js.convex_step(mech, *state, np.zeros(1), dt, contacts=contacts)
            return (after.q, after.v), None

        n = round(1.3 * np.pi / w / dt)
        start = np.array([1e-9]), np.array([-3.0])
        _, v = interpreted(lambda q, v: jax.lax.scan(one, (q, v), None, n)[0])(*start)
    assert abs((v[0] / 3) ** 2 - wanted) < 0.03


def test_the_dissipation_of_the_explicit_law_is_one_too():
    """1 - 2/3 d v of the speed comes back."""
    with jax.enable_x64(True):
        d, dt, speed, mech = 0.05, 2e-4, 3.0, ball(1.0)
        contacts = js.PointContacts(["ball"], stiffness=1e4, relaxation_time=0.0, friction=0.0).astype(np.float64)

        def one(state, _):
            forces = js.contact_forces(mech, *state, contacts, dissipation=d)
            return js.semi_implicit_step(mech, *state, np.zeros(1), dt, forces), None

        start = np.array([1e-9]), np.array([-speed])
        _, v = interpreted(lambda q, v: jax.lax.scan(one, (q, v), None, 250)[0])(*start)
    assert abs(v[0] / speed - (1 - 2 / 3 * d * speed)) < 0.01
