"""The formulas of `Rotation` over arrays: one for each constructor and conversion, in the precision asked for."""

from collections.abc import Callable
from typing import Any

import jax

from jaxspatial.arithmetic import check, vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Numbers, Three
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.rotation import angles, directions, exponential, quaternion


def over_arrays(formula: Callable[..., Any], precision: PrecisionName, **arrays: jax.Array) -> Any:
    """The formula over arrays of one dtype, with batches that broadcast; messages use their names."""
    check.require_same_dtype(**arrays)
    check.common_batch_shape(**{name: a.shape[:-1] for name, a in arrays.items()})
    return formula(precision, *arrays.values())


@formula
def nearest(entries: Numbers) -> Numbers:
    return vectors.flat(directions.nearest(vectors.rows(entries)))


@formula
def from_quaternion(q: Numbers) -> Numbers:
    return vectors.flat(quaternion.to_matrix(vectors.unit(q)))


@formula
def to_quaternion(entries: Numbers) -> Numbers:
    return quaternion.from_matrix(vectors.rows(entries))


@formula
def exp(w: Three) -> Numbers:
    return vectors.flat(exponential.rotation(w))


@formula
def log(entries: Numbers) -> Three:
    return exponential.rotation_vector(vectors.rows(entries))


@formula
def about(angle: Numbers, axis: int) -> Numbers:
    return vectors.flat(angles.about(axis, angle[0]))


@formula
def from_axis_angle(axis: Three, angle: Numbers) -> Numbers:
    return vectors.flat(quaternion.to_matrix(angles.about_axis(axis, angle[0])))


@formula
def to_axis_angle(entries: Numbers) -> list[Three | Number]:
    return list(angles.axis_angle(quaternion.from_matrix(vectors.rows(entries))))


@formula
def from_roll_pitch_yaw(rpy: Three) -> Numbers:
    return vectors.flat(quaternion.to_matrix(angles.from_roll_pitch_yaw(*rpy)))


@formula
def to_roll_pitch_yaw(entries: Numbers) -> Three:
    return angles.roll_pitch_yaw(quaternion.from_matrix(vectors.rows(entries)))


@formula
def from_one_vector(u: Three, axis: int) -> Numbers:
    return vectors.flat(directions.from_one_vector(u, axis))


@formula
def from_two_vectors(u: Three, v: Three, axes: tuple[int, int]) -> Numbers:
    return vectors.flat(directions.from_two_vectors(u, v, axes))


@formula
def between(a: Three, b: Three) -> Numbers:
    return vectors.flat(quaternion.to_matrix(directions.between(a, b)))


@formula
def interpolated(start: Numbers, end: Numbers, t: Numbers) -> Numbers:
    a, b = vectors.rows(start), vectors.rows(end)
    w = exponential.rotation_vector(vectors.matrix_product(vectors.transpose(a), b))
    return vectors.flat(vectors.matrix_product(a, exponential.rotation(vectors.times(t[0], w))))


@formula
def left_jacobian(w: Three) -> Numbers:
    return vectors.flat(exponential.left_jacobian(w))


@formula
def left_jacobian_inverse(w: Three) -> Numbers:
    return vectors.flat(exponential.left_jacobian_inverse(w))
