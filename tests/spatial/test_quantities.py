"""What spatial vectors, rotations, transforms and inertias have in common: dtypes, batches, stacks, sums, equality."""

import copy
import functools
import itertools
import operator
import warnings
from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.interop import orders
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but

VECTORS = (js.SpatialForce, js.SpatialMomentum, js.SpatialVelocity, js.SpatialAcceleration)
vectors = pytest.mark.parametrize("kind", VECTORS)


def quantity(kind, batch_shape=(), of=np.asarray, dtype=np.float32, seed=0):
    """Numbers of size 1, none of them zero."""
    draw = np.random.default_rng(seed).standard_normal

    def array(*shape):
        return of(draw((*batch_shape, *shape)).astype(dtype))

    if kind is js.Rotation:
        return kind(array(9))
    if kind is js.RigidTransform:
        return kind(js.Rotation(array(9)), array(3))
    shapes = {js.SpatialInertia: ((), (3,), (6,)), js.ArticulatedInertia: ((6,), (9,), (6,))}.get(kind, ((3,), (3,)))
    return kind(*(array(*shape) for shape in shapes))


KINDS = (*VECTORS, js.Rotation, js.RigidTransform, js.SpatialInertia, js.ArticulatedInertia)
# All kinds are made of one class. By default one of two arrays, one that has another inside, and one of three arrays.
kinds = pytest.mark.parametrize("kind", slow_but((js.SpatialForce, js.RigidTransform, js.SpatialInertia), KINDS))


def leaves(x):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(x)]


def assert_same(x, y):
    assert type(x) is type(y)
    for a, b in zip(leaves(x), leaves(y), strict=True):
        np.testing.assert_array_equal(a, b, strict=True)


# -- float64 NumPy while 64-bit types are off -------------------------------------------------------------------------

FAR = np.array([1e8 + 1, 0, 0])


@kinds
def test_what_is_held_keeps_its_dtype(kind, x64):
    x = quantity(kind, (2,), dtype=np.float64)
    for held in (x, kind(*(getattr(x, name) for name in x.__dataclass_fields__)), copy.copy(x)):
        assert held.dtype == np.float64 and {leaf.dtype.name for leaf in leaves(held)} == {"float64"}
    assert kind.zero(dtype=np.float64).dtype == np.float64 if hasattr(kind, "zero") else True
    assert_same(js.stack([x.at_batch(0), x.at_batch(1)]), x)
    assert all(x == x)


def test_digits_survive_wherever_nothing_is_computed(x64):
    F = js.SpatialForce(FAR, np.zeros(3))
    x6 = np.concatenate((FAR, np.zeros(3)))
    columns = x6[:, None]
    moved = (
        F.to_array()[..., 0], js.SpatialForce.from_array(x6).tau[0], (F + F).tau[0] / 2, F.__neg__().__neg__().tau[0],
        orders.to_linear_first(F)[3], orders.from_linear_first(js.SpatialForce, x6).f[0],
        js.SpatialForce.from_array(columns.T).to_array().T[0, 0],
        orders.quaternion_to_xyzw(np.array([0.0, 1e8 + 1, 0, 0]))[0],
        orders.symmetric_from_diagonal_first(x6)[0],
    )  # fmt: skip
    assert [float(x) for x in moved] == [1e8 + 1] * 9
    assert sum(float(word[0]) for word in jax.tree.leaves(js.to_double_word(F).tau)) == 1e8 + 1
    np.testing.assert_array_equal(F.get_maximum_absolute_differences(js.SpatialForce.zero(dtype=np.float64))[0], FAR[0])
    R = js.Rotation.from_matrix(np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1.0]]))
    assert R.to_matrix()[0, 0] == 0.6 and R.inverse().to_matrix()[0, 1] == 0.8
    P = js.ArticulatedInertia(np.diag(FAR), np.zeros((3, 3)), np.eye(3))
    assert float(P.to_matrix()[0, 0]) == 1e8 + 1


