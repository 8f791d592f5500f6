"""Bodies of uniform density: textbook formulas over fractions, each within its bound, and what they degenerate to."""

import math
from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia
from jaxspatial.inertia.promises import DETERMINANT, TETRAHEDRON_COM
from jaxspatial.inertia.promises import SHAPE_CENTRAL as CENTRAL
from jaxspatial.inertia.promises import SHAPE_MASS as MASS
from jaxspatial.measure.exact import Sized, attribute, rationals, sized
from tests.helpers.marks import slow, slow_but
from tests.helpers.operations import violations

PI = Sized(Fraction("3.14159265358979323846264338327950288419716939937510582097494459"))


def number(a, b=1):
    return Sized(Fraction(a, b))


def diagonal(m, xx, yy, zz):
    return [m * x for x in (xx, number(0), yy, number(0), number(0), zz)]


def about(m, along, across, n):
    """along u u^T + across (1 - u u^T), u = n / |n|: six entries."""
    squared = n[0] * n[0] + n[1] * n[1] + n[2] * n[2]
    x, y, z = (c * c / squared for c in n)
    off = [m * (along - across) * (n[i] * n[j] / squared) for i, j in ((0, 1), (0, 2), (1, 2))]
    xx, yy, zz = (m * (along * a + across * (b + c)) for a, b, c in ((x, y, z), (y, z, x), (z, x, y)))
    return [xx, off[0], yy, off[1], off[2], zz]


def box(x, y, z):
    return diagonal(number(1, 12), y * y + z * z, z * z + x * x, x * x + y * y)


def ellipsoid(a, b, c):
    return diagonal(number(1, 5), b * b + c * c, c * c + a * a, a * a + b * b)


def cylinder(r, h, p=None):
    """(along, across), of a tube with inner radius p."""
    squares = r * r if p is None else r * r + p * p
    return squares / number(2), squares / number(4) + h * h / number(12)


def capsule(r, h):
    whole = h + r * number(4, 3)
    between, ends = h / whole, r * number(4, 3) / whole
    along = between * r * r / number(2) + ends * r * r * number(2, 5)
    distances = r * r * number(2, 5) + h * h / number(4) + h * r * number(3, 8)
    return along, between * (h * h / number(12) + r * r / number(4)) + ends * distances


def cone(r, h):
    return r * r * number(3, 10), r * r * number(3, 20) + h * h * number(3, 80)


# Of each: how many lengths, whether it has an axis, its volume, and its unit inertia: six entries, or (along, across).
SHAPES = {
    "solid_box": (3, False, lambda x, y, z: x * y * z, box),
    "solid_cube": (1, False, lambda x: x * x * x, lambda x: box(x, x, x)),
    "solid_sphere": (1, False, lambda r: PI * r * r * r * number(4, 3), lambda r: ellipsoid(r, r, r)),
    "hollow_sphere": (1, False, lambda r: PI * r * r * number(4), lambda r: diagonal(number(2, 3), *[r * r] * 3)),
    "solid_ellipsoid": (3, False, lambda a, b, c: PI * a * b * c * number(4, 3), ellipsoid),
    "solid_cylinder": (2, True, lambda r, h: PI * r * r * h, cylinder),
    "solid_cylinder_about_end": (2, True, lambda r, h: PI * r * r * h, cylinder),
    "hollow_cylinder": (3, True, lambda p, q, h: PI * (q - p) * (q + p) * h, lambda p, q, h: cylinder(q, h, p)),
    "solid_capsule": (2, True, lambda r, h: PI * r * r * (h + r * number(4, 3)), capsule),
    "solid_cone": (2, True, lambda r, h: PI * r * r * h / number(3), cone),
    "thin_rod": (1, True, None, lambda h: (number(0), h * h / number(12))),
}
shapes = pytest.mark.parametrize("name", SHAPES)


def arguments(name, lengths, axis, **amount):
    """What the constructor takes, of lengths (n, *batch)."""
    positional = [jnp.stack(lengths, -1)] if name in ("solid_box", "solid_ellipsoid") else list(lengths)
    return [*positional, *([axis] if SHAPES[name][1] else [])], amount


