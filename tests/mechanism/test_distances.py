"""Distances between shapes: held to optima found by other means, at every degenerate pose, with their derivatives."""

import functools
import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.optimize import lsq_linear

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.marks import slow

F32, F64 = np.dtype(np.float32), np.dtype(np.float64)


@pytest.fixture(autouse=True)
def _digits():
    with mpmath.workdps(50):
        yield


# -- references -------------------------------------------------------------------------------------------------------


def core(shape, i):
    """(p, the half lines of which it is the sum, the radius about) of item i, in float64."""
    p, R = (np.asarray(x, float)[i] for x in (shape.placement.translation, shape.placement.rotation.to_matrix()))
    if isinstance(shape, js.Box):
        return p, [R[:, k] * float(shape.size[i, k]) / 2 for k in range(3)], 0.0
    return p, [R[:, 2] * float(shape.length[i]) / 2], float(shape.radius[i])


def reference(a, b, i):
    """The distance: least squares with bounds outside; inside the least overlap along a product of two lines."""
    (p_a, of_a, r_a), (p_b, of_b, r_b) = core(a, i), core(b, i)
    lines, p = np.array([*of_a, *of_b]), p_b - p_a
    apart = 0.0
    if len(of_a) == len(of_b) == 1:
        apart = between_lines(p, *lines)
    elif len(lines) == 4:
        line, box = (of_a[0], b) if len(of_a) == 1 else (of_b[0], a)
        R = np.asarray(box.placement.rotation.to_matrix(), float)[i]
        apart = from_line_to_box(p if box is a else -p, line, R, np.asarray(box.size[i], float) / 2)
    else:
        found = lsq_linear(
            np.concatenate([lines[: len(of_a)], -lines[len(of_a) :]]).T, p, (-1, 1), tol=1e-15, method="bvls"
        )
        apart = np.sqrt(2 * found.cost)
    if apart < (1e-10 if len(lines) == 6 else 1e-14) and len(lines) > 2:
        # Also of lines without a length: those of a box are perpendicular.
        rows = [np.asarray(x.placement.rotation.to_matrix(), float)[i].T for x in (a, b)]
        axes = np.concatenate([x if len(n) == 3 else x[2:] for x, n in zip(rows, (of_a, of_b), strict=True)])
        directions = [np.cross(x, y) for x, y in itertools.combinations(axes, 2)]
        units = [n / np.linalg.norm(n) for n in directions if np.linalg.norm(n) > 1e-9]
        apart = -max(0.0, min(abs(lines @ n).sum() - abs(p @ n) for n in units))
    return apart - r_a - r_b


def between_lines(p, a, b):
    """The least distance of s a from p + t b, |s|, |t| <= 1, in 50 digits: of the inner point and of the four sides."""
    p, a, b = ([mpmath.mpf(float(c)) for c in x] for x in (p, a, b))

    def dot(x, y):
        return sum(c * d for c, d in zip(x, y, strict=True))

    def size(s, t):
        w = [x + t * y - s * z for x, y, z in zip(p, b, a, strict=True)]
        return mpmath.sqrt(dot(w, w))

    def clip(x):
        return min(max(x, mpmath.mpf(-1)), mpmath.mpf(1))

    found = []
    for x in (mpmath.mpf(-1), mpmath.mpf(1)):
        found.append(size(x, clip((x * dot(a, b) - dot(p, b)) / dot(b, b)) if dot(b, b) else 0))
        found.append(size(clip((dot(p, a) + x * dot(a, b)) / dot(a, a)) if dot(a, a) else 0, x))
    det = dot(a, a) * dot(b, b) - dot(a, b) ** 2
    if det > 0:
        s = (dot(p, a) * dot(b, b) - dot(a, b) * dot(p, b)) / det
        t = (dot(a, b) * dot(p, a) - dot(a, a) * dot(p, b)) / det
        if abs(s) <= 1 and abs(t) <= 1:
            found.append(size(s, t))
    return float(min(found))


