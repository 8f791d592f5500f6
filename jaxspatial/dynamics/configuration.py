"""The manifold of configurations: integration, differences, interpolation, rates, and random configurations."""

import jax
import jax.numpy as jnp

from jaxspatial.engine.algorithm import JOINTS, algorithm, checked, checked_mechanism
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.promise import Normwise, promises
from jaxspatial.numerics.types import ArrayLike, BatchShape, DTypeLike, Key, PrecisionName

# Error bounds of scalar coordinates, of quaternions, and of positions in "planar" and "free" joints.
INTEGRATED, INTEGRATED_TURN = Normwise(2, "(|q| + |v dt|)"), Normwise(8, "of a quaternion")
INTEGRATED_POSITION = Normwise(8, "(|p| + |v dt|)")
# What a step beyond half a turn adds.
TURNS, TURNS_OF_POSITION = Normwise(1, "|w dt|", rounded=0), Normwise(1, "|w dt| |v dt|", rounded=0)
DIFFERENCE, SHORTEST = Normwise(2, "(|q0| + |q1|)"), Normwise(4, "(|q0| + |q1|)")
DIFFERENCE_TURN, DIFFERENCE_POSITION = Normwise(12, "of a rotation vector"), Normwise(8, "(|p0| + |p1|) (1 + |w|)")
QUATERNION_RATE, POSITION_RATE = Normwise(2, "|w|"), Normwise(6, "|v|")


@promises(number=INTEGRATED, turn=INTEGRATED_TURN, position=INTEGRATED_POSITION, turns=TURNS, moved=TURNS_OF_POSITION)
def integrate(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, dt: ArrayLike = 1.0, *, precision: PrecisionName = None
) -> jax.Array:
    """Integrates q for a time dt at constant body-frame velocity v.

    Each joint follows its exponential: a screw motion, if it both turns and moves. The inverse of `difference`. The
    bodies of `semi_implicit_step` move along straight lines instead.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        dt: the time, s: a number or (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        q (*batch, nq), over the common batch; quaternions of unit length, of either sign. What turns by more than some
        1 / u rad, such as the quaternion of a "ball", is NaN; in "compensated" and "faithful" by more than 1 / u^2.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: in "fast" and "reproducible" at most 2 u (|q| + |v dt|) of each coordinate that is a number; 8 u of a
        quaternion, in its 2-norm, and u |w dt| more beyond half a turn; 8 u (|p| + |v dt|) of positions in "planar" and
        "free" joints, in their 2-norms, and u |w dt| |v dt| more beyond half a turn. In the other two 1.01 u of each of
        these (number, quaternion, position), relative to it.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 2.36.

    Example:
        >>> print(js.integrate(arm, q, v, 0.1))
        [ 0.6  -0.15]
    """
    return _integrate(precision, mechanism, q, v, dt)


