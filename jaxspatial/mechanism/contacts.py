"""Contact of a mechanism: which points of it touch, and how stiff and rough they are."""

import pathlib
from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Any, Self, cast

import jax
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.quantity import OfOneDtype, exported_tree_of
from jaxspatial.numerics.types import ArrayLike, DTypeLike

if TYPE_CHECKING:
    from jaxspatial.mechanism.mechanism import Mechanism

# The numbers of the law of contact.
LAW = "stiffness", "relaxation_time", "friction"
_PARAMETERS = "radius", *LAW


@exported_tree_of("frames")
class PointContacts(OfOneDtype):
    """Spheres on named frames that touch the ground: the `contacts` of `contact_forces`.

    Sphere i has its centre at position i of frame i; with a radius of zero it is a point. Any number of spheres may be
    on one frame. The law that turns their depth and speed into forces belongs to the function that takes them. Every
    number but the names of frames is data: it can be differentiated, and batched.

    Args:
        frames: names of frames, n of them; static. A name may come several times.
        positions: (n, 3) or (*batch, n, 3) positions of the centres from the origins of their frames, in the axes of
            the frames, m; None for the origins.
        radius: of the spheres, m: a number, (n,) or (*batch, n), as all that follow.
        stiffness: k, N/m, above zero.
        relaxation_time: tau_d, s: how long a sphere that is let go inside the ground takes to come out, by a factor e.
        friction: the coefficient mu of Coulomb friction, static and dynamic. Numbers of Python take the dtype of arrays
            beside them, or else JAX's default.

    Raises:
        TypeError: frames are no names, or dtypes differ.
        ValueError: shapes do not fit, or a number known while tracing is negative or NaN, a stiffness zero.

    Error: none, nothing is computed.

    Example:
        >>> law = {"stiffness": 1e4, "relaxation_time": 0.01, "friction": 0.8}
        >>> feet = js.PointContacts(["hand", "lower"], radius=[0.02, 0.0], **law)
        >>> print(js.contact_report(arm, q, v, feet, js.HalfSpace(offset=-2.0)).depths)
        [-0.1471 -1.1224]
    """

    frames: tuple[str, ...]
    positions: jax.Array | None = None
    radius: jax.Array = 0.0  # pyright: ignore[reportAssignmentType]
    _: KW_ONLY
    stiffness: jax.Array
    relaxation_time: jax.Array
    friction: jax.Array

    if TYPE_CHECKING:

        def __init__(
            self,
            frames: Iterable[str],
            positions: ArrayLike | None = None,
            radius: ArrayLike = 0.0,
            *,
            stiffness: ArrayLike,
            relaxation_time: ArrayLike,
            friction: ArrayLike,
        ): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; the placeholders in trees of axes or specs pass unchecked."""
        frames = check.as_tuple(self.frames, str, "PointContacts: frames", "names")
        object.__setattr__(self, "frames", frames)
        given = {name: getattr(self, name) for name in ("positions", *_PARAMETERS)}
        if all(map(check.is_tree_mark, given.values())):
            return
        dtype = floats.floating_dtype(*given.values())
        arrays = {name: per_frame("PointContacts", name, given[name], len(frames), dtype) for name in _PARAMETERS}
        if self.positions is not None:
            what, n = "PointContacts: positions", len(frames)
            positions = floats.as_vectors(self.positions, what, dtype, many=[str(n)], keep_dtype=True)
            if positions.shape[-2] != n:
                raise ValueError(f"{what}: expected shape (*batch, {n}, 3), got {positions.shape}")
            if isinstance(positions, np.ndarray) and np.isnan(positions).any():
                raise ValueError(f"{what}: expected numbers, got {positions.tolist()}")
            arrays["positions"] = positions
        check.require_same_dtype(**arrays)
        floats.common_batch_shape(**{name: _batch_shape(name, x) for name, x in arrays.items()})
        for name, x in arrays.items():
            object.__setattr__(self, name, floats.owned(x))

    @classmethod
    def from_urdf(
        cls,
        mech: "Mechanism",
        path_or_text: str | pathlib.Path,
        *,
        stiffness: ArrayLike,
        relaxation_time: ArrayLike,
        friction: ArrayLike,
        bodies: Iterable[str] | None = None,
        geoms: Iterable[str] | None = None,
        rim: int = 8,
        corners: int = 16,
    ) -> Self:
        """Makes spheres of the collision shapes of a URDF; see `jaxspatial.mechanism.formats.collision`.

            feet = js.PointContacts.from_urdf(
                mech, "dog.urdf", bodies=["FL_FOOT", "FR_FOOT"], stiffness=2e4, relaxation_time=0.01, friction=0.8
            )

        A sphere gives one, a capsule two, a box its eight corners, a cylinder points on its rims, a mesh corners of its
        convex hull. They are in the axes of the file's links.

        Args:
            mech: the mechanism that was read from the file, or a part of it.
            path_or_text: a path, or the text itself; its meshes are looked for beside it and in folders above.
            stiffness, relaxation_time, friction: as of `PointContacts`; the format has no such numbers.
            bodies: links whose shapes to take.
            geoms: names of more shapes; one without a name is "<link>_<number>", counted from 0 on its link. With
                neither, all shapes on links that move are taken.
            rim: the number of points on each rim of a cylinder.
            corners: the largest number of points of a mesh.

        Returns:
            The contacts, with NumPy numbers in the dtype of the mechanism, in the order of the file.

        Raises:
            FileNotFoundError: there is no such file, or no such mesh.
            ImportError: lxml is missing, or for meshes trimesh, or pycollada for those of Collada.
            KeyError: the mechanism has no such frame, or the file no such shape; lists those there are.
            ValueError: a shape is malformed or unknown, with its line; or there is none to take.

        Error: a few u of the size of a link in the positions.

        Example:
            >>> inertia = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
            >>> shape = '<collision><geometry><sphere radius="0.25"/></geometry></collision>'
            >>> text = f'<robot name="r"><link name="ball"><inertial>{inertia}</inertial>{shape}</link></robot>'
            >>> ball, law = js.Mechanism.from_urdf(text, floating_base=True), {"relaxation_time": 0.01, "friction": 0.5}
            >>> print(js.PointContacts.from_urdf(ball, text, stiffness=1e4, **law).radius)
            [0.25]
        """
        from jaxspatial.mechanism.formats import collision, urdf

        operation = "PointContacts.from_urdf"
        taken = collision.chosen(operation, urdf.read_shapes(path_or_text), mech.topology, bodies, geoms)
        frames, p, radius, _ = collision.spheres(operation, taken, rim, corners, mech.dtype)
        law = {"stiffness": stiffness, "relaxation_time": relaxation_time, "friction": friction}
        return cls(frames, p, radius, **law)

    @classmethod
    def from_mjcf(
        cls,
        mech: "Mechanism",
        path_or_text: Any,
        *,
        stiffness: ArrayLike,
        relaxation_time: ArrayLike,
        friction: ArrayLike | None = None,
        bodies: Iterable[str] | None = None,
        geoms: Iterable[str] | None = None,
        rim: int = 8,
        corners: int = 16,
        assets: Mapping[str, bytes] | None = None,
    ) -> Self:
        """Makes spheres of the geoms of an MJCF that may touch; see `jaxspatial.mechanism.formats.collision`.

            points = js.PointContacts.from_mjcf(mech, "scene.xml", stiffness=2e4, relaxation_time=0.01)

        As `from_urdf`; an ellipsoid gives the six ends of its axes. The ground of the file, geoms that are welded to
        the world, makes no spheres.

        Args:
            mech: the mechanism that was read from the file, or a part of it.
            path_or_text: a path; the text itself; a mujoco.MjSpec, or a mujoco.MjModel.
            stiffness, relaxation_time: as of `PointContacts`; MuJoCo's contacts have another law.
            friction: None takes the sliding friction of each geom. MuJoCo takes the larger one of two surfaces: pass
                that of the ground where it is larger.
            bodies: bodies whose geoms to take: those that may touch the ground of the file by `contype`,
                `conaffinity`, <pair> and <exclude>, or in a file without ground, that may touch anything.
            geoms: names of more geoms, taken whatever their masks are. With neither, all on bodies that move are taken
                that may touch.
            rim: the number of points on each rim of a cylinder.
            corners: the largest number of points of a mesh.
            assets: files that the text names, by their names.

        Returns:
            The contacts, with NumPy numbers in the dtype of the mechanism, in the order of the file.

        Raises:
            FileNotFoundError: there is no such file.
            ImportError: mujoco or lxml is missing.
            KeyError: the mechanism has no such frame, or the file no such geom; lists those there are.
            ValueError: MuJoCo does not compile the file, or there is no geom to take.

        Error: a few u of the size of a body in the positions.

        Example:
            >>> part = '<body name="puck"><freejoint/><geom size="0.25" friction="0.5"/></body>'
            >>> text = f"<mujoco><worldbody>{part}</worldbody></mujoco>"
            >>> mech, law = js.Mechanism.from_mjcf(text), {"stiffness": 1e4, "relaxation_time": 0.01}
            >>> puck = js.PointContacts.from_mjcf(mech, text, **law)
            >>> print(puck.frames, puck.radius, puck.friction)
            ('puck',) [0.25] [0.5]
        """
        from jaxspatial.mechanism.formats import collision, mjcf

        operation = "PointContacts.from_mjcf"
        taken = collision.chosen(operation, mjcf.read_shapes(path_or_text, assets), mech.topology, bodies, geoms)
        frames, p, radius, own = collision.spheres(operation, taken, rim, corners, mech.dtype)
        law = {"stiffness": stiffness, "relaxation_time": relaxation_time}
        return cls(frames, p, radius, **law, friction=own if friction is None else friction)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape, without the axis over contacts."""
        arrays = {name: x for name, x in vars(self).items() if name != "frames" and x is not None}
        return floats.broadcast_shapes(*(_batch_shape(name, x) for name, x in arrays.items()))

    @property
    def dtype(self) -> np.dtype[Any]:
        """The dtype of the numbers."""
        return np.dtype(self.stiffness.dtype)

    def __repr__(self) -> str:
        parts = ["positions"] if self.positions is not None else []
        numbers = ", ".join(f"{name}={check.shown(getattr(self, name), 0)}" for name in (*parts, *_PARAMETERS))
        return f"PointContacts({list(self.frames)}, {numbers})"


def per_frame(kind: str, name: str, x, n: int, dtype: DTypeLike | None):
    """Checks a number of the law of contacts on n frames: one for all, or one for each; the stiffness is above zero."""
    what = f"{kind}: {name}"
    if x is None:
        raise TypeError(f"{what}: expected a number, ({n},) or (*batch, {n}), got None")
    array = cast(Any, floats.as_float_array(x, what, dtype, keep_dtype=True))
    if array.shape[-1:] not in ((), (n,)):
        raise ValueError(f"{what}: expected a number, or shape (*batch, {n}), got {array.shape}")
    if isinstance(array, np.ndarray):
        least = "above 0" if name == "stiffness" else "of at least 0"
        if not (array > 0 if name == "stiffness" else array >= 0).all():
            raise ValueError(f"{what}: expected numbers {least}, got {x}")
    return array


def _batch_shape(name: str, x) -> tuple[int, ...]:
    return x.shape[:-2] if name == "positions" else x.shape[:-1]
