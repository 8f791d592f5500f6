"""Mechanisms from MuJoCo's format (mujoco.readthedocs.io, XML reference), and states to and from MuJoCo's.

The package mujoco compiles the files. Bodies, joints and sites become bodies, joints and frames of the same name,
"body_<id>", "joint_<id>" and "site_<id>" where they have none; a site with the name of a body is "<body>/<site>". Of
several joints on one body, each but the last carries a body without mass, "<body>/<joint>". A joint constraint of at
most first degree makes a mimic, as if it were rigid. Springs, damping and friction of joints are numbers of the
mechanism, see `passive_forces`. What serves pictures, contact or control (geoms but for their mass, cameras, sensors,
keyframes, actuators but for armature and damping, options of MuJoCo's solver, that bodies are of mocap) is no part of a
mechanism: one `ModelFileWarning` lists it. Everything else that changes the motion and has no counterpart is refused,
with its line where it is in the text itself; so are numbers that are not finite or that the dtype does not have.

Coordinates of hinges, slides and balls are MuJoCo's: zero is where `ref` is zero. A free joint has its quaternion
first, and its linear velocity in the body's axes; a mimic has no coordinate. The functions below convert.
"""

import functools
import itertools
from typing import NoReturn

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.known import in_double
from jaxspatial.interop.files import Notes, built, file_source, needed, parsed, range_of, rotation_of, with_moments
from jaxspatial.mechanism import Body, Frame, Joint, Mechanism
from jaxspatial.mechanism.mechanism import READERS
from jaxspatial.mechanism.parts import WORLD, Mimic
from jaxspatial.rotation import Rotation
from jaxspatial.rotation.rotation import rotated
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialVelocity
from jaxspatial.spatial.vector import joined

_KINDS = "free", "ball", "prismatic", "revolute"
# Where in the text the elements of each kind are, and their tags there; None for all.
_SECTIONS = {
    "body": ("worldbody", ("body",)),
    "joint": ("worldbody", ("joint", "freejoint")),
    "site": ("worldbody", ("site",)),
    "eq": ("equality", None),
    "tendon": ("tendon", None),
    "actuator": ("actuator", None),
}
# Arrays with one item for each.
_COUNTS = {"joint": "njnt", "site": "nsite"}
_COUNTED = {"eq": "eq_type", "tendon": "tendon_num", "actuator": "actuator_trntype"}
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
# Attributes whose words are numbers, in which MuJoCo takes "nan" and "inf".
_ARE_NUMBERS = {
    "pos", "quat", "axis", "euler", "axisangle", "xyaxes", "zaxis", "fromto", "size", "mass", "density", "diaginertia",
    "fullinertia", "gravity", "armature", "damping", "frictionloss", "stiffness", "ref", "springref", "springdamper",
    "gear", "polycoef",
}  # fmt: skip
_NOT_FINITE = {"nan", "inf", "infinity"}
# Of these, infinite ones say that there is no limit.
_RANGES = {"range", "actuatorfrcrange"}


def read(path_or_text, dtype=None):
    """The Mechanism of a file, or of its text, with its gravity.

    Warns with `ModelFileWarning` of what was left out. Raises ValueError, with element and reason, for what MuJoCo does
    not compile and for what cannot be represented; ImportError without mujoco (`pip install jaxspatial[models]`);
    FileNotFoundError.
    """
    file = _File(path_or_text, dtype)
    _check_medium(file)
    _check_numbers(file)
    _check_bodies(file)
    _check_joints(file)
    _check_tendons(file)
    _leave_out(file)
    with in_double():
        parts = _parts(file)
    mechanism = built(functools.partial(file.refuse_named, "body"), *parts, file.gravity, dtype)
    file.notes.tell()
    return mechanism


READERS["mjcf"] = read


