"""Rigid transforms: where a frame is and how it is turned, and what that makes of spatial vectors."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self, overload

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.quantity import Quantity, require_alike
from jaxspatial.arithmetic.tree import rebuilt, tree
from jaxspatial.arithmetic.types import BatchShape, DTypeLike, Matrix, PrecisionName, Scalar, Vector3
from jaxspatial.rotation.matrices import as_matrices, expanded, matrices, owned, shown
from jaxspatial.rotation.rotation import Rotation, composed, rotated
from jaxspatial.spatial import transform_formulas as formulas
from jaxspatial.spatial.arguments import require_kind
from jaxspatial.spatial.velocity import SpatialVelocity

_OVER_UNIT_TIME = " (over unit time)"


@tree
class RigidTransform(Quantity):
    """X_AB: the pose of frame B in frame A. A point p_BoQ_B is p_AoQ_A = X_AB @ p_BoQ_B.

    rotation: Rotation R_AB
    translation: (*batch, 3) p_AoBo_A, metres
    """

    rotation: Rotation
    translation: jax.Array

    if TYPE_CHECKING:

        def __init__(self, rotation: Rotation, translation: Vector3): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; marks of a tree of axes or specs pass."""
        if all(map(check.is_tree_mark, self.vectors)):
            return
        require_kind(self.rotation, Rotation, "RigidTransform: rotation")
        p = check.as_vectors(self.translation, "RigidTransform: translation", self.rotation.dtype, held=True)
        R, p = check.alike(rotation=self.rotation, translation=p).values()
        batch = check.common_batch_shape(rotation=R.batch_shape, translation=p.shape[:-1])
        entries, p = check.broadcast_batch(batch, R.entries, p)
        object.__setattr__(self, "rotation", Rotation(entries))
        object.__setattr__(self, "translation", owned(p))

    def __repr__(self) -> str:
        return f"RigidTransform({self.rotation!r}, translation={shown(self.translation, 3)})"

    # -- construction --------------------------------------------------------------------------------------------------

    @classmethod
    def identity(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> Self:
        """The transform of a frame to itself, known while tracing. Exact.

        Args:
            batch_shape: shape of the batch.
            dtype: of the numbers; None takes JAX's default.

        Returns:
            The transform (*batch_shape,).

        Raises:
            TypeError: the dtype is not floating point.
        """
        R = Rotation.identity(batch_shape, dtype)
        return cls(R, np.zeros((*R.batch_shape, 3), R.dtype))

    @classmethod
    def from_matrix(cls, m: Matrix) -> Self:
        """From homogeneous matrices, taken as they are, whatever their last row. Exact.

        Args:
            m: (*batch, 4, 4).

        Returns:
            The transform (*batch,).

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit, or the upper left block is no rotation, as of `Rotation.from_matrix`.
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

        Error: as of `Rotation.exp`, of the translation at most 6 u |v|; beyond half a turn, 2 u |w| |v| more.
        Source: Murray, Li, Sastry 1994, 2.36.
        """
        require_kind(V, SpatialVelocity, "RigidTransform.exp", _OVER_UNIT_TIME)
        entries, p = formulas.exp(precision, V.w, V.v)
        return cls(Rotation(entries), p)

    # -- to other forms -----------------------------------------------------------------------------------------------

    def to_matrix(self) -> jax.Array:
        """The homogeneous matrix (*batch, 4, 4), with the last row 0 0 0 1. Exact."""
        return matrices(formulas.to_matrix("reproducible", self.rotation.entries, self.translation), 4)

    def log(self, *, precision: PrecisionName = None) -> SpatialVelocity:
        """The SpatialVelocity that makes this motion in unit time: exp(log(X)) = X.

        At half a turn it jumps, see `Rotation.log`.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            The velocity (*batch,) about Ao: w in rad, at most pi long, v in m.

        Error: as of `Rotation.log`, of v at most 8 u |v|.
        """
        return SpatialVelocity(*formulas.log(precision, self.rotation.entries, self.translation))

    @property
    def vectors(self) -> tuple[Any, ...]:
        return getattr(self.rotation, "entries", self.rotation), self.translation

    def with_vectors(self, vectors: Iterable[Any]) -> "RigidTransform":
        entries, p = vectors
        R = rebuilt(Rotation, ("entries",), (entries,))
        return rebuilt(RigidTransform, ("rotation", "translation"), (R, p))

    # -- operations ---------------------------------------------------------------------------------------------------

    def inverse(self, *, precision: PrecisionName = None) -> "RigidTransform":
        """X_BA of X_AB: (R^T, -R^T p).

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            The transform (*batch,).

        Error: of the translation as of `rotate`; the rotation is exact.
        """
        R_BA = self.rotation.inverse()
        return RigidTransform(R_BA, -rotated(R_BA, self.translation, precision=precision))

    @overload
    def __matmul__(self, other: "RigidTransform") -> "RigidTransform": ...

    @overload
    def __matmul__(self, other: Any) -> Any: ...

    def __matmul__(self, other: Any) -> Any:
        """X_AB @ p_BQ is p_AQ, (*batch, 3), m, of points; X_AB @ X_BC is X_AC; over the common batch.

        Error: per component of a point, mag = |R| |p_BQ| + |p_AB|: at most 4 u mag in "fast" and "reproducible",
            u |r| + 8 u^2 mag in "compensated", 1 ulp in "faithful". Of X_AC so of the translation, of the rotation as
            of `R_AB @ R_BC`.
        """
        return transformed(self, other)

    def inverse_times(self, other: "RigidTransform", *, precision: PrecisionName = None) -> "RigidTransform":
        """X_AB^-1 X_AC = X_BC, with the difference of the translations taken before it is rotated.

        Args:
            other: X_AC (*batch,).
            precision: name of a precision; None takes the default.

        Returns:
            X_BC, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: of the rotation as of `rotate`, of the translation as of `act_inverse`.
        """
        check.require_same_dtype(left=self, right=other)
        R_BC = composed(self.rotation.inverse(), other.rotation, precision=precision)
        p = formulas.moved_back(precision, self.rotation.entries, self.translation, other.translation)
        return RigidTransform(R_BC, p)

    def interpolate(self, other: "RigidTransform", t: Scalar, *, precision: PrecisionName = None) -> "RigidTransform":
        """X exp(t log(X^-1 X2)): at constant velocity from this pose to the other: a screw motion.

        Args:
            other: X2 (*batch,). The way is the shorter one; at half a turn see `Rotation.log`.
            t: (*batch,), any number: 0 for this pose, 1 for the other.
            precision: name of a precision; None takes the default.

        Returns:
            The transform, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: at most 24 u normwise and 16 u |t|, of the translation times the size of both.
        """
        t = check.as_float_array(t, "RigidTransform.interpolate: t", self.dtype)
        check.require_same_dtype(start=self, end=other, t=t)
        arrays = (self.rotation.entries, self.translation, other.rotation.entries, other.translation, expanded(t))
        entries, p = formulas.interpolated(precision, *arrays)
        return RigidTransform(Rotation(entries), p)

    @staticmethod
    def left_jacobian(V: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
        """J, rotational on top, with exp(V + e) = exp(J e) exp(V) for small e.

        Args:
            V: SpatialVelocity (*batch,) over unit time: w in rad, v in m.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 6, 6).

        Raises:
            TypeError: V is no SpatialVelocity.

        Error: at most 12 u normwise for |w| <= pi.
        Source: Barfoot 2017, 7.1.5.
        """
        require_kind(V, SpatialVelocity, "RigidTransform.left_jacobian", _OVER_UNIT_TIME)
        return matrices(formulas.left_jacobian(precision, V.w, V.v), 6)

    @staticmethod
    def left_jacobian_inverse(V: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
        """J^-1 of `left_jacobian`.

        Args:
            V: SpatialVelocity (*batch,) over unit time: w in rad, v in m.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 6, 6); infinite at |w| = 2 pi.

        Raises:
            TypeError: V is no SpatialVelocity.

        Error: at most 16 u normwise for |w| <= pi.
        Source: Barfoot 2017, 7.1.5.
        """
        require_kind(V, SpatialVelocity, "RigidTransform.left_jacobian_inverse", _OVER_UNIT_TIME)
        return matrices(formulas.left_jacobian_inverse(precision, V.w, V.v), 6)

    def to_motion_matrix(self) -> jax.Array:
        """[[R, 0], [p x R, R]]: what `act` does to the coefficients of a velocity.

        Its inverse transpose does it to a force.

        Returns:
            (*batch, 6, 6), rotational on top.

        Error: as of `cross`.
        """
        return matrices(formulas.motion_matrix(None, self.rotation.entries, self.translation), 6)


def transformed(X_AB: RigidTransform, other: Any, *, precision: PrecisionName = None) -> Any:
    """Points p_BQ as p_AQ = R p + p_AB, or a RigidTransform X_BC as X_AC.

    Args:
        X_AB: the transform (*batch,).
        other: (*batch, 3) positions of points from Bo, m, expressed in frame B; or a RigidTransform (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        p_AQ (*batch, 3), m, from Ao, in A; or X_AC; over the common batch. 18 flops; of a transform 63.

    Raises:
        TypeError: other is a spatial vector, or dtypes differ.
        ValueError: shapes do not fit.

    Error: as of `X_AB @ p_BQ`.
    """
    if isinstance(other, RigidTransform):
        return _composed(X_AB, other, precision)
    if isinstance(other, Quantity):
        raise TypeError(f"RigidTransform @ p: expected points or a RigidTransform, got {type(other).__name__}; see act")
    p = check.as_vectors(other, "RigidTransform @ p: p", X_AB.dtype)
    require_alike(RigidTransform=X_AB, p=p)
    return formulas.moved(precision, X_AB.rotation.entries, X_AB.translation, p)


def _composed(X_AB: RigidTransform, X_BC: RigidTransform, precision: PrecisionName) -> RigidTransform:
    check.require_same_dtype(left=X_AB, right=X_BC)
    R_AC = composed(X_AB.rotation, X_BC.rotation, precision=precision)
    return RigidTransform(R_AC, transformed(X_AB, X_BC.translation, precision=precision))
