"""Draws robots, frames, wrenches and inertias in 3-D axes of matplotlib.

    from jaxspatial import plot

    ax = plot.mechanism(mech, q)
    plot.torques(mech, q, js.gravity_forces(mech, q), ax)
    plot.wrench(F_T_W, p_WT, ax)
    plot.scale_bars(ax)

Every function draws in the axes that it is given, or in new ones, and returns them. Positions are in metres, in world
axes. Colours can be read on white and on black. A function draws one state: of a batch, pass one item. It needs the
extra `plot`.
"""

import pathlib
import weakref
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxspatial._drawing import (
    BODY,
    FORCE,
    GROUND,
    INERTIA,
    JOINT,
    TORQUE,
    XYZ,
    meshes,
    plane,
    spheres,
    surface,
    wrenches,
)
from jaxspatial.dynamics.kinematics import forward_kinematics
from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.inertia import SpatialInertia
from jaxspatial.mechanism import HalfSpace, Mechanism, PointContacts
from jaxspatial.numerics import check
from jaxspatial.numerics.types import ArrayLike
from jaxspatial.spatial import RigidTransform, SpatialForce, central_axis

try:
    from matplotlib import patheffects, pyplot
    from matplotlib.artist import Artist
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec
    from matplotlib.image import BboxImage
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path
    from matplotlib.text import Text
    from matplotlib.ticker import MaxNLocator, MultipleLocator
    from matplotlib.transforms import Bbox, IdentityTransform, ScaledTranslation
    from mpl_toolkits.mplot3d import Axes3D, proj3d
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection
except ImportError as error:
    raise ImportError("jaxspatial.plot: needs the package matplotlib: from a clone, pip install '.[plot]'") from error

__all__ = ["Arrow", "Scales", "axes", "forces", "frame", "inertia", "mechanism", "scale_bars", "scales", "torques"]
__all__ += ["wrench"]

# From the back to the front, in axes of our own: there the order of drawing is this one.
_PLANE, _SOLID, _BODY, _JOINT, _ARROW, _FRAME = range(1, 7)
# Lengths as shares of the size of the scene: the axes of a frame, the longest arrow, the largest arc, the shortest.
_TRIAD, _LONGEST, _WIDEST, _LEAST = 0.1, 0.3, 0.09, 0.01
# The margin of axes within their place, and the room between labels of ticks and of axes, points.
_MARGIN, _GAP = 4.0, 3.0
# How often what is drawn is fitted into its place: labels keep their size, so that once is not enough.
_FITS = 3
# The least edge of the ground, and how far it reaches beyond the robot, as shares too: more would make the robot small.
_GROUND, _BEYOND = 0.6, 0.05
# Its squares along the longest edge of the scene, and the cells of a ground function.
_SQUARES, _CELLS = 6, 24
# The length of a head of matplotlib's arrow style, over its scale.
_HEAD = 0.4
# Between a text and what it names, points.
_BESIDE = 4.0
# To the light; pixels of meshes for one of the picture, along each side.
_LIGHT = np.array([0.35, -0.45, 0.82])
_FINE = 2
# An arc has a gap, so that one sees which way it turns.
_TURN = np.linspace(0.0, np.deg2rad(290.0), 60)


class Scales(NamedTuple):
    """How large arrows are drawn. force: metres of arrow per N. torque: metres of an arc's radius per N m.

    Example:
        >>> from jaxspatial import plot
        >>> ax = plot.wrench(F, [0.0, 0.0, 0.0], scale=plot.Scales(force=0.5, torque=0.25))
        >>> print(plot.scales(ax))
        Scales(force=0.5, torque=0.25)
    """

    force: float | None = None
    torque: float | None = None


class _Axes(Axes3D):
    """3-D axes in which all that is drawn is as large as their place allows, with its labels."""

    def apply_aspect(self, position: Any = None) -> None:
        """The whole place: those of matplotlib take a square of it."""
        axes: Any = self
        axes._set_position(self.get_position(original=True) if position is None else position, "active")

    def draw(self, renderer: Any) -> None:
        """Fits what is drawn into its place, and draws; figures call it."""
        if not self.get_visible():
            return
        labels = [axis.label for axis in self._shown()]
        for label in labels:
            label.set_visible(False)  # it is placed and drawn here
        for _ in range(_FITS):
            self._fit(renderer)
        super().draw(renderer)
        for label in labels:
            label.set_visible(True)
            label.draw(renderer)

    def _shown(self) -> list[Any]:
        axes = (self.xaxis, self.yaxis, self.zaxis)
        return [axis for axis in axes if self._axis3don and axis.get_visible()]

    def _fit(self, renderer: Any) -> None:
        """Moves and scales the projection so that all that is drawn, and its labels, fill the place."""
        self.apply_aspect()
        self.M: Any = self.get_proj()
        self.invM = np.linalg.inv(self.M)
        limits = np.array([self.get_xlim(), self.get_ylim(), self.get_zlim()])
        corners = np.stack(np.meshgrid(*limits), -1).reshape(-1, 3)
        x, y, z = corners.T
        projected = np.stack(proj3d.proj_transform(x, y, z, self.M)[:2], -1)
        labels: list[Any] = [text for text in self.texts if isinstance(text, _Label) and text.get_visible()]
        with renderer._draw_disabled():
            for artist in (*labels, *self._shown()):
                artist.draw(renderer)
        around = [text.get_window_extent(renderer) for text in labels]
        for axis in self._shown():
            around += _place_label(axis, renderer)
        inner = Bbox.null()
        inner.update_from_data_xy(self.transData.transform(projected))
        outer = Bbox.union([inner, *around])
        beyond = np.array([np.subtract(inner.min, outer.min), np.subtract(outer.max, inner.max)])
        margin = _MARGIN * self.figure.dpi / 72
        pixels = np.array(self.bbox.size)
        room = pixels - 2 * margin - beyond.sum(0)
        size = np.ptp(projected, axis=0)
        # Pixels for one unit of the projection.
        scale = max((room / np.maximum(size, 1e-9)).min(), 1e-3)
        low = projected.min(0) - (margin + beyond[0] + (room - scale * size) / 2) / scale
        high = low + pixels / scale
        self.viewLim.intervalx, self.viewLim.intervaly = zip(low, high, strict=True)


