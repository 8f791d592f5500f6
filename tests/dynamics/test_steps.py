"""Single steps of a flywheel, whose equations are solved by hand: I dv/dt = tau - c v; and many steps of others."""

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import marks
from tests.helpers.interpreted import interpreted

INERTIA, DAMPING, TORQUE, RATE, DT = 0.5, 2.0, 3.0, -4.0, 1e-2
DECAY = DAMPING / INERTIA * DT


@pytest.fixture(autouse=True)
def _x64():
    """In the precision that compiles soonest."""
    with jax.enable_x64(True), js.default_precision("fast"):
        yield


def flywheel(damping=DAMPING):
    body = js.Body("a", js.SpatialInertia(1.0, np.zeros(3), INERTIA * np.eye(3)))
    joint = js.Joint("j", "revolute", "world", "a", axis=(0.0, 0.0, 1.0), damping=damping)
    return js.Mechanism.build([body], [joint], dtype=np.float64)


def step_of(step, damping=DAMPING, torque=TORQUE, rate=RATE):
    """(angle, rate) from an angle of 1."""
    # A mass matrix of which every number is known while tracing is refused, see the test of it.
    mech = flywheel(damping).as_data()
    q, v = interpreted(step)(mech, np.ones(1), np.full(1, rate), np.full(1, torque), DT)
    return float(q[0]), float(v[0])


STEPS = pytest.mark.parametrize(
    "step", [js.semi_implicit_step, js.symplectic_step, js.rk4_step], ids=["semi-implicit", "symplectic", "rk4"]
)


def test_runge_kutta_damps():
    """v = tau / c + (v0 - tau / c) exp(-c t / I), to within (c t / I)^5 / 120."""
    q, v = step_of(js.rk4_step)
    limit, fall = TORQUE / DAMPING, np.exp(-DECAY)
    np.testing.assert_allclose(v, limit + (RATE - limit) * fall, rtol=DECAY**5 / 60)
    np.testing.assert_allclose(q, 1 + limit * DT + (RATE - limit) * (1 - fall) * INERTIA / DAMPING, rtol=DECAY**5 / 60)


@pytest.mark.parametrize("step", [js.semi_implicit_step, js.symplectic_step], ids=["semi-implicit", "symplectic"])
def test_damping_acts_at_the_new_rate(step):
    """I (v - v0) = dt (tau - c v), and the new rate moves the angle."""
    q, v = step_of(step)
    np.testing.assert_allclose(v, (RATE + DT * TORQUE / INERTIA) / (1 + DECAY), rtol=1e-14)
    np.testing.assert_allclose(q, 1 + DT * v, rtol=1e-14)


@STEPS
def test_damping_takes_rate_of_either_sign(step):
    for rate in (4.0, -4.0):
        assert 0 < step_of(step, torque=0.0, rate=rate)[1] / rate < 1


@STEPS
def test_a_torque_alone_adds_to_the_rate(step):
    np.testing.assert_allclose(step_of(step, damping=0.0)[1], RATE + DT * TORQUE / INERTIA, rtol=1e-14)


def test_a_mass_matrix_that_is_known():
    np.testing.assert_array_equal(js.mass_matrix(flywheel(), np.ones(1)), [[INERTIA]])


# -- many steps -------------------------------------------------------------------------------------------------------


def energy(mech, q, v):
    return js.kinetic_energy(mech, q, v) + js.potential_energy(mech, q)


def test_momentum_is_conserved_in_free_fall():
    """A floating mechanism without gravity, over 40 steps of Runge and Kutta."""
    mech = js.testing.random_mechanism(3, 3, ["free", "ball", "prismatic"], is_chain=True, dtype=np.float64)
    mech = mech.replace(gravity=np.zeros(3), damping=0 * mech.damping, armature=0 * mech.armature)
    q = js.random_configuration(mech, jax.random.key(0), (), np.float64)
    v = jnp.asarray(np.random.default_rng(0).standard_normal(mech.nv))

    def step(x, _):
        return js.rk4_step(mech, *x, jnp.zeros(mech.nv), 1e-3), (js.centroidal_momentum(mech, *x), energy(mech, *x))

    _, (L, E) = interpreted(lambda q, v: jax.lax.scan(step, (q, v), length=40))(q, v)
    L = np.asarray(L.to_array())
    assert abs(L - L[0]).max() <= 1e-10 * abs(L[0]).max()
    assert abs(E - E[0]).max() <= 1e-9 * abs(E[0])


