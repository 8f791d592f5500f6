"""What CI runs: every slow test within three days and every night, with versions that pyproject.toml accepts."""

import datetime
import json
import pathlib
import re
import subprocess
import sys
import time
import tomllib
import types

import pytest
from packaging.requirements import Requirement

from tests.conftest import COMPILED_SOON, HERE, LONGEST, pytest_runtest_setup, third_of_day

ROOT = pathlib.Path(__file__).parent.parent
CI, NIGHTLY, HOOKS = (
    (ROOT / name).read_text()
    for name in (".github/workflows/ci.yml", ".github/workflows/nightly.yml", ".pre-commit-config.yaml")
)
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = PYPROJECT["project"]

# The names of the slow tests of one folder: of all, and of each third.
COLLECTED = """
import contextlib, json, sys
import pytest

class Names:
    def pytest_collection_finish(self, session):
        self.found = [item.nodeid for item in session.items]

found = {}
for third in ("", "1", "2", "3", "auto"):
    options = ["--third", third] if third else []
    options += ["-q", "--collect-only", "-n", "0", "-m", "slow", sys.argv[1]]
    with contextlib.redirect_stdout(sys.stderr):
        pytest.main(options, plugins=[names := Names()])
    found[third] = names.found
print(json.dumps(found))
"""


def test_every_slow_test_is_in_one_third():
    command = [sys.executable, "-c", COLLECTED, str(ROOT / "tests" / "interop")]
    found = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    thirds = [found[third] for third in ("1", "2", "3")]
    assert all(thirds) and sorted(sum(thirds, [])) == sorted(found[""])
    assert found["auto"] in thirds


@pytest.mark.parametrize("name", [*LONGEST, *COMPILED_SOON])
def test_files_that_are_treated_apart_are_there(name):
    assert (HERE / name).exists()


def test_three_days_have_three_thirds():
    first = datetime.date(2026, 2, 20)
    days = [third_of_day(first + datetime.timedelta(k)) for k in range(400)]
    assert all({*days[k : k + 3]} == {"1", "2", "3"} for k in range(398))


def test_ci_runs_the_slow_tests():
    """A third after the tests of the default run, and at night each."""
    commands = (ROOT / ".ci" / "run").read_text().splitlines()
    assert "-m pytest -m slow --third auto --minutes" in commands[-1]
    assert "schedule:" in NIGHTLY and "third: [1, 2, 3]" in NIGHTLY
    assert "-m pytest -m slow --third ${{ matrix.third }}" in NIGHTLY


def test_what_begins_too_late_is_skipped():
    config = types.SimpleNamespace(option=types.SimpleNamespace(minutes=2.0), start=time.monotonic() - 115)
    pytest_runtest_setup(types.SimpleNamespace(config=config))
    config.start -= 10
    with pytest.raises(pytest.skip.Exception, match="2 minutes are over"):
        pytest_runtest_setup(types.SimpleNamespace(config=config))


def test_the_hook_has_the_oldest_ruff_that_is_accepted():
    """An older one finds faults in what stands, and formats it otherwise."""
    (pinned,) = re.findall(r"ruff-pre-commit\n(?:\s+#.*\n)*\s+rev: v([\d.]+)\n", HOOKS)
    assert _oldest("ruff") == _numbers(pinned)


def test_ci_has_the_oldest_of_what_users_need():
    (oldest,) = re.findall(r'"((?:[\w-]+==[\d.]+ ?)+)"', CI)
    pinned = dict(name.split("==") for name in oldest.split())
    assert {Requirement(x).name for x in PROJECT["dependencies"]} <= {*pinned}
    assert {name: _oldest(name) for name in pinned} == {name: _numbers(version) for name, version in pinned.items()}


def test_ci_has_every_python_that_is_promised():
    promised = re.findall(r"Python :: (3\.\d+)", "\n".join(PROJECT["classifiers"]))
    assert {*re.findall(r'python: "([\d.]+)"', CI)} == {*promised}
    assert (
        PROJECT["requires-python"] == f">={promised[0]}"
        and PYPROJECT["tool"]["pyright"]["pythonVersion"] == promised[0]
    )
    assert PYPROJECT["tool"]["ruff"]["target-version"] == f"py{promised[0].replace('.', '')}"


def _oldest(name):
    """The oldest version that pyproject.toml accepts, of all places that ask for one."""
    extras = PROJECT["optional-dependencies"].values()
    asked = map(Requirement, [*PROJECT["dependencies"], *sum(extras, [])])
    return max(_numbers(bound.version) for x in asked if x.name == name for bound in x.specifier)


def _numbers(version):
    """Of three numbers: 2.0 is 2.0.0."""
    return (*map(int, version.split(".")), 0, 0)[:3]
