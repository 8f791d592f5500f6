"""The operations on spatial vectors and inertias, each one generic function.

A function checks the kinds of its arguments and calls the method of the kind: `shift(X, p)` is `X._shift(p, ...)`.
`vectors` implements these methods for spatial vectors, `jaxspatial.inertia` for inertias.

The error bounds of all operations have these conditions. u is the unit roundoff of the inputs' dtype, r the exact
component, mag the sum of the absolute values of its terms, multiplied out.
- Bounds hold while nothing over- or underflows. In precision "compensated" and "faithful", float16, bfloat16 and
  float32 are evaluated in float64, and it is enough that r itself does not. In "faithful" float64, intermediate
  overflow does no harm either, except in products of three factors; nor does it in sums over a batch, or in pull-backs
  to an argument that a batch shares. Otherwise intermediate overflow gives what IEEE 754 gives for the formula as it is
  written.
- Where subnormals are flushed to zero (XLA CPU), errors grow by a few finfo.tiny, and a subnormal argument counts as 0
  in all precisions, whatever it is multiplied by. Subnormals of float16 are not flushed. In float64 the bounds of
  "compensated" and "faithful" need every nonzero factor, and every nonzero product of factors of a term, to be at least
  2^-960. Below that, errors are at most 7 u mag for terms of two factors; a term of more factors may be lost
  altogether where a product of some of them underflows, in whatever order the formula multiplies.
- In float64 a factor above (1 - 2^-27) finfo.max reduces "compensated" to "fast".
- NaN and infinities propagate as in the formula (of an acceleration, multiplied out). An r beyond finfo.max becomes an
  infinity.
- Derivatives of every order keep the bounds of "compensated" and "faithful" in each component, and so do pull-backs to
  an item that a batch shares. In the other two precisions they are sums of products, each rounded.
- Double words in place of arrays (`js.to_double_word`) are evaluated as in "compensated", in "faithful" as there, but
  not rounded at the end: results are double words, whose error is the u^2 term alone.
"""

from typing import TypeVar

import jax

from jaxspatial.numerics.check import refuse, require_kind
from jaxspatial.numerics.promise import Promise, promises
from jaxspatial.numerics.quantity import Additive, require_compatible
from jaxspatial.numerics.types import ArrayLike, PrecisionName
from jaxspatial.rotation.rotation import ROTATED, Rotation
from jaxspatial.spatial.transform import RigidTransform
from jaxspatial.spatial.vectors import SpatialVector, SpatialVelocity, require_pair

_Kind = TypeVar("_Kind", bound=Additive)
_Vector = TypeVar("_Vector", bound=SpatialVector)

# Error bounds, see `numerics.promise`. The parts of `cross` are one cross product, or the sum of two.
SHIFT, SHIFT_ACCELERATION = Promise(3, 4), Promise(7, 32)
DOT, CROSS_ONE, CROSS_TWO = Promise(4, 8), Promise(2, 4), Promise(3, 4)
ACT, ACT_ACCELERATION = Promise(8, 32), Promise(14, 128)
# R S R^T of a central inertia.
ROTATED_INERTIA = Promise(6, 32)


@promises(bound=SHIFT, acceleration=SHIFT_ACCELERATION)
def shift(X_P_E: _Kind, p_PQ_E: ArrayLike, w: ArrayLike | None = None, *, precision: PrecisionName = None) -> _Kind:
    """Moves a spatial quantity from point P to point Q of the same body: X_P_E -> X_Q_E.

        force         tau_Q = tau_P - p_PQ x f            f_Q = f_P
        momentum      h_Q = h_P - p_PQ x l                l_Q = l_P
        velocity      w_Q = w_P                           v_Q = v_P + w x p_PQ
        acceleration  alpha_Q = alpha_P                   a_Q = a_P + alpha x p_PQ + w x (w x p_PQ)
        inertia       com_Q = com_P - p_PQ                mass and central stay, bit for bit

    Power `dot(F, V)` is unchanged when both are shifted. To shift a batch by one shared offset, use
    `jax.vmap(shift, in_axes=(0, None))`; by one offset each, `jax.vmap(shift)`. To reuse the memory of the input,
    donate it: `jax.jit(shift, donate_argnums=0)`.

    Args:
        X_P_E: SpatialForce, SpatialMomentum, SpatialVelocity, SpatialAcceleration or SpatialInertia (*batch,) about P,
            expressed in frame E.
        p_PQ_E: (*batch, 3) position of Q from P, m, in the same frame E. Floats in a list take the dtype of X.
        w: (*batch, 3) angular velocity of the body, rad/s, in E. An acceleration needs it, all others refuse it.
        precision: name of a precision; None takes the default.

    Returns:
        The same kind about Q, in E, over the common batch. 12 flops, of an acceleration 33.

    Raises:
        TypeError: X is of another kind, dtypes differ or are not floating point, w is missing or not wanted.
        ValueError: shapes do not fit.

    Error: per component, u the unit roundoff, r the exact value, mag the sum of the absolute values of its terms: at
        most 3 u mag in "fast" and "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful"; of an
        acceleration, mag = |a| + |alpha| |p| + |w| |w| |p|, multiplied out: at most 7 u mag in "fast" and
        "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp of r in "faithful"; while nothing over- or
        underflows; plus a few finfo.tiny where subnormals are flushed (XLA CPU). NaN and infinities propagate as in the
        formula. For the edges, and for derivatives, see `jaxspatial.spatial.operations`.
    Source: Jain 2010, Robot and Multibody Dynamics, 1.4 and 1.5; Featherstone 2008, 2.11.

    Example:
        >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        >>> js.shift(F, [2.0, 0.0, 0.0])
        SpatialForce(tau=[0.0, 0.0, -1.0], f=[1.0, 2.0, 0.0])
    """
    if not isinstance(X_P_E, Additive):
        refuse("shift", "a spatial vector or inertia", X_P_E)
    return X_P_E._shift(p_PQ_E, w, precision)


