"""Draws notebooks/frames.png, what the frames of a joint are: `python -m tests.helpers.frames_picture`."""

import numpy as np
from matplotlib.figure import Figure

from jaxspatial import plot
from tests.helpers.pages import FOLDER

FILE = FOLDER / "frames.png"
INK, PALE = "#333333", "#c5ccd4"


def _body(ax, at, angle, length, width):
    """A bar with round ends from a joint, and its centre of mass."""
    end = at + length * np.array([np.cos(angle), np.sin(angle)])
    ax.plot(*zip(at, end, strict=True), color=PALE, linewidth=width, solid_capstyle="round", zorder=1)
    return end


def _frame(ax, at, angle, name, away, length=0.42):
    for turn, color in ((0, plot.XYZ[0]), (np.pi / 2, plot.XYZ[2])):
        tip = at + length * np.array([np.cos(angle + turn), np.sin(angle + turn)])
        look = {"arrowstyle": "-|>", "color": color, "lw": 2, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
        ax.annotate("", tip, at, arrowprops=look, zorder=4)
    ax.plot(*at, "o", color=INK, markersize=6, zorder=5)
    ax.text(*(at + away), name, fontsize=11.5, color=INK, ha="center", va="center", zorder=6)


def drawn(dpi=110):
    figure = Figure(figsize=(8.4, 3.43), dpi=dpi)
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set(xlim=(-0.6, 7.0), ylim=(-0.6, 2.5), aspect="equal")
    ax.axis("off")
    ax.plot([-0.5, 6.9], [-0.25, -0.25], color=PALE, linewidth=1)
    W, A = np.array([0.0, -0.25]), np.array([1.3, 0.5])
    _frame(ax, W, 0.0, "W, the world", np.array([0.45, -0.22]))
    elbow = _body(ax, A, 0.55, 2.1, 38)
    hand = _body(ax, elbow, -0.35, 2.2, 28)
    _frame(ax, A, 0.55, 'B, frame of the body "upper"', np.array([1.35, -0.3]))
    _frame(ax, elbow, 0.55, 'P, of the joint "elbow" on its parent', np.array([-0.7, 0.62]))
    _frame(ax, elbow, -0.35, 'B, frame of the body "lower":\nwhere q is zero, it is P', np.array([2.1, 0.52]))
    _frame(ax, hand, -0.35, '"hand", a named frame', np.array([0.2, -0.42]))
    ax.annotate("", A + [-0.06, -0.02], W + [0.04, 0.05], arrowprops={"arrowstyle": "->", "color": INK, "ls": "--"})
    ax.text(0.36, 0.34, r"$X_{WB}$", fontsize=12, color=INK)
    turn = np.linspace(-0.35, 0.55, 20)
    ax.plot(elbow[0] + 0.75 * np.cos(turn), elbow[1] + 0.75 * np.sin(turn), color=plot.TORQUE, linewidth=2)
    ax.text(elbow[0] + 0.95, elbow[1] + 0.12, "q", fontsize=13, color=plot.TORQUE, ha="center", va="center")
    return figure


def save(file):
    drawn().savefig(file)


if __name__ == "__main__":
    save(FILE)
