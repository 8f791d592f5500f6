"""Formulas over numbers: what is known stays known; loops and calls change nothing; the dtypes that come out."""

import operator
from fractions import Fraction

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.numerics import linear, numbers
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.numbers import Rounded
from tests.helpers.interpreted import interpreted

REPRODUCIBLE = js.Precision.REPRODUCIBLE


@formula
def hypotenuse(v):
    a, b = v
    return (a * a + b * b).sqrt()


@formula
def parts(v, w, count):
    return [tuple(a + b for a, b in zip(v, w, strict=True)), numbers.high(v[0]) > 1, v[0] / count]


@pytest.mark.parametrize("precision", js.Precision)
@pytest.mark.parametrize("dtype", ["float16", "bfloat16", "float32"])
def test_dtypes_stay(dtype, precision, x64):
    found = hypotenuse(precision, jnp.asarray([[3, 4], [5, 12]], dtype))
    assert found.dtype == jnp.dtype(dtype)
    np.testing.assert_array_equal(np.asarray(found, np.float32), [5, 13])


@pytest.mark.parametrize("dtype", ["float16", "bfloat16"])
def test_sixteen_bits_are_rounded_between_formulas(dtype):
    """In one program too, where a conversion there and back could be left out."""
    v = jnp.asarray(np.random.default_rng(0).uniform(1, 2, (50, 2)), dtype)

    def twice(v):
        return hypotenuse("reproducible", jnp.stack((hypotenuse("reproducible", v), v[:, 0]), -1))

    np.testing.assert_array_equal(jax.jit(twice)(v), twice(v))


def test_subnormal_numbers_of_float16_stay():
    v = jnp.asarray([[1e-7, 0.0], [0.0, 3e-6]], jnp.float16)
    np.testing.assert_array_equal(hypotenuse("reproducible", v), v.max(-1))


def test_results_and_batches():
    """Tuples are arrays with a last axis, masks stay masks; batches broadcast."""
    v, w = jnp.ones((4, 1, 2)), jnp.ones((3, 2), jnp.float32)
    total, mask, quotient = parts("reproducible", v, w, count=2)
    assert total.shape == (4, 3, 2) and mask.shape == quotient.shape == (4, 3)
    assert mask.dtype == bool and not mask.any()
    np.testing.assert_array_equal(quotient, np.full((4, 3), 0.5))


def test_double_words_come_back():
    x = js.to_double_word(jnp.float32([[1, 1]])) / 3.0
    found = hypotenuse("reproducible", x)
    assert isinstance(found, js.DoubleWord) and found.dtype == np.float32
    assert abs(float(found.hi[0]) + float(found.lo[0]) - np.sqrt(2) / 3) < 1e-13


def test_what_is_known_stays_known():
    """Through every function of numbers, on NumPy numbers inside of a program: no operation is left."""

    def program(x):
        lane = Rounded(REPRODUCIBLE, np.float32(2.5))
        found = [
            lane * 2 + 1, (lane - 0.5).sqrt(), numbers.nearest_integer(lane), numbers.frozen(lane), abs(-lane),
            numbers.where(lane > 1, lane, 0.0), numbers.constant(lane, Fraction(1, 3)), numbers.doubled(lane, -2),
            numbers.times_power_of_two(lane, np.int32(3)), *linear.entrywise(operator.mul, [lane], [lane]),
            numbers.noinline(lambda a: a / 3)(lane), *numbers.repeated(lambda v: (v[0] * 0.5,), 2, (lane,)),
        ]  # fmt: skip
        assert all(isinstance(y.value, np.float32) for y in found)
        np.testing.assert_array_equal([float(y.value) for y in found[:6]], [6, np.float32(2) ** 0.5, 2, 2.5, 2.5, 2.5])
        assert float(found[8].value) == 20 and float(found[-1].value) == 0.625
        return x

    assert not jax.make_jaxpr(program)(1.0).eqns


@pytest.mark.parametrize("kind", ["lane", "double"])
def test_calls_and_loops_change_nothing(kind):
    """noinline, noinline_pairs, each and repeated give the bits of what they call."""
    x = jnp.asarray(np.random.default_rng(0).standard_normal((3, 50)).astype(np.float32))
    number = (lambda a: Rounded(REPRODUCIBLE, a)) if kind == "lane" else js.to_double_word

    def value(found):
        return [y.value if isinstance(y, Rounded) else js.from_double_word(y) for y in found]

    def step(v):
        a, b, c = v
        return a * 0.5 + b * c, b - a * 0.25, c * 0.75

    def plain(x):
        v = tuple(map(number, x))
        for _ in range(3):
            v = step(v)
        products = [p * q for p, q in zip(v, v[::-1], strict=True)]
        return value((*v, *products))

    def called(x):
        v = numbers.repeated(lambda v: numbers.noinline(numbers.noinline_pairs(step))(v), 3, tuple(map(number, x)))
        return value((*v, *linear.entrywise(operator.mul, v, v[::-1])))

    for a, b in zip(jax.jit(plain)(x), jax.jit(called)(x), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(
        jax.tree.leaves(jax.jit(jax.jacrev(plain))(x[:, :2])),
        jax.tree.leaves(jax.jit(jax.jacrev(called))(x[:, :2])),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-7)


def test_masks_pass_shared_calls():
    @numbers.noinline
    def chosen(x, mask):
        return numbers.where(mask, x, -x), ~mask

    @formula
    def masked(v):
        found, mask = chosen(v[0], numbers.high(v[1]) > 0)
        return [found, mask]

    found, mask = masked("reproducible", jnp.float32([[1, 1], [2, -1]]))
    np.testing.assert_array_equal(found, [1, -2])
    np.testing.assert_array_equal(mask, [False, True])


def test_root_has_a_derivative_rounded_on_its_own():
    """1 / (2 sqrt(x)): the same bits for one number and for many, and for a cotangent that all share."""
    x = jnp.asarray(np.random.default_rng(1).uniform(0.1, 9, (100, 2)).astype(np.float32))
    f = lambda v: hypotenuse("reproducible", v)  # noqa: E731
    many = jax.jit(jax.grad(lambda x: f(x).sum()))(x)
    for i in (0, 50, 99):
        np.testing.assert_array_equal(jax.grad(f)(x[i]), many[i])


def test_known_and_data_mix():
    """A known axis with an angle that is data, and the other way round, also in a program."""
    angle, axis = jnp.linspace(0, 1, 4), np.float32([0, 0, 2])
    expected = js.Rotation.about_z(angle).entries
    from_axis_angle = jax.jit(js.Rotation.from_axis_angle)
    for call in (js.Rotation.from_axis_angle, from_axis_angle):
        np.testing.assert_allclose(call(axis, angle).entries, expected, atol=1e-7)
    found = jax.jit(lambda t: js.Rotation.from_axis_angle(axis, t).entries)(angle)
    np.testing.assert_allclose(found, expected, atol=1e-7)
    ones = np.ones((4, 3), np.float32)
    found = jax.jit(lambda v: js.Rotation.from_axis_angle(v, np.float32(0.3)).entries)(ones)
    expected = interpreted(js.Rotation.from_axis_angle)(ones, np.full(4, 0.3, np.float32)).entries
    np.testing.assert_allclose(found, expected, atol=1e-7)
    found = jax.jit(lambda x: js.Rotation.identity((4,), np.float32).to_axis_angle()[1] + x)(0.0)
    np.testing.assert_array_equal(found, np.zeros(4))
