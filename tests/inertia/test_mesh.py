"""What closed meshes enclose: against boxes, tetrahedra and exact sums, near and far, thin and flat, and their sums.

In NumPy (`interpreted`); `test_batches_and_transformations` holds the bits of compiled programs.
"""

import functools
from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia
from jaxspatial.inertia.composition import sums_over_items
from jaxspatial.inertia.shapes import MESH_CENTRAL, MESH_COM, MESH_VOLUME
from jaxspatial.measure.error import rationals, unit_roundoff
from jaxspatial.numerics.formula import formula
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow
from tests.helpers.soon import compiled_as_for_users

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
BOX = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5], [2, 3, 7], [2, 7, 6], [0, 6, 4], [0, 2, 6],
     [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
PAIRS = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]


def of_mesh(vertices, faces, precision="reproducible", **amount):
    formula = functools.partial(SpatialInertia.triangle_mesh, triangles=faces, precision=precision, **amount)
    return evaluated(precision, formula)(vertices)


def globe(rng, levels=3, roughness=0.0):
    """An octahedron, refined, on a sphere of radius 1, with bumps."""
    points = [tuple(s * x for x in row) for row in np.eye(3) for s in (1.0, -1.0)]
    faces = [(a, b, c) for a in (0, 1) for b in (2, 3) for c in (4, 5)]
    faces = [f if np.linalg.det([points[i] for i in f]) > 0 else f[::-1] for f in faces]
    for _ in range(levels):
        middles, refined = {}, []
        for a, b, c in faces:
            ab, bc, ca = (_middle(points, middles, *pair) for pair in ((a, b), (b, c), (c, a)))
            refined += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        faces = refined
    points = np.array(points)
    points = points / np.linalg.norm(points, axis=-1, keepdims=True)
    return points * (1 + roughness * rng.uniform(-1, 1, (len(points), 1))), np.array(faces)


def _middle(points, middles, a, b):
    key = frozenset((a, b))
    if key not in middles:
        middles[key] = len(points)
        points.append(tuple((x + y) / 2 for x, y in zip(points[a], points[b], strict=True)))
    return middles[key]


def exactly(vertices, faces):
    """(volume, com, central per unit density as 6) over fractions, from tetrahedra at the origin; and S, r."""
    a, b, c = (rationals(vertices)[faces[:, i]] for i in range(3))
    d = (a * np.cross(b, c)).sum(-1)
    volume = d.sum() / 6
    s = a + b + c
    com = (d[:, None] * s).sum(0) / 24 / volume
    second = sum(
        (d[:, None, None] * x[:, :, None] * x[:, None, :]).sum(0) for x in (s, a, b, c)
    ) / 120 - volume * np.outer(com, com)
    central = np.trace(second) * np.eye(3, dtype=int) - second
    return volume, com, np.array([central[i, j] for i, j in PAIRS]), *sizes(np.asarray(vertices, float), faces)


def sizes(vertices, faces):
    """S and r of the docstring."""
    used = vertices[faces.ravel()]
    seen = vertices - (used.min(0) / 2 + used.max(0) / 2)
    a, b, c = (seen[faces[:, i]] for i in range(3))
    norms = (np.linalg.norm(x, axis=-1) for x in (a, b - a, c - a))
    return Fraction(float(np.prod(list(norms), axis=0).sum())), Fraction(float(np.linalg.norm(seen, axis=-1).max()))


def check(vertices, faces, precision, density=2.0, M=None):
    """M: what was found, if it was."""
    volume, com, central, S, r = exactly(vertices, faces)
    M = of_mesh(vertices, faces, precision, density=density) if M is None else M
    assert M.central.dtype == vertices.dtype
    u, n = unit_roundoff(vertices.dtype), len(faces)
    narrow = u if precision in ("fast", "reproducible") else MESH_VOLUME.u2 * u * u
    rho, size = Fraction(density), S / volume
    once = 0 if narrow == u else u
    errors = {
        "mass": (abs(rationals(M.mass) - rho * volume), narrow * MESH_VOLUME.factor(n) * rho * S + once * rho * volume),
        "com": (abs(rationals(M.com) - com).max(), u * abs(com).max() + narrow * MESH_COM.factor(n) * r * size),
        "central": (
            abs(rationals(M.central) - rho * central).max(),
            narrow * MESH_CENTRAL.factor(n) * rho * volume * r * r * size + once * rho * abs(central).max(),
        ),
    }
    for name, (error, allowed) in errors.items():
        assert error <= allowed, (name, precision, float(error), float(allowed))


