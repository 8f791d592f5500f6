"""Tendons and lifts as parts of a mechanism: what is refused, what editing keeps, what there is not costs nothing.

Their forces are compared with MuJoCo's in `peers/test_dynamics_mujoco.py`.
"""

import copy
import pickle

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.counting import done

BOX = js.SpatialInertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 2.0, 2.5]))
BAND = js.Tendon("band", ["a", "b", "c"], [1.0, -2.0, 0.5], 0.25, stiffness=3.0, rest=[0.1, 0.2], damping=0.5)


def arm(tendons=(), lift=None):
    """Three joints, of which the last follows the second."""
    bodies = [js.Body(x, BOX, lift if x == "b" else None) for x in "abc"]
    joints = [
        js.Joint("a", "revolute", "world", "a"),
        js.Joint("b", "prismatic", "a", "b", axis=(1, 0, 0)),
        js.Joint("c", "revolute", "b", "c", axis=(0, 1, 0), mimic=("b", 2.0, 0.3)),
    ]
    return js.Mechanism.build(bodies, joints, tendons=tendons, dtype=np.float32)


def forces(mech, q, v, *compliance):
    return np.asarray(js.passive_forces(mech, np.float32(q), np.float32(v), *compliance))


def test_forces_by_hand():
    """L = a - 2 b + (2 b + 0.3) / 2 + 0.25 = a - b + 0.4, its rate is that of a - b."""
    np.testing.assert_allclose(forces(arm([BAND]), [0.5, 0.1], [1, 2]), [-3 * 0.6 + 0.5, 3 * 0.6 - 0.5], rtol=1e-6)
    np.testing.assert_allclose(forces(arm([BAND]), [-0.5, 0.1], [0, 0]), [3 * 0.3, -3 * 0.3], rtol=1e-6)
    np.testing.assert_array_equal(forces(arm([BAND]), [-0.15, 0.1], [0, 0]), [0, 0])
    two = arm([BAND, js.Tendon("stop", ["a"], [2.0], lower=-0.1, upper=0.3)])
    soft = js.Compliance(limit_stiffness=[10.0, 0.0], limit_damping=1.0)
    found = forces(two, [0.5, 0.1], [1, 2], soft) - forces(two, [0.5, 0.1], [1, 2])
    np.testing.assert_allclose(found, [-2 * (10 * 0.7 + 2), 0], rtol=1e-5)
    found = forces(two, [0.5, 0.1], [-9, 2], soft) - forces(two, [0.5, 0.1], [-9, 2])
    np.testing.assert_allclose(found, [0, 0], atol=1e-5)


def test_a_spring_is_the_gradient_of_its_energy_where_numbers_are_data():
    def energy(mech, q):
        c, b = mech.tendons[0].coefficients, mech.tendons[0].offset
        length = c[0] * q[0] + c[1] * q[1] + c[2] * (2 * q[1] + 0.3) + b
        return 1.5 * jax.numpy.maximum(length - 0.2, 0) ** 2

    q, mech = np.float32([0.5, 0.1]), arm([BAND])
    expected = -np.asarray(jax.grad(energy, 1)(mech, q))
    data = mech.as_data()
    np.testing.assert_allclose(jax.jit(js.passive_forces)(data, q, 0 * q), expected, rtol=1e-5)
    slopes = jax.grad(lambda m: js.passive_forces(m, q, 0 * q)[0])(data).tendons[0]
    np.testing.assert_allclose([slopes.stiffness, slopes.offset], [-0.6, -3], rtol=1e-5)


def test_what_is_lifted_has_no_weight():
    """All of the body b: what holds the robot still is what holds it without b's weight."""
    lifted, q = arm(lift=BOX), np.float32([0.5, 0.2])
    weightless = arm()
    weightless = weightless.replace(gravity=np.zeros(3, np.float32))
    assert not forces(weightless, q, 0 * q).any()
    both = forces(lifted, q, 0 * q)
    alone = js.gravity_forces(lifted.lifted, q)
    np.testing.assert_array_equal(both, alone)
    np.testing.assert_array_equal(lifted.lifts.mass, [0, 1, 0])
    np.testing.assert_array_equal(lifted.lifts.com[1], np.float32([0.1, 0.2, 0.3]))


NOTHING = {
    "tendon that does nothing": js.Tendon("t", ["a"], [1.0]),
    "limits that do not act": js.Tendon("t", ["a"], [1.0], upper=1.0),
}


@pytest.mark.parametrize("tendon", NOTHING.values(), ids=NOTHING)
def test_what_there_is_not_leaves_no_operation(tendon):
    q = v = tau = np.float32([0.5, 0.1])
    step = lambda mech: done(lambda q, v: js.semi_implicit_step(mech, q, v, tau, 0.01), q, v)  # noqa: E731
    without = step(arm())
    assert step(arm([tendon])) == without
    assert sum(step(arm([BAND])).values()) > sum(without.values())
    no_gravity = {"gravity": np.zeros(3, np.float32)}
    assert step(arm(lift=BOX).replace(**no_gravity)) == step(arm().replace(**no_gravity))


