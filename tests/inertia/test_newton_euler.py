"""The equations of motion of one body: against their definition, a sum over particles, and as linear in ten
parameters.

Evaluated in NumPy (`interpreted`); `test_batches_transformations_and_derivatives` holds the bits of compiled programs.
"""

from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia
from jaxspatial.inertia.newton_euler import NEWTON_EULER, newton_euler
from jaxspatial.inertia.regressors import (
    ENERGY_REGRESSOR,
    NEWTON_EULER_REGRESSOR,
    kinetic_energy_regressor,
    momentum_regressor,
    newton_euler_regressor,
)
from jaxspatial.measure.error import Sized, rationals, sized
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow, slow_but
from tests.helpers.operation import violations
from tests.helpers.soon import compiled_as_for_users

LOWER = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]
ZERO = Sized(Fraction(0))


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


def full(six):
    return np.array([[six[LOWER.index((max(i, k), min(i, k)))] for k in range(3)] for i in range(3)])


def naive(m, c, central, alpha, a, w):
    """(tau, f), of one item and numbers of any kind."""
    I = full(central)  # noqa: E741 - the letter of the textbooks
    f = (a + np.cross(alpha, c) + np.cross(w, np.cross(w, c))) * m
    return I.dot(alpha) + np.cross(w, I.dot(w)) + np.cross(c, f), f


def case(dtype, n=16):
    """Bodies and motions over as many decades as the format has: rods and plates, heavy and light, far and near."""
    rng = np.random.default_rng(0)
    decades = {"float16": 0.3, "bfloat16": 2.0, "float32": 2.0}.get(dtype, 8.0)
    spread = [10 ** rng.uniform(-decades, decades, (n, 1)) for _ in range(6)]
    L = rng.standard_normal((n, 3, 3)) * 10 ** rng.uniform(-decades, 0, (n, 1, 3))
    second = np.einsum("nij,nkj->nik", L, L)
    moments = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    central = np.stack([moments[:, i, k] for i, k in LOWER], -1)
    arrays = [np.exp(rng.standard_normal((n, 1))), rng.standard_normal((n, 3)), central]
    arrays += list(rng.standard_normal((3, n, 3)))
    arrays = [(x * s).astype(jnp.dtype(dtype)) for x, s in zip(arrays, spread, strict=True)]
    return arrays[0][:, 0], *arrays[1:]


def computed(arrays, precision):
    def force(m, c, central, alpha, a, w):
        return newton_euler(SpatialInertia(m, c, central), js.SpatialAcceleration(alpha, a), w, precision=precision)

    return evaluated(precision, force)(*arrays)


CASES = [
    *((dtype, p) for dtype in ("float32", "float64") for p in ("fast", "reproducible", "compensated")),
    ("float16", "reproducible"),
    ("bfloat16", "compensated"),
    ("float32", "faithful"),
]


USUAL = [("float32", "reproducible"), ("float32", "compensated"), ("float64", "compensated")]


@pytest.mark.parametrize(("dtype", "precision"), slow_but(USUAL, CASES))
def test_bound_of_the_docstring(dtype, precision):
    arrays = case(dtype)
    F = computed(arrays, precision)
    exact = [naive(*item) for item in zip(*map(sized, arrays), strict=True)]
    promised = "compensated" if precision == "faithful" else precision
    for part, expected in zip((F.tau, F.f), zip(*exact, strict=True), strict=True):
        assert part.dtype == dtype
        assert not violations(NEWTON_EULER, promised, part, np.array(expected, object)).any()


def test_a_body_is_its_particles():
    """By the definition: what accelerates each particle, and its moment about P; the inertia is theirs too."""
    rng = np.random.default_rng(1)
    masses, places = abs(rng.standard_normal(7)), rng.standard_normal((7, 3))
    alpha, a, w = rng.standard_normal((3, 3))
    m, c = masses.sum(), masses @ places / masses.sum()
    arms = places - c
    second = np.einsum("n,ni,nj->ij", masses, arms, arms)
    M = SpatialInertia(np.asarray(m), c, np.trace(second) * np.eye(3) - second)
    forces = masses[:, None] * (a + np.cross(alpha, places) + np.cross(w, np.cross(w, places)))
    V, A = js.SpatialVelocity(w, np.zeros(3)), js.SpatialAcceleration(alpha, a)
    F = interpreted(newton_euler)(M, A, V)
    np.testing.assert_allclose(F.f, forces.sum(0), atol=1e-13)
    np.testing.assert_allclose(F.tau, np.cross(places, forces).sum(0), atol=1e-13)

    def pairs(M, A, V, F, p):
        """The same about another point of the body, in another frame, and without a spin."""
        R = js.Rotation.exp(p)
        yield newton_euler(js.shift(M, p), js.shift(A, p, V.w), V.w), js.shift(F, p)
        yield newton_euler(R @ M, R @ A, R @ V.w), R @ F
        yield newton_euler(M, A, jnp.zeros(3)), M @ A

    for x, y in interpreted(lambda *scene: list(pairs(*scene)))(M, A, V, F, rng.standard_normal(3)):
        chex.assert_trees_all_close(x, y, rtol=0, atol=1e-13)


