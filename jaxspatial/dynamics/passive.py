"""Generalized forces of what a mechanism does by itself at its joints: springs, damping, friction and limits."""

import functools
import operator
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Numbers, where
from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics.algorithm import JOINTS, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.arguments import checked
from jaxspatial.dynamics.state import KindState, MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.mechanism.joints.form import CosSin


class Compliance(NamedTuple):
    """How soft friction and limits are: numbers, or one per rate (nv,).

    friction_speed: of regularised friction, rad/s or m/s, > 0: there it has 1 / sqrt(2) of its full size
    limit_stiffness: N m/rad or N/m, per depth beyond a limit; zero leaves limits out
    limit_damping: N m s/rad or N s/m, per speed of what is beyond a limit
    """

    friction_speed: Any = 1e-3
    limit_stiffness: Any = 0.0
    limit_damping: Any = 0.0


Softness = Compliance | None  # None takes the default


def passive_forces(
    mechanism: Mechanism,
    q: Coordinates,
    v: Rates,
    compliance: Compliance | None = None,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """Generalized forces (*batch, nv) of springs, damping, friction and limits: what to add to tau.

        tau = -stiffness (q - spring_references) - damping v - friction_loss v / sqrt(v^2 + friction_speed^2) + N

    and N, where a coordinate is x beyond a limit, the larger of limit_stiffness x + limit_damping dx/dt and zero, back
    into the range. Limits push and never pull. Friction is regularised: it is zero at rest, and a load below
    friction_loss creeps, at about the same part of friction_speed.

    Args:
        mechanism: Mechanism, with `stiffness`, `spring_references`, `damping`, `friction_loss`, `lower`, `upper`. What
            is known to be zero, or infinite of limits, leaves no operation behind.
        q: (*batch, nq) coordinates.
        v: (*batch, nv) rates. Batch shapes broadcast.
        compliance: Compliance; None takes the default, in which limits do not act.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, nv), over the common batch: N m, or N of what slides. Springs are the derivative of the energy
        sum(stiffness d^2) / 2, of deflections d: the difference of coordinates, the short way round for "continuous"
        joints and the angle of "planar" ones; of positions in "planar" and "free" joints along the axes of the parent;
        of orientations the rotation vector from the reference. With one stiffness for all axes these are MuJoCo's
        springs. Limits of quaternions do not act.

    Raises:
        TypeError: dtypes differ, or the first argument is no Mechanism.
        ValueError: shapes do not fit, or a friction speed that is not above zero.

    Error: at most 8 u times the sum of the sizes of the four terms in "fast" and "reproducible", u |r| + 64 u^2 of them
        in the other two; for "ball", "free" and "planar" of the terms of all rates of the joint. An angle brought
        within half a turn adds 8 u stiffness, more for many turns.
    Source: springs and damping MuJoCo, Computation, passive forces; the Jacobian of rotation vectors Barfoot 2017, 7.1.
    """
    position, rates = checked("passive_forces", mechanism, q=q, v=v)
    found = acting(mechanism, position, rates, compliance, precision)
    batch = np.broadcast_shapes(position.shape[:-1], rates.shape[:-1])
    return jnp.zeros((*batch, mechanism.nv), position.dtype) if found is None else found


def acting(
    mechanism: Mechanism, q: Array, v: Array, softness: Softness, precision: PrecisionName, with_resistance: bool = True
) -> jax.Array | None:
    """`passive_forces`, or None where nothing acts; without damping and friction if so asked."""
    compliance = _checked(mechanism, q, softness)
    names = ("stiffness", "damping", "friction_loss") if with_resistance else ("stiffness",)
    acts = [not is_nothing(getattr(mechanism, name)) for name in names]
    acts.append(
        compliance.limit_stiffness is not None and not all(map(_is_infinite, (mechanism.lower, mechanism.upper)))
    )
    if not any(acts):
        return None
    return _forces(precision, mechanism, q, v, compliance, with_resistance=with_resistance)


def resistance(
    mechanism: Mechanism, v: Any, compliance: Compliance | None, precision: PrecisionName
) -> jax.Array | None:
    """The coefficients c of damping and friction, force = -c v: (nv,) of damping alone, (*batch, nv) with friction;
    None where there is neither."""
    friction_speed = _checked(mechanism, v, compliance).friction_speed
    damping, friction = (
        None if is_nothing(x) else jnp.asarray(x, v.dtype) for x in (mechanism.damping, mechanism.friction_loss)
    )
    if friction is None:
        return damping
    damping = jnp.zeros_like(friction) if damping is None else damping
    return _coefficients(precision, v, damping, friction, jnp.broadcast_to(friction_speed, friction.shape))


def is_nothing(x: Array):
    """True for zeros known while tracing."""
    return isinstance(x, np.ndarray) and not x.any()


def _is_infinite(x: Array):
    return isinstance(x, np.ndarray) and np.isinf(x).all()


def _is_unlimited(own: KindState):
    return all(_is_infinite(own.rows(own.state.fields[name], of_rates=False)) for name in ("lower", "upper"))


def _checked(mechanism: Mechanism, like: Array, compliance: object):
    """A Compliance of arrays (nv,), limit_stiffness None where limits do not act."""
    compliance = Compliance() if compliance is None else compliance
    if not isinstance(compliance, Compliance):
        raise TypeError(f"compliance: expected a Compliance, got {type(compliance).__name__}")
    given = [_per_rate(mechanism, like, name, x) for name, x in compliance._asdict().items()]
    speed, stiffness, damping = given
    if isinstance(speed, np.ndarray) and not (speed > 0).all():
        raise ValueError(f"compliance: friction_speed: expected numbers above 0, got {compliance.friction_speed}")
    acts = not (is_nothing(stiffness) and is_nothing(damping))
    return Compliance(speed, *((stiffness, damping) if acts else (None, None)))


def _per_rate(mechanism: Mechanism, like: Array, name: str, x: Any) -> Array:
    dtype = np.dtype(like.dtype)
    array = cast(Array, check.as_float_array(x, f"compliance: {name}", dtype))
    check.require_same_dtype(state=like, **{name: array}) if not isinstance(array, np.ndarray) else None
    if array.shape not in ((), (mechanism.nv,)):
        raise ValueError(f"compliance: {name}: expected a number or shape ({mechanism.nv},), got {array.shape}")
    return (np if isinstance(array, np.ndarray) else jnp).broadcast_to(array, (mechanism.nv,)).astype(dtype)


# -- formulas ---------------------------------------------------------------------------------------------------------


@formula
def _coefficients(v: Numbers, damping: Numbers, friction: Numbers, speed: Numbers):
    both = zip(v, damping, friction, speed, strict=True)
    return tuple(d + f / _length(x, s) for x, d, f, s in both)


def _length(x: Number, s: Number):
    """sqrt(x^2 + s^2), that neither over- nor underflows."""
    longer, shorter = (where(abs(x) > s, *both) for both in ((abs(x), s), (s, abs(x))))
    t = shorter / longer
    return longer * (1 + t * t).sqrt()


_READ = ("stiffness", "spring_references", "damping", "friction_loss", "lower", "upper")


@algorithm(*JOINTS, *_READ)
def _forces(state: MechanismState, v: Array, compliance: Compliance, *, with_resistance: bool):
    found = [_of_joints(own, v, compliance, with_resistance) for own in state.kind_states]
    return state.by_rate(found, state.topology.joints_by_kind)


def _of_joints(own: KindState, v: Array, compliance: Compliance, with_resistance: bool) -> Numbers:
    """Numbers per rate; what a mimic has of them is with the joint that it follows, see `mechanism.assembly`."""
    terms = _positional(own, v, compliance)
    terms += _resisting(own, v, compliance) if with_resistance else []
    if not terms:
        return (own.state.known(0.0),) * own.kind.nv
    return tuple(functools.reduce(operator.add, x) for x in zip(*terms, strict=True))


def _resisting(own: KindState, v: Array, compliance: Compliance) -> list[Numbers]:
    damping, friction = (own.state.fields[name] for name in ("damping", "friction_loss"))
    rates, terms = own.rates(v), list[Numbers]()
    if not is_nothing(own.rows(damping)):
        terms.append([-d * x for d, x in zip(own.rates(damping), rates, strict=True)])
    if not is_nothing(own.rows(friction)):
        both = zip(own.rates(friction), rates, strict=True)
        speeds = own.rates(compliance.friction_speed)
        terms.append([-f * (x / _length(x, s)) for (f, x), s in zip(both, speeds, strict=True)])
    return terms


def _positional(own: KindState, v: Array, compliance: Compliance) -> list[Numbers]:
    """Of springs and limits: of coordinates first, then of the rates."""
    kind, zero = own.kind, own.state.known(0.0)
    has_spring = not is_nothing(own.rows(own.state.fields["stiffness"]))
    has_limits = compliance.limit_stiffness is not None and not _is_unlimited(own)
    if not kind.nv or not (has_spring or has_limits):
        return []
    q = own.configuration(own.state.q)
    on_sphere, rates_of_it = kind.sphere
    torques, forces = [zero] * rates_of_it, [zero] * (kind.nq - on_sphere)
    if on_sphere and has_spring:
        torques = _of_sphere_spring(own, q)
    if forces:
        cos_sin = own.cos_sin(q)
        if has_spring:
            forces = _plus(forces, _of_springs(own, q))
        if has_limits:
            forces = _plus(forces, _of_limits(own, q, cos_sin, v, compliance))
        forces = own.joint.generalized_forces(q, cos_sin, forces)
    return [[*torques, *forces]]


def _plus(a: Numbers, b: Numbers):
    return [x + y for x, y in zip(a, b, strict=True)]


def _of_sphere_spring(own: KindState, q: Numbers):
    fields = own.state.fields
    reference, stiffness = own.coordinates(fields["spring_references"]), own.rates(fields["stiffness"])
    return own.joint.sphere_spring(q, reference, stiffness)


def _of_springs(own: KindState, q: Numbers):
    """By coordinate, of those that are not of the sphere."""
    fields, (start, first_rate) = own.state.fields, own.kind.sphere
    reference, stiffness = own.coordinates(fields["spring_references"]), own.rates(fields["stiffness"])[first_rate:]
    deflection = own.joint.deflection(reference[start:], q[start:])
    return [-k * d for k, d in zip(stiffness, deflection, strict=True)]


def _of_limits(own: KindState, q: Numbers, cos_sin: CosSin, v: Array, compliance: Compliance):
    fields, (start, first_rate) = own.state.fields, own.kind.sphere
    speeds = own.joint.rates(q, cos_sin, own.rates(v))[start:]
    softness = [own.rates(x)[first_rate:] for x in (compliance.limit_stiffness, compliance.limit_damping)]
    limits = [own.coordinates(fields[name])[start:] for name in ("lower", "upper")]
    return [_of_limit(*x) for x in zip(q[start:], speeds, *softness, *limits, strict=True)]


def _of_limit(q: Number, speed: Number, stiffness: Number, damping: Number, lower: Number, upper: Number):
    return _one_sided_force(lower - q, -speed, stiffness, damping) - _one_sided_force(
        q - upper, speed, stiffness, damping
    )


def _one_sided_force(depth: Number, speed: Number, stiffness: Number, damping: Number):
    """Zero where the depth is not above zero, minus infinity too."""
    is_beyond = depth > 0
    force = stiffness * where(is_beyond, depth, 0.0) + damping * where(is_beyond, speed, 0.0)
    return where(force > 0, force, 0.0)
