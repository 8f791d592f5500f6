"""What the command answers without importing JAX, which takes seconds: questions, and what it was told wrongly."""

import re
import subprocess
import sys

import pytest

from jaxspatial.measure import algorithms, operation, options, trade
from jaxspatial.numerics.precision import Precision

MOVE = ["--offset", "1", "2", "3"]
ANSWERS = {
    "help": (["--help"], "python -m jaxspatial"),
    "help of a job": (["shift", "--help"], "p_x p_y p_z"),
    "help of the check": (["self-check", "--help"], "--json"),
    "no such file": (["no.csv", *MOVE], "^error: no.csv: no such file$"),
    "nothing to shift": (["shift", "no.csv", *MOVE], "^error: no.csv: no such file$"),
    "no such robot": (["--robot", "no.urdf"], "^error: no.urdf: no such file$"),
    "folder": (["shift", ".", *MOVE], "^error: .: expected a file, got a folder$"),
    "folder to measure": ([".", *MOVE], "^error: .: expected a file, got a folder$"),
    "folder above": (["shift", "..", *MOVE], "^error: ..: expected a file, got a folder$"),
    "no name": (["shift", "", *MOVE], "^error: .: expected a file, got a folder$"),
    "folder for a robot": (["--robot", "."], "^error: .: expected a file, got a folder$"),
    "no format": (["shift", "no.txt", *MOVE], "expected a file ending in .npz, .csv or .tsv, got .txt"),
    "wrong option": (["--opration", "dot"], "unrecognized arguments: --opration"),
    "wrong operation": (["--operation", "twist"], "invalid choice: 'twist'"),
    "wrong precision": (["shift", "mine.csv", *MOVE, "--precision", "exact"], "invalid choice: 'exact'"),
    "too few numbers": (["shift", "mine.csv", "--offset", "1"], "expected 3 arguments"),
    "no motion": (["shift", "mine.csv"], "^error: expected --offset X Y Z, "),
    "no offset": (["mine.csv"], "^error: --offset: expected X Y Z, "),
    "no place": (["shift", "mine.csv", *MOVE, "--output", "no/x.csv"], "^error: no: expected a folder to write to$"),
}


@pytest.mark.parametrize(("arguments", "message"), ANSWERS.values(), ids=ANSWERS)
def test_answers_do_without_jax(arguments, message, tmp_path):
    (tmp_path / "mine.csv").write_text("")
    command = [sys.executable, "-X", "importtime", "-m", "jaxspatial", *arguments]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=_with_this_package())
    imported = {m[1] for m in re.finditer(r"^import time:.*\| *(\S+)$", run.stderr, re.M)}
    assert "jaxspatial.measure.options" in imported
    assert not {name.partition(".")[0] for name in imported} & {"jax", "jaxlib", "numpy"}
    said = run.stdout + re.sub(r"^import time:.*\n", "", run.stderr, flags=re.M)
    assert re.search(message, said, re.M) and "Traceback" not in said
    assert run.returncode == (0 if "--help" in arguments else 2)


def _with_this_package():
    return {**__import__("os").environ, "PYTHONPATH": ":".join(path for path in sys.path if path)}


def test_everything_that_is_measured_has_its_name():
    """Named without JAX, and there."""
    assert options.OPERATIONS == tuple(operation.OPERATIONS) and options.ALGORITHMS == tuple(algorithms.ALGORITHMS)
    assert options.DTYPES == trade.DTYPES and options.PRECISIONS == tuple(map(str, Precision))


def test_other_programs_have_all_names(tmp_path):
    """Those run with -m that import the package on the way, whatever they are told."""
    package = tmp_path / "mine"
    package.mkdir()
    (package / "__init__.py").write_text("import sys, jaxspatial as js\nassert sys.argv[0] == '-m'; js.SpatialForce")
    (package / "__main__.py").write_text("import jaxspatial as js; print(js.shift.__name__, js.__version__)")
    command = [sys.executable, "-m", "mine", "-m", "jaxspatial"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=_with_this_package())
    assert run.stdout.startswith("shift ") and not run.returncode, run.stderr
