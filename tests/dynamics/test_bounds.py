"""The error bounds of the docstrings, against 60 digits: chains of n revolute joints, bodies of very different masses.

Relative to the largest number of each result: see `dynamics.promises`. For forward dynamics times the condition of
the mass matrix.
"""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics.promises import ALGORITHM
from tests.helpers import exact_dynamics as exact

N = 6


@functools.cache
def chain():
    """Frames turned by quarters, which is exact; masses from 1e-3 to 1e3."""
    rng = np.random.default_rng(0)
    quarters = [js.Rotation.from_matrix(np.float64(m)) for m in ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.eye(3))]
    names = ["world", *(f"body{i}" for i in range(N))]
    bodies, joints = [], []
    for i in range(N):
        a, scale = rng.standard_normal((3, 3)), 10.0 ** rng.uniform(-3, 3)
        central = np.float32(scale * (a @ a.T + np.eye(3)) / 100)
        mass, com, arm = (
            np.float64(np.float32(x)) for x in (scale, rng.standard_normal(3) / 5, rng.standard_normal(3))
        )
        bodies.append(js.Body(names[i + 1], js.SpatialInertia(mass, com, np.float64(central))))
        X = js.RigidTransform(quarters[i % 2], arm)
        joints.append(js.Joint(f"joint{i}", "revolute", names[i], names[i + 1], axis=np.eye(3)[i % 3], placement=X))
    return js.Mechanism.build(bodies, joints, gravity=(0.5, -9.75, 1.25), dtype=np.float64)


@functools.cache
def state():
    rng = np.random.default_rng(1)
    return [np.float64(np.float32(x)) for x in rng.uniform(-3, 3, (3, N))]


@functools.cache
def expected():
    """name -> numbers of 60 digits."""
    with mp.workdps(60):
        c = exact.Chain(chain(), *state())
        (rotations, positions), (kinetic, potential), (_, center, rate) = c.poses(), c.energies(), c.center()
        return {
            "rotations": rotations,
            "positions": positions,
            "velocities": c.velocities(),
            "accelerations": c.accelerations(),
            "jacobian": c.jacobian(N - 2),
            "inverse dynamics": c.inverse_dynamics(),
            "forward dynamics": c.forward_dynamics(),
            "gravity forces": c.inverse_dynamics(v=[0] * N, a=[0] * N),
            "mass matrix": c.mass_matrix(),
            "kinetic energy": [kinetic],
            "potential energy": [potential],
            "centre of mass": list(center),
            "velocity of the centre of mass": list(rate),
            "momentum": c.momentum(),
            "dtau_dq": c.derivative("q"),
            "dtau_dv": c.derivative("v"),
        }


@functools.cache
def condition():
    return np.linalg.cond(np.array(expected()["mass matrix"], float).reshape((N, N)))


def all_of_ours(precision, q, v, a):
    mech = chain()
    with js.default_precision(precision):
        X, V, A = js.forward_kinematics(mech, q), js.body_velocities(mech, q, v), js.body_accelerations(mech, q, v, a)
        derivatives = js.inverse_dynamics_derivatives(mech, q, v, a)
        return {
            "rotations": X.rotation.to_matrix(),
            "positions": X.translation,
            "velocities": V.to_array(),
            "accelerations": A.to_array(),
            "jacobian": js.jacobian(mech, q, f"body{N - 2}"),
            "inverse dynamics": js.inverse_dynamics(mech, q, v, a),
            "forward dynamics": js.forward_dynamics(mech, q, v, a),
            "gravity forces": js.gravity_forces(mech, q),
            "mass matrix": js.mass_matrix(mech, q),
            "kinetic energy": js.kinetic_energy(mech, q, v),
            "potential energy": js.potential_energy(mech, q),
            "centre of mass": js.center_of_mass(mech, q),
            "velocity of the centre of mass": js.center_of_mass_velocity(mech, q, v),
            "momentum": js.centroidal_momentum(mech, q, v).to_array(),
            "dtau_dq": derivatives.dtau_dq,
            "dtau_dv": derivatives.dtau_dv,
        }


@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
@pytest.mark.parametrize("precision", ["fast", pytest.param("reproducible", marks=pytest.mark.slow), "compensated"])
def test_every_algorithm(precision, dtype):
    """In one program, in a batch."""
    u = float(jnp.finfo(dtype).eps) / 2
    with jax.enable_x64(dtype == "float64"):
        batch = [np.stack([x, x]).astype(dtype) for x in state()]
        found = jax.jit(jax.vmap(functools.partial(all_of_ours, precision)))(*batch)
    for name, numbers in expected().items():
        ours = np.asarray(found[name][1], np.float64).ravel()
        size, factor = max(map(abs, numbers)), condition() if name == "forward dynamics" else 1
        limit = ALGORITHM.allowed(js.Precision(precision), N, u, size, size, factor)
        error = max(abs(mp.mpf(float(x)) - y) for x, y in zip(ours, numbers, strict=True))
        assert error <= limit, (name, float(error / u / size))


@functools.cache
def falling():
    """Accelerations of a fall from rest, in float32; the forces of it, all but none, and the size of their terms."""
    masses, gravity = (np.array(expected()[name], float) for name in ("mass matrix", "gravity forces"))
    fall = np.float64(np.float32(-np.linalg.solve(masses.reshape(N, N), gravity)))
    with mp.workdps(60):
        forces = exact.Chain(chain(), state()[0], np.zeros(N), fall).inverse_dynamics()
    terms = abs(masses.reshape(N, N)) @ abs(fall) + abs(gravity)
    return fall, forces, terms.max()


@pytest.mark.parametrize("dtype", ["float32", pytest.param("float64", marks=pytest.mark.slow)])
@pytest.mark.parametrize("precision", list(js.Precision))
def test_terms_that_cancel(precision, dtype):
    """What little is left of forces while all falls: its errors are of the size of its terms, as promised."""
    u, (fall, forces, mag) = float(jnp.finfo(dtype).eps) / 2, falling()
    with jax.enable_x64(dtype == "float64"):
        arrays = [np.asarray(x).astype(dtype) for x in (state()[0], np.zeros(N), fall)]
        tau = jax.jit(functools.partial(js.inverse_dynamics, chain(), precision=precision))(*arrays)
    size = max(map(abs, forces))
    error = max(abs(mp.mpf(float(x)) - y) for x, y in zip(np.asarray(tau, np.float64), forces, strict=True))
    assert error <= ALGORITHM.allowed(precision, N, u, size, mag), float(error / u / mag)
    if not precision.sees_whole_sums and dtype == "float32":
        assert error > ALGORITHM.allowed(precision, N, u, size, size)
