"""Runs the notebooks as a reader does, in a process of their own, by papermill."""

import json
import os
import pathlib
import tempfile
import warnings
from unittest import mock

from tests.helpers import soon
from tests.helpers.optional import needs

FOLDER = pathlib.Path(__file__).parent.parent.parent / "notebooks"


def executed(name, compiled_soon=True, first=None, **parameters):
    """The notebook with its outputs; parameters replace numbers of its cell that is tagged "parameters". first: code
    that runs before."""
    papermill = needs("papermill")
    with warnings.catch_warnings(), mock.patch.dict(os.environ, soon.environment() if compiled_soon else {}):
        warnings.simplefilter("ignore")
        source = papermill.iorw.load_notebook_node(str(FOLDER / f"{name}.ipynb"))
        known = {p.name for p in papermill.inspection._infer_parameters(source)}
        assert parameters.keys() <= known, f"no parameters of {name}: {parameters.keys() - known}"
        path = FOLDER / f"{name}.ipynb"
        with tempfile.TemporaryDirectory() as folder:
            if first:
                source.cells.insert(0, needs("nbformat").v4.new_code_cell(first))
                path = pathlib.Path(folder) / path.name
                papermill.iorw.write_ipynb(source, str(path))
            return papermill.execute_notebook(path, None, parameters, cwd=FOLDER, progress_bar=False, log_output=False)


def last_numbers(notebook):
    """What the last cell of a notebook prints as JSON."""
    cell = [cell for cell in notebook.cells if cell.cell_type == "code"][-1]
    text = "".join(output.get("text", "") for output in cell.outputs)
    return json.loads(text.strip().splitlines()[-1])
