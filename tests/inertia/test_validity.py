"""Principal moments and axes, validity and its slack, the nearest valid inertia and equivalent shapes.

In NumPy (`interpreted`); `test_inertia.test_transformations` and `test_masks_work_everywhere` hold compiled programs.
"""

import functools

import chex
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia.inertia import AXES, ELLIPSOID, LENGTH, MOMENTS, NEAREST_VALID, ORTHONORMAL, SLACK
from jaxspatial.measure.error import unit_roundoff
from tests.helpers.exact_inertia import exactly, matrix, random_inertia, six_of
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow

EPS = 2.0**-52
dtypes = pytest.mark.parametrize("dtype", ["float32", slow("float64")])
precisions = pytest.mark.parametrize("precision", ["reproducible", "compensated"])


def body(central, mass=1.0, com=(0.0, 0.0, 0.0), dtype="float64"):
    return js.SpatialInertia(*(np.asarray(x, dtype) for x in (mass, com, central)))


# What bodies are asked, evaluated in NumPy.
of_principal = interpreted(js.SpatialInertia.principal_moments_and_axes)
validity_slack = interpreted(js.SpatialInertia.validity_slack)
is_physically_valid = interpreted(js.SpatialInertia.is_physically_valid)
nearest_valid = interpreted(js.SpatialInertia.nearest_valid)
equivalent_box = interpreted(js.SpatialInertia.equivalent_box)
equivalent_ellipsoid = interpreted(js.SpatialInertia.equivalent_ellipsoid)


@pytest.fixture(autouse=True)
def doubles():
    with jax.enable_x64(True):
        yield


