"""How a `Rotation` is made: its named constructors, the base of that class."""

import functools
from typing import TYPE_CHECKING, Any, Self

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.quantity import Quantity
from jaxspatial.arithmetic.types import BatchShape, DTypeLike, Matrix3, PrecisionName, Quaternion, Scalar, Vector3
from jaxspatial.rotation import formulas
from jaxspatial.rotation.formulas import over_arrays
from jaxspatial.rotation.matrices import as_matrices, expanded, owned, require_rotations


class Constructors(Quantity):
    """R_AB by its entries (*batch, 9), and the classmethods that make it."""

    entries: jax.Array

    if TYPE_CHECKING:

        def __init__(self, entries: Any): ...

    def __post_init__(self) -> None:
        """Checks what a caller passes; marks of a tree of axes or specs pass."""
        if not check.is_tree_mark(self.entries):
            entries = check.as_vectors(self.entries, "Rotation: entries", size=9, held=True)
            object.__setattr__(self, "entries", owned(entries))

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
        """
        shape = (batch_shape,) if isinstance(batch_shape, int) else batch_shape
        return cls(np.broadcast_to(np.eye(3, dtype=check.as_dtype(dtype)).ravel(), (*shape, 9)))

    @classmethod
    def from_matrix(cls, m: Matrix3) -> Self:
        """The rotation with given matrices, taken as they are, digit by digit.

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
        """
        entries = as_matrices(m, "Rotation.from_matrix: m")
        require_rotations(entries, "Rotation.from_matrix: m")
        return cls(entries)

    @classmethod
    def nearest(cls, m: Matrix3, *, precision: PrecisionName = None) -> Self:
        """The rotation nearest to a matrix in the Frobenius norm: it removes the drift of many products.

        Args:
            m: (*batch, 3, 3).
            precision: name of a precision; None takes the default.

        Returns:
            The rotation; NaN where the determinant is not positive.

        Raises:
            TypeError: m is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 12 u normwise for matrices near a rotation; times 2 / (s2 + s3) in general, of singular values
            s1 = 1 >= s2 >= s3.
        Source: Higham 1986, Computing the polar decomposition.
        """
        return cls(formulas.nearest(precision, as_matrices(m, "Rotation.nearest: m")))

    @classmethod
    def from_quaternion(cls, wxyz: Quaternion, *, precision: PrecisionName = None) -> Self:
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
        """
        q = check.as_vectors(wxyz, "Rotation.from_quaternion: wxyz", size=4)
        return cls(formulas.from_quaternion(precision, q))

    @classmethod
    def exp(cls, w: Vector3, *, precision: PrecisionName = None) -> Self:
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
        """
        return cls(formulas.exp(precision, check.as_vectors(w, "Rotation.exp: w")))

    @classmethod
    def about_x(cls, angle: Scalar, *, precision: PrecisionName = None) -> Self:
        """The rotation about the x axis.

        Args:
            angle: (*batch,), rad.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation; NaN as for `exp`.

        Raises:
            TypeError: the angle is not of floating point.

        Error: of sine and cosine at most 2 u for angles up to 2048 (float64: 2^26), 2 u |angle| beyond.
        """
        return cls._about(0, angle, precision)

    @classmethod
    def about_y(cls, angle: Scalar, *, precision: PrecisionName = None) -> Self:
        """The rotation about the y axis; arguments, result and errors as of `about_x`."""
        return cls._about(1, angle, precision)

    @classmethod
    def about_z(cls, angle: Scalar, *, precision: PrecisionName = None) -> Self:
        """The rotation about the z axis; arguments, result and errors as of `about_x`."""
        return cls._about(2, angle, precision)

    @classmethod
    def _about(cls, axis: int, angle: Scalar, precision: PrecisionName) -> Self:
        angle = check.as_float_array(angle, f"Rotation.about_{'xyz'[axis]}: angle")
        return cls(formulas.about(precision, expanded(angle), axis=axis))

    @classmethod
    def from_axis_angle(cls, axis: Vector3, angle: Scalar, *, precision: PrecisionName = None) -> Self:
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
        """
        axis = check.as_vectors(axis, "Rotation.from_axis_angle: axis")
        angle = check.as_float_array(angle, "Rotation.from_axis_angle: angle", axis.dtype)
        return cls(over_arrays(formulas.from_axis_angle, precision, axis=axis, angle=expanded(angle)))

    @classmethod
    def from_roll_pitch_yaw(cls, rpy: Vector3, *, precision: PrecisionName = None) -> Self:
        """Rz(yaw) Ry(pitch) Rx(roll).

        Args:
            rpy: (*batch, 3) angles, rad: roll, pitch, yaw.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation.

        Raises:
            TypeError: rpy is not of floating point.
            ValueError: the shape does not fit.

        Error: at most 8 u normwise.
        """
        rpy = check.as_vectors(rpy, "Rotation.from_roll_pitch_yaw: rpy")
        return cls(formulas.from_roll_pitch_yaw(precision, rpy))

    @classmethod
    def from_one_vector(cls, u: Vector3, axis: int = 2, *, precision: PrecisionName = None) -> Self:
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
        """
        u = check.as_vectors(u, "Rotation.from_one_vector: u")
        return cls(formulas.from_one_vector(precision, u, axis=_axis(axis, "Rotation.from_one_vector")))

    @classmethod
    def from_two_vectors(
        cls, u: Vector3, v: Vector3, axes: tuple[int, int] = (2, 0), *, precision: PrecisionName = None
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
        """
        u = check.as_vectors(u, "Rotation.from_two_vectors: u")
        v = check.as_vectors(v, "Rotation.from_two_vectors: v", u.dtype)
        both = tuple(_axis(axis, "Rotation.from_two_vectors") for axis in axes)
        if len(both) != 2 or both[0] == both[1]:
            raise ValueError(f"Rotation.from_two_vectors: axes: expected two different axes, got {both}")
        return cls(over_arrays(functools.partial(formulas.from_two_vectors, axes=both), precision, u=u, v=v))

    @classmethod
    def between(cls, a: Vector3, b: Vector3, *, precision: PrecisionName = None) -> Self:
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
        """
        a = check.as_vectors(a, "Rotation.between: a")
        b = check.as_vectors(b, "Rotation.between: b", a.dtype)
        return cls(over_arrays(formulas.between, precision, a=a, b=b))


def _axis(axis: int, name: str) -> int:
    if axis not in (0, 1, 2):
        raise ValueError(f"{name}: expected axis 0, 1 or 2, got {axis!r}")
    return int(axis)
