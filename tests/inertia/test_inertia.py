"""A SpatialInertia is mass, centre of mass and central inertia; what is done with it is what its 6 x 6 matrix does.

Bounds of sums of products and transformations: see the table of operations. Laws and examples are evaluated in NumPy
(`interpreted`): they are about formulas, and `test_transformations` holds that compiled programs have the same bits.
"""

import chex
import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial.inertia.inertia import ENERGY, FORCE, TORQUE
from jaxspatial.measure import error
from jaxspatial.measure.error import rationals, sized
from tests.helpers.exact_inertia import exactly, matrix, random_inertia, six_of, steiner
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow_but
from tests.helpers.soon import compiled_as_for_users

DTYPES = ("float16", "bfloat16", "float32", "float64")
MATRIX = np.array([[2.0, 0.1, -0.2], [0.1, 2.3, 0.3], [-0.2, 0.3, 2.4]])
SIX = [2.0, 0.1, 2.3, -0.2, 0.3, 2.4]


def body(dtype="float32"):
    return js.SpatialInertia(*(np.asarray(x, dtype) for x in (2.5, [0.1, -0.2, 0.3], SIX)))


def dense(M):
    """The 6 x 6 matrix, naively."""
    m, c, i = (np.asarray(x, np.float64) for x in jax.tree.leaves(M))
    cross = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    return np.block([[matrix(i) + m * cross @ cross.T, m * cross], [m * cross.T, m * np.eye(3)]])


def motion(kind, batch, dtype, seed=1):
    rng = np.random.default_rng(seed)
    return kind(*(rng.standard_normal((*batch, 3)).astype(jnp.dtype(dtype)) for _ in range(2)))


# -- construction -----------------------------------------------------------------------------------------------------


def test_parts_are_what_was_given(x64):
    M = js.SpatialInertia(np.float32(2.5), np.float32([1, 2, 3]), MATRIX.astype(np.float32))
    np.testing.assert_array_equal(M.mass, np.float32(2.5))
    np.testing.assert_array_equal(M.com, np.float32([1, 2, 3]))
    np.testing.assert_array_equal(M.central, np.float32(SIX))
    np.testing.assert_array_equal(M.central_matrix(), MATRIX.astype(np.float32))
    assert (M.batch_shape, M.dtype) == ((), np.float32)


def test_of_a_matrix_the_lower_triangle_is_read():
    asymmetric = MATRIX + np.triu(np.ones((3, 3)), 1)
    np.testing.assert_array_equal(js.SpatialInertia(1.0, [0.0, 0, 0], asymmetric).central, SIX)


def test_python_numbers_take_the_dtype_of_arrays_and_batches_broadcast(x64):
    M = js.SpatialInertia(1.0, jnp.zeros((4, 3), jnp.float16), np.eye(3).tolist())
    assert [x.shape for x in jax.tree.leaves(M)] == [(4,), (4, 3), (4, 6)] and {
        x.dtype.name for x in jax.tree.leaves(M)
    } == {"float16"}
    assert js.SpatialInertia(1.0, [0.0, 0, 0], np.eye(3).tolist()).dtype == (np.float64 if x64 else np.float32)


def test_numpy_numbers_stay_known_and_are_copied():
    com = np.ones(3, np.float32)
    M = js.SpatialInertia(np.float32(1), com, np.eye(3, dtype=np.float32))
    com[0] = 7
    assert all(isinstance(x, np.ndarray) for x in jax.tree.leaves(M)) and M.com[0] == 1 and not M.com.flags.writeable


