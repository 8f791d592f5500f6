"""jaxlie: SO3 and SE3, batched over leading axes as here. It has no forces.

Its tangents are [v; w] and its adjoints act on them: `orders.from_linear_first` and `orders.matrix_from_linear_first`
read both. `exp` is the same of both.
"""

from typing import TYPE_CHECKING

from jaxspatial.interop import orders
from jaxspatial.numerics.types import PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

if TYPE_CHECKING:
    import jaxlie


def from_so3(R_AB: "jaxlie.SO3", *, precision: PrecisionName = None) -> Rotation:
    """Reads a jaxlie.SO3 (*batch,), which holds quaternions wxyz.

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> import jaxlie
        >>> js.interop.jaxlie.from_so3(jaxlie.SO3.from_z_radians(0.5)).log()
        Array([0. , 0. , 0.5], dtype=float32)
    """
    return Rotation.from_quaternion(R_AB.wxyz, precision=precision)


def to_so3(R_AB: Rotation, *, precision: PrecisionName = None) -> "jaxlie.SO3":
    """Makes a jaxlie.SO3 (*batch,), the real part not negative.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> print(js.interop.jaxlie.to_so3(js.Rotation.about_z(0.5)).log())
        [0.  0.  0.5]
    """
    import jaxlie

    return jaxlie.SO3(wxyz=R_AB.to_quaternion(precision=precision))


def from_se3(X_AB: "jaxlie.SE3", *, precision: PrecisionName = None) -> RigidTransform:
    """Reads a jaxlie.SE3 (*batch,), which holds [wxyz; p_AB], m.

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> import jaxlie
        >>> print(js.interop.jaxlie.from_se3(jaxlie.SE3.from_translation(jnp.array([1.0, 2.0, 3.0]))).translation)
        [1. 2. 3.]
    """
    return orders.pose_from_wxyz_xyz(X_AB.wxyz_xyz, precision=precision)


def to_se3(X_AB: RigidTransform, *, precision: PrecisionName = None) -> "jaxlie.SE3":
    """Makes a jaxlie.SE3 (*batch,), m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> print(js.interop.jaxlie.to_se3(below).wxyz_xyz)
        [ 1.  0.  0.  0.  0.  0. -1.]
    """
    import jaxlie

    return jaxlie.SE3(wxyz_xyz=orders.pose_to_wxyz_xyz(X_AB, precision=precision))
