"""Joints that turn about an axis."""

from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind, JointNumbers
from jaxspatial.mechanism.joints.geometry import (
    forces,
    perpendicular,
    rotation_about,
    shortest_angle,
    torques,
    unit_vectors,
    zero_vector,
)
from jaxspatial.mechanism.joints.parameter import AXIS


class Revolute(JointKind):
    """Turns about the axis: q the angle, rad."""

    name, nq, nv, angles = "revolute", 1, 1, (0,)
    parameters, is_about_one_axis = (AXIS,), True

    @staticmethod
    def transform(joint: JointNumbers, q: Numbers, cos_sin: CosSin):
        return rotation_about(joint.axis, *cos_sin[0]), zero_vector(joint)

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin):
        return torques(joint, [joint.axis])

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin):
        return *torques(joint, perpendicular(joint.axis)), *forces(joint, unit_vectors(joint))


class Continuous(Revolute):
    """A revolute joint without limits; differences are the short way round."""

    name, moves_as = "continuous", "revolute"

    @staticmethod
    def difference(joint: JointNumbers, q: Numbers, q2: Numbers):
        return (shortest_angle(q2[0] - q[0]),)
