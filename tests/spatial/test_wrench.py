"""Wrenches and points, in numbers that one checks by hand: where the axis is, where a plane is pressed, and signs."""

import numpy as np
import pytest

import jaxspatial as js

# Small integers and powers of two: every result is exact, in every precision.
ARM, PITCH = np.array([1.0, 2.0, 0.0], np.float32), 0.5
precisions = pytest.mark.parametrize("precision", js.Precision)


def screw(axis, force, pitch):
    """The wrench about the origin of a force along a line through a point, and a couple about it."""
    return js.SpatialForce(np.cross(axis, force) + np.float32(pitch) * force, force)


@precisions
@pytest.mark.parametrize("size", [4.0, -4.0, 2.0**-90, 2.0**90])
def test_the_central_axis_is_where_the_force_acts(size, precision):
    """Upwards at (1, 2, 0), turning about itself: the arm points to the line, and the pitch has the torque's side."""
    F = screw(ARM, np.array([0, 0, size], np.float32), PITCH)
    axis = js.central_axis(F, precision=precision)
    np.testing.assert_array_equal(axis.point, ARM)
    np.testing.assert_array_equal(axis.pitch, np.float32(PITCH))
    np.testing.assert_array_equal(js.central_axis(screw(ARM, F.f, -PITCH), precision=precision).pitch, -PITCH)


def test_about_a_point_of_the_axis_the_torque_is_along_the_force():
    tau, f = np.random.default_rng(0).standard_normal((2, 3)).astype(np.float32)
    F = js.SpatialForce(tau, f)
    axis = js.central_axis(F)
    np.testing.assert_allclose(js.shift(F, axis.point).tau, axis.pitch * f, atol=1e-6)
    assert abs(axis.point @ f) < 1e-6


def test_a_couple_has_no_axis():
    axis = js.central_axis(js.SpatialForce(ARM, np.zeros(3, np.float32)))
    assert np.isinf(axis.pitch) and np.isnan(axis.point).all()
    assert np.isnan(js.central_axis(js.SpatialForce.zero()).pitch)


@precisions
@pytest.mark.parametrize(("normal", "arm"), [((0, 0, 1), (1, 2, 0)), ((0, 0, -2), (1, 2, 0)), ((4, 0, 0), (0, 1, 2))])
def test_the_plane_is_pressed_where_the_force_acts(normal, arm, precision):
    """Whichever side its normal is on, however long; friction and a couple about the normal move nothing."""
    normal, arm = np.array(normal, np.float32), np.array(arm, np.float32)
    force = np.array([2, 0.5, 1], np.float32)
    F = js.SpatialForce(np.cross(arm, force) + 8 * normal, force)
    np.testing.assert_array_equal(js.center_of_pressure(F, normal, precision=precision), arm)


def test_the_usual_normal_is_z():
    F = js.SpatialForce(np.array([6.0, -3.0, 5.0], np.float32), np.array([0, 0, 3.0], np.float32))
    np.testing.assert_array_equal(js.center_of_pressure(F), ARM)


@precisions
def test_feet_press_between_them(precision):
    """Two forces at points: their wrench is pressed at the mean of the points, weighted with the forces."""
    points = np.array([[0, 0, 0], [4, 8, 0]], np.float32)
    forces = np.array([[0, 0, 3], [0, 0, 1]], np.float32)
    F = js.wrench_from_point_forces(points, forces, precision=precision)
    np.testing.assert_array_equal(F.tau, [8, -4, 0])
    np.testing.assert_array_equal(F.f, [0, 0, 4])
    np.testing.assert_array_equal(js.center_of_pressure(F, precision=precision), ARM)
