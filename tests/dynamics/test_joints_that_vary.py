"""Joints whose motion subspace depends on a coordinate that is no angle, against a Lagrangian that knows poses alone.

One turns by q and slides by a q^2 / 2 along its axis, another slides by a q^2 / 2. The Lagrangian is differentiated by
JAX, and with it all that follows: mass matrix, forces, accelerations, and their derivatives.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.mechanism import joints
from jaxspatial.mechanism.joints import AXIS, KINDS, JointKind, Parameter, Prismatic, Revolute
from jaxspatial.numerics.linear import Motion, Pose

RATE = Parameter("rate_of_lead", default=0.7)


class Cam(JointKind):
    """Slides along the axis by rate q^2 / 2, m."""

    name, nq, nv, subspace_needs_q = "cam", 1, 1, True
    parameters, is_about_one_axis = (AXIS, RATE), True

    def transform(self, q, cos_sin):
        return Prismatic.transform(self, [0.5 * self.rate_of_lead * (q[0] * q[0])], cos_sin)

    def motion_subspace(self, q, cos_sin):
        return self.slides([(self.rate_of_lead * q[0]) * self.axis])

    def motion_subspace_rate(self, q, cos_sin, v):
        return self.slides([(self.rate_of_lead * v[0]) * self.axis])


class Spiral(JointKind):
    """Turns about the axis by q, rad, and slides along it by rate q^2 / 2, m."""

    name, nq, nv, angles, subspace_needs_q = "spiral", 1, 1, (0,), True
    parameters, is_about_one_axis = (AXIS, RATE), True

    def transform(self, q, cos_sin):
        return Pose(Revolute.transform(self, q, cos_sin).R, (0.5 * self.rate_of_lead * (q[0] * q[0])) * self.axis)

    def motion_subspace(self, q, cos_sin):
        return (Motion(self.axis, (self.rate_of_lead * q[0]) * self.axis),)

    def motion_subspace_rate(self, q, cos_sin, v):
        return self.slides([(self.rate_of_lead * v[0]) * self.axis])


@pytest.fixture(autouse=True, scope="module")
def _registered():
    """Known in this module alone: programs go on being kept by the name."""
    for kind in (Cam, Spiral):
        assert joints.register(kind) is kind
    yield
    for kind in (Cam, Spiral):
        del KINDS[kind.name]


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


# (kind, the body that each hangs on): a chain of three spirals makes a loop over rows.
TREE = [("cam", -1), ("revolute", 0), ("spiral", 1), ("spiral", 2), ("spiral", 3), ("prismatic", 1)]
N = len(TREE)


@functools.cache
def mechanism():
    with jax.enable_x64(True):
        rng = np.random.default_rng(0)
        bodies, made = [], []
        for i, (kind, on) in enumerate(TREE):
            a = rng.standard_normal((3, 3))
            M = js.SpatialInertia(np.float64(rng.uniform(1, 2)), rng.standard_normal(3), a @ a.T / 5 + np.eye(3))
            bodies.append(js.Body(f"b{i}", M))
            X = js.RigidTransform(js.Rotation.exp(rng.standard_normal(3)), rng.standard_normal(3))
            axis = (1.0, 0, 0) if i == 2 else rng.standard_normal(3)
            more = {"parameters": {"rate_of_lead": rng.uniform(0.5, 1)}} if kind in ("cam", "spiral") else {}
            made.append(js.Joint(f"j{i}", kind, f"b{on}" if on >= 0 else "world", f"b{i}", X, axis=axis, **more))
        return js.Mechanism.build(bodies, made, dtype=np.float64)


@functools.cache
def state():
    return tuple(np.random.default_rng(1).uniform(0.4, 1.2, (3, N)) * np.array([1, -1, 1, -1, 1, 1]))


# -- the Lagrangian ---------------------------------------------------------------------------------------------------


def _turn(axis, angle):
    x, y, z = axis
    K = jnp.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return jnp.eye(3) + jnp.sin(angle) * K + (1 - jnp.cos(angle)) * (K @ K)


def poses(q):
    """(rotations, origins) of all bodies in the world."""
    mech, found = mechanism(), []
    for i, (kind, on) in enumerate(TREE):
        R, p = found[on] if on >= 0 else (jnp.eye(3), jnp.zeros(3))
        p, R = p + R @ mech.placements.translation[i], R @ mech.placements.rotation.to_matrix()[i]
        axis = mech.axes[i]
        lead = mech.parameters["rate_of_lead"][i, 0] * q[i] ** 2 / 2
        slide = {"revolute": 0.0, "prismatic": q[i]}.get(kind, lead)
        turn = _turn(axis, q[i]) if kind in ("revolute", "spiral") else jnp.eye(3)
        found.append((R @ turn, p + R @ (slide * axis)))
    return jnp.stack([R for R, _ in found]), jnp.stack([p for _, p in found])


def motions(q, v):
    """Rotations, origins, angular velocities and velocities of origins in the world."""
    (R, p), (R_rate, p_rate) = jax.jvp(poses, (q,), (v,))
    W = R_rate @ jnp.swapaxes(R, -1, -2)
    return R, p, jnp.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], -1), p_rate


def energies(q, v):
    M = mechanism().inertias
    R, p, w, p_rate = motions(q, v)
    arm = jnp.einsum("nij,nj->ni", R, M.com)
    v_com, w_body = p_rate + jnp.cross(w, arm), jnp.einsum("nji,nj->ni", R, w)
    six = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])
    central = np.asarray(M.central)[:, six]
    kinetic = (M.mass * (v_com**2).sum(-1)).sum() / 2 + jnp.einsum("ni,nij,nj", w_body, central, w_body) / 2
    return kinetic, 9.81 * (M.mass * (p + arm)[:, 2]).sum()


def lagrangian(q, v):
    kinetic, potential = energies(q, v)
    return kinetic - potential


def torques(q, v, vdot):
    momentum = jax.grad(lagrangian, 1)
    return jax.jvp(momentum, (q, v), (v, vdot))[1] - jax.grad(lagrangian)(q, v)


def mass(q):
    return jax.hessian(lagrangian, 1)(q, jnp.zeros(N))


def accelerations(q, v, tau):
    return jnp.linalg.solve(mass(q), tau - torques(q, v, jnp.zeros(N)))


def last(q):
    """The velocity of the origin of the last spiral, rotational on top, as a function of v."""
    return lambda v: jnp.concatenate([x[4] for x in motions(q, v)[2:]])


def rate_of_last(q, v, vdot):
    return jax.jvp(lambda q, v: last(q)(v), (q, v), (v, vdot))[1]


def body(q):
    return jax.jacfwd(last(q))(jnp.zeros(N))


# {name: (ours, by the Lagrangian)}, as functions of q, v and a third, which is vdot or tau
RESULTS = {
    "inverse dynamics": (lambda q, v, a: js.inverse_dynamics(mechanism(), q, v, a), torques),
    "bias": (lambda q, v, a: js.bias_forces(mechanism(), q, v), lambda q, v, a: torques(q, v, jnp.zeros(N))),
    "gravity": (
        lambda q, v, a: js.gravity_forces(mechanism(), q),
        lambda q, v, a: jax.grad(lambda q: energies(q, 0 * v)[1])(q),
    ),
    "forward dynamics": (lambda q, v, a: js.forward_dynamics(mechanism(), q, v, a), accelerations),
    "mass matrix": (lambda q, v, a: js.mass_matrix(mechanism(), q), lambda q, v, a: mass(q)),
    "kinetic energy": (lambda q, v, a: js.kinetic_energy(mechanism(), q, v), lambda q, v, a: energies(q, v)[0]),
    "potential energy": (lambda q, v, a: js.potential_energy(mechanism(), q), lambda q, v, a: energies(q, v)[1]),
    "jacobian": (lambda q, v, a: js.jacobian(mechanism(), q, "b4"), lambda q, v, a: body(q)),
    "jacobian rate": (
        lambda q, v, a: js.jacobian_rate(mechanism(), q, v, "b4"),
        lambda q, v, a: jax.jvp(body, (q,), (v,))[1],
    ),
    "velocity": (lambda q, v, a: js.body_velocities(mechanism(), q, v, "b4").to_array(), lambda q, v, a: last(q)(v)),
    "acceleration": (lambda q, v, a: js.body_accelerations(mechanism(), q, v, a, "b4").to_array(), rate_of_last),
    "momentum": (
        lambda q, v, a: js.MomentumObserver.start(mechanism(), q, v).momentum,
        lambda q, v, a: jax.grad(lagrangian, 1)(q, v),
    ),
    # dp/dt = tau - beta, so that beta is minus the derivative of the Lagrangian by q.
    "beta": (
        lambda q, v, a: js.MomentumObserver.start(mechanism(), q, v).beta,
        lambda q, v, a: -jax.grad(lagrangian)(q, v),
    ),
    "regressor": (
        lambda q, v, a: (
            js.regressors.joint_torque_regressor(mechanism(), q, v, a)
            @ mechanism().inertias.to_dynamic_parameters().ravel()
        ),
        torques,
    ),
    "derivatives": (
        lambda q, v, a: jnp.stack(js.inverse_dynamics_derivatives(mechanism(), q, v, a)),
        lambda q, v, a: jnp.stack(jax.jacfwd(torques, (0, 1, 2))(q, v, a)),
    ),
    "forward derivatives": (
        lambda q, v, a: jnp.stack(js.forward_dynamics_derivatives(mechanism(), q, v, a)),
        lambda q, v, a: jnp.stack(jax.jacfwd(accelerations, (0, 1, 2))(q, v, a)),
    ),
    "jacfwd": (
        lambda q, v, a: jax.jacfwd(lambda q: js.inverse_dynamics(mechanism(), q, v, a))(q),
        lambda q, v, a: jax.jacfwd(torques)(q, v, a),
    ),
    "gradient": (
        lambda q, v, a: jax.grad(lambda q: js.forward_dynamics(mechanism(), q, v, a) @ a)(q),
        lambda q, v, a: jax.grad(lambda q: accelerations(q, v, a) @ a)(q),
    ),
}


@functools.cache
def expected(name):
    return np.asarray(jax.jit(RESULTS[name][1])(*state()))


@pytest.mark.parametrize("name", RESULTS)
def test_as_of_the_lagrangian(name):
    found, right = RESULTS[name][0](*state()), expected(name)
    assert abs(right).max() > 0.1
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-11 * abs(right).max())


def test_in_batches_as_data_and_compensated():
    mech, (q, v, a) = mechanism(), (np.stack([x, x[::-1]]) for x in state())
    for found in (
        js.inverse_dynamics(mech, q, v, a)[0],
        jax.jit(jax.vmap(lambda *x: js.inverse_dynamics(mech.as_data(), *x)))(q, v, a)[0],
        js.inverse_dynamics(mech.astype(np.float32), *(jnp.float32(x[0]) for x in (q, v, a)), precision="compensated"),
    ):
        tolerance = 1e-12 if found.dtype == np.float64 else 1e-5
        right = expected("inverse dynamics")
        np.testing.assert_allclose(found, right, rtol=0, atol=tolerance * abs(right).max())


def test_steps():
    """The accelerations of one step, and the energy that many keep."""
    mech, (q, v, _) = mechanism(), map(jnp.asarray, state())
    nothing, h = jnp.zeros(N), 1e-4
    vdot = np.asarray(jax.jit(accelerations)(q, v, nothing))
    for step in (js.semi_implicit_step, js.convex_step):
        after = step(mech, q, v, nothing, h)
        q1, v1 = (after.q, after.v) if isinstance(after, js.ConvexStep) else after
        np.testing.assert_allclose((v1 - v) / h, vdot, rtol=0, atol=1e-10 * abs(vdot).max())
        np.testing.assert_allclose(q1, q + h * v1, rtol=1e-14)
    energy = jax.jit(lambda q, v: sum(energies(q, v)))
    start = energy(q, v)
    many = jax.jit(lambda q, v: jax.lax.fori_loop(0, 50, lambda _, x: js.rk4_step(mech, *x, nothing, 2e-3), (q, v)))
    assert abs(energy(*many(q, v)) - start) < 1e-8 * abs(start)
    one = js.symplectic_step(mech, q, v, nothing, 1e-3)
    assert abs(energy(*one) - start) < 0.02 * abs(start)


def test_a_rate_is_asked_for():
    class WithoutRate(JointKind):
        name, nq, nv, subspace_needs_q = "without_rate", 1, 1, True

    with pytest.raises(ValueError, match="register: without_rate: motion_subspace_rate: expected the rates"):
        joints.register(WithoutRate)
