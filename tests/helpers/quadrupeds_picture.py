"""Draws notebooks/quadrupeds.webp, 256 robots that are pushed, by the code of its page:
`python -m tests.helpers.quadrupeds_picture`."""

import io

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from PIL import Image

from tests.helpers.pages import FOLDER, run_page

FILE = FOLDER / "quadrupeds.webp"
STANDS, FALLS, LEG, SHADOW, PUSH = "#2f7fc1", "#e0521f", "#3b4148", "#d9dde2", "#a64ac9"
SIZE, DPI = (10, 430 / 88), 88  # inches, pixels per inch
EVERY = 10  # steps of 5 ms for a picture: 20 a second
SPACING = 0.75  # m
HALF = np.array([0.19, 0.07, 0.035])  # of the trunk, m
# To the right, and up, in the picture; of the world.
AZIMUTH, ELEVATION = np.deg2rad(-62), np.deg2rad(33)
RIGHT = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0])
UP = np.array([-np.sin(ELEVATION) * np.cos(AZIMUTH), -np.sin(ELEVATION) * np.sin(AZIMUTH), np.cos(ELEVATION)])
TOWARDS = np.cross(RIGHT, UP)


def drawn(names, dpi=DPI):
    """The pictures, one after the other."""
    js, solo = names["js"], names["solo"]
    path = np.asarray(names["path"], np.float32)  # (robots, steps, nq)
    legs = ("FL", "FR", "HL", "HR")
    joints = [f"{leg}_{part}" for leg in legs for part in ("UPPER_LEG", "LOWER_LEG", "FOOT")]
    X = js.forward_kinematics(solo, path[:, ::EVERY], ["base_link", *joints])
    R, p = np.asarray(X.rotation.to_matrix()), np.array(X.translation)
    falls = p[:, -1, 0, 2] < 0.15
    n = round(len(path) ** 0.5)
    places = SPACING * np.stack([*np.meshgrid(np.arange(n), np.arange(n), indexing="ij"), np.zeros((n, n))], -1)
    p = p + (places - places.mean((0, 1))).reshape(-1, 1, 1, 3)
    pushes = np.asarray(names["pushes"])
    last = int(names["PUSHED"])
    for k in range(p.shape[1]):
        yield _picture(R[:, k, 0], p[:, k], falls, pushes if EVERY * k <= last else None, dpi)


def _flat(x):
    return np.stack([x @ RIGHT, x @ UP], -1)


CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
FACES = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
NORMALS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])


def _picture(R, p, falls, pushes, dpi):
    figure = Figure(figsize=SIZE, dpi=dpi)
    FigureCanvasAgg(figure)
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    ax.set(xlim=(-8.8, 8.8), ylim=(-4.3, 4.3), aspect="equal")
    order = np.argsort(p[:, 0] @ TOWARDS)
    base, legs = p[:, 0], p[:, 1:].reshape(len(p), 4, 3, 3)
    corners = base[:, None] + np.einsum("nij,kj->nki", R, CORNERS * HALF)
    on_ground = corners * [1, 1, 0]
    ax.add_collection(PolyCollection(_flat(on_ground[:, [0, 2, 6, 4]]), facecolors=SHADOW, zorder=0))
    shade = 0.72 + 0.28 * np.clip(np.einsum("nij,kj,i->nk", R, NORMALS, np.array([0.2, -0.3, 0.93])), 0, 1)
    is_seen = np.einsum("nij,kj,i->nk", R, NORMALS, TOWARDS) > 0
    rgb = np.array([[int(c[i : i + 2], 16) / 255 for i in (1, 3, 5)] for c in (STANDS, FALLS)])[falls.astype(int)]
    for rank, i in enumerate(order):
        ax.add_collection(LineCollection(_flat(legs[i]), colors=LEG, linewidths=1.3, zorder=2 * rank + 1))
        faces = [_flat(corners[i, face]) for face, seen in zip(FACES, is_seen[i], strict=True) if seen]
        colors = [rgb[i] * s for s, seen in zip(shade[i], is_seen[i], strict=True) if seen]
        ax.add_collection(PolyCollection(faces, facecolors=colors, zorder=2 * rank + 2))
    if pushes is not None:
        ends = np.stack([base - 0.016 * pushes, base], 1)
        ax.add_collection(LineCollection(_flat(ends), colors=PUSH, linewidths=1.2, zorder=2 * len(p) + 3))
    paper = io.BytesIO()
    figure.savefig(paper, dpi=dpi)
    return Image.open(paper).convert("RGB")


def save(file, names, dpi=DPI):
    """names: all names of the page after it has run."""
    pictures = list(drawn(names, dpi))
    how = {"duration": [50] * (len(pictures) - 1) + [1500], "loop": 0, "quality": 40, "method": 4}
    pictures[0].save(file, save_all=True, append_images=pictures[1:], **how)


if __name__ == "__main__":
    save(FILE, run_page("quadrupeds.md", precision=None, as_read=True))
