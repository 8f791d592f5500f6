"""The convex step: against the oracle, in cases that one works out by hand, in hostile states, and its derivatives."""

import functools
from typing import NamedTuple
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.contact import newton
from tests.helpers import contact_oracle as oracle
from tests.helpers import contact_scenes as scenes
from tests.helpers.counting import asked_for, done, flops
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.random_scenes import BUILT, built_scene, decrement, random_scene

G = 9.81
# Of velocities in float64, relative to the largest of them and of what gravity adds: the solver's tolerance.
ALLOWED = 1e-8
# The unit roundoff, and the smallest inertia of a velocity of the tree.
U, LIGHTEST = 2.0**-53, 0.1


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


# -- against the oracle -----------------------------------------------------------------------------------------------


@functools.cache
def tree():
    """A floating body with an arm: springs, damping, dry friction, limits; spheres on all bodies, two on the root."""
    ball = js.SpatialInertia.solid_ellipsoid(np.array([0.2, 0.3, 0.1]), mass=np.float64(2))
    joint = {"stiffness": 2.0, "damping": 0.3, "friction_loss": 0.5, "lower": -0.6, "upper": 0.8}
    out = [js.RigidTransform(js.Rotation.exp(np.array(w)), np.array(p)) for w, p in
           (([0.3, 0, 0], [0.2, 0, 0]), ([0, 0.5, 0], [0.3, 0, 0.1]), ([0.0, 0, -1], [0, 0.3, 0]))]  # fmt: skip
    joints = [
        js.Joint("root", "free", "world", "a"),
        js.Joint("j", "revolute", "a", "b", out[0], axis=(0, 1, 0), **joint),
        js.Joint("k", "prismatic", "b", "c", out[1], axis=(0, 0, 1), **joint | {"friction_loss": 0.0}),
        js.Joint("l", "revolute", "a", "d", out[2], axis=(1, 0, 0), **joint | {"lower": -np.inf}),
    ]
    mech = js.Mechanism.build([js.Body(name, ball) for name in "abcd"], joints, dtype=np.float64)
    stiffness, relaxation_time = np.array([1e4, 3e3, 1e5, 2e3, 1e4]), np.array([0.0, 0.05, 0.01, 0.1, 0.02])
    positions = np.array([[0, 0, -0.1], [-0.1, 0, -0.1], [0.1, 0, -0.1], [0.1, 0.1, 0], [0, 0.2, 0]])
    friction = np.array([0.0, 0.5, 0.3, 1.0, 0.6])
    return scenes.Scene("", mech, True, tuple("aabcd"), positions, 0.05, stiffness, relaxation_time, friction)


SCENES = {"box": scenes.box, "arm": scenes.arm, "tree": tree}


@functools.cache
def step(name, dt, dtype="float64"):
    """A step of many states, with the contacts of a scene: q, v, tau -> ConvexStep."""
    scene = SCENES[name]()
    mech, contacts = scene.mechanism.astype(dtype), scene.contacts.astype(dtype)
    return interpreted(lambda q, v, tau: js.convex_step(mech, q, v, tau, np.dtype(dtype).type(dt), contacts=contacts))


def many(name, n, seed=0):
    found = scenes.states(SCENES[name](), n, seed)
    return [np.array(x) for x in zip(*found, strict=True)]


FEW = [("box", 5e-3), ("arm", 1e-3), ("tree", 1e-2)]
CASES = slow_but(FEW, [(name, dt) for name in SCENES for dt in (1e-3, 5e-3, 1e-2)])


@pytest.mark.parametrize(("name", "dt"), CASES)
def test_it_is_the_optimum(name, dt):
    scene, (q, v, tau), n_rows = SCENES[name](), many(name, 40), []
    found = step(name, dt)(q, v, tau)
    assert found.residual.shape == found.iterations.shape == (40,)
    for i, expected in enumerate(oracle.steps_of(scene.mechanism, q, v, tau, dt, scene.contacts)):
        after = oracle.in_world(scene.mechanism, found.q[i]) @ found.v[i]
        size, f = max(abs(expected.v).max(), abs(v[i]).max(), G * dt), found.contact_forces
        np.testing.assert_allclose(after, expected.v, rtol=0, atol=ALLOWED * size, err_msg=f"{i}")
        # A stiff contact turns an error of a velocity into one of an impulse: momenta are what is compared.
        largest = max(abs(expected.forces).max(), 1)
        np.testing.assert_allclose(f.f[i], expected.forces, rtol=0, atol=1e-6 * largest, err_msg=f"{i}")
        np.testing.assert_array_equal(f.tau[i], 0)
        n_rows.append(len(expected.result.impulses))
    assert np.mean(np.array(n_rows) > 0) > 0.5 and found.iterations.max() < 30
    assert found.residual.max() < 1e-6


def test_without_anything_to_touch_it_is_the_plain_step():
    """The same program where there are no contacts; with contacts far away, the same bits."""
    scene, (q, v, tau) = scenes.box(), many("box", 8)
    expected = interpreted(lambda *x: js.semi_implicit_step(scene.mechanism, *x, 1e-2))(q, v, tau)
    alone = interpreted(lambda *x: js.convex_step(scene.mechanism, *x, 1e-2))(q, v, tau)
    far = {"contacts": scene.contacts, "ground": js.HalfSpace(offset=-99.0)}
    above = interpreted(lambda *x: js.convex_step(scene.mechanism, *x, 1e-2, **far))(q, v, tau)
    for found in (alone, above):
        np.testing.assert_array_equal(found.q, expected[0])
        np.testing.assert_array_equal(found.v, expected[1])
        np.testing.assert_array_equal(found.residual, 0)
        np.testing.assert_array_equal(found.iterations, 0)
    np.testing.assert_array_equal(above.contact_forces.to_array(), 0)

    mech = scene.mechanism
    for count in (asked_for, done):
        found = count(lambda *x: js.convex_step(mech, *x, 1e-2)[:2], q[0], v[0], tau[0])
        assert found == count(lambda *x: js.semi_implicit_step(mech, *x, 1e-2), q[0], v[0], tau[0])


def test_where_an_arm_touches_nothing_it_has_the_bits_of_the_plain_step():
    """In float32, with limits and spheres that are far: damping, and no term acts."""
    scene = scenes.arm()
    mech, contacts = scene.mechanism.astype(np.float32), scene.contacts.astype(np.float32)
    rng = np.random.default_rng(1)
    middle = (np.asarray(mech.lower) + np.asarray(mech.upper)) / 2
    q = (middle + 0.02 * rng.standard_normal((8, 4))).astype(np.float32)
    v, tau = (rng.standard_normal((2, 8, 4)) * [[[0.5]], [[2]]]).astype(np.float32)
    dt, ground = np.float32(1e-3), js.HalfSpace(offset=-9.0).astype(np.float32)
    found = interpreted(lambda *x: js.convex_step(mech, *x, dt, contacts=contacts, ground=ground))(q, v, tau)
    expected = interpreted(lambda *x: js.semi_implicit_step(mech, *x, dt))(q, v, tau)
    np.testing.assert_array_equal(found.iterations, 0)
    np.testing.assert_array_equal(found.q, expected[0])
    np.testing.assert_array_equal(found.v, expected[1])


def curved(p):
    """Distance from the surface of a ball of radius 5, centre at (0.5, 0, -5)."""
    return jnp.sqrt(((p - jnp.array([0.5, 0.0, -5.0], p.dtype)) ** 2).sum()) - 5


def test_a_curved_ground():
    scene, (q, v, tau), dt = scenes.box(), many("box", 8), 5e-3
    # Near its top, and 5 mm lower than above a plane.
    q[:, 4:] = q[:, 4:] * [0.1, 0.1, 1] + [0.5, 0, -0.005]
    mech, contacts = scene.mechanism, scene.contacts
    found = interpreted(lambda *x: js.convex_step(mech, *x, dt, contacts=contacts, ground=curved))(q, v, tau)
    n_inside = 0
    for i, expected in enumerate(oracle.steps_of(mech, q, v, tau, dt, contacts, curved)):
        after, f = oracle.in_world(mech, found.q[i]) @ found.v[i], found.contact_forces.f[i]
        np.testing.assert_allclose(after, expected.v, rtol=0, atol=ALLOWED * max(abs(v[i]).max(), 1))
        np.testing.assert_allclose(f, expected.forces, rtol=0, atol=1e-6 * max(abs(expected.forces).max(), 1))
        n_inside += np.count_nonzero(expected.forces.any(1))
    assert n_inside > 5


class Terrain(NamedTuple):
    """A height over waves on a slope, times a factor: a function of a point."""

    factor: np.ndarray
    slope: np.ndarray
    waves: np.ndarray

    def __call__(self, p):
        return self.factor * (p[2] - self.slope * p[0] - self.waves * (jnp.sin(2 * p[0]) + p[1] ** 2))


def test_a_ground_function_of_any_slope():
    """f / |grad f| is the distance. Of planes forces and their derivatives are those of HalfSpaces; of waves the step
    is the oracle's, and derivatives by coordinates are differences."""
    q, v = np.array([[0.3, 0.2, 0.41], [0.1, -0.5, 0.2], [-0.4, 0.3, -0.25]]), np.full((3, 3), [0.5, 0.2, -1.0])
    contacts, tau, dt, h = (
        spheres(["c"], np.zeros((1, 3)), 0.25, np.float64(STIFF), TAU_D, 0.5),
        np.zeros(3),
        5e-3,
        1e-6,
    )
    along = np.array([0.3, -0.5, 0.8])

    def of(q, v, ground):
        def step(q):
            found = js.convex_step(slider(), q, v, tau, dt, contacts=contacts, ground=ground)
            return found.v, found.contact_forces.f

        return jax.jvp(step, (q,), (along,))

    plane, waves = js.HalfSpace(np.tile([-1.0, 0, 1], (3, 1)), np.zeros(3)), (2.0, 0.2, 0.6)
    terrains = np.array([(1, 1, 0), (30, 1, 0), (1e-3, 1, 0), waves, waves, waves], float)
    at = np.tile(q, (6, 1, 1)) + np.array([0, 0, 0, 0, h, -h])[:, None, None] * along
    given = at.reshape((18, 3)), np.tile(v, (6, 1)), Terrain(*np.repeat(terrains, 3, 0).T)
    found = jax.tree.map(lambda x: x.reshape((6, 3, *x.shape[1:])), interpreted(jax.vmap(of))(*given))
    expected = interpreted(jax.vmap(of))(q, v, plane)
    assert (abs(expected[0][1]).max((1, 2)) > 1).all()
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        for own in a[:3]:
            np.testing.assert_allclose(own, b, rtol=0, atol=1e-10 * abs(b).max())

    (after, f), (slope, _) = found
    own = oracle.steps_of(slider(), q, v, np.zeros((3, 3)), np.full(3, dt), contacts, Terrain(*np.array(waves)))
    np.testing.assert_allclose(after[3], [x.v for x in own], rtol=0, atol=ALLOWED)
    np.testing.assert_allclose(f[3], [x.forces for x in own], rtol=0, atol=1e-6 * abs(f[3]).max())
    assert (abs(f[3]).max((1, 2)) > 1).all()
    np.testing.assert_allclose(slope[3], (after[4] - after[5]) / (2 * h), rtol=0, atol=1e-6 * abs(slope[3]).max())


def box_function(p, finite):
    """The distance from a box of 1 m, as it is mostly written; finite: with a gradient inside."""
    outside = jnp.maximum(abs(p) - 0.5, 0.0)
    square = (outside**2).sum()
    is_inside = (square == 0) & finite
    length = jnp.where(is_inside, 0.0, jnp.sqrt(jnp.where(is_inside, 1.0, square)))
    return length + jnp.minimum((abs(p) - 0.5).max(), 0.0)


