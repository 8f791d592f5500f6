"""Shows robots in a browser, by viser: their shapes, a trajectory with a slider, wrenches and frames.

    from jaxspatial import viewer

    scene = viewer.show(mech, q, dt=0.01, shapes="panda.urdf")         # q: (n, nq); look at the address that it prints
    viewer.record(mech, q, "fall.html", dt=0.01, shapes="panda.urdf")  # one file, which needs no server

All bodies are where `forward_kinematics` puts them. It needs the extra `view`.
"""

import contextlib
import io
import pathlib
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from jaxspatial import _drawing
from jaxspatial._drawing import meshes, plane, spheres, surface, wrenches
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.mechanism import HalfSpace, Mechanism, PointContacts
from jaxspatial.numerics import check
from jaxspatial.numerics.types import ArrayLike
from jaxspatial.spatial import act_inverse

try:
    import viser
    import yourdfpy  # which `_drawing.meshes` needs  # noqa: F401
except ImportError as error:
    raise ImportError(
        "jaxspatial.viewer: needs the package viser[urdf]: from a clone, pip install '.[view]'"
    ) from error

__all__ = ["Scene", "record", "show"]

FORCE, TORQUE, BODY, GROUND = (
    tuple(bytes.fromhex(color[1:])) for color in (_drawing.FORCE, _drawing.TORQUE, _drawing.BODY, _drawing.GROUND)
)
Ground = HalfSpace | Callable[[jax.Array], Any]

# As shares of the size of the scene: the axes of a frame, the longest arrow, the largest heads of arrows and the radius
# of their shafts, and that of a point of contact.
_TRIAD, _LONGEST, _HEAD, _THICK, _POINT = 0.08, 0.35, 0.04, 0.006, 0.01
# Short arrows have smaller heads, as shares of the largest: shorter than its head, an arrow would seem to point from
# elsewhere.
_SMALLER = 1.0, 1 / 3, 1 / 9, 1 / 27
# The edge of the ground as a share too, and of its cells.
_GROUND, _CELL = 6.0, 0.25
_FRAMES_PER_SECOND = 30.0


def show(
    mech: Mechanism,
    q: ArrayLike,
    *,
    dt: float = 1 / 30,
    shapes: str | pathlib.Path | None = None,
    forces: ExternalForces = None,
    frames: Sequence[str] = (),
    ground: Ground | None = None,
    contacts: PointContacts | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
) -> "Scene":
    """Shows a robot in a browser, at one state or along a trajectory, with a slider and a box to let it play.

        scene = viewer.show(mech, path.q, dt=5e-3, forces=js.AppliedForces(feet.frames, path.contact_forces))

    The address is printed. The program goes on, and the page lives as long as it does: `scene.server.sleep_forever()`.

    Args:
        mech: the mechanism.
        q: (nq,) or (n, nq) coordinates of n states: rad, m, quaternions.
        dt: time from one state to the next, s.
        shapes: path of the URDF file whose visual meshes are shown; None shows for each body the solid box
            with its inertia.
        forces: wrenches shown as arrows, as `external_forces` have them: SpatialForces by name of a frame,
            AppliedForces, or a list of these, which act together. Each is one for all states, or (n,) of them: N m, N.
            Forces orange, torques purple along their axes. Of steps in a loop stack the forces:
            `jax.tree.map(lambda *x: np.stack(x), *forces)`.
        frames: names of `mech.frame_names`, shown as three axes with their names.
        ground: HalfSpace, shown as a grid, or a function from a point (3,) to its signed distance, shown where it is
            zero in a cube about the motion; None for none.
        contacts: PointContacts, one for all states, whose spheres are shown; points are as small ones.
        host: address to listen at; "0.0.0.0" lets other machines in.
        port: the first to try.

    Returns:
        The Scene: `scene.draw(i)` shows state i; `scene.server` is viser's, and `scene.server.stop()` ends it.

    Raises:
        FileNotFoundError: there is no such file of shapes.
        KeyError: there is no such frame, or the file has a link that is no frame of the mechanism.
        TypeError: an argument has another type.
        ValueError: shapes of arrays do not fit, the time is not above zero, there is no such port, the shapes are no
            URDF, or a ground function has no zero near by.

    Example:
        >>> from jaxspatial import viewer
        >>> scene = viewer.show(arm, q, frames=["hand"])
        >>> scene.server.stop()
        >>> print(scene.n)
        1
    """
    scene = Scene(mech, q, dt, shapes, forces, frames, ground, contacts, host, port)
    scene._add_player()
    return scene


