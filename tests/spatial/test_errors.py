"""Bad input gets one clear message that names the argument, what was expected and what came; bad numbers get none.

Shapes, dtypes and kinds are refused the same way eagerly and while tracing. NaN, infinities and zeros pass, as data and
as numbers known while tracing.
"""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.marks import slow_but
from tests.helpers.operations import NAIVE, OPERATIONS, REPRESENTATIVES, SUMS

FLOATS = "float16, bfloat16, float32 or float64"
FIELDS = {
    js.SpatialForce: ("tau", "f"),
    js.SpatialMomentum: ("h", "l"),
    js.SpatialVelocity: ("w", "v"),
    js.SpatialAcceleration: ("alpha", "a"),
}
kinds_and_fields = pytest.mark.parametrize(
    ("kind", "i"), [(kind, i) for kind in FIELDS for i in (0, 1)], ids=lambda x: getattr(x, "__name__", str(x))
)


def zeros(*shape, dtype=np.float32):
    return np.zeros(shape, dtype)


def of(kind, *batch_shape, dtype=np.float32):
    return kind(zeros(*batch_shape, 3, dtype=dtype), zeros(*batch_shape, 3, dtype=dtype))


F, L, V, A = (of(kind) for kind in FIELDS)
F2, F4, V4 = of(js.SpatialForce, 2), of(js.SpatialForce, 4), of(js.SpatialVelocity, 4)
F16 = of(js.SpatialForce, dtype=np.float16)
P3, P3_16, P4 = zeros(3), zeros(3, dtype=np.float16), zeros(4, 3)

NOT_NUMBERS = {
    "string": ("abc", "str 'abc'"),
    "strings": (["1", "2", "3"], "list ['1', '2', '3']"),
    "none_in_list": ([1.0, None, 2.0], "list [1.0, None, 2.0]"),
    "none_beside_arrays": ([jnp.float32(1), None, 2.0], "list [Array(1., dtype=float32), None, 2.0]"),
    "complex_list": ([1j, 0, 0], "list [1j, 0, 0]"),
    "complex_array": (np.zeros(3, np.complex64), "complex64"),
    "complex_jax": (jnp.zeros(3, jnp.complex64), "complex64"),
    "ragged": ([[1.0, 2.0, 3.0], [1.0]], "list [[1.0, 2.0, 3.0], [1.0]]"),
    "ragged_arrays": ([jnp.zeros(3), jnp.zeros(2)], "list [Array([0., 0., 0.], dtype=float32), Array([0., 0.]"),
    "dict": ({"x": 1.0}, "dict {'x': 1.0}"),
    "object_array": (np.array([1.0, None, 2.0], object), "object"),
    "string_array": (np.array(["a", "b", "c"]), "<U1"),
    "vector": (F, "SpatialForce SpatialForce(tau=[0.0, 0.0, 0.0], f=[0.0, 0.0, 0.0])"),
    "integer_jax": (jnp.arange(3), "int32"),
    "integers_jax": ([jnp.int32(1), 2, 3], "int32"),
    "booleans": ([True, False, True], "bool"),
    "boolean_array": (np.ones(3, bool), "bool"),
    "booleans_and_integers": ([True, 2, 3], "int64"),
    "eight_bits": (np.ones(3, jnp.float8_e4m3fn), "float8_e4m3fn"),
    "eight_bits_jax": (jnp.ones(3, jnp.float8_e4m3fn), "float8_e4m3fn"),
    "key": (jax.random.key(0), "key<fry>"),
}
not_numbers = pytest.mark.parametrize(("bad", "shown"), NOT_NUMBERS.values(), ids=NOT_NUMBERS)


@not_numbers
@kinds_and_fields
def test_parts_are_floating_point(kind, i, bad, shown):
    parts = [P3, P3]
    parts[i] = bad
    _raises(
        TypeError, lambda: kind(*parts), f"{kind.__name__}: {FIELDS[kind][i]}: expected ", f"({FLOATS}), got {shown}"
    )


@pytest.mark.parametrize("bad", [zeros(2), zeros(), zeros(0), zeros(3, 1), zeros(6), 1.0, [1.0, 2.0]], ids=str)
@kinds_and_fields
def test_parts_end_in_three(kind, i, bad):
    parts = [P3, P3]
    parts[i] = bad
    expected = f"{kind.__name__}: {FIELDS[kind][i]}: expected shape (*batch, 3), got {np.shape(bad)}"
    _raises(ValueError, lambda: kind(*parts), expected)


