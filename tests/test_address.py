"""The public address of the repository: none is told that is not in pyproject.toml, and one command writes it."""

import json
import re
import shutil
import sys
import tomllib
import types

import pytest

import jaxspatial as js
from tests.helpers.optional import needs

nbformat = needs("nbformat")

from tests.helpers import write_address  # noqa: E402
from tests.helpers.write_address import ROOT  # noqa: E402
from tests.test_reference import pages  # noqa: E402

URL = "https://github.com/somebody/jaxspatial"
NOTEBOOKS = sorted(path.name for path in (ROOT / "notebooks").glob("*.ipynb"))


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A copy of all places, with an address."""
    copy = tmp_path_factory.mktemp("copy")
    (copy / "notebooks").mkdir()
    for path in ("pyproject.toml", "README.md", "notebooks/install.md", *(f"notebooks/{name}" for name in NOTEBOOKS)):
        shutil.copyfile(ROOT / path, copy / path)
    write_address.write("https://github.com/before/before", copy)
    write_address.write(URL, copy)
    return copy


def cells(folder, name):
    return nbformat.read(folder / "notebooks" / name, as_version=4).cells


def test_every_place_has_it_once(written):
    assert write_address.address(written) == URL
    for path in ("README.md", "notebooks/install.md", "pyproject.toml"):
        assert (written / path).read_text().count(URL) == 1 and "before/before" not in (written / path).read_text()
    assert f"git clone {URL} jaxspatial" in (written / "notebooks/install.md").read_text()
    assert f"  url    = {{{URL}}},\n}}" in (written / "README.md").read_text()


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_a_notebook_opens_in_colab_and_installs_there(written, name, monkeypatch):
    """Its first cell does nothing elsewhere. In Colab it brings all that the notebook imports, by extras there are."""
    title, install, *rest = cells(written, name)
    badge = f"(https://colab.research.google.com/github/somebody/jaxspatial/blob/main/notebooks/{name})"
    assert re.findall(r"\[!\[Open in Colab\]\(\S+\)\](\(\S+\))", title.source) == [badge]
    before = cells(ROOT, name)
    was_there = 2 if write_address.address() else 1
    assert [cell.source for cell in rest] == [cell.source for cell in before[was_there:]]

    called = []
    shell = types.SimpleNamespace(run_line_magic=lambda *x: called.append(x))
    exec(install.source, {"get_ipython": lambda: shell})
    assert not called
    monkeypatch.setitem(sys.modules, "google.colab", types.ModuleType("google.colab"))
    exec(install.source, {"get_ipython": lambda: shell})
    ((magic, line),) = called
    assert magic == "pip" and f" @ git+{URL}" in line
    extras = re.findall(r"jaxspatial\[([\w,]+)\]", line)[0].split(",")
    project = tomllib.loads((written / "pyproject.toml").read_text())["project"]
    brought = " ".join([line, *(x for extra in extras for x in project["optional-dependencies"][extra])])
    code = "\n".join(cell.source for cell in rest if cell.cell_type == "code")
    for module, package in {"equinox": "equinox", "optax": "optax", "brax": "brax", "mujoco.mjx": "mujoco-mjx"}.items():
        if re.search(rf"^(import|from) {re.escape(module)}\b", code, re.M):
            assert package in brought, module


def test_the_site_has_a_menu_of_versions(tmp_path):
    """This release is at the root of the site, and every one of the page on releases has its place."""
    file = tmp_path / "versions/switcher.json"
    options = pages.choice_of_versions(URL, js.__version__, file)
    listed = {x["version"]: x["url"] for x in json.loads(file.read_text())}
    assert listed[js.__version__] == "https://somebody.github.io/jaxspatial/"
    assert all(url == f"{listed[js.__version__]}{x}/" for x, url in listed.items() if x != js.__version__)
    menu = {"json_url": f"{listed[js.__version__]}_static/switcher.json", "version_match": js.__version__}
    assert options["switcher"] == menu and "version-switcher" in options["navbar_end"]


def test_what_colab_cannot_open_is_refused(written):
    with pytest.raises(ValueError, match="expected https://github.com/OWNER/NAME"):
        write_address.write("https://example.org/jaxspatial", written)


def test_no_other_address_is_told():
    """All places say what pyproject.toml says: at present that there is none."""
    known = write_address.address()
    told = [re.search(r"url    = \{(.*)\}", (ROOT / "README.md").read_text())]
    told += [re.search(r"git clone (https:\S+)", (ROOT / "notebooks/install.md").read_text())]
    told += [re.search(r"git\+(https:[^\s\"]+)", cells(ROOT, name)[1].source) for name in NOTEBOOKS]
    assert {x and x[1] for x in told} == {known}