NARROWING = {
    "shift": lambda F, G, p: js.shift(F, p),
    "offset": lambda F, G, p: js.shift(G, p),
    "dot": lambda F, G, p: js.dot(F, js.SpatialVelocity(p, p)),
    "scale": lambda F, G, p: (F * 2).tau,
    "scalar": lambda F, G, p: G * np.array(0.1),
    "add": lambda F, G, p: F + G,
    "beside": lambda F, G, p: js.SpatialForce(G.tau, p),
    "turn": lambda F, G, p: js.Rotation.exp(p),
    "rotate": lambda F, G, p: js.Rotation.identity().inverse() @ js.SpatialForce(G.tau, p),
    "axis": lambda F, G, p: js.central_axis(F),
    "sum": lambda F, G, p: js.stack([F, F]).sum(),
    "inertia": lambda F, G, p: js.shift(js.SpatialInertia(1.0, p, np.eye(3)), p),
    "inertias": lambda F, G, p: js.stack([js.SpatialInertia(1.0, p, np.eye(3))] * 2).sum(),
    "valid": lambda F, G, p: js.SpatialInertia(1.0, p, np.eye(3)).is_physically_valid(),
    "nearest": lambda F, G, p: js.SpatialInertia(1.0, p, np.eye(3)).nearest_valid(),
    "moments": lambda F, G, p: js.SpatialInertia(1.0, p, np.eye(3)).principal_moments(),
    "articulated": lambda F, G, p: js.ArticulatedInertia(np.eye(3), np.eye(3), np.eye(3)).shift(p),
    "transform": lambda F, G, p: js.RigidTransform(js.Rotation(np.eye(3).ravel() + 0.0), p) @ p,
    "compensated": lambda F, G, p: js.shift(F, p, precision="compensated"),
}


@pytest.mark.parametrize("operation", NARROWING.values(), ids=NARROWING)
def test_an_operation_that_narrows_says_so(operation):
    F, G, p = js.SpatialForce(FAR, np.zeros(3)), js.SpatialForce(jnp.ones(3), jnp.ones(3)), np.array([0.1, 0.2, 0.3])
    with pytest.raises(
        js.NarrowingWarning, match=r"64-bit types are off.*jax\.enable_x64\(True\).*\.astype\(np\.float32"
    ):
        operation(F, G, p)
    with pytest.warns(js.NarrowingWarning):
        found = operation(F, G, p)
    assert {leaf.dtype.name for leaf in leaves(found)} <= {"float32", "bool"}
    with jax.enable_x64(True):
        G = jax.tree.map(lambda x: np.asarray(x, np.float64), G)
        assert {leaf.dtype.name for leaf in leaves(operation(F, G, p))} <= {"float64", "bool"}


def test_it_is_said_once():
    F = js.SpatialForce(FAR, np.zeros(3))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("default")
        js.shift(F, FAR)
        js.shift(F, FAR)
        F.dot(js.SpatialVelocity(FAR, FAR))
    assert [w.category for w in said] == [js.NarrowingWarning]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        warnings.simplefilter("ignore", js.NarrowingWarning)
        js.shift(F, FAR)
    assert not said


def test_the_ways_out_are_ways_out():
    F = js.SpatialForce(FAR, np.zeros(3))
    assert js.shift(F.astype(np.float32), np.ones(3, np.float32)).dtype == np.float32
    with jax.enable_x64(True):
        assert js.shift(F, np.ones(3)).tau[0] == 1e8 + 1


def test_python_numbers_narrow_without_a_word():
    """They have no dtype, and neither has NumPy's float64 scalar, which is a Python float."""
    F = js.SpatialForce([0.1, 0.2, 0.3], [1, 2, 3]) * np.float64(0.1)
    assert js.shift(F, [0.1, 0, 0]).dtype == js.Rotation.about_x(np.float64(0.1)).dtype == np.float32


# -- numbers without a dtype, and messages about those that have one --------------------------------------------------


def test_python_integers_in_lists_are_numbers(x64):
    default = np.float64 if x64 else np.float32
    F = js.SpatialForce([0, 0, 3], [1, 2, 0])
    assert F.dtype == default and js.SpatialForce.from_array([1, 2, 3, 4, 5, 6]).f[2] == 6
    assert js.shift(F, [1, 0, 0]).dtype == default
    assert js.SpatialInertia(2, [0, 0, 1], np.eye(3, dtype=np.float16)).dtype == np.float16
    assert js.Rotation.from_quaternion([1, 0, 0, 0]).dtype == default and js.Rotation.about_z(0).dtype == default
    assert js.Components(1, 0, dtype=np.float16).dtype == np.float16
    mechanism = js.testing.random_mechanism(0, n=2, kinds=["revolute"], dtype=default)
    assert js.gravity_forces(mechanism, [0, 1]).dtype == default


