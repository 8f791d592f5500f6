"""The joint that slides along an axis."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind, JointNumbers
from jaxspatial.mechanism.joints.geometry import forces, perpendicular, torques, unit_vectors
from jaxspatial.mechanism.joints.parameter import AXIS


class Prismatic(JointKind):
    """Slides along the axis: q the distance, m."""

    name, nq, nv = "prismatic", 1, 1
    parameters, is_about_one_axis = (AXIS,), True

    @staticmethod
    def transform(joint: JointNumbers, q: Numbers, cos_sin: CosSin):
        return unit_vectors(joint), vectors.times(q[0], joint.axis)

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin):
        return forces(joint, [joint.axis])

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin):
        return *torques(joint, unit_vectors(joint)), *forces(joint, perpendicular(joint.axis))
