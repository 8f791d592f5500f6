"""Draws notebooks/robot.png, a robot with its wrenches: `python -m tests.helpers.robot_picture`."""

import importlib.metadata
import io
import pathlib
import warnings

import matplotlib
import numpy as np
import trimesh
from matplotlib import patheffects
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import proj3d
from PIL import Image

import jaxspatial as js
from jaxspatial import plot, viewer

FILE = pathlib.Path(__file__).parents[2] / "notebooks" / "robot.png"
INK, LIGHT = "#333333", np.array([0.35, -0.45, 0.82])
Q = np.pi * np.array([0.1, -0.2, 0.1, -0.7, 0.1, 0.6, 0.25])
T = "panda_hand_tcp"
# The load: the place of its middle from T, along its axes, its size, m, and its colour.
LOAD, SIZE, BOX = np.float32([0.0, 0.07, 0.03]), (0.06, 0.2, 0.06), (226, 188, 122, 255)
DPI = 125
FINE = 2  # pixels of the robot for one of the picture, along each side


def scene():
    """(the arm, its state, the shapes of its links and of the load, the weight about T, the torques of the motors)."""
    files = importlib.metadata.files("example-robot-data") or []
    path = pathlib.Path(next(file for file in files if file.name == "panda.urdf").locate())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", js.interop.ModelFileWarning)
        text = path.read_text().replace('type="prismatic"', 'type="fixed"')
        mech = js.Mechanism.from_urdf(text, dtype=np.float32)
    q = Q.astype(np.float32)
    p_TC_W = js.forward_kinematics(mech, q, T).rotation @ LOAD
    F_T_W = js.shift(js.SpatialForce(f=2 * mech.gravity), -p_TC_W)
    tau = js.inverse_dynamics(mech, q, 0 * q, 0 * q, {T: F_T_W})
    box = trimesh.creation.box(SIZE, trimesh.transformations.translation_matrix(LOAD))
    box.unmerge_vertices()  # edges are sharp
    box.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.SimpleMaterial(diffuse=BOX))
    return mech, q, {**viewer.meshes("viewer", mech, path), T: [box]}, F_T_W, np.asarray(tau)


def drawn(dpi=DPI):
    """The arm at rest with 2 kg in its hand: its torques, and the weight as a wrench about T."""
    mech, q, shapes, F_T_W, tau = scene()
    figure = Figure(figsize=(8.4, 5.6), dpi=dpi)
    FigureCanvasAgg(figure)
    # A square that is larger than the picture: nothing is cut off at its sides.
    ax = figure.add_axes((0, -0.25, 1, 1.5), projection="3d", computed_zorder=False)
    ax.view_init(14, -68)
    ax.set_axis_off()
    ax.patch.set_alpha(0)
    ax.set_proj_type("ortho")
    metres_per_newton = 0.011
    plot.torques(mech, q, tau, ax, scale=plot.Scales(metres_per_newton, 0.0035))
    p_WT = np.asarray(js.forward_kinematics(mech, q, T).translation)
    plot.wrench(F_T_W, p_WT, ax, axis=True)
    ax.set(xlim=(-0.13, 0.91), ylim=(-0.35, 0.45), zlim=(-0.06, 0.96))
    ax.set_aspect("equal")
    ax.set_box_aspect(ax.get_box_aspect(), zoom=1.09)
    halo = [patheffects.withStroke(linewidth=3, foreground="white")]
    write = {"fontsize": 11, "zorder": 10, "ha": "center", "va": "center", "path_effects": halo}
    joints = np.asarray(js.forward_kinematics(mech, q).translation)
    for i, (dx, dz) in {1: (0, -0.11), 2: (-0.1, -0.04), 3: (-0.13, 0.14), 5: (-0.09, -0.06)}.items():
        ax.text(*(joints[i] + [dx, 0, dz]), f"{abs(tau[i]):.0f} N m", color=plot.TORQUE, **write)
    ax.text(*(p_WT + [0, 0, metres_per_newton * F_T_W.f[2] - 0.03]), f"{-F_T_W.f[2]:.0f} N", color=plot.FORCE, **write)
    _explain(figure)
    ax.apply_aspect()
    figure.figimage(_rendered(ax, shapes, mech, q), origin="lower", zorder=-1)
    return figure


def _explain(figure):
    """What the arrows are, and the calls that they come from."""
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set(xlim=(0, 8.4), ylim=(0, 5.6))
    ax.axis("off")
    x = 5.62
    turn = np.linspace(-2.2, 2.6, 40)
    rows = (
        ("torques of the motors", "js.inverse_dynamics", plot.TORQUE),
        ("weight of the load", "js.SpatialForce", plot.FORCE),
    )
    rows += (("its central axis", "js.central_axis", plot.FORCE),)
    for y, (name, call, color) in zip((3.1, 2.45, 1.8), rows, strict=True):
        ax.text(x + 0.42, y + 0.12, name, fontsize=11.5, color=INK, va="center")
        ax.text(x + 0.42, y - 0.13, call, fontsize=9, color="#6a6f76", va="center", family="monospace")
        if "torques" in name:
            ax.plot(x + 0.16 * np.cos(turn), y + 0.16 * np.sin(turn), color=color, linewidth=2)
            ends = (x + 0.16 * np.cos(turn[-4:]), y + 0.16 * np.sin(turn[-4:]))
        else:
            ends = ((x, x), (y + 0.22, y - 0.22))
        if "axis" in name:
            ax.plot(*ends, color=color, linewidth=1.4, linestyle="--")
        else:
            arrow = {"arrowstyle": "-|>", "color": color, "lw": 2, "mutation_scale": 12, "shrinkA": 0, "shrinkB": 0}
            ax.annotate("", (ends[0][-1], ends[1][-1]), (ends[0][0], ends[1][0]), arrowprops=arrow)


