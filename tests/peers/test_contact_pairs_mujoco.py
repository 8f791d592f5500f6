"""Boxes on one another and a hand, beside MuJoCo: what its soft contacts and ours have in common.

Its law of normal forces is another, so heights differ. How far things slide, where they tip and slip, and what carries
a weight are Coulomb's and the levers' alone.
"""

import numpy as np
import pytest

from tests.helpers import contact_pairs as scenes
from tests.helpers.contact_pairs import BOXES, HANDS, LOWER, ROUND, mean_friction
from tests.helpers.optional import needs

mujoco = needs("mujoco")
pytestmark = pytest.mark.slow

# Hard contacts, and friction that creeps little.
OPTION = '<option timestep="{dt}" gravity="{g}" cone="elliptic" impratio="100" tolerance="1e-12" iterations="200"/>'
DEFAULT = '<default><geom condim="3" friction="{mu} 0 0" solref="{t} 1" solimp=".99 .999 .001 .5 2"/></default>'


def _text(x):
    return " ".join(f"{c:.17g}" for c in np.ravel(x))


def _box_inertia(mass, size):
    I = mass / 12 * ((size**2).sum() - size**2)  # noqa: E741
    return f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{_text(I)}"/>'


def _spheres(positions, bits):
    return "".join(f'<geom type="sphere" size="{ROUND}" pos="{_text(p)}" {bits}/>' for p in positions)


def _simulated(text, qpos, qvel, force, steps):
    """(the model's coordinates and velocities after steps, the forces of all contacts in the world)."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = qpos, qvel, force
    for _ in range(steps):
        mujoco.mj_step(model, data)
    return data.qpos.copy(), data.qvel.copy()


def boxes(case, steps):
    """(q, v) of a case of BOXES. Friction of a contact is that of both surfaces here, and the larger one there."""
    (masses, *_, size, gravity), dt = case.numbers, 5e-4
    mu, ground = mean_friction(case.numbers), case.numbers.friction[0]
    # Bits by which the balls of the lower box touch the ground, and those of the upper one the lower box.
    text = f"""<mujoco>{OPTION.format(dt=dt, g=_text(gravity))}{DEFAULT.format(mu=mu, t=2.5 * dt)}<worldbody>
      <geom type="plane" size="9 9 1" contype="1" conaffinity="0" friction="{ground} 0 0"/>
      <body pos="0 0 0.1"><freejoint/>{_box_inertia(masses[0], LOWER)}
        <geom type="box" size="{_text(LOWER / 2)}" contype="2" conaffinity="0"/>
        {_spheres(scenes.corners(LOWER, (-1,)), f'contype="0" conaffinity="1" friction="{ground} 0 0"')}</body>
      <body pos="0 0 0.3"><freejoint/>{_box_inertia(masses[1], size)}
        {_spheres(scenes.corners(size, (-1,)), 'contype="0" conaffinity="2"')}</body>
    </worldbody></mujoco>"""
    q, v = case.state.q, case.state.v
    qpos = np.concatenate([q[4:7], q[:4], q[11:], q[7:11]])
    qvel = np.concatenate([v[3:6], v[:3], v[9:], v[6:9]])
    qpos[2], qpos[9] = LOWER[2] / 2, LOWER[2] + size[2] / 2
    qpos, qvel = _simulated(text, qpos, qvel, np.zeros(12), round(steps * case.dt / dt))
    return np.concatenate([qpos[3:7], qpos[:3], qpos[10:], qpos[7:10]]), qvel


def tilt(q):
    return 2 * np.arccos(min(1.0, abs(q[7])))


@pytest.mark.parametrize("name", ["slides", "stands", "tips", "sticks", "slips"])
def test_boxes_slide_and_tip_as_mujocos(name):
    case, steps = BOXES[name], 300
    own = scenes.rolled_out(scenes.two_bodies, [case], steps)
    q = own.q[0, -1]
    there, _ = boxes(case, steps)
    moved, moved_there = q[11] - case.state.q[11], there[11] - case.state.q[11]
    if name in ("slides", "slips"):
        assert moved > 0.02
        # On a slope a small difference of two forces moves it.
        np.testing.assert_allclose(moved, moved_there, rtol=0.05 if name == "slides" else 0.2)
    elif name == "sticks":
        assert max(abs(moved), abs(moved_there)) < 5e-3
    else:
        assert [tilt(x) > 0.05 for x in (q, there)] == [name == "tips"] * 2


@pytest.mark.parametrize("name", ["holds", "slips", "lifts", "lifts too fast"])
def test_hands_hold_as_mujocos(name):
    """What is held moves along, or falls behind by as much."""
    case, dt = HANDS[name], 2e-4
    (masses, *_, size, gravity), mu = case.numbers, mean_friction(case.numbers)
    finger = _box_inertia(masses[0], np.array([0.02, 0.02, 0.1]))
    tips = _spheres([[0, 0, -0.03], [0, 0, 0.03]], 'contype="0" conaffinity="1"')
    fingers = "".join(f'<body><joint type="slide" axis="0 {side} 0"/>{finger}{tips}</body>' for side in (1, -1))
    text = f"""<mujoco>{OPTION.format(dt=dt, g=_text(gravity))}{DEFAULT.format(mu=mu, t=2.5 * dt)}<worldbody>
      <body><joint type="slide" axis="0 0 1" damping="0.5"/>{finger}{fingers}</body>
      <body><freejoint/>{_box_inertia(masses[1], size)}
        <geom type="cylinder" size="{size[1] / 2} {size[2] / 2}" contype="1" conaffinity="0"/></body>
    </worldbody></mujoco>"""
    q = case.state.q
    qpos = np.concatenate([q[:3], q[7:], q[3:7]])
    qpos[1:3] = -(size[1] / 2 + ROUND)
    steps = 200
    qpos, _ = _simulated(text, qpos, np.zeros(9), case.state.tau, round(steps * case.dt / dt))
    own = scenes.rolled_out(scenes.hand, [case], steps, "cylinder").q[0, -1]
    behind, behind_there = own[0] - own[9], qpos[0] - qpos[5]
    if name in ("holds", "lifts"):
        assert max(abs(behind), abs(behind_there)) < 5e-4
    else:
        assert behind > 0.01
        np.testing.assert_allclose(behind, behind_there, rtol=0.2)
    np.testing.assert_allclose(own[9] - q[9], qpos[5] - q[9], rtol=0, atol=0.003)
