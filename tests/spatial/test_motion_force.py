"""Where motion meets force: power and products, in numbers that one checks by hand."""

import numpy as np
import pytest

import jaxspatial as js

A, B, C, D = np.array([[1, 2, 3], [-1, 0, 2], [4, -2, 1], [0, 3, -1]], np.float32)
POWER = A @ C + B @ D


@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum])
def test_power_from_either_side(kind):
    X, V = kind(A, B), js.SpatialVelocity(C, D)
    assert js.dot(X, V) == js.dot(V, X) == X.dot(V) == V.dot(X) == POWER


@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum])
def test_a_force_is_carried_by_a_motion(kind):
    """V x* F = (w x tau + v x f, w x f)."""
    found = js.cross(js.SpatialVelocity(C, D), kind(A, B))
    np.testing.assert_array_equal(found.rotational, np.cross(C, A) + np.cross(D, B))
    np.testing.assert_array_equal(found.translational, np.cross(C, B))


@pytest.mark.parametrize("kind", [js.SpatialVelocity, js.SpatialAcceleration])
def test_a_motion_is_carried_by_a_motion(kind):
    """V x W = (w x w', w x v' + v x w')."""
    found = js.cross(js.SpatialVelocity(C, D), kind(A, B))
    np.testing.assert_array_equal(found.rotational, np.cross(C, A))
    np.testing.assert_array_equal(found.translational, np.cross(C, B) + np.cross(D, A))