def record(
    mech: Mechanism,
    q: ArrayLike,
    path: str | pathlib.Path,
    *,
    dt: float = 1 / 30,
    shapes: str | pathlib.Path | None = None,
    forces: ExternalForces = None,
    frames: Sequence[str] = (),
    ground: Ground | None = None,
    contacts: PointContacts | None = None,
) -> pathlib.Path:
    """Writes what `show` shows to one file that needs no server: a page that plays it, at 30 frames a second.

    Args:
        mech, q, dt, shapes, forces, frames, ground, contacts: as of `show`.
        path: where to write; ".html" makes a page with all it needs, some MB, dark where the browser or the page
            around it is; ".viser" the recording alone, for a client of viser that is there already.

    Returns:
        The path.

    Raises:
        FileNotFoundError: there is no such folder.
        ValueError: the path has another ending. Else as `show`.

    Example:
        >>> from jaxspatial import viewer
        >>> path = jnp.stack([0.0 * q, 0.5 * q, q])
        >>> print(viewer.record(arm, path, "arm.viser", dt=0.1))
        arm.viser
    """
    if not isinstance(path, str | pathlib.Path):
        check.refuse("viewer.record: path", "a path", path)
    path = pathlib.Path(path)
    if not path.parent.is_dir():
        raise FileNotFoundError(f"viewer.record: path: there is no folder {path.parent}")
    if path.suffix not in (".html", ".viser"):
        raise ValueError(f"viewer.record: path: expected one that ends in .html or .viser, got {path}")
    with contextlib.redirect_stdout(io.StringIO()):  # it has an address, for a while
        scene = Scene(mech, q, dt, shapes, forces, frames, ground, contacts, "127.0.0.1", 8080)
    try:
        recording = scene.server.get_scene_serializer()
        for i in scene.times() if scene.n > 1 else ():
            scene.draw(i)
            recording.insert_sleep(1 / _FRAMES_PER_SECOND)
        if path.suffix == ".html":
            # As viser writes it, but for its ground, which is white there or black, wherever the page is shown.
            page = recording.as_html().replace("_CONFIG__={darkMode:false}", f"_CONFIG__={{darkMode:{_IS_DARK}}}", 1)
            path.write_bytes(page.encode())
        else:
            path.write_bytes(recording.serialize())
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            scene.server.stop()
    return path


# Whether a page is dark: as the page that shows it in a frame, if that has a theme, or else as the browser is set.
_IS_DARK = (
    '(window.frameElement?.ownerDocument.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)")'
    '.matches ? "dark" : "light")) === "dark"'
)


