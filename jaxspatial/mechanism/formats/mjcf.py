"""Mechanisms from MuJoCo's format (mujoco.readthedocs.io, XML reference).

The package mujoco compiles the files. Bodies, joints, sites and fixed cameras become bodies, joints and frames of the
same name, "body_<id>", "joint_<id>", "site_<id>" and "cam_<id>" where they have none; a site or a camera with a name
that is taken is "<body>/<name>". A camera looks along -z. Of several joints on one body, each but the last carries a
body without mass, "<body>/<joint>". Fixed tendons with springs, damping or limits become the `tendons` of the
mechanism, and bodies with `gravcomp` have lifts. Springs, damping and friction of joints are numbers of the mechanism,
see `passive_forces`.

Equality constraints are taken for rigid. Those of joints and of fixed tendons may be of at most first degree. An
equality of two joints makes the first a mimic of the second; where it is one already, equations are solved for another
joint, and those that say nothing more are left out. An equality of one joint, or of three and more, becomes a
`Tendon` with two equal limits, which says what holds it; the warning names it. `connect` and `weld` become the
`loops` of the mechanism, of kinds "ball" and "weld"; between bodies they hold frames "<constraint>/a" on the first body
and "<constraint>/b" on the second.

What serves pictures, contact or control (geoms but for their mass, sensors, keyframes, actuators but for
armature and damping, options of MuJoCo's solver, mocap) is no part of a mechanism, and is left out. Drag of the medium,
springs, damping and limits of ropes (spatial tendons), and friction of tendons are left out, too; one
`ModelFileWarning` lists them, and `strict=True` refuses them. Everything else that changes the motion and that a
mechanism cannot represent is refused, and so are numbers that are not finite or beyond the dtype. Messages have the
line of the element, or of what holds it where it is in an attached model.

What a joint does not say has MuJoCo's default, or that of its class: without an axis it is along z. The mass matrix of
several slides of one body along the same direction is singular. MuJoCo takes it for diagonal (`body_simple`) where the
body hangs on the world and carries nothing, its joints are along the axes of its frame, and its centre of mass is at
its origin: results then differ.

Coordinates of hinges, slides and balls are MuJoCo's: zero is where `ref` is zero. A free joint has its quaternion
first, and its linear velocity in the body's axes; a mimic has no coordinate. `interop.mujoco` converts.

A free joint with `frictionloss` becomes the slides "<joint>/x", "<joint>/y" and "<joint>/z" along the axes of the world
and the ball "<joint>/ball", as MuJoCo's friction acts along the axes of the world; the warning names the joint. Their
coordinates and velocities are those of MuJoCo's free joint. The same is made of a free joint whose damping or armature
differs from axis to axis, as it can in an MjModel.
"""

import collections
import functools
import pathlib
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple, NoReturn

import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism.formats.collision import CollisionShape
from jaxspatial.mechanism.formats.source import (
    Element,
    Made,
    ModelText,
    built,
    doubt_inertias,
    needed,
    parsed,
    rotation_of,
    with_moments,
)
from jaxspatial.mechanism.loops import Kind, LoopClosure
from jaxspatial.mechanism.parts import WORLD, Body, Frame, Joint, Mimic
from jaxspatial.mechanism.tendons import Tendon
from jaxspatial.numerics.numbers.rounded import in_double
from jaxspatial.numerics.types import DTypeLike
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform


def read(
    build: Callable[..., Made],
    path_or_text: Any,
    assets: Mapping[str, bytes] | None = None,
    dtype: DTypeLike | None = None,
    strict: bool = False,
) -> Made:
    """Reads an MJCF for `Mechanism.from_mjcf`: the same arguments and errors, and `Mechanism.build`."""
    file = _File(path_or_text, assets, dtype, strict)
    _check(file)
    _leave_out(file)
    with in_double():
        *parts, loops, tendons = _parts(file)
    mechanism = built(build, file.refuse_part, *parts, file.gravity, dtype, loops, tendons)
    doubt_inertias(file, mechanism)
    file.warn()
    return mechanism


def read_shapes(path_or_text: Any, assets: Mapping[str, bytes] | None = None) -> list[CollisionShape]:
    """The geoms of an MJCF for `PointContacts.from_mjcf`, but those that are welded to the world: these are ground.

    Two geoms touch where contype of one and conaffinity of the other share a bit, unless an <exclude> names their
    bodies, or where a <pair> names them. In a file with ground a geom may touch that touches some of it; in one
    without, every geom that could touch another.
    """
    file = _File(path_or_text, assets, None, False)
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
    file = _File(path_or_text, assets, None, False)
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
        return top * levels.T, np.array([2 * half_x, 2 * half_y]), _pose(data.geom_xpos[i], wxyz)


class ActuatorPart(NamedTuple):
    """An actuator of a file. numbers: those of `Actuators`, by name."""

    name: str
    joints: list[str]
    gears: list[float]
    numbers: dict[str, float]


