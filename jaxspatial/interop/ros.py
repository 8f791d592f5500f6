"""ROS: `geometry_msgs/Wrench`, of ROS 1 and ROS 2, whose fields are force, then torque. One message holds one wrench.

A Wrench says neither point nor axes: the header of a WrenchStamped names a frame, and the wrench is about the origin of
that frame, in its axes. `act` moves it to another frame. So does `tf2_geometry_msgs`, but for its older versions: they
turned both parts and left out the moment of the force about the new origin (ros2/geometry2, pull request 538). Some
drivers mean another point or other axes than the header says.

Read: geometry_msgs/msg/Wrench.msg, tf2_geometry_msgs.hpp.
"""

from typing import TYPE_CHECKING

import numpy as np

from jaxspatial.interop import orders
from jaxspatial.spatial import SpatialForce

if TYPE_CHECKING:
    from geometry_msgs.msg import Wrench


def from_wrench(message: "Wrench") -> SpatialForce:
    """Reads a geometry_msgs/Wrench, N, N m, as float64: F_Fo_F, with F the frame that the header beside it names.

    Example:
        >>> from geometry_msgs.msg import Vector3, Wrench
        >>> js.interop.ros.from_wrench(Wrench(force=Vector3(x=1.0, y=2.0, z=0.0), torque=Vector3(x=0.0, y=0.0, z=3.0)))
        SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
    """
    six = [part for x in (message.force, message.torque) for part in (x.x, x.y, x.z)]
    return orders.from_linear_first(SpatialForce, np.array(six, np.float64))


def to_wrench(F_Fo_F: SpatialForce) -> "Wrench":
    """Makes a geometry_msgs.msg.Wrench, N, N m: about the origin of the frame F that its header will name, in the axes
    of F.

    Raises:
        ValueError: the wrench is a batch.

    Example:
        >>> message = js.interop.ros.to_wrench(F)
        >>> print(message.force.y, message.torque.z)
        2.0 3.0
    """
    from geometry_msgs.msg import Vector3, Wrench

    six = orders.single(orders.to_linear_first(F_Fo_F), "ros.to_wrench: F_Fo_F").tolist()
    force, torque = (Vector3(**dict(zip("xyz", part, strict=True))) for part in (six[:3], six[3:]))
    return Wrench(force=force, torque=torque)