@pytest.mark.parametrize(
    "ground", [lambda p: box_function(p, False), lambda p: 0 * p[2] - 0.1, lambda p: p[2] * np.inf]
)
def test_a_ground_without_a_normal_is_none_in_the_result(ground):
    """Where the gradient is zero or not finite, of values on either side; a state beside it keeps its bits."""
    q, v = np.array([[0, 0.1, 0.3], [0, 0, 0.6]]), np.zeros((2, 3))
    contacts = spheres(["c"], np.zeros((1, 3)), 0.2, np.float64(STIFF), TAU_D, 0.5)
    found = interpreted(lambda q, v: js.convex_step(slider(), q, v, v, 5e-3, contacts=contacts, ground=ground))(q, v)
    assert np.isnan(found.v[0]).any() and np.isnan(found.contact_forces.f[0]).all() and np.isnan(found.residual[0])
    whole = functools.partial(box_function, finite=True)
    expected = interpreted(lambda q, v: js.convex_step(slider(), q, v, v, 5e-3, contacts=contacts, ground=whole))(q, v)
    assert np.isfinite(expected.v).all() and (expected.contact_forces.f[:, 0, 2] > 1).all()
    if np.isfinite(found.v[1]).all():
        np.testing.assert_array_equal(found.v[1], expected.v[1])


def test_external_forces_are_generalized_forces():
    """F at a frame, or J^T F, of the same states; and neither."""
    scene, (q, v, tau) = tree(), many("tree", 6)
    mech, contacts = scene.mechanism, scene.contacts
    F = np.random.default_rng(2).standard_normal((6, 6)) * 5
    J = interpreted(lambda q: js.jacobian(mech, q, "c"))(q)

    def own(q, v, tau, F):
        force = js.AppliedForces(["c"], js.SpatialForce.from_array(F[:, None]))
        return js.convex_step(mech, q, v, tau, 5e-3, force, contacts=contacts).v

    taus, forces = (tau, tau + np.einsum("nij,ni->nj", J, F), tau), (F, 0 * F, 0 * F)
    after = interpreted(own)(np.tile(q, (3, 1)), np.tile(v, (3, 1)), np.concatenate(taus), np.concatenate(forces))
    found, expected, alone = after.reshape((3, 6, -1))
    np.testing.assert_allclose(found, expected, rtol=0, atol=ALLOWED * abs(expected).max())
    assert abs(found - alone).max() > 0.01


@pytest.mark.parametrize("precision", [slow(x) for x in ("fast", "compensated", "faithful")])
def test_every_precision_has_the_optimum(precision):
    scene, x = tree(), many("tree", 6)
    mech, contacts = scene.mechanism, scene.contacts
    found = js.convex_step(mech, *x, 5e-3, contacts=contacts, precision=precision)
    expected = step("tree", 5e-3)(*x)
    np.testing.assert_allclose(found.v, expected.v, rtol=0, atol=ALLOWED * abs(expected.v).max())
    assert found.residual.max() < 1e-8


@functools.cache
def with_mimics(floats):
    """(a mechanism, six states, its contacts, a pair, a closure): a joint that the next one follows, and a slide that
    one on another branch follows. With limits, dry friction, damping and armature."""
    rng, names = np.random.default_rng(0), "abcde"

    def placed():
        return js.RigidTransform(js.Rotation.exp(rng.standard_normal(3) / 2), 0.3 * rng.standard_normal(3))

    ball = js.SpatialInertia.solid_ellipsoid(np.array([0.1, 0.05, 0.2]), mass=np.float64(1))
    bodies = [js.Body(x, ball.shift(0.1 * rng.standard_normal(3))) for x in names]
    limits, resistance = {"lower": -0.2, "upper": 0.3}, {"damping": 0.1, "armature": 0.02}
    joints = [
        js.Joint("root", *("free" if floats else "fixed", "world", "a")),
        js.Joint("j", "revolute", "a", "b", placed(), axis=(0, 1, 0), **limits, **resistance),
        js.Joint("k", "revolute", "b", "c", placed(), axis=(0, 0.6, 0.8), mimic=("j", -1.5, 0.1), **resistance),
        js.Joint("s", "prismatic", "c", "d", placed(), axis=(1, 0, 0), friction_loss=0.5),
        js.Joint("t", "prismatic", "a", "e", placed(), axis=(0, 0, 1), mimic=("s", 0.7)),
    ]
    mech, n = js.Mechanism.build(bodies, joints, dtype=np.float64), 6
    q, (v, tau) = rng.standard_normal((n, mech.nq)), rng.standard_normal((2, n, mech.nv))
    if floats:
        q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
        q[:, 4:7] *= 0.1
    q[:, -2:] = [0.25, 0.05] + 0.02 * q[:, -2:]
    names = tuple(names if floats else names[1:])
    contacts = spheres(names, 0.2 * rng.standard_normal((len(names), 3)), 0.05 if floats else 0.6, 1e4, 0.01, 0.5)
    pair = tuple(spheres([x], 0.1 * rng.standard_normal((1, 3)), 0.5, 1e4, 0.01, 0.5) for x in "ce")
    return mech, (q, v, tau), contacts, pair, [js.LoopClosure("d", "e", "distance", 0.6)]


@pytest.mark.parametrize("floats", [False, slow(True)])
def test_mimics(floats):
    """As the oracle, whose mass matrix and Jacobians are of the joints that are followed."""
    mech, x, contacts, pair, loops = with_mimics(floats)
    terms, dt = {"pairs": pair, "loops": loops}, 5e-3

    def step(mech, *x):
        return js.convex_step(mech, *x, dt, contacts=contacts, **terms)

    found = interpreted(functools.partial(step, mech))(*x)
    if floats:
        # Whether the root has damping is not known then.
        np.testing.assert_allclose(interpreted(step)(mech, *x).v, found.v, rtol=0, atol=1e-9)
    expected = oracle.steps_of(mech, *x, dt, contacts, **terms)
    for i, own in enumerate(expected):
        after = oracle.in_world(mech, found.q[i]) @ found.v[i]
        np.testing.assert_allclose(after, own.v, rtol=0, atol=ALLOWED * abs(own.v).max(), err_msg=f"{i}")
        allowed = 1e-6 * max(abs(own.forces).max(), 1)
        np.testing.assert_allclose(found.contact_forces.f[i], own.forces, rtol=0, atol=allowed, err_msg=f"{i}")
    assert found.residual.max() < 1e-6 and found.iterations.max() < 30
    assert np.mean([len(own.result.impulses) for own in expected]) > 3


def pendulum(second):
    """A double one on the world: its second joint, and contacts of both links."""
    rod = js.SpatialInertia.solid_ellipsoid(np.array([0.1, 0.05, 0.3]), mass=np.float64(1)).shift(np.array([0, 0, 0.3]))
    below = js.RigidTransform(js.Rotation.identity(), np.array([0, 0.1, -0.6]))
    first = js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0), friction_loss=0.1, upper=0.31)
    joints = [first, js.Joint("k", parent="a", child="b", placement=below, axis=(1, 0, 0), **second)]
    contacts = spheres(["a", "b"], np.array([[0, 0, -0.6], [0.1, 0, -0.2]]), 0.7, 1e3, 0.01, 0.5)
    return js.Mechanism.build([js.Body("a", rod), js.Body("b", rod)], joints, dtype=np.float64), contacts


def test_a_mimic_that_stands_still_is_welded():
    """Of a multiplier 0: the step of the mechanism in which it is fixed, of which other programs are made."""
    x = np.array([[0.3], [-0.5]]), np.array([[2.0], [-1.0]]), np.zeros((2, 1))

    def step(second):
        mech, contacts = pendulum(second)
        return interpreted(lambda *x: js.convex_step(mech, *x, 5e-3, contacts=contacts)[1:])(*x)

    found, expected = map(step, ({"kind": "revolute", "mimic": ("j", 0.0)}, {"kind": "fixed"}))
    assert (expected[1].f[:, :, 2] > 1).all(0).any()
    np.testing.assert_allclose(found[0], expected[0], rtol=0, atol=ALLOWED)
    np.testing.assert_allclose(found[1].f, expected[1].f, rtol=0, atol=1e-6 * abs(expected[1].f).max())


@pytest.mark.parametrize("between", [False, slow(True)])
def test_derivatives_with_mimics(between):
    """By q, v, tau, multipliers and offsets, against differences; forward and reverse agree."""
    if between:
        mech, x, contacts, pair, loops = with_mimics(False)
        terms, at = {"contacts": contacts, "pairs": pair, "loops": loops}, [y[0] for y in x]
    else:
        mech, contacts = pendulum({"kind": "revolute", "mimic": ("j", 0.7)})
        terms, at = {"contacts": contacts}, [np.array([0.2]), np.array([1.0]), np.array([0.5])]
    rng, h, n = np.random.default_rng(1), 1e-6, mech.nv
    at = *at, mech.mimics
    along = tuple(rng.standard_normal(y.shape) for y in at)

    def after(q, v, tau, mimics):
        return js.convex_step(mech.replace(mimics=mimics), q, v, tau, 5e-3, **terms).v

    c, near = rng.standard_normal(n), [jax.tree.map(lambda y, d, s=s: y + s * d, at, along) for s in (0, h, -h)]

    def derivatives(*y):
        value, tangent = jax.jvp(after, y, along)
        return value, tangent, jax.vjp(after, *y)[1](c)

    found = interpreted(jax.vmap(derivatives))(*(np.stack(y) for y in zip(*near, strict=True)))
    (_, ahead, behind), tangent, pulled = found[0], found[1][0], [y[0] for y in found[2]]
    difference = (ahead - behind) / (2 * h)
    np.testing.assert_allclose(tangent, difference, rtol=0, atol=1e-5 * abs(difference).max())
    inner = sum(np.vdot(a, b) for a, b in zip(pulled, along, strict=True))
    assert abs(inner - c @ tangent) <= 1e-7 * np.linalg.norm(c) * np.linalg.norm(tangent)


LOOPS = {
    "ball": [js.LoopClosure("b", "d", "ball")],
    "to the world": [js.LoopClosure("world", "c", "universal"), js.LoopClosure("b", "d", "distance", 0.4)],
    "redundant": [js.LoopClosure("c", "d", "distance", 0.5)] * 2,
    "pairs": [],
    "pairs and a ball": [js.LoopClosure("b", "d", "ball")],
}


@functools.cache
def pairs():
    """Spheres between bodies of the tree: most of them inside each other."""
    law = {"relaxation_time": np.array([0.01, 0.0, 0.05]), "friction": np.array([0.5, 0.2, 0.9])}
    at = np.array([[0.1, 0, 0.05], [0, 0.1, 0], [0, 0, 0.2]])
    radii, stiffness = np.array([[0.2, 0.1, 0.3], [0.2, 0.2, 0.2]]), np.array([[1e3, 1e4, 1e5], [1e4, 1e4, 3e4]])
    both = (("a", "b", "d"), at), (("c", "d", "b"), -at)
    return tuple(js.PointContacts(*x, r, stiffness=k, **law) for x, r, k in zip(both, radii, stiffness, strict=True))


