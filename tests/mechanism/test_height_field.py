"""Terrain by its heights: what it is between samples, at cells' edges and beyond the border, in exact arithmetic."""

import functools
from fractions import Fraction

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

F32, F64 = np.dtype(np.float32), np.dtype(np.float64)


@pytest.fixture(autouse=True)
def _digits():
    with mpmath.workdps(60):
        yield


def exactly(x):
    return [Fraction(float(c)) for c in np.ravel(x)]


def reference(field, p):
    """(the heights about a point that may count, the slope, the distance): of Fractions, but for the root."""
    x, y, z = exactly(p)
    heights = np.asarray(field.heights)
    cells, shares, edges = [], [], []
    for c, size, n in zip((x, y), exactly(field.size), heights.shape, strict=True):
        edge, u = size / (n - 1), min(max(c + size / 2, 0), size)
        k = min(u // edge, n - 2)
        is_within = 0 <= c + size / 2 <= size
        cells.append(int(k))
        shares.append((u - k * edge) / edge)
        edges.append(edge if is_within else None)
    (i, j), (t, s) = cells, shares
    a, b, c, d = exactly(heights[i : i + 2, j : j + 2])
    height = a * (1 - t) * (1 - s) + b * (1 - t) * s + c * t * (1 - s) + d * t * s
    slope_x = 0 if edges[0] is None else ((c - a) * (1 - s) + (d - b) * s) / edges[0]
    slope_y = 0 if edges[1] is None else ((b - a) * (1 - t) + (d - c) * t) / edges[1]
    square = 1 + slope_x**2 + slope_y**2
    root = mpmath.sqrt(mpmath.mpf(square.numerator) / square.denominator) if slope_x or slope_y else mpmath.mpf(1)
    f = z - height
    return (i, j), (float(slope_x), float(slope_y)), mpmath.mpf(f.numerator) / f.denominator / root


def terrain(dtype, seed=0, shape=(5, 8)):
    rng = np.random.default_rng(seed)
    heights = rng.normal(size=shape) * np.exp2(rng.integers(-8, 1, shape))
    return js.HeightField(heights.astype(dtype), np.array([2.3, 0.7], dtype))


def hostile(field, dtype):
    """Points in cells, beside their edges, and beyond the border."""
    rng = np.random.default_rng(1)
    size = np.asarray(field.size, float)
    grid = [np.linspace(-s / 2, s / 2, n) for s, n in zip(size, field.heights.shape, strict=True)]
    on = np.stack([rng.choice(grid[0], 60), rng.choice(grid[1], 60), rng.normal(size=60)], -1)
    beside = on + rng.normal(size=on.shape) * np.exp2(rng.integers(-40, -4, on.shape))
    inside = np.concatenate([rng.uniform(-size / 2, size / 2, (80, 2)), rng.normal(size=(80, 1))], -1)
    far = rng.normal(size=(40, 3)) * np.exp2(rng.integers(0, 20, (40, 3)))
    return np.concatenate([on, beside, inside, far]).astype(dtype)


@pytest.mark.parametrize(
    ("dtype", "precision"),
    [
        (F32, "reproducible"),
        (F64, "reproducible"),
        (F32, "compensated"),
        slow(F32, "fast"),
        slow(F64, "fast"),
        slow(F64, "compensated"),
        slow(F32, "faithful"),
    ],
)
def test_distances_are_within_their_bounds(dtype, precision):
    """But beside a line between cells, where the other cell may be taken: there the distance along its normal."""
    with jax.enable_x64(dtype == F64):
        field = terrain(dtype)
        p = hostile(field, dtype)
        normals, found = interpreted(functools.partial(field.normals_and_distances, precision))(p)
    u, heights, size = float(np.finfo(dtype).eps) / 2, np.asarray(field.heights, float), np.asarray(field.size, float)
    edges = size / (np.array(heights.shape) - 1)
    is_precise = precision in ("compensated", "faithful")
    worst, exact = 0.0, 0
    for own, n, at in zip(found, normals, p, strict=True):
        (i, j), slopes, r = reference(field, at)
        expected = np.array([-slopes[0], -slopes[1], 1]) / np.hypot(1, np.hypot(*slopes))
        if abs(n - expected).max() > 64 * u * (1 + np.abs(heights).max() / edges.min()):
            # The neighbour: only within rounding errors of the line between them.
            places = (at[:2].astype(float) + size / 2) / edges
            assert abs(places - np.round(places)).min() * edges.max() < 8 * u * (np.linalg.norm(at) + size.sum())
            continue
        exact += 1
        near = heights[max(i - 1, 0) : i + 3, max(j - 1, 0) : j + 3]
        steep = max(abs(np.diff(near, axis=0)).max() / edges[0], abs(np.diff(near, axis=1)).max() / edges[1])
        reach = float(np.linalg.norm(at.astype(float)))
        scale = reach + abs(heights[i : i + 2, j : j + 2]).max() + steep * (reach + size.sum())
        bound = 1.01 * u * abs(r) + 1024 * u**2 * scale if is_precise else 32 * u * scale
        worst = max(worst, float(abs(mpmath.mpf(float(own)) - r) / bound))
    assert worst <= 1, worst
    assert exact > len(p) / 2


def test_the_kinks_are_as_stated():
    """A line between cells belongs to the one of larger coordinates, the last to the last; the border is held."""
    heights = np.float32([[0, 0, 0], [1, 1, 1], [1, 1, 1], [3, 3, 3]])
    field = js.HeightField(heights, np.float32([3, 2]))
    x = np.float32([-1.5, -0.5, 0.5, 1.5, 1.75, -9, 0])
    p = np.stack([x, 0.3 * np.ones_like(x), np.zeros_like(x)], -1)
    normals, distances = interpreted(lambda p: field.normals_and_distances(None, p))(p)
    slopes = np.array([1, 0, 2, 2, 0, 0, 0])
    np.testing.assert_allclose(-normals[:, 0] / normals[:, 2], slopes, rtol=1e-6, atol=0)
    expected = -np.array([0, 1, 1, 3, 3, 0, 1]) / np.hypot(1, slopes)
    np.testing.assert_allclose(distances, expected, rtol=1e-6, atol=0)
    corner = interpreted(lambda p: field.normals_and_distances(None, p))(np.float32([[-2, 7, 0.5]]))
    np.testing.assert_array_equal(corner[0], np.float32([[0, 0, 1]]))
    np.testing.assert_array_equal(corner[1], np.float32([0.5]))
    for at in ([np.nan, 0, 0], [0, np.nan, 0], [0, 0, np.nan]):
        assert np.isnan(interpreted(field)(np.float32(at)))


def test_a_height_that_is_none_is_none_where_it_counts():
    heights = jnp.zeros((3, 4), jnp.float32).at[0, 0].set(jnp.nan)
    found = js.HeightField(heights, np.float32([2, 3]))(np.float32([[-0.9, -1.4, 1], [0.5, 1, 1], [-0.9, 0.2, 1]]))
    np.testing.assert_array_equal(found, np.float32([np.nan, 1, 1]))


def test_derivatives_by_points_heights_and_sizes():
    """Against differences, in cells and beyond the border."""
    with jax.enable_x64(True):
        rng = np.random.default_rng(3)
        X = js.RigidTransform(js.Rotation.exp(0.2 * rng.normal(size=3)), rng.normal(size=3))
        field = terrain(F64)
        heights, size, p = field.heights, field.size, rng.uniform(-1.5, 1.5, (30, 3))
        along = [rng.normal(size=x.shape) for x in (heights, size, p, X.translation, X.rotation.entries)]

        def of(s):
            moved = [
                x + s * a for x, a in zip((heights, size, p, X.translation, X.rotation.entries), along, strict=True)
            ]
            placed = js.RigidTransform(js.Rotation(moved[4]), moved[3])
            return js.HeightField(moved[0], moved[1], placed).normals_and_distances(None, moved[2])

        found, h = interpreted(lambda s: jax.jvp(of, (s,), (1.0,))[1])(0.0), 1e-6
        for own, ahead, behind in zip(found, interpreted(of)(h), interpreted(of)(-h), strict=True):
            np.testing.assert_allclose(own, (ahead - behind) / (2 * h), rtol=0, atol=2e-5)
        backward = jax.grad(lambda x: js.HeightField(x, size)(p).sum())(jnp.asarray(heights))
        ahead, behind = (
            interpreted(lambda s: js.HeightField(heights + s * along[0], size)(p).sum())(s) for s in (h, -h)
        )
        np.testing.assert_allclose((backward * along[0]).sum(), (ahead - behind) / (2 * h), rtol=1e-6, atol=0)


def test_environments_have_heights_of_their_own():
    """By vmap, and as a batch of points of each."""
    rng = np.random.default_rng(2)
    many, p = rng.normal(size=(3, 4, 5)).astype(F32), rng.normal(size=(3, 6, 3)).astype(F32)
    size = np.float32([2, 3])
    each = [interpreted(js.HeightField(h, size))(own) for h, own in zip(many, p, strict=True)]
    mapped = jax.jit(jax.vmap(lambda h, p: js.HeightField(h, size)(p)))(many, p)
    field = js.HeightField(many, size)
    assert field.batch_shape == (3,)
    np.testing.assert_array_equal(mapped, each)
    np.testing.assert_array_equal(field.of_many_points().normals_and_distances(None, jnp.asarray(p))[1], each)
    np.testing.assert_array_equal(field(p[:, 0]), np.stack(each)[:, 0])
    grid = js.HeightField(many.reshape((3, 1, 4, 5)), size)
    np.testing.assert_array_equal(grid(p), each)


def test_sixteen_bits_find_their_cell():
    """Of 300 cells, whose numbers 8 bits cannot hold."""
    heights = np.zeros((300, 2), jnp.bfloat16)
    heights[257:] = 1
    field = js.HeightField(heights, jnp.array([299, 1], jnp.bfloat16))
    at = jnp.array([[120.0, 0, 1], [90.0, 0, 1]], jnp.bfloat16)
    np.testing.assert_array_equal(np.asarray(field(at), float), [0, 1])


def test_an_image_is_seen_from_above():
    """x to the right, y up; grey levels of any width."""
    levels = np.array([[0, 51, 255], [0, 0, 102]], np.uint8)
    field = js.HeightField.from_image(levels, np.float32([2, 1]), np.float32(2))
    expected = np.float32([[0, 0], [0, 0.4], [0.8, 2]])
    np.testing.assert_allclose(field.heights, expected, rtol=1e-6, atol=0)
    assert field.dtype == F32
    for other in (levels.astype(np.uint16) * 257, levels.astype(np.float32) / 255):
        again = js.HeightField.from_image(other, np.float32([2, 1]), np.float32(2))
        np.testing.assert_allclose(again.heights, expected, rtol=1e-6, atol=0)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: js.HeightField(np.zeros((1, 5)), (1.0, 1.0)), ValueError, r"heights: expected shape \(\*batch, n_x,"),
        (lambda: js.HeightField(np.zeros(5), (1.0, 1.0)), ValueError, r"of 2 at least, got \(5,\)"),
        (lambda: js.HeightField(np.zeros((2, 2)), 1.0), ValueError, r"size: expected shape \(\*batch, 2\), got \(\)"),
        (lambda: js.HeightField(np.zeros((2, 2)), (1.0, 0.0)), ValueError, "size: expected numbers above 0, got"),
        (lambda: js.HeightField(np.zeros((2, 2)), (1.0, np.inf)), ValueError, r"size: expected finite .* inf at \[1\]"),
        (
            lambda: js.HeightField([[0.0, 0.0], [0.0, np.nan]], (1.0, 1.0)),
            ValueError,
            r"heights: expected finite numbers, got nan at \[1, 1\]",
        ),
        (lambda: js.HeightField.from_image(np.zeros((2, 2, 3)), (1.0, 1.0), 1.0), ValueError, "one channel"),
        (lambda: js.HeightField.from_image(np.zeros((2, 2), int), (1.0, 1.0), 1.0), TypeError, "without a sign"),
        (lambda: js.HeightField("hills", (1.0, 1.0)), TypeError, "heights: expected an array of floating point"),
    ],
)
def test_what_is_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()
