"""geometry_msgs/Wrench there and back, as the message is declared and with the classes of rosbags, where it is."""

import dataclasses
import sys
import types

import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import ros


@dataclasses.dataclass
class Vector3:
    """geometry_msgs/msg/Vector3.msg."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclasses.dataclass
class Wrench:
    """geometry_msgs/msg/Wrench.msg."""

    force: Vector3 = dataclasses.field(default_factory=Vector3)
    torque: Vector3 = dataclasses.field(default_factory=Vector3)


@pytest.fixture(params=["declared", "rosbags"])
def messages(request, monkeypatch):
    """The module geometry_msgs.msg, which a ROS installation has."""
    if request.param == "declared":
        found = types.SimpleNamespace(Vector3=Vector3, Wrench=Wrench)
    else:
        typesys = pytest.importorskip("rosbags.typesys")
        known = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).types
        found = types.SimpleNamespace(**{name: known[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Wrench")})
    monkeypatch.setitem(sys.modules, "geometry_msgs", types.SimpleNamespace(msg=found))
    monkeypatch.setitem(sys.modules, "geometry_msgs.msg", found)
    return found


def test_force_comes_first(messages):
    """By name: a message holds no numbers by position."""
    message = messages.Wrench(force=messages.Vector3(x=1.0, y=2.0, z=3.0), torque=messages.Vector3(x=4.0, y=5.0, z=6.0))
    F = ros.from_wrench(message)
    np.testing.assert_array_equal(F.f, [1, 2, 3])
    np.testing.assert_array_equal(F.tau, [4, 5, 6])
    assert F.dtype == np.float64


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_there_and_back(messages, dtype):
    F = js.SpatialForce(*np.random.default_rng(0).normal(size=(2, 3)).astype(dtype))
    made = ros.to_wrench(F)
    assert type(made) is messages.Wrench and type(made.torque.z) is float
    np.testing.assert_array_equal(ros.from_wrench(made).to_array(), F.to_array())


def test_a_part_that_is_left_out_is_zero(messages):
    made = ros.to_wrench(js.SpatialForce(f=np.float32([1, 2, 3])))
    assert (made.torque.x, made.torque.y, made.torque.z) == (0.0, 0.0, 0.0)
    assert made.force.y == 2.0


def test_a_message_holds_one_wrench(messages):
    with pytest.raises(ValueError, match=r"to_wrench: F_Fo_F: expected one item, got a batch of shape \(2,\)"):
        ros.to_wrench(js.SpatialForce(np.ones((2, 3)), np.ones((2, 3))))


def test_a_sensor_that_is_read_acts_on_its_frame(messages):
    """In the axes of the frame that the header names: as external forces that turn with it."""
    mech = js.Mechanism.build([js.Body("hand")], [js.Joint("hinge", "revolute", "world", "hand", axis=(0, 0, 1))])
    q, F_H_H = np.float32([np.pi / 2]), js.SpatialForce(np.float32([0, 1, 0]), np.float32([2, 0, 0]))
    read = ros.from_wrench(ros.to_wrench(F_H_H)).astype(np.float32)
    forces = js.AppliedForces(["hand"], js.stack([read]), axes="frame")
    on_hand = js.applied_wrenches(mech, q, forces)["hand"]
    np.testing.assert_allclose(on_hand.to_array(), [-1, 0, 0, 0, 2, 0], rtol=0, atol=2.0**-22)


def test_without_ros():
    with pytest.raises(ImportError, match="geometry_msgs"):
        ros.to_wrench(js.SpatialForce(np.ones(3), np.ones(3)))