def _rendered(ax, shapes, mech, q):
    """The robot as the axes project it, with its shadow on the ground: an image (height, width, 3), from below."""
    figure, projection = ax.figure, ax.get_proj()
    width, height = (int(round(FINE * side * figure.dpi)) for side in figure.get_size_inches())

    def pixels(p):
        x, y, depth = proj3d.proj_transform(*p.T, projection)
        x, y = np.round(FINE * ax.transData.transform(np.stack([x, y], -1))).astype(int).T
        inside = np.flatnonzero((0 <= x) & (x < width) & (0 <= y) & (y < height))
        # What is nearer comes later, and stays.
        inside = inside[np.argsort(-depth[inside])]
        return y[inside], x[inside], inside

    # To the viewer, and the distance of pixels.
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    x, y, depth = proj3d.proj_transform(*corners.T, projection)
    towards = depth[0] - depth[1:]
    towards = towards / np.linalg.norm(towards)
    step = 0.7 / (
        FINE * np.ptp(ax.transData.transform(np.stack([x, y], -1))[[0, 3], 1]) / np.sin(np.arccos(towards[2]))
    )

    X_WF = js.forward_kinematics(mech, q, list(shapes))
    links = [(mesh, X_WF.at_batch(k)) for k, meshes in enumerate(shapes.values()) for mesh in meshes]
    p, normals, colors = map(np.concatenate, zip(*(_samples(*link, towards, step) for link in links), strict=True))
    shadow = np.zeros((height, width))
    y, x, _ = pixels(p - p[:, 2:] / LIGHT[2] * LIGHT)
    shadow[y, x] = 1
    image = np.ones((height, width, 3)) * (1 - 0.28 * _blurred(_blurred(shadow, FINE), 8 * FINE)[..., None])
    # Light from one side and from the sky; what is seen from its side is darker, as it is at edges.
    shade = 0.42 + 0.38 * np.clip(normals @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
    shade += 0.1 * (1 + normals[:, 2]) / 2 + 0.12 * np.clip(normals @ towards, 0, 1)
    y, x, seen = pixels(p)
    image[y, x] = colors[seen] * shade[seen, None]
    image = image.reshape(height // FINE, FINE, width // FINE, FINE, 3).mean((1, 3))
    return (255 * np.clip(image, 0, 1)).astype(np.uint8)


def _samples(mesh, X, towards, step):
    """Points of what faces the viewer, at most a step apart, their normals and colours, in the world."""
    R, p = np.asarray(X.rotation.to_matrix(), float), np.asarray(X.translation, float)
    faces = mesh.faces[mesh.face_normals @ R.T @ towards > 0]
    corners, normals = mesh.vertices[faces], mesh.vertex_normals[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(1)
    parts = np.ceil(longest / step).astype(int)
    found = []
    for n in np.unique(parts):
        # Middles of small triangles, for a triangle smaller than a step its own.
        i, j = np.meshgrid(np.arange(n), np.arange(n))
        a = (np.stack([i, j, n - 1 - i - j], -1)[i + j < n] + 1 / 3) / n
        found.append([np.einsum("sk,nkx->nsx", a, part[parts == n]).reshape(-1, 3) for part in (corners, normals)])
    p_F, n_F = map(np.concatenate, zip(*found, strict=True)) if found else (np.zeros((0, 3)),) * 2
    material = getattr(mesh.visual, "material", None)
    color = np.array(material.main_color[:3]) / 255
    n_F = n_F / np.maximum(np.linalg.norm(n_F, axis=1, keepdims=True), 1e-12)
    return p + p_F @ R.T, n_F @ R.T, np.broadcast_to(0.12 + 0.86 * color, p_F.shape)


def _blurred(image, radius):
    """Three means over squares: about a Gaussian."""
    for _ in range(3):
        for axis in (0, 1):
            n = image.shape[axis]
            sums = np.cumsum(np.pad(image, [(radius + 1, radius) if k == axis else (0, 0) for k in (0, 1)]), axis)
            ahead, behind = (np.take(sums, np.arange(k, k + n), axis) for k in (2 * radius + 1, 0))
            image = (ahead - behind) / (2 * radius + 1)
    return image


def save(file, dpi=DPI):
    with matplotlib.rc_context({"mathtext.fontset": "dejavusans"}):
        paper = io.BytesIO()
        drawn(dpi).savefig(paper, dpi=dpi)
    # As few colours as make no difference to the eye: a third of the bytes.
    Image.open(paper).convert("RGB").quantize(128).save(file, optimize=True)


if __name__ == "__main__":
    save(FILE)
