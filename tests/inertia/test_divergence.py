"""The divergence of inertias against its definition with 60 digits, its derivatives, and its edges.

In NumPy (`interpreted`); `laws.test_transformations` holds the bits of compiled programs.
"""

import functools
import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia.divergence import DIVERGENCE
from jaxspatial.measure.error import unit_roundoff
from tests.helpers.exact_inertia import random_inertia, second_moments
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but

TYPES = list(itertools.product(["float32", "float64"], js.Precision))
USUAL = [("float32", "reproducible"), ("float32", "compensated"), ("float64", "reproducible")]
types = pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, TYPES))


def _pseudo(m, c, six):
    """([[Sigma, m c], [m c^T, m]], Sigma about the centre of mass), in mpmath."""
    m, c = mpmath.mpf(float(m)), [mpmath.mpf(float(x)) for x in c]
    s = [[mpmath.mpf(x.numerator) / x.denominator for x in row] for row in second_moments(six)]
    about = [[s[i][j] + m * c[i] * c[j] for j in range(3)] + [m * c[i]] for i in range(3)]
    return mpmath.matrix([*about, [m * x for x in c] + [m]]), mpmath.matrix(s)


def _condition(s):
    return float((s[0, 0] + s[1, 1] + s[2, 2]) / min(mpmath.eigsy(s, eigvals_only=True)))


def _exactly(M, M0):
    """[(D by its definition, c + c0)] of two batches."""
    result = []
    for one, other in zip(*(zip(*map(np.asarray, jax.tree.leaves(x)), strict=True) for x in (M, M0)), strict=True):
        (P, s), (P0, s0) = _pseudo(*one), _pseudo(*other)
        Q = P * P0**-1
        D = sum(Q[i, i] for i in range(4)) - mpmath.log(mpmath.det(P) / mpmath.det(P0)) - 4
        result.append((D, _condition(s) + _condition(s0)))
    return result


def _near(M, relative, seed=9):
    """Other bodies, whose log-Cholesky parameters differ by so much."""
    theta = interpreted(js.SpatialInertia.to_log_cholesky)(M)
    moved = theta + relative * np.random.default_rng(seed).standard_normal(theta.shape)
    return interpreted(js.SpatialInertia.from_log_cholesky)(moved.astype(theta.dtype))


