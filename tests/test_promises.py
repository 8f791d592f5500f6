"""Error bounds are records: docstrings state them, and they say what they allow."""

import importlib.util
import inspect
import pathlib
import re
import sys

import pytest

import jaxspatial as js
from jaxspatial.numerics import promise
from jaxspatial.numerics.promise import Normwise, OfSum, Promise
from tests.helpers import write_bounds
from tests.helpers.write_bounds import differing, faults, fixed

PAGES = pathlib.Path(js.__file__).parent.parent / "notebooks"


def _bounded():
    """{name: function} of all public functions and methods with bounds."""
    named = {
        name: x for module in (js.inertia, js.regressors, js) for name, x in vars(module).items() if name[0] != "_"
    }
    named = {name: x for name, x in named.items() if not inspect.ismodule(x)}
    for name, cls in list(named.items()):
        if inspect.isclass(cls):
            named |= {f"{name}.{method}": getattr(cls, method) for method in dir(cls)}
    return {name: x for name, x in named.items() if hasattr(x, "promises")}


BOUNDED = _bounded()


def test_docstrings_state_the_records():
    """Where one does not: python -m tests.helpers.write_bounds --fix"""
    assert differing() == []


def test_most_operations_have_bounds():
    """All that compute, and no other way is left to state a number."""
    assert {"shift", "dot", "cross", "rotate", "act", "mass_matrix", "forward_dynamics", "Rotation.exp"} <= set(BOUNDED)
    assert len(BOUNDED) > 80


RECORDS = {"force": Promise(3, 4), "acceleration": Promise(7, 32), "sum": OfSum(2, 2, of="m")}
PARAGRAPH = """Error: of a force at most 3 u mag in "fast" and "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp
    of r in "faithful", while mag < 1; of an acceleration 7 u mag, in the other two u |r| + 32 u^2 mag; of sums (2 + 2
    L) u m."""


def test_a_docstring_that_states_its_records():
    assert faults(PARAGRAPH, RECORDS) == [] and fixed(PARAGRAPH, RECORDS) == PARAGRAPH


@pytest.mark.parametrize(
    ("name", "record"),
    [
        ("force", Promise(5, 4)),
        ("force", Promise(3, 16)),
        ("force", Promise(2.5, 1)),
        ("acceleration", Promise(8, 32)),
        ("acceleration", Promise(7, 64)),
        ("sum", OfSum(7, 3, of="m")),
    ],
)
def test_another_record_is_found_and_written(name, record):
    records = {**RECORDS, name: record}
    assert "is the bound of no record" in faults(PARAGRAPH, records)[0]
    paragraph = fixed(PARAGRAPH, records)
    assert faults(paragraph, records) == [] and faults(paragraph, RECORDS)
    without_numbers, as_before = (
        re.sub(r"(\b\d[\d.]* )?u mag|\d[\d.]*", "", x).split() for x in (paragraph, PARAGRAPH)
    )
    assert without_numbers == as_before


def test_what_cannot_be_written_is_said():
    """Bounds in another order than the records, bounds in words of their own, and none at all."""
    two = {"mass": Promise(12, 64), "central": Promise(20, 64)}
    assert faults("Error: of mass 12 u mag, of central 20 u mag.", two) == []
    assert ["order" in fault for fault in faults("Error: of mass 20 u mag, of central 12 u mag.", two)] == [True]
    assert faults(PARAGRAPH, {**RECORDS, "turn": Normwise(2, "|w|", rounded=0)})[0].startswith("turn: ")
    assert len(faults("", RECORDS)) == 3


def test_the_source_is_written(tmp_path, monkeypatch):
    """A file whose record has changed: only its paragraph does, at the width of its docstring."""
    source = '''"""A module."""
from jaxspatial.numerics.promise import Promise, promises


class Moved:
    @promises(bound=Promise(5, 4))
    def moved(self):
        """Moves by 3 u mag.

        Error: per component, while nothing over- or underflows, and no wind blows from the north: at most 3
            u mag in "fast" and "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful".
        Source: none.
        """
'''
    file = tmp_path / "jaxspatial" / "moves.py"
    file.parent.mkdir()
    file.write_text(source)
    spec = importlib.util.spec_from_file_location("jaxspatial.moves", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(sys.modules, "jaxspatial.moves", module)
    monkeypatch.setattr(write_bounds, "ROOT", tmp_path)
    assert "jaxspatial/moves.py:8: Moved.moved: " in differing()[0]
    assert differing(fix=True) == [] == differing()
    assert " ".join(file.read_text().split()) == " ".join(source.replace("most 3\n            u", "most 5 u").split())


def test_records_put_their_bounds_into_words():
    assert (Promise(3.5, 32, u_of_result=4, u2_of_result=16).plain, Promise(2, 4).precise) == (
        "3.5 u mag + 4 u |r| c",
        "u |r| + 4 u^2 mag",
    )
    assert Normwise(1, "|w|", rounded=0).plain == "u |w|"
    assert (OfSum(10, 2).plain, OfSum(u2=2).plain) == ("(10 + 2 L) u mag", "L u mag")


def test_the_page_states_them():
    page = " ".join((PAGES / "precision.md").read_text().split())
    shift, dot = js.shift.promises["bound"], js.dot.promises["bound"]
    assert f"at most {shift.u:g} u mag (shift), {dot.u:g} u mag (dot)" in page
    assert f"u abs(r) + {shift.u2:g} u^2 mag (dot: {dot.u2:g})" in page


def test_a_record_says_what_it_allows():
    """Of a shift: 3 u mag, u |r| + 4 u^2 mag, 1 ulp; nothing where all is exact."""
    bound, u, ulp, r, mag = Promise(3, 4), 2.0**-24, 2.0**-30, -3.0, 5.0
    expected = {"fast": 15 * u, "reproducible": 15 * u, "compensated": 3 * u + 20 * u**2, "faithful": ulp}
    for precision in js.Precision:
        assert bound.allowed(precision, u, ulp, r, mag) == expected[precision]
        assert promise.EXACT.allowed(precision, u, ulp, r, mag) == 0
    pressed = Promise(3.5, 32, u_of_result=4, u2_of_result=32)
    assert pressed.allowed("fast", u, ulp, r, mag, 7.0) == u * (3.5 * mag + 4 * 3 * 7)
    assert [pressed.is_given(p, u, 1e6) for p in js.Precision] == [False, False, True, True]
    assert Promise(3, 4, u3=16).allowed("faithful", u, ulp, r, mag) == ulp + 16 * u**3 * mag


def test_a_normwise_record_says_what_it_allows():
    bound, u = Normwise(4, "mag", per="n", u2=32), 2.0**-24
    assert bound.allowed("fast", u, 6 * 5.0, 3.0) == 4 * u * 30
    assert bound.allowed("compensated", u, 6 * 5.0, 3.0) == 1.01 * u * 3 + 32 * u**2 * 30
    assert Normwise(8).allowed("faithful", u, 2.0) == 1.01 * u * 2
    assert [OfSum(10, 2).factor(n) for n in (1, 2, 3, 9)] == [10, 12, 14, 18]


def test_no_other_layer_names_a_precision():
    """A new one is a matter of `numerics` alone."""
    named = re.compile(rf"Precision\.({'|'.join(p.name for p in js.Precision)})")
    package = pathlib.Path(js.__file__).parent
    files = [path for path in package.rglob("*.py") if path.relative_to(package).parts[0] != "numerics"]
    assert len(files) > 70 and [path.name for path in files if named.search(path.read_text())] == []