@pytest.mark.parametrize("integers", [np.array([3, 1, 2]), np.uint8([3, 1, 2]), [*np.int32([3, 1, 2])]], ids=repr)
def test_integers_of_numpy_are_taken_as_a_list_is(integers, x64):
    """In the dtype of the arrays beside them, or else in JAX's default."""
    given = [3, 1, 2]
    for dtype in (None, np.float16):
        F = js.SpatialForce(f=[1.0, 2.0, 4.0]).astype(dtype)
        found, expected = (js.shift(F, x) for x in (integers, given))
        assert found.dtype == expected.dtype == F.dtype and (found == expected).all()
    found, expected = (js.SpatialForce(x, x) for x in (integers, given))
    assert found.dtype == expected.dtype and (found == expected).all()
    whole = np.eye(3, dtype=int)
    assert (js.Rotation.from_matrix(whole) == js.Rotation.identity()).all()
    assert (js.SpatialForce(given) * np.int64(2) == js.SpatialForce([6, 2, 4])).all()
    assert js.SpatialInertia(np.int64(2), np.arange(3), whole).dtype == (np.float64 if x64 else np.float32)


def test_advice_can_be_followed():
    for x, dtype in ((jnp.arange(3), None), (jnp.arange(3), np.float16)):
        with pytest.raises(TypeError, match=r"convert with \.astype\('float") as error:
            js.shift(js.SpatialForce.zero(dtype=dtype), x)
        advised = str(error.value).rpartition(".astype('")[2].rstrip("')")
        assert js.shift(js.SpatialForce.zero(dtype=dtype), x.astype(advised)).dtype == advised
    with pytest.raises(TypeError, match="got bool; write 1.0 for 1"):
        js.SpatialForce([True, False, True], [0.0, 0, 0])
    with pytest.raises(TypeError, match="Rotation and SpatialForce: expected one dtype, got Rotation: float16, Sp"):
        js.rotate(js.Rotation.identity(dtype=np.float16), quantity(js.SpatialForce))
    with pytest.raises(TypeError, match="Rotation and v: expected one dtype, got Rotation: float16, v: float32"):
        operator.matmul(js.Rotation.identity(dtype=np.float16), np.ones(3, np.float32))
    with pytest.raises(TypeError, match="expected floating point .*, got (float128|longdouble)"):
        js.SpatialForce(np.zeros(3, np.longdouble), np.zeros(3, np.longdouble))


@kinds
@pytest.mark.parametrize("of", [np.asarray, jnp.asarray])
def test_astype(kind, of):
    x = quantity(kind, (2,), of)
    for dtype in (np.float16, "bfloat16", jnp.float32, None, float):
        y = x.astype(dtype)
        expected = np.float32 if dtype in (None, float) else jnp.dtype(dtype)
        assert type(y) is kind and y.dtype == expected
        assert_same(y, jax.tree.map(lambda leaf: leaf.astype(expected), x))  # noqa: B023 - called here
    assert all(isinstance(leaf, type(of(0.0))) for leaf in jax.tree.leaves(x.astype(np.float16)))
    with pytest.raises(TypeError, match="dtype: expected float16, bfloat16, float32 or float64, got int32"):
        x.astype(np.int32)


def test_astype_of_components_and_double_words():
    F = js.SpatialForce(js.Components(0.0, 0.0, jnp.float32(0.1)), js.Components(1.0, 0.0, 0.0, dtype=np.float32))
    half = F.astype(np.float16)
    assert half.dtype == half.f.dtype == np.float16 and repr(half.tau).startswith("Components(0.0, 0.0")
    assert js.to_double_word(quantity(js.SpatialForce)).astype(np.float16).tau.hi.dtype == np.float16


# -- a scalar does not make a batch -----------------------------------------------------------------------------------


