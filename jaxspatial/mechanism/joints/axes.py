"""Joints along given axes: they turn about them or slide along them. The weld, which does neither, comes first."""

from jaxspatial.mechanism.joints.geometry import perpendicular, rotation_about, shortest_angle
from jaxspatial.mechanism.joints.kind import AXIS, PITCH, SECOND_AXIS, CosSin, JointKind
from jaxspatial.numerics.linear import Motion, Pose, Wrench, cross
from jaxspatial.numerics.numbers import Numbers


class Fixed(JointKind):
    """Welds two bodies: it has no coordinates."""

    name, nq, nv, neutral = "fixed", 0, 0, ()

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(self.unit_vectors, self.zero_vector)

    def motion_subspace(self, cos_sin: CosSin):
        return ()

    def constraint_subspace(self, cos_sin: CosSin):
        return *self.couples(self.unit_vectors), *self.forces(self.unit_vectors)


class Revolute(JointKind):
    """Turns about the axis: q the angle, rad."""

    name, nq, nv, angles = "revolute", 1, 1, (0,)
    parameters, is_about_one_axis = (AXIS,), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(rotation_about(self.axis, *cos_sin[0]), self.zero_vector)

    def motion_subspace(self, cos_sin: CosSin):
        return self.turns([self.axis])

    def constraint_subspace(self, cos_sin: CosSin):
        return *self.couples(perpendicular(self.axis)), *self.forces(self.unit_vectors)


class Continuous(Revolute):
    """A revolute joint without limits; differences go the short way round."""

    name, moves_as = "continuous", "revolute"

    def difference(self, q: Numbers, q2: Numbers):
        return (shortest_angle(q2[0] - q[0]),)


class Prismatic(JointKind):
    """Slides along the axis: q the distance, m."""

    name, nq, nv = "prismatic", 1, 1
    parameters, is_about_one_axis = (AXIS,), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(self.unit_vectors, q[0] * self.axis)

    def motion_subspace(self, cos_sin: CosSin):
        return self.slides([self.axis])

    def constraint_subspace(self, cos_sin: CosSin):
        return *self.couples(self.unit_vectors), *self.forces(perpendicular(self.axis))


class Helical(JointKind):
    """A screw: q the angle, rad, and pitch times it along the axis, m."""

    name, nq, nv, angles = "helical", 1, 1, (0,)
    parameters, is_about_one_axis = (AXIS, PITCH), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(rotation_about(self.axis, *cos_sin[0]), (self.pitch * q[0]) * self.axis)

    def motion_subspace(self, cos_sin: CosSin):
        return (Motion(self.axis, self.pitch * self.axis),)

    def constraint_subspace(self, cos_sin: CosSin):
        across, back = perpendicular(self.axis), -self.pitch * self.axis
        return *self.couples(across), *self.forces(across), Wrench(back, self.axis)


class Cylindrical(JointKind):
    """Turns about the axis and slides along it: q the angle, rad, and the distance, m."""

    name, nq, nv, angles, neutral = "cylindrical", 2, 2, (0,), (0.0, 0.0)
    parameters, is_about_one_axis = (AXIS,), True

    def transform(self, q: Numbers, cos_sin: CosSin):
        return Pose(rotation_about(self.axis, *cos_sin[0]), q[1] * self.axis)

    def motion_subspace(self, cos_sin: CosSin):
        return *self.turns([self.axis]), *self.slides([self.axis])

    def constraint_subspace(self, cos_sin: CosSin):
        across = perpendicular(self.axis)
        return *self.couples(across), *self.forces(across)


class Universal(JointKind):
    """Turns about the first axis, and about the second, which the first carries: q two angles, rad."""

    name, nq, nv, angles, neutral = "universal", 2, 2, (0, 1), (0.0, 0.0)
    parameters = AXIS, SECOND_AXIS

    def transform(self, q: Numbers, cos_sin: CosSin):
        first, second = rotation_about(self.axis, *cos_sin[0]), rotation_about(self.second_axis, *cos_sin[1])
        return Pose(first @ second, self.zero_vector)

    def motion_subspace(self, cos_sin: CosSin):
        return self.turns([self._first_axis_in_child(cos_sin), self.second_axis])

    def motion_subspace_rate(self, cos_sin: CosSin, v: Numbers):
        """In the child's axes the first axis turns with -dq2/dt about the second."""
        turning = cross(self._first_axis_in_child(cos_sin), self.second_axis)
        return self.turns([v[1] * turning, self.zero_vector])

    def constraint_subspace(self, cos_sin: CosSin):
        """The couple is across both axes: shorter than 1 where they are not perpendicular, 0 where they coincide."""
        across = cross(self._first_axis_in_child(cos_sin), self.second_axis)
        return *self.couples([across]), *self.forces(self.unit_vectors)

    def _first_axis_in_child(self, cos_sin: CosSin):
        return rotation_about(self.second_axis, *cos_sin[1]).T @ self.axis
