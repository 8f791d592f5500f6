"""A double pendulum in closed form, its equations of motion derived here.

Two links hang in a vertical plane, turned about its normal y: the first by q1 from the vertical, the second by q2 from
the first. Link i has mass m_i, its centre of mass at a distance a_i below its joint, and the inertia I_i about y there;
the second joint is at a distance l below the first. With s1 = sin q1, s12 = sin(q1 + q2) and so on, and w = q1' + q2',
the centres of mass are at (x, z)

    (-a1 s1, -a1 c1)        (-l s1 - a2 s12, -l c1 - a2 c12)

and their speeds, squared, are a1^2 q1'^2 and l^2 q1'^2 + a2^2 w^2 + 2 l a2 q1' w c2. The energies are

    2 T = (I1 + m1 a1^2 + m2 l^2) q1'^2 + (I2 + m2 a2^2) w^2 + 2 h q1' w c2        with h = m2 l a2
      V = -(m1 a1 + m2 l) g c1 - m2 a2 g c12

With J1 and J2 for the two brackets of T, T is half of q'^T M q' with

    M = [J1 + J2 + 2 h c2,  J2 + h c2]
        [J2 + h c2,         J2       ]

Lagrange's equations, d/dt dT/dq' - dT/dq + dV/dq = tau, say tau = M q'' + c + G. In M only c2 changes, at the rate
-s2 q2'; of the angles T depends on q2 alone, and dT/dq2 = -h q1' w s2. Then

    c = M' q' - dT/dq = [-h s2 (2 q1' q2' + q2'^2)]        G = dV/dq = [(m1 a1 + m2 l) g s1 + m2 a2 g s12]
                        [ h s2 q1'^2              ]                    [ m2 a2 g s12                     ]

As in RigidBodyDynamics.jl, test/test_double_pendulum.jl. Evaluated in 60 digits; errors are relative to the largest
number of each result over all states: 4 n u, n = 2 joints, as the docstrings say, and times the condition of M for
forward dynamics.
"""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

# Numbers that are the same in every dtype. Of the inertias only the moment about y matters.
M1, M2, A1, A2, L, I1, I2, G = 1.5, 0.75, 0.625, 0.875, 1.25, 0.1875, 0.0625, 9.8125
N = 16


@functools.cache
def pendulum():
    def link(name, mass, a, moment):
        inertia = js.SpatialInertia(mass, np.array([0.0, 0.0, -a]), np.diag([1.5 * moment, moment, moment]))
        return js.Body(name, inertia)

    below = js.RigidTransform(js.Rotation.identity(dtype=np.float64), np.array([0.0, 0.0, -L]))
    joints = [
        js.Joint("shoulder", "revolute", "world", "upper", axis=(0, 1, 0)),
        js.Joint("elbow", "revolute", "upper", "lower", axis=(0, 1, 0), placement=below),
    ]
    bodies = [link("upper", M1, A1, I1), link("lower", M2, A2, I2)]
    return js.Mechanism.build(bodies, joints, gravity=(0.0, 0.0, -G), dtype=np.float64)


@functools.cache
def states():
    """(N, 2) each: q, q', and q'' or tau. The first hangs still, the second stands upright."""
    q, v, x = np.random.default_rng(0).uniform(-3, 3, (3, N, 2)).astype(np.float32)
    q[:2], v[:2] = [[0, 0], [np.pi, 0]], 0
    return q, v, x


def closed_form(q, v, x):
    """What the page above says of one state, by name; x stands for q'' and for tau."""
    (q1, q2), (v1, v2) = q, v
    J1, J2, h = I1 + M1 * A1**2 + M2 * L**2, I2 + M2 * A2**2, M2 * L * A2 * mp.cos(q2)
    M = mp.matrix([[J1 + J2 + 2 * h, J2 + h], [J2 + h, J2]])
    slope = M2 * L * A2 * mp.sin(q2)
    c = mp.matrix([-slope * (2 * v1 * v2 + v2**2), slope * v1**2])
    upper, lower = (M1 * A1 + M2 * L) * G, M2 * A2 * G
    gravity = mp.matrix([upper * mp.sin(q1) + lower * mp.sin(q1 + q2), lower * mp.sin(q1 + q2)])
    return {
        "inverse dynamics": M * x + c + gravity,
        "forward dynamics": M**-1 * (x - c - gravity),
        "mass matrix": M,
        "bias forces": c + gravity,
        "gravity forces": gravity,
        "kinetic energy": v.T * M * v / 2,
        "potential energy": [-upper * mp.cos(q1) - lower * mp.cos(q1 + q2)],
    }


def exactly(row):
    return mp.matrix([mp.mpf(float(y)) for y in row])


@functools.cache
def expected():
    """name -> (N, ...) numbers of 60 digits, and the largest condition of M."""
    with mp.workdps(60):
        found = [
            closed_form(*(mp.matrix([mp.mpf(float(y)) for y in row]) for row in rows))
            for rows in zip(*states(), strict=True)
        ]
    condition = max(np.linalg.cond(np.array(x["mass matrix"].tolist(), float)) for x in found)
    return {name: np.array([list(x[name]) for x in found]) for name in found[0]}, condition


def ours(q, v, x):
    mech = pendulum()
    return {
        "inverse dynamics": js.inverse_dynamics(mech, q, v, x),
        "forward dynamics": js.forward_dynamics(mech, q, v, x),
        "mass matrix": js.mass_matrix(mech, q),
        "bias forces": js.bias_forces(mech, q, v),
        "gravity forces": js.gravity_forces(mech, q),
        "kinetic energy": js.kinetic_energy(mech, q, v),
        "potential energy": js.potential_energy(mech, q),
    }


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_every_algorithm_is_the_closed_form(dtype):
    with jax.enable_x64(dtype == "float64"):
        run = jax.jit if dtype == "float32" else interpreted
        found = run(jax.vmap(ours))(*(x.astype(dtype) for x in states()))
    numbers, condition = expected()
    for name, exact in numbers.items():
        assert found[name].dtype == dtype
        errors = abs(np.asarray(found[name], float).reshape(exact.shape) - exact) / abs(exact).max()
        allowed = 8 * float(jnp.finfo(dtype).eps) / 2 * (condition if name == "forward dynamics" else 1)
        assert errors.max() <= allowed, (name, float(errors.max() / allowed))
