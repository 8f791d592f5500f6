"""Energies, the centre of mass, and momentum about it."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import doubled, shared
from jaxspatial.dynamics.kinematics import poses, velocities
from jaxspatial.dynamics.scene import algorithm, checked
from jaxspatial.inertia import symmetric


def kinetic_energy(mechanism, q, v, *, precision=None):
    """v^T M v / 2 (*batch,), joules, that of rotors (armature) with it.

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv)
    """
    q, v = checked("kinetic_energy", mechanism, q=q, v=v)
    return _kinetic_energy(precision, mechanism, q, v)


def potential_energy(mechanism, q, *, precision=None):
    """Of gravity, - sum of m g . p (*batch,), joules: zero where all centres of mass are at the world's origin.

    mechanism: Mechanism; q (*batch, nq)
    """
    (q,) = checked("potential_energy", mechanism, q=q)
    return _potential_energy(precision, mechanism, q)


def center_of_mass(mechanism, q, *, precision=None):
    """p_WC_W (*batch, 3) of all bodies that move, m; NaN where they have no mass.

    mechanism: Mechanism; q (*batch, nq)
    """
    (q,) = checked("center_of_mass", mechanism, q=q)
    return _center_of_mass(precision, mechanism, q)


@algorithm
def _kinetic_energy(scene, v):
    links = scene.links(v, None)
    of_bodies = [
        shared(_twice_energy)(link.inertia, V, link.armature, link.v)
        for link, V in zip(links, velocities(scene, v), strict=True)
    ]
    return doubled(scene.total(of_bodies), -1)


def _twice_energy(inertia, V, armature, rates):
    """m |v_C|^2 + w . I w, and of the rotor."""
    w, v = V
    at_com = vectors.plus(v, vectors.cross(w, inertia.com))
    turning = vectors.dot(w, vectors.matrix_times(symmetric.rows(inertia.central), w))
    of_rotors = vectors.dot(vectors.products(armature, rates), rates)
    return inertia.mass * vectors.dot(at_com, at_com) + turning + of_rotors


@algorithm
def _potential_energy(scene):
    upward = tuple(-g for g in scene.numbers(scene.mechanism.gravity))
    _, moment = _moments(scene)
    return vectors.dot(upward, moment)


@algorithm
def _center_of_mass(scene):
    mass, moment = _moments(scene)
    return tuple(x / mass for x in moment)


def _moments(scene):
    """(the mass, the sum of m p_WC) of all bodies."""
    own = [(scene.inertia(s), X) for s, X in zip(scene.segments, poses(scene), strict=True)]
    parts = [shared(_moment)(inertia, X) for inertia, X in own]
    masses = [scene.spread(s, inertia.mass) for s, (inertia, _) in zip(scene.segments, own, strict=True)]
    return scene.total(masses), tuple(scene.total([part[k] for part in parts]) for k in range(3))


def _moment(inertia, X_WJ):
    return vectors.times(inertia.mass, vectors.plus(X_WJ.p, vectors.matrix_times(X_WJ.rows, inertia.com)))