def from_line_to_box(p, e, R, half):
    """The least distance of p + s e, |s| <= 1, from a box about the origin, in 50 digits: by thirds."""
    p, e, half = ([mpmath.mpf(float(c)) for c in x] for x in (p, e, half))
    rows = [[mpmath.mpf(float(c)) for c in x] for x in R.T]

    def square(s):
        x = [c + s * d for c, d in zip(p, e, strict=True)]
        own = (abs(sum(c * d for c, d in zip(row, x, strict=True))) for row in rows)
        return sum(max(c - h, 0) ** 2 for c, h in zip(own, half, strict=True))

    low, high = mpmath.mpf(-1), mpmath.mpf(1)
    for _ in range(100):
        third = (high - low) / 3
        low, high = (low, high - third) if square(low + third) <= square(high - third) else (low + third, high)
    return float(mpmath.sqrt(square((low + high) / 2)))


# -- cases ------------------------------------------------------------------------------------------------------------


def placed(rotations, positions, dtype):
    with jax.enable_x64(True):
        R = js.Rotation.exp(np.asarray(rotations, float))
        entries = np.asarray(R.entries).astype(dtype)
    return js.RigidTransform(js.Rotation(entries), np.asarray(positions).astype(dtype))


def poses(seed, n, spread, dtype, alike=False):
    """Two batches of n placements; alike: turned by little against each other, or by quarters."""
    rng = np.random.default_rng(seed)
    w = rng.normal(size=(n, 3))
    other = rng.normal(size=(n, 3))
    if alike:
        w = 0 * w
        quarters = np.pi / 2 * rng.integers(0, 3, (n, 1)) * np.eye(3)[rng.integers(0, 3, n)]
        other = quarters + rng.normal(size=(n, 3)) * 10.0 ** -rng.integers(1, 12, (n, 1)) * rng.integers(0, 2, (n, 1))
    p = spread * rng.normal(size=(2, n, 3))
    if alike:
        p = np.where(rng.random((2, n, 3)) < 0.4, 0, np.round(4 * p) / 4)
    return placed(w, p[0], dtype), placed(other, p[1], dtype)


def made(kinds, dtype, n=40, alike=False, spread=0.6, seed=0):
    rng = np.random.default_rng(seed)
    shapes = []
    for kind, X in zip(kinds, poses(seed, n, spread, dtype, alike), strict=True):
        if kind is js.Box:
            size = np.where(alike, rng.choice([0.0, 0.25, 0.5, 1.0], (n, 3)), rng.uniform(0.05, 1, (n, 3)))
            size[0] = np.maximum(size[0], 0.25)
            shapes.append(js.Box(size.astype(dtype), X))
        elif kind is js.Cylinder:
            sizes = np.where(alike, rng.choice([0.0, 0.25, 0.5, 1.0], (2, n)), rng.uniform(0.05, 0.6, (2, n)))
            shapes.append(js.Cylinder(*sizes.astype(dtype), X))
        else:
            length = np.where(alike, rng.choice([0.0, 0.5, 1.0], n), rng.uniform(0.05, 1, n))
            shapes.append(js.Capsule(rng.uniform(0, 0.2, n).astype(dtype), length.astype(dtype), X))
    return shapes


PAIRS = [(js.Capsule, js.Capsule), (js.Capsule, js.Box), (js.Box, js.Capsule), (js.Box, js.Box)]
OF_CYLINDERS = [(js.Capsule, js.Cylinder), (js.Box, js.Cylinder)]


def of_pairs(*kinds):
    return pytest.mark.parametrize("kinds", kinds, ids=lambda x: "-".join(k.__name__ for k in x))


each_pair = of_pairs(*PAIRS)


