"""Actuators of an MJCF, and key frames, which have numbers for each of them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from jaxspatial.mechanism.formats.mjcf.file import File
from jaxspatial.mechanism.formats.mjcf.tendons import is_fixed, linear_form


class ActuatorPart(NamedTuple):
    """An actuator of a file. numbers: those of `Actuators`, by name."""

    name: str
    joints: list[str]
    gears: list[float]
    numbers: dict[str, float]


def read_actuators(path_or_text: Any, assets: Mapping[str, bytes] | None = None) -> list[ActuatorPart]:
    """The actuators of an MJCF for `Actuators.from_mjcf`, those that are plain; a warning lists the others."""
    file = File(path_or_text, assets, None, False)
    plain = _plain_actuators(file)
    found = [_actuator(file, i) for i in plain]
    for i in set(range(len(file.model.actuator_trntype))).difference(plain):
        file.miss(f"actuator with {_not_plain(file, i)}", file.name("actuator", i))
    _miss_limits_of_sums(file)
    file.warn()
    return found


class KeyFramePart(NamedTuple):
    """A key frame of a file, in MuJoCo's coordinates. ctrl: of the actuators of `read_actuators`."""

    name: str
    qpos: np.ndarray
    qvel: np.ndarray
    ctrl: np.ndarray


def read_key_frames(path_or_text: Any, assets: Mapping[str, bytes] | None = None) -> list[KeyFramePart]:
    """The key frames of an MJCF for `interop.mujoco.key_frames`."""
    file = File(path_or_text, assets, None, False)
    m, places = file.model, file.numbers("actuator_ctrladr")
    # Where the ctrl of each actuator is in those of the model.
    plain = [int(places[i, 0]) if places.shape[1] else i for i in _plain_actuators(file)]
    parts = (m.key_qpos, m.key_qvel, m.key_ctrl[:, plain])
    return [KeyFramePart(m.key(k).name or f"key_{k}", *(np.array(x[k]) for x in parts)) for k in range(m.nkey)]


def _plain_actuators(file: File) -> list[int]:
    return [i for i in range(len(file.model.actuator_trntype)) if not _not_plain(file, i)]


def _not_plain(file: File, i: int) -> str:
    """What of an actuator is not that of `Actuators`; "" for nothing."""
    m, mujoco = file.model, file.mujoco
    gain, bias = m.actuator_gainprm[i], m.actuator_biasprm[i]
    gains = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE
    biases = mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE
    if not file.has("ACTUATION") or (m.opt.disableactuator >> int(m.actuator_group[i])) & 1:
        return "a group that is switched off"
    if file.numbers("actuator_plugin")[i].tolist() not in ([], [-1]):
        return "a plugin"
    if m.actuator_dyntype[i] != int(mujoco.mjtDyn.mjDYN_NONE):
        return "activation"
    if file.numbers("actuator_delay")[i].any():
        return "a delay"
    if m.actuator_gaintype[i] not in map(int, gains) or m.actuator_biastype[i] not in map(int, biases):
        return "gains of its own kind"
    if m.actuator_gaintype[i] == int(gains[1]) and gain[1:3].any():
        return "gains that depend on the state"
    if not np.isfinite([*gain[:1], *bias[:3]]).all():
        return "gains that are not finite"
    return "" if _pulled(file, i) else "no hinge or slide, nor a tendon over such, to pull at"


def _pulled(file: File, i: int) -> tuple[list[int], np.ndarray] | None:
    """(joints, coefficients) of the length of an actuator, without its gear; None where it is no linear form."""
    m, kinds, target = file.model, file.mujoco.mjtTrn, int(file.model.actuator_trnid[i, 0])
    type = m.actuator_trntype[i]
    if type == int(kinds.mjTRN_TENDON) and is_fixed(file, target):
        return linear_form(file, target)
    is_joint = type in (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT))
    return ([target], np.ones(1)) if is_joint and file.kind(target) in ("revolute", "prismatic") else None


def _actuator(file: File, i: int) -> ActuatorPart:
    m, bias = file.model, file.model.actuator_biasprm[i]
    joints, c = _pulled(file, i) or ([], np.zeros(0))
    is_affine = m.actuator_biastype[i] == int(file.mujoco.mjtBias.mjBIAS_AFFINE)
    b, k, d = (bias[:3] * is_affine).tolist()
    numbers = {"gain": float(m.actuator_gainprm[i, 0]), "bias": b, "stiffness": -k, "damping": -d}
    limits = {
        ("lower", "upper"): (m.actuator_forcelimited[i], m.actuator_forcerange[i]),
        ("ctrl_lower", "ctrl_upper"): (m.actuator_ctrllimited[i] and file.has("CLAMPCTRL"), m.actuator_ctrlrange[i]),
    }
    for names, (is_limited, pair) in limits.items():
        numbers |= dict(zip(names, pair.tolist() if is_limited else (-np.inf, np.inf), strict=True))
    gears = (c * m.actuator_gear[i, 0]).tolist()
    return ActuatorPart(file.name("actuator", i), [file.name("joint", j) for j in joints], gears, numbers)


def _miss_limits_of_sums(file: File):
    """Lists limits of the forces of several actuators together that `effort_limit` does not have."""
    m = file.model
    for j in range(m.njnt):
        if m.jnt_actfrclimited[j] and m.jnt_actfrcrange[j].sum() != 0:
            file.miss("side of actuatorfrcrange that is nearer to 0", file.name("joint", j))
        if m.jnt_actgravcomp[j]:
            file.miss("actuatorgravcomp", file.name("joint", j))
    for i in range(m.ntendon):
        if file.numbers("tendon_actfrclimited")[i].any():
            file.miss("actuatorfrcrange of a tendon", file.name("tendon", i))


def rotor_numbers(file: File):
    """{"armature", "damping": those of the actuators of each joint, at its side of the gears}."""
    m = file.model
    totals = {"armature": np.zeros(m.njnt), "damping": np.zeros(m.njnt)}
    for i in range(len(m.actuator_trntype)):
        j, gear = m.actuator_trnid[i, 0], m.actuator_gear[i, 0]
        is_on_joint = m.actuator_trntype[i] == int(file.mujoco.mjtTrn.mjTRN_JOINT)
        for name in ("armature", "damping", "dampingpoly"):
            numbers = file.numbers(f"actuator_{name}")[i]
            if not numbers.any():
                continue
            if not (is_on_joint and file.kind(j) in ("revolute", "prismatic")) or name == "dampingpoly":
                file.refuse("actuator", i, f"{name.removesuffix('poly')}: expected one number, on a hinge or a slide")
            with np.errstate(over="ignore"):
                geared = numbers[0] * gear**2
            if not geared <= file.largest:
                expected = f"expected at most {file.largest:.3g} times gear^2"
                file.refuse("actuator", i, f"{name}: {expected}, got {numbers[0]:.3g} * {gear:.3g}^2")
            totals[name][j] += geared
    return totals
