"""What precisions cost stands in one table, which is the benchmark's, on the page on precisions; others quote it."""

import pathlib
import re

import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.pages import FOLDER

ROOT = FOLDER.parent
PAGE = (FOLDER / "precision.md").read_text()
# What the page calls a section of the benchmark, by name and memory.
SECTIONS = {
    ("a wrench moved", "streamed"): "shift, streaming",
    ("a wrench moved in place", "streamed"): "shift, streaming, in place",
    ("a wrench moved", "cache"): "shift, in cache",
    ("power", "streamed"): "dot, streaming",
    ("power", "cache"): "dot, in cache",
    ("inverse dynamics of an arm", "cache"): "inverse dynamics of an arm",
}


def _measured():
    """{section: {precision: time over that of fast}} of the benchmark."""
    text = (ROOT / "tests" / "benchmarks" / "precisions.md").read_text()
    sections = re.finditer(r"^\| (.+?) \| ns \|.*\n\|[-|]+\n((?:\|.*\n)+)", text, re.M)
    return {m[1]: dict(re.findall(r"^\| (\w+) \| .* ([0-9.]+) \|$", m[2], re.M)) for m in sections}


def _rows():
    lines = PAGE[PAGE.index("| time over that of") :].split("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_the_table_is_the_benchmarks():
    measured, rows = _measured(), _rows()
    assert {(name, memory) for name, _, memory, *_ in rows} == SECTIONS.keys() and len(rows) == 2 * len(SECTIONS)
    for name, batch, memory, dtype, reproducible, compensated, faithful in rows:
        found = measured[f"{SECTIONS[name, memory]}, {dtype}"]
        assert reproducible == found["reproducible"] and compensated == found["compensated"], (name, memory, dtype)
        assert faithful == found.get("faithful", "as compensated")
        assert batch == {"streamed": "1 000 000", "cache": "2 000"}[memory] or "arm" in name


def test_a_wrench_comes_back_as_told():
    """The one of the example on double words, shifted there and back."""
    text = " ".join(PAGE.split())
    F, p = js.SpatialForce([0.1, 0.2, 0.3], [1.0, 2.0, 3.0]), np.float32([1e3, -2e5, 0.7])
    for precision, k, told in (("reproducible", 0, "0.125 instead of 0.1,"), ("faithful", 2, "0.297 instead of 0.3.")):
        back = js.shift(js.shift(F, p, precision=precision), -p, precision=precision)
        assert f"{back.tau[k]:.3g} instead of" in told and told in text


# A ratio beside the name of a precision; benchmarks have theirs, and releases tell what was true then.
_NAMES = "fast|reproducible|compensated|faithful"
_RATIO = re.compile(rf'(\d\.\d+) times (?:as long|the time|slower)[^.|]*?`?"?(?:{_NAMES})')
_PAGES = [ROOT / "README.md", *sorted({*FOLDER.glob("*.md"), *FOLDER.glob("*.ipynb")} - {FOLDER / "releases.md"})]


def test_a_ratio_is_seen():
    assert _RATIO.findall('takes 1.7 times as long as in `"fast"` in float32, 5.6 times in float64') == ["1.7"]


@pytest.mark.parametrize("page", _PAGES, ids=lambda page: page.name)
def test_other_pages_quote_it(page: pathlib.Path):
    text = " ".join(page.read_text().split())
    known = {cell for row in _rows() for cell in row[4:]}
    assert {m[1] for m in _RATIO.finditer(text)} <= known
    assert not re.search(r"(at|for) the (speed|price|time) of `?\"?fast", text)
