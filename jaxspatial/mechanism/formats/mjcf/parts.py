"""The parts of a mechanism in an MJCF: bodies, joints and frames; loops and tendons are those of the files beside."""

import collections
from typing import Any

import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.formats.mjcf.actuators import rotor_numbers
from jaxspatial.mechanism.formats.mjcf.equalities import loop_closures, solved, tendons_of_one_length
from jaxspatial.mechanism.formats.mjcf.file import File, pose_of
from jaxspatial.mechanism.formats.mjcf.tendons import fixed_tendons
from jaxspatial.mechanism.formats.source import rotation_of, with_moments
from jaxspatial.mechanism.parts import WORLD, Body, Frame, Joint, Mimic
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

# How the warning lists free joints of which slides and a ball are made.
_SPLIT = "free joint read as slides NAME/x, NAME/y, NAME/z and a ball NAME/ball"


def read_parts(file: File):
    """(bodies, joints, frames, loops, tendons)."""
    followers, equations = solved(file)
    mimics = {j: Mimic(file.name("joint", leader), a, b) for j, (leader, a, b) in followers.items()}
    moving, rotors = range(1, file.model.nbody), rotor_numbers(file)
    joints = [joint for i in moving for joint in _joints(file, i, rotors, mimics)]
    loops, anchors = loop_closures(file)
    bodies, frames = [_body(file, i) for i in moving], [*_frames(file), *anchors]
    between = {joint.child for joint in joints} - {body.name for body in bodies}
    bodies += map(Body, sorted(between))
    _check_names(file, [joint.name for joint in joints])
    _check_names(file, [part.name for part in (*bodies, *frames)])
    return bodies, joints, frames, loops, [*fixed_tendons(file), *tendons_of_one_length(file, equations)]


def _check_names(file: File, names: list[str]):
    """Checks that the names made for elements without one are not those of others."""
    for name, count in collections.Counter(names).items():
        if count > 1:
            named = [e for e in file.root.iter("body", "joint", "freejoint", "site") if e.get("name") == name]
            reason = f"name: {name!r} is made for another here, which has no such name in the file; name one otherwise"
            file.refuse_element([file.root, *named][-1], reason)


def _body(file: File, i: int):
    m, name = file.model, file.name("body", i)
    if not (m.body_mass[i] > 0 or m.body_inertia[i].any()):
        return Body(name)
    # MuJoCo computes as if frames that nearly coincide did.
    is_same = m.body_sameframe[i] == int(file.mujoco.mjtSameFrame.mjSAMEFRAME_BODY)
    X_BI = pose_of(np.zeros(3), np.array([1.0, 0, 0, 0])) if is_same else pose_of(m.body_ipos[i], m.body_iquat[i])
    lift = None
    if share := float(m.body_gravcomp[i]):
        lift = SpatialInertia(np.float64(share * m.body_mass[i]), X_BI.translation, np.zeros((3, 3)))
    return Body(name, with_moments(m.body_mass[i], X_BI, np.diag(m.body_inertia[i])), lift)


def _joints(file: File, i: int, rotors: dict[str, np.ndarray], mimics: dict[int, Mimic]):
    """The joints of a body, in series."""
    m, body, parent = file.model, file.name("body", i), file.name("body", file.model.body_parentid[i])
    X_PB = pose_of(m.body_pos[i], m.body_quat[i])
    numbers = range(m.body_jntadr[i], m.body_jntadr[i] + m.body_jntnum[i])
    if not numbers:
        yield Joint(f"{body}/fixed", "fixed", parent, body, X_PB)
    for j in numbers:
        name, kind = file.name("joint", j), file.kind(j)
        child = body if j == numbers[-1] else f"{body}/{name}"
        fields = _numbers(file, j, rotors)
        if kind == "free":
            yield from _free(file, name, body, fields)
            continue
        yield Joint(name, kind, parent, child, *_anchored(file, j, X_PB), mimic=mimics.get(j), **fields)
        parent, X_PB = child, None


