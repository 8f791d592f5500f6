"""What `plot` and `viewer` share: colours, sizes, the shapes of a file, and where forces and contacts are."""

import pathlib
import xml.etree.ElementTree
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.mechanism import AppliedForces, HalfSpace, Mechanism, PointContacts
from jaxspatial.mechanism.formats.collision import path_of_mesh
from jaxspatial.numerics import check
from jaxspatial.numerics.numbers.components import as_array
from jaxspatial.spatial import SpatialForce

# They can be read on white and on black, and told apart with every kind of colour vision.
BODY, JOINT, GROUND = "#7b8794", "#2f7fc1", "#8a94a0"
FORCE, TORQUE, INERTIA = "#e0521f", "#a64ac9", "#00798c"
XYZ = "#d1495b", "#3a7d44", "#00798c"


def spheres(operation: str, contacts: Any) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """The frames, the centres (m, 3) on them and the radii (m,) of contacts that are the same in all states."""
    check.require_kind(contacts, PointContacts, f"{operation}: contacts")
    if contacts.batch_shape:
        raise ValueError(f"{operation}: contacts: expected one for all states, got a batch {contacts.batch_shape}")
    n = len(contacts.frames)
    p = np.zeros((n, 3)) if contacts.positions is None else np.asarray(contacts.positions, float)
    return contacts.frames, p, np.broadcast_to(np.asarray(contacts.radius, float), n)


def plane(operation: str, ground: HalfSpace) -> tuple[np.ndarray, float]:
    """(the normal, of length one, the offset) of a ground that is the same in all states."""
    if ground.batch_shape:
        raise ValueError(f"{operation}: ground: expected one plane, got a batch {ground.batch_shape}")
    normal = np.asarray(ground.normal, float)
    return normal / np.linalg.norm(normal), float(ground.offset)


# -- shapes -----------------------------------------------------------------------------------------------------------


def meshes(operation: str, mech: Mechanism, path: str | pathlib.Path) -> dict[str, list[Any]]:
    """The visual meshes of a URDF by link, in the axes of the link.

    viser's own ViserUrdf computes poses itself, of the joints of the file: here they come from the mechanism, which may
    float, or have joints that are locked."""
    path = pathlib.Path(path)
    try:
        import yourdfpy
    except ImportError as error:
        way_out = "needs the package viser[urdf]: from a clone, pip install '.[view]'"
        raise ImportError(f"{operation}: shapes: {way_out}") from error
    if not path.is_file():
        raise FileNotFoundError(f"{operation}: shapes: there is no file {path}")
    try:
        tag = xml.etree.ElementTree.parse(path).getroot().tag
    except xml.etree.ElementTree.ParseError as error:
        raise ValueError(f"{operation}: shapes: {path}: expected a URDF, got malformed XML: {error}") from None
    if tag != "robot":
        way_out = "; without shapes, the solid boxes with the inertias of bodies are shown" if tag == "mujoco" else ""
        raise ValueError(f"{operation}: shapes: {path}: expected a URDF, <robot>, got <{tag}>{way_out}")
    try:
        urdf = yourdfpy.URDF.load(
            str(path), filename_handler=lambda fname: str(path_of_mesh(fname, path.parent) or fname)
        )
    except KeyError as error:
        raise ValueError(f"{operation}: shapes: {path}: an element lacks the attribute {error}") from error
    found: dict[str, list[Any]] = {}
    for name, mesh in urdf.scene.geometry.items():
        link = urdf.scene.graph.transforms.parents[name]
        mech.topology.index(mech.frame_names, link, f"{operation}: shapes: a link of the file")
        # Scales and reflections are part of it.
        found.setdefault(link, []).append(mesh.copy().apply_transform(urdf.get_transform(name, link)))
    return found


# -- forces -----------------------------------------------------------------------------------------------------------


class Placed(NamedTuple):
    """m wrenches in each of n states: their points, torques and forces (n, m, 3), in world axes."""

    p: np.ndarray
    tau: np.ndarray
    f: np.ndarray


def wrenches(operation: str, mech: Mechanism, q: np.ndarray, forces: ExternalForces) -> Placed | None:
    """Those of external forces in states q (n, nq); None where there are none."""
    sources = {"forces": forces}
    if isinstance(forces, list | tuple):
        sources = {f"forces[{i}]": x for i, x in enumerate(forces)}
        _refuse_one_each(operation, forces, len(q))
    applied = [x for name, source in sources.items() for x in _applied(f"{operation}: {name}", source)]
    names = [name for _, x in applied for name in x.frames]
    if not names:
        return None
    X_WF = forward_kinematics(mech, q, names, precision="fast")
    R, p = np.asarray(X_WF.rotation.to_matrix()), np.asarray(X_WF.translation)
    ends = np.cumsum([len(x.frames) for _, x in applied])[:-1]
    frames = zip(applied, np.split(R, ends, axis=1), np.split(p, ends, axis=1), strict=True)
    parts = zip(*(_placed(*x, *at) for x, *at in frames), strict=True)
    return Placed(*(np.concatenate(x, axis=1) for x in parts))


def _refuse_one_each(operation: str, forces: Sequence[Any], n: int) -> None:
    """A list adds up. As many as there are states, on the same frames, are rather meant to be one for each."""
    frames = [
        tuple(x.frames if isinstance(x, AppliedForces) else x) for x in forces if isinstance(x, AppliedForces | dict)
    ]
    batched = any(getattr(x, "batch_shape", ()) for x in forces)
    if len(frames) == n > 1 and len(set(frames)) == 1 and frames[0] and not batched:
        raise ValueError(
            f"{operation}: forces: a list acts together, as in `external_forces`, got {n} on the same frames in "
            f"{n} states; "
            "for one in each state: jax.tree.map(lambda *x: np.stack(x), *forces); for all of them in every state: "
            "AppliedForces, in whose frames a name may come several times"
        )


def _applied(what: str, source: Any) -> list[tuple[str, AppliedForces]]:
    """What is no list, as AppliedForces under their names in messages."""
    if isinstance(source, AppliedForces):
        return [(what, source)] if source.frames else []
    if not isinstance(source, dict | None):
        expected = "SpatialForces in a dict by name of a frame, AppliedForces, or a list of these"
        check.refuse(what, expected, source)
    found: list[tuple[str, AppliedForces]] = []
    for name, F in (source or {}).items():
        check.require_kind(F, SpatialForce, f"{what}[{name!r}]")
        vectors: list[Any] = [np.asarray(as_array(x, F.batch_shape))[..., None, :] for x in F._vectors]
        found.append((f"{what}[{name!r}]", AppliedForces([name], SpatialForce(*vectors))))
    return found


def _placed(what: str, forces: AppliedForces, R: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
    """The points, the torques and the forces (n, m, 3), in world axes; of frames with these axes and origins."""
    n = len(p)
    if forces.batch_shape not in ((), (n,)):
        raise ValueError(f"{what}: expected one for all states or ({n},), got {forces.batch_shape}")
    if forces.points is not None:
        p = p + np.einsum("nmij,nmj->nmi", R, np.broadcast_to(np.asarray(forces.points), p.shape))
    wrenches = forces.wrenches
    parts = (np.broadcast_to(np.asarray(as_array(x, wrenches.batch_shape)), p.shape) for x in wrenches._vectors)
    tau, f = (np.einsum("nmij,nmj->nmi", R, x) if forces.axes == "frame" else x for x in parts)
    return p, tau, f
