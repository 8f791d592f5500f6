"""The joint that moves in a plane."""

from jaxspatial.mechanism.joints.geometry import rotation_about, shortest_angle
from jaxspatial.mechanism.joints.kind import CosSin, JointKind
from jaxspatial.numerics.functions import cosine_sine
from jaxspatial.numerics.linear import Pose, Vector
from jaxspatial.numerics.numbers import Number, Numbers
from jaxspatial.rotation import exponential


class Planar(JointKind):
    """Slides in the plane of x and y and turns about z: q = (x, y, angle), m and rad, in the parent's axes.

    v = (x, y, angular) is in the child's axes, so that the subspace is constant.
    """

    name, nq, nv, angles, neutral = "planar", 3, 3, (2,), (0.0, 0.0, 0.0)
    is_sequential, rates_need_angles, turned = False, True, (0, 1)

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(rotation_about(self.unit_vectors.z, *cos_sin[2]), Vector(q[0], q[1], self.zero))

    def motion_subspace(self, cos_sin: CosSin):
        x, y, z = self.unit_vectors
        return *self.slides([x, y]), *self.turns([z])

    def constraint_subspace(self, cos_sin: CosSin):
        x, y, z = self.unit_vectors
        return *self.couples([x, y]), *self.forces([z])

    def rates(self, q: Numbers, cos_sin: CosSin, v: Numbers):
        c, s = cos_sin[2]
        return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]

    def integrate(self, q: Numbers, step: Numbers):
        c, s = cosine_sine(q[2])
        turn, arm = Vector(self.zero, self.zero, step[2]), Vector(step[0], step[1], self.zero)
        x, y, _ = exponential.translation(turn, arm)
        return q[0] + (c * x - s * y), q[1] + (s * x + c * y), q[2] + step[2]

    def transport(self, v: Numbers, u: Numbers):
        return -(v[2] * u[1]), v[2] * u[0], self.zero

    def advance(self, q: Numbers, v: Numbers, dt: Number):
        (c, s), turn = cosine_sine(q[2]), dt * v[2]
        x, y = dt * v[0], dt * v[1]
        after = q[0] + (c * x - s * y), q[1] + (s * x + c * y), q[2] + turn
        c, s = cosine_sine(turn)
        return after, (c * v[0] + s * v[1], c * v[1] - s * v[0], v[2])

    def difference(self, q: Numbers, q2: Numbers):
        c, s = cosine_sine(q[2])
        x, y, turn = q2[0] - q[0], q2[1] - q[1], shortest_angle(q2[2] - q[2])
        axis, arm = Vector(self.zero, self.zero, turn), Vector(c * x + s * y, c * y - s * x, self.zero)
        return (*(exponential.left_jacobian_inverse(axis) @ arm)[:2], turn)

    def deflection(self, reference: Numbers, q: Numbers):
        """Along the axes of the parent, and the angle."""
        x, y, turn = Vector(*q) - Vector(*reference)
        return x, y, shortest_angle(turn)

    def generalized_forces(self, q: Numbers, cos_sin: CosSin, forces: Numbers):
        c, s = cos_sin[2]
        return c * forces[0] + s * forces[1], c * forces[1] - s * forces[0], forces[2]