def _place_label(axis: Any, renderer: Any) -> list[Bbox]:
    """Moves the name of an axis beside the numbers on it; returns where these are, and the name."""
    ticks = axis.get_major_ticks()
    low, high = sorted(axis.get_view_interval())
    numbers = [tick.label1.get_window_extent(renderer) for tick in ticks if low <= tick.get_loc() <= high]
    numbers = [box for box in numbers if box.width]
    ends = axis.line.get_transform().transform(axis.line.get_xydata())
    middle, along = ends.mean(0), ends[1] - ends[0]
    axes, label = axis.axes, axis.label
    away = np.array([along[1], -along[0]]) / max(np.hypot(*along), 1e-9)
    beside = np.mean([box.get_points().mean(0) for box in numbers], axis=0) if numbers else middle + away
    away = away if away @ (beside - middle) >= 0 else -away
    reach = max((((box.corners() - middle) @ away).max() for box in numbers), default=0.0)
    label.set_visible(True)
    size = np.array(label.get_window_extent(renderer).size)
    at = middle + (reach + abs(away) @ size / 2 + _GAP * axes.figure.dpi / 72) * away
    label.set(position=axes.transData.inverted().transform(at), ha="center", va="center")
    name = label.get_window_extent(renderer)
    label.set_visible(False)
    return [*numbers, name]


# -- what users call --------------------------------------------------------------------------------------------------


def axes(figure: Figure | None = None, place: tuple[int, int, int] | SubplotSpec = (1, 1, 1)) -> Axes3D:
    """Makes 3-D axes in the style of this module: in metres, with equal steps, arrows in front of robots.

    What is drawn in them is as large as their place allows, with all labels: on a screen and in a column of a paper,
    and from every side.

        figure = plt.figure(figsize=(12, 5))
        ax = plot.mechanism(mech, q, plot.axes(figure, (1, 2, 1)))

    Args:
        figure: where; None makes a new one.
        place: rows, columns and number of the axes in the figure, or a part of a grid, as of `figure.add_subplot`.

    Returns:
        The axes. Other 3-D axes serve as well.

    Raises:
        ValueError: there is no such place.

    Example:
        >>> from jaxspatial import plot
        >>> plot.axes().get_xlabel()
        'x, m'
    """
    style: Any = {"axes_class": _Axes, "computed_zorder": False}
    with pyplot.rc_context({"grid.color": f"{GROUND}60", "grid.linewidth": 0.6}):
        figure = pyplot.figure(figsize=(6.5, 6)) if figure is None else figure
        if place == (1, 1, 1):
            ax: Any = figure.add_axes((0, 0, 1, 0.94), **style)  # with room for a title
        else:
            ax = figure.add_subplot(*(place if isinstance(place, tuple) else (place,)), **style)
    ax.set(xlabel="x, m", ylabel="y, m", zlabel="z, m")
    ax.view_init(20, -50)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_pane_color((0, 0, 0, 0))
        axis.line.set_color(GROUND)
        axis.set_rotate_label(False)
    ax.tick_params(labelsize="small")
    return ax


def mechanism(
    mech: Mechanism,
    q: ArrayLike,
    ax: Axes3D | None = None,
    *,
    frames: Sequence[str] | None = None,
    ground: HalfSpace | Callable[[jax.Array], Any] | None = None,
    shapes: str | pathlib.Path | None = None,
    contacts: PointContacts | None = None,
    color: str = BODY,
) -> Axes3D:
    """Draws a robot: its bodies as lines between the origins of its joints, its joints as dots; or its shapes.

    A line leads from each joint to the joints of the next bodies, and from the origin of the world to the joints that
    stand on it, "free" ones excepted.

    Args:
        mech: the mechanism.
        q: (nq,) coordinates: rad, m, quaternions.
        ax: 3-D axes; None makes new ones.
        frames: names of `mech.frame_names`. Each is drawn with a line from the joint of its body, three axes and its
            name, in this order. None draws a line to the tip of each body without children: the frame that is farthest
            from the joint, or else the centre of mass.
        ground: HalfSpace, drawn as a part of its plane, or a function from a point (3,) to its signed distance, drawn
            in a cube about the point of it next to the robot; None for none.
        shapes: path of the URDF file whose visual meshes are drawn in place of lines and dots, in the colours of the
            file, with their shadow on the ground where that is a plane; 100 000 triangles take a second or two. It
            needs the extra `view`. None draws lines and dots.
        contacts: PointContacts, whose centres are drawn as rings; None for none.
        color: of the bodies.

    Returns:
        The axes. Each line has the name of the body or frame at its end, `line.get_gid()`; the dots are "joints", the
        meshes "shapes", the rings "contacts".

    Raises:
        FileNotFoundError: there is no such file of shapes.
        KeyError: there is no such frame; lists those there are.
        TypeError: an argument has another type.
        ValueError: mech, q or the ground is a batch, q has another size, or a ground function has no zero near by.

    Example:
        >>> from jaxspatial import plot
        >>> ax = plot.mechanism(arm, q, frames=["hand"])
        >>> [line.get_gid() for line in ax.lines]
        ['lower', 'joints', 'hand', 'hand x', 'hand y', 'hand z']
    """
    ax, X_WJ = _axes("plot.mechanism", ax), _joints("plot.mechanism", mech, q)
    solid = None
    frames = None if frames is None else check.as_tuple(frames, str, "plot.mechanism: frames", "names")
    X_WF = _frames(mech, X_WJ)
    if shapes is not None:
        solid = _solids(ax, mech, q, meshes("plot.mechanism", mech, shapes))
    else:
        _sticks(ax, mech, X_WJ, X_WF, color, has_tips=frames is None)
    numbers = [mech.topology.index(mech.frame_names, name, "plot.mechanism: frames") for name in frames or ()]
    for k in numbers:
        name, body = mech.topology.frames[k]
        _line(ax, X_WJ.p[body] if body >= 0 else np.zeros(3), X_WF.p[k], color, name)
    if contacts is not None:
        names, centres, _ = spheres("plot.mechanism", contacts)
        X_WC = _state_poses(mech, q, names)
        p = X_WC.p + np.einsum("nij,nj->ni", X_WC.R, centres)
        look: Any = {"markerfacecolor": "none", "markeredgewidth": 2, "color": FORCE, "zorder": _ARROW}
        ax.plot(*p.T, linestyle="", marker="o", markersize=8, gid="contacts", **look)
    size = _size(ax)
    for k in numbers:
        _triad(ax, X_WF.R[k], X_WF.p[k], _TRIAD * size, mech.frame_names[k])
    if isinstance(ground, HalfSpace):
        normal, offset = plane("plot.mechanism", ground)
        outline = _plane(ax, normal, offset)
        if solid is not None:
            solid.throw_shadow(normal, offset, outline)
    elif callable(ground):
        dtype = jax.dtypes.canonicalize_dtype(np.asarray(q).dtype)
        low, high = _around(ax)
        centre, edge = [*(low + high)[:2] / 2, X_WJ.p[:, 2].mean()], float((high - low)[:2].max())
        _surface(ax, surface("plot.mechanism", ground, centre, edge, _CELLS, dtype))
    elif ground is not None:
        check.refuse("plot.mechanism: ground", "a HalfSpace, or a function from a point to its distance", ground)
    return _fit(ax)


