"""To and from pydrake's objects, and what they mean there: in float64, in both directions.

Where only numbers move, they are equal. U = 2^-53.
"""

import chex
import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop
from jaxspatial.inertia import SpatialInertia
from tests.helpers.optional import needs
from tests.helpers.peer_bodies import N, each, inertias, poses
from tests.helpers.peer_inputs import inputs

drake_math = needs("pydrake.multibody.math")
pydrake_math = needs("pydrake.math")

U = 2.0**-53
KINDS = js.SpatialForce, js.SpatialVelocity, js.SpatialAcceleration, js.SpatialMomentum
every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


@every_kind
def test_spatial_vectors_both_ways(kind):
    of, to = interop.drake.from_spatial_vector, interop.drake.to_spatial_vector
    theirs = getattr(drake_math, kind.__name__)
    (six,) = inputs(6, rows=20)
    for row in six:
        ours = of(theirs(row))
        assert type(ours) is kind
        np.testing.assert_array_equal(ours.to_array(), row)
        assert type(to(ours)) is theirs
        np.testing.assert_array_equal(to(ours).get_coeffs(), row)


def test_what_is_read_does_not_change_with_its_source():
    F, X = drake_math.SpatialForce(np.arange(6.0)), pydrake_math.RigidTransform(np.arange(3.0))
    ours, frame = interop.drake.from_spatial_vector(F), interop.drake.from_rigid_transform(X)
    F.SetZero()
    X.set_translation(np.ones(3))
    np.testing.assert_array_equal(ours.to_array(), np.arange(6.0))
    np.testing.assert_array_equal(frame.translation, np.arange(3.0))


def test_power_is_theirs():
    six, other = inputs(6, 6, rows=20)
    for a, b in zip(six, other, strict=True):
        F, V = js.SpatialForce.from_array(a), js.SpatialVelocity.from_array(b)
        power = interop.drake.to_spatial_vector(F).dot(interop.drake.to_spatial_vector(V))
        assert abs(power - js.dot(F, V)) <= 8 * U * abs(a * b).sum()


def test_float32_and_double_words_are_widened_exactly():
    F = js.SpatialForce(*np.random.default_rng(0).normal(size=(2, 3)).astype(np.float32))
    np.testing.assert_array_equal(interop.drake.to_spatial_vector(F).get_coeffs(), np.asarray(F.to_array(), np.float64))
    pair = js.to_double_word(F)
    np.testing.assert_array_equal(
        interop.drake.to_spatial_vector(pair).get_coeffs(), np.asarray(F.to_array(), np.float64)
    )


def test_frames_both_ways_and_what_they_do():
    p = np.random.default_rng(1).normal(size=3)
    for X in each(poses()):
        theirs = interop.drake.to_rigid_transform(X)
        np.testing.assert_array_equal(theirs.GetAsMatrix4(), X.to_matrix())
        assert theirs.rotation().IsValid()
        back = interop.drake.from_rigid_transform(theirs)
        np.testing.assert_array_equal(back.to_matrix(), X.to_matrix())
        rotation = interop.drake.from_rotation_matrix(interop.drake.to_rotation_matrix(X.rotation))
        np.testing.assert_array_equal(rotation.entries, X.rotation.entries)
        size = abs(theirs.rotation().matrix()) @ abs(p) + abs(X.translation)
        assert (abs(theirs.multiply(p) - np.asarray(X @ p)) <= 8 * U * size).all()


def test_a_wrench_acted_on_is_rotated_and_shifted():
    """F_Ao_A = (R_AB F_Bo_B).Shift(-p_AoBo_A)."""
    for X, six in zip(each(poses()), np.random.default_rng(2).normal(size=(N, 6)), strict=True):
        F = js.SpatialForce.from_array(six)
        frame = interop.drake.to_rigid_transform(X)
        moved = interop.drake.to_spatial_vector(F).Rotate(frame.rotation()).Shift(np.negative(frame.translation()))
        theirs = np.asarray(moved.get_coeffs(), np.float64)
        size = np.abs(six).sum() * (1 + abs(X.translation).max())
        assert abs(theirs - np.asarray(js.act(X, F).to_array())).max() <= 8 * U * size


def plant_of_one_body():
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import SpatialInertia

    plant = MultibodyPlant(0.0)
    plant.AddRigidBody("B", SpatialInertia.SolidBoxWithMass(2.0, 0.3, 0.2, 0.1))
    plant.Finalize()
    return plant, plant.CreateDefaultContext(), plant.GetBodyByName("B")


