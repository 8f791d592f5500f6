"""Long chains, mass ratios, small and large lengths, bodies without mass: against 60 digits, values and derivatives."""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.mechanism import editing
from jaxspatial.mechanism.joints import KINDS
from tests.helpers import exact_dynamics as exact
from tests.helpers import tangents
from tests.helpers.counting import asked_for, done
from tests.helpers.interpreted import interpreted

slow = functools.partial(pytest.param, marks=pytest.mark.slow)


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("is_data", [False, True])
@pytest.mark.parametrize("mass", [2.0, 0.0])
def test_a_floating_body_without_rotational_inertia(mass, is_data):
    """A torque does not accelerate it, and without mass a force does not either: these accelerations are exactly +0."""
    point = js.SpatialInertia(mass, np.zeros(3), np.zeros(6))
    joint = js.Joint("root", "free", "world", "point")
    mech = js.Mechanism.build([js.Body("point", point)], [joint], dtype=np.float64)
    mech = mech.replace(gravity=np.zeros(3))
    mech = mech.as_data() if is_data else mech
    q, tau = np.eye(7)[0], np.arange(1.0, 7.0)

    def follows(tau):
        return js.forward_dynamics(mech, q, np.zeros(6), tau)

    inverse = np.diag([0.0] * 3 + [0.5 if mass else 0.0] * 3)
    found = follows(tau)
    np.testing.assert_array_equal(found, inverse @ tau)
    assert not np.signbit(found).any()
    np.testing.assert_array_equal(jax.jacfwd(follows)(tau), inverse)
    np.testing.assert_array_equal(jax.jacrev(follows)(tau), inverse)


def test_a_joint_without_inertia_is_as_if_locked():
    """Forces of its own do nothing, the others move as with the joint locked; steps leave its velocity as it is."""
    rng = np.random.default_rng(3)
    joints = [js.Joint("a", "revolute", "world", "arm", axis=(1, 0, 0)), js.Joint("b", "revolute", "arm", "hand")]
    mech = js.Mechanism.build([js.Body("arm", body(rng)), js.Body("hand")], joints, dtype=np.float64)
    q, v, tau = np.array([0.3, 0.2]), np.array([0.5, 1.0]), np.array([1.0, 7.0])
    vdot = js.forward_dynamics(mech, q, v, tau)
    locked = js.forward_dynamics(js.lock_joints(mech, {"b": 0.2}), q[:1], v[:1], tau[:1])
    np.testing.assert_allclose(vdot, [locked[0], 0.0], rtol=1e-14)
    assert np.isnan(js.mass_matrix_factor(mech, q).L).any()
    for step in (js.semi_implicit_step, js.rk4_step):
        assert step(mech, q, v, tau, 0.01)[1][1] == v[1]
    assert np.isnan(js.symplectic_step(mech, q, v, tau, 0.01)[1]).any()


def test_a_mass_matrix_without_a_factor():
    """Where one pivot is not positive all is NaN: here the last, of two hinges in line that turn one body."""
    ends = ("a", "world", "arm"), ("b", "arm", "hand")
    joints = [js.Joint(name, "revolute", parent, child, axis=(1, 0, 0)) for name, parent, child in ends]
    spinning = js.SpatialInertia(np.float64(1), np.zeros(3), 4 * np.eye(3))
    mech = js.Mechanism.build([js.Body("arm"), js.Body("hand", spinning)], joints, dtype=np.float64)
    np.testing.assert_array_equal(js.mass_matrix(mech, np.zeros(2)), np.full((2, 2), 4.0))
    for of in (js.mass_matrix_factor, jax.jit(jax.vmap(js.mass_matrix_factor, (None, 0)))):
        assert np.isnan(of(mech, np.zeros((1, 2))).L).all()


def test_armature_of_a_floating_root():
    """One number for each of its six velocities, on the diagonal of the mass matrix."""
    rng = np.random.default_rng(8)
    root = js.Joint("root", "free", "world", "base")
    mech = js.Mechanism.build([js.Body("base", body(rng))], [root], dtype=np.float64)
    armature, q, tau = rng.uniform(1, 2, 6), np.array([0.6, 0, 0.8, 0, 1, 2, 3.0]), rng.standard_normal(6)
    heavier = mech.replace(armature=armature)
    M = np.asarray(js.mass_matrix(mech, q)) + np.diag(armature)
    found = js.forward_dynamics(heavier, q, np.zeros(6), tau)
    gravity = js.gravity_forces(mech, q)
    assert abs(M @ found + gravity - tau).max() <= 64 * 2.0**-53 * abs(M).max() * abs(found).max()
    np.testing.assert_allclose(js.mass_matrix(heavier, q), M, rtol=1e-15)


