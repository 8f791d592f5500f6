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
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but

RATE = Parameter("rate_of_lead", default=0.7)


class Cam(JointKind):
    """Slides along the axis by rate q^2 / 2, m."""

    name, nq, nv, subspace_needs_q = "cam_follower", 1, 1, True
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


# (kind, the body that each hangs on): a chain of two spirals makes a loop over rows.
TREE = [("cam_follower", -1), ("spiral", 0), ("spiral", 1), ("prismatic", 0)]
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
            axis = (1.0, 0, 0) if i == 0 else rng.standard_normal(3)
            more = {"parameters": {"rate_of_lead": rng.uniform(0.5, 1)}} if kind in ("cam_follower", "spiral") else {}
            made.append(js.Joint(f"j{i}", kind, f"b{on}" if on >= 0 else "world", f"b{i}", X, axis=axis, **more))
        return js.Mechanism.build(bodies, made, dtype=np.float64)


@functools.cache
def state():
    return tuple(np.random.default_rng(1).uniform(0.4, 1.2, (3, N)) * np.array([1, -1, 1, 1]))


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


def last(q):
    """The velocity of the origin of the last spiral, rotational on top, as a function of v."""
    return lambda v: jnp.concatenate([x[2] for x in motions(q, v)[2:]])


def body(q):
    return jax.jacfwd(last(q))(jnp.zeros(N))


def slopes(q, v, vdot):
    """The derivatives of the torques."""
    return jnp.stack(jax.jacfwd(torques, (0, 1, 2))(q, v, vdot))


def of_lagrangian(q, v, a):
    """All that is compared but accelerations and their derivatives."""
    kinetic, potential = energies(q, v)
    return {
        "inverse dynamics": torques(q, v, a),
        "regressor": torques(q, v, a),
        "bias": torques(q, v, 0 * v),
        "gravity": torques(q, 0 * v, 0 * v),
        "mass matrix": mass(q),
        "kinetic energy": kinetic,
        "potential energy": potential,
        "jacobian": body(q),
        "jacobian rate": jax.jvp(body, (q,), (v,))[1],
        "velocity": last(q)(v),
        "acceleration": jax.jvp(lambda q, v: last(q)(v), (q, v), (v, a))[1],
        "momentum": jax.grad(lagrangian, 1)(q, v),
        # dp/dt = tau - beta, so that beta is minus the derivative of the Lagrangian by q.
        "beta": -jax.grad(lagrangian)(q, v),
        "derivatives": slopes(q, v, a),
    }


@functools.cache
def expected():
    """By name; a stands for accelerations, and for forces in forward dynamics."""
    q, v, a = state()
    found = interpreted(of_lagrangian)(q, v, a)
    vdot = np.linalg.solve(found["mass matrix"], a - found["bias"])
    by_q, by_v, _ = interpreted(slopes)(q, v, vdot)
    inverse = np.linalg.inv(found["mass matrix"])
    forward = np.stack([-inverse @ by_q, -inverse @ by_v, inverse])
    more = {"forward dynamics": vdot, "forward derivatives": forward, "gradient": a @ forward[0]}
    return found | more | {"jacfwd": found["derivatives"][0]}


def regressor(mech, q, v, a):
    pi = mech.inertias.to_dynamic_parameters().ravel()
    return js.regressors.joint_torque_regressor(mech, q, v, a) @ pi