def test_floating_joint_and_columns_of_a_jacobian():
    from pydrake.multibody.tree import JacobianWrtVariable

    plant, context, body = plant_of_one_body()
    frame, world = body.body_frame(), plant.world_frame()
    for X, v in zip(each(poses()), np.random.default_rng(3).normal(size=(N, 6)), strict=True):
        plant.SetPositions(context, interop.orders.pose_to_wxyz_xyz(X))
        plant.SetVelocities(context, js.SpatialVelocity.from_array(v).to_array())
        back = interop.drake.from_rigid_transform(plant.EvalBodyPoseInWorld(context, body))
        np.testing.assert_allclose(back.to_matrix(), X.to_matrix(), rtol=0, atol=12 * U)
        again = interop.orders.pose_from_wxyz_xyz(plant.GetPositions(context))
        np.testing.assert_allclose(again.to_matrix(), X.to_matrix(), rtol=0, atol=12 * U)
        moving = interop.drake.from_spatial_vector(plant.EvalBodySpatialVelocityInWorld(context, body))
        np.testing.assert_array_equal(moving.to_array(), js.SpatialVelocity.from_array(v).to_array())
        variable = JacobianWrtVariable.kV
        jacobian = plant.CalcJacobianSpatialVelocity(context, variable, frame, np.zeros(3), world, world)
        columns = js.SpatialVelocity.from_array(jacobian.T)
        assert columns.batch_shape == (6,)
        np.testing.assert_array_equal(columns.to_array().T, jacobian)
        np.testing.assert_allclose((columns * v).to_array().sum(0), v, rtol=0, atol=8 * U * abs(v).sum())


def test_externally_applied_force():
    rng = np.random.default_rng(4)
    _, _, body = plant_of_one_body()
    for X in each(poses()):
        F = js.SpatialForce.from_array(rng.normal(size=6))
        force = interop.drake.to_externally_applied(body.index(), F)
        assert force.body_index == body.index()
        np.testing.assert_array_equal(interop.drake.from_externally_applied(force, X).to_array(), F.to_array())
        force.p_BoBq_B = rng.normal(size=3)
        arm = np.asarray(X.rotation.to_matrix()) @ force.p_BoBq_B
        theirs = force.F_Bq_W.Shift(-arm).get_coeffs()
        ours = interop.drake.from_externally_applied(force, X).to_array()
        assert abs(np.asarray(ours) - theirs).max() <= 16 * U * (abs(theirs).max() + abs(arm).max() * abs(F.f).max())


def test_a_batch_is_refused():
    with pytest.raises(ValueError, match=r"drake.to_spatial_vector: expected one item, got a batch of shape \(4,\)"):
        interop.drake.to_spatial_vector(js.SpatialForce.zero(4))


def test_what_is_no_spatial_vector_of_floats_is_refused():
    from pydrake.autodiffutils import AutoDiffXd

    for x in (drake_math.SpatialForce_[AutoDiffXd](), np.zeros(6)):
        with pytest.raises(TypeError, match="drake.from_spatial_vector: x: expected pydrake's SpatialForce or"):
            interop.drake.from_spatial_vector(x)


def near(ours, theirs, size, k=16):
    """Within k u of the size."""
    assert (np.abs(np.asarray(ours) - np.asarray(theirs)) <= k * U * size).all()


def test_inertia_both_ways_and_what_it_does():
    motions = np.random.default_rng(10).normal(size=(N, 6))
    for (M, size), six in zip(inertias(), motions, strict=True):
        theirs, linear = interop.drake.to_inertia(M), float(M.mass) * (1 + np.linalg.norm(M.com))
        assert theirs.get_mass() == M.mass
        np.testing.assert_array_equal(theirs.get_com(), M.com)
        near(theirs.CopyToFullMatrix6(), M.to_matrix(), size + linear)
        back = interop.drake.from_inertia(theirs)
        assert back.mass == M.mass
        np.testing.assert_array_equal(back.com, M.com)
        near(back.central, M.central, size)
        V, A = js.SpatialVelocity.from_array(six), js.SpatialAcceleration.from_array(six)
        momentum = interop.drake.from_spatial_vector(theirs * interop.drake.to_spatial_vector(V))
        near((M @ V).to_array(), momentum.to_array(), 4 * (size + linear))
        force = interop.drake.from_spatial_vector(theirs * interop.drake.to_spatial_vector(A))
        near((M @ A).to_array(), force.to_array(), 4 * (size + linear))


def test_inertia_made_by_drake():
    """From the central inertia, as Drake recommends."""
    from pydrake.multibody import tree

    for M, size in inertias():
        six = interop.orders.symmetric_to_diagonal_first(np.asarray(M.central))
        theirs = tree.SpatialInertia.MakeFromCentralInertia(float(M.mass), M.com, tree.RotationalInertia(*six))
        near(interop.drake.from_inertia(theirs).central, M.central, size)


def test_shifted_inertia_is_theirs():
    for M, size in inertias():
        p = np.asarray(M.com) * 2 + 1
        theirs = interop.drake.to_inertia(M).Shift(p)
        near(theirs.CopyToFullMatrix6(), js.shift(M, p).to_matrix(), 2 * size + 4 * float(M.mass) * (1 + p @ p))


def test_bodies_without_mass():
    assert interop.drake.to_inertia(SpatialInertia.zero()).IsZero()
    point = SpatialInertia(0.0, np.array([1.0, 2.0, 3.0]), np.zeros(6))
    back = interop.drake.from_inertia(interop.drake.to_inertia(point))
    chex.assert_trees_all_equal(point, back)
    with pytest.raises(ValueError, match="drake.to_inertia: expected no central inertia without mass"):
        interop.drake.to_inertia(SpatialInertia(0.0, np.zeros(3), np.array([1.0, 0, 1, 0, 0, 1])))
