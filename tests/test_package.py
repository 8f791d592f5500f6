"""What users install: the wheel and the source distribution, built and installed from."""

import importlib.metadata
import pathlib
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from jaxspatial.command import measuring, options, quadruped

pytest.importorskip("hatchling")

ROOT = pathlib.Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
VERSION = PROJECT["version"]
# A wrench moved in an interpreter that finds no other jaxspatial than the installed one.
SCRIPT = """
import importlib.metadata, pathlib, sys
import jax.numpy as jnp
import jaxspatial as js
F, p = js.SpatialForce(f=[1.0, 2.0, 0.0]), jnp.array([2.0, -2.0, 1.0])
assert pathlib.Path(js.__file__).is_relative_to(sys.argv[1]), js.__file__
print(importlib.metadata.version("jaxspatial"), js.shift(F, p).tau)
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """{ending: file} of both distributions."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
    return {path.suffix: path for path in folder.iterdir()}


def test_names_tell_the_version(built):
    assert built[".whl"].name == f"jaxspatial-{VERSION}-py3-none-any.whl"
    assert built[".gz"].name == f"jaxspatial-{VERSION}.tar.gz"


def test_the_wheel_holds_the_package_alone(built):
    files = set(zipfile.ZipFile(built[".whl"]).namelist())
    sources = {str(p.relative_to(ROOT)) for p in (ROOT / "jaxspatial").rglob("*.py")}
    sources |= {"jaxspatial/py.typed", "jaxspatial/command/quadruped.urdf"}
    assert {name for name in files if ".dist-info/" not in name} == sources
    assert any(name.endswith("LICENSE") for name in files)


def test_the_source_holds_what_it_is_built_from(built):
    with tarfile.open(built[".gz"]) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    assert {"pyproject.toml", "README.md", "LICENSE", "jaxspatial/__init__.py", "tests/conftest.py"} <= names


def _brought(texts):
    """The distributions that requirements bring, with all that these need."""
    found, left = set(), [*texts]
    while left:
        requirement = Requirement(left.pop())
        name = canonicalize_name(requirement.name)
        if name not in found and (requirement.marker is None or requirement.marker.evaluate({"extra": ""})):
            found.add(name)
            left += importlib.metadata.requires(name) or ()
    return found


def test_the_command_needs_what_its_extra_brings(monkeypatch):
    """Its robot is read, and what it shows is imported, without the packages of other extras."""
    extras = PROJECT["optional-dependencies"]
    others = {name for extra in ("models", "view", "learn") for name in map(_name, extras[extra])}
    others -= _brought([*PROJECT["dependencies"], *extras["plot"]])
    modules = {x for x, names in importlib.metadata.packages_distributions().items() if others & {*map(_name, names)}}
    assert "mujoco" in modules
    for module in modules | {name for name in sys.modules if name.partition(".")[0] in modules}:
        monkeypatch.setitem(sys.modules, module, None)
    measuring.check_installed(options.to_measure([]), "lxml")
    assert quadruped.mechanism().nv == 18


def _name(text):
    return canonicalize_name(Requirement(text).name)


@pytest.mark.parametrize("ending", [".whl", pytest.param(".gz", marks=pytest.mark.slow)])
def test_it_installs_and_runs(ending, built, tmp_path):
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target"]
    subprocess.run([*install, str(tmp_path / "site"), str(built[ending])], check=True)
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / "site")]
    environment = {"PYTHONPATH": str(tmp_path / "site"), "PATH": "", "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(command, check=True, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout == f"{VERSION} [ 2. -1. -6.]\n"
    assert "jaxspatial.command.main import main" in (tmp_path / "site" / "bin" / "jaxspatial").read_text()