def torques(
    mech: Mechanism,
    q: ArrayLike,
    tau: ArrayLike,
    ax: Axes3D | None = None,
    *,
    scale: Scales | None = None,
    numbers: bool = False,
) -> Axes3D:
    """Draws the forces of joints: torques as arcs about the axes of hinges, forces as arrows along those of slides.

        plot.torques(mech, q, js.gravity_forces(mech, q), plot.mechanism(mech, q))

    Joints of several coordinates are left out, and so are those that follow another joint.

    Args:
        mech: the mechanism.
        q: (nq,) coordinates: rad, m, quaternions.
        tau: (nv,) generalized forces: N m, N.
        ax: 3-D axes; None makes new ones.
        scale: as of `wrench`.
        numbers: whether to write the amount beside each, in two digits: "33 N m".

    Returns:
        The axes, with the lines and arrows that `wrench` draws.

    Raises:
        TypeError: an argument has another type.
        ValueError: an argument is a batch, has another size, or is not finite.

    Example:
        >>> from jaxspatial import plot
        >>> ax = plot.torques(arm, q, js.gravity_forces(arm, q), plot.mechanism(arm, q), numbers=True)
        >>> [text.get_text() for text in ax.texts]
        ['17 N m', '2.9 N m']
    """
    ax, X_WJ = _axes("plot.torques", ax), _joints("plot.torques", mech, q)
    given = _one("plot.torques: tau", "tau", tau, mech.nv)
    t = mech.topology
    single = [i for i in range(len(t)) if t.kind(i).nv == 1 and t.kind(i).is_about_one_axis and not t.is_mimic(i)]
    along = np.einsum("nij,nj->ni", X_WJ.R, _numbers(mech.axes))[single] * given[[t.v_starts[i] for i in single], None]
    slides = np.array([t.kind(i).moves_as == "prismatic" for i in single], bool)[:, None]
    tau, f = np.where(slides, 0, along), np.where(slides, along, 0)
    return _draw_wrenches("plot.torques", ax, tau, f, X_WJ.p[single], scale, _amounts(tau, f) if numbers else "")


def frame(X_WF: RigidTransform, ax: Axes3D | None = None, *, length: float | None = None, name: str = "") -> Axes3D:
    """Draws a frame as three axes: x red, y green, z blue.

    Args:
        X_WF: the pose of the frame in the world, a single one, m.
        ax: 3-D axes; None makes new ones.
        length: of the axes, m; None takes a tenth of the scene.
        name: written beside the origin.

    Returns:
        The axes.

    Raises:
        TypeError: X_WF is no RigidTransform, or the axes are not 3-D.
        ValueError: X_WF is a batch.

    Example:
        >>> from jaxspatial import plot
        >>> [line.get_gid() for line in plot.frame(below, name="B").lines]
        ['B x', 'B y', 'B z']
    """
    ax, X = _axes("plot.frame", ax), _pose("plot.frame: X_WF", X_WF)
    _triad(ax, X.R, X.p, _TRIAD * _size(ax) if length is None else length, name)
    return _fit(ax)


def wrench(
    F_P_W: SpatialForce,
    p_WP: ArrayLike,
    ax: Axes3D | None = None,
    *,
    scale: Scales | None = None,
    axis: bool = True,
    name: str = "",
) -> Axes3D:
    """Draws a wrench at P: an arrow for its force, an arc about its torque, and the line of its central axis.

    The arc turns as the torque does. The dashed line is the central axis: about its points the wrench has no torque but
    that along its force. It has a dot at the point nearest to P, and is left out where it passes through P and where it
    is out of sight.

    All arrows in the same axes have one scale, so that they can be compared: the longest arrow takes three tenths of
    the scene, the largest arc about a tenth, and what is smaller than a hundredth is left out. Draw the robot first.

    Args:
        F_P_W: SpatialForce about P, in world axes: N m, N; a single one, or (n,) of them.
        p_WP: (3,) position of P, or (n, 3), m.
        ax: 3-D axes; None makes new ones.
        scale: Scales(force, torque): metres per N and per N m, of all arrows in these axes. None, or None in one of
            its fields, leaves it as it is.
        axis: whether to draw the central axis.
        name: written at the tip of the force, or at the arc where there is no force.

    Returns:
        The axes. Arrows and lines have names, `get_gid()`: "force", "torque", "central axis". The label of a central
        axis tells its pitch: `ax.legend()` shows it.

    Raises:
        TypeError: F_P_W is no SpatialForce, or the axes are not 3-D.
        ValueError: shapes do not fit, or numbers are not finite.

    Example:
        >>> from jaxspatial import plot
        >>> ax = plot.wrench(F, [0.0, 0.0, 0.0], plot.mechanism(arm, q))
        >>> [line.get_gid() for line in ax.lines if line.get_gid()]
        ['lower', 'lower tip', 'joints', 'torque', 'central axis']
    """
    ax = _axes("plot.wrench", ax)
    check.require_kind(F_P_W, SpatialForce, "plot.wrench", " first")
    if len(F_P_W.batch_shape) > 1:
        raise ValueError(f"plot.wrench: expected one wrench or (n,), got {F_P_W.batch_shape}: pass F.at_batch(i)")
    points = np.asarray(p_WP, float)
    if points.shape not in ((3,), (*F_P_W.batch_shape, 3)) and not (points.ndim == 2 and not F_P_W.batch_shape):
        raise ValueError(f"plot.wrench: p_WP: expected shape (3,) or {(*F_P_W.batch_shape, 3)}, got {points.shape}")
    tau, f, points = np.broadcast_arrays(*map(np.atleast_2d, (_numbers(F_P_W.tau), _numbers(F_P_W.f), points)))
    _draw_wrenches("plot.wrench", ax, tau, f, points, scale, name)
    if axis:
        # In the dtype that JAX computes in: a picture needs no digits.
        pitch, p_PA = central_axis(F_P_W.astype(None), precision="fast")
        pitch, p_PA = np.broadcast_to(_numbers(pitch), len(f)), np.broadcast_to(_numbers(p_PA), f.shape)
        for given in zip(f, points, pitch, p_PA, strict=True):
            _central_axis(ax, *given)
    return _fit(ax)


