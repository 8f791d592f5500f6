"""Bodies put together: against sums of fractions, at every scale, and never indefinite.

In NumPy (`interpreted`); `test_a_thousand_bodies` and `test_axis` are about compiled programs.
"""

import functools
import itertools
from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia.inertia import COMBINED, COMBINED_COM, SUM_CENTRAL, SUM_COM, SUM_MASS
from jaxspatial.measure.error import rationals, unit_roundoff
from tests.helpers.exact_inertia import exactly, is_positive_semidefinite, random_inertia, second_moments, steiner
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.soon import compiled_as_for_users

dtypes = pytest.mark.parametrize("dtype", ["float32", "float64"])
TYPES = list(itertools.product(["float32", "float64"], ["fast", "reproducible", "compensated", "faithful"]))
USUAL = [("float32", "reproducible"), ("float32", "compensated")]
types = pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, TYPES))


def exact_sum(m, c, i):
    """(mass, com, central, mag of com, mag of central) of bodies (..., n), as fractions: about the origin, back
    again."""
    mass = np.asarray(m.sum(-1), dtype=object)
    com = (m[..., None] * c).sum(-2) / mass[..., None]
    central = (i + steiner(m, c)).sum(-2) - steiner(mass, com)
    m_, c_, i_ = (np.abs(x.astype(float)) for x in (m, c, i))
    com_mag = (m_[..., None] * c_).sum(-2) / m_.sum(-1)[..., None]
    arm = m_ * ((c_ + np.abs(com.astype(float))[..., None, :]) ** 2).sum(-1)
    return mass, com, central, rationals(com_mag), rationals((i_ + arm[..., None]).sum(-2))


def _require(found, exact, mag, u, k, squared, precision):
    allowed = u * k * mag if precision in ("fast", "reproducible") else u * abs(exact) + u * u * squared * mag
    assert np.all(abs(rationals(np.asarray(found)) - exact) <= allowed)


