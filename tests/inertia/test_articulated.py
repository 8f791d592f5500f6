"""Articulated inertias: what Drake's own tests ask, dense algebra over fractions, and two links moved by hand."""

from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.arithmetic.promise import EXACT
from jaxspatial.inertia import SpatialInertia
from jaxspatial.inertia.articulated_inertia import ArticulatedInertia
from jaxspatial.inertia.joint_projection import joint_projection
from jaxspatial.inertia.promises import ARTICULATED_ACT as ACT
from jaxspatial.inertia.promises import ARTICULATED_ROTATED as TURN
from jaxspatial.inertia.promises import ARTICULATED_SHIFT as SHIFT
from jaxspatial.inertia.promises import PROJECTED
from jaxspatial.measure.error import unit_roundoff
from jaxspatial.measure.exact import Sized, attribute, rationals, sized
from tests.helpers.marks import slow
from tests.helpers.operations import violations

ZERO = Sized(Fraction(0))
LOWER = [(0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2)]


@pytest.fixture(autouse=True)
def float64():
    with jax.enable_x64(True):
        yield


# -- dense 6 x 6, of any numbers --------------------------------------------------------------------------------------


def dense(j, f, m):
    J, M = (np.array([[x[LOWER.index((max(i, k), min(i, k)))] for k in range(3)] for i in range(3)]) for x in (j, m))
    F = np.reshape(f, (3, 3))
    return np.block([[J, F], [F.T, M]])


def parts(P):
    lower = tuple(map(list, zip(*LOWER, strict=True)))
    return P[:3, :3][lower], P[:3, 3:].ravel(), P[3:, 3:][lower]


def skew(p, zero=0):
    x, y, z = p
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])


def shifted(P, p, zero=0):
    """[[1, -p x], [0, 1]] P [[1, 0], [p x, 1]], block by block."""
    J, F, M, S = P[:3, :3], P[:3, 3:], P[3:, 3:], skew(p, zero)
    G = F - S.dot(M)
    new = J - S.dot(F.T) + G.dot(S)
    return np.block([[new, G], [G.T, M]])


def turned(P, R):
    blocks = [[R.dot(P[i : i + 3, k : k + 3]).dot(R.T) for k in (0, 3)] for i in (0, 3)]
    return np.block(blocks)


def projected(P, S, armature=0):
    U = P.dot(S)
    D = S.dot(U) + armature
    return P - np.multiply.outer(U, U / D), U, D


def random_inertia(rng, n, decades=0.0):
    """Articulated: of a body, of which a random part of what it resists was projected out."""
    A = rng.standard_normal((n, 6, 6)) * 10 ** rng.uniform(-decades, decades, (n, 6, 1))
    return ArticulatedInertia.from_matrix(A @ A.swapaxes(-1, -2))


def cast(tree, dtype):
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), tree)


def leaves(P):
    return [np.asarray(x) for x in jax.tree.leaves(P)]


def references(formula, P, *arrays):
    """The parts of formula(dense P, *arrays), item by item, as arrays of `Sized`."""
    items = zip(*(sized(x) for x in (*leaves(P), *map(np.asarray, arrays))), strict=True)
    found = [parts(formula(dense(*item[:3]), *item[3:])) for item in items]
    return [np.array(x, object) for x in zip(*found, strict=True)]


def assert_within(P, exact, bounds, precision):
    for computed, expected, bound in zip(leaves(P), exact, bounds, strict=True):
        assert not violations(bound, precision, computed, expected).any(), (precision, bound)


# -- Drake's properties -----------------------------------------------------------------------------------------------


def body(mass, com, central):
    return SpatialInertia(jnp.asarray(mass), jnp.asarray(com), jnp.asarray(central))


M1 = (2.5, [0.1, -0.2, 0.3], [5.0, 0.25, 5.75, -0.25, 0.5, 6.0])
M2 = (5.3, [0.4, 0.2, -0.3], [2.0, 0.1, 2.3, -0.1, 0.2, 2.4])


def assert_close(a, b, eps=8):
    np.testing.assert_allclose(a, b, rtol=0, atol=eps * np.finfo(float).eps * max(abs(np.asarray(b)).max(), 1e-300))