def forces(
    mech: Mechanism,
    q: ArrayLike,
    given: ExternalForces,
    ax: Axes3D | None = None,
    *,
    scale: Scales | None = None,
    numbers: bool = False,
) -> Axes3D:
    """Draws external forces where they act, such as those of contacts.

        plot.forces(mech, q, js.AppliedForces(feet.frames, step.contact_forces), ax)

    Args:
        mech: the mechanism.
        q: (nq,) coordinates: rad, m, quaternions.
        given: wrenches as `external_forces` have them: SpatialForces by name of a frame, AppliedForces, or a list of
            these, of one state: N m, N.
        ax: 3-D axes; None makes new ones.
        scale: as of `wrench`.
        numbers: as of `torques`; of a wrench with a force, that of the force.

    Returns:
        The axes, with the lines and arrows that `wrench` draws.

    Raises:
        KeyError: there is no such frame.
        TypeError: an argument has another type.
        ValueError: an argument is a batch, has another size, or is not finite.

    Example:
        >>> from jaxspatial import plot
        >>> ax = plot.forces(arm, q, {"hand": F}, plot.mechanism(arm, q), numbers=True)
        >>> [text.get_text().strip() for text in ax.texts]
        ['2.2 N']
    """
    ax = _axes("plot.forces", ax)
    check.require_kind(mech, Mechanism, "plot.forces", " first")
    state = _one("plot.forces: q", "q", q, mech.nq).astype(jax.dtypes.canonicalize_dtype(np.asarray(q).dtype))
    placed = wrenches("plot.forces", mech, state[None], given)
    if placed is None:
        return _fit(ax)
    tau, f = placed.tau[0], placed.f[0]
    return _draw_wrenches("plot.forces", ax, tau, f, placed.p[0], scale, _amounts(tau, f) if numbers else "")


def scales(ax: Axes3D) -> Scales:
    """Tells how large the arrows in some axes are: `f"1 m of arrow is {1 / plot.scales(ax).force:.0f} N"`.

    Args:
        ax: 3-D axes in which `wrench` or `torques` has drawn.

    Returns:
        Scales, with None for what was not drawn yet.

    Raises:
        TypeError: the axes are not 3-D.

    Example:
        >>> from jaxspatial import plot
        >>> scale = plot.scales(plot.forces(arm, q, {"hand": F}, plot.mechanism(arm, q)))
        >>> print(f"1 m of arrow is {1 / scale.force:.1f} N")
        1 m of arrow is 3.9 N
    """
    _require_axes("plot.scales", ax)
    return _WRENCHES[ax].scale if ax in _WRENCHES else Scales()


def scale_bars(ax: Axes3D) -> Axes3D:
    """Adds an arrow and an arc of round numbers beside the scene, from which all others can be read.

    They stay what they say when more is drawn: they are drawn anew with all arrows.

    Args:
        ax: 3-D axes in which `wrench`, `torques` or `forces` has drawn.

    Returns:
        The axes, with an arrow named "force bar", an arc, and texts such as "20 N" and "5 N m".

    Raises:
        TypeError: the axes are not 3-D.
        ValueError: no wrench was drawn in them.

    Example:
        >>> from jaxspatial import plot
        >>> ax = plot.scale_bars(plot.forces(arm, q, {"hand": F}, plot.mechanism(arm, q)))
        >>> [text.get_text().strip() for text in ax.texts]
        ['1 N', '2 N m']
    """
    _require_axes("plot.scale_bars", ax)
    if ax not in _WRENCHES or not _WRENCHES[ax].wrenches:
        raise ValueError("plot.scale_bars: ax: expected axes with wrenches, got some without: draw these first")
    _WRENCHES[ax].has_bars = True
    _WRENCHES[ax].draw(ax)
    return _fit(ax)


def inertia(
    M_BBo_B: SpatialInertia, ax: Axes3D | None = None, X_WB: RigidTransform | None = None, *, color: str = INERTIA
) -> Axes3D:
    """Draws the solid ellipsoid with the same mass, centre of mass and inertia.

    Args:
        M_BBo_B: a single inertia about Bo, in the axes of B: kg, m, kg m2.
        ax: 3-D axes; None makes new ones.
        X_WB: the pose of B in the world, m; None where it is the world's.
        color: of the ellipsoid.

    Returns:
        The axes. Three lines named "inertia" are the sections through pairs of principal axes.

    Raises:
        TypeError: an argument has another type.
        ValueError: an argument is a batch, or the inertia has no ellipsoid: there is no mass, or no body has it.

    Example:
        >>> from jaxspatial import plot
        >>> ax = plot.inertia(js.SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=6.0))
        >>> [line.get_gid() for line in ax.lines]
        ['inertia', 'inertia', 'inertia']
    """
    ax = _axes("plot.inertia", ax)
    _require_single("plot.inertia", M_BBo_B, SpatialInertia)
    X = _Poses(np.eye(3), np.zeros(3)) if X_WB is None else _pose("plot.inertia: X_WB", X_WB)
    a, R_BE = M_BBo_B.equivalent_ellipsoid(precision="fast")
    semi_axes = X.R @ _numbers(R_BE.to_matrix()) * _numbers(a)  # as columns
    centre = X.p + X.R @ _numbers(M_BBo_B.com)
    if not np.isfinite(semi_axes).all():
        raise ValueError(f"plot.inertia: expected the inertia of a body with a mass, got {M_BBo_B}")
    around, down = np.linspace(0, 2 * np.pi, 49), np.linspace(0, np.pi, 25)
    sphere = np.stack([np.outer(np.cos(around), np.sin(down)), np.outer(np.sin(around), np.sin(down))])
    sphere = np.stack([*sphere, np.broadcast_to(np.cos(down), sphere[0].shape)])
    surface = centre[:, None, None] + np.einsum("ij,jkl->ikl", semi_axes, sphere)
    ax.plot_surface(*surface, color=color, alpha=0.25, linewidth=0, zorder=_SOLID)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        section = centre[:, None] + semi_axes[:, [i, j]] @ [np.cos(around), np.sin(around)]
        ax.plot(*section, color=color, linewidth=1, zorder=_SOLID, gid="inertia")
    return _fit(ax)


# -- arguments --------------------------------------------------------------------------------------------------------


class _Poses(NamedTuple):
    """Rotation matrices (*batch, 3, 3) and positions (*batch, 3)."""

    R: np.ndarray
    p: np.ndarray


def _numbers(x: Any) -> np.ndarray:
    return np.asarray(x, float)


def _poses(X: RigidTransform) -> _Poses:
    return _Poses(_numbers(X.rotation.to_matrix()), _numbers(X.translation))


def _require_axes(operation: str, ax: Any) -> None:
    if not isinstance(ax, Axes3D):
        raise TypeError(f"{operation}: ax: expected axes with projection='3d', got {type(ax).__name__}")


def _axes(operation: str, ax: Any) -> Axes3D:
    if ax is None:
        return axes()
    _require_axes(operation, ax)
    return ax


def _require_single(operation: str, x: Any, kind: type) -> None:
    check.require_kind(x, kind, operation)
    if x.batch_shape:
        raise ValueError(f"{operation}: expected a single one, got a batch {x.batch_shape}: pass x.at_batch(i)")


