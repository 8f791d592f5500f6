"""The error bounds of the docstrings, against 60 digits: chains of n revolute joints, bodies of very different masses.

Of the largest number of each result, where terms cancel too: see `dynamics.bounds`. For forward dynamics times the
condition of the mass matrix.
"""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.forward_dynamics import FORWARD_DYNAMICS
from tests.helpers import exact_dynamics as exact
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

N = 4
POSE = np.float64(np.float32([1.25, -0.5, 2.75, -2.0]))


@functools.cache
def chain():
    """Frames turned by quarters, which is exact; masses from 1e-3 to 1e3. It hangs from where the centre of mass is at
    the world's origin in the configuration `POSE`."""
    with mp.workdps(exact.DIGITS):
        (center, _) = exact.Chain(hung_from(np.zeros(3)), POSE, POSE, POSE).center()
    return hung_from(-np.float64(np.float32(center.value.astype(float))))


def hung_from(start):
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
        X = js.RigidTransform(quarters[i % 2], arm if i else start)
        joints.append(js.Joint(f"joint{i}", "revolute", names[i], names[i + 1], axis=np.eye(3)[i % 3], placement=X))
    return js.Mechanism.build(bodies, joints, gravity=(0.5, -9.75, 1.25), dtype=np.float64)


def at(q, v=(0,) * N, a=(0,) * N):
    return exact.Chain(chain(), q, v, a)


def floats(numbers, shape=(N,)):
    return np.array(exact.values(numbers), float).reshape(shape)


@functools.cache
def states():
    """name -> (q, v, a), of which forward dynamics takes a as the forces. Numbers of float32: terms that cancel leave
    what rounding the numbers makes."""
    pose, (q, v, a) = POSE, np.random.default_rng(1).uniform(-3, 3, (3, N))
    with mp.workdps(exact.DIGITS):
        held = floats(at(pose).gravity_forces())
        still = np.linalg.svd(floats(at(pose).center_jacobian(), (3, N)))[2][-1]
        found = {
            "any": (q, v, a),
            "falling from rest": (pose, 0 * v, -np.linalg.solve(floats(at(pose).mass_matrix(), (N, N)), held)),
            "held at rest": (pose, 0 * v, held),
            "held in motion": (pose, v, floats(at(pose, np.float32(v)).bias_forces())),
            "about its centre of mass": (pose, still, a),
            "in balance": (balanced(q), v, a),
        }
    return {name: [np.float64(np.float32(x)) for x in state] for name, state in found.items()}


def balanced(q):
    """Where the forces of gravity are zero, by Newton's method."""
    for _ in range(10):
        forces, slopes = at(q).gravity_forces(), at(q).derivative("q")
        q = q - np.linalg.solve(floats(slopes, (N, N)), floats(forces))
    return np.mod(q + np.pi, 2 * np.pi) - np.pi


@functools.cache
def expected(name):
    """algorithm -> numbers of 60 digits, with the size of their terms."""
    with mp.workdps(exact.DIGITS):
        q, v, a = states()[name]
        c = at(q, v, a)
        return {
            "rotations": c.rotations(),
            "positions": c.positions(),
            "velocities": c.velocities(),
            "accelerations": c.accelerations(),
            "jacobian": c.jacobian(N - 2),
            "jacobian rate": c.jacobian_rate(N - 2),
            "inverse dynamics": c.inverse_dynamics(),
            "forward dynamics": c.forward_dynamics(),
            "joint reactions": c.joint_reactions(),
            "applied wrench": c.applied_wrench(N - 1, a[:3], v[:3], q[:3]),
            "bias forces": c.bias_forces(),
            "gravity forces": c.gravity_forces(),
            "regressor": c.regressor(),
            "mass matrix": c.mass_matrix(),
            "kinetic energy": c.kinetic_energy(),
            "potential energy": c.potential_energy(),
            "centre of mass": c.center()[0].numbers(),
            "velocity of the centre of mass": c.center()[1].numbers(),
            "Jacobian of the centre of mass": c.center_jacobian(),
            "momentum": c.momentum(),
            "momentum matrix": c.momentum_matrix(),
            "dtau_dq": c.derivative("q"),
            "dtau_dv": c.derivative("v"),
        }


def _applied(mech, q, v, a):
    """Of a wrench at a point of the last body, in its axes: any numbers serve."""
    F = js.AppliedForces([f"body{N - 1}"], js.SpatialForce(a[None, :3], v[None, :3]), q[None, :3], "frame")
    return js.applied_wrenches(mech, q, F)[f"body{N - 1}"].to_array()


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
            "jacobian rate": js.jacobian_rate(mech, q, v, f"body{N - 2}"),
            "inverse dynamics": js.inverse_dynamics(mech, q, v, a),
            "forward dynamics": js.forward_dynamics(mech, q, v, a),
            "joint reactions": js.joint_reactions(mech, q, v, a).to_array(),
            "applied wrench": _applied(mech, q, v, a),
            "bias forces": js.bias_forces(mech, q, v),
            "gravity forces": js.gravity_forces(mech, q),
            "regressor": js.regressors.joint_torque_regressor(mech, q, v, a),
            "mass matrix": js.mass_matrix(mech, q),
            "kinetic energy": js.kinetic_energy(mech, q, v),
            "potential energy": js.potential_energy(mech, q),
            "centre of mass": js.center_of_mass(mech, q),
            "velocity of the centre of mass": js.center_of_mass_velocity(mech, q, v),
            "Jacobian of the centre of mass": js.center_of_mass_jacobian(mech, q),
            "momentum": js.centroidal_momentum(mech, q, v).to_array(),
            "momentum matrix": js.centroidal_momentum_matrix(mech, q),
            "dtau_dq": derivatives.dtau_dq,
            "dtau_dv": derivatives.dtau_dv,
        }


