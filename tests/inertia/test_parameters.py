"""Parametrisations against their definitions, and there and back; exp and log of numbers.

In NumPy (`interpreted`); `test_inertia.test_transformations` holds the bits of compiled programs, and
`test_exp_and_log` evaluates compiled ones.
"""

import functools
import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia.inertia import (
    ALPHA,
    FROM_MOMENTS,
    FROM_ROOT,
    LOG_CHOLESKY,
    LOG_CHOLESKY_OFF_DIAGONAL,
    ROOT_MASS,
    THERE_AND_BACK,
)
from jaxspatial.measure.error import rationals, ulp, unit_roundoff
from jaxspatial.numerics import functions
from jaxspatial.numerics.formula import formula
from tests.helpers.exact_inertia import exactly, is_positive_semidefinite, random_inertia, second_moments, steiner
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but

TYPES = list(itertools.product(["float32", "float64"], js.Precision))
USUAL = [("float32", "reproducible"), ("float64", "compensated")]
types = pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, TYPES))
dtypes = pytest.mark.parametrize("dtype", ["float32", slow("float64")])


def _allowed(precision, dtype, exact, mag, k, squared):
    u = unit_roundoff(dtype)
    if precision in ("fast", "reproducible"):
        return u * k * mag
    return (
        ulp(exact, dtype) if precision == "faithful" and not squared else u * abs(exact) + u * u * (squared or 16) * mag
    )


