"""The form that every kind of joint fills in: what it is made with, its coordinates, and how it moves.

A joint holds the child's frame B against the parent's side P of the joint; both are one frame at zero. The verbs are
formulas over numbers of one joint: a class fills them in and is never instantiated. Their arguments:

    joint       the parameters of the joint, by the names that the kind declares, and `joint.zero`, a number 0
    q, v, step  nq coordinates; nv rates; nv rates times a time
    cos_sin     {k: (cosine, sine)} of the coordinates k that `angles` lists: computed for all joints at once

A zero or one of an axis that is known while tracing leaves no operation behind. [Featherstone 2008, tables 4.1, 4.2]
"""

import collections
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp

from jaxspatial.arithmetic import vectors
from jaxspatial.mechanism.joints.geometry import JointNumbers, Number, Rows, Six, Vector
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
        many rates, the first, are theirs
    moves_as: the name of the kind that the dynamics takes it for; its own, unless a kind differs in coordinates alone
    is_about_one_axis: whether it turns about and slides along `joint.axis` alone: the dynamics may turn its frame then,
        so that this is z. Its other parameters have to be lengths and the like, not directions
    is_unconstrained: whether it holds nothing, and S is the identity: a floating root's rates are found all at once
    is_sequential: whether it moves as joints with one rate each, one after the other
    rates_need_angles: whether `rates` asks for `cos_sin`
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
    _Numbers: Callable[..., Any]

    def __init_subclass__(cls):
        cls.moves_as = vars(cls).get("moves_as", cls.name)
        # A named tuple, of fields that no text can declare: they are those of the kind.
        names = [*(p.name for p in cls.parameters), "zero"]
        cls._Numbers = collections.namedtuple("_Numbers", names)  # pyright: ignore[reportUntypedNamedTuple]

    @classmethod
    def numbers(cls, of: Callable[[Parameter], Any], zero: Number) -> Any:
        """The `joint` of the verbs: of(parameter) is its number, or the tuple of its numbers."""
        return cls._Numbers(*map(of, cls.parameters), zero)

    # -- how it moves -------------------------------------------------------------------------------------------------

    @staticmethod
    def transform(joint: JointNumbers, q: Sequence[Number], cos_sin: CosSin) -> tuple[Rows, Vector]:
        """X_PB as (R_PB by its rows, p_PoBo_P)."""
        raise NotImplementedError

    @staticmethod
    def motion_subspace(joint: JointNumbers, cos_sin: CosSin) -> tuple[Six, ...]:
        """The nv motions (w_PB_B, v_PBo_B) per rate, in the child's axes: the columns of S."""
        raise NotImplementedError

    @classmethod
    def motion_subspace_rate(cls, joint: JointNumbers, cos_sin: CosSin, v: Sequence[Number]) -> tuple[Six, ...]:
        """dS/dt, nv motions: the rates of the entries of S in the child's axes. Zero where S is constant in these."""
        zero = (joint.zero,) * 3
        return ((zero, zero),) * cls.nv

    @staticmethod
    def constraint_subspace(joint: JointNumbers, cos_sin: CosSin) -> tuple[Six, ...]:
        """A basis of the 6 - nv wrenches (tau, f) that the joint takes up, about Bo in the child's axes: those with no
        power on any motion of S. [Featherstone 2008, 3.2 and table 4.1]"""
        raise NotImplementedError

    # -- its coordinates ----------------------------------------------------------------------------------------------

    @staticmethod
    def rates(joint: JointNumbers, q: Sequence[Number], cos_sin: CosSin, v: Sequence[Number]) -> Sequence[Number]:
        """dq/dt, nq numbers, of the rates v."""
        return v

    @staticmethod
    def integrate(joint: JointNumbers, q: Sequence[Number], step: Sequence[Number]) -> Sequence[Number]:
        """q after the motion S step, that is as constant in B as S is."""
        return vectors.plus(q, step)

    @staticmethod
    def difference(joint: JointNumbers, q: Sequence[Number], q2: Sequence[Number]) -> Sequence[Number]:
        """The step that integrates q to q2, the short way round."""
        return vectors.minus(q2, q)

    @classmethod
    def random(cls, key: jax.Array, lower: jax.Array, upper: jax.Array, batch_shape: tuple[int, ...]) -> jax.Array:
        """Random coordinates (*batch_shape, nq), in the dtype of the limits lower and upper (nq,): uniform between
        these where both are finite; else angles within half a turn, lengths within 1 m."""
        usual = jnp.asarray([math.pi if k in cls.angles else 1.0 for k in range(cls.nq)], lower.dtype)
        has_two, shape = jnp.isfinite(lower) & jnp.isfinite(upper), (*batch_shape, cls.nq)
        lower, upper = (jnp.where(has_two, x, y) for x, y in ((lower, -usual), (upper, usual)))
        lower, upper = (jnp.broadcast_to(x, shape) for x in (lower, upper))
        return lower + (upper - lower) * jax.random.uniform(key, shape, lower.dtype)

    # -- springs and limits on coordinates ----------------------------------------------------------------------------

    @classmethod
    def sphere_spring(
        cls, joint: JointNumbers, q: Sequence[Number], reference: Sequence[Number], stiffness: Sequence[Number]
    ) -> Sequence[Number]:
        """The generalized forces of a spring on the coordinates of the sphere, at their rates: with one rate, of the
        angle from the reference."""
        turn = cls.difference(joint, reference, q)
        return tuple(-k * x for k, x in zip(stiffness, turn, strict=False))

    @classmethod
    def deflection(cls, joint: JointNumbers, reference: Sequence[Number], q: Sequence[Number]) -> Sequence[Number]:
        """How far the coordinates that are not of the sphere are from the reference; given are these alone."""
        return cls.difference(joint, reference, q)

    @staticmethod
    def generalized_forces(
        joint: JointNumbers, q: Sequence[Number], cos_sin: CosSin, forces: Sequence[Number]
    ) -> Sequence[Number]:
        """Of forces along the coordinates that are not of the sphere, at the rates of these: by the transpose of
        `rates`."""
        return forces
