"""Brax: Transform (pos, rot wxyz), Motion (ang, vel) and Force (ang, vel), whose ang is a torque and vel a force.

All may be batched over leading axes. Beware that `Transform.do` takes a Force, an Inertia and a
Transform out of the frame, as `act` does, but a Motion into it, as `act_inverse` does; that `inv_do` takes a Motion out
of it; and that `inv_do` of a Force returns NotImplemented. Read: brax/base.py, brax 0.14.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from jaxspatial.inertia import SpatialInertia
from jaxspatial.numerics import check, eigen, floats
from jaxspatial.numerics.numbers.components import as_array
from jaxspatial.numerics.types import PrecisionName
from jaxspatial.rotation import Rotation
from jaxspatial.spatial import (
    RigidTransform,
    SpatialAcceleration,
    SpatialForce,
    SpatialMomentum,
    SpatialVelocity,
    act,
    dot,
    shift,
)
from jaxspatial.spatial.vectors import SpatialVector

if TYPE_CHECKING:
    from brax import base
    from brax.generalized.base import State

# -- motions, forces and transforms ------------------------------------------------------------------------------------


def from_motion(V: "base.Motion") -> SpatialVelocity:
    """Reads a brax.base.Motion (*batch,) that is a velocity: w is its ang, v its vel.

    Example:
        >>> from brax.base import Motion
        >>> js.interop.brax.from_motion(Motion(ang=jnp.array([0.0, 0.0, 1.0]), vel=jnp.array([0.5, 0.0, 0.0])))
        SpatialVelocity(w=[0.0, 0.0, 1.0], v=[0.5, 0.0, 0.0])
    """
    return SpatialVelocity(V.ang, V.vel)


def to_motion(V: SpatialVelocity) -> "base.Motion":
    """Makes a brax.base.Motion (*batch,) that is a velocity.

    Example:
        >>> theirs = js.interop.brax.to_motion(V)
        >>> print(theirs.ang, theirs.vel)
        [0. 0. 1.] [0.5 0.  0. ]
    """
    from brax import base

    return base.Motion(**_parts(V))


def from_spatial_acceleration(
    A: "base.Motion", V: "base.Motion", *, precision: PrecisionName = None
) -> SpatialAcceleration:
    """Reads a brax.base.Motion that is Featherstone's acceleration: a = A.vel + w x v.

    Args:
        A: the acceleration (*batch,).
        V: the velocity, a Motion about the same point.
        precision: name of a precision; None takes the default.

    Returns:
        The classical acceleration (*batch,).

    Error: as of `SpatialAcceleration.from_featherstone`.

    Example:
        >>> from brax.base import Motion
        >>> A = js.interop.brax.from_spatial_acceleration(Motion.zero(), js.interop.brax.to_motion(V))
        >>> print(A.a)  # w x v, of a point on a circle
        [0.  0.5 0. ]
    """
    return SpatialAcceleration.from_featherstone(from_motion(A).to_array(), from_motion(V), precision=precision)


def to_spatial_acceleration(
    A: SpatialAcceleration, V: SpatialVelocity, *, precision: PrecisionName = None
) -> "base.Motion":
    """Makes a brax.base.Motion (*batch,) that is Featherstone's acceleration; A is classical, V about the same point.

    Error: as of `SpatialAcceleration.to_featherstone`.

    Example:
        >>> A = js.SpatialAcceleration(alpha=[0.0, 0.0, 2.0], a=[0.0, 0.5, 0.0])
        >>> theirs = js.interop.brax.to_spatial_acceleration(A, V)
        >>> print(theirs.ang, theirs.vel)
        [0. 0. 2.] [0. 0. 0.]
    """
    return to_motion(SpatialVelocity.from_array(A.to_featherstone(V, precision=precision)))


def from_force(F: "base.Force") -> SpatialForce:
    """Reads a brax.base.Force (*batch,) that is a force: tau is its ang, f its vel.

    Example:
        >>> from brax.base import Force
        >>> js.interop.brax.from_force(Force(ang=jnp.array([0.0, 0.0, 3.0]), vel=jnp.array([1.0, 2.0, 0.0])))
        SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
    """
    return SpatialForce(F.ang, F.vel)


def from_momentum(L: "base.Force") -> SpatialMomentum:
    """Reads a brax.base.Force (*batch,) that is a momentum, such as `Inertia.mul` gives: h is its ang, l its vel.

    Example:
        >>> moved = js.interop.brax.to_moved_inertia(rod)  # about its end, of 2 kg
        >>> js.interop.brax.from_momentum(moved.mul(js.interop.brax.to_motion(V))) == rod @ V
        Array(True, dtype=bool)
    """
    return SpatialMomentum(L.ang, L.vel)


def to_force(F: SpatialForce | SpatialMomentum) -> "base.Force":
    """Makes a brax.base.Force (*batch,).

    Example:
        >>> theirs = js.interop.brax.to_force(F)
        >>> print(theirs.ang, theirs.vel)
        [0. 0. 3.] [1. 2. 0.]
    """
    from brax import base

    return base.Force(**_parts(F))


def _parts(x: SpatialVector) -> dict:
    """Brax computes with arrays alone: a part that is a known zero becomes one."""
    return {name: as_array(part, x.batch_shape) for name, part in zip(("ang", "vel"), x._vectors, strict=True)}


def from_transform(X_AB: "base.Transform", *, precision: PrecisionName = None) -> RigidTransform:
    """Reads a brax.base.Transform (*batch,), which holds p_AB, m, and a quaternion wxyz.

    Error: as of `Rotation.from_quaternion`.

    Example:
        >>> from brax.base import Transform
        >>> X_AB = js.interop.brax.from_transform(Transform.create(pos=jnp.array([0.0, 0.0, -1.0])))
        >>> print(X_AB @ jnp.array([1.0, 0.0, 0.0]))
        [ 1.  0. -1.]
    """
    return RigidTransform(Rotation.from_quaternion(X_AB.rot, precision=precision), X_AB.pos)


def to_transform(X_AB: RigidTransform, *, precision: PrecisionName = None) -> "base.Transform":
    """Makes a brax.base.Transform (*batch,), m, the real part not negative.

    Error: as of `Rotation.to_quaternion`.

    Example:
        >>> theirs = js.interop.brax.to_transform(below)
        >>> print(theirs.pos, theirs.rot)
        [ 0.  0. -1.] [1. 0. 0. 0.]
    """
    from brax import base

    return base.Transform(pos=X_AB.translation, rot=X_AB.rotation.to_quaternion(precision=precision))


# -- inertias: one class with two meanings, of a link and after `Transform.do` -----------------------------------------


def from_inertia(M: "base.Inertia", *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads a brax.base.Inertia as links have it.

    Args:
        M: (*batch,); `i` is about the centre of mass, in the axes of `transform`, whose `pos` is the centre of mass.
        precision: name of a precision; None takes the default.

    Returns:
        M_BBo_B (*batch,), about the link's origin in its axes.

    Error: as of `act` of an inertia.

    Example:
        >>> M_BBo_B = js.interop.brax.from_inertia(js.interop.brax.to_inertia(rod))
        >>> print(M_BBo_B.mass, M_BBo_B.com)
        2.0 [ 0.   0.  -0.5]
    """
    X_BI = from_transform(M.transform, precision=precision)
    return act(X_BI, SpatialInertia(M.mass, np.zeros(3, X_BI.dtype), M.i), precision=precision)


