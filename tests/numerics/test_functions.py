"""Series, sines, angles and norms of numbers, against mpmath, over the whole range."""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

from jaxspatial.numerics import functions, linear
from jaxspatial.numerics.formula import formula
from jaxspatial.numerics.numbers.double_word import to_double_word
from jaxspatial.rotation import quaternion
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

wide_dtypes = pytest.mark.parametrize("dtype", ["float32", slow("float64")])


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def u(dtype):
    return float(jnp.finfo(dtype).eps) / 2


@formula
def cosine_sine(angle):
    return functions.cosine_sine(*angle)


@formula
def angle_ratio(x):
    return (functions.angle_ratio(*x),)


@formula
def angle_of(x):
    return (quaternion.angle_of(*x),)


@formula
def turns(angle, parts):
    return functions.turns(*angle, parts)


@formula
def unit(v):
    return linear.unit(v)


@formula
def norm(v):
    return (linear.norm(v),)


@formula
def square(v):
    return linear.square(v)


def column(x, dtype):
    return jnp.asarray(np.asarray(x, float).astype(dtype)[:, None])


def exactly(x):
    return [mp.mpf(float(c)) for c in np.asarray(x).ravel()]


def errors(found, exact):
    return np.array([float(mp.mpf(float(a)) - b) for a, b in zip(np.asarray(found), exact, strict=True)])


def near_quarter_turns(dtype, count):
    """The angles nearest to multiples of pi / 2, where sine or cosine lose the most digits, and their neighbours."""
    k = np.unique(np.concatenate((np.arange(1, 40), np.geomspace(40, count, 150).astype(int))))
    nearest = np.array([float(mp.pi * int(n) / 2) for n in k]).astype(dtype)
    return np.concatenate((nearest, np.nextafter(nearest, np.inf, dtype=dtype), -nearest)).astype(dtype)