def closest(kinds, dtype, alike):
    """(a, b, their closest points) of 60 items, of which holds what is said of all shapes: the distance alone is the
    same, points are along the normal, and where shapes are apart, on the surfaces."""
    with jax.enable_x64(dtype == F64):
        a, b = made(kinds, dtype, 60, alike, 0.25)
        found = interpreted(js.closest_points)(a, b)
        alone = interpreted(js.distance)(a, b)
        on = [interpreted(lambda p, s=s: s(p))(p) for s, p in ((a, found.point_a), (b, found.point_b))]
    np.testing.assert_array_equal(alone, found.distance)
    assert found.distance.dtype == dtype
    u = np.finfo(dtype).eps / 2
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=-1), 1, rtol=0, atol=8 * u)
    w = found.point_b.astype(float) - found.point_a
    np.testing.assert_allclose(w, found.distance[:, None].astype(float) * found.normal, rtol=0, atol=64 * u)
    for own in on:
        assert abs(own[found.distance > 0]).max() < 64 * u
    return a, b, found


# Degenerate pairs where u is largest, others where it is smallest.
any_and_alike = pytest.mark.parametrize(
    ("alike", "dtype"),
    [(False, F64), (True, F32), slow(False, F32), slow(True, F64)],
    ids=["any-float64", "alike-float32", "any-float32", "alike-float64"],
)


@each_pair
@any_and_alike
def test_distances_are_optima(kinds, alike, dtype):
    """Apart and inside one another, parallel, nearly so, crossing, and without any length."""
    a, b, found = closest(kinds, dtype, alike)
    u = np.finfo(dtype).eps / 2
    # The reference has errors of its own.
    worst, inside = 0.0, 0
    for i in range(60):
        r = reference(a, b, i)
        (p_a, of_a, r_a), (p_b, of_b, r_b) = core(a, i), core(b, i)
        scale = np.linalg.norm(p_b - p_a) + np.linalg.norm([*of_a, *of_b], axis=1).sum() + r_a + r_b
        bound = 64 * u * scale + 4 * u * (np.linalg.norm(p_a) + np.linalg.norm(p_b))
        own = 1e-12 if len(of_a) + len(of_b) > 4 else 0.0
        worst = max(worst, (abs(found.distance[i] - r) - own) / bound)
        inside += r < 0
    assert worst <= 1, worst
    assert 5 < inside < 55


def gap(normal, a, b, i):
    """The gap between items i along unit vectors (..., 3), by the farthest points along them, in longdouble."""
    total = 0.0
    n = np.asarray(normal, np.longdouble)
    for shape, sign in ((a, -1), (b, 1)):
        X = shape.placement
        R, p = (np.asarray(x, np.longdouble)[i] for x in (X.rotation.to_matrix(), X.translation))
        x, y, z = np.moveaxis(abs(n @ R), -1, 0)
        if isinstance(shape, js.Box):
            reach = np.stack([x, y, z], -1) @ np.asarray(shape.size[i], np.longdouble) / 2
        else:
            radius, half = (np.asarray(v[i], np.longdouble) for v in (shape.radius, shape.length / 2))
            reach = half * z + radius * (np.hypot(x, y) if isinstance(shape, js.Cylinder) else 1)
        total = total + sign * (n @ p) - reach
    return total


def widest(a, b, i, start=None):
    """The widest gap of 3000 directions, or of one, and of a random search around the best of them: a lower bound."""
    rng = np.random.default_rng(0)
    n, steps = rng.normal(size=(3000, 3)), 0.2 * 0.8 ** np.arange(60)
    if start is not None:
        n, steps = np.asarray(start, float)[None], 1e-3 * 0.8 ** np.arange(130)
    n = np.asarray(n, np.longdouble)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n = n[np.argsort(gap(n, a, b, i))[-6:]]
    for step in steps:
        near = n[:, None] + step * rng.normal(size=(len(n), 40, 3))
        near[:, 0] = n
        near /= np.linalg.norm(near, axis=-1, keepdims=True)
        n = near[np.arange(len(n)), gap(near, a, b, i).argmax(1)]
    return float(gap(n, a, b, i).max())


