"""Rotations, as what they do to vectors. The mathematics is in the modules beside this one."""

from typing import TYPE_CHECKING, Any, overload

import jax
import numpy as np

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.quantity import Quantity, require_alike
from jaxspatial.arithmetic.tree import tree
from jaxspatial.arithmetic.types import PrecisionName, Scalar, Vector3
from jaxspatial.rotation import formulas, matrices
from jaxspatial.rotation.constructors import Constructors
from jaxspatial.rotation.matrices import expanded


@tree
class Rotation(Constructors):
    """R_AB: re-expresses in frame A what is expressed in frame B. Made by the constructors of `Constructors`.

    entries: (*batch, 9) the matrix, row by row.

    What the error bounds of all constructors and functions below mean: u is the unit roundoff of the inputs' dtype; an
    error of k u normwise is one of the whole vector, or matrix, in its 2-norm (of a matrix Frobenius'), relative to it.
    In "fast" and "reproducible" bounds are those given (float16 and bfloat16 are computed in float32). In "compensated"
    and "faithful" formulas are evaluated in float64, or for float64 in double words, and every number r of the result
    is rounded once: off by u |r|, and by 16 k u^2 of the size of the whole. That is 1.01 u normwise. Derivatives of any
    order are those of the function, also where it has a removable singularity.

    Where subnormals are flushed to zero (XLA CPU), components below finfo.tiny (float32 1.2e-38, float64 2.2e-308)
    count as 0, also those given, in all precisions: 8 finfo.tiny are added to errors, to those of `log` and
    `to_quaternion` of the smallest angles, too. A direction given by a vector (`between`, `from_two_vectors`, ...)
    keeps its digits down to a size of finfo.tiny / eps; scale up what is smaller.
    """

    entries: jax.Array

    if TYPE_CHECKING:
        __init__ = Constructors.__init__

    # -- to other forms -----------------------------------------------------------------------------------------------

    def to_matrix(self) -> jax.Array:
        """The matrix (*batch, 3, 3). Exact."""
        return matrices.matrices(self.entries, 3)

    def to_quaternion(self, *, precision: PrecisionName = None) -> jax.Array:
        """The unit quaternion.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 4), real part first and not negative.

        Error: at most 4 u normwise.
        Source: Shepperd 1978, Quaternion from rotation matrix.
        """
        return formulas.to_quaternion(precision, self.entries)

    def log(self, *, precision: PrecisionName = None) -> jax.Array:
        """The rotation vector: exp(log(R)) = R.

        At angle pi it jumps to its negative, by nature: at exactly pi its largest component is positive.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3), rad, of length at most pi, with derivatives of all orders at the identity.

        Error: at most 6 u normwise, also of a vector of 1e-30, down to the smallest numbers (see `Rotation`).
        """
        return formulas.log(precision, self.entries)

    def to_axis_angle(self, *, precision: PrecisionName = None) -> tuple[jax.Array, jax.Array]:
        """The axis and the angle about it.

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (axis (*batch, 3), of unit length; angle (*batch,), rad, from 0 to pi). At the identity the axis is x, and
            derivatives are 0.

        Error: at most 6 u of the axis, in its 2-norm, and 8 u of the angle.
        """
        axis, angle = formulas.to_axis_angle(precision, self.entries)
        return axis, angle

    def to_roll_pitch_yaw(self, *, precision: PrecisionName = None) -> jax.Array:
        """The angles with R = Rz(yaw) Ry(pitch) Rx(roll).

        Args:
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 3), rad: roll, pitch, yaw, with |pitch| <= pi / 2, |roll| and |yaw| <= pi.

        Error: at most 24 u / cos(pitch) of roll and yaw, which have little meaning but together near |pitch| = pi / 2;
            of the rotation they make at most 24 u normwise.
        Source: Mitiguy, in Drake's RollPitchYaw.
        """
        return formulas.to_roll_pitch_yaw(precision, self.entries)

    def __repr__(self) -> str:
        return f"Rotation({matrices.shown(self.entries, 3)})"

    # -- operations ---------------------------------------------------------------------------------------------------

    def inverse(self) -> "Rotation":
        """R_BA of R_AB: the transpose. Exact, and known while tracing where R_AB is."""
        is_known = isinstance(self.entries, np.ndarray)
        return Rotation(self.entries[..., matrices.TRANSPOSED] if is_known else matrices.transposed(None, self.entries))

    @overload
    def __matmul__(self, other: "Rotation") -> "Rotation": ...

    @overload
    def __matmul__(self, other: Any) -> Any: ...

    def __matmul__(self, other: Any) -> Any:
        """R_AB @ v_B is v_A, (*batch, 3), and R_AB @ R_BC is R_AC, over the common batch.

        Error: per component, mag the sum of the absolute values of its three products: at most 3 u mag in "fast" and
            "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp in "faithful", while nothing over- or underflows;
            plus a few finfo.tiny where subnormals are flushed.
        """
        if isinstance(other, Rotation):
            return composed(self, other)
        return NotImplemented if isinstance(other, Quantity) else rotated(self, other)

    def interpolate(self, other: "Rotation", t: Scalar, *, precision: PrecisionName = None) -> "Rotation":
        """R exp(t log(R^-1 R2)): at constant angular velocity from this rotation to the other (slerp).

        Args:
            other: R2. The way is the shorter one; at half a turn see `log`.
            t: (*batch,), any number: 0 for this rotation, 1 for the other.
            precision: name of a precision; None takes the default.

        Returns:
            The rotation, over the common batch.

        Raises:
            TypeError: dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: at most 24 u normwise and 16 u |t|.
        """
        t = check.as_float_array(t, "Rotation.interpolate: t", self.dtype)
        ends = {"start": self.entries, "end": other.entries}
        return Rotation(formulas.over_arrays(formulas.interpolated, precision, **ends, t=expanded(t)))

    @staticmethod
    def left_jacobian(w: Vector3, *, precision: PrecisionName = None) -> jax.Array:
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
        """
        return matrices.matrices(formulas.left_jacobian(precision, check.as_vectors(w, "Rotation.left_jacobian: w")), 3)

    @staticmethod
    def left_jacobian_inverse(w: Vector3, *, precision: PrecisionName = None) -> jax.Array:
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
        """
        w = check.as_vectors(w, "Rotation.left_jacobian_inverse: w")
        return matrices.matrices(formulas.left_jacobian_inverse(precision, w), 3)


