"""Limits and dry friction of joints, as a term of the convex step."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.contact.term import NEAR_RIGID_LIMIT, STICKING, Rows, StepData, TermData
from jaxspatial.contact.world import World, scalars
from jaxspatial.engine import stacking
from jaxspatial.engine.stacking import Array
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics.linear import Motion
from jaxspatial.numerics.numbers import Mask, Number, constant, high, where
from jaxspatial.numerics.quantity import tree_of

# Drake's numbers: the stiffness of limits, and how many steps ahead they are seen.
LIMIT_STIFFNESS, LIMIT_WINDOW = 1e12, 2.0


def _limited_velocities(topology: Topology, fields: Mapping[str, Any]) -> tuple[list[int], list[int]]:
    """The m velocities on which limits or dry friction may act, and the joint of each. fields: of the mechanism."""
    velocities, joints = list[int](), list[int]()
    for i in (i for i in range(len(topology)) if not topology.is_mimic(i)):
        own = topology.v_slice(i)
        if _has_limits(topology, fields, i) or not _is_known_to_be(fields["friction_loss"], own, 0):
            velocities += range(own.start, own.stop)
            joints += [i] * (own.stop - own.start)
    return velocities, joints


def _has_limits(topology: Topology, fields: Mapping[str, Any], i: int) -> bool:
    """Whether limits may act on joint i: on one of one coordinate, whose rate is its velocity."""
    kind, places = topology.kind(i), topology.q_slice(i)
    is_simple = kind.nq == kind.nv == 1 and not kind.rates_need_angles
    unlimited = (_is_known_to_be(fields[k], places, x) for k, x in (("lower", -np.inf), ("upper", np.inf)))
    return is_simple and not all(unlimited)


def _is_known_to_be(x: Array, places: slice, number: float) -> bool:
    return isinstance(x, np.ndarray) and bool((x[places] == number).all())


@tree_of()
class JointData(TermData):
    """Limits and dry friction of joints: all of it stands in the fields of the mechanism."""

    def to_term(self, world: World, step: StepData) -> "Joints":
        state, dt = world.state, world.dt
        topology, fields = state.topology, state.fields
        velocities, joints = _limited_velocities(topology, fields)
        rows, q_rows = np.array(velocities), np.array([topology.q_starts[i] for i in joints])
        has_limits = np.array([_has_limits(topology, fields, i) for i in joints])
        lower_array, upper_array = (stacking.rows(fields[x], q_rows) for x in ("lower", "upper"))
        q, lower, upper = (scalars(state, x) for x in (stacking.rows(state.q, q_rows), lower_array, upper_array))
        friction = scalars(state, stacking.rows(fields["friction_loss"], rows))
        v0, y_free = world.velocity_numbers(step.v0, step.y_free)
        v_free = v0 + y_free
        speed = where(high(abs(v0)) > high(abs(v_free)), abs(v0), abs(v_free))
        w, speed = (stacking.mapped(lambda x: stacking.rows(x, rows), y) for y in (1 / world.diagonal, speed))
        is_equal = are_equal(lower, upper, lower_array, upper_array)
        is_equal = None if is_equal is None else is_equal & has_limits[:, None]
        limit = Limit.of(q - lower, upper - q, w, speed, dt, has_limits[:, None], is_equal)
        return Joints(tuple(velocities), limit, friction * dt, STICKING * w)


def joint_data(mechanism: Mechanism, _: np.dtype) -> JointData | None:
    """The JointData of a mechanism in which limits or dry friction may act; None for another."""
    return JointData() if _limited_velocities(mechanism.topology, vars(mechanism))[0] else None


def are_equal(lower: Number, upper: Number, lower_array: Array, upper_array: Array) -> Mask | None:
    """Which of m limits are equal, (m, B); None where it is known that none is. Given as numbers, and as arrays."""
    if isinstance(lower_array, np.ndarray) and isinstance(upper_array, np.ndarray):
        same = lower_array == upper_array
        return jnp.asarray(same[:, None]) if same.any() else None
    return high(lower) == high(upper)


class Limit(NamedTuple):
    """How m numbers are held between limits, as numbers (m, B).

    fastest_down, fastest_up: how fast, at most, a number may approach a limit. near_lower, near_upper: whether a limit
    is near, and may act. R: how much an impulse changes the velocity. is_equal: whether the two limits are equal, of
    which the lower one then pushes and pulls; None for none.
    """

    fastest_down: Number
    fastest_up: Number
    near_lower: Mask
    near_upper: Mask
    R: Number
    is_equal: Mask | None

    @classmethod
    def of(
        cls,
        below: Number,
        above: Number,
        w: Number,
        speed: Number,
        dt: Number,
        may_act: np.ndarray | bool = True,
        is_equal: Mask | None = None,
    ) -> Self:
        """From the distances to the lower and the upper limit, the size w of the Delassus operator, and the speed."""
        compliant, rigid = 1 / (2 * LIMIT_STIFFNESS * (dt * dt)), NEAR_RIGID_LIMIT * w
        R = where(high(rigid) > high(compliant), rigid, compliant)
        window = LIMIT_WINDOW * dt * speed
        # NaN is near, and becomes the impulse.
        near_lower, near_upper = (~(high(gap) >= high(window)) & may_act for gap in (below, above))
        if is_equal is not None:
            near_lower, near_upper = near_lower | is_equal, near_upper & ~is_equal
        down, up = (where(near, gap, 0.0) / (2 * dt) for near, gap in ((near_lower, below), (near_upper, above)))
        return cls(down, up, near_lower, near_upper, R, is_equal)


class Limited(Rows):
    """A term of numbers with limits, or with these and more."""

    limit: Limit

    def law(self, u: Number, held: Mask | None = None) -> tuple[Number, Number]:
        at, zero = self.limit, constant(u, 0)
        down, up = (-at.fastest_down - u) / at.R, (u - at.fastest_up) / at.R
        is_down, is_up = at.near_lower & ~(high(down) <= 0), at.near_upper & ~(high(up) <= 0)
        is_down = is_down if at.is_equal is None else is_down | at.is_equal
        return where(is_down, down, zero) - where(is_up, up, zero), where(is_down | is_up, 1 / at.R, zero)

    def magnitude(self, u: Number) -> Number:
        return abs(u) + abs(self.limit.fastest_down) + abs(self.limit.fastest_up)

    def acts(self) -> jax.Array:
        return self.limit.near_lower | self.limit.near_upper


@tree_of("places")
class Joints(Limited):
    """m velocities with limits or dry friction, as numbers (m, B). places: the numbers of the velocities.

    friction: the largest impulse of dry friction, a known zero without. R_f: how much an impulse of friction changes
    the velocity.
    """

    places: tuple[int, ...]
    limit: Limit
    friction: Number
    R_f: Number

    @property
    def count(self) -> int:
        return len(self.places)

    def law(self, u: Number, held: Mask | None = None) -> tuple[Number, Number]:
        impulse, G = super().law(u)
        stuck, largest = -u / self.R_f, self.friction
        is_stuck = high(abs(stuck)) < high(largest)
        slipping = where(high(stuck) > 0, largest, -largest)
        return impulse + where(is_stuck, stuck, slipping), G + where(is_stuck, 1 / self.R_f, constant(u, 0))

    def acts(self) -> jax.Array:
        return super().acts() | ~(high(self.friction) <= 0)

    def single_velocities(self) -> np.ndarray:
        return np.array(self.places)

    def velocities(self, world: World, motions: list[Motion], v: Number) -> Number:
        return stacking.mapped(lambda w: stacking.rows(w, np.array(self.places)), v)

    def on_joints(self, world: World, impulse: Number) -> Number:
        return world.at_velocities(impulse, np.array(self.places))
