"""The momentum observer: against simulated external forces, its lag and its noise against theory, and its rounding."""

import functools

import chex
import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics import momentum_observer
from jaxspatial.dynamics.momentum_observer import momentum_and_beta
from tests.dynamics.test_bounds import chain, states
from tests.helpers import exact_dynamics as exact
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

KINDS = ["free", "ball", "revolute"]


@pytest.fixture(autouse=True)
def _x64():
    """In the precision that compiles soonest."""
    with jax.enable_x64(True), js.default_precision("fast"):
        yield


@functools.cache
def floating():
    """A free body that carries a ball joint that carries a hinge, with rotors."""
    return js.testing.random_mechanism(2, 3, KINDS, is_chain=True, dtype=np.float64)


def state(mech, seed=0, batch=()):
    q = js.random_configuration(mech, jax.random.key(seed), batch, np.float64)
    return q, jnp.asarray(np.random.default_rng(seed).standard_normal((*batch, mech.nv)))


# -- momentum and beta ------------------------------------------------------------------------------------------------


def follower():
    """A hinge, and one that turns against it, both with rotors."""
    bodies = [js.Body(name, js.SpatialInertia(2.0, np.array([0.1, 0.2, 0.3]), np.eye(3))) for name in "ab"]
    X = js.RigidTransform(js.Rotation.identity(dtype=np.float64), np.array([0.0, 0.5, 0.0]))
    joints = [
        js.Joint("one", "revolute", "world", "a", axis=(0, 1, 0), armature=0.1),
        js.Joint("two", "revolute", "a", "b", axis=(1, 0, 0), placement=X, mimic=("one", -1.5, 0.3), armature=0.2),
    ]
    return js.Mechanism.build(bodies, joints, dtype=np.float64)


MECHANISMS = {
    "every kind": lambda: js.testing.random_mechanism(1, 10, dtype=np.float64),
    "a few": lambda: js.testing.random_mechanism(1, 3, ["free", "helical", "planar"], dtype=np.float64),
    "mimic": follower,
    "another tree": lambda: js.testing.random_mechanism(2, 12, dtype=np.float64),
}


@pytest.mark.parametrize("name", [slow("every kind"), "a few", "mimic", slow("another tree")])
def test_beta_is_what_the_bias_forces_and_the_rate_of_the_mass_matrix_leave(name):
    """p = M v, beta = bias_forces - dM/dt v."""
    mech = MECHANISMS[name]()
    q, v = state(mech)

    def both(q, v):
        of_momentum = functools.partial(js.inverse_dynamics, mech.replace(gravity=np.zeros(3)), v=0 * v, vdot=v)
        Mv, rate = jax.jvp(lambda q: of_momentum(q=q), (q,), (js.configuration_rates(mech, q, v),))
        return *momentum_and_beta(None, mech, q, v), Mv, js.bias_forces(mech, q, v) - rate

    p, beta, Mv, expected = interpreted(both)(q, v)
    np.testing.assert_allclose(p, Mv, rtol=0, atol=1e-13 * abs(Mv).max())
    np.testing.assert_allclose(beta, expected, rtol=0, atol=1e-13 * abs(expected).max())


@pytest.mark.parametrize("precision", ["fast", "compensated"])
@pytest.mark.parametrize("name", ["any", "held in motion", "in balance", "about its centre of mass"])
def test_bounds_of_momentum_and_beta(name, precision):
    """In float32, of numbers of very different size."""
    q, v, _ = states()[name]
    with mp.workdps(exact.DIGITS):
        at = exact.Chain(chain(), q, v, 0 * v)
        expected = at.momentum_and_beta()
        rates = [b.value - x.value for b, x in zip(at.bias_forces(), at.momentum_rate(), strict=True)]
        of_masses = np.reshape(exact.values(at.mass_matrix()), (len(v),) * 2) @ np.array([mp.mpf(x) for x in v])
        for ours, other in zip(expected, (of_masses, rates), strict=True):
            size = max(x.size for x in ours)
            assert max(abs(x.value - y) for x, y in zip(ours, other, strict=True)) <= mp.mpf(10) ** -18 * size
    run = jax.jit if precision == "fast" else interpreted
    found = run(functools.partial(momentum_and_beta, precision, chain()))(np.float32(q), np.float32(v))
    for ours, numbers in zip(found, expected, strict=True):
        error = max(abs(mp.mpf(float(x)) - y.value) for x, y in zip(ours, numbers, strict=True))
        size, largest = max(y.size for y in numbers), max(abs(y.value) for y in numbers)
        assert error <= momentum_observer.MOMENTUM.allowed(precision, 2.0**-24, len(v) * size, largest)


