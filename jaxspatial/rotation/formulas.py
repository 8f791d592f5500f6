"""The formulas of `Rotation` over arrays: one for each constructor and conversion, in the precision asked for."""

from typing import Any

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.rotation import angles, directions, exponential, quaternion


def over_arrays(formula: Any, precision: PrecisionName, static: dict[str, Any] | None = None, **arrays: Any) -> Any:
    """The formula over arrays of one dtype, with batches that broadcast; messages use their names."""
    check.require_same_dtype(**arrays)
    check.common_batch_shape(**{name: a.shape[:-1] for name, a in arrays.items()})
    return formula(precision, *arrays.values(), **(static or {}))


@formula
def nearest(entries):
    return vectors.flat(directions.nearest(vectors.rows(entries)))


@formula
def from_quaternion(q):
    return vectors.flat(quaternion.to_matrix(vectors.unit(q)))


@formula
def to_quaternion(entries):
    return quaternion.from_matrix(vectors.rows(entries))


@formula
def exp(w):
    return vectors.flat(exponential.rotation(w))


@formula
def log(entries):
    return exponential.rotation_vector(vectors.rows(entries))


@formula
def about(angle, axis):
    return vectors.flat(angles.about(axis, *angle))


@formula
def from_axis_angle(axis, angle):
    return vectors.flat(quaternion.to_matrix(angles.about_axis(axis, *angle)))


@formula
def to_axis_angle(entries):
    return list(angles.axis_angle(quaternion.from_matrix(vectors.rows(entries))))


@formula
def from_roll_pitch_yaw(rpy):
    return vectors.flat(quaternion.to_matrix(angles.from_roll_pitch_yaw(*rpy)))


@formula
def to_roll_pitch_yaw(entries):
    return angles.roll_pitch_yaw(quaternion.from_matrix(vectors.rows(entries)))


@formula
def from_one_vector(u, axis):
    return vectors.flat(directions.from_one_vector(u, axis))


@formula
def from_two_vectors(u, v, axes):
    return vectors.flat(directions.from_two_vectors(u, v, axes))


@formula
def between(a, b):
    return vectors.flat(quaternion.to_matrix(directions.between(a, b)))


@formula
def interpolated(start, end, t):
    start, end = vectors.rows(start), vectors.rows(end)
    w = exponential.rotation_vector(vectors.matrix_product(vectors.transpose(start), end))
    return vectors.flat(vectors.matrix_product(start, exponential.rotation(vectors.times(*t, w))))


@formula
def left_jacobian(w):
    return vectors.flat(exponential.left_jacobian(w))


@formula
def left_jacobian_inverse(w):
    return vectors.flat(exponential.left_jacobian_inverse(w))
