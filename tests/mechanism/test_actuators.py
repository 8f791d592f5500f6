"""Actuators: their forces by hand and against MuJoCo's, relative error 1e-12, what is read of files and what is not.

Compared with MuJoCo is `qfrc_actuator` at random states, whose ctrl and forces reach their limits.
"""

import copy
import pathlib
import pickle

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import ModelFileWarning
from jaxspatial.interop import mujoco as states
from tests.helpers.counting import done
from tests.helpers.interpreted import interpreted
from tests.helpers.optional import needs

BOX = js.SpatialInertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 2.0, 2.5]))
SERVO = {"gain": 50.0, "stiffness": 50.0, "damping": 2.0}


def arm(**limits):
    """A ball, a hinge, a slide, and a hinge that follows the slide."""
    joints = [
        js.Joint("root", "ball", "world", "r"),
        js.Joint("a", "revolute", "r", "a", **limits),
        js.Joint("b", "prismatic", "a", "b", axis=(1, 0, 0)),
        js.Joint("c", "revolute", "b", "c", axis=(0, 1, 0), mimic=("b", 2.0, 0.3)),
    ]
    return js.Mechanism.build([js.Body(x, BOX) for x in "rabc"], joints, dtype=np.float32)


Q, V = np.float32([1, 0, 0, 0, 0.5, 0.25]), np.float32([7, 7, 7, 1, -2])


def torques(actuators, ctrl, mech=None):
    return interpreted(lambda c: actuators.torques(mech or arm(), Q, V, c))(np.float32(ctrl))


def test_forces_by_hand():
    servo, motor = js.Actuators(["a"], **SERVO), js.Actuators(["m"], ["b"], 3.0, gain=2.0, bias=0.5)
    np.testing.assert_allclose(torques(servo, [0.7]), [0, 0, 0, 50 * 0.2 - 2, 0], rtol=1e-6)
    np.testing.assert_allclose(torques(motor, [0.7]), [0, 0, 0, 0, 3 * (2 * 0.7 + 0.5)], rtol=1e-6)
    # Over two joints, of which c = 2 b + 0.3 follows b: L = a - 3 (2 b + 0.3), its rate 1 + 12.
    line = js.Actuators(["line"], [("a", "c")], [1.0, -3.0], **SERVO)
    force = 50 * (0.7 - (0.5 - 3 * 0.8)) - 2 * 13
    np.testing.assert_allclose(torques(line, [0.7]), [0, 0, 0, force, -6 * force], rtol=1e-6)
    # What pulls at one joint adds up, three and more too.
    many = js.Actuators(["x", "y", "z", "w"], ["a", "b", "a", "a"], gain=[1.0, 2, 3, 4])
    np.testing.assert_allclose(torques(many, [1, 1, 1, 1]), [0, 0, 0, 8, 2])
    np.testing.assert_array_equal(torques(js.Actuators([]), []), np.zeros(5))


def test_limits():
    servo = js.Actuators(["a"], **SERVO, ctrl_lower=-1.0, ctrl_upper=1.0, lower=-20.0, upper=15.0)
    of = lambda ctrl: torques(servo, [ctrl])[3]  # noqa: E731
    np.testing.assert_allclose([of(0.7), of(9.0), of(-9.0)], [8, 15, -20], rtol=1e-6)
    two = js.Actuators(["x", "y"], ["a", "a"], gain=6.0)
    np.testing.assert_allclose(torques(two, [2, -1], arm(effort_limit=7.0))[3], 6, rtol=1e-6)
    np.testing.assert_allclose(torques(two, [2, 1], arm(effort_limit=7.0))[3], 7, rtol=1e-6)
    assert np.isnan(torques(servo, [np.nan])[3])


