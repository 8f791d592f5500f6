"""Steps on the manifold of configurations: along motions, between configurations, and random ones."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic.types import BatchShape, Coordinates, DTypeLike, Key, PrecisionName, Rates, Scalar
from jaxspatial.dynamics.algorithm import JOINTS, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.arguments import checked_mechanism
from jaxspatial.dynamics.state import MechanismState
from jaxspatial.mechanism import Mechanism


def integrate(
    mechanism: Mechanism, q: Coordinates, v: Rates, dt: Scalar = 1.0, *, precision: PrecisionName = None
) -> jax.Array:
    """The configuration after constant rates, in the axes of the bodies, have acted for a time.

    Follows the exponential of the rigid motion of each joint: a screw, where it moves and turns. The inverse of
    `difference`. `semi_implicit_step` goes straight instead.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        dt: the time, s: a number or (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        q (*batch, nq), over the common batch; quaternions of unit length, of either sign.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: in "fast" and "reproducible" at most 2 u (|q| + |v dt|) of each coordinate that is a number; 8 u of a
        quaternion, in its 2-norm, and u |w dt| more beyond half a turn; 8 u (|p| + |v dt|) of positions in "planar" and
        "free" joints, in their 2-norms, and u |w dt| |v dt| more beyond half a turn. In the other two 1.01 u of each of
        these (number, quaternion, position), relative to it.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 2.36.
    """
    return _integrate(precision, mechanism, q, v, dt)


def difference(mechanism: Mechanism, q0: Coordinates, q1: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """The rates that lead from one configuration to another in unit time, the short way round.

    `integrate(mechanism, q0, difference(mechanism, q0, q1))` is q1. At half a turn between orientations see
    `Rotation.log`.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q0: (*batch, nq) coordinates at the start: rad, m, quaternions (read normalised).
        q1: (*batch, nq) coordinates at the end.
        precision: name of a precision; None takes the default.

    Returns:
        v (*batch, nv), over the common batch: rad/s, m/s.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: in "fast" and "reproducible" at most 2 u (|q0| + |q1|) of each coordinate that is a number; 4 u (|q0| +
        |q1|) of the angle of "continuous" and "planar" joints; 12 u of a rotation vector, rad, in its 2-norm; 8 u (|p0|
        + |p1|) (1 + |w|) of positions in "planar" and "free" joints. In the other two 1.01 u of each of these (number,
        rotation vector, position), relative to it, while orientations are not opposite.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 2.36.
    """
    return _difference(precision, mechanism, q0, q1)


def interpolate(
    mechanism: Mechanism, q0: Coordinates, q1: Coordinates, t: Scalar, *, precision: PrecisionName = None
) -> jax.Array:
    """The configuration on the way from q0 to q1 at constant rates: `integrate(q0, difference(q0, q1), t)`.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q0: (*batch, nq) coordinates at t = 0: rad, m, quaternions (read normalised).
        q1: (*batch, nq) coordinates at t = 1.
        t: a number or (*batch,), any number.
        precision: name of a precision; None takes the default.

    Returns:
        q (*batch, nq), over the common batch; quaternions of unit length, of either sign.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: at most that of `integrate` and |t| times that of `difference`; in "compensated" and "faithful" too the rates
        between the two are rounded to the dtype.
    Source: Murray, Li, Sastry 1994, A mathematical introduction to robotic manipulation, 2.36 (the screw motion between
        two poses).
    """
    return integrate(mechanism, q0, difference(mechanism, q0, q1, precision=precision), t, precision=precision)


def configuration_rates(
    mechanism: Mechanism, q: Coordinates, v: Rates, *, precision: PrecisionName = None
) -> jax.Array:
    """The time derivative of q at the rates v: for solvers that step q as an array, and its tangent along v.

    Of a quaternion it is q (0, w) / 2, which keeps its length, and is in proportion to it: at any length a solver turns
    it as fast.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions of any length.
        v: (*batch, nv) rates: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        dq/dt (*batch, nq), over the common batch: rad/s, m/s, 1/s of quaternions.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: none of coordinates that are numbers; in "fast" and "reproducible" at most 2 u |w| of a unit
        quaternion's and 6 u |v| of a position's in "planar" and "free" joints, in 2-norms. In the other two 1.01 u of
        each of these, relative to it.
    Source: of quaternions, Shuster 1993, A survey of attitude representations.
    """
    return _configuration_rates(precision, mechanism, q, v)


def random_configuration(
    mechanism: Mechanism, key: Key, batch_shape: BatchShape = (), dtype: DTypeLike | None = None
) -> jax.Array:
    """A random configuration.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        key: of `jax.random`.
        batch_shape: an integer or a tuple.
        dtype: of floating point; None takes that of the mechanism.

    Returns:
        q (*batch, nq): uniform within the limits where there are two, angles else within half a turn, lengths within 1
        m of zero, orientations uniform.

    Raises:
        TypeError: the first argument is no Mechanism.

    Error: none, it is random.
    Source: of orientations, Muller 1959, A note on a method for generating points uniformly on n-dimensional spheres.
    """
    dtype = np.dtype(dtype or checked_mechanism("random_configuration", mechanism).dtype)
    batch_shape = (batch_shape,) if isinstance(batch_shape, int) else tuple(batch_shape)
    t = mechanism.topology
    parts = [
        _random(mechanism, i, k, batch_shape, dtype)
        for i, k in enumerate(jax.random.split(key, len(t)))
        if not t.is_mimic(i)
    ]
    return jnp.concatenate(parts, -1)


@algorithm(*JOINTS)
def _integrate(state: MechanismState, v: Array, dt: Array):
    """Each joint on its own: those of one kind side by side."""
    (time,) = state.numbers(dt)
    found = [own.apply("integrate", tuple(x * time for x in own.rates(v))) for own in state.kind_states]
    return state.by_coordinate(found, state.topology.joints_by_kind)


@algorithm(*JOINTS)
def transport(state: MechanismState, v: Array):
    """w x v of linear rates along axes that their own joint turns: what their derivative in the parent's axes has more
    than dv/dt."""
    return state.by_rate(
        [own.joint.transport(own.rates(v)) for own in state.kind_states], state.topology.joints_by_kind
    )


@algorithm(*JOINTS)
def advance(state: MechanismState, v: Array, dt: Array):
    """(q, v) after the time, as `JointKind.advance` has it: v is along the axes at q before, at the new q after."""
    (time,), kinds = state.numbers(dt), state.topology.joints_by_kind
    found = [own.apply("advance", own.rates(v), time) for own in state.kind_states]
    q, rates = zip(*found, strict=True)
    return state.by_coordinate(q, kinds), state.by_rate(rates, kinds)


@algorithm(*JOINTS)
def _configuration_rates(state: MechanismState, v: Array):
    return state.by_coordinate([own.dq_dt(own.rates(v))[0] for own in state.kind_states], state.topology.joints_by_kind)


@algorithm(*JOINTS, at="q0")
def _difference(state: MechanismState, q1: Array):
    found = [own.apply("difference", own.configuration(q1)) for own in state.kind_states]
    return state.by_rate(found, state.topology.joints_by_kind)


def _random(mechanism: Mechanism, i: int, key: Key, batch_shape: tuple[int, ...], dtype: DTypeLike):
    kind, own = mechanism.topology.kind(i), mechanism.topology.q_slice(i)
    lower, upper = (jnp.asarray(x[own], dtype) for x in (mechanism.lower, mechanism.upper))
    return kind.random(key, lower, upper, batch_shape)
