"""Spatial acceleration: the classical acceleration of a point on top of which the body turns."""

from typing import Self

import jax

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Three
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.tree import tree
from jaxspatial.arithmetic.types import PrecisionName, Six, Vector3
from jaxspatial.spatial import algebra
from jaxspatial.spatial.arguments import require_kind, require_w, shift_by
from jaxspatial.spatial.operations import shift
from jaxspatial.spatial.parts import LEFT_OUT, joined
from jaxspatial.spatial.vector import SpatialVector
from jaxspatial.spatial.velocity import SpatialVelocity


@tree
class SpatialAcceleration(SpatialVector):
    """A_MBp_E: how the motion of body B in frame M changes, looked at in point Bp, expressed in frame E.

    alpha: (*batch, 3) angular acceleration, rad/s2
    a: (*batch, 3) classical acceleration of Bp, m/s2: Featherstone's spatial acceleration plus w x v

    A part that is left out is a known zero, see `SpatialForce`.
    """

    alpha: jax.Array = LEFT_OUT
    a: jax.Array = LEFT_OUT

    def compose_with_moving_frame(
        self,
        p_BoCo_E: Vector3,
        w_MB_E: Vector3,
        V_BC_E: SpatialVelocity,
        A_BC_E: "SpatialAcceleration",
        *,
        precision: PrecisionName = None,
    ) -> "SpatialAcceleration":
        """A_MC_E of frame C that moves at V_BC_E and A_BC_E in frame B, which moves at w_MB_E and this A_MB_E in M.

            alpha_MC = alpha_MB + alpha_BC + w_MB x w_BC
            a_MCo = a_MBo + alpha_MB x p + w_MB x (w_MB x p) + 2 w_MB x v_BC + a_BC        p = p_BoCo

        The terms are the tangential, centripetal and Coriolis accelerations.

        Args:
            p_BoCo_E: (*batch, 3) position of Co from Bo, m, expressed in frame E.
            w_MB_E: (*batch, 3) angular velocity of B in M, rad/s, in E.
            V_BC_E: SpatialVelocity (*batch,) of C in B about Co, in E.
            A_BC_E: SpatialAcceleration (*batch,) of C in B about Co, in E.
            precision: name of a precision; None takes the default.

        Returns:
            A_MC_E about Co, over the common batch. 66 flops.

        Raises:
            TypeError: V_BC_E or A_BC_E is of another kind, or dtypes differ.
            ValueError: shapes do not fit.

        Error: per component, mag the sum of the absolute values of its terms, multiplied out: at most 10 u mag in
            "fast" and "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp in "faithful".
        Source: Mitiguy 2022, Dynamics of Mechanical, Aerospace, and Biomechanical Systems; Featherstone 2008, 2.11.
        """
        name = "compose_with_moving_frame"
        require_kind(V_BC_E, SpatialVelocity, f"{name}: V_BC_E")
        require_kind(A_BC_E, SpatialAcceleration, f"{name}: A_BC_E")
        p = check.as_vectors(p_BoCo_E, f"{name}: p_BoCo_E", self.dtype)
        w = check.as_vectors(w_MB_E, f"{name}: w_MB_E", self.dtype)
        require_alike(A_MB_E=self, p_BoCo_E=p, w_MB_E=w, V_BC_E=V_BC_E, A_BC_E=A_BC_E)
        return self.with_vectors(_composed(precision, *self.vectors, p, w, *V_BC_E.vectors, *A_BC_E.vectors))

    def to_featherstone(self, V_MP_E: SpatialVelocity, *, precision: PrecisionName = None) -> jax.Array:
        """Featherstone's spatial acceleration, rotational on top: (alpha, a - w x v).

        It is the rate of change of the velocity of whatever passes a fixed point, instead of that of one point of the
        body. Pinocchio's and MuJoCo's accelerations are of this kind. It is an array, so that nothing takes it for a
        classical acceleration.

        Args:
            V_MP_E: SpatialVelocity (*batch,) of the same body, about the same point, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            (*batch, 6), over the common batch: rad/s2, m/s2.

        Raises:
            TypeError: V_MP_E is of another kind, or dtypes differ.
            ValueError: batch shapes do not broadcast.

        Error: as of `shift` of a force.
        Source: Featherstone 2008, 2.11.
        """
        require_kind(V_MP_E, SpatialVelocity, "to_featherstone: V_MP_E")
        require_alike(A_MP_E=self, V_MP_E=V_MP_E)
        return joined(*_to_featherstone(precision, *self.vectors, *V_MP_E.vectors))

    @classmethod
    def from_featherstone(cls, x6: Six, V_MP_E: SpatialVelocity, *, precision: PrecisionName = None) -> Self:
        """The classical acceleration of Featherstone's, rotational on top: (alpha, a + w x v).

        Args:
            x6: (*batch, 6) Featherstone's spatial acceleration: rad/s2, m/s2; see `to_featherstone`.
            V_MP_E: SpatialVelocity (*batch,) of the same body, about the same point, in the same frame.
            precision: name of a precision; None takes the default.

        Returns:
            The acceleration, over the common batch.

        Raises:
            TypeError: V_MP_E is of another kind, or dtypes differ.
            ValueError: shapes do not fit.

        Error: as of `shift` of a force.
        Source: Featherstone 2008, 2.11.
        """
        require_kind(V_MP_E, SpatialVelocity, "from_featherstone: V_MP_E")
        spatial = cls.from_array(x6)
        require_alike(x6=spatial, V_MP_E=V_MP_E)
        return spatial.with_vectors(_from_featherstone(precision, *spatial.vectors, *V_MP_E.vectors))


@formula(of_sums=True)
def _composed(
    alpha: Three, a: Three, p: Three, w: Three, w_BC: Three, v_BC: Three, alpha_BC: Three, a_BC: Three
) -> list[Three]:
    turned, coriolis = vectors.cross(w, w_BC), vectors.cross(w, v_BC)
    moved = vectors.plus(algebra.acceleration_at(alpha, a, w, p), vectors.plus(coriolis, coriolis), a_BC)
    return [vectors.plus(alpha, alpha_BC, turned), moved]


@formula(of_sums=True)
def _to_featherstone(alpha: Three, a: Three, w: Three, v: Three) -> list[Three]:
    return [alpha, vectors.minus(a, vectors.cross(w, v))]


@formula(of_sums=True)
def _from_featherstone(alpha: Three, a: Three, w: Three, v: Three) -> list[Three]:
    return [alpha, vectors.plus(a, vectors.cross(w, v))]


@shift.register
def _shift_acceleration(
    A_MP_E: SpatialAcceleration, p_PQ_E: Vector3, w: Vector3 | None = None, *, precision: PrecisionName = None
) -> SpatialAcceleration:
    return shift_by(_shifted_acceleration, A_MP_E, precision, p_PQ_E=p_PQ_E, w=require_w(A_MP_E, w))


@formula(of_sums=True)
def _shifted_acceleration(alpha: Three, a: Three, p: Three, w: Three) -> list[Three]:
    return [alpha, algebra.acceleration_at(alpha, a, w, p)]