def read_actuators(path_or_text: Any, assets: Mapping[str, bytes] | None = None) -> list[ActuatorPart]:
    """The actuators of an MJCF for `Actuators.from_mjcf`, those that are plain; a warning lists the others."""
    file = _File(path_or_text, assets, None, False)
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
    file = _File(path_or_text, assets, None, False)
    m, places = file.model, file.numbers("actuator_ctrladr")
    # Where the ctrl of each actuator is in those of the model.
    plain = [int(places[i, 0]) if places.shape[1] else i for i in _plain_actuators(file)]
    parts = (m.key_qpos, m.key_qvel, m.key_ctrl[:, plain])
    return [KeyFramePart(m.key(k).name or f"key_{k}", *(np.array(x[k]) for x in parts)) for k in range(m.nkey)]


# -- the compiled model, and where in the text its elements are -------------------------------------------------------

_KINDS = "free", "ball", "prismatic", "revolute"
# For each kind of element: the section of the text, the tags there (none for all), an array of the model with one item
# for each element.
_ELEMENTS = {
    "body": ("worldbody", ("body",), "body_parentid"),
    "joint": ("worldbody", ("joint", "freejoint"), "jnt_bodyid"),
    "site": ("worldbody", ("site",), "site_bodyid"),
    "cam": ("worldbody", ("camera",), "cam_bodyid"),
    "eq": ("equality", (), "eq_type"),
    "tendon": ("tendon", (), "tendon_num"),
    "actuator": ("actuator", (), "actuator_trntype"),
}
# Attributes whose words are numbers, in which MuJoCo takes "nan" and "inf".
_ARE_NUMBERS = {
    "pos", "quat", "axis", "euler", "axisangle", "xyaxes", "zaxis", "fromto", "size", "mass", "density", "diaginertia",
    "fullinertia", "gravity", "armature", "damping", "frictionloss", "stiffness", "ref", "springref", "springdamper",
    "gear", "polycoef",
}  # fmt: skip
_NOT_FINITE = {"nan", "inf", "infinity"}
# Attributes in which infinite numbers mean that there is no limit.
_RANGES = {"range", "actuatorfrcrange"}


