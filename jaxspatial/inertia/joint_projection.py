"""An articulated body seen through a joint."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import jax

from jaxspatial.arithmetic import check
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.types import PrecisionName, Scalar
from jaxspatial.inertia import articulated
from jaxspatial.rotation.matrices import expanded
from jaxspatial.spatial.force import SpatialForce
from jaxspatial.spatial.velocity import SpatialVelocity

if TYPE_CHECKING:
    from jaxspatial.inertia.articulated_inertia import ArticulatedInertia

Motions = SpatialVelocity | Sequence[SpatialVelocity]  # of one joint: a list has one for each freedom


class JointProjection(NamedTuple):
    """What `joint_projection` found; `U` and `D` are lists where several motions were given."""

    inertia: "ArticulatedInertia"
    U: SpatialForce | list[SpatialForce]
    D: jax.Array | list[jax.Array]


def joint_projection(
    P_P_E: "ArticulatedInertia",
    S_P_E: Motions,
    armature: Scalar = 0.0,
    *,
    precision: PrecisionName = None,
) -> JointProjection:
    """The articulated inertia seen through a joint that lets it move freely along S.

        U = P S        D = S^T U + armature        inertia = P - U D^-1 U^T

    For a joint of k freedoms, the inertia left is P - P S (S^T P S + diag(armature))^-1 S^T P, S the 6 x k matrix. It
    is symmetric, and without an armature maps S to 0 but for errors. Where D is 0 or less, by rounding or because
    nothing hangs on the joint, there is nothing to remove: the inertia stays as it is.

    Args:
        P_P_E: the articulated inertia about P, expressed in frame E.
        S_P_E: the motion of a unit of the joint's velocity, about the same point in the same frame. For a joint of k
            freedoms a list of k, removed one after the other.
        armature: inertia of the joint itself (rotors ...), a number or (*batch,); of a list of motions one for all or a
            list of k.
        precision: name of a precision; None takes the default.

    Returns:
        (inertia, U, D), over the common batch. Of a list of motions U and D are lists: those of the i-th are those of
        the inertia left by the ones before, as an articulated-body algorithm needs them that treats the joint as k
        joints between massless bodies. 140 flops per freedom.

    Raises:
        TypeError: an argument is of another kind, or dtypes differ.
        ValueError: shapes do not fit, or there are not as many armatures as motions.

    Error: per entry of the inertia, for one S, with mag_D the sum of the absolute values of the terms of D and
        mag = |P_ij| + mag_U,i mag_U,j / D: at most 16 u mag mag_D / D in "fast" and "reproducible", u |r| + 64 u^2 mag
        mag_D / D in the other two, while mag_D / D <= 1 / (32 u), or 1 / (64 u^2). mag_D / D is 1 for a joint along one
        axis of the frame; it is large where a body is light about an oblique axis: a thin rod about its own.
    Source: Featherstone 2008, 7.2, equations 7.43 and 7.44; Jain 2010, 6.3.
    """
    S, arms = _joint(P_P_E, S_P_E, armature)
    words = [part for s in S for part in (s.w, s.v)]
    j, f, m, *found = articulated.projected(precision, *P_P_E.vectors, *arms, *words, n=len(S))
    U = [SpatialForce(tau, force) for tau, force in zip(found[::3], found[1::3], strict=True)]
    D = [d.reshape(d.shape[:-1]) for d in found[2::3]]
    return JointProjection(
        P_P_E.with_vectors((j, f, m)), *((U[0], D[0]) if isinstance(S_P_E, SpatialVelocity) else (U, D))
    )


def _joint(
    P: "ArticulatedInertia", S: Motions, armature: Scalar | Sequence[Scalar]
) -> tuple[list[SpatialVelocity], list[jax.Array]]:
    """(the SpatialVelocities of the joint, an armature (*batch, 1) for each), checked."""
    motions: list[Any] = list(S) if isinstance(S, (list, tuple)) else [S]
    for s in motions:
        if not isinstance(s, SpatialVelocity):
            kind = type(s).__name__
            raise TypeError(f"joint_projection: S: expected a SpatialVelocity or a list of them, got {kind}")
        require_alike(ArticulatedInertia=P, S=s)
    arms = armature if isinstance(armature, (list, tuple)) else [armature] * len(motions)
    if len(arms) != len(motions):
        raise ValueError(f"joint_projection: armature: expected {len(motions)} numbers, got {len(arms)}")
    return motions, [_arm(P, x) for x in arms]


def _arm(P: "ArticulatedInertia", armature: Scalar) -> jax.Array:
    arm = expanded(check.as_float_array(armature, "joint_projection: armature", P.dtype))
    require_alike(ArticulatedInertia=P, armature=arm)
    return arm
