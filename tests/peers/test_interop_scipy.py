"""To and from SciPy's Rotation and RigidTransform, batched, in float64, in both directions. U = 2^-53."""

import jax
import numpy as np
import pytest
from scipy.spatial import transform

import jaxspatial as js
from jaxspatial import interop

U = 2.0**-53


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def rotation_vectors():
    """Of all sizes up to pi, and structured ones."""
    rng = np.random.default_rng(0)
    spread = rng.normal(size=(200, 3)) * np.exp2(rng.integers(-40, 1, (200, 1)))
    axes = np.concatenate([angle * np.eye(3) for angle in (0, 1e-8, np.pi / 2, 2, 3.14)])
    return np.concatenate([spread, axes])


def test_rotation_both_ways_and_what_it_does():
    w = rotation_vectors()
    theirs = transform.Rotation.from_rotvec(w)
    ours = interop.scipy.from_rotation(theirs)
    np.testing.assert_allclose(ours.to_matrix(), theirs.as_matrix(), rtol=0, atol=8 * U)
    back = interop.scipy.to_rotation(ours)
    np.testing.assert_allclose((back * theirs.inv()).magnitude(), 0, atol=16 * U)
    np.testing.assert_allclose(back.as_rotvec(), ours.log(), rtol=16 * U, atol=16 * U)
    v = np.random.default_rng(1).normal(size=w.shape)
    np.testing.assert_allclose(np.asarray(ours @ v), theirs.apply(v), rtol=0, atol=64 * U)


def test_one_rotation():
    R = js.Rotation.exp(np.array([0.1, 0.2, 0.3], np.float32))
    theirs = interop.scipy.to_rotation(R)
    assert theirs.as_quat().shape == (4,)
    np.testing.assert_allclose(theirs.as_matrix(), R.to_matrix(), rtol=0, atol=8 * 2.0**-24)
    np.testing.assert_allclose(interop.scipy.from_rotation(theirs).to_matrix(), theirs.as_matrix(), rtol=0, atol=8 * U)


@pytest.mark.skipif(not hasattr(transform, "RigidTransform"), reason="SciPy before 1.16")
def test_rigid_transform_both_ways_and_what_it_does():
    rng = np.random.default_rng(2)
    w = rotation_vectors()
    V = js.SpatialVelocity(w, rng.normal(size=w.shape))
    theirs = transform.RigidTransform.from_exp_coords(np.array(V.to_array()))
    ours = interop.scipy.from_rigid_transform(theirs)
    np.testing.assert_allclose(ours.to_matrix(), theirs.as_matrix(), rtol=0, atol=8 * U)
    back = interop.scipy.to_rigid_transform(ours)
    np.testing.assert_allclose(back.as_matrix(), ours.to_matrix(), rtol=0, atol=8 * U)
    p = rng.normal(size=w.shape)
    np.testing.assert_allclose(np.asarray(ours @ p), theirs.apply(p), rtol=0, atol=64 * U)
    # SciPy's series near angle 0 sets the tolerance.
    np.testing.assert_allclose(js.RigidTransform.exp(V).to_matrix(), theirs.as_matrix(), rtol=0, atol=1e-11)
    again = js.SpatialVelocity.from_array(theirs.as_exp_coords())
    np.testing.assert_allclose(again.to_array(), V.to_array(), rtol=0, atol=1e-9)