# What cancels where: there errors in "fast" are larger than the bound would be without the size of terms.
CANCELLING = {
    ("falling from rest", "inverse dynamics"),
    ("held at rest", "forward dynamics"),
    ("held in motion", "forward dynamics"),
    ("held at rest", "centre of mass"),
    ("held at rest", "potential energy"),
    ("about its centre of mass", "velocity of the centre of mass"),
    ("in balance", "gravity forces"),
}


# Formulas are evaluated in NumPy. Compiled, `test_transformations` holds their bits in "reproducible", and bounds of
# inverse dynamics in the other precisions (`test_dtypes_and_precisions`); test_step_bounds those of steps in "fast".
CASES = [("reproducible", "float32", interpreted), ("compensated", "float32", interpreted)]
CASES += [slow(precision, dtype, jax.jit) for precision in js.Precision for dtype in ("float32", "float64")]


@pytest.mark.parametrize(("precision", "dtype", "run"), CASES)
def test_every_algorithm(precision, dtype, run):
    """In one program, in a batch of states. Where it is any state, of the results themselves. The largest errors take a
    fifth of the bound, and of that of accelerations a hundredth; in "compensated" more than half of one rounding."""
    precision = js.Precision(precision)
    u, beyond, reached = float(jnp.finfo(dtype).eps) / 2, set(), {}
    with jax.enable_x64(dtype == "float64"):
        batch = [np.stack(x).astype(dtype) for x in zip(*states().values(), strict=True)]
        found = jax.tree.map(np.asarray, run(jax.vmap(functools.partial(all_of_ours, precision)))(*batch))
    for i, state in enumerate(states()):
        condition = np.linalg.cond(floats(expected(state)["mass matrix"], (N, N)))
        for name, numbers in expected(state).items():
            size = max(map(abs, exact.values(numbers)))
            mag = size if state == "any" else max(x.size for x in numbers)
            bound, n = (FORWARD_DYNAMICS, N * condition) if name == "forward dynamics" else (ALGORITHM, N)
            ours = np.float64(found[name][i]).ravel()
            error = max(abs(mp.mpf(float(x)) - y) for x, y in zip(ours, exact.values(numbers), strict=True))
            allowed = bound.allowed(precision, u, n * mag, size)
            assert error <= allowed, (state, name, float(error / u / mag))
            reached[bound] = max(reached.get(bound, 0), float(error / allowed) if allowed else 0)
            beyond |= {(state, name)} if error > bound.allowed(precision, u, n * size, size) else set()
    assert beyond >= CANCELLING or precision.sees_whole_sums or dtype == "float64"
    if run is interpreted:  # The condition of a matrix is a bound of what its worst right side does.
        of_all, of_accelerations = (0.5, 0.5) if precision.sees_whole_sums else (0.2, 0.009)
        assert reached[ALGORITHM] > of_all and reached[FORWARD_DYNAMICS] > of_accelerations


# -- many wrenches on one body ----------------------------------------------------------------------------------------

U = 2.0**-24


def many(k):
    """name -> (tau, f, p) of k wrenches, (k, 3) each in float32."""
    rng = np.random.default_rng(k)
    wild = rng.standard_normal((3, k, 3)) * 2.0 ** rng.integers(-20, 20, (3, k, 1))
    some, order = wild[:, : k // 2], rng.permutation(k)
    opposed = np.stack([-some[0], -some[1], some[2]]) * (1 + 4 * U * rng.integers(-8, 9, some.shape))
    first = np.where(np.arange(k)[:, None], U, 1.0) * np.ones(3)
    found = {
        "of sizes of many orders": wild,
        "in pairs that cancel but for their last digits": np.concatenate([some, opposed], 1)[:, order],
        "beside a large one": (first, first, 0 * first),  # which a running sum does not see grow
    }
    return {name: [np.float32(x) for x in wrenches] for name, wrenches in found.items()}


@pytest.mark.parametrize(("k", "axes"), [(64, "world"), (64, "frame"), slow(1000, "world")])
def test_many_wrenches_on_one_body(k, axes):
    """They add ceil(log2 k) u mag to the error; a running sum would add up to (k - 1) u mag."""
    q, body, cases = states()["any"][0], f"body{N - 1}", many(k)

    def summed(q, tau, f, p):
        F = js.AppliedForces([body] * k, js.SpatialForce(tau, f), p, axes)
        return js.applied_wrenches(chain(), q, F)[body].to_array()

    found = interpreted(summed)(np.float32(q), *(np.stack(x) for x in zip(*cases.values(), strict=True)))
    for ours, (name, wrenches) in zip(found, cases.items(), strict=True):
        with mp.workdps(exact.DIGITS):
            numbers = at(q).applied_wrenches(N - 1, *wrenches, axes)
            error = max(abs(mp.mpf(float(x)) - y) for x, y in zip(ours, exact.values(numbers), strict=True))
        mag = max(x.size for x in numbers)
        allowed = ALGORITHM.allowed("reproducible", U, N * mag) + np.ceil(np.log2(k)) * U * mag
        assert error <= allowed, (name, float(error / U / mag))