@pytest.mark.parametrize(
    ("parts", "kind", "message"),
    [
        ((1.0, np.ones(2), np.eye(3)), ValueError, r"SpatialInertia: com: expected shape \(\*batch, 3\), got \(2,\)"),
        (
            (1.0, np.ones(3), np.ones(5)),
            ValueError,
            r"central: expected shape \(\*batch, 3, 3\) or \(\*batch, 6\), got \(5,\)",
        ),
        ((jnp.int32(1), np.ones(3), np.eye(3)), TypeError, "SpatialInertia: mass: expected floating point .*got int32"),
        (
            (1.0, jnp.arange(3), np.eye(3)),
            TypeError,
            r"com: expected floating point .*got int32; .*astype\('float64'\)",
        ),
        ((np.float32(1), np.ones(3, np.float16), np.eye(3, dtype=np.float32)), TypeError, "expected one dtype, got"),
        ((np.ones(2), np.ones((3, 3)), np.ones((3, 6))), ValueError, "expected batch shapes that broadcast, got"),
        ((None, np.ones(3), np.eye(3)), TypeError, "SpatialInertia: mass: expected an array of floating point"),
        (("1", np.ones(3), np.eye(3)), TypeError, "SpatialInertia: mass: expected an array of floating point"),
    ],
)
def test_errors_name_what_came(parts, kind, message):
    with pytest.raises(kind, match=message):
        js.SpatialInertia(*parts)


def test_no_value_raises():
    @interpreted
    def is_valid(mass, com, central):
        return js.SpatialInertia(mass, com, central).is_physically_valid()

    for mass, com, central in ((-1.0, 0.0, -1.0), (np.inf, np.nan, np.nan), (0.0, np.inf, 0.0)):
        parts = mass, np.full(3, com, np.float32), np.float32(central) * np.eye(3, dtype=np.float32)
        assert js.SpatialInertia(*parts).central is not None and not is_valid(np.float32(mass), *parts[1:])


def test_zero_and_nan():
    zero, nan = js.SpatialInertia.zero((2,), jnp.float32), js.SpatialInertia.nan(dtype=jnp.float16)
    assert zero.batch_shape == (2,) and not any(x.any() for x in jax.tree.leaves(zero))
    assert nan.dtype == np.float16 and all(np.isnan(x).all() for x in jax.tree.leaves(nan))


def test_repr():
    assert repr(body()) == "SpatialInertia(mass=2.5, com=[0.1, -0.2, 0.3], central=[2.0, 0.1, 2.3, -0.2, 0.3, 2.4])"
    assert (
        repr(js.SpatialInertia.zero((7,), jnp.float32))
        == "SpatialInertia(mass=float32[7], com=float32[7,3], central=float32[7,6])"
    )
    assert "float32[]" in repr(jax.eval_shape(lambda: body()))


def test_pytree():
    M = body()
    leaves, structure = jax.tree.flatten(M)
    assert len(leaves) == 3 and [jax.tree_util.keystr(k) for k, _ in jax.tree_util.tree_leaves_with_path(M)] == [
        ".mass", ".com", ".central"]  # fmt: skip
    assert isinstance(jax.tree.unflatten(structure, [object(), "x", None]), js.SpatialInertia)
    axes = js.SpatialInertia(0, None, jax.sharding.PartitionSpec("x"))
    assert axes.com is None
    many = random_inertia((4,), "float32")
    doubled = jax.vmap(lambda M: M + M, in_axes=(js.SpatialInertia(0, 0, 0),))(many)
    np.testing.assert_array_equal(doubled.mass, 2 * many.mass)


def test_export():
    exported = jax.export.export(jax.jit(lambda M: M.shift(M.com)))(jax.tree.map(jnp.asarray, body()))
    result = jax.export.deserialize(exported.serialize()).call(jax.tree.map(jnp.asarray, body()))
    np.testing.assert_array_equal(result.com, np.zeros(3))


