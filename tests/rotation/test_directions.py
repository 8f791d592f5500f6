"""Rotations from directions, and nearest to matrices, against 160 digits; interpolation.

In NumPy (`interpreted`); the table of operations holds the bits of compiled programs.
"""

import functools

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.rotation import rotation as bounds
from tests.helpers import exact_rotation as exact
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.rotation_cases import allowed, eps, of_dtype, wide_dtypes

CASES = [
    ("bfloat16", "reproducible"),
    ("float32", "reproducible"),
    ("float32", "compensated"),
    ("float64", "fast"),
    ("float64", "faithful"),
]
USUAL = [("float32", "reproducible"), ("float32", "compensated")]
cases = pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, CASES))


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


def errors(R, references):
    return np.linalg.norm(exact.differences(R.entries, references), axis=1) / np.sqrt(3)


def unit(v):
    n = exact.length(v)
    return [x / n for x in v]


def cross(a, b):
    return list(exact.cross_matrix(a) * mp.matrix(b))


def with_columns(columns):
    return [columns[j][i] for i in range(3) for j in range(3)]


def vectors(dtype, seed, count=12):
    rng = np.random.default_rng(seed)
    v = rng.standard_normal((count, 3))
    v[:3] = np.eye(3)
    v[3] = [1, 1, 1]
    v[4:6] *= 1e-3
    return of_dtype(v, dtype)


CONSTRUCTORS = {
    "from_one_vector": js.Rotation.from_one_vector,
    "from_two_vectors": lambda v: js.Rotation.from_two_vectors(v, -jnp.roll(v, 1, -1)),
    "between": lambda v: js.Rotation.between(v, jnp.roll(v, 1, -1)),
    "from_axis_angle": lambda v: js.Rotation.from_axis_angle(v, jnp.ones(v.shape[:-1], v.dtype)),
}


@pytest.mark.parametrize("name", CONSTRUCTORS)
@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_directions_of_the_smallest_vectors(name, dtype):
    """Down to a size of tiny / eps what is flushed to zero is below their roundoff."""
    v = np.random.default_rng(8).uniform(0.01, 1, (40, 3))
    v[::2, 1] *= eps(dtype)
    v = of_dtype(v / np.abs(v).max(-1, keepdims=True), dtype)
    small = v * v.dtype.type(float(jnp.finfo(dtype).tiny) / eps(dtype))
    found, expected = (np.asarray(interpreted(CONSTRUCTORS[name])(x).entries, float) for x in (small, v))
    assert np.abs(found - expected).max() <= 16 * eps(dtype)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("precision", [slow("reproducible"), "compensated"])
def test_logarithms_of_the_smallest_angles(dtype, precision):
    tiny = float(jnp.finfo(dtype).tiny)
    angles = np.array([0.5, 0.9, 1.1, 1.5, 2.5, 3.5, 4.5, 6.0, 9.0, 50.0]) * tiny
    R = js.Rotation(of_dtype([[1, -a, 0, a, 1, 0, 0, 0, 1] for a in angles], dtype))
    log, q = interpreted(lambda R: (R.log(precision=precision), R.to_quaternion(precision=precision)))(R)
    errors = np.abs([np.float64(log[:, 2]) - angles, np.float64(q[:, 3]) - angles / 2])
    assert (errors <= 8 * tiny + 4 * eps(dtype) * angles).all()


@cases
@pytest.mark.parametrize("axis", [0, slow(2)])
def test_from_one_vector(axis, dtype, precision):
    u = vectors(dtype, 0)
    of_vector = evaluated(precision, lambda u: js.Rotation.from_one_vector(u, axis, precision=precision))
    found = of_vector(u)
    exact_ones = []
    for x in map(exact.vector, u):
        first = unit(x)
        k = min(range(3), key=lambda i: abs(x[i]))
        second = unit(cross([int(i == k) for i in range(3)], first))
        columns = [first, second, cross(first, second)]
        exact_ones.append(with_columns([columns[(j - axis) % 3] for j in range(3)]))
    assert errors(found, exact_ones).max() <= allowed(dtype, precision, bounds.FROM_ONE_VECTOR)
    assert np.isnan(of_vector(0 * u).entries).all()


def test_one_vector_is_the_third_axis_unless_another_is_named():
    np.testing.assert_array_equal(js.Rotation.from_one_vector([0.0, 3.0, 0.0]).to_matrix()[:, 2], [0, 1, 0])


