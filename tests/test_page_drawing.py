"""The page on drawing: a quadruped in a figure, and its fall in a recording."""

import importlib.metadata

import matplotlib.image
import numpy as np
import pytest

from tests.helpers.pages import run_page


def test_a_quadruped_drops_and_stands(tmp_path, monkeypatch):
    """The forces that the recording shows carry its weight in the end."""
    pytest.importorskip("viser", reason="the extra `view` is not installed")
    if "example-robot-data" not in {x.metadata["Name"] for x in importlib.metadata.distributions()}:
        pytest.skip("the extra docs has the robot")
    monkeypatch.chdir(tmp_path)
    page = run_page("drawing.md")
    weight = 9.81 * float(np.sum(page["solo"].inertias.mass))
    f = np.asarray(page["forces"].f)
    assert not f[:10].any()  # in the air
    np.testing.assert_allclose(f[-100:].mean(0).sum(0), [0, 0, weight], rtol=0, atol=0.02 * weight)
    assert page["trajectory"][-1, 6] > 0.2
    picture = matplotlib.image.imread(tmp_path / "solo.png")
    assert (picture[..., :3].min(-1) < 0.5).mean() > 1e-3
    assert "<html" in (tmp_path / "solo.html").read_text()[:1000]
