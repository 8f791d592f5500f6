"""Spatial vectors of Pinocchio."""

from typing import Any

import numpy as np

from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.interop import orders
from jaxspatial.interop.library import library
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity
from jaxspatial.spatial.vector import SpatialVector


def from_force(F: Any) -> SpatialForce:
    """Reads a pinocchio.Force that is a force, such as `data.f[i]`.

    Args:
        F: [f; tau] about the origin of its frame, in its axes.

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialForce(F.angular, F.linear)


def from_momentum(L: Any) -> SpatialMomentum:
    """Reads a pinocchio.Force that is a momentum, such as `data.h[i]`, or `data.hg` about the centre of mass.

    Args:
        L: [l; h].

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialMomentum(L.angular, L.linear)


def to_force(F: SpatialForce | SpatialMomentum) -> Any:
    """Makes a pinocchio.Force.

    Args:
        F: a single one.

    Returns:
        The Force, [f; tau].

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.
    """
    return library("pinocchio").Force(_six(F, "pinocchio.to_force"))


def from_motion(V: Any) -> SpatialVelocity:
    """Reads a pinocchio.Motion that is a velocity, such as `data.v[i]`.

    Args:
        V: [v; w].

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialVelocity(V.angular, V.linear)


def to_motion(V: SpatialVelocity) -> Any:
    """Makes a pinocchio.Motion that is a velocity.

    Args:
        V: a single one.

    Returns:
        The Motion, [v; w].

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.
    """
    return library("pinocchio").Motion(_six(V, "pinocchio.to_motion"))


def from_spatial_acceleration(A: Any, V: Any, *, precision: PrecisionName = None) -> SpatialAcceleration:
    """Reads a pinocchio.Motion that is Featherstone's acceleration, such as `data.a[i]`.

    Args:
        A: the acceleration; `data.a` is without gravity, `data.a_gf` less gravity.
        V: the velocity, a Motion about the same point in the same axes.
        precision: name of a precision; None takes the default.

    Returns:
        The classical acceleration, a = A.linear + w x v, single, as NumPy in float64.

    Error: as of `SpatialAcceleration.from_featherstone`.
    """
    six = np.concatenate((A.angular, A.linear))
    return SpatialAcceleration.from_featherstone(six, from_motion(V), precision=precision)


def to_spatial_acceleration(A: SpatialAcceleration, V: SpatialVelocity, *, precision: PrecisionName = None) -> Any:
    """Makes a pinocchio.Motion that is Featherstone's acceleration, such as `data.a[i]`.

    Args:
        A: a single one, classical, as all here are.
        V: a single one about the same point in the same axes.
        precision: name of a precision; None takes the default.

    Returns:
        The Motion, [a - w x v; alpha].

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.

    Error: as of `SpatialAcceleration.to_featherstone`.
    """
    spatial = SpatialVelocity.from_array(A.to_featherstone(V, precision=precision))
    return library("pinocchio").Motion(_six(spatial, "pinocchio.to_spatial_acceleration"))


def from_classical_acceleration(A: Any) -> SpatialAcceleration:
    """Reads a pinocchio.Motion that is the classical acceleration, of `getFrameClassicalAcceleration`.

    Args:
        A: [a; alpha].

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialAcceleration(A.angular, A.linear)


def to_classical_acceleration(A: SpatialAcceleration) -> Any:
    """Makes a pinocchio.Motion that is the classical acceleration, as `getFrameClassicalAcceleration` returns it.

    Args:
        A: a single one.

    Returns:
        The Motion, [a; alpha].

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.
    """
    return library("pinocchio").Motion(_six(A, "pinocchio.to_classical_acceleration"))


def _six(x: SpatialVector, name: str) -> np.ndarray:
    return orders.single(orders.to_linear_first(x), name)
