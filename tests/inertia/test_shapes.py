"""Bodies of uniform density: textbook formulas over fractions, each within its bound, and what they degenerate to.

In NumPy (`interpreted`); `test_vmap_and_jit_are_the_batch_bitwise` holds the bits of compiled programs.
"""

import functools
import math
import re
from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia
from jaxspatial.inertia.shapes import CENTRAL, DETERMINANT, MASS, TETRAHEDRON_COM
from jaxspatial.measure.error import Sized, attribute, rationals, sized
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.operation import violations
from tests.helpers.soon import compiled_as_for_users

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


def made(name, kind, amount, lengths, axis, **precision):
    """What the constructor makes of lengths (n, *batch)."""
    positional = [jnp.stack(lengths, -1)] if name in ("solid_box", "solid_ellipsoid") else list(lengths)
    with_axis = [*positional, *([axis] if SHAPES[name][1] else [])]
    return getattr(SpatialInertia, name)(*with_axis, **{kind: amount}, **precision)


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
        for precision in precisions:
            formula = functools.partial(made, name, kind, precision=precision)
            M = evaluated(precision, formula)(amount, list(lengths), axis)
            assert (M.mass.dtype, M.central.dtype, M.mass.shape, M.central.shape) == (dtype, dtype, (24,), (24, 6))
            as_promised = "compensated" if precision == "faithful" else precision
            assert not violations(MASS, as_promised, M.mass, masses).any(), precision
            assert not violations(CENTRAL, as_promised, M.central, centrals).any(), precision


@shapes
def test_origin_is_the_centre_of_mass(name):
    amount, lengths, axis = inputs(name, "float64", hostile=False)
    with jax.enable_x64(True):
        M = interpreted(functools.partial(made, name, "mass"))(amount, list(lengths), axis)
        assert interpreted(SpatialInertia.is_physically_valid)(M).all()
        if name == "solid_cylinder_about_end":
            ends = M.com - lengths[1][:, None] / 2 * axis / np.linalg.norm(axis, axis=-1, keepdims=True)
            assert abs(ends).max() < 4 * np.finfo(float).eps * lengths[1].max()
        else:
            assert not M.com.any()
            found = []
            jax.make_jaxpr(lambda *x: found.append(made(name, "mass", *x)))(amount, list(lengths), axis)
            assert isinstance(found[0].com, np.ndarray)


@pytest.mark.parametrize("precision", ["reproducible", "compensated"])
def test_capsule_without_length_is_a_ball_and_without_radius_a_rod(precision):
    rng = np.random.default_rng(0)
    x, mass = np.abs(rng.standard_normal((2, 20))).astype(np.float32)
    axis, zero = rng.standard_normal((20, 3)).astype(np.float32), np.zeros(20, np.float32)

    def bodies(x, zero, axis, mass):
        kind = {"mass": mass, "precision": precision}
        capsule, ball = SpatialInertia.solid_capsule, SpatialInertia.solid_sphere(x, **kind)
        yield from (capsule(x, zero, axis, **kind), ball, capsule(x, zero, **kind), ball)
        yield from (capsule(zero, x, axis, **kind), SpatialInertia.thin_rod(x, axis, **kind))
        yield capsule(zero, zero, axis, **kind)
        by_density = {"density": mass, "precision": precision}
        yield from (capsule(x, zero, **by_density), SpatialInertia.solid_sphere(x, **by_density))

    turned, ball, along_z, _, rod, thin, point, *by_density = interpreted(lambda *x: list(bodies(*x)))(
        x, zero, axis, mass
    )
    np.testing.assert_allclose(turned.central, ball.central, rtol=2e-7, atol=0)
    np.testing.assert_array_equal(along_z.central, ball.central)
    np.testing.assert_array_equal(rod.central, thin.central)
    assert not point.central.any()
    np.testing.assert_array_equal(*(M.mass for M in by_density))


