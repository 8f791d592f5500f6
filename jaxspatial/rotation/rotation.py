"""Rotations: what they are made of, what they are converted to, and what they do to vectors.

The mathematics is in `quaternion` and `exponential`, over numbers.
"""

import operator
from typing import TYPE_CHECKING, Any, Self, overload

import jax
import numpy as np
from jax.core import Tracer

from jaxspatial.numerics import check, floats
from jaxspatial.numerics.floats import expanded, matrices
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.linear import Matrix, unit
from jaxspatial.numerics.numbers import Numbers
from jaxspatial.numerics.numbers.components import as_array
from jaxspatial.numerics.numbers.double_word import from_double_word
from jaxspatial.numerics.promise import Normwise, Promise, promises
from jaxspatial.numerics.quantity import Quantity, require_compatible, tree
from jaxspatial.numerics.types import ArrayLike, BatchShape, DTypeLike, PrecisionName
from jaxspatial.rotation import exponential, quaternion

# -- error bounds: see `numerics.promise` -----------------------------------------------------------------------------


def normwise(u: float, of: str = "normwise") -> Normwise:
    """Of angles: in "compensated" and "faithful" every number is rounded once."""
    return Normwise(u, of, u2=16 * u)


# R v, of a vector or of each column of a rotation.
ROTATED = Promise(3, 4)
SINE = normwise(2, "for angles")
FROM_QUATERNION, FROM_AXIS_ANGLE, FROM_ROLL_PITCH_YAW = normwise(6), normwise(8), normwise(8)
TO_QUATERNION, TO_AXIS, TO_ANGLE = normwise(4), normwise(6, "of the axis"), normwise(8, "of the angle")
# Of the rotation that three angles make: rounding these alone turns by up to 2 u, 1 u and 2 u.
TO_ROLL_PITCH_YAW, TO_ROLL = normwise(24)._replace(rounded=5), normwise(24, "/ cos(pitch)")
FROM_ONE_VECTOR, FROM_TWO_VECTORS, BETWEEN, NEAREST = normwise(6), normwise(8), normwise(8), normwise(12)
EXP, LOG, JACOBIAN, JACOBIAN_INVERSE = normwise(6), normwise(6), normwise(6), normwise(6)
# What exp adds beyond half a turn, and interpolation for each time that the whole way is covered.
TURNS, EACH_WAY = Normwise(2, "|w|", rounded=0), normwise(16, "|t|")._replace(rounded=0)
INTERPOLATED = normwise(24)

# -- formulas over arrays, a rotation as its matrix -------------------------------------------------------------------

_rotated = formula(lambda R, *vectors: [R @ v for v in vectors], of_sums=True, layout=(1, 2))
_transposed = formula(lambda R: R.T, of_sums=True)
_composed = formula(operator.matmul, of_sums=True, layout=(0,))
_from_quaternion = formula(lambda q: quaternion.to_matrix(unit(q)))
_from_axis_angle = formula(lambda axis, angle: quaternion.to_matrix(quaternion.about_axis(axis, angle[0])))
_about = formula(lambda angle, axis: quaternion.matrix_about(axis, angle[0]))
_to_axis_angle = formula(lambda R: quaternion.axis_angle(quaternion.from_matrix(R)))
_from_roll_pitch_yaw = formula(lambda rpy: quaternion.to_matrix(quaternion.from_roll_pitch_yaw(*rpy)))
_to_roll_pitch_yaw = formula(lambda R: quaternion.roll_pitch_yaw(quaternion.from_matrix(R)))
_between = formula(lambda a, b: quaternion.to_matrix(quaternion.between(a, b)))
_exp, _log, _to_quaternion = map(formula, (exponential.rotation, exponential.rotation_vector, quaternion.from_matrix))
_left_jacobian, _left_jacobian_inverse = map(formula, (exponential.left_jacobian, exponential.left_jacobian_inverse))
_from_one_vector, _from_two_vectors = map(formula, (quaternion.from_one_vector, quaternion.from_two_vectors))
_nearest = formula(quaternion.nearest)


