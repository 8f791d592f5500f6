"""Error bounds are records: a decorator writes them into docstrings, and they say what they allow."""

import inspect
import pathlib
import re

import pytest

import jaxspatial as js
from jaxspatial.numerics import promise
from jaxspatial.numerics.promise import Normwise, OfSum, Promise, promises

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


@pytest.mark.parametrize("name", sorted(BOUNDED))
def test_docstrings_state_the_records(name):
    doc, records = " ".join(inspect.getdoc(BOUNDED[name]).split()), BOUNDED[name].promises
    error = doc.partition("Error: ")[2]
    assert records and all(bound.plain in error or bound.precise in error for bound in records.values())
    assert "{" not in error


def test_most_operations_have_bounds():
    """All that compute, and no other way is left to state a number."""
    assert {"shift", "dot", "cross", "rotate", "act", "mass_matrix", "forward_dynamics", "Rotation.exp"} <= set(BOUNDED)
    assert len(BOUNDED) > 80


def test_the_decorator_writes_the_paragraph():
    @promises(force=Promise(3, 4), acceleration=Normwise(7, "mag", per="n", u2=32))
    def moved():
        """Moves.

        Error: of a force {force}; of an acceleration at most
            {acceleration.plain}, or {acceleration.precise}.
        Source: none.
        """

    error = 'at most 3 u mag in "fast" and "reproducible", u |r| + 4 u^2 mag in "compensated", 1 ulp of r in "faithful"'
    words = f"Moves. Error: of a force {error}; of an acceleration at most 7 n u mag, or 1.01 u |r| + 32 n u^2 mag."
    assert " ".join(moved.__doc__.split()) == words + " Source: none."
    assert max(map(len, moved.__doc__.splitlines())) <= 120
    assert list(moved.promises) == ["force", "acceleration"]
    with pytest.raises(ValueError, match="Error"):
        promises(bound=Promise(3, 4))(lambda: None)
    with pytest.raises(KeyError, match="bound"):

        @promises(other=Promise(3, 4))
        def unnamed():
            """Error: {bound}."""


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
