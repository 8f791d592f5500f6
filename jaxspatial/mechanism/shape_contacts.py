"""Shapes on bodies, which spheres on other bodies touch."""

from collections.abc import Iterable
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING

import jax
import numpy as np

from jaxspatial.mechanism.contacts import LAW, per_frame
from jaxspatial.mechanism.shapes import Shape
from jaxspatial.numerics import check, floats
from jaxspatial.numerics.quantity import OfOneDtype, exported_tree_of
from jaxspatial.numerics.types import ArrayLike


@exported_tree_of("frames")
class ShapeContacts(OfOneDtype):
    """A shape on each of some named frames, for the `pairs` of a step: spheres on other bodies touch it.

    Sphere i of the other touches the shape on frame i: a name comes once for each sphere that may touch its shape.

    Args:
        frames: names of frames, n of them; static.
        shape: where the shape is in each of the frames: a Box, a Sphere, a HalfSpace, a Union; or any other, such as a
            SignedDistance of one's own. The `placement` is in the axes of the frame. Of a batch each frame has its own:
            the last axis of the batch is over n, or 1.
        stiffness: k, N/m, above zero: a number, (n,) or (*batch, n), as all that follow.
        relaxation_time: tau_d, s.
        friction: the coefficient of Coulomb friction.

    Raises:
        TypeError: frames are no names, shape is no shape, or dtypes differ.
        ValueError: shapes do not fit, or a number known while tracing is negative or NaN, a stiffness zero.

    Error: none, nothing is computed.

    Example:
        >>> law = {"stiffness": 1e4, "relaxation_time": 0.01, "friction": 0.8}
        >>> crate, tip = js.ShapeContacts(["world"], js.Box([4.0, 4.0, 4.0]), **law), js.PointContacts(["hand"], **law)
        >>> print(js.contact_report(arm, q, v, pairs=(crate, tip)).depths)
        [0.1671]
    """

    frames: tuple[str, ...]
    shape: Shape
    _: KW_ONLY
    stiffness: jax.Array
    relaxation_time: jax.Array
    friction: jax.Array

    # Shapes are about the origins of their frames.
    positions = None

    if TYPE_CHECKING:

        def __init__(
            self,
            frames: Iterable[str],
            shape: Shape,
            *,
            stiffness: ArrayLike,
            relaxation_time: ArrayLike,
            friction: ArrayLike,
        ): ...

    def __post_init__(self) -> None:
        frames = check.as_tuple(self.frames, str, "ShapeContacts: frames", "names")
        object.__setattr__(self, "frames", frames)
        given = {name: getattr(self, name) for name in LAW}
        if all(map(check.is_tree_mark, (*given.values(), *jax.tree.leaves(self.shape)))):
            return
        if not isinstance(self.shape, Shape):
            check.refuse("ShapeContacts: shape", "a shape, such as js.Box", self.shape)
        n = len(frames)
        if self.shape.batch_shape and self.shape.batch_shape[-1] not in (1, n):
            raise ValueError(
                f"ShapeContacts: shape: expected one, or a batch (*batch, {n}), got {self.shape.batch_shape}"
            )
        dtype = self.shape.dtype
        arrays = {k: per_frame("ShapeContacts", k, x, n, dtype) for k, x in given.items()}
        check.require_same_dtype(shape=self.shape, **arrays)
        for name, x in arrays.items():
            object.__setattr__(self, name, floats.owned(x))

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """The batch shape, without the axis over frames."""
        shapes = (self.shape.batch_shape, *(getattr(self, k).shape for k in LAW))
        return floats.broadcast_shapes(*(s[:-1] for s in shapes))

    @property
    def dtype(self) -> np.dtype:
        """The dtype of the numbers."""
        return self.shape.dtype

    def __repr__(self) -> str:
        numbers = ", ".join(f"{k}={check.shown(getattr(self, k), 0)}" for k in LAW)
        return f"ShapeContacts({list(self.frames)}, {self.shape!r}, {numbers})"
