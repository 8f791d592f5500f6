"""Docstrings and pages state the bounds of the records that `measure` and the tests hold results against."""

import inspect
import pathlib
import re

import pytest

import jaxspatial as js
from jaxspatial.arithmetic import promise
from jaxspatial.arithmetic.promise import Normwise, OfSum, Promise
from jaxspatial.dynamics import promises as of_mechanisms
from jaxspatial.inertia import joint_projection
from jaxspatial.inertia import promises as of_inertia
from jaxspatial.inertia.shapes import Shapes
from jaxspatial.rotation import promises as of_rotations
from jaxspatial.spatial import promises as of_vectors

LAYERS = of_rotations, of_vectors, of_inertia, of_mechanisms
PROMISES = {name: records for layer in LAYERS for name, records in layer.PROMISES.items()}
PAGES = pathlib.Path(js.__file__).parent.parent / "notebooks"
# A number of units of roundoff, or of their squares; of sums a part of it.
FACTOR = re.compile(r"(?<![\w^.])(\d+(?:\.\d+)?)(?: \+ (?:\d )?L\))?(?: n| nv \(nv \+ 1\)| \(\d+ \+ L\))? u(\^2)?\b")


def _text(name):
    """The docstring, its lines joined."""
    found = js
    for part in name.split("."):
        found = getattr(found, part)
    return " ".join((inspect.getdoc(found) or "").split())


def _errors(name):
    """What the docstring says of errors."""
    return _text(name).partition("Error: ")[2].partition("Source: ")[0]


def _stated(text):
    """(number, power of u) of all bounds in a text."""
    return {(float(number), 2 if square else 1) for number, square in FACTOR.findall(text)}


def _public():
    """Names of functions and of methods that are listed."""
    for name, found in vars(js).items():
        if name.startswith("_") or inspect.ismodule(found):
            continue
        yield name
        if inspect.isclass(found):
            methods = (x for x in sorted(_methods(found)) if x == "__matmul__" or not x.startswith("_"))
            yield from (f"{name}.{method}" for method in methods)


def _methods(cls):
    """Own ones, and those of bases that are parts of the class."""
    layer = cls.__module__.rpartition(".")[0]
    return {name for base in cls.__mro__ if base.__module__.startswith(layer) for name in vars(base)}


@pytest.mark.parametrize("name", PROMISES)
def test_docstrings_state_the_records(name):
    text, records = _errors(name), PROMISES[name]
    for bound in records:
        if isinstance(bound, Promise):
            assert (bound.u, 1) in _stated(text) and (bound.u2, 2) in _stated(text)
            assert bound.mag in text or bound.mag == promise.TERMS
        else:
            assert bound.words in text
    assert _stated(text) <= set().union(*(bound.factors for bound in records))


def test_every_bound_has_a_record():
    assert [name for name in _public() if _stated(_errors(name)) and name not in PROMISES] == []
    assert set(PROMISES) <= set(_public())


def test_a_bound_is_seen():
    for words, factor in {
        "3 u mag": (3, 1),
        "1.01 u |r|": (1.01, 1),
        "4 n u mag": (4, 1),
        "32 n u^2 mag": (32, 2),
        "(12 + L) u S": (12, 1),
        "64 (4 + L) u^2 mag": (64, 2),
        "4 nv (nv + 1) u cond(M)": (4, 1),
    }.items():
        assert _stated(f"at most {words}, or so") == {factor}


def test_sums_state_theirs():
    """Of n items, L = ceil(log2 n)."""
    for rounds, n in enumerate((1, 2, 3, 5, 9)):
        assert of_vectors.of_sum(n) == Promise(u=rounds, u2=2 * rounds**2, u3=n**2)
        assert of_vectors.of_sum(n, each=2)[:2] == (2 + rounds, 2 * (2 + rounds) ** 2)
    assert "at most L u mag" in _text("SpatialForce.sum") and "2 L^2 u^2 mag" in _text("SpatialForce.sum")
    text = _text("wrench_from_point_forces")
    assert "(2 + L) u mag" in text and "2 (2 + L)^2 u^2 mag" in text and "n^2 u^2 mag" in text


