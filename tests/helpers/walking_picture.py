"""Draws notebooks/walking.png, by the code of its page: `python -m tests.helpers.walking_picture`, in minutes."""

import jax
import numpy as np
from matplotlib import pyplot

from tests.helpers.pages import FOLDER, run_page

FILE = FOLDER / "walking.png"
INK, REWARD, SPEED, PALE = "#333333", "#1668b8", "#c0392b", "#9aa3ad"


def walk(names, steps=200, seed=3):
    """The path (steps, nq) of one robot, without chance in its actions."""
    js, agent = names["js"], names["agent"]

    def act(robot, _):
        action = names["outputs"](agent["actor"], names["seen"](robot))
        # No key draws the end of its time.
        after, *_ = names["step"](robot, action, jax.random.key(0))
        return after, after["q"]

    with js.default_precision("fast"):
        path = jax.jit(lambda robot: jax.lax.scan(act, robot, None, steps)[1])
        return np.asarray(path(names["fresh"](jax.random.key(seed))))


def drawn(names, path):
    """Reward and speed by update, and the robot from its side."""
    figure = pyplot.figure(figsize=(9, 3.2))
    curve = np.asarray(names["curve"])
    left = figure.add_axes((0.07, 0.16, 0.34, 0.74))
    left.plot(curve[:, 0], color=REWARD, label="reward, mean of all robots")
    left.plot(curve[:, 2], color=SPEED, label="speed, m/s")
    left.axhline(names["SPEED"], color=SPEED, linestyle=":", linewidth=1)
    left.set(xlabel="update")
    left.legend(frameon=False, loc="lower right", fontsize=8)
    left.spines[["top", "right"]].set_visible(False)
    side = figure.add_axes((0.44, 0.16, 0.55, 0.74))
    js, legs = names["js"], ("FL", "FR", "HL", "HR")
    frames = [f"{leg}_{part}" for leg in legs for part in ("UPPER_LEG", "LOWER_LEG", "FOOT")]
    p = np.asarray(js.forward_kinematics(names["solo"], path[:: len(path) // 5], frames).translation)[..., [0, 2]]
    for legs_then in p.reshape(len(p), 4, 3, 2):
        side.plot(*legs_then[[0, 2], 0].T, color=INK, linewidth=5, solid_capstyle="round")
        for k, leg in enumerate(legs_then):
            side.plot(*leg.T, color=(REWARD, PALE)[k % 2], linewidth=2, zorder=2 - k % 2)
    side.axhline(0, color="#8a94a0", linewidth=1)
    side.set(aspect="equal", xlabel="m", yticks=[], title="the robot, every 0.8 s; legs of the left blue")
    side.title.set_fontsize(9)
    side.spines[["top", "right", "left"]].set_visible(False)
    return figure


def save(file, names):
    figure = drawn(names, walk(names))
    figure.savefig(file, dpi=110, metadata={"Software": None})
    pyplot.close(figure)


if __name__ == "__main__":
    save(FILE, run_page("walking.md", precision=None, as_read=True))
