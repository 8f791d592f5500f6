"""The site is built without a warning; every page is two clicks from the first, and no link is broken."""

import html.parser
import os
import pathlib
import subprocess
import sys
import urllib.parse

import pytest

from tests.test_reference import ENTRIES

ROOT = pathlib.Path(__file__).parent.parent
# By default `test_readme` follows the links of pages, and `test_reference` and `test_docstrings` look at every name.
pytestmark = pytest.mark.slow
pytest.importorskip("myst_nb", reason='the extra `docs` is not installed: python -m pip install -e ".[docs]"')


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
def site(tmp_path_factory):
    """path -> Page, of all pages."""
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


def test_a_robot_drops_on_the_page_on_drawing(site):
    """The recording is a page of its own, with all that it shows."""
    out, _ = site
    assert 'src="_recordings/solo.html"' in (out / "drawing.html").read_text()
    assert (out / "_recordings/solo.html").stat().st_size > 5e5


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
