"""The conventions of each library, on arrays and on whatever has the right attributes; no peer is needed."""

import inspect
import types

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import interop
from jaxspatial.inertia import SpatialInertia
from jaxspatial.interop import mujoco, orders, pinocchio
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

EPS = 2.0**-23
QUARTER = [0.0, 0.0, 0.0, 1.0]  # wxyz, half a turn about z
MODULES = [getattr(interop, name) for name in "brax drake jaxlie mujoco newton orders pinocchio ros scipy".split()]


def vector(*values):
    return np.array(values, np.float32)


def random(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def _cacc(cacc, cvel):
    gravity = [0.0, 0.0, -9.81]
    return mujoco.to_cacc(mujoco.from_cacc(cacc, cvel, gravity), js.SpatialVelocity.from_array(cvel), gravity)


def _free_joint(kind):
    def round_trip(x, w):
        R = js.Rotation.exp(w)
        return mujoco.to_free_joint(mujoco.from_free_joint(kind, x, R), R)

    return round_trip


def _rotational_first(kind):
    return lambda x: kind.from_array(x).to_array()


def _linear_first(kind):
    return lambda x: orders.to_linear_first(orders.from_linear_first(kind, x))


def _framed(x, w):
    frame = js.Rotation.exp(w).entries
    return mujoco.to_contact_force(mujoco.from_contact_force(x, frame), frame)


def _placed(p, w):
    return js.RigidTransform(js.Rotation(js.Rotation.exp(w).entries), p).translation


def _object(x):
    return mujoco.to_object_acceleration(mujoco.from_object_acceleration(x, [0.0, 0.0, -9.81]), [0.0, 0.0, -9.81])


# name: (function that gives back its first argument, sizes of its arguments)
ROUND_TRIPS = {
    "cvel": (_rotational_first(js.SpatialVelocity), 6),
    "cacc": (_cacc, 6, 6),
    "object_acceleration": (_object, 6),
    "cfrc": (_rotational_first(js.SpatialForce), 6),
    "xfrc_applied": (_linear_first(js.SpatialForce), 6),
    "contact_force": (_framed, 6, 3),
    "xpos_xmat": (_placed, 3, 3),
    "free_joint_qvel": (_free_joint(js.SpatialVelocity), 6, 3),
    "free_joint_qacc": (_free_joint(js.SpatialAcceleration), 6, 3),
    "free_joint_qfrc": (_free_joint(js.SpatialForce), 6, 3),
    "cinert": (lambda x: mujoco.to_cinert(mujoco.from_cinert(x)), 10),
    "free_flyer": (_linear_first(js.SpatialVelocity), 6),
}


WAYS = {"leading axes": lambda f: f, "vmap": lambda f: jax.vmap(jax.vmap(f))}


@pytest.mark.parametrize("way", [slow("leading axes"), "vmap"])
@pytest.mark.parametrize(("function", "sizes"), [(f, sizes) for f, *sizes in ROUND_TRIPS.values()], ids=ROUND_TRIPS)
def test_round_trips_over_batches_and_transformations(function, sizes, way):
    arrays = [random(3, 2, n, seed=i) for i, n in enumerate(sizes)]
    if sizes == [10]:
        arrays[0][..., 9] = 2
    expected = interpreted(function)(*arrays)
    assert expected.dtype == np.float32
    np.testing.assert_allclose(expected, arrays[0], rtol=0, atol=64 * EPS)
    np.testing.assert_array_equal(jax.jit(WAYS[way](function))(*arrays), expected)


def test_wide_types_switched_on_later():
    """JAX caches what it makes of an array of indices; it must not be of the narrow kind afterwards."""
    round_trip = ROUND_TRIPS["cinert"][0]
    jax.jit(round_trip)(np.ones(10, np.float32))
    with jax.enable_x64(True):
        assert jax.jit(round_trip)(np.ones(10)).dtype == np.float64


def test_the_two_orders_of_mujoco():
    counted = np.arange(1.0, 7.0, dtype=np.float32)
    np.testing.assert_array_equal(js.SpatialForce.from_array(counted).tau, [1, 2, 3])
    np.testing.assert_array_equal(orders.from_linear_first(js.SpatialForce, counted).f, [1, 2, 3])


def test_contact_frame_holds_axes_by_rows():
    """A normal force, along the first row."""
    frame = vector(0, 0, 1, 1, 0, 0, 0, 1, 0)
    for given in (frame, frame.reshape(3, 3)):
        F = mujoco.from_contact_force(vector(5, 0, 0, 0, 0, 2), given)
        np.testing.assert_array_equal(F.f, [0, 0, 5])
        np.testing.assert_array_equal(F.tau, [0, 2, 0])


def test_free_joint_is_mixed():
    """Linear in world axes, angular in those of the body."""
    R = js.Rotation.from_quaternion(vector(*QUARTER))
    V = mujoco.from_free_joint(js.SpatialVelocity, vector(1, 2, 3, 4, 5, 6), R)
    np.testing.assert_array_equal(V.v, [1, 2, 3])
    np.testing.assert_array_equal(V.w, [-4, -5, 6])


def test_acceleration_of_free_fall_and_of_rest():
    gravity, rest = [0.0, 0.0, -9.81], vector(0, 0, 0, 0, 0, 9.81)
    np.testing.assert_array_equal(mujoco.from_cacc(0 * rest, 0 * rest, gravity).a, vector(0, 0, -9.81))
    np.testing.assert_array_equal(mujoco.from_cacc(rest, 0 * rest, gravity).a, np.zeros(3))


def test_cinert_of_a_point_mass():
    M = mujoco.from_cinert(vector(2 * 13, 2 * 10, 2 * 5, -2 * 2, -2 * 3, -2 * 6, 2 * 1, 2 * 2, 2 * 3, 2))
    np.testing.assert_array_equal(M.com, [1, 2, 3])
    np.testing.assert_array_equal(M.central, np.zeros(6))


def test_body_inertia_is_turned_into_the_body():
    half = np.float32(np.sqrt(0.5))
    given = np.float32(2), vector(3, 2, 1), vector(1, 0, 0), vector(half, 0, 0, half)
    M = interpreted(mujoco.from_body_inertia)(*given)
    np.testing.assert_allclose(M.central_matrix(), np.diag([2, 3, 1]), rtol=0, atol=8 * EPS)
    mass, moments, ipos, _ = interpreted(mujoco.to_body_inertia)(M)
    assert mass == 2
    np.testing.assert_allclose(moments, [3, 2, 1], rtol=0, atol=8 * EPS)
    np.testing.assert_array_equal(ipos, [1, 0, 0])


def test_full_inertia():
    full = orders.symmetric_from_diagonal_first(vector(1, 2, 3, 0.1, 0.2, 0.3))
    M = SpatialInertia(np.float32(1), vector(0, 0, 1), full)
    np.testing.assert_array_equal(M.central_matrix(), np.float32([[1, 0.1, 0.2], [0.1, 2, 0.3], [0.2, 0.3, 3]]))
    np.testing.assert_array_equal(orders.symmetric_to_diagonal_first(M.central), vector(1, 2, 3, 0.1, 0.2, 0.3))


def test_objects_are_read_by_their_attributes():
    """In their own dtype, NumPy and so known while tracing."""
    motion = types.SimpleNamespace(angular=np.array([1.0, 2, 3]), linear=np.array([4.0, 5, 6]))
    F = pinocchio.from_force(motion)
    assert isinstance(F.tau, np.ndarray)
    assert F.dtype == np.float64
    np.testing.assert_array_equal(F.to_array(), [1, 2, 3, 4, 5, 6])
    motion = types.SimpleNamespace(angular=vector(1, 2, 3), linear=vector(4, 5, 6))
    A = pinocchio.from_spatial_acceleration(motion, motion)
    np.testing.assert_array_equal(A.a, np.array([4, 5, 6]) + np.cross([1, 2, 3], [4, 5, 6]))
    moving = types.SimpleNamespace(ang=vector(1, 2, 3), vel=vector(4, 5, 6))
    np.testing.assert_array_equal(interop.brax.from_motion(moving).to_array(), [1, 2, 3, 4, 5, 6])
    pose = types.SimpleNamespace(wxyz_xyz=vector(*QUARTER, 1, 2, 3))
    np.testing.assert_array_equal(interop.jaxlie.from_se3(pose).to_matrix()[:, 3], [1, 2, 3, 1])
    turn = types.SimpleNamespace(as_quat=lambda: vector(0, 0, 1, 0))
    np.testing.assert_array_equal(interop.scipy.from_rotation(turn).to_matrix(), np.diag([-1, -1, 1]))


def test_inertia_of_brax_means_two_things():
    pose = types.SimpleNamespace(pos=vector(0, 0, 2), rot=vector(1, 0, 0, 0))
    body = types.SimpleNamespace(transform=pose, i=np.diag(vector(9, 9, 1)), mass=np.float32(2))
    M, moved = interop.brax.from_inertia(body), interop.brax.from_moved_inertia(body)
    np.testing.assert_array_equal(M.com, [0, 0, 2])
    np.testing.assert_array_equal(M.central_matrix(), np.diag([9, 9, 1]))
    np.testing.assert_array_equal(moved.com, [0, 0, 1])
    np.testing.assert_array_equal(moved.central_matrix(), np.diag([7, 7, 1]))


def test_reference_frames_of_pinocchio():
    X = js.RigidTransform(js.Rotation.from_quaternion(vector(*QUARTER)), vector(1, 0, 0))
    F = js.SpatialForce(tau=vector(0, 0, 0), f=vector(0, 1, 0))
    aligned, world = js.rotate(X.rotation, F), js.act(X, F)
    np.testing.assert_array_equal(aligned.to_array(), [0, 0, 0, 0, -1, 0])
    np.testing.assert_array_equal(world.to_array(), [0, 0, -1, 0, -1, 0])
    np.testing.assert_array_equal(js.rotate(X.rotation.inverse(), aligned).to_array(), F.to_array())
    np.testing.assert_array_equal(js.act_inverse(X, world).to_array(), F.to_array())
    M = SpatialInertia(np.float32(1), vector(1, 0, 0), vector(1, 0, 1, 0, 0, 1))
    np.testing.assert_array_equal(js.act(X, M).com, [0, 0, 0])


@pytest.mark.parametrize("module", MODULES, ids=lambda m: m.__name__.rpartition(".")[2])
def test_every_function_says_what_it_converts_both_ways(module):
    functions = {n: f for n, f in inspect.getmembers(module, inspect.isfunction) if f.__module__ == module.__name__}
    public = {name for name in functions if not name.startswith("_")}
    assert all(functions[name].__doc__ for name in public)
    one_way = {"from_momentum", "single", "to_tau"}
    for name in public - one_way:
        back = name.replace("from_", "TO_").replace("to_", "from_").replace("TO_", "to_")
        assert back in public, f"{module.__name__}.{name} has no {back}"