@pytest.mark.parametrize("name", slow_but(["pairs and a ball"], list(LOOPS)))
def test_terms_between_two_bodies(name):
    """Loop closures, and spheres on two bodies, beside all other terms of the tree: closures open by some 1e-2."""
    scene, (q, v, tau), dt = tree(), many("tree", 12), 5e-3
    loops, touching, mech = LOOPS[name], pairs() if "pairs" in name else None, scene.mechanism
    step = interpreted(lambda *x: js.convex_step(mech, *x, dt, contacts=scene.contacts, pairs=touching, loops=loops))
    with jax.enable_x64(True):
        q = np.array(interpreted(lambda q: js.close_loops(mech, q, loops).q)(q)) + 1e-3
        q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    found = step(q, v, tau)
    inside, closing = 0, interpreted(lambda q: js.constraint_jacobian(mech, q, loops))(q) if loops else None
    relative = list(_relative(mech, q, loops))
    expected = oracle.steps_of(mech, q, v, tau, dt, scene.contacts, pairs=touching, loops=loops)
    for i, own in enumerate(expected):
        after = oracle.in_world(mech, found.q[i]) @ found.v[i]
        size = max(abs(own.v).max(), abs(v[i]).max(), G * dt)
        # Where a closure and a limit push against each other, momenta have the rounding errors of their impulses.
        rounding = 1e4 * U * max((abs(x).max() for x in own.result.impulses), default=0)
        np.testing.assert_allclose(after, own.v, rtol=0, atol=ALLOWED * size + rounding / LIGHTEST, err_msg=f"{i}")
        allowed = 1e-6 * max(abs(own.forces).max(), 1) + rounding / dt
        np.testing.assert_allclose(found.contact_forces.f[i], own.forces, rtol=0, atol=allowed, err_msg=f"{i}")
        inside += np.count_nonzero(own.forces[5:].any(1))
        if loops:
            multipliers = np.concatenate(own.result.impulses[-len(loops) :]) / dt
            wrenches = found.loop_wrenches.to_array()[i]
            pushed = sum(J[i].T @ F for J, F in zip(relative, wrenches, strict=True))
            np.testing.assert_allclose(pushed, closing[i].T @ multipliers, rtol=0, atol=1e-6 * abs(multipliers).max())
    assert found.residual.max() < 1e-6
    assert inside > 5 or touching is None


@functools.cache
def pendulums():
    """Two on the world, the second of two links."""
    rod = js.SpatialInertia.solid_ellipsoid(np.array([0.1, 0.05, 0.3]), mass=np.float64(1)).shift(np.array([0, 0, 0.3]))
    aside, below = (js.RigidTransform(js.Rotation.identity(), np.array(p)) for p in ([0.3, 0, 0], [0, 0, -0.6]))
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0)),
        js.Joint("k", "revolute", "world", "b", aside, axis=(0, 1, 0)),
        js.Joint("l", "revolute", "b", "c", below, axis=(0, 0.6, 0.8)),
    ]
    return js.Mechanism.build([js.Body(name, rod) for name in "abc"], joints, dtype=np.float64)


def test_a_closure_that_nothing_can_move_does_nothing():
    """The origin of c is on the axis of its joint to b: no number of the result is made of rounding errors."""
    mech, q, v, tau = pendulums(), np.array([0.3, -0.2, 0.5]), np.array([1.0, -2, 0.5]), np.zeros(3)
    loops = [js.LoopClosure("b", "c", "ball"), js.LoopClosure("a", "c", "distance", 0.7)]
    found, expected = (
        interpreted(lambda x=x: js.convex_step(mech, q, v, tau, 5e-3, loops=x))() for x in (loops, loops[1:])
    )
    np.testing.assert_allclose(found.v, expected.v, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.loop_wrenches.f[1:], expected.loop_wrenches.f, rtol=1e-5)


def _relative(mech, q, loops):
    """Jacobians (n, 6, nv) of the motion of B about its origin, less that of the point of A that is there."""
    for loop in loops:
        frames = loop.frame_a, loop.frame_b
        p = interpreted(lambda q, frames=frames: js.forward_kinematics(mech, q, frames).translation)(q)
        J = interpreted(lambda q, frames=frames: js.jacobian(mech, q, frames))(q)
        difference, p = J[:, 1] - J[:, 0], p[:, 1] - p[:, 0]
        difference[:, 3:] += np.cross(p[..., None], J[:, 0, :3], axis=1)
        yield difference


@pytest.mark.parametrize("with_mimic", [False, slow(True)])
def test_a_contact_that_nothing_can_move_does_nothing(with_mimic):
    """A point on the axis of the only hinge that carries it: no force, and the step and its derivatives without it."""
    out = js.RigidTransform(js.Rotation.identity(), np.array([0.0, 0, 0.5]))
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0)),
        js.Joint("k", "prismatic", "a", "b", out, axis=(1, 0, 0)),
    ]
    joints += [js.Joint("l", "revolute", "b", "c", out, mimic=("k", 0.5))] if with_mimic else []
    ball = js.SpatialInertia.solid_sphere(np.float64(0.2), mass=np.float64(2)).shift(np.array([0.1, 0, 0.3]))
    mech = js.Mechanism.build([js.Body(x, ball) for x in "abc"[: len(joints)]], joints, dtype=np.float64)
    held = spheres(["a"], np.zeros((1, 3)), 0.0, np.float64(STIFF), TAU_D, 0.5)

    def after(contacts, q, v):
        found = js.convex_step(mech, q, v, np.array([0.1, 0.1]), 1e-2, contacts=contacts)
        return found[:2], found.contact_forces

    at = np.array([0.2, 0.1]), np.array([0.5, -0.3])
    whole = interpreted(lambda q, v: (after(held, q, v), jax.jacobian(functools.partial(after, held), (0, 1))(q, v)))
    (found, forces), (slopes, of_forces) = whole(*at)
    without = interpreted(lambda q, v: (after(None, q, v), jax.jacobian(functools.partial(after, None), (0, 1))(q, v)))
    (expected, _), (expected_slopes, _) = without(*at)
    for x in jax.tree.leaves((forces, of_forces)):
        np.testing.assert_array_equal(x, 0)
    for x, y in zip(jax.tree.leaves((found, slopes)), jax.tree.leaves((expected, expected_slopes)), strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-12)


def test_limits_on_joints_of_several_coordinates_are_no_terms():
    body = js.Body("a", js.SpatialInertia.solid_ellipsoid(np.array([0.2, 0.3, 0.1]), mass=np.float64(2)))
    mech = js.Mechanism.build([body], [js.Joint("j", "planar", "world", "a")], dtype=np.float64)
    mech = mech.replace(lower=np.full(3, -0.1), upper=np.full(3, 0.1))
    q, v, tau = np.full(3, 0.2), np.ones(3), np.ones(3)
    found, expected = js.convex_step(mech, q, v, tau, 1e-2), js.semi_implicit_step(mech, q, v, tau, 1e-2)
    np.testing.assert_array_equal(found.q, expected[0])
    np.testing.assert_array_equal(found.v, expected[1])


def on(*frames):
    return js.PointContacts(frames, stiffness=np.float64(1e4), relaxation_time=np.float64(0), friction=np.float64(1))


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"contacts": on("world")}, ValueError, "contacts: expected frames of moving bodies, got 'world'"),
        ({"contacts": 3.0}, TypeError, "contacts: expected PointContacts, got"),
        (
            {"pairs": on("a")},
            TypeError,
            r"pairs: expected \(a, b\), two PointContacts, or ShapeContacts and PointContacts, got",
        ),
        ({"pairs": (on("a"), on("b", "c"))}, ValueError, "pairs: expected as many of one as of the other, got 1 and 2"),
        ({"pairs": (on("a"), on("a"))}, ValueError, "pairs: expected frames of two bodies, got 'a' and 'a', of one"),
        ({"loops": [js.LoopClosure("a", "nowhere", "ball")]}, KeyError, "loops: expected one of"),
        ({"ground": 3.0, "contacts": on("a")}, TypeError, "ground: expected a HalfSpace, or a function"),
        ({"ground": 3.0}, TypeError, "ground: expected a HalfSpace, or a function"),
    ],
)
def test_what_is_refused(given, error, message):
    mech, (q, v, tau) = tree().mechanism, many("tree", 1)
    with pytest.raises(error, match=f"convex_step: {message}"):
        js.convex_step(mech, q, v, tau, 5e-3, **given)
    with pytest.raises(TypeError, match="contacts"):
        js.convex_step(mech, q, v, tau, 5e-3, contacts=on("a").astype(np.float32))


# -- by hand ----------------------------------------------------------------------------------------------------------

MASS, STIFF, TAU_D = 2.0, 1e4, 0.02


def spheres(frames, positions, radius, stiffness, relaxation_time, friction):
    numbers = {"stiffness": stiffness, "relaxation_time": relaxation_time, "friction": friction}
    return js.PointContacts(frames, positions, np.asarray(radius, np.float64), **numbers)


@functools.cache
def slider():
    """A mass that moves along three axes, and does not turn."""
    mass = js.SpatialInertia.point_mass(np.zeros(3), mass=np.float64(MASS))
    bodies = [js.Body("a"), js.Body("b"), js.Body("c", mass)]
    axes = zip("xyz", ("world", "a", "b"), "abc", np.eye(3), strict=True)
    joints = [js.Joint(n, "prismatic", parent, child, axis=axis) for n, parent, child, axis in axes]
    return js.Mechanism.build(bodies, joints, dtype=np.float64)


def touching(friction, n=1, tau_d=TAU_D):
    """n points at the mass of the slider."""
    return spheres(["c"] * n, None, 0, np.float64(STIFF), np.float64(tau_d), friction)


def softness(dt, n=1):
    """(R_n, R_t) of the slider: w = |1/m 1|_F / 3."""
    return 1 / (dt * STIFF * (dt + TAU_D)), 1e-3 * np.sqrt(3) / 3 / MASS


@pytest.mark.parametrize("n", [1, 4])
def test_contacts_share_a_weight(n):
    """Depth m g / (n k): rest is a fixed point, bit for bit nearly."""
    q = np.array([0.3, 0.2, -MASS * G / (n * STIFF)])
    found = interpreted(
        lambda q: js.convex_step(slider(), q, np.zeros(3), np.zeros(3), 5e-3, contacts=touching(0.5, n))
    )(q)
    np.testing.assert_allclose(found.v, 0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.contact_forces.f, [[0, 0, MASS * G / n]] * n, rtol=1e-9, atol=1e-9)


def rolled_out(mech, q, v, dt, n, contacts=None, **terms):
    """States after each of n steps without forces of joints."""
    tau = np.zeros(mech.nv)

    def one(state, _):
        after = js.convex_step(mech, *state, tau, dt, contacts=contacts, **terms)
        return after[:2], after[:2]

    return jax.lax.scan(one, (jnp.asarray(q), jnp.asarray(v)), None, n)[1]


class Slide(NamedTuple):
    """Of a slider: its state at first, the time of a step, the law of two points at its mass, of which the second
    touches where `both` is 1, the normal of the ground and gravity."""

    q: np.ndarray
    v: np.ndarray
    dt: float
    friction: float
    relaxation_time: float = TAU_D
    both: float = 0.0
    normal: np.ndarray = np.array([0.0, 0, 1])
    gravity: np.ndarray = np.array([0, 0, -G])

    def run(self, n):
        mech = slider().replace(gravity=self.gravity)
        positions = jnp.stack([0 * self.normal, (1 - self.both) * 99 * self.normal])
        contacts = spheres(["c"] * 2, positions, 0, np.float64(STIFF), self.relaxation_time, self.friction)
        return rolled_out(mech, self.q, self.v, self.dt, n, contacts, ground=js.HalfSpace(self.normal))


def uphill(angle):
    """(down the slope, away from it)."""
    return np.array([np.cos(angle), 0, -np.sin(angle)]), np.array([np.sin(angle), 0, np.cos(angle)])


# Two contacts on inclines of 0.98 and 1.02 times the angle of friction; relaxation times of bounces.
MU, STEEPER, OF_BOUNCES = 0.6, (0.98, 1.02), (0.0, 2e-3)


def sliding():
    """(on an incline, its angle, its acceleration down the slope): steady sliding from the first step on."""
    mu, dt, angle = 0.3, 1e-3, 0.6
    down, normal = uphill(angle)
    faster = G * (np.sin(angle) - mu * np.cos(angle))
    rises, speed = (dt + TAU_D) * mu * faster, 0.1
    R_n, R_t = softness(dt)
    impulse = MASS * G * np.cos(angle) * dt
    depth = (dt + TAU_D) * ((R_n + mu**2 * R_t) * impulse + rises - mu * (speed + faster * dt))
    return Slide(-depth * normal, speed * down + rises * normal, dt, mu, normal=normal), angle, faster


