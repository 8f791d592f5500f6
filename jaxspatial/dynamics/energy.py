"""Kinetic and potential energy."""

import jax

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import Motion, Numbers, doubled, noinline
from jaxspatial.arithmetic.types import Coordinates, PrecisionName, Rates
from jaxspatial.dynamics.algorithm import BODIES, algorithm
from jaxspatial.dynamics.along import Array
from jaxspatial.dynamics.centroid import moments
from jaxspatial.dynamics.kinematics import poses, velocities
from jaxspatial.dynamics.links import minus_gravity
from jaxspatial.dynamics.state import Inertia, MechanismState
from jaxspatial.mechanism import Mechanism
from jaxspatial.spatial import algebra


def kinetic_energy(mechanism: Mechanism, q: Coordinates, v: Rates, *, precision: PrecisionName = None) -> jax.Array:
    """The kinetic energy, v^T M v / 2, with that of rotors (armature).

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        v: (*batch, nv) rates: rad/s, m/s.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch,), J.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: its definition, the sum of m |v_C|^2 / 2 + w . I w / 2 of all bodies.
    """
    return _kinetic_energy(precision, mechanism, q, v)


def potential_energy(mechanism: Mechanism, q: Coordinates, *, precision: PrecisionName = None) -> jax.Array:
    """The potential energy of gravity, -sum of m g . p.

    Args:
        mechanism: the mechanism. Its NumPy numbers are part of the program, traced ones are its data.
        q: (*batch, nq) coordinates: rad, m, quaternions (read normalised).
        precision: name of a precision; None takes the default.

    Returns:
        (*batch,), J: zero where all centres of mass are at the world's origin.

    Raises:
        TypeError: the first argument is no Mechanism, or dtypes differ or are not floating point.
        ValueError: shapes do not fit.

    Error: for n links one behind the other, r the largest number and mag what it would be if no terms cancelled, at
        most 4 n u mag in "fast" and "reproducible", 1.01 u |r| + 32 n u^2 mag in the other two.
    Source: its definition.
    """
    return _potential_energy(precision, mechanism, q)


@algorithm(*BODIES, "armature")
def _kinetic_energy(state: MechanismState, v: Array):
    of_bodies = [
        noinline(_twice_energy)(link.inertia, V, link.armature, link.v)
        for link, V in zip(state.links(v), velocities(state, v), strict=True)
    ]
    return doubled(state.sum_over_bodies(of_bodies), -1)


def _twice_energy(inertia: Inertia, V: Motion, armature: Numbers, rates: Numbers):
    """m |v_C|^2 + w . I w, and of the rotor."""
    return algebra.twice_kinetic_energy(*inertia, *V) + vectors.dot(
        vectors.componentwise_product(armature, rates), rates
    )


@algorithm(*BODIES, "gravity")
def _potential_energy(state: MechanismState):
    _, moment = moments(state, poses(state))
    return vectors.dot(minus_gravity(state), moment)