class _File:
    """The compiled model, and where in the text its elements are."""

    def __init__(self, path_or_text, dtype):
        mujoco = self.mujoco = needed("from_mjcf", "mujoco")
        source, path = file_source("from_mjcf", path_or_text)
        self.root, self.notes = parsed("from_mjcf", source, path is None), Notes("from_mjcf")
        self.smallest, self.largest = range_of(dtype)
        self._check_finite()
        try:
            # By its path, so that MuJoCo finds what the file includes.
            by_text = mujoco.MjModel.from_xml_string
            self.model = by_text(source.decode()) if path is None else mujoco.MjModel.from_xml_path(str(path))
        except ValueError as error:
            raise ValueError(f"from_mjcf: MuJoCo says {' '.join(str(error).split())}") from None
        bits = mujoco.mjtDisableBit.__members__
        self.disabled = {
            name for name, bit in bits.items() if "DSBL" in name and self.model.opt.disableflags & int(bit)
        }
        self.equalities = {int(value): name for name, value in mujoco.mjtEq.__members__.items()}
        self.on_joints = int(mujoco.mjtTrn.mjTRN_JOINT)

    def _check_finite(self):
        """Of the text itself, with its lines; MuJoCo would write into a log."""
        for element in self.root.iter("*"):
            for name, text in element.items():
                words = {word.lstrip("+-") for word in text.lower().split()}
                if ("nan" in words and name in _RANGES) or (words & _NOT_FINITE and name in _ARE_NUMBERS):
                    self.refuse_element(element, f"{name}: expected finite numbers, got {text!r}")

    def refuse_element(self, element, reason) -> NoReturn:
        raise ValueError(f"from_mjcf: line {element.sourceline}: <{element.tag}>: {reason}")

    def has(self, *flags):
        """Whether none of these is switched off: "SPRING", ..."""
        return not any(f"mjDSBL_{flag}" in self.disabled for flag in flags)

    @property
    def gravity(self):
        return np.array(self.model.opt.gravity) if self.has("GRAVITY") else np.zeros(3)

    def name(self, what, i):
        if (what, i) == ("body", 0):
            return WORLD
        return getattr(self.model, what)(i).name or f"{what}_{i}"

    def kind(self, j):
        return _KINDS[self.model.jnt_type[j]]

    def numbers(self, name):
        """An array of the model as (n, k); one of zeros, (n, 0), where this version of MuJoCo does not have it."""
        array = getattr(self.model, name, None)
        return np.zeros((1 << 16, 0)) if array is None else np.asarray(array).reshape((len(array), array[:1].size or 1))

    def refuse(self, what, i, reason) -> NoReturn:
        element = self._element(what, i)
        line = "" if element is None else f"line {element.sourceline}: "
        tag = what if element is None else element.tag
        raise ValueError(f'from_mjcf: {line}<{tag} name="{self.name(what, i)}">: {reason}')

    def refuse_named(self, what, name, reason) -> NoReturn:
        """By its name; a body of ours between the joints of one of theirs is not among them."""
        names = [self.name(what, i) for i in range(getattr(self.model, f"n{what}"))]
        self.refuse(what, names.index(name) if name in names else names.index(name.rpartition("/")[0]), reason)

    def _element(self, what, i):
        """By its name, or by its place where the text has all elements that the model has; None for all others."""
        section, tags = _SECTIONS[what]
        found = [e for part in self.root.findall(section) for e in part.iter(*(tags or ())) if isinstance(e.tag, str)]
        named = [e for e in found if e.get("name") and e.get("name") == getattr(self.model, what)(i).name]
        listed, n = self._listed(what)
        return named[0] if named else listed[i] if len(listed) == n else None

    def _listed(self, what):
        """(elements in the order of the model, how many it has)."""
        section, _ = _SECTIONS[what]
        bodies = [e for part in self.root.findall("worldbody") for e in (part, *part.iter("body"))]
        if what == "body":
            return bodies, self.model.nbody
        if section == "worldbody":
            tags = _SECTIONS[what][1]
            return [e for body in bodies for e in body.iterchildren(*tags)], getattr(self.model, _COUNTS[what])
        listed = [e for part in self.root.findall(section) for e in part.iterchildren("*")]
        return listed, len(getattr(self.model, _COUNTED[what]))


