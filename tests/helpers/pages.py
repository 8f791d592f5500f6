"""Runs the code of a page from top to bottom, as a reader does; sooner, where that is not asked for."""

import ast
import contextlib
import pathlib
import re

import jax

import jaxspatial as js
from jaxspatial.mechanism.joints import KINDS
from tests.helpers.soon import compiled_soon

FOLDER = pathlib.Path(__file__).parent.parent.parent / "notebooks"


def examples(text):
    """The code of a page, block by block."""
    return re.findall(r"```python\n(.*?)```", text, re.S)


def run(blocks, precision="fast", as_read=False, runs_long=False, **numbers):
    """All names after the blocks have run one after the other, under the promotion rules that users have.

    Numbers replace what names are assigned at the top level of a block: sizes, so that a test takes seconds. precision:
    what a page computes in where it says nothing, None for the one of readers; programs of "fast" compile soonest. As a
    page is read, compiled as users do: with neither. runs_long: as of
    `compiled_soon`. Kinds of joints that a page registers are forgotten after it."""
    scope, replaced, known = {}, set(), [*KINDS]
    soon = contextlib.ExitStack()
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"), soon:
        if not as_read:
            soon.enter_context(compiled_soon(runs_long))
        if precision and not as_read:
            soon.enter_context(js.default_precision(precision))
        for block in blocks:
            tree = ast.parse(block)
            for line in tree.body:
                if isinstance(line, ast.Assign) and isinstance(target := line.targets[0], ast.Name):
                    if target.id in numbers:
                        line.value = ast.copy_location(ast.Constant(numbers[target.id]), line.value)
                        replaced.add(target.id)
            exec(compile(tree, "page", "exec"), scope)
    for name in KINDS.keys() - known:
        del KINDS[name]
    assert replaced == numbers.keys(), f"assigned nowhere: {numbers.keys() - replaced}"
    return scope


def run_page(name, **numbers):
    """All names after a page has run: `run_page("scale.md", BATCH=64)`."""
    return run(examples((FOLDER / name).read_text()), **numbers)