def scale_of(shape, i):
    sizes = [shape.size[i]] if isinstance(shape, js.Box) else [2 * shape.radius[i], shape.length[i]]
    return sum(float(np.linalg.norm(x)) for x in sizes)


@of_pairs(*OF_CYLINDERS)
@any_and_alike
def test_distances_of_cylinders_are_optima(kinds, alike, dtype):
    """No gap is wider than a distance. Along the normal it is as wide, and where shapes are apart, closest points are
    as near: that is a proof. Inside no direction of many has a wider one."""
    a, b, found = closest(kinds, dtype, alike)
    u = np.finfo(dtype).eps / 2
    p = [np.asarray(x.placement.translation, float) for x in (a, b)]
    worst, inside = 0.0, 0
    for i in range(60):
        scale = np.linalg.norm(p[1][i] - p[0][i]) + scale_of(a, i) + scale_of(b, i)
        bound = 64 * u * scale + 4 * u * (np.linalg.norm(p[0][i]) + np.linalg.norm(p[1][i]))
        d, normal = float(found.distance[i]), np.asarray(found.normal[i], np.longdouble)
        along = float(gap(normal / np.linalg.norm(normal), a, b, i))
        if abs(along - d) > bound:
            # Of points that are nearly one the direction has few digits.
            along = widest(a, b, i, normal)
        worst, inside = max(worst, abs(along - d) / bound), inside + (d < 0)
        if d < bound:
            assert widest(a, b, i) <= d + bound
    assert worst <= 1, worst
    assert 5 < inside < 55


@pytest.mark.parametrize("dtype", [F32, F64])
def test_lines_that_are_nearly_parallel(dtype):
    """That cross at angles down to 1e-15: a determinant would leave them sqrt(eps) apart."""
    rng, n = np.random.default_rng(0), 60
    with jax.enable_x64(True):
        R = js.Rotation.exp(rng.normal(size=(n, 3)))
        angles = 10.0 ** -rng.uniform(0.5, 15, (n, 1))
        turned = R @ js.Rotation.exp(angles * np.array([[1.0, 0, 0]]))
        p = rng.normal(size=(n, 3))
        q = p + 0.3 * rng.uniform(-1, 1, (n, 1)) * np.asarray(R.to_matrix())[:, :, 2]
        entries = [np.asarray(x.entries).astype(dtype) for x in (R, turned)]
    a, b = (
        js.Capsule(np.zeros(n, dtype), np.full(n, 2, dtype), js.RigidTransform(js.Rotation(x), at.astype(dtype)))
        for x, at in zip(entries, (p, q), strict=True)
    )
    with jax.enable_x64(dtype == F64):
        found = interpreted(js.distance)(a, b)
    worst = max(abs(found[i] - reference(a, b, i)) for i in range(n))
    assert worst < 64 * np.finfo(dtype).eps / 2


def line(a, b):
    """(a, b) as a function of one number, along which all placements and sizes move."""
    leaves, structure = jax.tree.flatten((a, b))
    rng = np.random.default_rng(1)
    along = [rng.normal(size=(*x.shape[:-1], 3) if x.shape[-1] == 9 else x.shape) for x in leaves]

    def moved(s):
        numbers = [
            (js.Rotation.exp(s * y) @ js.Rotation(x)).entries if x.shape[-1] == 9 else x + s * y
            for x, y in zip(leaves, along, strict=True)
        ]
        return jax.tree.unflatten(structure, numbers)

    return moved


# A box beside a capsule is a capsule beside a box.
SLOW = PAIRS[2], *OF_CYLINDERS
each_of_all = of_pairs(*(x for x in PAIRS if x not in SLOW), *(pytest.param(x, marks=pytest.mark.slow) for x in SLOW))