# -- what there is no counterpart of ----------------------------------------------------------------------------------


def _check_medium(file):
    for name in ("density", "viscosity"):
        if getattr(file.model.opt, name) != 0:
            found = [e for e in file.root.findall("option") if e.get(name)]
            line = f"line {found[0].sourceline}: " if found else ""
            raise ValueError(f"from_mjcf: {line}<option>: {name}: there is no drag here, expected 0")
    if not (abs(file.gravity) <= file.largest).all():
        options = file.root.findall("option")
        line = f"line {options[0].sourceline}: " if options else ""
        raise ValueError(f"from_mjcf: {line}<option>: gravity: expected finite numbers, got {file.gravity.tolist()}")
    if file.model.nflex:
        raise ValueError("from_mjcf: <flex>: bodies are rigid here")


def _check_numbers(file):
    """Finite, and not negative where it would be no property of matter, in what the model was compiled to."""
    for what, arrays in _NUMBERS.items():
        for name, array in arrays.items():
            for i, x in enumerate(file.numbers(array)[: len(getattr(file.model, array, ()))]):
                _check_number(file, what, i, name, x)
    for j in range(file.model.njnt):
        q = file.model.jnt_qposadr[j]
        for name, array in _OF_RATES.items():
            _check_number(file, "joint", j, name, getattr(file.model, array)[_dofs(file, j)])
        for name, array in _OF_COORDINATES.items():
            _check_number(file, "joint", j, name, getattr(file.model, array)[q : q + _coordinates(file, j)])
        if np.isnan(file.model.jnt_range[j]).any():
            file.refuse("joint", j, "range: expected numbers, got nan")
        if not np.isclose(np.linalg.norm(file.model.jnt_axis[j]), 1):
            file.refuse("joint", j, "axis: expected numbers that MuJoCo can make a unit vector of")


def _check_number(file, what, i, name, x):
    if not (abs(x) <= file.largest).all():
        file.refuse(what, i, f"{name}: expected finite numbers of at most {file.largest:.3g}, got {x.tolist()}")
    if name in _NOT_NEGATIVE and (x < 0).any():
        file.refuse(what, i, f"{name}: expected a number >= 0, got {x.tolist()}")
    if name == "mass" and 0 < x < file.smallest:
        file.refuse(what, i, f"mass: expected at least {file.smallest:.3g}, got {x.tolist()}")


def _check_bodies(file):
    for i in range(file.model.nbody):
        if file.model.body_gravcomp[i] != 0 and file.gravity.any():
            file.refuse("body", i, "gravcomp: gravity pulls on every body here")
        if file.model.body_plugin[i] >= 0:
            file.refuse("body", i, "plugin: what it does to the motion is not known")


def _check_joints(file):
    m = file.model
    for j in range(m.njnt):
        dofs = _dofs(file, j)
        if file.has("SPRING", "PASSIVE") and file.numbers("jnt_stiffnesspoly")[j].any():
            file.refuse("joint", j, "stiffness: expected one number, springs are linear here")
        if file.has("SPRING", "PASSIVE") and file.numbers("jnt_springyield")[j].any():
            file.refuse("joint", j, "springyield: springs stay elastic here")
        if file.has("DAMPER", "PASSIVE") and file.numbers("dof_dampingpoly")[dofs].any():
            file.refuse("joint", j, "damping: expected one number, forces are linear in the rate here")
        if file.kind(j) == "ball" and _is_limited(file, j):
            file.refuse("joint", j, "range: a ball joint has no limits here")
        if file.kind(j) == "free" and m.dof_armature[dofs].any():
            file.refuse("joint", j, "armature: a free joint turns nothing; add mass and inertia to its body")
        if file.kind(j) == "free" and m.dof_frictionloss[dofs].any():
            file.refuse("joint", j, "frictionloss: that of a free joint is in the world's axes")


