"""The page of all public names: none is missing, and each example prints what it says."""

import contextlib
import importlib
import pathlib
import sys

import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.printed import printed
from tests.helpers.soon import compiled_soon

FOLDER = pathlib.Path(__file__).parent.parent / "notebooks"
sys.path.append(str(FOLDER / "_site"))
pages = importlib.import_module("pages")
TEXT = pages.reference()
ENTRIES = {entry.name: entry.example for entry in pages.entries(TEXT)}
# Imported by name: they need the extras `plot` and `view`.
OPTIONAL = {"plot": "matplotlib", "viewer": "viser"}


def test_every_public_name_has_one_entry():
    public = {name for name in dir(js) if not name.startswith("_")} | {*OPTIONAL}
    assert public == set(ENTRIES) and len(ENTRIES) == len(pages.entries(TEXT))


@contextlib.contextmanager
def names_of_the_page():
    """What its examples need not define, such as `arm`, and how they print."""
    with np.printoptions():
        scope = {}
        exec(pages.shared(TEXT), scope)
        yield scope


@pytest.fixture(scope="module")
def shared():
    with names_of_the_page() as names:
        yield names


# These compile long programs, or many.
LONG = {"self_check", "convex_step", "constrained_forward_dynamics", "close_loops"}


@pytest.mark.parametrize("name", [pytest.param(x, marks=[pytest.mark.slow] if x in LONG else []) for x in ENTRIES])
def test_example(name, shared, tmp_path, monkeypatch):
    """Under the promotion rules of these tests, which are stricter than a user's."""
    if name in OPTIONAL:
        pytest.importorskip(OPTIONAL[name])
    monkeypatch.chdir(tmp_path)
    with compiled_soon():
        found, said = printed(ENTRIES[name], dict(shared))
    assert found and found == said
