"""Runs the code of a page from top to bottom, as a reader does."""

import ast
import pathlib
import re

import jax

from tests.helpers.soon import compiled_soon

FOLDER = pathlib.Path(__file__).parent.parent.parent / "notebooks"


def examples(text):
    """The code of a page, block by block."""
    return re.findall(r"```python\n(.*?)```", text, re.S)


def run(blocks, **numbers):
    """All names after the blocks have run one after the other, under the promotion rules that users have.

    Numbers replace what names are assigned at the top level of a block: sizes, so that a test takes seconds."""
    scope, replaced = {}, set()
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"), compiled_soon():
        for block in blocks:
            tree = ast.parse(block)
            for line in tree.body:
                if isinstance(line, ast.Assign) and isinstance(target := line.targets[0], ast.Name):
                    if target.id in numbers:
                        line.value = ast.copy_location(ast.Constant(numbers[target.id]), line.value)
                        replaced.add(target.id)
            exec(compile(tree, "page", "exec"), scope)
    assert replaced == numbers.keys(), f"assigned nowhere: {numbers.keys() - replaced}"
    return scope


def run_page(name, **numbers):
    """All names after a page has run: `run_page("scale.md", BATCH=64)`."""
    return run(examples((FOLDER / name).read_text()), **numbers)