class _File(ModelText):
    is_read_by_another = True

    def __init__(self, source: Any, assets: Mapping[str, bytes] | None, dtype: DTypeLike | None, strict: bool):
        mujoco = self.mujoco = needed("from_mjcf", "mujoco")
        self.assets, text = dict(assets or {}), source
        self.model: Any = None
        self.of_text = ""
        if isinstance(source, mujoco.MjSpec):
            # A copy: compiling adds what elements get by default.
            spec = source.copy()
            self.model, text = self._compiled(spec.compile), spec.to_xml()
            self.of_text = " of MjSpec.to_xml()"
        elif isinstance(source, mujoco.MjModel):
            self.model, text, self.of_text = source, "<mujoco/>", " of no text: an MjModel has none"
        super().__init__("from_mjcf", text, dtype, strict)
        self._include(self.root, {self.path and self.path.resolve()})
        self._check_finite()
        if self.model is None:
            # By its path, so that MuJoCo finds included files.
            by_text, by_path = mujoco.MjModel.from_xml_string, mujoco.MjModel.from_xml_path
            read, given = (by_text, self.source.decode()) if self.path is None else (by_path, str(self.path))
            self.model = self._compiled(functools.partial(read, given, self.assets))
        self._check_encoding_of_names()
        bits = mujoco.mjtDisableBit.__members__
        flags = self.model.opt.disableflags
        self.disabled = {name for name, bit in bits.items() if "DSBL" in name and flags & int(bit)}

    def _compiled(self, compile: Callable[[], Any]) -> Any:
        try:
            return compile()
        except ValueError as error:
            message = " ".join(str(error).split())
            said = self._with_line(message) if hasattr(self, "root") else f"MuJoCo says {message}"
            if self.malformed:
                raise ValueError(f"from_mjcf: {self.malformed}") from None
            raise ValueError(f"from_mjcf: {said}; mend the model") from None

    def line(self, element: Element) -> str:
        return super().line(element) + self.of_text

    def _include(self, element: Element, files: set[pathlib.Path | None]):
        """Puts the elements of included files in place, as MuJoCo does; leaves what cannot be read for it to refuse."""
        folder = pathlib.Path() if self.path is None else self.path.parent
        for mark in list(element.iter("include")):
            name = mark.get("file", "")
            path = (folder / name).resolve()
            if path in files:
                continue
            try:
                root, _ = parsed(self.operation, self.assets.get(name) or path.read_bytes(), None, False)
            except OSError:
                continue
            if root is None:
                continue
            self._include(root, {*files, path})
            for part in list(root.iterchildren("*")):
                part.base = part.base or name
                mark.addprevious(part)
            mark.getparent().remove(mark)

    def _with_line(self, message: str):
        """A message of MuJoCo. One about an included file has no line: that of the element which names the file."""
        if b"\0" in self.source[:4]:
            return "line 1: expected text in UTF-8, got UTF-16; save it as UTF-8"
        if found := re.search(r"Line number=(\d+)", message):
            return f"line {found[1]}: MuJoCo says {message}"
        if re.search(r"line \d+", message):
            return f"MuJoCo says {message}"
        quoted = tuple(re.findall(r"'([^']+)'", message))
        naming = [e for e in self.root.iter("*") if any(text.endswith(quoted) for text in e.attrib.values())]
        return f"{self.line((*naming, self.root)[0])}: MuJoCo says {message}"

    def _check_encoding_of_names(self):
        """Checks that names are UTF-8: the model has no others."""
        try:
            self.model.names.decode()
        except UnicodeDecodeError as error:
            byte = error.object[error.start : error.start + 1]
            line = self.source[: max(self.source.find(byte), 0)].count(b"\n") + 1
            reason = f"expected names in UTF-8, got the byte 0x{byte.hex()}; save the text as UTF-8"
            raise ValueError(f"from_mjcf: line {line}: {reason}") from None

    def _check_finite(self):
        """Checks the text: its lines are known, and MuJoCo would write into a log."""
        for element in self.root.iter("*"):
            for name, text in element.items():
                words = {word.lstrip("+-") for word in text.lower().split()}
                if ("nan" in words and name in _RANGES) or (words & _NOT_FINITE and name in _ARE_NUMBERS):
                    self.refuse_element(element, f"{name}: expected finite numbers, got {text!r}")

    def has(self, *flags: str):
        """Whether none of these is switched off: "SPRING", ..."""
        return not any(f"mjDSBL_{flag}" in self.disabled for flag in flags)

    @property
    def gravity(self):
        return np.array(self.model.opt.gravity) if self.has("GRAVITY") else np.zeros(3)

    def name(self, what: str, i: int) -> str:
        if (what, i) == ("body", 0):
            return WORLD
        # Of a plugin the model has no view.
        own = (
            self.mujoco.mj_id2name(self.model, int(self.mujoco.mjtObj.mjOBJ_PLUGIN), i)
            if what == "plugin"
            else (getattr(self.model, what)(i).name)
        )
        return own or f"{what}_{i}"

    def kind(self, j: int) -> str:
        return _KINDS[int(self.model.jnt_type[j])]

    def is_limited(self, j: int):
        """Whether the range of a joint limits it."""
        return bool(self.model.jnt_limited[j]) and self.has("LIMIT", "CONSTRAINT")

    def dofs(self, j: int):
        """The places of the velocities of a joint."""
        start = self.model.jnt_dofadr[j]
        return slice(start, start + {"free": 6, "ball": 3}.get(self.kind(j), 1))

    def coordinates(self, j: int):
        """The places of the coordinates of a joint."""
        start = self.model.jnt_qposadr[j]
        return slice(start, start + {"free": 7, "ball": 4}.get(self.kind(j), 1))

    def numbers(self, name: str):
        """An array of the model as (n, k); zeros (n, 0) where this version of MuJoCo does not have it."""
        array = getattr(self.model, name, None)
        return np.zeros((1 << 16, 0)) if array is None else np.asarray(array).reshape((len(array), array[:1].size or 1))

    def option(self, name: str) -> Element:
        """The last element that sets an option, or the root."""
        return [self.root, *(e for e in self.root.findall("option") if e.get(name))][-1]

    def refuse(self, what: str, i: int, reason: str) -> NoReturn:
        element = self._element(what, i)
        if element is None:
            around = self._around(what, i)
            self.refuse_named(f"{self.line(around)}: in <{around.tag}>", what, self.name(what, i), reason)
        self.refuse_named(self.line(element), element.tag, self.name(what, i), reason)

    def refuse_part(self, what: str, name: str, reason: str) -> NoReturn:
        """Refuses a part of the mechanism. "<body>/<joint>" is a body of ours, "<joint>/x" a joint, "<body>/<site>" a
        site that has the name of a body; bodies and sites are frames."""
        kind = "body" if what == "frame" else what
        # The name, and what is left of it before each "/" from the last one on.
        words = name.split("/")
        own, *before = ((kind, "/".join(words[:k])) for k in range(len(words), 0, -1))
        sites = (("site", name), ("site", name.rpartition("/")[2])) if what == "frame" else ()
        for kind, candidate in (own, *sites, *before):
            names = [self.name(kind, i) for i in range(len(self._array(kind)))]
            if candidate in names:
                self.refuse(kind, names.index(candidate), reason)
        self.refuse_element(self.root, reason)

    def _array(self, what: str):
        return getattr(self.model, _ELEMENTS[what][2])

    def _element(self, what: str, i: int) -> Element | None:
        """By its name, or by its place where the text has all elements that the model has; else None."""
        section, tags, _ = _ELEMENTS[what]
        elements = [e for part in self.root.findall(section) for e in part.iter(*tags) if isinstance(e.tag, str)]
        named = [e for e in elements if e.get("name") and e.get("name") == getattr(self.model, what)(i).name]
        listed = self._listed(what)
        return named[0] if named else listed[i] if len(listed) == len(self._array(what)) else None

    def _around(self, what: str, i: int) -> Element:
        """What holds an element that is not in the text, as one of an attached model: a body, or the section."""
        if what in ("body", "joint", "site", "cam") and (what, i) != ("body", 0):
            carrier = int(self._array(what)[i])
            element = self._element("body", carrier)
            return self._around("body", carrier) if element is None else element
        return [self.root, *self.root.findall(_ELEMENTS[what][0])][-1]

    def _listed(self, what: str) -> list[Element]:
        """Elements in the order of the model: body by body, bodies depth first. The world may have several elements."""
        section, tags, _ = _ELEMENTS[what]
        parts = self.root.findall(section)
        if section != "worldbody":
            return [e for part in parts for e in part.iterchildren("*")]
        bodies = [parts or [self.root], *([body] for part in parts for body in _bodies(part))]
        if what == "body":
            return [body[0] for body in bodies]
        return [e for body in bodies for part in body for e in _children(part, tags)]


