"""Code whose prints are followed by comments with what they print, as in notebooks/reference.md."""

import ast
import contextlib
import io
import re


def printed(code, scope):
    """(what is printed, what the comments say), one for each print; a comment in its line, or in those below it."""
    lines, found, said = code.splitlines(), [], []
    for statement in ast.parse(code).body:
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(ast.Module([statement], []), "example", "exec"), scope)
        if out.getvalue():
            found.append([line.rstrip() for line in out.getvalue().splitlines()])
            said.append(_comments(lines[statement.end_lineno - 1 :]))
    return found, said


def _comments(lines):
    below = []
    for line in lines[1:]:
        if not line.startswith("#"):
            break
        below.append(line.removeprefix("#").removeprefix(" ").rstrip())
    # A comment in the line itself is prose where numbers stand below it.
    return below or [re.split(r"  # ", lines[0], maxsplit=1)[-1].rstrip()]
