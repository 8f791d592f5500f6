"""Docstrings and pages state the bounds of the records that `measure` and the tests hold results against."""

import inspect
import pathlib
import re

import pytest

import jaxspatial as js
from jaxspatial import dynamics
from jaxspatial.arithmetic import promise
from jaxspatial.dynamics.promises import ALGORITHM
from jaxspatial.inertia import promises as of_inertia
from jaxspatial.spatial import promises as of_vectors

PROMISES = {**of_vectors.PROMISES, **of_inertia.PROMISES}
PAGES = pathlib.Path(js.__file__).parent.parent / "notebooks"
# Whose bounds have letters in their factors, or another mag for each number: stated in words alone.
IN_WORDS = {
    "SpatialInertia.sum": "(L + 10) u mag",
}


def _text(name):
    """The docstring, its lines joined."""
    found = js
    for part in name.split("."):
        found = getattr(found, part)
    return " ".join((inspect.getdoc(found) or "").split())


def _stated(text, unit):
    """The factors of "u mag" or "u^2 mag" in a text; what stands in brackets counts too."""
    return {float(x) for x in re.findall(rf"(?<![\w^.])(\d+(?:\.\d+)?) {re.escape(unit)}(?: mag| \(mag)", text)}


def _public():
    """Names of functions and of methods that are listed."""
    for name, found in vars(js).items():
        if name.startswith("_") or inspect.ismodule(found):
            continue
        yield name
        if inspect.isclass(found):
            yield from (f"{name}.{method}" for method in sorted(_methods(found)) if not method.startswith("_"))


def _methods(cls):
    """Own ones, and those of bases that are parts of the class."""
    layer = cls.__module__.rpartition(".")[0]
    return {name for base in cls.__mro__ if base.__module__.startswith(layer) for name in vars(base)}


@pytest.mark.parametrize("name", PROMISES)
def test_docstrings_state_the_records(name):
    text = _text(name)
    assert _stated(text, "u") == {bound.u for bound in PROMISES[name]}
    assert _stated(text, "u^2") == {bound.u2 for bound in PROMISES[name]}
    assert all(bound.mag in text for bound in PROMISES[name] if bound.mag != promise.TERMS)


def test_every_bound_has_a_record():
    """A factor in a docstring is one of a record, or one that needs words."""
    stating = {name for name in _public() if _stated(_text(name), "u") | _stated(_text(name), "u^2")}
    assert stating - set(IN_WORDS) <= set(PROMISES)
    assert all(words in _text(name) for name, words in IN_WORDS.items())


def test_sums_state_theirs():
    """Of n items, L = ceil(log2 n)."""
    for rounds, n in enumerate((1, 2, 3, 5, 9)):
        assert of_vectors.of_sum(n) == promise.Promise(u=rounds, u2=2 * rounds**2, u3=n**2)
        assert of_vectors.of_sum(n, each=2)[:2] == (2 + rounds, 2 * (2 + rounds) ** 2)
    assert "at most L u mag" in _text("SpatialForce.sum") and "2 L^2 u^2 mag" in _text("SpatialForce.sum")
    text = _text("wrench_from_point_forces")
    assert "(2 + L) u mag" in text and "2 (2 + L)^2 u^2 mag" in text and "n^2 u^2 mag" in text


def test_double_words_state_theirs():
    add, multiply, divide, root = (promise.DOUBLE_WORDS[operation] for operation in ("+", "*", "/", "sqrt"))
    text = _text("DoubleWord")
    for words in (f"+ and - {add} u^2", f"* {multiply} u^2", f"/ {divide} u^2", f"sqrt {root} u^2"):
        assert words in text, words


def test_algorithms_state_theirs():
    """The same words wherever the number of links counts; only where a matrix is solved with are they others."""
    words, found = ALGORITHM.words(), []
    for name in _public():
        text = _text(name)
        if name not in vars(dynamics) or " n u" not in text:
            continue
        found.append(name)
        if name != "forward_dynamics" and "cond" not in text:
            assert words in text, name
    assert len(found) > 15
    assert ALGORITHM.words("c ") in _text("forward_dynamics")


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
