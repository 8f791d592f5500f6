"""Joints with a quaternion: one turns about any axis, the other does not hold the body at all."""

import jax
import jax.numpy as jnp

from jaxspatial.mechanism.joints.kind import CosSin, JointKind
from jaxspatial.numerics.linear import Motion, Pose, Vector, cross, unit
from jaxspatial.numerics.numbers import Number, Numbers, constant, doubled
from jaxspatial.numerics.types import DTypeLike, Key
from jaxspatial.rotation import exponential, quaternion


class Ball(JointKind):
    """Turns about any axis: q a quaternion wxyz, v = w_PB_B, rad/s."""

    name, nq, nv, neutral, sphere = "ball", 4, 3, (1.0, 0.0, 0.0, 0.0), (4, 3)
    is_sequential = False

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(quaternion.to_matrix(q), self.zero_vector)

    def motion_subspace(self, cos_sin: CosSin):
        return self.turns(self.unit_vectors)

    def constraint_subspace(self, cos_sin: CosSin):
        return self.forces(self.unit_vectors)

    def rates(self, q: Numbers, cos_sin: CosSin, v: Numbers):
        """q (0, v) / 2, a product of quaternions."""
        return tuple(doubled(x, -1) for x in quaternion.hamilton_product(q, (constant(v[0], 0), *v)))

    def integrate(self, q: Numbers, step: Numbers):
        return unit(quaternion.hamilton_product(q, exponential.to_quaternion(Vector(*step))))

    def difference(self, q: Numbers, q2: Numbers) -> Numbers:
        return exponential.from_quaternion(_between(q, q2))

    @classmethod
    def random(cls, key: Key, lower: jax.Array, upper: jax.Array, batch_shape: tuple[int, ...]):
        """Orientations are uniform."""
        return _random_quaternion(key, batch_shape, lower.dtype)

    def sphere_spring(self, q: Numbers, reference: Numbers, stiffness: Numbers):
        """-J^-1 K d, with d the rotation vector from the reference and J its left Jacobian: dd/dt = J^-T w."""
        d = Vector(*Ball.difference(self, reference[:4], q[:4]))
        pulls = Vector(*(-k * x for k, x in zip(stiffness[:3], d, strict=True)))
        return exponential.left_jacobian_inverse(d) @ pulls

    def turn(self, q: Numbers) -> Vector:
        """The rotation vector of the joint, the short way round."""
        identity = tuple(constant(q[0], x) for x in (1, 0, 0, 0))
        return Vector(*Ball.difference(self, identity, q[:4]))


class Free(Ball):
    """Holds nothing: q = (quaternion wxyz, p_PoBo_P), v = V_PB_B in the child's axes, angular first."""

    name, nq, nv, is_unconstrained, turned = "free", 7, 6, True, (3, 4, 5)
    neutral = (1.0, *[0.0] * 6)

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(quaternion.to_matrix(q[:4]), Vector(*q[4:]))

    def motion_subspace(self, cos_sin: CosSin):
        return *super().motion_subspace(cos_sin), *self.slides(self.unit_vectors)

    def constraint_subspace(self, cos_sin: CosSin):
        return ()

    def rates(self, q: Numbers, cos_sin: CosSin, v: Numbers):
        return *super().rates(q[:4], cos_sin, v[:3]), *(quaternion.to_matrix(q[:4]) @ Vector(*v[3:]))

    def integrate(self, q: Numbers, step: Numbers):
        turn, p = exponential.screw(Vector(*step[:3]), Vector(*step[3:]))
        turned = unit(quaternion.hamilton_product(q[:4], turn))
        return *turned, *(Vector(*q[4:]) + quaternion.to_matrix(q[:4]) @ p)

    def transport(self, v: Numbers, u: Numbers):
        return *self.zero_vector, *cross(v[:3], u[3:])

    def advance(self, q: Numbers, v: Numbers, dt: Number):
        step = Motion(dt * Vector(*v[:3]), dt * Vector(*v[3:]))
        turn = exponential.to_quaternion(step.w)
        turned = unit(quaternion.hamilton_product(q[:4], turn))
        p = Vector(*q[4:]) + quaternion.to_matrix(q[:4]) @ step.v
        return (*turned, *p), (*v[:3], *(quaternion.to_matrix(turn).T @ Vector(*v[3:])))

    def difference(self, q: Numbers, q2: Numbers):
        arm = quaternion.to_matrix(q[:4]).T @ (Vector(*q2[4:]) - Vector(*q[4:]))
        w, v = exponential.motion_logarithm(quaternion.to_matrix(_between(q[:4], q2[:4])), arm)
        return *w, *v

    @classmethod
    def random(cls, key: Key, lower: jax.Array, upper: jax.Array, batch_shape: tuple[int, ...]):
        """Orientations are uniform, positions within 1 m."""
        p = jax.random.uniform(jax.random.split(key)[0], (*batch_shape, 3), lower.dtype, -1, 1)
        return jnp.concatenate([_random_quaternion(key, batch_shape, lower.dtype), p], -1)

    def deflection(self, reference: Numbers, q: Numbers):
        """The position's, along the axes of the parent."""
        return Vector(*q) - Vector(*reference)

    def generalized_forces(self, q: Numbers, cos_sin: CosSin, forces: Numbers):
        return quaternion.to_matrix(q[:4]).T @ Vector(*forces)


def _between(q: Numbers, q2: Numbers) -> Numbers:
    """conj(q) q2, with real part >= 0."""
    return quaternion.with_positive_real_part(quaternion.hamilton_product((q[0], *(-x for x in q[1:])), q2))


def _random_quaternion(key: Key, batch_shape: tuple[int, ...], dtype: DTypeLike):
    """A uniform unit quaternion: the direction of a normal distribution."""
    w, x, y, z = jnp.moveaxis(direction := jax.random.normal(key, (*batch_shape, 4), dtype), -1, 0)
    return direction / jnp.sqrt(w**2 + x**2 + y**2 + z**2)[..., None]