@pytest.mark.parametrize("kind", ["free", "planar"])
def test_armature_along_axes_that_turn(kind, monkeypatch):
    """It is as the inertia of a ball about the joint, without weight. Without armature it leaves no operation."""
    rng, a, zero, n = np.random.default_rng(9), 0.3, np.zeros(3), KINDS[kind].nv
    own = body(rng)

    def floating(inertia, armature):
        joint = js.Joint("root", kind, "world", "base", armature=armature)
        return js.Mechanism.build([js.Body("base", inertia)], [joint], gravity=zero, dtype=np.float64)

    held, bare = floating(own, a), floating(own, 0.0)
    ball = floating(own + js.SpatialInertia(np.float64(a), zero, a * np.eye(3)), 0.0)
    q, v = np.asarray(held.neutral()) + 0.1 * rng.standard_normal(held.nq), rng.standard_normal((3, n))
    for function, *x in (
        (js.inverse_dynamics, *v[:2]), (js.forward_dynamics, *v[:2]), (js.inverse_dynamics_derivatives, *v[:2]),
        (js.MomentumObserver.start, v[0]), (js.kinetic_energy, v[0]),
        *((step, *v[:2], 0.01) for step in (js.semi_implicit_step, js.rk4_step, js.symplectic_step)),
    ):  # fmt: skip
        jax.tree.map(
            functools.partial(np.testing.assert_allclose, rtol=1e-13, atol=1e-13),
            interpreted(functools.partial(function, held))(q, *x),
            interpreted(functools.partial(function, ball))(q, *x),
        )

    def operations(mech):
        return done(lambda q, v: (js.forward_dynamics(mech, q, v, v), js.bias_forces(mech, q, v)), q, v[0])

    found = operations(bare)
    assert sum(operations(held).values()) > sum(found.values())
    monkeypatch.setattr(KINDS[kind], "transport", lambda joint, v, u: (joint.zero,) * n)
    assert found == operations(floating(own, 0.0))


def test_contact_pushes_armature_too():
    """A spinning box without weight, its mass at its origin: (m + armature) (u' - u) = dt f in the world's axes."""
    box = js.SpatialInertia.solid_box(np.array([0.4, 0.3, 0.2]), mass=np.float64(2))
    root = js.Joint("root", "free", "world", "box", armature=0.5)
    mech = js.Mechanism.build([js.Body("box", box)], [root], gravity=np.zeros(3), dtype=np.float64)
    contacts = js.PointContacts(
        ["box"], np.array([[0.2, 0.15, -0.1]]), stiffness=1e4, relaxation_time=0.01, friction=0.5
    )
    q, v = np.array([0.96, 0, 0.28, 0, 0, 0, 0.09]), np.array([2.0, 4, 6, 1, 0.4, -2])
    found = interpreted(lambda *x: js.convex_step(mech, *x, 0.01, contacts=contacts))(q, v, np.zeros(6))
    u, after = (np.asarray(js.Rotation.from_quaternion(x[:4]) @ y[3:]) for x, y in ((q, v), (found.q, found.v)))
    assert abs(found.contact_forces.f).min() > 1
    np.testing.assert_allclose(2.5 * (after - u), 0.01 * found.contact_forces.f[0], rtol=1e-9)


def chain(n, dtype=np.float64, seed=0):
    return js.testing.random_mechanism(seed, n, ["revolute"], is_chain=True, dtype=np.float64).astype(dtype)


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
    tau, twice = (
        interpreted(functools.partial(js.inverse_dynamics, mech, precision=p))(q, v, a)
        for p in ("reproducible", "compensated")
    )
    assert error(twice, expected) <= 4 * 2.0**-24 and error(tau, expected) <= 4 * n * 2.0**-24


