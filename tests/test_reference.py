"""The page of all public names: none is missing, and each example prints what it says."""

import importlib
import pathlib
import sys

import numpy as np
import pytest

import jaxspatial as js
from tests.helpers.printed import printed
from tests.test_architecture import LAYERS

FOLDER = pathlib.Path(__file__).parent.parent / "notebooks"
sys.path.append(str(FOLDER / "_site"))
pages = importlib.import_module("pages")
TEXT = pages.reference()
ENTRIES = {entry.name: entry.example for entry in pages.entries(TEXT)}
# Layers that are no names of their own.
INNER = {"numerics", "rotation", "spatial", "inertia", "mechanism", "engine", "dynamics"}


def test_every_public_name_has_one_entry():
    public = {name for name in vars(js) if not name.startswith("_")} - INNER
    assert INNER < set(LAYERS)
    assert public == set(ENTRIES) and len(ENTRIES) == len(pages.entries(TEXT))


@pytest.fixture(scope="module")
def shared():
    with np.printoptions():
        scope = {}
        exec(pages.shared(TEXT), scope)
        yield scope


@pytest.mark.parametrize("name", ENTRIES)
def test_example(name, shared):
    """As users have it: in the promotion rules of JAX."""
    found, said = printed(ENTRIES[name], dict(shared))
    assert found and found == said
