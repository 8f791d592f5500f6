"""Error bounds in docstrings are those of the records that `promises` attaches to a function.

    python -m tests.helpers.write_bounds          # says where they differ
    python -m tests.helpers.write_bounds --fix    # writes the records into the source

A paragraph "Error:" states each record in one of its three ways: `str(record)`, `record.plain` or `record.precise`.
Whatever else in it reads like one of these, but for its numbers, is a bound that no record has: `--fix` replaces it,
where only one record can be meant. Records that read alike stand in the order in which the decorator names them.
"""

import ast
import importlib
import inspect
import pathlib
import re
import sys
import textwrap

import jaxspatial

ROOT = pathlib.Path(jaxspatial.__file__).parent.parent
_NUMBER = r"\d+(?:\.\d+)?"


def error_of(doc):
    """The paragraph `Error:` of a docstring, as a match; None where there is none."""
    return re.search(r"^( *)Error: .*(?:\n\1 +.*)*", doc, re.M)


def faults(paragraph, records):
    """What the paragraph says that the records do not, in words."""
    stated = _stated(paragraph, records)
    wrong = [f"{text!r} is the bound of no record" for _, text, right in stated if not right]
    found = {text for _, text, _ in stated}
    missing = [f"{name}: {record} is not stated" for name, record in records.items() if not found & {*_ways(record)}]
    return wrong + missing + (_out_of_order(stated, records) if not wrong and not missing else [])


def fixed(paragraph, records):
    """The paragraph, filled anew, with the bounds of the records; as it is where more than one could be meant."""
    stated = _stated(paragraph, records)
    said = {text for _, text, right in stated if right}
    for (start, end), text, right in reversed(stated):
        if not right:
            meant = [
                (way, {*_ways(record)} & said)
                for record in records.values()
                for way in _ways(record)
                if _pattern(way).fullmatch(text) and not said & {way, str(record)}
            ]
            # Of several, the one that is not stated in any way.
            meant = [x for x in meant if not x[1]] or meant
            if len(meant) == 1:
                paragraph = paragraph[:start] + meant[0][0] + paragraph[end:]
    if all(right for *_, right in stated):
        return paragraph
    indent = paragraph[: len(paragraph) - len(paragraph.lstrip())]
    words = " ".join(paragraph.split())
    return textwrap.fill(words, 120, initial_indent=indent, subsequent_indent=f"{indent}    ", break_on_hyphens=False)


def _ways(record):
    return [way for way in (str(record), record.plain, record.precise) if way]


def _pattern(way):
    """The bound with any numbers, in any lines. A factor of one is not written."""
    # The 2 of u^2 is no number of a record.
    words = [_NUMBER.join(map(re.escape, re.split(rf"(?<!\^){_NUMBER}", word))) for word in way.split()]
    first = words[1:] if words[0] == _NUMBER else words
    return re.compile(rf"(?<![\w^])(?:{_NUMBER}\s+)?" + r"\s+".join(first) + r"(?![\w^])")


def _stated(paragraph, records):
    """[((start, end), the text, whether it is of a record)] of all that reads like a bound, in order."""
    ways = sorted({way for record in records.values() for way in _ways(record)}, key=len, reverse=True)
    found = []
    for way in ways:
        for match in _pattern(way).finditer(paragraph):
            if all(match.end() <= start or end <= match.start() for (start, end), *_ in found):
                text = " ".join(match[0].split())
                found.append((match.span(), text, text in ways))
    return sorted(found)


def _out_of_order(stated, records):
    """Records whose bounds could be taken for one another stand in the order of the decorator."""
    wrong = []
    ways = dict.fromkeys(way for record in records.values() for way in _ways(record))
    for pattern in {_pattern(way).pattern for way in ways}:
        said = [x for x in dict.fromkeys(text for _, text, _ in stated) if re.fullmatch(pattern, x)]
        alike = [x for x in ways if x in said]
        if said != alike:
            wrong.append(f"{said} stand in another order than in the decorator, {alike}")
    return wrong


def documented():
    """[(path, first line of the docstring's node, function)] of all functions with records in the library."""
    found = []
    for path in sorted((ROOT / "jaxspatial").rglob("*.py")):
        tree = ast.parse(path.read_text())
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        if not re.search(r"promises", path.read_text()):
            continue
        module = importlib.import_module(name)
        for owner, node in _functions(tree):
            function = inspect.getattr_static(getattr(module, owner, None) if owner else module, node.name, None)
            function = getattr(function, "__func__", function)
            if any("promises(" in ast.unparse(x) for x in node.decorator_list):
                found.append((path, node.body[0], function))
    return found


def _functions(tree):
    """(name of the class or "", node) of functions at the top of a module and of methods."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield "", node
        elif isinstance(node, ast.ClassDef):
            yield from ((node.name, member) for member in node.body if isinstance(member, ast.FunctionDef))


def differing(fix=False):
    """["file:line: what differs"]; with `fix`, what is left after the source was written."""
    left = []
    for path, node, function in reversed(documented()):
        lines = path.read_text().splitlines(keepends=True)
        doc = "".join(lines[node.lineno - 1 : node.end_lineno])
        error = error_of(doc)
        paragraph = "" if error is None else error[0]
        if fix and error is not None and faults(paragraph, function.promises):
            paragraph = fixed(paragraph, function.promises)
            lines[node.lineno - 1 : node.end_lineno] = [doc[: error.start()] + paragraph + doc[error.end() :]]
            path.write_text("".join(lines))
        place = f"{path.relative_to(ROOT)}:{node.lineno}: {function.__qualname__}"
        left += [f"{place}: {fault}" for fault in faults(paragraph, function.promises)]
    return left[::-1]


if __name__ == "__main__":
    found = differing(fix="--fix" in sys.argv[1:])
    print("\n".join(found))
    sys.exit(bool(found))
