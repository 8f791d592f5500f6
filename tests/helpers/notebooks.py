"""Runs the notebooks: as a reader does, by papermill, in a process of its own; or soon, in this one."""

import ast
import contextlib
import io
import json
import pathlib
import tempfile
import warnings
from unittest import mock

from tests.helpers import figures, pages
from tests.helpers.optional import needs

FOLDER = pathlib.Path(__file__).parent.parent.parent / "notebooks"
WATCHED = f"import sys\nsys.path.append({str(FOLDER.parent)!r})\nfrom tests.helpers import figures\nfigures.watch()"


def as_a_reader(name, **parameters):
    """What the notebook prints; parameters replace numbers of its cell that is tagged "parameters". A figure without
    numbers that differ is an error."""
    papermill = needs("papermill")
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        warnings.simplefilter("ignore")
        source = papermill.iorw.load_notebook_node(str(FOLDER / f"{name}.ipynb"))
        known = {p.name for p in papermill.inspection._infer_parameters(source)}
        _require_known(parameters, known)
        source.cells.insert(0, needs("nbformat").v4.new_code_cell(WATCHED))
        path = pathlib.Path(folder) / f"{name}.ipynb"
        papermill.iorw.write_ipynb(source, str(path))
        found = papermill.execute_notebook(path, None, parameters, cwd=FOLDER, progress_bar=False, log_output=False)
    outputs = [output for cell in found.cells if cell.cell_type == "code" for output in cell.outputs]
    return "".join(output.get("text", "") for output in outputs if output.output_type == "stream")


def soon(name, precision=None, runs_long=False, **parameters):
    """The same, compiled soon, without a kernel that imports everything anew. precision, runs_long: as of
    `pages.run`."""
    return begun(name, None, precision, runs_long, **parameters)[0]


def begun(name, heading, precision=None, runs_long=False, **parameters):
    """(what the notebook prints, all names) up to a heading; None for its end."""
    pyplot, blocks, printed = needs("matplotlib.pyplot"), [], io.StringIO()
    for cell in needs("nbformat").read(FOLDER / f"{name}.ipynb", as_version=4).cells:
        if heading and cell.source.startswith(heading):
            break
        if cell.cell_type != "code":
            continue
        blocks.append(cell.source)
        if "parameters" in cell.metadata.get("tags", ()):
            _require_known(parameters, {x.id for line in ast.parse(cell.source).body for x in _assigned(line)})
            blocks.append("\n".join(f"{key} = {value!r}" for key, value in parameters.items()))
        blocks.append("__import__('matplotlib.pyplot').pyplot.close('all')")
    else:
        assert heading is None, f"no cell begins with {heading!r}"
    with warnings.catch_warnings(), contextlib.redirect_stdout(printed), contextlib.chdir(FOLDER):
        warnings.simplefilter("ignore")
        with mock.patch.object(pyplot, "show", pyplot.show), pyplot.rc_context(), mock.patch.dict("os.environ"):
            figures.watch()
            names = pages.run(blocks, precision, runs_long=runs_long)
    return printed.getvalue(), names


def _assigned(line):
    return [x for x in getattr(line, "targets", ()) if isinstance(x, ast.Name)]


def _require_known(parameters, known):
    assert parameters.keys() <= known, f"no parameters of the notebook: {parameters.keys() - known}"


def last_numbers(printed):
    """What the last cell of a notebook prints as JSON."""
    return json.loads(printed.strip().splitlines()[-1])