@pytest.mark.parametrize("operation", [operator.mul, operator.truediv, lambda F, s: s * F])
def test_a_batch_of_numbers_needs_a_batch_of_vectors(operation):
    one, many, s = quantity(js.SpatialForce), quantity(js.SpatialForce, (3,)), np.array([2, 3, 5], np.float32)
    message = r"SpatialForce \* or / scalar: expected a number, or one per vector of the batch of shape \(\), got shape"
    for scalar in (s, jnp.asarray(s), s[:1], [2.0, 3.0, 5.0]):
        with pytest.raises(ValueError, match=message + r".*jax\.vmap\(operator\.mul, in_axes=\(None, 0\)\)"):
            operation(one, scalar)
    with pytest.raises(ValueError, match=r"of shape \(3,\), got shape \(2, 3\)"):
        operation(many, np.ones((2, 3), np.float32))
    assert operation(many, s).batch_shape == operation(many, np.float32(2)).batch_shape == (3,)
    assert operation(quantity(js.SpatialForce, (4, 3)), s).batch_shape == (4, 3)
    assert operation(many.at_batch(np.s_[:, None]), s).batch_shape == (3, 3)
    assert_same(jax.vmap(operator.mul, in_axes=(None, 0))(one, s), js.stack([one * x for x in s]))


# -- equality ---------------------------------------------------------------------------------------------------------


@kinds
@pytest.mark.parametrize("of", [np.asarray, jnp.asarray])
def test_equal_numbers_are_equal(kind, of):
    x, y = quantity(kind, (2,), of), quantity(kind, (2,), of)
    np.testing.assert_array_equal(x == y, [True, True])
    np.testing.assert_array_equal(x != y, [False, False])
    for i, leaf in enumerate(jax.tree.leaves(x)):
        bumped = np.array(leaf)
        bumped[(1, *(-1,) * (leaf.ndim - 1))] *= 1 + np.finfo(np.float32).eps
        all_leaves = [of(bumped) if i == j else old for j, old in enumerate(jax.tree.leaves(x))]
        other = jax.tree.unflatten(jax.tree.structure(x), all_leaves)
        np.testing.assert_array_equal(x == other, [True, False])
        np.testing.assert_array_equal(x != other, [False, True])
    assert x.at_batch(0) == y.at_batch(0) and not x.at_batch(0) != y.at_batch(0)
    np.testing.assert_array_equal(jax.jit(operator.eq)(x, y.at_batch(0)), [True, False])


def test_equality_of_numbers_is_that_of_ieee():
    F = quantity(js.SpatialForce)
    nan = js.SpatialForce.nan(dtype=np.float32)
    assert not nan == nan and nan != nan
    assert -js.SpatialForce.zero() == js.SpatialForce.zero()
    assert js.to_double_word(F) == js.to_double_word(F)
    assert js.SpatialForce(js.Components(0.0, 0.0, F.tau[2]), F.f) == js.SpatialForce(
        F.tau * np.float32([0, 0, 1]), F.f
    )


def test_what_cannot_be_equal_says_so():
    F = quantity(js.SpatialForce)
    for other in (quantity(js.SpatialVelocity), F.to_array(), jnp.zeros(6), 0, 1.0):
        for compare in (operator.eq, operator.ne):
            for pair in ((F, other), (other, F)):
                with pytest.raises(TypeError, match="==: expected two of one kind, got Spatial(Force|Velocity) and"):
                    compare(*pair)
    with pytest.raises(TypeError, match="expected one dtype"):
        assert F == F.astype(np.float16)
    assert F != "x" and not F == object() and F not in (None, "x") and F in (None, F)


AS_ARRAY = {
    "np.asarray": np.asarray,
    "np.array": np.array,
    "of a list": lambda x: np.array([x, x]),
    "with a dtype": lambda x: np.asarray(x, np.float32),
    "np.stack": lambda x: np.stack([x, x]),
    "jnp.asarray": jnp.asarray,
    "jnp.array": jnp.array,
    "of a list in JAX": lambda x: jnp.array([x, x]),
}


@pytest.mark.parametrize("as_array", AS_ARRAY.values(), ids=AS_ARRAY)
@kinds
def test_what_is_no_array_says_how_to_make_one(kind, as_array):
    way = "to_array" if kind in VECTORS else "to_matrix"
    message = rf"asarray: expected an array, got {kind.__name__}; its numbers are x\.{way}\(\)"
    for of in (np.asarray, jnp.asarray):
        x = quantity(kind, (2,), of)
        with pytest.raises(TypeError, match=message):
            as_array(x)
        with pytest.raises(TypeError, match=message):
            jax.jit(lambda x: as_array(x))(x)
        assert getattr(x, way)().shape[0] == 2