# -- what its matrix does ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", DTYPES)
def test_matrix_is_its_definition(dtype):
    with jax.enable_x64(dtype == "float64"):
        M = body(jnp.dtype(dtype))
        eps = float(jnp.finfo(dtype).eps)
        matrix, about = interpreted(lambda M: (M.to_matrix(), M.inertia_about_origin()))(M)
        np.testing.assert_allclose(np.asarray(matrix, np.float64), dense(M), rtol=0, atol=4 * eps)
        np.testing.assert_array_equal(matrix[:3, :3], about)
        for motion_, kind in ((js.SpatialAcceleration, js.SpatialForce), (js.SpatialVelocity, js.SpatialMomentum)):
            V = motion(motion_, (), dtype)
            result = interpreted(lambda M, V: M @ V)(M, V)
            assert type(result) is kind and result.dtype == jnp.dtype(dtype)
            expected = dense(M) @ np.concatenate(V._vectors).astype(np.float64)
            found = np.concatenate(result._vectors).astype(np.float64)
            np.testing.assert_allclose(found, expected, rtol=0, atol=32 * eps)


def _applied(mass, com, central, alpha, a):
    f = mass[..., None] * (a + np.cross(alpha, com))
    return (matrix(central) * alpha[..., None, :]).sum(-1) + np.cross(com, f), f


def _doubled_energy(mass, com, central, w, v):
    moved = v + np.cross(w, com)
    return mass * (moved * moved).sum(-1) + (w * (matrix(central) * w[..., None, :]).sum(-1)).sum(-1)


@pytest.mark.parametrize(
    ("precision", "dtype"),
    slow_but(
        [("reproducible", "float32"), ("compensated", "float32")],
        [(p, d) for p in ("fast", "reproducible", "compensated") for d in ("float32", "float64")]
        + [("faithful", "float32")],
    ),
)
def test_bounds_of_what_cancels(precision, dtype):
    """Points next to the one that does not move: v = -w x c up to rounding."""
    with jax.enable_x64(dtype == "float64"):
        M, V = random_inertia((20,), dtype), motion(js.SpatialVelocity, (20,), dtype)
        V = js.SpatialVelocity(V.w, -np.cross(V.w, M.com).astype(dtype))
        energy, momentum = evaluated(
            precision, lambda M, V: (M.kinetic_energy(V, precision=precision), M.apply(V, precision=precision))
        )(M, V)
        arrays = [sized(np.asarray(x)) for x in (*jax.tree.leaves(M), *V._vectors)]
        u = error.unit_roundoff(dtype)
        _require_bound(precision, dtype, np.asarray(energy) * 2, _doubled_energy(*arrays), u, ENERGY)
        for found, exact, bound in zip(momentum._vectors, _applied(*arrays), (TORQUE, FORCE), strict=True):
            _require_bound(precision, dtype, np.asarray(found), exact, u, bound)


@pytest.mark.parametrize("precision", js.Precision)
def test_a_kilogram_at_three_hundred_metres_per_second_in_float16(precision):
    """45000 J, where twice as many are beyond the largest number; a unit of inertia at 300 rad/s has as many."""
    v, zero, unit = (np.asarray(x, np.float16) for x in ([300, 0, 0], [0, 0, 0], [1, 0, 1, 0, 0, 1]))
    M = js.SpatialInertia(np.float16(1), zero, unit)
    both = evaluated(
        precision,
        lambda M, V: (
            M.kinetic_energy(V, precision=precision),
            js.regressors.kinetic_energy_regressor(V, precision=precision),
        ),
    )
    for V in (js.SpatialVelocity(zero, v), js.SpatialVelocity(v, zero)):
        energy, regressor = both(M, V)
        assert energy == 45000 == regressor.max()


# Where an intermediate result may overflow in one format or the other.
IN_RANGE = [(d, p) for d in DTYPES for p in js.Precision if (d, p) != ("float64", "compensated")]