@types
def test_two(dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        M, N = random_inertia((40,), dtype, 1, 2.0), random_inertia((40,), dtype, 2, 2.0)
        found = evaluated(precision, lambda M, N: M.combine(N, precision=precision))(M, N)
        both = [np.stack(x, 1) for x in zip(exactly(M), exactly(N), strict=True)]
        mass, com, central, com_mag, _ = exact_sum(*both)
        u = unit_roundoff(dtype)
        _require(found.mass, mass, mass, u, 1, 4, precision)
        of_com = abs(rationals(np.asarray(found.com)) - com)
        assert (of_com <= COMBINED_COM.allowed(precision, u, com_mag, abs(com))).all()
        m1, m2, d = both[0][:, 0], both[0][:, 1], both[1][:, 1] - both[1][:, 0]
        size = (m1 * m2 / (m1 + m2) * (d * d).sum(-1))[:, None]
        _require(found.central, central, abs(both[2]).sum(1) + size, u, COMBINED.u, COMBINED.u2, precision)


@dtypes
def test_two_commute_where_neither_is_as_heavy(dtype):
    with jax.enable_x64(dtype == "float64"):
        M, N = random_inertia((40,), dtype, 1), random_inertia((40,), dtype, 2)
        chex.assert_trees_all_equal(*interpreted(lambda M, N: (M + N, N + M))(M, N))


def _mixed(dtype, n=1000, seed=3):
    """Masses over 40 orders, and as many bodies of about the same mass as there are of all others."""
    M = random_inertia((n,), "float64", seed, 2.0)
    rng = np.random.default_rng(seed)
    scale = np.where(np.arange(n) % 2, 10.0 ** rng.uniform(-20, 20, n), 10.0 ** rng.uniform(-1, 1, n))
    scaled = np.asarray(M.mass) * scale, np.asarray(M.com), np.asarray(M.central) * scale[:, None]
    return js.SpatialInertia(*(x.astype(dtype) for x in scaled))


@functools.cache
def _exact_thousand(even, dtype):
    with jax.enable_x64(True):
        return exact_sum(*exactly(jax.tree.map(lambda x: x[:: 1 + even], _mixed(dtype))))


@types
@pytest.mark.parametrize("even", [slow(True), False], ids=["even masses", "masses 1e-20 to 1e20"])
def test_a_thousand_bodies(even, dtype, precision):
    with jax.enable_x64(True):
        M = jax.tree.map(lambda x: x[:: 1 + even], _mixed(dtype))
    with jax.enable_x64(dtype == "float64"):
        found, n = jax.jit(lambda M: M.sum(precision=precision))(M), M.batch_shape[0]
        squared, of_central = (x.u2 * x.factor(n) for x in (SUM_COM, SUM_CENTRAL))
        mass, com, central, com_mag, central_mag = _exact_thousand(even, dtype)
        u = unit_roundoff(dtype)
        _require(found.mass, mass, mass, u, SUM_MASS.factor(n), squared, precision)
        _require(found.com, com, com_mag, u, SUM_COM.factor(n), squared, precision)
        _require(found.central, central, central_mag, u, SUM_CENTRAL.factor(n), of_central, precision)
        if precision in ("compensated", "faithful"):
            for x, exact in zip(jax.tree.leaves(found), (mass, com, central), strict=True):
                assert np.all(abs(rationals(np.asarray(x)) - exact) <= 4 * u * abs(exact))


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_masses_that_are_lost_one_after_another(precision):
    """In each of L = 10 rounds the mass is rounded down by nearly u, which makes com larger, and the sum of shares of
    com up by as much: com is off by nearly 2 L u."""
    n, u = 1024, unit_roundoff("float32")
    mass, com = np.ones(n, "float32"), np.zeros((n, 3), "float32")
    for k in range(10):  # What is added to the first in round k: so many bodies, of 0.99 u together.
        mass[n >> k + 1 :: n >> k] = 0.99 * float(u) / (1 << k)
    com[:, 0] = np.where(mass < 1, 1.03, 1)
    # Of central, too, next to which masses are small.
    M = js.SpatialInertia(mass, com, np.float32([1024, 0, 1024, 0, 0, 1024]) * mass[:, None])
    found = interpreted(lambda M: M.sum(precision=precision))(M)
    exact_mass, exact_com, central, com_mag, central_mag = exact_sum(*exactly(M))
    _require(found.mass, exact_mass, exact_mass, u, SUM_MASS.factor(n), 0, precision)
    squared, of_central = (x.u2 * x.factor(n) for x in (SUM_COM, SUM_CENTRAL))
    _require(found.com, exact_com, com_mag, u, SUM_COM.factor(n), squared, precision)
    _require(found.central, central, central_mag, u, SUM_CENTRAL.factor(n), of_central, precision)


def test_the_sum_of_two():
    """Two whose com takes 3.3 of the 4 u, found among millions; and pairs about a common com that is 0, of which
    central takes what a body does."""
    u, few = unit_roundoff("float32"), np.zeros((1, 2, 6), "float32")
    com = np.float32([[[0.5078696, 0, 0], [0.5779062, 0, 0]]])
    hostile = js.SpatialInertia(np.float32([[1.2809731, 1.2591081]]), com, few)
    one = random_inertia((1000,), "float32", 5)
    pairs = js.SpatialInertia(
        np.stack([one.mass] * 2, 1), np.stack([one.com, -one.com], 1), np.float32(1e-3) * np.stack([one.central] * 2, 1)
    )
    for M in (hostile, pairs):
        found = interpreted(lambda M: M.sum(axis=1))(M)
        _, com, central, com_mag, central_mag = exact_sum(*exactly(M))
        _require(found.com, com, com_mag, u, SUM_COM.factor(2), 0, "reproducible")
        _require(found.central, central, central_mag, u, SUM_CENTRAL.factor(2), 0, "reproducible")


def test_one_by_one_is_nearly_as_good():
    with jax.enable_x64(True):
        M = _mixed("float64", 200)
        zero = js.SpatialInertia.zero(dtype=jnp.float64)
        one_by_one, whole = interpreted(lambda M: (jax.lax.scan(lambda N, M: (N + M, None), zero, M)[0], M.sum()))(M)
        for x, y in zip(jax.tree.leaves(one_by_one), jax.tree.leaves(whole), strict=True):
            np.testing.assert_allclose(x, y, rtol=0, atol=200 * 2.2e-16 * float(np.abs(y).max()))


def test_double_words_keep_twice_the_digits():
    M = random_inertia((37,), "float32", 4, 1.0)
    mass, com, central, com_mag, central_mag = exact_sum(*exactly(M))
    found = interpreted(lambda M: js.to_double_word(M).sum())(M)
    parts = found.mass, found.com, found.central
    for x, exact, mag in zip(parts, (mass, com, central), (mass, com_mag, central_mag), strict=True):
        pair = rationals(np.asarray(x.hi)) + rationals(np.asarray(x.lo))
        assert np.all(abs(pair - exact) <= unit_roundoff("float32") ** 2 * SUM_COM.u2 * SUM_COM.factor(37) * mag)


@pytest.mark.parametrize("axis", [0, *map(slow, (1, -1, -3))])
@compiled_as_for_users()
def test_axis(axis):
    """One program for a batch has the bits of NumPy, over the axis moved to the front, and one item after another."""
    M = random_inertia((4, 3, 5), "float32")
    found = jax.jit(lambda M: M.sum(axis))(M)
    moved = jax.tree.map(lambda x: np.moveaxis(x, axis % 3, 0), M)
    total = interpreted(js.SpatialInertia.sum)
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(total(moved)), strict=True):
        np.testing.assert_array_equal(x, y)
    one = total(jax.tree.map(lambda x: x[:, 1, 2], moved))
    for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(one), strict=True):
        np.testing.assert_array_equal(x[1, 2], y)
    with pytest.raises(ValueError, match=r"axis: expected one of a batch of shape \(4, 3, 5\), got 3"):
        M.sum(3)


