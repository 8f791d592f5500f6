"""The notebooks run from top to bottom, and what is committed shows their results."""

import os
import pathlib

import pytest

from tests.helpers.optional import needs

nbclient, nbformat = needs("nbclient"), needs("nbformat")

NOTEBOOKS = sorted((pathlib.Path(__file__).parent.parent / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
@pytest.mark.filterwarnings("ignore")
def test_notebook_runs(path, monkeypatch):
    monkeypatch.setitem(os.environ, "PYTHONPATH", str(path.parent.parent))
    notebook = nbformat.read(path, as_version=4)
    shown = [cell for cell in notebook.cells if cell.cell_type == "code" and cell.get("outputs")]
    assert any("image/png" in output.get("data", {}) for cell in shown for output in cell.outputs)
    nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3").execute()
