"""MJCF: what is read of it, as a file and as text, what is refused, with its line.

The numbers of motions are compared with MuJoCo's in `peers/test_dynamics_mujoco.py`.
"""

import copy
import pathlib
import re

import jax
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import ModelFileWarning
from tests.helpers.optional import needs
from tests.helpers.tracing import assert_known_while_tracing

ARM = """<mujoco model="arm">
  <compiler angle="radian"/>
  <option gravity="0 1 -9.81"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="upper" pos=".5 .25 1" quat="1 0 0 1">
      <joint name="shoulder" axis="0 0 2" range="-1 2" armature=".5" damping=".25" frictionloss=".125"/>
      <inertial mass="2" pos="1 2 3" diaginertia="4 5 6"/>
      <site name="upper" pos="0 0 1"/>
      <body name="fore">
        <joint name="slide" type="slide" axis="0 1 0" pos="1 2 3" ref=".5"/>
        <joint name="elbow" axis="1 0 0" pos="0 0 -1" actuatorfrcrange="-3 3"/>
        <inertial mass="2" pos="1 2 3" fullinertia="4 5 6 .1 .2 .3"/>
        <body name="tool" pos="0 0 1"><inertial mass="2" pos="0 0 0" diaginertia="4 5 6"/><site name="tip"/></body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
NAMED = ("upper", "fore/slide", "fore")
SHOULDER, ELBOW, END = '<joint name="shoulder"', '<joint name="elbow"', "</mujoco>"


# What they leave out is said, and is the subject of tests of its own.
pytestmark = pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")


def changed(text, *changes):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def read(text=ARM, *changes, **options):
    return js.Mechanism.from_mjcf(changed(text, *changes), **options)


def alone(parts):
    """Of one body with these parts."""
    return f"<mujoco><worldbody><body>{parts}</body></worldbody></mujoco>"


# -- what is read -----------------------------------------------------------------------------------------------------


def test_tree():
    mech = read()
    assert (mech.body_names, mech.joint_names) == (NAMED, ("shoulder", "slide", "elbow"))
    assert (mech.topology.kinds, mech.topology.parents) == (("revolute", "prismatic", "revolute"), (-1, 0, 1))
    assert (mech.nq, mech.nv, mech.dtype) == (3, 3, np.float32)
    # A site that is called as a body is.
    frames = {"world": -1, "upper": 0, "fore/slide": 1, "fore": 2, "tool": 2, "upper/upper": 0, "tip": 2}
    assert dict(mech.topology.frames) == frames


def test_fixed_cameras_are_frames():
    """Under their own names, or that of their body before it where it is taken."""
    cameras = '<camera name="eye" pos="0 0 2"/><camera name="fore"/><camera name="follows" mode="trackcom"/><camera/>'
    mech = read(ARM, ('<site name="tip"/>', f'<site name="tip"/>{cameras}'))
    assert mech.frame_names[-4:] == ("tip", "eye", "tool/fore", "cam_3")
    np.testing.assert_array_equal(mech.frame_placements.translation[-3], [0, 0, 4])


def test_numbers(x64):
    mech = read()
    assert mech.dtype == (np.float64 if x64 else np.float32)
    placed = [[0.5, 0.25, 1], [0, -0.5, 0], [0, 0, -1]]
    np.testing.assert_array_equal(mech.placements.translation, placed)
    np.testing.assert_array_equal(mech.placements.rotation.entries[0], [0, -1, 0, 1, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(mech.child_placements.translation, [[0, 0, 0], [0, 0, 0], [0, 0, 1]])
    np.testing.assert_array_equal(mech.axes, [[0, 0, 1], [0, 1, 0], [1, 0, 0]])
    for name, expected in {
        "lower": [-1, -np.inf, -np.inf],
        "upper": [2, np.inf, np.inf],
        "effort_limit": [np.inf, np.inf, 3],
        "velocity_limit": [np.inf] * 3,
        "armature": [0.5, 0, 0],
        "damping": [0.25, 0, 0],
        "friction_loss": [0.125, 0, 0],
        "gravity": np.asarray([0, 1, -9.81], mech.dtype),
    }.items():
        np.testing.assert_array_equal(getattr(mech, name), expected, err_msg=name)
    np.testing.assert_array_equal(mech.inertias.mass, [2, 0, 4])
    np.testing.assert_array_equal(mech.inertias.com[0], [1, 2, 3])
    np.testing.assert_array_equal(mech.inertias.central[0], [4, 0, 5, 0, 0, 6])
    assert read(dtype=np.float32).dtype == np.float32


def test_full_inertia():
    mech = read(ARM, ('<body name="tool" pos="0 0 1"><inertial mass="2" pos="0 0 0" diaginertia="4 5 6"/>', "<body>"))
    # About the elbow, a metre below.
    np.testing.assert_array_equal(mech.inertias.com[2], [1, 2, 4])
    np.testing.assert_allclose(mech.inertias.central[2], [4, 0.1, 5, 0.2, 0.3, 6], rtol=4e-7)


def test_mass_of_geometries():
    mech = js.Mechanism.from_mjcf(alone('<freejoint/><geom type="box" size=".5 1 1.5" mass="6"/>'))
    np.testing.assert_allclose(mech.inertias.central, [[6.5, 0, 5, 0, 0, 2.5]], rtol=4e-7)
    assert (mech.joint_names, mech.topology.kinds, mech.inertias.mass) == (("joint_0",), ("free",), 6)


def test_names_of_what_has_none():
    changes = (' name="upper" pos', " pos"), (' name="slide"', ""), (' name="tip"', ""), (' name="tool"', "")
    mech = read(ARM, *changes)
    assert mech.frame_names == ("world", "body_1", "fore/joint_1", "fore", "body_3", "upper", "site_1")
    assert mech.joint_names == ("shoulder", "joint_1", "elbow")


def test_file_and_path_are_as_the_text(tmp_path):
    path, part = tmp_path / "arm.xml", tmp_path / "part.xml"
    path.write_text(ARM)
    texts = [repr(js.Mechanism.from_mjcf(source)) for source in (ARM, str(path), pathlib.Path(path), "\n" + ARM)]
    assert len(set(texts)) == 1
    part.write_text(alone('<joint/><geom size="1"/>').replace("<body>", '<body name="more">'))
    path.write_text(ARM.replace(END, '<include file="part.xml"/></mujoco>'))
    assert js.Mechanism.from_mjcf(path).body_names == (*NAMED, "more")
    with pytest.raises(FileNotFoundError):
        js.Mechanism.from_mjcf(str(tmp_path / "other.xml"))
    with pytest.raises(TypeError, match="from_mjcf: path_or_text: expected a path or text, got int"):
        js.Mechanism.from_mjcf(3)


MIMIC = '<equality><joint joint1="elbow" joint2="slide" polycoef=".25 2"/></equality></mujoco>'


def test_mimic():
    """elbow - 0 = 1/4 + 2 (slide - 1/2)"""
    mech = read(ARM, (END, MIMIC))
    assert (mech.nq, mech.nv) == (2, 2)
    np.testing.assert_array_equal(mech.joint_position_indices("elbow"), mech.joint_position_indices("slide"))
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [1, 0], [2, -0.75]])
    mech = read(ARM, (END, MIMIC.replace("<joint ", '<joint active="false" ')))
    assert mech.nq == 3


def test_chains_of_mimics_multiply():
    """elbow = 1/4 + 2 (slide - 1/2), slide - 1/2 = 1 + 3 shoulder."""
    chain = MIMIC.replace("<equality>", '<equality><joint joint1="slide" joint2="shoulder" polycoef="1 3"/>')
    mech = read(ARM, (END, chain))
    assert (mech.nq, mech.nv) == (1, 1)
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [3, 1.5], [6, 2.25]])


def test_rotors_of_actuators():
    """Armature and damping of what drives a joint, at its side of the gears."""
    motors = '<motor joint="elbow" gear="3" armature="2" damping="1"/><position joint="slide" kp="9"/>'
    mech = read(ARM, (END, f"<actuator>{motors}</actuator></mujoco>"))
    np.testing.assert_array_equal(mech.armature, [0.5, 0, 18])
    np.testing.assert_array_equal(mech.damping, [0.25, 0, 9])


def test_what_is_switched_off():
    flags = '<flag gravity="disable" limit="disable" spring="disable" damper="disable"/>'
    mech = read(ARM, ("<worldbody>", f"<option>{flags}</option><worldbody>"), (SHOULDER, f'{SHOULDER} stiffness="2"'))
    np.testing.assert_array_equal(mech.gravity, [0, 0, 0])
    np.testing.assert_array_equal(mech.lower, [-np.inf] * 3)
    np.testing.assert_array_equal(mech.damping, [0, 0, 0])
    np.testing.assert_array_equal(mech.stiffness, [0, 0, 0])


def test_springs():
    """Of a free joint MuJoCo has the position first."""
    springs = (SHOULDER, f'{SHOULDER} stiffness="2" springref=".25"'), ('ref=".5"', 'ref=".5" stiffness="3"')
    mech = read(ARM, *springs)
    np.testing.assert_array_equal(mech.stiffness, [2, 3, 0])
    np.testing.assert_array_equal(mech.spring_references, [0.25, 0, 0])
    mech = js.Mechanism.from_mjcf(alone('<joint type="free" stiffness="4"/><geom size="1"/>').replace(
        "<body>", '<body pos="1 2 3" quat="0 1 0 0">'
    ))  # fmt: skip
    np.testing.assert_array_equal(mech.stiffness, [4] * 6)
    np.testing.assert_array_equal(mech.spring_references, [0, 1, 0, 0, 1, 2, 3])


HUMANOIDS = [
    ("brax", "envs/assets/humanoid.xml"),
    ("brax", "envs/assets/humanoidstandup.xml"),
    ("mujoco.mjx", "test_data/humanoid/humanoid.xml"),
]


@pytest.mark.parametrize(("package", "path"), HUMANOIDS)
def test_humanoids_have_springs(package, path):
    """Those of Brax and MJX."""
    file = pathlib.Path(needs(package).__file__).parent / path
    mech, model = js.Mechanism.from_mjcf(file), mujoco.MjModel.from_xml_path(str(file))
    stiffness = model.jnt_stiffness[model.dof_jntid]
    assert stiffness.any()
    np.testing.assert_array_equal(mech.stiffness, stiffness.astype(np.float32))


def test_what_does_not_move_it_is_left_out():
    more = '<actuator><motor joint="elbow"/></actuator><sensor><jointpos joint="elbow"/></sensor></mujoco>'
    tendon = '<tendon><fixed><joint joint="elbow" coef="1"/></fixed></tendon>'
    assert repr(read(ARM, (END, tendon + more))) == repr(read())


# -- what is refused --------------------------------------------------------------------------------------------------


_CONNECT = "<connect name='c' body1='tool' anchor='0 0 0'/>"


def _equality(element, more=""):
    return END, f"<equality>{element}</equality>{more}</mujoco>"


def _rope(attributes):
    sites = '<site site="upper"/><site site="tip"/>'
    return END, f'<tendon><spatial name="r" {attributes}>{sites}</spatial></tendon></mujoco>'


def _tendon(attributes):
    return END, f'<tendon><fixed {attributes}><joint joint="elbow" coef="1"/></fixed></tendon></mujoco>'


def _motor(attributes, n=1):
    motors = f'<motor name="m" joint="elbow" {attributes}/>' + f'<motor joint="elbow" {attributes}/>' * (n - 1)
    return END, f"<actuator>{motors}</actuator></mujoco>"


_BALL = '<joint name="elbow" type="ball" range="0 1"/><joint name="x" type="slide"'
_PAIR = '<tendon><fixed name="t"><joint joint="elbow" coef="2"/><joint joint="slide" coef="-3"/></fixed></tendon>'
_ROD = '<tendon><fixed name="t"><joint joint="elbow" coef="1"/></fixed></tendon>'
_FAR, _ROD_TOO_FAR = _ROD.replace('"1"', '"3e38"'), _ROD.replace('"1"', '"1e39"') + "</mujoco>"
_ROPE = '<spatial name="r"><site site="upper"/><site site="tip"/></spatial></tendon>'
REFUSED = {
    "malformed": ((END, "</mujo"), "malformed XML: .* line 19"),
    "unknown attribute": ((SHOULDER, f'{SHOULDER} dampin="1"'), "MuJoCo says .*'dampin'.*line 7"),
    "nan": (('pos=".5 .25 1"', 'pos=".5 nan 1"'), "line 6: <body>: pos: expected finite numbers, got '.5 nan 1'"),
    "infinite": (('pos=".5 .25 1"', 'pos=".5 INF 1"'), "line 6: <body>: pos: expected finite numbers"),
    "too far": (('pos=".5 .25 1"', 'pos=".5 1e400 1"'), "MuJoCo says .*too large.*'pos'.*line 6"),
    "too far for float32": (('pos=".5 .25 1"', 'pos=".5 1e40 1"'), 'line 6: <body name="upper">: pos: .*3.4e.38'),
    "gravity": (('gravity="0 1 -9.81"', 'gravity="0 nan 0"'), "line 3: <option>: gravity: expected finite"),
    "too much gravity": (('gravity="0 1 -9.81"', 'gravity="0 1e40 0"'), "line 3: <option>: gravity: expected finite"),
    "infinite mass": (('inertial mass="2"', 'inertial mass="inf"'), "line 8: <inertial>: mass: expected finite"),
    "mass of no dtype": (('inertial mass="2"', 'inertial mass="1e39"'), 'line 6: <body name="upper">: mass: .*3.4e.38'),
    "infinite damping": (('damping=".25"', 'damping="inf"'), "line 7: <joint>: damping: expected finite"),
    "nan in a default": (
        ("<worldbody>", '<default><joint damping="nan"/></default><worldbody>'),
        "line 4: <joint>: damping: expected",
    ),
    "nan of a spring": ((SHOULDER, f'{SHOULDER} springref="nan"'), "line 7: <joint>: springref: expected finite"),
    "range": (('range="-1 2"', 'range="nan 2"'), "line 7: <joint>: range: expected finite numbers, got 'nan 2'"),
    "long axis": (('axis="0 0 2"', 'axis="0 0 1e200"'), 'line 7: <joint name="shoulder">: axis: .*unit vector'),
    "no name": (('<body name="fore">', '<body pos="1e40 0 0">'), 'line 10: <body name="body_2">: pos: .*3.4e.38'),
    "negative damping": (('damping=".25"', 'damping="-1"'), 'line 7: <joint name="shoulder">: damping: .*>= 0'),
    "negative friction": (('frictionloss=".125"', 'frictionloss="-1"'), "line 7: <joint .*frictionloss: .*>= 0"),
    "negative spring": ((SHOULDER, f'{SHOULDER} stiffness="-1"'), "line 7: <joint .*stiffness: expected .*>= 0"),
    "negative armature": (('armature=".5"', 'armature="-1"'), "line 7: <joint .*armature: expected .*>= 0"),
    "triangle inequality": (('diaginertia="4 5 6"', 'diaginertia="4 5 9.1"'), "MuJoCo says .*A . B >= C.*line 6"),
    "unknown type": ((SHOULDER, f'{SHOULDER} type="screw"'), "MuJoCo says .*'screw'.*line 7"),
    "missing joint": (_equality('<joint joint1="x"/>'), "MuJoCo says .*'x'.*line 18"),
    "missing file": (
        ("<worldbody>", '<asset><mesh name="q" file="no.stl"/></asset><worldbody><geom type="mesh" mesh="q"/>'),
        "line 4: MuJoCo says .*no.stl",
    ),
    "missing part": (("<worldbody>", '<include file="no.xml"/><worldbody>'), "MuJoCo says .*no.xml.*line 4"),
    "too much data": (("<worldbody>", '<size nuserdata="-2"/><worldbody>'), "line 1: MuJoCo says .*too large"),
    "geared too far": (_motor('gear="1e20" armature="1"'), 'line 18: <motor name="m">: armature: .* got 1 . 1e.20.2'),
    "geared beyond all": (_motor('gear="1e19" damping="9e37"'), 'line 18: <motor name="m">: damping: .*3.4e.38 times'),
    "rotors that add up": (
        _motor('gear="1" armature="3e38"', 2),
        'line 12: <joint name="elbow">: armature: with what drives it .* float32',
    ),
    "stiffness that adds up": (
        (
            END,
            '<equality><joint joint1="elbow" joint2="slide" polycoef="0 1e20"/></equality>'
            '<default><joint stiffness="1"/></default></mujoco>',
        ),
        'line 11: <joint name="slide">: stiffness: with what drives it and follows it beyond',
    ),
    "mimic too far": (
        _equality('<joint joint1="elbow" joint2="slide" polycoef="0 1e39"/>'),
        "line 18: <joint .*polycoef: .*3.4e.38",
    ),
    "flex": (
        ("<worldbody>", '<worldbody>\n<flexcomp name="f" type="grid" count="2 2 1" dim="2"/>'),
        "line 5: <flexcomp>: bodies are rigid",
    ),
    "rubber": (
        (
            "</worldbody>",
            '</worldbody><deformable>\n<flex name="f" dim="1" body="upper fore" element="0 1"/></deformable>',
        ),
        "line 18: <flex>: bodies are rigid",
    ),
    "site too far": (('name="tip"', 'name="tip" pos="1e39 0 0"'), 'line 14: <site name="tip">: pos: .*3.4e.38'),
    "site that is too far with its body": (
        (
            'pos="0 0 1"><inertial mass="2" pos="0 0 0" diaginertia="4 5 6"/><site name="tip"',
            'pos="0 0 3e38"><site name="tip" pos="0 0 3e38"',
        ),
        'line 14: <site name="tip">: frame_placements: with what .* beyond the numbers of float32',
    ),
    "site that is called as a body is, too far with it": (
        (
            'pos="0 0 1"><inertial mass="2" pos="0 0 0" diaginertia="4 5 6"/><site name="tip"',
            'pos="0 0 3e38"><site name="fore" pos="0 0 3e38"',
        ),
        'line 14: <site name="fore">: frame_placements: with what .* beyond the numbers of float32',
    ),
    "site in a frame": (
        ('<site name="tip"/>', '<frame>\n<site pos="1e39 0 0"/></frame>'),
        'line 15: <site name="site_1">: pos: .*3.4e.38',
    ),
    "replicated": (
        (
            "</worldbody>",
            '<replicate count="3">\n<body><joint damping="-1"/><geom size="1"/></body></replicate></worldbody>',
        ),
        'line 18: <joint name="joint_3">: damping: .*>= 0',
    ),
    "a second world": (
        (END, '<worldbody>\n<body><joint damping="-1"/><geom size="1"/></body></worldbody></mujoco>'),
        'line 19: <joint name="joint_3">: damping: .*>= 0',
    ),
    "huge anchor": (_equality(_CONNECT.replace("anchor='0", "anchor='1e39")), 'line 18: <connect name="c">: anchor'),
    "frame of a loop": (
        ("</worldbody>", f'<site name="c/a"/></worldbody><equality>{_CONNECT}</equality>'),
        "name: 'c/a' is made for another",
    ),
    "polynomial": (_equality('<joint joint1="elbow" joint2="slide" polycoef="0 1 2"/>'), "line 18: <joint .*polycoef"),
    "two constraints that cannot both hold": (
        _equality(
            '<joint joint1="elbow" joint2="slide"/><joint name="e" joint1="elbow" joint2="slide" polycoef="1 1"/>'
        ),
        "line 18: <joint name=\"e\">: 'elbow', 'slide' cannot be so: other constraints say otherwise by 1; leave ",
    ),
    "bent spring": (_tendon('stiffness="3 1"'), 'line 18: <fixed name="tendon_0">: stiffness: expected one number'),
    "heavy tendon": (_tendon('name="t" armature="3"'), 'line 18: <fixed name="t">: armature: expected none .*leave it'),
    "infinite spring": (_tendon('stiffness="1e39"'), "line 18: <fixed .*stiffness: .*3.4e.38"),
    "negative spring of a tendon": (_tendon('stiffness="-1"'), "line 18: <fixed .*stiffness: .*>= 0"),
    "heavy rope": (_rope('armature="3"'), 'line 18: <spatial name="r">: armature: expected none here, .*leave it out'),
    "held rope": (
        _equality('<tendon tendon1="t" tendon2="r"/>', _ROD.replace("</tendon>", _ROPE)),
        "line 18: <tendon .*: tendon2: expected fixed tendons, got 'r' along a rope; leave the constraint out, or",
    ),
    "two tendons that are one": (
        _equality('<tendon name="e" tendon1="t" tendon2="s"/>', _PAIR + _PAIR.replace('"t"', '"s"')),
        'line 18: <tendon name="e">: tendon1: expected tendons that move, got joints that cancel; leave it out',
    ),
    "bent tendons": (
        _equality('<tendon tendon1="t" tendon2="s" polycoef="0 0 1"/>', _PAIR + _ROD.replace('"t"', '"s"')),
        "line 18: <tendon .*: polycoef: expected a polynomial of at most first degree",
    ),
    "tendon too far": (_tendon('name="t"')[0:1] + (_ROD_TOO_FAR,), 'line 18: <fixed name="t">: coef: .*3.4e.38'),
    "held too far": (
        _equality('<tendon name="e" tendon1="t" tendon2="s" polycoef="0 9"/>', _FAR + _FAR.replace('"t"', '"s"')),
        'line 18: <tendon name="e">: coefficients and length: .*3.4e.38',
    ),
    "rotor": (
        (END, f'{_ROD}<actuator><motor name="m" tendon="t" armature="1"/></actuator></mujoco>'),
        'line 18: <motor name="m">: armature',
    ),
}


@pytest.mark.parametrize(("change", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(change, message):
    with pytest.raises(ValueError, match="^from_mjcf: ") as error:
        read(ARM, change)
    assert re.search(message, str(error.value)), str(error.value)
    assert re.search(r"\bline \d+\b", str(error.value))
    # What to do: what was expected, or a way out.
    assert re.search("expected|; |MuJoCo says", str(error.value))


# What is left out though it changes the motion: (change, how the warning lists it, the message where it is refused).
MISSED = {
    "air": (('-9.81"', '-9.81" density="1.2"'), {"drag": ("density of the medium",)}, "line 3: <option>: density"),
    "oil": (('-9.81"', '-9.81" viscosity="1"'), {"drag": ("viscosity of the medium",)}, "line 3: <option>: viscosity"),
    "rope": (_rope('range="0 1"'), {"range of a tendon along a rope": ("r",)}, 'line 18: <spatial name="r">: range'),
    "elastic rope": (
        _rope('stiffness="3" damping="1"'),
        {"stiffness of a tendon along a rope": ("r",), "damping of a tendon along a rope": ("r",)},
        'line 18: <spatial name="r">: stiffness: expected none of a rope here',
    ),
    "rubbing tendon": (
        _tendon('frictionloss="2"'), {"frictionloss of a tendon": ("tendon_0",)}, "line 18: <fixed .*frictionloss"
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "unknown", "message"), MISSED.values(), ids=MISSED)
def test_what_is_left_out_and_changes_the_motion_is_listed(change, unknown, message):
    with pytest.warns(ModelFileWarning) as found:
        read(ARM, change)
    assert found[0].message.unknown == unknown
    with pytest.raises(ValueError, match=f"^from_mjcf: {message}"):
        read(ARM, change, strict=True)


def test_tendons_and_balls():
    changes = (ELBOW, _BALL), _tendon('name="t" range="-1 2" stiffness="3" damping="4" springlength="1"')
    changes = changes[0], (END, changes[1][1].replace("elbow", "x").replace("</fixed>", _SECOND))
    mech = read(ARM, *changes)
    (tendon,) = mech.tendons
    assert (tendon.name, tendon.joints) == ("t", ("x", "slide"))
    numbers = tendon.stiffness, tendon.damping, tendon.lower, tendon.upper, *tendon.rest, *tendon.coefficients
    np.testing.assert_array_equal(numbers, [3, 4, -1, 2, 1, 1, 1, -2])
    assert mech.turn_limits[mech.joint_names.index("elbow")] == 1
    assert read(ARM, _tendon("")).tendons == ()


_SECOND = '<joint joint="slide" coef="-2"/></fixed>'


def test_an_equality_of_a_tendon_over_two_joints_is_a_mimic():
    """2 elbow - 3 slide = -3/2 + 1/4, of ref = 1/2 of the slide."""
    mech = read(ARM, _equality('<tendon tendon1="t" polycoef=".25"/>', _PAIR))
    assert (mech.nq, mech.tendons) == (2, ())
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [1, 0], [1.5, -0.625]])


EQUALITIES = {
    "a joint": ('<joint joint1="elbow" polycoef=".25 9 9"/>', "", ["elbow"], [1], 0.25),
    "a joint with a reference": ('<joint joint1="slide" polycoef=".25"/>', "", ["slide"], [1], 0.75),
    "a tendon over one": ('<tendon tendon1="t" polycoef=".25"/>', _ROD, ["elbow"], [1], 0.25),
    "a tendon over three": (
        '<tendon tendon1="t" polycoef=".25 9 9"/>',
        _PAIR.replace("</fixed>", '<joint joint="shoulder" coef="1"/></fixed>'), ["elbow", "slide", "shoulder"],
        [2, -3, 1], -1.25,
    ),
    # (2 elbow - 3 slide) + 3/2 = 1/4 - 4 (elbow + shoulder)
    "two tendons": (
        '<tendon tendon1="t" tendon2="s" polycoef=".25 -4"/>',
        _PAIR + _ROD.replace("</fixed>", '<joint joint="shoulder" coef="1"/></fixed>').replace('"t"', '"s"'),
        ["elbow", "slide", "shoulder"], [6, -3, 4], -1.25,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", EQUALITIES)
def test_an_equality_that_is_no_mimic_is_a_tendon_of_one_length(name):
    element, tendons, joints, c, length = EQUALITIES[name]
    element = element.replace(" ", ' name="e" ', 1)
    with pytest.warns(ModelFileWarning, match=r"equality read as a tendon of one length, .* \(1: e\)"):
        mech = read(ARM, _equality(element, tendons), strict=True)
    (held,) = mech.tendons
    assert (mech.nq, held.name, held.joints) == (3, "e", tuple(joints))
    np.testing.assert_array_equal(held.coefficients, c)
    np.testing.assert_array_equal([held.lower, held.upper, held.offset], [length, length, 0])


_SHOULDER = '<joint name="{}" joint1="{}" joint2="{}" polycoef="{}"/>'
# Constraints of two joints of which the first follows another already: (constraints, mimics of all joints, tendons).
SOLVED = {
    "twice": ((("a", "elbow", "slide", ".5 2"),) * 2, {"elbow": ("slide", 2, -0.5)}, 0),
    "turned round": (
        (("a", "elbow", "slide", ".5 2"), ("b", "slide", "elbow", "-.25 .5")), {"elbow": ("slide", 2, -0.5)}, 0
    ),
    "two that it follows": (
        (("a", "elbow", "slide", "0 2"), ("b", "elbow", "shoulder", "0 3")),
        {"elbow": ("shoulder", 3, 0), "slide": ("shoulder", 1.5, 0.5)}, 0,
    ),
    "ring that leaves one place": (
        (("a", "elbow", "slide", "0 2"), ("b", "slide", "elbow", "0 1")), {"elbow": ("slide", 2, -1)}, 1
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SOLVED)
def test_constraints_of_joints_that_follow_others_are_solved(name, recwarn):
    """At any coordinates MuJoCo finds its constraints kept, but those that tendons have yet to hold."""
    constraints, mimics, held = SOLVED[name]
    names = [f"{x[0]}{k}" for k, x in enumerate(constraints)]
    texts = [_SHOULDER.format(own, *x[1:]) for own, x in zip(names, constraints, strict=True)]
    change = _equality("".join(texts))
    mech = read(ARM, change, dtype=np.float64)
    for joint, (leader, a, b) in mimics.items():
        i, k = (mech.joint_names.index(x) for x in (joint, leader))
        assert mech.topology.followed[i] == k
        np.testing.assert_allclose(mech.mimics[i], [a, b], rtol=0, atol=1e-15)
    assert len(mech.tendons) == held
    model = mujoco.MjModel.from_xml_string(changed(ARM, change))
    data = mujoco.MjData(model)
    q = {x: 0.375 for x in mech.joint_names if x not in mimics}
    for joint, (a, b), k in zip(mech.joint_names, mech.mimics, mech.topology.followed, strict=True):
        data.joint(joint).qpos[:] = a * q[mech.joint_names[k]] + b
    mujoco.mj_forward(model, data)
    of_equalities = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    residuals = data.efc_pos[of_equalities]
    assert (abs(residuals) > 1e-12).sum() == held
    with_tendon = [x.message.doubtful for x in recwarn if x.category is ModelFileWarning and x.message.doubtful]
    assert len(with_tendon) == held


def test_an_equality_of_two_tendons_over_two_joints_is_a_mimic():
    """2 elbow - 3 slide + 3/2 = -3 (slide - 1/2)."""
    slide = _ROD.replace("elbow", "slide").replace('"t"', '"s"').replace('"1"', '"3"')
    mech = read(ARM, _equality('<tendon tendon1="t" tendon2="s" polycoef="1 -2"/>', _PAIR + slide))
    assert mech.tendons == ()
    # 2 elbow - 3 slide + 3/2 = 1 - 2 (3 slide - 3/2)
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [1, 0], [-1.5, 1.25]])


def test_gravity_that_is_compensated():
    mech = read(ARM, ('name="fore"', 'name="fore" gravcomp=".5"'), ('name="tool"', 'name="tool" gravcomp="1"'))
    np.testing.assert_array_equal(mech.lifts.mass, [0, 0, 3])
    # About the elbow, a metre below: of 1 kg at (1, 2, 4) and of 2 kg at (0, 0, 2).
    np.testing.assert_allclose(mech.lifts.com[2], np.float32([1, 2, 8]) / 3, rtol=2e-7)
    assert not mech.lifts.central.any() or abs(mech.lifts.central[:2]).max() == 0
    np.testing.assert_array_equal(mech.inertias.mass, read().inertias.mass)
    assert read().lifts is None


MESH = (
    '<mujoco><asset><mesh name="a" file="a.obj"/></asset><worldbody><body name="b"><freejoint/>BODY</body></worldbody>'
)
MESH = MESH.replace("BODY", '<geom type="mesh" mesh="a"/>') + "</mujoco>"
ASSETS = {"a.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"}


def test_meshes_in_a_dict_models_and_specs(tmp_path):
    mech = js.Mechanism.from_mjcf(MESH, assets=ASSETS)
    np.testing.assert_allclose(mech.inertias.mass, 1000 / 6, rtol=1e-6)
    sources = [mujoco.MjModel.from_xml_string(MESH, ASSETS), mujoco.MjSpec.from_string(MESH, assets=ASSETS)]
    for other in map(js.Mechanism.from_mjcf, sources):
        assert all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(mech), jax.tree.leaves(other), strict=True))
    (tmp_path / "part.xml").write_text(MESH)
    path = tmp_path / "whole.xml"
    path.write_text('<mujoco><include file="part.xml"/></mujoco>')
    assert js.Mechanism.from_mjcf(path, assets=ASSETS).body_names == ("b",)
    with pytest.raises(ValueError, match=r"^from_mjcf: line 1: MuJoCo says .*a.obj.*; mend the model$"):
        js.Mechanism.from_mjcf(MESH)
    with pytest.raises(TypeError, match="^from_mjcf: path_or_text: expected a path or text, got dict"):
        js.Mechanism.from_mjcf(ASSETS)


def test_models_and_specs_have_no_lines_of_a_file():
    spec = mujoco.MjSpec.from_string(alone('<joint name="j"/><geom size="1"/>'))
    spec.joint("j").damping = [-1.0, 0, 0]
    with pytest.raises(ValueError, match=r'^from_mjcf: line \d+ of MjSpec.to_xml\(\): <joint name="j">: damping: '):
        js.Mechanism.from_mjcf(spec)
    with pytest.raises(
        ValueError, match='^from_mjcf: line 1 of no text: an MjModel has none: .*<joint name="j">: damping'
    ):
        js.Mechanism.from_mjcf(spec.compile())


def test_names_that_are_made_for_others():
    with pytest.raises(ValueError, match="^from_mjcf: line 11: <joint>: name: 'joint_2' is made for another here"):
        read(ARM, ('name="slide"', 'name="joint_2"'), (' name="elbow"', ""))
    with pytest.raises(ValueError, match="^from_mjcf: line 9: <site>: name: 'fore/slide' is made for another here"):
        read(ARM, ('<site name="upper"', '<site name="fore/slide"'))


PART = """<mujoco>
  <option density="1"/>
  <worldbody>
    <body><joint damping="-1"/><geom size="1"/></body>
  </worldbody>