def _thin(M, shares):
    """Second moments Q diag(shares) Q^T in place of those of M, with random axes."""
    rng = np.random.default_rng(3)
    q = np.linalg.qr(rng.standard_normal((*M.batch_shape, 3, 3)))[0]
    s = q @ (np.asarray(shares)[..., None] * np.swapaxes(q, -1, -2))
    central = np.trace(s, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - s
    return js.SpatialInertia(M.mass, M.com, central.astype(M.dtype))


def _pairs(dtype, n=12):
    """Pairs of unlike bodies, of nearly equal ones, of small and large ones, of thin ones and their neighbours."""
    M, M0 = random_inertia((n,), dtype, 1, 1.0), random_inertia((n,), dtype, 2, 1.0)
    yield M, M0
    for relative in (1e-1, 1e-3, 1e-5):
        yield _near(M0, relative), M0
    small = js.SpatialInertia(M0.mass * M0.dtype.type(1e-4), M0.com, M0.central * M0.dtype.type(1e-7))
    yield small, M0
    yield M0, small
    thin = _thin(M0, [1.0, 0.1, 1e-3])
    yield from ((thin, M0), (M0, thin), (_near(thin, 1e-5), thin), (_thin(M, [1.0, 1e-3, 1e-3]), thin))


@types
def test_against_its_definition(dtype, precision):
    """The error is relative to the divergence, near the prior as well."""
    u = float(unit_roundoff(dtype))
    with mpmath.workdps(60), jax.enable_x64(dtype == "float64"):
        divergence = evaluated(precision, functools.partial(js.bregman_divergence, precision=precision))
        for M, M0 in _pairs(dtype):
            found = np.asarray(divergence(M, M0))
            assert found.dtype == dtype and (found >= 0).all()
            for x, (exact, condition) in zip(found, _exactly(M, M0), strict=True):
                size = condition * exact
                assert abs(mpmath.mpf(float(x)) - exact) <= DIVERGENCE.allowed(precision, u, size, exact)


def test_it_is_what_the_paper_says():
    """By matrices, of the public pseudo-inertias."""
    with jax.enable_x64(True):
        M, M0 = random_inertia((20,), "float64", 5), random_inertia((20,), "float64", 6)
        P, P0 = (np.asarray(interpreted(js.SpatialInertia.to_pseudo_inertia)(x)) for x in (M, M0))
        Q = P @ np.linalg.inv(P0)
        expected = np.trace(Q, axis1=-2, axis2=-1) - np.linalg.slogdet(Q)[1] - 4
        np.testing.assert_allclose(interpreted(js.bregman_divergence)(M, M0), expected, rtol=1e-9)


@pytest.mark.parametrize("precision", slow_but([js.Precision.REPRODUCIBLE], js.Precision))
@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_equal_ones_are_at_0_exactly(dtype, precision):
    """With their first derivatives."""
    with jax.enable_x64(dtype == "float64"):
        for M in (random_inertia((50,), dtype, 7, 2.0), _thin(random_inertia((50,), dtype, 8), [1.0, 1e-2, 1e-3])):
            divergence = functools.partial(js.bregman_divergence, precision=precision)
            both = jax.value_and_grad(lambda *x, f=divergence: f(*x).sum(), (0, 1))
            value, slopes = evaluated(precision, both)(M, M)
            assert value == 0 and all((x == 0).all() for x in jax.tree.leaves(slopes))


def test_point_and_axes_and_units_do_not_matter():
    with jax.enable_x64(True):
        M, M0 = random_inertia((20,), "float64", 5), random_inertia((20,), "float64", 6)
        rng = np.random.default_rng(0)
        X = interpreted(js.RigidTransform.exp)(js.SpatialVelocity(*rng.standard_normal((2, 20, 3))))
        expected = interpreted(js.bregman_divergence)(M, M0)
        moved = interpreted(lambda X, M, M0: js.bregman_divergence(js.act(X, M), js.act(X, M0)))(X, M, M0)
        np.testing.assert_allclose(moved, expected, rtol=1e-10)
        grams = [js.SpatialInertia(1e3 * x.mass, 1e2 * x.com, 1e7 * x.central) for x in (M, M0)]
        np.testing.assert_allclose(interpreted(js.bregman_divergence)(*grams), expected, rtol=1e-11)


@pytest.mark.parametrize("relative", [0.0, slow(1e-6), slow(0.3)])
def test_gradient_and_hessian(relative):
    """By hand: P0^-1 - P^-1, and dP -> P^-1 dP P^-1, along the ten log-Cholesky parameters; at the prior as well."""
    with jax.enable_x64(True):
        theta0 = 0.5 * np.random.default_rng(1).standard_normal(10)
        theta = theta0 + relative * np.random.default_rng(2).standard_normal(10)
        at = js.SpatialInertia.from_log_cholesky

        def pseudo(theta):
            return at(theta).to_pseudo_inertia()

        def found(theta, theta0):
            return js.bregman_divergence(at(theta), at(theta0))

        P, P0 = (np.asarray(interpreted(pseudo)(x)) for x in (theta, theta0))
        first = np.asarray(interpreted(jax.jacfwd(pseudo))(theta))
        second = np.asarray(interpreted(jax.jacfwd(jax.jacfwd(pseudo)))(theta))
        inverse, slope = np.linalg.inv(P), np.linalg.inv(P0) - np.linalg.inv(P)
        gradient = np.einsum("ij,ijk->k", slope, first)
        hessian = np.einsum("ij,ijkl->kl", slope, second)
        hessian += np.einsum("ab,bck,cd,dal->kl", inverse, first, inverse, first)
        size = abs(np.einsum("ij,ijk->k", abs(inverse), abs(first))).max()
        np.testing.assert_allclose(interpreted(jax.grad(found))(theta, theta0), gradient, rtol=0, atol=1e-14 * size**2)
        slopes = interpreted(jax.hessian(found))(theta, theta0)
        np.testing.assert_allclose(slopes, hessian, rtol=0, atol=1e-12 * abs(hessian).max())


def test_edges(x64):
    """Infinite on the edge of what bodies can have, NaN beyond, and where the prior is one of these."""

    def body(moments, mass=1.0):
        return js.SpatialInertia(np.float32(mass), np.zeros(3, np.float32), np.diag(moments).astype(np.float32))

    ball = body([2, 2, 2])
    edge = [body([1, 1, 2]), body([2, 1, 1]), body([1, 2, 1]), body([1, 1, 0]), body([0, 0, 0]), body([2, 2, 2], 0)]
    beyond = [body([1, 1, 3]), body([3, 1, 1]), body([2, 2, 2], -1), body([2, 2, np.nan]), body([-1, -1, -1])]
    divergence = interpreted(js.bregman_divergence)
    assert divergence(ball, ball) == 0
    for M in edge:
        assert np.isposinf(divergence(M, ball)) and np.isnan(divergence(ball, M))
    for M in beyond:
        assert np.isnan(divergence(M, ball)) and np.isnan(divergence(ball, M))


def test_batches_and_dtypes(x64):
    M, M0 = random_inertia((4, 1), "float32", 1), random_inertia((3,), "float32", 2)
    divergence = interpreted(js.bregman_divergence)
    found = divergence(M, M0)
    assert found.shape == (4, 3) and found.dtype == jnp.float32
    np.testing.assert_array_equal(found[2, 1], divergence(M.at_batch((2, 0)), M0.at_batch(1)))
    with pytest.raises(TypeError, match="dtype"):
        js.bregman_divergence(M, random_inertia((3,), "float16", 2))
    with pytest.raises(TypeError, match="bregman_divergence: expected a SpatialInertia, got ndarray"):
        js.bregman_divergence(M, np.eye(4, dtype=np.float32))
    with pytest.raises(ValueError, match="batch"):
        js.bregman_divergence(M, random_inertia((2, 3), "float32", 2))
