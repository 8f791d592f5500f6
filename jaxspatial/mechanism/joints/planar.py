"""The joint that moves in a plane."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.functions import cosine_sine
from jaxspatial.arithmetic.numbers import Numbers, constant
from jaxspatial.mechanism.joints.form import CosSin, JointKind, JointNumbers
from jaxspatial.mechanism.joints.geometry import (
    forces,
    rotation_about,
    shortest_angle,
    torques,
    unit_vector,
    zero_vector,
)
from jaxspatial.rotation import exponential


class Planar(JointKind):
    """Slides in the plane of x and y and turns about z: q = (x, y, angle), m and rad, in the parent's axes.

    v = (x, y, angular) is in the child's axes, so that the subspace is constant.
    """

    name, nq, nv, angles, neutral = "planar", 3, 3, (2,), (0.0, 0.0, 0.0)
    is_sequential, rates_need_angles = False, True

    @staticmethod
    def transform(joint: JointNumbers, q: Numbers, cos_sin: CosSin):
        return rotation_about(unit_vector(joint, 2), *cos_sin[2]), (q[0], q[1], constant(joint.zero, 0))

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin):
        x, y, z = (unit_vector(joint, k) for k in range(3))
        return *forces(joint, [x, y]), *torques(joint, [z])

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin):
        x, y, z = (unit_vector(joint, k) for k in range(3))
        return *torques(joint, [x, y]), *forces(joint, [z])

    @staticmethod
    def rates(joint: JointNumbers, q: Numbers, cos_sin: CosSin, v: Numbers):
        c, s = cos_sin[2]
        return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]

    @staticmethod
    def integrate(joint: JointNumbers, q: Numbers, step: Numbers):
        c, s = cosine_sine(q[2])
        turn, arm = (*zero_vector(joint)[:2], step[2]), (*step[:2], constant(joint.zero, 0))
        x, y, _ = exponential.translation(turn, arm)
        return q[0] + (c * x - s * y), q[1] + (s * x + c * y), q[2] + step[2]

    @staticmethod
    def difference(joint: JointNumbers, q: Numbers, q2: Numbers):
        c, s = cosine_sine(q[2])
        x, y, turn = q2[0] - q[0], q2[1] - q[1], shortest_angle(q2[2] - q[2])
        axis, arm = (*zero_vector(joint)[:2], turn), (c * x + s * y, c * y - s * x, constant(joint.zero, 0))
        return (*vectors.matrix_times(exponential.left_jacobian_inverse(axis), arm)[:2], turn)

    @classmethod
    def deflection(cls, joint: JointNumbers, reference: Numbers, q: Numbers):
        """Along the axes of the parent, and the angle."""
        x, y, turn = vectors.minus(q, reference)
        return x, y, shortest_angle(turn)

    @staticmethod
    def generalized_forces(joint: JointNumbers, q: Numbers, cos_sin: CosSin, forces: Numbers):
        c, s = cos_sin[2]
        return c * forces[0] + s * forces[1], c * forces[1] - s * forces[0], forces[2]
