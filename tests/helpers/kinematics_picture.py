"""Draws notebooks/inverse_kinematics.png, by the code of its page: `python -m tests.helpers.kinematics_picture`."""

import pathlib

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from jaxspatial import plot
from tests.helpers.pages import FOLDER, run_page

FILE = FOLDER / "inverse_kinematics.png"
INK, ARM, HAND, PALE = "#333333", "#1668b8", "#c0392b", "#9aa3ad"
NAMES = ("all terms", "without mu", "without a posture")


def drawn(names):
    figure = Figure(figsize=(9, 3.1))
    _swing(plot.axes(figure, figure.add_gridspec(1, 1, left=0.01, right=0.31, bottom=0.03, top=0.84)[0]), names)
    _circle(figure.add_axes((0.37, 0.15, 0.27, 0.72)), names)
    _errors(figure.add_axes((0.74, 0.15, 0.24, 0.72)), names)
    return figure


def _origins(names, q):
    """(n, frames, 3) of the links and of the hand, of configurations (n, 7)."""
    js, panda = names["js"], names["panda"]
    return np.asarray(js.forward_kinematics(panda, q, ("panda_link0", *panda.body_names, names["HAND"])).translation)


def _swing(axes, names):
    """The arm between the first configuration and the last, while its hand stays."""
    q = np.asarray(names["path"])
    shown = q[np.linspace(0, len(q) - 1, 6).astype(int)]
    for k, p in enumerate(_origins(names, shown)):
        axes.plot(*p.T, color=PALE if k == 0 else ARM, lw=3, alpha=1 if k in (0, 5) else 0.2)
    axes.scatter(*p[-1], color=HAND, s=30, depthshade=False)
    axes.set(xlim=(-0.3, 0.3), ylim=(-0.45, 0.15), zlim=(0, 0.8), xticks=[], yticks=[], zticks=[0, 0.5])
    axes.set_box_aspect((0.6, 0.6, 0.8))
    axes.tick_params(labelsize=7)
    axes.set(xlabel="", ylabel="")
    axes.set_zlabel("z, m", fontsize=8)
    gained = float(names["gained"])
    axes.set_title(f"the hand stays: {gained:.1f} times\nthe manipulability", fontsize=9, color=INK)


def _circle(axes, names):
    """What hand and elbow draw, seen from the front: with a posture, and without."""
    moved = np.asarray(names["moved"])[:, ::10]
    for k, color in ((2, PALE), (0, ARM)):
        p = _origins(names, moved[k].reshape(-1, 7))
        axes.plot(p[:, 4, 1], p[:, 4, 2], color=color, lw=1.2, label="elbow, " + ("no posture" if k else "all terms"))
        axes.plot(p[:, -1, 1], p[:, -1, 2], color=HAND, lw=1.2, label=None if k else "hand")
    axes.set(aspect="equal")
    axes.set_xlabel("y, m", fontsize=8)
    axes.set_ylabel("z, m", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=7, frameon=False)
    axes.set_ylim(0.1, 0.78)
    axes.set_title("a circle, seen from the front", fontsize=9, color=INK)


def _errors(axes, names):
    distance = 1e3 * np.asarray(names["distance"])
    times = names["DT"] * np.arange(distance.shape[1])
    for d, color, name in zip(distance, (ARM, HAND, PALE), NAMES, strict=True):
        axes.semilogy(times[10:], d[10:], color=color, lw=1.2, label=name)
    axes.set_ylim(1e-2, 10)
    axes.set_xlabel("time, s", fontsize=8)
    axes.set_ylabel("mm", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.legend(fontsize=7, frameon=False, loc="lower right")
    axes.set_title("error of the hand", fontsize=9, color=INK)


def save(file: pathlib.Path, names=None):
    """names: those of the page, where it has run already."""
    names = names or run_page("inverse_kinematics.md")
    with matplotlib.rc_context({"mathtext.fontset": "dejavusans"}):
        drawn(names).savefig(file, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    save(FILE)
