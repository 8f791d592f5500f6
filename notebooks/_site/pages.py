"""The pages that are written while the site is built: one per public name, and the tables of benchmarks."""

import contextlib
import importlib
import inspect
import json
import pathlib
import re
import subprocess
from collections.abc import Iterator
from typing import Any, NamedTuple

import docstrings

FOLDER = pathlib.Path(__file__).parent.parent
ROOT = FOLDER.parent
# Types that only results are of stand on the page of the function that makes them.
RESULTS = {
    "central_axis": ["jaxspatial.spatial.wrench.CentralAxis"],
    "close_loops": ["jaxspatial.contact.closed_loops.ClosedConfiguration"],
    "constrained_forward_dynamics": ["jaxspatial.contact.closed_loops.ConstrainedDynamics"],
    "forward_dynamics_derivatives": ["jaxspatial.dynamics.linearization.ForwardDynamicsDerivatives"],
    "inverse_kinematics": ["jaxspatial.dynamics.inverse_kinematics.InverseKinematics"],
    "inverse_dynamics_derivatives": ["jaxspatial.dynamics.linearization.InverseDynamicsDerivatives"],
    "mass_matrix_factor": ["jaxspatial.dynamics.composite_bodies.MassMatrixFactor"],
}
# What stands behind public names and is told of in their docstrings.
BEHIND = {
    "error_bounds": (
        "Error bounds",
        ["jaxspatial.spatial.operations", "jaxspatial.dynamics.bounds", "jaxspatial.numerics.promise"],
    ),
}
# What the code of pages records. A page says where it is shown: `<!-- recording: solo.html -->`.
RECORDINGS = {"drawing": ("solo.html",), "gallery": ("hills.html", "boxes.html", "linkage.html")}
TABLES = [*sorted((ROOT / "tests/benchmarks").glob("*.md")), ROOT / "tests/peers/robots.md"]


class Entry(NamedTuple):
    """A public name of the page reference.md."""

    subject: str
    name: str
    example: str


def entries(text: str) -> list[Entry]:
    """All public names of the page, in its order."""
    found = []
    for section in re.split(r"^## ", text, flags=re.M)[1:]:
        subject, *parts = re.split(r"^### ", section, flags=re.M)
        for part in parts:
            (example,) = re.findall(r"```python\n(.*?)```", part, re.S)
            found.append(Entry(subject.partition("\n")[0], part.partition("\n")[0].strip(), example))
    return found


def shared(text: str) -> str:
    """What the examples of the page share."""
    return re.findall(r"```python\n(.*?)```", text.partition("\n## ")[0], re.S)[0]


def reference() -> str:
    return (FOLDER / "reference.md").read_text()


def first_sentence(x: Any) -> str:
    """What it computes, for a list."""
    paragraph = (inspect.getdoc(x) or "").partition("\n\n")[0]
    return " ".join(re.split(r"\.(?:\s|$)", paragraph.rstrip(":"))[0].split()) + "."


def choice_of_versions(address: str, release: str, file: pathlib.Path) -> dict[str, Any]:
    """Options of the theme for a menu of the versions in releases.md, and the file that the menu reads.

    address: of the repository on GitHub, whose site is the branch gh-pages: this release at its root, earlier ones in
    folders with their names. All of them read the list of the newest.
    """
    owner, name = address.removeprefix("https://github.com/").split("/")
    site = f"https://{owner.lower()}.github.io/{name}/"
    versions = re.findall(r"^## (\d+(?:\.\d+)+)", (FOLDER / "releases.md").read_text(), re.M)
    listed = [{"version": x, "url": site if x == release else f"{site}{x}/"} for x in versions]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(listed))
    menu = {"json_url": f"{site}_static/{file.name}", "version_match": release}
    return {
        "switcher": menu,
        "check_switcher": False,
        "navbar_end": ["version-switcher", "theme-switcher", "navbar-icon-links"],
    }


# -- as pages ---------------------------------------------------------------------------------------------------------


def overview(text: str) -> str:
    """reference.md as the site has it: tables of names by subject, in place of the examples."""
    intro, *_ = text.partition("\n## ")
    parts = [intro.replace("On the site every name has a page of its own", "Every name has a page of its own"), ""]
    found = entries(text)
    for subject in dict.fromkeys(entry.subject for entry in found):
        names = [entry.name for entry in found if entry.subject == subject]
        rows = [f"| [`{x}`](reference/{x}) | {_cell(first_sentence(_object(f'jaxspatial.{x}')))} |" for x in names]
        tree = ["```{toctree}", ":hidden:", f":caption: {subject}", "", *(f"reference/{x}" for x in names), "```"]
        note = re.split(rf"^## {subject}\n", text, flags=re.M)[1].partition("\n#")[0].strip()
        parts += [f"## {subject}", "", note, "", "| | |", "|---|---|", *rows, "", *tree, ""]
    parts.append("{ref}`Index of all names, members included <genindex>`")
    pages = [f"- [{title}](reference/{name})" for name, (title, _) in BEHIND.items()]
    tree = ["```{toctree}", ":hidden:", ":caption: What bounds mean", "", *(f"reference/{name}" for name in BEHIND)]
    return "\n".join([*parts, "## What bounds mean", "", *pages, "", *tree, "```", ""])


def with_trees(text: str) -> str:
    """A page of links with the pages in the tree of the site, each section one part of it."""
    parts = re.split(r"^(?=## )", text, flags=re.M)
    for i, part in enumerate(parts):
        linked = re.findall(r"^- \[[^\]]*\]\(([\w/]+)\.(?:md|ipynb)\)", part, re.M)
        caption = part.partition("\n")[0].removeprefix("## ")
        if linked:
            parts[i] += "\n".join(["", "```{toctree}", ":hidden:", f":caption: {caption}", "", *linked, "```", "", ""])
    return "".join(parts)