def hostile(dtype):
    """Meshes: a globe with bumps, also far away; a rod, a plate, an oblique needle; one off its own middle."""
    rng = np.random.default_rng(1)
    points, faces = globe(rng, 2, 0.3)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    far = 1e3 if dtype == "float32" else 1e8
    return {
        "globe": (points, faces),
        "far": (points + far, faces),
        "rod": (points * [1e-3, 1e-3, 10], faces),
        "plate": (points * [10, 10, 1e-4], faces),
        "needle": ((points * [1e-2, 1e-2, 1]) @ turn.T, faces),
        "tiny": (points * 1e-6, faces),
        "lopsided": (np.where(points > 0, points * 100, points), faces),
    }


@pytest.mark.parametrize("precision", [slow("fast"), "reproducible", "compensated"])
@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_bound_of_the_docstring(dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        for points, faces in hostile(dtype).values():
            check(points.astype(dtype), faces, precision)


def test_bound_of_one_triangle():
    """Of the tetrahedron that it makes with its middle, the origin: nothing is summed over triangles. Known, it is
    refused, as it encloses nothing."""
    rng = np.random.default_rng(8)
    some = np.stack([np.full((300, 3), -1.0), np.full((300, 3), 1.0), rng.uniform(-1, 1, (300, 3))], 1)
    corners, face = rng.permuted(some, axis=1).astype(np.float32), np.array([[0, 1, 2]])
    M = of_mesh(corners, jnp.asarray(face), density=2.0)
    for i in np.flatnonzero(M.mass > 0.1):
        check(corners[i], face, "reproducible", M=jax.tree.map(lambda x, i=i: x[i], M))


def test_box_is_a_box():
    size = np.array([0.5, 2.0, 3.0])
    for dtype in ("float16", "bfloat16", "float32"):
        M = SpatialInertia.triangle_mesh((CORNERS * size).astype(jnp.dtype(dtype)), BOX, density=2.0)
        B = interpreted(lambda size: SpatialInertia.solid_box(size, density=2.0))(size.astype(jnp.dtype(dtype)))
        eps = float(jnp.finfo(dtype).eps)
        assert isinstance(M.central, np.ndarray) and not np.asarray(M.com, float).any()
        for x, y in zip(jax.tree.leaves(M), jax.tree.leaves(B), strict=True):
            np.testing.assert_allclose(np.asarray(x, float), np.asarray(y, float), rtol=2 * eps, atol=2 * eps)


def test_far_away_nothing_is_lost():
    """A cube of 64 m at 2^27 m, where float32 knows every 8 m: bitwise the central inertia of the cube at home."""
    near = (CORNERS * 64).astype(np.float32)
    M, F = (of_mesh(x, BOX, mass=3.0) for x in (near, near + np.float32(2**27)))
    np.testing.assert_array_equal(M.central, F.central)
    np.testing.assert_array_equal(F.com, np.full(3, 2.0**27))
    np.testing.assert_allclose(M.central[0], 3 * 64**2 / 6, rtol=2e-7)


def test_tetrahedron_and_moved_globe():
    with jax.enable_x64(True):
        rng = np.random.default_rng(2)
        v = rng.standard_normal((4, 3))
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        faces = faces if np.linalg.det(v[1:] - v[0]) > 0 else faces[:, ::-1]
        T = interpreted(lambda v: SpatialInertia.solid_tetrahedron(v, density=2.0))(v)
        chex.assert_trees_all_close(of_mesh(v, faces, density=2.0), T, rtol=1e-7, atol=1e-14)
        points, faces = globe(rng, 2, 0.3)

        @interpreted
        def moved(w, p, M, points):
            X = js.RigidTransform(js.Rotation.exp(w), p)
            return js.act(X, M), X @ points

        M = of_mesh(points, faces, mass=1.5)
        expected, there = moved(np.array([0.3, -1.0, 2.0]), np.array([3.0, 4.0, 5.0]), M, points)
        found = of_mesh(there, faces, mass=1.5)
        chex.assert_trees_all_close(found, expected, rtol=1e-7, atol=32 * np.finfo(float).eps)
        fine = of_mesh(*globe(rng, 4), mass=1.0)
        np.testing.assert_allclose(fine.central[0], 2 / 5, rtol=1e-2)
        assert interpreted(SpatialInertia.is_physically_valid)(fine)


def test_no_volume_gives_nan():
    for faces in (BOX[:, ::-1], np.concatenate([BOX, BOX[:, ::-1]])):
        M = of_mesh(CORNERS.astype(np.float32), faces, density=1.0)
        assert all(np.isnan(x).all() for x in jax.tree.leaves(M))
        M = of_mesh(CORNERS.astype(np.float32), faces, mass=1.0)
        assert float(M.mass) == 1 and np.isnan(M.com).all() and np.isnan(M.central).all()


def test_derivatives_in_the_vertices():
    """Of a box that grows along x, which all is known about; against central differences over fractions elsewhere."""
    with jax.enable_x64(True):
        growing = CORNERS * [1, 0, 0], CORNERS

        def of_length(x):
            M = SpatialInertia.triangle_mesh(growing[1] + (x - 1) * growing[0] + x, BOX, density=1.0)
            return jnp.concatenate([M.mass[None], M.com, M.central])

        slope = interpreted(jax.jacfwd(of_length))(2.0)
        np.testing.assert_allclose(slope, [1, 1, 1, 1, 1 / 6, 0, 13 / 12, 0, 0, 13 / 12], atol=1e-14)
        points, faces = globe(np.random.default_rng(4), 1, 0.2)
        direction = np.random.default_rng(5).standard_normal(points.shape)
        weights = np.random.default_rng(6).standard_normal(6)

        def energy(v):
            return (SpatialInertia.triangle_mesh(v, faces, density=1.0).central * weights).sum()

        gradient = interpreted(jax.grad(energy))(points)
        step = Fraction(1, 10**9)
        ends = [exactly_moved(points, direction, s * step, faces) @ rationals(weights) for s in (1, -1)]
        np.testing.assert_allclose((gradient * direction).sum(), float((ends[0] - ends[1]) / (2 * step)), rtol=1e-12)


def exactly_moved(points, direction, step, faces):
    a, b, c = ((rationals(points) + step * rationals(direction))[faces[:, i]] for i in range(3))
    d, s = (a * np.cross(b, c)).sum(-1), a + b + c
    com = (d[:, None] * s).sum(0) / 4 / d.sum()
    second = sum((d[:, None, None] * x[:, :, None] * x[:, None, :]).sum(0) for x in (s, a, b, c)) / 120
    second = second - d.sum() / 6 * np.outer(com, com)
    central = np.trace(second) * np.eye(3, dtype=int) - second
    return np.array([central[i, j] for i, j in PAIRS])


@pytest.mark.slow
@compiled_as_for_users()
def test_batches_and_transformations():
    rng = np.random.default_rng(7)
    points, faces = globe(rng, 1, 0.2)
    many = (points + 0.01 * rng.standard_normal((3, 2, *points.shape))).astype(np.float32)
    density = np.float32([1.0, 2.0])

    def one(v, rho):
        return SpatialInertia.triangle_mesh(v, faces, density=rho)

    M = interpreted(one)(many, density)
    assert M.batch_shape == (3, 2)
    mapped = jax.jit(jax.vmap(jax.vmap(one), (0, None)))(many, density)
    chex.assert_trees_all_equal(M, jax.tree.map(np.asarray, mapped))


BAD = {
    "shape": (ValueError, r"expected shape \(m, 3\) with m >= 1, got \(3,\)", np.array([0, 1, 2])),
    "none": (ValueError, r"expected shape \(m, 3\) with m >= 1, got \(0, 3\)", np.zeros((0, 3), int)),
    "floats": (TypeError, "expected integers, got float64", np.zeros((4, 3))),
    "range": (ValueError, "expected indices from 0 to 7, got 0 to 8", BOX + 1 - (BOX == 0)),
    "open": (ValueError, "expected a closed surface: .*; none runs from vertex [013] to [013]$", BOX[1:]),
    "a triangle that is turned over": (ValueError, "expected a closed surface", np.vstack([BOX[:-1], BOX[-1:, ::-1]])),
    "a triangle twice": (ValueError, "expected a closed surface", np.vstack([BOX, BOX[:1]])),
    "three faces of a tetrahedron": (ValueError, "expected a closed", np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2]])),
}


