"""The page on extending: where it says that a formula is, it is. Its code is run by `test_readme`."""

import ast
import pathlib
import re

import pytest

from jaxspatial.numerics.promise import Promise
from tests.helpers.operation import Operation
from tests.helpers.operations import OPERATIONS
from tests.laws import test_counted_bounds, test_error_bounds

ROOT = pathlib.Path(__file__).parent.parent
PAGE = (ROOT / "notebooks" / "extending.md").read_text()
FORMULAS = re.findall(r"^\| ([^|]+) \| `(\w+)` \| \[([\w/.]+)\]\(\.\./jaxspatial/([\w/.]+)\) \|$", PAGE, re.M)


def test_ten_formulas():
    table = PAGE.split("| formula |")[1].split("\n\n")[0]
    assert len(FORMULAS) == 10 == table.count("\n") - 1
    assert len({function for _, function, *_ in FORMULAS}) == 10


@pytest.mark.parametrize("formula, function, file, link", FORMULAS, ids=[name for name, *_ in FORMULAS])
def test_a_formula_has_one_home(formula, function, file, link):
    """It is defined there, at the top of the file."""
    assert file == link
    tree = ast.parse((ROOT / "jaxspatial" / file).read_text())
    assert function in [node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))], formula


def test_every_way_to_extend_has_code():
    sections = re.split(r"^## ", PAGE, flags=re.M)[1:]
    assert [s.split("\n")[0] for s in sections] == [
        "Where a formula is", "A new operation", "A new joint", "A new algorithm", "A new contact term",
        "A new precision", "A new converter",
    ]  # fmt: skip
    assert all("```python\n" in s and "assert" in s for s in sections[1:])


def added(monkeypatch, bound=None):
    """The operation that the page adds, as a line of the table, with its bound or another."""
    section = PAGE.split("## A new operation\n")[1].split("\n## ")[0]
    names = {}
    exec(section.split("```python\n")[1].split("```")[0], names)
    function = names["moment_about"]
    row = Operation(f"moment, {bound}", "F vector vector", function, bounds=(bound or function.promises["bound"],))
    monkeypatch.setitem(OPERATIONS, row.name, row)
    return row.name


def test_the_operation_of_the_page_keeps_its_bound(monkeypatch):
    """By the count of its roundings, which is what the page says, and on inputs that cancel."""
    name = added(monkeypatch)
    monkeypatch.setattr(test_counted_bounds, "BOUNDED", [name])
    test_counted_bounds.test_a_bound_is_at_least_what_counting_proves(name)
    for number, is_twice in (("u", False), ("u2", True)):
        test_counted_bounds.test_no_number_is_twice_what_counting_proves(number, is_twice)
    for dtype, precision in (("float32", "reproducible"), ("float64", "compensated"), ("float32", "faithful")):
        test_error_bounds.test_bound_of_the_docstring_op_by_op(name, dtype, precision)


@pytest.mark.parametrize("bound", [Promise(1, 0.01), Promise(5, 32), Promise(6, 16)], ids=["both", "u", "u2"])
def test_counting_refuses_a_wrong_bound_of_it(bound, monkeypatch):
    """The page says 6 u, 32 u^2."""
    with pytest.raises(AssertionError):
        test_counted_bounds.test_a_bound_is_at_least_what_counting_proves(added(monkeypatch, bound))


@pytest.mark.parametrize(("dtype", "precision"), [("float32", "reproducible"), ("float64", "compensated")])
def test_inputs_refuse_a_wrong_bound_of_it(dtype, precision, monkeypatch):
    with pytest.raises(AssertionError):
        test_error_bounds.test_bound_of_the_docstring_op_by_op(added(monkeypatch, Promise(1, 0.01)), dtype, precision)
