"""Angles in every quadrant, and roll, pitch and yaw where two of them are one."""

import functools
import math

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.precision import Precision
from jaxspatial.rotation import quaternion
from tests.helpers.interpreted import interpreted

U = 2.0**-24
_angle_of = formula(lambda x: (quaternion.angle_of(*x),))
DIRECTIONS = [(s, c) for s in (-1.0, -0.25, 0.0, 0.75, 1.0) for c in (-1.0, -0.5, 0.0, 0.25, 1.0)]


@pytest.mark.parametrize("size", [1.0, 2.0**-100, 2.0**100])
def test_of_any_quadrant_and_length(size):
    """0 for (0, 0), of which the arc tangent of C says the same."""
    x = np.array(DIRECTIONS, np.float32) * np.float32(size)
    expected = [math.atan2(s, c) for s, c in DIRECTIONS]
    found = interpreted(functools.partial(_angle_of, Precision.REPRODUCIBLE))(x)
    np.testing.assert_allclose(found[:, 0], expected, rtol=8 * U)


@pytest.mark.parametrize("side", [1, -1])
def test_roll_and_yaw_at_a_right_angle_of_pitch(side):
    """Upright only one of their sum and difference has a meaning: it is kept, and nothing is NaN, slopes neither."""
    R = js.Rotation.from_matrix(np.array([[0, 0, side], [0, 1, 0], [-side, 0, 0]], np.float32))
    of = interpreted(js.Rotation.to_roll_pitch_yaw)
    np.testing.assert_allclose(of(R), [0, side * np.pi / 2, 0], atol=4 * U)
    slopes = interpreted(jax.jacfwd(lambda e: js.Rotation(e).to_roll_pitch_yaw()))(np.asarray(R.entries))
    assert np.isfinite(slopes).all()
    roll, pitch, yaw = of(interpreted(lambda R: R @ js.Rotation.about_x(np.float32(0.5)))(R))
    np.testing.assert_allclose(roll - side * yaw, 0.5, rtol=16 * U)
    np.testing.assert_allclose(pitch, side * np.pi / 2, rtol=1e-3)
