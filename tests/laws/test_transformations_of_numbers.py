"""What takes quotients, roots, angles or decisions gives the same numbers in every transformation, as sums of products
do in `test_transformations`.

Their formulas are too long to be written a second time in NumPy. What is compared with is the operation itself, run op
by op in NumPy: one primitive after another, with nothing to contract, rewrite or fuse. "reproducible" promises these
bits, in every program and of any batch; the other precisions, the 16-bit types and derivatives run op by op as well,
and against float64.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxspatial.measure.error import unit_roundoff
from jaxspatial.measure.exact import rationals
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow_but
from tests.helpers.operations_of_numbers import FORMULAS, OPERATIONS, REPRESENTATIVES

BATCH = (3, 1, 2)
DIFFERENTIABLE = [name for name in FORMULAS if OPERATIONS[name].differentiable]
MASKS = [name for name, operation in OPERATIONS.items() if operation.is_mask]
# Op by op sums over many items are many programs, of many shapes; `inertia.test_mesh` and `test_sums` tell of them.
LONG = ("triangle_mesh", "sum")
# What is made of other operations of the table, and takes long to compile.
MADE_OF_OTHERS = (
    "interpolate_motion",
    "left_jacobian_of_motion",
    "left_jacobian_inverse_of_motion",
    "nearest_valid",
    "equivalent_ellipsoid",
    "to_log_cholesky",
    "validity_slack",
)
OFTEN_KNOWN = ("from_axis_angle", "project_out")
OF_SEVERAL = [name for name, operation in OPERATIONS.items() if " " in operation.arguments]
# Of the values and derivatives of all operations next to float64, in u normwise: cancellation of well conditioned ones.
ROUNDED, DERIVED = 16, 64
# Central differences of order 8 at steps of 2^-10, in float64: what rounding leaves of them.
STEP, WEIGHTS, OF_DIFFERENCES = 2.0**-10, (4 / 5, -1 / 5, 4 / 105, -1 / 280), 2.5e-10


def _nested(f):
    """scan of vmap of vmap of cond of checkpoint, over a batch with three axes; the condition is known to nobody."""

    def chosen(is_on, *item):
        return lax.cond(is_on, jax.checkpoint(f), functools.partial(_zeros_like, f), *item)

    def over_batch(is_on, *arrays):
        one = functools.partial(chosen, is_on)
        return lax.scan(lambda _, x: (None, jax.vmap(jax.vmap(one))(*x)), None, arrays)[1]

    return lambda *arrays: jax.jit(over_batch)(jnp.asarray(True), *arrays)


def _partly_known(f):
    """All arrays but the first known while tracing; a single one is known."""

    def call(first, *others):
        known = list(map(np.asarray, others))
        return jax.jit(lambda x: f(x, *known))(first) if known else jax.jit(lambda: f(np.asarray(first)))()

    return call


ALL, FIRST, ONE = np.s_[:], np.s_[0, :, 0], np.s_[0, 0, 0]
# name: (context, which items of the batch, operations that are not slow, dtype, 64-bit types). To compile all formulas
# once takes half a minute.
PROGRAMS = {
    "nested": (_nested, ALL, [name for name in FORMULAS if name not in LONG + MADE_OF_OTHERS], "float32", False),
    "known": (_partly_known, FIRST, (*REPRESENTATIVES, *OFTEN_KNOWN), "float32", True),
    "eager": (lambda f: f, ALL, REPRESENTATIVES[:3], "float32", False),
    "jit": (jax.jit, ONE, REPRESENTATIVES[:3], "float64", True),
}
COMPILED = [(name, program) for program in PROGRAMS for name in OPERATIONS]


def _cases(cases, is_slow):
    """Cases with plain names, those that take long marked."""
    marks = {True: [pytest.mark.slow], False: []}
    return [pytest.param(*case, id="-".join(case), marks=marks[bool(is_slow(*case))]) for case in cases]


# By default all operations in one of these, and representatives in a few: in a formula nothing but the numbers it runs
# in depends on dtype and precision.
TYPES = [
    (name, dtype, precision)
    for dtype in ("float16", "bfloat16", "float32", "float64")
    for precision in ("fast", "reproducible", "compensated", "faithful")
    for name in (OPERATIONS if (dtype, precision) == ("float32", "reproducible") else FORMULAS)
]
USUAL = [("float32", "reproducible")]
OF_FEW = [
    ("float32", "compensated"),
    ("float16", "faithful"),
    ("float64", "reproducible"),
    ("bfloat16", "reproducible"),
]


# -- values -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "program"), _cases(COMPILED, lambda name, program: name not in PROGRAMS[program][2]))
def test_value_is_the_same_compiled(name, program):
    context, items, _, dtype, x64 = PROGRAMS[program]
    with jax.enable_x64(x64):
        arrays = [jnp.asarray(x[items]) for x in _arrays(name, dtype)]
        result = context(OPERATIONS[name].on_arrays())(*arrays)
        _assert_same_bits(result, [x[items] for x in _value(name, dtype)])


@pytest.mark.parametrize("name", _cases([(name,) for name in OPERATIONS], lambda name: name not in REPRESENTATIVES))
def test_batch_by_broadcasting_and_by_nested_vmap(name):
    """Broadcasting over (3, 1, 2) is what is compared with. All formulas: see "nested", "known" and "jit" above."""
    function = OPERATIONS[name].on_arrays()
    for items, transformed in (
        (ONE, function),
        (FIRST, function),
        (FIRST, jax.vmap(function)),
        (ALL, jax.vmap(jax.vmap(jax.vmap(function)))),
    ):
        arrays, expected = ([x[items] for x in xs] for xs in (_arrays(name, "float32"), _value(name, "float32")))
        _assert_same_bits(_op_by_op(transformed, arrays), expected)


@pytest.mark.parametrize("name", OF_SEVERAL)
def test_one_item_is_shared_by_a_batch(name):
    operation, arrays = OPERATIONS[name], _arrays(name, "float32")
    places = operation.places()
    for i in set(places):
        shared = [x[ONE] if place == i else x for x, place in zip(arrays, places, strict=True)]
        repeated = [np.broadcast_to(x, y.shape) for x, y in zip(shared, arrays, strict=True)]
        _assert_same_bits(_op_by_op(operation.on_arrays(), shared), _op_by_op(operation.on_arrays(), repeated))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", MASKS)
def test_masks(name, dtype):
    """Booleans of the shape of the batch, right for each item, whatever surrounds them (see above)."""
    (mask,) = _value(name, dtype)
    assert mask.dtype == bool
    np.testing.assert_array_equal(mask, np.arange(6).reshape(BATCH) % 2 == 0)


# -- precisions and dtypes --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "dtype", "precision"),
    _cases(
        TYPES,
        lambda name, *types: (
            types not in USUAL and (name not in REPRESENTATIVES or types not in OF_FEW) or name in LONG
        ),
    ),
)
def test_every_precision_keeps_the_dtype_and_agrees_with_float64(name, dtype, precision):
    """Evaluated in the wider format and rounded once: bit for bit what is rounded of it."""
    operation, wide = OPERATIONS[name], _evaluated_in(precision, dtype)
    found = _value(name, dtype, precision)
    for x, exact, same in zip(found, _widened(name, dtype, "float64"), _widened(name, dtype, wide), strict=True):
        assert x.dtype == (bool if operation.is_mask else dtype) and x.shape == exact.shape
        if operation.is_one_formula and operation.takes_precision and wide != dtype:
            np.testing.assert_array_equal(x, same.astype(x.dtype))
        _assert_near(x, exact, ROUNDED if wide == dtype or dtype == "float64" else 4)


@pytest.mark.parametrize("precision", slow_but(["compensated"], ["fast", "compensated"]))
@pytest.mark.parametrize("name", REPRESENTATIVES)
def test_other_precisions_compiled(name, precision):
    arrays = map(jnp.asarray, _arrays(name, "float32"))
    found = jax.jit(OPERATIONS[name].on_arrays(precision))(*arrays)
    if precision == "compensated":
        return _assert_same_bits(found, _value(name, "float32", precision))
    for x, exact in zip(found, _widened(name, "float32", "float64"), strict=True):
        _assert_near(np.asarray(x), exact, ROUNDED)


# -- derivatives ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    _cases([(name,) for name in DIFFERENTIABLE], lambda name: name not in (*REPRESENTATIVES, *OFTEN_KNOWN, "log")),
)
def test_tangent_is_the_derivative(name):
    """Of float64 next to differences, of float32 next to that of float64."""
    wide = _pushed(name, "float64")
    for x, expected in zip(wide, _differences(name), strict=True):
        assert abs(x - expected).max() <= OF_DIFFERENCES * max(abs(expected).max(), 1)
    for x, exact in zip(_pushed(name, "float32"), wide, strict=True):
        assert x.dtype == np.float32
        assert abs(x - exact).max() <= DERIVED * float(unit_roundoff("float32")) * abs(exact).max()


@pytest.mark.parametrize(
    ("name", "dtype"),
    _cases(
        [(name, dtype) for dtype in ("float32", "float64") for name in DIFFERENTIABLE],
        lambda name, dtype: dtype == "float64" or name not in REPRESENTATIVES,
    ),
)
def test_pull_back_is_the_transpose_of_the_tangent(name, dtype):
    """cotangent . tangent = pulled . t, and what is pulled back has the shapes and dtypes of what went in."""
    arrays, t, tangent = _point(name, dtype), _direction(name, dtype), _pushed(name, dtype)
    cotangent, pulled = _pulled(name, dtype)
    assert [(x.shape, x.dtype) for x in pulled] == [(x.shape, x.dtype) for x in arrays]
    (left, left_size), (right, right_size) = _inner(cotangent, tangent), _inner(pulled, t)
    assert abs(left - right) <= (left_size + right_size) * 16 * unit_roundoff(dtype)


@pytest.mark.parametrize("name", slow_but(["newton_euler"], ["combine", "newton_euler"]))
def test_derivatives_are_the_same_compiled(name):
    """Op by op a pull-back adds up in another order: calls that are kept apart have sums of their own."""
    function, again = OPERATIONS[name].on_arrays(), jax.checkpoint(OPERATIONS[name].on_arrays())
    given = _point(name, "float32"), _direction(name, "float32"), _pulled(name, "float32")[0]
    x, t, c = (list(map(jnp.asarray, arrays)) for arrays in given)
    tangent, gradient = jax.jit(lambda x, t, c: (jax.jvp(again, x, t)[1], jax.vjp(again, *x)[1](c)))(x, t, c)
    _assert_same_bits(tangent, _pushed(name, "float32"))
    _assert_same_bits(gradient, list(map(np.asarray, jax.vjp(function, *x)[1](c))))


# -- helpers ----------------------------------------------------------------------------------------------------------


@functools.cache
def _arrays(name, dtype, seed=0):
    return OPERATIONS[name].arrays(BATCH, dtype, seed)


def _op_by_op(function, arrays):
    return interpreted(function)(*arrays)


@functools.cache
def _value(name, dtype, precision=None):
    """Op by op, with 64-bit types as they are where float32 needs none."""
    with jax.enable_x64(dtype == "float64" or bool(precision)):
        return _op_by_op(OPERATIONS[name].on_arrays(precision), _arrays(name, dtype))


def _evaluated_in(precision, dtype):
    if precision in ("compensated", "faithful"):
        return "float64"
    return "float32" if dtype in ("float16", "bfloat16") else dtype


@functools.cache
def _widened(name, dtype, wide):
    """Of inputs of one dtype, what comes in another, in "reproducible"."""
    with jax.enable_x64(True):
        return _op_by_op(OPERATIONS[name].on_arrays(), [x.astype(wide) for x in _arrays(name, dtype)])


def _point(name, dtype):
    """The same numbers in every dtype."""
    return [x.astype(dtype) for x in _arrays(name, "float32")]


def _direction(name, dtype):
    rng = np.random.default_rng(1)
    return [rng.standard_normal(x.shape).astype(np.float32).astype(dtype) for x in _arrays(name, "float32")]


@functools.cache
def _pushed(name, dtype):
    x, t = _point(name, dtype), _direction(name, dtype)
    with jax.enable_x64(dtype == "float64"):
        function = OPERATIONS[name].on_arrays()
        return _op_by_op(lambda *xt: jax.jvp(function, xt[: len(x)], xt[len(x) :])[1], x + t)


@functools.cache
def _pulled(name, dtype):
    """(cotangent, what is pulled back)."""
    rng = np.random.default_rng(2)
    cotangent = [rng.standard_normal(x.shape).astype(dtype) for x in _pushed(name, dtype)]
    with jax.enable_x64(dtype == "float64"):
        function = OPERATIONS[name].on_arrays()
        return cotangent, _op_by_op(
            lambda *x: jax.vjp(function, *x)[1](list(map(jnp.asarray, cotangent))), _point(name, dtype)
        )


def _differences(name):
    x, t = _point(name, "float64"), _direction(name, "float64")
    steps = STEP * np.array([s * k for k in (1, 2, 3, 4) for s in (1, -1)])
    spread = [a + steps.reshape((8, *[1] * a.ndim)) * b for a, b in zip(x, t, strict=True)]
    with jax.enable_x64(True):
        found = _op_by_op(OPERATIONS[name].on_arrays(), spread)
    return [sum(w * (y[2 * k] - y[2 * k + 1]) for k, w in enumerate(WEIGHTS)) / STEP for y in found]


def _zeros_like(f, *item):
    return [jnp.zeros(x.shape, x.dtype) for x in jax.eval_shape(f, *item)]


def _inner(a, b):
    """(the inner product of two lists of arrays, the sum of the absolute values of its terms), exactly."""
    terms = [rationals(x) * rationals(y) for x, y in zip(a, b, strict=True)]
    return sum(np.sum(x) for x in terms), sum(np.sum(abs(x)) for x in terms)


def _assert_near(x, exact, n):
    """Within n u of the largest component, item by item; masks are the same."""
    if x.dtype == bool:
        return np.testing.assert_array_equal(x, exact)
    axes = tuple(range(len(BATCH), x.ndim))
    size = abs(exact).max(axes, keepdims=True)
    assert (abs(x.astype(np.float64) - exact) <= n * float(unit_roundoff(x.dtype)) * size).all()


def _assert_same_bits(result, expected):
    for x, y in zip(map(np.asarray, result), expected, strict=True):
        assert (x.shape, x.dtype) == (y.shape, y.dtype)
        assert x.tobytes() == y.tobytes(), (x, y)