# -- simulated external forces ----------------------------------------------------------------------------------------

GAIN, STEPS = 50.0, 24
DT = np.array([4e-3, 2e-3])


@functools.cache
def observed():
    """(residuals, the lag of the external forces, these), (steps, 2, nv) each, of a floating mechanism under constant
    forces of its joints and a constant wrench, sampled in times of which one is half the other."""
    mech, rng = floating(), np.random.default_rng(3)
    tau, F = rng.standard_normal((2, mech.nv)), js.SpatialForce.from_array(10 * rng.standard_normal((2, 6)))
    tau[1], wrench = tau[0], jax.tree.map(lambda x: jnp.asarray(x).at[1].set(x[0]), F)
    b = -np.expm1(-GAIN * DT)[:, None]

    def external(q):
        """J^T F."""
        return -js.bias_forces(mech.replace(gravity=np.zeros(3)), q, jnp.zeros_like(tau), {"body2": wrench})

    def step(carry, _):
        q, v, lag, observer = carry
        before, passive = external(q), js.passive_forces(mech, q, v)
        q, v = js.rk4_step(mech, q, v, tau, DT, {"body2": wrench})
        lag = lag + b * ((external(q) + before) / 2 - lag)
        # The dampers of the joints are known, by the mean of their forces at both samples.
        known = tau + (js.passive_forces(mech, q, v) + passive) / 2
        observer = observer.update(mech, q, v, known, DT, GAIN)
        return (q, v, lag, observer), (observer.residual, lag, before)

    def simulated(q, v):
        start = q, v, jnp.zeros_like(v), js.MomentumObserver.start(mech, q, v)
        return jax.lax.scan(step, start, length=STEPS)[1]

    return [np.asarray(x) for x in interpreted(simulated)(*(jnp.stack([x, x]) for x in state(mech)))]


