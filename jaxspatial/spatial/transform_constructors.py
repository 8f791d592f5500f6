"""How a `RigidTransform` is made: its named constructors, the base of that class."""

from typing import TYPE_CHECKING, Self

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.quantity import Quantity
from jaxspatial.arithmetic.types import BatchShape, DTypeLike, Matrix, PrecisionName, Vector3
from jaxspatial.rotation.matrices import as_matrices, matrices, owned
from jaxspatial.rotation.rotation import Rotation
from jaxspatial.spatial import transform_formulas as formulas
from jaxspatial.spatial.arguments import require_kind
from jaxspatial.spatial.velocity import SpatialVelocity

OVER_UNIT_TIME = " (over unit time)"


class Constructors(Quantity):
    """X_AB by its rotation and translation, and the classmethods that make it."""

    rotation: Rotation
    translation: jax.Array

    if TYPE_CHECKING:

        def __init__(self, rotation: Rotation, translation: Vector3): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; marks of a tree of axes or specs pass."""
        if all(map(check.is_tree_mark, (getattr(self.rotation, "entries", self.rotation), self.translation))):
            return
        require_kind(self.rotation, Rotation, "RigidTransform: rotation")
        p = check.as_vectors(self.translation, "RigidTransform: translation", self.rotation.dtype, held=True)
        R, p = check.alike(rotation=self.rotation, translation=p).values()
        batch = check.common_batch_shape(rotation=R.batch_shape, translation=p.shape[:-1])
        entries, p = check.broadcast_batch(batch, R.entries, p)
        object.__setattr__(self, "rotation", Rotation(entries))
        object.__setattr__(self, "translation", owned(p))

    @classmethod
    def identity(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> Self:
        """The transform of a frame to itself, known while tracing.

        Args:
            batch_shape: shape of the batch.
            dtype: of the numbers; None takes JAX's default.

        Returns:
            The transform (*batch_shape,).

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, it is exact.
        """
        R = Rotation.identity(batch_shape, dtype)
        return cls(R, np.zeros((*R.batch_shape, 3), R.dtype))

    @classmethod
    def from_matrix(cls, m: Matrix) -> Self:
        """From homogeneous matrices, taken as they are, whatever their last row.

        Args:
            m: (*batch, 4, 4).

        Returns:
            The transform (*batch,).

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit, or the upper left block is no rotation, as of `Rotation.from_matrix`.

        Error: none, it is exact.
        """
        found = matrices(as_matrices(m, "RigidTransform.from_matrix: m", 4), 4)
        return cls(Rotation.from_matrix(found[..., :3, :3]), found[..., :3, 3])

    @classmethod
    def exp(cls, V: SpatialVelocity, *, precision: PrecisionName = None) -> Self:
        """Where a frame gets in unit time that moves at V_AB_A, constant in both frames, from A.

        Args:
            V: SpatialVelocity (*batch,) about Ao, over unit time: w in rad, v in m.
            precision: name of a precision; None takes the default.

        Returns:
            X_AB (*batch,).

        Raises:
            TypeError: V is no SpatialVelocity.

        Error: as of `Rotation.exp`, of the translation at most 6 u |v|; beyond half a turn, 2 u |w| |v|
            more.
        Source: Murray, Li, Sastry 1994, 2.36.
        """
        require_kind(V, SpatialVelocity, "RigidTransform.exp", OVER_UNIT_TIME)
        entries, p = formulas.exp(precision, V.w, V.v)
        return cls(Rotation(entries), p)
