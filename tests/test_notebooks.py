"""The notebooks run from top to bottom, and what is committed shows their results."""

import pathlib

import jax
import matplotlib.pyplot as plt
import pytest

import jaxspatial as js
from tests.helpers.optional import needs

nbformat = needs("nbformat")

NOTEBOOKS = sorted((pathlib.Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
@pytest.mark.filterwarnings("ignore")
def test_notebook_runs(path, monkeypatch):
    """In this process, as a kernel for each would import everything anew; what asks for no precision, in the one that
    compiles soonest."""
    cells = [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.outputs)
    plt.switch_backend("agg")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    scope = {"__name__": "__main__"}
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"), js.default_precision("fast"):
        for i, cell in enumerate(cells):
            exec(compile(cell.source, f"{path.name}, code cell {i}", "exec"), scope)
