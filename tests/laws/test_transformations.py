"""Every operation gives the same numbers in every transformation, of every dtype, over every batch.

In precision "reproducible" (the default) values are bitwise those of the naive NumPy formula of the table, 16-bit types
included; where there is none, those of the operation itself, op by op in NumPy: one primitive after another, with
nothing to contract, rewrite or fuse.

What the formulas say is told op by op, of all operations. That the compiler keeps to it is told by programs of many.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from tests.helpers.interpreted import OF_NUMBERS as OPERATION_OF
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but
from tests.helpers.operations import NAIVE, OF_NUMBERS, OPERATIONS, OWN, REPRESENTATIVES
from tests.laws.given import ALL, BATCH, FIRST, ONE, arrays, assert_same_bits, on_device, together, value

MASKS = [name for name, operation in OPERATIONS.items() if operation.is_mask]
OF_SEVERAL = [name for name in OPERATIONS if " " in OPERATIONS[name].arguments]
# What is made of other operations of the table, or goes the way of one of a few below, and takes long to compile.
LONG = (
    "triangle_mesh",
    "sum_of_inertias",
    "interpolate",
    "interpolate_motion",
    "exp_of_motion",
    "log_of_motion",
    "left_jacobian",
    "left_jacobian_of_motion",
    "left_jacobian_inverse_of_motion",
    "from_roll_pitch_yaw",
    "to_roll_pitch_yaw",
    "between",
    "is_physically_valid",
    "validity_slack",
    "nearest_valid",
    "equivalent_ellipsoid",
    "to_log_cholesky",
    "act_inverse_articulated",
    "project_out_two",
)
MANY = (*REPRESENTATIVES, *OF_NUMBERS)
FEW = (*REPRESENTATIVES[:3], *OF_NUMBERS[:3])
FEWEST = (*REPRESENTATIVES[:3], "from_one_vector")


def _nested(f):
    """scan of vmap of vmap of cond of checkpoint, over a batch with three axes; the condition is known to nobody."""

    def chosen(is_on, item):
        return lax.cond(is_on, jax.checkpoint(f), functools.partial(_zeros_like, f), item)

    def over_batch(is_on, given):
        one = functools.partial(chosen, is_on)
        return lax.scan(lambda _, x: (None, jax.vmap(jax.vmap(one))(x)), None, given)[1]

    return lambda given: jax.jit(over_batch)(_true(), given)


def _partly_known(f):
    """All arguments but the first known while tracing, of one argument all arrays but the first; of one array that."""

    def call(given):
        data = {name: x[: _count(name)] for name, x in given.items()}
        known = {name: [np.asarray(a) for a in x[_count(name) :]] for name, x in given.items()}
        return jax.jit(lambda data: f({name: [*x, *known[name]] for name, x in data.items()}))(data)

    return call


def _count(name):
    places = OPERATIONS[name].places
    return places.count(0) if places[-1] else min(1, len(places) - 1)


CONTEXTS = {
    "eager": lambda f: f,
    "jit": jax.jit,
    "vmap": lambda f: jax.jit(jax.vmap(f)),
    "vmap_of_vmap": lambda f: jax.jit(jax.vmap(jax.vmap(f))),
    "scan": lambda f: lambda given: lax.scan(lambda _, x: (None, f(x)), None, given)[1],
    "cond": lambda f: lambda given: lax.cond(_true(), f, functools.partial(_zeros_like, f), given),
    "checkpoint": lambda f: jax.jit(jax.checkpoint(f)),
    "known": _partly_known,
    "nested": _nested,
}
# (context, dtype, 64-bit types, items of the batch, operations, whether it is slow). Each formula is compiled in one;
# some, of each kind of arithmetic, in the surroundings that differ the most to a formula; a few in everything.
PROGRAMS = [
    ("vmap", "float32", False, FIRST, [name for name in OWN if name not in (*LONG, *MANY)], False),
    ("vmap", "float32", False, FIRST, LONG, True),
    ("nested", "float32", False, ALL, MANY, False),
    ("nested", "float32", False, ALL, [name for name in OWN if name not in MANY], True),
    ("known", "float32", True, FIRST, (*MANY, "from_axis_angle", "project_out"), False),
    ("known", "float32", False, ALL, tuple(OPERATIONS), True),
    ("known", "float64", True, ALL, OWN, True),
    ("vmap", "float64", True, ALL, OWN, True),
    ("vmap", "float16", True, ALL, OWN, True),
    ("vmap", "bfloat16", True, ALL, OWN, True),
    ("eager", "float32", False, ALL, FEW, False),
    ("jit", "float64", True, ONE, FEWEST, False),
    ("vmap", "float64", True, ALL, (*FEWEST, "combine"), False),
    ("known", "float64", True, ALL, FEWEST, False),
    ("vmap", "float16", True, ALL, FEWEST, False),
    ("vmap", "bfloat16", True, ALL, FEWEST, False),
    *((context, "float32", False, ALL, REPRESENTATIVES[:3], False) for context in CONTEXTS),
    *((context, dtype, True, ALL, MANY, True) for context in CONTEXTS for dtype in ("float32", "float64")),
]
FORMATS = [("float16", False), ("float16", True), ("bfloat16", False), ("bfloat16", True), ("float32", False),
           ("float32", True), ("float64", True)]  # fmt: skip


@pytest.mark.parametrize(
    ("context", "dtype", "x64", "items", "names"),
    [
        pytest.param(*program, id=f"{'-'.join(map(str, program[:3]))}-{i}", marks=pytest.mark.slow if is_slow else [])
        for i, (*program, is_slow) in enumerate(PROGRAMS)
    ],
)
def test_value_is_the_same_compiled(context, dtype, x64, items, names):
    expected = {name: [x[items] for x in value(name, dtype)] for name in names}
    with jax.enable_x64(x64):
        given = {name: [jnp.asarray(x[items]) for x in arrays(name, dtype)] for name in names}
        result = CONTEXTS[context](together(names))(given)
        for name in names:
            assert_same_bits(result[name], expected[name], name)


@pytest.mark.parametrize(
    ("names", "dtype"),
    [(MANY, "float32"), *(pytest.param(OWN, dtype, marks=pytest.mark.slow) for dtype in ("float32", "float64"))],
    ids=["many-float32", "own-float32", "own-float64"],
)
def test_value_does_not_depend_on_who_computed_the_arguments(names, dtype):
    """Products of the same program, which without a barrier are contracted with sums of the operations."""
    rng = np.random.default_rng(0)
    given = {name: arrays(name, dtype) for name in names}
    near_one = {name: [rng.uniform(0.999, 1.001, x.shape).astype(dtype) for x in xs] for name, xs in given.items()}

    def multiplied(given, near_one):
        return {name: [x * y for x, y in zip(given[name], near_one[name], strict=True)] for name in names}

    expected = {name: OPERATIONS[name].naive(*xs) for name, xs in multiplied(given, near_one).items()}
    with jax.enable_x64(dtype == "float64"):
        result = jax.jit(lambda *both: together(names)(multiplied(*both)))(given, near_one)
    for name in names:
        assert_same_bits(result[name], expected[name], name)


@pytest.mark.parametrize(("dtype", "x64"), FORMATS)
def test_value_is_bitwise_the_naive_formula(dtype, x64):
    """Where 64-bit types are on, narrower ones are not widened."""
    for name in NAIVE:
        with jax.enable_x64(x64):
            result = interpreted(OPERATIONS[name].on_arrays())(*arrays(name, dtype))
        assert_same_bits(result, value(name, dtype), name)


def test_what_is_multiplied_without_a_fence_is_multiplied_exactly(monkeypatch):
    """By powers of two: else a compiler that contracts a product and a sum would change bits. Of what has a formula in
    NumPy the bits of compiled programs tell."""

    def multiplied(a, b):
        assert a.dtype != np.float32 or (np.multiply(a, b) == a.astype(float) * b.astype(float)).all()
        return np.multiply(a, b)

    monkeypatch.setitem(OPERATION_OF, "mul", multiplied)
    for name in OPERATIONS:
        if name not in NAIVE:
            OPERATIONS[name].op_by_op(*arrays(name))


@pytest.mark.parametrize("dtype", ["float16", "bfloat16"])
def test_sixteen_bits_are_rounded_between_operations(dtype):
    """In one program too, where a conversion there and back could be left out."""
    shift = OPERATIONS["shift_force"].on_arrays()

    def there_and_on(tau, f, p):
        return shift(*shift(tau, f, p), p)

    given = on_device(arrays("shift_force", dtype))
    assert_same_bits(jax.jit(there_and_on)(*given), there_and_on(*given))


@pytest.mark.parametrize("name", OPERATIONS)
def test_batch_by_broadcasting_and_by_nested_vmap(name):
    """Broadcasting over (3, 1, 2) is what is compared with. Compiled: see above."""
    function = OPERATIONS[name].on_arrays()
    for items, transformed in ((ONE, function), (ALL, jax.vmap(jax.vmap(jax.vmap(function))))):
        given, expected = ([x[items] for x in xs] for xs in (arrays(name), value(name)))
        assert_same_bits(interpreted(transformed)(*given), expected)


@pytest.mark.parametrize("name", slow_but([name for name in OF_SEVERAL if name in OWN], OF_SEVERAL))
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


def _true():
    return jnp.asarray(True)


def _zeros_like(f, given):
    return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(f, given))
