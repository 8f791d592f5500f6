"""Draws notebooks/closed_loops.png, by the code of that page: `python -m tests.helpers.linkage_picture`."""

import pathlib
import re

import jax
import matplotlib
import numpy as np
from matplotlib.figure import Figure

PAGES = pathlib.Path(__file__).parents[2] / "notebooks"
FILE = PAGES / "closed_loops.png"
INK, FAINT, GROUND = "#333333", "#b9c4d2", "#c9ced6"
CRANK, COUPLER, ROCKER, PATH = "#c0392b", "#1668b8", "#2a8a4a", "#8a6d1f"
# How far the crank is turned before the loop is closed again, rad: it turns back by some of that.
TURN, MOST = 0.1, 300


def scope():
    """The names of the first block of the page, once it has run."""
    names = {}
    exec(re.search(r"```python\n(.*?)```", (PAGES / "closed_loops.md").read_text(), re.S)[1], names)
    return names


def turned(names):
    """Closed configurations (k, 3), each of them near the one before, by which the crank goes around once."""
    js, linkage = names["js"], names["linkage"]
    close = jax.jit(lambda q: js.close_loops(linkage, q, linkage.loops).q)
    found = [names["q"]]
    while found[-1][0] < found[0][0] + 2 * np.pi and len(found) < MOST:
        found.append(close(found[-1] + np.float32([TURN, 0, 0])))
    return np.array(found)


def drawn(names):
    js, linkage = names["js"], names["linkage"]
    q = turned(names)
    frames = ("crank", "coupler", "coupler end", "rocker", "rocker end")
    p = np.asarray(js.forward_kinematics(linkage, q, frames).translation)[..., [0, 2]]
    middle = (p[:, 1] + p[:, 2]) / 2
    figure = Figure(figsize=(6, 3.4))
    axes = figure.add_axes((0, 0, 1, 1))
    for k in np.linspace(0, len(q) - 1, 9).astype(int):
        for a, b in ((0, 1), (1, 2), (3, 4)):
            axes.plot(*p[k, [a, b]].T, color=FAINT, lw=1, solid_capstyle="round")
    axes.plot(*middle.T, color=PATH, lw=1.5)
    for name, color, (a, b), aside in (
        ("crank", CRANK, (0, 1), (-0.12, -0.03)),
        ("coupler", COUPLER, (1, 2), (-0.02, 0.12)),
        ("rocker", ROCKER, (3, 4), (0.06, 0)),
    ):
        axes.plot(*p[0, [a, b]].T, color=color, lw=4, solid_capstyle="round")
        x, z = p[0, [a, b]].mean(0) + aside
        axes.text(x, z, name, color=color, fontsize=10, ha={"crank": "right", "rocker": "left"}.get(name, "center"))
    for i in (0, 3):
        axes.fill(p[0, i, 0] + np.array([0, -0.07, 0.07]), p[0, i, 1] - np.array([0, 0.1, 0.1]), color=GROUND, zorder=0)
    axes.plot(*p[0, [0, 1, 3]].T, "o", color="white", mec=INK, ms=6, zorder=4)
    pin = p[0, 2]
    axes.plot(*pin, "o", color=INK, ms=9, zorder=4)
    axes.annotate("the pin: a closure", pin, pin + [-0.15, 0.12], fontsize=10, color=INK, va="center")
    axes.text(-0.72, 0.66, "path of the\nmiddle of the coupler", fontsize=10, color=PATH)
    axes.set(aspect="equal", xlim=(-0.75, 1.9), ylim=(-0.62, 1.2))
    axes.axis("off")
    return figure


def save(file):
    with matplotlib.rc_context({"mathtext.fontset": "dejavusans"}):
        drawn(scope()).savefig(file, dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    save(FILE)
