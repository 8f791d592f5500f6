"""Spheres on a body against a shape on another: as pairs of spheres where both are, and laws of momentum."""

import itertools

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

LAW = {"stiffness": np.float64(2e4), "relaxation_time": np.float64(0.01), "friction": np.float64(0.5)}
SIZES = {"lower": np.array([0.6, 0.5, 0.2]), "upper": np.array([0.3, 0.2, 0.2])}
MASSES = {"lower": 4.0, "upper": 2.0}


def corners(name):
    return np.array(list(itertools.product(*([-x / 2, x / 2] for x in SIZES[name]))))


def boxes(gravity=(0.0, 0.0, -9.81)):
    bodies = [js.Body(k, js.SpatialInertia.solid_box(s, mass=np.float64(MASSES[k]))) for k, s in SIZES.items()]
    mech = js.Mechanism.build(bodies, [js.Joint(f"to {k}", "free", "world", k) for k in SIZES])
    return mech.replace(gravity=np.array(gravity))


def pair(shape=None, friction=0.5):
    shape = js.Box(SIZES["lower"]) if shape is None else shape
    law = LAW | {"friction": friction}
    return js.ShapeContacts(["lower"] * 8, shape, **law), js.PointContacts(
        ["upper"] * 8, corners("upper"), np.float64(0), **law
    )


def states(n=3, seed=0):
    """The upper box a little inside the lower one, and turned by little."""
    rng = np.random.default_rng(seed)
    q = np.zeros((n, 14))
    q[:, 0], q[:, 7], q[:, 6], q[:, 13] = 1, 1, 0.5, 0.69
    q[:, 8:11] = 0.03 * rng.normal(size=(n, 3))
    q[:, 1:4] = 0.3 * rng.normal(size=(n, 3))
    with jax.enable_x64(True):
        R = np.asarray(js.Rotation.from_quaternion(q[:, :4]).to_matrix())
        own = js.Rotation.from_quaternion(q[:, 7:11])
        q[:, 7:11] = (js.Rotation.from_quaternion(q[:, :4]) @ own).to_quaternion()
    q[:, 11:14] = np.einsum("nij,nj->ni", R, np.array([0.1, 0.05, 0.195]) + 0.01 * rng.normal(size=(n, 3)))
    q[:, 11:14] += q[:, 4:7]
    return q, 0.3 * rng.normal(size=(n, 12))


def test_a_ball_on_a_body_is_the_sphere_that_it_is():
    """By both ways, velocities and forces; and their report."""
    with jax.enable_x64(True):
        mech = boxes()
        q, v = states()
        q[:, 11:14] = q[:, 4:7] + np.array([0.1, 0.05, 0.25])
        at = np.array([0.02, 0.01, 0.03])
        X = js.RigidTransform(js.Rotation.identity((), np.float64), at)
        shape = js.ShapeContacts(["lower"], js.Sphere(np.float64(0.15), X), **LAW)
        sphere = js.PointContacts(["lower"], at[None], np.float64(0.15), **LAW)
        b = js.PointContacts(["upper"], None, np.float64(0.12), **LAW)

        def of(a):
            def step(q, v):
                after = js.convex_step(mech, q, v, np.zeros(12), 5e-3, pairs=(a, b))
                report = js.contact_report(mech, q, after.v, pairs=(a, b), forces=after.contact_forces, dt=5e-3)
                return after.v, after.contact_forces.f, report

            return interpreted(jax.vmap(step))(q, v)

        found, expected = of(shape), of(sphere)
    assert (np.linalg.norm(found[1], axis=-1) > 1).all()
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-8 * max(1, abs(y).max()))


def test_forces_between_bodies_keep_all_momentum():
    """The third law: of two bodies in empty space, let go inside one another, from rest."""
    with jax.enable_x64(True):
        mech = boxes((0.0, 0.0, 0.0))
        q, _ = states()

        def of(q):
            after = js.convex_step(mech, q, np.zeros(12), np.zeros(12), 5e-3, pairs=pair())
            return after, js.contact_report(mech, q, after.v, pairs=pair(), forces=after.contact_forces, dt=5e-3)

        after, report = interpreted(jax.vmap(of))(q)
        linear, angular, upper = 0, 0, 0
        for k, (name, size) in enumerate(SIZES.items()):
            old, new = (
                np.asarray(js.Rotation.from_quaternion(x[:, 7 * k : 7 * k + 4]).to_matrix()) for x in (q, after.q)
            )
            w, v = (np.einsum("nij,nj->ni", new, after.v[:, i : i + 3]) for i in (6 * k, 6 * k + 3))
            I = MASSES[name] / 12 * np.diag((size**2).sum() - size**2)  # noqa: E741
            p, l = q[:, 7 * k + 4 : 7 * k + 7], MASSES[name] * v  # noqa: E741
            h = np.einsum("nij,jk,nlk,nl->ni", old, I, old, w) + np.cross(p, l)
            linear, angular, upper = linear + l, angular + h, h
    f = after.contact_forces.f
    assert abs(upper).max() > 0.05
    np.testing.assert_allclose(linear, 0, rtol=0, atol=1e-10)
    np.testing.assert_allclose(angular, 0, rtol=0, atol=1e-10)
    np.testing.assert_allclose(upper, 5e-3 * np.cross(report.points, f).sum(1), rtol=0, atol=1e-10)


