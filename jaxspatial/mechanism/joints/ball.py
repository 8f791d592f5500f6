"""The joint that turns about any axis."""

import jax
import jax.numpy as jnp

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Numbers, constant, doubled
from jaxspatial.arithmetic.types import DTypeLike, Key
from jaxspatial.mechanism.joints.form import CosSin, JointKind
from jaxspatial.rotation import exponential, quaternion


class Ball(JointKind):
    """Turns about any axis: q a quaternion wxyz, v = w_PB_B, rad/s."""

    name, nq, nv, neutral, sphere = "ball", 4, 3, (1.0, 0.0, 0.0, 0.0), (4, 3)
    is_sequential = False

    def transform(self, q: Numbers, cos_sin: CosSin):
        return quaternion.to_matrix(q), self.zero_vector

    def motion_subspace(self, cos_sin: CosSin):
        return self.torques(self.unit_vectors)

    def constraint_subspace(self, cos_sin: CosSin):
        return self.forces(self.unit_vectors)

    def rates(self, q: Numbers, cos_sin: CosSin, v: Numbers):
        """q (0, v) / 2."""
        return tuple(doubled(x, -1) for x in quaternion.hamilton_product(q, (constant(v[0], 0), *v)))

    def integrate(self, q: Numbers, step: Numbers):
        return vectors.unit(quaternion.hamilton_product(q, exponential.to_quaternion(step)))

    def difference(self, q: Numbers, q2: Numbers):
        return exponential.from_quaternion(quaternion_between(q, q2))

    @classmethod
    def random(cls, key: Key, lower: jax.Array, upper: jax.Array, batch_shape: tuple[int, ...]):
        """Orientations are uniform."""
        return random_quaternion(key, batch_shape, lower.dtype)

    def sphere_spring(self, q: Numbers, reference: Numbers, stiffness: Numbers):
        """-J^-1 K d of the rotation vector d from the reference, J its left Jacobian: dd/dt = J^-T w."""
        d = Ball.difference(self, reference[:4], q[:4])
        pulls = [-k * x for k, x in zip(stiffness[:3], d, strict=True)]
        return vectors.matrix_times(exponential.left_jacobian_inverse(d), pulls)


def quaternion_between(q: Numbers, q2: Numbers) -> Numbers:
    """conj(q) q2, with real part >= 0."""
    return quaternion.with_positive_real_part(quaternion.hamilton_product((q[0], *(-x for x in q[1:])), q2))


def random_quaternion(key: Key, batch_shape: tuple[int, ...], dtype: DTypeLike):
    """A uniform one: of length 1 along a normal distribution."""
    w, x, y, z = jnp.moveaxis(direction := jax.random.normal(key, (*batch_shape, 4), dtype), -1, 0)
    return direction / jnp.sqrt(w**2 + x**2 + y**2 + z**2)[..., None]
