"""The benchmarks still run: every case, on few wrenches. What they claim is asserted by running them, not here."""

import pathlib
import shutil
import subprocess
import sys

import pytest

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
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_c_kernels_compute_what_we_compute(dtype):
    """Both sides of the comparison end in the same numbers: one shift, one power, 16 shifts, there and back."""
    program = f"import sys; sys.path.insert(0, {str(HERE)!r}); import wrench_kernels as k; k.agree({dtype!r})"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