@each_of_all
def test_derivatives_are_differences(kinds):
    """By placements and sizes: first and second derivatives, of distances, and of closest points where they are one."""
    with jax.enable_x64(True):
        a, b = made(kinds, F64, 12, seed=3)
        moved = line(a, b)

        def of(s):
            return js.closest_points(*moved(s))

        def slope(s):
            return jax.jvp(lambda s: of(s).distance, (s,), (1.0,))[1]

        h = 1e-6
        found = interpreted(lambda s: (slope(s), jax.jvp(slope, (s,), (1.0,))[1], jax.jvp(of, (s,), (1.0,))[1]))(0.0)
        first, second, points = found
        ahead, behind = interpreted(of)(h), interpreted(of)(-h)
        np.testing.assert_allclose(first, (ahead.distance - behind.distance) / (2 * h), rtol=0, atol=1e-7)
        difference = (interpreted(slope)(h) - interpreted(slope)(-h)) / (2 * h)
        np.testing.assert_allclose(second, difference, rtol=0, atol=1e-5 * max(1, abs(second).max()))
        for own, x, y in zip(points[1:], ahead[1:], behind[1:], strict=True):
            np.testing.assert_allclose(own, (x - y) / (2 * h), rtol=0, atol=1e-5 * max(1, abs(own).max()))
        backward = interpreted(jax.grad(lambda s: of(s).distance.sum()))(0.0)
        np.testing.assert_allclose(backward, first.sum(), rtol=1e-9, atol=1e-9)


@each_of_all
def test_derivatives_are_finite_everywhere(kinds):
    with jax.enable_x64(True):
        a, b = made(kinds, F64, 60, alike=True, seed=5)
        gradient = interpreted(jax.grad(lambda pair: js.distance(*pair).sum()))((a, b))
        again = interpreted(
            lambda a, b: jax.jvp(
                jax.grad(lambda pair: js.distance(*pair).sum()), ((a, b),), (jax.tree.map(jnp.ones_like, (a, b)),)
            )[1]
        )(a, b)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(gradient))
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(again))


@of_pairs(OF_CYLINDERS[0], pytest.param(OF_CYLINDERS[1], marks=pytest.mark.slow))
def test_slopes_of_cylinders_are_differences(kinds):
    """By placements and sizes: apart and inside one another."""
    with jax.enable_x64(True):
        a, b = made(kinds, F64, 40, seed=3, spread=0.3)
        moved = line(a, b)

        def of(s):
            return js.distance(*moved(s))

        h = 1e-6
        value, slope = interpreted(lambda s: jax.jvp(of, (s,), (1.0,)))(0.0)
        ahead, behind = interpreted(of)(h), interpreted(of)(-h)
    assert 5 < (value < 0).sum() < 35
    np.testing.assert_allclose(slope, (ahead - behind) / (2 * h), rtol=0, atol=1e-7)


def test_directions_where_there_is_a_choice():
    """Lines that cross, and that lie in one another; boxes with one centre."""
    about_x = placed([[np.pi / 2, 0, 0]], [[0.0, 0, 0]], F64)
    same = placed([[0.0, 0, 0]], [[0.0, 0, 0]], F64)
    with jax.enable_x64(True):
        long = functools.partial(js.Capsule, np.array([0.1]), np.array([1.0]))
        crossed = interpreted(js.closest_points)(long(same), long(about_x))
        np.testing.assert_allclose(crossed.distance, [-0.2], rtol=1e-14)
        np.testing.assert_allclose(abs(crossed.normal), [[1, 0, 0]], rtol=0, atol=1e-15)
        within = interpreted(js.closest_points)(long(same), long(same))
        np.testing.assert_allclose(within.distance, [-0.2], rtol=1e-14)
        np.testing.assert_array_equal(within.normal, [[1, 0, 0]])
        boxes = interpreted(js.closest_points)(js.Box(np.array([[1.0, 2, 3]]), same), js.Box(np.ones((1, 3)), same))
        np.testing.assert_allclose(boxes.distance, [-1.0], rtol=1e-14)
        np.testing.assert_array_equal(abs(boxes.normal), [[1, 0, 0]])