def _pose(operation: str, X: Any) -> _Poses:
    _require_single(operation, X, RigidTransform)
    return _poses(X)


def _one(operation: str, name: str, x: Any, n: int) -> np.ndarray:
    """The numbers (n,) of one state."""
    if np.shape(x) != (n,):
        way_out = f": pass one state, {name}[i]" if np.ndim(x) > 1 else ""
        raise ValueError(f"{operation}: expected shape ({n},), got {np.shape(x)}{way_out}")
    return _numbers(x)


def _joints(operation: str, mech: Any, q: Any) -> _Poses:
    """X_WJ: the frames of joints, which move with their bodies."""
    check.require_kind(mech, Mechanism, operation, " first")
    n = len(mech.topology)
    if mech.placements.batch_shape != (n,):
        raise ValueError(f"{operation}: expected one mechanism, got a batch: jax.tree.map(lambda x: x[i], mech)")
    _one(f"{operation}: q", "q", q, mech.nq)
    X_WB, X_JB = _state_poses(mech, q, None), _poses(mech.child_placements)
    R_WJ = X_WB.R @ X_JB.R.swapaxes(-1, -2)
    return _Poses(R_WJ, X_WB.p - np.einsum("nij,nj->ni", R_WJ, X_JB.p))


def _state_poses(mech: Mechanism, q: Any, names: Sequence[str] | None) -> _Poses:
    """X_WF of named frames in one state, None for all bodies."""
    # In the dtype that JAX computes in: a picture needs no digits.
    x = np.asarray(q)
    x = x.astype(jax.dtypes.canonicalize_dtype(x.dtype))
    return _poses(forward_kinematics(mech, x, names, precision="fast"))


def _frames(mech: Mechanism, X_WJ: _Poses) -> _Poses:
    """X_WF of all frames."""
    X_JF, bodies = _poses(mech.frame_placements), [body for _, body in mech.topology.frames]
    # The world is number -1: the last.
    R = np.concatenate([X_WJ.R, np.eye(3)[None]])[bodies]
    p = np.concatenate([X_WJ.p, np.zeros((1, 3))])[bodies]
    return _Poses(R @ X_JF.R, p + np.einsum("nij,nj->ni", R, X_JF.p))


def _tip(mech: Mechanism, i: int, X_WJ: _Poses, X_WF: _Poses) -> np.ndarray:
    """The frame of body i that is farthest from its joint, or its centre of mass."""
    on_body = [k for k, (_, body) in enumerate(mech.topology.frames) if body == i]
    farthest = max(X_WF.p[on_body], key=lambda p: np.linalg.norm(p - X_WJ.p[i]))
    if np.linalg.norm(farthest - X_WJ.p[i]) > 1e-6:
        return farthest
    return X_WJ.p[i] + X_WJ.R[i] @ _numbers(mech.inertias.com)[i]


# -- drawing ----------------------------------------------------------------------------------------------------------


class Arrow(FancyArrowPatch):
    """An arrow between two points of space, `ends` (2, 3) in m, with a head of a fixed size on paper.

    An arrow that is shorter on paper has a smaller head, unless it is the head of something else.

    Example:
        >>> from jaxspatial import plot
        >>> arrow = plot.axes().add_artist(plot.Arrow(np.zeros(3), np.array([0.0, 0.0, 1.0])))
        >>> print(arrow.ends)
        [[0. 0. 0.]
         [0. 0. 1.]]
    """

    def __init__(self, start: np.ndarray, end: np.ndarray, is_head: bool = False, **style: Any):
        super().__init__((0, 0), (1, 1), arrowstyle="-|>", shrinkA=0, shrinkB=0, **style)
        self.ends, self._is_head = np.stack([start, end]), is_head
        self._largest, self._width = self.get_mutation_scale(), self.get_linewidth()

    def do_3d_projection(self, renderer: Any = None) -> float:
        """Places the arrow on paper; axes call it.

        Example:
            >>> from jaxspatial import plot
            >>> ax = plot.axes()
            >>> short = ax.add_artist(plot.Arrow(np.zeros(3), np.array([0.0, 0.0, 1e-9])))
            >>> ax.figure.canvas.draw()
            >>> print(short.get_mutation_scale() < 1e-6)  # the size of its head
            True
        """
        ax: Any = self.axes
        xs, ys, zs = self.ends.T
        x, y, z = proj3d.proj_transform(xs, ys, zs, ax.M)
        self.set_positions((x[0], y[0]), (x[1], y[1]))
        if not self._is_head:
            # A head longer than its arrow would point the other way.
            points = np.ptp(ax.transData.transform(np.stack([x, y], -1)), axis=0) * 72 / ax.figure.dpi
            share = min(1.0, float(np.hypot(*points)) / (_HEAD * self._largest))
            self.set_mutation_scale(share * self._largest)
            self.set_linewidth(share * self._width)
        return min(z)


def _size(ax: Axes3D) -> float:
    """The length of the longest edge of the box around all that is drawn; 1 m where nothing is."""
    if not _has_data(ax):
        return 1.0
    return float(max(np.ptp(limits) for limits in (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())))


def _has_data(ax: Axes3D) -> bool:
    """Whether anything is drawn; matplotlib knows its own artists alone."""
    return ax.has_data() or any(isinstance(artist, _Meshes) for artist in ax.artists)


def _fit(ax: Axes3D) -> Axes3D:
    ax.set_aspect("equal")
    if isinstance(ax, _Axes):
        low, high = MaxNLocator(4).tick_values(0, _size(ax))[:2]
        for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
            axis.set_major_locator(MultipleLocator(high - low))
    return ax


def _include(ax: Axes3D, points: np.ndarray) -> None:
    """Widens the limits, as matplotlib does for what it draws itself."""
    ax.auto_scale_xyz(*np.reshape(points, (-1, 3)).T, had_data=_has_data(ax))


def _line(ax: Axes3D, start: np.ndarray, end: np.ndarray, color: str, gid: str) -> None:
    if np.linalg.norm(end - start) > 1e-9:
        look: Any = {"color": color, "linewidth": 4, "solid_capstyle": "round", "zorder": _BODY}
        ax.plot(*np.stack([start, end]).T, gid=gid, **look)


def _arrow(
    ax: Axes3D, start: np.ndarray, end: np.ndarray, color: str, gid: str, width: float = 2.2, is_head: bool = False
) -> Any:
    _include(ax, np.stack([start, end]))
    look: Any = {"color": color, "linewidth": width, "mutation_scale": 6 * width, "zorder": _ARROW}
    return ax.add_artist(Arrow(start, end, is_head, gid=gid, joinstyle="miter", **look))