def _check_tendons(file):
    m = file.model
    forces = {"stiffness": ("SPRING", "PASSIVE"), "damping": ("DAMPER", "PASSIVE")}
    forces |= {"stiffnesspoly": forces["stiffness"], "dampingpoly": forces["damping"]}
    forces |= {"frictionloss": ("FRICTIONLOSS", "CONSTRAINT"), "limited": ("LIMIT", "CONSTRAINT"), "armature": ()}
    for i in range(m.ntendon):
        for name, flags in forces.items():
            if file.has(*flags) and file.numbers(f"tendon_{name}")[i].any():
                file.refuse("tendon", i, f"{name.removesuffix('poly')}: there are no tendons here")


def _leave_out(file):
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


def _leave_out_options(file):
    usual, options = file.mujoco.MjOption(), file.model.opt
    for name in dir(usual):
        if not name.startswith("_") and name not in _OPTIONS:
            if not np.array_equal(getattr(usual, name), getattr(options, name)):
                file.notes.leave_out("option", name)
    for name in sorted(file.disabled):
        if name.removeprefix("mjDSBL_") not in _SWITCHES:
            file.notes.leave_out("option", f"{name.removeprefix('mjDSBL_').lower()} switched off")


def _leave_out_of_joints(file):
    m, spec = file.model, file.mujoco.MjSpec()
    for j in range(m.njnt):
        for name, (array, usual) in _SOFTNESS.items():
            own = getattr(m, array)[j if array.startswith("jnt") else _dofs(file, j)]
            if not np.array_equal(own, np.broadcast_to(getattr(spec.default.joint, usual), own.shape)):
                file.notes.leave_out(name, file.name("joint", j))
        if m.jnt_actfrclimited[j] and m.jnt_actfrcrange[j].sum() != 0:
            file.notes.leave_out("side of actuatorfrcrange that is nearer to 0", file.name("joint", j))


class _Rotors:
    """Armature and damping of what drives each joint, at its side of the gears."""

    def __init__(self, file):
        m = file.model
        self.armature, self.damping = np.zeros(m.njnt), np.zeros(m.njnt)
        for i in range(len(m.actuator_trntype)):
            for name in ("armature", "damping", "dampingpoly"):
                self._add(file, i, name, file.numbers(f"actuator_{name}")[i])

    def _add(self, file, i, name, numbers):
        if not numbers.any():
            return
        m, j = file.model, file.model.actuator_trnid[i, 0]
        is_simple = m.actuator_trntype[i] == file.on_joints and file.kind(j) in ("revolute", "prismatic")
        if not is_simple or name == "dampingpoly":
            file.refuse("actuator", i, f"{name.removesuffix('poly')}: expected one number, on a hinge or a slide")
        getattr(self, name)[j] += numbers[0] * m.actuator_gear[i, 0] ** 2


def _mimics(file):
    """What joints follow, by their numbers."""
    found = {}
    if file.has("EQUALITY", "CONSTRAINT"):
        for i in range(file.model.neq):
            if file.model.eq_active0[i]:
                _add_mimic(file, i, found)
    for j, (i, master, _, _) in found.items():
        if master in found:
            file.refuse("eq", i, f"{file.name('joint', j)!r} follows a joint that follows another itself")
    for j in found:
        if _is_limited(file, j):
            file.notes.leave_out("range of a mimic", file.name("joint", j))
    return {j: Mimic(file.name("joint", master), *numbers) for j, (_, master, *numbers) in found.items()}


def _add_mimic(file, i, found):
    """q1 - ref1 = a0 + a1 (q2 - ref2)."""
    m = file.model
    j, master = m.eq_obj1id[i], m.eq_obj2id[i]
    if file.equalities[m.eq_type[i]] != "mjEQ_JOINT":
        file.refuse("eq", i, "expected a tree of bodies, only joints can follow others")
    a0, a1, *higher = m.eq_data[i, :5]
    if any(higher):
        file.refuse(
            "eq", i, f"polycoef: expected a polynomial of at most first degree, got {m.eq_data[i, :5].tolist()}"
        )
    if master < 0:
        file.refuse("eq", i, f"joint2: expected a joint to follow; leave out {file.name('joint', j)!r}, that is held")
    if j in found:
        file.refuse("eq", i, f"joint1: {file.name('joint', j)!r} follows another joint already")
    found[j] = i, master, a1, a0 + _reference(file, j) - a1 * _reference(file, master)


