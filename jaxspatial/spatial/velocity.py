"""Spatial velocity."""

import jax

from jaxspatial.arithmetic import lanes
from jaxspatial.arithmetic.kernel import kernel
from jaxspatial.spatial.operations import shift
from jaxspatial.spatial.vector import SpatialVector, require_no_w, shifted, spatial_vector


@spatial_vector
class SpatialVelocity(SpatialVector):
    """V_MBp_E: how body B moves in frame M, looked at in point Bp, expressed in frame E.

    w: (*batch, 3) angular velocity, rad/s
    v: (*batch, 3) velocity of Bp, m/s
    """

    w: jax.Array
    v: jax.Array


@shift.register
def _shift_velocity(V_MP_E: SpatialVelocity, p_PQ_E, w=None, *, precision=None):
    require_no_w(V_MP_E, w)
    return shifted(_shifted, V_MP_E, precision, p_PQ_E=p_PQ_E)


@kernel
def _shifted(precision, w, v, p):
    return w, lanes.plus(v, lanes.cross(precision, lanes.unstack(w), lanes.unstack(p)))