def test_double_words_state_theirs():
    add, multiply, divide, root = (promise.DOUBLE_WORDS[operation] for operation in ("+", "*", "/", "sqrt"))
    text = _text("DoubleWord")
    for words in (f"+ and - {add} u^2", f"* {multiply} u^2", f"/ {divide} u^2", f"sqrt {root} u^2"):
        assert words in text, words


def test_shapes_state_theirs():
    text = " ".join((inspect.getdoc(Shapes) or "").split())
    mass, central = of_inertia.SHAPE_MASS, of_inertia.SHAPE_CENTRAL
    assert f"at most {mass.u} u mass and {central.u} u mag" in text and f"{central.u2} u^2 mag" in text


def test_projections_state_theirs():
    """Of a function that is not listed."""
    text, bound = " ".join((inspect.getdoc(joint_projection) or "").split()), of_inertia.PROJECTED
    assert f"{bound.u} u mag mag_D / D" in text and f"{bound.u2} u^2 mag mag_D / D" in text


def test_algorithms_state_theirs():
    """In both kinds of precisions, with the same words wherever the number of links counts."""
    for bound in (of_mechanisms.ALGORITHM, of_mechanisms.FORWARD_DYNAMICS):
        of_it = [name for name, records in PROMISES.items() if records == (bound,)]
        words = f'{bound.words} in "fast" and "reproducible", {bound.precise_words} in the other two'
        assert of_it and all(words in _text(name) for name in of_it)


def test_the_page_states_them():
    page = " ".join((PAGES / "precision.md").read_text().split())
    shift, dot = of_vectors.SHIFT, of_vectors.DOT
    assert f"at most {shift.u:g} u mag (shift), {dot.u:g} u mag (dot)" in page
    assert f"u abs(r) + {shift.u2:g} u^2 mag (dot: {dot.u2:g})" in page


def test_a_record_says_what_it_allows():
    """Of a shift: 3 u mag, u |r| + 4 u^2 mag, 1 ulp; nothing where all is exact."""
    bound, u, ulp, r, mag = of_vectors.SHIFT, 2.0**-24, 2.0**-30, -3.0, 5.0
    expected = {"fast": 15 * u, "reproducible": 15 * u, "compensated": 3 * u + 20 * u**2, "faithful": ulp}
    for precision in js.Precision:
        assert bound.allowed(precision, u, ulp, r, mag) == expected[precision]
        assert promise.EXACT.allowed(precision, u, ulp, r, mag) == 0
    pressed = of_vectors.PRESSED
    assert pressed.allowed("fast", u, ulp, r, mag, 7.0) == u * (3.5 * mag + 4 * 3 * 7)
    assert [pressed.is_given(p, u, 1e6) for p in js.Precision] == [False, False, True, True]
    assert of_vectors.of_sum(4).allowed("faithful", u, ulp, r, mag) == ulp + 16 * u**3 * mag


def test_a_normwise_record_says_what_it_allows():
    bound, u = Normwise(4, "mag", per="n", u2=32), 2.0**-24
    assert bound.allowed("fast", u, 6 * 5.0, 3.0) == 4 * u * 30
    assert bound.allowed("compensated", u, 6 * 5.0, 3.0) == 1.01 * u * 3 + 32 * u**2 * 30
    assert Normwise(8).allowed("faithful", u, 2.0) == 1.01 * u * 2
    assert [OfSum(10, 2).factor(n) for n in (1, 2, 3, 9)] == [10, 12, 14, 18]


def test_no_other_layer_names_a_precision():
    """A new one is a matter of `arithmetic` alone."""
    named = re.compile(rf"Precision\.({'|'.join(p.name for p in js.Precision)})")
    package = pathlib.Path(js.__file__).parent
    files = [path for path in package.rglob("*.py") if path.relative_to(package).parts[0] != "arithmetic"]
    assert len(files) > 100 and [path.name for path in files if named.search(path.read_text())] == []
