"""The formulas of `Rotation` over arrays: one for each constructor and conversion, in the precision asked for."""

import functools
from collections.abc import Callable
from typing import Any

import jax

from jaxspatial.arithmetic import vectors
from jaxspatial.arithmetic.formula import formula
from jaxspatial.arithmetic.numbers import Number, Numbers, Rows, Three
from jaxspatial.arithmetic.quantity import require_alike
from jaxspatial.arithmetic.types import PrecisionName
from jaxspatial.rotation import angles, directions, exponential, quaternion


def over_arrays(formula: Callable[..., Any], precision: PrecisionName, **arrays: jax.Array) -> Any:
    """The formula over arrays of one dtype, with batches that broadcast; messages use their names."""
    require_alike(**arrays)
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
def between(a: Three, b: Three) -> Numbers:
    return vectors.flat(quaternion.to_matrix(directions.between(a, b)))


@formula
def interpolated(start: Numbers, end: Numbers, t: Numbers) -> Numbers:
    a, b = vectors.rows(start), vectors.rows(end)
    w = exponential.rotation_vector(vectors.matrix_product(vectors.transpose(a), b))
    return vectors.flat(vectors.matrix_product(a, exponential.rotation(vectors.times(t[0], w))))


def _of_entries(function: Callable[..., Rows]) -> Callable[..., Any]:
    """The formula that gives the entries of a matrix by its rows."""
    return formula(functools.wraps(function)(lambda *numbers, **static: vectors.flat(function(*numbers, **static))))


exp = _of_entries(exponential.rotation)
left_jacobian, left_jacobian_inverse = map(_of_entries, (exponential.left_jacobian, exponential.left_jacobian_inverse))
from_one_vector, from_two_vectors = map(_of_entries, (directions.from_one_vector, directions.from_two_vectors))