@cases
@pytest.mark.parametrize("axes", [(2, 0), slow((0, 2)), slow((1, 2))])
def test_from_two_vectors(axes, dtype, precision):
    u, v = vectors(dtype, 1), vectors(dtype, 2)[::-1]
    of_vectors = evaluated(precision, lambda u, v: js.Rotation.from_two_vectors(u, v, axes, precision=precision))
    found = of_vectors(u, v)
    exact_ones, sines = [], []
    for x, y in zip(map(exact.vector, u), map(exact.vector, v), strict=True):
        first, normal = unit(x), cross(unit(x), unit(y))
        sines.append(float(exact.length(normal)))
        second = cross(unit(normal), first)
        third = cross(first, second) if (axes[1] - axes[0]) % 3 == 1 else cross(second, first)
        columns = dict(zip((*axes, 3 - sum(axes)), (first, second, third), strict=True))
        exact_ones.append(with_columns([columns[k] for k in range(3)]))
    assert (errors(found, exact_ones) * np.array(sines)).max() <= allowed(dtype, precision, bounds.FROM_TWO_VECTORS)
    m = np.asarray(found.to_matrix(), float)
    np.testing.assert_allclose(np.linalg.det(m), 1, atol=0.05)
    assert not np.isfinite(np.asarray(of_vectors(u, -u).entries[:2], float)).all()


def test_of_two_vectors_the_first_is_along_z_unless_told():
    u, v = of_dtype(np.array([0.0, 0, 3]), "float32"), of_dtype(np.array([2.0, 0, 1]), "float32")
    np.testing.assert_array_equal(interpreted(js.Rotation.from_two_vectors)(u, v).to_matrix(), np.eye(3))


@cases
def test_between(dtype, precision):
    """The smallest rotation from one direction to the other, up to nearly opposite ones."""
    rng = np.random.default_rng(3)
    a = rng.standard_normal((16, 3))
    b = rng.standard_normal((16, 3))
    off = np.maximum(10.0 ** -np.arange(1, 7), 16 * float(jnp.finfo(dtype).eps))
    b[:6] = -a[:6] + off[:, None] * rng.standard_normal((6, 3))
    b[6] = a[6]
    a, b = of_dtype(a, dtype), of_dtype(b, dtype)
    found = evaluated(precision, lambda a, b: js.Rotation.between(a, b, precision=precision))(a, b)
    exact_ones, halves = [], []
    for x, y in zip(map(exact.vector, a), map(exact.vector, b), strict=True):
        x, y = unit(x), unit(y)
        n, c = cross(x, y), sum(p * q for p, q in zip(x, y, strict=True))
        k = exact.cross_matrix(n)
        exact_ones.append(mp.eye(3) + k + k * k / (1 + c))
        halves.append(float(mp.sqrt((1 + c) / 2)))
    assert (errors(found, exact_ones) * np.array(halves)).max() <= allowed(dtype, precision, bounds.BETWEEN)


@wide_dtypes
def test_between_opposite_directions(dtype):
    a = vectors(dtype, 4)
    turned, log = interpreted(lambda a: (js.Rotation.between(a, -a) @ a, js.Rotation.between(a, -a).log()))(a)
    assert np.abs(turned.astype(float) + a).max() <= 8 * jnp.finfo(dtype).eps * np.abs(a).max()
    np.testing.assert_allclose(np.linalg.norm(log.astype(float), axis=1), np.pi, rtol=1e-6)
    gradient = interpreted(jax.jacrev(lambda b: js.Rotation.between(a[7], b).entries))(2 * a[7])
    assert np.isfinite(gradient).all()


def polar(m):
    """The orthogonal polar factor in 160 digits, by Newton's iteration."""
    m = mp.matrix(3, 3) + mp.matrix([[m[3 * i + j] for j in range(3)] for i in range(3)])
    for _ in range(60):
        new = (m + (m**-1).T) / 2
        if mp.mnorm(new - m, "f") < mp.mpf(10) ** -100:
            return new
        m = new
    raise AssertionError("no convergence")


