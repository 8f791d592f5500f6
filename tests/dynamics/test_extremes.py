"""Long chains, mass ratios, small and large lengths, bodies without mass: against 60 digits, values and derivatives."""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from dynamics import exact

import jaxspatial as js
from jaxspatial.mechanism import topology

slow = functools.partial(pytest.param, marks=pytest.mark.slow)


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def chain(n, dtype=np.float64, seed=0):
    return js.random_mechanism(seed, n, ["revolute"], is_chain=True, dtype=np.float64).astype(dtype)


def state(n, dtype=np.float64, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, n).astype(dtype), *(rng.standard_normal((2, n)) / np.sqrt(n)).astype(dtype)


def error(found, expected):
    """Of the largest number, relative to it."""
    size = max(abs(x) for x in expected)
    return float(max(abs(mp.mpf(float(x)) - y) for x, y in zip(found, expected, strict=True)) / size)


def without_armature(mech):
    return mech.replace(armature=np.zeros_like(mech.armature))


@pytest.mark.parametrize("n", [slow(10), 100])
def test_compensated_float32_carries_the_state_doubled(n):
    """Within 4 u of 60 digits, u = 2^-24, the rotations of placements not being quite that in float32."""
    mech, (q, v, a) = without_armature(chain(n, np.float32)), state(n, np.float32)
    expected = exact.inverse_dynamics(mech, q, v, a)
    assert error(js.inverse_dynamics(mech, q, v, a, precision="compensated"), expected) <= 4 * 2.0**-24
    assert error(js.inverse_dynamics(mech, q, v, a), expected) <= 4 * n * 2.0**-24


@pytest.mark.parametrize(("scale", "ratio"), [(1.0, 1e10), slow(1e-6, 1.0), slow(1e6, 1.0), slow(1.0, 0.0)])
def test_masses_and_lengths_of_all_sizes(scale, ratio):
    """Every other mass so much larger, or without mass; lengths scaled."""
    n = topology.LONG_CHAIN
    mech, (q, v, a) = without_armature(chain(n)), state(n)
    M = mech.inertias
    factor = np.where(np.arange(n) % 2 == 0, ratio, 1.0)
    inertias = js.SpatialInertia(M.mass * factor, M.com * scale, M.central * (factor * scale**2)[:, None])
    placements = js.RigidTransform(mech.placements.rotation, mech.placements.translation * scale)
    mech = mech.replace(inertias=inertias, placements=placements)
    expected = exact.inverse_dynamics(mech, q, v, a)
    tau = js.inverse_dynamics(mech, q, v, a)
    assert error(tau, expected) <= 4 * n * 2.0**-53
    assert error(js.inverse_dynamics(mech, q, v, a, precision="compensated"), expected) <= 1.01 * 2.0**-53
    M = np.asarray(js.mass_matrix(mech, q))
    back = np.asarray(js.forward_dynamics(mech, q, v, tau))
    assert abs(back - a).max() <= 4 * n * 2.0**-53 * np.linalg.norm(np.linalg.inv(M), 2) * abs(np.asarray(tau)).max()
    gradient = jax.grad(lambda q: js.inverse_dynamics(mech, q, v, a).sum())(jnp.asarray(q))
    assert np.isfinite(np.asarray(gradient)).all()


@pytest.mark.parametrize("algorithm", ["forward_dynamics", slow("inverse_dynamics"), slow("mass_matrix")])
def test_a_loop_gives_the_bits_of_what_is_written_out(algorithm, monkeypatch):
    """Chains from LONG_CHAIN on are loops."""
    n = 6
    function, arguments = getattr(js, algorithm), state(n)[: 1 if algorithm == "mass_matrix" else 3]
    found = []
    for longest in (n + 1, n):
        monkeypatch.setattr(topology, "LONG_CHAIN", longest)
        jax.clear_caches()
        found.append(np.asarray(function(chain(n), *arguments)))
    jax.clear_caches()
    np.testing.assert_array_equal(*found)


@functools.cache
def thousand():
    return without_armature(chain(1000))


def test_a_thousand_links():
    """Inverse dynamics to 60 digits; there and back, and gradients, finite."""
    mech, (q, v, a) = thousand(), state(1000)
    tau = js.inverse_dynamics(mech, q, v, a)
    assert error(tau, exact.inverse_dynamics(mech, q, v, a)) <= 1000 * 2.0**-53
    back = np.asarray(js.forward_dynamics(mech, q, v, tau))
    assert abs(back - a).max() <= 1e-6 * abs(a).max()
    gradient = jax.grad(lambda q: js.inverse_dynamics(mech, q, v, a)[0])(jnp.asarray(q))
    assert np.isfinite(np.asarray(gradient)).all()


def test_a_thousand_links_in_all_algorithms():
    mech, (q, v, a) = thousand(), state(1000)
    M = np.asarray(js.mass_matrix(mech, q))
    tau, bias = (np.asarray(js.inverse_dynamics(mech, q, v, x)) for x in (a, 0 * a))
    assert abs(M @ a - (tau - bias)).max() <= 1e-11 * abs(tau).max()
    np.testing.assert_array_equal(M, M.T)
    np.testing.assert_allclose(js.kinetic_energy(mech, q, v), v @ M @ v / 2, rtol=1e-11)
    X, V = js.forward_kinematics(mech, q), js.body_velocities(mech, q, v)
    for body in (0, 499, 999):
        J = np.asarray(js.jacobian(mech, q, f"body{body}"))
        np.testing.assert_allclose(J @ v, np.asarray(V.to_array())[body], rtol=1e-9, atol=1e-9)
    gravity = jax.grad(lambda q: js.potential_energy(mech, q))(jnp.asarray(q))
    expected = js.gravity_forces(mech, q)
    assert abs(np.asarray(gravity - expected)).max() <= 1e-11 * abs(np.asarray(expected)).max()
    assert X.translation.shape == (1000, 3)
