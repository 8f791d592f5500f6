"""Brax: Transform (pos, rot wxyz), Motion (ang, vel) and Force (ang, vel), whose ang is a torque and vel a force.

All may be batched over leading axes. Beware that `Transform.do` takes a Force, an Inertia and a Transform out of the
frame, as `act` does, but a Motion into it, as `act_inverse` does; that `inv_do` takes a Motion out of it; and that
`inv_do` of a Force returns NotImplemented. Read: brax/base.py, brax 0.14.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxspatial.arithmetic import check, symmetric
from jaxspatial.arithmetic.numbers.components import as_array
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import mujoco
from jaxspatial.interop.library import library
from jaxspatial.rotation.matrices import expanded
from jaxspatial.spatial import RigidTransform, SpatialAcceleration, SpatialForce, SpatialMomentum, SpatialVelocity, act
from jaxspatial.spatial.vector import SpatialVector


def from_motion(V: Any) -> SpatialVelocity:
    """Reads a brax.base.Motion that is a velocity.

    Args:
        V: ang is w, vel is v; (*batch, 3) each.

    Returns:
        The same (*batch,).
    """
    return SpatialVelocity(V.ang, V.vel)


def to_motion(V: SpatialVelocity) -> Any:
    """Makes a brax.base.Motion that is a velocity.

    Args:
        V: (*batch,).

    Returns:
        The Motion.

    Raises:
        ImportError: brax is missing.
    """
    return library("brax.base").Motion(**_parts(V))


def _parts(x: SpatialVector) -> dict[str, Any]:
    """Brax computes with arrays alone."""
    return {name: as_array(part, x.batch_shape) for name, part in zip(("ang", "vel"), x.vectors, strict=True)}


def from_spatial_acceleration(A: Any, V: Any, *, precision: PrecisionName = None) -> SpatialAcceleration:
    """Reads a brax.base.Motion that is Featherstone's acceleration.

    Args:
        A: the acceleration (*batch,).
        V: the velocity, a Motion about the same point.
        precision: name of a precision; None takes the default.

    Returns:
        The classical acceleration (*batch,), a = A.vel + w x v.

    Error: as of `SpatialAcceleration.from_featherstone`.
    """
    return SpatialAcceleration.from_featherstone(from_motion(A).to_array(), from_motion(V), precision=precision)


def to_spatial_acceleration(A: SpatialAcceleration, V: SpatialVelocity, *, precision: PrecisionName = None) -> Any:
    """Makes a brax.base.Motion that is Featherstone's acceleration.

    Args:
        A: classical, as all here are (*batch,).
        V: about the same point (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The Motion.

    Raises:
        ImportError: brax is missing.

    Error: as of `SpatialAcceleration.to_featherstone`.
    """
    return to_motion(SpatialVelocity.from_array(A.to_featherstone(V, precision=precision)))


def from_force(F: Any) -> SpatialForce:
    """Reads a brax.base.Force that is a force.

    Args:
        F: ang is tau, vel is f; (*batch, 3) each.

    Returns:
        The same (*batch,).
    """
    return SpatialForce(F.ang, F.vel)


def from_momentum(L: Any) -> SpatialMomentum:
    """Reads a brax.base.Force that is a momentum, such as `Inertia.mul` of a velocity.

    Args:
        L: ang is h, vel is l; (*batch, 3) each.

    Returns:
        The same (*batch,).
    """
    return SpatialMomentum(L.ang, L.vel)


def to_force(F: SpatialForce | SpatialMomentum) -> Any:
    """Makes a brax.base.Force.

    Args:
        F: (*batch,).

    Returns:
        The Force.

    Raises:
        ImportError: brax is missing.
    """
    return library("brax.base").Force(**_parts(F))


def from_transform(X_AB: Any, *, precision: PrecisionName = None) -> RigidTransform:
    """Reads a brax.base.Transform, which holds p_AB and a quaternion wxyz.

    Args:
        X_AB: a Transform (*batch,); m.
        precision: name of a precision; None takes the default.

    Returns:
        The same (*batch,).

    Error: as of `Rotation.from_quaternion`.
    """
    return mujoco.from_xpos_xquat(X_AB.pos, X_AB.rot, precision=precision)


def to_transform(X_AB: RigidTransform, *, precision: PrecisionName = None) -> Any:
    """Makes a brax.base.Transform, the real part not negative.

    Args:
        X_AB: (*batch,); m.
        precision: name of a precision; None takes the default.

    Returns:
        The Transform.

    Raises:
        ImportError: brax is missing.

    Error: as of `Rotation.to_quaternion`.
    """
    return library("brax.base").Transform(*mujoco.to_xpos_xquat(X_AB, precision=precision))


# Inertia is one class with two meanings: of a link, and after `Transform.do`.


def from_inertia(M: Any, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads a brax.base.Inertia as links have it.

    Args:
        M: `i` is about the centre of mass, in the axes of `transform`, whose `pos` is the centre of mass.
        precision: name of a precision; None takes the default.

    Returns:
        M_BBo_B (*batch,), about the link's origin in its axes.

    Error: as of `act` of an inertia.
    """
    X_BI = from_transform(M.transform, precision=precision)
    return act(X_BI, SpatialInertia(M.mass, np.zeros(3, X_BI.dtype), M.i), precision=precision)


def to_inertia(M_BBo_B: SpatialInertia) -> Any:
    """Makes a brax.base.Inertia as links have it, in the axes of the link.

    Args:
        M_BBo_B: (*batch,), about the link's origin in its axes.

    Returns:
        The Inertia.

    Raises:
        ImportError: brax is missing.
    """
    transform = library("brax.base").Transform.create(pos=check.as_vectors(M_BBo_B.com, "brax.to_inertia: com"))
    return library("brax.base").Inertia(transform=transform, i=M_BBo_B.central_matrix(), mass=M_BBo_B.mass)


def from_moved_inertia(M: Any, *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads a brax.base.Inertia that has gone through `Transform.do`; `Inertia.mul` is for these only.

    Args:
        M: `i` is about the new origin P, and `transform.pos` the mass times the centre of mass.
        precision: name of a precision; None takes the default.

    Returns:
        M_BP_E (*batch,).

    Error: as of `SpatialInertia.from_dynamic_parameters`, which tells what cancels.
    """
    mass, six = check.as_float_array(M.mass, "brax.from_moved_inertia: mass"), symmetric.from_matrix(M.i)
    pi10 = jnp.concatenate((expanded(mass), M.transform.pos, six), -1)
    return SpatialInertia.from_dynamic_parameters(pi10, precision=precision)


def to_moved_inertia(M_BP_E: SpatialInertia, *, precision: PrecisionName = None) -> Any:
    """Makes a brax.base.Inertia as it is after `Transform.do`, for `Inertia.mul`.

    Args:
        M_BP_E: (*batch,).
        precision: name of a precision; None takes the default.

    Returns:
        The Inertia.

    Raises:
        ImportError: brax is missing.

    Error: as of `SpatialInertia.to_dynamic_parameters`.
    """
    pi10 = M_BP_E.to_dynamic_parameters(precision=precision)
    transform = library("brax.base").Transform.create(pos=pi10[..., 1:4])
    return library("brax.base").Inertia(transform=transform, i=symmetric.to_matrix(pi10[..., 4:]), mass=M_BP_E.mass)
