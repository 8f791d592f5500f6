"""Writes the public address of the repository wherever it is needed. Until there is one, no place names any.

    python -m tests.helpers.write_address https://github.com/OWNER/NAME

`project.urls` of pyproject.toml gets it, from which the site takes its link to the repository, and a menu of versions;
the citation in the README; `git clone` on the page on installing; and each notebook, as a badge that opens it in Colab
and as a first cell that installs there, and only there, what its text says.
"""

import json
import pathlib
import re
import sys
import tomllib

import nbformat

ROOT = pathlib.Path(__file__).parent.parent.parent
BADGE = "[![Open in Colab](https://colab.research.google.com/assets/colab-badge.svg)]"
CELL = """import sys

if "google.colab" in sys.modules:
    packages = {packages}
    get_ipython().run_line_magic("pip", "install -q " + " ".join(f'"{{x}}"' for x in packages))
"""


def address(root=ROOT):
    """The one that is written; None where there is none yet."""
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    return project.get("urls", {}).get("Repository")


def write(url, root=ROOT):
    """Writes an address, in place of one that is there."""
    if not re.fullmatch(r"https://github\.com/[\w.-]+/[\w.-]+", url):
        raise ValueError(f"expected https://github.com/OWNER/NAME, which Colab opens, got {url!r}")
    _replace(root / "pyproject.toml", r'(?:\[project\.urls\]\nRepository = ".*"\n\n)?(?=\[project\.scripts\])',
             f'[project.urls]\nRepository = "{url}"\n\n')  # fmt: skip
    _replace(root / "README.md", r"(?<=  year   = \{2026\},\n)(?:  url    = \{.*\},\n)?", f"  url    = {{{url}}},\n")
    _replace(root / "notebooks/install.md", r"(?<=git clone )(?:<.*>|https:\S+)", url)
    for path in sorted((root / "notebooks").glob("*.ipynb")):
        _write_notebook(path, url)


def _replace(path, pattern, text):
    found, n = re.subn(pattern, lambda _: text, path.read_text(), count=1)
    assert n == 1, f"{path}: no place for the address"
    path.write_text(found)


def packages(cells, url):
    """What `pip install` in the text of a notebook brings, from the repository; else the extra `notebooks`."""
    text = " ".join(cell.source for cell in cells if cell.cell_type == "markdown")
    found = re.search(r'`pip install "\.\[([\w,]+)\]"([^`]*)`', text)
    extras, others = found.groups() if found else ("notebooks", "")
    more = [name for given in re.findall(r"`pip install ([\w -]+)`", text) for name in given.split()]
    names = [name for name in (*others.split(), *more) if name != "jupyterlab"]
    return [f"jaxspatial[{extras}] @ git+{url}", *dict.fromkeys(names)]


def _write_notebook(path, url):
    notebook = nbformat.read(path, as_version=4)
    place = f"{url.removeprefix('https://github.com')}/blob/main/notebooks/{path.name}"
    title, _, rest = notebook.cells[0].source.partition("\n")
    rest = re.sub(rf"^\n{re.escape(BADGE)}\(.*\)\n", "", rest)
    notebook.cells[0].source = f"{title}\n\n{BADGE}(https://colab.research.google.com/github{place})\n{rest}"
    if notebook.cells[1].id == "colab":
        del notebook.cells[1]
    source = CELL.format(packages=json.dumps(packages(notebook.cells, url))).rstrip("\n")
    notebook.cells.insert(1, nbformat.v4.new_code_cell(source, id="colab"))
    nbformat.write(notebook, path)


if __name__ == "__main__":
    write(sys.argv[1])
