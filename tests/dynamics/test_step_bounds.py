"""The error bounds of configurations, steps in time and factors of the mass matrix, against 60 digits."""

import functools
import itertools

import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.dynamics import composite_bodies, configuration, forward_dynamics, steps
from tests.helpers import exact_steps as exact
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but

KINDS = ["revolute", "continuous", "planar", "ball", "free"]
# "fast" has the bounds of "reproducible", and is compiled: of it some cases are enough.
PRECISIONS = "fast", "reproducible", "compensated"
U = 2.0**-24
MANY = 20


def cases(names, *compiled):
    """All pairs of a name and a precision: in "fast" those of few names by default."""
    pairs = list(itertools.product(names, PRECISIONS))
    return slow_but([x for x in pairs if x[1] != "fast" or x[0] in compiled], pairs)


@functools.cache
def joint(kind):
    body = js.Body("body", js.SpatialInertia.solid_sphere(0.5, mass=1.0))
    return js.Mechanism.build([body], [js.Joint("joint", kind, "world", "body")], dtype=np.float64)


def configurations(kind, rng):
    mech = joint(kind)
    q = rng.uniform(-3, 3, (MANY, mech.nq))
    if mech.nq > mech.nv:
        # Of length one, as rounded, and of any.
        lengths = np.where(np.arange(MANY) % 2, 1.0, 10.0 ** rng.uniform(-9, 9, MANY))
        q[:, :4] *= (lengths / np.linalg.norm(q[:, :4], axis=1))[:, None]
    return q.astype(np.float32)


@functools.cache
def inputs(kind, faster=1.0):
    rng = np.random.default_rng(0)
    v = faster * rng.standard_normal((MANY, joint(kind).nv)) * 10.0 ** rng.uniform(-3, 0.5, (MANY, 1))
    dt = rng.uniform(0.01, 1, MANY)
    return configurations(kind, rng), configurations(kind, rng), v.astype(np.float32), dt.astype(np.float32)


def ours(kind, precision, faster=1.0):
    mech = joint(kind)

    def of(q, q1, v, dt):
        with js.default_precision(precision):
            return js.integrate(mech, q, v, dt), js.difference(mech, q, q1), js.configuration_rates(mech, q, v)

    return [np.asarray(x) for x in evaluated(precision, of)(*inputs(kind, faster))]


def parts(kind, of_rates):
    """(slice, what it is) of coordinates, or of rates."""
    if kind in ("ball", "free"):
        n = 3 if of_rates else 4
        return [(slice(0, n), "turn"), (slice(n, n + 3), "position")][: 1 + (kind == "free")]
    return [(slice(0, 2), "position"), (slice(2, 3), "number")] if kind == "planar" else [(slice(0, 1), "number")]


def limits(kind, q, q1, v, step):
    """(of integrate, of difference, of rates): what -> the records of its bound, each with its size."""
    norm, turning = exact.norm, kind in ("ball", "free")
    place = slice(4, 7) if kind == "free" else slice(0, 2)
    linear = slice(3, 6) if kind == "free" else slice(0, 2)
    w = norm(step[:3] if turning else step[-1:])
    far = max(w - mp.pi, 0) and w
    apart = norm(exact.differed(kind, q, q1)[:3] if turning else exact.differed(kind, q, q1)[-1:])
    angle = configuration.SHORTEST if kind in ("continuous", "planar") else configuration.DIFFERENCE
    between = norm(q[place]) + norm(q1[place])
    return (
        {
            "number": [(configuration.INTEGRATED, abs(q[-1]) + abs(step[-1]))],
            "turn": [(configuration.INTEGRATED_TURN, 1), (configuration.TURNS, far)],
            "position": [
                (configuration.INTEGRATED_POSITION, norm(q[place]) + norm(step[linear])),
                (configuration.TURNS_OF_POSITION, far * norm(step[linear])),
            ],
        },
        {
            "number": [(angle, abs(q[-1]) + abs(q1[-1]))],
            "turn": [(configuration.DIFFERENCE_TURN, 1)],
            "position": [(configuration.DIFFERENCE_POSITION, between * (1 + apart))],
        },
        {
            "number": [],
            "turn": [(configuration.QUATERNION_RATE, norm(v[:3]) * norm(q[:4]))],
            "position": [(configuration.POSITION_RATE, norm(v[linear]))],
        },
    )


def _in_units(records, precision, r=None):
    """In u, of a result of the size r."""
    return sum(bound.allowed(precision, 1, size, r) for bound, size in records)


@pytest.mark.parametrize(("kind", "precision"), cases(KINDS, "continuous"))
def test_configurations(kind, precision):
    _require_within_bounds(kind, precision)


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_configurations_after_many_turns(precision):
    _require_within_bounds("free", precision, faster=1e3)