def _free(file: File, name: str, body: str, fields: dict[str, Any]):
    """A free joint; or slides along the axes of the world and a ball, which have its coordinates in MuJoCo.

    Friction, damping and armature of its linear velocities are along the axes of the world in MuJoCo; in a "free" joint
    friction and damping are along those of the body. Where one number is that of all axes, damping is the same.
    """
    names = "armature", "damping", "friction_loss", "stiffness"
    numbers: dict[str, Any] = {x: np.broadcast_to(fields[x], (6,)) for x in names}
    has_axes = any(len(set(numbers[x][3:].tolist())) > 1 for x in ("armature", "damping"))
    if not (has_axes or numbers["friction_loss"].any()):
        yield Joint(name, "free", WORLD, body, **fields)
        return
    file.doubt(_SPLIT, name)
    parent, rest = WORLD, fields["spring_reference"]
    for k, letter in enumerate("xyz"):
        child, own = f"{body}/{name}/{letter}", {x: array[3 + k] for x, array in numbers.items()}
        axis = np.eye(3)[k]
        yield Joint(f"{name}/{letter}", "prismatic", parent, child, axis=axis, spring_reference=rest[4 + k], **own)
        parent = child
    own = {x: array[:3] for x, array in numbers.items()}
    yield Joint(f"{name}/ball", "ball", parent, body, spring_reference=rest[:4], **own)


def _numbers(file: File, j: int, rotors: dict[str, np.ndarray]):
    """The fields of a joint that are numbers, by name."""
    m, kind, dofs = file.model, file.kind(j), file.dofs(j)
    rest = np.array(m.qpos_spring[file.coordinates(j)])
    of_velocities = (x[dofs] for x in (m.dof_armature, m.dof_damping, m.dof_frictionloss))
    armature, damping, friction = (np.roll(x, 3 * (kind == "free")) for x in of_velocities)
    numbers: dict[str, Any] = {
        "armature": armature + rotors["armature"][j],
        "damping": (damping + rotors["damping"][j]) * file.has("DAMPER", "PASSIVE"),
        "friction_loss": friction * file.has("FRICTIONLOSS", "CONSTRAINT"),
        "stiffness": m.jnt_stiffness[j] * file.has("SPRING", "PASSIVE"),
        "spring_reference": np.roll(rest, 4) if kind == "free" else rest,  # the quaternion first
    }
    if kind in ("revolute", "prismatic"):
        numbers["axis"] = m.jnt_axis[j]
    if file.is_limited(j):
        lower, upper = m.jnt_range[j].tolist()
        numbers |= {"turn_limit": max(lower, upper)} if kind == "ball" else {"lower": lower, "upper": upper}
    if m.jnt_actfrclimited[j]:
        numbers["effort_limit"] = float(abs(m.jnt_actfrcrange[j]).max())
    return numbers


def _anchored(file: File, j: int, X_PB: RigidTransform | None):
    """(X_PJ, X_JB) of a joint at its anchor: at q = ref the body is at X_PB."""
    axis, anchor = file.model.jnt_axis[j], file.model.jnt_pos[j]
    back, unturned = -file.reference(j) * axis, np.eye(3)
    if file.kind(j) == "prismatic":
        return _after(X_PB, unturned, back), None
    turned = rotation_of(Rotation.exp(back).entries) if back.any() else unturned
    return _after(X_PB, turned, anchor), RigidTransform(Rotation(unturned.ravel()), -anchor)


def _after(X_AB: RigidTransform | None, matrix: np.ndarray, p: np.ndarray):
    X_BC = RigidTransform(Rotation(matrix.ravel()), np.array(p))
    return X_BC if X_AB is None else X_AB @ X_BC


def _frames(file: File):
    m = file.model
    for i in range(m.nsite):
        yield Frame(file.frame_of_site(i), file.name("body", m.site_bodyid[i]), pose_of(m.site_pos[i], m.site_quat[i]))
    taken = {file.name(what, i) for what, n in (("body", m.nbody), ("site", m.nsite)) for i in range(n)}
    for i in range(m.ncam):
        name, body = file.name("cam", i), file.name("body", m.cam_bodyid[i])
        if m.cam_mode[i] == int(file.mujoco.mjtCamLight.mjCAMLIGHT_FIXED):
            yield Frame(f"{body}/{name}" if name in taken else name, body, pose_of(m.cam_pos[i], m.cam_quat[i]))
        else:
            file.leave_out("camera that turns by itself", name)
