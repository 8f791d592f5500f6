"""URDF: what is read of it, as a file and as text, and what is refused, with its line."""

import importlib.metadata
import pathlib
import re

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import ModelFileWarning
from tests.helpers.optional import needs
from tests.helpers.tracing import assert_known_while_tracing

INERTIAL = """<inertial><origin xyz="1 2 3"/><mass value="2"/>
  <inertia ixx="4" iyy="5" izz="6" ixy=".1" ixz=".2" iyz=".3"/></inertial>"""
ARM = f"""<robot name="arm">
  <!-- two links that move, one that is welded -->
  <material name="grey"/>
  <link name="base"><visual><geometry><sphere radius="1"/></geometry></visual></link>
  <link name="upper">{INERTIAL}</link>
  <link name="fore">{INERTIAL}</link>
  <link name="tool">{INERTIAL}</link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz=".1 .2 .3" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 2"/>
    <limit lower="-1" upper="2" effort="3" velocity="4"/><dynamics damping=".5" friction=".25"/>
  </joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/></joint>
  <joint name="grip" type="fixed"><parent link="fore"/><child link="tool"/><origin xyz="0 0 1"/></joint>
  <transmission name="drive"/>
</robot>
"""


# What they leave out is said, and is the subject of tests of its own.
pytestmark = pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")


def changed(text, *changes):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def read(text=ARM, *changes, **options):
    return js.Mechanism.from_urdf(changed(text, *changes), **options)


# -- what is read -----------------------------------------------------------------------------------------------------


def test_tree():
    mech = read()
    assert (mech.body_names, mech.joint_names) == (("upper", "fore"), ("shoulder", "elbow"))
    assert (mech.nq, mech.nv, mech.dtype) == (2, 2, np.float32)
    assert mech.frame_names == ("world", "base", "upper", "fore", "tool")
    assert dict(mech.topology.frames) == {"world": -1, "base": -1, "upper": 0, "fore": 1, "tool": 1}


def test_numbers(x64):
    mech = read()
    assert mech.dtype == (np.float64 if x64 else np.float32)
    np.testing.assert_array_equal(mech.placements.translation, np.asarray([[0.1, 0.2, 0.3], [0, 0, 0]], mech.dtype))
    # A quarter turn is exact, whatever the six digits of pi that a file has.
    np.testing.assert_array_equal(mech.placements.rotation.entries[0], [0, -1, 0, 1, 0, 0, 0, 0, 1])
    np.testing.assert_array_equal(mech.axes, [[0, 0, 1], [1, 0, 0]])
    for name, expected in {
        "lower": [-1, -np.inf],
        "upper": [2, np.inf],
        "effort_limit": [3, np.inf],
        "velocity_limit": [4, np.inf],
        "damping": [0.5, 0],
        "friction_loss": [0.25, 0],
        "armature": [0, 0],
        "gravity": [0, 0, np.asarray(-9.81, mech.dtype)],
    }.items():
        np.testing.assert_array_equal(getattr(mech, name), expected, err_msg=name)
    np.testing.assert_array_equal(mech.inertias.mass, [2, 4])
    np.testing.assert_array_equal(mech.inertias.com, [[1, 2, 3], [1, 2, 3.5]])
    central = np.asarray([4, 0.1, 5, 0.2, 0.3, 6], mech.dtype)
    np.testing.assert_array_equal(mech.inertias.central[0], central)
    # Twice the same, one above the other at a distance of 1: reduced mass 1.
    np.testing.assert_allclose(
        mech.inertias.central[1], 2 * central + [1, 0, 1, 0, 0, 0], rtol=4 * np.finfo(mech.dtype).eps
    )


def test_inertia_is_turned_by_its_origin():
    mech = read(ARM, ('<origin xyz="1 2 3"/>', '<origin xyz="1 2 3" rpy="1.5707963267948966 0 0"/>'))
    # y to z, z to -y
    expected = np.float32([4, -0.2, 6, 0.1, -0.3, 5])
    np.testing.assert_array_equal(mech.inertias.central[0], expected)


def test_file_and_path_are_as_the_text(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    texts = [repr(js.Mechanism.from_urdf(source)) for source in (ARM, str(path), pathlib.Path(path), "\n" + ARM)]
    assert len(set(texts)) == 1
    declared = '<?xml version="1.0" encoding="utf-8"?>' + ARM
    assert repr(js.Mechanism.from_urdf(declared)) == texts[0]
    with pytest.raises(FileNotFoundError):
        js.Mechanism.from_urdf(str(tmp_path / "other.urdf"))
    with pytest.raises(TypeError, match="from_urdf: path_or_text: expected a path or text, got int"):
        js.Mechanism.from_urdf(3)


def test_floating_base():
    mech = read(floating_base=True, gravity=(0.0, 0.0, -1.5))
    assert mech.body_names == ("base", "upper", "fore")
    assert mech.joint_names == ("root_joint", "shoulder", "elbow")
    assert (mech.nq, mech.nv) == (9, 8)
    np.testing.assert_array_equal(mech.gravity, [0, 0, -1.5])
    np.testing.assert_array_equal(mech.neutral(), [1, *[0] * 8])


def test_a_root_named_world_is_the_world():
    changes = ('<link name="base">', '<link name="world">'), ('<parent link="base"/>', '<parent link="world"/>')
    mech = read(ARM, *changes)
    assert (mech.nq, mech.frame_names) == (2, ("world", "upper", "fore", "tool"))
    with pytest.raises(ValueError, match="floating_base.*cannot float"):
        read(ARM, *changes, floating_base=True)


MIMIC = ('<child link="fore"/>', '<child link="fore"/><mimic joint="shoulder" multiplier="-2" offset=".5"/>')


def test_mimic():
    mech = read(ARM, MIMIC)
    assert (mech.nq, mech.nv) == (1, 1)
    np.testing.assert_array_equal(mech.joint_position_indices("elbow"), [0])
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [-2, 0.5]])
    mech = read(ARM, (MIMIC[0], '<child link="fore"/><mimic joint="shoulder"/>'))
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [1, 0]])


def test_a_fixed_joint_follows_nothing():
    """What robots have whose grippers were made rigid: the mimics are fixed, as is the joint they followed."""
    fixed = ('type="continuous"', 'type="fixed"')
    expected = repr(read(ARM, fixed))
    assert repr(read(ARM, fixed, MIMIC)) == expected
    assert repr(read(ARM, fixed, (MIMIC[0], MIMIC[1].replace("shoulder", "grip")))) == expected