def _require_within_bounds(kind, precision, faster=1.0):
    found = ours(kind, precision, faster)
    for i in range(MANY):
        q, q1, v, (dt,) = (exact.numbers(np.atleast_1d(x[i])) for x in inputs(kind, faster))
        step = [x * dt for x in v]
        wanted = exact.integrated(kind, q, step), exact.differed(kind, q, q1), exact.rates(kind, q, v)
        for k, (array, numbers) in enumerate(zip(found, wanted, strict=True)):
            for place, what in parts(kind, of_rates=k == 1):
                limit = _in_units(limits(kind, q, q1, v, step)[k][what], precision, exact.norm(numbers[place]))
                error = _apart(exact.numbers(array[i][place]), numbers[place], k == 0 and what == "turn")
                assert error <= limit * U, (
                    ("integrate", "difference", "rates")[k],
                    what,
                    float(error / U),
                    float(limit),
                )


def _apart(a, b, of_either_sign):
    both = [exact.norm([x - s * y for x, y in zip(a, b, strict=True)]) for s in (1, -1)]
    return min(both) if of_either_sign else both[0]


@pytest.mark.parametrize("precision", [slow("fast"), *PRECISIONS[1:]])
def test_interpolation(precision):
    """Half the way between orientations and positions."""
    mech, (q, q1, _, t) = joint("free"), inputs("free")
    found = np.asarray(evaluated(precision, lambda *x: js.interpolate(mech, *x, precision=precision))(q, q1, t))
    for i in range(MANY):
        a, b, (s,) = (exact.numbers(np.atleast_1d(x[i])) for x in (q, q1, t))
        rates = exact.differed("free", a, b)
        step = [s * x for x in rates]
        wanted = exact.integrated("free", a, step)
        one, two = (
            {what: _in_units(x, "reproducible") for what, x in each.items()}
            for each in limits("free", a, b, rates, step)[:2]
        )
        scale = 1 if precision == "fast" or precision == "reproducible" else mp.mpf(1) / 2
        error = _apart(exact.numbers(found[i][:4]), wanted[:4], True)
        assert error <= scale * (one["turn"] + s * two["turn"]) * U
        error = exact.norm([x - y for x, y in zip(exact.numbers(found[i][4:]), wanted[4:], strict=True)])
        assert error <= scale * (one["position"] + s * two["position"]) * (1 + exact.norm(step[:3])) * U


# -- chains -----------------------------------------------------------------------------------------------------------

N = 3


@functools.cache
def chain():
    """Frames turned by quarters, which is exact."""
    rng = np.random.default_rng(0)
    quarters = [js.Rotation.from_matrix(np.float64(m)) for m in ([[0, -1, 0], [1, 0, 0], [0, 0, 1]], np.eye(3))]
    names = ["world", *(f"body{i}" for i in range(N))]
    bodies, joints = [], []
    for i in range(N):
        a = rng.standard_normal((3, 3))
        mass, com, arm, central = (
            np.float64(np.float32(x))
            for x in (
                rng.uniform(1, 3),
                rng.standard_normal(3) / 5,
                rng.standard_normal(3),
                (a @ a.T + np.eye(3)) / 100,
            )
        )
        bodies.append(js.Body(names[i + 1], js.SpatialInertia(mass, com, central)))
        X = js.RigidTransform(quarters[i % 2], arm)
        joints.append(js.Joint(f"joint{i}", "revolute", names[i], names[i + 1], axis=np.eye(3)[i % 3], placement=X))
    return js.Mechanism.build(bodies, joints, gravity=(0.5, -9.75, 1.25), dtype=np.float64)


@functools.cache
def state():
    return np.random.default_rng(1).uniform(-3, 3, (3, N)).astype(np.float32)


@functools.cache
def stepped(name, h):
    with mp.workdps(60):
        q, v, _ = map(exact.numbers, state())
        steps = exact.Steps(chain(), state()[2], h)
        return getattr(steps, name)(q, v), steps.accelerations(q, v), steps.mass_matrix(q)


STEPS = {"semi_implicit": js.semi_implicit_step, "rk4": js.rk4_step, "symplectic": js.symplectic_step}


@pytest.mark.parametrize(("name", "precision"), cases(STEPS))
def test_steps(name, precision):
    """Of a thousandth and of a hundred-thousandth of a second: rates taken from a difference of coordinates would be
    off by u |q| / dt, which none of the bounds allows."""
    dt = np.float32([1e-3, 1e-5])
    found = evaluated(precision, functools.partial(STEPS[name], chain(), precision=precision))(*state(), dt)
    for q, v, h in zip(*map(np.asarray, found), dt, strict=True):
        (q_exact, v_exact), vdot, M = stepped(name, h)
        c, h = np.linalg.cond(np.array(M.tolist(), float)), float(h)
        of_q, of_v, of_vdot = (max(map(abs, x)) for x in (exact.numbers(state()[0]), v_exact, vdot))
        of_dynamics = forward_dynamics.FORWARD_DYNAMICS.allowed(precision, 1, N * c * of_vdot, of_vdot)
        if name == "symplectic":
            limit = steps.SYMPLECTIC.allowed(precision, 1, N * c * (of_v + h * of_vdot))
            assert h > 1e-4 or limit < of_q / h / 10
        else:
            own = steps.SEMI_IMPLICIT if name == "semi_implicit" else steps.RK4
            limit = own.allowed(precision, 1, of_v + h * of_vdot) + h * of_dynamics * 1.1
        assert _largest(v, v_exact) <= limit * U, float(_largest(v, v_exact) / U)
        own = (steps.RK4_COORDINATES if name == "rk4" else configuration.INTEGRATED).u * (of_q + h * of_v)
        assert _largest(q, q_exact) <= (own + h * limit) * U, float(_largest(q, q_exact) / U)