def _symmetric(n, seed=0):
    """Random, graded, clustered and indefinite matrices of all sizes."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    d = 10.0 ** rng.uniform(-12, 0, (n, 3))
    d[::4] = 1 + 10.0 ** rng.uniform(-16, -1, (len(d[::4]), 1)) * rng.standard_normal((len(d[::4]), 3))
    d[1::4] = rng.standard_normal((len(d[1::4]), 3))
    m = q @ (d[..., None] * np.swapaxes(q, -1, -2)) * 10.0 ** rng.uniform(-10, 10, (n, 1, 1))
    return six_of((m + np.swapaxes(m, -1, -2)) / 2)


# -- principal moments and axes ---------------------------------------------------------------------------------------


def _nearly_diagonal(n, dtype):
    """Off the axes by a few eps of the trace, half of them nearly round: where axes are chosen, not computed."""
    rng, eps = np.random.default_rng(1), float(jnp.finfo(dtype).eps)
    d = np.where(np.arange(n)[:, None] % 2, 1 + 40 * eps * rng.random((n, 3)), rng.uniform(0.5, 3, (n, 3)))
    x, y, z = (rng.uniform(-1, 1, (3, n)) * rng.choice([1, 2, 8], n)) * eps * d.sum(-1)
    return np.stack([d[:, 0], x, d[:, 1], y, z, d[:, 2]], -1)


@dtypes
@precisions
def test_moments_and_axes(precision, dtype):
    six = np.concatenate([_symmetric(60), _nearly_diagonal(20, dtype)]).astype(dtype)
    M = js.SpatialInertia(np.ones(80, dtype), np.zeros((80, 3), dtype), six)
    moments, R = evaluated(precision, lambda M: M.principal_moments_and_axes(precision=precision))(M)
    u = float(unit_roundoff(dtype))
    with mpmath.workdps(50):
        for six, found, q in zip(np.asarray(M.central), np.asarray(moments), np.asarray(R.to_matrix()), strict=True):
            A = mpmath.matrix(matrix(six).astype(float).tolist())
            (exact, V), Q = _eigen(A), mpmath.matrix(q.astype(float).tolist())
            size = max(map(abs, exact))
            for k in range(3):
                gap = min(abs(exact[k] - other) for i, other in enumerate(exact) if i != k)
                assert _off(Q[:, k], V[k]) * gap <= AXES.allowed(precision, u, size)
            worst = max(abs(mpmath.mpf(float(a)) - b) for a, b in zip(found, exact, strict=True))
            assert worst <= MOMENTS.allowed(precision, u, size)
            assert max(map(abs, Q.T * Q - mpmath.eye(3))) <= ORTHONORMAL.allowed(precision, u, 1)
            assert abs(mpmath.det(Q) - 1) <= 32 * u
            # Snapping to the coordinate axes, or to none, is 4 eps of the trace off at most.
            diagonal = mpmath.diag([mpmath.mpf(float(x)) for x in found])
            assert max(map(abs, Q * diagonal * Q.T - A)) <= 32 * u * size
    assert (np.diff(np.asarray(moments, float)) >= 0).all()


def _eigen(A):
    """(eigenvalues, ascending, their vectors)."""
    values, vectors = mpmath.eigsy(A)
    order = sorted(range(3), key=lambda i: values[i])
    return [values[i] for i in order], [vectors[:, i] for i in order]


def _off(q, v):
    """The largest difference of two unit vectors, of either sign."""
    return min(max(map(abs, q - v)), max(map(abs, q + v)))


def test_moments_of_double_words():
    six = _symmetric(16, 3)
    with jax.enable_x64(True):
        M = js.SpatialInertia(np.ones(16), np.zeros((16, 3)), six)
        moments = interpreted(lambda M: js.to_double_word(M).principal_moments())(M)
    with mpmath.workdps(60):
        for s, hi, lo in zip(six, np.asarray(moments.hi), np.asarray(moments.lo), strict=True):
            exact = sorted(mpmath.eigsy(mpmath.matrix(matrix(s).tolist()), eigvals_only=True))
            for a, b, c in zip(hi, lo, exact, strict=True):
                assert abs(mpmath.mpf(float(a)) + float(b) - c) <= 128 * EPS**2 * max(map(abs, exact))


def columns(R):
    return np.asarray(R.to_matrix()).T


@pytest.mark.parametrize(
    ("diagonal", "axes"),
    [
        ((2.0, 2.0, 2.0), np.eye(3)),
        ((1.0, 1.0, 1.0 + 4 * EPS), np.eye(3)),
        ((2.0, 3.0, 4.0), np.eye(3)),
        ((3.0, 2.0, 4.0), [[0, 1, 0], [1, 0, 0], [0, 0, -1]]),
        ((4.0, 2.0, 3.0), [[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
        ((3.0, 4.0, 2.0), [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
        ((0.0, 0.0, 0.0), np.eye(3)),
    ],
)
def test_axes_of_diagonal_inertias(diagonal, axes):
    moments, R = of_principal(body(np.diag(diagonal)))
    np.testing.assert_array_equal(moments, sorted(diagonal))
    np.testing.assert_array_equal(columns(R), axes)


def test_axes_of_a_box_turned_there_and_back():
    box = np.diag([1 + 25.0, 9 + 25, 9 + 1]) / 12

    @interpreted
    def turned_and_back(angles, M):
        R = js.Rotation.from_roll_pitch_yaw(angles)
        back = R.inverse() @ (R @ M)
        return (R @ M).principal_moments(), back.central, back.principal_moments_and_axes()[1]

    moments, central, axes = turned_and_back(np.deg2rad([20.0, 25, 30]), body(box))
    np.testing.assert_allclose(moments, np.sort(np.diag(box)), rtol=0, atol=4 * EPS * 3)
    assert np.abs(central[[1, 3, 4]]).max() <= 4 * EPS * 6 / 2
    np.testing.assert_array_equal(columns(axes), [[0, 0, 1], [1, 0, 0], [0, 1, 0]])


def test_axes_of_a_turned_ellipsoid():
    moments = 3 / 5 * np.array([16 + 9.0, 25 + 9, 25 + 16])
    R = interpreted(js.Rotation.about_z)(np.pi / 6)
    found, axes = interpreted(lambda R, M: (R @ M).principal_moments_and_axes())(R, body(np.diag(moments)))
    np.testing.assert_allclose(found, moments, rtol=4 * EPS)
    np.testing.assert_allclose(np.abs(np.diag(columns(axes) @ np.asarray(R.to_matrix()))), 1, rtol=0, atol=8 * EPS)
    np.testing.assert_allclose(np.linalg.det(np.asarray(axes.to_matrix())), 1, rtol=0, atol=8 * EPS)


@pytest.mark.parametrize("mode", [slow(jax.jacfwd), jax.jacrev, slow(jax.hessian)])
def test_derivatives_of_moments_and_axes(mode):
    """Forward, backward and second, against those of a matrix whose moments and axes are known."""
    w0, d0 = np.array([0.3, -0.5, 0.2]), np.array([1.0, 2.0, 3.5])

    def made(x):
        R = js.Rotation.exp(x[:3])
        return (
            R @ js.SpatialInertia(jnp.ones(()), jnp.zeros(3), jnp.zeros(6).at[jnp.array([0, 2, 5])].set(x[3:]))
        ).central

    def moments(x):
        return js.SpatialInertia(jnp.ones(()), jnp.zeros(3), made(x)).principal_moments()

    def axes(x):
        R = js.SpatialInertia(jnp.ones(()), jnp.zeros(3), made(x)).principal_moments_and_axes()[1].to_matrix()
        return R * jnp.broadcast_to(sign, (3, 3))

    x = np.concatenate((w0, d0))
    sign = jnp.ones(3)
    found, turn = interpreted(lambda x: (axes(x), js.Rotation.exp(x[:3]).to_matrix()))(x)
    sign = np.sign(np.diag(found.T @ turn))
    near = 1e-13 if mode is jax.hessian else 1e-14
    rates = np.zeros((3, 6, 6)) if mode is jax.hessian else np.eye(6)[3:]
    np.testing.assert_allclose(interpreted(mode(moments))(x), rates, rtol=0, atol=near)
    expected = interpreted(mode(lambda x: js.Rotation.exp(x[:3]).to_matrix()))(x)
    np.testing.assert_allclose(interpreted(mode(axes))(x), expected, rtol=0, atol=near)


def test_derivatives_where_moments_coincide():
    """Those of the moments' sum and product are right, no axis moves, nothing is NaN."""
    ball = np.array([2.0, 0, 2, 0, 0, 2])

    def moments_and_axes(six):
        return js.SpatialInertia(jnp.ones(()), jnp.zeros(3), six).principal_moments_and_axes()

    d_moments, d_R = interpreted(jax.jacrev(moments_and_axes))(ball)
    np.testing.assert_array_equal(d_moments.sum(0), [1, 0, 1, 0, 0, 1])
    np.testing.assert_array_equal(d_R.entries, 0)