@cases
def test_nearest(dtype, precision):
    rng = np.random.default_rng(5)
    m = rng.standard_normal((16, 3, 3))
    m *= np.sign(np.linalg.det(m))[:, None, None]
    near = np.linalg.qr(rng.standard_normal((8, 3, 3)))[0]
    m[:8] = near * np.linalg.det(near)[:, None, None] + 1e-3 * rng.standard_normal((8, 3, 3))
    m[8] *= 1e4
    m[9] *= 1e-4
    m[10] = m[10] @ np.diag([1, 1e-2, 1e-1])
    m = of_dtype(m, dtype)
    nearest = evaluated(precision, lambda m: js.Rotation.nearest(m, precision=precision).entries)
    found = js.Rotation(nearest(m))
    values = np.linalg.svd(np.asarray(m, float), compute_uv=False)
    condition = 2 * values[:, 0] / (values[:, 1] + values[:, 2])
    wrong = errors(found, [polar(exact.vector(x)) for x in m])
    assert (
        wrong <= allowed(dtype, precision, bounds.NEAREST) * (condition if precision in ("fast", "reproducible") else 1)
    ).all()
    bad = [np.diag(x) for x in ([1, 1, -1], [0, 0, 0], [1, 1, 0], [np.inf, 1, 1])] + [np.full((3, 3), np.nan)]
    assert np.isnan(np.asarray(nearest(of_dtype(bad, dtype)), float)).any(-1).all()


def test_no_rotation_is_near_a_reflection():
    """Of any orientation, rounded on either side of a determinant of -1."""
    R = interpreted(js.Rotation.exp)(np.random.default_rng(0).standard_normal((512, 3))).to_matrix()
    m = of_dtype(np.asarray(R) * np.array([1, 1, -1]), "float32")
    assert np.isnan(interpreted(js.Rotation.nearest)(m).entries).any(-1).all()


@wide_dtypes
def test_nearest_removes_drift(dtype):
    """Of a product of 1000 random rotations, which is off by its rounding errors; twice changes nothing more."""

    def multiplied(w):
        start = js.Rotation(jnp.eye(3, dtype=dtype).ravel())
        return jax.lax.scan(lambda R, step: (R @ step, None), start, js.Rotation.exp(w))[0]

    product = interpreted(multiplied)(of_dtype(np.random.default_rng(6).standard_normal((1000, 3)), dtype))
    nearest = interpreted(js.Rotation.nearest)
    eps = float(jnp.finfo(dtype).eps)

    def off(R):
        m = np.asarray(R.to_matrix(), np.longdouble)
        return np.abs(m @ m.T - np.eye(3)).max()

    assert off(product) > 10 * eps
    cleaned = nearest(np.asarray(product.to_matrix()))
    assert off(cleaned) <= 8 * eps
    assert np.abs(np.asarray(cleaned.entries - product.entries, float)).max() <= 2 * off(product)
    assert np.abs(nearest(np.asarray(cleaned.to_matrix())).entries - cleaned.entries).max() <= 8 * eps


@pytest.mark.parametrize("mode", [slow(jax.jacfwd), jax.jacrev])
def test_derivative_of_nearest(mode):
    """Along symmetric changes 0, along turns the turn: d exp(s w) (1 + s S) at s = 0."""
    R = np.asarray(interpreted(js.Rotation.exp)(np.array([0.3, -2.0, 1.0])).to_matrix())
    S = np.array([[1.0, 2, 3], [2, -1, 0], [3, 0, 2]])
    K = np.array([[0.0, -3, 2], [3, 0, -1], [-2, 1, 0]])
    derivative = mode(lambda s: js.Rotation.nearest(R @ np.eye(3) + s * (R @ (S + K))).to_matrix())
    np.testing.assert_allclose(interpreted(derivative)(0.0), R @ K, atol=1e-14)


