"""Spatial inertias of Drake."""

from typing import Any

import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from jaxspatial.interop.library import library


def from_inertia(M_SP_E: Any) -> SpatialInertia:
    """Reads pydrake's SpatialInertia, which holds mass, com and inertia about P per unit mass: [m, p_PScm, G_SP].

    Drake shifts G to the centre of mass. A body without mass has no inertia here, whatever its G.

    Args:
        M_SP_E: a SpatialInertia.

    Returns:
        M_SP_E, single, as NumPy in float64.

    Error: u m |com|^2 of float64, of the shift.
    """
    mass, com = M_SP_E.get_mass(), np.array(M_SP_E.get_com())
    central = M_SP_E.get_unit_inertia().ShiftToCenterOfMass(com).CopyToFullMatrix3()
    return SpatialInertia(mass, com, mass * central)


def to_inertia(M_SP_E: SpatialInertia) -> Any:
    """Makes pydrake's SpatialInertia, valid or not.

    Without mass G_SP is that of a point mass. Far from its centre of mass Drake may call a rod, or a point, invalid.

    Args:
        M_SP_E: a single one.

    Returns:
        The SpatialInertia.

    Raises:
        ValueError: it is a batch: the objects of the library are single.
        ValueError: there is a central inertia without mass (a rotor's), which Drake cannot hold.
        ImportError: pydrake is missing.

    Error: of G_SP a few u (|central| / m + |com|^2).
    """
    tree = library("pydrake.multibody.tree")
    (mass,), com, central = (orders.single(x, "drake.to_inertia") for x in M_SP_E.vectors)
    if mass == 0 and central.any():
        raise ValueError(f"drake.to_inertia: expected no central inertia without mass, got {central} for mass 0")
    moments_and_products = orders.symmetric_to_diagonal_first(central / mass if mass else central)
    G_SP_E = tree.UnitInertia(*moments_and_products).ShiftFromCenterOfMass(com)
    return tree.SpatialInertia(mass, com, G_SP_E, skip_validity_check=True)
