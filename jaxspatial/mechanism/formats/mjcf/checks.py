"""What of a model of MuJoCo changes the motion and has no counterpart here: refused."""

import numpy as np

from jaxspatial.mechanism.formats.mjcf.file import ModelFile

# Arrays of the model that become numbers of the mechanism, by what has them, with the names they have in files.
_NUMBERS = {
    "body": {"pos": "body_pos", "quat": "body_quat", "inertial pos": "body_ipos", "inertial quat": "body_iquat",
             "mass": "body_mass", "inertia": "body_inertia"},
    "joint": {"pos": "jnt_pos", "axis": "jnt_axis", "stiffness": "jnt_stiffness",
              "actuatorfrcrange": "jnt_actfrcrange"},
    "site": {"pos": "site_pos", "quat": "site_quat"},
    "actuator": {"gear": "actuator_gear", "armature": "actuator_armature", "damping": "actuator_damping"},
    "eq": {"polycoef": "eq_data"},
}  # fmt: skip
_OF_RATES = {"armature": "dof_armature", "damping": "dof_damping", "frictionloss": "dof_frictionloss"}
_OF_COORDINATES = {"ref": "qpos0", "springref": "qpos_spring"}
_NOT_NEGATIVE = {"mass", "stiffness", "armature", "damping", "frictionloss"}


def check(file: ModelFile):
    """Raises ValueError with element and reason."""
    _check_medium(file)
    _check_numbers(file)
    _check_bodies(file)
    _check_joints(file)
    _check_tendons(file)


def _check_medium(file: ModelFile):
    for name in ("density", "viscosity"):
        if getattr(file.model.opt, name) != 0:
            file.refuse_element(file.option(name), f"{name}: there is no drag here, expected 0")
    if not (abs(file.gravity) <= file.largest).all():
        found = file.gravity.tolist()
        file.refuse_element(file.option("gravity"), f"gravity: {_finite(file)}, got {found}")
    if file.model.nflex:
        file.refuse_element([file.root, *file.root.iter("flex", "flexcomp")][-1], "bodies are rigid here")


def _check_numbers(file: ModelFile):
    """Finite, and not negative where it would be no property of matter, in what the model was compiled to."""
    for what, arrays in _NUMBERS.items():
        for name, array in arrays.items():
            for i, x in enumerate(file.numbers(array)[: len(getattr(file.model, array, ()))]):
                _check_number(file, what, i, name, x)
    for j in range(file.model.njnt):
        q = file.model.jnt_qposadr[j]
        for name, array in _OF_RATES.items():
            _check_number(file, "joint", j, name, getattr(file.model, array)[file.dofs(j)])
        for name, array in _OF_COORDINATES.items():
            _check_number(file, "joint", j, name, getattr(file.model, array)[q : q + file.n_coordinates(j)])
        if np.isnan(file.model.jnt_range[j]).any():
            file.refuse("joint", j, "range: expected numbers, got nan")
        if not np.isclose(np.linalg.norm(file.model.jnt_axis[j]), 1):
            file.refuse("joint", j, "axis: expected numbers that MuJoCo can make a unit vector of")


def _check_number(file: ModelFile, what: str, i: int, name: str, x: np.ndarray):
    if not (abs(x) <= file.largest).all():
        file.refuse(what, i, f"{name}: {_finite(file)}, got {x.tolist()}")
    if name in _NOT_NEGATIVE and (x < 0).any():
        file.refuse(what, i, f"{name}: expected a number >= 0, got {x.tolist()}")
    if name == "mass" and 0 < x < file.smallest:
        file.refuse(what, i, f"mass: expected at least {file.smallest:.3g}, got {x.tolist()}")


def _finite(file: ModelFile):
    return f"expected finite numbers of at most {file.largest:.3g}"


def _check_bodies(file: ModelFile):
    for i in range(file.model.nbody):
        if file.model.body_gravcomp[i] != 0 and file.gravity.any():
            file.refuse("body", i, "gravcomp: gravity pulls on every body here")
        if file.model.body_plugin[i] >= 0:
            file.refuse("body", i, "plugin: what it does to the motion is not known")


def _check_joints(file: ModelFile):
    m = file.model
    for j in range(m.njnt):
        dofs = file.dofs(j)
        if file.has("SPRING", "PASSIVE") and file.numbers("jnt_stiffnesspoly")[j].any():
            file.refuse("joint", j, "stiffness: expected one number, springs are linear here")
        if file.has("SPRING", "PASSIVE") and file.numbers("jnt_springyield")[j].any():
            file.refuse("joint", j, "springyield: springs stay elastic here")
        if file.has("DAMPER", "PASSIVE") and file.numbers("dof_dampingpoly")[dofs].any():
            file.refuse("joint", j, "damping: expected one number, forces are linear in the rate here")
        if file.kind(j) == "ball" and file.is_limited(j):
            file.refuse("joint", j, "range: a ball joint has no limits here")
        if file.kind(j) == "free" and m.dof_armature[dofs].any():
            file.refuse("joint", j, "armature: a free joint turns nothing; add mass and inertia to its body")
        if file.kind(j) == "free" and m.dof_frictionloss[dofs].any():
            file.refuse("joint", j, "frictionloss: that of a free joint is in the world's axes")


def _check_tendons(file: ModelFile):
    m = file.model
    forces = {"stiffness": ("SPRING", "PASSIVE"), "damping": ("DAMPER", "PASSIVE")}
    forces |= {"stiffnesspoly": forces["stiffness"], "dampingpoly": forces["damping"]}
    forces |= {"frictionloss": ("FRICTIONLOSS", "CONSTRAINT"), "limited": ("LIMIT", "CONSTRAINT"), "armature": ()}
    for i in range(m.ntendon):
        for name, flags in forces.items():
            if file.has(*flags) and file.numbers(f"tendon_{name}")[i].any():
                file.refuse("tendon", i, f"{name.removesuffix('poly')}: there are no tendons here")
