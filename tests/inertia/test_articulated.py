"""Articulated inertias: what Drake's own tests ask, dense algebra over fractions, and two links moved by hand.

Formulas are evaluated in NumPy (`interpreted`); `test_batches_transformations_and_derivatives` holds that compiled
programs give the same bits, and the table of operations holds bounds of compiled ones.
"""

import functools
from fractions import Fraction

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia import SpatialInertia, joint_projection
from jaxspatial.inertia.articulated import ACT, PROJECTED, SHIFT, ArticulatedInertia
from jaxspatial.inertia.articulated import ROTATED as TURN
from jaxspatial.measure.error import Sized, attribute, rationals, sized, unit_roundoff
from jaxspatial.numerics.promise import EXACT
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow
from tests.helpers.operation import violations
from tests.helpers.soon import compiled_as_for_users

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
    return jax.tree.map(lambda x: np.asarray(x, jnp.dtype(dtype)), tree)


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
    return SpatialInertia(np.asarray(mass), np.asarray(com), np.asarray(central))


M1 = (2.5, [0.1, -0.2, 0.3], [5.0, 0.25, 5.75, -0.25, 0.5, 6.0])
M2 = (5.3, [0.4, 0.2, -0.3], [2.0, 0.1, 2.3, -0.1, 0.2, 2.4])


def assert_close(a, b, eps=8):
    np.testing.assert_allclose(a, b, rtol=0, atol=eps * np.finfo(float).eps * max(abs(np.asarray(b)).max(), 1e-300))


def matrices(function, *arguments):
    """The 6 x 6 matrices of the inertias that a function gives."""
    return interpreted(lambda *x: [P.to_matrix() for P in function(*x)])(*arguments)


def test_of_a_spatial_inertia_and_of_its_matrix():
    of_parts = ArticulatedInertia.from_spatial_inertia
    m, found = matrices(lambda M: (M, of_parts(M)), body(*M1))
    assert_close(found, m, 0)
    upper_is_not_read = m + np.triu(np.ones((6, 6)), 1)
    for matrix in (m, upper_is_not_read):
        assert_close(*matrices(lambda m: [ArticulatedInertia.from_matrix(m)], matrix), m, 0)
    assert_close(*matrices(lambda m: [ArticulatedInertia(m[:3, :3], m[:3, 3:], 2.5 * jnp.eye(3))], m), m, 0)


def test_shift_and_change_of_frame_are_those_of_the_spatial_inertia():
    def moved(M, p, w):
        P, R = ArticulatedInertia.from_spatial_inertia(M), js.Rotation.exp(w)
        X = js.RigidTransform(R, p)
        yield from (js.shift(P, p), js.shift(M, p), js.shift(js.shift(P, p), -p), P)
        yield from (R @ P, R @ M, js.act(X, P), js.act(X, M), js.act_inverse(X, P), js.act_inverse(X, M))
        yield from (js.act_inverse(X, js.act(X, P)), M)

    found = matrices(moved, body(*M1), np.array([2.0, 3.0, 4.0]), np.array([0.3, -0.4, 1.2]))
    assert_close(*found[:2])
    for a, b in zip(found[2::2], found[3::2], strict=True):
        assert_close(a, b, 64)


def test_sums_are_those_of_bodies_welded_together():
    def sums(M, N):
        P, Q = map(ArticulatedInertia.from_spatial_inertia, (M, N))
        assert (P + ArticulatedInertia.zero()).rotational is P.rotational
        return P + Q, M + N, P + Q - Q, M, P + N, sum([P, Q])

    welded, expected, one, first, mixed, total = matrices(sums, body(*M1), body(*M2))
    assert_close(welded, expected)
    assert_close(one, first, 16)
    assert_close(mixed, welded, 0)
    assert_close(total, welded, 0)


def test_products_are_dense_products():
    rng = np.random.default_rng(0)
    P, A = random_inertia(rng, 5), js.SpatialAcceleration(*rng.standard_normal((2, 5, 3)))
    found, m = interpreted(lambda P, A: ((P @ A).to_array(), P.to_matrix()))(P, A)
    assert_close(found, np.einsum("bij,bj->bi", m, np.concatenate(A._vectors, -1)), 16)
    one = jax.tree.map(lambda x: x[0], A)
    both = interpreted(lambda M, A: ((ArticulatedInertia.from_spatial_inertia(M) @ A).to_array(), (M @ A).to_array()))
    assert_close(*both(body(*M1), one), 16)