def is_identity(R_AB: Rotation) -> bool:
    """True for a single identity known while tracing."""
    known = isinstance(R_AB.entries, np.ndarray) and not R_AB.batch_shape
    return known and bool((R_AB.entries == np.eye(3).ravel()).all())


def rotated(R_AB: Rotation, v_B: Vector3, *, precision: PrecisionName = None) -> Any:
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
    v_B = check.as_vectors(v_B, "Rotation @ v: v", R_AB.dtype, held=is_identity(R_AB))
    check.require_same_dtype(Rotation=R_AB, v=v_B)
    return rotated_together(R_AB, v_B, precision=precision)[0]


def rotated_together(R_AB: Rotation, *vectors: Any, precision: PrecisionName = None) -> tuple[Any, ...]:
    """`rotated` for several vectors of the dtype of R, in one operation: what a derivative collects from all of them is
    one sum."""
    for v in vectors:
        check.common_batch_shape(Rotation=R_AB.batch_shape, v=v.shape[:-1])
    return vectors if is_identity(R_AB) else matrices.rotated(precision, R_AB.entries, *vectors)


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
    require_alike(left=R_AB, right=R_BC)
    if is_identity(R_AB) or is_identity(R_BC):
        return R_BC if is_identity(R_AB) else R_AB
    return Rotation(matrices.composed(precision, R_AB.entries, R_BC.entries))