# -- validity ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("central", "slack"),
    [
        (np.diag([2.0, 2, 2]), 1 / 3),
        (np.diag([1.0, 1, 2]), 0),
        (np.diag([0.0, 3, 3]), 0),
        (np.zeros((3, 3)), 0),
        (np.diag([1.0, 1, 4]), -1 / 5),
        (np.diag([-1.0, -1, -1]), -1 / 3),
        (np.diag([2.0, 3, 4]), 0.5 / 4.5),
    ],
)
@pytest.mark.parametrize("dtype", ["float16", slow("bfloat16"), "float32", slow("float64")])
@pytest.mark.parametrize("scale", [1, 2.0**-12, 2.0**12])
def test_slack_of_known_bodies(scale, dtype, central, slack):
    M = body(np.asarray(central) * scale, dtype=jnp.dtype(dtype))
    eps = float(jnp.finfo(dtype).eps)
    np.testing.assert_allclose(np.float64(validity_slack(M)), slack, rtol=0, atol=2 * eps)
    assert bool(is_physically_valid(M)) == (slack >= 0)


def _thin(n, dtype):
    """(masses, central inertias) of rods, plates, bodies of graded thickness and balls, of all sizes, turned."""
    rng = np.random.default_rng(4)
    q, _ = np.linalg.qr(rng.standard_normal((n, 3, 3)))
    s = 10.0 ** rng.uniform(-12, 0, (n, 3))
    s[::5, 0] = 0
    s[1::5, 1:] = 0
    s[2::5] = 1 + 10.0 ** rng.uniform(-16, -1, (len(s[2::5]), 1)) * rng.standard_normal((len(s[2::5]), 3))
    sigma = q @ (s[..., None] * np.swapaxes(q, -1, -2)) * 10.0 ** rng.uniform(-10, 10, (n, 1, 1))
    moments = np.trace(sigma, axis1=1, axis2=2)[:, None, None] * np.eye(3) - sigma
    return (10.0 ** rng.uniform(-5, 5, n)).astype(dtype), six_of((moments + np.swapaxes(moments, -1, -2)) / 2).astype(
        dtype
    )


def _second_moments_of(six):
    """s_1 >= s_2 >= s_3, exactly."""
    a, b, c = _eigen(mpmath.matrix(matrix(six).astype(float).tolist()))[0]
    return [(b - a + c) / 2, (a - b + c) / 2, (a + b - c) / 2]


