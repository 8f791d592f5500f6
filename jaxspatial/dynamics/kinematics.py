"""Where bodies are and how they move."""

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.numbers import shared
from jaxspatial.dynamics import recursion
from jaxspatial.dynamics.links import across, combined
from jaxspatial.dynamics.scene import Pose, algorithm, checked
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity


def forward_kinematics(mechanism, q, *, precision=None):
    """X_WB of all bodies, in the order of `mechanism.body_names`: a RigidTransform (*batch, n).

    mechanism: Mechanism; q (*batch, nq)
    """
    (q,) = checked("forward_kinematics", mechanism, q=q)
    entries, p = _forward_kinematics(precision, mechanism, q)
    return RigidTransform(Rotation(entries), p)


def body_velocities(mechanism, q, v, *, precision=None):
    """V_WB_W of all bodies' origins, in world axes: a SpatialVelocity (*batch, n).

    mechanism: Mechanism; q (*batch, nq), v (*batch, nv)
    """
    q, v = checked("body_velocities", mechanism, q=q, v=v)
    return SpatialVelocity(*_body_velocities(precision, mechanism, q, v))


def jacobian(mechanism, q, body, *, precision=None):
    """J (*batch, 6, nv), rotational on top, with V_WB_W = J v for the origin of a body, in world axes.

    mechanism: Mechanism; q (*batch, nq); body: one of `mechanism.body_names`
    """
    (q,) = checked("jacobian", mechanism, q=q)
    i = mechanism.topology.index(mechanism.body_names, body, "jacobian: body")
    return _jacobian(precision, mechanism, q, body=i)


def poses(scene):
    """X_WJ of every segment."""
    own = list(zip(map(scene.placement, scene.segments), scene.joints, strict=True))
    return recursion.outward(scene.segments, _pose, world(scene), own)


def world(scene):
    zero, one = (scene.known(x) for x in (0.0, 1.0))
    return Pose(((one, zero, zero), (zero, one, zero), (zero, zero, one)), (zero, zero, zero))


def _pose(own, X_WP):
    X_WJ = composed(X_WP, across(*own))
    return X_WJ, X_WJ


def composed(X_AB, X_BC):
    p = vectors.plus(X_AB.p, vectors.matrix_times(X_AB.rows, X_BC.p))
    return Pose(vectors.product(X_AB.rows, X_BC.rows), p)


@algorithm
def _forward_kinematics(scene):
    found = [composed(X, scene.child_placement(s)) for s, X in zip(scene.segments, poses(scene), strict=True)]
    return scene.stacked([vectors.flat(X.rows) for X in found]), scene.stacked([X.p for X in found])


def velocities(scene, v):
    """(w, v) of every segment: V_WJ_J."""
    zero = (scene.known(0.0),) * 3
    return recursion.outward(scene.segments, _velocity, (zero, zero), scene.links(v, None))


def _velocity(link, parent):
    X_PB = across(link.placement, link.hinge)
    R_BP = vectors.transpose(X_PB.rows)
    w_r, v_r = combined(link.hinge.subspace, link.v)
    arm = vectors.plus(parent[1], vectors.cross(parent[0], X_PB.p))
    V = vectors.plus(vectors.matrix_times(R_BP, parent[0]), w_r), vectors.plus(vectors.matrix_times(R_BP, arm), v_r)
    return V, V


@algorithm
def _body_velocities(scene, v):
    found = [
        _in_world(X, scene.child_placement(s), V)
        for s, X, V in zip(scene.segments, poses(scene), velocities(scene, v), strict=True)
    ]
    return tuple(scene.stacked([V[k] for V in found]) for k in (0, 1))


def _in_world(X_WJ, X_JB, V):
    """V_WB_W of V_WJ_J."""
    w, v = V
    v = vectors.plus(v, vectors.cross(w, X_JB.p))
    return vectors.matrix_times(X_WJ.rows, w), vectors.matrix_times(X_WJ.rows, v)


@algorithm
def _jacobian(scene, *, body):
    found = poses(scene)
    X_WB = [composed(X, scene.child_placement(s)) for s, X in zip(scene.segments, found, strict=True)]
    segment, place = scene.place(body)
    p_WB = [scene.at(segment, place, x) for x in X_WB[segment].p]
    carriers = set(scene.topology.ancestors(body))
    columns = [
        _columns(scene, s, hinge, X, p_WB, body) if s.start in carriers else _nothing(scene, s)
        for s, hinge, X in zip(scene.segments, scene.joints, found, strict=True)
    ]
    return scene.by_rate(columns).T


def _columns(scene, segment, hinge, X_WJ, p_WB, body):
    """What each rate of the joint does to the body's origin; of a chain, those up to the body."""
    found = []
    arm = vectors.minus(tuple(scene.spread(segment, x) for x in p_WB), X_WJ.p)
    for motion in hinge.subspace:
        found.append(tuple(scene.up_to(segment, body, x) for x in shared(_column)(X_WJ.rows, motion, arm)))
    return tuple(found)


def _column(rows, motion, arm):
    """A motion of J's origin, turned by the rows, of a point at the arm."""
    w, v = (vectors.matrix_times(rows, x) for x in motion)
    return *w, *vectors.plus(v, vectors.cross(w, arm))


def _nothing(scene, segment):
    zero = scene.spread(segment, scene.known(0.0))
    return ((zero,) * 6,) * scene.topology.kind(segment.start).nv
