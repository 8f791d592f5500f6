"""SciPy: rotations and rigid transforms, batched and float64; quaternions xyzw unless asked for otherwise."""

from typing import Any

import jax
import numpy as np

from jaxspatial.arithmetic.numbers.trees import from_double_word
from jaxspatial.arithmetic.types import PrecisionName, Six
from jaxspatial.interop import orders
from jaxspatial.interop.library import library
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import RigidTransform, SpatialVelocity


def from_rotation(R_AB: Any, *, precision: PrecisionName = None) -> Rotation:
    """Reads a scipy.spatial.transform.Rotation, which holds quaternions xyzw: v_A = R_AB.apply(v_B).

    Args:
        R_AB: a Rotation (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The same (*batch,), in float64.

    Error: as of `Rotation.from_quaternion`.
    """
    return Rotation.from_quaternion(orders.quaternion_from_xyzw(R_AB.as_quat()), precision=precision)


def to_rotation(R_AB: Rotation, *, precision: PrecisionName = None) -> Any:
    """Makes a scipy.spatial.transform.Rotation.

    Args:
        R_AB: (*batch,); SciPy before 1.17 takes at most one axis.
        precision: name of a precision; None takes the default.

    Returns:
        The Rotation, of the same batch shape, in float64.

    Raises:
        ImportError: scipy is missing.

    Error: as of `Rotation.to_quaternion`.
    """
    xyzw = orders.quaternion_to_xyzw(R_AB.to_quaternion(precision=precision))
    return library("scipy.spatial.transform").Rotation.from_quat(_host(xyzw))


def from_rigid_transform(X_AB: Any, *, precision: PrecisionName = None) -> RigidTransform:
    """Reads a scipy.spatial.transform.RigidTransform (SciPy 1.16): p_A = X_AB.apply(p_B).

    Args:
        X_AB: a RigidTransform (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The same (*batch,), in float64.

    Error: as of `Rotation.from_quaternion`.
    """
    return RigidTransform(from_rotation(X_AB.rotation, precision=precision), np.array(X_AB.translation))


def to_rigid_transform(X_AB: RigidTransform, *, precision: PrecisionName = None) -> Any:
    """Makes a scipy.spatial.transform.RigidTransform (SciPy 1.16).

    Args:
        X_AB: (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The RigidTransform, of the same batch shape, in float64.

    Raises:
        ImportError: scipy is missing.

    Error: as of `Rotation.to_quaternion`.
    """
    R_AB = to_rotation(X_AB.rotation, precision=precision)
    return library("scipy.spatial.transform").RigidTransform.from_components(_host(X_AB.translation), R_AB)


def from_exponential_coordinates(x6: Six) -> SpatialVelocity:
    """Reads SciPy's exponential coordinates of a RigidTransform: the same order as here.

    Args:
        x6: (*batch, 6) [rotation vector; v]; rad, m.

    Returns:
        The velocity over unit time (*batch,), for `RigidTransform.exp`.

    Raises:
        ValueError: the shape does not fit.
    """
    return SpatialVelocity.from_array(x6)


def to_exponential_coordinates(V: SpatialVelocity) -> np.ndarray:
    """Makes SciPy's exponential coordinates of a RigidTransform.

    Args:
        V: the velocity over unit time (*batch,), of `RigidTransform.log`.

    Returns:
        (*batch, 6) [rotation vector; v] in float64; rad, m.
    """
    return _host(V.to_array())


def _host(x: jax.Array) -> np.ndarray:
    # A copy: SciPy does not take arrays that it could not write to.
    return np.array(from_double_word(x), np.float64)
