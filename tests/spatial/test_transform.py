"""RigidTransform as a type: construction, laws, structure that folds, trees and transformations, double words."""

import pickle

import chex
import jax
import jax.export
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import evaluated, interpreted
from tests.helpers.marks import slow_but

EPS = float(np.finfo(np.float32).eps)


def transforms(count, seed=0, dtype=np.float32):
    rng = np.random.default_rng(seed)
    w, v = (rng.standard_normal((count, 3)).astype(dtype) for _ in range(2))
    return interpreted(js.RigidTransform.exp)(js.SpatialVelocity(w, v))


def points(count, seed=1):
    return np.random.default_rng(seed).standard_normal((count, 3)).astype(np.float32)


def matrices(X):
    return np.asarray(X.to_matrix(), float)


def near(a, b, tolerance=16 * EPS):
    np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=0, atol=tolerance)


# -- laws -------------------------------------------------------------------------------------------------------------


def test_to_matrix_and_back():
    X = transforms(5)
    m = matrices(X)
    np.testing.assert_array_equal(m[:, 3], np.tile([0, 0, 0, 1], (5, 1)))
    np.testing.assert_array_equal(m[:, :3, :3], np.asarray(X.rotation.to_matrix()))
    np.testing.assert_array_equal(m[:, :3, 3], np.asarray(X.translation))
    again = interpreted(lambda X: js.RigidTransform.from_matrix(X.to_matrix()))(X)
    chex.assert_trees_all_equal(again, X)


@pytest.mark.parametrize("precision", slow_but(["reproducible", "compensated"], js.Precision))
def test_products_are_those_of_matrices(precision):
    X, Y, p = transforms(7), transforms(7, 2), points(7)
    m, n, homogeneous = matrices(X), matrices(Y), np.concatenate((p, np.ones((7, 1))), 1)

    def products(X, Y, p):
        with js.default_precision(precision):
            motions = X @ Y, X.inverse(), X.inverse_times(Y), (X @ Y) @ X, X @ (Y @ X)
            return motions, X @ p, X.inverse() @ (X @ p)

    (product, inverse, relative, *twice), moved, back = evaluated(precision, products)(X, Y, p)
    near(matrices(product), m @ n)
    near(moved, np.einsum("nij,nj->ni", m, homogeneous)[:, :3])
    near(matrices(inverse), np.linalg.inv(m))
    near(matrices(relative), np.linalg.inv(m) @ n)
    near(back, p)
    near(*map(matrices, twice))


def test_poses_far_away_and_near_each_other():
    """`inverse_times` takes the difference first: 1e6 m out, millimetres keep their digits."""
    X = transforms(3)
    far = js.RigidTransform(X.rotation, X.translation + np.float32(1e6))
    other = js.RigidTransform(X.rotation, far.translation + np.float32(0.125))
    expected = np.einsum("nji,j->ni", matrices(X)[:, :3, :3], [0.125] * 3)
    near(interpreted(js.RigidTransform.inverse_times)(far, other).translation, expected, EPS)


def test_motion_matrix_is_what_act_does():
    X, V = transforms(4), js.SpatialVelocity(points(4), points(4, 5))
    F = js.SpatialForce(points(4, 6), points(4, 7))
    m, V_A, F_A = interpreted(lambda X, V, F: (X.to_motion_matrix(), js.act(X, V), js.act(X, F)))(X, V, F)
    near(np.einsum("nij,nj->ni", m.astype(float), np.concatenate(V._vectors, -1)), np.concatenate(V_A._vectors, -1))
    back = np.linalg.inv(m.astype(float))
    near(np.einsum("nji,nj->ni", back, np.concatenate(F._vectors, -1)), np.concatenate(F_A._vectors, -1))


def test_adjoint_of_exp_is_the_exponential_of_the_cross_product():
    """exp(V) with its Jacobian: Ad = 1 + ad J, J the left Jacobian."""

    def of(V):
        units = [js.SpatialVelocity.from_array(jnp.tile(jnp.eye(6)[k], (6, 1))) for k in range(6)]
        jacobians = js.RigidTransform.left_jacobian(V), js.RigidTransform.left_jacobian_inverse(V)
        return js.RigidTransform.exp(V).to_motion_matrix(), *jacobians, [js.cross(V, unit).to_array() for unit in units]

    adjoint, J, inverse, columns = interpreted(of)(js.SpatialVelocity(points(6), points(6, 3)))
    ad = np.stack(columns, -1).astype(float)
    near(adjoint, np.eye(6) + ad @ J.astype(float), 64 * EPS)
    near(J.astype(float) @ inverse.astype(float), np.tile(np.eye(6), (6, 1, 1)), 64 * EPS)


