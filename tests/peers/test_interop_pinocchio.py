"""To and from Pinocchio's objects, and what they mean there: in float64, in both directions.

Where only numbers move, they are equal. Elsewhere both sides err by a few u of the sizes that are multiplied.
U = 2^-53.
"""

import chex
import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import orders
from tests.helpers.optional import needs
from tests.helpers.peer_bodies import N, each, inertias, poses
from tests.helpers.peer_inputs import inputs

pin = needs("pinocchio")

U = 2.0**-53
VECTORS = {
    "force": (interop.pinocchio.from_force, interop.pinocchio.to_force, js.SpatialForce, pin.Force),
    "momentum": (interop.pinocchio.from_momentum, interop.pinocchio.to_force, js.SpatialMomentum, pin.Force),
    "motion": (interop.pinocchio.from_motion, interop.pinocchio.to_motion, js.SpatialVelocity, pin.Motion),
    "classical_acceleration": (
        interop.pinocchio.from_classical_acceleration,
        interop.pinocchio.to_classical_acceleration,
        js.SpatialAcceleration,
        pin.Motion,
    ),
}


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def near(ours, theirs, size, k=16):
    """Within k u of the size."""
    assert (np.abs(np.asarray(ours) - np.asarray(theirs)) <= k * U * size).all()


@pytest.mark.parametrize(("of", "to", "kind", "theirs"), VECTORS.values(), ids=VECTORS)
def test_spatial_vectors_both_ways(of, to, kind, theirs):
    (six,) = inputs(6, rows=20)
    for row in six:
        ours = of(theirs(row))
        assert type(ours) is kind
        np.testing.assert_array_equal(orders.to_linear_first(ours), row)
        assert type(to(ours)) is theirs
        np.testing.assert_array_equal(to(ours).vector, row)


def test_what_is_read_does_not_change_with_its_source():
    F, X = pin.Force(np.arange(6.0)), pin.SE3(np.eye(3), np.arange(3.0))
    ours, frame = interop.pinocchio.from_force(F), interop.pinocchio.from_se3(X)
    F.setZero()
    X.setRandom()
    np.testing.assert_array_equal(ours.to_array(), [3, 4, 5, 0, 1, 2])
    np.testing.assert_array_equal(frame.translation, np.arange(3.0))
    np.testing.assert_array_equal(frame.rotation.to_matrix(), np.eye(3))


def test_spatial_acceleration_both_ways():
    six, motion = inputs(6, 6, rows=20)
    for a, v in zip(six, motion, strict=True):
        A, V = pin.Motion(a), pin.Motion(v)
        ours = interop.pinocchio.from_spatial_acceleration(A, V)
        size = abs(a).max() + abs(v).max() ** 2
        near(ours.a, pin.classicAcceleration(V, A), size, 8)
        np.testing.assert_array_equal(ours.alpha, A.angular)
        back = interop.pinocchio.to_spatial_acceleration(ours, interop.pinocchio.from_motion(V))
        near(back.vector, a, size, 8)


def test_frames_both_ways():
    for X in each(poses()):
        theirs = interop.pinocchio.to_se3(X)
        np.testing.assert_array_equal(theirs.homogeneous, X.to_matrix())
        np.testing.assert_array_equal(interop.pinocchio.from_se3(theirs).to_matrix(), X.to_matrix())


def test_actions_agree():
    sixes = np.random.default_rng(2).normal(size=(N, 6))
    for X, six in zip(each(poses()), sixes, strict=True):
        theirs, size = interop.pinocchio.to_se3(X), 10 * (1 + abs(X.translation).max())
        for of, to, kind, _ in list(VECTORS.values())[:3]:
            x = kind.from_array(six)
            near(of(theirs.act(to(x))).to_array(), js.act(X, x).to_array(), size)
            near(of(theirs.actInv(to(x))).to_array(), js.act_inverse(X, x).to_array(), size)
        near(orders.matrix_from_linear_first(theirs.action), X.to_motion_matrix(), size)


def test_exponential_and_logarithm_agree():
    for six in np.random.default_rng(5).normal(size=(N, 6)):
        V = js.SpatialVelocity.from_array(six)
        theirs = pin.exp6(interop.pinocchio.to_motion(V))
        near(js.RigidTransform.exp(V).to_matrix(), theirs.homogeneous, 4, 32)
        near(
            js.RigidTransform.exp(V).log().to_array(), interop.pinocchio.from_motion(pin.log6(theirs)).to_array(), 8, 64
        )