def test_they_are_data():
    """Gains are learned, and drawn for each state of a batch; under jit and vmap the results are the same."""
    mech, servo = arm(), jax.tree.map(jnp.asarray, js.Actuators(["a"], **SERVO).astype(np.float32))
    slopes = jax.grad(lambda s: s.torques(mech, Q, V, jnp.ones(1, jnp.float32))[3])(servo)
    np.testing.assert_allclose([slopes.gain, slopes.stiffness, slopes.damping], [1, -0.5, -1])
    gains = np.float32([[1], [2], [3]])
    batched = js.Actuators(["a"], gain=gains)
    assert batched.batch_shape == (3,)
    found = batched.torques(mech, Q, V, np.float32([2]))
    np.testing.assert_array_equal(found[:, 3], [2, 4, 6])
    mapped = interpreted(jax.vmap(lambda g: js.Actuators(["a"], gain=g).torques(mech, Q, V, np.float32([2]))))(gains)
    np.testing.assert_array_equal(mapped, found)
    ctrl = jnp.float32([0.3])
    np.testing.assert_array_equal(jax.jit(servo.torques)(mech, Q, V, ctrl), servo.torques(mech, Q, V, ctrl))
    for other in (copy.deepcopy(servo), pickle.loads(pickle.dumps(servo))):
        assert other.names == ("a",) and other.joints == (("a",),) and other.gain == 50


def test_what_there_is_not_costs_nothing():
    """A motor of gain 1 is a place in tau, another a product; limits are a comparison each."""
    count = lambda **numbers: done(  # noqa: E731
        lambda c: js.Actuators(["a"], **numbers).torques(arm(), Q, V, c), np.float32([1.0])
    )
    assert not count(gain=1.0)
    assert count(gain=2.0) == {"multiply": 1}
    assert count(gain=2.0, lower=-1.0, upper=1.0) == {"multiply": 1, "compare": 2, "select": 2, "negate": 1}


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: js.Actuators("a"), TypeError, "Actuators: names: expected a sequence of names, got 'a'"),
        (lambda: js.Actuators(["a", "b"], ["a"]), ValueError, "joints: expected one or more for each of 2 names"),
        (lambda: js.Actuators(["a"], "a"), TypeError, "joints: expected a sequence of names, or of sequences"),
        (lambda: js.Actuators(["a"], gain=np.ones(2)), ValueError, r"gain: expected a number, or shape \(\*batch, 1\)"),
        (lambda: js.Actuators(["a"], gain=np.nan), ValueError, "Actuators: gain: expected numbers, got nan"),
        (lambda: js.Actuators(["a"], upper=[np.nan]), ValueError, "Actuators: upper: expected numbers, got .nan"),
        (lambda: js.Actuators(["a"], lower=2.0, upper=1.0), ValueError, "lower: expected at most upper, 1.0, got 2.0"),
        (lambda: js.Actuators(["a"], ctrl_upper=-1.0, ctrl_lower=np.zeros((2, 1))), ValueError, "ctrl_lower: .*-1"),
        (lambda: js.Actuators(["x"], [("a", "b")], np.ones(3)), ValueError, r"gears: expected .* \(\*batch, 2\), got"),
        (lambda: torques(js.Actuators(["e"]), [1]), KeyError, "joints: expected one of 'root', 'a', 'b', 'c', got 'e'"),
        (lambda: torques(js.Actuators(["root"]), [1]), ValueError, "joints of one coordinate, got 'root', a 'ball'"),
        (lambda: torques(js.Actuators(["a"]), [1, 2]), ValueError, r"Actuators.torques: ctrl: expected .*1"),
    ],
)
def test_messages(make, error, message):
    with pytest.raises(error, match=message):
        make()


# -- files ------------------------------------------------------------------------------------------------------------