@pytest.mark.parametrize(
    ("kind", "ours", "nq"),
    [("prismatic", "prismatic", 1), ("floating", "free", 7), ("planar", "planar", 3), ("spherical", "ball", 4)],
)
def test_other_joints(kind, ours, nq):
    mech = read(ARM, ('type="continuous"><', f'type="{kind}"><axis xyz="0 0 1"/><'))
    assert (mech.topology.kinds[1], mech.nq) == (ours, 1 + nq)


def test_a_joint_of_the_file_may_be_called_root_joint():
    assert read(ARM, ('"elbow"', '"root_joint"')).joint_names == ("shoulder", "root_joint")
    with pytest.raises(ValueError, match='line 15: <joint name="root_joint">: name'):
        read(ARM, ('"elbow"', '"root_joint"'), floating_base=True)


# -- what is refused --------------------------------------------------------------------------------------------------

ELBOW = '<joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/></joint>'


def _far(parent, child):
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="3e38 0 0"/>'
    return f'<link name="{child}"/><joint name="{child}" type="fixed">{ends}</joint>'


_LOOP = '<joint name="loop" type="fixed"><parent link="fore"/><child link="base"/></joint>'
_WORLD = '<link name="world"/>' + _LOOP.replace('"base"', '"world"')
REFUSED = {
    "malformed": (("</robot>", "</robo"), "malformed XML: .*line 1[89]"),
    "other format": (('<robot name="arm">', "<mujoco>"), "malformed XML"),
    "unknown type": (('"continuous"', '"screw"'), "line 15: <joint name=\"elbow\">: type: expected one of .*'screw'"),
    "no type": ((' type="continuous"', ""), 'line 15: <joint name="elbow">: type: expected one of .*None'),
    "misspelt kind": (('"continuous"', '"continous"'), "line 15: .*got 'continous'; did you mean 'continuous'[?]$"),
    "misspelt link": (
        ('<parent link="upper"/>', '<parent link="uper"/>'), "line 15: .*no link 'uper'; did you mean 'upper'[?]$"
    ),
    "misspelt mimic": (
        (MIMIC[0], MIMIC[1].replace("shoulder", "shuolder")), "line 15: .*'shuolder'; did you mean 'shoulder'[?]$"
    ),
    "no name": (('name="elbow" ', ""), "line 15: <joint>: name: expected one"),
    "name twice": (('"elbow"', '"shoulder"'), "line 15: <joint>: name: 'shoulder' comes twice"),
    "link twice": (('<link name="fore"', '<link name="upper"'), "line 7: <link>: name: 'upper' comes twice"),
    "no parent": (('<parent link="upper"/>', ""), 'line 15: <joint name="elbow">: parent: expected a link'),
    "no child": (('<child link="fore"/>', "<child/>"), 'line 15: <joint name="elbow">: child: expected a link'),
    "missing parent": (('<parent link="upper"/>', '<parent link="x"/>'), "line 15: .*parent: there is no link 'x'"),
    "missing child": (('<child link="fore"/>', '<child link="x"/>'), "line 15: .*child: there is no link 'x'"),
    "loop": (("</robot>", f"{_LOOP}</robot>"), 'line 1[1-8]: <joint .*hold each other: a loop'),
    "detached loop": (
        ("</robot>", '<link name="x"/><link name="y"/>' + _LOOP.replace("fore", "x").replace('"base"', '"y"') +
         _LOOP.replace("loop", "pool").replace("fore", "y").replace('"base"', '"x"') + "</robot>"),
        "line 18: <joint .*'[xy]', '[xy]' hold each other: a loop",
    ),
    "held twice": (("</robot>", _LOOP.replace('"base"', '"tool"') + "</robot>"), "line 18: .*'tool' hangs on 'grip'"),
    "two roots": ((ELBOW, ""), "line 1: <robot>: expected one link .*'base', 'fore'"),
    "world held": (("</robot>", _WORLD + "</robot>"), "line 18: .*child: the world hangs on nothing"),
    "no axis": (('<axis xyz="0 0 2"/>', '<axis xyz="0 0 0"/>'), "line 11: .*axis: expected .*not all zero"),
    "short axis": (('xyz="0 0 2"', 'xyz="0 2"'), "line 12: <axis>: xyz: expected 3 numbers, got '0 2'"),
    "not a number": (('xyz="0 0 1"', 'xyz="0 0 x"'), "line 16: <origin>: xyz: expected 3 numbers, got '0 0 x'"),
    "nan": (('rpy="0 0 1.5707963267948966"', 'rpy="0 0 nan"'), "line 12: <origin>: rpy: expected 3 numbers"),
    "mimic of nothing": ((MIMIC[0], MIMIC[1].replace("shoulder", "x")), "line 15: .*mimic: there is no joint 'x'"),
    "mimic of itself": ((MIMIC[0], MIMIC[1].replace("shoulder", "elbow")), "line 15: .*mimic: expected .*'elbow'"),
    "mimic of a weld": ((MIMIC[0], MIMIC[1].replace("shoulder", "grip")), "line 15: .*mimic: expected .*'grip'"),
    "negative mass": (('value="2"', 'value="-2"'), "line 5: <mass>: value: expected a number >= 0, got '-2'"),
    "negative damping": (('damping=".5"', 'damping="-.5"'), "line 13: <dynamics>: damping: expected a number >= 0"),
    "negative friction": (('friction=".25"', 'friction="-1"'), "line 13: <dynamics>: friction: expected a number >= 0"),
    "heavier than float32": (('value="2"', 'value="1e39"'), "line 5: <mass>: value: expected at most 3.4e.38 in this"),
    "lighter than float32": (('value="2"', 'value="1e-39"'), "line 5: <mass>: value: expected at least 1.18e-38"),
    "infinite mass": (('value="2"', 'value="inf"'), "line 5: <mass>: value: expected 1 number, got 'inf'"),
    "infinite moment": (('iyy="5"', 'iyy="1e400"'), "line 6: <inertia>: iyy: expected at most .* got '1e400'"),
    "infinitely far": (('xyz="0 0 1"', 'xyz="0 inf 1"'), "line 16: <origin>: xyz: expected 3 numbers, got '0 inf 1'"),
    "too far": (('xyz="0 0 1"', 'xyz="0 1e400 1"'), "line 16: <origin>: xyz: expected at most 3.4e.38"),
    "infinite damping": (('damping=".5"', 'damping="inf"'), "line 13: <dynamics>: damping: expected 1 number"),
    "infinite multiplier": ((MIMIC[0], MIMIC[1].replace('"-2"', '"inf"')), "line 15: <mimic>: multiplier: expected 1"),
    "infinite lower limit": (('lower="-1"', 'lower="inf"'), "line 11: .*limit: expected lower <= upper"),
    "limit beyond all": (('lower="-1"', 'lower="-1e400"'), "line 13: <limit>: lower: expected at most"),
    "decimal comma": (('value="2"', 'value="2,5"'), "line 5: <mass>: value: expected 1 number, got '2,5'; numbers"),
    "decimal commas": (
        ('xyz="0 0 1"', 'xyz="0,5 0 1"'), "line 16: <origin>: xyz: expected 3 numbers, got '0,5 0 1'; numbers"
    ),
    "commas that may be decimal": (('xyz="0 0 1"', 'xyz="0,5 1,5 1"'), "line 16: <origin>: xyz: expected 3 numbers"),
    "unit": (('lower="-1"', 'lower="-1rad"'), "line 13: <limit>: lower: expected 1 number, got '-1rad'"),
    "empty axis": (('xyz="0 0 2"', 'xyz=""'), "line 12: <axis>: xyz: expected 3 numbers, got ''"),
    "multiplier of a mimic whose square is too large": (
        (MIMIC[0], MIMIC[1].replace("-2", "1e38") + '<dynamics damping="9e30"/>'),
        'line 11: <joint name="shoulder">: damping: with what .* beyond the numbers of float32',
    ),
    "underscore": (('value="2"', 'value="1_0"'), "line 5: <mass>: value: expected 1 number, got '1_0'"),
    "other digits": (('value="2"', 'value="\u0663"'), "line 5: <mass>: value: expected 1 number"),
    "wide digits": (('xyz="0 0 1"', 'xyz="0 0 \uff11"'), "line 16: <origin>: xyz: expected 3 numbers"),
    "hexadecimal": (('value="2"', 'value="0x2"'), "line 5: <mass>: value: expected 1 number, got '0x2'"),
    "empty number": (('value="2"', 'value=""'), "line 5: <mass>: value: expected 1 number, got ''"),
    "no value": (('value="2"', ""), "line 5: <mass>: value: expected 1 number"),
    "no moment": (('iyy="5"', ""), "line 6: <inertia>: iyy: expected 1 number"),
    "no numbers": (
        ('<inertia ixx="4" iyy="5" izz="6" ixy=".1" ixz=".2" iyz=".3"/>', "<inertia/>"),
        "line 6: <inertia>: ixx: expected 1 number",
    ),
    "axis without numbers": (('<axis xyz="0 0 2"/>', "<axis/>"), "line 12: <axis>: xyz: expected 3 numbers"),
    "frame too far": (
        ("</robot>", _far("tool", "x") + "\n" + _far("x", "y") + "</robot>"),
        'line 19: <link name="y">: frame_placements: with what .* beyond the numbers of float32',
    ),
    "damping that adds up": (
        (MIMIC[0], MIMIC[1].replace("-2", "1e20") + '<dynamics damping="9"/>'),
        'line 11: <joint name="shoulder">: damping: with what .* beyond the numbers of float32',
    ),
    "text for xacro": (
        ('name="tool">', 'name="tool"><xacro:x/><xacro:include filename="x"/>'), "line 9: <xacro:x>: .*run it first"
    ),
    "declared xacro": (
        ('<robot name="arm">', '<robot name="arm" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro/>'),
        "line 1: <xacro:macro>: .*run it first",
    ),
    "number for xacro": (('xyz="0 0 1"', 'xyz="0 0 $(arg z)"'), "line 16: <origin>: xyz: .*xacro: run it first"),
    "misspelt axis": (('<axis xyz=', '<axis xyz_='), "line 12: <axis>: xyz: expected 3 numbers"),
    "misspelt type": (('type="continuous"', 'typ="continuous"'), "line 15: <joint .*: type: expected one of .*None"),
    "spring": ((MIMIC[0], MIMIC[0] + "<spring/>"), "line 15: <spring>: this changes how the robot moves, .*take it"),
    "closed loop": (("</robot>", "<loop_joint/></robot>"), "line 18: <loop_joint>: this changes how the robot moves"),
    "cable": (("</robot>", "<cable/></robot>"), "line 18: <cable>: this changes how the robot moves"),
    "force": (("</robot>", "<force_element/></robot>"), "line 18: <force_element>: this changes how"),
    "joint of a vendor": (("</robot>", "<drake:joint/></robot>"), "line 18: <drake:joint>: this changes how"),
    "mimics in a ring": (
        (('type="revolute">', 'type="revolute"><mimic joint="elbow"/>'), MIMIC),
        "line 1[15]: .*mimic: expected a joint of its own .*, got '(shoulder|elbow)', '(shoulder|elbow)' in a ring",
    ),
    "chain to a weld": (
        (('type="revolute">', 'type="revolute"><mimic joint="grip"/>'), MIMIC),
        "line 1[15]: .*mimic: expected two joints of one coordinate, .*'grip'",
    ),
    "two orientations": (
        ('xyz="0 0 1"', 'xyz="0 0 1" rpy="0 0 0" quat_xyzw="0 0 0 1"'), "line 16: <origin>: .* got both; take one"
    ),
    "no orientation": (('xyz="0 0 1"', 'quat_xyzw="0 0 0 0"'), "line 16: <origin>: quat_xyzw: expected a length"),
}  # fmt: skip


