"""Rigid transforms: the pose of a frame in another, exponential and logarithm, and transformed points."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Self, overload

import jax

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.check import require_kind
from jaxspatial.numerics.floats import expanded, matrices
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Matrix, Motion, Pose, Vector, cross
from jaxspatial.numerics.numbers import Numbers, constant
from jaxspatial.numerics.promise import Promise, promises
from jaxspatial.numerics.quantity import Quantity, rebuilt, require_compatible, tree
from jaxspatial.numerics.types import ArrayLike, BatchShape, DTypeLike, PrecisionName
from jaxspatial.rotation import exponential
from jaxspatial.rotation.rotation import EACH_WAY, INTERPOLATED, TURNS, Rotation, composed, normwise, rotated
from jaxspatial.spatial.vectors import SpatialVelocity

# Error bounds, see `numerics.promise`.
POINT = Promise(4, 8, mag="|R| |p_BQ| + |p_AB|")
EXP_TRANSLATION, LOG_TRANSLATION = normwise(6, "|v|"), normwise(8, "|v|")
MOTION_JACOBIAN, MOTION_JACOBIAN_INVERSE = normwise(12), normwise(16)

_OVER_UNIT_TIME = " (over unit time)"

# -- formulas over arrays ---------------------------------------------------------------------------------------------

_exp, _log = formula(exponential.pose), formula(exponential.motion_logarithm)
_moved = formula(lambda X, p: X.p + X.R @ p, of_sums=True)
_moved_back = formula(lambda X, p: X.R.T @ (p - X.p), of_sums=True, layout=(2,))


@formula(of_sums=True)
def _motion_matrix(X: Pose) -> Numbers:
    lower = Matrix(*(cross(X.p, column) for column in X.R.T)).T
    return _blocks(X.R, lower)


@formula
def _to_matrix(X: Pose) -> Numbers:
    (a, b, c), p = X
    return *a, p[0], *b, p[1], *c, p[2], *(constant(p[0], int(i == 3)) for i in range(4))


@formula
def _interpolated(X: Pose, Y: Pose, t: Numbers) -> Pose:
    # By components: a difference of vectors of double words is stacked into one, which takes longer here.
    arm = Vector(*(b - a for a, b in zip(X.p, Y.p, strict=True)))
    w, v = exponential.motion_logarithm(X.R.T @ Y.R, X.R.T @ arm)
    step = exponential.pose(Motion(t[0] * w, t[0] * v))
    return Pose(X.R @ step.R, X.p + X.R @ step.p)


@formula
def _left_jacobian(w: Vector, v: Vector) -> Numbers:
    return _blocks(exponential.left_jacobian(w), exponential.coupling(w, v))


@formula
def _left_jacobian_inverse(w: Vector, v: Vector) -> Numbers:
    inverse = exponential.left_jacobian_inverse(w)
    return _blocks(inverse, -(inverse @ (exponential.coupling(w, v) @ inverse)))


def _blocks(diagonal: Matrix, lower: Matrix) -> Numbers:
    """The entries of [[diagonal, 0], [lower, diagonal]]."""
    zero = (constant(diagonal[0][0], 0),) * 3
    top = tuple(x for row in diagonal for x in (*row, *zero))
    return top + tuple(x for rows in zip(lower, diagonal, strict=True) for row in rows for x in row)


@tree
class RigidTransform(Quantity):
    """X_AB: the pose of frame B in frame A. A point p_BoQ_B is p_AoQ_A = X_AB @ p_BoQ_B.

    rotation: Rotation R_AB
    translation: (*batch, 3) p_AoBo_A, metres

    Example:
        >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
        >>> print(X_AB @ [0.0, 1.0, 0.0])
        [2. 1. 0.]
        >>> print((X_AB @ X_AB).translation)
        [4. 0. 0.]
    """

    rotation: Rotation
    translation: jax.Array

    if TYPE_CHECKING:

        def __init__(self, rotation: Rotation, translation: ArrayLike): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; the placeholders in trees of axes or specs pass unchecked."""
        if all(map(check.is_tree_mark, self._vectors)):
            return
        require_kind(self.rotation, Rotation, "RigidTransform: rotation")
        p = floats.as_vectors(self.translation, "RigidTransform: translation", self.rotation.dtype, keep_dtype=True)
        R, p = check.same_dtype(rotation=self.rotation, translation=p).values()
        batch = floats.common_batch_shape(rotation=R.batch_shape, translation=p.shape[:-1])
        entries, p = floats.broadcast_batch(batch, R.entries, p)
        object.__setattr__(self, "rotation", Rotation(entries))
        object.__setattr__(self, "translation", floats.owned(p))

    def __repr__(self) -> str:
        return f"RigidTransform({self.rotation!r}, translation={check.shown(self.translation, 3)})"

    # -- construction -------------------------------------------------------------------------------------------------

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

        Example:
            >>> print(js.RigidTransform.identity() @ [0.0, 1.0, 0.0])
            [0. 1. 0.]
        """
        R = Rotation.identity(batch_shape, dtype)
        return cls(R, floats.numpy_for(R.batch_shape).zeros((*R.batch_shape, 3), R.dtype))

    @classmethod
    def from_matrix(cls, m: ArrayLike) -> Self:
        """From homogeneous matrices, taken as they are, whatever their last row. Exact.

        Args:
            m: (*batch, 4, 4).

        Returns:
            The transform (*batch,).

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit, or the upper left block is no rotation, as of `Rotation.from_matrix`.

        Example:
            >>> X_AB = js.RigidTransform.from_matrix([[1.0, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
            >>> print(X_AB.translation)
            [2. 0. 0.]
        """
        m = matrices(floats.as_matrices(m, "RigidTransform.from_matrix: m", 4), 4)
        return cls(Rotation.from_matrix(m[..., :3, :3]), m[..., :3, 3])

    @classmethod
    @promises(translation=EXP_TRANSLATION, beyond=TURNS)
    def exp(cls, V: SpatialVelocity, *, precision: PrecisionName = None) -> Self:
        """The pose that frame B reaches in unit time, from A, at the constant velocity V_AB_A.

        Args:
            V: SpatialVelocity (*batch,) about Ao, over unit time: w in rad, v in m.
            precision: name of a precision; None takes the default.

        Returns:
            X_AB (*batch,).

        Raises:
            TypeError: V is no SpatialVelocity.

        Error: as of `Rotation.exp`, of the translation at most 6 u |v|; beyond half a turn, 2 u |w| |v| more.
        Source: Murray, Li, Sastry 1994, 2.36.

        Example:
            >>> screw = js.SpatialVelocity(w=[0.0, 0.0, np.pi], v=[0.0, 0.0, 1.0])
            >>> print(js.RigidTransform.exp(screw).translation)
            [0. 0. 1.]
        """
        require_kind(V, SpatialVelocity, "RigidTransform.exp", _OVER_UNIT_TIME)
        entries, p = _exp(precision, Motion(*V._vectors))
        return cls(Rotation(entries), p)

    # -- to other forms -----------------------------------------------------------------------------------------------

    def to_matrix(self) -> jax.Array:
        """The homogeneous matrix (*batch, 4, 4), with the last row 0 0 0 1. Exact.

        Example:
            >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
            >>> print(X_AB.to_matrix()[0])
            [1. 0. 0. 2.]
        """
        return matrices(_to_matrix("reproducible", self._pose), 4)

    @promises(translation=LOG_TRANSLATION)
    def log(self, *, precision: PrecisionName = None) -> SpatialVelocity:
        """The constant velocity that leads from A to B in unit time: exp(log(X)) = X.

        At half a turn it jumps, see `Rotation.log`.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            The velocity (*batch,) about Ao: w in rad, at most pi long, v in m.

        Error: as of `Rotation.log`, of v at most 8 u |v|.

        Example:
            >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
            >>> X_AB.log()
            SpatialVelocity(w=[0.0, 0.0, 0.0], v=[2.0, 0.0, 0.0])
        """
        return SpatialVelocity(*_log(precision, *self._vectors))

    @property
    def _vectors(self) -> tuple:
        return getattr(self.rotation, "entries", self.rotation), self.translation

    @property
    def _pose(self) -> Pose:
        return Pose(*self._vectors)

    def _with_vectors(self, vectors: Iterable) -> "RigidTransform":
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

        Example:
            >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
            >>> print(X_AB.inverse() @ [2.0, 1.0, 0.0])
            [0. 1. 0.]
        """
        R_BA = self.rotation.inverse()
        return RigidTransform(R_BA, -rotated(R_BA, self.translation, precision=precision))

    @overload
    def __matmul__(self, other: "RigidTransform") -> "RigidTransform": ...

    @overload
    def __matmul__(self, other: ArrayLike) -> jax.Array: ...

    @promises(point=POINT)
    def __matmul__(self, other) -> Any:
        """X_AB @ p_BQ is p_AQ, (*batch, 3), m, of points; X_AB @ X_BC is X_AC; over the common batch.

        Error: per component of a point, mag = |R| |p_BQ| + |p_AB|: at most 4 u mag in "fast" and "reproducible", u |r|
            + 8 u^2 mag in "compensated", 1 ulp of r in "faithful". The translation of X_AC has the same bound, its
            rotation that of `R_AB @ R_BC`.
        """
        return transformed(self, other)

    def inverse_times(self, other: "RigidTransform", *, precision: PrecisionName = None) -> "RigidTransform":
        """X_BC = X_AB^-1 X_AC. Translations are subtracted before they are rotated.

        Args:
            other: X_AC (*batch,).
            precision: name of a precision; None takes the default.

        Returns:
            X_BC, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: of the rotation as of `rotate`, of the translation as of `act_inverse`.

        Example:
            >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
            >>> X_AC = js.RigidTransform(js.Rotation.identity(), [2.0, 1.0, 0.0])
            >>> print(X_AB.inverse_times(X_AC).translation)
            [0. 1. 0.]
        """
        require_kind(other, RigidTransform, "RigidTransform.inverse_times: other")
        check.require_same_dtype(left=self, right=other)
        R_BC = composed(self.rotation.inverse(), other.rotation, precision=precision)
        p = _moved_back(precision, self._pose, other.translation)
        return RigidTransform(R_BC, p)

    @promises(bound=INTERPOLATED, each_way=EACH_WAY)
    def interpolate(
        self, other: "RigidTransform", t: ArrayLike, *, precision: PrecisionName = None
    ) -> "RigidTransform":
        """A pose on the screw motion from this pose X to another: X exp(t log(X^-1 X2)).

        Args:
            other: X2 (*batch,). The rotation takes the shorter way; at half a turn see `Rotation.log`.
            t: (*batch,), any number: 0 for this pose, 1 for the other.
            precision: name of a precision; None takes the default.

        Returns:
            The transform, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: at most 24 u normwise and 16 u |t|, of the translation times the size of both.

        Example:
            >>> X = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
            >>> Y = js.RigidTransform(js.Rotation.identity(), [4.0, 0.0, 0.0])
            >>> print(X.interpolate(Y, 0.25).translation)
            [2.5 0.  0. ]
        """
        require_kind(other, RigidTransform, "RigidTransform.interpolate: other")
        t = expanded(floats.as_float_array(t, "RigidTransform.interpolate: t", self.dtype))
        check.require_same_dtype(start=self, end=other, t=t)
        entries, p = _interpolated(precision, self._pose, other._pose, t)
        return RigidTransform(Rotation(entries), p)

    @staticmethod
    @promises(bound=MOTION_JACOBIAN)
    def left_jacobian(V: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
        """The left Jacobian J of the exponential: exp(V + e) = exp(J e) exp(V) for small e. Rotational on top.

        Args:
            V: SpatialVelocity (*batch,) over unit time: w in rad, v in m.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 6, 6).

        Raises:
            TypeError: V is no SpatialVelocity.

        Error: at most 12 u normwise for |w| <= pi.
        Source: Barfoot 2017, 7.1.5.

        Example:
            >>> V = js.SpatialVelocity(w=[0.0, 0.0, 0.0], v=[2.0, 0.0, 0.0])
            >>> print(js.RigidTransform.left_jacobian(V)[5])
            [0. 1. 0. 0. 0. 1.]
        """
        require_kind(V, SpatialVelocity, "RigidTransform.left_jacobian", _OVER_UNIT_TIME)
        return matrices(_left_jacobian(precision, *V._vectors), 6)

    @staticmethod
    @promises(bound=MOTION_JACOBIAN_INVERSE)
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

        Example:
            >>> V = js.SpatialVelocity(w=[0.0, 0.0, 0.0], v=[2.0, 0.0, 0.0])
            >>> print(js.RigidTransform.left_jacobian_inverse(V)[5, 1])
            -1.0
        """
        require_kind(V, SpatialVelocity, "RigidTransform.left_jacobian_inverse", _OVER_UNIT_TIME)
        return matrices(_left_jacobian_inverse(precision, *V._vectors), 6)

    def to_motion_matrix(self) -> jax.Array:
        """The matrix by which `act` multiplies the coefficients of a velocity: [[R, 0], [p x R, R]].

        For a force it is the inverse transpose.

        Returns:
            (*batch, 6, 6), rotational on top.

        Error: as of `cross`.

        Example:
            >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
            >>> print(X_AB.to_motion_matrix()[4])
            [ 0.  0. -2.  0.  1.  0.]
        """
        return matrices(_motion_matrix(None, self._pose), 6)


def transformed(X_AB: RigidTransform, other, *, precision: PrecisionName = None) -> Any:
    """Transforms points, p_AQ = R p_BQ + p_AB, or composes with a RigidTransform, X_AC = X_AB X_BC.

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
        check.require_same_dtype(left=X_AB, right=other)
        R_AC = composed(X_AB.rotation, other.rotation, precision=precision)
        return RigidTransform(R_AC, transformed(X_AB, other.translation, precision=precision))
    if isinstance(other, Quantity):
        raise TypeError(f"RigidTransform @ p: expected points or a RigidTransform, got {type(other).__name__}; see act")
    p = floats.as_vectors(other, "RigidTransform @ p: p", X_AB.dtype)
    require_compatible(RigidTransform=X_AB, p=p)
    return _moved(precision, X_AB._pose, p)
