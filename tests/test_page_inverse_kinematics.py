"""The page on inverse kinematics and operational space: its numbers, and its formulas against their definitions."""

import functools
import importlib.metadata

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.interpreted import interpreted
from tests.helpers.pages import run_page


@functools.cache
def page(**sizes):
    if "example-robot-data" not in {x.metadata["Name"] for x in importlib.metadata.distributions()}:
        pytest.skip('example-robot-data is not installed: python -m pip install -e ".[test,peers]"')
    return run_page("inverse_kinematics.md", **sizes)


@pytest.fixture(scope="module")
def names():
    return page(TARGETS=100)


def _assert_told(names):
    """That which the page asserts, and tells in prose."""
    assert 0.3 < names["from_one"].is_solved.mean() < 0.7 and names["found"].is_solved.mean() > 0.99
    assert 4 < names["gained"] < 6
    assert 2e-4 < names["distance"][0].max() < 4e-4 and 1.5e-3 < names["distance"][1].max() < 3e-3
    assert abs(names["lag"]).max() < 1e-3


@pytest.mark.slow
def test_what_the_page_tells(names):
    _assert_told(names)


@pytest.mark.slow
def test_what_the_page_tells_of_a_thousand():
    _assert_told(page(as_read=True))


@pytest.mark.slow
def test_solutions_are_poses_of_the_hand(names):
    """By another logarithm: angle and distance from matrices in NumPy."""
    panda, q = names["panda"], np.asarray(names["q"])
    X, X_WT = js.forward_kinematics(panda, q, names["HAND"]), names["X_WT"]
    R, R_T = (np.asarray(x.rotation.to_matrix(), np.float64) for x in (X, X_WT))
    sine = np.linalg.norm(R - R_T, axis=(1, 2)) / np.sqrt(8)
    is_solved = np.asarray(names["found"].is_solved)
    assert (2 * np.arcsin(sine))[is_solved].max() < 1.02e-4
    assert np.linalg.norm(np.asarray(X.translation - X_WT.translation), axis=1)[is_solved].max() < 1.02e-4
    assert (q >= panda.lower).all() and (q <= panda.upper).all()


def test_the_jacobian_is_that_of_the_error(names):
    """Beside the factor that the page leaves out."""
    q = names["q_start"]
    X_WT = js.forward_kinematics(names["panda"], q + 0.2, names["HAND"])
    with jax.numpy_rank_promotion("allow"):
        (e, J), slope = interpreted(
            lambda q: (names["error"](q, X_WT), jax.jacfwd(lambda q: names["error"](q, X_WT)[0])(q))
        )(q)
    factor = js.RigidTransform.left_jacobian_inverse(js.SpatialVelocity.from_array(e))
    np.testing.assert_allclose(-factor @ J, slope, rtol=0, atol=1e-5)
    assert abs(-J - slope).max() > 0.05


def test_the_terms_of_operational_space(names):
    """A wrench at the hand accelerates it by Lambda^-1, mu and p hold it, and torques of the null space do nothing."""
    panda, v = names["panda"], jnp.linspace(-1.0, 1.0, 7)
    q, F, tau_0 = names["q_start"] + 0.1, 0.1 * jnp.arange(6.0), jnp.linspace(3.0, -5.0, 7)

    @interpreted
    def accelerations(q, v):
        J, Lambda, J_bar, mu, p = names["operational_space"](q, v)
        null = tau_0 - J.T @ (J_bar.T @ tau_0)
        F_all = J.T @ (F + mu + p)

        def of_hand(tau):
            vdot = js.forward_dynamics(panda, q, v, tau)
            return js.body_accelerations(panda, q, v, vdot, names["HAND"]).to_array()

        found = jax.vmap(of_hand)(jnp.stack([F_all, F_all + null, F_all - J.T @ mu]))
        return jnp.linalg.solve(Lambda, F), found

    with jax.numpy_rank_promotion("allow"):
        asked, (all_terms, with_null, without_mu) = accelerations(q, v)
    scale = abs(asked).max()
    np.testing.assert_allclose(all_terms, asked, rtol=0, atol=1e-3 * scale)
    np.testing.assert_allclose(with_null, asked, rtol=0, atol=1e-3 * scale)
    assert abs(without_mu - asked).max() > 1e-2 * scale


def test_gradients_are_finite_at_singular_configurations(names):
    """Of the step and of the manipulability, at joint angles where axes are in line."""
    at = jnp.stack([jnp.zeros(7), jnp.array([0.0, 0, 0, -np.pi / 2, 0, 0, 0]), jnp.array([1.0, 0, 0, 0, 0, 0, 1.0])])
    target = names["X_WT"].at_batch(0)

    def both(q):
        return jax.jacfwd(lambda q: names["improved"](q, target))(q), jax.grad(names["log_manipulability"])(q)

    with jax.numpy_rank_promotion("allow"):
        slopes = interpreted(jax.vmap(both))(at)
    assert all(jnp.isfinite(x).all() for x in slopes)


def test_the_picture_can_be_drawn_again(names, tmp_path):
    """In the size of the one beside the page, and of few bytes."""
    pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    from tests.helpers import kinematics_picture

    kinematics_picture.save(tmp_path / "again.png", names)
    assert imread(tmp_path / "again.png").shape == imread(kinematics_picture.FILE).shape
    assert kinematics_picture.FILE.stat().st_size < 100_000
