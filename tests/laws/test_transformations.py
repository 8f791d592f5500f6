"""Every operation gives the same numbers in every transformation, of every dtype, over every batch.

In precision "reproducible" (the default) values are bitwise those of the naive NumPy formula of the table, 16-bit types
included: eager, jit, vmap, vmap of vmap, scan, cond, checkpoint, and with arguments known while tracing. In all other
precisions they keep the bound of the docstring. Derivatives are those of the exact formula, pull-backs belong to
tangents.
"""

import functools
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxspatial.measure.error import unit_roundoff
from jaxspatial.measure.exact import rationals
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.operations import FORMULAS, OPERATIONS, REPRESENTATIVES, violations

BATCH = (3, 2)
CONTEXTS = {
    "eager": lambda f: f,
    "jit": jax.jit,
    "vmap": jax.vmap,
    "vmap_of_vmap": lambda f: jax.jit(jax.vmap(jax.vmap(f))),
    "scan": lambda f: lambda *args: lax.scan(lambda _, x: (None, f(*x)), None, args)[1],
    "cond": lambda f: lambda *args: lax.cond(_true(), f, functools.partial(_zeros_like, f), *args),
    "checkpoint": lambda f: jax.jit(jax.checkpoint(f)),
    "known": lambda f: lambda *args: jax.jit(lambda first: f(first, *_known(args[1:])))(args[0]),
}
ALL = tuple(OPERATIONS)
FEW = REPRESENTATIVES[:3]
FIRST = REPRESENTATIVES[:1]
NONE = ()
# Each formula once.
OWN = [name for name in ALL if not OPERATIONS[name].twin]
SHORT = [name for name in ALL if not OPERATIONS[name].is_long]
OF_SEVERAL = [name for name in OWN if " " in OPERATIONS[name].arguments]
# What has derivatives, with a precision to choose and without.
SUMS = [name for name in OWN if OPERATIONS[name].differentiable and OPERATIONS[name].bounds]
OTHERS = [name for name in OWN if OPERATIONS[name].differentiable and not OPERATIONS[name].bounds]
SHARED = [name for name in SUMS if name in OF_SEVERAL and (name in SHORT or name in REPRESENTATIVES)]
SHARED_OTHERS = [name for name in OTHERS if name in OF_SEVERAL and name in SHORT]

# A dtype, and whether 64-bit types are on; where they are, narrower ones must not be widened.
HALF, BRAIN, WIDE = ("float16", True), ("bfloat16", True), ("float64", True)
SINGLE, SINGLE_X64 = ("float32", False), ("float32", True)
FORMATS = [HALF, BRAIN, SINGLE, SINGLE_X64, WIDE]


def _named(case):
    return "-".join(f"{x[0]}-{'x64' if x[1] else 'x32'}" if x in FORMATS else str(x) for x in case)


def _table(names, *rows):
    """Parametrizes over rows (what a case is beside its operation, the operations, those that are not slow)."""
    cases = [
        pytest.param(name, *rest, id=_named((name, *rest)), marks=[] if name in usual else pytest.mark.slow)
        for *rest, operations, usual in rows
        for name in operations
    ]
    indirect = [name for name in ("dtype",) if name in names]
    return pytest.mark.parametrize(("name", *names), cases, indirect=indirect)