def test_of_a_spatial_inertia_and_of_its_matrix():
    M = body(*M1)
    P = ArticulatedInertia.from_spatial_inertia(M)
    assert_close(P.to_matrix(), M.to_matrix(), 0)
    assert_close(ArticulatedInertia.from_matrix(M.to_matrix()).to_matrix(), M.to_matrix(), 0)
    upper_is_not_read = M.to_matrix() + jnp.triu(jnp.ones((6, 6)), 1)
    assert_close(ArticulatedInertia.from_matrix(upper_is_not_read).to_matrix(), M.to_matrix(), 0)
    J, F = M.to_matrix()[:3, :3], M.to_matrix()[:3, 3:]
    assert_close(ArticulatedInertia(J, F, 2.5 * jnp.eye(3)).to_matrix(), M.to_matrix(), 0)


def test_shift_and_change_of_frame_are_those_of_the_spatial_inertia():
    M = body(*M1)
    P = ArticulatedInertia.from_spatial_inertia(M)
    p = jnp.asarray([2.0, 3.0, 4.0])
    assert_close(js.shift(P, p).to_matrix(), js.shift(M, p).to_matrix())
    assert_close(js.shift(js.shift(P, p), -p).to_matrix(), P.to_matrix(), 64)
    R = js.Rotation.exp(jnp.asarray([0.3, -0.4, 1.2]))
    X = js.RigidTransform(R, p)
    for a, b in (
        (R @ P, R @ M),
        (js.act(X, P), js.act(X, M)),
        (js.act_inverse(X, P), js.act_inverse(X, M)),
        (js.act_inverse(X, js.act(X, P)), M),
    ):
        assert_close(a.to_matrix(), b.to_matrix(), 64)


def test_sums_are_those_of_bodies_welded_together():
    M, N = body(*M1), body(*M2)
    P, Q = map(ArticulatedInertia.from_spatial_inertia, (M, N))
    assert_close((P + Q).to_matrix(), (M + N).to_matrix())
    assert_close((P + Q - Q).to_matrix(), M.to_matrix(), 16)
    assert_close((P + N).to_matrix(), (P + Q).to_matrix(), 0)
    assert_close(sum([P, Q]).to_matrix(), (P + Q).to_matrix(), 0)
    assert (P + ArticulatedInertia.zero()).rotational is P.rotational


def test_products_are_dense_products():
    rng = np.random.default_rng(0)
    P, A = random_inertia(rng, 5), js.SpatialAcceleration(*jnp.asarray(rng.standard_normal((2, 5, 3))))
    assert_close((P @ A).to_array(), np.einsum("bij,bj->bi", P.to_matrix(), A.to_array()), 16)
    M = body(*M1)
    one = jax.tree.map(lambda x: x[0], A)
    assert_close((ArticulatedInertia.from_spatial_inertia(M) @ one).to_array(), (M @ one).to_array(), 16)


def test_validity():
    P = random_inertia(np.random.default_rng(1), 5)
    assert P.is_physically_valid().all() and P.is_physically_valid().shape == (5,)
    assert not ArticulatedInertia.from_matrix(jnp.full((6, 6), jnp.nan)).is_physically_valid()
    assert not ArticulatedInertia.from_matrix(-jnp.eye(6)).is_physically_valid()
    assert not ArticulatedInertia.from_matrix(-1e-30 * jnp.eye(6)).is_physically_valid()
    assert ArticulatedInertia.zero().is_physically_valid()
    # In grams and millimetres it is what it is in kilograms and metres.
    for scale in (1e-12, 1.0, 1e12):
        units = np.diag([scale] * 3 + [1.0] * 3)
        slightly = np.diag([1, 2, 3, 1, 1, 1.0])
        slightly[0, 3] = slightly[3, 0] = 1 + 1e-10
        for matrix, expected in ((np.eye(6), True), (slightly, False)):
            assert bool(ArticulatedInertia.from_matrix(units @ matrix @ units).is_physically_valid()) == expected
    slack = np.diag([1, 1, 1, 1, 1, -1e-10])
    assert not ArticulatedInertia.from_matrix(slack).is_physically_valid()
    assert ArticulatedInertia.from_matrix(slack).is_physically_valid(tolerance=1e-9)
    assert bool(jax.jit(jax.vmap(ArticulatedInertia.is_physically_valid))(P).all())


