"""The folder tree is the architecture: each layer imports only from those below it."""

import ast
import pathlib
import subprocess
import sys
import types

import pytest

import jaxspatial

PACKAGE = pathlib.Path(jaxspatial.__file__).parent
LAYERS = [
    "numerics",
    "rotation",
    "spatial",
    "inertia",
    "mechanism",
    "engine",
    "dynamics",
    "contact",
    "interop",
    "measure",
    "command",
]
# Modules above all layers but the command, which shows what they draw: users import them, with an extra of each.
ON_TOP = ["plot", "viewer", "_drawing"]
# Modules of public names beside the list of all.
NAMED = ["regressors", "testing"]

FLOORS = [
    "jax_internals",
    "floats",
    "check",
    "precision",
    "types",
    "errorfree",
    "numbers",
    "linear",
    "elimination",
    "sums",
]
MODULES = sorted(PACKAGE.rglob("*.py"))


def _imported(path):
    """The layers of jaxspatial that a module imports from, function bodies included."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.startswith("jaxspatial"))
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = (f"{node.module}.{alias.name}" for alias in node.names)
            yield from (name for name in names if name.startswith("jaxspatial"))


def test_every_folder_is_a_layer():
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders == set(LAYERS)


@pytest.mark.parametrize("layer", LAYERS)
def test_a_layer_says_what_it_is(layer):
    """In words. Its number is the order of `LAYERS`, and stands nowhere else."""
    docstring = ast.get_docstring(ast.parse((PACKAGE / layer / "__init__.py").read_text()))
    assert docstring and docstring[0].isupper() and not docstring.lower().startswith("layer")


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_point_down(path):
    layer = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    assert layer in ("command", *ON_TOP) or not {name.split(".")[1] for name in _imported(path)} & {*ON_TOP}
    if layer in ("__init__", "__main__", *ON_TOP, *NAMED):
        return
    for name in _imported(path):
        below = name.split(".")[1]
        assert below in ON_TOP or LAYERS.index(below) <= LAYERS.index(layer), f"{layer} imports {name}"


def test_modules_are_a_layer_or_above_all():
    modules = {path.stem for path in PACKAGE.glob("*.py")}
    assert modules == {"__init__", "__main__", *ON_TOP, *NAMED}


def _floor(name):
    """How high a module of numerics stands: what no floor lists is above all."""
    return FLOORS.index(name) if name in FLOORS else len(FLOORS)


@pytest.mark.parametrize(
    "path", sorted((PACKAGE / "numerics").rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE))
)
def test_folders_of_numerics_stand_on_one_another(path):
    floor = path.relative_to(PACKAGE / "numerics").parts[0].removesuffix(".py")
    for name in (name.split(".")[2] for name in _imported(path)):
        assert _floor(name) <= _floor(floor), f"{path.name} imports {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_runtime_needs_only_what_is_installed(path):
    """Optional packages are imported inside functions or in modules that only the command line imports."""
    allowed = {"jax", "jaxlib", "numpy", "jaxspatial"}
    if path.parent.name == "command" and path.name in ("picture.py", "report.py"):
        allowed |= {"matplotlib", "rich"}
    standard = sys.stdlib_module_names
    for node in ast.parse(path.read_text()).body:
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        for name in (n.split(".")[0] for n in names):
            assert name in allowed or name in standard, f"{path}: {name}"


def test_public_names_exist_and_are_documented():
    exported = [name for name in dir(jaxspatial) if not name.startswith("_") and name not in (*LAYERS, *ON_TOP)]
    assert {"SpatialForce", "SpatialVelocity", "shift", "dot", "cross", "Precision"} <= set(exported)
    for name in exported:
        assert getattr(jaxspatial, name).__doc__, name


def test_what_no_program_needs_is_imported_when_it_is_asked_for():
    source = """
import sys, jaxspatial
later = ("jaxspatial.interop", "jaxspatial.measure", "jaxspatial.testing")
assert not [name for name in sys.modules if name.startswith(later)]
assert jaxspatial.self_check is jaxspatial.measure.self_check and jaxspatial.interop.ros and jaxspatial.testing
assert {"interop", "measure", "self_check", "shift", "testing"} <= set(dir(jaxspatial))
"""
    subprocess.run([sys.executable, "-c", source], check=True)
    with pytest.raises(AttributeError, match="module 'jaxspatial' has no attribute 'missing'"):
        _ = jaxspatial.missing


def test_no_folder_is_a_public_name():
    """Where `js.Mechanism` is a name and `js.mechanism` a folder, who looks for one is not shown the other."""
    shown = {name for name in dir(jaxspatial) if not name.startswith("_")}
    modules = {name for name in shown if isinstance(getattr(jaxspatial, name), types.ModuleType)}
    assert modules - {*ON_TOP} == {"interop", "measure", *NAMED}
    assert "Mechanism" in shown and not {name.lower() for name in shown - modules} & modules


@pytest.mark.parametrize("name", [*NAMED, "interop", "measure"])
def test_public_modules_are_imported_by_their_names(name):
    source = f"import jaxspatial.{name} as module, jaxspatial as js; assert js.{name} is module and module.__doc__"
    subprocess.run([sys.executable, "-c", source], check=True)


def test_what_users_do_not_call_is_private():
    """Of the classes that they meet: what the library alone asks for begins with an underscore."""
    inside = {"vectors", "with_vectors", "over_batch", "of_limb", "constant", "rounded", "first_data", "as_known"}
    classes = [x for x in vars(jaxspatial).values() if isinstance(x, type)]
    assert len(classes) > 20 and not [(x, name) for x in classes for name in inside & {*dir(x)}]


def test_import_touches_no_global_configuration():
    source = "import jax; before = dict(jax.config.values); import jaxspatial; assert before == dict(jax.config.values)"
    subprocess.run([sys.executable, "-c", source], check=True)


def test_what_may_change_of_jax_is_imported_in_one_file():
    """Public names of `jax.core` are no such part. Interfaces to other libraries stand above the layers."""
    unstable = ("jax._src", "jax.extend", "jax.interpreters", "jax.experimental")
    found = set()
    for path in MODULES:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if any(name and name.startswith(unstable) for name in names):
                found.add(path.relative_to(PACKAGE).as_posix())
    assert found == {"numerics/jax_internals.py"}


@pytest.mark.parametrize(
    "folder", ["numerics", "rotation", "spatial", "inertia", "engine", "contact", "interop", "measure"]
)
def test_private_functions_do_not_say_that_an_argument_may_be_anything(folder):
    """`Any` finds no fault: what an argument is, its type says, or the docstring alone."""
    found = list[str]()

    def read(node, is_private, place):
        for x in ast.iter_child_nodes(node):
            inside = is_private
            if isinstance(x, ast.FunctionDef):
                if is_private or (x.name.startswith("_") and not x.name.endswith("__")):
                    a = x.args
                    arguments = (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg)
                    anything = [y.arg for y in arguments if y and y.annotation and ast.unparse(y.annotation) == "Any"]
                    found.extend(f"{place}:{x.lineno} {x.name}: {name}" for name in anything)
                inside = True  # Functions in functions.
            read(x, inside, place)

    for path in sorted((PACKAGE / folder).rglob("*.py")):
        read(ast.parse(path.read_text()), False, path.name)
    assert not found