RESULTS = {
    "inverse dynamics": js.inverse_dynamics,
    "bias": lambda m, q, v, a: js.bias_forces(m, q, v),
    "gravity": lambda m, q, v, a: js.gravity_forces(m, q),
    "forward dynamics": js.forward_dynamics,
    "mass matrix": lambda m, q, v, a: js.mass_matrix(m, q),
    "kinetic energy": lambda m, q, v, a: js.kinetic_energy(m, q, v),
    "potential energy": lambda m, q, v, a: js.potential_energy(m, q),
    "jacobian": lambda m, q, v, a: js.jacobian(m, q, "b2"),
    "jacobian rate": lambda m, q, v, a: js.jacobian_rate(m, q, v, "b2"),
    "velocity": lambda m, q, v, a: js.body_velocities(m, q, v, "b2").to_array(),
    "acceleration": lambda m, q, v, a: js.body_accelerations(m, q, v, a, "b2").to_array(),
    "momentum": lambda m, q, v, a: js.MomentumObserver.start(m, q, v).momentum,
    "beta": lambda m, q, v, a: js.MomentumObserver.start(m, q, v).beta,
    "regressor": regressor,
    "derivatives": lambda m, q, v, a: jnp.stack(js.inverse_dynamics_derivatives(m, q, v, a)),
    "forward derivatives": lambda m, q, v, a: jnp.stack(js.forward_dynamics_derivatives(m, q, v, a)),
    "jacfwd": lambda m, q, v, a: jax.jacfwd(lambda q: js.inverse_dynamics(m, q, v, a))(q),
    "gradient": lambda m, q, v, a: jax.grad(lambda q: js.forward_dynamics(m, q, v, a) @ a)(q),
}


# Of the others each is made of one of these.
KEPT = ("inverse dynamics", "forward dynamics", "mass matrix", "jacobian rate", "acceleration", "beta", "gradient")


@pytest.mark.parametrize("name", slow_but(KEPT, RESULTS))
def test_as_of_the_lagrangian(name):
    found, right = interpreted(functools.partial(RESULTS[name], mechanism()))(*state()), expected()[name]
    assert abs(right).max() > 0.1
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-11 * abs(right).max())


def test_in_batches_as_data_and_compensated():
    mech, (q, v, a), right = mechanism(), (np.stack([x, x[::-1]]) for x in state()), expected()["inverse dynamics"]
    single = [np.float32(x[0]) for x in (q, v, a)]
    for found in (
        interpreted(js.inverse_dynamics)(mech.as_data(), q, v, a)[0],
        jax.jit(jax.vmap(functools.partial(js.inverse_dynamics, mech)))(q, v, a)[0],
        interpreted(lambda *x: js.inverse_dynamics(mech.astype(np.float32), *x, precision="compensated"))(*single),
    ):
        tolerance = 1e-12 if found.dtype == np.float64 else 2e-6
        np.testing.assert_allclose(found, right, rtol=0, atol=tolerance * abs(right).max())


def test_steps():
    """They move by the accelerations of the Lagrangian, and keep the energy as well as their order says."""
    mech, (q, v, _), right = mechanism(), state(), expected()
    nothing, h = np.zeros(N), 1e-3
    vdot = np.linalg.solve(right["mass matrix"], -right["bias"])
    for step in (js.semi_implicit_step, js.convex_step):
        after = interpreted(lambda *x, step=step: step(mech, *x, h)[:2])(q, v, nothing)
        np.testing.assert_allclose((after[1] - v) / h, vdot, rtol=0, atol=1e-11 * abs(vdot).max())
        np.testing.assert_allclose(after[0], q + h * after[1], rtol=1e-14)
    energy = interpreted(lambda q, v: sum(energies(q, v)))
    start = energy(q, v)
    for step, allowed in ((js.rk4_step, 1e-9), (js.symplectic_step, 1e-2)):
        after = interpreted(lambda *x, step=step: step(mech, *x, h))(q, v, nothing)
        assert abs(energy(*after) - start) < allowed * abs(start)
        np.testing.assert_allclose((after[1] - v) / h, vdot, rtol=0, atol=0.1 * abs(vdot).max())


def test_a_rate_is_asked_for():
    class WithoutRate(JointKind):
        name, nq, nv, subspace_needs_q = "without_rate", 1, 1, True

    with pytest.raises(ValueError, match="register: without_rate: motion_subspace_rate: expected the rates"):
        joints.register(WithoutRate)