@functools.cache
def slides():
    """(q, v) after each step of those that hold or slide, 200, and of those that bounce, 5000: in one program."""
    inclines = []
    for steeper in STEEPER:
        angle = np.arctan(MU) * steeper
        normal = uphill(angle)[1]
        q = -normal * MASS * G * np.cos(angle) / (2 * STIFF)
        inclines.append(Slide(q, np.zeros(3), 5e-3, MU, both=1.0, normal=normal))
    bounces = [Slide(np.zeros(3), np.array([0, 0, -1.0]), 1e-5, 0.0, x, gravity=np.zeros(3)) for x in OF_BOUNCES]
    cases = jax.tree.map(lambda *x: jnp.stack([jnp.asarray(y, float) for y in x]), *inclines, sliding()[0], *bounces)
    q, v = jax.jit(jax.vmap(lambda x: x.run(5000)))(cases)
    return np.asarray(q), np.asarray(v)


@pytest.mark.parametrize("steeper", STEEPER)
def test_an_incline_holds_up_to_its_angle_of_friction(steeper):
    """Below, a block creeps at R_t m g sin / n, the regularisation of sticking; above it slides away."""
    dt, n, angle = 5e-3, 2, np.arctan(MU) * steeper
    down, v = uphill(angle)[0], slides()[1][STEEPER.index(steeper), 199]
    creep = softness(dt)[1] * MASS * G * np.sin(angle) * dt / n
    if steeper < 1:
        np.testing.assert_allclose(v, creep * down, rtol=0, atol=1e-9)
    else:
        assert v @ down > 0.5 * 200 * dt * G * (np.sin(angle) - MU * np.cos(angle)) > 20 * creep


def test_sliding_down_an_incline():
    """Steadily g (sin - mu cos), while the convex problem lifts the block at (dt + tau_d) mu times that."""
    start, angle, faster = sliding()
    (down, normal), (q, v) = uphill(angle), (x[len(STEEPER), :20] for x in slides())
    np.testing.assert_allclose(v @ down, start.v @ down + faster * start.dt * np.arange(1, 21), rtol=1e-8)
    np.testing.assert_allclose(v @ normal, (start.dt + TAU_D) * start.friction * faster, rtol=1e-6)
    assert (q @ normal < 0).all()


def test_a_bounce_in_one_step():
    """(m + dt k (dt + tau_d)) v+ = m v* - dt k phi, or v+ = v* where the ground would pull."""
    dt, depths = 5e-3, np.array([1e-3, 5e-3, 1e-2, 1e-3])
    v = np.array([[0, 0, -1.0], [0, 0, 0.0], [0, 0, 0.3], [0, 0, 3.0]])
    q = np.stack([0 * depths, 0 * depths, -depths], 1)
    found = interpreted(lambda *x: js.convex_step(slider(), *x, np.zeros(3), dt, contacts=touching(0.5)))(q, v)
    free = v[:, 2] - G * dt
    memory = dt + TAU_D
    expected = np.maximum((MASS * free + dt * STIFF * depths) / (MASS + dt * STIFF * memory), free)
    np.testing.assert_allclose(found.v[:, 2], expected, rtol=1e-9, atol=1e-12)
    assert expected[3] == free[3] and (found.contact_forces.f[3] == 0).all()


@pytest.mark.parametrize("tau_d", OF_BOUNCES)
def test_restitution(tau_d):
    """Of short steps: exp(-(b / om) (pi - atan2(2 b om, om^2 - b^2))), b = k tau_d / 2 m. [Schwager, Poeschel 2007]"""
    v = slides()[1][len(STEEPER) + 1 + OF_BOUNCES.index(tau_d), -1]
    b = STIFF * tau_d / (2 * MASS)
    om = np.sqrt(STIFF / MASS - b**2)
    expected = np.exp(-b / om * (np.pi - np.arctan2(2 * b * om, om**2 - b**2)))
    np.testing.assert_allclose(v, [0, 0, expected], rtol=0, atol=2e-3)


def _momenta(mech, q, *steps):
    """The momenta (m, 6) about the centre of mass after steps from q, whose velocities are along axes that turn."""
    found = []
    for x in steps:
        old, new = ([oracle.in_world(mech, y) for y in z] for z in (q, x.q))
        after = np.array([a.T @ b @ v for a, b, v in zip(old, new, x.v, strict=True)])
        found.append(interpreted(lambda *y: js.centroidal_momentum(mech, *y).to_array())(q, after))
    return found


def test_impulses_move_momentum_and_oppose_slip():
    """A free body's momenta change by exactly the impulses; none of these pulls, none is outside of its cone."""
    scene, (q, v, _), dt = scenes.box(), many("box", 40), 5e-3
    mech = scene.mechanism.replace(gravity=np.zeros(3))
    still = np.zeros(mech.nv)
    found = interpreted(lambda *x: js.convex_step(mech, *x, still, dt, contacts=scene.contacts))(q, v)
    free = interpreted(lambda *x: js.convex_step(mech, *x, still, dt))(q, v)
    centers = interpreted(lambda q: js.forward_kinematics(mech, q, scene.frames) @ scene.positions)(q)
    points, f = centers * [1, 1, 0], np.asarray(found.contact_forces.f)
    after, without = _momenta(mech, q, found, free)
    change = after - without
    arms = points - interpreted(lambda q: js.center_of_mass(mech, q))(q)[:, None]
    size = abs(dt * f).max()
    np.testing.assert_allclose(change[:, 3:], dt * f.sum(1), rtol=0, atol=1e-7 * size)
    np.testing.assert_allclose(change[:, :3], dt * np.cross(arms, f).sum(1), rtol=0, atol=1e-7 * size)
    tangential = np.linalg.norm(f[..., :2], axis=-1)
    assert (f[..., 2] >= 0).all() and (tangential <= scene.friction * f[..., 2] + 1e-9 * abs(f).max()).all()
    assert (f[..., 2] > 0).sum() > 20


def free_spheres(*masses):
    """Free spheres of 0.1 m, each with spheres of contact at its centre."""
    names = [f"s{i}" for i in range(len(masses))]
    inertias = [js.SpatialInertia.solid_sphere(np.float64(0.1), mass=np.float64(m)) for m in masses]
    joints = [js.Joint(f"j{name}", "free", "world", name) for name in names]
    return js.Mechanism.build(list(map(js.Body, names, inertias)), joints, dtype=np.float64)


def test_a_stack_carries_its_weight():
    """Of three spheres: the ground carries all, each sphere what is above it. They lie as deep as these forces need,
    between two of them at half of the stiffness, and stay there."""
    masses = np.array([1.0, 2, 0.5])
    mech, weights = free_spheres(*masses), G * np.cumsum(masses[::-1])[::-1]
    q, r = np.zeros((3, 7)), 0.1
    q[:, 0] = 1
    q[:, 6] = np.cumsum([r, 2 * r, 2 * r] - weights / STIFF / [1, 0.5, 0.5])
    on_ground, lower, upper = (spheres(x, None, r, STIFF, TAU_D, 0.5) for x in (["s0"], ["s0", "s1"], ["s1", "s2"]))

    def own(q):
        still = np.zeros(18)
        return js.convex_step(mech, q, still, still, 5e-3, contacts=on_ground, pairs=(lower, upper))

    found = interpreted(own)(q.ravel())
    np.testing.assert_allclose(found.v, 0, rtol=0, atol=1e-10)
    expected = weights[:, None] * [0, 0, 1]
    np.testing.assert_allclose(found.contact_forces.f, expected, rtol=0, atol=1e-8 * weights[0])


def test_spheres_with_one_centre_are_pushed_along_z():
    """As on a plane with this normal, derivatives too. Centres that are apart at all have their own normal."""
    mech, n, zero = free_spheres(1.0, 3.0), 4, np.zeros(12)
    q, v = np.zeros((n, 14)), np.zeros((n, 12))
    q[:, [0, 7]] = 1
    q[:, 4:7] = q[:, 11:] = 0.3, -0.2, 0.5
    q[1:3, 11:] = 0
    q[1:3, 4:7] = [[0, 5e-324, 0], [1e-200, 0, 0]]
    q[3, 13] += 1e-9
    v[:, 9:] = 0.1, 0.2, -0.3
    pair = tuple(spheres([name], None, 0.1, STIFF, TAU_D, 0.5) for name in ("s0", "s1"))

    def step(q, v):
        return js.convex_step(mech, q, v, zero, 5e-3, pairs=pair).v

    after, by_q = interpreted(jax.vmap(lambda q, v: (step(q, v), jax.jacrev(step)(q, v))))(q, v)
    assert np.isfinite(after).all() and np.isfinite(by_q).all()
    # Impulses along and across z: the sphere of b goes up.
    assert (after[[0, 3], 11] > 0.3).all() and after[2, 9] < -0.3
    np.testing.assert_allclose(after[[0, 1]], after[[3, 3]], rtol=0, atol=1e-6)
    # By z of the other's centre as where they are apart; by x and y they do not turn the normal.
    np.testing.assert_allclose(by_q[0, :, [6, 13]], by_q[3, :, [6, 13]], rtol=0, atol=1e-6)
    np.testing.assert_allclose(by_q[0][:, [4, 5, 11, 12]], 0, rtol=0, atol=1e-9)


def test_a_pair_of_free_bodies_keeps_its_momentum():
    """Linear and angular, while the two hit, slip and turn each other."""
    mech, rng, n = free_spheres(1.0, 3.0).replace(gravity=np.zeros(3)), np.random.default_rng(11), 12
    q, v = rng.standard_normal((n, 2, 7)), 2 * rng.standard_normal((n, 12))
    q[..., :4] /= np.linalg.norm(q[..., :4], axis=-1, keepdims=True)
    aside = rng.standard_normal((n, 3))
    q[:, 1, 4:] = q[:, 0, 4:] + 0.195 * aside / np.linalg.norm(aside, axis=1, keepdims=True)
    q = q.reshape((n, 14))
    pair = tuple(spheres([name], None, 0.1, STIFF, TAU_D, 0.5) for name in ("s0", "s1"))
    still = np.zeros(12)
    found, free = (
        interpreted(lambda *x, terms=terms: js.convex_step(mech, *x, still, 5e-3, **terms))(q, v)
        for terms in ({"pairs": pair}, {})
    )
    after, without = _momenta(mech, q, found, free)
    f = np.linalg.norm(found.contact_forces.f[:, 0], axis=-1)
    assert np.count_nonzero(f) > n / 2
    np.testing.assert_allclose(after, without, rtol=0, atol=1e-9 * f.max() * 5e-3)
    assert abs(found.v - free.v).max() > 0.1


def test_what_a_hop_takes():
    """A body on a leg that pushes off: the ground's impulses are the change of momentum and the weight's."""
    masses, dt, n = np.array([4.0, 0.5]), 2e-3, 150
    bodies = [js.Body(x, js.SpatialInertia.point_mass(np.zeros(3), mass=m)) for x, m in zip("ab", masses, strict=True)]
    joints = [
        js.Joint("height", "prismatic", "world", "a", axis=(0, 0, 1)),
        js.Joint("leg", "prismatic", "a", "b", axis=(0, 0, 1)),
    ]
    mech = js.Mechanism.build(bodies, joints, dtype=np.float64)
    foot = spheres(["b"], None, 0, 1e4, 0.01, 0.5)

    def one(state, push):
        tau = jnp.stack([0 * push, -push])
        after = js.convex_step(mech, *state, tau, dt, contacts=foot)
        return after[:2], (after.v, after.contact_forces.f[0, 2])

    # It is let down first, and kicks then: in the end it flies.
    q, v, push = np.array([0.4, -0.4]), np.array([-1.0, 0]), np.where(np.arange(n) < 80, 60.0, 150.0)
    push[110:] = 0
    v_of, f = map(np.asarray, jax.jit(lambda *x: jax.lax.scan(one, x[:2], x[2])[1])(q, v, push))
    momenta = np.cumsum(np.vstack([v, v_of]), 1) @ masses
    T = dt * n
    np.testing.assert_allclose(f.sum() * dt, momenta[-1] - momenta[0] + masses.sum() * G * T, rtol=1e-8)
    assert (f >= 0).all() and f[-1] == 0 and v_of[-1, 0] > 0.5 and (f > 0).sum() > n / 3


