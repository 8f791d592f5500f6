"""Draws notebooks/contact.png, by the code of notebooks/contact.md: `python -m tests.helpers.contact_picture`."""

import pathlib
import re

import jax
import matplotlib
import numpy as np
from matplotlib.figure import Figure

from jaxspatial import plot

PAGES = pathlib.Path(__file__).parents[2] / "notebooks"
FILE = PAGES / "contact.png"
INK, GROUND, BOX, DOG, FORCE = "#333333", "#c9ced6", "#f0dfc0", "#1668b8", "#c0392b"


def scope():
    """The names of the page, once it has run."""
    names = {}
    for block in re.findall(r"```python\n(.*?)```", (PAGES / "contact.md").read_text(), re.S):
        exec(block, names)
    return names


def drawn(names):
    figure = Figure(figsize=(9, 5.2))
    box = figure.add_axes((0.05, 0.53, 0.93, 0.42))
    dog = plot.axes(figure, figure.add_gridspec(1, 1, left=0.02, right=0.48, bottom=0.02, top=0.45)[0])
    gradients = figure.add_axes((0.56, 0.12, 0.42, 0.33))
    _box(box, names)
    _dog(dog, names)
    _gradients(gradients, names)
    return figure


def _ground(axes, left, right, below):
    axes.fill_between([left, right], [0, 0], [below, below], color=GROUND, lw=0)
    axes.set(aspect="equal", xlim=(left, right))
    axes.axis("off")


def _box(axes, names):
    """Its outline in the plane of motion, from the first to the last, and where it is pressed."""
    q, f = np.asarray(names["path"].q), np.asarray(names["path"].contact_forces.f)
    _ground(axes, -0.35, 1.35, -0.05)
    js, corners = names["js"], np.asarray(names["corners"])
    order = [0, 1, 3, 2, 0]
    steps = np.unique(np.round(np.array([0, 0.04, 0.08, 0.12, 0.17, 0.24, 0.36, 1.0]) * (len(q) - 1)).astype(int))
    for k in steps:
        X = js.RigidTransform(js.Rotation.from_quaternion(q[k, :4]), q[k, 4:])
        p = np.asarray(X @ corners)
        side = p[corners[:, 1] < 0][order]
        axes.fill(side[:, 0], side[:, 2], fc=BOX, ec=INK, lw=1, alpha=0.85)
        for point, force in zip(p, f[k], strict=True):
            if force[2] > 0:
                arrow = {"arrowstyle": "-|>", "color": FORCE, "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
                long = 0.25 * force / max(np.linalg.norm(force), 20)
                axes.annotate("", (point[0] + long[0], point[2] + long[2]), (point[0], point[2]), arrowprops=arrow)
    axes.set_title("a box, thrown along the ground: it slides, tips over and rests", fontsize=10, color=INK)


def _dog(axes, names):
    """With the forces on its feet."""
    q, mech, js = np.asarray(names["standing"].q)[-1], names["dog"], names["js"]
    feet = list(names["feet"].frames)
    plot.mechanism(mech, q, axes, ground=js.HalfSpace(), color=DOG)
    forces = jax.tree.map(lambda x: x[-1], names["standing"].contact_forces)
    plot.wrench(forces, js.forward_kinematics(mech, q, feet).translation, axes)
    axes.view_init(14, -62)
    axes.set_axis_off()
    axes.set_title("a quadruped that stands, and the forces on its feet", fontsize=10, color=INK)


def _gradients(axes, names):
    heights = np.asarray(names["heights"])
    for key, color, label in (("stiff", FORCE, "convex_step"), ("smooth", DOG, "contact_forces")):
        axes.plot(heights, np.asarray(names[key][0]), color=color, lw=1.2, label=label)
    axes.set_xlabel("dropped from, m", fontsize=8)
    axes.set_ylabel("height later, m", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=8, frameon=False)
    axes.set_title("each tooth is smooth, the whole is not", fontsize=10, color=INK)


def save(file):
    with matplotlib.rc_context({"mathtext.fontset": "dejavusans"}):
        drawn(scope()).savefig(file, dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    save(FILE)
