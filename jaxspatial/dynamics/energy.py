"""Kinetic and potential energy."""

import jax

from jaxspatial.dynamics.bounds import ALGORITHM
from jaxspatial.dynamics.centroid import moments
from jaxspatial.dynamics.kinematics import poses, velocities
from jaxspatial.engine.algorithm import BODIES, algorithm
from jaxspatial.engine.stacking import Array
from jaxspatial.engine.state import MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.numerics.linear import dot
from jaxspatial.numerics.numbers import Number, doubled
from jaxspatial.numerics.promise import promises
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.spatial.algebra import twice_energy


@promises(bound=ALGORITHM)
def kinetic_energy(mechanism: Mechanism, q: ArrayLike, v: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The kinetic energy, v^T M v / 2, with that of rotors (armature).

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) generalized velocities: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch,), J.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: its definition, the sum of m |v_C|^2 / 2 + w . I w / 2 of all bodies.

    Example:
        >>> print(js.kinetic_energy(arm, q, v))
        3.553433
    """
    return _kinetic_energy(precision, mechanism, q, v)


@promises(bound=ALGORITHM)
def potential_energy(mechanism: Mechanism, q: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """The potential energy of gravity, -sum of m g . p.

    Args:
        mechanism: the mechanism, see `Mechanism`.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch,), J: zero where all centres of mass are at the world's origin.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: of every number at most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two;
        n, r and mag as in `jaxspatial.dynamics.bounds`.
    Source: its definition.

    Example:
        >>> print(js.potential_energy(arm, q) - js.potential_energy(arm, jnp.zeros(2)))
        4.0408936
    """
    return _potential_energy(precision, mechanism, q)


@algorithm(*BODIES, "armature")
def _kinetic_energy(state: MechanismState, v: Array):
    of_bodies = list[Number]()
    for link, V in zip(state.links(v), velocities(state, v), strict=True):
        of_rotors = dot([i * x for i, x in zip(link.armature, link.v, strict=True)], link.v)
        of_bodies.append(twice_energy(link.inertia, V) + of_rotors)
    return doubled(state.sum_over_bodies(of_bodies), -1)


@algorithm(*BODIES, "gravity")
def _potential_energy(state: MechanismState):
    _, moment = moments(state, poses(state))
    return dot(state.minus_gravity, moment)