def expected(name, kind, amount, lengths, axis):
    """(masses, central inertias) as `Sized`."""
    _, has_axis, volume, unit = SHAPES[name]
    masses, centrals = [], []
    for a, x, n in zip(sized(amount), sized(np.stack(lengths, -1)), sized(axis), strict=True):
        m = a if kind == "mass" else a * volume(*x)
        six = about(m, *unit(*x), n) if has_axis else [m * entry for entry in unit(*x)]
        masses.append(m)
        centrals.append(six)
    return np.array(masses, object), np.array(centrals, object)


def inputs(name, dtype, hostile=True):
    """Amounts, lengths and axes: rods and plates, axes of any length, amounts over many decades."""
    rng, n = np.random.default_rng(3), SHAPES[name][0]
    decades = 0.5 if not hostile else 1.0 if dtype == "float16" else 3.0
    amount = 10 ** rng.uniform(*((-20, 20) if hostile and dtype != "float16" else (-0.5, 0.5)), 24)
    lengths = np.abs(10 ** rng.uniform(-decades, decades, (n, 24)))
    axis = rng.standard_normal((24, 3)) * 10 ** rng.uniform(-decades, decades, (24, 1))
    axis[:3] = [[0, 0, 1], [0, -2, 0], [3, 0, 0]]
    if name == "hollow_cylinder":
        lengths[1] = lengths[0] * (1 + np.abs(rng.standard_normal(24)))
    return [x.astype(jnp.dtype(dtype)) for x in (amount, lengths, axis)]


# Double words compile for longer: the longest formula stands for all.
CASES = [
    *((name, dtype, "mass", ("reproducible",)) for name in SHAPES for dtype in ("float16", "float64")),
    *((name, "float32", "mass", ("reproducible", "compensated")) for name in SHAPES),
    *((name, "float32", "density", ("reproducible",)) for name in SHAPES if SHAPES[name][2]),
    ("solid_capsule", "bfloat16", "density", ("fast", "reproducible")),
    ("solid_capsule", "float64", "density", ("fast", "compensated", "faithful")),
]


USUAL = [case for case in CASES if case[1] == "float32" or case[0] == "solid_capsule" and case[1] != "float64"]


@pytest.mark.parametrize(("name", "dtype", "kind", "precisions"), slow_but(USUAL, CASES))
def test_textbook_formula_within_the_bound(name, dtype, kind, precisions):
    amount, lengths, axis = inputs(name, dtype)
    masses, centrals = expected(name, kind, amount, lengths, axis)
    with jax.enable_x64(dtype == "float64"):
        data = [jnp.asarray(amount), [jnp.asarray(x) for x in lengths], jnp.asarray(axis)]
        for precision in precisions:
            positional, named = arguments(name, data[1], data[2], **{kind: data[0]})
            M = getattr(SpatialInertia, name)(*positional, **named, precision=precision)
            assert (M.mass.dtype, M.central.dtype, M.mass.shape, M.central.shape) == (dtype, dtype, (24,), (24, 6))
            as_promised = "compensated" if precision == "faithful" else precision
            assert not violations(MASS, as_promised, M.mass, masses).any(), precision
            assert not violations(CENTRAL, as_promised, M.central, centrals).any(), precision


