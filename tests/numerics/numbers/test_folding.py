"""Numbers known while tracing leave nothing behind, and change nothing else."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspatial.numerics import linear
from jaxspatial.numerics.formula import Argument
from jaxspatial.numerics.numbers import Rounded
from jaxspatial.numerics.numbers.layout import stack, unstack
from jaxspatial.numerics.numbers.rounded import add, is_known, multiply, subtract
from jaxspatial.numerics.precision import Precision, resolve
from jaxspatial.numerics.sums.pairwise import pairwise_sum

P = Precision.REPRODUCIBLE
X = np.array([0.3, -1.7, 2.9], np.float32)


def _operations(function, *arguments):
    """The names of the arithmetic operations that a function traces to."""
    quiet = {
        "slice",
        "squeeze",
        "stack",
        "concatenate",
        "broadcast_in_dim",
        "reshape",
        "transpose",
        "pad",
        "jaxspatial_unstack",
    }
    return sorted(e.primitive.name for e in jax.make_jaxpr(function)(*arguments).eqns if e.primitive.name not in quiet)


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_stack_undoes_unstack(batch):
    x = np.random.default_rng(0).standard_normal((*batch, 3)).astype(np.float32)
    for given in (x, jnp.asarray(x)):
        components = unstack(given)
        assert all(np.shape(c) in (batch, ()) for c in components)
        np.testing.assert_array_equal(np.asarray(stack(components, batch)), x)


def test_a_column_of_one_number_is_known():
    x = np.array([[0.0, 1.0, 2.0], [0.0, 1.0, 3.0]], np.float32)
    first, second, third = unstack(x)
    assert is_known(first, 0) and is_known(second, 1) and not is_known(third)


def test_known_numbers_fold():
    zero, one, minus_one, two = np.array([0, 1, -1, 2], np.float32)
    assert _operations(lambda x: multiply(zero, x, P), X) == []
    assert _operations(lambda x: multiply(x, one, P), X) == []
    assert _operations(lambda x: multiply(minus_one, x, P), X) == ["neg"]
    assert _operations(lambda x: add(x, zero, P), X) == []
    assert _operations(lambda x: subtract(x, zero, P), X) == []
    assert _operations(lambda x: subtract(zero, x, P), X) == ["neg"]
    assert _operations(lambda x: multiply(multiply(two, two, P), x, P), X) == ["jaxspatial_product"]
    assert multiply(two, two, P) == 4 and type(multiply(two, two, P)) is np.float32


@pytest.mark.parametrize("precision", [Precision.FAST, P])
@pytest.mark.parametrize("operation", [add, subtract, multiply, lambda a, b, p: Rounded(p, a) < Rounded(p, b)])
def test_a_known_number_beside_an_array_is_one_operation(operation, precision):
    """It is not repeated first: that would be one more to trace, and take longer than the operation."""
    x, n = np.float32([[0.3], [-1.7], [2.9]]), np.float32(2.5)
    for pair in (lambda x: (x, n), lambda x: (n, x)):
        traced = jax.jit(lambda x, pair=pair: operation(*pair(x), precision))
        assert len(traced.trace(x).jaxpr.eqns) == 1
        np.testing.assert_array_equal(traced(x), operation(*pair(x), precision))


def test_cross_with_an_axis_is_two_products():
    axis = Argument(P, np.float32([0, 0, 2]))
    assert _operations(lambda x: [c.value for c in linear.cross(axis, Argument(P, x))], X) == [
        "jaxspatial_barrier",
        *["jaxspatial_product"] * 2,
        "neg",
    ]


def test_parallel_axes_leave_nothing():
    a, b = (Argument(P, np.float32(v)) for v in ([0, 0, 2], [0, 0, -3]))
    assert all(is_known(c.value, 0) for c in linear.cross(a, b))


def test_a_known_zero_is_exact_beside_infinity():
    x = jnp.array([jnp.inf, jnp.nan, 1.0], jnp.float32)
    axis = Argument(P, np.float32([0, 0, 1]))
    assert linear.dot(axis, Argument(P, x)).value == 1


def test_a_sum_is_one_operation_on_arrays_or_one_per_component():
    """Whichever is asked for; per component where something is known. What is given is read behind a barrier."""
    x, given = jnp.asarray(X), "jaxspatial_barrier"

    def as_array(a, b):
        return (Argument(P, a) + [Rounded(P, c) for c in unstack(b)]).array

    def apart(a, b):
        return [c.value for c in Argument(P, a) - Argument(P, b)]

    assert _operations(as_array, x, x) == [given, "jaxspatial_sum"]
    assert _operations(apart, x, x) == [given] * 2 + ["jaxspatial_difference"] * 3
    found = _operations(lambda a: as_array(a, np.float32([0, 1, 2])), x)
    assert found == [given] + ["jaxspatial_sum"] * 2
    np.testing.assert_array_equal(as_array(x, x), X + X)
    np.testing.assert_array_equal(apart(x, 2 * x), -X)


@pytest.mark.parametrize("n", [0, 1, 2, 3, 5, 8, 100])
def test_pairwise_sum_is_the_sum_by_halving(n):
    x = np.random.default_rng(n).standard_normal((2, n)).astype(np.float32)
    expected = np.pad(x, ((0, 0), (0, (1 << max(n - 1, 0).bit_length()) - n)))
    while expected.shape[1] > 1:
        half = expected.shape[1] // 2
        expected = expected[:, :half] + expected[:, half:]
    for function in (pairwise_sum, jax.jit(pairwise_sum), jax.jit(jax.vmap(pairwise_sum))):
        np.testing.assert_array_equal(np.asarray(function(jnp.asarray(x))), expected[:, 0])


def test_pairwise_sum_keeps_a_negative_zero():
    assert np.signbit(pairwise_sum(jnp.full((3,), -0.0, jnp.float32)))


@pytest.mark.parametrize("name", ["fast", "reproducible"])
def test_a_precision_is_its_name(name):
    assert resolve(name) is Precision(name) and resolve(Precision(name)) == name
    assert resolve(None) is Precision.REPRODUCIBLE