def test_the_residual_is_the_lag_of_the_external_forces():
    """To second order: half the time between samples leaves a quarter of the error."""
    residual, lag, external = observed()
    errors = abs(residual - lag).max(-1)
    coarse, fine = errors[: STEPS // 2, 0].max(), errors[:, 1].max()
    assert 3.4 < coarse / fine < 4.6
    assert fine < 2e-4 * abs(external).max()


def test_the_lag_has_the_time_constant_of_the_gain():
    """After the time t = 6 / gain of an external force that varies slowly, all but exp(-6) of it is seen."""
    arm = js.testing.random_mechanism(0, 1, ["prismatic"], dtype=np.float64)
    mech = arm.replace(gravity=np.zeros(3))
    force, dt = 3.0, 0.01
    M = js.mass_matrix(mech, np.zeros(1))[0, 0]
    observer = js.MomentumObserver.start(mech, np.zeros(1), np.zeros(1))
    for k in range(1, 31):
        observer = observer.update(mech, np.zeros(1), (force * k * dt / M)[None], np.zeros(1), dt, GAIN)
        np.testing.assert_allclose(observer.residual, force * (1 - np.exp(-GAIN * k * dt)), rtol=1e-12)


def test_every_gain_is_stable():
    """A gain beyond all limits takes the difference of momenta as it is."""
    mech = floating()
    (q, v), (q1, v1), tau = state(mech), state(mech, 1), np.ones(mech.nv)

    @interpreted
    def updated(q, v, q1, v1):
        """The observer before, and after a sample with the gain and with none."""
        start = js.MomentumObserver.start(mech, q, v)
        before = js.MomentumObserver(start.residual + 1e3, start.momentum, start.beta)
        return before, *(before.update(mech, q1, v1, tau, 0.1, gain) for gain in (1e9, 0.0))

    before, after, same = updated(q, v, q1, v1)
    expected = (after.momentum - before.momentum) / 0.1 - tau + (after.beta + before.beta) / 2
    np.testing.assert_allclose(after.residual, expected, atol=1e-11)
    np.testing.assert_array_equal(same.residual, before.residual)


# -- noise ------------------------------------------------------------------------------------------------------------


@functools.cache
def at_rest():
    """An arm, where it is, its gravity forces and mass matrix there, and residuals (samples, arms, 2), of measured
    velocities and forces, a gain and a time: compiled once for all that is measured."""
    mech, q = js.testing.random_mechanism(4, 2, ["revolute"], is_chain=True, dtype=np.float64), np.array([0.3, -0.8])
    gravity, M = interpreted(lambda q: (js.gravity_forces(mech, q), js.mass_matrix(mech, q)))(q)

    @jax.jit
    def residuals(v, tau, gain, dt):
        def step(observer, sample):
            observer = observer.update(mech, q, *sample, dt, gain)
            return observer, observer.residual

        return jax.lax.scan(step, js.MomentumObserver.start(mech, q, v[0]), (v[1:], tau[1:]))[1]

    return gravity, M, residuals


@pytest.mark.parametrize("gain", [5.0, 400.0])
@pytest.mark.parametrize("noisy", ["velocities", "forces"])
def test_noise_is_that_of_theory(noisy, gain):
    """An arm at rest, 400 of them over 250 samples: standard deviations within 3 %."""
    gravity, M, residuals = at_rest()
    (dt, s), rng = (4e-3, 1e-4), np.random.default_rng(5)
    v, forces = (s * x * rng.standard_normal((250, 400, 2)) for x in (noisy == "velocities", noisy == "forces"))
    found, b = residuals(v, gravity + forces, gain, dt), -np.expm1(-gain * dt)
    if noisy == "velocities":
        expected = s * np.linalg.norm(M, axis=1) * b / dt * np.sqrt(2 / (2 - b))
    else:
        expected = s * np.sqrt(b / (2 - b)) * np.ones(2)
    settled = np.asarray(found)[-1 if gain < 100 else slice(100, None)].reshape(-1, 2)
    few = 1 / np.sqrt(2 * len(settled) / (1 if gain < 100 else 2))
    assert (abs(settled.std(0) / expected - 1) < 4 * few).all() and few < 0.04


# -- as other functions of JAX ----------------------------------------------------------------------------------------


def samples(n=3, batch=()):
    mech, rng = floating(), np.random.default_rng(6)
    q = js.random_configuration(mech, jax.random.key(1), (n, *batch), np.float64)
    v, tau = (jnp.asarray(rng.standard_normal((n, *batch, mech.nv))) for _ in range(2))
    return q, v, tau


def run(mech, q, v, tau, gain=GAIN, dt=1e-2):
    """Residuals of a scan over samples."""

    def step(observer, sample):
        observer = observer.update(mech, *sample, dt, gain)
        return observer, observer.residual

    return jax.lax.scan(step, js.MomentumObserver.start(mech, q[0], v[0]), (q[1:], v[1:], tau[1:]))[1]


def test_a_scan_is_a_loop_and_a_batch_its_items():
    mech, (q, v, tau) = floating(), samples(4, (2,))
    with js.default_precision("reproducible"):
        found = interpreted(functools.partial(run, mech))(q, v, tau)
        each = interpreted(jax.vmap(functools.partial(run, mech), 1, 1))(q, v, tau)
        observer = interpreted(lambda q, v: js.MomentumObserver.start(mech, q, v))(q[0], v[0])
        update = interpreted(lambda observer, *sample: observer.update(mech, *sample, 1e-2, GAIN))
        for k in range(1, 4):
            observer = update(observer, q[k], v[k], tau[k])
            np.testing.assert_array_equal(observer.residual, found[k - 1])
    np.testing.assert_array_equal(found, each)
    assert found.shape == (3, 2, mech.nv)


def test_what_has_no_batch_goes_with_every_item():
    """Gains of each velocity, times of each item, one state for all."""
    mech, (q, v, tau) = floating(), samples(2)
    gain, dt = np.linspace(1.0, 50.0, mech.nv), np.array([1e-3, 1e-2])
    call = lambda gain, dt: interpreted(  # noqa: E731
        lambda *x: js.MomentumObserver.start(mech, q[0], v[0]).update(mech, *x, dt, gain)
    )(q[1], v[1], tau[1])
    whole = call(gain, dt)
    chex.assert_shape(jax.tree.leaves(whole), (2, mech.nv))
    for i, j in ((0, 0), (1, mech.nv - 1)):
        np.testing.assert_array_equal(whole.residual[i, j], call(gain[j], dt[i]).residual[j])


@pytest.mark.slow
def test_derivatives_by_everything_are_finite():
    """By measured numbers, gain, time and the inertias."""
    mech, (q, v, tau) = floating().as_data(), samples(3)

    def total(inertias, q, v, tau, gain, dt):
        return (run(mech.replace(inertias=inertias), q, v, tau, gain, dt) ** 2).sum()

    arguments = mech.inertias, q, v, tau, jnp.asarray(GAIN), jnp.asarray(1e-2)
    slopes = interpreted(jax.grad(total, tuple(range(6))))(*arguments)
    assert all(np.isfinite(x).all() and x.any() for x in jax.tree.leaves(slopes))


@pytest.mark.parametrize("x64", [False, True])
def test_float32_stays_float32(x64):
    mech, (q, v, tau) = floating(), samples(3)
    expected = interpreted(functools.partial(run, mech))(q, v, tau)
    narrow = [np.float32(x) for x in (q, v, tau)]
    with jax.enable_x64(x64):
        found = interpreted(functools.partial(run, mech))(*narrow)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * abs(expected).max())


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_bound_of_an_update(precision):
    """In float32, of the numbers that it starts from: in 60 digits."""
    mech, (q, v, tau), dt, gain = floating(), samples(2), np.float32(1e-3), np.float32(77.0)
    q, v, tau = np.float32(q), np.float32(v), np.float32(tau[1])

    @interpreted
    def both(q, v, tau):
        start = js.MomentumObserver.start(mech, q[0], v[0])
        start = js.MomentumObserver(jnp.full(mech.nv, 1e3, np.float32), start.momentum, start.beta)
        return start, start.update(mech, q[1], v[1], tau, dt, gain, precision=precision)

    start, end = both(q, v, tau)
    with mp.workdps(60):
        b = -mp.expm1(-mp.mpf(float(dt)) * mp.mpf(float(gain)))
        for i in range(mech.nv):
            r0, p0, p1, b0, b1, t, h = (
                mp.mpf(float(x))
                for x in (
                    *(y[i] for y in (start.residual, start.momentum, end.momentum, start.beta, end.beta, tau)),
                    dt,
                )
            )
            exactly = r0 + b * ((p1 - p0) / h - t + (b0 + b1) / 2 - r0)
            s = abs(r0) + b * (abs(p0) + abs(p1)) / h + b * (abs(t) + abs(b0) + abs(b1))
            assert abs(mp.mpf(float(end.residual[i])) - exactly) <= momentum_observer.UPDATE.allowed(
                precision, 2.0**-24, s
            )


def test_errors_name_the_argument():
    mech, (q, v, tau) = floating(), samples(2)
    observer = js.MomentumObserver(*np.zeros((3, mech.nv)))
    for arguments, error, message in (
        ((1, q[0], v[0], tau[0], 0.1, 1.0), TypeError, "update: expected a Mechanism first, got int"),
        ((mech, q[0], v[0, 1:], tau[0], 0.1, 1.0), ValueError, "update: v: expected shape"),
        ((mech, q[0], v[0], tau[0], 0.1, np.ones(2)), ValueError, r"update: gain: expected a number or shape .*\(2,\)"),
        ((mech, q[0], v[0], tau[0], 0.1, np.float32(2)), TypeError, "gain: float32"),
    ):
        with pytest.raises(error, match=message):
            observer.update(*arguments)
    with pytest.raises(ValueError, match=r"MomentumObserver.start: q: expected shape"):
        js.MomentumObserver.start(mech, q[0, 1:], v[0])