def test_nothing_and_one():
    empty = interpreted(js.SpatialInertia.sum)(random_inertia((0, 2), "float32"))
    assert empty.batch_shape == (2,) and not any(np.any(x) for x in jax.tree.leaves(empty))
    M = random_inertia((1,), "float32")
    for x, y in zip(jax.tree.leaves(interpreted(js.SpatialInertia.sum)(M)), jax.tree.leaves(M), strict=True):
        np.testing.assert_array_equal(x, y[0])


def test_without_mass_com_is_the_mean(x64):
    M = js.SpatialInertia(np.float32(0), np.float32([1, 2, 3]), np.float32(np.eye(3)))
    N = js.SpatialInertia(np.float32(0), np.float32([3, 2, 0]), np.float32(np.eye(3)))
    heavy = js.SpatialInertia(np.float32(2), np.float32([0.1, 0.2, 0.3]), np.float32(np.eye(3)))

    @interpreted
    def found(M, N, heavy):
        massless = M + N, jax.tree.map(lambda *x: jnp.stack(x), M, N).sum()
        return massless, (heavy + M, M + heavy), M - N

    massless, with_one, difference = found(M, N, heavy)
    for both in massless:
        np.testing.assert_array_equal(both.com, [2, 2, 1.5])
        np.testing.assert_array_equal(both.mass, 0)
        np.testing.assert_array_equal(both.central, [2, 0, 2, 0, 0, 2])
    for both in with_one:
        np.testing.assert_array_equal(both.com, heavy.com)
    np.testing.assert_array_equal(difference.com, M.com)


def test_same_centre_of_mass_stays_exactly():
    M = random_inertia((20,), "float32")
    N = js.SpatialInertia(M.mass * np.float32(0.37), M.com, M.central)
    np.testing.assert_array_equal(interpreted(lambda M, N: M + N)(M, N).com, M.com)


def test_removing_undoes_adding():
    with jax.enable_x64(True):
        M, N = random_inertia((30,), seed=1), random_inertia((30,), seed=2)
        back, gone, is_valid = interpreted(lambda M, N: ((M + N) - N, M - M, (M - M).is_physically_valid()))(M, N)
        for x, y in zip(jax.tree.leaves(back), jax.tree.leaves(M), strict=True):
            np.testing.assert_allclose(x, y, rtol=0, atol=5e-14)
        assert not np.isfinite(gone.com).any() and not is_valid.any()


def test_python_sums_bodies_and_others_are_refused():
    M = random_inertia((), "float32")
    np.testing.assert_array_equal(interpreted(lambda M: sum([M, M, M]))(M).mass, 3 * M.mass)
    for call in (lambda: M + 1.0, lambda: 1.0 + M, lambda: M - np.float32(1), lambda: M.combine(2.0)):
        with pytest.raises(TypeError, match="SpatialInertia"):
            call()


def test_two_cubes_are_a_box():
    def cube(m, x):
        return js.SpatialInertia(m, np.array([x, 0.0, 0.0]), m * 8 / 12 * np.eye(3))

    with jax.enable_x64(True):
        both, matrix = interpreted(lambda M, N: (M + N, (M + N).central_matrix()))(cube(1.0, 1.0), cube(1.0, -1.0))
        box = 2 / 12 * np.diag([4 + 4, 16 + 4, 16 + 4])
        np.testing.assert_allclose(matrix, box, rtol=4e-16)
        np.testing.assert_array_equal(both.com, [0, 0, 0])


