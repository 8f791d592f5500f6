"""The operations on spatial vectors, as one generic function each.

They dispatch on the type of the first argument; every kind registers what it means for it. What stands here is the
answer to all other types.

What the error bounds of all of them mean. u is the unit roundoff of the inputs' dtype, r the exact component, mag the
sum of the absolute values of its terms, multiplied out.
- Bounds hold while nothing over- or underflows. In precision "compensated" and "faithful" that is: while r does not,
  for float16, bfloat16 and float32, which are evaluated in float64. In "faithful" float64 no overflow on the way
  matters either, but of products of three factors; in sums over a batch, and in pull-backs to what it shares, neither.
  Otherwise an overflow of an intermediate gives what IEEE 754 gives for the formula as it is written.
- Where subnormals are flushed to zero (XLA CPU) a few finfo.tiny are added; and a subnormal number that is given (but
  for float16, whose are numbers as all others) counts as 0, in all precisions, whatever it is multiplied by. In float64
  that means in "compensated" and "faithful": bounds hold while no factor, and no product of some or all factors of a
  term, but 0 is below 2^-960. Below, errors are at most 7 u mag for terms of two factors; one of more may be lost
  altogether where a product of some of its factors underflows, in whatever order the formula has them.
- In float64 a factor above (1 - 2^-27) finfo.max makes of "compensated" the precision "fast".
- NaN and infinities go where the formula takes them (an acceleration's, multiplied out); an r beyond finfo.max becomes
  an infinity.
- Derivatives of every order keep the bounds of "compensated" and "faithful" in each of their components, pull-backs of
  an item that a batch shares too. In the other two they are sums of products rounded one by one.
- Double words in place of arrays (`js.to_double_word`) are evaluated as in "compensated", or "faithful" where that is
  asked for, but not rounded at the end: results are double words, and of the errors the u^2 term alone is left.
"""

import functools
from typing import Any, TypeVar

from jaxspatial.arithmetic.quantity import Quantity
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.rotation.rotation import Rotation
from jaxspatial.spatial.arguments import refuse, require_kind

_Kind = TypeVar("_Kind", bound=Quantity)


@functools.singledispatch
def shift(X_P_E: Quantity, p_PQ_E: Vector3, w: Vector3 | None = None, *, precision: PrecisionName = None) -> Any:
    """Moves a spatial quantity from point P to point Q of the same body: X_P_E -> X_Q_E.

        force         tau_Q = tau_P - p_PQ x f            f_Q = f_P
        momentum      h_Q = h_P - p_PQ x l                l_Q = l_P
        velocity      w_Q = w_P                           v_Q = v_P + w x p_PQ
        acceleration  alpha_Q = alpha_P                   a_Q = a_P + alpha x p_PQ + w x (w x p_PQ)
        inertia       com_Q = com_P - p_PQ                mass and central stay, bit for bit

    Power `dot(F, V)` is unchanged when both are shifted. A batch against one shared offset is
    `jax.vmap(shift, in_axes=(0, None))`, one offset each `jax.vmap(shift)`. In place:
    `jax.jit(shift, donate_argnums=0)`.

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

    Error: per component, u the unit roundoff, r the exact value, mag the sum of the absolute values of its terms, for
        force, momentum and velocity, in brackets for acceleration (mag: |a| + |alpha| |p| + |w| |w| |p|, multiplied
        out):

            fast, reproducible   3 u mag [7 u mag]
            compensated          u |r| + 4 u^2 mag [32 u^2 mag]
            faithful             1 ulp of r

        while nothing over- or underflows; plus a few finfo.tiny where subnormals are flushed (XLA CPU). NaN and
        infinities go where the formula takes them. For the edges, and for derivatives, see
        `jaxspatial.spatial.operations`.
    Source: Jain 2010, Robot and Multibody Dynamics, 1.4 and 1.5; Featherstone 2008, 2.11.
    """
    refuse("shift", "a SpatialForce, SpatialMomentum, SpatialVelocity or SpatialAcceleration", X_P_E)


@functools.singledispatch
def dot(F_P_E: Quantity, V_P_E: Quantity, *, precision: PrecisionName = None) -> Any:
    """The pairing of a force or momentum with a velocity, in either order.

        F . V = tau . w + f . v       power
        L . V = h . w + l . v         twice the kinetic energy

    It changes neither with the point nor with the frame.

    Args:
        F_P_E: SpatialForce or SpatialMomentum (*batch,) about P, expressed in frame E; or the velocity.
        V_P_E: SpatialVelocity (*batch,) about the same point, in the same frame; or the force or momentum.
        precision: name of a precision; None takes the default.

    Returns:
        (*batch,), over the common batch: W of a force, J of a momentum. 11 flops.

    Raises:
        TypeError: the two are another pair of kinds, or dtypes differ.
        ValueError: batch shapes do not broadcast.

    Error: mag the sum of the absolute values of the six products: at most 4 u mag in "fast" and "reproducible" (summed
        as written: each part from the left, then both), u |r| + 8 u^2 mag in "compensated", 1 ulp of r in "faithful",
        while nothing over- or underflows; plus a few finfo.tiny where subnormals are flushed. For the edges, and for
        derivatives, see `jaxspatial.spatial.operations`.
    Source: Jain 2010, Robot and Multibody Dynamics, 1.5.
    """
    refuse("dot", "a SpatialForce or SpatialMomentum and a SpatialVelocity", F_P_E)


@functools.singledispatch
def cross(V_P_E: Quantity, X_P_E: Quantity, *, precision: PrecisionName = None) -> Any:
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

    Error: per component, mag the sum of the absolute values of the terms: in "fast" and "reproducible" at most 2 u mag
        for the single product, 3 u mag for the sum of two, u |r| + 4 u^2 mag in "compensated", 1 ulp of r in
        "faithful", while nothing over- or underflows; plus a few finfo.tiny where subnormals are flushed. For the
        edges, and for derivatives, see `jaxspatial.spatial.operations`.
    Source: Featherstone 2008, Rigid Body Dynamics Algorithms, 2.9, equations 2.31 and 2.32.
    """
    refuse("cross", "a SpatialVelocity first", V_P_E)


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

    Error: per component, mag the sum of the absolute values of its three products, or nine, in brackets for a central
        inertia: at most 3 u mag [6 u mag] in "fast" and "reproducible", u |r| + 4 u^2 mag [32 u^2 mag] in
        "compensated", 1 ulp in "faithful", while nothing over- or underflows; plus a few finfo.tiny where subnormals
        are flushed.
    Source: Featherstone 2008, 2.8.
    """
    require_kind(R_AE, Rotation, "rotate", " first")
    return rotating(X_P_E, R_AE, precision)


@functools.singledispatch
def rotating(X_P_E: Quantity, R_AE: Rotation, precision: PrecisionName) -> Any:
    """`rotate`, dispatched on what is rotated."""
    refuse("rotate", "one of the four spatial vectors as second", X_P_E)
