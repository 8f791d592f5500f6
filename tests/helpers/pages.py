"""Runs the code of a page from top to bottom, as a reader does; sooner, where that is not asked for. And looks at code
without running it."""

import ast
import contextlib
import importlib
import inspect
import pathlib
import re
import subprocess
import sys
import warnings

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


def faults(blocks):
    """What can be seen to be wrong in the code of a page without running it, in words: names that are nowhere defined,
    attributes that a module does not have, arguments that a function of ours does not take."""
    code = "\n".join(blocks)
    tree = ast.parse(code)
    command = [sys.executable, "-m", "ruff", "check", "-q", "--isolated", "--select", "F821,F823", "--output-format"]
    looked = subprocess.run([*command, "concise", "-"], input=code, capture_output=True, text=True)
    found = looked.stdout.splitlines() + looked.stderr.splitlines()
    with warnings.catch_warnings(action="ignore"):  # of what other libraries import
        modules = dict(_imported(tree, found))
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and (names := _chain(node)) and names[0] in modules:
            with contextlib.suppress(LookupError):
                _resolved(modules, names, found)
        if isinstance(node, ast.Call) and (names := _chain(node.func)) and names[0] in modules:
            _look_at_call(node, names, modules, found)
    return list(dict.fromkeys(found))


def _imported(tree, found):
    """(name, what it is) of what a page imports; what is not installed is left out."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Import | ast.ImportFrom):
            continue
        for alias in node.names:
            of = alias.name if isinstance(node, ast.Import) else node.module
            try:
                module = importlib.import_module(of)
            except ImportError:
                continue
            if isinstance(node, ast.Import):
                yield (
                    alias.asname or of.partition(".")[0],
                    module if alias.asname else sys.modules[of.partition(".")[0]],
                )
            elif hasattr(module, alias.name):
                yield alias.asname or alias.name, getattr(module, alias.name)
            else:
                try:
                    yield alias.asname or alias.name, importlib.import_module(f"{of}.{alias.name}")
                except ModuleNotFoundError as error:
                    # Otherwise a library that it needs is not installed.
                    is_missing = error.name == f"{of}.{alias.name}" and of.partition(".")[0] == "jaxspatial"
                    found += [f"{of} has no {alias.name}"] if is_missing else []


def _chain(node):
    """["js", "interop", "mujoco"] of an expression of names and dots alone; [] of any other."""
    names = []
    while isinstance(node, ast.Attribute):
        names.append(node.attr)
        node = node.value
    return [node.id, *reversed(names)] if isinstance(node, ast.Name) else []


def _resolved(modules, names, found):
    """The object; LookupError, and a fault, where there is none. Of types alone their own names are known."""
    x = modules[names[0]]
    for i, name in enumerate(names[1:], 1):
        if not inspect.ismodule(x) and not inspect.isclass(x):
            raise LookupError
        if not hasattr(x, name):
            # Fields without a default are no attributes of a class.
            if not inspect.isclass(x):
                found.append(f"{'.'.join(names[:i])} has no {name}")
            raise LookupError
        x = getattr(x, name)
    return x


def _look_at_call(node, names, modules, found):
    with contextlib.suppress(LookupError):
        f = _resolved(modules, names, [])
        if not getattr(f, "__module__", "").startswith("jaxspatial") or not callable(f):
            return
        given = [x for x in node.args if not isinstance(x, ast.Starred)], [x.arg for x in node.keywords if x.arg]
        is_whole = len(given[0]) == len(node.args) and len(given[1]) == len(node.keywords)
        signature = inspect.signature(f)
        try:
            bind = signature.bind if is_whole else signature.bind_partial
            bind(*given[0], **dict.fromkeys(given[1]))
        except TypeError as error:
            found.append(f"{'.'.join(names)}: {error}")
