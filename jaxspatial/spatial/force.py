"""Spatial force and spatial momentum: the two kinds that shift alike."""

import jax

from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Three
from jaxspatial.arithmetic.tree import tree
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.spatial import algebra
from jaxspatial.spatial.arguments import require_no_w, shift_by
from jaxspatial.spatial.operations import shift
from jaxspatial.spatial.parts import LEFT_OUT
from jaxspatial.spatial.vector import SpatialVector


@tree
class SpatialForce(SpatialVector):
    """F_Bp_E: a wrench on body B: a torque on top of a force, about point Bp, expressed in frame E.

    tau: (*batch, 3) torque about Bp, N m
    f: (*batch, 3) force, N

    A part that is left out is a known zero, which leaves no operation behind: `SpatialForce(f=f)` is a pure force,
    `SpatialForce(tau)` a couple. The sum of two has a meaning for forces on the same body, about the same point, in the
    same frame.
    """

    tau: jax.Array = LEFT_OUT
    f: jax.Array = LEFT_OUT


@tree
class SpatialMomentum(SpatialVector):
    """L_MSp_E: the momentum of system S in frame M, about point Sp, expressed in frame E.

    h: (*batch, 3) angular momentum about Sp, N m s
    l: (*batch, 3) linear momentum, N s

    A part that is left out is a known zero, see `SpatialForce`.
    """

    h: jax.Array = LEFT_OUT
    l: jax.Array = LEFT_OUT  # noqa: E741 - the field's letter


@shift.register
def _shift_force(
    F_P_E: SpatialForce | SpatialMomentum, p_PQ_E: Vector3, w: Vector3 | None = None, *, precision: PrecisionName = None
) -> SpatialForce | SpatialMomentum:
    require_no_w(F_P_E, w)
    return shift_by(_shifted_force, F_P_E, precision, p_PQ_E=p_PQ_E)


@formula(of_sums=True)
def _shifted_force(tau: Three, f: Three, p: Three) -> list[Three]:
    return [algebra.torque_about(tau, f, p), f]
