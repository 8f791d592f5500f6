"""The site: `python -m sphinx -W -b html notebooks site`, with the extra `docs`."""

import importlib.util
import os
import pathlib
import re
import shutil
import sys
import tomllib
from typing import Any

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE / "_site"))

import docstrings  # noqa: E402
import pages  # noqa: E402
from docutils.utils.math.latex2mathml import tex2mathml  # noqa: E402

import jaxspatial  # noqa: E402

project = "jaxspatial"
author = "The jaxspatial developers"
copyright = "The jaxspatial developers"
release = jaxspatial.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
# Buttons that copy code, where the extension of the extra `docs` is installed.
extensions += ["sphinx_copybutton"] if importlib.util.find_spec("sphinx_copybutton") else []
exclude_patterns = ["_site", "**.ipynb_checkpoints"]
smartquotes_action = "D"  # dashes: names of precisions are in plain quotation marks
nitpicky = True
# Names of other libraries, and annotations of our own that are no public names.
nitpick_ignore_regex = [("py:.*", r"(?!jaxspatial\.).*")]

# -- pages and notebooks ----------------------------------------------------------------------------------------------

nb_execution_mode = "off"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

# -- reference --------------------------------------------------------------------------------------------------------

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
add_module_names = False
toc_object_entries_show_parents = "hide"
python_use_unqualified_type_names = True
viewcode_follow_imported_members = True

# -- looks ------------------------------------------------------------------------------------------------------------

html_theme = "pydata_sphinx_theme"
html_title = f"jaxspatial {release}"
html_static_path = ["_site/static"]
html_favicon = "_site/static/favicon.svg"
html_css_files = ["style.css"]
copybutton_prompt_text = ">>> "
html_extra_path = ["source/recordings"]
html_math_renderer = "mathml"
html_copy_source = False
html_domain_indices = False
html_show_sourcelink = False
html_theme_options: dict[str, Any] = {
    "navbar_align": "left",
    "header_links_before_dropdown": 6,
    "show_nav_level": 1,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
PROJECT = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["project"]
if "urls" in PROJECT:
    address = PROJECT["urls"]["Repository"]
    html_theme_options["icon_links"] = [{"name": "Repository", "url": address, "icon": "fa-brands fa-github"}]
    # Versions to choose from; without an address, the title of each page says which one it is of.
    html_theme_options |= pages.choice_of_versions(address, release, HERE / "source/versions/switcher.json")
    html_static_path.append("source/versions")

# -- links ------------------------------------------------------------------------------------------------------------
# Pages link files as a clone has them. Here a page is linked as a page, a picture is copied, and of any other file of
# the repository there is a page with its text.

ROOT = HERE.parent
# Where the text of a page of the site is in the repository.
PLACES = {"measured/" + path.stem: path for path in pages.TABLES}
SOURCES = HERE / "source"


def _relinked(text: str, place: pathlib.Path, docname: str) -> str:
    """place: the folder that links in the text are relative to."""

    def link(match: re.Match) -> str:
        target, _, anchor = match[2].partition("#")
        if not target or re.match(r"[a-z]+:", target):
            return match[0]
        path = pathlib.Path(os.path.normpath(place / target))
        page = _page_of(path)
        if page is None:
            return match[0]  # let Sphinx say that it is missing
        relative = os.path.relpath(page, (HERE / docname).parent)
        return f"{match[1]}({relative}{'#' + anchor if anchor else ''})"

    return re.sub(r"(!?\[(?:[^\]\[]|\[[^\]]*\])*\])\(([^)\s]+)\)", link, text)


def _page_of(path: pathlib.Path) -> pathlib.Path | None:
    """The file under notebooks/ that stands for a file of the repository."""
    for docname, place in PLACES.items():
        if path == place:
            return HERE / f"{docname}.md"
    if path == ROOT / "README.md":
        return HERE / "index.md"
    if not path.is_file():
        return None
    if path.is_relative_to(HERE):
        return path
    name = str(path.relative_to(ROOT))
    if path.suffix == ".png":
        copied = SOURCES / name
        copied.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, copied)
        return copied
    return _source_page(path, name)


def _source_page(path: pathlib.Path, name: str) -> pathlib.Path:
    page = SOURCES / f"{name}.md"
    page.parent.mkdir(parents=True, exist_ok=True)
    language = {".py": "python", ".cpp": "cpp", ".c": "c", ".toml": "toml"}.get(path.suffix, "text")
    relative = os.path.relpath(path, page.parent)
    text = f"---\norphan: true\n---\n\n# {path.name}\n\n`{name}`\n\n```{{literalinclude}} {relative}\n"
    text += f":language: {language}\n:linenos:\n```\n"
    if not page.exists() or page.read_text() != text:
        page.write_text(text)
    return page


