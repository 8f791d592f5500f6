"""The joint that slides along an axis."""

from jaxspatial.arithmetic import vectors
from jaxspatial.mechanism.joints.form import JointKind
from jaxspatial.mechanism.joints.geometry import forces, perpendicular, torques, unit_vectors
from jaxspatial.mechanism.joints.parameter import AXIS


class Prismatic(JointKind):
    """Slides along the axis: q the distance, m."""

    name, nq, nv = "prismatic", 1, 1
    parameters, is_about_one_axis = (AXIS,), True

    @staticmethod
    def transform(joint, q, cos_sin):
        return unit_vectors(joint), vectors.times(q[0], joint.axis)

    @staticmethod
    def motion_subspace(joint, cos_sin):
        return forces(joint, [joint.axis])

    @staticmethod
    def constraint_subspace(joint, cos_sin):
        return *torques(joint, unit_vectors(joint)), *forces(joint, perpendicular(joint.axis))
