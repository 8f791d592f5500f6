"""Arrays whose components stay apart give what arrays give, and what is known of them stays known."""

import itertools

import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxspatial as js
from tests.helpers.marks import slow_but
from tests.helpers.operation import violations
from tests.helpers.operations import DTYPES, NAIVE, OPERATIONS

C = js.Components
PRECISIONS = [str(p) for p in js.Precision]
BATCH = (3, 2)
# Per number of components, what is known of those of one array after another; None for data.
PATTERNS = {
    3: [(None, None, 0.0), (0.0, None, 1.0), (-1.0, None, 2.5), (0.0, 0.0, None), (None, None, None), (0.0, 0.0, 0.0)],
    6: [(None, 0.0, None, 0.0, 0.0, None), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (None, None, None, 0.0, 0.0, None)],
    9: [(None, None, 0.0, None, None, 0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0, None, None, 0.0, None, None)],
}
OF_ARRAYS = [name for name in NAIVE if not {"scalar", "coefficients"} & set(OPERATIONS[name].arguments.split())]
KEEPING = [name for name in OF_ARRAYS if OPERATIONS[name].bounds and name != "central_axis"]
SOME = ["shift_force", "shift_acceleration", "dot_force_velocity", "cross_force", "rotate", "compose_rotations",
        "act_velocity", "center_of_pressure"]  # fmt: skip
# All shapes of arguments and results, and all that is made of components one by one.
USUAL = [*SOME, "rotate_inertia", "to_matrix", "newton_euler_regressor", "articulated_shift",
         "wrench_from_point_forces", "sum", "central_axis", "motion_matrix", "stack", "at_batch", "equal",
         "is_approx"]  # fmt: skip

WHOLE_SUMS = [("float32", "compensated"), ("float64", "compensated"), ("float64", "faithful")]


def _inputs(name, dtype, batch=BATCH, seed=0):
    """(arguments of Components, the same of arrays), with the same numbers in them."""
    operation = OPERATIONS[name]
    start = sum(map(ord, name)) + seed
    apart, whole = [], []
    leaves = jax.tree.leaves(operation.inputs(batch, dtype, seed))
    for i, (leaf, shape) in enumerate(zip(leaves, operation.shapes, strict=True)):
        if not shape:
            apart.append(jnp.asarray(leaf))
            whole.append(leaf)
            continue
        patterns = PATTERNS[leaf.shape[-1]]
        # Some have data in any case, and so a batch.
        has_data = i == 0 or len(shape) > 1
        known = patterns[0 if has_data else (start + i) % len(patterns)]
        apart.append(C.from_array(jnp.asarray(leaf), known))
        whole.append(
            np.stack([leaf[..., k] if c is None else np.full_like(leaf[..., k], c) for k, c in enumerate(known)], -1)
        )
    return operation.build(apart), operation.build(whole)


def _assert_same(result, expected):
    """Number for number; -0 is 0."""
    leaves = jax.tree.leaves(js.from_components(result))
    for leaf, x in zip(leaves, expected, strict=True):
        assert leaf.dtype == x.dtype
        np.testing.assert_array_equal(np.broadcast_to(leaf, x.shape), x)


# -- values -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but(USUAL, OF_ARRAYS))
def test_values_are_those_of_arrays(name):
    """Compiled; some are called outside of a program too."""
    apart, whole = _inputs(name, "float32")
    expected = OPERATIONS[name].naive(*whole)
    function = OPERATIONS[name].function
    for run in (jax.jit(function), function) if name in SOME else (jax.jit(function),):
        _assert_same(run(*apart), expected)


@pytest.mark.parametrize("dtype", [dtype for dtype in DTYPES if dtype != "float32"])
@pytest.mark.parametrize("name", slow_but(["shift_force", "rotate"], SOME))
def test_values_of_every_dtype_under_vmap(name, dtype):
    with jax.enable_x64(True):
        apart, whole = _inputs(name, dtype)
        _assert_same(jax.vmap(OPERATIONS[name].function)(*apart), OPERATIONS[name].naive(*whole))