def test_capsule_is_a_cylinder_and_two_half_balls():
    """Drake's third way: parts put together. A half ball is 83/320 m r^2 about its own centre of mass, 3/8 r off."""
    r, h, rho = 0.5, 1.5, 1000.0
    half = np.diag([83 / 320, 83 / 320, 2 / 5])

    def both():
        middle, m = SpatialInertia.solid_cylinder(r, h, density=rho), rho * math.pi * r**3 * 2 / 3
        ends = [SpatialInertia(m, [0.0, 0.0, s * (h / 2 + 3 * r / 8)], m * r * r * half) for s in (1, -1)]
        return middle + ends[0] + ends[1], SpatialInertia.solid_capsule(r, h, density=rho)

    with jax.enable_x64(True):
        whole, M = interpreted(both)()
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
            kind = {"precision": precision}
            M, D = interpreted(
                lambda v, kind=kind: (
                    SpatialInertia.solid_tetrahedron(v, mass=1.0, **kind),
                    SpatialInertia.solid_tetrahedron(v[:, ::-1], density=2.0, **kind),
                )
            )(vertices)
            errors = [abs(rationals(M.central[:, n]) - central[:, i, j]) for n, (i, j) in enumerate(six)]
            assert (np.max(errors, axis=0) <= (k + Fraction(1, 100)) * u * moment).all()
            of_com = abs(rationals(M.com) - v.mean(-2)).max(-1)
            assert (of_com <= TETRAHEDRON_COM.allowed("reproducible", u, abs(v).max((-1, -2)))).all()
            size = abs(edges[:, 0, :, None, None] * edges[:, 1, None, :, None] * edges[:, 2, None, None, :])
            of_mass = abs(rationals(D.mass) - 2 * volume)
            assert (of_mass <= DETERMINANT.allowed(precision, u, size.sum((-1, -2, -3)) / 3, 2 * volume)).all()


def test_point_mass():
    M = SpatialInertia.point_mass([1.0, 2.0, 3.0], mass=jnp.asarray([1.0, 3.0]))
    assert isinstance(M.central, np.ndarray) and not M.central.any()
    assert M.batch_shape == (2,) and M.com.shape == (2, 3)
    moved = interpreted(lambda M: js.shift(M, [1.0, 2.0, 3.0]))(M)
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
    few, many = (len(re.findall("jaxspatial_(?!kept|sum|difference)", str(x))) for x in (program, oblique))
    assert few < 10 < many


def test_derivatives():
    def central(r, h, axis, m):
        return SpatialInertia.solid_cylinder(r, h, axis, mass=m).central

    with jax.enable_x64(True):
        given = np.array(0.3), np.array(0.7), np.array([0.1, -2.0, 0.4]), np.array(1.7)
        jacobians = interpreted(jax.jacrev(central, argnums=(0, 1, 2, 3)))(*given)
        for i, (x, jacobian) in enumerate(zip(given, jacobians, strict=True)):
            direction, step = np.random.default_rng(i).standard_normal(x.shape), 1e-6
            ends = [interpreted(central)(*given[:i], x + s * step * direction, *given[i + 1 :]) for s in (1, -1)]
            slope = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(np.tensordot(jacobian, direction, x.ndim), slope, atol=1e-9)
        by_density = interpreted(jax.grad(lambda r: SpatialInertia.solid_sphere(r, density=1.0).mass))(0.3)
        np.testing.assert_allclose(by_density, 4 * math.pi * 0.09, rtol=1e-15)


def test_double_words():
    """Carried at twice the precision: nothing is rounded to one word."""

    @interpreted
    def ball(r):
        third = js.to_double_word(r) / 3
        return third, SpatialInertia.solid_sphere(third, mass=js.to_double_word(jnp.ones(2, jnp.float32)))

    r, M = ball(np.float32([0.1, 3.0]))
    exact = (rationals(r.hi) + rationals(r.lo)) ** 2 * Fraction(2, 5)
    found = rationals(M.central.hi[:, 0]) + rationals(M.central.lo[:, 0])
    assert (abs(found - exact) <= Fraction(32, 2**48) * exact).all()