@pytest.mark.parametrize(("dtype", "precision"), IN_RANGE)
def test_halves_of_sums_that_overflow(dtype, precision):
    """Second moments are halves of sums of moments that are beyond the largest number."""
    with jax.enable_x64(dtype == "float64"):
        unit = 2.0 ** (int(jnp.finfo(dtype).maxexp) - 1)
        parts = 1.0, np.zeros(3), [1.25 * unit, 0, 1.25 * unit, 0, 0, 1.5 * unit]
        M = js.SpatialInertia(*(np.asarray(x).astype(jnp.dtype(dtype)) for x in parts))
        J = evaluated(precision, lambda M: M.to_pseudo_inertia(precision=precision))(M)
        np.testing.assert_array_equal(np.diag(np.asarray(J, np.float64)), [0.75 * unit, 0.75 * unit, 0.5 * unit, 1])


@pytest.mark.parametrize(("dtype", "precision"), IN_RANGE)
def test_halves_of_squares_that_overflow(dtype, precision):
    with jax.enable_x64(dtype == "float64"):
        fast = np.array([1.25 * float(jnp.finfo(dtype).max) ** 0.5, 0, 0]).astype(jnp.dtype(dtype))
        regressor = evaluated(precision, lambda V: js.regressors.kinetic_energy_regressor(V, precision=precision))
        y = regressor(js.SpatialVelocity(fast, fast))
        half = rationals(fast)[0] ** 2 / 2
        assert (abs(rationals(np.asarray(y)[[0, 4]]) - half) <= 2 * error.unit_roundoff(dtype) * half).all()


def test_derivatives_of_halves():
    """The momentum, by tangents and by a pull-back, each rounded once: 1 kg at (1, 2, 3) m/s, then with a spin."""
    v, zero = np.float32([1, 2, 3]), np.zeros(3, np.float32)
    M = js.SpatialInertia(np.float32(1), zero, np.float32([2, 0, 4, 0, 0, 6]))

    def energy(w, v):
        return M.kinetic_energy(js.SpatialVelocity(w, v), precision="compensated")

    for derivative in (jax.grad, jax.jacfwd):
        spin, push = interpreted(derivative(energy, (0, 1)))(v, v)
        np.testing.assert_array_equal(spin, [2, 8, 18])
        np.testing.assert_array_equal(push, v)
    jacobian = jax.jacrev(lambda i: js.SpatialInertia(M.mass, M.com, i).to_pseudo_inertia(precision="compensated"))
    np.testing.assert_array_equal(interpreted(jacobian)(M.central)[0, 0], [-0.5, 0, 0.5, 0, 0, 0.5])


def _require_bound(precision, dtype, found, exact, u, bound):
    value, mag = (np.frompyfunc(lambda x, n=n: getattr(x, n), 1, 1)(exact) for n in ("value", "mag"))
    allowed = bound.allowed(precision, u, error.ulp(value, dtype), value, mag)
    assert (abs(rationals(found) - value) <= allowed).all()


def test_apply_refuses_other_kinds():
    F = js.SpatialForce(np.ones(3, np.float32), np.ones(3, np.float32))
    with pytest.raises(TypeError, match="expected a SpatialAcceleration or SpatialVelocity, got SpatialForce"):
        _ = body() @ F
    with pytest.raises(TypeError, match="kinetic_energy: expected a SpatialVelocity, got SpatialForce"):
        body().kinetic_energy(F)
    with pytest.raises(TypeError, match="expected one dtype"):
        _ = body() @ motion(js.SpatialVelocity, (), "float16")
    with pytest.raises(TypeError, match="w is for a SpatialAcceleration"):
        js.shift(body(), np.ones(3, np.float32), np.ones(3, np.float32))


# -- laws -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def scene():
    with jax.enable_x64(True):
        rng = np.random.default_rng(5)
        M, V = random_inertia((50,)), motion(js.SpatialVelocity, (50,), "float64")
        R = interpreted(js.Rotation.exp)(rng.standard_normal((50, 3)))
        yield M, V, js.RigidTransform(R, rng.standard_normal((50, 3)))


def _close(a, b, eps=64):
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=eps * 2.2e-16 * (1 + float(np.abs(y).max())))


