"""Spatial vectors of bodies, inside MuJoCo and at its surface."""

import jax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.types import DTypeLike, Matrix, PrecisionName, Six, Vector, Vector3
from jaxspatial.interop import orders
from jaxspatial.interop.mujoco.frames import rotation
from jaxspatial.spatial import SpatialAcceleration, SpatialForce, SpatialVelocity, rotate

# -- inside: rotational first, about C, in the world's axes ------------------------------------------------------------


def from_cvel(cvel: Six) -> SpatialVelocity:
    """Reads mjData.cvel.

    Args:
        cvel: (*batch, 6) [w; v]; rad/s, m/s.

    Returns:
        V_WC_W (*batch,), of the body's point at C.

    Raises:
        ValueError: the shape does not fit.
    """
    return SpatialVelocity.from_array(cvel)


def to_cvel(V_WC_W: SpatialVelocity) -> jax.Array:
    """Makes mjData.cvel.

    Args:
        V_WC_W: of the body's point at C (*batch,).

    Returns:
        (*batch, 6) [w; v].
    """
    return V_WC_W.to_array()


def from_cdof(cdof: Six) -> SpatialVelocity:
    """Reads mjData.cdof.

    Args:
        cdof: (nv, 6) [w; v].

    Returns:
        V_WC_W (nv,) per unit velocity of each degree of freedom.

    Raises:
        ValueError: the shape does not fit.
    """
    return SpatialVelocity.from_array(cdof)


def to_cdof(V_WC_W: SpatialVelocity) -> jax.Array:
    """Makes mjData.cdof.

    Args:
        V_WC_W: per unit velocity of each degree of freedom (nv,).

    Returns:
        (nv, 6) [w; v].
    """
    return V_WC_W.to_array()


def from_cacc(cacc: Six, cvel: Six, gravity: Vector3, *, precision: PrecisionName = None) -> SpatialAcceleration:
    """Reads mjData.cacc, which is there after mj_rnePostConstraint.

    a = cacc[3:] + gravity + w x v
    MuJoCo's is Featherstone's acceleration, about C at rest, less gravity: -gravity for the world body, 0 in free fall.

    Args:
        cacc: (*batch, 6) [alpha; a].
        cvel: (*batch, 6) [w; v], of mjData.
        gravity: (3,) of mjOption, m/s2.
        precision: name of a precision; None takes the default.

    Returns:
        A_WC_W (*batch,) of the body's point at C, classical.

    Raises:
        ValueError: the shape does not fit.

    Error: as of `SpatialAcceleration.from_featherstone`.
    """
    spatial = SpatialAcceleration.from_array(cacc)
    falling = spatial + _falling(gravity, spatial.dtype)
    return SpatialAcceleration.from_featherstone(falling.to_array(), from_cvel(cvel), precision=precision)


def to_cacc(
    A_WC_W: SpatialAcceleration,
    V_WC_W: SpatialVelocity,
    gravity: Vector3,
    *,
    precision: PrecisionName = None,
) -> jax.Array:
    """Makes mjData.cacc: (alpha, a - w x v - gravity).

    Args:
        A_WC_W: of the body's point at C (*batch,), classical.
        V_WC_W: of the same point.
        gravity: (3,) of mjOption, m/s2.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 6) [alpha; a].

    Error: as of `SpatialAcceleration.to_featherstone`.
    """
    spatial = SpatialAcceleration.from_array(A_WC_W.to_featherstone(V_WC_W, precision=precision))
    return (spatial - _falling(gravity, spatial.dtype)).to_array()


def from_object_acceleration(x6: Six, gravity: Vector3) -> SpatialAcceleration:
    """Reads what mj_objectAcceleration gives with flg_local = 0.

    Args:
        x6: (*batch, 6) [alpha; a - gravity].
        gravity: (3,) of mjOption, m/s2.

    Returns:
        A_WP_W (*batch,) of the object's origin P, classical.

    Raises:
        ValueError: the shape does not fit.

    Error: a sum, rounded once.
    """
    A_WP_W = SpatialAcceleration.from_array(x6)
    return A_WP_W + _falling(gravity, A_WP_W.dtype)