def _text(ax: Axes3D, p: np.ndarray, text: str, color: str | None = None, middle: Any = None) -> list[Any]:
    """Written beside a point of space, on the side that is away from another; to the right where there is none."""
    if not text:
        return []
    # So that it can be read in front of robots.
    halo = patheffects.withStroke(linewidth=2.5, foreground=pyplot.rcParams["figure.facecolor"])
    look: Any = {"color": color or pyplot.rcParams["text.color"], "fontsize": "small", "zorder": _FRAME + 1}
    return [ax.add_artist(_Label(p, middle, text, path_effects=[halo], **look))]


class _Label(Text):
    """A text beside a point of space, `p`, on the side of it that is away from another; to its right without one."""

    def __init__(self, p: np.ndarray, middle: np.ndarray | None, text: str, **style: Any):
        super().__init__(0, 0, text, ha="center", va="center", **style)
        self.p, self.middle = p, p if middle is None else middle

    def draw(self, renderer: Any) -> None:
        """Places the text on paper; axes call it."""
        ax: Any = self.axes
        xs, ys, zs = np.stack([self.middle, self.p]).T
        x, y, _ = proj3d.proj_transform(xs, ys, zs, ax.get_proj())
        away = np.diff(ax.transData.transform(np.stack([x, y], -1)), axis=0)[0]
        length = np.hypot(*away)
        away = away / length if length > 1e-3 else np.array([1.0, 0.0])
        half = np.array(self.get_window_extent(renderer).size) / 2
        gap = _BESIDE * ax.figure.dpi / 72
        # It begins where its frame does.
        away = away * (gap + (half / np.maximum(abs(away), 1e-9)).min()) / ax.figure.dpi
        self.set_position((x[1], y[1]))
        self.set_transform(ax.transData + ScaledTranslation(away[0], away[1], ax.figure.dpi_scale_trans))
        super().draw(renderer)


def _sticks(ax: Axes3D, mech: Mechanism, X_WJ: _Poses, X_WF: _Poses, color: str, has_tips: bool) -> None:
    """Lines between joints, and to the tips of bodies without children; dots on joints."""
    for i, parent in enumerate(mech.parents):
        if parent >= 0 or mech.topology.kinds[i] != "free":
            _line(ax, X_WJ.p[parent] if parent >= 0 else np.zeros(3), X_WJ.p[i], color, mech.body_names[i])
    if has_tips:
        for i, children in enumerate(mech.topology.children):
            if not children:
                _line(ax, X_WJ.p[i], _tip(mech, i, X_WJ, X_WF), color, f"{mech.body_names[i]} tip")
    ax.plot(*X_WJ.p.T, linestyle="", marker="o", markersize=6, color=JOINT, zorder=_JOINT, gid="joints")


def _solids(ax: Axes3D, mech: Mechanism, q: ArrayLike, found: dict[str, list[Any]]) -> "_Meshes | None":
    """Meshes by link."""
    links = [(k, mesh) for k, several in enumerate(found.values()) for mesh in several]
    if not links:
        return None
    X_WL = _state_poses(mech, q, list(found))
    parts = [
        (np.asarray(mesh.triangles, float) @ X_WL.R[k].T + X_WL.p[k], _shades(mesh, X_WL.R[k])) for k, mesh in links
    ]
    corners, colors = (np.concatenate(x) for x in zip(*parts, strict=True))
    _include(ax, corners)
    solid = _Meshes(corners, colors, zorder=_BODY, gid="shapes")
    ax.add_artist(solid)
    return solid


def _shades(mesh: Any, R_WL: np.ndarray) -> np.ndarray:
    """Colours (n, 3, 3) of the corners of triangles: lighter where they face the light or the sky."""
    look = mesh.visual
    color = np.asarray(look.main_color if hasattr(look, "main_color") else look.material.main_color, float)[:3] / 255
    of_faces = np.broadcast_to(np.asarray(mesh.face_normals, float)[:, None], (len(mesh.faces), 3, 3))
    normals = np.asarray(mesh.vertex_normals, float)[mesh.faces]
    # A mean over the faces at a corner is smooth, but no edge of a box is.
    is_smooth = (normals * of_faces).sum(-1, keepdims=True) > 0.8
    normals = np.where(is_smooth, normals, of_faces) @ R_WL.T
    shade = 0.5 + 0.4 * np.clip(normals @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1) + 0.12 * (1 + normals[..., 2]) / 2
    return np.clip(shade[..., None] * (0.12 + 0.86 * color), 0, 1)


class _Meshes(Artist):
    """Triangles of space, drawn as one image: what is nearer covers, and edges are smooth in it.

    corners, colors: (n, 3, 3) positions, m, and colours of their corners.
    shadow: (n, 3, 3) where the corners throw it; None for none. outline: (4, 3) of what it falls on.
    """

    shadow: np.ndarray | None = None
    outline: np.ndarray

    def __init__(self, corners: np.ndarray, colors: np.ndarray, **style: Any):
        super().__init__()
        self.corners, self.colors = corners, colors
        self.update(style)

    def throw_shadow(self, normal: np.ndarray, offset: float, outline: np.ndarray) -> None:
        """On a plane, within a part of it."""
        above = np.maximum(self.corners @ normal - offset, 0)
        self.shadow = self.corners - above[..., None] / max(normal @ _LIGHT, 0.2) * _LIGHT
        self.outline = outline

    def _projected(self, corners: np.ndarray) -> np.ndarray:
        """(n, 3, 3) pixels from the left and from below, and the depth."""
        ax: Any = self.axes
        xs, ys, zs = corners.reshape(-1, 3).T
        x, y, depth = proj3d.proj_transform(xs, ys, zs, ax.get_proj())
        pixels = ax.transData.transform(np.stack([x, y], -1))
        return np.column_stack([pixels, depth]).reshape(corners.shape)

    def get_window_extent(self, renderer: Any = None) -> Bbox:
        """What it covers, in pixels."""
        p = self._projected(self.corners)
        return Bbox([p[..., :2].min((0, 1)), p[..., :2].max((0, 1))])

    def draw(self, renderer: Any) -> None:
        """Draws the image; axes call it."""
        if not self.get_visible():
            return
        axes: Any = self.axes
        width, height = (int(np.ceil(x)) for x in axes.figure.bbox.size)
        # Of pictures in vectors a pixel is a point, which is too coarse.
        fine = _FINE * int(np.ceil(renderer.get_image_magnification()))
        shape = height * fine, width * fine
        solid, p = np.zeros((*shape, 4)), self._projected(self.corners)
        u, v = p[:, 1, :2] - p[:, 0, :2], p[:, 2, :2] - p[:, 0, :2]
        faces = u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0]  # the viewer
        y, x, rest = _samples(np.concatenate([p, self.colors], -1)[faces], fine, shape)
        # What is nearer comes later, and stays.
        order = np.argsort(-rest[:, 0])
        solid[y[order], x[order], :3], solid[y, x, 3] = rest[order, 1:], 1
        if self.shadow is not None:
            dark, black = np.zeros(shape), np.zeros((height, width, 4))
            y, x, _ = _samples(self._projected(self.shadow), fine, shape)
            dark[y, x] = 1
            black[..., 3] = 0.28 * _blurred(_mean(dark[..., None], fine)[..., 0], 0.1 * axes.figure.dpi)
            self._paint(renderer, black, Path(self._projected(self.outline[None])[0, :, :2]))
        solid = _mean(solid, fine)
        solid[..., :3] /= np.maximum(solid[..., 3:], 1e-9)  # of pixels that are covered in part
        self._paint(renderer, solid)

    def _paint(self, renderer: Any, image: np.ndarray, within: Path | None = None) -> None:
        """Draws an image of the whole figure; within: in pixels."""
        figure: Any = self.figure
        picture = BboxImage(Bbox.from_bounds(0, 0, *image.shape[1::-1]), origin="lower", interpolation="nearest")
        picture.set_data((255 * np.clip(image, 0, 1)).astype(np.uint8))
        picture.set_figure(figure)
        if within is not None:
            picture.set_clip_path(within, IdentityTransform())
        picture.draw(renderer)