@compiled_as_for_users()
def test_vmap_and_jit_are_the_batch_bitwise():
    amount, lengths, axis = inputs("solid_capsule", "float32")
    formula = functools.partial(made, "solid_capsule", "density")
    mapped = jax.jit(jax.vmap(formula))(amount, list(lengths), axis)
    found = interpreted(formula)(amount, list(lengths), axis)
    chex.assert_trees_all_equal(found, jax.tree.map(np.asarray, mapped))


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


_BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 20.0 - 10
_SIDES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4)]
_SIDES = np.array([*_SIDES, (1, 5, 7), (1, 7, 3)])
# The largest length is 10, along x where it has a direction.
OVERFLOWING = {
    "solid_box": ([[1.0, 10.0, 1.0]], "mass"),
    "solid_cube": ([10.0], "mass"),
    "solid_sphere": ([10.0], "mass"),
    "hollow_sphere": ([10.0], "density"),
    "solid_ellipsoid": ([[1.0, 2.0, 10.0]], "density"),
    "solid_cylinder": ([10.0, 10.0], "mass"),
    "solid_cylinder_about_end": ([1.0, 10.0, [1.0, 2.0, 0.0]], "mass"),
    "hollow_cylinder": ([1.0, 10.0, 1.0], "mass"),
    "solid_capsule": ([10.0, 0.0], "density"),
    "solid_cone": ([1.0, 10.0], "mass"),
    "thin_rod": ([10.0], "mass"),
    "solid_tetrahedron": (np.eye(4, 3)[None] * 10, "mass"),
    "triangle_mesh": ([_BOX, _SIDES], "mass"),
}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", OVERFLOWING)
def test_known_numbers_with_which_moments_overflow_are_refused(name, dtype):
    """Amounts of half the largest number, which the dtype has. Of NaN, and of arrays of JAX, nothing is said."""
    given, kind = OVERFLOWING[name]
    given = [np.asarray(x, None if x is _SIDES else dtype) for x in given]
    amount = np.asarray(jnp.finfo(dtype).max / 2, dtype)
    with jax.enable_x64(dtype == "float64"):
        make = getattr(SpatialInertia, name)
        with pytest.raises(ValueError, match=f"^{name}: expected mass and moments with terms of at most .* in {dtype}"):
            make(*given, **{kind: amount})
        assert np.isfinite(make(*given, **{kind: amount / 10**8}).central).all()
        assert not np.isfinite(make(*given, **{kind: amount * np.nan}).central).all()


def test_moments_of_data_overflow_in_silence():
    M = interpreted(lambda m: SpatialInertia.solid_sphere(10.0, mass=m))(np.float32(3e38))
    assert np.isinf(M.central[0]) and not interpreted(SpatialInertia.is_physically_valid)(M)
    M = SpatialInertia(np.float32(3e38), np.float32([10, 0, 0]), np.eye(3, dtype=np.float32))
    assert np.isfinite(M.central).all() and np.isinf(interpreted(SpatialInertia.inertia_about_origin)(M)).any()
    M = interpreted(SpatialInertia.from_origin)(*M._parts)
    assert not interpreted(SpatialInertia.is_physically_valid)(M)


def test_axis_of_no_length_gives_nan_and_of_any_other_none():
    axes = np.float32([[0, 0, 0], [1e-30, 0, 2e-30], [0, 3e30, 1e30]])
    M = interpreted(lambda axes: SpatialInertia.thin_rod(jnp.ones(3), axes, mass=jnp.ones(3)))(axes)
    assert np.isnan(M.central[0]).all() and np.isfinite(M.central[1:]).all()
    assert attribute(sized(np.ones(1)), "value")[0] == 1
