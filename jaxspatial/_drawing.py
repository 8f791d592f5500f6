"""What `plot` and `viewer` share: colours, the ground, the shapes of a file, and where forces and contacts are."""

import itertools
import pathlib
import xml.etree.ElementTree
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.mechanism import AppliedForces, HalfSpace, Mechanism, PointContacts
from jaxspatial.mechanism.formats.collision import path_of_mesh
from jaxspatial.numerics import check
from jaxspatial.numerics.numbers.components import as_array
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.spatial import SpatialForce

# They can be read on white and on black, and told apart with every kind of colour vision.
BODY, JOINT, GROUND = "#7b8794", "#2f7fc1", "#8a94a0"
FORCE, TORQUE, INERTIA = "#e0521f", "#a64ac9", "#00798c"
XYZ = "#d1495b", "#3a7d44", "#00798c"
# The six tetrahedra of a cube: each goes from one corner to the opposite one, along the axes in one of their orders.
_TETRAHEDRA = np.stack(
    [np.cumsum([(0, 0, 0), *np.eye(3, dtype=int)[[*order]]], axis=0) for order in itertools.permutations(range(3))]
)
# Between which of four corners, from the lowest distance to the highest, the surface passes, by how many are inside.
_CUTS = {1: [(0, 1), (0, 2), (0, 3)], 2: [(0, 2), (0, 3), (1, 3), (1, 2)], 3: [(0, 3), (1, 3), (2, 3)]}


def spheres(operation: str, contacts: Any) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """The frames, the centres (m, 3) on them and the radii (m,) of contacts that are the same in all states."""
    check.require_kind(contacts, PointContacts, f"{operation}: contacts")
    if contacts.batch_shape:
        raise ValueError(f"{operation}: contacts: expected one for all states, got a batch {contacts.batch_shape}")
    n = len(contacts.frames)
    p = np.zeros((n, 3)) if contacts.positions is None else np.asarray(contacts.positions, float)
    return contacts.frames, p, np.broadcast_to(np.asarray(contacts.radius, float), n)


# -- the ground -------------------------------------------------------------------------------------------------------


def plane(operation: str, ground: HalfSpace) -> tuple[np.ndarray, float]:
    """(the normal, of length one, the offset) of a ground that is the same in all states."""
    if ground.batch_shape:
        raise ValueError(f"{operation}: ground: expected one plane, got a batch {ground.batch_shape}")
    normal = np.asarray(ground.normal, float)
    return normal / np.linalg.norm(normal), float(ground.offset)


def surface(
    operation: str, ground: Callable[[jax.Array], Any], centre, edge: float, cells: int, dtype: DTypeLike
) -> np.ndarray:
    """The triangles (n, 3, 3) of the ground in a cube about the point of the ground that is next to a centre, m.

    ground: a function from a point (3,) to its signed distance; distances of any slope serve, and where they are not
    finite there is no ground. edge: of the cube. cells: along each edge; a plane is exact, other surfaces are as near
    as a distance is to its linear interpolation in a cell. Marching tetrahedra [Doi, Koide 1991].
    """

    def distance(point: jax.Array) -> jax.Array:
        x = jnp.asarray(ground(point))
        if x.shape:
            expected = f"{operation}: ground: expected a signed distance, {np.dtype(dtype)}[], of a point (3,)"
            raise ValueError(f"{expected}, got {check.in_short(x)}")
        return x

    centre = _on_ground(jax.jit(jax.value_and_grad(distance)), np.asarray(centre, dtype))
    grid = np.stack(np.meshgrid(*[np.arange(cells + 1)] * 3, indexing="ij"), axis=-1)
    low, step = centre - edge / 2, edge / cells
    points = (low + step * grid).astype(dtype)
    distances = np.asarray(jax.jit(jax.vmap(distance))(points.reshape(-1, 3)), float).reshape(grid.shape[:3])
    corners = np.stack(
        [distances[tuple(slice(i, cells + i) for i in at)] for at in itertools.product((0, 1), repeat=3)]
    )
    # NaN is neither inside nor outside.
    crossed = np.argwhere((corners <= 0).any(0) & (corners > 0).any(0))
    tetrahedra = (crossed[:, None, None] + _TETRAHEDRA).reshape(-1, 4, 3)
    d = distances[tuple(np.moveaxis(tetrahedra, -1, 0))]
    tetrahedra, d = tetrahedra[np.isfinite(d).all(1)], d[np.isfinite(d).all(1)]
    order = np.argsort(d, axis=1)
    d, p = np.take_along_axis(d, order, 1), low + step * np.take_along_axis(tetrahedra, order[..., None], 1)
    triangles = [_cut(p[k == n], d[k == n], cuts) for k in [(d <= 0).sum(1)] for n, cuts in _CUTS.items()]
    found = np.concatenate(triangles)
    area = np.linalg.norm(np.cross(found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]), axis=-1)
    found = found[area > 1e-9 * step**2]
    if not len(found):
        where = f"{edge:.3g} m about {centre.tolist()}"
        raise ValueError(f"{operation}: ground: expected a distance that is 0 near the robot, got none in {where}")
    return found


def _on_ground(value_and_gradient, p: np.ndarray) -> np.ndarray:
    """A point of the ground, found from another along gradients by Newton's method, or the last one that was finite."""
    for _ in range(30):
        d, gradient = map(np.asarray, value_and_gradient(p))
        with np.errstate(all="ignore"):
            step = d * gradient / (gradient @ gradient)
        if not np.isfinite(step).all() or not step.any():
            break
        p = p - step
    return p.astype(float)


def _cut(p: np.ndarray, d: np.ndarray, cuts: list[tuple[int, int]]) -> np.ndarray:
    """The triangles (m, 3, 3) in tetrahedra (n, 4, 3) that the surface cuts between these corners."""
    ends = [p[:, a] + (d[:, a] / (d[:, a] - d[:, b]))[:, None] * (p[:, b] - p[:, a]) for a, b in cuts]
    fans = [np.stack([ends[0], *ends[i : i + 2]], axis=1) for i in range(1, len(ends) - 1)]
    return np.concatenate(fans)


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
