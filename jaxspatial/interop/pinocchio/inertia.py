"""Spatial inertias of Pinocchio."""

from typing import Any

import numpy as np

from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.interop.library import library

# Its ten dynamic parameters, as arrays, are `SpatialInertia.from_dynamic_parameters` and `to_dynamic_parameters`.


def from_inertia(Y: Any) -> SpatialInertia:
    """Reads a pinocchio.Inertia, which holds mass, lever (com) and the central inertia.

    Args:
        Y: an Inertia.

    Returns:
        The same, single, as NumPy in float64.
    """
    return SpatialInertia(Y.mass, np.array(Y.lever), np.array(Y.inertia))


def to_inertia(M: SpatialInertia) -> Any:
    """Makes a pinocchio.Inertia of the numbers as they are.

    Pinocchio's constructor would refuse one that rounding has made a little indefinite, like that of a rod.

    Args:
        M: a single one.

    Returns:
        The Inertia.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.
    """
    mass, com, six = (orders.single(x, "pinocchio.to_inertia") for x in M.vectors)
    Y = library("pinocchio").Inertia.Zero()
    Y.mass, Y.lever, Y.inertia = mass[0], com, six[np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])]
    return Y


def from_pseudo_inertia(J: Any, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads a pinocchio.PseudoInertia.

    Args:
        J: a PseudoInertia.
        precision: name of a precision; None takes the default.

    Returns:
        The inertia, single.

    Error: as of `SpatialInertia.from_pseudo_inertia`.
    """
    return SpatialInertia.from_pseudo_inertia(np.array(J.toMatrix()), precision=precision)


def to_pseudo_inertia(M: SpatialInertia, *, precision: PrecisionName = None) -> Any:
    """Makes a pinocchio.PseudoInertia.

    Args:
        M: a single one.
        precision: name of a precision; None takes the default.

    Returns:
        The PseudoInertia.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.

    Error: as of `SpatialInertia.to_pseudo_inertia`.
    """
    J = M.to_pseudo_inertia(precision=precision)
    entries = orders.single(J.reshape((*J.shape[:-2], 16)), "pinocchio.to_pseudo_inertia")
    return library("pinocchio").PseudoInertia.FromMatrix(entries.reshape(4, 4))


def from_log_cholesky(theta: Any, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads pinocchio.LogCholeskyParameters.

    Args:
        theta: LogCholeskyParameters.
        precision: name of a precision; None takes the default.

    Returns:
        The inertia, single.

    Error: as of `SpatialInertia.from_log_cholesky`.
    """
    return SpatialInertia.from_log_cholesky(np.array(theta.parameters), precision=precision)


def to_log_cholesky(M: SpatialInertia, *, precision: PrecisionName = None) -> Any:
    """Makes pinocchio.LogCholeskyParameters, which Pinocchio has no way to make of an inertia.

    Args:
        M: a single one.
        precision: name of a precision; None takes the default.

    Returns:
        The LogCholeskyParameters.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ImportError: pinocchio is missing.

    Error: as of `SpatialInertia.to_log_cholesky`.
    """
    theta10 = orders.single(M.to_log_cholesky(precision=precision), "pinocchio.to_log_cholesky")
    return library("pinocchio").LogCholeskyParameters(theta10)