def test_free_flyer_configuration_and_velocity():
    """Of the joint as Pinocchio integrates it, and as its XYZQUAT."""
    model = free_flyer()
    data = model.createData()
    velocities = np.random.default_rng(3).normal(size=(N, 6))
    for X, six in zip(each(poses()), velocities, strict=True):
        q = np.asarray(orders.pose_to_xyz_xyzw(X))
        V = js.SpatialVelocity.from_array(six)
        v = np.asarray(orders.to_linear_first(V))
        near(abs(q), abs(pin.SE3ToXYZQUAT(interop.pinocchio.to_se3(X))), 1, 8)
        pin.forwardKinematics(model, data, q, v)
        near(interop.pinocchio.from_se3(data.oMi[1]).to_matrix(), X.to_matrix(), 1, 12)
        near(orders.pose_from_xyz_xyzw(q).to_matrix(), X.to_matrix(), 1, 12)
        np.testing.assert_array_equal(interop.pinocchio.from_motion(data.v[1]).to_array(), six)
        np.testing.assert_array_equal(orders.from_linear_first(js.SpatialVelocity, v).to_array(), six)


def free_flyer():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "free")
    model.appendBodyToJoint(
        joint, pin.Inertia.FromBox(2.0, 0.3, 0.2, 0.1), pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3]))
    )
    return model


def moving():
    """Pose, velocity and acceleration of a free body, ours; and Pinocchio's model and data of it."""
    model = free_flyer()
    rng = np.random.default_rng(6)
    for X in each(poses()):
        v, a = rng.normal(size=(2, 6))
        data = model.createData()
        q = np.asarray(orders.pose_to_xyz_xyzw(X))
        pin.forwardKinematics(model, data, q, v, a)
        yield interop.pinocchio.from_se3(data.oMi[1]), model, data


def test_reference_frames_of_a_velocity():
    frames = pin.ReferenceFrame
    for X, model, data in moving():
        V = interop.pinocchio.from_motion(pin.getVelocity(model, data, 1, frames.LOCAL))
        in_world = interop.pinocchio.from_motion(pin.getVelocity(model, data, 1, frames.WORLD))
        aligned = interop.pinocchio.from_motion(pin.getVelocity(model, data, 1, frames.LOCAL_WORLD_ALIGNED))
        size = 8 * (1 + abs(X.translation).max())
        near(js.act(X, V).to_array(), in_world.to_array(), size)
        near(js.act_inverse(X, in_world).to_array(), V.to_array(), size)
        near(js.rotate(X.rotation, V).to_array(), aligned.to_array(), 8)
        near(js.rotate(X.rotation.inverse(), aligned).to_array(), V.to_array(), 8)


def test_reference_frames_of_an_acceleration():
    """The classical one of the body's point at the world's origin, for WORLD."""
    frames = pin.ReferenceFrame
    for X, model, data in moving():
        V, A = ({f: get(model, data, 1, f) for f in (frames.LOCAL, frames.WORLD, frames.LOCAL_WORLD_ALIGNED)}
                for get in (pin.getVelocity, pin.getAcceleration))  # fmt: skip
        local, world, aligned = (interop.pinocchio.from_spatial_acceleration(A[f], V[f]) for f in A)
        w = interop.pinocchio.from_motion(V[frames.LOCAL]).w
        size = 64 * (1 + abs(X.translation).max())
        near(js.act(X, local, w).to_array(), world.to_array(), size)
        near(js.act_inverse(X, world, X.rotation @ w).to_array(), local.to_array(), size)
        near(js.rotate(X.rotation, local).to_array(), aligned.to_array(), 64)
        classical = pin.getClassicalAcceleration(model, data, 1, frames.LOCAL_WORLD_ALIGNED)
        near(interop.pinocchio.from_classical_acceleration(classical).to_array(), aligned.to_array(), 64)


