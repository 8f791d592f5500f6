"""Where motion meets force: power, kinetic energy, and the two cross products."""

import jax

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Three
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.spatial import algebra
from jaxspatial.spatial.acceleration import SpatialAcceleration
from jaxspatial.spatial.arguments import require_kind
from jaxspatial.spatial.force import SpatialForce, SpatialMomentum
from jaxspatial.spatial.operations import cross, dot
from jaxspatial.spatial.vector import SpatialVector
from jaxspatial.spatial.velocity import SpatialVelocity

_FORCES = (SpatialForce, SpatialMomentum)
_MOTIONS = (SpatialVelocity, SpatialAcceleration)


@dot.register
def _dot_force(
    F_P_E: SpatialForce | SpatialMomentum, V_P_E: SpatialVelocity, *, precision: PrecisionName = None
) -> jax.Array:
    require_kind(V_P_E, SpatialVelocity, "dot", f" beside a {_kind(F_P_E)}")
    return _dot(precision, *_parts(F_P_E, V_P_E))


@dot.register
def _dot_velocity(V_P_E: SpatialVelocity, F_P_E: object, *, precision: PrecisionName = None) -> jax.Array:
    if not isinstance(F_P_E, _FORCES):
        raise TypeError(f"dot: expected a SpatialForce or SpatialMomentum beside a velocity, got {_kind(F_P_E)}")
    return dot(F_P_E, V_P_E, precision=precision)


@cross.register
def _cross_velocity(V_P_E: SpatialVelocity, X_P_E: object, *, precision: PrecisionName = None) -> SpatialVector:
    if not isinstance(X_P_E, _MOTIONS + _FORCES):
        raise TypeError(f"cross: expected one of the four spatial vectors as second, got {_kind(X_P_E)}")
    product = _cross_motion if isinstance(X_P_E, _MOTIONS) else _cross_force
    return X_P_E.with_vectors(product(precision, *_parts(V_P_E, X_P_E)))


def _kind(x: object) -> str:
    return type(x).__name__


def _parts(a: SpatialVector, b: SpatialVector) -> tuple[jax.Array, ...]:
    """The parts of a and b, of one dtype, with batches that broadcast."""
    check.require_same_dtype(**{_kind(a): a, _kind(b): b} if type(a) is not type(b) else {"first": a, "second": b})
    check.common_batch_shape(first=a.batch_shape, second=b.batch_shape)
    return *a.vectors, *b.vectors


@formula(of_sums=True)
def _dot(tau: Three, f: Three, w: Three, v: Three) -> Number:
    return algebra.power((tau, f), (w, v))


@formula(of_sums=True)
def _cross_motion(w: Three, v: Three, x: Three, y: Three) -> list[Three]:
    return [vectors.laid_out_as(*each) for each in zip((x, y), algebra.motion_cross((w, v), (x, y)), strict=True)]


@formula(of_sums=True)
def _cross_force(w: Three, v: Three, tau: Three, f: Three) -> list[Three]:
    return [vectors.laid_out_as(*each) for each in zip((tau, f), algebra.force_cross((w, v), (tau, f)), strict=True)]
