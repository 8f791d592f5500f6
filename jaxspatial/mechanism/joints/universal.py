"""The joint that turns about two axes, one after the other."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind
from jaxspatial.mechanism.joints.geometry import rotate_back, rotation_about
from jaxspatial.mechanism.joints.parameter import AXIS, SECOND_AXIS


class Universal(JointKind):
    """Turns about the first axis, and then about the second, that the first carries: q two angles, rad."""

    name, nq, nv, angles, neutral = "universal", 2, 2, (0, 1), (0.0, 0.0)
    parameters = AXIS, SECOND_AXIS

    def transform(self, q: Numbers, cos_sin: CosSin):
        first, second = rotation_about(self.axis, *cos_sin[0]), rotation_about(self.second_axis, *cos_sin[1])
        return vectors.matrix_product(first, second), self.zero_vector

    def motion_subspace(self, cos_sin: CosSin):
        return self.torques([self._first_axis_in_child(cos_sin), self.second_axis])

    def motion_subspace_rate(self, cos_sin: CosSin, v: Numbers):
        """The first axis turns back in the child's axes, at -q2' k2."""
        turning = vectors.cross(self._first_axis_in_child(cos_sin), self.second_axis)
        return self.torques([vectors.times(v[1], turning), self.zero_vector])

    def constraint_subspace(self, cos_sin: CosSin):
        """The torque is across both axes: shorter than 1 where they are not perpendicular, 0 where they are one."""
        across = vectors.cross(self._first_axis_in_child(cos_sin), self.second_axis)
        return *self.torques([across]), *self.forces(self.unit_vectors)

    def _first_axis_in_child(self, cos_sin: CosSin):
        return rotate_back(rotation_about(self.second_axis, *cos_sin[1]), self.axis)
