"""What a mechanism cannot represent: what changes the motion is refused, and what does not is listed as left out."""

import numpy as np

from jaxspatial.mechanism.formats.mjcf.equalities import closure_kinds
from jaxspatial.mechanism.formats.mjcf.file import File
from jaxspatial.mechanism.formats.mjcf.tendons import check_tendons

# {element: {name in files: array of the model}}, of arrays that become numbers of the mechanism.
_NUMBERS = {
    "body": {"pos": "body_pos", "quat": "body_quat", "inertial pos": "body_ipos", "inertial quat": "body_iquat",
             "mass": "body_mass", "inertia": "body_inertia"},
    "joint": {"pos": "jnt_pos", "axis": "jnt_axis", "stiffness": "jnt_stiffness",
              "actuatorfrcrange": "jnt_actfrcrange"},
    "site": {"pos": "site_pos", "quat": "site_quat"},
    "cam": {"pos": "cam_pos", "quat": "cam_quat"},
    "tendon": {"stiffness": "tendon_stiffness", "damping": "tendon_damping", "springlength": "tendon_lengthspring"},
    "actuator": {"gear": "actuator_gear", "armature": "actuator_armature", "damping": "actuator_damping"},
}  # fmt: skip
_OF_COORDINATES = {"ref": "qpos0", "springref": "qpos_spring"}
# {element: how many the model has}
_LEFT_OUT = {
    "geom": "ngeom", "light": "nlight", "skin": "nskin", "mesh": "nmesh", "tex": "ntex", "mat": "nmat",
    "hfield": "nhfield", "pair": "npair", "exclude": "nexclude", "actuator": "nu", "sensor": "nsensor", "key": "nkey",
    "tendon": "ntendon", "numeric": "nnumeric", "tuple": "ntuple", "plugin": "nplugin",
}  # fmt: skip
_TAGS = {"tex": "texture", "mat": "material", "key": "keyframe"}
# Options and switches that a mechanism has, or that are refused.
_OPTIONS = {"gravity", "density", "viscosity", "disableflags", "o_margin", "o_solref", "o_solimp", "o_friction"}
_SWITCHES = {"CONSTRAINT", "EQUALITY", "FRICTIONLOSS", "LIMIT", "SPRING", "DAMPER", "GRAVITY", "PASSIVE"}
# What makes limits and friction of joints soft in MuJoCo: {name in files: (array of the model, default in a spec)}.
_SOFTNESS = {
    "margin": ("jnt_margin", "margin"),
    "solreflimit": ("jnt_solref", "solref_limit"),
    "solimplimit": ("jnt_solimp", "solimp_limit"),
    "solreffriction": ("dof_solref", "solref_friction"),
    "solimpfriction": ("dof_solimp", "solimp_friction"),
}


def check_representable(file: File):
    """Refuses what changes the motion and cannot be represented."""
    m = file.model
    for name in ("density", "viscosity"):
        if getattr(m.opt, name) != 0:
            if file.strict:
                file.refuse_strictly(file.option(name), f"{name}: there is no drag here, expected 0")
            file.miss("drag", f"{name} of the medium")
    if not (abs(file.gravity) <= file.largest).all():
        file.refuse_element(file.option("gravity"), f"gravity: {file.expected_finite}, got {file.gravity.tolist()}")
    if m.nflex:
        file.refuse_element([file.root, *file.root.iter("flex", "flexcomp")][-1], "bodies are rigid here; take it out")
    _check_numbers(file)
    for i in range(m.nbody):
        if m.body_plugin[i] >= 0:
            file.refuse("body", i, "plugin: what it does to the motion is not known; take it out")
    _check_joints(file)
    check_tendons(file)


def _check_numbers(file: File):
    """Checks the compiled numbers: finite, and not negative where no matter has such."""
    m = file.model
    for what, arrays in _NUMBERS.items():
        for name, array in arrays.items():
            for i, x in enumerate(file.numbers(array)[: len(getattr(m, array, ()))]):
                file.check_number(what, i, name, x)
    for i in range(m.neq):
        name = "anchor" if m.eq_type[i] in closure_kinds(file) else "polycoef"
        file.check_number("eq", i, name, m.eq_data[i])
    for j in range(m.njnt):
        for name in ("armature", "damping", "frictionloss"):
            file.check_number("joint", j, name, getattr(m, f"dof_{name}")[file.dofs(j)])
        for name, array in _OF_COORDINATES.items():
            file.check_number("joint", j, name, getattr(m, array)[file.coordinates(j)])
        if np.isnan(m.jnt_range[j]).any():
            file.refuse("joint", j, "range: expected numbers, got nan")
        if not np.isclose(np.linalg.norm(m.jnt_axis[j]), 1):
            file.refuse("joint", j, "axis: expected numbers that MuJoCo can make a unit vector of")


def _check_joints(file: File):
    m, has_springs = file.model, file.has("SPRING", "PASSIVE")
    for j in range(m.njnt):
        if has_springs and file.numbers("jnt_stiffnesspoly")[j].any():
            file.refuse("joint", j, "stiffness: expected one number, springs are linear here")
        if has_springs and file.numbers("jnt_springyield")[j].any():
            file.refuse("joint", j, "springyield: expected none, springs stay elastic here")
        if file.has("DAMPER", "PASSIVE") and file.numbers("dof_dampingpoly")[file.dofs(j)].any():
            file.refuse("joint", j, "damping: expected one number, forces are linear in the rate here")


def leave_out_the_rest(file: File):
    """Lists what is no part of a mechanism."""
    m = file.model
    for what, count in _LEFT_OUT.items():
        # An actuator may have several controls, which nu counts.
        for i in range(len(m.actuator_trntype) if what == "actuator" else getattr(m, count, 0)):
            file.leave_out(_TAGS.get(what, what), file.name(what, i))
    for i in range(m.neq):
        if not (m.eq_active0[i] and file.has("EQUALITY", "CONSTRAINT")):
            file.leave_out("constraint that is not active", file.name("eq", i))
    for i in range(1, m.nbody):
        if m.body_mocapid[i] >= 0:
            file.leave_out("mocap", file.name("body", i))
    usual = file.mujoco.MjOption()
    for name in dir(usual):
        if not name.startswith("_") and name not in _OPTIONS:
            if not np.array_equal(getattr(usual, name), getattr(m.opt, name)):
                file.leave_out("option", name)
    for name in sorted(file.disabled):
        if name.removeprefix("mjDSBL_") not in _SWITCHES:
            file.leave_out("option", f"{name.removeprefix('mjDSBL_').lower()} switched off")
    defaults = file.mujoco.MjSpec().default.joint
    for j in range(m.njnt):
        for name, (array, default) in _SOFTNESS.items():
            values = getattr(m, array)[j if array.startswith("jnt") else file.dofs(j)]
            if not np.array_equal(values, np.broadcast_to(getattr(defaults, default), values.shape)):
                file.leave_out(name, file.name("joint", j))
        if m.jnt_actfrclimited[j] and m.jnt_actfrcrange[j].sum() != 0:
            file.leave_out("side of actuatorfrcrange that is nearer to 0", file.name("joint", j))