@pytest.mark.parametrize("kind", FIELDS)
def test_parts_have_one_dtype_and_one_batch_shape(kind):
    first, second = (f"{kind.__name__}: {name}" for name in FIELDS[kind])
    _raises(
        TypeError, lambda: kind(P3, P3_16), "expected one dtype", f"got {first}: float32, {second}: float16", "astype"
    )
    _raises(
        ValueError,
        lambda: kind(P4, P3),
        f"{kind.__name__}: expected equal batch shapes",
        f"{first}: (4,), {second}: ()",
    )
    _raises(ValueError, lambda: kind(P4, zeros(1, 3)), "expected equal batch shapes", f"{first}: (4,), {second}: (1,)")


VECTOR_ARGUMENTS = {
    "shift: p_PQ_E": lambda x: js.shift(F, x),
    "shift: w": lambda x: js.shift(A, P3, x),
    "center_of_pressure: normal": lambda x: js.center_of_pressure(F, x),
    "wrench_from_point_forces: points": lambda x: js.wrench_from_point_forces(x, zeros(1, 3)),
    "wrench_from_point_forces: forces": lambda x: js.wrench_from_point_forces(zeros(1, 3), x),
}
vector_arguments = pytest.mark.parametrize(("name", "call"), VECTOR_ARGUMENTS.items(), ids=VECTOR_ARGUMENTS)


@not_numbers
@vector_arguments
def test_arguments_are_floating_point(name, call, bad, shown):
    _raises(TypeError, lambda: call(bad), f"{name}: expected ", f"({FLOATS}), got {shown}")


@vector_arguments
def test_arguments_end_in_three(name, call):
    for shape in ((2,), (5, 1), ()):
        _raises(
            ValueError, lambda shape=shape: call(zeros(*shape)), f"{name}: expected shape (*batch", f"3), got {shape}"
        )


@vector_arguments
def test_arguments_have_the_dtype_of_the_vector(name, call):
    argument = name.split(": ")[1]
    _raises(
        TypeError, lambda: call(zeros(1, 3, dtype=np.float16)), "expected one dtype", f"{argument}: float16", "astype"
    )


FORCES = "a SpatialForce or SpatialMomentum"
KINDS = "a spatial vector or inertia"
# (call, operation, expected, got)
WRONG_KINDS = [
    (lambda: js.dot(F, F), "dot", "a SpatialVelocity beside a SpatialForce", "SpatialForce"),
    (lambda: L.dot(F), "dot", "a SpatialVelocity beside a SpatialMomentum", "SpatialForce"),
    (lambda: js.dot(F, A), "dot", "a SpatialVelocity beside a SpatialForce", "SpatialAcceleration"),
    (lambda: js.dot(F, P3), "dot", "a SpatialVelocity beside a SpatialForce", "ndarray"),
    (lambda: js.dot(V, V), "dot", f"{FORCES} beside a velocity", "SpatialVelocity"),
    (lambda: js.dot(A, F), "dot", f"{FORCES} and a SpatialVelocity", "SpatialAcceleration"),
    (lambda: js.dot(P3, F), "dot", f"{FORCES} and a SpatialVelocity", "ndarray"),
    (lambda: F + V, "add", "two of one kind", "SpatialForce and SpatialVelocity"),
    (lambda: V - A, "sub", "two of one kind", "SpatialVelocity and SpatialAcceleration"),
    (lambda: F.is_approx(V), "comparison", "two of one kind", "SpatialForce and SpatialVelocity"),
    (lambda: F.is_approx(1.0), "comparison", "two of one kind", "SpatialForce and float"),
    (lambda: js.cross(F, V), "cross", "a SpatialVelocity first", "SpatialForce"),
    (lambda: js.cross(A, V), "cross", "a SpatialVelocity first", "SpatialAcceleration"),
    (lambda: js.cross(V, P3), "cross", "one of the four spatial vectors as second", "ndarray"),
    (lambda: js.shift(1.0, P3), "shift", KINDS, "float"),
    (lambda: js.shift(None, P3), "shift", KINDS, "NoneType"),
    (lambda: js.shift(P3, P3), "shift", KINDS, "ndarray"),
    (lambda: js.shift(F, None), "shift: p_PQ_E", f"an array of floating point ({FLOATS})", "NoneType None"),
    (lambda: js.central_axis(V), "central_axis", "a SpatialForce", "SpatialVelocity"),
    (lambda: js.center_of_pressure(L), "center_of_pressure", "a SpatialForce", "SpatialMomentum"),
]


@pytest.mark.parametrize(("call", "operation", "expected", "got"), WRONG_KINDS)
def test_wrong_kind(call, operation, expected, got):
    _raises(TypeError, call, f"{operation}: expected {expected}, got {got}")


NO_OPERATORS = {
    "add_number": lambda: F + 1.0,
    "number_add": lambda: 1.0 + F,
    "add_array": lambda: F + P3,
    "array_add": lambda: P3 + F,
    "jax_array_subtract": lambda: jnp.zeros(3) - F,
    "multiply_vectors": lambda: F * V,
    "divide_by_vector": lambda: 1.0 / F,
    "power": lambda: F**2,
}


