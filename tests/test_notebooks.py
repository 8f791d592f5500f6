"""The notebooks run from top to bottom, and what is committed shows their results.

Those with numbers of their own to check have tests of their own, `test_page_*.py`."""

import pytest

from tests.helpers.marks import slow
from tests.helpers.notebooks import FOLDER, executed
from tests.helpers.optional import needs

nbformat = needs("nbformat")

NAMES = [path.stem for path in sorted(FOLDER.glob("*.ipynb"))]


@pytest.mark.parametrize("name", NAMES)
def test_pictures_are_shown(name):
    cells = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.get("outputs", ()))
    assert not any(output.output_type == "error" for cell in cells for output in cell.get("outputs", ()))


@pytest.mark.parametrize("name", [name for name in NAMES if name < "04"])
@pytest.mark.parametrize("compiled_soon", [True, slow(False)], ids=lambda x: "soon" if x else "as a reader does")
def test_it_runs(name, compiled_soon):
    executed(name, compiled_soon)
