"""Draws notebooks/sensor.png, which points and axes a reading belongs to: `python -m tests.helpers.sensor_picture`."""

import pathlib

import matplotlib
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

FILE = pathlib.Path(__file__).parents[2] / "notebooks" / "sensor.png"
INK, LINK, LOAD = "#333333", "#c9ced6", "#f0dfc0"
READING, WEIGHT, CONTACT = "#1668b8", "#6b6b6b", "#c0392b"
# Positions in the picture.
SO, C, T = (2.55, 1.5), (4.25, 1.3), (6.6, 1.5)


def drawn():
    """The picture: the link on the left, the sensor on it, the load on the right."""
    figure = Figure(figsize=(8, 3.4))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 8), ylim=(-0.35, 3.05), aspect="equal")
    axes.axis("off")
    axes.add_patch(FancyBboxPatch((0.25, 1.1), 1.75, 0.8, "round,pad=0.05", fc=LINK, ec=INK))
    axes.add_patch(Rectangle((2.05, 0.95), 0.5, 1.1, fc="#9fb6d4", ec=INK))
    axes.add_patch(FancyBboxPatch((2.62, 0.7), 2.6, 1.6, "round,pad=0.05,rounding_size=0.25", fc=LOAD, ec=INK))
    axes.add_patch(Rectangle((5.28, 1.38), T[0] - 5.28, 0.24, fc=LOAD, ec=INK))
    _text(axes, 1.1, 1.5, "last link L", INK)
    _text(axes, 2.1, 0.72, "sensor", INK)
    _text(axes, 3.95, 0.45, "load", INK)
    for tip, name in (((3.3, 1.5), "z"), ((2.55, 0.15), "x")):
        _arrow(axes, SO, tip, INK, width=1.4)
        _text(axes, tip[0] + (0.12 if name == "z" else 0.14), tip[1] - (0.14 if name == "z" else -0.02), name, INK)
    _arrow(axes, SO, (SO[0], 2.75), READING)
    _text(
        axes,
        2.7,
        2.72,
        "reading $F_{So\\_S}$: on the load, by the robot,\nabout So, along the axes of S",
        READING,
        "left",
    )
    _arrow(axes, C, (C[0], -0.1), WEIGHT)
    _text(axes, C[0] + 0.12, 0.0, "weight m g, at C", WEIGHT, "left")
    _arrow(axes, (T[0], 0.35), T, CONTACT)
    _text(axes, T[0] + 0.12, 0.55, "contact, on\nthe load, at T", CONTACT, "left")
    axes.annotate("", T, SO, arrowprops={"arrowstyle": "->", "color": INK, "ls": (0, (4, 3)), "lw": 1, "shrinkB": 4})
    _text(axes, 5.95, 1.82, "$p_{ST\\_S}$", INK)
    for (x, y), name, dx, dy in ((SO, "So", -0.25, 0.24), (C, "C", 0.2, -0.04), (T, "T", 0.22, 0.12)):
        axes.add_patch(Circle((x, y), 0.055, fc=INK, ec="white", zorder=5))
        _text(axes, x + dx, y + dy, name, INK)
    return figure


def _arrow(axes, start, end, color, width=2.4):
    arrow = {"arrowstyle": "-|>", "color": color, "lw": width, "mutation_scale": 16, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=arrow)


def _text(axes, x, y, text, color, ha="center"):
    axes.text(x, y, text, color=color, ha=ha, va="center", fontsize=11)


def save(file):
    with matplotlib.rc_context({"mathtext.fontset": "dejavusans"}):
        drawn().savefig(file, dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    save(FILE)
