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
WATCHED = f"import sys\nsys.path.append({str(FOLDER.parent)!r})\nfrom tests.helpers import figures\nfigures.watch()"


def executed(name, compiled_soon=True, first="", **parameters):
    """The notebook with its outputs; parameters replace numbers of its cell that is tagged "parameters". first: code
    that runs before. A figure without numbers that differ is an error."""
    papermill = needs("papermill")
    with warnings.catch_warnings(), mock.patch.dict(os.environ, soon.environment() if compiled_soon else {}):
        warnings.simplefilter("ignore")
        source = papermill.iorw.load_notebook_node(str(FOLDER / f"{name}.ipynb"))
        known = {p.name for p in papermill.inspection._infer_parameters(source)}
        assert parameters.keys() <= known, f"no parameters of {name}: {parameters.keys() - known}"
        with tempfile.TemporaryDirectory() as folder:
            source.cells.insert(0, needs("nbformat").v4.new_code_cell(f"{WATCHED}\n{first}"))
            path = pathlib.Path(folder) / f"{name}.ipynb"
            papermill.iorw.write_ipynb(source, str(path))
            return papermill.execute_notebook(path, None, parameters, cwd=FOLDER, progress_bar=False, log_output=False)


def last_numbers(notebook):
    """What the last cell of a notebook prints as JSON."""
    cell = [cell for cell in notebook.cells if cell.cell_type == "code"][-1]
    text = "".join(output.get("text", "") for output in cell.outputs)
    return json.loads(text.strip().splitlines()[-1])