def to_inertia(M_BBo_B: SpatialInertia) -> "base.Inertia":
    """Makes a brax.base.Inertia (*batch,) as links have it, in the axes of the link.

    Example:
        >>> theirs = js.interop.brax.to_inertia(rod)
        >>> print(theirs.mass, theirs.transform.pos)
        2.0 [ 0.   0.  -0.5]
    """
    from brax import base

    transform = base.Transform.create(pos=floats.as_vectors(M_BBo_B.com, "brax.to_inertia: com"))
    return base.Inertia(transform=transform, i=M_BBo_B.central_matrix(), mass=M_BBo_B.mass)


def from_moved_inertia(M: "base.Inertia", *, precision: PrecisionName = None) -> SpatialInertia:
    """Reads a brax.base.Inertia that has gone through `Transform.do`; `Inertia.mul` is for these only.

    Args:
        M: (*batch,); `i` is about the new origin P, and `transform.pos` the mass times the centre of mass.
        precision: name of a precision; None takes the default.

    Returns:
        M_BP_E (*batch,).

    Error: as of `SpatialInertia.from_dynamic_parameters`, which says what cancels.

    Example:
        >>> js.interop.brax.from_moved_inertia(js.interop.brax.to_moved_inertia(rod)).com
        Array([ 0. ,  0. , -0.5], dtype=float32)
    """
    mass, six = floats.as_float_array(M.mass, "brax.from_moved_inertia: mass"), eigen.six_of_matrix(M.i)
    pi10 = jnp.concatenate((mass.reshape((*mass.shape, 1)), M.transform.pos, six), -1)
    return SpatialInertia.from_dynamic_parameters(pi10, precision=precision)