def test_interpolation_moves_on_a_screw():
    """Constant velocity: equal steps; about the axis, the distance to it stays."""
    X, Y = transforms(5), transforms(5, 4)

    def moved(X, Y):
        steps = [X.interpolate(Y, jnp.full(5, t, jnp.float32)) for t in (0.0, 0.25, 0.5, 0.75, 1.0)]
        return steps, [a.inverse_times(b) for a, b in zip(steps, steps[1:], strict=False)]

    steps, between = interpreted(moved)(X, Y)
    relative = list(map(matrices, between))
    for m in relative[1:]:
        near(m, relative[0], 64 * EPS)
    near(matrices(steps[-1]), matrices(Y), 64 * EPS)


# -- construction -----------------------------------------------------------------------------------------------------


def test_what_is_refused():
    R, X = js.Rotation.identity(dtype=np.float32), transforms(2)
    p, V = np.ones(3, np.float32), js.SpatialVelocity.zero(dtype=np.float32)
    F = js.SpatialForce.zero(dtype=np.float32)
    refused = [
        (TypeError, "RigidTransform: rotation: expected a Rotation, got ndarray", lambda: js.RigidTransform(p, p)),
        (TypeError, "RigidTransform: rotation: expected a Rotation, got ndarray", lambda: js.RigidTransform(p, 0)),
        (
            ValueError,
            r"RigidTransform: translation: expected shape .*, got \(2,\)",
            lambda: js.RigidTransform(R, p[:2]),
        ),
        (TypeError, "RigidTransform: translation: expected floating", lambda: js.RigidTransform(R, jnp.arange(3))),
        (TypeError, "rotation: float32, translation: float16", lambda: js.RigidTransform(R, p.astype(np.float16))),
        (ValueError, "rotation: .*translation: ", lambda: js.RigidTransform(X.rotation, np.ones((3, 3), np.float32))),
        (ValueError, r"Rotation: entries: expected shape .*, got \(3, 3\)", lambda: js.Rotation(np.eye(3, dtype="f4"))),
        (
            ValueError,
            r"from_matrix: m: expected shape .*, got \(3, 3\)",
            lambda: js.RigidTransform.from_matrix(np.eye(3)),
        ),
        (ValueError, "from_matrix: m: expected shape", lambda: js.RigidTransform.from_matrix(np.ones((3, 4)))),
        (TypeError, r"exp: expected a SpatialVelocity .*, got SpatialForce", lambda: js.RigidTransform.exp(F)),
        (TypeError, "exp: expected a SpatialVelocity .*, got ndarray", lambda: js.RigidTransform.exp(p)),
        (TypeError, "left_jacobian: expected a SpatialVelocity", lambda: js.RigidTransform.left_jacobian(p)),
        (TypeError, "left_jacobian_inverse: expected", lambda: js.RigidTransform.left_jacobian_inverse(p)),
        (ValueError, "RigidTransform @ p: p: expected shape", lambda: X @ np.ones(4, np.float32)),
        (TypeError, "RigidTransform: float32, p: float16", lambda: X @ np.ones(3, np.float16)),
        (TypeError, "expected points or a RigidTransform, got SpatialVelocity; see act", lambda: X @ V),
        (ValueError, "expected batch shapes that broadcast", lambda: X @ np.ones((3, 3), np.float32)),
        (TypeError, "interpolate: t: expected floating", lambda: X.interpolate(X, jnp.arange(2))),
        (ValueError, "axis 0, 1 or 2, got 3", lambda: js.Rotation.from_one_vector(p, 3)),
        (ValueError, "two different axes", lambda: js.Rotation.from_two_vectors(p, p, (1, 1))),
        (ValueError, "precision: expected one of", lambda: X.log(precision="best")),
    ]
    for kind, words, call in refused:
        with pytest.raises(kind, match=words):
            call()


