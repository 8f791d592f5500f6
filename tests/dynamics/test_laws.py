"""Laws of mechanics on random trees with every kind of joint: they need no other engine to compare with.

They are held on what the formulas give, primitive by primitive; that compiled programs give the same, at the end.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics.composite_bodies import MassMatrixFactor
from jaxspatial.dynamics.configuration import transport
from jaxspatial.mechanism.joints import KINDS
from tests.helpers import marks, tangents
from tests.helpers.interpreted import interpreted

N = 4
MOVING = [name for name in KINDS if name != "fixed"]
# Of what holds for every kind of joint where other laws do, and of compiled programs: a few kinds are enough.
FEW = "few kinds"
ALL = "every kind", FEW, "chain", *MOVING
trees = pytest.mark.parametrize("tree", marks.slow_but(["every kind"], ALL))
few = pytest.mark.parametrize("tree", marks.slow_but([FEW], ALL))


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@functools.cache
def mechanism(tree):
    if tree == "every kind":
        return js.testing.random_mechanism(0, len(MOVING), dtype=np.float64)
    if tree == "chain":
        return js.testing.random_mechanism(1, len(MOVING), MOVING[::-1], is_chain=True, dtype=np.float64)
    return js.testing.random_mechanism(2, 3, ["helical", "planar", "ball"] if tree == FEW else [tree], dtype=np.float64)


@functools.cache
def state(tree):
    """q, v and vdot of N items."""
    mech, rng = mechanism(tree), np.random.default_rng(3)
    q = jax.jit(lambda key: js.random_configuration(mech, key, N, np.float64))(jax.random.key(4))
    return np.asarray(q), *rng.standard_normal((2, N, mech.nv))


def dynamics(mech, q, v, a):
    """tau, M, bias and gravity forces, and the accelerations that tau gives."""
    tau = js.inverse_dynamics(mech, q, v, a)
    bias, gravity = js.bias_forces(mech, q, v), js.gravity_forces(mech, q)
    return tau, js.mass_matrix(mech, q), bias, gravity, js.forward_dynamics(mech, q, v, tau)


def of(function, tree):
    """The function of this mechanism."""
    return interpreted(functools.partial(function, mechanism(tree)))


@functools.cache
def evaluated(tree):
    return of(dynamics, tree)(*state(tree))


def moved(mech, q, step):
    return js.integrate(mech, q, step)


@trees
def test_forward_after_inverse_is_the_identity(tree):
    _, M, *_, found = evaluated(tree)
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

    found = np.asarray(interpreted(jax.vmap(gradient))(q))
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
    assert (abs(np.asarray(interpreted(jax.vmap(rate))(q, v, a)) - power) <= 256 * 2.0**-53 * size).all()


@trees
def test_energy_is_that_of_the_mass_matrix(tree):
    q, v, _ = state(tree)
    M = evaluated(tree)[1]
    expected = np.einsum("bi,bij,bj->b", v, M, v) / 2
    np.testing.assert_allclose(of(js.kinetic_energy, tree)(q, v), expected, rtol=64 * 2.0**-53)


@trees
def test_jacobian_is_the_derivative_of_the_pose(tree):
    mech, (q, v, _) = mechanism(tree), state(tree)
    # On the ways to bodies that carry none is every joint.
    ends = sorted(set(range(len(mech.body_names))) - set(mech.topology.parents))

    def both(q, v):
        origins = lambda t: js.forward_kinematics(mech, moved(mech, q, t * v)).translation  # noqa: E731
        jacobians = [js.jacobian(mech, q, mech.body_names[i]) for i in ends]
        return js.body_velocities(mech, q, v).to_array(), jacobians, jax.jvp(origins, (0.0,), (1.0,))[1]

    V, jacobians, rates = interpreted(jax.vmap(both))(q, v)
    for i, J in zip(ends, jacobians, strict=True):
        np.testing.assert_allclose(J @ v[..., None], V[:, i, :, None], atol=1e-13)
    assert abs(rates - V[..., 3:]).max() <= 1e-12 * abs(rates).max()


@trees
def test_accelerations_and_rates_are_derivatives_along_the_motion(tree):
    """Of velocities, Jacobians, configurations, the centre of mass; of bodies, and of a frame by name."""
    mech, state_ = mechanism(tree), state(tree)
    body = mech.body_names[-1]

    def moving(q, v):
        V = js.body_velocities(mech, q, v, [body, "world"])
        return V.to_array(), js.jacobian(mech, q, body), js.center_of_mass(mech, q), q

    def both(q, v, a):
        start = q, v
        rates = js.configuration_rates(mech, q, v), a
        A = js.body_accelerations(mech, q, v, a, [body, "world"])
        found = A.to_array(), js.jacobian_rate(mech, q, v, body), js.center_of_mass_velocity(mech, q, v)
        step = lambda t: js.integrate(mech, q, t * v)  # noqa: E731
        return (*found, rates[0]), (*jax.jvp(moving, start, rates)[1][:3], jax.jvp(step, (0.0,), (1.0,))[1])

    for found, expected in zip(*interpreted(jax.vmap(both))(*state_), strict=True):
        assert abs(np.asarray(found - expected)).max() <= 256 * 2.0**-53 * max(abs(np.asarray(expected)).max(), 1)


@trees
def test_momentum_about_the_centre_of_mass(tree):
    """A v, the mass times the velocity of the centre, and the sum over bodies."""
    mech, (q, v, _) = mechanism(tree), state(tree)

    def all_of_them(q, v):
        L, A = js.centroidal_momentum(mech, q, v), js.centroidal_momentum_matrix(mech, q)
        return L.to_array(), A, js.center_of_mass_jacobian(mech, q), js.center_of_mass_velocity(mech, q, v)

    L, A, J, v_WC = interpreted(jax.vmap(all_of_them))(q, v)
    size, M = abs(L).max(), mech.inertias
    np.testing.assert_allclose(np.einsum("bij,bj->bi", A, v), L, atol=256 * 2.0**-53 * size, rtol=0)
    np.testing.assert_allclose(np.einsum("bij,bj->bi", J, v), v_WC, atol=256 * 2.0**-53, rtol=0)
    np.testing.assert_allclose(M.mass.sum() * v_WC, L[:, 3:], atol=256 * 2.0**-53 * size, rtol=0)
    if tree == "free":  # the frames of bodies are those of their joints
        X, V = js.forward_kinematics(mech, q), js.body_velocities(mech, q, v)
        arm = np.asarray(X.rotation @ np.broadcast_to(M.com, (N, *M.com.shape)))
        at_com = js.shift(V, arm)
        l = np.asarray(M.mass)[:, None] * np.asarray(at_com.v)  # noqa: E741
        R = np.asarray(X.rotation.to_matrix())
        spin = np.einsum("bnij,njk,bnlk,bnl->bni", R, central(M), R, V.w)
        p = np.asarray(X.translation) + arm - np.asarray(js.center_of_mass(mech, q))[:, None]
        np.testing.assert_allclose((spin + np.cross(p, l)).sum(1), L[:, :3], atol=1e-13 * size)


def central(M):
    xx, xy, yy, xz, yz, zz = np.asarray(M.central).T
    return np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], -1).reshape((-1, 3, 3))


@trees
def test_torques_are_linear_in_the_inertial_parameters(tree):
    mech, (q, v, a) = mechanism(tree), state(tree)
    Y = of(js.regressors.joint_torque_regressor, tree)(q, v, a)
    pi = np.asarray(mech.inertias.to_dynamic_parameters()).ravel()
    tau = evaluated(tree)[0]
    # Rotors have the rates of linear velocities in the axes of the parent.
    rates = np.asarray(a + of(lambda mech, q, v: transport(None, mech, q, v), tree)(q, v))
    assert abs(Y @ pi + mech.armature * rates - tau).max() <= 256 * 2.0**-53 * abs(tau).max()


@trees
@pytest.mark.parametrize("is_pulled", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_derivatives_in_closed_form_are_those_of_autodiff(tree, is_pulled):
    mech, (q, v, a) = mechanism(tree), state(tree)
    rng = np.random.default_rng(5)
    names = {mech.body_names[0], mech.body_names[-1]} if is_pulled else ()
    forces = {name: js.SpatialForce(*jnp.asarray(rng.standard_normal((2, 3)))) for name in sorted(names)}
    at = jnp.zeros(mech.nv)

    def autodiff(q, v, a):
        moving = lambda s, v, a: js.inverse_dynamics(mech, moved(mech, q, s), v, a, forces)  # noqa: E731
        return tangents.jacobians(moving, (0, 1, 2))(at, v, a)

    def closed(q, v, a):
        return js.inverse_dynamics_derivatives(mech, q, v, a, forces)

    found, expected = (interpreted(jax.vmap(f))(q, v, a) for f in (closed, autodiff))
    for x, y in zip(found, expected, strict=True):
        assert abs(np.asarray(x) - np.asarray(y)).max() <= 256 * 2.0**-53 * abs(np.asarray(y)).max()


def test_derivatives_of_forward_dynamics():
    mech, (q, v, tau) = mechanism("universal"), [x[0] for x in state("universal")]
    M = of(js.mass_matrix, "universal")(q)

    def autodiff(v, tau):
        moving = lambda s, v, tau: js.forward_dynamics(mech, moved(mech, q, s), v, tau)  # noqa: E731
        return tangents.jacobians(moving, (0, 1, 2))(jnp.zeros(mech.nv), v, tau)

    found = of(js.forward_dynamics_derivatives, "universal")(q, v, tau)
    allowed = 64 * 2.0**-53 * np.linalg.cond(M)
    for x, y in zip(found, interpreted(autodiff)(v, tau), strict=True):
        assert abs(np.asarray(x) - np.asarray(y)).max() <= allowed * abs(np.asarray(y)).max()


def following():
    """A chain of hinges, two of which follow others."""
    rng, names = np.random.default_rng(8), [f"body{i}" for i in range(5)]
    shapes = [js.SpatialInertia(1.0 + i, 0.1 * rng.standard_normal(3), np.eye(3) / 5) for i in range(5)]
    joints = [
        js.Joint(
            f"joint{i}",
            "revolute",
            names[i - 1] if i else "world",
            names[i],
            js.RigidTransform(js.Rotation.identity(dtype=np.float64), rng.standard_normal(3)),
            axis=rng.standard_normal(3),
            mimic=(f"joint{i - 1}", 2.0, 0.1) if i in (2, 4) else None,
        )
        for i in range(5)
    ]
    return js.Mechanism.build(list(map(js.Body, names, shapes)), joints, dtype=np.float64)


WITH_A_LOAD = {
    "limbs on a floating base": lambda: js.testing.random_mechanism(5, 7, ["free", "revolute", "universal"]),
    "mimics": following,
    # So many that a library factors the mass matrix.
    "a long chain": lambda: js.testing.random_mechanism(6, 30, ["revolute"], is_chain=True),
}


@pytest.mark.parametrize("tree", WITH_A_LOAD)
def test_derivatives_of_forward_dynamics_are_the_inverse_times_those_of_inverse_dynamics(tree):
    """Under a force on the last body."""
    mech, rng = WITH_A_LOAD[tree](), np.random.default_rng(7)
    q, v, tau = mech.neutral(), *rng.standard_normal((2, mech.nv))
    loads = {mech.body_names[-1]: js.SpatialForce(*rng.standard_normal((2, 3)))}

    def both(q, v, tau):
        vdot = js.forward_dynamics(mech, q, v, tau, loads)
        inverse = js.inverse_dynamics_derivatives(mech, q, v, vdot, loads)
        return inverse, js.forward_dynamics_derivatives(mech, q, v, tau, loads)

    (dq, dv, M), found = jax.tree.map(np.asarray, interpreted(both)(q, v, tau))
    expected = -np.linalg.solve(M, dq), -np.linalg.solve(M, dv), np.linalg.inv(M)
    # A tenth of the bound of every column, 4 nv (nv + 1) u cond(M).
    allowed = 0.4 * mech.nv * (mech.nv + 1) * 2.0**-53 * np.linalg.cond(M)
    for x, y in zip(found, expected, strict=True):
        assert (np.linalg.norm(x - y, axis=0) <= allowed * np.linalg.norm(y, axis=0)).all()


def test_derivatives_of_forward_dynamics_without_inertia_are_nan():
    mech = mechanism("revolute")
    none = js.SpatialInertia(*(np.zeros_like(x) for x in jax.tree.leaves(mech.inertias)))
    q, v, tau = (x[0] for x in state("revolute"))
    found = interpreted(functools.partial(js.forward_dynamics_derivatives, mech.replace(inertias=none)))(q, v, tau)
    assert all(np.isnan(x).all() for x in found)


@few
def test_rate_of_the_mass_matrix_less_twice_coriolis_is_skew(tree):
    """With Coriolis' matrix that of Christoffel's symbols: C v = the bias without gravity, and M' = C + C^T."""
    mech, (q, v, _) = mechanism(tree), state(tree)
    mech = mech.replace(gravity=np.zeros(3))

    def both(q, v):
        zero = jnp.zeros(mech.nv)
        C = js.inverse_dynamics_derivatives(mech, q, v, zero).dtau_dv / 2
        rates = js.configuration_rates(mech, q, v)
        dM = jax.jvp(lambda q: js.mass_matrix(mech, q), (q,), (rates,))[1]
        return C @ v - js.bias_forces(mech, q, v), v @ (dM - 2 * C) @ v, v @ dM @ v

    rest, power, size = interpreted(jax.vmap(both))(q, v)
    assert abs(np.asarray(rest)).max() <= 1e-12 * abs(np.asarray(size)).max()
    assert abs(np.asarray(power)).max() <= 1e-12 * abs(np.asarray(size)).max()


