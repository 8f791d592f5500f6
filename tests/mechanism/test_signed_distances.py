"""Shapes: distances held to exact arithmetic, normals to derivatives, kinks to what docstrings say of them."""

import functools
import itertools

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


# -- references: independent of the formulas, in 60 digits ------------------------------------------------------------


def exact(x):
    return [mpmath.mpf(float(c)) for c in np.ravel(x)]


def local(p, placement):
    """p_SP_S with the entries of the matrix as they are."""
    p = exact(p)
    if placement is None:
        return p
    R, t = exact(placement.rotation.entries), exact(placement.translation)
    return [sum(R[3 * i + k] * (p[i] - t[i]) for i in range(3)) for k in range(3)]


def length(*x):
    return mpmath.sqrt(sum(c * c for c in x))


def to_segment(p, a, b):
    """The distance from a line between two points, of any number of coordinates."""
    d = [y - x for x, y in zip(a, b, strict=True)]
    square = sum(c * c for c in d)
    t = sum((x - y) * c for x, y, c in zip(p, a, d, strict=True)) / square if square else mpmath.mpf(0)
    t = min(max(t, 0), 1)
    return length(*(x - y - t * c for x, y, c in zip(p, a, d, strict=True)))


def outline(p, corners, is_inside):
    """The signed distance from a closed or open line of corners."""
    least = min(to_segment(p, a, b) for a, b in zip(corners, corners[1:], strict=False))
    return -least if is_inside else least


def of_sphere(shape, p):
    return length(*p) - exact(shape.radius)[0]


def of_capsule(shape, p):
    half = exact(shape.length)[0] / 2
    return to_segment(p, [0, 0, -half], [0, 0, half]) - exact(shape.radius)[0]


def of_box(shape, p):
    half = [x / 2 for x in exact(shape.size)]
    if all(abs(x) <= b for x, b in zip(p, half, strict=True)):
        return -min(abs(s * b - x) for x, b in zip(p, half, strict=True) for s in (-1, 1))
    return length(*(x - min(max(x, -b), b) for x, b in zip(p, half, strict=True)))


def of_cylinder(shape, p):
    r, half = exact(shape.radius)[0], exact(shape.length)[0] / 2
    rho, z = length(*p[:2]), p[2]
    return outline([rho, z], [[0, half], [r, half], [r, -half], [0, -half]], rho <= r and abs(z) <= half)


def of_stairs(shape, p):
    run, rise = exact(shape.run)[0], exact(shape.rise)[0]
    x, _, z = p
    far = abs(x) + abs(z) + shape.steps * (run + rise) + 1
    corners = [[-far, 0], [0, 0]]
    for k in range(shape.steps):
        corners += [[k * run, (k + 1) * rise], [(k + 1) * run, (k + 1) * rise]]
    corners[-1] = [far, shape.steps * rise]
    height = max([mpmath.mpf(0)] + [(k + 1) * rise for k in range(shape.steps) if x >= k * run])
    return outline([x, z], corners, z <= height)


REFERENCES = {
    js.Sphere: of_sphere, js.Capsule: of_capsule, js.Box: of_box, js.Cylinder: of_cylinder, js.Stairs: of_stairs,
}  # fmt: skip


def size_of(shape):
    if isinstance(shape, js.Stairs):
        return float(shape.steps * (shape.run + shape.rise))
    return float(sum(np.sum(getattr(shape, k)) for k in shape._axes))


# -- cases ------------------------------------------------------------------------------------------------------------


def placement(dtype):
    rng = np.random.default_rng(4)
    with jax.enable_x64(True):
        R = js.Rotation.exp(rng.normal(size=3))
    return js.RigidTransform(R.astype(dtype), rng.normal(size=3).astype(dtype))


def shapes(dtype, X=None):
    return [
        js.Sphere(dtype.type(0.3), X),
        js.Sphere(dtype.type(0.0), X),
        js.Capsule(dtype.type(0.2), dtype.type(0.7), X),
        js.Capsule(dtype.type(0.2), dtype.type(0.0), X),
        js.Box(np.array([0.4, 0.7, 1.1], dtype), X),
        js.Box(np.array([0.4, 0.0, 1e4], dtype), X),
        js.Cylinder(dtype.type(0.3), dtype.type(1.1), X),
        js.Cylinder(dtype.type(0.9), dtype.type(0.1), X),
        js.Stairs(3, dtype.type(0.31), dtype.type(0.17), X),
        js.Stairs(1, dtype.type(0.1), dtype.type(0.9), X),
    ]