def _bodies(element: Element) -> Iterator[Element]:
    for body in _children(element, ("body",)):
        yield body
        yield from _bodies(body)


def _children(element: Element, tags: tuple[str, ...]) -> Iterator[Element]:
    """Children with these tags, those in frames too, and those in <replicate> as often as it says."""
    for part in element.iterchildren("*"):
        if part.tag in tags:
            yield part
        elif part.tag in ("frame", "replicate"):
            yield from [*_children(part, tags)] * int(part.get("count", 1))


# -- the shapes that touch --------------------------------------------------------------------------------------------


def _is_ground(file: _File, i: int) -> bool:
    return not file.model.body_weldid[file.model.geom_bodyid[i]]


def _shape(file: _File, i: int, may_touch: bool) -> CollisionShape:
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
    pose, body = _pose(m.geom_pos[i], m.geom_quat[i]), file.name("body", m.geom_bodyid[i])
    vertices = functools.partial(_vertices, file, int(m.geom_dataid[i])) if kind == "mesh" else None
    friction = float(m.geom_friction[i, 0])
    return CollisionShape(file.name("geom", i), body, pose, kind, tuple(size), vertices, friction, may_touch)


def _vertices(file: _File, mesh: int) -> np.ndarray:
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


# -- actuators --------------------------------------------------------------------------------------------------------


def _plain_actuators(file: _File) -> list[int]:
    return [i for i in range(len(file.model.actuator_trntype)) if not _not_plain(file, i)]


def _not_plain(file: _File, i: int) -> str:
    """What of an actuator is not that of `Actuators`; "" for nothing."""
    m, mujoco = file.model, file.mujoco
    gain, bias = m.actuator_gainprm[i], m.actuator_biasprm[i]
    gains, biases = (
        (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE),
        (
            mujoco.mjtBias.mjBIAS_NONE,
            mujoco.mjtBias.mjBIAS_AFFINE,
        ),
    )
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


def _pulled(file: _File, i: int) -> tuple[list[int], np.ndarray] | None:
    """(joints, coefficients) of the length of an actuator, without its gear; None where it is no linear form."""
    m, kinds, target = file.model, file.mujoco.mjtTrn, int(file.model.actuator_trnid[i, 0])
    type = m.actuator_trntype[i]
    if type == int(kinds.mjTRN_TENDON) and _is_fixed(file, target):
        return _coordinates_of(file, target)
    is_joint = type in (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT))
    return ([target], np.ones(1)) if is_joint and file.kind(target) in ("revolute", "prismatic") else None


def _actuator(file: _File, i: int) -> ActuatorPart:
    m, bias = file.model, file.model.actuator_biasprm[i]
    joints, c = _pulled(file, i) or ([], np.zeros(0))
    is_affine = m.actuator_biastype[i] == int(file.mujoco.mjtBias.mjBIAS_AFFINE)
    b, k, d = (bias[:3] * is_affine).tolist()
    numbers = {"gain": float(m.actuator_gainprm[i, 0]), "bias": b, "stiffness": -k, "damping": -d}
    limits = {
        ("lower", "upper"): (m.actuator_forcelimited[i], m.actuator_forcerange[i]),
        ("ctrl_lower", "ctrl_upper"): (
            m.actuator_ctrllimited[i] and file.has("CLAMPCTRL"),
            m.actuator_ctrlrange[i],
        ),
    }
    for names, (is_limited, pair) in limits.items():
        numbers |= dict(zip(names, pair.tolist() if is_limited else (-np.inf, np.inf), strict=True))
    gears = (c * m.actuator_gear[i, 0]).tolist()
    return ActuatorPart(file.name("actuator", i), [file.name("joint", j) for j in joints], gears, numbers)


def _miss_limits_of_sums(file: _File):
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


