"""Forces on a mechanism: where they act, and in which axes they are given."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, get_args

import jax
import numpy as np

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.quantity import exported_tree_of
from jaxspatial.numerics.types import ArrayLike
from jaxspatial.spatial import SpatialForce

Axes = Literal["world", "frame"]


@exported_tree_of("frames", "axes")
class AppliedForces:
    """Wrenches at points of named frames: the `external_forces` of an algorithm.

        feet = js.AppliedForces(["foot_left", "foot_right"], F)                 # F: (*batch, 2), world axes
        thrust = js.AppliedForces(["rotor"] * 4, F, points, axes="frame")       # along the axes of the frame

    Wrench i acts at point i of frame i, on the body that carries the frame. Any number of wrenches may act on one
    frame.

    In place of it an algorithm takes a dict from names of frames (bodies are frames, welded links too) to SpatialForces
    (*batch,) about the origins of the frames, in world axes; and a list of several sources, which add up. They act on
    the bodies that carry the frames, see `Mechanism.frame_body`.

    Args:
        frames: names of frames, n of them; static. A name may come several times.
        wrenches: SpatialForce (*batch, n), each about its point: N m, N. A part that is left out, and NumPy zeros in a
            program that is traced, leave no operation behind.
        points: (n, 3) or (*batch, n, 3) positions of the points from the origins of their frames, in the axes of the
            frames, m; None for the origins.
        axes: the axes of the wrenches; static. "world": along the axes of the world. "frame": along the axes of each
            frame; a wrench then turns with its frame.

    Raises:
        TypeError: frames are no names, wrenches no SpatialForce, or dtypes differ.
        ValueError: the numbers of names, wrenches and points differ, or there are no such axes.

    Error: k wrenches on one body add ceil(log2 k) u mag to the error of algorithms: they are summed in pairs.

    Example:
        >>> push = js.AppliedForces(["hand"], js.SpatialForce(f=jnp.array([[5.0, 0.0, 0.0]])))  # world axes
        >>> print(js.inverse_dynamics(arm, q, 0 * v, 0 * v, push) - js.gravity_forces(arm, q))
        [9.1646 4.7767]
    """

    frames: tuple[str, ...]
    wrenches: SpatialForce
    points: jax.Array | None = None
    axes: Axes = "world"

    if TYPE_CHECKING:

        def __init__(
            self,
            frames: Iterable[str],
            wrenches: SpatialForce,
            points: ArrayLike | None = None,
            axes: Axes = "world",
        ): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; the placeholders in trees of axes or specs pass unchecked."""
        frames = check.as_tuple(self.frames, str, "AppliedForces: frames", "names")
        object.__setattr__(self, "frames", frames)
        if self.axes not in get_args(Axes):
            raise ValueError(f"AppliedForces: axes: expected 'world' or 'frame', got {self.axes!r}")
        if not isinstance(self.wrenches, SpatialForce):
            check.refuse("AppliedForces: wrenches", "a SpatialForce", self.wrenches)
        if all(map(check.is_tree_mark, (*vars(self.wrenches).values(), self.points))):
            return
        batch = self.wrenches.batch_shape
        if batch[-1:] != (len(frames),):
            expected = f"one for each of {len(frames)} frames, a batch of shape (*batch, {len(frames)})"
            raise ValueError(f"AppliedForces: wrenches: expected {expected}, got shape {batch}")
        if self.points is not None:
            points = floats.as_vectors(
                self.points, "AppliedForces: points", self.wrenches.dtype, many=[str(len(frames))], keep_dtype=True
            )
            if points.shape[-2] != len(frames):
                expected = f"(*batch, {len(frames)}, 3)"
                raise ValueError(f"AppliedForces: points: expected shape {expected}, got {points.shape}")
            check.same_dtype(wrenches=self.wrenches, points=points)
            floats.common_batch_shape(wrenches=batch[:-1], points=points.shape[:-2])
            object.__setattr__(self, "points", floats.owned(points))

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape, without the axis over frames."""
        batch = self.wrenches.batch_shape[:-1]
        return batch if self.points is None else floats.broadcast_shapes(batch, self.points.shape[:-2])

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return self.wrenches.dtype

    def __repr__(self) -> str:
        points = "" if self.points is None else f", points={check.in_short(self.points)}"
        return f"AppliedForces({list(self.frames)}, {self.wrenches!r}{points}, axes={self.axes!r})"
