"""Rotations do to vectors what their matrices do; bounds and transformations: see the table of operations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted

EPS = float(np.finfo(np.float32).eps)


def _rotations(count, dtype=np.float32):
    """Orthogonal matrices with determinant 1, but for rounding."""
    q, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((count, 3, 3)))
    return (q * np.linalg.det(q)[:, None, None]).astype(dtype)


def _vectors(count):
    return np.random.default_rng(1).standard_normal((count, 3)).astype(np.float32)


def test_matrix_vector_and_matrix_matrix(x64):
    m, v = _rotations(4), _vectors(4)
    R = js.Rotation.from_matrix(m)
    np.testing.assert_array_equal(R.to_matrix(), m)
    np.testing.assert_allclose(np.asarray(R @ v), np.einsum("nij,nj->ni", m, v), atol=1e-6, strict=True)
    product = R @ js.Rotation.from_matrix(m[::-1].copy())
    np.testing.assert_allclose(np.asarray(product.to_matrix()), m @ m[::-1], atol=1e-6)


def test_inverse_undoes():
    R, v = js.Rotation.from_matrix(_rotations(4)), _vectors(4)
    np.testing.assert_allclose(np.asarray(R.inverse() @ (R @ v)), v, atol=1e-6)
    np.testing.assert_array_equal(R.inverse().inverse().to_matrix(), R.to_matrix())


@pytest.mark.parametrize("kind", [js.SpatialForce, js.SpatialMomentum, js.SpatialVelocity, js.SpatialAcceleration])
def test_rotate_turns_both_parts(kind):
    R, v, w = js.Rotation.from_matrix(_rotations(1)[0]), _vectors(5), _vectors(5)[::-1].copy()
    X = kind(v, w)
    turned = R @ X
    assert type(turned) is kind
    np.testing.assert_array_equal(turned.rotational, R @ v)
    np.testing.assert_array_equal(turned.translational, R @ w)
    np.testing.assert_array_equal(js.rotate(R, X).to_array(), turned.to_array())


def test_power_does_not_change():
    R = js.Rotation.from_matrix(_rotations(50, np.float32))
    F, V = js.SpatialForce(_vectors(50), _vectors(50) + 1), js.SpatialVelocity(_vectors(50) - 2, _vectors(50))
    np.testing.assert_allclose(np.asarray(js.dot(R @ F, R @ V)), np.asarray(js.dot(F, V)), rtol=0, atol=1e-5)


def test_identity_and_known_zeros_leave_nothing():
    v = jnp.asarray(_vectors(2))
    identity = js.Rotation.identity(dtype=jnp.float32)
    assert jax.make_jaxpr(lambda v: identity @ v)(v).eqns == []
    about_z = js.Rotation.from_matrix(np.float32([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]]))
    names = [e.primitive.name for e in jax.make_jaxpr(lambda v: about_z @ v)(v[0]).eqns]
    assert names.count("jaxspatial_product") == 4


def test_batches_broadcast_and_vmap():
    m, v = _rotations(4), _vectors(4)
    R, one = js.Rotation.from_matrix(m), js.Rotation.from_matrix(m[0])
    assert (R @ v[0]).shape == (4, 3) and (one @ v).shape == (4, 3)
    np.testing.assert_array_equal(jax.vmap(lambda R, v: R @ v)(R, v), R @ v)
    np.testing.assert_array_equal(jax.vmap(js.rotate, in_axes=(None, 0))(one, js.SpatialForce(v, v)).tau, one @ v)


def test_errors_name_what_came():
    R = js.Rotation.identity(dtype=jnp.float32)
    F = js.SpatialForce(np.ones(3, np.float32), np.ones(3, np.float32))
    with pytest.raises(ValueError, match=r"Rotation.from_matrix: m: expected shape .*, got \(4, 3\)"):
        js.Rotation.from_matrix(np.ones((4, 3), np.float32))
    with pytest.raises(TypeError, match="rotate: expected a Rotation first, got ndarray; .* with Rotation.from_matrix"):
        js.rotate(np.eye(3, dtype=np.float32), F)
    with pytest.raises(TypeError, match="rotate: expected a spatial vector or inertia as second, got ndarray"):
        js.rotate(R, np.ones(3, np.float32))
    with pytest.raises(TypeError, match="Rotation and v: expected one dtype, got Rotation: float32, v: float16"):
        _ = R @ np.ones(3, np.float16)
    with pytest.raises(ValueError, match="Rotation @ v: v: expected shape"):
        _ = R @ np.ones(4, np.float32)


@pytest.mark.parametrize(
    ("call", "way_out"),
    [
        (lambda: js.Rotation(np.eye(3)), "Rotation.from_matrix"),
        (lambda: js.Rotation(jnp.ones((2, 3, 3))), "Rotation.from_matrix"),
        (lambda: js.Rotation([1.0, 0, 0, 0]), "Rotation.from_quaternion"),
        (lambda: js.RigidTransform(np.eye(3), np.zeros(3)), "Rotation.from_matrix"),
        (lambda: js.act(np.eye(4), js.SpatialForce.zero()), "RigidTransform.from_matrix"),
        (lambda: js.SpatialForce(np.zeros(6)), "SpatialForce.from_array"),
        (lambda: js.SpatialVelocity(np.zeros(6), np.zeros(6)), "SpatialVelocity.from_array"),
        (lambda: js.RigidTransform.exp(np.zeros(6)), "SpatialVelocity.from_array"),
    ],
    ids=range(8),
)
def test_arrays_in_place_of_objects_are_told_what_takes_them(call, way_out):
    with pytest.raises((TypeError, ValueError), match=f"got .*with {way_out}"):
        call()
    maker = getattr(getattr(js, way_out.split(".")[0]), way_out.split(".")[1])
    assert callable(maker)


def test_rpy_is_that_of_a_urdf():
    """Roll, pitch, yaw about the fixed axes x, y, z in turn: Rz(yaw) Ry(pitch) Rx(roll), as a file's rpy is read."""
    rpy = np.float32([0.3, -0.5, 2.0])
    R = interpreted(js.Rotation.from_rpy)(rpy)
    about_z, about_y, about_x = (
        getattr(js.Rotation, f"about_{axis}")(rpy[k]) for k, axis in ((2, "z"), (1, "y"), (0, "x"))
    )
    np.testing.assert_allclose(R.to_matrix(), (about_z @ about_y @ about_x).to_matrix(), rtol=0, atol=4 * EPS)
    np.testing.assert_allclose(interpreted(js.Rotation.to_rpy)(R), rpy, rtol=0, atol=16 * EPS)
    assert (
        js.Rotation.from_rpy.__func__ is js.Rotation.from_roll_pitch_yaw.__func__
    )  # whose bounds and derivatives hold
    assert js.Rotation.to_rpy is js.Rotation.to_roll_pitch_yaw
    pytest.importorskip("lxml")
    moments = 'ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"'
    arm = f"""<robot name="arm"><link name="a"/>
      <link name="b"><inertial><mass value="1"/><inertia {moments}/></inertial></link>
      <joint name="j" type="continuous"><parent link="a"/><child link="b"/>
      <origin rpy="{" ".join(map(str, rpy))}"/></joint></robot>"""
    read = js.Mechanism.from_urdf(arm, dtype=np.float32)
    np.testing.assert_allclose(R.entries, read.placements.rotation.entries[0], rtol=0, atol=4 * EPS)