def test_validity():
    of_matrix = interpreted(lambda m: ArticulatedInertia.from_matrix(m).is_physically_valid())
    P = random_inertia(np.random.default_rng(1), 5)
    assert bool(jax.jit(jax.vmap(ArticulatedInertia.is_physically_valid))(P).all())
    found = interpreted(ArticulatedInertia.is_physically_valid)(P)
    assert found.all() and found.shape == (5,)
    assert not of_matrix(np.full((6, 6), np.nan))
    assert not of_matrix(-np.eye(6))
    assert not of_matrix(-1e-30 * np.eye(6))
    assert interpreted(lambda: ArticulatedInertia.zero().is_physically_valid())()
    # In grams and millimetres it is what it is in kilograms and metres.
    slightly = np.diag([1, 2, 3, 1, 1, 1.0])
    slightly[0, 3] = slightly[3, 0] = 1 + 1e-10
    for scale in (1e-12, 1.0, 1e12):
        units = np.diag([scale] * 3 + [1.0] * 3)
        assert of_matrix(units @ units) and not of_matrix(units @ slightly @ units)
    slack = np.diag([1, 1, 1, 1, 1, -1e-10])
    assert not of_matrix(slack)
    assert interpreted(lambda m: ArticulatedInertia.from_matrix(m).is_physically_valid(tolerance=1e-9))(slack)


# -- bounds -----------------------------------------------------------------------------------------------------------


def case(dtype, n=12):
    rng = np.random.default_rng(2)
    decades = 0.5 if dtype in ("float16", "bfloat16") else 3.0
    P = cast(random_inertia(rng, n, decades), dtype)
    p = cast(rng.standard_normal((n, 3)) * 10 ** rng.uniform(-decades, decades, (n, 1)), dtype)
    R = js.Rotation(cast(interpreted(js.Rotation.exp)(rng.standard_normal((n, 3))).entries, dtype))
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
    rows = lambda e: e.reshape(3, 3)  # noqa: E731
    exact = {
        "shift": references(lambda P, p: shifted(P, p, ZERO), P, p),
        "rotate": references(lambda P, e: turned(P, rows(e)), P, R.entries),
        "act": references(lambda P, e, p: shifted(turned(P, rows(e)), -p, ZERO), P, R.entries, p),
        "act_inverse": references(lambda P, e, p: turned(shifted(P, p, ZERO), rows(e).T), P, R.entries, p),
    }
    for precision in precisions:
        found = dict(zip(exact, evaluated(precision, functools.partial(moved, precision))(P, p, R), strict=True))
        bounds = {"shift": (SHIFT, SHIFT, EXACT), "rotate": (TURN,) * 3, "act": (ACT,) * 3, "act_inverse": (ACT,) * 3}
        for name, computed in found.items():
            assert_within(computed, exact[name], bounds[name], precision)
            assert computed.dtype == dtype


def moved(precision, P, p, R):
    X, kind = js.RigidTransform(R, p), {"precision": precision}
    return P.shift(p, **kind), P.rotate(R, **kind), js.act(X, P, **kind), js.act_inverse(X, P, **kind)


@pytest.mark.parametrize("precision", ["compensated", slow("faithful")])
def test_bounds_in_float64(precision):
    """Kernels, and of what is evaluated in double words one."""
    P, p, R = case("float64" if precision == "compensated" else "float32")
    exact = references(lambda P, p: shifted(P, p, ZERO), P, p)
    found = interpreted(lambda P, p: P.shift(p, precision=precision))(P, p)
    assert_within(found, exact, (SHIFT, SHIFT, EXACT), precision)
    if precision == "compensated":
        turn = references(lambda P, e: turned(P, e.reshape(3, 3)), P, R.entries)
        found = interpreted(lambda P, R: P.rotate(R, precision=precision))(P, R)
        assert_within(found, turn, (TURN,) * 3, precision)


def projection_error(P, S, armature, precision):
    """The largest error in units of u mag mag_D / D, and of u^2 of that where u |r| is allowed; after one step."""
    found = evaluated(precision, functools.partial(joint_projection, precision=precision))(P, S, armature)
    u = unit_roundoff(P.dtype)
    worst = 0
    for i in range(P.batch_shape[0]):
        item = [sized(x[i]) for x in leaves(P)]
        s, a = sized(np.concatenate(S._vectors, -1)[i]), sized(armature[i])
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
    S = js.SpatialVelocity(*rng.standard_normal((2, 8, 3)).astype(dtype))
    armature = (rng.uniform(0, 1, 8) * (np.arange(8) % 2)).astype(dtype)
    limit = PROJECTED.u if precision in ("fast", "reproducible") else PROJECTED.u2
    assert projection_error(P, S, armature, precision) <= limit
    thin = 10 ** (-rng.uniform(1, 4 if dtype == "float64" else 1.4, 8))
    axis = rng.standard_normal((8, 3))
    rods = interpreted(
        lambda radius, axis: ArticulatedInertia.from_spatial_inertia(
            SpatialInertia.solid_cylinder(radius, jnp.ones(8), axis, mass=jnp.ones(8))
        )
    )(thin, axis)
    S = js.SpatialVelocity(axis.astype(dtype), np.zeros((8, 3), dtype))
    assert projection_error(cast(rods, dtype), S, np.zeros(8, dtype), precision) <= limit


