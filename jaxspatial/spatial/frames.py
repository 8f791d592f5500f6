"""Spatial vectors under rigid transforms: moved and re-expressed at once; and under rotations."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import jax

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Numbers, Three
from jaxspatial.arithmetic.quantity import Quantity, require_alike
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.rotation.rotation import Rotation, rotated_together
from jaxspatial.spatial import algebra
from jaxspatial.spatial.acceleration import SpatialAcceleration
from jaxspatial.spatial.arguments import refuse, require_kind, require_no_w, require_w
from jaxspatial.spatial.force import SpatialForce, SpatialMomentum
from jaxspatial.spatial.operations import rotating
from jaxspatial.spatial.transform import RigidTransform
from jaxspatial.spatial.vector import SpatialVector
from jaxspatial.spatial.velocity import SpatialVelocity

_Kind = TypeVar("_Kind", bound=Quantity)


def act(X_AB: RigidTransform, X_Bo_B: _Kind, w: Vector3 | None = None, *, precision: PrecisionName = None) -> _Kind:
    """Moves a spatial quantity from Bo to Ao and re-expresses it from frame B in frame A: X_Bo_B -> X_Ao_A.

        force, momentum   f_A = R f             tau_A = R tau + p x f_A
        velocity          w_A = R w             v_A = R v + p x w_A
        acceleration      alpha_A = R alpha     a_A = R a + p x alpha_A + R w x (p x R w)
        inertia           com_A = R com + p     central_A = R central R^T

    `act_inverse` undoes it. Both points are points of the same body. For the velocity of a moving frame see
    `SpatialVelocity.compose_with_moving_frame`. Power does not change when force and velocity are both acted on.

    Args:
        X_AB: RigidTransform (*batch,) with rotation R and translation p = p_AoBo_A.
        X_Bo_B: any spatial vector, a SpatialInertia or an ArticulatedInertia (*batch,), about Bo, expressed in frame B.
        w: (*batch, 3) angular velocity of the body, rad/s, in B. An acceleration needs it, all others refuse it.
        precision: name of a precision; None takes the default.

    Returns:
        The kind of X_Bo_B, about Ao, in A, over the common batch. 42 flops, of an acceleration 93.

    Raises:
        TypeError: the arguments are of other kinds, dtypes differ, w is missing or not wanted.
        ValueError: shapes do not fit.

    Error: per component, mag the sum of the absolute values of its terms, multiplied out: at most 8 u mag in "fast" and
        "reproducible" [acceleration 14 u mag], u |r| + 32 u^2 mag in "compensated" [128 u^2 mag], 1 ulp in "faithful",
        while nothing over- or underflows. For the edges, and for derivatives, see `jaxspatial.spatial.operations`.
    Source: Featherstone 2008, 2.8; Jain 2010, 1.5.
    """
    return acting(X_Bo_B, X_AB, w, precision, "act")


@functools.singledispatch
def acting(X: Quantity, X_AB: RigidTransform, w: Vector3 | None, precision: PrecisionName, operation: str) -> Any:
    """`act` or `act_inverse`, as `operation` says, dispatched on what is acted on."""
    refuse(operation, "a spatial vector or inertia as second", X)


def act_inverse(
    X_AB: RigidTransform, X_Ao_A: _Kind, w: Vector3 | None = None, *, precision: PrecisionName = None
) -> _Kind:
    """`act` of X_AB^-1, without forming it: X_Ao_A -> X_Bo_B.

        force, momentum   f_B = R^T f           tau_B = R^T (tau - p x f)
        velocity          w_B = R^T w           v_B = R^T (v + w x p)
        acceleration      alpha_B = R^T alpha   a_B = R^T (a + alpha x p + w x (w x p))
        inertia           com_B = R^T (com - p) central_B = R^T central R

    Args:
        X_AB: RigidTransform (*batch,) with rotation R and translation p = p_AoBo_A.
        X_Ao_A: any spatial vector, a SpatialInertia or an ArticulatedInertia (*batch,), about Ao, expressed in frame A.
        w: (*batch, 3) angular velocity of the body, rad/s, in A. An acceleration needs it, all others refuse it.
        precision: name of a precision; None takes the default.

    Returns:
        The kind of X_Ao_A, about Bo, in B, over the common batch.

    Raises:
        TypeError: the arguments are of other kinds, dtypes differ, w is missing or not wanted.
        ValueError: shapes do not fit.

    Error: as of `act`.
    Source: as of `act`.
    """
    return acting(X_Ao_A, X_AB, w, precision, "act_inverse")


@rotating.register
def _rotate_vector(X_P_E: SpatialVector, R_AE: Rotation, precision: PrecisionName) -> SpatialVector:
    check.require_same_dtype(Rotation=R_AE, **{type(X_P_E).__name__: X_P_E})
    return X_P_E.with_vectors(rotated_together(R_AE, *X_P_E.vectors, precision=precision))


@acting.register
def _act_on_force(
    F: SpatialForce | SpatialMomentum, X_AB: RigidTransform, w: Vector3 | None, precision: PrecisionName, operation: str
) -> SpatialForce | SpatialMomentum:
    require_no_w(F, w, operation)
    f, tau = _pair(_OF_PAIRS[operation], precision, X_AB, F, *reversed(F.vectors))
    return F.with_vectors((tau, f))


@acting.register
def _act_on_velocity(
    V: SpatialVelocity, X_AB: RigidTransform, w: Vector3 | None, precision: PrecisionName, operation: str
) -> SpatialVelocity:
    require_no_w(V, w, operation)
    return V.with_vectors(_pair(_OF_PAIRS[operation], precision, X_AB, V, *V.vectors))


@acting.register
def _act_on_acceleration(
    A: SpatialAcceleration, X_AB: RigidTransform, w: Vector3 | None, precision: PrecisionName, operation: str
) -> SpatialAcceleration:
    w = require_w(A, w, operation)
    return A.with_vectors(_pair(_OF_ACCELERATIONS[operation], precision, X_AB, A, w, *A.vectors))


def _pair(
    formula: Callable[..., Any], precision: PrecisionName, X_AB: RigidTransform, vector: SpatialVector, *arrays: Any
) -> Any:
    return formula(precision, *pose_of(X_AB, vector), *arrays)


def pose_of(X_AB: RigidTransform, X: Quantity) -> tuple[jax.Array, jax.Array]:
    """The entries of the rotation and the translation, with what they have in common with X checked."""
    require_kind(X_AB, RigidTransform, "act", " first")
    require_alike(RigidTransform=X_AB, **{type(X).__name__: X})
    return X_AB.rotation.entries, X_AB.translation


def _formula_of_pairs(law: Callable[..., tuple[Three, Three]]) -> Callable[..., Any]:
    """Of a law (rows, p, ..., x, y) that gives a pair, in the layout of x and y."""

    @formula(of_sums=True)
    def found(entries: Numbers, p: Three, *arrays: Three) -> list[Numbers]:
        pairs = zip(arrays[-2:], law(vectors.rows(entries), p, *arrays), strict=True)
        return [vectors.laid_out_as(*pair) for pair in pairs]

    return found


_OF_PAIRS = {"act": _formula_of_pairs(algebra.act), "act_inverse": _formula_of_pairs(algebra.act_inverse)}
_OF_ACCELERATIONS = {
    "act": _formula_of_pairs(algebra.act_on_acceleration),
    "act_inverse": _formula_of_pairs(algebra.act_inverse_on_acceleration),
}
