"""What all spatial vectors have: their parts, by name, by place and in print."""

import operator

import jax
import numpy as np
import pytest

import jaxspatial as js

KINDS = pytest.mark.parametrize(
    "kind", [js.SpatialForce, js.SpatialVelocity, js.SpatialAcceleration, js.SpatialMomentum]
)
SIX = np.arange(1.0, 7.0, dtype=np.float32)


@KINDS
def test_the_rotational_part_is_the_first(kind):
    x = kind(SIX[:3], SIX[3:])
    np.testing.assert_array_equal(x.rotational, SIX[:3])
    np.testing.assert_array_equal(x.translational, SIX[3:])
    np.testing.assert_array_equal(x.to_array(), SIX)
    assert [float(x[i]) for i in range(-6, 6)] == [*SIX, *SIX]
    for i in (-7, 6):
        with pytest.raises(IndexError, match=f"expected a component index from -6 to 5, got {i}"):
            x[i]


@KINDS
def test_zero_in_a_sum_is_that_of_python_only(kind):
    x = kind(SIX[:3], SIX[3:])
    np.testing.assert_array_equal((0 + x).to_array(), SIX)
    np.testing.assert_array_equal(sum([x, x]).to_array(), 2 * SIX)
    for other in (1, 0.0):
        with pytest.raises(TypeError, match="expected two of one kind"):
            operator.add(other, x)


def test_one_vector_shows_its_numbers_and_a_batch_its_shape():
    x = js.SpatialForce(SIX[:3], SIX[3:])
    assert repr(x) == "SpatialForce(tau=[1.0, 2.0, 3.0], f=[4.0, 5.0, 6.0])"
    assert repr(js.stack([x, x])) == "SpatialForce(tau=float32[2,3], f=float32[2,3])"
    shown = []
    jax.jit(lambda x: shown.append(repr(x)))(x)
    assert shown == ["SpatialForce(tau=float32[3], f=float32[3])"]