# -- bounds -----------------------------------------------------------------------------------------------------------


def case(dtype, n=12):
    rng = np.random.default_rng(2)
    decades = 0.5 if dtype in ("float16", "bfloat16") else 3.0
    P = cast(random_inertia(rng, n, decades), dtype)
    p = jnp.asarray(rng.standard_normal((n, 3)) * 10 ** rng.uniform(-decades, decades, (n, 1)), dtype)
    R = js.Rotation(cast(js.Rotation.exp(jnp.asarray(rng.standard_normal((n, 3)))).entries, dtype))
    return P, p, R


@pytest.mark.parametrize(
    ("dtype", "precisions"),
    [
        slow("bfloat16", ["reproducible"]),
        ("float32", ["reproducible", "compensated"]),
        slow("float64", ["fast"]),
    ],
)
def test_bounds_of_shift_and_change_of_frame(dtype, precisions):
    P, p, R = case(dtype)
    X = js.RigidTransform(R, p)
    rows = lambda e: e.reshape(3, 3)  # noqa: E731
    exact = {
        "shift": references(lambda P, p: shifted(P, p, ZERO), P, p),
        "rotate": references(lambda P, e: turned(P, rows(e)), P, R.entries),
        "act": references(lambda P, e, p: shifted(turned(P, rows(e)), -p, ZERO), P, R.entries, p),
        "act_inverse": references(lambda P, e, p: turned(shifted(P, p, ZERO), rows(e).T), P, R.entries, p),
    }
    for precision in precisions:
        P_Q = P.shift(p, precision=precision)
        assert_within(P_Q, exact["shift"], (SHIFT, SHIFT, EXACT), precision)
        assert_within(P.rotate(R, precision=precision), exact["rotate"], (TURN,) * 3, precision)
        assert_within(js.act(X, P, precision=precision), exact["act"], (ACT,) * 3, precision)
        assert_within(js.act_inverse(X, P, precision=precision), exact["act_inverse"], (ACT,) * 3, precision)
        assert P_Q.dtype == dtype


@pytest.mark.parametrize("precision", ["compensated", slow("faithful")])
def test_bounds_in_float64(precision):
    """Kernels, and of what is evaluated in double words one."""
    P, p, R = case("float64")
    exact = references(lambda P, p: shifted(P, p, ZERO), P, p)
    if precision == "compensated":
        assert_within(P.shift(p, precision=precision), exact, (SHIFT, SHIFT, EXACT), precision)
        turn = references(lambda P, e: turned(P, e.reshape(3, 3)), P, R.entries)
        assert_within(P.rotate(R, precision=precision), turn, (TURN,) * 3, precision)
    else:
        P, p, exact = cast(P, np.float32), cast(p, np.float32), None
        exact = references(lambda P, p: shifted(P, p, ZERO), P, p)
        assert_within(P.shift(p, precision=precision), exact, (SHIFT, SHIFT, EXACT), precision)


def projection_error(P, S, armature, precision):
    """The largest error in units of u mag mag_D / D, and of u^2 of that where u |r| is allowed; after one step."""
    found = joint_projection(P, S, armature, precision=precision)
    u = unit_roundoff(P.dtype)
    worst = 0
    for i in range(P.batch_shape[0]):
        item = [sized(x[i]) for x in leaves(P)]
        s, a = sized(S.to_array()[i]), sized(np.asarray(armature)[i])
        matrix = dense(*item)
        U = matrix.dot(s)
        D = s.dot(U) + a[()]
        kappa = D.mag / D.value
        for k, (exact, computed) in enumerate(zip(parts(matrix), leaves(found.inertia), strict=True)):
            rows, columns = _places(k)
            for n in range(len(exact)):
                r, c = rows[n], columns[n]
                r_exact = matrix[r, c].value - U[r].value * U[c].value / D.value
                mag = abs(matrix[r, c].value) + U[r].mag * U[c].mag / D.value
                error = abs(Fraction(float(computed[i, n])) - r_exact)
                if not mag:
                    assert not error
                elif precision in ("fast", "reproducible"):
                    worst = max(worst, error / (u * mag * kappa))
                else:
                    worst = max(worst, (error - u * abs(r_exact)) / (u * u * mag * kappa))
    return float(worst)


