"""Springs, damping, friction and limits: against exact numbers and their definition; and in steps."""

import functools
import itertools

import chex
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics import steps
from jaxspatial.dynamics.passive import PASSIVE, PASSIVE_TURNS
from jaxspatial.mechanism.joints import KINDS
from tests.helpers.counting import done, flops
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but

KINDS = [name for name in KINDS if name != "fixed"]
SOFT = js.Compliance(friction_speed=0.25, limit_stiffness=300.0, limit_damping=7.0)
SEQUENTIAL = ["revolute", "prismatic", "helical", "cylindrical", "universal"]


def sprung(kinds, dtype=np.float64, **numbers):
    """A tree of joints with a spring, damping, friction and limits each, but for what is given."""
    rng = np.random.default_rng(7)
    mech = js.testing.random_mechanism(3, len(kinds), kinds)
    sizes = {"stiffness": mech.nv, "damping": mech.nv, "friction_loss": mech.nv}
    found = {name: rng.uniform(1, 9, n) for name, n in sizes.items()}
    found |= {"lower": rng.uniform(-0.9, -0.1, mech.nq), "upper": rng.uniform(0.1, 0.9, mech.nq)}
    with jax.enable_x64(True):
        found["spring_references"] = np.asarray(js.random_configuration(mech, jax.random.key(1), (), np.float64))
        return mech.replace(**found | {k: np.broadcast_to(x, found[k].shape) for k, x in numbers.items()}).astype(dtype)


NO_RESISTANCE = {"damping": 0.0, "friction_loss": 0.0}
NO_LIMITS = {"lower": -np.inf, "upper": np.inf}


def state(mech, n, dtype=np.float64, size=1.0):
    with jax.enable_x64(True):
        q = js.random_configuration(
            mech.replace(lower=np.full_like(mech.lower, -np.inf)), jax.random.key(2), n, np.float64
        )
        v = size * np.random.default_rng(3).standard_normal((n, mech.nv))
        return np.asarray(q, dtype), np.asarray(v, dtype)


@pytest.fixture
def float64():
    with jax.enable_x64(True):
        yield


@pytest.fixture
def fast():
    """The precision that compiles soonest, for steps in time."""
    with jax.enable_x64(True), js.default_precision("fast"):
        yield


# -- against exact numbers --------------------------------------------------------------------------------------------


def exact(mech, compliance, q, v):
    """(forces, sizes) in 160 digits, of joints whose rates are those of their coordinates."""
    number = lambda x: mpmath.mpf(float(x))  # noqa: E731
    speed, stiff, damp = (number(np.asarray(x, q.dtype)) for x in compliance)
    found = []
    for k in range(len(q)):
        x, w = number(q[k]), number(v[k])
        spring = number(mech.stiffness[k]) * (x - number(mech.spring_references[k]))
        drag = number(mech.damping[k]) * w
        friction = number(mech.friction_loss[k]) * w / mpmath.sqrt(w**2 + speed**2)
        low = _push(number(mech.lower[k]) - x, -w, stiff, damp)
        high = _push(x - number(mech.upper[k]), w, stiff, damp)
        depth = max(number(mech.lower[k]) - x, x - number(mech.upper[k]), mpmath.mpf(0))
        sizes = abs(spring) + abs(drag) + abs(friction) + (stiff * depth + damp * abs(w) if depth else 0)
        found.append((-spring - drag - friction + low - high, sizes))
    return zip(*found, strict=True)


def _push(depth, speed, stiffness, damping):
    return max(stiffness * depth + damping * speed, mpmath.mpf(0)) if depth > 0 else mpmath.mpf(0)