@formula
def _interpolated(R: Matrix, S: Matrix, t: Numbers) -> Matrix:
    return R @ exponential.rotation(t[0] * exponential.rotation_vector(R.T @ S))


_MAKERS = "; of matrices make one with Rotation.from_matrix, of quaternions with Rotation.from_quaternion"


@tree
class Rotation(Quantity):
    """R_AB: re-expresses in frame A what is expressed in frame B.

    entries: (*batch, 9) the matrix, row by row.

    What the error bounds of all constructors and functions below mean: u is the unit roundoff of the inputs' dtype; an
    error of k u normwise is one of the whole vector, or matrix, in its 2-norm (of a matrix Frobenius'), relative to it.
    In "fast" and "reproducible" bounds hold as stated (float16 and bfloat16 are computed in float32). In "compensated"
    and "faithful" formulas are evaluated in float64, or for float64 in double words, and every number r of the result
    is rounded once: off by u |r|, and by 16 k u^2 of the size of the whole. That is 1.01 u normwise. Derivatives of any
    order are those of the function, also where it has a removable singularity.

    Where subnormals are flushed to zero (XLA CPU), components below finfo.tiny (float32 1.2e-38, float64 2.2e-308)
    count as 0 in all precisions, in arguments too: 8 finfo.tiny are added to errors, also to those of `log` and
    `to_quaternion` of the smallest angles. The direction of a vector (`between`, `from_two_vectors`, ...) keeps its
    digits down to a length of finfo.tiny / eps; scale up shorter vectors.

    Example:
        >>> R_AB = js.Rotation.about_z(np.pi / 2)
        >>> print(R_AB @ [1.0, 2.0, 0.0])
        [-2.  1.  0.]
        >>> print(R_AB.log(), R_AB.to_quaternion())
        [0.     0.     1.5708] [0.7071 0.     0.     0.7071]
    """

    entries: jax.Array

    if TYPE_CHECKING:

        def __init__(self, entries: ArrayLike): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; marks of a tree of axes or specs pass."""
        if not check.is_tree_mark(self.entries):
            entries = floats.as_vectors(self.entries, "Rotation: entries", size=9, keep_dtype=True, otherwise=_MAKERS)
            object.__setattr__(self, "entries", floats.owned(entries))

    def __repr__(self) -> str:
        return f"Rotation({check.shown(self.entries, 3)})"

    # -- construction -------------------------------------------------------------------------------------------------

    @classmethod
    def identity(cls, batch_shape: BatchShape = (), dtype: DTypeLike | None = None) -> Self:
        """The rotation that changes nothing, known while tracing: it leaves no operation behind.

        Args:
            batch_shape: an integer or a tuple.
            dtype: of floating point; None takes JAX's default.

        Returns:
            Identities, over the batch shape.

        Raises:
            TypeError: the dtype is not floating point.

        Error: none, it is exact.

        Example:
            >>> R_AB = js.Rotation.identity()
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [1. 2. 3.]
        """
        shape = check.as_batch_shape(batch_shape)
        entries = np.eye(3, dtype=floats.as_dtype(dtype)).ravel()
        return cls(floats.numpy_for(shape).broadcast_to(entries, (*shape, 9)))

    @classmethod
    def from_matrix(cls, m: ArrayLike) -> Self:
        """The rotation of matrices, taken as they are, digit by digit.

        Args:
            m: (*batch, 3, 3). NaN passes. *unchecked* while tracing, and in `Rotation(entries)`.

        Returns:
            The rotation, over the batch of m.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit, or numbers are no rotation: an entry of m m^T is 1e-3 + 16 eps or more
                off that of the identity, or the determinant is negative. The check finds scaled, mirrored and
                unfinished matrices, not drift: `nearest` removes that.

        Error: none, it is exact.

        Example:
            >>> R_AB = js.Rotation.from_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
            >>> print(R_AB @ [1.0, 2.0, 0.0])
            [-2.  1.  0.]
        """
        entries = floats.as_matrices(m, "Rotation.from_matrix: m")
        _require_rotations(entries, "Rotation.from_matrix: m")
        return cls(entries)

    @classmethod
    @promises(bound=NEAREST)
    def nearest(cls, m: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The rotation nearest to a matrix in the Frobenius norm: it removes the drift of many products.

        Args:
            m: (*batch, 3, 3).
            precision: name of a precision; None takes the default.

        Returns:
            The rotation; NaN where the determinant is not positive.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 12 u normwise for matrices near a rotation; times 2 / (s2 + s3) in general, of singular values s1
            = 1 >= s2 >= s3.
        Source: Higham 1986, Computing the polar decomposition.

        Example:
            >>> R_AB = js.Rotation.nearest([[0.0, -2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [-2.  1.  3.]
        """
        return cls(_nearest(precision, floats.as_matrices(m, "Rotation.nearest: m")))

    @classmethod
    @promises(bound=FROM_QUATERNION)
    def from_quaternion(cls, wxyz: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The rotation of a quaternion.

        Args:
            wxyz: (*batch, 4), real part first, of any length but 0.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation; NaN for a quaternion of length 0.

        Raises:
            TypeError: wxyz is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 6 u normwise.

        Example:
            >>> R_AB = js.Rotation.from_quaternion([1.0, 0.0, 0.0, 1.0])
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [-2.  1.  3.]
        """
        q = floats.as_vectors(wxyz, "Rotation.from_quaternion: wxyz", size=4)
        return cls(_from_quaternion(precision, q))

    @classmethod
    @promises(bound=EXP, beyond=TURNS)
    def exp(cls, w: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The rotation about w by |w| radians, to which the angular velocity w leads in unit time.

        Args:
            w: (*batch, 3), rad.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation, with derivatives of all orders everywhere, at 0 too; NaN where u |w| is as large as a turn.

        Raises:
            TypeError: w is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 6 u normwise for |w| <= pi; beyond, 2 u |w| more in "fast" and "reproducible".
        Source: Rodrigues 1840.

        Example:
            >>> R_AB = js.Rotation.exp([0.0, 0.0, np.pi / 2])
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [-2.  1.  3.]
        """
        return cls(_exp(precision, floats.as_vectors(w, "Rotation.exp: w")))

    @classmethod
    @promises(sine=SINE)
    def about_x(cls, angle: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The rotation about the x axis.

        Args:
            angle: (*batch,), rad.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation; NaN as for `exp`.

        Raises:
            TypeError: the angle is not of floating point.

        Error: of sine and cosine at most 2 u for angles up to 2048 (float64: 2^26), times |angle| beyond.

        Example:
            >>> R_AB = js.Rotation.about_x(np.pi / 2)
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [ 1. -3.  2.]
        """
        return cls._about_coordinate_axis(0, angle, precision)

    @classmethod
    def about_y(cls, angle: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The rotation about the y axis; arguments, result and errors as of `about_x`.

        Example:
            >>> R_AB = js.Rotation.about_y(np.pi / 2)
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [ 3.  2. -1.]
        """
        return cls._about_coordinate_axis(1, angle, precision)

    @classmethod
    def about_z(cls, angle: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The rotation about the z axis; arguments, result and errors as of `about_x`.

        Example:
            >>> R_AB = js.Rotation.about_z(np.pi / 2)
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [-2.  1.  3.]
        """
        return cls._about_coordinate_axis(2, angle, precision)

    @classmethod
    def _about_coordinate_axis(cls, axis: int, angle: ArrayLike, precision: PrecisionName) -> Self:
        angle = floats.as_float_array(angle, f"Rotation.about_{'xyz'[axis]}: angle")
        return cls(_about(precision, expanded(angle), axis=axis))

    @classmethod
    @promises(bound=FROM_AXIS_ANGLE)
    def from_axis_angle(cls, axis: ArrayLike, angle: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The rotation about an axis by an angle.

        Args:
            axis: (*batch, 3), of any length but 0.
            angle: (*batch,), rad.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation, over the common batch; NaN for an axis of length 0.

        Raises:
            TypeError: dtypes differ or are not floating point.
            ValueError: shapes do not fit.

        Error: at most 8 u normwise.

        Example:
            >>> R_AB = js.Rotation.from_axis_angle([0.0, 0.0, 5.0], np.pi / 2)
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [-2.  1.  3.]
        """
        axis = floats.as_vectors(axis, "Rotation.from_axis_angle: axis")
        angle = expanded(floats.as_float_array(angle, "Rotation.from_axis_angle: angle", axis.dtype))
        require_compatible(axis=axis, angle=angle)
        return cls(_from_axis_angle(precision, axis, angle))

    @classmethod
    @promises(bound=FROM_ROLL_PITCH_YAW)
    def from_roll_pitch_yaw(cls, rpy: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """Rz(yaw) Ry(pitch) Rx(roll), as the rpy of a URDF; also `from_rpy`.

        Args:
            rpy: (*batch, 3) angles, rad: roll, pitch, yaw.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation.

        Raises:
            TypeError: rpy is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 8 u normwise.

        Example:
            >>> R_AB = js.Rotation.from_roll_pitch_yaw([0.1, 0.2, 0.3])
            >>> print(R_AB.to_roll_pitch_yaw())
            [0.1 0.2 0.3]
        """
        rpy = floats.as_vectors(rpy, "Rotation.from_roll_pitch_yaw: rpy")
        return cls(_from_roll_pitch_yaw(precision, rpy))

    # As URDF and other libraries name it.
    from_rpy = from_roll_pitch_yaw

    @classmethod
    @promises(bound=FROM_ONE_VECTOR)
    def from_one_vector(cls, u: ArrayLike, axis: int = 2, *, precision: PrecisionName = None) -> Self:
        """A frame, one axis of which points along a vector.

        The axis after that one is perpendicular to the coordinate axis along which u is smallest; the frame jumps where
        that changes.

        Args:
            u: (*batch, 3), of any length but 0.
            axis: 0, 1 or 2: the axis that points along u.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation; NaN for a vector of length 0.

        Raises:
            TypeError: u is not of floating point.
            ValueError: the shape does not fit, or there is no such axis.

        Error: at most 6 u normwise.

        Example:
            >>> R_AB = js.Rotation.from_one_vector([3.0, 0.0, 4.0])
            >>> print(R_AB @ [0.0, 0.0, 1.0])
            [0.6 0.  0.8]
        """
        u = floats.as_vectors(u, "Rotation.from_one_vector: u")
        return cls(_from_one_vector(precision, u, axis=_axis(axis, "Rotation.from_one_vector")))

    @classmethod
    @promises(bound=FROM_TWO_VECTORS)
    def from_two_vectors(
        cls, u: ArrayLike, v: ArrayLike, axes: tuple[int, int] = (2, 0), *, precision: PrecisionName = None
    ) -> Self:
        """A frame whose axis axes[0] points along u, with v between that and axis axes[1] (Gram-Schmidt).

        Args:
            u: (*batch, 3), of any length but 0.
            v: (*batch, 3), of any length but 0.
            axes: two different ones of 0, 1 and 2.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation, over the common batch; NaN where u and v are parallel, or the sine of the angle between them
            is below finfo.tiny.

        Raises:
            TypeError: dtypes differ or are not floating point.
            ValueError: shapes do not fit, or the axes are not two.

        Error: at most 8 u normwise over the sine of the angle between u and v.

        Example:
            >>> R_AB = js.Rotation.from_two_vectors([0.0, 0.0, 2.0], [0.0, 1.0, 1.0])
            >>> print(R_AB @ [1.0, 2.0, 3.0])
            [-2.  1.  3.]
        """
        u = floats.as_vectors(u, "Rotation.from_two_vectors: u")
        v = floats.as_vectors(v, "Rotation.from_two_vectors: v", u.dtype)
        require_compatible(u=u, v=v)
        both = tuple(_axis(axis, "Rotation.from_two_vectors") for axis in axes)
        if len(both) != 2 or both[0] == both[1]:
            raise ValueError(f"Rotation.from_two_vectors: axes: expected two different axes, got {both}")
        return cls(_from_two_vectors(precision, u, v, axes=both))

    @classmethod
    @promises(bound=BETWEEN)
    def between(cls, a: ArrayLike, b: ArrayLike, *, precision: PrecisionName = None) -> Self:
        """The smallest rotation that takes the direction of a to that of b.

        Args:
            a: (*batch, 3), of any length but 0.
            b: (*batch, 3), of any length but 0.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation, over the common batch; NaN for vectors of length 0. Where the directions are exactly opposite,
            or so to finfo.tiny, it is by pi about an axis perpendicular to both.

        Raises:
            TypeError: dtypes differ or are not floating point.
            ValueError: shapes do not fit.

        Error: at most 8 u normwise times 2 / |a/|a| + b/|b||, which is 1 unless they are nearly opposite.

        Example:
            >>> R = js.Rotation.between([1.0, 0.0, 0.0], [0.0, 3.0, 0.0])
            >>> print(R @ [1.0, 2.0, 3.0])
            [-2.  1.  3.]
        """
        a = floats.as_vectors(a, "Rotation.between: a")
        b = floats.as_vectors(b, "Rotation.between: b", a.dtype)
        require_compatible(a=a, b=b)
        return cls(_between(precision, a, b))

    # -- to other forms -----------------------------------------------------------------------------------------------

    def to_matrix(self) -> jax.Array:
        """The matrix (*batch, 3, 3). Exact.

        Example:
            >>> R_AB = js.Rotation.from_quaternion([0.0, 0.0, 0.0, 1.0])
            >>> print(R_AB.to_matrix())
            [[-1.  0.  0.]
             [ 0. -1.  0.]
             [ 0.  0.  1.]]
        """
        return matrices(self.entries, 3)

    @promises(bound=TO_QUATERNION)
    def to_quaternion(self, *, precision: PrecisionName = None) -> jax.Array:
        """The unit quaternion.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 4), real part first and not negative.

        Error: at most 4 u normwise.
        Source: Shepperd 1978, Quaternion from rotation matrix.

        Example:
            >>> print(js.Rotation.about_z(np.pi / 2).to_quaternion())
            [0.7071 0.     0.     0.7071]
        """
        return _to_quaternion(precision, self.entries)

    @promises(bound=LOG)
    def log(self, *, precision: PrecisionName = None) -> jax.Array:
        """The rotation vector: exp(log(R)) = R.

        At angle pi it jumps to its negative, by nature: at exactly pi its largest component is positive.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3), rad, of length at most pi, with derivatives of all orders at the identity.

        Error: at most 6 u normwise, also of a vector of 1e-30, down to the smallest numbers (see `Rotation`).

        Example:
            >>> print(js.Rotation.about_z(np.pi / 2).log())
            [0.     0.     1.5708]
        """
        return _log(precision, self.entries)

    @promises(axis=TO_AXIS, angle=TO_ANGLE)
    def to_axis_angle(self, *, precision: PrecisionName = None) -> tuple[jax.Array, jax.Array]:
        """The axis and the angle about it.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (axis (*batch, 3), of unit length; angle (*batch,), rad, from 0 to pi). At the identity the axis is x, and
            derivatives are 0.

        Error: at most 6 u of the axis, in its 2-norm, and 8 u of the angle.

        Example:
            >>> axis, angle = js.Rotation.about_z(0.5).to_axis_angle()
            >>> print(axis, angle)
            [0. 0. 1.] 0.5
        """
        axis, angle = _to_axis_angle(precision, self.entries)
        return axis, angle

    @promises(roll=TO_ROLL, rotation=TO_ROLL_PITCH_YAW)
    def to_roll_pitch_yaw(self, *, precision: PrecisionName = None) -> jax.Array:
        """The angles with R = Rz(yaw) Ry(pitch) Rx(roll); also `to_rpy`.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3), rad: roll, pitch, yaw, with |pitch| <= pi / 2, |roll| and |yaw| <= pi.

        Error: at most 24 u / cos(pitch) of roll and yaw, which near |pitch| = pi / 2 have a meaning only together; of
            the rotation that they make at most 24 u normwise.
        Source: Mitiguy, in Drake's RollPitchYaw.

        Example:
            >>> print(js.Rotation.about_z(0.5).to_roll_pitch_yaw())
            [0.  0.  0.5]
        """
        return _to_roll_pitch_yaw(precision, self.entries)

    to_rpy = to_roll_pitch_yaw

    # -- operations ---------------------------------------------------------------------------------------------------

    def inverse(self) -> "Rotation":
        """R_BA of R_AB: the transpose. Exact, and known while tracing where R_AB is.

        Example:
            >>> R_AB = js.Rotation.about_z(np.pi / 2)
            >>> print(R_AB.inverse() @ [1.0, 2.0, 3.0])
            [ 2. -1.  3.]
        """
        is_known = isinstance(self.entries, np.ndarray)
        return Rotation(self.entries[..., _TRANSPOSED] if is_known else _transposed(None, self.entries))

    @overload
    def __matmul__(self, other: "Rotation") -> "Rotation": ...

    @overload
    def __matmul__(self, other: ArrayLike) -> jax.Array: ...

    @promises(bound=ROTATED)
    def __matmul__(self, other) -> Any:
        """R_AB @ v_B is v_A, (*batch, 3), and R_AB @ R_BC is R_AC, over the common batch.

        Error: per component, mag the sum of the absolute values of its three products: at most 3 u mag in "fast" and
            "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful", while nothing over- or
            underflows; plus a few finfo.tiny where subnormals are flushed.
        """
        if isinstance(other, Rotation):
            return composed(self, other)
        return NotImplemented if isinstance(other, Quantity) else rotated(self, other)

    @promises(bound=INTERPOLATED, each_way=EACH_WAY)
    def interpolate(self, other: "Rotation", t: ArrayLike, *, precision: PrecisionName = None) -> "Rotation":
        """R exp(t log(R^-1 R2)): at constant angular velocity from this rotation to the other (slerp).

        Args:
            other: R2. The rotation goes the shorter way round; at half a turn see `log`.
            t: (*batch,), any number: 0 for this rotation, 1 for the other.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: at most 24 u normwise and 16 u |t|.

        Example:
            >>> R, S = js.Rotation.identity(), js.Rotation.about_z(0.5)
            >>> print(R.interpolate(S, 0.2).log())
            [0.  0.  0.1]
        """
        t = expanded(floats.as_float_array(t, "Rotation.interpolate: t", self.dtype))
        require_compatible(start=self, end=other, t=t)
        return Rotation(_interpolated(precision, self.entries, other.entries, t))

    @staticmethod
    @promises(bound=JACOBIAN)
    def left_jacobian(w: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
        """J with exp(w + e) = exp(J e) exp(w) for small e. The right Jacobian is that of -w, its transpose.

        Args:
            w: (*batch, 3), rad.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3, 3).

        Raises:
            TypeError: w is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 6 u normwise for |w| <= pi.
        Source: Barfoot 2017, State estimation for robotics, 7.1.3.

        Example:
            >>> J = js.Rotation.left_jacobian([0.0, 0.0, np.pi])
            >>> print(J[1] @ jnp.array([1.0, 0.0, 2.0]))
            0.6366196
        """
        return matrices(_left_jacobian(precision, floats.as_vectors(w, "Rotation.left_jacobian: w")), 3)

    @staticmethod
    @promises(bound=JACOBIAN_INVERSE)
    def left_jacobian_inverse(w: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
        """J^-1 of `left_jacobian`.

        Args:
            w: (*batch, 3), rad.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3, 3); infinite at |w| = 2 pi.

        Raises:
            TypeError: w is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 6 u normwise for |w| <= pi.
        Source: Barfoot 2017, State estimation for robotics, 7.1.3.

        Example:
            >>> theta = [0.0, 0.0, np.pi]
            >>> print(js.Rotation.left_jacobian_inverse(theta) @ np.array([2.0, 4.0, 6.0]))
            [ 6.2832 -3.1416  6.    ]
        """
        w = floats.as_vectors(w, "Rotation.left_jacobian_inverse: w")
        return matrices(_left_jacobian_inverse(precision, w), 3)


_TRANSPOSED = np.arange(9).reshape(3, 3).T.ravel()


def is_identity(R_AB: Rotation) -> bool:
    """True for a single identity known while tracing."""
    known = isinstance(R_AB.entries, np.ndarray) and not R_AB.batch_shape
    return known and bool((R_AB.entries == np.eye(3).ravel()).all())


def rotated(R_AB: Rotation, v_B: ArrayLike, *, precision: PrecisionName = None) -> jax.Array:
    """v_A = R_AB v_B: the same vector, expressed in frame A.

    Args:
        R_AB: the rotation.
        v_B: (*batch, 3), expressed in frame B.
        precision: name of a precision; None takes the default.

    Returns:
        v_A (*batch, 3), over the common batch. 15 flops.

    Raises:
        TypeError: dtypes differ.
        ValueError: shapes do not fit.

    Error: as of `R_AB @ v_B`.
    """
    v_B = floats.as_vectors(v_B, "Rotation @ v: v", R_AB.dtype, keep_dtype=is_identity(R_AB))
    check.require_same_dtype(Rotation=R_AB, v=v_B)
    return rotated_together(R_AB, v_B, precision=precision)[0]


def rotated_together(R_AB: Rotation, *vectors, precision: PrecisionName = None) -> tuple:
    """`rotated` for several vectors of the dtype of R, in one operation: what a derivative collects from all of them is
    one sum."""
    for v in vectors:
        floats.common_batch_shape(Rotation=R_AB.batch_shape, v=v.shape[:-1])
    return vectors if is_identity(R_AB) else _rotated(precision, R_AB.entries, *vectors)


def composed(R_AB: Rotation, R_BC: Rotation, *, precision: PrecisionName = None) -> Rotation:
    """R_AC = R_AB R_BC.

    Args:
        R_AB: the rotation on the left.
        R_BC: the rotation on the right.
        precision: name of a precision; None takes the default.

    Returns:
        R_AC, over the common batch. 45 flops.

    Raises:
        TypeError: dtypes differ.
        ValueError: batch shapes do not broadcast.

    Error: as of `R_AB @ R_BC`.
    """
    require_compatible(left=R_AB, right=R_BC)
    if is_identity(R_AB) or is_identity(R_BC):
        return R_BC if is_identity(R_AB) else R_AB
    return Rotation(_composed(precision, R_AB.entries, R_BC.entries))


# -- checks of arguments ----------------------------------------------------------------------------------------------


def _axis(axis: int, name: str) -> int:
    if axis not in (0, 1, 2):
        raise ValueError(f"{name}: expected axis 0, 1 or 2, got {axis!r}")
    return int(axis)


def _require_rotations(entries: jax.Array, name: str) -> None:
    """Raises ValueError for known entries that are no rotation, see `Rotation.from_matrix`; traced ones pass."""
    leaves = jax.tree.leaves(entries)
    if not leaves or any(isinstance(x, (Tracer, jax.ShapeDtypeStruct)) for x in leaves):
        return
    tolerance = 1e-3 + 16 * floats.eps(entries.dtype)
    m = np.asarray(from_double_word(as_array(entries, entries.shape[:-1]))).astype(np.float64).reshape((-1, 3, 3))
    with np.errstate(all="ignore"):
        off = abs(m @ np.swapaxes(m, -1, -2) - np.eye(3)).max((-1, -2), initial=0.0)
        wrong = np.flatnonzero((off > tolerance) | (np.linalg.det(m) < 0))
    if wrong.size:
        i = wrong[0]
        which = f"at place {i} of {len(m)} " if len(m) > 1 else ""
        how = f"with an entry of m m^T {off[i]:.3g} off" if off[i] > tolerance else "with a negative determinant"
        raise ValueError(
            f"{name}: expected rotation matrices, got {which}{m[i].tolist()}, {how}; Rotation.nearest(m) is the "
            "nearest rotation, Rotation(m.reshape((*m.shape[:-2], 9))) takes numbers as they are"
        )