# Everything in the surroundings that differ the most to a formula, representatives in all of them. By default each
# operation in float32, compiled; the first of each kind of arithmetic, or all where that is cheap, in everything else.
surroundings = _table(
    ("dtype", "context"),
    (SINGLE, "vmap", ALL, ALL),
    (SINGLE, "known", ALL, REPRESENTATIVES),
    (SINGLE, "eager", REPRESENTATIVES, REPRESENTATIVES),
    (SINGLE, "jit", REPRESENTATIVES, REPRESENTATIVES),
    (SINGLE, "vmap_of_vmap", REPRESENTATIVES, REPRESENTATIVES),
    (SINGLE, "scan", REPRESENTATIVES, REPRESENTATIVES),
    (SINGLE, "cond", REPRESENTATIVES, REPRESENTATIVES),
    (SINGLE, "checkpoint", REPRESENTATIVES, REPRESENTATIVES),
    (WIDE, "vmap", ALL, FEW),
    (WIDE, "known", ALL, FEW),
    (WIDE, "eager", ALL, FEW),
    (WIDE, "jit", REPRESENTATIVES, FEW),
    (WIDE, "vmap_of_vmap", REPRESENTATIVES, FEW),
    (WIDE, "scan", REPRESENTATIVES, FEW),
    (WIDE, "cond", REPRESENTATIVES, FEW),
    (WIDE, "checkpoint", REPRESENTATIVES, FEW),
    (SINGLE_X64, "vmap", ALL, FEW),
    (SINGLE_X64, "known", ALL, FEW),
    (HALF, "vmap", ALL, FEW),
    (HALF, "known", ALL, FEW),
    (BRAIN, "vmap", ALL, FEW),
    (BRAIN, "known", ALL, FEW),
)
batches = _table(
    ("batch_shape", "context"),
    ((), "eager", ALL, FEW),
    ((), "known", ALL, FEW),
    ((), "nested_vmap", ALL, FEW),
    ((1,), "eager", ALL, FEW),
    ((1,), "known", ALL, FEW),
    ((1,), "nested_vmap", ALL, FEW),
    ((3, 1, 2, 1), "eager", ALL, FEW),
    ((3, 1, 2, 1), "known", ALL, FEW),
    ((3, 1, 2, 1), "nested_vmap", ALL, OWN),
)
bounds_in_every_context = _table(
    ("precision",),
    ("fast", REPRESENTATIVES, NONE),
    ("compensated", REPRESENTATIVES, FEW),
    ("faithful", REPRESENTATIVES, NONE),
)
bounds = _table(
    ("precision",),
    ("fast", REPRESENTATIVES, FEW),
    ("compensated", FORMULAS, FEW),
    ("faithful", REPRESENTATIVES, FEW),
)
# One of the 16-bit types, and one of the float32: the others go through the same formulas.
differentiable = _table(
    ("precision", "dtype"),
    ("reproducible", SINGLE, SUMS, SUMS),
    ("reproducible", WIDE, SUMS, SUMS),
    ("reproducible", BRAIN, SUMS, SUMS),
    ("fast", SINGLE, SUMS, FIRST),
    ("fast", WIDE, SUMS, FIRST),
    (None, SINGLE, OTHERS, OTHERS),
    (None, WIDE, OTHERS, OTHERS),
    (None, BRAIN, OTHERS, OTHERS),
)
# In one of the two, which differ in how they add up and not in what they are to JAX, but for representatives.
whole_sums = _table(
    ("precision",),
    ("compensated", FORMULAS, REPRESENTATIVES),
    ("faithful", REPRESENTATIVES, NONE),
)
shared_items = _table(
    ("precision", "how"),
    ("reproducible", "vmap", SHARED, SHARED),
    ("reproducible", "broadcasting", REPRESENTATIVES, NONE),
    ("compensated", "vmap", REPRESENTATIVES, NONE),
    ("compensated", "broadcasting", REPRESENTATIVES, NONE),
    (None, "vmap", SHARED_OTHERS, SHARED_OTHERS),
)
contexts = pytest.mark.parametrize("context", CONTEXTS)


@pytest.fixture(params=FORMATS, ids=lambda param: _named([param]))
def dtype(request):
    with jax.enable_x64(request.param[1]):
        yield request.param[0]


# -- values -----------------------------------------------------------------------------------------------------------


@surroundings
def test_value_is_bitwise_the_naive_formula(name, context, dtype):
    inputs = _inputs(name, dtype, BATCH)
    result = CONTEXTS[context](OPERATIONS[name].function)(*_on_device(inputs))
    _assert_same_bits(result, _naive(name, dtype, BATCH))


@pytest.mark.parametrize("dtype", ["float16", "bfloat16"])
@pytest.mark.parametrize("name", slow_but(REPRESENTATIVES, OPERATIONS))
def test_sixteen_bits_are_the_same_without_64_bit_types(name, dtype):
    result = OPERATIONS[name].function(*_on_device(_inputs(name, dtype, BATCH)))
    _assert_same_bits(result, _naive(name, dtype, BATCH))


@pytest.mark.parametrize("dtype", ["float16", "bfloat16"])
def test_sixteen_bits_are_rounded_between_operations(dtype):
    """In one program too, where a conversion there and back could be left out."""
    F, p = _on_device(_inputs("shift_force", dtype, BATCH))

    shift = OPERATIONS["shift_force"].function

    def there_and_on(F, p):
        return shift(shift(F, p), p)

    _assert_same_bits(jax.jit(there_and_on)(F, p), jax.tree.leaves(there_and_on(F, p)))