@pytest.mark.parametrize(("dtype", "precision"), WHOLE_SUMS)
@pytest.mark.parametrize("name", slow_but(["shift_force", "rotate"], SOME))
def test_bounds_of_whole_sums(name, dtype, precision):
    operation = OPERATIONS[name]
    with jax.enable_x64(dtype == "float64"):
        apart, whole = _inputs(name, dtype)
        leaves = jax.tree.leaves(js.from_components(operation.function(*apart, precision=precision)))
    exact = operation.sized(*whole)
    for leaf, x, bound in zip(leaves, exact, operation.bounds, strict=True):
        assert not violations(bound, precision, np.broadcast_to(leaf, x.shape), x, flushed=4).any()


@pytest.mark.parametrize("name", ["shift_force", "act_velocity", "dot_force_velocity"])
def test_one_item_is_shared_by_a_batch(name):
    apart, whole = _inputs(name, "float32")
    one, one_whole = _inputs(name, "float32", (), seed=1)
    result = OPERATIONS[name].function(apart[0], one[1])
    _assert_same(result, OPERATIONS[name].naive(whole[0], one_whole[1]))


def test_a_known_number_is_rounded_to_the_dtype():
    assert C(jnp.float16(1), 0.1).components[1] == np.float16(0.1)
    assert np.isinf(C(jnp.float16(1), 1e6).components[1])


# -- what is known ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", slow_but([n for n in KEEPING if n in USUAL], KEEPING))
def test_structure_depends_neither_on_precision_nor_on_where_it_is_called(name):
    apart, _ = _inputs(name, "float32", ())
    function = OPERATIONS[name].function
    structures = {
        jax.tree.structure(jax.eval_shape(lambda *x, p=p: function(*x, precision=p), *apart)) for p in PRECISIONS
    }
    assert structures == {jax.tree.structure(function(*apart))}


def test_what_lies_in_the_plane_stays_there():
    x, y, z = jnp.float32([0.3, -1.7, 2.9])
    plane, normal = C(x, y, 0.0), C(0.0, 0.0, z)
    X = js.RigidTransform(js.Rotation(C(x, -y, 0.0, y, x, 0.0, 0.0, 0.0, 1.0)), plane)
    F, V, A = js.SpatialForce(normal, plane), js.SpatialVelocity(normal, plane), js.SpatialAcceleration(normal, plane)
    for before, after in (
        (F, js.shift(F, plane)), (V, js.shift(V, plane)), (A, js.shift(A, plane, normal)), (F, js.cross(V, F)),
        (F, X.rotation @ F), (F, js.act(X, F)), (V, js.act_inverse(X, V)), (A, js.act(X, A, normal)), (X, X @ X),
        (X, X.inverse()), (F, F + F), (F, F * 2.0), (F, x * F), (F, -F), (plane, X @ plane),
        (V, V.compose_with_moving_frame(plane, V)),
    ):  # fmt: skip
        assert jax.tree.structure(after) == jax.tree.structure(before)


def test_numpy_beside_is_known_where_it_is_zero_or_one():
    F = js.SpatialForce(C(0.0, 0.0, jnp.float32(3)), C(jnp.float32(1), jnp.float32(2), 0.0))
    offset = np.float32([2.0, 1.0, 0.0])
    for shift in (js.shift, jax.jit(lambda F, p: js.shift(F, offset))):
        assert repr(shift(F, offset).tau) == "Components(0.0, 0.0, Array(0.0))"
    assert jax.tree.leaves(js.shift(F, jnp.asarray(offset)).tau).__len__() == 3


def test_known_numbers_are_computed_now():
    a, b = C(2.0, 0.0, 3.0), C(0.0, 4.0, 5.0)
    for precision in PRECISIONS:
        moved = js.shift(js.SpatialVelocity(a, C(0.5, 0.0, 0.0)), b, precision=precision)
        assert repr(moved.v) == "Components(-11.5, -10.0, 8.0)"
    for result, shown in (
        (a + b, "2.0, 4.0, 8.0"),
        (a * 2.0, "4.0, 0.0, 6.0"),
        (abs(-a), "2.0, 0.0, 3.0"),
        (3.0 - a, "1.0, 3.0, 0.0"),
        (b / a, "0.0, inf, 1.6666666269302368"),
    ):
        assert repr(result) == f"Components({shown})"


