"""Tendons of an MJCF: a fixed one is a linear form of coordinates, a spatial one is a rope from place to place."""

import functools

import numpy as np

from jaxspatial.mechanism.formats.mjcf.file import File
from jaxspatial.mechanism.tendons import Tendon

# What a tendon does: {name in files: the switches of MuJoCo that it needs}.
_OF_TENDONS = {
    "stiffness": ("SPRING", "PASSIVE"),
    "damping": ("DAMPER", "PASSIVE"),
    "limited": ("LIMIT", "CONSTRAINT"),
    "frictionloss": ("FRICTIONLOSS", "CONSTRAINT"),
    "armature": (),
    "stiffnesspoly": ("SPRING", "PASSIVE"),
    "dampingpoly": ("DAMPER", "PASSIVE"),
}


def check_tendons(file: File):
    """Fixed tendons have linear springs, damping and limits here; ropes from place to place do nothing."""
    for i in range(file.model.ntendon):
        if is_fixed(file, i):
            file.check_number("tendon", i, "coef", linear_form(file, i)[1])
        for name, flags in _OF_TENDONS.items():
            if not (file.has(*flags) and file.numbers(f"tendon_{name}")[i].any()):
                continue
            short = name.removesuffix("poly")
            if name in ("stiffness", "damping", "limited") and is_fixed(file, i):
                continue
            is_left_out = name == "frictionloss" or (not is_fixed(file, i) and name != "armature")
            if is_left_out and not file.strict:
                of = "a tendon" if name == "frictionloss" else "a tendon along a rope"
                file.miss(f"{'range' if short == 'limited' else short} of {of}", file.name("tendon", i))
                continue
            kinds = "one number: springs and damping are linear" if name != short else "none of a rope"
            expected = kinds if short in ("stiffness", "damping") else "none"
            short = "range" if short == "limited" else short
            file.refuse("tendon", i, f"{short}: expected {expected} here, tendons are linear forms; leave it out")


def fixed_tendons(file: File) -> list[Tendon]:
    """The fixed tendons that do something."""
    m, found = file.model, list[Tendon]()
    for i in filter(functools.partial(is_fixed, file), range(m.ntendon)):
        stiffness, damping, limited = (
            file.numbers(f"tendon_{name}")[i] * file.has(*_OF_TENDONS[name])
            for name in ("stiffness", "damping", "limited")
        )
        if stiffness.any() or damping.any() or limited.any():
            joints, c = linear_form(file, i)
            lower, upper = m.tendon_range[i].tolist() if limited.any() else (-np.inf, np.inf)
            numbers = {"stiffness": float(stiffness[0]), "damping": float(damping[0]), "rest": m.tendon_lengthspring[i]}
            names = [file.name("joint", j) for j in joints]
            found.append(Tendon(file.name("tendon", i), names, c, lower=lower, upper=upper, **numbers))
    return found


def is_fixed(file: File, i: int) -> bool:
    m = file.model
    return int(m.wrap_type[m.tendon_adr[i]]) == int(file.mujoco.mjtWrap.mjWRAP_JOINT)


def linear_form(file: File, i: int) -> tuple[list[int], np.ndarray]:
    """(joints, coefficients) of a fixed tendon. One that comes twice has the sum."""
    m = file.model
    places = range(m.tendon_adr[i], m.tendon_adr[i] + m.tendon_num[i])
    c = dict[int, float]()
    for k in places:
        c[int(m.wrap_objid[k])] = c.get(int(m.wrap_objid[k]), 0.0) + float(m.wrap_prm[k])
    return list(c), np.array([*c.values()])