def test_batches_broadcast():
    X = js.RigidTransform(js.Rotation.identity(dtype=np.float32), np.ones((4, 3), np.float32))
    assert X.batch_shape == X.rotation.batch_shape == (4,)
    Y = js.RigidTransform(transforms(4).rotation, np.ones(3, np.float32))
    assert Y.translation.shape == (4, 3)
    assert (transforms(1) @ points(5)).shape == (5, 3)
    assert js.RigidTransform.identity(2).batch_shape == js.RigidTransform.identity((2,)).batch_shape == (2,)
    assert js.RigidTransform(js.Rotation.identity(dtype=np.float32), [1.0, 2.0, 3.0]).dtype == np.float32


def test_what_the_caller_writes_later_stays_out():
    p, m = np.ones(3, np.float32), np.eye(3, dtype=np.float32)
    X = js.RigidTransform(js.Rotation.from_matrix(m), p)
    p[0] = m[0, 0] = 7
    near(X.to_matrix(), [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [0, 0, 0, 1]], 0)


def test_repr():
    X = js.RigidTransform(js.Rotation.identity(dtype=np.float32), np.float32([1, 2, 3]))
    assert repr(X) == (
        "RigidTransform(Rotation([1.0, 0.0, 0.0; 0.0, 1.0, 0.0; 0.0, 0.0, 1.0]), translation=[1.0, 2.0, 3.0])"
    )
    assert repr(transforms(4)) == "RigidTransform(Rotation(float32[4,9]), translation=float32[4,3])"
    jax.jit(lambda X: print(repr(X)) or X)(X)


# -- structure --------------------------------------------------------------------------------------------------------


def test_the_identity_leaves_no_operation():
    identity, X, p = js.RigidTransform.identity(dtype=np.float32), transforms(1), points(1)[0]
    X = jax.tree.map(lambda leaf: leaf[0], X)

    def arithmetic(f, *arguments):
        text = jax.jit(f).lower(*arguments).as_text()
        return "stablehlo.multiply" in text or "stablehlo.divide" in text

    assert not arithmetic(lambda p: identity @ p, p)
    assert not arithmetic(lambda X: identity @ X, X)
    assert not arithmetic(lambda X: (X @ identity).rotation, X)
    assert not arithmetic(lambda X: identity.inverse_times(X), X)
    assert not arithmetic(lambda p: identity.inverse() @ p, p)
    assert arithmetic(lambda X: X @ X, X)


def test_a_known_translation_alone_is_three_additions():
    shift, p = js.RigidTransform(js.Rotation.identity(dtype=np.float32), np.float32([1, 2, 3])), points(1)[0]
    names = [e.primitive.name for e in jax.make_jaxpr(lambda p: shift @ p)(p).eqns]
    assert "jaxspatial_product" not in names and names.count("jaxspatial_sum") == 3


# -- trees and transformations ----------------------------------------------------------------------------------------


def test_vmap_over_axes_of_a_tree():
    X, p = transforms(4), points(1)[0]
    axes = js.RigidTransform(js.Rotation(0), 0)
    found = jax.vmap(lambda X, p: X @ p, in_axes=(axes, None))(X, p)
    np.testing.assert_array_equal(found, X @ p)
    turned = jax.vmap(lambda X: X @ X, in_axes=(js.RigidTransform(js.Rotation(0), None),), out_axes=0)
    one = js.RigidTransform(X.rotation, p)
    mixed = jax.tree.unflatten(jax.tree.structure(one), [X.rotation.entries, p])
    near(matrices(turned(mixed)), matrices(one @ one), 4 * EPS)
    both = jax.vmap(lambda X: X, out_axes=js.RigidTransform(js.Rotation(1), 1))(X)
    assert both.translation.shape == (3, 4)


def test_trees_are_rebuilt_unchecked():
    X = transforms(4)
    components = jax.tree.map(lambda leaf: leaf[..., 0], X)
    assert components.translation.shape == components.rotation.entries.shape == (4,)
    assert jax.tree.map(lambda _: None, X, is_leaf=lambda x: x is None).translation is None
    structure = jax.tree.structure(X)
    assert jax.tree.unflatten(structure, ["a", object()]).rotation.entries == "a"
    keys = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_flatten_with_path(X)[0]]
    assert keys == [".rotation.entries", ".translation"]