@batches
def test_batch_by_broadcasting_and_by_nested_vmap(name, batch_shape, context):
    transform = CONTEXTS.get(context) or functools.partial(_nested_vmap, len(batch_shape))
    inputs = _inputs(name, "float32", batch_shape)
    result = transform(OPERATIONS[name].function)(*_on_device(inputs))
    _assert_same_bits(result, _naive(name, "float32", batch_shape))


@pytest.mark.parametrize("name", slow_but(SHORT, OF_SEVERAL))
def test_one_item_is_shared_by_a_batch(name, x64):
    for i in range(len(OPERATIONS[name].arguments.split())):
        inputs = _one_shared(name, i, BATCH)
        if OPERATIONS[name].arguments.split()[i] in "FA" and "scalar" in OPERATIONS[name].arguments.split():
            with pytest.raises(ValueError, match="one per vector of the batch"):
                OPERATIONS[name].function(*_on_device(inputs))
            continue
        result = interpreted(OPERATIONS[name].function)(*inputs)
        leaves = jax.tree.leaves(result)
        assert all(leaf.shape[:2] == BATCH for leaf in leaves)
        expected = zip(OPERATIONS[name].naive(*inputs), leaves, strict=True)
        _assert_same_bits(result, [np.broadcast_to(x, leaf.shape) for x, leaf in expected])


@contexts
@bounds_in_every_context
def test_bound_of_the_docstring_in_every_context(name, precision, context):
    result = CONTEXTS[context](_function(name, precision))(*_on_device(_inputs(name, "float32", BATCH)))
    _assert_within_bounds(result, name, precision, "float32")


@bounds
def test_bound_of_the_docstring_with_64_bit_types_on(name, precision):
    """With them off, and in all dtypes: see `laws.test_error_bounds`."""
    with jax.enable_x64(True):
        result = jax.jit(_function(name, precision))(*_on_device(_inputs(name, "float32", BATCH)))
    _assert_within_bounds(result, name, precision, "float32")


# -- derivatives ------------------------------------------------------------------------------------------------------


@differentiable
def test_tangent_is_the_exact_linearisation(name, precision, dtype):
    value, tangent = _pushed(name, precision, dtype, jax.config.jax_enable_x64)
    _assert_near(tangent, _linearisation(name, dtype), dtype)
    if precision != "fast":
        _assert_same_bits(value, _naive(name, dtype, BATCH))


@differentiable
def test_pull_back_is_the_transpose_of_the_tangent(name, precision, dtype):
    x, t = (_on_device(_inputs(name, dtype, BATCH, seed)) for seed in (0, 1))
    _, tangent = _pushed(name, precision, dtype, jax.config.jax_enable_x64)
    _assert_transpose(_function(name, precision), x, t, tangent)


@whole_sums
def test_derivatives_of_whole_sums(name, precision):
    """The last two tests for the precisions that `laws.test_derivatives` holds against their bounds."""
    x, t = (_on_device(_inputs(name, "float32", BATCH, seed)) for seed in (0, 1))
    tangent = _pushed(name, precision, "float32", jax.config.jax_enable_x64)[1]
    _assert_near(tangent, _linearisation(name, "float32"), "float32")
    _assert_transpose(_function(name, precision), x, t, tangent)


@shared_items
def test_pull_back_of_an_item_shared_by_a_batch(name, precision, how):
    of_all = _function(name, precision)
    for i in range(len(OPERATIONS[name].arguments.split())):
        x, t = (_on_device(_one_shared(name, i, BATCH[:1], seed)) for seed in (0, 1))
        axes = tuple(None if j == i else 0 for j in range(len(x)))
        function = of_all if how == "broadcasting" else jax.vmap(of_all, axes)
        _assert_transpose(function, x, t, interpreted(functools.partial(jax.jvp, function))(x, t)[1])


@pytest.mark.parametrize(
    "dtype",
    [slow(BRAIN), SINGLE, slow(WIDE)],
    indirect=True,
    ids=lambda param: _named([param]),
)
@pytest.mark.parametrize(
    "name",
    slow_but(REPRESENTATIVES, [*SUMS, *OTHERS]),
)
def test_gradient_is_bitwise_the_same_compiled_and_recomputed(name, dtype):
    function = OPERATIONS[name].function
    x = _on_device(_inputs(name, dtype, BATCH))
    cotangent = _cotangent(jax.eval_shape(function, *x))
    gradient = jax.jit(functools.partial(_pulled, jax.checkpoint(function)))(x, cotangent)
    _assert_same_bits(gradient, _leaves(interpreted(functools.partial(_pulled, function))(x, cotangent)))