def test_factors_of_the_mass_matrix():
    (q, _, a), M = state("every kind"), evaluated("every kind")[1]

    def all_of_them(mech, q, x):
        F = js.mass_matrix_factor(mech, q)
        return F.L, F.solve(x), F.inverse(), F.log_determinant()

    L, solved, inverse, log_determinant = of(all_of_them, "every kind")(q, np.einsum("bij,bj->bi", M, a))
    np.testing.assert_allclose(L.transpose(0, 2, 1) @ L, M, atol=64 * 2.0**-53 * abs(M).max())
    assert (np.triu(L, 1) == 0).all() and ((M == 0) <= ((L == 0) | (L.transpose(0, 2, 1) == 0))).all()
    allowed = 64 * 2.0**-53 * max(map(np.linalg.cond, M))
    np.testing.assert_allclose(solved, a, atol=allowed * abs(a).max())
    np.testing.assert_allclose(inverse @ M, np.broadcast_to(np.eye(M.shape[-1]), M.shape), atol=allowed)
    np.testing.assert_allclose(log_determinant, np.linalg.slogdet(M)[1], rtol=allowed)


@pytest.mark.parametrize("n", [1, 63, 64])
def test_factors_of_any_size_solve(n):
    """Those of at most 63 velocities by machine code, with derivatives."""
    rng = np.random.default_rng(n)
    L = np.tril(rng.standard_normal((2, n, n)) / n, -1) + np.eye(n)
    x, rate = rng.standard_normal((2, 2, n))
    with jax.enable_x64(True):
        solved, moved = jax.jvp(lambda L: MassMatrixFactor(L).solve(x), (L,), (rate[..., None] * L,))
    M = L.transpose(0, 2, 1) @ L
    M_dot = L.transpose(0, 2, 1) @ (rate[..., None] * L) * 2
    expected = np.linalg.solve(M, x[..., None])
    np.testing.assert_allclose(solved, expected[..., 0], atol=1e-13 * abs(expected).max())
    M_dot = (M_dot + M_dot.transpose(0, 2, 1)) / 2
    np.testing.assert_allclose(moved, -np.linalg.solve(M, M_dot @ expected)[..., 0], atol=1e-12 * abs(moved).max())