def to_object_acceleration(A_WP_W: SpatialAcceleration, gravity: Vector3) -> jax.Array:
    """Makes what mj_objectAcceleration gives with flg_local = 0.

    Args:
        A_WP_W: of the object's origin P (*batch,), classical.
        gravity: (3,) of mjOption, m/s2.

    Returns:
        (*batch, 6) [alpha; a - gravity].

    Error: a difference, rounded once.
    """
    return (A_WP_W - _falling(gravity, A_WP_W.dtype)).to_array()


def from_cfrc(cfrc: Six) -> SpatialForce:
    """Reads mjData.cfrc_int or cfrc_ext.

    Args:
        cfrc: (*batch, 6) [tau; f]; N m, N.

    Returns:
        F_C_W (*batch,): on the body, by its parent or from outside.

    Raises:
        ValueError: the shape does not fit.
    """
    return SpatialForce.from_array(cfrc)


def to_cfrc(F_C_W: SpatialForce) -> jax.Array:
    """Makes mjData.cfrc_int or cfrc_ext.

    Args:
        F_C_W: on the body, by its parent or from outside (*batch,).

    Returns:
        (*batch, 6) [tau; f].
    """
    return F_C_W.to_array()


def _falling(gravity: Vector3, dtype: DTypeLike) -> SpatialAcceleration:
    a = check.as_vectors(gravity, "gravity", dtype)
    return SpatialAcceleration(0 * a, a)


# -- at the surface: force first ---------------------------------------------------------------------------------------


def from_xfrc_applied(xfrc_applied: Six) -> SpatialForce:
    """Reads mjData.xfrc_applied.

    Args:
        xfrc_applied: (*batch, 6) [f; tau]; N, N m.

    Returns:
        F_Bcm_W (*batch,), about the body's centre of mass `xipos`, in world axes.

    Raises:
        ValueError: the shape does not fit.
    """
    return orders.from_linear_first(SpatialForce, xfrc_applied)


def to_xfrc_applied(F_Bcm_W: SpatialForce) -> jax.Array:
    """Makes mjData.xfrc_applied. From the body's origin: `shift(F_Bo_W, xipos - xpos)`.

    Args:
        F_Bcm_W: about the body's centre of mass `xipos`, in world axes (*batch,).

    Returns:
        (*batch, 6) [f; tau].
    """
    return orders.to_linear_first(F_Bcm_W)


def from_contact_force(force: Six, frame: Vector | Matrix, *, precision: PrecisionName = None) -> SpatialForce:
    """Reads what mj_contactForce gives.

    Args:
        force: (*batch, 6) [f; tau] along the axes of the contact.
        frame: (*batch, 9) or (*batch, 3, 3) of the contact: its axes by rows, the first of them the normal from geom1
            to geom2.
        precision: name of a precision; None takes the default.

    Returns:
        F_P_W (*batch,), about the contact's `pos` in the world's axes, on the body of its second geom; on that of the
        first acts -F.

    Raises:
        ValueError: the shape does not fit.

    Error: as of `rotate`.
    """
    return rotate(rotation(frame).inverse(), orders.from_linear_first(SpatialForce, force), precision=precision)


def to_contact_force(F_P_W: SpatialForce, frame: Vector | Matrix, *, precision: PrecisionName = None) -> jax.Array:
    """Makes what mj_contactForce gives.

    Args:
        F_P_W: about the contact's `pos` in the world's axes, on the body of its second geom (*batch,).
        frame: (*batch, 9) or (*batch, 3, 3) of the contact: its axes by rows, the first of them the normal from geom1
            to geom2.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch, 6) [f; tau] along the axes of the contact.

    Error: as of `rotate`.
    """
    return orders.to_linear_first(rotate(rotation(frame), F_P_W, precision=precision))
