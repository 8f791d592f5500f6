"""Brax: Transform (pos, rot wxyz), Motion (ang, vel) and Force (ang, vel), whose ang is a torque and vel a force.

All may be batched over leading axes. Beware that `Transform.do` takes a Force, an Inertia and a Transform out of the
frame, as `act` does, but a Motion into it, as `act_inverse` does; that `inv_do` takes a Motion out of it; and that
`inv_do` of a Force returns NotImplemented. Read: brax/base.py, brax 0.14.
"""

import jax.numpy as jnp
import numpy as np

from jaxspatial.inertia import SpatialInertia, symmetric
from jaxspatial.interop import mujoco
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity, act


def from_motion(V):
    """SpatialVelocity of a brax.base.Motion, w its ang and v its vel."""
    return SpatialVelocity(V.ang, V.vel)


def to_motion(V):
    """brax.base.Motion of a SpatialVelocity."""
    return _base().Motion(ang=V.w, vel=V.v)


def from_spatial_acceleration(A, V, *, precision=None):
    """SpatialAcceleration, ours being classical, of Motions A, Featherstone's acceleration, and V, about one point: a =
    A.vel + w x v."""
    return SpatialAcceleration.from_featherstone(from_motion(A).to_array(), from_motion(V), precision=precision)


def to_spatial_acceleration(A, V, *, precision=None):
    """brax.base.Motion, Featherstone's acceleration, of a SpatialAcceleration and SpatialVelocity about one point."""
    return to_motion(SpatialVelocity.from_array(A.to_featherstone(V, precision=precision)))


def from_force(F):
    """SpatialForce of a brax.base.Force, tau its ang and f its vel."""
    return SpatialForce(F.ang, F.vel)


def from_momentum(L):
    """SpatialMomentum of a brax.base.Force, which `Inertia.mul` of a velocity is."""
    return SpatialMomentum(L.ang, L.vel)


def to_force(F):
    """brax.base.Force of a SpatialForce or SpatialMomentum."""
    return _base().Force(ang=F.rotational, vel=F.translational)


def from_transform(X_AB, *, precision=None):
    """RigidTransform of a brax.base.Transform, which holds p_AB and a quaternion wxyz."""
    return mujoco.from_xpos_xquat(X_AB.pos, X_AB.rot, precision=precision)


def to_transform(X_AB, *, precision=None):
    """brax.base.Transform, the real part not negative."""
    return _base().Transform(*mujoco.to_xpos_xquat(X_AB, precision=precision))


# Inertia is one class with two meanings: of a link, and after `Transform.do`.


def from_inertia(M, *, precision=None):
    """M_BBo_B, about the link's origin in its axes, of a brax.base.Inertia as links have it: `i` about the centre of
    mass, in the axes of `transform`, whose `pos` is the centre of mass."""
    X_BI = from_transform(M.transform, precision=precision)
    return act(X_BI, SpatialInertia(M.mass, np.zeros(3, X_BI.dtype), M.i), precision=precision)


def to_inertia(M_BBo_B):
    """brax.base.Inertia as links have it, in the axes of the link. Exact."""
    transform = _base().Transform.create(pos=jnp.asarray(M_BBo_B.com))
    return _base().Inertia(transform=transform, i=M_BBo_B.central_matrix(), mass=M_BBo_B.mass)


def from_moved_inertia(M, *, precision=None):
    """M_BP_E of a brax.base.Inertia that has gone through `Transform.do`: `i` about the new origin P, and
    `transform.pos` the mass times the centre of mass. `Inertia.mul` is for these only. What cancels: see
    `SpatialInertia.from_dynamic_parameters`."""
    six = symmetric.from_matrix(M.i)
    pi10 = jnp.concatenate((jnp.asarray(M.mass)[..., None], M.transform.pos, six), -1)
    return SpatialInertia.from_dynamic_parameters(pi10, precision=precision)


def to_moved_inertia(M_BP_E, *, precision=None):
    """brax.base.Inertia as it is after `Transform.do`, for `Inertia.mul`."""
    pi10 = M_BP_E.to_dynamic_parameters(precision=precision)
    transform = _base().Transform.create(pos=jnp.asarray(pi10[..., 1:4]))
    return _base().Inertia(transform=transform, i=symmetric.to_matrix(pi10[..., 4:]), mass=M_BP_E.mass)


def _base():
    from brax import base

    return base