@trees
def test_difference_undoes_integrate(tree):
    q, v, _ = state(tree)
    found = of(lambda mech, q, v: js.difference(mech, q, js.integrate(mech, q, v, 0.5)), tree)(q, v)
    assert abs(found - v / 2).max() <= 1e-14 * abs(v).max() * 4
    np.testing.assert_allclose(of(js.integrate, tree)(q, np.zeros_like(v)), q, rtol=4 * 2.0**-53)


@few
def test_external_forces_act_through_the_jacobian(tree):
    mech, (q, v, a) = mechanism(tree), state(tree)
    rng = np.random.default_rng(5)
    bodies = sorted([mech.body_names[1], mech.body_names[-1]])
    forces = {name: js.SpatialForce(*rng.standard_normal((2, N, 3))) for name in bodies}

    def all_of_them(mech, q, v, a, forces):
        tau = js.inverse_dynamics(mech, q, v, a, forces)
        jacobians = [js.jacobian(mech, q, name) for name in forces]
        return js.inverse_dynamics(mech, q, v, a), tau, js.forward_dynamics(mech, q, v, tau, forces), jacobians

    alone, tau, back, jacobians = of(all_of_them, tree)(q, v, a, forces)
    for J, F in zip(jacobians, forces.values(), strict=True):
        tau = tau + np.einsum("bij,bi->bj", J, np.concatenate([F.tau, F.f], -1))
    np.testing.assert_allclose(tau, alone, atol=1e-13 * abs(tau).max())
    np.testing.assert_allclose(back, a, atol=1e-11)


@few
@pytest.mark.parametrize("i", [0, pytest.param(np.s_[:], marks=pytest.mark.slow)], ids=["torques", "all of them"])
def test_compiled_programs_give_the_same_bits(tree, i):
    """As the formulas in NumPy, operation by operation; of other algorithms see `test_transformations`."""

    def own(*x):
        return dynamics(mechanism(tree), *x)[i]

    compiled = jax.jit(jax.vmap(own))(*state(tree))
    jax.tree.map(np.testing.assert_array_equal, compiled, interpreted(own)(*state(tree)))
