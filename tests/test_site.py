"""The site is built without a warning; every page is two clicks from the first, and no link is broken.

And the page on drawing, whose code makes a recording that the site shows: it runs once, for both.

Building takes a minute, so all of this is slow. By default `test_readme` looks at links, places in pages, and code."""

import html.parser
import importlib
import importlib.metadata
import json
import os
import pathlib
import shutil
import subprocess
import sys
import urllib.parse

import numpy as np
import pytest

from tests.helpers.pages import run_page
from tests.test_reference import ENTRIES, pages

pytestmark = pytest.mark.slow

ROOT = pathlib.Path(__file__).parent.parent
RECORDING = ROOT / "notebooks/source/recordings/_recordings/solo.html"


class Page(html.parser.HTMLParser):
    """What a page links and shows, and the places in it that can be linked."""

    def __init__(self, path):
        super().__init__()
        self.links, self.shown, self.places = [], [], set()
        self.feed(path.read_text())

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.places |= {given[key] for key in ("id", "name") if given.get(key)}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        if tag in ("img", "script") and given.get("src"):
            self.shown.append(given["src"])


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """(all names of the page on drawing, the folder of its files)."""
    pytest.importorskip("viser", reason="the extra `view` is not installed")
    if "example-robot-data" not in {x.metadata["Name"] for x in importlib.metadata.distributions()}:
        pytest.skip("the extra docs has the robot")
    folder = tmp_path_factory.mktemp("drawn")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return run_page("drawing.md"), folder


@pytest.fixture(scope="module")
def site(tmp_path_factory, drawn):
    """path -> Page, of all pages. Its recording is there: it would run the page again."""
    pytest.importorskip("myst_nb", reason='the extra `docs` is not installed: python -m pip install -e ".[docs]"')
    RECORDING.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(drawn[1] / "solo.html", RECORDING)
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "notebooks", str(out)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    assert not built.stderr, built.stderr
    return out, {path: Page(path) for path in sorted(out.rglob("*.html")) if "_static" not in path.parts}


def targets(path, link):
    """The file and the place in it that a link of a page leads to; None for other sites."""
    parts = urllib.parse.urlsplit(link)
    if parts.scheme or parts.netloc:
        return None
    name = urllib.parse.unquote(parts.path)
    file = pathlib.Path(os.path.normpath(path.parent / name)) if name else path
    return file, urllib.parse.unquote(parts.fragment)


def test_every_name_has_its_page(site):
    out, pages = site
    for name in ENTRIES:
        page = pages[out / "reference" / f"{name}.html"]
        assert any(place == f"jaxspatial.{name}" or place == f"module-jaxspatial.{name}" for place in page.places), name


@pytest.mark.parametrize("name", ["semi_implicit_step", "SpatialForce", "convex_step"])
def test_search_finds_a_name(site, name):
    """As an object, as a title, and in the text of pages: `searchindex.js` is what the search in a browser reads."""
    out, _ = site
    text = (out / "searchindex.js").read_text()
    index = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    page = index["docnames"].index(f"reference/{name}")
    assert any(place[0] == page and place[-1] == name for place in index["objects"]["jaxspatial"])
    stem = importlib.import_module("sphinx.search.en").SearchEnglish({}).stem(name.lower())  # as the browser does
    assert index["terms"][stem]  # other pages
    titled = index["titleterms"][stem]  # the number of one page, or a list of several
    assert page in (titled if isinstance(titled, list) else [titled])


@pytest.mark.parametrize(("words", "name"), [("RNEA", "inverse_dynamics"), ("ABA", "forward_dynamics"),
                                             ("CRBA", "mass_matrix"), ("domain randomization", "as_data")])  # fmt: skip
def test_search_finds_what_the_field_says(site, words, name):
    """A page that has all of the words, and the call that they mean."""
    out, _ = site
    index = json.loads((out / "searchindex.js").read_text().removeprefix("Search.setIndex(").removesuffix(")"))
    stem = importlib.import_module("sphinx.search.en").SearchEnglish({}).stem
    found = [index["terms"][stem(word)] for word in words.lower().split()]
    shared = set.intersection(*(set(x if isinstance(x, list) else [x]) for x in found))
    texts = [(out / f"{index['docnames'][k]}.html").read_text() for k in shared]
    assert any(name in text for text in texts)


def test_no_link_is_broken(site):
    _, pages = site
    broken = []
    for path, page in pages.items():
        for link in {*page.links, *page.shown}:
            found = targets(path, link)
            if found is None:
                continue
            file, place = found
            is_there = file.is_file() and (not place or file not in pages or place in pages[file].places)
            broken += [] if is_there else [(path.name, link)]
    assert not broken


def test_pages_show_their_recordings(site):
    """A recording is a page of its own, with all that it shows."""
    out, _ = site
    for page, names in pages.RECORDINGS.items():
        text = (out / f"{page}.html").read_text()
        assert "&lt;!--" not in text and "recording: " + names[0] in text
        for name in names:
            assert text.count(f'src="_recordings/{name}"') == 1
            assert (out / "_recordings" / name).stat().st_size > 5e5


def test_a_quadruped_drops_and_stands(drawn):
    """The forces that the recording shows carry its weight in the end."""
    matplotlib = pytest.importorskip("matplotlib.image")
    page, folder = drawn
    weight = 9.81 * float(np.sum(page["solo"].inertias.mass))
    f = np.asarray(page["forces"].f)
    assert not f[:10].any()  # in the air
    np.testing.assert_allclose(f[-100:].mean(0).sum(0), [0, 0, weight], rtol=0, atol=0.02 * weight)
    assert page["trajectory"][-1, 6] > 0.2
    picture = matplotlib.imread(folder / "solo.png")
    assert (picture[..., :3].min(-1) < 0.5).mean() > 1e-3
    assert "<html" in (folder / "solo.html").read_text()[:1000]


def test_the_site_records_what_pages_show(drawn, tmp_path):
    """Where there is no recording, or one that is older than its page."""
    pages.record(tmp_path)
    names = {name for names in pages.RECORDINGS.values() for name in names}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert all(5e5 < path.stat().st_size < 2e6 for path in tmp_path.iterdir())
    recorded = (tmp_path / "solo.html").stat()
    pages.record(tmp_path)
    assert (tmp_path / "solo.html").stat().st_mtime == recorded.st_mtime
    os.utime(tmp_path / "solo.html", (0, 0))
    pages.record(tmp_path)
    assert (tmp_path / "solo.html").stat().st_mtime > 0


def test_every_page_is_two_clicks_from_the_first(site):
    out, pages = site
    near = {out / "index.html"}
    for _ in range(2):
        near |= {
            found[0] for path in near & pages.keys() for link in pages[path].links if (found := targets(path, link))
        }
    # Besides pages Sphinx makes the search, and the sources of modules, behind [source].
    ours = {path for path in pages if not path.relative_to(out).parts[0].startswith("_") and path.name != "search.html"}
    assert ours - near == set()


def test_no_public_name_lacks_a_docstring(site):
    """What is described has a text below its signature."""
    out, _ = site
    for name in ENTRIES:
        text = (out / "reference" / f"{name}.html").read_text()
        assert "<dd></dd>" not in text.replace("\n", ""), name
