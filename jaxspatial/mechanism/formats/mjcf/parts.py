"""A model of MuJoCo as the parts of a mechanism."""

import collections
from typing import Any

import numpy as np

from jaxspatial.mechanism.formats.mjcf.file import ModelFile
from jaxspatial.mechanism.formats.numbers import rotation_of, with_moments
from jaxspatial.mechanism.parts import Body, Frame, Joint, Mimic
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

# The equation of a mimic, the joint that it follows, multiplier and offset.
Followed = tuple[int, int, float, float]

Mimics = dict[int, Mimic]  # by the number of the joint


def parts(file: ModelFile):
    """(bodies, joints, frames)."""
    rotors, mimics = _Rotors(file), _mimics(file)
    moving = range(1, file.model.nbody)
    joints = [joint for i in moving for joint in _held(file, i, rotors, mimics)]
    bodies = [_body(file, i) for i in moving]
    between = {joint.child for joint in joints} - {body.name for body in bodies}
    found = [*bodies, *map(Body, sorted(between))], joints, list(_frames(file))
    _check_names(file, [joint.name for joint in joints])
    _check_names(file, [part.name for part in (*found[0], *found[2])])
    return found


def _check_names(file: ModelFile, names: list[str]):
    """Those that are made for what has none may be those of others."""
    for name, count in collections.Counter(names).items():
        if count > 1:
            named = [e for e in file.root.iter("body", "joint", "freejoint", "site") if e.get("name") == name]
            reason = f"name: {name!r} is made for another here, which has none in the file; name one of them otherwise"
            file.refuse_element([file.root, *named][-1], reason)


class _Rotors:
    """Armature and damping of what drives each joint, at its side of the gears."""

    def __init__(self, file: ModelFile):
        m = file.model
        self.armature, self.damping = np.zeros(m.njnt), np.zeros(m.njnt)
        for i in range(len(m.actuator_trntype)):
            for name in ("armature", "damping", "dampingpoly"):
                self._add(file, i, name, file.numbers(f"actuator_{name}")[i])

    def _add(self, file: ModelFile, i: int, name: str, numbers: np.ndarray):
        if not numbers.any():
            return
        m, j = file.model, file.model.actuator_trnid[i, 0]
        is_simple = m.actuator_trntype[i] == file.on_joints and file.kind(j) in ("revolute", "prismatic")
        if not is_simple or name == "dampingpoly":
            file.refuse("actuator", i, f"{name.removesuffix('poly')}: expected one number, on a hinge or a slide")
        gear = m.actuator_gear[i, 0]
        with np.errstate(over="ignore"):
            geared = numbers[0] * gear**2
        if not geared <= file.largest:
            reason = f"{name}: expected at most {file.largest:.3g} times gear^2, got {numbers[0]:.3g} * {gear:.3g}^2"
            file.refuse("actuator", i, reason)
        getattr(self, name)[j] += geared


def _mimics(file: ModelFile):
    """What joints follow, by their numbers."""
    found: dict[int, Followed] = {}
    if file.has("EQUALITY", "CONSTRAINT"):
        for i in range(file.model.neq):
            if file.model.eq_active0[i]:
                _add_mimic(file, i, found)
    for j, (i, followed, _, _) in found.items():
        if followed in found:
            file.refuse("eq", i, f"{file.name('joint', j)!r} follows a joint that follows another itself")
    for j in found:
        if file.is_limited(j):
            file.notes.leave_out("range of a mimic", file.name("joint", j))
    return {j: Mimic(file.name("joint", followed), *numbers) for j, (_, followed, *numbers) in found.items()}


def _add_mimic(file: ModelFile, i: int, found: dict[int, Followed]):
    """q1 - ref1 = a0 + a1 (q2 - ref2)."""
    m = file.model
    j, followed = m.eq_obj1id[i], m.eq_obj2id[i]
    if file.equalities[m.eq_type[i]] != "mjEQ_JOINT":
        file.refuse("eq", i, "expected a tree of bodies, only joints can follow others")
    a0, a1, *higher = m.eq_data[i, :5]
    if any(higher):
        file.refuse(
            "eq", i, f"polycoef: expected a polynomial of at most first degree, got {m.eq_data[i, :5].tolist()}"
        )
    if followed < 0:
        file.refuse("eq", i, f"joint2: expected a joint to follow; leave out {file.name('joint', j)!r}, that is held")
    if j in found:
        file.refuse("eq", i, f"joint1: {file.name('joint', j)!r} follows another joint already")
    found[j] = i, followed, a1, a0 + _reference(file, j) - a1 * _reference(file, followed)


