"""SciPy: rotations and rigid transforms, batched and float64; quaternions xyzw unless asked for otherwise."""

import numpy as np

from jaxspatial.arithmetic.double_word import from_double_word
from jaxspatial.interop import orders
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity


def from_rotation(R_AB, *, precision=None):
    """Of a scipy.spatial.transform.Rotation, which holds quaternions xyzw: v_A = R_AB.apply(v_B)."""
    return Rotation.from_quaternion(orders.quaternion_from_xyzw(R_AB.as_quat()), precision=precision)


def to_rotation(R_AB, *, precision=None):
    """scipy.spatial.transform.Rotation, of the same batch shape (SciPy before 1.17: at most one axis)."""
    from scipy.spatial import transform

    xyzw = orders.quaternion_to_xyzw(R_AB.to_quaternion(precision=precision))
    return transform.Rotation.from_quat(_host(xyzw))


def from_rigid_transform(X_AB, *, precision=None):
    """Of a scipy.spatial.transform.RigidTransform (SciPy 1.16): p_A = X_AB.apply(p_B)."""
    return RigidTransform(from_rotation(X_AB.rotation, precision=precision), np.array(X_AB.translation))


def to_rigid_transform(X_AB, *, precision=None):
    """scipy.spatial.transform.RigidTransform of the same batch shape."""
    from scipy.spatial import transform

    R_AB = to_rotation(X_AB.rotation, precision=precision)
    return transform.RigidTransform.from_components(_host(X_AB.translation), R_AB)


def from_exponential_coordinates(x6):
    """The SpatialVelocity of `RigidTransform.exp` from SciPy's (*batch, 6) [rotation vector; v]: the same order."""
    return SpatialVelocity.from_array(x6)


def to_exponential_coordinates(V):
    """(*batch, 6) [rotation vector; v] of a SpatialVelocity over unit time."""
    return _host(V.to_array())


def _host(x):
    # A copy: SciPy does not take arrays that it could not write to.
    return np.array(from_double_word(x), np.float64)