def _blurred(image: np.ndarray, width: float) -> np.ndarray:
    """With a Gaussian of this standard deviation, in pixels; outside of the image is nothing."""
    beyond = int(4 * width)
    wide = np.pad(image, ((0, beyond), (0, beyond)))
    y, x = np.fft.fftfreq(wide.shape[0])[:, None], np.fft.rfftfreq(wide.shape[1])
    passed = np.exp(-2 * (np.pi * width) ** 2 * (x**2 + y**2))
    return np.fft.irfft2(np.fft.rfft2(wide) * passed, wide.shape)[: image.shape[0], : image.shape[1]]


def _samples(corners: np.ndarray, fine: int, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(rows, columns, the other numbers (m, ...)) of points less than a pixel apart on triangles (n, 3, 2 + ...)."""
    corners = np.concatenate([fine * corners[..., :2], corners[..., 2:]], -1)
    longest = np.linalg.norm((corners - np.roll(corners, 1, axis=1))[..., :2], axis=-1).max(1)
    parts = np.ceil(longest / 0.7).clip(1, 4 * max(shape)).astype(int)
    found = [np.zeros((0, corners.shape[-1]))]
    for n in np.unique(parts):
        # Middles of small triangles, for a triangle smaller than a step its own.
        i, j = np.meshgrid(np.arange(n), np.arange(n))
        at = (np.stack([i, j, n - 1 - i - j], -1)[i + j < n] + 1 / 3) / n
        found.append(np.einsum("sk,nkx->nsx", at, corners[parts == n]).reshape(-1, corners.shape[-1]))
    points = np.concatenate(found)
    x, y = np.floor(points[:, :2]).astype(int).T
    inside = (0 <= x) & (x < shape[1]) & (0 <= y) & (y < shape[0])
    return y[inside], x[inside], points[inside, 2:]


def _mean(image: np.ndarray, fine: int) -> np.ndarray:
    """Over squares of fine x fine pixels."""
    height, width, n = image.shape
    return image.reshape(height // fine, fine, width // fine, fine, n).mean((1, 3))


def _triad(ax: Axes3D, R: np.ndarray, p: np.ndarray, length: float, name: str) -> None:
    for axis, color, letter in zip(R.T, XYZ, "xyz", strict=True):
        ax.plot(*np.stack([p, p + length * axis]).T, color=color, linewidth=2.2, zorder=_FRAME, gid=f"{name} {letter}")
    # On the side where no axis is.
    _text(ax, p, name, middle=p + length * R.sum(1) / 3)


def _around(ax: Axes3D) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the box around all that is drawn, a little larger, and not much less wide than it is long."""
    limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    middle, size = limits.mean(1), _size(ax)
    half = np.maximum(np.ptp(limits, axis=1) / 2 + _BEYOND * size, _GROUND / 2 * size)
    return middle - half, middle + half


def _plane(ax: Axes3D, normal: np.ndarray, offset: float) -> np.ndarray:
    """A checkered part of the plane, next to the robot; returns its corners (4, 3)."""
    # Its squares lie along the two axes of the world that it faces least.
    k = int(np.argmax(abs(normal)))
    a, b = (i for i in range(3) if i != k)
    low, high = _around(ax)
    counts = np.maximum(np.rint((high - low)[[a, b]] / _size(ax) * _SQUARES), 1).astype(int)

    def at(share: np.ndarray) -> np.ndarray:
        p = np.zeros((*share.shape[:-1], 3))
        p[..., [a, b]] = low[[a, b]] + share * (high - low)[[a, b]]
        p[..., k] = (offset - p @ normal) / normal[k]
        return p

    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    squares = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 2)
    _checkered(ax, at((squares[:, None] + corners) / counts), squares.sum(1) % 2)
    return at(corners.astype(float))


def _surface(ax: Axes3D, triangles: np.ndarray) -> None:
    """Triangles with the squares of a checkered plane below them; shaded by how steep they are."""
    low, edge = triangles.min((0, 1)), np.ptp(triangles[..., :2], axis=(0, 1)).max() / _SQUARES
    across = ((triangles.mean(1) - low)[:, :2] / edge).astype(int).sum(1) % 2
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    steep = 1 - abs(normals[:, 2]) / np.linalg.norm(normals, axis=-1)
    _checkered(ax, triangles, across, 0.35 * steep)


def _checkered(ax: Axes3D, polygons: np.ndarray, is_dark: np.ndarray, darker: Any = 0.0) -> None:
    opacity = 0.1 + 0.12 * is_dark + darker
    shades = np.column_stack([np.tile(to_rgb(GROUND), (len(polygons), 1)), np.broadcast_to(opacity, len(polygons))])
    look: Any = {"facecolors": shades, "linewidths": 0, "zorder": _PLANE, "gid": "ground"}
    ax.add_collection(Poly3DCollection(polygons, **look), autolim=False)
    _include(ax, polygons)