@pytest.mark.parametrize(
    ("n", "scale", "ratio"),
    [(24, 1.0, 1e10), slow(64, 1.0, 1e10), slow(64, 1e-6, 1.0), slow(64, 1e6, 1.0), slow(64, 1.0, 0.0)],
)
def test_masses_and_lengths_of_all_sizes(n, scale, ratio):
    """Every other mass so much larger, or without mass; lengths scaled: what formulas make of them in NumPy."""
    mech, (q, v, a) = without_armature(chain(n)), state(n)
    M = mech.inertias
    factor = np.where(np.arange(n) % 2 == 0, ratio, 1.0)
    inertias = js.SpatialInertia(M.mass * factor, M.com * scale, M.central * (factor * scale**2)[:, None])
    placements = js.RigidTransform(mech.placements.rotation, mech.placements.translation * scale)
    mech = mech.replace(inertias=inertias, placements=placements)
    expected = exact.inverse_dynamics(mech, q, v, a)

    def all_of_them(q, v, a):
        tau = js.inverse_dynamics(mech, q, v, a)
        twice = js.inverse_dynamics(mech, q, v, a, precision="compensated")
        gradient = jax.grad(lambda q: js.inverse_dynamics(mech, q, v, a).sum())(q)
        return tau, twice, js.mass_matrix(mech, q), js.forward_dynamics(mech, q, v, tau), gradient

    tau, twice, M, back, gradient = interpreted(all_of_them)(q, v, a)
    assert error(tau, expected) <= 4 * n * 2.0**-53
    assert error(twice, expected) <= 1.01 * 2.0**-53
    assert abs(back - a).max() <= 4 * n * 2.0**-53 * np.linalg.norm(np.linalg.inv(M), 2) * abs(tau).max()
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize(("n", "run"), [(30, interpreted), slow(100, jax.jit)], ids=["30", "100 compiled"])
def test_compensated_float64_of_a_long_chain_in_free_fall(n, run):
    """What is left of forces is rounding of the accelerations: relative to their terms, as promised."""
    mech, (q, v, _) = without_armature(chain(n)), state(n)
    masses, gravity = interpreted(lambda q: (js.mass_matrix(mech, q), js.gravity_forces(mech, q)))(q)
    fall = np.linalg.solve(masses, -gravity)
    expected = exact.inverse_dynamics(mech, q, 0 * v, fall)
    mag, size = (abs(masses) @ abs(fall) + abs(gravity)).max(), float(max(map(abs, expected)))
    tau = run(functools.partial(js.inverse_dynamics, mech, precision="compensated"))(q, 0 * v, fall)
    limit = ALGORITHM.allowed(js.Precision.COMPENSATED, 2.0**-53, n * mag, size)
    assert size <= 1e-14 * mag and error(tau, expected) * size <= limit


def planar_and_general(n):
    """Chains of two lengths side by side on a base, and one that is alone."""
    rng = np.random.default_rng(n)
    joints, bodies = [js.Joint("root", "free", "world", "base")], [js.Body("base", body(rng))]
    for name, length in (("a", n), ("b", n), ("c", 1)):
        for k in range(length):
            parent = "base" if k == 0 else f"{name}{k - 1}"
            placement = js.RigidTransform(js.Rotation.identity(dtype=np.float64), rng.standard_normal(3))
            axis = np.eye(3)[rng.integers(3)] * (-1) ** k
            joints.append(js.Joint(f"j{name}{k}", "revolute", parent, f"{name}{k}", placement=placement, axis=axis))
            bodies.append(js.Body(f"{name}{k}", body(rng)))
    return js.Mechanism.build(bodies, joints, dtype=np.float64)


def body(rng):
    a = rng.standard_normal((3, 3)) / 5
    return js.SpatialInertia(1 + rng.random(), rng.standard_normal(3) / 5, a @ a.T + np.eye(3) / 10)


def alone(mech, name):
    """The chain of a name with its base: nothing side by side."""
    names = [x for x in mech.joint_names if x == "root" or x.startswith(f"j{name}")]
    bodies, joints, _ = editing.parts(mech)
    kept = [j for j in joints if j.name in names]
    held = {j.child for j in kept}
    return js.Mechanism.build([b for b in bodies if b.name in held], kept, (), mech.gravity, mech.dtype)