@dtypes
@precisions
def test_slack_and_ellipsoid_by_definition(precision, dtype):
    """Of what a body can be, and the slack also of what none can."""
    mass, six = _thin(60, dtype)
    u, M = float(unit_roundoff(dtype)), js.SpatialInertia(mass, np.zeros((60, 3), dtype), six)
    axes = evaluated(precision, lambda M: M.equivalent_ellipsoid(precision=precision)[0])(M)
    any_six = np.concatenate([six, _symmetric(40, 7).astype(dtype), _nearly_diagonal(20, dtype).astype(dtype)])
    others = js.SpatialInertia(np.ones(120, dtype), np.zeros((120, 3), dtype), any_six)
    slack = evaluated(precision, lambda M: M.validity_slack(precision=precision))(others)
    with mpmath.workdps(50):
        for m, s, found in zip(mass, map(_second_moments_of, six), np.asarray(axes, float), strict=True):
            squares = [5 * max(x, 0) / mpmath.mpf(float(m)) for x in s]
            worst = max(abs(mpmath.mpf(a) ** 2 - x) for a, x in zip(found, squares, strict=True))
            assert worst <= ELLIPSOID.allowed(precision, u, max(squares))
        for found, s in zip(np.asarray(slack, float), map(_second_moments_of, any_six), strict=True):
            assert abs(mpmath.mpf(found) - s[2] / sum(map(abs, s))) <= SLACK.allowed(precision, u, 1)


def test_slack_is_invariant():
    M = random_inertia((30,), seed=2, spread=1.0)
    w = np.random.default_rng(0).standard_normal((30, 3))
    moved = interpreted(lambda w, M: (js.Rotation.exp(w) @ M.shift(M.com * 100.0)).validity_slack())(w, M)
    np.testing.assert_allclose(moved, validity_slack(M), rtol=0, atol=SLACK.allowed("reproducible", EPS, 1))


# Drake's own examples, with its tolerances where they are relative.
VALID = {
    "nothing": (0.0, (0.0, 0, 0), np.zeros((3, 3))),
    "zero mass, com": (0.0, (1.0, 2, 3), np.zeros((3, 3))),
    "rod far away": (10.0, (1e4, 2e4, 3e4), np.diag([0.0, 20.8, 20.8])),
    "tiny plate far away": (1.0, (10.0, 20, 30), np.diag([0.01, 0.01, 0.02]) / np.pi),
    "moments": (1.0, (0.0, 0, 0), [17.0, -3, 13, -3, -6, 10]),
    "ball": (1.0, (0.0, 0, 0), 1e-5 * np.eye(3)),
    "within 8 eps": (1.0, (0.0, 0, 0), np.diag([2.0, 4, 6 + 8 * EPS * 6])),
    "masses": (1e-20, (0.0, 0, 0), 1e-40 * np.eye(3)),
    "large": (1e20, (1e30, 0, 0), 1e200 * np.eye(3)),
}
INVALID = {
    "mass": (-1.0, (0.0, 0, 0), np.eye(3)),
    "infinite mass": (np.inf, (0.0, 0, 0), np.eye(3)),
    "NaN mass": (np.nan, (0.0, 0, 0), np.eye(3)),
    "infinite com": (1.0, (0.0, np.inf, 0), np.eye(3)),
    "NaN moment": (1.0, (0.0, 0, 0), np.diag([1.0, np.nan, 1])),
    "infinite product": (1.0, (0.0, 0, 0), [1.0, np.inf, 1, 0, 0, 1]),
    "negated": (1.0, (0.0, 0, 0), -np.array([2.0, 0.1, 3, 0.2, 0.3, 4])),
    "com too far out": (1.0, (2.0, 0, 0), np.diag([0.4, -3.6, -3.6])),
    "triangle": (1.0, (0.0, 0, 0), [0.001983, 0.000245, 0.002103, 1.29e-5, 1.5e-6, 0.000408]),
    "doubled": (1.0, (0.0, 0, 0), [34.0, -3, 13, -3, -6, 10]),
    "small": (1.0, (0.0, 0, 0), [1.0, -3, 13, -3, -6, 10]),
    "long": (1.0, (0.0, 0, 0), np.diag([10.0, 10, 30])),
    "products": (1.0, (0.0, 0, 0), [4.0, 2.1, 4, 0, 0, 4]),
    "one product": (1.0, (0.0, 0, 0), [2.0, -0.8, 2, 0, -0.8, 2]),
    "Laplacian": (1.0, (0.0, 0, 0), [2.0, -1, 2, 0, -1, 2]),
    "beyond 64 eps": (1.0, (0.0, 0, 0), np.diag([2.0, 4, 6 + 64 * EPS * 6])),
    # For Drake these are valid, but what has no mass has no moments.
    "zero mass": (0.0, (0.0, 0, 0), np.eye(3)),
    "zero mass, a product": (0.0, (0.0, 0, 0), [0.0, 1e-300, 0, 0, 0, 0]),
}