# -- helpers ----------------------------------------------------------------------------------------------------------


@functools.cache
def _inputs(name, dtype, batch_shape, seed=0):
    return OPERATIONS[name].inputs(batch_shape, dtype, np.random.default_rng(seed))


def _one_shared(name, i, batch_shape, seed=0):
    """Inputs of which the i-th is a single item beside batches."""
    one, many = (_inputs(name, "float32", shape, seed) for shape in ((), batch_shape))
    return (*many[:i], one[i], *many[i + 1 :])


@functools.cache
def _naive(name, dtype, batch_shape):
    return OPERATIONS[name].naive(*_inputs(name, dtype, batch_shape))


@functools.cache
def _sized(name, dtype, batch_shape):
    return OPERATIONS[name].sized(*_inputs(name, dtype, batch_shape))


@functools.cache
def _pushed(name, precision, dtype, x64):
    x, t = (_inputs(name, dtype, BATCH, seed) for seed in (0, 1))
    return interpreted(functools.partial(jax.jvp, _function(name, precision)))(x, t)


@functools.cache
def _linearisation(name, dtype):
    """Central differences over fractions: nothing is rounded, and the step is too small to matter."""
    step = Fraction(1, 2**100)
    x, t = ([rationals(leaf) for leaf in _leaves(_inputs(name, dtype, BATCH, seed))] for seed in (0, 1))
    ahead, behind = (OPERATIONS[name].naive([a + s * b for a, b in zip(x, t, strict=True)]) for s in (step, -step))
    return [(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)]


def _function(name, precision):
    function = OPERATIONS[name].function
    return functools.partial(function, precision=precision) if precision else function


def _true():
    return jnp.asarray(True)


def _zeros_like(f, *args):
    return jax.tree.map(jnp.zeros_like, f(*args))


def _nested_vmap(depth, f):
    for _ in range(depth):
        f = jax.vmap(f)
    return f


def _known(tree):
    return jax.tree.map(np.asarray, tree)


def _on_device(tree):
    return jax.tree.map(jnp.asarray, tree)


def _leaves(tree):
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def _types(tree):
    return [(leaf.shape, leaf.dtype) for leaf in jax.tree.leaves(tree)]


def _assert_transpose(function, x, t, tangent):
    """cotangent . tangent = pulled . t, and what is pulled back has the shapes and dtypes of x."""
    cotangent = _cotangent(jax.eval_shape(function, *x))
    pulled = interpreted(functools.partial(_pulled, function))(x, cotangent)
    assert jax.tree.structure(pulled) == jax.tree.structure(x)
    assert _types(pulled) == _types(x)
    left, left_size = _inner(cotangent, tangent)
    right, right_size = _inner(pulled, t)
    assert abs(left - right) <= (left_size + right_size) * 16 * unit_roundoff(jax.tree.leaves(x)[0].dtype)


def _pulled(function, x, cotangent):
    return jax.vjp(function, *x)[1](cotangent)


def _cotangent(value):
    rng = np.random.default_rng(2)
    return jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(x.shape).astype(x.dtype)), value)


def _inner(a, b):
    """(the inner product of two trees, the sum of the absolute values of its terms), exactly."""
    terms = [rationals(x) * rationals(y) for x, y in zip(_leaves(a), _leaves(b), strict=True)]
    return sum(np.sum(x) for x in terms), sum(np.sum(abs(x)) for x in terms)


def _assert_near(tangent, expected, dtype):
    for array, exact in zip(_leaves(tangent), expected, strict=True):
        assert array.dtype == dtype
        assert abs(rationals(array) - exact).max() <= 32 * unit_roundoff(dtype) * abs(exact).max()


def _assert_within_bounds(result, name, precision, dtype):
    for array, exact, bound in zip(_leaves(result), _sized(name, dtype, BATCH), OPERATIONS[name].bounds, strict=True):
        assert array.dtype == dtype
        assert not violations(bound, precision, array, exact).any()


def _assert_same_bits(result, expected):
    assert _types(result) == _types(expected)
    for x, y in zip(_leaves(result), expected, strict=True):
        assert x.tobytes() == y.tobytes(), (x, y)
