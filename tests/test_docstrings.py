"""The form of public docstrings: Args with every parameter, Returns, then the error bound, the source, an example."""

import doctest
import importlib
import inspect
import pkgutil
import re
import sys
import typing
from types import SimpleNamespace

import jax
import numpy as np
import pytest

import jaxspatial as js
from jaxspatial import plot
from jaxspatial.dynamics.composite_bodies import MassMatrixFactor
from jaxspatial.engine.algorithm import ExternalForces
from jaxspatial.numerics import quantity
from tests.helpers.optional import needs
from tests.helpers.soon import compiled_soon
from tests.interop.test_ros import Vector3, Wrench
from tests.test_reference import LONG, names_of_the_page


def _public(module):
    return {name: f for name, f in vars(module).items() if name[0] != "_" and inspect.isfunction(f)}


def _methods(cls, folder=None):
    """Own ones, and those of bases in a folder, that of the class for None. The nearest with a docstring counts."""
    found = {}
    for base in (c for c in cls.__mro__ if c.__module__.startswith(folder or cls.__module__.rpartition(".")[0])):
        for name, member in vars(base).items():
            function = getattr(member, "__func__", member)
            is_own = inspect.isfunction(function) and function.__module__.startswith("jaxspatial")
            if name[0] != "_" and is_own and not (name in found and found[name].__doc__):
                found[name] = function
    return {f"{cls.__name__}.{name}": function for name, function in found.items()}


INERTIA = _public(js.inertia)
ELSEWHERE = _public(js.regressors) | {"random_mechanism": js.testing.random_mechanism}
FUNCTIONS = (
    _public(js) | INERTIA | {name: f for name, f in ELSEWHERE.items() if name.endswith(("regressor", "mechanism"))}
)
ALGORITHMS = [
    name for name, f in FUNCTIONS.items() if f.__module__.startswith(("jaxspatial.dynamics", "jaxspatial.contact"))
]
VECTORS = js.Rotation, js.RigidTransform, js.SpatialVelocity, js.SpatialAcceleration
NUMBERS = js.Components, js.DoubleWord
OF_DYNAMICS = MassMatrixFactor, js.MomentumObserver
CLASSES = *VECTORS, js.SpatialInertia, js.ArticulatedInertia, *OF_DYNAMICS, quantity.Quantity, *NUMBERS
METHODS = {name: f for cls in CLASSES for name, f in _methods(cls).items()}


def _parameters(function):
    return [name for name in inspect.signature(function).parameters if name not in ("self", "cls")]


def _section(doc, title):
    """The lines of a section, without their indent; None where there is none."""
    match = re.search(rf"^{title}:\n((?:[ \t]+.*\n?|\n)*)", doc, re.M)
    return None if match is None else inspect.cleandoc(match[1])


def faults(function):
    doc = inspect.getdoc(function) or ""
    found = [] if re.match(r"[^\n]+[.:](\n|$)", doc) else ["the first line is no sentence"]
    parameters, args = _parameters(function), _section(doc, "Args")
    named = re.findall(r"^(\w+): ", args or "", re.M)
    if named != parameters:
        found.append(f"Args: expected {parameters}, got {named}")
    if not _section(doc, "Returns"):
        found.append("no Returns")
    if not re.search(r"^Error: .", doc, re.M):
        found.append("no Error")
    if re.search(r"{\w", doc):
        found.append("a bound is not filled in")
    return found


PARTS = js.Mechanism, js.StaticMechanism, js.Body, js.Joint, js.Frame, js.AppliedForces, js.Tendon
OF_PARTS = {name: f for cls in PARTS for name, f in _methods(cls).items()}
# Modules of converters, and what the examples of each need beside what all tests have.
LIBRARIES = {
    "bodies": None,
    "brax": "brax.base",
    "drake": "pydrake.math",
    "jaxlie": "jaxlie",
    "mujoco": None,
}
LIBRARIES |= {"newton": None, "orders": None, "pinocchio": "pinocchio", "ros": None, "scipy": "scipy.spatial.transform"}
CONVERTERS = {
    f"{module}.{name}": f
    for module in LIBRARIES
    for name, f in _public(getattr(js.interop, module)).items()
    if f.__module__.endswith(f"interop.{module}")
}
DRAWN = {f"plot.{name}": f for name, f in _public(plot).items() if name in plot.__all__}
# All that users import names from, by the prefix of names in this file. Of a converter what it defines is public.
MODULES = {"": js, "inertia.": js.inertia, "regressors.": js.regressors, "testing.": js.testing, "plot.": plot}
MODULES |= {"measure.": js.measure, "interop.": js.interop}
MODULES |= {f"{name}.": getattr(js.interop, name) for name in LIBRARIES}
if importlib.util.find_spec("viser"):
    MODULES["viewer."] = importlib.import_module("jaxspatial.viewer")