def hostile(shape, dtype):
    """Points on and beside centres, axes, faces, edges and corners, near and far, and random ones."""
    rng = np.random.default_rng(1)
    numbers = [np.ravel(getattr(shape, k)) for k in shape._axes]
    marks = sorted({0.0, *(float(s * x * m) for n in numbers for x in n for m in (0.5, 1) for s in (-1, 1))})
    grid = np.array(list(itertools.product(marks, marks[:3] + [0.0], marks)))
    beside = grid + rng.normal(size=grid.shape) * np.exp2(rng.integers(-30, 0, grid.shape))
    many = rng.normal(size=(60, 3)) * np.exp2(rng.integers(-20, 12, (60, 1)))
    p = np.concatenate([grid, np.nextafter(grid.astype(dtype), np.inf).astype(float), beside, many])
    if len(p) > 240:
        p = p[rng.permutation(len(p))[:240]]
    if shape.placement is not None:
        p = p @ np.asarray(shape.placement.rotation.to_matrix(), float).T + np.asarray(shape.placement.translation)
    return p.astype(dtype)


CASES = [
    pytest.param(F32, False, "reproducible"),
    pytest.param(F64, True, "reproducible"),
    pytest.param(F32, True, "compensated"),
    *(slow(F32, True, x) for x in ("reproducible", "fast", "faithful")),
    *(slow(F64, True, x) for x in ("fast", "compensated")),
]


@pytest.mark.parametrize(("dtype", "is_placed", "precision"), CASES)
@pytest.mark.parametrize("which", range(10))
def test_distances_are_within_their_bounds(which, dtype, is_placed, precision):
    with jax.enable_x64(dtype == F64):
        X = placement(dtype) if is_placed else None
        shape = shapes(dtype, X)[which]
        p = hostile(shape, dtype)
        found = interpreted(functools.partial(shape.normals_and_distances, precision))(p)[1]
    assert found.dtype == dtype
    u, t = float(np.finfo(dtype).eps) / 2, 0.0 if X is None else np.linalg.norm(X.translation)
    size = size_of(shape)
    is_precise = precision in ("compensated", "faithful") and not isinstance(shape, js.Stairs)
    worst = 0.0
    for own, at in zip(found, p, strict=True):
        r = REFERENCES[type(shape)](shape, local(at, X))
        scale = float(np.linalg.norm(at.astype(float))) + t + size
        bound = 1.01 * u * abs(r) + 256 * u**2 * scale if is_precise else 16 * u * scale
        bound += 8 * float(np.finfo(dtype).tiny)
        worst = max(worst, float(abs(mpmath.mpf(float(own)) - r) / bound))
    assert worst <= 1, worst


def derivatives(shape, p):
    """(the normals, the distances, the gradients of the distances, second derivatives) at points (n, 3)."""

    def of(p):
        return shape.normals_and_distances(None, p)

    normals, distances = of(p)
    gradients = jax.vmap(jax.grad(lambda x: of(x)[1]))(p)
    turning = jax.vmap(jax.jacfwd(lambda x: of(x)[0]))(p)
    return normals, distances, gradients, turning


@pytest.mark.parametrize("which", range(10))
def test_normals_are_gradients(which):
    """Everywhere, on kinks too: of unit length, and finite with all derivatives."""
    with jax.enable_x64(True):
        shape = shapes(F64, placement(F64))[which]
        p = hostile(shape, F64)
        normals, distances, gradients, turning = interpreted(functools.partial(derivatives, shape))(p)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1, rtol=0, atol=1e-15)
        np.testing.assert_allclose(gradients, normals, rtol=0, atol=2e-15)
        assert np.isfinite(turning).all()
        # A step along the normal is one of the distance, but where the surface is nearer on another side.
        ahead = interpreted(shape)(p + 1e-6 * normals) - distances
    assert np.mean(abs(ahead - 1e-6) < 1e-9) > 0.9


@pytest.mark.parametrize("which", range(10))
def test_numbers_of_shapes_are_differentiated(which):
    """By sizes and placements, against differences."""
    with jax.enable_x64(True):
        shape = jax.tree.map(jnp.asarray, shapes(F64, placement(F64))[which])
        p = np.random.default_rng(3).normal(size=(20, 3))
        leaves, structure = jax.tree.flatten(shape)
        rng = np.random.default_rng(5)
        along = [rng.normal(size=x.shape) for x in leaves]

        def of(s):
            moved = [x + s * a for x, a in zip(leaves, along, strict=True)]
            return jax.tree.unflatten(structure, moved)(p)

        h = 1e-6
        found = interpreted(lambda s: jax.jvp(of, (s,), (1.0,))[1])(0.0)
        expected = (interpreted(of)(h) - interpreted(of)(-h)) / (2 * h)
        backward = interpreted(jax.grad(lambda shape: shape(p).sum()))(shape)
        total = sum(float((a * b).sum()) for a, b in zip(along, jax.tree.leaves(backward), strict=True))
    # A size of 0 has a kink there.
    is_smooth = which not in (1, 3, 5)
    assert np.isfinite(found).all()
    if is_smooth:
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)
        np.testing.assert_allclose(total, expected.sum(), rtol=0, atol=1e-6)