@shapes
def test_origin_is_the_centre_of_mass(name):
    amount, lengths, axis = inputs(name, "float64", hostile=False)
    with jax.enable_x64(True):
        positional, named = arguments(name, list(lengths), axis, mass=amount)
        M = getattr(SpatialInertia, name)(*positional, **named)
        assert np.asarray(M.is_physically_valid()).all()
        if name == "solid_cylinder_about_end":
            ends = M.com - lengths[1][:, None] / 2 * axis / np.linalg.norm(axis, axis=-1, keepdims=True)
            assert abs(ends).max() < 4 * np.finfo(float).eps * lengths[1].max()
        else:
            assert isinstance(M.com, np.ndarray) and not M.com.any()


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_capsule_without_length_is_a_ball_and_without_radius_a_rod(precision):
    rng = np.random.default_rng(0)
    x, mass = (jnp.asarray(np.abs(rng.standard_normal(20)), jnp.float32) for _ in range(2))
    axis, zero = jnp.asarray(rng.standard_normal((20, 3)), jnp.float32), jnp.zeros(20)
    kind = {"mass": mass, "precision": precision}
    ball, rod = SpatialInertia.solid_capsule(x, zero, axis, **kind), SpatialInertia.solid_capsule(zero, x, axis, **kind)
    np.testing.assert_allclose(ball.central, SpatialInertia.solid_sphere(x, **kind).central, rtol=2e-7, atol=0)
    np.testing.assert_array_equal(rod.central, SpatialInertia.thin_rod(x, axis, **kind).central)
    along_z = SpatialInertia.solid_capsule(x, zero, **kind)
    np.testing.assert_array_equal(along_z.central, SpatialInertia.solid_sphere(x, **kind).central)
    point = SpatialInertia.solid_capsule(zero, zero, axis, **kind)
    assert not np.asarray(point.central).any()
    by_density = [
        getattr(SpatialInertia, name)(*given, density=mass, precision=precision).mass
        for name, given in (("solid_capsule", (x, zero)), ("solid_sphere", (x,)))
    ]
    np.testing.assert_array_equal(*by_density)


def test_capsule_is_a_cylinder_and_two_half_balls():
    """Drake's third way: parts put together. A half ball is 83/320 m r^2 about its own centre of mass, 3/8 r off."""
    with jax.enable_x64(True):
        r, h, rho = 0.5, 1.5, 1000.0
        M = SpatialInertia.solid_capsule(r, h, density=rho)
        middle = SpatialInertia.solid_cylinder(r, h, density=rho)
        m = rho * math.pi * r**3 * 2 / 3
        half = [[83 / 320, 0, 0], [0, 83 / 320, 0], [0, 0, 2 / 5]]
        ends = [SpatialInertia(m, [0.0, 0.0, s * (h / 2 + 3 * r / 8)], m * r * r * np.array(half)) for s in (1, -1)]
        whole = middle + ends[0] + ends[1]
        np.testing.assert_allclose(whole.central, M.central, rtol=8 * np.finfo(float).eps)
        np.testing.assert_allclose(whole.mass, M.mass, rtol=4 * np.finfo(float).eps)


@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_tetrahedron(dtype):
    """By its definition over fractions: m/20 (sum of (v - com)(v - com)^T), however far away and flat it is."""
    rng = np.random.default_rng(5)
    shape = rng.standard_normal((30, 4, 3)) * 10 ** rng.uniform(-4, 0, (30, 1, 3))
    vertices = (shape + 10 ** rng.uniform(-2, 3, (30, 1, 1)) * rng.standard_normal((30, 1, 3))).astype(dtype)
    v, six = rationals(vertices), [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]
    arms = v - v.sum(-2, keepdims=True) / 4
    second = (arms[..., :, None] * arms[..., None, :]).sum(-3) / 20
    central = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3, dtype=int) - second
    edges = v[:, 1:] - v[:, :1]
    volume = abs((edges[:, 0] * np.cross(edges[:, 1], edges[:, 2])).sum(-1)) / 6
    moment = np.array([[abs(e) for e in row] for row in central.reshape(30, 9)]).max(-1)
    with jax.enable_x64(dtype == "float64"):
        u = Fraction(float(jnp.finfo(dtype).eps)) / 2
        for precision, k in (("reproducible", CENTRAL.u), ("compensated", 1)):
            M = SpatialInertia.solid_tetrahedron(jnp.asarray(vertices), mass=1.0, precision=precision)
            errors = [abs(rationals(M.central[:, n]) - central[:, i, j]) for n, (i, j) in enumerate(six)]
            assert (np.max(errors, axis=0) <= (k + Fraction(1, 100)) * u * moment).all()
            assert (
                abs(rationals(M.com) - v.mean(-2)).max(-1) <= int(TETRAHEDRON_COM.u) * u * abs(v).max((-1, -2))
            ).all()
            D = SpatialInertia.solid_tetrahedron(jnp.asarray(vertices[:, ::-1]), density=2.0, precision=precision)
            size = abs(edges[:, 0, :, None, None] * edges[:, 1, None, :, None] * edges[:, 2, None, None, :])
            assert (abs(rationals(D.mass) - 2 * volume) <= int(DETERMINANT.u) * u * size.sum((-1, -2, -3)) / 3).all()


