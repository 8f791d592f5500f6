"""Docstrings as reStructuredText: sections as fields, equations set as they stand, names in backticks as links.

Docstrings are plain text: what is indented is an equation or code, and `*`, `|` and `_` mean themselves.
"""

import re
from collections.abc import Callable, Iterable

SECTIONS = ("Args", "Returns", "Raises", "Error", "Source", "Example")
Link = Callable[[str], str | None]


def to_rst(lines: Iterable[str], link: Link) -> list[str]:
    """The lines of a docstring as reStructuredText. link: code -> the full name of the object it names, or None."""
    head, *rest = re.split(rf"^({'|'.join(SECTIONS)}):", "\n".join(lines), flags=re.M)
    text = _blocks(head.splitlines(), link)
    for title, body in zip(rest[::2], rest[1::2], strict=True):
        text += [""] + _field(title, body, link)
    return [*text, ""]


def _field(title: str, body: str, link: Link) -> list[str]:
    if title == "Example":
        return ["", ".. code-block:: pycon", "", *body.strip("\n").splitlines()]
    if title in ("Args", "Raises"):
        role = "param" if title == "Args" else "raises"
        entries = re.findall(r"^    ([\w.]+(?:, [\w.]+)*): ((?:.*\n?)(?:     +.*\n?|\n)*)", body, re.M)
        text_of = {name: _inline(" ".join(text.split()), link) for names, text in entries for name in names.split(", ")}
        return [f":{role} {name}: {text}" for name, text in text_of.items()]
    name = {"Returns": "returns", "Error": "Error bound"}.get(title, title)
    paragraphs = [_inline(" ".join(x.split()), link) for x in re.split(r"\n\s*\n", body) if x.strip()]
    return [f":{name}: {paragraphs[0]}", *(line for x in paragraphs[1:] for line in ("", f"    {x}"))]


def _blocks(lines: list[str], link: Link) -> list[str]:
    """Paragraphs, lists, and literal blocks of what is indented."""
    found, paragraph = [], []

    def end_paragraph() -> None:
        fields = _fields(paragraph)
        if fields:
            found.extend([*(f"- {_inline(field, link)}" for field in fields), ""])
        elif paragraph:
            found.extend([_inline("\n".join(paragraph), link), ""])
        paragraph.clear()

    lines, i = [line.rstrip() for line in lines], 0
    while i < len(lines):
        line = lines[i]
        if line.startswith("    ") and not paragraph:
            end = next((k for k in range(i, len(lines)) if lines[k] and not lines[k].startswith("    ")), len(lines))
            block = "\n".join(lines[i:end]).rstrip()
            language = "python" if re.search(r"\b(js|jax|measure|interop)\.|\bprint\(", block) else "text"
            found += [f".. code-block:: {language}", "", *block.splitlines(), ""]
            i = end
            continue
        if re.match(r"(- |\d\. )", line) or not line:
            end_paragraph()
        if line:
            paragraph.append(line)
        i += 1
    end_paragraph()
    return "\n".join(found).splitlines()


def _fields(lines: list[str]) -> list[str]:
    """The entries of a list of fields, `name: what it is`, each as one line; none of another paragraph."""
    if lines and lines[0] == "Attributes:":
        lines = [line.removeprefix("    ") for line in lines[1:]]
    entries = re.findall(r"^\S.*(?:\n +.*)*", "\n".join(lines), re.M)
    if not all(re.match(r"[a-z]\w*(, \w+)*: ", entry) for entry in entries):
        return []
    return [re.sub(r"^([\w, ]+): ", r"`\1`: ", " ".join(entry.split())) for entry in entries]


def _inline(text: str, link: Link) -> str:
    """A paragraph, with everything escaped that reStructuredText would take for markup."""
    pieces = re.split(r"(`+)([^`]+)\1", text)
    plain, codes = pieces[::3], [" ".join(code.split()) for code in pieces[2::3]]
    marker = re.match(r"- |\d\. ", plain[0])
    plain = [re.sub(r"([*|\\`]|_(?!\w))", r"\\\1", x) for x in plain]
    parts = [plain[0]]
    for code, after in zip(codes, plain[1:], strict=True):
        target = link(code)
        role = f":py:obj:`{code} <{target}>`" if target else f"``{code}``"
        parts.append(role + ("\\ " if after[:1].isalnum() else "") + after)
    joined = "".join(parts)
    return re.sub(r"\n *", "\n" + " " * len(marker[0]), joined) if marker else joined