@pytest.mark.parametrize("kind", [js.Capsule, js.Box, js.Cylinder, js.HalfSpace, js.Stairs, js.Sphere])
def test_a_ball_is_beside_any_shape(kind):
    """As far as its centre, less its radius; and either way around."""
    with jax.enable_x64(True):
        n, rng = 20, np.random.default_rng(0)
        X, Y = poses(2, n, 0.8, F64)
        shape = {
            js.Capsule: lambda: js.Capsule(0.2, 0.8, Y),
            js.Box: lambda: js.Box([0.4, 0.6, 0.8], Y),
            js.Cylinder: lambda: js.Cylinder(0.3, 0.8, Y),
            js.HalfSpace: lambda: js.HalfSpace([0.3, 0.4, 1.2], 0.2),
            js.Stairs: lambda: js.Stairs(3, 0.3, 0.2),
            js.Sphere: lambda: js.Sphere(0.3, Y),
        }[kind]()
        ball = js.Sphere(rng.uniform(0.05, 0.3, n), X)
        found = interpreted(js.closest_points)(ball, shape)
        expected = interpreted(shape)(X.translation) - ball.radius
        np.testing.assert_allclose(found.distance, expected, rtol=0, atol=1e-15)
        np.testing.assert_allclose(interpreted(shape)(found.point_b), 0, rtol=0, atol=1e-14)
        np.testing.assert_allclose(
            found.point_b - found.point_a, found.distance[:, None] * found.normal, rtol=0, atol=1e-14
        )
        np.testing.assert_allclose(interpreted(ball)(found.point_a), 0, rtol=0, atol=1e-14)
        back = interpreted(js.closest_points)(shape, ball)
        if kind is not js.Sphere:
            np.testing.assert_array_equal(back.normal, -found.normal)
        np.testing.assert_allclose(back.distance, found.distance, rtol=0, atol=1e-15)
        np.testing.assert_allclose(back.point_a, found.point_b, rtol=0, atol=1e-15)


def test_batches_of_some_numbers_alone():
    """Of radii beside one place, of places beside one size."""
    radii, X = np.float32([0.1, 0.2]), placed(np.zeros((2, 3)), [[0, 0, 1], [0, 0, 2]], F32)
    far = js.Capsule(np.float32(0.1), np.float32(1), placed([0, 0, 0.0], [3, 0, 0], F32))
    for a, b in (
        (js.Sphere(radii), js.HalfSpace(np.float32([0, 0, 1]), np.float32(-1))),
        (js.Sphere(np.float32(0.1)), js.Box(np.float32([1, 1, 1]), X)),
        (js.Capsule(radii, np.float32(1)), js.HalfSpace(np.float32([0, 0, 1]), np.float32(-1))),
        (js.Capsule(radii, np.float32(1)), far),
        (js.Box(np.float32([1, 1, 1]), X), far),
        (js.Box(np.float32([[1, 1, 1], [2, 2, 2]])), js.Box(np.float32([1, 1, 1]), X)),
        (js.Cylinder(radii, np.float32(1)), far),
    ):
        found = interpreted(js.closest_points)(a, b)
        assert [x.shape for x in found] == [(2,), (2, 3), (2, 3), (2, 3)]
        for k in range(2):
            one = [jax.tree.map(lambda x, k=k: x[k] if x.shape[:1] == (2,) else x, s) for s in (a, b)]
            own = interpreted(js.closest_points)(*one)
            for x, y in zip(found, own, strict=True):
                np.testing.assert_array_equal(x[k], y)