def _require_equal_pairs(function, *arguments, eps=64):
    """Of all pairs that the function gives."""
    for a, b in interpreted(function)(*arguments):
        _close(a, b, eps)


def test_momentum_of_the_shifted_is_the_shifted_momentum(scene):
    M, V, X = scene
    _require_equal_pairs(lambda M, V, p: [(M.shift(p) @ V.shift(p), (M @ V).shift(p))], M, V, X.translation)


@pytest.mark.parametrize("precision", slow_but(list(js.Precision)[:-1], js.Precision))
def test_kinetic_energy_beyond_the_largest_number_is_an_infinity(precision):
    """Also where m v is, beside terms that w or the centre of mass make zero."""
    with jax.enable_x64(True):
        M = js.SpatialInertia(jnp.asarray(1e300), jnp.zeros(3), jnp.eye(3))
        V = js.SpatialVelocity(jnp.zeros((3, 3)), jnp.asarray([[0, 0, 1e15], [-1e15, 0, 0], [1e200, 1e200, 1.0]]))
        found = evaluated(precision, lambda M, V: M.kinetic_energy(V, precision=precision))(M, V)
    np.testing.assert_array_equal(found, np.full(3, np.inf))


def test_kinetic_energy_does_not_depend_on_point_or_frame(scene):
    def energies(M, V, X):
        p, R = X.translation, X.rotation
        yield M.shift(p).kinetic_energy(V.shift(p))
        yield (R @ M).kinetic_energy(R @ V)
        yield js.act(X, M).kinetic_energy(js.act(X, V))
        yield js.dot(M @ V, V) / 2

    M, V, X = scene
    energy, others = interpreted(lambda M, V, X: (M.kinetic_energy(V), list(energies(M, V, X))))(M, V, X)
    v_cm = V.v + np.cross(V.w, M.com)
    spin = np.einsum("ni,nij,nj->n", V.w, matrix(np.asarray(M.central)), V.w)
    for other in (*others, (M.mass * (v_cm**2).sum(-1) + spin) / 2):
        _close(energy, other)


def test_act_is_rotate_then_shift_and_can_be_undone(scene):
    def pairs(M, V, X):
        yield js.act(X, M), (X.rotation @ M).shift(-X.translation)
        yield js.act_inverse(X, js.act(X, M)), M
        yield js.act_inverse(X, M), js.act(X.inverse(), M)
        yield js.act(X, M) @ js.act(X, V), js.act(X, M @ V)

    _require_equal_pairs(lambda *x: list(pairs(*x)), *scene)
    moved, m, adjoint = interpreted(
        lambda M, V, X: (js.act(X, M).to_matrix(), M.to_matrix(), X.inverse().to_motion_matrix())
    )(*scene)
    _close(moved, np.swapaxes(adjoint, -1, -2) @ m @ adjoint, 256)


def test_rate_of_the_rotated(scene):
    """d/dt (R I R^T) = (w x) I - I (w x), by forward differentiation."""
    M, V, _ = scene

    def rate(M, w):
        return jax.jvp(lambda t: (js.Rotation.exp(t * w) @ M).central_matrix(), (0.0,), (1.0,))[1]

    cross = np.cross(V.w[:, None], np.eye(3)).swapaxes(-1, -2)
    central = matrix(np.asarray(M.central))
    _close(interpreted(rate)(M, V.w), cross @ central - central @ cross)


@pytest.mark.parametrize("dtype", slow_but(["float32"], DTYPES))
def test_no_distance_takes_digits(dtype):
    with jax.enable_x64(dtype == "float64"):
        M = random_inertia((10,), dtype)
        far = np.asarray([1e8, -1e8, 1e8] if dtype != "float16" else [1e4] * 3, jnp.dtype(dtype))
        there = interpreted(lambda M, p: M.shift(p))(M, far)
        back = interpreted(lambda M, p: M.shift(-p))(there, far)
        np.testing.assert_array_equal(back.central, M.central)
        np.testing.assert_array_equal(back.mass, M.mass)
        assert interpreted(js.SpatialInertia.is_physically_valid)(there).all()


