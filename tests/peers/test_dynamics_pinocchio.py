"""Every algorithm on real robots, against Pinocchio in float64: relative error 1e-12 in float64, 2e-5 in float32.

Relative to the largest number of each result. What differs by choice, and is converted: see `pinocchio_models`.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js

pytest.importorskip("yourdfpy")
pin = pytest.importorskip("pinocchio")
models = pytest.importorskip("peers.pinocchio_models")

N = 8
ALLOWED = {"float64": 1e-12, "float32": 2e-5}
FAST = [("ur5", False), ("double_pendulum", True)]
SLOW = [(name, base) for name in models.FILES for base in (False, True) if (name, base) not in FAST]
robots = pytest.mark.parametrize(
    ("name", "floating_base"),
    [*FAST, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)],
    ids=lambda x: x if isinstance(x, str) else "floating" if x else "fixed",
)


@functools.cache
def states(name, floating_base):
    with jax.enable_x64(True):
        return models.States(*models.load(name, floating_base), N)


def all_of_ours(mech, body, q, v, a):
    tau = js.inverse_dynamics(mech, q, v, a)
    V = js.body_velocities(mech, q, v)
    return {
        "inverse dynamics": tau,
        "bias forces": js.bias_forces(mech, q, v),
        "gravity forces": js.gravity_forces(mech, q),
        "forward dynamics": js.forward_dynamics(mech, q, v, a),
        "mass matrix": js.mass_matrix(mech, q),
        "positions": js.forward_kinematics(mech, q).translation,
        "rotations": js.forward_kinematics(mech, q).rotation.to_matrix(),
        "velocities": jnp.concatenate([V.w, V.v], -1),
        "jacobian": js.jacobian(mech, q, body),
        "centre of mass": js.center_of_mass(mech, q),
        "kinetic energy": js.kinetic_energy(mech, q, v),
        "potential energy": js.potential_energy(mech, q),
    }


def all_of_pinocchio(s, body):
    model, G = s.model, s.of_ours
    frames = [model.getFrameId(name, pin.FrameType.BODY) for name in s.mech.body_names]
    frame = model.getFrameId(body, pin.FrameType.BODY)

    def mass(m, d, q, v, a):
        upper = np.triu(pin.crba(m, d, q))
        return G.T @ (upper + np.triu(upper, 1).T) @ G

    def placed(part):
        def function(m, d, q, v, a):
            pin.framesForwardKinematics(m, d, q)
            return [getattr(d.oMf[f], part) for f in frames]

        return function

    def velocities(m, d, q, v, a):
        pin.forwardKinematics(m, d, q, v)
        found = [pin.getFrameVelocity(m, d, f, pin.LOCAL_WORLD_ALIGNED) for f in frames]
        return [np.concatenate([V.angular, V.linear]) for V in found]

    def jacobian(m, d, q, v, a):
        J = pin.computeFrameJacobian(m, d, q, frame, pin.LOCAL_WORLD_ALIGNED)
        return np.vstack([J[3:], J[:3]]) @ G

    def forward(m, d, q, v, a):
        if s.mech.nv == m.nv:
            return G.T @ pin.aba(m, d, q, v, a)
        return np.linalg.solve(mass(m, d, q, v, a), s.a[k.pop(0)] - G.T @ pin.nonLinearEffects(m, d, q, v))

    k = list(range(N))
    functions = {
        "inverse dynamics": lambda m, d, q, v, a: G.T @ pin.rnea(m, d, q, v, a),
        "bias forces": lambda m, d, q, v, a: G.T @ pin.nonLinearEffects(m, d, q, v),
        "gravity forces": lambda m, d, q, v, a: G.T @ pin.computeGeneralizedGravity(m, d, q),
        "forward dynamics": forward,
        "mass matrix": mass,
        "positions": placed("translation"),
        "rotations": placed("rotation"),
        "velocities": velocities,
        "jacobian": jacobian,
        "centre of mass": lambda m, d, q, v, a: pin.centerOfMass(m, d, q),
        "kinetic energy": lambda m, d, q, v, a: pin.computeKineticEnergy(m, d, q, v),
        "potential energy": lambda m, d, q, v, a: pin.computePotentialEnergy(m, d, q),
    }
    return {name: s.each(function) for name, function in functions.items()}


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@robots
def test_all_algorithms(name, floating_base, dtype):
    s = states(name, floating_base)
    body = s.mech.body_names[-1]
    with jax.enable_x64(dtype == "float64"):
        ours = jax.jit(jax.vmap(functools.partial(all_of_ours, s.mech, body)))(
            *(jnp.asarray(x.astype(dtype)) for x in (s.q, s.v, s.a))
        )
    for what, expected in all_of_pinocchio(s, body).items():
        error = abs(np.asarray(ours[what], float) - expected).max() / abs(expected).max()
        assert ours[what].dtype == dtype and error <= ALLOWED[dtype], (what, error)
