"""The notebooks run from top to bottom, and what is committed shows their results.

Those with numbers of their own to check have tests of their own, `test_page_*.py`."""

import re

import numpy as np
import pytest

from jaxspatial.measure import checks
from tests.helpers import figures
from tests.helpers.marks import slow, slow_but
from tests.helpers.notebooks import FOLDER, as_a_reader, soon
from tests.helpers.optional import needs
from tests.helpers.pages import faults

nbformat = needs("nbformat")

NAMES = [path.stem for path in sorted(FOLDER.glob("*.ipynb"))]
# Of index.md, the README.
PAGES = [path for path in sorted(FOLDER.iterdir()) if path.suffix in (".md", ".ipynb") and path.name != "index.md"]


def written(path):
    """The text of a page or notebook, without its code."""
    if path.suffix == ".md":
        return re.sub(r"^```.*?^```", "", path.read_text(), flags=re.M | re.S)
    cells = nbformat.read(path, as_version=4).cells
    return "\n\n".join(cell.source for cell in cells if cell.cell_type == "markdown")


@pytest.mark.parametrize("path", [FOLDER.parent / "README.md", *PAGES], ids=lambda path: path.name)
def test_one_title_comes_first(path):
    """And no heading is two levels below the one before it."""
    levels = [len(signs) for signs in re.findall(r"^(#+) ", written(path), re.M)]
    assert levels[0] == 1 and levels.count(1) == 1
    assert written(path).lstrip().startswith("# ")
    assert all(after <= before + 1 for before, after in zip(levels, levels[1:], strict=False))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_fractions_are_in_braces(path):
    """The site sets "frac12" as 12 over what follows."""
    assert not re.findall(r"\\[td]?frac(?!\{)", written(path))


@pytest.mark.parametrize("name", NAMES)
def test_pictures_are_shown(name):
    cells = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells
    assert any("image/png" in output.get("data", {}) for cell in cells for output in cell.get("outputs", ()))
    assert not any(output.output_type == "error" for cell in cells for output in cell.get("outputs", ()))


@pytest.mark.parametrize("name", NAMES)
def test_numbers_of_pictures_are_looked_at(name):
    """`executed` looks at what `plt.show` shows: no picture comes another way."""
    cells = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells
    for cell in cells:
        pictures = sum("image/png" in output.get("data", {}) for output in cell.get("outputs", ()))
        assert pictures == cell.source.count("plt.show()")


def test_a_figure_without_numbers_is_found():
    pyplot = needs("matplotlib.pyplot")
    for bad in ([0.0] * 3, [2.0] * 3, [np.nan] * 3):
        for draw in ("plot", "bar", "barh"):
            figure, ax = pyplot.subplots()
            ax.axhline(1.0)
            getattr(ax, draw)(range(3), bad)
            with pytest.raises(AssertionError, match="nowhere finite|all numbers are equal"):
                figures.require_numbers(figure)
            ax.clear()
            getattr(ax, draw)(range(3), [0.0, 0.0, 1.0])
            figures.require_numbers(figure)
            pyplot.close(figure)


# What these compute in by default, where they say nothing: it compiles soonest.
PRECISIONS = {"01_spatial_algebra": "fast", "03_a_robot": "fast"}


@pytest.mark.parametrize("name", NAMES)
def test_code_is_whole(name):
    """Without running it, see `test_readme.test_code_of_pages_is_whole`."""
    cells = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells
    assert faults([cell.source for cell in cells if cell.cell_type == "code"]) == []


FIRST = [name for name in NAMES if name < "04"]


# Of the others, programs compile for ten seconds and more.
@pytest.mark.parametrize("name", slow_but(["00_first_wrench", "01_spatial_algebra"], FIRST))
@pytest.mark.parametrize("how", ["soon", slow("as a reader does")])
def test_it_runs(name, how, monkeypatch):
    """Soon, a self-check is of one dtype."""
    if how == "soon":
        monkeypatch.setattr(checks, "DTYPES", ("float32",))
        printed = soon(name, PRECISIONS.get(name))
    else:
        printed = as_a_reader(name)
    if name == "02_speed_and_accuracy":
        assert "All promises hold here." in printed