def test_identity_and_known_zeros_leave_nothing():
    M = jax.tree.map(jnp.asarray, body())
    identity = js.Rotation.identity(dtype=jnp.float32)
    assert jax.make_jaxpr(lambda M: identity @ M)(M).eqns == []
    shifted = jax.make_jaxpr(lambda M: M.shift(np.float32([0, 0, 2])))(M)
    assert [e.primitive.name for e in shifted.eqns].count("jaxspatial_difference") == 1


# -- Drake's examples -------------------------------------------------------------------------------------------------


def test_reexpress_about_x_exchanges_y_and_z():
    with jax.enable_x64(True):
        x, y, z = 0.2, 1.0, 0.5
        M = js.SpatialInertia(1.3, [0.0, 0, 0], 1.3 / 12 * np.diag([y * y + z * z, x * x + z * z, x * x + y * y]))
        R = js.Rotation.from_matrix(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]))
        turned = interpreted(lambda M, R, p: R @ M.shift(p))(M, R, np.array([0.0, 1, 0]))
        np.testing.assert_array_equal(turned.com, [0, 0, -1])
        np.testing.assert_array_equal(turned.central, np.asarray(M.central)[[0, 1, 5, 3, 4, 2]])


def test_reexpress_of_a_full_inertia():
    entries = [
        17.36933842091061,
        -3.084298624204901,
        13.60270381717411,
        -3.634144189476002,
        -6.539290790868233,
        10.02795776191528,
    ]
    expected = [
        6.369894432933752,
        1.134877977228511,
        18.38428249710324,
        6.018249975302059,
        -0.6136491084717202,
        16.24582306996301,
    ]

    def both(a, b, c, entries):
        R = js.Rotation.about_x(a) @ js.Rotation.about_y(b) @ js.Rotation.about_z(c)
        M = js.SpatialInertia(1.0, [0.0, 0, 0], entries)
        return (R.inverse() @ M).central, (R @ M).central

    with jax.enable_x64(True):
        found = interpreted(both)(*np.deg2rad([30.0, 70, -70]), np.array(entries))
        assert min(np.abs(x - expected).max() for x in found) <= 8 * 2.2e-16 * 20


def test_shift_of_a_cylinder():
    with jax.enable_x64(True):
        m, r, length = 1.2, 0.05, 1.5
        across, along = m * (3 * r * r + length**2) / 12, m * r * r / 2
        M = js.SpatialInertia(m, [0.0, 0, 0], np.diag([across, along, across]))
        M = interpreted(lambda M, p: M.shift(p))(M, np.array([0, length / 2, 0]))
        np.testing.assert_array_equal(M.com, [0, -length / 2, 0])
        np.testing.assert_allclose(
            np.diag(interpreted(js.SpatialInertia.inertia_about_origin)(M)),
            [across + m * length**2 / 4, along, across + m * length**2 / 4],
            rtol=1e-15,
        )


def test_central_inertia_far_away():
    with jax.enable_x64(True):
        M = js.SpatialInertia(2.0, [3.0, 4.0, 5.0], np.diag([6.0, 7, 8]))
        about, is_valid = interpreted(lambda M: (M.inertia_about_origin(), M.is_physically_valid()))(M)
        np.testing.assert_array_equal(six_of(about), [88, -24, 75, -30, -40, 58])
        assert is_valid


def test_from_origin_undoes_inertia_about_origin():
    with jax.enable_x64(True):
        M = random_inertia((30,))
        m, c, i = exactly(M)
        about = six_of(interpreted(lambda M: M.inertia_about_origin(precision="faithful"))(M))
        assert (abs(rationals(about) - (i + steiner(m, c))) <= error.ulp(i + steiner(m, c), "float64")).all()
        from_origin = js.SpatialInertia.from_origin
        back, again = interpreted(
            lambda M: (
                from_origin(M.mass, M.com, M.inertia_about_origin(), precision="compensated"),
                js.SpatialInertia.from_matrix(M.to_matrix()),
            )
        )(M)
        _close(back.central, M.central, 16)
        _close(again, M, 32)