@pytest.mark.parametrize("precision", ["reproducible", "fast", "compensated"])
@wide_dtypes
def test_cosine_and_sine(dtype, precision):
    rng = np.random.default_rng(0)
    x = np.concatenate((
        [0, 1e-30, 1e-10, 1e-4, 0.1], rng.uniform(-10, 10, 200), rng.uniform(-1e3, 1e3, 50),
        near_quarter_turns(dtype, 2**13 // 4 if dtype == "float32" else 2**27),
    )).astype(dtype)  # fmt: skip
    found = np.asarray(cosine_sine(precision, column(x, dtype)))
    cosines, sines = ([f(t) for t in exactly(x)] for f in (mp.cos, mp.sin))
    bound = 1.01 if precision == "compensated" else 1.6
    for computed, exact in ((found[:, 0], cosines), (found[:, 1], sines)):
        wrong = np.abs(errors(computed, exact))
        assert wrong.max() <= bound * u(dtype)
        # Relative to itself too, however near to 0.
        assert (wrong <= 3 * u(dtype) * np.abs(np.array(exact, float)) + 1e-300).all()


@wide_dtypes
def test_huge_angles(dtype):
    """2 u of the angle more, as if it had been rounded, up to where not even the turn is known: NaN."""
    largest = 2.0 ** (jnp.finfo(dtype).nmant - 3)
    x = np.geomspace(2.0**13, largest, 50).astype(dtype)
    found = np.asarray(cosine_sine("reproducible", column(x, dtype)))
    wrong = np.abs(errors(found[:, 1], [mp.sin(t) for t in exactly(x)]))
    assert (wrong <= 2 * u(dtype) + 2 * u(dtype) * x).all()
    beyond = [2.0 ** (jnp.finfo(dtype).nmant + k) for k in (1, 2, 3, 7, 20, 60)] + [np.inf, -np.inf, np.nan]
    for precision in ("reproducible", "fast"):
        assert np.isnan(np.asarray(cosine_sine(precision, column(beyond, dtype)))).all()


@wide_dtypes
def test_rest_of_whole_turns(dtype):
    """Relative to itself, for every angle next to a whole turn."""
    x = near_quarter_turns(dtype, 2**13 if dtype == "float32" else 2**28)[:180]
    k, rest = np.asarray(turns("reproducible", column(x, dtype), parts=4)).T
    exact = [t - int(n) * mp.pi / 2 for t, n in zip(exactly(x), k, strict=True)]
    assert (np.abs(errors(rest, exact)) <= 3 * u(dtype) * np.abs(np.array(exact, float))).all()


@wide_dtypes
def test_angle_ratio(dtype):
    """t / sin(t), up to t = pi / 2; smooth at 0."""
    t = np.concatenate(([0, 1e-30, 1e-10, 1e-3], np.linspace(0.01, np.pi / 2, 200)))
    s, c = np.sin(t).astype(dtype), np.abs(np.cos(t)).astype(dtype)
    given = jnp.asarray(np.stack((s.astype(float) ** 2, c), 1).astype(dtype))
    exact = [a / mp.sin(a) if a else mp.mpf(1) for a in exactly(t)]
    assert np.abs(errors(angle_ratio("reproducible", given)[:, 0], exact)).max() <= 6 * u(dtype)
    # As a function of the squared sine, beside its own cosine: 1 + x / 6 + 3 x^2 / 40 + ...
    f = functools.partial(angle_ratio, "reproducible")
    with_cosine = lambda x: f(jnp.stack((x, jnp.sqrt(1 - x))))[0]  # noqa: E731
    zero = np.zeros((), dtype)
    np.testing.assert_allclose(interpreted(jax.grad(with_cosine))(zero), 1 / 6, rtol=8 * u(dtype))
    np.testing.assert_allclose(interpreted(jax.grad(jax.grad(with_cosine)))(zero), 3 / 20, rtol=64 * u(dtype))


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
@wide_dtypes
def test_angle_of_a_vector(dtype, precision):
    rng = np.random.default_rng(1)
    sc = rng.standard_normal((200, 2)) * 10.0 ** rng.uniform(-15, 15, (200, 1))
    sc[:60] = np.array(
        [
            [s, c]
            for s in (0.0, 1.0, -1.0, 1e-20, -1e-8, 3e30)
            for c in (0.0, 1.0, -1.0, 1e-20, -1e-8, -3e30, 1e-3, -5.0, 2.0, 1e9)
        ]
    )
    sc = sc.astype(dtype)
    found = np.asarray(angle_of(precision, jnp.asarray(sc)))[:, 0]
    exact = [mp.atan2(*exactly(x)) if x.any() else mp.mpf(0) for x in sc]
    bound = 1.01 if precision == "compensated" else 5
    sizes = np.abs(np.array(exact, float))
    assert (np.abs(errors(found, exact)) <= bound * u(dtype) * sizes + float(jnp.finfo(dtype).tiny)).all()
    assert np.isnan(np.asarray(angle_of(precision, jnp.asarray([[np.nan, 1], [1, np.nan], [np.inf, 1]], dtype)))).all()


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
@wide_dtypes
def test_units_and_norms(dtype, precision):
    """Of any length, without over- or underflow on the way."""
    info = jnp.finfo(dtype)
    rng = np.random.default_rng(2)
    v = rng.standard_normal((40, 3)) / 4
    v = v * 2.0 ** np.linspace(info.minexp + info.nmant + 8, info.maxexp - 2, 40)[:, None]
    v[:3] = np.eye(3)
    v[3] = [1e-30, 1, 1e30]
    v = v.astype(dtype)
    lengths = [mp.sqrt(sum(c * c for c in exactly(x))) for x in v]
    found = np.asarray(norm(precision, jnp.asarray(v)))[:, 0]
    bound = 1.01 if precision == "compensated" else 3
    assert (np.abs(errors(found, lengths)) <= bound * u(dtype) * np.array(lengths, float)).all()
    directions = np.asarray(unit(precision, jnp.asarray(v)))
    for k in range(3):
        exact = [exactly(x)[k] / n for x, n in zip(v, lengths, strict=True)]
        assert np.abs(errors(directions[:, k], exact)).max() <= bound * u(dtype)
    for bad in ([0, 0, 0], [np.inf, 0, 1], [1, np.nan, 0], [-np.inf, np.inf, 0]):
        assert np.isnan(np.asarray(unit(precision, jnp.asarray([bad], dtype)))).all()
    np.testing.assert_array_equal(norm(precision, jnp.asarray([[0, 0, 0], [np.inf, 1, 2]], dtype))[:, 0], [0, np.inf])


def test_derivatives_of_the_norm():
    """0 at 0, the direction elsewhere, however long."""
    f = lambda v: norm("reproducible", v)[0]  # noqa: E731
    for mode in (jax.jacfwd, jax.jacrev):
        slope = interpreted(mode(f))
        np.testing.assert_array_equal(slope(np.zeros(3)), np.zeros(3))
        for size in (1e-200, 1.0, 1e200):
            np.testing.assert_allclose(slope(size * np.array([3.0, 0, 4.0])), [0.6, 0, 0.8], rtol=1e-15)


@wide_dtypes
def test_squares_keep_what_rounding_took(dtype):
    rng = np.random.default_rng(3)
    v = rng.standard_normal((200, 3)) * 10.0 ** rng.uniform(-6, 1, (200, 1))
    v = v.astype(dtype)
    rounded, missing = np.asarray(square("reproducible", jnp.asarray(v))).T
    exact = [sum(c * c for c in exactly(x)) for x in v]
    wrong = np.array(
        [float(mp.mpf(float(a)) + mp.mpf(float(b)) - e) for a, b, e in zip(rounded, missing, exact, strict=True)]
    )
    sizes = np.array(exact, float)
    assert (np.abs(wrong) <= u(dtype) * np.maximum(0.1 * sizes, 0.01)).all()
    assert (np.abs(rounded - sizes.astype(dtype)) <= 3 * u(dtype) * sizes).all()
    jacobian = interpreted(jax.vmap(jax.jacrev(lambda v: square("reproducible", v)[0])))(v)
    np.testing.assert_allclose(jacobian, 2 * v, rtol=4 * u(dtype))


def test_double_words_have_twice_the_digits():
    """Functions of double words: 1e-30 and not 1e-16."""
    seventh = interpreted(lambda x: to_double_word(x) / 7.0)
    x = seventh(np.array([[0.3], [2.0], [-40.0], [1e5]]))
    found = interpreted(functools.partial(cosine_sine, "reproducible"))(x)
    exact_x = [mp.mpf(float(h)) + mp.mpf(float(lo)) for h, lo in zip(x.hi[:, 0], x.lo[:, 0], strict=True)]
    for k, f in enumerate((mp.cos, mp.sin)):
        for i, t in enumerate(exact_x):
            value = mp.mpf(float(found.hi[i, k])) + mp.mpf(float(found.lo[i, k]))
            assert abs(value - f(t)) <= 1e-30