@wide_dtypes
def test_interpolation(dtype):
    """t = 0 and 1 give both ends, between the turn is in proportion, beyond it goes on; also of poses."""
    rng = np.random.default_rng(7)
    w = rng.standard_normal((20, 3))
    exp = interpreted(js.Rotation.exp)
    start, step = (exp(of_dtype(x, dtype)) for x in (rng.standard_normal((20, 3)), w))
    end = interpreted(lambda R, S: R @ S)(start, step)
    eps = float(jnp.finfo(dtype).eps)
    interpolated = interpreted(lambda R, S, t: R.interpolate(S, jnp.broadcast_to(t, (20,))))
    for t in (0.0, 0.5, 1.0, 3.0, -1.0):
        found = np.asarray(interpolated(start, end, of_dtype(t, dtype)).to_matrix(), float)
        expected = np.asarray(start.to_matrix(), float) @ np.asarray(exp(t * w).to_matrix())
        assert (
            np.linalg.norm(found - expected, 2, axis=(1, 2)).max()
            <= (bounds.INTERPOLATED.u + bounds.EACH_WAY.u * abs(t)) * eps / 2
        )
    np.testing.assert_array_equal(interpolated(start, end, of_dtype(0, dtype)).entries, start.entries)
    assert np.isnan(interpolated(start, end, of_dtype(np.nan, dtype)).entries).all()
    p, q = (of_dtype(rng.standard_normal((20, 3)), dtype) for _ in range(2))
    X, Y = js.RigidTransform(start, p), js.RigidTransform(end, q)
    sizes = np.linalg.norm(np.asarray(p, float), axis=1) + np.linalg.norm(np.asarray(q, float), axis=1)
    for t, expected in ((0, p), (1, q)):
        wrong = np.linalg.norm(interpolated(X, Y, of_dtype(t, dtype)).translation.astype(float) - expected, axis=1)
        assert (wrong / sizes).max() <= (4 + 8 * t) * eps
    half = interpolated(X, Y, of_dtype(0.5, dtype))
    twice = interpreted(lambda X, half: half @ X.inverse_times(half))(X, half)
    assert np.abs(twice.translation.astype(float) - q).max() <= 40 * eps * sizes.max()


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_bound_of_interpolation(precision):
    """Of two matrices as they are, up to a hundred times the way; rounded once in "compensated"."""
    rng, u = np.random.default_rng(8), 2.0**-24
    w, t = rng.standard_normal((2, 24, 3)), of_dtype(np.resize([1e-3, 1, -1, 3, 30, 100], 24), "float32")
    ends = [js.Rotation(of_dtype(x.entries, "float32")) for x in map(interpreted(js.Rotation.exp), w)]
    found = evaluated(precision, lambda *x: js.Rotation.interpolate(*x, precision=precision))(*ends, t)
    for x, y, k, ours in zip(*(R.entries.astype(float) for R in ends), t.astype(float), found.entries, strict=True):
        R = x.reshape(3, 3)
        q, *n = exact.proportional_to_quaternion(R.T @ y.reshape(3, 3))
        turn = exact.exp([k * 2 * mp.atan2(exact.length(n), q) / exact.length(n) * c for c in n])
        error = np.linalg.norm(exact.differences(ours, [mp.matrix(R.tolist()) * turn])) / np.sqrt(3)
        assert error <= bounds.INTERPOLATED.allowed(precision, u, 1) + bounds.EACH_WAY.allowed(precision, u, abs(k))


@pytest.mark.parametrize("name", ["exp", slow("left_jacobian"), slow("left_jacobian_inverse")])
def test_decisions_of_angles_agree_with_themselves(name):
    """In "fast" too, at the switches: a batch of angles within rounding of |w|^2 = 10 and 1."""
    rng = np.random.default_rng(9)
    d = rng.standard_normal((4000, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    for size in (np.sqrt(10), 1.0):
        w = of_dtype(d * size * (1 + rng.integers(-4, 5, (4000, 1)) * 2.0**-24), "float32")
        f = functools.partial(_entries, getattr(js.Rotation, name))
        fast, exact_ones = (
            evaluated(p, jax.vmap(jax.jacfwd(functools.partial(f, p))))(w) for p in ("fast", "compensated")
        )
        assert np.abs(np.asarray(fast) - exact_ones).max() <= 1e-4 * (1 if size < 2 else 4)


def test_decisions_of_rows_that_tie_agree_with_themselves():
    rng = np.random.default_rng(10)
    q = of_dtype(rng.choice([-0.5, 0.5], (4000, 4)) * (1 + 1e-7 * rng.standard_normal((4000, 4))), "float32")
    R, twice = interpreted(lambda q: [f(js.Rotation.from_quaternion(q)) for f in (lambda R: R, lambda R: R @ R)])(q)
    turned = jax.jit(lambda R, S: R.interpolate(S, jnp.ones(4000, jnp.float32), precision="fast"))(R, twice)
    assert np.abs(np.asarray(turned.entries) - twice.entries).max() <= 1e-5


def _entries(function, precision, w):
    found = function(w, precision=precision)
    return found.entries if isinstance(found, js.Rotation) else found