@pytest.mark.parametrize("call", NO_OPERATORS.values(), ids=NO_OPERATORS)
def test_operators_that_have_no_meaning_name_the_kind(call):
    _raises(TypeError, call, "SpatialForce")


@pytest.mark.parametrize("mark", [0, None, jax.sharding.PartitionSpec("x")], ids=["axis", "None", "spec"])
@pytest.mark.parametrize("kind", FIELDS)
def test_a_mark_of_a_tree_beside_numbers_is_a_mistake(kind, mark):
    for parts in ((mark, P3), (P3, mark)):
        with pytest.raises((TypeError, ValueError), match=rf"{kind.__name__}: \w+: expected"):
            kind(*parts)


def test_python_sums_vectors():
    np.testing.assert_array_equal(np.asarray(sum([F, F, F]).to_array()), np.asarray((F * 3).to_array()))


def test_an_acceleration_cannot_do_without_w():
    message = "shift: expected w, the angular velocity of the body, (*batch, 3), for a SpatialAcceleration"
    _raises(TypeError, lambda: js.shift(A, P3), message)
    _raises(TypeError, lambda: A.shift(P3), message)


@pytest.mark.parametrize("array", [np.asarray, jnp.asarray, list], ids=["numpy", "jax", "list"])
@pytest.mark.parametrize("x", [F, L, V], ids=lambda x: type(x).__name__)
def test_w_is_for_an_acceleration_only(x, array):
    message = f"shift: w is for a SpatialAcceleration, not for a {type(x).__name__}"
    _raises(TypeError, lambda: js.shift(x, P3, array(P3)), message)
    _raises(TypeError, lambda: x.shift(P3, w=array(P3)), message)


def _velocity(F):
    return js.SpatialVelocity(F.tau, F.f)


def _points(F):
    return F.f[..., None, :]


# operation -> (call with two vectors, what the message may call the first, and the second)
PAIRS = {
    "shift": (lambda F, G: js.shift(F, G.f), "SpatialForce", "p_PQ_E"),
    "dot": (lambda F, G: js.dot(F, _velocity(G)), "SpatialForce|first", "SpatialVelocity|second"),
    "cross": (lambda F, G: js.cross(_velocity(F), G), "SpatialVelocity|first", "SpatialForce|second"),
    "add": (lambda F, G: F + G, "left", "right"),
    "comparison": (lambda F, G: F.get_maximum_absolute_differences(G), "left", "right"),
    "scalar": (lambda F, G: F * G.f[..., 0], "SpatialForce", "scalar"),
    "center_of_pressure": (lambda F, G: js.center_of_pressure(F, G.f), "SpatialForce", "normal"),
    "wrench": (lambda F, G: js.wrench_from_point_forces(_points(F), _points(G)), "points", "forces"),
}
pairs = pytest.mark.parametrize(("call", "left", "right"), PAIRS.values(), ids=PAIRS)


@pairs
def test_dtypes_are_equal(call, left, right):
    with pytest.raises(TypeError, match=r"expected one dtype, got .*; convert with \.astype") as error:
        call(F, F16)
    assert re.search(f"({left}): float32", str(error.value)) and re.search(f"({right}): float16", str(error.value))


@pairs
def test_batch_shapes_broadcast(call, left, right):
    with pytest.raises(
        ValueError, match=r"expected batch shapes that broadcast, got .*; one item against many"
    ) as error:
        call(F2, F4)
    assert re.search(rf"({left}): \(2", str(error.value)) and re.search(rf"({right}): \(4", str(error.value))


@pytest.mark.parametrize(
    ("scalar", "message"),
    [
        ("2", f"SpatialForce * or / scalar: expected an array of floating point ({FLOATS}), got str '2'"),
        (None, f"SpatialForce * or / scalar: expected an array of floating point ({FLOATS}), got NoneType None"),
        (2j, f"SpatialForce * or / scalar: expected an array of floating point ({FLOATS}), got complex 2j"),
        (jnp.int32(2), f"SpatialForce * or / scalar: expected floating point ({FLOATS}), got int32"),
        (np.float16(2), "SpatialForce and scalar: expected one dtype, got SpatialForce: float32, scalar: float16"),
        (jnp.bfloat16(2), "SpatialForce and scalar: expected one dtype, got SpatialForce: float32, scalar: bfloat16"),
    ],
    ids=lambda x: repr(x)[:20],
)
def test_wrong_scalar(scalar, message):
    for call in (lambda: F * scalar, lambda: scalar * F, lambda: F / scalar):
        _raises(TypeError, call, message)


