"""Laws of mechanics on random trees with every kind of joint: they need no other engine to compare with."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.mechanism.joints import KINDS

N = 4
MOVING = [name for name in KINDS if name != "fixed"]
slow = [pytest.param(tree, marks=pytest.mark.slow) for tree in ("chain", *MOVING)]
trees = pytest.mark.parametrize("tree", ["every kind", *slow])


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@functools.cache
def mechanism(tree):
    if tree == "every kind":
        return js.random_mechanism(0, len(MOVING), dtype=np.float64)
    if tree == "chain":
        return js.random_mechanism(1, len(MOVING), MOVING[::-1], is_chain=True, dtype=np.float64)
    return js.random_mechanism(2, 3, [tree], dtype=np.float64)


@functools.cache
def state(tree):
    """q, v and vdot of N items."""
    mech, rng = mechanism(tree), np.random.default_rng(3)
    q = js.random_configuration(mech, jax.random.key(4), N, np.float64)
    return q, *(jnp.asarray(rng.standard_normal((N, mech.nv))) for _ in range(2))


@functools.cache
def evaluated(tree):
    """tau, M, bias and gravity forces, compiled once for all laws."""
    mech = mechanism(tree)

    def all_of_them(q, v, a):
        tau = js.inverse_dynamics(mech, q, v, a)
        bias, gravity = js.bias_forces(mech, q, v), js.gravity_forces(mech, q)
        return tau, js.mass_matrix(mech, q), bias, gravity, js.forward_dynamics(mech, q, v, tau)

    return [np.asarray(x) for x in jax.jit(jax.vmap(all_of_them))(*state(tree))]


def moved(mech, q, step):
    return js.integrate(mech, q, step)


@trees
def test_forward_after_inverse_is_the_identity(tree):
    tau, M, *_, found = evaluated(tree)
    a = np.asarray(state(tree)[2])
    condition = max(np.linalg.cond(m) for m in M)
    assert abs(found - a).max() <= 64 * 2.0**-53 * condition * abs(a).max()


@trees
def test_mass_matrix_is_what_accelerations_take(tree):
    """tau = M vdot + bias, M symmetric to the last bit and positive."""
    tau, M, bias, *_ = evaluated(tree)
    a = np.asarray(state(tree)[2])
    rest = tau - bias - np.einsum("bij,bj->bi", M, a)
    assert abs(rest).max() <= 64 * 2.0**-53 * (abs(tau) + abs(bias)).max()
    np.testing.assert_array_equal(M, M.transpose(0, 2, 1))
    assert np.linalg.eigvalsh(M).min() > 0


@trees
def test_gravity_forces_are_the_gradient_of_the_potential(tree):
    mech, (q, _, _) = mechanism(tree), state(tree)
    gravity = evaluated(tree)[3]

    def gradient(q):
        return jax.grad(lambda step: js.potential_energy(mech, moved(mech, q, step)))(jnp.zeros(mech.nv))

    found = np.asarray(jax.jit(jax.vmap(gradient))(q))
    assert abs(found - gravity).max() <= 256 * 2.0**-53 * abs(gravity).max()


@trees
def test_power_is_the_rate_of_energy(tree):
    """v . (tau - g) = dT/dt along the motion: velocity-dependent forces do no work of their own."""
    mech, (q, v, a) = mechanism(tree), state(tree)
    tau, _, _, gravity, _ = evaluated(tree)

    def rate(q, v, a):
        energy = lambda t: js.kinetic_energy(mech, moved(mech, q, t * v), v + t * a)  # noqa: E731
        return jax.jvp(energy, (0.0,), (1.0,))[1]

    power = np.einsum("bi,bi->b", np.asarray(v), tau - gravity)
    size = np.einsum("bi,bi->b", abs(np.asarray(v)), abs(tau) + abs(gravity))
    assert (abs(np.asarray(jax.jit(jax.vmap(rate))(q, v, a)) - power) <= 256 * 2.0**-53 * size).all()


@trees
def test_energy_is_that_of_the_mass_matrix(tree):
    mech, (q, v, _) = mechanism(tree), state(tree)
    M = evaluated(tree)[1]
    expected = np.einsum("bi,bij,bj->b", v, M, v) / 2
    np.testing.assert_allclose(np.asarray(js.kinetic_energy(mech, q, v)), expected, rtol=64 * 2.0**-53)


@trees
def test_jacobian_is_the_derivative_of_the_pose(tree):
    mech, (q, v, _) = mechanism(tree), state(tree)
    V = js.body_velocities(mech, q, v)
    for i, body in enumerate(mech.body_names):
        J = np.asarray(js.jacobian(mech, q, body))
        np.testing.assert_allclose(J @ np.asarray(v)[..., None], np.asarray(V.to_array())[:, i, :, None], atol=1e-13)

    def origins(q, v):
        return jax.jvp(lambda t: js.forward_kinematics(mech, moved(mech, q, t * v)).translation, (0.0,), (1.0,))[1]

    rates = np.asarray(jax.jit(jax.vmap(origins))(q, v))
    assert abs(rates - np.asarray(V.v)).max() <= 1e-12 * abs(rates).max()


@trees
def test_difference_undoes_integrate(tree):
    mech, (q, v, _) = mechanism(tree), state(tree)
    found = js.difference(mech, q, js.integrate(mech, q, v, 0.5))
    assert abs(np.asarray(found) - np.asarray(v) / 2).max() <= 1e-14 * abs(np.asarray(v)).max() * 4
    np.testing.assert_allclose(js.integrate(mech, q, jnp.zeros_like(v)), q, rtol=4 * 2.0**-53)


@pytest.mark.parametrize("tree", ["every kind"])
def test_external_forces_act_through_the_jacobian(tree):
    mech, (q, v, a) = mechanism(tree), state(tree)
    rng = np.random.default_rng(5)
    bodies = mech.body_names[2], mech.body_names[-1]
    forces = {name: js.SpatialForce(*rng.standard_normal((2, N, 3))) for name in bodies}
    tau = np.asarray(js.inverse_dynamics(mech, q, v, a, forces))
    for name, F in forces.items():
        tau = tau + np.einsum("bij,bi->bj", np.asarray(js.jacobian(mech, q, name)), np.asarray(F.to_array()))
    np.testing.assert_allclose(tau, evaluated(tree)[0], atol=1e-13 * abs(tau).max())
    back = js.forward_dynamics(mech, q, v, js.inverse_dynamics(mech, q, v, a, forces), forces)
    np.testing.assert_allclose(back, a, atol=1e-11)
