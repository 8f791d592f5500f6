"""Every operation keeps its dtype in every precision, and the bound of its docstring.

Operations without a formula in the table are compared with float64. Hostile inputs: see `test_error_bounds`, and the
tests of each operation.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspatial.measure.error import unit_roundoff
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.operation import violations
from tests.helpers.operations import BOUNDED, OPERATIONS, OTHER_REPRESENTATIVES, REPRESENTATIVES, SUMS
from tests.laws import cases
from tests.laws.batches import BATCH, arrays, assert_same_bits, on_device, precisely, sized, together, value
from tests.laws.surroundings import OF_OPERATIONS

# How far a result may be from float64, in u normwise: well conditioned values cancel a little.
ROUNDED = 16


@cases.PRECISIONS.parametrize
def test_every_precision_keeps_the_dtype_and_agrees_with_float64(name, dtype, precision):
    """A formula evaluated in a wider dtype has the bits of that result, rounded once."""
    operation, wide = OPERATIONS[name], _evaluated_in(precision, dtype, is_sum=name in BOUNDED)
    results = value(name, dtype) if precision == "reproducible" else precisely(name, dtype, precision)
    for x, exact, same in zip(results, _widened(name, dtype, "float64"), _widened(name, dtype, wide), strict=True):
        assert x.dtype == (bool if operation.is_mask else dtype) and x.shape == exact.shape
        if operation.is_one_formula and operation.takes_precision and wide != dtype:
            np.testing.assert_array_equal(x, same.astype(x.dtype))
        _assert_near(x, exact, ROUNDED if wide == dtype or dtype == "float64" else 4)


@pytest.mark.parametrize(
    ("precision", "names"),
    [
        ("compensated", OTHER_REPRESENTATIVES[1:4]),
        slow("compensated", OTHER_REPRESENTATIVES),
        slow("fast", OTHER_REPRESENTATIVES),
    ],
)
def test_other_precisions_compiled(precision, names):
    results = jax.jit(together(names, precision))({name: on_device(arrays(name)) for name in names})
    for name in names:
        if precision == "compensated":
            assert_same_bits(results[name], precisely(name, "float32", precision), name)
        for x, exact in zip(results[name], _widened(name, "float32", "float64"), strict=True):
            _assert_near(np.asarray(x), exact, ROUNDED)


@pytest.mark.parametrize("precision", [slow("fast"), "compensated", slow("faithful")])
@pytest.mark.parametrize("names", [REPRESENTATIVES[:3], *(slow((name,)) for name in SUMS)], ids="-".join)
def test_bound_of_the_docstring_with_64_bit_types_on(names, precision):
    """With them off, and in all dtypes: see `test_error_bounds`."""
    with jax.enable_x64(True):
        _assert_within_bounds(jax.jit(together(names, precision)), names, precision)


@cases.SURROUNDED.parametrize
def test_bound_of_the_docstring_in_every_surrounding(surrounding, precision):
    names = REPRESENTATIVES[:3] if precision == "compensated" else REPRESENTATIVES
    _assert_within_bounds(OF_OPERATIONS[surrounding](together(names, precision)), names, precision)


# -- helpers ----------------------------------------------------------------------------------------------------------


def _evaluated_in(precision, dtype, is_sum):
    """See `formula`: sums of products stay in float16."""
    if precision in ("compensated", "faithful"):
        return "float64"
    return "float32" if dtype == "bfloat16" or (dtype == "float16" and not is_sum) else dtype


@functools.cache
def _widened(name, dtype, wide):
    """The result in "reproducible" of inputs of one dtype, converted to another."""
    return OPERATIONS[name].op_by_op(*(x.astype(wide) for x in arrays(name, dtype)))


def _assert_near(x, exact, n):
    """Within n u of the largest component, item by item; masks are the same."""
    if x.dtype == bool:
        return np.testing.assert_array_equal(x, exact)
    axes = tuple(range(len(BATCH), x.ndim))
    size = abs(exact).max(axes, keepdims=True)
    assert (abs(x.astype(np.float64) - exact) <= n * float(unit_roundoff(x.dtype)) * size).all()


def _assert_within_bounds(program, names, precision):
    results = program({name: on_device(arrays(name)) for name in names})
    for name in names:
        for array, exact, bound in zip(results[name], sized(name), OPERATIONS[name].bounds, strict=True):
            assert array.dtype == np.float32
            assert not violations(bound, precision, array, exact).any(), (name, bound)


# Their formulas are differentiated by rules of their own, which JAX calls where the types of the caller hold.
WITH_RULES = ["exp", "log", "from_roll_pitch_yaw", "left_jacobian", "exp_of_motion", "to_log_cholesky"]


@pytest.mark.parametrize("name", slow_but(WITH_RULES, list(OPERATIONS)))
def test_derivatives_of_numbers_computed_in_64_bits_need_no_64_bit_types(name):
    """Of float32 "compensated" and "faithful" compute in float64. The order of sums of cotangents may differ."""
    operation = OPERATIONS[name]
    arrays = operation.arrays((3,), np.float32)
    floats = tuple(i for i, x in enumerate(arrays) if jnp.issubdtype(x.dtype, jnp.floating))

    def total(*arrays):
        results = jax.tree.leaves(operation.on_arrays("compensated")(*arrays))
        return sum((y.sum() for y in results if y.dtype == np.float32), jnp.float32(0))

    found = []
    for types in (False, True):
        with jax.enable_x64(types):
            found.append(interpreted(jax.grad(total, floats))(*arrays))
    for x, y in zip(*found, strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=2 * float(unit_roundoff("float32")) * abs(y).max())
