"""The joint that turns about an axis and slides along it."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind
from jaxspatial.mechanism.joints.geometry import perpendicular, rotation_about
from jaxspatial.mechanism.joints.parameter import AXIS


class Cylindrical(JointKind):
    """Turns about the axis and slides along it: q the angle, rad, and the distance, m."""

    name, nq, nv, angles, neutral = "cylindrical", 2, 2, (0,), (0.0, 0.0)
    parameters, is_about_one_axis = (AXIS,), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return rotation_about(self.axis, *cos_sin[0]), vectors.times(q[1], self.axis)

    def motion_subspace(self, cos_sin: CosSin):
        return *self.torques([self.axis]), *self.forces([self.axis])

    def constraint_subspace(self, cos_sin: CosSin):
        across = perpendicular(self.axis)
        return *self.torques(across), *self.forces(across)
