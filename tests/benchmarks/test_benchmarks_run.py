"""The benchmarks still run: every case, on few wrenches. What they claim is asserted by running them, not here."""

import pathlib
import shutil
import subprocess
import sys

import pytest
from marks import slow

HERE = pathlib.Path(__file__).parent


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
def test_wrench_kernels():
    command = [sys.executable, HERE / "wrench_kernels.py", "--n", "64", "--rounds", "2"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode in (0, 1) and not run.stderr, run.stderr
    for dtype in ("float32", "float64"):
        assert run.stdout.count(dtype) == 4
    assert "16 chained shifts, there and back" in run.stdout


@pytest.mark.skipif(not shutil.which("gcc"), reason="needs gcc")
@pytest.mark.parametrize("dtype", ["float32", slow("float64")])
def test_the_c_kernels_compute_what_we_compute(dtype):
    """Both sides of the comparison end in the same numbers: one shift, one power, 16 shifts, there and back."""
    program = f"import sys; sys.path.insert(0, {str(HERE)!r}); import wrench_kernels as k; k.agree({dtype!r})"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
def test_precisions():
    command = [sys.executable, HERE / "precisions.py", "--n", "640", "--rounds", "2", "--sample", "20"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert run.returncode in (0, 1) and "Traceback" not in run.stderr, run.stderr
    for dtype in ("float32", "float64"):
        assert f"shift, streaming, {dtype}" in run.stdout and f"wrong in all digits, {dtype}" in run.stdout


@pytest.mark.slow
def test_results_of_compensated_and_faithful_are_never_meaningless():
    """What the benchmark asserts without a clock: the table of hostile families, ours never wrong in all digits."""
    program = f"import sys; sys.path.insert(0, {str(HERE)!r}); import precisions as p; p.require_meaning(100)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("g++"), reason="needs g++")
def test_dynamics():
    """All sides, on few states of one robot."""
    for name in ("pinocchio", "mujoco.mjx", "frax"):
        pytest.importorskip(name)
    options = ["--robots", "panda", "--batches", "4", "--dtypes", "float32", "--rounds", "2"]
    run = subprocess.run([sys.executable, HERE / "dynamics.py", *options], capture_output=True, text=True, timeout=1800)
    assert run.returncode == 0 and "Pinocchio C++" in run.stdout, run.stderr


@pytest.mark.slow
def test_robots():
    pytest.importorskip("pinocchio")
    command = [sys.executable, HERE / "robots.py", "double_pendulum"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert run.returncode == 0 and "| double_pendulum | floating |" in run.stdout, run.stderr


def test_mutants_are_drawn_from_the_seed():
    """The same twice, each another program than the one it is made of, and of the folder asked for."""
    pytest.importorskip("cosmic_ray")
    program = "import mutants as m; print([(x.file, x.after) for x in m.sample(6, 1, ['spatial', 'rotation'])])"
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(HERE)!r}); {program}"]
    runs = [subprocess.run(command, capture_output=True, text=True, timeout=300) for _ in range(2)]
    assert runs[0].returncode == 0, runs[0].stderr
    assert runs[0].stdout == runs[1].stdout and runs[0].stdout.count(".py") == 6


@pytest.mark.slow
def test_mutants():
    pytest.importorskip("cosmic_ray")
    command = [sys.executable, HERE / "mutants.py", "--n", "1", "--only", "rotation"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    assert run.returncode in (0, 1) and "1 mutants drawn, 1 run" in run.stdout, run.stderr