@types
def test_dynamic_parameters_and_pseudo_inertia(dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        M = random_inertia((20,), dtype, 1, 2.0)
        m, c, i = exactly(M)
        about, first = i + steiner(m, c), m[:, None] * c
        mag = abs(i) + abs(steiner(m, c))
        both = evaluated(precision, lambda M: [f(M, precision=precision) for f, _ in (WAYS["dynamic"], WAYS["pseudo"])])
        ten, J = (rationals(np.asarray(x)) for x in both(M))
        np.testing.assert_array_equal(ten[:, 0], m)
        assert (abs(ten[:, 1:4] - first) <= unit_roundoff(dtype) * abs(first)).all()
        assert (abs(ten[:, 4:] - about) <= _allowed(precision, dtype, about, mag, 5, 0)).all()
        sigma = np.array([second_moments(x) for x in np.asarray(M.central)]) + (m[:, None] * c)[..., None] * c[:, None]
        size = abs(i)[:, [0, 2, 5]].sum(-1)[:, None, None] + abs((m[:, None] * c)[..., None] * c[:, None])
        assert (abs(J[:, :3, :3] - sigma) <= _allowed(precision, dtype, sigma, size, 5, 0)).all()
        np.testing.assert_array_equal(J, np.swapaxes(J, -1, -2))
        np.testing.assert_array_equal(J[:, 3], ten[:, [1, 2, 3, 0]])


WAYS = {
    "dynamic": (js.SpatialInertia.to_dynamic_parameters, js.SpatialInertia.from_dynamic_parameters),
    "pseudo": (js.SpatialInertia.to_pseudo_inertia, js.SpatialInertia.from_pseudo_inertia),
    "matrix": (js.SpatialInertia.to_matrix, js.SpatialInertia.from_matrix),
}


@types
@pytest.mark.parametrize("way", WAYS)
def test_back_again(way, dtype, precision):
    """Of what was rounded on the way: with mag about the origin, in units of which central is known at all."""
    with jax.enable_x64(dtype == "float64"):
        M = random_inertia((20,), dtype, 2, 1.0)
        there, from_there = WAYS[way]
        back = evaluated(precision, lambda M: from_there(there(M), precision=precision))(M)
        m, c, i = exactly(M)
        u = unit_roundoff(dtype)
        np.testing.assert_array_equal(back.mass, M.mass)
        assert (abs(rationals(np.asarray(back.com)) - c) <= 3 * u * abs(c)).all()
        mag = (abs(i) + abs(steiner(m, c)))[:, [0, 2, 5]].sum(-1)[:, None]
        assert (abs(rationals(np.asarray(back.central)) - i) <= 12 * u * mag).all()


@types
def test_bound_of_from_dynamic_parameters(dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        ten = interpreted(js.SpatialInertia.to_dynamic_parameters)(random_inertia((20,), dtype, 3, 1.0))
        found = evaluated(precision, lambda ten: js.SpatialInertia.from_dynamic_parameters(ten, precision=precision))(
            ten
        )
        m, first, about = (rationals(np.asarray(x)) for x in (ten[:, 0], ten[:, 1:4], ten[:, 4:]))
        c = first / m[:, None]
        for x, exact, mag, k in (
            (found.com, c, abs(c), 1),
            (found.central, about - steiner(m, c), abs(about) + abs(steiner(m, c)), FROM_MOMENTS.u),
        ):
            assert (
                abs(rationals(np.asarray(x)) - exact) <= _allowed(precision, dtype, exact, mag, k, FROM_MOMENTS.u2)
            ).all()


def test_pseudo_inertia_is_the_second_moment_of_points():
    """J = sum m_i (x_i, 1) (x_i, 1)^T."""
    with jax.enable_x64(True):
        rng = np.random.default_rng(0)
        m, x = rng.random(20), rng.standard_normal((20, 3))
        points = js.SpatialInertia(m, x, np.zeros((20, 6)))
        homogeneous = np.concatenate((x, np.ones((20, 1))), 1)
        expected = (m[:, None, None] * homogeneous[:, :, None] * homogeneous[:, None]).sum(0)
        found = interpreted(lambda M: M.sum().to_pseudo_inertia())(points)
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-14)


def test_massless(x64):
    of_ten, of_pseudo = js.SpatialInertia.from_dynamic_parameters, js.SpatialInertia.from_pseudo_inertia
    ten = np.zeros(10, np.float32)
    for f, zeros in ((of_ten, ten), (of_pseudo, np.zeros((4, 4), np.float32))):
        M, is_valid = interpreted(lambda x, f=f: (f(x), f(x).is_physically_valid()))(zeros)
        assert all((x == 0).all() for x in jax.tree.leaves(M)) and is_valid
    ten[1] = 1
    assert not interpreted(lambda x: of_ten(x).is_physically_valid())(ten)
    assert np.isneginf(interpreted(js.SpatialInertia.to_log_cholesky)(js.SpatialInertia.zero(dtype=jnp.float32))[0])


# -- log-Cholesky -----------------------------------------------------------------------------------------------------


def _reference(theta):
    """J = U U^T with 60 digits."""
    alpha, d1, d2, d3, s12, s23, s13, *t = (mpmath.mpf(float(x)) for x in theta)
    e = mpmath.exp
    u = mpmath.matrix([[e(d1), s12, s13, t[0]], [0, e(d2), s23, t[1]], [0, 0, e(d3), t[2]], [0, 0, 0, 1]]) * e(alpha)
    return u * u.T


def _central(J):
    """(central six, mag) of a pseudo-inertia, in mpmath."""
    m = J[3, 3]
    s = [[J[i, j] - J[i, 3] * J[j, 3] / m for j in range(3)] for i in range(3)]
    trace = s[0][0] + s[1][1] + s[2][2]
    return [trace * (i == j) - s[i][j] for i, j in ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))], trace


@types
def test_from_log_cholesky(dtype, precision):
    with mpmath.workdps(60), jax.enable_x64(dtype == "float64"):
        theta = (np.random.default_rng(0).standard_normal((15, 10)) * ([3] * 4 + [1] * 6)).astype(dtype)
        M = evaluated(precision, functools.partial(js.SpatialInertia.from_log_cholesky, precision=precision))(theta)
        u = float(unit_roundoff(dtype))
        wide = precision in ("compensated", "faithful")
        for x, mass, central in zip(theta, np.asarray(M.mass), np.asarray(M.central), strict=True):
            J = _reference(x)
            exact, mag = _central(J)
            assert abs(mass - J[3, 3]) <= ROOT_MASS.allowed(precision, u, J[3, 3])
            for a, b in zip(central, exact, strict=True):
                once, twice = u * abs(b) + FROM_ROOT.u2 * u * u * mag, FROM_ROOT.u * u * mag
                assert abs(mpmath.mpf(float(a)) - b) <= (once if wide else twice)
        np.testing.assert_array_equal(M.com, theta[:, 7:])
        assert interpreted(js.SpatialInertia.is_physically_valid)(M).all()
        assert all(is_positive_semidefinite(second_moments(x), 8 * unit_roundoff(dtype) * rationals(x)[[0, 2, 5]].sum())
                   for x in np.asarray(M.central))  # fmt: skip


@pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL[:1], TYPES))
def test_there_and_back(dtype, precision):
    """The error near the boundary, where Sigma turns singular, is what the docstring says."""
    with jax.enable_x64(dtype == "float64"):
        M = random_inertia((200,), dtype, 4)
        flat = np.diag([1.0, 1, 2]) + np.array([1e-2, 1e-3, 1e-4])[:, None, None] * np.eye(3)
        plate = js.SpatialInertia(2.0, np.zeros(3, dtype), flat.astype(dtype))
        turned = interpreted(lambda w, M: js.Rotation.exp(w) @ M)(np.array([0.3, 0.2, 0.1], dtype), plate)
        there_and_back = evaluated(
            precision,
            lambda M: js.SpatialInertia.from_log_cholesky(M.to_log_cholesky(precision=precision), precision=precision),
        )
        for bodies in (M, turned):
            back = there_and_back(bodies)
            condition = 1 / np.asarray(interpreted(js.SpatialInertia.validity_slack)(bodies), np.float64)
            size = np.abs(np.asarray(bodies.central, np.float64)).max(-1)
            u = float(unit_roundoff(dtype))
            error = np.abs(np.asarray(back.central, np.float64) - np.asarray(bodies.central, np.float64)).max(-1) / size
            assert (error <= THERE_AND_BACK.u * u * condition).all()
            np.testing.assert_allclose(back.mass, bodies.mass, rtol=16 * u)
            np.testing.assert_array_equal(back.com, bodies.com)


@dtypes
def test_to_log_cholesky_against_60_digits(dtype):
    with mpmath.workdps(60), jax.enable_x64(dtype == "float64"):
        M = random_inertia((40,), dtype, 5)
        found = interpreted(lambda M: {p: M.to_log_cholesky(precision=p) for p in ("reproducible", "compensated")})(M)
        conditions = 1 / np.asarray(interpreted(js.SpatialInertia.validity_slack)(M), np.float64)
        u = float(unit_roundoff(dtype))
        for k, (m, c, six) in enumerate(zip(*map(np.asarray, jax.tree.leaves(M)), strict=True)):
            exact = _log_cholesky(m, six)
            scale, condition = float(np.sqrt(six[[0, 2, 5]].sum() / m)), conditions[k]
            for i, x in enumerate(exact):
                sizes = abs(x), condition + abs(x), condition * scale
                records = ALPHA, LOG_CHOLESKY, LOG_CHOLESKY_OFF_DIAGONAL
                place = 0 if i == 0 else 1 if i < 4 else 2
                bound = records[place].u * sizes[place]
                assert abs(float(found["reproducible"][k][i]) - x) <= u * bound
                assert abs(float(found["compensated"][k][i]) - x) <= u * records[place].rounded * abs(x) + u * u * bound
            np.testing.assert_array_equal(found["compensated"][k][7:], c)


def _log_cholesky(m, six):
    m, s = mpmath.mpf(float(m)), second_moments(six)
    s = mpmath.matrix([[mpmath.mpf(x.numerator) / x.denominator / m for x in row] for row in s])
    l33 = mpmath.sqrt(s[2, 2])
    s13, s23 = s[0, 2] / l33, s[1, 2] / l33
    l22 = mpmath.sqrt(s[1, 1] - s23**2)
    s12 = (s[0, 1] - s13 * s23) / l22
    l11 = mpmath.sqrt(s[0, 0] - s12**2 - s13**2)
    return [mpmath.log(m) / 2, *map(mpmath.log, (l11, l22, l33)), s12, s23, s13]


def test_where_there_is_no_log_cholesky():
    plate = js.SpatialInertia(1.0, np.zeros(3, np.float32), np.float32(np.diag([1, 1, 2])))
    impossible = js.SpatialInertia(1.0, np.zeros(3, np.float32), np.float32(np.diag([1, 1, 3])))
    of_plate, of_impossible = map(interpreted(js.SpatialInertia.to_log_cholesky), (plate, impossible))
    assert not np.isfinite(of_plate[1:4]).all() and np.isnan(of_impossible[1:4]).any()
    flat = np.float32([0, 0, 0, -np.inf, 0, 0, 0, 0, 0, 0])
    degenerate = interpreted(js.SpatialInertia.from_log_cholesky)(flat)
    np.testing.assert_array_equal(degenerate.central, np.float32([1, 0, 1, 0, 0, 2]))


