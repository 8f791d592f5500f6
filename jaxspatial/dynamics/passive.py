"""The passive generalized forces of a mechanism: springs, damping, friction and limits of its joints."""

import functools
import operator
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.inverse_dynamics import inverse_dynamics_of
from jaxspatial.engine import stacking
from jaxspatial.engine.algorithm import JOINTS, NO_ARRAY, algorithm, checked
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import JointsOfKind, MechanismState
from jaxspatial.mechanism import Mechanism, Tendon
from jaxspatial.mechanism.joints import Ball
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.floats import is_infinite, is_nothing, one_array
from jaxspatial.numerics.formula import formula, plus
from jaxspatial.numerics.linear import Vector, dot
from jaxspatial.numerics.numbers import Number, Numbers, high, where
from jaxspatial.numerics.promise import Normwise, promises
from jaxspatial.numerics.quantity import exported
from jaxspatial.numerics.sums.pairwise import of_neighbours
from jaxspatial.numerics.types import ArrayLike, PrecisionName


@exported
class Compliance(NamedTuple):
    """How soft friction and limits are: numbers, or one per velocity (nv,).

    friction_speed: speed, rad/s or m/s, > 0, at which regularised friction has 1 / sqrt(2) of its full size
    limit_stiffness: N m/rad or N/m, times the depth beyond a limit; zero leaves limits out
    limit_damping: N m s/rad or N s/m, times the speed beyond a limit

    Limits of tendons have the numbers of the first joint of each, those of "ball" joints of the first velocity of each.

    Example:
        >>> stiff = js.Compliance(limit_stiffness=100.0)
        >>> print(js.passive_forces(arm.replace(upper=np.float32([0.25, 1.0])), q, v, stiff))
        [-25.   0.]
    """

    friction_speed: Any = 1e-3
    limit_stiffness: Any = 0.0
    limit_damping: Any = 0.0


PASSIVE = Normwise(8, "times the sum of the sizes of the four terms", rounded=1, u2=64)
PASSIVE_TURNS = Normwise(8, "stiffness", rounded=8)