# -- transformations --------------------------------------------------------------------------------------------------

FUNCTIONS = {
    "from_origin": lambda M: js.SpatialInertia.from_origin(M.mass, M.com, M.central),
    "to_matrix": lambda M: M.to_matrix(),
    "from_matrix": lambda M: js.SpatialInertia.from_matrix(M.to_matrix()),
    "dynamic_parameters": lambda M: js.SpatialInertia.from_dynamic_parameters(M.to_dynamic_parameters()),
    "pseudo_inertia": lambda M: js.SpatialInertia.from_pseudo_inertia(M.to_pseudo_inertia()),
    "log_cholesky": lambda M: js.SpatialInertia.from_log_cholesky(M.to_log_cholesky()),
    "combine": lambda M: (M + M.shift(M.com * 2.0)) - M,
    "slack": lambda M: M.validity_slack(),
    "nearest": lambda M: M.nearest_valid(),
    "moments": lambda M: M.principal_moments_and_axes(),
    "ellipsoid": lambda M: M.equivalent_ellipsoid(),
    "box": lambda M: M.equivalent_box(),
    "length": lambda M: M.minimum_length(),
    "central": lambda M: M.central_matrix(),
}


# What runs by default: sums of products, quotients, a loop.
FEW = ("dynamic_parameters", "combine")


def _sum_of_all(name, M):
    """One number that depends on all that a function gives."""
    return sum(x.astype(jnp.float32).sum() for x in jax.tree.leaves(FUNCTIONS[name](M)))


@pytest.mark.parametrize("name", slow_but(FEW, FUNCTIONS))
@compiled_as_for_users()
def test_transformations(name):
    """The same bits in NumPy, and compiled for one item mapped over two axes; a derivative that is finite
    everywhere."""
    M = random_inertia((2, 3), "float32")
    mapped = jax.jit(jax.vmap(jax.vmap(FUNCTIONS[name])))(M)
    chex.assert_trees_all_equal(jax.tree.map(np.asarray, mapped), interpreted(FUNCTIONS[name])(M), strict=True)
    gradient = interpreted(jax.grad(lambda M: _sum_of_all(name, M)))(M)
    chex.assert_tree_all_finite(gradient)


@pytest.mark.parametrize("dtype", slow_but(["bfloat16"], DTYPES))
def test_the_dtype_of_the_parts_rules(dtype):
    """Every result has it, and is as near to that of twice the digits as rounding the parts lets it be."""
    with jax.enable_x64(True):
        wide = random_inertia((5,), "float64", 11)
        expected = interpreted(lambda M: [f(M) for f in FUNCTIONS.values()])(wide)
    with jax.enable_x64(dtype == "float64"):
        M = random_inertia((5,), dtype, 11)
        found = interpreted(lambda M: [f(M) for f in FUNCTIONS.values()])(M)
        for x, y in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
            assert x.dtype == jnp.dtype(dtype)
            error = np.abs(np.asarray(x, np.float64) - np.asarray(y))
            assert (error <= 500 * float(jnp.finfo(dtype).eps) * np.abs(np.asarray(y)).max()).all()


@pytest.mark.parametrize("name", slow_but(FEW, FUNCTIONS))
def test_double_words(name):
    """What takes double words gives them, as near to what float64 gives as both get."""
    M = random_inertia((3,), "float32")
    pair = interpreted(lambda M: js.from_double_word(FUNCTIONS[name](js.to_double_word(M))))(M)
    for x, y in zip(jax.tree.leaves(pair), jax.tree.leaves(interpreted(FUNCTIONS[name])(M)), strict=True):
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-4 * (1 + float(np.abs(np.asarray(y)).max())))