@kinds
def test_to_jax_it_is_a_tree_all_the_same(kind):
    x = quantity(kind, (3,))
    assert_same(jax.jit(lambda x: x)(x), jax.tree.map(jnp.asarray, x))
    assert_same(jax.vmap(lambda x: x)(x), jax.device_put(x))
    assert_same(
        jax.lax.scan(lambda c, x: (x, c), x.at_batch(0), x)[1].at_batch(np.s_[1:]),
        jax.device_put(x).at_batch(np.s_[:2]),
    )
    assert_same(jax.tree.map(lambda *leaves: np.stack(leaves), x, x), js.stack([x, x]))
    assert_same(jax.device_get(jax.tree.map(jnp.asarray, x)), x)
    np.testing.assert_array_equal(*(leaves(y)[0] for y in (x, jax.device_put(x))))
    chex.assert_trees_all_equal(x, jax.device_get(jax.device_put(x)))
    assert jax.eval_shape(lambda x: x, x).batch_shape == (3,) and np.iterable(leaves(x))
    two = jnp.float32(2)
    if hasattr(kind, "__mul__"):
        assert_same(two * x, x * two)
        assert_same(operator.mul(np.float32(2), x), operator.mul(x, np.float32(2)))


@kinds
def test_equality_does_not_disturb_hashes_and_trees(kind):
    x, y = quantity(kind), quantity(kind)
    assert {x: 1, y: 2}[x] == 1 and len({x, y}) == 2
    assert jax.tree.structure(x) == jax.tree.structure(y)
    assert jax.jit(lambda a, b: a.dtype.itemsize, static_argnums=1)(x, y) == 4
    axes = jax.tree.map(lambda _: 0, x)
    assert axes == jax.tree.map(lambda _: 0, x) and axes != jax.tree.map(lambda _: 1, x) and axes != x
    many = js.stack([x, y])
    np.testing.assert_array_equal(jax.vmap(operator.eq, in_axes=(axes, None))(many, x), [True, True])


# -- rotation matrices ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "float32", "float64"])
def test_a_matrix_that_is_no_rotation_is_refused(dtype):
    with jax.enable_x64(True):
        R = np.array(js.Rotation.exp([0.3, -1.2, 0.7]).to_matrix())
        for of in (np.asarray, jnp.asarray):
            good = of(R.astype(jnp.dtype(dtype)))
            assert_same(js.Rotation.from_matrix(good), js.Rotation(good.reshape(9)))
            for bad, words in ((good * 2, "an entry of m m.T .* off"), (-good, "negative determinant")):
                with pytest.raises(ValueError, match=f"Rotation.from_matrix: m: expected rotation matrices, .*{words}"):
                    js.Rotation.from_matrix(bad)
                # While tracing, and in the constructor, numbers are taken as they are.
                assert_same(jax.jit(js.Rotation.from_matrix)(bad), js.Rotation(jnp.asarray(bad).reshape(9)))
    pose = np.eye(4, dtype=np.float32) * 2
    with pytest.raises(ValueError, match=r"expected rotation matrices, got at place 1 of 2 \[\[2\.0"):
        js.RigidTransform.from_matrix(np.stack([pose / 2, pose]))


def test_drift_and_nan_pass():
    drifted = (np.eye(3) + 1e-4 * np.random.default_rng(0).standard_normal((3, 3))).astype(np.float32)
    assert js.Rotation.from_matrix(drifted).entries[0] == drifted[0, 0]
    assert np.isnan(js.Rotation.from_matrix(np.full((2, 3, 3), np.nan, np.float32)).entries).all()
    assert js.Rotation.from_matrix(np.zeros((0, 3, 3), np.float32)).batch_shape == (0,)


# -- batches ----------------------------------------------------------------------------------------------------------

INDICES = {
    "int": 1, "negative": -1, "slice": slice(1, 3), "step": slice(None, None, 2), "pair": (2, 1), "column": np.s_[:, 0],
    "ellipsis": (..., 1), "new_axis": (None, 2), "list": [2, 0], "array": np.array([[0, 1]]),
    "mask": np.array([True, False, True]), "both": ([0, 1], [1, 0]), "empty": [],
}  # fmt: skip


