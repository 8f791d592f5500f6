"""The joint that does not move."""

from jaxspatial.mechanism.joints.form import JointKind
from jaxspatial.mechanism.joints.geometry import forces, torques, unit_vectors, zero_vector


class Fixed(JointKind):
    """Welds two bodies."""

    name, nq, nv, neutral = "fixed", 0, 0, ()

    @staticmethod
    def transform(joint, q, cos_sin):
        return unit_vectors(joint), zero_vector(joint)

    @staticmethod
    def motion_subspace(joint, cos_sin):
        return ()

    @staticmethod
    def constraint_subspace(joint, cos_sin):
        return *torques(joint, unit_vectors(joint)), *forces(joint, unit_vectors(joint))
