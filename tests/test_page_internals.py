"""The page on internals: what its example prints, and which caches there are."""

import pathlib
import re

import pytest

from tests.helpers.pages import FOLDER, examples, run

ENGINE = FOLDER.parent / "jaxspatial" / "engine"
PAGE = (FOLDER / "internals.md").read_text()
# Two letters at most: names of arrays in a trace, which JAX counts through.
_NAME = re.compile(r"\b[a-z]{1,2}(?=[: ,)]|$)")


def _lines(text):
    return [_NAME.sub("_", line.rstrip()) for line in text.splitlines()]


def test_the_example_prints_what_is_shown(capsys):
    """All of it, but where an ellipsis stands for other lines."""
    run(examples(PAGE), precision=None)
    printed, at = _lines(capsys.readouterr().out), 0
    shown = [line for text in re.findall(r"```text\n(.*?)```", PAGE, re.S) for line in _lines(text)]
    assert len(shown) >= 40
    for before, line in zip(["", *shown], shown, strict=False):
        if line != "...":
            at = 1 + (printed.index(line, at) if before == "..." else at)
            assert printed[at - 1] == line
    assert not any(printed[at:]) or shown[-1] == "..."


def _caches(path: pathlib.Path):
    """The names of caches of a module."""
    text = path.read_text()
    of_functions = re.findall(r"@functools\.(?:lru_)?cache\b.*\ndef (\w+)", text)
    return of_functions + re.findall(r"^(\w+)\b.* = (?:weakref\.Weak\w+Dictionary|functools\.lru_cache)\(", text, re.M)


def _told():
    """{file: names that the page says keep something there}."""
    table = PAGE.split("### What is kept, and for how long\n")[1].strip().split("\n\n")[0]
    places = [place for row in table.splitlines()[2:] for place in row.split("|")[3].split(";")]
    found = {}
    for place in places:
        for file in re.findall(r"(\w+\.py)", place):
            found.setdefault(file, set()).update(re.findall(r"`(\w+)`", place))
    return found


@pytest.mark.parametrize("path", sorted(ENGINE.glob("*.py")), ids=lambda path: path.name)
def test_caches_are_those_there_are(path):
    told = _told().get(path.name, set())
    assert set(_caches(path)) <= told
    assert all(re.search(rf"\b{name}\b", path.read_text()) for name in told)


def test_names_are_there():
    """Names in code, and words that are explained, are those of the package, or of what it calls."""
    source = " ".join(path.read_text() for path in ENGINE.parent.rglob("*.py"))
    text = re.sub(r"^```.*?^```", "", PAGE, flags=re.M | re.S)
    names = {part for name in re.findall(r"`([\w.]+)`", text) for part in name.split(".")}
    table = text.split("### Words in the source\n")[1].strip().split("\n\n")[0]
    words = [word.strip() for row in table.splitlines()[2:] for word in row.split("|")[1].split(";")]
    assert len(names) > 50 and len(words) > 40
    known = {*re.findall(r"\w+", source)}
    assert [name for name in (*names, *words) if not (name in known or " " in name and name in source)] == []