def test_derivatives_are_differences():
    """By the state, the size of the shape and friction."""
    with jax.enable_x64(True):
        mech = boxes()
        q, v = states(2, seed=4)
        rng = np.random.default_rng(1)
        dq, dv, ds = rng.normal(size=(2, 12)), rng.normal(size=(2, 12)), np.array([0.3, 0.2, 0.5])

        def of(s, q, v, dq, dv):
            a, b = pair(js.Box(SIZES["lower"] + s * ds), 0.5 + s)
            q = js.integrate(mech, q, dq, s)
            after = js.convex_step(mech, q, v + s * dv, np.zeros(12), 5e-3, pairs=(a, b))
            return after.v, after.contact_forces.f

        def slope(*at):
            return jax.jvp(lambda s: of(s, *at), (0.0,), (1.0,))[1]

        h, at = 1e-6, (q, v, dq, dv)
        found = interpreted(jax.vmap(slope))(*at)
        ahead, behind = (interpreted(jax.vmap(lambda *at, s=s: of(s, *at)))(*at) for s in (h, -h))
    for own, x, y in zip(found, ahead, behind, strict=True):
        assert abs(own).max() > 1
        np.testing.assert_allclose(own, (x - y) / (2 * h), rtol=0, atol=1e-4 * abs(own).max())


def test_a_stack_rests():
    """One box on another, on the ground: forces carry the weights, and contacts give way by as much."""
    with jax.enable_x64(True):
        mech = boxes()
        ground = js.PointContacts(["lower"] * 8, corners("lower"), np.float64(0), **LAW)
        q = np.zeros(14)
        q[[0, 7]], q[6], q[13], q[11] = 1, 0.1, 0.3, 0.05

        def one(state, _):
            after = js.convex_step(mech, *state, np.zeros(12), 1e-2, contacts=ground, pairs=pair())
            return (after.q, after.v), after.contact_forces.f

        (q, v), f = interpreted(lambda q: jax.lax.scan(one, (q, np.zeros(12)), None, 120))(q)
    weights = 9.81 * np.array(list(MASSES.values()))
    assert abs(v).max() < 1e-5
    np.testing.assert_allclose(f[-1, :8, 2].sum(), weights.sum(), rtol=1e-4)
    np.testing.assert_allclose(f[-1, 8:, 2].sum(), weights[1], rtol=1e-4)
    # Four corners each; of two surfaces each has half of the stiffness.
    sunk = weights.sum() / (4 * 2e4), weights[1] / (4 * 1e4)
    np.testing.assert_allclose(0.1 - q[6], sunk[0], rtol=1e-3)
    np.testing.assert_allclose(0.2 - (q[13] - q[6]), sunk[1], rtol=2e-2)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: js.ShapeContacts("a", js.Sphere(1.0), **LAW), TypeError, "ShapeContacts: frames: expected a sequence"),
        (lambda: js.ShapeContacts(["a"], 3, **LAW), TypeError, "ShapeContacts: shape: expected a shape, such as"),
        (
            lambda: js.ShapeContacts(["a"] * 2, js.Sphere(np.ones(3)), **LAW),
            ValueError,
            r"ShapeContacts: shape: expected one, or a batch \(\*batch, 2\), got \(3,\)",
        ),
        (
            lambda: js.ShapeContacts(["a"], js.Sphere(np.float64(1)), **LAW | {"friction": -1.0}),
            ValueError,
            "ShapeContacts: friction: expected numbers of at least 0, got -1.0",
        ),
        (
            lambda: js.convex_step(boxes(), states()[0][0], np.zeros(12), np.zeros(12), 5e-3, pairs=pair()[::-1]),
            TypeError,
            "convex_step: pairs: expected PointContacts, got ShapeContacts",
        ),
        (
            lambda: js.convex_step(
                boxes(), states()[0][0], np.zeros(12), np.zeros(12), 5e-3,
                pairs=(js.ShapeContacts(["upper"] * 8, js.Box(SIZES["lower"]), **LAW), pair()[1]),
            ),
            ValueError,
            "pairs: expected frames of two bodies, got 'upper' and 'upper', of one",
        ),
    ],
)  # fmt: skip
def test_what_is_refused(make, error, message):
    with jax.enable_x64(True), pytest.raises(error, match=message):
        make()