# -- linear in ten parameters -----------------------------------------------------------------------------------------


def parameters(m, c, central):
    """[m, m c, I about P] of fractions."""
    about = full(central) + m * ((c * c).sum() * np.eye(3, dtype=int) - np.outer(c, c))
    return np.array([m, *(m * c), *(about[i, k] for i, k in LOWER)])


def skew(x, zero=0):
    return np.array([[zero, -x[2], x[1]], [x[2], zero, -x[0]], [-x[1], x[0], zero]])


def moments(x, zero=0):
    return np.array([[x[0], x[1], zero, x[2], zero, zero], [zero, x[0], x[1], zero, x[2], zero],
                     [zero, zero, zero, x[0], x[1], x[2]]])  # fmt: skip


def naive_regressor(alpha, a, w):
    top = np.hstack([np.full((3, 1), ZERO), -skew(a, ZERO), moments(alpha, ZERO) + skew(w, ZERO).dot(moments(w, ZERO))])
    arm = skew(alpha, ZERO) + skew(w, ZERO).dot(skew(w, ZERO))
    return np.vstack([top, np.hstack([a[:, None], arm, np.full((3, 6), ZERO)])])


@pytest.mark.parametrize("precision", slow_but(["reproducible"], js.Precision))
def test_force_is_the_regressor_times_the_parameters(precision):
    """Exactly, over fractions, of small integers."""
    rng = np.random.default_rng(2)
    arrays = [rng.integers(-9, 10, shape).astype(float) for shape in ((5,), (5, 3), (5, 6), (5, 3), (5, 3), (5, 3))]
    m, c, central, alpha, a, w = arrays
    A, V = js.SpatialAcceleration(alpha, a), js.SpatialVelocity(w, a)
    M = SpatialInertia(m, c, central)
    pi = np.array([parameters(*item) for item in zip(rationals(m), rationals(c), rationals(central), strict=True)])
    kind = {"precision": precision}
    Y, momentum, energy, F = evaluated(
        precision,
        lambda M, A, V: (
            newton_euler_regressor(A, V, **kind),
            momentum_regressor(V, **kind),
            kinetic_energy_regressor(V, **kind),
            newton_euler(M, A, V, **kind).to_array(),
        ),
    )(M, A, V)
    ten, L, T = interpreted(lambda M, V: (M.to_dynamic_parameters(), (M @ V).to_array(), M.kinetic_energy(V)))(M, V)
    np.testing.assert_array_equal(pi.astype(float), ten)
    exact = np.array([np.concatenate(naive(*item)) for item in zip(*map(rationals, arrays), strict=True)])
    assert ((rationals(Y) * pi[:, None]).sum(-1) == exact).all()
    np.testing.assert_array_equal(F, exact.astype(float))
    np.testing.assert_array_equal((rationals(momentum) * pi[:, None]).sum(-1).astype(float), L)
    np.testing.assert_array_equal((rationals(energy) * pi).sum(-1).astype(float), T)


@pytest.mark.parametrize(
    ("dtype", "precision"),
    [slow("float32", "fast"), ("float32", "reproducible"), ("float32", "compensated"), ("float64", "compensated"),
     slow("float32", "faithful"), slow("bfloat16", "reproducible")],
)  # fmt: skip
def test_bounds_of_the_regressors(dtype, precision):
    *_, alpha, a, w = case(dtype, 6)
    Y, e = evaluated(
        precision,
        lambda A, V: (
            newton_euler_regressor(A, V, precision=precision),
            kinetic_energy_regressor(V, precision=precision),
        ),
    )(js.SpatialAcceleration(alpha, a), js.SpatialVelocity(w, a))
    exact = np.array([naive_regressor(*item) for item in zip(*map(sized, (alpha, a, w)), strict=True)])
    assert Y.shape == (6, 6, 10) and Y.dtype == dtype
    assert not violations(NEWTON_EULER_REGRESSOR, precision, Y, exact).any()
    assert not np.asarray(Y)[np.vectorize(lambda x: x is ZERO)(exact)].any()
    half = sized(np.array(0.5))[()]
    items = zip(sized(w), sized(a), strict=True)
    energies = [
        [half * (v * v).sum(), *np.cross(v, w), *(w[i] * w[k] * (half if i == k else sized(np.array(1.0))[()])
                                                   for i, k in LOWER)]
        for w, v in items
    ]  # fmt: skip
    assert not violations(ENERGY_REGRESSOR, precision, e, np.array(energies, object)).any()