@pytest.mark.parametrize(
    ("parts", "expected"), [*((x, True) for x in VALID.values()), *((x, False) for x in INVALID.values())]
)
def test_examples(parts, expected):
    M = js.SpatialInertia(*(np.asarray(x, float) for x in parts))
    assert bool(is_physically_valid(M)) == expected


def test_masks_work_everywhere():
    """One compiled program for all of Drake's bodies; where all is forgiven only what is no number is left."""
    bodies = [js.SpatialInertia(*(np.asarray(x, float) for x in one)) for one in (*VALID.values(), *INVALID.values())]
    M = jax.tree.map(lambda *x: np.stack(x), *bodies)
    expected = [True] * len(VALID) + [False] * len(INVALID)
    np.testing.assert_array_equal(jax.jit(jax.vmap(js.SpatialInertia.is_physically_valid))(M), expected)
    assert interpreted(lambda M: M.is_physically_valid(np.inf))(M)[len(VALID) + 6 :].all()


@dtypes
def test_rods_and_plates_turned_any_way_are_valid(dtype):
    turns = interpreted(js.Rotation.exp)(np.random.default_rng(0).standard_normal((500, 3)))
    R = js.Rotation(turns.entries.astype(dtype))
    for thin in (np.diag([0.0, 1, 1]), np.diag([1.0, 2, 3])):
        assert interpreted(lambda R, M: (R @ M).is_physically_valid())(R, body(thin, dtype=dtype)).all()


# -- nearest ----------------------------------------------------------------------------------------------------------


@dtypes
def test_nearest_valid(dtype):
    rng = np.random.default_rng(1)
    M = js.SpatialInertia(
        rng.standard_normal(100).astype(dtype), np.ones((100, 3), dtype), _symmetric(100, 5).astype(dtype)
    )
    N = nearest_valid(M)
    assert is_physically_valid(N).all()
    for x, y in zip(jax.tree.leaves(N), jax.tree.leaves(nearest_valid(N)), strict=True):
        np.testing.assert_array_equal(x, y)
    was_valid = is_physically_valid(js.SpatialInertia(np.abs(M.mass), M.com, M.central))
    assert 0 < was_valid.sum() < 100
    np.testing.assert_array_equal(np.asarray(N.central)[was_valid], np.asarray(M.central)[was_valid])
    # None of them loses all its moments.
    np.testing.assert_array_equal(N.mass, np.where(M.mass > 0, M.mass, np.finfo(dtype).tiny))
    six = np.asarray(M.central, np.float64)
    sigma = np.trace(matrix(six), axis1=1, axis2=2)[:, None, None] / 2 * np.eye(3) - matrix(six)
    eigenvalues, q = np.linalg.eigh(sigma)
    clamped = (q * np.maximum(eigenvalues, 0)[:, None]) @ np.swapaxes(q, -1, -2)
    expected = np.trace(clamped, axis1=1, axis2=2)[:, None, None] * np.eye(3) - clamped
    size = np.abs(np.linalg.eigvalsh(matrix(six))).max(-1)[:, None, None]
    u = float(unit_roundoff(dtype))
    assert (np.abs(matrix(np.asarray(N.central, np.float64)) - expected) <= NEAREST_VALID.u * u * size).all()


@pytest.mark.parametrize("mass", [0.0, -2.0])
def test_nearest_of_moments_without_mass(mass):
    """It has the least mass that there is, unless no moments are left."""
    for moments, expected in ((np.eye(3), np.finfo(np.float64).tiny), (np.zeros((3, 3)), 0.0), (-np.eye(3), 0.0)):
        N = nearest_valid(body(moments, mass=mass))
        assert N.mass == expected and is_physically_valid(N) and validity_slack(N) >= 0
        np.testing.assert_array_equal(N.central[[0, 2, 5]], np.maximum(np.diag(moments), 0))


def test_nearest_of_what_is_not_finite_stays():
    M = js.SpatialInertia(np.nan, np.zeros(3), np.full(6, np.inf))
    N = nearest_valid(M)
    assert np.isnan(N.mass) and np.isinf(N.central).all()


