"""The joint that turns about an axis and slides along it."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind, JointNumbers
from jaxspatial.mechanism.joints.geometry import forces, perpendicular, rotation_about, torques
from jaxspatial.mechanism.joints.parameter import AXIS


class Cylindrical(JointKind):
    """Turns about the axis and slides along it: q the angle, rad, and the distance, m."""

    name, nq, nv, angles, neutral = "cylindrical", 2, 2, (0,), (0.0, 0.0)
    parameters, is_about_one_axis = (AXIS,), True

    @staticmethod
    def transform(joint: JointNumbers, q: Numbers, cos_sin: CosSin):
        return rotation_about(joint.axis, *cos_sin[0]), vectors.times(q[1], joint.axis)

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin):
        return *torques(joint, [joint.axis]), *forces(joint, [joint.axis])

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin):
        across = perpendicular(joint.axis)
        return *torques(joint, across), *forces(joint, across)