KINKS = [
    (js.Sphere(0.3), (0, 0, 0), (0, 0, 1), -0.3),
    (js.Capsule(0.2, 1.0), (0, 0, 0.3), (1, 0, 0), -0.2),
    (js.Capsule(0.2, 1.0), (0, 0, 0.5), (1, 0, 0), -0.2),
    (js.Box([2.0, 2.0, 2.0]), (0, 0, 0), (1, 0, 0), -1),
    (js.Box([4.0, 2.0, 2.0]), (0, 0, 0), (0, 1, 0), -1),
    (js.Box([2.0, 2.0, 2.0]), (1, 1, 1), (1, 0, 0), 0),
    (js.Box([2.0, 2.0, 2.0]), (0.5, -1, 1), (0, -1, 0), 0),
    (js.Box([np.inf, 2.0, np.inf]), (7, 1.5, 3), (0, 1, 0), 0.5),
    (js.Cylinder(1.0, 8.0), (0, 0, 0), (1, 0, 0), -1),
    (js.Cylinder(8.0, 1.0), (0, 0, 0), (0, 0, 1), -0.5),
    (js.Stairs(2, 0.5, 0.25), (0, 0, 0.25), (0, 0, 1), 0),
    (js.Stairs(2, 0.5, 0.25), (0, 0, 0.125), (-1, 0, 0), 0),
    (js.Stairs(2, 0.5, 0.25), (0.25, 0, 0.25), (0, 0, 1), 0),
    (js.Stairs(2, 0.5, 0.25), (2.0, 0, 0.25), (0, 0, 1), -0.25),
    (js.Stairs(2, 0.5, 0.25), (0.5, 0, 0.125), (0, 0, 1), -0.125),
    (js.Union([js.HalfSpace(), js.Sphere(1.0)]), (0, 0, 3.0), (0, 0, 1), 2),
    (js.Union([js.HalfSpace(), js.Sphere(1.0)]), (3.0, 0, 3.5), (0, 0, 1), 3.5),
    (js.Union([js.HalfSpace(), js.HalfSpace([1.0, 0, 0])]), (1.0, 0, 1.0), (0, 0, 1), 1),
]


@pytest.mark.parametrize(("shape", "p", "normal", "distance"), KINKS, ids=lambda x: type(x).__name__)
def test_kinks_are_as_stated(shape, p, normal, distance):
    shape = shape.astype(F32)
    found = interpreted(lambda p: (*shape.normals_and_distances(None, p), jax.grad(shape)(p)))
    n, d, gradient = found(np.float32(p))
    np.testing.assert_allclose(n, normal, rtol=0, atol=1e-7)
    np.testing.assert_allclose(d, distance, rtol=1e-7, atol=0)
    np.testing.assert_allclose(gradient, normal, rtol=0, atol=2e-7)
    assert np.isnan(found(np.float32([np.nan, np.nan, np.nan]))[1])


# Shapes of sizes, and how many these are.
SIZED = {
    "Sphere": (lambda x: js.Sphere(x[0]), 1),
    "Capsule": (lambda x: js.Capsule(*x[:2]), 2),
    "Box": (js.Box, 3),
    "Cylinder": (lambda x: js.Cylinder(*x[:2]), 2),
    "Stairs": (lambda x: js.Stairs(2, *x[:2]), 2),
    "HalfSpace": (lambda x: js.HalfSpace([0.0, 0, 1], x[0]), 1),
}


@pytest.mark.parametrize(("make", "n"), SIZED.values(), ids=SIZED)
def test_a_size_that_is_none_gives_none(make, n):
    """And so does the height of a point that is, wherever the point is."""
    points, sizes = (
        np.float32([[0.1, 0.2, 0.3], [0, 0, 0], [3, 0, 0.1], [0.1, 0, 5], [0, 0.1, -5]]),
        np.float32([1] * 3),
    )
    assert np.isfinite(interpreted(make(sizes))(points)).all()
    for k in range(n):
        shape = make(np.where(np.arange(3) == k, np.float32(np.nan), sizes))
        assert np.isnan(interpreted(shape)(points)).all(), k
    points[:, 2] = np.nan
    assert np.isnan(interpreted(make(sizes))(points)).all()