def test_nearest_has_derivatives():
    """Of a body beyond the boundary along the normal: those of the projection."""
    M = body(np.diag([1.0, 1.5, 4.0]))
    moments, step = np.array([1.0, 0, 1.5, 0, 0, 4.0]), 1e-6

    def nearest(six):
        return js.SpatialInertia(M.mass, M.com, six).nearest_valid().central

    jacobian, values = interpreted(jax.jacfwd(nearest))(moments), interpreted(nearest)
    for k, direction in enumerate(step * np.eye(6)):
        slope = (values(moments + direction) - values(moments - direction)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, k], slope, rtol=0, atol=1e-8)


# -- equivalent shapes ------------------------------------------------------------------------------------------------


def box(edges, mass=2.0):
    x, y, z = np.square(edges)
    return body(mass / 12 * np.diag([y + z, x + z, x + y]), mass)


def ellipsoid(axes, mass=3.0):
    x, y, z = np.square(axes)
    return body(mass / 5 * np.diag([y + z, x + z, x + y]), mass)


def test_equivalent_shapes():
    lengths, R = equivalent_ellipsoid(ellipsoid([5.0, 4, 3]))
    np.testing.assert_allclose(lengths, [5, 4, 3], rtol=0, atol=64 * EPS)
    np.testing.assert_array_equal(R.to_matrix(), np.eye(3))
    lengths, R = equivalent_box(box([5.0, 4, 3]))
    np.testing.assert_allclose(lengths, [5, 4, 3], rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(
        equivalent_ellipsoid(box([5.0, 4, 3]))[0], np.sqrt(1 / 0.6) * np.array([2.5, 2, 1.5]), rtol=64 * EPS
    )
    turn = interpreted(js.Rotation.about_z)(np.pi / 6)
    moved = interpreted(lambda R, M, p: R @ M.shift(p))(turn, box([5.0, 4, 3]), np.array([-1.2, -3.4, -5.6]))
    turned, axes = equivalent_box(moved)
    np.testing.assert_allclose(turned, lengths, rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(np.abs(np.diag(columns(axes) @ np.asarray(turn.to_matrix()))), 1, rtol=0, atol=64 * EPS)


def test_flat_and_thin_shapes():
    np.testing.assert_allclose(equivalent_box(box([5.0, 4, 0]))[0], [5, 4, 0], rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(equivalent_box(box([0.0, 5, 0]))[0], [5, 0, 0], rtol=0, atol=64 * EPS)
    np.testing.assert_array_equal(equivalent_ellipsoid(body(np.zeros((3, 3))))[0], np.zeros(3))
    assert not np.isfinite(equivalent_box(body(np.eye(3), 0.0))[0]).any()
    gradient = interpreted(jax.grad(lambda M: M.equivalent_box()[0].sum()))(box([5.0, 4, 0]))
    chex.assert_tree_all_finite(gradient)


def test_minimum_length():
    """Of two points that far apart, and by definition."""
    minimum_length = interpreted(js.SpatialInertia.minimum_length)
    np.testing.assert_allclose(minimum_length(body(np.diag([0.0, 180**2, 180**2]) * 7, 7.0)), 360, rtol=2 * EPS)
    M = random_inertia((20,), seed=3, spread=2.0)
    m, _, i = exactly(M)
    squares = 2 * i[:, [0, 2, 5]].sum(-1) / m
    for precision in ("reproducible", "compensated"):
        found = interpreted(functools.partial(js.SpatialInertia.minimum_length, precision=precision))(M)
        for x, square in zip(found, squares, strict=True):
            exact = mpmath.sqrt(mpmath.mpf(square.numerator) / square.denominator)
            assert abs(float(x) - exact) <= LENGTH.allowed(precision, EPS / 2, exact)


@pytest.mark.parametrize("dtype", ["float16", "float32", "float64"])
def test_lengths_over_all_magnitudes(dtype):
    """Nothing over- or underflows before the result does."""
    tiny, largest = (float(np.sqrt(float(getattr(jnp.finfo(dtype), x)))) for x in ("tiny", "max"))
    for scale in (tiny * 16, 1.0, largest / 16):
        M = body(np.eye(3) * scale**2 / 4, scale, dtype=dtype)
        expected = np.sqrt(2.5 * scale / 4)
        np.testing.assert_allclose(
            np.float64(equivalent_ellipsoid(M)[0]), expected, rtol=8 * float(jnp.finfo(dtype).eps)
        )