BODIES = """
  <body><joint name="a" axis="1 2 3" range="-2 2" ref=".3" damping=".1"/><geom size=".1" mass="1"/>
    <body><joint name="b" type="slide" axis="0 1 0"/><geom size=".2" mass="1"/>
      <body><joint name="c" axis="0 1 0" actuatorfrcrange="-2 2"/><geom size=".3" mass="1"/></body>
    </body>
  </body>
  <body name="ball" pos="0 0 9"><joint name="ball" type="ball"/><geom size=".2" mass="1"/></body>
  <body name="free" pos="9 0 9"><freejoint name="free"/><geom size=".2" mass="1"/><site name="s"/></body>
"""
TENDONS = '<tendon><fixed name="t"><joint joint="a" coef="2"/><joint joint="c" coef="-.5"/></fixed></tendon>'
ACTUATORS = """
    <position name="p" joint="a" kp="30" kv="2" ctrlrange="-1 1" gear="2"/>
    <position joint="b" kp="7" dampratio="1" inheritrange="0" forcerange="-1 2"/>
    <position name="q" joint="a" kp="3" inheritrange=".5"/>
    <velocity name="v" jointinparent="b" kv="4" gear="-3"/>
    <motor class="strong" name="m" joint="c"/>
    <motor name="n" tendon="t" gear="1.5"/>
    <position name="o" tendon="t" kp="2" forcerange="-.5 .5"/>
    <general name="g" joint="b" gainprm="3" biastype="affine" biasprm=".5 -2 -.25" ctrlrange="-.1 .1"/>
"""
DEFAULTS = (
    '<default><default class="strong"><motor gear="5" ctrllimited="true" ctrlrange="-.4 .7"/></default></default>'
)


def mjcf(actuators, rest="", mimic=""):
    return f"""<mujoco><compiler angle="radian" autolimits="true"/>{DEFAULTS}<worldbody>{BODIES}</worldbody>{TENDONS}
        <equality>{mimic}</equality><actuator>{actuators}</actuator>{rest}</mujoco>"""


def relative_error(source):
    """Of tau against MuJoCo's, over some states of a text or a model. Of mimics both are on the joints they follow."""
    model = source if isinstance(source, mujoco.MjModel) else mujoco.MjModel.from_xml_string(source)
    with jax.enable_x64(True):
        mech = js.Mechanism.from_mjcf(source, dtype=np.float64)
        actuators, data, rng = js.Actuators.from_mjcf(mech, source), mujoco.MjData(model), np.random.default_rng(0)
        q, v = rng.standard_normal((3, mech.nq)), rng.standard_normal((3, mech.nv))
        ctrl = np.array([[0.1], [1.0], [10.0]]) * rng.standard_normal((3, len(actuators.names)))

        @interpreted
        @jax.vmap
        def both(q, v, ctrl):
            qpos, qvel = states.to_qpos(mech, q), states.to_qvel(mech, q, v)
            # The generalized force of a force on each of MuJoCo's coordinates.
            T = jax.vmap(lambda f: states.from_qfrc(mech, q, f), out_axes=1)(jnp.eye(model.nv))
            return qpos, qvel, T, actuators.torques(mech, q, v, ctrl)

        worst = 0.0
        for k, (qpos, qvel, T, ours) in enumerate(zip(*both(q, v, ctrl), strict=True)):
            data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl[k]
            mujoco.mj_forward(model, data)
            theirs = T @ data.qfrc_actuator
            worst = max(worst, abs(ours - theirs).max() / abs(theirs).max())
    return worst


@pytest.mark.slow
@pytest.mark.parametrize("which", range(8))
def test_one_actuator_against_mujoco(which):
    assert relative_error(mjcf(ACTUATORS.strip().splitlines()[which])) <= 1e-12


def test_all_actuators_against_mujoco():
    assert relative_error(mjcf(ACTUATORS)) <= 1e-12
    assert (
        relative_error(
            mjcf(ACTUATORS).replace("<worldbody>", '<option><flag clampctrl="disable"/></option><worldbody>')
        )
        <= 1e-12
    )


def test_actuators_of_mimics_against_mujoco():
    mimic = '<joint joint1="b" joint2="a" polycoef=".3 -1.5"/>'
    assert relative_error(mjcf(ACTUATORS, mimic=mimic)) <= 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("file", ["humanoid/humanoid.xml", "shadow_hand/scene_right.xml"])
@pytest.mark.filterwarnings("ignore::jaxspatial.interop.ModelFileWarning")
def test_models_of_others_against_mujoco(file):
    """Servos on tendons over two joints, and motors."""
    folder = pathlib.Path(needs("mujoco.mjx").__file__).parent / "test_data"
    model = mujoco.MjModel.from_xml_path(str(folder / file))
    assert model.nu > 15 and relative_error(model) <= 1e-12