def test_derivatives_there_and_back():
    """Jacobian there times Jacobian back is 1."""
    with jax.enable_x64(True):
        theta = np.random.default_rng(1).standard_normal(10) * 0.5

        def there(theta):
            return js.SpatialInertia.from_log_cholesky(theta).to_dynamic_parameters()

        def back(ten):
            return js.SpatialInertia.from_dynamic_parameters(ten).to_log_cholesky()

        ten, first = interpreted(lambda theta: (there(theta), jax.jacrev(there)(theta)))(theta)
        product = interpreted(jax.jacfwd(back))(ten) @ first
        np.testing.assert_allclose(product, np.eye(10), rtol=0, atol=1e-12)


@pytest.mark.parametrize("mode", [slow(jax.jacfwd), jax.jacrev, slow(jax.hessian)])
def test_derivatives_of_log_cholesky(mode):
    """That of J = U U^T is by hand; the second derivative too."""
    with jax.enable_x64(True):
        theta = np.random.default_rng(1).standard_normal(10) * 0.5

        def by_hand(theta):
            a, d1, d2, d3, s12, s23, s13, x, y, z = theta
            e, o = jnp.exp, jnp.zeros(())
            U = e(a) * jnp.array([[e(d1), s12, s13, x], [o, e(d2), s23, y], [o, o, e(d3), z], [o, o, o, o + 1]])
            return U @ U.T

        def pseudo(theta):
            return js.SpatialInertia.from_log_cholesky(theta).to_pseudo_inertia()

        expected = jax.jit((jax.hessian if mode is jax.hessian else jax.jacfwd)(by_hand))(theta)
        found = interpreted(mode(pseudo))(theta)
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-13 * float(abs(expected).max()))


# -- exp and log of numbers -------------------------------------------------------------------------------------------


@formula
def _exp(x):
    return tuple(map(functions.exp, x))


@formula
def _log(x):
    return tuple(map(functions.log, x))


@dtypes
@pytest.mark.parametrize("name", ["exp", "log"])
def test_exp_and_log(name, dtype):
    with mpmath.workdps(60), jax.enable_x64(dtype == "float64"):
        rng = np.random.default_rng(0)
        largest = {"float32": 87, "float64": 700}[dtype]
        if name == "exp":
            x = np.concatenate((rng.uniform(-largest, largest, 60), 10.0 ** rng.uniform(-30, 1, 40), [0.0, -1e-20]))
        else:
            x = np.concatenate(
                (np.exp(rng.uniform(-largest, largest, 60)), 1 + 10.0 ** rng.uniform(-7, -1, 40), [1.0, 0.75])
            )
        x = x[:, None].astype(dtype)
        u = float(unit_roundoff(dtype))
        exact = [getattr(mpmath, name)(mpmath.mpf(float(v))) for v in np.asarray(x)[:, 0]]
        f = {"exp": _exp, "log": _log}[name]
        for precision, bound in (("reproducible", 4), ("compensated", 1.01)):
            found = np.asarray(f(precision, x))[:, 0]
            assert all(abs(float(a) - b) <= bound * u * abs(b) for a, b in zip(found, exact, strict=True))
        pair = interpreted(lambda x: f(None, js.to_double_word(x)))(x[:40])
        for hi, lo, b in zip(np.asarray(pair.hi)[:, 0], np.asarray(pair.lo)[:, 0], exact, strict=False):
            # Where the low word is no subnormal.
            if abs(b) > float(jnp.finfo(dtype).tiny) / u**2:
                assert abs(mpmath.mpf(float(hi)) + float(lo) - b) <= 16 * u * u * abs(b)


def test_exp_and_log_at_the_edges(x64):
    x = np.float32([[0.0], [-1.0], [np.inf], [np.nan], [-np.inf], [1e30]])
    logarithms, powers = (interpreted(functools.partial(f, None))(x)[:, 0] for f in (_log, _exp))
    np.testing.assert_array_equal(logarithms[:5], np.float32([-np.inf, np.nan, np.inf, np.nan, np.nan]))
    np.testing.assert_array_equal(powers[[0, 2, 3, 4, 5]], [1, np.inf, np.nan, 0, np.inf])