def _places(k):
    lower = tuple(zip(*LOWER, strict=True))
    offset = (0, 0) if k == 0 else (3, 3)
    if k == 1:
        return [i // 3 for i in range(9)], [3 + i % 3 for i in range(9)]
    return [i + offset[0] for i in lower[0]], [i + offset[1] for i in lower[1]]


@pytest.mark.parametrize(
    ("dtype", "precision"),
    [slow("float32", "fast"), ("float32", "reproducible"), ("float32", "compensated"), slow("float64", "reproducible"),
     slow("float64", "compensated")],
)  # fmt: skip
def test_bound_of_a_projection(dtype, precision):
    """Random inertias, and bodies light about an oblique axis: thin rods that turn about their own."""
    rng = np.random.default_rng(3)
    P = cast(random_inertia(rng, 8, 2.0), dtype)
    S = js.SpatialVelocity(*jnp.asarray(rng.standard_normal((2, 8, 3)), dtype))
    armature = jnp.asarray(rng.uniform(0, 1, 8) * (np.arange(8) % 2), dtype)
    limit = PROJECTED.u if precision in ("fast", "reproducible") else PROJECTED.u2
    assert projection_error(P, S, armature, precision) <= limit
    thin = 10 ** (-rng.uniform(1, 4 if dtype == "float64" else 1.4, 8))
    axis = rng.standard_normal((8, 3))
    rods = SpatialInertia.solid_cylinder(jnp.asarray(thin), jnp.ones(8), jnp.asarray(axis), mass=jnp.ones(8))
    rods = cast(ArticulatedInertia.from_spatial_inertia(rods), dtype)
    S = js.SpatialVelocity(jnp.asarray(axis, dtype), jnp.zeros((8, 3), dtype))
    assert projection_error(rods, S, jnp.zeros(8, dtype), precision) <= limit


# -- what is left of an inertia ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [slow(1), 3, slow(6)])
def test_projection_of_several_freedoms_is_the_dense_one(k):
    rng = np.random.default_rng(4)
    P, armature = random_inertia(rng, 4), [0.1 * (i + 1) for i in range(k)]
    S = [js.SpatialVelocity(*jnp.asarray(rng.standard_normal((2, 4, 3)))) for _ in range(k)]
    m, s = np.asarray(P.to_matrix()), np.stack([x.to_array() for x in S], -1)
    for arms in ([0.0] * k, armature):
        found = joint_projection(P, S, arms)
        D = s.swapaxes(-1, -2) @ m @ s + np.diag(arms)
        exact = m - m @ s @ np.linalg.solve(D, s.swapaxes(-1, -2) @ m)
        assert abs(found.inertia.to_matrix() - exact).max() <= 1e-12 * abs(m).max()
        assert len(found.U) == len(found.D) == k
        np.testing.assert_allclose(np.prod(found.D, 0), np.linalg.det(D), rtol=1e-10)
        if any(arms) or k < 6:
            assert found.inertia.is_physically_valid().all()
    one = joint_projection(P, S[0], armature[0])
    np.testing.assert_array_equal(one.U.to_array(), joint_projection(P, S[:1], armature[:1]).U[0].to_array())
    np.testing.assert_allclose(one.U.to_array(), np.einsum("bij,bj->bi", m, s[..., 0]), atol=1e-13)
    np.testing.assert_array_equal(P.project_out(S[0], armature[0]).to_matrix(), one.inertia.to_matrix())


def test_nothing_is_left_along_the_axis_of_a_joint():
    P = random_inertia(np.random.default_rng(5), 6, 3.0)
    for i in range(6):
        S = js.SpatialVelocity.from_array(np.eye(6)[i])
        left = np.asarray(P.project_out(S).to_matrix())
        assert (abs(left[:, i]) <= np.finfo(float).eps * abs(np.asarray(P.to_matrix())[:, i])).all()


def test_nothing_that_hangs_on_a_joint_is_nothing_to_remove():
    S = js.SpatialVelocity(jnp.asarray([0.0, 0.0, 1.0]), jnp.zeros(3))
    P = ArticulatedInertia.from_spatial_inertia(SpatialInertia.thin_rod(2.0, mass=1.0))
    found = joint_projection(P, S)
    assert found.D == 0
    np.testing.assert_array_equal(found.inertia.to_matrix(), P.to_matrix())
    gradient = jax.grad(lambda m: joint_projection(_rod(m), S).inertia.to_matrix().sum())(1.0)
    np.testing.assert_allclose(gradient, _rod(1.0).to_matrix().sum())
    assert np.isnan(P.project_out(S, jnp.nan).to_matrix()).any()


def _rod(mass):
    return ArticulatedInertia.from_spatial_inertia(SpatialInertia.thin_rod(2.0, mass=mass))


def test_nothing_turns_indefinite(dtype="float32"):
    """Rods, plates and heavy or light bodies, moved far out and turned, with a joint removed on the way."""
    rng, n = np.random.default_rng(6), 64
    size = 10 ** rng.uniform(-4, 0, (n, 3))
    M = SpatialInertia.solid_box(jnp.asarray(size, dtype), mass=jnp.asarray(10 ** rng.uniform(-20, 20, n), dtype))
    P = ArticulatedInertia.from_spatial_inertia(M)
    offsets = jnp.asarray(rng.standard_normal((n, 3)) * 10 ** rng.uniform(-4, 4, (n, 1)), dtype)
    S = js.SpatialVelocity(jnp.asarray(np.eye(3)[rng.integers(0, 3, n)], dtype), jnp.zeros((n, 3), dtype))
    R = js.Rotation.exp(jnp.asarray(rng.standard_normal((n, 3)), dtype))
    for X in (P, P.shift(offsets), P.rotate(R), P.project_out(S), P.project_out(S).shift(offsets).rotate(R)):
        assert X.is_physically_valid().all()


# -- two links, by dense algebra --------------------------------------------------------------------------------------


def test_two_links_move_as_dense_algebra_says():
    """A chain of two revolute joints at rest, without gravity: forward dynamics by articulated bodies against the
    accelerations that solve the whole system's equations."""
    rng = np.random.default_rng(7)
    first, second = (SpatialInertia.from_pseudo_inertia(jnp.asarray(a @ a.T)) for a in rng.standard_normal((2, 4, 4)))
    p = jnp.asarray(rng.standard_normal(3))
    axes, torques = rng.standard_normal((2, 3)), rng.standard_normal(2)
    S1, S2 = (js.SpatialVelocity(jnp.asarray(a), jnp.zeros(3)) for a in axes)
    outer = joint_projection(ArticulatedInertia.from_spatial_inertia(second), S2)
    # What the second joint's torque presses on the first body.
    bias = outer.U * (torques[1] / outer.D)
    P1 = js.shift(outer.inertia, -p) + first
    inner = joint_projection(P1, S1)
    u1 = torques[0] - js.dot(js.shift(bias, -p), S1)
    q1 = u1 / inner.D
    A1 = js.SpatialAcceleration(S1.w * q1, S1.v * q1)
    A2 = js.shift(A1, p, jnp.zeros(3))
    q2 = (torques[1] - np.dot(outer.U.to_array(), A2.to_array())) / outer.D
    J1 = np.stack([S1.to_array(), np.zeros(6)], -1)
    J2 = np.stack([js.shift(S1, p).to_array(), S2.to_array()], -1)
    H = J1.T @ first.to_matrix() @ J1 + J2.T @ second.to_matrix() @ J2
    np.testing.assert_allclose([q1, q2], np.linalg.solve(H, torques), rtol=1e-12)


# -- transformations, trees, messages ---------------------------------------------------------------------------------


def test_batches_transformations_and_derivatives():
    rng = np.random.default_rng(8)
    P, p, R = random_inertia(rng, 6), jnp.asarray(rng.standard_normal((6, 3))), jnp.asarray(rng.standard_normal((6, 3)))
    V, turn = js.SpatialVelocity(p, R), js.Rotation.exp(jnp.asarray([0.3, -0.4, 1.2]))

    def chain(P, p, V):
        return js.act(js.RigidTransform(turn, p), P.shift(p).project_out(V, 0.5)).to_matrix()

    whole = chain(P, p, V)
    np.testing.assert_array_equal(whole, jax.jit(jax.vmap(chain))(P, p, V))
    assert jax.eval_shape(chain, jax.tree.map(lambda x: x[0], P), p, V).shape == (6, 6, 6)
    direction = jax.tree.map(lambda x: jnp.asarray(rng.standard_normal(x.shape)), (P, p, V))
    tangent = jax.jit(lambda x, t: jax.jvp(chain, x, t)[1])((P, p, V), direction)
    step = 1e-6
    ends = [chain(*jax.tree.map(lambda x, t, s=s: x + s * step * t, (P, p, V), direction)) for s in (1, -1)]
    np.testing.assert_allclose(tangent, (ends[0] - ends[1]) / (2 * step), atol=1e-6 * abs(tangent).max())
    pulled = jax.jit(jax.grad(lambda x: (chain(*x) * whole).sum()))((P, p, V))
    terms = jax.tree.map(lambda a, b: (a * b).sum(), pulled, direction)
    np.testing.assert_allclose(sum(jax.tree.leaves(terms)), (tangent * whole).sum(), rtol=1e-10)


def test_double_words_are_carried():
    P = js.to_double_word(jax.tree.map(lambda x: x.astype(np.float32), random_inertia(np.random.default_rng(9), 3)))
    p = jnp.asarray([1e-3, 2.0, 3e3], np.float32)
    back = js.from_double_word(js.shift(js.shift(P, p), -p))
    chex.assert_trees_all_close(back, js.from_double_word(P), rtol=1e-6, atol=0)


def test_trees_are_rebuilt_with_any_leaves():
    P = random_inertia(np.random.default_rng(10), 2)
    leaves, structure = jax.tree.flatten(P)
    assert jax.tree.unflatten(structure, [1, 2, 3]).coupling == 2
    assert [str(path[0]) for path, _ in jax.tree_util.tree_leaves_with_path(P)] == [
        ".rotational", ".coupling", ".translational"
    ]  # fmt: skip
    assert ArticulatedInertia(0, 0, None).rotational == 0
    carried = jax.lax.scan(lambda c, x: (c + x, None), ArticulatedInertia.zero(), P)[0]
    np.testing.assert_allclose(carried.to_matrix(), P.to_matrix().sum(0), rtol=1e-15)


def test_messages():
    P, z = random_inertia(np.random.default_rng(11), 1), jnp.zeros
    with pytest.raises(ValueError, match=r"ArticulatedInertia: coupling: expected shape .* got \(6,\)"):
        ArticulatedInertia(z(6), z(6), z(6))
    with pytest.raises(TypeError, match="expected one dtype"):
        ArticulatedInertia(z(6), z(9), z(6, np.float32))
    with pytest.raises(TypeError, match="joint_projection: S: expected a SpatialVelocity or a list of them, got list"):
        P.project_out([[1.0]])
    with pytest.raises(ValueError, match="armature: expected 1 numbers, got 2"):
        P.project_out([js.SpatialVelocity.zero()], [0.0, 1.0])
    with pytest.raises(TypeError, match="w is for a SpatialAcceleration"):
        js.shift(P, [0.0, 0.0, 1.0], [0.0, 0.0, 1.0])
    with pytest.raises(TypeError, match="from_spatial_inertia: expected a SpatialInertia, got ArticulatedInertia"):
        ArticulatedInertia.from_spatial_inertia(P)
    with pytest.raises(TypeError, match="times: expected a SpatialAcceleration, got SpatialVelocity"):
        P.times(js.SpatialVelocity.zero())
    with pytest.raises(TypeError):
        _ = P @ js.SpatialVelocity.zero()
    assert attribute(sized(np.ones(1)), "mag")[0] == 1 and rationals(1.0) == 1
