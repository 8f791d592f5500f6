"""Of many points, those on a frame that does not touch are left out: results have the same bits, and derivatives."""

import functools
from unittest import mock

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.contact import points
from jaxspatial.numerics.numbers import where_any
from tests.helpers.interpreted import interpreted

SIDE = np.array([0.3, 0.2, 0.1])
POINTS = {
    "a": np.array([[-0.15, 0.1, -0.05], [0.15, -0.1, -0.05]]),
    "paw": np.array([[0.0, 0.0, 0.0], [0.02, 0.05, 0.0]]),
    "b": np.array([[-0.15, 0.0, -0.05]]),
}
W = np.random.default_rng(7).normal(size=7)


def hinged(name):
    """Two bricks with a hinge between them, and a paw at the end of one. name: for programs of its own."""
    brick = js.SpatialInertia.solid_box(SIDE, mass=np.float64(2))
    beside = js.RigidTransform(js.Rotation.identity((), np.float64), np.array([0.35, 0, 0]))
    joints = [
        js.Joint("root", "free", "world", f"{name} a"),
        js.Joint("hinge", "revolute", f"{name} a", f"{name} b", axis=(0, 1, 0), placement=beside),
    ]
    mech = js.Mechanism.build([js.Body(f"{name} {k}", brick) for k in "ab"], joints)
    below = js.RigidTransform(js.Rotation.identity((), np.float64), np.array([0.15, 0, -0.05]))
    return js.add_frames(mech, [js.Frame(f"{name} paw", f"{name} b", below)])


def states():
    """All touch; one body and the paw of the other; that other alone, but for its paw; none; one is fast and slides."""
    q = np.tile(np.array([1, 0.02, 0, 0, 0, 0, 0.049, 0.0]), (5, 1))
    q[1, 7], q[2, 6], q[2, 7], q[3, 6] = 0.6, 0.11, -0.6, 0.5
    v = 0.1 * np.random.default_rng(1).normal(size=(5, 7))
    v[4, 4] = 2
    return q, v


def value(name, q, v, friction):
    mech, at = hinged(name), np.concatenate(list(POINTS.values()))
    frames = [f"{name} {frame}" for frame, own in POINTS.items() for _ in own]
    law = {"stiffness": np.float64(2e4), "relaxation_time": np.float64(0.01)}
    touching = js.PointContacts(frames, at, np.float64(0), friction=friction, **law)
    after = js.convex_step(mech, q, v, np.zeros(7), np.float64(5e-3), contacts=touching)
    return W @ after.v, after


def of_both(function):
    """Results with points by frame, and with all points together."""
    with jax.enable_x64(True):
        for name, most in (("by frame", 1), ("together", 99)):
            with mock.patch.object(points, "MOST_TOGETHER", most):
                of_each = jax.vmap(functools.partial(function, name), in_axes=(0, 0, None))
                yield interpreted(of_each)(*states(), np.float64(0.5))


def test_results_have_the_same_bits():
    groups = set()

    def recorded(mask, function, *arguments):
        groups.add(arguments[0].frames)
        return where_any(mask, function, *arguments)

    with mock.patch.object(points, "where_any", recorded):
        one, other = (x for _, x in of_both(value))
    # Laws by frame; what acts on the second body, of both of its frames.
    assert sorted(map(len, groups)) == [1, 2, 2, 3]
    force = np.asarray(one.contact_forces.f)[..., 2] > 0
    touches = np.stack([force[:, :2].any(1), force[:, 2:4].any(1), force[:, 4]], 1)
    assert touches.astype(int).tolist() == [[1, 1, 1], [1, 1, 0], [0, 0, 1], [0, 0, 0], [1, 1, 1]]
    for own, same in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(own, same)


@pytest.mark.slow
def test_derivatives_are_the_same():
    """Back through states of which a body, or both, is left out: no zero is divided by."""
    one, other = of_both(lambda name, *x: jax.grad(lambda *x: value(name, *x)[0], (0, 1, 2))(*x))
    for own, same in zip(one, other, strict=True):
        assert np.isfinite(own).all() and np.abs(own).max() > 0
        np.testing.assert_allclose(own, same, rtol=0, atol=1e-9 * np.abs(same).max())