def test_jit_grad_scan_and_cond():
    X, p = transforms(1), points(1)
    X = jax.tree.map(lambda leaf: leaf[0], X)
    np.testing.assert_array_equal(jax.jit(lambda X: X @ p[0])(X), X @ p[0])
    gradient = interpreted(jax.grad(lambda X: (X @ p[0]).sum()))(X)
    np.testing.assert_array_equal(gradient.translation, np.ones(3))
    np.testing.assert_array_equal(gradient.rotation.entries, np.tile(p[0], 3))
    V = js.SpatialVelocity(points(50) / 10, points(50, 2) / 10)
    start = js.RigidTransform.identity(dtype=np.float32)
    end, path = jax.lax.scan(lambda X, V: (X @ js.RigidTransform.exp(V), X.translation), start, V)
    expected = start
    for i in range(50):
        expected = expected @ js.RigidTransform.exp(jax.tree.map(lambda leaf, i=i: leaf[i], V))
    np.testing.assert_array_equal(end.to_matrix(), expected.to_matrix())
    assert path.shape == (50, 3)
    chosen = jax.lax.cond(True, lambda X: X @ X, lambda X: X, X)
    np.testing.assert_array_equal(chosen.to_matrix(), (X @ X).to_matrix())


def test_pickle_and_export():
    X = transforms(3)
    for again in (pickle.loads(pickle.dumps(X)), pickle.loads(pickle.dumps(X.rotation))):
        assert type(again) in (js.RigidTransform, js.Rotation)
    exported = jax.export.export(jax.jit(lambda X: X.inverse()))(X)
    again = jax.export.deserialize(exported.serialize()).call(X)
    np.testing.assert_array_equal(again.to_matrix(), X.inverse().to_matrix())


@pytest.mark.slow
def test_double_words():
    """Every operation carries them; results are near those of float64 to 2^-44."""
    with jax.enable_x64(True):
        exact = transforms(3, dtype=np.float64), transforms(3, 9, dtype=np.float64)
        given = [js.to_double_word(X, np.float32) for X in exact]
        V = js.SpatialVelocity(jnp.ones((3, 3)), jnp.ones((3, 3)) / 3)
        calls = {
            "exp": lambda X, Y, V: js.RigidTransform.exp(V),
            "log": lambda X, Y, V: X.log(),
            "inverse": lambda X, Y, V: X.inverse(),
            "compose": lambda X, Y, V: X @ Y,
            "point": lambda X, Y, V: X @ V.v,
            "inverse_times": lambda X, Y, V: X.inverse_times(Y),
            "to_matrix": lambda X, Y, V: X.to_matrix(),
            "interpolate": lambda X, Y, V: X.interpolate(Y, V.v[:, 0]),
            "motion_matrix": lambda X, Y, V: X.to_motion_matrix(),
            "left_jacobian": lambda X, Y, V: js.RigidTransform.left_jacobian(V),
            "left_jacobian_inverse": lambda X, Y, V: js.RigidTransform.left_jacobian_inverse(V),
            "quaternion": lambda X, Y, V: js.Rotation.from_quaternion(X.rotation.to_quaternion()),
            "rpy": lambda X, Y, V: js.Rotation.from_roll_pitch_yaw(X.rotation.to_roll_pitch_yaw()),
            "axis_angle": lambda X, Y, V: js.Rotation.from_axis_angle(*X.rotation.to_axis_angle()),
            "nearest": lambda X, Y, V: js.Rotation.nearest(X.rotation.to_matrix()),
            "between": lambda X, Y, V: js.Rotation.between(V.v, X.translation),
            "from_two_vectors": lambda X, Y, V: js.Rotation.from_two_vectors(V.v, X.translation),
        }
        for name, call in calls.items():
            found = js.from_double_word(call(*given, js.to_double_word(V, np.float32)), np.float64)
            expected = call(*exact, V)
            assert jax.tree.structure(found) == jax.tree.structure(expected)
            for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
                assert np.abs(np.asarray(a - b)).max() <= 2.0**-44, name