# -- structure, transformations, messages -----------------------------------------------------------------------------


def test_what_is_known_leaves_no_operation():
    A, w = js.SpatialAcceleration(jnp.ones(3), jnp.ones(3)), jnp.ones(3)

    def count(M, *spin):
        program = jax.make_jaxpr(lambda A, *w: newton_euler(M, A, *(w or [np.zeros(3)])))(A, *spin)
        return str(program).count("jaxspatial_product")

    general = SpatialInertia(np.array(1.5), np.array([0.1, 0.2, 0.3]), np.array([5.0, 0.1, 6.0, 0.2, 0.3, 7.0]))
    centred = SpatialInertia.solid_box([1.0, 2.0, 3.0], mass=2.0)
    assert count(centred) == 6 < count(general) < count(general, w)
    assert count(centred, w) < count(general, w)
    assert count(SpatialInertia.point_mass([0.0, 0.0, 0.0], mass=1.0), w) == 0


@compiled_as_for_users()
def test_batches_transformations_and_derivatives():
    """Compiled for one item and mapped, the bits of NumPy; what is shared by a batch broadcasts; the force is linear in
    the acceleration."""
    arrays = case("float32", 5)

    def force(m, c, central, alpha, a, w):
        F = newton_euler(SpatialInertia(m, c, central), js.SpatialAcceleration(alpha, a), w)
        return F.to_array(), newton_euler_regressor(js.SpatialAcceleration(alpha, a), w)

    whole = interpreted(force)(*arrays)
    for x, y in zip(whole, jax.jit(jax.vmap(force))(*arrays), strict=True):
        np.testing.assert_array_equal(x, y)
    shared = interpreted(force)(arrays[0][0], arrays[1][0], arrays[2][0], *arrays[3:])[0]
    assert shared.shape == (5, 6)
    np.testing.assert_array_equal(shared[0], whole[0][0])
    m, c, central, alpha, a, w = (x[0] for x in case("float64"))
    slope = interpreted(jax.jacrev(lambda a: force(m, c, central, alpha, a, w)[0]))(a)
    np.testing.assert_allclose(slope[3:], m * np.eye(3), atol=1e-15 * m)
    np.testing.assert_allclose(slope[:3], m * skew(c), atol=1e-15 * m * abs(c).max())


def test_double_words_are_carried():
    arrays = case("float32", 3)

    def force(*arrays):
        m, c, central, alpha, a, w = map(js.to_double_word, arrays)
        return newton_euler(SpatialInertia(m, c, central), js.SpatialAcceleration(alpha, a), w)

    F = interpreted(force)(*arrays)
    exact = [naive(*item) for item in zip(*map(sized, arrays), strict=True)]
    for part, expected in zip((F.tau, F.f), zip(*exact, strict=True), strict=True):
        for x, y in zip((rationals(part.hi) + rationals(part.lo)).ravel(), np.array(expected).ravel(), strict=True):
            assert abs(x - y.value) <= 48 * Fraction(1, 2**48) * y.mag


def test_messages():
    M, A, V = SpatialInertia.solid_sphere(1.0, mass=1.0), js.SpatialAcceleration.zero(), js.SpatialVelocity.zero()
    with pytest.raises(TypeError, match="newton_euler: expected a SpatialInertia first, got SpatialAcceleration"):
        newton_euler(A, M, V)
    with pytest.raises(TypeError, match="newton_euler: expected a SpatialAcceleration, got SpatialVelocity"):
        newton_euler(M, V, V)
    with pytest.raises(ValueError, match=r"newton_euler_regressor: w: expected shape \(\*batch, 3\), got \(2,\)"):
        newton_euler_regressor(A, [1.0, 2.0])
    with pytest.raises(TypeError, match="expected one dtype"):
        newton_euler(M, A, np.zeros(3, np.float32))
    for regressor in (momentum_regressor, kinetic_energy_regressor):
        with pytest.raises(TypeError, match=f"{regressor.__name__}: expected a SpatialVelocity"):
            regressor(A)
