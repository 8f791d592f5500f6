"""The joint that slides along an axis."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind
from jaxspatial.mechanism.joints.geometry import perpendicular
from jaxspatial.mechanism.joints.parameter import AXIS


class Prismatic(JointKind):
    """Slides along the axis: q the distance, m."""

    name, nq, nv = "prismatic", 1, 1
    parameters, is_about_one_axis = (AXIS,), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return self.unit_vectors, vectors.times(q[0], self.axis)

    def motion_subspace(self, cos_sin: CosSin):
        return self.forces([self.axis])

    def constraint_subspace(self, cos_sin: CosSin):
        return *self.torques(self.unit_vectors), *self.forces(perpendicular(self.axis))