def test_over_a_half_space():
    """The deepest corner of a box, and the deepest end of a capsule."""
    with jax.enable_x64(True):
        X, _ = poses(1, 30, 0.5, F64)
        ground = js.HalfSpace(np.array([0.3, 0.4, 1.2]), 0.2)
        n = np.array([0.3, 0.4, 1.2]) / 1.3
        R, p = np.asarray(X.rotation.to_matrix()), np.asarray(X.translation)
        box = interpreted(js.closest_points)(js.Box([0.4, 0.6, 0.8], X), ground)
        corners = np.array(list(itertools.product(*([-x / 2, x / 2] for x in (0.4, 0.6, 0.8)))))
        expected = ((p[:, None] + np.einsum("nij,kj->nki", R, corners)) @ n - 0.2).min(1)
        np.testing.assert_allclose(box.distance, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(box.point_a @ n - 0.2, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(box.normal, -np.broadcast_to(n, (30, 3)), rtol=0, atol=1e-15)
        capsule = interpreted(js.distance)(ground, js.Capsule(0.1, 0.8, X))
        ends = (p[:, None] + np.einsum("ni,k->nki", R[:, :, 2], np.array([-0.4, 0.4]))) @ n - 0.2
        np.testing.assert_allclose(capsule, ends.min(1) - 0.1, rtol=0, atol=1e-14)
        cylinder = interpreted(js.closest_points)(js.Cylinder(0.2, 0.8, X), ground)
        local = np.einsum("nij,i->nj", R, n)
        expected = p @ n - 0.2 - 0.2 * np.hypot(*local[:, :2].T) - 0.4 * abs(local[:, 2])
        np.testing.assert_allclose(cylinder.distance, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(cylinder.point_a @ n - 0.2, expected, rtol=0, atol=1e-14)
        np.testing.assert_allclose(interpreted(js.Cylinder(0.2, 0.8, X))(cylinder.point_a), 0, rtol=0, atol=1e-14)
        # Upright, any point of the rim is the deepest.
        floor = js.HalfSpace(np.array([0.0, 0, 1]), 0.0)

        def above(z):
            X = js.RigidTransform(js.Rotation.identity((), F64), jnp.zeros(3).at[2].set(z))
            return js.distance(js.Cylinder(0.2, 0.8, X), floor)

        np.testing.assert_allclose(jax.grad(above)(0.7), 1, rtol=1e-15)


@pytest.mark.slow
def test_programs_have_the_bits_of_the_formulas():
    a, b = made((js.Box, js.Box), F32, 7)
    compiled = jax.jit(jax.vmap(lambda a, b: js.distance(a, b)))(a, b)
    np.testing.assert_array_equal(compiled, interpreted(js.distance)(a, b))


def test_all_pairs_of_the_capsules_of_a_robot():
    """In a batch of states, compiled: with the bits of the formulas."""
    mech = js.testing.random_mechanism(0, n=4, dtype=np.float32)
    frames, (i, j) = mech.body_names, np.triu_indices(4, 1)
    radii, lengths = np.full(4, 0.05, F32), np.full(4, 0.3, F32)

    def of_pairs(q):
        links = js.Capsule(radii, lengths, js.forward_kinematics(mech, q, frames))
        return js.distance(*(jax.tree.map(lambda x, k=k: x[k], links) for k in (i, j)))

    q = jax.vmap(lambda key: js.random_configuration(mech, key))(jax.random.split(jax.random.key(0), 3))
    found = jax.jit(jax.vmap(of_pairs))(q)
    assert found.shape == (3, 6)
    np.testing.assert_array_equal(found[1], interpreted(of_pairs)(q[1]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: js.distance(js.Sphere(1.0), 3), "distance: b: expected a shape, such as js.Capsule, got int"),
        (
            lambda: js.distance(js.Cylinder(1.0, 1.0), js.Cylinder(1.0, 1.0)),
            "no two Cylinders, got Cylinder and Cylinder; take a Capsule for one, or the distances of its points$",
        ),
        (lambda: js.distance(js.Box([1.0, 1, 1]), js.Stairs(3, 0.3, 0.2)), "expected a Sphere, .* got Box and Stairs$"),
        (lambda: js.closest_points(js.HalfSpace(), js.HalfSpace()), "got HalfSpace and HalfSpace"),
        (lambda: js.distance(js.Sphere(np.float32(1)), js.Sphere(np.float16(1))), "a and b: expected one dtype"),
    ],
)
def test_what_is_refused(make, message):
    with pytest.raises(TypeError, match=message):
        make()