def test_a_mimic_whose_numbers_are_beyond_any_dtype(x64):
    """Of damping the square of the multiplier counts, which Python's numbers cannot have."""
    change = MIMIC[0], MIMIC[1].replace("-2", "1e300") + '<dynamics damping="9"/>'
    with pytest.raises(
        ValueError, match="^from_urdf: line 1[15]: <.*(damping: with what|multiplier: expected at most)"
    ):
        read(ARM, change, dtype=np.float64)


def test_sums_beyond_the_dtype_are_refused():
    """Each number is one that float32 has, what they make together is not."""
    with pytest.raises(ValueError, match='^from_urdf: line 7: <link name="fore">: inertia: .* at most .* float32, got'):
        read(ARM, *[('value="2"', 'value="2e37"')] * 3)


@pytest.mark.parametrize(("change", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(change, message):
    with pytest.raises(ValueError, match="^from_urdf: ") as error:
        read(ARM, *(change if isinstance(change[0], tuple) else [change]))
    assert re.search(message, str(error.value)), str(error.value)
    assert re.search(r"\bline \d+\b", str(error.value))
    # What to do: what was expected, or a way out.
    assert re.search("expected|; ", str(error.value))


# What is read though the format does not allow it: (change, the message where it is refused, doubts, unknown words).
FOUND = {
    "no name of the robot": ((' name="arm"', ""), "line 1: <robot>: name: expected one", {}, {}),
    "version of XML": (("<robot", '<?xml version="0.0"?><robot'), "malformed XML: Unsupported version", {}, {}),
    "comment": (("<!-- two", "<!-- -- two"), "malformed XML: Double hyphen", {}, {}),
    "namespace": (("<robot", '<robot xmlns="http://a.b"'), "line 1: .*expected <robot> without a namespace", {}, {}),
    "prefix": (
        ("<transmission", "<drake:collision_filter_group/><transmission"), "malformed XML: Namespace prefix drake",
        {}, {"<drake:collision_filter_group>": ("line 17",)},
    ),
    "prefix of an attribute": (
        ('velocity="4"', 'velocity="4" drake:acceleration="5"'), "malformed XML: Namespace prefix drake",
        {}, {"drake:acceleration of <limit>": ("shoulder",)},
    ),
    "declared prefix": (
        ('<robot name="arm">', '<robot name="arm" xmlns:d="http://a.b"><d:collision_filter_group/>'),
        "line 1: <d:collision_filter_group>: there is no counterpart", {}, {"<d:collision_filter_group>": ("line 1",)},
    ),
    "words of vendors": (
        ('<child link="fore"/>', '<child link="fore"/><joint_properties/><traits/>'),
        "line 15: <joint_properties>: there is no counterpart", {},
        {"<joint_properties>": ("elbow",), "<traits>": ("elbow",)},
    ),
    "stray inertial": (
        ("</robot>", f"{INERTIAL}</robot>"), "line 18: <inertial>: there is no counterpart", {},
        {"<inertial>": ("line 18",)},
    ),
    "rpy of an axis": (
        ('<axis xyz="0 0 2"', '<axis xyz="0 0 2" rpy="0 0 0"'), "line 12: <axis>: rpy: there is no such attribute",
        {}, {"rpy of <axis>": ("shoulder",)},
    ),
    "unknown attribute": (
        ('<child link="fore"/>', '<child link="fore" at="1"/>'), "line 15: <child>: at: .*expected one of link",
        {}, {"at of <child>": ("elbow",)},
    ),
    "attribute of inertial": (
        ("<inertial>", '<inertial mass="2">'), "line 5: <inertial>: mass: .*expected none",
        {}, {"mass of <inertial>": ("upper",)},
    ),
    "part of a mass": (
        ('<mass value="2"/>', '<mass value="2"><x/></mass>'), "line 5: <x>: .*expected nothing", {}, {"<x>": ("upper",)}
    ),
    "text": (
        ('<mass value="2"/>', '<mass value="2"/>3'), "line 5: <inertial>: expected no text, got '3'; mend it",
        {}, {"text": ("upper",)},
    ),
    "misspelt xyz": (
        ('origin xyz="0 0 1"', 'origin xzy="0 0 1"'), "line 16: <origin>: xzy: .*one of quat_xyzw, rpy, xyz",
        {"xzy of <origin> is not read; did you mean 'xyz'?": ("grip",)}, {"xzy of <origin>": ("grip",)},
    ),
    "misspelt inertial": (
        (INERTIAL, INERTIAL.replace("inertial", "Inertial")), "line 5: <Inertial>: .*part of a link, .* inertial",
        {"<Inertial> is not read; did you mean 'inertial'?": ("upper",)}, {"<Inertial>": ("upper",)},
    ),
    "misspelt mass": (
        ('<mass value="2"/>', '<Mass value="2"/>'), "line 5: <Mass>: .*part of a inertial",
        {"mass 0 with moments": ("upper in line 6: mass 0 kg with moments up to 6 kg m2",),
         "<Mass> is not read; did you mean 'mass'?": ("upper",),
         "<inertial> without mass, taken as 0": ("upper",)}, {"<Mass>": ("upper",)},
    ),
    "no mass": (
        ('<mass value="2"/>', ""), 'line 5: <link name="upper">: inertial: expected mass and inertia',
        {"mass 0 with moments": ("upper in line 6: mass 0 kg with moments up to 6 kg m2",),
         "<inertial> without mass, taken as 0": ("upper",)}, {},
    ),
    "mass alone": (
        (INERTIAL, '<inertial><mass value="2"/></inertial>'), 'line 5: <link name="upper">: inertial: expected mass',
        {"<inertial> without inertia, taken as 0": ("upper",)}, {},
    ),
    "nothing": (
        (INERTIAL, "<inertial/>"), 'line 5: <link name="upper">: inertial: expected mass and inertia',
        {"<inertial> without mass and inertia, taken as 0": ("upper",)}, {},
    ),
    "no product": (
        ('ixz=".2"', ""), "line 6: <inertia>: ixz: expected 1 number", {"no ixz of <inertia>": ("upper",)}, {}
    ),
    "no limits": (
        ('<limit lower="-1" upper="2" effort="3" velocity="4"/>', ""), "line 11: .*limit: .*continuous",
        {"revolute joint without <limit>, taken as unlimited": ("shoulder",)}, {},
    ),
    "limits reversed": (
        ('lower="-1"', 'lower="7"'), "line 11: .*limit: expected lower <= upper, got 7.0 and 2.0",
        {"lower limit above the upper one, taken as unlimited": ("shoulder",)}, {},
    ),
    "negative effort": (
        ('effort="3"', 'effort="-1"'), "line 13: <limit>: effort: expected a number >= 0, got '-1'",
        {"effort below 0, taken as none": ("shoulder",)}, {},
    ),
    "commas": (
        ('xyz="0 0 1"', 'xyz="0, 0 1,"'), "line 16: <origin>: xyz: expected 3 numbers, got '0, 0 1,'; numbers",
        {"commas between numbers, taken as blanks": ("grip",)}, {},
    ),
    "commas alone": (
        ('xyz="0 0 2"', 'xyz="0,0,2"'), "line 12: <axis>: xyz: expected 3 numbers, got '0,0,2'",
        {"commas between numbers, taken as blanks": ("shoulder",)}, {},
    ),
    "dot that comes twice": (
        ('lower="-1"', 'lower="-1.."'), "line 13: <limit>: lower: expected 1 number, got '-1..'; mend it",
        {"number with a dot or an f behind it, taken without": ("shoulder",)}, {},
    ),
    "number of C": (
        ('mass value="2"', 'mass value="2.0f"'), "line 5: <mass>: value: expected 1 number, got '2.0f'",
        {"number with a dot or an f behind it, taken without": ("upper",)}, {},
    ),
    "empty limit": (
        ('effort="3"', 'effort=" "'), "line 13: <limit>: effort: expected 1 number, got ' '",
        {"empty effort of <limit>, taken as left out": ("shoulder",)}, {},
    ),
    "empty angles": (
        ('xyz="0 0 1"', 'xyz="0 0 1" rpy=""'), "line 16: <origin>: rpy: expected 3 numbers, got ''",
        {"empty rpy of <origin>, taken as left out": ("grip",)}, {},
    ),
    "empty product": (
        ('ixy=".1"', 'ixy=""'), "line 6: <inertia>: ixy: expected 1 number, got ''",
        {"empty ixy of <inertia>, taken as left out": ("upper",), "no ixy of <inertia>": ("upper",)}, {},
    ),
    "axis that comes twice": (
        ('<axis xyz="0 0 2"/>', '<axis xyz="0 0 2"/><axis xyz="0 0 2"/>'), "line 12: <axis>: <axis> comes twice", {}, {}
    ),
    "two inertials": (
        (INERTIAL, INERTIAL + INERTIAL.replace('"2"', '"3"')), "line 6: <inertial>: <inertial> comes twice; mend it",
        {"<inertial> comes twice, the first is taken": ("upper",)}, {},
    ),
    "two masses": (
        ('<mass value="2"/>', '<mass value="2"/><mass value="3"/>'), "line 5: <mass>: <mass> comes twice",
        {"<mass> comes twice, the first is taken": ("upper",)}, {},
    ),
    "two limits": (
        ('effort="3" velocity="4"/>', 'effort="3" velocity="4"/><limit/>'), "line 13: <limit>: <limit> comes twice",
        {"<limit> comes twice, the first is taken": ("shoulder",)}, {},
    ),
    "call of a macro": (
        ('name="tool">', 'name="tool"><xacro:x/>'), "malformed XML: Namespace prefix xacro",
        {"macro that xacro did not know": ("xacro:x in line 9",)}, {"<xacro:x>": ("tool",)},
    ),
    "useless axis": (
        ('<origin xyz="0 0 1"/>', '<origin xyz="0 0 1"/><axis xzy="0 0 1"/>'), "line 16: <axis>: xzy: .*no such", {}, {}
    ),
    "world that nobody declares": (
        ("</robot>", '<joint name="w" type="fixed"><parent link="world"/><child link="base"/></joint></robot>'),
        "line 18: .*parent: there is no link 'world'", {}, {},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("change", "message", "doubtful", "unknown"), FOUND.values(), ids=FOUND)
def test_what_files_have_is_read_and_refused_where_strict(change, message, doubtful, unknown, recwarn):
    mech = read(ARM, change)
    said = [x.message for x in recwarn if x.category is ModelFileWarning]
    assert [(x.doubtful, x.unknown) for x in said] == ([(doubtful, unknown)] if doubtful or unknown else [])
    assert all(list(x.doubtful) == list(doubtful) and x.unknown.items() <= x.left_out.items() for x in said)
    assert (mech.joint_names, mech.nv) == (("shoulder", "elbow"), 2)
    with pytest.raises(ValueError, match="^from_urdf: ") as error:
        read(ARM, change, strict=True)
    assert re.search(message, str(error.value)), str(error.value)
    # Or what XML does not allow, for any reader.
    assert re.search("read the file without strict=True|there is no link 'world'|malformed XML", str(error.value))


def test_what_is_read_so_has_these_numbers():
    mech = read(ARM, *(FOUND[what][0] for what in ("limits reversed", "negative effort", "no product")))
    np.testing.assert_array_equal([mech.lower[0], mech.upper[0], mech.effort_limit[0]], [-np.inf, np.inf, np.inf])
    np.testing.assert_array_equal(mech.inertias.central[0], np.float32([4, 0.1, 5, 0, 0.3, 6]))
    for what in ("commas", "commas alone", "dot that comes twice", "number of C", "empty angles"):
        assert repr(read(ARM, FOUND[what][0])) == repr(read())
    mech = read(ARM, FOUND["mass alone"][0])
    np.testing.assert_array_equal([mech.inertias.mass[0], *mech.inertias.central[0]], [2, 0, 0, 0, 0, 0, 0])
    for what in ("two inertials", "two masses", "two limits"):
        assert repr(read(ARM, FOUND[what][0])) == repr(read())
        np.testing.assert_array_equal(read(ARM, FOUND[what][0]).inertias.mass, read().inertias.mass)
    mech = read(ARM, FOUND["world that nobody declares"][0])
    assert dict(mech.topology.frames) == {"world": -1, "base": -1, "upper": 0, "fore": 1, "tool": 1}


def test_newer_versions_of_the_format(recwarn):
    """1.1 has limits of rates, 1.2 has quaternions; of any length here, as what is computed with them is normalised."""
    changes = (
        ('<robot name="arm">', '<robot name="arm" version="1.2">'),
        ('rpy="0 0 1.5707963267948966"', 'quat_xyzw="0 0 3 3"'),
        ('velocity="4"', 'velocity="4" acceleration="5" deceleration="6" jerk="7"'),
    )
    np.testing.assert_array_equal(read(ARM, *changes).placements.rotation.entries, read().placements.rotation.entries)
    assert not [x for x in recwarn if x.category is ModelFileWarning]


def test_chains_of_mimics_multiply():
    """tip = 3 elbow + 1, elbow = -2 shoulder + 1/2."""
    tip = '<mimic joint="elbow" multiplier="3" offset="1"/>'
    changes = MIMIC, ('name="grip" type="fixed">', f'name="grip" type="revolute"><limit/>{tip}')
    mech = read(ARM, *changes)
    assert (mech.nq, mech.nv) == (1, 1)
    np.testing.assert_array_equal(mech.mimics, [[1, 0], [-2, 0.5], [-6, 2.5]])
    np.testing.assert_array_equal(mech.joint_position_indices("grip"), [0])


@pytest.mark.parametrize("axis", ["1 0 0", "0 1 0", "0 0 1", "-1 0 0", "0 -2 0", "0 0 -1", "1 2 3", "1e-9 0 -1"])
def test_planar_joints_move_across_their_axis(axis, x64):
    """The turn is about the axis, and x and y are across it, right-handed. Without an axis it is x."""
    changed = read(ARM, ('type="continuous"><', f'type="planar"><axis xyz="{axis}"/><'), dtype=np.float64)
    n = np.array(axis.split(), float)
    n /= np.linalg.norm(n)
    X_PJ = changed.placements.rotation.entries[1].reshape(3, 3)
    np.testing.assert_allclose(X_PJ[:, 2], n, rtol=0, atol=4e-16)
    np.testing.assert_allclose(X_PJ.T @ X_PJ, np.eye(3), rtol=0, atol=1e-15)
    assert np.linalg.det(X_PJ) > 0
    # At zero the body is where it is without a joint.
    np.testing.assert_allclose(changed.child_placements.rotation.entries[1].reshape(3, 3), X_PJ.T, rtol=0, atol=0)
    without = read(ARM, ('type="continuous"', 'type="planar"')).placements.rotation.entries[1]
    np.testing.assert_array_equal(without, [0, 0, 1, 0, 1, 0, -1, 0, 0])


SOURCES = {
    "nothing": ("", r"expected a path or text, got ''"),
    "blanks": (" \n ", r"expected a path or text, got ' \\n '"),
    "no XML": ("robot\n" * 50, "expected a path, or text that begins with '<', got"),
    "no element": ("<!-- -->", "malformed XML: "),
}


@pytest.mark.parametrize(("text", "message"), SOURCES.values(), ids=SOURCES)
def test_what_is_neither_path_nor_text(text, message):
    with pytest.raises(ValueError, match="^from_urdf: .*" + message):
        js.Mechanism.from_urdf(text)


@pytest.mark.parametrize("text", [b"", bytes(range(256))])
def test_a_file_without_text_is_refused_in_our_words(text, tmp_path):
    (path := tmp_path / "arm.urdf").write_bytes(text)
    with pytest.raises(ValueError, match="^from_urdf: malformed XML: Document is empty, line 1, column 1; mend"):
        js.Mechanism.from_urdf(path)


def test_numbers_are_no_floating_base():
    """They were meant as gravity."""
    with pytest.raises(TypeError, match="^from_urdf: floating_base: expected True or False, got tuple"):
        js.Mechanism.from_urdf(ARM, (0.0, 0.0, -9.81))


def test_what_comes_before_the_text_does_no_harm(tmp_path):
    """A mark of the byte order, blanks before a declaration, and a declaration of what text no longer is."""
    expected, path = repr(read()), tmp_path / "arm.urdf"
    declared = '<?xml version="1.0" encoding="latin-1"?>'
    path.write_text("\ufeff" + ARM, encoding="utf-8")
    other = tmp_path / "other.urdf"
    wide = tmp_path / "wide.urdf"
    wide.write_text('<?xml version="1.0" encoding="utf-16"?>' + ARM, encoding="utf-16")
    ended = tmp_path / "ended.urdf"
    ended.write_text(ARM + "\n \0\0")
    other.write_text(f"\n\n {declared.replace('latin-1', 'iso-8859-1')}{ARM}\0", encoding="latin-1")
    for source in ("\ufeff" + ARM, path, other, wide, ended, f"\n {declared}{ARM}", "\ufeff\n\n" + ARM):
        assert repr(js.Mechanism.from_urdf(source)) == expected
    assert read(declared + ARM, ('"elbow"', '"ellb\xf6gen"')).joint_names[1] == "ellb\xf6gen"
    with pytest.raises(ValueError, match="line 6: <link>: name: expected one"):
        read(f"\n\n{declared}{ARM}", ('link name="base"', "link"))


# What XML does not allow, and the parser of Pinocchio and MuJoCo reads: (what of the file, the message where strict).
MENDED = {
    "comment in Latin-1": ((b"<!-- two", b"<!-- \xe9"), "line 2"),
    "comment in GBK": ((b"<!-- two", b"<!-- \xc4\xe3"), "line 2"),
    "unknown encoding": ((b"<robot", b"<?xml version='1.0' encoding='utf8mb4'?><robot"), "line 1"),
    "encoding that it has not": (
        (b"<robot", b"<?xml version='1.0' encoding='ascii'?><!-- \xc3\xa9 --><robot"),
        "line 1",
    ),
    "comment that ends late": ((b"welded -->", b"welded ---->"), "line (2|18)"),
    "ampersand": ((b'<material name="grey"', b'<material name="black & grey"'), "line 3"),
    "entity of HTML": ((b'<material name="grey"', b'<material name="&nbsp;"'), "line 3"),
    "bracket in a name": ((b'<material name="grey"', b'<material name="<grey"'), "line 3"),
    "no blank": ((b'name="shoulder" type', b'name="shoulder"type'), "line 11"),
    "blank": ((b"<limit", b"< limit"), "line 13"),
    "control character": ((b"<!-- two", b"<!-- \x0b"), "line 2"),
    "two declarations": ((b"<robot", b"<?xml version='1.0'?>\n<?xml version='1.0'?><robot"), "line 2"),
    "declaration behind a comment": ((b"<robot", b"<!-- -->\n<?xml version='1.0'?><robot"), "line 2"),
    "three parts of a name": ((b"<limit", b'<limit a:b:c="1"'), "line 13"),
}
LISTED = {
    "two robots": ((b"</robot>", b"</robot><robot/>"), "line 18", {"text behind </robot>": ("line 18",)}),
    "a link behind": ((b"</robot>", b"</robot>\n<link name='x'/>"), "line 19", {"text behind </robot>": ("line 19",)}),
    "what a tool said": ((b"<robot", b"xacro: done\n<?xml version='1.0'?><robot"), "line 1",
                         {"text before <robot>": ("line 1",)}),
}  # fmt: skip


@pytest.mark.parametrize(("change", "message", "unknown"), [(*x, {}) for x in MENDED.values()] + [*LISTED.values()],
                         ids=[*MENDED, *LISTED])  # fmt: skip
def test_what_other_parsers_of_xml_read(change, message, unknown, tmp_path, recwarn):
    path = tmp_path / "arm.urdf"
    assert change[0] in ARM.encode()
    path.write_bytes(ARM.encode().replace(*change, 1))
    assert repr(js.Mechanism.from_urdf(path)) == repr(read())
    listed = [x.message.unknown for x in recwarn if x.category is ModelFileWarning]
    assert listed == ([unknown] if unknown else []) or listed == [{"a:b:c of <limit>": ("shoulder",)}]
    with pytest.raises(ValueError, match=f"^from_urdf: malformed XML: .*{message}, column .*; mend the file there"):
        js.Mechanism.from_urdf(path, strict=True)


def test_names_in_another_encoding_are_read_as_latin_1(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(ARM.replace('"elbow"', '"ellb\xf6gen"').encode("latin-1"))
    assert js.Mechanism.from_urdf(path).joint_names == ("shoulder", "ellb\xf6gen")
    # A text that declares entities has these.
    declared = ARM.replace('name="elbow"', 'name="&e;"').replace(
        "<robot", '<!DOCTYPE robot [<!ENTITY e "elbow">]><robot'
    )
    path.write_text(declared)
    assert js.Mechanism.from_urdf(path).joint_names == ("shoulder", "elbow")


NOT_MENDED = {
    "attribute twice": (b'type="revolute"', b'type="revolute" type="fixed"'),
    "no quotes": (b'type="revolute"', b"type=revolute"),
    "open comment": (b"welded -->", b"welded"),
    "open tag": (b"</robot>", b""),
    "other tag": (b"</robot>", b"</robots>"),
    "zero": (b"<!-- two", b"<!-- \0"),
}


@pytest.mark.parametrize("change", NOT_MENDED.values(), ids=NOT_MENDED)
def test_xml_that_no_parser_reads_is_refused(change, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(ARM.encode().replace(*change, 1))
    with pytest.raises(ValueError, match=r"^from_urdf: malformed XML: .*line \d+, column \d+; mend the file there$"):
        js.Mechanism.from_urdf(path)


def test_a_picture_without_geometry_is_left_out_like_any_other():
    assert repr(read(ARM, ("<visual>", "<visual/><visual>"))) == repr(read())


@pytest.mark.parametrize("axis", ["1e-200 1e-200 0", "1e-320 1e-320 0", "3e38 3e38 0"])
def test_axes_of_any_length(axis):
    np.testing.assert_allclose(read(ARM, ("0 0 2", axis)).axes[0], [0.5**0.5, 0.5**0.5, 0], rtol=1e-7)


def test_limits_may_be_infinite():
    mech = read(ARM, ('lower="-1" upper="2" effort="3"', 'lower="-inf" upper="inf" effort="inf"'))
    np.testing.assert_array_equal([mech.lower[0], mech.upper[0], mech.effort_limit[0]], [-np.inf, np.inf, np.inf])


# -- what is left out -------------------------------------------------------------------------------------------------


def warned(function, *arguments):
    with pytest.warns(ModelFileWarning) as found:
        function(*arguments)
    assert len(found) == 1 and found[0].filename == __file__
    return found[0].message


def doubts(text):
    """Of a text that has something else to be warned of."""
    return warned(js.Mechanism.from_urdf, changed(text, ("</robot>", "<traits/></robot>"))).doubtful


def test_what_is_left_out_is_listed_once():
    fixed = ('<origin xyz="0 0 1"/>', '<origin xyz="0 0 1"/><axis xyz="0 0 1"/>')
    current = ('velocity="4"', 'velocity="4" current="9"')
    message = warned(js.Mechanism.from_urdf, changed(ARM, fixed, current, ("</robot>", "<traits/></robot>")))
    assert message.left_out == {
        "<material>": ("grey",), "<transmission>": ("drive",), "<visual>": ("base",), "<traits>": ("line 18",),
        "current of <limit>": ("shoulder",), "<axis> of a fixed joint": ("grip",),
    }  # fmt: skip
    assert str(message) == "from_urdf: left out: <traits> (1)"


def test_nothing_is_said_of_shapes(recwarn):
    """Nor of other things that nobody looks for in a mechanism."""
    more = '<gazebo reference="base"/><ros2_control name="c"/><sensor name="s"/></robot>'
    shape = "<visual/><collision><geometry/></collision></link>"
    read(ARM, ("</robot>", more), ("</link>", shape), ('<child link="fore"/>', '<child link="fore"/><calibration/>'))
    assert not [x for x in recwarn if x.category is ModelFileWarning]


WITHOUT = "no inertia along coordinates, so that no torque accelerates them"
NO_MASS = ((INERTIAL, ""),) * 3
ROD = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="0" ixy="0" ixz="0" iyz="0"/></inertial>'
POINT = '<inertial><origin xyz="0 0 1"/><mass value="2"/></inertial>'
# What the links are made of, and the joints that nothing resists.
COORDINATES = {
    "no mass at all": (NO_MASS, ("shoulder", "elbow")),
    "mass behind": ((*NO_MASS[:2],), ()),
    "nothing at the end": ((NO_MASS[0], NO_MASS[1], (INERTIAL, "")), ("shoulder", "elbow")),
    "rod along the axis": (((INERTIAL, ROD), (INERTIAL, ""), (INERTIAL, "")), ("shoulder", "elbow")),
    "rod across the axis": (((INERTIAL, ""), (INERTIAL, ROD), (INERTIAL, "")), ()),
    "point on the axis": (((INERTIAL, POINT), (INERTIAL, ""), (INERTIAL, "")), ("shoulder", "elbow")),
    "point beside the axis": (((INERTIAL, ""), (INERTIAL, POINT), (INERTIAL, "")), ()),
    "slide with moments alone": (
        ((INERTIAL, ""), (INERTIAL, POINT.replace('"2"', '"0"')), (INERTIAL, ""), ('"continuous"', '"prismatic"')),
        ("shoulder", "elbow"),
    ),
    "free point": (((INERTIAL, ""), (INERTIAL, POINT), (INERTIAL, ""), ('"continuous"', '"floating"')), ("elbow",)),
    "follower": ((*NO_MASS[:2], (INERTIAL, ""), MIMIC), ("shoulder",)),
    "follower with mass": (((INERTIAL, ""), MIMIC), ()),
}


@pytest.mark.parametrize(("changes", "names"), COORDINATES.values(), ids=COORDINATES)
def test_coordinates_that_nothing_resists_are_said_first(changes, names):
    """Those of which M has a zero on its diagonal, at any coordinates."""
    text = changed(ARM, *changes, ("</robot>", "<traits/></robot>"))
    message = warned(js.Mechanism.from_urdf, text)
    assert message.doubtful.get(WITHOUT, ()) == names
    if names:
        assert str(message).startswith(f"from_urdf: {WITHOUT} ({len(names)}: {', '.join(names)})")
    mech = js.Mechanism.from_urdf(text)
    M = np.asarray(js.mass_matrix(mech, js.random_configuration(mech, jax.random.key(0))))
    zero = {mech.joint_names[i] for i in range(len(mech.joint_names)) if not mech.topology.is_mimic(i)
            if not (np.diag(M)[mech.topology.v_slice(i)] > 1e-6).all()}  # fmt: skip
    assert zero == set(names)


def test_every_robot_of_a_collection_is_read():
    """Of example-robot-data; what is refused is wrong: a mimic of no joint, a robot without a name."""
    needs("pinocchio")
    files = [f for f in importlib.metadata.files("example-robot-data") or [] if f.suffix == ".urdf"]
    refused = {}
    for file in files:
        try:
            read(file.read_text())
        except ValueError as error:
            refused[file.stem] = str(error)
    assert len(files) > 50 and set(refused) == {"alex_psyonic_hands", "ur3"}, refused


def test_limits_that_have_no_place_are_listed():
    limited = changed(MIMIC[1], ("/><mimic", '/><limit lower="0" upper="1"/><mimic'))
    assert warned(read, ARM, (MIMIC[0], limited)).left_out["<limit> of a mimic"] == ("elbow",)
    found = warned(read, ARM, (MIMIC[0], limited.partition("<mimic")[0])).left_out
    assert found["lower and upper limit of a continuous joint"] == ("elbow",)


@pytest.mark.parametrize("limit", ['lower="-3.4" upper="2.5"', 'lower="-3.5" upper="2.4"', 'velocity="7"', ""])
def test_limits_of_a_mimic_that_say_nothing_more_are_not_listed(limit):
    """It moves by -2 times the angle of the other, which is within -1 and 2 rad and 4 rad/s, and 0.5 rad."""
    as_wide = 'lower="-3.5" upper="2.5" effort="1" velocity="8"'
    limited = changed(MIMIC[1], ("/><mimic", f"/><limit {limit or as_wide}/><mimic"))
    if limit:
        assert warned(read, ARM, (MIMIC[0], limited)).left_out["<limit> of a mimic"] == ("elbow",)
    else:
        read(ARM, (MIMIC[0], limited))


def _of_moments(ixx, iyy, izz):
    return f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/>'


IMPOSSIBLE = {
    "plate": ((4, 5, 9), None),
    "rounded plate": ((4, 5, 9.0001), None),
    "triangle": ((9.1, 5, 4), "principal moments 4 + 5 < 9.1 kg m2 by 0.1 (triangle inequality)"),
    "small": (
        (4e-30, 5e-30, 9.5e-30),
        "principal moments 4e-30 + 5e-30 < 9.5e-30 kg m2 by 5e-31 (triangle inequality)",
    ),
    "negative": ((4, -2, 5), "principal moment -2 kg m2 < 0"),
    "negative definite": ((-4, -5, -6), "principal moment -6 kg m2 < 0"),
}


@pytest.mark.parametrize(("moments", "why"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_inertias_of_no_body_are_listed_with_the_rule_they_break(moments, why):
    """Of a plate the third moment is the sum of the others: what rounding makes of it is none of those."""
    text = changed(ARM, (INERTIAL.partition("\n  ")[2].partition("</")[0], _of_moments(*moments)))
    message = warned(js.Mechanism.from_urdf, changed(text, ("</robot>", "<traits/></robot>")))
    assert message.doubtful == ({"inertia that no rigid body has": (f"upper in line 6: {why}",)} if why else {})
    assert (f"upper in line 6: {why}" in str(message)) is (why is not None)


IMPROPER = f'<inertial><mass value=".1"/>{_of_moments(1, 1, 3)}</inertial>'


def test_inertias_of_what_is_welded_count_with_all_that_is():
    """That of the tool alone is of no body, that of the forearm with it is; with two such it is not."""
    of = {name: (f'<link name="{name}">{INERTIAL}', f'<link name="{name}">{IMPROPER}') for name in ("fore", "tool")}
    assert not doubts(changed(ARM, of["tool"]))
    (found,) = doubts(changed(ARM, *of.values())).values()
    assert [x.split()[0] for x in found] == ["fore", "tool"]


def test_moments_without_mass_are_listed():
    """Of a link that is welded to others they are moments of what has mass."""
    massless = f'<inertial><mass value="0"/>{_of_moments(1, 1, 1)}</inertial>'
    of = {name: (f'<link name="{name}">{INERTIAL}', f'<link name="{name}">{massless}') for name in ("fore", "tool")}
    assert not doubts(changed(ARM, of["tool"]))
    (found,) = doubts(changed(ARM, *of.values())).values()
    assert [x.split(": ")[1] for x in found] == ["mass 0 kg with moments up to 1 kg m2"] * 2


def test_an_inertia_that_is_welded_to_the_world_is_none():
    """The base; it is one where it floats."""
    text = changed(ARM, ('<link name="base">', f'<link name="base">{IMPROPER}'))
    assert not doubts(text)
    assert list(warned(lambda: js.Mechanism.from_urdf(text, floating_base=True)).doubtful)


def test_all_is_said_of_a_robot_that_has_nothing_else(recwarn):
    read(ARM, ("<visual><geometry><sphere radius=\"1\"/></geometry></visual>", ""), ('<material name="grey"/>', ""),
         ('<transmission name="drive"/>', ""))  # fmt: skip
    assert not recwarn


def test_numbers_of_a_file_are_known_while_tracing():
    assert_known_while_tracing(read)


def test_without_the_package(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "lxml.etree", None)
    with pytest.raises(ImportError, match=r"from_urdf: needs the package lxml: .*pip install '\.\[models\]'"):
        read()