# -- what is left of an inertia ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("k", [slow(1), 3, slow(6)])
def test_projection_of_several_freedoms_is_the_dense_one(k):
    rng = np.random.default_rng(4)
    P, armature = random_inertia(rng, 4), [0.1 * (i + 1) for i in range(k)]
    S = [js.SpatialVelocity(*rng.standard_normal((2, 4, 3))) for _ in range(k)]
    (m,), s = matrices(lambda P: [P], P), np.stack([np.concatenate(x._vectors, -1) for x in S], -1)
    for arms in ([0.0] * k, armature):
        found = interpreted(lambda P, S, arms=arms: joint_projection(P, S, arms))(P, S)
        D = s.swapaxes(-1, -2) @ m @ s + np.diag(arms)
        exact = m - m @ s @ np.linalg.solve(D, s.swapaxes(-1, -2) @ m)
        assert abs(matrices(lambda P: [P], found.inertia)[0] - exact).max() <= 1e-12 * abs(m).max()
        assert len(found.U) == len(found.D) == k
        np.testing.assert_allclose(np.prod(found.D, 0), np.linalg.det(D), rtol=1e-10)
        if any(arms) or k < 6:
            assert interpreted(ArticulatedInertia.is_physically_valid)(found.inertia).all()
    one, first, left = interpreted(
        lambda P, S: (
            joint_projection(P, S, armature[0]),
            joint_projection(P, [S], armature[:1]).U[0],
            P.project_out(S, armature[0]),
        )
    )(P, S[0])
    chex.assert_trees_all_equal((one.U, one.inertia), (first, left))
    np.testing.assert_allclose(np.concatenate(one.U._vectors, -1), np.einsum("bij,bj->bi", m, s[..., 0]), atol=1e-13)


def test_nothing_is_left_along_the_axis_of_a_joint():
    P = random_inertia(np.random.default_rng(5), 6, 3.0)
    whole, *left = matrices(lambda P: [P, *(P.project_out(js.SpatialVelocity.from_array(x)) for x in np.eye(6))], P)
    for i, rest in enumerate(left):
        assert (abs(rest[:, i]) <= np.finfo(float).eps * abs(whole[:, i])).all()


def test_nothing_that_hangs_on_a_joint_is_nothing_to_remove():
    S = js.SpatialVelocity(np.array([0.0, 0.0, 1.0]), np.zeros(3))

    def left(mass, armature):
        P = ArticulatedInertia.from_spatial_inertia(SpatialInertia.thin_rod(2.0, mass=mass))
        return joint_projection(P, S, armature), P

    found, P = interpreted(left)(1.0, 0.0)
    assert found.D == 0
    chex.assert_trees_all_equal(found.inertia, P)
    assert any(np.isnan(x).any() for x in leaves(interpreted(left)(1.0, np.nan)[0].inertia))
    sums = interpreted(jax.grad(lambda m: left(m, 0.0)[0].inertia.to_matrix().sum()))
    np.testing.assert_allclose(sums(1.0), matrices(lambda P: [P], P)[0].sum())


def test_nothing_turns_indefinite(dtype="float32"):
    """Rods, plates and heavy or light bodies, moved far out and turned, with a joint removed on the way."""
    rng, n = np.random.default_rng(6), 64
    size, mass = 10 ** rng.uniform(-4, 0, (n, 3)), 10 ** rng.uniform(-20, 20, n)
    offsets = rng.standard_normal((n, 3)) * 10 ** rng.uniform(-4, 4, (n, 1))
    S = js.SpatialVelocity(np.eye(3)[rng.integers(0, 3, n)], np.zeros((n, 3)))

    @interpreted
    def valid(size, mass, offsets, S, w):
        P = ArticulatedInertia.from_spatial_inertia(SpatialInertia.solid_box(size, mass=mass))
        R, left = js.Rotation.exp(w), P.project_out(S)
        moved = P, P.shift(offsets), P.rotate(R), left, left.shift(offsets).rotate(R)
        return [X.is_physically_valid() for X in moved]

    for mask in valid(*cast((size, mass, offsets, S, rng.standard_normal((n, 3))), dtype)):
        assert mask.shape == (n,) and mask.all()


# -- two links, by dense algebra --------------------------------------------------------------------------------------