def to_moved_inertia(M_BP_E: SpatialInertia, *, precision: PrecisionName = None) -> "base.Inertia":
    """Makes a brax.base.Inertia (*batch,) as it is after `Transform.do`, for `Inertia.mul`.

    Error: as of `SpatialInertia.to_dynamic_parameters`.

    Example:
        >>> print(js.interop.brax.to_moved_inertia(rod).transform.pos)  # 2 kg times 0.5 m
        [ 0.  0. -1.]
    """
    from brax import base

    pi10 = M_BP_E.to_dynamic_parameters(precision=precision)
    transform = base.Transform.create(pos=pi10[..., 1:4])
    return base.Inertia(transform=transform, i=eigen.matrix_of_six(pi10[..., 4:]), mass=M_BP_E.mass)


# -- wrenches on links -------------------------------------------------------------------------------------------------


def to_tau(
    sys: "base.System",
    state: "State",
    wrenches: Mapping[str, SpatialForce],
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """Makes the generalized forces of wrenches on links, for the generalized pipeline of Brax.

        tau_i = cdof_i . sum F_C        over the links that joint i moves, C = root_com

    `cdof` and `root_com` of a state are those of its q, so that the next step starts with them. Of a slide on a body
    that has turned, Brax 0.14 does not turn the axis in cdof: its dynamics then are not those of MuJoCo, nor is this.

    Args:
        sys: a brax.base.System.
        state: a brax.generalized.base.State (*batch,) of it.
        wrenches: by name of a link F_Bo_W (*batch,), about the origin of the link in world axes, N m, N, as
            `applied_wrenches` gives them. What acts on "world" moves no link.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, qd_size) tau, N m or N, in the order of `state.qd`, to be added to those of the actuators.

    Raises:
        KeyError: there is no such link.

    Error: as of `shift`, then of `dot`, for each wrench; then one sum per further wrench.

    Example:
        >>> from brax.generalized import pipeline
        >>> from brax.io import mjcf
        >>> body = '<body name="rod"><joint axis="0 1 0"/><geom type="capsule" size=".1" fromto="0 0 0 0 0 -1"/></body>'
        >>> sys = mjcf.loads(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
        >>> state = pipeline.init(sys, jnp.zeros(1), jnp.zeros(1))
        >>> print(js.interop.brax.to_tau(sys, state, {"rod": js.SpatialForce(tau=[0.0, 3.0, 0.0])}))
        [3.]
    """
    total = jnp.zeros_like(state.qd)
    for name, F_Bo_W in wrenches.items():
        if name == "world":
            continue
        if name not in sys.link_names:
            raise KeyError(f"brax.to_tau: there is no link {name!r}{check.did_you_mean(name, sys.link_names)}")
        link = sys.link_names.index(name)
        F_C_W = shift(F_Bo_W, state.root_com[..., link, :] - state.x.pos[..., link, :], precision=precision)
        S_C_W = from_motion(state.cdof)
        on_each = SpatialForce(*(part[..., None, :] for part in F_C_W._vectors))
        total = total + jnp.where(_moves(sys, link), dot(S_C_W, on_each, precision=precision), 0)
    return total


def _moves(sys, link: int) -> np.ndarray:
    """(qd_size,) whether a joint coordinate moves a link: it is one of the link, or of a link that carries it."""
    carriers = set[int]()
    while link >= 0:
        carriers.add(link)
        link = int(sys.link_parents[link])
    widths = [6 if kind == "f" else int(kind) for kind in sys.link_types]
    return np.repeat([i in carriers for i in range(len(widths))], widths)
