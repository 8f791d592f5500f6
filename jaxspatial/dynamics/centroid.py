"""The centre of mass of a mechanism, and momentum about it."""

import jax

from jaxspatial.arithmetic import symmetric, vectors
from jaxspatial.arithmetic.numbers import Motion, Number, Numbers, Three, noinline
from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics.algorithm import BODIES, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.kinematics import poses, velocities
from jaxspatial.dynamics.links import to_parent
from jaxspatial.dynamics.mass_matrix import composites
from jaxspatial.dynamics.state import Inertia, JointState, MechanismState, Pose
from jaxspatial.mechanism import Mechanism
from jaxspatial.spatial import SpatialMomentum, algebra


def center_of_mass(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """The centre of mass of all bodies that move.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        p_WC_W (*batch, 3), m; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: its definition, sum of m p over sum of m.
    """
    return _center_of_mass(precision, mechanism, q)


def center_of_mass_velocity(
    mechanism: Mechanism, q: Coordinates, v: Rates, *, precision: PrecisionName = None
) -> jax.Array:
    """The time derivative of `center_of_mass`.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        v_WC_W (*batch, 3), m/s; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: its definition, sum of m v over sum of m.
    """
    return _center_of_mass_velocity(precision, mechanism, q, v)


def center_of_mass_jacobian(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """The Jacobian of the centre of mass: v_WC_W = J v.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        J (*batch, 3, nv); NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Orin, Goswami, Lee 2013, Centroidal dynamics of a humanoid robot.
    """
    return _center_of_mass_jacobian(precision, mechanism, q)


def centroidal_momentum(
    mechanism: Mechanism, q: Coordinates, v: Rates, *, precision: PrecisionName = None
) -> SpatialMomentum:
    """The momentum of all bodies that move, about their centre of mass.

    Without external forces and gravity it does not change. That of rotors (armature) is not part of it.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        L_WC_W (*batch,), in world axes: N m s, N s; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Orin, Goswami, Lee 2013, Centroidal dynamics of a humanoid robot.
    """
    return SpatialMomentum(*_centroidal_momentum(precision, mechanism, q, v))


def centroidal_momentum_matrix(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """The matrix of `centroidal_momentum` = A v.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        A (*batch, 6, nv), rotational rows on top; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: Orin, Goswami, Lee 2013, Centroidal dynamics of a humanoid robot, equation 25.
    """
    return _centroidal_momentum_matrix(precision, mechanism, q)


# -- sums over bodies -------------------------------------------------------------------------------------------------


@algorithm(*BODIES)
def _center_of_mass(state: MechanismState):
    return _center(state, poses(state))


def _center(state: MechanismState, placed: list[Pose]) -> Three:
    mass, moment = moments(state, placed)
    return tuple(x / mass for x in moment)


def moments(state: MechanismState, placed: list[Pose]) -> tuple[Number, Three]:
    """(the mass, the sum of m p_WC) of all bodies, with X_WJ of every bundle."""
    own = [(state.inertia(b), X) for b, X in zip(state.bundles, placed, strict=True)]
    return _mass(state), _sum_over_bodies(state, [noinline(_moment)(inertia, X) for inertia, X in own])


def _mass(state: MechanismState):
    return state.sum_over_bodies([state.inertia(b).mass for b in state.bundles])


def _sum_over_bodies(state: MechanismState, vectors_: list[Numbers]):
    """The sum of vectors, one for every bundle."""
    return tuple(state.sum_over_bodies([x[k] for x in vectors_]) for k in range(len(vectors_[0])))


def _moment(inertia: Inertia, X_WJ: Pose):
    return vectors.times(inertia.mass, vectors.plus(X_WJ.p, vectors.matrix_times(X_WJ.rows, inertia.com)))


@algorithm(*BODIES)
def _center_of_mass_velocity(state: MechanismState, v: Array):
    both = zip(poses(state), velocities(state, v), state.bundles, strict=True)
    momenta = [noinline(_linear_momentum)(state.inertia(b), X, V) for X, V, b in both]
    mass = _mass(state)
    return tuple(x / mass for x in _sum_over_bodies(state, momenta))


def _linear_momentum(inertia: Inertia, X_WJ: Pose, V: Motion):
    v = vectors.plus(V[1], vectors.cross(V[0], inertia.com))
    return vectors.matrix_times(X_WJ.rows, vectors.times(inertia.mass, v))


@algorithm(*BODIES)
def _centroidal_momentum(state: MechanismState, v: Array):
    """About a point that moves with the centre of mass: each body's velocity is taken relative to it."""
    placed = poses(state)
    both = zip(placed, velocities(state, v), state.bundles, strict=True)
    center = _center(state, placed)
    momenta = [noinline(_momentum)(state.inertia(b), X, V, center) for X, V, b in both]
    found = _sum_over_bodies(state, momenta)
    return found[:3], found[3:]


def _momentum(inertia: Inertia, X_WJ: Pose, V: Motion, p_WC: Three) -> Numbers:
    l = _linear_momentum(inertia, X_WJ, V)  # noqa: E741
    arm = vectors.plus(vectors.minus(X_WJ.p, p_WC), vectors.matrix_times(X_WJ.rows, inertia.com))
    spin = vectors.matrix_times(symmetric.rows(inertia.central), V[0])
    return *vectors.plus(vectors.matrix_times(X_WJ.rows, spin), vectors.cross(arm, l)), *l


# -- matrices ---------------------------------------------------------------------------------------------------------


@algorithm(*BODIES)
def _center_of_mass_jacobian(state: MechanismState):
    """The linear momentum of composite bodies at a unit rate, over the mass."""
    mass = _mass(state)
    found = [tuple(tuple(x / mass for x in column[3:]) for column in columns) for columns in _of_rates(state, False)]
    return state.matrix_by_rate(found)


@algorithm(*BODIES)
def _centroidal_momentum_matrix(state: MechanismState):
    return state.matrix_by_rate(_of_rates(state, about_center=True))


def _of_rates(state: MechanismState, about_center: bool) -> list[tuple[Numbers, ...]]:
    """Of every rate of every bundle the momentum of all behind its joint, about the centre of mass or J, in world
    axes."""
    placed = poses(state)
    center = _center(state, placed) if about_center else None
    return [_of_bundle(*numbers, center) for numbers in zip(state.joints, composites(state), placed, strict=True)]


def _of_bundle(joint: JointState, composite: Inertia, X_WJ: Pose, center: Three | None):
    X_CJ = Pose(X_WJ.rows, vectors.minus(X_WJ.p, X_WJ.p if center is None else center))
    return tuple(noinline(_about)(composite, motion, X_CJ) for motion in joint.subspace)


def _about(composite: Inertia, motion: Motion, X_CJ: Pose):
    return vectors.flat(to_parent(X_CJ, *algebra.inertia_times(*composite, *motion)))