@functools.cache
def ball(kind):
    """Of mass 1 and inertia 1, floating, in a field."""
    body = js.Body("body", js.SpatialInertia(1.0, np.zeros(3), np.eye(3)))
    return js.Mechanism.build([body], [js.Joint("joint", kind, "world", "body")], gravity=FIELD, dtype=np.float64)


FIELD, FLOATING = (0.5, -9.75, 1.25), ("free", "planar")


@pytest.mark.parametrize(("kind", "precision"), cases(FLOATING, "planar"))
def test_steps_of_what_floats(kind, precision):
    """Of a ball, a = f + g and alpha = tau: turns within a step from none to several."""
    mech, rng = ball(kind), np.random.default_rng(5)
    q, (_, _, v, dt), tau = configurations(kind, rng), inputs(kind), rng.standard_normal((MANY, ball(kind).nv))
    v, tau = (v * np.float32(10) ** rng.uniform(0, 1.5, (MANY, 1))).astype(np.float32), tau.astype(np.float32)
    step = functools.partial(js.semi_implicit_step, mech, precision=precision)
    found = [np.asarray(x) for x in evaluated(precision, step)(q, v, tau, dt)]
    place, linear = (slice(4, 7), slice(3, 6)) if kind == "free" else (slice(0, 2), slice(0, 2))
    angular = slice(0, 3) if kind == "free" else slice(2, 3)
    for i in range(MANY):
        x, rates, forces, (h,) = (exact.numbers(np.atleast_1d(y[i])) for y in (q, v, tau, dt))
        turn = [x[0], *(-c for c in x[1:4])] if kind == "free" else exact.planar([0, 0, -x[2]])[0]
        g = exact.rotated(turn, [mp.mpf(c) for c in FIELD])[: linear.stop - linear.start]
        a = list(forces)
        a[linear] = [f + c for f, c in zip(forces[linear], g, strict=True)]
        q_exact, v_exact = exact.straight_ahead(kind, x, rates, a, h)
        w = exact.norm(v_exact[angular])
        centripetal = exact.norm(rates[angular]) * exact.norm(rates[linear])
        vdot = exact.norm(a) + centripetal
        of_dynamics = forward_dynamics.FORWARD_DYNAMICS.allowed(precision, U, vdot, vdot) / U
        far = max(h * w - mp.pi, 0) and h * w
        size = exact.norm(rates[linear]) + h * vdot
        own = steps.STRAIGHT_AHEAD.allowed(precision, 1, size) + steps.TURNS.allowed(precision, 1, far * size)
        limit = own + h * of_dynamics
        error = exact.norm([b - c for b, c in zip(exact.numbers(found[1][i][linear]), v_exact[linear], strict=True)])
        assert error <= limit * U, ("v", float(error / U / size), float(limit / size))
        moved = (
            configuration.INTEGRATED_POSITION.u * (exact.norm(x[place]) + h * exact.norm(v_exact[linear])) + h * limit
        )
        error = exact.norm([b - c for b, c in zip(exact.numbers(found[0][i][place]), q_exact[place], strict=True)])
        assert error <= moved * U, ("q", float(error / U), float(moved))


def _largest(ours, numbers):
    return max(abs(x - y) for x, y in zip(exact.numbers(ours), numbers, strict=True))


def test_factors_of_the_mass_matrix():
    """Of a given matrix, near singular: its own errors are in `test_bounds`."""
    factor = interpreted(functools.partial(js.mass_matrix_factor, chain()))(state()[0])
    M = np.asarray(interpreted(functools.partial(js.mass_matrix, chain()))(state()[0]), np.float64)
    L, n = np.asarray(factor.L, np.float64), N
    size, c = np.linalg.norm(M, 2), np.linalg.cond(M)
    assert np.linalg.norm(L.T @ L - M, 2) <= composite_bodies.FACTOR.u * n * (n + 1) * U * size
    tau = state()[2]
    x = np.linalg.solve(M, tau.astype(np.float64))
    limit = composite_bodies.SOLVED.u * n * (n + 1) * U * c
    assert np.linalg.norm(np.asarray(factor.solve(tau), np.float64) - x) <= limit * np.linalg.norm(x)
    inverse = np.linalg.inv(M)
    assert np.linalg.norm(np.asarray(factor.inverse(), np.float64) - inverse, 2) <= limit * np.linalg.norm(inverse, 2)
    logs = np.abs(np.log(np.diagonal(L))).sum()
    limit = composite_bodies.LOG_DETERMINANT.u * n * U * (2 * logs + composite_bodies.SOLVED.u * n * (n + 1) * c)
    assert abs(float(factor.log_determinant()) - np.linalg.slogdet(M)[1]) <= limit
    assert jnp.isfinite(factor.L).all()