def _place_of(docname: str) -> pathlib.Path | None:
    """The folder that links in a page in Markdown are relative to; None where its links are those of the site."""
    if docname.startswith(("source/", "reference/")):
        return None
    return PLACES[docname].parent if docname in PLACES else HERE


def read_page(app: Any, docname: str, source: list[str]) -> None:
    if docname == "reference":
        source[0] = pages.overview(source[0])
    elif docname == "index":
        readme = _relinked((ROOT / "README.md").read_text(), ROOT, docname)
        source[0] = source[0].replace("```{include} ../README.md\n```", readme)
    elif (place := _place_of(docname)) is not None:
        source[0] = _relinked(source[0], place, docname)
    if docname in pages.RECORDINGS:
        source[0] = pages.with_recordings(source[0])
    if docname in ("guide", "coming_from", "measured", "internals"):
        source[0] = pages.with_trees(source[0])


# -- docstrings -------------------------------------------------------------------------------------------------------


def read_docstring(app: Any, what: str, name: str, x: Any, options: Any, lines: list[str]) -> None:
    lines[:] = docstrings.to_rst(lines, lambda code: _named(code, name))


def read_signature(app: Any, what: str, name: str, x: Any, options: Any, signature: str | None, returns: Any) -> Any:
    """A part that is left out is known to be zero; its object says no more."""
    return signature and signature.replace("Components(0.0, 0.0, 0.0)", "0"), returns


def _named(code: str, context: str) -> str | None:
    """The public object, or the page on bounds, that code in a docstring names."""
    if any(code in modules for _, modules in pages.BEHIND.values()):
        return code
    match = re.fullmatch(r"(?:js\.|jaxspatial\.)?([A-Za-z]\w*(?:\.\w+)?)(?:\(\))?", code)
    if match is None:
        return None
    owner = context.split(".")[1] if context.count(".") == 2 else ""
    for name in (match[1], f"{owner}.{match[1]}"):
        parts = name.split(".")
        if parts[0] in NAMES and (len(parts) == 1 or name in MEMBERS):
            return None if context == f"jaxspatial.{name}" else f"jaxspatial.{name}"
    return None


def _members() -> set[str]:
    """Methods and attributes that autodoc describes: those with a docstring, of public classes."""
    found = set()
    for name in NAMES:
        cls = getattr(jaxspatial, name, None)
        if isinstance(cls, type):
            ours = [base for base in cls.__mro__ if base.__module__.startswith("jaxspatial")]
            members = {key: x for base in reversed(ours) for key, x in vars(base).items() if key[0] != "_"}
            found |= {
                f"{name}.{key}" for key, x in members.items() if callable(getattr(x, "__get__", None)) and x.__doc__
            }
    return found


NAMES = {entry.name for entry in pages.entries(pages.reference())}
MEMBERS = _members()


def drop_lost_links(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    """Sphinx links the sources of a module to one name of it only, however many names it is documented by."""
    known = app.env.domaindata["py"]["objects"]

    def link(match: re.Match) -> str:
        file, name = match[1], match[2]
        return match[0] if name in known and file.endswith(f"{known[name].docname}.html") else ""

    if page.startswith("_modules/"):
        context["body"] = re.sub(r'<a class="viewcode-back" href="([^"#]*)#([^"]*)">.*?</a>', link, context["body"])


# -- formulas: MathML, which browsers set without a script ------------------------------------------------------------


def visit_math(self: Any, node: Any) -> None:
    self.body.append(tex2mathml(node.astext(), as_block=False))
    from docutils import nodes

    raise nodes.SkipNode


def visit_displaymath(self: Any, node: Any) -> None:
    self.body.append(f'<div class="formula">{tex2mathml(node.astext(), as_block=True)}</div>')
    from docutils import nodes

    raise nodes.SkipNode


def setup(app: Any) -> None:
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_displaymath, None))
    app.connect("source-read", read_page)
    app.connect("autodoc-process-docstring", read_docstring)
    app.connect("autodoc-process-signature", read_signature)
    app.connect("html-page-context", drop_lost_links)
    pages.write()
    pages.record(SOURCES / "recordings/_recordings")
    # Pages of sources are there before Sphinx looks for pages.
    for path in [ROOT / "README.md", *HERE.glob("*.md"), *HERE.glob("*.ipynb"), *PLACES.values()]:
        _relinked(path.read_text(), path.parent, path.stem)
