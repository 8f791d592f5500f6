"""Derivatives of exp and log, first and second, in both modes, across every switch and on both sides of half a turn.

In NumPy (`interpreted`), but for "fast": that compiled programs decide alike in all their results, at every switch,
`test_derivatives_of_log` holds of the logarithm of an exponential, and `test_directions.test_decisions_of_angles_agree_
with_themselves` of the exponential.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers import exact_rotation as exact
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow
from tests.helpers.rotation_cases import eps, wide_dtypes

CASES = [("float32", "reproducible"), slow("float32", "fast"), slow("float64", "reproducible")]
cases = pytest.mark.parametrize(("dtype", "precision"), [*CASES, slow("float64", "compensated")])
cases_of_log = pytest.mark.parametrize(
    ("dtype", "precision"), [("float32", "fast"), slow("float64", "reproducible"), slow("float64", "compensated")]
)


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


SWITCHES = (
    0.0,
    1e-30,
    1e-8,
    1e-4,
    0.3,
    1 - 1e-6,
    1 + 1e-6,
    1.5,
    2.0,
    2.5,
    3.0,
    3.14,
    3.1416,
    3.15,
    10**0.5 - 1e-6,
    10**0.5 + 1e-6,
    4.5,
)


def at_switches(dtype, angles=SWITCHES):
    rng = np.random.default_rng(7)
    d = rng.standard_normal((len(angles), 3))
    w = d / np.linalg.norm(d, axis=1)[:, None] * np.array(angles)[:, None]
    return w.astype(dtype), rng.standard_normal(w.shape).astype(dtype)


@functools.cache
def exact_derivatives(dtype, order):
    """Of the 9 entries and of the translation, in w."""
    find = exact.first_derivatives if order == 1 else exact.second_derivatives
    w, v = at_switches(dtype)
    return [
        find(lambda x, y=y: [*exact.exp(x), *exact.translation(x, y)], exact.vector(x))
        for x, y in zip(w, map(exact.vector, v), strict=True)
    ]


def over_basis(f, n):
    """Derivatives of f, n numbers of one item: along a direction, of a product with a cotangent, and of that along one.

    Basis vectors come in as a batch: one small program for all components.
    """

    def forward(x, direction):
        return jax.jvp(f, (x,), (direction,))[1]

    def reverse(x, cotangent):
        return jax.vjp(f, x)[1](cotangent)[0]

    def second(x, cotangent, direction):
        return jax.jvp(lambda y: reverse(y, cotangent), (x,), (direction,))[1]

    return forward, reverse, second


def jacobians(f, x, n, precision="reproducible"):
    """(batch, n, k) by forward and by reverse differentiation."""
    forward, reverse, _ = (jax.vmap(jax.vmap(d, (None, 0)), (0, None)) for d in over_basis(f, n))
    columns = evaluated(precision, forward)(x, np.eye(x.shape[-1], dtype=x.dtype))
    rows = evaluated(precision, reverse)(x, np.eye(n, dtype=x.dtype))
    return np.asarray(columns).transpose(0, 2, 1), np.asarray(rows)


def hessians(f, x, n, precision="reproducible"):
    """(batch, n, k, k) by forward over reverse differentiation."""
    second = jax.vmap(jax.vmap(jax.vmap(over_basis(f, n)[2], (None, None, 0)), (None, 0, None)), (0, None, None))
    return np.asarray(evaluated(precision, second)(x, np.eye(n, dtype=x.dtype), np.eye(x.shape[-1], dtype=x.dtype)))


def exp_of_both(x, precision):
    X = js.RigidTransform.exp(js.SpatialVelocity(x[..., :3], x[..., 3:]), precision=precision)
    return jnp.concatenate((X.rotation.entries, X.translation), -1)


@cases
def test_derivatives_of_exp(dtype, precision):
    w, v = at_switches(dtype)
    formula, x = functools.partial(exp_of_both, precision=precision), np.concatenate((w, v), -1)
    for found in jacobians(formula, x, 12, precision):
        wrong = exact.differences(found[..., :3], [x.ravel() for x in exact_derivatives(dtype, 1)])
        assert np.abs(wrong).max() <= 16 * eps(dtype)
        wrong = exact.differences(found[:, 9:, 3:], [list(exact.left_jacobian(exact.vector(x))) for x in w])
        assert np.abs(wrong).max() <= 8 * eps(dtype)
        assert not found[:, :9, 3:].any()


@pytest.mark.parametrize(("dtype", "precision"), CASES)
def test_second_derivatives_of_exp(dtype, precision):
    w, v = at_switches(dtype)
    formula, x = functools.partial(exp_of_both, precision=precision), np.concatenate((w, v), -1)
    found = hessians(formula, x, 12, precision)
    wrong = exact.differences(found[..., :3, :3], [x.ravel() for x in exact_derivatives(dtype, 2)])
    assert np.abs(wrong).max() <= 32 * eps(dtype)
    assert not found[..., 3:, 3:].any()


LOG_SWITCHES = (0.0, 1e-30, 1e-8, 1e-4, 0.3, 1 - 1e-6, 1 + 1e-6, 1.5, 2.0, 2.09, 2.1, 2.5, 3.0, 3.14, 3.1415)


@pytest.mark.parametrize("mode", [slow("forward"), "reverse"])
@cases_of_log
def test_derivatives_of_log(dtype, precision, mode):
    """Of log(exp(e) R) at e = 0, the inverse left Jacobian."""
    w, _ = at_switches(dtype, LOG_SWITCHES)
    # The rotation goes in as data, beside the number to differentiate by.
    R = interpreted(lambda w: js.Rotation.exp(w, precision="compensated").entries)(w)
    forward = lambda R, d: jax.jvp(lambda e: _stepped(R, e, precision), (0 * d,), (d,))[1]  # noqa: E731
    reverse = lambda R, c: jax.vjp(lambda e: _stepped(R, e, precision), 0 * c)[1](c)[0]  # noqa: E731
    exact_ones = [list(exact.left_jacobian(exact.vector(x)) ** -1) for x in w]
    f = {"forward": forward, "reverse": reverse}[mode]
    found = np.asarray(evaluated(precision, jax.vmap(jax.vmap(f, (None, 0)), (0, None)))(R, np.eye(3, dtype=dtype)))
    found = found.transpose(0, 2, 1) if f is forward else found
    assert np.abs(exact.differences(found, exact_ones)).max() <= 32 * eps(dtype)


def _stepped(R, e, precision):
    return (js.Rotation.exp(e, precision=precision) @ js.Rotation(R)).log(precision=precision)


def there_and_back(x):
    V = js.RigidTransform.exp(js.SpatialVelocity(x[..., :3], x[..., 3:])).log()
    return jnp.concatenate((V.w, V.v), -1)


@pytest.mark.parametrize("order", [1, slow(2)])
@wide_dtypes
def test_derivatives_there_and_back(dtype, order):
    """Of log(exp(V)): the identity and 0."""
    x = np.concatenate(at_switches(dtype, LOG_SWITCHES), -1)
    if order == 2:
        assert np.abs(hessians(there_and_back, x, 6)).max() <= 256 * eps(dtype)
    else:
        for found in jacobians(there_and_back, x, 6):
            assert np.abs(found - np.eye(6)).max() <= 64 * eps(dtype)