# -- what changes the motion and cannot be represented is refused -----------------------------------------------------

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
_OF_VELOCITIES = {"armature": "dof_armature", "damping": "dof_damping", "frictionloss": "dof_frictionloss"}
_OF_COORDINATES = {"ref": "qpos0", "springref": "qpos_spring"}
# How the warning lists equality constraints that become tendons with equal limits.
HELD = "equality read as a tendon of one length, which convex_step holds"
# What is this small next to the terms of a sum comes from rounding.
_ROUNDED = 1e-9
# How the warning lists free joints of which slides and a ball are made.
SPLIT = "free joint read as slides NAME/x, NAME/y, NAME/z and a ball NAME/ball"
_NOT_NEGATIVE = {"mass", "stiffness", "armature", "damping", "frictionloss"}


def _check(file: _File):
    m = file.model
    for name in ("density", "viscosity"):
        if getattr(m.opt, name) != 0:
            if file.strict:
                file.refuse_strictly(file.option(name), f"{name}: there is no drag here, expected 0")
            file.miss("drag", f"{name} of the medium")
    if not (abs(file.gravity) <= file.largest).all():
        file.refuse_element(file.option("gravity"), f"gravity: {_finite(file)}, got {file.gravity.tolist()}")
    if m.nflex:
        file.refuse_element([file.root, *file.root.iter("flex", "flexcomp")][-1], "bodies are rigid here; take it out")
    _check_numbers(file)
    for i in range(m.nbody):
        if m.body_plugin[i] >= 0:
            file.refuse("body", i, "plugin: what it does to the motion is not known; take it out")
    _check_joints(file)
    _check_tendons(file)


def _check_numbers(file: _File):
    """Checks the compiled numbers: finite, and not negative where no matter has such."""
    m = file.model
    for what, arrays in _NUMBERS.items():
        for name, array in arrays.items():
            for i, x in enumerate(file.numbers(array)[: len(getattr(m, array, ()))]):
                _check_number(file, what, i, name, x)
    for i in range(m.neq):
        name = "anchor" if m.eq_type[i] in _closures(file) else "polycoef"
        _check_number(file, "eq", i, name, m.eq_data[i])
    for j in range(m.njnt):
        for name, array in _OF_VELOCITIES.items():
            _check_number(file, "joint", j, name, getattr(m, array)[file.dofs(j)])
        for name, array in _OF_COORDINATES.items():
            _check_number(file, "joint", j, name, getattr(m, array)[file.coordinates(j)])
        if np.isnan(m.jnt_range[j]).any():
            file.refuse("joint", j, "range: expected numbers, got nan")
        if not np.isclose(np.linalg.norm(m.jnt_axis[j]), 1):
            file.refuse("joint", j, "axis: expected numbers that MuJoCo can make a unit vector of")


def _check_number(file: _File, what: str, i: int, name: str, x: np.ndarray):
    if not (abs(x) <= file.largest).all():
        file.refuse(what, i, f"{name}: {_finite(file)}, got {x.tolist()}")
    if name in _NOT_NEGATIVE and (x < 0).any():
        file.refuse(what, i, f"{name}: expected a number >= 0, got {x.tolist()}")
    if name == "mass" and 0 < x < file.smallest:
        file.refuse(what, i, f"mass: expected at least {file.smallest:.3g}, got {x.tolist()}")


def _finite(file: _File):
    return f"expected finite numbers of at most {file.largest:.3g}"


def _check_joints(file: _File):
    m, has_springs = file.model, file.has("SPRING", "PASSIVE")
    for j in range(m.njnt):
        if has_springs and file.numbers("jnt_stiffnesspoly")[j].any():
            file.refuse("joint", j, "stiffness: expected one number, springs are linear here")
        if has_springs and file.numbers("jnt_springyield")[j].any():
            file.refuse("joint", j, "springyield: expected none, springs stay elastic here")
        if file.has("DAMPER", "PASSIVE") and file.numbers("dof_dampingpoly")[file.dofs(j)].any():
            file.refuse("joint", j, "damping: expected one number, forces are linear in the rate here")


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


def _check_tendons(file: _File):
    """Fixed tendons have linear springs, damping and limits here; ropes from place to place do nothing."""
    for i in range(file.model.ntendon):
        if _is_fixed(file, i):
            _check_number(file, "tendon", i, "coef", _coordinates_of(file, i)[1])
        for name, flags in _OF_TENDONS.items():
            if not (file.has(*flags) and file.numbers(f"tendon_{name}")[i].any()):
                continue
            short = name.removesuffix("poly")
            if name in ("stiffness", "damping", "limited") and _is_fixed(file, i):
                continue
            is_left_out = name == "frictionloss" or (not _is_fixed(file, i) and name != "armature")
            if is_left_out and not file.strict:
                of = "a tendon" if name == "frictionloss" else "a tendon along a rope"
                file.miss(f"{'range' if short == 'limited' else short} of {of}", file.name("tendon", i))
                continue
            kinds = "one number: springs and damping are linear" if name != short else "none of a rope"
            expected = kinds if short in ("stiffness", "damping") else "none"
            short = "range" if short == "limited" else short
            file.refuse("tendon", i, f"{short}: expected {expected} here, tendons are linear forms; leave it out")


def _is_fixed(file: _File, i: int) -> bool:
    m = file.model
    return int(m.wrap_type[m.tendon_adr[i]]) == int(file.mujoco.mjtWrap.mjWRAP_JOINT)


