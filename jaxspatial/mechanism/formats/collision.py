"""Collision shapes of model files as spheres that touch: `PointContacts.from_urdf` and `from_mjcf`.

| shape | spheres |
|---|---|
| sphere | one |
| capsule | two, at the ends of its axis |
| box | its eight corners |
| cylinder | `rim` on each of its two rims, evenly from the x axis on |
| ellipsoid | the six ends of its axes |
| mesh | the corners of its convex hull, at most `corners` |

Of more corners those are taken that lie farthest apart: first the one that is farthest from the mean of all, then the
one that is farthest from those taken, and so on.
"""

import pathlib
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from jaxspatial.mechanism.formats.source import needed
from jaxspatial.mechanism.parts import WORLD
from jaxspatial.mechanism.topology import Topology
from jaxspatial.numerics import check
from jaxspatial.spatial import RigidTransform

# Shares of the size of a mesh below which it is flat, and below which two corners are one.
_FLAT, _SAME = 1e-9, 1e-9


class CollisionShape(NamedTuple):
    """A collision shape of a file. size: m; of a sphere and a capsule the radius comes first."""

    name: str
    body: str
    pose: RigidTransform  # X_BS, in the frame of its body
    kind: str
    size: tuple[float, ...]
    vertices: Callable[[], np.ndarray] | None = None  # of a mesh: (n, 3) in the axes of the shape, m
    friction: float = np.nan
    may_touch: bool = True  # by the masks of the file


def chosen(operation: str, shapes: list[CollisionShape], t: Topology, bodies: Any, geoms: Any) -> list[CollisionShape]:
    """The shapes on these bodies, and those of these names, whatever their masks are; else all on bodies that move."""
    if bodies is None and geoms is None:
        moving = {name for name, carrier in t.frames if carrier >= 0}
        found = [shape for shape in shapes if shape.body in moving and shape.may_touch]
    else:
        there = tuple(dict.fromkeys(name for name, _ in t.frames if name != WORLD))
        bodies = _known(f"{operation}: bodies", bodies, there, t)
        geoms = _known(f"{operation}: geoms", geoms, tuple(shape.name for shape in shapes), t)
        found = [x for x in shapes if (x.body in bodies and x.may_touch) or x.name in geoms]
        _known(f"{operation}: geoms: their bodies", [shape.body for shape in found], there, t)
    if not found:
        came = f"none of {len(shapes)} shapes of the file" if shapes else "a file without collision shapes"
        wanted = "that move" if bodies is None and geoms is None else "of these names"
        raise ValueError(f"{operation}: expected collision shapes that may touch, on bodies {wanted}; got {came}")
    return found


def _known(what: str, names: Iterable[str] | None, there: tuple[str, ...], t: Topology) -> tuple[str, ...]:
    """The names, none for None; they have to be there."""
    found = (
        () if names is None else tuple(names) if isinstance(names, Iterable) and not isinstance(names, str) else None
    )
    if found is None:
        raise TypeError(f"{what}: expected a sequence of names, got {names!r}")
    for name in found:
        t.index(there, name, what)
    return found


def spheres(operation: str, shapes: list[CollisionShape], rim: int, corners: int, dtype: np.dtype[Any]):
    """(frames, positions (n, 3), radius (n,), friction (n,)) of the spheres of shapes, in their order."""
    rim, corners = check.as_count(rim, f"{operation}: rim", 3), check.as_count(corners, f"{operation}: corners", 1)
    frames, rows = list[str](), list[np.ndarray]()
    for shape in shapes:
        p_S = farthest(corners_of_hull(shape.vertices()), corners) if shape.vertices else _points(shape, rim)
        R, is_round = np.reshape(shape.pose.rotation.entries, (3, 3)), shape.kind in ("sphere", "capsule")
        own = np.tile([shape.size[0] if is_round else 0.0, shape.friction], (len(p_S), 1))
        frames += [shape.body] * len(p_S)
        rows.append(np.hstack([p_S @ R.T + shape.pose.translation, own]))
    numbers = np.concatenate(rows).astype(dtype)
    return frames, numbers[:, :3], numbers[:, 3], numbers[:, 4]


