"""What the page on learners tells of numbers of contacts: gradients of whole runs, and where they point."""

import re

import jax
import numpy as np
import pytest

from tests.helpers import contact_laws as laws
from tests.helpers.interpreted import interpreted
from tests.helpers.pages import FOLDER

SECTION = (FOLDER / "learning.md").read_text().partition("## Numbers of contacts")[2].partition("\n## ")[0]


@pytest.fixture(autouse=True)
def _x64():
    with jax.enable_x64(True):
        yield


@pytest.mark.parametrize("law", [laws.Law(1e-2, 16), laws.Law(5e-3, 25, 0.3)], ids=["convex_step", "contact_forces"])
@pytest.mark.slow
def test_gradients_of_whole_runs_are_differences(law):
    """By all five numbers at once, from a half to twice the true ones, of boxes that fall, slide and turn over."""
    n, apart, (q, v) = len(laws.NUMBERS), 1e-7, laws.throws(12, highest=0.05)
    at = np.random.default_rng(1).uniform(-np.log(2), np.log(2), (12, n))
    around = at[:, None] + apart * np.concatenate([np.eye(n), -np.eye(n)])
    around = np.concatenate([around, np.zeros((12, 1, n))], 1)
    paths = interpreted(jax.vmap(jax.vmap(lambda *x: laws.path(law, *x), (0, None, None))))(around, q, v)
    truth = paths[:, -1]
    found = interpreted(jax.vmap(jax.jacrev(lambda *x: laws.losses(law, *x))))(at, q, v, truth)

    squares = ((paths[:, :-1] - truth[:, None]) ** 2).sum(-1).mean(-1)
    near = np.stack([squares[..., -1], squares.mean(-1)], 1)
    expected = (near[..., :n] - near[..., n:]) / (2 * apart)
    size = near.max(-1, keepdims=True)
    assert (abs(found - expected) <= 1e-4 * abs(expected) + 1e-5 * size).all()
    assert (abs(expected) > 1e-2 * size).mean((0, 1)).min() > 0.5


@pytest.mark.slow
def test_the_table_tells_where_gradients_point():
    """To five in a hundred, as the last bits of a run that diverges are those of a machine."""
    _, _, *told = re.findall(r"^\|.*\|$", SECTION, re.M)
    rows, found = zip(*laws.table(), strict=True)
    for row, expected in zip(told, rows, strict=True):
        (law, _, shares), (of, _, computed) = row.partition(" ms "), expected.partition(" ms ")
        assert law == of
        told_and_computed = (list(map(int, re.findall(r"\d+", x))) for x in (shares, computed))
        np.testing.assert_allclose(*told_and_computed, rtol=0, atol=5)
    of_one_throw = re.search(
        r"path in (\d+) % of the cases of the first row, and in (\d+) % of those of the last", SECTION
    )
    assert of_one_throw
    first_and_last = [100 * x.of_one[0, 1] for x in (found[0], found[-1])]
    np.testing.assert_allclose(list(map(int, of_one_throw.groups())), first_and_last, rtol=0, atol=5)


@pytest.mark.slow
def test_three_numbers_are_learned_together():
    pytest.importorskip("optax")
    with jax.numpy_dtype_promotion("standard"):  # optax mixes dtypes
        found = [laws.learned(laws.LAWS[i]) for i in (0, 2, 4, 5)]
    off = [abs(x - 1).max(1) for x in found]
    assert off[0].max() < 0.005 and 0.005 < off[1].max() < 0.015
    np.testing.assert_allclose(found[1], found[1][[0] * 8], rtol=1e-3)
    assert np.sum(off[2] < off[0].max() / 10) > 4 and np.any(off[2] > 0.1)
    assert off[3].min() > 0.1
