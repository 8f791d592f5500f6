"""The page on quadrupeds, in few steps; its picture, which was made by its code."""

import importlib.metadata

import numpy as np
import pytest

from tests.helpers.pages import FOLDER, run_page

FILE = FOLDER / "quadrupeds.webp"


@pytest.fixture(scope="module")
def page():
    if "example-robot-data" not in {x.metadata["Name"] for x in importlib.metadata.distributions()}:
        pytest.skip('example-robot-data is not installed: python -m pip install -e ".[test,peers]"')
    return run_page("quadrupeds.md", STEPS=20, PUSHED=10, SIDE=2)


# By default `test_readme` looks at its code: steps with contact, and their gradient, compile for long.
@pytest.mark.slow
def test_the_code_of_the_page_runs(page):
    """Pushes along x and y move the trunk that way; the slope is that of differences."""
    path, pushes = np.asarray(page["path"]), np.asarray(page["pushes"])
    assert path.shape == (4, 20, 19) and np.isfinite(path).all()
    moved = path[:, -1, 4:6] - path[:, 0, 4:6]
    assert (np.sum(moved * pushes[:, :2], axis=1)[2:] > 0.1).all()
    push = np.float32([0.0, 20.0, 0.0])
    heights = [float(page["height"](push + np.float32([0.0, dy, 0.0]))) for dy in (-1.0, 1.0)]
    np.testing.assert_allclose(page["slope"][1], (heights[1] - heights[0]) / 2, rtol=0.1, atol=2e-6)


def test_the_picture_moves_and_is_small():
    image = pytest.importorskip("PIL.Image")
    with image.open(FILE) as kept:
        assert kept.n_frames == 30 and kept.size == (880, 430) and FILE.stat().st_size < 1.5e6


@pytest.mark.slow
def test_the_code_of_the_picture_draws_robots(page):
    """Of a path: blue and orange ones."""
    pytest.importorskip("PIL.Image")
    pytest.importorskip("matplotlib")
    from tests.helpers import quadrupeds_picture

    names = dict(page, path=np.repeat(np.asarray(page["path"]), 8, axis=0)[:25])
    pictures = list(quadrupeds_picture.drawn({**names, "pushes": np.ones((25, 3))}))
    assert len(pictures) == 2 and pictures[0].size == (880, 430)
    pixels = np.asarray(pictures[0], float)
    assert (pixels[..., 2] > pixels[..., 0] + 60).mean() > 1e-3


@pytest.mark.slow
def test_what_the_page_tells():
    names = run_page("quadrupeds.md", as_read=True)
    assert 0.2 < np.mean(names["has_fallen"]) < 0.3
    pushes = np.float32([[0, 31, 0], [0, -31, 0], [-34, 0, 0], [0, 25, 0], [-30, 0, 0], [45, 0, 0]])
    heights = names["jax"].vmap(lambda push: names["pushed"](push, names["STEPS"])[-1, 6])(pushes)
    assert ((np.asarray(heights) < 0.15) == [True, True, True, False, False, False]).all()
