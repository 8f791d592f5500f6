"""The joint that does not move."""

from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind


class Fixed(JointKind):
    """Welds two bodies."""

    name, nq, nv, neutral = "fixed", 0, 0, ()

    def transform(self, q: Numbers, cos_sin: CosSin):
        return self.unit_vectors, self.zero_vector

    def motion_subspace(self, cos_sin: CosSin):
        return ()

    def constraint_subspace(self, cos_sin: CosSin):
        return *self.torques(self.unit_vectors), *self.forces(self.unit_vectors)