@promises(number=DIFFERENCE, angle=SHORTEST, turn=DIFFERENCE_TURN, position=DIFFERENCE_POSITION)
def difference(mechanism: Mechanism, q0: ArrayLike, q1: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The velocity that leads from one configuration to another in unit time, the short way round.

    `integrate(mechanism, q0, difference(mechanism, q0, q1))` is q1. At half a turn between orientations see
    `Rotation.log`.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q0: (*batch, nq) coordinates at the start: rad, m, quaternions (read normalised).
        q1: (*batch, nq) coordinates at the end.
        precision: name of a precision; None takes the default.

    Returns:
        v (*batch, nv), over the common batch: rad/s, m/s.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: in "fast" and "reproducible" at most 2 u (|q0| + |q1|) of each coordinate that is a number; 4 u (|q0| + |q1|)
        of the angle of "continuous" and "planar" joints; 12 u of a rotation vector, rad, in its 2-norm; 8 u (|p0| +
        |p1|) (1 + |w|) of positions in "planar" and "free" joints. In the other two 1.01 u of each of these (number,
        rotation vector, position), relative to it, while orientations are not opposite.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 2.36.

    Example:
        >>> print(js.difference(arm, q, js.integrate(arm, q, v, 0.1)))
        [0.1  0.05]
    """
    return _difference(precision, mechanism, q0, q1)


def interpolate(
    mechanism: Mechanism, q0: ArrayLike, q1: ArrayLike, t: ArrayLike, *, precision: PrecisionName = None
) -> jax.Array:
    """The configuration on the way from q0 to q1 at constant velocity: `integrate(q0, difference(q0, q1), t)`.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q0: (*batch, nq) coordinates at t = 0: rad, m, quaternions (read normalised).
        q1: (*batch, nq) coordinates at t = 1.
        t: a number or (*batch,), any number.
        precision: name of a precision; None takes the default.

    Returns:
        q (*batch, nq), over the common batch; quaternions of unit length, of either sign.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: at most that of `integrate` and |t| times that of `difference`; in "compensated" and "faithful" too the
        velocity between the two is rounded to the dtype.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 2.36 (the screw motion between
        two poses).

    Example:
        >>> print(js.interpolate(arm, jnp.zeros(2), q, 0.5))
        [ 0.25 -0.1 ]
    """
    # Messages name these arguments, and not those of the two functions.
    checked("interpolate", mechanism, q0=q0, q1=q1, t=t)
    return integrate(mechanism, q0, difference(mechanism, q0, q1, precision=precision), t, precision=precision)


@promises(quaternion=QUATERNION_RATE, position=POSITION_RATE)
def configuration_rates(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, *, precision: PrecisionName = None
) -> jax.Array:
    """The time derivative of q at the velocity v, for solvers that step q as an array, and for tangents along v.

    For a quaternion it is q (0, w) / 2, which keeps its length, and is proportional to it, so that a quaternion of any
    length turns equally fast.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions of any length.
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        dq/dt (*batch, nq), over the common batch: rad/s, m/s, 1/s of quaternions.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: none of coordinates that are numbers; in "fast" and "reproducible" at most 2 u |w| of a unit quaternion's and
        6 u |v| of a position's in "planar" and "free" joints, in 2-norms. In the other two 1.01 u of each of these,
        relative to it.
    Source: of quaternions, Shuster 1993, A survey of attitude representations.

    Example:
        >>> print(js.configuration_rates(arm, q, v))  # v itself, but for quaternions
        [1.  0.5]
    """
    return _configuration_rates(precision, mechanism, q, v)


def random_configuration(
    mechanism: Mechanism, key: Key, batch_shape: BatchShape = (), dtype: DTypeLike | None = None
) -> jax.Array:
    """A random configuration.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        key: of `jax.random`.
        batch_shape: an integer or a tuple.
        dtype: of floating point; None takes that of the mechanism.

    Returns:
        q (*batch, nq): uniform between the limits of a joint that has two; other angles within half a turn, and other
        lengths within 1 m, of zero; orientations uniform.

    Raises:
        TypeError: the first argument is no Mechanism, the key no single key, or the dtype is not floating point.
        ValueError: the batch shape has something else than integers from 0 on.

    Error: none, it is random.
    Source: of orientations, Muller 1959, A note on a method for generating points uniformly on n-dimensional spheres.

    Example:
        >>> js.random_configuration(arm, jax.random.key(0), (1000,)).shape
        (1000, 2)
    """
    mechanism = checked_mechanism("random_configuration", mechanism)
    check.require_key(key, "random_configuration: key")
    dtype, batch_shape = floats.as_dtype(dtype or mechanism.dtype), check.as_batch_shape(batch_shape)
    t, parts = mechanism.topology, list[jax.Array]()
    for i, k in enumerate(jax.random.split(key, len(t))):
        if not t.is_mimic(i):
            lower, upper = (jnp.asarray(x[t.q_slice(i)], dtype) for x in (mechanism.lower, mechanism.upper))
            parts.append(t.kind(i).random(k, lower, upper, batch_shape))
    return jnp.concatenate(parts, -1) if parts else jnp.zeros((*batch_shape, 0), dtype)


@algorithm(*JOINTS)
def _integrate(state: MechanismState, v: Array, dt: Array):
    """`JointKind.integrate` of all joints, those of one kind at once."""
    (time,) = state.numbers(dt)
    steps = ((joints, tuple(x * time for x in joints.velocities(v))) for joints in state.independent_joints)
    q = [joints.apply("integrate", step) for joints, step in steps]
    return state.by_coordinate(q, state.topology.joints_by_kind)


@algorithm(*JOINTS)
def transport(state: MechanismState, v: Array):
    """w x v, for linear velocities along axes that turn with their own joint; zero for all other velocities.

    dv/dt + w x v is the time derivative of such a velocity in the parent's axes.
    """
    terms = [joints.joint.transport(*[joints.velocities(v)] * 2) for joints in state.independent_joints]
    return state.by_velocity(terms, state.topology.joints_by_kind)


@algorithm(*JOINTS)
def advance(state: MechanismState, v: Array, dt: Array):
    """(q, v) after the time dt, by `JointKind.advance`. v is along the axes at q, the result along those at new q."""
    (time,), bundles = state.numbers(dt), state.topology.joints_by_kind
    moved = [joints.apply("advance", joints.velocities(v), time) for joints in state.independent_joints]
    q, velocities = zip(*moved, strict=True)
    return state.by_coordinate(q, bundles), state.by_velocity(velocities, bundles)


@algorithm(*JOINTS)
def _configuration_rates(state: MechanismState, v: Array):
    rates = [joints.dq_dt(joints.velocities(v))[0] for joints in state.independent_joints]
    return state.by_coordinate(rates, state.topology.joints_by_kind)


@algorithm(*JOINTS, at="q0")
def _difference(state: MechanismState, q1: Array):
    steps = [joints.apply("difference", joints.configuration(q1)) for joints in state.independent_joints]
    return state.by_velocity(steps, state.topology.joints_by_kind)