# -- what is no part of a mechanism is listed -------------------------------------------------------------------------

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


def _leave_out(file: _File):
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


# -- the parts of the mechanism ---------------------------------------------------------------------------------------


def _parts(file: _File):
    """(bodies, joints, frames, loops, tendons)."""
    followers, equations = _solved(file, _equations(file))
    mimics = {j: Mimic(file.name("joint", leader), a, b) for j, (leader, a, b) in followers.items()}
    moving, rotors = range(1, file.model.nbody), _rotors(file)
    joints = [joint for i in moving for joint in _joints(file, i, rotors, mimics)]
    loops, anchors = _loops(file)
    bodies, frames = [_body(file, i) for i in moving], [*_frames(file), *anchors]
    between = {joint.child for joint in joints} - {body.name for body in bodies}
    bodies += map(Body, sorted(between))
    _check_names(file, [joint.name for joint in joints])
    _check_names(file, [part.name for part in (*bodies, *frames)])
    return bodies, joints, frames, loops, [*_tendons(file), *_tendons_of_one_length(file, equations)]


def _check_names(file: _File, names: list[str]):
    """Checks that the names made for elements without one are not those of others."""
    for name, count in collections.Counter(names).items():
        if count > 1:
            named = [e for e in file.root.iter("body", "joint", "freejoint", "site") if e.get("name") == name]
            reason = f"name: {name!r} is made for another here, which has no such name in the file; name one otherwise"
            file.refuse_element([file.root, *named][-1], reason)


def _rotors(file: _File):
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


def _equalities(file: _File) -> list[int]:
    """The numbers of the equality constraints that are active."""
    return [i for i in range(file.model.neq) if file.model.eq_active0[i] and file.has("EQUALITY", "CONSTRAINT")]


def _closures(file: _File) -> dict[int, Kind]:
    """{type of an equality constraint: the kind of closure that it is}."""
    types = file.mujoco.mjtEq
    return {int(types.mjEQ_CONNECT): "ball", int(types.mjEQ_WELD): "weld"}


class _Equation(NamedTuple):
    """sum c q = length, over different joints: constraint number i of the model."""

    i: int
    joints: list[int]
    c: np.ndarray
    length: float


def _equations(file: _File) -> list[_Equation]:
    """Those of the equality constraints of joints and tendons."""
    m, types = file.model, file.mujoco.mjtEq
    of = {int(types.mjEQ_JOINT): _equation_of_joints, int(types.mjEQ_TENDON): _equation_of_tendons}
    found = list[_Equation]()
    for i in _equalities(file):
        if m.eq_type[i] in of:
            found.append(of[int(m.eq_type[i])](file, i))
        elif m.eq_type[i] not in _closures(file):
            expected = "expected joints or tendons that follow others, or bodies that are connected or welded"
            file.refuse("eq", i, f"{expected}; leave it out")
    return found


def _equation_of_joints(file: _File, i: int) -> _Equation:
    """q1 - ref1 = a0 + a1 (q2 - ref2), or q1 - ref1 = a0 without joint2."""
    m, (a0, a1) = file.model, _coefficients(file, i)
    j, leader = m.eq_obj1id[i], m.eq_obj2id[i]
    length = a0 + _reference(file, j)
    if leader < 0:
        return _Equation(i, [j], np.ones(1), length)
    return _Equation(i, [j, leader], np.array([1.0, -a1]), length - a1 * _reference(file, leader))


def _equation_of_tendons(file: _File, i: int) -> _Equation:
    """L1 - ref1 = a0 + a1 (L2 - ref2), or L1 - ref1 = a0 without tendon2."""
    m, (a0, a1) = file.model, _coefficients(file, i)
    length, of_joints = a0, dict[int, float]()
    for name, factor in (("obj1id", 1.0), ("obj2id", -a1)):
        tendon = int(getattr(m, f"eq_{name}")[i])
        if tendon < 0:
            continue
        if not _is_fixed(file, tendon):
            way_out = "leave the constraint out, or close a loop with a connect"
            file.refuse("eq", i, f"tendon{name[3]}: expected fixed tendons, got {file.name('tendon', tendon)!r} along "
                        f"a rope; {way_out}")  # fmt: skip
        length += factor * float(m.tendon_length0[tendon])
        for j, x in zip(*_coordinates_of(file, tendon), strict=True):
            of_joints[j] = of_joints.get(j, 0.0) + factor * float(x)
    joints = [j for j, x in of_joints.items() if x]
    if not joints:
        file.refuse("eq", i, "tendon1: expected tendons that move, got joints that cancel; leave it out")
    return _Equation(i, joints, np.array([of_joints[j] for j in joints]), length)


def _coefficients(file: _File, i: int) -> tuple[float, float]:
    """The polynomial a0 + a1 x of an equality constraint."""
    m = file.model
    if m.eq_obj2id[i] >= 0 and any(m.eq_data[i, 2:5]):
        expected = "expected a polynomial of at most first degree"
        file.refuse("eq", i, f"polycoef: {expected}, got {m.eq_data[i, :5].tolist()}; cut the others, or leave it out")
    return float(m.eq_data[i, 0]), float(m.eq_data[i, 1])


