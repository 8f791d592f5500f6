"""External forces: what pulls on bodies besides their joints."""

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.numbers import shared
from jaxspatial.dynamics import recursion
from jaxspatial.dynamics.kinematics import poses
from jaxspatial.spatial import SpatialForce


def checked_forces(operation, mechanism, external_forces, q):
    """(the numbers of the bodies that are pulled, the arrays (tau, f) of each)."""
    external_forces = external_forces or {}
    if not isinstance(external_forces, dict):
        came = type(external_forces).__name__
        raise TypeError(f"{operation}: external_forces: expected SpatialForces in a dict by body name, got {came}")
    found = {}
    for name, F in external_forces.items():
        i = mechanism.topology.index(mechanism.body_names, name, f"{operation}: external_forces")
        if not isinstance(F, SpatialForce):
            raise TypeError(f"{operation}: external_forces[{name!r}]: expected a SpatialForce, got {type(F).__name__}")
        check.require_same_dtype(q=q, **{f"external_forces[{name!r}]": F})
        check.common_batch_shape(q=q.shape[:-1], **{f"external_forces[{name!r}]": F.batch_shape})
        found[i] = F.tau, F.f
    bodies = tuple(sorted(found))
    return bodies, tuple(found[i] for i in bodies)


def loads(scene, bodies, forces):
    """(tau, f) of every segment, about J in its axes: known zeros where nothing pulls."""
    zero = (scene.known(0.0),) * 3
    found = [(zero, zero)] * len(scene.segments)
    if not bodies:
        return found
    placed = poses(scene)
    for body, (tau, f) in zip(bodies, forces, strict=True):
        k, place = scene.place(body)
        segment = scene.segments[k]
        frames = (placed[k], scene.child_placement(segment))
        frames = scene.of_body(k, place, frames)
        load = shared(_about_joint)(*frames, scene.numbers(tau), scene.numbers(f))
        found[k] = _put(scene, segment, place, found[k], load)
    return found


def _about_joint(X_WJ, X_JB, tau, f):
    """Of a wrench about Bo in world axes: about Jo in those of J."""
    R_JW = vectors.transpose(X_WJ.rows)
    f = vectors.matrix_times(R_JW, f)
    return vectors.plus(vectors.matrix_times(R_JW, tau), vectors.cross(X_JB.p, f)), f


def _put(scene, segment, place, old, load):
    """The loads of a segment, with one of its bodies'."""
    if not segment.is_chain:
        return load
    columns = [tuple(scene.spread(segment, x) for x in part) for part in old]
    return tuple(recursion.with_column(c, place, x) for c, x in zip(columns, load, strict=True))