def _all_of(prefix, module):
    """The public classes and functions of a module, and the methods of classes that are written in this library."""
    is_converter = prefix[:-1] in LIBRARIES
    for name in getattr(module, "__all__", dir(module)):
        x = getattr(module, name)
        of = getattr(x, "__module__", None) or ""
        if name[0] == "_" or not callable(x) or not of.startswith(module.__name__ if is_converter else "jaxspatial"):
            continue
        yield prefix + name, x
        if inspect.isclass(x):
            yield from ((prefix + own, f) for own, f in _methods(x, "jaxspatial").items())


_ALL = [(cls.__name__, cls) for cls in (MassMatrixFactor, quantity.Quantity)] + list(METHODS.items())
_ALL += [pair for prefix, module in MODULES.items() for pair in _all_of(prefix, module)]
# What several classes inherit, or several modules have, once.
EXAMPLES = {name: x for name, x in {id(x): (name, x) for name, x in reversed(_ALL)}.values()}


@pytest.fixture(scope="module")
def names():
    """What examples need not define: the names that the page of all public names begins with."""
    plot.pyplot.switch_backend("agg")
    with names_of_the_page() as names:
        yield names
    plot.pyplot.close("all")


def _lines(x):
    return doctest.DocTestParser().get_examples(inspect.cleandoc(x.__doc__ or ""))


def _ends_with_an_example(x):
    """Of two to five lines, and what it prints, after all else."""
    doc, examples = inspect.cleandoc(x.__doc__ or ""), _lines(x)
    is_last = "\nExample:\n    >>> " in doc and not re.search(r"^\w", doc.partition("\nExample:\n")[2], re.M)
    lines = sum(len(f"{e.source}{e.want}".splitlines()) for e in examples)
    return is_last and lines in range(2, 8) and bool(examples[-1].want)


def test_all_that_is_public_has_an_example():
    """Every class, function and method that users may call, without exception."""
    assert not [name for name, x in EXAMPLES.items() if not _ends_with_an_example(x)]
    of = {name.partition(".")[0] for name in EXAMPLES}
    assert len(EXAMPLES) > 350 and {"plot", "measure", "testing", "regressors", *LIBRARIES} <= of
    assert {x.name for x in pkgutil.iter_modules(js.interop.__path__)} == set(LIBRARIES)


SLOW = LONG | {"brax.to_tau"}
RUN = [pytest.param(x, marks=[pytest.mark.slow] if x in SLOW else []) for x in sorted(EXAMPLES) if _lines(EXAMPLES[x])]


# Brax reads attributes that MJX has moved, and says that it is no longer developed.
with_brax = pytest.mark.filterwarnings(
    "ignore:Accessing .* from `Data` is deprecated:DeprecationWarning", "ignore:Brax System, piplines:UserWarning"
)


@with_brax
@pytest.mark.parametrize("name", RUN)
def test_an_example_prints_what_it_says(name, names, monkeypatch, tmp_path):
    said = _said(name, names, monkeypatch, tmp_path)
    assert not said, "".join(said)


@pytest.mark.slow
@with_brax
@pytest.mark.parametrize("name", [param.values[0] for param in RUN])
def test_an_example_runs_with_64_bit_types_on(name, monkeypatch, tmp_path):
    """What it prints has more digits, or other ones at the end."""
    with jax.enable_x64(True), names_of_the_page() as names:
        said = "".join(_said(name, names, monkeypatch, tmp_path))
    assert "Exception raised" not in said, said


