"""The notebooks run from top to bottom, and what is committed shows their results.

Those with numbers of their own to check have tests of their own, `test_page_*.py`."""

import ast
import inspect
import re

import pytest

import jaxspatial as js
from tests.helpers.notebooks import FOLDER, executed
from tests.helpers.optional import needs
from tests.helpers.pages import run

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


def _code(name):
    cells = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4).cells
    return "\n\n".join(cell.source for cell in cells if cell.cell_type == "code")


@pytest.mark.parametrize("name", NAMES)
def test_what_it_asks_of_the_library_exists(name):
    """All names, and the keywords that functions are called with."""
    tree, found = ast.parse(_code(name)), 0

    def of(node):
        """What the expression `js.a.b` means; None of any other."""
        if isinstance(node, ast.Name):
            return js if node.id == "js" else None
        owner = of(node.value) if isinstance(node, ast.Attribute) else None
        return None if owner is None else getattr(owner, node.attr)

    for node in ast.walk(tree):
        function = of(node.func if isinstance(node, ast.Call) else node)
        found += function is not None
        if isinstance(node, ast.Call) and inspect.isroutine(function):
            inspect.signature(function).bind_partial(**{x.arg: None for x in node.keywords if x.arg})
    assert found >= 3


SHORT = [name for name in NAMES if name < "04"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT)
@pytest.mark.parametrize("compiled_soon", [True, False], ids=lambda x: "soon" if x else "as a reader does")
def test_it_runs(name, compiled_soon):
    executed(name, compiled_soon)


# Sizes, by notebook; the check of a machine is that of `measure.test_self_check`.
SMALLER = {
    "02_speed_and_accuracy": {
        "n=50": "n=5",
        "n = 100_000": "n = 1_000",
        "print(js.self_check())": "assert js.self_check",
    },
    "03_a_robot": {
        "EVERY = 2.5e-4, 16": "EVERY = 2.5e-4, 2",
        "length=500": "length=10",
        "np.arange(1, 501)": "np.arange(1, 11)",
        "reshape(3, 256, 500, 3)": "reshape(3, 8, 10, 3)",
        "(256, 7)": "(8, 7)",
        "range(0, 256, 8)": "range(8)",
        "milliseconds = (10, 5, 2, 1, 0.5, 0.2, 0.1)": "milliseconds = (10, 5)",
        "length=600": "length=10",
        "jnp.linspace(0, 10, 500)": "jnp.linspace(0, 10, 20)",
    },
}


@pytest.mark.parametrize("name", SHORT)
def test_its_code_runs_with_smaller_sizes(name, monkeypatch):
    """In this process, where much is imported and compiled."""
    plt = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setattr(plt, "show", lambda: plt.close("all"))
    monkeypatch.chdir(FOLDER)
    code = _code(name)
    for size, smaller in SMALLER.get(name, {}).items():
        assert size in code, f"nowhere: {size}"
        code = code.replace(size, smaller)
    run([code])
