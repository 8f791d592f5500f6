"""Limits of tendons, and of the angles of "ball" joints, as terms of the convex step.

Each holds a number L(q) whose rate is a linear form of generalized velocities, dL/dt = sum c_j v_j: of a tendon with
the coefficients of the tendon, of the angle of a ball with the axis of its rotation.
"""

import functools
import operator

import jax.numpy as jnp
import numpy as np

from jaxspatial.contact.joints import Limit, Limited, are_equal
from jaxspatial.contact.term import Columns, StepData, TermData
from jaxspatial.contact.world import World, scalars
from jaxspatial.dynamics.passive import over_coordinates
from jaxspatial.engine import stacking
from jaxspatial.engine.stacking import Array
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.joints import Ball
from jaxspatial.numerics.floats import is_infinite, one_array
from jaxspatial.numerics.linear import Motion, dot
from jaxspatial.numerics.numbers import Mask, Number, high, where
from jaxspatial.numerics.quantity import tree_of

# Places of joints among generalized velocities: the j-th of each of m rows, for each j.
Places = tuple[tuple[int, ...], ...]


@tree_of("coordinates", "velocities")
class TendonData(TermData):
    """The limits of m tendons over at most k joints each.

    coordinates, velocities: the places (k, m) of joint j of each tendon in q and in v. coefficients (k m,): those of
    the first joints, of the second ..., zero where a tendon has no more. offset, lower, upper: (m,).
    """

    coordinates: Places
    velocities: Places
    coefficients: Array
    offset: Array
    lower: Array
    upper: Array

    def to_term(self, world: World, step: StepData) -> "LimitsOfForms":
        state, m = world.state, len(self.velocities[0])
        c = tuple(scalars(state, self.coefficients[j * m : (j + 1) * m]) for j in range(len(self.velocities)))
        q = (scalars(state, stacking.rows(state.q, np.array(x))) for x in self.coordinates)
        offset, lower, upper = (scalars(state, x) for x in (self.offset, self.lower, self.upper))
        length = functools.reduce(operator.add, map(operator.mul, c, q), offset)
        is_equal = are_equal(lower, upper, self.lower, self.upper)
        return _limits_of_forms(world, step, self.velocities, c, length - lower, upper - length, is_equal)


def tendon_data(mechanism: Mechanism, dtype: np.dtype) -> TendonData | None:
    """The TendonData of the tendons that have limits; None for none."""
    limited = (x for x in mechanism.tendons if not (is_infinite(x.lower) and is_infinite(x.upper)))
    rows = [(*over_coordinates(mechanism, x), x.lower, x.upper) for x in limited]
    if not rows:
        return None
    k = max(len(places) for places, *_ in rows)
    # A tendon over fewer joints has its first one again, times zero.
    places = [[x[j] if j < len(x) else x[0] for x, *_ in rows] for j in range(k)]
    c = one_array([x[j] if j < len(x) else 0.0 for j in range(k) for _, x, *_ in rows], dtype)
    coordinates, velocities = (tuple(tuple(x[i] for x in own) for own in places) for i in range(2))
    numbers = [one_array(own, dtype) for own in list(zip(*rows, strict=True))[2:]]
    return TendonData(coordinates, velocities, c, *numbers)


@tree_of("bodies")
class BallData(TermData):
    """The limits of the angles of ball joints, which stand in the fields of the mechanism. bodies: what they carry."""

    bodies: tuple[int, ...]

    def to_term(self, world: World, step: StepData) -> "LimitsOfForms":
        state, t = world.state, world.state.topology
        turns: list = [x.kind.turn(x.q) if isinstance(x.kind, Ball) else None for x in state.joints]
        turn = state.of_bodies(self.bodies, turns, state.zero_vector)
        square = dot(turn, turn)
        is_none = high(square) == 0
        # Without a rotation any axis is as good.
        angle = where(is_none, 1.0, square).sqrt()
        axis = (where(is_none, x, y / angle) for x, y in zip((1.0, 0.0, 0.0), turn, strict=True))
        largest = scalars(state, stacking.rows(state.fields["turn_limits"], np.array(self.bodies)))
        velocities = tuple(tuple(t.v_starts[i] + j for i in self.bodies) for j in range(3))
        angle = where(is_none, 0.0, angle)
        return _limits_of_forms(world, step, velocities, tuple(axis), angle + np.inf, largest - angle)


def ball_data(mechanism: Mechanism, _: np.dtype) -> BallData | None:
    """The BallData of the balls that have limits; None for none."""
    t, limits = mechanism.topology, mechanism.turn_limits
    if limits is None:
        return None
    of_balls = (i for i in range(len(t)) if t.kind(i).name == Ball.name)
    bodies = tuple(i for i in of_balls if not is_infinite(limits[i : i + 1]))
    return BallData(bodies) if bodies else None


def _limits_of_forms(
    world: World,
    step: StepData,
    places: Places,
    c: tuple[Number, ...],
    below: Number,
    above: Number,
    is_equal: Mask | None = None,
) -> "LimitsOfForms":
    """The LimitsOfForms of numbers at distances below and above from their limits. is_equal: as of `Limit`."""
    v0, y_free = world.velocity_numbers(step.v0, step.y_free)
    u0, u_free = (_form(places, c, v) for v in (v0, v0 + y_free))
    speed = where(high(abs(u0)) > high(abs(u_free)), abs(u0), abs(u_free))
    w = _form(places, tuple(x * x for x in c), 1 / world.diagonal)
    limit = Limit.of(below, above, w, speed, world.dt, is_equal=is_equal)
    return LimitsOfForms(places, c, limit, limit.R)


def _form(places: Places, c: tuple[Number, ...], v: Number) -> Number:
    """sum c_j v_j (m, B), of numbers v (nv, B)."""
    own = (stacking.mapped(lambda w, x=x: stacking.rows(w, np.array(x)), v) for x in places)
    return functools.reduce(operator.add, map(operator.mul, c, own))


@tree_of("places")
class LimitsOfForms(Limited):
    """m linear forms of generalized velocities with limits. c: their coefficients, numbers (m, B), for each j."""

    places: Places
    c: tuple[Number, ...]
    limit: Limit
    R: Number

    @property
    def count(self) -> int:
        return len(self.places[0])

    def velocities(self, world: World, motions: list[Motion], v: Number) -> Number:
        return _form(self.places, self.c, v)

    def on_joints(self, world: World, impulse: Number) -> Number:
        return stacking.pairwise_sum(stacking.mapped(lambda w: w[:, None], impulse) * self._J(world))

    def columns(self, world: World, G: Number) -> list[Columns]:
        at_world, nothing = (-1,) * self.count, world.no_wrench
        on_joints = stacking.mapped(lambda w: w[:, None], G.sqrt()) * self._J(world)
        return [Columns(at_world, at_world, nothing, nothing, on_joints)]

    def _J(self, world: World) -> Number:
        """(m, nv, B)."""
        state, shape = world.state, (self.count, world.state.topology.nv, world.state.n)
        parts = list[Number]()
        for places, c in zip(self.places, self.c, strict=True):
            here = np.array(places)[:, None] == np.arange(shape[1])
            row = stacking.mapped(lambda w: w[:, None], stacking.spread(c, (shape[0], state.n)))
            parts.append(where(jnp.broadcast_to(here[:, :, None], shape), row, 0.0))
        return functools.reduce(operator.add, parts)