@functools.cache
def double_pendulum():
    rod = js.shift(js.SpatialInertia.thin_rod(1.0, (0.0, 0.0, 1.0), mass=1.0), np.array([0.0, 0.0, 0.5]))
    below = js.RigidTransform(js.Rotation.identity(dtype=np.float64), np.array([0.0, 0.0, -1.0]))
    joints = [
        js.Joint("upper", "revolute", "world", "a", axis=(0, 1, 0)),
        js.Joint("lower", "revolute", "a", "b", axis=(0, 1, 0), placement=below),
    ]
    return js.Mechanism.build([js.Body("a", rod), js.Body("b", rod)], joints, dtype=np.float64)


def simulated(step, mech, x, dt, n, run=jax.jit):
    def body(x, _):
        x = step(mech, *x, jnp.zeros(mech.nv), dt)
        return x, energy(mech, *x)

    return run(lambda x: jax.lax.scan(body, x, length=n))(x)


@pytest.mark.parametrize("many", [20_000, marks.slow(100_000)])
def test_energy_of_a_double_pendulum_over_many_steps(many):
    """Symplectic ones: bounded, in proportion to dt, without a drift. The motion is chaotic: of 16 starts within 1e-9
    the largest deviations over a hundred thousand are 0.0288 to 0.0314 of the swing."""
    mech, x = double_pendulum(), (jnp.array([2.0, 1.0]), jnp.zeros(2))
    start = energy(mech, *x)
    swing = 2 * (0.5 + 1.5) * 9.81  # of the potential, from lowest to highest
    largest = []

    @functools.partial(jax.jit, static_argnums=1)
    def run(dt, n):
        return simulated(js.symplectic_step, mech, x, dt, n, lambda f: f)[1] - start

    for dt, n in ((1e-3, many), (5e-4, 20_000)):
        E = np.asarray(run(dt, n))
        largest.append(abs(E).max() / swing)
        assert abs(E[-n // 4 :].mean() - E[: n // 4].mean()) <= 0.1 * abs(E).max()
    assert largest[0] <= 0.032 and largest[1] <= 0.75 * largest[0]


@pytest.mark.parametrize(
    ("step", "order"),
    [(js.semi_implicit_step, 1), pytest.param(js.symplectic_step, 1, marks=pytest.mark.slow), (js.rk4_step, 4)],
    ids=["semi-implicit", "symplectic", "Runge-Kutta"],
)
def test_orders_of_the_steps(step, order):
    """Half the step, half the error, and a sixteenth."""
    mech, rng = js.testing.random_mechanism(4, 2, ["planar", "ball"], dtype=np.float64), np.random.default_rng(0)
    x = js.random_configuration(mech, jax.random.key(1), (), np.float64), jnp.asarray(rng.standard_normal(mech.nv))

    @interpreted
    def end(x, dt, n):
        return jax.lax.fori_loop(0, n, lambda _, x: step(mech, *x, jnp.zeros(mech.nv), dt), x)

    ends = [end(x, 0.08 / n, n) for n in (8, 16, 32)]
    apart = [(js.difference(mech, a[0], b[0]), b[1] - a[1]) for a, b in itertools.pairwise(ends)]
    errors = [np.linalg.norm(np.concatenate(x)) for x in apart]
    assert abs(np.log2(errors[0] / errors[1]) - order) <= 0.3, errors


@pytest.mark.parametrize("step", [js.semi_implicit_step, js.symplectic_step], ids=["semi-implicit", "symplectic"])
def test_stiff_damping_is_stable(step):
    """Implicit: the rate falls to what the torque keeps up, and no further; explicit it would blow up."""
    mech = double_pendulum().replace(damping=np.array([1e6, 1e6]))
    (q, v), _ = simulated(step, mech, (jnp.array([2.0, 1.0]), jnp.array([1.0, -1.0])), 1e-3, 50, interpreted)
    gravity = js.gravity_forces(mech, q)
    np.testing.assert_allclose(v, -np.asarray(gravity) / 1e6, rtol=1e-5)


# -- what floats ------------------------------------------------------------------------------------------------------


def floating(kind, gravity=(0.0, 0.0, 0.0)):
    body = js.Body("body", js.SpatialInertia.solid_box(np.array([0.1, 0.2, 0.3]), mass=2.0))
    return js.Mechanism.build([body], [js.Joint("joint", kind, "world", "body")], gravity=gravity, dtype=np.float64)


PLACES = {"free": (slice(4, 7), slice(3, 6), slice(2, 3)), "planar": (slice(0, 2), slice(0, 2), slice(2, 3))}
STEPS_OF_FLIGHT = 100


def flown(step, kind, gravity, spin, dt, n=STEPS_OF_FLIGHT):
    """(positions, linear rates) of spins about z and times, after so many steps from the origin at 3 and 4 m/s."""
    mech, (place, linear, turning) = floating(kind, gravity), PLACES[kind]
    v = jnp.zeros(mech.nv).at[linear].set(jnp.array([3.0, 4.0, 0.0])[: linear.stop - linear.start])

    def end(spin, dt):
        start = jnp.asarray(mech.neutral()), v.at[turning].set(spin)
        return jax.lax.fori_loop(0, n, lambda _, x: step(mech, *x, jnp.zeros(mech.nv), dt), start)

    q, v = interpreted(jax.vmap(end))(spin, dt)
    return q[:, place], v[:, linear]


# Any turn within a step, several turns too.
SPINS, TIMES = (x.ravel() for x in np.meshgrid([0.0, 0.5, -10.0, 3e3], [1e-5, 1e-3, 5e-3, 0.25]))


@pytest.mark.parametrize("kind", PLACES)
def test_what_spins_flies_straight_at_a_constant_speed(kind):
    """To rounding: of w x v, which acts for a time and is taken off, at each step."""
    p, v = flown(js.semi_implicit_step, kind, (0.0, 0.0, 0.0), SPINS, TIMES)
    allowed = STEPS_OF_FLIGHT * 8 * 2.0**-53 * (1 + abs(SPINS) * TIMES)
    assert (abs(np.linalg.norm(v, axis=1) - 5) <= 5 * allowed).all()
    straight = STEPS_OF_FLIGHT * TIMES[:, None] * np.array([3.0, 4.0, 0.0])[: p.shape[1]]
    assert (np.linalg.norm(p - straight, axis=1) <= 5 * STEPS_OF_FLIGHT * TIMES * allowed).all()


@pytest.mark.parametrize("kind", PLACES)
def test_what_spins_falls_as_what_does_not(kind):
    """Of a point, v' = v + dt g and p' = p + dt v'."""
    g, n = np.array([1.0, -9.0, 0.0]), STEPS_OF_FLIGHT
    p, _ = flown(js.semi_implicit_step, kind, g, SPINS, TIMES)
    h = TIMES[:, None]
    fallen = (n * h * np.array([3.0, 4.0, 0.0]) + n * (n + 1) / 2 * h**2 * g)[:, : p.shape[1]]
    size = n * TIMES * (5 + n * TIMES * np.linalg.norm(g))
    assert (np.linalg.norm(p - fallen, axis=1) <= 8 * n * 2.0**-53 * (1 + abs(SPINS) * TIMES) * size).all()


@pytest.mark.parametrize("kind", marks.slow_but(("planar",), PLACES))
def test_what_spins_flies_straight_in_other_steps_to_their_order(kind):
    """Runge-Kutta to (w dt)^4; the variational step at a constant speed, in another direction by w dt / 2: its rates
    are those of the screw that led there."""
    spin, dt, n = np.full(1, 10.0), np.full(1, 5e-3), 5
    straight, turn = n * dt[0] * np.array([3.0, 4.0]), spin[0] * dt[0]
    far = np.linalg.norm(straight)
    p, v = flown(js.rk4_step, kind, (0.0, 0.0, 0.0), spin, dt, n)
    assert abs(np.linalg.norm(v) - 5) <= 5 * n * turn**6 / 100
    assert np.linalg.norm(p[0, :2] - straight) <= turn**4 * far
    p, v = flown(js.symplectic_step, kind, (0.0, 0.0, 0.0), spin, dt, n)
    assert abs(np.linalg.norm(v) - 5) <= 5 * n * turn**5
    assert abs(np.linalg.norm(p) / far - 1) <= turn**2
    assert abs(np.linalg.norm(p[0, :2] / np.linalg.norm(p) - straight / far) - turn / 2) <= turn**2


def test_damping_of_what_spins_is_implicit():
    """m (u' - u) = -dt c u' in the parent's axes, in which u stands still: |u| falls by 1 + dt c / m, however it spins,
    and however stiff."""
    for kind, (_, linear, turning) in PLACES.items():
        for c in (0.7, 1e6):
            mech = floating(kind)
            mech = mech.replace(damping=np.full(mech.nv, c))
            v = np.zeros(mech.nv)
            v[linear][0], v[turning] = 5.0, 20.0
            _, after = interpreted(functools.partial(js.semi_implicit_step, mech))(mech.neutral(), v, 0 * v, 0.01)
            expected = 5.0 / (1 + 0.01 * c / 2.0)
            np.testing.assert_allclose(np.linalg.norm(after[linear]), expected, rtol=1e-12)


@pytest.mark.parametrize("kind", PLACES)
def test_derivatives_of_what_floats(kind):
    """By q, v, forces and time: differences, and the same in reverse."""
    mech, rng = floating(kind, (1.0, -2.0, 3.0)), np.random.default_rng(0)
    q = np.asarray(js.random_configuration(mech, jax.random.key(0), (), np.float64))
    x = q, *rng.standard_normal((2, mech.nv)), np.float64(0.3)
    t = [rng.standard_normal(np.shape(y)) for y in x]

    def step(*x):
        return jnp.concatenate(js.semi_implicit_step(mech, *x))

    along = interpreted(lambda *t: jax.jvp(step, x, t)[1])(*t)
    ahead, behind = (interpreted(step)(*(y + h * s for y, s in zip(x, t, strict=True))) for h in (1e-6, -1e-6))
    np.testing.assert_allclose(along, (ahead - behind) / 2e-6, rtol=1e-7, atol=1e-7)
    c = rng.standard_normal(along.shape)
    pulled = interpreted(lambda c: jax.vjp(step, *x)[1](c))(c)
    np.testing.assert_allclose(sum(np.vdot(a, b) for a, b in zip(pulled, t, strict=True)), c @ along, rtol=1e-12)


def test_linear_momentum_of_a_satellite():
    """With wheels that its motors turn, and the centre of mass at the origin of its base: to rounding."""
    wheel = js.SpatialInertia.solid_cylinder(np.float64(0.1), np.float64(0.05), mass=np.float64(1.0))
    base = js.SpatialInertia.solid_box(np.array([0.5, 0.6, 0.7]), mass=np.float64(10.0))
    at = lambda x: js.RigidTransform(js.Rotation.exp(np.array([x, 0.3, 0.0])), np.array([x, 2 * x, 0.0]))  # noqa: E731
    bodies = [js.Body("base", base), js.Body("a", wheel), js.Body("b", wheel)]
    joints = [js.Joint("root", "free", "world", "base")]
    joints += [js.Joint(k, "revolute", "base", k, at(x), axis=(0, 0, 1)) for k, x in (("a", 0.3), ("b", -0.3))]
    mech = js.Mechanism.build(bodies, joints, gravity=(0, 0, 0), dtype=np.float64)
    v = np.array([3.0, -4.0, 5.0, 1.0, 2.0, -3.0, 50.0, -20.0])
    tau = np.array([0.0] * 6 + [0.5, -1.0])

    def step(x, _):
        x = js.semi_implicit_step(mech, *x, tau, 0.02)
        return x, js.centroidal_momentum(mech, *x).l

    start = jnp.asarray(js.random_configuration(mech, jax.random.key(0), (), np.float64)), jnp.asarray(v)
    momenta = interpreted(lambda x: jax.lax.scan(step, x, length=20)[1])(start)
    expected = np.asarray(js.centroidal_momentum(mech, *start).l)
    assert abs(momenta - expected).max() <= 20 * 32 * 2.0**-53 * abs(expected).max()