@kinds
@pytest.mark.parametrize("index", INDICES.values(), ids=INDICES)
def test_items_of_a_batch(kind, index):
    x = quantity(kind, (3, 2))
    for of in (np.asarray, jnp.asarray):
        found = quantity(kind, (3, 2), of).at_batch(index)
        places = np.arange(6).reshape(3, 2)[index if not isinstance(index, list) else np.array(index, int)]
        assert found.batch_shape == places.shape
        for a, b in zip(leaves(found), leaves(x), strict=True):
            np.testing.assert_array_equal(a, b.reshape((6, *b.shape[2:]))[places], strict=True)
        assert all(isinstance(leaf, type(of(0.0))) for leaf in jax.tree.leaves(found))


@kinds
def test_there_is_no_item_behind_the_last(kind):
    for of in (np.asarray, jnp.asarray):
        x = quantity(kind, (3, 2), of)
        for index in (3, -4, (0, 2), (0, 0, 0), [3]):
            with pytest.raises(
                IndexError, match=rf"{kind.__name__}.at_batch: expected an index of a batch of shape \(3"
            ):
                x.at_batch(index)
        with pytest.raises(IndexError, match="of a batch of shape ()"):
            x.at_batch((0, 0)).at_batch(0)
    assert_same(jax.jit(lambda x, i: x.at_batch(i))(x, 2), jax.tree.map(jnp.asarray, x.at_batch(2)))


# Of JAX's arrays one axis: with NumPy's all axes cost next to nothing.
AXES = (0, 1, 2, -1, -3)
STACKED = [*((axis, np.asarray) for axis in AXES), (1, jnp.asarray)]


@kinds
@pytest.mark.parametrize(("axis", "of"), slow_but(STACKED, list(itertools.product(AXES, [np.asarray, jnp.asarray]))))
def test_stack(kind, axis, of):
    items = [quantity(kind, (3, 2), of, seed=i) for i in range(4)]
    stacked = js.stack(items, axis)
    place = axis % 3
    assert stacked.batch_shape == (*(3, 2)[:place], 4, *(3, 2)[place:])
    for i, x in enumerate(items):
        assert_same(stacked.at_batch((*[slice(None)] * place, i)), x)
    assert all(isinstance(leaf, type(of(0.0))) for leaf in jax.tree.leaves(stacked))
    assert_same(jax.jit(js.stack, static_argnums=1)(items, axis), jax.tree.map(jnp.asarray, stacked))


def test_stack_of_what_is_partly_known():
    C, z = js.Components, jnp.float32(0.5)
    F, G = js.SpatialForce(C(0.0, 0.0, z), C(z, z, 0.0)), js.SpatialForce(C(0.0, 0.0, 2 * z), C(z, z, 0.0))
    both = js.stack([F, G])
    assert repr(both.tau) == "Components(0.0, 0.0, float32[2])" and both.at_batch(1) == G
    other = js.stack([F, js.SpatialForce(C(z, 0.0, 0.0), jnp.ones(3))])
    np.testing.assert_array_equal(other.tau, [[0, 0, 0.5], [0.5, 0, 0]])
    pairs = js.stack([js.to_double_word(quantity(js.SpatialForce)), quantity(js.SpatialForce)])
    assert isinstance(pairs.tau, js.DoubleWord) and pairs.batch_shape == (2,)


def test_what_does_not_stack():
    F = quantity(js.SpatialForce)
    refused = {
        "expected at least one quantity": ([], ValueError),
        r"quantities\[1\]: expected a spatial vector or the like, got ndarray": ([F, F.tau], TypeError),
        r"one kind, got quantities\[0\]: SpatialForce, quantities\[1\]: SpatialV": (
            [F, quantity(js.SpatialVelocity)], TypeError
        ),
        r"equal batch shapes, got quantities\[0\]: \(\), quantities\[2\]: \(2,\)": (
            [F, F, quantity(js.SpatialForce, (2,))], ValueError
        ),
        r"one dtype, got quantities\[0\]: float32, quantities\[1\]: float16": ([F, F.astype("float16")], TypeError),
    }  # fmt: skip
    for message, (items, error) in refused.items():
        with pytest.raises(error, match=message):
            js.stack(items)
    for axis in (1, -2):
        with pytest.raises(ValueError, match=rf"stack: axis: expected one of a batch of shape \(1,\), got {axis}"):
            js.stack([F], axis)


# -- sums -------------------------------------------------------------------------------------------------------------


