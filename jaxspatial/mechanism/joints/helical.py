"""The joint that is a screw."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind
from jaxspatial.mechanism.joints.geometry import perpendicular, rotation_about
from jaxspatial.mechanism.joints.parameter import AXIS, PITCH


class Helical(JointKind):
    """A screw: q the angle, rad, and pitch times it along the axis, m."""

    name, nq, nv, angles = "helical", 1, 1, (0,)
    parameters, is_about_one_axis = (AXIS, PITCH), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return rotation_about(self.axis, *cos_sin[0]), vectors.times(self.pitch * q[0], self.axis)

    def motion_subspace(self, cos_sin: CosSin):
        return ((self.axis, vectors.times(self.pitch, self.axis)),)

    def constraint_subspace(self, cos_sin: CosSin):
        across, back = perpendicular(self.axis), vectors.times(-self.pitch, self.axis)
        return *self.torques(across), *self.forces(across), (back, self.axis)
