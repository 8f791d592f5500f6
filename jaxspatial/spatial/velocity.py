"""Spatial velocity."""

import jax

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Three
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.tree import tree
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.spatial import algebra
from jaxspatial.spatial.arguments import require_kind, require_no_w, shift_by
from jaxspatial.spatial.operations import shift
from jaxspatial.spatial.parts import LEFT_OUT
from jaxspatial.spatial.vector import SpatialVector


@tree
class SpatialVelocity(SpatialVector):
    """V_MBp_E: how body B moves in frame M, looked at in point Bp, expressed in frame E.

    w: (*batch, 3) angular velocity, rad/s
    v: (*batch, 3) velocity of Bp, m/s

    A part that is left out is a known zero, see `SpatialForce`: `SpatialVelocity(v=v)` is a translation.
    """

    w: jax.Array = LEFT_OUT
    v: jax.Array = LEFT_OUT

    def compose_with_moving_frame(
        self, p_BoCo_E: Vector3, V_BC_E: "SpatialVelocity", *, precision: PrecisionName = None
    ) -> "SpatialVelocity":
        """V_MC_E of frame C that moves at V_BC_E in frame B, which moves at this V_MB_E in frame M.

            w_MC = w_MB + w_BC            v_MCo = v_MBo + w_MB x p_BoCo + v_BCo

        Composing frame after frame is associative but for rounding.

        Args:
            p_BoCo_E: (*batch, 3) position of Co from Bo, m, expressed in frame E.
            V_BC_E: SpatialVelocity (*batch,) of C in B about Co, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            V_MC_E about Co, over the common batch. 18 flops.

        Raises:
            TypeError: V_BC_E is of another kind, or dtypes differ.
            ValueError: shapes do not fit.

        Error: per component, mag the sum of the absolute values of its terms: at most 4 u mag in "fast" and
            "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp in "faithful".
        Source: Jain 2010, 1.4.
        """
        require_kind(V_BC_E, SpatialVelocity, "compose_with_moving_frame: V_BC_E")
        p = check.as_vectors(p_BoCo_E, "compose_with_moving_frame: p_BoCo_E", self.dtype)
        require_alike(V_MB_E=self, p_BoCo_E=p, V_BC_E=V_BC_E)
        return self.with_vectors(_composed(precision, *self.vectors, p, *V_BC_E.vectors))


@formula(of_sums=True)
def _composed(w: Three, v: Three, p: Three, w_BC: Three, v_BC: Three) -> list[Three]:
    return [vectors.plus(w, w_BC), vectors.plus(algebra.velocity_at(w, v, p), v_BC)]


@shift.register
def _shift_velocity(
    V_MP_E: SpatialVelocity, p_PQ_E: Vector3, w: Vector3 | None = None, *, precision: PrecisionName = None
) -> SpatialVelocity:
    require_no_w(V_MP_E, w)
    return shift_by(_shifted_velocity, V_MP_E, precision, p_PQ_E=p_PQ_E)


@formula(of_sums=True)
def _shifted_velocity(w: Three, v: Three, p: Three) -> list[Three]:
    return [w, algebra.velocity_at(w, v, p)]
