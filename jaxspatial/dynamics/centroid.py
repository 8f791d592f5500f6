"""The centre of mass of a mechanism, and momentum about it."""

import math
from collections.abc import Sequence

import jax

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.composite_bodies import composites
from jaxspatial.dynamics.kinematics import poses, velocities
from jaxspatial.engine.algorithm import BODIES, algorithm
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.linear import Inertia, Motion, Pose, Vector, Wrench, cross
from jaxspatial.numerics.numbers import Number, Numbers
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial import SpatialMomentum
from jaxspatial.spatial.algebra import acted_wrench, apply_inertia


@promises(bound=ALGORITHM)
def center_of_mass(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The centre of mass of all bodies that move.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        p_WC_W (*batch, 3), m; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: its definition, sum of m p over sum of m.

    Example:
        >>> print(js.center_of_mass(arm, jnp.zeros(2)))
        [-0.  0. -1.]
    """
    return _center_of_mass(precision, mechanism, q)


@promises(bound=ALGORITHM)
def center_of_mass_velocity(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, *, precision: PrecisionName = None
) -> jax.Array:
    """The time derivative of `center_of_mass`.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        v_WC_W (*batch, 3), m/s; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: its definition, sum of m v over sum of m.

    Example:
        >>> print(js.center_of_mass_velocity(arm, jnp.zeros(2), v))
        [-1.125  0.     0.   ]
    """
    return _center_of_mass_velocity(precision, mechanism, q, v)


@promises(bound=ALGORITHM)
def center_of_mass_jacobian(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The Jacobian of the centre of mass: v_WC_W = J v.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        J (*batch, 3, nv); NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Orin, Goswami, Lee 2013, Centroidal dynamics of a humanoid robot.

    Example:
        >>> J = js.center_of_mass_jacobian(arm, jnp.zeros(2))
        >>> print(J @ v)
        [-1.125  0.     0.   ]
    """
    return _center_of_mass_jacobian(precision, mechanism, q)


@promises(bound=ALGORITHM)
def centroidal_momentum(
    mechanism: Mechanism, q: ArrayLike, v: ArrayLike, *, precision: PrecisionName = None
) -> SpatialMomentum:
    """The momentum of all bodies that move, about their centre of mass.

    Without external forces, gravity, and armature of a floating root it does not change. Rotors (armature) are no part
    of it.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        L_WC_W (*batch,), in world axes: N m s, N s; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Orin, Goswami, Lee 2013, Centroidal dynamics of a humanoid robot.

    Example:
        >>> js.centroidal_momentum(arm, jnp.zeros(2), v)
        SpatialMomentum(h=[-0.0, 1.6666667, -0.0], l=[-4.5, 0.0, 0.0])
    """
    return SpatialMomentum(*_centroidal_momentum(precision, mechanism, q, v))


@promises(bound=ALGORITHM)
def centroidal_momentum_matrix(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The matrix A of `centroidal_momentum` = A v.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        A (*batch, 6, nv), rotational rows on top; NaN where the bodies have no mass.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: Orin, Goswami, Lee 2013, Centroidal dynamics of a humanoid robot, equation 25.

    Example:
        >>> A = js.centroidal_momentum_matrix(arm, jnp.zeros(2))
        >>> print(A @ v)
        [ 0.      1.6667  0.     -4.5     0.      0.    ]
    """
    return _centroidal_momentum_matrix(precision, mechanism, q)


# -- sums over bodies -------------------------------------------------------------------------------------------------


@algorithm(*BODIES)
def _center_of_mass(state: MechanismState):
    return _center(state, poses(state))


def _center(state: MechanismState, placed: list[Pose]) -> Vector:
    mass, moment = moments(state, placed)
    return Vector(*_over_mass(state, mass, moment))


def _over_mass(state: MechanismState, mass: Number, sums: Numbers) -> Numbers:
    """Sums over bodies divided by their mass; NaN without bodies, as where they have no mass."""
    return tuple(x / mass if state.bundles else state.known(math.nan) for x in sums)


def moments(state: MechanismState, placed: list[Pose]) -> tuple[Number, Vector]:
    """(the mass, the sum of m p_WC) of all bodies. placed: X_WJ of every bundle."""
    inertias = map(state.inertia, state.bundles)
    of_bundles = [M.mass * (X.p + X.R @ M.com) for M, X in zip(inertias, placed, strict=True)]
    return _mass(state), Vector(*_sum_over_bodies(state, of_bundles, 3))


def _mass(state: MechanismState) -> Number:
    return state.sum_over_bodies([state.inertia(b).mass for b in state.bundles])


def _sum_over_bodies(state: MechanismState, of_bundles: Sequence[Numbers], k: int) -> Numbers:
    """The sum over all bodies of k numbers for every bundle."""
    return tuple(state.sum_over_bodies([x[i] for x in of_bundles]) for i in range(k))


@algorithm(*BODIES)
def _center_of_mass_velocity(state: MechanismState, v: Array):
    both = zip(poses(state), velocities(state, v), state.bundles, strict=True)
    momenta = [_linear_momentum(state.inertia(b), X, V) for X, V, b in both]
    return _over_mass(state, _mass(state), _sum_over_bodies(state, momenta, 3))


def _linear_momentum(M: Inertia, X_WJ: Pose, V: Motion) -> Vector:
    return X_WJ.R @ (M.mass * (V.v + cross(V.w, M.com)))


@algorithm(*BODIES)
def _centroidal_momentum(state: MechanismState, v: Array):
    """About a point that moves with the centre of mass: the velocity of each body is taken relative to it."""
    placed = poses(state)
    center = _center(state, placed)
    if not state.bundles:
        return center, state.zero_vector
    momenta = list[Numbers]()
    for X, V, b in zip(placed, velocities(state, v), state.bundles, strict=True):
        M = state.inertia(b)
        linear = _linear_momentum(M, X, V)
        arm = X.p - center + X.R @ M.com
        momenta.append((*(X.R @ (M.central @ V.w) + cross(arm, linear)), *linear))
    h_and_l = _sum_over_bodies(state, momenta, 6)
    return h_and_l[:3], h_and_l[3:]


# -- matrices ---------------------------------------------------------------------------------------------------------


@algorithm(*BODIES)
def _center_of_mass_jacobian(state: MechanismState):
    """Its columns: the linear momentum of a composite body at a unit velocity, divided by the mass."""
    mass = _mass(state)
    columns = _of_unit_velocities(state, about_center=False)
    return state.matrix_by_velocity([tuple(L.f / mass for L in of_joint) for of_joint in columns], 3)


@algorithm(*BODIES)
def _centroidal_momentum_matrix(state: MechanismState):
    columns = _of_unit_velocities(state, about_center=True)
    return state.matrix_by_velocity([tuple((*L.tau, *L.f) for L in of_joint) for of_joint in columns], 6)


def _of_unit_velocities(state: MechanismState, about_center: bool) -> list[tuple[Wrench, ...]]:
    """For every velocity of every bundle, the momentum of the composite body at this unit velocity.

    In world axes, about the centre of mass or J.
    """
    placed = poses(state)
    center = _center(state, placed) if about_center else None
    momenta = list[tuple[Wrench, ...]]()
    for joint, composite, X_WJ in zip(state.joints, composites(state), placed, strict=True):
        X_CJ = Pose(X_WJ.R, X_WJ.p - (X_WJ.p if center is None else center))
        momenta.append(tuple(acted_wrench(X_CJ, apply_inertia(composite, s)) for s in joint.subspace))
    return momenta
