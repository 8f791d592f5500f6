"""Joints that turn about an axis."""

from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind
from jaxspatial.mechanism.joints.geometry import perpendicular, rotation_about, shortest_angle
from jaxspatial.mechanism.joints.parameter import AXIS


class Revolute(JointKind):
    """Turns about the axis: q the angle, rad."""

    name, nq, nv, angles = "revolute", 1, 1, (0,)
    parameters, is_about_one_axis = (AXIS,), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return rotation_about(self.axis, *cos_sin[0]), self.zero_vector

    def motion_subspace(self, cos_sin: CosSin):
        return self.torques([self.axis])

    def constraint_subspace(self, cos_sin: CosSin):
        return *self.torques(perpendicular(self.axis)), *self.forces(self.unit_vectors)


class Continuous(Revolute):
    """A revolute joint without limits; differences are the short way round."""

    name, moves_as = "continuous", "revolute"

    def difference(self, q: Numbers, q2: Numbers):
        return (shortest_angle(q2[0] - q[0]),)