def test_two_links_move_as_dense_algebra_says():
    """A chain of two revolute joints at rest, without gravity: forward dynamics by articulated bodies against the
    accelerations that solve the whole system's equations."""
    rng = np.random.default_rng(7)
    pseudo, p = [a @ a.T for a in rng.standard_normal((2, 4, 4))], rng.standard_normal(3)
    axes, torques = rng.standard_normal((2, 3)), rng.standard_normal(2)

    def accelerations(pseudo, p, axes, torques):
        first, second = map(SpatialInertia.from_pseudo_inertia, pseudo)
        S1, S2 = (js.SpatialVelocity(a, jnp.zeros(3)) for a in axes)
        outer = joint_projection(ArticulatedInertia.from_spatial_inertia(second), S2)
        # What the second joint's torque presses on the first body.
        bias = outer.U * (torques[1] / outer.D)
        P1 = js.shift(outer.inertia, -p) + first
        inner = joint_projection(P1, S1)
        u1 = torques[0] - js.dot(js.shift(bias, -p), S1)
        q1 = u1 / inner.D
        A2 = js.shift(js.SpatialAcceleration(S1.w * q1, S1.v * q1), p, jnp.zeros(3))
        q2 = (torques[1] - (outer.U.to_array() * A2.to_array()).sum()) / outer.D
        return (q1, q2), [x.to_array() for x in (S1, js.shift(S1, p), S2)], [M.to_matrix() for M in (first, second)]

    q, (s1, s1_moved, s2), (m1, m2) = interpreted(accelerations)(pseudo, p, list(axes), list(torques))
    J1, J2 = np.stack([s1, np.zeros(6)], -1), np.stack([s1_moved, s2], -1)
    H = J1.T @ m1 @ J1 + J2.T @ m2 @ J2
    np.testing.assert_allclose(q, np.linalg.solve(H, torques), rtol=1e-12)


# -- transformations, trees, messages ---------------------------------------------------------------------------------


@pytest.mark.slow
@compiled_as_for_users()
def test_batches_transformations_and_derivatives():
    """Compiled for one item and mapped, a chain of operations has the bits of NumPy; its tangents are differences of
    it, its pull-back is the transpose of them."""
    rng = np.random.default_rng(8)
    P, p, w = random_inertia(rng, 6), rng.standard_normal((6, 3)), rng.standard_normal((6, 3))
    V, turn = js.SpatialVelocity(p, w), interpreted(js.Rotation.exp)(np.array([0.3, -0.4, 1.2]))

    def chain(P, p, V):
        return js.act(js.RigidTransform(turn, p), P.shift(p).project_out(V, 0.5)).to_matrix()

    whole = interpreted(chain)(P, p, V)
    np.testing.assert_array_equal(whole, jax.jit(jax.vmap(chain))(P, p, V))
    assert jax.eval_shape(chain, jax.tree.map(lambda x: x[0], P), p, V).shape == (6, 6, 6)
    direction = jax.tree.map(lambda x: rng.standard_normal(x.shape), (P, p, V))

    def derivatives(x, t, c):
        return jax.jvp(chain, x, t)[1], jax.vjp(lambda x: chain(*x), x)[1](c)[0]

    tangent, pulled = interpreted(derivatives)((P, p, V), direction, whole)
    step = 1e-6
    ends = interpreted(chain)(*jax.tree.map(lambda x, t: np.stack([x + step * t, x - step * t]), (P, p, V), direction))
    np.testing.assert_allclose(tangent, (ends[0] - ends[1]) / (2 * step), atol=1e-6 * abs(tangent).max())
    terms = jax.tree.map(lambda a, b: (a * b).sum(), pulled, direction)
    np.testing.assert_allclose(sum(jax.tree.leaves(terms)), (tangent * whole).sum(), rtol=1e-10)


def test_double_words_are_carried():
    P = cast(random_inertia(np.random.default_rng(9), 3), "float32")
    p = np.array([1e-3, 2.0, 3e3], np.float32)
    back = interpreted(lambda P, p: js.from_double_word(js.shift(js.shift(js.to_double_word(P), p), -p)))(P, p)
    chex.assert_trees_all_close(back, P, rtol=1e-6, atol=0)


def test_trees_are_rebuilt_with_any_leaves():
    P = random_inertia(np.random.default_rng(10), 2)
    leaves, structure = jax.tree.flatten(P)
    assert jax.tree.unflatten(structure, [1, 2, 3]).coupling == 2
    assert [str(path[0]) for path, _ in jax.tree_util.tree_leaves_with_path(P)] == [
        ".rotational", ".coupling", ".translational"
    ]  # fmt: skip
    assert ArticulatedInertia(0, 0, None).rotational == 0
    carried = interpreted(lambda P: jax.lax.scan(lambda c, x: (c + x, None), ArticulatedInertia.zero(), P)[0])(P)
    for x, y in zip(jax.tree.leaves(carried), leaves, strict=True):
        np.testing.assert_allclose(x, y.sum(0), rtol=1e-15)


def test_messages():
    P, z = random_inertia(np.random.default_rng(11), 1), np.zeros
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
