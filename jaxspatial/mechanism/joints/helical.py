"""The joint that is a screw."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind, JointNumbers
from jaxspatial.mechanism.joints.geometry import forces, perpendicular, rotation_about, torques
from jaxspatial.mechanism.joints.parameter import AXIS, PITCH


class Helical(JointKind):
    """A screw: q the angle, rad, and pitch times it along the axis, m."""

    name, nq, nv, angles = "helical", 1, 1, (0,)
    parameters, is_about_one_axis = (AXIS, PITCH), True

    @staticmethod
    def transform(joint: JointNumbers, q: Numbers, cos_sin: CosSin):
        return rotation_about(joint.axis, *cos_sin[0]), vectors.times(joint.pitch * q[0], joint.axis)

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin):
        return ((joint.axis, vectors.times(joint.pitch, joint.axis)),)

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin):
        across, back = perpendicular(joint.axis), vectors.times(-joint.pitch, joint.axis)
        return *torques(joint, across), *forces(joint, across), (back, joint.axis)