def _points(shape: CollisionShape, rim: int) -> np.ndarray:
    """(n, 3) the points of a shape that is no mesh, in its axes."""
    signs = np.array([-1.0, 1.0])
    match shape.kind, *shape.size:
        case "sphere", _:
            return np.zeros((1, 3))
        case "capsule", _, length:
            return np.outer(signs, [0, 0, length / 2])
        case "box", x, y, z:
            return np.stack(np.meshgrid(signs, signs, signs, indexing="ij"), -1).reshape(8, 3) * [x / 2, y / 2, z / 2]
        case "cylinder", radius, length:
            angles = 2 * np.pi * np.arange(rim) / rim
            circle = radius * np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1)
            return np.concatenate([circle + [0, 0, sign * length / 2] for sign in signs])
        case "ellipsoid", *semi_axes:
            return np.concatenate([sign * np.diag(semi_axes) for sign in signs])
    raise AssertionError(shape.kind)


# -- meshes -----------------------------------------------------------------------------------------------------------


def corners_of_hull(vertices: np.ndarray) -> np.ndarray:
    """(k, 3) the corners of the convex hull of points (n, 3), which may lie in a plane, on a line, or in one place."""
    from scipy.spatial import ConvexHull  # jax brings scipy

    points = np.unique(np.asarray(vertices, np.float64), axis=0)
    _, sizes, axes = np.linalg.svd(points - points.mean(0), full_matrices=False)
    dimensions = int((sizes > _FLAT * max(sizes[0], np.finfo(float).tiny)).sum())
    along = (points - points.mean(0)) @ axes[:dimensions].T
    if dimensions < 2:
        return points[sorted({int(along.argmin()), int(along.argmax())})] if dimensions else points[:1]
    return points[np.sort(ConvexHull(along / sizes[0]).vertices)]


def farthest(points: np.ndarray, n: int) -> np.ndarray:
    """At most n of the points (k, 3): the farthest from their mean, and then each the farthest from those taken."""
    distance, taken = np.linalg.norm(points - points.mean(0), axis=1), list[int]()
    near = _SAME * distance.max(initial=0.0)
    for _ in range(min(n, len(points))):
        k = int(distance.argmax())
        if taken and not distance[k] > near:
            break
        taken.append(k)
        from_new = np.linalg.norm(points - points[k], axis=1)
        distance = from_new if len(taken) == 1 else np.minimum(distance, from_new)
    return points[taken]


def path_of_mesh(name: str, folder: pathlib.Path) -> pathlib.Path | None:
    """The path of a mesh: what follows "package://" is looked for in all folders above the model."""
    parts = pathlib.PurePosixPath(name.partition("://")[2] or name).parts
    tails = [pathlib.Path(*parts[k:]) for k in range(len(parts))]
    places = (up / tail for tail in tails for up in (folder, *folder.resolve().parents))
    return next(filter(pathlib.Path.is_file, places), None)


def mesh_file(operation: str, name: str, folder: pathlib.Path, where: str) -> np.ndarray:
    """(n, 3) the vertices of a mesh in a file, in its units."""
    trimesh = needed(operation, "trimesh")
    if (path := path_of_mesh(name, folder)) is None:
        raise FileNotFoundError(f"{operation}: {where}: there is no file {name!r} at {folder} or above")
    if path.suffix.lower() == ".dae":
        needed(operation, "collada", "pycollada")  # by which trimesh reads them
    try:
        return np.asarray(trimesh.load(path, force="mesh", ignore_broken=True, skip_materials=True).vertices)
    except Exception as error:  # Whatever a reader of meshes says of a file.
        raise ValueError(f"{operation}: {where}: trimesh cannot read {str(path)!r}: {error}") from error