# -- parts ------------------------------------------------------------------------------------------------------------


def _parts(file):
    """(bodies, joints, frames)."""
    rotors, mimics = _Rotors(file), _mimics(file)
    moving = range(1, file.model.nbody)
    joints = [joint for i in moving for joint in _held(file, i, rotors, mimics)]
    bodies = [_body(file, i) for i in moving]
    between = {joint.child for joint in joints} - {body.name for body in bodies}
    return [*bodies, *map(Body, sorted(between))], joints, list(_frames(file))


def _body(file, i):
    m = file.model
    X_BI = _pose(m.body_ipos[i], m.body_iquat[i])
    has_mass = m.body_mass[i] > 0 or m.body_inertia[i].any()
    return Body(
        file.name("body", i), with_moments(m.body_mass[i], X_BI, np.diag(m.body_inertia[i])) if has_mass else None
    )


def _held(file, i, rotors, mimics):
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


def _joint(file, j, parent, child, X_PB, rotors, mimics):
    kind, dofs = file.kind(j), _dofs(file, j)
    numbers = {
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


def _anchored(file, j, X_PB):
    """(X_PJ, X_JB) of a joint at its anchor: at q = ref the body is at X_PB."""
    axis, anchor = file.model.jnt_axis[j], file.model.jnt_pos[j]
    back, unturned = -_reference(file, j) * axis, np.eye(3)
    if file.kind(j) == "prismatic":
        return _after(X_PB, unturned, back), None
    turned = rotation_of(Rotation.exp(back).entries) if back.any() else unturned
    return _after(X_PB, turned, anchor), RigidTransform(Rotation(unturned.ravel()), -anchor)


def _after(X_AB, matrix, p):
    X_BC = RigidTransform(Rotation(matrix.ravel()), np.array(p))
    return X_BC if X_AB is None else X_AB @ X_BC


def _reference(file, j):
    """MuJoCo's coordinate in the pose that the file describes."""
    is_number = file.kind(j) in ("revolute", "prismatic")
    return float(file.model.qpos0[file.model.jnt_qposadr[j]]) if is_number else 0.0


def _rest(file, j):
    """The coordinates at which the spring is; of a free joint the quaternion first."""
    x = file.model.qpos_spring[file.model.jnt_qposadr[j] :][: _coordinates(file, j)]
    return np.roll(x, 4) if file.kind(j) == "free" else np.array(x)


def _limits(file, j):
    m, limits = file.model, {}
    if _is_limited(file, j):
        limits |= {"lower": float(m.jnt_range[j, 0]), "upper": float(m.jnt_range[j, 1])}
    if m.jnt_actfrclimited[j]:
        # The larger of the two, where they differ.
        limits["effort_limit"] = float(abs(m.jnt_actfrcrange[j]).max())
    return limits


def _is_limited(file, j):
    return bool(file.model.jnt_limited[j]) and file.has("LIMIT", "CONSTRAINT")


def _dofs(file, j):
    """Where the rates of a joint are; of a free joint all are alike."""
    start = file.model.jnt_dofadr[j]
    return slice(start, start + {"free": 6, "ball": 3}.get(file.kind(j), 1))


def _coordinates(file, j):
    return {"free": 7, "ball": 4}.get(file.kind(j), 1)


def _frames(file):
    m, taken = file.model, {file.name("body", i) for i in range(file.model.nbody)}
    for i in range(m.nsite):
        name, body = file.name("site", i), file.name("body", m.site_bodyid[i])
        yield Frame(f"{body}/{name}" if name in taken else name, body, _pose(m.site_pos[i], m.site_quat[i]))


def _pose(p, wxyz):
    entries = Rotation.from_quaternion(np.array(wxyz)).entries
    return RigidTransform(Rotation(rotation_of(entries).ravel()), np.array(p))


# -- states -----------------------------------------------------------------------------------------------------------


def to_qpos(mechanism, q):
    """mjData.qpos (*batch, model.nq) of q (*batch, nq). Exact but for mimics."""
    pieces, q = _state("mjcf.to_qpos", mechanism, q=q)
    return _joined(q, [_rolled(p, p.followed(q[..., p.q])) for p in pieces])


def from_qpos(mechanism, qpos):
    """q (*batch, nq) of mjData.qpos (*batch, model.nq); what is in it of mimics is left out. Exact."""
    pieces, qpos = _state("mjcf.from_qpos", mechanism, qpos=qpos)
    return _joined(qpos, [_rolled(p, qpos[..., p.qpos], back=True) for p in pieces if not p.is_mimic])


def to_qvel(mechanism, q, v, *, precision=None):
    """mjData.qvel (*batch, model.nv) of q (*batch, nq) and v (*batch, nv)."""
    pieces, q, v = _state("mjcf.to_qvel", mechanism, q=q, v=v)
    return _joined(q, [p.in_world(q, p.followed(v[..., p.v], of_rates=True), precision) for p in pieces])


def from_qvel(mechanism, q, qvel, *, precision=None):
    """v (*batch, nv) of q (*batch, nq), ours, and mjData.qvel (*batch, model.nv); mimics are left out."""
    pieces, q, qvel = _state("mjcf.from_qvel", mechanism, q=q, qvel=qvel)
    return _joined(q, [p.in_body(q, qvel[..., p.qvel], precision) for p in pieces if not p.is_mimic])


def to_qacc(mechanism, q, v, vdot, *, precision=None):
    """mjData.qacc (*batch, model.nv) of q (*batch, nq), v and vdot (*batch, nv). MuJoCo's linear acceleration of a free
    joint is that of the body's origin in world axes, R (dv/dt + w x v)."""
    pieces, q, v, vdot = _state("mjcf.to_qacc", mechanism, q=q, v=v, vdot=vdot)
    found = [p.classical(p.followed(vdot[..., p.v], of_rates=True), v[..., p.v], precision) for p in pieces]
    return _joined(q, [p.in_world(q, x, precision) for p, x in zip(pieces, found, strict=True)])


def from_qacc(mechanism, q, v, qacc, *, precision=None):
    """vdot (*batch, nv) of q (*batch, nq) and v (*batch, nv), ours, and mjData.qacc (*batch, model.nv)."""
    pieces, q, v, qacc = _state("mjcf.from_qacc", mechanism, q=q, v=v, qacc=qacc)
    own = [p for p in pieces if not p.is_mimic]
    found = [p.in_body(q, qacc[..., p.qvel], precision) for p in own]
    return _joined(q, [p.derivative(x, v[..., p.v], precision) for p, x in zip(own, found, strict=True)])


def to_qfrc(mechanism, q, tau, *, precision=None):
    """Generalised forces of MuJoCo (*batch, model.nv), as qfrc_applied, of q (*batch, nq) and tau (*batch, nv), with
    the same power. None on mimics."""
    pieces, q, tau = _state("mjcf.to_qfrc", mechanism, q=q, tau=tau)
    return _joined(q, [0 * tau[..., p.v] if p.is_mimic else p.in_world(q, tau[..., p.v], precision) for p in pieces])


def from_qfrc(mechanism, q, qfrc, *, precision=None):
    """tau (*batch, nv) of q (*batch, nq), ours, and generalised forces of MuJoCo (*batch, model.nv), as qfrc_inverse or
    qfrc_bias: with the same power. What is on mimics their masters feel."""
    pieces, q, qfrc = _state("mjcf.from_qfrc", mechanism, q=q, qfrc=qfrc)
    felt = {p.v.start: p.in_body(q, qfrc[..., p.qvel], precision) for p in pieces if not p.is_mimic}
    for p in (p for p in pieces if p.is_mimic):
        felt[p.v.start] = felt[p.v.start] + p.followed(qfrc[..., p.qvel], of_rates=True)
    return _joined(q, [felt[start] for start in sorted(felt)])


class _Piece:
    """The part of a joint in all these arrays: in ours, q and v, and in MuJoCo's, qpos and qvel."""

    def __init__(self, mechanism, i, qpos, qvel, dtype):
        t = mechanism.topology
        if t.kinds[i] not in (*_KINDS, "continuous"):
            raise ValueError(f"mjcf: MuJoCo has no joints like {t.joint_names[i]!r}: {t.kinds[i]}")
        self.q, self.v, self.qpos, self.qvel = t.q_slice(i), t.v_slice(i), qpos, qvel
        self.is_free, self.is_mimic = t.kinds[i] == "free", t.is_mimic(i)
        self.multiplier, self.offset = (mechanism.mimics[i, k : k + 1].astype(dtype) for k in (0, 1))

    def followed(self, x, of_rates=False):
        """Of the part of the master."""
        if not self.is_mimic:
            return x
        multiplier, offset = (jnp.broadcast_to(jnp.asarray(y), x.shape) for y in (self.multiplier, self.offset))
        return multiplier * x if of_rates else multiplier * x + offset

    def in_world(self, q, x, precision):
        """(linear in world axes, angular) of (angular, linear) in the body's; of a free joint."""
        return (
            joined(rotated(self._R(q, precision), x[..., 3:], precision=precision), x[..., :3]) if self.is_free else x
        )

    def in_body(self, q, x, precision):
        if not self.is_free:
            return x
        return joined(x[..., 3:], rotated(self._R(q, precision).inverse(), x[..., :3], precision=precision))

    def _R(self, q, precision):
        return Rotation.from_quaternion(q[..., self.q][..., :4], precision=precision)

    def classical(self, vdot, v, precision):
        """Of a free joint: vdot is the acceleration of Featherstone."""
        if not self.is_free:
            return vdot
        return SpatialAcceleration.from_featherstone(
            vdot, SpatialVelocity.from_array(v), precision=precision
        ).to_array()

    def derivative(self, acceleration, v, precision):
        if not self.is_free:
            return acceleration
        A = SpatialAcceleration.from_array(acceleration)
        return A.to_featherstone(SpatialVelocity.from_array(v), precision=precision)


def _rolled(piece, x, back=False):
    """The position of a free joint before its quaternion, or back."""
    n = 3 if back else 4
    return jnp.concatenate([x[..., n:], x[..., :n]], -1) if piece.is_free else x


def _state(operation, mechanism, **arrays):
    """(the pieces of all joints, the arrays over one batch shape)."""
    if not isinstance(mechanism, Mechanism):
        raise TypeError(f"{operation}: expected a Mechanism first, got {type(mechanism).__name__}")
    kinds = [mechanism.topology.kind(i) for i in range(len(mechanism.topology))]
    ends = [[0, *itertools.accumulate(sizes)] for sizes in ([k.nq for k in kinds], [k.nv for k in kinds])]
    sizes = {"q": mechanism.nq, "qpos": ends[0][-1]} | dict.fromkeys(("qvel", "qacc", "qfrc"), ends[1][-1])
    given = {
        name: check.as_vectors(x, f"{operation}: {name}", size=sizes.get(name, mechanism.nv))
        for name, x in arrays.items()
    }
    check.require_same_dtype(**given)
    batch = check.common_batch_shape(**{name: x.shape[:-1] for name, x in given.items()})
    dtype = next(iter(given.values())).dtype
    places = ([slice(a, b) for a, b in itertools.pairwise(e)] for e in ends)
    pieces = [_Piece(mechanism, i, *place, dtype) for i, place in enumerate(zip(*places, strict=True))]
    return pieces, *check.broadcast_batch(batch, *given.values())


def _joined(like, parts):
    return jnp.concatenate([like[..., :0], *parts], -1)