def test_batches_of_shapes_and_points():
    """Of each item its own points, and each as on its own."""
    rng = np.random.default_rng(2)
    p = rng.normal(size=(3, 5, 3)).astype(F32)
    X = js.RigidTransform(js.Rotation.identity((3,), F32), rng.normal(size=(3, 3)).astype(F32))
    for many in (
        js.Sphere(np.float32([0.1, 0.2, 0.3])),
        js.Capsule(np.float32(0.1), np.float32([0.1, 0.2, 0.3]), X),
        js.Box(rng.uniform(0.1, 1, (3, 3)).astype(F32), X),
        js.Stairs(2, np.float32([0.1, 0.2, 0.3]), np.float32(0.1)),
        js.HalfSpace(rng.normal(size=(3, 3)).astype(F32), np.float32(0)),
        js.Union([js.Sphere(np.float32([0.1, 0.2, 0.3])), js.Capsule(np.float32(0.1), np.float32(0.9))]),
    ):
        assert many.batch_shape == (3,) and many.dtype == F32
        found = interpreted(lambda p, many=many: many.of_many_points().normals_and_distances(None, p))(p)
        for i in range(3):
            one = jax.tree.map(lambda x, i=i: x[i] if x.shape[:1] == (3,) else x, many)
            one = js.HalfSpace(many.normal[i], many.offset) if isinstance(many, js.HalfSpace) else one
            own = interpreted(functools.partial(one.normals_and_distances, None))(p[i])
            for a, b in zip(found, own, strict=True):
                np.testing.assert_array_equal(a[i], b)
    many = js.Box(rng.uniform(0.1, 1, (3, 3)).astype(F32))
    mapped = jax.vmap(lambda size, p: js.Box(size)(p))(many.size, p)
    np.testing.assert_array_equal(mapped, interpreted(lambda p: many.of_many_points()(p))(p))


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: js.Sphere(-1.0), ValueError, "Sphere: radius: expected numbers of at least 0, got -1.0"),
        (lambda: js.Sphere("big"), TypeError, "Sphere: radius: expected an array of floating point"),
        (lambda: js.Capsule(0.1, None), TypeError, "Capsule: length: expected numbers, got None"),
        (lambda: js.Box([1.0, 2.0]), ValueError, r"Box: size: expected shape \(\*batch, 3\), got \(2,\)"),
        (lambda: js.Box([1.0, 2.0, 3.0], np.eye(3)), TypeError, "Box: placement: expected a RigidTransform"),
        (lambda: js.Stairs(0, 0.3, 0.1), ValueError, "Stairs: steps: expected a whole number of at least 1, got 0"),
        (lambda: js.Stairs(2.0, 0.3, 0.1), ValueError, "Stairs: steps: expected a whole number .*, got 2.0"),
        (lambda: js.Union([]), ValueError, "Union: shapes: expected at least one, got none"),
        (lambda: js.Union([js.Sphere(1.0), 3]), TypeError, r"Union: shapes\[1\]: expected a shape.*, got int"),
        (
            lambda: js.Union([js.Sphere(np.float32(1)), js.Sphere(np.float16(1))]),
            TypeError,
            r"shapes\[0\] and shapes\[1\]: expected one dtype",
        ),
        (
            lambda: js.Capsule(np.ones(2, F32), np.ones(3, F32)),
            ValueError,
            "radius and length: expected batch shapes that broadcast",
        ),
        (lambda: js.Sphere(1.0)(np.zeros(2)), ValueError, r"Sphere: point: expected shape \(\*batch, 3\), got \(2,\)"),
        (
            lambda: js.Sphere(np.float32(1.0))(jnp.zeros(3, jnp.float16)),
            TypeError,
            "Sphere and point: expected one dtype",
        ),
    ],
)
def test_what_is_refused(make, error, message):
    with pytest.raises(error, match=message):
        make()


def test_whole_numbers_are_sizes_and_arrays_stay_what_they_are():
    assert js.Sphere(1).radius == 1.0 and js.Sphere(1).dtype == np.asarray(jnp.ones(())).dtype
    box = js.Box(np.float32([1, 2, 3]))
    assert isinstance(box.size, np.ndarray) and not box.size.flags.writeable
    assert jax.tree.structure(jax.tree.map(lambda _: 0, box)) == jax.tree.structure(js.Box(0))
    assert repr(js.Stairs(4, np.float32(0.5), np.float32(0.25))) == "Stairs(4, run=0.5, rise=0.25)"
    assert repr(js.Union([js.Sphere(np.float32(0.5))])) == "Union([Sphere(radius=0.5)])"


def test_a_shape_without_a_placement_leaves_no_turning_behind():
    """Nor one at a known place."""
    p = jnp.zeros(3, jnp.float32)

    def products(shape):
        return str(jax.make_jaxpr(lambda p: shape.normals_and_distances("fast", p))(p)).count(" mul ")

    size = np.float32([1, 2, 3])
    X = js.RigidTransform.identity((), F32)
    traced = jax.tree.map(jnp.asarray, X)
    assert products(js.Box(size)) == products(js.Box(size, X)) < products(js.Box(size, traced)) - 15
