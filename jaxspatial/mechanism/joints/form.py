"""The form that every kind of joint fills in: what it is made with, its coordinates, and how it moves.

A joint holds the child's frame B against the parent's side P of the joint; both are one frame at zero. The verbs are
formulas over the numbers of one joint, an instance of its kind, which has its parameters by the names that the kind
declares, and `zero`, a number 0. Their arguments:

    q, v, step  nq coordinates, a quaternion among them of unit length; nv rates; nv rates times a time
    cos_sin     {k: (cosine, sine)} of the coordinates k that `angles` lists: computed for all joints at once

A zero or one of an axis that is known while tracing leaves no operation behind. [Featherstone 2008, tables 4.1, 4.2]
"""

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import tree, vectors
from jaxspatial.arithmetic.numbers import constant
from jaxspatial.arithmetic.types import Key
from jaxspatial.mechanism.joints.geometry import Number, Rows, Six, Vector
from jaxspatial.mechanism.joints.parameter import Parameter

# By coordinate.
CosSin = Mapping[int, tuple[Number, Number]]


class JointKind:
    """Base of all kinds. What stands here serves joints whose coordinates are numbers with their rates as derivatives.

    name: what `Joint.kind` says
    nq, nv: how many coordinates and rates there are
    parameters: what a joint of this kind is made with
    neutral: the coordinates at zero
    angles: which coordinates are angles, in radians
    sphere: how many coordinates, the first, are a point of a unit sphere (a quaternion, or sine and cosine), and how
        many rates, the first, are theirs. Whatever their length is, the verbs get the point in their direction
    moves_as: the name of the kind that the dynamics takes it for; its own, unless a kind differs in coordinates alone
    is_about_one_axis: whether it turns about and slides along `joint.axis` alone: the dynamics may turn its frame then,
        so that this is z. Its other parameters have to be lengths and the like, not directions
    is_unconstrained: whether it holds nothing, and S is the identity: a floating root's rates are found all at once
    is_sequential: whether it moves as joints with one rate each, one after the other
    rates_need_angles: whether `rates` asks for `cos_sin`
    turns_its_axes: whether linear rates are along axes that the joint itself turns: then it has a `transport` and an
        `advance` of its own
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
    turns_its_axes: bool = False

    # Of a joint, where its kind has them.
    zero: Number
    axis: Vector
    second_axis: Vector
    pitch: Number

    def __init_subclass__(cls):
        cls.moves_as = vars(cls).get("moves_as", cls.name)
        # Its stub is known in part.
        register = jax.tree_util.register_pytree_node  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        register(cls, _numbers_of, functools.partial(tree.rebuilt, cls))

    def __init__(self, of: Callable[[Parameter], Any], zero: Number):
        """of(parameter): its number, or the tuple of its numbers."""
        vars(self).update({p.name: of(p) for p in self.parameters}, zero=zero)

    # -- how it moves -------------------------------------------------------------------------------------------------

    def transform(self, q: Sequence[Number], cos_sin: CosSin) -> tuple[Rows, Vector]:
        """X_PB as (R_PB by its rows, p_PoBo_P)."""
        raise NotImplementedError

    def motion_subspace(self, cos_sin: CosSin) -> tuple[Six, ...]:
        """The nv motions (w_PB_B, v_PBo_B) per rate, in the child's axes: the columns of S."""
        raise NotImplementedError

    def motion_subspace_rate(self, cos_sin: CosSin, v: Sequence[Number]) -> tuple[Six, ...]:
        """dS/dt, nv motions: the rates of the entries of S in the child's axes. Zero where S is constant in these."""
        return ((self.zero_vector, self.zero_vector),) * self.nv

    def constraint_subspace(self, cos_sin: CosSin) -> tuple[Six, ...]:
        """A basis of the 6 - nv wrenches (tau, f) that the joint takes up, about Bo in the child's axes: those with no
        power on any motion of S. [Featherstone 2008, 3.2 and table 4.1]"""
        raise NotImplementedError

    # -- what these consist of ----------------------------------------------------------------------------------------

    @property
    def zero_vector(self) -> Vector:
        return (self.zero,) * 3

    def unit_vector(self, k: int) -> Vector:
        """Axis k of the child."""
        return tuple(constant(self.zero, int(i == k)) for i in range(3))

    @property
    def unit_vectors(self) -> Rows:
        """All three: the identity by its rows."""
        return tuple(map(self.unit_vector, range(3)))

    def torques(self, directions: Iterable[Vector]) -> tuple[Six, ...]:
        """The wrenches, or turns, (direction, 0)."""
        return tuple((k, self.zero_vector) for k in directions)

    def forces(self, directions: Iterable[Vector]) -> tuple[Six, ...]:
        """The wrenches, or translations, (0, direction)."""
        return tuple((self.zero_vector, k) for k in directions)

    # -- its coordinates ----------------------------------------------------------------------------------------------

    def rates(self, q: Sequence[Number], cos_sin: CosSin, v: Sequence[Number]) -> Sequence[Number]:
        """dq/dt, nq numbers, of the rates v. Of what is on the sphere in proportion to its length, which is any."""
        return v

    def integrate(self, q: Sequence[Number], step: Sequence[Number]) -> Sequence[Number]:
        """q after the motion S step, that is as constant in B as S is."""
        return vectors.plus(q, step)

    def transport(self, v: Sequence[Number]) -> Sequence[Number]:
        """How the rates change, negative, where the motion is constant in the parent's axes: w x v of linear rates."""
        return (self.zero,) * self.nv

    def advance(
        self, q: Sequence[Number], v: Sequence[Number], dt: Number
    ) -> tuple[Sequence[Number], Sequence[Number]]:
        """(q, v) after a time of constant rates: linear ones in the parent's axes, straight ahead. v is along the axes
        at q before, and along those at the new q after."""
        return self.integrate(q, vectors.times(dt, v)), v

    def difference(self, q: Sequence[Number], q2: Sequence[Number]) -> Sequence[Number]:
        """The step that integrates q to q2, the short way round."""
        return vectors.minus(q2, q)

    @classmethod
    def random(cls, key: Key, lower: jax.Array, upper: jax.Array, batch_shape: tuple[int, ...]) -> jax.Array:
        """Random coordinates (*batch_shape, nq), in the dtype of the limits lower and upper (nq,): uniform between
        these where both are finite; else angles within half a turn, lengths within 1 m."""
        usual = np.array([math.pi if k in cls.angles else 1.0 for k in range(cls.nq)], lower.dtype)
        has_two, shape = jnp.isfinite(lower) & jnp.isfinite(upper), (*batch_shape, cls.nq)
        lower, upper = (jnp.where(has_two, x, y) for x, y in ((lower, -usual), (upper, usual)))
        lower, upper = (jnp.broadcast_to(x, shape) for x in (lower, upper))
        return lower + (upper - lower) * jax.random.uniform(key, shape, lower.dtype)

    # -- springs and limits on coordinates ----------------------------------------------------------------------------

    def sphere_spring(
        self, q: Sequence[Number], reference: Sequence[Number], stiffness: Sequence[Number]
    ) -> Sequence[Number]:
        """The generalized forces of a spring on the coordinates of the sphere, at their rates: with one rate, of the
        angle from the reference."""
        turn = self.difference(reference, q)
        return tuple(-k * x for k, x in zip(stiffness, turn, strict=False))

    def deflection(self, reference: Sequence[Number], q: Sequence[Number]) -> Sequence[Number]:
        """How far the coordinates that are not of the sphere are from the reference; given are these alone."""
        return self.difference(reference, q)

    def generalized_forces(self, q: Sequence[Number], cos_sin: CosSin, forces: Sequence[Number]) -> Sequence[Number]:
        """Of forces along the coordinates that are not of the sphere, at the rates of these: by the transpose of
        `rates`."""
        return forces


def _numbers_of(joint: JointKind) -> tuple[tuple[Any, ...], tuple[str, ...]]:
    """(its numbers, their names)."""
    return tuple(vars(joint).values()), tuple(vars(joint))