@pytest.mark.parametrize("n", [2, slow(5)])
def test_chains_side_by_side_have_the_bits_of_each_alone(n):
    """Positions and velocities of a chain do not depend on what hangs beside it."""
    mech, rng = planar_and_general(n), np.random.default_rng(0)
    q = np.concatenate([[1.0, 0, 0, 0, 0.1, 0.2, 0.3], rng.standard_normal(mech.nq - 7)])
    v = rng.standard_normal(mech.nv)
    velocities = lambda m, q, v: interpreted(functools.partial(js.body_velocities, m))(q, v).to_array()  # noqa: E731
    whole = velocities(mech, q, v)
    for name in "abc":
        part = alone(mech, name)
        rows = [mech.body_names.index(x) for x in part.body_names]
        of_q = np.concatenate([mech.joint_position_indices(x) for x in part.joint_names])
        of_v = np.concatenate([mech.joint_velocity_indices(x) for x in part.joint_names])
        np.testing.assert_array_equal(velocities(part, q[of_q], v[of_v]), whole[np.array(rows)])


def test_programs_do_not_grow_with_chains():
    """Of 10 or 100 links, of one finger or five, the same operations."""
    counts, in_code = [], []
    for n in (10, 100, 200):
        mech, x = without_armature(chain(n)), state(n)
        forward = functools.partial(js.forward_dynamics, mech)
        counts.append(asked_for(forward, *x))
        in_code.append(sum(done(forward, *x, in_all_turns=False).values()))
    assert counts[0] == counts[1] == counts[2]
    # Many links are a loop, but for the sines and cosines of their angles.
    assert in_code[2] - in_code[1] <= 75 * 100
    hands = [branching({f"f{i}": ("base", 4) for i in range(n)}) for n in (1, 5)]
    assert operations(hands[1]) <= 1.2 * operations(hands[0])


def test_programs_do_not_grow_with_limbs():
    """Of a humanoid, arms on a waist beside legs, not a third more operations than of its legs."""
    legs = {"left": ("base", 6), "right": ("base", 6)}
    limbs = {"waist": ("base", 3), "left arm": ("waist2", 7), "right arm": ("waist2", 7)}
    assert operations(branching(legs | limbs)) <= 1.33 * operations(branching(legs))


def test_limbs_that_are_one_loop():
    """Chains of other lengths that hang on one another: laws that hold whatever hangs where."""
    mech, (q, v, a) = limbs()
    assert [b.bodies.shape for b in mech.topology.bundles] == [(1, 1), (6, 2)]
    found = interpreted(functools.partial(_all_of_limbs, mech))(q, v, a)
    M, tau, allowed = found["M"], found["tau"], 1e3 * 2.0**-53
    np.testing.assert_allclose(found["back"], a, atol=allowed * np.linalg.cond(M))
    # Energies add up bodies, of which none passes anything on to another.
    np.testing.assert_allclose(M.diagonal() / 2, found["by_motions"], rtol=allowed)
    np.testing.assert_allclose(M @ a, tau - found["bias"], atol=allowed * abs(tau).max())
    slope = found["slope"]
    np.testing.assert_allclose(found["gravity"][6:], slope[7:], atol=allowed * abs(slope).max())
    expected = found["rates"]
    np.testing.assert_allclose(found["dtau_dv"], expected, atol=10 * allowed * abs(expected).max())


def _all_of_limbs(mech, q, v, a):
    tau = js.inverse_dynamics(mech, q, v, a)
    return {
        "tau": tau,
        "back": js.forward_dynamics(mech, q, v, tau),
        "M": js.mass_matrix(mech, q),
        "by_motions": jax.vmap(lambda x: js.kinetic_energy(mech, q, x))(jnp.eye(mech.nv)),
        "bias": js.bias_forces(mech, q, v),
        "gravity": js.gravity_forces(mech, q),
        "slope": jax.grad(lambda q: js.potential_energy(mech, q))(q),
        "dtau_dv": js.inverse_dynamics_derivatives(mech, q, v, a).dtau_dv,
        "rates": tangents.jacobians(lambda v: js.inverse_dynamics(mech, q, v, a), (0,))(v)[0],
    }


@pytest.mark.slow
def test_derivatives_of_limbs_that_are_one_loop():
    """Through what turns forces into accelerations."""
    mech, (q, v, a) = limbs()
    found = interpreted(lambda v: js.forward_dynamics_derivatives(mech, q, v, a).dvdot_dv)(v)
    (expected,) = interpreted(tangents.jacobians(lambda v: js.forward_dynamics(mech, q, v, a), (0,)))(v)
    np.testing.assert_allclose(found, expected, atol=1e4 * 2.0**-53 * abs(np.asarray(expected)).max())


