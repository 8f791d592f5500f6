"""The page on extending: where it says that a formula is, it is. Its code is run by `test_readme`."""

import ast
import pathlib
import re

import pytest

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
        "Where a formula is", "A new joint", "A new algorithm", "A new precision", "A new converter"
    ]  # fmt: skip
    assert all("```python\n" in s and "assert" in s for s in sections[1:])