@pytest.mark.parametrize(("kind", "message", "faces"), BAD.values(), ids=BAD)
def test_triangles_that_are_refused(kind, message, faces):
    with pytest.raises(kind, match="triangle_mesh: triangles: " + message):
        SpatialInertia.triangle_mesh(CORNERS.astype(np.float32), faces, mass=1.0)


def test_vertices_at_one_place_are_one_where_they_are_known():
    """Files for printers list three vertices for each triangle. Where these are data, nobody can tell."""
    corners = CORNERS.astype(np.float32)
    apart, count = corners[BOX].reshape(-1, 3), np.arange(36).reshape(12, 3)
    known = SpatialInertia.triangle_mesh(apart, count, mass=1.0)
    chex.assert_trees_all_close(known, SpatialInertia.triangle_mesh(corners, BOX, mass=1.0), rtol=1e-6, atol=1e-7)
    with pytest.raises(ValueError, match="expected a closed surface"):
        of_mesh(apart, count, mass=1.0)
    flat = np.float32([[0, 0, 0], [1, 0, 0], [-0.0, 1, 0], [0, 0, 1], [0, -0.0, 0]])
    SpatialInertia.triangle_mesh(flat, np.array([[0, 2, 1], [4, 1, 3], [0, 3, 2], [1, 2, 3]]), mass=1.0)
    # A triangle that is but an edge closes itself.
    SpatialInertia.triangle_mesh(corners, np.vstack([BOX, [[0, 0, 5]]]), mass=1.0)