@pytest.mark.slow
def test_the_order_of_contacts_means_nothing():
    scene, (q, v, tau) = scenes.box(), many("box", 20)
    c = scene.contacts
    back = spheres(c.frames[::-1], c.positions[::-1], c.radius, c.stiffness, c.relaxation_time, c.friction)
    a, b = (js.convex_step(scene.mechanism, q, v, tau, 5e-3, contacts=x) for x in (c, back))
    np.testing.assert_allclose(a.v, b.v, rtol=0, atol=ALLOWED * abs(a.v).max())
    np.testing.assert_allclose(a.contact_forces.f, b.contact_forces.f[:, ::-1], rtol=0, atol=1e-4)


STEPS = np.array([1e-3, 5e-3, 2e-2])


def energies(mech, q, v, contacts=None):
    """(kinetic and potential energy, the distances of spheres from the ground) of many states."""

    def of_one(q, v):
        energy = js.kinetic_energy(mech, q, v) + js.potential_energy(mech, q)
        if contacts is None:
            return energy, jnp.zeros(0)
        X = js.forward_kinematics(mech, q, contacts.frames)
        return energy, (X @ contacts.positions)[..., 2] - contacts.radius

    return interpreted(jax.vmap(of_one))(q, v)


RADIUS, STIFF_OF_BALL = 0.1, 1e5


@functools.cache
def thrown(n):
    """(q, v) of a box thrown to the ground, at first and after each of n steps, for each of STEPS, and last of a ball
    of RADIUS thrown along it, at 1 ms a step: a box of another inertia, of whose spheres seven have no surface."""
    scene, ball = scenes.box(), js.SpatialInertia.solid_sphere(np.float64(RADIUS), mass=np.float64(1))
    q, v = np.zeros((4, 7)), np.zeros((4, 6))
    q[:3], v[:3] = [0.9, 0.3, -0.2, 0.1, 0, 0, 0.4], [1.0, -2, 0.5, 0.5, 0.3, 0]
    q[:3, :4] /= np.linalg.norm(q[0, :4])
    q[3, 0], q[3, 6], v[3, 3] = 1, RADIUS - G / STIFF_OF_BALL, 1
    c, radii = scene.contacts, np.array([RADIUS] + [-99.0] * 7)
    own = [scene.mechanism.inertias] * 3 + [jax.tree.map(lambda x: jnp.asarray(x)[None], ball)]
    given = [(x, c.positions, np.full(8, c.radius), c.stiffness, c.relaxation_time, c.friction) for x in own[:3]]
    given.append((own[3], np.zeros((8, 3)), radii, STIFF_OF_BALL, 0.002, 0.3))
    given = jax.tree.map(lambda *x: np.stack([np.asarray(y, float) for y in x]), *given)

    def run(dt, q, v, given):
        M, *of_contacts = given
        contacts = js.PointContacts(c.frames, **dict(zip(OF_CONTACTS, of_contacts, strict=True)))
        return rolled_out(scene.mechanism.replace(inertias=M), q, v, dt, n, contacts)

    after = jax.jit(jax.vmap(run))(np.append(STEPS, 1e-3), q, v, given)
    return [np.concatenate([x[:, None], y], 1) for x, y in zip((q, v), after, strict=True)]


def test_a_thrown_sphere_rolls():
    """At 5/7 of its speed, for a radius less its depth: v0 / (1 + 0.4 R^2 / h^2)."""
    R, h = RADIUS, RADIUS - G / STIFF_OF_BALL
    q, v = (x[-1, 400] for x in thrown(1000))
    R_WB = js.Rotation.from_quaternion(q[:4])
    w, linear = (np.asarray(R_WB @ x) for x in v.reshape(2, 3))
    np.testing.assert_allclose(linear, [1 / (1 + 0.4 * R**2 / h**2), 0, 0], rtol=0, atol=2e-3)
    np.testing.assert_allclose(np.cross(w, [0, 0, -h]) + linear, 0, rtol=0, atol=1e-3)
    assert abs(linear[0] - 5 / 7) < 2e-3


@pytest.mark.parametrize("n", [1000, slow(100_000)])
def test_energy_is_never_more(n):
    """Of a box thrown to the ground: kinetic, potential and elastic. In a step it rises by the elastic energy of the
    spheres that are newly found inside, at most; else it never rises. In the end the box rests."""
    q, v = (x[:3] for x in thrown(n))
    found = energies(scenes.box().mechanism, q.reshape((-1, 7)), v.reshape((-1, 6)), scenes.box().contacts)
    (energy, distance), speed = (x.reshape((3, n + 1, *x.shape[1:])) for x in found), abs(v).max(-1)
    elastic = scenes.box().stiffness * np.minimum(distance, 0) ** 2 / 2
    is_new = (distance[:, :-1] > 0) & (distance[:, 1:] <= 0)
    rise = np.diff(energy + elastic.sum(-1)) - (elastic[:, 1:] * is_new).sum(-1)
    assert rise.max() < 1e-14 * energy[:, 0].max()
    assert is_new.any((1, 2)).all()
    assert speed[1:, -1].max() < 1e-3 and energy[1:, -1].max() < 0.5 * energy[1:, 0].max()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["limits", "a pair and a closure"])
def test_limits_pairs_and_closures_add_no_energy(name):
    """A second of a fast arm that is thrown against its limits, and of pendulums that hit each other and are tied.

    Their energy is never more than at first. Limits give back what they hold after a step, some 1e-4 J."""
    if name == "limits":
        mech, terms = scenes.arm().mechanism, {}
        q, v, steps = np.array([0.1, 1.0, 0.02, 0.3]), np.array([3.0, 2, 0.5, -4]), STEPS[:2]
    else:
        mech, steps = pendulums(), STEPS
        q, v = np.array([-1.2, 0.9, 0.5]), np.array([0.5, -0.3, 0.2])
        law = {"stiffness": np.array([2e3]), "relaxation_time": np.array([0.01]), "friction": np.array([0.5])}
        pair = tuple(js.PointContacts([x], np.array([[0, 0.05, -0.3]]), np.array([0.1]), **law) for x in "ab")
        X = js.forward_kinematics(mech, q, ("a", "c")).translation
        terms = {"pairs": pair, "loops": [js.LoopClosure("a", "c", "distance", jnp.linalg.norm(X[0] - X[1]))]}
    q_of, v_of = jax.vmap(lambda dt: rolled_out(mech, q, v, dt, 1000, **terms))(steps)
    energy = np.stack([energies(mech, *x)[0] for x in zip(np.asarray(q_of), np.asarray(v_of), strict=True)])
    start = energies(mech, q[None], v[None])[0]
    assert energy.max() < start - 1e-3
    assert np.diff(energy).max() < 1e-3 or name != "limits"
    lost = start - energy[:, -1]
    assert (lost > 0.5).all() and (name != "limits" or np.ptp(lost) < 0.02 * lost.max())


@pytest.mark.parametrize("damping", [0.0, 1e-9])
def test_dry_friction_of_a_floating_body_is_along_its_axes(damping):
    """As that of `passive_forces` is, whatever else acts along them: it slides, and it sticks."""
    inertia = js.SpatialInertia.solid_box(np.array([0.3, 0.2, 0.1]), mass=np.float64(2))
    loss = np.array([0.01, 0.02, 0.03, 0.4, 0.5, 0.6])
    mech = js.Mechanism.build(
        [js.Body("a", inertia)], [js.Joint("root", "free", "world", "a", friction_loss=loss, damping=damping)],
        dtype=np.float64, gravity=np.zeros(3),
    )  # fmt: skip
    q = np.array([0.9, 0.1, 0.3, -0.2, 0, 0, 0])
    v, tau, dt = np.array([3.0, -4, 5, 1, 2, -3]), np.array([[0.0] * 6, 0.5 * loss]), 1e-3
    q[:4] /= np.linalg.norm(q[:4])
    without = mech.replace(friction_loss=np.zeros(6))
    v = np.array([v, 0 * v])
    after = interpreted(lambda v, tau: js.convex_step(mech, q, v, tau, dt))(v, tau)
    free, M = interpreted(lambda v: (js.convex_step(without, q, v, 0 * v, dt), js.mass_matrix(mech, q)))(v)
    # Axes turn within the step.
    found, free = (oracle.in_world(mech, x.q[0]) @ x.v[0] for x in (after, free))
    pushed = oracle.in_world(mech, q).T @ (found - free)
    np.testing.assert_allclose(pushed, -dt * loss * np.sign(v[0]) / np.diag(M), rtol=1e-7)
    assert abs(after.v[1]).max() < 1e-3 * (dt * tau[1] / np.diag(M)).max()


# -- transformations --------------------------------------------------------------------------------------------------


def two_bodies():
    """(a mechanism, six states, terms of all kinds): dry friction, a limit, a sphere on the ground, a pair, a loop."""
    rod = js.SpatialInertia.solid_ellipsoid(np.array([0.1, 0.05, 0.3]), mass=np.float64(1)).shift(np.array([0, 0, 0.3]))
    aside = js.RigidTransform(js.Rotation.identity(), np.array([0.3, 0, 0]))
    joints = [
        js.Joint("j", "revolute", "world", "a", axis=(0, 1, 0), friction_loss=0.2),
        js.Joint("k", "revolute", "world", "b", aside, axis=(0, 1, 0), upper=0.2),
    ]
    mech = js.Mechanism.build([js.Body(x, rod) for x in "ab"], joints, dtype=np.float64)
    rng = np.random.default_rng(4)
    x = np.array([-0.3, 0.2]) + 1e-3 * rng.standard_normal((6, 2)), *rng.standard_normal((2, 6, 2))
    pair = tuple(spheres([x], np.array([[0, 0.05, -0.3]]), 0.1, np.float64(2e3), 0.01, 0.5) for x in "ab")
    below = spheres(["a"], np.array([[0, 0, -0.2]]), 0.3, np.float64(1e3), 0.01, 0.5)
    return mech, x, {"contacts": below, "pairs": pair, "loops": [js.LoopClosure("a", "b", "ball")]}


@pytest.mark.parametrize("name", ["two bodies", slow("tree"), slow("mimics")])
def test_compiled_it_is_the_same(name):
    """As evaluated operation by operation, which is how other tests here do it: bit by bit, but for the forces."""
    if name == "tree":
        mech, x = tree().mechanism, many("tree", 6)
        call = {"contacts": tree().contacts, "pairs": pairs(), "loops": LOOPS["ball"]}
    elif name == "mimics":
        # The error of a "distance" has other last bits when compiled.
        mech, x, contacts, pair, _ = with_mimics(True)
        call = {"contacts": contacts, "pairs": pair, "loops": [js.LoopClosure("d", "e", "ball")]}
    else:
        mech, x, call = two_bodies()

    def own(q, v, tau):
        return js.convex_step(mech, q, v, tau, 5e-3, **call)

    expected, found = interpreted(own)(*x), jax.jit(jax.vmap(own))(*x)
    pushes = abs(expected.contact_forces.f).max((0, 2)) > 1
    assert pushes.all() if name == "two bodies" else pushes.sum() >= 4
    np.testing.assert_array_equal(found.q, expected.q)
    np.testing.assert_array_equal(found.v, expected.v)
    np.testing.assert_array_equal(found.iterations, expected.iterations)
    for a, b in (
        (found.contact_forces.f, expected.contact_forces.f),
        (found.loop_wrenches.f, expected.loop_wrenches.f),
    ):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * abs(b).max())