@promises(bound=DOT)
def dot(F_P_E: SpatialVector, V_P_E: SpatialVector, *, precision: PrecisionName = None) -> jax.Array:
    """The pairing of a force or momentum with a velocity, in either order.

        F . V = tau . w + f . v       power
        L . V = h . w + l . v         twice the kinetic energy

    The result depends neither on the point nor on the frame.

    Args:
        F_P_E: SpatialForce or SpatialMomentum (*batch,) about P, expressed in frame E; or the velocity.
        V_P_E: SpatialVelocity (*batch,) about the same point, in the same frame; or the force or momentum.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch,), over the common batch: W of a force, J of a momentum. 11 flops.

    Raises:
        TypeError: the two are another pair of kinds, or dtypes differ.
        ValueError: batch shapes do not broadcast.

    Error: mag the sum of the absolute values of the six products: at most 4 u mag in "fast" and "reproducible", u |r| +
        8 u^2 mag in "compensated", 1 ulp of r in "faithful" (summed as written: each part from the left, then both),
        while nothing over- or underflows; plus a few finfo.tiny where subnormals are flushed. For the edges, and for
        derivatives, see `jaxspatial.spatial.operations`.
    Source: Jain 2010, Robot and Multibody Dynamics, 1.5.

    Example:
        >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        >>> V = js.SpatialVelocity(w=[0.0, 0.0, 1.0], v=[0.5, 0.0, 0.0])
        >>> print(js.dot(F, V))
        3.5
    """
    if not isinstance(F_P_E, SpatialVector):
        refuse("dot", "a SpatialForce or SpatialMomentum and a SpatialVelocity", F_P_E)
    return F_P_E._dot(V_P_E, precision)


@promises(one=CROSS_ONE, two=CROSS_TWO)
def cross(V_P_E: SpatialVelocity, X_P_E: _Vector, *, precision: PrecisionName = None) -> _Vector:
    """The rate of change of a spatial quantity that is fixed in a body with velocity V, per second.

        motion  V x V2 = (w x w2,  w x v2 + v x w2)       force  V x* F = (w x tau + v x f,  w x f)

    Power is conserved: dot(cross(V, F), V2) = -dot(F, cross(V, V2)). In all precisions but "fast" cross(V, V) is
    exactly 0, in "reproducible" cross(V, V2) is exactly -cross(V2, V).

    Args:
        V_P_E: SpatialVelocity (*batch,) about P, expressed in frame E.
        X_P_E: any of the four kinds (*batch,), about the same point, in the same frame.
        precision: name of a precision; None takes the default.

    Returns:
        The kind of X, about P, in E, over the common batch; its units per second. 30 flops.

    Raises:
        TypeError: the arguments are of other kinds, or dtypes differ.
        ValueError: batch shapes do not broadcast.

    Error: per component, mag the sum of the absolute values of the terms: of the part that is a single product at most
        2 u mag in "fast" and "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful"; of the sum
        of two at most 3 u mag in "fast" and "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in
        "faithful", while nothing over- or underflows; plus a few finfo.tiny where subnormals are flushed. For the
        edges, and for derivatives, see `jaxspatial.spatial.operations`.
    Source: Featherstone 2008, Rigid Body Dynamics Algorithms, 2.9, equations 2.31 and 2.32.

    Example:
        >>> V = js.SpatialVelocity(w=[0.0, 0.0, 1.0], v=[0.5, 0.0, 0.0])
        >>> L = js.SpatialMomentum(h=[0.0, 0.0, 0.1], l=[2.0, 0.0, 0.0])
        >>> js.cross(V, L)
        SpatialMomentum(h=[0.0, 0.0, 0.0], l=[0.0, 2.0, 0.0])
    """
    require_kind(V_P_E, SpatialVelocity, "cross", " first")
    if not isinstance(X_P_E, SpatialVector):
        refuse("cross", "one of the four spatial vectors as second", X_P_E)
    require_pair(V_P_E, X_P_E)
    return X_P_E._cross(V_P_E, precision)