@types
def test_nothing_turns_indefinite(dtype, precision):
    """Pairs, and crowds, of points on a line, in a plane and in space, far apart and of masses far apart."""
    with jax.enable_x64(True):
        rng = np.random.default_rng(8)
        directions = rng.standard_normal((12, 1, 3))
        along = directions * rng.standard_normal((12, 6, 1)) * 10.0 ** rng.uniform(-8, 8, (12, 1, 1))
        points = np.concatenate((along, along * np.array([1, 1, 0.0]) + 1.0, along + rng.standard_normal((12, 6, 3))))
        mass = 10.0 ** rng.uniform(-12, 12, (36, 6))
        M = js.SpatialInertia(*(x.astype(dtype) for x in (mass, points, np.zeros((36, 6, 6)))))
    with jax.enable_x64(dtype == "float64"):
        first, second = (jax.tree.map(lambda x, k=k: x[:, k], M) for k in (0, 1))
        pair = evaluated(precision, lambda M, N: M.combine(N, precision=precision))(first, second)
        crowd = evaluated(precision, lambda M: M.sum(axis=1, precision=precision))(M)
        k = 16 if precision in ("fast", "reproducible") else 2
        for found in (pair, crowd):
            assert interpreted(js.SpatialInertia.is_physically_valid)(found).all()
            for six in np.asarray(found.central):
                seconds = second_moments(six)
                trace = sum(seconds[i][i] for i in range(3))
                assert trace >= 0 and is_positive_semidefinite(seconds, k * unit_roundoff(dtype) * trace)
        bodies, slack = interpreted(lambda M, N: (M + N, (M + N).validity_slack()))(
            random_inertia((50,), dtype, 5), random_inertia((50,), dtype, 6)
        )
        assert (slack > 0).all()
        assert all(is_positive_semidefinite(second_moments(six)) for six in np.asarray(bodies.central))


def test_derivatives():
    """Of the sum of two against those of mass, first moment and inertia about the origin, which just add."""
    with jax.enable_x64(True):
        M, N = random_inertia((), seed=1), random_inertia((), seed=2)

        def combined(M, N):
            return (M + N).to_dynamic_parameters()

        def added(M, N):
            return M.to_dynamic_parameters() + N.to_dynamic_parameters()

        both = (interpreted(jax.jacrev(f, (0, 1)))(M, N) for f in (combined, added))
        chex.assert_trees_all_close(*both, rtol=0, atol=1e-13)
        stacked = jax.tree.map(lambda *x: np.stack(x), M, N)
        jacobian = interpreted(jax.jacfwd(lambda M: M.sum().to_dynamic_parameters()))(stacked)
        expected = interpreted(jax.jacfwd(lambda M: sum(M.to_dynamic_parameters())))(stacked)
        chex.assert_trees_all_close(jacobian, expected, rtol=0, atol=1e-13)


def test_far_away_and_back():
    """A metre of distance, a million kilometres from the origin."""
    with jax.enable_x64(True):
        far = np.array([1e9, -1e9, 1e9])
        M, N = random_inertia((), seed=1), random_inertia((), seed=2)
        moved, *there = interpreted(
            lambda M, N, far: ((M.shift(-far) + N.shift(-far)).shift(far), M.shift(-far), N.shift(-far))
        )(M, N, far)
        c1, c2 = (rationals(x.com) for x in there)
        m1, m2 = (Fraction(float(x.mass)) for x in (M, N))
        *_, i1 = exactly(M)
        *_, i2 = exactly(N)
        exact = i1 + i2 + steiner(m1 * m2 / (m1 + m2), c2 - c1)
        assert (
            np.abs(np.asarray(moved.central) - exact.astype(float)).max() <= 8e-16 * np.abs(exact.astype(float)).max()
        )


def test_gradient_of_a_sum_in_float64_without_64_bit_types():
    """In a program that knows no float64 outside of the formula."""
    with jax.enable_x64(False):
        M = js.SpatialInertia.solid_box(jnp.ones((5, 3), jnp.float32), mass=jnp.ones(5, jnp.float32))

        def mass(m):
            return js.SpatialInertia(m, M.com, M.central).sum(precision="compensated").mass

        np.testing.assert_array_equal(jax.grad(mass)(M.mass), np.ones(5))
