"""The page on learners fits an arm by least squares, and then by bodies that exist: what both promise."""

import jax
import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.pages import FOLDER, examples, run

SECTION = "## Least squares, and bodies that exist"


@pytest.fixture(scope="module")
def page():
    """All names after the section has run, alone."""
    text = (FOLDER / "learning.md").read_text()
    return run(examples(text.partition(SECTION)[2].partition("\n## ")[0]))


def deviations(page, found, covariance, rank):
    """What is wrong in a fit, in standard deviations of the combinations of parameters that it determines: (rank,)."""
    size = np.linalg.norm(page["Y"], axis=0)
    size = np.where(size > 1e-10 * size.max(), size, size.max())
    variances, combinations = np.linalg.eigh(covariance * np.outer(size, size))
    assert variances[-rank] > 1e-9 * variances[-1] > 1e3 * abs(variances[:-rank]).max()
    return combinations[:, -rank:].T @ (size * (found - page["truth"])) / np.sqrt(variances[-rank:])


def test_the_rank_is_the_number_of_base_parameters(page):
    """Of hinges: seven of each link; of the first, about a vertical axis, the moment about it alone."""
    assert page["rank"] == 7 + 7 + 1
    assert np.linalg.matrix_rank(page["covariance"] / page["covariance"].max(), hermitian=True) <= 15
    unseen = np.linalg.norm(page["Y"], axis=0) < 1e-10
    deviation = np.sqrt(np.diag(page["covariance"]))
    assert unseen.any() and deviation[unseen].max() < 1e-12 * deviation.max()
    np.testing.assert_allclose(page["estimate"][unseen], page["prior"][unseen], rtol=0, atol=1e-12)


def test_estimates_are_within_their_covariance(page):
    """Of 40 draws of the noise, squares in standard deviations have the mean of chi squared, up to 5 of its own."""
    Y, prior, rng = page["Y"], page["prior"], np.random.default_rng(1)
    squares = []
    for _ in range(40):
        tau = Y @ page["truth"] + page["NOISE"] * rng.standard_normal(len(Y))
        estimate, covariance, rank = page["least_squares"](Y, tau, prior)
        squares.append(np.sum(deviations(page, estimate, covariance, rank) ** 2))
    assert abs(np.mean(squares) - 15) < 5 * np.sqrt(2 * 15 / 40)
    exact, *_ = page["least_squares"](Y, Y @ page["truth"], prior)
    np.testing.assert_allclose(Y @ exact, Y @ page["truth"], rtol=0, atol=1e-11)


def test_bodies_exist_and_explain_the_torques_as_well(page):
    """Where the page begins with balls. From plates it is stuck, as it says."""
    with jax.enable_x64(True):
        bodies, fitted = page["bodies"], page["fitted"]
        assert bodies.is_physically_valid().all() and not fitted.is_physically_valid().all()
        found = np.asarray(bodies.to_dynamic_parameters()).ravel()
        balls = page["ball"](page["plates"])
        np.testing.assert_allclose(balls.mass, page["plates"].mass, rtol=1e-15)
        np.testing.assert_allclose(balls.validity_slack(), 1 / 3, rtol=1e-12)
    error, least = (page["tau"] - page["Y"] @ x for x in (found, page["estimate"]))
    assert (error @ error - least @ least) / 2 < 0.01 * page["NOISE"] ** 2
    assert np.sum(deviations(page, found, page["covariance"], page["rank"]) ** 2) < 15 + 5 * np.sqrt(2 * 15)
    excess = (np.array([page["of_balls"][-1], page["of_plates"][-1]]) - least @ least / 2 / page["NOISE"] ** 2).tolist()
    assert abs(excess[0]) < 0.01 and excess[1] > 50


def test_the_regressor_is_that_of_inverse_dynamics(page):
    with jax.enable_x64(True):
        tau = js.inverse_dynamics(page["robot"], page["q"][:3], page["v"][:3], page["vdot"][:3], precision="fast")
    np.testing.assert_allclose(page["Y"][:9] @ page["truth"], np.ravel(tau), rtol=0, atol=1e-11)