@pytest.mark.parametrize(
    ("bad", "precision"),
    slow_but(
        [(np.inf, "reproducible"), (np.inf, "faithful"), (np.nan, "compensated")],
        list(itertools.product([np.inf, np.nan], PRECISIONS)),
    ),
)
def test_a_known_zero_is_exact_beside_infinity_and_nan(bad, precision):
    x = jnp.float32(bad)
    one = jnp.float32(1)
    F = js.SpatialForce(C(0.0, 0.0, one), C(x, one, 0.0))
    assert repr(js.shift(F, C(one, one, 0.0), precision=precision).tau).startswith("Components(0.0, 0.0, Array(")
    R = js.Rotation(C(one, 0.0, 0.0, 0.0, one, -one, 0.0, one, one))
    turned = js.rotate(R, js.SpatialForce(C(x, one, one), C(one, one, one)), precision=precision)
    np.testing.assert_array_equal(turned.tau.to_array()[1:], [0, 2])
    V = js.SpatialVelocity(C(one, one, one), C(0.0, one, one))
    assert js.dot(js.SpatialForce(C(0.0, 0.0, one), C(x, one, 0.0)), V, precision=precision) == 2


# -- as a tree --------------------------------------------------------------------------------------------------------


def test_leaves_are_the_data():
    x = C(jnp.zeros(4, np.float32), 0.0, jnp.ones((), np.float32))
    assert [leaf.shape for leaf in jax.tree.leaves(x)] == [(4,), (4,)]
    paths = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(x)]
    assert paths == ["[0]", "[2]"]
    assert jax.tree.leaves(C(1.0, 2.0)) == []


def test_structures_compare():
    def structure(*components):
        return jax.tree.structure(C(*components))

    x = jnp.float32(1)
    assert structure(x, 0.0) == structure(x + 1, -0.0) and hash(structure(x, 0.0)) == hash(structure(x, -0.0))
    assert structure(x, np.nan) == structure(x, float("nan")) and hash(structure(np.nan)) == hash(structure(-np.nan))
    assert structure(x, 0.0) != structure(x, 1.0) != structure(x, x)
    assert structure(0.0) == structure(np.float32(0)) != jax.tree.structure(C(0.0, dtype=np.float16))


@pytest.mark.parametrize(
    "leaf",
    [None, object(), "x", 0, jax.ShapeDtypeStruct((2,), np.float32)],
    ids=lambda leaf: type(leaf).__name__,
)
def test_a_tree_is_rebuilt_of_anything(leaf):
    leaves, structure = jax.tree.flatten(js.SpatialForce(C(jnp.float32(1), 0.0, 0.0), C(jnp.float32(1), 0.0, 0.0)))
    rebuilt = jax.tree.unflatten(structure, [leaf] * len(leaves))
    assert all(x is leaf for x in jax.tree.leaves(rebuilt, is_leaf=lambda x: x is None))
    repr(rebuilt)


def test_conversion_of_leaves_converts_what_is_known():
    x = jax.tree.map(lambda leaf: leaf.astype(np.float16), C(jnp.float32(0.1), 0.1))
    assert x.dtype == np.float16 and all(c.dtype == np.float16 for c in x.components)
    assert x.astype(np.float32).dtype == C(0.1, 0.2).astype(np.float32).dtype == np.float32


def test_leaves_that_are_numpy_are_data():
    x = jax.device_get(C(jnp.zeros(2, np.float32), 1.0))
    assert all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(x))
    doubled = jax.jit(lambda: x + x)()
    assert jax.tree.structure(doubled).num_leaves == 1 and repr(doubled) == "Components(float32[2], 2.0)"