class _Follower(NamedTuple):
    """q = multiplier q[leader] + offset."""

    leader: int
    multiplier: float
    offset: float


def _solved(file: _File, equations: list[_Equation]) -> tuple[dict[int, _Follower], list[_Equation]]:
    """({joint: what it follows}, the equations that make no mimic).

    Of two joints the first follows the second. Where it follows another already, the joints that both follow in the
    end take their places. What is left of an equation then says something, nothing, or what cannot be.
    """
    followers, others = dict[int, _Follower](), list[_Equation]()
    for equation in sorted(equations, key=lambda x: len(x.joints) != 2):
        i, (j, *_), (c1, *_), _ = equation
        if len(equation.joints) == 2 and (j in followers or _last(followers, equation.joints[1]).leader == j):
            equation = _over_leaders(file, followers, equation)
            if equation is None:
                continue
            (j, *_), (c1, *_) = equation.joints, equation.c
        if len(equation.joints) == 2:
            followers[j] = _Follower(equation.joints[1], -float(equation.c[1]) / float(c1), equation.length / float(c1))
        elif _over_leaders(file, followers, equation):
            others.append(equation)
    for j in followers:
        if file.is_limited(j):
            file.miss("range of a mimic", file.name("joint", j))
    return followers, sorted(others, key=lambda x: x.i)


def _last(followers: dict[int, _Follower], j: int) -> _Follower:
    """The joint that another one follows in the end, and how; itself where it follows none."""
    leader, a, b = j, 1.0, 0.0
    while leader in followers:
        leader, further, c = followers[leader]
        a, b = a * further, a * c + b
    return _Follower(leader, a, b)


def _over_leaders(file: _File, followers: dict[int, _Follower], equation: _Equation) -> _Equation | None:
    """An equation over joints that follow none; None where others say it already."""
    i, joints, c, length = equation
    of_leaders, sizes = dict[int, float](), [abs(length)]
    for j, x in zip(joints, c.tolist(), strict=True):
        leader, a, b = _last(followers, j)
        of_leaders[leader] = of_leaders.get(leader, 0.0) + x * a
        length -= x * b
        sizes += [abs(x * a), abs(x * b)]
    left = {j: x for j, x in of_leaders.items() if abs(x) > _ROUNDED * max(sizes)}
    if left:
        return _Equation(i, list(left), np.array([*left.values()]), length)
    if abs(length) > _ROUNDED * max(sizes):
        names = ", ".join(repr(file.name("joint", j)) for j in joints)
        file.refuse("eq", i, f"{names} cannot be so: other constraints say otherwise by {length:.3g}; leave one out")
    file.leave_out("constraint that others imply", file.name("eq", i))
    return None


def _coordinates_of(file: _File, i: int) -> tuple[list[int], np.ndarray]:
    """(joints, coefficients) of a fixed tendon. One that comes twice has the sum."""
    m = file.model
    places = range(m.tendon_adr[i], m.tendon_adr[i] + m.tendon_num[i])
    c = dict[int, float]()
    for k in places:
        c[int(m.wrap_objid[k])] = c.get(int(m.wrap_objid[k]), 0.0) + float(m.wrap_prm[k])
    return list(c), np.array([*c.values()])


def _tendons(file: _File) -> list[Tendon]:
    """The fixed tendons that do something."""
    m, found = file.model, list[Tendon]()
    for i in filter(functools.partial(_is_fixed, file), range(m.ntendon)):
        stiffness, damping, limited = (
            file.numbers(f"tendon_{name}")[i] * file.has(*_OF_TENDONS[name])
            for name in ("stiffness", "damping", "limited")
        )
        if stiffness.any() or damping.any() or limited.any():
            joints, c = _coordinates_of(file, i)
            lower, upper = m.tendon_range[i].tolist() if limited.any() else (-np.inf, np.inf)
            numbers = {"stiffness": float(stiffness[0]), "damping": float(damping[0]), "rest": m.tendon_lengthspring[i]}
            names = [file.name("joint", j) for j in joints]
            found.append(Tendon(file.name("tendon", i), names, c, lower=lower, upper=upper, **numbers))
    return found


def _tendons_of_one_length(file: _File, equations: list[_Equation]) -> list[Tendon]:
    """One for each of the equations, which make no mimic."""
    found = list[Tendon]()
    for i, joints, c, length in equations:
        name = file.name("eq", i)
        _check_number(file, "eq", i, "coefficients and length", np.array([*c, length]))
        file.doubt(HELD, name)
        found.append(Tendon(name, [file.name("joint", j) for j in joints], c, lower=length, upper=length))
    return found


