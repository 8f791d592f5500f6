"""body_f of Newton on whatever has the attributes of its Model: labels, worlds, and what is refused."""

import types

import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import newton
from tests.helpers.interpreted import interpreted

LABELS = ["robot/worldbody/base", "robot/worldbody/base/arm", "robot/worldbody/base/arm/tool"]
COM = np.float32([[0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
U = 2.0**-24


class OfWarp:
    """An array of Warp, as far as it is read."""

    def __init__(self, numbers):
        self._numbers = np.asarray(numbers, np.float32)

    def numpy(self):
        return self._numbers


def model(worlds=1, labels=None, com=None):
    labels = LABELS * worlds if labels is None else labels
    com = OfWarp(np.tile(COM, (worlds, 1)) if com is None else com)
    return types.SimpleNamespace(body_label=labels, body_com=com, world_count=worlds)


def robot():
    """A base that floats, an arm on a hinge along z, and a tool that is welded to it."""
    along_x = js.RigidTransform(js.Rotation.identity(), np.float32([1, 0, 0]))
    return js.Mechanism.build(
        [js.Body("base"), js.Body("arm"), js.Body("tool")],
        [
            js.Joint("root", "free", "world", "base"),
            js.Joint("hinge", "revolute", "base", "arm", along_x, axis=(0, 0, 1)),
            js.Joint("weld", "fixed", "arm", "tool", along_x),
        ],
    )


def state(*batch):
    q = np.zeros((*batch, 8), np.float32)
    q[..., 0], q[..., 7] = 1, np.pi / 2
    return q


def test_about_the_centre_of_mass_force_first():
    """A force on the tool, which is welded to the arm: it acts on the arm, about its centre of mass."""
    F = js.SpatialForce(f=np.float32([3, 5, 0]))
    x = newton.to_body_f(model(), robot(), state(), {"tool": F})
    assert x.shape == (3, 6)
    # From the arm's origin, in world axes, the tool is at (0, 1, 0) and the centre of mass at (-0.2, 0, 0).
    np.testing.assert_allclose(x[1], [3, 5, 0, 0, 0, -2], rtol=0, atol=16 * U)
    assert not x[0].any() and not x[2].any()


def test_many_worlds_are_a_batch():
    rng = np.random.default_rng(0)
    F = js.SpatialForce(*rng.normal(size=(2, 4, 2, 3)).astype(np.float32))
    forces = js.AppliedForces(["base", "arm"], F)
    com = rng.normal(size=(12, 3))
    of_worlds = interpreted(lambda forces: newton.to_body_f(model(4, com=com), robot(), state(4), forces))
    x = of_worlds(forces)
    assert x.shape == (4, 3, 6)
    for i in range(4):
        own = js.AppliedForces(["base", "arm"], F.at_batch(i))
        of_one = model(com=com[3 * i : 3 * i + 3])
        alone = interpreted(lambda own, m=of_one: newton.to_body_f(m, robot(), state(), own))(own)
        np.testing.assert_allclose(x[i], alone, rtol=0, atol=16 * U)
    back = newton.from_body_f(model(4, com=com), OfWarp(x.reshape(-1, 6)))
    assert back.frames == ("base", "arm", "tool") and back.batch_shape == (4,)
    np.testing.assert_allclose(of_worlds(back), x, rtol=0, atol=64 * U)


def test_what_is_read_is_force_first():
    x = np.arange(18, dtype=np.float32).reshape(3, 6)
    forces = newton.from_body_f(model(), x)
    np.testing.assert_array_equal(forces.wrenches.f, x[:, :3])
    np.testing.assert_array_equal(forces.wrenches.tau, x[:, 3:])
    np.testing.assert_array_equal(forces.points, COM)
    assert forces.axes == "world"


def test_what_is_not_there_is_named():
    F = {"arm": js.SpatialForce(f=np.float32([1, 0, 0]))}
    with pytest.raises(KeyError, match="no body 'arm'; did you mean 'arm_1'"):
        newton.to_body_f(model(labels=["robot/base", "robot/arm_1", "robot/tool"]), robot(), state(), F)
    with pytest.raises(ValueError, match="'arm' names several bodies: .*'left/arm', 'right/arm'"):
        newton.to_body_f(model(labels=["left/arm", "right/arm", "base"]), robot(), state(), F)
    with pytest.raises(ValueError, match="the same bodies in each of 2 worlds"):
        newton.to_body_f(model(2, labels=[*LABELS, "a", "b", "c"]), robot(), state(2), F)
    with pytest.raises(ValueError, match=r"\(\*batch, 3, 6\)"):
        newton.from_body_f(model(), np.zeros((4, 6), np.float32))
