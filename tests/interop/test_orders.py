"""Component orders, spelled out in numbers, in both directions, on arrays of any kind; no peer is needed."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import orders
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

KINDS = (js.SpatialForce, js.SpatialMomentum, js.SpatialVelocity, js.SpatialAcceleration)
every_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
COUNTED = np.arange(1.0, 7.0, dtype=np.float32)
TURN = np.array([0.5, 0.5, -0.5, 0.5], np.float32)  # wxyz, a third of a turn: exact in any arithmetic
MATRIX = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]], np.float32)
PLACE = np.array([1.0, 2.0, 3.0], np.float32)

# name: (from, to, theirs, ours)
ARRAYS = {
    "quaternion_xyzw": (orders.quaternion_from_xyzw, orders.quaternion_to_xyzw, [1, 2, 3, 0], [0, 1, 2, 3]),
    "symmetric_diagonal_first": (
        orders.symmetric_from_diagonal_first,
        orders.symmetric_to_diagonal_first,
        ["xx", "yy", "zz", "xy", "xz", "yz"],
        ["xx", "xy", "yy", "xz", "yz", "zz"],
    ),
    "symmetric_upper_triangle": (
        orders.symmetric_from_upper_triangle,
        orders.symmetric_to_upper_triangle,
        ["xx", "xy", "xz", "yy", "yz", "zz"],
        ["xx", "xy", "yy", "xz", "yz", "zz"],
    ),
}
POSES = {
    "xyz_xyzw": (orders.pose_from_xyz_xyzw, orders.pose_to_xyz_xyzw, [*PLACE, 0.5, -0.5, 0.5, 0.5]),
    "xyz_wxyz": (orders.pose_from_xyz_wxyz, orders.pose_to_xyz_wxyz, [*PLACE, *TURN]),
    "wxyz_xyz": (orders.pose_from_wxyz_xyz, orders.pose_to_wxyz_xyz, [*TURN, *PLACE]),
}
every_array = pytest.mark.parametrize(("of", "to", "theirs", "ours"), ARRAYS.values(), ids=ARRAYS)
every_pose = pytest.mark.parametrize(("of", "to", "seven"), POSES.values(), ids=POSES)


@every_kind
def test_linear_first_exchanges_the_halves(kind):
    x = orders.from_linear_first(kind, COUNTED)
    assert type(x) is kind
    np.testing.assert_array_equal(x.rotational, [4, 5, 6])
    np.testing.assert_array_equal(x.translational, [1, 2, 3])
    np.testing.assert_array_equal(orders.to_linear_first(x), COUNTED)


@every_kind
def test_rotational_first_is_ours(kind):
    x = kind.from_array(COUNTED)
    np.testing.assert_array_equal(x.rotational, [1, 2, 3])
    np.testing.assert_array_equal(x.to_array(), COUNTED)


def test_matrix_between_linear_first_vectors_acts_on_ours():
    rng = np.random.default_rng(0)
    m = rng.integers(-8, 9, (5, 6, 6)).astype(np.float32)
    linear_first = rng.integers(-8, 9, (5, 6)).astype(np.float32)
    theirs = orders.from_linear_first(js.SpatialForce, np.einsum("nij,nj->ni", m, linear_first))
    ours = np.einsum("nij,nj->ni", orders.matrix_from_linear_first(m), np.roll(linear_first, 3, -1))
    np.testing.assert_array_equal(ours, theirs.to_array())
    np.testing.assert_array_equal(orders.matrix_to_linear_first(orders.matrix_from_linear_first(m)), m)


@every_array
def test_components_go_where_their_names_are(of, to, theirs, ours):
    values = {name: float(i + 1) for i, name in enumerate(sorted(theirs, key=str))}
    given, expected = (np.array([values[name] for name in names], np.float32) for names in (theirs, ours))
    np.testing.assert_array_equal(of(given), expected)
    np.testing.assert_array_equal(to(expected), given)


@every_pose
def test_pose(of, to, seven):
    seven = np.array(seven, np.float32)
    X, back, moved = interpreted(lambda x, p: (of(x), to(of(x)), of(x) @ p))(seven, np.array([1, 0, 0], np.float32))
    np.testing.assert_array_equal(X.rotation.to_matrix(), MATRIX)
    np.testing.assert_array_equal(X.translation, PLACE)
    np.testing.assert_array_equal(back, seven)
    np.testing.assert_array_equal(moved, PLACE + MATRIX[:, 0])


ON_ARRAYS = {
    "linear_first": (6, lambda x: orders.to_linear_first(orders.from_linear_first(js.SpatialVelocity, x))),
    **{f"{name}_from": (len(theirs), of) for name, (of, _, theirs, _) in ARRAYS.items()},
    **{f"{name}_to": (len(theirs), to) for name, (_, to, theirs, _) in ARRAYS.items()},
    **{f"pose_{name}": (7, lambda x, of=of, to=to: to(of(x))) for name, (of, to, _) in POSES.items()},
}


# Poses are computed, and compile for seconds: one dtype for them, since rotations are tested in all.
CASES = {
    f"{name}-{dtype}": (size, function, dtype)
    for name, (size, function) in ON_ARRAYS.items()
    for dtype in (["float32"] if size == 7 else ["float16", "bfloat16", "float32", "float64"])
}


WAYS = {"leading axes": lambda f: f, "vmap": lambda f: jax.vmap(jax.vmap(f))}


@pytest.mark.parametrize("way", [slow("leading axes"), "vmap"])
@pytest.mark.parametrize(("size", "function", "dtype"), CASES.values(), ids=CASES)
def test_batches_transformations_and_dtypes(size, function, dtype, way):
    with jax.enable_x64(True):
        x = np.random.default_rng(size).normal(size=(3, 2, size)).astype(jnp.dtype(dtype))
        expected = interpreted(function)(x)
        assert expected.dtype == x.dtype
        assert expected.shape == x.shape
        np.testing.assert_array_equal(jax.jit(WAYS[way](function))(x), expected)


@pytest.mark.parametrize(("size", "function"), ON_ARRAYS.values(), ids=ON_ARRAYS)
def test_double_words_pass(size, function):
    x = np.random.default_rng(size).normal(size=(3, size)).astype(np.float32)
    result, plain = interpreted(lambda x: (js.from_double_word(function(js.to_double_word(x))), function(x)))(x)
    np.testing.assert_allclose(result, plain, rtol=0, atol=2.0**-21)


@pytest.mark.parametrize(("size", "function"), ON_ARRAYS.values(), ids=ON_ARRAYS)
def test_other_shapes_are_refused(size, function):
    with pytest.raises(ValueError, match=rf": expected shape \(\*batch, {size}\), got \(2, {size + 1}\)"):
        function(np.zeros((2, size + 1), np.float32))


def test_single_refuses_a_batch_and_says_what_to_do():
    with pytest.raises(
        ValueError, match=r"here: expected one item, got a batch of shape \(2,\); item i is jax.tree.map"
    ):
        orders.single(np.zeros((2, 3)), "here")
    pair = js.DoubleWord(jnp.asarray([1.0], jnp.float32), jnp.asarray([2.0**-30], jnp.float32))
    np.testing.assert_array_equal(orders.single(pair, "here"), [1 + 2.0**-30])


def test_import_of_interop_imports_no_peer():
    peers = "pydrake pinocchio mujoco brax jaxlie scipy.spatial".split()
    source = f"import sys, jaxspatial.interop; assert not set({peers}) & set(sys.modules)"
    subprocess.run([sys.executable, "-c", source], check=True)