@pytest.mark.slow
def test_however_it_is_called():
    """Compiled, batched by axes and by vmap, one by one: states do not see each other."""
    x = many("tree", 6)
    scene = tree()

    def own(q, v, tau):
        return js.convex_step(scene.mechanism, q, v, tau, 5e-3, contacts=scene.contacts)

    expected = step("tree", 5e-3)(*x)
    calls = {
        "jit of vmap": jax.jit(jax.vmap(own))(*x),
        "eager": own(*x),
        "(2, 3)": jax.tree.map(lambda y: y.reshape((6, *y.shape[2:])), own(*(y.reshape((2, 3, -1)) for y in x))),
        "scan": jax.lax.scan(lambda _, item: (None, own(*item)), None, tuple(map(jnp.asarray, x)))[1],
    }
    for how, found in calls.items():
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            np.testing.assert_array_equal(a, b, err_msg=how)


@pytest.mark.slow
def test_inside_of_other_transformations():
    """Of checkpoint and cond: the bits, and gradients, of the step alone."""
    scene, x = scenes.box(), [jnp.asarray(x[0]) for x in many("box", 1)]

    def own(q, v, tau):
        return js.convex_step(scene.mechanism, q, v, tau, 5e-3, contacts=scene.contacts).v

    def chosen(q, v, tau):
        return jax.lax.cond(q[6] < 9, own, lambda q, v, tau: v, q, v, tau)

    def gradient(function):
        return jax.jit(jax.grad(lambda *x: function(*x).sum(), 1))(*x)

    expected = jax.jit(own)(*x)
    for function in (jax.checkpoint(own), chosen):
        np.testing.assert_array_equal(jax.jit(function)(*x), expected)
        np.testing.assert_allclose(gradient(function), gradient(own), rtol=1e-9)


@pytest.mark.slow
def test_a_batch_of_contacts():
    scene, (q, v, tau) = scenes.box(), many("box", 4)

    def stepped(q, v, tau, friction):
        contacts = spheres(scene.frames, scene.positions, 0.02, np.float64(1e4), np.float64(0.02), friction)
        return js.convex_step(scene.mechanism, q, v, tau, 5e-3, contacts=contacts)

    friction = np.repeat(np.linspace(0, 1, 4)[:, None], 8, 1)
    found = stepped(q, v, tau, friction)
    for i in range(4):
        np.testing.assert_allclose(found.v[i], stepped(q[i], v[i], tau[i], friction[i]).v, rtol=0, atol=1e-12)


def test_float32():
    """Its own dtype throughout, and near what float64 has: nine of ten states to 1e-4 of the largest velocity.
    Depths are known to a rounding of positions, and so is whether a sphere touches."""
    x = many("tree", 40)
    expected = step("tree", 5e-3)(*x)
    found = step("tree", 5e-3, "float32")(*(y.astype(np.float32) for y in x))
    assert {y.dtype.name for y in jax.tree.leaves(found)} == {"float32", "int32"}
    error = abs(np.asarray(found.v, float) - np.asarray(expected.v)).max(1) / abs(np.asarray(expected.v)).max(1)
    assert np.median(error) < 1e-5 and np.quantile(error, 0.9) < 1e-4 and error.max() < 1e-2
    assert found.iterations.max() < 40


@pytest.mark.parametrize("dtype", ["float16", slow("bfloat16")])
def test_16_bits(dtype):
    """Their own dtype throughout, and what float32 makes of the same numbers, rounded once, with terms of all kinds; by
    hand, on the ground, whose function sees the dtype, and in the air."""
    u = float(jnp.finfo(dtype).eps) / 2
    narrow = jax.tree.map(lambda x: jnp.asarray(x).astype(dtype), two_bodies())
    wide = jax.tree.map(lambda x: x.astype(np.float32), narrow)

    def step(given):
        mech, x, terms = given
        return js.convex_step(mech, *x, jnp.asarray(2.0**-7, x[0].dtype), **terms)

    found, expected = interpreted(step)(narrow), interpreted(step)(wide)
    assert {y.dtype.name for y in jax.tree.leaves(found)} == {dtype, "int32"}
    assert (found.iterations > 0).all() and (abs(found.contact_forces.f.astype(float)).max((0, 2)) > 1).all()
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        with np.errstate(over="ignore"):
            np.testing.assert_array_equal(a, b.astype(a.dtype))

    mass, q = slider().astype(dtype), jnp.zeros((2, 3), dtype).at[:, 2].set(jnp.asarray([-0.002, 1.0], dtype))
    still, dt, contacts = jnp.zeros((2, 3), dtype), jnp.asarray(0.01, dtype), touching(0.5).astype(dtype)

    def on(ground):
        return interpreted(
            lambda q: js.convex_step(mass, q, still, still, dt, contacts=contacts, ground=ground).contact_forces.f
        )(q)[:, 0].astype(float)

    f = (STIFF * 0.002 - STIFF * (0.01 + TAU_D) * -G * 0.01) / (1 + 0.01 * STIFF * (0.01 + TAU_D) / MASS)
    for ground in (None, lambda p: p[2] * jnp.asarray(3, dtype)):
        np.testing.assert_allclose(on(ground), [[0, 0, f], [0, 0, 0]], rtol=0, atol=16 * u * f)


def test_what_sticks_takes_one_iteration():
    """A box that lies on the ground, and one that is set down on it; one that slides takes more."""
    n, rng = 12, np.random.default_rng(3)
    q, v = np.zeros((n, 7)), np.zeros((n, 6))
    q[:, 0] = 1
    # Four spheres are inside, at 0.2 m below the centre.
    q[:, 6] = 0.2 + 0.02 - rng.uniform(1e-4, 2e-3, n)
    v[:4], v[4:8, 5], v[8:, 3] = 0, -0.1, 2
    found = step("box", 5e-3)(q, v, np.zeros((n, 6)))
    np.testing.assert_array_equal(found.iterations[:8], 1)
    assert found.iterations[8:].min() > 1
    assert found.residual.max() < 1e-10


def test_no_number_in_none_out():
    """In the state that has it, whichever number that is and whether its term acts or not, and no endless loop."""
    x, others = [np.stack([y] * 4) for y in many("tree", 6)], np.arange(6) != 2
    for k in range(3):
        x[k][k, 2, -1] = np.nan
    found = step("tree", 5e-3)(*x)
    for k in range(3):
        assert np.isnan(found.v[k, 2]).any() and np.isnan(found.residual[k, 2])
        np.testing.assert_array_equal(found.v[k, others], found.v[3, others])
    assert np.isfinite(found.v[3]).all()
    # Nothing acts on a box in flight.
    q, v, tau = many("box", 1)
    q[0, 6], v[0, 0] = 5, np.nan
    found = step("box", 5e-3)(q, v, tau)
    assert np.isnan(found.v).any() and np.isnan(found.residual)


OF_MECHANISM = "lower", "upper", "damping", "friction_loss"
OF_CONTACTS = "positions", "radius", "stiffness", "relaxation_time", "friction"


@functools.cache
def with_all_numbers():
    """(a step of the tree that takes all numbers but those of the state as an argument, these numbers for one state).

    There is one pair, and one closure."""
    scene, (a, b) = tree(), pairs()
    mech, c = scene.mechanism, scene.contacts
    a, b = (js.PointContacts(x.frames[:1], **{k: getattr(x, k)[:1] for k in OF_CONTACTS}) for x in (a, b))
    numbers = {k: getattr(mech, k) for k in OF_MECHANISM} | {f"b.{k}": getattr(b, k) for k in OF_CONTACTS}
    numbers |= {f"c.{k}": getattr(c, k) for k in OF_CONTACTS} | {"c.radius": np.full(5, c.radius)}
    numbers |= {"dt": 5e-3, "normal": np.array([0.0, 0, 1]), "offset": 0.0, "distance": 0.5}

    def own(q, v, tau, given, mech=mech, external_forces=None):
        spheres_b, spheres_c = (
            js.PointContacts(x.frames, **{k: given[f"{name}.{k}"] for k in OF_CONTACTS})
            for name, x in (("b", b), ("c", c))
        )
        terms = {
            "contacts": spheres_c,
            "pairs": (a, spheres_b),
            "loops": [js.LoopClosure("c", "d", "distance", given["distance"])],
            "ground": js.HalfSpace(given["normal"], given["offset"]),
        }
        own = mech.replace(**{k: given[k] for k in OF_MECHANISM})
        return js.convex_step(own, q, v, tau, given["dt"], external_forces, **terms)

    return own, jax.tree.map(lambda x: np.asarray(x, float), numbers)


