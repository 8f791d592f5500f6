"""The joint of a body that nothing holds."""

import jax
import jax.numpy as jnp

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Number, Numbers
from jaxspatial.arithmetic.types import Key
from jaxspatial.mechanism.joints.ball import Ball, quaternion_between, random_quaternion
from jaxspatial.mechanism.joints.form import CosSin
from jaxspatial.mechanism.joints.geometry import rotate_back
from jaxspatial.rotation import exponential, quaternion


class Free(Ball):
    """Holds nothing: q = (quaternion wxyz, p_PoBo_P), v = V_PB_B, angular first, both in the child's axes."""

    name, nq, nv, is_unconstrained, turns_its_axes = "free", 7, 6, True, True
    neutral = (1.0, *[0.0] * 6)

    def transform(self, q: Numbers, cos_sin: CosSin):
        return quaternion.to_matrix(q[:4]), tuple(q[4:])

    def motion_subspace(self, cos_sin: CosSin):
        return *super().motion_subspace(cos_sin), *self.forces(self.unit_vectors)

    def constraint_subspace(self, cos_sin: CosSin):
        return ()

    def rates(self, q: Numbers, cos_sin: CosSin, v: Numbers):
        return *super().rates(q[:4], cos_sin, v[:3]), *vectors.matrix_times(quaternion.to_matrix(q[:4]), v[3:])

    def integrate(self, q: Numbers, step: Numbers):
        turn, p = exponential.screw(step[:3], step[3:])
        turned = vectors.unit(quaternion.hamilton_product(q[:4], turn))
        return *turned, *vectors.plus(q[4:], vectors.matrix_times(quaternion.to_matrix(q[:4]), p))

    def transport(self, v: Numbers):
        return *self.zero_vector, *vectors.cross(v[:3], v[3:])

    def advance(self, q: Numbers, v: Numbers, dt: Number):
        step = vectors.times(dt, v)
        turn = exponential.to_quaternion(step[:3])
        turned = vectors.unit(quaternion.hamilton_product(q[:4], turn))
        p = vectors.plus(q[4:], vectors.matrix_times(quaternion.to_matrix(q[:4]), step[3:]))
        return (*turned, *p), (*v[:3], *rotate_back(quaternion.to_matrix(turn), v[3:]))

    def difference(self, q: Numbers, q2: Numbers):
        arm = rotate_back(quaternion.to_matrix(q[:4]), vectors.minus(q2[4:], q[4:]))
        w, v = exponential.motion_logarithm(quaternion.to_matrix(quaternion_between(q[:4], q2[:4])), arm)
        return *w, *v

    @classmethod
    def random(cls, key: Key, lower: jax.Array, upper: jax.Array, batch_shape: tuple[int, ...]):
        """Orientations are uniform, positions within 1 m."""
        p = jax.random.uniform(jax.random.split(key)[0], (*batch_shape, 3), lower.dtype, -1, 1)
        return jnp.concatenate([random_quaternion(key, batch_shape, lower.dtype), p], -1)

    def deflection(self, reference: Numbers, q: Numbers):
        """Of the position, along the axes of the parent."""
        return vectors.minus(q, reference)

    def generalized_forces(self, q: Numbers, cos_sin: CosSin, forces: Numbers):
        return rotate_back(quaternion.to_matrix(q[:4]), forces)
