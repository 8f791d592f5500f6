"""Quaternions of q are read normalised: by every function of q, to the bit for powers of two; by derivatives too."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import mujoco, orders
from tests.helpers import marks
from tests.helpers.counting import asked_for, done
from tests.helpers.interpreted import interpreted

U = 2.0**-53


@pytest.fixture(autouse=True)
def _float64():
    with jax.enable_x64(True):
        yield


@functools.cache
def mechanism():
    mech = js.testing.random_mechanism(3, 2, ["free", "ball"], is_chain=True, dtype=np.float64)
    return mech.replace(stiffness=np.ones(mech.nv))


@functools.cache
def state():
    """(q, another q, v, vdot)."""
    mech, rng = mechanism(), np.random.default_rng(0)
    q, q2 = (np.asarray(js.random_configuration(mech, jax.random.key(i), (), np.float64)) for i in (0, 1))
    return q, q2, *rng.standard_normal((2, mech.nv))


def quaternions(mech):
    """Where in q they are."""
    t = mech.topology
    starts = [t.q_starts[i] for i in range(len(t)) if t.kind(i).sphere == (4, 3)]
    return [slice(start, start + 4) for start in starts]


def scaled(mech, q, factor):
    q = np.array(q)
    for own in quaternions(mech):
        q[own] *= factor
    return q


def last(mech):
    return mech.body_names[-1]


FUNCTIONS = {
    "forward kinematics": lambda m, q, v, a: js.forward_kinematics(m, q).to_matrix(),
    "velocities": lambda m, q, v, a: js.body_velocities(m, q, v).to_array(),
    "accelerations": lambda m, q, v, a: js.body_accelerations(m, q, v, a).to_array(),
    "jacobian": lambda m, q, v, a: js.jacobian(m, q, last(m)),
    "jacobian rate": lambda m, q, v, a: js.jacobian_rate(m, q, v, last(m)),
    "inverse dynamics": js.inverse_dynamics,
    "forward dynamics": js.forward_dynamics,
    "mass matrix": lambda m, q, v, a: js.mass_matrix(m, q),
    "factor": lambda m, q, v, a: js.mass_matrix_factor(m, q).solve(a),
    "bias forces": lambda m, q, v, a: js.bias_forces(m, q, v),
    "gravity forces": lambda m, q, v, a: js.gravity_forces(m, q),
    "regressor": js.regressors.joint_torque_regressor,
    "energy": lambda m, q, v, a: js.kinetic_energy(m, q, v) + js.potential_energy(m, q),
    "centre of mass": lambda m, q, v, a: js.center_of_mass(m, q),
    "its velocity": lambda m, q, v, a: js.center_of_mass_velocity(m, q, v),
    "its Jacobian": lambda m, q, v, a: js.center_of_mass_jacobian(m, q),
    "momentum": lambda m, q, v, a: js.centroidal_momentum(m, q, v).to_array(),
    "momentum matrix": lambda m, q, v, a: js.centroidal_momentum_matrix(m, q),
    "derivatives": lambda m, q, v, a: js.inverse_dynamics_derivatives(m, q, v, a).dtau_dq,
    "passive forces": lambda m, q, v, a: js.passive_forces(m, q, v),
    "integrate": lambda m, q, v, a: js.integrate(m, q, v, 0.1),
    "difference": lambda m, q, v, a: js.difference(m, q, state()[1]),
    "difference to": lambda m, q, v, a: js.difference(m, state()[1], q),
    "interpolate": lambda m, q, v, a: js.interpolate(m, q, state()[1], 0.25),
    "semi-implicit step": lambda m, q, v, a: jnp.concatenate(js.semi_implicit_step(m, q, v, a, 0.01)),
    "symplectic step": lambda m, q, v, a: jnp.concatenate(js.symplectic_step(m, q, v, a, 0.01, iterations=2)),
    "Runge-Kutta step": lambda m, q, v, a: jnp.concatenate(js.rk4_step(m, q, v, a, 0.01)),
}
# What gives coordinates gives quaternions of either sign.
COORDINATES = ("integrate", "interpolate", "semi-implicit step", "symplectic step", "Runge-Kutta step")
FACTORS = (2.0, 0.5, -1.0, 2.0**-600, 2.0**600, 1e3, 1e-200)


# Every function reads q by one of these.
of_some = marks.slow_but(
    (
        "forward kinematics",
        "inverse dynamics",
        "forward dynamics",
        "passive forces",
        "integrate",
        "difference",
        "difference to",
    ),
    FUNCTIONS,
)


@functools.cache
def found(name):
    """At quaternions of length one, of these factors, and of zero."""
    with jax.enable_x64(True):
        mech, (q, _, v, a) = mechanism(), state()
        batch = np.stack([scaled(mech, q, factor) for factor in (1.0, *FACTORS, 0.0)])
        return interpreted(jax.vmap(lambda q: FUNCTIONS[name](mech, q, v, a)))(batch)


def with_positive_real_parts(name, x):
    if name in COORDINATES:
        for own in quaternions(mechanism()):
            x = np.concatenate(
                [x[..., : own.start], x[..., own] * np.sign(x[..., own][..., :1]), x[..., own.stop :]], -1
            )
    return x


@pytest.mark.parametrize("name", of_some)
def test_any_length(name):
    expected, *others, _ = (with_positive_real_parts(name, x) for x in found(name))
    for factor, x in zip(FACTORS, others, strict=True):
        # A power of two changes no bit. The factors of the mass matrix have the order of sums of a library.
        is_exact = abs(np.frexp(factor)[0]) == 0.5 and name not in ("factor", "symplectic step")
        np.testing.assert_allclose(x, expected, rtol=0, atol=0 if is_exact else 256 * U * abs(expected).max())


# Of these some numbers are of positions, or of what no orientation enters.
IN_PART = ("forward kinematics", "mass matrix", "regressor", "jacobian", "jacobian rate", "its Jacobian")
IN_PART += ("momentum matrix", "derivatives", "passive forces")


@pytest.mark.parametrize("name", of_some)
def test_a_quaternion_of_zeros_is_none(name):
    """NaN in all that it enters."""
    is_nan = np.isnan(found(name)[-1])
    assert is_nan.any() if name in IN_PART else is_nan.all()


def test_rates_of_coordinates_are_in_proportion_to_the_length():
    """As the derivative of a quaternion of that length: one that a solver steps turns at the same rate."""
    mech, (q, _, v, _) = mechanism(), state()
    rates = interpreted(functools.partial(js.configuration_rates, mech))
    expected = rates(q, v)
    for factor in (2.0, -0.25):
        np.testing.assert_array_equal(rates(scaled(mech, q, factor), v), scaled(mech, expected, factor))
    is_nan = np.isnan(rates(scaled(mech, q, 0.0), v))
    np.testing.assert_array_equal(np.flatnonzero(is_nan), mech.joint_position_indices(mech.joint_names[0])[4:])
    long, h = scaled(mech, q, 3.0), 1e-6
    place = interpreted(lambda q: js.forward_kinematics(mech, q).to_matrix())
    later = interpreted(lambda q: js.integrate(mech, q, v, h))
    np.testing.assert_allclose(place(long + h * rates(long, v)), place(later(long)), rtol=0, atol=1e-9)


def test_every_gradient_is_tangential():
    """Orthogonal to the quaternion, at any length, and the slope of what the function is."""
    names = ("inverse dynamics", "passive forces", "integrate", "difference", "difference to")
    mech, (q, _, v, a) = mechanism(), state()
    q, rng = scaled(mech, q, 1.5), np.random.default_rng(3)
    weights = {name: rng.standard_normal(found(name).shape[1:]) for name in names}

    def sums(q):
        return jnp.stack([(weights[name] * FUNCTIONS[name](mech, q, v, a)).sum() for name in names])

    gradients = interpreted(jax.jacrev(sums))(q)
    for own in quaternions(mech):
        along = gradients[:, own] @ q[own]
        np.testing.assert_array_less(abs(along), 1e-12 * (1 + np.linalg.norm(gradients, axis=1)))
    step = rng.standard_normal(mech.nq)
    ahead, behind = (interpreted(sums)(q + h * step) for h in (1e-5, -1e-5))
    np.testing.assert_allclose(gradients @ step, (ahead - behind) / 2e-5, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("function", [js.inverse_dynamics, marks.slow(js.forward_dynamics)])
def test_jacobians_by_quaternions_of_any_length(function):
    """In closed form where there are many columns or rows; and once more differentiated."""
    mech, (q, _, v, a) = mechanism(), state()
    q, rng = scaled(mech, q, 0.7), np.random.default_rng(4)
    of_q = lambda q: function(mech, q, v, a)  # noqa: E731
    forward, reverse = (interpreted(j(of_q))(q) for j in (jax.jacfwd, jax.jacrev))
    step = rng.standard_normal((2, mech.nq))
    ahead, behind = (interpreted(of_q)(q + h * step[0]) for h in (1e-5, -1e-5))
    size = abs(forward).max()
    np.testing.assert_allclose(forward @ step[0], (ahead - behind) / 2e-5, rtol=0, atol=1e-7 * size)
    np.testing.assert_allclose(reverse, forward, rtol=0, atol=1e-12 * size)
    second = interpreted(jax.grad(lambda q, t: jax.jvp(of_q, (q,), (t,))[1] @ a))
    sloped = interpreted(jax.grad(lambda q: of_q(q) @ a))
    ahead, behind = (sloped(q + h * step[1]) for h in (1e-5, -1e-5))
    expected = (ahead - behind) / 2e-5
    np.testing.assert_allclose(second(q, step[1]), expected, rtol=0, atol=1e-7 * abs(expected).max())


@pytest.mark.parametrize("count", [asked_for, done], ids=["on arrays", "on numbers"])
@pytest.mark.parametrize("kinds", [["free"], ["ball", "revolute", "ball"], ["free", "free"]])
def test_known_ones_of_length_one_leave_no_operation(kinds, count):
    """No root and no quotient, in any function of them; of another length where there is one of a kind."""
    mech = js.testing.random_mechanism(3, len(kinds), kinds, dtype=np.float64)
    q = np.asarray(js.random_configuration(mech, jax.random.key(0), (), np.float64))
    v = np.ones(mech.nv)

    def counted(q):
        functions = (js.body_velocities, js.bias_forces, js.configuration_rates)
        return count(lambda v: [f(mech, q, v) for f in functions], v)

    known = [counted(q)] + ([counted(scaled(mech, q, 3.0))] if len(kinds) == 1 else [])
    for found in known:
        assert found["sqrt"] == found["divide"] == 0 < found["add"]
    assert count(lambda q: js.body_velocities(mech, q, v), q)["sqrt"] > 0


# -- where else they come in ------------------------------------------------------------------------------------------


def test_joints_are_locked_at_quaternions_of_any_length():
    mech, q = mechanism(), state()[0]
    name, own = mech.joint_names[1], mech.joint_position_indices(mech.joint_names[1])
    at = [js.lock_joints(mech, {name: factor * q[own]}).inertias for factor in (1.0, 2.0, 3.0)]
    for found, allowed in zip(at[1:], (0.0, 64 * U), strict=True):
        jax.tree.map(functools.partial(np.testing.assert_allclose, rtol=0, atol=allowed), found, at[0])
    with pytest.raises(ValueError, match="positions.*expected a length above 0, got"):
        js.lock_joints(mech, {name: 0 * q[own]})


def test_states_and_poses_of_others_are_read_at_any_length():
    mech, (q, _, v, a) = mechanism(), state()
    calls = {
        "qvel": lambda q: mujoco.to_qvel(mech, q, v),
        "from qvel": lambda q: mujoco.from_qvel(mech, q, v),
        "qacc": lambda q: mujoco.to_qacc(mech, q, v, a),
        "from qacc": lambda q: mujoco.from_qacc(mech, q, v, a),
        "qfrc": lambda q: mujoco.to_qfrc(mech, q, a),
        "from qfrc": lambda q: mujoco.from_qfrc(mech, q, a),
        "velocities of qpos": lambda q: js.body_velocities(mech, mujoco.from_qpos(mech, mujoco.to_qpos(mech, q)), v).w,
        "Drake's positions": lambda q: orders.pose_from_wxyz_xyz(q[:7]).rotation.entries,
    }
    for name, call in calls.items():
        expected, halved, long = interpreted(jax.vmap(call))(np.stack([scaled(mech, q, x) for x in (1, -0.5, 1e3)]))
        np.testing.assert_array_equal(halved, expected, err_msg=name)
        np.testing.assert_allclose(long, expected, rtol=0, atol=64 * U * abs(expected).max())


def test_a_turn_beyond_all_digits_is_nan():
    """And one of half of 1 / u rad is a quaternion of unit length; numbers that do not turn are numbers."""
    mech, (q, _, v, _) = mechanism(), state()
    v = np.stack([v, v])
    v[:, -1] = 0.5 / U, 4 / U
    within, beyond = np.asarray(js.integrate(mech, q, v))
    ball, rest = within[-4:], slice(None, -4)
    assert abs(ball @ ball - 1) < 32 * U and np.isnan(beyond[-4:]).all()
    np.testing.assert_array_equal(beyond[rest], within[rest])
