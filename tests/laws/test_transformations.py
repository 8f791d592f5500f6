"""Every operation gives the same numbers in every transformation, of every dtype, over every batch.

In precision "reproducible" (the default) values are bitwise those of the naive NumPy formula of the table, 16-bit types
included; where there is none, those of the operation itself, op by op in NumPy: one primitive after another, with
nothing to contract, rewrite or fuse.

All operations are tested op by op. That the compiler keeps their bits is tested with programs of many operations: see
`cases.PROGRAMS`.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.helpers.interpreted import OF_NUMBERS as OPERATION_OF
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.operations import DISTINCT, DTYPES, NAIVE, OPERATIONS, REPRESENTATIVES
from tests.helpers.products import sums_of_arguments
from tests.laws.batches import ALL, BATCH, ONE, arrays, assert_same_bits, on_device, together, value
from tests.laws.cases import MANY, PROGRAMS
from tests.laws.surroundings import OF_OPERATIONS

MASKS = [name for name, operation in OPERATIONS.items() if operation.is_mask]
OF_SEVERAL = [name for name in OPERATIONS if " " in OPERATIONS[name].arguments]


@pytest.mark.parametrize(
    ("surrounding", "dtype", "x64", "items", "operations"),
    [
        pytest.param(
            *program[:5], id=f"{'-'.join(map(str, program[:3]))}-{i}", marks=[pytest.mark.slow] * program.is_slow
        )
        for i, program in enumerate(PROGRAMS)
    ],
)
def test_value_is_the_same_compiled(surrounding, dtype, x64, items, operations):
    expected = {name: [x[items] for x in value(name, dtype)] for name in operations}
    with jax.enable_x64(x64):
        inputs = {name: [jnp.asarray(x[items]) for x in arrays(name, dtype)] for name in operations}
        result = OF_OPERATIONS[surrounding](together(operations))(inputs)
        for name in operations:
            assert_same_bits(result[name], expected[name], name)


# One of them compares: its differences are no results, and no sums of a formula.
@pytest.mark.parametrize(
    ("names", "dtype"),
    [
        ((*REPRESENTATIVES, "maximum_absolute_differences"), "float32"),
        slow(MANY, "float32"),
        slow(DISTINCT, "float32"),
        slow(DISTINCT, "float64"),
    ],
    ids=["representatives-float32", "many-float32", "distinct-float32", "distinct-float64"],
)
def test_value_does_not_depend_on_who_computed_the_arguments(names, dtype):
    """The same program multiplies them: without a barrier these products and sums of the operations become fmas."""
    rng = np.random.default_rng(0)
    inputs = {name: arrays(name, dtype) for name in names}
    near_one = {name: [rng.uniform(0.999, 1.001, x.shape).astype(dtype) for x in xs] for name, xs in inputs.items()}

    def multiplied(inputs, near_one):
        return {name: [x * y for x, y in zip(inputs[name], near_one[name], strict=True)] for name in names}

    expected = {name: OPERATIONS[name].naive(*xs) for name, xs in multiplied(inputs, near_one).items()}
    with jax.enable_x64(dtype == "float64"):
        result = jax.jit(lambda *both: together(names)(multiplied(*both)))(inputs, near_one)
    for name in names:
        assert_same_bits(result[name], expected[name], name)


@pytest.mark.parametrize("precision", [None, "compensated", "faithful"])
def test_arguments_are_added_behind_a_barrier(precision):
    """They may be products of the caller's, as above; whether a compiler makes fmas of these depends on what else is
    compiled with them. Sums of a whole polynomial (`jaxspatial_sums`) have their barriers inside."""
    for name, operation in OPERATIONS.items():
        traced = jax.make_jaxpr(operation.on_arrays(precision))(*arrays(name))
        assert sums_of_arguments(traced) == [], name


# float64 exists only while 64-bit types are on.
@pytest.mark.parametrize(
    ("dtype", "x64"), [(dtype, x64) for dtype in DTYPES for x64 in (False, True) if x64 or dtype != "float64"]
)
def test_value_is_bitwise_the_naive_formula(dtype, x64):
    """With 64-bit types on, too: narrower types are not widened."""
    for name in NAIVE:
        with jax.enable_x64(x64):
            result = interpreted(OPERATIONS[name].on_arrays())(*arrays(name, dtype))
        assert_same_bits(result, value(name, dtype), name)


def test_products_without_a_barrier_are_exact(monkeypatch):
    """A factor is a power of two: otherwise a compiler that makes an fma of a product and a sum would change bits.
    Operations with a formula in NumPy are left out, as the bits of their compiled programs are compared with it."""

    def multiplied(a, b):
        assert a.dtype != np.float32 or (np.multiply(a, b) == a.astype(float) * b.astype(float)).all()
        return np.multiply(a, b)

    monkeypatch.setitem(OPERATION_OF, "mul", multiplied)
    for name in OPERATIONS:
        if name not in NAIVE:
            OPERATIONS[name].op_by_op(*arrays(name))


@pytest.mark.parametrize("dtype", ["float16", "bfloat16"])
def test_sixteen_bits_are_rounded_between_operations(dtype):
    """In one program too, where the compiler could leave out the conversion there and back."""
    shift = OPERATIONS["shift_force"].on_arrays()

    def there_and_on(tau, f, p):
        return shift(*shift(tau, f, p), p)

    inputs = on_device(arrays("shift_force", dtype))
    assert_same_bits(jax.jit(there_and_on)(*inputs), there_and_on(*inputs))


# A twin runs the same formula on another type, which `test_precisions` and the naive formulas above hold.
@pytest.mark.parametrize("name", slow_but(DISTINCT, OPERATIONS))
def test_batch_by_broadcasting_and_by_nested_vmap(name):
    """Compares with broadcasting over (3, 1, 2). Compiled: see above."""
    function = OPERATIONS[name].on_arrays()
    for items, transformed in ((ONE, function), (ALL, jax.vmap(jax.vmap(jax.vmap(function))))):
        inputs, expected = ([x[items] for x in xs] for xs in (arrays(name), value(name)))
        assert_same_bits(interpreted(transformed)(*inputs), expected)


@pytest.mark.parametrize("name", slow_but(DISTINCT, OPERATIONS))
def test_a_batch_is_split_along_an_explicit_axis_of_the_mesh_in_the_context(name):
    """With constants that are made on the way."""
    operation = OPERATIONS[name]
    mesh = jax.make_mesh((1,), ("batch",), axis_types=(jax.sharding.AxisType.Explicit,))
    given = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in operation.arrays((2,), np.float32)]
    expected = jax.eval_shape(operation.on_arrays(), *given)
    with jax.set_mesh(mesh):
        split = [x.update(sharding=jax.NamedSharding(mesh, jax.P("batch"))) for x in given]
        found = jax.eval_shape(operation.on_arrays(), *split)
    assert [x.shape for x in found] == [x.shape for x in expected]
    assert any("batch" in x.sharding.spec for x in found)


@pytest.mark.parametrize("name", slow_but([name for name in OF_SEVERAL if name in DISTINCT], OF_SEVERAL))
def test_one_item_is_shared_by_a_batch(name):
    operation = OPERATIONS[name]
    for i, kind in enumerate(operation.arguments.split()):
        shared = [x[ONE] if place == i else x for x, place in zip(arrays(name), operation.places, strict=True)]
        if kind in ("F", "A") and "scalar" in operation.arguments.split():
            with pytest.raises(ValueError, match="one per vector of the batch"):
                operation.function(*on_device(operation.build(shared)))
            continue
        repeated = [np.broadcast_to(x, y.shape) for x, y in zip(shared, arrays(name), strict=True)]
        result = interpreted(operation.on_arrays())(*shared)
        # What does not depend on the others has no batch.
        expected = [x[(0,) * (x.ndim - y.ndim)] for x, y in zip(operation.naive(*repeated), result, strict=True)]
        assert_same_bits(result, expected)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", MASKS)
def test_masks(name, dtype):
    """Booleans of the shape of the batch, right for each item, whatever surrounds them (see above)."""
    (mask,) = value(name, dtype)
    assert mask.dtype == bool
    np.testing.assert_array_equal(mask, np.arange(6).reshape(BATCH) % 2 == 0)
