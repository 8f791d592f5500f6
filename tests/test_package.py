"""What users install: the wheel and the source distribution, built and installed from."""

import pathlib
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest

pytest.importorskip("hatchling")

ROOT = pathlib.Path(__file__).parent.parent
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
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


@pytest.mark.parametrize("ending", [".whl", ".gz"])
def test_it_installs_and_runs(ending, built, tmp_path):
    install = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--target"]
    subprocess.run([*install, str(tmp_path / "site"), str(built[ending])], check=True)
    command = [sys.executable, "-c", SCRIPT, str(tmp_path / "site")]
    environment = {"PYTHONPATH": str(tmp_path / "site"), "PATH": "", "JAX_PLATFORMS": "cpu"}
    done = subprocess.run(command, check=True, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout == f"{VERSION} [ 2. -1. -6.]\n"
    assert "jaxspatial.command.main import main" in (tmp_path / "site" / "bin" / "jaxspatial").read_text()
