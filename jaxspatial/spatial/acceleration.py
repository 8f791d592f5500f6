"""Spatial acceleration: the classical acceleration of a point on top of which the body turns."""

import jax

from jaxspatial.arithmetic import lanes
from jaxspatial.arithmetic.kernel import kernel
from jaxspatial.spatial.operations import shift
from jaxspatial.spatial.vector import SpatialVector, shifted, spatial_vector


@spatial_vector
class SpatialAcceleration(SpatialVector):
    """A_MBp_E: how the motion of body B in frame M changes, looked at in point Bp, expressed in frame E.

    alpha: (*batch, 3) angular acceleration, rad/s2
    a: (*batch, 3) classical acceleration of Bp, m/s2: Featherstone's spatial acceleration plus w x v
    """

    alpha: jax.Array
    a: jax.Array


@shift.register
def _shift_acceleration(A_MP_E: SpatialAcceleration, p_PQ_E, w=None, *, precision=None):
    if w is None:
        raise TypeError("shift: expected w, the angular velocity of the body, (*batch, 3), for a SpatialAcceleration")
    return shifted(_shifted, A_MP_E, precision, p_PQ_E=p_PQ_E, w=w)


@kernel
def _shifted(precision, alpha, a, p, w):
    alpha_, p_, w_ = map(lanes.unstack, (alpha, p, w))
    tangential = lanes.cross(precision, alpha_, p_)
    centripetal = lanes.cross(precision, w_, lanes.cross(precision, w_, p_))
    return alpha, lanes.plus(lanes.plus(a, tangential), centripetal)
