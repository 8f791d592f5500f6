"""The joint that does not move."""

from jaxspatial.arithmetic.numbers import Numbers
from jaxspatial.mechanism.joints.form import CosSin, JointKind, JointNumbers
from jaxspatial.mechanism.joints.geometry import forces, torques, unit_vectors, zero_vector


class Fixed(JointKind):
    """Welds two bodies."""

    name, nq, nv, neutral = "fixed", 0, 0, ()

    @staticmethod
    def transform(joint: JointNumbers, q: Numbers, cos_sin: CosSin):
        return unit_vectors(joint), zero_vector(joint)

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin):
        return ()

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin):
        return *torques(joint, unit_vectors(joint)), *forces(joint, unit_vectors(joint))
