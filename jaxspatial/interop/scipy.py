"""SciPy: rotations and rigid transforms, batched and float64; quaternions xyzw unless asked for otherwise.

What is read is copied, NumPy in float64; what is made is copied to the host. The exponential coordinates of a
RigidTransform are [rotation vector; v], the order of `SpatialVelocity.from_array`.
"""

from typing import TYPE_CHECKING

import jax
import numpy as np

from jaxspatial.interop import orders
from jaxspatial.numerics.numbers.double_word import from_double_word
from jaxspatial.numerics.types import PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform

if TYPE_CHECKING:
    from scipy.spatial import transform


def from_rotation(R_AB: "transform.Rotation", *, precision: PrecisionName = None) -> Rotation:
    """Reads a scipy.spatial.transform.Rotation (*batch,), which holds quaternions xyzw: v_A = R_AB.apply(v_B).

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> from scipy.spatial import transform
        >>> with jax.enable_x64(True):
        ...     js.interop.scipy.from_rotation(transform.Rotation.from_rotvec([0.0, 0.0, 0.5])).log()
        Array([0. , 0. , 0.5], dtype=float64)
    """
    return Rotation.from_quaternion(orders.quaternion_from_xyzw(R_AB.as_quat()), precision=precision)


def to_rotation(R_AB: Rotation, *, precision: PrecisionName = None) -> "transform.Rotation":
    """Makes a scipy.spatial.transform.Rotation (*batch,); SciPy before 1.17 takes at most one axis.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> print(js.interop.scipy.to_rotation(js.Rotation.about_z(0.5)).as_euler("xyz", degrees=True))
        [ 0.      0.     28.6479]
    """
    from scipy.spatial import transform

    return transform.Rotation.from_quat(_host(orders.quaternion_to_xyzw(R_AB.to_quaternion(precision=precision))))


def from_rigid_transform(X_AB: "transform.RigidTransform", *, precision: PrecisionName = None) -> RigidTransform:
    """Reads a scipy.spatial.transform.RigidTransform (*batch,) of SciPy 1.16, m: p_A = X_AB.apply(p_B).

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> from scipy.spatial import transform
        >>> with jax.enable_x64(True):
        ...     js.interop.scipy.from_rigid_transform(transform.RigidTransform.from_translation([1, 2, 3])).translation
        array([1., 2., 3.])
    """
    return RigidTransform(from_rotation(X_AB.rotation, precision=precision), np.array(X_AB.translation))


def to_rigid_transform(X_AB: RigidTransform, *, precision: PrecisionName = None) -> "transform.RigidTransform":
    """Makes a scipy.spatial.transform.RigidTransform (*batch,) of SciPy 1.16, m.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> print(js.interop.scipy.to_rigid_transform(below).apply([1.0, 0.0, 0.0]))
        [ 1.  0. -1.]
    """
    from scipy.spatial import transform

    R_AB = to_rotation(X_AB.rotation, precision=precision)
    return transform.RigidTransform.from_components(_host(X_AB.translation), R_AB)


def _host(x: jax.Array) -> np.ndarray:
    # A copy: SciPy takes no arrays that it could not write to.
    return np.array(from_double_word(x), np.float64)
