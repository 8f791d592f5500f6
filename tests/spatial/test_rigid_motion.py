"""Rigid motions from pose to pose, and what constructors say of wrong arguments."""

import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

N, EPS = 24, float(np.finfo(np.float32).eps)


def _poses(seed):
    w, p = np.random.default_rng(seed).standard_normal((2, N, 3)).astype(np.float32)
    return js.RigidTransform(interpreted(js.Rotation.exp)(w), p)


def _assert_near(X, Y, tolerance):
    np.testing.assert_allclose(np.asarray(X.to_matrix()), np.asarray(Y.to_matrix()), rtol=0, atol=tolerance)


def test_interpolation_is_the_screw_from_pose_to_pose():
    X, Y = _poses(0), _poses(1)
    t = np.tile(np.float32([0.0, 1.0, 0.5, -0.25, 1.5, 0.1]), N // 6)
    interpolated = interpreted(js.RigidTransform.interpolate)
    screw = interpreted(lambda X, Y, t: X @ js.RigidTransform.exp((X.inverse() @ Y).log() * t))(X, Y, t)
    _assert_near(interpolated(X, Y, t), screw, 200 * EPS)
    _assert_near(interpolated(X, Y, np.ones(N, np.float32)), Y, 32 * EPS)
    _assert_near(interpolated(X, Y, np.zeros(N, np.float32)), X, 8 * EPS)


def test_inverse_and_inverse_times_undo():
    def undone(X, Y):
        again = js.RigidTransform.from_matrix(X.to_matrix())
        return X.inverse() @ X, X.inverse_times(X @ Y), js.RigidTransform.exp(X.log()), again

    X, Y = _poses(2), _poses(3)
    nothing, second, of_log, again = interpreted(undone)(X, Y)
    _assert_near(nothing, js.RigidTransform.identity((N,), np.float32), 8 * EPS)
    _assert_near(second, Y, 16 * EPS)
    _assert_near(of_log, X, 16 * EPS)
    assert np.asarray(again.to_matrix()).tolist() == np.asarray(X.to_matrix()).tolist()


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: js.Rotation.from_quaternion(np.ones(3)), ValueError, "wxyz: expected shape (*batch, 4), got (3,)"),
        (lambda: js.Rotation.from_matrix(np.ones((2, 3))), ValueError, "m: expected shape (*batch, 3, 3), got (2, 3)"),
        (lambda: js.Rotation.from_one_vector([1, 1, 1], 3), ValueError, "expected axis 0, 1 or 2, got 3"),
        (lambda: js.RigidTransform.exp(np.ones(6)), TypeError, "expected a SpatialVelocity"),
        (lambda: js.RigidTransform(np.eye(3), np.ones(3)), TypeError, "rotation: expected a Rotation"),
        (lambda: js.act(js.Rotation.identity(), js.SpatialForce.zero()), TypeError, "expected a RigidTransform"),
        (lambda: js.act(_poses(0), np.ones(6)), TypeError, "act: expected a spatial vector or inertia"),
        (lambda: js.act(_poses(0), js.SpatialAcceleration.zero(dtype="float32")), TypeError, "act: expected w"),
    ],
    ids=range(8),
)
def test_messages_name_what_was_expected(call, kind, words):
    with pytest.raises(kind) as error:
        call()
    assert words in str(error.value)