def _body(file: ModelFile, i: int):
    m = file.model
    X_BI = _pose(m.body_ipos[i], m.body_iquat[i])
    has_mass = m.body_mass[i] > 0 or m.body_inertia[i].any()
    return Body(
        file.name("body", i), with_moments(m.body_mass[i], X_BI, np.diag(m.body_inertia[i])) if has_mass else None
    )


def _held(file: ModelFile, i: int, rotors: _Rotors, mimics: Mimics):
    """The joints of a body, each after the one before."""
    m, body, parent = file.model, file.name("body", i), file.name("body", file.model.body_parentid[i])
    X_PB = _pose(m.body_pos[i], m.body_quat[i])
    own = list(range(m.body_jntadr[i], m.body_jntadr[i] + m.body_jntnum[i]))
    if not own:
        return [Joint(f"{body}/fixed", "fixed", parent, body, X_PB)]
    carried = [*(f"{body}/{file.name('joint', j)}" for j in own[:-1]), body]
    poses = [X_PB, *[None] * (len(own) - 1)]
    joints = zip(own, [parent, *carried], carried, poses, strict=False)
    return [_joint(file, *joint, rotors, mimics) for joint in joints]


def _joint(
    file: ModelFile, j: int, parent: str, child: str, X_PB: RigidTransform | None, rotors: _Rotors, mimics: Mimics
):
    kind, dofs = file.kind(j), file.dofs(j)
    numbers: dict[str, Any] = {
        "armature": file.model.dof_armature[dofs] + rotors.armature[j],
        "damping": (file.model.dof_damping[dofs] + rotors.damping[j]) * file.has("DAMPER", "PASSIVE"),
        "friction_loss": file.model.dof_frictionloss[dofs] * file.has("FRICTIONLOSS", "CONSTRAINT"),
        "stiffness": file.model.jnt_stiffness[j] * file.has("SPRING", "PASSIVE"),
        "spring_reference": _rest(file, j),
        "mimic": mimics.get(j),
        **_limits(file, j),
    }
    placed = (None, None) if kind == "free" else _anchored(file, j, X_PB)
    axis = {"axis": file.model.jnt_axis[j]} if kind in ("revolute", "prismatic") else {}
    return Joint(file.name("joint", j), kind, parent, child, *placed, **axis, **numbers)


def _anchored(file: ModelFile, j: int, X_PB: RigidTransform | None):
    """(X_PJ, X_JB) of a joint at its anchor: at q = ref the body is at X_PB."""
    axis, anchor = file.model.jnt_axis[j], file.model.jnt_pos[j]
    back, unturned = -_reference(file, j) * axis, np.eye(3)
    if file.kind(j) == "prismatic":
        return _after(X_PB, unturned, back), None
    turned = rotation_of(Rotation.exp(back).entries) if back.any() else unturned
    return _after(X_PB, turned, anchor), RigidTransform(Rotation(unturned.ravel()), -anchor)


def _after(X_AB: RigidTransform | None, matrix: np.ndarray, p: np.ndarray):
    X_BC = RigidTransform(Rotation(matrix.ravel()), np.array(p))
    return X_BC if X_AB is None else X_AB @ X_BC


def _reference(file: ModelFile, j: int):
    """MuJoCo's coordinate in the pose that the file describes."""
    is_number = file.kind(j) in ("revolute", "prismatic")
    return float(file.model.qpos0[file.model.jnt_qposadr[j]]) if is_number else 0.0


def _rest(file: ModelFile, j: int):
    """The coordinates at which the spring is; of a free joint the quaternion first."""
    x = file.model.qpos_spring[file.model.jnt_qposadr[j] :][: file.n_coordinates(j)]
    return np.roll(x, 4) if file.kind(j) == "free" else np.array(x)


def _limits(file: ModelFile, j: int):
    m, limits = file.model, dict[str, float]()
    if file.is_limited(j):
        limits |= {"lower": float(m.jnt_range[j, 0]), "upper": float(m.jnt_range[j, 1])}
    if m.jnt_actfrclimited[j]:
        # The larger of the two, where they differ.
        limits["effort_limit"] = float(abs(m.jnt_actfrcrange[j]).max())
    return limits


def _frames(file: ModelFile):
    m, taken = file.model, {file.name("body", i) for i in range(file.model.nbody)}
    for i in range(m.nsite):
        name, body = file.name("site", i), file.name("body", m.site_bodyid[i])
        yield Frame(f"{body}/{name}" if name in taken else name, body, _pose(m.site_pos[i], m.site_quat[i]))


def _pose(p: np.ndarray, wxyz: np.ndarray):
    entries = Rotation.from_quaternion(np.array(wxyz)).entries
    return RigidTransform(Rotation(rotation_of(entries).ravel()), np.array(p))