@pytest.mark.slow
@pytest.mark.parametrize("function", [js.gravity_forces, js.mass_matrix], ids=["gravity forces", "mass matrix"])
def test_limbs_that_are_one_loop_compensated(function):
    """Numbers of two words along the same loop."""
    mech, (q, _, _) = limbs()
    of = functools.partial(function, mech)
    found, expected = (interpreted(functools.partial(of, precision=p))(q) for p in ("compensated", "reproducible"))
    np.testing.assert_allclose(found, expected, atol=4 * 10 * 2.0**-53 * abs(expected).max())


def limbs():
    mech = branching({"leg": ("base", 2), "tail": ("base", 1), "left": ("tail0", 3), "right": ("tail0", 3)})
    rng = np.random.default_rng(3)
    q = np.concatenate([[1.0, 0, 0, 0, 0.1, 0.2, 0.3], rng.standard_normal(mech.nq - 7)])
    return mech, (q, *rng.standard_normal((2, mech.nv)))


def branching(limbs):
    """A floating base with limbs by name: (the body each hangs on, the number of its links)."""
    joints, rng = [js.Joint("root", "free", "world", "base")], np.random.default_rng(1)
    for name, (parent, n) in limbs.items():
        for k in range(n):
            placement = js.RigidTransform(js.Rotation.identity(dtype=np.float64), rng.standard_normal(3))
            on = f"{name}{k - 1}" if k else parent
            joints.append(js.Joint(f"j{name}{k}", "revolute", on, f"{name}{k}", placement=placement))
    bodies = [js.Body(joint.child, body(rng)) for joint in joints]
    return js.Mechanism.build(bodies, joints, dtype=np.float64)


def operations(mech):
    x = np.ones(mech.nq), np.ones(mech.nv), np.ones(mech.nv)
    return sum(asked_for(lambda *x: js.inverse_dynamics(mech, *x), *x).values())


@pytest.mark.slow
@pytest.mark.parametrize("n", [200, 1000])
def test_hundreds_of_links(n):
    """Inverse dynamics, compiled, to 60 digits."""
    mech, x = without_armature(chain(n)), state(n)
    assert error(js.inverse_dynamics(mech, *x), exact.inverse_dynamics(mech, *x)) <= n * 2.0**-53


@pytest.mark.parametrize("n", [60, slow(200), slow(1000)])
def test_many_links_in_all_algorithms(n):
    """There and back, by the mass matrix and by velocities; gradients."""
    mech, (q, v, a) = without_armature(chain(n)), state(n)
    bodies = (0, n // 2 - 1, n - 1)

    def all_of_them(q, v, a):
        tau, M = js.inverse_dynamics(mech, q, v, a), js.mass_matrix(mech, q)
        both = tau, js.bias_forces(mech, q, v), js.forward_dynamics(mech, q, v, tau)
        jacobians = [js.jacobian(mech, q, f"body{i}") for i in bodies]
        X, V = js.forward_kinematics(mech, q), js.body_velocities(mech, q, v)
        forces = jax.grad(lambda q: js.potential_energy(mech, q))(q), js.gravity_forces(mech, q)
        gradient = jax.grad(lambda q: js.inverse_dynamics(mech, q, v, a, precision="fast")[0])(q)
        return both, M, js.kinetic_energy(mech, q, v), jacobians, X.translation, V.to_array(), forces, gradient

    found = interpreted(all_of_them)(q, v, a)
    (tau, bias, back), M, energy, jacobians, p, V, (slope, gravity), gradient = found
    assert abs(back - a).max() <= 1e-6 * abs(a).max()
    assert abs(M @ a - (tau - bias)).max() <= 1e-11 * abs(tau).max()
    np.testing.assert_array_equal(M, M.T)
    np.testing.assert_allclose(energy, v @ M @ v / 2, rtol=1e-11)
    for i, J in zip(bodies, jacobians, strict=True):
        np.testing.assert_allclose(J @ v, V[i], rtol=1e-9, atol=1e-9)
    assert abs(slope - gravity).max() <= 1e-11 * abs(gravity).max()
    assert p.shape == (n, 3) and np.isfinite(gradient).all()
