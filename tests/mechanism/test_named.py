"""Coordinates and velocities by the names of joints, and back."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.mechanism.joints import BUILT_IN

MECH = js.testing.random_mechanism(0, 10, dtype=np.float32)
KINDS = {kind: name for name, kind in zip(MECH.joint_names, MECH.topology.kinds, strict=True)}


def test_there_and_back():
    """Of every kind of joint, one state and a batch, quaternions up to their sign."""
    assert {*KINDS} == {kind.name for kind in BUILT_IN if kind.nv}
    rng, on_spheres = np.random.default_rng(0), np.zeros(MECH.nq, int)
    for k, kind in enumerate(("ball", "free")):
        on_spheres[MECH.joint_position_indices(KINDS[kind])[:4]] = k + 1
    for batch in ((), (2, 3)):
        q = rng.standard_normal((*batch, MECH.nq)).astype(np.float32)
        for k in (1, 2):
            q[..., on_spheres == k] /= np.linalg.norm(q[..., on_spheres == k], axis=-1, keepdims=True)
            q[..., on_spheres == k] *= np.sign(q[..., on_spheres == k][..., :1])
        parts = MECH.joint_positions(q)
        assert list(parts) == list(MECH.joint_names)
        again = MECH.configuration(parts)
        assert again.shape == q.shape and again.dtype == np.float32
        np.testing.assert_array_equal(again[..., on_spheres == 0], q[..., on_spheres == 0])
        np.testing.assert_allclose(again, q, atol=5e-7)
        # In any order.
        np.testing.assert_array_equal(MECH.configuration(dict(reversed(parts.items()))), again)
        v = rng.standard_normal((*batch, MECH.nv)).astype(np.float32)
        np.testing.assert_array_equal(MECH.velocities(MECH.joint_velocities(v)), v)


def test_what_is_not_named_is_neutral():
    for made, nothing in ((MECH.configuration, MECH.neutral()), (MECH.velocities, np.zeros(MECH.nv, np.float32))):
        np.testing.assert_array_equal(made({}), nothing)
        assert made({}).dtype == np.float32 and isinstance(made({KINDS["revolute"]: 0.5}), np.ndarray)
    q = MECH.configuration({KINDS["prismatic"]: 0.5, KINDS["planar"]: [1.0, 2.0, 3.0]})
    np.testing.assert_array_equal(q[MECH.joint_position_indices(KINDS["prismatic"])], [0.5])
    np.testing.assert_array_equal(q[MECH.joint_position_indices(KINDS["planar"])], [1, 2, 3])
    assert (q != MECH.neutral()).sum() == 4


def test_poses_and_turns():
    """Of joints that are placed at the origin of the world they are the poses of their bodies."""
    joints = [js.Joint("base", "free", "world", "trunk"), js.Joint("neck", "ball", "trunk", "head")]
    mech = js.Mechanism.build([js.Body("trunk"), js.Body("head")], joints, dtype=np.float32)
    R = js.Rotation.exp(jnp.float32([[0.1, 0.2, 0.3], [-1.0, 2.0, 0.5]]))
    X = js.RigidTransform(R, jnp.float32([1, 2, 3]))
    turn = js.Rotation.about_x(np.float32(0.4))
    q = mech.configuration({"neck": turn, "base": X})
    assert q.shape == (2, 11)
    found = js.forward_kinematics(mech, q)
    np.testing.assert_allclose(found.to_matrix()[:, 0], X.to_matrix(), atol=1e-6)
    np.testing.assert_allclose(found.rotation.to_matrix()[:, 1], (R @ turn).to_matrix(), atol=1e-6)
    numbers = {"base": q[:, :7], "neck": q[:, 7:]}
    np.testing.assert_array_equal(mech.configuration(numbers), q)
    V = js.SpatialVelocity(jnp.float32([1, 2, 3]), jnp.float32([4, 5, 6]))
    np.testing.assert_array_equal(mech.velocities({"base": V}), np.float32([1, 2, 3, 4, 5, 6, 0, 0, 0]))
    np.testing.assert_array_equal(mech.configuration({"base": js.RigidTransform.identity()}), mech.neutral())


def test_transformed():
    hinge, slide = KINDS["revolute"], KINDS["prismatic"]
    angles, lengths = jnp.float32([0.1, 0.2, 0.3]), jnp.float32(0.7)

    def made(angle):
        return MECH.configuration({hinge: angle, slide: lengths})

    whole = made(angles)
    assert whole.shape == (3, MECH.nq) and whole.dtype == np.float32
    for q in (jax.vmap(made)(angles), jax.jit(made)(angles)):
        np.testing.assert_array_equal(q, whole)
    slope = jax.jacfwd(made)(angles[0])
    np.testing.assert_array_equal(np.flatnonzero(slope), MECH.joint_position_indices(hinge))
    back = jax.grad(lambda q: MECH.joint_positions(q)[hinge])(whole[0])
    np.testing.assert_array_equal(back, slope)


def test_dtypes_are_those_of_arrays():
    hinge, slide = KINDS["revolute"], KINDS["prismatic"]
    assert MECH.configuration({hinge: jnp.float16(1), slide: 0.5}).dtype == np.float16
    assert MECH.configuration({hinge: 1, slide: 0.5}).dtype == np.float32
    with pytest.raises(TypeError, match=f"{hinge} and {slide}: expected one dtype"):
        MECH.configuration({hinge: jnp.float16(1), slide: jnp.float32(1)})


def test_a_mechanism_without_joints():
    mech = js.Mechanism.build([], [], dtype=np.float32)
    assert mech.configuration({}).shape == (0,) and mech.joint_positions(jnp.zeros((2, 0))) == {}


def test_mimics_follow():
    joints = [
        js.Joint("a", "revolute", "world", "one"),
        js.Joint("b", "revolute", "one", "two", mimic=("a", 2.0, 0.1)),
        js.Joint("c", "prismatic", "two", "three"),
    ]
    mech = js.Mechanism.build([js.Body(name) for name in ("one", "two", "three")], joints, dtype=np.float32)
    np.testing.assert_array_equal(mech.configuration({"c": 2.0, "a": 1.0}), [1, 2])
    assert list(mech.joint_positions(np.float32([1, 2]))) == ["a", "c"]
    for made in (mech.configuration, mech.velocities):
        with pytest.raises(ValueError, match="'b' is a mimic: give 'a', which it follows"):
            made({"b": 1.0})


REFUSED = [
    ({"jiont0": 1.0}, KeyError, r"^\"Mechanism.configuration: positions: expected one of .*did you mean 'joint"),
    ({KINDS["planar"]: np.ones(2, np.float32)}, ValueError, r"\['joint6'\]: expected shape .*3\) for a 'planar' joint"),
    ({KINDS["free"]: 1.0}, ValueError, "a RigidTransform, or shape .*7.* for a 'free' joint, got shape "),
    ({KINDS["revolute"]: js.RigidTransform.identity()}, TypeError, "a number or .*batch.* got RigidTransform"),
    ({KINDS["ball"]: js.RigidTransform.identity()}, TypeError, "a Rotation, or shape .*4.* got RigidTransform"),
    ({KINDS["revolute"]: np.ones(3, bool)}, TypeError, "expected floating point"),
    ({KINDS["revolute"]: "up"}, TypeError, "expected an array of floating point"),
    ([0.1], TypeError, "expected a mapping from names of joints, got list"),
    (
        {KINDS["revolute"]: np.ones(2, np.float32), KINDS["prismatic"]: np.ones(3, np.float32)},
        ValueError,
        "expected batch shapes that broadcast, got",
    ),
]


@pytest.mark.parametrize(("positions", "error", "message"), REFUSED)
def test_what_does_not_fit_is_refused_by_name(positions, error, message):
    with pytest.raises(error, match=message):
        MECH.configuration(positions)


def test_parts_of_what_is_no_configuration():
    with pytest.raises(ValueError, match=r"Mechanism.joint_positions: q: expected shape \(\*batch, 23\)"):
        MECH.joint_positions(np.ones(3, np.float32))
