"""Laws of the precisions that need error-free transforms, and bits, once more without fused multiply-add: on the
instruction set of a machine that has none. What is chosen: see `conftest`.
"""

import os
import pathlib
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).parent


def test_few():
    _run([HERE / "test_error_bounds.py", HERE / "test_reproducible.py"], "without_fma_by_default and not slow")


@pytest.mark.slow
@pytest.mark.parametrize("file", ["test_error_bounds", "test_derivatives", "test_extremes", "test_reproducible"])
def test_all(file):
    _run([HERE / f"{file}.py"], "without_fma")


def _run(files, marks):
    environment = {**os.environ, "XLA_FLAGS": "--xla_cpu_max_isa=AVX"}
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "-m", marks, *files]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=3600)
    assert run.returncode == 0, run.stdout[-4000:]