def test_numbers_in_lists_take_the_dtype_of_the_vector(x64):
    F_f = js.SpatialForce(P4, P4)
    for result in (js.shift(F_f, [1.0, 2.0, 3.0]), F_f * [1.0, 2.0, 3.0, 4.0], F_f / [1.0, 2.0, 3.0, 4.0], F_f * 2.0):
        assert result.dtype == np.float32


@pytest.mark.parametrize("kind", FIELDS)
def test_coefficients_are_six(kind):
    name = f"{kind.__name__}.from_array: x6: expected"
    _raises(ValueError, lambda: kind.from_array(zeros(5)), f"{name} shape (*batch, 6), got (5,)")
    _raises(ValueError, lambda: kind.from_array(zeros(6, 1)), f"{name} shape (*batch, 6), got (6, 1)")
    _raises(TypeError, lambda: kind.from_array(jnp.arange(6)), f"{name} floating point", "got int32")


@pytest.mark.parametrize("precision", ["best", "", 2, ["fast"]])
@pytest.mark.parametrize("name", SUMS)
def test_unknown_precision(name, precision):
    operation = OPERATIONS[name]
    inputs = operation.inputs((), "float32")
    message = f"precision: expected one of 'fast', 'reproducible', 'compensated', 'faithful' or None, got {precision!r}"
    _raises(ValueError, lambda: operation.function(*inputs, precision=precision), message)


@pytest.mark.parametrize("kind", FIELDS)
def test_component_index(kind):
    x, batch = of(kind), of(kind, 2)
    for i in (6, -7):
        _raises(IndexError, lambda i=i: x[i], f"{kind.__name__}: expected a component index from -6 to 5, got {i}")
    for i in (slice(0, 2), 1.0, None):
        with pytest.raises(TypeError, match=type(i).__name__):
            x[i]
    with pytest.raises((IndexError, TypeError), match=rf"{kind.__name__}.* batch of shape \(2,\).*to_array.*at_batch"):
        batch[0]


def test_a_batch_is_not_silently_iterated_over():
    with pytest.raises(TypeError, match="SpatialForce"):
        list(F2)


def test_points_have_an_axis():
    _raises(ValueError, lambda: js.wrench_from_point_forces(P3, P3), "points: expected shape (*batch, n, 3), got (3,)")


WHILE_TRACING = {
    "shape": (lambda x: js.shift(F, x[:2]), ValueError, "shift: p_PQ_E: expected shape (*batch, 3), got (2,)"),
    "dtype": (lambda x: js.shift(F16, x), TypeError, "expected one dtype, got SpatialForce: float16, p_PQ_E: float32"),
    "integers": (
        lambda x: js.shift(F, x.astype(int)),
        TypeError,
        f"p_PQ_E: expected floating point ({FLOATS}), got int32",
    ),
    "batch": (lambda x: js.SpatialForce(x, x[None]), ValueError, "SpatialForce: expected equal batch shapes"),
    "kind": (lambda x: js.dot(js.SpatialForce(x, x), F), TypeError, "dot: expected a SpatialVelocity"),
    "w": (lambda x: js.shift(F, x, x), TypeError, "shift: w is for a SpatialAcceleration, not for a SpatialForce"),
    "from_array": (js.SpatialForce.from_array, ValueError, "expected shape (*batch, 6), got (3,)"),
}


@pytest.mark.parametrize(("call", "error", "message"), WHILE_TRACING.values(), ids=WHILE_TRACING)
def test_the_same_messages_while_tracing(call, error, message):
    _raises(error, lambda: jax.jit(call)(P3), message)


@pytest.mark.parametrize("value", [0.0, -0.0, np.inf, -np.inf, np.nan, np.finfo(np.float32).max], ids=str)
@pytest.mark.parametrize("name", slow_but(REPRESENTATIVES, NAIVE))
def test_no_value_raises(name, value):
    function = OPERATIONS[name].function
    inputs = OPERATIONS[name].inputs((), "float32")
    filled = jax.tree.map(lambda x: np.full_like(x, value), inputs)
    eager, compiled = (f(*jax.tree.map(jnp.asarray, filled)) for f in (function, jax.jit(function)))
    first_traced = jax.jit(lambda first: function(first, *filled[1:]))(filled[0])
    for a, b, c in zip(*map(jax.tree.leaves, (eager, compiled, first_traced)), strict=True):
        np.testing.assert_array_equal(a, b, strict=True)
        assert (c.shape, c.dtype) == (a.shape, a.dtype)


def _raises(error, call, *messages):
    """`call` raises with all the messages, word by word."""
    with pytest.raises(error) as raised:
        call()
    for message in messages:
        assert message in str(raised.value)