@promises(bound=ROTATED, inertia=ROTATED_INERTIA)
def rotate(R_AE: Rotation, X_P_E: _Kind, *, precision: PrecisionName = None) -> _Kind:
    """Re-expresses a spatial quantity, about the same point, in another frame: X_P_E -> X_P_A. Also `R_AE @ X_P_E`.

    Each part v becomes R v, a central inertia R I R^T. Power does not change when both are rotated.

    Args:
        R_AE: Rotation (*batch,).
        X_P_E: any of the four kinds, or a SpatialInertia (*batch,), expressed in frame E.
        precision: name of a precision; None takes the default.

    Returns:
        The kind of X_P_E, about P, in A, over the common batch. 30 flops.

    Raises:
        TypeError: the arguments are of other kinds, or dtypes differ.
        ValueError: batch shapes do not broadcast.

    Error: per component, mag the sum of the absolute values of its three products: at most 3 u mag in "fast" and
        "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful"; of the nine of a central inertia
        at most 6 u mag in "fast" and "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp of r in "faithful",
        while nothing over- or underflows; plus a few finfo.tiny where subnormals are flushed.
    Source: Featherstone 2008, 2.8.

    Example:
        >>> F = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        >>> R_AE = js.Rotation.from_matrix([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        >>> js.rotate(R_AE, F)
        SpatialForce(tau=[0.0, 0.0, 3.0], f=[-2.0, 1.0, 0.0])
    """
    require_kind(R_AE, Rotation, "rotate", " first")
    if not isinstance(X_P_E, Additive):
        refuse("rotate", "a spatial vector or inertia as second", X_P_E)
    return X_P_E._rotate(R_AE, precision)


@promises(bound=ACT, acceleration=ACT_ACCELERATION)
def act(X_AB: RigidTransform, X_Bo_B: _Kind, w: ArrayLike | None = None, *, precision: PrecisionName = None) -> _Kind:
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
        "reproducible", u |r| + 32 u^2 mag in "compensated", 1 ulp of r in "faithful"; of an acceleration at most 14 u
        mag in "fast" and "reproducible", u |r| + 128 u^2 mag in "compensated", 1 ulp of r in "faithful"; while nothing
        over- or underflows. For the edges, and for derivatives, see `jaxspatial.spatial.operations`.
    Source: Featherstone 2008, 2.8; Jain 2010, 1.5.

    Example:
        >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
        >>> F_Bo_B = js.SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
        >>> js.act(X_AB, F_Bo_B)
        SpatialForce(tau=[0.0, 0.0, 7.0], f=[1.0, 2.0, 0.0])
    """
    _require_to_act("act", X_AB, X_Bo_B)
    return X_Bo_B._act(X_AB, w, precision)


def act_inverse(
    X_AB: RigidTransform, X_Ao_A: _Kind, w: ArrayLike | None = None, *, precision: PrecisionName = None
) -> _Kind:
    """Moves a spatial quantity from Ao to Bo and re-expresses it from frame A in frame B: X_Ao_A -> X_Bo_B.

        force, momentum   f_B = R^T f           tau_B = R^T (tau - p x f)
        velocity          w_B = R^T w           v_B = R^T (v + w x p)
        acceleration      alpha_B = R^T alpha   a_B = R^T (a + alpha x p + w x (w x p))
        inertia           com_B = R^T (com - p) central_B = R^T central R

    It undoes `act`, and does not form the inverse of X_AB.

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

    Example:
        >>> X_AB = js.RigidTransform(js.Rotation.identity(), [2.0, 0.0, 0.0])
        >>> F_Ao_A = js.SpatialForce(tau=[0.0, 0.0, 7.0], f=[1.0, 2.0, 0.0])
        >>> js.act_inverse(X_AB, F_Ao_A)
        SpatialForce(tau=[0.0, 0.0, 3.0], f=[1.0, 2.0, 0.0])
    """
    _require_to_act("act_inverse", X_AB, X_Ao_A)
    return X_Ao_A._act_inverse(X_AB, w, precision)


def _require_to_act(operation: str, X_AB: RigidTransform, X: Additive) -> None:
    if not isinstance(X, Additive):
        refuse(operation, "a spatial vector or inertia as second", X)
    require_kind(X_AB, RigidTransform, operation, " first")
    require_compatible(RigidTransform=X_AB, **{type(X).__name__: X})