@pytest.mark.parametrize("is_data", [False, True], ids=["known", "data"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_error(dtype, is_data):
    """Of the formulas in NumPy; programs, compiled in float32, give the same bits however they are called."""
    with jax.enable_x64(dtype == np.float64):
        mech = sprung(SEQUENTIAL, dtype)
        q, v = state(mech, 16, dtype)
        given = mech.as_data() if is_data else mech
        forces = functools.partial(js.passive_forces, compliance=SOFT)
        twice = functools.partial(forces, precision="compensated")
        in_numpy = lambda f: (  # noqa: E731
            interpreted(f)(given, q, v) if is_data else interpreted(functools.partial(f, mech))(q, v)
        )
        both, twice = [in_numpy(forces)], in_numpy(twice)
        if dtype == np.float32:
            calls = [jax.jit(forces)] if is_data else [jax.vmap(forces, in_axes=(None, 0, 0))]
            both += [np.asarray(f(given, q, v)) for f in calls]
    u = float(jnp.finfo(dtype).eps) / 2
    for found in both:
        assert found.dtype == dtype
        np.testing.assert_array_equal(found, both[0])
    for i in range(len(q)):
        for k, (r, size) in enumerate(zip(*exact(mech, SOFT, q[i], v[i]), strict=True)):
            for x, precision in ((both[0], "reproducible"), (twice, "compensated")):
                assert abs(mpmath.mpf(float(x[i, k])) - r) <= PASSIVE.allowed(precision, u, size, abs(r))


def exact_vector(mech, q):
    """(forces, the sum of their sizes) of the springs of a joint with an orientation or a heading."""
    x, r, k = ([mpmath.mpf(float(y)) for y in ys] for ys in (q, mech.spring_references, mech.stiffness))
    if len(x) == 3:
        full = 2 * mpmath.pi
        turn = x[2] - r[2] - full * mpmath.nint((x[2] - r[2]) / full)
        R = mpmath.matrix(
            [[mpmath.cos(x[2]), -mpmath.sin(x[2]), 0], [mpmath.sin(x[2]), mpmath.cos(x[2]), 0], [0, 0, 1]]
        )
        pull = mpmath.matrix([-k[0] * (x[0] - r[0]), -k[1] * (x[1] - r[1]), -k[2] * turn])
        return list(R.T * pull), sum(map(abs, pull))
    d = _rotation_vector(r[:4], x[:4])
    turning = mpmath.matrix([-a * b for a, b in zip(k, d, strict=False)])
    pull = mpmath.matrix([-a * (b - c) for a, b, c in zip(k[3:], x[4:], r[4:], strict=True)])
    forces = list(_left_jacobian_inverse(d) * turning) + (list(_matrix(x[:4]).T * pull) if len(pull) else [])
    return forces, sum(map(abs, turning)) + sum(map(abs, pull))


def _matrix(q):
    w, v = q[0], mpmath.matrix(q[1:])
    K = _cross(v)
    n = sum(y**2 for y in q)
    return mpmath.eye(3) + (2 * w * K + 2 * K * K) / n


def _cross(v):
    x, y, z = v
    return mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _rotation_vector(r, x):
    a, b = mpmath.matrix(r[1:]), mpmath.matrix(x[1:])
    real = r[0] * x[0] + (a.T * b)[0]
    vector = r[0] * b - x[0] * a - _cross(a) * b
    real, vector = (real, vector) if real >= 0 else (-real, -vector)
    length = mpmath.norm(vector)
    return list(vector * (2 * mpmath.atan2(length, real) / length))


def _left_jacobian_inverse(d):
    K, t = _cross(d), mpmath.norm(mpmath.matrix(d))
    return mpmath.eye(3) - K / 2 + K * K * (1 / t**2 - (1 + mpmath.cos(t)) / (2 * t * mpmath.sin(t)))


# In float32 of a free joint, whose turns are those of a ball.
TURNING = [(np.float32, "free"), (np.float64, "planar"), (np.float64, "free")]


@pytest.mark.parametrize(
    ("dtype", "kind"), slow_but(TURNING, itertools.product([np.float32, np.float64], ["ball", "free", "planar"]))
)
def test_error_of_springs_that_turn(dtype, kind):
    with jax.enable_x64(dtype == np.float64):
        mech = sprung([kind], dtype, **NO_RESISTANCE, **NO_LIMITS)
        q, v = state(mech, 32, dtype)
        run = jax.jit if kind == "free" and dtype == np.float32 else interpreted
        found = np.asarray(run(functools.partial(js.passive_forces, mech))(q, v))
    u = float(jnp.finfo(dtype).eps) / 2
    for i in range(len(q)):
        forces, size = exact_vector(mech, q[i])
        of_turns = PASSIVE_TURNS.allowed("reproducible", u, mech.stiffness[-1]) if kind == "planar" else 0
        error = max(abs(mpmath.mpf(float(x)) - r) for x, r in zip(found[i], forces, strict=True))
        assert error <= PASSIVE.allowed("reproducible", u, size) + of_turns, float(error / u / size)


@pytest.mark.parametrize("speed", [0.0, 1e-30, 1e-3, 1e25, -1e25])
def test_friction_at_extreme_speeds(speed):
    mech = sprung(["revolute"], np.float32, stiffness=0.0, damping=0.0, friction_loss=3.0, **NO_LIMITS)
    found = js.passive_forces(mech, np.zeros(1, np.float32), np.full(1, speed, np.float32))
    s, c = np.float64(np.float32(speed)), np.float64(np.float32(1e-3))
    np.testing.assert_allclose(found, -3 * s / np.hypot(s, c), rtol=4e-7)


# -- by their definition ----------------------------------------------------------------------------------------------


def spring_energy(mech, q, stiffness=None):
    """Written naively: of rotation vectors by matrices, else of the difference of coordinates."""
    t, total = mech.topology, 0.0
    stiffness = mech.stiffness if stiffness is None else stiffness
    for i in range(len(t)):
        x, r, k = q[t.q_slice(i)], mech.spring_references[t.q_slice(i)], stiffness[t.v_slice(i)]
        if t.kinds[i] in ("ball", "free"):
            R, R0 = (js.Rotation.from_quaternion(jnp.asarray(y[:4])) for y in (x, r))
            d = jnp.concatenate([(R0.inverse() @ R).log(), x[4:] - r[4:]])
        else:
            d = x - r
        if t.kinds[i] in ("continuous", "planar"):
            d = d.at[-1].set((d[-1] + np.pi) % (2 * np.pi) - np.pi)
        total = total + (k * d**2).sum() / 2
    return total


@pytest.mark.parametrize("kind", slow_but([kind for kind in KINDS if kind != "ball"], KINDS))
def test_springs_are_the_derivative_of_an_energy(kind, float64):
    mech = sprung([kind], **NO_RESISTANCE, **NO_LIMITS)
    q, v = state(mech, 4)

    def power(q, v):
        rates = js.configuration_rates(mech, q, v)
        return -jax.jvp(functools.partial(spring_energy, mech), (q,), (rates,))[1], js.passive_forces(mech, q, v) @ v

    expected, found = interpreted(jax.vmap(power))(q, v)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", slow_but([kind for kind in KINDS if kind != "ball"], KINDS))
def test_limits_push_back_and_take_power(kind, float64):
    """By the depth along each coordinate that is a number, and never pull."""
    mech = sprung([kind], stiffness=0.0, **NO_RESISTANCE)
    q, v = state(mech, 16, size=0.1)
    start = 4 if kind in ("ball", "free") else 0
    beyond = np.maximum(q - mech.upper, 0) - np.maximum(mech.lower - q, 0)

    def powers(q, v, beyond):
        rates = js.configuration_rates(mech, q, v)
        elastic = js.passive_forces(mech, q, v, js.Compliance(limit_stiffness=300.0)) @ v
        return elastic, -300.0 * (beyond * rates)[start:].sum(), js.passive_forces(mech, q, v, SOFT) @ v

    elastic, expected, damped = interpreted(jax.vmap(powers))(q, v, beyond)
    np.testing.assert_allclose(elastic, expected, rtol=1e-12, atol=1e-12)
    assert (damped <= elastic + 1e-12).all()
    if kind == "revolute":
        back = js.passive_forces(mech, mech.upper + 1e-3, np.array([-1.0]), SOFT)
        assert back == 0 and js.passive_forces(mech, mech.upper + 1e-3, np.array([1.0]), SOFT) < -7


@pytest.mark.parametrize("is_data", [False, True], ids=["known", "data"])
def test_equal_limits_of_a_tendon_push_and_pull(is_data, float64):
    """A spring and a damper on either side, also where the length is the limit: there those of one side have a kink."""
    joints = [js.Joint("j", "revolute", "world", "a"), js.Joint("k", "prismatic", "a", "b")]
    tendon = js.Tendon("t", ["j", "k"], [1.0, -2.0], 0.5, lower=0.25, upper=0.25)
    mech = js.Mechanism.build([js.Body("a"), js.Body("b")], joints, tendons=[tendon])
    mech = mech.as_data() if is_data else mech
    q, v = np.array([[0.5, 0.375], [0.5, 0.25], [0.0, 0.25]]), np.array([[0.0, 0.0], [3.0, 1.0], [-3.0, 0.5]])
    force = interpreted(jax.vmap(lambda q, v: js.passive_forces(mech, q, v, SOFT)))
    slopes = interpreted(jax.vmap(jax.jacobian(lambda q, v: js.passive_forces(mech, q, v, SOFT), (0, 1))))(q, v)
    c = np.array([1.0, -2.0])
    tension = -300.0 * (q @ c + 0.25) - 7.0 * (v @ c)
    assert tension[0] == 0 and tension[1] < 0 < tension[2]
    np.testing.assert_allclose(force(q, v), tension[:, None] * c, rtol=1e-14, atol=1e-13)
    for found, k in zip(slopes, (300.0, 7.0), strict=True):
        np.testing.assert_allclose(found, [-k * np.outer(c, c)] * 3, rtol=1e-15)


@pytest.mark.parametrize("is_data", [False, True], ids=["known", "data"])
def test_the_slope_of_a_tendon_at_its_length_at_rest(is_data, float64):
    """It is that of a spring, as beside it; between two lengths nothing pulls."""
    joints = [js.Joint("j", "revolute", "world", "a")]

    def slope(rest, q):
        mech = js.Mechanism.build([js.Body("a")], joints, tendons=[js.Tendon("t", ["j"], [2.0], 0.5, 3.0, rest)])
        mech = mech.as_data() if is_data else mech
        return interpreted(jax.jacobian(lambda q: js.passive_forces(mech, q, 0 * q)))(np.array([q]))

    for q in (-0.25, -0.2, -0.3):
        np.testing.assert_array_equal(slope(0.0, q), [[-12.0]])
    for q, expected in ((-0.35, -12.0), (-0.25, 0.0), (-0.15, -12.0)):
        np.testing.assert_array_equal(slope([-0.1, 0.1], q), [[expected]])


@pytest.mark.parametrize("kind", ["limits", "limit of a ball", "limits of a tendon", "tendon with two lengths at rest"])
def test_no_number_in_none_out(kind, float64):
    """Coordinates, limits and, beyond a limit, velocities that are NaN: no force that looks as if nothing acted."""
    given = {"turn_limit": 0.5} if kind == "limit of a ball" else {"lower": -1.0, "upper": 1.0}
    joint = "ball" if kind == "limit of a ball" else "prismatic"
    tendons = {
        "limits of a tendon": [js.Tendon("t", ["j"], [1.0], lower=-1.0, upper=1.0)],
        "tendon with two lengths at rest": [js.Tendon("t", ["j"], [1.0], stiffness=2.0, rest=[-1.0, 1.0])],
    }.get(kind, [])
    joints = [js.Joint("j", joint, "world", "a", **{} if tendons else given)]
    mech = js.Mechanism.build([js.Body("a")], joints, tendons=tendons)

    def force(mech, q, v):
        return interpreted(lambda q, v: js.passive_forces(mech, q, v, SOFT))(q, v)

    beyond = np.array([0.6, 0, 0, 0.8] if joint == "ball" else [1.5])
    still, none = np.zeros(mech.nv), np.full(mech.nv, np.nan)
    assert force(mech, beyond, still).any() and np.isfinite(force(mech, beyond, still)).all()
    assert np.isnan(force(mech, np.full_like(beyond, np.nan), still)).all()
    if kind != "tendon with two lengths at rest":
        assert np.isnan(force(mech, beyond, none)).any()
    if kind == "limits":
        assert np.isnan(force(mech.replace(upper=none), beyond, still)).all()
    if kind == "limit of a ball":
        assert np.isnan(force(mech.replace(turn_limits=np.array([np.nan])), beyond, still)).all()


def test_a_spring_of_a_mimic_acts_on_its_master(float64):
    joints = [
        js.Joint("j", "revolute", "world", "a", stiffness=2.0, spring_reference=0.25),
        js.Joint("k", "prismatic", "a", "b", mimic=("j", -3.0, 0.5), stiffness=4.0, spring_reference=1.5),
    ]
    mech = js.Mechanism.build([js.Body("a"), js.Body("b")], joints)
    q = 0.7
    expected = -2 * (q - 0.25) + 3 * 4 * (-3 * q + 0.5 - 1.5)
    np.testing.assert_allclose(js.passive_forces(mech, np.array([q]), np.zeros(1)), [expected], rtol=1e-15)


# -- transformations --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_data", [slow(False), True], ids=["known", "data"])
def test_derivatives(is_data, float64):
    """Against differences, where the forces are smooth; and finite where springs and friction rest."""
    mech = sprung(["ball", "planar"])
    given = mech.as_data() if is_data else mech
    q, v = (x[0] for x in state(mech, 1))
    direction = np.random.default_rng(5).standard_normal((2, mech.nv))

    def along(t):
        moved = js.integrate(mech, q, t * direction[0])
        return js.passive_forces(given, moved, v + t * direction[1], SOFT)

    jacobian, at = interpreted(jax.jacfwd(along)), interpreted(along)
    difference = (at(1e-6) - at(-1e-6)) / 2e-6
    np.testing.assert_allclose(jacobian(0.0), difference, rtol=1e-6, atol=1e-5)


def test_derivatives_at_rest(float64):
    """Where springs and friction are, and at no distance from a limit; by the mechanism's numbers too."""
    mech = sprung(["ball", "prismatic"])
    mech = mech.replace(upper=mech.spring_references)
    pulled = jax.grad(lambda m, q, v: js.passive_forces(m, q, v, SOFT).sum(), (0, 1, 2))
    found = interpreted(pulled)(mech.as_data(), jnp.asarray(mech.spring_references), jnp.zeros(mech.nv))
    chex.assert_tree_all_finite(found)
    np.testing.assert_allclose(found[2], -mech.damping - mech.friction_loss / 0.25, rtol=1e-15)
    np.testing.assert_array_equal(found[0].friction_loss, np.zeros(4))


def test_dtype_is_the_state_s(x64):
    dtype = np.float32
    mech = sprung(["revolute", "ball"], dtype)
    q, v = state(mech, 2, dtype)
    assert interpreted(functools.partial(js.passive_forces, mech))(q, v).dtype == dtype
    assert jax.eval_shape(js.passive_forces, mech, q, v).dtype == dtype
    step = jax.eval_shape(js.semi_implicit_step, mech, q, v, v, np.float32(1e-3))
    assert {x.dtype for x in step} == {np.dtype(dtype)}


def nothing():
    return sprung(["revolute", "ball"], np.float32, stiffness=0.0, **NO_RESISTANCE, **NO_LIMITS)


def test_nothing_leaves_nothing_behind():
    mech = nothing()
    q, v = state(mech, 1, np.float32)
    program = jax.make_jaxpr(lambda q, v: js.passive_forces(mech, q, v, SOFT))(q[0], v[0])
    assert [e.primitive.name for e in program.eqns] == ["broadcast_in_dim"]
    limited = mech.replace(lower=np.full_like(mech.lower, -1))

    def plain(q, v, tau):
        q, v, tau, h = steps.checked("plain", mech, q=q, v=v, tau=tau, dt=1e-3)
        v = steps.euler(None, v, h, js.forward_dynamics(mech, q, v, tau))
        return js.integrate(mech, q, v, 1e-3), v

    def step(mech, q, v, tau):
        return js.semi_implicit_step(mech, q, v, tau, 1e-3, compliance=SOFT)

    functions = plain, functools.partial(step, mech), functools.partial(step, limited)
    counts = [done(f, q[0], v[0], v[0]) for f in functions]
    assert counts[0] == counts[1] and flops(counts[1]) < flops(counts[2])
    # A limit alone does not compute springs: there is no arc tangent of a rotation vector.
    program = str(jax.make_jaxpr(lambda q, v: js.passive_forces(limited, q, v, SOFT))(q[0], v[0]))
    assert "sqrt" not in program and "atan" not in program


REFUSED = {
    "no compliance": (3.0, TypeError, "compliance: expected a Compliance, got float"),
    "softness": (js.Compliance(limit_damping=-1.0), ValueError, "limit_damping: expected .* at least 0, got -1"),
    "stiffness": (js.Compliance(limit_stiffness=np.nan), ValueError, "limit_stiffness: .* at least 0, got nan"),
    "speed": (js.Compliance(friction_speed=0.0), ValueError, "compliance: friction_speed: expected numbers above 0"),
    "shape": (
        js.Compliance(limit_stiffness=np.ones(7, np.float32)),
        ValueError,
        r"limit_stiffness: expected .* \(4,\), got \(7,\)",
    ),
    "no number": (js.Compliance(limit_damping="3"), TypeError, "compliance: limit_damping: expected"),
}


@pytest.mark.parametrize(("compliance", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(compliance, error, message):
    mech = nothing()
    with pytest.raises(error, match=message):
        js.passive_forces(mech, mech.neutral(), np.zeros(4, np.float32), compliance)


# -- in steps ---------------------------------------------------------------------------------------------------------


def simulated(step, mech, x, dt, n, **options):
    """Coordinates and rates after every step."""

    def body(x, _):
        x = step(mech, *x, jnp.zeros_like(x[1]), dt, **options)
        return x, x

    return jax.jit(lambda x: jax.lax.scan(body, x, length=n)[1])(x)


def energies(mech, q, v):
    """(of the springs, and of motion and gravity besides) at many states."""
    springs = jax.vmap(functools.partial(spring_energy, mech))(q)
    return springs, springs + js.kinetic_energy(mech, q, v) + js.potential_energy(mech, q)


@pytest.mark.parametrize(
    ("step", "kinds", "dt", "n", "allowed"),
    [
        slow(js.semi_implicit_step, ["revolute", "prismatic"], 2e-3, 1000, 0.1),
        (js.symplectic_step, ["revolute", "prismatic"], 1e-3, 4000, 0.02),
        slow(js.rk4_step, ["ball"], 2e-3, 1000, 1e-6),
    ],
    ids=["semi-implicit", "symplectic", "Runge-Kutta"],
)
def test_springs_conserve_energy(step, kinds, dt, n, allowed, fast):
    """Relative to what moves into the springs and back; symplectic steps do not drift."""
    mech = sprung(kinds, **NO_RESISTANCE, **NO_LIMITS)
    start = [jnp.asarray(x) for x in state(mech, 1)]
    later = simulated(step, mech, tuple(x[0] for x in start), dt, n)
    springs, all_of_them = interpreted(functools.partial(energies, mech))(
        *map(np.concatenate, zip(start, later, strict=True))
    )
    moved, apart = np.ptp(springs), abs(all_of_them - all_of_them[0])[1:]
    assert apart.max() <= allowed * moved
    if step is js.symplectic_step:
        assert abs(apart[-1000:].mean() - apart[:1000].mean()) <= 2e-3 * moved


def pendulum(**numbers):
    body = js.Body("a", js.shift(js.SpatialInertia.solid_sphere(0.1, mass=1.0), np.array([0.0, 0.0, -1.0])))
    joint = js.Joint("j", "revolute", "world", "a", axis=(0.0, 1.0, 0.0), **numbers)
    return js.Mechanism.build([body], [joint], dtype=np.float64)


@pytest.mark.parametrize("step", [js.semi_implicit_step, js.symplectic_step], ids=["semi-implicit", "symplectic"])
def test_friction_stops_what_moves(step, fast):
    """However large: one that is explicit would throw it about at friction dt / inertia, 20 rad/s."""
    mech, x = pendulum(friction_loss=2e4), (jnp.array([0.5]), jnp.array([3.0]))
    _, v = simulated(step, mech, x, 1e-3, 20)
    assert (v >= -1e-6).all() and abs(v[-1, 0]) <= 1e-6


def test_friction_creeps_at_its_part_of_the_speed(fast):
    """Half of what it holds pulls: x / sqrt(x^2 + s^2) = 1/2 at s / sqrt(3)."""
    x = jnp.array([0.5]), jnp.array([0.0])
    pull = -float(js.gravity_forces(pendulum(), x[0])[0])
    mech = pendulum(friction_loss=2 * abs(pull))
    _, v = simulated(js.semi_implicit_step, mech, x, 1e-3, 200, compliance=js.Compliance(friction_speed=1e-3))
    np.testing.assert_allclose(v[-1, 0], np.sign(pull) * 1e-3 / np.sqrt(3), rtol=2e-3)


@pytest.mark.parametrize("step", [js.semi_implicit_step, js.symplectic_step, js.rk4_step])
def test_limits_hold(step, fast):
    """The pendulum falls on its limit, and comes to rest on it as deep as its weight over the stiffness."""
    mech = pendulum(lower=-1.0, upper=1.0)
    soft = js.Compliance(limit_stiffness=1e4, limit_damping=100.0)
    q, _ = simulated(step, mech, (jnp.array([0.1]), jnp.array([0.0])), 2e-3, 1500, compliance=soft)
    assert 1.01 < q.max() < 1.1
    pull = -float(js.gravity_forces(mech, q[-1])[0])
    np.testing.assert_allclose(q[-1, 0] - 1, pull / 1e4, rtol=1e-3)


def test_batches_of_steps_are_as_single_ones(float64):
    """With friction every item has a resistance of its own; times and external forces too."""
    mech = sprung(["revolute", "prismatic"])
    q, v = state(mech, 6)
    q, v, dt = q.reshape(2, 3, -1), v.reshape(2, 3, -1), np.linspace(1e-3, 2e-3, 3)
    tau = np.arange(2.0 * mech.nv).reshape(2, 1, mech.nv)
    forces = {mech.body_names[1]: js.SpatialForce(np.ones((3, 3)), np.arange(9.0).reshape(3, 3))}
    step = interpreted(functools.partial(js.semi_implicit_step, mech, compliance=SOFT))
    many = step(q, v, tau, dt, forces)
    assert many[0].shape == q.shape
    for i, k in itertools.product(range(2), range(3)):
        force = jax.tree.map(lambda x, k=k: x[k], forces)
        for a, b in zip(many, step(q[i, k], v[i, k], tau[i, 0], dt[k], force), strict=True):
            np.testing.assert_allclose(a[i, k], b, rtol=1e-13)
