"""Every operation keeps its dtype in every precision, and the bound of its docstring; what has no formula in the table
is compared with float64. Hostile inputs: see `test_error_bounds`, and the tests of each operation.
"""

import functools

import jax
import numpy as np
import pytest

from jaxspatial.measure.error import unit_roundoff
from tests.helpers.marks import slow, slow_but
from tests.helpers.operation import violations
from tests.helpers.operations import DTYPES, NAIVE, OF_NUMBERS, OPERATIONS, OWN, REPRESENTATIVES, SUMS
from tests.laws.given import BATCH, arrays, assert_same_bits, on_device, precisely, sized, together, value
from tests.laws.test_transformations import CONTEXTS

PRECISIONS = ("fast", "reproducible", "compensated", "faithful")
# Next to float64, in u normwise: cancellation of well conditioned ones.
ROUNDED = 16
# Sums over many items are many programs op by op, of many shapes; `inertia.test_mesh` and `test_sums` tell of them.
MANY_SHAPES = ("triangle_mesh", "sum_of_inertias")
OTHERS = [name for name in OPERATIONS if name not in NAIVE]
# By default all operations in one of these, and representatives in a few: in a formula nothing but the numbers it runs
# in depends on dtype and precision.
TYPES = [
    (name, dtype, precision)
    for dtype in DTYPES
    for precision in PRECISIONS
    for name in OTHERS
    if name in OWN or (dtype, precision) == ("float32", "reproducible")
]
OF_FEW = [
    ("float32", "compensated"),
    ("float16", "faithful"),
    ("float64", "reproducible"),
    ("bfloat16", "reproducible"),
]
USUAL = [
    (name, *types)
    for name, *types in TYPES
    if name not in MANY_SHAPES and (types == ["float32", "reproducible"] or name in OF_NUMBERS and (*types,) in OF_FEW)
]


@pytest.mark.parametrize(("name", "dtype", "precision"), slow_but(USUAL, TYPES))
def test_every_precision_keeps_the_dtype_and_agrees_with_float64(name, dtype, precision):
    """Evaluated in the wider format and rounded once: bit for bit what is rounded of it."""
    operation, wide = OPERATIONS[name], _evaluated_in(precision, dtype)
    found = value(name, dtype) if precision == "reproducible" else precisely(name, dtype, precision)
    for x, exact, same in zip(found, _widened(name, dtype, "float64"), _widened(name, dtype, wide), strict=True):
        assert x.dtype == (bool if operation.is_mask else dtype) and x.shape == exact.shape
        if operation.is_one_formula and operation.takes_precision and wide != dtype:
            np.testing.assert_array_equal(x, same.astype(x.dtype))
        _assert_near(x, exact, ROUNDED if wide == dtype or dtype == "float64" else 4)


@pytest.mark.parametrize(
    ("precision", "names"),
    [("compensated", OF_NUMBERS[1:4]), slow("compensated", OF_NUMBERS), slow("fast", OF_NUMBERS)],
)
def test_other_precisions_compiled(precision, names):
    found = jax.jit(together(names, precision))({name: on_device(arrays(name)) for name in names})
    for name in names:
        if precision == "compensated":
            assert_same_bits(found[name], precisely(name, "float32", precision), name)
        for x, exact in zip(found[name], _widened(name, "float32", "float64"), strict=True):
            _assert_near(np.asarray(x), exact, ROUNDED)


@pytest.mark.parametrize("precision", ["fast", "compensated", "faithful"])
@pytest.mark.parametrize("names", [REPRESENTATIVES[:3], *(slow((name,)) for name in SUMS)], ids="-".join)
def test_bound_of_the_docstring_with_64_bit_types_on(names, precision):
    """With them off, and in all dtypes: see `test_error_bounds`."""
    with jax.enable_x64(True):
        _assert_within_bounds(jax.jit(together(names, precision)), names, precision)


SURROUNDED = [(context, precision) for precision in ("compensated", "faithful", "fast") for context in CONTEXTS]


@pytest.mark.parametrize(("context", "precision"), slow_but(SURROUNDED[: len(CONTEXTS)], SURROUNDED))
def test_bound_of_the_docstring_in_every_context(context, precision):
    names = REPRESENTATIVES[:3] if precision == "compensated" else REPRESENTATIVES
    _assert_within_bounds(CONTEXTS[context](together(names, precision)), names, precision)


# -- helpers ----------------------------------------------------------------------------------------------------------


def _evaluated_in(precision, dtype):
    if precision in ("compensated", "faithful"):
        return "float64"
    return "float32" if dtype in ("float16", "bfloat16") else dtype


@functools.cache
def _widened(name, dtype, wide):
    """Of inputs of one dtype, what comes in another, in "reproducible"."""
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
