"""Draws notebooks/robot.png, a robot with its wrenches: `python -m tests.helpers.robot_picture`."""

import importlib.metadata
import io
import pathlib
import tempfile
import warnings

import matplotlib
import numpy as np
from matplotlib import pyplot
from matplotlib.lines import Line2D
from PIL import Image

import jaxspatial as js
from jaxspatial import plot

FILE = pathlib.Path(__file__).parents[2] / "notebooks" / "robot.png"
Q = np.pi * np.array([0.1, -0.2, 0.1, -0.7, 0.1, 0.6, 0.25])
T = "panda_hand_tcp"
# The place of the middle of the load from T, along its axes, its size, m, and its colour.
LOAD, SIZE, BOX = np.float32([0.0, 0.07, 0.03]), (0.06, 0.2, 0.06), (0.89, 0.74, 0.48)
VISUAL = f"""<link name="load"><visual><geometry><box size="{SIZE[0]} {SIZE[1]} {SIZE[2]}"/></geometry>
  <material name="wood"><color rgba="{BOX[0]} {BOX[1]} {BOX[2]} 1"/></material></visual></link>
<joint name="grip" type="fixed"><parent link="{T}"/><child link="load"/>
  <origin xyz="{LOAD[0]} {LOAD[1]} {LOAD[2]}"/></joint></robot>"""
DPI = 125


def scene():
    """(the arm, its state, the text of its file, the weight about T, the torques of the motors)."""
    files = importlib.metadata.files("example-robot-data") or []
    path = pathlib.Path(next(file for file in files if file.name == "panda.urdf").locate())
    text = path.read_text().replace('type="prismatic"', 'type="fixed"').replace("</robot>", VISUAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", js.interop.ModelFileWarning)
        mech = js.Mechanism.from_urdf(text, dtype=np.float32)
    q = Q.astype(np.float32)
    p_TC_W = js.forward_kinematics(mech, q, T).rotation @ LOAD
    F_T_W = js.shift(js.SpatialForce(f=2 * mech.gravity), -p_TC_W)
    tau = js.inverse_dynamics(mech, q, 0 * q, 0 * q, {T: F_T_W})
    return mech, q, text.replace("package://", f"{path.parents[4]}/"), F_T_W, tau


def drawn(dpi=DPI):
    """The arm at rest with 2 kg in its hand: its torques, and the weight as a wrench about T."""
    mech, q, text, F_T_W, tau = scene()
    figure = pyplot.figure(figsize=(8.4, 5.6), dpi=dpi)
    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        print(text, file=file, flush=True)
        ax = plot.mechanism(mech, q, plot.axes(figure), shapes=file.name, ground=js.HalfSpace())
    plot.torques(mech, q, tau, ax, scale=plot.Scales(0.011, 0.0035), numbers=True)
    plot.wrench(F_T_W, js.forward_kinematics(mech, q, T).translation, ax, name="20 N")
    ax.view_init(14, -68)
    ax.set_axis_off()
    ax.set_position((0, 0, 0.76, 1))
    shown = {gid: next(line for line in ax.lines if line.get_gid() == gid) for gid in ("torque", "central axis")}
    arrow = Line2D([], [], color=plot.FORCE, marker=11, markevery=[0], linewidth=2)
    rows = {"motors: js.inverse_dynamics": shown["torque"], "weight of the load: js.SpatialForce": arrow}
    rows |= {"its central axis: js.central_axis": shown["central axis"]}
    figure.legend(rows.values(), rows, loc="center right", frameon=False, fontsize="small")
    return figure


def save(file, dpi=DPI):
    with matplotlib.rc_context({"font.size": 12.5}):
        paper = io.BytesIO()
        drawn(dpi).savefig(paper, dpi=dpi)
    # As few colours as make no difference to the eye: a third of the bytes.
    Image.open(paper).convert("RGB").quantize(256, kmeans=3).save(file, optimize=True)


if __name__ == "__main__":
    save(FILE)