def test_editing_keeps_them():
    mech = arm([BAND, js.Tendon("stop", ["a"], [2.0])], lift=BOX)
    (band, stop) = js.lock_joints(mech, {"b": 0.5}).tendons
    assert (band.joints, stop.joints) == (("a",), ("a",))
    np.testing.assert_allclose(band.offset, 0.25 - 2 * 0.5 + 0.5 * 1.3, rtol=1e-6)
    locked = js.lock_joints(mech, {"b": 0.5})
    for q in (-0.4, 0.6):
        np.testing.assert_allclose(forces(locked, [q], [0.5]), forces(mech, [q, 0.5], [0.5, 0])[:1], rtol=1e-5)
    # A tendon over locked joints alone does nothing.
    assert [x.name for x in js.lock_joints(mech, {"a": 0.5}).tendons] == ["band"]
    assert js.lock_joints(mech, {"a": 0.5, "b": 0.5}).tendons == ()
    below = js.subtree(mech, "b")
    assert (below.tendons, below.lifts.mass.tolist()) == ((), [1, 0])
    again = js.subtree(mech, "a")
    assert [x.name for x in again.tendons] == ["band", "stop"]
    np.testing.assert_allclose(again.lifts.com, mech.lifts.com, rtol=1e-6)


def test_constants_with_them():
    mech = arm([BAND], lift=BOX)
    static, other = mech.as_static(), arm([BAND], lift=BOX).as_static()
    assert static is other and static is not arm([BAND]).as_static()
    assert pickle.loads(pickle.dumps(static)) is static and copy.copy(static).contents == static.contents
    assert mech.astype(np.float16).tendons[0].stiffness.dtype == np.float16
    exported = jax.export.export(jax.jit(js.passive_forces))(static, *[np.float32([0.5, 0.1])] * 2)
    found = jax.export.deserialize(exported.serialize()).call(static, *[np.float32([0.5, 0.1])] * 2)
    np.testing.assert_allclose(found, forces(mech, [0.5, 0.1], [0.5, 0.1]), rtol=1e-6)


def swinging(**limit):
    return js.Mechanism.build([js.Body("d", BOX)], [js.Joint("j", "ball", "world", "d", **limit)], dtype=np.float32)


def test_limits_of_the_angle_of_a_ball(x64):
    """Beyond it about the axis of the rotation, for both quaternions of it; and derivatives where there is no axis."""
    soft, mech = js.Compliance(limit_stiffness=10.0, limit_damping=2.0), swinging(turn_limit=0.5)
    axis = np.float32([0.6, 0, 0.8])
    for angle, sign in ((0.75, 1), (0.75, -1), (-0.75, 1), (0.4, 1), (3.1, 1)):
        q = sign * np.float32([np.cos(angle / 2), *np.sin(angle / 2) * axis])
        depth = max(abs(angle) - 0.5, 0)
        for rate in (0.0, 1.0, -9.0):
            push = max(10 * depth + 2 * rate * np.sign(angle), 0) if depth else 0
            expected = -push * np.sign(angle) * axis
            np.testing.assert_allclose(forces(mech, q, rate * axis, soft), expected, rtol=1e-5, atol=1e-5)
    slopes = jax.jacfwd(lambda q: js.passive_forces(mech, q, np.zeros(3, np.float32), soft))(np.float32([1, 0, 0, 0]))
    np.testing.assert_array_equal(slopes, np.zeros((3, 4)))
    q, v = np.float32([0.5, 0.5, 0.5, 0.5]), np.zeros(3, np.float32)
    step = lambda mech: done(lambda q, v: js.passive_forces(mech, q, v, soft), q, v)  # noqa: E731
    assert step(swinging()) == {} and step(mech) != {}
    assert js.subtree(mech, "d").turn_limits == np.float32(0.5)
    assert mech.as_static() is not swinging().as_static()


BAD = {
    "no joint": (
        ["x"],
        [1.0],
        KeyError,
        "build: tendons: Tendon 't': joints: expected one of 'a', 'b', 'c', got",
    ),
    "a joint with three": (["ball"], [1.0], ValueError, "expected joints of one coordinate, got 'ball', a 'ball'"),
}


@pytest.mark.parametrize(("joints", "c", "kind", "message"), BAD.values(), ids=BAD)
def test_tendons_that_are_refused(joints, c, kind, message):
    with pytest.raises(kind, match=message):
        if joints == ["ball"]:
            js.Mechanism.build(
                [js.Body("d", BOX)], [js.Joint("ball", "ball", "world", "d")], tendons=[js.Tendon("t", joints, c)]
            )
        arm([js.Tendon("t", joints, c)])


def test_numbers_that_are_refused():
    with pytest.raises(ValueError, match=r"Tendon 't': coefficients: expected shape \(2,\), got \(1,\)"):
        js.Tendon("t", ["a", "b"], [1.0])
    with pytest.raises(ValueError, match="Tendon 't': damping: expected numbers of at least 0, got -1.0"):
        js.Tendon("t", ["j"], [1.0], damping=-1.0)
    with pytest.raises(ValueError, match="Tendon 't': upper: expected numbers, got nan"):
        js.Tendon("t", ["j"], [1.0], upper=np.nan)
    with pytest.raises(ValueError, match="Tendon 't': lower: expected at most upper, 1.0, got 2.0"):
        js.Tendon("t", ["j"], [1.0], lower=2.0, upper=1.0)
    with pytest.raises(ValueError, match="Tendon 't': joints: expected at least one name, got none"):
        js.Tendon("t", [], [])
    with pytest.raises(TypeError, match="Tendon: joints: expected a sequence of names, got 'ab'"):
        js.Tendon("t", "ab", [1.0])
    with pytest.raises(TypeError, match="Mechanism.replace: tendons: expected a sequence of Tendons, got 3"):
        arm().replace(tendons=3)
    with pytest.raises(ValueError, match="Joint 'j': turn_limit: expected none for 'free', got 1.0"):
        js.Joint("j", "free", "world", "a", turn_limit=1.0)