@promises(bound=PASSIVE, turns=PASSIVE_TURNS)
def passive_forces(
    mechanism: Mechanism,
    q: ArrayLike,
    v: ArrayLike,
    compliance: Compliance | None = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """The generalized forces of springs, damping, friction, limits, tendons and lifts, which add to tau.

        tau = -stiffness (q - spring_references) - damping v - friction_loss v / sqrt(v^2 + friction_speed^2) + N

    Those of tendons, see `Tendon`, and those that hold the `lifts` of bodies against gravity come on top.

    N is the force of a limit, back into the range: limit_stiffness x + limit_damping dx/dt at the depth x beyond it, or
    zero if that is negative, as limits push and never pull; equal limits of a tendon do both. Friction is regularised:
    it is zero at rest, and a joint creeps under any load below friction_loss, for small loads at about the same
    fraction of friction_speed.

    Args:
        mechanism: Mechanism, with `stiffness`, `spring_references`, `damping`, `friction_loss`, `lower`, `upper`,
            `tendons`, `lifts`. Known zeros, limits known to be infinite, and what there is not cost no operation.
        q: (*batch, nq) coordinates.
        v: (*batch, nv) generalized velocities. Batch shapes broadcast.
        compliance: Compliance; None takes the default, in which limits do not act.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv), over the common batch: N m, or N along sliding joints. Springs are the gradient of the energy
        sum(stiffness d^2) / 2. The deflection d is the difference of coordinates, the short way round for "continuous"
        joints and the angle of "planar" ones; for positions in "planar" and "free" joints, along the axes of the
        parent; for orientations, the rotation vector from the reference. With one stiffness for all axes these are
        MuJoCo's springs. The limit of a "ball" is one of the angle of its rotation, about whose axis it pushes; those
        of other quaternions do not act.

    Raises:
        TypeError: dtypes differ, or the first argument is no Mechanism.
        ValueError: shapes do not fit, or of numbers known while tracing a friction speed is not above zero, a stiffness
            or damping of limits below zero or NaN.

    Error: at most 8 u times the sum of the sizes of the four terms in "fast" and "reproducible", 1 u |r| + 64 u^2 times
        the sum of the sizes of the four terms in the other two; for "ball", "free" and "planar" of the terms of the
        whole joint. An angle brought within half a turn adds 8 u stiffness, more for many turns. The length of a tendon
        over k joints has an error of ceil(log2 k) + 2 u of the sum of the sizes of its terms; lifts have the error of
        `gravity_forces`.
    Source: springs and damping MuJoCo, Computation, passive forces; the Jacobian of rotation vectors Barfoot 2017, 7.1.

    Example:
        >>> damped = arm.replace(damping=np.float32([0.5, 0.2]))
        >>> print(js.passive_forces(damped, q, v))
        [-0.5 -0.1]
    """
    position, velocity = checked("passive_forces", mechanism, q=q, v=v)
    forces = passive_forces_or_none(mechanism, position, velocity, compliance, precision)
    batch = floats.broadcast_shapes(position.shape[:-1], velocity.shape[:-1])
    return jnp.zeros((*batch, mechanism.nv), position.dtype) if forces is None else forces


def passive_forces_or_none(
    mechanism: Mechanism,
    q: Array,
    v: Array,
    compliance: Compliance | None,
    precision: PrecisionName,
    with_resistance: bool = True,
) -> jax.Array | None:
    """`passive_forces`, or None if there are none. with_resistance=False leaves out damping and friction."""
    compliance = checked_compliance(mechanism, q, compliance)
    names = ("stiffness", "damping", "friction_loss") if with_resistance else ("stiffness",)
    acts = [not is_nothing(getattr(mechanism, name)) for name in names]
    limits = (x for x in (mechanism.lower, mechanism.upper, mechanism.turn_limits) if x is not None)
    acts.append(compliance.limit_stiffness is not None and not all(map(is_infinite, limits)))
    forces = _forces(precision, mechanism, q, v, compliance, with_resistance=with_resistance) if any(acts) else None
    if rows := _rows_of_tendons(mechanism, np.dtype(q.dtype), compliance):
        places, numbers = zip(*rows, strict=True)
        of_tendons = _tendon_forces(precision, mechanism, q, v, numbers, places=places)
        forces = of_tendons if forces is None else plus(precision, forces, of_tendons)
    if mechanism.lifts is not None and not (is_nothing(mechanism.lifts.mass) or is_nothing(mechanism.gravity)):
        of_lifts = inverse_dynamics_of(
            precision, mechanism.lifted, q, NO_ARRAY, NO_ARRAY, None, operation="passive_forces"
        )
        forces = of_lifts if forces is None else plus(precision, forces, of_lifts)
    return forces


def damping_coefficients(
    mechanism: Mechanism, v, compliance: Compliance | None, precision: PrecisionName
) -> jax.Array | None:
    """The coefficients c of the force -c v of damping and friction, or None if there are none.

    (nv,) for damping alone, (*batch, nv) with friction, whose coefficient depends on v.
    """
    friction_speed = checked_compliance(mechanism, v, compliance).friction_speed
    damping, friction = (
        None if is_nothing(x) else jnp.asarray(x, v.dtype) for x in (mechanism.damping, mechanism.friction_loss)
    )
    if friction is None:
        return damping
    damping = jnp.zeros_like(friction) if damping is None else damping
    return _coefficients(precision, v, damping, friction, jnp.broadcast_to(friction_speed, friction.shape))


def checked_compliance(mechanism: Mechanism, like, compliance: object):
    """The Compliance, checked, as arrays (nv,); limit_stiffness and limit_damping are None if limits do not act."""
    compliance = Compliance() if compliance is None else compliance
    if not isinstance(compliance, Compliance):
        raise TypeError(f"compliance: expected a Compliance, got {type(compliance).__name__}")
    items = compliance._asdict().items()
    speed, stiffness, damping = [_per_velocity(mechanism, like, name, x) for name, x in items]
    if isinstance(speed, np.ndarray) and not (speed > 0).all():
        raise ValueError(f"compliance: friction_speed: expected numbers above 0, got {compliance.friction_speed}")
    for name, x in (("limit_stiffness", stiffness), ("limit_damping", damping)):
        if isinstance(x, np.ndarray) and not (x >= 0).all():
            got = getattr(compliance, name)
            raise ValueError(f"compliance: {name}: expected numbers of at least 0, got {got}")
    acts = not (is_nothing(stiffness) and is_nothing(damping))
    return Compliance(speed, *((stiffness, damping) if acts else (None, None)))


def _per_velocity(mechanism: Mechanism, like: Array, name: str, x) -> Array:
    dtype = np.dtype(like.dtype)
    array = cast(Array, floats.as_float_array(0.0 if x is None else x, f"compliance: {name}", dtype))
    check.require_same_dtype(state=like, **{name: array}) if not isinstance(array, np.ndarray) else None
    if array.shape not in ((), (mechanism.nv,)):
        raise ValueError(f"compliance: {name}: expected a number or shape ({mechanism.nv},), got {array.shape}")
    return (np if isinstance(array, np.ndarray) else jnp).broadcast_to(array, (mechanism.nv,)).astype(dtype)


# -- formulas ---------------------------------------------------------------------------------------------------------


@formula(by_number=True)
def _coefficients(v: Number, damping: Number, friction: Number, speed: Number):
    return damping + friction / _hypotenuse(v, speed)


def _hypotenuse(x: Number, s: Number):
    """sqrt(x^2 + s^2), without over- or underflow."""
    longer, shorter = (where(abs(x) > s, *both) for both in ((abs(x), s), (s, abs(x))))
    t = shorter / longer
    return longer * (1 + t * t).sqrt()


_FIELDS = ("stiffness", "spring_references", "damping", "friction_loss", "lower", "upper", "turn_limits")


@algorithm(*JOINTS, *_FIELDS)
def _forces(state: MechanismState, v: Array, compliance: Compliance, *, with_resistance: bool):
    forces = [_of_joints(joints, v, compliance, with_resistance) for joints in state.independent_joints]
    return state.by_velocity(forces, state.topology.joints_by_kind)


def _of_joints(joints: JointsOfKind, v: Array, compliance: Compliance, with_resistance: bool) -> Numbers:
    """The force of each velocity. `mechanism.assembly` adds parameters of mimics to the joint that they follow."""
    terms, velocities = _positional(joints, v, compliance), joints.velocities(v)
    damping, friction = (joints.state.fields[name] for name in ("damping", "friction_loss"))
    if with_resistance and not is_nothing(joints.part_of(damping)):
        terms.append([-d * x for d, x in zip(joints.velocities(damping), velocities, strict=True)])
    if with_resistance and not is_nothing(joints.part_of(friction)):
        both = zip(joints.velocities(friction), velocities, strict=True)
        speeds = joints.velocities(compliance.friction_speed)
        terms.append([-f * (x / _hypotenuse(x, s)) for (f, x), s in zip(both, speeds, strict=True)])
    if not terms:
        return (joints.state.known(0.0),) * joints.kind.nv
    return tuple(functools.reduce(operator.add, x) for x in zip(*terms, strict=True))


def _positional(joints: JointsOfKind, v: Array, compliance: Compliance) -> list[Numbers]:
    """The forces of springs and limits, if they act: computed for coordinates, then converted to velocities."""
    kind, fields, zero = joints.kind, joints.state.fields, joints.state.known(0.0)
    has_spring = not is_nothing(joints.part_of(fields["stiffness"]))
    limits, largest, softness = list[Array](), None, list[Array]()
    if compliance.limit_stiffness is not None:
        limits, softness = [fields["lower"], fields["upper"]], [compliance.limit_stiffness, compliance.limit_damping]
        if kind.name == Ball.name and (turn_limits := fields["turn_limits"]) is not None:
            largest = stacking.rows(turn_limits[:, None], joints.bundle.bodies)
    has_limits = not all(is_infinite(joints.part_of(x, over_velocities=False)) for x in limits)
    largest = None if largest is None or is_infinite(largest) else largest
    if not kind.nv or not (has_spring or has_limits or largest is not None):
        return []
    q, (on_sphere, n_turns) = joints.configuration(joints.state.q), kind.sphere
    torques, forces = [zero] * n_turns, [zero] * (kind.nq - on_sphere)
    reference, stiffness = (), ()
    if has_spring:
        reference, stiffness = joints.coordinates(fields["spring_references"]), joints.velocities(fields["stiffness"])
    if on_sphere and has_spring:
        torques = joints.joint.sphere_spring(q, reference, stiffness)
    if largest is not None:
        (angle,) = joints.state.numbers(largest)
        torques = map(operator.add, torques, _of_turn_limit(joints, q, v, compliance, angle))
    if forces:
        cos_sin = joints.cos_sin(q)
        if has_spring:
            deflection = joints.joint.deflection(reference[on_sphere:], q[on_sphere:])
            forces = [x + -k * d for x, k, d in zip(forces, stiffness[n_turns:], deflection, strict=True)]
        if has_limits:
            speeds = joints.joint.rates(q, cos_sin, joints.velocities(v))[on_sphere:]
            numbers = (
                *(joints.velocities(x)[n_turns:] for x in softness),
                *(joints.coordinates(x)[on_sphere:] for x in limits),
            )
            coordinates = zip(q[on_sphere:], speeds, *numbers, strict=True)
            forces = list(map(operator.add, forces, (_of_limit(*x) for x in coordinates)))
        forces = joints.joint.generalized_forces(q, cos_sin, forces)
    return [[*torques, *forces]]


def _of_turn_limit(joints: JointsOfKind, q: Numbers, v: Array, compliance: Compliance, largest: Number) -> Numbers:
    """The torque of the limit of the angle of a ball joint, back along the axis of its rotation."""
    k, c = (joints.velocities(x)[0] for x in (compliance.limit_stiffness, compliance.limit_damping))
    turn = cast(Ball, joints.joint).turn(q)
    squared = dot(turn, turn)
    is_within = squared <= largest * largest
    # Within the limit there is no torque, and no axis at zero.
    angle = where(is_within, 1.0, squared).sqrt()
    axis = Vector(*(x / angle for x in turn))
    speed = dot(axis, joints.velocities(v))
    force = _one_sided_force(where(is_within, 0.0, angle - largest), speed, k, c)
    return tuple(where(is_within, 0.0, -force * x) for x in axis)


def _of_limit(q: Number, speed: Number, stiffness: Number, damping: Number, lower: Number, upper: Number):
    """The force of two limits."""
    return _one_sided_force(lower - q, -speed, stiffness, damping) - _one_sided_force(
        q - upper, speed, stiffness, damping
    )


def _one_sided_force(depth: Number, speed: Number, stiffness: Number, damping: Number):
    """The force at a depth beyond a limit; zero where the depth is not positive, even if it is minus infinity."""
    # NaN is not within, and becomes the force.
    is_within = depth <= 0
    force = stiffness * where(is_within, 0.0, depth) + damping * where(is_within, 0.0, speed)
    return where(force <= 0, 0.0, force)


# -- tendons ----------------------------------------------------------------------------------------------------------


class _Row(NamedTuple):
    """The numbers of a tendon over k coordinates, as arrays: coefficients (k,), rest and limits (2,), others (1,)."""

    coefficients: Array
    offset: Array
    stiffness: Array
    rest: Array
    damping: Array
    limits: Array
    limit_stiffness: Array
    limit_damping: Array


_Places = tuple[tuple[int, int], ...]  # of each coordinate of a tendon in q, and in v


def _rows_of_tendons(mechanism: Mechanism, dtype: np.dtype, compliance: Compliance) -> list[tuple[_Places, _Row]]:
    """The tendons that may exert a force."""
    rows = list[tuple[_Places, _Row]]()
    for tendon in mechanism.tendons:
        limits = one_array([tendon.lower, tendon.upper], dtype)
        has_limits = compliance.limit_stiffness is not None and not is_infinite(limits)
        spring, damping = (one_array([x], dtype) for x in (tendon.stiffness, tendon.damping))
        if is_nothing(spring) and is_nothing(damping) and not has_limits:
            continue
        places, coefficients, offset = over_coordinates(mechanism, tendon)
        i = places[0][1]
        both: Any = (compliance.limit_stiffness, compliance.limit_damping)
        softness = [x[i : i + 1] for x in (both if has_limits else (np.zeros(i + 1, dtype),) * 2)]
        numbers = one_array(coefficients, dtype), one_array([offset], dtype)
        if not has_limits:
            limits = np.array([-np.inf, np.inf], dtype)
        rows.append((places, _Row(*numbers, spring, one_array(list(tendon.rest), dtype), damping, limits, *softness)))
    return rows


def over_coordinates(mechanism: Mechanism, tendon: Tendon) -> tuple[_Places, list, Any]:
    """(places, coefficients, offset): a mimic counts with the joint that it follows."""
    t, c, offset = mechanism.topology, dict[int, Any](), tendon.offset
    for name, x in zip(tendon.joints, tendon.coefficients, strict=True):
        i = t.joint_names.index(name)
        multiplier, shift = mechanism.mimics[i] if t.is_mimic(i) else (1.0, 0.0)
        leader = t.followed[i]
        if t.is_mimic(i):
            offset, x = offset + x * shift, x * multiplier
        c[leader] = c[leader] + x if leader in c else x
    return tuple((t.q_starts[i], t.v_starts[i]) for i in c), list(c.values()), offset


@algorithm(*JOINTS)
def _tendon_forces(state: MechanismState, v: Array, rows: tuple[_Row, ...], *, places: tuple[_Places, ...]):
    forces = dict[int, list[Number]]()
    for row, coordinates in zip(rows, places, strict=True):
        c = [_number(state, row.coefficients, k) for k in range(len(coordinates))]
        q = [_number(state, state.q, i) for i, _ in coordinates]
        rates = [_number(state, v, i) for _, i in coordinates]
        length, rate = (of_neighbours(operator.add, list(map(operator.mul, c, x))) for x in (q, rates))
        tension = _tension(state, row, length + _number(state, row.offset, 0), rate)
        for (_, i), factor in zip(coordinates, c, strict=True):
            forces.setdefault(i, []).append(factor * tension)
    nothing = state.known(0.0)
    sums = [functools.reduce(operator.add, forces[i]) if i in forces else nothing for i in range(state.topology.nv)]
    return stacking.stacked(tuple(sums), (state.n,), 0)


def _tension(state: MechanismState, row: _Row, length: Number, rate: Number) -> Number:
    force = state.known(0.0)
    if not is_nothing(row.stiffness):
        shortest, longest = (_number(state, row.rest, k) for k in (0, 1))
        stretch = length - shortest
        if not (isinstance(row.rest, np.ndarray) and row.rest[0] == row.rest[1]):
            # With one length at rest, and at it, the derivative is that of a spring. NaN becomes the force.
            stretch = where(length > longest, length - longest, where(length > shortest, 0.0, stretch))
        force = force - _number(state, row.stiffness, 0) * stretch
    if not is_nothing(row.damping):
        force = force - _number(state, row.damping, 0) * rate
    if not is_infinite(row.limits):
        force = force + _of_limits(state, row, length, rate)
    return force


def _of_limits(state: MechanismState, row: _Row, length: Number, rate: Number) -> Number:
    """The force of the limits of a tendon: equal ones push and pull."""
    k, c = (_number(state, x, 0) for x in (row.limit_stiffness, row.limit_damping))
    lower, upper = (_number(state, row.limits, i) for i in (0, 1))
    is_known = isinstance(row.limits, np.ndarray)
    if is_known and row.limits[0] != row.limits[1]:
        return _of_limit(length, rate, k, c, lower, upper)
    held = k * (lower - length) - c * rate
    return held if is_known else where(high(lower) == high(upper), held, _of_limit(length, rate, k, c, lower, upper))


def _number(state: MechanismState, array: Array, i: int) -> Number:
    """Number i of an array (k,), or of data (k, B)."""
    return state.numbers(array[i : i + 1])[0]
