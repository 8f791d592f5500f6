"""Geoms of an MJCF: the shapes that touch, and height fields."""

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxspatial.mechanism.formats.collision import CollisionShape
from jaxspatial.mechanism.formats.mjcf.file import File, pose_of
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.spatial import RigidTransform


def read_shapes(path_or_text: Any, assets: Mapping[str, bytes] | None = None) -> list[CollisionShape]:
    """The geoms of an MJCF for `PointContacts.from_mjcf`, but those that are welded to the world: these are ground.

    Two geoms touch where contype of one and conaffinity of the other share a bit, unless an <exclude> names their
    bodies, or where a <pair> names them. In a file with ground a geom may touch that touches some of it; in one
    without, every geom that could touch another.
    """
    file = File(path_or_text, assets, None, False)
    m = file.model
    ground = [i for i in range(m.ngeom) if _is_ground(file, i)]
    pairs = [{int(a), int(b)} for a, b in zip(m.pair_geom1, m.pair_geom2, strict=True)]
    # A height field that moves has no corners to touch with.
    has_corners = m.geom_type != int(file.mujoco.mjtGeom.mjGEOM_HFIELD)
    with in_double():
        own = [i for i in range(m.ngeom) if has_corners[i] and not _is_ground(file, i)]
        return [_shape(file, i, _may_touch(m, i, ground, pairs)) for i in own]


def read_height_field(
    path_or_text: Any, geom: str | None, assets: Mapping[str, bytes] | None = None
) -> tuple[np.ndarray, np.ndarray, RigidTransform]:
    """(heights (n_x, n_y), size (2,), X_WS) of a geom of an MJCF, for `HeightField.from_mjcf`."""
    file = File(path_or_text, assets, None, False)
    m, mujoco = file.model, file.mujoco
    is_field = m.geom_type == int(mujoco.mjtGeom.mjGEOM_HFIELD)
    fields = {file.name("geom", i): i for i in range(m.ngeom) if is_field[i] and _is_ground(file, i)}
    if geom is None and len(fields) == 1:
        (geom,) = fields
    if geom not in fields:
        wanted = "the name of one" if geom is None else repr(geom)
        raise ValueError(
            f"HeightField.from_mjcf: geom: expected {wanted}, a height field that does not move; the file has "
            f"{', '.join(fields) or 'none'}"
        )
    i, data = fields[geom], mujoco.MjData(m)
    mujoco.mj_kinematics(m, data)
    k = int(m.geom_dataid[i])
    start, shape = int(m.hfield_adr[k]), (int(m.hfield_nrow[k]), int(m.hfield_ncol[k]))
    levels = np.array(m.hfield_data[start : start + shape[0] * shape[1]], np.float64).reshape(shape)
    half_x, half_y, top, _ = m.hfield_size[k].tolist()
    wxyz = np.empty(4)
    mujoco.mju_mat2Quat(wxyz, data.geom_xmat[i])
    with in_double():
        return top * levels.T, np.array([2 * half_x, 2 * half_y]), pose_of(data.geom_xpos[i], wxyz)


def _is_ground(file: File, i: int) -> bool:
    return not file.model.body_weldid[file.model.geom_bodyid[i]]


def _shape(file: File, i: int, may_touch: bool) -> CollisionShape:
    m, type = file.model, file.mujoco.mjtGeom(int(file.model.geom_type[i]))
    a, b, c = m.geom_size[i].tolist()
    kinds = {
        "mjGEOM_SPHERE": ("sphere", a),
        "mjGEOM_CAPSULE": ("capsule", a, 2 * b),
        "mjGEOM_BOX": ("box", 2 * a, 2 * b, 2 * c),
        "mjGEOM_CYLINDER": ("cylinder", a, 2 * b),
        "mjGEOM_ELLIPSOID": ("ellipsoid", a, b, c),
        "mjGEOM_MESH": ("mesh",),
        "mjGEOM_SDF": ("mesh",),
    }
    kind, *size = kinds[type.name]
    pose, body = pose_of(m.geom_pos[i], m.geom_quat[i]), file.name("body", m.geom_bodyid[i])
    vertices = functools.partial(_vertices, file, int(m.geom_dataid[i])) if kind == "mesh" else None
    friction = float(m.geom_friction[i, 0])
    return CollisionShape(file.name("geom", i), body, pose, kind, tuple(size), vertices, friction, may_touch)


def _vertices(file: File, mesh: int) -> np.ndarray:
    start, n = file.model.mesh_vertadr[mesh], file.model.mesh_vertnum[mesh]
    return np.array(file.model.mesh_vert[start : start + n], np.float64)


def _may_touch(m: Any, i: int, ground: list[int], pairs: list[set[int]]) -> bool:
    if not ground:
        return bool(m.geom_contype[i] | m.geom_conaffinity[i]) or any(i in pair for pair in pairs)
    for k in ground:
        share_bits = (m.geom_contype[i] & m.geom_conaffinity[k]) | (m.geom_contype[k] & m.geom_conaffinity[i])
        a, b = sorted((int(m.geom_bodyid[i]), int(m.geom_bodyid[k])))
        are_excluded = (a << 16) + b in m.exclude_signature
        if {i, k} in pairs or (share_bits and not are_excluded):
            return True
    return False