def test_names_and_numbers_of_a_file():
    text = mjcf(ACTUATORS)
    mech = js.Mechanism.from_mjcf(text)
    actuators = js.Actuators.from_mjcf(mech, text)
    assert actuators.names == ("p", "actuator_1", "q", "v", "m", "n", "o", "g") and actuators.dtype == np.float32
    assert actuators.joints[0] == ("a",) and actuators.joints[5] == ("a", "c")
    np.testing.assert_array_equal(actuators.gears, np.float32([2, 1, 1, -3, 5, 3, -0.75, 2, -0.5, 1]))
    np.testing.assert_array_equal(actuators.gain, np.float32([30, 7, 3, 4, 1, 1, 2, 3]))
    np.testing.assert_allclose([actuators.ctrl_lower[4], actuators.ctrl_upper[4]], [-0.4, 0.7])
    assert all(isinstance(x, np.ndarray) for x in jax.tree.leaves(actuators))
    compiled = js.Actuators.from_mjcf(mech, mujoco.MjModel.from_xml_string(text))
    np.testing.assert_array_equal(compiled.stiffness, actuators.stiffness)
    with pytest.raises(KeyError, match="a joint of the file: expected one of 'z', got 'a'"):
        other = js.Mechanism.build([js.Body("z", BOX)], [js.Joint("z", "revolute", "world", "z")])
        js.Actuators.from_mjcf(other, text)


NOT_PLAIN = {
    "activation": '<intvelocity name="x" joint="a" kp="1" actrange="-1 1"/>',
    "activation ": '<position name="x" joint="a" kp="1" timeconst="1"/>',
    "gains that depend on the state": '<general name="x" joint="a" gaintype="affine" gainprm="1 2 3"/>',
    "no hinge or slide, nor a tendon over such, to pull at": '<motor name="x" joint="ball" gear="1 2 3"/>',
    "no hinge or slide, nor a tendon over such, to pull at ": '<motor name="x" site="s" gear="0 0 1"/>',
    "a group that is switched off": '<motor name="x" joint="a" group="3"/>',
}


@pytest.mark.parametrize("why", NOT_PLAIN)
def test_what_is_not_plain_is_listed(why):
    option = '<option actuatorgroupdisable="3"/>'
    text = mjcf(f'<motor name="w" joint="a"/>{NOT_PLAIN[why]}<motor name="y" joint="b"/>', option)
    mech = js.Mechanism.from_mjcf(text)
    with pytest.warns(ModelFileWarning, match=f"left out: actuator with {why.strip()}") as said:
        actuators = js.Actuators.from_mjcf(mech, text)
    assert actuators.names == ("w", "y")
    assert said[0].message.unknown == {f"actuator with {why.strip()}": ("x",)} and said[0].filename == __file__


def test_key_frames():
    frames = """<keyframe>
      <key name="home" qpos=".1 .2 .3 0 1 0 0 1 2 3 0 0 1 0" qvel="1 2 3 4 5 6 7 8 9 10 11 12" ctrl="1 2 3"/><key/>
    </keyframe>"""
    plain = '<motor name="w" joint="a"/>{}<motor name="y" joint="b"/>'.format(NOT_PLAIN["activation"])
    text = mjcf(plain, frames.replace("<key name", '<key act="0" name'))
    mech = js.Mechanism.from_mjcf(text)
    found = js.interop.mujoco.key_frames(mech, text)
    assert list(found) == ["home", "key_1"]
    q, v, ctrl = found["home"]
    positions = mech.joint_positions(q)
    np.testing.assert_array_equal([positions[x] for x in "abc"], np.float32([0.1, 0.2, 0.3]))
    np.testing.assert_array_equal(q[mech.joint_position_indices("free")], [0, 0, 1, 0, 1, 2, 3])
    np.testing.assert_array_equal(ctrl, [1, 3])  # of the actuators that are read
    np.testing.assert_array_equal(states.to_qvel(mech, q, v), range(1, 13))
    np.testing.assert_array_equal(jax.jit(lambda: js.interop.mujoco.key_frames(mech, text)["home"].q)(), q)
    np.testing.assert_array_equal(found["key_1"].q[0], np.float32(0.3))