def test_triangles_that_are_data_of_known_vertices():
    corners = CORNERS.astype(np.float32)

    def mass(faces):
        return SpatialInertia.triangle_mesh(corners, faces, density=1.0).mass

    assert float(jax.jit(mass)(BOX)) == float(mass(BOX))


# -- sums -------------------------------------------------------------------------------------------------------------


@formula
def _summed(x, size):
    return [sums_over_items(x, size)]


@pytest.mark.parametrize(
    ("precision", "n"),
    [(precision, n) for precision in ("reproducible", "compensated") for n in (1, 2, 7)]
    + [("reproducible", 1000), slow("compensated", 1000)],
)
def test_sums_by_halving(n, precision):
    with jax.enable_x64(True):
        rng = np.random.default_rng(n)
        x = rng.standard_normal((2, n, 2)) * 10 ** rng.uniform(-8, 8, (2, n, 2))
        (total,) = interpreted(functools.partial(_summed, precision, size=n))(x)
        exact, mag = rationals(x).sum(1), abs(rationals(x)).sum(1)
        u, rounds = unit_roundoff(np.float64), int(np.ceil(np.log2(n)))
        allowed = u * rounds * mag if precision == "reproducible" else u * abs(exact) + 3 * u * u * rounds * mag
        assert (abs(rationals(total[:, 0]) - exact) <= allowed).all()


def test_a_known_zero_stays_known_in_a_sum():
    found = []

    @formula
    def both(known, data, size):
        sums = sums_over_items((*known, *data), size)
        found.extend(isinstance(x.value, np.generic) for x in sums)
        return [sums]

    known = np.array([[0.0, 2.0]] * 3, np.float32)
    program = jax.jit(lambda x: both(None, known, x, size=3)[0])
    np.testing.assert_array_equal(program(jnp.ones((3, 1)))[0], [0, 6, 3])
    assert found == [True, False, False]
