"""The centre of mass of a mechanism, and momentum about it."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import noinline
from jaxspatial.dynamics.algorithm import BODIES, algorithm, checked
from jaxspatial.dynamics.kinematics import poses, velocities
from jaxspatial.dynamics.mass_matrix import composites, inertia_times, wrench_to_parent
from jaxspatial.dynamics.state import Pose
from jaxspatial.inertia import symmetric
from jaxspatial.spatial import SpatialMomentum


def center_of_mass(mechanism, q, *, precision=None):
    """p_WC_W (*batch, 3) of all bodies that move, m; NaN where they have no mass.

    mechanism: Mechanism; q (*batch, nq)
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    (q,) = checked("center_of_mass", mechanism, q=q)
    return _center_of_mass(precision, mechanism, q)


def center_of_mass_velocity(mechanism, q, v, *, precision=None):
    """v_WC_W (*batch, 3), m/s: the time derivative of `center_of_mass`.

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv)
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    q, v = checked("center_of_mass_velocity", mechanism, q=q, v=v)
    return _center_of_mass_velocity(precision, mechanism, q, v)


def center_of_mass_jacobian(mechanism, q, *, precision=None):
    """J (*batch, 3, nv), with v_WC_W = J v.

    mechanism: Mechanism; q (*batch, nq)
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two.
    """
    (q,) = checked("center_of_mass_jacobian", mechanism, q=q)
    return _center_of_mass_jacobian(precision, mechanism, q)


def centroidal_momentum(mechanism, q, v, *, precision=None):
    """L_WC_W: the SpatialMomentum (*batch,) of all bodies that move, about their centre of mass, in world axes.

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv). That of rotors (armature) is not in it. Free of external
    forces and gravity, it does not change.
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two. [Orin, Goswami, Lee 2013]
    """
    q, v = checked("centroidal_momentum", mechanism, q=q, v=v)
    return SpatialMomentum(*_centroidal_momentum(precision, mechanism, q, v))


def centroidal_momentum_matrix(mechanism, q, *, precision=None):
    """A (*batch, 6, nv), rotational on top, with `centroidal_momentum` = A v.

    mechanism: Mechanism; q (*batch, nq).
    Error of the largest number, for n links one behind the other: at most 4 n u in "fast" and "reproducible", 1.01 u in
    the other two. [Orin, Goswami, Lee 2013, equation 25]
    """
    (q,) = checked("centroidal_momentum_matrix", mechanism, q=q)
    return _centroidal_momentum_matrix(precision, mechanism, q)


# -- sums over bodies -------------------------------------------------------------------------------------------------


@algorithm(*BODIES)
def _center_of_mass(state):
    return _center(state, poses(state))


def _center(state, placed):
    mass, moment = moments(state, placed)
    return tuple(x / mass for x in moment)


def moments(state, placed):
    """(the mass, the sum of m p_WC) of all bodies, with X_WJ of every bundle."""
    own = [(state.inertia(b), X) for b, X in zip(state.bundles, placed, strict=True)]
    return _mass(state), _total(state, [noinline(_moment)(inertia, X) for inertia, X in own])


def _mass(state):
    return state.total([state.inertia(b).mass for b in state.bundles])


def _total(state, vectors_):
    """The sum of vectors, one for every bundle."""
    return tuple(state.total([x[k] for x in vectors_]) for k in range(len(vectors_[0])))


def _moment(inertia, X_WJ):
    return vectors.times(inertia.mass, vectors.plus(X_WJ.p, vectors.matrix_times(X_WJ.rows, inertia.com)))


@algorithm(*BODIES)
def _center_of_mass_velocity(state, v):
    both = zip(poses(state), velocities(state, v), state.bundles, strict=True)
    momenta = [noinline(_linear_momentum)(state.inertia(b), X, V) for X, V, b in both]
    mass = _mass(state)
    return tuple(x / mass for x in _total(state, momenta))


def _linear_momentum(inertia, X_WJ, V):
    v = vectors.plus(V[1], vectors.cross(V[0], inertia.com))
    return vectors.matrix_times(X_WJ.rows, vectors.times(inertia.mass, v))


@algorithm(*BODIES)
def _centroidal_momentum(state, v):
    """About a point that moves with the centre of mass: each body's velocity is taken relative to it."""
    placed = poses(state)
    both = zip(placed, velocities(state, v), state.bundles, strict=True)
    center = _center(state, placed)
    momenta = [noinline(_momentum)(state.inertia(b), X, V, center) for X, V, b in both]
    found = _total(state, momenta)
    return found[:3], found[3:]


def _momentum(inertia, X_WJ, V, p_WC):
    l = _linear_momentum(inertia, X_WJ, V)  # noqa: E741
    arm = vectors.plus(vectors.minus(X_WJ.p, p_WC), vectors.matrix_times(X_WJ.rows, inertia.com))
    spin = vectors.matrix_times(symmetric.rows(inertia.central), V[0])
    return *vectors.plus(vectors.matrix_times(X_WJ.rows, spin), vectors.cross(arm, l)), *l


# -- matrices ---------------------------------------------------------------------------------------------------------


@algorithm(*BODIES)
def _center_of_mass_jacobian(state):
    """The linear momentum of composite bodies at a unit rate, over the mass."""
    mass = _mass(state)
    found = [tuple(tuple(x / mass for x in column[3:]) for column in columns) for columns in _of_rates(state, None)]
    return state.matrix_by_rate(found)


@algorithm(*BODIES)
def _centroidal_momentum_matrix(state):
    return state.matrix_by_rate(_of_rates(state, True))


def _of_rates(state, about_center):
    """Of every rate of every bundle the momentum of all behind its joint, about the centre of mass or J, in world
    axes."""
    placed = poses(state)
    center = _center(state, placed) if about_center else None
    return [_of_bundle(*numbers, center) for numbers in zip(state.joints, composites(state), placed, strict=True)]


def _of_bundle(joint, composite, X_WJ, center):
    X_CJ = Pose(X_WJ.rows, vectors.minus(X_WJ.p, X_WJ.p if center is None else center))
    return tuple(noinline(_about)(composite, motion, X_CJ) for motion in joint.subspace)


def _about(composite, motion, X_CJ):
    return wrench_to_parent(X_CJ, inertia_times(composite, motion))