def test_no_number_of_a_term_in_none_out():
    """Every second state has NaN in one of the numbers that are no state. The others keep their bits. Of the second
    half, from a height of 5 m, no sphere touches the ground."""
    own, numbers = with_all_numbers()
    names = [*numbers] * 2
    n = 2 * len(names)
    q, v, tau = (np.repeat(x, n, 0) for x in many("tree", 1))
    q[n // 2 :, 6] += 5
    clean = jax.tree.map(lambda x: np.repeat(x[None], n, 0), numbers)
    broken = jax.tree.map(np.copy, clean)
    for i, name in enumerate(names):
        broken[name][(2 * i, *[-1] * (broken[name].ndim - 1))] = np.nan
    run = interpreted(jax.vmap(own))
    expected, found = run(q, v, tau, clean), run(q, v, tau, broken)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_array_equal(a[1::2], b[1::2])
    for i, name in enumerate(names):
        is_none = [np.isnan(x).any() for x in (found.v[2 * i], found.contact_forces.f[2 * i], found.residual[2 * i])]
        assert all(is_none), (name, i, is_none)


# -- hostile ----------------------------------------------------------------------------------------------------------


class Hostile(NamedTuple):
    """A mechanism, terms of the step that are the same for all states, and numbers of states: q, v, tau, dt and the
    stiffness, relaxation time and friction of its spheres."""

    mechanism: js.Mechanism
    positions: np.ndarray
    terms: dict
    states: tuple

    def step(self, q, v, tau, dt, k, tau_d, mu):
        law = {"stiffness": k, "relaxation_time": tau_d, "friction": mu}
        contacts = js.PointContacts(("a", "b", "c") * 2, self.positions, np.asarray(0.05, q.dtype), **law)
        return js.convex_step(self.mechanism, q, v, tau, dt, contacts=contacts, **self.terms)

    def astype(self, dtype):
        return Hostile(*jax.tree.map(lambda x: x.astype(dtype) if hasattr(x, "astype") else dtype.type(x), tuple(self)))


def hostile(kind, n):
    """No friction and much, stiffness from 1 to 1e12, masses of 1e-3 and 1e3, steps from 1e-5 to 0.1, deep inside,
    every contact twice. "joints": limits and dry friction too. "between": these, spheres on two bodies, and a closure
    twice, open by some 0.3 m."""
    rng = np.random.default_rng(5)
    light, heavy = (js.SpatialInertia.solid_sphere(np.float64(0.2), mass=np.float64(m)) for m in (1e-3, 1e3))
    out = js.RigidTransform(js.Rotation.identity(), np.array([0.3, 0.1, 0.2]))
    more = {} if kind == "contacts" else {"lower": -0.5, "upper": 0.5, "friction_loss": 1.0}
    joints = [
        js.Joint("root", "free", "world", "a"),
        js.Joint("j", "revolute", "a", "b", out, axis=(0, 1, 0), **more),
        js.Joint("k", "revolute", "b", "c", out, axis=(1, 0, 0), **more),
    ]
    bodies = [js.Body("a", light), js.Body("b", heavy), js.Body("c", light)]
    mech = js.Mechanism.build(bodies, joints, dtype=np.float64)
    positions, terms = np.tile(rng.normal(size=(3, 3)) / 5, (2, 1)), {}
    if kind == "between":
        pair = tuple(spheres([x], np.array([[0.05, 0, 0.02]]), 0.3, np.float64(1e5), 0.01, 0.5) for x in "ac")
        terms = {"pairs": pair, "loops": [js.LoopClosure("a", "c", "distance", 0.45)] * 2}
    q, v, tau = rng.standard_normal((n, 9)), 3 * rng.standard_normal((n, 8)), rng.standard_normal((n, 8))
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    q[:, 6] = rng.uniform(-1, 0.3, n)
    dt, k = 10 ** rng.uniform(-5, -1, n), 10 ** rng.uniform(0, 12, (n, 6))
    mu, tau_d = rng.choice([0.0, 0.5, 10.0], (n, 6)), rng.choice([0.0, 0.1], (n, 6))
    return Hostile(mech, positions, terms, (q, v, tau, dt, k, tau_d, mu))


CHUNK = 2000


def in_chunks(function, arguments):
    """A function of many states, evaluated where these are few, else compiled for chunks of them."""
    n = len(arguments[0])
    if n < 100:
        return interpreted(function)(*arguments)
    run = jax.jit(function)
    parts = [run(*(x[i : i + CHUNK] for x in arguments)) for i in range(0, n, CHUNK)]
    return jax.tree.map(lambda *x: np.concatenate(x), *parts)


# (how hostile, how many states, the largest share of them that does not converge in 60 iterations).
@pytest.mark.parametrize(
    ("kind", "n", "unsolved"),
    [
        ("contacts", 64, 0.0),
        ("joints", 12, 0.1),
        ("between", 3, 0.0),
        slow("contacts", 2000, 0.0),
        slow("contacts", 100_000, 1e-3),
        slow("joints", 2000, 0.01),
        slow("between", 200, 0.02),
    ],
)
def test_hostile_numbers(kind, n, unsolved):
    """What comes is the optimum, or the residual says that it is not."""
    given = hostile(kind, n)
    found = in_chunks(given.step, given.states)
    q, v, tau, dt, k, tau_d, mu = given.states
    contacts, wrong = spheres(("a", "b", "c") * 2, given.positions, 0.05, k, tau_d, mu), []
    for i, (problem, *_) in enumerate(oracle.problems_of(given.mechanism, q, v, tau, dt, contacts, **given.terms)):
        if not problem.terms:
            continue
        after = oracle.in_world(given.mechanism, found.q[i]) @ found.v[i]
        size, of = problem.momenta(after)
        best = problem.optimum(after)
        assert np.isfinite(after).all()
        # Of momenta: A times what is wrong with the velocities. Impulses against one another leave rounding errors.
        error = np.linalg.norm(problem.scale * (problem.A @ (after - best.v))) / max(of, 1e-300)
        largest = max(abs(x).max() for x in best.impulses)
        allowed = (2e-8 if kind != "between" and n <= CHUNK else 1e-6) + (
            kind != "contacts"
        ) * 1e4 * U * largest * problem.scale.max() / max(of, 1e-300)
        residual, ends = float(found.residual[i]), found.iterations[i] < 60
        # Deep in the stiffest contacts the rounding of a depth alone makes a residual of some 1e-8.
        is_wrong = (error > allowed and (residual < 1e-8 or ends)) or (residual > 1e-7 and ends)
        wrong.append((is_wrong, i, error, size / of, residual))
    assert not [x for x in wrong if x[0]], [x[1:] for x in wrong if x[0]]
    assert np.mean((found.residual > 1e-8) & (found.iterations == 60)) <= unsolved


@pytest.mark.parametrize(("kind", "n"), [("contacts", 32), slow("contacts", 2000), slow("joints", 2000)])
def test_hostile_numbers_in_float32(kind, n):
    """Finite, and the residual is as `ConvexStep` has it."""
    given = hostile(kind, n).astype(np.dtype(np.float32))
    found = in_chunks(given.step, given.states)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(found))
    residual, is_out = found.residual, found.iterations == 60
    # Shares of many states, and what a sample of n may have above.
    share_below, share_above, share_out = {"contacts": (0.37, 0.22, 0.0085), "joints": (0.2, 0.37, 0.12)}[kind]
    assert np.sum(residual < 1e-5) >= n * share_below - 3 * np.sqrt(n * share_below * (1 - share_below))
    assert np.sum(~(residual < 2e-4)) <= n * share_above + 3 * np.sqrt(n * share_above)
    assert np.sum(is_out) <= n * share_out + 3 * np.sqrt(n * share_out)


@pytest.mark.parametrize(("kind", "n"), [("contacts", 32), slow("contacts", 99), slow("joints", 99)])
def test_the_residual_of_hostile_numbers_in_float32(kind, n):
    """Most often it is the decrement in float64, of the same numbers; of a depth that is one of rounding it is not."""
    given = hostile(kind, n).astype(np.dtype(np.float32))
    found, wide = in_chunks(given.step, given.states), given.astype(np.dtype(np.float64))
    q, v, tau, dt, k, tau_d, mu = wide.states
    contacts, ratios = spheres(("a", "b", "c") * 2, wide.positions, float(np.float32(0.05)), k, tau_d, mu), []
    problems = oracle.problems_of(wide.mechanism, q, v, tau, dt, contacts, **wide.terms)
    for own, after_q, after_v, residual in zip(problems, found.q, found.v, found.residual, strict=True):
        if own.problem.terms:
            ratios.append(decrement(wide.mechanism, own, after_q, after_v) / residual)
    assert np.quantile(ratios, 0.8) < 2 and 0.5 < np.median(ratios) < 1.5, np.sort(ratios)


@pytest.mark.parametrize(("kind", "n"), [("contacts", 4), slow("contacts", 2000), slow("joints", 2000)])
def test_gradients_of_hostile_numbers_are_finite(kind, n):
    """Of all velocities and coordinates after the step, by all numbers of a state."""
    given = hostile(kind, n)

    def total(*x):
        found = given.step(*x)
        return found.v.sum() + found.q.sum()

    found = in_chunks(jax.vmap(jax.grad(total, tuple(range(len(given.states))))), given.states)
    is_finite = [np.isfinite(x).reshape((n, -1)).all(1) for x in found]
    assert np.all(is_finite), [np.flatnonzero(~x) for x in is_finite]


# A weld and a universal joint that cannot close; a weld across a hinge.
TOLD = [("leg", "float32")]


@pytest.mark.parametrize(
    ("scene", "dtype"),
    slow_but(TOLD, [(x, dtype) for x in [*range(40), *BUILT] for dtype in ("float64", "float32")]),
)
def test_the_residual_is_that_of_what_is_returned(scene, dtype):
    """Of mechanisms with contacts, limits, friction and closures, against sqrt(g^T H^-1 g) by dense matrices in
    float64, of the same numbers. A residual above 1 says that the step is nowhere near the optimum, and not how far."""
    given = built_scene(scene) if scene in BUILT else random_scene(scene)
    found = given.step(dtype)
    decrements, residual = given.decrements(found, dtype), np.asarray(found.residual)
    assert ((decrements <= 2 * residual) | (residual > 1)).all(), (decrements, residual)
    if (scene, dtype) in TOLD or dtype == "float64":
        assert found.iterations.max() < 20
    # It is the optimum, and not only said that it is not.
    assert decrements.max() < 1e-7 or dtype == "float32"


@pytest.mark.slow
@pytest.mark.parametrize("opening", [1e-5, 1e-4, 1e-3, 1e-2])
def test_a_weld_across_a_hinge_of_a_leg_in_float32(opening):
    """Its velocities are those of float64, but for what the residual says."""
    given = built_scene("leg", 4, opening)
    narrow = given.astype("float32")
    wide = narrow.astype("float64")
    found, expected = narrow.step("float32"), wide.step("float64")
    assert expected.residual.max() < 1e-2 * found.residual.min()
    M, y = interpreted(
        lambda q, v, tau: (
            js.mass_matrix(wide.mechanism, q),
            wide.dt * js.forward_dynamics(wide.mechanism, q, v, tau),
        )
    )(*wide.states)
    (v, difference), shares = (wide.states[1], found.v - np.asarray(expected.v)), []
    for A, *vectors in zip(M, v, y, difference, strict=True):
        of_v, of_y, off = (x @ A @ x for x in vectors)
        shares.append(np.sqrt(off / (of_v + of_y)))
    assert (shares <= 2 * found.residual).all() and found.residual.max() < 0.1, (shares, found.residual)


def test_what_the_residual_costs():
    """About two thirds of an iteration; nothing where nobody asks for it."""
    mech, contacts, (q, v, tau) = tree().mechanism, tree().contacts, (x[0] for x in many("tree", 1))

    def count(wanted):
        def step(*x):
            found = js.convex_step(mech, *x, 1e-3, contacts=contacts)
            return tuple(getattr(found, name) for name in wanted)

        return flops(done(step, q, v, tau, in_all_turns=False))

    alone = count(["q", "v"])
    with mock.patch.object(newton, "residual", lambda *x: x[-3].time):
        assert alone == count(["q", "v"])
    assert 0.1 * alone < count(["q", "v", "residual"]) - alone < 0.4 * alone


# -- derivatives ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["box", slow("arm"), slow("tree")])
def test_derivatives_are_those_of_the_optimum(name):
    """By v, tau and all numbers of contacts, against differences of the oracle's optima: stuck, sliding and in flight.
    Forward and reverse agree."""
    scene, dt, n, rng = SCENES[name](), 5e-3, 12, np.random.default_rng(6)
    mech, given, (q, v, tau) = scene.mechanism, scene.contacts, many(name, n)
    numbers = given.radius, given.stiffness, given.relaxation_time, given.friction
    per_contact = (np.broadcast_to(x, len(given.frames)) for x in numbers)
    contacts = jax.tree.map(jnp.asarray, spheres(given.frames, given.positions, *per_contact))
    along = jax.tree.map(lambda y: rng.standard_normal(y.shape) * abs(y).max(), contacts)
    along = (*rng.standard_normal((2, mech.nv)), along)

    def own(q, v, tau, contacts):
        return js.convex_step(mech, q, v, tau, dt, contacts=contacts).v

    def derivatives(q, v, tau, c):
        x = v, tau, contacts
        tangent = jax.jvp(lambda *x: own(q, *x), x, along)[1]
        return tangent, jax.vjp(lambda *x: own(q, *x), *x)[1](c)

    cotangents = rng.standard_normal((n, mech.nv))
    tangents, pulled = interpreted(jax.vmap(derivatives))(q, v, tau, cotangents)
    errors, kinds = [], set()
    for i, (c, tangent) in enumerate(zip(cotangents, tangents, strict=True)):
        inner = sum(np.vdot(a[i], b) for a, b in zip(jax.tree.leaves(pulled), jax.tree.leaves(along), strict=True))
        assert abs(inner - c @ tangent) <= 1e-7 * np.linalg.norm(c) * np.linalg.norm(tangent)
        difference, n_impulses = _difference(scene, (q[i], dt), (v[i], tau[i], contacts), along)
        errors.append(abs(difference - tangent).max() / abs(difference).max())
        kinds.add(n_impulses)
    assert np.max(errors) < 1e-5, errors
    assert len(kinds) > 1