def _cell(text: str) -> str:
    """In a table of Markdown, all but code as it stands."""
    plain_and_code = re.split(r"(`[^`]+`)", text)
    return "".join(x if i % 2 else re.sub(r"([*_\\<\[])", r"\\\1", x) for i, x in enumerate(plain_and_code)).replace(
        "|", r"\|"
    )


def write() -> None:
    """The generated pages, each only where it has changed, and none that is no more."""
    pages = {FOLDER / "reference" / f"{name}.rst": text for name, text in _reference_pages().items()}
    pages |= {FOLDER / "measured" / path.name: _table(path) for path in TABLES}
    for path, text in pages.items():
        path.parent.mkdir(exist_ok=True)
        if not path.exists() or path.read_text() != text:
            path.write_text(text)
    for folder in ("reference", "measured"):
        for path in set((FOLDER / folder).iterdir()) - pages.keys():
            path.unlink()


def _reference_pages() -> dict[str, str]:
    text = reference()
    pages = {entry.name: _page(entry, shared(text)) for entry in entries(text)}
    for name, (title, modules) in BEHIND.items():
        parts = (f".. automodule:: {module}\n" + "   :members:\n" * module.endswith("promise") for module in modules)
        pages[name] = _titled(title) + "\n".join(parts)
    return pages


def _titled(title: str) -> str:
    return f"{title}\n{'=' * len(title)}\n\n"


def _page(entry: Entry, setup: str) -> str:
    x = _object(f"jaxspatial.{entry.name}")
    described = [_module(f"jaxspatial.{entry.name}", x)] if inspect.ismodule(x) else []
    described += [] if described else [_described(f"jaxspatial.{entry.name}", x)]
    described += [_described(name, _object(name)) for name in RESULTS.get(entry.name, [])]
    example = f"Example\n-------\n\n{_code(entry.example)}\n{_folded('What the examples share', setup)}"
    # What has members is long: there the example comes first.
    parts = [example, *described] if not inspect.isroutine(x) else [*described, example]
    return _titled(entry.name) + "\n".join(parts)


def _folded(title: str, code: str) -> str:
    opened, closed = f"<details class='shared'><summary>{title}</summary>", "</details>"
    return f".. raw:: html\n\n   {opened}\n\n{_code(code)}\n.. raw:: html\n\n   {closed}\n"


def _described(name: str, x: Any) -> str:
    if not inspect.isclass(x):
        return f".. autofunction:: {name}\n"
    bases = ", ".join(base.__name__ for base in x.__mro__ if not base.__module__.startswith("jaxspatial"))
    return f".. autoclass:: {name}\n   :members:\n   :inherited-members: {bases}\n"


def _module(name: str, module: Any) -> str:
    """All public names of a module and of the modules in it."""
    parts = [f".. py:module:: {name}\n", *docstrings.to_rst((module.__doc__ or "").splitlines(), lambda code: None)]
    inner = []
    for key, x in _public(module):
        if inspect.ismodule(x):
            inner += [f"{key}\n{'-' * len(key)}\n", _module(f"{name}.{key}", x)]
        else:
            parts.append(_described(f"{name}.{key}", x))
    return "\n".join([*parts, *inner])


def _public(module: Any) -> Iterator[tuple[str, Any]]:
    """What a module exports as itself, `X as X`, and what it defines if it is no package."""
    exported = set(re.findall(r"\b(\w+) as \1\b", inspect.getsource(module)))
    is_package = hasattr(module, "__path__")
    for key, x in vars(module).items():
        is_own = not is_package and callable(x) and getattr(x, "__module__", "") == module.__name__
        if key in exported or (is_own and not key.startswith("_")):
            yield key, x


def _object(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition(".")
        return getattr(importlib.import_module(module), attribute)


def _code(text: str) -> str:
    return ".. code-block:: python\n\n" + _indented(text)


def _indented(text: str) -> str:
    return re.sub(r"^(?=.)", "   ", text, flags=re.M)


def _table(path: pathlib.Path) -> str:
    """A table of a benchmark, with the day on which it was written."""
    title, _, rest = path.read_text().partition("\n")
    command = ["git", "log", "-1", "--format=%cs", "--", str(path)]
    is_shallow = (ROOT / ".git/shallow").exists()  # there the last commit has all files
    found = None if is_shallow else subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    day = found.stdout.strip() if found else ""
    source = path.relative_to(ROOT)
    return f"{title}\n\n`{source}`{f', of {day}' if day else ''}.\n{rest}"


def with_recordings(text: str) -> str:
    """A page whose marks are frames in which recordings play."""
    frame = '<iframe class="recording" src="_recordings/{0}" title="a recording: {0}" loading="lazy"></iframe>'
    shown = "```{{raw}} html\n" + frame + "\n```"
    return re.sub(r"^<!-- recording: (\S+) -->$", lambda match: shown.format(match[1]), text, flags=re.M)


def record(folder: pathlib.Path) -> None:
    """Runs the code of pages in a folder, for their recordings, unless these are there and not older."""
    for page, names in RECORDINGS.items():
        path = FOLDER / f"{page}.md"
        made = [folder / name for name in names]
        if all(x.exists() and x.stat().st_mtime > path.stat().st_mtime for x in made):
            continue
        folder.mkdir(parents=True, exist_ok=True)
        with contextlib.chdir(folder):
            exec("\n".join(re.findall(r"```python\n(.*?)```", path.read_text(), re.S)), {})
        for other in set(folder.iterdir()) - {folder / name for names in RECORDINGS.values() for name in names}:
            other.unlink()