def test_a_scan_carries_the_structure_and_refuses_another():
    F = js.SpatialForce(C(0.0, 0.0, jnp.float32(1)), C(jnp.float32(1), jnp.float32(2), 0.0))
    p = C(jnp.float32(1), jnp.float32(0.5), 0.0)
    last, _ = lax.scan(lambda F, _: (js.shift(F, p), None), F, length=3)
    assert repr(last) == repr(js.shift(js.shift(js.shift(F, p), p), p))
    with pytest.raises(TypeError, match="scan"):
        lax.scan(lambda F, _: (js.shift(F, C(0.0, 0.0, jnp.float32(1))), None), F, length=3)


def test_vmap_maps_over_the_batch():
    x, y = jnp.arange(6, dtype=np.float32).reshape(2, 3), jnp.ones((2, 3), np.float32)
    p = C(x, y, 0.0)
    squared = jax.vmap(jax.vmap(lambda p: js.dot(*_paired(p))))(p)
    np.testing.assert_array_equal(squared, x * x + y * y)
    np.testing.assert_array_equal(jax.vmap(lambda p: p.components[0], in_axes=-1)(p), x.T)
    F = js.SpatialForce(p, js.Components(0.0, 0.0, 1.0))
    for axes in (0, js.SpatialForce(0, None)):
        moved = jax.vmap(js.shift, in_axes=(axes, None))(F, C(1.0, 2.0, 3.0))
        assert repr(moved.tau) == "Components(float32[2,3], float32[2,3], 0.0)"
        np.testing.assert_array_equal(moved.tau.to_array(), js.shift(F, C(1.0, 2.0, 3.0)).tau.to_array())


def _paired(p):
    zero = C(0.0, 0.0, 0.0)
    return js.SpatialForce(zero, p), js.SpatialVelocity(zero, p)


@pytest.mark.parametrize("precision", slow_but(["reproducible", "compensated"], PRECISIONS))
def test_derivatives(precision):
    x, y, z, a, b = jnp.float32([0.3, -1.7, 2.9, 1.1, 0.7])

    def power(F, p, V):
        return js.dot(js.shift(F, p, precision=precision), V, precision=precision)

    def of(planar, normal):
        return js.SpatialForce(normal(z), planar(x, y)), planar(a, b), js.SpatialVelocity(normal(b), planar(y, z))

    apart = of(lambda p, q: C(p, q, 0.0), lambda n: C(0.0, 0.0, n))
    whole = of(lambda p, q: jnp.stack([p, q, 0 * p]), lambda n: jnp.stack([0 * n, 0 * n, n]))
    gradients = [jax.grad(power, argnums=(0, 1, 2))(*args) for args in (apart, whole)]
    assert jax.tree.structure(gradients[0]) == jax.tree.structure(apart)
    for one, other in zip(*map(_parts, gradients), strict=True):
        for c, d in zip(one.components, other, strict=True):
            assert isinstance(c, np.generic) or abs(c - d) <= 4 * np.finfo(np.float32).eps * abs(d)
    _, tangent = jax.jvp(lambda F: js.shift(F, apart[1], precision=precision), apart[:1], apart[:1])
    assert jax.tree.structure(tangent) == jax.tree.structure(apart[0])
    assert repr(tangent) == repr(js.shift(apart[0], apart[1], precision=precision))


def _parts(gradient):
    F, p, V = gradient
    return F.tau, F.f, p, V.w, V.v


def test_exported_and_back():
    x = C(jnp.float32(1), 0.0, -np.inf, np.nan)
    exported = jax.export.export(jax.jit(lambda x: x + x))(x)
    result = jax.export.deserialize(exported.serialize(vjp_order=0)).call(x)
    assert repr(result) == "Components(Array(2.0), 0.0, -inf, nan)"
    assert jax.tree.structure(result) == jax.tree.structure(x + x)


# -- double words -----------------------------------------------------------------------------------------------------