def _body(file: _File, i: int):
    m, name = file.model, file.name("body", i)
    if not (m.body_mass[i] > 0 or m.body_inertia[i].any()):
        return Body(name)
    # MuJoCo computes as if frames that nearly coincide did.
    is_same = m.body_sameframe[i] == int(file.mujoco.mjtSameFrame.mjSAMEFRAME_BODY)
    X_BI = _pose(np.zeros(3), np.array([1.0, 0, 0, 0])) if is_same else _pose(m.body_ipos[i], m.body_iquat[i])
    lift = None
    if share := float(m.body_gravcomp[i]):
        lift = SpatialInertia(np.float64(share * m.body_mass[i]), X_BI.translation, np.zeros((3, 3)))
    return Body(name, with_moments(m.body_mass[i], X_BI, np.diag(m.body_inertia[i])), lift)


def _joints(file: _File, i: int, rotors: dict[str, np.ndarray], mimics: dict[int, Mimic]):
    """The joints of a body, in series."""
    m, body, parent = file.model, file.name("body", i), file.name("body", file.model.body_parentid[i])
    X_PB = _pose(m.body_pos[i], m.body_quat[i])
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


def _free(file: _File, name: str, body: str, fields: dict[str, Any]):
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
    file.doubt(SPLIT, name)
    parent, rest = WORLD, fields["spring_reference"]
    for k, letter in enumerate("xyz"):
        child, own = f"{body}/{name}/{letter}", {x: array[3 + k] for x, array in numbers.items()}
        axis = np.eye(3)[k]
        yield Joint(f"{name}/{letter}", "prismatic", parent, child, axis=axis, spring_reference=rest[4 + k], **own)
        parent = child
    own = {x: array[:3] for x, array in numbers.items()}
    yield Joint(f"{name}/ball", "ball", parent, body, spring_reference=rest[:4], **own)


def _numbers(file: _File, j: int, rotors: dict[str, np.ndarray]):
    """The fields of a joint that are numbers, by name."""
    m, kind, dofs = file.model, file.kind(j), file.dofs(j)
    rest = np.array(m.qpos_spring[file.coordinates(j)])
    of_velocities = (getattr(m, _OF_VELOCITIES[name])[dofs] for name in ("armature", "damping", "frictionloss"))
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


def _anchored(file: _File, j: int, X_PB: RigidTransform | None):
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


def _reference(file: _File, j: int):
    """MuJoCo's coordinate in the pose that the file describes."""
    is_number = file.kind(j) in ("revolute", "prismatic")
    return float(file.model.qpos0[file.model.jnt_qposadr[j]]) if is_number else 0.0


def _frames(file: _File):
    m = file.model
    for i in range(m.nsite):
        yield Frame(_site(file, i), file.name("body", m.site_bodyid[i]), _pose(m.site_pos[i], m.site_quat[i]))
    taken = {file.name(what, i) for what, n in (("body", m.nbody), ("site", m.nsite)) for i in range(n)}
    for i in range(m.ncam):
        name, body = file.name("cam", i), file.name("body", m.cam_bodyid[i])
        if m.cam_mode[i] == int(file.mujoco.mjtCamLight.mjCAMLIGHT_FIXED):
            yield Frame(f"{body}/{name}" if name in taken else name, body, _pose(m.cam_pos[i], m.cam_quat[i]))
        else:
            file.leave_out("camera that turns by itself", name)


def _loops(file: _File) -> tuple[list[LoopClosure], list[Frame]]:
    """(closures, the frames that they hold where these are no sites)."""
    m, kinds = file.model, _closures(file)
    loops, frames = list[LoopClosure](), list[Frame]()
    for i in _equalities(file):
        if (kind := kinds.get(int(m.eq_type[i]))) is None:
            continue
        ids = m.eq_obj1id[i], m.eq_obj2id[i]
        if m.eq_objtype[i] == int(file.mujoco.mjtObj.mjOBJ_SITE):
            a, b = (_site(file, k) for k in ids)
        else:
            a, b = (f"{file.name('eq', i)}/{side}" for side in "ab")
            for name, body, pose in zip((a, b), ids, _anchors(m.eq_data[i], kind), strict=True):
                frames.append(Frame(name, file.name("body", body), pose))
        loops.append(LoopClosure(a, b, kind))
    return loops, frames


def _anchors(data: np.ndarray, kind: Kind) -> list[RigidTransform]:
    """The poses of the frames that an equality constraint holds, on its two bodies."""
    unturned = np.array([1.0, 0, 0, 0])
    if kind == "ball":
        return [_pose(data[:3], unturned), _pose(data[3:6], unturned)]
    # The anchor on the second body comes first, then the pose of the second body on the first.
    return [_pose(data[3:6], data[6:10]), _pose(data[:3], unturned)]


def _site(file: _File, i: int) -> str:
    """The name of the frame of a site."""
    name, taken = file.name("site", i), {file.name("body", k) for k in range(file.model.nbody)}
    return f"{file.name('body', file.model.site_bodyid[i])}/{name}" if name in taken else name


def _pose(p: np.ndarray, wxyz: np.ndarray):
    entries = Rotation.from_quaternion(np.array(wxyz)).entries
    return RigidTransform(Rotation(rotation_of(entries).ravel()), np.array(p))
