"""The joint that turns about two axes, one after the other."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind, JointNumbers
from jaxspatial.mechanism.joints.geometry import forces, rotate_back, rotation_about, torques, unit_vectors, zero_vector
from jaxspatial.mechanism.joints.parameter import AXIS, SECOND_AXIS


class Universal(JointKind):
    """Turns about the first axis, and then about the second, that the first carries: q two angles, rad."""

    name, nq, nv, angles, neutral = "universal", 2, 2, (0, 1), (0.0, 0.0)
    parameters = AXIS, SECOND_AXIS

    @staticmethod
    def transform(joint: JointNumbers, q: Numbers, cos_sin: CosSin):
        first, second = rotation_about(joint.axis, *cos_sin[0]), rotation_about(joint.second_axis, *cos_sin[1])
        return vectors.matrix_product(first, second), zero_vector(joint)

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin):
        return torques(joint, [_first_axis_in_child(joint, cos_sin), joint.second_axis])

    @classmethod
    def motion_subspace_rate(cls, joint: JointNumbers, cos_sin: CosSin, v: Numbers):
        """The first axis turns back in the child's axes, at -q2' k2."""
        turning = vectors.cross(_first_axis_in_child(joint, cos_sin), joint.second_axis)
        return torques(joint, [vectors.times(v[1], turning), zero_vector(joint)])

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin):
        """The torque is across both axes: shorter than 1 where they are not perpendicular, 0 where they are one."""
        across = vectors.cross(_first_axis_in_child(joint, cos_sin), joint.second_axis)
        return *torques(joint, [across]), *forces(joint, unit_vectors(joint))


def _first_axis_in_child(joint: JointNumbers, cos_sin: CosSin):
    return rotate_back(rotation_about(joint.second_axis, *cos_sin[1]), joint.axis)