def _difference(scene, at, x, along, h=1e-7):
    """(the derivative of rates after a step of the oracle, how many terms have an impulse)."""
    (q, dt), three = at, np.array([0.0, h, -h])
    v, tau, contacts = jax.tree.map(lambda y, d: np.stack([y + s * d for s in three]), x, along)
    steps = oracle.steps_of(scene.mechanism, np.stack([q] * 3), v, tau, dt, contacts)
    after, ahead, behind = (step.v for step in steps)
    difference = (ahead - behind) / (2 * h)
    if scene.is_floating:
        # Those of the base are along its axes, which have turned by dt w: these have a derivative too.
        R, (w, linear) = oracle.in_world(scene.mechanism, q)[:3, :3], after[:6].reshape(2, 3)

        def in_body(w, linear):
            R_after = js.Rotation.exp(dt * w).to_matrix() @ R
            return jnp.concatenate([R_after.T @ w, R_after.T @ linear])

        difference[:6] = jax.jvp(in_body, (w, linear), (difference[:3], difference[3:6]))[1]
    return difference, sum(bool(impulse.any()) for impulse in steps[0].result.impulses)


def test_derivatives_with_terms_between_two_bodies():
    """By q, v, tau and all numbers of pairs, against differences; forward and reverse agree."""
    mech, dt, rng = pendulums(), 5e-3, np.random.default_rng(7)
    q, v, tau = np.array([-0.3, 0.2, 0.5]), np.array([-1.0, 0.2, 0.5]), np.array([0.3, 0.1, -0.2])
    law = {"relaxation_time": np.array([0.01]), "friction": np.array([0.5])}
    p, radius, stiffness = np.array([[0, 0.05, -0.3]]), np.array([0.1]), np.array([2e3])
    touching = tuple(js.PointContacts([x], p, radius, stiffness=stiffness, **law) for x in "ab")
    touching, loops = jax.tree.map(jnp.asarray, touching), [js.LoopClosure("a", "c", "distance", 0.615)]
    along = jax.tree.map(lambda y: rng.standard_normal(y.shape) * abs(y).max(), touching)
    x, along = (q, v, tau, touching), (*rng.standard_normal((3, 3)), along)

    def own(x):
        q, v, tau, touching = x
        found = js.convex_step(mech, q, v, tau, dt, pairs=touching, loops=loops)
        return jnp.concatenate([found.v, found.contact_forces.f.ravel(), found.loop_wrenches.f.ravel()])

    def derivatives(x, c):
        value, tangent = jax.jvp(own, (x,), (along,))
        # What is pulled back has parts of one size.
        c = c / (1 + abs(tangent))
        return value, tangent, c, jax.vjp(own, x)[1](c)[0]

    near = [jax.tree.map(lambda a, d, s=s: a + s * d, x, along) for s in (0, 1e-6, -1e-6, 2e-6, -2e-6)]
    cotangents = rng.standard_normal((5, 9))
    values, *found = interpreted(jax.vmap(derivatives))(jax.tree.map(lambda *y: jnp.stack(y), *near), cotangents)
    tangent, c, pulled = jax.tree.map(lambda y: y[0], found)
    value, ahead, behind, *farther = values
    assert abs(value[3:6]).max() > 1 and abs(value[6:]).max() > 1
    difference = (8 * (ahead - behind) - (farther[0] - farther[1])) / 12e-6
    for part in (slice(3), slice(3, 6), slice(6, None)):
        np.testing.assert_allclose(tangent[part], difference[part], rtol=0, atol=1e-5 * abs(difference[part]).max())
    inner = sum(np.vdot(a, b) for a, b in zip(jax.tree.leaves(pulled), jax.tree.leaves(along), strict=True))
    np.testing.assert_allclose(inner, c @ tangent, rtol=1e-7)


MASSES, PUSHED = "masses", "external forces"
OTHERS = ("q", MASSES, PUSHED, "dt", "normal", "offset", "distance", *OF_MECHANISM, "b.positions", "c.positions")


@pytest.mark.slow
def test_derivatives_by_every_other_number():
    """Along q, masses, damping, dry friction, limits, the time, the ground, a closure and external forces, one by one,
    against differences, in a state in which spheres, limits, a pair and a closure act."""
    own, numbers = with_all_numbers()
    mech, rng, h = tree().mechanism, np.random.default_rng(8), 1e-5
    base = dict(zip(("q", "v", "tau"), (x[9] for x in many("tree", 10)), strict=True)) | numbers
    base |= {MASSES: np.zeros(4), PUSHED: rng.standard_normal(6), "distance": np.float64(0.468)}
    # One joint is above its upper limit, another below its lower one.
    for name, i, beyond in (("upper", 9, 1e-2), ("lower", 8, -1e-3)):
        base[name] = np.where(np.arange(10) == i, base["q"] - beyond, base[name])

    def after(x):
        M, more = mech.inertias, 1 + x[MASSES]
        heavier = js.SpatialInertia(M.mass * more, M.com, M.central * more[:, None])
        F = js.AppliedForces(["c"], js.SpatialForce.from_array(x[PUSHED][None]))
        found = own(x["q"], x["v"], x["tau"], x, mech.replace(inertias=heavier), F)
        return jnp.concatenate([found.v, found.contact_forces.f.ravel() / 1e3])

    along = {k: np.zeros((len(OTHERS), *np.shape(x))) for k, x in base.items()}
    for i, k in enumerate(OTHERS):
        x = np.where(np.isfinite(base[k]), base[k], 0)
        along[k][i] = rng.standard_normal(np.shape(x)) * np.isfinite(base[k]) * (abs(x).max() or 1)
    x = jax.tree.map(lambda y: np.repeat(np.asarray(y, float)[None], len(OTHERS), 0), base)
    tangent = interpreted(jax.vmap(lambda x, d: jax.jvp(after, (x,), (d,))[1]))(x, along)
    near = [jax.tree.map(lambda a, d, s=s: a + s * d, x, along) for s in (h, -h, 2 * h, -2 * h)]
    ahead, behind, *farther = interpreted(jax.vmap(jax.vmap(after)))(jax.tree.map(lambda *y: np.stack(y), *near))
    difference = (8 * (ahead - behind) - (farther[0] - farther[1])) / (12 * h)
    for k, a, b in zip(OTHERS, tangent, difference, strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-6 * abs(b).max() + 1e-7, err_msg=k)
        assert abs(b).max() > 1e-3, k


@pytest.mark.slow
def test_gradients_of_hostile_states_are_finite():
    """At rest, where nothing slips; just touching; without friction; and with every contact twice."""
    mech, zero = slider(), np.zeros(3)

    def total(q, v, contacts):
        found = js.convex_step(mech, q, v, zero, 5e-3, contacts=contacts)
        return found.v.sum() + found.q.sum()

    gradient = interpreted(jax.grad(total, (0, 1, 2)))
    for depth in (0.0, 1e-12, 1e-3):
        for mu in (0.0, 0.5):
            contacts = jax.tree.map(jnp.asarray, touching(mu, 2))
            found = gradient(np.array([0, 0, -depth]), zero, contacts)
            assert all(np.isfinite(y).all() for y in jax.tree.leaves(found))


@pytest.mark.slow
def test_what_friction_learns():
    """Of a block that slides: its speed v0 - mu gamma / m with gamma in closed form, and the derivative by mu."""
    dt, start, depth = 5e-3, 1.0, MASS * G / STIFF
    q, v = np.array([0, 0, -depth]), np.array([start, 0, 0])
    R_n, R_t = softness(dt)

    def speed(mu):
        return js.convex_step(slider(), q, v, np.zeros(3), dt, contacts=touching(mu)).v[0]

    def by_hand(mu):
        whole = R_n + 1 / MASS + mu**2 * (R_t + 1 / MASS)
        return start - mu * (depth / (dt + TAU_D) + G * dt + mu * start) / whole / MASS

    def derivatives(function):
        """(value, first derivative by reverse mode, the second by forward mode of it)."""
        return lambda mu: jax.jvp(jax.value_and_grad(function), (mu,), (1.0,))

    (value, first), (_, second) = interpreted(derivatives(speed))(0.3)
    expected, (_, of_first) = derivatives(by_hand)(0.3)
    np.testing.assert_allclose((value, first), expected, rtol=1e-6)
    np.testing.assert_allclose(second, of_first, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("root", ["planar", "free"])
def test_second_derivatives_where_axes_turn(root):
    """Along v, of a body whose axes turn and a link with dry friction: those of forward mode are differences."""
    M = js.SpatialInertia(np.float64(2), np.array([0.1, 0.2, -0.3]), np.diag([0.1, 0.2, 0.25]))
    out = js.RigidTransform(js.Rotation.exp(np.array([0.3, 0.2, 0])), np.array([0.2, 0, 0.1]))
    joints = [
        js.Joint("i", root, "world", "a", out),
        js.Joint("j", "revolute", "a", "b", out, axis=(1, 0, 0), friction_loss=0.3),
    ]
    mech = js.Mechanism.build([js.Body(x, M) for x in "ab"], joints, dtype=np.float64)
    rng, h = np.random.default_rng(0), 1e-4
    q = js.integrate(mech, mech.neutral(), rng.standard_normal(mech.nv))
    v, d = rng.standard_normal((2, mech.nv)) * [[3], [1]]

    def first(t):
        return jax.jvp(lambda t: js.convex_step(mech, q, v + t * d, np.zeros(mech.nv), 5e-3)[:2], (t,), (1.0,))[1]

    one, two = interpreted(jax.vmap(lambda t: jax.jvp(first, (t,), (1.0,))))(np.array([0.0, h, -h]))
    for a, b in zip(one, two, strict=True):
        np.testing.assert_allclose(b[0], (a[1] - a[2]) / (2 * h), rtol=0, atol=1e-7 * abs(b).max())
        assert abs(b[0]).max() > 1e-6


@pytest.mark.slow
def test_what_a_stiffness_learns():
    """Of a ball that bounces for 160 steps, between a quarter and eight times the true stiffness: both laws have the
    derivatives of their steps, after each of them. Whole paths tell on which side the truth is, last heights often not.
    """
    start, rate, n = np.array([0.5, 0.53, 0.56, 0.6]), 1e-6, 61
    sphere = js.SpatialInertia.solid_sphere(np.float64(0.05), mass=np.float64(1))
    up = js.Joint("height", "prismatic", "world", "ball", axis=(0, 0, 1))
    ball = js.Mechanism.build([js.Body("ball", sphere)], [up], dtype=np.float64)
    side = np.linspace(np.log(0.25), np.log(8), n)
    numbers = 1e3 * np.exp(np.concatenate([side, side + rate, side - rate, [0]]))

    def point(k, relaxation_time):
        return js.PointContacts(["ball"], stiffness=k, relaxation_time=relaxation_time, friction=0.0)

    def convex(q, v, k):
        return js.convex_step(ball, q, v, np.zeros(1), 5e-3, contacts=point(k, 1e-3))[:2]

    def explicit(q, v, k):
        forces = js.contact_forces(ball, q, v, point(k, 0.0), dissipation=0.1)
        return js.semi_implicit_step(ball, q, v, np.zeros(1), 5e-3, forces)

    for step, (of_path, of_end) in ((convex, (1.0, 0.9)), (explicit, (0.97, 0.8))):

        def path(k, h, step=step):
            return jax.lax.scan(lambda s, _: (step(*s, k), s[0][0]), (h[None], jnp.zeros(1)), None, 160)[1]

        both = jax.vmap(lambda k, h, path=path: jax.jvp(lambda k: path(k, h), (k,), (k,)), (None, 0))
        z, slopes = jax.jit(jax.vmap(both, (0, None)))(numbers, start)
        difference = (z[n : 2 * n] - z[2 * n : 3 * n]) / (2 * rate)
        np.testing.assert_allclose(slopes[:n], difference, rtol=0, atol=1e-6 * abs(difference).max())
        rates = (z[:n] - z[-1:]) * slopes[:n]
        shares = [np.mean(np.sign(x.sum((1, 2))) == np.sign(side)) for x in (rates, rates[..., -1:])]
        assert shares[0] >= of_path and shares[1] < of_end, shares