def test_accelerations_with_and_without_gravity():
    """data.a is without it, data.a_gf less it, in the axes of the body."""
    model = free_flyer()
    rng = np.random.default_rng(8)
    for X in each(poses()):
        v, a = rng.normal(size=(2, 6))
        data, q = model.createData(), np.asarray(orders.pose_to_xyz_xyzw(X))
        pin.rnea(model, data, q, v, a)
        less = interop.pinocchio.from_spatial_acceleration(data.a_gf[1], data.v[1])
        pin.forwardKinematics(model, data, q, v, a)
        A = interop.pinocchio.from_spatial_acceleration(data.a[1], data.v[1])
        gravity = X.rotation.inverse() @ model.gravity.linear
        near((A - less).a, gravity, 64)


def test_a_batch_is_refused():
    with pytest.raises(ValueError, match=r"pinocchio.to_motion: expected one item, got a batch of shape \(4,\)"):
        interop.pinocchio.to_motion(js.SpatialVelocity.zero(4))


def test_inertia_both_ways_and_what_it_does():
    motions = np.random.default_rng(10).normal(size=(N, 6))
    for (M, size), six in zip(inertias(), motions, strict=True):
        theirs = interop.pinocchio.to_inertia(M)
        back = interop.pinocchio.from_inertia(theirs)
        chex.assert_trees_all_equal(M, back)
        V, linear = js.SpatialVelocity.from_array(six), float(M.mass) * (1 + np.linalg.norm(M.com))
        momentum = interop.pinocchio.from_momentum(theirs * interop.pinocchio.to_motion(V))
        near((M @ V).h, momentum.h, 4 * (size + linear))
        near((M @ V).l, momentum.l, 4 * linear)
        near(2 * M.kinetic_energy(V), theirs.vtiv(interop.pinocchio.to_motion(V)), 16 * (size + linear))
        near(orders.matrix_from_linear_first(theirs.matrix()), M.to_matrix(), size + linear, 8)
        near(M.to_dynamic_parameters(), theirs.toDynamicParameters(), size + linear, 8)


def test_inertia_that_rounding_made_indefinite_and_zero():
    M = SpatialInertia(1.0, np.zeros(3), np.array([-1e-17, 0, 1, 0, 0, 1]))
    np.testing.assert_array_equal(interop.pinocchio.to_inertia(M).inertia, M.central_matrix())
    assert interop.pinocchio.to_inertia(SpatialInertia.zero()).isZero()


def test_moved_inertia_is_theirs():
    for (M, size), X in zip(inertias(), each(poses()), strict=True):
        frame = interop.pinocchio.to_se3(X)
        theirs = interop.pinocchio.from_inertia(frame.act(interop.pinocchio.to_inertia(M)))
        near(js.act(X, M).com, theirs.com, abs(X.translation).max() + 3 * abs(M.com).max(), 8)
        near(js.act(X, M).central, theirs.central, size)


def test_pseudo_inertia_both_ways():
    for M, size in inertias():
        theirs = interop.pinocchio.to_pseudo_inertia(M)
        size = size + float(M.mass) * (1 + np.linalg.norm(M.com))
        near(pin.PseudoInertia.FromInertia(interop.pinocchio.to_inertia(M)).toMatrix(), theirs.toMatrix(), size)
        back = interop.pinocchio.from_pseudo_inertia(theirs)
        near(back.central, M.central, size)
        near(back.com, M.com, np.linalg.norm(M.com))
        assert back.mass == M.mass


def test_log_cholesky_both_ways():
    for theta in np.random.default_rng(11).normal(size=(N, 10)):
        theirs = pin.LogCholeskyParameters(theta)
        M, read = interop.pinocchio.from_log_cholesky(theirs), interop.pinocchio.from_inertia(theirs.toInertia())
        size = float(M.mass) * (1 + np.linalg.norm(M.com)) ** 2 + abs(M.central).max()
        near(M.mass, read.mass, float(M.mass))
        near(M.com, read.com, np.linalg.norm(M.com))
        near(M.central, read.central, size, 32)
        again = interop.pinocchio.to_log_cholesky(M)
        near(again.toDynamicParameters(), theirs.toDynamicParameters(), size, 64)
        # What is small in Sigma is known less well: its condition number is that of what comes back.
        sigma = np.asarray(M.shift(M.com).to_pseudo_inertia())[:3, :3]
        near(again.parameters, theta, np.linalg.cond(sigma) * (1 + abs(theta).max()), 64)
