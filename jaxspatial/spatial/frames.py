"""Spatial vectors under rigid transforms: moved and re-expressed at once; and under rotations."""

from collections.abc import Callable
from typing import Any

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Numbers, Three
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.types import PrecisionName, Vector3
from jaxspatial.rotation.rotation import Rotation, rotated_together
from jaxspatial.spatial import algebra
from jaxspatial.spatial.acceleration import SpatialAcceleration
from jaxspatial.spatial.arguments import require_kind, require_no_w, require_w
from jaxspatial.spatial.force import SpatialForce, SpatialMomentum
from jaxspatial.spatial.operations import acting, rotating
from jaxspatial.spatial.transform import RigidTransform
from jaxspatial.spatial.vector import SpatialVector
from jaxspatial.spatial.velocity import SpatialVelocity


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
    """The formula over the transform and the arrays of a spatial vector, with what they have in common checked."""
    require_kind(X_AB, RigidTransform, "act", " first")
    require_alike(RigidTransform=X_AB, **{type(vector).__name__: vector})
    return formula(precision, X_AB.rotation.entries, X_AB.translation, *arrays)


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
