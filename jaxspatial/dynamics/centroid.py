"""The centre of mass of a mechanism, and momentum about it."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import shared
from jaxspatial.dynamics.kinematics import poses, velocities
from jaxspatial.dynamics.mass_matrix import composites, felt, wrench_to_parent
from jaxspatial.dynamics.scene import Pose, algorithm, checked
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


@algorithm
def _center_of_mass(scene):
    return _center(scene, poses(scene))


def _center(scene, placed):
    mass, moment = moments(scene, placed)
    return tuple(x / mass for x in moment)


def moments(scene, placed):
    """(the mass, the sum of m p_WC) of all bodies, with X_WJ of every segment."""
    own = [(scene.inertia(s), X) for s, X in zip(scene.segments, placed, strict=True)]
    return _mass(scene), _total(scene, [shared(_moment)(inertia, X) for inertia, X in own])


def _mass(scene):
    return scene.total([scene.spread(s, scene.inertia(s).mass) for s in scene.segments])


def _total(scene, vectors_):
    """The sum of vectors, one for every segment."""
    return tuple(scene.total([x[k] for x in vectors_]) for k in range(len(vectors_[0])))


def _moment(inertia, X_WJ):
    return vectors.times(inertia.mass, vectors.plus(X_WJ.p, vectors.matrix_times(X_WJ.rows, inertia.com)))


@algorithm
def _center_of_mass_velocity(scene, v):
    both = zip(poses(scene), velocities(scene, v), scene.segments, strict=True)
    momenta = [shared(_linear_momentum)(scene.inertia(s), X, V) for X, V, s in both]
    mass = _mass(scene)
    return tuple(x / mass for x in _total(scene, momenta))


def _linear_momentum(inertia, X_WJ, V):
    v = vectors.plus(V[1], vectors.cross(V[0], inertia.com))
    return vectors.matrix_times(X_WJ.rows, vectors.times(inertia.mass, v))


@algorithm
def _centroidal_momentum(scene, v):
    """About a point that moves with the centre of mass: each body's velocity is taken relative to it."""
    placed = poses(scene)
    both = zip(placed, velocities(scene, v), scene.segments, strict=True)
    center = _center(scene, placed)
    momenta = [shared(_momentum)(scene.inertia(s), X, V, tuple(scene.spread(s, x) for x in center)) for X, V, s in both]
    found = _total(scene, momenta)
    return found[:3], found[3:]


def _momentum(inertia, X_WJ, V, p_WC):
    l = _linear_momentum(inertia, X_WJ, V)  # noqa: E741
    arm = vectors.plus(vectors.minus(X_WJ.p, p_WC), vectors.matrix_times(X_WJ.rows, inertia.com))
    spin = vectors.matrix_times(symmetric.rows(inertia.central), V[0])
    return *vectors.plus(vectors.matrix_times(X_WJ.rows, spin), vectors.cross(arm, l)), *l


# -- matrices ---------------------------------------------------------------------------------------------------------


@algorithm
def _center_of_mass_jacobian(scene):
    """The linear momentum of composite bodies at a unit rate, over the mass."""
    mass = _mass(scene)
    found = [
        tuple(tuple(x / scene.spread(s, mass) for x in column[3:]) for column in columns)
        for s, columns in zip(scene.segments, _of_rates(scene, None), strict=True)
    ]
    return scene.by_rate(found).T


@algorithm
def _centroidal_momentum_matrix(scene):
    return scene.by_rate(_of_rates(scene, True)).T


def _of_rates(scene, about_center):
    """Of every rate of every segment the momentum of all behind its joint, about the centre of mass or J, in world
    axes."""
    placed = poses(scene)
    center = _center(scene, placed) if about_center else None
    zipped = zip(scene.segments, scene.joints, composites(scene), placed, strict=True)
    return [_of_segment(scene, *numbers, center) for numbers in zipped]


def _of_segment(scene, segment, hinge, composite, X_WJ, center):
    origin = X_WJ.p if center is None else tuple(scene.spread(segment, x) for x in center)
    X_CJ = Pose(X_WJ.rows, vectors.minus(X_WJ.p, origin))
    return tuple(shared(_about)(composite, motion, X_CJ) for motion in hinge.subspace)


def _about(composite, motion, X_CJ):
    return wrench_to_parent(X_CJ, felt(composite, motion))