def test_point_mass():
    M = SpatialInertia.point_mass([1.0, 2.0, 3.0], mass=jnp.asarray([1.0, 3.0]))
    assert isinstance(M.central, np.ndarray) and not M.central.any()
    assert M.batch_shape == (2,) and M.com.shape == (2, 3)
    moved = js.shift(M, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(moved.com, np.zeros((2, 3)))


def test_what_is_known_stays_known_while_tracing():
    found = {}

    def traced(x):
        found["sphere"] = SpatialInertia.solid_sphere(0.5, density=1000.0)
        found["capsule"] = SpatialInertia.solid_capsule(np.full(4, 0.5, np.float32), 1.5, (0, 0, 1), mass=np.float32(2))
        found["box"] = SpatialInertia.solid_box([1, 2, 3], mass=x)
        return x

    for transform in (jax.jit, jax.vmap, jax.grad):
        argument = jnp.ones(3) if transform is jax.vmap else jnp.asarray(1.0)
        transform(traced)(argument)
        assert all(isinstance(x, np.ndarray) for name in ("sphere", "capsule") for x in jax.tree.leaves(found[name]))
        assert isinstance(found["box"].com, np.ndarray) and isinstance(found["box"].central, jax.core.Tracer)
    assert found["capsule"].batch_shape == (4,)
    program = jax.make_jaxpr(lambda r: SpatialInertia.solid_cylinder(r, 1.0, mass=1.0).central)(0.5)
    oblique = jax.make_jaxpr(lambda r: SpatialInertia.solid_cylinder(r, 1.0, (1, 2, 3), mass=1.0).central)(0.5)
    assert str(program).count("jaxspatial_") < 10 < str(oblique).count("jaxspatial_")


def test_derivatives():
    def central(r, h, axis, m):
        return SpatialInertia.solid_cylinder(r, h, axis, mass=m).central

    with jax.enable_x64(True):
        given = jnp.asarray(0.3), jnp.asarray(0.7), jnp.asarray([0.1, -2.0, 0.4]), jnp.asarray(1.7)
        jacobians = jax.jit(jax.jacrev(central, argnums=(0, 1, 2, 3)))(*given)
        for i, (x, jacobian) in enumerate(zip(given, jacobians, strict=True)):
            direction, step = np.random.default_rng(i).standard_normal(x.shape), 1e-6
            ends = [central(*given[:i], x + s * step * direction, *given[i + 1 :]) for s in (1, -1)]
            slope = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(np.tensordot(jacobian, direction, x.ndim), slope, atol=1e-9)
        by_density = jax.grad(lambda r: SpatialInertia.solid_sphere(r, density=1.0).mass)(jnp.asarray(0.3))
        np.testing.assert_allclose(by_density, 4 * math.pi * 0.09, rtol=1e-15)


def test_double_words():
    """Carried at twice the precision: nothing is rounded to one word."""
    r = js.to_double_word(jnp.asarray([0.1, 3.0], jnp.float32)) / 3
    M = SpatialInertia.solid_sphere(r, mass=js.to_double_word(jnp.ones(2, jnp.float32)))
    exact = (rationals(r.hi) + rationals(r.lo)) ** 2 * Fraction(2, 5)
    found = rationals(M.central.hi[:, 0]) + rationals(M.central.lo[:, 0])
    assert (abs(found - exact) <= Fraction(32, 2**48) * exact).all()


def test_vmap_and_jit_are_the_batch_bitwise():
    amount, lengths, axis = inputs("solid_capsule", "float32")
    M = SpatialInertia.solid_capsule(*map(jnp.asarray, lengths), jnp.asarray(axis), density=jnp.asarray(amount))
    one = jax.jit(jax.vmap(lambda r, h, n, rho: SpatialInertia.solid_capsule(r, h, n, density=rho)))
    mapped = one(*map(jnp.asarray, lengths), jnp.asarray(axis), jnp.asarray(amount))
    chex.assert_trees_all_equal(M, mapped)


BAD = {
    "both": (TypeError, "solid_sphere: expected either mass or density, got both", {"mass": 1.0, "density": 1.0}),
    "neither": (TypeError, "solid_sphere: expected either mass or density, got neither", {}),
    "negative mass": (ValueError, "solid_sphere: mass: expected no negative number, got -1.0", {"mass": -1.0}),
    "negative density": (ValueError, "solid_sphere: density: expected no negative", {"density": np.float32(-1)}),
    "string": (TypeError, "solid_sphere: mass: expected an array of floating point", {"mass": "heavy"}),
}


@pytest.mark.parametrize(("kind", "message", "amount"), BAD.values(), ids=BAD)
def test_amounts_that_are_refused(kind, message, amount):
    with pytest.raises(kind, match=message):
        SpatialInertia.solid_sphere(0.5, **amount)


@pytest.mark.parametrize("bad", [0, -0.5, np.float32(-1), np.array([1.0, 0.0])], ids=str)
def test_lengths_that_are_refused(bad):
    lengths = {"solid_sphere": ["radius"], "solid_cone": ["radius", "height"], "thin_rod": ["length"]}
    for name, names in lengths.items():
        for i, key in enumerate(names):
            given = [bad if i == j else 1.0 for j in range(len(names))]
            with pytest.raises(ValueError, match=f"{name}: {key}: expected a positive number"):
                getattr(SpatialInertia, name)(*given, mass=1.0)
    with pytest.raises(ValueError, match="solid_box: size: expected a positive number"):
        SpatialInertia.solid_box([1.0, float(np.min(bad)), 1.0], mass=1.0)


def test_other_arguments_that_are_refused():
    with pytest.raises(ValueError, match="solid_capsule: radius: expected no negative number"):
        SpatialInertia.solid_capsule(-0.1, 1.0, mass=1.0)
    with pytest.raises(ValueError, match="hollow_cylinder: inner_radius: expected at most outer_radius"):
        SpatialInertia.hollow_cylinder(2.0, 1.0, 1.0, mass=1.0)
    with pytest.raises(ValueError, match=r"solid_box: size: expected shape \(\*batch, 3\), got \(2,\)"):
        SpatialInertia.solid_box([1.0, 2.0], mass=1.0)
    with pytest.raises(ValueError, match=r"solid_tetrahedron: vertices: expected shape \(\*batch, 4, 3\)"):
        SpatialInertia.solid_tetrahedron(np.ones((3, 3)), mass=1.0)
    with pytest.raises(TypeError, match="expected one dtype"):
        SpatialInertia.solid_sphere(jnp.ones(2), mass=jnp.ones(2, jnp.float16))
    # What may be traced is not looked at.
    assert float(jax.jit(lambda r: SpatialInertia.solid_sphere(r, mass=-1.0 * r).mass)(-2.0)) == 2.0


def test_axis_of_no_length_gives_nan_and_of_any_other_none():
    axes = jnp.asarray([[0, 0, 0], [1e-30, 0, 2e-30], [0, 3e30, 1e30]], jnp.float32)
    M = SpatialInertia.thin_rod(jnp.ones(3), axes, mass=jnp.ones(3))
    assert np.isnan(M.central[0]).all() and np.isfinite(M.central[1:]).all()
    assert attribute(sized(np.ones(1)), "value")[0] == 1