def _across(n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (u, v) with u x v = n."""
    u = np.cross(n, np.eye(3)[np.argmin(abs(n))])
    u = u / np.linalg.norm(u)
    return u, np.cross(n, u)


# -- wrenches ---------------------------------------------------------------------------------------------------------


class _Wrenches:
    """All wrenches in some axes: drawn anew when one is added, as the largest chooses the scale of all."""

    def __init__(self, ax: Axes3D):
        limits = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()]).T
        self.scene = limits if _has_data(ax) else np.zeros((0, 3))
        self.given, self.scale = Scales(), Scales()
        self.wrenches: list[tuple[np.ndarray, np.ndarray, np.ndarray, str]] = []  # tau, f, the point, a name
        self.artists: list[Any] = []
        self.has_bars = False

    @property
    def size(self) -> float:
        """Of the scene, without arrows but with their points."""
        corners = np.stack([*self.scene, *(p for *_, p, _ in self.wrenches)])
        return float(np.ptp(corners, axis=0).max()) or 1.0

    def draw(self, ax: Axes3D) -> None:
        """Draws all of them, in the place of those that were drawn before."""
        for artist in self.artists:
            artist.remove()
        scale: list[float | None] = [*self.given]
        for k, share in ((0, _LONGEST), (1, _WIDEST)):
            largest = max(float(np.linalg.norm((f, tau)[k])) for tau, f, *_ in self.wrenches)
            if scale[k] is None and largest:
                scale[k] = share * self.size / largest
        self.scale, least = Scales(*scale), _LEAST * self.size
        self.artists = []
        for tau, f, p, name in self.wrenches:
            force, torque = (self.scale.force or 0) * f, (self.scale.torque or 0) * tau
            is_seen, radius = np.linalg.norm(force) >= least, float(np.linalg.norm(torque))
            if is_seen:
                self.artists += [_arrow(ax, p, p + force, FORCE, "force"), *_text(ax, p + force, name, FORCE, p)]
            if radius >= least:
                self.artists += _arc(ax, torque / radius, p, radius)
                if name and not is_seen:
                    away = self._away(p, torque / radius)
                    self.artists += _text(ax, p + radius * away, name, TORQUE, p)
        if self.has_bars:
            self.draw_bars(ax)

    def _away(self, p: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The direction in the plane of an arc that leads away from the middle of the scene, of unit length."""
        away = p - np.mean([*self.scene, *(p for *_, p, _ in self.wrenches)], axis=0)
        away = away - (normal @ away) * normal
        length = np.linalg.norm(away)
        return away / length if length > _LEAST * self.size else _across(normal)[0]

    def draw_bars(self, ax: Axes3D) -> None:
        """An arrow up and an arc about its foot, at the corner of the scene that is on the left of the picture."""
        corner, up = np.min([*self.scene, *(p for *_, p, _ in self.wrenches)], axis=0), np.eye(3)[2]
        if self.scale.force:
            number = _round_below(0.7 * _LONGEST * self.size / self.scale.force)
            tip = corner + self.scale.force * number * up
            self.artists += [
                _arrow(ax, corner, tip, FORCE, "force bar"),
                *_text(ax, tip, f"{number:g} N", FORCE, corner),
            ]
        if self.scale.torque:
            number = _round_below(_WIDEST * self.size / self.scale.torque)
            radius = self.scale.torque * number
            azimuth = np.deg2rad(ax.azim)
            right = corner + radius * np.array([-np.sin(azimuth), np.cos(azimuth), 0])  # of it, as it is seen now
            self.artists += [*_arc(ax, up, corner, radius), *_text(ax, right, f"{number:g} N m", TORQUE, corner)]


def _amounts(tau: np.ndarray, f: np.ndarray) -> list[str]:
    """What is written beside wrenches (n, 3), two digits: of the force, or of the torque where there is none."""
    sizes = zip(*(np.linalg.norm(x, axis=-1) for x in (f, tau)), strict=True)
    return [f"{float(f'{a or b:.2g}'):g} {'N' if a else 'N m'}" for a, b in sizes]


def _round_below(x: float) -> float:
    """The largest of 1, 2, 5, 10, ... that is not above x."""
    power = 10.0 ** np.floor(np.log10(x))
    return float(max(k for k in (1, 2, 5) if k * power <= x * (1 + 1e-12)) * power)


_WRENCHES: "weakref.WeakKeyDictionary[Axes3D, _Wrenches]" = weakref.WeakKeyDictionary()


def _draw_wrenches(
    operation: str,
    ax: Axes3D,
    tau: np.ndarray,
    f: np.ndarray,
    points: np.ndarray,
    scale: Scales | None,
    names: str | list[str] = "",
) -> Axes3D:
    if not all(np.isfinite(x).all() for x in (tau, f, points)):
        raise ValueError(f"{operation}: expected finite numbers, got torques {tau}, forces {f}, points {points}")
    if scale is not None:
        check.require_kind(scale, Scales, f"{operation}: scale")
    drawn = _WRENCHES.get(ax)
    # Axes that were cleared have none.
    if drawn is None or any(artist.axes is not ax for artist in drawn.artists) or not _has_data(ax):
        drawn = _WRENCHES[ax] = _Wrenches(ax)
    drawn.given = Scales(
        *(old if new is None else new for old, new in zip(drawn.given, scale or Scales(), strict=True))
    )
    names = [names] * len(f) if isinstance(names, str) else names
    drawn.wrenches += list(zip(tau, f, points, names, strict=True))
    if drawn.wrenches:
        _include(ax, points)
        drawn.draw(ax)
    return _fit(ax)


def _arc(ax: Axes3D, normal: np.ndarray, centre: np.ndarray, radius: float) -> list[Any]:
    """An arc that turns about the normal, with a head at its end, and the axis that it turns about."""
    u, v = _across(normal)
    arc = centre + radius * (np.outer(np.cos(_TURN), u) + np.outer(np.sin(_TURN), v))
    axis = centre + np.outer([-0.5, 0.5], radius * normal)
    lines = ax.plot(*arc.T, color=TORQUE, linewidth=2, zorder=_ARROW, gid="torque")
    lines += ax.plot(*axis.T, color=TORQUE, linewidth=1, zorder=_ARROW)
    return [*lines, _arrow(ax, arc[-4], arc[-1], TORQUE, "torque head", width=1.7, is_head=True)]


def _central_axis(ax: Axes3D, f: np.ndarray, p: np.ndarray, pitch: float, p_PA: np.ndarray) -> None:
    force, away, size = np.linalg.norm(f), np.linalg.norm(p_PA), _size(ax)
    # Of a couple, it is NaN.
    if not away <= size or max(away, abs(pitch)) < 1e-3 * size:
        return
    line = p + p_PA + np.outer([-0.35, 0.35], size * f / force)
    look: Any = {"color": FORCE, "linewidth": 1.2, "zorder": _ARROW}
    ax.plot(*line.T, linestyle="--", gid="central axis", label=f"central axis, pitch {pitch:.3g} m", **look)
    ax.plot(*(p + p_PA)[:, None], marker="o", markersize=4, **look)
    ax.plot(*np.stack([p, p + p_PA]).T, linestyle=":", **look)