</mujoco>"""


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (PART.replace("density", "gravity").replace('"1"', '"1e40 0 0"'), "line 2 of part.xml: <option>: gravity: "),
        (PART.replace(' density="1"', ""), 'line 4 of part.xml: <joint name="joint_3">: damping: .*>= 0'),
        (PART.replace("-1", "nan"), "line 4 of part.xml: <joint>: damping: expected finite"),
        (PART.replace(' density="1"', "").replace("-1", "1e39"), "line 4 of part.xml: <joint .*>: damping: .*3.4e.38"),
    ],
)
def test_what_is_included_has_its_line(tmp_path, part, message):
    path = tmp_path / "arm.xml"
    (tmp_path / "part.xml").write_text(part)
    path.write_text(changed(ARM, (END, '<include file="part.xml"/></mujoco>')))
    with pytest.raises(ValueError, match=f"^from_mjcf: {message}"):
        js.Mechanism.from_mjcf(path)


ATTACHED = {
    "joint": (
        ('<body><joint damping="-1"/>', '<body name="more"><joint damping="-1"/>'),
        '<joint name="joint_1">: damping',
    ),
    "body": (('<body><joint damping="-1"/>', '<body name="more" pos="1e40 0 0">'), '<body name="pmore">: pos'),
}


@pytest.mark.parametrize(("change", "message"), ATTACHED.values(), ids=ATTACHED)
def test_what_is_attached_has_the_line_of_what_holds_it(tmp_path, change, message):
    """Which is not in the text itself."""
    path = tmp_path / "arm.xml"
    (tmp_path / "part.xml").write_text(changed(PART, (' density="1"', ""), change))
    attached = (
        '<body name="tip"><geom size="1"/>\n<attach model="p" body="more" prefix="p"/></body>\n<body name="fore">'
    )
    model = '<asset><model name="p" file="part.xml"/></asset><worldbody>'
    path.write_text(changed(ARM, ("<worldbody>", model), ('<body name="fore">', attached)))
    with pytest.raises(ValueError, match=f"^from_mjcf: line 10: in <body>: {message}: "):
        js.Mechanism.from_mjcf(path)


def test_numbers_of_a_free_joint():
    """MuJoCo has the linear velocities first, along the axes of the world: what differs there has no place here."""
    model = mujoco.MjModel.from_xml_string(alone('<joint name="f" type="free" armature=".75"/><geom size="1"/>'))
    model.dof_armature[3:] = 1, 2, 3
    model.dof_damping[:] = 4, 4, 4, 5, 6, 7
    mech = js.Mechanism.from_mjcf(model)
    np.testing.assert_array_equal(mech.armature, [1, 2, 3, 0.75, 0.75, 0.75])
    np.testing.assert_array_equal(mech.damping, [5, 6, 7, 4, 4, 4])
    # Numbers of each axis, or friction, are those of slides along the axes of the world and a ball.
    for name, field in (("armature", "armature"), ("damping", "damping"), ("frictionloss", "friction_loss")):
        changed_model = copy.copy(model)
        getattr(changed_model, f"dof_{name}")[:] = 9, 8, 7, 6, 5, 4
        mech = js.Mechanism.from_mjcf(changed_model)
        assert mech.topology.kinds == ("prismatic",) * 3 + ("ball",)
        np.testing.assert_array_equal(getattr(mech, field), [9, 8, 7, 6, 5, 4])


RUBBING = alone('<joint name="f" type="free" frictionloss="1" stiffness="2"/><geom size="1"/>').replace(
    "<body>", '<body name="a" pos="1 2 3" quat="0 1 0 0">'
)


def test_a_free_joint_that_rubs():
    """Is slides and a ball, also where all is refused that is left out; one whose friction is switched off is free."""
    for source in (RUBBING, mujoco.MjModel.from_xml_string(RUBBING), mujoco.MjSpec.from_string(RUBBING)):
        with pytest.warns(ModelFileWarning) as found:
            mech = js.Mechanism.from_mjcf(source, strict=True)
        read_as = "free joint read as slides NAME/x, NAME/y, NAME/z and a ball NAME/ball"
        assert str(found[0].message) == f"from_mjcf: {read_as} (1: f)"
        assert (found[0].message.doubtful, found[0].message.unknown) == ({read_as: ("f",)}, {})
        assert mech.joint_names == ("f/x", "f/y", "f/z", "f/ball")
        assert mech.body_names == ("a/f/x", "a/f/y", "a/f/z", "a")
        np.testing.assert_array_equal(mech.axes[:3], np.eye(3))
        np.testing.assert_array_equal(mech.friction_loss, [1] * 6)
        np.testing.assert_array_equal(mech.stiffness, [2] * 6)
        np.testing.assert_array_equal(mech.spring_references, [1, 2, 3, 0, 1, 0, 0])
    key = '<keyframe><key name="k" qpos="3 2 1 0 0 1 0" qvel="1 2 3 4 5 6"/></keyframe></mujoco>'
    frame = js.interop.mujoco.key_frames(mech, RUBBING.replace(END, key))["k"]
    np.testing.assert_array_equal(frame.q, [3, 2, 1, 0, 0, 1, 0])
    np.testing.assert_array_equal(frame.v, [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(js.interop.mujoco.to_qpos(mech, frame.q), frame.q)
    np.testing.assert_array_equal(mech.configuration({"f/ball": frame.q[3:], "f/z": 1.0})[2:], frame.q[2:])
    with pytest.raises(KeyError, match="expected one of 'f/x', 'f/y', 'f/z', 'f/ball', got 'f'"):
        mech.configuration({"f": frame.q})
    off = RUBBING.replace("<worldbody>", '<option><flag frictionloss="disable"/></option><worldbody>')
    assert js.Mechanism.from_mjcf(off).topology.kinds == ("free",)


def test_what_is_made_of_a_free_joint_has_the_line_of_what_it_was():
    """Bodies between the slides are those of the body, slides those of the joint."""
    heavy = RUBBING.replace('<geom size="1"/>', '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')
    with pytest.raises(ValueError, match='^from_mjcf: line 1: <body name="a">: inertia: .* at most .* float32'):
        js.Mechanism.from_mjcf(heavy.replace('mass="1"', 'mass="3e37"').replace('pos="0 0 0"', 'pos="0 0 9"'))
    with pytest.raises(ValueError, match="^from_mjcf: line 1: <joint>: name: 'f/x' is made for another here"):
        js.Mechanism.from_mjcf(RUBBING.replace("</body>", '<body><joint name="f/x"/><geom size="1"/></body></body>'))


@pytest.mark.parametrize("package", ["mujoco", "lxml"])
def test_without_the_package(monkeypatch, package):
    for name in [name for name in __import__("sys").modules if name.split(".")[0] == package]:
        monkeypatch.setitem(__import__("sys").modules, name, None)
    with pytest.raises(ImportError, match=rf"from_mjcf: needs the package {package}: .*pip install .*models"):
        read()


def test_springs_that_are_not_linear():
    """Of MuJoCo from version 4."""
    for attribute, reason in (("stiffness", "expected one number"), ("springyield", "stay elastic")):
        numbers = "2 1" if attribute == "stiffness" else "1"
        try:
            mujoco.MjModel.from_xml_string(changed(ARM, (SHOULDER, f'{SHOULDER} {attribute}="{numbers}"')))
        except ValueError:
            continue
        with pytest.raises(ValueError, match=f'line 7: <joint name="shoulder">: {attribute}: .*{reason}'):
            read(ARM, (SHOULDER, f'{SHOULDER} {attribute}="{numbers}"'))


def test_sums_beyond_the_dtype_are_refused():
    with pytest.raises(ValueError, match='^from_mjcf: line 10: <body name="fore">: inertia: .* at most .* float32'):
        read(ARM, *[('inertial mass="2"', 'inertial mass="2e37"')] * 3)


@pytest.mark.parametrize("text", ["", " \n ", "mujoco\n" * 50])
def test_what_is_neither_path_nor_text(text):
    with pytest.raises(ValueError, match="^from_mjcf: path_or_text: expected a path"):
        js.Mechanism.from_mjcf(text)


def test_what_comes_before_the_text_does_no_harm(tmp_path):
    expected, path = repr(read()), tmp_path / "arm.xml"
    path.write_text("\ufeff" + ARM, encoding="utf-8")
    for source in ("\ufeff" + ARM, path, f'\n <?xml version="1.0" encoding="latin-1"?>{ARM}', "\ufeff\n\n" + ARM):
        assert repr(js.Mechanism.from_mjcf(source)) == expected


# What MuJoCo reads though it is no XML.
MENDED = {
    "comment in Latin-1": (b"<worldbody>", b"<worldbody><!-- \xe9 -->"),
    "two models": (b"</mujoco>", b"</mujoco>\n<mujoco/>"),
    "ampersand": (b'model="arm"', b'model="arm & hand"'),
    "no blank": (b'name="shoulder" axis', b'name="shoulder"axis'),
    "what a tool said": (b"<mujoco", b"done\n<mujoco"),
}


@pytest.mark.parametrize("change", MENDED.values(), ids=MENDED)
def test_what_mujoco_reads_is_read(change, tmp_path):
    path, later = tmp_path / "arm.xml", tmp_path / "later.xml"
    path.write_bytes(ARM.encode().replace(*change, 1))
    assert repr(js.Mechanism.from_mjcf(path)) == repr(read())
    # Lines are those of the text.
    later.write_bytes(path.read_bytes().replace(b'damping=".25"', b'damping="-1"'))
    line = 8 if change[1].startswith(b"done") else 7
    with pytest.raises(ValueError, match=f'^from_mjcf: line {line}: <joint name="shoulder">: damping'):
        js.Mechanism.from_mjcf(later)


ENCODINGS = {
    "utf-16": "line 1: expected text in UTF-8, got UTF-16; save it as UTF-8",
    "latin-1": "line 7: expected names in UTF-8, got the byte 0xe9; save the text as UTF-8",
}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_text_that_is_no_utf_8_is_refused(encoding, tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.replace("shoulder", "\xe9paule"), encoding=encoding)
    with pytest.raises(ValueError, match=f"^from_mjcf: {ENCODINGS[encoding]}"):
        js.Mechanism.from_mjcf(path)


# -- what is left out -------------------------------------------------------------------------------------------------

CONTROL = """<tendon><fixed name="rope"><joint joint="elbow" coef="1"/></fixed></tendon>
<actuator><motor name="m" joint="elbow"/><position joint="slide"/></actuator>
<sensor><jointpos name="s" joint="elbow"/></sensor><keyframe><key name="k" qpos="0 0 0"/></keyframe>
<contact><exclude name="x" body1="upper" body2="fore"/></contact>
<equality><joint name="e" active="false" joint1="elbow"/></equality></mujoco>"""


def test_what_is_left_out_is_listed_once():
    """Beside what may change the motion, of which the warning speaks."""
    options = ('gravity="0 1 -9.81"/>', 'gravity="0 1 -9.81" timestep="1e-3"><flag contact="disable"/></option>')
    asymmetric = ('actuatorfrcrange="-3 3"', 'actuatorfrcrange="-3 2" solreflimit=".1 1" margin="1" range="0 1"')
    follows = ('<joint name="e"', '<joint joint1="elbow" joint2="slide"/><joint name="e"')
    with pytest.warns(ModelFileWarning) as found:
        js.Mechanism.from_mjcf(changed(ARM, (END, CONTROL), options, asymmetric, follows))
    assert len(found) == 1 and found[0].filename == __file__
    assert str(found[0].message) == "from_mjcf: left out: range of a mimic (1)"
    assert found[0].message.left_out == {
        "range of a mimic": ("elbow",),
        "geom": ("geom_0",), "exclude": ("x",), "actuator": ("m", "actuator_1"), "sensor": ("s",), "keyframe": ("k",),
        "tendon": ("rope",), "constraint that is not active": ("e",), "option": ("timestep", "contact switched off"),
        "margin": ("elbow",), "solreflimit": ("elbow",), "side of actuatorfrcrange that is nearer to 0": ("elbow",),
    }  # fmt: skip


def test_plugins_and_actuators_with_several_controls_are_left_out():
    """Those of MuJoCo's package and those that this version has."""
    sensor = (
        '<sensor><plugin name="s" plugin="mujoco.sensor.touch_grid" objtype="site" objname="tip"><config key="size" '
    )
    sensor += 'value="7 7"/><config key="fov" value="45 45"/></plugin></sensor>'
    pid = '<actuator><plugin joint="slide" plugin="mujoco.pid"><config key="kp" value="1"/></plugin></actuator>'
    motor = '<actuator><dcmotor name="d" joint="slide" motorconst="1" resistance="1" input="pos vel" '
    motor += 'controller="0 0 5"/></actuator>'
    extension = '<extension><plugin plugin="mujoco.sensor.touch_grid"/><plugin plugin="mujoco.pid"/></extension><option'
    read_some = 0
    for part, before in ((sensor, extension), (pid, extension), (motor, "<option")):
        text = changed(ARM, (END, f"{part}{END}"), ("<option", before))
        try:
            mujoco.MjModel.from_xml_string(text)
        except ValueError:  # of an older version
            continue
        assert repr(js.Mechanism.from_mjcf(text)) == repr(read())
        read_some += 1
        if "actuator" in part:
            with pytest.warns(ModelFileWarning) as said:
                assert not js.Actuators.from_mjcf(read(), text).names
            assert said[0].message.unknown
    assert read_some


def test_nothing_is_said_of_shapes_and_control(recwarn):
    read(ARM, (END, CONTROL))
    assert not recwarn


def test_numbers_of_a_file_are_known_while_tracing():
    assert_known_while_tracing(read)