class Scene:
    """What a browser shows of a robot, one state at a time; made by `show`.

    Attributes:
        server: viser's server, to add to the scene or to its panel.
        n: the number of states.
        dt: time from one state to the next, s.

    Example:
        >>> from jaxspatial import viewer
        >>> scene = viewer.show(arm, jnp.stack([0.0 * q, q]), dt=0.1)
        >>> scene.server.stop()
        >>> print(scene.n, scene.dt)
        2 0.1
    """

    def __init__(
        self,
        mech: Mechanism,
        q: ArrayLike,
        dt: float,
        shapes: str | pathlib.Path | None,
        forces: ExternalForces,
        frames: Sequence[str],
        ground: Ground | None,
        contacts: PointContacts | None,
        host: str,
        port: int,
    ):
        check.require_kind(mech, Mechanism, "viewer", " first")
        states = np.atleast_2d(np.asarray(q))
        if states.ndim != 2 or states.shape[1] != mech.nq or not len(states):
            raise ValueError(f"viewer: q: expected shape ({mech.nq},) or (n, {mech.nq}), got {np.shape(q)}")
        if ground is not None and not callable(ground):
            check.refuse(
                "viewer: ground", "a HalfSpace, or a function from a point (3,) to its signed distance", ground
            )
        flat = plane("viewer", ground) if isinstance(ground, HalfSpace) else None
        touching, centres, radii = (
            ((), np.zeros((0, 3)), np.zeros(0)) if contacts is None else spheres("viewer", contacts)
        )
        # viser tries one port after the other, and waits for ever where there is none of that number.
        if not isinstance(port, int) or isinstance(port, bool) or not 0 <= port < 2**16:
            raise ValueError(f"viewer: port: expected an integer from 0 to 65535, got {port!r}")
        self.n, self.dt = len(states), check.above_zero(dt, "viewer: dt")
        found = {} if shapes is None else meshes("viewer", mech, shapes)
        names = list(dict.fromkeys([*(mech.body_names if shapes is None else found), *frames, *touching]))
        self._wxyz, self._p = _poses(mech, states, names)
        arrows = _arrows(mech, states, forces)
        size = float(np.ptp(self._p[0], axis=0).max(initial=0.2))
        land = None if ground is None or flat else _land(ground, self._p, size, states.dtype)

        self.server: Any = viser.ViserServer(host=host, port=port, verbose=False)
        add = self.server.scene
        add.set_up_direction("+z")
        self._nodes = []
        for name in names:
            is_named = name in frames
            length = _TRIAD * size
            look: Any = {"show_axes": is_named, "axes_length": length, "axes_radius": 0.05 * length}
            self._nodes.append(add.add_frame(f"/robot/{_node(name)}", **look))
            for k, mesh in enumerate(found.get(name, ())):
                add.add_mesh_trimesh(f"/robot/{_node(name)}/shape {k}", mesh)
            if is_named:
                add.add_label(f"/robot/{_node(name)}/name", name)
        # Origins of bodies may lie closer together than the bodies are long.
        away = size + (_add_boxes(add, mech) / 2 if shapes is None else 0)
        _add_spheres(add, touching, centres, radii, size)
        self._arrows = [_Arrows(add, *given, size) for given in arrows]
        if flat is not None:
            _add_plane(add, *flat, size)
        elif land is not None:
            faces = np.arange(land.size // 3).reshape(-1, 3)
            look: Any = {"color": GROUND, "flat_shading": True, "side": "double", "opacity": 0.8}
            add.add_mesh_simple("/ground", land.reshape(-1, 3).astype(np.float32), faces, **look)
        self.server.initial_camera.position = self._p[0].mean(0) + away * np.array([0.8, -1.2, 0.4])
        self.server.initial_camera.look_at = self._p[0].mean(0)
        self.draw(0)

    def draw(self, i: int) -> None:
        """Shows state i.

        Example:
            >>> from jaxspatial import viewer
            >>> scene = viewer.show(arm, jnp.stack([0.0 * q, q]))
            >>> scene.draw(1)
            >>> scene.server.stop()
            >>> print(scene.n)
            2
        """
        with self.server.atomic():
            for node, wxyz, p in zip(self._nodes, self._wxyz[i], self._p[i], strict=True):
                node.wxyz, node.position = wxyz, p
            for arrows in self._arrows:
                arrows.draw(i)

    def times(self) -> np.ndarray:
        """The states to be seen at 30 frames a second: integers.

        Example:
            >>> from jaxspatial import viewer
            >>> scene = viewer.show(arm, jnp.zeros((10, 2)), dt=0.01)
            >>> scene.server.stop()
            >>> print(scene.times())
            [0 3 6]
        """
        step = 1 / (_FRAMES_PER_SECOND * self.dt)  # in states; a hair more than an integer is that integer
        return (np.arange(np.ceil(self.n / step - 1e-6)) * step + 1e-6).astype(int)

    def _add_player(self) -> None:
        """Adds a slider over the states, and a box that lets them play in real time, again and again."""
        if self.n == 1:
            return
        slider = self.server.gui.add_slider("state", min=0, max=self.n - 1, step=1, initial_value=0)
        plays = self.server.gui.add_checkbox("play", initial_value=False)
        slider.on_update(lambda _: self.draw(int(slider.value)))

        def play() -> None:
            while plays.value:
                for i in self.times()[np.searchsorted(self.times(), slider.value) % len(self.times()) :]:
                    if not plays.value:
                        return
                    slider.value = int(i)  # which draws
                    time.sleep(1 / _FRAMES_PER_SECOND)
                slider.value = 0

        @plays.on_update
        def _(_: Any) -> None:
            if plays.value:
                threading.Thread(target=play, daemon=True).start()


# -- shapes -----------------------------------------------------------------------------------------------------------


def _add_boxes(add: Any, mech: Mechanism) -> float:
    """The solid box with each inertia, on its body; returns the longest edge of all."""
    M = act_inverse(mech.child_placements, mech.inertias, precision="fast")  # M_BBo_B
    edges, R_BE = M.equivalent_box(precision="fast")
    parts = np.asarray(edges), np.asarray(R_BE.to_quaternion(precision="fast")), np.asarray(M.com)
    longest = 0.0
    for name, sides, wxyz, com in zip(mech.body_names, *parts, strict=True):
        if np.isfinite(sides).all() and sides.any():
            # Flat and thin ones can be seen, too.
            seen = tuple(np.maximum(sides, 0.02 * sides[0]).tolist())
            add.add_box(f"/robot/{_node(name)}/shape", BODY, seen, opacity=0.7, wxyz=wxyz, position=com)
            longest = max(longest, seen[0])
    return longest


def _add_spheres(add: Any, frames: Sequence[str], centres: np.ndarray, radii: np.ndarray, size: float) -> None:
    """The spheres of contacts, on their frames."""
    for k, (name, at, r) in enumerate(zip(frames, centres, radii.tolist(), strict=True)):
        radius = max(r, _POINT * size)
        add.add_icosphere(f"/robot/{_node(name)}/contact {k}", radius=radius, color=FORCE, position=at, opacity=0.8)


def _node(name: str) -> str:
    """A name for viser, to which "/" begins that of a child."""
    return name.replace("/", "_")


def _poses(mech: Mechanism, q: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Quaternions (n, k, 4) and positions (n, k, 3) of frames."""
    X_WF = forward_kinematics(mech, q, list(names), precision="fast")
    return np.asarray(X_WF.rotation.to_quaternion(precision="fast")), np.asarray(X_WF.translation)


def _add_plane(add: Any, normal: np.ndarray, offset: float, size: float) -> None:
    # The quaternion that turns z to the normal, the short way.
    x, y, z = normal
    wxyz = np.array([0.0, 1.0, 0.0, 0.0] if z < -1 + 1e-12 else [1 + z, -y, x, 0.0])
    place: Any = {"wxyz": wxyz / np.linalg.norm(wxyz), "position": normal * offset}
    edge = _GROUND * size
    add.add_grid("/ground", width=edge, height=edge, cell_size=_CELL * size, section_size=size, **place)


def _land(ground: Callable[[jax.Array], Any], p: np.ndarray, size: float, dtype: Any) -> np.ndarray:
    """The triangles (n, 3, 3) of a ground function about all places p (n, k, 3), of at most 80 cells along an edge."""
    low, high = p.min((0, 1)), p.max((0, 1))
    edge = max(_GROUND * size, 1.5 * float((high - low).max()))
    cells = min(int(np.ceil(edge / (_CELL * size))), 80)
    return surface("viewer", ground, (low + high) / 2, edge, cells, jax.dtypes.canonicalize_dtype(dtype))


# -- arrows -----------------------------------------------------------------------------------------------------------


def _arrows(mech: Mechanism, q: np.ndarray, forces: ExternalForces) -> list[tuple[str, np.ndarray, np.ndarray, Any]]:
    """(name, points (n, m, 3), vectors (n, m, 3), colour) of the forces and of the torques, in world axes."""
    placed = wrenches("viewer", mech, q, forces)
    kinds = () if placed is None else (("forces", placed.f, FORCE), ("torques", placed.tau, TORQUE))
    return [(name, placed.p, x, color) for name, x, color in kinds if placed and (np.isfinite(x) & (x != 0)).any()]


class _Arrows:
    """Arrows of one kind and colour, over time. The longest of all times takes a third of the scene; those shorter than
    a two hundredth of it are left out."""

    def __init__(self, add: Any, name: str, points: Any, vectors: Any, color: Any, size: float):
        lengths = np.linalg.norm(vectors, axis=-1)
        scale = _LONGEST * size / lengths.max(where=np.isfinite(lengths), initial=0)
        self.ends = np.stack([points, points + scale * vectors], axis=-2)
        # viser has heads of one size in each of its objects.
        heads = _HEAD * size * np.array(_SMALLER)
        self.sizes = (scale * lengths[..., None] <= heads).sum(-1)  # as many as there are heads: it is left out
        self.sizes[~np.isfinite(lengths)] = len(heads)
        self.handles = []
        for k, share in enumerate(_SMALLER):
            thick, head = share * _THICK * size, share * _HEAD * size
            look: Any = {"shaft_radius": thick, "head_radius": 2.5 * thick, "head_length": head}
            self.handles.append(add.add_arrows(f"/{name}/{k}", self.ends[0], color, **look))

    def draw(self, i: int) -> None:
        """Shows those of state i."""
        for k, handle in enumerate(self.handles):
            has_size = self.sizes[i] == k
            handle.visible = bool(has_size.any())
            if handle.visible:
                handle.points = self.ends[i][has_size]