def test_with_double_words_data_are_double_words():
    F = js.SpatialForce(C(0.0, 0.0, jnp.float32(2.9)), C(jnp.float32(0.3), jnp.float32(-1.7), 0.0))
    p = C(jnp.float32(1.1), jnp.float32(0.7), 0.0)
    exact = js.shift(js.to_double_word(js.from_components(F)), p.to_array()).tau[2]
    for result in (js.shift(js.to_double_word(F), p), js.shift(F, js.to_double_word(p.to_array()))):
        z = result.tau.components[2]
        assert isinstance(z, js.DoubleWord) and z == exact and z.lo != 0
    back = js.from_double_word(js.shift(js.to_double_word(F), p))
    assert jax.tree.structure(back) == jax.tree.structure(F)
    assert isinstance(p.to_array() + js.to_double_word(p), C)


def test_components_of_double_words():
    x = js.to_double_word(jnp.float32([1.0, 2.0])) / 3.0
    y = C(x, 1.0, jnp.float32(2)) * js.to_double_word(jnp.ones((1,), np.float32))
    assert repr(y) == "Components(DoubleWord(float32[2]), 1.0, float32[2])" or isinstance(y.to_array(), js.DoubleWord)

    def operations(a):
        return [a + a, a - 1.0, 2.0 / a, -abs(a), a * a]

    both = jax.jit(lambda x: (operations(x), [y.components[0] for y in operations(C(x, 0.5))]))(x)
    for expected, result in zip(*both, strict=True):
        assert bool((expected == result).all())


# -- as an array ------------------------------------------------------------------------------------------------------

X = np.random.default_rng(0).standard_normal((2, 4, 3)).astype(np.float32)
X[..., 1] = 0.5
PLANE = C.from_array(jnp.asarray(X), (None, 0.5, None))


INDICES = [
    *(0, (1, 2), (..., 0), (..., 1), (..., -1), (0, ..., 1), (..., slice(1, None)), (..., [2, 1]), (slice(None), 1)),
    *((1, 2, 1), np.array([1, 0]), (..., None), (0, None), Ellipsis, (..., slice(None, None, -1)), X[..., 0] > 0),
    (np.array([1]), 0, [1]),
]


@pytest.mark.parametrize("index", INDICES, ids=str)
def test_index(index):
    result = PLANE[index]
    assert result.shape == X[index].shape
    np.testing.assert_array_equal(np.asarray(result), X[index])


def test_what_an_index_of_the_batch_leaves_is_known():
    assert repr(PLANE[0]) == "Components(float32[4], 0.5, float32[4])" and isinstance(PLANE[..., 1], np.ndarray)
    assert [row.shape for row in PLANE] == [(4, 3)] * 2 and len(PLANE) == 2
    np.testing.assert_array_equal([float(c) for c in C(jnp.float32(1), 2.0)], [1, 2])


def test_shapes():
    assert (PLANE.shape, PLANE.ndim, PLANE.dtype) == ((2, 4, 3), 3, np.float32)
    assert isinstance(PLANE.reshape(8, 3), C) and PLANE.reshape((8, 3)).shape == (8, 3)
    assert PLANE.reshape((2, 12)).shape == (2, 12) and C(1.0, 2.0).reshape((1, 2)).shape == (2,)
    np.testing.assert_array_equal(PLANE.to_array(), X)
    assert C(1.0, 2.0).to_array((5,)).shape == (5, 2) and C(1.0, 2.0)[..., 0, :].shape == (2,)
    tree = js.from_components({"p": PLANE, "n": 3})
    np.testing.assert_array_equal(tree["p"], X)
    assert tree["n"] == 3


OPERATORS = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
}


@pytest.mark.parametrize("operator", OPERATORS.values(), ids=OPERATORS)
@pytest.mark.parametrize(
    "other", [X[0], X[..., :1], np.float32(3), np.float32([0, 1, -1]), X[0, 0, 0] * np.ones(())], ids=np.shape
)
def test_operators(operator, other):
    other = np.asarray(other, np.float32)[()]
    with np.errstate(divide="ignore"):
        for expected, given in ((operator(X, other), (PLANE, other)), (operator(other, X), (other, PLANE))):
            array = given if isinstance(other, np.generic) else [jnp.asarray(x) if x is other else x for x in given]
            for result in (operator(*given), operator(*array)):
                assert isinstance(result, C)
                np.testing.assert_array_equal(np.asarray(result), expected)


