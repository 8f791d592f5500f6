"""What every kind of joint declares: its parameters, its coordinates, and how it moves.

A joint holds the child's frame B against the parent's side P of the joint; both frames coincide at zero. The methods
are formulas over the numbers of one joint, an instance of its kind: it has its parameters by their names, and `zero`, a
number 0. Their arguments:

    q, v, step  nq coordinates, a quaternion among them of unit length; nv generalized velocities; velocities times time
    cos_sin     {k: (cosine, sine)} of the coordinates k that `angles` lists: computed for all joints at once

Where an axis has zeros and ones that are known while tracing, they leave no operation in the program.
[Featherstone 2008, tables 4.1, 4.2]
"""

import dataclasses
import functools
import math
import operator
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.numerics import linear
from jaxspatial.numerics.linear import Matrix, Motion, Pose, Vector, Wrench, entrywise
from jaxspatial.numerics.numbers import Number, Numbers, constant
from jaxspatial.numerics.quantity import rebuilt
from jaxspatial.numerics.types import Key

# {coordinate: (cosine, sine)}
CosSin = Mapping[int, tuple[Number, Number]]


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A number, or a vector, that joints of a kind have; m, rad or what the kind says.

    name: its key in a joint's `parameters`, and in `Mechanism.parameters`, arrays (n, size) of all joints
    size: how many numbers it is
    default: its value where a joint gives none
    is_direction: whether it is scaled to a unit vector
    field: the field of a Mechanism that holds it, for the three below, which joints have as attributes; else None
    """

    name: str
    size: int = 1
    default: float | tuple[float, ...] = 0.0
    is_direction: bool = False
    field: str | None = None


# What the joint turns about or slides along, in its frame J; for "universal" the second axis is carried by the first.
AXIS = Parameter("axis", 3, (0.0, 0.0, 1.0), is_direction=True, field="axes")
SECOND_AXIS = Parameter("second_axis", 3, (1.0, 0.0, 0.0), is_direction=True, field="second_axes")
# Metres per radian.
PITCH = Parameter("pitch", field="pitches")
OF_EVERY_JOINT = AXIS, SECOND_AXIS, PITCH


class JointKind:
    """Base of all kinds of joints. To add one, subclass it and fill in its attributes and methods.

    The methods here serve joints whose coordinates are plain numbers with the velocities as their derivatives: these
    need only `transform` and `motion_subspace`. Where S varies in the child's axes they need `motion_subspace_rate`,
    too. Where it depends on coordinates that are no angles, as that of a cam which slides by a q^2 / 2, set
    `subspace_needs_q`: both methods get q first then.

    name: the value of `Joint.kind`
    nq, nv: the numbers of coordinates and of generalized velocities
    parameters: what joints of this kind have besides their poses
    neutral: the coordinates at zero
    angles: which coordinates are angles, in radians
    sphere: how many coordinates, the first ones, are a point of a unit sphere (a quaternion, or sine and cosine), and
        how many velocities, the first ones, are theirs. The methods get the point normalised
    moves_as: the name of the kind that moves the same way, for kinds that differ in coordinates alone; else its own
    is_about_one_axis: whether it turns about and slides along `joint.axis` alone: the dynamics may turn its frame then,
        so that this is z. Its other parameters must be scalars such as lengths, not directions
    is_unconstrained: whether it has six velocities and S is the identity: a floating root is solved all at once
    is_sequential: whether it moves as joints with one velocity each, in series
    rates_need_angles: whether `rates` needs `cos_sin`
    subspace_needs_q: whether `motion_subspace`, `motion_subspace_rate` and `constraint_subspace` take q before their
        other arguments: of S that depends on coordinates which are no angles. Whole Jacobians of inverse dynamics are
        then computed column by column, and not in closed form
    turned: which velocities are linear, along axes that the joint itself turns: then it overrides `transport` and
        `advance`
    """

    name: str
    nq: int
    nv: int
    parameters: tuple[Parameter, ...] = ()
    neutral: tuple[float, ...] = (0.0,)
    angles: tuple[int, ...] = ()
    sphere: tuple[int, int] = (0, 0)
    moves_as: str
    is_about_one_axis: bool = False
    is_unconstrained: bool = False
    is_sequential: bool = True
    rates_need_angles: bool = False
    subspace_needs_q: bool = False
    turned: tuple[int, ...] = ()

    # Numbers of a joint; the parameters where its kind has them.
    zero: Number
    axis: Vector
    second_axis: Vector
    pitch: Number

    def __init_subclass__(cls):
        cls.moves_as = vars(cls).get("moves_as", cls.name)
        jax.tree_util.register_pytree_node(
            cls, lambda joint: (tuple(vars(joint).values()), tuple(vars(joint))), functools.partial(rebuilt, cls)
        )

    def __init__(self, of: Callable[[Parameter], Any], zero: Number):
        """`of` returns the number of a parameter, or the tuple of its numbers."""
        numbers = {p.name: of(p) for p in self.parameters}
        vars(self).update(
            {name: linear.by_size(x) if isinstance(x, tuple) else x for name, x in numbers.items()}, zero=zero
        )

    # -- how it moves -------------------------------------------------------------------------------------------------

    def transform(self, q: Numbers, cos_sin: CosSin) -> Pose:
        """The pose X_PB."""
        raise NotImplementedError

    def motion_subspace(self, cos_sin: CosSin) -> tuple[Motion, ...]:
        """The columns of S: the nv motions (w_PB_B, v_PBo_B) per unit velocity, in the child's axes.

        With `subspace_needs_q` it is `motion_subspace(self, q, cos_sin)`, and so are the next two."""
        raise NotImplementedError

    def motion_subspace_rate(self, cos_sin: CosSin, v: Numbers) -> tuple[Motion, ...]:
        """dS/dt, nv motions: the derivatives of the entries of S in the child's axes; 0 where S is constant there."""
        return (Motion(self.zero_vector, self.zero_vector),) * self.nv

    def constraint_subspace(self, cos_sin: CosSin) -> tuple[Wrench, ...]:
        """A basis of the 6 - nv wrenches (tau, f) of constraint, about Bo in the child's axes: those without power on
        all motions of S. [Featherstone 2008, 3.2 and table 4.1]"""
        raise NotImplementedError

    # -- parts of these -----------------------------------------------------------------------------------------------

    @property
    def zero_vector(self) -> Vector:
        return Vector(self.zero, self.zero, self.zero)

    @property
    def unit_vectors(self) -> Matrix:
        """The axes of the child: the identity."""
        zero, one = constant(self.zero, 0), constant(self.zero, 1)
        return Matrix(Vector(one, zero, zero), Vector(zero, one, zero), Vector(zero, zero, one))

    def turns(self, axes: Iterable[Vector]) -> tuple[Motion, ...]:
        """The motions (axis, 0)."""
        return tuple(Motion(k, self.zero_vector) for k in axes)

    def slides(self, axes: Iterable[Vector]) -> tuple[Motion, ...]:
        """The motions (0, axis)."""
        return tuple(Motion(self.zero_vector, k) for k in axes)

    def couples(self, axes: Iterable[Vector]) -> tuple[Wrench, ...]:
        """The wrenches (axis, 0)."""
        return tuple(Wrench(k, self.zero_vector) for k in axes)

    def forces(self, axes: Iterable[Vector]) -> tuple[Wrench, ...]:
        """The wrenches (0, axis)."""
        return tuple(Wrench(self.zero_vector, k) for k in axes)

    # -- its coordinates ----------------------------------------------------------------------------------------------

    def rates(self, q: Numbers, cos_sin: CosSin, v: Numbers) -> Numbers:
        """dq/dt, nq numbers, at the velocities v. For coordinates on a sphere it is in proportion to their length."""
        return v

    def integrate(self, q: Numbers, step: Numbers) -> Numbers:
        """q after a step: the motion S step, constant in B where S is."""
        return tuple(entrywise(operator.add, q, step))

    def transport(self, v: Numbers, u: Numbers) -> Numbers:
        """-du/dt of velocities u that are constant in the parent's axes, while the joint moves with v: w x u for linear
        ones. It is linear in v and in u."""
        return (self.zero,) * self.nv

    def advance(self, q: Numbers, v: Numbers, dt: Number) -> tuple[Numbers, Numbers]:
        """(q, v) after the time dt at constant velocity: linear ones go straight ahead in the parent's axes. v is along
        the axes at the old q, the result along those at the new q."""
        return self.integrate(q, tuple(dt * x for x in v)), v

    def difference(self, q: Numbers, q2: Numbers) -> Numbers:
        """The step that `integrate` takes from q to q2, the short way round."""
        return tuple(entrywise(operator.sub, q2, q))

    @classmethod
    def random(cls, key: Key, lower: jax.Array, upper: jax.Array, batch_shape: tuple[int, ...]) -> jax.Array:
        """Random coordinates (*batch_shape, nq) in the dtype of the limits lower and upper (nq,): uniform between them
        where both are finite; else angles within half a turn, lengths within 1 m."""
        usual = np.array([math.pi if k in cls.angles else 1.0 for k in range(cls.nq)], lower.dtype)
        has_two, shape = jnp.isfinite(lower) & jnp.isfinite(upper), (*batch_shape, cls.nq)
        lower, upper = (jnp.where(has_two, x, y) for x, y in ((lower, -usual), (upper, usual)))
        lower, upper = (jnp.broadcast_to(x, shape) for x in (lower, upper))
        return lower + (upper - lower) * jax.random.uniform(key, shape, lower.dtype)

    # -- springs and limits -------------------------------------------------------------------------------------------

    def sphere_spring(self, q: Numbers, reference: Numbers, stiffness: Numbers) -> Numbers:
        """The generalized forces of a spring on the coordinates of the sphere; here those of one with one velocity, -k
        times the angle from the reference."""
        turn = self.difference(reference, q)
        return tuple(-k * x for k, x in zip(stiffness, turn, strict=False))

    def deflection(self, reference: Numbers, q: Numbers) -> Numbers:
        """The differences of the coordinates that are not of the sphere from the reference. It gets these alone."""
        return self.difference(reference, q)

    def generalized_forces(self, q: Numbers, cos_sin: CosSin, forces: Numbers) -> Numbers:
        """The generalized forces of forces along the coordinates that are not of the sphere: the transpose of `rates`
        times them."""
        return forces
