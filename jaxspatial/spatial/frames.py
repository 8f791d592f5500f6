"""Spatial vectors under rigid transforms: moved and re-expressed at once."""

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.spatial import algebra
from jaxspatial.spatial.acceleration import SpatialAcceleration
from jaxspatial.spatial.arguments import require_no_w, require_w
from jaxspatial.spatial.force import SpatialForce, SpatialMomentum
from jaxspatial.spatial.operations import acting, acting_inverse
from jaxspatial.spatial.transform import require_transform
from jaxspatial.spatial.velocity import SpatialVelocity


@acting.register(SpatialForce)
@acting.register(SpatialMomentum)
def _act_force(F_Bo_B, X_AB, w, precision):
    require_no_w(F_Bo_B, w, "act")
    f, tau = _pair(_moved_pair, precision, X_AB, F_Bo_B, *reversed(F_Bo_B.vectors))
    return F_Bo_B.with_vectors((tau, f))


@acting_inverse.register(SpatialForce)
@acting_inverse.register(SpatialMomentum)
def _act_inverse_force(F_Ao_A, X_AB, w, precision):
    require_no_w(F_Ao_A, w, "act_inverse")
    f, tau = _pair(_pair_moved_back, precision, X_AB, F_Ao_A, *reversed(F_Ao_A.vectors))
    return F_Ao_A.with_vectors((tau, f))


@acting.register
def _act_velocity(V_Bo_B: SpatialVelocity, X_AB, w, precision):
    require_no_w(V_Bo_B, w, "act")
    return V_Bo_B.with_vectors(_pair(_moved_pair, precision, X_AB, V_Bo_B, *V_Bo_B.vectors))


@acting_inverse.register
def _act_inverse_velocity(V_Ao_A: SpatialVelocity, X_AB, w, precision):
    require_no_w(V_Ao_A, w, "act_inverse")
    return V_Ao_A.with_vectors(_pair(_pair_moved_back, precision, X_AB, V_Ao_A, *V_Ao_A.vectors))


@acting.register
def _act_acceleration(A_Bo_B: SpatialAcceleration, X_AB, w, precision):
    w = require_w(A_Bo_B, w, "act")
    return A_Bo_B.with_vectors(_pair(_moved_acceleration, precision, X_AB, A_Bo_B, w, *A_Bo_B.vectors))


@acting_inverse.register
def _act_inverse_acceleration(A_Ao_A: SpatialAcceleration, X_AB, w, precision):
    w = require_w(A_Ao_A, w, "act_inverse")
    return A_Ao_A.with_vectors(_pair(_acceleration_moved_back, precision, X_AB, A_Ao_A, w, *A_Ao_A.vectors))


def _pair(formula, precision, X_AB, vector, *arrays):
    """The formula over the transform and the arrays of a spatial vector, with what they have in common checked."""
    require_transform(X_AB)
    check.require_same_dtype(RigidTransform=X_AB, **{type(vector).__name__: vector})
    check.common_batch_shape(RigidTransform=X_AB.batch_shape, **{type(vector).__name__: vector.batch_shape})
    return formula(precision, X_AB.rotation.entries, X_AB.translation, *arrays)


def _formula_of_pairs(law):
    """Of a law (rows, p, ..., x, y) that gives a pair, in the layout of x and y."""

    @formula(of_sums=True)
    def found(entries, p, *arrays):
        pairs = zip(arrays[-2:], law(vectors.rows(entries), p, *arrays), strict=True)
        return [vectors.laid_out_as(*pair) for pair in pairs]

    return found


_moved_pair, _pair_moved_back = map(_formula_of_pairs, (algebra.act, algebra.act_inverse))
_moved_acceleration = _formula_of_pairs(algebra.act_on_acceleration)
_acceleration_moved_back = _formula_of_pairs(algebra.act_inverse_on_acceleration)
