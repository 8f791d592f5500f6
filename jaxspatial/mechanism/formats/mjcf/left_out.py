"""What a model of MuJoCo has besides the mechanism: noted, for the warning."""

import numpy as np

from jaxspatial.mechanism.formats.mjcf.file import ModelFile

# What is left out, by what the arrays of the model say of it.
_LEFT_OUT = {
    "geom": "ngeom", "cam": "ncam", "light": "nlight", "skin": "nskin", "mesh": "nmesh", "tex": "ntex", "mat": "nmat",
    "hfield": "nhfield", "pair": "npair", "exclude": "nexclude", "actuator": "nu", "sensor": "nsensor", "key": "nkey",
    "tendon": "ntendon", "numeric": "nnumeric", "tuple": "ntuple", "plugin": "nplugin",
}  # fmt: skip
_TAGS = {"cam": "camera", "tex": "texture", "mat": "material", "eq": "constraint", "key": "keyframe"}
# Options and switches that a mechanism has, or that are refused.
_OPTIONS = {"gravity", "density", "viscosity", "disableflags", "o_margin", "o_solref", "o_solimp", "o_friction"}
_SWITCHES = {"CONSTRAINT", "EQUALITY", "FRICTIONLOSS", "LIMIT", "SPRING", "DAMPER", "GRAVITY", "PASSIVE"}
# What makes limits and friction of joints soft in MuJoCo, with the values they have by default.
_SOFTNESS = {
    "margin": ("jnt_margin", "margin"),
    "solreflimit": ("jnt_solref", "solref_limit"),
    "solimplimit": ("jnt_solimp", "solimp_limit"),
    "solreffriction": ("dof_solref", "solref_friction"),
    "solimpfriction": ("dof_solimp", "solimp_friction"),
}


def leave_out(file: ModelFile):
    """What the model has besides, by name."""
    m = file.model
    for what, count in _LEFT_OUT.items():
        for i in range(getattr(m, count, 0)):
            file.notes.leave_out(_TAGS.get(what, what), getattr(m, what)(i).name or f"{what}_{i}")
    for i in range(m.neq):
        if not (m.eq_active0[i] and file.has("EQUALITY", "CONSTRAINT")):
            file.notes.leave_out("constraint that is not active", file.name("eq", i))
    for i in range(1, m.nbody):
        if m.body_mocapid[i] >= 0:
            file.notes.leave_out("mocap", file.name("body", i))
    _leave_out_options(file)
    _leave_out_of_joints(file)


def _leave_out_options(file: ModelFile):
    usual, options = file.mujoco.MjOption(), file.model.opt
    for name in dir(usual):
        if not name.startswith("_") and name not in _OPTIONS:
            if not np.array_equal(getattr(usual, name), getattr(options, name)):
                file.notes.leave_out("option", name)
    for name in sorted(file.disabled):
        if name.removeprefix("mjDSBL_") not in _SWITCHES:
            file.notes.leave_out("option", f"{name.removeprefix('mjDSBL_').lower()} switched off")


def _leave_out_of_joints(file: ModelFile):
    m, spec = file.model, file.mujoco.MjSpec()
    for j in range(m.njnt):
        for name, (array, usual) in _SOFTNESS.items():
            own = getattr(m, array)[j if array.startswith("jnt") else file.dofs(j)]
            if not np.array_equal(own, np.broadcast_to(getattr(spec.default.joint, usual), own.shape)):
                file.notes.leave_out(name, file.name("joint", j))
        if m.jnt_actfrclimited[j] and m.jnt_actfrcrange[j].sum() != 0:
            file.notes.leave_out("side of actuatorfrcrange that is nearer to 0", file.name("joint", j))