def _said(name, names, monkeypatch, tmp_path):
    """What doctest says of an example that does not print what it says."""
    said, library = [], LIBRARIES.get(name.partition(".")[0])
    monkeypatch.chdir(tmp_path)
    if name.startswith("viewer."):
        # With it viser shows its address, which is another one when the first port is taken.
        monkeypatch.setattr("rich.print", lambda *_: None)
    if library:
        # While it is imported, Brax's pipeline prints what it misses.
        module = needs("brax.generalized.pipeline" if name == "brax.to_tau" else library)
        if "scipy" in library and "rigid" in name and not hasattr(module, "RigidTransform"):
            pytest.skip("SciPy before 1.16 has no RigidTransform")
    # Of ROS the two classes that it declares.
    monkeypatch.setitem(sys.modules, "geometry_msgs.msg", SimpleNamespace(Vector3=Vector3, Wrench=Wrench))
    # Brax mixes dtypes and ranks.
    strictness = ("standard", "allow") if name.startswith("brax") else ("strict", "raise")
    with jax.numpy_dtype_promotion(strictness[0]), jax.numpy_rank_promotion(strictness[1]), compiled_soon():
        test = doctest.DocTest(_lines(EXAMPLES[name]), dict(names), name, None, None, None)
        doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    return said


def _is_of_another(doc):
    return re.search(r"(as|see|of) `\w+", doc.splitlines()[0]) or "Exact" in doc.splitlines()[0]


def test_a_precision_is_given_by_name():
    """But to what takes nothing else."""
    kinds = {name: inspect.signature(f).parameters.get("precision") for name, f in {**FUNCTIONS, **METHODS}.items()}
    given = {name for name, x in kinds.items() if x is not None and x.kind is not inspect.Parameter.KEYWORD_ONLY}
    assert given == {"default_precision"} and len(kinds) > 100


@pytest.mark.parametrize("cls", CLASSES)
def test_what_takes_no_object_is_static(cls):
    """It can be called by an object too."""
    own = {name: member for base in cls.__mro__[:-1] for name, member in vars(base).items()}
    methods = {name: list(inspect.signature(f).parameters) for name, f in own.items() if inspect.isfunction(f)}
    assert not {name: given for name, given in methods.items() if name[0] != "_" and given[:1] != ["self"]}


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_functions(name):
    assert not faults(FUNCTIONS[name])


@pytest.mark.parametrize("name", sorted(ALGORITHMS))
def test_algorithms_tell_their_source_and_what_they_raise(name):
    doc = inspect.getdoc(FUNCTIONS[name]) or ""
    assert re.search(r"^Source: .", doc, re.M) and re.search(r"^    \w+Error: .", doc, re.M)


@pytest.mark.parametrize("name", sorted(METHODS))
def test_methods(name):
    """What is told of another method is not told again, and what has no parameters has no section of them."""
    doc = inspect.getdoc(METHODS[name]) or ""
    if _is_of_another(doc):
        return
    assert not faults(METHODS[name])


@pytest.mark.parametrize("name", sorted(FUNCTIONS) + sorted(METHODS))
def test_signatures_are_annotated(name):
    signature = inspect.signature((FUNCTIONS | METHODS)[name])
    assert signature.return_annotation is not inspect.Signature.empty
    own = [p for p in signature.parameters.values() if p.name not in ("self", "cls")]
    assert all(p.annotation is not inspect.Parameter.empty for p in own)


@pytest.mark.parametrize("name", sorted(FUNCTIONS) + sorted(METHODS))
def test_signatures_name_unions(name):
    """What `help` opens with: arrays are ArrayLike there, and no list of all that is one."""
    shown = str(inspect.signature((FUNCTIONS | METHODS)[name]))
    assert not re.search("StandIn|SupportsDType", shown) and shown.count("SpatialForce") <= 2


def test_a_named_union_keeps_its_members():
    from jaxspatial.numerics import types

    for alias, member in ((types.ArrayLike, np.ndarray), (ExternalForces, js.AppliedForces)):
        union = getattr(alias, "__value__", None) or alias.__bound__
        assert member in typing.get_args(union) and repr(alias).lstrip("~") in ("ArrayLike", "ExternalForces")


def test_no_riddles():
    """Words that the field has others for."""
    for name, function in (FUNCTIONS | METHODS).items():
        doc = inspect.getdoc(function) or ""
        assert not re.search(r"\b(feels?|felt|pulls on|as told|is told|carried by)\b", doc), name
