"""Derivatives keep the bounds of "compensated" and "faithful" in each component, held against exact rationals.

Tangents and pull-backs are sums of products of their own, which may cancel where the value does not.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.measure.inputs import FAMILIES, with_condition
from jaxspatial.numerics.promise import EXACT, Promise
from tests.helpers import duals, hostile
from tests.helpers.marks import slow
from tests.helpers.operation import violations
from tests.helpers.operations import OPERATIONS
from tests.laws.cases import DERIVATIVES

N = 4
# Operations, and which of their arrays all items share: those of the last argument, those of the first.
SHARED = [
    ("shift_force", {2}),
    ("shift_force", {0, 1}),
    ("shift_velocity", {2}),
    ("dot_force_velocity", {0, 1}),
    ("dot_force_velocity", {2, 3}),
]


@DERIVATIVES.parametrize
def test_tangent(name, dtype, precision, run):
    arrays, tangents = _directions(name, dtype)
    with jax.enable_x64(dtype == "float64"):
        results = run(_jvp(name, precision))(arrays, tangents)
    _check(name, precision, _bounds(name), results, _pushed(name, dtype))


@DERIVATIVES.parametrize
def test_pull_back_of_each_result_alone(name, dtype, precision, run):
    arrays, cotangents = _covectors(name, dtype)
    for part in (i for i, bound in enumerate(_bounds(name)) if bound != EXACT):
        with jax.enable_x64(dtype == "float64"):
            results = run(_vjp_of_part(name, precision, part))(arrays, cotangents[part])
        _check(name, precision, [_worst(name)] * len(arrays), results, _pulled(name, dtype, part))


@DERIVATIVES.parametrize
def test_pull_back_of_all_results(name, dtype, precision, run):
    """Also to arguments that are passed on as they are, or that enter several results."""
    arrays, cotangents = _covectors(name, dtype)
    with jax.enable_x64(dtype == "float64"):
        results = run(_vjp(name, precision))(arrays, cotangents)
    _check(name, precision, [_worst(name)] * len(arrays), results, _pulled(name, dtype))


@pytest.mark.parametrize("how", ["vmap", slow("broadcasting")])
@pytest.mark.parametrize("precision", ["compensated", slow("faithful")])
@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
@pytest.mark.parametrize(("name", "shared"), SHARED)
def test_pull_back_to_an_item_that_a_batch_shares(name, shared, dtype, precision, how):
    """It is one sum over the batch, rounded once. Only the computed result has a cotangent."""
    arrays, cotangents = _covectors(name, dtype)
    part = _FREE.get(name, (0, 0))[1]
    expected = _pulled(name, dtype, part, frozenset(shared))
    with jax.enable_x64(dtype == "float64"):
        given = [x[0] if i in shared else x for i, x in enumerate(arrays)]
        computed = _shared_vjp(name, precision, part, shared, how)(given, cotangents[part])
    bounds = [_of_sum(_worst(name), len(cotangents[0])) if i in shared else _worst(name) for i in range(len(arrays))]
    summed = [x.sum(0) if i in shared else x for i, x in enumerate(expected)]
    _check(name, precision, bounds, computed, summed)


@pytest.mark.parametrize(
    ("name", "precision"),
    [
        *(("dot_force_velocity", precision) for precision in js.Precision),
        ("shift_acceleration", "compensated"),
        *(slow("shift_acceleration", precision) for precision in ("fast", "reproducible", "faithful")),
    ],
)
def test_hessian(name, precision):
    """Of the last result contracted with a vector: exact second differences are what the formula gives."""
    arrays = [x[0] for x in hostile.arranged(name, FAMILIES["benign"], np.random.default_rng(4), 1, "float32")]
    places = [(j, k) for j in range(len(arrays)) for k in range(3)]
    function = OPERATIONS[name].on_arrays(precision)
    with jax.enable_x64(False):
        hessian = jax.jit(jax.jacfwd(jax.jacrev(lambda x: jnp.sum(function(*x)[-1]))))([jnp.asarray(x) for x in arrays])
    computed = np.array([[hessian[j][m][k, n] for m, n in places] for j, k in places])
    np.testing.assert_allclose(computed, _second_differences(name, arrays, places), rtol=1e-6, atol=1e-6)


def _second_differences(name, arrays, places):
    """In float64, at steps of 1: of polynomials of third degree symmetric differences are exact but for rounding."""

    def value(*steps):
        moved = [x.astype(np.float64) for x in arrays]
        for (j, k), step in steps:
            moved[j][k] += step
        return np.sum(OPERATIONS[name].naive(*moved)[-1])

    signs = [(s, t) for s in (1, -1) for t in (1, -1)]
    return [[sum(s * t * value((a, s), (b, t)) for s, t in signs) / 4 for b in places] for a in places]


# -- computed ---------------------------------------------------------------------------------------------------------


def _jvp(name, precision):
    function = OPERATIONS[name].on_arrays(precision)
    return jax.vmap(lambda x, t: jax.jvp(function, tuple(x), tuple(t))[1])


def _vjp(name, precision):
    function = OPERATIONS[name].on_arrays(precision)
    return jax.vmap(lambda x, c: jax.vjp(function, *x)[1](list(c)))


def _vjp_of_part(name, precision, part):
    function = OPERATIONS[name].on_arrays(precision)
    return jax.vmap(lambda x, c: jax.vjp(lambda *a: function(*a)[part], *x)[1](c))


def _shared_vjp(name, precision, part, shared, how):
    function = OPERATIONS[name].on_arrays(precision)
    axes = tuple(None if i in shared else 0 for i in range(len(OPERATIONS[name].shapes)))
    batched = jax.vmap(function, axes) if how == "vmap" else function
    return jax.jit(lambda x, c: jax.vjp(lambda *a: batched(*a)[part], *x)[1](c))


# -- inputs and exact results -----------------------------------------------------------------------------------------


@functools.cache
def _directions(name, dtype):
    """(arrays, tangents): of every family, and such that the tangents cancel, where a term of their own allows it."""
    count, rng = len(OPERATIONS[name].shapes), np.random.default_rng(11)
    groups = [_pair(name, family, rng, dtype) for family in FAMILIES.values()]
    if name in _FREE:
        groups += [_cancelling(name, rng, dtype, condition) for condition in hostile.conditions(dtype)]
    joined = [np.concatenate(x) for x in zip(*groups, strict=True)]
    return joined[:count], joined[count:]


def _pair(name, family, rng, dtype):
    """Twice the arrays of an operation, all of one draw: as close to parallel as the family makes them."""
    shapes = OPERATIONS[name].shapes
    rows = max(int(np.prod(shape)) // 3 for shape in shapes)
    vectors = family(rng, 2 * len(shapes), N * rows, jnp.dtype(dtype))
    return [
        x.reshape(N, -1)[:, : np.prod(shape)].reshape(N, *shape) for x, shape in zip(vectors, shapes * 2, strict=True)
    ]


# The argument that is a term of a result as it stands, and the place of that result.
_FREE = {"shift_force": (0, 0), "shift_velocity": (1, 1), "shift_acceleration": (1, 1)}


def _cancelling(name, rng, dtype, condition):
    """arrays and tangents, the tangent of the free argument opposed to all other terms."""
    free, place = _FREE[name]
    others = _pair(name, FAMILIES["benign"], rng, dtype)
    count = len(others) // 2
    rest = [x for i, x in enumerate(others) if i != count + free]

    def rate(first, *rest):
        full = [*rest[: count + free], first, *rest[count + free :]]
        return duals.pushed(name, full[:count], full[count:])[place]

    first, *rest = with_condition(rng, rate, rest, condition)
    return [*rest[: count + free], first, *rest[count + free :]]


@functools.cache
def _pushed(name, dtype):
    return duals.pushed(name, *_directions(name, dtype))


@functools.cache
def _covectors(name, dtype):
    """(arrays, cotangents), all of one draw of every family; and such that pull-backs of shifts cancel."""
    rng = np.random.default_rng(13)
    groups = [_with_cotangents(name, family, rng, dtype) for family in FAMILIES.values()]
    if name in ("shift_force", "shift_velocity"):
        groups += [_cancelling_pull_back(name, rng, dtype, condition) for condition in hostile.conditions(dtype)]
    joined = [np.concatenate(x) for x in zip(*groups, strict=True)]
    count = len(OPERATIONS[name].shapes)
    return joined[:count], joined[count:]


def _with_cotangents(name, family, rng, dtype):
    arrays = _pair(name, family, rng, dtype)
    given, more = arrays[: len(arrays) // 2], arrays[len(arrays) // 2 :]
    shapes = [np.shape(r) for r in OPERATIONS[name].naive(*given)]
    pool = [x.reshape(-1) for x in more] * 2
    return [*given, *(x[: np.prod(shape)].reshape(shape) for x, shape in zip(pool, shapes, strict=False))]


def _cancelling_pull_back(name, rng, dtype, condition):
    """The cotangent of what is passed on is opposed to what comes back from the other result."""
    arrays = _with_cotangents(name, FAMILIES["benign"], rng, dtype)
    free = 1 if name == "shift_force" else 0
    rest = [x for i, x in enumerate(arrays) if i != 3 + free]

    def back(first, *rest):
        full = [*rest[: 3 + free], first, *rest[3 + free :]]
        return duals.pulled(name, full[:3], full[3:])[free]

    first, *rest = with_condition(rng, back, rest, condition)
    return [*rest[: 3 + free], first, *rest[3 + free :]]


@functools.cache
def _pulled(name, dtype, part=None, shared=frozenset()):
    """Of all results or of one alone; with some of the arguments the same for all items."""
    arrays, cotangents = _covectors(name, dtype)
    given = [np.broadcast_to(x[0], x.shape) if i in shared else x for i, x in enumerate(arrays)]
    incoming = [c if part in (None, i) else np.zeros_like(c) for i, c in enumerate(cotangents)]
    return duals.pulled(name, given, incoming)


# -- bounds -----------------------------------------------------------------------------------------------------------


def _worst(name) -> Promise:
    return max((b for b in _bounds(name) if b != EXACT), key=lambda b: b.u2)


def _bounds(name) -> tuple:
    return OPERATIONS[name].bounds or ()


def _of_sum(bound, n):
    rounds = int(np.ceil(np.log2(n)))
    return Promise(u2=bound.u2 + 2 * (2 + rounds) ** 2, u3=n**2)


def _check(name, precision, bounds, results, expected):
    for i, (bound, computed, exactly) in enumerate(zip(bounds, results, expected, strict=True)):
        wrong = violations(bound, precision, computed, exactly)
        assert not wrong.any(), (name, precision, i, int(wrong.sum()), np.argwhere(wrong)[:5].tolist())
