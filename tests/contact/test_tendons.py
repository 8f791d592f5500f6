"""Limits of tendons and of the angles of balls in the convex step: against the oracle and differences."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import contact_oracle as oracle
from tests.helpers.counting import done
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

DT = 5e-3
ALLOWED = 1e-9


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def link():
    return js.SpatialInertia.solid_ellipsoid(np.array([0.1, 0.05, 0.2]), mass=np.float64(1.5)).shift(
        np.array([0.02, 0, 0.2])
    )


@functools.cache
def hand(with_balls=True):
    """A floating palm with two fingers, coupled by tendons, and a ball; with spheres, a limit and a closure."""
    out = [js.RigidTransform(js.Rotation.exp(np.array(w)), np.array(p)) for w, p in
           (([0.3, 0, 0], [0.2, 0, 0]), ([0, 0.5, 0], [0.3, 0, 0.1]), ([0.0, 0, -1], [0, 0.3, 0]))]  # fmt: skip
    third = {"kind": "ball", "turn_limit": 0.6} if with_balls else {"kind": "prismatic", "axis": (1, 0, 0)}
    joints = [
        js.Joint("root", "free", "world", "a"),
        js.Joint("j", "revolute", "a", "b", out[0], axis=(0, 1, 0), damping=0.1, upper=0.5),
        js.Joint("k", "revolute", "b", "c", out[1], axis=(0, 0.6, 0.8), friction_loss=0.2),
        js.Joint("l", parent="a", child="d", placement=out[2], **third),
        js.Joint("m", "prismatic", "d", "e", out[1], axis=(0, 0, 1)),
    ]
    tendons = [
        js.Tendon("pull", ["j", "k", "m"], [1.0, -0.5, 2.0], 0.1, lower=-0.2, upper=0.3),
        js.Tendon("stop", ["m", "j"], [1.0, 0.4], upper=0.1),
        js.Tendon("spring", ["j", "k"], [1.0, 1.0], stiffness=3.0, damping=0.01),
    ]
    mech = js.Mechanism.build([js.Body(x, link()) for x in "abcde"], joints, tendons=tendons, dtype=np.float64)
    law = {"stiffness": np.float64(1e4), "relaxation_time": np.float64(0.01), "friction": np.float64(0.5)}
    contacts = js.PointContacts(["a", "c", "e"], np.full((3, 3), 0.02), np.full(3, 0.3), **law)
    return mech, contacts


def states(mech, n, seed=0):
    rng = np.random.default_rng(seed)
    q = np.array(interpreted(lambda v: js.integrate(mech, mech.neutral(), v))(0.35 * rng.standard_normal((n, mech.nv))))
    return q, *rng.standard_normal((2, n, mech.nv))


TERMS = {
    "alone": lambda _: {},
    "contacts": lambda contacts: {"contacts": contacts},
    "contacts and a closure": lambda contacts: {
        "contacts": contacts,
        "loops": [js.LoopClosure("c", "e", "distance", 0.5)],
    },
}


@pytest.mark.parametrize("name", [slow("alone"), slow("contacts"), "contacts and a closure"])
def test_it_is_the_optimum(name):
    (mech, contacts), n = hand(), 8
    q, v, tau = states(mech, n)
    terms = TERMS[name](contacts)
    found = interpreted(lambda *x: js.convex_step(mech, *x, DT, **terms))(q, v, tau)
    far = js.PointContacts(["a"], np.array([[0, 0, 1e3]]), stiffness=1.0, relaxation_time=0.0, friction=0.0)
    terms.setdefault("contacts", far)
    near = 0
    problems = oracle.problems_of(mech, q, v, tau, np.full(n, DT), **terms)
    for i, own in enumerate(problems):
        after, expected = oracle.in_world(mech, found.q[i]) @ found.v[i], own.problem.optimum(own.v).v
        np.testing.assert_allclose(after, expected, rtol=0, atol=ALLOWED * max(abs(expected).max(), 1), err_msg=f"{i}")
        near += sum(np.count_nonzero(J) > 1 for J, _ in own.problem.terms if len(J) == 1)
    assert near > n and found.residual.max() < 1e-6 and found.iterations.max() < 30


@pytest.mark.parametrize("joints", [("j", "k"), slow(("k",))])
def test_mimics(joints):
    """A tendon counts a mimic with the joint that it follows: it is the tendon over that joint, with the sum."""
    out = js.RigidTransform(js.Rotation.exp(np.array([0.3, 0, 0])), np.array([0.2, 0, 0]))
    c = {"j": 1.0, "k": 0.5}

    def step(tendon):
        made = [js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0)),
                js.Joint("k", "revolute", "a", "b", out, axis=(0, 1, 0), mimic=("j", 2.0, 0.1)),
                js.Joint("l", "revolute", "b", "c", out, axis=(1, 0, 0))]  # fmt: skip
        mech = js.Mechanism.build([js.Body(x, link()) for x in "abc"], made, tendons=[tendon], dtype=np.float64)
        q, v = np.array([[0.3, 0.1], [0.2, -0.4]]), np.array([[2.0, 1.0], [0.5, -1.0]])
        return interpreted(lambda q, v: js.convex_step(mech, q, v, 0 * v, DT))(q, v)

    given = {"lower": -0.5, "upper": 0.2}
    found = step(js.Tendon("t", [*joints, "l"], [*(c[x] for x in joints), 0.3], **given))
    multiplier = sum({"j": 1.0, "k": 2 * c["k"]}[x] for x in joints)
    expected = step(js.Tendon("t", ["j", "l"], [multiplier, 0.3], 0.1 * c["k"], **given))
    np.testing.assert_allclose(found.v, expected.v, rtol=0, atol=ALLOWED)
    assert (found.iterations > 0).any() and found.residual.max() < 1e-8


def test_a_tendon_over_one_joint_is_its_limit():
    """L = 2 q - 0.1 between -0.5 and 0.3, and q between -0.2 and 0.2: of joints with and without the tendon."""

    def step(limits, tendons):
        joint = js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0), **limits)
        mech = js.Mechanism.build([js.Body("a", link())], [joint], tendons=tendons, dtype=np.float64)
        q, v = np.array([[0.25], [0.199], [0.0], [-0.2], [-0.3]]), np.array([[0.1], [1.0], [3.0], [-1.0], [0.2]])
        return interpreted(lambda q, v: js.convex_step(mech, q, v, 0 * v, DT))(q, v)

    own = js.Tendon("t", ["j"], [2.0], -0.1, lower=-0.5, upper=0.3)
    found, expected = step({}, [own]), step({"lower": -0.2, "upper": 0.2}, [])
    np.testing.assert_allclose(found.v, expected.v, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.iterations > 0, expected.iterations > 0)


def held(free=False):
    """A chain with a tendon of one length and a joint that is held; free: without either."""
    out = js.RigidTransform(js.Rotation.exp(np.array([0.3, 0, 0.2])), np.array([0.2, 0, 0]))
    stop = {} if free else {"lower": 0.25, "upper": 0.25}
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0), damping=0.2),
        js.Joint("k", "revolute", "a", "b", out, axis=(1, 0, 0)),
        js.Joint("l", "prismatic", "b", "c", out, axis=(0, 0.6, 0.8)),
        js.Joint("m", "revolute", "c", "d", out, axis=(0, 0, 1), **stop),
    ]
    tendons = [] if free else [js.Tendon("t", ["j", "k", "l"], [1.0, -0.5, 2.0], 0.125, lower=0.375, upper=0.375)]
    bodies = [js.Body(x, link()) for x in "abcd"]
    return js.Mechanism.build(bodies, joints, gravity=np.zeros(3), tendons=tendons, dtype=np.float64)


@pytest.mark.parametrize("as_data", [False, slow(True)])
def test_equal_limits_hold_from_both_sides(as_data):
    """The optimum in closed form, two-sided wherever the state is. At rest nothing pushes: with limits of one side the
    derivatives would be those of free motion."""
    mech, without, n = held(), held(free=True), 6
    mech = mech.as_data() if as_data else mech
    J, goal, rng = np.array([[1, -0.5, 2, 0], [0, 0, 0, 1.0]]), np.array([0.25, 0.25]), np.random.default_rng(0)
    q, v = 0.1 * rng.standard_normal((2, n, 4))
    # Open, and closed up to rounding; the last one exactly, and at rest.
    q[n // 2 :, 2:] = np.stack([(0.25 - q[:, 0] + 0.5 * q[:, 1]) / 2, np.full(n, 0.25)], 1)[n // 2 :]
    q[-1], v[-1] = [0, 0, 0.125, 0.25], 0
    tau = 0 * v

    def moved(q, v, tau):
        after = js.convex_step(mech, q, v, tau, DT)
        return after.v, jax.jacobian(lambda tau: js.convex_step(mech, q, v, tau, DT).v)(tau), after.residual

    def oracle_numbers(q, v):
        return js.mass_matrix(without, q), js.bias_forces(without, q, v)

    found, slopes, residual = interpreted(jax.vmap(moved))(q, v, tau)
    for i, (M, bias) in enumerate(zip(*interpreted(jax.vmap(oracle_numbers))(q, v), strict=True)):
        A = M + DT * np.diag(without.damping)
        free = np.linalg.solve(A, M @ v[i] - DT * bias)
        R = oracle.NEAR_RIGID_LIMIT * np.array([oracle.delassus(A, row[None]) for row in J])
        target = (goal - J @ q[i]) / (2 * DT)
        H = A + J.T @ (J / R[:, None])
        expected = np.linalg.solve(H, A @ free + J.T @ (target / R))
        np.testing.assert_allclose(found[i], expected, rtol=0, atol=ALLOWED * max(abs(expected).max(), 1))
        inverse = DT * np.linalg.inv(H)
        np.testing.assert_allclose(slopes[i], inverse, rtol=0, atol=ALLOWED * abs(inverse).max())
    assert residual.max() < 1e-8 and (found[-1] == 0).all()


def test_derivatives():
    """By q, v, tau and the numbers of tendons and balls, against differences; forward and reverse agree."""
    out = js.RigidTransform(js.Rotation.exp(np.array([0.3, 0, 0.2])), np.array([0.2, 0, 0]))
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0)),
        js.Joint("k", "ball", "a", "b", out, turn_limit=0.6),
        js.Joint("l", "prismatic", "b", "c", out, axis=(0, 0, 1)),
    ]
    pull = js.Tendon("pull", ["j", "l"], [1.0, 2.0], 0.1, lower=-0.2, upper=0.3)
    mech = js.Mechanism.build([js.Body(x, link()) for x in "abc"], joints, tendons=[pull], dtype=np.float64)
    rng, h = np.random.default_rng(1), 1e-6
    # Both limits act.
    q = np.array(js.integrate(mech, mech.neutral(), np.array([0.45, 0.5, 0.3, -0.4, 0.02])))
    v, tau = rng.standard_normal((2, mech.nv))
    at = v, tau, mech.tendons, mech.turn_limits
    moving = jax.tree.map(lambda x: rng.standard_normal(np.shape(x)) * np.isfinite(x), at)
    along_q = rng.standard_normal(mech.nv)

    def after(s, v, tau, tendons, turn_limits):
        own = mech.replace(tendons=tendons, turn_limits=turn_limits)
        return js.convex_step(own, js.integrate(mech, q, s * along_q), v, tau, DT).v

    def given(s):
        return s, *jax.tree.map(lambda x, d: x + s * d, at, moving)

    def derivatives(s, *x):
        value, tangent = jax.jvp(after, (s, *x), (1.0, *moving))
        return value, tangent, jax.vjp(after, s, *x)[1](np.ones(mech.nv))

    near = [given(x) for x in (0.0, h, -h)]
    stacked = jax.tree.map(lambda *x: np.stack(x), *near)
    values, tangents, pulled = interpreted(jax.vmap(derivatives))(*stacked)
    difference = (values[1] - values[2]) / (2 * h)
    np.testing.assert_allclose(tangents[0], difference, rtol=0, atol=1e-6 * max(abs(difference).max(), 1))
    pulled = jax.tree.map(lambda x: np.asarray(x)[0], pulled)
    both = zip(jax.tree.leaves(pulled), jax.tree.leaves((1.0, *moving)), strict=True)
    np.testing.assert_allclose(sum(np.vdot(a, b) for a, b in both), tangents[0].sum(), rtol=1e-7)
    assert abs(pulled[3][0].upper) > 1 and abs(pulled[4]).max() > 1 and pulled[3][0].lower == 0


def test_without_limits_it_costs_nothing():
    def operations(*tendons, **limit):
        joints = [
            js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0), upper=1.0),
            js.Joint("k", "ball", "a", "b", **limit),
        ]
        mech = js.Mechanism.build([js.Body(x, link()) for x in "ab"], joints, tendons=tendons, dtype=np.float64)
        q, v = np.concatenate([[0.1], mech.neutral()[1:]]), np.ones(4)
        return done(lambda *x: js.convex_step(mech, *x, DT).v, q, v, v, in_all_turns=False)

    alone = operations()
    assert operations(js.Tendon("t", ["j"], [1.0])) == alone
    assert operations(js.Tendon("t", ["j"], [1.0], upper=1.0))["sqrt"] > alone["sqrt"]
    assert operations(turn_limit=0.5)["sqrt"] > alone["sqrt"]


def test_no_number_in_none_out():
    mech, _ = hand()
    q, v, tau = (x[0] for x in states(mech, 1))
    bad = mech.replace(tendons=[js.Tendon("t", ["j", "m"], [1.0, 1.0], lower=jnp.asarray(np.nan))])
    assert np.isnan(interpreted(lambda *x: js.convex_step(bad, *x, DT).v)(q, v, tau)).any()