@vectors
def test_a_sum_is_over_one_axis(kind):
    x = kind(*(np.arange(36, dtype=np.float32).reshape(2, 3, 2, 3) + shift for shift in (0, 1)))
    for axis in (0, 1, 2, -1, -3):
        expected = kind(*(np.asarray(part).sum(axis % 3, dtype=np.float32) for part in x._vectors))
        for found in (x.sum(axis), jax.jit(kind.sum, static_argnums=1)(x, axis)):
            assert_same(found, expected)
    for axis in (3, -4):
        with pytest.raises(
            ValueError, match=rf"{kind.__name__}\.sum: axis: expected one of a batch of shape \(2, 3, 2"
        ):
            x.sum(axis)


PRECISIONS = ("fast", "reproducible", "compensated", "faithful")


@vectors
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_sum_of_nothing_and_of_one(kind, precision):
    for of in (np.asarray, jnp.asarray):
        assert not np.asarray(quantity(kind, (0, 2), of).sum(precision=precision).to_array()).any()
        one = quantity(kind, (1, 2), of)
        np.testing.assert_array_equal(one.sum(precision=precision).to_array(), one.at_batch(0).to_array())


CANCELLING = list(itertools.product([2, 7, 1000], ["float32", "float64"]))
USUAL = [(7, "float64"), (1000, "float32")]


@pytest.mark.parametrize(("n", "dtype"), slow_but(USUAL, CANCELLING))
def test_error_of_a_sum_that_cancels(n, dtype):
    """Against exact rationals, compiled, and of items in NumPy; what is left is 1e-9 of the terms."""
    dtype = np.dtype(dtype)
    u = Fraction(float(np.finfo(dtype).eps)) / 2
    rng = np.random.default_rng(n)
    half = rng.standard_normal((2, n // 2, 3)) * 10.0 ** rng.integers(-3, 4, (2, n // 2, 3))
    rest = rng.standard_normal((2, n - 2 * (n // 2), 3)) * 1e-6
    numbers = np.concatenate((half, -half * (1 + 1e-9), rest), 1).astype(dtype)
    levels = int(np.ceil(np.log2(n)))
    r = [[sum(map(Fraction, map(float, numbers[p, :, c]))) for c in range(3)] for p in range(2)]
    mag = [[sum(abs(Fraction(float(x))) for x in numbers[p, :, c]) for c in range(3)] for p in range(2)]
    with jax.enable_x64(True):
        F = js.SpatialForce(*numbers)
        for precision in PRECISIONS:
            summed = functools.partial(js.SpatialForce.sum, precision=precision)
            each = interpreted(jax.vmap(summed))(jax.tree.map(lambda x: x[None], F)).at_batch(0)
            for found in (jax.jit(summed)(F), each):
                for p, c in np.ndindex(2, 3):
                    exact, size = r[p][c], mag[p][c]
                    bound = {
                        "compensated": u * abs(exact) + 2 * levels**2 * u**2 * size,
                        "faithful": 2 * u * abs(exact) + n**2 * u**3 * size,
                    }.get(precision, levels * u * size)
                    assert abs(Fraction(float(found._vectors[p][c])) - exact) <= bound, (precision, p, c)


def test_the_default_sum_is_halved_in_the_same_order_everywhere():
    F = quantity(js.SpatialForce, (5, 100), jnp.asarray)
    found = F.sum()
    padded = np.concatenate([np.asarray(F.tau), np.full((3, 100, 3), -0.0, np.float32)])
    while len(padded) > 1:
        padded = padded[: len(padded) // 2] + padded[len(padded) // 2 :]
    np.testing.assert_array_equal(found.tau, padded[0])
    assert_same(jax.vmap(js.SpatialForce.sum, in_axes=1)(F), found)


def test_known_zeros_stay_known_in_a_sum():
    z, tz = np.zeros((4, 3), np.float32), jnp.arange(4, dtype=jnp.float32)
    text = jax.jit(lambda f: js.SpatialForce(z, f).sum().tau).lower(jnp.ones((4, 3))).as_text()
    assert "stablehlo.add" not in text
    summed = js.SpatialForce(js.Components(0.0, 0.0, tz), js.Components(2.0, 0.0, 0.0, dtype=np.float32)).sum()
    assert repr(summed.tau) == "Components(0.0, 0.0, Array(6.0))"
    np.testing.assert_array_equal(summed.f.to_array(), [8, 0, 0])