def test_operators_of_two_and_of_numbers():
    np.testing.assert_array_equal(np.asarray(PLANE * 3.0 - PLANE), X * np.float32(3) - X)
    np.testing.assert_array_equal(np.asarray(1 / abs(-PLANE)), 1 / abs(X))
    assert repr(PLANE * 0.0) == "Components(0.0, 0.0, 0.0)"


def test_spatial_vectors_compare():
    F = js.SpatialForce(C(0.0, 0.0, 0.0), PLANE[0])
    assert F.batch_shape == (4,) and F.to_array().shape == (4, 6) and F.dtype == np.float32
    assert bool(F.is_approx(F).all()) and F.is_approx(F).shape == (4,)
    rotational, translational = (F - F * 2.0).get_maximum_absolute_differences(js.SpatialForce.zero(4, np.float32))
    np.testing.assert_array_equal(rotational, np.zeros(4))
    np.testing.assert_array_equal(translational, abs(X[0]).max(-1))
    single = jax.tree.map(lambda leaf: leaf[0], F)
    assert [float(single[i]) for i in range(6)] == [0, 0, 0, *X[0, 0]]


def test_repr():
    assert repr(C(jnp.float32(1.5), 0.0)) == "Components(Array(1.5), 0.0)"
    assert repr(jax.eval_shape(lambda x: C(x, 0.0), jnp.float32(1))) == "Components(float32[], 0.0)"


# -- what is refused --------------------------------------------------------------------------------------------------

F32, F16 = jnp.float32(1), jnp.float16(1)
FLOATS = "float16, bfloat16, float32 or float64"
BATCHES = "expected batch shapes that broadcast, got component 0: (2,), component 1: (3,)"
REFUSED = {
    "none": (lambda: C(), ValueError, "Components: expected at least one component, got none"),
    "integer": (
        lambda: C(F32, jnp.int32(0)),
        TypeError,
        f"Components: component 1: expected floating point ({FLOATS})",
    ),
    "string": (lambda: C("x"), TypeError, f"Components: component 0: expected an array of floating point ({FLOATS})"),
    "nested": (lambda: C(C(0.0)), TypeError, "component 0: expected an array (*batch,), a DoubleWord or a float, got"),
    "dtypes": (lambda: C(F32, F16), TypeError, "component 0 and component 1: expected one dtype, got component 0: f"),
    "number": (lambda: C(F32, np.float16(0)), TypeError, "component 1: float16; convert with .astype"),
    "named": (lambda: C(F32, 0.0, dtype=np.float16), TypeError, "got component 0: float32, dtype: float16"),
    "batches": (lambda: C(jnp.zeros(2), jnp.zeros(3)), ValueError, f"component 0 and component 1: {BATCHES}"),
    "known": (lambda: C.from_array(X, (None, 0.0)), ValueError, "from_array: x: expected shape (*batch, 2), got"),
    "size": (lambda: PLANE + X[..., :2], ValueError, "other: expected shape (*batch, 3) or (*batch, 1), got (2, 4, 2)"),
    "other": (lambda: PLANE + F16, TypeError, "Components and other: expected one dtype, got Components: float32"),
    "vector": (
        lambda: js.SpatialForce(C(F32, 0.0), PLANE),
        ValueError,
        "SpatialForce: tau: expected shape (*batch, 3)",
    ),
    "parts": (lambda: js.SpatialForce(C(F32, 0.0, 0.0), PLANE), ValueError, "expected equal batch shapes"),
    "offset": (lambda: js.shift(js.SpatialForce(PLANE, PLANE), C(F16, 0.0, 0.0)), TypeError, "p_PQ_E: float16"),
    "operator": (lambda: PLANE + "x", TypeError, "unsupported operand"),
    "jax": (lambda: jnp.sin(PLANE), TypeError, "sin requires ndarray or scalar arguments, got"),
}


@pytest.mark.parametrize(("call", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(call, error, message):
    with pytest.raises(error) as raised:
        call()
    assert message in str(raised.value)
